//! Header of a table: positions of columns, and messages for missing columns.

use super::mapping::at_last_number;
use super::press::{COLUMNS, OUTPUTS, output_name};
use super::table_error::{MAX_COLUMNS, TableError, quoted};
use csv::StringRecord;

/// Header, and all data for messages about it.
pub(super) struct Header<'a> {
    pub file: &'a str,
    pub line: u64,
    pub names: &'a StringRecord,
    /// Message for a missing column that isn't only misspelt.
    pub help: &'static str,
}

impl Header<'_> {
    /// Checks that the header isn't empty, too long or ambiguous.
    pub(super) fn check(&self) -> Result<(), TableError> {
        let names = self.names;
        let is_repeated =
            |(index, name): &(usize, &str)| !name.is_empty() && names.iter().take(*index).any(|n| n == *name);
        if names.iter().all(str::is_empty) {
            return Err(TableError::Empty { file: self.file.to_owned() });
        }
        if names.len() > MAX_COLUMNS {
            return Err(TableError::TooLarge {
                file: self.file.to_owned(),
                line: Some(self.line),
                limit: MAX_COLUMNS as u64,
                what: "columns",
            });
        }
        match names.iter().enumerate().find(is_repeated) {
            Some((_, name)) => {
                Err(TableError::DuplicateColumn { file: self.file.to_owned(), line: self.line, column: quoted(name) })
            }
            None => Ok(()),
        }
    }

    /// Returns the position of a column, if it exists.
    pub(super) fn optional(&self, column: &str) -> Option<usize> {
        self.names.iter().position(|name| name == column)
    }

    /// Returns the position of the column of this name, which contains `what`.
    pub(super) fn needed(&self, what: &str, name: &str) -> Result<usize, TableError> {
        self.optional(name).ok_or_else(|| TableError::MissingColumn {
            file: self.file.to_owned(),
            line: self.line,
            column: quoted(name),
            help: self.hint(what, name),
        })
    }

    /// Returns the positions of the outputs: the columns of these names, or `out_1`, `out_2`, ..., at least one and without a
    /// gap.
    pub(super) fn outputs(&self, names: Option<&[String]>) -> Result<Vec<usize>, TableError> {
        match names {
            Some(names) => names.iter().map(|name| self.needed(OUTPUTS, name)).collect(),
            None => {
                let count = self.count_outputs()?;
                (1..=count.max(1)).map(|unit| self.needed(OUTPUTS, &output_name(unit))).collect()
            }
        }
    }

    /// Returns the largest N of the `out_N` columns that the number of columns allows; 0 if there are no such columns.
    fn count_outputs(&self) -> Result<usize, TableError> {
        let numbered = |name: &&str| {
            name.strip_prefix("out_").is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
        };
        let names: Vec<&str> = self.names.iter().filter(numbered).collect();
        match names.iter().find(|name| name.starts_with("out_0")) {
            // Numbered from 0 or padded: no gap, but no output either.
            Some(name) => {
                Err(TableError::OutputNumber { file: self.file.to_owned(), line: self.line, column: quoted(name) })
            }
            // Without a gap, as many numbers as columns: the first that isn't among 1..=count is then missed by name.
            None => Ok(names.len()),
        }
    }

    /// Returns advice about a missing column: the most similar unknown name of the header, if one is similar.
    fn hint(&self, what: &str, column: &str) -> String {
        /// Least Jaro-Winkler similarity at which a name counts as a misspelling of another.
        const NEAR: f64 = 0.7;
        let number =
            column.strip_prefix("out_").and_then(|number| number.parse::<usize>().ok()).filter(|_| what == OUTPUTS);
        if let Some(number) = number {
            let is_there = |number| self.optional(&output_name(number)).is_some();
            if (1..=self.names.len()).any(|later| later > number && is_there(later)) {
                let alike = |name: &&str| name.to_lowercase().replace(['_', ' ', '-'], "") == format!("out{number}");
                return match self.names.iter().find(alike) {
                    Some(name) => format!("the header has `{}`: rename it to `{column}`", quoted(name)),
                    None => "number the outputs without a gap, in all tables and readings of this sensor".to_owned(),
                };
            }
            if let Some((first, last)) = self.series() {
                let (first, last) = (quoted(first), quoted(last));
                return format!(
                    "the header has {first} to {last}: if they are the outputs, add --columns outputs={first}..{last}"
                );
            }
        }
        let known: Vec<&str> = COLUMNS.iter().map(|column| column.name).collect();
        let is_known = |name: &str| known.contains(&name) || name.starts_with("out_");
        let unknown = self.names.iter().filter(|name| !name.is_empty() && !is_known(name));
        let lower = column.to_lowercase();
        let scored = unknown.map(|name| (strsim::jaro_winkler(&lower, &name.to_lowercase()), name));
        match scored.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(similarity, _)| *similarity > NEAR) {
            Some((_, name)) if what == OUTPUTS => {
                format!("the header has `{}`: rename it to `{column}` if it holds that", quoted(name))
            }
            Some((_, name)) => {
                let name = quoted(name);
                format!("the header has `{name}`: if it holds that, rename it, or add --columns \"{what}={name}\"")
            }
            // one of the program's own names
            None if number.is_some() || (what != OUTPUTS && known.contains(&column)) => self.help.to_owned(),
            None => self.name_list(),
        }
    }

    /// The columns of the header, the first of them if there are many.
    fn name_list(&self) -> String {
        const MOST: usize = 12;
        let names: Vec<String> = self.names.iter().take(MOST).map(|name| format!("`{}`", quoted(name))).collect();
        let more = if self.names.len() > MOST { ", ..." } else { "" };
        format!("the header has {}{more}: correct the name in --columns, or in the table", names.join(", "))
    }

    /// Returns the first and the last name of the header's longest series of numbered names, such as `ch0` and `ch15`; `None` if
    /// there is no series.
    fn series(&self) -> Option<(&str, &str)> {
        let is_next = |before: &str, name: &str| {
            let ((word, number), (other, next)) = (numbered(before)?, numbered(name)?);
            (word == other && number.checked_add(1) == Some(next)).then_some(())
        };
        let names: Vec<&str> = self.names.iter().collect();
        let runs = names.chunk_by(|before, name| is_next(before, name).is_some());
        let longest = runs.filter(|run| run.len() > 1).max_by_key(|run| run.len())?;
        Some((longest[0], longest[longest.len() - 1]))
    }
}

/// Returns a name without the number at its end, and the number.
fn numbered(name: &str) -> Option<(&str, usize)> {
    let (word, number, rest) = at_last_number(name)?;
    Some((word, number.parse().ok().filter(|_| rest.is_empty())?))
}
