//! Column separator and decimal mark of an external table.

use super::mapping::{Decimal, Mapping};
use super::table_error::TableError;
use csv::StringRecord;

/// Separator of a table, and the decimal marks of its numbers.
pub(super) struct Dialect {
    separator: u8,
    /// Whether a columns file states the separator.
    is_stated: bool,
    /// Decimal mark stated by a columns file.
    decimal: Option<Decimal>,
    /// First line with a decimal point in a number, and first line with a decimal comma.
    point: Option<u64>,
    comma: Option<u64>,
}

impl Dialect {
    /// Finds the separator with which the header has a column of this name: comma, semicolon or tab. Returns comma if no
    /// separator gives this column. `start` is the beginning of the table. Properties stated by the mapping aren't detected.
    pub(super) fn of_start(start: &[u8], column: &str, mapping: &Mapping) -> Self {
        let text = String::from_utf8_lossy(start);
        let is_header = |line: &&str| !line.trim().is_empty() && !is_comment(line);
        let header = text.trim_start_matches('\u{feff}').lines().find(is_header).unwrap_or_default();
        let has = |separator: &u8| {
            let mut names = header.split(char::from(*separator));
            names.any(|name| name.trim().trim_matches('"').trim() == column)
        };
        // without a header: the characters between its numbers
        let is_between = |separator: &u8| {
            let mut cells = header.split(char::from(*separator)).map(str::trim);
            let is_comma = *separator == b',';
            let is_numeric = |cell: &str| {
                cell.parse::<f64>().is_ok() || (is_comma && cell.is_empty()) || (!is_comma && is_number(cell, ','))
            };
            cells.clone().count() > 1 && cells.all(is_numeric)
        };
        let by_name = || [b',', b';', b'\t'].into_iter().find(has);
        let by_numbers = || [b',', b';', b'\t', b' '].into_iter().find(is_between);
        // the name is missing or misspelt: with the right separator the error names it
        let most = |separator: &u8| header.bytes().filter(|byte| byte == separator).count();
        let by_count = || [b'\t', b';', b','].into_iter().max_by_key(most);
        let detected = || by_name().or_else(by_numbers).or_else(by_count).unwrap_or(b',');
        let separator = mapping.separator.unwrap_or_else(detected);
        Dialect {
            separator,
            is_stated: mapping.separator.is_some(),
            decimal: mapping.decimal,
            point: None,
            comma: None,
        }
    }

    pub(super) fn separator(&self) -> u8 {
        self.separator
    }

    /// Replaces the decimal commas of a row's numbers by points. A table separated by commas has no decimal commas.
    ///
    /// # Errors
    /// The table has decimal points and decimal commas, so it is unknown which of them groups thousands.
    pub(super) fn with_points(&mut self, file: &str, line: u64, record: &mut StringRecord) -> Result<(), TableError> {
        if self.separator == b',' || self.decimal == Some(Decimal::Point) {
            return Ok(());
        }
        let marks = |mark: char| record.iter().any(|cell| is_number(cell.trim(), mark));
        let (has_point, has_comma) = (marks('.'), marks(','));
        self.point = self.point.or(has_point.then_some(line));
        self.comma = self.comma.or(has_comma.then_some(line));
        if let (Some(point), Some(comma)) = (self.point, self.comma) {
            return Err(TableError::TwoDecimalMarks { file: file.to_owned(), point, comma });
        }
        if has_comma {
            let written = |cell: &str| match is_number(cell.trim(), ',') {
                true => cell.replace(',', "."),
                false => cell.to_owned(),
            };
            *record = record.iter().map(written).collect();
        }
        Ok(())
    }

    /// Describes the detected format, if it isn't plain CSV.
    pub(super) fn detected(&self) -> Option<String> {
        let separator = match self.separator {
            b';' => "semicolons",
            b'\t' => "tabs",
            b' ' => "spaces",
            _ => return None,
        };
        if self.is_stated {
            return None;
        }
        let decimals = if self.comma.is_some() { ", decimal commas" } else { "" };
        Some(format!("columns are separated by {separator}{decimals}"))
    }
}

/// Whether a line above the header belongs to no column: a comment, or Excel's line with the separator, `sep=;`.
pub(super) fn is_comment(line: &str) -> bool {
    line.starts_with('#') || line.trim_matches('"').starts_with("sep=")
}

/// Whether a cell is a number with this decimal mark: `-0,5`, `1.5e-3`.
fn is_number(cell: &str, mark: char) -> bool {
    let Some((whole, rest)) = cell.split_once(mark) else { return false };
    let whole = whole.strip_prefix(['-', '+']).unwrap_or(whole);
    let (part, exponent) = rest.split_once(['e', 'E']).unwrap_or((rest, "0"));
    let exponent = exponent.strip_prefix(['-', '+']).unwrap_or(exponent);
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    digits(whole) && digits(part) && digits(exponent) && !exponent.is_empty() && whole.len() + part.len() > 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_separator_is_the_one_with_which_the_header_has_the_column() {
        for (start, separator) in [
            ("x_mm,y_mm\n", b','),
            ("\u{feff}# exported; by hand, twice\n\nx_mm;y_mm;a,b\n", b';'),
            ("y_mm\t\"x_mm\"\r\n1\t2\r\n", b'\t'),
            ("X;Y\n", b';'),
            ("sep=;\nX;Y;Z\n", b';'),
            ("X,Y\n", b','),
            ("1,5;-2\n", b';'),
            ("1.5\t-2e3\n", b'\t'),
            ("1.5 -2\n", b' '),
            ("1,5\n", b','),
            ("0.3 ,65536\n", b','),
            ("1, 2, 3\n", b','),
            (", 2, 3\n", b','),
            ("", b','),
        ] {
            let dialect = Dialect::of_start(start.as_bytes(), "x_mm", &Mapping::default());
            assert_eq!(dialect.separator(), separator, "{start:?}");
        }
    }

    #[test]
    fn numbers_have_digits_and_one_mark() {
        for number in ["1,5", "-0,5", "+,5", "3,", "1,5e-3", "2,0E+7"] {
            assert!(is_number(number, ','), "{number}");
        }
        for other in [",", "1.5", "1,2,3", "a,5", "1,5e", "", "-", "1,5 N"] {
            assert!(!is_number(other, ','), "{other}");
        }
    }
}
