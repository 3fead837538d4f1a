//! Where to press a new sensor.

use super::Prior;
use super::posterior::{ArrayPosterior, Information};
use super::spread::Deviations;
use crate::Covariance;
use crate::adapt::Moved;
use crate::normal::{NormalEquations, inverse};
use palpate_core::algebra::Matrix;
use palpate_core::quantity::Place;

/// Number of places along a side of the area where a press can be chosen. The second constant is the number of cells along a
/// side, at whose centres expected errors are averaged.
const CANDIDATES_A_SIDE: usize = 13;
const CONTACTS_A_SIDE: usize = 9;

/// Slopes of each output at one place under 1 N, and its value.
struct OutputSlopes {
    place: Place,
    outputs: Vec<(f64, Moved)>,
}

impl Prior {
    /// Returns places in the order in which each press lowers the expected mean location error most. The error is that of
    /// contacts of `contact_n` everywhere in the area, after presses of `press_n` at the places so far.
    pub fn chosen_places(&self, count: usize, press_n: f64, contact_n: f64) -> Vec<Place> {
        let area = self.map.response.field.area();
        let felt =
            |places: Vec<Place>| places.into_iter().map(|place| self.felt_at(place)).collect::<Vec<OutputSlopes>>();
        let (candidates, contacts) = (felt(area.grid(CANDIDATES_A_SIDE)), felt(area.cells(CONTACTS_A_SIDE)));
        let mut informed = self.nothing_known();
        let mut chosen = Vec::with_capacity(count);
        for _ in 0..count {
            let after = |candidate: &OutputSlopes| {
                let mut informed = informed.clone();
                self.inform(&mut informed, candidate, press_n);
                self.expected_mm(&informed, &contacts, contact_n)
            };
            let errors: Vec<f64> = candidates.iter().map(after).collect();
            let best = (0..candidates.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]));
            let Some(best) = best else { break };
            self.inform(&mut informed, &candidates[best], press_n);
            chosen.push(candidates[best].place);
        }
        chosen
    }

    /// Returns the expected mean location error of contacts of `contact_n`, mm, after presses of `press_n` at some places.
    pub fn expected_after_mm(&self, places: &[Place], press_n: f64, contact_n: f64) -> f64 {
        let informed = self.informed_by(places, press_n);
        let contacts = self.map.response.field.area().cells(CONTACTS_A_SIDE);
        let contacts: Vec<OutputSlopes> = contacts.into_iter().map(|place| self.felt_at(place)).collect();
        self.expected_mm(&informed, &contacts, contact_n)
    }

    /// Returns the standard deviations with which presses of `press_n` at some places measure the means over all units.
    pub fn repeats_of_means(&self, places: &[Place], press_n: f64) -> Deviations {
        let informed = self.informed_by(places, press_n);
        let own = self.spread.own.squares();
        let mut sum = Moved::ZERO;
        for of in &informed {
            let (_, covariance) = of.with(&own);
            // noise alone: the part of the covariance that the presses leave, not what the prior leaves out
            let noise = covariance * of.matrix * covariance;
            sum += noise.diagonal();
        }
        let count = informed.len() as f64;
        Deviations::of(&(sum / (count * count)))
    }

    fn nothing_known(&self) -> Vec<Information> {
        vec![Information::NONE; self.units.len()]
    }

    fn informed_by(&self, places: &[Place], press_n: f64) -> Vec<Information> {
        let mut informed = self.nothing_known();
        places.iter().for_each(|place| self.inform(&mut informed, &self.felt_at(*place), press_n));
        informed
    }

    fn felt_at(&self, place: Place) -> OutputSlopes {
        let of = |output: usize| self.map.slopes(output, place, &Moved::ZERO);
        OutputSlopes { place, outputs: (0..self.calibration.units()).map(of).collect() }
    }

    /// Adds what a press shows.
    fn inform(&self, informed: &mut [Information], press: &OutputSlopes, press_n: f64) {
        let noise = &self.map.response.noise;
        for (unit, of) in informed.iter_mut().zip(&self.units) {
            for &output in of {
                let (value, slopes) = press.outputs[output];
                let slopes = slopes * press_n;
                unit.add(&slopes, 0.0, noise.variance(output, press_n * value));
            }
        }
    }

    fn expected_mm(&self, informed: &[Information], contacts: &[OutputSlopes], contact_n: f64) -> f64 {
        let spread = &self.spread;
        let (own, common) = (spread.own.squares(), spread.common.squares());
        let [own, common] = [own, common].map(Matrix::from_diagonal);
        let ArrayPosterior { covariances, .. } = ArrayPosterior::joint(informed, &own, &[common]);
        let noise = &self.map.response.noise;
        let error_mm = |contact: &OutputSlopes| {
            let mut normal = NormalEquations::default();
            for (covariance, of) in covariances.iter().zip(&self.units) {
                for &output in of {
                    let (value, slopes) = contact.outputs[output];
                    let of_map = contact_n * contact_n * slopes.dot(&(*covariance * slopes));
                    let variance = noise.variance(output, contact_n * value) + of_map;
                    normal.add(1.0 / variance, [contact_n * slopes[1], contact_n * slopes[2], value], 0.0);
                }
            }
            normal.finish();
            inverse(&normal.information).map(|covariance| Covariance(covariance).mean_distance_mm())
        };
        let errors: Vec<f64> = contacts.iter().filter_map(error_mm).collect();
        errors.iter().sum::<f64>() / errors.len() as f64
    }
}
