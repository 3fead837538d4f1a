//! `palpate fit`: a calibrated sensor as a file.

use super::exit::Failure;
use super::method::{MethodArgs, Source, tell_left_out};
use super::output::OutputArgs;
use palpate_data::dataset::sensor_file::{Card, SensorFile, SensorFileError, check_replaceable};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate fit runs/paper --out sensor.palpate
  palpate fit grid.csv --solver surrogate --out A-017.palpate
  palpate solve --model sensor.palpate < readings.csv

The file holds the fitted method. `solve --model` gives the same answers as
`solve --calibration`, bit for bit, without fitting. Its first two lines are text:
the source, and the area and the forces that it is valid for. Its size is
128 MB at most. If the presses don't fit into it, readings with a missing
output can't be solved.

Forces are those of the load cell. `evaluate` of a run uses the set forces, as the
paper does, so its cross-validation errors differ slightly.";

/// Fit a method to a calibration and write the calibrated sensor to a file
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct FitArgs {
    /// A run folder, or a table of presses
    calibration: PathBuf,
    /// Output file; an existing sensor file is replaced
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// Fits, and writes the file.
pub(super) fn fit(args: &FitArgs) -> Result<ExitCode, Failure> {
    check_replaceable(&args.out).map_err(Failure::usage)?;
    let source = Source::read(&args.calibration, &args.method)?;
    let model = args.method.fit(&source)?;
    args.method.tell(&source, &model)?;
    args.method.tell_constant_load(&source, &model)?;
    tell_left_out(&source.path, model.fitted())?;
    let made_from = vec![source.fingerprint()?];
    let file = SensorFile::new(model, source.sensor, made_from).map_err(Failure::usage)?;
    let (text, content) = write(&file, &args.out)?;
    args.output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
}

/// Writes a sensor file.
pub(super) fn place(file: &SensorFile, out: &Path) -> Result<(), Failure> {
    file.write(out).map_err(|error| match error {
        SensorFileError::Taken { .. } => Failure::usage(error),
        error => Failure::unwritten(error),
    })
}

/// Writes a sensor file, and returns what is in it, as text and as an object.
pub(super) fn write(file: &SensorFile, out: &Path) -> Result<(String, Value), Failure> {
    place(file, out)?;
    let Card { method, bytes, keeps_presses, .. } = &file.card;
    let kept = if *keeps_presses { "" } else { ", without its presses" };
    let (path, kb) = (out.display(), bytes.div_ceil(1000));
    let text = format!("{path}: {method}, {kb} kB{kept}\nnext: palpate solve --model {path} < readings.csv\n");
    Ok((text, json!({ "file": out, "method": method, "bytes": bytes, "keeps_presses": keeps_presses })))
}
