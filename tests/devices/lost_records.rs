//! An hour of a Net F/T at 1 kHz over a network that loses, doubles, overtakes and holds back datagrams: every lost record is reported,
//! and none counts twice.

use palpate_core::parallel::lock;
use palpate_core::quantity::{RandomStream, stream};
use palpate_drivers::lines::{LineLoadCell, LinePort, LineProfile, PortCounts};
use palpate_link::device::LoadCell;
use palpate_link::time::{Instant, run_virtually, spawn};
use palpate_link::wire::Connector;
use palpate_run::rig::{RigSpec, parse};
use palpate_sim::emulator::serve;
use palpate_testing::campaign;
use palpate_testing::executions::rig_with_three_axes;
use rand::RngExt;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};

/// Virtual time in the quick and in the full tier, s.
const SECONDS: (usize, usize) = (30, 3600);

const RATE_HZ: usize = 1000;

/// Number of bytes of a record. The stream holds no more, so each read takes one record, as from a socket.
const RECORD_BYTES: usize = 36;

/// Longest wait for a reading of the driver.
const PATIENCE: Duration = Duration::from_millis(500);

/// Largest number of records by which one is late.
const LATE_MOST: u32 = 8;

/// Largest number of records in a silence.
const SILENT_MOST: u32 = 300;

type Record = [u8; RECORD_BYTES];

/// The network, and what it has done so far.
struct Network {
    rng: RandomStream,
    client: DuplexStream,
    /// Records that are late: each with the record behind which it arrives, and whether it arrives again.
    late: Vec<(u32, Record, bool)>,
    /// Records that are held back until this one.
    held: (u32, Vec<Record>),
    /// The last record of a silence that loses all.
    lost_until: u32,
    tally: Arc<Mutex<Tally>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Tally {
    /// Newest record that has arrived.
    newest: u32,
    dropped: u64,
    /// Records that arrived behind a newer one.
    overtaken: u64,
    /// Records that arrived again.
    again: u64,
    silences: u64,
}

#[test]
fn every_lost_record_is_reported_and_none_counts_twice() {
    let count = (campaign::size(SECONDS.0, SECONDS.1) * RATE_HZ) as u32;
    let began = std::time::Instant::now();
    let spec = parse("rig.toml", &rig_with_three_axes(), &|_| unreachable!()).expect("a rig");
    let tally = Arc::new(Mutex::new(Tally::default()));
    let (counts, warnings) = run_virtually(carried(spec, count, tally.clone()));
    let tally = *lock(&tally);
    println!("{count} records, {tally:?}, {counts:?}, {:.1} s", began.elapsed().as_secs_f64());
    assert_eq!(counts.lost, tally.dropped + tally.overtaken, "each, once");
    assert_eq!(counts.good + counts.lost, u64::from(count), "every record is one or the other");
    assert_eq!((counts.rejected, tally.newest), (0, count));
    assert!(tally.dropped > 0 && tally.overtaken > 0 && tally.again > 0 && tally.silences > 0, "{tally:?}");
    assert_eq!(warnings, [format!("{} of {count} readings were lost on their way", counts.lost)]);
}

/// Reads to the last record. Returns what the driver counted, and the warnings of its identity.
async fn carried(spec: RigSpec, count: u32, tally: Arc<Mutex<Tally>>) -> (PortCounts, Vec<String>) {
    let origin = Instant::now();
    let simulated = spec.emulators(1).expect("emulators");
    let (scene, device) = (simulated.scene.clone(), simulated.load_cell.instrument().expect("it has a link").clone());
    let dial = move || {
        let ((near, client), (behind, far)) = (duplex(RECORD_BYTES), duplex(RECORD_BYTES));
        let (rng, tally) = (stream(1, 0, "lost records"), tally.clone());
        let network = Network { rng, client, late: Vec::new(), held: (0, Vec::new()), lost_until: 0, tally };
        drop(spawn(serve(far, device.clone(), scene.clone(), origin)));
        drop(spawn(network.carry(behind, count)));
        near
    };
    let port = LinePort::new(Connector::in_memory(dial), LineProfile::shipped("ati-netft").expect("a profile"));
    let force = port.profile().force.clone().expect("a force");
    let mut cell = LineLoadCell::new(port.clone(), force, "network".into(), RATE_HZ as f64, origin);
    assert_eq!(cell.prepare().await.expect("a cell").warnings, [""; 0]);
    let (mut nth, mut newest) = (1, 1.0);
    while newest < f64::from(count) {
        let received = port.newer_than(nth + 1, Instant::now() + PATIENCE).await.expect("a reading");
        assert!(received.numbers[0] > newest && received.nth > nth, "{received:?} after {newest}");
        (nth, newest) = (received.nth, received.numbers[0]);
    }
    (port.counts(), cell.prepare().await.expect("a cell").warnings)
}

impl Network {
    /// Carries the first `count` records of the stream. The first and the last arrive.
    async fn carry(mut self, mut device: DuplexStream, count: u32) {
        let (mut command, mut record) = ([0; 8], [0; RECORD_BYTES]);
        self.client.read_exact(&mut command).await.expect("a command");
        device.write_all(&command).await.expect("the device takes it");
        loop {
            device.read_exact(&mut record).await.expect("a record");
            let nth = number(&record);
            if nth == 1 || nth == count {
                self.end_silence().await;
                self.release(u32::MAX).await;
                self.deliver(record, false).await;
            } else {
                self.take(nth, record).await;
            }
            if nth == count {
                std::future::pending::<()>().await; // an end would close the link
            }
        }
    }

    async fn take(&mut self, nth: u32, record: Record) {
        if nth <= self.lost_until {
            lock(&self.tally).dropped += 1;
            return;
        }
        if nth < self.held.0 {
            self.held.1.push(record);
            return;
        }
        self.end_silence().await;
        let later = nth + self.rng.random_range(1..=LATE_MOST);
        let silent_until = nth + self.rng.random_range(1..SILENT_MOST);
        match self.rng.random_range(0..5000) {
            fate @ (0 | 1) => {
                self.release(u32::MAX).await;
                let mut tally = lock(&self.tally);
                tally.silences += 1;
                if fate == 0 {
                    tally.dropped += 1;
                    self.lost_until = silent_until;
                } else {
                    self.held = (silent_until, vec![record]);
                }
            }
            2..20 => lock(&self.tally).dropped += 1,
            20..40 => self.late.push((later, record, false)),
            40..60 => {
                self.deliver(record, false).await;
                self.deliver(record, true).await;
            }
            60..80 => {
                self.deliver(record, false).await;
                self.late.push((later, record, true));
            }
            _ => self.deliver(record, false).await,
        }
        self.release(nth).await;
    }

    /// Delivers what was held back.
    async fn end_silence(&mut self) {
        for record in std::mem::take(&mut self.held.1) {
            self.deliver(record, false).await;
        }
    }

    /// Delivers the late records that are due behind the `nth`.
    async fn release(&mut self, nth: u32) {
        for (_, record, again) in self.late.extract_if(.., |(due, ..)| *due <= nth).collect::<Vec<_>>() {
            self.deliver(record, again).await;
        }
    }

    async fn deliver(&mut self, record: Record, again: bool) {
        let nth = number(&record);
        {
            let mut tally = lock(&self.tally);
            tally.again += u64::from(again);
            tally.overtaken += u64::from(!again && nth < tally.newest);
            tally.newest = tally.newest.max(nth);
        }
        self.client.write_all(&record).await.expect("the driver reads");
    }
}

fn number(record: &Record) -> u32 {
    u32::from_be_bytes([record[0], record[1], record[2], record[3]])
}
