//! The command line of palpate, which calibrates tactile sensors. It drives a three-axis stage, a load cell and a sensor array through
//! their real protocols, presses the sensor where a TOML recipe says with the force it says, records every press, and solves place
//! and force of unknown contacts.
//!
//! [`api`] has the commands as functions; [`cli`] turns words into their options, and results into text.
//!
//! The work is done by the crates below: `palpate-run` executes a recipe on a rig, `palpate-data` keeps the record, `palpate-solver`
//! finds contacts. The repository's ARCHITECTURE.md lists them all, and follows one press through them.

#![forbid(unsafe_code)]

pub mod api;
pub mod cli;
