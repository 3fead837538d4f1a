//! Presses with outliers: the choice of `best` compared with boosted trees of scikit-learn.

use palpate_core::quantity::{ArrayLayout, Place, stream};
use palpate_sim::scene::Skin;
use palpate_testing::TestFolder;
use palpate_testing::python::{Python, said};
use palpate_testing::skins::scene_t;
use rand::RngExt;
use serde_json::Value;
use std::fmt::Write as _;

/// Fraction of presses in which one to three units have wrong outputs.
const SPIKED: f64 = 0.05;

/// A table of presses of 0.3 to 1 N at these places.
fn table(skin: &mut Skin, places: &[Place], seed: u64) -> String {
    let mut rng = stream(seed, 0, "spiked presses");
    let mut text = "x_mm,y_mm,force_n,out_1,out_2,out_3,out_4,out_5,out_6,out_7,out_8,out_9\n".to_owned();
    for place in places {
        let force_n = rng.random_range(0.3..=1.0);
        let mut outputs = vec![0.0; skin.len()];
        skin.draw_contact(&mut rng);
        skin.outputs(force_n, *place, &mut outputs);
        if rng.random_bool(SPIKED) {
            for _ in 0..rng.random_range(1..=3) {
                let unit = rng.random_range(0..outputs.len());
                // from a tenth of the largest output to ten times it, up or down
                let spike: f64 = 10f64.powf(rng.random_range(-1.0..=1.0));
                outputs[unit] += if rng.random_bool(0.5) { spike } else { -spike };
            }
        }
        let outputs: Vec<String> = outputs.iter().map(f64::to_string).collect();
        let _ = writeln!(text, "{},{},{force_n},{}", place.x_mm, place.y_mm, outputs.join(","));
    }
    text
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn presses_with_spikes_are_solved_as_well_as_by_boosted_trees() {
    let python = Python::with("import numpy, sklearn");
    let (mut own_mm, mut trees_mm) = (0.0, 0.0);
    for seed in 1..=3 {
        let mut skin = Skin::new(&scene_t(), &ArrayLayout::grid(3, 3, 4.5), 2.0, seed);
        let grid: Vec<Place> =
            (0..625).map(|i| Place::new(0.5 * (i % 25) as f64 - 6.0, 0.5 * (i / 25) as f64 - 6.0)).collect();
        let mut rng = stream(seed, 0, "places");
        let mut along = || rng.random_range(-6.0..=6.0);
        let random: Vec<Place> = (0..600).map(|_| Place::new(along(), along())).collect();
        let [calibration, test] = [table(&mut skin, &grid, seed), table(&mut skin, &random, seed + 10)];
        let bench = TestFolder::with([("calibration.csv", &*calibration), ("test.csv", &test)]);
        let output = bench.palpate_ends(0, "evaluate --calibration calibration.csv --test test.csv --json");
        let row: Value = serde_json::from_str(output.out.lines().next().expect("a row")).expect("JSON");
        let own = row["location_error_mm"]["mean"].as_f64().expect("a mean");
        let words = [bench.path("calibration.csv"), bench.path("test.csv")];
        let trees: f64 = said(python.script("boosted_trees.py", words)).trim().parse().expect("a number");
        println!("seed {seed}: {} {own:.3} mm, boosted trees {trees:.3} mm", row["solver"]);
        own_mm += own / 3.0;
        trees_mm += trees / 3.0;
    }
    assert!(own_mm <= 1.15 * trees_mm, "{own_mm} mm, boosted trees {trees_mm} mm");
}
