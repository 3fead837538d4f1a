//! One positioner of a group: its place, speeds and limits.

use crate::scene::{Scene, Trajectory};
use palpate_core::quantity::Axis;

/// Travel of a VP-25XL to either side of its middle, mm (its file in a public XPS configuration).
pub(super) const TRAVEL_MM: f64 = crate::emulator::STAGE_TRAVEL_MM;
/// Largest speed of a VP-25XL, mm/s (same file).
pub(super) const SPEED_MOST_MM_S: f64 = 25.0;
/// Largest acceleration of a VP-25XL, mm/s^2 (same file).
pub(super) const ACCELERATION_MOST_MM_S2: f64 = 100.0;
/// Ratio of the emergency deceleration to the normal one (same file: 1 or 4).
const EMERGENCY_FACTOR: f64 = 4.0;
/// Speed and acceleration of homing, mm/s and mm/s^2.
const HOME_SPEED_MM_S: f64 = 5.0;
const HOME_ACCELERATION_MM_S2: f64 = 50.0;
/// Least and largest jerk time, s (same file).
const JERK_S: (f64, f64) = (0.005, 0.05);
/// Largest distance of a target beyond a limit that counts as rounding, mm.
const ROUNDING_MM: f64 = 1e-9;

// hardware status (as EPICS reads it)
const ABOVE_HOME: u32 = 0x0000_0004;
const END_MINUS: u32 = 0x8000_0100;
const END_PLUS: u32 = 0x8000_0200;

/// One positioner of a group: a VP-25XL and the controller's knowledge of it. Places are true places in stage coordinates,
/// unless a name contains `count`. A count is the controller's assumed place, which is wrong by `offset_mm` until the positioner
/// is homed.
pub(super) struct EmulatedPositioner {
    pub name: String,
    pub axis: Axis,
    /// True place minus count, mm.
    offset_mm: f64,
    pub s_gamma: SGamma,
    /// Smallest and largest allowed count of a target, mm.
    pub limits_mm: (f64, f64),
}

/// Motion parameters of a positioner. The jerk times are stored and reported, and have no other effect, because the scene's axes
/// change their acceleration at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SGamma {
    pub speed_mm_s: f64,
    pub acceleration_mm_s2: f64,
    pub jerk_s: (f64, f64),
}

impl SGamma {
    /// Whether a VP-25XL can do this.
    pub(super) fn is_sound(&self) -> bool {
        let SGamma { speed_mm_s, acceleration_mm_s2, jerk_s } = *self;
        speed_mm_s > 0.0
            && speed_mm_s <= SPEED_MOST_MM_S
            && acceleration_mm_s2 > 0.0
            && acceleration_mm_s2 <= ACCELERATION_MOST_MM_S2
            && jerk_s.0 > 0.0
            && jerk_s.0 <= jerk_s.1
    }
}

impl EmulatedPositioner {
    /// Creates a positioner at power-on: its present place counts as zero.
    pub(super) fn new(name: &str, axis: Axis, scene: &Scene) -> Self {
        let s_gamma =
            SGamma { speed_mm_s: SPEED_MOST_MM_S, acceleration_mm_s2: ACCELERATION_MOST_MM_S2, jerk_s: JERK_S };
        let mut positioner =
            EmulatedPositioner { name: name.into(), axis, offset_mm: 0.0, s_gamma, limits_mm: (-TRAVEL_MM, TRAVEL_MM) };
        positioner.reset_encoder(scene);
        positioner
    }

    /// Makes the encoder count from the present place of the positioner.
    pub(super) fn reset_encoder(&mut self, scene: &Scene) {
        self.offset_mm = scene.motion(self.axis).end_mm();
    }

    /// Notes that the home mark is found, so the count is true.
    pub(super) fn set_homed(&mut self) {
        self.offset_mm = 0.0;
    }

    /// Position as a count, mm.
    pub(super) fn count_mm(&self, scene: &mut Scene, now_s: f64) -> f64 {
        scene.axis(self.axis, now_s).0 - self.offset_mm
    }

    /// Present setpoint of the controller as a count, mm.
    pub(super) fn setpoint_mm(&self, scene: &Scene, now_s: f64) -> f64 {
        scene.motion(self.axis).position_mm(now_s) - self.offset_mm
    }

    /// Whether the controller moves it.
    pub(super) fn moves(&self, scene: &Scene, now_s: f64) -> bool {
        scene.motion(self.axis).moving(now_s)
    }

    /// Time at which the controller expects the motion to end, s.
    pub(super) fn end_s(&self, scene: &Scene) -> f64 {
        scene.motion(self.axis).end_s()
    }

    /// Whether a count is allowed as a target.
    pub(super) fn allows(&self, count_mm: f64) -> bool {
        count_mm >= self.limits_mm.0 - ROUNDING_MM && count_mm <= self.limits_mm.1 + ROUNDING_MM
    }

    /// Time needed from the present place to a count, s.
    pub(super) fn time_to_s(&self, count_mm: f64, scene: &Scene) -> f64 {
        self.way_to(count_mm, 1.0, scene, 0.0).end_s()
    }

    /// Moves from the present place to a count, slower than possible by the factor `slower`.
    pub(super) fn go_to(&self, count_mm: f64, slower: f64, scene: &mut Scene, now_s: f64) {
        let way = self.way_to(count_mm, slower, scene, now_s);
        scene.set_motion(self.axis, way, now_s);
    }

    /// Moves to the home mark.
    pub(super) fn go_home(&self, scene: &mut Scene, now_s: f64) {
        let way = Trajectory::to(now_s, self.commanded(scene, now_s), 0.0, HOME_SPEED_MM_S, HOME_ACCELERATION_MM_S2);
        scene.set_motion(self.axis, way, now_s);
    }

    /// Stops with the deceleration of its motion.
    pub(super) fn abort(&self, scene: &mut Scene, now_s: f64) {
        self.stop(self.s_gamma.acceleration_mm_s2, scene, now_s);
    }

    /// Stops as hard as possible.
    pub(super) fn brake(&self, scene: &mut Scene, now_s: f64) {
        self.stop(ACCELERATION_MOST_MM_S2 * EMERGENCY_FACTOR, scene, now_s);
    }

    /// Returns the bits of the hardware status: above the home mark, or at an end of the travel.
    pub(super) fn hardware_status(&self, scene: &mut Scene, now_s: f64) -> u32 {
        let place_mm = scene.axis(self.axis, now_s).0;
        let bits = [
            (place_mm >= 0.0, ABOVE_HOME),
            (place_mm <= -TRAVEL_MM + ROUNDING_MM, END_MINUS),
            (place_mm >= TRAVEL_MM - ROUNDING_MM, END_PLUS),
        ];
        bits.iter().filter(|(set, _)| *set).fold(0, |all, (_, bits)| all | bits)
    }

    fn way_to(&self, count_mm: f64, slower: f64, scene: &Scene, now_s: f64) -> Trajectory {
        let target_mm = scene.target_mm(count_mm) + self.offset_mm;
        let SGamma { speed_mm_s, acceleration_mm_s2, .. } = self.s_gamma;
        let from_mm = scene.motion(self.axis).end_mm();
        Trajectory::to(now_s, (from_mm, 0.0), target_mm, speed_mm_s / slower, acceleration_mm_s2 / (slower * slower))
    }

    fn stop(&self, deceleration_mm_s2: f64, scene: &mut Scene, now_s: f64) {
        if !self.moves(scene, now_s) {
            return;
        }
        let state = self.commanded(scene, now_s);
        let way = Trajectory::stop(now_s, state, deceleration_mm_s2.max(least_brake_mm_s2(state)));
        scene.set_motion(self.axis, way, now_s);
    }

    /// Returns the commanded position and speed at `now_s`, mm and mm/s. The controller plans from them. The stage may lag
    /// behind.
    fn commanded(&self, scene: &Scene, now_s: f64) -> (f64, f64) {
        let motion = scene.motion(self.axis);
        (motion.position_mm(now_s), motion.speed_mm_s(now_s))
    }
}

/// Least deceleration, mm/s^2, at which the axis stops before the end of travel. The end of travel stops the axis if its brake
/// doesn't.
fn least_brake_mm_s2((place_mm, speed_mm_s): (f64, f64)) -> f64 {
    let room_mm = TRAVEL_MM - place_mm * speed_mm_s.signum();
    speed_mm_s * speed_mm_s / (2.0 * room_mm.max(ROUNDING_MM))
}

/// The hardware status in words.
pub(super) fn hardware_text(status: u32) -> String {
    let texts = [(ABOVE_HOME, "ZM high level"), (0x100, "Minus end of run"), (0x200, "Plus end of run")];
    let words: Vec<&str> = texts.iter().filter(|(bits, _)| status & bits != 0).map(|(_, text)| *text).collect();
    words.join(" - ")
}
