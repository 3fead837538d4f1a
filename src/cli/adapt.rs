//! `palpate adapt`: updates an older calibration, or that of a similar sensor, with a few new presses.

use super::fit::{SensorFileArgs, write};
use super::method::fitted_to;
use super::summary::{note, tell};
use crate::api::Failure;
use crate::api::fit::note_left_out;
use crate::api::method::FitSource;
use miette::{IntoDiagnostic, WrapErr};
use palpate_data::dataset::sensor_file::{SensorFile, check_replaceable};
use palpate_solver::{Adapted, ArrayChange, MeanErrors, Solver as _, TriedUpdate, Update};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate adapt --from runs/monday --with runs/tuesday --out sensor.palpate
  palpate adapt --from sensor of the same family.csv --with few.csv --out A-018.palpate

The command tries the old presses unchanged, with other gains and positions of
units, or corrected by a smooth function of the place; and the new presses alone.
It prints the error of each on new presses that it doesn't know (cross-validated),
and writes the best, or the old calibration if none is better by more than
chance. Half-widths and the limit of a misfit follow from the new presses.

At least 5 new presses are required, without old ones some 20. Spread them over
the area.";

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
    /// Write the file also if the mean place is as good
    #[arg(long)]
    anyway: bool,
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
    let (update, presses, mean_place_mm) = (name(adapted.update), adapted.presses, adapted.mean_place_mm);
    if !adapted.beats_mean_place() {
        let problem = format!("the mean place of the new presses is as good an answer: {mean_place_mm:.3} mm");
        if !args.anyway {
            let help = "press more places, or use --anyway to write the file";
            return Err(Failure::not_accepted(miette::miette!(help = help, "{problem}; nothing is written")));
        }
        note(&problem);
    }
    let errors = |errors: MeanErrors| {
        let force_n = (!is_relative).then_some(errors.force_n);
        json!({ "location_mm": errors.location_mm, "force_n": force_n })
    };
    let (mean_error, units) = (errors(adapted.held_out()), adapted.change.units.clone());
    let candidate = |tried: &TriedUpdate| json!({ "update": name(tried.update), "mean_error": errors(tried.held_out) });
    let candidates: Vec<_> = adapted.tried.iter().map(candidate).collect();
    let made_from = vec![old.fingerprint()?, new.fingerprint()?];
    let file = SensorFile::new(adapted.model, new.sensor, made_from).map_err(Failure::usage)?;
    let (text, file) = write(&file, out)?;
    let content = json!({
        "file": file, "presses": presses, "update": update, "mean_error": mean_error, "candidates": candidates,
        "mean_place_mm": mean_place_mm, "units": units,
    });
    output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
}

/// Name of a way in results.
fn name(update: Update) -> &'static str {
    match update {
        Update::Unchanged => "unchanged",
        Update::CommonGain => "common-gain",
        Update::Gains => "gains",
        Update::GainsAndPlaces => "gains-and-places",
        Update::Corrected => "corrected",
        Update::NewAlone => "new-alone",
    }
}

/// Name of a way in the table.
fn label(update: Update) -> &'static str {
    match update {
        Update::Unchanged => "old calibration, unchanged",
        Update::CommonGain => "old, common gain changed",
        Update::Gains => "old, gains changed",
        Update::GainsAndPlaces => "old, gains and places changed",
        Update::Corrected => "old, corrected from place to place",
        Update::NewAlone => "new presses alone",
    }
}

/// Describes what each way would give on the new presses, and the change of the sensor. Without forces, force errors are omitted.
fn text(adapted: &Adapted, is_relative: bool) -> String {
    let errors = |errors: MeanErrors| match is_relative {
        true => format!("{:.3} mm", errors.location_mm),
        false => format!("{:.3} mm, {:.4} N", errors.location_mm, errors.force_n),
    };
    let row = |tried: &TriedUpdate| {
        let written = if tried.update == adapted.update { "  <- chosen" } else { "" };
        format!("  {:<36}{}{written}\n", label(tried.update), errors(tried.held_out))
    };
    let rows: String = adapted.tried.iter().map(row).collect();
    let mean_place = format!("  {:<36}{:.3} mm\n", "their mean place", adapted.mean_place_mm);
    let change = match adapted.update {
        Update::CommonGain | Update::Gains | Update::Corrected => format!("gains     {}\n", gains(&adapted.change)),
        Update::GainsAndPlaces => {
            format!("gains     {}\nplaces    {}\n", gains(&adapted.change), places(&adapted.change))
        }
        Update::Unchanged | Update::NewAlone => String::new(),
    };
    format!("{} new presses, mean error (cross-validated)\n{rows}{mean_place}{change}", adapted.presses)
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

fn places(change: &ArrayChange) -> String {
    let count = change.units.len() as f64;
    let (x_mm, y_mm) = change.units.iter().fold((0.0, 0.0), |(x, y), unit| (x + unit.x_mm, y + unit.y_mm));
    let farthest = change.units.iter().map(|unit| unit.x_mm.hypot(unit.y_mm)).fold(0.0, f64::max);
    format!("{:+.3}, {:+.3} mm on average; at most {farthest:.3} mm for one unit", x_mm / count, y_mm / count)
}
