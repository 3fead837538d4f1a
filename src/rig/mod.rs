//! The rig: which driver on which link plays which role, where the specimen is, what it bears.
//!
//! A [`RigSpec`] is a rig file understood. [`RigSpec::open`] is the only place that chooses between a real link and an
//! emulator in memory; behind it everything runs the same driver, the same framing and the same time-outs.

mod compare;
mod driver;
mod family;
mod keys;
mod open;
mod parse;
mod scene;
mod scene_keys;
mod simulated;
mod skin;

pub use compare::{Difference, Verdict, differences};
pub use family::{
    ArrayDriver, Driver, FAMILIES, Family, Links, LoadCellDriver, MappedDevice, Misfit, Role, StageDriver,
};
pub use open::{OpenRig, Wiring};
pub use parse::parse;
pub use simulated::{EmulatedDevice, FarEnd, SceneProbe, SimulatedRig};

use crate::control::Timing;
use crate::document::Keys;
use crate::quantity::{ArrayLayout, Axis, Frame, Limits, Range, Travel};
use crate::scene::SceneSpec;
use crate::wire::Link;
use std::sync::Arc;

/// Every key that a rig may have.
pub const KEYS: Keys = keys::root::KEYS;

/// The paper's rig, simulated, as it is shipped.
pub const SIM_RIG: &str = include_str!("../../rigs/sim.toml");

/// Clearance above the highest the surface may be, in which the indenter travels before the surface is learned, mm.
const CLEARANCE_MM: f64 = 0.3;

/// A rig file, understood.
#[derive(Clone, Debug)]
pub struct RigSpec {
    /// The three-axis stage.
    pub stage: StageSpec,
    /// The load cell.
    pub load_cell: LoadCellSpec,
    /// The sensor array.
    pub array: ArraySpec,
    /// What the specimen bears.
    pub limits: Limits,
    /// Where the specimen is.
    pub frame: Frame,
    /// What is simulated when links are; the paper's where the file has no `[scene]`.
    pub scene: SceneSpec,
    /// The largest force that a simulated sensor and its load cell are made for, N; none: the force limit. A run that goes on with a
    /// tighter limit goes on with the sensor that it began with.
    pub full_scale_n: Option<f64>,
}

/// The stage's part of a rig file.
#[derive(Clone, Debug)]
pub struct StageSpec {
    /// Which driver.
    pub driver: Arc<dyn StageDriver>,
    /// Where it is.
    pub link: Link,
    /// How far the axes may go.
    pub travel: Travel,
    /// Fastest speed to be used, mm/s.
    pub speed_mm_s: f64,
    /// Acceleration to be used, mm/s^2.
    pub acceleration_mm_s2: f64,
    /// How long it moves on after its controller says that it stands, s.
    pub settle_s: f64,
}

/// The load cell's part of a rig file.
#[derive(Clone, Debug)]
pub struct LoadCellSpec {
    /// Which driver.
    pub driver: Arc<dyn LoadCellDriver>,
    /// Where it is.
    pub link: Link,
    /// Conversions a second.
    pub conversions_hz: f64,
    /// How long its filter and its transport hold a force back, s.
    pub lag_s: f64,
}

/// The array's part of a rig file.
#[derive(Clone, Debug)]
pub struct ArraySpec {
    /// Which driver.
    pub driver: Arc<dyn ArrayDriver>,
    /// Where it is.
    pub link: Link,
    /// Its outputs, and where the units are that they belong to.
    pub layout: ArrayLayout,
    /// The largest output it can tell, either way, V; none: not known.
    pub range_v: Option<f64>,
    /// The unit of its outputs as it is shown.
    pub unit: String,
}

impl RigSpec {
    /// The same rig with our emulators in place of its links.
    #[must_use]
    pub fn simulated(mut self) -> RigSpec {
        self.stage.link = Link::Sim;
        self.load_cell.link = Link::Sim;
        self.array.link = Link::Sim;
        self
    }

    /// Whether our emulators are at the far ends: the run then passes in virtual time.
    pub fn is_simulated(&self) -> bool {
        self.stage.link == Link::Sim
    }

    /// The z at which nothing of the specimen can be touched, whatever its surface: the frame's word and a clearance, mm.
    pub fn clear_mm(&self) -> f64 {
        -self.frame.uncertainty_mm - CLEARANCE_MM
    }

    /// How far the axes may go once the specimen counts: z ends where its depth limit does.
    pub fn permitted_travel(&self) -> Travel {
        let deepest_mm = self.frame.uncertainty_mm + self.limits.depth_mm;
        let end_mm = self.frame.to_stage(Default::default(), deepest_mm).z_mm;
        let mut travel = self.stage.travel;
        let z = &mut travel.axes[Axis::Z.index()];
        *z = match self.frame.down {
            crate::quantity::Down::Plus => Range { max: z.max.min(end_mm), ..*z },
            crate::quantity::Down::Minus => Range { min: z.min.max(end_mm), ..*z },
        };
        travel
    }

    /// How fast the rig is as far as its file says; the links haven't been timed.
    pub fn unmeasured_timing(&self) -> Timing {
        Timing {
            exchange_s: 0.0,
            settle_s: self.stage.settle_s + self.load_cell.lag_s,
            conversion_s: 1.0 / self.load_cell.conversions_hz,
            acceleration_mm_s2: self.stage.acceleration_mm_s2,
            reaction_s: 0.0,
        }
    }

    /// What a plan is held against.
    pub fn ground(&self) -> crate::recipe::Ground<'_> {
        crate::recipe::Ground {
            travel: &self.stage.travel,
            frame: &self.frame,
            limits: &self.limits,
            layout: &self.array.layout,
        }
    }
}
