//! Faults at the wire of a bench: from a set time on, an instrument answers other values than it measured, or a stage does something else
//! than it was sent. The instruments themselves are sound.

use palpate_core::quantity::{Axis, RandomStream, stream};
use palpate_run::rig::SimulatedRig;
use palpate_sim::emulator::{Instrument, Owed, Shared};
use palpate_sim::scene::{Scene, SceneDevice, Trajectory};
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use std::ops::Range;
use std::sync::{Arc, Mutex};
use tokio::sync::Notify;

/// The first register of the load cell's input, and those of the nine taxels, on a T7.
const CELL_REGISTER: u16 = 26;
const TAXEL_REGISTERS: Range<u16> = 0..18;

/// Bytes before a frame's function, and those before its registers; functions that read registers.
const FUNCTION_AT: usize = 7;
const DATA_AT: usize = 9;
const READS: [u8; 2] = [3, 4];

/// Motion of a slipping stage, mm/s and mm/s^2; and the time of a shifted scene until its servo is there, s.
const DROPS_MM_S: f64 = 5.0;
const DROPS_MM_S2: f64 = 100.0;
const SHIFTS_S: f64 = 0.03;

/// A fault at the wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WireFault {
    /// The load cell follows with a first-order lag, s. Noise of the second value, N, is added after the lag.
    CellSlow(f64, f64),
    /// The load cell reads this multiple of the force.
    CellGain(f64),
    /// The load cell repeats one value, with noise of this size, N.
    CellStuck(f64),
    /// The load cell's zero drifts, N/s.
    CellDrifts(f64),
    /// The load cell reads this much more, N.
    CellOffset(f64),
    /// The array has moved: this distance, mm, in this direction, rad.
    ArrayShifted(f64, f64),
    /// The outputs are multiplied.
    ArrayTimes(f64),
    /// A taxel reads 0.
    TaxelDead(u16),
    /// A taxel repeats its reading.
    TaxelStuck(u16),
    /// The stage goes deeper, mm, and its encoder shows it.
    StageDrops(f64),
    /// The stage goes deeper than sent, mm, and its encoder doesn't show it.
    StageDeeper(f64),
    /// The stage ignores every stop.
    StopIgnored,
}

impl WireFault {
    /// The instrument whose wire it is.
    pub fn device(self) -> SceneDevice {
        use WireFault as Is;
        match self {
            Is::CellSlow(..) | Is::CellGain(_) | Is::CellStuck(_) | Is::CellDrifts(_) | Is::CellOffset(_) => {
                SceneDevice::LoadCell
            }
            Is::ArrayShifted(..) | Is::ArrayTimes(_) | Is::TaxelDead(_) | Is::TaxelStuck(_) => SceneDevice::Array,
            Is::StageDrops(_) | Is::StageDeeper(_) | Is::StopIgnored => SceneDevice::Stage,
        }
    }
}

/// Puts a fault on the wire of a rig, from `from_s` on. `seed` determines its noise.
pub fn put_on_wire(rig: &mut SimulatedRig, fault: WireFault, from_s: f64, seed: u64) {
    let end = match fault.device() {
        SceneDevice::Stage => &mut rig.stage,
        SceneDevice::LoadCell => &mut rig.load_cell,
        SceneDevice::Array => &mut rig.array,
    };
    let device = end.instrument().expect("it has a link").clone();
    let rng = stream(seed, 0, "fault at the wire");
    end.replace(Arc::new(Mutex::new(Faulty { device, fault, from_s, rng, last: None, held: None })));
}

/// An instrument with a fault on its wire.
struct Faulty {
    device: Shared<dyn Instrument>,
    fault: WireFault,
    from_s: f64,
    rng: RandomStream,
    /// Time of the last reading, s, and its value.
    last: Option<(f64, f64)>,
    /// The repeated value; of a stage, whether the fault has begun.
    held: Option<f64>,
}

impl Faulty {
    fn inner(&self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        self.device.lock().expect("a device that lives").answer(request, scene, now_s)
    }

    /// The load cell's answer for a reading, N.
    fn cell_n(&mut self, read_n: f64, now_s: f64) -> f64 {
        let since_s = now_s - self.from_s;
        let (last_s, last_n) = self.last.unwrap_or((now_s, read_n));
        let is_begun = since_s >= 0.0;
        match self.fault {
            WireFault::CellSlow(lag_s, noise_n) => {
                let share = if is_begun { 1.0 - (-(now_s - last_s) / lag_s).exp() } else { 1.0 };
                let passed_n = last_n + share * (read_n - last_n);
                self.last = Some((now_s, passed_n));
                passed_n + if is_begun { self.noise_n(noise_n) } else { 0.0 }
            }
            _ if !is_begun => read_n,
            WireFault::CellGain(gain) => gain * read_n,
            WireFault::CellStuck(noise_n) => *self.held.get_or_insert(read_n) + self.noise_n(noise_n),
            WireFault::CellDrifts(n_s) => read_n + n_s * since_s,
            WireFault::CellOffset(offset_n) => read_n + offset_n,
            _ => read_n,
        }
    }

    /// Normal noise of this standard deviation, N.
    fn noise_n(&mut self, sigma_n: f64) -> f64 {
        let draw: f64 = StandardNormal.sample(&mut self.rng);
        sigma_n * draw
    }

    /// The array's answer for an output of a taxel.
    fn output(&mut self, taxel: u16, output: f64) -> f64 {
        match self.fault {
            WireFault::ArrayTimes(factor) => factor * output,
            WireFault::TaxelDead(dead) if dead == taxel => 0.0,
            WireFault::TaxelStuck(stuck) if stuck == taxel => *self.held.get_or_insert(output),
            _ => output,
        }
    }

    fn answer_of_cell(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut answer = self.inner(request, scene, now_s);
        for (register, bytes) in floats(request, &mut answer) {
            if register == CELL_REGISTER {
                let read_n = f64::from(f32::from_be_bytes(*bytes));
                *bytes = (self.cell_n(read_n, now_s) as f32).to_be_bytes();
            }
        }
        answer
    }

    fn answer_of_array(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        if let WireFault::ArrayShifted(by_mm, direction) = self.fault {
            let mut elsewhere = scene.clone();
            for (axis, share) in [(Axis::X, direction.cos()), (Axis::Y, direction.sin())] {
                let at_mm = elsewhere.axis(axis, now_s).0 + share * by_mm;
                elsewhere.set_motion(axis, Trajectory::at_rest(at_mm), now_s);
            }
            self.inner(request, scene, now_s); // the noise of a reading is used up
            return self.inner(request, &mut elsewhere, now_s + SHIFTS_S);
        }
        let mut answer = self.inner(request, scene, now_s);
        for (register, bytes) in floats(request, &mut answer) {
            if TAXEL_REGISTERS.contains(&register) {
                let output = f64::from(f32::from_be_bytes(*bytes));
                *bytes = (self.output(register / 2, output) as f32).to_be_bytes();
            }
        }
        answer
    }

    fn answer_of_stage(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let text = String::from_utf8_lossy(request).into_owned();
        let parts: Vec<&str> = text.trim_end().split(';').collect();
        let ending = &text[text.trim_end().len()..];
        match self.fault {
            WireFault::StopIgnored => {
                let kept: Vec<&str> = parts.into_iter().filter(|part| !part.ends_with("ST")).collect();
                if kept.is_empty() {
                    return Vec::new();
                }
                self.inner((kept.join(";") + ending).as_bytes(), scene, now_s)
            }
            WireFault::StageDrops(by_mm) => {
                if self.held.is_none() {
                    self.held = Some(by_mm);
                    let motion = scene.motion(Axis::Z);
                    let (state, end_mm) = ((motion.position_mm(now_s), motion.speed_mm_s(now_s)), motion.end_mm());
                    let drop = Trajectory::to(now_s, state, end_mm - by_mm, DROPS_MM_S, DROPS_MM_S2);
                    scene.set_motion(Axis::Z, drop, now_s);
                }
                self.inner(request, scene, now_s)
            }
            WireFault::StageDeeper(by_mm) => {
                let target_mm = |part: &str| part.strip_prefix("3PA").and_then(|mm| mm.parse::<f64>().ok());
                let deeper = |part: &&str| match target_mm(part) {
                    Some(mm) => format!("3PA{:.5}", mm - by_mm),
                    None => (*part).to_owned(),
                };
                if parts.iter().any(|part| target_mm(part).is_some()) {
                    self.held = Some(by_mm);
                }
                let sent = parts.iter().map(deeper).collect::<Vec<_>>().join(";") + ending;
                let answer = self.inner(sent.as_bytes(), scene, now_s);
                if self.held.is_some() { raised_z(&parts, &answer, by_mm) } else { answer }
            }
            _ => self.inner(request, scene, now_s),
        }
    }
}

/// The answers to a line of commands, with z's position higher by a distance.
fn raised_z(parts: &[&str], answer: &[u8], by_mm: f64) -> Vec<u8> {
    let asks = parts.iter().filter(|part| part.ends_with('?') || part.ends_with("TP"));
    let text = String::from_utf8_lossy(answer);
    let line = |(line, asked): (&str, Option<&&str>)| match (asked, line.trim().parse::<f64>()) {
        (Some(&"3TP"), Ok(mm)) => format!("{:.4}\r\n", mm + by_mm),
        _ => format!("{line}\r\n"),
    };
    let asked = asks.map(Some).chain(std::iter::repeat(None));
    text.lines().zip(asked).map(line).collect::<String>().into_bytes()
}

/// The floats in a Modbus TCP answer, each with its first register.
fn floats<'a>(request: &[u8], answer: &'a mut [u8]) -> impl Iterator<Item = (u16, &'a mut [u8; 4])> {
    let reads = |frame: &[u8]| frame.get(FUNCTION_AT).is_some_and(|function| READS.contains(function));
    let first = match request.get(FUNCTION_AT + 1..FUNCTION_AT + 3) {
        Some(&[high, low]) => u16::from_be_bytes([high, low]),
        _ => 0,
    };
    let is_read = reads(request) && reads(answer);
    let data = if is_read { answer.get_mut(DATA_AT..).unwrap_or_default() } else { Default::default() };
    let (values, _) = data.as_chunks_mut::<4>();
    (first..).step_by(2).zip(values)
}

impl Instrument for Faulty {
    fn device(&self) -> SceneDevice {
        self.device.lock().expect("a device that lives").device()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.device.lock().expect("a device that lives").take_request(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        match self.fault.device() {
            SceneDevice::LoadCell => self.answer_of_cell(request, scene, now_s),
            _ if now_s < self.from_s => self.inner(request, scene, now_s),
            SceneDevice::Array => self.answer_of_array(request, scene, now_s),
            SceneDevice::Stage => self.answer_of_stage(request, scene, now_s),
        }
    }

    fn deaf_until_s(&self) -> f64 {
        self.device.lock().expect("a device that lives").deaf_until_s()
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        self.device.lock().expect("a device that lives").bell()
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        self.device.lock().expect("a device that lives").owed(scene, now_s)
    }
}
