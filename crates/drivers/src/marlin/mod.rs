//! Marlin 2: a 3D printer as a stage. Based on Marlin's G-code documents and its serial protocol.
//!
//! A printer finishes each motion that it accepted, and reports where its queue ends. So the driver sends one motion at a time, waits for
//! its end (`M400`), and reads the counted steps back (`M114`). A stop sends nothing: the motion under way ends at its own end point.

mod port;
mod report;
mod stage;

pub use stage::{LEAST_STEPS, Marlin};

#[cfg(test)]
mod tests;
