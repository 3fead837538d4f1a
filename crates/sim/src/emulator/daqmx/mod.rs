//! NI's DAQmx library with one USB-6343, limited to the functions that a rig uses. It is the table of functions over a scene,
//! with no bytes in between. It is based on NIDAQmx.h and on the device's capabilities as public drivers list them.

mod channels;
mod errors;
#[cfg(test)]
mod tests;

use super::Shared;
use crate::scene::{Scene, SceneDevice};
use channels::{INPUTS, TaskChannel};
use errors::DaqmxStatus;
use palpate_core::parallel::lock;
use palpate_link::time::Instant;
use palpate_link::wire::daqmx::{AUTO, NiDaqmx, TaskHandle};
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, MutexGuard};

/// Largest number of scans times channels per second. There is one converter.
const RATE_MOST_HZ: f64 = 500_000.0;
/// Time from a scan until it can be read, s, because of the USB transfer.
const TRANSFER_S: f64 = 0.001;
/// Volts for each reading unit of a taxel. 1 N directly above a taxel gives one reading unit.
const VOLTS_PER_UNIT: f64 = 1.0;
/// Largest number of simultaneous tasks.
const TASKS_MOST: usize = 64;
/// Largest number of channels of one task, which may contain an input more than once.
const CHANNELS_MOST: usize = 4095;
/// Largest number of samples in a task's buffer, all channels together.
const BUFFER_MOST: u64 = 1 << 24;
/// Shift in scans that prevents a time computed as k / rate from being rounded down to scan k - 1.
const ROUNDING: f64 = 1e-6;

/// A USB-6343 and the library that drives it. It has 32 analog inputs relative to ground or 16 differential ones, 16 bit in
/// ranges of 10, 5, 1 and 0.2 V, 500,000 conversions per second. One input has a load cell's amplifier, or several have the bridges of a
/// cell with three axes. The taxels are on the
/// inputs from `array_first_channel` on, 1 V for one reading unit. The other inputs read 0 V.
///
/// A scene can't be asked about the past. So only the newest scan has the scene's state at the time of the read, which is up to 1
/// ms plus a period after the scan was due. The scans since the last read (or the start) are on a straight line to the newest
/// scan. The noise of the load cell is the noise of the scans that are looked at.
///
/// This emulator is stricter than NI's library where a rig needs less. A task must have a sample clock and be started before it
/// is read, and its buffer has the requested size. The last error is common to all threads.
pub struct DaqmxEmulator {
    scene: Shared<Scene>,
    origin: Instant,
    device: String,
    wiring: InputWiring,
    library: Mutex<Library>,
}

/// Wiring of the inputs.
struct InputWiring {
    cell_inputs: Vec<u32>,
    cell: EmulatedCell,
    array_first_channel: u32,
}

/// Volts per newton of a load cell.
enum EmulatedCell {
    OneAxis(f64),
    /// Of each input, for the forces of the tip on the specimen along x, y and the press.
    Axes(Vec<[f64; 3]>),
}

/// State of the library.
#[derive(Default)]
struct Library {
    tasks: BTreeMap<TaskHandle, EmulatedTask>,
    last_task: TaskHandle,
    last_error: String,
}

/// Acquisition task.
struct EmulatedTask {
    name: String,
    channels: Vec<TaskChannel>,
    /// Scans per second, and number of scans that the buffer holds.
    clock: Option<(f64, u64)>,
    run: Option<StartedTask>,
}

/// Task that was started.
struct StartedTask {
    start_s: f64,
    /// Number of scans so far.
    count: u64,
    /// Number of the last scan that was looked at, and its channel values, V.
    looked: (u64, Vec<f64>),
    /// Samples that have come and haven't been read, scan by scan.
    unread: VecDeque<f64>,
    overrun: bool,
}

impl DaqmxEmulator {
    /// Creates an idle device of that name. `cell_channel` is the input with the load cell's amplifier, and its gain in volts per
    /// newton; `None`: no load cell. Time zero of the scene is `origin`.
    pub fn new(
        scene: Shared<Scene>,
        origin: Instant,
        device: &str,
        cell_channel: Option<u32>,
        array_first_channel: u32,
        volts_per_newton: f64,
    ) -> Self {
        let (cell_inputs, cell) = (cell_channel.into_iter().collect(), EmulatedCell::OneAxis(volts_per_newton));
        let wiring = InputWiring { cell_inputs, cell, array_first_channel };
        DaqmxEmulator { scene, origin, device: device.into(), wiring, library: Mutex::default() }
    }

    /// Puts a load cell with three axes on the inputs `physical`: volts per newton of each input, for the forces of the tip on the
    /// specimen along x, y and the press.
    #[must_use]
    pub fn with_axes(mut self, physical: &str, volts_per_newton: Vec<[f64; 3]>) -> Self {
        self.wiring.cell_inputs = channels::inputs(physical, &self.device).unwrap_or_default(); // a task refuses a wrong name
        self.wiring.cell = EmulatedCell::Axes(volts_per_newton);
        self
    }

    /// Locks the library. The library is locked before the scene.
    fn library(&self) -> MutexGuard<'_, Library> {
        lock(&self.library)
    }

    /// Acts on a task. An error is stored as the last error.
    fn with_task(&self, task: TaskHandle, act: impl FnOnce(&mut EmulatedTask) -> Result<(), DaqmxStatus>) -> i32 {
        let mut library = self.library();
        let result = match library.tasks.get_mut(&task) {
            Some(acquisition) => act(acquisition),
            None => Err(DaqmxStatus::BAD_TASK),
        };
        library.report(Some(task), result)
    }

    /// Looks at the scene under its lock. Passes the scene and the present time, s, to `look` and returns its result.
    fn look<T>(&self, look: impl FnOnce(&mut Scene, f64) -> T) -> T {
        let mut scene = lock(&self.scene);
        let now_s = (Instant::now() - self.origin).as_secs_f64();
        look(&mut scene, now_s)
    }
}

impl NiDaqmx for DaqmxEmulator {
    fn create_task(&self, name: &str, task: &mut TaskHandle) -> i32 {
        let mut library = self.library();
        let result = library.create(name).map(|created| *task = created);
        library.report(None, result)
    }

    fn create_ai_voltage_channel(&self, task: TaskHandle, physical: &str, terminal: i32, range_v: [f64; 2]) -> i32 {
        self.with_task(task, |acquisition| {
            acquisition.must_stand()?;
            let inputs = channels::inputs(physical, &self.device)?;
            if acquisition.channels.len() + inputs.len() > CHANNELS_MOST {
                return Err(DaqmxStatus::BAD_VALUE);
            }
            let added: Result<Vec<TaskChannel>, DaqmxStatus> =
                inputs.into_iter().map(|input| TaskChannel::new(input, terminal, range_v[0], range_v[1])).collect();
            acquisition.channels.extend(added?);
            Ok(())
        })
    }

    fn configure_sample_clock(&self, task: TaskHandle, rate_hz: f64, samples_per_channel: u64) -> i32 {
        self.with_task(task, |acquisition| {
            acquisition.must_stand()?;
            let sound = rate_hz > 0.0 && rate_hz <= RATE_MOST_HZ && (1..=BUFFER_MOST).contains(&samples_per_channel);
            if !sound {
                return Err(DaqmxStatus::BAD_VALUE);
            }
            acquisition.clock = Some((rate_hz, samples_per_channel));
            Ok(())
        })
    }

    fn start_task(&self, task: TaskHandle) -> i32 {
        let mut library = self.library();
        let another_runs = library.tasks.iter().any(|(other, each)| *other != task && each.run.is_some());
        let result = match library.tasks.get_mut(&task) {
            Some(acquisition) => acquisition.may_start(another_runs).map(|()| {
                acquisition.run = Some(self.look(|scene, now_s| {
                    let volts = self.wiring.volts(&acquisition.channels, scene, now_s);
                    StartedTask {
                        start_s: now_s,
                        count: 0,
                        looked: (0, volts),
                        unread: VecDeque::new(),
                        overrun: false,
                    }
                }));
            }),
            None => Err(DaqmxStatus::BAD_TASK),
        };
        library.report(Some(task), result)
    }

    fn stop_task(&self, task: TaskHandle) -> i32 {
        self.with_task(task, |acquisition| {
            acquisition.run = None;
            Ok(())
        })
    }

    fn clear_task(&self, task: TaskHandle) -> i32 {
        let mut library = self.library();
        let result = library.tasks.remove(&task).map(|_| ()).ok_or(DaqmxStatus::BAD_TASK);
        library.report(Some(task), result)
    }

    fn read_analog_f64(&self, task: TaskHandle, samples_per_channel: i32, buffer: &mut [f64], read: &mut i32) -> i32 {
        *read = 0;
        self.with_task(task, |acquisition| {
            let EmulatedTask { channels, clock: Some(clock), run: Some(run), .. } = acquisition else {
                return Err(DaqmxStatus::BAD_TASK);
            };
            self.look(|scene, now_s| run.fetch(*clock, channels, &self.wiring, scene, now_s))?;
            let there = run.unread.len() / channels.len();
            let wanted = match samples_per_channel {
                AUTO => there,
                wanted => usize::try_from(wanted).map_err(|_| DaqmxStatus::BAD_VALUE)?,
            };
            let samples = wanted.saturating_mul(channels.len());
            let room = buffer.get_mut(..samples).ok_or(DaqmxStatus::BUFFER_TOO_SMALL)?;
            if wanted > there {
                return Err(DaqmxStatus::NOT_THERE_IN_TIME);
            }
            for (place, sample) in room.iter_mut().zip(run.unread.drain(..samples)) {
                *place = sample;
            }
            *read = i32::try_from(wanted).unwrap_or(i32::MAX);
            Ok(())
        })
    }

    fn extended_error_info(&self) -> String {
        self.library().last_error.clone()
    }

    fn error_string(&self, code: i32) -> String {
        if code == 0 { String::new() } else { DaqmxStatus(code).message(None) }
    }
}

impl Library {
    fn create(&mut self, name: &str) -> Result<TaskHandle, DaqmxStatus> {
        if self.tasks.len() == TASKS_MOST {
            return Err(DaqmxStatus::OUT_OF_MEMORY);
        }
        let name = if name.is_empty() { format!("_unnamedTask<{}>", self.last_task) } else { name.into() };
        if self.tasks.values().any(|each| each.name == name) {
            return Err(DaqmxStatus::TASK_NAME_TAKEN);
        }
        self.last_task += 1;
        let acquisition = EmulatedTask { name, channels: Vec::new(), clock: None, run: None };
        self.tasks.insert(self.last_task, acquisition);
        Ok(self.last_task)
    }

    /// Returns the status number of a result. An error is stored with the task's name.
    fn report(&mut self, task: Option<TaskHandle>, result: Result<(), DaqmxStatus>) -> i32 {
        let Err(status) = result else { return 0 };
        let name = task.and_then(|task| self.tasks.get(&task)).map(|acquisition| acquisition.name.as_str());
        self.last_error = status.message(name);
        status.0
    }
}

impl EmulatedTask {
    fn must_stand(&self) -> Result<(), DaqmxStatus> {
        if self.run.is_some() { Err(DaqmxStatus::TASK_RUNS) } else { Ok(()) }
    }

    fn may_start(&self, another_runs: bool) -> Result<(), DaqmxStatus> {
        self.must_stand()?;
        if self.channels.is_empty() {
            return Err(DaqmxStatus::NO_CHANNELS);
        }
        let channels = self.channels.len();
        let (rate_hz, scans) = self.clock.ok_or(DaqmxStatus::BAD_VALUE)?;
        if rate_hz * channels as f64 > RATE_MOST_HZ || scans.saturating_mul(channels as u64) > BUFFER_MOST {
            return Err(DaqmxStatus::BAD_VALUE);
        }
        if another_runs { Err(DaqmxStatus::RESERVED) } else { Ok(()) }
    }
}

impl StartedTask {
    /// Adds the scans that have arrived by `now_s`.
    fn fetch(
        &mut self,
        (rate_hz, buffer): (f64, u64),
        channels: &[TaskChannel],
        wiring: &InputWiring,
        scene: &mut Scene,
        now_s: f64,
    ) -> Result<(), DaqmxStatus> {
        let since_s = now_s - TRANSFER_S - self.start_s;
        // a float that is below zero is cast to none
        let count = ((since_s * rate_hz + ROUNDING).floor() + 1.0) as u64;
        if count > self.count && !wiring.is_silent(scene, now_s) {
            let unread = (self.unread.len() / channels.len()) as u64;
            self.overrun |= unread + (count - self.count) > buffer;
            if !self.overrun {
                let volts = wiring.volts(channels, scene, now_s);
                let (from, newest) = (self.looked.0, count - 1);
                for scan in self.count..count {
                    let share = if newest > from { (scan - from) as f64 / (newest - from) as f64 } else { 1.0 };
                    let line = self.looked.1.iter().zip(&volts).map(|(before, now)| before + share * (now - before));
                    self.unread.extend(channels.iter().zip(line).map(|(channel, volts)| channel.convert(volts)));
                }
                self.looked = (newest, volts);
                self.count = count;
            }
        }
        if self.overrun { Err(DaqmxStatus::OVERRUN) } else { Ok(()) }
    }
}

impl InputWiring {
    /// Whether the scene has made the device's link silent, so that no scans arrive. If the load cell is on this device, the load
    /// cell's link decides.
    fn is_silent(&self, scene: &mut Scene, now_s: f64) -> bool {
        let device = if self.cell_inputs.is_empty() { SceneDevice::Array } else { SceneDevice::LoadCell };
        scene.latency_s(device, now_s).is_none()
    }

    /// Voltages on the inputs of some channels, V. The load cell is read only if one of the channels belongs to it, because each
    /// reading draws noise.
    fn volts(&self, channels: &[TaskChannel], scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let mut outputs = vec![0.0; scene.taxels()];
        let taxels =
            self.array_first_channel..self.array_first_channel.saturating_add(outputs.len() as u32).min(INPUTS);
        let reads = |inputs: &dyn Fn(u32) -> bool| {
            channels.iter().any(|channel| inputs(channel.input) || channel.against.is_some_and(inputs))
        };
        if reads(&|input| taxels.contains(&input)) {
            scene.outputs(now_s, &mut outputs);
        }
        let (one_v, axes_v): ([f64; 1], Vec<f64>);
        let cell_v: &[f64] = match &self.cell {
            _ if !reads(&|input| self.cell_inputs.contains(&input)) => &[],
            EmulatedCell::OneAxis(volts_per_newton) => {
                one_v = [scene.load_cell_n(now_s) * volts_per_newton];
                &one_v
            }
            EmulatedCell::Axes(inputs) => {
                let forces_n = scene.load_cell_axes_n(now_s);
                let volts = |input: &[f64; 3]| input.iter().zip(forces_n).map(|(volts, force_n)| volts * force_n).sum();
                axes_v = inputs.iter().map(volts).collect();
                &axes_v
            }
        };
        let input_v = |input: u32| match self.cell_inputs.iter().zip(cell_v).find(|(own, _)| **own == input) {
            Some((_, volts)) => *volts,
            None if taxels.contains(&input) => outputs[(input - taxels.start) as usize] * VOLTS_PER_UNIT,
            None => 0.0,
        };
        channels.iter().map(|channel| input_v(channel.input) - channel.against.map_or(0.0, input_v)).collect()
    }
}
