//! The command line as its user meets it.

#[path = "../support/mod.rs"]
mod support;

mod begin;
mod book;
mod cli;
mod data;
mod import;
mod refusals;
mod shipped;
