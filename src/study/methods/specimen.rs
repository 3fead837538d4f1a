//! The specimens on which methods are compared: the paper's array with the noise of its Table 1, read in two ways.

use crate::paper;
use crate::quantity::{ArrayLayout, Place, Stream};
use crate::scene::{Converter, Elastomer, NoiseOf, Skin, SkinSpec, TaxelNoise};
use crate::solver::{Calibration, CalibrationError, CalibrationPoint};
use rand::RngExt;
use serde::Serialize;

/// The largest force that the array is specified for, N (PAPER S3).
pub const FULL_SCALE_N: f64 = 2.0;
/// The force of a calibration, N.
pub const CALIBRATION_N: f64 = 1.0;
/// Least and most force of a test, N.
pub const FORCES_N: (f64, f64) = (0.1, 1.0);
/// Half the side of the calibrated square, mm.
pub const HALF_MM: f64 = 6.0;
/// Depth of the paper's taxels, mm.
pub const DEPTH_MM: f64 = 5.0;

/// The paper's array: units along a side, and from one to the next, mm.
const SIDE: usize = 3;
const PITCH_MM: f64 = 4.5;
/// Beside a noise that grows with the reading, reading units: 1 mV at 1 V a newton.
const FLOOR: f64 = 0.001;
/// 16 bits over 10 V either way, at 1 V a newton.
pub const CONVERTER: Converter = Converter { bits: 16, range: 10.0 };

/// What Table 1's repeatability is a share of. The paper doesn't say; both are tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum NoiseReference {
    /// Full scale: the noise is the same at every force.
    T,
    /// The reading, over a small floor.
    Q,
}

impl NoiseReference {
    /// Both.
    pub const ALL: [NoiseReference; 2] = [NoiseReference::T, NoiseReference::Q];

    /// One letter, as it stands in rows and files.
    pub fn name(self) -> &'static str {
        match self {
            NoiseReference::T => "T",
            NoiseReference::Q => "Q",
        }
    }

    /// The same for a person.
    pub fn told(self) -> &'static str {
        match self {
            NoiseReference::T => "T: noise a share of full scale",
            NoiseReference::Q => "Q: noise a share of the reading",
        }
    }
}

/// An array and what its taxels read.
#[derive(Clone, Debug, PartialEq)]
pub struct Specimen {
    /// What the taxels are.
    pub skin: SkinSpec,
    /// Where they are said to be.
    pub layout: ArrayLayout,
}

impl Specimen {
    /// The paper's 3 x 3 units with their own noise.
    pub fn papers(noise: NoiseReference) -> Specimen {
        Self::new(noise, ArrayLayout::grid(SIDE, SIDE, PITCH_MM), paper::repeatability_percent().to_vec())
    }

    /// A square of units that are all as noisy as the paper's are on average.
    pub fn square(noise: NoiseReference, side: usize, pitch_mm: f64) -> Specimen {
        let mean = paper::repeatability_percent().iter().sum::<f64>() / paper::TABLE_1_PERCENT.len() as f64;
        Self::new(noise, ArrayLayout::grid(side, side, pitch_mm), vec![mean; side * side])
    }

    fn new(noise: NoiseReference, layout: ArrayLayout, repeatability_percent: Vec<f64>) -> Specimen {
        let (of, floor) = match noise {
            NoiseReference::T => (NoiseOf::FullScale, 0.0),
            NoiseReference::Q => (NoiseOf::Reading, FLOOR),
        };
        let skin = SkinSpec {
            elastomer: Some(Elastomer::half_space(DEPTH_MM)),
            noise: Some(TaxelNoise { repeatability_percent, of, floor }),
            converter: Some(CONVERTER),
            ..SkinSpec::default()
        };
        Specimen { skin, layout }
    }

    /// The same with something changed.
    #[must_use]
    pub fn with(&self, change: impl FnOnce(&mut SkinSpec)) -> Specimen {
        let mut changed = self.clone();
        change(&mut changed.skin);
        changed
    }

    /// One of them, drawn.
    pub fn skin(&self, seed: u64) -> Skin {
        Skin::new(&self.skin, &self.layout, FULL_SCALE_N, seed)
    }
}

/// What presses on the array at once: one load, or two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Where, mm.
    pub place: Place,
    /// How hard, N.
    pub force_n: f64,
    /// A second contact that presses as hard.
    pub second: Option<Place>,
}

/// What is known of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownContact {
    /// Where it was pressed, mm.
    pub place: Place,
    /// How hard, N; none where that isn't known, or isn't one force.
    pub force_n: Option<f64>,
    /// Where it was pressed at the same time, mm.
    pub second: Option<Place>,
}

/// Readings whose truth is known.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownReadings {
    /// Outputs a reading.
    pub units: usize,
    /// One a reading.
    pub truths: Vec<KnownContact>,
    /// The readings one after another, one output for each.
    pub outputs: Vec<f64>,
}

impl KnownReadings {
    /// What a skin reads of some touches, each with an error of its own.
    pub fn of(skin: &mut Skin, touches: &[Touch], rng: &mut Stream) -> KnownReadings {
        let units = skin.len();
        let mut outputs = vec![0.0; units * touches.len()];
        for (touch, outputs) in touches.iter().zip(outputs.chunks_exact_mut(units)) {
            skin.draw_contact(rng);
            skin.add_load(touch.force_n, touch.place, outputs);
            if let Some(second) = touch.second {
                skin.add_load(touch.force_n, second, outputs);
            }
            skin.read_out(0.0, outputs);
        }
        let truth = |touch: &Touch| KnownContact {
            place: touch.place,
            force_n: touch.second.is_none().then_some(touch.force_n),
            second: touch.second,
        };
        KnownReadings { units, truths: touches.iter().map(truth).collect(), outputs }
    }

    /// One after another.
    pub fn iter(&self) -> impl Iterator<Item = (&KnownContact, &[f64])> + Clone {
        self.truths.iter().zip(self.outputs.chunks_exact(self.units))
    }

    /// The same presses as a calibration; a force that isn't known counts as the paper's 1 N.
    ///
    /// # Errors
    /// A press that can't be calibrated on.
    pub fn calibration(&self) -> Result<Calibration, CalibrationError> {
        let point = |(truth, outputs): (&KnownContact, _)| {
            let KnownContact { place, force_n, .. } = *truth;
            CalibrationPoint { place, force_n: force_n.unwrap_or(CALIBRATION_N), outputs }
        };
        Calibration::new(&self.iter().map(point).collect::<Vec<_>>())
    }
}

/// A square grid of touches over the whole area, `side` along a side.
pub fn grid(side: usize) -> Vec<Touch> {
    let at = |index: usize| HALF_MM * (2.0 * index as f64 / (side - 1) as f64 - 1.0);
    let place = |index: usize| Place::new(at(index % side), at(index / side));
    (0..side * side).map(|index| Touch { place: place(index), force_n: CALIBRATION_N, second: None }).collect()
}

/// Touches anywhere in the area with any of the forces.
pub fn anywhere(count: usize, forces_n: (f64, f64), rng: &mut Stream) -> Vec<Touch> {
    let mut touch = || {
        let [x_mm, y_mm] = [(); 2].map(|()| rng.random_range(-HALF_MM..=HALF_MM));
        Touch { place: Place::new(x_mm, y_mm), force_n: rng.random_range(forces_n.0..=forces_n.1), second: None }
    };
    (0..count).map(|_| touch()).collect()
}
