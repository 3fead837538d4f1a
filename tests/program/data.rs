//! The folder `data`: its example is what the program makes of its recipe, and an independent script finds the same
//! characteristics.

use crate::support::skips::skipped;
use crate::support::{Bench, shipped, shipped_text};
use palpate::control::Branch;
use palpate::dataset::characteristics::{Repeatability, Staircases, characterise};
use palpate::dataset::{Mapping, parse_table};
use palpate::quantity::{ArrayLayout, round};
use std::process::{Command, Stdio};
use toml::{Table, Value};

/// The example's tables and the phase that each holds.
const TABLES: [(&str, &str); 3] =
    [("characterisation", "characterisation"), ("calibration", "calibration"), ("test", "test")];

#[test]
fn the_example_is_what_its_recipe_comes_to() {
    let bench = Bench::new();
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
    let bench = Bench::new();
    let (calibration, readings) = (calibration.display().to_string(), test.display().to_string());
    let told = bench.palpate_ends(0, &format!("evaluate --calibration {calibration} --test {readings} --json"));
    assert_eq!(told.json_lines()[0]["points"], 60);
    let file = std::fs::File::open(test).expect("the table of tests");
    let solved = bench.command(&format!("solve --calibration {calibration}")).stdin(file).output().expect("it starts");
    assert!(solved.status.success(), "{}", String::from_utf8_lossy(&solved.stderr));
    assert_eq!(String::from_utf8_lossy(&solved.stdout).lines().count(), 61, "a header, and a contact a reading");
}

#[test]
fn an_independent_script_finds_the_same_characteristics() {
    let text = shipped_text("data/example/characterisation.csv");
    let shipped = shipped_text("data/example/characteristics.csv");
    assert!(shipped.lines().count() == 10 && !shipped.contains(",,"), "{shipped}");
    assert_eq!(characterised(&text), shipped, "by the library");
    if let Some(found) = recomputed(&text) {
        assert_eq!(found, shipped, "by Python");
    }
    // the simulated units are straight and return to zero: these are bent and wander, and some of their levels are flagged
    let worn = worn(&text);
    let expected = characterised(&worn);
    for column in [5, 6] {
        let cells = expected.lines().skip(1).map(|line| line.split(',').nth(column).unwrap().parse::<f64>().unwrap());
        assert!(cells.into_iter().all(|percent| percent.abs() > 0.001), "{expected}");
    }
    if let Some(found) = recomputed(&worn) {
        assert_eq!(found, expected, "by Python, of worn units");
    }
}

/// What the library makes of a table of staircases, as `characteristics.csv` has it.
fn characterised(text: &str) -> String {
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
            unit.zero_return_percent.expect("levels in air"),
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

/// The same by Python, where it is there.
fn recomputed(text: &str) -> Option<String> {
    let bench = Bench::with([("characterisation.csv", text)]);
    let mut python = Command::new("python3");
    python
        .arg(shipped("data/check/characteristics.py"))
        .arg(bench.path("characterisation.csv"))
        .args(["3", "3", "4.5"]);
    match python.stdin(Stdio::null()).output() {
        Ok(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            Some(String::from_utf8(output.stdout).expect("text").replace("\r\n", "\n"))
        }
        Err(error) => {
            skipped("data/check/characteristics.py", &format!("python3: {error}"));
            None
        }
    }
}

/// The table with outputs that bend and wander with time, and a flag at every 37th row.
fn worn(text: &str) -> String {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header: Vec<String> = reader.headers().expect("a header").iter().map(str::to_owned).collect();
    let mut worn = header.join(",") + "\n";
    for (index, row) in reader.records().enumerate() {
        let row = row.expect("a row");
        let cell = |name: &str| &row[header.iter().position(|column| column == name).expect("a column")];
        let t_s: f64 = cell("t_s").parse().expect("a time");
        let bent = |output: &str| {
            let output: f64 = output.parse().expect("an output");
            let wandered = 0.01 * (0.3 * t_s).sin() + 0.02 * output * (0.07 * t_s).cos();
            format!("{:.7}", output - 0.05 * output * output + wandered)
        };
        let cells = header.iter().zip(&row).map(|(name, cell)| match name.as_str() {
            output if output.starts_with("out_") => bent(cell),
            "flags" if index % 37 == 0 => "stale".to_owned(),
            _ => cell.to_owned(),
        });
        worn += &(cells.collect::<Vec<String>>().join(",") + "\n");
    }
    worn
}

#[test]
fn the_papers_recipe_and_rig_are_what_the_paper_did() {
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
