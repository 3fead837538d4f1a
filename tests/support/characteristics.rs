//! The library's characteristics of staircases, for comparison with those of others.

use super::shipped_text;
use palpate_control::Branch;
use palpate_core::quantity::{ArrayLayout, round};
use palpate_data::dataset::characteristics::{Repeatability, Staircases, characterise};
use palpate_data::dataset::{Mapping, parse_table};

/// The library's characteristics of a table of staircases, as in `characteristics.csv`.
pub fn characterised(text: &str) -> String {
    let presses = parse_table("characterisation.csv", text.as_bytes(), &Mapping::default()).expect("a table");
    let staircases = Staircases::of_run(&presses, &ArrayLayout::grid(3, 3, 4.5)).expect("staircases");
    let mut table =
        shipped_text("data/example/characteristics.csv").lines().next().expect("a header").to_owned() + "\n";
    for unit in characterise(&staircases, Repeatability::ThreeSd) {
        let (least, most): (Vec<f64>, Vec<f64>) = [Branch::Loading, Branch::Unloading]
            .map(|branch| unit.repeatability_interval_percent(branch).expect("repeats"))
            .into_iter()
            .unzip();
        let cells = [
            unit.repeatability_loading_percent.expect("repeats"),
            unit.repeatability_unloading_percent.expect("repeats"),
            unit.hysteresis_percent.expect("two branches"),
            unit.hysteresis_of_reading_percent.expect("two branches"),
            unit.linearity_percent.expect("levels"),
            unit.zero_return_percent.expect("levels without load"),
            least[0],
            most[0],
            least[1],
            most[1],
        ];
        let cells = cells.map(|value| format!("{:.4}", round(value, 4)));
        table += &format!("{},{}\n", unit.unit, cells.join(","));
    }
    table
}
