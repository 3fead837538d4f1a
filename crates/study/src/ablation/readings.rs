//! Readings of a specimen without a rig: a calibration and its test, and the staircases of Table 1.

use super::{AblationSize, TermModel};
use crate::StudyError;
use crate::methods::specimen::{FORCES_N, KnownContact, KnownReadings, Touch, anywhere, grid};
use palpate_control::Branch;
use palpate_core::quantity::{Place, RandomStream, stream};
use palpate_data::dataset::characteristics::{HeldLevel, Repeatability, Staircases, UnitCharacteristics, characterise};
use palpate_run::rig::RigSpec;
use palpate_sim::scene::Skin;
use palpate_solver::{ForceRule, Pearson, Setting, SolveError, Solver as _, Workspace, fit};
use rand::RngExt;
use rand::distr::Distribution;
use rand_distr::StandardNormal;

/// Time from one press to the next, s, of a calibration and of the paper's 100 test presses. It is the time that the base's own
/// loop takes.
const PRESS_S: f64 = 1.1;
const PAPERS_TESTS: f64 = 100.0;
/// Staircases of the paper: height of a step, N; number of steps; number of repetitions; rest of the specimen between them, s.
const STEP_N: f64 = 0.5;
const STEPS: usize = 4;
const REPEATS: usize = 5;
const REST_S: f64 = 300.0;
/// Time over which the load cell's conversions are averaged, s.
const WINDOW_S: f64 = 0.1;
const HOUR_S: f64 = 3600.0;

/// Returns mean location (mm) and force (N) errors of the paper's method, the surrogate and the physics solver.
pub(super) fn methods(
    model: &TermModel,
    rig: &RigSpec,
    size: AblationSize,
    seed: u64,
) -> Result<[Option<f64>; 6], StudyError> {
    let layout = &rig.array.layout;
    let mut specimen = RepeatedSpecimen::new(model, rig, seed);
    let presses = specimen.readings(&grid(size.side), PRESS_S);
    // as long as the paper's, for any number
    let each_s = PRESS_S * PAPERS_TESTS / size.tests as f64;
    let test = specimen.readings(&anywhere(size.tests, FORCES_N, &mut stream(seed, 0, "test contacts")), each_s);
    let (calibration, setting) = (presses.calibration()?, Setting::of_layout(Some(layout)));
    let mut workspace = Workspace::default();
    // as in the paper: without the cross-validation for stated errors, and with every unit, where `fit` leaves out one that seems
    // saturated, which can happen on a coarse grid without noise
    let papers = Pearson::fit(&calibration, setting.layout, ForceRule::ClosestUnit).ok();
    let of_papers = papers.and_then(|papers| mean_errors(&test, |outputs| papers.contact(outputs, &mut workspace)));
    let [surrogate, physics] = ["surrogate", "physics"].map(|name| {
        let solver = fit(name, &calibration, &setting).ok()?;
        mean_errors(&test, |outputs| {
            solver.solve(outputs, &mut workspace).map(|solution| (solution.place, solution.force_n))
        })
    });
    let parts = [of_papers, surrogate, physics].map(|errors| [errors.map(|(mm, _)| mm), errors.map(|(_, n)| n)]);
    Ok([parts[0][0], parts[0][1], parts[1][0], parts[1][1], parts[2][0], parts[2][1]])
}

/// Mean location and force errors. `None` unless every reading has an answer, because a mean over fewer readings would be for
/// other contacts.
fn mean_errors(
    test: &KnownReadings,
    mut solve: impl FnMut(&[f64]) -> Result<(Place, f64), SolveError>,
) -> Option<(f64, f64)> {
    let (mut location_mm, mut error_n) = (0.0, 0.0);
    for (truth, outputs) in test.iter() {
        let (place, force_n) = solve(outputs).ok()?;
        location_mm += place.distance_mm(truth.place);
        error_n += (force_n - truth.force_n?).abs();
    }
    let count = test.truths.len() as f64;
    Some((location_mm / count, error_n / count))
}

/// Returns repeatability while loading and while unloading, and hysteresis: means over units, % of full scale.
pub(super) fn table_1(model: &TermModel, rig: &RigSpec, seed: u64) -> [Option<f64>; 3] {
    let places = rig.array.layout.places();
    let mut specimen = RepeatedSpecimen::new(model, rig, seed);
    let readings = places
        .iter()
        .enumerate()
        .map(|(unit, &place)| (0..REPEATS).flat_map(|_| specimen.staircase(unit, place)).collect::<Vec<HeldLevel>>());
    let readings: Vec<_> = readings.collect();
    let units = (0..readings.len()).collect();
    let staircases = Staircases { readings, units, left_out: 0 };
    let units = characterise(&staircases, Repeatability::default());
    let mean = |of: fn(&UnitCharacteristics) -> Option<f64>| {
        Some(units.iter().map(of).sum::<Option<f64>>()? / units.len() as f64)
    };
    [
        mean(|unit| unit.repeatability_loading_percent),
        mean(|unit| unit.repeatability_unloading_percent),
        mean(|unit| unit.hysteresis_percent),
    ]
}

/// Specimen that is pressed repeatedly. Each term draws from its own random stream. So a try without a term draws the same values
/// for all other terms.
struct RepeatedSpecimen<'a> {
    model: &'a TermModel,
    skin: Skin,
    grain_mm: f64,
    full_scale_n: f64,
    /// Standard deviation of the load cell's mean over a window, N.
    cell_sd_n: f64,
    /// Drift of each unit's zero, reading units.
    zeros: Vec<f64>,
    /// Error of each unit at this contact, as a fraction of its reading.
    shares: Vec<f64>,
    noise: RandomStream,
    noise_of_reading: RandomStream,
    reached: RandomStream,
    drift: RandomStream,
    cell: RandomStream,
}

impl<'a> RepeatedSpecimen<'a> {
    fn new(model: &'a TermModel, rig: &RigSpec, seed: u64) -> Self {
        let (layout, full_scale_n) = (&rig.array.layout, rig.limits.force_n);
        let conversions = (WINDOW_S * rig.load_cell.conversions_hz).max(1.0);
        RepeatedSpecimen {
            model,
            skin: Skin::new(&model.scene.skin, layout, full_scale_n, seed),
            grain_mm: model.scene.stage.map_or(0.0, |stage| stage.quantum_mm),
            full_scale_n,
            cell_sd_n: model.scene.load_cell.map_or(0.0, |cell| cell.noise_n) / conversions.sqrt(),
            zeros: vec![0.0; layout.len()],
            shares: vec![0.0; layout.len()],
            noise: stream(seed, 0, "taxel noise"),
            noise_of_reading: stream(seed, 0, "noise of reading"),
            reached: stream(seed, 0, "force reached"),
            drift: stream(seed, 0, "drift of zeros"),
            cell: stream(seed, 0, "load cell noise"),
        }
    }

    /// Returns the readings of some touches, at intervals of `each_s` seconds. The truth is the requested contact.
    fn readings(&mut self, touches: &[Touch], each_s: f64) -> KnownReadings {
        let units = self.skin.len();
        let mut outputs = vec![0.0; units * touches.len()];
        for (touch, outputs) in touches.iter().zip(outputs.chunks_exact_mut(units)) {
            self.slow_drift(each_s);
            self.touch();
            let force_n = self.reached_n(touch.force_n);
            self.read(touch.place, force_n, 0.0, outputs);
        }
        let truth = |touch: &Touch| KnownContact { place: touch.place, force_n: Some(touch.force_n), second: None };
        KnownReadings { units, truths: touches.iter().map(truth).collect(), outputs }
    }

    /// Returns one staircase above a unit after a rest: zero, up to full scale and back, in one contact.
    fn staircase(&mut self, unit: usize, place: Place) -> Vec<HeldLevel> {
        self.slow_drift(REST_S);
        let mut outputs = vec![0.0; self.skin.len()];
        let level =
            |step: usize| (step.min(2 * STEPS - step), if step <= STEPS { Branch::Loading } else { Branch::Unloading });
        let mut held = Vec::with_capacity(2 * STEPS + 1);
        for (steps, branch) in (0..=2 * STEPS).map(level) {
            let force_set_n = STEP_N * steps as f64;
            if steps == 0 {
                // without load no level is reached, and a contact has no error
                self.skin.forget_contact();
                self.shares.fill(0.0);
            } else if steps == 1 && branch == Branch::Loading {
                self.touch();
            }
            let true_n = if steps == 0 { 0.0 } else { self.reached_n(force_set_n) };
            let unloading = if branch == Branch::Unloading { 1.0 } else { 0.0 };
            self.read(place, true_n, unloading, &mut outputs);
            let force_n = true_n + self.cell_sd_n * normal(&mut self.cell);
            let top_n = STEP_N * STEPS as f64;
            held.push(HeldLevel { place, top_n, branch, force_set_n, force_n, output: outputs[unit] });
        }
        held
    }

    /// Advances the time.
    fn slow_drift(&mut self, for_s: f64) {
        let sd = self.model.drift_percent / 100.0 * self.full_scale_n * (for_s / HOUR_S).sqrt();
        for zero in self.zeros.iter_mut().filter(|_| sd > 0.0) {
            *zero += sd * normal(&mut self.drift);
        }
    }

    /// Begins a contact.
    fn touch(&mut self) {
        self.skin.draw_contact(&mut self.noise);
        if let Some(percents) = &self.model.noise_of_reading_percent {
            for (share, percent) in self.shares.iter_mut().zip(percents) {
                *share = percent / 3.0 / 100.0 * normal(&mut self.noise_of_reading);
            }
        }
    }

    /// Force that the loop reaches for a requested force, N.
    fn reached_n(&mut self, force_n: f64) -> f64 {
        let within_n = self.model.force_tolerance_n;
        if within_n == 0.0 { force_n } else { force_n + self.reached.random_range(-within_n..=within_n) }
    }

    fn read(&mut self, asked: Place, force_n: f64, unloading: f64, outputs: &mut [f64]) {
        let to_grain = |mm: f64| if self.grain_mm > 0.0 { (mm / self.grain_mm).round() * self.grain_mm } else { mm };
        let place = Place::new(to_grain(asked.x_mm), to_grain(asked.y_mm));
        outputs.fill(0.0);
        self.skin.add_load(force_n, place, outputs);
        for ((output, share), zero) in outputs.iter_mut().zip(&self.shares).zip(&self.zeros) {
            *output += share * *output + zero;
        }
        self.skin.read_out(unloading, outputs);
    }
}

fn normal(rng: &mut RandomStream) -> f64 {
    StandardNormal.sample(rng)
}

#[cfg(test)]
mod tests {
    use super::super::TERMS;
    use super::*;

    fn with(name: &str, base: &TermModel, on: bool) -> TermModel {
        TERMS.iter().find(|term| term.name == name).unwrap().set(base, on)
    }

    /// A calibration's readings, one row of outputs after another.
    fn outputs(model: &TermModel, rig: &RigSpec, seed: u64) -> Vec<f64> {
        RepeatedSpecimen::new(model, rig, seed).readings(&grid(5), PRESS_S).outputs
    }

    #[test]
    fn trial_with_a_term_has_the_other_random_values_of_the_one_without() {
        let (base, rig) = TermModel::base().unwrap();
        let unrounded = with("converter", &base, false);
        let silent = with("taxel noise", &unrounded, false);
        let noise = |on: &dyn Fn(&TermModel) -> TermModel| -> Vec<f64> {
            let pair = [&unrounded, &silent].map(|model| outputs(&on(model), &rig, 3));
            pair[0].iter().zip(&pair[1]).map(|(noisy, silent)| noisy - silent).collect()
        };
        let plain = noise(&TermModel::clone);
        assert!(plain.iter().all(|error| *error != 0.0));
        for term in TERMS.iter().filter(|term| term.touches(super::super::Touches::Methods) && !term.in_base) {
            let found = noise(&|model| term.set(model, true));
            let differs = found.iter().zip(&plain).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(differs < 1e-12, "{}: other noise by {differs}", term.name);
        }
        assert_ne!(outputs(&unrounded, &rig, 3), outputs(&unrounded, &rig, 4));
    }

    #[test]
    fn each_term_of_the_readings_changes_them() {
        let (base, rig) = TermModel::base().unwrap();
        let plain = outputs(&base, &rig, 1);
        for term in TERMS.iter().filter(|term| term.touches(super::super::Touches::Methods)) {
            // 1 N on a grid of 3 mm is on the stage's grain
            assert_eq!(outputs(&term.other_than(&base), &rig, 1) == plain, term.name == "stage grain", "{}", term.name);
        }
        let anywhere = |model: &TermModel| {
            let touches = anywhere(20, FORCES_N, &mut stream(1, 0, "test contacts"));
            RepeatedSpecimen::new(model, &rig, 1).readings(&touches, 1.0).outputs
        };
        let unrounded = with("converter", &base, false);
        assert_ne!(anywhere(&with("stage grain", &unrounded, true)), anywhere(&unrounded));
    }

    #[test]
    fn zero_drifts_by_its_declared_amount_after_an_hour() {
        let (base, rig) = TermModel::base().unwrap();
        let drifting = with("drift of zeros", &base, true);
        let after = |seed: u64, pieces: u32| {
            let mut specimen = RepeatedSpecimen::new(&drifting, &rig, seed);
            (0..pieces).for_each(|_| specimen.slow_drift(HOUR_S / f64::from(pieces)));
            specimen.zeros
        };
        for pieces in [1, 16] {
            let zeros: Vec<f64> = (0..400).flat_map(|seed| after(seed, pieces)).collect();
            let sd = (zeros.iter().map(|zero| zero * zero).sum::<f64>() / zeros.len() as f64).sqrt();
            assert!((sd / 0.02 - 1.0).abs() < 0.05, "{sd} in {pieces} pieces, not 1 % of 2 N");
        }
    }

    #[test]
    fn simulated_table_1_equals_its_noise_and_hysteresis() {
        let (base, rig) = TermModel::base().unwrap();
        let mean = |of: usize| (0..40).filter_map(|seed| table_1(&base, &rig, seed)[of]).sum::<f64>() / 40.0;
        // three standard deviations of five repeats are 0.94 of the true three
        let (papers, known) = (17.41 / 9.0, 0.94);
        assert!((mean(0) / papers / known - 1.0).abs() < 0.06, "{}", mean(0));
        assert!((mean(2) / (34.90 / 9.0) - 1.0).abs() < 0.02, "{}", mean(2));
        let quiet = with("hysteresis", &with("taxel noise", &base, false), false);
        let [loading, unloading, hysteresis] = table_1(&quiet, &rig, 1).map(Option::unwrap);
        assert!(loading.max(unloading).max(hysteresis) < 0.1, "{loading} {unloading} {hysteresis}");
    }
}
