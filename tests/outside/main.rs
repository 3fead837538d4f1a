//! Programs and libraries of others, on the real clock. Tests that need more than Rust are ignored by default (`cargo test --test outside
//! -- --include-ignored` runs them); without the other program they fail.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod book;
mod browser;
mod c_file;
mod certificate;
mod characteristics;
mod daqmx;
mod disk;
mod outliers;
mod programs;
mod references;
mod schemas;
mod servers;
mod shells;
mod skins;
