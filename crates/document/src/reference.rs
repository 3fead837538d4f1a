//! Creates reference pages from lists of keys.

use super::key::{Absent, Key, Keys, ValueKind};

/// Returns a Markdown page with every key of a text. After `begin` there is a section for each table, the outermost with the
/// heading `root`. Each key has its type, bounds and unit, default, meaning and an example.
pub fn reference(begin: &str, root: &str, keys: &Keys) -> String {
    let mut page = begin.to_owned();
    section(&mut page, root, "", keys);
    page
}

/// Writes the section of a table and the sections of the tables in it.
fn section(page: &mut String, heading: &str, path: &str, keys: &Keys) {
    rows(page, &format!("## {heading}"), keys.always);
    if let Some(by) = keys.by {
        keys.cases.iter().for_each(|case| rows(page, &format!("With `{} = \"{}\"`:", by.name, case.name), case.keys));
    } else if keys.cases.iter().any(|case| case.keys.len() > 1) {
        keys.cases.iter().for_each(|case| rows(page, &format!("With `{}`:", case.name), case.keys));
    } else if !keys.cases.is_empty() {
        let names: Vec<String> = keys.cases.iter().map(|case| format!("`{}`", case.name)).collect();
        rows(page, &format!("Exactly one of {}:", names.join(", ")), keys.cases.iter().flat_map(|case| case.keys));
    }
    for key in keys.all() {
        let Some(inner) = key.inner() else { continue };
        let path = if path.is_empty() { key.name.to_owned() } else { format!("{path}.{}", key.name) };
        let heading = match key.kind {
            ValueKind::Tables(_) => format!("`[[{path}]]`"),
            _ => format!("`[{path}]`"),
        };
        section(page, &heading, &path, inner);
    }
}

/// Writes a line and, below it, a row for each key.
fn rows<'k>(page: &mut String, above: &str, keys: impl IntoIterator<Item = &'k Key>) {
    *page += &format!("\n{above}\n\n| key | value | default | meaning | example |\n|---|---|---|---|---|\n");
    keys.into_iter().for_each(|key| *page += &format!("{}\n", row(key)));
}

fn row(key: &Key) -> String {
    let default = match key.absent {
        Absent::Refused => "required".to_owned(),
        Absent::Allowed => "optional".to_owned(),
        Absent::Is(value) => format!("`{value}`"),
    };
    let example = if key.example.is_empty() { String::new() } else { format!("`{}`", key.example) };
    let cells = [format!("`{}`", key.name), value(&key.kind), default, key.meaning.to_owned(), example];
    format!("| {} |", cells.map(|cell| cell.replace('|', "\\|")).join(" | "))
}

/// Returns the type of a value, its bounds and unit.
fn value(kind: &ValueKind) -> String {
    let words = |words: &[&str]| words.iter().map(|word| format!("`\"{word}\"`")).collect::<Vec<_>>().join(", ");
    match kind {
        ValueKind::Number(bounds) => format!("number, {}", bounds.stated()),
        ValueKind::Range(bounds) => format!("`[from, to]`, each {}", bounds.stated()),
        ValueKind::Numbers(bounds) => format!("number or list of numbers, {}", bounds.stated()),
        ValueKind::PerUnit(bounds) => format!("list, one number for each unit, {}", bounds.stated()),
        ValueKind::Places(bounds) => format!("list of `[x, y]`, each {}", bounds.stated()),
        ValueKind::Matrix(bounds) => format!("three lists of three numbers, each {}", bounds.stated()),
        ValueKind::Rows(bounds) => format!("three lists of numbers, each {}", bounds.stated()),
        ValueKind::Whole(min, max) => format!("integer, {min} to {max}"),
        ValueKind::Wholes(min, max) => format!("list of integers, {min} to {max}"),
        ValueKind::Flag => "`true` or `false`".to_owned(),
        ValueKind::Text => "string".to_owned(),
        ValueKind::Texts => "list of strings".to_owned(),
        ValueKind::Word(list) => words(list),
        ValueKind::Words(list) => format!("list of {}", words(list)),
        ValueKind::Table(_) => "table".to_owned(),
        ValueKind::Tables(_) => "list of tables".to_owned(),
        ValueKind::Either(kinds) => kinds.iter().map(value).collect::<Vec<_>>().join("; or "),
    }
}
