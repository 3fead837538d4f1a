//! What the record costs: a hundred thousand presses of nine units written to a run folder, flushed to the disk one by one and
//! not, then read again.
//!
//! `cargo bench --bench journal`. The disk is the one that holds the system's temporary folder.
#![allow(clippy::print_stdout, reason = "it prints its results")]

use cpu_time::ProcessTime;
use palpate_control::{LearnedContact, NoLoadReadings};
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_data::dataset::{
    Durability, Ledger, Left, NoLoad, Origins, Press, PressTruth, Provenance, Record, RecordedContact, RunFacts,
    RunFolder,
};
use palpate_data::recipe::Phase;
use std::path::Path;
use std::time::{Duration, Instant};

const PRESSES: u64 = 100_000;
/// With a flush each, fewer are enough to know what one costs.
const FLUSHED: u64 = 5_000;
const UNITS: usize = 9;

fn main() {
    let home = tempfile::tempdir().expect("a folder");
    let layout = ArrayLayout::grid(3, 3, 4.5);
    for (durability, presses) in [(Durability::Full, FLUSHED), (Durability::Fast, PRESSES)] {
        let path = home.path().join(format!("{durability:?}"));
        let (wall, cpu) = written(&path, &layout, durability, presses);
        println!(
            "{durability:?}: {presses} presses written in {:.2} s, {:.3} ms CPU and {:.3} ms a press",
            wall.as_secs_f64(),
            cpu.as_secs_f64() * 1e3 / presses as f64,
            wall.as_secs_f64() * 1e3 / presses as f64
        );
    }
    let path = home.path().join("Fast");
    let began = Instant::now();
    let folder = RunFolder::open(&path, &layout).expect("the run");
    let opened = began.elapsed();
    let rows: usize =
        folder.contacts().expect("contacts").map(|contact| contact.expect("a contact").levels.len()).sum();
    println!("opened in {:.2} s, all {rows} rows read in {:.2} s", opened.as_secs_f64(), began.elapsed().as_secs_f64());
    let journal = std::fs::metadata(path.join("journal.log")).expect("the journal").len();
    println!("{:.0} MB of journal; peak memory {}", journal as f64 / 1e6, peak_memory());
}

/// Wall and processor time of recording so many presses.
fn written(path: &Path, layout: &ArrayLayout, durability: Durability, presses: u64) -> (Duration, Duration) {
    let facts = RunFacts { recipe: "journal".to_owned(), presses_planned: presses, ..RunFacts::default() };
    let session = Provenance { durability, ..Provenance::default() };
    let origins = Origins::new(String::new(), String::new(), Vec::new());
    let mut folder = RunFolder::create(Some(path), &origins, facts, session, layout).expect("a run folder");
    let (began, cpu_began) = (Instant::now(), ProcessTime::now());
    for press in 0..presses {
        folder.record(&Record::Contact(contact(press))).expect("a record");
    }
    (began.elapsed(), cpu_began.elapsed())
}

/// A press as a guarded one leaves it, with as many digits.
fn contact(press: u64) -> RecordedContact {
    let wave = |n: u64| (press * 7 + n * 13) as f64 * 1e-3 % 1.0 + 0.123_456_789;
    let row = Press {
        press,
        level: 0,
        phase: Some(Phase::Calibration),
        x_mm: -5.5,
        y_mm: 6.0,
        force_set_n: Some(1.0),
        force_n: Some(wave(1)),
        depth_mm: Some(wave(2)),
        t_s: Some(1.137 * press as f64),
        outputs: (0..UNITS as u64).map(wave).collect(),
        flags: Vec::new(),
        z_mm: Some(-wave(3)),
        ..Press::default()
    };
    let path = (0..6).map(|n| (wave(n) / 3.0, wave(n + 1) / 7.0)).collect();
    let truth = PressTruth { force_true_n: wave(4), force_peak_n: wave(5), depth_peak_mm: wave(6) };
    let no_load = |n| {
        let force = NoLoadReadings {
            mean_n: wave(n) / 900.0,
            sigma_n: 0.002_917_3,
            readings: 83,
            age_s: 0.0415,
            ..NoLoadReadings::default()
        };
        NoLoad { force, outputs: (0..9).map(|unit| wave(n + unit) / 50.0).collect() }
    };
    RecordedContact {
        press,
        levels: vec![row.rounded()],
        budgets: Vec::new(),
        truth: vec![truth.rounded()],
        learned_contact: Some(LearnedContact::Touch { place: Place::new(-5.5, 6.0), z_mm: wave(7) / 11.0, path }),
        no_load_before: no_load(8),
        no_load_after: no_load(9),
        left: Some(Left { z_mm: -wave(8) / 3.0 }),
        ..RecordedContact::default()
    }
}

/// Peak memory of the process, where /proc states it.
fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kb = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().trim_end_matches(" kB").parse().ok());
    kb.map_or("isn't known on this system".to_owned(), |kb: u64| format!("{:.0} MB", kb as f64 / 1024.0))
}
