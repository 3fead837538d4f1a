//! Makes an evaluation from presses: selects the test presses and the source of the true forces.

use super::calibration::{COMMANDED, CalibrateError, ForceSource, LOAD_CELL, Selection, SolvedQuantity, check_places};
use super::check::cell_u_n;
use super::places::{SAME_PLACE_MM, same_places};
use super::{Press, Presses, Split};
use crate::acceptance::Measured;
use crate::recipe::Phase;
use miette::Diagnostic;
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_solver::{
    Broken, Calibration, CalibrationPoint, ErrorSummary, Evaluation, EvaluationError, FaultyUnit, FitError, Fitted,
    ForceKnown, Model, PreparedCalibration, Session, Setting, Solver, TestPress, TriedMethod, Workspace, broken,
    evaluate,
};
use std::collections::HashSet;
use std::hint::black_box;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Time for which solves are repeated to measure the time of one solve. It is long compared with the clock's resolution, and
/// short for a user who waits.
const TIMED: Duration = Duration::from_millis(20);

/// Reason why there is no evaluation; all reasons are exit code 2.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum EvaluateError {
    /// The presses are unsuitable for calibration, or there are none.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Calibrate(#[from] CalibrateError),
    /// The two tables are from different arrays.
    #[error("{calibration} has {calibration_channels} outputs (out_1..), {test} has {test_channels}")]
    #[diagnostic(help("calibrate and test with the same array, and keep all its outputs in both tables"))]
    Channels {
        /// Table of the calibration.
        calibration: String,
        /// Number of its outputs.
        calibration_channels: usize,
        /// Table of the test.
        test: String,
        /// Number of its outputs.
        test_channels: usize,
    },
    /// The test can't be evaluated.
    #[error("{source_name}: can't be evaluated")]
    Evaluation {
        /// Run or table of the test.
        source_name: String,
        /// Reason of the error.
        source: EvaluationError,
    },
}

impl EvaluateError {
    /// Returns the error and its cause in one line. The cause states the problem.
    pub fn text(&self) -> String {
        let cause = std::error::Error::source(self).map(|cause| format!(": {cause}")).unwrap_or_default();
        format!("{self}{cause}")
    }

    /// Whether the error may concern only this solver, so that another solver could be evaluated.
    pub fn is_of_solver(&self) -> bool {
        matches!(self, EvaluateError::Calibrate(CalibrateError::Fit { .. }) | EvaluateError::Evaluation { .. })
    }
}

/// A calibration and a test of known truth, for any number of methods. Flagged presses are excluded and counted.
pub struct Trial<'a> {
    calibration: Selection<'a>,
    test: Selection<'a>,
    layout: Option<&'a ArrayLayout>,
    load: ForceKnown,
    force: &'static ForceSource,
    /// Whether the presses are those of a run. A run's forces are compared with the set forces and with the load cell's.
    is_run: bool,
    /// Whether the test was held out of the same table or run as the calibration.
    is_held_out: bool,
    /// Data shared by all methods that are fitted to the calibration.
    prepared: OnceLock<PreparedCalibration<'a>>,
}

impl<'a> Trial<'a> {
    /// Takes a run's calibration presses and test presses. `force_error_n` uses the commanded force for both, as in the paper.
    /// `force_error_load_cell_n` uses the load cell for both. Imported presses have no commanded force, so the table's force is
    /// used.
    pub fn of_run(presses: &'a Presses, layout: Option<&'a ArrayLayout>) -> Result<Self, EvaluateError> {
        let calibration = Selection::of_phase(presses, Phase::Calibration)?;
        let test = Selection::of_phase(presses, Phase::Test)?;
        let is_run = calibration.knows(&COMMANDED) && test.knows(&COMMANDED);
        let force = SolvedQuantity::Known.of(&calibration, if is_run { &COMMANDED } else { &LOAD_CELL });
        let (load, is_held_out, prepared) = (ForceKnown::default(), false, OnceLock::new());
        let is_run = is_run && !force.is_depth();
        Ok(Trial { calibration, test, layout, load, force, is_run, is_held_out, prepared })
    }

    /// Takes a table for calibration and a table to solve. If one of them has no forces, only the location is evaluated.
    pub fn of_tables(calibration: &'a Presses, test: &'a Presses) -> Result<Self, EvaluateError> {
        check_channels(calibration, test)?;
        let calibration = Selection::of_all(calibration, Phase::Calibration)?;
        let test = Selection::of_all(test, Phase::Test)?;
        let (force, prepared) = (SolvedQuantity::Known.of(&calibration, &LOAD_CELL), OnceLock::new());
        Ok(Trial {
            calibration,
            test,
            layout: None,
            load: ForceKnown::default(),
            force,
            is_run: false,
            is_held_out: false,
            prepared,
        })
    }

    /// Takes the two parts of one table or run. What is fitted and chosen sees only the calibration.
    pub fn of_split(split: &'a Split) -> Result<Self, EvaluateError> {
        Ok(Trial { is_held_out: true, ..Trial::of_tables(&split.calibration, &split.test)? })
    }

    /// Sets the positions of the units, if they are known.
    #[must_use]
    pub fn with_layout(self, layout: Option<&'a ArrayLayout>) -> Self {
        Trial { layout, prepared: OnceLock::new(), ..self }
    }

    /// Sets what is known about the load of the test.
    #[must_use]
    pub fn with_load(self, load: ForceKnown) -> Self {
        Trial { load, prepared: OnceLock::new(), ..self }
    }

    /// Sets what is solved besides the place.
    #[must_use]
    pub fn with_quantity(self, quantity: SolvedQuantity) -> Self {
        let force = match quantity {
            SolvedQuantity::Known => self.force,
            SolvedQuantity::Force if !self.force.is_depth() => self.force,
            // a run is then compared with the load cell's forces alone, if it was to be solved by depth
            SolvedQuantity::Force | SolvedQuantity::Depth => quantity.of(&self.calibration, &LOAD_CELL),
        };
        let is_run = self.is_run && !force.is_depth();
        Trial { force, is_run, prepared: OnceLock::new(), ..self }
    }

    /// Returns a note if the depths of the presses are known, but can't be solved.
    pub fn unsolved_depth(&self) -> Option<String> {
        let calibration = self.calibration.calibration(self.force, self.load).ok()?;
        let is_unsolved = self.force.is_depth() && calibration.depth_curve().is_none();
        is_unsolved.then(|| match self.load {
            ForceKnown::Constant => "depth isn't solved: contacts are assumed to press like the calibration".to_owned(),
            ForceKnown::Unknown => {
                format!("depth isn't solved: the presses of {} have nearly one depth", self.calibration.source())
            }
        })
    }

    /// Fits a method and solves the test with it.
    pub fn evaluate(&self, solver: &str) -> Result<Evaluation, EvaluateError> {
        self.evaluate_fitted(solver).map(|(evaluation, _)| evaluation)
    }

    /// Fits and evaluates a method like [`evaluate`](Self::evaluate), and also returns the fitted method.
    pub fn evaluate_fitted(&self, solver: &str) -> Result<(Evaluation, Fitted), EvaluateError> {
        let (mut evaluation, fitted) = self.by(self.force, self.prepared()?, solver)?;
        if self.is_run {
            // by its name: the choice isn't repeated, and only the forces of its answers count
            let by_load_cell = self.prepare(&LOAD_CELL, false)?;
            let answers = self.by(&LOAD_CELL, &by_load_cell, fitted.name())?.0;
            evaluation.force_error_load_cell_n = answers.force_error_n;
        }
        evaluation.choice = fitted.choice().cloned();
        evaluation.broken_outputs = self.broken_outputs().unwrap_or_default();
        if evaluation.not_as_calibrated_after.is_some() {
            evaluation.outputs_at_fault = self.outputs_at_fault(fitted.name()).unwrap_or_default();
        }
        Ok((evaluation, fitted))
    }

    /// Solves the test with a method that was fitted to this calibration and to other data. Forces are those of the load cell.
    pub fn evaluate_with(&self, fitted: &Fitted) -> Result<Evaluation, EvaluateError> {
        let broken_outputs = self.broken_outputs().unwrap_or_default();
        Ok(Evaluation { broken_outputs, ..self.evaluated(fitted, &LOAD_CELL)? })
    }

    /// Returns the test presses with the load cell's forces; `None` without forces.
    pub fn tested(&self) -> Option<Calibration> {
        self.test.calibration(&LOAD_CELL, self.load).ok()
    }

    /// Fits and evaluates a method like [`evaluate`](Self::evaluate), and measures its time.
    pub fn evaluate_timed(&self, solver: &str) -> Result<Evaluation, EvaluateError> {
        let (mut evaluation, fitted) = self.evaluate_fitted(solver)?;
        let presses = self.presses(self.force);
        evaluation.ns_per_solve = ns_per_solve(&fitted, presses.iter().map(|press| press.outputs));
        Ok(evaluation)
    }

    /// Evaluates only the answers, without the errors that a method states itself and without the load cell. The numbers are the
    /// same as with [`evaluate`](Self::evaluate), but faster to compute.
    pub fn answers(&self, solver: &str) -> Result<Evaluation, EvaluateError> {
        self.by(self.force, &self.prepare(self.force, false)?, solver).map(|(evaluation, _)| evaluation)
    }

    /// Returns the quantities that an acceptance rule uses.
    pub fn counted(&self) -> Measured {
        let bits = |press: &Press| -> Vec<u64> {
            [press.x_mm, press.y_mm].iter().chain(&press.outputs).map(|value| value.to_bits()).collect()
        };
        let calibrated: HashSet<Vec<u64>> = self.calibration.iter().map(bits).collect();
        let tested: HashSet<(Vec<u64>, [Option<u64>; 2])> = self
            .test
            .iter()
            .map(|press| (bits(press), [press.force_n, press.depth_mm].map(|known| known.map(f64::to_bits))))
            .collect();
        Measured {
            calibration_presses: self.calibration.iter().count(),
            test_presses: self.test.iter().count(),
            test_repeats_itself: self.test.iter().count() - tested.len(),
            at_calibrated_places: self.at_calibrated_places(),
            constant_load: matches!(self.load, ForceKnown::Constant),
            is_held_out: self.is_held_out,
            test_repeats_calibration: self.test.iter().filter(|press| calibrated.contains(&bits(press))).count(),
            broken_outputs: self.broken_outputs(),
            flagged_presses: self.calibration.flagged + self.test.flagged,
            ..Measured::default()
        }
    }

    /// Returns the mean standard uncertainty of the test's forces, N, with the change of the load cell that the run's checks leave
    /// possible; `None` if it is unknown for any of them.
    pub fn u_force_n(&self) -> Option<f64> {
        let cell_u_n = |press: &Press| cell_u_n(self.test.cell(), press.force_n.unwrap_or_default());
        self.mean_u(|press| press.u_force_n.map(|u_n| u_n.hypot(cell_u_n(press))))
    }

    /// Returns the mean standard uncertainty of the test's depths, mm; `None` if it is unknown for any of them.
    pub fn u_depth_mm(&self) -> Option<f64> {
        self.mean_u(|press| press.u_depth_mm)
    }

    fn mean_u(&self, u: impl Fn(&Press) -> Option<f64>) -> Option<f64> {
        let all: Option<Vec<f64>> = self.test.iter().map(u).collect();
        let all = all.filter(|all| all.iter().all(|u| u.is_finite() && *u >= 0.0));
        ErrorSummary::of(&all?).map(|summary| summary.mean)
    }

    /// Channels that are dead or saturated in the calibration, or in calibration and test together: nine presses can't show that an
    /// output has a largest value. Each is named with its fault. `None` without a calibration.
    pub fn broken_outputs(&self) -> Option<Vec<String>> {
        let point = |press: &'a Press| CalibrationPoint { place: press.place(), force_n: 1.0, outputs: &press.outputs };
        let all: Vec<CalibrationPoint<'_>> = self.calibration.iter().chain(self.test.iter()).map(point).collect();
        let in_all = Calibration::new(&all).map(|all| broken(&all)).unwrap_or_default();
        let of_calibration = self.prepared().ok()?.broken();
        let further = in_all.iter().filter(|broken| of_calibration.iter().all(|known| known.unit != broken.unit));
        Some(of_calibration.iter().chain(further).map(Broken::text).collect())
    }

    /// Number of test presses at places that the calibration has pressed too, within [`SAME_PLACE_MM`].
    fn at_calibrated_places(&self) -> usize {
        let places: Vec<Place> = self.calibration.iter().chain(self.test.iter()).map(Press::place).collect();
        let groups = same_places(&places, SAME_PLACE_MM);
        let (calibration, test) = groups.split_at(self.calibration.iter().count());
        let calibrated: HashSet<usize> = calibration.iter().copied().collect();
        test.iter().filter(|place| calibrated.contains(place)).count()
    }

    /// Returns the calibration, prepared once for all methods.
    fn prepared(&self) -> Result<&PreparedCalibration<'a>, EvaluateError> {
        match self.prepared.get() {
            Some(prepared) => Ok(prepared),
            None => {
                let prepared = self.prepare(self.force, true)?;
                Ok(self.prepared.get_or_init(|| prepared))
            }
        }
    }

    /// Prepares the calibration. For `appraised`, see [`Setting::appraised`].
    fn prepare(&self, force: &ForceSource, appraised: bool) -> Result<PreparedCalibration<'a>, EvaluateError> {
        let calibration = self.calibration.calibration(force, self.load)?;
        check_places(self.calibration.source(), &calibration)?;
        let setting = Setting { load: self.load, appraised, ..Setting::of_layout(self.layout) };
        PreparedCalibration::new(calibration, &setting).map_err(|source| self.unfit(source))
    }

    fn by(
        &self,
        force: &ForceSource,
        prepared: &PreparedCalibration<'_>,
        solver: &str,
    ) -> Result<(Evaluation, Fitted), EvaluateError> {
        let fitted = prepared.fit(solver).map_err(|source| self.unfit(source))?;
        Ok((self.evaluated(&fitted, force)?, fitted))
    }

    fn evaluated(&self, fitted: &Fitted, force: &ForceSource) -> Result<Evaluation, EvaluateError> {
        let mut evaluation = evaluate(fitted, &self.presses(force))
            .map_err(|source| EvaluateError::Evaluation { source_name: self.test.source().to_owned(), source })?;
        evaluation.left_out.calibration_flagged = self.calibration.flagged;
        evaluation.left_out.test_flagged = self.test.flagged;
        evaluation.at_calibrated_places = self.at_calibrated_places();
        Ok(evaluation)
    }

    /// Solves the test as one session, which finds the outputs that broke since the calibration.
    fn outputs_at_fault(&self, solver: &str) -> Option<Vec<String>> {
        let calibration = self.calibration.calibration(self.force, self.load).ok()?;
        let setting = Setting { load: self.load, ..Setting::of_layout(self.layout) };
        let mut session = Session::new(Model::fit(solver, calibration, &setting).ok()?);
        self.test.iter().for_each(|press| _ = session.solve(&press.outputs));
        session.finish();
        Some(session.at_fault().iter().map(FaultyUnit::text).collect())
    }

    fn unfit(&self, source: FitError) -> EvaluateError {
        CalibrateError::Fit { source_name: self.calibration.source().to_owned(), source }.into()
    }

    fn presses(&self, force: &ForceSource) -> Vec<TestPress<'a>> {
        self.test.to_solve(force, self.calibration.knows(force))
    }
}

/// Returns the mean errors of a method on presses that were held out of the calibration in turn; with [`BEST`](palpate_solver::BEST)
/// those of every method that was tried, the chosen one first. A run uses the load cell's forces.
pub fn cross_validated(
    presses: &Presses,
    layout: Option<&ArrayLayout>,
    load: ForceKnown,
    quantity: SolvedQuantity,
    solver: &str,
) -> Result<Vec<TriedMethod>, EvaluateError> {
    let selection = match presses.presses.iter().any(|press| press.phase.is_some()) {
        true => Selection::of_phase(presses, Phase::Calibration)?,
        false => Selection::of_all(presses, Phase::Calibration)?,
    };
    let calibration = selection.calibration(quantity.of(&selection, &LOAD_CELL), load)?;
    check_places(&presses.source, &calibration)?;
    let unfit = |source| CalibrateError::Fit { source_name: presses.source.clone(), source };
    let setting = Setting { load, ..Setting::of_layout(layout) };
    let found = PreparedCalibration::new(calibration, &setting).and_then(|prepared| prepared.candidates(solver));
    Ok(found.map_err(unfit)?)
}

/// Checks whether two tables can be from one array: both must have the same number of outputs.
pub fn check_channels(calibration: &Presses, test: &Presses) -> Result<(), EvaluateError> {
    if calibration.channels != test.channels {
        return Err(EvaluateError::Channels {
            calibration: calibration.source.clone(),
            calibration_channels: calibration.channels,
            test: test.source.clone(),
            test_channels: test.channels,
        });
    }
    Ok(())
}

/// Whether a press of a run is part of its evaluation, flagged or not.
pub fn is_to_evaluate(press: &Press) -> bool {
    press.is_of(Phase::Calibration) || press.is_of(Phase::Test)
}

/// Returns the mean time of a solve, ns. It is measured over complete passes through some readings, repeated until 20 ms are
/// filled. `None` without readings.
pub fn ns_per_solve<'r>(solver: &dyn Solver, readings: impl Iterator<Item = &'r [f64]> + Clone) -> Option<f64> {
    let mut workspace = Workspace::default();
    let (begun, mut solves) = (Instant::now(), 0);
    while begun.elapsed() < TIMED {
        for outputs in readings.clone() {
            // other tests check its answers; here it only must not be left out
            let _ = black_box(solver.solve(black_box(outputs), &mut workspace));
            solves += 1;
        }
    }
    (solves > 0).then(|| begun.elapsed().as_nanos() as f64 / f64::from(solves))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    fn evaluate_tables(calibration: &Presses, test: &Presses, solver: &str) -> Result<Evaluation, EvaluateError> {
        Trial::of_tables(calibration, test)?.evaluate(solver)
    }

    use crate::dataset::{Mapping, parse_table};

    /// Reads the presses of a table with this text.
    pub(crate) fn table(text: &str) -> Presses {
        parse_table("a.csv", text.as_bytes(), &Mapping::default()).unwrap()
    }

    /// Reads the presses of a run's table, which has every column of a run.
    pub(crate) fn run(text: &str) -> Presses {
        let whole = |(index, line): (usize, &str)| {
            format!("{line},{}\n", if index == 0 { "depth_mm,t_s,z_mm" } else { "0,0,0" })
        };
        table(&text.lines().enumerate().map(whole).collect::<String>())
    }

    /// Text of a small run. It contains flagged and unsolvable presses, and presses of another phase.
    pub(crate) const RUN: &str = "\
press,level,phase,x_mm,y_mm,force_set_n,force_n,out_1,out_2,flags
0,0,calibration,-1,0,1,0.8,1,0.5,
1,0,calibration,1,0,1,0.8,0.5,1,
2,0,calibration,1,0,1,1,5,1,trip
3,0,test,-1,0,0.5,0.4,0.55,0.2,
4,0,test,1,0,0.5,0.4,0.2,0.55,trip
5,0,test,1,0,0.5,0.4,0.2,0.2,
6,0,teach,1,0,0.5,0.4,0.2,0.2,
";

    #[test]
    fn run_is_compared_with_the_set_force_and_with_the_load_cell() {
        let presses = run(RUN);
        let layout = ArrayLayout::from_places(vec![palpate_core::quantity::Place::new(-1.0, 0.0); 2]);
        let evaluation = Trial::of_run(&presses, Some(&layout)).unwrap().evaluate("pearson").unwrap();
        assert_eq!((evaluation.points, evaluation.location_error_mm.max), (1, 0.0));
        assert!((evaluation.force_error_n.unwrap().mean - 0.05).abs() < 1e-12); // 0.55 of 1 N against 0.5 N
        assert!((evaluation.force_error_load_cell_n.unwrap().mean - 0.04).abs() < 1e-12); // 0.55 of 0.8 N against 0.4 N
        let left_out = evaluation.left_out;
        assert_eq!((left_out.calibration_flagged, left_out.test_flagged, left_out.test_unsolved), (1, 1, 1));
    }

    #[test]
    fn a_change_of_the_load_cell_during_the_run_widens_a_known_uncertainty_alone() {
        let mut presses = run(RUN);
        presses.cell = 0.12;
        assert_eq!(Trial::of_run(&presses, None).unwrap().u_force_n(), None);
        presses.presses.iter_mut().for_each(|press| press.u_force_n = Some(0.003));
        let u_n = Trial::of_run(&presses, None).unwrap().u_force_n().unwrap();
        assert!((u_n - 0.003f64.hypot(0.12 * 0.4 / 12.0f64.sqrt())).abs() < 1e-12, "{u_n}"); // both tests have 0.4 N
        presses.cell = 0.0;
        assert_eq!(Trial::of_run(&presses, None).unwrap().u_force_n(), Some(0.003));
    }

    #[test]
    fn plain_tables_need_no_force() {
        let calibration = table("x_mm,y_mm,out_1,out_2\n0,0,1,2\n1,0,2,1\n");
        let test = table("x_mm,y_mm,force_n,out_1,out_2\n0,0,2,2,4\n1,0,2,4,2\n");
        // newtons can't be compared with multiples of a typical press
        for (calibration, test) in [(&calibration, &test), (&test, &calibration), (&calibration, &calibration)] {
            let evaluation = evaluate_tables(calibration, test, "pearson").unwrap();
            assert_eq!((evaluation.force_error_n, evaluation.within.both), (None, None));
        }
        assert_eq!(evaluate_tables(&test, &test, "pearson").unwrap().force_error_n.unwrap().max, 0.0);
    }

    #[test]
    fn presses_of_known_depths_are_solved_by_depth_unless_there_are_forces() {
        let row = |i: u32, force: &str| {
            let (x, y, depth_mm) = (f64::from(i % 6), f64::from(i / 6 % 6), 0.2 + 0.1 * f64::from(i * 5 % 9));
            let of_unit = |(a, b): (f64, f64)| depth_mm.powf(1.5) * (-0.05 * ((x - a).powi(2) + (y - b).powi(2))).exp();
            let [one, two, three] = [(0.0, 0.0), (5.0, 0.0), (2.0, 5.0)].map(of_unit);
            format!("{x},{y},{force}{depth_mm},{one},{two},{three}\n")
        };
        let of = |head: &str, force: &str| {
            table(
                &(format!("x_mm,y_mm,{head}depth_mm,out_1,out_2,out_3\n")
                    + &(0..72).map(|i| row(i, force)).collect::<String>()),
            )
        };
        let (silent, loaded) = (of("", ""), of("force_n,", "1,"));
        let solved = |presses: &Presses, quantity| {
            let trial = Trial::of_tables(presses, presses).unwrap().with_quantity(quantity);
            let evaluation = trial.evaluate("surrogate").unwrap();
            (evaluation.depth_error_mm.map(|error| error.mean < 0.05), evaluation.force_error_n.is_some())
        };
        assert_eq!(solved(&silent, SolvedQuantity::Known), (Some(true), false));
        assert_eq!(solved(&loaded, SolvedQuantity::Known), (None, true));
        assert_eq!(solved(&loaded, SolvedQuantity::Depth), (Some(true), false));
        assert_eq!(solved(&silent, SolvedQuantity::Force), (None, false));
        let mut alike = silent.clone();
        alike.presses.iter_mut().for_each(|press| press.depth_mm = Some(0.5));
        let trial = Trial::of_tables(&alike, &alike).unwrap();
        assert_eq!(trial.unsolved_depth().unwrap(), "depth isn't solved: the presses of a.csv have nearly one depth");
        assert_eq!(trial.evaluate("surrogate").unwrap().depth_error_mm, None);
        let mut negative = silent.clone();
        negative.presses[4].depth_mm = Some(-0.1);
        let refusal = evaluate_tables(&negative, &silent, "pearson").unwrap_err().to_string();
        assert!(refusal.contains("line 6, column `depth_mm`"), "{refusal}");
    }

    #[test]
    fn tables_that_do_not_fit_are_refused_by_line() {
        let good = table("x_mm,y_mm,out_1,out_2\n0,0,1,2\n1,0,2,1\n");
        let other = table("x_mm,y_mm,out_1\n0,0,1\n");
        assert!(matches!(evaluate_tables(&good, &other, "pearson"), Err(EvaluateError::Channels { .. })));
        let unloaded = table("x_mm,y_mm,force_n,out_1,out_2\n0,0,1,1,2\n\n0,0,0,1,2\n");
        let refusal = evaluate_tables(&unloaded, &good, "pearson").unwrap_err().to_string();
        assert!(refusal.contains("line 4, column `force_n`"), "{refusal}");
        let flagged = table("x_mm,y_mm,out_1,out_2,flags\n0,0,1,2,bad\n");
        let refusal = evaluate_tables(&good, &flagged, "pearson").unwrap_err();
        let expected =
            matches!(refusal, EvaluateError::Calibrate(CalibrateError::NoPresses { phase: "test", flagged: 1, .. }));
        assert!(expected, "{refusal}");
    }

    #[test]
    fn a_solve_is_timed_only_where_that_is_asked_for() {
        let presses = run(RUN);
        let trial = Trial::of_run(&presses, None).unwrap().with_load(ForceKnown::Constant);
        assert_eq!(trial.evaluate("pearson").unwrap().ns_per_solve, None);
        let ns_per_solve = trial.evaluate_timed("pearson").unwrap().ns_per_solve.unwrap();
        assert!(ns_per_solve > 0.0 && ns_per_solve.is_finite());
    }
}
