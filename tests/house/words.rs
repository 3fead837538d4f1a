//! The English that a person reads: unwanted words in strings and docs of the program.

use std::fs;
use std::path::{Path, PathBuf};

/// Refused in strings and docs, with the alternative.
const EVERYWHERE: [(&str, &str); 16] = [
    ("told", "reported, given, known"),
    ("tell", "report, show, distinguish"),
    ("tells", "reports, shows, distinguishes"),
    ("anew", "again"),
    ("held against", "compared with, checked against"),
    ("whatever", "any"),
    ("nearest right", "nearest correct"),
    ("ask for at most", "use at most"),
    ("drawn from", "random seed for"),
    ("reckoned", "assumed, computed"),
    ("goes on", "continues"),
    ("gone on", "continued"),
    ("go on", "continue"),
    ("to come", "expected"),
    ("whoever", "the program that"),
    ("in place of", "instead of"),
];

/// Refused in strings: messages, help, keys and reports.
const IN_STRINGS: [(&str, &str); 17] = [
    ("beside", "next to, in addition to"),
    ("lie", "is"),
    ("stands", "is"),
    ("says", "reports, states"),
    ("comes to", "is"),
    ("by itself", "without a command"),
    ("so much", "the amount"),
    ("so many", "the number"),
    ("put right", "correct"),
    ("bears", "can take"),
    ("borne", "taken"),
    ("nobody", "no person"),
    ("anything", "name it"),
    ("turned", "rotated"),
    ("alike", "similar, the same"),
    ("as it was", "unchanged"),
    ("heeds", "follows"),
];

/// Fewest strings and docs: with fewer this test doesn't read them any more.
const READ_LEAST: usize = 5000;

#[test]
fn listed_words_are_in_no_string_and_no_doc() {
    let mut files = Vec::new();
    for folder in ["src", "crates"] {
        collect(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &mut files);
    }
    files.sort();
    let (mut found, mut read) = (Vec::new(), 0);
    for file in files.iter().filter(|file| !is_test(file)) {
        let source = fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let source = source.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        for Text { line, is_doc, text } in texts(source) {
            read += 1;
            if !is_doc && !text.trim().contains(' ') {
                continue; // a name, not a sentence
            }
            let words = plain(&text, is_doc);
            let listed = EVERYWHERE.iter().chain(IN_STRINGS.iter().filter(|_| !is_doc));
            for (word, instead) in listed.filter(|(word, _)| words.contains(&format!(" {word} "))) {
                found.push(format!("{}:{line}: \"{word}\": write {instead}", file.display()));
            }
        }
    }
    assert!(found.is_empty(), "{} listed words:\n{}", found.len(), found.join("\n"));
    assert!(read > READ_LEAST, "only {read} strings and docs were read");
}

#[test]
fn the_scanner_reads_strings_and_docs_and_no_code() {
    let source = r##"//! One.
let tells = 'x'; /// Two `tells` three.
// tells
const A: &str = "four {output} \"five\""; const B: char = '"'; fn f<'a>() { r#"six "seven""#; }
"##;
    let read: Vec<(usize, String)> = texts(source).map(|text| (text.line, plain(&text.text, text.is_doc))).collect();
    let words = [(1, "one"), (2, "two three"), (4, "four five"), (4, "six seven")];
    assert_eq!(read.len(), words.len(), "{read:?}");
    for ((line, text), (expected_line, expected)) in read.iter().zip(words) {
        let squeezed = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!((*line, squeezed(text)), (expected_line, squeezed(expected)));
    }
}

/// A string literal or a line of docs.
struct Text {
    line: usize,
    is_doc: bool,
    text: String,
}

/// The words of a text with one blank around each; without braces of a string and code marks of a doc.
fn plain(text: &str, is_doc: bool) -> String {
    let (open, close) = if is_doc { ('`', '`') } else { ('{', '}') };
    let (mut words, mut is_code) = (String::from(" "), false);
    for letter in text.chars() {
        if is_code || letter == open {
            is_code = if is_code { letter != close } else { true };
            words.push(' ');
        } else {
            words.push(if letter.is_alphanumeric() || letter == '\'' { letter.to_ascii_lowercase() } else { ' ' });
        }
    }
    format!(" {} ", words.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Every string literal and every line of docs of a source.
fn texts(source: &str) -> impl Iterator<Item = Text> {
    let (mut rest, mut line, mut found) = (source, 1, Vec::new());
    while let Some(letter) = rest.chars().next() {
        let (taken, text) = if rest.starts_with("//") {
            let end = rest.find('\n').unwrap_or(rest.len());
            let is_doc = rest.starts_with("///") || rest.starts_with("//!");
            (end, is_doc.then(|| (true, rest[3..end].to_owned())))
        } else if let Some(marks) = raw_marks(rest) {
            let (from, close) = (marks + 2, format!("\"{}", "#".repeat(marks)));
            let end = rest[from..].find(&close).map_or(rest.len(), |at| from + at);
            ((end + close.len()).min(rest.len()), Some((false, rest[from..end].to_owned())))
        } else if letter == '"' {
            let end = closing(rest);
            (end + 1, Some((false, rest[1..end].replace("\\\n", " ").replace("\\n", " ").replace('\\', " "))))
        } else if letter == '\'' {
            (character(rest), None)
        } else if letter.is_alphanumeric() || letter == '_' {
            (rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len()), None)
        } else {
            (letter.len_utf8(), None)
        };
        found.extend(text.map(|(is_doc, text)| Text { line, is_doc, text }));
        line += rest[..taken].matches('\n').count();
        rest = &rest[taken..];
    }
    found.into_iter()
}

/// Number of `#` at the beginning of a raw string, if one begins here.
fn raw_marks(rest: &str) -> Option<usize> {
    let after = rest.strip_prefix('r')?;
    let marks = after.len() - after.trim_start_matches('#').len();
    after[marks..].starts_with('"').then_some(marks)
}

/// End of a string.
fn closing(rest: &str) -> usize {
    let mut is_escaped = false;
    for (at, letter) in rest.char_indices().skip(1) {
        match letter {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return at,
            _ => {}
        }
    }
    rest.len() - 1
}

/// Length of a character literal, or of the mark of a lifetime.
fn character(rest: &str) -> usize {
    let mut letters = rest.char_indices().skip(1);
    match (letters.next(), letters.next()) {
        (Some((_, '\\')), Some((at, _))) => rest[at + 1..].find('\'').map_or(1, |end| at + 1 + end + 1),
        (Some(_), Some((at, '\''))) => at + 1,
        _ => 1,
    }
}

fn is_test(file: &Path) -> bool {
    file.ends_with("tests.rs") || file.iter().any(|part| part == "tests")
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        match entry.is_dir() {
            true => collect(&entry, files),
            false if entry.extension().is_some_and(|ending| ending == "rs") => files.push(entry),
            false => {}
        }
    }
}
