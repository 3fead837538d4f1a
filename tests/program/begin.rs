//! The first steps of a new user: `demo`, `init`, schemas, completions and man pages.

use palpate_testing::{CommandOutput, SMALL, TestFolder, shipped_text};

#[cfg(target_os = "linux")]
#[test]
fn demo_runs_the_papers_recipe_and_opens_its_page() {
    use std::{fs, os::unix::fs::PermissionsExt as _};

    // no file of this name is used as the recipe, and a browser that fails is no error
    let bench = TestFolder::with([("paper", SMALL), ("xdg-open", "#!/bin/sh\necho \"$@\" > opened\nexit 3\n")]);
    fs::set_permissions(bench.path("xdg-open"), fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", bench.path(".").display(), std::env::var("PATH").unwrap());
    let printed = CommandOutput::from(bench.command("demo").env("PATH", path).output().unwrap());
    assert_eq!(printed.code, Some(0), "{}\n{}", printed.out, printed.err);
    for part in ["\ncomplete: 770 of 770 presses, runs/paper\n", "\nACCEPTED", "runs/paper/report.html: "] {
        assert!(printed.out.contains(part), "{part}: {}", printed.out);
    }
    assert!(printed.out.lines().count() <= 20 && !printed.out.contains("palpate report"), "{}", printed.out);
    assert!(bench.read("runs/paper/report.html").starts_with("<!DOCTYPE html>"));
    assert_eq!(bench.read("opened"), "runs/paper/report.html\n");
    assert!(printed.running().contains("note: the page wasn't opened: xdg-open: exit status: 3"), "{}", printed.err);
}

#[test]
fn demo_overwrites_nothing() {
    let bench = TestFolder::with([("mine", "")]);
    let output = bench.palpate_ends(2, "demo --out mine --no-open");
    assert!(output.running().contains("mine already exists"), "{}", output.err);
}

const SENSORS: [(&str, &str); 5] = [
    ("paper", ""),
    ("magnetic", " --simulate"),
    ("barometer", " --simulate"),
    ("depth", " --simulate"),
    ("printer", " --simulate"),
];

#[test]
fn each_template_of_init_can_be_checked() {
    for (sensor, simulate) in SENSORS {
        let bench = TestFolder::new();
        let output = bench.palpate_ends(0, &format!("init mine --from {sensor}")).out;
        let check = format!("check recipe.toml{simulate}");
        assert!(
            output.contains(&format!("  palpate {check}\n")) && output.contains(&format!("runs/{sensor}\n")),
            "{output}"
        );
        assert!(output.lines().all(|line| line.chars().count() <= 80), "{output}");
        let checked = bench.palpate_ends(0, &check.replace("recipe.toml", "mine/recipe.toml"));
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
fn a_template_without_a_load_cell_has_no_certificate() {
    for (start, has_it) in [("depth", false), ("protocol:fkeel-interdigitation", false), ("magnetic", true)] {
        let bench = TestFolder::new();
        let output = bench.palpate_ends(0, &format!("init mine --from {start}")).out;
        assert_eq!(output.contains("certificate"), has_it, "{output}");
        assert_eq!(bench.path("mine/certificate.toml").exists(), has_it, "{start}");
    }
}

#[test]
fn the_commands_that_init_prints_work_to_their_end() {
    for (sensor, _) in SENSORS.into_iter().filter(|(sensor, _)| *sensor != "paper") {
        let bench = TestFolder::new();
        let output = bench.palpate_ends(0, &format!("init . --from {sensor}")).out;
        let recipe = bench.read("recipe.toml");
        bench.write(
            "recipe.toml",
            &recipe
                .replace("spacing_mm = 0.5", "spacing_mm = 3.0")
                .replace("spacing_mm = 1.0", "spacing_mm = 3.0")
                .replace("count = 50", "count = 5"),
        );
        for command in output.lines().filter_map(|line| line.strip_prefix("  palpate ")) {
            let output = bench.palpate(command);
            assert!(matches!(output.code, Some(0 | 1)), "{sensor}: palpate {command}\n{}\n{}", output.out, output.err);
        }
        assert!(bench.has(&format!("runs/{sensor}/report.html")), "{sensor}");
    }
}

/// At the start of a run the driver compares the rig before anything is created, and its suggestion works.
#[test]
fn a_travel_that_a_simulated_grbl_cant_have_is_refused_by_check_with_one_that_it_can() {
    let rig = shipped_text("rigs/grbl.toml");
    let axes = "x = [-24.5, -0.5], y = [-24.5, -0.5], z = [-24.5, -0.5]";
    let wide = rig.replace(axes, "x = [-12.5, 12.5], y = [-24.5, -5.0], z = [-24.5, -0.5]");
    let bench = TestFolder::with([("rig.toml", wide.as_str())]);
    for words in ["check", "run"] {
        let output = bench.palpate_ends(2, &format!("{words} calibrate --rig rig.toml --simulate")).running();
        let parts = [
            "`travel_mm.x` is [-12.5, 12.5], but x of a simulated GRBL ends at -0.5 mm: write x = [-25.5, -0.5], and move \
             `frame.origin_mm.x` by -13 mm",
            "`travel_mm.y` is [-24.5, -5], but y of a simulated GRBL ends at -0.5 mm, where it homes: write y = [-24.5, -0.5]",
        ];
        parts.iter().for_each(|part| assert!(output.contains(part), "{part}\n{output}"));
        assert!(!output.contains("$130") && !output.contains("travel_mm.z") && !bench.has("runs"), "{output}");
    }
    let suggested = wide.replace("x = [-12.5, 12.5], y = [-24.5, -5.0]", "x = [-25.5, -0.5], y = [-24.5, -0.5]");
    bench.write("rig.toml", &suggested);
    bench.palpate_ends(0, "check calibrate --rig rig.toml --simulate");
    // a longer travel, a faster stage, a z that homes to minus
    let more = rig.replace(axes, "x = [-60.0, -0.5], y = [-24.5, -0.5], z = [-40.0, -5.0]");
    let more = more.replace("speed_mm_s = 10.0", "speed_mm_s = 40.0").replace("down = \"-z\"", "down = \"+z\"");
    bench.write("rig.toml", &more);
    bench.write("r.toml", SMALL);
    bench.palpate_ends(0, "run r.toml --rig rig.toml --simulate");
}

#[test]
fn init_overwrites_nothing() {
    let bench = TestFolder::with([("rig.toml", "mine")]);
    let output = bench.palpate_ends(2, "init");
    assert!(
        output.running().contains("rig.toml exists already") && output.running().contains("palpate init DIR"),
        "{}",
        output.err
    );
    assert_eq!(bench.read("rig.toml"), "mine");
    assert!(!bench.has("recipe.toml"));
}

#[test]
fn each_shell_has_completions() {
    let bench = TestFolder::new();
    for shell in ["bash", "zsh", "fish"] {
        let script = bench.palpate_ends(0, &format!("completions {shell}")).out;
        assert!(script.contains("check-weight") && script.contains("palpate"), "{shell}: {script}");
    }
}

#[test]
fn each_command_has_a_man_page() {
    let bench = TestFolder::new();
    bench.palpate_ends(0, "man --out man1");
    for page in ["palpate", "palpate-run", "palpate-study-minutes"] {
        let text = bench.read(&format!("man1/{page}.1"));
        assert!(text.contains(".TH") && text.contains("NAME"), "{page}: {text}");
    }
    let commands = bench.palpate_ends(0, "reference commands").out;
    assert!(commands.contains("\n## palpate run\n") && commands.contains("\n### palpate study minutes\n"));
}

#[test]
fn docs_lists_and_prints_pages_and_refuses_unknown_and_ambiguous_names() {
    let bench = TestFolder::new();
    let list = bench.palpate_ends(0, "docs").out;
    assert!(list.contains("tutorials/simulation") && list.contains("reference/rig"), "{list}");
    assert!(list.lines().all(|line| line.len() <= 80), "{list}");
    assert_eq!(bench.palpate_ends(0, "docs process").out, shipped_text("docs/reference/process.md"));
    assert_eq!(bench.palpate_ends(0, "docs reference/rig").out, bench.palpate_ends(0, "reference rig").out);
    let unknown = bench.palpate_ends(2, "docs how-to/line-devise");
    assert!(unknown.err.contains("did you mean how-to/line-device?"), "{}", unknown.err);
    let ambiguous = bench.palpate_ends(2, "docs recipe");
    assert!(ambiguous.err.contains("write one of how-to/recipe, reference/recipe"), "{}", ambiguous.err);
}

#[test]
fn an_unknown_command_is_refused_with_the_known_ones() {
    let bench = TestFolder::new();
    let output = bench.palpate_ends(2, "calibrate paper");
    assert!(output.err.contains("calibrate is a recipe: palpate run calibrate"), "{}", output.err);
    for (words, known) in
        [("frobnicate", "\ncommands: demo, check, run,"), ("study frob", "\ncommands: control, speed-accuracy,")]
    {
        let output = bench.palpate_ends(2, words);
        assert!(output.err.contains(known), "{}", output.err);
        assert!(output.err.lines().all(|line| line.len() <= 80), "{}", output.err);
    }
}

#[test]
fn a_travel_that_no_simulated_stage_has_is_refused_before_anything_moves() {
    let wide = shipped_text("rigs/process.toml").replace("z = [-12.5, 12.5]", "z = [-40.0, 12.5]");
    let bench = TestFolder::with([("rig.toml", wide.as_str())]);
    for words in ["check", "run"] {
        let output = bench.palpate_ends(2, &format!("{words} recipes/paper.toml --rig rig.toml --simulate"));
        let said = "z of a simulated stage goes from -12.5 to 12.5 mm, and `stage.travel_mm.z` has -40 to 12.5";
        assert!(output.running().contains(said), "{}", output.err);
        assert!(!bench.has("runs"));
    }
}

#[test]
fn a_missing_table_is_reported_with_its_keys() {
    let bench = TestFolder::with([("rig.toml", "[stage]\ndriver = \"esp301\"\n")]);
    let output = bench.palpate_ends(2, "check recipes/paper.toml --rig rig.toml");
    for part in [
        "`frame` is missing: a table with `surface_mm`, `down`",
        "`array` is missing: a table with `driver`, `grid` or `places_mm`",
    ] {
        assert!(output.running().contains(part), "{}", output.err);
    }
}
