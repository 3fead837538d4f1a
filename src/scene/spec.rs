//! The physical terms of a scene, and what surrounds it.

use super::faults::Fault;
use super::skin::SkinSpec;
use crate::quantity::{ArrayLayout, Frame, GRAVITY_M_S2, Place, Position};
use std::f64::consts::TAU;

/// The physical terms a scene names; what is `None` or empty isn't modelled.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSpec {
    /// What the taxels read.
    pub skin: SkinSpec,
    /// Relaxed force against depth.
    pub contact: ContactLaw,
    /// What a sudden load adds, and how it decays.
    pub relaxation: Vec<RelaxationBranch>,
    /// How the specimen really lies; none: as the rig says.
    pub mounting: Option<Mounting>,
    /// How far the surface plane may lie from the nominal one, anywhere in the loading area, mm; 0: flat.
    pub surface_tilt_mm: f64,
    /// How the surface rises and sinks in time, mm; none: it doesn't.
    pub surface_wave: Option<Wave>,
    /// What the surface has over its plane; none: nothing.
    pub relief: Option<Relief>,
    /// How the stiffness differs from place to place; none: it doesn't.
    pub stiffness: Option<Stiffness>,
    /// What the stage makes of its controller's motions; none: just those.
    pub stage: Option<Servo>,
    /// What the load cell does to the force; none: it reads the truth.
    pub load_cell: Option<LoadCell>,
    /// How long the devices take to answer.
    pub latencies: Latencies,
    /// What goes wrong, and when.
    pub faults: Vec<Fault>,
}

/// Relaxed contact force against depth s: `linear s + quadratic s^2`, with a parabolic toe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactLaw {
    /// N/mm.
    pub linear_n_mm: f64,
    /// N/mm^2.
    pub quadratic_n_mm2: f64,
    /// Depth over which the tip comes to bear fully, mm; 0: at once.
    pub toe_mm: f64,
}

/// One relaxation branch: `share` of a sudden load is added and decays with `time_s`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelaxationBranch {
    /// Share of the relaxed force, 1.
    pub share: f64,
    /// Time constant, s.
    pub time_s: f64,
}

/// What the surface has over its plane; it belongs to the specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relief {
    /// What the smooth part never exceeds either way, mm.
    pub bumps_mm: f64,
    /// Least and most wavelength of the smooth part, mm.
    pub bumps_wavelength_mm: (f64, f64),
    /// Standard deviation of what each spot of 1 um has for itself, mm.
    pub roughness_mm: f64,
}

/// How the contact curve is stretched from place to place; it belongs to the specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness {
    /// What the smooth part never exceeds either way, % of the curve.
    pub smooth_percent: f64,
    /// Standard deviation of what each spot of 1 um has for itself, % of the curve.
    pub white_percent: f64,
}

/// What the stage makes of its controller's motions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Servo {
    /// How much later than the controller's profile the stage is anywhere, s. The controller calls a motion done when its
    /// profile is, which is that much before the stage rests.
    pub lag_s: f64,
    /// What targets are rounded to a multiple of, mm; 0: they aren't.
    pub quantum_mm: f64,
    /// How far the controller's z moves after it turned round before the indenter follows, mm.
    pub backlash_mm: f64,
}

/// The load cell's imperfections. The force goes through the low-pass, is converted, and can be read after the transport.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadCell {
    /// Standard deviation of one conversion, N.
    pub noise_n: f64,
    /// Standard deviation of the noise that the low-pass has let through, N: what two conversions in a row share of it is the
    /// low-pass' to say.
    pub noise_ahead_n: f64,
    /// What the cell reads with nothing on it when the rig is opened, N.
    pub offset_n: f64,
    /// How fast that grows, N/s.
    pub drift_n_s: f64,
    /// How it comes and goes, slowly; none: it doesn't.
    pub wander: Option<Wave>,
    /// What the mains add, behind the low-pass; none: nothing.
    pub hum: Option<Wave>,
    /// What a newton reads as, N.
    pub gain: f64,
    /// From a conversion to when it can be read, s.
    pub transport_s: f64,
    /// Corner of the first-order low-pass before the converter, Hz; none: there is no low-pass.
    pub low_pass_hz: Option<f64>,
    /// How stiff it and the indenter are between the stage and the specimen, N/mm; none: rigid.
    pub stiffness_n_mm: Option<f64>,
    /// What hangs from it and moves with the stage, kg: it reads the weight, and what it takes to accelerate that.
    pub tool_kg: f64,
}

impl LoadCell {
    /// What it reads of its tool while the stage accelerates toward the specimen, N.
    pub fn tool_n(&self, acceleration_mm_s2: f64) -> f64 {
        self.tool_kg * (acceleration_mm_s2 / 1000.0 - GRAVITY_M_S2)
    }

    /// A cell that reads the truth.
    pub const IDEAL: LoadCell = LoadCell {
        noise_n: 0.0,
        noise_ahead_n: 0.0,
        offset_n: 0.0,
        drift_n_s: 0.0,
        wander: None,
        hum: None,
        gain: 1.0,
        transport_s: 0.0,
        low_pass_hz: None,
        stiffness_n_mm: None,
        tool_kg: 0.0,
    };
}

impl Default for LoadCell {
    fn default() -> Self {
        LoadCell::IDEAL
    }
}

/// A sine of the time since the rig was opened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// How far it goes either way.
    pub amplitude: f64,
    /// How long one turn takes, s.
    pub period_s: f64,
}

impl Wave {
    /// Its value at a time.
    pub fn at(&self, at_s: f64) -> f64 {
        self.amplitude * (TAU * at_s / self.period_s).sin()
    }

    /// How fast it changes at a time, 1/s.
    pub fn slope_at(&self, at_s: f64) -> f64 {
        self.amplitude * TAU / self.period_s * (TAU * at_s / self.period_s).cos()
    }
}

/// A device of a rig, as the scene distinguishes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// The three-axis stage's controller.
    Stage,
    /// The load cell's transmitter.
    LoadCell,
    /// The array's converter.
    Array,
}

impl Device {
    /// All devices.
    pub const ALL: [Device; 3] = [Device::Stage, Device::LoadCell, Device::Array];

    /// The role's name as it stands in a rig file.
    pub fn name(self) -> &'static str {
        ["stage", "load_cell", "array"][self as usize]
    }
}

/// How long each device takes from a request to its answer: least and most, s, uniform between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latencies {
    /// The stage's controller.
    pub stage_s: (f64, f64),
    /// The load cell's transmitter.
    pub load_cell_s: (f64, f64),
    /// The array's converter.
    pub array_s: (f64, f64),
    /// What some exchanges of the stage take longer; none: they don't.
    pub stage_spikes: Option<Spikes>,
}

/// How the specimen really lies, seen from where the rig says it does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounting {
    /// Where its origin is.
    pub origin: Place,
    /// How far it is turned, degrees.
    pub rotation_deg: f64,
    /// How much deeper its surface lies, mm.
    pub z_mm: f64,
}

/// Exchanges that take much longer than others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spikes {
    /// Their share of all, 1.
    pub share: f64,
    /// What they take longer, s.
    pub longer_s: f64,
}

impl Latencies {
    /// The least and the most of one device, s.
    pub fn of(&self, device: Device) -> (f64, f64) {
        match device {
            Device::Stage => self.stage_s,
            Device::LoadCell => self.load_cell_s,
            Device::Array => self.array_s,
        }
    }
}

/// What the scene takes from the rig around it.
#[derive(Clone, Debug, PartialEq)]
pub struct Surroundings {
    /// Where the specimen is in the stage's coordinates.
    pub frame: Frame,
    /// Where the taxels are.
    pub layout: ArrayLayout,
    /// Largest force the taxels are specified for, N: their full scale is the reading for it straight above.
    pub full_scale_n: f64,
    /// Half the side of the loading area in which the surface's tilt is bounded, mm.
    pub half_extent_mm: f64,
    /// Where the axes stand when the controller is switched on, in true stage coordinates.
    pub power_on: Position,
    /// Conversions of the load cell a second.
    pub conversions_hz: f64,
    /// How long the devices take to answer.
    pub latencies: Latencies,
}
