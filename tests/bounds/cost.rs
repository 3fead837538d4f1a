//! What the program costs its users, counted and not timed: instructions, allocations, threads, and waits for a time.
//!
//! `cost.toml` has the expected counts. The counts of instructions are those of the wheel's program on one processor with AVX2, which
//! callgrind knows; another compiler may change them by some percent, and then they are written again. `tests/README.md` has the
//! commands.

mod allocations;
mod callgrind;
mod expected;
mod feed;
mod skins;
mod waits;

use callgrind::Run;
use expected::{Count, Table, check};
use feed::Feed;
use palpate_testing::TestFolder;
use palpate_testing::alone::processors;
use skins::{Sensor, State};
use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::thread;
use waits::SystemCalls;

/// Two runs differ by less than 0.5 %, because the keys of hash tables are random. A change of 5 % is never noise.
static INSTRUCTIONS: Table = Table { name: "instructions", of: "instructions", share: 0.05, least: 0.0, decimals: 0 };

static THREADS: Table = Table { name: "threads", of: "threads begun", share: 0.0, least: 0.0, decimals: 0 };
static WAITS: Table = Table { name: "waits", of: "waits for a time", share: 0.0, least: 0.0, decimals: 0 };

/// The paper's run with 25 presses and one staircase instead of 625 and nine.
const PAPER: &str = include_str!("cost/paper.toml");

/// A command whose instructions are counted.
struct Case {
    name: String,
    words: String,
    feed: Feed,
    /// Readings. If there are any, the count is that of each: those of the command with one reading for each connection are subtracted.
    lines: Vec<String>,
}

impl Case {
    fn new(name: &str, words: &str) -> Case {
        Case { name: name.to_owned(), words: words.to_owned(), feed: Feed::File, lines: Vec::new() }
    }

    /// The longest cases, which begin first.
    fn all(sensors: &[Sensor]) -> Vec<Case> {
        let mut cases = vec![
            Case::new("fit-best-64-units-98-presses", "fit half-64.csv --solver best --out fitted-64.palpate"),
            Case::new("fit-best-9-units-169-presses", "fit 9.csv --solver best --out fitted-9.palpate"),
            Case::new("run-paper-25-presses", "run paper.toml --out counted"),
            Case::new("report", "report run --out report.html"),
            Case::new("evaluate", "evaluate run"),
            Case::new("load-best-9-units", "solve --model best-9.palpate"),
            Case::new("load-pearson-192-units", "solve --model pearson-192.palpate"),
        ];
        for sensor in sensors.iter().rev() {
            let units = sensor.units;
            for state in State::ALL {
                cases.push(Case {
                    name: format!("solve-pearson-{units}-units-{}", state.name()),
                    words: format!("solve --model pearson-{units}.palpate --json --quiet"),
                    feed: Feed::File,
                    lines: sensor.lines(state),
                });
            }
        }
        let nine = || sensors[0].lines(State::Healthy);
        // one held contact: a search beside the answers would count as far as it has come at the end
        let held = || vec![nine()[0].clone(); nine().len()];
        let serve = "serve --model pearson-9.palpate --json --quiet --listen 127.0.0.1:0";
        let solve = "solve --model pearson-9.palpate --json --quiet";
        let best = Case::new("solve-best-9-units-healthy", "solve --model best-9.palpate --json --quiet");
        cases.push(Case { lines: nine(), ..best });
        let live = [
            ("solve-live-9-units", solve, Feed::Pipe),
            ("serve-1-connection", serve, Feed::Server { connections: 1 }),
            ("serve-8-connections", serve, Feed::Server { connections: 8 }),
        ];
        cases.extend(live.map(|(name, words, feed)| Case { feed, lines: held(), ..Case::new(name, words) }));
        let one = Case { feed: Feed::Pipe, lines: nine(), ..Case::new("solve-live-one-line", solve) };
        cases.push(Case { lines: one.lines[..1].to_vec(), ..one });
        cases
    }

    /// Counts on a processor.
    fn counted(&self, program: &Path, folder: &Path, processor: usize) -> Result<Count, String> {
        let Case { name, words, feed, lines } = self;
        let run = Run { program, words, folder, processor };
        let annotate = |name: &str| format!("callgrind_annotate {}", callgrind::file(name).display());
        let all = run.instructions(name, *feed, lines)?;
        let few = if let Feed::Server { connections } = feed { *connections } else { 1 };
        if lines.len() <= few {
            return Ok(Count { name: name.clone(), found: all, shown_by: annotate(name) });
        }
        let base = format!("{name}.base");
        let without = run.instructions(&base, *feed, &lines[..few])?;
        let found = (all - without) / (lines.len() - few) as f64;
        let shown_by = format!("{}\n  without most readings: {}", annotate(name), annotate(&base));
        Ok(Count { name: name.clone(), found, shown_by })
    }
}

#[test]
#[ignore = "needs valgrind and the release program: .ci/run runs it"]
fn commands_and_readings_take_as_many_instructions_as_expected() {
    let (program, sensors) = (program(), Sensor::all());
    let folder = prepared(&program, &sensors);
    std::fs::create_dir_all(callgrind::FOLDER).expect("a folder of the build");
    let mut cases = Case::all(&sensors);
    let order: Vec<String> = cases.iter().map(|case| case.name.clone()).collect();
    cases.reverse();
    let (cases, counted) = (Mutex::new(cases), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for processor in processors() {
            let (cases, counted, program, folder) = (&cases, &counted, &program, folder.path(""));
            scope.spawn(move || {
                let next = || cases.lock().expect("no panic").pop();
                while let Some(case) = next() {
                    let count = case.counted(program, &folder, processor);
                    counted.lock().expect("no panic").push((case.name, count));
                }
            });
        }
    });
    let mut counted = counted.into_inner().expect("no panic");
    counted.sort_by_key(|(name, _)| order.iter().position(|other| other == name));
    check([(&INSTRUCTIONS, counted.into_iter().map(|(_, count)| count).collect())]);
}

#[test]
#[ignore = "needs strace and the release program: .ci/run runs it"]
fn live_readings_begin_as_many_threads_and_wait_as_often_as_expected() {
    let (program, sensors) = (program(), Sensor::all());
    let folder = prepared(&program, &sensors);
    std::fs::create_dir_all(callgrind::FOLDER).expect("a folder of the build");
    let (mut threads, mut waits) = (Vec::new(), Vec::new());
    for sensor in &sensors {
        for state in State::ALL {
            let name = format!("solve-live-{}-units-{}", sensor.units, state.name());
            let words = format!("solve --model pearson-{}.palpate --json --quiet", sensor.units);
            let file = Path::new(callgrind::FOLDER).join(format!("{name}.strace"));
            let calls = SystemCalls::of(&program, &words, &folder.path(""), &sensor.lines(state), &file);
            let counted = |found: fn(&SystemCalls) -> usize| {
                let shown_by = format!("{} lists the calls; `strace -k` adds where each is from", file.display());
                let calls = calls.as_ref().map_err(|error| format!("{name}: {error}"))?;
                Ok(Count { name: name.clone(), found: found(calls) as f64, shown_by })
            };
            threads.push(counted(|calls| calls.threads));
            waits.push(counted(|calls| calls.waits));
        }
    }
    check([(&THREADS, threads), (&WAITS, waits)]);
}

/// The release program: that of `PALPATE_PROGRAM`, or the one next to this build.
fn program() -> PathBuf {
    let program = env::var_os("PALPATE_PROGRAM").map(PathBuf::from).unwrap_or_else(|| {
        let test = env::current_exe().expect("this test has a path");
        test.ancestors().nth(3).expect("a test is in a folder of the target folder").join("release/palpate")
    });
    let program = program.canonicalize().unwrap_or_else(|error| {
        panic!("{}: {error}. tests/README.md has the command that makes it", program.display())
    });
    println!("instructions of {}", program.display());
    program
}

/// A folder with tables, sensor files and a run, by the program itself.
fn prepared(program: &Path, sensors: &[Sensor]) -> TestFolder {
    let folder = TestFolder::with([("paper.toml", PAPER)]);
    let palpate = |words: &str| {
        let mut command = Command::new(program);
        command.args(words.split_whitespace()).current_dir(folder.path("")).stdin(Stdio::null());
        let output = command.env("XDG_STATE_HOME", folder.path("")).output().expect("the program starts");
        assert!(output.status.success(), "palpate {words}: {}", String::from_utf8_lossy(&output.stderr));
    };
    for sensor in sensors {
        folder.write(&format!("{}.csv", sensor.units), &sensor.table(1));
        palpate(&format!("fit {0}.csv --solver pearson --out pearson-{0}.palpate", sensor.units));
    }
    folder.write("half-64.csv", &sensors[1].table(2));
    palpate("fit 9.csv --solver best --out best-9.palpate");
    palpate("run paper.toml --out run");
    folder
}
