//! Programs and libraries of others, on the real clock. A test that needs something besides Rust is ignored unless it is asked for
//! (`cargo test --test outside -- --include-ignored`), and fails then where that is missing.
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
