//! Acknowledged rows, compared with the table that must contain them.

use super::TestFolder;
use serde_json::Value;
use std::collections::HashMap;

/// The columns of `presses.csv` with whole numbers, and those with words; all others have numbers.
const WHOLE: [&str; 2] = ["press", "level"];
const WORDS: [&str; 2] = ["phase", "flags"];

/// Results for acknowledged rows.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct StoredRow {
    /// Number of missing rows.
    pub lost: usize,
    /// Number of rows with another value in any column.
    pub changed: usize,
    /// The first of these.
    pub first: Option<String>,
}

/// The rows of a run's `presses.csv` as the objects that acknowledge them.
pub fn table(bench: &TestFolder, run: &str) -> Vec<Value> {
    let (header, rows) = bench.table(&format!("{run}/presses.csv"));
    let cell = |(column, cell): (&String, String)| {
        let value: Value = if WHOLE.contains(&column.as_str()) {
            cell.parse::<u64>().expect("a whole number").into()
        } else if WORDS.contains(&column.as_str()) {
            cell.into()
        } else if cell.is_empty() {
            Value::Null // not measured
        } else {
            cell.parse::<f64>().expect("a number").into()
        };
        (column.clone(), value)
    };
    rows.into_iter().map(|row| header.iter().zip(row).map(cell).collect()).collect()
}

/// A line that acknowledges a row.
pub fn json(line: &str) -> Value {
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{line}: {error}"))
}

/// Press and level of each row.
pub fn numbered(rows: &[Value]) -> Vec<(u64, u64)> {
    let number = |row: &Value, key: &str| row[key].as_u64().expect("a whole number");
    rows.iter().map(|row| (number(row, "press"), number(row, "level"))).collect()
}

/// Number of presses that the rows belong to.
pub fn presses(rows: &[Value]) -> usize {
    let mut presses: Vec<u64> = numbered(rows).into_iter().map(|(press, _)| press).collect();
    presses.sort_unstable();
    presses.dedup();
    presses.len()
}

/// Searches a table for each acknowledged row.
pub fn kept(acknowledged: &[Value], table: &[Value]) -> StoredRow {
    let there: HashMap<(u64, u64), &Value> = numbered(table).into_iter().zip(table).collect();
    let mut kept = StoredRow::default();
    for (row, number) in acknowledged.iter().zip(numbered(acknowledged)) {
        let what = match there.get(&number) {
            Some(same) if *same == row => continue,
            Some(other) => {
                kept.changed += 1;
                format!("changed to {other}")
            }
            None => {
                kept.lost += 1;
                "lost".to_owned()
            }
        };
        kept.first.get_or_insert_with(|| format!("{row}: {what}"));
    }
    kept
}
