//! JSON output of the commands, and standard input as a file.

use palpate_testing::{TestFolder, shipped};

/// Commands whose result can be one JSON object, in an order in which each finds the files of the earlier ones, and one of its keys.
const COMMANDS: [(&str, &str); 17] = [
    ("check batch --json", "plan"),
    ("run batch --dry-run --json", "warnings"),
    ("batch check batch --json", "chance"),
    ("verify run --json", "files_unchanged"),
    ("rebuild run --json", "presses_done"),
    ("report run --json", "page"),
    ("report run run --compare --json --out two.html", "result"),
    ("fit run --solver pearson-lsq --out s.palpate --json", "method"),
    ("adapt --from s.palpate --with run --solver pearson-lsq --out t.palpate --json", "mean_error"),
    ("export run --format csv --json", "written"),
    ("export --model s.palpate --format c --json", "written"),
    ("import run/presses.csv --out imported --json", "ranges"),
    ("retract batch --json", "z_mm"),
    ("align sim --dry-run --json", "tilt_mm_per_mm"),
    ("list --json", "recipes"),
    ("drivers --json", "drivers"),
    ("ports --json", "ports"),
];

#[test]
fn every_result_can_be_one_json_object() {
    let bench = TestFolder::new();
    bench.palpate_ends(0, "run batch --evaluate recipe --out run");
    for (words, key) in COMMANDS {
        let printed = bench.palpate_ends(0, words);
        let objects = printed.json_lines();
        assert!(objects.len() == 1 && !objects[0][key].is_null(), "{words}: {}", printed.out);
    }
    bench.write("run/presses.csv", "changed\n");
    let found = bench.palpate_ends(1, "verify run --json").json_lines().remove(0);
    assert!(found["problems"][0].as_str().is_some_and(|problem| problem.contains("presses.csv")), "{found}");
}

#[test]
fn a_result_is_printed_before_a_later_step_fails() {
    let bench = TestFolder::new();
    bench.palpate_ends(0, "run batch --evaluate recipe --out run");
    let printed = bench.palpate_ends(5, "adapt --from run --with run --solver pearson-lsq --out none/s.palpate");
    assert!(printed.out.contains("new presses, mean error (cross-validated)"), "{printed:?}");
}

#[test]
fn a_dash_is_standard_input_for_recipes_and_tables() {
    let bench = TestFolder::new();
    bench.palpate_ends(0, "run batch --evaluate recipe --out run");
    let recipe = std::fs::read_to_string(shipped("recipes/batch.toml")).expect("a recipe");
    assert_eq!(
        bench.palpate_reads("check - --rig batch --json", &recipe).json_lines(),
        bench.palpate_ends(0, "check batch --rig batch --json").json_lines()
    );
    let table = bench.read("run/presses.csv");
    let errors = |words: &str, input: &str| {
        let printed = bench.palpate_reads(words, input);
        printed.out.lines().skip(1).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(errors("evaluate -", &table), errors("evaluate run/presses.csv", ""));
    bench.palpate_reads("import - --out imported", &table);
    let manifest = bench.read("imported/manifest.json");
    assert!(manifest.contains("\"standard input\"") && !manifest.contains("\"-\""), "{manifest}");
    let batch = std::fs::read_to_string(shipped("batches/batch.toml")).expect("a batch");
    for (words, input, why) in [
        ("evaluate - -", &table, "is named twice"),
        ("solve --calibration -", &table, "has the readings"),
        ("batch run -", &batch, "has the serial numbers"),
    ] {
        let printed = bench.palpate_reads(words, input);
        assert!(printed.code == Some(2) && printed.running().contains(why), "{words}: {}", printed.err);
    }
}

#[test]
fn damaged_journal_is_reported_with_its_readable_records() {
    let bench = TestFolder::new();
    bench.palpate_ends(0, "run batch --evaluate recipe --out run");
    let journal = bench.read("run/journal.log");
    let at = journal.match_indices('\n').nth(19).expect("twenty records").0 + 1;
    let damaged = format!("{}X{}", &journal[..at + 40], &journal[at + 41..]);
    bench.write("run/journal.log", &damaged);
    let printed = bench.palpate_ends(1, "verify run").err.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(printed.contains("the 20 records before it are sound"), "{printed}");
    assert!(printed.contains(&format!("truncate --size {at} journal.log")), "{printed}");
    // the advice works
    bench.write("run/journal.log", &damaged[..at]);
    bench.palpate_ends(0, "rebuild run --accept-loss");
    bench.palpate_ends(0, "verify run");
}
