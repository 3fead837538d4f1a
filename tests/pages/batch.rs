//! Pages of batches: their numbers are those of the events, and they remain usable with thousands of sensors.

use palpate_data::acceptance::SensorVerdict;
use palpate_run::batch::{BatchEvent, Ended};
use palpate_testing::batches::{Drawn, MONTH, WITHIN, write};
use palpate_testing::{TestFolder, campaign, shipped_text};
use std::collections::HashMap;
use std::fs;

/// Largest page of 5,000 sensors, MB.
const LARGEST_MB: f64 = 8.0;

/// The first number of each key on a page.
fn numbers(page: &str) -> HashMap<String, f64> {
    let mut found = HashMap::new();
    for data in page.split("<data value=\"").skip(1) {
        let (value, rest) = data.split_once("\" data-key=\"").expect("a key");
        let key = rest.split_once('"').expect("its end").0;
        found.entry(key.to_owned()).or_insert_with(|| value.parse().expect("a number"));
    }
    found
}

/// The last result of each sensor that wasn't skipped.
fn results(events: &[BatchEvent]) -> Vec<&Ended> {
    let mut last: Vec<&Ended> = Vec::new();
    for event in events {
        let BatchEvent::Ended(ended) = event else { continue };
        last.retain(|other| other.serial != ended.serial);
        last.push(ended);
    }
    last.into_iter().filter(|ended| !ended.reference).collect()
}

#[test]
fn every_number_of_the_page_is_that_of_the_events() {
    let bench = TestFolder::new();
    let events = write(&bench.path("june"), &MONTH, &shipped_text("rigs/batch.toml"));
    fs::create_dir_all(bench.path("june/runs/S-00003")).expect("a folder");
    bench.write("june/runs/S-00003/report.html", "a page");
    let output = bench.palpate_ends(0, "batch report june").out;
    let page = bench.read("june/report.html");
    let numbers = numbers(&page);

    let results = results(&events);
    let accepted = results.iter().filter(|ended| ended.verdict == Some(SensorVerdict::Accepted)).count();
    let judged = results.iter().filter(|ended| ended.verdict.is_some()).count();
    assert_eq!((judged, results.len()), (118, 119), "one tripped, one skipped");
    assert_eq!((numbers["accepted"], numbers["judged"]), (accepted as f64, judged as f64));
    assert_eq!(numbers["yield"], accepted as f64 / judged as f64);
    assert!(numbers["yield.low"] < 100.0 * numbers["yield"] && numbers["yield.high"] > 100.0 * numbers["yield"]);
    assert_eq!((numbers["standing.tripped"], numbers["standing.skipped"], numbers["sensors"]), (1.0, 1.0, 120.0));
    assert_eq!((numbers["attempts"], numbers["references"]), (120.0, 12.0));
    let alarms = events.iter().filter(|event| matches!(event, BatchEvent::Alarm(_))).count();
    assert_eq!((numbers["alarms.bench"], numbers["alarms.batch"]), (alarms as f64, 0.0));
    assert!(output.contains(&format!("{accepted} of 120 sensors accepted")), "{output}");

    for ended in &results {
        assert_eq!(numbers[&format!("{}.minutes", ended.serial)], ended.minutes);
        for found in &ended.found {
            let value = found.value.expect("measured");
            let displayed = if found.figure == "location_within" { 100.0 * value } else { value };
            assert_eq!(numbers[&format!("{}.{}", ended.serial, found.figure)], displayed);
        }
    }
    let calibrated: Vec<&&Ended> = results.iter().filter(|ended| !ended.change.is_empty()).collect();
    let of_first = |value: fn(&palpate_solver::UnitChange) -> f64| {
        calibrated.iter().map(|ended| value(&ended.change[0])).sum::<f64>() / calibrated.len() as f64
    };
    let is_near = |one: f64, other: f64| assert!((one - other).abs() < 1e-9, "{one} {other}");
    is_near(numbers["output.1.gain"], 100.0 * (of_first(|change| change.gain) - 1.0));
    is_near(numbers["output.1.x_mm"], of_first(|change| change.x_mm));
    let used = |ended: &Ended| {
        let part = |bound: f64, within: f64| (bound / 0.6).max((1.0 - within) / (1.0 - WITHIN));
        part(ended.found[0].bound.expect("guarded"), ended.found[1].bound.expect("guarded"))
    };
    let worst = calibrated.iter().max_by(|one, other| used(one).total_cmp(&used(other))).expect("a sensor");
    is_near(numbers[&format!("{}.used", worst.serial)], used(worst));

    assert!(page.contains("href=\"runs/S-00003/report.html\"") && page.matches(" href=").count() == 2, "icon and link");
    assert!(page.contains("Ada &lt;b&gt;") && !page.contains("Ada <b>"));
    assert!(page.contains(">limit 0.6 mm<") && page.contains("up to the 95 % bound") && page.contains(">bench<"));
    for title in ["Mean gain of each output", "Standard deviation of the gain", "Mean displacement", "Sensors a day"] {
        assert!(page.contains(title), "{title}");
    }
    assert!(!page.contains("<script") && !page.contains("http"), "self-contained");

    bench.palpate_ends(0, "batch report june --out page.html");
    assert!(bench.read("page.html").contains("href=\"june/runs/S-00003/report.html\""));
    bench.palpate_ends(0, "batch report june");
    assert_eq!(bench.read("june/report.html"), page, "the same journal gives the same bytes");
}

#[test]
fn a_batch_without_prior_rule_or_reference_has_what_is_known() {
    let bench = TestFolder::new();
    let drawn = Drawn { sensors: 12, outputs: 0, every: 0, guarded: false, ..MONTH };
    write(&bench.path("plain"), &drawn, "no rig");
    bench.palpate_ends(0, "batch report plain");
    let page = bench.read("plain/report.html");
    assert!(
        page.contains("Without a reference sensor") && !page.contains("95 % bound</") && !page.contains("Mean gain")
    );
    write(&bench.path("begun"), &Drawn { sensors: 0, ..drawn }, "no rig");
    bench.palpate_ends(0, "batch report begun");
    assert!(bench.read("begun/report.html").contains("No sensor has a verdict"));
    write(&bench.path("odd"), &Drawn { sensors: 12, outputs: 7, ..drawn }, &shipped_text("rigs/batch.toml"));
    bench.palpate_ends(0, "batch report odd");
    assert!(bench.read("odd/report.html").contains("so there is no map"));
}

#[test]
fn batches_are_compared_side_by_side() {
    let bench = TestFolder::new();
    let rig = shipped_text("rigs/batch.toml");
    let june = write(&bench.path("june"), &MONTH, &rig);
    let july = Drawn { name: "july", sensors: 60, drift: 0.0, seed: 2, ..MONTH };
    write(&bench.path("july"), &july, &rig);
    let output = bench.palpate_ends(0, "batch report --compare june july").out;
    assert!(output.starts_with("2 batches compared"), "{output}");
    let page = bench.read("comparison.html");
    let numbers = numbers(&page);
    let results = results(&june);
    let mut values: Vec<f64> = results.iter().filter_map(|ended| ended.found.first()?.value).collect();
    values.sort_by(f64::total_cmp);
    let median = 0.5 * (values[(values.len() - 1) / 2] + values[values.len() / 2]);
    assert!((numbers["1.location_mean_mm.median"] - median).abs() < 1e-12);
    assert_eq!((numbers["1.judged"], numbers["2.judged"]), (118.0, 58.0));
    assert!(numbers["1.alarms.bench"] > 0.0 && numbers["2.alarms.bench"] == 0.0);
    assert_eq!(numbers["2.location_mean_mm.limit"], 0.6);
    let lower = bench.palpate_ends(2, "batch report june july").err;
    assert!(lower.contains("add --compare"), "{lower}");
}

#[test]
fn a_page_replaces_only_a_page_and_needs_a_batch() {
    let bench = TestFolder::new();
    write(&bench.path("plain"), &Drawn { sensors: 2, ..MONTH }, "no rig");
    bench.write("mine.html", "mine");
    bench.palpate_ends(2, "batch report plain --out mine.html");
    assert_eq!(bench.read("mine.html"), "mine");
    let output = bench.palpate_ends(2, "batch report nowhere").err;
    assert!(output.contains("is not a batch folder"), "{output}");
}

#[test]
fn five_thousand_sensors_have_a_page_that_can_be_used() {
    let bench = TestFolder::new();
    // a thousand of them in the quick tier, whose page may be a fifth as large
    let sensors = campaign::size(1000, 5000);
    let year = Drawn { name: "year", sensors, drift: 0.0, ..MONTH };
    write(&bench.path("year"), &year, &shipped_text("rigs/batch.toml"));
    let output = bench.palpate_ends(0, "batch report year").out;
    let page = bench.read("year/report.html");
    let size_mb = page.len() as f64 / 1e6;
    println!("{sensors} sensors: {size_mb} MB");
    assert!(size_mb < LARGEST_MB * sensors as f64 / 5000.0, "{size_mb} MB: {output}");
    let before = page.find("<details").expect("closed tables");
    assert!(before < page.len() / 4, "{before} of {} bytes are seen at once", page.len());
    assert!(bench.palpate_ends(0, "batch status year").out.contains(&format!("{sensors} sensors")));
    // kept for a measurement of the time
    if let Some(kept) = std::env::var_os("PALPATE_KEEP_BATCH") {
        fs::rename(bench.path("year"), kept).expect("it can be moved");
    }
}
