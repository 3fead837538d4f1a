//! Failing disks: every call of a run or a resume that opens or changes a file fails in turn. The exit code reports it, and on a sound disk
//! the run is completed with all acknowledged presses.
//!
//! A library in C (`tests/outside/disk/failing.c`), loaded before the system's, catches the calls, so these tests need a C compiler (`cc`).
//! `PALPATE_TESTS=full` lets every call fail in four ways, `PALPATE_TESTS=3` in ten.
#![cfg(target_os = "linux")]

use palpate_testing::interrupted::{cut_to_lines, lines_before_contacts};
use palpate_testing::rows::{self, json, kept, numbered};
use palpate_testing::{CommandOutput, TestFolder, campaign, shared_library, shipped_text};
use rustix::process::geteuid;
use serde_json::Value;
use std::fs::{self, Permissions};
use std::os::unix::fs::{PermissionsExt, chown};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Place of the run below the failing folder: a new folder in a new folder.
const DISK: &str = "disk";
const RUN: &str = "disk/new/run";

/// 1 staircase, 2 points.
const RECIPE: &str = r#"
name = "short"

[[step]]
phase = "characterisation"
units = [5]
staircase = { to_n = 1.0, step_n = 1.0 }

[[step]]
phase = "calibration"
grid = { x_mm = [-1.0, 1.0], y_mm = [0.0, 0.0], spacing_mm = 2.0 }
force_n = 1.0
"#;
const PLAN: [(u64, u64); 5] = [(0, 0), (0, 1), (0, 2), (1, 0), (2, 0)];

/// Exit codes: complete; bad input, nothing moved; the record couldn't be written.
const DONE: i32 = 0;
const USAGE: i32 = 2;
const RECORD: i32 = 5;

/// Errors of disks, as Linux numbers them.
const EIO: i32 = 5;
const EACCES: i32 = 13;
const ENOSPC: i32 = 28;
const EROFS: i32 = 30;
const EDQUOT: i32 = 122;

/// Ways to fail: one call; half a write and the next call; half a write and the next two calls, so that the half can't be removed either;
/// every call from one on.
const FAILURES: [(&str, i32); 4] = [("once", ENOSPC), ("short", ENOSPC), ("torn", ENOSPC), ("from", EIO)];
const MORE_FAILURES: [(&str, i32); 6] =
    [("once", EIO), ("once", EACCES), ("short", EDQUOT), ("from", ENOSPC), ("from", EROFS), ("from", EDQUOT)];

/// One in so many calls fails: quick and full.
const EVERY: (usize, usize) = (11, 1);

/// Number of calls after which a session doesn't end any more: a sound one has some hundred.
const CALLS_MOST: usize = 2000;

/// The calls that write and flush a record.
const WRITE: &str = "write journal.log";
const FLUSH: &str = "fdatasync journal.log";

/// A batch of one sensor.
const BATCH: &str =
    "name = \"day\"\ndesign = \"skin\"\nrig = \"rig.toml\"\nrecipes = [\"r.toml\"]\nserials = [\"A-01\"]\n";

/// Calls whose failure changes nothing, with their file, and why: such a run may succeed if it is complete.
const HARMLESS: [(&str, &str); 0] = [];

/// Files of a run that `resume` reads before it moves anything, as `run` reads the user's: an unreadable one is bad input.
const INPUTS: [&str; 2] = ["recipe.toml", "rig.toml"];

#[test]
#[ignore = "needs a C compiler: cc"]
fn every_failing_call_of_a_run_is_reported_without_loss() {
    let words = format!("run r.toml --rig rig.toml --json --out {RUN}");
    assert_every_call_may_fail("every call of a run", &DiskStart { words, ..DiskStart::default() });
}

#[test]
#[ignore = "needs a C compiler: cc"]
fn every_failing_call_of_a_resume_is_reported_without_loss() {
    assert_every_call_may_fail("every call of a resume", &half_done());
}

/// Unflushed data survive the end of the program, but not a power cut.
#[test]
#[ignore = "needs a C compiler: cc"]
fn each_record_and_new_folder_is_flushed_before_the_next() {
    let (shelf, presses) = (TestFolder::new(), PLAN[PLAN.len() - 1].0 as usize + 1);
    let library = library(&shelf);
    let run =
        calls(&library, &DiskStart { words: format!("run r.toml --rig rig.toml --out {RUN}"), ..DiskStart::default() });
    assert_flushed("a run", &run, presses);
    // the draft of the run's folder, the folder in which it appears, and the folder of that one
    for folder in [".short.", "new", "disk"] {
        let is_flush = |call: &String| call.starts_with(&format!("fsync {folder}"));
        assert!(run.iter().any(is_flush), "{folder} isn't flushed: {run:?}");
    }
    assert_flushed("a resume", &calls(&library, &half_done()), presses - 1);
    let bench = TestFolder::with([("b.toml", BATCH), ("r.toml", RECIPE), ("rig.toml", &shipped_text("rigs/sim.toml"))]);
    bench.palpate_ends(DONE, "batch run b.toml --out day");
    let journal = fs::read(bench.path("day/journal.log")).expect("a journal");
    let (words, files) = (format!("batch note {RUN} A-01 scratched"), vec![("journal.log".to_owned(), journal)]);
    assert_flushed("a note in a batch", &calls(&library, &DiskStart { words, files, ..DiskStart::default() }), 1);
}

/// Each record of a session is flushed, and there are at least so many.
fn assert_flushed(session: &str, calls: &[String], least: usize) {
    let journal: Vec<&str> = calls.iter().map(String::as_str).filter(|call| [WRITE, FLUSH].contains(call)).collect();
    let writes = journal.iter().filter(|call| **call == WRITE).count();
    assert!(writes >= least, "{session}: {writes} records in {calls:?}");
    let next = |at: usize| journal.get(at + 1).copied();
    let is_flushed = |(at, call): (usize, &&str)| *call == FLUSH || next(at) == Some(FLUSH);
    assert!(journal.iter().enumerate().all(is_flushed), "{session}: a record isn't flushed: {journal:?}");
}

#[test]
fn read_only_folder_is_reported_and_not_changed() {
    let bench = bench(&half_done());
    let locked = |path: &str, mode: u32| {
        fs::set_permissions(bench.path(path), Permissions::from_mode(mode)).expect("permissions can be set");
    };
    locked(RUN, 0o555);
    let before = bench.bytes(RUN);
    let refused = |words: &str| {
        let output = ends_without_privileges(&bench, RECORD, words);
        assert!(output.running().contains("Permission denied"), "{}", output.err);
        assert_eq!(output.out, "", "nothing is acknowledged");
    };
    refused(&format!("resume {RUN} --json"));
    assert!(bench.bytes(RUN) == before, "the run folder is as it was");
    locked(RUN, 0o755);
    // a read-only journal in a writable folder
    let journal = format!("{RUN}/journal.log");
    locked(&journal, 0o444);
    refused(&format!("resume {RUN} --json"));
    assert_eq!(names(&bench, RUN), before.into_iter().map(|(name, _)| name).collect::<Vec<_>>());
    locked(&journal, 0o644);
    ends_without_privileges(&bench, DONE, &format!("resume {RUN}"));
    assert_eq!(numbered(&rows::table(&bench, RUN)), PLAN);
    // a folder in which none can be created
    locked(DISK, 0o555);
    refused(&format!("run r.toml --rig rig.toml --json --out {DISK}/other"));
    assert!(!bench.has("disk/other"));
    locked(DISK, 0o755);
    ends_without_privileges(&bench, DONE, &format!("run r.toml --rig rig.toml --out {DISK}/other"));
}

/// The user and the group that own nothing, on every Linux.
const NOBODY: u32 = 65534;

/// Runs the program as a user with restricted rights: as this user, or if that is root, as nobody, who then owns the folder and a copy of
/// the program there.
fn ends_without_privileges(bench: &TestFolder, code: i32, words: &str) -> CommandOutput {
    let mut command = bench.command(words);
    if geteuid().is_root() {
        let program = bench.path("palpate");
        if !program.exists() {
            fs::copy(command.get_program(), &program).expect("the program can be copied");
        }
        hand_over(&bench.path(""));
        let mut others = Command::new(program);
        others.args(command.get_args()).current_dir(bench.path("")).uid(NOBODY).gid(NOBODY);
        others.envs(command.get_envs().filter_map(|(name, value)| Some((name, value?))));
        command = others;
    }
    let printed: CommandOutput = command.output().expect("the program starts").into();
    assert_eq!(printed.code, Some(code), "palpate {words}\n{}\n{}", printed.out, printed.err);
    printed
}

/// Makes nobody the owner of a folder and its content.
fn hand_over(path: &Path) {
    chown(path, Some(NOBODY), Some(NOBODY)).expect("root may give away what it has");
    if path.is_dir() {
        fs::read_dir(path).expect("a folder").for_each(|entry| hand_over(&entry.expect("an entry").path()));
    }
}

/// Begin of a session: the command line, the existing files, and the acknowledged presses.
#[derive(Default)]
struct DiskStart {
    words: String,
    files: Vec<(String, Vec<u8>)>,
    rows: Vec<Value>,
}

/// A run that a power cut ended after its staircase.
fn half_done() -> DiskStart {
    let bench = whole();
    let rows = rows::table(&bench, RUN).into_iter().filter(|row| row["press"] == 0).collect();
    cut_to_lines(&bench, RUN, lines_before_contacts(&bench, RUN) + 1);
    DiskStart { words: format!("resume {RUN} --json"), files: bench.bytes(RUN), rows }
}

/// A run in which nothing fails.
fn whole() -> TestFolder {
    let bench = bench(&DiskStart::default());
    bench.palpate_ends(DONE, &format!("run r.toml --rig rig.toml --out {RUN}"));
    bench
}

/// The names in a folder.
fn names(bench: &TestFolder, folder: &str) -> Vec<String> {
    let entries = fs::read_dir(bench.path(folder)).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn bench(start: &DiskStart) -> TestFolder {
    let bench = TestFolder::with([("r.toml", RECIPE), ("rig.toml", &shipped_text("rigs/sim.toml"))]);
    fs::create_dir(bench.path(DISK)).expect("a folder");
    if !start.files.is_empty() {
        fs::create_dir_all(bench.path(RUN)).expect("a folder");
    }
    for (name, bytes) in &start.files {
        fs::write(bench.path(RUN).join(name), bytes).expect("a file can be written");
    }
    bench
}

fn assert_every_call_may_fail(test: &str, start: &DiskStart) {
    let shelf = TestFolder::new();
    let library = library(&shelf);
    let (every, ways) = (campaign::every(EVERY.0, EVERY.1), campaign::size(FAILURES.len(), FAILURES.len()));
    let files = names(&whole(), RUN);
    let (mut failed, mut violations) = (0, Vec::new());
    for (mode, errno) in FAILURES.iter().chain(&MORE_FAILURES).take(ways) {
        let first = failed;
        for call in (1..).step_by(every) {
            assert!(call < CALLS_MOST, "{test}: it doesn't end");
            let Some((name, output, bench)) = fail(&library, start, mode, *errno, call) else { break };
            let judged = judge(&bench, start, &output, &name).and_then(|()| tidy(&bench, &files, mode));
            failed += 1;
            let output = |problem: String| format!("{mode} {errno}, call {call} ({name}): {problem}");
            violations.extend(judged.err().map(output));
        }
        assert!(failed > first, "{test}: no call failed, {mode}: is the library loaded?");
    }
    println!("{test}: {failed} failures");
    assert!(violations.is_empty(), "{test}: {} of {failed}:\n{}", violations.len(), violations.join("\n"));
}

/// One session with a failing call: the call with its file, the output, and the remaining files; none if the session has no such call.
fn fail(
    library: &Path,
    start: &DiskStart,
    mode: &str,
    errno: i32,
    call: usize,
) -> Option<(String, CommandOutput, TestFolder)> {
    let (calls, output, bench) = session(library, start, mode, errno, call);
    Some((calls.into_iter().next()?, output, bench))
}

/// The calls of a session without failures.
fn calls(library: &Path, start: &DiskStart) -> Vec<String> {
    let (calls, output, _) = session(library, start, "look", 0, 0);
    assert_eq!(output.code, Some(DONE), "{}", output.err);
    calls
}

/// One session with the library: the recorded calls with their files, the output, and the remaining files.
fn session(
    library: &Path,
    start: &DiskStart,
    mode: &str,
    errno: i32,
    call: usize,
) -> (Vec<String>, CommandOutput, TestFolder) {
    let bench = bench(start);
    let log = bench.path("failed.log");
    let mut command = bench.command(&start.words);
    command.env("LD_PRELOAD", library).env("FAILING_BELOW", bench.path(DISK).canonicalize().expect("a folder"));
    command.env("FAILING_CALL", call.to_string()).env("FAILING_ERRNO", errno.to_string());
    command.env("FAILING_MODE", mode).env("FAILING_LOG", &log);
    let printed = command.output().expect("the program starts").into();
    let noted = |line: &str| {
        let (name, path) = line.rsplit_once(' ').expect("a call and its path");
        // the folders above belong to the test
        format!("{name} {}", Path::new(path).file_name().unwrap_or_default().to_string_lossy())
    };
    // there is none if no call was recorded
    let calls = fs::read_to_string(log).unwrap_or_default().lines().map(noted).collect();
    (calls, printed, bench)
}

/// Whether a session with a failing call reported it correctly, and can be continued.
fn judge(bench: &TestFolder, start: &DiskStart, output: &CommandOutput, name: &str) -> Result<(), String> {
    let CommandOutput { code, out, err } = output;
    ensure(!err.contains("panicked"), || format!("it panicked: {err}"))?;
    ensure(!err.contains("could not be parked"), || format!("the stage wasn't parked: {err}"))?;
    let there = bench.has(RUN);
    ensure(there || out.is_empty(), || "rows were acknowledged and there is no folder".to_owned())?;
    let is_complete = there && bench.manifest(RUN)["status"] == "complete";
    let harmless = HARMLESS.iter().any(|(harmless, _)| *harmless == name);
    let input = start.words.starts_with("resume") && INPUTS.iter().any(|input| name == format!("open {input}"));
    let fits = match *code {
        Some(RECORD) => true,
        Some(USAGE) => input,
        Some(DONE) => harmless && is_complete,
        _ => false,
    };
    let acknowledged: Vec<Value> = start.rows.iter().cloned().chain(out.lines().map(json)).collect();
    // the disk is sound again
    let words = if there { format!("resume {RUN} --json") } else { start.words.clone() };
    let after = bench.palpate(&words);
    let ended = || format!("afterwards `{words}` ends with {:?}: {}", after.code, after.running());
    ensure(after.code == Some(DONE), ended)?;
    let table = rows::table(bench, RUN);
    ensure(numbered(&table) == PLAN, || format!("the final table is {:?}", numbered(&table)))?;
    let all: Vec<Value> = acknowledged.into_iter().chain(after.out.lines().map(json)).collect();
    let kept = kept(&all, &table);
    ensure(kept.first.is_none(), || format!("{kept:?}"))?;
    let manifest = bench.manifest(RUN);
    ensure(manifest["status"] == "complete", || format!("the manifest says {}", manifest["status"]))?;
    // the output is checked last, because losses matter more
    ensure(fits, || format!("exit code {code:?}: {}", output.running()))?;
    ensure(is_complete || !err.contains("complete: "), || "it says `complete`, which the manifest doesn't".to_owned())?;
    ensure(!err.contains("restore the journal"), || "it says that a sound journal is damaged".to_owned())
}

/// Whether no unexpected file is left. If the next calls fail too, nothing can be removed.
fn tidy(bench: &TestFolder, files: &[String], mode: &str) -> Result<(), String> {
    let (inside, beside) = (names(bench, RUN), names(bench, "disk/new"));
    ensure(inside == files, || format!("in the run's folder are {inside:?}"))?;
    ensure(matches!(mode, "from" | "torn") || beside == ["run"], || format!("beside the run are {beside:?}"))
}

fn ensure(holds: bool, output: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(output()) }
}

/// The library that makes calls fail.
fn library(shelf: &TestFolder) -> PathBuf {
    shared_library(shelf, "failing.so", "tests/outside/disk/failing.c", &["-ldl"])
}
