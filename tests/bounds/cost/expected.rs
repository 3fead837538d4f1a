//! Compares counts with those of `cost.toml`, or writes them there.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, Write as _};
use toml_edit::{DocumentMut, Value};

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bounds/cost.toml");

/// Environment variable that writes what was found into the file.
const VARIABLE: &str = "PALPATE_COST";
const UPDATE: &str = "update";

/// A table of the file: counts of one kind.
#[derive(Debug)]
pub(super) struct Table {
    pub name: &'static str,
    /// What is counted.
    pub of: &'static str,
    /// Change without an effect, as a fraction of the expected count.
    pub share: f64,
    /// The same, as a count: the larger of both is used.
    pub least: f64,
    /// Decimals of a count in the file.
    pub decimals: usize,
}

/// A count that was found.
#[derive(Debug)]
pub(super) struct Count {
    pub name: String,
    pub found: f64,
    /// Command that shows where it was spent.
    pub shown_by: String,
}

/// Counts of a table, and the reasons why others are missing.
pub(super) type Counted = Vec<Result<Count, String>>;

/// Compares counts with tables of the file. With `PALPATE_COST=update` it writes them there.
///
/// # Panics
/// A count has changed, or a case couldn't be counted.
pub(super) fn check(counted: impl IntoIterator<Item = (&'static Table, Counted)>) {
    let problems: Vec<String> = counted.into_iter().flat_map(|(table, counted)| table.problems(counted)).collect();
    assert!(
        problems.is_empty(),
        "the cost has changed:\n\n{}\n\nIf a change is meant to cost this, write the new counts by the same command with \
         {VARIABLE}={UPDATE}, and commit them with the reason.",
        problems.join("\n\n"),
    );
}

impl Table {
    fn problems(&self, counted: Counted) -> Vec<String> {
        let (mut counts, mut problems) = (Vec::new(), Vec::new());
        counted.into_iter().for_each(|counted| match counted {
            Ok(count) => counts.push(count),
            Err(why) => problems.push(why),
        });
        for Count { name, found, .. } in &counts {
            println!("{name:<40} {:>14} {}", self.written(*found), self.of);
        }
        let is_update = std::env::var_os(VARIABLE).is_some_and(|value| value == UPDATE);
        let expected = if is_update { self.write(&counts) } else { self.read() };
        for count in &counts {
            problems.extend(self.problem(expected.get(&count.name).copied(), count));
        }
        if problems.is_empty() {
            let stale = expected.keys().filter(|name| counts.iter().all(|count| count.name != **name));
            problems.extend(stale.map(|name| format!("{name}: no case has this name: remove it from cost.toml")));
        }
        problems
    }

    /// A change of a count that is more than noise. A count that fell is a problem too: as long as the old one is expected, a later
    /// change can take back what was gained without being seen.
    fn problem(&self, expected: Option<f64>, Count { name, found, shown_by }: &Count) -> Option<String> {
        let Some(expected) = expected else {
            return Some(format!("{name}: {} {}, and cost.toml has no count for it", self.written(*found), self.of));
        };
        let change = found - expected;
        if change.abs() <= self.least.max(self.share * expected) {
            return None;
        }
        let percent = if expected > 0.0 { format!(" ({:+.1} %)", 100.0 * change / expected) } else { String::new() };
        let (how, what_next) = match change > 0.0 {
            true => ("grew", format!("To see where: {shown_by}")),
            false => ("fell: lower the expected count", "So nothing can grow back to it unseen.".to_owned()),
        };
        let (expected, found) = (self.written(expected), self.written(*found));
        Some(format!("{name} {how}: expected {expected} {}, found {found}{percent}\n  {what_next}", self.of))
    }

    /// The counts of the file.
    fn read(&self) -> BTreeMap<String, f64> {
        let text = std::fs::read_to_string(FILE).unwrap_or_else(|error| panic!("{FILE}: {error}"));
        self.counts(&document(&text))
    }

    /// Writes counts instead of those of the file, and returns them. Tests that run at the same time write other tables: each waits.
    fn write(&self, counts: &[Count]) -> BTreeMap<String, f64> {
        let mut file = File::options().read(true).write(true).open(FILE).expect("the file of the expected counts");
        file.lock().expect("a file that can be locked");
        let mut text = String::new();
        file.read_to_string(&mut text).expect("text");
        let mut document = document(&text);
        let kept = document[self.name].or_insert(toml_edit::table()).as_table_mut().expect("a table");
        kept.retain(|name, _| counts.iter().any(|count| count.name == name));
        for Count { name, found, .. } in counts {
            kept[name.as_str()] = toml_edit::value(self.written(*found).parse::<Value>().expect("a number"));
        }
        file.rewind().expect("a file");
        file.set_len(0).expect("a file that can be written");
        file.write_all(document.to_string().as_bytes()).expect("a file that can be written");
        self.counts(&document)
    }

    fn counts(&self, document: &DocumentMut) -> BTreeMap<String, f64> {
        let counts = document.get(self.name).and_then(|table| table.as_table()).into_iter().flatten();
        let number = |value: &toml_edit::Item| value.as_float().or(value.as_integer().map(|count| count as f64));
        counts.map(|(name, count)| (name.to_owned(), number(count).expect("a number"))).collect()
    }

    /// A count as in the file, with marks between thousands.
    fn written(&self, count: f64) -> String {
        let text = format!("{count:.*}", self.decimals);
        let whole = text.split('.').next().map_or(0, str::len);
        let mut written = String::new();
        for (index, digit) in text.chars().enumerate() {
            if (1..whole).contains(&index) && (whole - index).is_multiple_of(3) {
                written.push('_');
            }
            written.push(digit);
        }
        written
    }
}

fn document(text: &str) -> DocumentMut {
    text.parse().unwrap_or_else(|error| panic!("{FILE}: {error}"))
}

#[test]
fn a_count_that_grew_or_fell_is_named_with_both_numbers() {
    let instructions = Table { name: "instructions", of: "instructions", share: 0.05, least: 0.0, decimals: 0 };
    let allocations = Table { name: "allocations", of: "allocations a reading", share: 0.0, least: 0.5, decimals: 2 };
    let problem = |table: &Table, expected: Option<f64>, found: f64| {
        let count = Count { name: "fit".to_owned(), found, shown_by: "callgrind_annotate fit".to_owned() };
        table.problem(expected, &count)
    };
    for (expected, found) in [(1e6, 1.05e6), (1e6, 0.95e6), (0.0, 0.0)] {
        assert_eq!(problem(&instructions, Some(expected), found), None);
    }
    let grew =
        "fit grew: expected 1_000_000 instructions, found 1_051_000 (+5.1 %)\n  To see where: callgrind_annotate fit";
    assert_eq!(problem(&instructions, Some(1e6), 1.051e6).as_deref(), Some(grew));
    let fell = problem(&instructions, Some(1e6), 0.949e6).unwrap();
    assert!(fell.starts_with("fit fell: lower the expected count: expected 1_000_000"), "{fell}");
    assert!(problem(&instructions, None, 1.0).unwrap().contains("no count"));
    assert_eq!(problem(&allocations, Some(40.0), 40.4), None);
    let one_more = problem(&allocations, Some(0.0), 1.0).unwrap();
    assert!(one_more.starts_with("fit grew: expected 0.00 allocations a reading, found 1.00\n"), "{one_more}");
}
