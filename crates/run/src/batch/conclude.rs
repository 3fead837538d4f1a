//! What the presses of a sensor amount to: verdict, change, and whether more presses are needed.

use super::design::judge_by;
use crate::rig::RigSpec;
use palpate_data::acceptance::{AcceptanceRule, Judgement, SensorVerdict};
use palpate_data::dataset::calibration::calibration_of_run;
use palpate_data::dataset::evaluate::{EvaluateError, Trial};
use palpate_data::dataset::{Evidence, Presses, Recorded};
use palpate_data::recipe::Phase;
use palpate_solver::{Belongs, Deviation, FamilySensor, ForceKnown, Model, Prior, Setting, UnitChange, Update};

/// What decides about a sensor.
#[derive(Clone, Copy)]
pub struct Basis<'a> {
    /// The rig.
    pub rig: &'a RigSpec,
    /// The acceptance rule.
    pub rule: Option<&'a AcceptanceRule>,
    /// The design's prior.
    pub prior: Option<&'a Prior>,
    /// Expected mean location error, mm, above which more presses are used.
    pub enough_mm: Option<f64>,
}

/// The conclusion about one sensor.
pub struct Conclusion {
    /// The verdict by the rule; `None` without a rule.
    pub judgement: Option<Judgement>,
    /// Numbers of calibration and test presses that count.
    pub presses: (usize, usize),
    /// Difference from the design; empty without a prior.
    pub change: Vec<UnitChange>,
    /// Whether the sensor isn't one of the design.
    pub is_refused: bool,
    /// What a person should know.
    pub reasons: Vec<String>,
    /// Whether a further recipe should be pressed, if there is one.
    pub needs_more: bool,
    /// The calibrated sensor; `None` without a prior, and for a sensor that is refused.
    pub model: Option<Model>,
}

/// Concludes from all runs of a sensor. `is_last` states that there is no further recipe.
pub fn conclude(recorded: &[Recorded], basis: &Basis<'_>, is_last: bool) -> Conclusion {
    let mut all = recorded.iter().map(Recorded::presses);
    let Some(mut presses) = all.next() else { return Conclusion::nothing() };
    all.for_each(|more| presses.join(more));
    let count = |phase| presses.sound(phase).count();
    let mut conclusion =
        Conclusion { presses: (count(Phase::Calibration), count(Phase::Test)), ..Conclusion::nothing() };
    let layout = Some(&basis.rig.array.layout);
    let trial = Trial::of_run(&presses, layout);
    let u_place_mm = basis.rig.u_place_mm();
    let evidence = Evidence { presses: &presses, layout, runs: recorded.iter().collect(), u_place_mm };
    match basis.prior.map(|prior| family_sensor(prior, &presses, basis.rig)) {
        // the design names broken units too
        Some(Ok(family_sensor)) => conclusion.with(family_sensor, basis, &evidence, &trial, is_last),
        without => {
            conclusion.judgement = basis.rule.map(|rule| evidence.judge(rule, &trial, &[]));
            conclusion.reasons.extend(trial.as_ref().ok().and_then(Trial::broken_outputs).unwrap_or_default());
            let why = without.and_then(Result::err);
            conclusion.reasons.extend(why.map(|why| format!("not compared with the design: {why}")));
        }
    }
    conclusion
}

fn family_sensor(prior: &Prior, presses: &Presses, rig: &RigSpec) -> Result<FamilySensor, String> {
    let calibration = calibration_of_run(presses, ForceKnown::default()).map_err(|why| why.to_string())?;
    let setting = Setting::of_layout(Some(&rig.array.layout));
    prior.family_sensor(&calibration, &setting).map_err(|why| why.to_string())
}

impl Conclusion {
    fn nothing() -> Self {
        Conclusion {
            judgement: None,
            presses: (0, 0),
            change: Vec::new(),
            is_refused: false,
            reasons: Vec::new(),
            needs_more: false,
            model: None,
        }
    }

    fn with(
        &mut self,
        family_sensor: FamilySensor,
        basis: &Basis<'_>,
        evidence: &Evidence<'_>,
        trial: &Result<Trial<'_>, EvaluateError>,
        is_last: bool,
    ) {
        let too_large = basis.enough_mm.filter(|enough_mm| family_sensor.expected_mm > *enough_mm && !is_last);
        let too_large = too_large.and_then(|enough_mm| Some((enough_mm, basis.prior?.least_mm(&family_sensor))));
        let of_another_way = other_way(&family_sensor);
        let FamilySensor { model, change, belongs, expected_mm, .. } = family_sensor;
        self.change = change.units;
        let by_model = |rule: &AcceptanceRule| {
            let evaluation = trial.as_ref().ok().and_then(|trial| trial.evaluate_with(model.fitted()).ok());
            judge_by(rule, evidence, trial, model.fitted(), evaluation.as_slice())
        };
        match belongs {
            Belongs::Outsider(deviations) => {
                self.is_refused = true;
                self.judgement = basis.rule.map(|rule| Judgement {
                    verdict: SensorVerdict::NotAccepted,
                    reasons: vec![text("refused", &deviations)],
                    ..by_model(rule)
                });
                if basis.rule.is_none() {
                    self.reasons.push(text("refused", &deviations));
                }
            }
            Belongs::Beyond(deviations) if !is_last => {
                self.needs_more = true;
                self.reasons.push(text("more presses are needed", &deviations));
            }
            // a full calibration doesn't need the design
            Belongs::Beyond(deviations) => {
                self.judgement = basis.rule.map(|rule| evidence.judge(rule, trial, &[]));
                self.reasons.push(text("calibrated without the prior", &deviations));
            }
            Belongs::Typical => {
                self.reasons.extend(of_another_way);
                if let Some((enough_mm, least_mm)) = too_large {
                    let reason = format!("expected error {expected_mm:.3} mm, above the {enough_mm} mm of `enough_mm`");
                    self.needs_more = expected_mm > WORTHWHILE * least_mm;
                    self.reasons.push(match self.needs_more {
                        true => format!("more presses are needed: {reason}"),
                        false => format!("{reason}; with any number of presses it stays at {least_mm:.3} mm"),
                    });
                }
                self.judgement = basis.rule.map(by_model);
                let test = trial.as_ref().ok().and_then(Trial::tested);
                self.model = Some(match test {
                    Some(test) => model.with_half_widths_of(&test),
                    None => model,
                });
            }
        }
    }
}

/// States which way the presses preferred to that of the prior, if they did.
fn other_way(family_sensor: &FamilySensor) -> Option<String> {
    let FamilySensor { update, tried, .. } = family_sensor;
    let (own, chosen) = (tried.first()?, tried.iter().find(|tried| tried.update == *update)?);
    let how = match update {
        Update::Corrected => "calibrated with a correction of the prior's map",
        Update::NewAlone => "calibrated by the sensor's presses alone",
        _ => return None,
    };
    let [chosen_mm, own_mm] = [chosen, own].map(|tried| tried.held_out.location_mm);
    Some(format!("{how}: mean error {chosen_mm:.3} mm on held-out presses, with the prior's map {own_mm:.3} mm"))
}

/// Ratio of the expected error to the least possible one from which more presses are worth their time.
const WORTHWHILE: f64 = 1.05;

fn text(what: &str, deviations: &[Deviation]) -> String {
    let all: Vec<String> = deviations.iter().map(Deviation::text).collect();
    format!("{what}: {}", all.join("; "))
}
