//! Content and look of reports and studies.
#![allow(clippy::print_stdout, reason = "campaigns print their numbers")]

mod ablation;
mod batch;
mod certificate;
mod curves;
mod figures;
mod report;
mod sensor;
mod sensors;
mod study;
mod validation;
mod vectors;
