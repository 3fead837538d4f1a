//! Acceptance of a sensor: a [`AcceptanceRule`] with its limits, the [`Measured`] values, and [`judge`], the only function that decides.
//!
//! `run`, `evaluate`, `report` and `certificate` all report the same [`Judgement`]. The terms follow ILAC-G8:09/2019. A *simple*
//! rule compares the figure with the limit. A *guarded* rule compares its one-sided 95 % bound, so that at most 5 % of sensors at
//! a limit are accepted. The module has no side effects: its input is numbers, its output is a verdict.

pub mod bound;
mod judge;
mod rule;

pub use judge::{Judgement, LimitCheck, Measured, SensorVerdict, TestErrors, Worst, judge};
pub use rule::{AcceptanceRule, Decision, Limit, LimitedFigure, limit_used};
