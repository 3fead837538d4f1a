//! Cargo considers build dependencies only with a build script.

fn main() {}
