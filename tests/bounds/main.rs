//! Bounds of memory and time for everything from outside.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

use cap::Cap;
use std::alloc::System;

mod allocations;
mod fuzz;
mod fuzz_files;
mod long_plan;
mod memory;

#[global_allocator]
static HEAP: Cap<System> = Cap::new(System, usize::MAX);
