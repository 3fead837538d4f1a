//! A program of the user that plays a role. It exchanges one JSON object per line over its standard input and output, as
//! described in `docs/reference/process.md`.

mod port;
mod readers;
mod stage;

pub use port::answer_in;
pub use readers::{ProcessArray, ProcessLoadCell};
pub use stage::ProcessStage;

#[cfg(test)]
mod tests;
