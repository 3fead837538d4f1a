//! Universal Robots: an arm as a stage. Based on the RTDE guide, the URScript manual and the Dashboard Server manual (PolyScope 5).
//!
//! The arm moves along straight lines with a fixed orientation, in a frame of three taught points. Each motion is one program with one
//! `movel`. Its start, its way and its end are read by RTDE. The arm can be stopped, but a program starts some 0.1 s late: no motion may
//! need a stop.

mod frame;
mod load_cell;
mod rtde;
mod script;
mod stage;

pub use frame::TaughtFrame;
pub use load_cell::UrForce;
pub use stage::{RobotLinks, RobotSettings, Ur};

#[cfg(test)]
mod tests;
