//! Connects a rig's drivers to their links.

use super::cell::AdjustedCell;
use super::emulated::EmulatedDevice;
use super::monitor::{EmulatedMonitor, MonitorSpec};
use super::simulated::{GroundTruth, SimulatedRig};
use super::spec::{Dial, Driver, Home, RigSpec, RigWiring};
use palpate_core::parallel::lock;
use palpate_core::quantity::Axis;
use palpate_drivers::{AnyArray, AnyStage};
use palpate_link::device::{DeviceError, DeviceProblem, HomeSearch, Instruments, StageUse};
use palpate_link::time::{Instant, spawn};
use palpate_link::wire::{self, Claims, Connector, Link, SerialLine};
use palpate_sim::emulator::{self, Instrument, Shared};
use palpate_sim::scene::Scene;

/// Number of bytes that can wait in a link in memory before its writer has to wait.
const MEMORY_BYTES: usize = 4096;

/// A rig with its drivers connected to their links. Nothing has been sent yet.
pub struct OpenRig {
    /// The drivers.
    pub instruments: Instruments<AnyStage, AdjustedCell, AnyArray>,
    /// Drivers of the monitors, in the order of the rig.
    pub monitors: Vec<AnyArray>,
    /// Settings for the use of the stage.
    pub stage_use: StageUse,
    /// What the scene of a simulated rig knows.
    pub truth: GroundTruth,
    /// Real devices, reserved for this program as long as the drivers exist.
    pub claims: Claims,
}

impl RigSpec {
    /// Connects the drivers to their links. In a simulated rig, this program's emulators are at the far ends, in a scene with
    /// this seed. Real devices are reserved for this program.
    ///
    /// # Errors
    /// Another program uses a real device, a device has no emulator for its simulated link, or NI's library is missing.
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
            move |port| Connector::Real(at_port(link.clone(), port))
        };
        let (stage, load_cell, array) = (real(&self.stage.link), real(&self.load_cell.link), real(&self.array.link));
        let origin = Instant::now();
        let monitor = |monitor: &MonitorSpec| monitor.open(self, Dial(&real(&monitor.array.link)), None, origin);
        let monitors = self.monitors.iter().map(monitor).collect::<Result<_, _>>()?;
        Ok(OpenRig { claims, monitors, ..self.wired([Dial(&stage), Dial(&load_cell), Dial(&array)], None, origin)? })
    }

    /// Connects the drivers to links in memory with these devices at the far ends. The time of their scene begins now.
    ///
    /// # Errors
    /// A register map is unsuitable for its role.
    ///
    /// # Panics
    /// Outside a tokio runtime.
    pub fn open_on(&self, simulated: SimulatedRig) -> Result<OpenRig, DeviceError> {
        let origin = Instant::now();
        let SimulatedRig { scene, stage, load_cell, array, monitors: emulated } = simulated;
        let monitor = |(spec, EmulatedMonitor { device, scene }): (&MonitorSpec, EmulatedMonitor)| {
            spec.open(self, Dial(&in_memory(device, scene.clone(), origin)), Some(scene), origin)
        };
        let monitors = self.monitors.iter().zip(emulated).map(monitor).collect::<Result<_, _>>()?;
        let [stage, load_cell, array] =
            [stage, load_cell, array].map(|device: EmulatedDevice| in_memory(device, scene.clone(), origin));
        let dials = [Dial(&stage), Dial(&load_cell), Dial(&array)];
        Ok(OpenRig { monitors, ..self.wired(dials, Some(scene), origin)? })
    }

    /// Returns the stage's driver on links that the caller opens; nothing is sent.
    pub fn stage_on(&self, dial: Dial) -> AnyStage {
        self.stage.driver.open(dial, self)
    }

    /// Returns the load cell's driver on a link that the caller opens, with readings timed from `origin`; nothing is sent.
    ///
    /// # Errors
    /// A register map is unsuitable for the role, or NI's library is missing.
    pub fn load_cell_on(&self, dial: Dial, origin: Instant) -> Result<AdjustedCell, DeviceError> {
        self.adjusted_cell(dial, &RigWiring::new(self, None, origin))
    }

    fn adjusted_cell(&self, dial: Dial, wiring: &RigWiring) -> Result<AdjustedCell, DeviceError> {
        Ok(AdjustedCell::new(self.load_cell.driver.open(dial, wiring)?, &self.load_cell))
    }

    fn wired(
        &self,
        [stage, load_cell, array]: [Dial; 3],
        scene: Option<Shared<Scene>>,
        origin: Instant,
    ) -> Result<OpenRig, DeviceError> {
        let wiring = RigWiring::new(self, scene, origin);
        let instruments = Instruments {
            stage: self.stage_on(stage),
            load_cell: self.adjusted_cell(load_cell, &wiring)?,
            array: self.array.driver.open(array, &wiring)?,
        };
        let truth = GroundTruth::new(wiring.scene, origin);
        let (stage_use, monitors, claims) = (self.stage_use(), Vec::new(), Claims::default());
        Ok(OpenRig { instruments, monitors, stage_use, truth, claims })
    }

    /// Returns the settings for the use of the stage, as this rig states them.
    pub(super) fn stage_use(&self) -> StageUse {
        let away = -self.frame.down.sign();
        StageUse {
            travel: self.permitted_travel(),
            away,
            speed_mm_s: self.stage.speed_mm_s,
            acceleration_mm_s2: self.stage.acceleration_mm_s2,
            home_speed_mm_s: self.stage.speed_mm_s,
            home_z_mm: self.stage.home_z_mm.unwrap_or_else(|| self.stage.travel.along(Axis::Z).end(away)),
            homed: self.stage.homed,
            z_holds_unpowered: self.stage.z_holds_unpowered,
            by_hand: self.stage.home == Home::ByHand,
            steps: self.stage.steps,
            home_search: HomeSearch::Away,
            abilities: self.stage.driver.abilities(),
        }
    }

    /// Claims the real devices exclusively for this program. Each device is claimed once, even if several roles share it. A monitor
    /// isn't claimed if several rigs can read it.
    fn claims(&self) -> Result<Claims, DeviceError> {
        let mut claims = Claims::default();
        let roles: [(&dyn Driver, &Link, String); 3] = [
            (&*self.stage.driver, &self.stage.link, "stage".to_owned()),
            (&*self.load_cell.driver, &self.load_cell.link, "load cell".to_owned()),
            (&*self.array.driver, &self.array.link, "array".to_owned()),
        ];
        let only_ours = |monitor: &&MonitorSpec| !monitor.array.driver.serves_several(&monitor.array.link);
        let monitors = self.monitors.iter().filter(only_ours).map(|monitor| {
            let driver: &dyn Driver = &*monitor.array.driver;
            (driver, &monitor.array.link, monitor.role())
        });
        for (driver, link, device) in roles.into_iter().chain(monitors) {
            driver.claim(link, &mut claims).map_err(|error| DeviceError {
                device,
                doing: "opening its link".to_owned(),
                problem: DeviceProblem::Claim(error.to_string()),
            })?;
        }
        Ok(claims)
    }
}

/// Returns links in memory. Each time a link is opened, an emulator begins to serve its other end.
fn in_memory(device: EmulatedDevice, scene: Shared<Scene>, origin: Instant) -> impl Fn(Option<u16>) -> Connector {
    move |port| {
        let instrument = device.instrument().and_then(|device| match port {
            Some(port) => lock(device).at_port(port),
            None => Some(device.clone()),
        });
        match instrument {
            Some(instrument) => dial(device.line, instrument, scene.clone(), origin),
            None => Connector::Real(Link::Sim), // a library has no stream; nobody opens this
        }
    }
}

/// Returns a link with another TCP port.
fn at_port(link: Link, port: Option<u16>) -> Link {
    match (link, port) {
        (Link::Tcp { host, .. }, Some(port)) => Link::Tcp { host, port },
        (link, _) => link,
    }
}

fn dial(
    line: Option<SerialLine>,
    instrument: Shared<dyn Instrument>,
    scene: Shared<Scene>,
    origin: Instant,
) -> Connector {
    Connector::in_memory(move || {
        let (near, far) = wire::in_memory(MEMORY_BYTES);
        // its only error is that the near end has gone
        drop(spawn(emulator::serve_on(line, far, instrument.clone(), scene.clone(), origin)));
        near
    })
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;

    const XPS: &str = include_str!("../../../../rigs/xps.toml");
    const PROGRAMS: &str = include_str!("../../../../rigs/process.toml");

    /// A host of this test process only, because its locks are those of the machine.
    fn host(name: &str) -> String {
        format!("{name}-of-{}", std::process::id())
    }

    /// Reads a rig with these parts changed.
    fn rig(text: &str, changes: &[(&str, &str)], more: &str) -> RigSpec {
        let text = changes.iter().fold(text.to_owned(), |text, (from, to)| {
            assert!(text.contains(from), "no {from}");
            text.replace(from, to)
        });
        let read = parse("rig.toml", &(text + more), &|_| Err(std::io::ErrorKind::NotFound.into()));
        read.unwrap_or_else(|problems| panic!("{:?}", problems.lines()))
    }

    /// Returns an XPS rig of this name with one more section.
    fn xps(name: &str, more: &str) -> RigSpec {
        let (stage, array) = (host(&format!("{name}-stage")), host(&format!("{name}-array")));
        rig(XPS, &[("192.168.0.254", &stage), ("192.168.1.10", &array)], more)
    }

    #[test]
    fn two_rigs_read_one_thermometer_if_it_bears_it() {
        let gateway = host("gateway");
        for (driver, link, is_free) in [
            ("process = [\"python3\", \"thermometer.py\"]", String::new(), true),
            ("modbus = \"labjack-t7\"", format!("link = \"tcp://{gateway}:502\""), true),
            ("lines = \"one-number\"", format!("link = \"tcp://{gateway}:503\""), false),
        ] {
            let more = format!("\n[[monitor]]\nname = \"t_c\"\ndriver = {{ {driver} }}\n{link}\n");
            let _first = xps("first", &more).claims().unwrap();
            let second = xps("second", &more).claims();
            assert_eq!(second.is_ok(), is_free, "{driver}: {:?}", second.err());
        }
    }

    #[test]
    fn only_the_program_of_a_stage_is_claimed() {
        let script = host("stage.py");
        let other = host("other.py");
        let with = |script: &str| rig(PROGRAMS, &[("examples/stage.py", script)], "");
        let _first = with(&script).claims().unwrap();
        let refused = with(&script).claims().unwrap_err().to_string();
        let process = if cfg!(windows) { String::new() } else { format!(" (process {})", std::process::id()) };
        assert_eq!(
            refused,
            format!(
                "stage: while opening its link: process python3 {script} is in use by another palpate{process}: end it, or wait \
                 for it; if this program drives another device, state in its command what differs, such as the port"
            )
        );
        // cell and array of both rigs are the same commands
        with(&other).claims().unwrap();
    }
}
