//! The paper's nine units as taxels that read a force of three axes, calibrated with presses and drags.

use palpate_core::quantity::{ArrayLayout, Place, RandomStream, stream};
use palpate_report::paper::repeatability_percent;
use palpate_sim::scene::{Converter, Elastomer, NoiseOf, Skin, SkinSpec, TaxelNoise, Taxels};
use palpate_solver::vector::{VectorCalibration, VectorMap, VectorRow};
use rand::RngExt;
use std::f64::consts::TAU;

const FULL_SCALE_N: f64 = 2.0;
pub const HALF_MM: f64 = 6.0;

/// An array and the noise of its outputs.
pub struct VectorScene {
    skin: Skin,
    noise_sd: Vec<f64>,
}

impl VectorScene {
    /// Scene T: the noise of Table 1, for units of one output (normal) or three.
    pub fn t(channels: usize) -> Self {
        Self::new(channels, repeatability_percent().to_vec(), 0.0)
    }

    /// The same units with a noise of 1 mV.
    pub fn of_1_mv(channels: usize) -> Self {
        Self::new(channels, vec![0.0; 9], 0.001)
    }

    fn new(channels: usize, repeatability_percent: Vec<f64>, floor: f64) -> Self {
        let sd = |percent: &f64| (percent / 300.0 * FULL_SCALE_N).hypot(floor);
        let noise_sd = repeatability_percent.iter().flat_map(|percent| vec![sd(percent); channels]).collect();
        let spec = SkinSpec {
            elastomer: Some(Elastomer::half_space(5.0)),
            noise: Some(TaxelNoise { repeatability_percent, of: NoiseOf::FullScale, floor }),
            converter: Some(Converter { bits: 16, range: 10.0 }),
            taxels: Taxels { shear: true, ..Taxels::default() },
            ..SkinSpec::default()
        };
        let layout = ArrayLayout::grid(3, 3, 4.5).with_channels(channels);
        VectorScene { skin: Skin::new(&spec, &layout, FULL_SCALE_N, 1), noise_sd }
    }

    /// The reading of some loads at once, as a new contact.
    pub fn read(&mut self, loads: &[(Place, [f64; 3])], rng: &mut RandomStream) -> Vec<f64> {
        self.skin.draw_contact(rng);
        let mut outputs = self.exact(loads);
        self.skin.read_out(0.0, &mut outputs);
        outputs
    }

    /// The outputs of some loads at once, without noise.
    pub fn exact(&self, loads: &[(Place, [f64; 3])]) -> Vec<f64> {
        let mut outputs = vec![0.0; self.skin.len()];
        loads.iter().for_each(|(place, force_n)| self.skin.add_force(*force_n, *place, &mut outputs));
        outputs
    }

    /// A square grid of presses of 1 N; with drags also 0.5 N in four directions, each with its own noise.
    pub fn calibration(&mut self, side: usize, drags: bool, seed: u64) -> VectorCalibration {
        let mut rng = stream(seed, 0, "vector calibration");
        let at = |i: usize| -HALF_MM + 2.0 * HALF_MM * i as f64 / (side - 1) as f64;
        let sideways = [[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]];
        let mut presses = Vec::new();
        for place in (0..side * side).map(|i| Place::new(at(i % side), at(i / side))) {
            for [x_n, y_n] in &sideways[..if drags { 5 } else { 1 }] {
                let force_n = [*x_n, *y_n, 1.0];
                presses.push((place, force_n, self.read(&[(place, force_n)], &mut rng)));
            }
        }
        let rows: Vec<VectorRow<'_>> = presses
            .iter()
            .map(|(place, force_n, outputs)| VectorRow { place: *place, force_n: *force_n, outputs })
            .collect();
        VectorCalibration::new(&rows).expect("a sound calibration")
    }

    /// The map of this array without any error.
    pub fn known(&self) -> VectorMap {
        let columns = |place: Place| {
            let axis = |axis: usize| {
                let mut force_n = [0.0; 3];
                force_n[axis] = 1.0;
                self.exact(&[(place, force_n)])
            };
            [axis(0), axis(1), axis(2)].concat()
        };
        let corners = [Place::new(-HALF_MM, -HALF_MM), Place::new(HALF_MM, HALF_MM)];
        VectorMap::known(corners, 0.4, &self.noise_sd, columns)
    }
}

/// A random place in the area, and a force of 0.1 to 1 N with a shear of up to `share` of it in any direction.
pub fn anywhere(share: f64, rng: &mut RandomStream) -> (Place, [f64; 3]) {
    let place = Place::new(rng.random_range(-HALF_MM..=HALF_MM), rng.random_range(-HALF_MM..=HALF_MM));
    let press_n: f64 = rng.random_range(0.1..=1.0);
    // evenly over the disc
    let shear_n = share * press_n * rng.random_range(0.0..=1.0f64).sqrt();
    let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
    (place, [shear_n * cos, shear_n * sin, press_n])
}
