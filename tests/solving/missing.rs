//! Readings that lack outputs: solved by the same method fitted without these units.

use palpate_core::quantity::{ArrayLayout, Place, stream};
use palpate_sim::scene::Skin;
use palpate_solver::{
    Calibration, CalibrationPoint, MOST_PARTIAL, Model, SOLVERS, Session, Setting, Solver as _, Unanswered, Workspace,
    fit,
};
use palpate_testing::skins::scene_t;

/// Outputs of nine units for 1 N at 81 places, and for one contact between them.
struct Skins {
    layout: ArrayLayout,
    places: Vec<Place>,
    rows: Vec<Vec<f64>>,
    reading: Vec<f64>,
}

impl Skins {
    fn new() -> Self {
        let layout = ArrayLayout::grid(3, 3, 4.5);
        let (mut skin, mut rng) = (Skin::new(&scene_t(), &layout, 2.0, 7), stream(7, 1, "contacts"));
        let mut press = |place: Place, force_n: f64| {
            let mut outputs = vec![0.0; skin.len()];
            skin.draw_contact(&mut rng);
            skin.outputs(force_n, place, &mut outputs);
            outputs
        };
        let at = |index: i32| Place::new(1.5 * f64::from(index % 9) - 6.0, 1.5 * f64::from(index / 9) - 6.0);
        let places: Vec<Place> = (0..81).map(at).collect();
        let rows = places.iter().map(|place| press(*place, 1.0)).collect();
        let reading = press(Place::new(1.3, -0.8), 0.7);
        Skins { layout, places, rows, reading }
    }

    /// The calibration of some of the units.
    fn calibration(&self, units: &[usize]) -> Calibration {
        let rows: Vec<Vec<f64>> = self.rows.iter().map(|row| units.iter().map(|&unit| row[unit]).collect()).collect();
        let presses = self.places.iter().zip(&rows);
        let points: Vec<CalibrationPoint<'_>> =
            presses.map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
        Calibration::new(&points).unwrap()
    }

    fn without(&self, missing: &[usize]) -> Vec<f64> {
        let mut reading = self.reading.clone();
        missing.iter().for_each(|&unit| reading[unit] = f64::NAN);
        reading
    }
}

const ALL: [usize; 9] = [0, 1, 2, 3, 4, 5, 6, 7, 8];

#[test]
fn a_reading_that_lacks_outputs_is_solved_as_by_an_array_without_these_units() {
    let skins = Skins::new();
    let calibration = skins.calibration(&ALL);
    for name in SOLVERS {
        let mut session =
            Session::new(Model::fit(name, calibration.clone(), &Setting::of_layout(Some(&skins.layout))).unwrap());
        let whole = session.solve(&skins.reading).unwrap();
        for missing in [&[4][..], &[0, 8]] {
            let kept: Vec<usize> = ALL.into_iter().filter(|unit| !missing.contains(unit)).collect();
            let layout = skins.layout.only(&kept);
            let alone = fit(name, &skins.calibration(&kept), &Setting::of_layout(Some(&layout))).unwrap();
            let row: Vec<f64> = kept.iter().map(|&unit| skins.reading[unit]).collect();
            let expected = alone.solve(&row, &mut Workspace::default()).unwrap();
            for _ in 0..2 {
                let solution = session.solve(&skins.without(missing)).unwrap();
                assert_eq!(
                    (solution.place, solution.force_n),
                    (expected.place, expected.force_n),
                    "{name}, {missing:?}"
                );
                assert_eq!(solution.covariance, expected.covariance, "{name}, {missing:?}");
            }
        }
        assert_eq!(
            session.solve(&skins.reading).unwrap(),
            whole,
            "{name}: a whole reading is solved by the whole array"
        );
        assert_eq!(session.broken(), [], "{name}: what is missing once isn't broken");
    }
}

#[test]
fn at_most_16_partial_fits_are_kept() {
    assert_eq!(MOST_PARTIAL, 16, "as docs/explanation/promises.md has it");
    let skins = Skins::new();
    let calibration = skins.calibration(&ALL);
    let mut session =
        Session::new(Model::fit("pearson", calibration.clone(), &Setting::of_layout(Some(&skins.layout))).unwrap());
    assert_eq!(session.solve(&[f64::NAN; 9]), Err(Unanswered::NoOutputs));
    let pairs: Vec<[usize; 2]> = (0..9).flat_map(|a| (a + 1..9).map(move |b| [a, b])).collect();
    for pair in &pairs[..MOST_PARTIAL] {
        session.solve(&skins.without(pair)).unwrap();
    }
    assert_eq!(session.solve(&skins.without(&pairs[MOST_PARTIAL])), Err(Unanswered::TooMany));
    assert!(session.solve(&skins.without(&pairs[0])).is_ok(), "a fit that is kept still solves");
    assert!(session.solve(&skins.reading).is_ok());
    session.restart();
    for pair in &pairs[MOST_PARTIAL..2 * MOST_PARTIAL] {
        assert!(session.solve(&skins.without(pair)).is_ok(), "fits from before a restart leave their place");
    }
    assert_eq!(session.solve(&skins.without(&pairs[0])), Err(Unanswered::TooMany));
}

#[test]
fn infinite_output_is_not_a_missing_one() {
    let skins = Skins::new();
    let calibration = skins.calibration(&ALL);
    let mut session =
        Session::new(Model::fit("pearson", calibration.clone(), &Setting::of_layout(Some(&skins.layout))).unwrap());
    let mut reading = skins.reading.clone();
    reading[3] = f64::INFINITY;
    assert_eq!(session.solve(&reading).unwrap_err().to_string(), "output 4 is not a finite number");
}
