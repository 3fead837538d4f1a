use super::{
    ArrayDriver, ArraySpec, EmulatedDevice, LoadCellDriver, LoadCellSpec, MappedDevice, RigSpec, SceneProbe,
    SimulatedRig, StageDriver, StageSpec,
};
use crate::device::{DeviceError, Identity, Instruments, Problem, StageUse};
use crate::driver::daqmx::{Acquisition, DaqmxArray, DaqmxLoadCell, SharedAcquisition};
use crate::driver::grbl::Grbl;
use crate::driver::modbus::{ModbusArray, ModbusLoadCell, Profile, Transport};
use crate::driver::process::{ProcessArray, ProcessLoadCell, ProcessStage};
use crate::driver::xps::{Xps, XpsAnalog};
use crate::driver::{AnyArray, AnyLoadCell, AnyStage, Esp301};
use crate::emulator::{self, Instrument, Shared};
use crate::scene::Scene;
use crate::wire::daqmx::{DaqmxLibrary, Functions};
use crate::wire::{Claims, Connector, Link};
use std::sync::Arc;
use tokio::io::duplex;
use tokio::sync::Mutex;
use tokio::time::Instant;

/// Bytes that wait in a link in memory before its writer waits too.
const DUPLEX_BYTES: usize = 4096;

/// A rig with its drivers on their links. Nothing has been sent yet.
pub struct OpenRig {
    /// The drivers.
    pub instruments: Instruments<AnyStage, AnyLoadCell, AnyArray>,
    /// How the stage is to be used.
    pub stage_use: StageUse,
    /// The truth behind a simulated rig.
    pub probe: Option<SceneProbe>,
    /// The real links: this program's alone as long as the drivers live.
    pub claims: Claims,
}

/// Opens the links of one role, as many as its driver needs.
type Dial<'a> = &'a dyn Fn() -> Connector;

impl RigSpec {
    /// Puts the drivers on their links; in a simulated rig our emulators are at the far ends, in a scene of this seed. Real
    /// links are held for this program alone.
    ///
    /// # Errors
    /// A real link that another program holds, a simulated one to a device there is no emulator for, or NI's library where
    /// there is none.
    ///
    /// # Panics
    /// Outside a tokio runtime.
    pub fn open(&self, seed: u64) -> Result<OpenRig, DeviceError> {
        if self.is_simulated() {
            return self.open_on(self.emulators(seed)?);
        }
        let claims = self.claims()?;
        let real = |link: &Link| {
            let link = link.clone();
            move || Connector::Real(link.clone())
        };
        let (stage, load_cell, array) = (real(&self.stage.link), real(&self.load_cell.link), real(&self.array.link));
        let functions = self.daqmx_library()?;
        Ok(OpenRig { claims, ..self.wired([&stage, &load_cell, &array], functions, None, Instant::now())? })
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
        let [stage, load_cell, array] =
            [stage, load_cell, array].map(|device: EmulatedDevice| in_memory(device, scene.clone(), origin));
        let functions = self.uses_daqmx().then(|| Functions::Here(self.emulated_daqmx(&scene, origin)));
        self.wired([&stage, &load_cell, &array], functions, Some(SceneProbe { scene, origin }), origin)
    }

    fn wired(
        &self,
        [stage, load_cell, array]: [Dial; 3],
        functions: Option<Functions>,
        probe: Option<SceneProbe>,
        origin: Instant,
    ) -> Result<OpenRig, DeviceError> {
        let acquisition = functions.map(|functions| self.acquisition(functions));
        let guard = match (&self.stage.driver, &self.load_cell.driver) {
            (StageDriver::Xps { guard: true, .. }, LoadCellDriver::Xps(guard)) => Some(guard.clone()),
            _ => None,
        };
        let instruments = Instruments {
            stage: self.stage.driver(stage, guard),
            load_cell: self.load_cell.driver(load_cell, acquisition.as_ref(), origin)?,
            array: self.array.driver(array, acquisition.as_ref(), &self.load_cell)?,
        };
        let stage_use = StageUse {
            travel: self.permitted_travel(),
            away: -self.frame.down.sign(),
            speed_mm_s: self.stage.speed_mm_s,
            acceleration_mm_s2: self.stage.acceleration_mm_s2,
        };
        Ok(OpenRig { instruments, stage_use, probe, claims: Claims::default() })
    }

    /// Takes the real links for this program alone: each once, whichever roles share it.
    fn claims(&self) -> Result<Claims, DeviceError> {
        let mut claims = Claims::default();
        let cell_inputs = match &self.load_cell.driver {
            LoadCellDriver::Daqmx { inputs, .. } => Some(inputs),
            _ => None,
        };
        let array_inputs = match &self.array.driver {
            ArrayDriver::Daqmx(inputs) => Some(inputs),
            _ => None,
        };
        for (role, link, inputs) in [
            ("stage", &self.stage.link, None),
            ("load cell", &self.load_cell.link, cell_inputs),
            ("array", &self.array.link, array_inputs),
        ] {
            let taken = match (link, inputs) {
                (Link::Daqmx(_), Some(inputs)) => claims.take_ni(&inputs.physical),
                _ => claims.take(link),
            };
            taken.map_err(|error| DeviceError {
                device: role.to_owned(),
                doing: "opening its link".to_owned(),
                problem: Problem::Claim(error.to_string()),
            })?;
        }
        Ok(claims)
    }

    fn uses_daqmx(&self) -> bool {
        matches!(self.load_cell.driver, LoadCellDriver::Daqmx { .. })
            || matches!(self.array.driver, ArrayDriver::Daqmx(_))
    }

    /// NI's library, loaded, where the rig needs it.
    fn daqmx_library(&self) -> Result<Option<Functions>, DeviceError> {
        let path = match (&self.load_cell.link, &self.array.link) {
            (Link::Daqmx(path), _) | (_, Link::Daqmx(path)) => path.as_deref(),
            _ => return Ok(None),
        };
        let failed = |told: String| DeviceError {
            device: "NI device".to_owned(),
            doing: "loading NI's library".to_owned(),
            problem: Problem::Link(told),
        };
        let library = DaqmxLibrary::load(path).map_err(|error| failed(error.to_string()))?;
        let functions = Functions::on_a_thread(Arc::new(library));
        functions.map(Some).map_err(|error| failed(format!("there is no thread for it: {error}")))
    }

    /// One task for all NI inputs of the rig: the load cell's first.
    fn acquisition(&self, functions: Functions) -> SharedAcquisition {
        let mut inputs = Vec::new();
        if let LoadCellDriver::Daqmx { inputs: cell, .. } = &self.load_cell.driver {
            inputs.push(cell.clone());
        }
        if let ArrayDriver::Daqmx(array) = &self.array.driver {
            inputs.push(array.clone());
        }
        let load_cells = matches!(self.load_cell.driver, LoadCellDriver::Daqmx { .. });
        let link = if load_cells { &self.load_cell.link } else { &self.array.link };
        let (rate_hz, link) = (self.load_cell.conversions_hz, link.to_string());
        Arc::new(Mutex::new(Acquisition::new(functions, inputs, rate_hz, link)))
    }
}

impl StageSpec {
    fn driver(&self, dial: Dial, guard: Option<crate::driver::xps::Guard>) -> AnyStage {
        let link = self.link.to_string();
        match &self.driver {
            StageDriver::Esp301 => AnyStage::Esp301(Esp301::new(dial(), link)),
            StageDriver::Xps { group, .. } => {
                let sockets = [dial(), dial(), dial()];
                AnyStage::Xps(Box::new(Xps::new(sockets, link, group.clone(), guard)))
            }
            StageDriver::Grbl => AnyStage::Grbl(Grbl::new(dial(), link)),
            StageDriver::Process => AnyStage::Process(ProcessStage::new(dial(), link)),
        }
    }
}

impl LoadCellSpec {
    fn driver(
        &self,
        dial: Dial,
        acquisition: Option<&SharedAcquisition>,
        origin: Instant,
    ) -> Result<AnyLoadCell, DeviceError> {
        let (link, hz) = (self.link.to_string(), self.conversions_hz);
        Ok(match &self.driver {
            LoadCellDriver::Modbus(map) => {
                let MappedDevice { name, profile, .. } = &**map;
                let transport = transport(&self.link, profile);
                let driver = ModbusLoadCell::new(dial(), transport, profile.clone(), &link, hz, origin);
                AnyLoadCell::Modbus(driver.ok_or_else(|| unfit("load cell", name))?)
            }
            LoadCellDriver::Xps(input) => {
                AnyLoadCell::Xps(XpsAnalog::new(dial(), link, &input.input, input.newton_per_volt, hz, origin))
            }
            LoadCellDriver::Daqmx { inputs, newton_per_volt } => {
                let identity = ni_identity("load_cell", &inputs.physical, hz, link);
                let acquisition = acquisition.ok_or_else(|| unfit("load cell", "daqmx"))?.clone();
                let (at, range_v) = (0, inputs.range_v);
                AnyLoadCell::Daqmx(DaqmxLoadCell::new(acquisition, at, *newton_per_volt, range_v, hz, origin, identity))
            }
            LoadCellDriver::Process => AnyLoadCell::Process(ProcessLoadCell::new(dial(), link, hz, origin)),
        })
    }
}

impl ArraySpec {
    fn driver(
        &self,
        dial: Dial,
        acquisition: Option<&SharedAcquisition>,
        load_cell: &LoadCellSpec,
    ) -> Result<AnyArray, DeviceError> {
        let (link, units) = (self.link.to_string(), self.layout.len());
        Ok(match &self.driver {
            ArrayDriver::Modbus(map) => {
                let MappedDevice { name, profile, .. } = &**map;
                let transport = transport(&self.link, profile);
                let driver = ModbusArray::new(dial(), transport, profile.clone(), &link, units);
                AnyArray::Modbus(driver.ok_or_else(|| unfit("array", name))?)
            }
            ArrayDriver::Daqmx(inputs) => {
                let acquisition = acquisition.ok_or_else(|| unfit("array", "daqmx"))?.clone();
                let identity = ni_identity("array", &inputs.physical, load_cell.conversions_hz, link);
                // behind the load cell, where that is in the same task
                let at = usize::from(matches!(load_cell.driver, LoadCellDriver::Daqmx { .. }));
                AnyArray::Daqmx(DaqmxArray::new(acquisition, at, units, identity))
            }
            ArrayDriver::Process => AnyArray::Process(ProcessArray::new(dial(), link, units)),
        })
    }
}

/// The link decides the framing; a simulated one is what the device itself speaks.
fn transport(link: &Link, profile: &Profile) -> Transport {
    match link {
        Link::Serial { .. } => Transport::Rtu,
        Link::Tcp { .. } => Transport::Tcp,
        _ => profile.transport,
    }
}

fn ni_identity(role: &str, physical: &str, rate_hz: f64, link: String) -> Identity {
    let identity = format!("NI-DAQmx {physical} at {rate_hz} Hz");
    Identity { role: role.to_owned(), identity, link, warnings: Vec::new() }
}

fn unfit(role: &str, driver: &str) -> DeviceError {
    let problem = Problem::Mismatch(format!("\"{driver}\" can't play this role"));
    DeviceError { device: role.to_owned(), doing: "opening it".to_owned(), problem }
}

/// Links in memory: each time one is opened an emulator begins to serve its far end.
fn in_memory(device: EmulatedDevice, scene: Shared<Scene>, origin: Instant) -> impl Fn() -> Connector {
    move || match device.instrument() {
        Some(instrument) => dial(instrument.clone(), scene.clone(), origin),
        None => Connector::Real(Link::Sim), // a library has no stream; nobody opens this
    }
}

fn dial(instrument: Shared<dyn Instrument>, scene: Shared<Scene>, origin: Instant) -> Connector {
    Connector::Memory(Box::new(move || {
        let (near, far) = duplex(DUPLEX_BYTES);
        // its only error is that the near end has gone
        drop(tokio::spawn(emulator::serve(far, instrument.clone(), scene.clone(), origin)));
        near
    }))
}
