//! Holds out calibration presses and solves them, as trials of a method.

use super::field::CalibratedArea;
use super::response::ForwardResponse;
use super::{Calibration, FitError, LocatedContact, Setting, SolveError, Workspace};
use palpate_core::quantity::{Place, stream};
use rand::distr::Distribution;
use rand_distr::StandardNormal;

/// Calibration press, scaled to another force, and solved by a method that was fitted without this press' place.
#[derive(Clone)]
pub(super) struct HeldPress<A = Result<LocatedContact, SolveError>> {
    /// Place of the press.
    pub place: Place,
    /// Force that the press represents, N.
    pub force_n: f64,
    /// Whether the press isn't at the border of the calibrated area. At the border, a fit without the press has to extrapolate,
    /// which no later press requires.
    pub is_inside: bool,
    /// Sum of the squares of the press's outputs divided by their noise.
    pub loudness: f64,
    /// Answer of the method.
    pub answer: A,
}

/// Factors by which held-out presses are scaled.
#[derive(Clone, Copy)]
enum Loads {
    /// The expected forces, smallest and largest, divided by the calibration's force. They are distributed evenly over the presses.
    Between(f64, f64),
    /// Each press is scaled by each factor.
    Each(&'static [f64]),
}

impl Loads {
    /// Number of trials of each press.
    fn count(self) -> usize {
        match self {
            // an unscaled press represents one force
            Loads::Between(least, most) if least == most => 1,
            Loads::Between(..) => FORCES_A_PRESS,
            Loads::Each(shares) => shares.len(),
        }
    }

    /// Returns the factor of one trial of the press with an index.
    fn share(self, index: usize, trial: usize) -> f64 {
        match self {
            Loads::Between(least, most) => {
                // evenly over the forces, for any order of the presses
                let quantile = (index as f64 * GOLDEN_SHARE + trial as f64 / self.count() as f64).fract();
                least + (most - least) * quantile
            }
            Loads::Each(shares) => shares[trial],
        }
    }
}

/// Parts into which the places of a calibration are divided. One part at a time is held out of a fit.
pub(super) struct Folds<'a> {
    calibration: &'a Calibration,
    /// Response that readings are compared with. Its noise is added to readings that are scaled down.
    response: &'a ForwardResponse,
    /// The presses of each part.
    parts: Vec<Vec<usize>>,
    loads: Loads,
    area: Option<CalibratedArea>,
}

/// Number of parts into which the places of a calibration are divided. One part at a time is held out. Of few places fewer are held
/// out at once, because a map without a fifth of them is much worse.
const FOLDS: usize = 5;
const FOLDS_OF_FEW: usize = 10;

/// Least number of places for which some can be held out.
const FEWEST_PLACES: usize = 9;

/// Number of forces that each press represents.
const FORCES_A_PRESS: usize = 2;

/// Largest number of trials. If there are more presses, some are used.
const MOST_TRIALS: usize = 2000;

impl<'a> Folds<'a> {
    /// Returns the parts of a calibration; `None` if it has too few places to hold any out.
    pub(crate) fn of(
        calibration: &'a Calibration,
        setting: &Setting<'_>,
        response: &'a ForwardResponse,
    ) -> Option<Self> {
        let mut spots = calibration.by_place();
        if spots.len() < FEWEST_PLACES {
            return None;
        }
        shuffle(&mut spots, &mut stream(0, 0, "held-out presses"));
        let folds = if calibration.has_few_places() { FOLDS_OF_FEW.min(spots.len()) } else { FOLDS };
        let part = |fold: usize| spots.iter().skip(fold).step_by(folds).flatten().copied().collect();
        let parts = (0..folds).map(part).collect();
        let inner = CalibratedArea::around(calibration.points().map(|point| point.place));
        let area = inner.filter(|area| calibration.points().any(|point| area.has_inside(point.place)));
        let (least, most) = setting.shares(calibration);
        Some(Folds { calibration, response, parts, loads: Loads::Between(least, most), area })
    }

    /// Returns the same parts, of which each press is scaled by each of these factors.
    pub(crate) fn scaled_by(self, shares: &'static [f64]) -> Self {
        Folds { loads: Loads::Each(shares), ..self }
    }

    /// Number of parts.
    pub(crate) fn count(&self) -> usize {
        self.parts.len()
    }

    /// Tries a method on some of the parts, with the force unknown to the method. Held-out presses are rescaled to the expected
    /// forces. Noise is added to presses that were scaled down, so that they are as noisy as measured ones.
    ///
    /// # Errors
    /// The method can't be fitted to the other parts.
    pub(crate) fn trials<M, A>(
        &self,
        folds: impl Iterator<Item = usize>,
        fit: impl Fn(&Calibration) -> Result<M, FitError>,
        answer: impl Fn(&M, &[f64], &mut Workspace) -> A,
    ) -> Result<Vec<HeldPress<A>>, FitError> {
        let forces = self.loads.count();
        let mut trials = Vec::new();
        let mut workspace = Workspace::default();
        let mut reading = vec![0.0; self.calibration.units()];
        for fold in folds {
            let mut rng = stream(0, fold as u64, "noise of held-out presses");
            let others = (0..self.count()).filter(|part| *part != fold).flat_map(|part| &self.parts[part]);
            let method = fit(&self.calibration.subset(&others.copied().collect::<Vec<_>>()))?;
            let held = &self.parts[fold];
            // of many presses some, from everywhere
            let every = held.len().div_ceil(MOST_TRIALS / self.count() / forces).max(1);
            for (index, &press) in held.iter().step_by(every).enumerate() {
                let point = self.calibration.point(press);
                for trial in 0..forces {
                    let share = self.loads.share(index, trial);
                    for (unit, (reading, output)) in reading.iter_mut().zip(point.outputs).enumerate() {
                        let normal: f64 = StandardNormal.sample(&mut rng);
                        *reading = share * output + self.response.missing_noise(unit, share) * normal;
                    }
                    trials.push(HeldPress {
                        place: point.place,
                        force_n: share * point.force_n,
                        is_inside: self.area.is_none_or(|area| area.has_inside(point.place)),
                        loudness: self.response.loudness(&reading),
                        answer: answer(&method, &reading, &mut workspace),
                    });
                }
            }
        }
        Ok(trials)
    }
}

/// Golden section. Any number of its multiples is evenly distributed over the unit interval.
pub(super) const GOLDEN_SHARE: f64 = 0.618_033_988_749_894_9;

/// Shuffles a list (Fisher and Yates).
pub(super) fn shuffle<T>(list: &mut [T], rng: &mut impl rand::Rng) {
    for last in (1..list.len()).rev() {
        let other = (rng.next_u64() % (last as u64 + 1)) as usize;
        list.swap(last, other);
    }
}
