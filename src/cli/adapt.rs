//! `palpate adapt`: updates an older calibration, or that of a similar sensor, with a few new presses.

use super::fit::{SensorFileArgs, write};
use super::method::fitted_to;
use super::summary::{note, tell};
use crate::api::Failure;
use crate::api::fit::note_left_out;
use crate::api::method::FitSource;
use miette::{IntoDiagnostic, WrapErr};
use palpate_data::dataset::sensor_file::{SensorFile, check_replaceable};
use palpate_solver::{Adapted, ArrayChange, Extent, MeanErrors, NewPressErrors, Solver as _};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate adapt --from runs/monday --with runs/tuesday --out sensor.palpate
  palpate adapt --from sensor of the same family.csv --with few.csv --out A-018.palpate

The old presses are corrected to what the sensor would read now: each unit's gain
and position change where the new presses show a change. Then the method is
fitted to them. At least 5 new presses are required. Spread them over the
area, one near each unit if possible.

The command prints the changes and two mean errors on the new presses: with the
old calibration, and with the updated one (cross-validated). Gains and positions
of single units change only where this lowers the second error by more than
chance. The file's 68 % half-widths contain 68 % of these errors.";

/// Update an older calibration, or that of a similar sensor, with a few new presses
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct AdaptArgs {
    /// The older calibration: a run folder, a table of presses or a sensor file
    #[arg(long, value_name = "RUN")]
    from: PathBuf,
    /// The new presses: a run folder or a table
    #[arg(long, value_name = "RUN")]
    with: PathBuf,
    #[command(flatten)]
    file: SensorFileArgs,
}

/// Changes the old presses, fits, and writes the file.
pub(super) fn adapt(args: &AdaptArgs) -> Result<ExitCode, Failure> {
    let SensorFileArgs { out, method, output } = &args.file;
    for (is_given, option, what) in
        [(method.vector, "--vector", "force vectors"), (method.history, "--history", "series of readings")]
    {
        if is_given {
            let help = format!("fit the new presses alone: palpate fit RUN {option} --out FILE");
            return Err(Failure::usage(miette::miette!(help = help, "`adapt` doesn't know {what}")));
        }
    }
    check_replaceable(out).map_err(Failure::usage)?;
    let old = FitSource::read_older(&args.from, method, &note)?;
    let new = FitSource::read(&args.with, method, &note)?;
    let setting = method.setting(&old)?;
    let adapted = Adapted::new(method.solver(), &old.calibration, &new.calibration, &setting).into_diagnostic();
    let adapted = adapted
        .wrap_err_with(|| format!("{}: can't update this calibration", old.path.display()))
        .map_err(Failure::usage)?;
    tell(&format!("{}\n", fitted_to(adapted.model.fitted().name(), adapted.model.validity())))?;
    note_left_out(&old.path, adapted.model.fitted(), &note);
    let is_relative = old.is_relative || new.is_relative;
    output.text(&text(&adapted, is_relative))?;
    let NewPressErrors { presses, before, after } = adapted.held_out;
    let errors = |errors: MeanErrors| {
        let force_n = (!is_relative).then_some(errors.force_n);
        json!({ "location_mm": errors.location_mm, "force_n": force_n })
    };
    let (before, after, units) = (errors(before), errors(after), adapted.change.units.clone());
    let made_from = vec![old.fingerprint()?, new.fingerprint()?];
    let file = SensorFile::new(adapted.model, new.sensor, made_from).map_err(Failure::usage)?;
    let (text, file) = write(&file, out)?;
    let content =
        json!({ "file": file, "presses": presses, "mean_error_before": before, "mean_error": after, "units": units });
    output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
}

/// Describes the change of the sensor, and the errors at the new presses. Without forces, force errors are omitted.
fn text(adapted: &Adapted, is_relative: bool) -> String {
    let Adapted { change, extent, held_out: NewPressErrors { presses, before, after }, .. } = adapted;
    let errors = |errors: &MeanErrors| match is_relative {
        true => format!("{:.3} mm", errors.location_mm),
        false => format!("{:.3} mm, {:.4} N", errors.location_mm, errors.force_n),
    };
    format!(
        "gains     {}\nplaces    {}\n{presses} new presses, mean error\n  with the old calibration  {}\n  \
         updated                   {} (cross-validated)\n",
        gains(change),
        places(change, *extent),
        errors(before),
        errors(after)
    )
}

fn gains(change: &ArrayChange) -> String {
    let numbered = || change.units.iter().map(|unit| unit.gain).enumerate();
    let mean = numbered().map(|(_, gain)| gain).sum::<f64>() / change.units.len() as f64;
    let (Some((low, least)), Some((high, most))) =
        (numbered().min_by(|a, b| a.1.total_cmp(&b.1)), numbered().max_by(|a, b| a.1.total_cmp(&b.1)))
    else {
        return String::new();
    };
    if least == most {
        return format!("x {mean:.3}, the same for all units");
    }
    format!("x {mean:.3} on average; from x {least:.3} (unit {}) to x {most:.3} (unit {})", low + 1, high + 1)
}

fn places(change: &ArrayChange, extent: Extent) -> String {
    if extent != Extent::GainsAndPlaces {
        return "unchanged: moving them would not lower the cross-validated error".to_owned();
    }
    let count = change.units.len() as f64;
    let (x_mm, y_mm) = change.units.iter().fold((0.0, 0.0), |(x, y), unit| (x + unit.x_mm, y + unit.y_mm));
    let farthest = change.units.iter().map(|unit| unit.x_mm.hypot(unit.y_mm)).fold(0.0, f64::max);
    format!("{:+.3}, {:+.3} mm on average; at most {farthest:.3} mm for one unit", x_mm / count, y_mm / count)
}
