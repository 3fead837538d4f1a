//! The page of a run with drags: the forces along the surface as arrows, with the numbers of `evaluate --vector`.

use palpate_testing::TestFolder;
use palpate_testing::executions::rig_with_drags;
use serde_json::Value;

/// Test presses: of the first number not all have an arrow.
const MANY: usize = 70;
const FEW: usize = 3;

/// A folder with a run of calibrated places, and its page. Each place is pressed once for each of two directions.
fn page_of(places: &str, calibrated: &str, tests: usize, tested: &str) -> (TestFolder, String) {
    let recipe = format!(
        "name = \"vectors\"\nchecks = \"none\"\n[[step]]\nphase = \"calibration\"\n{places}\nforce_n = 1.0\n{calibrated}\n\
         [[step]]\nphase = \"test\"\nrandom = {{ count = {tests}, x_mm = [-3.0, 3.0], y_mm = [-3.0, 3.0] }}\nforce_n = 1.0\n{tested}\n"
    );
    let bench = TestFolder::with([("rig.toml", &*rig_with_drags()), ("vectors.toml", &*recipe)]);
    bench.palpate_ends(0, "run vectors.toml --rig rig.toml --simulate --durability fast --out run");
    bench.palpate_ends(0, "report run --figures figures");
    let page = bench.read("run/report.html");
    (bench, page)
}

const GRID: &str = "grid = { x_mm = [-3.0, 3.0], y_mm = [-3.0, 3.0], spacing_mm = 2.0 }";
const DRAG: &str = "drag = { mm = 0.4, directions_deg = [0, 90] }";
const TEST_DRAG: &str = "drag = { mm = 0.3, directions_deg = [45] }";

#[test]
fn forces_along_the_surface_are_arrows_with_the_errors_of_evaluate() {
    let (bench, page) = page_of(GRID, DRAG, MANY, TEST_DRAG);
    let errors = bench.palpate_ends(0, "evaluate run --vector --json").json_lines().remove(0);
    let section = page.split("<h2>Force vectors of the test presses</h2>").nth(1).expect("a section");
    let section = section.split("<h2>").next().expect("an end");
    for (key, digits) in [("location_mm", 3), ("press_n", 4), ("shear_n", 4)] {
        let [mean, p95] = [0, 1].map(|index| errors[key][index].as_f64().expect("a number"));
        let cell = |value: f64| format!("<data value=\"{value}\" data-key=\"vector.{key}\">{value:.digits$}</data>");
        assert!(section.contains(&cell(mean)) && section.contains(&cell(p95)), "{key} {mean} {p95}: {section}");
        let caption = section.split("<figcaption>").nth(1).and_then(|rest| rest.split("</figcaption>").next());
        assert!(caption.expect("one").contains(&format!(" {mean:.digits$} ")), "{caption:?}");
    }
    assert_eq!(errors["presses"], Value::from(2 * MANY), "before the drag and after it");

    // one window after a drag in each part of the area
    let (head, rows) = bench.table("figures/force-vectors.csv");
    assert!(section.contains(&format!("of the area is shown, {} of {MANY}.", rows.len())), "{section}");
    assert!((30..=64).contains(&rows.len()), "{}", rows.len());
    let at = |name: &str| head.iter().position(|column| column == name).expect("a column");
    for (axis, row) in ["x", "y"].into_iter().flat_map(|axis| rows.iter().map(move |row| (axis, row))) {
        let [is, found] = ["true", "predicted"].map(|which| row[at(&format!("force_{which}_{axis}_n"))].parse::<f64>());
        let (is, found) = (is.expect("a number"), found.expect("a number"));
        assert!((is - 0.2).abs() < 0.1 && (found - is).abs() < 0.3, "{is} and {found}");
    }
    for (hue, arrows) in [("ink", rows.len()), ("orange", rows.len()), ("grey", 1)] {
        let path = section.split(&format!("<path class=\"{hue} bar\" d=\"")).nth(1).expect("arrows");
        assert_eq!(path.split('"').next().expect("an end").matches('M').count(), 3 * arrows, "{hue}");
    }
    assert!(section.contains(" N</text>"), "the scale");

    // a place counts once, and a press with a drag has its time
    assert!(page.contains(">16 calibrated places<") && page.contains("16 presses, one at each place"));
    assert!(page.contains("<strong>Time of each press</strong>") && page.contains("includes its drag"));
}

#[test]
fn a_page_says_why_there_are_no_force_vectors() {
    let (_, page) = page_of("list = { places_mm = [[0.0, 0.0], [2.0, -2.0]] }", DRAG, FEW, TEST_DRAG);
    assert!(page.contains("The force vectors can't be solved: the presses are at 2 places, the map requires"));
    assert!(!page.contains("Force along the surface"));
}

#[test]
fn without_drags_there_are_no_arrows_of_solved_forces() {
    let (_, page) = page_of(GRID, "", FEW, "");
    assert!(!page.contains("Force vectors") && !page.contains("drag"));
    // a test with drags alone doesn't show the effect of a force along the surface
    let (bench, page) = page_of(GRID, "", FEW, TEST_DRAG);
    assert!(page.contains("The outputs don't determine the force along the surface: 6 windows."));
    assert!(bench.table("figures/force-vectors.csv").1.iter().all(|row| !row[2].is_empty() && row[6].is_empty()));
}
