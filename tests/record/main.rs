//! What is on the disk after whatever happens, and how a run goes on.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod changed_rig;
mod checks;
mod damage;
mod foreign;
mod kills;
mod owner;
mod pauses;
mod provenance;
mod replaced;
mod rerun;
mod signals;
