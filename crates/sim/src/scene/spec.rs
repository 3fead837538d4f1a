//! Physical terms of a scene, and its surroundings.

use super::faults::SceneFault;
use super::friction::Friction;
use super::glitches::CorruptSamples;
use super::skin::SkinSpec;
use super::temperature::Temperature;
use palpate_core::quantity::{ArrayLayout, Frame, GRAVITY_M_S2, Place, Position, Tilt};
use std::f64::consts::TAU;

/// Physical terms of a scene. A term that is `None` or empty isn't modelled.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSpec {
    /// Readings of the taxels.
    pub skin: SkinSpec,
    /// Slow change of the taxels' outputs: under a load that stays, each branch grows to `share` of the output without creep. A
    /// negative share lets the output fall.
    pub taxel_creep: Vec<RelaxationBranch>,
    /// Time constant with which the taxels' outputs follow their load, s; `None`: at once. The creep follows the lagged load, and no
    /// branch has this time constant.
    pub taxel_lag_s: Option<f64>,
    /// Change of the taxels by each contact; `None`: no change.
    pub wear: Option<Wear>,
    /// Temperature and its effects; `None`: no effects.
    pub temperature: Option<Temperature>,
    /// Relaxed force as a function of depth.
    pub contact: ContactLaw,
    /// Additional force after a sudden load, and its decay.
    pub relaxation: Vec<RelaxationBranch>,
    /// Real position of the specimen; `None`: as stated in the rig file.
    pub mounting: Option<Mounting>,
    /// Largest distance of the surface plane from the nominal plane, anywhere in the loading area, mm; 0: flat.
    /// It is small, so its cosine isn't modelled.
    pub surface_tilt_mm: f64,
    /// Friction of the tip; `None`: no force sideways but that of a tilt.
    pub friction: Option<Friction>,
    /// Further tilt of the surface plane, whose cosine is modelled: the tip indents along the normal, without friction.
    pub surface_tilt: Tilt,
    /// Rise and fall of the surface over time, mm; `None`: the surface doesn't move.
    pub surface_wave: Option<Sine>,
    /// Height of the surface over its plane; `None`: flat.
    pub relief: Option<Relief>,
    /// Variation of the stiffness from place to place; `None`: constant.
    pub stiffness: Option<Stiffness>,
    /// Change of the stiffness near the specimen's free edges; `None`: no edges. Rig files don't have this term.
    pub edges: Option<Edges>,
    /// Difference of the stage from its controller's motions; `None`: no difference.
    pub stage: Option<Servo>,
    /// Effect of the load cell on the force; `None`: it reads the true force.
    pub load_cell: Option<LoadCellScene>,
    /// Answer times of the devices.
    pub latencies: Latencies,
    /// Faults and their times.
    pub faults: Vec<SceneFault>,
    /// Random seed for the specimen; `None`: that of the run. Runs with the same one press the same specimen.
    pub specimen: Option<u64>,
}

impl SceneSpec {
    /// Returns a scene with these terms and no other.
    pub fn of(skin: SkinSpec, contact: ContactLaw) -> Self {
        SceneSpec {
            skin,
            taxel_creep: Vec::new(),
            taxel_lag_s: None,
            wear: None,
            temperature: None,
            contact,
            relaxation: Vec::new(),
            mounting: None,
            surface_tilt_mm: 0.0,
            friction: None,
            surface_tilt: Tilt::LEVEL,
            surface_wave: None,
            relief: None,
            stiffness: None,
            edges: None,
            stage: None,
            load_cell: None,
            latencies: Latencies {
                stage_s: (0.0, 0.0),
                load_cell_s: (0.0, 0.0),
                array_s: (0.0, 0.0),
                stage_spikes: None,
            },
            faults: Vec::new(),
            specimen: None,
        }
    }
}

/// Relaxed contact force at depth s: `linear s + quadratic s^2`, with a parabolic toe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactLaw {
    /// Linear coefficient, N/mm.
    pub linear_n_mm: f64,
    /// Quadratic coefficient, N/mm^2.
    pub quadratic_n_mm2: f64,
    /// Depth at which the tip is in full contact, mm; 0: at once.
    pub toe_mm: f64,
}

/// One relaxation branch: a fraction `share` of a sudden load is added and decays with `time_s`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelaxationBranch {
    /// Fraction of the relaxed force, 1.
    pub share: f64,
    /// Time constant, s.
    pub time_s: f64,
}

/// Change of every taxel by each contact, the first one included. A contact begins when the tip touches the specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wear {
    /// Change of the gain, as a share of the gain without wear, 1 per contact. The gain falls to 0 at most.
    pub gain_per_press: f64,
    /// Change of the output, loaded or not, reading units per contact.
    pub zero_per_press: f64,
    /// Distance over which a contact wears the gain, mm; infinite: the whole skin.
    pub radius_mm: f64,
}

/// Height of the surface over its plane; it belongs to the specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Relief {
    /// Largest height of the smooth part either way, mm.
    pub bumps_mm: f64,
    /// Smallest and largest wavelength of the smooth part, mm.
    pub bumps_wavelength_mm: (f64, f64),
    /// Each spot of 1 um has its own random height. This is its standard deviation, mm.
    pub roughness_mm: f64,
}

/// Stretch of the contact curve from place to place; it belongs to the specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness {
    /// Largest value of the smooth part either way, % of the curve.
    pub smooth_percent: f64,
    /// Each spot of 1 um has its own random stretch. This is its standard deviation, % of the curve.
    pub white_percent: f64,
}

/// Change of the contact curve near the edges of a square specimen. It decays with the distance from the nearest edge as a normal
/// curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edges {
    /// Change at an edge, % of the curve: negative if the edge is softer.
    pub percent: f64,
    /// Half the side of the specimen, mm.
    pub half_mm: f64,
    /// Distance from an edge at which the change has decayed to `exp(-1/2)`, mm.
    pub width_mm: f64,
}

impl Edges {
    /// Returns the relative change of the force at a place.
    pub(super) fn at(&self, place: Place) -> f64 {
        let within_mm = (self.half_mm - place.x_mm.abs().max(place.y_mm.abs())).max(0.0);
        self.percent / 100.0 * (-0.5 * (within_mm / self.width_mm).powi(2)).exp()
    }
}

/// Difference of the stage from its controller's motions.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Servo {
    /// Delay of the stage relative to the controller's profile, s. The controller reports a motion as done at the end of its
    /// profile; the stage comes to rest later by this time.
    pub lag_s: f64,
    /// Step to which targets are rounded, mm; 0: no rounding.
    pub quantum_mm: f64,
    /// Distance that the controller's z moves after a reversal before the indenter follows, mm.
    pub backlash_mm: f64,
}

/// Imperfections of the load cell. The force goes through the low-pass, is converted, and can be read after the transport.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadCellScene {
    /// Standard deviation of one conversion, N.
    pub noise_n: f64,
    /// Standard deviation of the noise after the low-pass, N. The low-pass determines the correlation between two successive
    /// conversions.
    pub noise_ahead_n: f64,
    /// Cell reading without load when the rig is opened, N.
    pub offset_n: f64,
    /// Drift of this offset, N/s.
    pub drift_n_s: f64,
    /// Slow periodic change of this offset; `None`: no such change.
    pub slow_drift: Option<Sine>,
    /// Mains interference, added after the low-pass; `None`: no mains interference.
    pub mains: Option<Sine>,
    /// Reading for a force of one newton, N.
    pub gain: f64,
    /// Time from a conversion until it can be read, s.
    pub transport_s: f64,
    /// Corner of the first-order low-pass before the converter, Hz; `None`: there is no low-pass.
    pub low_pass_hz: Option<f64>,
    /// Stiffness of load cell and indenter between the stage and the specimen, N/mm; `None`: rigid.
    pub stiffness_n_mm: Option<f64>,
    /// Mass that hangs from the cell and moves with the stage, kg. The cell reads its weight and the force of its acceleration.
    pub tool_kg: f64,
    /// Share of a force that each other axis of a cell with three axes reads too.
    pub crosstalk: f64,
    /// How the axes x and y of a cell with three axes differ from what the rig states.
    pub side_axes: SideAxes,
    /// Corrupt samples; `None`: no such samples.
    pub glitches: Option<CorruptSamples>,
}

/// Difference of the axes x and y from what the rig states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SideAxes {
    /// None.
    #[default]
    AsStated,
    /// x reads the force along y, and y that along x.
    Swapped,
    /// x reads with the wrong sign.
    Mirrored,
    /// x reads only noise.
    Dead,
}

impl LoadCellScene {
    /// Force reading caused by the tool while the stage accelerates toward the specimen, N.
    pub(crate) fn tool_n(&self, acceleration_mm_s2: f64) -> f64 {
        self.tool_kg * (acceleration_mm_s2 / 1000.0 - GRAVITY_M_S2)
    }

    /// A cell that reads the true force.
    pub const IDEAL: LoadCellScene = LoadCellScene {
        noise_n: 0.0,
        noise_ahead_n: 0.0,
        offset_n: 0.0,
        drift_n_s: 0.0,
        slow_drift: None,
        mains: None,
        gain: 1.0,
        transport_s: 0.0,
        low_pass_hz: None,
        stiffness_n_mm: None,
        tool_kg: 0.0,
        crosstalk: 0.0,
        side_axes: SideAxes::AsStated,
        glitches: None,
    };
}

impl Default for LoadCellScene {
    fn default() -> Self {
        LoadCellScene::IDEAL
    }
}

/// A sine of the time since the rig was opened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sine {
    /// Amplitude either way.
    pub amplitude: f64,
    /// Duration of one period, s.
    pub period_s: f64,
}

impl Sine {
    /// Value of the wave at a time.
    pub fn at(&self, at_s: f64) -> f64 {
        self.amplitude * (TAU * at_s / self.period_s).sin()
    }

    /// Slope of the wave at a time, 1/s.
    pub(crate) fn slope_at(&self, at_s: f64) -> f64 {
        self.amplitude * TAU / self.period_s * (TAU * at_s / self.period_s).cos()
    }
}

/// A device of a rig, as the scene distinguishes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneDevice {
    /// The three-axis stage's controller.
    Stage,
    /// The load cell's transmitter.
    LoadCell,
    /// The array's converter.
    Array,
}

impl SceneDevice {
    /// All devices.
    pub const ALL: [SceneDevice; 3] = [SceneDevice::Stage, SceneDevice::LoadCell, SceneDevice::Array];

    /// Name of the role in a rig file.
    pub fn name(self) -> &'static str {
        ["stage", "load_cell", "array"][self as usize]
    }
}

/// Time of each device from a request to its answer: smallest and largest value, s, uniform between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latencies {
    /// The stage's controller.
    pub stage_s: (f64, f64),
    /// The load cell's transmitter.
    pub load_cell_s: (f64, f64),
    /// The array's converter.
    pub array_s: (f64, f64),
    /// Additional time of some exchanges of the stage; `None`: no additional time.
    pub stage_spikes: Option<Spikes>,
}

/// Real position of the specimen, relative to the position in the rig file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounting {
    /// Position of its origin.
    pub origin: Place,
    /// Rotation, degrees.
    pub rotation_deg: f64,
    /// Additional depth of its surface, mm.
    pub z_mm: f64,
}

/// Exchanges that take much longer than others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spikes {
    /// Fraction of all exchanges, 1.
    pub share: f64,
    /// Additional time of such an exchange, s.
    pub longer_s: f64,
}

impl Latencies {
    /// Smallest and largest answer time of one device, s.
    pub fn of(&self, device: SceneDevice) -> (f64, f64) {
        match device {
            SceneDevice::Stage => self.stage_s,
            SceneDevice::LoadCell => self.load_cell_s,
            SceneDevice::Array => self.array_s,
        }
    }
}

/// Data that the scene takes from its rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Surroundings {
    /// Position of the specimen in stage coordinates.
    pub frame: Frame,
    /// Positions of the taxels.
    pub layout: ArrayLayout,
    /// Largest specified force of the taxels, N. Their full scale is the reading for this force straight above.
    pub full_scale_n: f64,
    /// Half the side of the loading area in which the surface's tilt is bounded, mm.
    pub half_extent_mm: f64,
    /// Positions of the axes at power-on of the controller, in true stage coordinates.
    pub power_on: Position,
    /// Conversions of the load cell per second.
    pub conversions_hz: f64,
    /// Answer times of the devices.
    pub latencies: Latencies,
}
