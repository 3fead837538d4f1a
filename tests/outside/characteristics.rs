//! The characteristics of units, by the library and by an independent script.

use palpate_testing::characteristics::characterised;
use palpate_testing::{TestFolder, shipped, shipped_text, there};
use std::process::{Command, Stdio};

#[test]
#[ignore = "needs python3"]
fn an_independent_script_finds_the_same_characteristics() {
    let text = shipped_text("data/example/characterisation.csv");
    assert_eq!(recomputed(&text), shipped_text("data/example/characteristics.csv"));
    // the simulated units are linear and return to zero: these are nonlinear and drift, and some levels are flagged
    let worn = worn(&text);
    let expected = characterised(&worn);
    for column in [5, 6] {
        let cells = expected.lines().skip(1).map(|line| line.split(',').nth(column).unwrap().parse::<f64>().unwrap());
        assert!(cells.into_iter().all(|percent| percent.abs() > 0.001), "{expected}");
    }
    assert_eq!(recomputed(&worn), expected, "of worn units");
}

/// The same by Python.
fn recomputed(text: &str) -> String {
    let bench = TestFolder::with([("characterisation.csv", text)]);
    let mut python = Command::new("python3");
    python
        .arg(shipped("data/check/characteristics.py"))
        .arg(bench.path("characterisation.csv"))
        .args(["3", "3", "4.5"]);
    let output = there(python.stdin(Stdio::null()), "python3");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text").replace("\r\n", "\n")
}

/// The table with outputs that are nonlinear and drift, and a flag at every 37th row.
fn worn(text: &str) -> String {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header: Vec<String> = reader.headers().expect("a header").iter().map(str::to_owned).collect();
    let mut worn = header.join(",") + "\n";
    for (index, row) in reader.records().enumerate() {
        let row = row.expect("a row");
        let cell = |name: &str| &row[header.iter().position(|column| column == name).expect("a column")];
        let t_s: f64 = cell("t_s").parse().expect("a time");
        let bent = |output: &str| {
            let output: f64 = output.parse().expect("an output");
            let slow_drift = 0.01 * (0.3 * t_s).sin() + 0.02 * output * (0.07 * t_s).cos();
            format!("{:.7}", output - 0.05 * output * output + slow_drift)
        };
        let cells = header.iter().zip(&row).map(|(name, cell)| match name.as_str() {
            output if output.starts_with("out_") => bent(cell),
            "flags" if index % 37 == 0 => "stale".to_owned(),
            _ => cell.to_owned(),
        });
        worn += &(cells.collect::<Vec<String>>().join(",") + "\n");
    }
    worn
}
