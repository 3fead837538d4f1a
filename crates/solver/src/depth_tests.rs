//! Calibrations whose presses are known by their depths.

use super::*;
use palpate_core::quantity::stream;
use rand::RngExt as _;
use rand::distr::Distribution as _;
use rand_distr::StandardNormal;

/// Presses on a grid at random depths, of an array of 3 x 3 units whose outputs grow as depth^1.5, with some noise.
struct Pressed {
    places: Vec<Place>,
    depths_mm: Vec<f64>,
    outputs: Vec<Vec<f64>>,
}

impl Pressed {
    fn on_grid(side: usize, offset_mm: f64, passes: usize, seed: u64) -> Self {
        let mut rng = stream(seed, 0, "presses by depth");
        let mut pressed = Pressed { places: Vec::new(), depths_mm: Vec::new(), outputs: Vec::new() };
        for i in 0..passes * side * side {
            let step_mm = 8.0 / side as f64;
            let mm = |index: usize| offset_mm + step_mm * index as f64 - 4.0 + step_mm / 2.0;
            let place = Place::new(mm(i % side), mm(i / side % side));
            let depth_mm: f64 = rng.random_range(0.2..1.0);
            let unit = |unit: usize| Place::new(4.0 * (unit % 3) as f64 - 4.0, 4.0 * (unit / 3) as f64 - 4.0);
            let pattern = |at: usize| (-(place.distance_mm(unit(at)) / 3.5).powi(2)).exp();
            let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
            let outputs = (0..9).map(|at| depth_mm.powf(1.5) * pattern(at) + 0.005 * noise()).collect();
            pressed.places.push(place);
            pressed.depths_mm.push(depth_mm);
            pressed.outputs.push(outputs);
        }
        pressed
    }

    fn points(&self) -> Vec<CalibrationPoint<'_>> {
        let presses = self.places.iter().zip(&self.outputs);
        presses.map(|(place, outputs)| CalibrationPoint { place: *place, force_n: f64::NAN, outputs }).collect()
    }

    fn calibration(&self) -> Calibration {
        Calibration::by_depth(&self.points(), &self.depths_mm).unwrap()
    }

    fn test(&self) -> Vec<TestPress<'_>> {
        let presses = self.places.iter().zip(&self.depths_mm).zip(&self.outputs);
        let press = |place: &Place, depth_mm: &f64, outputs| {
            let (place, force_n, depth_mm) = (*place, Some(1.0), Some(*depth_mm));
            TestPress { place, force_n, depth_mm, outputs }
        };
        presses.map(|((place, depth_mm), outputs)| press(place, depth_mm, outputs)).collect()
    }
}

#[test]
fn depths_are_solved_with_errors_as_stated() {
    let (calibration, test) = (Pressed::on_grid(9, 0.0, 2, 1), Pressed::on_grid(8, 0.2, 4, 2));
    for name in ["surrogate", "gaussian-process"] {
        let fitted = fit(name, &calibration.calibration(), &Setting::default()).unwrap();
        let evaluation = evaluate(&fitted, &test.test()).unwrap();
        let (depth, coverage) = (evaluation.depth_error_mm.unwrap(), evaluation.coverage.unwrap());
        assert_eq!((evaluation.force_error_n, coverage.force_68, evaluation.within.both), (None, None, None));
        assert!(depth.mean < 0.03, "{name}: {depth:?}");
        let (narrow, wide) = (coverage.depth_68.unwrap(), coverage.depth_95.unwrap());
        assert!((0.55..0.85).contains(&narrow) && wide > 0.88, "{name}: {coverage:?}");
    }
}

#[test]
fn a_model_keeps_its_depths_in_its_bytes() {
    let calibration = Pressed::on_grid(6, 0.0, 2, 3);
    let model = Model::fit("surrogate", calibration.calibration(), &Setting::default()).unwrap();
    let bytes = model.to_bytes().unwrap();
    let again = Model::from_bytes(&bytes).unwrap();
    assert_eq!(again.to_bytes().unwrap(), bytes);
    assert_eq!((again.validity(), again.calibration()), (model.validity(), model.calibration()));
    assert!(!again.forces_are_known() && again.depths_are_known() && again.validity().force_n.is_none());
    let [mut one, mut other] = [model, again].map(Session::new);
    // a missing output needs another fit, which has depths too
    let mut missing = calibration.outputs[7].clone();
    missing[0] = f64::NAN;
    for reading in calibration.outputs[..5].iter().chain([&missing]) {
        let solution = one.solve(reading).unwrap();
        assert!(solution.depth.is_some());
        assert_eq!(other.solve(reading).unwrap(), solution);
    }
    let damaged = Model::from_bytes(&bytes[..bytes.len() - 1]);
    assert!(damaged.is_err());
}

#[test]
fn depths_must_be_positive_and_differ() {
    let pressed = Pressed::on_grid(6, 0.0, 1, 4);
    for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let depths_mm = [&pressed.depths_mm[..3], &[wrong], &pressed.depths_mm[4..]].concat();
        assert_eq!(Calibration::by_depth(&pressed.points(), &depths_mm).unwrap_err().point(), Some(3));
    }
    let alike = Calibration::by_depth(&pressed.points(), &[0.5; 36]).unwrap();
    assert_eq!((alike.depth_curve(), &alike), (None, &Calibration::without_forces(&pressed.points()).unwrap()));
}

#[test]
fn few_new_presses_and_a_prior_need_forces() {
    let all: Vec<Calibration> = (5..9).map(|seed| Pressed::on_grid(6, 0.0, 1, seed).calibration()).collect();
    let refused = Adapted::new("surrogate", &all[0], &all[1], &Setting::default()).err();
    assert_eq!(refused, Some(AdaptError::ByDepth));
    assert_eq!(Prior::new(&all, None).err(), Some(PriorError::NoForces));
}
