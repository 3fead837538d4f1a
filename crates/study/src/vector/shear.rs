//! Errors of place and force vector against noise, number of units and number of calibration places.

use super::specimen::VectorSpecimen;
use super::{VectorSize, median_us, taxels};
use crate::methods::specimen::{FORCES_N, HALF_MM};
use crate::{OnProgress, StudyError, carried_out};
use palpate_core::quantity::{Place, round, stream};
use palpate_solver::vector::{Shear, USUAL_SHEAR_SHARE, VectorWorkspace};
use rand::RngExt;
use serde::Serialize;
use std::f64::consts::TAU;
use std::time::Instant;

/// Errors under one condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShearRow {
    /// Always `shear`.
    pub study: &'static str,
    /// What is varied: `noise`, `units` along a side, or calibration `places` along a side.
    pub condition: &'static str,
    /// Its value; for the noise a standard deviation as a fraction of the reading of 1 N straight above.
    pub value: f64,
    /// `three axes` or `normal`.
    pub taxels: &'static str,
    /// Mean location error, mm.
    pub location_error_mm: f64,
    /// Mean error of the force into the specimen, N.
    pub press_error_n: f64,
    /// Mean error of the shear vector, N. A shear that isn't determinable counts as an answer of none.
    pub shear_error_n: f64,
    /// Least mean location error of an unbiased method that knows the array, mm (Cramer-Rao).
    pub location_bound_mm: f64,
    /// Least mean error of the force into the specimen, N.
    pub press_bound_n: f64,
    /// Least mean error of the shear vector, N.
    pub shear_bound_n: f64,
    /// Fraction of the contacts whose shear isn't determinable.
    pub not_determinable: f64,
    /// Measured median time of a solve.
    pub us_per_solve: f64,
}

/// Mean noise of the paper's Table 1, and the noises, units and places that are studied.
const NOISE_SD: f64 = 0.0129;
const NOISES_SD: [f64; 6] = [0.001, 0.002, 0.005, NOISE_SD, 0.025, 0.05];
const UNITS: [usize; 4] = [2, 3, 4, 5];
const PLACES: [usize; 6] = [4, 5, 7, 9, 13, 25];

struct ShearTry {
    condition: &'static str,
    value: f64,
    channels: usize,
    noise_sd: f64,
    units: usize,
    side: usize,
}

/// Solves random contacts with a shear of up to half the press under each condition.
///
/// # Errors
/// Never in practice: simulated presses are suitable for calibration.
pub fn shear(size: VectorSize, seed: u64, on_progress: OnProgress<'_>) -> Result<Vec<ShearRow>, StudyError> {
    let mut jobs = Vec::new();
    for channels in [3, 1] {
        let base =
            |condition, value| ShearTry { condition, value, channels, noise_sd: NOISE_SD, units: 3, side: size.side };
        jobs.extend(size.of(&NOISES_SD).into_iter().map(|sd| ShearTry { noise_sd: sd, ..base("noise", sd) }));
        jobs.extend(size.of(&UNITS).into_iter().map(|units| ShearTry { units, ..base("units", units as f64) }));
        jobs.extend(
            size.of(if size.all { &PLACES } else { &PLACES[..4] })
                .into_iter()
                .map(|side| ShearTry { side, ..base("places", side as f64) }),
        );
    }
    carried_out(&jobs, on_progress, |job| job.row(size.tests, seed))
}

impl ShearTry {
    fn row(&self, tests: usize, seed: u64) -> Result<ShearRow, StudyError> {
        let mut specimen = VectorSpecimen::new(self.units, self.channels, Some(self.noise_sd), seed);
        let (map, known) = (specimen.calibrated(self.side, true)?, specimen.known());
        let (mut workspace, mut rng) = (VectorWorkspace::default(), stream(seed, 0, "vector contacts"));
        let (mut errors, mut bounds, mut unknown, mut times_s) = ([0.0; 3], [0.0; 3], 0.0, Vec::with_capacity(tests));
        for _ in 0..tests {
            let [x_mm, y_mm] = [(); 2].map(|()| rng.random_range(-HALF_MM..=HALF_MM));
            let (place, press_n) = (Place::new(x_mm, y_mm), rng.random_range(FORCES_N.0..=FORCES_N.1));
            // evenly over a disc
            let shear_n = USUAL_SHEAR_SHARE * press_n * f64::sqrt(rng.random_range(0.0..=1.0));
            let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
            let force_n = [shear_n * cos, shear_n * sin, press_n];
            let outputs = specimen.read(&[(place, force_n)], &mut rng);
            let began = Instant::now();
            let solved = map.solve(&outputs, &mut workspace);
            times_s.push(began.elapsed().as_secs_f64());
            let Ok(contact) = solved else { continue };
            let [x_n, y_n] = match contact.shear {
                Shear::Force(shear_n) => shear_n,
                Shear::NotDeterminable { .. } => [0.0; 2],
            };
            unknown += f64::from(u8::from(matches!(contact.shear, Shear::NotDeterminable { .. })));
            let off_n = (x_n - force_n[0]).hypot(y_n - force_n[1]);
            let off = [contact.place.distance_mm(place), (contact.press_n - press_n).abs(), off_n];
            // where the units determine nothing there is no bound
            let bound = known.bound(place, force_n).map_or([f64::NAN; 3], |bound| bound.mean_errors());
            errors.iter_mut().zip(off).for_each(|(sum, off)| *sum += off);
            bounds.iter_mut().zip(bound).for_each(|(sum, bound)| *sum += bound);
        }
        let mean = |sum: f64, digits: i32| round(sum / tests as f64, digits);
        Ok(ShearRow {
            study: "shear",
            condition: self.condition,
            value: self.value,
            taxels: taxels(self.channels),
            location_error_mm: mean(errors[0], 4),
            press_error_n: mean(errors[1], 5),
            shear_error_n: mean(errors[2], 5),
            location_bound_mm: mean(bounds[0], 4),
            press_bound_n: mean(bounds[1], 5),
            shear_bound_n: mean(bounds[2], 5),
            not_determinable: mean(unknown, 4),
            us_per_solve: median_us(times_s),
        })
    }
}
