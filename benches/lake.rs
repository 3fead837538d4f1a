//! What a press costs in the lake, and what a reader of one sensor pays.
//!
//! `cargo bench --features files --bench lake -- 10000000` writes ten million presses; 100,000 without a number. Where `PALPATE_PYTHON`
//! names an interpreter with DuckDB, it reads the maps of all sensors, and those of one.
#![allow(clippy::print_stdout, reason = "it prints its results")]

#[path = "../tests/files/recorded.rs"]
mod recorded;

use cpu_time::ThreadTime;
use palpate_data::dataset::Press;
use palpate_report::export::arrow::ParquetFile;
use palpate_report::export::frame::presses_of;
use palpate_report::export::lake::Lake;
use palpate_report::export::of_run;
use recorded::{OUTPUTS, press, recorded};
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::Path;
use std::process::Command;

/// Presses of the writer, unless others are asked for, and those of one sensor.
const PRESSES: usize = 100_000;
const OF_A_SENSOR: usize = 10_000;
/// Presses of the folder that is exported.
const IN_A_FOLDER: u64 = 10_000;

fn main() {
    let presses = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(PRESSES);
    let home = tempfile::tempdir().expect("a folder");
    let lake = home.path().join("lake");
    fs::create_dir(&lake).expect("a folder");
    let writer_us = written(&lake, presses);
    let folder_us = exported(home.path().join("folder").as_path());
    println!("CPU a press: {writer_us:.3} us of the writer alone, {folder_us:.1} us from a folder; {}", memory());
    if let Some(python) = std::env::var_os("PALPATE_PYTHON") {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/outside/lake_speed.py");
        let status = Command::new(python).arg(script).arg(home.path()).status();
        assert!(status.expect("the interpreter starts").success());
    }
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
    let run = home.join("run");
    recorded(&run, IN_A_FOLDER);
    let mut lake = Lake::open(&home.join("lake")).unwrap();
    let began = ThreadTime::now();
    let staged = lake.stage(&run).unwrap();
    lake.publish(staged).unwrap();
    began.elapsed().as_secs_f64() * 1e6 / IN_A_FOLDER as f64
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
