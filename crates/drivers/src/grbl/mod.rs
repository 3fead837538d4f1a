//! GRBL 1.1: a CNC frame or a converted printer as a stage. Based on GRBL's interface, commands, settings and jogging documents.
//! grblHAL and FluidNC accept the same lines.

mod firmware;
mod port;
mod report;
mod settings;
mod stage;

pub use firmware::{Build, GrblFirmware};
pub use report::{GrblReport, parse_report};
pub use settings::{AxisCounts, ReportedSettings};
pub use stage::Grbl;

#[cfg(test)]
mod tests;
