//! The folder `data`: the program makes its example from its recipe, and an independent script finds the same characteristics.

use palpate_testing::characteristics::characterised;
use palpate_testing::{TestFolder, shipped, shipped_text};
use toml::{Table, Value};

/// The example's tables and the phase of each.
const TABLES: [(&str, &str); 3] =
    [("characterisation", "characterisation"), ("calibration", "calibration"), ("test", "test")];

#[test]
fn example_data_follow_from_its_recipe() {
    let bench = TestFolder::new();
    bench.palpate_ends(0, &format!("run {} --out example", shipped("data/example/recipe.toml").display()));
    let presses = bench.read("example/presses.csv");
    let (header, rows) = presses.split_once('\n').expect("a header");
    for (name, phase) in TABLES {
        let of_phase = rows.lines().filter(|row| row.split(',').nth(2) == Some(phase));
        let expected: String = [header].into_iter().chain(of_phase).map(|line| format!("{line}\n")).collect();
        is_shipped(&format!("{name}.csv"), &expected);
    }
    is_shipped("characteristics.csv", &bench.read("example/characteristics.csv"));
    bench.palpate_ends(0, "report example");
    assert!(bench.read("example/report.html").contains("Characteristics of each unit"));
}

fn is_shipped(name: &str, expected: &str) {
    let found = shipped_text(&format!("data/example/{name}"));
    let differs = found.lines().zip(expected.lines()).position(|(found, expected)| found != expected);
    assert!(
        found == expected,
        "data/example/{name} differs from line {differs:?} on: data/README.md says how it is made"
    );
}

#[test]
fn the_example_can_be_evaluated_and_solved_at_once() {
    let [calibration, test] = ["calibration", "test"].map(|name| shipped(&format!("data/example/{name}.csv")));
    let bench = TestFolder::new();
    let (calibration, readings) = (calibration.display().to_string(), test.display().to_string());
    let printed = bench.palpate_ends(0, &format!("evaluate --calibration {calibration} --test {readings} --json"));
    assert_eq!(printed.json_lines()[0]["points"], 60);
    let file = std::fs::File::open(test).expect("the table of tests");
    let solved = bench.command(&format!("solve --calibration {calibration}")).stdin(file).output().expect("it starts");
    assert!(solved.status.success(), "{}", String::from_utf8_lossy(&solved.stderr));
    assert_eq!(String::from_utf8_lossy(&solved.stdout).lines().count(), 61, "a header, and a contact a reading");
}

#[test]
fn the_shipped_characteristics_are_those_of_the_library() {
    let shipped = shipped_text("data/example/characteristics.csv");
    assert!(shipped.lines().count() == 10 && !shipped.contains(",,"), "{shipped}");
    assert_eq!(characterised(&shipped_text("data/example/characterisation.csv")), shipped);
}

#[test]
fn shipped_recipe_and_rig_follow_the_paper() {
    let [paper, recipe, rig] = ["data/paper.toml", "recipes/paper.toml", "rigs/sim.toml"]
        .map(|path| shipped_text(path).parse::<Table>().expect("TOML"));
    let number = |value: &Value| value.as_float().or(value.as_integer().map(|whole| whole as f64)).expect("a number");
    let is = |key: &str, found: &Value| match found {
        Value::Array(_) => assert_eq!(*found, paper[key], "{key}"),
        found => assert_eq!(number(found), number(&paper[key]), "{key}"),
    };
    let steps = recipe["step"].as_array().expect("steps");
    let [staircase, grid, random] = [(0, "staircase"), (1, "grid"), (2, "random")].map(|(step, key)| &steps[step][key]);
    is("staircase_top_n", &staircase["to_n"]);
    is("staircase_step_n", &staircase["step_n"]);
    is("staircase_repeats", &staircase["repeats"]);
    is("staircase_rest_s", &staircase["rest_s"]);
    is("calibration_force_n", &steps[1]["force_n"]);
    is("calibration_spacing_mm", &grid["spacing_mm"]);
    is("test_points", &random["count"]);
    is("test_force_n", &random["force_n"]);
    is("force_resolution_n", &recipe["press"]["force_tolerance_n"]);
    for places in [grid, random] {
        is("area_mm", &places["x_mm"]);
        is("area_mm", &places["y_mm"]);
    }
    let array = &rig["array"]["grid"];
    is("pitch_mm", &array["pitch_mm"]);
    assert_eq!(number(&array["rows"]) * number(&array["columns"]), number(&paper["units"]));
    is("cover_mm", &rig["scene"]["elastomer"]["depth_mm"]);
    is("staircase_top_n", &rig["limits"]["force_n"]);
    let area = paper["area_mm"].as_array().expect("an interval");
    let side = (number(&area[1]) - number(&area[0])) / number(&paper["calibration_spacing_mm"]) + 1.0;
    is("calibration_points", &Value::Float(side * side));
    let units = |column: usize| (1..=9).map(move |unit| (format!("unit_{unit}"), column));
    let column = |column| Value::Array(units(column).map(|(key, column)| paper[&key][column].clone()).collect());
    assert_eq!(rig["scene"]["taxel_noise"]["repeatability_percent"], column(0));
    assert_eq!(rig["scene"]["hysteresis"]["hysteresis_percent"], column(2));
}
