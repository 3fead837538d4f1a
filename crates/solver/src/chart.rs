//! Control chart of the contacts that don't fit a calibration.

use super::{ContactVerdict, Solution};
use palpate_core::quantity::Ewma;

/// Compares the fraction of contacts that don't fit the calibration with the false-alarm rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct MisfitChart {
    unfit: Ewma,
    false_alarms: f64,
}

/// Weight of the newest contact: the chart's mean is that of some 100 contacts.
const NEWEST_WEIGHT: f64 = 0.02;
/// Variance of the fraction of good contacts that don't fit, relative to the binomial variance of one contact. Presses of a
/// calibration give this fraction only approximately.
const OF_RATE: f64 = 0.02;
/// Limit of the chart. At a false-alarm rate of 1 % it is reached when 13 % of some 100 contacts don't fit, or the first six.
const LIMIT_SIGMAS: f64 = 7.0;

impl MisfitChart {
    /// Creates a chart without contacts.
    pub(crate) fn new(false_alarms: f64) -> Self {
        MisfitChart { unfit: Ewma::new(NEWEST_WEIGHT), false_alarms }
    }

    /// Counts a contact. Returns whether so many contacts didn't fit that the sensor should be calibrated again. Answers that show
    /// nothing, or are outside the calibrated area, don't count.
    pub(crate) fn count(&mut self, solution: &Solution) -> bool {
        let shows_nothing = matches!(solution.verdict, ContactVerdict::WeakSignal | ContactVerdict::OutsideArea);
        if !shows_nothing && solution.misfit.is_some() {
            let (rate, is_unfit) = (self.false_alarms, f64::from(u8::from(solution.verdict != ContactVerdict::Ok)));
            self.unfit = self.unfit.with((is_unfit - rate) / (rate * (1.0 - rate)).sqrt());
        }
        self.unfit.is_changed(OF_RATE, LIMIT_SIGMAS)
    }
}
