//! A calibration prepared for fitting any number of methods. Results that several methods need are computed once.

use super::appraised::Appraised;
use super::best::MethodTrials;
use super::blend::{Blend, MemberErrors};
use super::broken::{broken, kept};
use super::by_load::{Both, ByLoad, Earned, LOADS, Lengths};
use super::extra_trees::ExtraTrees;
use super::field::CalibratedArea;
use super::fitted::Answering;
use super::forward::{Forward, MapKind};
use super::gaussian_process::{GaussianProcess, Likeliest};
use super::heldout::{Folds, HeldPress};
use super::method::{BLEND, EXTRA_TREES, FittedMethod, PATTERN_MAP, PHYSICS, PROCESS, SURROGATE};
use super::pattern_map::{Correlations, PatternMap};
use super::physics::physics;
use super::response::ForwardResponse;
use super::surrogate::{surrogate, surrogate_with};
use super::threshold::Unexplained;
use super::view::has_several_lengths;
use super::{
    BEST, Broken, Calibration, Choice, FitError, Fitted, ForceKnown, ForceRule, Locate, Pearson, SOLVERS, Setting,
    Solver as _, TriedMethod, best,
};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::{ArrayLayout, Place};
use std::ops::RangeBounds;
use std::sync::OnceLock;

/// A calibration, and other data about its array.
pub struct PreparedCalibration<'a> {
    /// Calibration without the excluded units.
    calibration: Calibration,
    /// Layout of the remaining units, if some are excluded.
    layout: Option<ArrayLayout>,
    setting: Setting<'a>,
    broken: Vec<Broken>,
    /// Number of units, including the excluded units.
    units: usize,
    /// The smooth map of the calibration.
    response: OnceLock<Result<ForwardResponse, FitError>>,
    /// View of a reading in the Gaussian process, and its correlation.
    process: OnceLock<Result<Likeliest, FitError>>,
    /// The pattern map of the calibration, and its correlations.
    pattern: OnceLock<Result<(PatternMap, Correlations), FitError>>,
    /// The trials of each method, by [`SOLVERS`].
    trials: [FoldTrials; SOLVERS.len()],
}

/// Trials of a method on the first part of the presses, and on the other parts.
#[derive(Default)]
struct FoldTrials {
    first: OnceLock<Result<Vec<HeldPress>, FitError>>,
    others: OnceLock<Result<Vec<HeldPress>, FitError>>,
}

/// The chosen method, and its trials.
struct ChosenMethod {
    solver: &'static str,
    trials: Vec<HeldPress>,
    choice: Choice,
}

/// Least advantage over the next method, in standard deviations, that justifies `blend`, which runs two methods.
const WORTH_TWO_SIGMAS: f64 = 2.0;

/// Methods that learn the place, or the pattern, from the readings alone, at many times the cost of the smooth map.
const REGRESSIONS: [&str; 3] = [PROCESS, PATTERN_MAP, EXTRA_TREES];

/// Largest mean location error that counts as small, as a fraction of the area's longer side.
const LITTLE_OF_AREA: f64 = 0.05;

/// Largest leverage of a smooth map that explains the calibration with which `physics` isn't tried. The error of a predicted output is
/// then at most 6 % larger than with a map that is known exactly.
const KNOWN_LEVERAGE: f64 = 0.12;

/// Largest ratio of the mean location error of such a map to the error that its noise explains, and largest correlation of its units'
/// residuals. Errors that units have in common make both larger, and regressions can be more accurate then.
const AS_STATED: f64 = 1.2;
const UNCORRELATED: f64 = 2.5;

/// Number of places for each unit from which the correlations of all units are known well. The second constant is the least number
/// from which they can be learned unless places are few; `pattern-map` then needs a clear lead, because the places of a grid are
/// predicted better than those between them.
const PLACES_A_UNIT: usize = 10;
const FEWEST_PLACES_A_UNIT: usize = 4;
/// Least lead of `pattern-map` with few places for each unit: in standard errors, or as the ratio of both errors.
const FEW_PLACES_SIGMAS: f64 = 2.0;
const FEW_PLACES_LEAD: f64 = 1.5;

/// Largest ratio of the residual of `physics` to that of the smooth map: standard deviations, geometric mean of all units.
const UNEXPLAINED: f64 = 1.15;

/// Least number of places inside the area on which methods are compared.
const FEWEST_INSIDE: usize = 4;
/// Largest residual of `physics`, as a fraction of a unit's output, with which it explains fewer places.
const UNEXPLAINED_OF_FEW: f64 = 0.1;

/// Ratio of the next method's error to that of `physics` from which `physics` leads although its residual is larger. With very
/// few places the smooth map is poor, and its residual shows nothing.
const FAR_AHEAD: f64 = 3.0;

impl<'a> PreparedCalibration<'a> {
    /// Prepares a calibration, without the units that are dead or saturated.
    ///
    /// # Errors
    /// The layout belongs to another array, or no unit is left.
    pub fn new(calibration: Calibration, setting: &Setting<'a>) -> Result<Self, FitError> {
        if let Some(layout) = setting.layout.filter(|layout| layout.len() != calibration.units()) {
            return Err(FitError::Layout { layout: layout.len(), calibration: calibration.units() });
        }
        let broken = broken(&calibration);
        PreparedCalibration::without(calibration, setting, broken)
    }

    /// Returns the same calibration with the units to leave out.
    pub(super) fn without(
        calibration: Calibration,
        setting: &Setting<'a>,
        broken: Vec<Broken>,
    ) -> Result<Self, FitError> {
        let units = calibration.units();
        let prepared = |calibration, layout, broken| PreparedCalibration {
            calibration,
            layout,
            setting: *setting,
            broken,
            units,
            response: OnceLock::new(),
            process: OnceLock::new(),
            pattern: OnceLock::new(),
            trials: Default::default(),
        };
        if broken.is_empty() {
            return Ok(prepared(calibration, None, broken));
        }
        let kept = kept(units, &broken);
        if kept.is_empty() {
            return Err(FitError::NothingToTellApart);
        }
        let layout = setting.layout.map(|layout| layout.only(&kept));
        Ok(prepared(calibration.of_units(&kept), layout, broken))
    }

    /// Returns the dead or saturated units, which are excluded.
    pub fn broken(&self) -> &[Broken] {
        &self.broken
    }

    /// Fits the method of that name, like [`fit`](super::fit).
    ///
    /// # Errors
    /// No method has that name, or the method can't be fitted to the calibration.
    pub fn fit(&self, name: &str) -> Result<Fitted, FitError> {
        Ok(self.left_out(self.fit_to_kept(name)?))
    }

    /// Fits a method to other presses of the array, with the correlations of this calibration. Its errors are those of this
    /// calibration's trials.
    pub(super) fn fit_again(&self, name: &str, presses: &Calibration) -> Result<Fitted, FitError> {
        let method = self.fit_part(&presses.of_units(&kept(self.units, &self.broken)), name)?;
        Ok(self.left_out(self.fitted(self.stating(method, &self.tried(name)?)?)))
    }

    /// Fits a method, whose errors are those of the trials of another calibration of the array.
    pub(super) fn fit_with_trials_of(&self, other: &PreparedCalibration<'_>, name: &str) -> Result<Fitted, FitError> {
        Ok(self.left_out(self.fitted(self.answering(name, &other.tried(name)?)?)))
    }

    /// Returns a fit of the kept units as a fit of all units.
    fn left_out(&self, fitted: Fitted) -> Fitted {
        let fitted = fitted.with_depth_curve(self.calibration.depth_curve().cloned());
        if self.broken.is_empty() { fitted } else { fitted.without(self.broken.clone(), self.units) }
    }

    /// Returns the mean errors of a method on held-out presses; for [`BEST`] those of all methods that were tried, the chosen one
    /// first.
    ///
    /// # Errors
    /// No method has that name, or the method can't be fitted to the calibration.
    pub fn candidates(&self, name: &str) -> Result<Vec<TriedMethod>, FitError> {
        match SOLVERS.into_iter().find(|solver| *solver == name) {
            Some(solver) => Ok(vec![self.candidate(&self.tried_as(solver, self.tried(solver)?))]),
            None => Ok(self.fit(name)?.choice().map(|choice| choice.candidates.clone()).unwrap_or_default()),
        }
    }

    fn fit_to_kept(&self, name: &str) -> Result<Fitted, FitError> {
        match name {
            BEST => self.best(),
            name if !SOLVERS.contains(&name) => Err(FitError::UnknownSolver { name: name.to_owned() }),
            name if self.setting.appraised => Ok(self.fitted(self.answering(name, &self.tried(name)?)?)),
            SURROGATE | PHYSICS => Ok(self.fitted(self.answering(name, &[])?)),
            name => Ok(self.fitted(Answering::Appraised(Box::new(Appraised::unappraised(self.method(name)?))))),
        }
    }

    /// Chooses the method with the least location error on held-out places. If the location errors are nearly equal, a much smaller force
    /// error decides. If the smooth map explains the calibration, no other regression is tried; nor is `physics` if the map's own
    /// error is small. After the first part of the places, methods with much larger errors aren't tried further.
    fn choose(&self) -> Result<ChosenMethod, FitError> {
        let is_explained = self.is_explained()?;
        let is_known = is_explained && self.response()?.mean_leverage() <= KNOWN_LEVERAGE;
        let needless = |name: &str| (is_explained && REGRESSIONS.contains(&name)) || (is_known && name == PHYSICS);
        let is_tried = |name: &&str| self.is_candidate(name) && !needless(name);
        let names: Vec<&'static str> = SOLVERS.into_iter().filter(is_tried).collect();
        let first = |&solver: &&'static str| self.tried_as(solver, self.first_trials(solver).unwrap_or_default());
        let mut tried = in_parallel(&names, first);
        // the mean of two methods can be good although one of them is far behind
        self.add_blend(&mut tried);
        // a lead that follows from assumptions about the cover may be due to few places: see `may_lead`
        let mut hopeful = best::hopeful(&tried, |tried| tried.solver != PHYSICS);
        if tried.len() > names.len() && hopeful.pop().is_some_and(|is_hopeful| is_hopeful) {
            let is_member = |name: &&'static str| self.members().contains(name);
            names.iter().zip(&mut hopeful).filter(|(name, _)| is_member(name)).for_each(|(_, hopeful)| *hopeful = true);
        }
        tried.truncate(names.len());
        let on: Vec<usize> = (0..names.len()).filter(|&method| hopeful[method]).collect();
        let trials = in_parallel(&on, |&method| self.tried(names[method]).unwrap_or_default());
        on.into_iter().zip(trials).for_each(|(method, trials)| tried[method].trials = trials);
        self.add_blend(&mut tried);
        let mut ranked = best::ranked(&tried);
        let may_lead = |&rank: &usize| self.may_lead(ranked[rank], &ranked[rank + 1..]);
        // a mean of two methods is worth its time for a much smaller force error
        let may_lead_by_force = |rank: &usize| ranked[*rank].solver == BLEND || may_lead(rank);
        let of_few = ranked.iter().position(|tried| tried.solver == PHYSICS).filter(|_| self.is_elastic_by_few());
        let leader = of_few.unwrap_or_else(|| best::leader(&ranked, may_lead, may_lead_by_force));
        ranked[..=leader].rotate_right(1);
        let candidates: Vec<_> = ranked.iter().map(|tried| self.candidate(tried)).collect();
        let ties = best::ties(&ranked);
        let chosen = if candidates[0].location_error_mm.is_some() { ranked[0] } else { &tried[0] };
        let mean_place_error_mm = chosen.mean_place_error_mm();
        let (solver, trials) = (chosen.solver, chosen.trials.clone());
        Ok(ChosenMethod { solver, trials, choice: Choice { candidates, ties, mean_place_error_mm, load_gain: None } })
    }

    /// Returns the chosen method. If forces are unknown and it is worth it, a second one answers readings with the load of the
    /// calibration.
    fn best(&self) -> Result<Fitted, FitError> {
        let ChosenMethod { solver, trials, mut choice } = self.choose()?;
        let any = self.answering(solver, &trials)?;
        let second = match self.has_one_unknown_load() {
            true => self.second(solver, choice.location_error_mm())?,
            false => None,
        };
        choice.load_gain = second.as_ref().map(|(_, earned)| earned.gain.clone());
        Ok(self.with_second(any, second).chosen(choice))
    }

    /// Returns a method for any load, and a second one for the load of the calibration if there is one.
    fn with_second(&self, any: Answering, second: Option<(Answering, Earned)>) -> Fitted {
        self.fitted(match second {
            Some((calibrated, earned)) => Answering::ByLoad(ByLoad::new(any, calibrated, &earned, &self.calibration)),
            None => any,
        })
    }

    /// Returns the best method that assumes the load of the calibration, if it is worth using beside the method for any load, which has
    /// this error.
    fn second(&self, any: &str, any_mm: Option<f64>) -> Result<Option<(Answering, Earned)>, FitError> {
        let alike = self.with_equal_forces()?;
        let ChosenMethod { solver, choice, .. } = alike.choose()?;
        let is_better = choice.location_error_mm().zip(any_mm).is_some_and(|(error_mm, any_mm)| error_mm < any_mm);
        if is_better { self.earned(any, &alike, solver) } else { Ok(None) }
    }

    /// Returns the same presses, all with the same load, which is expected of contacts too.
    fn with_equal_forces(&self) -> Result<PreparedCalibration<'_>, FitError> {
        let setting = Setting { load: ForceKnown::Constant, ..self.setting() };
        PreparedCalibration::without(self.calibration.with_equal_forces(), &setting, Vec::new())
    }

    /// Returns a method that assumes the load of the calibration, if held-out presses show that it is worth it.
    fn earned(
        &self,
        any: &str,
        alike: &PreparedCalibration<'_>,
        calibrated: &str,
    ) -> Result<Option<(Answering, Earned)>, FitError> {
        let Some(folds) = Folds::of(&self.calibration, &self.setting(), self.response()?) else { return Ok(None) };
        let folds = folds.scaled_by(&LOADS);
        let fit = |part: &Calibration| {
            let calibrated = alike.fit_part(&part.with_equal_forces(), calibrated)?;
            Ok(Both { any: self.fit_part(part, any)?, calibrated, lengths: Lengths::of(part) })
        };
        let each: Vec<usize> = (0..folds.count()).collect();
        let trials = in_parallel(&each, |&fold| folds.trials(fold..=fold, fit, Both::answers));
        let trials: Vec<_> = trials.into_iter().collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
        let Some(earned) = Earned::of(&trials, calibrated) else { return Ok(None) };
        Ok(Some((alike.answering(calibrated, &earned.answered)?, earned)))
    }

    /// Fits the methods of another fit.
    pub(super) fn fit_like(&self, other: &Fitted) -> Result<Fitted, FitError> {
        let Answering::ByLoad(by_load) = other.answering() else { return self.fit(other.name()) };
        let (any, calibrated) = (by_load.any.solver().name(), by_load.calibrated.solver().name());
        let any_fit = self.answering(any, &self.tried(any)?)?;
        let second = self.earned(any, &self.with_equal_forces()?, calibrated)?;
        Ok(self.left_out(self.with_second(any_fit, second)))
    }

    /// Returns a method that is fitted to some of the presses; `blend` with the members' errors of all presses.
    fn fit_part(&self, part: &Calibration, name: &str) -> Result<FittedMethod, FitError> {
        if name == BLEND { self.blend(|member| self.fit_to(part, member)) } else { self.fit_to(part, name) }
    }

    /// Returns `blend` of members that `fit` makes, with the members' errors of all presses.
    fn blend(&self, fit: impl Fn(&str) -> Result<FittedMethod, FitError>) -> Result<FittedMethod, FitError> {
        let [one, other] = self.members();
        let errors = [MemberErrors::of(&self.tried(one)?), MemberErrors::of(&self.tried(other)?)];
        Ok(FittedMethod::Blend(Blend::new([fit(one)?, fit(other)?], errors)))
    }

    /// Whether the method ranked before others may be chosen. `blend` runs two methods, and the assumptions of `physics` may
    /// be wrong for this skin.
    fn may_lead(&self, first: &MethodTrials, others: &[&MethodTrials]) -> bool {
        let next = others.first();
        match first.solver {
            BLEND => next.is_none_or(|next| first.lead_sigmas(next) >= WORTH_TWO_SIGMAS),
            PHYSICS => next.is_some_and(|next| first.lead(next) >= FAR_AHEAD) || self.is_elastic(),
            PATTERN_MAP => {
                // `blend` has it as a member
                let rival = others.iter().find(|other| other.solver != BLEND);
                let is_ahead = |rival: &&MethodTrials| {
                    first.lead(rival) >= FEW_PLACES_LEAD || first.lead_sigmas(rival) >= FEW_PLACES_SIGMAS
                };
                self.has_places_a_unit(PLACES_A_UNIT) || rival.is_none_or(is_ahead)
            }
            _ => true,
        }
    }

    /// Whether a method is a candidate for `best`. `physics` needs the units' positions, and learning the common deviations of
    /// all units takes many places for each unit.
    fn is_candidate(&self, name: &str) -> bool {
        match name {
            PHYSICS => self.setting().layout.is_some(),
            PATTERN_MAP => {
                let is_learnable = !self.calibration.has_few_places() && self.has_places_a_unit(FEWEST_PLACES_A_UNIT);
                is_learnable || self.has_places_a_unit(PLACES_A_UNIT)
            }
            // from the results of its members
            BLEND => false,
            _ => true,
        }
    }

    fn has_places_a_unit(&self, least: usize) -> bool {
        self.calibration.by_place().len() >= least * self.calibration.units()
    }

    /// Whether the smooth map leaves only noise of the calibration, independent for each unit, and this noise explains the location
    /// errors and makes them small. Then no regression can be much more accurate. With a larger noise, a regression that stays near the
    /// mean of all places can be more accurate.
    fn is_explained(&self) -> Result<bool, FitError> {
        let (response, setting) = (self.response()?, self.setting());
        if !Unexplained::of(response, &self.calibration, &setting).is_noise() {
            return Ok(false);
        }
        let tried = self.tried_as(SURROGATE, self.first_trials(SURROGATE)?);
        let most_mm = LITTLE_OF_AREA * response.field.area().side_mm();
        let is_small = tried.candidate().location_error_mm.is_some_and(|error_mm| error_mm <= most_mm);
        let is_as_stated = tried.mean_of_stated().is_some_and(|ratio| ratio <= AS_STATED);
        Ok(is_small && is_as_stated && response.correlation() <= UNCORRELATED)
    }

    /// Names of the methods that are blended: a regression and a map.
    fn members(&self) -> [&'static str; 2] {
        [PROCESS, if self.has_places_a_unit(PLACES_A_UNIT) { PATTERN_MAP } else { SURROGATE }]
    }

    /// Adds `blend` to the tried methods, if its members were tried on all parts.
    fn add_blend(&self, tried: &mut Vec<MethodTrials>) {
        let most = tried.iter().map(|tried| tried.trials.len()).max().unwrap_or(0);
        let of = |name| tried.iter().find(|tried| tried.solver == name && tried.trials.len() == most);
        let [Some(one), Some(other)] = self.members().map(of) else { return };
        let trials = Blend::trials([&one.trials, &other.trials]);
        tried.push(self.tried_as(BLEND, trials));
    }

    /// Whether `physics` explains the calibration as well as the smooth map does, so that its residual is only noise. If not,
    /// `physics` is wrong for this skin. It then leads only with very few places, where holding some out harms the smooth map
    /// more.
    fn is_elastic(&self) -> bool {
        let Ok(physics) = physics(&self.calibration, self.setting().layout) else { return false };
        let Ok(smooth) = self.response() else { return false };
        let ratios = physics.typical_sd().into_iter().zip(smooth.typical_sd());
        let logs: Vec<f64> = ratios.map(|(elastic, smooth)| (elastic / smooth).ln()).collect();
        logs.iter().sum::<f64>() / logs.len() as f64 <= UNEXPLAINED.ln()
    }

    /// Whether too few places are inside the area to compare methods on them, and `physics` explains most of the outputs. On a grid
    /// of 3 x 3 only the middle is inside, and one place that is held out shows nothing about the method.
    fn is_elastic_by_few(&self) -> bool {
        let area = CalibratedArea::around(self.calibration.points().map(|point| point.place));
        let is_inside = |place: &Place| area.is_some_and(|area| area.has_inside(*place));
        let places: Vec<Place> =
            self.calibration.by_place().iter().map(|spot| self.calibration.point(spot[0]).place).collect();
        if !self.is_candidate(PHYSICS) || places.iter().filter(|place| is_inside(place)).count() >= FEWEST_INSIDE {
            return false;
        }
        let Ok(physics) = physics(&self.calibration, self.setting().layout) else { return false };
        let rms = |unit: usize| {
            let squares = self.calibration.points().map(|point| point.outputs[unit].powi(2));
            (squares.sum::<f64>() / self.calibration.len() as f64).sqrt()
        };
        let ratios = physics.typical_sd().into_iter().enumerate().map(|(unit, sd)| (sd / rms(unit)).ln());
        let share = (ratios.sum::<f64>() / self.calibration.units() as f64).exp();
        share <= UNEXPLAINED_OF_FEW
    }

    /// Returns the mean errors of a method. Those of intensities aren't in newtons, so they aren't stated.
    fn candidate(&self, tried: &MethodTrials) -> TriedMethod {
        let candidate = tried.candidate();
        let force_error_n = candidate.force_error_n.filter(|_| self.calibration.depth_curve().is_none());
        TriedMethod { force_error_n, ..candidate }
    }

    fn tried_as(&self, solver: &'static str, trials: Vec<HeldPress>) -> MethodTrials {
        MethodTrials { solver, trials, forces_are_known: self.calibration.forces_are_known() }
    }

    /// Returns the trials of a method on all presses, each held out of the calibration.
    fn tried(&self, name: &str) -> Result<Vec<HeldPress>, FitError> {
        if name == BLEND {
            let [one, other] = self.members();
            return Ok(Blend::trials([&self.tried(one)?, &self.tried(other)?]));
        }
        let mut trials = self.first_trials(name)?;
        let others = || self.try_on(1.., name);
        trials.extend_from_slice(self.trials_of(name)?.others.get_or_init(others).as_ref().map_err(Clone::clone)?);
        Ok(trials)
    }

    /// Returns the trials on the first part of the presses.
    fn first_trials(&self, name: &str) -> Result<Vec<HeldPress>, FitError> {
        self.trials_of(name)?.first.get_or_init(|| self.try_on(..1, name)).clone()
    }

    fn trials_of(&self, name: &str) -> Result<&FoldTrials, FitError> {
        let index = SOLVERS.iter().position(|solver| *solver == name);
        Ok(&self.trials[index.ok_or_else(|| FitError::UnknownSolver { name: name.to_owned() })?])
    }

    fn try_on(&self, folds: impl RangeBounds<usize>, name: &str) -> Result<Vec<HeldPress>, FitError> {
        match Folds::of(&self.calibration, &self.setting(), self.response()?) {
            Some(parts) => {
                let folds = (0..parts.count()).filter(|fold| folds.contains(fold));
                parts.trials(folds, |part| self.fit_to(part, name), Locate::locate)
            }
            None => Ok(Vec::new()),
        }
    }

    /// Returns the Gaussian process' view of a reading, and its correlation.
    fn process(&self) -> Result<&Likeliest, FitError> {
        let seek = || GaussianProcess::seek(&self.calibration, self.setting.load);
        self.process.get_or_init(seek).as_ref().map_err(Clone::clone)
    }

    /// Returns the pattern map of the calibration, and its correlations.
    fn pattern(&self) -> Result<&(PatternMap, Correlations), FitError> {
        let fit = || PatternMap::fit(&self.calibration, self.setting.load, &Correlations::default());
        self.pattern.get_or_init(fit).as_ref().map_err(Clone::clone)
    }

    /// Returns a method that has learned the uncertainty of its answers from its trials.
    fn answering(&self, name: &str, trials: &[HeldPress]) -> Result<Answering, FitError> {
        self.stating(self.method(name)?, trials)
    }

    /// Returns a method with the uncertainty of its answers that trials show.
    fn stating(&self, method: FittedMethod, trials: &[HeldPress]) -> Result<Answering, FitError> {
        let setting = self.setting();
        Ok(match method {
            FittedMethod::Forward(forward) => Answering::Forward(Box::new(forward.learned_curve(trials, &setting))),
            method => Answering::Appraised(Box::new(Appraised::new(method, trials, self.response()?, &setting))),
        })
    }

    fn fitted(&self, answering: Answering) -> Fitted {
        let fitted = Fitted::new(answering, self.calibration.units());
        if self.has_one_unknown_load() { fitted.of_one_load(&self.calibration) } else { fitted }
    }

    /// Whether all presses have the same load, which is unknown, and contacts may have others.
    fn has_one_unknown_load(&self) -> bool {
        let is_unknown = !self.calibration.forces_are_known() && self.setting.load == ForceKnown::Unknown;
        is_unknown && !has_several_lengths(&self.calibration)
    }

    /// Returns a method that is fitted to all presses.
    fn method(&self, name: &str) -> Result<FittedMethod, FitError> {
        match name {
            SURROGATE => Ok(self.forward(MapKind::Smooth, self.response()?.clone(), &self.calibration)),
            BLEND => self.blend(|member| self.method(member)),
            PATTERN_MAP => Ok(FittedMethod::PatternMap(self.pattern()?.0.clone())),
            name => self.fit_to(&self.calibration, name),
        }
    }

    /// Returns a method that is fitted to some of the presses. The correlations are those of all presses. A change of a fifth in
    /// the presses has little effect on them, and finding them takes most of a fit's time.
    fn fit_to(&self, part: &Calibration, name: &str) -> Result<FittedMethod, FitError> {
        let setting = self.setting();
        Ok(match name {
            SURROGATE => {
                self.forward(MapKind::Smooth, surrogate_with(part, self.response()?.hyperparameters.as_ref())?, part)
            }
            PHYSICS => self.forward(MapKind::Elastic, physics(part, setting.layout)?, part),
            PROCESS => FittedMethod::GaussianProcess(GaussianProcess::fit_with(part, setting.load, self.process()?)?),
            PATTERN_MAP => FittedMethod::PatternMap(PatternMap::fit(part, setting.load, &self.pattern()?.1)?.0),
            "pearson" => FittedMethod::Pearson(Pearson::fit(part, setting.layout, ForceRule::ClosestUnit)?),
            "pearson-lsq" => FittedMethod::Pearson(Pearson::fit(part, setting.layout, ForceRule::LeastSquares)?),
            EXTRA_TREES => FittedMethod::ExtraTrees(ExtraTrees::fit(part, setting.load)?),
            name => return Err(FitError::UnknownSolver { name: name.to_owned() }),
        })
    }

    fn forward(&self, kind: MapKind, response: ForwardResponse, calibration: &Calibration) -> FittedMethod {
        FittedMethod::Forward(Box::new(Forward::new(kind, response, calibration, &self.setting())))
    }

    pub(super) fn response(&self) -> Result<&ForwardResponse, FitError> {
        self.response.get_or_init(|| surrogate(&self.calibration)).as_ref().map_err(Clone::clone)
    }

    pub(super) fn setting(&self) -> Setting<'_> {
        Setting { layout: self.layout.as_ref().or(self.setting.layout), ..self.setting }
    }
}
