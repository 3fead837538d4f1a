//! A press that a safety rule stopped and that a person calls sound: the run can be finished, and its verdict waits for another person.

use palpate_testing::{TestFolder, shipped_text};

/// Presses at one place, and a rule that needs no test.
const RECIPE: &str = "name = \"r\"\nchecks = \"none\"\n[[step]]\nphase = \"calibration\"\nforce_n = 1.0\n\
    list = { places_mm = [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]] }\n[accept]\nnoise_percent = 90.0\n";

/// The outputs are half as large again after the first press of a session.
const SCALED: &str = "\n[[scene.fault]]\nkind = \"scaled-outputs\"\nfrom_s = 41.4\nvalue = 1.5\n";

#[test]
fn a_run_is_finished_after_a_false_alarm_and_its_verdict_waits() {
    let bench = TestFolder::with([("r.toml", RECIPE), ("rig.toml", &(shipped_text("rigs/sim.toml") + SCALED))]);
    let output = bench.palpate_ends(4, "run r.toml --rig rig.toml --out run");
    assert!(output.err.contains("outputs-differ: 40."), "{}", output.err);
    assert!(output.out.contains("or, if the press is sound, --sound outputs-differ"), "{}", output.out);
    bench.palpate_ends(2, "resume run");
    bench.palpate_ends(2, "resume run --sound outputs-differ --after-trip");
    bench.palpate_ends(2, "resume run --from-here");

    // the named press is recorded and flagged, and the next one is compared again
    let output = bench.palpate_ends(4, "resume run --sound outputs-differ");
    assert!(output.err.contains("a person called press 1 sound, which outputs-differ had stopped"), "{}", output.err);
    let flagged = || bench.read("run/presses.csv").lines().filter(|row| row.contains(",called-sound,")).count();
    assert_eq!((bench.manifest("run")["presses_done"].as_u64(), flagged()), (Some(2), 1));
    let output = bench.palpate_ends(1, "resume run --sound outputs-differ --from-here");
    assert!(output.out.contains("NOT DECIDED"), "{}", output.out);
    assert_eq!((bench.manifest("run")["status"].as_str(), flagged()), (Some("complete"), 1));

    // the first statement remains with the run
    let reason = "run: a person called press 1 sound, which outputs-differ had stopped";
    assert_eq!(bench.manifest("run")["called_sound"], reason.split_once(": ").expect("two parts").1);
    let manifest = bench.manifest("run");
    bench.palpate_ends(0, "verify run");
    bench.palpate_ends(0, "rebuild run");
    assert_eq!(bench.manifest("run"), manifest, "it follows from the journal");
    let output = bench.palpate_ends(1, "report run");
    assert!(output.out.contains("not decided"), "{}", output.out);
    let page = bench.read("run/report.html");
    assert!(page.contains("a person called press 1 sound"), "the page states it");
    // nothing is left to call sound
    let output = bench.palpate_ends(2, "resume run --sound outputs-differ");
    assert!(output.err.contains("no press was stopped by outputs-differ; the run is complete"), "{}", output.err);
    // who accepts it, decides
    bench.write("accept.toml", "noise_percent = 90.0\ncalled_sound = true\n");
    let output = bench.palpate_ends(0, "report run --accept accept.toml");
    assert!(output.out.contains("run: accepted"), "{}", output.out);
}

#[test]
fn only_what_its_rule_stopped_is_called_sound() {
    let stuck = "\n[[scene.fault]]\nkind = \"no-sensor\"\nfrom_s = 41.4\n";
    let bench = TestFolder::with([("r.toml", RECIPE), ("rig.toml", &(shipped_text("rigs/sim.toml") + stuck))]);
    bench.palpate_ends(4, "run r.toml --rig rig.toml --out run");
    let journal = bench.read("run/journal.log");
    let output = bench.palpate_ends(2, "resume run --sound outputs-differ");
    assert!(output.err.contains("no press was stopped by outputs-differ; the run is tripped: "), "{}", output.err);
    assert_eq!(bench.read("run/journal.log"), journal, "nothing is recorded");
    let output = bench.palpate_ends(2, "resume run --sound over-force");
    assert!(output.err.contains("outputs-differ"), "the rules that can be called so: {}", output.err);
}
