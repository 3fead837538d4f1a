//! The firm rule of the house: imports run downward only, and rooms on one floor don't import each other.

use std::fs;
use std::path::{Path, PathBuf};

/// The floors from the ground up. A room may import those of the floors below its own.
const FLOORS: [&[&str]; 7] = [
    &["chart", "mechanics", "paper", "parallel", "quantity"],
    &["acceptance", "control", "device", "document", "scene", "solver", "wire"],
    &["driver", "emulator", "recipe"],
    &["dataset", "rig"],
    &["batch", "run"],
    &["export", "report", "study"],
    &["cli"],
];

#[test]
fn imports_run_downward_only() {
    let (mut imports, mut told) = (0, Vec::new());
    for path in sources() {
        let text = fs::read_to_string(&path).expect("a source file is text");
        let file = path.strip_prefix(root()).expect("under the root").display().to_string().replace('\\', "/");
        imports += imported(&file, &text).len();
        told.extend(arrows_up(&file, &text));
    }
    assert!(told.is_empty(), "imports that don't run downward:\n{}", told.join("\n"));
    assert!(imports > 100, "only {imports} imports were found: does this test still read what is there?");
}

#[test]
fn every_room_has_a_floor() {
    let entries = fs::read_dir(root().join("src")).expect("src can be read").map(|entry| entry.expect("an entry"));
    let rooms: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    let homeless = rooms.iter().map(|name| name.trim_end_matches(".rs")).filter(|room| {
        let is_room = !matches!(*room, "lib" | "main");
        is_room && floor(room).is_none()
    });
    assert_eq!(homeless.collect::<Vec<_>>(), [""; 0], "rooms in src/ that stand on no floor of this test");
}

#[test]
fn foreign_functions_are_called_in_one_file() {
    let allowed = "allow(unsafe_code";
    let allows = |path: &PathBuf| fs::read_to_string(path).expect("a source file is text").contains(allowed);
    let files: Vec<PathBuf> = sources().into_iter().filter(allows).collect();
    assert_eq!(files, [root().join("src/wire/daqmx/library.rs")], "files that allow themselves unsafe code");
}

#[test]
fn an_arrow_that_runs_up_is_told_with_its_file_and_line() {
    let upward = "//! Not an import: crate::cli\nuse crate::quantity::Place;\nuse crate::run::{Halt, walk};\n";
    assert_eq!(arrows_up("src/wire/line.rs", upward), ["src/wire/line.rs:3: wire -> run runs up"]);

    let grouped = "use crate::{\n    quantity::{Axis, Place},\n    // a comment\n    driver::Esp301,\n    scene,\n};\n";
    assert_eq!(
        arrows_up("src/emulator/esp301/mod.rs", grouped),
        ["src/emulator/esp301/mod.rs:4: emulator -> driver stays on the floor"]
    );

    let inline = "fn f() -> crate::rig::RigSpec {\n    $crate::cli::main()\n}\n";
    assert_eq!(
        arrows_up("src/dataset/table.rs", inline),
        ["src/dataset/table.rs:1: dataset -> rig stays on the floor", "src/dataset/table.rs:2: dataset -> cli runs up"]
    );

    let unknown = "use crate::attic::Box;\nuse crate::*;\nuse crate::{self as house};\n";
    assert_eq!(
        arrows_up("src/run/walk.rs", unknown),
        [
            "src/run/walk.rs:1: run -> attic, which has no floor",
            "src/run/walk.rs:2: run -> *, which has no floor",
            "src/run/walk.rs:3: run -> self, which has no floor",
        ]
    );

    let round_the_back = "use super::plan;\nuse super::super::run::walk;\nmod tests {\n    use super::super::cli;\n    \
                          use super::super::super::cli;\n}\n";
    assert_eq!(
        arrows_up("src/recipe/parse.rs", round_the_back),
        ["src/recipe/parse.rs:2: recipe -> run runs up", "src/recipe/parse.rs:5: recipe -> cli runs up"]
    );

    let downward = "use crate::{control::{Press, Task}, quantity};\nuse crate::recipe::Plan;\nlet a = \"crate\";\n";
    assert_eq!(arrows_up("src/recipe/plan.rs", downward), [""; 0]);
    assert_eq!(imported("src/recipe/plan.rs", downward).len(), 3);
}

/// Every import of a file that isn't to a floor below, as `file:line: from -> to`.
fn arrows_up(file: &str, text: &str) -> Vec<String> {
    let Some(from) = room_of(file) else { return Vec::new() };
    let judged = imported(file, text).into_iter().filter_map(|(line, to)| {
        let verdict = match (floor(from), floor(&to)) {
            _ if from == to => return None,
            (Some(here), Some(there)) if there < here => return None,
            (Some(here), Some(there)) if there == here => " stays on the floor",
            (_, None) => ", which has no floor",
            _ => " runs up",
        };
        Some(format!("{file}:{line}: {from} -> {to}{verdict}"))
    });
    judged.collect()
}

/// The rooms that a file's paths lead into, each with its line: `crate::room`, `crate::{room, ..}`, and `super::` often
/// enough to leave the room.
fn imported(file: &str, text: &str) -> Vec<(usize, String)> {
    let text = without_comments(text);
    let line = |at: usize| text[..at].matches('\n').count() + 1;
    let mut found = Vec::new();
    for (at, _) in text.match_indices("crate::").filter(|(at, _)| starts_a_path(&text, *at)) {
        let start = at + "crate::".len();
        found.extend(heads(&text[start..]).into_iter().map(|(offset, room)| (line(start + offset), room)));
    }
    for (at, _) in text.match_indices("super::").filter(|(at, _)| starts_a_path(&text, *at)) {
        let supers = text[at..].split("::").take_while(|part| *part == "super").count();
        if supers == depth(file, &text, at) {
            let start = at + supers * "super::".len();
            found.extend(heads(&text[start..]).into_iter().map(|(offset, room)| (line(start + offset), room)));
        }
    }
    found.sort();
    found
}

/// Whether a path begins here, rather than goes on (`a::super::`) or is part of a name.
fn starts_a_path(text: &str, at: usize) -> bool {
    !text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':')
}

/// The first name of a path, or of each path in a group, with its offset.
fn heads(path: &str) -> Vec<(usize, String)> {
    let name_at = |start: usize| {
        let skipped = path[start..].len() - path[start..].trim_start().len();
        let rest = &path[start + skipped..];
        let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        // a glob is kept as such: it has no floor and is told
        let name = if rest.starts_with('*') { "*" } else { &rest[..end] };
        (!name.is_empty()).then(|| (start + skipped, name.to_owned()))
    };
    if !path.starts_with('{') {
        return name_at(0).into_iter().collect();
    }
    let (mut depth, mut names) = (0, Vec::new());
    for (at, c) in path.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 1 && matches!(c, '{' | ',') {
            names.extend(name_at(at + 1));
        }
        if depth == 0 {
            break;
        }
    }
    names
}

/// How many modules deep a place in a file is; by the indentation of the modules in it, which the formatter sees to.
fn depth(file: &str, text: &str, at: usize) -> usize {
    let modules = file.trim_start_matches("src/").trim_end_matches(".rs").split('/');
    let of_file = modules.filter(|name| !matches!(*name, "mod" | "lib" | "main")).count();
    let indent = |line: &str| line.len() - line.trim_start().len();
    let mut open: Vec<usize> = Vec::new();
    for line in text[..at].lines().filter(|line| !line.trim().is_empty()) {
        while line.trim_start().starts_with('}') && open.last().is_some_and(|module| indent(line) <= *module) {
            open.pop();
        }
        let is_module = line.split_whitespace().any(|word| word == "mod") && line.ends_with('{');
        if is_module {
            open.push(indent(line));
        }
    }
    of_file + open.len()
}

/// The text with its comment lines emptied, so that line numbers stay. Nothing else is overlooked, not even tests.
fn without_comments(text: &str) -> String {
    let line = |line: &str| if line.trim_start().starts_with("//") { String::new() } else { line.to_owned() };
    text.lines().map(|text| line(text) + "\n").collect()
}

fn room_of(file: &str) -> Option<&str> {
    let room = file.strip_prefix("src/")?.split('/').next()?.trim_end_matches(".rs");
    (!matches!(room, "lib" | "main")).then_some(room)
}

fn floor(room: &str) -> Option<usize> {
    FLOORS.iter().position(|rooms| rooms.contains(&room))
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every source file.
fn sources() -> Vec<PathBuf> {
    let (mut folders, mut files) = (vec![root().join("src")], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a source folder can be read") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}
