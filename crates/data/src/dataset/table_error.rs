//! Reasons why a table can't be read, and limits of its size.

use miette::Diagnostic;
use palpate_document::printable;
use std::io;

/// Size of the largest table that is read, bytes: about 100 000 presses of 500 units, far beyond any run. Only numbers are kept
/// in memory, which are mostly smaller than the text.
pub const MAX_TABLE_BYTES: u64 = 512 << 20;
/// Longest row of a table, bytes: a kilobyte for each of the columns. A file without line ends is refused here.
pub(crate) const MAX_ROW_BYTES: u64 = 4 << 20;
/// Largest number of rows of a table. A stage that presses every three seconds needs a month for this number.
pub(crate) const MAX_ROWS: usize = 1 << 20;
/// Largest number of columns of a table. It is far beyond any array, and small enough to search names one by one.
pub(crate) const MAX_COLUMNS: usize = 4096;

/// Reason why a table can't be used; `line` counts from 1.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[allow(missing_docs, reason = "the fields say what the messages say")]
pub enum TableError {
    /// The path doesn't exist, isn't a file, or access is denied.
    #[error("{file}: can't be read")]
    #[diagnostic(help("give an existing table; `palpate rebuild` regenerates the table of a run"))]
    Unreadable { file: String, source: io::Error },
    /// The table exceeds [`MAX_TABLE_BYTES`], [`MAX_ROW_BYTES`], [`MAX_ROWS`] or [`MAX_COLUMNS`].
    #[error("{file}{}: more than {limit} {what}", line.map(|line| format!(", line {line}")).unwrap_or_default())]
    #[diagnostic(help("split the table, remove columns that aren't needed, or average repeated presses"))]
    TooLarge { file: String, line: Option<u64>, limit: u64, what: &'static str },
    /// A file of another program isn't what its extension states.
    #[error("{file}: {problem}")]
    #[diagnostic(help("save the table again, or save it as CSV"))]
    Malformed { file: String, problem: String },
    /// The file is of another kind.
    #[error("{file}: this is {kind}, not a table of presses")]
    #[diagnostic(help("give a table with the columns x_mm, y_mm, out_1, out_2, ..., or a run folder"))]
    OtherKind { file: String, kind: &'static str },
    /// This program was built without the reader of the file.
    #[error("{file}: reading .{extension} needs the feature `files`, which this program was built without")]
    #[diagnostic(help(
        "save the table as CSV, or install palpate with `cargo install --path . --features files` in its repository"
    ))]
    NotBuilt { file: String, extension: String },
    /// The file isn't text.
    #[error("{file}, line {line}: not UTF-8 text")]
    #[diagnostic(help("save the table as CSV in UTF-8"))]
    NotText { file: String, line: u64 },
    /// There is no row below the header, or no header.
    #[error("{file}: the table has no rows")]
    #[diagnostic(help("expected a header (x_mm, y_mm, out_1, ...) and at least one row"))]
    NoRows { file: String },
    /// The file has no bytes, or only blank lines and comments.
    #[error("{file}: there is no header and no row")]
    #[diagnostic(help("expected a header (x_mm, y_mm, out_1, ...) and at least one row"))]
    Empty { file: String },
    /// No row has a value in every column that is read.
    #[error("{file}: none of its {rows} rows has a value in every column (line {line}: none in column `{column}`)")]
    #[diagnostic(help("leave the column out of `outputs`, or correct the cells"))]
    NothingComplete { file: String, rows: usize, line: u64, column: String },
    /// The first line has only numbers.
    #[error("{file}, line {line}: the table has no header: most cells of this line are numbers")]
    #[diagnostic(help(
        "write the names of the columns above it (x_mm, y_mm, force_n, out_1, ...); or give a columns file with `header = false`, \
         which names columns by their numbers: x_mm = \"1\""
    ))]
    NoHeader { file: String, line: u64 },
    /// A quotation mark isn't closed before the end of the table.
    #[error("{file}, line {line}: a quotation mark isn't closed")]
    #[diagnostic(help("remove the mark in this line, or close it: the rest of the table belongs to this cell"))]
    OpenQuote { file: String, line: u64 },
    /// A required column is missing.
    #[error("{file}, line {line}: column `{column}` is missing")]
    MissingColumn {
        file: String,
        line: u64,
        column: String,
        #[help]
        help: String,
    },
    /// Two columns have the same name.
    #[error("{file}, line {line}: column `{column}` is in the header twice")]
    #[diagnostic(help("keep one of them, or rename the other"))]
    DuplicateColumn { file: String, line: u64, column: String },
    /// The number of an output column isn't in a sequence from 1.
    #[error("{file}, line {line}: invalid output column `{column}`")]
    #[diagnostic(help("use out_1, out_2, ..., without leading zeros"))]
    OutputNumber { file: String, line: u64, column: String },
    /// A row has another length than the header.
    #[error("{file}, line {line}: {found} cells where the header has {expected} (up to column `{column}`)")]
    #[diagnostic(help(
        "every row needs one cell per column; {}",
        if found < expected { "if the table was cut off, copy or export it again" } else { "write decimals with a point, not a comma" }
    ))]
    Ragged { file: String, line: u64, column: String, expected: usize, found: usize },
    /// The table has decimal points and decimal commas.
    #[error(
        "{file}, line {}: a table can't have decimal commas (line {comma}) and decimal points (line {point})", point.max(comma)
    )]
    #[diagnostic(help("export the table with one decimal mark and without thousands separators"))]
    TwoDecimalMarks { file: String, point: u64, comma: u64 },
    /// A cell isn't valid for its column.
    #[error("{file}, line {line}, column `{column}`: expected {expected}, found {}", found_in(found))]
    #[diagnostic(help("{}", advice_about(found)))]
    Cell { file: String, line: u64, column: String, expected: &'static str, found: String },
}

/// Describes the content of a cell.
fn found_in(cell: &str) -> String {
    if cell.is_empty() { "a blank cell".to_owned() } else { format!("`{cell}`") }
}

fn advice_about(cell: &str) -> &'static str {
    match cell {
        "" => "fill the cell, or remove the row; with --columns, rows with a blank cell are excluded",
        _ => "correct the cell, or remove the row",
    }
}

/// Largest number of a cell's characters in a message.
const QUOTED: usize = 40;

/// Returns a cell or a column's name for a message. A long text is shortened, and characters that control a terminal are
/// replaced.
pub(super) fn quoted(cell: &str) -> String {
    start_of(cell, QUOTED)
}

/// Returns the first characters of an external text, without characters that control a terminal.
pub(super) fn start_of(text: &str, most: usize) -> String {
    let start = text.char_indices().nth(most).map_or(text, |(end, _)| &text[..end]);
    printable(start.to_owned()) + if start.len() < text.len() { "..." } else { "" }
}
