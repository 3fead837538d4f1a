//! Properties that vary from spot to spot: height and stiffness.

use palpate_core::quantity::{Place, stream};
use rand::RngExt;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use std::f64::consts::TAU;

/// Number of cosines in a smooth part.
const WAVES: usize = 4;

/// Property of the specimen that varies from place to place. It has a smooth part, and a separate value for each spot of 1 um.
/// The seed alone determines both.
#[derive(Clone)]
pub(super) struct SpotMap {
    waves: [SpotWave; WAVES],
    /// Standard deviation of the independent part of the spots.
    white_sd: f64,
    white_name: &'static str,
    seed: u64,
    /// Last requested place and its value, stored because x and y rest most of the time.
    last: (Place, f64),
}

#[derive(Clone, Copy)]
struct SpotWave {
    amplitude: f64,
    per_x: f64,
    per_y: f64,
    phase: f64,
}

impl SpotMap {
    /// Creates a smooth part of at most `most`, composed of waves between two wavelengths, and an independent part of the spots
    /// with the standard deviation `white_sd`. The two names separate this property's streams from others.
    pub(super) fn new(
        most: f64,
        wavelength_mm: (f64, f64),
        white_sd: f64,
        names: [&'static str; 2],
        seed: u64,
    ) -> Self {
        let mut rng = stream(seed, 0, names[0]);
        let waves = std::array::from_fn(|_| {
            let (direction, phase) = (rng.random_range(0.0..TAU), rng.random_range(0.0..TAU));
            let per_mm = TAU / rng.random_range(wavelength_mm.0..=wavelength_mm.1);
            let (sin, cos) = f64::sin_cos(direction);
            SpotWave { amplitude: most / WAVES as f64, per_x: per_mm * cos, per_y: per_mm * sin, phase }
        });
        let nowhere = Place::new(f64::NAN, f64::NAN);
        SpotMap { waves, white_sd, white_name: names[1], seed, last: (nowhere, 0.0) }
    }

    /// Returns the value at a place.
    pub(super) fn at(&mut self, place: Place) -> f64 {
        if self.last.0 != place {
            self.last = (place, self.smooth(place) + self.white(place));
        }
        self.last.1
    }

    fn smooth(&self, place: Place) -> f64 {
        let waves = self.waves.iter();
        waves.map(|w| w.amplitude * (w.per_x * place.x_mm + w.per_y * place.y_mm + w.phase).cos()).sum()
    }

    fn white(&self, place: Place) -> f64 {
        if self.white_sd == 0.0 {
            return 0.0;
        }
        let um = |mm: f64| u64::from((mm * 1000.0).round() as i32 as u32);
        let spot = um(place.x_mm) << 32 | um(place.y_mm);
        let draw: f64 = StandardNormal.sample(&mut stream(self.seed, spot, self.white_name));
        self.white_sd * draw
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 2] = ["smooth", "white"];

    fn grid() -> impl Iterator<Item = Place> {
        (-60..=60).flat_map(|i| (-60..=60).map(move |j| Place::new(f64::from(i) * 0.1, f64::from(j) * 0.1)))
    }

    #[test]
    fn the_smooth_part_is_bounded_and_as_smooth_as_its_shortest_wave() {
        let mut largest = 0.0f64;
        for seed in 0..40 {
            let mut map = SpotMap::new(0.005, (6.0, 12.0), 0.0, NAMES, seed);
            for place in grid() {
                let here = map.at(place);
                let beside = map.at(Place::new(place.x_mm + 1e-3, place.y_mm));
                assert!(here.abs() <= 0.005, "{here}");
                assert!((beside - here).abs() <= 0.005 * TAU / 6.0 * 1e-3 + 1e-15, "{here} {beside}");
                largest = largest.max(here.abs());
            }
        }
        assert!(largest > 0.004, "the room is used: {largest}");
    }

    #[test]
    fn shorter_waves_make_a_shorter_relief() {
        let steepest = |wavelength_mm| {
            let mut map = SpotMap::new(0.03, wavelength_mm, 0.0, NAMES, 3);
            let slopes = grid().map(|at| (map.at(Place::new(at.x_mm + 1e-4, at.y_mm)) - map.at(at)).abs() / 1e-4);
            slopes.fold(0.0, f64::max)
        };
        assert!(steepest((1.0, 2.0)) > 3.0 * steepest((6.0, 12.0)));
    }

    #[test]
    fn each_spot_keeps_its_own_value() {
        let mut map = SpotMap::new(0.0, (6.0, 12.0), 0.001, NAMES, 7);
        let values: Vec<f64> = grid().map(|place| map.at(place)).collect();
        let again: Vec<f64> = grid().map(|place| map.at(Place::new(place.x_mm + 3e-4, place.y_mm))).collect();
        assert_eq!(values, again, "300 nm beside is the same spot");
        let mean_of = |f: &dyn Fn(usize) -> f64| (0..values.len() - 1).map(f).sum::<f64>() / (values.len() - 1) as f64;
        let (mean, square) = (mean_of(&|i| values[i]), mean_of(&|i| values[i] * values[i]));
        let neighbours = mean_of(&|i| values[i] * values[i + 1]);
        assert!(mean.abs() < 3e-5 && (square.sqrt() / 0.001 - 1.0).abs() < 0.03, "{mean} {square}");
        assert!(neighbours.abs() / square < 0.03, "neighbours know nothing of each other");
        let mut other = SpotMap::new(0.0, (6.0, 12.0), 0.001, NAMES, 8);
        assert_ne!(other.at(Place::new(1.0, 1.0)), map.at(Place::new(1.0, 1.0)));
    }
}
