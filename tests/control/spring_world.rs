//! The program against an independent world in real time: a spring behind the process protocol with a known true force
//! (`examples/spring_world`), with one or two faults of devices, specimen or host in each run.
//!
//! ```sh
//! PALPATE_TESTS=full cargo test --test control spring_world::campaign -- --ignored --nocapture
//! PALPATE_WORLD="cell-slow:lag=1.2,at-press=3" PALPATE_WORLD_SEED=7 cargo test --test control spring_world::one -- --ignored --nocapture
//! ```
//!
//! The first command writes a line for each run to `target/tmp/spring_world.jsonl`, and fails if a bound is exceeded. A number in
//! `PALPATE_TESTS` makes that multiple, and `PALPATE_WORLD_SEED` is the first seed. The second command repeats one run, with a seed and a
//! fault that the first one printed; `PALPATE_WORLD_STIFFNESS` is the true stiffness as a fraction of the declared one, if it was printed.
#![cfg(unix)]

mod draw;
mod verdict;

use draw::{DrawKind, RandomDraw};
use palpate_testing::{campaign, program};
use std::env;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use verdict::{Verdict, WorldVerdictTable};

/// Runs: quick and full. Even the quick ones take a minute, so both are ignored by default.
const RUNS: (usize, usize) = (16, 300);

/// Runs at a time: they mostly wait.
const SIDE_BY_SIDE: usize = 8;

/// The first seed.
const SEED: u64 = 1;

#[test]
#[ignore = "runs in real time: 16 runs in a minute, or 300 with PALPATE_TESTS=full"]
fn campaign() {
    let world = SpringWorld::built();
    let kinds = world.kinds();
    let first = env::var("PALPATE_WORLD_SEED").ok().map_or(SEED, |seed| seed.parse().expect("a seed"));
    let (runs, next) = (campaign::size(RUNS.0, RUNS.1) as u64, AtomicU64::new(first));
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("spring_world.jsonl");
    let file = Mutex::new(File::create(&path).expect("a file"));
    let table = Mutex::new(WorldVerdictTable::default());
    thread::scope(|scope| {
        let work = || loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= first + runs {
                break;
            }
            let line = world.run(&RandomDraw::new(seed, &kinds), None);
            writeln!(file.lock().expect("a file"), "{line}").expect("a line can be written");
            table.lock().expect("a table").add(Verdict::of(&line));
        };
        (0..SIDE_BY_SIDE).for_each(|_| _ = scope.spawn(work));
    });
    let table = table.into_inner().expect("a table");
    println!("{table}\n{}", path.display());
    assert!(table.fallen() == 0, "{} runs broke a bound", table.fallen());
}

#[test]
#[ignore = "runs in real time what PALPATE_WORLD and PALPATE_WORLD_SEED say"]
fn one() {
    let number = |name: &str| env::var(name).ok().map(|text| text.parse::<f64>().expect("a number"));
    let draw = RandomDraw {
        seed: number("PALPATE_WORLD_SEED").unwrap_or(1.0) as u64,
        fault: env::var("PALPATE_WORLD").unwrap_or_else(|_| "none".to_owned()),
        stiffness: number("PALPATE_WORLD_STIFFNESS"),
    };
    let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join("spring_world_one");
    // the run folder must be new
    let _ = fs::remove_dir_all(&kept);
    let line = SpringWorld::built().run(&draw, Some(&kept));
    let verdict = Verdict::of(&line);
    println!("{line}\n{}\n{}", verdict.text(), kept.display());
    assert!(verdict.falls.is_empty(), "{}", verdict.text());
}

#[test]
fn a_verdict_names_each_bound_that_broke() {
    let line = |fault: &str, press: u32, k: f64, changed: &str| {
        let name = fault.split(':').next().expect("a name");
        let fired = format!("[{{\"name\": {name:?}, \"at_s\": 1.0, \"press\": {press}}}]");
        let clean = "\"own_mm\": 0.1, \"end_n\": 0.0, \"wrong_rows\": 0, \"worst_row_n\": 0.0";
        let said =
            format!("\"fault\": {fault:?}, \"world\": \"map k={k} k2=0.00\", \"words\": \"x\", \"fired\": {fired}");
        // the last value of a key counts
        format!("{{{said}, \"code\": \"4\", \"force_max_n\": 2.0, {clean}, {changed}}}")
    };
    for (fault, press, k, changed, expected) in [
        ("cell-slow", 3, 1.0, "\"force_max_n\": 2.49", ""),
        ("cell-slow", 3, 1.0, "\"force_max_n\": 2.51", "over"),
        ("cell-slow", 11, 1.0, "\"force_max_n\": 2.21", "over"),
        ("host-stop", 1, 1.0, "\"force_max_n\": 2.21", "over"),
        ("stage-drops", 1, 1.0, "\"force_max_n\": 2.30", ""),
        ("stage-drops", 1, 1.0, "\"force_max_n\": 2.32", "over"),
        ("specimen-jumps:mm=0.5", 1, 1.0, "\"force_max_n\": 2.62", ""),
        ("specimen-jumps:mm=0.5", 1, 1.0, "\"force_max_n\": 2.63", "over"),
        ("cell-gain", 11, 3.0, "\"force_max_n\": 9.0", ""),
        ("cell-gain", 11, 3.0, "\"force_max_n\": 2.1, \"code\": \"0\"", "unnoticed"),
        ("stage-dead", 1, 1.0, "\"end_n\": 0.1", "left"),
        ("stage-dead", 1, 1.0, "\"end_n\": 0.1, \"words\": \"the force that remains can't be known\"", ""),
        ("host-kill", 1, 1.0, "\"end_n\": 1.8", ""),
        ("cell-gain", 11, 1.0, "\"wrong_rows\": 1, \"code\": \"0\"", "silent"),
        ("stage-lost", 1, 1.0, "\"code\": \"hung\"", "ended"),
    ] {
        let falls = Verdict::of(&line(fault, press, k, changed)).falls;
        let expected: Vec<&str> = expected.split_whitespace().collect();
        let words: Vec<&str> = falls.iter().filter_map(|fall| fall.split([':', ' ']).next()).collect();
        assert_eq!(words, expected, "{fault} {changed}: {falls:?}");
    }
}

/// The program of the world.
struct SpringWorld {
    path: PathBuf,
}

impl SpringWorld {
    /// Builds the example, because `cargo test --test control` doesn't.
    fn built() -> SpringWorld {
        let folder = program().parent().expect("a folder").to_owned();
        let release = folder.ends_with("release");
        let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        cargo.args(["build", "--quiet", "--locked", "--example", "spring_world"]).args(release.then_some("--release"));
        let built = cargo.current_dir(env!("CARGO_MANIFEST_DIR")).status().expect("cargo starts");
        assert!(built.success(), "the example is built");
        SpringWorld { path: folder.join("examples/spring_world") }
    }

    /// The known faults, with each of their values.
    fn kinds(&self) -> Vec<DrawKind> {
        let output = Command::new(&self.path).arg("kinds").output().expect("the world starts");
        String::from_utf8(output.stdout).expect("a text").lines().flat_map(DrawKind::of_line).collect()
    }

    /// Makes a run; returns its line of JSON.
    fn run(&self, draw: &RandomDraw, keep: Option<&Path>) -> String {
        let mut command = Command::new(&self.path);
        command.arg("run").arg("--palpate").arg(program()).args(["--fault", &draw.fault]);
        command.args(["--seed", &draw.seed.to_string()]);
        if let Some(share) = draw.stiffness {
            command.args(["--stiffness", &share.to_string()]);
        }
        if let Some(folder) = keep {
            command.arg("--keep").arg(folder);
        }
        let output = command.output().expect("the world starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}: {said}", draw.fault);
        String::from_utf8(output.stdout).expect("a text").trim().to_owned()
    }
}
