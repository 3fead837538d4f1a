//! Programs and libraries of others, on the real clock.

#[path = "../support/mod.rs"]
mod support;

mod daqmx;
mod emulate;
mod outliers;
mod programs;
mod schemas;
mod servers;
mod skins;
