//! `palpate solve`: readings in, contacts out, a line for a line.

use palpate_testing::{CommandOutput, SMALL, TestFolder, exchanged};
use serde_json::{Value, json};
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Stdio};

/// Three places, three units; the unit straight below a place has the largest output.
const CALIBRATION: &str = "\
x_mm,y_mm,force_n,out_1,out_2,out_3
-4,0,1,1.0,0.3,0.1
0,0,1,0.3,1.0,0.3
4,0,1,0.1,0.3,1.0
";

const KEYS: &str = "x_mm,y_mm,force_n,sd_x_mm,sd_y_mm,sd_force_n,half68_mm,half95_mm,half68_n,half95_n,\
                    other_x_mm,other_y_mm,misfit,verdict,unit,left_out";

const WORDS: &str = "solve --calibration a.csv --solver pearson --quiet";

/// Half, twice and once the calibrated outputs, as four programs would write them.
const READINGS: [&str; 4] = [
    "out_1,out_2,out_3\n0.5,0.15,0.05\n0.6,2.0,0.6\n0.1,0.3,1.0\n",
    "note,out_3,out_2,out_1\r\n,0.05,0.15,0.5\r\n\r\n\"a, b\",0.6,2,0.6\r\nx,1,.3,1e-1",
    "0.5,0.15,0.05\n0.6,2.0,0.6\n0.1,0.3,1.0\n",
    "{\"outputs\":[0.5,0.15,0.05]}\n[0.6,2.0,0.6]\n{\"more\":[1],\"outputs\":[0.1,0.3,1]}\n",
];

#[test]
fn each_line_has_one_answer_in_every_format() {
    let contacts = ["-4.0,0.0,0.5", "0.0,0.0,2.0", "4.0,0.0,1.0"].map(|contact| format!("{contact},,,,,,,,,,,ok,,\n"));
    let expected = format!("{KEYS}\n{}", contacts.concat());
    for readings in READINGS {
        let output = solved(WORDS, readings, 0);
        assert_eq!(places(&output.out), places(&expected), "{readings:?}\n{}", output.out);
        assert!(output.err.is_empty(), "{}", output.err);
        let objects = solved(&format!("{WORDS} --json"), readings, 0).json_lines();
        let mut sorted: Vec<&str> = KEYS.split(',').collect();
        sorted.sort_unstable();
        assert_eq!(objects.len(), contacts.len(), "{readings:?}");
        for (object, [x_mm, force_n]) in objects.iter().zip([[-4.0, 0.5], [0.0, 2.0], [4.0, 1.0]]) {
            let mut found: Vec<&str> = object.as_object().expect("an object").keys().map(String::as_str).collect();
            found.sort_unstable();
            assert_eq!(found, sorted);
            let value = |key: &str| object[key].as_f64().expect("a number");
            assert!((value("x_mm") - x_mm).abs() < 1e-9 && (value("force_n") - force_n).abs() < 1e-6, "{object}");
            assert_eq!(object["verdict"], "ok");
        }
        assert_eq!(objects.len(), 3);
    }
    assert_eq!(solved(WORDS, "", 0).out, "");
    assert_eq!(solved(WORDS, "out_1,out_2,out_3\n", 0).out, "");
}

#[test]
fn id_is_returned_with_its_contact() {
    let output = solved(WORDS, "t_s,id,out_1,out_2,out_3\n0.5,\"a, b\",1,0.3,0.1\n,,1,0.3,0.1\n", 0);
    let lines: Vec<&str> = output.out.lines().collect();
    assert!(lines[0].starts_with("id,t_s,x_mm,"), "{}", output.out);
    assert!(lines[1].starts_with("\"a, b\",0.5,-4.0,") && lines[2].starts_with(",,-4.0,"), "{}", output.out);
    let readings = "{\"id\":7,\"outputs\":[1,0.3,0.1]}\n{\"t_s\":\"noon\",\"outputs\":[1,0.3,0.1]}\n";
    let objects = solved(&format!("{WORDS} --json"), readings, 0).json_lines();
    assert_eq!((&objects[0]["id"], objects[0].get("t_s")), (&json!(7), None));
    assert_eq!((objects[1].get("id"), &objects[1]["t_s"]), (None, &json!("noon")));
}

#[test]
fn unanswered_reading_has_a_line_with_its_reason() {
    let readings = "1,1,1\nnan,1,1\n1,0.3,0.1\n";
    let lines: Vec<String> = solved(WORDS, readings, 0).out.lines().map(str::to_owned).collect();
    assert_eq!(lines[1..3], [",,,,,,,,,,,,,unsolved,,", ",,,,,,,,,,,,,unsolved,,"]);
    assert!(lines[3].starts_with("-4.0,"), "{lines:?}");
    let output = solved(&WORDS.replace(" --quiet", ""), readings, 0).running();
    assert!(
        output.contains("stdin, line 1: unsolved, all outputs are equal") && !output.contains("line 2: unsolved"),
        "{output}"
    );
    let objects = solved(&format!("{WORDS} --json"), "[1,1,1]\n[null,1,1]\n[1,0.3,0.1]\n", 0).json_lines();
    let said = |index: usize| (&objects[index]["verdict"], objects[index].get("error").and_then(Value::as_str));
    assert_eq!(said(0), (&json!("unsolved"), Some("all outputs are equal: the reading correlates with no place")));
    assert_eq!(said(1), said(0), "without the missing output the others are equal");
    assert_eq!((&objects[0]["x_mm"], said(2)), (&Value::Null, (&json!("ok"), None)));
}

#[test]
fn malformed_reading_ends_solve_after_earlier_answers() {
    for (readings, before, parts) in [
        ("1,0.3,0.1\n1,0.3\n", 1, ["stdin, line 2: 2 outputs where the calibration has 3", "one number for each"]),
        ("1,0.3,0.1\n\n1,x,1\n", 1, ["stdin, line 3, column `out_2`: expected a number, found `x`", "help"]),
        ("out_1,out_2\n1,0.3\n", 0, ["stdin, line 1: 2 outputs where the calibration has 3", "help"]),
        ("out_1,out_2,out3\n1,2,3\n", 0, ["stdin, line 1: 2 outputs where", "help"]),
        ("a,b,c\n1,2,3\n", 0, ["stdin, line 1: column `out_1` is missing", "numbers only needs no header"]),
        (
            "[1,0.3,0.1]\n[1,0.3,0.1]\n[1,0.3\n",
            2,
            ["stdin, line 3, column 6: EOF", "expected a reading, as {\"outputs\""],
        ),
        ("{\"outputs\":[1,0.3,\"1\"]}\n", 0, ["stdin, line 1, column 21: invalid type: string \"1\"", "help"]),
    ] {
        let output = solved(&format!("{WORDS} --json"), readings, 2);
        assert_eq!(output.out.lines().count(), before, "{readings:?}\n{}", output.out);
        for part in parts {
            assert!(output.running().contains(part), "{readings:?} doesn't say {part:?}:\n{}", output.err);
        }
        assert!(output.err.lines().all(|line| line.chars().count() <= 80), "{}", output.err);
    }
    // with an explicit format, a first character means nothing
    let output = solved(&format!("{WORDS} --input ndjson"), "1,0.3,0.1\n", 2);
    assert!(output.running().contains("stdin, line 1, column 1: invalid type"), "{}", output.err);
    solved(&format!("{WORDS} --input csv"), "1,0.3,0.1\n", 0);
}

/// A word for a number, too short, another format, no end of a quotation, too long.
const BAD: [&str; 5] = ["1,x,1", "1,0.3", "[1,0.3,0.1]", "1,\"0.3,0.1", "1,0.3,0.1,0.1"];
const BAD_JSON: [&str; 5] = ["[1,\"x\",1]", "[1,0.3]", "1,0.3,0.1", "{\"outputs\":[1,0.3", "{\"id\":5,\"outputs\":[]}"];

#[test]
fn keep_going_answers_an_invalid_line_and_solves_the_next() {
    let good = "1,0.3,0.1\n";
    let readings: String = BAD.iter().map(|bad| format!("{bad}\n\n{good}")).collect();
    let output = solved(&format!("{WORDS} --keep-going"), &readings, 0);
    let lines: Vec<&str> = output.out.lines().collect();
    assert_eq!(lines[0], format!("line,id,t_s,{KEYS},error"));
    assert_eq!(lines.len(), 1 + 2 * BAD.len(), "{}", output.out);
    for (index, pair) in lines[1..].chunks(2).enumerate() {
        let line = 3 * index + 1;
        let [bad, good] = pair else { panic!("{}", output.out) };
        assert!(
            bad.starts_with(&format!("{line},,,,,,,,,,,,,,,,unsolved,,,")) && bad.contains(&format!("line {line}")),
            "{bad}"
        );
        assert!(good.starts_with(&format!("{},,,-4.0,0.0,1.0,", line + 2)) && good.ends_with(",ok,,,"), "{good}");
    }
    assert!(lines[1].ends_with("\"stdin, line 1, column `out_2`: expected a number, found `x`\""), "{}", lines[1]);
    assert!(output.err.is_empty(), "{}", output.err);

    let readings: String = BAD_JSON.iter().map(|bad| format!("{bad}\n[1,0.3,0.1]\n")).collect();
    let objects = solved(&format!("{WORDS} --keep-going --json --input ndjson"), &readings, 0).json_lines();
    assert_eq!(objects.len(), 2 * BAD_JSON.len());
    for (index, object) in objects.iter().enumerate() {
        let is_bad = index % 2 == 0;
        assert_eq!(
            (object["line"].as_u64(), object["error"].is_string()),
            (Some(index as u64 + 1), is_bad),
            "{object}"
        );
        assert_eq!(object["verdict"], if is_bad { "unsolved" } else { "ok" });
        assert_eq!(object["x_mm"].is_null(), is_bad, "{object}");
    }
    assert_eq!(objects[8]["id"], 5, "the label of a bad reading comes back where it can be read");
}

#[test]
fn keep_going_returns_ids_after_an_invalid_first_line() {
    let readings = "hello\n{\"id\":7,\"outputs\":[1,0.3,0.1]}\n";
    let output = solved(&format!("{WORDS} --keep-going --input ndjson"), readings, 0);
    assert!(output.out.lines().nth(2).is_some_and(|line| line.starts_with("2,7,,-4.0,")), "{}", output.out);
}

#[test]
fn keep_going_still_ends_at_an_unusable_header() {
    for readings in ["a,b,c\n1,2,3\n", "out_1,out_2\n1,0.3\n", "out_1,out_2,\"out_3\n1,2,3\n"] {
        let output = solved(&format!("{WORDS} --keep-going"), readings, 2);
        assert!(output.out.is_empty() && output.running().contains("stdin, line 1"), "{readings:?}: {output:?}");
    }
}

#[test]
fn a_missing_channel_is_left_out_of_its_reading() {
    let bench = TestFolder::with([("whole.csv", NINE), ("less.csv", &without_first_output(NINE))]);
    let expected = solved_on(&bench, "solve --calibration less.csv --solver pearson --quiet", "0.62,0.21\n", 0).out;
    let words = "solve --calibration whole.csv --solver pearson --quiet";
    for readings in [
        "nan,0.62,0.21\n",
        ",0.62,0.21\n",
        "out_3,out_2,out_1\n0.21,0.62,\n",
        "[null,0.62,0.21]\n",
        "{\"outputs\":[NaN,0.62,0.21]}\n",
    ] {
        assert_eq!(places(&solved_on(&bench, words, readings, 0).out), places(&expected), "{readings:?}");
    }
    let output = solved_on(&bench, &format!("{words} --json"), "[NaN,NaN,null]\n", 0).json_lines();
    assert_eq!((&output[0]["verdict"], &output[0]["error"]), (&json!("unsolved"), &json!("every output is missing")));
}

#[test]
fn contact_is_written_before_the_next_reading_is_read() {
    for (words, reading) in [(WORDS.to_owned(), "1,0.3,0.1\n"), (format!("{WORDS} --json"), "[1,0.3,0.1]\n")] {
        let bench = TestFolder::with([("a.csv", CALIBRATION)]);
        let mut child = started(&bench, &words);
        let mut readings = child.stdin.take().expect("piped");
        let mut contacts = BufReader::new(child.stdout.take().expect("piped")).lines().map(|line| line.expect("text"));
        for _ in 0..3 {
            // and a part of the next line, which isn't answered yet
            let (whole, piece) = (reading, &reading[..2]);
            write!(readings, "{whole}{piece}").expect("it listens");
            let contact = contacts.by_ref().find(|line| !line.starts_with("x_mm")).expect("a contact");
            assert!(contact.contains("-4.0") && contact.contains("ok"), "{contact}");
            write!(readings, "{}", &reading[2..]).expect("it listens");
            contacts.next().expect("a contact");
        }
        drop(readings);
        assert_eq!(contacts.next(), None);
        assert!(child.wait().expect("it ends").success());
    }
}

#[test]
fn closed_output_is_not_an_error() {
    let readings = "1,0.3,0.1\n".repeat(100_000);
    let bench = TestFolder::with([("a.csv", CALIBRATION), ("readings.csv", readings.as_str())]);
    for words in [WORDS.to_owned(), format!("{WORDS} --json")] {
        let input = File::open(bench.path("readings.csv")).expect("it was written");
        let mut command = bench.command(&words);
        let child = command.stdin(input).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut child = child.expect("the program starts");
        drop(child.stdout.take());
        let output: CommandOutput = child.wait_with_output().expect("it ends").into();
        assert_eq!((output.code, output.err.as_str()), (Some(0), ""));
    }
}

#[test]
fn run_folder_is_a_calibration_and_its_method_is_printed() {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    let presses = bench.read("run/presses.csv");
    let output = solved_on(&bench, "solve --calibration run --solver pearson", &presses, 0);
    assert!(
        output.err.starts_with("pearson, fitted to 4 presses of 9 outputs\nstdin, line 2: unsolved"),
        "{}",
        output.err
    );
    assert_eq!(output.out.lines().count(), presses.lines().count());
    assert!(output.out.starts_with("t_s,x_mm,"), "{}", output.out);
    let output = solved_on(&bench, "solve --calibration run --quiet", &presses, 0);
    assert!(output.err.is_empty() && output.out.lines().count() == presses.lines().count(), "{output:?}");
    let output = solved_on(&bench, "solve --calibration run", &presses, 0);
    assert!(output.err.contains(", fitted to 4 presses of 9 outputs\n"), "{}", output.err);
    assert!(output.err.lines().all(|line| line.chars().count() <= 80), "{}", output.err);
}

#[test]
fn broken_unit_is_reported_once_and_then_excluded() {
    let recipe = SMALL.replace("spacing_mm = 4.0", "spacing_mm = 0.5").replace("count = 2", "count = 60");
    let bench = TestFolder::with([("r.toml", recipe.as_str())]);
    bench.palpate_ends(0, "run r.toml --out run");
    let (header, rows) = bench.table("run/presses.csv");
    let first = header.iter().position(|name| name == "out_1").expect("out_1");
    let readings = |broken: Option<usize>| -> String {
        let output =
            |(unit, cell): (usize, &String)| if broken == Some(unit + 1) { "0".to_owned() } else { cell.clone() };
        let reading = |row: &Vec<String>| {
            let outputs = row[first..first + 9].iter().enumerate().map(output);
            outputs.collect::<Vec<_>>().join(",") + "\n"
        };
        rows.iter().filter(|row| row[2] == "test").map(reading).collect()
    };
    let words = "solve --calibration run --solver surrogate --quiet";
    let printed = solved_on(&bench, words, &readings(None), 0);
    assert!(printed.err.is_empty(), "{}", printed.err);
    let printed = solved_on(&bench, words, &readings(Some(5)), 0);
    // the chart notices it first, without a name
    let notes = printed.running();
    let line = notes.rsplit_once("stdin, line ").and_then(|(before, said)| {
        assert!(before.contains("calibrate the sensor again"), "{before}");
        let (line, said) = said.split_once(": output 5 contradicts the others (odds ")?;
        said.strip_suffix(" to 1), left out from here on")?.parse::<u64>().ok().filter(|odds| *odds > 9000)?;
        line.parse::<usize>().ok()
    });
    let line = line.unwrap_or_else(|| panic!("{}", printed.err));
    let left_out: Vec<bool> = printed.out.lines().skip(1).map(|line| line.contains(",5:")).collect();
    assert_eq!(left_out.iter().position(|left_out| *left_out), Some(line), "from the next line on: {}", printed.out);
    assert!(left_out.len() == 60 && left_out[line..].iter().all(|left_out| *left_out) && line <= 50, "{}", printed.out);
    // a file ends with what its last contacts show
    let few: String = readings(Some(5)).lines().take(25).map(|line| format!("{line}\n")).collect();
    let printed = solved_on(&bench, words, &few, 0);
    assert!(printed.running().contains("stdin: output 5 contradicts the others (odds "), "{}", printed.err);
    assert!(!printed.out.contains(",5:"), "it counts from the next line on: {}", printed.out);
    // a live stream waits for no search
    let mut piped = started(&bench, words);
    piped.stdin.take().expect("a pipe").write_all(readings(Some(5)).as_bytes()).expect("the program reads");
    let printed: CommandOutput = piped.wait_with_output().expect("the program ends").into();
    assert_eq!(printed.out.lines().count(), 61, "{}", printed.out);
}

#[test]
fn table_without_forces_is_reported_as_relative() {
    let note = "no force_n in the calibration: relative_force is relative to its typical press\n";
    let silent: String = CALIBRATION.lines().map(|line| exchanged(line, &third(line), "") + "\n").collect();
    let bench = TestFolder::with([("a.csv", silent.as_str())]);
    let words = "solve --calibration a.csv --solver pearson";
    let output = solved_on(&bench, words, "2,0.6,0.2\n", 0);
    assert!(output.err.starts_with(note), "{}", output.err);
    // sqrt(1.10 and 1.18, 1.10 squared), by the length of each row
    let typical = ((1.10f64 + 1.18 + 1.10) / 3.0).sqrt();
    let header = output.out.lines().next().unwrap_or_default();
    assert!(header.contains(",misfit,relative_force,half68_relative_force,half95_relative_force,"), "{header}");
    let cells: Vec<&str> = output.out.lines().nth(1).expect("an answer").split(',').collect();
    assert_eq!([cells[2], cells[5], cells[8], cells[9]], [""; 4], "no force in newtons");
    let force: f64 = cells[13].parse().expect("a relative force");
    assert!((force - 2.0 * 1.10f64.sqrt() / typical).abs() < 1e-6, "{}", output.out);
    let object = &solved_on(&bench, &format!("{words} --json"), "2,0.6,0.2\n", 0).json_lines()[0];
    assert_eq!((&object["force_n"], &object["half95_n"]), (&Value::Null, &Value::Null));
    assert!(object["relative_force"].as_f64().is_some_and(|found| (found - force).abs() < 1e-9), "{object}");
    let output = solved_on(&bench, &format!("{words} --constant-load"), "2,0.6,0.2\n", 0);
    assert!(!output.err.contains(note), "{}", output.err);
    assert!(output.out.lines().nth(1).is_some_and(|line| line.split(',').nth(2) == Some("")), "{}", output.out);
    assert!(!solved("solve --calibration a.csv --solver pearson", "", 0).err.contains(note));
}

#[test]
fn unusable_calibration_or_option_is_refused() {
    let flat = "x_mm,y_mm,out_1,out_2\n0,0,1,1\n1,0,2,2\n";
    let bench = TestFolder::with([("a.csv", CALIBRATION), ("flat.csv", flat)]);
    for (words, part) in [
        ("solve", "--calibration"),
        ("solve --calibration none.csv", "none.csv: can't be read"),
        ("solve --calibration .", "is not a run folder (journal.log not found)"),
        ("solve --calibration flat.csv --solver pearson", "flat.csv: can't be used as a calibration"),
        ("solve --calibration a.csv --solver all", "invalid value 'all'"),
        ("solve --calibration a.csv --false-alarms 0", "expected a number between 0 and 1"),
        ("solve --calibration a.csv --false-alarms nan", "expected a number between 0 and 1"),
        ("solve --calibration a.csv --forces-n 1 0", "expected a force above 0 N"),
        ("solve --calibration a.csv --forces-n 2 1", "the first force must be smaller"),
        ("solve --calibration a.csv --forces-n 1 2 --constant-load", "cannot be used with"),
        ("solve --calibration a.csv --input xml", "invalid value 'xml'"),
    ] {
        let output = bench.palpate_ends(2, words);
        assert!(output.out.is_empty() && output.running().contains(part), "{words}: {output:?}");
    }
    bench.palpate_ends(0, "solve --calibration a.csv --forces-n 1 2 --false-alarms 0.05");
}

/// Nine places, three units.
const NINE: &str = "\
x_mm,y_mm,force_n,out_1,out_2,out_3
0,0,1,0.9,0.3,0.3
1,0,1,0.7,0.7,0.2
2,0,1,0.3,0.9,0.1
0,1,1,0.7,0.2,0.7
1,1,1,0.5,0.6,0.5
2,1,1,0.2,0.7,0.3
0,2,1,0.3,0.1,0.9
1,2,1,0.2,0.3,0.7
2,2,1,0.1,0.3,0.4
";

/// The table without `out_1`, the others numbered from 1 again.
fn without_first_output(table: &str) -> String {
    let mut less = "x_mm,y_mm,force_n,out_1,out_2\n".to_owned();
    for row in table.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        less += &format!("{},{}\n", cells[..3].join(","), cells[4..].join(","));
    }
    less
}

fn solved(words: &str, readings: &str, code: i32) -> CommandOutput {
    solved_on(&TestFolder::with([("a.csv", CALIBRATION)]), words, readings, code)
}

fn solved_on(bench: &TestFolder, words: &str, readings: &str, code: i32) -> CommandOutput {
    bench.write("readings", readings);
    let input = File::open(bench.path("readings")).expect("it was written");
    let printed: CommandOutput = bench.command(words).stdin(input).output().expect("the program starts").into();
    assert_eq!(printed.code, Some(code), "palpate {words}\n{}\n{}", printed.out, printed.err);
    printed
}

fn started(bench: &TestFolder, words: &str) -> Child {
    let mut command = bench.command(words);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the program starts")
}

/// Header, and place and force of each line: the other columns depend on the method.
fn places(contacts: &str) -> Vec<String> {
    let of = |line: &str| line.split(',').take(3).collect::<Vec<_>>().join(",");
    contacts.lines().take(1).map(str::to_owned).chain(contacts.lines().skip(1).map(of)).collect()
}

/// The third cell with its comma.
fn third(line: &str) -> String {
    line.split(',').nth(2).map(|cell| format!("{cell},")).unwrap_or_default()
}
