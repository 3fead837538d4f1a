//! Every file that comes from outside, fed with real ones that were mutated: none upsets the program, none takes more memory
//! or time than it is worth, and what is wrong with it is told with its place.
//!
//! Few inputs by default; `PALPATE_FUZZ_FILES=1000000 cargo test --release --test fuzz_files recipes -- --nocapture` for so
//! many of one target.

#[path = "support/mutation.rs"]
mod mutation;

use cap::Cap;
use cpu_time::ThreadTime;
use mutation::{TEXT_MOST, rewritten};
use palpate::dataset::readings::{Format, ReadingError, Readings};
use palpate::dataset::table::{Table, TableError};
use palpate::dataset::{Journal, Manifest, Origins, RunFolder};
use palpate::document::Problems;
use palpate::quantity::{Axis, Stream, stream};
use palpate::recipe::{self, PRESSES_MAX, Plan};
use palpate::rig::{self, RigSpec, SIM_RIG};
use palpate::run::{Cancel, Errand, Listener, walk};
use rand::RngExt;
use std::alloc::System;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant as Wall;

#[global_allocator]
static HEAP: Cap<System> = Cap::new(System, usize::MAX);

/// Most that the process may ever hold, bytes: the targets beside each other, each with the plan of 100,000 presses.
const EVER_HELD_MOST: usize = 192 << 20;

/// Longest that one input may take of the processor, s: that plan, some times over.
const INPUT_S_MOST: f64 = if cfg!(debug_assertions) { 20.0 } else { 2.0 };

/// After how many inputs it is told how far it has come.
const PROGRESS: usize = 100_000;

/// Presses that teach at most.
const TEACHES: usize = 5;

/// How many problems of an input are drawn as a person sees them, and how much each may take, bytes: its lines, twice over.
const DRAWN: usize = 2;
const DRAWN_MOST: usize = TEXT_MOST + (64 << 10);

/// A name of a file in messages, that no mutation writes.
const FILE: &str = "outside";

/// A small run, whose files are what is mutated.
const SMALL: &str = "name = \"small\"\n[[step]]\nphase = \"characterisation\"\nunits = [5]\n\
                     staircase = { to_n = 1.0, step_n = 1.0, repeats = 1 }\n[[step]]\nphase = \"test\"\n\
                     random = { count = 2, x_mm = [-2, 2], y_mm = [-2, 2], force_n = [0.5, 1] }\n";

#[test]
fn recipes() {
    let (spec, seeds) = (sim_rig(), texts_in("recipes", "toml"));
    fuzz("recipes", 1000, &seeds, |input| {
        let text = String::from_utf8_lossy(input);
        match recipe::parse(FILE, &text).and_then(|recipe| Plan::new(&recipe, &spec.ground(), 1)) {
            Ok(plan) => check_plan(&plan, &spec),
            Err(problems) => check_problems(problems, &text),
        }
    });
}

#[test]
fn rigs() {
    let seeds = texts_in("rigs", "toml");
    let map = fs::read_to_string(root().join("profiles/generic-rs485.toml")).expect("a shipped map");
    fuzz("rigs", 1000, &seeds, |input| {
        let text = String::from_utf8_lossy(input);
        match rig::parse(FILE, &text, &|_| Ok(map.clone())) {
            Ok(spec) => _ = spec.simulated().emulators(1).is_ok(),
            Err(problems) => check_problems(problems, &text),
        }
    });
}

#[test]
fn register_maps() {
    let seeds = texts_in("profiles", "toml");
    let rig = SIM_RIG.replace("generic-rs485", "own.toml");
    fuzz("register maps", 1000, &seeds, |input| {
        let text = String::from_utf8_lossy(input);
        if let Err(problems) = rig::parse(FILE, &rig, &|_| Ok(text.to_string())) {
            check_problems(problems, &rig);
        }
        if let Err(problems) = palpate::driver::modbus::Profile::parse(FILE, &text) {
            check_problems(problems, &text);
        }
    });
}

#[test]
fn tables() {
    let plain = b"x_mm,y_mm,out_1,out_2,flags\n0,0,0.1,0.2,\n1,-1,0.3,0.4,0\n2.5,1e-3,-0.3,4,stale\n".to_vec();
    let seeds = [plain, run().presses.clone()];
    fuzz_file("tables", 10_000, &seeds, rewritten, |path, input| check_table(Table::read(path), path, input));
}

#[test]
fn presses() {
    let seeds = [run().presses.clone()];
    fuzz_file("presses", 4000, &seeds, rewritten, |path, input| check_table(Table::read_run(path), path, input));
}

#[test]
fn readings() {
    let seeds: Vec<Vec<u8>> = [
        "out_1,out_2\n0.1,0.2\n0.3,nan\n",
        "0.1,0.2\n0.3,0.4\n",
        "id,t_s,out_2,out_1,x\n7,0.5,1,2,\"a,b\"\n\n8,0.6,3,4,\n",
        "{\"outputs\": [0.1, 0.2], \"id\": \"a\", \"t_s\": 1.5}\n[0.1, null]\n",
    ]
    .iter()
    .map(|text| text.as_bytes().to_vec())
    .collect();
    let mut nth = 0;
    fuzz("readings", 40_000, &seeds, |input| {
        nth += 1;
        let format = [None, Some(Format::Csv), Some(Format::Ndjson)][nth % 3];
        let mut readings = Readings::new(FILE, input, 2, format);
        let lines = lines(input);
        for nth_reading in 0..=lines {
            match readings.read_next() {
                Ok(Some(reading)) => {
                    assert!(reading.outputs.len() == 2 && (1..=lines as u64).contains(&reading.line), "{reading:?}");
                }
                Ok(None) => return,
                Err(ReadingError::Cells(TableError::NoRows { .. })) if nth_reading == 0 => return,
                Err(ReadingError::Cells(TableError::TooLarge { .. })) => return,
                Err(error) => return check_line(&error.to_string(), FILE, input),
            }
        }
        panic!("more readings than {lines} lines");
    });
}

#[test]
fn journals() {
    fuzz_file("journals", 1500, std::slice::from_ref(&run().journal), resealed, |path, input| {
        let most = lines(input) + 1;
        let sound = Journal::records(path).expect("a file").take_while(Result::is_ok).count();
        assert!(sound <= most, "{sound} records of {most} lines");
        let damaged = Journal::records(path).expect("a file").take(most).find_map(Result::err);
        let mut taken = 0;
        let opened = Journal::open(path, |_, _| {
            taken += 1;
            Ok(())
        });
        assert_eq!(taken, sound);
        match opened {
            Ok(_) => {
                assert!(damaged.is_none(), "it was opened, and is damaged: {damaged:?}");
                let again = Journal::records(path).expect("a file").filter(Result::is_ok).count();
                assert_eq!(again, sound, "records after its torn tail was cut off");
            }
            Err(error) => {
                let told = error.to_string();
                assert!(told.starts_with(&path.display().to_string()) && told.contains("at byte "), "{told}");
                assert_eq!(fs::read(path).expect("a file"), input, "a damaged journal was touched");
            }
        }
    });
}

#[test]
fn manifests() {
    let seeds = [run().manifest.clone()];
    fuzz("manifests", 20_000, &seeds, |input| {
        let Ok(manifest) = serde_json::from_str::<Manifest>(&String::from_utf8_lossy(input)) else { return };
        let text = serde_json::to_string(&manifest).expect("text and numbers");
        assert_eq!(serde_json::from_str::<Manifest>(&text).expect("what was written"), manifest);
    });
}

// ---- what is asked of an answer ------------------------------------------------------------------------------------

/// No plan is longer than it may be, or leaves what the rig allows.
fn check_plan(plan: &Plan, spec: &RigSpec) {
    let entries = &plan.entries;
    assert!(!entries.is_empty() && entries.len() <= PRESSES_MAX + TEACHES, "{} entries", entries.len());
    for entry in entries {
        let position = spec.frame.to_stage(entry.place, 0.0);
        let within =
            [Axis::X, Axis::Y].into_iter().all(|axis| spec.stage.travel.along(axis).contains(position.along(axis)));
        assert!(within && entry.task.most_n() <= spec.limits.force_n && !entry.task.levels.is_empty(), "{entry:?}");
        assert!(entry.rest_after_s >= 0.0 && (entry.press as usize) < entries.len(), "{entry:?}");
    }
}

/// Each problem is one line, without anything that a terminal would act on, at a place within the text.
fn check_problems(problems: Problems, text: &str) {
    let told = problems.lines();
    assert!(!told.is_empty(), "refused without a reason");
    let mut widths: Vec<usize> = text.split('\n').map(|line| line.chars().count()).collect();
    if text.is_empty() || text.len() > palpate::document::TEXT_MAX_BYTES {
        widths = vec![0];
    }
    for line in &told {
        let mut parts = line.splitn(4, ':');
        let mut part = || parts.next().unwrap_or_default();
        assert_eq!(part(), FILE, "{line}");
        let (at, column): (usize, usize) = (part().parse().unwrap_or(0), part().parse().unwrap_or(0));
        let width = widths.get(at.wrapping_sub(1)).copied();
        assert!(width.is_some_and(|width| (1..=width + 1).contains(&column)), "no such place: {line}");
        let message = part();
        assert!(message.len() > 1, "{line}");
        assert!(!message.chars().any(char::is_control), "control characters in {line:?}");
    }
    let drawn: usize = problems.into_reports().take(DRAWN).map(|report| format!("{report:?}").len()).sum();
    assert!(drawn < DRAWN * DRAWN_MOST, "{drawn} bytes are drawn");
}

fn check_table(table: Result<Table, TableError>, path: &Path, input: &[u8]) {
    match table {
        Ok(table) => {
            assert!(!table.rows.is_empty() && table.rows.len() <= lines(input));
            let sound =
                |outputs: &[f64]| outputs.len() == table.units && outputs.iter().all(|output| output.is_finite());
            assert!(table.rows.iter().all(|row| sound(&row.outputs) && row.place.x_mm.is_finite()));
        }
        Err(error @ (TableError::TooLarge { .. } | TableError::NoRows { .. })) => {
            assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
        }
        Err(error) => check_line(&error.to_string(), &path.display().to_string(), input),
    }
}

/// A message that names a file and a line of it.
fn check_line(told: &str, file: &str, input: &[u8]) {
    let line = told.strip_prefix(file).and_then(|rest| rest.strip_prefix(", line "));
    let line = line.and_then(|rest| rest.split([',', ':']).next()).and_then(|line| line.parse::<usize>().ok());
    assert!(line.is_some_and(|line| (1..=lines(input)).contains(&line)), "{told:?} of {} lines", lines(input));
}

/// How many lines there can be, whatever ends them.
fn lines(input: &[u8]) -> usize {
    1 + input.iter().filter(|&&byte| byte == b'\n' || byte == b'\r').count()
}

// ---- feeding -------------------------------------------------------------------------------------------------------

/// Feeds a reader, and says how much, how fast, and what took longest.
fn fuzz(name: &str, inputs: usize, seeds: &[Vec<u8>], read: impl FnMut(&[u8])) {
    fuzz_with(name, inputs, seeds, rewritten, read);
}

/// The same with a reader of a file.
fn fuzz_file(
    name: &str,
    inputs: usize,
    seeds: &[Vec<u8>],
    mutate: fn(&[Vec<u8>], &mut Stream, &mut Vec<u8>),
    mut read: impl FnMut(&Path, &[u8]),
) {
    let home = tempfile::tempdir().expect("a folder");
    let path = home.path().join(FILE);
    fuzz_with(name, inputs, seeds, mutate, |input| {
        let _ = fs::remove_file(&path); // a new file is written faster than one that is cut off first
        fs::write(&path, input).expect("a file");
        read(&path, input);
    });
}

fn fuzz_with(
    name: &str,
    inputs: usize,
    seeds: &[Vec<u8>],
    mutate: fn(&[Vec<u8>], &mut Stream, &mut Vec<u8>),
    mut read: impl FnMut(&[u8]),
) {
    let asked = std::env::var("PALPATE_FUZZ_FILES").ok().and_then(|inputs| inputs.parse().ok());
    let inputs = asked.unwrap_or(if cfg!(debug_assertions) { inputs / 20 } else { inputs });
    let (mut rng, mut input, mut longest_s) = (stream(1, 0, name), Vec::new(), 0.0f64);
    let began = Wall::now();
    for n in 0..inputs {
        if n > 0 && n.is_multiple_of(PROGRESS) {
            println!("{name}: {n} inputs so far, the longest {longest_s:.3} s, {} bytes", HEAP.max_allocated());
        }
        mutate(seeds, &mut rng, &mut input);
        let started = ThreadTime::now();
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| read(&input)));
        let took_s = started.elapsed().as_secs_f64();
        longest_s = longest_s.max(took_s);
        let wrong = match done {
            Err(_) => "it panicked".to_owned(),
            Ok(()) if took_s > INPUT_S_MOST => format!("it took {took_s:.1} s"),
            Ok(()) if HEAP.max_allocated() > EVER_HELD_MOST => format!("it held {} bytes", HEAP.max_allocated()),
            Ok(()) => continue,
        };
        panic!("{name}: input {n}: {wrong}:\n{}", excerpt(&input));
    }
    let (took_s, held) = (began.elapsed().as_secs_f64(), HEAP.max_allocated());
    let rate = inputs as f64 / took_s;
    println!(
        "{name}: {inputs} inputs in {took_s:.1} s, {rate:.0} a second, the longest {longest_s:.3} s, {held} bytes"
    );
}

/// As much of an input as a person looks at.
fn excerpt(input: &[u8]) -> String {
    let text = String::from_utf8_lossy(input);
    let shown: String = text.chars().take(4000).collect();
    if shown.len() < text.len() { format!("{shown}... ({} bytes)", input.len()) } else { shown }
}

/// A journal after some mutations, the check sums and the numbers of most of its lines put right: what has none gets no
/// further.
fn resealed(seeds: &[Vec<u8>], rng: &mut Stream, into: &mut Vec<u8>) {
    rewritten(seeds, rng, into);
    if rng.random_bool(0.2) {
        return;
    }
    let renumbers = rng.random_bool(0.7);
    let mut sealed = Vec::with_capacity(into.len());
    let mut sequence = 0u64;
    for line in into.split_inclusive(|&byte| byte == b'\n') {
        let text = String::from_utf8_lossy(line);
        let mut parts = text.trim_end_matches('\n').splitn(3, ' ');
        let (Some(number), Some(_), Some(json)) = (parts.next(), parts.next(), parts.next()) else {
            sealed.extend_from_slice(line);
            continue;
        };
        let number = if renumbers { sequence } else { number.parse().unwrap_or(sequence) };
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&number.to_le_bytes());
        hasher.update(json.as_bytes());
        let mut line = String::new();
        let _ = writeln!(line, "{number} {:08x} {json}", hasher.finalize());
        sealed.extend_from_slice(line.as_bytes());
        sequence += 1;
    }
    *into = sealed;
}

// ---- what is mutated -----------------------------------------------------------------------------------------------

/// The files of a run.
struct Run {
    journal: Vec<u8>,
    presses: Vec<u8>,
    manifest: Vec<u8>,
}

/// A small run as it stands on the disk.
fn run() -> &'static Run {
    static RUN: OnceLock<Run> = OnceLock::new();
    RUN.get_or_init(|| {
        let spec = sim_rig();
        let home = tempfile::tempdir().expect("a folder");
        let recipe = recipe::parse("small.toml", SMALL).expect("a recipe");
        let plan = Plan::new(&recipe, &spec.ground(), 1).expect("a plan");
        let origins = Origins { recipe: SMALL.to_owned(), rig: SIM_RIG.to_owned(), maps: Vec::new() };
        let (manifest, path) = (Manifest::new(&plan, true, None, String::new()), home.path().join("run"));
        let mut folder = RunFolder::create(Some(&path), &origins, manifest, &spec.array.layout).expect("a run");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
        let ending = runtime.expect("a runtime").block_on(async {
            let cancel = Cancel::default();
            let errand = Errand { plan: &plan, spec: &spec, ledger: &mut folder, cancel: &cancel, shown: &|_| {} };
            walk(errand, &mut Unheard).await
        });
        folder.finish(ending.status()).expect("a run that ends");
        let [journal, presses, manifest] =
            ["journal.log", "presses.csv", "manifest.json"].map(|name| fs::read(path.join(name)).expect(name));
        Run { journal, presses, manifest }
    })
}

struct Unheard;

impl Listener for Unheard {}

fn sim_rig() -> RigSpec {
    rig::parse("sim.toml", SIM_RIG, &|_| unreachable!("no map of its own")).expect("the shipped rig")
}

/// All texts of a kind in one of the project's folders, in the order of their names.
fn texts_in(folder: &str, extension: &str) -> Vec<Vec<u8>> {
    let entries = fs::read_dir(root().join(folder)).expect("a folder of the project");
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a file").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|own| own == extension));
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("a text")).collect()
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}
