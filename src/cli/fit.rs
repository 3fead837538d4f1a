//! `palpate fit`: a calibrated sensor as a file.

use super::design::{design_table, design_value};
use super::method::{tell_constant_load, tell_sensor};
use super::output::OutputArgs;
use super::summary::note;
use crate::api::fit::place;
use crate::api::{self, Failure, FittedDesign, MethodOptions};
use palpate_data::dataset::sensor_file::{Card, SensorFile, SensorModel, check_replaceable};
use palpate_solver::HISTORY_METHOD;
use palpate_solver::vector::VECTOR_METHOD;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate fit runs/paper --out sensor.palpate
  palpate fit A.csv B.csv C.csv --out design.palpate
  palpate fit runs/drags --vector --out sensor.palpate
  palpate fit series.csv --history --out skin.palpate
  palpate solve --model sensor.palpate < readings.csv

`solve --model` gives the answers of `solve --calibration`, without fitting. The
file begins with two lines of text: source, valid area and forces. It has 128 MB
at most. If the presses don't fit, readings with a missing output aren't solved.

Sensors of a design get one map, with half-widths for a further sensor.

Forces are those of the load cell. `evaluate` uses the set forces of a run.";

/// Fit a method to a calibration and write the calibrated sensor to a file
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct FitArgs {
    /// A run folder or a table of presses; of a design, one for each sensor
    #[arg(required = true, value_name = "CALIBRATION")]
    calibration: Vec<PathBuf>,
    #[command(flatten)]
    file: SensorFileArgs,
}

/// The sensor file that is written, and how it is fitted.
#[derive(Debug, clap::Args)]
pub(super) struct SensorFileArgs {
    /// Output file; an existing sensor file is replaced
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    #[command(flatten)]
    pub method: MethodOptions,
    #[command(flatten)]
    pub output: OutputArgs,
}

/// Fits, and writes the file.
pub(super) fn fit(args: &FitArgs) -> Result<ExitCode, Failure> {
    let SensorFileArgs { out, method, output } = &args.file;
    check_replaceable(out).map_err(Failure::usage)?;
    let (sensor, sensors) = match args.calibration.as_slice() {
        [one] => (api::fit(one, method, &note)?, Vec::new()),
        several => {
            let FittedDesign { sensor, sensors } = api::fit_design(several, method, &note)?;
            (sensor, sensors)
        }
    };
    tell_sensor(&sensor, true)?;
    if let SensorModel::Contact(model) = &sensor.model {
        tell_constant_load(model)?;
    }
    let file = SensorFile::new(sensor.model, sensor.sensor, sensor.made_from).map_err(Failure::usage)?;
    let (mut text, mut content) = write(&file, out)?;
    if !sensors.is_empty() {
        text = design_table(&sensors) + &text;
        content["sensors"] = design_value(&sensors);
    }
    output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
}

/// Writes a sensor file, and returns what is in it, as text and as an object.
pub(super) fn write(file: &SensorFile, out: &Path) -> Result<(String, Value), Failure> {
    place(file, out)?;
    let Card { method, bytes, keeps_presses, .. } = &file.card;
    let needs_presses = ![VECTOR_METHOD, HISTORY_METHOD].contains(&method.as_str());
    let kept = if *keeps_presses || !needs_presses { "" } else { ", without its presses" };
    let (path, kb) = (out.display(), bytes.div_ceil(1000));
    let text = format!("{path}: {method}, {kb} kB{kept}\nnext: palpate solve --model {path} < readings.csv\n");
    Ok((text, json!({ "file": out, "method": method, "bytes": bytes, "keeps_presses": keeps_presses })))
}
