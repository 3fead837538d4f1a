//! A parsed rig file, and the capabilities of each of its drivers.

use super::axes::CellAxes;
use super::emulated::EmulatedDevice;
use super::monitor::MonitorSpec;
use super::no_load_cell::WithoutLoadCell;
use super::which_way::{Unattended, WhichWay};
use palpate_control::{DragLimits, SafetyRule, Timing, Trip, depth_without_force_mm};
use palpate_core::quantity::{
    ArrayLayout, AxesCheck, Axis, Down, Frame, GAIN_OFF_MOST, Limits, LoadCellCertificate, Range, StageAbilities,
    StageCertificate, Steps, Travel, WeightCheck,
};
use palpate_data::recipe::Ground;
use palpate_drivers::daqmx::SharedAcquisition;
use palpate_drivers::lines::{LinePort, LineProfile};
use palpate_drivers::{AnyArray, AnyLoadCell, AnyStage};
use palpate_link::device::DeviceError;
use palpate_link::time::Instant;
use palpate_link::wire::{ClaimError, Claims, Connector, Link};
use palpate_sim::emulator::{STAGE_TRAVEL_MM, Shared};
use palpate_sim::scene::{Scene, SceneDevice, SceneSpec};
use std::any::Any;
use std::cell::{OnceCell, RefCell};
use std::fmt::Debug;
use std::sync::Arc;

/// Clearance above the highest possible surface at which the indenter travels before the surface is learned, mm.
const CLEARANCE_MM: f64 = 0.3;

/// Distance of the waiting stage from the end of its travel, mm, so that it isn't on a switch.
const TOP_MM: f64 = 0.1;

/// A parsed rig file.
#[derive(Clone, Debug)]
pub struct RigSpec {
    /// The three-axis stage.
    pub stage: StageSpec,
    /// The load cell.
    pub load_cell: LoadCellSpec,
    /// The sensor array.
    pub array: ArraySpec,
    /// Slow devices that are read between presses.
    pub monitors: Vec<MonitorSpec>,
    /// Limits of the specimen.
    pub limits: Limits,
    /// Smallest apparent stiffness of the specimen, N/mm; `None` if not declared. A load cell that reads too little makes the
    /// specimen look softer.
    pub stiffness_least_n_mm: Option<f64>,
    /// What a drag in contact may do; `None`: x and y never move in contact.
    pub drag: Option<DragLimits>,
    /// Position of the specimen.
    pub frame: Frame,
    /// Standard uncertainty of either coordinate of the specimen's origin, mm; `None` if it wasn't aligned.
    pub u_origin_mm: Option<f64>,
    /// Scene that is simulated if links are simulated; the paper's scene if the file has no `[scene]`.
    pub scene: SceneSpec,
    /// Largest force for which a simulated sensor and its load cell are designed, N; `None` for the force limit. A run that
    /// continues with a tighter limit keeps the sensor with which it began.
    pub full_scale_n: Option<f64>,
    /// Command of the program that is notified of events; empty without one.
    pub notify: Vec<String>,
    /// Source of the direction of z, asked before a rig that isn't simulated moves. If `None`, the rig doesn't move.
    pub which_way: Option<Arc<dyn WhichWay>>,
    /// Whether a person touched the surface in steps, and confirms that it is where the frame states, within its uncertainty. Only a rig
    /// without a load cell needs it, and only if its array doesn't feel the surface.
    pub is_touched: bool,
}

/// Stage section of a rig file.
#[derive(Clone, Debug)]
pub struct StageSpec {
    /// Driver of the stage.
    pub driver: Arc<dyn StageDriver>,
    /// Link of the stage.
    pub link: Link,
    /// Allowed travel of the axes.
    pub travel: Travel,
    /// Largest speed to be used, mm/s.
    pub speed_mm_s: f64,
    /// Acceleration to be used, mm/s^2.
    pub acceleration_mm_s2: f64,
    /// Largest approach speed before the specimen is touched for the first time, mm/s. A hard object in the way tolerates this
    /// speed.
    pub approach_mm_s: f64,
    /// Time during which the stage still moves after its controller reports standstill, s.
    pub settle_s: f64,
    /// Steps of the axes.
    pub steps: Steps,
    /// Calibration certificate of the stage.
    pub certificate: Option<StageCertificate>,
    /// Stiffness of the stage itself, N/mm; `None` if not stated.
    pub stiffness_n_mm: Option<f64>,
    /// How the position of the axes becomes known.
    pub home: Home,
    /// End of z at which the stage homes, as seen from the specimen.
    pub home_side: HomeSide,
    /// Count of z at the limit where it homes, mm; `None`: the end of its travel. Only for controllers that let the program choose it.
    pub home_z_mm: Option<f64>,
    /// Whether axes whose motors are on are homed; only for controllers that don't report it.
    pub homed: bool,
    /// Whether z stays where it is without power, so that the last resort may cut it.
    pub z_holds_unpowered: bool,
}

/// How the position of the axes becomes known at each start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Home {
    /// The controller searches for its switches.
    Switches,
    /// A person brings the axes to the rig's zero and confirms it. There are no switches, and no limits but this program's.
    ByHand,
}

/// End of z at which a stage homes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomeSide {
    /// Away from the specimen.
    Away,
    /// On the specimen's side. A person confirms before each search that nothing is in the way.
    Toward,
}

/// Load cell section of a rig file.
#[derive(Clone, Debug)]
pub struct LoadCellSpec {
    /// Driver of the load cell.
    pub driver: Arc<dyn LoadCellDriver>,
    /// Link of the load cell.
    pub link: Link,
    /// Conversion rate, 1/s.
    pub conversions_hz: f64,
    /// Delay of a force by the load cell's filter and transport, s.
    pub lag_s: f64,
    /// Allowed reading without load, with the tool, N; `None` if not stated.
    pub air_n: Option<Range>,
    /// Stiffness of the cell itself, N/mm; `None` if not stated.
    pub stiffness_n_mm: Option<f64>,
    /// Mounting of a cell with three axes; `None` for a cell with one.
    pub axes: Option<CellAxes>,
    /// Calibration certificate of the load cell.
    pub certificate: Option<LoadCellCertificate>,
    /// Gain measured with a known weight.
    pub check: Option<WeightCheck>,
    /// Gains and crosstalk of three axes, measured with a known weight along each.
    pub axes_check: Option<AxesCheck>,
}

/// Array section of a rig file.
#[derive(Clone, Debug)]
pub struct ArraySpec {
    /// Driver of the array.
    pub driver: Arc<dyn ArrayDriver>,
    /// Link of the array.
    pub link: Link,
    /// Outputs of the array, and the positions of their units.
    pub layout: ArrayLayout,
    /// Largest possible output, + and -, V; `None` if unknown.
    pub range_v: Option<f64>,
    /// Unit of the outputs, as displayed.
    pub unit: String,
}

impl LoadCellSpec {
    /// Returns the standard uncertainty of a force of this size, N, from the data about the cell; `None` if there are no data.
    /// For adjusted readings the check is used. For other readings the certificate is used; a check only confirms it. Without a
    /// certificate the check is used, whose deviation isn't corrected.
    pub fn standard_uncertainty_n(&self, force_n: f64) -> Option<f64> {
        match (&self.check, &self.certificate) {
            (Some(check), _) if check.adjusted => Some(check.standard_uncertainty() / check.gain * force_n.abs()),
            (_, Some(certificate)) => Some(certificate.standard_uncertainty_n(force_n)),
            (Some(check), None) => Some(check.standard_uncertainty().hypot(check.gain - 1.0) * force_n.abs()),
            (None, None) => None,
        }
    }

    /// Returns the standard uncertainties of forces along x, y and the press, N, from the data about the cell; `None` if there are no data.
    /// A certificate is about each axis. Without one, the gains of x and y are those of a check along the axes.
    pub fn axes_uncertainty_n(&self, forces_n: [f64; 3]) -> Option<[f64; 3]> {
        let own_n = |axis: usize| match (&self.certificate, &self.axes_check) {
            _ if axis == 2 => self.standard_uncertainty_n(forces_n[axis]),
            (Some(certificate), _) => Some(certificate.standard_uncertainty_n(forces_n[axis])),
            (None, Some(check)) => Some(check.gain_u(axis) * forces_n[axis].abs()),
            (None, None) => None,
        };
        let [x_n, y_n, press_n] = [own_n(0)?, own_n(1)?, own_n(2)?];
        let others_n = self.axes_check.as_ref().map_or([0.0; 3], |check| check.crosstalk_n(forces_n));
        Some([x_n.hypot(others_n[0]), y_n.hypot(others_n[1]), press_n.hypot(others_n[2])])
    }

    /// Returns the divisor of the readings.
    pub fn divisor(&self) -> f64 {
        self.check.as_ref().map_or(1.0, WeightCheck::divisor)
    }

    /// Checks whether the gain is reliable according to a check with a known weight.
    ///
    /// # Errors
    /// The rule that the gain breaks.
    pub fn check_gain(&self) -> Result<(), Trip> {
        let certificate = self.certificate.as_ref();
        match self.check.as_ref().filter(|check| !check.is_sound(certificate)) {
            None => Ok(()),
            Some(check) => Err(gain_off(check, certificate)),
        }
    }
}

/// Returns the trip for a gain with too large an error.
fn gain_off(check: &WeightCheck, certificate: Option<&LoadCellCertificate>) -> Trip {
    let most = if check.adjusted { GAIN_OFF_MOST } else { check.explained(certificate).min(GAIN_OFF_MOST) };
    Trip::new(SafetyRule::GainOff, 100.0 * (check.gain - 1.0), 100.0 * most, "%")
}

impl RigSpec {
    /// Returns the standard uncertainty of a pressed place along one axis, mm, in the frame of the array. It contains the stage's
    /// uncertainty. If `align` found the array, it also contains that of its origin; otherwise places are relative to the
    /// calibration's own origin. `None` without a certificate.
    pub fn u_place_mm(&self) -> Option<f64> {
        let certificate = self.stage.certificate.as_ref()?;
        Some(certificate.standard_uncertainty_mm().hypot(self.u_origin_mm.unwrap_or(0.0)))
    }

    /// Returns the standard uncertainty of a depth, mm, from that of the touched surface, that of the stage, and the deflections of the load
    /// cell and of the stage under this force. A deflection isn't subtracted: the true one is anywhere from none to force over stiffness.
    /// `None` if the stage has no certificate, or the stiffness of the load cell or of an arm isn't stated.
    pub fn u_depth_mm(&self, touch_sigma_mm: f64, force_n: f64) -> Option<f64> {
        let stage_mm = self.stage.certificate.as_ref()?.standard_uncertainty_mm();
        let deflection_mm = if self.has_load_cell() { force_n / self.load_cell.stiffness_n_mm? } else { 0.0 };
        // without a load cell the force may be any up to the limit
        let most_n = if self.has_load_cell() { force_n } else { self.limits.force_n };
        let bent_mm = match self.stage.stiffness_n_mm {
            Some(stiffness_n_mm) => most_n / stiffness_n_mm,
            None if self.stage.driver.bends() => return None,
            None => 0.0,
        };
        let deflections_mm = deflection_mm.hypot(bent_mm) / 3f64.sqrt();
        Some(touch_sigma_mm.hypot(stage_mm).hypot(deflections_mm))
    }

    /// Returns the same rig with this program's emulators instead of its links. A serial line keeps its rate.
    #[must_use]
    pub fn simulated(mut self) -> RigSpec {
        let monitors = self.monitors.iter_mut().map(|monitor| &mut monitor.array.link);
        for link in [&mut self.stage.link, &mut self.load_cell.link, &mut self.array.link].into_iter().chain(monitors) {
            *link = std::mem::replace(link, Link::Sim).emulated();
        }
        self
    }

    /// Returns the simulated rig on links without a rate.
    #[must_use]
    pub fn without_links(mut self) -> RigSpec {
        self = self.simulated();
        (self.stage.link, self.load_cell.link, self.array.link) = (Link::Sim, Link::Sim, Link::Sim);
        self
    }

    /// Whether there is a load cell. Without one, presses are by depth.
    pub fn has_load_cell(&self) -> bool {
        let driver: &dyn Any = &*self.load_cell.driver;
        !driver.is::<WithoutLoadCell>()
    }

    /// Returns the largest depth of a press without a load cell, mm. If the surface is confirmed by a person, its uncertainty takes a part.
    pub fn unforced_mm(&self, is_touched: bool) -> f64 {
        depth_without_force_mm(&self.limits) - if is_touched { self.frame.uncertainty_mm } else { 0.0 }
    }

    /// Whether this program's emulators are at the far ends. The run then uses virtual time.
    pub fn is_simulated(&self) -> bool {
        self.stage.link.is_simulated()
    }

    /// Returns the source of the direction of z; `None` if the rig is simulated.
    pub fn which_way(&self) -> Option<&dyn WhichWay> {
        match (&self.which_way, self.is_simulated()) {
            (_, true) => None,
            (Some(which_way), false) => Some(&**which_way),
            (None, false) => Some(&Unattended),
        }
    }

    /// Returns the allowed reading of the load cell without load, N. If the file states none, it is the force limit in both directions.
    pub fn air_n(&self) -> Range {
        let limit_n = self.limits.force_n;
        self.load_cell.air_n.unwrap_or(Range { min: -limit_n, max: limit_n })
    }

    /// Returns the end of z's travel away from the specimen, mm.
    pub fn end_mm(&self) -> f64 {
        let z = self.stage.travel.along(Axis::Z);
        self.frame.z_from_stage(z.min).min(self.frame.z_from_stage(z.max))
    }

    /// Returns the height of the stage before the specimen is touched for the first time, mm. It is slightly inside the end of
    /// its travel away from the specimen.
    pub fn top_mm(&self) -> f64 {
        self.end_mm() + TOP_MM
    }

    /// Returns the z at which the indenter can't touch any surface of the specimen, mm: the height stated by the frame plus a
    /// clearance.
    pub fn clear_mm(&self) -> f64 {
        -self.frame.uncertainty_mm - CLEARANCE_MM
    }

    /// Returns the allowed travel of the axes when the specimen is considered; z ends at the depth limit.
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

    /// Returns the timing of the rig according to its file, without measured link times.
    pub(crate) fn unmeasured_timing(&self) -> Timing {
        Timing {
            exchange_s: 0.0,
            settle_s: self.stage.settle_s + self.load_cell.lag_s,
            lag_s: self.load_cell.lag_s,
            conversion_s: 1.0 / self.load_cell.conversions_hz,
            acceleration_mm_s2: self.stage.acceleration_mm_s2,
            reaction_s: 0.0,
        }
    }

    /// Whether the load cell has three axes.
    pub fn has_three_axes(&self) -> bool {
        self.load_cell.axes.is_some()
    }

    /// Returns the limits against which a plan is checked.
    pub fn ground(&self) -> Ground<'_> {
        Ground {
            travel: &self.stage.travel,
            frame: &self.frame,
            limits: &self.limits,
            layout: &self.array.layout,
            drag: self.drag,
            three_axes: self.has_three_axes(),
            abilities: self.stage.driver.abilities(),
            steps: self.stage.steps,
            is_slippery: self.is_simulated() && self.scene.friction.is_none(),
            unforced_mm: (!self.has_load_cell()).then(|| self.unforced_mm(self.is_touched)),
        }
    }
}

/// A driver as described by a rig, in any role.
pub trait Driver: Any + Debug + Send + Sync {
    /// Returns the driver's own link. `None` if the rig has to name the link.
    fn own_link(&self) -> Option<Link> {
        None
    }

    /// Returns the text that describes the driver's device, if it has one.
    fn own_file(&self) -> Option<&OwnFile> {
        None
    }

    /// Claims what the driver's real link opens exclusively for this program.
    ///
    /// # Errors
    /// Returns an error if another program uses the device.
    fn claim(&self, link: &Link, claims: &mut Claims) -> Result<(), ClaimError> {
        claims.take(link)
    }

    /// Whether several programs can read the device through this link, so that it can be a monitor of several rigs.
    fn serves_several(&self, link: &Link) -> bool {
        let _ = link;
        false
    }

    /// Whether a load cell and an array with this driver can be one device on one serial port.
    fn shares_port(&self) -> bool {
        false
    }

    /// Returns the reasons why the driver can't work with the rest of the rig.
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        let _ = rig;
        Vec::new()
    }
}

/// A driver that is incompatible with the rest of its rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Misfit {
    /// Role that must be changed.
    pub role: SceneDevice,
    /// Description of the problem.
    pub text: String,
    /// Suggested correction.
    pub help: Option<&'static str>,
}

/// What ends a motion that no stop has ended, as [`abort`](palpate_link::device::Stage::abort) sends it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LastResort {
    /// This keeps z powered.
    KeepsPower(&'static str),
    /// This cuts the power, so it is sent only if z holds without it.
    CutsPower(&'static str),
}

/// Driver of a stage.
pub trait StageDriver: Driver {
    /// Returns the driver on its link, which `dial` opens. Nothing is sent.
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage;

    /// Returns the emulator that answers the driver in a simulated rig.
    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice;

    /// Returns the reason why its emulator can't have the travel of this rig, and a travel that it can have; `None` if it fits.
    fn simulated_misfit(&self, rig: &RigSpec) -> Option<String> {
        outside_stock(rig)
    }

    /// Whether it can home z on the specimen's side, and reports whether home is known.
    fn homes_toward(&self) -> bool {
        false
    }

    /// Returns what it can do in a motion.
    fn abilities(&self) -> StageAbilities {
        StageAbilities::FULL
    }

    /// Returns what ends a motion that no stop has ended.
    fn last_resort(&self) -> LastResort {
        LastResort::KeepsPower("its stop")
    }

    /// Whether it gives way under a force as an arm does, so that its position isn't that of the tip.
    fn bends(&self) -> bool {
        false
    }

    /// Whether its axes can do without switches, so that a person brings them to the rig's zero.
    fn homes_by_hand(&self) -> bool {
        false
    }
}

/// Returns the reason why z of an emulated stage of the usual travel can't have the travel of this rig. z travels to its end to
/// retract. x and y go no further than to where they press.
pub(super) fn outside_stock(rig: &RigSpec) -> Option<String> {
    let z = rig.stage.travel.along(Axis::Z);
    let most = Range { min: -STAGE_TRAVEL_MM, max: STAGE_TRAVEL_MM };
    (z.min < most.min || z.max > most.max).then(|| {
        format!(
            "z of a simulated stage goes from {} to {} mm, and `stage.travel_mm.z` has {} to {}: narrow it for a simulated run",
            most.min, most.max, z.min, z.max
        )
    })
}

/// Driver of a load cell.
pub trait LoadCellDriver: Driver {
    /// Returns the driver on its link, which `dial` opens. Nothing is sent.
    ///
    /// # Errors
    /// Returns an error if the driver can't play this role, or needs a library that is missing.
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyLoadCell, DeviceError>;

    /// Returns the emulator that answers the driver in a simulated rig with the stage `stage`.
    ///
    /// # Errors
    /// Returns an error if there is no emulator.
    fn emulated(&self, rig: &RigSpec, stage: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError>;

    /// Whether its readings have forces along three axes. The rig states then how it is mounted.
    fn has_axes(&self) -> bool {
        false
    }

    /// Counts per N that its readings are scaled by, if it is a Net F/T, whose web page states them too.
    fn net_ft_counts(&self) -> Option<f64> {
        None
    }
}

/// Driver of an array.
pub trait ArrayDriver: Driver {
    /// Returns the driver on its link, which `dial` opens. Nothing is sent.
    ///
    /// # Errors
    /// Returns an error if the driver can't play this role, or needs a library that is missing.
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyArray, DeviceError>;

    /// Returns the emulator that answers the driver in a simulated rig.
    ///
    /// # Errors
    /// Returns an error if there is no emulator.
    fn emulated(&self, rig: &RigSpec) -> Result<EmulatedDevice, DeviceError>;

    /// Returns the reason why the driver can't read all outputs of a layout, and advice.
    fn misfit(&self, layout: &ArrayLayout) -> Option<(String, Option<&'static str>)> {
        let _ = layout;
        None
    }

    /// Returns the largest possible output of the driver, if known, V.
    fn range_v(&self) -> Option<f64> {
        None
    }
}

/// Opens the links of one role, as many as its driver requires.
#[derive(Clone, Copy)]
pub struct Dial<'a>(pub &'a dyn Fn(Option<u16>) -> Connector);

impl Dial<'_> {
    /// Returns the rig's link.
    pub fn link(self) -> Connector {
        (self.0)(None)
    }

    /// Returns a link to another TCP port of the device.
    pub fn port(self, port: u16) -> Connector {
        (self.0)(Some(port))
    }
}

/// Data shared by a rig's drivers when they are opened.
pub struct RigWiring<'a> {
    /// The rig.
    pub rig: &'a RigSpec,
    /// Start of the rig's time, from which readings are timed.
    pub origin: Instant,
    /// Scene of a simulated rig.
    pub(super) scene: Option<Shared<Scene>>,
    /// Task that samples all NI inputs, after it was created.
    pub(super) acquisition: OnceCell<SharedAcquisition>,
    /// Ports of devices that send lines, after they were created.
    pub(super) line_ports: RefCell<Vec<(Link, LinePort)>>,
}

/// A text that describes a device, such as a register map or a line profile, and its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct OwnFile {
    /// Name in the rig file: a text that is part of the program, or a file in the rig's folder.
    pub name: String,
    /// Text of the user's own file; `None` for one that is part of the program.
    pub text: Option<String>,
}

impl OwnFile {
    /// Says why the device that the text describes can't be simulated.
    pub(super) fn not_simulated(&self, why: &str) -> String {
        format!("\"{}\" can't be simulated: {why}", self.name)
    }
}

impl<'a> RigWiring<'a> {
    /// Creates the data of a rig none of whose drivers has been opened.
    pub(super) fn new(rig: &'a RigSpec, scene: Option<Shared<Scene>>, origin: Instant) -> Self {
        RigWiring { rig, origin, scene, acquisition: OnceCell::new(), line_ports: RefCell::default() }
    }

    /// Returns the port behind a link, which the roles on this link share.
    pub(super) fn line_port(&self, link: &Link, profile: &LineProfile, dial: Dial) -> LinePort {
        let mut ports = self.line_ports.borrow_mut();
        let known = ports.iter().find(|(known, _)| *link != Link::Sim && known == link);
        if let Some((_, port)) = known {
            return port.clone();
        }
        let port = LinePort::new(dial.link(), profile.clone());
        ports.push((link.clone(), port.clone()));
        port
    }
}
