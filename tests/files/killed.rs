//! A writer of a lake that is killed at any time: no reader sees a part of a run.

use crate::bench;
use palpate_testing::{TestFolder, campaign};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// Kills: quick and full.
const KILLS: (usize, usize) = (5, 20);

/// Rows of the visible files of presses.
///
/// A file that is replaced during the search is searched for again.
pub(crate) fn visible(lake: &Path) -> Vec<(PathBuf, i64)> {
    let mut found = Vec::new();
    let mut folders = vec![lake.join("presses")];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = fs::read_dir(&folder) else { continue };
        for path in entries.map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let file = File::open(&path).unwrap();
            let file = SerializedFileReader::new(file).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            let metadata = file.metadata();
            let in_groups: i64 = metadata.row_groups().iter().map(|group| group.num_rows()).sum();
            assert_eq!(in_groups, metadata.file_metadata().num_rows());
            found.push((path, in_groups));
        }
    }
    found
}

/// A run after some of its presses: the beginning of its journal, its readings, and no other files.
fn cut(bench: &TestFolder, run: &str, part: &str, contacts: usize) {
    let journal = bench.read(&format!("{run}/journal.log"));
    let mut left = contacts;
    let kept = journal.lines().take_while(|line| {
        let is_contact = line.contains("{\"contact\":");
        left -= usize::from(is_contact && left > 0);
        !is_contact || left > 0
    });
    let kept: String = kept.map(|line| format!("{line}\n")).collect();
    fs::create_dir(bench.path(part)).unwrap();
    bench.write(&format!("{part}/journal.log"), &kept);
    fs::copy(bench.path(&format!("{run}/series.arrows")), bench.path(&format!("{part}/series.arrows"))).unwrap();
}

#[test]
fn killed_writer_leaves_complete_runs() {
    let kills = campaign::size(KILLS.0, KILLS.1);
    let bench = bench([("runs/a", "--sensor A --design d"), ("runs/b", "--sensor B --design d")]);
    let lake = bench.path("lake");
    for run in ["a", "b"] {
        cut(&bench, &format!("runs/{run}"), &format!("part-{run}"), 60);
    }
    bench.palpate_ends(0, "export part-a part-b --lake lake");
    let parts: BTreeSet<i64> = visible(&lake).iter().map(|(_, rows)| *rows).collect();
    bench.palpate_ends(0, "export runs/a runs/b --lake lake");
    let wholes: BTreeSet<i64> = visible(&lake).iter().map(|(_, rows)| *rows).collect();
    assert!(parts.len() == 1 && wholes.len() == 1 && parts != wholes, "{parts:?} {wholes:?}");
    let allowed: BTreeSet<i64> = &parts | &wholes;
    let spawned = |runs: &str| {
        let mut command = bench.command(&format!("export {runs} --lake lake"));
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    };
    // the time of a kill is a number of looks of the reader; a writer that isn't killed shows their number
    let (mut whole, mut writer) = (0, spawned("runs/a runs/b"));
    while writer.try_wait().unwrap().is_none() {
        visible(&lake);
        whole += 1;
    }
    let (mut passes, mut unfinished, mut changes) = (0, 0, BTreeSet::new());
    for kill in 0..kills {
        let runs = if kill % 2 == 0 { "part-a part-b" } else { "runs/a runs/b" };
        let (mut writer, mut looks) = (spawned(runs), 0);
        while looks <= whole * kill / kills && writer.try_wait().unwrap().is_none() {
            let seen = visible(&lake);
            assert!(seen.iter().all(|(_, rows)| allowed.contains(rows)), "{seen:?} of {allowed:?}");
            changes.insert(seen.iter().map(|(_, rows)| *rows).collect::<Vec<_>>());
            looks += 1;
        }
        unfinished += usize::from(writer.try_wait().unwrap().is_none());
        writer.kill().unwrap();
        writer.wait().unwrap();
        passes += looks;
        let seen = visible(&lake);
        assert_eq!(seen.len(), 2, "{seen:?}");
        assert!(seen.iter().all(|(_, rows)| allowed.contains(rows)), "{seen:?} of {allowed:?}");
        for (path, _) in seen {
            let of_run = path.to_string_lossy().replace("/presses/", "/runs/");
            assert!(Path::new(&of_run).is_file(), "{of_run}");
        }
    }
    bench.palpate_ends(0, "export runs/a runs/b --lake lake");
    assert_eq!(visible(&lake).iter().map(|(_, rows)| *rows).collect::<BTreeSet<i64>>(), wholes);
    assert_eq!(fs::read_dir(lake.join(".drafts")).unwrap().count(), 0, "drafts of killed writers are removed");
    println!(
        "{kills} kills, {unfinished} of writers at work, {passes} looks at the lake, {} states seen",
        changes.len()
    );
}
