//! Modbus drivers against answers from a script.

use super::*;
use crate::device::LoadCell;
use crate::driver::script::{Script, closing, scripted};
use tokio::time::Instant;

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
async fn a_float_decoded_in_the_wrong_word_order_is_beyond_any_range() {
    // 0.132 with its words swapped: 2.9e24
    let (link, device) = scripted(&[
        (b"\0\0\0\0\0\x06\x01\x03\0\x41\0\x01", b"\0\0\0\0\0\x05\x01\x03\x02\0\0"),
        (b"\0\x01\0\0\0\x06\x01\x03\0\x3F\0\x02", b"\0\x01\0\0\0\x07\x01\x03\x04\x67\x10\x3E\x07"),
    ]);
    let profile = Profile::shipped("seneca-zsg").unwrap();
    let mut cell = ModbusLoadCell::new(link, Transport::Tcp, profile, "script", 200.0, Instant::now()).unwrap();
    let told = cell.prepare().await.unwrap_err().to_string();
    assert!(told.contains("expected a force within 1000 N"), "{told}");
    drop(cell);
    device.await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn a_link_that_the_far_end_closes_is_told_as_that() {
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
        let told = cell.prepare().await.unwrap_err().to_string();
        assert!(
            told.ends_with("while reading its decimals: the other end closed the link, 3 times"),
            "{transport:?}: {told}"
        );
        drop(cell);
        device.await.unwrap();
    }
}
