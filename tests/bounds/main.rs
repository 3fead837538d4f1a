//! Bounds of memory and time for everything from outside.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

use cap::Cap;
use counting::Counting;

mod allocations;
#[cfg(target_os = "linux")]
mod cost;
mod counting;
mod fuzz;
mod fuzz_files;
mod long_plan;
mod memory;

#[global_allocator]
static HEAP: Cap<Counting> = Cap::new(Counting, usize::MAX);
