//! The specimens of these studies, and their calibrations.

use super::super::methods::specimen::{FULL_SCALE_N, HALF_MM, NoiseReference, StudySpecimen, grid};
use crate::StudyError;
use palpate_core::quantity::{ArrayLayout, Place, RandomStream, stream};
use palpate_sim::scene::{NoiseOf, Skin, Taxels};
use palpate_solver::vector::{VectorCalibration, VectorMap, VectorRow};

/// Load at a place: the force along x, y and into the specimen, N.
pub(super) type Load = (Place, [f64; 3]);

/// Width of the square that the units cover, from the first to the last, mm.
const COVERED_MM: f64 = 9.0;
/// Force of the drags of a calibration, N.
const DRAG_N: f64 = 0.5;
/// Length of a cell of an exact map, mm.
const CELL_MM: f64 = 0.3;

/// An array whose taxels read tractions.
pub(super) struct VectorSpecimen {
    skin: Skin,
    noise_sd: Vec<f64>,
    seed: u64,
}

impl VectorSpecimen {
    /// Returns the paper's units with their noise of Table 1, or a square of units with the same noise for all, reading units.
    pub(super) fn new(side: usize, channels: usize, noise_sd: Option<f64>, seed: u64) -> Self {
        let units = side * side;
        let specimen = match noise_sd {
            None => StudySpecimen::papers(NoiseReference::T),
            Some(_) => StudySpecimen::square(NoiseReference::T, side, COVERED_MM / (side - 1) as f64),
        };
        let specimen = specimen.with(|skin| {
            skin.taxels = Taxels { shear: true, ..Taxels::default() };
            if let (Some(noise), Some(sd)) = (&mut skin.noise, noise_sd) {
                (noise.repeatability_percent, noise.of) = (vec![300.0 * sd / FULL_SCALE_N; units], NoiseOf::FullScale);
            }
        });
        let percent = specimen.skin.noise.iter().flat_map(|noise| noise.repeatability_percent.clone());
        let sd = |percent: f64| vec![percent / 300.0 * FULL_SCALE_N; channels];
        let noise_sd = percent.flat_map(sd).collect();
        let layout: ArrayLayout = specimen.layout.with_channels(channels);
        VectorSpecimen { skin: Skin::new(&specimen.skin, &layout, FULL_SCALE_N, seed), noise_sd, seed }
    }

    /// Returns the map of a calibration at `side` x `side` places.
    pub(super) fn calibrated(&mut self, side: usize, drags: bool) -> Result<VectorMap, StudyError> {
        let mut rng = stream(self.seed, 0, "vector calibration");
        let directions = [[0.0, 0.0], [DRAG_N, 0.0], [-DRAG_N, 0.0], [0.0, DRAG_N], [0.0, -DRAG_N]];
        let mut presses = Vec::new();
        for touch in grid(side) {
            for [x_n, y_n] in &directions[..if drags { directions.len() } else { 1 }] {
                let load = (touch.place, [*x_n, *y_n, touch.force_n]);
                presses.push((load, self.read(&[load], &mut rng)));
            }
        }
        let rows: Vec<VectorRow<'_>> = presses
            .iter()
            .map(|((place, force_n), outputs)| VectorRow { place: *place, force_n: *force_n, outputs })
            .collect();
        let broken =
            |error: palpate_solver::vector::VectorError| StudyError::Broken { seed: self.seed, why: error.to_string() };
        VectorCalibration::new(&rows).and_then(|calibration| VectorMap::fit(&calibration)).map_err(broken)
    }

    /// Returns the exact map, which gives the bounds.
    pub(super) fn known(&self) -> VectorMap {
        let columns = |place: Place| {
            let axis = |axis: usize| self.exact(&[(place, std::array::from_fn(|i| f64::from(u8::from(i == axis))))]);
            (0..3).flat_map(axis).collect()
        };
        let corners = [Place::new(-HALF_MM, -HALF_MM), Place::new(HALF_MM, HALF_MM)];
        VectorMap::known(corners, CELL_MM, &self.noise_sd, columns)
    }

    /// Reads loads at once, as a new contact.
    pub(super) fn read(&mut self, loads: &[Load], rng: &mut RandomStream) -> Vec<f64> {
        self.skin.draw_contact(rng);
        let mut outputs = self.exact(loads);
        self.skin.read_out(0.0, &mut outputs);
        outputs
    }

    fn exact(&self, loads: &[Load]) -> Vec<f64> {
        let mut outputs = vec![0.0; self.skin.len()];
        loads.iter().for_each(|(place, force_n)| self.skin.add_force(*force_n, *place, &mut outputs));
        outputs
    }
}
