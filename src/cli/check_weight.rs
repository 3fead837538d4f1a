//! `palpate doctor --check-weight-n`: what is asked of a person, what a known weight showed, and what the rig file then says.

use super::rig_file::{check_text, replace};
use super::summary::tell;
use super::tables::filled;
use crate::api::Failure;
use jiff::ZonedDateTime;
use miette::IntoDiagnostic;
use palpate_core::quantity::round;
use palpate_core::quantity::{AxesCheck, Axis, CROSSTALK_MOST, GAIN_OFF_MOST, WeightCheck};
use palpate_run::rig::RigSpec;
use palpate_run::run::{
    Ask, AxesMeasurement, FINGER_WAIT, KnownWeight, LoadCellVerdict, WEIGHT_TIMES, WEIGHT_WAIT, WeightMeasurement,
    WeightResult, judged,
};
use serde::Serialize;
use std::path::Path;
use toml_edit::{DocumentMut, InlineTable, Item, Value, value};

/// Assumed uncertainty of a weight without a given uncertainty, as a fraction of the weight. Its force may have been computed
/// from its mass with 9.81 m/s^2, for any location on earth.
const UNSTATED_SHARE: f64 = 0.005;

/// Largest expanded uncertainty of a weight with which a gain can be checked, as a fraction of the weight.
const U_SHARE_MOST: f64 = 0.02;

/// Number of digits after the decimal point of a gain in a rig file.
const GAIN_DECIMALS: i32 = 6;

/// Names of the three axes.
const AXES: [&str; 3] = ["x", "y", "press"];

/// A check of the load cell with a known weight.
#[derive(Debug, clap::Args)]
pub(super) struct WeightArgs {
    /// Check the load cell with a weight of this force, N; palpate asks when to put it on the tip
    #[arg(long, value_name = "N")]
    check_weight_n: Option<f64>,
    /// Expanded uncertainty (k = 2) of the weight's force, N [default: 0.5 % of the force]
    #[arg(long, value_name = "N", requires = "check_weight_n")]
    check_weight_u_n: Option<f64>,
    /// The weight acts in the direction of contact (default)
    #[arg(long, requires = "check_weight_n", conflicts_with = "pull")]
    push: bool,
    /// The weight hangs from the tip and acts against the direction of contact
    #[arg(long, requires = "check_weight_n")]
    pull: bool,
    /// Then measure along x and along y too: the crosstalk of three axes
    #[arg(long, requires = "check_weight_n")]
    pub three_axes: bool,
    /// From now on, divide readings by the gain that this check measures
    #[arg(long, requires = "check_weight_n")]
    adjust: bool,
}

/// What came of a check.
pub(super) struct Concluded {
    /// For a person.
    pub text: String,
    /// For a program.
    pub json: WeightJson,
    /// Why the load cell can't be trusted.
    pub failure: Option<Failure>,
}

/// What `--json` prints of a check.
#[derive(Serialize)]
pub(super) struct WeightJson {
    weight_n: f64,
    weight_u_n: f64,
    pull: bool,
    gains: Vec<f64>,
    gain: f64,
    gain_sd: f64,
    gain_u: f64,
    off: f64,
    explained: f64,
    verdict: &'static str,
    cause: Option<&'static str>,
    written: bool,
}

impl WeightArgs {
    /// The weight that is asked for, if one is.
    pub(super) fn weight(&self, rig: &RigSpec) -> Result<Option<KnownWeight>, Failure> {
        let Some(weight_n) = self.check_weight_n else { return Ok(None) };
        let limit_n = rig.limits.force_n;
        // written as the positive condition, so NaN fails
        let is_borne = weight_n > 0.0 && weight_n <= limit_n;
        if !is_borne {
            let help = "use a lighter weight; nothing was moved";
            let text = miette::miette!(
                help = help,
                "--check-weight-n is {weight_n} N; it must be above 0 and at most the rig's force limit of {limit_n} N"
            );
            return Err(Failure::usage(text));
        }
        let (u_n, most_n) = (self.check_weight_u_n.unwrap_or(UNSTATED_SHARE * weight_n), U_SHARE_MOST * weight_n);
        let is_known = u_n > 0.0 && u_n <= most_n;
        if !is_known {
            let help = "use a weight with a smaller uncertainty; nothing was moved";
            let text = miette::miette!(
                help = help,
                "--check-weight-u-n is {u_n} N; it must be above 0 and at most {most_n} N, {} % of the weight",
                100.0 * U_SHARE_MOST
            );
            return Err(Failure::usage(text));
        }
        if self.three_axes && rig.load_cell.axes.is_none() {
            let text =
                miette::miette!(help = "remove it; nothing was moved", "--three-axes: the load cell has one axis");
            return Err(Failure::usage(text));
        }
        Ok(Some(KnownWeight { weight_n, u_n, pull: self.pull, along: Axis::Z }))
    }
}

/// Asks a person for the weight. A closed standard error stops nothing: the cell shows what was done.
pub(super) fn ask(what: Ask) {
    let wait_s = if what == Ask::Finger { FINGER_WAIT } else { WEIGHT_WAIT }.as_secs();
    let _ = match what {
        Ask::Finger => {
            tell(&format!("press the tip lightly with a finger, as a contact would: waiting up to {wait_s} s\n"))
        }
        Ask::PutOn(time, KnownWeight { weight_n, pull, along, .. }) => {
            let how = match (along, pull) {
                (Axis::X, _) => {
                    "let the weight pull the tip toward +x of the specimen, over a pulley or with the cell rotated"
                }
                (Axis::Y, _) => "let the weight pull the tip toward +y of the specimen",
                (Axis::Z, true) => "hang the weight from the tip",
                (Axis::Z, false) => "put the weight on the tip",
            };
            tell(&filled(&format!("{how} ({weight_n} N, {time} of {WEIGHT_TIMES}): waiting up to {wait_s} s"), "  "))
        }
        Ask::TakeOff(time) => {
            tell(&format!("take the weight off ({time} of {WEIGHT_TIMES}): waiting up to {wait_s} s\n"))
        }
    };
}

/// Describes the crosstalk of three axes, and writes it to the rig file, which has just been written with the weight.
pub(super) fn concluded_axes(
    weighed: &AxesMeasurement,
    (file, invented): (&Path, bool),
) -> Result<(String, AxesCheck), Failure> {
    let found = weighed.check(&ZonedDateTime::now().date().to_string());
    let along = found.along.map(|row| row.map(|number| round(number, GAIN_DECIMALS)));
    let found = AxesCheck { along, u: round(found.u, GAIN_DECIMALS), ..found };
    let mut lines = format!("\n{:<11}{:<12}{:>10}{:>10}{:>10}\n", "axes", "force along", "x", "y", "press");
    for (name, [x, y, press]) in AXES.iter().zip(along) {
        lines += &format!("{:<11}{name:<12}{x:>10.4}{y:>10.4}{press:>10.4}\n", "");
    }
    let (most, force, reading) = found.crosstalk();
    let percent = 100.0 * most;
    lines += &format!("{:<11}readings per newton; standard uncertainty {:.5}\n", "", found.u);
    lines +=
        &format!("{:<11}largest crosstalk {percent:+.2} %: a force along {} on {}\n", "", AXES[force], AXES[reading]);
    if most.abs() > CROSSTALK_MOST {
        lines += &format!(
            "{:<11}over {} %: check the mounting, or state the cell's `matrix` in `axes`\n",
            "",
            100.0 * CROSSTALK_MOST
        );
    }
    let gains = [0, 1, 2].map(|axis| found.along[axis][axis]);
    if let Some(axis) = (0..3).find(|axis| (gains[*axis] - 1.0).abs() > GAIN_OFF_MOST) {
        let help = "check `axes` of [load_cell], its matrix and its unit; nothing was written";
        let text = format!("a force of 1 N along {} reads {:.3} N on its own axis", AXES[axis], gains[axis]);
        tell(&lines)?;
        return Err(Failure::untrusted(miette::miette!(help = help, "checking the axes of the load cell: {text}")));
    }
    if invented {
        return Ok((lines + "not written: it is that of a simulated load cell\n", found));
    }
    let text = std::fs::read_to_string(file).into_diagnostic().map_err(Failure::usage)?;
    let mut document: DocumentMut = text.parse::<DocumentMut>().into_diagnostic().map_err(Failure::usage)?;
    let rows = along.map(Value::from_iter);
    let mut table = InlineTable::new();
    table.insert("along", Value::from_iter(rows));
    table.insert("u", Value::from(found.u));
    table.insert("date", Value::from(found.date.as_str()));
    table.fmt();
    document["load_cell"]["axes_check"] = value(table);
    let changed = document.to_string();
    check_text(file, &changed)?;
    replace(file, &text, &changed)?;
    Ok((format!("{lines}written: `axes_check` of [load_cell] in {}\n", file.display()), found))
}

/// Judges what a weight showed and writes it to the rig file: `place` is the file, the text that was read of it, and whether
/// emulators stand in for real links.
pub(super) fn concluded(
    args: &WeightArgs,
    weighed: &WeightMeasurement,
    rig: &RigSpec,
    (file, text, invented): (&Path, &str, bool),
) -> Result<Concluded, Failure> {
    let found = weighed.check(&ZonedDateTime::now().date().to_string(), false);
    let (gain, gain_sd) = (round(found.gain, GAIN_DECIMALS), round(found.gain_sd, GAIN_DECIMALS));
    let found = WeightCheck { gain, gain_sd, ..found };
    let before = rig.load_cell.check.as_ref();
    let certificate = rig.load_cell.certificate.as_ref();
    let judged = judged(&found, before, certificate);
    let check = WeightCheck { adjusted: args.adjust && found.is_adjustable(), ..found };
    let adjusted_before = before.filter(|before| before.adjusted).map(|before| before.gain);
    // the gain for adjustment is changed only on request, or if it is wrong
    let stays = judged.verdict == LoadCellVerdict::Verified && !check.adjusted && adjusted_before.is_some();
    let unwritten = match (stays, invented) {
        (true, _) => Some("the rig's `check` is unchanged"),
        (false, true) => Some("not written: the gain of a simulated load cell doesn't apply to a real one"),
        _ => None,
    };
    if unwritten.is_none() {
        let changed = with_check(text, &check).into_diagnostic().map_err(Failure::usage)?;
        check_text(file, &changed)?;
        replace(file, text, &changed)?;
    }
    let written = format!("written: `check` of [load_cell] in {}", file.display());
    let text = format!("{}\n{}\n", described(&check, judged, adjusted_before), unwritten.unwrap_or(&written));
    let json = json(&check, judged, weighed, unwritten.is_none());
    let failure = if check.adjusted { None } else { failure(&check, judged, check.is_sound(certificate)) };
    Ok(Concluded { text, json, failure })
}

/// Describes the result of a weight for a person.
fn described(check: &WeightCheck, judged: WeightResult, adjusted_before: Option<f64>) -> String {
    let WeightCheck { weight_n, weight_u_n, gain, gain_sd, times, adjusted, .. } = check;
    let WeightResult { verdict, off, explained } = judged;
    let (off_percent, explained_percent) = (100.0 * off, 100.0 * explained);
    let from = adjusted_before.map_or_else(String::new, |gain| format!(" (adjusted by {gain})"));
    let verdict = match verdict {
        LoadCellVerdict::Verified => {
            format!("verified: {off_percent:+.2} %{from}; uncertainty allows {explained_percent:.2} %")
        }
        LoadCellVerdict::Off => {
            format!("off by {off_percent:+.2} %{from}; uncertainty allows {explained_percent:.2} %")
        }
        LoadCellVerdict::WrongSign => "its sign is wrong".to_owned(),
        LoadCellVerdict::Fault(_) => "a fault: too large to adjust".to_owned(),
    };
    let mut lines = vec![
        format!("{gain:.4} of a weight of {weight_n} N (U = {weight_u_n} N, k = 2)"),
        format!("standard uncertainty {:.5}; {gain_sd:.5} (sd) of {times} repeats", check.standard_uncertainty()),
        verdict,
    ];
    if *adjusted {
        lines.push(format!("adjusted: readings are divided by {gain} from now on"));
    }
    let line = |(n, line): (usize, &String)| format!("{:<11}{line}\n", if n == 0 { "gain" } else { "" });
    format!("\n{}", lines.iter().enumerate().map(line).collect::<String>())
}

/// Returns the result of a weight for a program.
fn json(check: &WeightCheck, judged: WeightResult, weighed: &WeightMeasurement, written: bool) -> WeightJson {
    let (verdict, cause) = match judged.verdict {
        _ if check.adjusted => ("adjusted", None),
        LoadCellVerdict::Verified => ("verified", None),
        LoadCellVerdict::Off => ("off", None),
        LoadCellVerdict::WrongSign => ("wrong-sign", None),
        LoadCellVerdict::Fault(cause) => ("fault", cause),
    };
    WeightJson {
        weight_n: check.weight_n,
        weight_u_n: check.weight_u_n,
        pull: check.pull,
        gains: weighed.gains.clone(),
        gain: check.gain,
        gain_sd: check.gain_sd,
        gain_u: check.standard_uncertainty(),
        off: judged.off,
        explained: judged.explained,
        verdict,
        cause,
        written,
    }
}

/// Returns the reason why the load cell can't be trusted after a check, with advice. `is_sound` states whether a run uses the
/// present gain.
fn failure(check: &WeightCheck, judged: WeightResult, is_sound: bool) -> Option<Failure> {
    let WeightCheck { gain, weight_n, pull, .. } = check;
    let (text, help) = match judged.verdict {
        LoadCellVerdict::Verified => return None,
        LoadCellVerdict::Off => {
            let (off_percent, explained_percent) = (100.0 * judged.off, 100.0 * judged.explained);
            let text =
                format!("its gain is off by {off_percent:+.2} %, but the uncertainty is only {explained_percent:.2} %");
            let help = if is_sound {
                "readings are no longer adjusted: the cell is correct without it. Was it repaired?"
            } else {
                "add --adjust, or repair the cell and check it again"
            };
            (text, help.to_owned())
        }
        LoadCellVerdict::WrongSign => {
            let (acted, read, other) =
                if *pull { ("pulled", "positive", "--push") } else { ("pressed", "negative", "--pull") };
            let text =
                format!("its sign is wrong. The weight {acted}, but the cell read {read} ({gain:.3} of the weight)");
            (
                text,
                format!("swap the cell's signal wires or set its sign; if the weight acted the other way, add {other}"),
            )
        }
        LoadCellVerdict::Fault(cause) => {
            let most_percent = 100.0 * GAIN_OFF_MOST;
            let text = format!(
                "it read {gain:.4} of the weight. An error over {most_percent} % is a fault and isn't adjusted"
            );
            let help = match cause {
                Some(cause) => format!("probable cause: {cause}"),
                None => {
                    "check that the transmitter's range matches the cell's rating plate, and that the weight is correct"
                        .to_owned()
                }
            };
            (text, help)
        }
    };
    let until = if is_sound { "" } else { ". Until then palpate refuses to run on this rig" };
    let help = format!("{help}{until}");
    Some(Failure::untrusted(miette::miette!(help = help, "checking the load cell with {weight_n} N: {text}")))
}

/// Returns the rig's text with the check. Everything else, including comments, is unchanged.
fn with_check(text: &str, check: &WeightCheck) -> Result<String, toml_edit::TomlError> {
    let mut document: DocumentMut = text.parse()?;
    let WeightCheck { weight_n, weight_u_n, pull, gain, gain_sd, times, date, adjusted } = check;
    let mut table = InlineTable::new();
    let numbers = [("weight_n", *weight_n), ("weight_u_n", *weight_u_n), ("gain", *gain), ("gain_sd", *gain_sd)];
    table.extend(numbers.map(|(key, number)| (key, Value::from(number))));
    table.insert("times", Value::from(i64::from(*times)));
    table.insert("date", Value::from(date.as_str()));
    for (key, flag) in [("pull", *pull), ("adjusted", *adjusted)] {
        if flag {
            table.insert(key, Value::from(true));
        }
    }
    table.fmt();
    let mut new = value(table);
    let cell = &mut document["load_cell"];
    if let Some(cell) = cell.as_table_like_mut().filter(|cell| cell.get("check").is_some_and(Item::is_table)) {
        cell.remove("check"); // it becomes a line
    }
    let old = cell.get("check").and_then(Item::as_value);
    if let (Some(old), Item::Value(new)) = (old, &mut new) {
        *new.decor_mut() = old.decor().clone();
    }
    cell["check"] = new;
    Ok(document.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(adjusted: bool) -> WeightCheck {
        let (weight_n, weight_u_n, gain, gain_sd) = (0.5, 0.0005, 1.0101, 0.0002);
        let date = "2026-05-04".to_owned();
        WeightCheck { weight_n, weight_u_n, pull: false, gain, gain_sd, times: 3, date, adjusted }
    }

    #[test]
    fn a_check_is_written_and_nothing_else_changes() {
        let text = "# mine\n[load_cell] # a cell\nlink = \"sim\"  # here\n\n[array]\nlink = \"sim\"\n";
        let line = "check = { weight_n = 0.5, weight_u_n = 0.0005, gain = 1.0101, gain_sd = 0.0002, times = 3, date = \
                    \"2026-05-04\", adjusted = true }";
        let written = with_check(text, &check(true)).unwrap();
        assert_eq!(written, text.replacen("\n\n[array]", &format!("\n{line}\n\n[array]"), 1));
        let commented = written.replacen("true }", "true }  # by me", 1);
        let again = with_check(&commented, &check(false)).unwrap();
        assert_eq!(again, commented.replacen(", adjusted = true }", " }", 1));
        let table = "[load_cell]\nlink = \"sim\"\n\n[load_cell.check]\ngain = 3.0\n\n[array]\n";
        let written = with_check(table, &check(true)).unwrap();
        assert!(written.contains(line) && !written.contains("3.0"), "{written}");
    }
}
