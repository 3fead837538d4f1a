//! A batch at the bench: a day of 30 sensors at a terminal, and typed, refused, interrupted and continued sensors.

mod day;
mod desk;
mod notify;
mod prior;

use palpate_data::dataset::{Journal, Status};
use palpate_run::batch::{BatchEvent, Ended};
use palpate_testing::{CommandOutput, TestFolder, shipped_text};
use std::io::Write;
use std::process::Stdio;

/// 9 places, 5 test contacts, and a rule that most sensors of the rig keep.
const RECIPE: &str = r#"
name = "short"

[press]
force_tolerance_n = 0.05

[[step]]
phase = "calibration"
grid = { x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], spacing_mm = 4.0 }
force_n = 1.0

[[step]]
phase = "test"
random = { count = 5, x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], force_n = [0.5, 1.0] }

[accept]
method = "pearson"
location_mean_mm = 1.5
"#;

const BATCH: &str = r#"
name = "day"
design = "skin"
rig = "rig.toml"
recipes = ["r.toml"]
serials = { prefix = "A-", first = 1, last = 30, digits = 2 }
operator = "Ada"
warm_up_s = 5.0
"#;

/// A folder with a batch of 30 sensors, and more lines in its file.
fn bench(more: &str) -> TestFolder {
    let batch = format!("{BATCH}{more}");
    TestFolder::with([("b.toml", batch.as_str()), ("r.toml", RECIPE), ("rig.toml", &shipped_text("rigs/batch.toml"))])
}

/// A fault in the bench's rig from a time on, s.
fn break_rig(bench: &TestFolder, kind: &str, from_s: f64) {
    let text = shipped_text("rigs/batch.toml");
    bench.write("rig.toml", &format!("{text}\n[[scene.fault]]\nkind = \"{kind}\"\nfrom_s = {from_s:.1}\n"));
}

fn mend_rig(bench: &TestFolder) {
    bench.write("rig.toml", &shipped_text("rigs/batch.toml"));
}

/// Runs the program with these lines on its standard input.
fn piped(bench: &TestFolder, words: &str, lines: &[&str]) -> CommandOutput {
    let mut command = bench.command(words);
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut stdin = child.stdin.take().expect("piped");
    let typed: String = lines.iter().map(|line| format!("{line}\n")).collect();
    // a program that refuses its files reads nothing
    let _ = stdin.write_all(typed.as_bytes());
    drop(stdin);
    child.wait_with_output().expect("it ends").into()
}

/// Every event of a batch; its journal must be sound.
fn events(bench: &TestFolder, batch: &str) -> Vec<BatchEvent> {
    let journal = Journal::<BatchEvent>::records(&bench.path(&format!("{batch}/journal.log"))).expect("a journal");
    journal.map(|event| event.expect("a sound event").1).collect()
}

/// The results of a sensor, in order.
fn results<'e>(events: &'e [BatchEvent], serial: &str) -> Vec<&'e Ended> {
    let ended = |event: &'e BatchEvent| if let BatchEvent::Ended(ended) = event { Some(ended) } else { None };
    events.iter().filter_map(ended).filter(|ended| ended.serial == serial).collect()
}

/// Number of times that a sensor began.
fn begun(events: &[BatchEvent], serial: &str) -> usize {
    events.iter().filter(|event| matches!(event, BatchEvent::Began(began) if began.serial == serial)).count()
}

/// Number of complete results of a sensor.
fn complete(events: &[BatchEvent], serial: &str) -> usize {
    results(events, serial).iter().filter(|ended| ended.status == Status::Complete).count()
}
