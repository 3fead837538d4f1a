//! `docs/explanation/validation.md` has the results of the program: its numbers are those of the runs, and the paper's numbers are those of
//! the paper.

use palpate_data::dataset::characteristics::UnitCharacteristics;
use palpate_solver::Evaluation;
use palpate_study::validation::{SEEDS, Validation, ValidationOutcome, validation};
use palpate_testing::{TestFolder, campaign, shipped_text};
use serde_json::Value;
use std::sync::LazyLock;

/// The paper's numbers (Sensors 2018, 18, 351), copied from it and not from the program: name, value, digits here, unit.
const PAPERS: [(&str, &str, usize, &str); 5] = [
    ("location error, mean", "0.46", 3, "mm"),
    ("location error under 1 mm", "93", 1, "%"),
    ("force error, mean", "0.043", 4, "N"),
    ("force error under 0.1 N", "91", 1, "%"),
    ("both under", "84", 1, "%"),
];

/// Its Table 1: unit, repeatability loading and unloading, hysteresis.
const TABLE_1: [[&str; 4]; 9] = [
    ["1", "1.60", "1.07", "4.11"],
    ["2", "3.74", "2.78", "2.29"],
    ["3", "2.19", "2.32", "2.88"],
    ["4", "0.83", "1.97", "3.08"],
    ["5", "0.51", "1.44", "3.39"],
    ["6", "1.02", "1.24", "5.53"],
    ["7", "0.71", "0.39", "3.99"],
    ["8", "2.84", "3.23", "4.44"],
    ["9", "3.97", "4.89", "5.19"],
];

/// The protocol once, with the seed of a specimen: the quick tier makes no other runs.
static ONCE: LazyLock<Validation> =
    LazyLock::new(|| validation(1, 3, &|_, _| {}).expect("the shipped recipe and rig are sound"));

/// The page has the paper's numbers, and the same words as the page of a single run.
fn the_page_is_what_the_program_writes_but_for_its_numbers() {
    let (found, page) = (ONCE.markdown(), shipped_text("docs/explanation/validation.md"));
    let words = |text: &str| {
        // one line counts the runs in words
        let is_count = |line: &str| line.starts_with("Best is what cross-validation");
        let is_prose = |line: &&str| !line.contains(|c: char| c.is_ascii_digit()) && !is_count(line);
        text.lines().filter(is_prose).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(words(&found), words(&page));
    assert!(words(&page).len() > 10, "{page}");
    for (name, paper, _, unit) in PAPERS {
        assert!(page.contains(&format!("| {name} | {paper} {unit} | ")), "{name}");
    }
    for [unit, loading, unloading, hysteresis] in TABLE_1 {
        let is_row = |line: &str| {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            cells.len() == 9 && [cells[1], cells[2], cells[4], cells[6]] == [unit, loading, unloading, hysteresis]
        };
        assert!(page.lines().any(is_row), "unit {unit}");
    }
}

#[test]
fn validation_page_has_the_numbers_of_its_runs() {
    if campaign::is_quick() {
        return the_page_is_what_the_program_writes_but_for_its_numbers();
    }
    let found = validation(SEEDS, 1, &|_, _| {}).expect("the shipped recipe and rig are sound");
    let page = shipped_text("docs/explanation/validation.md");
    for (line, (found, kept)) in found.markdown().lines().zip(page.lines()).enumerate() {
        assert_eq!(found, kept, "line {}: `palpate study validation` regenerates it", line + 1);
    }
    assert_eq!(found.markdown(), page);
    for (name, paper, digits, unit) in PAPERS {
        let of = |which: fn(&ValidationOutcome) -> &Evaluation| {
            mean_and_sd(&found.outcomes.iter().map(|outcome| number(name, which(outcome))).collect::<Vec<f64>>())
        };
        let [(mean, sd), (best_mean, best_sd)] = [of(|outcome| &outcome.papers), of(|outcome| &outcome.best)];
        let away = (paper.parse::<f64>().expect("a number") - mean) / sd;
        let row = format!(
            "| {name} | {paper} {unit} | {mean:.digits$} ± {sd:.digits$} {unit} | {away:+.1} | \
             {best_mean:.digits$} ± {best_sd:.digits$} {unit} |"
        );
        assert!(page.lines().any(|line| line == row), "the page doesn't say\n{row}");
    }
    for [unit, loading, unloading, hysteresis] in TABLE_1 {
        let of = |part: fn(&UnitCharacteristics) -> Option<f64>| mean_of_unit(&found, unit, part);
        let row = format!(
            "| {unit} | {loading} | {:.2} | {unloading} | {:.2} | {hysteresis} | {:.2} |",
            of(|u| u.repeatability_loading_percent),
            of(|u| u.repeatability_unloading_percent),
            of(|u| u.hysteresis_percent)
        );
        assert!(page.lines().any(|line| line == row), "the page doesn't say\n{row}");
    }
}

#[test]
fn a_specimen_of_the_study_is_the_run_of_its_seed() {
    let bench = TestFolder::with([
        ("paper.toml", shipped_text("recipes/paper.toml").as_str()),
        ("rig.toml", &shipped_text("rigs/paper.toml")),
    ]);
    let outcome = &ONCE.outcomes[0];
    bench.palpate_ends(0, "run paper.toml --rig rig.toml --seed 3 --out run");
    let solvers = [("pearson", &outcome.papers), ("best", &outcome.best)];
    let tried = if campaign::is_quick() { 1 } else { solvers.len() };
    for (solver, of_study) in solvers.into_iter().take(tried) {
        let output = bench.palpate_ends(0, &format!("evaluate run --json --solver {solver}")).json_lines();
        for (key, expected) in
            [("location_error_mm", Some(of_study.location_error_mm)), ("force_error_n", of_study.force_error_n)]
        {
            let expected = expected.expect("errors");
            for (part, expected) in [("mean", expected.mean), ("p95", expected.p95), ("max", expected.max)] {
                let found = output[0][key][part].as_f64().expect("a number");
                assert!((found - expected).abs() < 1e-12, "{solver}: {key} {part} {found}, in the study {expected}");
            }
        }
    }
}

/// A number of an evaluation by its name on the page.
fn number(name: &str, evaluation: &Evaluation) -> f64 {
    let Evaluation { location_error_mm, force_error_n, within, .. } = evaluation;
    match name {
        "location error, mean" => location_error_mm.mean,
        "location error under 1 mm" => 100.0 * within.location_1mm,
        "force error, mean" => force_error_n.expect("forces").mean,
        "force error under 0.1 N" => 100.0 * within.force_0_1n.expect("forces"),
        "both under" => 100.0 * within.both.expect("forces"),
        _ => panic!("{name}"),
    }
}

fn mean_and_sd(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    (mean, (squares / (values.len() as f64 - 1.0)).sqrt())
}

fn mean_of_unit(found: &Validation, unit: &str, part: fn(&UnitCharacteristics) -> Option<f64>) -> f64 {
    let index = unit.parse::<usize>().expect("a number") - 1;
    let values: Vec<f64> = found.outcomes.iter().filter_map(|outcome| part(&outcome.table_1[index])).collect();
    assert_eq!(values.len(), SEEDS, "unit {unit}");
    mean_and_sd(&values).0
}

#[test]
fn quick_validation_has_a_row_for_each_specimen_and_is_reproducible() {
    if campaign::is_quick() {
        let rows: Vec<Value> = ONCE.ndjson().lines().map(|row| serde_json::from_str(row).expect("JSON")).collect();
        return check_rows(&rows, &[3]);
    }
    let bench = TestFolder::new();
    let rows = bench.palpate_ends(0, "study validation --quick --json --seed 7 --out a").json_lines();
    check_rows(&rows, &[7, 8]);
    let output = bench.palpate_ends(0, "study validation --quick --seed 7 --out b");
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    assert_eq!(bench.bytes("a"), bench.bytes("b"));
}

/// Each specimen and each claim has a row.
fn check_rows(rows: &[Value], expected: &[u64]) {
    let seeds: Vec<u64> = rows.iter().filter_map(|row| row["seed"].as_u64()).collect();
    assert_eq!(seeds, expected);
    let specimens: Vec<&Value> = rows.iter().filter(|row| row["study"] == "validation").collect();
    assert_eq!(specimens.len(), seeds.len());
    for row in specimens {
        assert_eq!((row["presses"].as_u64(), row["papers"]["points"].as_u64()), (Some(770), Some(100)));
        assert!(
            row["best"]["location_error_mm"]["mean"].as_f64() < row["papers"]["location_error_mm"]["mean"].as_f64()
        );
    }
    assert!(rows.iter().any(|row| row["verdict"] == "fails"), "claims are among the rows");
}
