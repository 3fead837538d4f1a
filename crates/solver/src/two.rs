//! Two contacts at once: two loads whose outputs add up.
//!
//! A coarse search tries all pairs of a grid with forces that aren't negative, and damped Gauss-Newton steps refine the best pairs. Two
//! contacts are reported if they explain a reading so much better than one that a single contact seldom would.

use crate::SolveError;
use crate::evaluation::{FORCE_REFERENCE_N, LOCATION_REFERENCE_MM};
use crate::normal::{NormalEquations, inverse};
use crate::threshold::upper;
use crate::vector::{AxisBuffers, PRESS, ShearPrior, VectorFit, VectorMap, VectorWorkspace};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::Place;
use statrs::distribution::{ContinuousCDF, Gamma};
use std::sync::Arc;

/// Solver for one or two contacts without shear, on the map of a calibration.
#[derive(Clone, Debug)]
pub struct TwoContacts {
    map: Arc<VectorMap>,
    /// Products of the directions of all pairs of the grid's places.
    products: Vec<f32>,
    /// Gain above which two contacts are reported.
    pub(crate) gain_most: f64,
}

/// Number of contacts, and the contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ContactCount {
    /// One contact explains the reading as well.
    One {
        /// Place, specimen frame, mm.
        place: Place,
        /// Force, N.
        force_n: f64,
    },
    /// Two contacts.
    Two(Pair),
    /// Not one contact. If there are two, the outputs hardly show where: the best pair may be off by more than 1 mm or 0.1 N.
    TwoNotSeparable(Pair),
}

/// Two contacts with their expected errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Places, specimen frame, mm.
    pub places: [Place; 2],
    /// Forces, N.
    pub forces_n: [f64; 2],
    /// Root mean square of the error of each place, mm; infinite if it is unknown.
    pub errors_mm: [f64; 2],
    /// Standard deviation of each force, N.
    pub errors_n: [f64; 2],
    /// Weighted sum of squares of reading minus contacts.
    pub chi2: f64,
}

/// Largest expected errors of contacts that are separable: 19 of 20 places are then within 1 mm, and 19 of 20 forces within 0.1 N. A
/// place with a root mean square of r is farther off than d with a probability of exp(-d^2 / r^2).
const SEPARABLE_MM: f64 = 0.578 * LOCATION_REFERENCE_MM;
const SEPARABLE_N: f64 = 0.510 * FORCE_REFERENCE_N;
/// Fraction of the accepted false alarms that the limit may cause among the single contacts from which it is learned.
const OF_FALSE_ALARMS: f64 = 0.5;
/// Number of these contacts.
const SINGLE_CONTACTS: usize = 1000;
/// Largest number of pairs that are refined, and the distance of both places from a better pair within which a pair isn't tried, mm.
const MOST_PAIRS: usize = 6;
const SAME_PAIR_MM: f64 = 1.5;
/// Largest number of steps, first damping and its factor, and the expected gain at which a refinement ends.
const MOST_STEPS: usize = 30;
const FIRST_DAMPING: f64 = 1e-2;
const DAMPING_FACTOR: f64 = 4.0;
const LAST_GAIN: f64 = 1e-3;

impl TwoContacts {
    /// Prepares the search, and learns the limit of a single contact from presses of the calibration that their map didn't know.
    pub fn new(map: impl Into<Arc<VectorMap>>) -> Self {
        let mut two = TwoContacts::limited(map.into(), f64::INFINITY);
        let gain = |outputs: &Vec<f64>| Some(two.gain(outputs, &mut VectorWorkspace::default())?.2);
        let gains = in_parallel(&two.map.single_contacts(SINGLE_CONTACTS), gain);
        two.gain_most = limit(gains.into_iter().flatten().collect(), two.map.false_alarms);
        two
    }

    /// Prepares the search with a known limit.
    pub(crate) fn limited(map: Arc<VectorMap>, gain_most: f64) -> Self {
        let places = map.coarse.places.len();
        let mut products = vec![0.0; places * places];
        for row in map.coarse.bases.chunks_exact(3 * places) {
            for (one, products) in row[..places].iter().zip(products.chunks_exact_mut(places)) {
                products.iter_mut().zip(row).for_each(|(product, other)| *product += one * other);
            }
        }
        TwoContacts { map, products, gain_most }
    }

    /// Returns the contacts that caused one reading.
    ///
    /// # Errors
    /// The reading has another number of outputs, a number isn't finite, or no press explains any of it.
    pub fn solve(&self, outputs: &[f64], workspace: &mut VectorWorkspace) -> Result<ContactCount, SolveError> {
        self.map.check(outputs)?;
        let (one, pair, gain) = self.gain(outputs, workspace).ok_or(SolveError::AllEqual)?;
        Ok(match pair.filter(|_| gain > self.gain_most) {
            None => ContactCount::One { place: one.place, force_n: one.force_n[PRESS] },
            Some(pair) if pair.is_separable() => ContactCount::Two(pair),
            Some(pair) => ContactCount::TwoNotSeparable(pair),
        })
    }

    /// Returns the best single contact and the best pair, and how much better the pair is.
    pub(crate) fn gain(&self, outputs: &[f64], w: &mut VectorWorkspace) -> Option<(VectorFit, Option<Pair>, f64)> {
        let one = self.map.best(outputs, ShearPrior::Zero, 0..0, w)?;
        let pair = self.best(outputs, w);
        Some((one, pair, pair.map_or(0.0, |pair| one.chi2 - pair.chi2)))
    }

    fn best(&self, outputs: &[f64], w: &mut VectorWorkspace) -> Option<Pair> {
        let grid = &self.map.coarse.places;
        self.map.coarse.multiply(outputs, &mut w.scores);
        let along = &w.scores[..grid.len()];
        let mut starts: Vec<(f32, [Place; 2])> = Vec::with_capacity(grid.len());
        for (i, products) in self.products.chunks_exact(grid.len()).enumerate() {
            let (mut most, mut partner) = (0.0, None);
            for (j, (product, other)) in products.iter().zip(along).enumerate().take(i) {
                let [a, b] = [along[i] - product * other, other - product * along[i]];
                let explained = (along[i] * a + other * b) / (1.0 - product * product);
                if a > 0.0 && b > 0.0 && explained > most {
                    (most, partner) = (explained, Some(j));
                }
            }
            starts.extend(partner.map(|j| (most, [grid[i], grid[j]])));
        }
        starts.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut tried: Vec<[Place; 2]> = Vec::with_capacity(MOST_PAIRS);
        let mut best: Option<Pair> = None;
        for (_, start) in starts {
            let near = |a: Place, b: Place| a.distance_mm(b) < SAME_PAIR_MM;
            let is_same = |[a, b]: &[Place; 2]| {
                (near(*a, start[0]) && near(*b, start[1])) || (near(*a, start[1]) && near(*b, start[0]))
            };
            if tried.iter().any(is_same) {
                continue;
            }
            tried.push(start);
            best =
                [best, self.refined(start, outputs, w)].into_iter().flatten().min_by(|a, b| a.chi2.total_cmp(&b.chi2));
            if tried.len() == MOST_PAIRS {
                break;
            }
        }
        best
    }

    /// Refines a pair by the method of Levenberg and Marquardt, with the forces eliminated after each step.
    fn refined(&self, start: [Place; 2], outputs: &[f64], w: &mut VectorWorkspace) -> Option<Pair> {
        let (mut places, mut damping) = (start, FIRST_DAMPING);
        self.map.respond_to_two(places, true, w)?;
        w.weight.clear();
        w.weight.extend(self.map.coarse.noise_sd.iter().map(|sd| 1.0 / (sd * sd)));
        let mut forces_n = forces_n(outputs, w);
        let mut last = None;
        for _ in 0..MOST_STEPS {
            self.map.weigh_two(forces_n, w);
            forces_n = self::forces_n(outputs, w);
            let (normal, chi2) = normal(forces_n, outputs, w);
            let mut damped = normal;
            (0..6).for_each(|i| damped.information[i][i] *= 1.0 + damping);
            let step = damped.step(self.is_free(places, forces_n, &normal.slope));
            last = Some((places, forces_n, chi2, normal));
            if damped.gain(step) < LAST_GAIN {
                break;
            }
            let moved = |i: usize| {
                let Place { x_mm, y_mm } = places[i];
                self.map.area.clamp(Place::new(x_mm + step[2 * i], y_mm + step[2 * i + 1]))
            };
            let next = [moved(0), moved(1)];
            self.map.respond_to_two(next, false, w)?;
            let tried_n = self::forces_n(outputs, w);
            if self::normal(tried_n, outputs, w).1 <= chi2 {
                (places, forces_n, damping) = (next, tried_n, damping / DAMPING_FACTOR);
            } else {
                damping *= DAMPING_FACTOR;
                self.map.respond_to_two(places, false, w)?;
            }
        }
        let (places, forces_n, chi2, normal) = last.filter(|(_, _, chi2, _)| chi2.is_finite())?;
        Some(Pair::of(places, forces_n, chi2, &normal))
    }

    /// Unknowns that may change: not a place at the border that would leave the area, and no place without a force.
    fn is_free(&self, places: [Place; 2], forces_n: [f64; 2], slope: &[f64; 6]) -> [bool; 6] {
        let area = self.map.area;
        let stays =
            |at: f64, least: f64, most: f64, slope: f64| !(at <= least && slope < 0.0 || at >= most && slope > 0.0);
        std::array::from_fn(|i| match i {
            4 | 5 => forces_n[i - 4] > 0.0,
            _ if forces_n[i / 2] <= 0.0 => false,
            _ if i % 2 == 0 => stays(places[i / 2].x_mm, area.least.x_mm, area.most.x_mm, slope[i]),
            _ => stays(places[i / 2].y_mm, area.least.y_mm, area.most.y_mm, slope[i]),
        })
    }
}

impl VectorMap {
    /// Writes the columns of both places, and at the beginning their errors, to the first two buffers.
    fn respond_to_two(&self, places: [Place; 2], with_errors: bool, w: &mut VectorWorkspace) -> Option<()> {
        let press = self.axes[PRESS].as_ref()?;
        for (place, AxisBuffers { value, along_x, along_y, error }) in places.into_iter().zip(&mut w.axes) {
            [&mut *value, along_x, along_y, error].into_iter().for_each(|buffer| buffer.resize(self.outputs, 0.0));
            press.field.value_and_gradient(place, value, along_x, along_y);
            if with_errors {
                press.error(place, error);
            }
        }
        Some(())
    }

    fn weigh_two(&self, forces_n: [f64; 2], w: &mut VectorWorkspace) {
        let [a, b, _] = &w.axes;
        let [first_n, second_n] = forces_n;
        for (output, weight) in w.weight.iter_mut().enumerate() {
            let of_noise = self.noise.variance(output, first_n * a.value[output] + second_n * b.value[output]);
            let of_map = first_n * first_n * a.error[output] + second_n * second_n * b.error[output];
            *weight = 1.0 / (of_noise * (1.0 + of_map));
        }
    }
}

impl Pair {
    /// Returns two contacts with the smallest errors of an unbiased method, including the map's own error (Cramer-Rao).
    pub fn bound(map: &VectorMap, places: [Place; 2], forces_n: [f64; 2]) -> Option<Self> {
        let (outputs, mut w) = (vec![0.0; map.outputs], VectorWorkspace::default());
        map.respond_to_two(places, true, &mut w)?;
        w.weight.resize(outputs.len(), 0.0);
        map.weigh_two(forces_n, &mut w);
        Some(Pair::of(places, forces_n, 0.0, &normal(forces_n, &outputs, &w).0))
    }

    fn of(places: [Place; 2], forces_n: [f64; 2], chi2: f64, normal: &NormalEquations<6>) -> Self {
        let covariance = inverse(&normal.information);
        let sd = |i: usize| covariance.map_or(f64::INFINITY, |covariance| covariance[i][i].max(0.0).sqrt());
        let errors_mm = [sd(0).hypot(sd(1)), sd(2).hypot(sd(3))];
        Pair { places, forces_n, errors_mm, errors_n: [sd(4), sd(5)], chi2 }
    }

    /// Whether the outputs show both places within 1 mm and both forces within 0.1 N.
    pub(crate) fn is_separable(&self) -> bool {
        let is_within = |errors: [f64; 2], most: f64| errors.iter().all(|error| *error <= most);
        is_within(self.errors_mm, SEPARABLE_MM) && is_within(self.errors_n, SEPARABLE_N)
    }
}

/// Forces of at least 0 that fit best with the weights.
fn forces_n(outputs: &[f64], w: &VectorWorkspace) -> [f64; 2] {
    let [a, b, _] = &w.axes;
    let mut normal = NormalEquations::<2>::default();
    for (output, value) in outputs.iter().enumerate() {
        normal.add(w.weight[output], [a.value[output], b.value[output]], *value);
    }
    normal.finish();
    let [first, second] = normal.step([true; 2]);
    match (first > 0.0, second > 0.0) {
        (true, true) => [first, second],
        (false, true) => normal.step([false, true]).map(|n| n.max(0.0)),
        _ => normal.step([true, false]).map(|n| n.max(0.0)),
    }
}

fn normal(forces_n: [f64; 2], outputs: &[f64], w: &VectorWorkspace) -> (NormalEquations<6>, f64) {
    let ([a, b, _], [first_n, second_n]) = (&w.axes, forces_n);
    let (mut normal, mut chi2) = (NormalEquations::<6>::default(), 0.0);
    for (i, output) in outputs.iter().enumerate() {
        let residual = output - first_n * a.value[i] - second_n * b.value[i];
        let slopes = [first_n * a.along_x[i], first_n * a.along_y[i], second_n * b.along_x[i], second_n * b.along_y[i]];
        let [ax, ay, bx, by] = slopes;
        normal.add(w.weight[i], [ax, ay, bx, by, a.value[i], b.value[i]], residual);
        chi2 += w.weight[i] * residual * residual;
    }
    normal.finish();
    (normal, chi2)
}

/// Returns the limit that the gains of single contacts exceed at the false-alarm rate. Mean and variance of the gains give a gamma
/// distribution; if the gains themselves exceed its limit more often, their own limit counts.
pub(crate) fn limit(gains: Vec<f64>, false_alarms: f64) -> f64 {
    let share = OF_FALSE_ALARMS * false_alarms;
    let count = gains.len().max(1) as f64;
    let mean = gains.iter().sum::<f64>() / count;
    let variance = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / count;
    let gamma = Gamma::new(mean * mean / variance, mean / variance)
        .map_or(f64::INFINITY, |gamma| gamma.inverse_cdf(1.0 - share));
    gamma.max(upper(gains, share).unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::mechanics::lambda;

    /// Nine normal outputs, 5 mm deep; nothing is known about a shear.
    fn columns(place: Place) -> Vec<f64> {
        let unit = |i: i32| Place::new(4.5 * f64::from(i % 3) - 4.5, 4.5 * f64::from(i / 3) - 4.5);
        let press = (0..9).map(|i| lambda(place.distance_mm(unit(i)) / 5.0));
        vec![0.0; 18].into_iter().chain(press).collect()
    }

    fn read(loads: &[(Place, f64)]) -> Vec<f64> {
        let of = |i: usize| loads.iter().map(|(place, force_n)| force_n * columns(*place)[18 + i]).sum();
        (0..9).map(of).collect()
    }

    #[test]
    fn two_contacts_without_noise_are_given_back_and_scale_with_their_forces() {
        let map = VectorMap::known([Place::new(-6.0, -6.0), Place::new(6.0, 6.0)], 0.3, &[0.001; 9], columns);
        let (two, mut workspace) = (TwoContacts::new(map), VectorWorkspace::default());
        let places = [Place::new(-2.3, 1.2), Place::new(2.6, -1.7)];
        for times in [1.0, 3.0] {
            let outputs = read(&[(places[0], 0.4 * times), (places[1], 0.7 * times)]);
            let answer = two.solve(&outputs, &mut workspace).unwrap();
            assert_eq!(two.solve(&outputs, &mut VectorWorkspace::default()).unwrap(), answer, "the same twice");
            let ContactCount::Two(pair) = answer else { panic!("{answer:?}") };
            let first = usize::from(pair.places[0].x_mm > 0.0);
            for (truth, force_n, found) in [(places[0], 0.4, first), (places[1], 0.7, 1 - first)] {
                assert!(pair.places[found].distance_mm(truth) < 0.02, "{pair:?}");
                assert!((pair.forces_n[found] - force_n * times).abs() < 0.01 * times, "{pair:?}");
            }
        }
        let one = two.solve(&read(&[(places[0], 0.8)]), &mut workspace).unwrap();
        assert!(matches!(one, ContactCount::One { place, .. } if place.distance_mm(places[0]) < 0.01), "{one:?}");
    }
}
