//! Certificates in other programs: the schema of the PTB, and another reader.

use palpate_testing::certified::bench;
use palpate_testing::{TestFolder, shipped, there};
use serde_json::Value;
use std::env;
use std::path::Path;
use std::process::Command;

#[test]
#[ignore = "needs xmllint, and PALPATE_DCC_SCHEMA that names the folder of the schema"]
fn a_certificate_is_valid() {
    let bench = bench();
    bench.write("strict.toml", "method = \"surrogate\"\nlocation_mean_mm = 0.001\n");
    bench.write("open.toml", "location_mean_mm = 5.0\ntest_presses_least = 1000\n");
    for (out, words) in [("pass", ""), ("fail", "--accept strict.toml"), ("open", "--accept open.toml")] {
        bench.palpate_ends(0, &format!("certificate run --with c.toml --out {out} {words}"));
        is_valid(&bench.path(&format!("{out}.xml")));
    }
}

#[test]
#[ignore = "needs python3"]
fn certificate_has_the_numbers_of_evaluate() {
    let bench = bench();
    bench.palpate_ends(0, "certificate run --with c.toml");
    let evaluation = bench.palpate_ends(0, "evaluate run --solver surrogate --json").json_lines().remove(0);
    let read = read_outside(&bench, "run/certificate.xml");
    assert_eq!((&read["version"], &read["identifier"]), (&"3.2.0".into(), &"LAB-2026-0042".into()));
    assert_eq!((&read["serial"], &read["conformity"]), (&"A-7".into(), &"pass".into()));
    let results = read["results"].as_array().unwrap();
    let of =
        |name: &str| results.iter().find(|result| result["name"] == name).unwrap_or_else(|| panic!("{name}")).clone();
    for (name, path, unit) in [
        ("location error, mean", "/location_error_mm/mean", "\\milli\\metre"),
        ("location error, 95th percentile", "/location_error_mm/p95", "\\milli\\metre"),
        ("force error, mean", "/force_error_n/mean", "\\newton"),
        ("force error, 95th percentile", "/force_error_n/p95", "\\newton"),
    ] {
        let found = of(name);
        let expected = evaluation.pointer(path).and_then(Value::as_f64).unwrap();
        assert!((found["value"].as_f64().unwrap() - expected).abs() < 1e-12, "{name}: {found} {expected}");
        assert_eq!(found["unit"], unit);
    }
    // the certificates add more to the mean than its scatter
    assert!(of("location error, mean")["expanded"].as_f64() > Some(0.01), "{results:?}");
    assert_eq!(of("location error, mean")["k"], 2.0);
    // three staircases leave two degrees of freedom
    let k = of("unit 5, hysteresis")["k"].as_f64().unwrap();
    assert!((k - 4.3027).abs() < 5e-4, "{k}");
    let (header, rows) = bench.table("run/characteristics.csv");
    let column = |name: &str| header.iter().position(|column| column == name).unwrap();
    let unit = of("unit 5, repeatability, loading");
    for (key, name) in [
        ("value", "repeatability_loading_percent"),
        ("least", "repeatability_loading_least_percent"),
        ("most", "repeatability_loading_most_percent"),
    ] {
        let expected: f64 = rows[4][column(name)].parse().unwrap();
        assert!((unit[key].as_f64().unwrap() - expected).abs() < 6e-5, "{key}: {unit} {expected}");
    }
}

/// Validates against the schema of the PTB.
fn is_valid(xml: &Path) {
    let folder = env::var("PALPATE_DCC_SCHEMA").unwrap_or_else(|_| {
        panic!("PALPATE_DCC_SCHEMA names no folder: download dcc_3_2_0.xsd and what it imports, with a catalog.xml, and name it")
    });
    let folder = Path::new(&folder);
    let mut xmllint = Command::new("xmllint");
    xmllint.env("XML_CATALOG_FILES", folder.join("catalog.xml")).args(["--nonet", "--noout", "--schema"]);
    let output = there(xmllint.arg(folder.join("dcc_3_2_0.xsd")).arg(xml), "xmllint (libxml2-utils)");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The content that another reader finds in the document.
fn read_outside(bench: &TestFolder, xml: &str) -> Value {
    let mut python = Command::new("python3");
    let output = there(python.arg(shipped("tests/outside/certificate.py")).arg(bench.path(xml)), "python3");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}
