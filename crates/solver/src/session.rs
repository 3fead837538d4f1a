//! Solves one reading after another, without broken units.

use super::chart::MisfitChart;
use super::fits::Unmade;
use super::history::GAP_MOST;
use super::search_schedule::SearchSchedule;
use super::{
    Broken, ContactVerdict, FaultChange, FaultSearch, FaultyUnit, FitError, Fits, Fitted, MOST_FITS, Model,
    OutputFault, SearchedFaults, Solution, SolveError, Solver, Workspace,
};
use std::sync::Arc;

/// Solves one reading after another. If a unit breaks, it is excluded from then on.
///
/// A reading may have missing outputs, which are NaN. Such a reading is solved by the same method fitted without these units.
/// That fit is made for the first such reading, and kept.
///
/// A [`FaultSearch`] among the last contacts shows which units broke since the calibration, and which work again. It is made when the
/// contacts give a reason, and its result counts from the tenth contact after on. All readings of the same contact count once.
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
    schedule: SearchSchedule,
    changes: Vec<FaultChange>,
    /// Whether the program makes the searches.
    defers: bool,
    search: Searching,
    /// Number of restarts, which shows the result of an earlier search.
    restarts: u64,
    /// Last contact that counted.
    last: Option<Solution>,
    /// Last reading that was kept.
    last_outputs: Vec<f64>,
    /// Contacts that don't fit the calibration.
    chart: MisfitChart,
    /// Whether the chart reported, and whether that is stated.
    chart_reports: bool,
    is_out_of_date: bool,
    workspace: Workspace,
}

/// The search of a session.
enum Searching {
    /// None.
    No,
    /// One is due with these contacts, and begins when the program takes it.
    Due(FaultSearch),
    /// One was begun, and its result counts from this contact on.
    Begun { counts_from: u64 },
    /// The result is known, and counts from this contact on.
    Done { counts_from: u64, searched: SearchedFaults },
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
/// Number of contacts from the beginning of a search until its result counts. It is the same for a file as for a live stream, whose
/// answers don't wait for the search.
const COUNTS_AFTER: u64 = 10;
/// Least change of a reading that is kept, as a fraction of its length.
const CHANGED: f64 = 0.1;
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
            schedule: SearchSchedule::new(fits.model()),
            changes: Vec::new(),
            defers: false,
            search: Searching::No,
            restarts: 0,
            chart: MisfitChart::new(fits.model().setting().false_alarms),
            fits,
            broke: Vec::new(),
            reduced: None,
            partial: Vec::new(),
            last: None,
            last_outputs: Vec::new(),
            chart_reports: false,
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
        let (defers, restarts) = (self.defers, self.restarts + 1);
        *self = Session { workspace, defers, restarts, ..Session::sharing(self.fits.clone()) };
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

    /// States that the chart reports, unless a search shows soon whether units at fault are the reason.
    fn state_chart(&mut self) {
        let is_searched = match self.search {
            Searching::No => false,
            Searching::Due(_) => true,
            Searching::Begun { counts_from } | Searching::Done { counts_from, .. } => {
                self.schedule.count() < counts_from
            }
        };
        self.is_out_of_date |= self.chart_reports && !is_searched;
    }

    /// Solves the next reading; a missing output is NaN.
    ///
    /// # Errors
    /// The reading has no answer, or it can't be solved without its missing outputs.
    pub fn solve(&mut self, outputs: &[f64]) -> Result<Solution, Unanswered> {
        let (expected, found) = (self.model().validity().units, outputs.len());
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
        self.count(outputs, &solution);
        Ok(solution)
    }

    /// Returns the fit without these units.
    fn partial(&mut self, missing: &[usize]) -> Result<Arc<Fitted>, Unanswered> {
        if let Some(partial) = self.partial.iter().find(|partial| partial.missing == missing) {
            return partial.fitted.clone().map_err(Unanswered::Unfit);
        }
        if missing.len() + self.broken().len() >= self.model().validity().units {
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

    /// Counts a contact that differs from the last one, and keeps its reading for a search.
    fn count(&mut self, outputs: &[f64], solution: &Solution) {
        self.schedule.earn();
        if solution.verdict == ContactVerdict::WeakSignal {
            return;
        }
        if !self.last.is_some_and(|last| is_same(&last, solution)) {
            self.last = Some(*solution);
            self.chart_reports |= self.chart.count(solution);
        }
        if outputs.iter().all(|output| output.is_finite()) && !is_nearly(&self.last_outputs, outputs) {
            self.count_changed(outputs, solution);
        }
        self.state_chart();
    }

    /// Keeps the reading of a contact, and begins a search if one is due.
    fn count_changed(&mut self, outputs: &[f64], solution: &Solution) {
        self.last_outputs.clear();
        self.last_outputs.extend_from_slice(outputs);
        self.schedule.add(outputs, solution);
        self.apply();
        if matches!(self.search, Searching::No)
            && let Some(contacts) = self.schedule.due(self.chart_reports, !self.broke.is_empty())
        {
            self.begin(contacts);
        }
    }

    /// Begins a search, or leaves it to the program.
    fn begin(&mut self, contacts: Vec<Vec<f64>>) {
        self.search = Searching::Due(FaultSearch {
            fits: self.fits.clone(),
            contacts,
            broke: self.broke.clone(),
            work: self.schedule.work(),
            may_try: self.schedule.may_try(),
            paid: std::mem::take(&mut self.schedule.paid), // after `may_try`, which asks for it
            restarts: self.restarts,
        });
        if !self.defers
            && let Some(search) = self.search()
        {
            self.accept(search.run());
        }
    }

    /// Leaves searches for units at fault to the program: see [`Session::search`]. Otherwise [`Session::solve`] makes them.
    #[must_use]
    pub fn deferring(self) -> Self {
        Session { defers: true, ..self }
    }

    /// Returns a search for units at fault, if one is due, and none until its result is [accepted](Session::accept).
    pub fn search(&mut self) -> Option<FaultSearch> {
        let Searching::Due(_) = &self.search else { return None };
        let counts_from = self.schedule.count() + COUNTS_AFTER;
        match std::mem::replace(&mut self.search, Searching::Begun { counts_from }) {
            Searching::Due(search) => Some(search),
            _ => None,
        }
    }

    /// Whether the result of a search should count now, but isn't accepted yet.
    pub fn awaits_search(&self) -> bool {
        matches!(self.search, Searching::Begun { counts_from } if self.schedule.count() >= counts_from)
    }

    /// Takes the result of a search of this session. It counts from the tenth contact after the beginning of the search on.
    pub fn accept(&mut self, searched: SearchedFaults) {
        if let Searching::Begun { counts_from } = self.search
            && searched.restarts == self.restarts
        {
            self.search = Searching::Done { counts_from, searched };
            self.apply();
        }
    }

    /// Gives up a search that can't be made. Another one is due later.
    pub fn forget_search(&mut self) {
        self.search = Searching::No;
    }

    /// Ends the readings: lets the result of a search count, and that of another one if the last contacts give a reason for it.
    pub fn finish(&mut self) {
        self.count_now();
        if let Some(contacts) = self.schedule.due_at_end(self.chart_reports, !self.broke.is_empty()) {
            self.begin(contacts);
            if let Some(search) = self.search() {
                self.accept(search.run());
            }
            self.count_now();
        }
        self.state_chart();
    }

    /// Lets the result of a search count if it is time.
    fn apply(&mut self) {
        if matches!(self.search, Searching::Done { counts_from, .. } if self.schedule.count() >= counts_from) {
            self.count_now();
        }
    }

    /// Lets the result of a search count.
    fn count_now(&mut self) {
        let searched = match std::mem::replace(&mut self.search, Searching::No) {
            Searching::Done { searched, .. } => searched,
            other => {
                self.search = other;
                return;
            }
        };
        self.schedule.searched(searched.spent, searched.shown);
        self.schedule.paid = searched.paid;
        let is_stated = |change: &FaultChange| *change == FaultChange::Unfit && self.changes.contains(change);
        self.changes.extend(searched.changes.into_iter().filter(|change| !is_stated(change)).collect::<Vec<_>>());
        if let Some((broke, reduced)) = searched.found {
            (self.broke, self.reduced) = (broke, reduced);
            self.partial.clear();
            self.schedule.begin_again();
            // the units were the reason
            self.chart = MisfitChart::new(self.model().setting().false_alarms);
            (self.chart_reports, self.is_out_of_date) = (false, false);
        }
    }

    /// Returns the units that broke in this session and are left out.
    pub fn at_fault(&self) -> Vec<FaultyUnit> {
        let mut at_fault: Vec<FaultyUnit> = Vec::new();
        for change in &self.changes {
            match *change {
                FaultChange::LeftOut(faulty) => at_fault.push(faulty),
                FaultChange::Back(unit) => at_fault.retain(|faulty| faulty.unit != unit),
                FaultChange::Unfit => {}
            }
        }
        at_fault
    }

    /// Returns the changes of the units that are left out, from the first one.
    pub fn changes(&self) -> &[FaultChange] {
        &self.changes
    }
}

/// Whether a reading has hardly changed.
fn is_nearly(last: &[f64], outputs: &[f64]) -> bool {
    let square = |value: f64| value * value;
    let length = |row: &[f64]| row.iter().map(|output| square(*output)).sum::<f64>();
    let change: f64 = last.iter().zip(outputs).map(|(last, output)| square(output - last)).sum();
    !last.is_empty() && change <= CHANGED * CHANGED * length(last).max(length(outputs))
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
