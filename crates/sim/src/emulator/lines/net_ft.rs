//! ATI Net F/T: a sensor with six axes that streams RDT records over UDP (manual 9610-05-1022, from memory; the PyPI packages NetFT and
//! pynetft agree about records, commands and the bits of the state).

use super::{BoardFirmware, CellScale, Port, axes};
use crate::scene::{Scene, SceneDevice};

/// Number of bytes of a request: header, command, number of records.
const REQUEST_BYTES: usize = 8;

/// Beginning of every request.
const HEADER: [u8; 2] = [0x12, 0x34];

/// Commands: to stop, to stream, and to set the software bias.
const STOP: u8 = 0;
const START: u8 = 2;
const BIAS: u8 = 0x42;

/// Counts of the usual calibration.
const USUAL: CellScale = CellScale { newton_per_unit: 0.000_001, offset: 0.0 };

/// Rate at which the device converts and counts; it may send fewer records, 1/s.
const INTERNAL_HZ: f64 = 7000.0;

/// State of a transducer beyond its range: that bit, and the bit of any error.
const SATURATED: f64 = (0x8000_0000u32 | 0x0002_0000) as f64;

/// Number of counts of a 32-bit counter.
const COUNTER: f64 = 4_294_967_296.0;

/// A Net F/T that sends to the last client that asked. Each start begins a new stream, whose records are counted from 1. Torques are 0.
pub struct NetFt {
    rate_hz: f64,
    range_n: f64,
    mounting: [[f64; 3]; 3],
    scale: CellScale,
    stream: Option<Stream>,
    /// Forces that the command for the software bias has set to zero, N.
    bias_n: [f64; 3],
}

/// The stream that is being sent.
struct Stream {
    sent: u32,
    /// Records still to be sent; `None` without end.
    left: Option<u32>,
}

impl NetFt {
    /// Creates a device that sends `rate_hz` records per second, of forces up to `range_n` along each axis. `mounting` is the matrix from
    /// the forces of the tip on the specimen along x, y and the press to those along its axes.
    pub fn new(rate_hz: f64, range_n: f64, mounting: [[f64; 3]; 3]) -> Self {
        NetFt { rate_hz, range_n, mounting, scale: USUAL, stream: None, bias_n: [0.0; 3] }
    }

    /// Gives it another calibration.
    #[must_use]
    pub fn scaled(self, scale: CellScale) -> Self {
        NetFt { scale, ..self }
    }
}

impl BoardFirmware for NetFt {
    fn device(&self) -> SceneDevice {
        SceneDevice::LoadCell
    }

    fn port(&self) -> Port {
        Port::datagrams()
    }

    fn start(&mut self) -> Vec<u8> {
        self.stream = None;
        Vec::new()
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        let stream = self.stream.as_ref()?;
        (stream.left != Some(0)).then(|| 1.0 / self.rate_hz)
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let (forces_n, is_beyond) = axes::read(scene, now_s, &self.mounting, self.range_n);
        let counts = forces_n.iter().zip(self.bias_n).map(|(force_n, bias_n)| self.scale.number(force_n - bias_n));
        let sequence = self.stream.as_mut().map_or(0, |stream| {
            stream.sent = stream.sent.wrapping_add(1);
            stream.left = stream.left.map(|left| left.saturating_sub(1));
            stream.sent
        });
        let converted = (now_s * INTERNAL_HZ).floor().rem_euclid(COUNTER);
        let state = if is_beyond { SATURATED } else { 0.0 };
        [f64::from(sequence), converted, state].into_iter().chain(counts.map(f64::round)).chain([0.0; 3]).collect()
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        if self.stream.is_none() {
            return Vec::new(); // it was stopped when this record was due
        }
        let (counters, counts) = reading.split_at(3.min(reading.len()));
        let counters = counters.iter().flat_map(|value| (*value as u32).to_be_bytes());
        counters.chain(counts.iter().flat_map(|value| (*value as i32).to_be_bytes())).collect()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        if inbox.len() >= REQUEST_BYTES && inbox.starts_with(&HEADER) {
            let request: Vec<u8> = inbox.drain(..REQUEST_BYTES).collect();
            if matches!(request[2..4], [0, START | STOP]) {
                self.stream = None; // the next client gets nothing of the stream before its own
            }
            return Some(request);
        }
        inbox.clear(); // a datagram is a whole request or none
        None
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let &[_, _, 0, command, a, b, c, d] = request else { return Vec::new() };
        let records = u32::from_be_bytes([a, b, c, d]);
        match command {
            START => self.stream = Some(Stream { sent: 0, left: (records > 0).then_some(records) }),
            BIAS => (self.bias_n, _) = axes::read(scene, now_s, &self.mounting, self.range_n),
            _ => {}
        }
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::Instrument;
    use crate::emulator::lines::tests::{listen, opened};
    use crate::emulator::lines::{STRAIGHT, SerialBoard};
    use crate::emulator::tests::{pressed, scene};

    const STREAM: [u8; 8] = [0x12, 0x34, 0, 2, 0, 0, 0, 0];
    const END: [u8; 8] = [0x12, 0x34, 0, 0, 0, 0, 0, 0];

    /// The datagrams of a second after a request, as RDT sequence, state and forces in counts.
    fn second_after(
        device: &mut SerialBoard<NetFt>,
        scene: &mut Scene,
        request: &[u8],
        from_s: f64,
    ) -> Vec<(u32, u32, [i32; 3])> {
        let mut inbox = request.to_vec();
        while let Some(request) = device.take_request(&mut inbox) {
            assert!(device.answer(&request, scene, from_s).is_empty());
        }
        let word = |bytes: &[u8], at: usize| u32::from_be_bytes(bytes[4 * at..][..4].try_into().unwrap());
        let record = |bytes: Vec<u8>| {
            assert_eq!(bytes.len(), 36, "one record in each datagram");
            (word(&bytes, 0), word(&bytes, 2), [3, 4, 5].map(|at| word(&bytes, at) as i32))
        };
        listen(device, scene, from_s, from_s + 1.0).into_iter().map(|(_, bytes)| record(bytes)).collect()
    }

    fn device(mounting: [[f64; 3]; 3]) -> SerialBoard<NetFt> {
        opened(SerialBoard::new(NetFt::new(100.0, 2.0, mounting)))
    }

    #[test]
    fn a_record_has_36_bytes_high_byte_first() {
        let mut device = NetFt::new(100.0, 2.0, STRAIGHT);
        device.answer(&STREAM, &mut scene(), 0.0);
        let bytes = device.line(&[7.0, 4200.0, 0.0, 500_000.0, -250_000.0, -1_500_000.0, 0.0, 0.0, 1.0]);
        let golden = "00000007 00001068 00000000 0007a120 fffc2f70 ffe91ca0 00000000 00000000 00000001";
        let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, golden.replace(' ', ""));
    }

    #[test]
    fn it_streams_from_a_start_to_a_stop_and_each_start_counts_from_1() {
        let (mut device, mut scene) = (device(STRAIGHT), scene());
        assert_eq!(second_after(&mut device, &mut scene, &[], 0.0), []);
        for from_s in [1.0, 2.0] {
            let sequences: Vec<u32> =
                second_after(&mut device, &mut scene, &STREAM, from_s).iter().map(|record| record.0).collect();
            assert!(sequences.len() >= 99 && sequences.iter().copied().eq(1..=sequences.len() as u32), "{sequences:?}");
        }
        assert_eq!(second_after(&mut device, &mut scene, &END, 3.0), []);
        assert_eq!(second_after(&mut device, &mut scene, &[0x12, 0x34, 0, 2, 0, 0, 0, 5], 4.0).len(), 5);
        for garbage in [&[0x12, 0x35, 0, 2, 0, 0, 0, 0][..], &STREAM[..7]] {
            assert_eq!(second_after(&mut device, &mut scene, garbage, 5.0), []);
        }
    }

    #[test]
    fn a_press_is_along_the_axis_of_the_mounting_and_one_beyond_the_range_is_reported() {
        let mut device = device([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let (_, state, counts) = *second_after(&mut device, &mut pressed(1.5), &STREAM, 0.0).last().unwrap();
        assert_eq!((state, counts), (0, [-1_500_000, 0, 0]));
        let (_, state, counts) = *second_after(&mut device, &mut pressed(2.5), &STREAM, 1.0).last().unwrap();
        assert_eq!((state, counts), (0x8002_0000, [-2_000_000, 0, 0]));
        let bias = [0x12, 0x34, 0, 0x42, 0, 0, 0, 0];
        let (_, _, counts) =
            *second_after(&mut device, &mut pressed(1.0), &[&bias[..], &STREAM].concat(), 2.0).last().unwrap();
        assert_eq!(counts, [0; 3]);
    }
}
