//! Few presses of a new sensor, with the prior of its design.
//!
//! The sensors are simulated: the paper's array under a bonded layer, with the noise of its Table 1. They differ in the gain, the
//! place and the depth of each unit. The prior is made from full calibrations of other sensors. [`presses`] finds the error as a
//! function of the number of presses, [`foreign sensors`] whether sensors that aren't of the design are found, and [`verdicts`] whether
//! few presses decide like a full calibration.

mod design;
mod figure;
mod foreign_sensors;
mod presses;
mod verdicts;

pub use design::SensorDesign;
pub use figure::few_figures;
pub use foreign_sensors::ForeignSensor;
pub use foreign_sensors::{ForeignSensorRow, foreign_sensors};
pub use presses::{FewRow, Way, presses};
pub use verdicts::{VerdictRow, verdicts};

use super::StudyError;

/// Size of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FewSize {
    /// Number of new sensors with each number of presses.
    pub sensors: usize,
    /// Number of new sensors that are calibrated without a prior, which takes longer.
    pub without: usize,
    /// Number of new contacts on each sensor.
    pub tests: usize,
    /// Number of good sensors in the search for foreign sensors.
    pub good: usize,
    /// Number of foreign sensors of each kind.
    pub foreign_sensors: usize,
    /// Number of sensors that are judged.
    pub judged: usize,
}

impl FewSize {
    /// Complete study.
    pub const WHOLE: FewSize =
        FewSize { sensors: 150, without: 20, tests: 300, good: 1000, foreign_sensors: 100, judged: 1000 };
    /// Small study for a first look, and for tests. Its numbers mean little.
    pub const QUICK: FewSize = FewSize { sensors: 6, without: 1, tests: 100, good: 20, foreign_sensors: 4, judged: 10 };
}

/// First seeds of the sensors that make the prior, of the new sensors, of the good ones and foreign sensors, and of the judged ones.
const PRIOR_SEEDS: u64 = 0;
const NEW_SEEDS: u64 = 1000;
const GOOD_SEEDS: u64 = 10_000;
const JUDGED_SEEDS: u64 = 20_000;

/// Returns an error for a study that can't be made.
fn broken(why: impl std::fmt::Display) -> StudyError {
    StudyError::Broken { seed: PRIOR_SEEDS, why: why.to_string() }
}

#[cfg(test)]
mod tests {
    use super::design::{SIDE, cells, mean_errors};
    use super::*;
    use crate::methods::NoiseReference;
    use crate::methods::specimen::{DEPTH_MM, Touch, grid};
    use palpate_core::quantity::Place;
    use palpate_sim::scene::Elastomer;
    use palpate_solver::{BEST, Belongs, ContactVerdict, Prior, Setting, Solver as _, Update, Workspace, fit};
    use palpate_testing::campaign;

    /// What the noise is a share of: a prior takes seconds, so the quick tier has one.
    fn noises() -> &'static [NoiseReference] {
        if campaign::is_quick() { &NoiseReference::ALL[..1] } else { &NoiseReference::ALL }
    }

    #[test]
    fn map_with_prior_is_as_certain_as_a_full_calibration() {
        for noise in noises() {
            let design = SensorDesign::papers(*noise);
            let (prior, setting) = (design.prior().unwrap(), Setting::of_layout(Some(design.layout())));
            let presses = design.calibration(NEW_SEEDS, &grid(SIDE)).unwrap();
            let family_sensor = prior.family_sensor(&presses, &setting).unwrap();
            let whole = fit("surrogate", &presses, &setting).unwrap();
            assert_eq!(family_sensor.belongs, Belongs::Typical);
            for at in [Place::new(0.0, 0.0), Place::new(3.0, 2.0), Place::new(-5.0, 1.0)] {
                let [family_sensor, whole] = [family_sensor.model.fitted(), &whole]
                    .map(|fitted| fitted.expected(at, 1.0).unwrap().mean_distance_mm());
                assert!(
                    (family_sensor / whole - 1.0).abs() < 0.1,
                    "{} {at:?}: {family_sensor} mm, {whole} mm",
                    noise.name()
                );
            }
        }
    }

    #[test]
    fn nine_presses_with_a_prior_are_nearly_a_full_calibration() {
        let design = SensorDesign::papers(NoiseReference::T);
        let (prior, setting) = (design.prior().unwrap(), Setting::of_layout(Some(design.layout())));
        let count = campaign::size(4, 10);
        let sensors = NEW_SEEDS..NEW_SEEDS + count as u64;
        let mut sums = [0.0; 4];
        for seed in sensors.clone() {
            let test = design.test(seed, 300);
            let few = |columns, rows| {
                let presses = design.calibration(seed, &cells(columns, rows)).unwrap();
                mean_errors(prior.family_sensor(&presses, &setting).unwrap().model.fitted(), &test).location_mm
            };
            let whole = fit("surrogate", &design.calibration(seed, &grid(SIDE)).unwrap(), &setting).unwrap();
            let found = [few(1, 1), few(3, 3), few(5, 5), mean_errors(&whole, &test).location_mm];
            sums.iter_mut().zip(found).for_each(|(sum, mm)| *sum += mm / count as f64);
        }
        let [one, nine, many, whole] = sums;
        println!("{count} sensors; 1: {one:.3}, 9: {nine:.3}, 25: {many:.3}, 625 without a prior: {whole:.3} mm");
        assert!(one < 1.6 * whole && nine < 1.06 * whole && many < 1.04 * whole, "{sums:?}");
    }

    /// Mean location errors of the way that the presses prefer, of the prior's map, and of the presses alone, mm; and how often errors are
    /// within both half-widths.
    #[derive(Debug, Default)]
    struct Compared {
        chosen_mm: f64,
        prior_mm: f64,
        alone_mm: f64,
        within: [f64; 2],
        doubted: f64,
    }

    fn compared(prior: &Prior, design: &SensorDesign, touches: &[Touch], draws: u64) -> Compared {
        let setting = Setting::of_layout(Some(design.layout()));
        let (mut sum, each) = (Compared::default(), 1.0 / draws as f64);
        for seed in NEW_SEEDS..NEW_SEEDS + draws {
            let (new, test) = (design.calibration(seed, touches).unwrap(), design.test(seed, 300));
            let chosen = prior.family_sensor(&new, &setting).unwrap().model;
            let own = prior.sensor_by(Update::GainsAndPlaces, &new, &setting).unwrap();
            sum.chosen_mm += each * mean_errors(chosen.fitted(), &test).location_mm;
            sum.prior_mm += each * mean_errors(own.fitted(), &test).location_mm;
            sum.alone_mm += each * mean_errors(&fit(BEST, &new, &setting).unwrap(), &test).location_mm;
            let mut workspace = Workspace::default();
            for (truth, outputs) in test.iter() {
                let solution = chosen.fitted().solve(outputs, &mut workspace).unwrap();
                let (off_mm, each) = (solution.place.distance_mm(truth.place), each / 300.0);
                let halves = solution.half_widths.map(|half| [half.half68_mm, half.half95_mm]);
                let is_within = halves.unwrap_or([f64::INFINITY; 2]).map(|half_mm| off_mm <= half_mm);
                sum.within.iter_mut().zip(is_within).for_each(|(sum, is)| *sum += each * f64::from(u8::from(is)));
                sum.doubted += if solution.verdict == ContactVerdict::Ok { 0.0 } else { each };
            }
        }
        println!("{} presses, {draws} sensors: {sum:.3?}", touches.len());
        sum
    }

    /// Sensors of the design, and sensors with another skin, which no change of gains, places and widths explains.
    #[test]
    fn presses_correct_a_prior_that_is_wrong_and_keep_one_that_is_right() {
        let design = SensorDesign::papers(NoiseReference::T);
        let other = design.with(|skin| skin.elastomer = Some(Elastomer::half_space(DEPTH_MM)));
        let (prior, draws) = (design.prior().unwrap(), campaign::size(1, 20) as u64);
        let all = [(&other, 7, 7), (&other, 5, 4), (&design, 5, 4), (&design, 7, 7)];
        for (design, columns, rows) in &all[..if campaign::is_quick() { 1 } else { 4 }] {
            let found = compared(&prior, design, &cells(*columns, *rows), draws);
            assert!(found.chosen_mm <= 1.05 * found.prior_mm.min(found.alone_mm), "{found:?}");
            let is_other = std::ptr::eq(*design, &other);
            assert!(
                !is_other || *columns < 7 || found.chosen_mm <= 0.9 * found.prior_mm.min(found.alone_mm),
                "{found:?}"
            );
            // few presses of a wrong prior, at the centres of cells, don't show the errors at the borders
            let least = if is_other && *columns < 7 { 0.85 } else { 0.92 };
            assert!((0.6..=0.78).contains(&found.within[0]) && found.within[1] >= least, "{found:?}");
            assert!(found.doubted <= 0.02, "{found:?}");
        }
    }

    /// Number of sensors of each kind: quick and full.
    const FOREIGN_SENSORS: (usize, usize) = (1, 4);

    #[test]
    fn foreign_sensors_are_refused_and_thicker_layer_needs_a_full_grid() {
        let sensors = GOOD_SEEDS..GOOD_SEEDS + campaign::size(FOREIGN_SENSORS.0, FOREIGN_SENSORS.1) as u64;
        for noise in noises() {
            let design = SensorDesign::papers(*noise);
            let prior = design.prior().unwrap();
            for kind in ForeignSensor::ALL {
                let is_refused = |seed: &u64| {
                    let readings = kind.read(&design, *seed, &cells(3, 3));
                    let belongs = prior.belongs(&readings.calibration().unwrap()).unwrap();
                    matches!(belongs, Belongs::Outsider(_))
                };
                let refused = sensors.clone().filter(is_refused).count();
                println!("{}: {refused} of {} refused, {kind:?}", noise.name(), sensors.clone().count());
                assert_eq!(refused, if kind == ForeignSensor::Good { 0 } else { sensors.clone().count() }, "{kind:?}");
            }
            for seed in sensors.clone() {
                let thicker = design.with_layer(1.1).calibration(seed, &cells(3, 3)).unwrap();
                assert!(matches!(prior.belongs(&thicker).unwrap(), Belongs::Beyond(_)), "{seed}");
            }
        }
    }

    #[test]
    fn design_lists_rotations_its_presses_cannot_show() {
        let design = SensorDesign::papers(NoiseReference::T);
        let prior = design.prior().unwrap();
        let places: Vec<Place> = cells(3, 3).iter().map(|touch| touch.place).collect();
        assert_eq!(prior.undetectable(&places, 1.0), [""; 0]);
        // a press in the middle can't show a rotation of this array
        let alike = prior.undetectable(&[Place::new(0.0, 0.0)], 1.0);
        assert!(alike.contains(&"rotated by 180 degrees"), "{alike:?}");
    }

    #[test]
    fn places_that_are_chosen_lower_the_expected_error() {
        let prior = SensorDesign::papers(NoiseReference::T).prior().unwrap();
        let order = prior.chosen_places(4, 1.0, 0.5);
        let expected = |count: usize| prior.expected_after_mm(&order[..count], 1.0, 0.5);
        assert!((1..=4).all(|count| expected(count) < expected(count - 1)), "{order:?}");
    }
}
