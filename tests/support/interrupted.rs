//! Runs after a power cut, and simulated worlds that change before the run continues.

use super::TestFolder;
use palpate_data::dataset::Fingerprint;
use serde_json::{Value, json};
use std::fs;

/// Truncates the journal of a complete run: its tables and manifest are then those of a run in progress, without presses that the journal
/// lacks.
pub fn cut_back(bench: &TestFolder, run: &str, journal: &[u8]) {
    let file = |name: &str| format!("{run}/{name}");
    let mut manifest = bench.manifest(run);
    let kept: Vec<String> = std::str::from_utf8(journal)
        .expect("a journal is text")
        .split_inclusive('\n')
        .filter(|line| line.ends_with('\n') && line.contains(" {\"contact\":"))
        .map(|line| record(line)["contact"]["press"].to_string())
        .collect();
    let table = bench.read(&file("presses.csv"));
    let is_kept =
        |line: &&str| line.starts_with("press,") || kept.iter().any(|press| line.starts_with(&format!("{press},")));
    let rows: String = table.split_inclusive('\n').filter(is_kept).collect();
    fs::write(bench.path(&file("journal.log")), journal).expect("a journal");
    bench.write(&file("presses.csv"), &rows);
    for view in ["scene.csv", "characteristics.csv", "calibration_matrix.csv", "test_matrix.csv"] {
        let _ = fs::remove_file(bench.path(&file(view))); // not every run has each
    }
    let object = manifest.as_object_mut().expect("a manifest");
    object.remove("ended");
    object.extend([
        ("status".to_owned(), json!("stopped")),
        ("presses_done".to_owned(), json!(0)),
        ("rows_flagged".to_owned(), json!(0)),
        ("files".to_owned(), json!([])),
    ]);
    bench.write(&file("manifest.json"), &manifest.to_string());
}

/// The same, by a number of lines.
pub fn cut_to_lines(bench: &TestFolder, run: &str, lines: usize) {
    let journal = bench.read(&format!("{run}/journal.log"));
    let kept: String = journal.split_inclusive('\n').take(lines).collect();
    cut_back(bench, run, kept.as_bytes());
}

/// Number of lines before the first contact in a run's journal.
pub fn lines_before_contacts(bench: &TestFolder, run: &str) -> usize {
    let journal = bench.read(&format!("{run}/journal.log"));
    journal.lines().position(|line| line.contains(" {\"contact\":")).expect("a contact")
}

/// Changes the simulated world of a run: the text of the rig is changed in the folder and in the journal.
pub fn change_the_world(bench: &TestFolder, run: &str, rig: &str) {
    change_text(bench, run, "rig.toml", rig);
}

/// Changes a text of a run in its folder and in the journal.
pub fn change_text(bench: &TestFolder, run: &str, name: &str, new: &str) {
    let path = format!("{run}/journal.log");
    let stated = |session: &mut Value| {
        for text in session["texts"].as_array_mut().into_iter().flatten().filter(|text| text["name"] == name) {
            *text = json!(Fingerprint::of(name, new.as_bytes()));
        }
    };
    let another = |line: &str| {
        let mut read = record(line);
        if read["text"]["name"] == name {
            read["text"]["text"] = new.into();
        }
        read.get_mut("session").into_iter().for_each(stated);
        let sequence = line.split(' ').next().and_then(|number| number.parse().ok()).expect("a sequence number");
        sealed(sequence, &read.to_string()) + "\n"
    };
    let journal: String = bench.read(&path).split_inclusive('\n').map(another).collect();
    bench.write(&path, &journal);
    bench.write(&format!("{run}/{name}"), new);
    let mut manifest = bench.manifest(run);
    manifest["files"] = json!([]); // it has the hash of the former journal
    manifest["sessions"].as_array_mut().into_iter().flatten().for_each(stated);
    bench.write(&format!("{run}/manifest.json"), &manifest.to_string());
}

/// A record as in a journal, without its line end.
pub fn sealed(sequence: u64, json: &str) -> String {
    let mut checksum = crc32fast::Hasher::new();
    checksum.update(&sequence.to_le_bytes());
    checksum.update(json.as_bytes());
    format!("{sequence} {:08x} {json}", checksum.finalize())
}

fn record(line: &str) -> Value {
    let json = line.splitn(3, ' ').nth(2).expect("a record");
    serde_json::from_str(json).unwrap_or_else(|error| panic!("{line}: {error}"))
}
