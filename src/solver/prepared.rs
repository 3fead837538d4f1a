//! A calibration made ready to fit any number of methods to: what several of them need is found once.

use super::appraised::Appraised;
use super::best::Tried;
use super::blend::{Blend, MemberErrors};
use super::broken::broken;
use super::extra_trees::ExtraTrees;
use super::forward::Forward;
use super::gaussian_process::{GaussianProcess, Likeliest};
use super::heldout::{FOLDS, Folds, HeldPress};
use super::pattern_map::PatternMap;
use super::physics::physics;
use super::response::Response;
use super::surrogate::{surrogate, surrogate_with};
use super::{
    BEST, Broken, Calibration, FitError, Fitted, ForceRule, Locate, Pearson, PearsonKnn, SOLVERS, Setting, Solver,
    Whitened, best,
};
use crate::parallel::in_parallel;
use crate::quantity::ArrayLayout;
use std::ops::Range;
use std::sync::OnceLock;

/// A calibration, and what is known of it beside.
pub struct Prepared<'a> {
    /// Without the units that are left out.
    calibration: Calibration,
    /// That of the units that are left, where some are left out.
    layout: Option<ArrayLayout>,
    setting: Setting<'a>,
    broken: Vec<Broken>,
    /// How many units there are with those that are left out.
    units: usize,
    /// The smooth map of the calibration.
    response: OnceLock<Result<Response, FitError>>,
    /// What the Gaussian process sees of a reading, and its correlation.
    process: OnceLock<Result<Likeliest, FitError>>,
    /// The errors of the members of `blend` on held-out presses.
    member_errors: OnceLock<[MemberErrors; 2]>,
}

const PHYSICS: &str = "physics";
const PROCESS: &str = "gaussian-process";
const PATTERN_MAP: &str = "pattern-map";
const BLEND: &str = "blend";

/// The lead over the next method, standard deviations, from which `blend` is worth the work of two.
const WORTH_TWO_SIGMAS: f64 = 2.0;

/// The places a unit from which the correlations of all units can be learned.
const PLACES_A_UNIT: usize = 10;

/// What `physics` may leave unexplained, over what the smooth map leaves: standard deviations, geometric mean of all units.
const UNEXPLAINED: f64 = 1.15;

/// By what factor `physics` must be nearer than the next method to lead although it leaves more unexplained: with very few places no
/// smooth map is any good, and what it leaves unexplained tells nothing.
const FAR_AHEAD: f64 = 3.0;

impl<'a> Prepared<'a> {
    /// A calibration of which units that are dead or saturated are left out.
    ///
    /// # Errors
    /// The layout of another array, or no unit that is left.
    pub fn new(calibration: Calibration, setting: &Setting<'a>) -> Result<Self, FitError> {
        if let Some(layout) = setting.layout.filter(|layout| layout.len() != calibration.units()) {
            return Err(FitError::Layout { layout: layout.len(), calibration: calibration.units() });
        }
        let broken = broken(&calibration);
        Prepared::without(calibration, setting, broken)
    }

    /// The same with the units to leave out.
    pub(super) fn without(
        calibration: Calibration,
        setting: &Setting<'a>,
        broken: Vec<Broken>,
    ) -> Result<Self, FitError> {
        let units = calibration.units();
        let prepared = |calibration, layout, broken| Prepared {
            calibration,
            layout,
            setting: *setting,
            broken,
            units,
            response: OnceLock::new(),
            process: OnceLock::new(),
            member_errors: OnceLock::new(),
        };
        if broken.is_empty() {
            return Ok(prepared(calibration, None, broken));
        }
        let is_kept = |unit: &usize| broken.iter().all(|broken| broken.unit != *unit);
        let kept: Vec<usize> = (0..units).filter(is_kept).collect();
        if kept.is_empty() {
            return Err(FitError::NothingToTellApart);
        }
        let layout = setting.layout.map(|layout| layout.only(&kept));
        Ok(prepared(calibration.of_units(&kept), layout, broken))
    }

    /// The units that are dead or saturated, and left out.
    pub fn broken(&self) -> &[Broken] {
        &self.broken
    }

    /// Fits the method of that name, as [`fit`](super::fit).
    ///
    /// # Errors
    /// No method of that name, or a calibration that it can't be fitted to.
    pub fn fit(&self, name: &str) -> Result<Fitted, FitError> {
        let fitted = self.fit_to_kept(name)?;
        Ok(if self.broken.is_empty() { fitted } else { fitted.without(self.broken.clone(), self.units) })
    }

    fn fit_to_kept(&self, name: &str) -> Result<Fitted, FitError> {
        if name != BEST && !SOLVERS.contains(&name) {
            return Err(FitError::UnknownSolver { name: name.to_owned() });
        }
        let calibration = &self.calibration;
        let fitted = |solver: Box<dyn Solver>| Fitted::new(solver, calibration.units());
        if let Some(forward) = self.forward(name)? {
            let trials = if self.setting.appraised { self.tried(name, 0..FOLDS)? } else { Vec::new() };
            return Ok(fitted(Box::new(forward.taught(&trials, &self.setting))));
        }
        if name != BEST && !self.setting.appraised {
            return Ok(fitted(Box::new(Appraised::unappraised(self.method(name)?))));
        }
        if name != BEST {
            return Ok(fitted(self.appraised(name, &self.tried(name, 0..FOLDS)?)?));
        }
        self.best()
    }

    /// The method that errs least on places that are held out. After the first part of these, methods that are far behind are tried no
    /// further.
    fn best(&self) -> Result<Fitted, FitError> {
        self.response()?;
        let names: Vec<&'static str> = SOLVERS.into_iter().filter(|name| self.is_candidate(name)).collect();
        let mut tried =
            in_parallel(&names, |&solver| Tried { solver, trials: self.tried(solver, 0..1).unwrap_or_default() });
        // a lead that rests on what is assumed of the cover may be one of few places: see below
        let hopeful = best::hopeful(&tried, |tried| tried.solver != PHYSICS);
        let on: Vec<usize> = (0..names.len()).filter(|&method| hopeful[method]).collect();
        let others = in_parallel(&on, |&method| self.tried(names[method], 1..FOLDS));
        for (&method, others) in on.iter().zip(others) {
            match others {
                Ok(others) => tried[method].trials.extend(others),
                Err(_) => tried[method].trials.clear(),
            }
        }
        self.add_blend(&mut tried);
        let mut choice = best::choice(&tried);
        let lead = best::lead_sigmas(&tried, &choice);
        if choice.candidates[0].solver == BLEND && lead.is_some_and(|sigmas| sigmas < WORTH_TWO_SIGMAS) {
            choice.candidates.swap(0, 1);
        }
        let is_far_ahead = choice.candidates[0].solver == PHYSICS && best::lead(&choice) >= FAR_AHEAD;
        if names.contains(&PHYSICS) && !is_far_ahead && !self.is_elastic()? {
            choice.candidates.sort_by_key(|candidate| candidate.solver == PHYSICS);
        }
        let best = choice.candidates.first().filter(|best| best.location_error_mm.is_some());
        let chosen = best.and_then(|best| tried.iter().find(|tried| tried.solver == best.solver)).unwrap_or(&tried[0]);
        let solver = match self.forward(chosen.solver)? {
            Some(forward) => Box::new(forward.taught(&chosen.trials, &self.setting)),
            None => self.appraised(chosen.solver, &chosen.trials)?,
        };
        Ok(Fitted::new(solver, self.calibration.units()).chosen(choice))
    }

    /// Whether a method is one for `best` to choose: what is assumed of the cover needs to know where the units are, and how all units
    /// stray together takes many places a unit to learn.
    fn is_candidate(&self, name: &str) -> bool {
        match name {
            PHYSICS => self.setting().layout.is_some(),
            PATTERN_MAP => self.calibration.by_place().len() >= PLACES_A_UNIT * self.calibration.units(),
            // of what its members come to
            BLEND => false,
            _ => true,
        }
    }

    /// The methods that are blended: a regression and a map.
    fn members(&self) -> [&'static str; 2] {
        [PROCESS, if self.is_candidate(PATTERN_MAP) { PATTERN_MAP } else { "surrogate" }]
    }

    /// Adds `blend` to the methods that were tried, if its members were tried to the end.
    fn add_blend(&self, tried: &mut Vec<Tried>) {
        let most = tried.iter().map(|tried| tried.trials.len()).max().unwrap_or(0);
        let of = |name| tried.iter().find(|tried| tried.solver == name && tried.trials.len() == most);
        let [Some(one), Some(other)] = self.members().map(of) else { return };
        let trials = self.blended([&one.trials, &other.trials]);
        tried.push(Tried { solver: BLEND, trials });
    }

    /// The trials of `blend`, by those of its members, whose errors are then known.
    fn blended(&self, members: [&[HeldPress]; 2]) -> Vec<HeldPress> {
        let errors = self.member_errors.get_or_init(|| members.map(MemberErrors::of));
        Blend::trials(members, errors)
    }

    /// Whether `physics` explains the calibration as well as the smooth map does: what it leaves unexplained is no more than noise. If
    /// not, it is wrong of this skin, and leads only where places are so few that the smooth map suffers more from holding some out.
    fn is_elastic(&self) -> Result<bool, FitError> {
        let Ok(Some(physics)) = self.forward(PHYSICS) else { return Ok(false) };
        let ratios = physics.response().typical_sd().into_iter().zip(self.response()?.typical_sd());
        let logs: Vec<f64> = ratios.map(|(elastic, smooth)| (elastic / smooth).ln()).collect();
        Ok(logs.iter().sum::<f64>() / logs.len() as f64 <= UNEXPLAINED.ln())
    }

    /// A method, tried on some parts of the presses, each held out of its calibration.
    fn tried(&self, name: &str, folds: Range<usize>) -> Result<Vec<HeldPress>, FitError> {
        if name == BLEND {
            let [one, other] = self.members();
            return Ok(self.blended([&self.tried(one, folds.clone())?, &self.tried(other, folds)?]));
        }
        let (setting, response) = (self.setting(), self.response()?);
        let Some(parts) = Folds::of(&self.calibration, &setting, response) else { return Ok(Vec::new()) };
        // found once: a fifth of the presses more or less changes a correlation little, and finding it is most of a fit
        match name {
            PROCESS => {
                let sought = self.process()?;
                parts.trials(folds, |part| Ok(Box::new(GaussianProcess::fit_with(part, setting.load, sought)?)))
            }
            "surrogate" => parts.trials(folds, |part| {
                let response = surrogate_with(part, response.sought.as_ref())?;
                Ok(Box::new(Forward::new("surrogate", response, part, &setting)))
            }),
            _ => parts.trials(folds, |part| method(name, part, &setting, Some(response))),
        }
    }

    /// What the Gaussian process sees of a reading, and its correlation.
    fn process(&self) -> Result<&Likeliest, FitError> {
        let seek = || GaussianProcess::seek(&self.calibration, self.setting.load);
        self.process.get_or_init(seek).as_ref().map_err(Clone::clone)
    }

    fn appraised(&self, name: &str, trials: &[HeldPress]) -> Result<Box<dyn Solver>, FitError> {
        Ok(Box::new(Appraised::new(self.method(name)?, trials, self.response()?, &self.setting())))
    }

    fn method(&self, name: &str) -> Result<Box<dyn Locate>, FitError> {
        match self.forward(name)? {
            Some(forward) => Ok(Box::new(forward)),
            None if name == PROCESS => {
                let process = GaussianProcess::fit_with(&self.calibration, self.setting.load, self.process()?)?;
                Ok(Box::new(process))
            }
            None if name == BLEND => {
                if self.member_errors.get().is_none() {
                    self.tried(BLEND, 0..FOLDS)?;
                }
                let errors = *self.member_errors.get_or_init(|| [MemberErrors::of(&[]); 2]);
                let [one, other] = self.members();
                Ok(Box::new(Blend::new([self.method(one)?, self.method(other)?], errors)))
            }
            None if name == "whitened" => method(name, &self.calibration, &self.setting(), Some(self.response()?)),
            None => method(name, &self.calibration, &self.setting(), None),
        }
    }

    fn forward(&self, name: &str) -> Result<Option<Forward>, FitError> {
        match name {
            "surrogate" => {
                let response = self.response()?.clone();
                Ok(Some(Forward::new("surrogate", response, &self.calibration, &self.setting())))
            }
            name => forward(name, &self.calibration, &self.setting()),
        }
    }

    fn response(&self) -> Result<&Response, FitError> {
        self.response.get_or_init(|| surrogate(&self.calibration)).as_ref().map_err(Clone::clone)
    }

    fn setting(&self) -> Setting<'_> {
        Setting { layout: self.layout.as_ref().or(self.setting.layout), ..self.setting }
    }
}

/// The method of that name, if it is one that inverts a map of the array.
fn forward(name: &str, calibration: &Calibration, setting: &Setting<'_>) -> Result<Option<Forward>, FitError> {
    let (name, response) = match name {
        "surrogate" => ("surrogate", surrogate(calibration)?),
        "physics" => ("physics", physics(calibration, setting.layout)?),
        _ => return Ok(None),
    };
    Ok(Some(Forward::new(name, response, calibration, setting)))
}

/// The method of that name, fitted, without an idea of its errors. A smooth map that is known isn't made again.
fn method(
    name: &str,
    calibration: &Calibration,
    setting: &Setting<'_>,
    response: Option<&Response>,
) -> Result<Box<dyn Locate>, FitError> {
    if let Some(forward) = forward(name, calibration, setting)? {
        return Ok(Box::new(forward));
    }
    Ok(match name {
        "pearson" => Box::new(Pearson::fit(calibration, setting.layout, ForceRule::ClosestUnit)?),
        "pearson-lsq" => Box::new(Pearson::fit(calibration, setting.layout, ForceRule::LeastSquares)?),
        "pearson-knn" => Box::new(PearsonKnn::fit(calibration)?),
        "whitened" => {
            let typical_sd = match response {
                Some(response) => response.typical_sd(),
                None => surrogate(calibration)?.typical_sd(),
            };
            Box::new(Whitened::fit(calibration, &typical_sd)?)
        }
        "gaussian-process" => Box::new(GaussianProcess::fit(calibration, setting.load)?),
        PATTERN_MAP => Box::new(PatternMap::fit(calibration, setting.load)?),
        "extra-trees" => Box::new(ExtraTrees::fit(calibration, setting.load)?),
        _ => return Err(FitError::UnknownSolver { name: name.to_owned() }),
    })
}
