//! Writes a reading as its device does: the inverse of the reader, for an emulator of a device that only its profile knows.

use super::framing::{ByteFrame, ByteOrder, Finder, FrameNumber, LineFraming, TextLine};
use super::profile::LineProfile;
use palpate_core::quantity::Range;

/// Text between two numbers of a device whose profile names none.
const SEPARATOR: &str = ",";

/// End of a line, as an Arduino prints it.
const LINE_END: &str = "\r\n";

impl LineProfile {
    /// Returns the bytes of a reading. A number beyond the ends of its type becomes that end. Columns without a number are 0.
    pub fn write(&self, numbers: &[f64]) -> Vec<u8> {
        match &self.framing {
            LineFraming::Text(line) => line.write(numbers),
            LineFraming::Frame(frame) => frame.write(numbers),
        }
    }

    /// Whether the profile reads a reading that it wrote.
    pub fn reads_back(&self, numbers: &[f64]) -> bool {
        let mut finder = Finder::new(self.framing.clone(), true);
        finder.take(&self.write(numbers));
        finder.find().is_some_and(|found| found.is_ok_and(|found| self.is_possible(&found)))
    }

    /// Returns the ends of the whole numbers that a column can hold; `None` if it isn't limited to whole numbers.
    pub fn whole_range(&self, column: usize) -> Option<Range> {
        let LineFraming::Frame(frame) = &self.framing else { return None };
        frame.numbers.iter().filter(|number| **number != FrameNumber::Skip).nth(column)?.range()
    }
}

impl TextLine {
    fn write(&self, numbers: &[f64]) -> Vec<u8> {
        let number = |column: usize| numbers.get(column).copied().unwrap_or(0.0).to_string();
        let separator = if self.separator.is_empty() { SEPARATOR } else { &self.separator };
        let numbers: Vec<String> = (0..self.columns).map(number).collect();
        format!("{}{}{}{LINE_END}", self.before, numbers.join(separator), self.after).into_bytes()
    }
}

impl ByteFrame {
    fn write(&self, numbers: &[f64]) -> Vec<u8> {
        let mut numbers = numbers.iter().copied();
        let mut payload = Vec::new();
        for number in &self.numbers {
            let value = if *number == FrameNumber::Skip { 0.0 } else { numbers.next().unwrap_or(0.0) };
            payload.extend(number.write(value, self.order));
        }
        let sum = self.checksum.map_or_else(Vec::new, |checksum| checksum.of(&payload));
        [&self.head[..], &payload, &sum, &self.tail].concat()
    }
}

impl FrameNumber {
    /// Returns the bytes of a number. A cast to a whole number ends with its type.
    fn write(self, number: f64, order: ByteOrder) -> Vec<u8> {
        let whole = number.round();
        let mut bytes = match self {
            FrameNumber::U8 => (whole as u8).to_le_bytes().to_vec(),
            FrameNumber::I8 => (whole as i8).to_le_bytes().to_vec(),
            FrameNumber::U16 => (whole as u16).to_le_bytes().to_vec(),
            FrameNumber::I16 => (whole as i16).to_le_bytes().to_vec(),
            FrameNumber::U32 => (whole as u32).to_le_bytes().to_vec(),
            FrameNumber::I32 => (whole as i32).to_le_bytes().to_vec(),
            FrameNumber::F32 => (number as f32).to_le_bytes().to_vec(),
            FrameNumber::F64 => number.to_le_bytes().to_vec(),
            FrameNumber::Skip => vec![0],
        };
        if order == ByteOrder::Big {
            bytes.reverse();
        }
        bytes
    }

    /// Returns the ends of a whole number; `None` for others.
    fn range(self) -> Option<Range> {
        let (min, max) = match self {
            FrameNumber::U8 => (0.0, f64::from(u8::MAX)),
            FrameNumber::I8 => (f64::from(i8::MIN), f64::from(i8::MAX)),
            FrameNumber::U16 => (0.0, f64::from(u16::MAX)),
            FrameNumber::I16 => (f64::from(i16::MIN), f64::from(i16::MAX)),
            FrameNumber::U32 => (0.0, f64::from(u32::MAX)),
            FrameNumber::I32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
            FrameNumber::F32 | FrameNumber::F64 | FrameNumber::Skip => return None,
        };
        Some(Range { min, max })
    }
}

#[cfg(test)]
mod tests {
    use super::super::framing::Checksum;
    use super::super::profile::SHIPPED;
    use super::*;
    use proptest::prelude::*;

    /// What a framing finds in the bytes of readings, one after another.
    fn found(profile: &LineProfile, readings: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut finder = Finder::new(profile.framing.clone(), true);
        let mut found = Vec::new();
        for reading in readings {
            finder.take(&profile.write(reading));
            while let Some(next) = finder.find() {
                found.push(next.expect("what it wrote"));
            }
        }
        found
    }

    fn profile(framing: LineFraming) -> LineProfile {
        LineProfile { framing, ..LineProfile::shipped("one-number").expect("a shipped profile") }
    }

    #[test]
    fn every_shipped_profile_reads_what_it_writes() {
        for (name, _) in SHIPPED {
            let profile = LineProfile::shipped(name).expect("a shipped profile");
            let reading: Vec<f64> = (0..profile.columns()).map(|column| (column + 1) as f64).collect();
            assert_eq!(found(&profile, &[reading.clone(), reading.clone()]), [reading.clone(), reading], "{name}");
        }
    }

    #[test]
    fn a_number_beyond_its_type_is_its_end() {
        let frame = ByteFrame {
            numbers: vec![FrameNumber::U8, FrameNumber::I16],
            order: ByteOrder::Big,
            head: vec![0xAA],
            tail: Vec::new(),
            checksum: None,
            packet: false,
        };
        assert_eq!(frame.write(&[300.0, -1e9]), [0xAA, 0xFF, 0x80, 0x00]);
        assert_eq!(frame.write(&[-1.0]), [0xAA, 0, 0, 0]);
    }

    fn number() -> impl Strategy<Value = (FrameNumber, f64)> {
        prop_oneof![
            any::<u8>().prop_map(|number| (FrameNumber::U8, f64::from(number))),
            any::<i8>().prop_map(|number| (FrameNumber::I8, f64::from(number))),
            any::<u16>().prop_map(|number| (FrameNumber::U16, f64::from(number))),
            any::<i16>().prop_map(|number| (FrameNumber::I16, f64::from(number))),
            any::<u32>().prop_map(|number| (FrameNumber::U32, f64::from(number))),
            any::<i32>().prop_map(|number| (FrameNumber::I32, f64::from(number))),
            (-1e30f32..1e30).prop_map(|number| (FrameNumber::F32, f64::from(number))),
            (-1e300..1e300).prop_map(|number| (FrameNumber::F64, number)),
            Just((FrameNumber::Skip, 0.0)),
        ]
    }

    fn checksum() -> impl Strategy<Value = Option<Checksum>> {
        let sums =
            [Checksum::Sum8, Checksum::Xor8, Checksum::Crc16Modbus, Checksum::Crc16X25, Checksum::Crc32].map(Some);
        prop::sample::select([&sums[..], &[None]].concat())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        #[test]
        fn a_frame_is_read_as_it_was_written(
            numbers in prop::collection::vec(number(), 1..20),
            is_big in any::<bool>(),
            head in prop::collection::vec(any::<u8>(), 1..3),
            tail in prop::collection::vec(any::<u8>(), 0..3),
            checksum in checksum(),
        ) {
            let order = if is_big { ByteOrder::Big } else { ByteOrder::Little };
            let (types, values): (Vec<_>, Vec<_>) = numbers.into_iter().unzip();
            let of_columns = types.iter().zip(&values).filter(|(number, _)| **number != FrameNumber::Skip);
            let reading: Vec<f64> = of_columns.map(|(_, value)| *value).collect();
            let frame = ByteFrame { numbers: types, order, head, tail, checksum, packet: false };
            let profile = profile(LineFraming::Frame(frame));
            prop_assert_eq!(found(&profile, &[reading.clone(), reading.clone()]), [reading.clone(), reading]);
        }

        #[test]
        fn a_line_is_read_as_it_was_written(
            reading in prop::collection::vec(-1e12..1e12f64, 1..20),
            separator in prop::sample::select(vec!["", ",", "\t", " ", ";", " | "]),
            before in prop::sample::select(vec!["", "F,", "Reading: "]),
            after in prop::sample::select(vec!["", " N", ";end"]),
        ) {
            let [separator, before, after] = [separator, before, after].map(str::to_owned);
            let line = TextLine { columns: reading.len(), separator, before, after };
            let profile = profile(LineFraming::Text(line));
            prop_assert_eq!(found(&profile, &[reading.clone(), reading.clone()]), [reading.clone(), reading]);
        }
    }
}
