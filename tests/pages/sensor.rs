//! The page of one sensor: its first screen, its units as in the array, and missing information.

use palpate_testing::TestFolder;
use palpate_testing::skins::FIFTEEN;

/// Five units of three channels, one in the middle of the other four.
const CHARACTERISE: &str = "
[[step]]
phase = \"characterisation\"
units = \"all\"
staircase = { to_n = 1.0, step_n = 0.5, repeats = 2 }
";
const CALIBRATE: &str = "
[[step]]
phase = \"calibration\"
grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 2.0 }
force_n = 1.0
";
const TEST: &str = "
[[step]]
phase = \"test\"
random = { count = 10, x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], force_n = [0.2, 1.0] }
";

/// A folder with a run of these steps, called `run`, and its page.
fn page_of(steps: &[&str]) -> (TestFolder, String) {
    let recipe = format!("name = \"skin\"\nrig = \"rig.toml\"\n{}", steps.concat());
    let bench = TestFolder::with([("rig.toml", FIFTEEN), ("skin.toml", recipe.as_str())]);
    bench.palpate_ends(0, "run skin.toml --out run");
    bench.palpate_ends(0, "report run --figures figures");
    let page = bench.read("run/report.html");
    (bench, page)
}

#[test]
fn errors_and_places_come_first_and_each_unit_is_where_the_array_has_it() {
    let (bench, page) = page_of(&[CHARACTERISE, CALIBRATE, TEST]);
    let (verdict, rest) = page.split_once("<h2>").expect("a heading");
    assert!(verdict.contains("class=\"sides verdict\"") && rest.starts_with("Errors of the test presses</h2>"));
    let first = rest.split("<h2>").next().expect("a section");
    assert!(first.contains("<table>") && first.contains("Places by pearson") && first.contains("(best)"), "{first}");

    // a panel for each unit with a line for each channel and branch; the middle one is between the others
    let load = figure(&page, "Output of each unit against the force");
    let titles: Vec<(f64, f64, &str)> = texts(load).into_iter().filter(|text| text.2.starts_with("unit ")).collect();
    let names: Vec<&str> = titles.iter().map(|title| title.2).collect();
    assert_eq!(names, ["unit 4", "unit 5", "unit 1", "unit 2", "unit 3"]);
    let (columns, rows): (Vec<f64>, Vec<f64>) = titles.iter().map(|(x, y, _)| (*x, *y)).unzip();
    assert!(columns[0] < columns[2] && columns[2] < columns[1] && columns[0] == columns[3], "{columns:?}");
    assert!(rows[0] == rows[1] && rows[1] < rows[2] && rows[2] < rows[3], "{rows:?}");
    assert_eq!(load.matches("<polyline").count(), 5 * 3 * 2 + 3 * 2, "a line for each channel, and the legend");
    let (header, saved) = bench.table("figures/output-against-load.csv");
    assert_eq!(&header[..2], ["panel", "series"]);
    assert!(saved.iter().any(|row| row[0] == "unit 5" && row[1] == "channel 3, unloading"));

    // a map of each channel, and the places of units and calibration
    for channel in 1..=3 {
        let map = figure(&page, &format!("Output of channel {channel} of each unit for 1 N at each place"));
        assert_eq!(texts(map).iter().filter(|text| text.2.starts_with("unit ")).count(), 5);
    }
    let layout = figure(&page, "Units and calibrated places");
    assert!((1..=5).all(|unit| texts(layout).iter().any(|text| text.2 == unit.to_string())), "{layout}");
    assert_eq!(bench.table("figures/layout.csv").1.len(), 5 + 49);
    assert!(!page.contains('…'), "a text is cut");
}

#[test]
fn a_long_table_shows_the_worst_and_folds_the_rest() {
    let (_, page) = page_of(&[CHARACTERISE]);
    let (_, rest) = page.split_once("<strong>Hysteresis</strong>").expect("a table");
    let (shown, folded) = rest.split_once("<details>").expect("a fold");
    let values = |text: &str| -> Vec<f64> {
        let rows = text.split("<th scope=\"row\">").skip(1).filter(|row| !row.starts_with("mean"));
        rows.map(|row| row.split("value=\"").nth(1).and_then(|v| v.split('"').next()).expect("a value"))
            .map(|value| value.parse().expect("a number"))
            .collect()
    };
    let folded = values(folded.split("</details>").next().expect("an end"));
    let shown = values(shown);
    assert_eq!((shown.len(), folded.len()), (6, 9));
    let least = shown.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(folded.iter().all(|value| *value <= least), "{shown:?} {folded:?}");
    assert!(page.contains("the other 9"));
}

#[test]
fn force_errors_keep_their_sign_and_unknown_uncertainty_has_a_reason() {
    let (bench, page) = page_of(&[CALIBRATE]);
    let (header, rows) = bench.table("run/presses.csv");
    let column = |name: &str| header.iter().position(|column| column == name).expect("a column");
    let (set, held) = (column("force_set_n"), column("force_n"));
    let number = |text: &str| text.parse::<f64>().expect("a number");
    let errors: Vec<f64> = rows.iter().map(|row| 1000.0 * (number(&row[held]) - number(&row[set]))).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let control = page.split("<h2>Force control</h2>").nth(1).expect("a section");
    assert!(mean < -1.0 && control.contains(&format!(">{mean:.1}</data>")), "{mean}");
    assert!(control.contains("from below"), "it says why");

    let budget = page.split("<h2>Uncertainty of the force</h2>").nth(1).and_then(|rest| rest.split("</table>").next());
    let budget = budget.expect("a table");
    assert!(budget.contains("not known") && budget.contains("the load cell was not checked"), "{budget}");
    assert!(!budget.contains("<td>-</td>"), "{budget}");
}

#[test]
fn a_calibration_without_a_test_has_cross_validated_errors() {
    let (bench, page) = page_of(&[CALIBRATE]);
    let found = bench.palpate_ends(0, "evaluate run --json").json_lines().remove(0);
    let candidates = found["cross_validated"].as_array().expect("candidates");
    let section = page.split("<h2>Cross-validated errors of the calibration</h2>").nth(1).expect("a section");
    for candidate in candidates.iter().filter(|candidate| candidate["location_error_mm"].is_number()) {
        let solver = candidate["solver"].as_str().expect("a name");
        let value = format!("value=\"{}\" data-key=\"{solver}.location_error_mm\"", candidate["location_error_mm"]);
        assert!(section.contains(&value), "{value}");
    }
    assert!(section.contains("No test presses"));
}

/// The picture with this title.
fn figure<'a>(page: &'a str, title: &str) -> &'a str {
    let (_, rest) = page.split_once(&format!("aria-label=\"{title}\"")).unwrap_or_else(|| panic!("no {title}"));
    rest.split("</svg>").next().expect("an end")
}

/// The level texts of a picture, with their places.
fn texts(figure: &str) -> Vec<(f64, f64, &str)> {
    let text = |element: &'_ str| {
        let at = |name: &str| element.split(&format!(" {name}=\"")).nth(1)?.split('"').next()?.parse::<f64>().ok();
        Some((at("x")?, at("y")?))
    };
    let all = figure.split("<text ").skip(1);
    all.filter_map(|rest| {
        let (element, output) = rest.split_once('>')?;
        let (x, y) = text(element)?;
        Some((x, y, output.split("</").next()?))
    })
    .collect()
}
