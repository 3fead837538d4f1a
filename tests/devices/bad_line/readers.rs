//! Load cells and arrays: their readings are compared with the forces that are possible.

use super::{BadLineOutcome, BadLineSubject, rig};
use palpate_core::parallel::lock;
use palpate_core::quantity::{Axis, RandomStream, stream};
use palpate_drivers::daqmx::{Acquisition, DaqmxArray, DaqmxLoadCell, Inputs, Sensitivity, Terminal};
use palpate_drivers::modbus::{ModbusArray, ModbusLoadCell, Profile, Transport};
use palpate_drivers::process::{ProcessArray, ProcessLoadCell};
use palpate_drivers::xps::XpsAnalog;
use palpate_drivers::{AnyArray, AnyLoadCell};
use palpate_link::device::{DeviceError, LoadCell, SensorArray};
use palpate_link::time::{Instant, sleep, timeout};
use palpate_link::wire::Connector;
use palpate_link::wire::daqmx::{Functions, NiDaqmx, TaskHandle};
use palpate_sim::emulator::{DaqmxEmulator, Shared};
use palpate_sim::scene::{Scene, Trajectory};
use palpate_testing::bad_line::{BAD_SHARE, BadLineFate, Framing, connector, passes};
use rand::RngExt;
use std::sync::{Arc, Mutex};
use std::time::Duration;

pub(super) const STIFFNESS_N_MM: f64 = 2.0;

/// Largest error of a true reading, N: the device's rounding.
const TOLERANCE_N: f64 = 0.0025;

/// Largest age of the newest conversion, s.
const CONVERSION_S: f64 = 0.012;

/// Longest `prepare` and `read`, s: a few exchanges, each tried a few times.
const CALL_S: f64 = 15.0;

/// Largest number of messages of a call.
const MESSAGES_MOST: usize = 64;

const READS: u64 = 25;
const UNITS: usize = 9;
/// Longest wait for a program's first answer.
const START: Duration = Duration::from_secs(10);

enum Reader {
    Cell(AnyLoadCell),
    Array(AnyArray),
}

impl Reader {
    async fn prepare(&mut self) -> Result<(), DeviceError> {
        match self {
            Reader::Cell(cell) => cell.prepare().await.map(|_| ()),
            Reader::Array(array) => array.prepare().await.map(|_| ()),
        }
    }

    /// A reading in units of the reading for 1 N; none if it reports that it isn't valid.
    async fn read(&mut self) -> Result<Option<Vec<f64>>, DeviceError> {
        match self {
            Reader::Cell(cell) => {
                let reading = cell.read().await?;
                Ok((!reading.health.saturated && !reading.health.fault).then(|| vec![reading.force_n]))
            }
            Reader::Array(array) => {
                let mut outputs = vec![0.0; UNITS];
                array.read(&mut outputs).await.map(|()| Some(outputs))
            }
        }
    }
}

pub(super) async fn run(subject: BadLineSubject, seed: u64, bad: bool) -> BadLineOutcome {
    let origin = Instant::now();
    let (load_cell, array) = match subject {
        BadLineSubject::CellRtu => (r#"{ modbus = "generic-rs485" }"#, r#"{ modbus = "labjack-t7" }"#),
        BadLineSubject::CellLaumas => (r#"{ modbus = "laumas-tlb" }"#, r#"{ modbus = "labjack-t7" }"#),
        BadLineSubject::CellXps => (r#"{ xps = "GPIO2.ADC1", newton_per_volt = 1.0 }"#, r#"{ modbus = "labjack-t7" }"#),
        BadLineSubject::CellProcess | BadLineSubject::ArrayProcess => {
            (r#"{ process = ["x"] }"#, r#"{ process = ["x"] }"#)
        }
        _ => (r#"{ modbus = "labjack-t7" }"#, r#"{ modbus = "labjack-t7" }"#),
    };
    let stage = if subject == BadLineSubject::CellXps { r#"{ xps = "XYZ" }"# } else { r#""esp301""# };
    let spec = rig(stage, load_cell, array);
    let simulated = spec.emulators(seed).expect("emulators");
    let scene = simulated.scene.clone();
    let fate = BadLineFate::new(seed, scene.clone(), origin);
    let mut rng = stream(seed, 1, "bad line");
    let (press, pattern) = begin_to_press(&scene, &mut rng);
    let framing = match subject {
        BadLineSubject::CellRtu | BadLineSubject::CellLaumas => Framing::Rtu,
        BadLineSubject::CellXps => Framing::Xps,
        BadLineSubject::CellProcess | BadLineSubject::ArrayProcess => Framing::Process,
        _ => Framing::Tcp,
    };
    let array = matches!(subject, BadLineSubject::ArrayTcp | BadLineSubject::ArrayProcess);
    let device = if array { &simulated.array } else { &simulated.load_cell };
    let device = device.instrument().expect("it has a link").clone();
    let link = connector(framing, device, scene.clone(), origin, fate.clone());
    let mut reader = match subject {
        BadLineSubject::CellDaqmx | BadLineSubject::ArrayDaqmx => {
            let emulator = DaqmxEmulator::new(scene.clone(), origin, "Dev1", Some(0), 1, 1.0);
            let rng = Mutex::new(stream(seed, 2, "bad line"));
            let (fate, last) = (fate.clone(), Mutex::default());
            daqmx(subject, BadTable { table: emulator, fate, rng, last }, origin)
        }
        _ => reader(subject, link, origin),
    };

    let mut outcome = BadLineOutcome::default();
    let clean = rng.random_bool(0.7);
    lock(&fate).bad = bad && !clean;
    let prepared = call("prepare", &mut outcome, &fate, reader.prepare()).await;
    assert!(prepared.is_ok() || !clean && bad, "{:?}", prepared.err().map(|error| error.to_string()));
    if prepared.is_err() {
        outcome.errors += 1;
        return outcome;
    }
    lock(&fate).bad = bad;
    if bad && rng.random_bool(0.2) {
        lock(&fate).close_in = Some(rng.random_range(1..40));
    }
    for _ in 0..READS {
        sleep(Duration::from_secs_f64(rng.random_range(0.0..0.2))).await;
        let from_s = lock(&fate).now_s();
        let read = call("read", &mut outcome, &fate, reader.read()).await;
        let to_s = lock(&fate).now_s();
        let Ok(values) = read else {
            outcome.errors += 1;
            assert!(bad, "an error on a good line: {:?}", read.err().map(|error| error.to_string()));
            continue;
        };
        let Some(values) = values else {
            assert!(bad, "out of range on a good line");
            continue;
        };
        let scale = |at: usize| if values.len() == 1 { 1.0 } else { pattern[at] };
        let window = (from_s - CONVERSION_S, to_s);
        let is_true = |(at, value): (usize, &f64)| could_read(&press, window, *value, scale(at));
        if values.iter().enumerate().all(is_true) {
            outcome.values += 1;
            continue;
        }
        let finite = values.iter().all(|value| value.is_finite());
        let (altered, stray) = lock(&fate).happened(from_s, to_s);
        let output = || format!("read {values:?} between {from_s} and {to_s} s, altered {altered}, stray {stray}");
        outcome.judge(subject, altered && finite, stray && finite, output);
    }
    outcome
}

/// Moves z up and down across the surface for ever; the output of each unit for 1 N.
fn begin_to_press(scene: &Shared<Scene>, rng: &mut RandomStream) -> (Trajectory, Vec<f64>) {
    let mut scene = lock(scene);
    for axis in [Axis::X, Axis::Y] {
        let from_mm = scene.motion(axis).end_mm();
        scene.set_motion(axis, Trajectory::to(0.0, (from_mm, 0.0), 0.3, 100.0, 1e4), 0.0);
    }
    let from_mm = scene.motion(Axis::Z).end_mm();
    let mut way = Trajectory::to(0.0, (from_mm, 0.0), 0.1, 100.0, 1e4);
    for n in 0..80 {
        let target_mm = if n % 2 == 0 { rng.random_range(-0.5..-0.1) } else { rng.random_range(-0.05..0.1) };
        let leg = Trajectory::to(way.end_s(), (way.end_mm(), 0.0), target_mm, rng.random_range(0.05..0.4), 100.0);
        way = way.then(&leg);
    }
    scene.set_motion(Axis::Z, way.clone(), 0.0);
    let mut later = scene.clone();
    let mut outputs = vec![0.0; UNITS];
    let mut at_s = 1.0;
    while later.true_force_n(at_s) < 0.2 {
        at_s += 0.05;
    }
    later.outputs(at_s, &mut outputs);
    let force_n = later.true_force_n(at_s);
    (way, outputs.iter().map(|output| output / force_n).collect())
}

/// Whether a unit with the output `scale` for 1 N can have had this output in a period of time.
fn could_read(press: &Trajectory, window: (f64, f64), value: f64, scale: f64) -> bool {
    let force_n = value / scale;
    let (tolerance_mm, at_mm) = (TOLERANCE_N / STIFFNESS_N_MM / scale.abs().min(1.0), -force_n / STIFFNESS_N_MM);
    let without_load = |at_s: f64| press.position_mm(at_s) > 0.0;
    let touches = passes(press, window, at_mm, tolerance_mm) && at_mm <= tolerance_mm;
    touches
        || force_n.abs() <= TOLERANCE_N
            && (without_load(window.0) || without_load(window.1) || passes(press, window, 0.0, 0.0))
}

async fn call<T>(
    name: &'static str,
    outcome: &mut BadLineOutcome,
    fate: &Shared<BadLineFate>,
    done: impl Future<Output = T>,
) -> T {
    let (began, sent) = (Instant::now(), lock(fate).sent);
    let came = timeout(Duration::from_secs_f64(CALL_S), done).await;
    let (took_s, messages) = (began.elapsed().as_secs_f64(), lock(fate).sent - sent);
    outcome.took(name, took_s, messages);
    assert!(messages <= MESSAGES_MOST, "{name} took {messages} messages");
    came.unwrap_or_else(|_| panic!("{name} hangs"))
}

fn reader(subject: BadLineSubject, link: Connector, origin: Instant) -> Reader {
    let hz = 200.0;
    let name = || "bad".to_owned();
    let profile = |name| Profile::shipped(name).expect("it is shipped");
    match subject {
        BadLineSubject::CellRtu => Reader::Cell(cell(link, Transport::Rtu, profile("generic-rs485"), hz, origin)),
        BadLineSubject::CellLaumas => Reader::Cell(cell(link, Transport::Rtu, profile("laumas-tlb"), hz, origin)),
        BadLineSubject::CellTcp => Reader::Cell(cell(link, Transport::Tcp, profile("labjack-t7"), hz, origin)),
        BadLineSubject::CellXps => {
            Reader::Cell(AnyLoadCell::Xps(XpsAnalog::new(link, name(), "GPIO2.ADC1", 1.0, hz, origin)))
        }
        BadLineSubject::CellProcess => {
            Reader::Cell(AnyLoadCell::Process(ProcessLoadCell::new(link, name(), START, hz, origin)))
        }
        BadLineSubject::ArrayTcp => {
            let array = ModbusArray::new(link, Transport::Tcp, profile("labjack-t7"), "bad", UNITS);
            Reader::Array(AnyArray::Modbus(array.expect("it has outputs")))
        }
        BadLineSubject::ArrayProcess => Reader::Array(AnyArray::Process(ProcessArray::new(link, name(), START, UNITS))),
        _ => unreachable!("{subject:?} has no link"),
    }
}

fn cell(link: Connector, transport: Transport, profile: Profile, hz: f64, origin: Instant) -> AnyLoadCell {
    AnyLoadCell::Modbus(ModbusLoadCell::new(link, transport, profile, "bad", hz, origin).expect("it has a force"))
}

fn daqmx(subject: BadLineSubject, table: BadTable, origin: Instant) -> Reader {
    let inputs =
        |physical: &str, count| Inputs { physical: physical.into(), count, terminal: Terminal::Rse, range_v: 10.0 };
    let both = vec![inputs("Dev1/ai0", 1), inputs("Dev1/ai1:9", UNITS)];
    let acquisition = Acquisition::new(Functions::Here(Arc::new(table)), both, 200.0, "bad".into());
    let acquisition = Arc::new(tokio::sync::Mutex::new(acquisition));
    let identity = palpate_link::device::Identity {
        role: "load_cell".into(),
        identity: "bad".into(),
        link: "bad".into(),
        warnings: Vec::new(),
    };
    match subject {
        BadLineSubject::CellDaqmx => Reader::Cell(AnyLoadCell::Daqmx(DaqmxLoadCell::new(
            acquisition,
            0,
            Sensitivity::OneAxis(1.0),
            10.0,
            200.0,
            origin,
            identity,
        ))),
        _ => Reader::Array(AnyArray::Daqmx(DaqmxArray::new(acquisition, 1, UNITS, identity))),
    }
}

/// NI's functions. Some reads fail, repeat the last values, or return garbled ones.
struct BadTable {
    table: DaqmxEmulator,
    fate: Shared<BadLineFate>,
    rng: Mutex<RandomStream>,
    /// The last values.
    last: Mutex<Vec<f64>>,
}

/// Errors at the end of a read: not there in time, overrun, gone.
const ERRORS: [i32; 3] = [-200_284, -200_279, -201_003];

impl BadTable {
    fn garble(&self, buffer: &mut [f64], read: &mut i32) -> i32 {
        let (mut rng, mut fate) = (lock(&self.rng), lock(&self.fate));
        let now_s = fate.now_s();
        let channels = 1 + UNITS;
        let count = usize::try_from(*read).unwrap_or(0) * channels;
        match rng.random_range(0..6) {
            0 => return ERRORS[rng.random_range(0..ERRORS.len())],
            1 => *read = 0,
            2 => {
                // the last values again
                let last = lock(&self.last);
                let length = last.len().min(buffer.len());
                buffer[..length].copy_from_slice(&last[..length]);
                *read = (length / channels) as i32;
                fate.stray_s.push(now_s);
            }
            3 => *read = [i32::MAX, -1, i32::MIN][rng.random_range(0..3)],
            4 if count > 0 => {
                let no_voltage = [f64::NAN, f64::INFINITY, 1e9, -11.0];
                buffer[count - channels + rng.random_range(0..channels)] = no_voltage[rng.random_range(0..4)];
                // only impossible numbers can be recognised
            }
            _ if count > 0 => {
                let at = count - channels + rng.random_range(0..channels);
                buffer[at] = f64::from_bits(buffer[at].to_bits() ^ 1 << rng.random_range(0..64));
                fate.altered_s.push(now_s);
            }
            _ => {}
        }
        if *read > 0 && *read < i32::MAX {
            *lock(&self.last) = buffer[..usize::try_from(*read).unwrap_or(0) * channels].to_vec();
        }
        0
    }
}

impl NiDaqmx for BadTable {
    fn create_task(&self, name: &str, task: &mut TaskHandle) -> i32 {
        self.table.create_task(name, task)
    }
    fn create_ai_voltage_channel(&self, task: TaskHandle, physical: &str, terminal: i32, range_v: [f64; 2]) -> i32 {
        self.table.create_ai_voltage_channel(task, physical, terminal, range_v)
    }
    fn configure_sample_clock(&self, task: TaskHandle, rate_hz: f64, samples_per_channel: u64) -> i32 {
        self.table.configure_sample_clock(task, rate_hz, samples_per_channel)
    }
    fn start_task(&self, task: TaskHandle) -> i32 {
        self.table.start_task(task)
    }
    fn stop_task(&self, task: TaskHandle) -> i32 {
        self.table.stop_task(task)
    }
    fn clear_task(&self, task: TaskHandle) -> i32 {
        self.table.clear_task(task)
    }
    fn read_analog_f64(&self, task: TaskHandle, samples_per_channel: i32, buffer: &mut [f64], read: &mut i32) -> i32 {
        let status = self.table.read_analog_f64(task, samples_per_channel, buffer, read);
        let struck = {
            let mut fate = lock(&self.fate);
            fate.sent += 1;
            fate.bad && lock(&self.rng).random_bool(BAD_SHARE)
        };
        if struck { self.garble(buffer, read) } else { status }
    }
    fn extended_error_info(&self) -> String {
        self.table.extended_error_info()
    }
    fn error_string(&self, code: i32) -> String {
        self.table.error_string(code)
    }
}
