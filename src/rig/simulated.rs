use super::{ArrayDriver, LoadCellDriver, MappedDevice, RigSpec, StageDriver};
use crate::device::{DeviceError, Problem};
use crate::emulator::{
    self, DaqmxEmulator, Grbl, Instrument, LabJackT7, LaumasTlb, Modbus, ProcessArray, ProcessLoadCell, ProcessStage,
    SenecaZsg, Shared, Transmitter,
};
use crate::quantity::{Axis, Place, Position};
use crate::scene::{Device, Scene, Setting, Truth};
use crate::wire::daqmx::NiDaqmx;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::time::Instant;

/// Half the side of the loading area (PAPER S8), mm.
const LOADING_HALF_MM: f64 = 6.0;

/// How far from the specimen the axes stand when an emulated controller is switched on, mm.
const POWER_ON_MM: f64 = 5.0;

/// The range of the emulated transmitters over the specimen's force limit.
const RANGE_OVER_LIMIT: f64 = 2.5;

/// A rig's emulators, acting on one scene.
pub struct SimulatedRig {
    /// The scene.
    pub scene: Shared<Scene>,
    /// The stage's controller.
    pub stage: EmulatedDevice,
    /// The load cell's transmitter.
    pub load_cell: EmulatedDevice,
    /// The array's converter.
    pub array: EmulatedDevice,
}

/// One emulated device.
#[derive(Clone)]
pub struct EmulatedDevice {
    /// What stands at the far end of its link.
    pub far_end: FarEnd,
    /// What it speaks, such as `esp301`, `modbus-rtu` or `daqmx`.
    pub protocol: &'static str,
}

/// What stands at the far end of a link, and how it would be wired.
#[derive(Clone)]
pub enum FarEnd {
    /// An instrument on a serial line.
    Serial(Shared<dyn Instrument>),
    /// An instrument on a network.
    Network(Shared<dyn Instrument>),
    /// A program, on its standard input and output.
    Pipe(Shared<dyn Instrument>),
    /// NI's library: a table of functions, no stream of bytes.
    Library,
}

/// What a run may know of a simulated scene: it names the presses and reads the truth, and touches nothing.
#[derive(Clone)]
pub struct SceneProbe {
    pub(super) scene: Shared<Scene>,
    pub(super) origin: Instant,
}

impl RigSpec {
    /// The rig's emulators in a scene of this seed.
    ///
    /// # Errors
    /// A device there is no emulator for.
    pub fn emulators(&self, seed: u64) -> Result<SimulatedRig, DeviceError> {
        let spec = self.scene.clone();
        let away = self.frame.to_stage(Place::default(), -POWER_ON_MM).z_mm;
        let travel = &self.stage.travel;
        let within = |axis: Axis, mm: f64| mm.clamp(travel.along(axis).min, travel.along(axis).max);
        let setting = Setting {
            // the drivers go by the rig's word, the scene by how the specimen really lies
            frame: spec.mounting.map_or(self.frame, |real| self.frame.moved(real.origin, real.rotation_deg, real.z_mm)),
            layout: self.array.layout.clone(),
            full_scale_n: self.limits.force_n,
            half_extent_mm: LOADING_HALF_MM,
            power_on: Position {
                x_mm: within(Axis::X, self.frame.origin.x_mm + 1.3),
                y_mm: within(Axis::Y, self.frame.origin.y_mm - 0.8),
                z_mm: within(Axis::Z, away),
            },
            conversions_hz: self.load_cell.conversions_hz,
            latencies: spec.latencies,
        };
        let scene = Scene::new(spec, setting, seed);
        let range_n = RANGE_OVER_LIMIT * self.limits.force_n;
        let stage = self.emulated_stage(&scene);
        let load_cell = match &self.load_cell.driver {
            LoadCellDriver::Modbus(map) => emulated_map(map, Device::LoadCell, range_n)?,
            // another socket of the stage's own controller
            LoadCellDriver::Xps(_) => stage.clone(),
            LoadCellDriver::Daqmx { .. } => EmulatedDevice { far_end: FarEnd::Library, protocol: "daqmx" },
            LoadCellDriver::Process => pipe(ProcessLoadCell::new()),
        };
        let array = match &self.array.driver {
            ArrayDriver::Modbus(map) => emulated_map(map, Device::Array, range_n)?,
            ArrayDriver::Daqmx(_) => EmulatedDevice { far_end: FarEnd::Library, protocol: "daqmx" },
            ArrayDriver::Process => pipe(ProcessArray::new()),
        };
        Ok(SimulatedRig { scene: Arc::new(Mutex::new(scene)), stage, load_cell, array })
    }

    fn emulated_stage(&self, scene: &Scene) -> EmulatedDevice {
        let device = |far_end, protocol| EmulatedDevice { far_end, protocol };
        match &self.stage.driver {
            StageDriver::Esp301 => device(FarEnd::Serial(shared(emulator::Esp301::new(scene))), "esp301"),
            StageDriver::Xps { group, .. } => {
                let volts_per_newton = match &self.load_cell.driver {
                    LoadCellDriver::Xps(input) => 1.0 / input.newton_per_volt,
                    _ => 1.0,
                };
                let positioners = group.positioners.each_ref().map(String::as_str);
                let xps = emulator::Xps::new(scene, &group.name, positioners, volts_per_newton);
                device(FarEnd::Network(shared(xps)), "xps")
            }
            StageDriver::Grbl => device(FarEnd::Serial(shared(Grbl::new(scene))), "grbl"),
            StageDriver::Process => pipe(ProcessStage::new(scene)),
        }
    }

    /// NI's functions in a scene: the channels that the rig's drivers name carry what they are meant to.
    pub(super) fn emulated_daqmx(&self, scene: &Shared<Scene>, origin: Instant) -> Arc<dyn NiDaqmx> {
        let (mut device, mut cell, mut first, mut volts_per_newton) = ("Dev1", None, 0, 1.0);
        if let ArrayDriver::Daqmx(inputs) = &self.array.driver {
            (device, first) = first_input(&inputs.physical);
        }
        if let LoadCellDriver::Daqmx { inputs, newton_per_volt } = &self.load_cell.driver {
            let (name, channel) = first_input(&inputs.physical);
            (device, cell, volts_per_newton) = (name, Some(channel), 1.0 / newton_per_volt);
        }
        Arc::new(DaqmxEmulator::new(scene.clone(), origin, device, cell, first, volts_per_newton))
    }
}

impl SimulatedRig {
    /// The devices with their roles.
    pub fn devices(&self) -> [(&EmulatedDevice, &'static str); 3] {
        [(&self.stage, Device::Stage), (&self.load_cell, Device::LoadCell), (&self.array, Device::Array)]
            .map(|(device, role)| (device, role.name()))
    }
}

impl EmulatedDevice {
    /// The instrument at the far end; none where it is a library.
    pub fn instrument(&self) -> Option<&Shared<dyn Instrument>> {
        match &self.far_end {
            FarEnd::Serial(instrument) | FarEnd::Network(instrument) | FarEnd::Pipe(instrument) => Some(instrument),
            FarEnd::Library => None,
        }
    }

    /// Whether it is the same instrument as another, in another role.
    pub fn is_same(&self, other: &EmulatedDevice) -> bool {
        self.instrument().zip(other.instrument()).is_some_and(|(own, others)| Arc::ptr_eq(own, others))
    }

    /// Puts another instrument in its place.
    pub fn replace(&mut self, other: Shared<dyn Instrument>) {
        match &mut self.far_end {
            FarEnd::Serial(instrument) | FarEnd::Network(instrument) | FarEnd::Pipe(instrument) => *instrument = other,
            FarEnd::Library => {}
        }
    }
}

impl SceneProbe {
    /// Names the press that comes next.
    pub fn begin_press(&self, press: u64) {
        self.scene().begin_press(press, self.now_s());
    }

    /// Begins to average the true force.
    pub fn open_window(&self) {
        self.scene().open_window(self.now_s());
    }

    /// Ends that average.
    pub fn close_window(&self) {
        self.scene().close_window(self.now_s());
    }

    /// What really happened since this was last asked.
    pub fn take_truth(&self) -> Truth {
        self.scene().take_truth(self.now_s())
    }

    fn scene(&self) -> MutexGuard<'_, Scene> {
        self.scene.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }
}

fn shared<I: Instrument + 'static>(instrument: I) -> Shared<dyn Instrument> {
    Arc::new(Mutex::new(instrument))
}

fn pipe<I: Instrument + 'static>(instrument: I) -> EmulatedDevice {
    EmulatedDevice { far_end: FarEnd::Pipe(shared(instrument)), protocol: "process" }
}

/// The device and the number of the first input of `Dev1/ai1:9`.
fn first_input(physical: &str) -> (&str, u32) {
    let (device, inputs) = physical.split_once('/').unwrap_or((physical, ""));
    let digits: String = inputs.chars().skip_while(|c| !c.is_ascii_digit()).take_while(char::is_ascii_digit).collect();
    (device, digits.parse().unwrap_or(0))
}

fn emulated_map(map: &MappedDevice, role: Device, range_n: f64) -> Result<EmulatedDevice, DeviceError> {
    let unit_id = map.profile.unit_id;
    let rtu = |instrument| Ok(EmulatedDevice { far_end: FarEnd::Serial(instrument), protocol: "modbus-rtu" });
    match (map.name.as_str(), role) {
        ("generic-rs485", Device::LoadCell) => rtu(shared(Modbus::rtu(Transmitter::new(range_n), unit_id))),
        ("laumas-tlb", Device::LoadCell) => rtu(shared(Modbus::rtu(LaumasTlb::new(range_n), unit_id))),
        ("seneca-zsg", Device::LoadCell) => rtu(shared(Modbus::rtu(SenecaZsg::new(range_n), unit_id))),
        ("labjack-t7", Device::LoadCell | Device::Array) => {
            let far_end = FarEnd::Network(shared(Modbus::tcp(LabJackT7::new(role))));
            Ok(EmulatedDevice { far_end, protocol: "modbus-tcp" })
        }
        (name, role) => {
            let told = format!(
                "there is no emulator for the register map \"{name}\" in this role: simulated are generic-rs485, \
                 laumas-tlb and seneca-zsg (load cell) and labjack-t7 (load cell or array)"
            );
            let (device, doing) = (role.name().to_owned(), "opening it".to_owned());
            Err(DeviceError { device, doing, problem: Problem::Mismatch(told) })
        }
    }
}
