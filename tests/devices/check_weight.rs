//! `palpate doctor --check-weight-n`, and the effect of a load cell's certificate and check on a run.

use palpate_testing::{SMALL, TestFolder, exchanged, shipped_text};

const DOCTOR: &str = "doctor rig.toml --check-weight-n 0.5 --check-weight-u-n 0.0005";
const CERTIFICATE: &str = "certificate = { number = \"K-7\", date = \"2026-05-04\", u_n = 0.002 }\n";

/// The shipped rig with a load cell that reads this percentage too much, and with more keys.
fn rig(gain_error_percent: f64, more: &str) -> String {
    let noise = "noise_n = 0.003";
    let rig = shipped_text("rigs/sim.toml");
    let rig = exchanged(&rig, noise, &format!("{noise}, gain_error_percent = {gain_error_percent:?}"));
    exchanged(&rig, "\n[array]\n", &format!("{more}\n[array]\n"))
}

fn bench(gain_error_percent: f64, more: &str) -> TestFolder {
    TestFolder::with([("rig.toml", rig(gain_error_percent, more).as_str()), ("small.toml", SMALL)])
}

fn run(bench: &TestFolder, code: i32) -> String {
    bench.palpate_ends(code, "run small.toml --rig rig.toml --out run").err
}

fn words(text: &str) -> String {
    text.split_whitespace().filter(|word| *word != "│").collect::<Vec<_>>().join(" ")
}

#[test]
fn right_gain_is_verified_and_changes_nothing_else_in_the_file() {
    let bench = bench(0.0, "");
    let output = bench.palpate_ends(0, DOCTOR);
    for asked in ["put the weight on the tip (0.5 N, 1 of 3): waiting up to 60 s", "take the weight off (3 of 3)"] {
        assert!(output.err.contains(asked), "{}", output.err);
    }
    assert!(output.out.contains("verified: ") && output.out.contains("no problems found"), "{}", output.out);
    assert!(output.out.ends_with("written: `check` of [load_cell] in rig.toml\n"), "{}", output.out);
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    let written = bench.read("rig.toml");
    let others: Vec<&str> = written.lines().filter(|line| !line.starts_with("check = ")).collect();
    assert_eq!(others, rig(0.0, "").lines().collect::<Vec<_>>());
    let err = run(&bench, 0);
    assert!(!err.contains("warning: load_cell"), "{err}");
}

#[test]
fn wrong_gain_is_refused_until_adjusted_and_recorded() {
    let bench = bench(1.0, "");
    let output = bench.palpate_ends(4, DOCTOR);
    assert!(words(&output.err).contains("its gain is off by +1.0"), "{}", output.err);
    assert!(words(&output.err).contains("add --adjust"), "{}", output.err);
    let err = words(&run(&bench, 4));
    assert!(
        err.contains("safety trip: gain-off: 1.0") && err.contains("`palpate doctor --check-weight-n N --adjust`"),
        "{err}"
    );
    assert!(!bench.path("run").exists(), "nothing is made of a run that is refused");
    bench.palpate_ends(4, "doctor rig.toml");
    bench.palpate_ends(4, "align rig.toml");
    let output = bench.palpate_ends(0, &format!("{DOCTOR} --adjust"));
    assert!(output.out.contains("adjusted: readings are divided by 1.0"), "{}", output.out);
    assert!(bench.read("rig.toml").contains("adjusted = true }"), "{}", bench.read("rig.toml"));
    let divided = "its readings are divided by 1.0";
    let err = run(&bench, 0);
    assert!(err.contains(&format!("warning: load_cell: {divided}")), "{err}");
    bench.palpate_ends(0, "report run");
    for file in ["run/manifest.json", "run/report.html"] {
        assert!(bench.read(file).contains(divided), "{file}");
    }
    // a check of the adjusted cell changes nothing
    let before = bench.read("rig.toml");
    let output = bench.palpate_ends(0, DOCTOR);
    assert!(
        output.out.contains("verified: ") && output.out.ends_with("the rig's `check` is unchanged\n"),
        "{}",
        output.out
    );
    assert_eq!(bench.read("rig.toml"), before);
}

#[test]
fn change_of_a_cell_after_its_adjustment_is_reported() {
    let adjusted = "check = { weight_n = 0.5, weight_u_n = 0.0005, gain = 1.02, gain_sd = 0.0002, times = 3, date = \
                    \"2026-05-04\", adjusted = true }\n";
    let bench = bench(3.0, adjusted);
    let output = bench.palpate_ends(4, DOCTOR);
    assert!(output.out.contains("(adjusted by 1.02)"), "{}", output.out);
    assert!(words(&run(&bench, 4)).contains("gain-off"));
}

#[test]
fn gain_fault_is_refused_named_and_recorded() {
    for (gain_error_percent, output) in [
        (-50.0, "it read 0.5"),
        (25.0, "isn't adjusted help: check that the transmitter's range matches the cell's rating plate"),
        (-200.0, "its sign is wrong. The weight pressed, but the cell read negative"),
        (-89.8028, "probable cause: the cell's unit is the kilogram-force (9.80665 N)"),
        (-77.519, "probable cause: the cell's unit is the pound-force (4.448 N)"),
    ] {
        let bench = bench(gain_error_percent, CERTIFICATE);
        let err = words(&bench.palpate_ends(4, &format!("{DOCTOR} --adjust")).err);
        assert!(err.contains(output), "{gain_error_percent}: {err}");
        assert!(!bench.read("rig.toml").contains("adjusted"), "{gain_error_percent}");
        assert!(words(&run(&bench, 4)).contains("gain-off"), "{gain_error_percent}");
    }
}

#[test]
fn hanging_weight_is_a_negative_force() {
    let pulled = bench(0.0, "").palpate_ends(0, &format!("{DOCTOR} --pull"));
    assert!(pulled.err.contains("hang the weight from the tip (0.5 N, 1 of 3)"), "{}", pulled.err);
    let bench = bench(-200.0, "");
    let output = bench.palpate_ends(4, &format!("{DOCTOR} --pull --json"));
    assert!(words(&output.err).contains("The weight pulled, but the cell read positive"), "{}", output.err);
    let found = &output.json_lines()[0]["check_weight"];
    assert_eq!((found["verdict"].as_str(), found["pull"].as_bool()), (Some("wrong-sign"), Some(true)), "{found}");
    assert!((found["gain"].as_f64().unwrap() + 1.0).abs() < 0.005, "{found}");
}

#[test]
fn missing_weight_is_awaited_for_a_minute() {
    let bench = bench(-99.0, "");
    let output = bench.palpate_ends(4, DOCTOR);
    assert!(words(&output.err).contains("safety trip: no-weight: 0.00"), "{}", output.err);
    assert_eq!(bench.read("rig.toml"), rig(-99.0, ""));
}

#[test]
fn a_weight_is_refused_before_anything_moves() {
    let bench = bench(0.0, "");
    for (args, output) in [
        (
            "--check-weight-n 2.5",
            "--check-weight-n is 2.5 N; it must be above 0 and at most the rig's force limit of 2 N",
        ),
        ("--check-weight-n 0", "--check-weight-n is 0 N; it must be above 0"),
        ("--check-weight-n nan", "--check-weight-n is NaN N; it must be above 0"),
        (
            "--check-weight-n 0.5 --check-weight-u-n 0.02",
            "--check-weight-u-n is 0.02 N; it must be above 0 and at most 0.01 N, 2 % of the weight",
        ),
        ("--adjust", "--check-weight-n <N>"),
        ("--check-weight-n 0.5 --push --pull", "'--push' cannot be used with '--pull'"),
    ] {
        let err = words(&bench.palpate_ends(2, &format!("doctor rig.toml {args}")).err);
        assert!(err.contains(output), "{args}: {err}");
    }
}

#[test]
fn a_simulated_gain_is_not_written_to_a_real_rig() {
    let esp301 = shipped_text("rigs/esp301.toml");
    let bench = TestFolder::with([("rig.toml", esp301.as_str())]);
    let output = bench.palpate_ends(0, &format!("{DOCTOR} --simulate"));
    assert!(
        output.out.ends_with("not written: the gain of a simulated load cell doesn't apply to a real one\n"),
        "{}",
        output.out
    );
    assert_eq!(bench.read("rig.toml"), esp301);
}

#[test]
fn run_without_certificate_and_check_is_marked() {
    let neither = "it has neither a certificate nor a check with a known weight";
    let plain = bench(0.0, "");
    let err = run(&plain, 0);
    assert_eq!(err.split_whitespace().collect::<Vec<_>>().join(" ").matches(neither).count(), 1, "{err}");
    plain.palpate_ends(0, "report run");
    assert!(plain.read("run/report.html").contains(neither));
    let err = run(&bench(0.0, CERTIFICATE), 0);
    assert!(!err.contains("warning: load_cell"), "{err}");
}
