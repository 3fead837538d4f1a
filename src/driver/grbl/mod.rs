//! GRBL 1.1: a CNC frame or a converted printer as a stage. Based on GRBL's interface, commands and jogging documents.

mod port;
mod report;
mod stage;

pub use report::{Report, parse_report};
pub use stage::Grbl;

#[cfg(test)]
mod tests;
