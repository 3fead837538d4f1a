//! Solves readings of an array: a contact for each.

use super::choices::ReadingsChoice;
use super::fit::{DEPTH_IS_SOLVED, Sensor, fit, read_sensor};
use super::force_answer::ForceSolutions;
use super::lines::AnswerWriter;
use super::method::MethodOptions;
use super::solutions::{Measure, Solutions};
use super::stream::AnswerStream;
use super::{Failure, Note};
use miette::{IntoDiagnostic, WrapErr};
use palpate_data::dataset::LiveSession;
use palpate_data::dataset::answers::{Answers, ReadingSolver};
use palpate_data::dataset::readings::{Readings, StreamLines};
use palpate_data::dataset::sensor_file::SensorModel;
use palpate_solver::vector::{VectorFits, VectorSession};
use palpate_solver::{HistorySession, Model, Session};
use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Name of the input in messages.
const SOURCE: &str = "stdin";

/// The calibrated sensor, and the form of readings and contacts.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct SolveOptions {
    /// A run folder, or a table of calibration presses
    #[arg(long, value_name = "RUN")]
    pub calibration: Option<PathBuf>,
    /// A sensor file, written by `palpate fit`
    #[arg(long, value_name = "FILE", conflicts_with_all = FITTED_BEFORE)]
    pub model: Option<PathBuf>,
    /// Input format [default: detected from the first character]
    #[arg(long, value_name = "FORMAT", value_enum)]
    pub input: Option<ReadingsChoice>,
    /// Print one JSON object per line instead of CSV
    #[arg(long)]
    pub json: bool,
    /// Answer an invalid line with its problem, and continue
    #[arg(long)]
    pub keep_going: bool,
    /// Don't print which method is used and why
    #[arg(long)]
    pub quiet: bool,
    /// Whether searches for outputs at fault run beside the answers, so that none waits for one. Otherwise the same readings have the same
    /// answers.
    #[arg(skip)]
    pub is_live: bool,
    /// The method, if no sensor file is named.
    #[command(flatten)]
    pub method: MethodOptions,
}

/// Options that a sensor file has already fixed.
const FITTED_BEFORE: [&str; 9] = [
    "calibration",
    "solver",
    "constant_load",
    "quantity",
    "common_offset",
    "false_alarms",
    "forces_n",
    "vector",
    "history",
];

impl SolveOptions {
    /// Reads the sensor file, or fits the method to the calibration.
    ///
    /// # Errors
    /// Bad input, or neither is named.
    pub fn sensor(&self, note: Note<'_>) -> Result<Sensor, Failure> {
        let note: Note<'_> = &|text| {
            // an output that is excluded is noted all the same
            if !(self.quiet && text == DEPTH_IS_SOLVED) {
                note(text);
            }
        };
        match (&self.model, &self.calibration) {
            (Some(file), _) => read_sensor(file, note),
            (None, Some(calibration)) => fit(calibration, &self.method, note),
            (None, None) => {
                let help =
                    "add --model FILE, a sensor file of `palpate fit`, or --calibration RUN, a run folder or a table";
                Err(Failure::usage(miette::miette!(help = help, "`solve` needs a calibrated sensor")))
            }
        }
    }
}

/// Answers each line of `readings` with a line of `contacts` as soon as it arrives, like `palpate solve`.
///
/// # Errors
/// An invalid line, unless [`SolveOptions::keep_going`] is set, or contacts that can't be written. All earlier contacts are written.
pub fn solve(
    model: impl Into<SensorModel>,
    options: &SolveOptions,
    readings: impl Read,
    contacts: impl Write,
    note: Note<'_>,
) -> Result<(), Failure> {
    let SolveOptions { json, keep_going, .. } = *options;
    match model.into() {
        SensorModel::Contact(model) => {
            let solutions = Solutions::new(contacts, json, keep_going, Measure::of(&model)).of_methods(model.fitted());
            let units = model.validity().units;
            let session = Session::new(*model);
            match options.is_live {
                true => answer(LiveSession::new(session), units, options, readings, solutions, note),
                false => answer(session, units, options, readings, solutions, note),
            }
        }
        SensorModel::Vector(model) => {
            let (solutions, units) = (ForceSolutions::new(contacts, json, keep_going), model.validity().units);
            let session = VectorSession::new(Arc::new(VectorFits::new(*model)));
            answer(session, units, options, readings, solutions, note)
        }
        SensorModel::History(model) => {
            let (solutions, units) = (ForceSolutions::new(contacts, json, keep_going), model.validity().units);
            answer(HistorySession::new(model), units, options, readings, solutions, note)
        }
    }
}

/// Returns the mean time of an answer, ns, from the text of a reading to the text of its contact. `None` without readings.
pub fn ns_per_answer<'r>(model: Model, readings: impl Iterator<Item = &'r [f64]>) -> Option<f64> {
    let number = |output: &f64| output.to_string();
    let line = |outputs: &[f64]| outputs.iter().map(number).collect::<Vec<_>>().join(",") + "\n";
    let lines: Vec<String> = readings.map(line).collect();
    let options = SolveOptions { quiet: true, ..SolveOptions::default() };
    let began = Instant::now();
    solve(model, &options, lines.concat().as_bytes(), io::sink(), &|_| {}).ok()?;
    (!lines.is_empty()).then(|| began.elapsed().as_nanos() as f64 / lines.len() as f64)
}

fn answer<S: ReadingSolver>(
    session: S,
    units: usize,
    options: &SolveOptions,
    readings: impl Read,
    mut solutions: impl AnswerWriter<S::Solution>,
    note: Note<'_>,
) -> Result<(), Failure> {
    let SolveOptions { input, json, keep_going, quiet, .. } = *options;
    let of = Readings::new(SOURCE, units, input.map(Into::into), options.method.mapping()?);
    let with_reasons = !(quiet || json || keep_going);
    let stream = AnswerStream { source: SOURCE, keep_going, with_reasons, note, is_refused: |_| false };
    let mut answers = Answers::new(of, session);
    match stream.answer(&mut answers, &mut StreamLines::new(SOURCE, readings), &mut solutions) {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(Failure::usage(error)),
        Err(error) => unwritten(error),
    }
}

/// Returns the failure of an output. A closed output isn't an error.
fn unwritten(error: io::Error) -> Result<(), Failure> {
    match error.kind() {
        io::ErrorKind::BrokenPipe => Ok(()),
        _ => Err(error).into_diagnostic().wrap_err("can't write the contacts").map_err(Failure::unwritten),
    }
}
