//! `palpate doctor`.

use super::check_weight::{WeightArgs, WeightJson, ask, concluded, concluded_axes};
use super::one_rig::OneRigArgs;
use super::output::OutputArgs;
use super::rehearsed::rehearsed_as_measured;
use super::signals::{First, heed};
use super::summary::beside;
use super::tables::filled;
use crate::api::Failure;
use crate::api::run::block_on;
use miette::Diagnostic;
use palpate_control::{Drift, MainsInterference, Reaction, Trip};
use palpate_core::quantity::AxesCheck;
use palpate_data::dataset::MonitorValue;
use palpate_drivers::lines::ForceCounts;
use palpate_link::device::{Identity, shown};
use palpate_run::rig::{GAIN_UNKNOWN, RigSpec};
use palpate_run::run::{Examination, Finding, ForceCheck, NOISE_SHARE, NoLoadCell, ShownBy, Weighing, examine};
use serde::Serialize;
use std::fmt::Write as _;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate doctor rigs/esp301.toml --finger
  palpate doctor rigs/paper.toml --json
  palpate doctor rigs/esp301.toml --check-weight-n 0.5 --check-weight-u-n 0.0005

With a check weight, palpate asks three times to put the weight on the tip and to
take it off; the load cell detects both. The result is written to `check` in the
rig's [load_cell]. With --three-axes the weight then acts along x and along y.

Homes axes that aren't homed (z first, away from the specimen) and moves to the clear height.
Then the load cell must show that it measures force: with --finger or a check weight. `palpate align` shows it too.
A real rig isn't pressed; a simulated rig presses once, also instead of a finger.";

/// What is reported if nothing has shown that the load cell measures force, and how to show it.
const NOT_SHOWN: &str = "nothing has shown that the load cell measures force";
const SHOW: &str =
    "press the tip (`--finger`), use a known weight (`--check-weight-n N`), or let `palpate align` press";

/// Number of bars in the histogram of reaction times. The second constant is the length of the longest bar in columns.
const BARS: usize = 8;
const BAR_COLUMNS: usize = 40;

/// Allowed move of the zero in either direction in the proposed `air_n`, as a fraction of the force limit.
const ZERO_MOVES_SHARE: f64 = 0.2;

/// Time for which the proposed `air_n` allows for a drift, s: the longest time between two checks of a run.
const DRIFTS_FOR_S: f64 = 3600.0;

/// Typical window of recipes, used to calculate the mains interference that remains in it, s.
const WINDOW_S: f64 = 0.2;

/// Zero, as a fraction of the force limit, above which little of the cell's range remains.
const ZERO_SHARE: f64 = 0.5;

/// Approach speed below which the search for the surface takes most of a press' time, mm/s.
const SLOW_MM_S: f64 = 1.0;

/// Check a rig: identify its devices, measure zero, noise and reaction time
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct DoctorArgs {
    #[command(flatten)]
    rig: OneRigArgs,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    weight: WeightArgs,
    /// Ask for a finger on the tip, which shows that the load cell measures force
    #[arg(long, conflicts_with = "check_weight_n")]
    finger: bool,
}

/// Checks the rig and reports what to do.
pub(super) fn doctor(args: &DoctorArgs) -> Result<ExitCode, Failure> {
    let (text, rig, invented) = args.rig.read()?;
    if !rig.has_load_cell() {
        return devices_alone(args, &rig);
    }
    let weight = args.weight.weight(&rig)?;
    let spec = if weight.is_some() { as_it_reads(&rig) } else { rig.clone() };
    let cancel = heed(First::Stop, Some("stopping"))?;
    let mut asked = ask;
    let three_axes = args.weight.three_axes;
    let asked = match weight {
        Some(weight) => ForceCheck::Weight(Weighing { weight, three_axes, ask: &mut asked }),
        None if args.finger && !spec.is_simulated() => ForceCheck::Finger(&mut asked),
        None => ForceCheck::Press, // also instead of a finger, which no simulated rig feels
    };
    let looked = examine(&spec, args.rig.seed, &cancel, asked);
    let found = block_on(spec.is_simulated(), looked)?.map_err(Failure::halted)?;
    let place = (args.rig.rig.as_path(), text.as_str(), invented);
    let weighed = found.weighed.as_ref().and_then(|weighed| weighed.as_ref().ok());
    let weighed = weighed.map(|weighed| concluded(&args.weight, weighed, &rig, place)).transpose()?;
    let advice = advice(&found, &spec);
    let rehearsed = rehearsed(&found, &rig).map_or_else(String::new, |text| format!("\n{}", filled(&text, "  ")));
    let mut text =
        described(&found, &spec, &advice) + &rehearsed + weighed.as_ref().map_or("", |weighed| weighed.text.as_str());
    let mut axes = None;
    if let Some(Ok(weighed)) = &found.weighed_axes {
        let (more, check) = concluded_axes(weighed, (place.0, invented))?;
        text += &more;
        axes = Some(check);
    }
    args.output.print(&text, &json(&found, &advice, (weighed.as_ref().map(|weighed| &weighed.json), axes.as_ref())))?;
    let failed = found.devices.into_iter().find_map(|(_, device)| device.err());
    let axes_failed = found.weighed_axes.and_then(Result::err);
    match (failed, found.no_load, found.shown) {
        (Some(error), ..) => Err(Failure::halted(error.into())),
        (None, Some(Err(trip)), _) | (None, _, Some(Err(trip))) => Err(Failure::halted(trip.into())),
        (None, _, shown) => {
            match weighed {
                Some(weighed) => weighed.failure.map_or(Ok(()), Err)?,
                None => rig.load_cell.check_gain().map_err(|trip| Failure::halted(trip.into()))?,
            }
            if let Some(trip) = axes_failed {
                return Err(Failure::halted(trip.into()));
            }
            if shown.is_none() {
                return Err(Failure::not_accepted(miette::miette!(help = SHOW, "{NOT_SHOWN}")));
            }
            Ok(ExitCode::SUCCESS)
        }
    }
}

/// Rehearses some presses with the measured times; `None` if a device failed.
fn rehearsed(found: &Examination, rig: &RigSpec) -> Option<String> {
    let is_usable = found.devices.iter().all(|(_, device)| device.is_ok()) && matches!(found.no_load, Some(Ok(_)));
    let [stage_s, load_cell_s, array_s] = &found.exchanges_s;
    is_usable.then(|| rehearsed_as_measured(rig, [stage_s, load_cell_s, array_s])).flatten()
}

/// Checks stage and array of a rig without a load cell. Nothing moves: no force would show a contact.
fn devices_alone(args: &DoctorArgs, rig: &RigSpec) -> Result<ExitCode, Failure> {
    if args.finger || args.weight.weight(rig)?.is_some() {
        let help = "remove the option, or add a [load_cell] to the rig";
        return Err(Failure::usage(miette::miette!(
            help = help,
            "this rig has no load cell, so no force can be shown"
        )));
    }
    let cancel = heed(First::Stop, Some("stopping"))?;
    let looked = examine(rig, args.rig.seed, &cancel, ForceCheck::Nobody);
    let mut found = block_on(rig.is_simulated(), looked)?.map_err(Failure::halted)?;
    let load_cell = found.devices.remove(1);
    debug_assert_eq!(load_cell.0, "load_cell");
    let [stage, _, array] = found.exchanges_s;
    found.exchanges_s = [stage, array, Vec::new()];
    let text = described(&found, rig, &[]) + "\nno load cell: presses are by depth, and nothing was moved\n";
    args.output.print(&text, &json(&found, &[], (None, None)))?;
    match found.devices.into_iter().find_map(|(_, device)| device.err()) {
        Some(error) => Err(Failure::halted(error.into())),
        None => Ok(ExitCode::SUCCESS),
    }
}

/// Returns the rig with a load cell whose own readings count, without adjustment. A known weight checks these readings.
fn as_it_reads(rig: &RigSpec) -> RigSpec {
    let mut spec = rig.clone();
    spec.load_cell.check = None;
    spec
}

fn described(found: &Examination, spec: &RigSpec, advice: &[String]) -> String {
    let mut text = String::new();
    // writing to a string can't fail
    for (role, device) in &found.devices {
        let _ = match device {
            Ok(identity) => write!(text, "{}", beside(role, 11, &identity.identity)),
            Err(_) => writeln!(text, "{role:<11}fails: see below"),
        };
    }
    for (monitor, MonitorValue { name, value, .. }) in &found.monitors {
        text += &beside("monitor", 11, &format!("{name} is {value}, read by {}", monitor.identity));
    }
    if let Some((_, Err(why))) = &found.counts {
        let _ = writeln!(text, "{:<11}its web page doesn't confirm the counts per N: {why}", "");
    }
    let _ = writeln!(text, "\n{:<11}{:>10}{:>10}{:>10}", "exchange", "shortest", "median", "longest");
    for ((role, _), exchanges_s) in found.devices.iter().zip(&found.exchanges_s) {
        if let Some([shortest, median, longest]) = spread(exchanges_s) {
            let _ = writeln!(text, "{role:<11}{shortest:>7.1} ms{median:>7.1} ms{longest:>7.1} ms");
        }
    }
    if let Some(Ok(no_load)) = &found.no_load {
        let NoLoadCell { zero, readings, fresh_share, outputs_sigma_v, drift } = no_load;
        let _ = writeln!(
            text,
            "\n{:<11}zero {:.4} N, noise of a reading {:.2} mN",
            "no load",
            zero.offset_n,
            1000.0 * zero.sigma_n
        );
        let _ = writeln!(text, "{:<11}of {readings} readings {:.0} % are new", "", 100.0 * fresh_share);
        if let Some(mains) = zero.mains {
            let _ = writeln!(text, "{:<11}{}", "", mains_text(&mains));
        }
        for line in drift_text(zero.offset_n, drift, spec) {
            let _ = writeln!(text, "{:<11}{line}", "");
        }
        if spec.load_cell.air_n.is_none() {
            let [least_n, most_n] = proposed_air_n(zero.offset_n, drift, spec.limits.force_n);
            let _ = writeln!(text, "{:<11}`air_n = [{least_n}, {most_n}]` in [load_cell] would limit this zero", "");
        }
        let noise = match (outputs_sigma_v, spec.array.unit.as_str()) {
            (None, _) => "not measured".to_owned(),
            (Some(sigma_v), "V") => format!("{:.2} mV", 1000.0 * sigma_v),
            (Some(sigma), unit) => format!("{sigma:.4} {unit}"),
        };
        let _ = writeln!(text, "{:<11}noise of the noisiest output {noise}", "");
    }
    if let Some(Ok(shown)) = found.shown {
        let by = match shown {
            ShownBy::Weight => "a known weight",
            ShownBy::Finger => "a finger",
            ShownBy::Press => "a press of the simulated rig",
        };
        let _ = writeln!(text, "{:<11}it measures force, as {by} has shown", "");
    }
    if let (Some(reaction), Some(approach_mm_s)) = (&found.reaction, found.approach_mm_s) {
        let _ = writeln!(text, "\nreaction   from a change of force to the stage's response");
        text.push_str(&histogram(&found.reactions_s));
        let (worst_ms, limits) = (1000.0 * reaction.worst_s(), &spec.limits);
        let _ =
            writeln!(text, "\n{:<11}{worst_ms:.1} ms are assumed: 1.5 times the longest, plus 10 ms for the servo", "");
        let _ = writeln!(
            text,
            "{:<11}fastest safe approach: {approach_mm_s:.2} mm/s\n{:<11}({} N at {} N/mm, {} mm/s^2)",
            "", "", limits.force_n, limits.stiffness_n_mm, spec.stage.acceleration_mm_s2
        );
    }
    text += &to_write(&found.findings);
    let _ = match advice {
        [] if !found.findings.is_empty() => Ok(()),
        [] => writeln!(text, "\nno problems found"),
        advice => writeln!(text, "\nto do\n{}", wrapped(advice)),
    };
    text
}

/// Describes the mains interference, and the part of it that means leave.
fn mains_text(mains: &MainsInterference) -> String {
    let (hz, amplitude_mn) = (mains.hz, 1000.0 * mains.amplitude_n);
    match mains.whole_s {
        Some(whole_s) => {
            format!(
                "mains interference of {amplitude_mn:.1} mN at {hz} Hz: means span whole periods, {:.0} ms",
                1000.0 * whole_s
            )
        }
        None => {
            let left_mn = 1000.0 * mains.left_n(WINDOW_S);
            format!(
                "mains interference of {amplitude_mn:.1} mN at {hz} Hz: the cell is too slow, {left_mn:.1} mN remain in a window"
            )
        }
    }
}

/// Returns the proposed range of the load cell's reading without load, assuming that the present reading is air. In both directions it
/// allows the same move as the zero may have in a run. In the direction of a drift it allows more, up to what is allowed without the key.
fn proposed_air_n(offset_n: f64, drift: &Drift, limit_n: f64) -> [f64; 2] {
    let rounded = |n: f64| (n * 1000.0).round() / 1000.0;
    let [least_n, most_n] = [-ZERO_MOVES_SHARE, ZERO_MOVES_SHARE].map(|share| offset_n + share * limit_n);
    let drifts_n = drift.seen_n_s().unwrap_or(0.0) * DRIFTS_FOR_S;
    let by_drift = [(least_n + drifts_n.min(0.0)).max(-limit_n), (most_n + drifts_n.max(0.0)).min(limit_n)];
    [least_n.min(by_drift[0]), most_n.max(by_drift[1])].map(rounded)
}

/// Describes the drift of the zero: its rate with its error, whether a run continues with it, and for how long. Empty if no drift is seen.
fn drift_text(offset_n: f64, drift: &Drift, spec: &RigSpec) -> Vec<String> {
    let Some(rate_n_s) = drift.seen_n_s() else { return Vec::new() };
    let (most_n_s, air_n) = (Drift::most_n_s(spec.limits.force_n), spec.air_n());
    let bound_n = if rate_n_s > 0.0 { air_n.max } else { air_n.min };
    let leaves_min = ((bound_n - offset_n) / rate_n_s / 60.0).max(0.0);
    let [rate, sd] = [rate_n_s, drift.sigma_n_s].map(|n_s| format!("{:.2}", 1000.0 * n_s));
    vec![
        format!("drift of the zero {rate} mN/s, sd {sd} mN/s; a run passes up to {:.1} mN/s", 1000.0 * most_n_s),
        format!("at this rate the zero leaves `air_n` in {leaves_min:.0} min"),
    ]
}

/// Returns advice if the web page of a Net F/T states its counts in another unit than N.
fn other_unit(ForceCounts { counts, unit }: &ForceCounts) -> Option<String> {
    let text =
        format!("load_cell: its web page states {counts} counts per {}: set its unit to N, and ask again", shown(unit));
    (unit != "N").then_some(text)
}

/// Returns the lines to write in the rig file, below their sections.
fn to_write(findings: &[Finding]) -> String {
    let mut sections: Vec<&str> = findings.iter().map(|finding| finding.role).collect();
    sections.dedup();
    let lines = |role: &str| -> String {
        let own = findings.iter().filter(|finding| finding.role == role);
        own.map(|finding| format!("  {}\n", finding.line())).collect()
    };
    let text: String = sections.iter().map(|role| format!("  [{role}]\n{}", lines(role))).collect();
    if text.is_empty() { text } else { format!("\nto write in the rig file\n{text}") }
}

fn wrapped(advice: &[String]) -> String {
    let options = textwrap::Options::new(80).initial_indent("- ").subsequent_indent("  ");
    advice.iter().map(|line| textwrap::fill(line, &options)).collect::<Vec<_>>().join("\n")
}

/// Returns advice for the user about the results.
fn advice(found: &Examination, spec: &RigSpec) -> Vec<String> {
    let (mut advice, mut has_failed) = (Vec::new(), false);
    for (role, device) in &found.devices {
        match device {
            Ok(identity) => {
                let is_done = |warning: &&String| found.weighed.is_some() && *warning == GAIN_UNKNOWN;
                let left = identity.warnings.iter().filter(|warning| !is_done(warning));
                advice.extend(left.map(|warning| format!("{role}: {warning}")));
            }
            // the first one ends the command with its message
            Err(_) if !std::mem::replace(&mut has_failed, true) => {}
            Err(error) => {
                let help = error.help().map(|help| format!(": {help}")).unwrap_or_default();
                advice.push(format!("{error}{help}"));
            }
        }
    }
    for (spec, (monitor, MonitorValue { value, .. })) in spec.monitors.iter().zip(&found.monitors) {
        let outside = (!spec.admits(*value)).then(|| format!("{value} is outside its `bounds`: a run would wait"));
        let warnings = monitor.warnings.iter().chain(&outside);
        advice.extend(warnings.map(|warning| format!("{}: {warning}", monitor.role)));
    }
    if let Some((_, Ok(stated))) = &found.counts {
        advice.extend(other_unit(stated));
    }
    match &found.shown {
        None if matches!(found.no_load, Some(Ok(_))) => advice.push(format!("load_cell: {NOT_SHOWN}: {SHOW}")),
        Some(Err(trip)) if found.weighed.is_none() => advice.push(format!("load_cell: {trip}")),
        _ => {}
    }
    advice.extend(
        found.glitches.text().map(|text| format!("load_cell: {text}: check its cable, its supply and its ground")),
    );
    let limit_n = spec.limits.force_n;
    match &found.no_load {
        Some(Err(trip)) => advice.push(format!("load_cell: {trip}")),
        Some(Ok(no_load)) => {
            let sigma_n = no_load.zero.sigma_n;
            if sigma_n > NOISE_SHARE * limit_n {
                advice.push(format!(
                    "load_cell: its noise of {sigma_n:.4} N is over {} % of the force limit: a run won't start. Filter it, or \
                     use a cell with a smaller range",
                    100.0 * NOISE_SHARE
                ));
            }
            if no_load.zero.offset_n.abs() > ZERO_SHARE * limit_n {
                advice.push(format!(
                    "load_cell: it reads {:.3} N without load. This is subtracted, but check whether it is preloaded or something touches it",
                    no_load.zero.offset_n
                ));
            }
        }
        None => {}
    }
    advice.extend(spec.load_cell.check_gain().err().map(|trip| format!("load_cell: {trip}")));
    if let (Some(reaction), Some(approach_mm_s)) = (&found.reaction, found.approach_mm_s)
        && approach_mm_s < SLOW_MM_S
    {
        let text = "the approach is slow";
        advice.push(format!("{text}: {approach_mm_s:.2} mm/s. {}", slowest_part(reaction)));
    }
    advice
}

/// Returns the part of the reaction that should be made faster first.
fn slowest_part(reaction: &Reaction) -> String {
    let Reaction { conversion_s, load_cell_s, stage_s, lag_s } = *reaction;
    let parts = [
        (conversion_s, "the time between two conversions of the load cell: raise its rate"),
        (load_cell_s, "the load cell's link: raise its baud rate, or use TCP"),
        (stage_s, "the stage's link: raise its baud rate"),
        (lag_s, "the load cell's filter (`lag_ms`): raise its cut-off frequency"),
    ];
    let (seconds, what) = parts.into_iter().fold((0.0, ""), |most, part| if part.0 > most.0 { part } else { most });
    format!(
        "The largest part is {what} ({:.1} ms). A smaller `limits.stiffness_n_mm` also helps, if the specimen allows it",
        1000.0 * seconds
    )
}

/// Shortest, median and longest time, ms.
fn spread(seconds: &[f64]) -> Option<[f64; 3]> {
    let mut sorted = seconds.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (first, last) = (sorted.first()?, sorted.last()?);
    Some([first, &sorted[sorted.len() / 2], last].map(|s| 1000.0 * s))
}

fn histogram(seconds: &[f64]) -> String {
    let Some([shortest, _, longest]) = spread(seconds) else { return String::new() };
    let width = ((longest - shortest) / BARS as f64).max(1.0);
    let mut counts = [0usize; BARS];
    for s in seconds {
        counts[(((1000.0 * s - shortest) / width) as usize).min(BARS - 1)] += 1;
    }
    let most = counts.iter().copied().max().unwrap_or(1).max(1);
    let bar = |(n, count): (usize, &usize)| {
        let (from, to) = (shortest + n as f64 * width, shortest + (n + 1) as f64 * width);
        let columns = (count * BAR_COLUMNS).div_ceil(most);
        format!("{:<11}{from:>6.1} to {to:>5.1} ms {count:>5} {}", "", "#".repeat(columns)).trim_end().to_owned() + "\n"
    };
    // a rig that always takes the same time has one bar
    let last = counts.iter().rposition(|count| *count > 0).unwrap_or(0);
    counts[..=last].iter().enumerate().map(bar).collect()
}

/// Output of `--json`.
#[derive(Serialize)]
struct DoctorJson<'a> {
    devices: Vec<ExaminedDevice<'a>>,
    /// Identity and value of each monitor.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    monitors: &'a [(Identity, MonitorValue)],
    zero_n: Option<f64>,
    noise_n: Option<f64>,
    /// Rate of the zero, and its standard deviation.
    drift_n_s: Option<f64>,
    drift_sd_n_s: Option<f64>,
    fresh_share: Option<f64>,
    outputs_noise_v: Option<f64>,
    trip: Option<&'a Trip>,
    reaction_ms: Vec<f64>,
    reaction_worst_ms: Option<f64>,
    approach_mm_s: Option<f64>,
    findings: &'a [Finding],
    advice: &'a [String],
    check_weight: Option<&'a WeightJson>,
    /// Readings of x, y and the press per newton along each, and their standard uncertainty.
    axes: Option<(&'a [[f64; 3]; 3], f64)>,
    measures_force: Option<bool>,
}

#[derive(Serialize)]
struct ExaminedDevice<'a> {
    role: &'a str,
    identity: Option<&'a Identity>,
    error: Option<String>,
    exchange_ms: Vec<f64>,
}

fn json<'a>(
    found: &'a Examination,
    advice: &'a [String],
    (check_weight, axes): (Option<&'a WeightJson>, Option<&'a AxesCheck>),
) -> DoctorJson<'a> {
    let ms = |seconds: &[f64]| seconds.iter().map(|s| (1e6 * s).round() / 1e3).collect::<Vec<_>>();
    let device = |((role, device), exchanges_s): (&'a (&'static str, Result<Identity, _>), &Vec<f64>)| ExaminedDevice {
        role,
        identity: device.as_ref().ok(),
        error: device.as_ref().err().map(|error: &palpate_link::device::DeviceError| error.to_string()),
        exchange_ms: ms(exchanges_s),
    };
    let no_load = found.no_load.as_ref().and_then(|no_load| no_load.as_ref().ok());
    DoctorJson {
        monitors: &found.monitors,
        devices: found.devices.iter().zip(&found.exchanges_s).map(device).collect(),
        zero_n: no_load.map(|no_load| no_load.zero.offset_n),
        noise_n: no_load.map(|no_load| no_load.zero.sigma_n),
        drift_n_s: no_load.map(|no_load| no_load.drift.seen_n_s().unwrap_or(0.0)),
        drift_sd_n_s: no_load.map(|no_load| no_load.drift.sigma_n_s),
        fresh_share: no_load.map(|no_load| no_load.fresh_share),
        outputs_noise_v: no_load.and_then(|no_load| no_load.outputs_sigma_v),
        trip: found
            .no_load
            .as_ref()
            .and_then(|no_load| no_load.as_ref().err())
            .or(found.shown.as_ref().and_then(|shown| shown.as_ref().err())),
        reaction_ms: ms(&found.reactions_s),
        reaction_worst_ms: found.reaction.map(|reaction| 1000.0 * reaction.worst_s()),
        approach_mm_s: found.approach_mm_s,
        findings: &found.findings,
        advice,
        check_weight,
        axes: axes.map(|check| (&check.along, check.u)),
        measures_force: found.shown.as_ref().map(Result::is_ok),
    }
}
