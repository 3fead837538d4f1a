//! A Gaussian process from outputs to the place.

use super::correlation::Smoothness;
use super::hyperparameters::{Hyperparameters, Regression};
use super::kriging::Kriging;
use super::process::{self, Process};
use super::view::View;
use super::{Calibration, FitError, ForceKnown, Locate, LocatedContact, SolveError, Workspace};
use palpate_core::quantity::{Place, stream};
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Standard regression for comparison: a Gaussian process directly from readings to places and forces.
///
/// Its coordinates are the reading scaled to length 1, so the force has no effect. If the calibration has several forces, or the
/// load is constant, the amplitude may be used. Then the most likely of several [views](View) of a reading is used. The process
/// makes no assumption about how the pattern moves with the contact. So it is suitable for skins whose pattern changes with
/// depth.
#[derive(Serialize, Deserialize)]
pub(super) struct GaussianProcess {
    process: Process,
    /// Logarithm of the error of the process on held-out presses, as a function of the reading.
    spread: Process,
    view: View,
    load: ForceKnown,
    /// Force of the calibration if the load is constant, N.
    force_n: f64,
}

/// Number of answers of the process: x, y, and the logarithm of the force divided by a quantity proportional to the reading.
const ANSWERS: usize = 3;

/// Number of answers that are coordinates of the place.
const COORDINATES: usize = 2;

/// Regression of the process. The correlation is decisive, so it is searched for with most of the available places.
pub(super) const MANNER: Regression =
    Regression { about_mean: true, most_to_seek_with: MOST_TO_SEEK_WITH, of: &Smoothness::ALL };
const MOST_TO_SEEK_WITH: usize = 320;

/// Regression with which views are compared: one smoothness only.
const OF_VIEWS: Regression = Regression { of: &[Smoothness::Smooth], ..MANNER };

/// Largest number of coordinates that are stretched separately.
const MOST_STRETCHED: usize = 32;

/// Largest number of presses from which principal components are found.
const MOST_FOR_COMPONENTS: usize = 1000;

/// Least number of places from which stretches can be determined.
const FEWEST_TO_STRETCH: usize = 50;

/// Steps of a stretch's logarithm, one for each round.
const STRETCHES: [f64; 6] = [0.5, 0.5, 0.5, 0.25, 0.25, 0.25];

/// Expected standard deviation of the stretches' logarithms.
const STRETCHED_ALIKE: f64 = 0.5;

/// Largest number of presses in the regression. If there are more, some are chosen at random. The cost grows with the cube of
/// this number.
const MOST_PRESSES: usize = 2000;

/// Least error that counts, as a fraction of the mean error. One press may be right by chance.
const LEAST_ERROR: f64 = 0.1;

/// View and correlation that make a calibration most likely.
pub(super) type Likeliest = (View, Hyperparameters);

impl GaussianProcess {
    /// Returns the view and the correlation with the largest likelihood for a calibration.
    pub(crate) fn seek(calibration: &Calibration, load: ForceKnown) -> Result<Likeliest, FitError> {
        let mut views = View::suitable(calibration, load);
        let hyperparameters = |view: &View, manner| {
            let Seen { inputs, answers } = Seen::of(calibration, view, MOST_TO_SEEK_WITH)?;
            Some(Hyperparameters::of(&inputs, view.dimensions(), &answers, ANSWERS, manner))
        };
        if views.len() > 1 {
            let likelihood = |view: &View| {
                hyperparameters(view, OF_VIEWS).map_or(f64::NEG_INFINITY, |hyperparameters| hyperparameters.likelihood)
            };
            let likelihoods: Vec<f64> = views.iter().map(likelihood).collect();
            let best = (1..views.len()).fold(0, |best, i| if likelihoods[i] > likelihoods[best] { i } else { best });
            views.swap(0, best);
        }
        let mut view = views.swap_remove(0);
        let mut hyperparameters = hyperparameters(&view, MANNER).ok_or(FitError::NothingToTellApart)?;
        if view.dimensions() <= MOST_STRETCHED {
            stretch(calibration, &mut view, &mut hyperparameters);
        } else if let Some(components) = components(calibration, &view, &hyperparameters) {
            return Ok(components);
        }
        Ok((view, hyperparameters))
    }

    /// Fits a calibration with a known view and a known correlation.
    pub(crate) fn fit_with(
        calibration: &Calibration,
        load: ForceKnown,
        likeliest: &Likeliest,
    ) -> Result<Self, FitError> {
        let (view, hyperparameters) = likeliest;
        let dimensions = view.dimensions();
        let seen = Seen::of(calibration, view, MOST_PRESSES).ok_or(FitError::NothingToTellApart)?;
        let Seen { inputs, answers } = seen;
        let few = (inputs.len() / dimensions).min(MOST_TO_SEEK_WITH);
        let few_inputs = inputs[..few * dimensions].to_vec();
        let (process, held_out) = Process::fit(inputs, dimensions, &answers, ANSWERS, hyperparameters, COORDINATES);
        let errors: Vec<f64> = held_out.chunks_exact(COORDINATES).map(|error| error[0].hypot(error[1])).collect();
        let least = (LEAST_ERROR * errors.iter().sum::<f64>() / errors.len() as f64).max(f64::MIN_POSITIVE);
        let log_errors: Vec<f64> = errors[..few].iter().map(|error| error.max(least).ln()).collect();
        let spread = Kriging::fit_with(&few_inputs, dimensions, &log_errors, 1, MANNER, hyperparameters).into_process();
        let (view, force_n) = (view.clone(), calibration.typical_force_n());
        Ok(GaussianProcess { process, spread, view, load, force_n })
    }
}

/// Returns the view of the principal components of a view with many coordinates, if the places are more likely with it.
fn components(calibration: &Calibration, view: &View, hyperparameters: &Hyperparameters) -> Option<Likeliest> {
    let Seen { inputs, .. } = Seen::of(calibration, view, MOST_FOR_COMPONENTS)?;
    let mut components = view.components(&inputs, MOST_STRETCHED)?;
    let Seen { inputs, answers } = Seen::of(calibration, &components, MOST_TO_SEEK_WITH)?;
    let mut of_components = Hyperparameters::of(&inputs, components.dimensions(), &answers, ANSWERS, MANNER);
    let likelihood = stretch(calibration, &mut components, &mut of_components)?;
    let before = one_press_a_place(calibration, view).and_then(|seen| {
        let ratio = ratio_of_place(hyperparameters).exp();
        process::likelihood(
            &seen.inputs,
            view.dimensions(),
            &seen.places(),
            COORDINATES,
            hyperparameters.correlation,
            ratio,
        )
    });
    (likelihood > before.unwrap_or(f64::NEG_INFINITY)).then_some((components, of_components))
}

/// Returns the calibration in a view, of several presses at a place only one: they are easy to explain by each other, without regard
/// to what is between the places. `None` if there are few places.
fn one_press_a_place(calibration: &Calibration, view: &View) -> Option<Seen> {
    let few = calibration.by_place().len().min(MOST_TO_SEEK_WITH);
    Seen::of(calibration, view, few).filter(|_| few >= FEWEST_TO_STRETCH)
}

/// Mean logarithm of the noise ratios of the place's coordinates.
fn ratio_of_place(hyperparameters: &Hyperparameters) -> f64 {
    hyperparameters.noise_ratio[..COORDINATES].iter().map(|ratio| ratio.ln()).sum::<f64>() / COORDINATES as f64
}

/// Stretches each coordinate of the view, and changes the noise of the place, as long as the places become more likely. Returns the
/// logarithm of their likelihood; `None` if there are few places.
fn stretch(calibration: &Calibration, view: &mut View, hyperparameters: &mut Hyperparameters) -> Option<f64> {
    let seen = one_press_a_place(calibration, view)?;
    let (dimensions, places, inputs) = (view.dimensions(), seen.places(), seen.inputs);
    // logarithms: of the stretch of each coordinate, of the noise ratio, of the stretch of all coordinates
    let mut chosen = vec![0.0; dimensions + 2];
    let ratio = ratio_of_place(hyperparameters);
    let mut stretched = inputs.clone();
    let mut likelihood = |logs: &[f64]| {
        let (each, common) = logs.split_at(dimensions);
        let factors: Vec<f64> = each.iter().map(|log| (log + common[1]).exp()).collect();
        for (row, known) in stretched.chunks_exact_mut(dimensions).zip(inputs.chunks_exact(dimensions)) {
            row.iter_mut().zip(known).zip(&factors).for_each(|((value, known), factor)| *value = known * factor);
        }
        let ratio = (ratio + common[0]).exp();
        let likelihood =
            process::likelihood(&stretched, dimensions, &places, COORDINATES, hyperparameters.correlation, ratio);
        let unlike: f64 = each.iter().map(|log| (log / STRETCHED_ALIKE).powi(2)).sum();
        likelihood.map_or(f64::NEG_INFINITY, |likelihood| likelihood - 0.5 * unlike)
    };
    let mut best = likelihood(&chosen);
    for step in STRETCHES {
        for coordinate in (0..chosen.len()).rev() {
            for sign in [1.0, -1.0] {
                let before = chosen[coordinate];
                chosen[coordinate] += sign * step;
                let found = likelihood(&chosen);
                if found > best {
                    best = found;
                    break;
                }
                chosen[coordinate] = before;
            }
        }
    }
    hyperparameters.noise_ratio[..COORDINATES].fill((ratio + chosen[dimensions]).exp());
    view.stretch(chosen[..dimensions].iter().map(|log| (log + chosen[dimensions + 1]).exp()));
    Some(best)
}

/// Calibration as the process sees it.
struct Seen {
    /// Inputs, row-major, presses x dimensions.
    inputs: Vec<f64>,
    /// Answers, row-major, presses x `ANSWERS`.
    answers: Vec<f64>,
}

impl Seen {
    /// Coordinates of the places, row-major, presses x `COORDINATES`.
    fn places(&self) -> Vec<f64> {
        self.answers.chunks_exact(ANSWERS).flat_map(|answer| &answer[..COORDINATES]).copied().collect()
    }

    /// Returns the calibration in a view. Of very many presses it uses some, in random order. `None` if no press has a reading.
    fn of(calibration: &Calibration, view: &View, most: usize) -> Option<Self> {
        let presses = places_in_turn(calibration);
        let (mut inputs, mut answers) = (Vec::new(), Vec::new());
        for point in presses.into_iter().map(|press| calibration.point(press)) {
            let length = view.length(point.outputs);
            if length > 0.0 && answers.len() < most * ANSWERS {
                view.see(point.outputs, length, &mut inputs);
                let log_force = point.force_n.ln() - view.log_proportional(length);
                answers.extend([point.place.x_mm, point.place.y_mm, log_force]);
            }
        }
        (!inputs.is_empty()).then_some(Seen { inputs, answers })
    }
}

/// Returns the presses of a calibration in random order: first one press of each place, then a second press of each place that
/// has two, and so on.
pub(super) fn places_in_turn(calibration: &Calibration) -> Vec<usize> {
    let mut rng = stream(0, 0, "regressed presses");
    let mut shuffle = |list: &mut [usize]| {
        for first in 0..list.len() {
            let other = first + (rng.next_u64() % (list.len() - first) as u64) as usize;
            list.swap(first, other);
        }
    };
    let mut presses: Vec<usize> = (0..calibration.len()).collect();
    shuffle(&mut presses);
    let mut turn = vec![0; calibration.len()];
    for mut spot in calibration.by_place() {
        shuffle(&mut spot);
        spot.into_iter().enumerate().for_each(|(index, press)| turn[press] = index);
    }
    presses.sort_by_key(|&press| turn[press]);
    presses
}

impl Locate for GaussianProcess {
    fn name(&self) -> &'static str {
        "gaussian-process"
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<LocatedContact, SolveError> {
        let length = self.view.length(outputs);
        if length == 0.0 {
            return Err(SolveError::AllEqual);
        }
        workspace.row.clear();
        self.view.see(outputs, length, &mut workspace.row);
        let mut answer = [0.0; ANSWERS];
        let nearest = self.process.predict(&workspace.row, &mut answer);
        let mut log_error = [0.0];
        self.spread.predict(&workspace.row, &mut log_error);
        let force_n = self.load.force_n(self.force_n, answer[2] + self.view.log_proportional(length))?;
        let (place, residue, scale_mm) = (Place::new(answer[0], answer[1]), nearest * nearest, log_error[0].exp());
        Ok(LocatedContact { place, force_n, residue, scale_mm, ..LocatedContact::PLAIN })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CalibrationPoint;

    /// Two units that continue reading less and less of more force.
    fn outputs(x_mm: f64, force_n: f64) -> [f64; 2] {
        [1.0 - x_mm, 1.0 + x_mm].map(|near| (0.5 * near * force_n).tanh())
    }

    fn fitted(calibration: &Calibration, load: ForceKnown) -> GaussianProcess {
        let likeliest = GaussianProcess::seek(calibration, load).unwrap();
        GaussianProcess::fit_with(calibration, load, &likeliest).unwrap()
    }

    #[test]
    fn outputs_of_several_forces_need_not_be_proportional() {
        let presses: Vec<(f64, f64, [f64; 2])> = (0..11)
            .flat_map(|i| [0.25, 0.5, 1.0, 1.5, 2.0].map(|force_n| (-0.5 + 0.1 * f64::from(i), force_n)))
            .map(|(x_mm, force_n)| (x_mm, force_n, outputs(x_mm, force_n)))
            .collect();
        let point = |(x_mm, force_n, outputs)| CalibrationPoint { place: Place::new(x_mm, 0.0), force_n, outputs };
        let points: Vec<_> = presses.iter().map(|(x_mm, force_n, outputs)| point((*x_mm, *force_n, outputs))).collect();
        let process = fitted(&Calibration::new(&points).unwrap(), ForceKnown::Unknown);
        assert!(process.view.dimensions() > 2 || process.view.log_proportional(2.0) == 0.0, "the amplitude must count");
        let located = process.locate(&outputs(0.13, 1.7), &mut Workspace::default()).unwrap();
        assert!((located.place.x_mm - 0.13).abs() < 0.02 && (located.force_n - 1.7).abs() < 0.05, "{located:?}");
    }

    #[test]
    fn amplitude_locates_contacts_under_a_constant_load() {
        let rows: Vec<[f64; 1]> = (0..11).map(|i| [1.0 + 0.1 * f64::from(i)]).collect();
        let point = |(i, outputs)| CalibrationPoint { place: Place::new(i as f64, 0.0), force_n: 1.0, outputs };
        let points: Vec<_> = rows.iter().map(|row| row.as_slice()).enumerate().map(point).collect();
        let calibration = Calibration::new(&points).unwrap();
        let process = fitted(&calibration, ForceKnown::Constant);
        let located = process.locate(&[1.45], &mut Workspace::default()).unwrap();
        assert!((located.place.x_mm - 4.5).abs() < 0.1 && located.force_n == 1.0, "{located:?}");
    }
}
