//! Keys of a line profile, table by table.

use super::framing::{ByteOrder, Checksum, FrameNumber};
use palpate_document::{Bounds, Keys, keys, words};

pub(super) const CHECKSUMS: [(&str, Checksum); 5] = [
    ("sum8", Checksum::Sum8),
    ("xor8", Checksum::Xor8),
    ("crc16-modbus", Checksum::Crc16Modbus),
    ("crc16-x25", Checksum::Crc16X25),
    ("crc32", Checksum::Crc32),
];
pub(super) const ORDERS: [(&str, ByteOrder); 2] = [("little", ByteOrder::Little), ("big", ByteOrder::Big)];

/// Types of the numbers of a frame, with their names in `numbers`.
pub(super) const TYPES: [(&str, FrameNumber); 9] = [
    ("u8", FrameNumber::U8),
    ("i8", FrameNumber::I8),
    ("u16", FrameNumber::U16),
    ("i16", FrameNumber::I16),
    ("u32", FrameNumber::U32),
    ("i32", FrameNumber::I32),
    ("f32", FrameNumber::F32),
    ("f64", FrameNumber::F64),
    ("skip", FrameNumber::Skip),
];

/// Largest number of numbers in a reading.
pub(super) const COLUMNS_MAX: u64 = 1024;

/// Largest step of a count.
const STEP_MAX: u64 = 1_000_000;

/// Largest mask: 32 bits.
const MASK_MAX: u64 = u32::MAX as u64;

const START: Bounds = Bounds::within(0.0, 60.0, "s");
const FACTOR: Bounds = Bounds::within(-1e12, 1e12, "");
const RAW: Bounds = Bounds::within(-1e12, 1e12, "units of the device");
const RANGE: Bounds = Bounds::above(0.0, 1e6, "N");
const UNIT_OF_TIME: Bounds = Bounds::above(0.0, 3600.0, "s");

/// Keys of a line profile.
pub const KEYS: Keys = root::KEYS;

keys! {
    /// The complete profile.
    root {
        name: Text, Refused, "the device's name in messages", "\"Arduino with HX711\"";
        start_s: Number(START), or(5.0),
            "longest wait for the first reading after the port is opened, which restarts many boards", "5.0";
        on_start: Text, Allowed, "command that is sent when the device is ready, such as one that starts its output", "\"AOUT50\\r\"";
        on_start_hex: Text, Allowed, "the same command as bytes, hexadecimal; either this or on_start", "\"12 34 00 02\"";
        ask: Text, Allowed, "command that asks for one reading; without it, the device sends without a command", "\"?\\r\"";
        text: Table(&text::KEYS), Allowed, "a reading is a line of text; either this or [frame]";
        frame: Table(&frame::KEYS), Allowed, "a reading is a frame of bytes; either this or [text]";
        force: Table(&force::KEYS), Allowed, "the number that is a load cell's force";
        outputs: Table(&outputs::KEYS), Allowed, "the numbers that are an array's outputs";
        time: Table(&time::KEYS), Allowed, "the number that is the device's own time";
        counter: Table(&counter::KEYS), Allowed, "the number that counts the device's readings";
        status: Table(&status::KEYS), Allowed, "the number whose bits report the state of a load cell";
    }
}

keys! {
    /// `[text]`
    text {
        columns: Whole(1, COLUMNS_MAX), Refused, "how many numbers a line has; a line with another count is ignored", "16";
        separator: Text, Allowed, "text between two numbers; without it, commas, semicolons, tabs and blanks", "\",\"";
        before: Text, Allowed, "text before the first number", "\"F,\"";
        after: Text, Allowed, "text after the last number, such as a unit", "\" N\"";
    }
}

keys! {
    /// `[frame]`
    frame {
        numbers: Texts, Refused,
            "the numbers of a frame in their order: a type, or a count and a type; `skip` is a byte without meaning",
            "[\"u16\", \"skip\", \"20 f32\"]";
        order: Word(&words(&ORDERS)), or_word("little"), "order of the bytes of a number", "\"big\"";
        head: Text, Allowed, "bytes before the numbers, hexadecimal", "\"AA 55\"";
        tail: Text, Allowed, "bytes at the end of the frame, hexadecimal", "\"0D 0A\"";
        checksum: Word(&words(&CHECKSUMS)), Allowed, "check sum over the numbers, which follows them", "\"sum8\"";
        packet: Flag, or_flag(false), "whether each datagram of a UDP link has complete frames; they need no mark then", "true";
    }
}

keys! {
    /// `[force]`
    force {
        column: Whole(1, COLUMNS_MAX), or_whole(1), "which number it is, from 1; either this or columns", "1";
        columns: Text, Allowed, "the numbers of a cell with three axes: its x, y and z, from 1", "\"4-6\"";
        newton_per_unit: Number(FACTOR), Allowed,
            "N per unit of the device; negative if a push decreases it; without it, the rig states it", "0.0000025";
        offset: Number(RAW), or(0.0), "the number without force", "84000.0";
        range_n: Number(RANGE), Allowed, "largest force it can measure; a line with a larger one is ignored", "50.0";
        saturated_at: Range(RAW), Allowed, "the ends of its range: at these numbers or beyond it is saturated", "[-8388608, 8388607]";
    }
}

keys! {
    /// `[outputs]`
    outputs {
        columns: Text, Refused, "which numbers they are, from 1, in the order of the rig's units and channels", "\"2-16\"";
        scale: Number(FACTOR), or(1.0), "factor of each output, after the offset", "0.001";
        offset: Number(RAW), or(0.0), "what is subtracted from each number", "512.0";
        possible: Range(RAW), Allowed, "range of the numbers; a line with another one is ignored", "[0, 1023]";
    }
}

keys! {
    /// `[time]`
    time {
        column: Whole(1, COLUMNS_MAX), Refused, "which number it is, from 1", "1";
        unit_s: Number(UNIT_OF_TIME), Refused, "its unit, s", "0.001";
    }
}

keys! {
    /// `[counter]`
    counter {
        column: Whole(1, COLUMNS_MAX), Refused, "which number it is, from 1; a reading with the same count again is no new one", "17";
        step: Whole(1, STEP_MAX), Allowed,
            "how much it grows for each reading: a larger step shows lost readings, and a count that goes back a device that restarted", "1";
    }
}

keys! {
    /// `[status]`
    status {
        column: Whole(1, COLUMNS_MAX), Refused, "which number it is, from 1", "1";
        fault_mask: Whole(1, MASK_MAX), Allowed, "bits that report a fault of the cell; one of them stops the stage", "0x80000000";
        saturated_mask: Whole(1, MASK_MAX), Allowed, "bits that report a force beyond its range; one of them stops the stage", "2";
    }
}

#[cfg(test)]
mod tests {
    use crate::lines::{KEYS, LineProfile};
    use palpate_document::sample::assert_read_is_listed;

    #[test]
    fn line_profile_reader_reads_exactly_the_listed_keys() {
        assert_read_is_listed(&KEYS, |text| drop(LineProfile::parse("profile.toml", text)));
    }
}
