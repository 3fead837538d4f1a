//! Reports and studies: what their pages say, and how they look.

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
