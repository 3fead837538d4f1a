//! Measured quantities of a sensor that an acceptance rule needs, and the verdict.

use super::characteristics::{Repeatability, Staircases, UnitCharacteristics, characterise, repeats};
use super::evaluate::{EvaluateError, Trial, is_to_evaluate};
use super::{Manifest, Press, Presses, Recorded, RecordedContact, Status};
use crate::acceptance::bound::sd_upper_factor;
use crate::acceptance::{AcceptanceRule, Judgement, LimitedFigure, Measured, TestErrors, Worst, judge};
use crate::recipe::Phase;
use palpate_core::quantity::ArrayLayout;
use palpate_solver::{BEST, Evaluation};
use std::collections::BTreeSet;

/// Ratio of the degrees of freedom of successive differences to those of a standard deviation (von Neumann et al. 1941).
const SUCCESSIVE_FREEDOM: f64 = 2.0 / 3.0;

/// All recorded data of a sensor.
pub struct Evidence<'a> {
    /// Presses of all its runs.
    pub presses: &'a Presses,
    /// Positions of its units; `None` for tables.
    pub layout: Option<&'a ArrayLayout>,
    /// Its runs; empty for tables.
    pub runs: Vec<&'a Recorded>,
    /// Standard uncertainty of the pressed places, mm; `None` if it is unknown.
    pub u_place_mm: Option<f64>,
}

impl Evidence<'_> {
    /// Returns the verdict by a rule. `trial` is the sensor's calibration and test; `known` are its existing evaluations.
    pub fn judge(
        &self,
        rule: &AcceptanceRule,
        trial: &Result<Trial<'_>, EvaluateError>,
        known: &[Evaluation],
    ) -> Judgement {
        let is_by_rule = |evaluation: &&Evaluation| match rule.method.as_str() {
            BEST => evaluation.choice.is_some(),
            method => evaluation.choice.is_none() && evaluation.solver == method,
        };
        let evaluated = match (trial, known.iter().find(is_by_rule)) {
            (_, Some(evaluation)) => Ok(evaluation.clone()),
            (Ok(trial), None) => trial.evaluate(&rule.method).map_err(|why| why.text()),
            (Err(why), None) => Err(why.text()),
        };
        let mut measured = self.measured(trial.as_ref().ok(), evaluated.as_ref().ok());
        measured.doubtful = self.doubtful(rule.called_sound);
        measured.worst = self.worst(rule);
        let judgement = judge(rule, &measured);
        match evaluated {
            // a rule without limits of places or forces needs no test
            Err(why) if judgement.checks.iter().any(|check| check.kind.is_of_test() && check.value.is_none()) => {
                Judgement { reasons: [vec![why], judgement.reasons].concat(), ..judgement }
            }
            _ => judgement,
        }
    }

    fn measured(&self, trial: Option<&Trial<'_>>, evaluation: Option<&Evaluation>) -> Measured {
        let mut measured = trial.map(Trial::counted).unwrap_or_else(|| self.counted());
        measured.incomplete = self.incomplete();
        measured.without_load_cell = self.runs.iter().any(|run| run.manifest.facts.without_load_cell);
        let confirmed = self.runs.iter().filter_map(|run| run.manifest.facts.confirmed_within_mm);
        measured.confirmed_within_mm = confirmed.reduce(f64::max);
        measured.cell_unchecked = self.runs.iter().any(|run| run.manifest.cell_unchecked);
        if let Some(evaluation) = evaluation {
            let sizes = evaluation.presses.iter().map(|press| press.location_error_mm).collect();
            measured.location = Some(TestErrors { sizes, u_truth: self.u_place_mm });
            let forces: Option<Vec<f64>> = evaluation.presses.iter().map(|press| press.force_error_n).collect();
            let u_force_n = trial.and_then(Trial::u_force_n);
            measured.force =
                forces.filter(|forces| !forces.is_empty()).map(|sizes| TestErrors { sizes, u_truth: u_force_n });
            let depths: Option<Vec<f64>> = evaluation.presses.iter().map(|press| press.depth_error_mm).collect();
            let u_depth_mm = trial.and_then(Trial::u_depth_mm);
            measured.depth =
                depths.filter(|depths| !depths.is_empty()).map(|sizes| TestErrors { sizes, u_truth: u_depth_mm });
            measured.test_unsolved = evaluation.unsolved.len();
        }
        measured
    }

    /// Returns the number of counted presses, if no calibration has a test.
    fn counted(&self) -> Measured {
        let count = |phase| self.presses.sound(phase).count();
        let is_flagged = |press: &&Press| press.is_flagged() && is_to_evaluate(press);
        Measured {
            calibration_presses: count(Phase::Calibration),
            test_presses: count(Phase::Test),
            flagged_presses: self.presses.presses.iter().filter(is_flagged).count(),
            ..Measured::default()
        }
    }

    /// Returns the worst unit's or channel's figures of the kinds that the rule limits.
    pub(super) fn worst(&self, rule: &AcceptanceRule) -> Vec<Worst> {
        let is_limited = |figure: LimitedFigure| rule.limits.iter().any(|limit| limit.figure == figure);
        let of_units = self.layout.filter(|_| KINDS.iter().any(|(figure, ..)| is_limited(*figure)));
        let mut worst = of_units.map(|layout| self.worst_units(layout)).unwrap_or_default();
        worst.extend(is_limited(LimitedFigure::Noise).then(|| self.noise()).flatten());
        worst
    }

    /// Returns the worst unit's characteristics of each kind.
    fn worst_units(&self, layout: &ArrayLayout) -> Vec<Worst> {
        let Some(staircases) = Staircases::of_run(self.presses, layout) else { return Vec::new() };
        let units = characterise(&staircases, Repeatability::default());
        let n =
            staircases.readings.iter().map(|readings| repeats(readings)).filter(|count| *count > 0).min().unwrap_or(0);
        KINDS.into_iter().filter_map(|(figure, value, upper)| worst(figure, &units, n, value, upper)).collect()
    }

    /// Returns a message about incomplete runs. Their missing data might have changed the verdict.
    fn incomplete(&self) -> Option<String> {
        let run = self.runs.iter().find(|run| run.manifest.status != Status::Complete)?;
        let Manifest { status, facts, presses_done, .. } = &run.manifest;
        let name = run.name();
        Some(format!("{name} is {}: {presses_done} of {} presses", status.name(), facts.presses_planned))
    }

    /// Returns a message about a check that failed, or about a press that a person called sound unless that is accepted. The presses
    /// before may be wrong.
    fn doubtful(&self, accepts_called_sound: bool) -> Option<String> {
        let doubt = |run: &&Recorded| {
            let manifest = &run.manifest;
            let called_sound = manifest.called_sound.as_ref().filter(|_| !accepts_called_sound);
            Some(format!("{}: {}", run.name(), manifest.check_failed.as_ref().or(called_sound)?))
        };
        self.runs.iter().find_map(doubt)
    }

    /// Returns the noisiest channel without load. The noise is the difference between the readings without load before successive presses
    /// of a run, so drift doesn't count.
    fn noise(&self) -> Option<Worst> {
        // a contact whose readings were missed has no outputs
        let is_read = |contact: &&RecordedContact| !contact.no_load_before.outputs.is_empty();
        let runs: Vec<Vec<&RecordedContact>> =
            self.runs.iter().map(|run| run.contacts.iter().filter(is_read).collect()).collect();
        let contacts = || runs.iter().map(Vec::as_slice);
        let channels = contacts().flatten().map(|contact| contact.no_load_before.outputs.len()).min().unwrap_or(0);
        let changes = contacts().map(|contacts| contacts.len().saturating_sub(1)).sum::<usize>();
        let percent = |channel: usize| {
            let calibrated = self.presses.sound(Phase::Calibration);
            let full_scale = calibrated.map(|press| press.outputs[channel].abs()).fold(0.0, f64::max);
            let output = |contact: &RecordedContact| contact.no_load_before.outputs[channel];
            let pairs = contacts().flat_map(|contacts| contacts.windows(2));
            let squares: f64 = pairs.map(|pair| (output(pair[1]) - output(pair[0])).powi(2)).sum();
            (full_scale > 0.0).then(|| 100.0 * (squares / (2 * changes) as f64).sqrt() / full_scale)
        };
        if changes == 0 {
            return None;
        }
        let all: Vec<Option<f64>> = (0..channels).map(percent).collect();
        let value = all.iter().copied().flatten().reduce(f64::max)?;
        let upper = sd_upper_factor(SUCCESSIVE_FREEDOM * changes as f64).map(|factor| factor * value);
        let missing = all.iter().filter(|value| value.is_none()).count();
        Some(Worst { figure: LimitedFigure::Noise, value, upper, n: changes + 1, missing })
    }
}

type CharacteristicValue = fn(&UnitCharacteristics) -> Option<f64>;

/// Characteristics that can be limited: the figure, its value and its upper bound.
const KINDS: [(LimitedFigure, CharacteristicValue, CharacteristicValue); 5] = [
    (
        LimitedFigure::Repeatability,
        |unit| unit.repeatability_loading_percent,
        |unit| unit.repeatability_loading_interval_percent.map(|(_, most)| most),
    ),
    (LimitedFigure::Hysteresis, |unit| unit.hysteresis_percent, |unit| Some(unit.hysteresis_known?.upper)),
    (
        LimitedFigure::HysteresisOfReading,
        |unit| unit.hysteresis_of_reading_percent,
        |unit| Some(unit.hysteresis_of_reading_known?.upper),
    ),
    (LimitedFigure::Linearity, |unit| unit.linearity_percent, |unit| Some(unit.linearity_known?.upper)),
    (LimitedFigure::ZeroReturn, |unit| unit.zero_return_percent, |unit| Some(unit.zero_return_known?.upper)),
];

fn worst(
    figure: LimitedFigure,
    units: &[UnitCharacteristics],
    n: usize,
    value: CharacteristicValue,
    upper: CharacteristicValue,
) -> Option<Worst> {
    let measured: Vec<&UnitCharacteristics> = units.iter().filter(|unit| value(unit).is_some()).collect();
    let largest = |of: CharacteristicValue| {
        let all: Option<Vec<f64>> = measured.iter().map(|unit| of(unit)).collect();
        all?.into_iter().map(f64::abs).reduce(f64::max)
    };
    // channels of one unit count once
    let missing: BTreeSet<usize> = units.iter().filter(|unit| value(unit).is_none()).map(|unit| unit.unit).collect();
    Some(Worst { figure, value: largest(value)?, upper: largest(upper), n, missing: missing.len() })
}
