//! A calibration made ready to fit any number of methods to: what several of them need is found once.

use super::appraised::Appraised;
use super::broken::broken;
use super::extra_trees::ExtraTrees;
use super::forward::Forward;
use super::gaussian_process::GaussianProcess;
use super::heldout::{self, HeldPress};
use super::pattern_map::PatternMap;
use super::physics::physics;
use super::response::Response;
use super::surrogate::surrogate;
use super::{
    BEST, Broken, Calibration, FitError, Fitted, ForceRule, Locate, Pearson, PearsonKnn, SOLVERS, Setting, Solver,
    Whitened, best,
};
use crate::parallel::in_parallel;
use crate::quantity::ArrayLayout;
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
}

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
        let (setting, response) = (*setting, OnceLock::new());
        if broken.is_empty() {
            return Ok(Prepared { calibration, layout: None, setting, broken, units, response });
        }
        let is_kept = |unit: &usize| broken.iter().all(|broken| broken.unit != *unit);
        let kept: Vec<usize> = (0..units).filter(is_kept).collect();
        if kept.is_empty() {
            return Err(FitError::NothingToTellApart);
        }
        let layout = setting.layout.map(|layout| layout.only(&kept));
        Ok(Prepared { calibration: calibration.of_units(&kept), layout, setting, broken, units, response })
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
            return Ok(fitted(Box::new(forward)));
        }
        if name != BEST && !self.setting.appraised {
            return Ok(fitted(Box::new(Appraised::unappraised(self.method(name)?))));
        }
        if name != BEST {
            return Ok(fitted(self.appraised(name, &self.tried(name)?)?));
        }
        self.response()?;
        let trials = in_parallel(&SOLVERS, |name| self.tried(name).unwrap_or_default());
        let candidates = SOLVERS.iter().zip(&trials).map(|(name, trials)| best::candidate(name, trials));
        let choice = best::choice(candidates.collect());
        let best = choice.candidates.first().filter(|best| best.location_error_mm.is_some());
        let chosen = SOLVERS.iter().position(|name| best.is_some_and(|best| best.solver == *name)).unwrap_or(0);
        let solver = match self.forward(SOLVERS[chosen])? {
            Some(forward) => Box::new(forward),
            None => self.appraised(SOLVERS[chosen], &trials[chosen])?,
        };
        Ok(fitted(solver).chosen(choice))
    }

    /// A method, tried on presses that are held out of its calibration.
    fn tried(&self, name: &str) -> Result<Vec<HeldPress>, FitError> {
        let setting = self.setting();
        // found once: a fifth of the presses more or less changes a correlation little, and finding it is most of a fit
        let sought =
            (name == "gaussian-process").then(|| GaussianProcess::seek(&self.calibration, setting.load)).transpose()?;
        heldout::trials(&self.calibration, &setting, self.response()?, |part| match &sought {
            Some(sought) => Ok(Box::new(GaussianProcess::fit_with(part, setting.load, sought)?)),
            None => method(name, part, &setting, Some(self.response()?)),
        })
    }

    fn appraised(&self, name: &str, trials: &[HeldPress]) -> Result<Box<dyn Solver>, FitError> {
        Ok(Box::new(Appraised::new(self.method(name)?, trials, self.response()?, &self.setting())))
    }

    fn method(&self, name: &str) -> Result<Box<dyn Locate>, FitError> {
        match self.forward(name)? {
            Some(forward) => Ok(Box::new(forward)),
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
        "pattern-map" => Box::new(PatternMap::fit(calibration, setting.load)?),
        "extra-trees" => Box::new(ExtraTrees::fit(calibration, setting.load)?),
        _ => return Err(FitError::UnknownSolver { name: name.to_owned() }),
    })
}
