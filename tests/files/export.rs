//! Exported files, each read by its own program and compared with the CSV export, bit by bit.

use crate::bench;
use palpate_testing::python::{Python, said};
use palpate_testing::{TestFolder, there};
use std::fs;
use std::process::Command;

/// Fewest values that a comparison needs: with fewer the reader is broken.
const VALUES_LEAST: u64 = 5000;

/// A folder with `all/`: the exports of one run in every format.
fn exported() -> TestFolder {
    let bench = bench([("runs/every", "--sensor A-017")]);
    fs::create_dir(bench.path("all")).unwrap();
    for (format, out) in [
        ("csv", "csv"),
        ("parquet", "parquet"),
        ("arrow", "arrow"),
        ("npz", "run.npz"),
        ("mat", "run.mat"),
        ("h5", "run.h5"),
    ] {
        bench.palpate_ends(0, &format!("export runs/every --format {format} --out all/{out}"));
    }
    bench
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn every_format_has_the_same_numbers_for_its_own_reader() {
    let bench = exported();
    assert_eq!(bench.read("all/csv/presses.csv"), bench.read("runs/every/presses.csv"));
    for library in ["numpy", "scipy", "pandas", "pyarrow", "polars", "duckdb", "h5py"] {
        let import = match library {
            "scipy" => "import scipy.io",
            "pandas" => "import pandas, pyarrow",
            library => &format!("import {library}"),
        };
        let python = Python::with(import);
        let words = [library.into(), bench.path("all").into_os_string()];
        let compared: u64 = said(python.script("frames.py", words)).trim().parse().unwrap();
        assert!(compared > VALUES_LEAST, "{library}: {compared}");
    }
}

/// Octave prints doubles in hexadecimal, which are compared with those of the CSV file.
#[test]
#[ignore = "needs octave-cli"]
fn octave_reads_the_same_numbers_and_texts() {
    let bench = exported();
    let script = "load all/run.mat; printf('%s\\n', num2hex(presses.force_n)'); printf('%s\\n', presses.phase{:}); \
                  printf('%d %d\\n', size(presses.outputs)); printf('%s\\n', num2hex(presses.outputs(:, end))'); \
                  printf('%s %s\\n', presses.unit.force_n, class(manifest));";
    let mut octave = Command::new("octave-cli");
    let output = there(octave.args(["--norc", "--eval", script]).current_dir(bench.path("")), "Octave");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{err}");
    let mut reader = csv::Reader::from_reader(fs::File::open(bench.path("all/csv/presses.csv")).unwrap());
    let header = reader.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let at = |name: &str| header.iter().position(|column| column == name).unwrap();
    let hex = |name: &str| {
        let bits = |row: &csv::StringRecord| format!("{:016x}", row[at(name)].parse::<f64>().unwrap().to_bits());
        rows.iter().map(bits).collect::<Vec<_>>().join("")
    };
    let phases: String = rows.iter().map(|row| format!("{}\n", &row[at("phase")])).collect();
    let out_9 = hex("out_9");
    let expected = format!("{}\n{phases}{} 9\n{out_9}\nN char\n", hex("force_n"), rows.len());
    assert_eq!(out.replace("\r\n", "\n"), expected, "{err}");
}

#[test]
fn nothing_is_overwritten_and_several_runs_share_a_folder() {
    let bench = bench([("runs/a", "--sensor A"), ("runs/b", "--sensor B")]);
    bench.write("kept.npz", "kept");
    for (words, expected) in [
        ("export runs/a --format npz --out kept.npz", "kept.npz already exists"),
        ("export runs/a runs/a --format npz", "two runs have the name a"),
        ("export runs/none --format csv", "runs/none"),
        ("export runs/a", "--format"),
        ("export runs/a --lake runs", "runs isn't a lake of palpate, and isn't an empty folder"),
        ("export runs/a --lake kept.npz", "kept.npz isn't a lake of palpate, and isn't an empty folder"),
    ] {
        let output = bench.palpate_ends(2, words);
        assert!(output.running().contains(expected), "{words}: {}", output.err);
    }
    assert_eq!(bench.read("kept.npz"), "kept");
    bench.palpate_ends(0, "export runs/a runs/b --format mat --out both");
    assert!(bench.has("both/a.mat") && bench.has("both/b.mat"));
    bench.palpate_ends(0, "export runs/a runs/b --format csv");
    assert!(bench.has("export-csv/a/presses.csv") && bench.has("export-csv/b/truth.json"));
    let stray = |name: &str| name.starts_with('.') && name.ends_with(".new");
    let names = fs::read_dir(bench.path("")).unwrap().map(|entry| entry.unwrap().file_name().display().to_string());
    assert_eq!(names.filter(|name| stray(name)).collect::<Vec<_>>(), [""; 0]);
}
