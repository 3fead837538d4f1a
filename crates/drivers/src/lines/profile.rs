//! Line profile: how a device's readings look, and what their numbers mean.

use super::columns::columns;
use super::framing::{ByteFrame, FrameNumber, LineFraming, TextLine};
use super::hex;
use super::keys::{self, COLUMNS_MAX, counter, force, frame, outputs, root, text, time};
use palpate_core::quantity::Range;
use palpate_document::{self as document, Key, Problem, Problems, Table};

/// Profiles included with the program: name and text.
pub const SHIPPED: [(&str, &str); 5] = [
    ("hx711", include_str!("../../../../profiles/lines/hx711.toml")),
    ("mark-10", include_str!("../../../../profiles/lines/mark-10.toml")),
    ("reskin", include_str!("../../../../profiles/lines/reskin.toml")),
    ("mlx90393-text", include_str!("../../../../profiles/lines/mlx90393-text.toml")),
    ("velostat-16", include_str!("../../../../profiles/lines/velostat-16.toml")),
];

/// How a device's readings look, and what their numbers mean. Columns are counted from 0.
#[derive(Clone, Debug, PartialEq)]
pub struct LineProfile {
    /// The device's name in messages.
    pub name: String,
    /// Longest wait for the first reading after the port is opened, s.
    pub start_s: f64,
    /// Command that is sent when the device is ready.
    pub on_start: Option<String>,
    /// Command that asks for one reading; `None` if the device sends by itself.
    pub ask: Option<String>,
    /// How readings are marked.
    pub framing: LineFraming,
    /// The force.
    pub force: Option<ForceField>,
    /// The outputs.
    pub outputs: Option<OutputColumns>,
    /// The device's own time.
    pub time: Option<TimeColumn>,
    /// Column of the device's own count of readings.
    pub counter: Option<usize>,
}

/// The force of a load cell.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceField {
    /// Its column.
    pub column: usize,
    /// Newtons per unit of the device; `None` if the rig states it.
    pub newton_per_unit: Option<f64>,
    /// Number at zero force.
    pub offset: f64,
    /// Largest force that the device can measure, N. A larger one is damaged.
    pub range_n: Option<f64>,
    /// Ends of the device's range, in its units.
    pub saturated_at: Option<Range>,
}

/// The outputs of an array.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputColumns {
    /// Their columns.
    pub columns: Vec<usize>,
    /// Factor of each, after the offset.
    pub scale: f64,
    /// What is subtracted from each.
    pub offset: f64,
    /// Range of the numbers. Others are damaged.
    pub possible: Option<Range>,
}

/// The device's own time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeColumn {
    /// Its column.
    pub column: usize,
    /// Its unit, s.
    pub unit_s: f64,
}

impl LineProfile {
    /// Reads a line profile; `file` is its name in messages.
    ///
    /// # Errors
    /// All problems of the text, each with its line.
    pub fn parse(file: &str, text: &str) -> Result<LineProfile, Problems> {
        document::read(file, text, &root::KEYS, |table| {
            let name = table.text(&root::name);
            let start_s = table.number(&root::start_s);
            let command = |key: &Key| table.text(key).map(str::to_owned);
            let (on_start, ask) = (command(&root::on_start), command(&root::ask));
            let framing = read_framing(table);
            let force = document::optional(table.table(&root::force), read_force);
            let outputs = document::optional(table.table(&root::outputs), read_outputs);
            let time = document::optional(table.table(&root::time), |table| {
                let (column, unit_s) = (read_column(table, &time::column), table.number(&time::unit_s));
                Some(TimeColumn { column: column?, unit_s: unit_s? })
            });
            let counter = document::optional(table.table(&root::counter), |table| read_column(table, &counter::column));
            let profile = LineProfile {
                name: name?.to_owned(),
                start_s: start_s?,
                on_start,
                ask,
                framing: framing?,
                force: force?,
                outputs: outputs?,
                time: time?,
                counter: counter?,
            };
            profile.check_columns(table);
            Some(profile)
        })
    }

    /// Returns a profile included with the program; `None` if there is no profile of that name.
    pub fn shipped(name: &str) -> Option<LineProfile> {
        let (_, text) = SHIPPED.iter().find(|(shipped, _)| *shipped == name)?;
        LineProfile::parse(name, text).ok() // a test reads every one of them
    }

    /// Whether a reading's numbers are possible.
    pub fn is_possible(&self, numbers: &[f64]) -> bool {
        let within = |range: &Option<Range>, number: f64| range.is_none_or(|range| range.contains(number));
        let outputs = self.outputs.iter().flat_map(|own| own.columns.iter().map(move |&column| (own, column)));
        let mut outputs = outputs.map(|(own, column)| (&own.possible, numbers.get(column)));
        let are_outputs = outputs.all(|(possible, number)| number.is_some_and(|&number| within(possible, number)));
        let is_force = self.force.as_ref().is_none_or(|own| {
            let force_n = numbers.get(own.column).map(|number| own.newton(*number));
            force_n.is_some_and(|force_n| own.range_n.is_none_or(|range_n| force_n.abs() <= range_n))
        });
        are_outputs && is_force
    }

    /// Number of columns of a reading.
    pub fn columns(&self) -> usize {
        match &self.framing {
            LineFraming::Text(line) => line.columns,
            LineFraming::Frame(frame) => frame.columns(),
        }
    }

    /// Checks that every named column is there.
    fn check_columns(&self, table: &Table) {
        let most = self.columns();
        let force = self.force.iter().map(|own| (own.column, &root::force));
        let outputs = self.outputs.iter().flat_map(|own| own.columns.iter().map(|&column| (column, &root::outputs)));
        let time = self.time.iter().map(|own| (own.column, &root::time));
        let counter = self.counter.iter().map(|&column| (column, &root::counter));
        let missing = force.chain(outputs).chain(time).chain(counter).find(|(column, _)| *column >= most);
        if let Some((column, key)) = missing {
            let text = format!("[{}] names column {}, but a reading has {most} numbers", key.name, column + 1);
            table.complain(Problem::new(table.span_of(key), text));
        }
    }
}

impl ForceField {
    /// Converts a number of the device to N.
    pub fn newton(&self, number: f64) -> f64 {
        (number - self.offset) * self.newton_per_unit.unwrap_or(1.0)
    }
}

fn read_framing(table: &Table) -> Option<LineFraming> {
    let (has_text, has_frame) = (table.has(&root::text), table.has(&root::frame));
    let line = table.table(&root::text).and_then(|table| read_text(&table));
    let frame = table.table(&root::frame).and_then(|table| read_frame(&table));
    match (has_text, has_frame) {
        (true, false) => line.map(LineFraming::Text),
        (false, true) => frame.map(LineFraming::Frame),
        (true, true) => {
            let words = "a reading is [text] or [frame], not both";
            table.complain(Problem::new(table.span_of(&root::frame), words));
            None
        }
        (false, false) => {
            let problem = Problem::new(0..0, "it isn't stated how a reading looks");
            table.complain(problem.help("add [text] for lines of numbers, or [frame] for frames of bytes"));
            None
        }
    }
}

fn read_text(table: &Table) -> Option<TextLine> {
    let columns = table.whole(&text::columns);
    let own = |key: &Key| table.text(key).unwrap_or_default().to_owned();
    let (separator, before, after) = (own(&text::separator), own(&text::before), own(&text::after));
    Some(TextLine { columns: columns? as usize, separator, before, after })
}

fn read_frame(table: &Table) -> Option<ByteFrame> {
    let numbers = table.texts(&frame::numbers).and_then(|parts| {
        let wrong = |words: String| {
            let help = format!(
                "such as [\"u16\", \"skip\", \"20 f32\"]; types: {}",
                keys::TYPES.map(|(name, _)| name).join(", ")
            );
            table.complain(Problem::new(table.span_of(&frame::numbers), words).help(help));
        };
        if let Some(part) = parts.iter().find(|part| numbers_of(part).is_none()) {
            wrong(format!("`numbers` has \"{part}\", expected a type, with a count before it if there are several"));
            return None;
        }
        let numbers: Vec<FrameNumber> = parts.into_iter().filter_map(numbers_of).flatten().collect();
        if numbers.is_empty() || numbers.len() as u64 > 8 * COLUMNS_MAX {
            wrong(format!("`numbers` has {} numbers, expected 1 to {}", numbers.len(), 8 * COLUMNS_MAX));
            return None;
        }
        Some(numbers)
    });
    let order = table.word(&frame::order, &keys::ORDERS);
    let mark = |key: &Key| {
        let read = hex::bytes(table.text(key).unwrap_or_default());
        if read.is_none() {
            let words = format!("`{}` is pairs of hexadecimal digits, such as \"AA 55\"", key.name);
            table.complain(Problem::new(table.span_of(key), words));
        }
        read
    };
    let (head, tail) = (mark(&frame::head), mark(&frame::tail));
    let checksum = if table.has(&frame::checksum) {
        Some(Some(table.word(&frame::checksum, &keys::CHECKSUMS)?))
    } else {
        Some(None)
    };
    let frame = ByteFrame { numbers: numbers?, order: order?, head: head?, tail: tail?, checksum: checksum? };
    if frame.head.is_empty() && frame.tail.is_empty() && frame.checksum.is_none() {
        let problem =
            Problem::new(table.span(), "a frame without a head, a tail or a check sum can't be found in the bytes");
        table.complain(problem.help("state the mark that the device sends"));
        return None;
    }
    Some(frame)
}

/// Reads a type, or a count and a type.
fn numbers_of(part: &str) -> Option<Vec<FrameNumber>> {
    let (count, name) = part.trim().split_once(' ').map_or((Some(1), part.trim()), |(count, name)| {
        (count.parse().ok().filter(|count| (1..=COLUMNS_MAX).contains(count)), name.trim())
    });
    let (_, number) = keys::TYPES.into_iter().find(|(known, _)| *known == name)?;
    Some(vec![number; count? as usize])
}

fn read_force(table: &Table) -> Option<ForceField> {
    let column = read_column(table, &force::column);
    let newton_per_unit = table.number(&force::newton_per_unit);
    if newton_per_unit == Some(0.0) {
        let text = "`newton_per_unit` is 0, so every force would read 0 N";
        table.complain(Problem::new(table.span_of(&force::newton_per_unit), text));
    }
    let offset = table.number(&force::offset);
    let (range_n, saturated_at) = (table.number(&force::range_n), table.range(&force::saturated_at));
    Some(ForceField { column: column?, newton_per_unit, offset: offset?, range_n, saturated_at })
}

fn read_outputs(table: &Table) -> Option<OutputColumns> {
    let listed = table.text(&outputs::columns).and_then(|text| {
        let listed = columns(text);
        if listed.is_none() {
            let words = format!("`columns` is \"{text}\", expected numbers from 1 and ranges, such as \"2-4, 6-8\"");
            table.complain(Problem::new(table.span_of(&outputs::columns), words));
        }
        listed
    });
    let possible = table.range(&outputs::possible);
    let [scale, offset] = table.numbers([outputs::scale, outputs::offset])?;
    Some(OutputColumns { columns: listed?, scale, offset, possible })
}

/// Reads the number of a column, from 1, and returns it from 0.
fn read_column(table: &Table, key: &Key) -> Option<usize> {
    table.whole(key).map(|column| column as usize - 1)
}
