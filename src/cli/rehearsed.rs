//! The rehearsal of a plan, in words.

use super::summary::duration;
use super::tables::{NO_BREAK, filled};
use crate::api::Failure;
use palpate_control::SafetyRule;
use palpate_core::quantity::round;
use palpate_data::recipe::{self, Phase, Plan};
use palpate_run::rig::RigSpec;
use palpate_run::run::{EarlyEnd, Halt, Rehearsal, rehearse};
use palpate_sim::scene::Latencies;
use serde_json::{Value, json};
use std::process::ExitCode;

/// The rehearsal of a plan, or why a rig with real links can't be simulated.
pub(super) struct Rehearsed(Result<Rehearsal, String>);

/// Fraction of the force limit, or of the largest depth without a load cell, with which a rig is rehearsed without a recipe.
const USUAL_SHARE: f64 = 0.5;

/// Rehearses presses at the units of a rig with the measured times of its exchanges, s: stage, load cell and array. Returns what a press
/// would take, or why it would end; `None` if the units aren't in reach, or the rig can't be simulated.
pub(super) fn rehearsed_as_measured(rig: &RigSpec, exchanges_s: [&[f64]; 3]) -> Option<String> {
    let load = match rig.has_load_cell() {
        true => format!("force_n = {:?}", round(USUAL_SHARE * rig.limits.force_n, 3)),
        false => format!("depth_mm = {:?}", round(USUAL_SHARE * rig.unforced_mm(false), 3)),
    };
    let text = format!("name = \"doctor\"\n[[step]]\nphase = \"calibration\"\nunits = \"all\"\n{load}\n");
    let mut rig = rig.clone().without_links();
    let measured = exchanges_s.map(|exchanges_s| {
        let spread = |(least, most): (f64, f64), s: &f64| (least.min(*s), most.max(*s));
        exchanges_s.iter().fold((f64::INFINITY, 0.0), spread)
    });
    let [stage_s, load_cell_s, array_s] = measured.map(|(least, most)| (least.min(most), most));
    rig.scene.latencies = Latencies { stage_s, load_cell_s, array_s, stage_spikes: None };
    rig.scene.faults.clear();
    let recipe = recipe::parse("doctor", &text).ok()?;
    let plan = Plan::new(&recipe, &rig.ground(), 0).ok()?;
    let rehearsal = rehearse(&plan, &rig).ok()?;
    Some(match rehearsal.early {
        None => {
            format!("rehearsed with these times: a press with {load} takes some {} s", round(rehearsal.press_s(), 2))
        }
        Some(EarlyEnd { text, .. }) => format!("rehearsed with these times: a press with {load} ends early: {text}"),
    })
}

impl Rehearsed {
    /// Rehearses a plan.
    pub(super) fn of(plan: &Plan, rig: &RigSpec) -> Result<Rehearsed, Failure> {
        match rehearse(plan, rig) {
            Ok(rehearsal) => Ok(Rehearsed(Ok(rehearsal))),
            Err(error) if rig.is_simulated() => Err(Failure::halted(Halt::Device(error))),
            Err(error) => Ok(Rehearsed(Err(error.to_string()))),
        }
    }

    /// Expected time of a run, s; `None` if it isn't known.
    pub(super) fn total_s(&self) -> Option<f64> {
        self.complete().map(Rehearsal::total_s)
    }

    /// Expected time of the presses of a phase, s.
    pub(super) fn phase_s(&self, plan: &Plan, phase: Phase) -> Option<f64> {
        let entries = plan.entries.iter().zip(&self.complete()?.entries_s);
        Some(entries.filter(|(entry, _)| entry.phase == phase).map(|(_, s)| s).sum())
    }

    /// Number of checks during and after the run.
    pub(super) fn checks(&self) -> usize {
        self.complete().map_or(0, |rehearsal| rehearsal.checks.len())
    }

    /// The force at which it ended early, because the permit allows no more, N.
    pub(super) fn out_of_reach_n(&self) -> Option<f64> {
        let trip = self.0.as_ref().ok()?.early.as_ref()?.trip.as_ref()?;
        (trip.rule == SafetyRule::OutOfReach).then_some(trip.measured)
    }

    /// The rehearsal, if the plan was completed.
    pub(super) fn complete(&self) -> Option<&Rehearsal> {
        self.0.as_ref().ok().filter(|rehearsal| rehearsal.early.is_none())
    }

    /// States whether the plan works, and the time of a press, in lines of at most 80 columns.
    pub(super) fn text(&self, plan: &Plan) -> String {
        let rehearsal = match &self.0 {
            Ok(rehearsal) => rehearsal,
            Err(why) => return filled(&format!("not rehearsed, so no time is known: {why}"), "  "),
        };
        let (presses, all) = (rehearsal.presses, plan.entries.len());
        match &rehearsal.early {
            None => {
                let works = format!(
                    "rehearsed {presses} of {all} presses on the simulated rig: works; a press takes some {}{NO_BREAK}s, all together {}, {} \
                     of it before the first press",
                    round(rehearsal.press_s(), 2),
                    duration(rehearsal.total_s()),
                    duration(rehearsal.ready_s),
                );
                filled(&works, "  ")
            }
            Some(EarlyEnd { press, text, .. }) => {
                let at = press.map(|(press, place)| {
                    format!(" in press {press} at ({}, {}) mm", round(place.x_mm, 3), round(place.y_mm, 3))
                });
                let early = format!("rehearsed on the simulated rig: ends early{}: {text}", at.unwrap_or_default());
                filled(&early, "  ")
            }
        }
    }

    /// Returns it as an object.
    pub(super) fn object(&self) -> Value {
        match &self.0 {
            Err(why) => json!({ "why_not": why }),
            Ok(rehearsal) => json!({
                "presses": rehearsal.presses,
                "press_s": self.complete().map(|complete| round(complete.press_s(), 3)),
                "ends_early": rehearsal.early.as_ref().map(|EarlyEnd { press, text, .. }| json!({
                    "press": press.map(|(press, _)| press),
                    "place_mm": press.map(|(_, place)| [place.x_mm, place.y_mm]),
                    "reason": text,
                })),
            }),
        }
    }

    /// Exit code: 1 if the plan was not completed.
    pub(super) fn exit_code(&self) -> ExitCode {
        let is_early = self.0.as_ref().is_ok_and(|rehearsal| rehearsal.early.is_some());
        if is_early { ExitCode::from(1) } else { ExitCode::SUCCESS }
    }
}
