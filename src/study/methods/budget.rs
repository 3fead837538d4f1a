//! How many calibration presses each method needs.

use super::cramer_rao::MeanBound;
use super::specimen::{FORCES_N, FULL_SCALE_N, KnownReadings, NoiseReference, Specimen, anywhere, grid};
use super::trial::{CRAMER_RAO, Method, MethodRow, Tally};
use crate::dataset::round;
use crate::quantity::stream;
use crate::solver::Setting;
use crate::study::{StudyError, Told, carried_out};

/// What is varied, as it stands in rows.
pub const BUDGET: &str = "calibration presses";
/// Presses along a side of the square, the most first: they take longest.
pub const SIDES: [usize; 8] = [25, 19, 13, 9, 7, 5, 4, 3];
/// Specimens, each calibrated once with each number of presses, and contacts that each calibration is tested with.
const SPECIMENS: usize = 6;
const TESTS: usize = 1000;
/// The same for a first look.
const QUICK: (&[usize], usize, usize) = (&[7, 5, 3], 1, 60);
/// From one calibration press to the next, s: the median of `palpate study control` for places 0.5 mm apart, by the strategy
/// `map` on the fast bench, 10 mN.
pub const PRESS_S: f64 = 0.755;
/// How one specimen differs from the next: gains % and depths %, and places mm.
const GAIN_SPREAD_PERCENT: f64 = 20.0;
const DEPTH_SPREAD_PERCENT: f64 = 5.0;
const PLACE_SPREAD_MM: f64 = 0.1;

/// Calibrates every method with ever fewer presses.
///
/// # Errors
/// None in practice: simulated presses can be calibrated on.
pub fn budget(quick: bool, seed: u64, told: Told<'_>) -> Result<Vec<MethodRow>, StudyError> {
    let (sides, specimens, tests) = if quick { QUICK } else { (&SIDES[..], SPECIMENS, TESTS) };
    let mut jobs = Vec::new();
    for &side in sides {
        for noise in NoiseReference::ALL {
            jobs.extend((0..specimens).map(|specimen| (noise, side, specimen)));
        }
    }
    let tried = carried_out(&jobs, told, |&(noise, side, specimen)| {
        calibrate(noise, side, tests, seed.wrapping_add(specimen as u64))
    })?;
    let mut rows = Vec::new();
    for noise in NoiseReference::ALL {
        for &side in sides.iter().rev() {
            let of_it: Vec<&Tried> = jobs
                .iter()
                .zip(&tried)
                .filter(|((its, its_side, _), _)| (*its, *its_side) == (noise, side))
                .map(|(_, tried)| tried)
                .collect();
            rows.extend(Method::names().enumerate().map(|(index, solver)| {
                let mut sum = Tally::default();
                of_it.iter().for_each(|tried| sum.add(tried.tallies[index].clone()));
                row(noise, side, solver, &sum, MeanBound::mean(of_it.iter().map(|tried| tried.least)))
            }));
        }
    }
    Ok(rows)
}

/// What every method made of one calibration.
struct Tried {
    tallies: Vec<Tally>,
    least: Option<MeanBound>,
}

fn calibrate(noise: NoiseReference, side: usize, tests: usize, seed: u64) -> Result<Tried, StudyError> {
    let specimen = Specimen::papers(noise).with(|skin| {
        skin.taxels.gain_spread_percent = GAIN_SPREAD_PERCENT;
        skin.taxels.place_spread_mm = PLACE_SPREAD_MM;
        skin.taxels.depth_spread_percent = DEPTH_SPREAD_PERCENT;
    });
    let mut skin = specimen.skin(seed);
    let presses = KnownReadings::of(&mut skin, &grid(side), &mut stream(seed, side as u64, "calibration noise"));
    let touches = anywhere(tests, FORCES_N, &mut stream(seed, 0, "test contacts"));
    let test = KnownReadings::of(&mut skin, &touches, &mut stream(seed, 0, "test noise"));
    let methods = Method::all(&presses.calibration()?, &Setting::of_layout(Some(&specimen.layout)));
    Ok(Tried {
        tallies: methods.iter().map(|method| Tally::of(method, &test)).collect(),
        least: MeanBound::over(&skin, &specimen.skin, FULL_SCALE_N, &test),
    })
}

fn row(noise: NoiseReference, side: usize, solver: &'static str, sum: &Tally, least: Option<MeanBound>) -> MethodRow {
    let presses = side * side;
    MethodRow {
        study: "budget",
        scene: noise.name().to_owned(),
        condition: BUDGET,
        value: presses as f64,
        calibration_presses: presses,
        minutes: Some(round(presses as f64 * PRESS_S / 60.0, 3)),
        ..sum.row(solver, least.map(|least| (least, CRAMER_RAO)))
    }
}
