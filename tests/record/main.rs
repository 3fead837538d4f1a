//! The files on the disk after any event, and how a run continues.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod by_depth;
mod called_sound;
mod changed_rig;
mod checks;
mod damage;
mod drags;
mod foreign;
mod kills;
mod missed;
mod monitors;
mod owner;
mod pauses;
mod provenance;
mod replaced;
mod rerun;
mod signals;
mod three_axes;
mod without_load_cell;
