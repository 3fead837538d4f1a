//! `palpate report` as its user sees it: a page has the numbers of `evaluate`, and needs nothing else.

use palpate_testing::interrupted::sealed;
use palpate_testing::{CommandOutput, TestFolder, exchanged, shipped_text};
use serde_json::Value;
use std::collections::BTreeMap;

/// Staircases, a calibration and a test, each small.
const CHARACTERISE: &str = "
[[step]]
phase = \"characterisation\"
units = [1, 5]
staircase = { to_n = 2.0, step_n = 0.5, repeats = 3 }
";
const CALIBRATE: &str = "
[[step]]
phase = \"calibration\"
grid = { x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], spacing_mm = 1.0 }
force_n = 1.0
";
const TEST: &str = "
[[step]]
phase = \"test\"
random = { count = 12, x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], force_n = [0.1, 1.0] }
";

const ACCEPT: &str = "
[accept]
location_mean_mm = 1.0
force_mean_n = 0.1
";

fn recipe(steps: &[&str]) -> String {
    format!("name = \"small\"\nrig = \"sim\"\n{}", steps.concat())
}

/// A folder with a complete run, called `all`.
fn bench() -> TestFolder {
    let bench = TestFolder::with([("all.toml", recipe(&[CHARACTERISE, CALIBRATE, TEST, ACCEPT]).as_str())]);
    bench.palpate_ends(0, "run all.toml --out all");
    bench
}

#[test]
fn every_number_of_a_page_is_that_of_evaluate() {
    let bench = bench();
    let output = bench.palpate_ends(0, "report all");
    assert!(output.out.starts_with("all: accepted, ") && output.out.contains("all/report.html: "), "{}", output.out);
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    let page = bench.read("all/report.html");
    let shown = numbers(&page);
    for (key, value, words) in data(&page) {
        assert!(is_reported(value, &words), "{key} is {value}, and a person reads {words}");
    }
    has_the_runs_characteristics(&bench, &page);
    for (name, solver) in [("pearson", "pearson"), ("best", "best")] {
        let evaluation =
            bench.palpate_ends(0, &format!("evaluate all --json --solver {solver}")).json_lines().remove(0);
        let of_it: Vec<(&String, &f64)> =
            shown.iter().filter(|(key, _)| key.starts_with(&format!("{name}."))).collect();
        assert!(of_it.len() >= 16, "{name}: {of_it:?}");
        for (key, value) in of_it {
            let path = format!("/{}", key[name.len() + 1..].replace('.', "/"));
            assert_eq!(evaluation.pointer(&path).and_then(Value::as_f64), Some(*value), "{key}");
        }
        if let Some(chosen @ ("physics" | "surrogate")) = evaluation["solver"].as_str() {
            assert!(page.contains(&format!("by {chosen}, at the median force of the test")), "{chosen}");
        }
        let decisive = evaluation["location_error_mm"]["mean"].as_f64().unwrap();
        assert!(page.contains(&format!("{decisive:.3}")), "{decisive}");
    }
}

/// Every characteristic of the page (repeatability by 3 sd) is that of the run's `characteristics.csv`.
fn has_the_runs_characteristics(bench: &TestFolder, page: &str) {
    let (header, mut rows) = bench.table("all/characteristics.csv");
    rows.retain(|row| !row[1].is_empty());
    assert_eq!(rows.len(), 2, "{rows:?}");
    // the table, which of its numbers, the paper's numbers if there are some, and the column of the run
    for (title, place, column) in [
        ("Repeatability, loading", 0, "repeatability_loading_percent"),
        ("Repeatability, loading", 1, "repeatability_loading_least_percent"),
        ("Repeatability, loading", 2, "repeatability_loading_most_percent"),
        ("Repeatability, unloading", 0, "repeatability_unloading_percent"),
        ("Repeatability, unloading", 1, "repeatability_unloading_least_percent"),
        ("Repeatability, unloading", 2, "repeatability_unloading_most_percent"),
        ("Hysteresis", 0, "hysteresis_percent"),
        ("Hysteresis", 1, "hysteresis_of_reading_percent"),
        ("Linearity and zero return", 0, "linearity_percent"),
        ("Linearity and zero return", 1, "zero_return_percent"),
    ] {
        let column = header.iter().position(|name| name == column).unwrap_or_else(|| panic!("{column} in {header:?}"));
        let table = page.split(&format!("<strong>{title}</strong>")).nth(1).unwrap().split("</table>").next().unwrap();
        for row in &rows {
            let line = table.split("<tr>").find(|line| line.contains(&format!("<th scope=\"row\">{}</th>", row[0])));
            let line = line.unwrap_or_else(|| panic!("{title}: no unit {} in {table}", row[0]));
            let ours = data(line).nth(place).unwrap_or_else(|| panic!("{title}: {line}")).1;
            // the table has four decimals
            assert!((ours - row[column].parse::<f64>().unwrap()).abs() < 6e-5, "{title}, unit {}: {ours}", row[0]);
        }
    }
}

#[test]
fn page_is_self_contained_and_reproducible() {
    let bench = bench();
    bench.palpate_ends(0, "report all");
    let page = bench.read("all/report.html");
    for foreign in ["http:", "https:", "<script", "url(", " src=", "@import", "NaN", "inf ", "inf<"] {
        assert!(!page.contains(foreign), "{foreign} is in the page");
    }
    assert_eq!(page.matches("<link").count(), page.matches("href=\"data:,\"").count());
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
    for figure in figures(&page) {
        assert!(has_data(figure), "nothing is drawn in {figure}");
    }
    let titles = [
        "Errors of the test presses",
        "Characteristics of each unit",
        "Output of each unit, by load and by place",
        "Distribution of the errors",
        "Errors against the force and against the distance from the edge",
        "Expected location error",
        "Force control",
        "Devices, program and files",
    ];
    for title in titles {
        assert!(page.contains(&format!("<h2>{title}</h2>")), "{title}");
    }
    for other in ["Figure ", "Table ", "paper"] {
        assert!(!page.contains(other), "{other} is in the page");
    }
    assert_eq!(
        figures(&page).len(),
        14,
        "two of places, three of the units, errors, dependences, one map, four records"
    );
    bench.palpate_ends(0, "report all --out again.html");
    assert_eq!(bench.read("again.html"), page);
    bench.palpate_ends(0, "verify all");
}

#[test]
fn three_runs_of_a_sensor_make_the_page_of_one() {
    let bench = bench();
    for (name, step) in [("characterise", CHARACTERISE), ("calibrate", CALIBRATE), ("test", TEST)] {
        bench.write("one.toml", &recipe(&[step]));
        bench.palpate_ends(0, &format!("run one.toml --out {name} --sensor A-7 --design A<7>&co"));
    }
    bench.palpate_ends(0, "report characterise calibrate test --out page.html");
    let page = bench.read("page.html");
    assert_eq!(figures(&page).len(), 14);
    assert!(page.contains("Sensor A-7") && page.contains("A&lt;7&gt;&amp;co") && !page.contains("A<7>"));
    let output = bench.palpate_ends(2, "report all test --same-sensor --out other.html").running();
    assert!(output.contains("all and test both have test presses"), "{output}");
    let four = exchanged(&shipped_text("rigs/sim.toml"), "rows = 3, columns = 3", "rows = 2, columns = 2");
    let four = four.lines().filter(|line| !line.contains("_percent")).collect::<Vec<_>>().join("\n");
    bench.write("four.toml", &four);
    bench.palpate("run one.toml --rig four.toml --out four");
    let output = bench.palpate_ends(2, "report calibrate four --same-sensor --out other.html").running();
    assert!(output.contains("calibrate has 9 units, four has 4"), "{output}");
    assert!(!bench.has("other.html"));
}

#[test]
fn a_part_of_a_run_has_the_page_of_that_part() {
    let bench = TestFolder::new();
    for (name, steps, has, lacks) in [
        ("characterise", vec![CHARACTERISE], "Output of each unit against the force", "Errors of the test presses"),
        ("calibrate", vec![CALIBRATE], "Output of each unit for 1 N at each place", "Places by"),
        ("test", vec![TEST], "Force control", "Places by"),
    ] {
        bench.write("one.toml", &recipe(&steps));
        bench.palpate_ends(0, &format!("run one.toml --out {name}"));
        let output = bench.palpate_ends(0, &format!("report {name}"));
        assert!(output.out.contains("not evaluated"), "{}", output.out);
        let page = bench.read(&format!("{name}/report.html"));
        assert!(page.contains(has) && !page.contains(lacks) && page.contains("No verdict"), "{name}");
        assert!(figures(&page).into_iter().all(has_data), "{name}");
    }
}

#[test]
fn interrupted_run_is_reported_first() {
    let bench = TestFolder::with([
        ("soft.toml", exchanged(&shipped_text("rigs/sim.toml"), "linear_n_mm = 1.1", "linear_n_mm = 0.2").as_str()),
        ("all.toml", &recipe(&[CALIBRATE, TEST])),
    ]);
    bench.palpate_ends(4, "run all.toml --rig soft.toml --out tripped");
    let output = bench.palpate_ends(0, "report tripped");
    assert!(output.out.contains("not evaluated"), "{}", output.out);
    let page = bench.read("tripped/report.html");
    let rule = bench.manifest("tripped")["trip"]["rule"].as_str().unwrap().to_owned();
    assert!(page.contains("tripped is tripped: 0 of 93 presses") && page.contains(&rule), "{rule}");
    assert!(page.contains("verdict bad"));
}

#[test]
fn a_sensors_name_can_be_printed() {
    let bench = TestFolder::with([("one.toml", recipe(&[TEST]).as_str())]);
    // a look-alike ID would be another sensor: IDs follow the rule of a batch
    for name in ["\u{1b}[2Jx", "a\nb", " ", &"x".repeat(65), "A\u{200b}-7", "\u{410}-7", "A<7>&co"] {
        let printed = bench.command("run one.toml --out one --sensor").arg(name).output().expect("the program starts");
        assert_eq!(printed.status.code(), Some(2), "{name:?}");
        assert!(String::from_utf8_lossy(&printed.stderr).contains("expected 1 to 64 letters, digits,"), "{name:?}");
        assert!(!bench.has("one"));
    }
}

#[test]
fn a_crafted_sensor_id_reaches_no_terminal_and_no_file() {
    let bench = TestFolder::with([("all.toml", recipe(&[CALIBRATE, TEST]).as_str())]);
    bench.palpate_ends(0, "run all.toml --out run --sensor A-7 --note clean");
    let owned = "\\u001b]0;owned\\u0007";
    let journal = bench.read("run/journal.log");
    let first = journal.lines().next().and_then(|line| line.splitn(3, ' ').nth(2)).expect("a record");
    let crafted = exchanged(first, "\"sensor\":\"A-7\"", &format!("\"sensor\":\"{owned}\""));
    let crafted = exchanged(
        &exchanged(&crafted, "\"clean\"", &format!("\"{owned}\"")),
        "\"recipe\":\"",
        &format!("\"recipe\":\"{owned}"),
    );
    let rest: String = journal.lines().skip(1).map(|line| format!("{line}\n")).collect();
    bench.write("run/journal.log", &format!("{}\n{rest}", sealed(0, &crafted)));
    std::fs::remove_file(bench.path("run/manifest.json")).expect("a manifest");
    for (words, file) in [
        ("rebuild run", "run/manifest.json"),
        ("report run", "run/report.html"),
        ("report --compare run run --out pages.html", ""),
        ("certificate run --with c.toml", ""),
        ("evaluate run --solver pearson", ""),
        ("fit run --solver pearson --out s.palpate", "s.palpate"),
        ("export --model s.palpate --format c --out s.c", "s.c"),
        ("solve --model s.palpate", ""),
        ("verify run", ""),
        ("resume run", ""),
    ] {
        let output = bench.palpate(words);
        let is_shown = |text: &[u8]| !text.contains(&0x1b) && !text.contains(&0x07);
        assert!(is_shown(output.out.as_bytes()) && is_shown(output.err.as_bytes()), "{words}: {output:?}");
        if !file.is_empty() {
            assert_eq!(output.code.map(|code| code < 2), Some(true), "{words}: {}", output.err);
            let bytes = std::fs::read(bench.path(file)).expect("a file");
            // the model of a sensor file isn't text, but its head is
            let lines = if file == "s.palpate" { 2 } else { usize::MAX };
            let text = bytes.split(|byte| *byte == b'\n').take(lines).collect::<Vec<_>>().join(&b'\n');
            assert!(is_shown(&text) && !String::from_utf8_lossy(&text).contains("u001b"), "{file}");
        }
    }
    assert!(bench.read("run/report.html").contains("\u{fffd}]0;owned"), "what is left of it is shown");
}

#[test]
fn only_a_page_of_ours_is_replaced() {
    let bench = TestFolder::with([("one.toml", recipe(&[CHARACTERISE]).as_str()), ("mine.html", "text")]);
    bench.palpate_ends(0, "run one.toml --out one");
    let output = bench.palpate_ends(2, "report one --out mine.html").running();
    assert!(output.contains("mine.html already exists"), "{output}");
    assert_eq!(bench.read("mine.html"), "text");
    bench.palpate_ends(0, "report one --out pages/one.html");
    bench.palpate_ends(0, "report one --out pages/one.html");
    let output = bench.palpate_ends(2, "report nowhere").running();
    assert!(output.contains("nowhere doesn't exist"), "{output}");
    bench.palpate_ends(2, "report one --solver physics"); // of a comparison only
    let files: Vec<String> = bench.bytes("pages").into_iter().map(|(name, _)| name).collect();
    assert_eq!(files, ["one.html"]);
}

#[test]
fn comparison_has_the_numbers_of_evaluate() {
    let bench = bench();
    for seed in [2, 3] {
        bench.palpate_ends(0, &format!("run all.toml --out s{seed} --seed {seed} --sensor A-{seed}"));
    }
    bench.write("one.toml", &recipe(&[CHARACTERISE]));
    bench.palpate_ends(0, "run one.toml --out part");
    let output = bench.palpate_ends(0, "report --compare all s2 s3 part").out;
    assert!(output.starts_with("4 runs compared, 3 accepted, 1 without a rule\n"), "{output}");
    let page = bench.read("comparison.html");
    let shown = numbers(&page);
    for (index, run) in ["all", "s2", "s3"].into_iter().enumerate() {
        for solver in ["pearson", "surrogate"] {
            let words = format!("evaluate {run} --json --solver {solver}");
            let evaluation = bench.palpate_ends(0, &words).json_lines().remove(0);
            for path in ["location_error_mm.mean", "force_error_n.mean", "within.both"] {
                let expected = evaluation.pointer(&format!("/{}", path.replace('.', "/"))).and_then(Value::as_f64);
                assert_eq!(
                    shown.get(&format!("{}.{solver}.{path}", index + 1)).copied(),
                    expected,
                    "{run} {solver} {path}"
                );
            }
        }
    }
    assert!(page.contains("part isn't evaluated: ") && page.contains("A-3"));
    assert_eq!(figures(&page).len(), 3);
    assert!(figures(&page).into_iter().all(has_data));
    let output = bench.palpate_ends(0, "report --compare all s2 --solver physics --out b.html").out;
    assert!(output.starts_with("2 runs compared, 2 accepted\n"), "{output}");
}

/// Steps at places of a list.
fn list(phase: &str, places_mm: &str, force_n: f64) -> String {
    format!("\n[[step]]\nphase = \"{phase}\"\nlist = {{ places_mm = {places_mm} }}\nforce_n = {force_n:?}\n")
}

#[test]
fn presses_on_one_line_or_at_one_place_make_a_page() {
    let line = list("calibration", "[[-4, 0], [-2, 0], [0, 0], [2, 0], [4, 0]]", 1.0);
    let on_line = list("test", "[[-3, 0], [1, 0], [3, 0]]", 0.5);
    let edge = list("test", "[[-4, 0], [4, 1], [3, 4], [0, -4]]", 0.5);
    let (place, on_place) = (list("calibration", "[[0, 0]]", 1.0), list("test", "[[0, 0]]", 1.0));
    let bench = TestFolder::new();
    for (name, steps) in [("line", [&*line, &on_line]), ("edge", [CALIBRATE, &edge]), ("place", [&place, &on_place])] {
        bench.write("one.toml", &recipe(&steps));
        bench.palpate_ends(0, &format!("run one.toml --out {name}"));
        // a figure whose places all have the same distance from the edge never ended
        bench.palpate_ends(0, &format!("report {name}"));
        let page = bench.read(&format!("{name}/report.html"));
        assert!(!page.contains("NaN") && !page.contains("inf\""), "{name}");
        assert!(!figures(&page).is_empty(), "{name}");
        // the panels of a line have room for one number each
        for figure in figures(&page).into_iter().filter(|_| name != "line") {
            let output: Vec<&str> =
                figure.split("class=\"end\"").skip(1).map(|rest| rest.split("</").next().unwrap()).collect();
            let [first, second, ..] = output.as_slice() else { panic!("{name}: an axis without numbers in {figure}") };
            assert_ne!(number_of(first), number_of(second), "{name}: {figure}");
        }
    }
    assert!(bench.read("edge/report.html").contains("distance from the edge"));
    // three errors of 1 mm: none is smaller, so the fraction rises at 1 mm
    let page = bench.read("line/report.html");
    let errors = figures(&page).into_iter().find(|figure| figure.contains("aria-label=\"Location errors\"")).unwrap();
    let lines: Vec<&str> = errors.split("<polyline ").skip(1).map(|rest| rest.split('>').next().unwrap()).collect();
    let corners: Vec<&str> = lines.last().unwrap().split("points=\"").nth(1).unwrap().split(' ').collect();
    let up = |corner: &str| corner.split_once(',').unwrap().1.trim_matches(['"', '/']).to_owned();
    assert_eq!(up(corners[0]), up(corners[1]), "{corners:?}");
}

/// Content of a text element.
fn number_of(element: &str) -> &str {
    element.rsplit('>').next().unwrap()
}

#[test]
fn outputs_of_many_forces_are_reported_per_newton() {
    let random = "
[[step]]
phase = \"calibration\"
random = { count = 40, x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], force_n = [0.5, 1.5] }
";
    let bench = TestFolder::new();
    for (name, steps) in [("random", vec![random]), ("two", vec![CALIBRATE, &CALIBRATE.replace("1.0\n", "0.5\n")])] {
        let last = steps.last().unwrap();
        assert!(name != "two" || last.contains("force_n = 0.5"), "{last}");
        bench.write("one.toml", &recipe(&steps));
        bench.palpate_ends(0, &format!("run one.toml --out {name}"));
        bench.palpate_ends(0, &format!("report {name}"));
        let page = bench.read(&format!("{name}/report.html"));
        assert!(page.contains("Output of each unit per newton, at each place") && page.contains("V/N"), "{name}");
        assert!(!page.contains("Output of each unit for 1"), "{name}");
    }
    assert!(bench.read("two/report.html").contains("162 presses of 0.5 to 1 N; one scale"));
}

#[test]
fn narrow_area_has_as_many_numbers_as_fit() {
    let strip = CALIBRATE.replace("y_mm = [-4.0, 4.0]", "y_mm = [-1.0, 1.0]");
    let bench = TestFolder::with([("one.toml", recipe(&[&strip]).as_str())]);
    bench.palpate_ends(0, "run one.toml --out one");
    bench.palpate_ends(0, "report one");
    let page = bench.read("one/report.html");
    let rows = figures(&page)[0].matches("class=\"end\"").count();
    assert!((3..=6).contains(&rows), "one or two in each of three rows: {rows}");
}

#[test]
fn run_is_named_by_its_folder_from_any_directory() {
    let bench = TestFolder::with([("one.toml", recipe(&[CHARACTERISE]).as_str())]);
    bench.palpate_ends(0, "run one.toml --out one");
    let mut command = bench.command("report .");
    let printed: CommandOutput = command.current_dir(bench.path("one")).output().expect("the program starts").into();
    assert_eq!(printed.code, Some(0), "{}", printed.err);
    assert!(printed.out.starts_with("one: no verdict, not evaluated"), "{}", printed.out);
    assert!(bench.read("one/report.html").contains("<h1>one</h1>"));
}

#[cfg(unix)]
#[test]
fn device_file_is_not_read_and_symlink_is_kept() {
    let bench = TestFolder::with([("one.toml", recipe(&[CHARACTERISE]).as_str()), ("file", "")]);
    bench.palpate_ends(0, "run one.toml --out one");
    // such a device gives zeros for ever
    let output = bench.palpate_ends(2, "report one --out /dev/zero").running();
    assert!(output.contains("/dev/zero already exists"), "{output}");
    bench.palpate_ends(0, "report one --out page.html");
    std::os::unix::fs::symlink("page.html", bench.path("link.html")).unwrap();
    bench.palpate_ends(0, "report one --out link.html");
    assert!(bench.path("link.html").symlink_metadata().unwrap().is_symlink());
    // a text that quotes a page isn't a page
    bench.write("quoting.txt", &format!("notes: {}", bench.read("page.html")));
    bench.palpate_ends(2, "report one --out quoting.txt");
    let output = bench.palpate_ends(5, "report one --out file/page.html").running();
    assert!(
        output.contains("writing the page file/page.html: ") && output.contains("choose another --out"),
        "{output}"
    );
    assert!(!output.contains("resume"), "{output}");
    bench.write(".page.html.new", "mine");
    bench.palpate_ends(0, "report one --out page.html");
    assert_eq!(bench.read(".page.html.new"), "mine");
}

#[test]
fn comparison_gives_the_reason_of_an_unevaluated_run() {
    let bench = bench();
    let (place, test) = (list("calibration", "[[0, 0]]", 1.0), TEST);
    let one = exchanged(&shipped_text("rigs/sim.toml"), "rows = 3, columns = 3", "rows = 1, columns = 1");
    let one = one.lines().filter(|line| !line.contains("_percent")).collect::<Vec<_>>().join("\n");
    bench.write("rig.toml", &one);
    bench.write("one.toml", &recipe(&[&place, test]));
    bench.palpate_ends(0, "run one.toml --rig rig.toml --out lone");
    bench.palpate_ends(0, "report --compare all lone");
    let page = bench.read("comparison.html");
    let reason = "1 calibration press at 1 place; a calibration needs at least 2 different places";
    assert!(page.contains(&format!("lone isn't evaluated: lone: {reason}")));
    let output = bench.palpate_ends(0, "report --compare all").out;
    assert!(output.starts_with("1 run compared, 1 accepted\n"), "{output}");
    assert!(bench.read("comparison.html").contains("<h1>1 run side by side</h1>"));
}

#[test]
fn page_uses_the_journal_and_reports_changed_tables() {
    let bench = bench();
    bench.palpate_ends(0, "report all");
    let page = bench.read("all/report.html");
    let presses = bench.read("all/presses.csv");
    bench.write("all/presses.csv", &exchanged(&presses, ",calibration,-4,-4,1,", ",calibration,-4,-4,2,"));
    let rig = bench.read("all/rig.toml");
    bench.write("all/rig.toml", &exchanged(&rig, "pitch_mm = 4.5", "pitch_mm = 4.0"));
    let output = bench.palpate_ends(0, "report all");
    assert!(output.err.contains("warning: all: presses.csv differs from the journal"), "{}", output.err);
    assert!(output.err.contains("warning: all: rig.toml has changed since it was written"), "{}", output.err);
    assert_eq!(bench.read("all/report.html"), page);
    std::fs::remove_file(bench.path("all/rig.toml")).unwrap();
    let output = bench.palpate_ends(0, "report all");
    assert!(output.err.contains("warning: all: rig.toml is missing"), "{}", output.err);
    assert_eq!(bench.read("all/report.html"), page);
    bench.palpate_ends(0, "rebuild all");
    assert_eq!((bench.read("all/rig.toml"), bench.read("all/presses.csv")), (rig, presses));
}

#[test]
fn only_matching_runs_are_joined_and_compared() {
    let bench = bench();
    bench.write("other.toml", &recipe(&[&CALIBRATE.replace("spacing_mm = 1.0", "spacing_mm = 2.0"), TEST]));
    bench.palpate_ends(0, "run other.toml --out other");
    bench.palpate_ends(0, "run all.toml --seed 2 --out again");
    bench.palpate_ends(0, "report --compare all other again");
    let page = bench.read("comparison.html");
    assert!(page.contains("1 run excluded: calibrated at other places or forces"), "units of unlike calibrations");
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "pitch_mm = 4.5", "pitch_mm = 4.0");
    bench.write("narrow.toml", &rig);
    bench.write("one.toml", &recipe(&[CHARACTERISE]));
    bench.palpate_ends(0, "run one.toml --rig narrow.toml --out narrow");
    let output = bench.palpate_ends(2, "report other narrow --same-sensor --out page.html").running();
    assert!(output.contains("other has 9 units, narrow has 9 at other places"), "{output}");
}

/// Content of the page's `data` elements with a key.
fn numbers(page: &str) -> BTreeMap<String, f64> {
    data(page).filter(|(key, ..)| !key.is_empty()).map(|(key, value, _)| (key, value)).collect()
}

/// The page's `data` elements: key, value, and visible text with its unit.
fn data(page: &str) -> impl Iterator<Item = (String, f64, String)> {
    page.split("<data ").skip(1).map(|rest| {
        let (element, rest) = rest.split_once('>').unwrap();
        let attribute = |name: &str| {
            let rest = element.split(&format!("{name}=\"")).nth(1).unwrap();
            rest.split('"').next().unwrap().to_owned()
        };
        let (inner, behind) = rest.split_once("</data>").unwrap();
        let words = format!("{inner}{}", behind.split('<').next().unwrap());
        (attribute("data-key"), attribute("value").parse().expect("a number"), words)
    })
}

/// Whether the visible text is the rounded value; a fraction is read as %.
fn is_reported(value: f64, words: &str) -> bool {
    let (number, unit) = words.split_once(' ').unwrap_or((words, ""));
    let digits = number.split_once('.').map_or(0, |(_, digits)| digits.len());
    format!("{:.digits$}", if unit.starts_with('%') { 100.0 * value } else { value }) == number
}

/// The pictures of a page.
fn figures(page: &str) -> Vec<&str> {
    page.split("<svg ").skip(1).map(|rest| rest.split("</svg>").next().unwrap()).collect()
}

/// Whether something is drawn besides axes, grid and legend: more than a few marks, or a path of many points.
fn has_data(figure: &str) -> bool {
    let marks = ["<circle ", "<polygon ", "<path "].map(|mark| figure.matches(mark).count()).iter().sum::<usize>();
    let corners = figure.split(" d=\"").skip(1).map(|path| path.split('"').next().unwrap().matches('M').count());
    marks + corners.sum::<usize>() > 6
}
