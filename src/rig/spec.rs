//! A rig file understood, and what each of its drivers can do.

use super::emulated::EmulatedDevice;
use super::which_way::{Nobody, WhichWay};
use crate::control::{Rule, Timing, Trip};
use crate::device::DeviceError;
use crate::driver::daqmx::SharedAcquisition;
use crate::driver::modbus::Profile;
use crate::driver::{AnyArray, AnyLoadCell, AnyStage};
use crate::emulator::Shared;
use crate::quantity::{
    ArrayLayout, Axis, Certificate, Down, Frame, GAIN_OFF_MOST, Limits, Range, StageCertificate, Travel, WeightCheck,
};
use crate::recipe::Ground;
use crate::scene::{Device, Scene, SceneSpec};
use crate::wire::{ClaimError, Claims, Connector, Link};
use std::any::Any;
use std::cell::OnceCell;
use std::fmt::Debug;
use std::sync::Arc;
use tokio::time::Instant;

/// Clearance above the highest the surface may be, in which the indenter travels before the surface is learned, mm.
const CLEARANCE_MM: f64 = 0.3;

/// How far from the end of its travel the stage waits, mm: not on a switch.
const TOP_MM: f64 = 0.1;

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
    /// The least stiffness that the specimen shows, N/mm: a cell that reads too little makes it look softer; none: not declared.
    pub stiffness_least_n_mm: Option<f64>,
    /// Where the specimen is.
    pub frame: Frame,
    /// Standard uncertainty of either coordinate of its origin, mm; none: it wasn't aligned.
    pub u_origin_mm: Option<f64>,
    /// What is simulated when links are; the paper's where the file has no `[scene]`.
    pub scene: SceneSpec,
    /// The largest force that a simulated sensor and its load cell are made for, N; none: the force limit. A run that continues with a
    /// tighter limit continues with the sensor that it began with.
    pub full_scale_n: Option<f64>,
    /// Who is asked which way z goes before a rig that isn't simulated moves; none: nobody, and it doesn't.
    pub which_way: Option<Arc<dyn WhichWay>>,
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
    /// Fastest approach until the specimen was touched for the first time, mm/s: something hard in the way bears it.
    pub approach_mm_s: f64,
    /// How long it moves on after its controller says that it stands, s.
    pub settle_s: f64,
    /// Its calibration certificate.
    pub certificate: Option<StageCertificate>,
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
    /// What it may say in air, its tool included, N; none: not said.
    pub air_n: Option<Range>,
    /// Its calibration certificate.
    pub certificate: Option<Certificate>,
    /// Its gain as a known weight showed it.
    pub check: Option<WeightCheck>,
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
    /// The largest possible output, + and -, V; none: not known.
    pub range_v: Option<f64>,
    /// The unit of its outputs as it is shown.
    pub unit: String,
}

impl LoadCellSpec {
    /// Standard uncertainty of a force of this size by what is known of the cell, N; none where nothing is. Readings that are
    /// adjusted rest on the check; others rest on the certificate, which a check has confirmed, or on the check alone, whose
    /// deviation isn't corrected.
    pub fn standard_uncertainty_n(&self, force_n: f64) -> Option<f64> {
        match (&self.check, &self.certificate) {
            (Some(check), _) if check.adjusted => Some(check.standard_uncertainty() / check.gain * force_n.abs()),
            (_, Some(certificate)) => Some(certificate.standard_uncertainty_n(force_n)),
            (Some(check), None) => Some(check.standard_uncertainty().hypot(check.gain - 1.0) * force_n.abs()),
            (None, None) => None,
        }
    }

    /// What its readings are divided by.
    pub fn divisor(&self) -> f64 {
        self.check.as_ref().map_or(1.0, WeightCheck::divisor)
    }

    /// Whether its gain can be relied on, as far as a check with a known weight says.
    ///
    /// # Errors
    /// The rule that it breaks.
    pub fn check_gain(&self) -> Result<(), Trip> {
        let certificate = self.certificate.as_ref();
        match self.check.as_ref().filter(|check| !check.is_sound(certificate)) {
            None => Ok(()),
            Some(check) => Err(gain_off(check, certificate)),
        }
    }
}

/// The trip of a gain that is off.
fn gain_off(check: &WeightCheck, certificate: Option<&Certificate>) -> Trip {
    let most = if check.adjusted { GAIN_OFF_MOST } else { check.explained(certificate).min(GAIN_OFF_MOST) };
    Trip::new(Rule::GainOff, 100.0 * (check.gain - 1.0), 100.0 * most, "%")
}

impl RigSpec {
    /// Standard uncertainty of a pressed place along one axis, mm, in the frame of the array: the stage's and, where `align` found
    /// the array, that of its origin; otherwise places count from the calibration's own origin. None without a certificate.
    pub fn u_place_mm(&self) -> Option<f64> {
        let certificate = self.stage.certificate.as_ref()?;
        Some(certificate.standard_uncertainty_mm().hypot(self.u_origin_mm.unwrap_or(0.0)))
    }

    /// The same rig with our emulators instead of its links.
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

    /// Who is asked which way z goes; none where the rig is simulated.
    pub fn which_way(&self) -> Option<&dyn WhichWay> {
        match (&self.which_way, self.is_simulated()) {
            (_, true) => None,
            (Some(which_way), false) => Some(&**which_way),
            (None, false) => Some(&Nobody),
        }
    }

    /// What the load cell may say in air, N: without a word in the file the force limit, either way.
    pub fn air_n(&self) -> Range {
        let limit_n = self.limits.force_n;
        self.load_cell.air_n.unwrap_or(Range { min: -limit_n, max: limit_n })
    }

    /// The end of z's travel that is away from the specimen, mm.
    pub fn end_mm(&self) -> f64 {
        let z = self.stage.travel.along(Axis::Z);
        self.frame.z_from_stage(z.min).min(self.frame.z_from_stage(z.max))
    }

    /// The height that the stage goes to until the specimen was touched: just within the end of its travel that is away, mm.
    pub fn top_mm(&self) -> f64 {
        self.end_mm() + TOP_MM
    }

    /// The z at which nothing of the specimen can be touched, with any surface: the frame's word and a clearance, mm.
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
            Down::Plus => Range { max: z.max.min(end_mm), ..*z },
            Down::Minus => Range { min: z.min.max(end_mm), ..*z },
        };
        travel
    }

    /// How fast the rig is as far as its file says; the links haven't been timed.
    pub fn unmeasured_timing(&self) -> Timing {
        Timing {
            exchange_s: 0.0,
            settle_s: self.stage.settle_s + self.load_cell.lag_s,
            lag_s: self.load_cell.lag_s,
            conversion_s: 1.0 / self.load_cell.conversions_hz,
            acceleration_mm_s2: self.stage.acceleration_mm_s2,
            reaction_s: 0.0,
        }
    }

    /// What a plan is checked against.
    pub fn ground(&self) -> Ground<'_> {
        Ground { travel: &self.stage.travel, frame: &self.frame, limits: &self.limits, layout: &self.array.layout }
    }
}

/// A driver as a rig describes it, whichever role it plays.
pub trait Driver: Any + Debug + Send + Sync {
    /// The link that it has by itself; none: the rig names it.
    fn own_link(&self) -> Option<Link> {
        None
    }

    /// The register map that it goes by, if it has one.
    fn map(&self) -> Option<&MappedDevice> {
        None
    }

    /// Takes its real link for this program alone.
    ///
    /// # Errors
    /// Another program has it.
    fn claim(&self, link: &Link, claims: &mut Claims) -> Result<(), ClaimError> {
        claims.take(link)
    }

    /// What keeps it from working with the rest of the rig.
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        let _ = rig;
        Vec::new()
    }
}

/// A driver that doesn't fit the rest of its rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Misfit {
    /// The role that has to be changed.
    pub role: Device,
    /// What is wrong.
    pub told: String,
    /// What to do.
    pub help: Option<&'static str>,
}

/// A stage.
pub trait StageDriver: Driver {
    /// The driver on its link, which `dial` opens; nothing is sent.
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage;

    /// The emulator that answers it in a simulated rig.
    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice;
}

/// A load cell.
pub trait LoadCellDriver: Driver {
    /// The driver on its link, which `dial` opens; nothing is sent.
    ///
    /// # Errors
    /// It can't play this role, or needs a library that isn't there.
    fn open(&self, dial: Dial, wiring: &Wiring) -> Result<AnyLoadCell, DeviceError>;

    /// The emulator that answers it in a simulated rig, whose stage is `stage`.
    ///
    /// # Errors
    /// There is none.
    fn emulated(&self, rig: &RigSpec, stage: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError>;
}

/// An array.
pub trait ArrayDriver: Driver {
    /// The driver on its link, which `dial` opens; nothing is sent.
    ///
    /// # Errors
    /// It can't play this role, or needs a library that isn't there.
    fn open(&self, dial: Dial, wiring: &Wiring) -> Result<AnyArray, DeviceError>;

    /// The emulator that answers it in a simulated rig.
    ///
    /// # Errors
    /// There is none.
    fn emulated(&self, rig: &RigSpec) -> Result<EmulatedDevice, DeviceError>;

    /// What keeps it from reading all outputs of a layout, and what to do about it.
    fn misfit(&self, layout: &ArrayLayout) -> Option<(String, Option<&'static str>)> {
        let _ = layout;
        None
    }

    /// The largest output that it can give, where it knows, V.
    fn range_v(&self) -> Option<f64> {
        None
    }
}

/// Opens the links of one role, as many as its driver needs.
pub type Dial<'a> = &'a dyn Fn() -> Connector;

/// What a rig's drivers share as they are opened.
pub struct Wiring<'a> {
    /// The rig.
    pub rig: &'a RigSpec,
    /// When its time begins: readings are timed from then.
    pub origin: Instant,
    /// The scene behind a simulated rig.
    pub(super) scene: Option<Shared<Scene>>,
    /// The task that samples all NI inputs, once it is made.
    pub(super) acquisition: OnceCell<SharedAcquisition>,
}

/// A Modbus register map and where it came from.
#[derive(Clone, Debug)]
pub struct MappedDevice {
    /// The name in the rig file: one that came with the program, or a file beside the rig's.
    pub name: String,
    /// The map.
    pub profile: Profile,
    /// The text of a map of the user's own; none where it came with the program.
    pub own_text: Option<String>,
}
