//! The lake: read directly by DuckDB, polars and pyarrow, and updated by exports.

use crate::bench;
use palpate_testing::executions::rig_with_drags;
use palpate_testing::python::{Python, said};
use palpate_testing::{TestFolder, shipped};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::RowAccessor as _;
use std::fs;
use std::path::{Path, PathBuf};

/// Rows of a complete run of the recipe.
const ROWS: usize = 9 * 2 * 5 + 81 + 20;

/// All files below a folder, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() { found.extend(files(&entry)) } else { found.push(entry) }
    }
    found.sort();
    found
}

fn with_runs() -> TestFolder {
    let bench = bench([
        ("runs/a", "--sensor A-017 --design pad --batch 2026-05"),
        ("runs/b", "--sensor B-1 --design pad --batch ü/=%"),
        ("runs/c", "--design strip"),
    ]);
    bench.palpate_ends(0, "export runs/a runs/b runs/c --lake lake");
    bench
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn readers_of_hive_find_every_press_of_every_sensor() {
    let bench = with_runs();
    let expected = format!("pad|2026-05|A-017|{ROWS}\npad|ü/=%|B-1|{ROWS}\nstrip|None|None|{ROWS}\n");
    for library in ["duckdb", "polars", "pyarrow"] {
        let import = if library == "pyarrow" { "import pyarrow.dataset" } else { &format!("import {library}") };
        let python = Python::with(import);
        let words = [library.into(), bench.path("").into_os_string()];
        assert_eq!(said(python.script("lake.py", words)), expected, "{library}");
    }
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn the_queries_of_the_book_find_something() {
    let bench = with_runs();
    let python = Python::with("import duckdb");
    let page = shipped("docs/how-to/files.md");
    let words = ["queries".into(), bench.path("").into_os_string(), page.into_os_string()];
    let output = said(python.script("lake.py", words));
    let found: Vec<(usize, usize)> = output
        .lines()
        .map(|line| line.split(' ').take(2).map(|count| count.parse().unwrap()).collect::<Vec<usize>>())
        .map(|counts| (counts[0], counts[1]))
        .collect();
    assert_eq!(found.len(), 2, "{output}");
    assert!(found.iter().all(|(rows, whole)| *rows > 0 && *whole > 0), "{output}");
}

#[test]
fn run_is_in_the_lake_once_under_its_present_labels() {
    let bench = with_runs();
    let before = files(&bench.path("lake"));
    assert_eq!(before.iter().filter(|file| file.extension().is_some()).count(), 3 * 6);
    fs::rename(bench.path("runs/a"), bench.path("moved")).unwrap();
    bench.palpate_ends(0, "export moved runs/b --lake lake");
    assert_eq!(files(&bench.path("lake")), before);
    // files of a sensor with another label, as if the label had been corrected
    let place = |sensor: &str| bench.path(&format!("lake/presses/design=pad/batch=2026-05/sensor={sensor}"));
    fs::rename(place("A-017"), place("A-071")).unwrap();
    assert_ne!(files(&bench.path("lake")), before);
    bench.palpate_ends(0, "export moved --lake lake");
    assert_eq!(files(&bench.path("lake")), before);
}

#[test]
fn a_verdict_needs_a_rule_and_an_import_has_none() {
    let bench = bench([("runs/a", "")]);
    bench.palpate_ends(0, "export runs/a --format csv --out csv");
    bench.palpate_ends(0, "import csv/calibration_matrix.csv --test csv/test_matrix.csv --out imported");
    bench.palpate_ends(0, "export imported --lake lake");
    assert!(!bench.has("lake/verdicts") && bench.has("lake/presses"));
    bench.write("rule.toml", "method = \"pearson\"\nlocation_mean_mm = 5.0\n");
    bench.palpate_ends(0, "export imported --lake lake --accept rule.toml");
    assert!(bench.has("lake/verdicts") && bench.has("lake/errors"));
    bench.palpate_ends(0, "export imported --lake lake");
    assert!(files(&bench.path("lake/verdicts")).is_empty(), "an earlier verdict by another rule");
}

const PLACES: &str =
    "checks = \"none\"\n[[step]]\nphase = \"calibration\"\nlist = { places_mm = [[0.0, 0.0], [2.0, -2.0]] }\n";

#[test]
fn a_lake_has_the_columns_of_drags_and_depths() {
    let dragged = format!("name = \"d\"\n{PLACES}force_n = 1.0\ndrag = {{ mm = 0.4, directions_deg = [0, 90] }}\n");
    let deep = format!("name = \"deep\"\nrig = \"sim\"\n{PLACES}depth_mm = 0.5\n");
    let bench =
        TestFolder::with([("axes.toml", &*rig_with_drags()), ("dragged.toml", &*dragged), ("deep.toml", &*deep)]);
    bench.palpate_ends(0, "run dragged.toml --rig axes.toml --simulate --out dragged");
    bench.palpate_ends(0, "run deep.toml --out deep");
    for run in ["dragged", "deep"] {
        bench.palpate_ends(0, &format!("export {run} --lake lake-{run}"));
        let file = files(&bench.path(&format!("lake-{run}/presses"))).remove(0);
        let file = SerializedFileReader::new(fs::File::open(file).unwrap()).unwrap();
        let columns = file.metadata().file_metadata().schema_descr().columns();
        let (header, rows) = bench.table(&format!("{run}/presses.csv"));
        assert!(
            columns[1..].iter().map(|column| column.name()).eq(&header),
            "{run}: the run, and the run's own columns"
        );
        let of = |name: &str| header.iter().position(|column| column == name);
        for name in ["force_x_n", "force_y_n", "drag_mm", "depth_mm"] {
            let Some(column) = of(name) else { continue };
            let read = file.get_row_iter(None).unwrap().map(|row| row.unwrap().get_double(column + 1).unwrap());
            assert!(read.eq(rows.iter().map(|row| row[column].parse::<f64>().unwrap())), "{run}: {name}");
        }
        assert_eq!(of("drag_mm").is_some(), run == "dragged");
    }
}
