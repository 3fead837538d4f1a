//! `palpate emulate` with another program: byte by byte by hand, and with the real drivers in real time.
#![cfg(unix)]

use palpate_testing::{Live, TestFolder, exchanged, shipped, shipped_text};
use std::fs::OpenOptions;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};

/// Longest wait for an answer: the slowest device takes 20 ms.
const PATIENCE: Duration = Duration::from_secs(5);

const PRESS: &str = "name = \"press\"\n[[step]]\nphase = \"test\"\nforce_n = 1.0\nlist = { places_mm = [[0, 0]] }\n";
/// Longest wait for a press in real time after the first descent: some 10 s on an idle machine.
const PRESSED: Duration = Duration::from_secs(120);

/// Height of the surface, and a place nearer to the end of z's travel, which shortens the first descent by seconds.
const SURFACE: &str = "surface_mm = { z = 0.0";
const NEAR_SURFACE: &str = "surface_mm = { z = 9.0";

/// A press with a longer hold than the test.
const HELD: &str = "name = \"held\"\n[press]\nhold_s = 600\n[[step]]\nphase = \"test\"\nforce_n = 1.0\nunits = [5]\n";

#[test]
fn emulated_instruments_answer_any_program_and_the_real_drivers() {
    let bench = TestFolder::with([("press.toml", PRESS), ("held.toml", HELD)]);
    bench.write("sim.toml", &exchanged(&shipped_text("rigs/sim.toml"), SURFACE, NEAR_SURFACE));
    let emulators = Live::start(bench.command("emulate sim.toml --json"));
    let [stage, load_cell, array] = addresses(&emulators);

    // by hand, as in the manuals
    assert!(ask(&stage, b"VE?\r", |answer| answer.ends_with(b"\n")).starts_with(b"ESP301 Version"));
    let weight = ask(&load_cell, &[0x01, 0x03, 0x00, 0x50, 0x00, 0x02, 0xC4, 0x1A], |answer| answer.len() >= 9);
    assert_eq!((weight.len(), &weight[..3]), (9, &[0x01, 0x03, 0x04][..]), "{weight:02X?}");
    assert_eq!(crc(&weight), 0, "the sum over a frame and its own sum: {weight:02X?}");
    assert_eq!(registers(&array, 60000), 7.0, "PRODUCT_ID");

    // by the drivers: the real rig's file with other addresses, and an approach that is fast enough for a test
    let mut rig = shipped_text("rigs/esp301.toml");
    for (from, to) in [
        ("serial:///dev/ttyUSB0?", format!("serial://{stage}?")),
        ("serial:///dev/ttyUSB1?", format!("serial://{load_cell}?")),
        ("tcp://192.168.1.10:502", format!("tcp://{array}")),
        ("settle_ms = 10.0", "settle_ms = 10.0\napproach_mm_s = 2.0".to_owned()),
        (SURFACE, NEAR_SURFACE.to_owned()),
    ] {
        rig = exchanged(&rig, from, &to);
    }
    bench.write("rig.toml", &rig);
    let z_mm = || {
        let z = ask(&stage, b"3TP?\r", |answer| answer.ends_with(b"\n"));
        String::from_utf8_lossy(&z).trim().parse::<f64>().expect("a position")
    };
    let stands_mm = z_mm();
    let output = bench.palpate_ends(2, "run press.toml --rig rig.toml --out unconfirmed");
    assert!(output.running().contains("nothing was moved. Run `palpate doctor` at a terminal once"), "{}", output.err);
    assert_eq!((z_mm(), &bench.manifest("unconfirmed")["presses_done"]), (stands_mm, &0.into()), "nothing moves");
    let output = Live::start(bench.command("run press.toml --rig rig.toml --out run --json --confirmed down"));
    let output = output.end_within(PRESSED);
    assert_eq!(output.code, Some(0), "{}\n{}", output.out, output.err);
    assert_eq!(output.json_lines().len(), 1);
    let manifest = bench.manifest("run");
    assert_eq!((&manifest["status"], &manifest["simulated"]), (&"complete".into(), &false.into()));
    let link = |device: usize| manifest["devices"][device]["link"].as_str().unwrap_or_default().to_owned();
    assert!(link(0).contains(&stage) && link(1).contains(&load_cell) && link(2).contains(&array), "{manifest}");
    let force_n: f64 = bench.column("run/presses.csv", "force_n")[0].parse().expect("a number");
    assert!((force_n - 1.0).abs() <= 0.05, "{force_n} N");
    assert!(!bench.has("run/scene.csv"), "nobody knows the truth behind a real link");

    // stopped in contact, as the middle unit shows; the stage itself reports its position then
    let live = Live::start(bench.command("run held.toml --rig rig.toml --out stopped --json --confirmed down"));
    live.until_printed("from press 1");
    let began = Instant::now();
    while registers(&array, 8) < 0.5 {
        assert!(began.elapsed() < PRESSED, "no contact yet");
    }
    live.signal("TERM"); // a Ctrl-C would wait for the end of the press
    let output = live.end();
    assert_eq!(output.code, Some(130), "{}\n{}", output.out, output.err);
    assert_eq!(bench.manifest("stopped")["status"], "stopped");
    let z_mm = z_mm();
    assert!(z_mm > 9.3, "parked above the highest the surface may be, not at {z_mm} mm");

    emulators.signal("TERM");
    let output = emulators.end();
    assert_eq!((output.code, output.out.as_str(), output.err.as_str()), (Some(0), "", ""));
}

#[test]
fn without_json_each_device_is_a_plain_line() {
    let emulators =
        Live::start(TestFolder::new().command(&format!("emulate {}", shipped("rigs/esp301.toml").display())));
    for (device, protocol) in [("stage", "esp301"), ("load_cell", "modbus-rtu"), ("array", "modbus-tcp")] {
        let line = emulators.line().expect("a line a device");
        let words: Vec<&str> = line.split_whitespace().collect();
        assert_eq!((words.len(), &words[..2]), (3, &[device, protocol][..]), "{line}");
    }
    emulators.signal("INT");
    assert_eq!(emulators.end().code, Some(0));
}

/// Addresses of the three devices: two pseudo-terminals and a port of this machine.
fn addresses(emulators: &Live) -> [String; 3] {
    let expected =
        [("stage", "esp301", "/dev/"), ("load_cell", "modbus-rtu", "/dev/"), ("array", "modbus-tcp", "127.")];
    expected.map(|(device, protocol, start)| {
        let line = emulators.line().expect("a line a device");
        let object: serde_json::Map<_, _> = serde_json::from_str(&line).expect("one JSON object a line");
        let listen = object["listen"].as_str().unwrap_or_default().to_owned();
        assert_eq!((object.len(), &object["device"], &object["protocol"]), (3, &device.into(), &protocol.into()));
        // a system with other names for terminals still has them in its file tree
        assert!(listen.starts_with(start), "{line}");
        listen
    })
}

/// A value of the array's converter: two registers from an address, over its own connection.
fn registers(array: &str, address: u16) -> f32 {
    let mut socket = TcpStream::connect(array).expect("connects");
    socket.set_read_timeout(Some(PATIENCE)).expect("a deadline");
    let [high, low] = address.to_be_bytes();
    socket.write_all(&[0x00, 0x07, 0, 0, 0, 6, 0x01, 0x03, high, low, 0x00, 0x02]).expect("writes");
    let mut answer = [0; 13];
    socket.read_exact(&mut answer).expect("an answer");
    let ([head @ .., a, b, c, d], expected) = (answer, [0x00, 0x07, 0, 0, 0, 7, 0x01, 0x03, 0x04]);
    assert_eq!(head, expected);
    f32::from_be_bytes([a, b, c, d])
}

/// Writes to a terminal and reads until the answer is complete. A thread reads, and is abandoned if nothing comes, because a terminal has
/// no deadline.
fn ask(path: &str, question: &[u8], is_whole: fn(&[u8]) -> bool) -> Vec<u8> {
    let mut terminal = OpenOptions::new().read(true).write(true).open(path).expect("the terminal opens");
    terminal.write_all(question).expect("writes");
    let (sender, receiver) = channel();
    thread::spawn(move || {
        let mut answer = Vec::new();
        while !is_whole(&answer) {
            let mut bytes = [0; 64];
            let count = terminal.read(&mut bytes).expect("reads");
            answer.extend(&bytes[..count]);
        }
        // the only error is that nobody waits any more
        let _ = sender.send(answer);
    });
    receiver.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("no answer from {path} to {question:02X?}"))
}

/// CRC-16 of Modbus over serial line; 0 over a frame with its CRC.
fn crc(frame: &[u8]) -> u16 {
    frame.iter().fold(0xFFFF, |sum, byte| {
        (0..8).fold(sum ^ u16::from(*byte), |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0xA001 } else { sum >> 1 })
    })
}
