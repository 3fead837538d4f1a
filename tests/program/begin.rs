//! The first steps of a new user: `init`, schemas, completions and man pages.

use crate::support::skips::skipped;
use crate::support::{Bench, shipped, shipped_text};
use std::process::Command;

const SENSORS: [(&str, &str); 4] =
    [("paper", ""), ("magnetic", " --simulate"), ("barometer", " --simulate"), ("printer", " --simulate")];

#[test]
fn each_sensor_of_init_can_be_checked_as_it_is_printed() {
    for (sensor, simulate) in SENSORS {
        let bench = Bench::new();
        let told = bench.palpate_ends(0, &format!("init mine --from {sensor}")).out;
        let check = format!("check recipe.toml --rig rig.toml{simulate}");
        assert!(told.contains(&format!("  palpate {check}\n")) && told.contains(&format!("runs/{sensor}\n")), "{told}");
        assert!(told.lines().all(|line| line.chars().count() <= 80), "{told}");
        let checked = bench
            .palpate_ends(0, &check.replace("recipe.toml", "mine/recipe.toml").replace("rig.toml", "mine/rig.toml"));
        assert!(checked.err.is_empty(), "{}", checked.err);
        for file in ["recipe", "rig"] {
            let text = bench.read(&format!("mine/{file}.toml"));
            assert!(text.starts_with(&format!("#:schema {file}.schema.json\n")), "{text}");
            assert_eq!(
                bench.read(&format!("mine/{file}.schema.json")),
                bench.palpate_ends(0, &format!("schema {file}")).out
            );
        }
    }
}

#[test]
fn init_overwrites_nothing() {
    let bench = Bench::with([("rig.toml", "mine")]);
    let told = bench.palpate_ends(2, "init");
    assert!(
        told.running().contains("rig.toml exists already") && told.running().contains("palpate init DIR"),
        "{}",
        told.err
    );
    assert_eq!(bench.read("rig.toml"), "mine");
    assert!(!bench.has("recipe.toml"));
}

#[test]
fn completions_load_in_each_shell() {
    let bench = Bench::new();
    for (shell, load) in [("bash", "."), ("zsh", "compdef() { :; }; ."), ("fish", "source")] {
        let script = bench.palpate_ends(0, &format!("completions {shell}")).out;
        assert!(script.contains("check-weight") && script.contains("palpate"), "{shell}: {script}");
        bench.write("script", &script);
        let mut command = Command::new(shell);
        command.args(["-c", &format!("{load} ./script")]).current_dir(bench.path("."));
        match command.output() {
            Ok(output) => {
                let err = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success() && err.is_empty(), "{shell}: {err}");
            }
            Err(error) => skipped(&format!("completions in {shell}"), &error.to_string()),
        }
    }
}

#[test]
fn each_command_has_a_man_page() {
    let bench = Bench::new();
    bench.palpate_ends(0, "man --out man1");
    for page in ["palpate", "palpate-run", "palpate-study-minutes"] {
        let text = bench.read(&format!("man1/{page}.1"));
        assert!(text.contains(".TH") && text.contains("NAME"), "{page}: {text}");
    }
    let commands = std::fs::read_to_string(shipped("docs/reference/commands.md")).unwrap();
    assert!(commands.contains("\n## palpate run\n") && commands.contains("\n### palpate study minutes\n"));
}

#[test]
fn an_unknown_command_is_refused_with_the_known_ones() {
    let bench = Bench::new();
    for (words, known) in
        [("frobnicate", "\ncommands: check, run,"), ("study frob", "\ncommands: control, speed-accuracy,")]
    {
        let told = bench.palpate_ends(2, words);
        assert!(told.err.contains(known), "{}", told.err);
        assert!(told.err.lines().all(|line| line.len() <= 80), "{}", told.err);
    }
}

#[test]
fn a_travel_that_no_simulated_stage_has_is_refused_before_anything_moves() {
    let wide = shipped_text("rigs/process.toml").replace("z = [-12.5, 12.5]", "z = [-40.0, 12.5]");
    let bench = Bench::with([("rig.toml", wide.as_str())]);
    for words in ["check", "run"] {
        let told = bench.palpate_ends(2, &format!("{words} recipes/paper.toml --rig rig.toml --simulate"));
        let said = "z of a simulated stage goes from -12.5 to 12.5 mm, and `stage.travel_mm.z` has -40 to 12.5";
        assert!(told.running().contains(said), "{}", told.err);
        assert!(!bench.has("runs"));
    }
}

#[test]
fn a_missing_table_is_reported_with_its_keys() {
    let bench = Bench::with([("rig.toml", "[stage]\ndriver = \"esp301\"\n")]);
    let told = bench.palpate_ends(2, "check recipes/paper.toml --rig rig.toml");
    for part in [
        "`frame` is missing: a table with `surface_mm`, `down`",
        "`array` is missing: a table with `driver`, `grid` or `places_mm`",
    ] {
        assert!(told.running().contains(part), "{}", told.err);
    }
}
