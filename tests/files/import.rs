//! Tables in files of other programs give the same presses as CSV, to the last bit.

use crate::bench;
use palpate_testing::python::{Python, said};
use palpate_testing::{TestFolder, shipped_text};

const SHORT: &str = "--columns x_mm=X,y_mm=Y,force_n=Fz,outputs=ch_1..ch_9";

/// A folder with the example's calibration under other names, as CSV and in the formats of other libraries.
fn tables() -> TestFolder {
    let imports = "import numpy, openpyxl, pandas, polars, scipy.io, pyarrow";
    let python = Python::with(imports);
    let text = shipped_text("data/example/calibration.csv");
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|column| column == name).unwrap();
    let outputs: Vec<usize> = (1..=9).map(|number| at(&format!("out_{number}"))).collect();
    let taken: Vec<usize> = [at("x_mm"), at("y_mm"), at("force_n")].into_iter().chain(outputs).collect();
    let mut table = "X,Y,Fz,ch_1,ch_2,ch_3,ch_4,ch_5,ch_6,ch_7,ch_8,ch_9\n".to_owned();
    for (number, row) in reader.records().map(Result::unwrap).enumerate() {
        // digits that no short decimal has
        let cell = |at: &usize| (row[*at].parse::<f64>().unwrap() / 3.0 + number as f64 * 1e-13).to_string();
        table += &(taken.iter().map(cell).collect::<Vec<_>>().join(",") + "\n");
    }
    let bench = TestFolder::with([("grid.csv", table.as_str())]);
    said(python.script("tables.py", [bench.path("grid.csv"), bench.path("")]));
    bench
}

/// The presses of an imported run.
fn presses(bench: &TestFolder, run: &str) -> String {
    bench.read(&format!("{run}/presses.csv"))
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn a_table_of_any_format_gives_the_presses_of_its_csv() {
    let bench = tables();
    bench.palpate_ends(0, &format!("import grid.csv {SHORT} --out csv"));
    bench.palpate_ends(0, &format!("import sheet.csv {SHORT} --out sheet-csv"));
    for (words, out) in [("one.xlsx", "one"), ("two.xlsx --sheet Data", "two")] {
        bench.palpate_ends(0, &format!("import {words} {SHORT} --out {out}"));
        assert_eq!(presses(&bench, out), presses(&bench, "sheet-csv"), "{words}");
    }
    let files =
        ["columns.npz", "matrix.npz", "columns.mat", "matrix.mat", "pandas.parquet", "gzip.parquet", "polars.parquet"];
    for file in files {
        bench.palpate_ends(0, &format!("import {file} {SHORT} --out from-{file}"));
        assert_eq!(presses(&bench, &format!("from-{file}")), presses(&bench, "csv"), "{file}");
    }
    // every command that reads a table reads them: the sensor files differ only in their sources
    for (file, out) in [("grid.csv", "a.palpate"), ("matrix.mat", "b.palpate")] {
        bench.palpate_ends(0, &format!("fit {file} {SHORT} --solver pearson --out {out}"));
    }
    let evaluated = |table: &str| {
        let output = bench.palpate_ends(0, &format!("evaluate {table} {table} {SHORT} --solver pearson --json"));
        let mut value: serde_json::Value = serde_json::from_str(&output.out).unwrap();
        value.as_object_mut().unwrap().remove("ns_per_solve");
        value
    };
    assert_eq!(evaluated("pandas.parquet"), evaluated("grid.csv"));
}

#[test]
#[ignore = "needs PALPATE_PYTHON (tests/outside/requirements.txt)"]
fn spreadsheet_error_names_sheet_row_and_column() {
    let bench = tables();
    bench.write("text.npz", "no archive");
    bench.write("text.mat", "no variables");
    bench.write("text.parquet", "no columns");
    bench.write("text.xlsx", "no sheets");
    for (words, expected) in [
        ("import wrong.xlsx", "wrong.xlsx, sheet Data, line 8, column `Y`: expected a finite number, found `n.a.`"),
        ("import far.xlsx", "sheet `Data` reaches over more than 10000000 cells"),
        ("import two.xlsx", "two.xlsx, sheet Notes"),
        ("import two.xlsx --sheet Date", "it has no sheet `Date`; its sheets: Notes, Data"),
        ("import zstd.parquet", "save it with snappy"),
        ("import text.npz", "text.npz: not an .npz file that can be read"),
        ("import text.mat", "text.mat: not a MAT file of version 5"),
        ("import text.parquet", "text.parquet: not a Parquet file that can be read"),
        ("import text.xlsx", "text.xlsx: not a workbook that can be read"),
        ("import none.xlsx", "none.xlsx: can't be read"),
    ] {
        let output = bench.palpate_ends(2, &format!("{words} {SHORT}"));
        assert!(output.running().contains(expected), "{words}: {}", output.err);
        assert!(!bench.has("runs"), "{words}");
    }
}

#[test]
fn exported_files_are_imported_again() {
    let bench = bench([("runs/every", "")]);
    for (format, table) in [("csv", "presses.csv"), ("parquet", "presses.parquet"), ("npz", ""), ("mat", "")] {
        let out = format!("{format}{}", if table.is_empty() { format!(".{format}") } else { String::new() });
        bench.palpate_ends(0, &format!("export runs/every --format {format} --out {out}"));
        let table = if table.is_empty() { out } else { format!("{out}/{table}") };
        bench.palpate_ends(0, &format!("import {table} --out again-{format}"));
    }
    for format in ["parquet", "npz", "mat"] {
        assert_eq!(presses(&bench, &format!("again-{format}")), presses(&bench, "again-csv"), "{format}");
    }
}
