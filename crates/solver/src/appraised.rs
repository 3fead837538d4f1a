//! A method with errors estimated from held-out presses.

use super::heldout::HeldPress;
use super::method::FittedMethod;
use super::noise::{Noise, Residual};
use super::rescaled::Rescaled;
use super::response::ForwardResponse;
use super::threshold::{WEAK_SHARE, chi2_quantile, upper};
use super::widths::{FEWEST_TRIALS, Widths};
use super::{
    ContactVerdict, Covariance, Locate, LocatedContact, Pearson, Setting, Solution, SolveError, Solver, Workspace,
};
use serde::{Deserialize, Serialize};

/// Method that gives only location and force, with its errors on presses held out of its calibration.
#[derive(Serialize, Deserialize)]
pub(super) struct Appraised {
    method: FittedMethod,
    experience: Option<Experience>,
}

/// Errors of a method on presses that weren't in its calibration, as a function of their force F.
#[derive(Serialize, Deserialize)]
struct Experience {
    /// Variance of x and of y, mm^2: a constant part, and a part that grows with 1 / F^2.
    location: Noise,
    /// Variance of the force, N^2: a constant part, and a part that grows with F^2.
    force: Noise,
    /// Mean residue of a fit: a constant part, and a part that grows with 1 / F^2.
    residue: Noise,
    /// Limit of the residue relative to `residue`, which only the fraction of false alarms exceeds.
    most_residue: f64,
    /// Inverse of the variance of each unit's additive noise.
    silence: Vec<f64>,
    /// Sum of squares that readings without contact exceed only at the false-alarm rate.
    no_contact: f64,
    /// Factors by which standard deviations are multiplied to give half-widths.
    widths: Option<Widths>,
}

impl Appraised {
    /// Returns a method with the results of its trials, or without results if there are few trials.
    pub(crate) fn new(
        method: FittedMethod,
        trials: &[HeldPress],
        response: &ForwardResponse,
        setting: &Setting<'_>,
    ) -> Self {
        Appraised { method, experience: Experience::of(trials, response, setting) }
    }

    /// Returns the method if it is the paper's.
    pub(crate) fn pearson(&self) -> Option<&Pearson> {
        match &self.method {
            FittedMethod::Pearson(pearson) => Some(pearson),
            _ => None,
        }
    }

    /// Returns the variance of each unit's additive noise, the limit of a weak signal, and both parts of the largest residue.
    pub(crate) fn silence(&self) -> (Vec<f64>, f64, [f64; 2]) {
        let Some(Experience { silence, no_contact, residue, most_residue, .. }) = &self.experience else {
            return (Vec::new(), 0.0, [f64::INFINITY, 0.0]);
        };
        let parts = residue.parts().map(|part| part[0] * most_residue);
        (silence.iter().map(|precision| 1.0 / precision).collect(), *no_contact, parts)
    }

    /// Largest residue of one contact with a force of 1; infinite if it is unknown.
    pub(crate) fn most_residue(&self) -> f64 {
        self.experience.as_ref().map_or(f64::INFINITY, |known| known.residue.variance(0, 1.0) * known.most_residue)
    }

    /// Multiplies the half-widths and the limit of a misfit.
    pub(crate) fn rescale(&mut self, rescaled: &Rescaled) {
        if let Some(experience) = &mut self.experience {
            experience.widths = experience.widths.map(|widths| widths.rescaled(rescaled));
            experience.most_residue *= rescaled.misfit;
            let [constant, of_softness] = experience.location.parts();
            let constant = constant.iter().map(|variance| variance * rescaled.map_error).collect();
            experience.location = Noise::of_parts(constant, of_softness);
        }
    }

    /// Part of the location's variance that doesn't depend on the force.
    pub(crate) fn of_map(&self, force_n: f64) -> f64 {
        let of = |experience: &Experience| {
            let location = &experience.location;
            location.variance(0, 0.0) / location.variance(0, 1.0 / force_n)
        };
        self.experience.as_ref().map_or(0.0, of)
    }

    /// Returns a method with unknown errors.
    pub(crate) fn unappraised(method: FittedMethod) -> Self {
        Appraised { method, experience: None }
    }
}

impl Solver for Appraised {
    fn name(&self) -> &'static str {
        self.method.name()
    }

    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError> {
        let located = self.method.locate(outputs, workspace)?;
        let mut solution = Solution::plain(located.place, located.force_n, ContactVerdict::Ok);
        if let Some(experience) = &self.experience {
            let softness = 1.0 / located.force_n;
            if softness.is_finite() {
                let (location, force) = experience.variances(&located);
                solution.covariance = Some(Covariance([[location, 0.0, 0.0], [0.0, location, 0.0], [0.0, 0.0, force]]));
                let misfit = located.residue / (experience.residue.variance(0, softness) * experience.most_residue);
                solution.misfit = misfit.is_finite().then_some(misfit);
                let widened = |widths: &Widths| widths.at((2.0 * location).sqrt(), force.sqrt(), 0.0).widened(misfit);
                solution.half_widths = experience.widths.as_ref().map(widened);
            }
            solution.verdict = experience.verdict(outputs, solution.misfit);
        }
        Ok(solution)
    }
}

impl Experience {
    fn of(trials: &[HeldPress], response: &ForwardResponse, setting: &Setting<'_>) -> Option<Self> {
        let (mut location, mut force, mut residue) = (Vec::new(), Vec::new(), Vec::new());
        let answered = || trials.iter().filter_map(|trial| Some((trial, trial.answer.as_ref().ok()?)));
        for (trial, answer) in answered() {
            let of = |predicted, residual| Residual { predicted, residual, leverage: 0.0 };
            location.push(of(1.0 / trial.force_n, (answer.place.x_mm - trial.place.x_mm) / answer.scale_mm));
            location.push(of(1.0 / trial.force_n, (answer.place.y_mm - trial.place.y_mm) / answer.scale_mm));
            force.push(of(trial.force_n, (answer.force_n - trial.force_n) / answer.scale_n));
            residue.push(of(1.0 / trial.force_n, answer.residue.sqrt()));
        }
        if force.len() < FEWEST_TRIALS {
            return None;
        }
        let residue = Noise::fit(&[residue]);
        let over = answered().map(|(_, answer)| answer.residue / residue.variance(0, 1.0 / answer.force_n)).collect();
        let most_residue = upper(over, setting.excluded_share())?.max(f64::MIN_POSITIVE);
        let quietest = upper(trials.iter().map(|trial| -trial.loudness).collect(), WEAK_SHARE * setting.false_alarms)?;
        let units = response.field.channels();
        let experience = Experience {
            location: Noise::fit(&[location]),
            force: Noise::fit(&[force]),
            residue,
            most_residue,
            silence: (0..units).map(|unit| 1.0 / response.noise.variance(unit, 0.0)).collect(),
            no_contact: chi2_quantile(units, setting.false_alarms).min(-quietest),
            widths: None,
        };
        let widths = Widths::of(trials, |trial| {
            let answer = trial.answer.as_ref().ok()?;
            let (location, force) = experience.variances(answer);
            Some(((2.0 * location).sqrt(), force.sqrt(), 0.0))
        });
        Some(Experience { widths, ..experience })
    }

    /// Variances of x and of y, mm^2, and of the force, N^2.
    fn variances(&self, located: &LocatedContact) -> (f64, f64) {
        let location = located.scale_mm.powi(2) * self.location.variance(0, 1.0 / located.force_n);
        (location, located.scale_n.powi(2) * self.force.variance(0, located.force_n))
    }

    fn verdict(&self, outputs: &[f64], misfit: Option<f64>) -> ContactVerdict {
        let loudness: f64 =
            outputs.iter().zip(&self.silence).map(|(output, precision)| output * output * precision).sum();
        if loudness < self.no_contact {
            ContactVerdict::WeakSignal
        } else if misfit.is_some_and(|misfit| misfit > 1.0) {
            ContactVerdict::NotOneContact
        } else {
            ContactVerdict::Ok
        }
    }
}
