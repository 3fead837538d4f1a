//! `palpate study`: a small one runs, says the same twice, and leaves rows and figures that another program can read.

mod support;

use serde_json::Value;
use std::collections::BTreeSet;
use support::Bench;

#[test]
fn a_small_study_leaves_rows_and_figures_and_is_the_same_twice() {
    let bench = Bench::new();
    let told = bench.palpate_ends(0, "study control --quick --out a --json");
    let rows = told.json_lines();
    assert_eq!(bench.read("a/rows.ndjson"), told.out);

    let text = |row: &Value, key: &str| row[key].as_str().unwrap_or_default().to_owned();
    let of = |part: &str| rows.iter().filter(|row| row["part"] == part).cloned().collect::<Vec<_>>();
    let scenes = of("scenes");
    let names: BTreeSet<String> = scenes.iter().map(|row| text(row, "scene")).collect();
    let each: BTreeSet<(String, String, String)> =
        scenes.iter().map(|row| (text(row, "rig"), text(row, "scene"), text(row, "strategy"))).collect();
    assert_eq!((names.len(), each.len(), scenes.len()), (13, 78, 78), "two benches, 13 scenes, three strategies");
    assert_eq!((of("tolerance").len(), of("mismatch").len(), of("caution").len()), (30, 12, 18));
    assert_eq!(of("stability").len(), 28);

    for row in rows.iter().filter(|row| row["part"] != "stability") {
        let (points, done, trips) = (row["points"].as_u64(), row["done"].as_u64(), row["trips"].as_u64());
        assert_eq!(row["rule"].is_null(), trips == Some(0), "{row}");
        assert_eq!(done == points, trips == Some(0), "{row}");
        for key in ["force_set_n", "tolerance_n", "bound_s"] {
            assert!(row[key].as_f64().is_some_and(|value| value > 0.0), "{key} in {row}");
        }
        for key in ["median_s", "p95_s", "ratio", "error_mean_mn", "error_p95_mn", "error_max_mn", "peak_over_mn"] {
            assert!(row[key].is_number() || done < Some(2), "{key} in {row}");
        }
    }
    assert_eq!(pareto(&of("tolerance")), pareto_again(&of("tolerance")));

    let figures: Vec<(String, Vec<u8>)> =
        bench.bytes("a").into_iter().filter(|(name, _)| name.ends_with(".svg")).collect();
    assert_eq!(figures.len(), 5);
    for (name, bytes) in &figures {
        is_well_formed(name, std::str::from_utf8(bytes).expect("an SVG is text"));
    }

    let told = bench.palpate_ends(0, "study control --quick --out b");
    assert!(told.out.lines().all(|line| line.chars().count() <= 80), "{}", told.out);
    assert_eq!(bench.bytes("a"), bench.bytes("b"));
}

#[test]
fn a_folder_that_is_there_is_not_touched() {
    let bench = Bench::with([("mine", "text")]);
    let told = bench.palpate_ends(2, "study control --quick --out mine");
    assert!(told.running().contains("mine is there already"), "{}", told.err);
    assert_eq!(bench.read("mine"), "text");
}

/// Which rows say that they are the best of their bench.
fn pareto(rows: &[Value]) -> Vec<bool> {
    rows.iter().map(|row| row["pareto"] == true).collect()
}

/// The same, recomputed from their numbers.
fn pareto_again(rows: &[Value]) -> Vec<bool> {
    let mark = |row: &Value| {
        let error_mn = row["error_p95_mn"].as_f64().filter(|_| row["rule"].is_null())?;
        Some((row["rig"].clone(), row["median_s"].as_f64()?, error_mn))
    };
    let beats = |other: &Value, (rig, s, mn): &(Value, f64, f64)| {
        mark(other).is_some_and(|(its_rig, its_s, its_mn)| {
            its_rig == *rig && its_s <= *s && its_mn <= *mn && (its_s, its_mn) != (*s, *mn)
        })
    };
    let best = |row: &Value| mark(row).is_some_and(|mark| !rows.iter().any(|other| beats(other, &mark)));
    rows.iter().map(best).collect()
}

/// Every element ends in the order they began, no number is lost, and there is something drawn.
fn is_well_formed(name: &str, svg: &str) {
    assert!(svg.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\"") && svg.ends_with("</svg>\n"), "{name}");
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{name}");
    assert!(svg.contains("prefers-color-scheme:dark") && svg.contains("class=\"axis\""), "{name}");
    let (mut open, mut rest) = (Vec::new(), svg);
    while let Some(start) = rest.find('<') {
        let end = rest[start..].find('>').unwrap_or_else(|| panic!("{name}: an element without an end")) + start;
        let element = &rest[start + 1..end];
        assert_eq!(element.matches('"').count() % 2, 0, "{name}: {element}");
        if let Some(ended) = element.strip_prefix('/') {
            assert_eq!(open.pop(), Some(ended), "{name}");
        } else if !element.ends_with('/') {
            open.extend(element.split_whitespace().next());
        }
        rest = &rest[end + 1..];
    }
    assert!(open.is_empty(), "{name}: {open:?} never end");
}
