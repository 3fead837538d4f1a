//! A batch: sensors of one design, calibrated one after another at one bench.
//!
//! A batch is a folder with a journal of its own and the run folders of its sensors. The run folders stay the record of what was
//! measured; the journal keeps what was done with which sensor, and the result. An [`Event`] is one record of it.

pub mod chart;
mod event;

pub use event::{Alarm, Began, Cause, Ended, Event, Facts, Found, Session};
