//! The command line for a user and for another program: help, acknowledgements, tables, complete runs.

use palpate_testing::{SMALL, SMALL_PRESSES, SMALL_ROWS, TestFolder, shipped, shipped_text};
use serde_json::{Value, json};

#[test]
fn every_subcommand_has_help_with_a_valid_example() {
    let bench = TestFolder::new();
    let whole = bench.palpate_ends(0, "--help").out;
    for subcommand in ["check", "run", "resume", "evaluate", "solve", "study", "emulate", "ports"] {
        assert!(whole.contains(&format!("\n  {subcommand} ")), "{subcommand} isn't in\n{whole}");
        let help = bench.palpate_ends(0, &format!("{subcommand} --help")).out;
        let (_, examples) = help.split_once("Example").unwrap_or_else(|| panic!("no example in\n{help}"));
        let mut calls = examples.lines().filter_map(|line| line.trim().strip_prefix("palpate "));
        assert!(calls.clone().all(|call| call.starts_with(subcommand)) && calls.next().is_some(), "{help}");
        for path in examples.split_whitespace().filter(|word| word.ends_with(".toml")) {
            let path = &path.replace("example/", "data/example/"); // as `init --from example` writes it
            assert!(shipped(path).is_file(), "{path}, which `palpate {subcommand} --help` names");
        }
    }
}

#[test]
fn version_and_manifest_name_the_commit_that_the_program_is_built_from() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    let version = bench.palpate_ends(0, "--version").out;
    bench.palpate_ends(0, "run r.toml --out run");
    let manifest = bench.manifest("run");
    let commit = manifest["sessions"][0]["commit"].as_str().map(|commit| format!(" ({commit})")).unwrap_or_default();
    assert_eq!(version.trim(), format!("palpate {}{commit}", env!("CARGO_PKG_VERSION")));
    // a checkout of this repository names its commit
    assert_eq!(commit.is_empty(), !shipped(".git").exists(), "{version}");
}

#[test]
fn check_prints_the_plan_and_leaves_nothing_behind() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    let output = bench.palpate_ends(0, "check r.toml --seed 3");
    assert!(
        output.out.starts_with("rig sim.toml: simulated, named by the recipe\nplan small, seed 3\n"),
        "{}",
        output.out
    );
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    assert!(!bench.has("runs"));
}

#[test]
fn check_states_what_ends_a_motion_of_another_host() {
    for (rig, expected) in [
        ("sim", "AB would end it, and isn't sent without `z_holds_unpowered = true`"),
        ("klipper", "emergency_stop would end it, and isn't sent without `z_holds_unpowered = true`"),
        ("marlin", "from 2.2 N on M410 ends it; 5 mm/s reaches some 3.7 N"),
        ("matrix", "from 2.2 N on a feed hold and a reset ends it; 10 mm/s reaches some 6.4 N"),
        ("ur", "from 2.42 N on the dashboard's stop ends it; 20 mm/s reaches some 8.8 N"),
        ("process", "from 2.2 N on its stop ends it"),
    ] {
        let bench =
            TestFolder::with([("r.toml", SMALL), ("rig.toml", shipped_text(&format!("rigs/{rig}.toml")).as_str())]);
        let output = bench.palpate_ends(0, "check r.toml --rig rig.toml").out;
        assert!(output.contains(expected), "{rig}: {output}");
        assert!(output.lines().all(|line| line.chars().count() <= 80), "{output}");
    }
}

#[test]
fn check_warns_about_probable_mistakes() {
    let accept = "\n[accept]\nlocation_mean_mm = 0.5\n";
    let (without_test, _) = SMALL.split_at(SMALL.rfind("[[step]]").unwrap());
    let slow = SMALL.replace("force_tolerance_n = 0.05", "force_tolerance_n = 0.05\nsample_s = 100.0");
    let bench = TestFolder::with([
        ("r.toml", SMALL),
        ("slow.toml", slow.as_str()),
        ("no-test.toml", (without_test.to_owned() + accept).as_str()),
    ]);
    assert_eq!(bench.palpate_ends(0, "check r.toml").err, "");
    let strong = SMALL.replace("force_n = [0.5, 1.0]", "force_n = [0.5, 2.0]");
    let guarded = format!("{SMALL}\n[accept]\nrule = \"guarded\"\nforce_mean_n = 0.1\nhysteresis_percent = 5.0\n");
    bench.write("strong.toml", &strong);
    bench.write("guarded.toml", &guarded);
    for (recipe, expected) in [
        (
            "strong.toml",
            "note: test forces reach 1.855 N, but the calibration has up to 1 N: stronger contacts are answered less exactly, or \
             with `not-one-contact`. Calibrate with 1.855 N, or give the forces to `palpate fit` and `solve`, such as --forces-n 0.1 1.855",
        ),
        ("guarded.toml", "this plan can't give a verdict: force error, mean: 2 test presses; its 95 % bound needs 59"),
        ("guarded.toml", "this plan can't give a verdict: hysteresis, worst unit: 8 units have no value"),
        ("slow.toml", "warning: a press takes over 100 s: `hold_s` and `sample_s` are in seconds"),
        ("no-test.toml", "warning: the recipe has an acceptance rule, but no step with `phase = \"test\"`"),
    ] {
        let output = bench.palpate_ends(0, &format!("check {recipe}"));
        assert!(output.running().contains(expected), "{}", output.err);
    }
}

#[test]
fn each_row_is_acknowledged_by_one_json_object_equal_to_its_line_in_the_table() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    let output = bench.palpate_ends(0, "run r.toml --json --out run");
    let (header, rows) = bench.table("run/presses.csv");
    let objects = output.json_lines();
    assert_eq!((objects.len(), rows.len()), (SMALL_ROWS, SMALL_ROWS));
    for (object, row) in objects.iter().zip(&rows) {
        let object = object.as_object().expect("an object");
        assert_eq!(object.len(), header.len());
        for (column, cell) in header.iter().zip(row) {
            match &object[column] {
                Value::Number(number) => assert_eq!(number.as_f64(), cell.parse().ok(), "{column}"),
                Value::Null => assert_eq!(cell, "", "{column}"),
                other => assert_eq!(other, cell.as_str(), "{column}"),
            }
        }
    }
    assert!(output.err.contains("complete: 7 of 7 presses, run"), "the summary goes to standard error: {}", output.err);
}

#[test]
fn run_folder_has_recipe_measured_and_true_values() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    let output = bench.palpate_ends(0, "run r.toml --out run --full --seed 5 --sensor A-017");
    let names: Vec<String> = bench.bytes("run").into_iter().map(|(name, _)| name).collect();
    let tables = ["calibration_matrix.csv", "characteristics.csv", "presses.csv", "scene.csv", "test_matrix.csv"];
    for name in tables.iter().chain(&["journal.log", "manifest.json", "recipe.toml", "rig.toml"]) {
        assert!(names.iter().any(|there| there == name), "{name} isn't in {names:?}");
    }
    assert!(tables.iter().all(|table| output.out.contains(table)), "the summary names the tables: {}", output.out);
    assert!(names.iter().all(|name| !name.starts_with('.')), "no drafts are left: {names:?}");

    let manifest = bench.manifest("run");
    assert_eq!(manifest["status"], "complete");
    assert_eq!(manifest["presses_planned"], SMALL_PRESSES);
    assert_eq!(manifest["presses_done"], SMALL_PRESSES);
    assert_eq!((&manifest["seed"], &manifest["sensor"]), (&json!(5), &json!("A-017")));
    assert!(manifest["virtual_s"].as_f64() > Some(10.0) && manifest["wall_s"].as_f64() > Some(0.0), "{manifest}");
    let session = &manifest["sessions"][0];
    assert_eq!((&session["palpate"], &session["durability"]), (&json!(env!("CARGO_PKG_VERSION")), &json!("full")));
    assert!(["host", "system", "started"].iter().all(|key| session[key].as_str() > Some("")), "{manifest}");
    assert!(manifest["ended"].as_str().is_some_and(|ended| ended.ends_with(']')), "with its time zone: {manifest}");
    let roles: Vec<&Value> = manifest["devices"].as_array().expect("devices").iter().map(|d| &d["role"]).collect();
    assert_eq!(roles, ["stage", "load_cell", "array"]);

    let (header, rows) = bench.table("run/presses.csv");
    let outputs: Vec<String> = (1..=9).map(|unit| format!("out_{unit}")).collect();
    let before = ["press", "level", "phase", "x_mm", "y_mm", "force_set_n", "force_n", "u_force_n", "depth_mm", "t_s"];
    let agreed: Vec<&str> = before.into_iter().chain(outputs.iter().map(String::as_str)).chain(["flags"]).collect();
    assert_eq!(header[..agreed.len()], agreed[..]);
    let numbered: Vec<String> = rows.iter().map(|row| row[..3].join(" ")).collect();
    let expected = [
        "0 0 characterisation",
        "0 1 characterisation",
        "0 2 characterisation",
        "0 3 characterisation",
        "0 4 characterisation",
        "1 0 calibration",
        "2 0 calibration",
        "3 0 calibration",
        "4 0 calibration",
        "5 0 test",
        "6 0 test",
    ];
    assert_eq!(numbered, expected);
    assert_eq!(bench.column("run/presses.csv", "force_set_n")[..6], ["0", "1", "2", "1", "0", "1"]);
    let (header, truth) = bench.table("run/scene.csv");
    assert_eq!(header, ["press", "level", "force_true_n", "force_peak_n", "depth_peak_mm"]);
    let numbered = |rows: &[Vec<String>]| rows.iter().map(|row| row[..2].to_vec()).collect::<Vec<_>>();
    assert_eq!(numbered(&truth), numbered(&rows), "a row of scene.csv a row");
    let (header, _) = bench.table("run/characteristics.csv");
    let agreed = [
        "unit",
        "repeatability_loading_percent",
        "repeatability_unloading_percent",
        "hysteresis_percent",
        "hysteresis_of_reading_percent",
        "linearity_percent",
        "zero_return_percent",
        "repeatability_loading_least_percent",
        "repeatability_loading_most_percent",
        "repeatability_unloading_least_percent",
        "repeatability_unloading_most_percent",
    ];
    assert_eq!(header, agreed);
}

#[test]
fn a_complete_run_is_left_alone_by_resume() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let before = bench.bytes("run");
    let output = bench.palpate_ends(0, "resume run");
    assert!(output.err.contains("run is complete: nothing to do"), "{output:?}");
    assert_eq!(bench.bytes("run"), before);
}

#[test]
fn run_gets_the_first_free_name() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    for expected in ["runs/small", "runs/small-2", "runs/small-3"] {
        assert!(!bench.has(expected));
        let output = bench.palpate_ends(0, "run r.toml");
        assert!(output.out.contains(&format!("complete: 7 of 7 presses, {expected}\n")), "{}", output.out);
        assert_eq!(bench.manifest(expected)["status"], "complete");
    }
}

#[test]
fn progress_without_a_terminal_is_plain_lines() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    let output = bench.palpate_ends(0, "run r.toml");
    assert!(!output.err.contains(['\u{1b}', '\r']) && !output.out.contains(['\u{1b}', '\r']), "{output:?}");
    for expected in ["characterisation: from press 1 of 7", "calibration: from press 2 of 7", "100 %: 7 of 7 presses"] {
        assert!(output.err.contains(expected), "{expected:?} isn't in\n{}", output.err);
    }
}

#[test]
fn evaluation_of_the_recipe_decides_the_exit_code() {
    let text = SMALL.to_owned() + "[evaluate]\nsolvers = [\"pearson\", \"pearson-lsq\"]\n";
    let bench = TestFolder::with([("r.toml", text.as_str())]);
    let output = bench.palpate("run r.toml --out run");
    let alone = bench.palpate("evaluate run --solver pearson");
    assert_eq!(output.code, alone.code);
    for expected in ["pearson-lsq", "location error, mean", "virtual time", "run\n", "hysteresis"] {
        assert!(output.out.contains(expected), "{expected:?} isn't in\n{}", output.out);
    }
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    let output = TestFolder::with([("r.toml", text.as_str())]).palpate("run r.toml --json");
    assert_eq!(output.json_lines().len(), SMALL_ROWS, "nothing but rows on standard output");
}
