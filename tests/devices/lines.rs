//! The driver of lines and frames with boards that damage them, stall and restart. See the numbers with `cargo test --release --test
//! devices lines:: -- --nocapture`.

use palpate_drivers::lines::{LinePort, LineProfile, Received};
use palpate_link::time::Instant;
use palpate_link::wire::Connector;
use palpate_run::rig;
use palpate_sim::emulator::lines::{
    BoardFirmware, Damage, DamageKind, LineFault, LineFaultKind, Port, Sent, SerialBoard,
};
use palpate_sim::emulator::serve;
use palpate_sim::scene::{Scene, SceneDevice};
use palpate_testing::executions::run_virtually;
use palpate_testing::{TestFolder, shipped_text};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::duplex;

/// Format of a board's readings.
#[derive(Clone, Copy, Debug)]
enum LineMarks {
    /// A line of text.
    Text,
    /// A line of text between a word and another.
    MarkedText,
    /// Floats, then CR LF.
    Tail,
    /// A head, 16-bit numbers, their sum.
    HeadAndSum,
    /// A head, 16-bit numbers, their CRC-16.
    HeadAndCrc,
}

/// A skin with different counts in each reading.
struct LineSkin {
    marks: LineMarks,
    channels: usize,
    hz: f64,
    port: Port,
    nth: u64,
}

impl BoardFirmware for LineSkin {
    fn device(&self) -> SceneDevice {
        SceneDevice::Array
    }

    fn port(&self) -> Port {
        self.port
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        Some(1.0 / self.hz)
    }

    fn read(&mut self, _: &mut Scene, _: f64) -> Vec<f64> {
        self.nth += 1;
        (0..self.channels as u64).map(|k| ((self.nth * 7919 + k * 104_729) % 1024) as f64).collect()
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        let text = || reading.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let words = || reading.iter().flat_map(|value| (*value as u16).to_le_bytes()).collect::<Vec<u8>>();
        match self.marks {
            LineMarks::Text => format!("{}\r\n", text()).into_bytes(),
            LineMarks::MarkedText => format!("S,{},E\r\n", text()).into_bytes(),
            LineMarks::Tail => {
                let floats = reading.iter().flat_map(|value| (*value as f32).to_le_bytes());
                floats.chain(*b"\r\n").collect()
            }
            LineMarks::HeadAndSum => {
                let sum = words().iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte));
                [&[0xAA, 0x55], &words()[..], &[sum]].concat()
            }
            LineMarks::HeadAndCrc => {
                let crc = words().iter().fold(0xFFFFu16, |crc, byte| {
                    (0..8)
                        .fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xA001 } else { crc >> 1 })
                });
                [&[0xAA, 0x55], &words()[..], &crc.to_le_bytes()].concat()
            }
        }
    }
}

impl LineMarks {
    fn profile(self, channels: usize) -> LineProfile {
        let framing = match self {
            LineMarks::Text => format!("[text]\ncolumns = {channels}\n"),
            LineMarks::MarkedText => format!("[text]\nbefore = \"S,\"\nafter = \",E\"\ncolumns = {channels}\n"),
            LineMarks::Tail => format!("[frame]\nnumbers = [\"{channels} f32\"]\ntail = \"0D 0A\"\n"),
            LineMarks::HeadAndSum => {
                format!("[frame]\nhead = \"AA 55\"\nnumbers = [\"{channels} u16\"]\nchecksum = \"sum8\"\n")
            }
            LineMarks::HeadAndCrc => {
                format!("[frame]\nhead = \"AA 55\"\nnumbers = [\"{channels} u16\"]\nchecksum = \"crc16-modbus\"\n")
            }
        };
        let text = format!("name = \"skin\"\n{framing}[outputs]\ncolumns = \"1-{channels}\"\npossible = [0, 1023]\n");
        LineProfile::parse("skin.toml", &text).expect("a profile")
    }
}

/// The readings received in some seconds, and those sent.
struct LineOutcome {
    received: Vec<Received>,
    sent: Vec<Sent>,
    origin: Instant,
}

/// Receives every reading of a board for `seconds`.
fn received(skin: LineSkin, damage: f64, faults: &[LineFault], seconds: f64) -> LineOutcome {
    let (marks, channels) = (skin.marks, skin.channels);
    let spec = rig::parse("sim", &shipped_text("rigs/sim.toml"), &|_| unreachable!()).expect("a rig");
    let scene = spec.emulators(1).expect("emulators").scene;
    let damage = Damage { fraction: damage, kinds: DamageKind::ALL.to_vec(), seed: 3 };
    let board = faults.iter().fold(SerialBoard::new(skin).damaged(damage), |board, fault| board.with_fault(*fault));
    let board = Arc::new(Mutex::new(board));
    run_virtually(async {
        let origin = Instant::now();
        let served = board.clone();
        let dial = move || {
            let (near, far) = duplex(4096);
            drop(palpate_link::time::spawn(serve(far, served.clone(), scene.clone(), origin)));
            near
        };
        let port = LinePort::new(Connector::in_memory(dial), marks.profile(channels));
        let (mut received, mut sent): (Vec<Received>, Vec<Sent>) = (Vec::new(), Vec::new());
        while origin.elapsed().as_secs_f64() < seconds {
            let nth = received.last().map_or(0, |last: &Received| last.nth + 1);
            if let Ok(one) = port.newer_than(nth, Instant::now() + Duration::from_secs(3)).await {
                received.push(one);
            }
            // the board remembers its last lines only
            let known_s = sent.last().map_or(-1.0, |last| last.last_byte_s);
            sent.extend(board.lock().unwrap().sent().filter(|line| line.last_byte_s > known_s).cloned());
        }
        LineOutcome { received, sent, origin }
    })
}

impl LineOutcome {
    /// Received readings that were never sent.
    fn wrong(&self) -> usize {
        let was_sent = |one: &&Received| !self.sent.iter().any(|line| line.reading == one.numbers);
        self.received.iter().filter(was_sent).count()
    }

    /// Largest difference between a reading's time and the departure of its last byte, s. The numbers repeat after 1024 lines.
    fn off_s(&self) -> f64 {
        let off = |one: &Received| {
            let at_s = (one.at - self.origin).as_secs_f64();
            let lines = self.sent.iter().filter(|line| line.reading == one.numbers);
            lines.map(|line| (at_s - line.last_byte_s).abs()).reduce(f64::min)
        };
        self.received.iter().filter_map(off).fold(0.0, f64::max)
    }

    /// The longest time without a reading, s.
    fn gap_s(&self) -> f64 {
        let gaps = self.received.windows(2).map(|pair| (pair[1].at - pair[0].at).as_secs_f64());
        gaps.fold(0.0, f64::max)
    }
}

#[test]
fn age_of_readings_is_right_with_damage_a_stall_and_a_reset() {
    let stall = LineFault { kind: LineFaultKind::Stops, at_s: 6.0, for_s: 0.3 };
    let reset = LineFault { kind: LineFaultKind::Resets, at_s: 8.0, for_s: 1.7 };
    let uno = LineSkin { marks: LineMarks::Text, channels: 15, hz: 100.0, port: Port::uno(115_200.0), nth: 0 };
    let fast =
        LineSkin { marks: LineMarks::HeadAndCrc, channels: 64, hz: 1000.0, port: Port::native_usb(0.03), nth: 0 };
    for (name, skin, per_s) in
        [("15 channels, 100 Hz, 115200 baud", uno, 90.0), ("64 channels, 1 kHz, USB", fast, 900.0)]
    {
        let outcome = received(skin, 0.03, &[stall, reset], 12.0);
        let (wrong, off_s, gap_s) = (outcome.wrong(), outcome.off_s(), outcome.gap_s());
        println!(
            "{name}: {} readings, {wrong} wrong, ages off by {off_s:.4} s at most, a gap of {gap_s:.2} s",
            outcome.received.len()
        );
        assert!(off_s < 0.002, "{name}: {off_s}");
        assert!((1.6..1.9).contains(&gap_s), "{name}: {gap_s}");
        assert!(outcome.received.len() as f64 > per_s * 8.0, "{name}: {}", outcome.received.len());
    }
}

#[test]
fn number_of_accepted_damaged_readings_depends_on_the_marks() {
    // accepted lines of 20,000, with 3 % damaged
    for (marks, most) in [
        (LineMarks::Text, 200),
        (LineMarks::MarkedText, 200),
        (LineMarks::Tail, 200),
        (LineMarks::HeadAndSum, 10),
        (LineMarks::HeadAndCrc, 0),
    ] {
        let skin = LineSkin { marks, channels: 15, hz: 1000.0, port: Port::native_usb(0.0), nth: 0 };
        let outcome = received(skin, 0.03, &[], 20.0);
        let damaged = outcome.sent.iter().filter(|line| !line.whole).count();
        println!(
            "{marks:?}: {} lines, {damaged} damaged, {} received, {} of them wrong",
            outcome.sent.len(),
            outcome.received.len(),
            outcome.wrong()
        );
        assert!(outcome.wrong() <= most, "{marks:?}: {} wrong", outcome.wrong());
        assert!(outcome.received.len() > outcome.sent.len() * 9 / 10, "{marks:?}");
    }
}

#[test]
fn calibration_with_home_by_hand_a_z_sg_and_a_matrix_of_16_is_complete() {
    let bench = TestFolder::new();
    bench.palpate_ends(0, "run calibrate --rig matrix --simulate --out run");
    let forces = bench.column("run/presses.csv", "force_n");
    assert_eq!(forces.len(), 625);
    let flags = bench.column("run/presses.csv", "flags");
    let flagged = flags.iter().filter(|flags| !flags.is_empty()).count();
    println!("{flagged} of {} presses flagged", flags.len());
    assert!(flagged <= 6, "{flagged}");
}
