//! Whether a sensor is accepted: a [`Rule`] with its limits, what was [`Measured`], and [`judge`], the only place that decides.
//!
//! `run`, `evaluate`, `report` and `certificate` all report the same [`Judgement`]. Terms after ILAC-G8:09/2019: a *simple* rule
//! compares the figure with the limit; a *guarded* one compares its one-sided 95 % bound, so that at most 5 % of sensors at a limit
//! are accepted. Pure: numbers in, a verdict out.

pub mod bound;
mod judge;
mod rule;

pub use judge::{Check, Errors, Judgement, Measured, Verdict, Worst, judge};
pub use rule::{Decision, Figure, Limit, Rule};
