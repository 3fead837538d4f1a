//! Wrong input never moves the stage: exit 2, every problem with its file, line, column and correction, and no run folder.

use palpate_testing::twins::{RECIPE_TWINS, RIG_TWINS, Twin};
use palpate_testing::{CommandOutput, SMALL, TestFolder, exchanged, shipped_text};

const RIG: &str = "rigs/sim.toml";

#[test]
fn a_suggestion_never_changes_what_the_data_mean() {
    for (phase, suggested) in [("validation", None), ("tset", Some("test")), ("calibratoin", Some("calibration"))] {
        let recipe = exchanged(SMALL, "phase = \"calibration\"", &format!("phase = \"{phase}\""));
        let bench = TestFolder::with([("r.toml", recipe.as_str())]);
        let output = bench.palpate_ends(2, "check r.toml");
        let output = output.running();
        assert!(output.contains("expected one of characterisation, calibration, test") || suggested.is_some());
        match suggested {
            Some(word) => assert!(output.contains(&format!("did you mean `{word}`?")), "{output}"),
            None => assert!(!output.contains("did you mean"), "{output}"),
        }
    }
}

#[test]
fn each_wrong_variant_is_refused_at_its_line_by_check_and_run() {
    for Twin { from, to, parts, .. } in RECIPE_TWINS {
        let bench = TestFolder::with([("r.toml", exchanged(SMALL, from, to).as_str())]);
        for words in ["check r.toml", "run r.toml", "run r.toml --json --out there"] {
            assert_refused(&bench, words, parts);
        }
    }
}

#[test]
fn recipe_of_the_wrong_variants_is_valid() {
    let output = TestFolder::with([("r.toml", SMALL)]).palpate_ends(0, "check r.toml");
    assert!(output.out.contains("plan small, seed 1") && output.err.is_empty(), "{output:?}");
}

#[test]
fn several_problems_are_reported_at_once_in_the_order_of_their_lines() {
    let text = exchanged(&exchanged(SMALL, "to_n = 2.0", "to_n = \"2 N\""), "spacing_mm = 4.0", "spacing_mm = 0.7");
    let bench = TestFolder::with([("r.toml", exchanged(&text, "count = 2", "count = 2.5").as_str())]);
    let places = ["r.toml:10:22", "r.toml:14:63", "r.toml:19:20"];
    let output = assert_refused(&bench, "run r.toml", &places);
    assert!(places.map(|place| output.err.find(place)).is_sorted(), "{}", output.err);
}

#[test]
fn a_misspelt_place_of_a_step_is_reported_with_its_nearest_spelling() {
    let bench = TestFolder::with([("r.toml", exchanged(SMALL, "units = [5]", "unit = [5]").as_str())]);
    assert_refused(&bench, "run r.toml", &["unknown key `unit` in `step`", "r.toml:9:1", "did you mean `units`?"]);
}

#[test]
fn a_recipe_that_is_not_there_or_not_text_is_reported_by_its_name() {
    let bench = TestFolder::new();
    assert_refused(&bench, "run none.toml", &["none.toml", "give an existing file"]);
    assert_refused(&bench, "check none.toml", &["none.toml", "give an existing file"]);
    std::fs::write(bench.path("noise.toml"), [0xFD, 0xFE, 0x00]).expect("writes");
    assert_refused(&bench, "run noise.toml", &["noise.toml", "UTF-8", "this file isn't text"]);
    let utf16: Vec<u8> = "\u{feff}name = \"a\"\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    std::fs::write(bench.path("windows.toml"), utf16).expect("writes");
    assert_refused(&bench, "run windows.toml", &["windows.toml", "it is UTF-16: save it as UTF-8"]);
    bench.write("empty.toml", "");
    assert_refused(&bench, "run empty.toml", &["empty.toml:1:1", "there is no [[step]]: nothing to press"]);
}

#[test]
fn a_solver_that_does_not_exist_is_refused_before_anything_moves() {
    let text = SMALL.to_owned() + "[evaluate]\nsolvers = [\"pearson\", \"pearson-lsd\"]\n";
    let bench = TestFolder::with([("r.toml", text.as_str())]);
    for words in ["check r.toml", "run r.toml"] {
        assert_refused(&bench, words, &["pearson-lsd", "pearson-lsq", "r.toml:21:"]);
    }
    bench.write("a.csv", "x_mm,y_mm,out_1,out_2\n0,0,1,2\n");
    assert_refused(&bench, "evaluate --calibration a.csv --test a.csv --solver person", &["'person'", "pearson-lsq"]);
}

#[test]
fn an_evaluation_without_anything_to_evaluate_is_refused_before_anything_moves() {
    let without_test = SMALL.split("[[step]]\nphase = \"test\"").next().unwrap_or_default();
    let bench = TestFolder::with([("r.toml", format!("{without_test}[evaluate]\n").as_str())]);
    for words in ["check r.toml", "run r.toml"] {
        assert_refused(&bench, words, &["r.toml:17:1", "test"]);
    }
}

#[test]
fn a_rig_that_cannot_be_used_is_refused_at_its_line() {
    let sim = shipped_text(RIG);
    let bench = TestFolder::with([("r.toml", SMALL)]);
    for Twin { from, to, parts, .. } in RIG_TWINS {
        bench.write("rig.toml", &exchanged(&sim, from, to));
        assert_refused(&bench, "check r.toml --rig rig.toml", parts);
        assert_refused(&bench, "run r.toml --rig rig.toml", parts);
    }
    assert_refused(&bench, "run r.toml --rig none.toml", &["none.toml", "give an existing file"]);
}

#[test]
fn a_folder_that_exists_is_never_touched() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    for (name, file) in [("full", Some("note.txt")), ("empty", None)] {
        std::fs::create_dir(bench.path(name)).expect("makes");
        if let Some(file) = file {
            bench.write(&format!("{name}/{file}"), "mine");
        }
        let before = bench.bytes(name);
        let words = format!("run r.toml --out {name}");
        assert_refused(&bench, &words, &[&format!("{name} already exists"), "choose another --out"]);
        assert_eq!(bench.bytes(name), before);
    }
    bench.write("file", "mine");
    assert_refused(&bench, "run r.toml --out file", &["file already exists"]);
    assert_eq!(bench.read("file"), "mine");
}

#[test]
fn wrong_command_line_is_refused_with_a_correction() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    for (words, parts) in [
        ("", ["Usage: palpate", "check"]),
        ("chek r.toml", ["unrecognized subcommand 'chek'", "'check'"]),
        ("run", ["required", "<RECIPE>"]),
        ("run r.toml --sede 7", ["'--sede'", "'--seed"]),
        ("run r.toml --seed x", ["'x'", "expected a whole number, 0 to 18446744073709551615"]),
        ("run r.toml --seed -1", ["'-1'", "expected a whole number, 0 to 18446744073709551615"]),
        ("evaluate", ["`evaluate` needs a run or two tables", "palpate evaluate runs/paper"]),
        ("import t.csv --out there --columns scale.x_mm=1000", ["factors and offsets need a columns file", "[scale]"]),
        ("import t.csv --out there --columns x_mm:X,y_mm:Y", ["the short form is x_mm=X,y_mm=Y", "no such file"]),
        ("run r.toml --strategy mapped", ["'mapped'", "expected one of guarded, velocity, map"]),
        ("run r.toml --pace 0", ["'0'", "1 is real time"]),
        ("run r.toml --pace nan", ["'nan'", "expected a number above 0"]),
        ("resume none", ["none doesn't exist", "palpate run"]),
        ("evaluate none", ["none doesn't exist", "palpate run"]),
        ("emulate none.toml", ["none.toml", "give an existing file"]),
    ] {
        assert_refused(&bench, words, &parts);
    }
}

/// It ends with 2 and prints each part; no file was created.
fn assert_refused(bench: &TestFolder, words: &str, parts: &[&str]) -> CommandOutput {
    let output = bench.palpate(words);
    let running = output.running();
    assert_eq!(output.code, Some(2), "palpate {words}\n{}\n{}", output.out, output.err);
    for part in parts {
        assert!(running.contains(part), "palpate {words} doesn't say {part:?}:\n{}", output.err);
    }
    let is_rig = |line: &str| line.starts_with("rig ");
    assert!(output.out.lines().all(is_rig), "palpate {words} says on standard output: {}", output.out);
    assert!(!bench.has("runs") && !bench.has("there"), "palpate {words} left a folder");
    output
}

#[test]
fn a_folder_that_cant_be_made_is_reported_before_anything_is_pressed() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    let output = bench.palpate("run r.toml --out /proc/none/run");
    assert_eq!(output.code, Some(5), "{}", output.err);
    assert!(output.running().contains("nothing was pressed: choose another --out"), "{}", output.err);
    assert!(!output.running().contains("resume"), "{}", output.err);
}

#[test]
fn a_mistake_in_a_file_that_a_rig_names_keeps_its_suggestion() {
    let map = shipped_text("profiles/generic-rs485.toml").replacen("newton_per_unit", "newtons_per_unit", 1);
    let rig = shipped_text("rigs/esp301.toml").replace("modbus = \"generic-rs485\"", "modbus = \"mine.toml\"");
    let bench = TestFolder::with([("rig.toml", rig.as_str()), ("mine.toml", map.as_str())]);
    let parts = ["mine.toml:", "unknown key `newtons_per_unit`", "did you mean `newton_per_unit`?"];
    assert_refused(&bench, "check calibrate --rig rig.toml", &parts);
}

#[test]
fn an_invalid_force_of_random_is_the_only_problem_of_its_step() {
    let text = exchanged(SMALL, "force_n = [0.5, 1.0]", "force_n = [0.0, 1.0]");
    let bench = TestFolder::with([("r.toml", text.as_str())]);
    let output = assert_refused(&bench, "check r.toml", &["`force_n` is 0, must be over 0", "one problem"]);
    assert!(!output.err.contains("this step has no force"), "{}", output.err);
}

#[test]
fn a_number_for_all_units_is_reported_how_many_it_needs() {
    let rig = shipped_text(RIG);
    let start = rig.find("repeatability_percent = [").expect("a list");
    let end = start + rig[start..].find(']').expect("its end") + 1;
    let one = format!("{}repeatability_percent = 2{}", &rig[..start], &rig[end..]);
    let bench = TestFolder::with([("rig.toml", one.as_str()), ("r.toml", SMALL)]);
    let expected = "`repeatability_percent` is an integer, expected a list of 9 numbers, one for each unit";
    assert_refused(&bench, "check r.toml --rig rig.toml", &[expected]);
}

#[test]
fn a_million_presses_are_refused_by_a_limit_that_can_be_raised_by_its_name() {
    let step = "random = { count = 1000000, x_mm = [-2.0, 2.0], y_mm = [-2.0, 2.0], force_n = [0.5, 1.0] }";
    let text = format!("name = \"million\"\nrig = \"sim\"\n[[step]]\nphase = \"test\"\n{step}\n");
    let bench = TestFolder::with([("r.toml", text.as_str())]);
    for words in ["check r.toml", "run r.toml --out run"] {
        let output = bench.palpate_ends(2, words);
        assert!(
            output.err.contains("r.toml:5:") && output.running().contains("1000000 presses, but at most 100000"),
            "{}",
            output.err
        );
        assert!(output.running().contains("--presses-max 1000000"), "{}", output.err);
    }
    assert!(!bench.has("run"));
    let output = bench.palpate_ends(0, "check r.toml --presses-max 1000000");
    assert!(output.out.contains("1000000"), "{}", output.out);
    bench.palpate_ends(2, "check r.toml --presses-max 10000001");
}
