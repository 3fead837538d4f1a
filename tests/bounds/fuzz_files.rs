//! Mutated files for every reader of a file: none crashes the program or takes too much memory or time, and each problem is reported with
//! its place.
//!
//! The numbers here are those of the full tier. `PALPATE_TESTS=100 cargo test --release --test bounds fuzz_files::recipes -- --nocapture`
//! tries a hundred times as many inputs of one reader.

mod feeding;
mod seeds;

use feeding::{fuzz, fuzz_file, resealed};
use palpate_core::quantity::Axis;
use palpate_data::dataset::readings::{LineContent, ReadingError, ReadingFormat, Readings, StreamLines};
use palpate_data::dataset::{Journal, JournalRecords, Manifest, Mapping, Presses, Record, TableError, read_table};
use palpate_data::recipe::{self, PRESSES_MAX, Plan};
use palpate_document::Problems;
use palpate_run::rig::{self, RigSpec, SIM_RIG};
use palpate_testing::mutation::{TEXT_MOST, rewritten};
use seeds::{root, run, sim_rig, texts_in};
use std::fs;
use std::path::Path;

/// Largest number of training presses.
const TRAINING_PRESSES: usize = 5;

/// Number of problems of an input that are drawn as a person sees them, and the largest size of each, bytes: twice its lines.
const DRAWN: usize = 2;
const DRAWN_MOST: usize = TEXT_MOST + (64 << 10);

/// A file name in messages that no mutation writes.
const FILE: &str = "outside";

#[test]
fn recipes() {
    let (spec, seeds) = (sim_rig(), texts_in("recipes", "toml"));
    fuzz("recipes", 1000, &seeds, |input| {
        let text = String::from_utf8_lossy(input);
        match recipe::parse(FILE, &text).and_then(|recipe| Plan::new(&recipe, &spec.ground(), 1)) {
            Ok(plan) => check_plan(&plan, &spec),
            Err(problems) => check_problems(problems, &text),
        }
    });
}

#[test]
fn rigs() {
    let seeds = texts_in("rigs", "toml");
    let map = fs::read_to_string(root().join("profiles/generic-rs485.toml")).expect("a shipped map");
    fuzz("rigs", 1000, &seeds, |input| {
        let text = String::from_utf8_lossy(input);
        match rig::parse(FILE, &text, &|_| Ok(map.clone())) {
            Ok(spec) => _ = spec.simulated().emulators(1).is_ok(),
            Err(problems) => check_problems(problems, &text),
        }
    });
}

#[test]
fn register_maps() {
    let seeds = texts_in("profiles", "toml");
    let rig = SIM_RIG.replace("generic-rs485", "own.toml");
    fuzz("register maps", 1000, &seeds, |input| {
        let text = String::from_utf8_lossy(input);
        if let Err(problems) = rig::parse(FILE, &rig, &|_| Ok(text.to_string())) {
            check_problems(problems, &rig);
        }
        if let Err(problems) = palpate_drivers::modbus::Profile::parse(FILE, &text) {
            check_problems(problems, &text);
        }
    });
}

#[test]
fn tables() {
    let plain = b"x_mm,y_mm,out_1,out_2,flags\n0,0,0.1,0.2,\n1,-1,0.3,0.4,0\n2.5,1e-3,-0.3,4,stale\n".to_vec();
    let seeds = [plain, run().presses.clone()];
    fuzz_file("tables", 10_000, &seeds, rewritten, |path, input| {
        check_table(read_table(path, &Mapping::default()), path, input)
    });
}

#[test]
fn presses() {
    let seeds = [run().presses.clone()];
    fuzz_file("presses", 4000, &seeds, rewritten, |path, input| {
        check_table(read_table(path, &Mapping::default()), path, input)
    });
}

#[test]
fn readings() {
    let seeds: Vec<Vec<u8>> = [
        "out_1,out_2\n0.1,0.2\n0.3,nan\n",
        "0.1,0.2\n0.3,0.4\n",
        "id,t_s,out_2,out_1,x\n7,0.5,1,2,\"a,b\"\n\n8,0.6,3,4,\n",
        "{\"outputs\": [0.1, 0.2], \"id\": \"a\", \"t_s\": 1.5}\n[0.1, null]\n[NaN, 0.1]\n",
    ]
    .iter()
    .map(|text| text.as_bytes().to_vec())
    .collect();
    let mut nth = 0;
    fuzz("readings", 40_000, &seeds, |input| {
        nth += 1;
        let format = [None, Some(ReadingFormat::Csv), Some(ReadingFormat::Ndjson)][nth % 3];
        let (mut lines, mut readings) =
            (StreamLines::new(FILE, input), Readings::new(FILE, 2, format, Mapping::default()));
        let most = self::lines(input);
        for _ in 0..=most {
            let Some(line) = lines.read_next().expect("bytes don't break off") else { return };
            match readings.read(line) {
                Ok(LineContent::Reading) => {
                    let reading = readings.reading();
                    assert!(reading.outputs.len() == 2 && (1..=most as u64).contains(&reading.line), "{reading:?}");
                }
                Ok(LineContent::Bad(error)) => check_line_of(&error.to_string(), FILE, most),
                Ok(LineContent::Nothing) => {}
                Err(ReadingError::Cells(TableError::NoRows { .. })) if readings.reading().outputs.is_empty() => return,
                Err(error) => return check_line(&error.to_string(), FILE, input),
            }
        }
        panic!("more than {most} lines");
    });
}

#[test]
fn journals() {
    fuzz_file("journals", 1500, std::slice::from_ref(&run().journal), resealed, |path, input| {
        let most = lines(input) + 1;
        let sound = Journal::<Record>::records(path).expect("a file").take_while(Result::is_ok).count();
        assert!(sound <= most, "{sound} records of {most} lines");
        let damaged = Journal::<Record>::records(path).expect("a file").take(most).find_map(Result::err);
        let mut taken = 0;
        let read = Journal::<Record>::read(path, |_, _| {
            taken += 1;
            Ok(())
        });
        let opened = read.and_then(JournalRecords::go_on);
        assert_eq!(taken, sound);
        match opened {
            Ok(_) => {
                assert!(damaged.is_none(), "it was opened, and is damaged: {damaged:?}");
                let ends = input.iter().filter(|&&byte| byte == b'\n').count();
                assert_eq!(sound, ends, "a line with its end was cut off in silence");
                let again = Journal::<Record>::records(path).expect("a file").filter(Result::is_ok).count();
                assert_eq!(again, sound, "records after its torn tail was cut off");
            }
            Err(error) => {
                let output = error.to_string();
                let says_why = output.contains("at byte ") || output.contains(": a journal of format ");
                assert!(output.starts_with(&path.display().to_string()) && says_why, "{output}");
                if let Some((_, rest)) = output.split_once("at byte ") {
                    let at = input.split_inclusive(|&byte| byte == b'\n').take(sound).map(<[u8]>::len).sum::<usize>();
                    assert_eq!(
                        rest.split(' ').next(),
                        Some(at.to_string().as_str()),
                        "{output}, after {sound} records"
                    );
                }
                assert_eq!(fs::read(path).expect("a file"), input, "a damaged journal was touched");
            }
        }
    });
}

#[test]
fn manifests() {
    let seeds = [run().manifest.clone()];
    let (mut sound, mut refused) = (0, 0);
    fuzz_file("manifests", 20_000, &seeds, rewritten, |path, input| match Manifest::read(path) {
        Ok(manifest) => {
            sound += 1;
            let text = serde_json::to_string(&manifest).expect("text and numbers");
            assert_eq!(Manifest::parse(&text).expect("what was written"), manifest);
        }
        Err(error) => {
            refused += 1;
            let output = error.to_string();
            let rest = output.strip_prefix(&path.display().to_string()).unwrap_or_else(|| panic!("{output}"));
            let line = rest.strip_prefix(':').and_then(|rest| rest.split(':').next()?.parse::<usize>().ok());
            let is_text = std::str::from_utf8(input).is_ok();
            assert!(!is_text || line.is_some_and(|line| line <= lines(input)), "no such place: {output:?}");
        }
    });
    assert!(sound > 0 && refused > 0, "{sound} read, {refused} refused");
}

// ---- checks of an answer ------------------------------------------------------------------------------------------

/// No plan exceeds its largest length or the limits of the rig.
fn check_plan(plan: &Plan, spec: &RigSpec) {
    let entries = &plan.entries;
    assert!(!entries.is_empty() && entries.len() <= PRESSES_MAX + TRAINING_PRESSES, "{} entries", entries.len());
    for entry in entries {
        let position = spec.frame.to_stage(entry.place, 0.0);
        let within =
            [Axis::X, Axis::Y].into_iter().all(|axis| spec.stage.travel.along(axis).contains(position.along(axis)));
        assert!(within && entry.task.most_n() <= spec.limits.force_n && !entry.task.levels.is_empty(), "{entry:?}");
        assert!(entry.rest_after_s >= 0.0 && (entry.press as usize) < entries.len(), "{entry:?}");
    }
}

/// Each problem is one line, without control characters, at a place within the text.
fn check_problems(problems: Problems, text: &str) {
    let output = problems.lines();
    assert!(!output.is_empty(), "refused without a reason");
    let mut widths: Vec<usize> = text.split('\n').map(|line| line.chars().count()).collect();
    if text.is_empty() || text.len() > palpate_document::TEXT_MAX_BYTES {
        widths = vec![0];
    }
    for line in &output {
        let mut parts = line.splitn(4, ':');
        let mut part = || parts.next().unwrap_or_default();
        assert_eq!(part(), FILE, "{line}");
        let (at, column): (usize, usize) = (part().parse().unwrap_or(0), part().parse().unwrap_or(0));
        let width = widths.get(at.wrapping_sub(1)).copied();
        assert!(width.is_some_and(|width| (1..=width + 1).contains(&column)), "no such place: {line}");
        let message = part();
        assert!(message.len() > 1, "{line}");
        assert!(!message.chars().any(char::is_control), "control characters in {line:?}");
    }
    let drawn: usize = problems.into_reports().take(DRAWN).map(|report| format!("{report:?}").len()).sum();
    assert!(drawn < DRAWN * DRAWN_MOST, "{drawn} bytes are drawn");
}

fn check_table(table: Result<Presses, TableError>, path: &Path, input: &[u8]) {
    match table {
        Ok(table) => {
            assert!(!table.presses.is_empty() && table.presses.len() <= lines(input));
            let sound =
                |outputs: &[f64]| outputs.len() == table.channels && outputs.iter().all(|output| output.is_finite());
            assert!(table.presses.iter().all(|press| sound(&press.outputs) && press.x_mm.is_finite()));
        }
        Err(
            error @ (TableError::TooLarge { line: None, .. } | TableError::Empty { .. } | TableError::NoRows { .. }),
        ) => {
            assert!(error.to_string().starts_with(&path.display().to_string()), "{error}");
        }
        Err(error) => check_line(&error.to_string(), &path.display().to_string(), input),
    }
}

/// A message that names a file and a line, without control characters.
fn check_line(output: &str, file: &str, input: &[u8]) {
    check_line_of(output, file, lines(input));
}

/// The same with several lines.
fn check_line_of(output: &str, file: &str, lines: usize) {
    let line = output.strip_prefix(file).and_then(|rest| rest.strip_prefix(", line "));
    let line = line.and_then(|rest| rest.split([',', ':']).next()).and_then(|line| line.parse::<usize>().ok());
    assert!(line.is_some_and(|line| (1..=lines).contains(&line)), "{output:?} of {lines} lines");
    assert!(!output.contains(char::is_control), "control characters in {output:?}");
}

/// Largest number of lines, for any line ends.
fn lines(input: &[u8]) -> usize {
    1 + input.iter().filter(|&&byte| byte == b'\n' || byte == b'\r').count()
}
