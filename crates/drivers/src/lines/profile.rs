//! Line profile: how a device's readings look, and what their numbers mean.

use super::columns::columns;
use super::count::CounterColumn;
use super::framing::{ByteFrame, FrameNumber, LineFraming, TextLine};
use super::hex;
use super::keys::{self, COLUMNS_MAX, counter, force, frame, outputs, root, status, text, time};
use palpate_core::quantity::{Health, Range};
use palpate_document::{self as document, Key, Problem, Problems, Table};

/// Profiles included with the program: name and text.
pub const SHIPPED: [(&str, &str); 9] = [
    ("hx711", include_str!("../../../../profiles/lines/hx711.toml")),
    ("mark-10", include_str!("../../../../profiles/lines/mark-10.toml")),
    ("ati-netft", include_str!("../../../../profiles/lines/ati-netft.toml")),
    ("bota-serial", include_str!("../../../../profiles/lines/bota-serial.toml")),
    ("me-gsv8", include_str!("../../../../profiles/lines/me-gsv8.toml")),
    ("reskin", include_str!("../../../../profiles/lines/reskin.toml")),
    ("mlx90393-text", include_str!("../../../../profiles/lines/mlx90393-text.toml")),
    ("velostat-16", include_str!("../../../../profiles/lines/velostat-16.toml")),
    ("one-number", include_str!("../../../../profiles/lines/one-number.toml")),
];

/// How a device's readings look, and what their numbers mean. Columns are counted from 0.
#[derive(Clone, Debug, PartialEq)]
pub struct LineProfile {
    /// The device's name in messages.
    pub name: String,
    /// Longest wait for the first reading after the port is opened, s.
    pub start_s: f64,
    /// Command that is sent when the device is ready.
    pub on_start: Option<Vec<u8>>,
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
    /// The device's own count of readings.
    pub counter: Option<CounterColumn>,
    /// Bits that report the state of a load cell.
    pub status: Option<StatusColumn>,
}

/// The force of a load cell.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceField {
    /// Its columns.
    pub columns: ForceColumns,
    /// Newtons per unit of the device; `None` if the rig states it.
    pub newton_per_unit: Option<f64>,
    /// Number at zero force.
    pub offset: f64,
    /// Largest force that the device can measure, N. A larger one is damaged.
    pub range_n: Option<f64>,
    /// Ends of the device's range, in its units.
    pub saturated_at: Option<Range>,
}

/// Columns of a load cell's force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ForceColumns {
    /// The force of a cell with one axis.
    One([usize; 1]),
    /// The forces along the device's x, y and z.
    Axes([usize; 3]),
}

/// Number whose bits report the state of a load cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StatusColumn {
    /// Its column.
    pub column: usize,
    /// Bits that report a fault of the cell.
    pub fault_mask: u64,
    /// Bits that report a force beyond its range.
    pub saturated_mask: u64,
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
            let (on_start, ask) = (read_on_start(table), command(&root::ask));
            let framing = read_framing(table);
            let force = document::optional(table.table(&root::force), read_force);
            let outputs = document::optional(table.table(&root::outputs), read_outputs);
            let time = document::optional(table.table(&root::time), |table| {
                let (column, unit_s) = (read_column(table, &time::column), table.number(&time::unit_s));
                Some(TimeColumn { column: column?, unit_s: unit_s? })
            });
            let counter = document::optional(table.table(&root::counter), |table| {
                let (column, step) = (read_column(table, &counter::column), table.whole(&counter::step));
                let column = column?;
                let period = framing.as_ref().and_then(|framing| framing.period(column));
                Some(CounterColumn { column, step: step.map(|step| step as f64), period })
            });
            let status = document::optional(table.table(&root::status), read_status);
            let profile = LineProfile {
                name: name?.to_owned(),
                start_s: start_s?,
                on_start: on_start?,
                ask,
                framing: framing?,
                force: force?,
                outputs: outputs?,
                time: time?,
                counter: counter?,
                status: status?,
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
            own.columns.all().iter().all(|column| {
                let force_n = numbers.get(*column).map(|number| own.newton(*number));
                force_n.is_some_and(|force_n| own.range_n.is_none_or(|range_n| force_n.abs() <= range_n))
            })
        });
        are_outputs && is_force
    }

    /// Whether the device sends packets of complete frames.
    pub fn is_packets(&self) -> bool {
        matches!(&self.framing, LineFraming::Frame(frame) if frame.packet)
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
        let force = self.force.iter().flat_map(|own| own.columns.all().iter().map(|&column| (column, &root::force)));
        let outputs = self.outputs.iter().flat_map(|own| own.columns.iter().map(|&column| (column, &root::outputs)));
        let time = self.time.iter().map(|own| (own.column, &root::time));
        let counter = self.counter.iter().map(|own| (own.column, &root::counter));
        let status = self.status.iter().map(|own| (own.column, &root::status));
        let missing = force.chain(outputs).chain(time).chain(counter).chain(status).find(|(column, _)| *column >= most);
        if let Some((column, key)) = missing {
            let text = format!("[{}] names column {}, but a reading has {most} numbers", key.name, column + 1);
            table.complain(Problem::new(table.span_of(key), text));
        }
    }
}

impl ForceColumns {
    /// Returns all of them.
    pub fn all(&self) -> &[usize] {
        match self {
            ForceColumns::One(columns) => columns,
            ForceColumns::Axes(columns) => columns,
        }
    }
}

impl StatusColumn {
    /// Returns what the bits of a number report.
    pub fn health(&self, number: f64) -> Health {
        // a signed number has the same bits
        let bits = number as i64 as u64;
        Health { saturated: bits & self.saturated_mask != 0, fault: bits & self.fault_mask != 0 }
    }
}

impl ForceField {
    /// Returns the number of the device for a force: the inverse of [`newton`](Self::newton).
    pub fn number(&self, force_n: f64) -> f64 {
        force_n / self.newton_per_unit.unwrap_or(1.0) + self.offset
    }

    /// Converts a number of the device to N.
    pub fn newton(&self, number: f64) -> f64 {
        (number - self.offset) * self.newton_per_unit.unwrap_or(1.0)
    }
}

/// Reads the command at the start, as text or as bytes.
fn read_on_start(table: &Table) -> Option<Option<Vec<u8>>> {
    let text = table.text(&root::on_start).map(|text| text.as_bytes().to_vec());
    let is_hex = table.has(&root::on_start_hex);
    let bytes = read_hex(table, &root::on_start_hex);
    if text.is_some() && is_hex {
        let words = "the command at the start is `on_start` or `on_start_hex`, not both";
        table.complain(Problem::new(table.span_of(&root::on_start_hex), words));
        return None;
    }
    if is_hex { bytes.map(Some) } else { Some(text) }
}

/// Reads bytes; without the key there are none.
fn read_hex(table: &Table, key: &Key) -> Option<Vec<u8>> {
    let read = hex::bytes(table.text(key).unwrap_or_default());
    if read.is_none() {
        let words = format!("`{}` is pairs of hexadecimal digits, such as \"AA 55\"", key.name);
        table.complain(Problem::new(table.span_of(key), words));
    }
    read
}

fn read_status(table: &Table) -> Option<StatusColumn> {
    let column = read_column(table, &status::column);
    let masks = [&status::fault_mask, &status::saturated_mask].map(|key| (table.has(key), table.whole(key)));
    if masks.iter().all(|(is_stated, _)| !is_stated) {
        let problem = Problem::new(table.span(), "[status] has neither `fault_mask` nor `saturated_mask`");
        table.complain(problem.help("state the bits that mean a fault, or remove [status]"));
        return None;
    }
    let [fault_mask, saturated_mask] = masks.map(|(_, mask)| mask.unwrap_or_default());
    Some(StatusColumn { column: column?, fault_mask, saturated_mask })
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
    let (head, tail) = (read_hex(table, &frame::head), read_hex(table, &frame::tail));
    let packet = table.flag(&frame::packet);
    let checksum = if table.has(&frame::checksum) {
        Some(Some(table.word(&frame::checksum, &keys::CHECKSUMS)?))
    } else {
        Some(None)
    };
    let frame =
        ByteFrame { numbers: numbers?, order: order?, head: head?, tail: tail?, checksum: checksum?, packet: packet? };
    if !frame.packet && frame.head.is_empty() && frame.tail.is_empty() && frame.checksum.is_none() {
        let problem =
            Problem::new(table.span(), "a frame without a head, a tail or a check sum can't be found in the bytes");
        let help = "state the mark that the device sends, or `packet = true` if it sends packets over UDP";
        table.complain(problem.help(help));
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
    let columns = read_force_columns(table);
    let newton_per_unit = table.number(&force::newton_per_unit);
    if newton_per_unit == Some(0.0) {
        let text = "`newton_per_unit` is 0, so every force would read 0 N";
        table.complain(Problem::new(table.span_of(&force::newton_per_unit), text));
    }
    let offset = table.number(&force::offset);
    let (range_n, saturated_at) = (table.number(&force::range_n), table.range(&force::saturated_at));
    Some(ForceField { columns: columns?, newton_per_unit, offset: offset?, range_n, saturated_at })
}

/// Reads the one column of a force, or the three of a cell with three axes.
fn read_force_columns(table: &Table) -> Option<ForceColumns> {
    let one = read_column(table, &force::column);
    let listed = read_columns(table, &force::columns);
    if !table.has(&force::columns) {
        return Some(ForceColumns::One([one?]));
    }
    let span = table.span_of(&force::columns);
    if table.has(&force::column) {
        table.complain(Problem::new(span, "the force has `column` or `columns`, not both"));
        return None;
    }
    let listed = listed?;
    match listed[..] {
        [x, y, z] if x != y && y != z && z != x => Some(ForceColumns::Axes([x, y, z])),
        _ => {
            let words = "`columns` of [force] are three different numbers: the cell's x, y and z";
            table.complain(Problem::new(span, words).help("a cell with one axis has `column`"));
            None
        }
    }
}

/// Reads a list of columns; `None` without the key.
fn read_columns(table: &Table, key: &Key) -> Option<Vec<usize>> {
    let text = table.text(key)?;
    let listed = columns(text);
    if listed.is_none() {
        let words = format!("`columns` is \"{text}\", expected numbers from 1 and ranges, such as \"2-4, 6-8\"");
        table.complain(Problem::new(table.span_of(key), words));
    }
    listed
}

fn read_outputs(table: &Table) -> Option<OutputColumns> {
    let listed = read_columns(table, &outputs::columns);
    let possible = table.range(&outputs::possible);
    let [scale, offset] = table.numbers([outputs::scale, outputs::offset])?;
    Some(OutputColumns { columns: listed?, scale, offset, possible })
}

/// Reads the number of a column, from 1, and returns it from 0.
fn read_column(table: &Table, key: &Key) -> Option<usize> {
    table.whole(key).map(|column| column as usize - 1)
}
