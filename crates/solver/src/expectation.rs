//! What a reading should be by its model, with some of its outputs left out.

use super::fitted::Answering;
use super::forward::Forward;
use super::nearest::{ComparedReading, NearestPresses};
use super::{Model, Workspace};
use palpate_core::parallel::lock;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, OnceLock};

/// What a model predicts of a reading, from the outputs that count.
pub(super) struct Prediction {
    /// Logarithm of the misfit of the outputs that count.
    pub log_misfit: f64,
    /// Predicted outputs, also of the units that don't count.
    pub outputs: Vec<f64>,
    /// Standard deviation of each output from its prediction.
    pub sd: Vec<f64>,
    /// Standard deviation of each output without a contact.
    pub quiet_sd: Vec<f64>,
}

/// Least output that a unit should have felt, in standard deviations without a contact.
const FELT_SD: f64 = 3.0;

impl Prediction {
    /// Whether a unit felt the contact, or should have felt it.
    pub(crate) fn is_felt(&self, unit: usize, output: f64) -> bool {
        self.outputs[unit].abs().max(output.abs()) > FELT_SD * self.quiet_sd[unit]
    }
}

/// Readings of good contacts, by the map that the model inverts. A method without such a map is represented by its presses. Units are
/// those that the model uses, in its order.
pub(super) struct Expectation {
    model: Arc<Model>,
    presses: Option<NearestPresses>,
    /// The presses of a model with a map.
    beside_map: OnceLock<Option<NearestPresses>>,
    /// Typical size of each output.
    scales: Vec<f64>,
    /// Misfits of held-out presses, without these units; the last ones that were needed.
    held_out: Mutex<VecDeque<(Vec<usize>, Arc<HeldOutMisfits>)>>,
}

/// A contact, prepared for its comparison with what is expected without some units.
pub(super) enum ExpectedContact {
    /// Compared with the presses.
    Presses(ComparedReading),
    /// The outputs, for a map.
    Map(Vec<f64>),
}

/// Misfits of good contacts.
#[derive(Clone, Copy)]
pub(super) struct UsualMisfit {
    /// Median of the logarithm.
    typical: Option<f64>,
    /// Mean and standard deviation of the logarithm as it is compared.
    mean: f64,
    pub sd: f64,
    /// Standard deviation of its decrease, compared with the misfit of more units.
    pub gain_sd: f64,
}

/// Distance from which two readings of length 1 aren't alike.
const ALIKE: f32 = 0.1;
/// Misfits of held-out presses.
struct HeldOutMisfits {
    /// Median of their logarithms.
    typical: f64,
    relative: Vec<f64>,
}

impl UsualMisfit {
    /// Returns the logarithm of a misfit, compared with those of good contacts, whose mean is 0 then.
    pub(crate) fn compared(&self, log_misfit: f64) -> f64 {
        self.typical.map_or(log_misfit, |typical| relative(log_misfit, typical)) - self.mean
    }
}

/// Returns the logarithm of 1 plus a misfit divided by a typical one, because how small a misfit is shows nothing.
fn relative(log_misfit: f64, typical: f64) -> f64 {
    (log_misfit - typical).exp().ln_1p()
}

/// Largest number of sets of units whose held-out misfits are kept: more than the 45 sets of nine units, and than a search needs.
pub(super) const MOST_SETS: usize = 200;

impl Expectation {
    /// Returns the expectation of a model; `None` if it has neither a map nor presses.
    pub(crate) fn of(model: Arc<Model>) -> Option<Self> {
        let presses = match map_of(&model) {
            Some(_) => None,
            None => Some(nearest_presses(&model)?),
        };
        let scales = match (&presses, map_of(&model)) {
            (None, Some(map)) => map.loudest.clone(),
            (presses, _) => presses.as_ref()?.sizes(),
        };
        let scales = scales.into_iter().map(|scale| scale.max(f64::MIN_POSITIVE)).collect();
        Some(Expectation { model, presses, beside_map: OnceLock::new(), scales, held_out: Mutex::default() })
    }

    /// Prepares a contact for predictions.
    pub(crate) fn contact(&self, outputs: Vec<f64>) -> ExpectedContact {
        match &self.presses {
            Some(presses) => ExpectedContact::Presses(presses.compare(outputs)),
            None => ExpectedContact::Map(outputs),
        }
    }

    /// Returns what the model predicts of a contact, of which some units don't count. `None` if nothing explains any of it.
    pub(crate) fn predict(
        &self,
        contact: &ExpectedContact,
        without: &[usize],
        workspace: &mut Workspace,
    ) -> Option<Prediction> {
        match contact {
            ExpectedContact::Presses(reading) => Some(self.presses.as_ref()?.predict(reading, without)),
            ExpectedContact::Map(outputs) => map_of(&self.model)?.predict(outputs, without, workspace),
        }
        .filter(|prediction| prediction.log_misfit.is_finite())
    }

    /// Whether two readings in typical sizes are nearly the same without some units, as those of contacts at one place are. Their sizes
    /// count only if the model is one of several loads.
    pub(crate) fn is_alike(&self, one: &[f32], other: &[f32], without: &[usize]) -> bool {
        if !self.presses.as_ref().is_none_or(NearestPresses::is_scaled) {
            return is_near(one, other, without);
        }
        let [one_square, other_square, between] = products(one, other, without);
        let lengths = (one_square * other_square).sqrt();
        // the square of the distance of two directions is twice 1 minus their cosine
        2.0 * (lengths - between) < ALIKE * ALIKE * lengths
    }

    /// Returns the misfits of good contacts without some units, compared with those without fewer units.
    pub(crate) fn usual(&self, without: &[usize], fewer: &[usize]) -> UsualMisfit {
        let Some(presses) = &self.presses else {
            let free = self.model.fitted().kept().len().saturating_sub(without.len() + 3).max(1) as f64;
            let (sd, fewer) = ((2.0 / free).sqrt(), without.len().abs_diff(fewer.len()));
            return UsualMisfit { typical: None, mean: 0.0, sd, gain_sd: fewer as f64 * sd / free.sqrt() };
        };
        let [misfits, others] = [without, fewer].map(|units| self.held_out(presses, units));
        let (mean, sd) = mean_and_sd(misfits.relative.iter().copied());
        let (_, gain_sd) =
            mean_and_sd(others.relative.iter().zip(&misfits.relative).map(|(other, misfit)| other - misfit));
        UsualMisfit { typical: Some(misfits.typical), mean, sd, gain_sd }
    }

    /// Returns an output in units of the unit's typical size. Outputs that read the same are the same then.
    pub(crate) fn scaled(&self, unit: usize, output: f64) -> f32 {
        (output / self.scales[unit]) as f32
    }

    /// Probability that a unit that works reads a scaled output again in another contact that it feels; `None` if no presses
    /// show it, or if they repeat it.
    pub(crate) fn repeats(&self, unit: usize, scaled: f32) -> Option<f64> {
        let beside_map = || self.beside_map.get_or_init(|| nearest_presses(&self.model)).as_ref();
        let presses = self.presses.as_ref().or_else(beside_map)?;
        presses.repeats(unit, |output| self.scaled(unit, output) == scaled)
    }

    /// Number of held-out presses that show the usual misfits.
    pub(crate) fn held_out_count(&self) -> usize {
        self.presses.as_ref().map_or(0, NearestPresses::held_count)
    }

    fn held_out(&self, presses: &NearestPresses, without: &[usize]) -> Arc<HeldOutMisfits> {
        if let Some((_, known)) = lock(&self.held_out).iter().find(|(units, _)| units == without) {
            return known.clone();
        }
        let mut misfits = presses.held_out(without);
        let middle = misfits.len() / 2;
        let typical = *misfits.clone().select_nth_unstable_by(middle, f64::total_cmp).1;
        misfits.iter_mut().for_each(|misfit| *misfit = relative(*misfit, typical));
        let found = Arc::new(HeldOutMisfits { typical, relative: misfits });
        let mut held_out = lock(&self.held_out);
        if held_out.len() >= MOST_SETS {
            held_out.pop_front();
        }
        held_out.push_back((without.to_vec(), found.clone()));
        found
    }
}

impl ExpectedContact {
    /// Outputs of the units that the model uses.
    pub(crate) fn outputs(&self) -> &[f64] {
        match self {
            ExpectedContact::Presses(reading) => &reading.outputs,
            ExpectedContact::Map(outputs) => outputs,
        }
    }
}

/// Whether two readings in typical sizes are nearly the same without some units, also in size.
pub(super) fn is_near(one: &[f32], other: &[f32], without: &[usize]) -> bool {
    let [one_square, other_square, between] = products(one, other, without);
    one_square + other_square - 2.0 * between < ALIKE * ALIKE * one_square.max(other_square)
}

/// Returns the squares of two readings without some units, and their product.
fn products(one: &[f32], other: &[f32], without: &[usize]) -> [f32; 3] {
    let product = |a: &[f32], b: &[f32]| {
        a.iter().zip(b).enumerate().filter(|(unit, _)| !without.contains(unit)).map(|(_, (a, b))| a * b).sum()
    };
    [product(one, one), product(other, other), product(one, other)]
}

fn nearest_presses(model: &Model) -> Option<NearestPresses> {
    let calibration = model.calibration()?.of_units(&model.fitted().kept());
    NearestPresses::of(&calibration, model.setting().load, still(model.fitted().answering()))
}

/// Variance of each output without a contact; `None` if the method doesn't know it.
fn still(answering: &Answering) -> Option<Vec<f64>> {
    match answering {
        Answering::ByLoad(by_load) => still(&by_load.any),
        Answering::Appraised(appraised) => Some(appraised.silence().0).filter(|still| !still.is_empty()),
        Answering::Forward(forward) => {
            let units = forward.response.field.channels();
            Some((0..units).map(|unit| forward.response.noise.variance(unit, 0.0)).collect())
        }
    }
}

fn map_of(model: &Model) -> Option<&Forward> {
    let answering = match model.fitted().answering() {
        Answering::ByLoad(by_load) => &by_load.any,
        other => other,
    };
    match answering {
        Answering::Forward(forward) => Some(forward),
        Answering::Appraised(_) | Answering::ByLoad(_) => None,
    }
}

/// Returns the mean and the standard deviation of some numbers.
pub(super) fn mean_and_sd(numbers: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = numbers.clone().count().max(1) as f64;
    let mean = numbers.clone().sum::<f64>() / count;
    (mean, (numbers.map(|number| (number - mean).powi(2)).sum::<f64>() / count).sqrt())
}
