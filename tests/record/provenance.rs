//! Provenance in a run folder: its program, its sources, and whether it has changed.

use palpate_testing::interrupted::{cut_back, cut_to_lines, sealed};
use palpate_testing::{SMALL, TestFolder, exchanged};

const VIEWS: [&str; 6] =
    ["manifest.json", "presses.csv", "characteristics.csv", "calibration_matrix.csv", "test_matrix.csv", "scene.csv"];

/// A complete run.
fn whole() -> TestFolder {
    let bench = TestFolder::with([("r.toml", SMALL)]);
    bench.palpate_ends(0, "run r.toml --out run");
    bench
}

#[test]
fn changed_views_are_named_and_rebuilt_byte_for_byte() {
    let bench = whole();
    let output = bench.palpate_ends(0, "verify run");
    assert!(output.out.contains("files unchanged") && !output.out.contains("isn't complete"), "{}", output.out);
    let before = bench.bytes("run");
    for name in VIEWS {
        let path = format!("run/{name}");
        let text = bench.read(&path);
        for (changed, described_as) in [
            (text.replacen('1', "2", 1), name),
            (text[..text.len() / 2].to_owned(), name),
            (text.clone() + "\n", name),
            (String::new(), name),
        ] {
            if name == "manifest.json" && changed == text.clone() + "\n" {
                continue; // JSON may end with any number of line ends
            }
            bench.write(&path, &changed);
            let output = bench.palpate_ends(1, "verify run");
            assert!(output.running().contains(described_as), "{name}: {}", output.err);
            bench.palpate_ends(0, "rebuild run");
            assert!(bench.bytes("run") == before, "{name} is made anew as it was");
        }
        std::fs::remove_file(bench.path(&path)).expect("a file");
        bench.palpate_ends(1, "verify run");
        bench.palpate_ends(0, "rebuild run");
        assert!(bench.bytes("run") == before, "{name} is made anew as it was");
    }
    // data that no journal has are reported, and stay
    for name in ["recipe.toml", "rig.toml"] {
        let path = format!("run/{name}");
        let text = bench.read(&path);
        bench.write(&path, &(text.clone() + "# of another hand\n"));
        for _ in 0..2 {
            let output = bench.palpate_ends(1, "verify run");
            assert!(output.running().contains(&format!("{name} has")), "{}", output.err);
            bench.palpate_ends(0, "rebuild run");
        }
        bench.write(&path, &text);
        bench.palpate_ends(0, "rebuild run");
        bench.palpate_ends(0, "verify run");
    }
}

#[test]
fn edited_manifest_hides_nothing() {
    let bench = whole();
    let (manifest, presses) = (bench.read("run/manifest.json"), bench.read("run/presses.csv"));
    let files = manifest.find("\n  \"files\": [").expect("files");
    bench.write("run/manifest.json", &(manifest[..files].to_owned() + "\n  \"files\": []\n}\n"));
    bench.write("run/presses.csv", &presses.replacen("0,0", "0,1", 1));
    let output = bench.palpate_ends(1, "verify run");
    assert!(output.running().contains("has no SHA-256 of presses.csv"), "{}", output.err);
    assert!(output.running().contains("presses.csv differs from the journal"), "{}", output.err);
    // a complete run that lost a table gets it back when it is opened
    let output = bench.palpate_ends(0, "resume run");
    assert!(output.err.contains("its tables were regenerated"), "{}", output.err);
    assert_eq!(bench.read("run/presses.csv"), presses);
    // a table of another run isn't used
    std::fs::remove_file(bench.path("run/scene.csv")).expect("a file");
    bench.palpate_ends(1, "verify run");
    let simple = SMALL.split("[[step]]").take(3).collect::<Vec<_>>().join("[[step]]");
    bench.write("simple.toml", &simple);
    bench.palpate_ends(0, "run simple.toml --out simple");
    std::fs::copy(bench.path("run/test_matrix.csv"), bench.path("simple/test_matrix.csv")).expect("a copy");
    let output = bench.palpate_ends(1, "verify simple");
    assert!(output.running().contains("test_matrix.csv differs from the journal"), "{}", output.err);
    bench.palpate_ends(0, "rebuild simple");
    assert!(!bench.has("simple/test_matrix.csv"));
    bench.palpate_ends(0, "verify simple");
}

#[test]
fn resumed_run_uses_its_own_recipe_and_names_its_rig() {
    let bench = whole();
    let (journal, recipe, rig) =
        (bench.read("run/journal.log"), bench.read("run/recipe.toml"), bench.read("run/rig.toml"));
    cut_to_lines(&bench, "run", journal.lines().count() - 2);
    bench.write("run/recipe.toml", &exchanged(&recipe, "force_n = 1.0", "force_n = 0.9"));
    let output = bench.palpate_ends(2, "resume run");
    assert!(output.running().contains("recipe.toml has changed since the start of the run"), "{}", output.err);
    bench.write("run/recipe.toml", &recipe);
    bench.write("run/rig.toml", &(rig + "# on another port now\n"));
    bench.palpate_ends(0, "resume run");
    bench.palpate_ends(0, "verify run");
    let manifest = bench.manifest("run");
    let sha256 = |session: usize, text: usize| manifest["sessions"][session]["texts"][text]["sha256"].as_str();
    assert!(sha256(0, 0).is_some() && sha256(0, 0) == sha256(1, 0) && sha256(0, 1) != sha256(1, 1), "{manifest}");
}

#[test]
fn changed_journal_is_refused_and_a_cut_one_is_incomplete() {
    let bench = whole();
    let journal = bench.read("run/journal.log");
    bench.write("run/journal.log", &journal.replacen("\"force_n\":0", "\"force_n\":1", 1));
    for words in ["verify run", "rebuild run", "resume run"] {
        let output = bench.palpate(words);
        assert!(output.running().contains("is damaged: the checksum is wrong"), "{words}: {}", output.err);
        assert_eq!(output.code, Some(if words == "verify run" { 1 } else { 2 }), "{words}");
    }
    bench.write("run/journal.log", &journal);
    cut_to_lines(&bench, "run", journal.lines().count() - 1);
    let output = bench.palpate_ends(0, "verify run");
    assert!(output.out.contains("the run isn't complete"), "{}", output.out);
    bench.palpate_ends(0, "resume run");
    bench.palpate_ends(0, "verify run");
    assert_eq!(bench.manifest("run")["sessions"].as_array().map(Vec::len), Some(2), "who went on is kept");
}

#[test]
fn clock_set_back_changes_only_reported_times() {
    let bench = whole();
    let whole = bench.read("run/presses.csv");
    // as after a power cut before the last press, with a start in the future
    let journal = bench.read("run/journal.log");
    let lines: Vec<&str> = journal.lines().collect();
    let (began, rest) = (lines[1], &lines[2..lines.len() - 2]);
    let json = began.splitn(3, ' ').nth(2).expect("a record");
    let later = exchanged(json, "\"started\":\"20", "\"started\":\"29");
    let began = sealed(1, &later);
    let text: Vec<&str> = [lines[0], &began].into_iter().chain(rest.iter().copied()).collect();
    cut_back(&bench, "run", (text.join("\n") + "\n").as_bytes());
    bench.palpate_ends(0, "resume run");
    let manifest = bench.manifest("run");
    let started = manifest["sessions"][0]["started"].as_str().expect("a time").to_owned();
    assert!(started.as_str() > manifest["ended"].as_str().expect("a time"), "{manifest}");
    assert_eq!(manifest["status"], "complete");
    let places = |text: &str| text.lines().map(|line| line.split(',').take(6).collect::<String>()).collect::<Vec<_>>();
    assert_eq!(places(&bench.read("run/presses.csv")), places(&whole));
    bench.palpate_ends(0, "verify run");
}

#[test]
fn a_name_that_leads_out_of_the_folder_is_not_followed() {
    let bench = whole();
    bench.write("secret.txt", "not of this run");
    let manifest = bench.read("run/manifest.json");
    bench.write("run/manifest.json", &exchanged(&manifest, "\"presses.csv\"", "\"../secret.txt\""));
    let output = bench.palpate_ends(1, "verify run");
    assert!(
        output.running().contains("\"../secret.txt\" is not a valid name of a file in a run folder"),
        "{}",
        output.err
    );
    // neither do the names of texts in a journal
    let journal = bench.read("run/journal.log");
    let lines: Vec<&str> = journal.lines().collect();
    for name in ["../secret.txt", "/dev/zero", "run.fifo/.."] {
        let began = exchanged(lines[1].splitn(3, ' ').nth(2).expect("a record"), "\"rig.toml\"", &format!("{name:?}"));
        let text: Vec<String> = [lines[0].to_owned(), sealed(1, &began)]
            .into_iter()
            .chain(lines[2..lines.len() - 2].iter().map(|line| (*line).to_owned()))
            .collect();
        bench.write("run/journal.log", &journal);
        bench.write("run/manifest.json", &manifest);
        bench.palpate_ends(0, "rebuild run");
        cut_back(&bench, "run", (text.join("\n") + "\n").as_bytes());
        let output = bench.palpate("resume run");
        assert!(output.running().contains("is not a valid name of a file in a run folder"), "{}", output.err);
        assert_eq!(output.code, Some(2), "{}", output.err);
    }
    // nor those of the texts themselves
    let nth = lines.iter().position(|line| line.contains(" {\"text\":{\"name\":\"rig.toml\"")).expect("the rig");
    let text = exchanged(lines[nth].splitn(3, ' ').nth(2).expect("a record"), "\"rig.toml\"", "\"../secret.txt\"");
    let changed = sealed(nth as u64, &text);
    let rest = lines[nth + 1..lines.len() - 2].iter().copied();
    let text: Vec<&str> = lines[..nth].iter().copied().chain([changed.as_str()]).chain(rest).collect();
    for words in ["resume run", "rebuild run"] {
        cut_back(&bench, "run", (text.join("\n") + "\n").as_bytes());
        let output = bench.palpate_ends(2, words);
        assert!(output.running().contains("is not a valid name of a file in a run folder"), "{words}: {}", output.err);
    }
    assert_eq!(bench.read("secret.txt"), "not of this run");
    bench.write("run/journal.log", &journal);
    bench.write("run/manifest.json", &manifest);
    // a register map is in the folder of its rig, and nowhere else
    let rig = bench.read("run/rig.toml");
    bench.write("climbing.toml", &exchanged(&rig, "\"labjack-t7\"", "\"../map.toml\""));
    let output = bench.palpate_ends(2, "run r.toml --rig climbing.toml --out climbed");
    assert!(output.running().contains("there is no register map \"../map.toml\""), "{}", output.err);
    bench.write("named.toml", &exchanged(SMALL, "name = \"small\"", "name = \"../small\""));
    let output = bench.palpate_ends(2, "run named.toml");
    assert!(output.running().contains("which isn't a valid folder name"), "{}", output.err);
    assert!(!bench.has("climbed") && !bench.has("runs"));
}
