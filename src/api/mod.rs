//! The work of the commands as functions: options in, results out. The command line and the Python package call them.
//!
//! Nothing is printed, no signal is handled, and no person is asked. Each function takes its options as a struct, whose documentation is
//! the help of the command line: an option stands once. A line that a person should read is passed to a [`Note`]. A [`Failure`] has
//! a [`FailureKind`], which is the exit code of the command.

mod accept;
mod batch;
mod certificate;
mod choices;
mod columns;
mod design;
mod evaluate;
pub mod events;
mod failure;
mod figure_files;
pub(crate) mod fit;
pub(crate) mod force_answer;
mod forces;
mod history;
mod holdout;
pub(crate) mod labels;
pub(crate) mod lines;
pub(crate) mod method;
pub(crate) mod protocols;
pub(crate) mod provenance;
pub(crate) mod recorded;
mod removed;
pub(crate) mod report;
mod results;
pub(crate) mod run;
pub(crate) mod shipped;
pub(crate) mod solutions;
mod solve;
pub(crate) mod sources;
pub(crate) mod stdin;
pub(crate) mod stream;
mod vectors;
pub(crate) mod which_rig;
pub(crate) mod which_way;

pub use accept::AcceptOptions;
pub use batch::batch_status;
pub use certificate::{CertificateOptions, Certified, certificate};
pub use choices::{
    DurabilityChoice, EvaluateChoice, ExportChoice, QuantityChoice, ReadingsChoice, RepeatabilityChoice, SoundRule,
    choice, strategy,
};
pub use columns::ColumnsOptions;
pub use design::{FittedDesign, LeftOutSensors, Named, fit_design};
pub use evaluate::{EvaluateOptions, Evaluated, SolverOutcome, evaluate};
pub use failure::{Failure, FailureKind};
pub use fit::{Sensor, fit, read_sensor, write_sensor};
pub use force_answer::vector_numbers;
pub use forces::ForcesEvaluated;
pub use holdout::HoldoutOptions;
pub use labels::LabelOptions;
pub use method::MethodOptions;
pub use palpate_data::dataset::sensor_file::SensorModel;
pub use provenance::built_from;
pub use recorded::{read_run, read_table};
pub use report::{ReportOptions, ReportPage, report};
pub use results::RunResults;
pub use run::{MannerOptions, OpenedRun, ResumeOptions, Resumed, RunOptions, begin, resume, run};
pub use solutions::{Measure, NUMBERS, UNSOLVED, numbers};
pub use solve::{SolveOptions, ns_per_answer, solve};
pub use sources::RigOptions;
pub use vectors::VectorEvaluation;
pub use which_way::{ConfirmOptions, Confirmed};

/// Receives the lines that a command prints about its input, without an end of line: notes, and warnings that begin with `warning: `.
pub type Note<'a> = &'a dyn Fn(&str);

#[cfg(test)]
mod tests;
