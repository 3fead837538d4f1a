//! The paper's nine units as simulated skins with two readings of their noise; and runs of two magnetic skins.

use super::TestFolder;
use palpate_report::paper::repeatability_percent;
use palpate_sim::scene::{Converter, Elastomer, NoiseOf, SkinSpec, TaxelNoise};

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
