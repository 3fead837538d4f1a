//! Lines for a batch, piped: refusals, trays, trips, the reference sensor, and continuing.

use super::{RECIPE, begun, bench, break_rig, complete, events, mend_rig, piped, results};
use palpate_data::dataset::Status;
use palpate_run::batch::BatchEvent;
use palpate_testing::{TestFolder, exchanged};

const RUN: &str = "batch run b.toml --out day";

/// Two nests on one tray.
const TRAY: &str = r#"
[[nest]]
name = "left"
offset_mm = { x = -3.0, y = 0.0 }
[[nest]]
name = "right"
offset_mm = { x = 3.0, y = 1.5 }
"#;

const REFERENCE: &str = "reference = { serial = \"REF\", every = 2 }\n";

#[test]
fn every_event_is_a_line_of_json_and_in_the_journal() {
    let bench = bench("");
    let output = piped(&bench, &format!("{RUN} --json"), &["B-1", "A-01", ".note clean", "A-01"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    let lines: Vec<BatchEvent> = output.out.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    let all = events(&bench, "day");
    assert_eq!(all, lines);
    let names = |event: &BatchEvent| match event {
        BatchEvent::Refused { typed, .. } => format!("refused {typed}"),
        BatchEvent::Began(began) => format!("began {}", began.run),
        BatchEvent::Ended(ended) => format!("ended {}", ended.serial),
        BatchEvent::Noted { note, .. } => format!("noted {note}"),
        BatchEvent::Batch(facts) => format!("batch {}", facts.name),
        BatchEvent::Text(text) => format!("text {}", text.name),
        BatchEvent::Added { serials, .. } => format!("added {}", serials.len()),
        BatchEvent::Session(session) => format!("session {}", session.bench),
        BatchEvent::Closed { .. } => "closed".to_owned(),
        other => format!("{other:?}"),
    };
    let said: Vec<String> = lines.iter().map(names).collect();
    let first = ["batch day", "text batch.toml", "text rig.toml", "text recipe-1.toml", "added 30", "session rig"];
    assert_eq!(said[..first.len()], first);
    let then = ["refused B-1", "began runs/A-01", "ended A-01", "noted clean", "refused A-01", "closed"];
    assert_eq!(said[first.len()..], then);
    assert!(
        output.err.contains("B-1 isn't in this batch: check it, or add it with `palpate batch add`; nothing moves")
    );
    assert!(output.err.contains("A-01 ACCEPTED") || output.err.contains("A-01 NOT ACCEPTED"), "{}", output.err);
}

#[test]
fn a_sensor_calibrated_again_is_the_same_specimen_with_other_noise() {
    let bench = bench("");
    assert_eq!(piped(&bench, RUN, &["A-01", ".repeat", "A-01", "A-02"]).code, Some(0));
    let manifest = |run: &str| bench.manifest(&format!("day/runs/{run}"));
    let (first, again, other) = (manifest("A-01"), manifest("A-01-2"), manifest("A-02"));
    assert_eq!(first["specimen"], again["specimen"]);
    assert_ne!(first["specimen"], other["specimen"]);
    assert_ne!(first["seed"], again["seed"]);
    // the gains of a specimen differ by 20 %, the readings of one specimen by some 3 %
    let outputs = |run: &str| -> Vec<f64> {
        let table = format!("day/runs/{run}/presses.csv");
        let column = |unit| bench.column(&table, &format!("out_{unit}")).into_iter().take(9);
        (1..=9).flat_map(column).map(|output| output.parse().expect("a number")).collect()
    };
    let [first, again, other] = ["A-01", "A-01-2", "A-02"].map(outputs);
    let apart = |one: &[f64], two: &[f64]| one.iter().zip(two).map(|(a, b)| (a - b).abs()).sum::<f64>();
    let (same, differs) = (apart(&first, &again), apart(&first, &other));
    assert!(same > 0.0 && same < 0.5 * differs, "{same} {differs}");
}

#[test]
fn the_sensors_on_a_tray_are_calibrated_one_after_another_each_in_its_nest() {
    let bench = bench(TRAY);
    let output = piped(&bench, RUN, &["A-01", "A-01", "A-02", "", "A-03"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    assert!(output.err.contains("A-01 is on the tray already; nothing moves"), "{}", output.err);
    let all = events(&bench, "day");
    let nests: Vec<(String, String)> = all
        .iter()
        .filter_map(|event| match event {
            BatchEvent::Began(began) => Some((began.serial.clone(), began.nest.clone().expect("a nest"))),
            _ => None,
        })
        .collect();
    let expected = [("A-01", "left"), ("A-02", "right"), ("A-03", "right")];
    assert_eq!(nests, expected.map(|(serial, nest)| (serial.to_owned(), nest.to_owned())));
    for (serial, origin) in [("A-01", "{ x = -3.0, y = 0.0 }"), ("A-02", "{ x = 3.0, y = 1.5 }")] {
        let rig = bench.read(&format!("day/runs/{serial}/rig.toml"));
        assert!(rig.contains(&format!("origin_mm = {origin}")), "{rig}");
        assert_eq!(complete(&all, serial), 1);
    }
}

#[test]
fn a_nest_out_of_the_travel_is_refused_before_there_is_a_folder() {
    let bench = bench(&TRAY.replace("x = 3.0", "x = 10.0"));
    for words in [RUN, "batch check b.toml"] {
        let output = piped(&bench, words, &["A-01"]);
        assert_eq!(output.code, Some(2), "{}", output.err);
        assert!(
            output.err.starts_with("at the nest right:\n") && output.running().contains("travel"),
            "{}",
            output.err
        );
        assert!(!bench.has("day"));
    }
}

#[test]
fn the_reference_sensor_is_asked_for_first_and_may_wait_for_one_sensor() {
    let bench = bench(REFERENCE);
    let typed = ["A-01", "later", "A-01", "A-02", "REF", "A-02", "A-03", "A-04", "REF", ".end"];
    let output = piped(&bench, RUN, &typed);
    assert_eq!(output.code, Some(0), "{}", output.err);
    let due = "the reference sensor REF is due: put it on the bench and type REF, or type `later`; nothing moves";
    assert_eq!(output.err.matches(due).count(), 3, "{}", output.err);
    let all = events(&bench, "day");
    let began: Vec<&str> = all
        .iter()
        .filter_map(|event| if let BatchEvent::Began(began) = event { Some(began.serial.as_str()) } else { None })
        .collect();
    assert_eq!(began, ["A-01", "REF", "A-02", "A-03", "REF"]);
    for result in results(&all, "REF") {
        assert!(result.reference && result.verdict.is_none() && result.found.len() == 1, "{result:?}");
    }
    assert_eq!(bench.manifest("day/runs/REF-2")["sensor"], "REF");
}

#[test]
fn trip_ends_one_sensor_which_needs_confirmation() {
    let bench = bench("");
    break_rig(&bench, "stuck", 25.0);
    let output = piped(&bench, RUN, &["A-01", "A-01", "A-02"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    let all = events(&bench, "day");
    for serial in ["A-01", "A-02"] {
        let [result] = results(&all, serial)[..] else { panic!("{serial}") };
        assert_eq!((result.status, result.verdict), (Status::Tripped, None), "{result:?}");
    }
    assert!(output.err.contains("safety trip: "), "{}", output.err);
    assert!(
        output.out.contains("A-01 TRIPPED") && output.out.contains("to calibrate it again: .repeat A-01, then A-01")
    );
    let refused =
        "A-01 ended with a safety trip: find its cause, then type `.repeat A-01` to allow it again; nothing moves";
    assert!(output.err.contains(refused), "{}", output.err);
    mend_rig(&bench);
    let output = piped(&bench, RUN, &["A-01", ".repeat A-01", "A-01"]);
    assert!(output.err.contains("the rig has changed since the last session: the batch keeps both"), "{}", output.err);
    let all = events(&bench, "day");
    assert_eq!((begun(&all, "A-01"), complete(&all, "A-01")), (2, 1));
}

#[test]
fn a_device_that_does_not_answer_is_found_before_the_run() {
    let bench = bench("");
    break_rig(&bench, "array-lost", 0.0);
    let output = piped(&bench, RUN, &["A-01"]);
    assert_eq!(output.code, Some(0), "{}", output.err);
    let all = events(&bench, "day");
    let result = results(&all, "A-01")[0];
    assert_eq!((result.status, result.runs.len()), (Status::Failed, 0), "{result:?}");
    assert!(result.reasons[0].contains("array"), "{result:?}");
    assert!(!bench.has("day/runs/A-01"), "no run began");
}

#[test]
fn a_stage_that_can_not_be_parked_ends_the_batch() {
    let bench = bench("");
    break_rig(&bench, "stage-lost", 25.0);
    let output = piped(&bench, RUN, &["A-01", "A-02"]);
    assert!(matches!(output.code, Some(3 | 4)), "{:?} {}", output.code, output.err);
    assert!(
        output.err.contains("the stage could not be parked: move it clear of the specimen by hand"),
        "{}",
        output.err
    );
    let all = events(&bench, "day");
    assert_eq!((results(&all, "A-01").len(), begun(&all, "A-02")), (1, 0));
}

#[test]
fn a_batch_is_continued_with_the_same_files_only() {
    let bench = bench("");
    assert_eq!(piped(&bench, RUN, &["A-01"]).code, Some(0));
    bench.write("r.toml", &exchanged(RECIPE, "force_n = 1.0", "force_n = 0.9"));
    let output = piped(&bench, RUN, &["A-02"]);
    assert_eq!(output.code, Some(2));
    assert!(output.running().contains("day was begun with another recipe-1.toml"), "{}", output.err);
    bench.write("r.toml", RECIPE);
    assert_eq!(piped(&bench, RUN, &["A-02"]).code, Some(0));
    assert_eq!(complete(&events(&bench, "day"), "A-02"), 1);
    bench.palpate("run r.toml --rig rig.toml --out run");
    let output = piped(&bench, "batch run b.toml --out run", &["A-03"]);
    assert_eq!(output.code, Some(2));
    assert!(output.running().contains("the journal of a run, not of a batch"), "{}", output.err);
}

#[test]
fn a_batch_is_not_continued_with_wider_limits_than_it_began_with() {
    let bench = bench("");
    assert_eq!(piped(&bench, RUN, &["A-01"]).code, Some(0));
    let (rig, journal) = (bench.read("rig.toml"), bench.read("day/journal.log"));
    for (from, to) in [("force_n = 2.0", "force_n = 4.0"), ("stiffness_n_mm = 2.0", "stiffness_n_mm = 1.0")] {
        bench.write("rig.toml", &exchanged(&rig, from, to));
        let output = piped(&bench, RUN, &["A-02"]);
        assert_eq!(output.code, Some(2), "{}", output.err);
        let (key, now) = to.split_once(" = ").expect("a key");
        let expected = format!("`limits.{key}` is {now}; the batch began with 2.0");
        assert!(output.running().contains(&expected), "{}", output.err);
        assert_eq!(bench.read("day/journal.log"), journal, "nothing is changed");
    }
    // a tighter limit is accepted and recorded, and the first one remains the widest
    for (force, sensor, code) in [("1.8", "A-02", 0), ("2.0", "A-03", 0), ("2.1", "A-04", 2)] {
        bench.write("rig.toml", &exchanged(&rig, "force_n = 2.0", &format!("force_n = {force}")));
        let output = piped(&bench, RUN, &[sensor]);
        assert_eq!(output.code, Some(code), "{force} N: {}", output.err);
    }
    let all = events(&bench, "day");
    let rigs = all.iter().filter(|event| matches!(event, BatchEvent::Text(text) if text.name == "rig.toml"));
    assert_eq!(rigs.count(), 3);
    assert_eq!(["A-01", "A-02", "A-03", "A-04"].map(|sensor| begun(&all, sensor)), [1, 1, 1, 0]);
}

#[test]
fn a_batch_whose_journal_has_lost_a_sensor_names_its_run_and_calibrates_nothing() {
    let bench = bench("");
    assert_eq!(piped(&bench, RUN, &["A-01", "A-02"]).code, Some(0));
    let journal = bench.read("day/journal.log");
    let lines: Vec<&str> = journal.lines().collect();
    let began = lines.iter().rposition(|line| line.contains("{\"began\":")).expect("A-02 began");
    bench.write("day/journal.log", &(lines[..began].join("\n") + "\n"));
    let before = bench.read("day/journal.log");
    for words in [RUN, "batch note day A-01 seen"] {
        let output = piped(&bench, words, &["A-02"]);
        assert_eq!(output.code, Some(2), "{words}: {}", output.err);
        assert!(
            output.running().contains("day: journal.log doesn't have the runs runs/A-02"),
            "{words}: {}",
            output.err
        );
        assert!(!bench.has("day/runs/A-02-2") && bench.read("day/journal.log") == before, "{words}");
    }
    std::fs::rename(bench.path("day/runs/A-02"), bench.path("A-02")).expect("another place");
    assert_eq!(piped(&bench, RUN, &["A-02"]).code, Some(0));
}

#[test]
fn decisions_of_the_operator_are_recorded() {
    let bench = bench("");
    assert_eq!(piped(&bench, RUN, &["A-01", ".skip A-02", "A-02"]).code, Some(0));
    for (words, code, said) in [
        ("batch add day C-1 C-2", 0, "2 sensors added"),
        ("batch add day C-3 c-1", 2, "\"c-1\": is in the batch already"),
        ("batch add day C-3 C-3", 2, "\"C-3\": is here twice"),
        ("batch add day a/b", 2, "\"a/b\": not a serial number"),
        ("batch retry day A-02", 0, "A-02 may be calibrated again"),
        ("batch retry day B-1", 2, "day has no sensor \"B-1\""),
        ("batch skip day C-2", 0, "C-2 is skipped"),
        ("batch note day C-1 scratched", 0, "C-1 has this note"),
        ("batch status nothing", 2, "nothing is not a batch folder (journal.log not found)"),
    ] {
        let output = bench.palpate_ends(code, words);
        assert!(format!("{}{}", output.out, output.running()).contains(said), "{words}: {}{}", output.out, output.err);
    }
    let output = piped(&bench, RUN, &["A-02", "C-2", "C-1"]);
    assert!(
        output.err.contains("C-2 was skipped: type `.repeat C-2` to allow it again; nothing moves"),
        "{}",
        output.err
    );
    let status = &bench.palpate_ends(0, "batch status day --json").json_lines()[0];
    assert_eq!((&status["counts"]["waiting"], &status["counts"]["skipped"]), (&28.into(), &1.into()), "{status}");
    assert_eq!(status["sensors"][30]["note"], "scratched");
    assert_eq!(bench.manifest("day/runs/C-1")["note"], "scratched");
}

#[test]
fn all_problems_of_a_batch_file_are_reported_at_once_each_at_its_line() {
    let bench =
        TestFolder::with([("b.toml", "name = \"a/b\"\ndesign = \"d\"\nrig = \"rig.toml\"\nserials = []\nseeds = 1\n")]);
    let output = bench.palpate_ends(2, "batch check b.toml");
    for problem in
        ["isn't a valid folder name", "`recipes` is missing", "`serials` has 0 sensors", "unknown key `seeds`"]
    {
        assert!(output.running().contains(problem), "{problem}: {}", output.err);
    }
}

#[test]
fn chance_of_no_decision_is_printed_or_its_missing_keys() {
    let bench = bench("");
    let output = bench.palpate_ends(0, "batch check b.toml");
    assert!(output.out.contains("computed: state `location_mean_mm` in `typical`"), "{}", output.out);
    assert!(output.out.contains("14 presses: 9 of the calibration, 5 of the test"), "{}", output.out);
    let batch = bench.read("b.toml");
    bench.write("b.toml", &format!("{batch}accept = \"rule.toml\"\ntypical = {{ location_mean_mm = 0.9 }}\n"));
    bench.write("rule.toml", "rule = \"guarded\"\nlocation_mean_mm = 1.0\n");
    let output = bench.palpate_ends(0, "batch check b.toml");
    assert!(output.out.contains("ACCEPTED with 0.0 %"), "{}", output.out);
    assert!(output.out.contains("none is accepted: use more test presses"), "{}", output.out);
}
