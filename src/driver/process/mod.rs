//! A program of the user's own that plays a role: one JSON object a line over its standard input and output, as
//! `docs/process.md` has it.

mod port;
mod readers;
mod stage;

pub use port::answer_in;
pub use readers::{ProcessArray, ProcessLoadCell};
pub use stage::ProcessStage;

#[cfg(test)]
mod tests;
