//! Runs whose array is silent for a time, and that are killed too: no row is lost, and none is there twice.

use palpate_core::quantity::stream;
use palpate_testing::rows::{self, numbered};
use palpate_testing::{Live, TestFolder, campaign, shipped_text};
use rand::RngExt;

const SEED: u64 = 1;

/// Presses and kills: quick, and full (the paper's grid).
const PRESSES: (u64, u64) = (16, 625);
const KILLS: (usize, usize) = (1, 10);

/// Silences of the array since the start of each program: the first one when it presses, how far they are apart, how many, and how long, s.
const FIRST_S: usize = 55;
const APART_S: usize = 13;
const SILENCES: usize = 100;
const SILENT_S: f64 = 2.5;

/// A silence that is longer than all retries of a press, s.
const LONG_S: f64 = 30.0;

fn rig(silences: impl Iterator<Item = (usize, f64)>) -> String {
    let fault =
        |(from_s, for_s)| format!("\n[[scene.fault]]\nkind = \"array-lost\"\nfrom_s = {from_s}.0\nvalue = {for_s:?}\n");
    shipped_text("rigs/sim.toml") + &silences.map(fault).collect::<String>()
}

fn recipe(presses: u64, phases: &[&str], on_miss: &str) -> String {
    let step = |phase: &&str| {
        format!(
            "[[step]]\nphase = \"{phase}\"\nforce_n = 1.0\n\
             random = {{ count = {presses}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0] }}\n"
        )
    };
    format!("name = \"missed\"\non_miss = \"{on_miss}\"\n{}", phases.iter().map(step).collect::<String>())
}

#[test]
fn a_run_with_silences_and_kills_has_each_row_once() {
    let (presses, kills) =
        (campaign::size(PRESSES.0 as usize, PRESSES.1 as usize) as u64, campaign::size(KILLS.0, KILLS.1));
    let rig = rig((0..SILENCES).map(|nth| (FIRST_S + APART_S * nth, SILENT_S)));
    let bench = TestFolder::with([("r.toml", recipe(presses, &["calibration"], "retry").as_str()), ("rig.toml", &rig)]);
    let mut rng = stream(SEED, 0, "when a run is killed");
    let mut acknowledged = Vec::new();
    for kill in 0..kills {
        let words = if kill == 0 { "run r.toml --rig rig.toml --json --out run" } else { "resume run --json" };
        let mut live = Live::start(bench.command(words));
        let share = presses / (kills as u64 + 1);
        for _ in 0..rng.random_range(share / 2..=share) {
            acknowledged.push(rows::json(&live.line().expect("a row")));
        }
        live.kill();
        acknowledged.extend(live.end().json_lines());
    }
    acknowledged.extend(bench.palpate_ends(0, "resume run --json").json_lines());
    let table = rows::table(&bench, "run");
    assert_eq!(numbered(&table), (0..presses).map(|press| (press, 0)).collect::<Vec<_>>(), "each row once, in order");
    let kept = rows::kept(&acknowledged, &table);
    assert_eq!((kept.lost, kept.changed), (0, 0), "{:?}", kept.first);
    let manifest = bench.manifest("run");
    let missed = manifest["missed"]["count"].as_u64().unwrap_or(0);
    println!("{presses} presses, {kills} kills, {missed} missed readings");
    assert!(missed >= kills as u64, "{missed} missed readings");
    assert_eq!(manifest["status"], "complete");
    // an answer that came late, at the end of a silence, is flagged as ever
    let flags = bench.column("run/presses.csv", "flags");
    assert!(flags.iter().all(|flags| flags.is_empty() || flags == "stale"), "{flags:?}");
}

#[test]
fn flagged_rows_are_blank_in_every_file_and_left_out_of_the_evaluation() {
    let rig = rig([(FIRST_S, LONG_S)].into_iter());
    let recipe = recipe(PRESSES.0, &["calibration", "test"], "flag");
    let bench = TestFolder::with([("r.toml", recipe.as_str()), ("rig.toml", &rig)]);
    let ended = bench.palpate_ends(0, "run r.toml --rig rig.toml --out run");
    let summary = ended.out.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(summary.contains("readings were missed, the last at press"), "{summary}");
    let (flags, outputs) = (bench.column("run/presses.csv", "flags"), bench.column("run/presses.csv", "out_1"));
    let flagged = flags.iter().filter(|flags| *flags == "missed").count();
    assert!((1..8).contains(&flagged), "{flags:?}");
    assert!(flags.iter().zip(&outputs).all(|(flags, output)| output.is_empty() == (flags == "missed")), "{outputs:?}");
    for source in ["run", "run/presses.csv"] {
        let evaluated = bench.palpate_ends(0, &format!("evaluate {source}"));
        assert!(!evaluated.out.contains("NaN"), "{}", evaluated.out);
    }
    bench.palpate_ends(0, "report run");
    bench.palpate_ends(0, "verify run");
}
