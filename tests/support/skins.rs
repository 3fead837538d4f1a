//! The paper's nine units as simulated skins with two readings of their noise; grids of any number of units; and runs of two magnetic
//! skins.

use super::TestFolder;
use palpate_core::quantity::{ArrayLayout, Place, RandomStream, stream};
use palpate_report::paper::repeatability_percent;
use palpate_sim::scene::{Converter, Elastomer, NoiseOf, Skin, SkinSpec, TaxelNoise};
use rand::RngExt;

fn scene(of: NoiseOf, floor: f64) -> SkinSpec {
    SkinSpec {
        elastomer: Some(Elastomer::half_space(5.0)),
        noise: Some(TaxelNoise { repeatability_percent: repeatability_percent().to_vec(), of, floor }),
        converter: Some(Converter { bits: 16, range: 10.0 }),
        ..SkinSpec::default()
    }
}

/// Noise that is a fraction of full scale.
pub fn scene_t() -> SkinSpec {
    scene(NoiseOf::FullScale, 0.0)
}

/// Noise that is a fraction of the reading, and a floor.
pub fn scene_q() -> SkinSpec {
    scene(NoiseOf::Reading, 0.001)
}

/// A press: its place, force in N, and outputs.
pub type Pressed = (Place, f64, Vec<f64>);

/// A grid of simulated units, and the random numbers of its presses.
pub struct GridSkin {
    pub layout: ArrayLayout,
    /// Half the width and half the height of the area, mm.
    half_mm: [f64; 2],
    skin: Skin,
    rng: RandomStream,
}

impl GridSkin {
    pub fn new(columns: usize, rows: usize) -> GridSkin {
        let (layout, units) = (ArrayLayout::grid(rows, columns, 4.5), columns * rows);
        let noise = TaxelNoise { repeatability_percent: vec![1.0; units], of: NoiseOf::Reading, floor: 0.001 };
        let fine = SkinSpec { elastomer: Some(Elastomer::half_space(5.0)), noise: Some(noise), ..SkinSpec::default() };
        let spec = if units == 9 { scene_t() } else { fine };
        let half_mm = [columns, rows].map(|count| 2.25 * (count as f64 - 1.0) + 1.5);
        let (skin, rng) = (Skin::new(&spec, &layout, 2.0, units as u64), stream(units as u64, 1, "contacts"));
        GridSkin { layout, half_mm, skin, rng }
    }

    /// Presses with 1 N at places of a grid.
    pub fn spaced(&mut self, spacing_mm: f64) -> Vec<Pressed> {
        let [wide_mm, high_mm] = self.half_mm;
        let [across, along] = self.half_mm.map(|half_mm| (2.0 * half_mm / spacing_mm) as usize + 1);
        let at = |index: usize, half_mm: f64| spacing_mm * index as f64 - half_mm;
        let places = (0..across * along).map(|i| Place::new(at(i % across, wide_mm), at(i / across, high_mm)));
        places.map(|place| self.press(place, 1.0)).collect()
    }

    /// Presses with 1 N at so many places along x and along y.
    pub fn grid(&mut self, across: usize, along: usize) -> Vec<Pressed> {
        let [wide_mm, high_mm] = self.half_mm;
        let at = |index: usize, count: usize, half_mm: f64| half_mm * (2.0 * index as f64 / (count - 1) as f64 - 1.0);
        let place = |i: usize| Place::new(at(i % across, across, wide_mm), at(i / across, along, high_mm));
        (0..across * along).map(|i| self.press(place(i), 1.0)).collect()
    }

    /// Presses at random places with random forces.
    pub fn random(&mut self, count: usize) -> Vec<Pressed> {
        let [wide_mm, high_mm] = self.half_mm;
        let mut anywhere = |_| {
            let [x_mm, y_mm] = [wide_mm, high_mm].map(|half_mm| self.rng.random_range(-half_mm..half_mm));
            let force_n = self.rng.random_range(0.1..1.0);
            self.press(Place::new(x_mm, y_mm), force_n)
        };
        (0..count).map(&mut anywhere).collect()
    }

    /// One press, with noise of its own.
    pub fn press(&mut self, place: Place, force_n: f64) -> Pressed {
        let mut outputs = vec![0.0; self.skin.len()];
        self.skin.draw_contact(&mut self.rng);
        self.skin.outputs(force_n, place, &mut outputs);
        (place, force_n, outputs)
    }
}

/// A magnetic skin of 4 x 4 outputs, and one of five chips with three axes each, both in microtesla.
pub const MAGNETIC: &str = include_str!("rigs/magnetic.toml");
pub const FIFTEEN: &str = include_str!("rigs/fifteen.toml");

/// A recipe with every kind of step, for either skin.
pub const SKIN: &str = r#"
name = "skin"

[[step]]
phase = "characterisation"
units = "all"
staircase = { to_n = 2.0, step_n = 0.5, repeats = 3 }

[[step]]
phase = "calibration"
grid = { x_mm = [-9.0, 9.0], y_mm = [-9.0, 9.0], spacing_mm = 1.0 }
force_n = 1.5

[[step]]
phase = "test"
random = { count = 60, x_mm = [-9.0, 9.0], y_mm = [-9.0, 9.0], force_n = [0.2, 2.0] }
"#;

/// A folder with a run of both skins.
pub fn skins() -> TestFolder {
    let bench = TestFolder::with([("magnetic.toml", MAGNETIC), ("fifteen.toml", FIFTEEN), ("skin.toml", SKIN)]);
    for skin in ["magnetic", "fifteen"] {
        bench.palpate_ends(0, &format!("run skin.toml --rig {skin}.toml --out {skin}"));
    }
    bench
}
