//! NI-DAQmx (USB-6343 and similar devices): the load cell, the array or both as analog inputs of one task, sampled with the
//! device's own clock.

mod acquisition;
mod roles;
#[cfg(test)]
mod tests;

pub use acquisition::{Acquisition, Inputs, Terminal};
pub use roles::{DaqmxArray, DaqmxLoadCell, Sensitivity, SharedAcquisition};
