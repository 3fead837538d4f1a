//! Cells with three axes, against golden bytes: an ATI Net F/T and a Bota sensor, and what their counts and states report.

use super::framing::Finder;
use super::tests::{link, profile};
use super::*;
use palpate_core::quantity::{ForceReading, Health};
use palpate_link::device::LoadCell;
use palpate_link::time::{Instant, sleep, spawn};
use palpate_link::wire::{Connector, Link};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::net::UdpSocket;

/// x as the device's x, y against its y, and a press against its z.
const MOUNTED: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];

/// A record of the Net F/T: counts of 0.5, -0.25 and -1.5 N.
fn record(sequence: u32, status: u32) -> Vec<u8> {
    let forces = [[0x00, 0x07, 0xA1, 0x20], [0xFF, 0xFC, 0x2F, 0x70], [0xFF, 0xE9, 0x1C, 0xA0]].concat();
    [&sequence.to_be_bytes()[..], &[0, 0, 0x10, 0x68], &status.to_be_bytes(), &forces, &[0; 12]].concat()
}

fn net_ft() -> (LineLoadCell, LinePort, DuplexStream) {
    let (connector, far) = link();
    let port = LinePort::new(connector, LineProfile::shipped("ati-netft").unwrap());
    let force = port.profile().force.clone().unwrap();
    let cell = LineLoadCell::new(port.clone(), force, "here".into(), 1000.0, Instant::now()).mounted(MOUNTED);
    (cell, port, far)
}

/// Takes the command that starts the stream.
async fn started(far: &mut DuplexStream) {
    let mut command = [0; 8];
    far.read_exact(&mut command).await.unwrap();
    assert_eq!(command, [0x12, 0x34, 0, 2, 0, 0, 0, 0]);
}

fn is_near(reading: &ForceReading, side_n: [f64; 2], force_n: f64) -> bool {
    let given = [reading.side_n.unwrap()[0], reading.side_n.unwrap()[1], reading.force_n];
    given.iter().zip([side_n[0], side_n[1], force_n]).all(|(given, expected)| (given - expected).abs() < 1e-9)
}

#[tokio::test(start_paused = true)]
async fn net_ft_streams_after_its_command_and_its_axes_are_those_of_the_mounting() {
    let (mut cell, port, mut far) = net_ft();
    let origin = Instant::now();
    let device = spawn(async move {
        started(&mut far).await;
        for (sequence, status) in [(1, 0), (2, 0), (3, 0x8002_0000), (4, 0x8000_0001)] {
            far.write_all(&record(sequence, status)).await.unwrap();
            sleep(Duration::from_millis(10)).await;
        }
        sleep(Duration::from_secs(60)).await;
    });
    let identity = cell.prepare().await.unwrap();
    assert_eq!((identity.identity.as_str(), identity.warnings.len()), ("ATI Net F/T", 0));
    assert!(origin.elapsed() < Duration::from_millis(100), "it doesn't wait for a bootloader");
    for (saturated, fault) in [(false, false), (true, true), (false, true)] {
        let reading = cell.read().await.unwrap();
        assert!(is_near(&reading, [0.5, 0.25], 1.5), "{reading:?}");
        assert_eq!(reading.health, Health { saturated, fault });
    }
    assert_eq!(port.counts(), super::port::PortCounts { good: 4, rejected: 0, lost: 0 });
    device.abort();
}

#[tokio::test(start_paused = true)]
async fn lost_records_are_counted_and_named_when_the_device_is_silent() {
    let (mut cell, port, mut far) = net_ft();
    let device = spawn(async move {
        started(&mut far).await;
        // 3 is lost, 6 and 7 too, and 5 comes again behind 8
        for sequence in [1, 2, 4, 5, 8, 5, 9] {
            far.write_all(&record(sequence, 0)).await.unwrap();
            sleep(Duration::from_millis(1)).await;
        }
        sleep(Duration::from_secs(60)).await;
    });
    cell.prepare().await.unwrap();
    sleep(Duration::from_millis(50)).await;
    assert_eq!(port.counts(), super::port::PortCounts { good: 6, rejected: 0, lost: 3 });
    let warnings = cell.prepare().await.unwrap().warnings;
    assert_eq!(warnings, ["3 of 9 readings were lost on their way"]);
    let text = cell.read().await.unwrap_err().to_string();
    assert!(text.ends_with("no reading within 501 ms; before, 3 of 9 readings were lost on their way"), "{text}");
    device.abort();
}

#[tokio::test(start_paused = true)]
async fn a_count_that_begins_again_ends_the_link() {
    let (mut cell, _, mut far) = net_ft();
    let device = spawn(async move {
        started(&mut far).await;
        for sequence in [5000, 5001, 1] {
            far.write_all(&record(sequence, 0)).await.unwrap();
            sleep(Duration::from_millis(10)).await;
        }
        sleep(Duration::from_secs(60)).await;
    });
    cell.prepare().await.unwrap();
    cell.read().await.unwrap();
    let text = cell.read().await.unwrap_err().to_string();
    let cause = "its count jumped from 5001 to 1: the device restarted, or another program took its readings";
    assert!(text.contains(cause), "{text}");
    device.abort();
}

#[test]
fn a_packet_that_is_cut_shifts_no_later_frame() {
    let framing = LineProfile::shipped("ati-netft").unwrap().framing;
    let mut finder = Finder::new(framing, false);
    let mut found = |bytes: &[u8]| {
        finder.take(bytes);
        let mut sequences = Vec::new();
        while let Some(next) = finder.find() {
            sequences.push(next.map(|numbers| numbers[0]).map_err(|rejected| rejected.expected));
        }
        sequences
    };
    let cut = || Err("packets of frames of 36 bytes".to_owned());
    assert_eq!(found(&record(1, 0)), [Ok(1.0)]);
    assert_eq!(found(&record(2, 0)[..20]), [cut()]);
    assert_eq!(found(&[record(3, 0), record(4, 0)].concat()), [Ok(3.0), Ok(4.0)], "two records in one packet");
    assert_eq!(found(&[record(5, 0), vec![0]].concat()), [cut()]);
    assert_eq!(found(&record(6, 0)), [Ok(6.0)]);
}

/// A frame of a Bota sensor: 0.5, -0.25 and 1.5 N at 1 s, over range. Its check sum was computed by other code.
const BOTA: [u8; 37] = [
    0xAA, 0x02, 0x00, 0x00, 0x00, 0x00, 0x3F, 0x00, 0x00, 0x80, 0xBE, 0x00, 0x00, 0xC0, 0x3F, 0x0A, 0xD7, 0x23, 0x3C,
    0x0A, 0xD7, 0xA3, 0x3C, 0x8F, 0xC2, 0xF5, 0x3C, 0x40, 0x42, 0x0F, 0x00, 0x00, 0x00, 0xC8, 0x41, 0x99, 0xDF,
];

#[tokio::test(start_paused = true)]
async fn bota_frames_are_checked_and_their_state_is_read() {
    let (connector, mut far) = link();
    let port = LinePort::new(connector, LineProfile::shipped("bota-serial").unwrap());
    let force = port.profile().force.clone().unwrap();
    let mut cell = LineLoadCell::new(port.clone(), force, "here".into(), 100.0, Instant::now());
    let mut broken = BOTA;
    broken[5] ^= 1;
    // a cut frame, a broken one and two whole ones
    far.write_all(&[&BOTA[30..], &broken, &BOTA, &BOTA].concat()).await.unwrap();
    cell.prepare().await.unwrap();
    far.write_all(&BOTA).await.unwrap();
    let reading = cell.read().await.unwrap();
    assert!(is_near(&reading, [0.5, -0.25], 1.5), "{reading:?}");
    assert_eq!(reading.health, Health { saturated: true, fault: false });
    assert_eq!(port.counts().good, 3);
}

/// A measurement of a GSV-8: 0.5, -0.25 and 1.5 N, with this status.
fn measurement(status: u8) -> Vec<u8> {
    let forces = [0x3F, 0x00, 0x00, 0x00, 0xBE, 0x80, 0x00, 0x00, 0x3F, 0xC0, 0x00, 0x00];
    [&[0xAA, 0x17, status], &forces[..], &[0; 20], &[0x85]].concat()
}

#[tokio::test(start_paused = true)]
async fn a_gsv8_is_started_and_its_measurements_are_read() {
    let (connector, mut far) = link();
    let port = LinePort::new(connector, LineProfile::shipped("me-gsv8").unwrap());
    let force = port.profile().force.clone().unwrap();
    let mut cell = LineLoadCell::new(port, force, "here".into(), 100.0, Instant::now());
    let device = spawn(async move {
        let mut command = [0; 4];
        far.read_exact(&mut command).await.unwrap();
        assert_eq!(command, [0xAA, 0x90, 0x24, 0x85]);
        far.write_all(&[0xAA, 0x50, 0x00, 0x85]).await.unwrap();
        for status in [0xB0, 0xB0, 0xB0, 0xB1, 0xB2] {
            far.write_all(&measurement(status)).await.unwrap();
            sleep(Duration::from_millis(10)).await;
        }
        sleep(Duration::from_secs(60)).await;
    });
    cell.prepare().await.unwrap();
    let mut seen = Vec::new();
    while let Ok(reading) = cell.read().await {
        assert!(is_near(&reading, [0.5, -0.25], 1.5), "{reading:?}");
        seen.push((reading.health.saturated, reading.health.fault));
    }
    assert!(seen.ends_with(&[(false, false), (true, false), (false, true)]), "{seen:?}");
    device.abort();
}

#[tokio::test(start_paused = true)]
async fn one_axis_at_its_end_saturates_the_cell_and_an_impossible_one_is_rejected() {
    let (connector, mut far) = link();
    let text = "name = \"b\"\n[text]\ncolumns = 3\n[force]\ncolumns = \"1-3\"\nnewton_per_unit = 0.1\noffset = 10\n\
                saturated_at = [-100, 100]\nrange_n = 20.0\n";
    let port = LinePort::new(connector, profile(text));
    let force = port.profile().force.clone().unwrap();
    let mut cell = LineLoadCell::new(port.clone(), force, "here".into(), 100.0, Instant::now());
    far.write_all(b"0,0,0\n10,20,30\n").await.unwrap();
    cell.prepare().await.unwrap();
    for (line, side_n, force_n, saturated) in
        [("20,10,0\n", [1.0, 0.0], -1.0, false), ("20,-100,0\n", [1.0, -11.0], -1.0, true)]
    {
        far.write_all(line.as_bytes()).await.unwrap();
        let reading = cell.read().await.unwrap();
        assert!(is_near(&reading, side_n, force_n), "{reading:?}");
        assert_eq!(reading.health, Health { saturated, fault: false });
    }
    far.write_all(b"10,10,300\n").await.unwrap();
    cell.read().await.unwrap_err();
    assert_eq!(port.counts().rejected, 1);
}

#[tokio::test]
async fn the_last_packet_of_a_queue_counts() {
    let device = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let link = Link::parse(&format!("udp://{}", device.local_addr().unwrap())).unwrap();
    let port = LinePort::new(Connector::Real(link), LineProfile::shipped("ati-netft").unwrap());
    let force = port.profile().force.clone().unwrap();
    let mut cell = LineLoadCell::new(port.clone(), force, "here".into(), 1000.0, Instant::now());
    let (client, prepared) = tokio::join!(
        async {
            let (_, client) = device.recv_from(&mut [0; 8]).await.unwrap();
            device.send_to(&record(1, 0), client).await.unwrap();
            client
        },
        cell.prepare()
    );
    prepared.unwrap();
    // without an await no task reads in between; the first ones are saturated
    for sequence in 2..=150 {
        let status = if sequence < 150 { 0x0002_0000 } else { 0 };
        device.try_send_to(&record(sequence, status), client).unwrap();
    }
    assert!(!cell.read().await.unwrap().health.saturated);
    assert_eq!(port.counts().good, 150);
}
