//! Modbus drivers against answers from a script.

use super::*;
use crate::script::{Script, closing, scripted};
use palpate_link::device::LoadCell;
use palpate_link::time::Instant;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

#[tokio::test(start_paused = true)]
async fn the_manuals_frame_of_the_generic_transmitter_is_132_counts() {
    // decimals 3 in register 8; the gross weight is the manual's own worked frame
    let (link, device) = scripted(&[
        (b"\x01\x03\x00\x08\x00\x01\x05\xC8", b"\x01\x03\x02\x00\x03\xF8\x45"),
        (b"\x01\x03\x00\x08\x00\x01\x05\xC8", b"\x01\x03\x02\x00\x03\xF8\x45"),
        (b"\x01\x03\x00\x50\x00\x02\xC4\x1A", b"\x01\x03\x04\x00\x00\x00\x84\xFA\x50"),
        (b"\x01\x03\x00\x50\x00\x02\xC4\x1A", b"\x01\x03\x04\x00\x00\x00\x84\xFA\x50"),
    ]);
    let profile = Profile::shipped("generic-rs485").unwrap();
    let mut cell = ModbusLoadCell::new(link, Transport::Rtu, profile, "script", 200.0, Instant::now()).unwrap();
    cell.prepare().await.unwrap();
    assert_eq!(cell.read().await.unwrap().force_n, 0.132);
    drop(cell);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_magnitude_takes_its_sign_and_its_health_from_the_status_read_with_it() {
    // Laumas over TCP: status and gross weight are one read of three registers from 6 on
    let (link, device) = scripted(&[
        (b"\0\0\0\0\0\x06\x01\x03\0\x06\0\x01", b"\0\0\0\0\0\x05\x01\x03\x02\0\0"),
        (b"\0\x01\0\0\0\x06\x01\x03\0\x06\0\x03", b"\0\x01\0\0\0\x09\x01\x03\x06\0\0\0\0\0\x84"),
        (b"\0\x02\0\0\0\x06\x01\x03\0\x06\0\x03", b"\0\x02\0\0\0\x09\x01\x03\x06\0\x88\0\0\0\x84"),
    ]);
    let profile = Profile::shipped("laumas-tlb").unwrap();
    let mut cell = ModbusLoadCell::new(link, Transport::Tcp, profile, "script", 200.0, Instant::now()).unwrap();
    cell.prepare().await.unwrap();
    let reading = cell.read().await.unwrap();
    assert!((reading.force_n + 0.132).abs() < 1e-12 && reading.health.saturated, "{reading:?}");
    drop(cell);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn three_forces_are_one_read_and_those_of_the_mounting() {
    // frames of an FT 300 over RTU, check sums by other code: 0.5, -0.25 and -1.5 N, then -300.01 N along z
    const ASKED: &[u8] = b"\x09\x03\x00\xB4\x00\x03\x44\xA5";
    const PRESSED: &[u8] = b"\x09\x03\x06\x00\x32\xFF\xE7\xFF\x6A\x3E\x8D";
    const BEYOND: &[u8] = b"\x09\x03\x06\x00\x32\xFF\xE7\x8A\xCF\xD8\x66";
    let (link, device) = scripted(&[(ASKED, PRESSED), (ASKED, PRESSED), (ASKED, BEYOND)]);
    let profile = Profile::shipped("robotiq-ft300").unwrap();
    let cell = ModbusLoadCell::new(link, Transport::Rtu, profile, "script", 80.0, Instant::now()).unwrap();
    let mut cell = cell.mounted([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
    cell.prepare().await.unwrap();
    let reading = cell.read().await.unwrap();
    assert_eq!((reading.side_n, reading.force_n), (Some([-0.25, -0.5]), 1.5));
    let text = cell.read().await.unwrap_err().to_string();
    assert!(text.contains("expected a force within 300 N"), "{text}");
    drop(cell);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_float_decoded_in_the_wrong_word_order_is_beyond_any_range() {
    // 0.132 with its words swapped: 2.9e24
    let (link, device) = scripted(&[
        (b"\0\0\0\0\0\x06\x01\x03\0\x41\0\x01", b"\0\0\0\0\0\x05\x01\x03\x02\0\0"),
        (b"\0\x01\0\0\0\x06\x01\x03\0\x3F\0\x02", b"\0\x01\0\0\0\x07\x01\x03\x04\x67\x10\x3E\x07"),
    ]);
    let profile = Profile::shipped("seneca-zsg").unwrap();
    let mut cell = ModbusLoadCell::new(link, Transport::Tcp, profile, "script", 200.0, Instant::now()).unwrap();
    let text = cell.prepare().await.unwrap_err().to_string();
    assert!(text.contains("expected a force within 1000 N"), "{text}");
    drop(cell);
    device.await.unwrap();
}

/// The shortest time from an answer to the next request, three times in a row, over a framing.
async fn shortest_rest(framing: impl Into<ModbusFraming>) -> Duration {
    let framing = framing.into();
    let (near, mut far) = tokio::io::duplex(256);
    let near = std::sync::Mutex::new(Some(near));
    let dial = move || near.lock().unwrap().take().expect("the link is opened once");
    let profile = Profile::shipped("generic-rs485").unwrap();
    let link = palpate_link::wire::Connector::in_memory(dial);
    let mut client = ModbusClient::new(link, framing, &profile, "load cell", "script");
    let device = tokio::spawn(async move {
        let (mut answered, mut shortest) = (None, Duration::MAX);
        for _ in 0..4 {
            match framing.transport {
                Transport::Rtu => {
                    far.read_exact(&mut [0; 8]).await.unwrap();
                    shortest = shortest.min(answered.map_or(Duration::MAX, |at| Instant::now() - at));
                    far.write_all(b"\x01\x03\x02\x00\x03\xF8\x45").await.unwrap();
                }
                Transport::Tcp => {
                    let mut request = [0; 12];
                    far.read_exact(&mut request).await.unwrap();
                    shortest = shortest.min(answered.map_or(Duration::MAX, |at| Instant::now() - at));
                    let header = [request[0], request[1], 0, 0, 0, 5, 1, 3, 2, 0, 3];
                    far.write_all(&header).await.unwrap();
                }
            }
            answered = Some(Instant::now());
        }
        shortest
    });
    for _ in 0..4 {
        assert_eq!(client.read("reading", Function::Holding, 8, 1).await.unwrap(), [3]);
    }
    device.await.unwrap()
}

#[tokio::test(start_paused = true)]
async fn a_serial_line_is_silent_for_three_and_a_half_characters_before_a_request() {
    // tokio's timers are rounded up to a millisecond
    assert_eq!(shortest_rest(Transport::Tcp).await, Duration::ZERO);
    for (link, silence_us, rest_ms) in [
        ("serial:///dev/ttyUSB0?baud=2400", 14_583, 15),
        ("serial:///dev/ttyUSB0?baud=9600", 3_645, 4),
        ("serial:///dev/ttyUSB0?baud=9600&parity=even", 4_010, 5),
        ("serial:///dev/ttyUSB0?baud=9600&parity=even&stop_bits=2", 4_375, 5),
        ("serial:///dev/ttyUSB0?baud=19200", 1_822, 2),
        ("serial:///dev/ttyUSB0?baud=115200", 1_750, 2),
        ("sim", 1_750, 2),
    ] {
        let framing = ModbusFraming::of(&palpate_link::wire::Link::parse(link).unwrap(), Transport::Rtu);
        assert_eq!((framing.transport, framing.silence.as_micros()), (Transport::Rtu, silence_us), "{link}");
        assert_eq!(shortest_rest(framing).await, Duration::from_millis(rest_ms), "{link}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_link_that_the_far_end_closes_is_reported_as_that() {
    const TCP: &[u8] = b"\0\0\0\0\0\x06\x01\x03\0\x08\0\x01";
    const RTU: &[u8] = b"\x01\x03\x00\x08\x00\x01\x05\xC8";
    // a line that was opened again is asked with the other function first
    const RTU_DOUBTED: &[u8] = b"\x01\x04\x00\x08\x00\x01\xB0\x08";
    for (transport, scripts) in [
        (Transport::Tcp, [&[(TCP, b"" as &[u8])], &[(TCP, b"\0\0\0\0\0")], &[(TCP, b"\0\0\0\0\0\x05\x01\x03\x02\0")]]),
        (Transport::Rtu, [&[(RTU, b"")], &[(RTU_DOUBTED, b"\x01\x04")], &[(RTU_DOUBTED, b"")]]),
    ] {
        let scripts: &'static [Script] = Vec::leak(scripts.map(|script| script as Script).to_vec());
        let (link, device) = closing(scripts);
        let profile = Profile::shipped("generic-rs485").unwrap();
        let mut cell = ModbusLoadCell::new(link, transport, profile, "script", 200.0, Instant::now()).unwrap();
        let text = cell.prepare().await.unwrap_err().to_string();
        assert!(
            text.ends_with("while reading its decimals: the other end closed the link, 3 times"),
            "{transport:?}: {text}"
        );
        drop(cell);
        device.await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn answer_with_too_few_registers_is_an_error() {
    const REQUEST: &[u8] = b"\0\0\0\0\0\x06\x01\x03\0\x08\0\x01";
    const EMPTY: &[u8] = b"\0\0\0\0\0\x03\x01\x03\0";
    let (link, device) = closing(&[&[(REQUEST, EMPTY)], &[(REQUEST, EMPTY)], &[(REQUEST, EMPTY)]]);
    let profile = Profile::shipped("generic-rs485").unwrap();
    let mut client = ModbusClient::new(link, Transport::Tcp, &profile, "load cell", "script");
    let text = client.read("reading", Function::Holding, 8, 1).await.unwrap_err().to_string();
    assert!(text.ends_with("while reading: 0 registers arrived instead of 1, 3 times"), "{text}");
    drop(client);
    device.await.unwrap();
}
