//! `palpate evaluate` on two plain tables and on a run, as another program would use it.

use palpate_solver::SOLVERS;
use palpate_testing::{CommandOutput, SMALL, TestFolder, exchanged, shipped_text};
use serde_json::{Value, json};

/// Three places, three units; the unit straight below a place has the largest output.
const CALIBRATION: &str = "\
x_mm,y_mm,force_n,out_1,out_2,out_3
-4,0,1,1.0,0.3,0.1
0,0,1,0.3,1.0,0.3
4,0,1,0.1,0.3,1.0
";

/// Half, twice and once the calibrated outputs, the last one a step of 4 mm away.
const TEST: &str = "\
x_mm,y_mm,force_n,out_1,out_2,out_3
-4,0,0.5,0.5,0.15,0.05
0,0,2,0.6,2.0,0.6
0,0,1,0.1,0.3,1.0
";

const WORDS: &str = "evaluate --calibration a.csv --test b.csv";

/// The paper's solver, whose answers are known by hand.
const PAPERS: &str = "--json --solver pearson";

/// The keys of every object.
const KEYS: [&str; 9] = [
    "at_calibrated_places",
    "coverage",
    "force_error_n",
    "location_error_mm",
    "ns_per_solve",
    "points",
    "solver",
    "verdicts",
    "within",
];

#[test]
fn two_tables_give_one_json_object_with_the_documented_keys() {
    let object = evaluation(CALIBRATION, TEST, PAPERS);
    assert_eq!(keys(&object), KEYS);
    assert_eq!(object["solver"], "pearson");
    assert!(object["ns_per_solve"].as_f64() > Some(0.0), "{object}");
    assert_eq!(keys(&object["verdicts"]), ["channel-fault", "not-one-contact", "ok", "outside-area", "weak-signal"]);
    assert_eq!(object["points"], 3);
    assert_eq!(keys(&object["location_error_mm"]), ["max", "mean", "median", "p95"]);
    assert_eq!(keys(&object["force_error_n"]), ["max", "mean", "median", "p95"]);
    assert_eq!(keys(&object["within"]), ["both", "force_0_1n", "location_1mm"]);
    for (key, expected) in [("mean", 4.0 / 3.0), ("median", 0.0), ("p95", 3.6), ("max", 4.0)] {
        assert_near(&object["location_error_mm"][key], expected);
    }
    assert_near(&object["force_error_n"]["max"], 0.0);
    let two_of_three = 2.0 / 3.0;
    for (key, expected) in [("location_1mm", two_of_three), ("force_0_1n", 1.0), ("both", two_of_three)] {
        assert_near(&object["within"][key], expected);
    }
}

#[test]
fn a_table_is_80_columns_wide() {
    let bench = TestFolder::with([("a.csv", CALIBRATION), ("b.csv", TEST)]);
    let output = bench.palpate_ends(0, &format!("{WORDS} --solver pearson"));
    let row = |label: &str| output.out.lines().find(|line| line.starts_with(label)).unwrap_or_default().to_owned();
    assert!(row("location error, mean").ends_with("1.333 mm"), "{}", output.out);
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
}

#[test]
fn number_of_outputs_and_order_of_columns_follow_the_table() {
    // 12 outputs, columns mixed, one of them unknown and not a number
    let outputs = |at: usize| (1..=12).map(move |unit| if unit == at { 1.0 } else { 0.1 });
    let header = (1..=12).rev().map(|unit| format!("out_{unit},")).collect::<String>();
    let row = |at, x_mm: i32| {
        let cells: Vec<String> = outputs(at).map(|output| output.to_string()).rev().collect();
        format!("{},a note,{x_mm},0\n", cells.join(","))
    };
    let table = format!("{header}note,x_mm,y_mm\n{}{}", row(2, -3), row(11, 3));
    let object = evaluation(&table, &table, PAPERS);
    assert_eq!((&object["points"], &object["location_error_mm"]["max"]), (&json!(2), &json!(0.0)));
    let fewer = exchanged(&table, "out_12,", "more,");
    assert_refused(&table, &fewer, &["a.csv", "has 12 outputs", "b.csv has 11"]);
}

#[test]
fn without_forces_in_the_test_only_the_location_is_evaluated() {
    let located = without_force(TEST);
    let object = evaluation(CALIBRATION, &located, PAPERS);
    assert_eq!(keys(&object), KEYS);
    assert_eq!(object["force_error_n"], Value::Null);
    assert_eq!((&object["within"]["force_0_1n"], &object["within"]["both"]), (&Value::Null, &Value::Null));
    assert_near(&object["location_error_mm"]["mean"], 4.0 / 3.0);
}

#[test]
fn without_forces_in_the_calibration_only_the_location_is_evaluated() {
    let located = evaluation(&without_force(CALIBRATION), TEST, PAPERS);
    assert_eq!(located["force_error_n"], Value::Null);
    let stated = evaluation(CALIBRATION, TEST, PAPERS);
    assert_eq!(located["location_error_mm"], stated["location_error_mm"]);
    let doubled = CALIBRATION.replace(",0,1,", ",0,2,");
    assert_ne!(evaluation(&doubled, TEST, PAPERS)["force_error_n"], stated["force_error_n"], "a stated force counts");
}

#[test]
fn a_calibration_by_depth_is_evaluated_solved_and_judged_in_millimetres() {
    let rows = |count: usize, off_mm: f64| -> String {
        let row = |i: usize| {
            let (x, y) = ((i % 6) as f64 + off_mm, (i / 6 % 6) as f64);
            let depth_mm = 0.2 + 0.1 * off_mm + 0.1 * (i * 5 % 9) as f64;
            let of_unit = |(a, b): (f64, f64)| depth_mm.powf(1.5) * (-0.05 * ((x - a).powi(2) + (y - b).powi(2))).exp();
            let [one, two, three] = [(0.0, 0.0), (5.0, 0.0), (2.0, 5.0)].map(of_unit);
            format!("{x},{y},{depth_mm},{one},{two},{three}\n")
        };
        "x_mm,y_mm,depth_mm,out_1,out_2,out_3\n".to_owned() + &(0..count).map(row).collect::<String>()
    };
    let (a, b) = (rows(72, 0.0), rows(30, 0.3));
    let rule = "depth_mean_mm = 0.1\ndepth_within = { mm = 0.1, share = 0.9 }\n";
    let force = "force_mean_n = 0.1\n";
    let bench = TestFolder::with([("a.csv", a.as_str()), ("b.csv", &b), ("depth.toml", rule), ("force.toml", force)]);
    let words = "evaluate --calibration a.csv --test b.csv --solver surrogate";
    let output = bench.palpate_ends(0, &format!("{words} --accept depth.toml"));
    let depth = output.out.lines().find(|line| line.starts_with("depth error, mean")).unwrap_or_default();
    assert!(depth.ends_with(" mm") && !output.out.contains(" N\n"), "{}", output.out);
    let undecided = bench.palpate(&format!("{words} --accept force.toml"));
    assert!(undecided.out.contains("no true force is known"), "{}", undecided.out);
    bench.palpate_ends(0, "fit a.csv --solver surrogate --out s.palpate");
    let readings = "out_1,out_2,out_3\n".to_owned() + a.lines().nth(5).unwrap().splitn(4, ',').nth(3).unwrap();
    let solved = bench.palpate_reads("solve --model s.palpate", &readings).out;
    assert!(solved.starts_with("x_mm,y_mm,depth_mm,sd_x_mm,") && !solved.contains("_n"), "{solved}");
    let refused = bench.palpate("export --model s.palpate --format c --out s.c");
    assert!(refused.err.contains("for depths can't be exported as C"), "{}", refused.err);
}

#[test]
fn wrong_constant_load_increases_errors() {
    let recipe = SMALL.replace("spacing_mm = 4.0", "spacing_mm = 1.0").replace("count = 2", "count = 20");
    let bench = TestFolder::with([("r.toml", recipe.as_str())]);
    bench.palpate_ends(0, "run r.toml --out run");
    let error_mm = |words: &str| {
        let object = one_object(&bench.palpate(&format!("evaluate run --json --solver surrogate {words}")));
        object["location_error_mm"]["mean"].as_f64().expect("a number")
    };
    let (unknown, constant) = (error_mm(""), error_mm("--constant-load"));
    assert!(2.0 * unknown < constant, "half a newton to one newton: {unknown} {constant}");
}

#[test]
fn the_best_is_the_default() {
    let (default, best) = (evaluation_of(CALIBRATION, TEST), evaluation(CALIBRATION, TEST, "--json --solver best"));
    for key in ["solver", "location_error_mm", "choice"] {
        assert_eq!(default[key], best[key]);
    }
    let mut keys_of_best = [KEYS.as_slice(), &["choice"]].concat();
    keys_of_best.sort_unstable();
    assert_eq!(keys(&default), keys_of_best);
    assert_eq!(default["choice"]["candidates"][0]["solver"], default["solver"]);
}

#[test]
fn all_solvers_are_a_line_each_with_the_best_last() {
    let bench = TestFolder::with([("a.csv", CALIBRATION), ("b.csv", TEST)]);
    let output = bench.palpate_ends(0, &format!("{WORDS} --solver all --json"));
    let objects = output.json_lines();
    let names: Vec<&str> = objects.iter().map(|object| object["solver"].as_str().expect("a name")).collect();
    assert_eq!(names[..SOLVERS.len()], SOLVERS);
    assert!(names.len() == SOLVERS.len() + 1 && SOLVERS.contains(&names[SOLVERS.len()]), "{names:?}");
    let alone = one_object(&bench.palpate_ends(0, &format!("{WORDS} {PAPERS}")));
    assert_eq!(objects[0]["location_error_mm"], alone["location_error_mm"]);

    let output = bench.palpate_ends(0, &format!("{WORDS} --solver all"));
    let lines: Vec<&str> = output.out.lines().collect();
    assert!(lines.iter().all(|line| line.chars().count() <= 80), "{}", output.out);
    // tables don't state the places of the units, so the array may not be the paper's
    assert!(lines[2].starts_with("pearson ") && !output.out.contains("paper"), "{}", output.out);
    assert_eq!(
        lines[2].split_whitespace().collect::<Vec<_>>()[1..7],
        "1.333 0.000 3.600 4.000 0.000 66.7".split(' ').collect::<Vec<_>>()
    );
    let best = lines.iter().find(|line| line.starts_with("best: ")).unwrap_or_else(|| panic!("{}", output.out));
    assert!(best.starts_with(&format!("best: {}", names[SOLVERS.len()])), "{best}");
}

#[test]
fn unfitted_solver_has_a_line_with_its_reason() {
    let flat = "x_mm,y_mm,out_1,out_2\n0,0,1,1\n1,0,2,2\n3,0,5,5\n";
    let bench = TestFolder::with([("a.csv", flat), ("b.csv", flat)]);
    let output = bench.palpate(&format!("{WORDS} --solver all --json"));
    let reason = "all units have the same output at every calibration point, so the points can't be distinguished";
    assert_eq!(output.json_lines()[0], json!({"solver": "pearson", "error": reason}));
    assert_eq!(output.json_lines().len(), SOLVERS.len() + 1);
    let output = bench.palpate(&format!("{WORDS} --solver all"));
    let expected = "\n\
        pearson: all units have the same output at every calibration point, so the\n  points can't be distinguished\n";
    assert!(output.out.contains(expected), "{}", output.out);
    // without other methods there is nothing else to report
    let output = bench.palpate_ends(2, &format!("{WORDS} --solver pearson"));
    assert!(output.out.is_empty() && output.running().contains(reason), "{output:?}");
    // methods without a result have no line
    let other = TestFolder::with([("a.csv", flat), ("b.csv", TEST)]).palpate_ends(2, &format!("{WORDS} --solver all"));
    assert!(other.out.is_empty() && other.running().contains("a.csv has 2 outputs"), "{other:?}");
}

#[test]
fn the_better_baseline_has_the_same_places_and_its_own_forces() {
    let noisy = exchanged(TEST, "0.6,2.0,0.6", "0.8,2.0,0.5");
    let (paper, baseline) =
        (evaluation(CALIBRATION, &noisy, PAPERS), evaluation(CALIBRATION, &noisy, "--json --solver pearson-lsq"));
    assert_eq!(paper["location_error_mm"], baseline["location_error_mm"]);
    assert_ne!(paper["force_error_n"], baseline["force_error_n"]);
    assert_eq!(baseline["solver"], "pearson-lsq");
}

#[test]
fn a_table_that_cannot_be_used_is_named_with_its_line_and_column() {
    let twins: [(&str, &str, &[&str]); 9] = [
        ("x_mm,y_mm", "x,y_mm", &["line 1", "`x_mm` is missing", "rename it, or add --columns"]),
        ("x_mm,y_mm", "x_mm,note", &["line 1", "`y_mm` is missing"]),
        ("out_2", "out_4", &["line 1", "`out_2` is missing"]),
        ("out_2", "out_1", &["line 1", "`out_1` is in the header twice"]),
        ("0,0,1,", "NaN,0,1,", &["line 3", "column `x_mm`", "finite number", "`NaN`"]),
        ("0,0,1,0.3,1.0", "0,0,1,0.3,inf", &["line 3", "column `out_2`", "`inf`"]),
        ("0,0,1,0.3,1.0", "0,0,one,0.3,1.0", &["line 3", "column `force_n`", "`one`"]),
        ("0,0,1,0.3,1.0,0.3", "0,0,1,0.3,1.0", &["line 3", "5 cells where the header has 6", "column `out_2`"]),
        ("0,0,1,0.3,1.0,0.3", "0,0,1,0.3,1.0,0.3,9", &["line 3", "7 cells where the header has 6", "column `out_3`"]),
    ];
    for (from, to, parts) in twins {
        let broken = exchanged(CALIBRATION, from, to);
        assert_refused(&broken, TEST, &[&["a.csv"], parts].concat());
        assert_refused(CALIBRATION, &broken, &[&["b.csv"], parts].concat());
    }
    assert_refused("", TEST, &["a.csv", "no header and no row"]);
    let none = TestFolder::with([("b.csv", TEST)]).palpate_ends(2, WORDS);
    assert!(none.running().contains("a.csv: can't be read"), "{}", none.err);
}

#[test]
fn a_run_is_evaluated_by_the_commanded_force_and_by_the_load_cell() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let output = bench.palpate("evaluate run --json --solver pearson");
    let object = one_object(&output);
    let mut agreed = [KEYS.as_slice(), &["force_error_load_cell_n"]].concat();
    agreed.sort_unstable();
    assert_eq!(keys(&object), agreed);
    assert_eq!(keys(&object["force_error_load_cell_n"]), ["max", "mean", "median", "p95"]);
    assert_eq!((&object["points"], &object["solver"]), (&json!(2), &json!("pearson")));

    // the same rows as plain tables: the load cell's force is then the force
    let (header, rows) = bench.table("run/presses.csv");
    let of_phase = |phase: &str| {
        let rows = rows.iter().filter(|row| row[2] == phase).map(|row| row.join(","));
        std::iter::once(header.join(",")).chain(rows).collect::<Vec<_>>().join("\n")
    };
    let bench = TestFolder::with([("a.csv", of_phase("calibration").as_str()), ("b.csv", of_phase("test").as_str())]);
    let plain = one_object(&bench.palpate(&format!("{WORDS} {PAPERS}")));
    assert_eq!(keys(&plain), KEYS);
    assert_eq!(plain["location_error_mm"], object["location_error_mm"]);
}

#[test]
fn a_run_without_test_presses_has_cross_validated_errors() {
    let bench = TestFolder::with([("r.toml", SMALL.split("[[step]]\nphase = \"test\"").next().unwrap_or_default())]);
    bench.palpate_ends(0, "run r.toml --out run");
    let output = bench.palpate_ends(0, "evaluate run --solver pearson");
    assert!(output.out.starts_with("no test presses: cross-validated errors of the calibration"), "{}", output.out);
    let objects = bench.palpate_ends(0, "evaluate run --solver pearson --json").json_lines();
    assert_eq!(objects[0]["cross_validated"][0]["solver"], "pearson");
    // a rule needs a test
    let bench = TestFolder::with([("a.csv", grid(6, 2).as_str()), ("rule.toml", RULE)]);
    let output = bench.palpate_ends(1, "evaluate a.csv --accept rule.toml");
    assert!(output.out.contains("NOT DECIDED") && output.out.contains("a.csv: no valid test press"), "{}", output.out);
}

/// Largest mean location error of 100 mm.
const RULE: &str = "location_mean_mm = 100.0\n";

/// A table of a grid of `side` x `side` places, 1 mm apart, with noisy outputs of four units, and `passes` presses at each place.
fn grid(side: usize, passes: usize) -> String {
    let mut text = "x_mm,y_mm,force_n,out_1,out_2,out_3,out_4\n".to_owned();
    for press in 0..passes * side * side {
        let (x, y) = ((press % side) as f64, (press / side % side) as f64);
        let force_n = 1.0 + 0.3 * (press as f64 * 0.7).sin();
        let output = |unit: usize| {
            let (off_x, off_y) = (x - (unit % 2 * side) as f64, y - (unit / 2 * side) as f64);
            let noise = ((7 * press + 3 * unit) as f64 * 1.3).sin();
            force_n * (-(off_x * off_x + off_y * off_y) / (side * side) as f64).exp() + 0.003 * noise
        };
        text += &format!("{x},{y},{force_n},{},{},{},{}\n", output(0), output(1), output(2), output(3));
    }
    text
}

#[test]
fn saved_parts_give_the_figures_of_the_hold_out_to_the_last_bit() {
    let columns = "[array]\nplaces_mm = [[0.0, 0.0], [7.0, 0.0], [0.0, 7.0], [7.0, 7.0]]\n";
    let bench = TestFolder::with([("a.csv", grid(8, 3).as_str()), ("columns.toml", columns), ("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let figures = |words: &str| {
        let mut object = bench.palpate_ends(0, words).json_lines().remove(0);
        object.as_object_mut().expect("an object").remove("ns_per_solve");
        object
    };
    let output = bench.palpate_ends(0, "evaluate a.csv --holdout time 20% --solver pearson");
    assert!(output.err.contains("the order of the file"), "{}", output.err);
    for (number, (source, solver, columns)) in [
        ("a.csv --holdout places 20% --seed 3", "best", ""),
        ("a.csv --holdout press 0.25", "surrogate", ""),
        ("a.csv --holdout time 20% --columns columns.toml", "physics", "columns.toml"),
        ("run --holdout places 30%", "pearson", "columns.toml"),
    ]
    .into_iter()
    .enumerate()
    {
        let held_out = figures(&format!("evaluate {source} --solver {solver} --json --save parts{number}"));
        let columns = if columns.is_empty() { String::new() } else { format!("--columns parts{number}/{columns}") };
        let tables = format!("parts{number}/calibration.csv parts{number}/test.csv");
        assert_eq!(held_out, figures(&format!("evaluate {tables} --solver {solver} --json {columns}")), "{source}");
    }
    let again = bench.palpate_ends(5, "evaluate a.csv --holdout places 20% --save parts0");
    assert!(again.running().contains("name a folder without such files"), "{}", again.err);
}

#[test]
fn hold_out_gives_a_verdict_only_with_holdout_in_the_rule() {
    let permitted = format!("holdout = true\n{RULE}");
    let bench = TestFolder::with([("a.csv", grid(6, 2).as_str()), ("rule.toml", RULE), ("permitted.toml", &permitted)]);
    let words = "evaluate a.csv --solver pearson --holdout press 20%";
    let output = bench.palpate_ends(1, &format!("{words} --accept rule.toml"));
    assert!(output.out.contains("NOT DECIDED") && output.out.contains("holdout = true"), "{}", output.out);
    assert!(
        output.err.contains("warning: ") && output.err.contains("are at places of the calibration"),
        "{}",
        output.err
    );
    bench.palpate_ends(0, &format!("{words} --accept permitted.toml"));
    let output = bench.palpate_ends(0, words);
    assert!(output.out.contains("no verdict") && output.out.contains("location error, mean"), "{}", output.out);
}

#[test]
fn impossible_hold_out_is_refused() {
    let bench = TestFolder::with([("a.csv", grid(6, 2).as_str()), ("b.csv", CALIBRATION)]);
    for (words, part) in [
        ("a.csv --holdout rows 20%", "expected places, press or time"),
        ("a.csv --holdout places 120%", "expected a share between 0 and 100 %"),
        ("a.csv --holdout places x", "expected a share between 0 and 100 %"),
        ("a.csv b.csv --holdout places 20%", "--holdout splits one table or run"),
        ("a.csv --save parts", "--holdout"),
        ("a.csv --holdout places 20% --same-place 0", "expected a distance"),
    ] {
        let output = bench.palpate_ends(2, &format!("evaluate {words}"));
        assert!(output.running().contains(part), "{words}: {}", output.err);
    }
}

/// The object of an evaluation with additional options.
fn evaluation(calibration: &str, test: &str, words: &str) -> Value {
    let bench = TestFolder::with([("a.csv", calibration), ("b.csv", test)]);
    one_object(&bench.palpate_ends(0, &format!("{WORDS} {words}")))
}

fn evaluation_of(calibration: &str, test: &str) -> Value {
    one_object(&TestFolder::with([("a.csv", calibration), ("b.csv", test)]).palpate(&format!("{WORDS} --json")))
}

fn one_object(output: &CommandOutput) -> Value {
    let mut lines = output.json_lines();
    assert!(lines.len() == 1 && output.err.is_empty(), "{output:?}");
    lines.remove(0)
}

fn assert_refused(calibration: &str, test: &str, parts: &[&str]) {
    let bench = TestFolder::with([("a.csv", calibration), ("b.csv", test)]);
    let output = bench.palpate_ends(2, &format!("{WORDS} --json"));
    assert!(output.out.is_empty(), "{}", output.out);
    for part in parts {
        assert!(output.running().contains(part), "it doesn't say {part:?}:\n{}", output.err);
    }
}

/// The keys of an object in alphabetical order.
fn keys(object: &Value) -> Vec<&str> {
    let mut keys: Vec<&str> = object.as_object().expect("an object").keys().map(String::as_str).collect();
    keys.sort_unstable();
    keys
}

fn without_force(table: &str) -> String {
    let line = |line: &str| {
        line.split(',').enumerate().filter(|(i, _)| *i != 2).map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
    };
    table.lines().map(|text| line(text) + "\n").collect()
}

fn assert_near(value: &Value, expected: f64) {
    let value = value.as_f64().expect("a number");
    assert!((value - expected).abs() < 1e-9, "{value} instead of {expected}");
}

#[test]
fn rows_of_a_dead_array_are_flagged_and_not_evaluated() {
    let rig = shipped_text("rigs/sim.toml");
    let is_felt =
        |line: &&str| !["elastomer =", "taxel_noise =", "hysteresis ="].iter().any(|key| line.starts_with(key));
    let unmoved: String = rig.lines().filter(is_felt).map(|line| format!("{line}\n")).collect();
    for (rig, flag) in [(exchanged(&rig, "range_v = 10.0", "range_v = 0.1"), "saturated"), (unmoved, "stale")] {
        let bench = TestFolder::with([("r.toml", SMALL), ("rig.toml", rig.as_str())]);
        bench.palpate_ends(0, "run r.toml --rig rig.toml --out run");
        let (forces, flags) =
            (bench.column("run/presses.csv", "force_set_n"), bench.column("run/presses.csv", "flags"));
        let in_contact: Vec<&String> =
            flags.iter().zip(&forces).filter(|(_, n)| *n != "0").map(|(flags, _)| flags).collect();
        assert!(in_contact.len() == 9 && in_contact.iter().all(|flags| *flags == flag), "{flag}: {flags:?}");
        let output = bench.palpate_ends(2, "evaluate run --solver pearson");
        assert!(output.running().contains("no valid calibration press (4 are flagged and excluded)"), "{}", output.err);
    }
}

#[test]
fn a_test_by_a_sensor_that_changed_is_not_as_calibrated() {
    let bench = TestFolder::new();
    for name in ["calibration", "test"] {
        bench.write(&format!("{name}.csv"), &exchanged_table(name, 1.0));
    }
    bench.write("changed.csv", &exchanged_table("test", 0.7));
    let of = |test: &str| bench.palpate_ends(0, &format!("evaluate calibration.csv {test}.csv --solver surrogate"));
    assert!(!of("test").out.contains("not as calibrated"));
    let changed = of("changed").out;
    assert!(changed.contains("not as calibrated: after ") && changed.contains("test presses too many"), "{changed}");
    bench.write("dead.csv", &exchanged_table("test", 0.0));
    let dead = of("dead").out;
    assert!(dead.contains("calibration of\n  surrogate; output 5 contradicts the others (odds "), "{dead}");
}

/// A table of the shipped example, with out_5 multiplied.
fn exchanged_table(name: &str, gain: f64) -> String {
    let path = format!("{}/data/example/{name}.csv", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    let header = text.lines().next().unwrap().to_owned();
    let column = header.split(',').position(|name| name == "out_5").unwrap();
    let lines = text.lines().skip(1).map(|line| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        cells[column] = (gain * cells[column].parse::<f64>().unwrap()).to_string();
        cells.join(",")
    });
    [vec![header], lines.collect()].concat().join("\n") + "\n"
}
