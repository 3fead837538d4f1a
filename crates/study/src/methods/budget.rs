//! Number of calibration presses that each method needs.

use super::cramer_rao::MeanBound;
use super::specimen::{FORCES_N, FULL_SCALE_N, KnownReadings, NoiseReference, StudySpecimen, anywhere, grid};
use super::speed_accuracy::MethodTrial;
use super::trial::{CRAMER_RAO, MethodRow, StudiedMethod, Tally};
use crate::{OnProgress, StudyError, carried_out};
use palpate_core::quantity::round;
use palpate_core::quantity::{Place, stream};
use palpate_solver::{Calibration, Setting};
use rand::RngExt;

/// Name of the varied quantity in rows.
pub(super) const BUDGET: &str = "calibration presses";
/// Numbers of presses along a side of the square, the largest first because it takes longest.
pub(super) const SIDES: [usize; 8] = [25, 19, 13, 9, 7, 5, 4, 3];
/// Number of specimens. Each specimen is calibrated once with each number of presses. The second constant is the number of
/// contacts that test each calibration.
const SPECIMENS: usize = 6;
const TESTS: usize = 1000;
/// Sides, specimens and tests for a quick look.
const QUICK: (&[usize], usize, usize) = (&[7, 5, 3], 1, 60);
/// Time from one calibration press to the next, s. It is the median of `palpate study control` for places 0.5 mm apart, by the
/// strategy `map` on the fast bench, 10 mN.
pub const PRESS_S: f64 = 0.755;
/// Least number of recorded presses for a calibration. The second constant is the number of random choices for each number of
/// presses.
const FEWEST: usize = 9;
const CHOICES: usize = 3;
/// Differences between specimens: gains in %, depths in %, and places in mm.
const GAIN_SPREAD_PERCENT: f64 = 20.0;
const DEPTH_SPREAD_PERCENT: f64 = 5.0;
const PLACE_SPREAD_MM: f64 = 0.1;

/// Calibrates every method with fewer and fewer presses.
///
/// # Errors
/// Never in practice: simulated presses are suitable for calibration.
pub fn budget(quick: bool, seed: u64, on_progress: OnProgress<'_>) -> Result<Vec<MethodRow>, StudyError> {
    let (sides, specimens, tests) = if quick { QUICK } else { (&SIDES[..], SPECIMENS, TESTS) };
    let mut jobs = Vec::new();
    for &side in sides {
        for noise in NoiseReference::ALL {
            jobs.extend((0..specimens).map(|specimen| (noise, side, specimen)));
        }
    }
    let tried = carried_out(&jobs, on_progress, |&(noise, side, specimen)| {
        calibrate(noise, side, tests, seed.wrapping_add(specimen as u64))
    })?;
    let mut rows = Vec::new();
    for noise in NoiseReference::ALL {
        for &side in sides.iter().rev() {
            let of_it: Vec<&CalibrationResult> = jobs
                .iter()
                .zip(&tried)
                .filter(|((its, its_side, _), _)| (*its, *its_side) == (noise, side))
                .map(|(_, tried)| tried)
                .collect();
            rows.extend(StudiedMethod::names().enumerate().map(|(index, solver)| {
                let mut sum = Tally::default();
                of_it.iter().for_each(|tried| sum.add(tried.tallies[index].clone()));
                row(noise, side, solver, &sum, MeanBound::mean(of_it.iter().map(|tried| tried.least)))
            }));
        }
    }
    Ok(rows)
}

/// Calibrates every method with fewer and fewer of the recorded presses: all of them, half, a quarter and so on.
///
/// # Errors
/// Never in practice: if all presses are suitable for calibration, so is a part of them.
pub fn budget_of(
    trial: &MethodTrial,
    quick: bool,
    seed: u64,
    on_progress: OnProgress<'_>,
) -> Result<Vec<MethodRow>, StudyError> {
    let whole = trial.calibration.len();
    let counts: Vec<usize> = std::iter::successors(Some(whole), |count| Some(count / 2))
        .take_while(|count| *count == whole || *count >= FEWEST)
        .collect();
    let choices = if quick { 1 } else { CHOICES };
    let orders: Vec<Vec<usize>> = (0..choices)
        .map(|choice| {
            let first = stream(seed, choice as u64, "first press").random_range(0..whole);
            spread_out(&trial.calibration, first, counts.get(1).copied().unwrap_or(0))
        })
        .collect();
    let mut jobs: Vec<(usize, Option<&[usize]>)> = vec![(whole, None)];
    for &count in &counts[1..] {
        jobs.extend(orders.iter().map(|order| (count, Some(&order[..count]))));
    }
    let tried = carried_out(&jobs, on_progress, |(_, presses)| {
        let some = presses.map(|presses| trial.calibration.subset(presses));
        let calibration = some.as_ref().unwrap_or(&trial.calibration);
        let methods = StudiedMethod::all(calibration, &Setting::of_layout(trial.layout.as_ref()));
        Ok(methods.iter().map(|method| Tally::of(method, &trial.test)).collect::<Vec<Tally>>())
    })?;
    // that of Cramér and Rao doesn't depend on the calibration; one that a method states does
    let least = trial.least.filter(|(_, whose)| *whose == CRAMER_RAO);
    let mut rows = Vec::new();
    for &count in counts.iter().rev() {
        for (index, solver) in StudiedMethod::names().enumerate() {
            let mut sum = Tally::default();
            let of_it = jobs.iter().zip(&tried).filter(|((its_count, _), _)| *its_count == count);
            of_it.for_each(|(_, tallies)| sum.add(tallies[index].clone()));
            rows.push(MethodRow {
                study: "budget",
                scene: trial.scene.clone(),
                condition: BUDGET,
                value: count as f64,
                calibration_presses: count,
                ..sum.row(solver, least)
            });
        }
    }
    Ok(rows)
}

/// Returns `count` presses, beginning with the given one. Each is as far as possible from all earlier ones. So any number of the
/// first presses covers the complete area.
fn spread_out(calibration: &Calibration, first: usize, count: usize) -> Vec<usize> {
    let places: Vec<Place> = calibration.points().map(|point| point.place).collect();
    let mut nearest_mm = vec![f64::INFINITY; places.len()];
    let mut order = vec![first];
    while order.len() < count {
        let last = order[order.len() - 1];
        nearest_mm[last] = f64::NEG_INFINITY; // it isn't chosen again
        for (nearest_mm, place) in nearest_mm.iter_mut().zip(&places) {
            *nearest_mm = nearest_mm.min(place.distance_mm(places[last]));
        }
        let farthest = nearest_mm.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map(|(index, _)| index);
        order.extend(farthest);
    }
    order
}

/// Results of all methods for one calibration.
struct CalibrationResult {
    tallies: Vec<Tally>,
    least: Option<MeanBound>,
}

fn calibrate(noise: NoiseReference, side: usize, tests: usize, seed: u64) -> Result<CalibrationResult, StudyError> {
    let specimen = StudySpecimen::papers(noise).with(|skin| {
        skin.taxels.gain_spread_percent = GAIN_SPREAD_PERCENT;
        skin.taxels.place_spread_mm = PLACE_SPREAD_MM;
        skin.taxels.depth_spread_percent = DEPTH_SPREAD_PERCENT;
    });
    let mut skin = specimen.skin(seed);
    let presses = KnownReadings::of(&mut skin, &grid(side), &mut stream(seed, side as u64, "calibration noise"));
    let touches = anywhere(tests, FORCES_N, &mut stream(seed, 0, "test contacts"));
    let test = KnownReadings::of(&mut skin, &touches, &mut stream(seed, 0, "test noise"));
    let methods = StudiedMethod::all(&presses.calibration()?, &Setting::of_layout(Some(&specimen.layout)));
    Ok(CalibrationResult {
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

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_solver::CalibrationPoint;

    #[test]
    fn chosen_presses_cover_the_area_without_repeats() {
        let places: Vec<Place> = grid(5).iter().map(|touch| touch.place).collect();
        let twice = places.iter().chain(&places);
        let points: Vec<CalibrationPoint<'_>> =
            twice.map(|place| CalibrationPoint { place: *place, force_n: 1.0, outputs: &[1.0] }).collect();
        let calibration = Calibration::new(&points).unwrap();
        let order = spread_out(&calibration, 12, 50);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..50).collect::<Vec<_>>());
        let corners = order[1..5].iter().map(|&press| calibration.point(press).place);
        assert!(corners.into_iter().all(|place| place.x_mm.abs() + place.y_mm.abs() == 12.0), "{order:?}");
        let mut first: Vec<usize> = order[..25].iter().map(|press| press % 25).collect();
        first.sort_unstable();
        assert_eq!(first, (0..25).collect::<Vec<_>>(), "every place before any a second time");
    }
}
