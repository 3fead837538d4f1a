//! A journal that doesn't belong to its manifest: that of another run, or one that was edited with the right checksums.

use palpate_testing::interrupted::{cut_to_lines, lines_before_contacts, sealed};
use palpate_testing::{SMALL, TestFolder, exchanged, shipped_text};
use serde_json::Value;
use std::fs;

/// Commands that answer from a run, and the files of each.
const READERS: [(&str, &str); 7] = [
    ("evaluate one --solver pearson", ""),
    ("solve --calibration one --solver pearson", ""),
    ("fit one --solver pearson --out s.palpate", "s.palpate"),
    ("report one --out page.html", "page.html"),
    ("export one --format csv --out tables", "tables"),
    ("certificate one --with c.toml --out c", "c.html"),
    ("resume one", ""),
];

/// Two complete runs of two sensors.
fn two_runs() -> TestFolder {
    let given = shipped_text("data/example/certificate.toml");
    let bench = TestFolder::with([("r.toml", SMALL), ("c.toml", &given)]);
    for (run, sensor, seed) in [("one", "S-1", 1), ("two", "S-2", 2)] {
        bench.palpate_ends(0, &format!("run r.toml --out {run} --sensor {sensor} --seed {seed}"));
    }
    bench
}

fn copy(bench: &TestFolder, from: &str, to: &str) {
    fs::copy(bench.path(from), bench.path(to)).expect("a copy");
}

/// The journal with moved test presses and the right checksums.
fn moved(journal: &str) -> String {
    let line = |(number, line): (usize, &str)| {
        let json = line.splitn(3, ' ').nth(2).expect("a record");
        let mut record: Value = serde_json::from_str(json).expect("JSON");
        let levels = record["contact"]["levels"].as_array_mut().into_iter().flatten();
        let mut is_moved = false;
        for level in levels.filter(|level| level["phase"] == "test") {
            for key in ["x_mm", "y_mm"] {
                level[key] = (level[key].as_f64().expect("a place") * 0.9).into();
            }
            is_moved = true;
        }
        if is_moved { sealed(number as u64, &record.to_string()) } else { line.to_owned() }
    };
    journal.lines().enumerate().map(|(number, text)| line((number, text)) + "\n").collect()
}

/// Every command names the journal of run `one`, refuses it and changes nothing, until a person accepts it.
fn is_refused_until_accepted(bench: &TestFolder, differences: &[&str]) {
    let before = bench.bytes("one");
    let expected = "one/journal.log: the journal isn't the one that manifest.json describes: ";
    for (words, written) in READERS.into_iter().chain([("rebuild one", ""), ("rebuild one --accept-loss", "")]) {
        let output = bench.palpate_ends(2, words);
        assert!(output.running().contains(expected), "{words}: {}", output.err);
        differences
            .iter()
            .for_each(|it| assert!(output.running().contains(it), "{words}: no {it:?} in {}", output.err));
        assert!(!output.err.contains("presses.csv"), "{words}: {}", output.err);
        assert!(written.is_empty() || !bench.has(written), "{words} wrote {written}");
        assert!(output.out.is_empty(), "{words}: {}", output.out);
    }
    let output = bench.palpate_ends(1, "verify one");
    assert!(output.running().contains(expected), "{}", output.err);
    assert!(bench.bytes("one") == before, "nothing is changed");

    bench.palpate_ends(0, "rebuild one --accept-journal");
    let loss = &bench.manifest("one")["losses"][0];
    let recorded = loss["journal"].to_string();
    differences.iter().for_each(|it| assert!(recorded.contains(it), "no {it:?} in {loss}"));
    assert!(bench.read("one/journal.log").contains("\"loss\":{"), "the journal records it");
}

fn answers_again(bench: &TestFolder) {
    for (words, written) in READERS.into_iter().filter(|(words, _)| !words.starts_with("certificate")) {
        let output = bench.palpate_ends(0, words);
        assert!(!output.err.contains("warning"), "{words}: {}", output.err);
        assert!(written.is_empty() || bench.has(written), "{words}");
    }
    let output = bench.palpate_ends(0, "verify one");
    assert!(output.out.contains("its journal was exchanged, accepted 2"), "{}", output.out);
}

#[test]
fn the_journal_of_another_run_is_refused_by_every_command_until_it_is_accepted() {
    let bench = two_runs();
    copy(&bench, "two/journal.log", "one/journal.log");
    is_refused_until_accepted(&bench, &["sensor S-2, manifest.json states S-1", "seed 2, manifest.json states 1"]);
    assert_eq!(bench.manifest("one")["sensor"], "S-2");
    assert_eq!(bench.manifest("one")["status"], "complete");
    assert_eq!(bench.read("one/presses.csv"), bench.read("two/presses.csv"));
    answers_again(&bench);
    assert!(bench.read("page.html").contains("journal exchanged"));
}

#[test]
fn a_journal_that_was_edited_with_its_checksums_is_refused_until_it_is_accepted() {
    let bench = two_runs();
    let journal = bench.read("one/journal.log");
    bench.write("one/journal.log", &moved(&journal));
    is_refused_until_accepted(&bench, &[]);
    answers_again(&bench);
    // of the same size: one digit of an output
    bench.palpate_ends(0, "run r.toml --out third");
    let journal = bench.read("third/journal.log");
    let (number, line) =
        journal.lines().enumerate().find(|(_, line)| line.contains("{\"contact\":")).expect("a contact");
    let json = line.splitn(3, ' ').nth(2).expect("a record");
    let (before, after) = (format!("{line}\n"), exchanged(json, "\"force_set_n\":1.0", "\"force_set_n\":2.0"));
    bench.write("third/journal.log", &journal.replacen(&before, &(sealed(number as u64, &after) + "\n"), 1));
    let output = bench.palpate_ends(2, "evaluate third");
    assert!(output.running().contains("describes: its SHA-256 differs"), "{}", output.err);
}

#[test]
fn incomplete_run_continues_only_with_its_own_journal() {
    let bench = two_runs();
    for run in ["one", "two"] {
        cut_to_lines(&bench, run, lines_before_contacts(&bench, run) + 2);
    }
    let own = bench.read("one/journal.log");
    copy(&bench, "two/journal.log", "one/journal.log");
    is_refused_until_accepted(&bench, &["sensor S-2, manifest.json states S-1"]);
    bench.palpate_ends(0, "resume one");
    bench.palpate_ends(0, "verify one");
    // and one of another recipe or rig, for any labels
    for (text, from, to) in
        [("recipe.toml", "force_n = 1.0", "force_n = 0.9"), ("rig.toml", "speed_mm_s = 10.0", "speed_mm_s = 9.0")]
    {
        let recipe = if text == "recipe.toml" { exchanged(SMALL, from, to) } else { SMALL.to_owned() };
        bench.write("other.toml", &recipe);
        let rig = shipped_text("rigs/sim.toml");
        bench.write("rig.toml", &if text == "rig.toml" { exchanged(&rig, from, to) } else { rig });
        let _ = fs::remove_dir_all(bench.path("other"));
        bench.palpate_ends(0, "run other.toml --rig rig.toml --out other --sensor S-1");
        cut_to_lines(&bench, "other", lines_before_contacts(&bench, "other") + 2);
        bench.write("other/journal.log", &own);
        let output = bench.palpate_ends(2, "resume other");
        assert!(output.running().contains(&format!("another text of {text}")), "{}", output.err);
    }
}
