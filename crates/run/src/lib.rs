//! Runs on a rig. This is the one crate that knows real and simulated devices.
//!
//! | module | what it is |
//! |---|---|
//! | [`rig`] | a rig file; the only place that chooses a real or a simulated link |
//! | [`run`] | executes a plan on a rig: prepares, presses, records, parks |
//! | [`batch`] | sensors of one design, one after another: journal, state, control charts |

#![forbid(unsafe_code)]

pub mod batch;
pub mod rig;
pub mod run;
