use super::{ArraySpec, LoadCellSpec, MappedDevice, RigSpec};
use crate::device::{DeviceError, Instruments, Problem, StageUse};
use crate::driver::Esp301;
use crate::driver::modbus::{ModbusArray, ModbusLoadCell, Profile, Transport};
use crate::emulator::{self, Instrument, LabJackT7, Modbus, Shared, Transmitter};
use crate::quantity::{Axis, Place, Position};
use crate::scene::{Device, Scene, Setting, Truth};
use crate::wire::{Connector, Link};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::io::duplex;
use tokio::time::Instant;

/// Bytes that wait in a link in memory before its writer waits too.
const DUPLEX_BYTES: usize = 4096;

/// Half the side of the loading area (PAPER S8), mm.
const LOADING_HALF_MM: f64 = 6.0;

/// How far from the specimen the axes stand when an emulated controller is switched on, mm.
const POWER_ON_MM: f64 = 5.0;

/// The range of the emulated transmitter over the specimen's force limit.
const RANGE_OVER_LIMIT: f64 = 2.5;

/// A rig with its drivers on their links. Nothing has been sent yet.
pub struct OpenRig {
    /// The drivers.
    pub instruments: Instruments<Esp301, ModbusLoadCell, ModbusArray>,
    /// How the stage is to be used.
    pub stage_use: StageUse,
    /// The truth behind a simulated rig.
    pub probe: Option<SceneProbe>,
}

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

/// One emulated device, and how it would be wired.
pub struct EmulatedDevice {
    /// The device.
    pub instrument: Shared<dyn Instrument>,
    /// What it speaks: `esp301`, `modbus-rtu` or `modbus-tcp`.
    pub protocol: &'static str,
    /// What it speaks over.
    pub wiring: Wiring,
}

/// What a device speaks over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wiring {
    /// A serial line.
    Serial,
    /// A network.
    Network,
}

/// What a run may know of a simulated scene: it names the presses and reads the truth, and touches nothing.
#[derive(Clone)]
pub struct SceneProbe {
    scene: Shared<Scene>,
    origin: Instant,
}

impl RigSpec {
    /// Puts the drivers on their links; in a simulated rig our emulators are at the far ends, in a scene of this seed.
    ///
    /// # Errors
    /// A simulated link to a device there is no emulator for.
    ///
    /// # Panics
    /// Outside a tokio runtime.
    pub fn open(&self, seed: u64) -> Result<OpenRig, DeviceError> {
        if self.is_simulated() {
            return self.open_on(self.emulators(seed)?);
        }
        let links = [&self.stage.link, &self.load_cell.link, &self.array.link];
        self.wired(links.map(|link| Connector::Real(link.clone())), None, Instant::now())
    }

    /// Puts the drivers on links in memory with these devices at the far ends; their scene's time begins now.
    ///
    /// # Errors
    /// A register map that can't play its role.
    ///
    /// # Panics
    /// Outside a tokio runtime.
    pub fn open_on(&self, simulated: SimulatedRig) -> Result<OpenRig, DeviceError> {
        let origin = Instant::now();
        let SimulatedRig { scene, stage, load_cell, array } = simulated;
        let devices = [stage, load_cell, array];
        let connectors = devices.map(|device| dial(device.instrument, scene.clone(), origin));
        self.wired(connectors, Some(SceneProbe { scene, origin }), origin)
    }

    fn wired(
        &self,
        [stage, load_cell, array]: [Connector; 3],
        probe: Option<SceneProbe>,
        origin: Instant,
    ) -> Result<OpenRig, DeviceError> {
        let instruments = Instruments {
            stage: Esp301::new(stage, self.stage.link.to_string()),
            load_cell: self.load_cell.driver(load_cell, origin)?,
            array: self.array.driver(array)?,
        };
        let stage_use = StageUse {
            travel: self.permitted_travel(),
            away: -self.frame.down.sign(),
            speed_mm_s: self.stage.speed_mm_s,
            acceleration_mm_s2: self.stage.acceleration_mm_s2,
        };
        Ok(OpenRig { instruments, stage_use, probe })
    }

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
            frame: self.frame,
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
        let stage = EmulatedDevice {
            instrument: Arc::new(Mutex::new(emulator::Esp301::new(&scene))),
            protocol: "esp301",
            wiring: Wiring::Serial,
        };
        let range_n = RANGE_OVER_LIMIT * self.limits.force_n;
        let load_cell = emulate(&self.load_cell.map, Device::LoadCell, range_n)?;
        let array = emulate(&self.array.map, Device::Array, range_n)?;
        Ok(SimulatedRig { scene: Arc::new(Mutex::new(scene)), stage, load_cell, array })
    }
}

impl SimulatedRig {
    /// The devices with their roles.
    pub fn devices(&self) -> [(&EmulatedDevice, &'static str); 3] {
        [(&self.stage, Device::Stage), (&self.load_cell, Device::LoadCell), (&self.array, Device::Array)]
            .map(|(device, role)| (device, role.name()))
    }
}

impl SceneProbe {
    /// Names the press that comes next.
    pub fn begin_press(&self, press: u64) {
        self.scene().begin_press(press);
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

impl LoadCellSpec {
    fn driver(&self, connector: Connector, origin: Instant) -> Result<ModbusLoadCell, DeviceError> {
        let MappedDevice { name, profile, .. } = &self.map;
        let transport = transport(&self.link, profile);
        let link = self.link.to_string();
        ModbusLoadCell::new(connector, transport, profile.clone(), &link, self.conversions_hz, origin)
            .ok_or_else(|| unfit("load cell", name))
    }
}

impl ArraySpec {
    fn driver(&self, connector: Connector) -> Result<ModbusArray, DeviceError> {
        let MappedDevice { name, profile, .. } = &self.map;
        let transport = transport(&self.link, profile);
        ModbusArray::new(connector, transport, profile.clone(), &self.link.to_string(), self.layout.len())
            .ok_or_else(|| unfit("array", name))
    }
}

/// The link decides the framing; a simulated one is what the device itself speaks.
fn transport(link: &Link, profile: &Profile) -> Transport {
    match link {
        Link::Serial { .. } => Transport::Rtu,
        Link::Tcp { .. } => Transport::Tcp,
        Link::Sim => profile.transport,
    }
}

fn emulate(map: &MappedDevice, role: Device, range_n: f64) -> Result<EmulatedDevice, DeviceError> {
    let (instrument, protocol, wiring): (Shared<dyn Instrument>, _, _) = match (map.name.as_str(), role) {
        ("generic-rs485", Device::LoadCell) => {
            let device = Modbus::rtu(Transmitter::new(range_n), map.profile.unit_id);
            (Arc::new(Mutex::new(device)), "modbus-rtu", Wiring::Serial)
        }
        ("labjack-t7", Device::LoadCell | Device::Array) => {
            (Arc::new(Mutex::new(Modbus::tcp(LabJackT7::new(role)))), "modbus-tcp", Wiring::Network)
        }
        (name, role) => return Err(unfit(role.name(), name)),
    };
    Ok(EmulatedDevice { instrument, protocol, wiring })
}

fn unfit(role: &str, map: &str) -> DeviceError {
    let told = "simulated are generic-rs485 (load cell) and labjack-t7 (load cell or array)";
    let problem =
        Problem::Mismatch(format!("there is no emulator for the register map \"{map}\" in this role: {told}"));
    DeviceError { device: role.to_owned(), doing: "opening it".to_owned(), problem }
}

/// A link in memory: each time it is opened an emulator begins to serve its far end.
fn dial(instrument: Shared<dyn Instrument>, scene: Shared<Scene>, origin: Instant) -> Connector {
    Connector::Memory(Box::new(move || {
        let (near, far) = duplex(DUPLEX_BYTES);
        // its only error is that the near end has gone
        drop(tokio::spawn(emulator::serve(far, instrument.clone(), scene.clone(), origin)));
        near
    }))
}
