//! Drivers with failing lines and devices, and rigs of every kind.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod axes;
mod bad_line;
mod check_weight;
mod driver_safety;
mod emulate;
#[cfg(unix)]
mod endings;
mod lines;
mod lost_records;
mod monitors;
mod own_profiles;
mod rig_checks;
mod rigs;
mod unplugged;
