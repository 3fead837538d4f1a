//! Repetition: one seed gives the same tables byte for byte, and an interrupted run gets the rows of its plan, with the acknowledged ones
//! unchanged.

use palpate_data::dataset::{Journal, Memory, Record, Status};
use palpate_data::recipe::{self, Plan};
use palpate_run::rig;
use palpate_run::run::{Cancel, Listener, RunJob, execute};
use palpate_testing::executions::run_virtually;
use palpate_testing::interrupted::{change_text, change_the_world, cut_to_lines, lines_before_contacts, sealed};
use palpate_testing::{SMALL, SMALL_PRESSES, TestFolder, exchanged, shipped_text};

#[test]
fn one_seed_gives_the_same_tables_byte_for_byte_and_another_does_not() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    // neither the output nor the pace may change the measured values
    for (run, more) in [("one", ""), ("two", "--json"), ("paced", "--pace 200"), ("other", "--seed 2")] {
        bench.palpate_ends(0, &format!("run r.toml --out {run} {more}"));
    }
    let (one, two, paced) = (tables(&bench, "one"), tables(&bench, "two"), tables(&bench, "paced"));
    let names: Vec<&str> = one.iter().map(|(name, _)| name.as_str()).collect();
    let expected = [
        "calibration_matrix.csv",
        "characteristics.csv",
        "journal.log",
        "presses.csv",
        "recipe.toml",
        "rig.toml",
        "scene.csv",
        "test_matrix.csv",
    ];
    assert_eq!(names, expected);
    assert!(one == two, "two runs of one seed differ: {:?}", differing(&one, &two));
    assert!(one == paced, "the pace changes {:?}", differing(&one, &paced));
    let other = tables(&bench, "other");
    let differing = differing(&one, &other);
    assert_eq!(differing, expected.into_iter().filter(|name| !name.ends_with(".toml")).collect::<Vec<_>>());
}

#[test]
fn run_without_files_has_the_records_of_a_run_with_files() {
    struct RerunSilent;
    impl Listener for RerunSilent {}
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let journal = Journal::records(&bench.path("run/journal.log")).expect("a journal");
    // except for the provenance of the folder
    let is_measured =
        |record: &Record| !matches!(record, Record::Run(_) | Record::Session(_) | Record::Text(_) | Record::End(_));
    let records: Vec<_> = journal.map(|record| record.expect("a record").1).filter(is_measured).collect();

    let spec = rig::parse("rig.toml", &shipped_text("rigs/sim.toml"), &|_| unreachable!()).expect("a rig");
    let plan = Plan::new(&recipe::parse("r.toml", SMALL).expect("a recipe"), &spec.ground(), 1).expect("a plan");
    let (mut memory, cancel) = (Memory::default(), Cancel::default());
    let mut execute_on = |expected: &[_]| {
        let job = RunJob { plan: &plan, spec: &spec, ledger: &mut memory, cancel: &cancel, shown: &|_| {} };
        let ending = run_virtually(execute(job, &mut RerunSilent));
        assert_eq!(ending.status(), Status::Complete, "{:?}", ending.text());
        assert_eq!(memory.records()[..records.len()], *expected);
        assert_eq!(memory.contacts().count(), SMALL_PRESSES as usize);
    };
    execute_on(&records);
    execute_on(&records); // existing presses aren't made again
}

#[test]
fn a_run_of_a_removed_method_is_resumed_and_evaluated_with_the_others() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let named = format!("{SMALL}\n[evaluate]\nsolvers = [\"whitened\", \"pearson\"]\n");
    change_text(&bench, "run", "recipe.toml", &named);
    cut_to_lines(&bench, "run", lines_before_contacts(&bench, "run") + 3);
    let output = bench.palpate_ends(0, "resume run --evaluate recipe");
    let removed = "whitened was removed from palpate";
    assert_eq!(output.running().matches(removed).count(), 1, "{}", output.err);
    assert!(output.out.contains("pearson") && !output.out.contains("whitened"), "{}", output.out);
    for words in ["evaluate run --solver pearson", "report run", "verify run"] {
        let output = bench.palpate_ends(0, words);
        assert_eq!(output.running().contains(removed), !words.starts_with("verify"), "{words}: {}", output.err);
    }
    bench.write("new.toml", &named);
    let output = bench.palpate_ends(2, "check new.toml --rig sim");
    assert!(output.running().contains("`solvers` has \"whitened\", expected some of"), "{}", output.err);
}

#[test]
fn a_strategy_from_the_command_line_is_kept_and_planned_again_by_resume() {
    let recipe = SMALL.replace("spacing_mm = 4.0", "spacing_mm = 2.0"); // 1 staircase, 9 and 2 plain presses
    let bench = TestFolder::with([("r.toml", recipe.as_str())]);
    let output = bench.palpate_ends(0, "run r.toml --out run --strategy map");
    assert!(output.err.contains("teach: from press 1 of 17"), "{}", output.err);
    assert_eq!(bench.manifest("run")["strategy"], "map");
    assert_eq!(bench.manifest("run")["presses_done"], 17);
    let whole = bench.read("run/presses.csv");
    let training_presses: Vec<String> = bench.column("run/presses.csv", "phase").into_iter().rev().take(5).collect();
    assert_eq!(training_presses, ["teach"; 5], "numbered after all others");
    assert_eq!(bench.read("run/calibration_matrix.csv").lines().next().map(|line| line.split(',').count()), Some(9));

    // as after a power cut after the training presses
    cut_to_lines(&bench, "run", lines_before_contacts(&bench, "run") + 5);
    let output = bench.palpate_ends(0, "resume run");
    assert!(output.err.contains("characterisation: from press 6 of 17"), "{}", output.err);
    assert_eq!(bench.manifest("run")["presses_done"], 17);
    let cells = |text: &str| text.lines().map(|line| line.split(',').take(6).collect::<String>()).collect::<Vec<_>>();
    assert_eq!(cells(&bench.read("run/presses.csv")), cells(&whole), "the same plan");

    bench.palpate_ends(0, "run r.toml --out other");
    assert_eq!(bench.manifest("other").get("strategy"), None);
}

#[test]
fn run_does_not_continue_with_another_zero() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    // as after a power cut before the last press, with another load cell
    cut_to_lines(&bench, "run", bench.read("run/journal.log").lines().count() - 2);
    let rig = bench.read("run/rig.toml");
    let offset = |offset_n: f64| exchanged(&rig, "noise_n = 0.003", &format!("noise_n = 0.003, offset_n = {offset_n}"));
    // 20 % of the force limit are 0.4 N; zeros of sessions in between don't count
    change_the_world(&bench, "run", &offset(0.38));
    bench.palpate_ends(0, "resume run");
    cut_to_lines(&bench, "run", bench.read("run/journal.log").lines().count() - 2);
    change_the_world(&bench, "run", &offset(0.42));
    let output = bench.palpate_ends(4, "resume run");
    assert!(output.running().contains("zero-drifted: 0.42"), "{}", output.err);
    assert_eq!(bench.manifest("run")["status"], "tripped");
    // the old cell back, and confirmed by a person
    change_the_world(&bench, "run", &rig);
    bench.palpate_ends(2, "resume run");
    bench.palpate_ends(0, "resume run --after-trip");
    assert_eq!(bench.manifest("run")["status"], "complete");
}

#[test]
fn run_does_not_continue_after_the_surface_moved() {
    let bench = half_done();
    let rig = bench.read("run/rig.toml");
    for (moved_mm, goes_on) in [("0.03", true), ("-0.1", false), ("0.1", false)] {
        let bench = half_done();
        let moved = exchanged(&rig, "[scene]", &format!("[scene]\nmounting = {{ z_mm = {moved_mm} }}\n"));
        change_the_world(&bench, "run", &moved);
        if goes_on {
            let output = bench.palpate_ends(0, "resume run");
            assert!(output.err.matches("touched again at ").count() == 3, "three of four places: {}", output.err);
            continue;
        }
        let output = bench.palpate_ends(4, "resume run");
        assert!(
            output.running().contains("surface-moved: ") && output.running().contains("limit 0.0500 mm"),
            "{}",
            output.err
        );
        assert!(output.running().contains("check whether the specimen or the rig has moved"), "{}", output.err);
        // put back, it continues after a confirmation
        change_the_world(&bench, "run", &rig);
        bench.palpate_ends(2, "resume run");
        bench.palpate_ends(0, "resume run --after-trip");
    }
}

#[test]
fn stage_homed_by_hand_repeats_presses_and_a_sideways_shift_is_found() {
    let sim = include_str!("../../rigs/sim.toml");
    let rig = exchanged(sim, "driver = \"esp301\"", "driver = \"grbl\"\nhome = \"by hand\"");
    let recipe = "name = \"r\"\nrig = \"sim\"\n[[step]]\nphase = \"calibration\"\nforce_n = 1.0\n\
                  grid = { x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], spacing_mm = 2.0 }\n";
    for (shift_mm, goes_on) in [("0.0", true), ("0.1", true), ("0.5", false), ("-0.6", false)] {
        let bench = TestFolder::with([("r.toml", recipe), ("rig.toml", &rig)]);
        bench.palpate_ends(0, "run r.toml --rig rig.toml --out run");
        cut_to_lines(&bench, "run", lines_before_contacts(&bench, "run") + 20);
        let began = bench.read("run/rig.toml");
        let moved = exchanged(&began, "[scene]", &format!("[scene]\nmounting = {{ x_mm = {shift_mm} }}\n"));
        change_the_world(&bench, "run", &moved);
        let output = bench.palpate_ends(if goes_on { 0 } else { 4 }, "resume run");
        assert_eq!(output.running().contains("zero-shifted: 0."), !goes_on, "{shift_mm}: {}", output.err);
        assert_eq!(output.err.matches("touched again at ").count(), 3, "{}", output.err);
    }
}

#[test]
fn run_does_not_continue_with_another_device() {
    let bench = half_done();
    let rig = bench.read("run/rig.toml");
    change_the_world(&bench, "run", &exchanged(&rig, "\"generic-rs485\"", "\"laumas-tlb\""));
    let output = bench.palpate_ends(3, "resume run");
    let expected = "load_cell: while identifying it, to continue the run: it was \"generic RS485";
    assert!(output.running().contains(expected), "{}", output.err);
    assert_eq!(bench.manifest("run")["status"], "failed");
    change_the_world(&bench, "run", &rig);
    bench.palpate_ends(0, "resume run");
    // a stage that the run didn't begin with
    let bench = half_done();
    let journal = bench.read("run/journal.log");
    let (nth, devices) =
        journal.lines().enumerate().find(|(_, line)| line.contains(" {\"devices\":")).expect("devices");
    let json = devices.splitn(3, ' ').nth(2).expect("a record");
    let others = sealed(nth as u64, &exchanged(json, "\"ESP301", "\"another ESP301"));
    bench.write("run/journal.log", &exchanged(&journal, devices, &others));
    let output = bench.palpate_ends(3, "resume run");
    let expected = "stage: while identifying it, to continue the run: it was \"another ESP301";
    assert!(output.running().contains(expected), "{}", output.err);
}

/// A run that a power cut ended after a staircase and three points of its grid.
fn half_done() -> TestFolder {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    cut_to_lines(&bench, "run", lines_before_contacts(&bench, "run") + 4);
    bench
}

#[test]
fn matrices_have_a_row_of_outputs_for_each_unit() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let (header, rows) = bench.table("run/presses.csv");
    let first = header.iter().position(|name| name == "out_1").expect("out_1");
    for (phase, name, points) in [("calibration", "calibration_matrix.csv", 4), ("test", "test_matrix.csv", 2)] {
        let matrix = bench.read(&format!("run/{name}"));
        let matrix: Vec<Vec<&str>> = matrix.lines().map(|line| line.split(',').collect()).collect();
        let presses: Vec<&Vec<String>> = rows.iter().filter(|row| row[2] == phase).collect();
        assert_eq!((matrix.len(), presses.len()), (9, points), "{name}");
        for (unit, row) in matrix.iter().enumerate() {
            let outputs: Vec<&String> = presses.iter().map(|press| &press[first + unit]).collect();
            assert_eq!(*row, outputs, "{name}, unit {}", unit + 1);
        }
    }
}

/// Everything in a run's folder except for its times.
fn tables(bench: &TestFolder, run: &str) -> Vec<(String, Vec<u8>)> {
    let telling = |(name, bytes): (String, Vec<u8>)| match name.as_str() {
        "manifest.json" => None,
        "journal.log" => Some((name, without_the_clock(&bytes))),
        _ => Some((name, bytes)),
    };
    bench.bytes(run).into_iter().filter_map(telling).collect()
}

/// A journal without the two kinds of record with time and place.
fn without_the_clock(journal: &[u8]) -> Vec<u8> {
    let text = std::str::from_utf8(journal).expect("a journal is text");
    let is_timeless = |line: &&str| !line.contains(" {\"session\":") && !line.contains(" {\"end\":");
    text.lines().filter(is_timeless).flat_map(|line| [line, "\n"]).collect::<String>().into_bytes()
}

/// Names of the files that differ.
fn differing<'a>(one: &'a [(String, Vec<u8>)], other: &[(String, Vec<u8>)]) -> Vec<&'a str> {
    one.iter().filter(|file| !other.contains(file)).map(|(name, _)| name.as_str()).collect()
}

#[cfg(unix)]
mod interrupted {
    use palpate_testing::{CommandOutput, LONG, LONG_PRESSES, Live, TestFolder};
    use serde_json::Value;

    /// Slow enough for a signal in the middle of the run, and fast enough for a test: 2 s a press take 130 ms.
    const RUN: &str = "run r.toml --json --out run --pace 15";

    #[test]
    fn a_run_that_is_stopped_parks_keeps_its_rows_and_is_finished_by_resume() {
        // before the first press; in the second staircase; among the points of the grid
        for rows in [0, 5, 13] {
            let bench = TestFolder::with([("r.toml", LONG)]);
            let (seen, output) = interrupted(&bench, RUN, rows, "INT");
            assert_eq!(output.code, Some(130), "{}", output.err);
            assert!(output.err.contains("stopped: ") && !output.err.contains("could not be parked"), "{}", output.err);
            let manifest = bench.manifest("run");
            assert_eq!(manifest["status"], "stopped");
            assert_eq!(manifest["presses_done"], presses(&seen), "after {rows} rows");
            assert!(presses(&seen) < LONG_PRESSES, "it was stopped in the middle");
            assert_eq!(numbered(&table(&bench)), numbered(&seen), "presses.csv has what was acknowledged");
            assert_finished_by_resume(&bench, &seen);
        }
    }

    #[test]
    fn a_run_that_is_killed_has_every_acknowledged_row_and_is_finished_by_resume() {
        for rows in [0, 1, 5, 7, 12] {
            let bench = TestFolder::with([("r.toml", LONG)]);
            let (seen, output) = interrupted(&bench, RUN, rows, "KILL");
            assert_eq!(output.code, None);
            assert_eq!(bench.manifest("run")["status"], "stopped", "what it is if nobody says otherwise");
            assert_finished_by_resume(&bench, &seen);
        }
    }

    #[test]
    fn run_can_be_interrupted_repeatedly() {
        let bench = TestFolder::with([("r.toml", LONG)]);
        let (mut seen, _) = interrupted(&bench, RUN, 5, "KILL");
        for signal in ["INT", "KILL", "TERM"] {
            let (more, _) = interrupted(&bench, "resume run --json --pace 15", 1, signal);
            seen.extend(more);
        }
        assert_finished_by_resume(&bench, &seen);
    }

    /// Starts the program, sends it a signal after so many acknowledged rows (0: when the first press begins), and returns the acknowledged
    /// rows.
    fn interrupted(bench: &TestFolder, words: &str, rows: usize, signal: &str) -> (Vec<Value>, CommandOutput) {
        let live = Live::start(bench.command(words));
        live.until_printed(": from press ");
        let mut seen: Vec<Value> = (0..rows).map(|_| json(&live.line().expect("another row"))).collect();
        live.signal(signal);
        let output = live.end();
        seen.extend(output.out.lines().map(json));
        (seen, output)
    }

    /// Resumes to the end: each row of the plan once, in its order, with the acknowledged ones unchanged.
    fn assert_finished_by_resume(bench: &TestFolder, acknowledged: &[Value]) {
        let output = bench.palpate_ends(0, "resume run --json");
        let resumed: Vec<Value> = output.out.lines().map(json).collect();
        let manifest = bench.manifest("run");
        assert_eq!((&manifest["status"], &manifest["presses_done"]), (&"complete".into(), &LONG_PRESSES.into()));

        let staircases = (0..2).flat_map(|press| (0..5).map(move |level| (press, level)));
        let plan: Vec<(u64, u64)> = staircases.chain((2..LONG_PRESSES).map(|press| (press, 0))).collect();
        let table = table(bench);
        assert_eq!(numbered(&table), plan);
        for row in acknowledged.iter().chain(&resumed) {
            assert!(table.contains(row), "this row was acknowledged and isn't in the table as it was: {row}");
        }
        let again = numbered(acknowledged).into_iter().filter(|row| numbered(&resumed).contains(row));
        assert_eq!(again.collect::<Vec<_>>(), [], "acknowledged rows that were made again");
        let times: Vec<f64> = table.iter().filter_map(|row| row["t_s"].as_f64()).collect();
        assert!(times.is_sorted(), "t_s is since the run's start, whatever came between: {times:?}");
        assert_eq!(bench.table("run/scene.csv").1.len(), plan.len());
    }

    /// The rows of `presses.csv` as the objects that acknowledge them.
    fn table(bench: &TestFolder) -> Vec<Value> {
        let (header, rows) = bench.table("run/presses.csv");
        let is_word = |column: &str| matches!(column, "phase" | "flags");
        let cell = |(column, cell): (&String, String)| {
            let whole = matches!(column.as_str(), "press" | "level").then(|| cell.parse::<u64>().map(Value::from));
            let value = match whole {
                Some(whole) => whole.expect("a whole number"),
                None if is_word(column) => cell.into(),
                None if cell.is_empty() => Value::Null, // not measured
                None => cell.parse::<f64>().expect("a number").into(),
            };
            (column.clone(), value)
        };
        rows.into_iter().map(|row| header.iter().zip(row).map(cell).collect()).collect()
    }

    fn json(line: &str) -> Value {
        serde_json::from_str(line).unwrap_or_else(|error| panic!("{line}: {error}"))
    }

    fn numbered(rows: &[Value]) -> Vec<(u64, u64)> {
        let number = |row: &Value, key: &str| row[key].as_u64().expect("a whole number");
        rows.iter().map(|row| (number(row, "press"), number(row, "level"))).collect()
    }

    /// Number of presses that the rows belong to.
    fn presses(rows: &[Value]) -> u64 {
        let mut presses: Vec<u64> = numbered(rows).into_iter().map(|(press, _)| press).collect();
        presses.dedup();
        presses.len() as u64
    }
}
