//! Readings found in bytes, and received over a link, against golden bytes.

use super::framing::{ByteFrame, ByteOrder, Checksum, Finder, FrameNumber, LineFraming, TextLine};
use super::*;
use crate::script::scripted;
use palpate_link::device::{LoadCell, SensorArray};
use palpate_link::time::{Instant, sleep};
use palpate_link::wire::Connector;
use std::sync::Mutex;
use std::time::Duration;
use tokio::io::{AsyncWriteExt, DuplexStream, duplex};

fn text(columns: usize, separator: &str, before: &str, after: &str) -> LineFraming {
    let [separator, before, after] = [separator, before, after].map(str::to_owned);
    LineFraming::Text(TextLine { columns, separator, before, after })
}

fn readings(framing: &LineFraming, in_step: bool, bytes: &[u8]) -> Vec<Vec<f64>> {
    let mut finder = Finder::new(framing.clone(), in_step);
    let mut found = Vec::new();
    // byte by byte: the pieces don't matter
    for byte in bytes {
        finder.take(&[*byte]);
        while let Some(next) = finder.find() {
            found.extend(next);
        }
    }
    found
}

#[test]
fn lines_of_common_sketches_are_read_and_others_are_not() {
    let any = text(3, "", "", "");
    assert_eq!(
        readings(&any, true, b"1,2,3\r\n4\t5 6\n-7;8e1;+9.5\n"),
        [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [-7.0, 80.0, 9.5]]
    );
    assert_eq!(readings(&any, true, b"1,2\n1,2,3,4\n1,2,x\n1,2,nan\n\n1,2,3"), Vec::<Vec<f64>>::new());
    assert_eq!(readings(&any, false, b"99,2,3\n1,2,3\n"), [[1.0, 2.0, 3.0]], "the first may lack its beginning");
    let tabs = text(2, "\t", "", "");
    assert_eq!(readings(&tabs, true, b"500.00\t1.5\t\r\n500.00\t1.5\r\n"), [[500.0, 1.5], [500.0, 1.5]]);
    let marked = text(1, "", "Reading: ", " N");
    assert_eq!(readings(&marked, true, b"Reading: -0.2 N\r\nReading: 0.2 lbs\r\n0.2 N\r\n"), [[-0.2]]);
}

#[test]
fn a_line_without_an_end_is_forgotten_and_the_next_whole_one_is_read() {
    let framing = text(1, "", "", "");
    let mut bytes = vec![b'7'; 3 * super::framing::LINE_MAX_BYTES];
    bytes.extend(b"8\n9\n");
    assert_eq!(readings(&framing, true, &bytes), [[9.0]]);
}

/// Frames with one u16 and two i8.
fn frame(head: &[u8], tail: &[u8], checksum: Option<Checksum>) -> LineFraming {
    let numbers = vec![FrameNumber::U16, FrameNumber::Skip, FrameNumber::I8, FrameNumber::I8];
    LineFraming::Frame(ByteFrame {
        numbers,
        order: ByteOrder::Big,
        head: head.to_vec(),
        tail: tail.to_vec(),
        checksum,
        packet: false,
    })
}

#[test]
fn frames_are_found_by_their_marks() {
    let whole = [0xAA, 0x01, 0x02, 0, 0xFF, 0x7F];
    let found = [258.0, -1.0, 127.0];
    let headed = frame(&[0xAA], &[], None);
    assert_eq!(readings(&headed, false, &[&[9, 9], &whole[..], &whole, &whole].concat()), [found; 3]);
    // a head within a number doesn't count
    let tricky = [0xAA, 0xAA, 0x02, 0, 0xAA, 0x7F];
    assert_eq!(readings(&headed, false, &[&[9], &tricky[..], &tricky, &tricky].concat()).len(), 3);
    // the check values that catalogues of check sums list for "123456789"
    for (checksum, listed) in [
        (Checksum::Sum8, vec![0xDD]),
        (Checksum::Xor8, vec![0x31]),
        (Checksum::Crc16Modbus, vec![0x37, 0x4B]),
        (Checksum::Crc16X25, vec![0x6E, 0x90]),
        (Checksum::Crc32, vec![0x26, 0x39, 0xF4, 0xCB]),
    ] {
        assert_eq!(checksum.of(b"123456789"), listed, "{checksum:?}");
        let sum = checksum.of(&whole[1..]);
        let framing = frame(&[0xAA], &[], Some(checksum));
        let sent = [&whole[..], &sum].concat();
        let mut broken = sent.clone();
        broken[2] ^= 1;
        assert_eq!(
            readings(&framing, false, &[&broken[..], &sent, &broken, &sent].concat()),
            [found; 2],
            "{checksum:?}"
        );
    }
}

#[test]
fn a_frame_with_a_tail_alone_is_found_again_after_a_lost_byte() {
    let framing = frame(&[], &[0x0D, 0x0A], None);
    let whole = [0x01, 0x02, 0, 0xFF, 0x7F, 0x0D, 0x0A];
    let mut bytes = [&whole[3..], &whole, &whole, &whole[1..], &whole, &whole].concat();
    assert_eq!(readings(&framing, false, &bytes), [[258.0, -1.0, 127.0]; 4]);
    // the tail within a number
    let tricky = [0x0D, 0x0A, 0, 0x0D, 0x0A, 0x0D, 0x0A];
    bytes.splice(0..0, [&tricky[..], &tricky, &tricky].concat());
    assert!(readings(&framing, true, &bytes).len() >= 7);
}

/// A link whose far end the test writes to.
pub(super) fn link() -> (Connector, DuplexStream) {
    let (near, far) = duplex(1 << 16);
    let near = Mutex::new(Some(near));
    (Connector::in_memory(move || near.lock().unwrap().take().expect("the link is opened once")), far)
}

pub(super) fn profile(text: &str) -> LineProfile {
    LineProfile::parse("test.toml", text).unwrap()
}

const ONE_BOARD: &str = "name = \"board\"\n[text]\nbefore = \"F,\"\ncolumns = 3\n\
    [force]\nnewton_per_unit = 0.5\n[outputs]\ncolumns = \"2-3\"\n";

#[tokio::test(start_paused = true)]
async fn both_roles_read_one_port_and_ages_count_from_the_last_byte() {
    let (connector, mut far) = link();
    let origin = Instant::now();
    let port = LinePort::new(connector, profile(ONE_BOARD));
    let own = port.profile().clone();
    let mut cell = LineLoadCell::new(port.clone(), own.force.unwrap(), "here".into(), 100.0, origin);
    let mut array = LineArray::new(port, own.outputs.unwrap(), "here".into());
    tokio::spawn(async move {
        far.write_all(b"2,513\nF,1.0,5").await.unwrap();
        sleep(Duration::from_millis(20)).await;
        far.write_all(b"12,513\n").await.unwrap();
        sleep(Duration::from_millis(300)).await;
        far.write_all(b"F,2.0,514,515\nF,3.0,516,517\n").await.unwrap();
        sleep(Duration::from_secs(60)).await;
    });
    assert_eq!(cell.prepare().await.unwrap().identity, "board");
    assert_eq!(array.prepare().await.unwrap().identity, "board, 2 outputs");
    let reading = cell.read().await.unwrap();
    assert_eq!(reading.force_n, 1.5, "the newest of two that came at once");
    assert!((reading.at_s - 0.320).abs() < 0.002, "{}", reading.at_s);
    let mut outputs = [0.0; 2];
    array.read(&mut outputs).await.unwrap();
    assert_eq!(outputs, [516.0, 517.0]);
    let text = cell.read().await.unwrap_err().to_string();
    assert!(text.contains("no reading within 510 ms"), "{text}");
}

#[tokio::test(start_paused = true)]
async fn a_device_that_answers_is_asked_when_its_bootloader_has_ended() {
    let (connector, device) = scripted(&[(b"?\r", b"0.250 N\r\n"), (b"?\r", b"-1.000 N\r\n")]);
    let port = LinePort::new(connector, LineProfile::shipped("mark-10").unwrap());
    let force = port.profile().force.clone().unwrap();
    let mut cell = LineLoadCell::new(port, force, "script".into(), 50.0, Instant::now());
    cell.prepare().await.unwrap();
    assert_eq!(cell.read().await.unwrap().force_n, -1.0);
    drop(cell);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn line_that_fits_no_profile_is_shown() {
    let (connector, mut far) = link();
    let port = LinePort::new(connector, profile(ONE_BOARD));
    let force = port.profile().force.clone().unwrap();
    let mut cell = LineLoadCell::new(port, force, "here".into(), 100.0, Instant::now());
    far.write_all(b"hello\nF,0.012,513\n").await.unwrap();
    let text = cell.prepare().await.unwrap_err().to_string();
    assert_eq!(
        text,
        "load cell (board at here): while waiting for its first reading: no reading within 5000 ms, but 1 other lines or \
         frames: expected a line with 3 numbers after \"F,\", and the last was \"F,0.012,513\""
    );
    drop(far);
    let text = cell.read().await.unwrap_err().to_string();
    assert!(text.contains("the link failed: the other end closed it"), "{text}");
}

#[tokio::test(start_paused = true)]
async fn device_time_shows_delays_and_counter_shows_repeats() {
    let (connector, mut far) = link();
    let origin = Instant::now();
    let text = "name = \"b\"\n[text]\ncolumns = 3\n[force]\ncolumn = 3\nnewton_per_unit = 1.0\n\
                [time]\ncolumn = 1\nunit_s = 0.001\n[counter]\ncolumn = 2\n";
    let port = LinePort::new(connector, profile(text));
    let force = port.profile().force.clone().unwrap();
    let mut cell = LineLoadCell::new(port, force, "here".into(), 10.0, origin);
    tokio::spawn(async move {
        far.write_all(b"0,0,0\n1000,1,1.0\n").await.unwrap();
        sleep(Duration::from_millis(400)).await;
        far.write_all(b"1100,2,2.0\n1200,3,3.0\n1200,3,9.0\n").await.unwrap();
        sleep(Duration::from_secs(60)).await;
    });
    cell.prepare().await.unwrap();
    let reading = cell.read().await.unwrap();
    assert_eq!(reading.force_n, 3.0, "the repeated count is no new reading");
    assert!((reading.at_s - 0.2).abs() < 0.002, "0.2 s before it arrived: {}", reading.at_s);
}

#[test]
fn every_shipped_profile_can_be_read() {
    for (name, text) in SHIPPED {
        LineProfile::parse(name, text).unwrap();
        assert!(LineProfile::shipped(name).is_some(), "{name}");
    }
}

#[test]
fn mistakes_of_a_profile_are_reported_at_their_lines() {
    let words = |text: &str| LineProfile::parse("p.toml", text).unwrap_err().lines();
    let cell = |text: &str| words(&format!("name = \"x\"\n[frame]\nnumbers = [\"7 i16\"]\npacket = true\n{text}"));
    for (text, problem) in [
        (
            "[force]\ncolumns = \"2-3\"\n",
            "6:11: `columns` of [force] are three different numbers: the cell's x, y and z",
        ),
        (
            "[force]\ncolumns = \"2,3,2\"\n",
            "6:11: `columns` of [force] are three different numbers: the cell's x, y and z",
        ),
        ("[force]\ncolumns = \"6-8\"\n", "5:1: [force] names column 8, but a reading has 7 numbers"),
        ("[force]\ncolumns = \"2-4\"\ncolumn = 1\n", "6:11: the force has `column` or `columns`, not both"),
        ("[status]\ncolumn = 1\n", "5:1: [status] has neither `fault_mask` nor `saturated_mask`"),
        ("[status]\ncolumn = 9\nfault_mask = 1\n", "5:1: [status] names column 9, but a reading has 7 numbers"),
        ("[counter]\ncolumn = 1\nstep = 0\n", "7:8: `step` is 0, must be 1 to 1000000"),
    ] {
        assert_eq!(cell(text), [format!("p.toml:{problem}")], "{text}");
    }
    let start = "name = \"x\"\non_start = \"S\"\non_start_hex = \"53\"\n[text]\ncolumns = 1\n";
    assert_eq!(words(start), ["p.toml:3:16: the command at the start is `on_start` or `on_start_hex`, not both"]);
    let start = "name = \"x\"\non_start_hex = \"5\"\n[text]\ncolumns = 1\n";
    assert_eq!(words(start), ["p.toml:2:16: `on_start_hex` is pairs of hexadecimal digits, such as \"AA 55\""]);
    assert_eq!(words("name = \"x\"\n"), ["p.toml:1:1: it isn't stated how a reading looks"]);
    assert_eq!(
        words("name = \"x\"\n[text]\ncolumns = 2\n[force]\ncolumn = 3\n"),
        ["p.toml:4:1: [force] names column 3, but a reading has 2 numbers"]
    );
    assert_eq!(
        words("name = \"x\"\n[frame]\nnumbers = [\"3 f23\"]\nhead = \"A\"\n"),
        [
            "p.toml:3:11: `numbers` has \"3 f23\", expected a type, with a count before it if there are several",
            "p.toml:4:8: `head` is pairs of hexadecimal digits, such as \"AA 55\""
        ]
    );
    assert_eq!(
        words("name = \"x\"\n[frame]\nnumbers = [\"3 f32\"]\n"),
        ["p.toml:2:1: a frame without a head, a tail or a check sum can't be found in the bytes"]
    );
    assert_eq!(
        words("name = \"x\"\n[text]\ncolumns = 4\n[outputs]\ncolumns = \"4-2\"\n"),
        ["p.toml:5:11: `columns` is \"4-2\", expected numbers from 1 and ranges, such as \"2-4, 6-8\""]
    );
}
