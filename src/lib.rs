//! palpate calibrates tactile sensors. It drives a three-axis stage, a load cell and a sensor array through their real
//! protocols, presses the sensor where a TOML recipe says with the force it says, keeps every press, and solves the inverse
//! problem on what it kept: location and force of unknown contacts.
//!
//! # The house
//!
//! Imports run downward only; rooms on one floor don't know each other (a test holds them to it).
//!
//! | floor | room | what it is |
//! |---|---|---|
//! | 7 | [`cli`] | the command line, one file a subcommand; the only room that prints |
//! | 6 | [`export`] | runs for other programs: frames, files, a lake, C |
//! | 6 | [`report`] | a page about a run, or about many of them |
//! | 6 | [`study`] | the force loop and the solvers measured under many conditions, and drawn |
//! | 5 | [`batch`] | sensors of one design, one after another: journal, state, control charts |
//! | 5 | [`run`] | walks a plan on a rig: prepares, presses, records, parks |
//! | 4 | [`rig`] | a rig file understood; the only place that chooses a real or a simulated link |
//! | 4 | [`dataset`] | the journal, which is the record, and plain tables that are views of it |
//! | 3 | [`recipe`] | a recipe understood, and its plan |
//! | 3 | [`driver`] | one module per instrument family: a role over a link |
//! | 3 | [`emulator`] | one per wire protocol: bytes in, scene, bytes out; never sees a driver |
//! | 2 | [`acceptance`] | whether a sensor is accepted: a rule, what was measured, the one verdict |
//! | 2 | [`control`] | the force loop, pure: the press and its three strategies, its permits, its trips, the learned map |
//! | 2 | [`device`] | the roles as traits: stage, load cell, array |
//! | 2 | [`document`] | TOML read with every problem kept, each at its line |
//! | 2 | [`scene`] | the physics of a simulated rig, pure, advanced in closed form |
//! | 2 | [`solver`] | calibration and reading to contact, and their evaluation |
//! | 2 | [`wire`] | links: how bytes get there and back; NI's functions as a table |
//! | 1 | [`chart`] | charts as SVG |
//! | 1 | [`mechanics`] | linear elasticity: what a taxel reads of a load |
//! | 1 | [`paper`] | what the paper reports |
//! | 1 | [`parallel`] | work shared out to all processors |
//! | 1 | [`quantity`] | the vocabulary, with units |
//!
//! # One press, followed through
//!
//! A recipe becomes a [`recipe::Plan`] of entries. [`run::walk`] takes the next one that isn't recorded, travels there in the
//! clear, and hands what it sees to a [`control::ForceLoop`]: events in, commands out. Each motion toward the specimen carries a
//! [`control::Permitted`] that only a [`control::Permit`] can make, since its end point is safe by itself. A driver turns it
//! into bytes; in a simulated run an emulator at the far end turns them into motions of a [`scene::Scene`]. What comes back is
//! watched, averaged, sampled, and on disk before the next press begins. The repository's ARCHITECTURE.md follows the same
//! press line by line.

pub mod cli;
pub use palpate_control as control;
pub use palpate_core::{mechanics, parallel, quantity};
pub use palpate_data::{acceptance, dataset, recipe};
pub use palpate_document as document;
pub use palpate_drivers as driver;
pub use palpate_link::{device, wire};
pub use palpate_report::{chart, export, paper, report};
pub use palpate_run::{batch, rig, run};
pub use palpate_sim::{emulator, scene};
pub use palpate_solver as solver;
pub use palpate_study as study;
