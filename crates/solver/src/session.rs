//! Solves one reading after another, without broken units.

use super::chart::MisfitChart;
use super::fits::Unmade;
use super::history::GAP_MOST;
use super::{
    Broken, ContactVerdict, FitError, Fits, Fitted, MOST_FITS, Model, OutputFault, Solution, SolveError, Solver,
    Workspace,
};
use std::sync::Arc;

/// Solves one reading after another. If a unit breaks, it is excluded from then on.
///
/// A reading may have missing outputs, which are NaN. Such a reading is solved by the same method fitted without these units.
/// That fit is made for the first such reading, and kept.
///
/// For each reading, a forward method reports which unit contradicts all others, if one does. These verdicts are added up for
/// each unit by a cumulative sum test (Page 1954). A broken unit is named by at least every second contact, a good unit by at
/// most one of fifty. All readings of the same contact count once.
///
/// A control chart shows whether more contacts than expected don't fit the calibration: see [`Session::is_out_of_date`].
///
/// Sessions share a model and its fits: each holds only what it learned from its own readings.
pub struct Session {
    fits: Arc<Fits>,
    /// Units that broke in this session.
    broke: Vec<Broken>,
    /// The method, fitted without the units that broke; `None` if no unit broke.
    reduced: Option<Arc<Fitted>>,
    /// Fits for readings with missing outputs.
    partial: Vec<Partial>,
    /// Logarithm of the odds that each unit is broken; at least 0.
    evidence: Vec<f64>,
    /// Last contact that counted.
    witness: Option<Solution>,
    /// Contacts that don't fit the calibration.
    chart: MisfitChart,
    is_out_of_date: bool,
    workspace: Workspace,
}

/// Fit without some units, in addition to the broken ones.
struct Partial {
    /// Missing units, in order.
    missing: Vec<usize>,
    fitted: Result<Arc<Fitted>, FitError>,
}

/// Reason why a reading has no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unanswered {
    /// The method has no answer.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// No output is left.
    #[error("every output is missing")]
    NoOutputs,
    /// The outputs that are left don't determine a contact.
    #[error("fewer than three outputs are left")]
    TooFewOutputs,
    /// There are no presses for fitting the method without the missing units.
    #[error("outputs are missing, and the sensor file doesn't contain the presses required to fit without them")]
    NoPresses,
    /// The method can't be fitted to the calibration without the missing units.
    #[error("outputs are missing, and the method can't be fitted to the others: {0}")]
    Unfit(FitError),
    /// Other sets of units were missing before, too many for another fit.
    #[error("outputs are missing in more than {MOST_PARTIAL} combinations, the largest number of fits")]
    TooMany,
    /// The reading of a series has no time.
    #[error("the reading has no time: a sensor with a history needs t_s, in s")]
    NoTime,
    /// Times of a series don't increase.
    #[error("its time of {t_s} s isn't later than {before_s} s, that of the reading before")]
    NotLater {
        /// Time of the reading, s.
        t_s: f64,
        /// Time of the reading before, s.
        before_s: f64,
    },
    /// Readings of a series are missing.
    #[error(
        "no reading for {gap_s:.2} s: after more than {GAP_MOST} intervals of the calibration its history begins again"
    )]
    Gap {
        /// Time since the reading before, s.
        gap_s: f64,
    },
    /// Other sessions of the same model use too many fits.
    #[error("other sessions of this sensor use {MOST_FITS} fits without broken or missing outputs, the largest number")]
    TooManyInAll,
}

/// Largest number of fits that are kept for readings with missing outputs. Each set of missing units requires one.
pub const MOST_PARTIAL: usize = 16;
/// Assumed fraction of contacts in which a broken unit is named.
const NAMED_IF_BROKEN: f64 = 0.5;
/// Assumed fraction of contacts in which a good unit is named.
const NAMED_IF_GOOD: f64 = 0.02;
/// Sufficient evidence (natural logarithm): a million to one.
const ENOUGH: f64 = 13.8;
/// Least distance of two different contacts, in sd.
const APART_SD: f64 = 3.0;
impl Session {
    /// Creates a session for a model.
    pub fn new(model: impl Into<Arc<Model>>) -> Self {
        Session::sharing(Arc::new(Fits::new(model)))
    }

    /// Creates a session that shares the fits of a model with other sessions.
    pub fn sharing(fits: Arc<Fits>) -> Self {
        Session {
            evidence: vec![0.0; fits.model().validity().units],
            chart: MisfitChart::new(fits.model().setting().false_alarms),
            fits,
            broke: Vec::new(),
            reduced: None,
            partial: Vec::new(),
            witness: None,
            is_out_of_date: false,
            workspace: Workspace::default(),
        }
    }

    /// Returns the model, with the units that broke in this session.
    pub fn model(&self) -> &Model {
        self.fits.model()
    }

    /// Returns the excluded units, in the order in which they were found.
    pub fn broken(&self) -> &[Broken] {
        self.fitted().broken()
    }

    /// Forgets all readings, so that the next answers are those of a new session.
    pub fn restart(&mut self) {
        let workspace = Workspace { other_loads: 0.0, ..std::mem::take(&mut self.workspace) };
        *self = Session { workspace, ..Session::sharing(self.fits.clone()) };
    }

    /// The method, without the units that broke.
    fn fitted(&self) -> &Fitted {
        self.reduced.as_deref().unwrap_or(self.fits.model().fitted())
    }

    /// Whether so many contacts didn't fit the calibration that the sensor should be calibrated again. Contacts at several places
    /// at once don't fit either.
    pub fn is_out_of_date(&self) -> bool {
        self.is_out_of_date
    }

    /// Solves the next reading; a missing output is NaN.
    ///
    /// # Errors
    /// The reading has no answer, or it can't be solved without its missing outputs.
    pub fn solve(&mut self, outputs: &[f64]) -> Result<Solution, Unanswered> {
        let (expected, found) = (self.evidence.len(), outputs.len());
        if found != expected {
            return Err(SolveError::Channels { expected, found }.into());
        }
        let is_left_out = |unit: usize| self.broken().iter().any(|broken| broken.unit == unit);
        let is_missing = |unit: &usize| outputs[*unit].is_nan() && !is_left_out(*unit);
        let missing: Vec<usize> = (0..found).filter(is_missing).collect();
        let partial = if missing.is_empty() { None } else { Some(self.partial(&missing)?) };
        // not by `fitted`, which would borrow the workspace too
        let fitted = partial.as_deref().or(self.reduced.as_deref()).unwrap_or(self.fits.model().fitted());
        let solution = fitted.solve(outputs, &mut self.workspace)?;
        self.weigh(&solution, &missing);
        Ok(solution)
    }

    /// Returns the fit without these units.
    fn partial(&mut self, missing: &[usize]) -> Result<Arc<Fitted>, Unanswered> {
        if let Some(partial) = self.partial.iter().find(|partial| partial.missing == missing) {
            return partial.fitted.clone().map_err(Unanswered::Unfit);
        }
        if missing.len() + self.broken().len() >= self.evidence.len() {
            return Err(Unanswered::NoOutputs);
        }
        if self.partial.len() == MOST_PARTIAL {
            return Err(Unanswered::TooMany);
        }
        let without = missing.iter().map(|&unit| Broken { unit, fault: OutputFault::Missing });
        let without: Vec<Broken> = self.broke.iter().copied().chain(without).collect();
        let fitted = self.fits.without(&without).map_err(|why| match why {
            Unmade::NoPresses => Unanswered::NoPresses,
            Unmade::TooMany => Unanswered::TooManyInAll,
        })?;
        self.partial.push(Partial { missing: missing.to_vec(), fitted: fitted.clone() });
        fitted.map_err(Unanswered::Unfit)
    }

    /// Counts the solution as evidence for or against each unit. Leaves out a unit if the evidence against it is sufficient.
    fn weigh(&mut self, solution: &Solution, missing: &[usize]) {
        let says_nothing = solution.verdict == ContactVerdict::WeakSignal;
        if says_nothing || self.witness.is_some_and(|last| is_same(&last, solution)) {
            return;
        }
        self.witness = Some(*solution);
        let named = match solution.verdict {
            ContactVerdict::ChannelFault(unit) => Some(unit),
            _ => None,
        };
        let odds_if_named = (NAMED_IF_BROKEN / NAMED_IF_GOOD).ln();
        let odds_if_not = ((1.0 - NAMED_IF_BROKEN) / (1.0 - NAMED_IF_GOOD)).ln();
        for (unit, evidence) in self.evidence.iter_mut().enumerate().filter(|(unit, _)| !missing.contains(unit)) {
            let odds = if named == Some(unit) { odds_if_named } else { odds_if_not };
            *evidence = (*evidence + odds).max(0.0);
        }
        self.is_out_of_date |= self.chart.count(solution);
        if let Some(unit) = named.filter(|unit| self.evidence[*unit] > ENOUGH) {
            let without = [self.broke.as_slice(), &[Broken { unit, fault: OutputFault::Contradicts }]].concat();
            // an array that has too few units left, or a model without presses, continues with the units it has
            if let Ok(Ok(fitted)) = self.fits.without(&without) {
                (self.broke, self.reduced) = (without, Some(fitted));
                self.partial.clear();
                // the unit was the reason
                self.chart = MisfitChart::new(self.model().setting().false_alarms);
            }
            self.evidence.fill(0.0);
        }
    }
}

/// Whether x, y or the force alone shows that two solutions don't belong to one contact. Most readings of other contacts end
/// here, without roots.
fn is_far(a: &Solution, b: &Solution, of_a: &[[f64; 3]; 3], of_b: &[[f64; 3]; 3]) -> bool {
    /// Rounding must not decide: in doubt the distance is computed.
    const MARGIN: f64 = 1.0 + 1e-9;
    let variance_mm2 = of_a[0][0] + of_a[1][1] + of_b[0][0] + of_b[1][1];
    let variance_n2 = of_a[2][2] + of_b[2][2];
    let apart = |difference: f64, variance: f64| difference * difference > MARGIN * APART_SD * APART_SD * variance;
    apart(a.place.x_mm - b.place.x_mm, variance_mm2)
        || apart(a.place.y_mm - b.place.y_mm, variance_mm2)
        || apart(a.force_n - b.force_n, variance_n2)
}

/// Whether two solutions may belong to one contact.
fn is_same(a: &Solution, b: &Solution) -> bool {
    let (Some(sd_a), Some(sd_b)) = (a.covariance, b.covariance) else { return false };
    if is_far(a, b, &sd_a.0, &sd_b.0) {
        return false;
    }
    let location_sd_mm = sd_a.x_mm().hypot(sd_a.y_mm()).hypot(sd_b.x_mm()).hypot(sd_b.y_mm());
    let force_sd_n = sd_a.force_n().hypot(sd_b.force_n());
    a.place.distance_mm(b.place) < APART_SD * location_sd_mm && (a.force_n - b.force_n).abs() < APART_SD * force_sd_n
}
