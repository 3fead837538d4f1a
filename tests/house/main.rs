//! Checks of the project's own files.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod book;
mod numbers;
mod promises;
mod prose;
mod tiers;
mod words;
