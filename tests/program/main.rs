//! The command line as its user sees it.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod begin;
mod book;
mod cli;
mod data;
mod import;
mod output;
mod over_time;
mod protocols;
mod refusals;
mod shipped;
mod which_rig;
