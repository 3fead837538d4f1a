//! The paper's nine units as simulated skins, their noise read in two ways.

use palpate::paper::repeatability_percent;
use palpate::scene::{Converter, Elastomer, NoiseOf, SkinSpec, TaxelNoise};

fn scene(of: NoiseOf, floor: f64) -> SkinSpec {
    SkinSpec {
        elastomer: Some(Elastomer::half_space(5.0)),
        noise: Some(TaxelNoise { repeatability_percent: repeatability_percent().to_vec(), of, floor }),
        converter: Some(Converter { bits: 16, range: 10.0 }),
        ..SkinSpec::default()
    }
}

/// Noise that is a share of full scale.
pub(crate) fn scene_t() -> SkinSpec {
    scene(NoiseOf::FullScale, 0.0)
}

/// Noise that is a share of the reading, and a floor.
pub(crate) fn scene_q() -> SkinSpec {
    scene(NoiseOf::Reading, 0.001)
}
