//! `palpate batch check`.

use super::super::check::object;
use super::super::output::OutputArgs;
use super::super::rehearsed::Rehearsed;
use super::super::summary::duration;
use super::super::tables::filled;
use super::material::{Material, calibrated};
use crate::api::Failure;
use crate::api::run::check_gain;
use palpate_core::quantity::Place;
use palpate_data::acceptance::{AcceptanceRule, Decision};
use palpate_data::recipe::{Phase, Plan};
use palpate_run::batch::{Chance, DRAWS, Test, chance};
use palpate_solver::Prior;
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate batch check batch
  palpate batch check monday.toml --simulate";

/// Print what a batch would do with each sensor; nothing moves
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct BatchCheckArgs {
    /// The batch file
    #[arg(value_name = "BATCH")]
    batch_file: PathBuf,
    /// Simulate: replace the rig's links by emulators, in virtual time
    #[arg(long)]
    simulate: bool,
    #[command(flatten)]
    output: OutputArgs,
}

/// Checks every file and the plan at each nest, and prints minutes, presses and the chance of no decision.
pub(super) fn check(args: &BatchCheckArgs) -> Result<ExitCode, Failure> {
    let material = Material::read(&args.batch_file, args.simulate)?;
    check_gain(&material.rig)?;
    material.check()?;
    let plan = material.plan(0, &material.rig, material.file.seed)?;
    let rehearsed = Rehearsed::of(&plan, &material.rig)?;
    let (file, chance) = (&material.file, chance_of(&material, &plan));
    let content = json!({
        "name": file.name, "design": file.design, "bench": material.bench, "sensors": file.serials,
        "nests": file.nests.iter().map(|nest| &nest.name).collect::<Vec<_>>(), "warm_up_s": file.warm_up_s,
        "plan": object(&plan, &material.rig, &rehearsed),
        "chance": chance.as_ref().and_then(|chance| chance.as_ref().ok()).map(|chance| json!({
            "accepted": chance.accepted, "not_accepted": chance.not_accepted, "not_decided": chance.not_decided,
        })),
    });
    let text = material.chosen.line(&material.rig) + &described(&material, &plan, &rehearsed, chance);
    args.output.print(&text, &content)?;
    Ok(rehearsed.exit_code())
}

fn described(
    material: &Material,
    plan: &Plan,
    rehearsed: &Rehearsed,
    chance: Option<Result<Chance, &'static str>>,
) -> String {
    let file = &material.file;
    let mut text = format!("batch {}, design {}, bench {}\n", file.name, file.design, material.bench);
    // writing to a string can't fail
    let (first, last) = (file.serials.first(), file.serials.last());
    let ends = first.zip(last).map(|(first, last)| format!(": {first} to {last}")).unwrap_or_default();
    let _ = writeln!(text, "  {} sensors{ends}", file.serials.len());
    if let Some(reference) = &file.reference {
        let _ = writeln!(
            text,
            "  reference sensor {}: first, and after every {} sensors",
            reference.serial, reference.every
        );
    }
    let nests: Vec<&str> = file.nests.iter().map(|nest| nest.name.as_str()).collect();
    if !nests.is_empty() {
        text += &filled(&format!("  nests: {}; the plan is within the travel at each", nests.join(", ")), "    ");
    }
    let [calibration, test] = [Phase::Calibration, Phase::Test].map(|phase| presses(plan, phase));
    let _ = writeln!(
        text,
        "each sensor, with the recipe {}\n  {} presses: {calibration} of the calibration, {test} of the test",
        plan.name,
        plan.entries.len()
    );
    text += &rehearsed.text(plan);
    let warm_up_s = file.warm_up_s / file.nests.len().max(1) as f64;
    if let Some(run_s) = rehearsed.total_s() {
        let (each_s, sensors) = (run_s + warm_up_s, file.serials.len());
        let _ = writeln!(
            text,
            "  estimated {}: run {}, warm-up {}",
            duration(each_s),
            duration(run_s),
            duration(warm_up_s)
        );
        let all = duration(sensors as f64 * each_s);
        let _ = writeln!(text, "  all {sensors} sensors: {all}, without the time to change them");
    }
    text += &prior_text(material, plan);
    for recipe in &material.recipes[1..] {
        let _ = writeln!(text, "  more presses, if the result needs them: {}", recipe.recipe.name);
    }
    text += &chance_text(material.rule.as_ref(), chance);
    text
}

/// Describes the design's prior, and the error that it expects after the first recipe.
fn prior_text(material: &Material, plan: &Plan) -> String {
    let Some(prior) = &material.prior else { return String::new() };
    let (places, press_n) = calibrated(plan);
    let own = prior.spread().own;
    format!(
        "prior of {} sensors; standard deviations of a unit from sensor to sensor:\n  gain {:.1} %, place {:.3} mm, width {:.1} %\n  \
         expected mean location error after these presses, at {press_n} N: {:.3} mm\n{}",
        prior.sensors(),
        100.0 * own.gain,
        own.place_mm,
        100.0 * own.width,
        prior.expected_after_mm(&places, press_n, press_n),
        undetectable_text(prior, &places, press_n)
    )
}

/// Names the ways to mount or wire a sensor wrongly that the presses can't show.
fn undetectable_text(prior: &Prior, places: &[Place], press_n: f64) -> String {
    let alike = prior.undetectable(places, press_n);
    match alike.is_empty() {
        true => String::new(),
        false => filled(
            &format!("  can't be detected, because the design's map stays as it is: {}", alike.join(", ")),
            "    ",
        ),
    }
}

fn presses(plan: &Plan, phase: Phase) -> usize {
    plan.entries.iter().filter(|entry| entry.phase == phase).count()
}

/// Returns the chance that a typical sensor is decided, or the key that is missing; `None` without a rule.
fn chance_of(material: &Material, plan: &Plan) -> Option<Result<Chance, &'static str>> {
    let (rule, rig) = (material.rule.as_ref()?, &material.rig);
    let test = Test {
        calibration_presses: presses(plan, Phase::Calibration),
        test_presses: presses(plan, Phase::Test),
        u_place_mm: rig.u_place_mm(),
        u_force_n: rig.load_cell.standard_uncertainty_n(mean_n(plan)),
    };
    Some(chance(rule, &test, &material.file.typical))
}

fn chance_text(rule: Option<&AcceptanceRule>, chance: Option<Result<Chance, &'static str>>) -> String {
    let Some((rule, chance)) = rule.zip(chance) else {
        return "no verdict: no acceptance rule (`accept` of the batch, or [accept] of the recipe)\n".to_owned();
    };
    match chance {
        Err(key) => format!(
            "{} rule; the chance that a typical sensor is NOT DECIDED can't be\n  computed: state `{key}` in `typical`\n",
            rule.decision.word()
        ),
        Ok(chance) => described_chance(rule, chance),
    }
}

fn described_chance(rule: &AcceptanceRule, chance: Chance) -> String {
    let percent = |share: f64| 100.0 * share;
    let mut text = format!(
        "{} rule; a typical sensor is\n  NOT DECIDED with a chance of {:.1} %, ACCEPTED with {:.1} %, NOT ACCEPTED with {:.1} %\n  \
         ({DRAWS} drawn tests of sensors with the errors that `typical` states)\n",
        rule.decision.word(),
        percent(chance.not_decided),
        percent(chance.accepted),
        percent(chance.not_accepted)
    );
    if rule.decision == Decision::Guarded && chance.accepted == 0.0 {
        text += "  none is accepted: use more test presses, and state the certificates in the rig\n";
    }
    text
}

/// Returns the mean of the test's largest forces, N.
fn mean_n(plan: &Plan) -> f64 {
    let test = plan.entries.iter().filter(|entry| entry.phase == Phase::Test);
    let (count, sum_n) = test.fold((0, 0.0), |(count, sum_n), entry| (count + 1, sum_n + entry.task.most_n()));
    if count > 0 { sum_n / f64::from(count) } else { 0.0 }
}
