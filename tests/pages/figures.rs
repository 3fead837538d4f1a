//! `palpate report --figures`: each figure of a page as a file with its numbers; and rules for every figure.

use palpate_testing::TestFolder;
use serde_json::Value;

const RECIPE: &str = r#"
name = "small"
rig = "sim"

[[step]]
phase = "characterisation"
units = [1, 5]
staircase = { to_n = 2.0, step_n = 0.5, repeats = 3 }

[[step]]
phase = "calibration"
grid = { x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], spacing_mm = 1.0 }
force_n = 1.0

[[step]]
phase = "test"
random = { count = 12, x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], force_n = [0.1, 1.0] }
"#;

/// A bench with a run of everything, called `all`.
fn bench() -> TestFolder {
    let bench = TestFolder::with([("all.toml", RECIPE)]);
    bench.palpate_ends(0, "run all.toml --out all --sensor A-1");
    bench
}

#[test]
fn every_figure_is_saved_with_its_numbers() {
    let bench = bench();
    let output = bench.palpate_ends(0, "report all --figures figures").out;
    assert!(output.ends_with("\nfigures: 14 figures, each as SVG and CSV\n"), "{output}");
    let page = bench.read("all/report.html");
    assert_eq!(page.matches("<svg ").count(), 14);
    let files = bench.bytes("figures");
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    let stems = [
        "errors-against-edge",
        "errors-against-force",
        "expected-location-error",
        "force-errors",
        "layout",
        "location-errors",
        "locations-best",
        "locations-pearson",
        "output-against-load",
        "output-by-place",
        "press-force-errors",
        "press-overshoots",
        "press-times",
        "press-zero-drift",
    ];
    let expected: Vec<String> = stems.iter().flat_map(|stem| [format!("{stem}.csv"), format!("{stem}.svg")]).collect();
    assert_eq!(names, expected);
    for (name, bytes) in &files {
        let text = std::str::from_utf8(bytes).expect("a text");
        let lines: Vec<&str> = text.lines().collect();
        if name.ends_with(".svg") {
            assert!(text.starts_with("<svg xmlns=\"http://www.w3.org/2000/svg\" width=") && text.ends_with("</svg>\n"));
            assert!(text.contains("<style>") && text.contains("class=\"sheet\"") && text.contains("class=\"title\""));
            // light for every reader, and nothing from elsewhere
            assert!(
                !text.contains("prefers-color-scheme") && !text.contains("url(") && !text.contains("NaN"),
                "{name}"
            );
        } else {
            let columns = lines[0].split(',').count();
            assert!(columns >= 3 && lines.len() > 5, "{name}: {text}");
            let is_column = |name: &str| name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_');
            assert!(lines[0].split(',').all(is_column), "{name}: {}", lines[0]);
            assert!(!text.contains("NaN") && !text.contains("inf"), "{name}");
        }
    }
    // again: the same bytes replace our files
    bench.palpate_ends(0, "report all --figures figures");
    assert_eq!(bench.bytes("figures"), files);
}

#[test]
fn the_numbers_of_a_figure_are_those_of_evaluate() {
    let bench = bench();
    bench.palpate_ends(0, "report all --figures figures");
    for (stem, solver) in [("pearson", "pearson"), ("best", "best")] {
        let evaluation =
            bench.palpate_ends(0, &format!("evaluate all --json --solver {solver}")).json_lines().remove(0);
        let (header, rows) = bench.table(&format!("figures/locations-{stem}.csv"));
        assert_eq!(header[0], "test_press");
        let errors: Vec<f64> = rows.iter().map(|row| row[5].parse().expect("a number")).collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let expected = evaluation.pointer("/location_error_mm/mean").and_then(Value::as_f64).expect("a mean");
        assert!((mean - expected).abs() < 1e-9 && rows.len() == 12, "{stem}: {mean} and {expected}");
        for row in &rows {
            let at: Vec<f64> = row[1..].iter().map(|cell| cell.parse().expect("a number")).collect();
            assert!(((at[0] - at[2]).hypot(at[1] - at[3]) - at[4]).abs() < 1e-9, "{row:?}");
        }
    }
}

#[test]
fn a_file_that_is_not_ours_stays() {
    for (name, text) in [("location-errors.svg", "<svg>mine</svg>"), ("location-errors.csv", "mine")] {
        let bench = bench();
        std::fs::create_dir(bench.path("figures")).expect("a folder");
        bench.write(&format!("figures/{name}"), text);
        let output = bench.palpate_ends(2, "report all --figures figures").running();
        assert!(output.contains(&format!("{name} already exists")) && output.contains("another --figures"), "{output}");
        assert_eq!(bench.read(&format!("figures/{name}")), text);
        let files: Vec<String> = bench.bytes("figures").into_iter().map(|(name, _)| name).collect();
        assert_eq!(files, [name], "nothing is written beside it");
        assert!(!bench.has("all/report.html"), "nor the page");
    }
    let bench = bench();
    bench.write("file", "mine");
    bench.palpate_ends(2, "report all --figures file");
    assert_eq!(bench.read("file"), "mine");
}

#[test]
fn a_comparison_names_sensors_and_days_and_is_saved_too() {
    let bench = bench();
    bench.palpate_ends(0, "run all.toml --out s2 --seed 2 --sensor A-2");
    bench.palpate_ends(0, "run all.toml --out s3 --seed 3");
    let output = bench.palpate_ends(0, "report --compare all s2 s3 --figures figures").out;
    assert!(output.ends_with("\nfigures: 3 figures, each as SVG and CSV\n"), "{output}");
    let page = bench.read("comparison.html");
    let day = bench.manifest("s2")["sessions"][0]["started"].as_str().expect("a time")[..10].to_owned();
    let figures: Vec<&str> = figures(&page);
    assert_eq!(figures.len(), 3);
    for figure in figures {
        let texts = texts(figure);
        for name in ["A-1", "A-2", "s3"] {
            assert!(texts.contains(&name), "{name} in {texts:?}");
        }
        assert_eq!(texts.iter().filter(|text| text.starts_with(&day)).count(), 3, "{day} in {texts:?}");
        assert!(!texts.contains(&"run"), "{texts:?}");
    }
    let (header, rows) = bench.table("figures/location-errors.csv");
    assert_eq!(header, ["sensor", "run", "began", "solver", "location_error_mean_mm", "location_error_p95_mm"]);
    assert_eq!((rows.len(), &*rows[1][0], &*rows[1][1], &*rows[2][0]), (6, "A-2", "s2", ""));
    assert_eq!(bench.table("figures/output-changes.csv").1.len(), 3 * 9);
}

#[test]
fn colours_have_a_bar_with_numbers_and_a_unit() {
    let bench = bench();
    bench.palpate_ends(0, "report all");
    let page = bench.read("all/report.html");
    let coloured: Vec<&str> = figures(&page).into_iter().filter(|figure| figure.contains("\"c15\"")).collect();
    assert_eq!(coloured.len(), 2);
    for (figure, name) in coloured.into_iter().zip(["output, V", "expected location error, mm"]) {
        // the bar comes after all cells; its numbers after all others
        let texts = texts(figure);
        assert!(texts.contains(&name), "{texts:?}");
        let numbers = texts.iter().rev().take_while(|text| text.parse::<f64>().is_ok()).count();
        assert!(numbers >= 3, "{texts:?}");
        for level in 0..16 {
            assert!(figure.contains(&format!("class=\"c{level}\"")), "colour {level}");
        }
    }
    assert!(!page.contains("class=\"ramp\""));
}

#[test]
fn true_places_look_alike_and_fractions_have_their_own_panels() {
    let bench = bench();
    bench.palpate_ends(0, "report all");
    let page = bench.read("all/report.html");
    let places: Vec<&str> = figures(&page).into_iter().filter(|figure| figure.contains("\"Places by ")).collect();
    assert_eq!(places.len(), 2);
    for figure in &places {
        assert_eq!(figure.matches("<circle class=\"ink mark hollow\"").count(), 12 + 1, "12 presses and the legend");
        assert!(texts(figure).contains(&"true"));
    }
    for name in ["Location errors", "Force errors"] {
        let figure = figures(&page).into_iter().find(|figure| figure.contains(&format!("\"{name}\""))).expect(name);
        assert_eq!(figure.matches("class=\"axis\"").count(), 2, "{name}: two panels");
        let texts = texts(figure);
        assert!(texts.contains(&"share of the presses, %") && texts.contains(&"cumulative share, %"), "{texts:?}");
    }
}

/// Three presses with a light force and three with a strong one: nothing was measured between.
#[test]
fn no_line_is_drawn_where_nothing_was_measured() {
    let at = |force_n: &str| {
        format!(
            "\n[[step]]\nphase = \"test\"\nlist = {{ places_mm = [[-3, 1], [1, 2], [3, -1]] }}\nforce_n = {force_n}\n"
        )
    };
    let (recipe, _) = RECIPE.split_once("\n[[step]]\nphase = \"test\"").expect("a test");
    let bench = TestFolder::with([("gap.toml", format!("{recipe}{}{}", at("0.2"), at("1.8")).as_str())]);
    bench.palpate_ends(0, "run gap.toml --out gap");
    bench.palpate_ends(0, "report gap --figures figures");
    let page = bench.read("gap/report.html");
    let figure = figures(&page).into_iter().find(|figure| figure.contains("\"Errors against the force\"")).expect("it");
    let legend = texts(figure).iter().filter(|text| text.contains("pearson") || text.contains("best")).count();
    assert_eq!(figure.matches("<polyline").count(), legend, "only the legend has lines");
    let (header, rows) = bench.table("figures/errors-against-force.csv");
    let column = |name: &str| header.iter().position(|column| column == name).unwrap_or_else(|| panic!("{header:?}"));
    let (from, to) = (column("force_from_n"), column("force_to_n"));
    let bars: Vec<[f64; 2]> = rows
        .iter()
        .filter(|row| !row[from].is_empty())
        .map(|row| [from, to].map(|column| row[column].parse().expect("a number")))
        .collect();
    assert!(!bars.is_empty());
    for [from, to] in bars {
        assert!(to - from < 0.4 && (from <= 0.2 || to >= 1.75), "a mean from {from} to {to} N");
    }
}

/// The pictures of a page.
fn figures(page: &str) -> Vec<&str> {
    page.split("<svg ").skip(1).map(|rest| rest.split("</svg>").next().expect("an end")).collect()
}

/// The texts of a picture, in the order in which they are written.
fn texts(figure: &str) -> Vec<&str> {
    let texts = figure.split("<text ").skip(1);
    texts.map(|rest| rest.split_once('>').and_then(|(_, rest)| rest.split("</").next()).expect("a text")).collect()
}
