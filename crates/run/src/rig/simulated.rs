//! A rig's emulators, acting on one scene.

use super::emulated::EmulatedDevice;
use super::monitor::EmulatedMonitor;
use super::spec::{Home, RigSpec};
use palpate_core::parallel::lock;
use palpate_core::quantity::{Axis, Place, Position};
use palpate_link::device::{DeviceError, DeviceProblem};
use palpate_link::time::Instant;
use palpate_link::wire::Link;
use palpate_sim::emulator::Shared;
use palpate_sim::scene::{SKIN_CHANNELS_MAX, Scene, SceneDevice, Surroundings, Truth};
use std::sync::{Arc, Mutex};

/// Half the side of the loading area (PAPER S8), mm.
const LOADING_HALF_MM: f64 = 6.0;

/// Distance of the axes from the specimen when an emulated controller is switched on, mm.
const POWER_ON_MM: f64 = 5.0;

/// Reason why an array has no emulator if its units have more channels than a scene supports.
pub(super) const TOO_MANY_CHANNELS: &str =
    "a simulated unit has at most 3 channels: the stress, and its slopes along x and y";

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
    /// The monitors, in the order of the rig.
    pub monitors: Vec<EmulatedMonitor>,
}

/// Time in which a simulated person puts a weight on or takes it off after the request, s.
const PERSON_S: f64 = 2.0;

/// What only the scene of a simulated rig knows or does: the true forces, and the actions of a person. A real rig has no scene, and
/// nothing happens here.
#[derive(Clone)]
pub struct GroundTruth {
    scene: Option<Shared<Scene>>,
    origin: Instant,
}

impl RigSpec {
    /// Whether load cell and array are one device on one port, which sends what both measure.
    pub(super) fn is_one_board(&self) -> bool {
        let is_shared = self.load_cell.link == self.array.link && self.array.link != Link::Sim;
        is_shared && self.load_cell.driver.shares_port() && self.array.driver.shares_port()
    }

    /// Returns the rig's emulators in a scene with this seed.
    ///
    /// # Errors
    /// A device has no emulator.
    pub fn emulators(&self, seed: u64) -> Result<SimulatedRig, DeviceError> {
        if self.array.layout.units().any(|unit| unit.len() > SKIN_CHANNELS_MAX) {
            return Err(not_simulated(SceneDevice::Array, TOO_MANY_CHANNELS.to_owned()));
        }
        if let Some(text) = self.stage.driver.simulated_misfit(self) {
            return Err(not_simulated(SceneDevice::Stage, text));
        }
        let spec = self.scene.clone();
        // the drivers use the rig's values, the scene the true place of the specimen
        let frame =
            spec.mounting.map_or(self.frame, |real| self.frame.moved(real.origin, real.rotation_deg, real.z_mm));
        let away = frame.to_stage(Place::default(), -POWER_ON_MM).z_mm;
        let travel = &self.stage.travel;
        let within = |axis: Axis, mm: f64| mm.clamp(travel.along(axis).min, travel.along(axis).max);
        let setting = Surroundings {
            frame,
            layout: self.array.layout.clone(),
            full_scale_n: self.full_scale_n.unwrap_or(self.limits.force_n),
            half_extent_mm: LOADING_HALF_MM,
            power_on: match self.stage.home {
                Home::ByHand => Position::default(),
                Home::Switches => Position {
                    x_mm: within(Axis::X, self.frame.origin.x_mm + 1.3),
                    y_mm: within(Axis::Y, self.frame.origin.y_mm - 0.8),
                    z_mm: within(Axis::Z, away),
                },
            },
            conversions_hz: self.load_cell.conversions_hz,
            latencies: spec.latencies,
        };
        let scene = Scene::new(spec, setting, seed);
        let stage = self.stage.driver.emulated(&scene, self).on(&self.stage.link);
        let load_cell = self.load_cell.driver.emulated(self, &stage)?.on(&self.load_cell.link);
        let array = match self.is_one_board() {
            true => load_cell.clone(),
            false => self.array.driver.emulated(self)?.on(&self.array.link),
        };
        let monitors = self.monitors.iter().map(|monitor| monitor.emulated(self, &scene)).collect::<Result<_, _>>()?;
        Ok(SimulatedRig { scene: Arc::new(Mutex::new(scene)), stage, load_cell, array, monitors })
    }
}

/// Returns the error of a rig's device that can't be simulated.
pub(super) fn not_simulated(device: SceneDevice, why: String) -> DeviceError {
    let (device, doing) = (device.name().to_owned(), "opening it".to_owned());
    DeviceError { device, doing, problem: DeviceProblem::Mismatch(why) }
}

impl SimulatedRig {
    /// Returns the devices with their roles.
    pub fn devices(&self) -> [(&EmulatedDevice, &'static str); 3] {
        [(&self.stage, SceneDevice::Stage), (&self.load_cell, SceneDevice::LoadCell), (&self.array, SceneDevice::Array)]
            .map(|(device, role)| (device, role.name()))
    }
}

impl GroundTruth {
    pub(crate) fn new(scene: Option<Shared<Scene>>, origin: Instant) -> GroundTruth {
        GroundTruth { scene, origin }
    }

    /// Sets the number of the next press.
    pub fn begin_press(&self, press: u64) {
        self.in_scene(|scene, now_s| scene.begin_press(press, now_s));
    }

    /// Begins to average the true force.
    pub fn open_window(&self) {
        self.in_scene(Scene::open_window);
    }

    /// Ends the average of the true force.
    pub fn close_window(&self) {
        self.in_scene(Scene::close_window);
    }

    /// Returns the true values since the previous call; `None` with a real rig.
    pub fn take(&self) -> Option<Truth> {
        self.in_scene(Scene::take_truth)
    }

    /// Requests a known weight on the tip, along an axis of the specimen; z is the press.
    pub fn put_weight(&self, nominal_n: f64, u_n: f64, along: Axis) {
        self.in_scene(|scene, now_s| scene.put_weight(nominal_n, u_n, along, now_s + PERSON_S));
    }

    /// Requests the removal of the weight.
    pub fn take_weight(&self) {
        self.in_scene(|scene, now_s| scene.take_weight(now_s + PERSON_S));
    }

    fn in_scene<T>(&self, act: impl FnOnce(&mut Scene, f64) -> T) -> Option<T> {
        let scene = self.scene.as_ref()?;
        Some(act(&mut lock(scene), self.origin.elapsed().as_secs_f64()))
    }
}
