//! Signals during a run: Ctrl-C once and twice, SIGTERM, a closed terminal, a pause and Enter. In any case the stage is parked, the journal
//! is complete, and the run can continue.
#![cfg(unix)]

mod batch;

use palpate_data::dataset::{Journal, Record, RecordedContact};
use palpate_testing::rows::{json, numbered, table};
use palpate_testing::terminal::{TestTerminal, heed_hangups, signal, spawned, wait};
use palpate_testing::{CommandOutput, LONG, LONG_PRESSES, Live, TestFolder};
use serde_json::Value;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

/// First phase of the recipe.
const STAIRCASES: u64 = 2;
const LEVELS: u64 = 5;

/// Number of pauses of one run.
const PAUSES: usize = 3;

/// The first press takes two seconds at this pace, because its descent is slow: a signal at its beginning comes in the middle of it.
const RUN: &str = "run r.toml --json --out run --pace 15";

/// Time for which a pause is watched: a run that continues would take a zero in a tenth of it.
const A_WHILE: Duration = Duration::from_millis(700);

const CANCELLED: Option<i32> = Some(130);

/// Message after the first Ctrl-C.
const FINISHED_FIRST: &str = "finishing this press";

#[test]
fn one_interrupt_without_a_terminal_finishes_the_press_and_stops() {
    assert_finishes_the_press_and_stops("INT");
}

#[test]
fn a_stop_by_job_control_finishes_the_press_and_stops_too() {
    assert_finishes_the_press_and_stops("TSTP");
}

fn assert_finishes_the_press_and_stops(name: &str) {
    let bench = TestFolder::with([("r.toml", LONG)]);
    let live = Live::start(bench.command(RUN));
    live.until_printed(": from press 1 of 11");
    live.signal(name);
    let output = live.end();
    assert_eq!(output.code, CANCELLED, "{}", output.err);
    assert!(output.err.contains(&format!("{FINISHED_FIRST}, then the run stops")), "{}", output.err);
    assert!(output.err.contains("stopped: 1 of 11 presses"), "{}", output.err);
    assert_eq!(rows(&output.out).len() as u64, LEVELS, "the whole staircase is acknowledged");
    assert_stopped_with(&bench, 1);
    assert_finished_by_resume(&bench, &output.out);
}

#[test]
fn two_interrupts_stop_in_the_middle_of_the_press() {
    let bench = TestFolder::with([("r.toml", LONG)]);
    let live = Live::start(bench.command(RUN));
    live.until_printed(": from press 1 of 11");
    live.signal("INT");
    live.until_printed(FINISHED_FIRST);
    live.signal("INT");
    assert_stopped_at_once(&bench, live.end());
}

#[test]
fn sigterm_and_hangup_stop_in_the_middle_of_the_press() {
    heed_hangups();
    for name in ["TERM", "HUP"] {
        let bench = TestFolder::with([("r.toml", LONG)]);
        let live = Live::start(bench.command(RUN));
        live.until_printed(": from press 1 of 11");
        live.signal(name);
        assert_stopped_at_once(&bench, live.end());
    }
}

#[test]
fn a_signal_before_the_first_press_stops_there() {
    let bench = TestFolder::with([("r.toml", LONG)]);
    let live = Live::start(bench.command(RUN));
    live.until_printed("stage "); // the start of the run is printed, and the touched places come next
    live.signal("TERM");
    assert_stopped_at_once(&bench, live.end());
}

#[test]
fn run_without_a_reader_stops_as_usual() {
    for (name, presses) in [("TERM", 0), ("INT", 1)] {
        let bench = TestFolder::with([("r.toml", LONG)]);
        let child = unheard(&bench);
        signal(&child, name);
        assert_eq!(wait(child), CANCELLED, "{name}");
        assert_stopped_with(&bench, presses);
        assert_finished_by_resume(&bench, "");
    }
}

#[test]
fn run_without_a_reader_is_completed_as_usual() {
    let bench = TestFolder::with([("r.toml", LONG)]);
    assert_eq!(wait(unheard(&bench)), Some(0));
    assert_eq!(bench.manifest("run")["status"], "complete");
    assert_eq!(numbered(&table(&bench, "run")), plan());
}

/// `setsid` of util-linux gives a program a controlling terminal.
#[cfg(target_os = "linux")]
#[test]
fn a_closed_terminal_stops_and_parks() {
    heed_hangups();
    let bench = TestFolder::with([("r.toml", LONG)]);
    let mut terminal = TestTerminal::open();
    // in its own session, with this terminal: it gets the hangup when the terminal closes
    let program = bench.command(RUN);
    let mut command = Command::new("setsid");
    command.arg("--ctty").arg(program.get_program()).args(program.get_args()).current_dir(bench.path("."));
    command.env("TERM", "xterm");
    let child = spawned(command.stdin(terminal.far()).stdout(terminal.far()).stderr(terminal.far()));
    terminal.until("characterisation");
    terminal.close();
    assert_eq!(wait(child), CANCELLED);
    assert_stopped_with(&bench, 0);
    assert_finished_by_resume(&bench, "");
}

#[cfg(target_os = "linux")]
#[test]
fn a_hangup_under_nohup_stops_nothing() {
    let bench = TestFolder::with([("r.toml", LONG)]);
    let program = bench.command(RUN);
    let mut command = Command::new("nohup");
    command.arg(program.get_program()).args(program.get_args()).current_dir(bench.path("."));
    let live = Live::start(command);
    live.until_printed(": from press 1 of 11");
    live.signal("HUP");
    let output = live.end();
    assert_eq!(output.code, Some(0), "{}", output.err);
    assert_eq!(numbered(&rows(&output.out)), plan());
}

#[test]
fn a_pause_at_a_terminal_is_ended_by_enter_with_a_new_zero() {
    let bench = TestFolder::with([("r.toml", LONG)]);
    let (mut terminal, child) = attended(&bench);
    terminal.until("characterisation");
    terminal.enter(); // before there is a pause that it could end
    signal(&child, "INT");
    terminal.until(&format!("{FINISHED_FIRST}, then the run pauses"));
    terminal.until("paused after 1 of 11 presses, stage parked: Enter continues, Ctrl-C ends");
    sleep(A_WHILE);
    assert_eq!((zeros(&bench), contacts(&bench).len()), (1, 1), "nothing is done before Enter");
    terminal.enter();
    let seen = terminal.until_end();
    assert_eq!(wait(child), Some(0), "{seen}");
    assert_eq!(zeros(&bench), 2, "the zero is taken again");
    assert_eq!(bench.manifest("run")["status"], "complete");
    let acknowledged = rows(&bench.read("rows"));
    assert_eq!(numbered(&acknowledged), plan(), "each row once");
    assert_eq!(table(&bench, "run"), acknowledged);
}

#[test]
fn run_can_be_paused_repeatedly() {
    let bench = TestFolder::with([("r.toml", LONG)]);
    let mut terminal = TestTerminal::open();
    let mut command = bench.command(RUN);
    command.stdin(terminal.far()).stderr(terminal.far());
    let mut child = spawned(command.stdout(Stdio::piped()));
    drop(command); // it is at the terminal too
    let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
    let (mut acknowledged, mut presses) = (Vec::new(), 0);
    for pause in 0..PAUSES {
        // a press after the last pause: the run continues
        while numbered(&acknowledged).last().is_none_or(|(press, _)| *press < presses) {
            acknowledged.push(json(&lines.next().expect("another row").expect("a line")));
        }
        signal(&child, "INT");
        terminal.until("paused after ");
        presses = terminal.until(" of ").parse().expect("a number");
        sleep(A_WHILE);
        assert_eq!(
            (zeros(&bench), contacts(&bench).len() as u64),
            (1 + pause, presses),
            "nothing is done before Enter"
        );
        terminal.enter();
    }
    let seen = terminal.until_end();
    assert_eq!(wait(child), Some(0), "{seen}");
    assert_eq!(zeros(&bench), 1 + PAUSES);
    acknowledged.extend(lines.map(|line| json(&line.expect("a line"))));
    assert_eq!(numbered(&acknowledged), plan(), "each row once");
}

#[test]
fn a_pause_is_ended_by_a_second_interrupt() {
    assert_a_pause_is_ended(|terminal, child| {
        signal(child, "INT");
        let seen = terminal.until_end();
        assert!(seen.contains("stopping") && !seen.contains("could not be parked"), "{seen}");
    });
}

#[test]
fn pause_ends_when_the_terminal_closes() {
    assert_a_pause_is_ended(|terminal, _| terminal.close());
}

fn assert_a_pause_is_ended(end: impl FnOnce(TestTerminal, &Child)) {
    let bench = TestFolder::with([("r.toml", LONG)]);
    let (mut terminal, child) = attended(&bench);
    terminal.until("characterisation");
    signal(&child, "INT");
    terminal.until("paused after 1 of 11 presses");
    end(terminal, &child);
    assert_eq!(wait(child), CANCELLED);
    assert_stopped_with(&bench, 1);
    let acknowledged = bench.read("rows");
    assert_eq!(rows(&acknowledged).len() as u64, LEVELS);
    assert_finished_by_resume(&bench, &acknowledged);
}

/// A run in its first press whose readers are gone: neither messages nor rows can be written any more.
fn unheard(bench: &TestFolder) -> Child {
    let mut command = bench.command(RUN);
    let mut child = spawned(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
    let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines();
    let is_begun = |line: Result<String, _>| line.expect("a line").contains(": from press 1 of 11");
    assert!(lines.any(is_begun), "it ended before its first press");
    drop((lines, child.stdout.take()));
    child
}

/// A run at this terminal; its rows go into a file.
fn attended(bench: &TestFolder) -> (TestTerminal, Child) {
    let terminal = TestTerminal::open();
    let mut command = bench.command(RUN);
    command.stdin(terminal.far()).stderr(terminal.far());
    let child = spawned(command.stdout(File::create(bench.path("rows")).expect("a file")));
    (terminal, child)
}

/// It stopped during its first press, and parked.
fn assert_stopped_at_once(bench: &TestFolder, output: CommandOutput) {
    assert_eq!(output.code, CANCELLED, "{}", output.err);
    assert!(output.err.contains("stopping: the stage is stopped and parked"), "{}", output.err);
    assert!(output.err.contains("stopped: 0 of 11") && !output.err.contains("could not be parked"), "{}", output.err);
    assert_eq!(output.out, "", "nothing is acknowledged");
    assert_stopped_with(bench, 0);
    assert_finished_by_resume(bench, "");
}

/// The journal states the stop, and has so many complete presses.
fn assert_stopped_with(bench: &TestFolder, presses: u64) {
    let manifest = bench.manifest("run");
    assert_eq!((&manifest["status"], &manifest["presses_done"]), (&"stopped".into(), &presses.into()));
    let contacts = contacts(bench);
    assert_eq!(contacts.len() as u64, presses);
    for contact in &contacts {
        assert_eq!(contact.levels.len() as u64, levels(contact.press), "press {}", contact.press);
    }
    assert!(matches!(records(bench).last(), Some(Record::End(_))), "the journal is ended");
}

/// Resumes to the end: each row of the plan once, with the acknowledged ones unchanged.
fn assert_finished_by_resume(bench: &TestFolder, acknowledged: &str) {
    let output = bench.palpate_ends(0, "resume run --json");
    let all: Vec<Value> = rows(acknowledged).into_iter().chain(rows(&output.out)).collect();
    let table = table(bench, "run");
    assert_eq!(numbered(&table), plan());
    for row in &all {
        assert!(table.contains(row), "this row was acknowledged and isn't in the table as it was: {row}");
    }
    assert_eq!(bench.manifest("run")["status"], "complete");
}

/// Press and level of each row of the plan.
fn plan() -> Vec<(u64, u64)> {
    (0..LONG_PRESSES).flat_map(|press| (0..levels(press)).map(move |level| (press, level))).collect()
}

fn levels(press: u64) -> u64 {
    if press < STAIRCASES { LEVELS } else { 1 }
}

fn rows(lines: &str) -> Vec<Value> {
    lines.lines().map(json).collect()
}

fn zeros(bench: &TestFolder) -> usize {
    records(bench).iter().filter(|record| matches!(record, Record::Zero { .. })).count()
}

fn contacts(bench: &TestFolder) -> Vec<RecordedContact> {
    records(bench).iter().filter_map(|record| record.contact().cloned()).collect()
}

/// Content of the journal of a run that has ended or pauses; all of it must be sound.
fn records(bench: &TestFolder) -> Vec<Record> {
    let journal = Journal::records(&bench.path("run/journal.log")).expect("a journal");
    journal.map(|record| record.expect("a record").1).collect()
}
