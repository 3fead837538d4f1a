//! A method fitted to an old calibration that few new presses have updated.

use super::adapt::{ArrayChange, Extent, Older};
use super::widths::rank_68;
use super::{Calibration, FitError, Fitted, HalfWidths, Model, Setting, Solver as _, Workspace, fit};
use palpate_core::parallel::in_parallel;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Method for the array in its present state, and what is known about the method.
pub struct Adapted {
    /// The method. Its half-widths are at least those that the held-out presses show.
    pub model: Model,
    /// Change between the old calibration and the new presses.
    pub change: ArrayChange,
    /// Properties that are assumed to have changed: the smallest extent, unless a larger one has smaller errors on held-out
    /// presses.
    pub extent: Extent,
    /// Results on the new presses, each solved by a method that was updated without this press.
    pub held_out: NewPressErrors,
}

/// Mean errors on the new presses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewPressErrors {
    /// Number of presses.
    pub presses: usize,
    /// Errors with the old calibration, unchanged.
    pub before: MeanErrors,
    /// Errors with the changed calibration, each press held out of the change.
    pub after: MeanErrors,
}

/// Mean errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeanErrors {
    /// Distance between true and solved place, mm.
    pub location_mm: f64,
    /// Difference between true and solved force, N.
    pub force_n: f64,
}

/// Reason why few presses can't update a calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AdaptError {
    /// The presses are from another array.
    #[error("the old calibration has {old} outputs per press, the new presses have {new}")]
    Units {
        /// Number of units in the old calibration.
        old: usize,
        /// Number of units in the new presses.
        new: usize,
    },
    /// There are too few presses.
    #[error("there are {presses} new presses; {FEWEST_PRESSES} are required")]
    TooFew {
        /// Number of presses.
        presses: usize,
    },
    /// A calibration knows its presses by depth.
    #[error("a calibration by depth can't be updated by a few presses: press all its places again")]
    ByDepth,
    /// The method can't be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// Smallest number of new presses.
pub(crate) const FEWEST_PRESSES: usize = 5;

/// Largest probability, by Student's t test, that chance alone gives a larger change its advantage on held-out presses. Above it
/// the larger change isn't used.
const BY_CHANCE: f64 = 0.1;

/// Largest number of parts into which the new presses are divided. One part at a time is held out.
const MOST_PARTS: usize = 5;

impl Adapted {
    /// Updates a calibration and fits the method of that name to it. Holds out the new presses, one part at a time.
    ///
    /// # Errors
    /// The presses are from another array or too few, or the method can't be fitted to the calibration.
    pub fn new(name: &str, old: &Calibration, new: &Calibration, setting: &Setting<'_>) -> Result<Self, AdaptError> {
        if old.units() != new.units() {
            return Err(AdaptError::Units { old: old.units(), new: new.units() });
        }
        if new.len() < FEWEST_PRESSES {
            return Err(AdaptError::TooFew { presses: new.len() });
        }
        if old.depth_curve().or(new.depth_curve()).is_some() {
            return Err(AdaptError::ByDepth);
        }
        let trials = NewPressTrials::new(name, old, new, setting)?;
        let held_out = trials.held_out()?;
        let extent = chosen(&held_out);
        let after = &held_out[extent as usize];
        let change = trials.older.change(new, extent);
        let mut model = Model::fit(trials.unchanged.name(), trials.older.changed(&change), setting)?;
        let [location, force] = beyond(&model, new, after);
        let forces_are_known = old.forces_are_known() && new.forces_are_known();
        model.widen(location, if forces_are_known { force } else { 1.0 });
        let before = mean(&errors(&trials.unchanged, new, &trials.presses(|_| true), 1.0));
        let held_out = NewPressErrors { presses: new.len(), before, after: mean(after) };
        Ok(Adapted { model, change, extent, held_out })
    }
}

/// Method that is tested on new presses.
struct NewPressTrials<'a> {
    older: Older<'a>,
    new: &'a Calibration,
    setting: Setting<'a>,
    /// Method fitted to the old calibration, unchanged. It is the best method for the old calibration, because few presses don't
    /// show which method is best.
    unchanged: Fitted,
    /// Part in which each new press is held out. Presses at one place are in the same part.
    part_of: Vec<usize>,
    parts: usize,
}

/// Error of each new press; `None` if there was no answer.
type PressErrors = Vec<Option<MeanErrors>>;

impl<'a> NewPressTrials<'a> {
    fn new(name: &str, old: &'a Calibration, new: &'a Calibration, setting: &Setting<'a>) -> Result<Self, FitError> {
        let setting = Setting { appraised: false, ..*setting };
        let spots = new.by_place();
        let parts = spots.len().min(MOST_PARTS);
        let mut part_of = vec![0; new.len()];
        for (spot, presses) in spots.iter().enumerate() {
            presses.iter().for_each(|&press| part_of[press] = spot % parts);
        }
        let unchanged = fit(name, old, &setting)?;
        Ok(NewPressTrials { older: Older::new(old)?, new, setting, unchanged, part_of, parts })
    }

    /// Returns the presses of the selected parts.
    fn presses(&self, is_of: impl Fn(usize) -> bool) -> Vec<usize> {
        (0..self.new.len()).filter(|&press| is_of(self.part_of[press])).collect()
    }

    /// Returns the errors of each extent. Each press is held out of the change.
    fn held_out(&self) -> Result<Vec<PressErrors>, FitError> {
        let jobs: Vec<(Extent, usize)> =
            Extent::ALL.into_iter().flat_map(|extent| (0..self.parts).map(move |part| (extent, part))).collect();
        let tried = in_parallel(&jobs, |&(extent, part)| self.without(extent, part));
        let mut held_out = vec![vec![None; self.new.len()]; Extent::ALL.len()];
        for ((extent, part), errors) in jobs.into_iter().zip(tried) {
            let presses = self.presses(|of| of == part);
            presses.into_iter().zip(errors?).for_each(|(press, error)| held_out[extent as usize][press] = error);
        }
        Ok(held_out)
    }

    /// Returns the errors of the presses of a part, which is held out of the change.
    fn without(&self, extent: Extent, part: usize) -> Result<PressErrors, FitError> {
        let [held, others] = [self.presses(|of| of == part), self.presses(|of| of != part)];
        // all at one place: there is nothing to learn
        if others.is_empty() {
            return Ok(errors(&self.unchanged, self.new, &held, 1.0));
        }
        let change = self.older.change(&self.new.subset(&others), extent);
        Ok(match extent {
            // a model fitted to larger outputs solves a reading as the old one solves a smaller reading
            Extent::CommonGain => errors(&self.unchanged, self.new, &held, change.units[0].gain),
            _ => {
                errors(&fit(self.unchanged.name(), &self.older.changed(&change), &self.setting)?, self.new, &held, 1.0)
            }
        })
    }
}

/// Returns the extent with the smallest error among the extents that have significantly smaller errors than a common gain. If
/// there is none, returns the common gain.
fn chosen(held_out: &[PressErrors]) -> Extent {
    let errors = |extent: Extent| &held_out[extent as usize];
    let leading = [Extent::Gains, Extent::GainsAndPlaces].into_iter();
    let leading = leading.filter(|larger| leads(errors(*larger), errors(Extent::CommonGain)));
    let location_mm = |extent: &Extent| mean(errors(*extent)).location_mm;
    leading.min_by(|a, b| location_mm(a).total_cmp(&location_mm(b))).unwrap_or(Extent::CommonGain)
}

/// Returns the errors of a method on some of the new presses, whose outputs are first divided by a gain. `None` where the method
/// has no answer.
fn errors(fitted: &Fitted, new: &Calibration, presses: &[usize], gain: f64) -> PressErrors {
    let mut workspace = Workspace::default();
    let error = |&press: &usize| {
        let point = new.point(press);
        let outputs: Vec<f64> = point.outputs.iter().map(|output| output / gain).collect();
        let solution = fitted.solve(&outputs, &mut workspace).ok()?;
        let force_n = (solution.force_n - point.force_n).abs();
        Some(MeanErrors { location_mm: solution.place.distance_mm(point.place), force_n })
    };
    presses.iter().map(error).collect()
}

/// Whether the location errors are smaller than the other errors on the same presses, by more than chance.
fn leads(errors: &PressErrors, others: &PressErrors) -> bool {
    let pairs = errors.iter().zip(others).filter_map(|(error, other)| error.as_ref().zip(other.as_ref()));
    let leads: Vec<f64> = pairs.map(|(error, other)| other.location_mm - error.location_mm).collect();
    let (count, free) = (leads.len() as f64, leads.len() as f64 - 1.0);
    let mean = leads.iter().sum::<f64>() / count;
    let variance = leads.iter().map(|lead| (lead - mean).powi(2)).sum::<f64>() / free;
    // too few leads to show anything: their number of degrees of freedom isn't one
    let sigmas = StudentsT::new(0.0, 1.0, free).map_or(f64::INFINITY, |t| t.inverse_cdf(1.0 - BY_CHANCE));
    mean > sigmas * (variance / count).sqrt()
}

/// Returns the factors for a model's 68 % half-widths of location and of force, each at least 1. With these factors the
/// half-widths contain 68 % of the given errors on the new presses.
fn beyond(model: &Model, new: &Calibration, errors: &[Option<MeanErrors>]) -> [f64; 2] {
    let mut workspace = Workspace::default();
    let (mut location, mut force) = (Vec::new(), Vec::new());
    for (point, error) in new.points().zip(errors) {
        let half_widths =
            model.fitted().solve(point.outputs, &mut workspace).ok().and_then(|solved| solved.half_widths);
        if let (Some(HalfWidths { half68_mm, half68_n, .. }), Some(error)) = (half_widths, error) {
            location.push(error.location_mm / half68_mm);
            force.push(error.force_n / half68_n);
        }
    }
    [location, force].map(|scores| rank_68(scores).map_or(1.0, |score| score.max(1.0)))
}

fn mean(errors: &[Option<MeanErrors>]) -> MeanErrors {
    let known = || errors.iter().flatten();
    let of = |error: fn(&MeanErrors) -> f64| known().map(error).sum::<f64>() / known().count().max(1) as f64;
    MeanErrors { location_mm: of(|error| error.location_mm), force_n: of(|error| error.force_n) }
}
