//! The simulated design, its sensors and its prior.

use super::super::StudyError;
use super::super::methods::specimen::{
    CALIBRATION_N, DEPTH_MM, FORCES_N, HALF_MM, KnownReadings, NoiseReference, StudySpecimen, Touch, anywhere, grid,
};
use super::{PRIOR_SEEDS, broken};
use palpate_core::mechanics::Medium;
use palpate_core::quantity::{ArrayLayout, Place, Range, cell_centres, stream};
use palpate_sim::scene::{Elastomer, SkinSpec};
use palpate_solver::{Calibration, MeanErrors, Prior, Solver, Workspace};

/// Poisson's ratio of the layer.
const RUBBER: f64 = 0.49;
/// Largest differences between sensors either way: gains and depths in %, places in mm.
const GAIN_SPREAD_PERCENT: f64 = 20.0;
const DEPTH_SPREAD_PERCENT: f64 = 5.0;
const PLACE_SPREAD_MM: f64 = 0.1;
/// Number of sensors that make the prior.
pub(super) const SENSORS: u64 = 5;
/// Number of places along a side of a full calibration.
pub(super) const SIDE: usize = 25;

/// A design from which sensors are drawn.
#[derive(Clone)]
pub struct SensorDesign {
    specimen: StudySpecimen,
}

impl SensorDesign {
    /// Returns the paper's array under a bonded layer.
    pub fn papers(noise: NoiseReference) -> SensorDesign {
        let medium = Medium::BondedLayer { poisson_ratio: RUBBER };
        let specimen = StudySpecimen::papers(noise).with(|skin| {
            skin.elastomer = Some(Elastomer { depth_mm: DEPTH_MM, medium });
            skin.taxels.gain_spread_percent = GAIN_SPREAD_PERCENT;
            skin.taxels.place_spread_mm = PLACE_SPREAD_MM;
            skin.taxels.depth_spread_percent = DEPTH_SPREAD_PERCENT;
        });
        SensorDesign { specimen }
    }

    /// Returns the design with a change.
    #[must_use]
    pub fn with(&self, change: impl FnOnce(&mut SkinSpec)) -> SensorDesign {
        SensorDesign { specimen: self.specimen.with(change) }
    }

    /// Returns the same design with another thickness of the layer.
    #[must_use]
    pub(crate) fn with_layer(&self, times: f64) -> SensorDesign {
        self.with(|skin| skin.elastomer.iter_mut().for_each(|elastomer| elastomer.depth_mm *= times))
    }

    /// Returns the positions of the units.
    pub fn layout(&self) -> &ArrayLayout {
        &self.specimen.layout
    }

    /// Returns the readings of one sensor of the design.
    pub fn read(&self, seed: u64, touches: &[Touch], purpose: &str) -> KnownReadings {
        KnownReadings::of(&mut self.specimen.skin(seed), touches, &mut stream(seed, 0, purpose))
    }

    /// Returns presses of one sensor of the design.
    pub fn calibration(&self, seed: u64, touches: &[Touch]) -> Result<Calibration, StudyError> {
        Ok(self.read(seed, touches, "calibration noise").calibration()?)
    }

    /// Returns new contacts of one sensor, at random places with random forces.
    pub fn test(&self, seed: u64, count: usize) -> KnownReadings {
        self.read(seed, &anywhere(count, FORCES_N, &mut stream(seed, 0, "test contacts")), "test noise")
    }

    /// Returns the prior from full calibrations of some sensors.
    pub fn prior(&self) -> Result<Prior, StudyError> {
        let full = (PRIOR_SEEDS..PRIOR_SEEDS + SENSORS).map(|seed| self.calibration(seed, &grid(SIDE)));
        let full = full.collect::<Result<Vec<Calibration>, StudyError>>()?;
        Prior::new(&full, Some(self.layout())).map_err(broken)
    }
}

/// Returns presses at some places.
pub(super) fn presses_at(places: &[Place]) -> Vec<Touch> {
    places.iter().map(|place| Touch { place: *place, force_n: CALIBRATION_N, second: None }).collect()
}

/// Returns presses at the centres of equal cells of the area.
pub(super) fn cells(columns: usize, rows: usize) -> Vec<Touch> {
    let range = Range { min: -HALF_MM, max: HALF_MM };
    presses_at(&cell_centres(range, range, columns, rows))
}

/// Returns the mean errors of a method, over the contacts that it solves.
pub(super) fn mean_errors(solver: &dyn Solver, test: &KnownReadings) -> MeanErrors {
    let mut workspace = Workspace::default();
    let (mut sum, mut count) = (MeanErrors::default(), 0.0f64);
    for (truth, outputs) in test.iter() {
        if let Ok(solved) = solver.solve(outputs, &mut workspace) {
            sum.location_mm += solved.place.distance_mm(truth.place);
            sum.force_n += truth.force_n.map_or(0.0, |force_n| (solved.force_n - force_n).abs());
            count += 1.0;
        }
    }
    let count = count.max(1.0);
    MeanErrors { location_mm: sum.location_mm / count, force_n: sum.force_n / count }
}
