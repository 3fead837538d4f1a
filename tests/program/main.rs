//! The command line as its user meets it.

mod begin;
mod book;
mod cli;
mod data;
mod import;
mod output;
mod refusals;
mod shipped;
mod which_rig;
