//! The only verdict: measured values of a sensor, compared with a rule.

use super::bound::{CONFIDENCE, MEAN_PRESSES_LEAST, mean_upper, quantile_least, quantile_upper, share_lower};
use super::rule::{AcceptanceRule, Decision, Limit, LimitedFigure};
use palpate_core::quantity::percentile;
use serde::{Deserialize, Serialize};

/// Percentile that can be limited, as a fraction.
const PERCENTILE: f64 = 0.95;

/// One-sided 95 % quantile of the normal distribution. It is the factor for the contribution of the truth's standard uncertainty
/// to a bound.
const NORMAL_95: f64 = 1.645;

/// Whether a sensor satisfies a rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorVerdict {
    /// Every figure is within its limit; with a guarded rule, the bound of every figure is within its limit.
    Accepted,
    /// A figure exceeds its limit.
    NotAccepted,
    /// Too little was measured to decide.
    NotDecided,
}

/// Measured quantities of a sensor that a rule can use.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Number of calibration presses that count.
    pub calibration_presses: usize,
    /// Number of test presses that count.
    pub test_presses: usize,
    /// Number of test presses for which the method has no answer.
    pub test_unsolved: usize,
    /// Number of test presses that equal a calibration press in every digit.
    pub test_repeats_calibration: usize,
    /// Number of test presses that equal another test press in every digit.
    pub test_repeats_itself: usize,
    /// Number of test presses at places that the calibration also pressed.
    pub at_calibrated_places: usize,
    /// Whether the method assumes that every contact has the force of the calibration.
    pub constant_load: bool,
    /// Whether the test was held out of the calibration's own table or run.
    pub is_held_out: bool,
    /// Description of the run that isn't complete.
    pub incomplete: Option<String>,
    /// Description of the check that failed.
    pub doubtful: Option<String>,
    /// Whether a known weight for the load cell wasn't used after the run.
    pub cell_unchecked: bool,
    /// Whether a run had no load cell.
    pub without_load_cell: bool,
    /// Uncertainty of a surface that a person confirmed, mm.
    pub confirmed_within_mm: Option<f64>,
    /// Location errors, mm; `None` if there was no test.
    pub location: Option<TestErrors>,
    /// Absolute force errors, N; `None` if no true force is known.
    pub force: Option<TestErrors>,
    /// Absolute depth errors, mm; `None` if no depth was solved or no true depth is known.
    pub depth: Option<TestErrors>,
    /// Figures of single units, the worst value for each kind.
    pub worst: Vec<Worst>,
    /// Dead or saturated channels with their faults; `None` if there was no calibration.
    pub broken_outputs: Option<Vec<String>>,
    /// Number of flagged presses of calibration and test.
    pub flagged_presses: usize,
}

/// Errors of the test presses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TestErrors {
    /// Sizes of the errors, mm or N, in any order.
    pub sizes: Vec<f64>,
    /// Standard uncertainty of the truth that is common to all errors, mm or N; `None` if it is unknown.
    pub u_truth: Option<f64>,
}

/// Worst value of a figure that every unit or channel has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// The figure.
    pub figure: LimitedFigure,
    /// Its largest value among the units.
    pub value: f64,
    /// Largest of the units' upper bounds; `None` if one unit has no bound.
    pub upper: Option<f64>,
    /// Number of readings for a unit's value.
    pub n: usize,
    /// Number of units or channels without a value.
    pub missing: usize,
}

/// Result of checking one limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LimitCheck {
    /// Key that sets the limit.
    pub figure: &'static str,
    /// Measured value; `None` if it wasn't measured.
    pub value: Option<f64>,
    /// One-sided 95 % bound of the value, including the bench's uncertainty; for a fraction the lower bound. Only with a guarded
    /// rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bound: Option<f64>,
    /// The limit, in the figure's unit.
    pub limit: f64,
    /// For a fraction: the largest error that counts, mm or N.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reach: Option<f64>,
    /// Number of presses or readings.
    pub n: usize,
    /// The result of this limit alone.
    pub verdict: SensorVerdict,
    /// Reason why the value isn't accepted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Warning to the reader about a figure that is accepted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warning: Option<String>,
    /// The figure itself.
    #[serde(skip)]
    pub kind: LimitedFigure,
}

/// A verdict and the data on which it is based.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// The verdict.
    pub verdict: SensorVerdict,
    /// `simple` or `guarded`.
    pub rule: &'static str,
    /// Method that finds places and forces.
    pub method: String,
    /// File that gave the rule after the run; `None` if the run's own recipe gave it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub judged_afterwards_by: Option<String>,
    /// Number of calibration presses that count.
    pub calibration_presses: usize,
    /// Number of test presses that count.
    pub test_presses: usize,
    /// Reasons why there is no decision that apply to any limits.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<String>,
    /// Notes to the reader about the presses that count.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Outputs that are broken in calibration and test, with their faults.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub broken_outputs: Vec<String>,
    /// Checks, one for each limit.
    pub checks: Vec<LimitCheck>,
}

/// Compares the measured values with a rule. This is the only function that decides.
pub fn judge(rule: &AcceptanceRule, measured: &Measured) -> Judgement {
    let checks: Vec<LimitCheck> = rule.limits.iter().map(|limit| check(limit, rule.decision, measured)).collect();
    let reasons = reasons(rule, measured);
    let is = |verdict: SensorVerdict| checks.iter().any(|check| check.verdict == verdict);
    let verdict = match () {
        // a sensor that exceeds a limit isn't accepted, with however few presses, unless none count
        () if measured.is_held_out && !rule.holdout => SensorVerdict::NotDecided,
        () if measured.test_repeats_calibration > 0 || measured.doubtful.is_some() => SensorVerdict::NotDecided,
        () if is(SensorVerdict::NotAccepted) => SensorVerdict::NotAccepted,
        () if !reasons.is_empty() || is(SensorVerdict::NotDecided) => SensorVerdict::NotDecided,
        () => SensorVerdict::Accepted,
    };
    Judgement {
        verdict,
        rule: rule.decision.word(),
        method: rule.method.clone(),
        judged_afterwards_by: rule.afterwards_by.clone(),
        calibration_presses: measured.calibration_presses,
        test_presses: measured.test_presses,
        reasons,
        notes: notes(measured),
        broken_outputs: measured.broken_outputs.clone().unwrap_or_default(),
        checks,
    }
}

/// Returns notes for the reader about the counted presses, for any verdict.
fn notes(measured: &Measured) -> Vec<String> {
    let Measured { at_calibrated_places: at, flagged_presses: flagged, test_presses, .. } = measured;
    let all = [
        (*at > 0).then(|| format!("{at} of {test_presses} test presses are at places of the calibration")),
        (*flagged > 0).then(|| format!("{flagged} flagged presses are excluded")),
        measured.confirmed_within_mm.map(|mm| {
            format!(
                "depths count from a surface that a person confirmed: its uncertainty, {mm} mm, isn't in their errors"
            )
        }),
        measured.cell_unchecked.then(|| "the load cell was not checked after the run".to_owned()),
        measured.is_held_out.then(|| "the test presses were held out of the calibration's own presses".to_owned()),
        measured.constant_load.then(|| "every contact was assumed to have the force of the calibration".to_owned()),
    ];
    all.into_iter().flatten().collect()
}

/// Returns the reasons why nothing can be decided for any limits.
fn reasons(rule: &AcceptanceRule, measured: &Measured) -> Vec<String> {
    let fewer = |what: &str, found: usize, least: usize| {
        (found < least).then(|| format!("{found} valid {what} presses; the rule requires {least}"))
    };
    // a rule without limits of places or forces needs no presses for them
    let is_of_test = rule.limits.iter().any(|limit| limit.figure.is_of_test());
    let (repeated, twice) = (measured.test_repeats_calibration, measured.test_repeats_itself);
    let twice =
        (twice > 0).then(|| format!("{twice} of {} test presses are identical to another one", measured.test_presses));
    let repeats = (repeated > 0)
        .then(|| format!("{repeated} of {} test presses are identical to calibration presses", measured.test_presses));
    let held_out = "the rule requires a test of its own; with `holdout = true` it accepts presses that were held out";
    let all = [
        measured.incomplete.clone(),
        measured.doubtful.clone(),
        (measured.without_load_cell && rule.decision == Decision::Guarded)
            .then(|| "a guarded rule needs a load cell, and the run had none".to_owned()),
        (measured.is_held_out && !rule.holdout).then(|| held_out.to_owned()),
        repeats,
        twice,
        fewer("calibration", measured.calibration_presses, rule.calibration_presses_least).filter(|_| is_of_test),
        fewer("test", measured.test_presses, rule.test_presses_least).filter(|_| is_of_test),
    ];
    all.into_iter().flatten().collect()
}

/// Value, its bound or the reason why it has none, and the number of presses or readings.
struct FoundValue {
    value: f64,
    bound: Result<f64, String>,
    n: usize,
}

fn check(limit: &Limit, decision: Decision, measured: &Measured) -> LimitCheck {
    let Limit { figure, limit: most, reach } = *limit;
    let blank = LimitCheck {
        figure: figure.key(),
        value: None,
        bound: None,
        limit: most,
        reach,
        n: 0,
        verdict: SensorVerdict::NotDecided,
        reason: None,
        warning: None,
        kind: figure,
    };
    let FoundValue { value, bound, n } = match found(limit, measured) {
        Ok(found) => found,
        Err(reason) => return LimitCheck { reason: Some(reason), ..blank },
    };
    let keeps = |value: f64| if figure.is_share() { value >= most } else { value <= most };
    let (verdict, reason) = match (decision, &bound) {
        _ if !keeps(value) => (SensorVerdict::NotAccepted, Some("exceeds the limit".to_owned())),
        (Decision::Simple, _) => (SensorVerdict::Accepted, None),
        (Decision::Guarded, Ok(bound)) if keeps(*bound) => (SensorVerdict::Accepted, None),
        (Decision::Guarded, Ok(_)) => (SensorVerdict::NotDecided, Some("its bound exceeds the limit".to_owned())),
        (Decision::Guarded, Err(why)) => (SensorVerdict::NotDecided, Some(why.clone())),
    };
    let reason = reason.map(|text| if figure.is_share() { text.replace("exceeds", "is below") } else { text });
    // few repeats leave a unit's figure open: with five a repeatability scatters by a third
    let is_open = |bound: &&f64| figure.is_of_units() && !keeps(**bound) && verdict == SensorVerdict::Accepted;
    let warning = bound.as_ref().ok().filter(is_open).map(|bound| {
        let (bound, unit) = (figure.shown(*bound, figure.digits()), figure.unit());
        format!("within the limit, but with {n} repeats its bound is {bound} {unit}")
    });
    let bound = bound.ok().filter(|_| decision == Decision::Guarded);
    LimitCheck { value: Some(value), bound, n, verdict, reason, warning, ..blank }
}

fn found(limit: &Limit, measured: &Measured) -> Result<FoundValue, String> {
    let errors_of = |errors: &Option<TestErrors>, missing: &str| match errors {
        Some(errors) => of_errors(limit, errors, measured.test_unsolved),
        None => Err(missing.to_owned()),
    };
    match limit.figure {
        LimitedFigure::LocationMean | LimitedFigure::LocationP95 | LimitedFigure::LocationWithin => {
            errors_of(&measured.location, "no test was evaluated")
        }
        LimitedFigure::ForceMean | LimitedFigure::ForceP95 | LimitedFigure::ForceWithin => {
            errors_of(&measured.force, "no true force is known")
        }
        LimitedFigure::DepthMean | LimitedFigure::DepthP95 | LimitedFigure::DepthWithin => {
            errors_of(&measured.depth, "no depth was solved, or no true depth is known")
        }
        LimitedFigure::BrokenChannels => {
            counted(measured.broken_outputs.as_ref().map(Vec::len), measured.calibration_presses)
        }
        LimitedFigure::FlaggedPresses => {
            counted(Some(measured.flagged_presses), measured.calibration_presses + measured.test_presses)
        }
        figure => {
            let worst = measured.worst.iter().find(|worst| worst.figure == figure);
            let how = if figure == LimitedFigure::Noise { "a run" } else { "a step with `staircase`" };
            let worst = worst.ok_or_else(|| format!("not measured: {how} of palpate measures it"))?;
            let Worst { value, upper, n, missing, .. } = *worst;
            if missing > 0 {
                let noun = if figure == LimitedFigure::Noise { "channels" } else { "units" };
                return Err(format!("{missing} {noun} have no value (not measured, or without an output)"));
            }
            Ok(FoundValue { value, bound: upper.ok_or_else(|| "too few repeats for a bound".to_owned()), n })
        }
    }
}

/// Returns a count in this sample. Its bound is the count itself.
fn counted(count: Option<usize>, n: usize) -> Result<FoundValue, String> {
    let value = count.ok_or("it was not measured")? as f64;
    Ok(FoundValue { value, bound: Ok(value), n })
}

fn of_errors(limit: &Limit, errors: &TestErrors, unsolved: usize) -> Result<FoundValue, String> {
    let n = errors.sizes.len() + unsolved;
    let mut sorted = errors.sizes.clone();
    sorted.sort_by(f64::total_cmp);
    // a press without an answer is farther off than any limit
    sorted.extend(std::iter::repeat_n(f64::INFINITY, unsolved));
    if n == 0 {
        return Err("no test was evaluated".to_owned());
    }
    let truth = errors.u_truth.map(|u| NORMAL_95 * u).ok_or_else(|| unknown_truth(limit.figure));
    let fewer = |least: usize| {
        format!("{n} test presses; its {:.0} % bound needs {least} (a simple rule needs no bound)", 100.0 * CONFIDENCE)
    };
    match limit.figure {
        LimitedFigure::LocationMean | LimitedFigure::ForceMean | LimitedFigure::DepthMean => {
            if unsolved > 0 {
                return Err(format!("{unsolved} test presses have no answer, so there is no mean"));
            }
            let value = sorted.iter().sum::<f64>() / n as f64;
            let bound = mean_upper(&sorted).ok_or_else(|| fewer(MEAN_PRESSES_LEAST));
            Ok(FoundValue { value, bound: widened_by(value, bound, truth), n })
        }
        LimitedFigure::LocationP95 | LimitedFigure::ForceP95 | LimitedFigure::DepthP95 => {
            let value = percentile(&sorted, PERCENTILE);
            let bound = quantile_upper(&sorted, PERCENTILE).ok_or_else(|| fewer(quantile_least(PERCENTILE)));
            Ok(FoundValue { value, bound: widened_by(value, bound, truth), n })
        }
        _ => {
            let reach = limit.reach.unwrap_or_default();
            let count = |reach: f64| sorted.iter().filter(|size| **size <= reach).count();
            let value = count(reach) as f64 / n as f64;
            // an error that the truth's own uncertainty could hide doesn't count as within
            Ok(FoundValue { value, bound: truth.map(|truth| share_lower(count(reach - truth), n)), n })
        }
    }
}

/// The bound with the uncertainty of the truth; or every reason why there is none.
fn widened_by(value: f64, bound: Result<f64, String>, truth: Result<f64, String>) -> Result<f64, String> {
    match (bound, truth) {
        (Ok(bound), Ok(truth)) => Ok(widened(value, bound, truth)),
        (Err(few), Err(unknown)) => Err(format!("{few}; {unknown}")),
        (Err(why), _) | (_, Err(why)) => Err(why),
    }
}

fn unknown_truth(figure: LimitedFigure) -> String {
    match figure {
        LimitedFigure::LocationMean | LimitedFigure::LocationP95 | LimitedFigure::LocationWithin => {
            "the uncertainty of the positions isn't known (`certificate` in [stage] of the rig)".to_owned()
        }
        LimitedFigure::DepthMean | LimitedFigure::DepthP95 | LimitedFigure::DepthWithin => {
            "the uncertainty of the depths isn't known (`certificate` in [stage]; `stiffness_n_mm` of the load cell and of an arm); a simple \
             rule doesn't need it".to_owned()
        }
        _ => "the uncertainty of the forces isn't known (`certificate` in [load_cell] of the rig, or `palpate doctor --check-weight-n`)".to_owned(),
    }
}

/// Combines the bound from the presses' scatter with the possible error of the truth. Both are for 95 % and independent.
fn widened(value: f64, bound: f64, truth: f64) -> f64 {
    value + (bound - value).max(0.0).hypot(truth)
}

impl Judgement {
    /// Returns the reasons why the sensor isn't accepted: first the reasons that don't depend on the limits, then each limit that
    /// isn't satisfied. Also returns the warnings about satisfied limits.
    pub fn all_reasons(&self) -> impl Iterator<Item = String> {
        let of_check = |check: &LimitCheck| match (&check.reason, &check.warning) {
            (Some(_), _) => Some(check.compared()),
            (None, warning) => {
                warning.as_ref().map(|warning| format!("{}: {warning}", check.kind.full_name(check.reach)))
            }
        };
        self.reasons.iter().cloned().chain(self.checks.iter().filter_map(of_check))
    }
}

impl LimitCheck {
    /// Returns the figure with its value, its bound and its limit, and the reason why it isn't accepted.
    pub fn compared(&self) -> String {
        let (name, unit) = (self.kind.full_name(self.reach), self.kind.unit());
        let shown = |value: f64| format!("{} {unit}", self.shown(Some(value))).trim_end().to_owned();
        let reason = self.reason.as_deref().unwrap_or_default();
        let Some(value) = self.value.map(shown) else { return format!("{name}: {reason}") };
        let bound = self.bound.map_or(String::new(), |bound| format!(" (95 % bound {})", shown(bound)));
        let limit = shown(self.limit);
        match self.verdict {
            SensorVerdict::NotAccepted => format!("{name} {value}{bound} {reason} {limit}"),
            SensorVerdict::NotDecided => format!("{name} {value}{bound}, limit {limit}: {reason}"),
            SensorVerdict::Accepted => format!("{name} {value}{bound}, limit {limit}"),
        }
    }

    /// Returns a value of the figure without its unit, with enough digits to distinguish the result from the limit.
    pub fn shown(&self, value: Option<f64>) -> String {
        let Some(value) = value else { return "-".to_owned() };
        let tells = |digits: &usize| {
            let found = self.value.filter(|found| *found != self.limit);
            found.is_none_or(|found| self.kind.shown(found, *digits) != self.kind.shown(self.limit, *digits))
        };
        let digits = (self.kind.digits()..DIGITS_MOST).find(tells).unwrap_or(DIGITS_MOST);
        self.kind.shown(value, digits)
    }
}

/// Largest number of a value's digits after the decimal point.
const DIGITS_MOST: usize = 9;

impl SensorVerdict {
    /// Describes the verdict in words.
    pub const fn text(self) -> &'static str {
        match self {
            SensorVerdict::Accepted => "accepted",
            SensorVerdict::NotAccepted => "not accepted",
            SensorVerdict::NotDecided => "not decided",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rule(decision: Decision, limits: &[(LimitedFigure, f64, Option<f64>)]) -> AcceptanceRule {
        AcceptanceRule {
            decision,
            method: "best".to_owned(),
            calibration_presses_least: 10,
            test_presses_least: 2,
            holdout: false,
            limits: limits.iter().map(|&(figure, limit, reach)| Limit { figure, limit, reach }).collect(),
            called_sound: false,
            afterwards_by: None,
        }
    }

    /// A hundred errors of 0.01 to 1.00 mm.
    fn measured() -> Measured {
        let sizes = (1..=100).map(|rank| 0.01 * f64::from(rank)).collect();
        Measured {
            calibration_presses: 100,
            test_presses: 100,
            location: Some(TestErrors { sizes, u_truth: Some(0.0) }),
            worst: vec![Worst {
                figure: LimitedFigure::Repeatability,
                value: 2.0,
                upper: Some(4.0),
                n: 20,
                missing: 0,
            }],
            broken_outputs: Some(Vec::new()),
            ..Measured::default()
        }
    }

    fn verdict(
        decision: Decision,
        limit: (LimitedFigure, f64, Option<f64>),
        measured: &Measured,
    ) -> (SensorVerdict, String) {
        let judgement = judge(&rule(decision, &[limit]), measured);
        (judgement.verdict, judgement.all_reasons().collect::<Vec<_>>().join("; "))
    }

    #[test]
    fn held_out_presses_decide_only_with_holdout_in_the_rule() {
        let held_out = Measured { is_held_out: true, ..measured() };
        for most_mm in [0.1, 0.9] {
            let rule = rule(Decision::Simple, &[(LimitedFigure::LocationMean, most_mm, None)]);
            let judged = judge(&rule, &held_out);
            assert_eq!(judged.verdict, SensorVerdict::NotDecided);
            assert!(judged.reasons[0].contains("`holdout = true`"), "{:?}", judged.reasons);
            let permitted = judge(&AcceptanceRule { holdout: true, ..rule.clone() }, &held_out);
            assert_eq!(permitted.verdict, judge(&rule, &measured()).verdict);
            assert!(permitted.reasons.is_empty() && permitted.notes[0].contains("held out"), "{permitted:?}");
        }
    }

    #[test]
    fn a_figure_its_bound_and_the_limit_decide() {
        // mean 0.505, its bound 0.555; 95th percentile 0.95, its bound the 99th; 90 within 0.9, at least 83.6 % of all
        for (limit, verdicts) in [
            ((LimitedFigure::LocationMean, 0.504, None), [SensorVerdict::NotAccepted, SensorVerdict::NotAccepted]),
            ((LimitedFigure::LocationMean, 0.53, None), [SensorVerdict::Accepted, SensorVerdict::NotDecided]),
            ((LimitedFigure::LocationMean, 0.56, None), [SensorVerdict::Accepted, SensorVerdict::Accepted]),
            ((LimitedFigure::LocationP95, 0.95, None), [SensorVerdict::NotAccepted, SensorVerdict::NotAccepted]),
            ((LimitedFigure::LocationP95, 0.98, None), [SensorVerdict::Accepted, SensorVerdict::NotDecided]),
            ((LimitedFigure::LocationP95, 0.991, None), [SensorVerdict::Accepted, SensorVerdict::Accepted]),
            (
                (LimitedFigure::LocationWithin, 0.91, Some(0.9)),
                [SensorVerdict::NotAccepted, SensorVerdict::NotAccepted],
            ),
            ((LimitedFigure::LocationWithin, 0.85, Some(0.9)), [SensorVerdict::Accepted, SensorVerdict::NotDecided]),
            ((LimitedFigure::LocationWithin, 0.83, Some(0.9)), [SensorVerdict::Accepted, SensorVerdict::Accepted]),
            ((LimitedFigure::Repeatability, 3.0, None), [SensorVerdict::Accepted, SensorVerdict::NotDecided]),
            ((LimitedFigure::BrokenChannels, 0.0, None), [SensorVerdict::Accepted, SensorVerdict::Accepted]),
        ] {
            let found = [Decision::Simple, Decision::Guarded].map(|decision| verdict(decision, limit, &measured()).0);
            assert_eq!(found, verdicts, "{limit:?}");
        }
    }

    #[test]
    fn a_simple_rule_warns_where_the_repeats_leave_a_units_figure_open() {
        let judgement = judge(&rule(Decision::Simple, &[(LimitedFigure::Repeatability, 3.0, None)]), &measured());
        assert_eq!(judgement.verdict, SensorVerdict::Accepted);
        let text: Vec<String> = judgement.all_reasons().collect();
        assert_eq!(text, ["repeatability, worst unit: within the limit, but with 20 repeats its bound is 4.00 %"]);
    }

    #[test]
    fn value_and_limit_are_printed_with_enough_digits_to_differ() {
        let shown = |limit| {
            let check = judge(&rule(Decision::Simple, &[(LimitedFigure::LocationMean, limit, None)]), &measured())
                .checks[0]
                .clone();
            [check.shown(check.value), check.shown(Some(limit)), check.shown(None)]
        };
        assert_eq!(shown(1.0), ["0.505", "1.000", "-"]);
        assert_eq!(shown(0.504_96), ["0.50500", "0.50496", "-"]);
        assert_eq!(shown(1e30)[1], "1.0e30");
    }

    #[test]
    fn uncertainty_of_the_truth_widens_each_bound() {
        let mut measured = measured();
        let bound = |measured: &Measured, figure, reach| {
            judge(&rule(Decision::Guarded, &[(figure, 0.5, reach)]), measured).checks[0].bound
        };
        let figures = [
            (LimitedFigure::LocationMean, None),
            (LimitedFigure::LocationP95, None),
            (LimitedFigure::LocationWithin, Some(0.9)),
        ];
        let exact = figures.map(|(figure, reach)| bound(&measured, figure, reach).unwrap());
        measured.location.as_mut().unwrap().u_truth = Some(0.1);
        let widened = figures.map(|(figure, reach)| bound(&measured, figure, reach).unwrap());
        let expected = 0.505 + (exact[0] - 0.505).hypot(0.1645);
        assert!((widened[0] - expected).abs() < 1e-9, "{widened:?}");
        assert!(widened[1] > exact[1] && widened[2] < exact[2], "{exact:?} {widened:?}");
        measured.location.as_mut().unwrap().u_truth = None;
        let (found, why) = verdict(Decision::Guarded, (LimitedFigure::LocationMean, 5.0, None), &measured);
        assert_eq!(found, SensorVerdict::NotDecided);
        assert_eq!(
            why,
            "location error, mean 0.505 mm, limit 5.000 mm: the uncertainty of the positions isn't known (`certificate` in \
             [stage] of the rig)"
        );
    }

    #[test]
    fn too_few_unanswered_or_repeated_presses_give_no_decision() {
        let limit = (LimitedFigure::LocationMean, 5.0, None);
        let few = Measured { calibration_presses: 9, ..measured() };
        let text = "9 valid calibration presses; the rule requires 10".to_owned();
        assert_eq!(verdict(Decision::Simple, limit, &few), (SensorVerdict::NotDecided, text));
        let unsolved = Measured { test_unsolved: 3, ..measured() };
        let text = "location error, mean: 3 test presses have no answer, so there is no mean".to_owned();
        assert_eq!(verdict(Decision::Simple, limit, &unsolved), (SensorVerdict::NotDecided, text));
        // presses without an answer are beyond any distance
        let within = (LimitedFigure::LocationWithin, 0.98, Some(5.0));
        assert_eq!(verdict(Decision::Simple, within, &unsolved).0, SensorVerdict::NotAccepted);
        let twice = Measured { test_repeats_itself: 99, ..measured() };
        let text = "99 of 100 test presses are identical to another one".to_owned();
        assert_eq!(verdict(Decision::Simple, limit, &twice), (SensorVerdict::NotDecided, text));
        let stopped = Measured { incomplete: Some("run is stopped: 90 of 100 presses".to_owned()), ..measured() };
        assert_eq!(verdict(Decision::Simple, limit, &stopped).0, SensorVerdict::NotDecided);
        let mut unmeasured = measured();
        unmeasured.worst[0].missing = 1;
        assert_eq!(
            verdict(Decision::Simple, (LimitedFigure::Repeatability, 5.0, None), &unmeasured).0,
            SensorVerdict::NotDecided
        );
        let repeated = Measured { test_repeats_calibration: 100, ..measured() };
        let text = "100 of 100 test presses are identical to calibration presses".to_owned();
        assert_eq!(verdict(Decision::Simple, limit, &repeated), (SensorVerdict::NotDecided, text));
        let untested = Measured { location: None, ..measured() };
        assert_eq!(verdict(Decision::Simple, limit, &untested).1, "location error, mean: no test was evaluated");
    }

    #[test]
    fn exceeded_limit_outweighs_an_undecided_one() {
        let limits = [(LimitedFigure::LocationMean, 0.4, None), (LimitedFigure::ForceMean, 0.1, None)];
        let judgement = judge(&rule(Decision::Simple, &limits), &measured());
        assert_eq!(judgement.verdict, SensorVerdict::NotAccepted);
        let reasons: Vec<String> = judgement.all_reasons().collect();
        assert_eq!(
            reasons,
            ["location error, mean 0.505 mm exceeds the limit 0.400 mm", "force error, mean: no true force is known"]
        );
    }
}
