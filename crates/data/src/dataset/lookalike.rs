//! Columns of an external table that aren't used although their names look like a force, a depth, a place or an output. They are reported,
//! so that nobody assumes they were used.

use super::press::{COLUMNS, Presence};
use super::table_error::quoted;
use csv::StringRecord;

/// A column that isn't used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lookalike {
    /// Name in the table; only its first characters if it is long.
    pub column: String,
    /// Quantity that the name looks like.
    pub looks_like: &'static str,
    /// Column from which this quantity is read.
    pub read_from: &'static str,
}

/// Beginnings of the words that name each kind of value, and single letters with the same meaning.
const KINDS: [(&str, &str, &[&str], &[&str]); 4] = [
    ("a force", "force_n", &["force", "load", "newton"], &["f", "fx", "fy", "fz", "n"]),
    ("a depth", "depth_mm", &["depth", "indentation"], &[]),
    ("a place", "x_mm, y_mm", &["pos", "place", "location", "coord"], &["x", "y", "px", "py"]),
    ("an output", "out_1, out_2, ...", &["out", "ch", "adc", "sensor", "signal", "taxel", "volt"], &["v"]),
];

/// Returns the columns of a header that resemble a known column but aren't read. `named` are read too.
pub(super) fn lookalikes(header: &StringRecord, named: &[&str]) -> Vec<Lookalike> {
    let is_read = |name: &str| {
        let of_any_table = |presence| matches!(presence, Presence::Needed | Presence::Optional | Presence::OfRun);
        COLUMNS.iter().any(|column| column.name == name && of_any_table(column.presence)) || is_output(name)
    };
    let unused = header.iter().filter(|name| !is_read(name) && !named.contains(name));
    let lookalike = |name: &str| {
        let (looks_like, read_from, ..) = KINDS.into_iter().find(|(_, _, words, letters)| {
            let lower = name.to_lowercase();
            let mut parts = lower.split(|c: char| !c.is_alphabetic()).filter(|part| !part.is_empty());
            parts.any(|part| letters.contains(&part) || words.iter().any(|word| part.starts_with(word)))
        })?;
        Some(Lookalike { column: quoted(name), looks_like, read_from })
    };
    unused.filter_map(lookalike).collect()
}

/// Whether a name is `out_1`, `out_2`, ...
fn is_output(name: &str) -> bool {
    name.strip_prefix("out_").is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn similar_column_names_are_suggested() {
        let header =
            "x_mm,y_mm,force_n,out_1,flags,depth_mm,Fz (N),Depth,force,X,pos_y,ch3,Sensor_4,time_s,temperature,note,n";
        let found = lookalikes(&StringRecord::from(header.split(',').collect::<Vec<_>>()), &[]);
        let found: Vec<(&str, &str)> = found.iter().map(|found| (found.column.as_str(), found.looks_like)).collect();
        assert_eq!(
            found,
            [
                ("Fz (N)", "a force"),
                ("Depth", "a depth"),
                ("force", "a force"),
                ("X", "a place"),
                ("pos_y", "a place"),
                ("ch3", "an output"),
                ("Sensor_4", "an output"),
                ("n", "a force"),
            ]
        );
    }
}
