//! The specimens on which methods are compared: the paper's array with the noise of its Table 1, read in two ways.

use palpate_core::quantity::{ArrayLayout, Place, RandomStream};
use palpate_report::paper;
use palpate_sim::scene::{Converter, Elastomer, NoiseOf, Skin, SkinSpec, TaxelNoise};
use palpate_solver::{Calibration, CalibrationError, CalibrationPoint};
use rand::RngExt;
use serde::Serialize;

/// Largest specified force of the array, N (PAPER S3).
pub(crate) const FULL_SCALE_N: f64 = 2.0;
/// Force of a calibration, N.
pub(crate) const CALIBRATION_N: f64 = 1.0;
/// Smallest and largest force of a test, N.
pub(crate) const FORCES_N: (f64, f64) = (0.1, 1.0);
/// Half the side of the calibrated square, mm.
pub(crate) const HALF_MM: f64 = 6.0;
/// Depth of the paper's taxels, mm.
pub(crate) const DEPTH_MM: f64 = 5.0;

/// Array of the paper: units along a side, and distance from one unit to the next, mm.
const SIDE: usize = 3;
const PITCH_MM: f64 = 4.5;
/// Noise floor in addition to a noise that grows with the reading, reading units: 1 mV at 1 V per newton.
const FLOOR: f64 = 0.001;
/// 16 bits over 10 V in either direction, at 1 V per newton.
pub(crate) const CONVERTER: Converter = Converter { bits: 16, range: 10.0 };

/// Quantity to which the repeatability of Table 1 refers. The paper doesn't state it, so both are tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum NoiseReference {
    /// Full scale: the noise is the same at every force.
    T,
    /// The reading, over a small floor.
    Q,
}

impl NoiseReference {
    /// Both references.
    pub const ALL: [NoiseReference; 2] = [NoiseReference::T, NoiseReference::Q];

    /// Returns the letter used in rows and files.
    pub fn name(self) -> &'static str {
        match self {
            NoiseReference::T => "T",
            NoiseReference::Q => "Q",
        }
    }

    /// Returns a description for people.
    pub fn text(self) -> &'static str {
        match self {
            NoiseReference::T => "T: noise a share of full scale",
            NoiseReference::Q => "Q: noise a share of the reading",
        }
    }
}

/// An array and the readings of its taxels.
#[derive(Clone, Debug, PartialEq)]
pub struct StudySpecimen {
    /// Properties of the taxels.
    pub skin: SkinSpec,
    /// Nominal positions of the taxels.
    pub layout: ArrayLayout,
}

impl StudySpecimen {
    /// Returns the paper's 3 x 3 units with their own noise.
    pub fn papers(noise: NoiseReference) -> StudySpecimen {
        Self::new(noise, ArrayLayout::grid(SIDE, SIDE, PITCH_MM), paper::repeatability_percent().to_vec())
    }

    /// Returns a square of units, each with the mean noise of the paper's units.
    pub fn square(noise: NoiseReference, side: usize, pitch_mm: f64) -> StudySpecimen {
        let mean = paper::repeatability_percent().iter().sum::<f64>() / paper::TABLE_1_PERCENT.len() as f64;
        Self::new(noise, ArrayLayout::grid(side, side, pitch_mm), vec![mean; side * side])
    }

    fn new(noise: NoiseReference, layout: ArrayLayout, repeatability_percent: Vec<f64>) -> StudySpecimen {
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
        StudySpecimen { skin, layout }
    }

    /// Returns a copy with a change.
    #[must_use]
    pub fn with(&self, change: impl FnOnce(&mut SkinSpec)) -> StudySpecimen {
        let mut changed = self.clone();
        change(&mut changed.skin);
        changed
    }

    /// Draws a random skin of this specimen.
    pub fn skin(&self, seed: u64) -> Skin {
        Skin::new(&self.skin, &self.layout, FULL_SCALE_N, seed)
    }
}

/// Simultaneous loads on the array: one load or two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Place of the load, mm.
    pub place: Place,
    /// Force, N.
    pub force_n: f64,
    /// Place of a second contact with the same force.
    pub second: Option<Place>,
}

/// Known truth about a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownContact {
    /// Place of the press, mm.
    pub place: Place,
    /// Force, N; `None` if it is unknown or isn't a single force.
    pub force_n: Option<f64>,
    /// Place of a simultaneous second press, mm.
    pub second: Option<Place>,
}

/// Readings with known truth.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownReadings {
    /// Number of outputs per reading.
    pub units: usize,
    /// Truths, one for each reading.
    pub truths: Vec<KnownContact>,
    /// Readings one after another, with one output for each unit.
    pub outputs: Vec<f64>,
}

impl KnownReadings {
    /// Returns a skin's readings of some touches, each with its own error.
    pub fn of(skin: &mut Skin, touches: &[Touch], rng: &mut RandomStream) -> KnownReadings {
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

    /// Iterates over the truths and readings.
    pub fn iter(&self) -> impl Iterator<Item = (&KnownContact, &[f64])> + Clone {
        self.truths.iter().zip(self.outputs.chunks_exact(self.units))
    }

    /// Returns these presses in the form of a calibration. An unknown force counts as the paper's 1 N.
    ///
    /// # Errors
    /// A press is unsuitable for calibration.
    pub fn calibration(&self) -> Result<Calibration, CalibrationError> {
        let point = |(truth, outputs): (&KnownContact, _)| {
            let KnownContact { place, force_n, .. } = *truth;
            CalibrationPoint { place, force_n: force_n.unwrap_or(CALIBRATION_N), outputs }
        };
        Calibration::new(&self.iter().map(point).collect::<Vec<_>>())
    }
}

/// Returns a square grid of touches over the complete area, `side` along a side.
pub(crate) fn grid(side: usize) -> Vec<Touch> {
    let at = |index: usize| HALF_MM * (2.0 * index as f64 / (side - 1) as f64 - 1.0);
    let place = |index: usize| Place::new(at(index % side), at(index / side));
    (0..side * side).map(|index| Touch { place: place(index), force_n: CALIBRATION_N, second: None }).collect()
}

/// Returns touches at random places in the area with random forces in the range.
pub(crate) fn anywhere(count: usize, forces_n: (f64, f64), rng: &mut RandomStream) -> Vec<Touch> {
    let mut touch = || {
        let [x_mm, y_mm] = [(); 2].map(|()| rng.random_range(-HALF_MM..=HALF_MM));
        Touch { place: Place::new(x_mm, y_mm), force_n: rng.random_range(forces_n.0..=forces_n.1), second: None }
    };
    (0..count).map(|_| touch()).collect()
}
