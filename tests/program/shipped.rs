//! Shipped files work: every recipe on every rig.

use palpate_data::recipe::{self, Recipe};
use palpate_testing::{SMALL, TestFolder, campaign, exchanged, shipped, shipped_text};
use serde_json::json;
use std::fs;

#[test]
fn every_recipe_can_be_run_on_every_rig() {
    let (recipes, rigs) = (files("recipes"), files("rigs"));
    assert!(recipes.len() >= 5 && rigs.len() >= 2, "{recipes:?} {rigs:?}");
    let bench = TestFolder::new();
    for recipe in &recipes {
        // its readings are a file of Arrow
        let needs_files = recipe.ends_with("over-time.toml") && cfg!(not(feature = "files"));
        for rig in &rigs {
            if needs_files {
                let refused = bench.palpate_ends(2, &format!("check {recipe} --rig {rig}")).running();
                assert!(refused.contains("`series` needs the feature `files`"), "{refused}");
                continue;
            }
            let output = bench.palpate_ends(0, &format!("check {recipe} --rig {rig}"));
            // an arm is too coarse for the recipe that asks for 10 mN
            let is_coarse = recipe.ends_with("bench.toml") && rig.ends_with("ur.toml");
            assert_eq!(
                output.err.contains("the force tolerance is 0.01 N"),
                is_coarse,
                "{recipe} on {rig}: {output:?}"
            );
            assert!(output.out.contains("largest force") && (is_coarse || output.err.is_empty()), "{output:?}");
        }
    }
}

#[test]
fn a_plan_is_described_in_presses_levels_force_and_time() {
    let output = TestFolder::new().palpate_ends(0, &format!("check {}", shipped("recipes/paper.toml").display()));
    let rows: Vec<Vec<&str>> = output.out.lines().map(|line| line.split_whitespace().collect()).collect();
    for expected in [["characterisation", "45", "405"], ["calibration", "625", "625"], ["test", "100", "100"]] {
        assert!(rows.iter().any(|row| row.starts_with(&expected)), "{expected:?} isn't in\n{}", output.out);
    }
    for expected in ["together 770 1130", "largest force 2 N, limit 2 N", "travel -12.5 to 12.5 mm"] {
        assert!(rows.iter().any(|row| row.join(" ").contains(expected)), "{expected:?} isn't in\n{}", output.out);
    }
}

#[test]
fn bench_recipe_is_the_grid_of_the_paper_with_training_in_another_order() {
    let described = |more: &str| {
        let output =
            TestFolder::new().palpate_ends(0, &format!("check {} {more}", shipped("recipes/bench.toml").display()));
        output.out.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect::<Vec<_>>()
    };
    let (mapped, guarded) = (described(""), described("--strategy guarded"));
    let has = |lines: &[String], start: &str| lines.iter().any(|line| line.starts_with(start));
    for start in ["teach 5 5 ", "calibration 625 625 ", "together 630 630 "] {
        assert!(has(&mapped, start), "{start}: {mapped:?}");
    }
    assert!(has(&guarded, "together 625 625 ") && !has(&guarded, "teach"), "{guarded:?}");
}

#[test]
fn the_characterisation_runs_on_the_simulated_rig() {
    let recipe = shipped_text("recipes/characterise.toml");
    let recipe = thinned(&recipe, "repeats = 5", "repeats = 2");
    let bench = TestFolder::with([("r.toml", recipe.as_str())]);
    bench.palpate_ends(0, &format!("run r.toml --rig {} --out run", shipped("rigs/sim.toml").display()));
    assert_complete(&bench);
    assert_eq!(bench.column("run/characteristics.csv", "unit"), ["1", "2", "3", "4", "5", "6", "7", "8", "9"]);
    assert!(!bench.has("run/calibration_matrix.csv") && !bench.has("run/test_matrix.csv"));
}

#[test]
fn the_calibration_runs_on_the_real_rigs_file_with_simulate() {
    let recipe = thinned(&shipped_text("recipes/calibrate.toml"), "spacing_mm = 0.5", "spacing_mm = 2.0");
    let bench = TestFolder::with([("r.toml", recipe.as_str())]);
    bench.palpate_ends(0, &format!("run r.toml --rig {} --simulate --out run", shipped("rigs/esp301.toml").display()));
    assert_complete(&bench);
    assert!(bench.has("run/calibration_matrix.csv") && !bench.has("run/test_matrix.csv"));
    assert_eq!(bench.read("run/rig.toml"), shipped_text("rigs/esp301.toml"), "the rig is kept as given");
}

#[test]
fn test_recipe_gives_equal_results_on_both_rigs() {
    // without its lines, whose bytes take time
    let without_a_rate =
        |line: &str| if line.starts_with("link = ") { "link = \"sim\"\n".to_owned() } else { format!("{line}\n") };
    let rig: String = shipped_text("rigs/esp301.toml").lines().map(without_a_rate).collect();
    let bench = TestFolder::with([("rig.toml", rig.as_str())]);
    let recipe = shipped("recipes/test.toml");
    bench.palpate_ends(0, &format!("run {} --rig {} --out run", recipe.display(), shipped("rigs/sim.toml").display()));
    assert_complete(&bench);
    bench.palpate_ends(0, &format!("run {} --rig rig.toml --out again", recipe.display()));
    // a simulated rig without a scene has the paper's
    assert_eq!(bench.read("run/presses.csv"), bench.read("again/presses.csv"));
}

#[test]
fn without_a_rig_that_of_the_paper_is_simulated_in_any_folder() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml");
    assert_eq!(bench.read("runs/small/rig.toml"), shipped_text("rigs/sim.toml"));
    assert_eq!(bench.read("runs/small/recipe.toml"), SMALL);
    bench.palpate_ends(0, "run r.toml");
    assert_eq!(bench.read("runs/small/presses.csv"), bench.read("runs/small-2/presses.csv"));
}

#[test]
fn recipe_of_the_paper_is_the_three_others_in_sequence() {
    let paper = recipe("recipes/paper.toml");
    let parts = ["recipes/characterise.toml", "recipes/calibrate.toml", "recipes/test.toml"].map(recipe);
    let of_parts: Vec<String> = parts.iter().flat_map(|part| part.steps.iter().map(step)).collect();
    assert_eq!(paper.steps.iter().map(step).collect::<Vec<_>>(), of_parts);
    assert_eq!(paper.solvers, ["pearson", "pearson-lsq"]);
    assert!(parts.iter().all(|part| part.solvers.is_empty()), "only the whole protocol can be evaluated");
}

#[test]
fn real_rig_equals_the_simulated_one_except_for_links_and_scene() {
    let table = |path| shipped_text(path).parse::<toml::Table>().expect("a rig is TOML");
    let (mut simulated, mut real) = (table("rigs/sim.toml"), table("rigs/esp301.toml"));
    assert!(simulated.remove("scene").is_some() && !real.contains_key("scene"));
    for role in ["stage", "load_cell", "array"] {
        let link = |rig: &mut toml::Table| rig[role].as_table_mut().and_then(|table| table.remove("link"));
        assert_eq!(link(&mut simulated), Some("sim".into()));
        let address = link(&mut real).and_then(|link| link.as_str().map(str::to_owned)).expect("a link");
        assert!(address.starts_with("serial://") || address.starts_with("tcp://"), "{role}: {address}");
    }
    assert_eq!(simulated, real);
}

/// A step without its place in the text.
fn step(step: &recipe::Step) -> String {
    let recipe::Step { phase, places, load, manner, .. } = step;
    format!("{phase:?} {places:?} {load:?} {manner:?}")
}

fn recipe(path: &str) -> Recipe {
    recipe::parse(path, &shipped_text(path)).unwrap_or_else(|problems| panic!("{:?}", problems.lines()))
}

/// The paths of the shipped files in a folder.
fn files(folder: &str) -> Vec<String> {
    let entries = fs::read_dir(shipped(folder)).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut paths: Vec<_> = entries.map(|path| path.display().to_string()).collect();
    paths.retain(|path| path.ends_with(".toml"));
    paths.sort();
    paths
}

/// As shipped in the full tier; otherwise with fewer presses.
fn thinned(recipe: &str, from: &str, to: &str) -> String {
    let fewer = exchanged(recipe, from, to);
    if campaign::is_quick() { fewer } else { recipe.to_owned() }
}

fn assert_complete(bench: &TestFolder) {
    let manifest = bench.manifest("run");
    assert_eq!(manifest["status"], "complete");
    assert_eq!(manifest["presses_done"], manifest["presses_planned"]);
    assert_eq!((&manifest["simulated"], &manifest["seed"]), (&json!(true), &json!(1)));
    let most_n =
        bench.column("run/scene.csv", "force_peak_n").iter().map(|n| n.parse::<f64>().expect("N")).fold(0.0, f64::max);
    assert!(most_n <= 2.0, "the specimen felt {most_n} N");
    let rows = bench.column("run/presses.csv", "flags");
    assert!(rows.iter().all(String::is_empty), "flagged rows: {rows:?}");
    assert_eq!(bench.column("run/scene.csv", "press").len(), rows.len());
}

#[test]
fn shipped_files_are_found_by_name_from_any_folder_and_a_file_of_the_user_wins() {
    let bench = TestFolder::new();
    let by_path = bench.palpate_ends(0, &format!("check {}", shipped("recipes/paper.toml").display())).out;
    for name in ["paper", "paper.toml", "recipes/paper.toml"] {
        assert_eq!(bench.palpate_ends(0, &format!("check {name}")).out, by_path, "{name}");
    }
    bench.palpate_ends(0, "check paper --rig bench-fast");
    let listed = bench.palpate_ends(0, "list").out;
    assert!(listed.lines().all(|line| line.chars().count() <= 80), "{listed}");
    assert!(listed.contains("\n  paper         The paper's whole protocol"), "{listed}");

    bench.write("paper", SMALL);
    assert!(bench.palpate_ends(0, "check paper").out != by_path, "the file named paper is read");
    let output = bench.palpate_ends(2, "check papr").running();
    assert!(output.contains("give an existing file or a shipped one: paper, calibrate,"), "{output}");
}

#[test]
fn the_batch_recipe_rejects_a_sensor_with_a_clipped_unit_whose_errors_are_small() {
    let rig =
        shipped_text("rigs/batch.toml") + "\n[[scene.taxel_fault]]\nunit = 5\nkind = \"clipped\"\nreading = 0.3\n";
    let bench = TestFolder::with([("clipped.toml", rig.as_str())]);
    let output = bench.palpate_ends(1, "run batch --rig clipped.toml --seed 45 --evaluate recipe").out;
    assert!(output.contains("NOT ACCEPTED") && output.contains("broken channels 1 exceeds the limit 0"), "{output}");
    assert!(output.contains("and 2 within their limits"), "{output}");
    assert!(output.find("\nbroken: output 5 saturates\n") < output.find("\nNOT ACCEPTED"), "{output}");
    let page = bench.palpate_ends(1, "evaluate runs/batch --json").out;
    assert!(page.contains(r#""broken_outputs":["output 5 saturates"]"#), "{page}");
}
