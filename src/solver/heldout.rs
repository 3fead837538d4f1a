//! Calibration presses held out and solved, as trials of a method.

use super::response::Response;
use super::{Calibration, FitError, Locate, Located, Setting, SolveError, Workspace};
use crate::quantity::{Place, stream};
use rand::distr::Distribution;
use rand_distr::StandardNormal;

/// A calibration press, made as if of another force, solved by a method that was fitted without its place.
pub(super) struct HeldPress {
    /// Where it was pressed.
    pub place: Place,
    /// The force it stands for, N.
    pub force_n: f64,
    /// What the method said.
    pub answer: Result<Located, SolveError>,
}

/// In how many parts the places of a calibration are held out, one part at a time.
const FOLDS: usize = 5;

/// The fewest places of which some can be held out.
const FEWEST_PLACES: usize = 9;

/// How many forces each press stands for.
const FORCES_A_PRESS: usize = 2;

/// The most presses that are tried; of more, some.
const MOST_PRESSES: usize = 1000;

/// Tries a method on a calibration, the force unknown to it: presses that were held out are rescaled over the forces to come, and
/// noise is added to bring what was scaled down back to what `response` measured.
///
/// Empty where the calibration has too few places to hold any out.
pub(super) fn trials(
    calibration: &Calibration,
    setting: &Setting<'_>,
    response: &Response,
    fit: impl Fn(&Calibration) -> Result<Box<dyn Locate>, FitError>,
) -> Result<Vec<HeldPress>, FitError> {
    let mut spots = calibration.by_place();
    if spots.len() < FEWEST_PLACES {
        return Ok(Vec::new());
    }
    let mut rng = stream(0, 0, "held-out presses");
    shuffle(&mut spots, &mut rng);
    let (least, most) = setting.shares(calibration);
    let mut trials = Vec::new();
    let mut workspace = Workspace::default();
    let mut reading = vec![0.0; calibration.units()];
    for fold in 0..FOLDS {
        let is_held = |spot: usize| spot % FOLDS == fold;
        let of =
            |held: bool| spots.iter().enumerate().filter(move |(i, _)| is_held(*i) == held).flat_map(|(_, spot)| spot);
        let method = fit(&calibration.subset(&of(false).copied().collect::<Vec<_>>()))?;
        for (index, &press) in of(true).enumerate().take(MOST_PRESSES / FOLDS) {
            let point = calibration.point(press);
            for part in 0..FORCES_A_PRESS {
                // evenly over the forces, whatever the order of the presses
                let quantile = (index as f64 * GOLDEN_SHARE + part as f64 / FORCES_A_PRESS as f64).fract();
                let share = least + (most - least) * quantile;
                for (unit, (reading, output)) in reading.iter_mut().zip(point.outputs).enumerate() {
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    *reading = share * output + response.missing_noise(unit, share) * normal;
                }
                let answer = method.locate(&reading, &mut workspace);
                trials.push(HeldPress { place: point.place, force_n: share * point.force_n, answer });
            }
        }
    }
    Ok(trials)
}

/// The golden section: its multiples fill the unit interval evenly, however many there are.
pub(super) const GOLDEN_SHARE: f64 = 0.618_033_988_749_894_9;

/// Brings a list into random order (Fisher and Yates).
fn shuffle<T>(list: &mut [T], rng: &mut impl rand::Rng) {
    for last in (1..list.len()).rev() {
        let other = (rng.next_u64() % (last as u64 + 1)) as usize;
        list.swap(last, other);
    }
}
