//! Finds readings in a stream of bytes: lines of text, or frames with marks.

/// Longest line, bytes. A longer one is ignored.
pub(super) const LINE_MAX_BYTES: usize = 16 * 1024;

/// Way in which a device marks its readings.
#[derive(Clone, Debug, PartialEq)]
pub enum LineFraming {
    /// A line of numbers.
    Text(TextLine),
    /// A frame of bytes.
    Frame(ByteFrame),
}

/// A line of text.
#[derive(Clone, Debug, PartialEq)]
pub struct TextLine {
    /// Number of numbers.
    pub columns: usize,
    /// Text between two numbers; empty for commas, semicolons, tabs and blanks.
    pub separator: String,
    /// Text before the first number.
    pub before: String,
    /// Text after the last number.
    pub after: String,
}

/// A frame of bytes: head, numbers, check sum, tail.
#[derive(Clone, Debug, PartialEq)]
pub struct ByteFrame {
    /// Types of the numbers.
    pub numbers: Vec<FrameNumber>,
    /// Order of the bytes of a number.
    pub order: ByteOrder,
    /// Bytes before the numbers.
    pub head: Vec<u8>,
    /// Bytes at the end.
    pub tail: Vec<u8>,
    /// Check sum over the numbers.
    pub checksum: Option<Checksum>,
    /// Whether each piece that arrives has complete frames.
    pub packet: bool,
}

/// Type of a number in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "each is named as its type")]
pub enum FrameNumber {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
    /// A byte without meaning. It isn't a column.
    Skip,
}

/// Order of the bytes of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "each is named as its order")]
pub enum ByteOrder {
    Little,
    Big,
}

/// Check sum of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checksum {
    /// Sum of the bytes, modulo 256.
    Sum8,
    /// Exclusive or of the bytes.
    Xor8,
    /// CRC-16 as in Modbus RTU (polynomial A001 reflected, start FFFF), low byte first.
    Crc16Modbus,
    /// CRC-16/X-25 (polynomial 1021 reflected, start and final exclusive or FFFF), low byte first.
    Crc16X25,
    /// CRC-32 as in Ethernet, low byte first.
    Crc32,
}

/// Why a line or a frame isn't a reading.
#[derive(Clone, Debug, PartialEq)]
pub struct Rejected {
    /// What it should have been.
    pub expected: String,
    /// The line, or the frame as hexadecimal text.
    pub received: String,
}

/// Bytes that were received, and what was found in them.
#[derive(Debug)]
pub struct Finder {
    framing: LineFraming,
    inbox: Vec<u8>,
    /// Whether the inbox begins at the beginning of a line or a frame.
    in_step: bool,
    /// A packet that isn't a number of complete frames.
    misfit: Option<Rejected>,
}

impl Finder {
    /// Creates a finder. `in_step`: the first byte begins a line or a frame, as the answer to a question does.
    pub fn new(framing: LineFraming, in_step: bool) -> Finder {
        Finder { framing, inbox: Vec::new(), in_step, misfit: None }
    }

    /// Takes received bytes: those of one packet, if the device sends packets.
    pub fn take(&mut self, bytes: &[u8]) {
        match &self.framing {
            // it isn't kept: the next packet begins with a frame again
            LineFraming::Frame(frame) if frame.packet && !bytes.len().is_multiple_of(frame.length()) => {
                self.misfit = Some(frame.rejected(bytes));
            }
            _ => self.inbox.extend_from_slice(bytes),
        }
    }

    /// Returns the next reading or what was rejected; `None` if more bytes are needed. At most one incomplete line or frame stays.
    pub fn find(&mut self) -> Option<Result<Vec<f64>, Rejected>> {
        match &self.framing {
            LineFraming::Text(line) => {
                let found = next_line(&mut self.inbox, &mut self.in_step)?;
                Some(line.parse(&found))
            }
            LineFraming::Frame(frame) if frame.packet => {
                self.misfit.take().map(Err).or_else(|| frame.next_of_packet(&mut self.inbox))
            }
            LineFraming::Frame(frame) => frame.next(&mut self.inbox, &mut self.in_step),
        }
    }
}

/// Takes the next complete line without its end. The rest of a line whose beginning is missing, and a line that is too long, are
/// ignored.
fn next_line(inbox: &mut Vec<u8>, in_step: &mut bool) -> Option<Vec<u8>> {
    loop {
        let Some(end) = inbox.iter().position(|&byte| byte == b'\n') else {
            if inbox.len() > LINE_MAX_BYTES {
                inbox.clear();
                *in_step = false;
            }
            return None;
        };
        let line: Vec<u8> = inbox.drain(..=end).collect();
        if std::mem::replace(in_step, true) {
            return Some(line);
        }
    }
}

impl LineFraming {
    /// Returns the number of counts after which a counter in this column begins again; `None` if it doesn't.
    pub(super) fn period(&self, column: usize) -> Option<f64> {
        let LineFraming::Frame(frame) = self else { return None };
        let mut columns = frame.numbers.iter().filter(|number| **number != FrameNumber::Skip);
        columns.nth(column)?.period()
    }
}

impl TextLine {
    fn parse(&self, line: &[u8]) -> Result<Vec<f64>, Rejected> {
        let text = String::from_utf8_lossy(line);
        let numbers = self
            .numbers(text.trim_matches(['\r', '\n']))
            .ok_or_else(|| Rejected { expected: self.to_string(), received: text.trim_end().to_owned() })?;
        Ok(numbers)
    }

    fn numbers(&self, line: &str) -> Option<Vec<f64>> {
        let inner = line.trim().strip_prefix(self.before.trim_start())?.strip_suffix(self.after.trim_end())?;
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let numbers: Option<Vec<f64>> = if self.separator.is_empty() {
            let is_between = |c: char| matches!(c, ',' | ';') || c.is_whitespace();
            inner.split(is_between).filter(|part| !part.is_empty()).map(number).collect()
        } else {
            // some sketches print a separator behind the last number too
            inner.strip_suffix(&self.separator).unwrap_or(inner).split(&self.separator).map(number).collect()
        };
        numbers.filter(|numbers| numbers.len() == self.columns)
    }
}

impl std::fmt::Display for TextLine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let numbers = if self.columns == 1 { "one number".to_owned() } else { format!("{} numbers", self.columns) };
        write!(f, "a line with {numbers}")?;
        let named = [("after", &self.before), ("before", &self.after), ("separated by", &self.separator)];
        named.iter().filter(|(_, text)| !text.is_empty()).try_for_each(|(place, text)| write!(f, " {place} {text:?}"))
    }
}

impl ByteFrame {
    /// Number of bytes of a frame.
    pub fn length(&self) -> usize {
        let check = self.checksum.map_or(0, Checksum::length);
        self.head.len() + self.payload() + check + self.tail.len()
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.numbers.iter().filter(|number| **number != FrameNumber::Skip).count()
    }

    fn payload(&self) -> usize {
        self.numbers.iter().map(|number| number.length()).sum()
    }

    /// Returns the next frame of a packet.
    fn next_of_packet(&self, inbox: &mut Vec<u8>) -> Option<Result<Vec<f64>, Rejected>> {
        if inbox.len() < self.length() {
            return None;
        }
        let frame: Vec<u8> = inbox.drain(..self.length()).collect();
        Some(if self.has_marks(&frame) { self.read(&frame) } else { Err(self.rejected(&frame)) })
    }

    /// Returns the next frame. A frame that isn't in step with the one before counts only if a check sum, or the marks on both
    /// sides of it, confirm it: a mark alone may be part of a number.
    fn next(&self, inbox: &mut Vec<u8>, in_step: &mut bool) -> Option<Result<Vec<f64>, Rejected>> {
        let length = self.length();
        if inbox.len() < length {
            return None;
        }
        if *in_step && self.has_marks(inbox) {
            let frame: Vec<u8> = inbox.drain(..length).collect();
            return Some(self.read(&frame));
        }
        let was_in_step = std::mem::replace(in_step, false);
        for at in 0..=inbox.len() - length {
            let is_confirmed = self.checksum.is_some() || self.is_confirmed(inbox, at);
            if self.has_marks(&inbox[at..]) && is_confirmed && self.read(&inbox[at..at + length]).is_ok() {
                let skipped: Vec<u8> = inbox.drain(..at).collect();
                *in_step = true;
                return if was_in_step { Some(Err(self.rejected(&skipped))) } else { self.next(inbox, in_step) };
            }
        }
        // a frame that may still be confirmed stays, and the mark before it
        let frames = if self.checksum.is_some() { 1 } else { 2 };
        let rest = inbox.len() - (frames * length - 1 + self.tail.len()).min(inbox.len());
        let skipped: Vec<u8> = inbox.drain(..rest).collect();
        was_in_step.then(|| Err(self.rejected(&skipped)))
    }

    /// Whether the marks of a frame are at the beginning of these bytes.
    fn has_marks(&self, bytes: &[u8]) -> bool {
        let length = self.length();
        bytes.len() >= length && bytes.starts_with(&self.head) && bytes[..length].ends_with(&self.tail)
    }

    /// Whether the frame at `at` follows the tail of another, or the head or tail of another follows it.
    fn is_confirmed(&self, inbox: &[u8], at: usize) -> bool {
        let follows = !self.tail.is_empty() && inbox[..at].ends_with(&self.tail);
        follows || self.has_marks(&inbox[at + self.length()..])
    }

    fn read(&self, frame: &[u8]) -> Result<Vec<f64>, Rejected> {
        let payload = &frame[self.head.len()..self.head.len() + self.payload()];
        if let Some(checksum) = self.checksum {
            let sent = &frame[self.head.len() + self.payload()..][..checksum.length()];
            if checksum.of(payload) != sent {
                return Err(self.rejected(frame));
            }
        }
        let mut rest = payload;
        let mut values = Vec::with_capacity(self.columns());
        for number in &self.numbers {
            let (own, after) = rest.split_at(number.length());
            rest = after;
            values.extend(number.read(own, self.order));
        }
        if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(self.rejected(frame)) }
    }

    fn rejected(&self, bytes: &[u8]) -> Rejected {
        let received: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
        let length = self.length();
        let expected = if self.packet {
            format!("packets of frames of {length} bytes")
        } else {
            format!("a frame of {length} bytes")
        };
        Rejected { expected, received: received.join(" ") }
    }
}

impl FrameNumber {
    fn length(self) -> usize {
        match self {
            FrameNumber::U8 | FrameNumber::I8 | FrameNumber::Skip => 1,
            FrameNumber::U16 | FrameNumber::I16 => 2,
            FrameNumber::U32 | FrameNumber::I32 | FrameNumber::F32 => 4,
            FrameNumber::F64 => 8,
        }
    }

    /// Number of counts after which a counter of this type begins again; `None` if it doesn't.
    pub(super) fn period(self) -> Option<f64> {
        let bits = match self {
            FrameNumber::U8 | FrameNumber::I8 => 8,
            FrameNumber::U16 | FrameNumber::I16 => 16,
            FrameNumber::U32 | FrameNumber::I32 => 32,
            FrameNumber::F32 | FrameNumber::F64 | FrameNumber::Skip => return None,
        };
        Some(2f64.powi(bits))
    }

    /// Returns the value of a number's bytes; `None` for bytes without meaning.
    fn read(self, bytes: &[u8], order: ByteOrder) -> Option<f64> {
        let mut ordered = [0; 8];
        let ordered = &mut ordered[..bytes.len()];
        ordered.copy_from_slice(bytes);
        if order == ByteOrder::Big {
            ordered.reverse();
        }
        match (self, &*ordered) {
            (FrameNumber::U8, &[a]) => Some(f64::from(a)),
            (FrameNumber::I8, &[a]) => Some(f64::from(a as i8)),
            (FrameNumber::U16, &[a, b]) => Some(f64::from(u16::from_le_bytes([a, b]))),
            (FrameNumber::I16, &[a, b]) => Some(f64::from(i16::from_le_bytes([a, b]))),
            (FrameNumber::U32, &[a, b, c, d]) => Some(f64::from(u32::from_le_bytes([a, b, c, d]))),
            (FrameNumber::I32, &[a, b, c, d]) => Some(f64::from(i32::from_le_bytes([a, b, c, d]))),
            (FrameNumber::F32, &[a, b, c, d]) => Some(f64::from(f32::from_le_bytes([a, b, c, d]))),
            (FrameNumber::F64, &[a, b, c, d, e, f, g, h]) => Some(f64::from_le_bytes([a, b, c, d, e, f, g, h])),
            _ => None,
        }
    }
}

impl Checksum {
    fn length(self) -> usize {
        match self {
            Checksum::Sum8 | Checksum::Xor8 => 1,
            Checksum::Crc16Modbus | Checksum::Crc16X25 => 2,
            Checksum::Crc32 => 4,
        }
    }

    /// Returns the bytes of the check sum of these bytes.
    pub fn of(self, bytes: &[u8]) -> Vec<u8> {
        match self {
            Checksum::Sum8 => vec![bytes.iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte))],
            Checksum::Xor8 => vec![bytes.iter().fold(0, |sum, byte| sum ^ byte)],
            Checksum::Crc16Modbus => crc16(bytes, 0xA001).to_le_bytes().to_vec(),
            Checksum::Crc16X25 => (!crc16(bytes, 0x8408)).to_le_bytes().to_vec(),
            Checksum::Crc32 => crc32fast::hash(bytes).to_le_bytes().to_vec(),
        }
    }
}

/// CRC-16 that starts with FFFF, by a reflected polynomial.
fn crc16(bytes: &[u8], polynomial: u16) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { (crc >> 1) ^ polynomial } else { crc >> 1 })
    })
}
