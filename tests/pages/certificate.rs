//! `palpate certificate`: what it writes is valid, says what `evaluate` says, and rests on the journals that it names.

use crate::support::{Bench, exchanged, shipped, shipped_text, skips::skipped};
use serde_json::Value;
use std::env;
use std::path::Path;
use std::process::Command;

const RECIPE: &str = "
name = \"all\"
[[step]]
phase = \"characterisation\"
units = [1, 5]
staircase = { to_n = 2.0, step_n = 0.5, repeats = 3 }
[[step]]
phase = \"calibration\"
grid = { x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], spacing_mm = 1.0 }
force_n = 1.0
[[step]]
phase = \"test\"
random = { count = 60, x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], force_n = [0.1, 1.0] }
[accept]
method = \"surrogate\"
location_mean_mm = 1.0
";

/// A run of everything on a rig whose instruments have certificates.
fn bench() -> Bench {
    let rig = shipped_text("rigs/sim.toml").replacen(
        "[load_cell]\n",
        "certificate = { number = \"S-1\", date = \"2026-05-04\", u_mm = 0.01 }\n\n[load_cell]\n\
         certificate = { number = \"K-1\", date = \"2026-05-04\", u_percent = 0.2 }\n",
        1,
    );
    let given = shipped_text("data/example/certificate.toml");
    let bench = Bench::with([("r.toml", RECIPE), ("rig.toml", &rig), ("c.toml", &given)]);
    bench.palpate_ends(0, "run r.toml --rig rig.toml --out run --sensor A<7>&co --design D-1 --operator K");
    bench
}

#[test]
fn a_certificate_is_valid_and_says_what_evaluate_says() {
    let bench = bench();
    let told = bench.palpate_ends(0, "certificate run --with c.toml").out;
    assert!(told.starts_with("certificate LAB-2026-0042 of sensor A<7>&co: accepted, "), "{told}");
    assert!(told.lines().all(|line| line.chars().count() <= 80), "{told}");
    is_valid(&bench.path("run/certificate.xml"));
    let html = bench.read("run/certificate.html");
    for part in [
        "A&lt;7&gt;&amp;co",
        "certificate K-1 of 2026-05-04",
        "certificate S-1",
        "Pass",
        "certifies no sensor",
        "not signed",
    ] {
        assert!(html.contains(part), "{part}");
    }
    let evaluation = bench.palpate_ends(0, "evaluate run --solver surrogate --json").json_lines().remove(0);
    let Some(read) = read_outside(&bench, "run/certificate.xml") else { return };
    assert_eq!((&read["version"], &read["identifier"]), (&"3.2.0".into(), &"LAB-2026-0042".into()));
    assert_eq!((&read["serial"], &read["conformity"]), (&"A<7>&co".into(), &"pass".into()));
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
    // the scatter of the mean alone is less than what the certificates add to it
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

#[test]
fn conformity_is_the_verdict_and_no_statement_where_nothing_is_decided() {
    let bench = bench();
    bench.write("strict.toml", "method = \"surrogate\"\nlocation_mean_mm = 0.001\n");
    bench.write("open.toml", "location_mean_mm = 5.0\ntest_presses_least = 1000\n");
    for (out, words, statement, xml) in [
        ("c", "--accept strict.toml", "Fail", "<dcc:conformity>fail</dcc:conformity>"),
        ("open", "--accept open.toml", "No statement", "judged afterwards by open.toml"),
    ] {
        let words = format!("certificate run --with c.toml --out {out} {words}");
        bench.palpate_ends(0, &words);
        let again = bench.palpate_ends(2, &words).running();
        assert!(again.contains(&format!("{out}.html already exists")), "{again}");
        assert!(bench.read(&format!("{out}.html")).contains(&format!("<strong>{statement}</strong>")), "{words}");
        assert!(bench.read(&format!("{out}.xml")).contains(xml), "{words}");
        is_valid(&bench.path(&format!("{out}.xml")));
    }
    assert!(!bench.read("open.xml").contains("<dcc:conformity>"));
}

#[test]
fn a_certificate_rests_on_its_journals() {
    let bench = bench();
    bench.palpate_ends(0, "certificate run --with c.toml");
    for file in ["run/certificate.xml", "run/certificate.html"] {
        let told = bench.palpate_ends(0, &format!("verify run --certificate {file}")).out;
        assert!(told.contains(&format!("{file} states the SHA-256 of this journal\n")), "{told}");
    }
    bench.palpate_ends(0, "run r.toml --rig rig.toml --out other --seed 2 --sensor A-8");
    let told = bench.palpate_ends(1, "verify other --certificate run/certificate.xml").running();
    assert!(told.contains("doesn't match the journal of other"), "{told}");
    bench.write("hash.xml", &format!("<!-- {} -->", bench.manifest("run")["seed"]));
    bench.palpate_ends(2, "verify run --certificate hash.xml");
    let told = bench.palpate_ends(2, "verify run --certificate rig.toml").running();
    assert!(told.contains("states no SHA-256 of a journal"), "{told}");
}

#[test]
fn what_no_run_knows_must_be_given_and_nothing_is_written_without_it() {
    let bench = bench();
    let given = bench.read("c.toml");
    let refused = |text: &str, runs: &str| {
        bench.write("other.toml", text);
        let told = bench.palpate_ends(2, &format!("certificate {runs} --with other.toml --out out")).running();
        assert!(!bench.has("out.html") && !bench.has("out.xml"), "{told}");
        told
    };
    let told = refused(&exchanged(&given, "country = \"DK\"", "country = \"Denmark\""), "run");
    assert!(told.contains("expected two upper-case letters"), "{told}");
    let told = refused(&given.replace("[procedure]", "[procedur]"), "run");
    assert!(told.contains("`procedure` is missing") && told.contains("did you mean `procedure`?"), "{told}");
    let without =
        given.split("[[responsible]]").next().unwrap().to_owned() + "[item]" + given.split("[item]").nth(1).unwrap();
    assert!(refused(&without, "run").contains("`responsible` is missing"));
    bench.palpate_ends(0, "run r.toml --rig rig.toml --out unnamed");
    assert!(refused(&given, "unnamed").contains("unnamed has no sensor ID"));
    bench.write("out.xml", "mine");
    let told = bench.palpate_ends(2, "certificate run --with c.toml --out out").running();
    assert!(
        told.contains("out.xml already exists") && bench.read("out.xml") == "mine" && !bench.has("out.html"),
        "{told}"
    );
}

/// Validates against the schema of the PTB, where `PALPATE_DCC_SCHEMA` names the folder that has it and a catalog.
fn is_valid(xml: &Path) {
    let Ok(folder) = env::var("PALPATE_DCC_SCHEMA") else {
        return skipped("certificate", "PALPATE_DCC_SCHEMA names no folder with the schema");
    };
    let folder = Path::new(&folder);
    let mut xmllint = Command::new("xmllint");
    xmllint.env("XML_CATALOG_FILES", folder.join("catalog.xml")).args(["--nonet", "--noout", "--schema"]);
    match xmllint.arg(folder.join("dcc_3_2_0.xsd")).arg(xml).output() {
        Ok(output) => assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr)),
        Err(_) => skipped("certificate", "there is no xmllint"),
    }
}

/// What a reader that isn't ours finds in the document.
fn read_outside(bench: &Bench, xml: &str) -> Option<Value> {
    let script = shipped("tests/outside/certificate.py");
    match Command::new("python3").arg(script).arg(bench.path(xml)).output() {
        Ok(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            Some(serde_json::from_slice(&output.stdout).expect("JSON"))
        }
        Err(_) => {
            skipped("certificate", "there is no python3");
            None
        }
    }
}
