//! Compares solved with true presses: errors, and how well they were predicted.

use super::chart::MisfitChart;
use super::{Choice, ContactVerdict, Setting, Solution, SolveError, Solver, Workspace};
use palpate_core::quantity::{Place, percentile};
use serde::Serialize;

/// Location error below which a contact counts as found, mm (set by the paper: a fingertip resolves 1.6 mm).
pub const LOCATION_REFERENCE_MM: f64 = 1.0;
/// Force error below which a force counts as correct, N (set by the paper: a hand feels 0.147 N).
pub const FORCE_REFERENCE_N: f64 = 0.1;

/// Errors of a solver on presses with known truth; serialises to the object that `evaluate --json` prints.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Name of the solver.
    pub solver: String,
    /// Number of test presses that were solved; never 0.
    pub points: usize,
    /// Distance between true and solved place, mm.
    pub location_error_mm: ErrorSummary,
    /// Absolute difference between true and solved force, N; null if the true force is unknown.
    pub force_error_n: Option<ErrorSummary>,
    /// Absolute difference between true and solved depth, mm; in the object only if depths are solved and known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_error_mm: Option<ErrorSummary>,
    /// Fractions of the points with small enough errors.
    pub within: Within,
    /// Fraction of errors that were at most as large as the solver stated; null if it states none.
    pub coverage: Option<Coverage>,
    /// Number of points with each verdict.
    pub verdicts: Verdicts,
    /// Duration of one solve, ns. This module reads no clock, so the caller who measures the duration sets this field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ns_per_solve: Option<f64>,
    /// How the solver was chosen, if it was chosen. The caller who fitted the solver sets this field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub choice: Option<Choice>,
    /// Force error relative to the load cell, which then also gives the calibration's forces. Only for a run, where
    /// `force_error_n` is relative to the commanded force.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_error_load_cell_n: Option<ErrorSummary>,
    /// Number of test presses at places that the calibration also pressed. The caller who knows the calibration sets this field.
    pub at_calibrated_places: usize,
    /// Number of presses after which so many didn't fit the calibration that the test isn't as calibrated; in the object only if it
    /// happened.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_as_calibrated_after: Option<usize>,
    /// Outputs that broke since the calibration and are the reason, with their odds; in the object only if there are any. The caller who
    /// has the calibration sets this field.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub outputs_at_fault: Vec<String>,
    /// Presses that didn't count; in the object only if there are any.
    #[serde(skip_serializing_if = "LeftOut::is_none")]
    pub left_out: LeftOut,
    /// Outputs that are broken in calibration and test, with their faults; in the object only if there are any. The caller who knows the
    /// calibration sets this field.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub broken_outputs: Vec<String>,
    /// The solved presses one by one, in test order.
    #[serde(skip)]
    pub presses: Vec<PressError>,
    /// The presses that had no answer, in test order.
    #[serde(skip)]
    pub unsolved: Vec<UnsolvedPress>,
}

/// Mean, median, 95th percentile and largest of a set of errors, in the errors' unit.
///
/// The percentile is interpolated linearly between two order statistics. Of n sorted errors it has rank q (n - 1), counted from 0
/// (definition 7 of Hyndman and Fan 1996, the usual one in numerical software).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorSummary {
    /// Arithmetic mean.
    pub mean: f64,
    /// 50th percentile.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest error.
    pub max: f64,
}

/// Fractions of the points with errors below the paper's reference values, 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Within {
    /// Location error under [`LOCATION_REFERENCE_MM`].
    pub location_1mm: f64,
    /// Force error under [`FORCE_REFERENCE_N`]; null if the true force is unknown.
    pub force_0_1n: Option<f64>,
    /// Both errors under their references; null if the true force is unknown.
    pub both: Option<f64>,
}

/// Fractions of the errors that are at most one and two standard deviations as stated by the solver, 0 to 1. The errors of x and
/// y are counted together. Normal errors of the stated size are within one standard deviation in 0.683 of the cases, and within
/// two in 0.954.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Errors of x and y within one standard deviation.
    pub xy_1sd: f64,
    /// Errors of x and y within two standard deviations.
    pub xy_2sd: f64,
    /// Errors of the force within one standard deviation; null if the true force is unknown.
    pub force_1sd: Option<f64>,
    /// Errors of the force within two standard deviations; null if the true force is unknown.
    pub force_2sd: Option<f64>,
    /// Distances within the stated `half68_mm`; null if no half-width is stated.
    pub location_68: Option<f64>,
    /// Distances within the stated `half95_mm`.
    pub location_95: Option<f64>,
    /// Errors of the force within the stated `half68_n`; null if the true force is unknown.
    pub force_68: Option<f64>,
    /// Errors of the force within the stated `half95_n`.
    pub force_95: Option<f64>,
    /// Errors of the depth within one and two standard deviations; in the object only if depths are solved and known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_1sd: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs, reason = "described above")]
    pub depth_2sd: Option<f64>,
    /// Errors of the depth within the stated half-widths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_68: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    #[allow(missing_docs, reason = "described above")]
    pub depth_95: Option<f64>,
}

/// Number of presses with each verdict, by the verdict's word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[allow(missing_docs, reason = "each is a verdict of `ContactVerdict`, described there")]
pub struct Verdicts {
    pub ok: usize,
    pub weak_signal: usize,
    pub outside_area: usize,
    pub not_one_contact: usize,
    pub channel_fault: usize,
}

/// Presses that were recorded but didn't count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Number of calibration presses excluded because they are flagged.
    pub calibration_flagged: usize,
    /// Number of test presses excluded because they are flagged.
    pub test_flagged: usize,
    /// Number of test presses without an answer.
    pub test_unsolved: usize,
}

/// One test press: its place, force and depth, and the array's reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TestPress<'a> {
    /// Place of the press, mm.
    pub place: Place,
    /// Force, N, if it is known.
    pub force_n: Option<f64>,
    /// Depth, mm, if it is known. It counts only if the solver solves depths.
    pub depth_mm: Option<f64>,
    /// Outputs, one for each unit.
    pub outputs: &'a [f64],
}

/// One solved test press: true and solved values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressError {
    /// Index among the test presses given, from 0.
    pub index: usize,
    /// True place, mm.
    pub place_true: Place,
    /// Solved place, mm.
    pub place_solved: Place,
    /// Distance between true and solved place, mm.
    pub location_error_mm: f64,
    /// Solved force, N; an intensity if the solver solves depths.
    pub force_solved_n: f64,
    /// Absolute difference from the true force, N, if the true force is known.
    pub force_error_n: Option<f64>,
    /// Solved depth, mm, if the solver solves depths.
    pub depth_solved_mm: Option<f64>,
    /// Absolute difference from the true depth, mm, if both are known.
    pub depth_error_mm: Option<f64>,
}

/// One test press without an answer.
#[derive(Clone, Debug, PartialEq)]
pub struct UnsolvedPress {
    /// Index among the test presses given, from 0.
    pub index: usize,
    /// Reason why there is no answer.
    pub reason: SolveError,
}

/// Reason why nothing can be evaluated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// No test press was given.
    #[error("there is no test press to evaluate")]
    NoPresses,
    /// The test doesn't belong to this calibration.
    #[error("the test doesn't match the calibration: {0}")]
    OtherArray(SolveError),
    /// No test press could be solved.
    #[error("none of the {presses} test presses could be solved; the first: {first}")]
    NoneSolved {
        /// Number of test presses given.
        presses: usize,
        /// Reason why the first test press has no answer.
        first: SolveError,
    },
}

/// Solves every test press and summarises the errors.
///
/// Forces are evaluated if every solved press has one; depths too, if the solver solves depths instead of forces. A press without an answer is counted and kept in `unsolved`.
pub fn evaluate(solver: &dyn Solver, test: &[TestPress<'_>]) -> Result<Evaluation, EvaluationError> {
    let (mut presses, mut unsolved) = (Vec::with_capacity(test.len()), Vec::new());
    let (mut verdicts, mut stated) = (Verdicts::default(), Stated::default());
    let (mut chart, mut not_as_calibrated_after) = (MisfitChart::new(Setting::default().false_alarms), None);
    let mut workspace = Workspace::default();
    for (index, press) in test.iter().enumerate() {
        match solver.solve(press.outputs, &mut workspace) {
            Ok(solution) => {
                // an intensity can't be compared with newtons
                let force_n = press.force_n.filter(|_| solution.depth.is_none());
                let depth_solved_mm = solution.depth.map(|depth| depth.depth_mm);
                let depths = depth_solved_mm.zip(press.depth_mm);
                let error = PressError {
                    index,
                    place_true: press.place,
                    place_solved: solution.place,
                    location_error_mm: solution.place.distance_mm(press.place),
                    force_solved_n: solution.force_n,
                    force_error_n: force_n.map(|force_n| (solution.force_n - force_n).abs()),
                    depth_solved_mm,
                    depth_error_mm: depths.map(|(solved_mm, depth_mm)| (solved_mm - depth_mm).abs()),
                };
                verdicts.count(solution.verdict);
                stated.extend(&error, &solution);
                presses.push(error);
                if chart.count(&solution) {
                    not_as_calibrated_after = not_as_calibrated_after.or(Some(presses.len()));
                }
            }
            Err(reason @ SolveError::Channels { .. }) => return Err(EvaluationError::OtherArray(reason)),
            Err(reason) => unsolved.push(UnsolvedPress { index, reason }),
        }
    }
    let location_errors: Vec<f64> = presses.iter().map(|press| press.location_error_mm).collect();
    let force_errors: Option<Vec<f64>> = presses.iter().map(|press| press.force_error_n).collect();
    let depth_errors: Option<Vec<f64>> = presses.iter().map(|press| press.depth_error_mm).collect();
    let Some(location_error_mm) = ErrorSummary::of(&location_errors) else {
        return Err(match unsolved.first() {
            None => EvaluationError::NoPresses,
            Some(first) => EvaluationError::NoneSolved { presses: test.len(), first: first.reason.clone() },
        });
    };
    Ok(Evaluation {
        solver: solver.name().to_owned(),
        points: presses.len(),
        location_error_mm,
        force_error_n: force_errors.as_deref().and_then(ErrorSummary::of),
        depth_error_mm: depth_errors.as_deref().and_then(ErrorSummary::of),
        within: Within::of(&location_errors, force_errors.as_deref()),
        coverage: stated.coverage(),
        verdicts,
        ns_per_solve: None,
        choice: None,
        force_error_load_cell_n: None,
        at_calibrated_places: 0,
        not_as_calibrated_after,
        outputs_at_fault: Vec::new(),
        left_out: LeftOut { test_unsolved: unsolved.len(), ..LeftOut::default() },
        broken_outputs: Vec::new(),
        presses,
        unsolved,
    })
}

impl ErrorSummary {
    /// Summarises errors; returns `None` if there are no errors.
    pub fn of(errors: &[f64]) -> Option<Self> {
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        let max = *sorted.last()?;
        let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
        Some(ErrorSummary { mean, median: percentile(&sorted, 0.5), p95: percentile(&sorted, 0.95), max })
    }
}

impl LeftOut {
    /// Whether every press counted.
    pub fn is_none(&self) -> bool {
        *self == LeftOut::default()
    }
}

impl Within {
    fn of(location_errors: &[f64], force_errors: Option<&[f64]>) -> Self {
        let share = |good: usize| good as f64 / location_errors.len() as f64;
        let is_found = |error: &f64| *error < LOCATION_REFERENCE_MM;
        let is_right = |error: &f64| *error < FORCE_REFERENCE_N;
        let pairs =
            |forces: &[f64]| location_errors.iter().zip(forces).filter(|(l, f)| is_found(l) && is_right(f)).count();
        Within {
            location_1mm: share(location_errors.iter().filter(|error| is_found(error)).count()),
            force_0_1n: force_errors.map(|forces| share(forces.iter().filter(|error| is_right(error)).count())),
            both: force_errors.map(|forces| share(pairs(forces))),
        }
    }
}

impl ContactVerdict {
    /// Returns the word for this verdict in all outputs.
    pub fn word(self) -> &'static str {
        match self {
            ContactVerdict::Ok => "ok",
            ContactVerdict::WeakSignal => "weak-signal",
            ContactVerdict::OutsideArea => "outside-area",
            ContactVerdict::NotOneContact => "not-one-contact",
            ContactVerdict::ChannelFault(_) => "channel-fault",
        }
    }
}

impl Verdicts {
    /// Returns the number of presses for each verdict other than ok, with the verdict's word.
    pub fn doubts(&self) -> [(usize, &'static str); 4] {
        [
            (self.weak_signal, ContactVerdict::WeakSignal.word()),
            (self.outside_area, ContactVerdict::OutsideArea.word()),
            (self.not_one_contact, ContactVerdict::NotOneContact.word()),
            (self.channel_fault, ContactVerdict::ChannelFault(0).word()),
        ]
    }

    fn count(&mut self, verdict: ContactVerdict) {
        match verdict {
            ContactVerdict::Ok => self.ok += 1,
            ContactVerdict::WeakSignal => self.weak_signal += 1,
            ContactVerdict::OutsideArea => self.outside_area += 1,
            ContactVerdict::NotOneContact => self.not_one_contact += 1,
            ContactVerdict::ChannelFault(_) => self.channel_fault += 1,
        }
    }
}

/// Errors divided by their stated standard deviations.
#[derive(Default)]
struct Stated {
    xy: Vec<f64>,
    force: Vec<f64>,
    depth: Vec<f64>,
    /// Errors divided by their stated half-widths, 68 and 95 %: of location, of force, and of depth.
    halves: [Vec<f64>; 6],
}

impl Stated {
    fn extend(&mut self, error: &PressError, solution: &Solution) {
        if let Some(half) = &solution.half_widths {
            let [location_68, location_95, force_68, force_95, depth_68, depth_95] = &mut self.halves;
            location_68.push(error.location_error_mm / half.half68_mm);
            location_95.push(error.location_error_mm / half.half95_mm);
            force_68.extend(error.force_error_n.map(|error_n| error_n / half.half68_n));
            force_95.extend(error.force_error_n.map(|error_n| error_n / half.half95_n));
            let halves_mm = solution.depth.and_then(|depth| depth.half_widths_mm);
            if let Some((error_mm, [half68_mm, half95_mm])) = error.depth_error_mm.zip(halves_mm) {
                depth_68.push(error_mm / half68_mm);
                depth_95.push(error_mm / half95_mm);
            }
        }
        let Some(covariance) = &solution.covariance else { return };
        let (found, there) = (error.place_solved, error.place_true);
        self.xy.push((found.x_mm - there.x_mm).abs() / covariance.x_mm());
        self.xy.push((found.y_mm - there.y_mm).abs() / covariance.y_mm());
        self.force.extend(error.force_error_n.map(|error_n| error_n / covariance.force_n()));
        let depth_sd_mm = solution.depth.and_then(|depth| depth.sd_mm);
        self.depth.extend(error.depth_error_mm.zip(depth_sd_mm).map(|(error_mm, sd_mm)| error_mm / sd_mm));
    }

    fn coverage(&self) -> Option<Coverage> {
        let share = |ratios: &[f64], sd: f64| {
            let within = ratios.iter().filter(|ratio| **ratio <= sd).count();
            (!ratios.is_empty()).then(|| within as f64 / ratios.len() as f64)
        };
        Some(Coverage {
            xy_1sd: share(&self.xy, 1.0)?,
            xy_2sd: share(&self.xy, 2.0)?,
            force_1sd: share(&self.force, 1.0),
            force_2sd: share(&self.force, 2.0),
            location_68: share(&self.halves[0], 1.0),
            location_95: share(&self.halves[1], 1.0),
            force_68: share(&self.halves[2], 1.0),
            force_95: share(&self.halves[3], 1.0),
            depth_1sd: share(&self.depth, 1.0),
            depth_2sd: share(&self.depth, 2.0),
            depth_68: share(&self.halves[4], 1.0),
            depth_95: share(&self.halves[5], 1.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ContactVerdict, Covariance};

    /// Answers with its outputs: x, y and force.
    struct EchoMethod;

    impl Solver for EchoMethod {
        fn name(&self) -> &'static str {
            "echo"
        }

        fn solve(&self, outputs: &[f64], _: &mut Workspace) -> Result<Solution, SolveError> {
            match *outputs {
                [x_mm, y_mm, force_n] if force_n.is_finite() => {
                    let place = Place::new(x_mm, y_mm);
                    Ok(Solution::plain(place, force_n, ContactVerdict::Ok))
                }
                [_, _, _] => Err(SolveError::AllEqual),
                _ => Err(SolveError::Channels { expected: 3, found: outputs.len() }),
            }
        }
    }

    fn press(outputs: &[f64], force_n: Option<f64>) -> TestPress<'_> {
        TestPress { place: Place::new(0.0, 0.0), force_n, depth_mm: None, outputs }
    }

    #[test]
    fn percentiles_are_interpolated_between_order_statistics() {
        let summary = ErrorSummary::of(&[4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!((summary.mean, summary.median, summary.max), (2.5, 2.5, 4.0));
        assert!((summary.p95 - 3.85).abs() < 1e-12); // rank 2.85
        assert_eq!(ErrorSummary::of(&[7.0]), Some(ErrorSummary { mean: 7.0, median: 7.0, p95: 7.0, max: 7.0 }));
        assert_eq!(ErrorSummary::of(&[]), None);
    }

    #[test]
    fn errors_and_fractions_are_counted() {
        let test = [
            press(&[0.3, 0.4, 1.05], Some(1.0)), // both
            press(&[3.0, 4.0, 0.95], Some(1.0)), // force only
            press(&[0.5, 0.0, 1.25], Some(1.0)), // location only
            press(&[1.0, 0.0, 1.0], Some(1.0)),  // exactly 1 mm isn't under 1 mm
        ];
        let evaluation = evaluate(&EchoMethod, &test).unwrap();
        assert_eq!(evaluation.location_error_mm.mean, (0.5 + 5.0 + 0.5 + 1.0) / 4.0);
        assert!((evaluation.force_error_n.unwrap().mean - 0.0875).abs() < 1e-12);
        assert_eq!(evaluation.within, Within { location_1mm: 0.5, force_0_1n: Some(0.75), both: Some(0.25) });
        assert_eq!(evaluation.presses[1].location_error_mm, 5.0);
    }

    #[test]
    fn without_forces_their_parts_are_null_and_the_object_has_exactly_its_keys() {
        let json = serde_json::to_string(&evaluate(&EchoMethod, &[press(&[0.0, 0.5, 1.0], None)]).unwrap()).unwrap();
        let expected =
            r#"{"solver":"echo","points":1,"location_error_mm":{"mean":0.5,"median":0.5,"p95":0.5,"max":0.5},"#
                .to_owned()
                + r#""force_error_n":null,"within":{"location_1mm":1.0,"force_0_1n":null,"both":null},"#
                + r#""coverage":null,"verdicts":{"ok":1,"weak-signal":0,"outside-area":0,"#
                + r#""not-one-contact":0,"channel-fault":0},"at_calibrated_places":0}"#;
        assert_eq!(json, expected);
    }

    /// Answers the origin and 1 N, as sure of it as the first output says, with the verdict that the second one says.
    struct Modest;

    impl Solver for Modest {
        fn name(&self) -> &'static str {
            "modest"
        }

        fn solve(&self, outputs: &[f64], _: &mut Workspace) -> Result<Solution, SolveError> {
            let variance = outputs[0] * outputs[0];
            let covariance = [[variance, 0.0, 0.0], [0.0, variance, 0.0], [0.0, 0.0, variance]];
            let covariance = (variance > 0.0).then_some(Covariance(covariance));
            let verdict = if outputs[1] > 0.0 { ContactVerdict::ChannelFault(0) } else { ContactVerdict::OutsideArea };
            Ok(Solution { covariance, ..Solution::plain(Place::new(0.0, 0.0), 1.0, verdict) })
        }
    }

    #[test]
    fn errors_are_compared_with_stated_ones_and_verdicts_counted() {
        let press = |outputs, force_n| TestPress { place: Place::new(0.5, 1.5), force_n, depth_mm: None, outputs };
        let coverage = |test: &[TestPress<'_>]| evaluate(&Modest, test).unwrap().coverage;
        // 0.5, 1.5 and 0.6 of one; then a quarter, three quarters and 0.3; then nothing is stated
        let test = [press(&[1.0, 0.0], Some(1.6)), press(&[2.0, 1.0], Some(1.6)), press(&[0.0, 0.0], Some(1.6))];
        let expected = |xy_1sd, xy_2sd, [force_1sd, force_2sd]: [Option<f64>; 2]| Coverage {
            xy_1sd,
            xy_2sd,
            force_1sd,
            force_2sd,
            location_68: None,
            location_95: None,
            force_68: None,
            force_95: None,
            depth_1sd: None,
            depth_2sd: None,
            depth_68: None,
            depth_95: None,
        };
        assert_eq!(coverage(&test), Some(expected(0.75, 1.0, [Some(1.0), Some(1.0)])));
        assert_eq!(coverage(&[press(&[1.0, 0.0], None)]), Some(expected(0.5, 1.0, [None, None])));
        assert_eq!(coverage(&[press(&[0.4, 0.0], Some(2.0))]), Some(expected(0.0, 0.5, [Some(0.0), Some(0.0)])));
        assert_eq!(coverage(&test[2..]), None);
        let verdicts = evaluate(&Modest, &test).unwrap().verdicts;
        assert_eq!(verdicts, Verdicts { outside_area: 2, channel_fault: 1, ..Verdicts::default() });
    }

    #[test]
    fn a_verdict_is_counted_under_the_word_it_is_written_with() {
        for verdict in [
            ContactVerdict::Ok,
            ContactVerdict::WeakSignal,
            ContactVerdict::OutsideArea,
            ContactVerdict::NotOneContact,
            ContactVerdict::ChannelFault(3),
        ] {
            let mut verdicts = Verdicts::default();
            verdicts.count(verdict);
            let json = serde_json::to_string(&verdicts).unwrap();
            assert!(json.contains(&format!("\"{}\":1", verdict.word())), "{json}");
        }
    }

    #[test]
    fn a_press_without_an_answer_is_counted_not_dropped() {
        let test = [press(&[0.0, 0.0, 1.0], Some(1.0)), press(&[0.0, 0.0, f64::NAN], Some(1.0))];
        let evaluation = evaluate(&EchoMethod, &test).unwrap();
        assert_eq!((evaluation.points, evaluation.left_out.test_unsolved), (1, 1));
        assert_eq!(evaluation.unsolved, [UnsolvedPress { index: 1, reason: SolveError::AllEqual }]);
        assert!(serde_json::to_string(&evaluation).unwrap().contains(r#""test_unsolved":1"#));
    }

    #[test]
    fn nothing_to_evaluate_is_an_error_not_nan() {
        assert_eq!(evaluate(&EchoMethod, &[]).unwrap_err(), EvaluationError::NoPresses);
        let unsolvable = evaluate(&EchoMethod, &[press(&[0.0, 0.0, f64::NAN], None)]).unwrap_err();
        assert_eq!(unsolvable, EvaluationError::NoneSolved { presses: 1, first: SolveError::AllEqual });
        assert!(matches!(evaluate(&EchoMethod, &[press(&[1.0], None)]), Err(EvaluationError::OtherArray(_))));
    }
}
