//! `palpate check`.

use super::output::OutputArgs;
use super::rehearsed::Rehearsed;
use super::summary::{duration, tell};
use super::tables::filled;
use super::text_table::{TextTable, cells};
use crate::api::sources::{RigOptions, Sources};
use crate::api::{ConfirmOptions, Failure};
use palpate_control::{LEARNED, PressTask, depth_without_force_mm, safe_speed_mm_s};
use palpate_core::quantity::{Axis, COVERAGE, Limits, Tilt, round};
use palpate_data::acceptance::{Decision, LimitCheck, SensorVerdict};
use palpate_data::dataset::{Truths, foreseen};
use palpate_data::recipe::{Checks, Entry, Phase, Plan, PlannedDrag, Recipe};
use palpate_run::rig::{LastResort, RigSpec, TEMPERATURE};
use palpate_run::run::LAST_RESORT_SHARE;
use palpate_solver::SEVERAL_DEPTHS;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate check recipes/paper.toml
  palpate check recipes/test.toml --rig rigs/esp301.toml --seed 7
  palpate check recipes/bench.toml --strategy guarded";

/// Assumed total time of an exchange on the links of a rig, s: a quick rig and a slow rig. The real time is measured when a run
/// begins.
const EXCHANGES_S: [f64; 2] = [0.01, 0.1];

/// Distance within which an earlier press predicts a press, mm.
const COMPARED_MM: f64 = 1.0;

/// Print what a recipe would do on a rig; nothing moves
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct CheckArgs {
    /// The recipe
    recipe: PathBuf,
    #[command(flatten)]
    rig: RigOptions,
    #[command(flatten)]
    confirm: ConfirmOptions,
    #[command(flatten)]
    output: OutputArgs,
}

/// Checks and prints the plan.
pub(super) fn check(args: &CheckArgs) -> Result<ExitCode, Failure> {
    check_recipe(&args.recipe, &args.rig, args.confirm.is_touched(), args.output)
}

/// The same for `palpate run --dry-run`. `is_touched` states whether a person confirms the surface.
pub(super) fn check_recipe(
    recipe: &Path,
    rig: &RigOptions,
    is_touched: bool,
    output: OutputArgs,
) -> Result<ExitCode, Failure> {
    let mut sources = Sources::read(recipe, rig)?;
    sources.rig.is_touched = is_touched;
    let plan = sources.plan(rig.seed)?;
    let rehearsed = Rehearsed::of(&plan, &sources.rig)?;
    let warnings = warnings(&sources.recipe, &plan, &sources.rig, &rehearsed);
    let notes = notes(&sources.recipe, &plan, &sources.rig);
    let text = sources.chosen.line(&sources.rig) + &described(&plan, &sources.rig, &rehearsed);
    let content = json!({
        "rig": sources.chosen.path, "is_simulated": sources.rig.is_simulated(),
        "plan": object(&plan, &sources.rig, &rehearsed),
        "warnings": warnings, "notes": notes,
    });
    output.print(&text, &content)?;
    for warning in warnings {
        tell(&filled(&format!("warning: {warning}"), "  "))?;
    }
    for note in notes {
        tell(&filled(&format!("note: {note}"), "  "))?;
    }
    Ok(rehearsed.exit_code())
}

/// Returns warnings about settings that are valid but probably not intended.
fn warnings(recipe: &Recipe, plan: &Plan, rig: &RigSpec, rehearsed: &Rehearsed) -> Vec<String> {
    /// Press time above which the time was probably given in milliseconds, s.
    const LONG_S: f64 = 60.0;
    /// Least excess of the normal force over the limit that is worth a warning, N.
    const OVER_N: f64 = 0.001;
    let mut warnings = Vec::new();
    let has = |phase| plan.entries.iter().any(|entry| entry.phase == phase);
    if recipe.rule().is_some() && !has(Phase::Test) {
        warnings.push(
            "the recipe has an acceptance rule, but no step with `phase = \"test\"`: errors can't be judged".to_owned(),
        );
    }
    let longest_s = plan.entries.iter().map(|entry| entry.task.hold_s + entry.task.sample_s).fold(0.0, f64::max);
    if longest_s > LONG_S {
        warnings.push(format!("a press takes over {longest_s} s: `hold_s` and `sample_s` are in seconds"));
    }
    let height_mm = heights_mm(plan, rig);
    if height_mm > 2.0 * rig.frame.uncertainty_mm {
        warnings.push(format!(
            "the tilted surface is {height_mm:.3} mm deeper at one place than at another, over + and - \
             `frame.surface_mm.uncertainty` of {} mm: raise it, or level the specimen",
            rig.frame.uncertainty_mm
        ));
    }
    let normal_n = rig.frame.tilt.normal_n(plan.most_n());
    if normal_n > rig.limits.force_n + OVER_N {
        warnings.push(format!(
            "the largest force is {normal_n:.4} N along the tilted surface's normal, over the limit of {} N: lower it, or \
             level the specimen",
            rig.limits.force_n
        ));
    }
    if true_n(plan, rig).is_some_and(|true_n| true_n > rig.limits.force_n) {
        warnings.push(
            "the largest force may exceed the limit by the load cell's error: lower it, or raise `limits.force_n`"
                .to_owned(),
        );
    }
    let effect = rig.load_cell.certificate.as_ref().and_then(|certificate| certificate.temperature);
    if effect.is_some() && rig.monitors.iter().all(|monitor| monitor.name != TEMPERATURE) {
        warnings.push(format!(
            "`temperature_percent_per_c` of the load cell isn't in `u_force_n`: no [[monitor]] has the name `{TEMPERATURE}`"
        ));
    }
    warnings.extend(of_steps(plan, rig, rehearsed));
    warnings
}

/// Returns notes about results that the plan can't give.
fn notes(recipe: &Recipe, plan: &Plan, rig: &RigSpec) -> Vec<String> {
    let of = |phase: Phase| plan.entries.iter().filter(move |entry| entry.phase == phase);
    let most_n = |phase: Phase| of(phase).map(|entry| entry.task.most_n()).fold(0.0, f64::max);
    let (calibration_n, test_n) = (most_n(Phase::Calibration), most_n(Phase::Test));
    let mut notes = Vec::new();
    if calibration_n > 0.0 && test_n > calibration_n {
        let (calibration_n, test_n) = (shown(calibration_n), shown(test_n));
        notes.push(format!(
            "test forces reach {test_n} N, but the calibration has up to {calibration_n} N: stronger contacts are answered less \
             exactly, or with `not-one-contact`. Calibrate with {test_n} N, or give the forces to `palpate fit` and `solve`, such \
             as --forces-n {} {test_n}",
            shown(0.1 * calibration_n)
        ));
    }
    let truths = Truths {
        layout: &rig.array.layout,
        u_place_mm: rig.u_place_mm(),
        u_force_n: rig.load_cell.standard_uncertainty_n(test_n),
    };
    let has_test = test_n > 0.0;
    let depths = of(Phase::Calibration).map(|entry| entry.task.most_mm()).filter(|depth_mm| *depth_mm > 0.0);
    let (least_mm, most_mm) =
        depths.fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), mm| (least.min(mm), most.max(mm)));
    if !rig.has_load_cell() && most_mm > 0.0 && most_mm < SEVERAL_DEPTHS * least_mm {
        notes.push(format!(
            "the calibration has nearly one depth, {most_mm} mm: places will be solved, but no depths. Press to several depths, the \
             largest at least {SEVERAL_DEPTHS} times the smallest"
        ));
    }
    if !rig.has_load_cell() && recipe.rule().is_some_and(|rule| rule.decision == Decision::Guarded) {
        notes.push(
            "this plan can't give a verdict: a guarded rule needs a load cell; `rule = \"simple\"` doesn't".to_owned(),
        );
    }
    if let Some(judgement) = recipe.rule().map(|rule| foreseen(rule, plan, &truths)) {
        let is_reported =
            |check: &&LimitCheck| check.verdict != SensorVerdict::Accepted && (has_test || !check.kind.is_of_test());
        let of_checks = judgement
            .checks
            .iter()
            .filter(is_reported)
            .filter_map(|check| Some(format!("{}: {}", check.kind.full_name(check.reach), check.reason.as_ref()?)));
        let reasons = judgement.reasons.iter().filter(|_| has_test).cloned().chain(of_checks);
        notes.extend(reasons.map(|reason| format!("this plan can't give a verdict: {reason}")));
    }
    notes
}

/// Returns a number without the digits that only its calculation gives.
fn shown(value: f64) -> f64 {
    /// Digits after the decimal point that a person writes in a recipe.
    const DIGITS: i32 = 6;
    round(value, DIGITS)
}

/// Returns warnings about forces that a stage with steps can't reach.
fn of_steps(plan: &Plan, rig: &RigSpec, rehearsed: &Rehearsed) -> Vec<String> {
    let (steps, limits) = (rig.stage.steps, &rig.limits);
    let mut warnings = Vec::new();
    let tolerance_n = plan.entries.iter().map(|entry| entry.task.force_tolerance_n).fold(f64::INFINITY, f64::min);
    let reach_n = steps.reach_n(limits.stiffness_n_mm);
    if tolerance_n < reach_n {
        warnings.push(format!(
            "the force tolerance is {tolerance_n} N, but a step of z of {} mm changes the force by up to {} N, so a force is reached \
             only to within {} N and the noise: presses beyond the tolerance are flagged. Use a larger `force_tolerance_n`, or finer \
             steps",
            steps.along(Axis::Z),
            round(2.0 * reach_n, 4),
            round(reach_n, 4),
        ));
    }
    // z may end deeper than its target, so the permit stays below the limit
    if let Some(reached_n) = rehearsed.out_of_reach_n().filter(|_| !steps.is_fine()) {
        warnings.push(format!(
            "the largest force is {} N, but the steps of z and the noise of its place end the rehearsal at {} N, below the limit of {} N. Set \
             less than that",
            shown(plan.most_n()),
            round(reached_n, 3),
            limits.force_n,
        ));
    }
    warnings
}

/// Returns a plan as an object: its presses by phase, their time, and their extent.
pub(super) fn object(plan: &Plan, rig: &RigSpec, rehearsed: &Rehearsed) -> Value {
    let phases = parts(plan).map(|(phase, part)| {
        let estimated_s = rehearsed.phase_s(plan, phase);
        json!({ "phase": phase.name(), "presses": part.len(), "levels": levels(&part), "estimated_s": estimated_s })
    });
    let [x, y] = plan.envelope();
    json!({
        "name": plan.name, "seed": plan.seed, "phases": phases.collect::<Vec<Value>>(), "presses": plan.entries.len(),
        "checks": rehearsed.checks(), "estimated_s": rehearsed.total_s(), "rehearsal": rehearsed.object(),
        "x_mm": [x.min, x.max], "y_mm": [y.min, y.max], "force_most_n": plan.most_n(), "force_limit_n": rig.limits.force_n,
        "depth_most_mm": plan.most_mm(), "depth_limit_mm": rig.limits.depth_mm,
    })
}

/// Returns the phases that a plan has, each with its presses.
fn parts(plan: &Plan) -> impl Iterator<Item = (Phase, Vec<Entry>)> {
    let part = |phase| plan.entries.iter().filter(|entry| entry.phase == phase).cloned().collect();
    let all = [Phase::Teach].into_iter().chain(Phase::ALL.into_iter().filter(|phase| *phase != Phase::Teach));
    all.into_iter().map(move |phase| (phase, part(phase))).filter(|(_, part): &(Phase, Vec<Entry>)| !part.is_empty())
}

fn levels(entries: &[Entry]) -> usize {
    entries.iter().map(|entry| entry.task.levels.len()).sum()
}

fn described(plan: &Plan, rig: &RigSpec, rehearsed: &Rehearsed) -> String {
    let mut text = String::new();
    let [x, y] = plan.envelope();
    let travel = &rig.stage.travel.axes;
    // writing to a string can't fail
    let _ = writeln!(text, "plan {}, seed {}", plan.name, plan.seed);
    let mut table = TextTable::new(1, ["phase", "presses", "levels", "estimated"]);
    let mut row = |name: &str, entries: &[Entry], seconds: Option<f64>| {
        table.row(cells![name, entries.len(), levels(entries), seconds.map_or("-".to_owned(), duration)]);
    };
    for (phase, part) in parts(plan) {
        row(phase.name(), &part, rehearsed.phase_s(plan, phase));
    }
    row("together", &plan.entries, rehearsed.total_s());
    text += &table.to_string();
    text.push_str(&checked(rehearsed));
    text.push_str(&rehearsed.text(plan));
    let _ = writeln!(text, "limits of the rig");
    let _ = writeln!(text, "  x {:>7.3} to {:>6.3} mm, travel {} to {} mm", x.min, x.max, travel[0].min, travel[0].max);
    let _ = writeln!(text, "  y {:>7.3} to {:>6.3} mm, travel {} to {} mm", y.min, y.max, travel[1].min, travel[1].max);
    let limits = &rig.limits;
    if plan.most_n() > 0.0 {
        let most_n = shown(plan.most_n());
        let _ = writeln!(text, "  largest force {most_n} N, limit {} N{}", limits.force_n, distance(plan, rig));
    }
    if plan.most_mm() > 0.0 {
        let most_mm = shown(plan.most_mm());
        let _ = match (rig.has_load_cell(), rig.is_touched) {
            (true, _) => writeln!(
                text,
                "  largest depth {most_mm} mm, limit {} mm; its force is measured,\n  and a press that needs over {} N ends the run",
                limits.depth_mm, limits.force_n
            ),
            (false, true) => writeln!(
                text,
                "  largest depth {most_mm} mm, limit {} mm with --confirmed touch",
                round(rig.unforced_mm(true), 3)
            ),
            (false, false) => writeln!(
                text,
                "  largest depth {most_mm} mm, limit {} mm without a load cell,\n  {} mm with --confirmed touch",
                round(rig.unforced_mm(false), 3),
                round(rig.unforced_mm(true), 3)
            ),
        };
    }
    if !rig.stage.steps.is_fine() {
        let reach_n = round(rig.stage.steps.reach_n(limits.stiffness_n_mm), 4);
        let step_mm = rig.stage.steps.along(Axis::Z);
        let _ = writeln!(
            text,
            "  steps of z of {step_mm} mm: a force is reached to within {reach_n} N at {} N/mm,\n  \
             and the noise of the load cell",
            limits.stiffness_n_mm
        );
    }
    let _ = writeln!(text, "  depth at most {} mm below the measured surface", limits.depth_mm);
    text.push_str(&dragged(plan, rig));
    text.push_str(&followed(plan, rig));
    text.push_str(&tilted(plan, rig));
    let way_mm = -rig.top_mm();
    let steps = (way_mm * limits.stiffness_n_mm / limits.force_n).ceil().max(1.0);
    let _ = writeln!(text, "  first descent: {way_mm:.1} mm from home in {steps} steps or more");
    let _ = writeln!(text, "{}", permitted(rig));
    text.push_str(&last_resort(rig));
    text.push_str(&finished(rig));
    let links = if rig.is_simulated() { "simulated, in virtual time" } else { "real, in real time" };
    let _ = writeln!(text, "  links: {links}");
    text.push_str(&guarded(plan, rig));
    text
}

/// Describes a stage that finishes each motion, and what it can't do.
fn finished(rig: &RigSpec) -> String {
    let abilities = rig.stage.driver.abilities();
    if !abilities.finishes() {
        return String::new();
    }
    let late = match abilities.late_s {
        0.0 => String::new(),
        late_s => format!(", some {late_s} s late"),
    };
    format!("  the stage finishes each motion{late}:\n  strategies guarded and map, no drags\n")
}

/// Describes what notices a load cell or a sensor that changes, and what doesn't.
fn guarded(plan: &Plan, rig: &RigSpec) -> String {
    if !rig.has_load_cell() {
        return without_load_cell(rig);
    }
    let (near, all) = (compared(plan), plan.entries.len());
    let nothing = match plan.checks {
        Checks::None if near == 0 => {
            "\n  so nothing notices a gain that changes during the run (`checks` in the recipe)"
        }
        _ if near == 0 => "\n  so a gain that changes during the run is noticed by its checks alone",
        _ => "",
    };
    let least = match rig.stiffness_least_n_mm {
        Some(least_n_mm) => format!("at the first press, below {least_n_mm} N/mm"),
        None => "by nothing (`limits.stiffness_least_n_mm`)".to_owned(),
    };
    let weight = match rig.load_cell.check {
        Some(_) => "checked with a known weight",
        None => "not checked (`palpate doctor --check-weight-n N`)",
    };
    format!(
        "what notices a load cell that reads wrong\n  gain before the run: {weight}\n  too little force for the depth: \
         {least}\n  depth and outputs, by earlier presses there or around: {near} of {all} presses{nothing}\n"
    )
}

/// Describes what a run without a load cell relies on.
fn without_load_cell(rig: &RigSpec) -> String {
    let Limits { force_n, stiffness_n_mm, .. } = rig.limits;
    let lines = [
        format!(
            "a move ends at most {:.3} mm below the earliest possible surface: {force_n} N over {stiffness_n_mm} N/mm",
            depth_without_force_mm(&rig.limits)
        ),
        "a specimen that is stiffer gets more force, by as much as it is stiffer".to_owned(),
        format!(
            "the array must feel the surface within {} mm of `frame.surface_mm`; with --confirmed touch it is where the frame states. \
             Nothing is promised for a surface outside this uncertainty",
            rig.frame.uncertainty_mm
        ),
    ];
    let lines: String = lines.iter().map(|text| filled(&format!("  {text}"), "  ")).collect();
    format!("no load cell: no force is measured, and no force stops a motion\n{lines}")
}

/// Number of presses that are compared with earlier presses: with one at the same place, or with those of enough places around.
fn compared(plan: &Plan) -> usize {
    let cell = |mm: f64| (mm / COMPARED_MM).floor() as i64;
    let (mut places, mut cells) = (HashSet::new(), HashSet::new());
    let is_near = |cells: &HashSet<(i64, i64)>, (x, y): (i64, i64)| {
        (-1..=1).any(|i| (-1..=1).any(|j| cells.contains(&(x + i, y + j))))
    };
    let mut count = 0;
    for Entry { place, .. } in &plan.entries {
        let (known, at) = (places.len(), (cell(place.x_mm), cell(place.y_mm)));
        let is_new = places.insert((place.x_mm.to_bits(), place.y_mm.to_bits()));
        count += usize::from(!is_new || (known >= LEARNED && is_near(&cells, at)));
        cells.insert(at);
    }
    count
}

/// Describes the tilt of the surface that the rig states; nothing if it states none.
fn tilted(plan: &Plan, rig: &RigSpec) -> String {
    let tilt = rig.frame.tilt;
    if tilt == Tilt::LEVEL {
        return String::new();
    }
    format!(
        "  surface tilted by {:.2} degrees, deeper toward {:.0} degrees from x toward y:\n  \
         {:.1} um sideways per mm of depth, {:.3} mm of height over the pressed area\n",
        tilt.degrees(),
        tilt.direction_deg(),
        1000.0 * tilt.tangent(),
        heights_mm(plan, rig),
    )
}

/// Returns the difference in height of the tilted surface between the highest and the deepest place of the plan, mm.
fn heights_mm(plan: &Plan, rig: &RigSpec) -> f64 {
    let heights = plan.entries.iter().map(|entry| rig.frame.tilt.height_mm(entry.place));
    let (least, most) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), mm| (a.min(mm), b.max(mm)));
    (most - least).max(0.0)
}

/// Describes the effect of the load cell's stated error on the largest set force.
fn distance(plan: &Plan, rig: &RigSpec) -> String {
    let text = |true_n: f64| format!(": with the\n  load cell's stated error up to {true_n:.3} N");
    true_n(plan, rig).map_or_else(String::new, text)
}

/// Returns the largest set force plus the load cell's stated error, N; `None` if the load cell states no error.
fn true_n(plan: &Plan, rig: &RigSpec) -> Option<f64> {
    let set_n = Some(plan.most_n()).filter(|most_n| *most_n > 0.0)?;
    rig.load_cell.standard_uncertainty_n(set_n).map(|u_n| set_n + COVERAGE * u_n)
}

/// Describes the limits that the permit sets for every motion, even if the host fails.
fn permitted(rig: &RigSpec) -> String {
    let limits = &rig.limits;
    let lag_s = rig.stage.settle_s + rig.load_cell.lag_s;
    let speed = |exchanges_s: f64| {
        let reaction_s = exchanges_s + lag_s;
        safe_speed_mm_s(limits.force_n, limits.stiffness_n_mm, reaction_s, rig.stage.acceleration_mm_s2)
    };
    let [fast, slow] = EXCHANGES_S.map(|exchanges_s| speed(exchanges_s).min(rig.stage.speed_mm_s));
    format!(
        "  a move ends at most {:.3} mm beyond the earliest contact ({} N at {} N/mm),\n  \
         before the first touch beyond the depth that was measured to be free\n  \
         fastest approach: {slow:.2} mm/s if an exchange with the devices takes {:.0} ms,\n  \
         {fast:.2} mm/s if it takes {:.0} ms",
        limits.force_n / limits.stiffness_n_mm,
        limits.force_n,
        limits.stiffness_n_mm,
        1000.0 * EXCHANGES_S[1],
        1000.0 * EXCHANGES_S[0],
    )
}

/// Describes what ends a motion of somebody else, as another host of the stage can begin one, and the force that it reaches.
fn last_resort(rig: &RigSpec) -> String {
    if !rig.has_load_cell() {
        return String::new();
    }
    let (stage, limits) = (&rig.stage, &rig.limits);
    let beyond_n = LAST_RESORT_SHARE * limits.force_n;
    let another = "  a motion that continues after a stop, as another host can command:\n";
    let text = match stage.driver.last_resort() {
        LastResort::CutsPower(what) if !stage.z_holds_unpowered => {
            return format!("{another}  {what} would end it, and isn't sent without `z_holds_unpowered = true`\n");
        }
        LastResort::KeepsPower(what) | LastResort::CutsPower(what) => what,
    };
    // two readings, and the slow rig's exchanges
    let reaction_s = 2.0 / rig.load_cell.conversions_hz + EXCHANGES_S[1] + rig.load_cell.lag_s;
    let (v, a) = (stage.speed_mm_s, stage.acceleration_mm_s2);
    let most_n = beyond_n + limits.stiffness_n_mm * (v * reaction_s + v * v / (2.0 * a));
    format!("{another}  from {} N on {text} ends it; {v} mm/s reaches some {most_n:.1} N\n", round(beyond_n, 3))
}

/// Describes how the longest drag of the plan can end; nothing without a drag.
fn dragged(plan: &Plan, rig: &RigSpec) -> String {
    let planned = plan.entries.iter().filter_map(|Entry { task, .. }| {
        let (most_n, most_mm, tolerance_n) = (task.most_n(), task.most_mm(), task.force_tolerance_n);
        Some(PlannedDrag { most_n, most_mm, tolerance_n, way_mm: task.drag()?.way_mm() })
    });
    let longest = planned.max_by(|a, b| a.way_mm.total_cmp(&b.way_mm));
    let Some((drag, most)) = longest.zip(rig.drag) else { return String::new() };
    let [_, (shear_n, shear_most_n, _), (length_n, ..)] = drag.end(&rig.ground(), &most);
    format!(
        "  a drag of {} mm ends with at most {shear_n:.3} of {shear_most_n} N sideways,\n  {length_n:.3} of {} N in all, even if the tip sticks\n",
        round(drag.way_mm, 3),
        rig.limits.force_n
    )
}

/// Describes what levels that are followed over time can show.
fn followed(plan: &Plan, rig: &RigSpec) -> String {
    let of_task = |task: &PressTask| (0..task.levels.len()).map(|level| task.follow_s(level)).fold(0.0, f64::max);
    let times_s = plan.entries.iter().map(|entry| of_task(&entry.task)).filter(|follow_s| *follow_s > 0.0);
    let Some(longest_s) = times_s.reduce(f64::max) else { return String::new() };
    let hz = rig.load_cell.conversions_hz;
    format!(
        "  followed for up to {}: {hz} forces per second, outputs as fast as the\n  array answers; shows time constants from {} s to {longest_s} s\n",
        duration(longest_s),
        round(2.0 / hz, 3)
    )
}

/// Describes the checks, whose time is in the line before; nothing if there are none.
fn checked(rehearsed: &Rehearsed) -> String {
    let checks = rehearsed.complete().map_or(&[][..], |rehearsal| &rehearsal.checks);
    let Some(Entry { place, .. }) = checks.last() else { return String::new() };
    let counted = match checks.len() - 1 {
        0 => "1 check at the end".to_owned(),
        1 => "1 check during the run and 1 at the end".to_owned(),
        between => format!("{between} checks during the run and 1 at the end"),
    };
    format!("  and {counted}, at ({}, {}) mm\n", shown(place.x_mm), shown(place.y_mm))
}
