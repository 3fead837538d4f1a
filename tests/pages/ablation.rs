//! `palpate study ablation`: a small study gives the same result twice; a smaller one agrees with the whole one; and the shipped scenes
//! have no more terms than it justifies.

use palpate_study::ablation::{AblationFindings, AblationSize, Needed, QUESTIONS, TERMS, TermRow, ablation};
use palpate_testing::printed::is_narrow;
use palpate_testing::{TestFolder, campaign, shipped};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::sync::LazyLock;

/// Result of the whole study with seed 1: each necessary term, and for which question. A smaller study doesn't contradict it, and the
/// shipped scenes have no more terms.
const NEEDED: [(&str, &[&str]); 9] = [
    (
        "taxel noise",
        &[
            "paper-location",
            "paper-force",
            "surrogate-location",
            "surrogate-force",
            "physics-location",
            "physics-force",
            "repeatability-loading",
            "repeatability-unloading",
        ],
    ),
    ("noise of reading", &["repeatability-loading", "repeatability-unloading"]),
    ("hysteresis", &["hysteresis"]),
    ("taxel disc", &["paper-force", "surrogate-force"]),
    ("bonded layer", &["paper-force", "surrogate-location", "surrogate-force", "physics-location", "physics-force"]),
    (
        "drift of zeros",
        &[
            "paper-location",
            "paper-force",
            "surrogate-location",
            "surrogate-force",
            "physics-location",
            "physics-force",
            "repeatability-loading",
            "repeatability-unloading",
        ],
    ),
    ("force tolerance", &["paper-force", "surrogate-force", "physics-force"]),
    ("load-cell noise", &["press-error", "press-time"]),
    ("relaxation", &["press-error"]),
];

/// The key of a term in a rig's `[scene]`, if it has one.
const KEYS: [(&str, &str); 14] = [
    ("taxel noise", "taxel_noise"),
    ("noise of reading", "taxel_noise.of"),
    ("hysteresis", "hysteresis"),
    ("punch", "indenter"),
    ("taxel disc", "taxels.radius_mm"),
    ("bonded layer", "elastomer.bonded_poisson_ratio"),
    ("gains", "taxels.gain_spread_percent"),
    ("places", "taxels.place_spread_mm"),
    ("depths", "taxels.depth_spread_percent"),
    ("converter", "converter"),
    ("stage grain", "stage.quantum_mm"),
    ("load-cell noise", "load_cell.noise_n"),
    ("surface tilt", "surface.tilt_mm"),
    ("relaxation", "relaxation"),
];

#[test]
fn small_study_writes_rows_and_is_reproducible_except_for_times() {
    let bench = TestFolder::new();
    assert!(bench.palpate_ends(0, "study --help").out.contains("ablation"));
    if campaign::is_quick() {
        let rows = SMALLEST.ndjson();
        let rows: Vec<Value> = rows.lines().map(|row| serde_json::from_str(row).expect("JSON")).collect();
        check_rows(&rows, SMALLEST_SIZE.seeds);
        println!("{} rows", rows.len());
        let again = ablation(SMALLEST_SIZE, 101, &|_, _| {}).expect("the shipped scene is sound");
        assert_eq!(again.rows, SMALLEST.rows, "the same twice");
        return;
    }
    let output = bench.palpate_ends(0, "study ablation --quick --out a --json");
    assert_eq!(bench.read("a/rows.ndjson"), output.out);
    check_rows(&output.json_lines(), 3);

    let again = bench.palpate_ends(0, "study ablation --quick --out b");
    is_narrow(&again.out);
    let timeless =
        |rows: &str| rows.lines().filter(|row| !row.contains("\"cost\"")).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(timeless(&bench.read("a/rows.ndjson")), timeless(&bench.read("b/rows.ndjson")));
    let other = bench.palpate_ends(0, "study ablation --quick --out c --seed 2 --json");
    assert_ne!(timeless(&bench.read("a/rows.ndjson")), timeless(&other.out));
}

/// The smallest study with every term: the quick tier makes it once.
const SMALLEST_SIZE: AblationSize = AblationSize { seeds: 2, side: 5, tests: 10, presses: 2 };
static SMALLEST: LazyLock<AblationFindings> =
    LazyLock::new(|| ablation(SMALLEST_SIZE, 101, &|_, _| {}).expect("the shipped scene is sound"));

/// Each term has a row for each question that it can affect, and its numbers are consistent.
fn check_rows(rows: &[Value], seeds: usize) {
    let (costs, rows): (Vec<Value>, Vec<Value>) = rows.iter().cloned().partition(|row| row["cost"].is_string());

    let tried = |row: &Value| (row["term"].to_string(), row["question"].to_string());
    let each: BTreeSet<(String, String)> = rows.iter().map(tried).collect();
    let touched = TERMS.iter().flat_map(|term| QUESTIONS.iter().filter(|question| term.touches(question.of)));
    assert_eq!((each.len(), rows.len()), (touched.count(), each.len()), "a row a term and a question it can touch");
    for row in &rows {
        let number = |key: &str| row[key].as_f64().unwrap_or_else(|| panic!("{key} in {row}"));
        assert!((number("on") - number("off") - number("difference")).abs() < 3e-6, "{row}");
        let base = if row["in_base"] == true { "on" } else { "off" };
        assert_eq!(number("base"), number(base), "{row}");
        assert!(
            number("within") >= 0.0
                && number("counts_from") >= 0.05 * number("base").abs()
                && number("seeds") == seeds as f64
        );
        assert!(["yes", "no", "undecided"].iter().any(|verdict| row["needed"] == *verdict), "{row}");
    }
    for cost in &costs {
        let number = |key: &str| cost[key].as_f64().unwrap_or_else(|| panic!("{key} in {cost}"));
        assert!(number("off") > 0.0 && number("on") > 0.0 && number("ratio") > 0.0, "{cost}");
    }
    assert!(costs.iter().any(|cost| cost["term"] == "all terms"), "{costs:?}");
}

#[test]
fn needed_terms_can_affect_their_questions() {
    for (name, questions) in NEEDED {
        let term = TERMS.iter().find(|term| term.name == name).unwrap_or_else(|| panic!("no term is called {name}"));
        for asked in questions {
            let question = QUESTIONS.iter().find(|question| question.name == *asked);
            assert!(question.is_some_and(|question| term.touches(question.of)), "{name}: {asked}");
        }
        assert!(!questions.is_empty(), "{name}");
    }
    for (name, _) in KEYS {
        assert!(TERMS.iter().any(|term| term.name == name), "no term is called {name}");
    }
}

#[test]
fn smaller_study_agrees_with_the_whole_study() {
    if campaign::is_quick() {
        // its intervals are those of 95 %, and its places are too few for the paper's errors
        let (refuted, rows) = (refuted_by(&SMALLEST), SMALLEST.rows.len());
        assert!(20 * refuted.len() <= rows, "{} of {rows} are refuted: {refuted:#?}", refuted.len());
        return;
    }
    let size = AblationSize { seeds: 6, side: 25, tests: 200, presses: 5 };
    let found = ablation(size, 101, &|_, _| {}).expect("the shipped scene is sound");
    let refuted = refuted_by(&found);
    assert!(refuted.is_empty(), "{refuted:#?}");
    // a listed term isn't a random result: most are found again
    let listed = NEEDED.iter().map(|(_, questions)| questions.len()).sum::<usize>();
    let again = found.rows.iter().filter(|row| row.needed == Needed::Yes).count();
    println!("{} rows, {again} of {listed} found again", found.rows.len());
    assert!(4 * again >= 3 * listed, "{again} of {listed}");
}

/// The rows of a study that contradict the list of necessary terms.
fn refuted_by(found: &AblationFindings) -> Vec<String> {
    let is_refuted = |row: &&TermRow| {
        let surely_counts = row.effect.difference.abs() - row.effect.within > row.counts_from;
        let is_listed = NEEDED.iter().any(|(term, questions)| *term == row.term && questions.contains(&row.question));
        if is_listed { row.needed == Needed::No } else { surely_counts }
    };
    let line = |row: &TermRow| {
        format!("{} for {:?}: {:?}, counts from {}", row.term, row.question, row.effect, row.counts_from)
    };
    found.rows.iter().filter(is_refuted).map(line).collect()
}

/// Terms of a shipped scene that the study doesn't need, and why.
const ALLOWED: [(&str, &str); 11] = [
    ("elastomer.depth_mm", "geometry"),
    ("contact", "the specimen itself: without it there is no press"),
    ("latency_ms", "a rig's exchanges take their time: the loop is timed against them"),
    ("load_cell.transport_ms", "the loop's own test bench"),
    ("load_cell.low_pass_hz", "the loop's own test bench"),
    ("surface.bumps_mm", "the loop's own test bench"),
    ("surface.roughness_mm", "the loop's own test bench"),
    ("stiffness", "the loop's own test bench"),
    ("stage.servo_ms", "the loop's own test bench"),
    ("stage.quantum_mm", "the loop's own test bench: 0.1 um, a tenth of what the study finds to be waste"),
    ("surface.tilt_mm", "the loop's own test bench: a slope is what its strategy map has to learn"),
];

/// The same for the scene of a batch: its sensors differ, and its prior describes how.
const OF_BATCH: [&str; 3] = ["taxels.gain_spread_percent", "taxels.place_spread_mm", "taxels.depth_spread_percent"];

#[test]
fn shipped_scenes_have_only_needed_terms() {
    let mut scenes = 0;
    for entry in fs::read_dir(shipped("rigs")).expect("rigs are shipped") {
        let path = entry.expect("an entry").path();
        let rig: toml::Table = fs::read_to_string(&path).expect("a text").parse().expect("TOML");
        let Some(scene) = rig.get("scene").and_then(toml::Value::as_table) else { continue };
        scenes += 1;
        let is_batch = path.file_name().is_some_and(|name| name == "batch.toml");
        let waste: Vec<String> =
            unjustified(scene).into_iter().filter(|term| !(is_batch && OF_BATCH.contains(&term.as_str()))).collect();
        assert!(waste.is_empty(), "{}: nothing needs {waste:?}", path.display());
    }
    assert_eq!(scenes, 5, "rigs with a scene");
}

#[test]
fn scene_with_unneeded_terms_is_reported() {
    let scene = |text: &str| unjustified(&text.parse().expect("TOML"));
    assert_eq!(scene("indenter = { radius_mm = 0.5 }\ntaxel_noise = { repeatability_percent = [1.0] }"), ["indenter"]);
    assert_eq!(
        scene("elastomer = { depth_mm = 5.0 }\ntaxels = { radius_mm = 1.0, place_spread_mm = 0.1 }"),
        ["taxels.place_spread_mm"]
    );
    assert_eq!(scene("converter = { bits = 16, range = 10.0 }\nnovelty = 1.0"), ["converter", "novelty"]);
}

/// The keys of a scene without a necessary term, and without permission.
fn unjustified(scene: &toml::Table) -> Vec<String> {
    let is_needed = |name: &str| NEEDED.iter().any(|(term, _)| *term == name);
    let is_justified = |key: &str| {
        let needed = KEYS.iter().filter(|(term, _)| is_needed(term)).map(|(_, key)| *key);
        needed.chain(ALLOWED.iter().map(|(allowed, _)| *allowed)).any(|justified| justified == key)
    };
    let mut waste = Vec::new();
    for (key, value) in scene {
        match value.as_table() {
            _ if is_justified(key) => {}
            Some(table) if KEYS.iter().all(|(_, of_term)| of_term != key) => {
                waste.extend(table.keys().map(|of| format!("{key}.{of}")).filter(|path| !is_justified(path)));
            }
            _ => waste.push(key.clone()),
        }
    }
    waste.sort();
    waste
}
