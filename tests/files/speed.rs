//! What a press costs in the lake, and what a reader of one sensor pays.

use crate::support::python::{Python, said};
use crate::support::skips::asked;
use cpu_time::ThreadTime;
use palpate::control::{AirReadings, Lesson};
use palpate::dataset::{
    Air, Contact, Durability, Ledger as _, Origins, Press, PressTruth, Provenance, Record, RunFacts, RunFolder, Status,
};
use palpate::export::arrow::ParquetFile;
use palpate::export::frame::presses_of;
use palpate::export::lake::Lake;
use palpate::export::of_run;
use palpate::quantity::{ArrayLayout, Place};
use palpate::recipe::Phase;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;

/// Presses of the writer, unless `PALPATE_LAKE_PRESSES` asks for others, and those of one sensor.
const PRESSES: usize = 100_000;
const OF_A_SENSOR: usize = 10_000;
/// Presses of the folder that is exported.
const IN_A_FOLDER: u64 = 10_000;
const OUTPUTS: usize = 9;
/// Presses from which a scan of all is long enough to be compared with one sensor's.
const COMPARED_LEAST: usize = 10_000_000;

/// Most CPU of a press, us: of the writer alone, and with the reading of its folder.
const WRITER_US: f64 = 2.0;
const FOLDER_US: f64 = 20.0;

/// A press with as many digits as a measured one.
fn press(number: u64) -> Press {
    let wave = |n: u64| ((number * 7919 + n * 104_729) % 1_000_003) as f64 / 1e6 + 0.123_456_7;
    Press {
        press: number,
        phase: Some(Phase::Calibration),
        x_mm: -6.0 + 0.5 * (number % 25) as f64,
        y_mm: -6.0 + 0.5 * (number / 25 % 25) as f64,
        force_set_n: Some(1.0),
        force_n: Some(0.9 + 0.1 * wave(1)),
        u_force_n: Some(0.001 * wave(2)),
        depth_mm: Some(wave(3)),
        t_s: Some(3.0 * number as f64),
        outputs: (0..OUTPUTS as u64).map(|n| wave(10 + n)).collect(),
        z_mm: Some(-wave(4)),
        air_before_n: Some(0.01 * wave(5)),
        air_after_n: Some(0.01 * wave(6)),
        ..Press::default()
    }
    .rounded()
}

/// Writes the presses of sensors to a lake. Returns the CPU of a press, us.
fn written(lake: &Path, presses: usize) -> f64 {
    let its: Vec<Press> = (0..OF_A_SENSOR as u64).map(press).collect();
    let sensors = presses / OF_A_SENSOR;
    let began = ThreadTime::now();
    for sensor in 0..sensors {
        let id = format!("{sensor:016x}");
        let draft = lake.join("draft");
        let like = of_run(presses_of(&[], OUTPUTS, "V"), &id);
        let mut file = ParquetFile::new(BufWriter::new(File::create(&draft).unwrap()), &like, None).unwrap();
        for some in its.chunks(4096) {
            file.add(of_run(presses_of(some, OUTPUTS, "V"), &id)).unwrap();
        }
        drop(file.finish("{}").unwrap());
        let place = format!("presses/design=pad/batch=B{}/sensor=S{sensor}", sensor % 20);
        fs::create_dir_all(lake.join(&place)).unwrap();
        fs::rename(draft, lake.join(place).join(format!("{id}.parquet"))).unwrap();
    }
    began.elapsed().as_secs_f64() * 1e6 / (sensors * OF_A_SENSOR) as f64
}

/// Makes a run folder, and exports it. Returns the CPU of a press, us.
fn exported(home: &Path) -> f64 {
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let facts = RunFacts { recipe: "many".to_owned(), presses_planned: IN_A_FOLDER, ..RunFacts::default() };
    let session = Provenance { durability: Durability::Fast, ..Provenance::default() };
    let rig = fs::read_to_string(crate::support::shipped("rigs/sim.toml")).unwrap();
    let origins = Origins::new(String::new(), rig, Vec::new());
    let run = home.join("run");
    let mut folder = RunFolder::create(Some(&run), &origins, facts, session, &layout).unwrap();
    for number in 0..IN_A_FOLDER {
        let wave = |n: u64| ((number * 7919 + n * 104_729) % 1_000_003) as f64 / 3e6;
        let air = |n: u64| {
            let force = AirReadings { mean_n: wave(n), sigma_n: 0.002_917_3, readings: 83, age_s: 0.0415 };
            Air { force, outputs: (0..OUTPUTS as u64).map(|output| wave(n + output)).collect() }
        };
        let path = (0..6).map(|n| (wave(n), wave(n + 1))).collect();
        let truth = PressTruth { force_true_n: wave(4), force_peak_n: wave(5), depth_peak_mm: wave(6) };
        let contact = Contact {
            press: number,
            levels: vec![press(number)],
            truth: vec![truth.rounded()],
            lesson: Some(Lesson::Touch { place: Place::new(-5.5, 6.0), z_mm: wave(7), path }),
            air_before: air(8),
            air_after: air(9),
            ..Contact::default()
        };
        folder.record(&Record::Contact(contact)).unwrap();
    }
    assert_eq!(folder.manifest().status, Status::Stopped);
    drop(folder);
    let mut lake = Lake::open(&home.join("lake")).unwrap();
    let began = ThreadTime::now();
    let staged = lake.stage(&run).unwrap();
    let told = lake.publish(staged).unwrap();
    let us = began.elapsed().as_secs_f64() * 1e6 / IN_A_FOLDER as f64;
    assert!(told.starts_with(&format!("{IN_A_FOLDER} presses at ")), "{told}");
    us
}

#[test]
#[cfg_attr(debug_assertions, ignore = "measures a program that is optimised")]
fn a_press_in_the_lake_costs_little_and_a_sensor_is_found_without_a_scan() {
    let presses = asked("PALPATE_LAKE_PRESSES").map_or(PRESSES, |presses| presses.parse().unwrap());
    let home = tempfile::tempdir().unwrap();
    let lake = home.path().join("lake");
    fs::create_dir(&lake).unwrap();
    let writer_us = written(&lake, presses);
    let folder_us = exported(home.path().join("folder").as_path());
    println!("CPU a press: {writer_us:.3} us of the writer alone, {folder_us:.1} us from a folder; {}", memory());
    assert!(writer_us < WRITER_US && folder_us < FOLDER_US, "{writer_us} us and {folder_us} us");
    if presses < COMPARED_LEAST {
        return;
    }
    let Some(python) = Python::with("one sensor's maps in a lake", "import duckdb") else { return };
    let told = said(python.script("lake_speed.py", [home.path()]));
    println!("{told}");
    let seconds: Vec<f64> = told.split_whitespace().take(3).map(|seconds| seconds.parse().unwrap()).collect();
    // by its path; with a condition, DuckDB lists all folders first
    assert!(100.0 * seconds[2] < seconds[0], "{seconds:?}");
}

/// Peak memory of this program, as Linux reports it.
fn memory() -> String {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    status
        .lines()
        .find(|line| line.starts_with("VmHWM"))
        .unwrap_or_default()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}
