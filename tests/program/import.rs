//! Tables of other programs: imported as runs, or read directly with `--columns`.

use palpate_testing::{CommandOutput, TestFolder, shipped, shipped_text};
use serde_json::Value;
use std::fs::File;

const SHORT: &str = "--columns x_mm=X,y_mm=Y,force_n=Fz,outputs=ch0..ch8";

/// Names, units, separators and decimals of another laboratory; the values are those of the examples.
const COLUMNS: &str = "\
x_mm = \"X [um]\"
y_mm = \"Y [um]\"
force_n = \"Fz\"
outputs = \"s1..s9\"
missing = [\"-999\"]
measured = \"2026-05-04\"
scale = { x_mm = 0.001, force_n = -1.0 }
array = { grid = { rows = 3, columns = 3, pitch_mm = 4.5 }, unit = \"V\" }
";

/// The rows of an example: place, force and outputs.
fn rows(file: &str) -> Vec<Vec<f64>> {
    let text = shipped_text(file);
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let header = reader.headers().unwrap().clone();
    let outputs = (1..=9).map(|number| format!("out_{number}"));
    let names = ["x_mm", "y_mm", "force_n"].map(str::to_owned).into_iter().chain(outputs);
    let at: Vec<usize> = names.map(|name| header.iter().position(|column| column == name).unwrap()).collect();
    let row = |record: csv::StringRecord| at.iter().map(|&at| record[at].parse().unwrap()).collect();
    reader.records().map(|record| row(record.unwrap())).collect()
}

/// Comma-separated, with short names.
fn short(file: &str) -> String {
    let names: String = (0..9).map(|number| format!(",ch{number}")).collect();
    let line = |row: &Vec<f64>| row.iter().map(f64::to_string).collect::<Vec<_>>().join(",") + "\n";
    format!("X,Y,Fz{names}\n") + &rows(file).iter().map(line).collect::<String>()
}

/// As a spreadsheet of another country exports it, in um and with pulling forces.
fn foreign(file: &str) -> String {
    let names: String = (1..=9).map(|number| format!(";s{number}")).collect();
    let line = |row: &Vec<f64>| {
        let cells = [1000.0 * row[0], 1000.0 * row[1], -row[2]];
        let cells: Vec<String> = cells.iter().chain(&row[3..]).map(|cell| cell.to_string().replace('.', ",")).collect();
        cells.join(";") + "\r\n"
    };
    let rows: String = rows(file).iter().map(line).collect();
    format!(
        "\u{feff}sep=;\r\n# exported\r\nX [um];Y [um];Fz{names}\r\n{rows}0;0;;1;1;1;1;1;1;1;1;1\r\n0;0;-1;NaN;1;1;1;1;1;1;1;1\r\n0;0;-1;1;1;1;1;1;1;1;1;-999\r\n"
    )
}

fn bench() -> TestFolder {
    let [calibration, test] = ["data/example/calibration.csv", "data/example/test.csv"];
    TestFolder::with([
        ("grid.csv", short(calibration).as_str()),
        ("random.csv", short(test).as_str()),
        ("kalib.csv", foreign(calibration).as_str()),
        ("probe.csv", foreign(test).as_str()),
        ("columns.toml", COLUMNS),
        ("certificate.toml", shipped_text("data/example/certificate.toml").as_str()),
    ])
}

/// The evaluation, without its time.
fn evaluated(bench: &TestFolder, words: &str) -> Value {
    let output = bench.palpate_ends(0, &format!("evaluate {words} --solver pearson-lsq --json")).out;
    let mut value: Value = serde_json::from_str(&output).unwrap();
    value.as_object_mut().unwrap().remove("ns_per_solve");
    value
}

#[test]
fn every_format_of_the_same_presses_gives_the_same_errors() {
    let bench = bench();
    let [calibration, test] =
        ["data/example/calibration.csv", "data/example/test.csv"].map(|file| shipped(file).display().to_string());
    let own = evaluated(&bench, &format!("{calibration} {test}"));
    assert_eq!(evaluated(&bench, &format!("--calibration {calibration} --test {test}")), own);
    assert_eq!(evaluated(&bench, &format!("grid.csv random.csv {SHORT}")), own);
    bench.palpate_ends(0, &format!("import grid.csv --test random.csv {SHORT}"));
    assert_eq!(evaluated(&bench, "runs/grid"), own);
    let output = bench.palpate_ends(0, "import kalib.csv --test probe.csv --columns columns.toml --sensor A-017");
    assert_eq!(
        output.out.lines().next().unwrap(),
        format!(
            "runs/kalib: {} presses of 9 outputs imported",
            rows("data/example/calibration.csv").len() + rows("data/example/test.csv").len()
        )
    );
    for note in [
        "note: kalib.csv: columns are separated by semicolons, decimal commas",
        "note: kalib.csv: 3 rows excluded: a cell is blank or has no value (first: line",
        "column `Fz`)",
    ] {
        assert!(output.err.contains(note), "{note}: {}", output.err);
    }
    let number = |value: &Value| value["location_error_mm"]["mean"].as_f64().unwrap();
    let imported = evaluated(&bench, "runs/kalib");
    assert!((number(&imported) - number(&own)).abs() < 1e-9, "um come back as mm to the last digits: {imported} {own}");
}

#[test]
fn imported_run_is_marked_in_record_page_and_certificate() {
    let bench = bench();
    bench.palpate_ends(0, "import kalib.csv --test probe.csv --columns columns.toml --sensor A-017");
    let hashes = ["kalib.csv", "probe.csv", "columns.toml"]
        .map(|file| palpate_data::dataset::source_fingerprint(&bench.path(file)).unwrap().sha256);
    let journal = bench.read("runs/kalib/journal.log");
    let first = journal.lines().next().unwrap();
    bench.palpate_ends(0, "report runs/kalib");
    bench.palpate_ends(0, "certificate runs/kalib --with certificate.toml");
    let documents =
        ["report.html", "certificate.html", "certificate.xml"].map(|file| bench.read(&format!("runs/kalib/{file}")));
    for hash in &hashes {
        assert!(first.contains(hash), "{first}");
        assert!(documents.iter().all(|text| text.contains(hash)), "{hash}");
    }
    assert!(first.contains("\"imported\":{") && documents.iter().all(|text| text.contains("imported")), "{first}");
    assert!(documents[2].contains("<dcc:beginPerformanceDate>2026-05-04</dcc:beginPerformanceDate>"));
    assert_eq!(bench.read("runs/kalib/columns.toml"), COLUMNS);
    for command in
        ["verify runs/kalib", "rebuild runs/kalib", "verify runs/kalib --certificate runs/kalib/certificate.xml"]
    {
        bench.palpate_ends(0, command);
    }
    let output = bench.palpate_ends(2, "resume runs/kalib");
    assert!(output.running().contains("runs/kalib was imported, not measured"), "{}", output.err);
}

#[test]
fn failed_import_leaves_no_files() {
    let bench = bench();
    bench.write("one.csv", "X,Y,Fz,ch0\n0,0,1,2\n");
    bench.write("dead.csv", "X,Y,Fz,ch0,ch1\n0,0,1,2,\n1,0,1,2,\n");
    bench.write("mn.csv", "X,Y,Fz,ch0,ch1\n0,0,900,2,1\n1,0,950,2,2\n");
    bench.write("n.csv", "X,Y,Fz,ch0,ch1\n0,0,0.9,2,1\n1,0,0.95,2,2\n");
    bench.write(
        "small.toml",
        "x_mm = \"X\"\ny_mm = \"Y\"\narray = { places_mm = [[0.0, 0.0]] }\noutputs = \"ch0..ch1\"\n",
    );
    for (words, expected) in [
        ("import grid.csv", "the header has `X`"),
        ("import grid.csv --columns x_mm=X,y_mm=Y", "if they are the outputs, add --columns outputs=ch0..ch8"),
        ("import grid.csv --columns x_mm=X,y_mm=Y,force_n=Kraft,outputs=ch0..ch8", "column `Kraft` is missing"),
        ("import grid.csv --columns x_mm=X,y_mm=Y,output=ch0..ch8", "unknown key `output`"),
        ("import grid.csv --test one.csv --columns x_mm=X,y_mm=Y,outputs=ch0..ch8", "column `ch1` is missing"),
        (
            "import dead.csv --columns x_mm=X,y_mm=Y,outputs=ch0..ch1",
            "none of its 2 rows has a value in every column (line 2: none in column `ch1`)",
        ),
        ("import n.csv --columns small.toml", "`array` has 1 outputs, but `outputs` names 2 columns"),
        ("import none.csv --columns columns.toml", "none.csv: can't be read"),
        ("import grid.csv --columns x_mm=X,y_mm=Y,outputs=ch0-ch8", "`outputs` is \"ch0-ch8\", which names one column"),
        ("import kalib.csv --test grid.csv --columns columns.toml", "column `X [um]` is missing"),
    ] {
        let output = bench.palpate_ends(2, words);
        assert!(output.running().contains(expected), "{words}: {}", output.err);
        assert!(!bench.has("runs"), "{words}");
    }
    let output =
        bench.palpate_ends(0, "import n.csv --test mn.csv --columns x_mm=X,y_mm=Y,force_n=Fz,outputs=ch0..ch1");
    assert!(
        output.running().contains("warning: force_n up to 950 in mn.csv, and up to 0.95 in n.csv: both must be in N"),
        "{}",
        output.err
    );
    let two =
        [TestFolder::path(&bench, "own.csv"), shipped("data/example/test.csv")].map(|path| path.display().to_string());
    bench.write("own.csv", &shipped_text("data/example/calibration.csv"));
    let output = bench.palpate_ends(0, &format!("evaluate {} {} --solver pearson", two[1], two[0]));
    assert!(output.running().contains("their column `phase` states the opposite"), "{}", output.err);
    bench.write("um.csv", "X,Y,Fz,ch0,ch1\n-900,0,1,2,1\n900,10,1,2,2\n");
    bench.write("um.toml", "x_mm = \"X\"\ny_mm = \"Y\"\nforce_n = \"Fz\"\noutputs = \"ch0..ch1\"\narray = { places_mm = [[0.0, 0.0], [9.0, 1.0]] }\n");
    let output = bench.palpate_ends(0, "import um.csv --columns um.toml");
    assert!(output.err.contains("warning: the presses are over 1800 mm, but the array is 9 mm wide"), "{}", output.err);
    bench.write("pulled.csv", "X,Y,Fz,ch0,ch1\n0,0,-0.9,2,1\n1,0,-0.95,2,2\n");
    let output = bench.palpate_ends(2, "import pulled.csv --columns x_mm=X,y_mm=Y,force_n=Fz,outputs=ch0..ch1");
    assert!(output.running().contains("pulled.csv: all forces are negative"), "{}", output.err);
    bench.write("far.toml", "x_mm = \"X\"\ny_mm = \"Y\"\nforce_n = \"Fz\"\noutputs = \"ch0..ch1\"\narray = { places_mm = [[9.0, 0.0], [9.0, 1.0]] }\n");
    let output = bench.palpate_ends(0, "import n.csv --columns far.toml");
    assert!(output.running().contains("warning: 2 of 2 units are outside the area of the presses"), "{}", output.err);
    let output = bench.palpate_ends(2, "certificate runs/n --with certificate.toml");
    assert!(output.running().contains("has no sensor ID"), "{}", output.err);
    bench.palpate_ends(0, &format!("import grid.csv --test random.csv {SHORT} --sensor A-017 --out undated"));
    let output = bench.palpate_ends(2, "certificate undated --with certificate.toml");
    assert!(output.running().contains("doesn't state the day of the measurement"), "{}", output.err);
}

#[test]
fn readings_have_the_columns_of_the_tables() {
    let bench = bench();
    bench.palpate_ends(0, "fit kalib.csv --columns columns.toml --solver pearson-lsq --out sensor.palpate");
    bench.palpate_ends(0, &format!("fit grid.csv {SHORT} --solver pearson-lsq --out other.palpate"));
    let solved = |model: &str, columns: &str, input: &str| {
        bench.write("input", input);
        let mut command = bench.command(&format!("solve --model {model} {columns} --quiet"));
        let printed: CommandOutput = command.stdin(File::open(bench.path("input")).unwrap()).output().unwrap().into();
        assert_eq!(printed.code, Some(0), "{}", printed.err);
        printed.out
    };
    let expected = solved("other.palpate", SHORT, &short("data/example/test.csv"));
    let row = |text: String| {
        text.lines().nth(5).unwrap().split(',').take(3).map(|cell| cell.parse::<f64>().unwrap()).collect::<Vec<_>>()
    };
    let input = foreign("data/example/test.csv");
    let found = row(solved("sensor.palpate", "--columns columns.toml", &input));
    assert!(found.iter().zip(row(expected)).all(|(a, b)| (a - b).abs() < 1e-3), "{found:?}");
}
