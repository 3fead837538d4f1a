//! Two contacts at once: how often both are found, by separation, noise and taxels.

use super::specimen::VectorSpecimen;
use super::{VectorSize, median_us, taxels};
use crate::methods::specimen::HALF_MM;
use crate::{OnProgress, StudyError, carried_out};
use palpate_core::quantity::{Place, RandomStream, round, stream};
use palpate_solver::two::{Pair, TwoContacts};
use palpate_solver::vector::{PairShares, VectorMap, VectorWorkspace};
use rand::RngExt;
use serde::Serialize;
use std::f64::consts::TAU;
use std::time::Instant;

/// What became of pairs of contacts under one condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TwoRow {
    /// Always `two-contacts`.
    pub study: &'static str,
    /// `T`, the noise of Table 1, or `1 mV`.
    pub scene: &'static str,
    /// `three axes` or `normal`.
    pub taxels: &'static str,
    /// Whether the map is exact; otherwise it is calibrated.
    pub is_true_map: bool,
    /// Calibration places along a side.
    pub places: usize,
    /// Distance of the two contacts.
    pub separation_mm: f64,
    /// Fraction of pairs whose places are both within 1 mm, and whose forces are within 0.1 N.
    pub right: f64,
    /// Fraction called not separable that isn't right.
    pub not_separable: f64,
    /// Fraction called two that isn't right.
    pub wrong: f64,
    /// Fraction called one.
    pub called_one: f64,
    /// Median of the least root mean square error of a place (Cramer-Rao).
    pub location_bound_mm: f64,
    /// Measured median time of a solve.
    pub us_per_solve: f64,
}

const SEPARATIONS_MM: [f64; 7] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0];
/// Force of each contact, N.
const FORCE_N: f64 = 0.5;
/// Noise of 1 mV at 1 V for each newton, reading units.
const QUIET_SD: f64 = 0.001;
/// Calibration places along a side of a small calibration.
const FEW: usize = 9;

/// Solves pairs of contacts of 0.5 N at each separation.
///
/// # Errors
/// Never in practice: simulated presses are suitable for calibration.
pub fn two_contacts(size: VectorSize, seed: u64, on_progress: OnProgress<'_>) -> Result<Vec<TwoRow>, StudyError> {
    let mut jobs = Vec::new();
    for (scene, noise_sd) in [("T", None), ("1 mV", Some(QUIET_SD))].into_iter().take(if size.all { 2 } else { 1 }) {
        for channels in [3, 1] {
            let all = [(false, size.side), (false, FEW), (true, 0)].into_iter().take(if size.all { 3 } else { 1 });
            jobs.extend(all.map(|(is_true_map, side)| (scene, noise_sd, channels, is_true_map, side)));
        }
    }
    let rows = carried_out(&jobs, on_progress, |&(scene, noise_sd, channels, is_true_map, side)| {
        let mut specimen = VectorSpecimen::new(3, channels, noise_sd, seed);
        let known = specimen.known();
        let map: VectorMap = if is_true_map { known.clone() } else { specimen.calibrated(side, false)? };
        let two = TwoContacts::new(map);
        let each = size.of(&SEPARATIONS_MM).into_iter().map(|separation_mm| {
            let row = found(&mut specimen, &two, &known, separation_mm, size.tests, seed);
            TwoRow { scene, taxels: taxels(channels), is_true_map, places: side, ..row }
        });
        Ok(each.collect::<Vec<TwoRow>>())
    })?;
    Ok(rows.concat())
}

fn found(
    specimen: &mut VectorSpecimen,
    two: &TwoContacts,
    known: &VectorMap,
    separation_mm: f64,
    tests: usize,
    seed: u64,
) -> TwoRow {
    let (mut workspace, mut rng) = (VectorWorkspace::default(), stream(seed, 0, "two contacts"));
    let (mut bounds_mm, mut times_s) = (Vec::with_capacity(tests), Vec::with_capacity(tests));
    let shares = PairShares::of((0..tests).map(|_| {
        let places = apart(separation_mm, &mut rng);
        let outputs = specimen.read(&places.map(|place| (place, [0.0, 0.0, FORCE_N])), &mut rng);
        let began = Instant::now();
        let answer = two.solve(&outputs, &mut workspace);
        times_s.push(began.elapsed().as_secs_f64());
        bounds_mm.push(Pair::bound(known, places, [FORCE_N; 2]).map_or(f64::INFINITY, |bound| bound.errors_mm[0]));
        (answer, places, [FORCE_N; 2])
    }));
    bounds_mm.sort_by(f64::total_cmp);
    TwoRow {
        study: "two-contacts",
        scene: "",
        taxels: "",
        is_true_map: false,
        places: 0,
        separation_mm,
        right: round(shares.right, 4),
        not_separable: round(shares.not_separable, 4),
        wrong: round(shares.wrong, 4),
        called_one: round(shares.one, 4),
        location_bound_mm: round(bounds_mm.get(tests / 2).copied().unwrap_or(f64::NAN), 4),
        us_per_solve: median_us(times_s),
    }
}

/// Returns two random places at a distance, both in the area.
fn apart(distance_mm: f64, rng: &mut RandomStream) -> [Place; 2] {
    loop {
        let [x_mm, y_mm] = [(); 2].map(|()| rng.random_range(-HALF_MM..=HALF_MM));
        let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
        let second = Place::new(x_mm + distance_mm * cos, y_mm + distance_mm * sin);
        if second.x_mm.abs() <= HALF_MM && second.y_mm.abs() <= HALF_MM {
            return [Place::new(x_mm, y_mm), second];
        }
    }
}
