//! The arm: where it stands, what it carries, and its faults.

use super::turn::Turn;
use crate::emulator::faults::{DeviceFault, FaultAfterBytes};

/// An arm and where the scene is in its base frame. The tip of its tool is the scene's indenter.
#[derive(Clone, Debug)]
pub struct UrArm {
    /// Place of the scene's stage origin in the base frame, mm.
    pub origin_mm: [f64; 3],
    /// Unit vectors of the scene's stage x, y and z in the base frame. They are perpendicular to each other.
    pub axes: [[f64; 3]; 3],
    /// Orientation of the tool when the controller starts, as a rotation vector, rad. With it the tool's z, which
    /// points out of the tool, lies along the scene's stage z and points to the specimen.
    pub rotvec_rad: [f64; 3],
    /// Largest distance of the TCP from the base, m.
    pub reach_m: f64,
    /// Step to which targets are rounded along the stage axes, mm; 0 for none. The scene's own step is applied after
    /// it.
    pub step_mm: f64,
    /// Model, as in `UR5e`.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// Standard deviation of each coordinate of the reported pose, mm, and of each rotation, rad: white from one control cycle to the
    /// next. The planned pose has none. [`UrArm::POSE_NOISE`] by default.
    pub pose_noise: (f64, f64),
    /// Error of each component of the reported force, N: a constant offset, a drift over minutes, and noise of a fiftieth.
    pub force_error_n: f64,
    /// Faults.
    pub faults: Vec<UrFault>,
    /// Faults after some bytes at the port of programs.
    pub faults_after_bytes: Vec<UrFaultAfterBytes>,
}

impl UrArm {
    /// Noise of the pose of an arm of the e-Series at rest, mm and rad, from a public recording of 2281 cycles: 12.8, 10.9 and 12.3 um, and
    /// 38, 23 and 43 urad. Means of 25 cycles have 2.9 um there, where white noise has 2.5.
    pub const POSE_NOISE: (f64, f64) = (0.013, 4e-5);
}

impl Default for UrArm {
    /// A UR5e in front of the scene, whose stage axes are those of the base. The tool points down.
    fn default() -> Self {
        UrArm {
            origin_mm: [300.0, -200.0, 100.0],
            axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            rotvec_rad: [std::f64::consts::PI, 0.0, 0.0],
            reach_m: 0.85,
            step_mm: 0.001,
            model: String::from("UR5e"),
            serial: String::from("20195500001"),
            pose_noise: UrArm::POSE_NOISE,
            force_error_n: 4.0,
            faults: Vec::new(),
            faults_after_bytes: Vec::new(),
        }
    }
}

impl UrArm {
    /// Place of the tip in the base frame for a place of the stage, mm.
    pub(super) fn tip_mm(&self, stage_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|n| self.origin_mm[n] + self.along(stage_mm)[n])
    }

    /// Place of the stage for a place of the tip in the base frame, mm.
    pub(super) fn stage_mm(&self, tip_mm: [f64; 3]) -> [f64; 3] {
        self.axes.map(|axis| (0..3).map(|n| axis[n] * (tip_mm[n] - self.origin_mm[n])).sum())
    }

    /// Noise of the pose in a control cycle: of its position, mm, and its rotation vector, rad.
    pub(super) fn noise(&self, cycle: u64) -> ([f64; 3], [f64; 3]) {
        let (place_mm, turn_rad) = self.pose_noise;
        let of = |component: usize, sd: f64| if sd > 0.0 { sd * normal(8 * cycle + component as u64) } else { 0.0 };
        (std::array::from_fn(|n| of(n, place_mm)), std::array::from_fn(|n| of(3 + n, turn_rad)))
    }

    /// Turns a vector along the stage axes into one in the base frame.
    pub(super) fn along(&self, stage: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|n| (0..3).map(|axis| self.axes[axis][n] * stage[axis]).sum())
    }

    /// Force of the environment on the tip that the controller reports when the tip presses with `force_n` along the
    /// taught tool, N, in the base frame.
    pub(super) fn reported_n(&self, force_n: f64, at_s: f64) -> [f64; 3] {
        let true_n = Turn::of(self.rotvec_rad).apply([0.0, 0.0, -force_n]);
        std::array::from_fn(|n| true_n[n] + self.error_n(n, at_s))
    }

    /// Error of a component of the reported force, N.
    fn error_n(&self, component: usize, at_s: f64) -> f64 {
        let phase = component as f64;
        let (offset, drift) = ((1.0 + 2.0 * phase).cos(), (at_s / (700.0 + 200.0 * phase) + phase).sin());
        // the digits that a large factor brings to the front are as good as random
        let noise = ((at_s + phase).sin() * 43_758.545_3).rem_euclid(1.0) - 0.5;
        self.force_error_n * (0.5 * offset + 0.5 * drift + 0.07 * noise)
    }
}

/// A number of a standard normal distribution for a whole number, always the same one: the same cycle is read alike on every link.
fn normal(number: u64) -> f64 {
    // one round of SplitMix64, and the transform of Box and Muller
    let mut bits = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^= bits >> 31;
    let [radius, angle] = [bits >> 32, bits & 0xffff_ffff].map(|half| (half as f64 + 0.5) / 2f64.powi(32));
    (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * angle).cos()
}

/// A fault of the arm or the controller.
pub type UrFault = DeviceFault<UrFaultKind>;
/// A fault of them after some bytes.
pub type UrFaultAfterBytes = FaultAfterBytes<UrFaultKind>;

/// Kinds of fault. Each happens once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UrFaultKind {
    /// The arm decelerates quickly and stays where it is. The program pauses, and another one runs only after
    /// somebody has unlocked the stop.
    ProtectiveStop,
    /// Somebody presses the emergency stop, and it stays pressed. The arm loses its power.
    EmergencyStop,
    /// Somebody moves the speed slider to this fraction.
    SpeedSlider(f64),
    /// All RTDE links are closed, and new ones are for 2 s.
    RtdeLost,
    /// No more data packages are sent. The links stay open and requests are answered.
    RtdeSilent,
    /// Somebody switches the robot to local control.
    LocalControl,
    /// Later motions leave their line in the middle and return to it.
    Sideways {
        /// Largest distance from the line, mm.
        mm: f64,
    },
    /// Later motions turn the tool about its x on their way and back.
    Tilt {
        /// Largest angle, rad.
        rad: f64,
    },
    /// Somebody switches the arm's power off.
    PowerOff,
    /// Another client sends this program, which replaces the one under way. A secondary one, such as
    /// `"sec tool():\n set_tcp(p[0,0,0.01,0,0,0])\nend\n"`, replaces none.
    Other(&'static str),
}
