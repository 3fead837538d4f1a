//! Runs on a rig without a load cell: depths count from a surface that the array felt, or that a person confirmed.

use palpate_testing::executions::rig_without_load_cell;
use palpate_testing::interrupted::cut_to_lines;
use palpate_testing::{TestFolder, shipped_text};

const RECIPE: &str = r#"name = "deep"

[[step]]
phase = "calibration"
grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 3.0 }
depth_mm = [0.3, 0.6]

[[step]]
phase = "test"
random = { count = 6, x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], depth_mm = [0.2, 0.6] }
"#;

#[test]
fn array_feels_the_surface_and_presses_go_to_their_depth() {
    let rig = rig_without_load_cell();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --simulate --out run");
    let header = bench.read("run/presses.csv");
    assert!(!header.lines().next().unwrap().contains("force"), "{header}");
    let truth = bench.column("run/scene.csv", "depth_peak_mm");
    let set = bench.column("run/presses.csv", "depth_set_mm");
    let number = |text: &String| text.parse::<f64>().unwrap();
    for (truth, set) in truth.iter().map(number).zip(set.iter().map(number)) {
        assert!((truth - set).abs() < 0.05, "{truth} mm in place of {set} mm");
    }
    assert!(bench.column("run/scene.csv", "force_peak_n").iter().map(number).all(|force_n| force_n < 2.0));
    bench.palpate_ends(0, "verify run");
}

#[test]
fn touch_is_confirmed_for_a_sensor_in_a_mounting() {
    let rig = rig_without_load_cell();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    let begun = "run deep.toml --rig rig.toml --simulate --out run --confirmed touch";
    assert!(bench.palpate_ends(2, begun).err.contains("--mounting NAME"));
    bench.palpate_ends(0, &format!("{begun} --sensor A1 --mounting 1"));
    assert!(bench.read("run/journal.log").contains(r#""by":"person""#));
    cut_to_lines(&bench, "run", 12);
    let refused = bench.palpate_ends(2, "resume run").err;
    assert!(refused.contains("nothing was moved"), "{refused}");
    bench.palpate_ends(0, "resume run --confirmed touch");
}

/// The surface is 0.2 mm deeper than the frame states, which is inside its uncertainty, or so deep that nothing is touched.
#[test]
fn confirmed_surface_is_named_in_the_verdict_and_presses_in_air_end_the_run() {
    let accept = "\n[accept]\nlocation_mean_mm = 3.0\ndepth_mean_mm = 0.5\n";
    let deeper = |mm: &str| {
        let rig = rig_without_load_cell();
        format!("{rig}\n[scene.mounting]\nz_mm = {mm}\n")
    };
    let (recipe, rig, far) = (format!("{RECIPE}{accept}"), deeper("0.2"), deeper("0.9"));
    let bench = TestFolder::with([("deep.toml", recipe.as_str()), ("rig.toml", &rig), ("far.toml", &far)]);
    let words = |rig: &str| {
        format!("run deep.toml --rig {rig}.toml --simulate --out {rig} --confirmed touch --sensor A1 --mounting 1")
    };
    bench.palpate_ends(0, &words("rig"));
    let note = "depths count from a surface that a person confirmed: its uncertainty, 0.3 mm, isn't in their errors";
    let judged = bench.palpate_ends(0, "evaluate rig").out;
    let judged = judged.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(judged.contains(note), "{judged}");
    assert!(bench.read("rig/manifest.json").contains("\"confirmed_within_mm\": 0.3"));
    let tripped = bench.palpate_ends(4, &words("far")).running();
    assert!(tripped.contains("no-contact"), "{tripped}");
    assert!(bench.column("far/presses.csv", "press").len() < 10, "it ends after a few presses");
}

#[test]
fn force_is_refused_without_a_load_cell() {
    let (rig, by_force) = (rig_without_load_cell(), RECIPE.replace("depth_mm = [0.3, 0.6]", "force_n = 0.5"));
    let bench = TestFolder::with([("force.toml", by_force.as_str()), ("rig.toml", rig.as_str())]);
    let refused = bench.palpate_ends(2, "run force.toml --rig rig.toml --simulate --out run").err;
    assert!(refused.contains("has no load cell"), "{refused}");
}

#[cfg(not(feature = "files"))]
#[test]
fn series_needs_the_feature_files_and_is_refused_at_its_line() {
    let recipe = "name = \"r\"\nrig = \"sim\"\n[record]\nseries = \"press\"\n[[step]]\nphase = \"test\"\nunits = \"all\"\nforce_n = 1\n";
    let bench = TestFolder::with([("r.toml", recipe)]);
    for words in ["check r.toml", "run r.toml --out run"] {
        let refused = bench.palpate_ends(2, words).running();
        let expected = "`series` needs the feature `files`, which this program was built without";
        assert!(refused.contains(expected) && refused.contains("r.toml:4:10"), "{refused}");
        assert!(!bench.has("run"));
    }
}

#[test]
fn interval_of_forces_is_refused_with_the_depth_as_the_other_way() {
    let (rig, by_force) = (rig_without_load_cell(), RECIPE.replace("depth_mm = [0.3, 0.6]", "force_n = [0.3, 0.5]"));
    let bench = TestFolder::with([("force.toml", by_force.as_str()), ("rig.toml", rig.as_str())]);
    let refused = bench.palpate_ends(2, "check force.toml --rig rig.toml").running();
    assert!(refused.contains("On a rig without a load cell, use `depth_mm`"), "{refused}");
}

#[test]
fn limits_of_a_force_error_are_refused_at_their_lines_before_anything_moves() {
    let rig = rig_without_load_cell();
    let limits = "location_mean_mm = 0.5\nforce_mean_n = 0.1\nforce_within = { n = 0.1, share = 0.9 }\n";
    let (own, named) =
        (format!("{RECIPE}\n[accept]\n{limits}"), RECIPE.replacen('\n', "\naccept = \"accept.toml\"\n", 1));
    let bench = TestFolder::with([
        ("own.toml", own.as_str()),
        ("named.toml", named.as_str()),
        ("accept.toml", limits),
        ("rig.toml", rig.as_str()),
    ]);
    for (recipe, places) in
        [("own", ["own.toml:14:16", "own.toml:15:16"]), ("named", ["accept.toml:2:16", "accept.toml:3:16"])]
    {
        for command in ["check", "run"] {
            let refused =
                bench.palpate_ends(2, &format!("{command} {recipe}.toml --rig rig.toml --simulate")).running();
            for part in
                places.into_iter().chain(["so no force error is known", "use `depth_mean_mm`", "use `depth_within`"])
            {
                assert!(refused.contains(part), "{part}: {refused}");
            }
        }
        assert!(!bench.path("runs").exists());
    }
    bench.palpate_ends(0, "check own.toml --rig sim");
}

#[test]
fn strategy_is_refused_where_it_is_written() {
    let rig = rig_without_load_cell();
    let of_all = RECIPE.replacen('\n', "\n[press]\nstrategy = \"guarded\"\n", 1);
    let of_step = format!("{RECIPE}strategy = \"map\"\n");
    let bench = TestFolder::with([
        ("deep.toml", RECIPE),
        ("all.toml", of_all.as_str()),
        ("step.toml", of_step.as_str()),
        ("rig.toml", rig.as_str()),
    ]);
    for (words, place) in [
        ("all.toml", "all.toml:3:12"),
        ("step.toml", "step.toml:11:12"),
        ("deep.toml --strategy velocity", "'velocity' for '--strategy'"),
    ] {
        for command in ["check", "run"] {
            let refused = bench.palpate_ends(2, &format!("{command} {words} --rig rig.toml --simulate")).running();
            for part in [place, "a rig without a load cell has no strategy"] {
                assert!(refused.contains(part), "{part}: {refused}");
            }
        }
    }
    bench.palpate_ends(0, "check deep.toml --rig rig.toml");
    bench.palpate_ends(0, "check deep.toml --rig sim --strategy velocity");
}

#[test]
fn check_prints_the_depth_limit_of_a_confirmed_touch() {
    let rig = rig_without_load_cell();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    let both = bench.palpate_ends(0, "check deep.toml --rig rig.toml").out;
    assert!(both.contains("mm without a load cell,\n") && both.contains("mm with --confirmed touch"), "{both}");
    let one = bench.palpate_ends(0, "check deep.toml --rig rig.toml --confirmed touch").out;
    assert!(one.contains("mm with --confirmed touch") && !one.contains("mm without a load cell"), "{one}");
}

#[test]
fn page_of_a_run_by_depth_has_depths_in_place_of_forces() {
    let rig = rig_without_load_cell();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --simulate --out run");
    bench.palpate_ends(0, "report run --figures figures");
    let page = bench.read("run/report.html");
    for part in ["Errors against the depth", "Output of each unit, by depth and by place"] {
        assert!(page.contains(part), "{part}");
    }
    for part in ["Errors against the force", "by load and by place", "zero without load"] {
        assert!(!page.contains(part), "{part}");
    }
    let depths = bench.column("figures/errors-against-depth.csv", "depth_mm");
    let depths: Vec<f64> = depths.iter().filter_map(|depth| depth.parse().ok()).collect();
    assert!(!depths.is_empty() && depths.iter().all(|depth| (0.2..=0.6).contains(depth)), "{depths:?}");
    assert!(!bench.path("figures/errors-against-force.csv").exists());
}

#[test]
fn quiet_solve_prints_nothing_but_contacts() {
    let rig = rig_without_load_cell();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --simulate --out run");
    let table = bench.read("run/presses.csv");
    let noted = bench.palpate_reads("solve --calibration run", &table);
    assert!(noted.running().contains("depth is solved instead of force"), "{}", noted.err);
    let quiet = bench.palpate_reads("solve --calibration run --quiet", &table);
    assert_eq!(quiet.err, "");
    assert_eq!(quiet.out, noted.out);
    assert!(bench.palpate_ends(0, "solve --help").out.contains("half95_depth_mm"));
    let matrix = bench.palpate_reads("solve --calibration run", &bench.read("run/test_matrix.csv")).running();
    assert!(matrix.contains("has a row for each output: use its `presses.csv`"), "{matrix}");
}

#[test]
fn run_that_was_cut_feels_the_surface_again_and_goes_on() {
    let rig = rig_without_load_cell();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --simulate --out whole");
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --simulate --out cut");
    cut_to_lines(&bench, "cut", 30);
    bench.palpate_ends(0, "resume cut");
    let depths = |run: &str| bench.column(&format!("{run}/presses.csv"), "depth_set_mm");
    assert_eq!(depths("cut"), depths("whole"));
    bench.palpate_ends(0, "verify cut");
}

#[test]
fn run_without_a_load_cell_has_no_certificate_and_its_page_says_so_first() {
    let rig = rig_without_load_cell();
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --simulate --out run --sensor A1");
    bench.palpate_ends(0, "report run --out page.html");
    assert!(bench.read("page.html").contains("There was no load cell: no force is known"));
    bench.write("given.toml", &shipped_text("data/example/certificate.toml"));
    let refused = bench.palpate_ends(2, "certificate run --with given.toml").err;
    assert!(refused.contains("without a load cell"), "{refused}");
}

#[test]
fn guarded_rule_decides_nothing_without_a_load_cell() {
    let rig = rig_without_load_cell();
    let accept = "rule = \"guarded\"\nmethod = \"surrogate\"\nlocation_mean_mm = 9.0\ncalibration_presses_least = 1\ntest_presses_least = 1\n";
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str()), ("accept.toml", accept)]);
    bench.palpate_ends(0, "run deep.toml --rig rig.toml --simulate --out run");
    let judged = bench.palpate_ends(1, "evaluate run --accept accept.toml");
    assert!(judged.out.contains("a guarded rule needs a load cell"), "{} {}", judged.out, judged.err);
}

#[test]
fn stiffness_is_required_with_how_to_find_it() {
    let rig = rig_without_load_cell().replace("stiffness_n_mm = 2.0", "");
    let bench = TestFolder::with([("deep.toml", RECIPE), ("rig.toml", rig.as_str())]);
    let refused = bench.palpate_ends(2, "check deep.toml --rig rig.toml").err;
    assert!(refused.contains("kitchen scale"), "{refused}");
}
