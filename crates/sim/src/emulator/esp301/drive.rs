//! One axis: its position, motion and settings.

use super::errors::{AxisFault, EspError, General};
use crate::scene::{Scene, Trajectory};
use palpate_core::quantity::Axis;

/// Travel of a VP-25XL to either side of its middle, mm (its file in a public XPS configuration).
pub(super) const TRAVEL_MM: f64 = crate::emulator::STAGE_TRAVEL_MM;
/// Largest speed of a VP-25XL, mm/s (same file).
const STAGE_SPEED_MM_S: f64 = 25.0;
/// Largest acceleration of a VP-25XL, mm/s^2 (same file).
const STAGE_ACCELERATION_MM_S2: f64 = 100.0;
/// Speed of homing unless `OH` sets another value, mm/s.
const HOME_SPEED_MM_S: f64 = 5.0;
/// Encoder counts per mm: 20 um interpolated 4000 times (same file).
const COUNTS_PER_MM: f64 = 200_000.0;
/// Positions per mm that the controller reports.
const REPORTED_PER_MM: f64 = 1e4;
/// Value of `SN` for a stage that counts in encoder counts. The second constant is the value for mm (manual, page SN).
const UNIT_COUNTS: u16 = 0;
const UNIT_MM: u16 = 2;
/// The highest `SN`: microradians.
pub(super) const UNIT_LAST: u16 = 11;
/// Settings of a VP-25XL that clients read at the start, and that have no effect here. They are base and jog speeds, high and
/// low, mm/s; following error, full-step resolution and gain. The values are examples; the commands are those of the manual.
const SETTINGS: [(&[u8; 2], f64); 9] = [
    (b"VB", 0.0),
    (b"JH", 5.0),
    (b"JL", 1.0),
    (b"FR", 0.001),
    (b"SU", 0.000_005),
    (b"QM", 3.0),
    (b"QS", 1.0),
    (b"KP", 10.0),
    (b"LC", 0.0),
];
/// Largest distance of a target beyond the end of travel that counts as rounding, mm.
const ROUNDING_MM: f64 = 1e-9;

/// One axis: a VP-25XL and the controller's knowledge of it. Places are true places in stage coordinates, unless a name contains
/// `count`. A count is the controller's assumed place, which is wrong by `offset_mm` until the axis is homed.
///
/// A mirrored axis counts against the true direction. Its + end is then at the - end of the stage.
pub(super) struct Drive {
    axis: Axis,
    pub motor_on: bool,
    /// True place that counts zero, mm.
    offset_mm: f64,
    /// Direction in which it counts: 1, or -1 if it is mirrored.
    direction: f64,
    target_mm: f64,
    action: AxisAction,
    /// Acceleration of the move under way, mm/s^2.
    ramp_mm_s2: f64,
    speed_mm_s: f64,
    most_speed_mm_s: f64,
    home_speed_mm_s: f64,
    acceleration_mm_s2: f64,
    deceleration_mm_s2: f64,
    left_limit_count_mm: f64,
    right_limit_count_mm: f64,
    /// The count that a search for home assigns to the place where it ends (`SH`).
    home_count_mm: f64,
    pub unit: u16,
}

/// Present action of an axis. The scene holds the motion, which ends there independently.
#[derive(Clone, Copy, Debug, PartialEq)]
enum AxisAction {
    Idle,
    /// To a target; an error may follow on arrival.
    Move(Option<AxisFault>),
    /// To the home mark or an end of travel, mm; the place where the search ends gets the count of `SH`. Mode 0 has no such place.
    Home {
        place_mm: Option<f64>,
    },
    Stop,
}

impl Drive {
    /// Creates an axis at power-on: its present place counts as zero, and its motor is off.
    pub(super) fn new(axis: Axis, scene: &Scene) -> Self {
        let place_mm = scene.motion(axis).end_mm();
        Drive {
            axis,
            motor_on: false,
            offset_mm: place_mm,
            direction: 1.0,
            target_mm: place_mm,
            action: AxisAction::Idle,
            ramp_mm_s2: 0.0,
            speed_mm_s: 10.0,
            most_speed_mm_s: STAGE_SPEED_MM_S,
            home_speed_mm_s: HOME_SPEED_MM_S,
            acceleration_mm_s2: 50.0,
            deceleration_mm_s2: 50.0,
            left_limit_count_mm: -TRAVEL_MM,
            right_limit_count_mm: TRAVEL_MM,
            home_count_mm: 0.0,
            unit: UNIT_MM,
        }
    }

    /// Returns an error of this axis.
    pub(super) fn fault(&self, fault: AxisFault) -> EspError {
        EspError::OfAxis(self.axis, fault)
    }

    /// Whether the axis moves (`MD?` is 0), as of the last [`notice`](Self::notice).
    pub(super) fn moving(&self) -> bool {
        self.action != AxisAction::Idle
    }

    /// Time at which the controller expects the motion to end, s.
    pub(super) fn end_s(&self, scene: &Scene) -> f64 {
        scene.motion(self.axis).end_s()
    }

    /// Applies the effects of a motion that has ended by `now_s`. Returns the error, if there is one, and its time, s.
    pub(super) fn notice(&mut self, scene: &Scene, now_s: f64) -> Option<(EspError, f64)> {
        let end_s = self.end_s(scene);
        if self.action == AxisAction::Idle || now_s < end_s {
            return None;
        }
        match std::mem::replace(&mut self.action, AxisAction::Idle) {
            AxisAction::Move(fault) => fault.map(|fault| (self.fault(fault), end_s)),
            AxisAction::Home { place_mm } => {
                if let Some(place_mm) = place_mm {
                    self.offset_mm = place_mm - self.direction * self.home_count_mm;
                }
                None
            }
            AxisAction::Idle | AxisAction::Stop => None,
        }
    }

    /// Returns the axis position in counts, in the unit of `SN` (mm, unless it is encoder counts), as `TP` writes it.
    pub(super) fn place(&self, scene: &mut Scene, now_s: f64) -> String {
        let count_mm = self.count_mm(scene.axis(self.axis, now_s).0);
        if self.unit == UNIT_COUNTS {
            format!("{:.0}", (count_mm * COUNTS_PER_MM).round() + 0.0)
        } else {
            decimal(count_mm)
        }
    }

    /// Returns the commanded position, mm, as `DP?` writes it: without what the mechanics still lack.
    pub(super) fn setpoint(&self, scene: &Scene, now_s: f64) -> String {
        decimal(self.count_mm(self.commanded(scene, now_s).0))
    }

    /// Returns the target, mm, as `PA?` writes it.
    pub(super) fn target(&self) -> String {
        decimal(self.count_mm(self.target_mm))
    }

    /// `PA`: moves to a count at `VA`. Beyond a soft limit it doesn't move at all; beyond the travel, it moves to the end of the
    /// travel.
    pub(super) fn go_to(&mut self, count_mm: f64, scene: &mut Scene, now_s: f64) -> Result<(), EspError> {
        self.may_move()?;
        let fault = match count_mm {
            right if right > self.right_limit_count_mm + ROUNDING_MM => Some(AxisFault::PLUS_SOFTWARE_LIMIT),
            left if left < self.left_limit_count_mm - ROUNDING_MM => Some(AxisFault::MINUS_SOFTWARE_LIMIT),
            _ => None,
        };
        match fault {
            Some(fault) => Err(self.fault(fault)),
            None => {
                self.start_move(self.offset_mm + self.direction * scene.target_mm(count_mm), scene, now_s);
                Ok(())
            }
        }
    }

    /// `PR`: moves by a distance from the present position, at `VA`.
    pub(super) fn go_by(&mut self, way_mm: f64, scene: &mut Scene, now_s: f64) -> Result<(), EspError> {
        let count_mm = self.count_mm(self.commanded(scene, now_s).0);
        self.go_to(count_mm + way_mm, scene, now_s)
    }

    /// `OR`: mode 0 moves to count zero, 1 and 2 to the mark in the middle of the travel, 3 to 6 to the + or - end. The place where
    /// the search ends has the count that `SH` states, 0 as shipped; mode 0 leaves the count unchanged (manual, pages OR and SH).
    pub(super) fn home(&mut self, mode: u8, scene: &mut Scene, now_s: f64) -> Result<(), EspError> {
        self.may_move()?;
        let place_mm = match mode {
            0 => self.offset_mm.clamp(-TRAVEL_MM, TRAVEL_MM),
            3 | 5 => self.direction * TRAVEL_MM,
            4 | 6 => -self.direction * TRAVEL_MM,
            _ => 0.0,
        };
        self.start(place_mm, self.home_speed_mm_s, scene, now_s);
        self.action = AxisAction::Home { place_mm: (mode != 0).then_some(place_mm) };
        Ok(())
    }

    /// `DH`: the present position of the axis becomes `count_mm`.
    pub(super) fn define(&mut self, count_mm: f64, scene: &mut Scene, now_s: f64) -> Result<(), EspError> {
        self.stands()?;
        self.offset_mm = self.commanded(scene, now_s).0 - self.direction * count_mm;
        Ok(())
    }

    /// Counts in the other direction from now on. What is under way is made all the same.
    pub(super) fn mirror(&mut self, scene: &Scene, now_s: f64) {
        let place_mm = self.commanded(scene, now_s).0;
        let count_mm = self.count_mm(place_mm);
        self.direction = -self.direction;
        self.offset_mm = place_mm - self.direction * count_mm;
    }

    /// Count of a true place, mm.
    fn count_mm(&self, place_mm: f64) -> f64 {
        self.direction * (place_mm - self.offset_mm)
    }

    /// `ST`: stops the axis with `AG`. Returns whether it interrupted a homing.
    pub(super) fn stop(&mut self, scene: &mut Scene, now_s: f64) -> bool {
        self.brake(self.deceleration_mm_s2, scene, now_s)
    }

    /// `AB` and `MF`: stops the axis as hard as possible and turns the motor off. Returns whether it interrupted a homing.
    pub(super) fn cut_power(&mut self, scene: &mut Scene, now_s: f64) -> bool {
        self.motor_on = false;
        self.brake(STAGE_ACCELERATION_MM_S2, scene, now_s)
    }

    /// Returns the value of a command that sets and reports a number.
    pub(super) fn number(&self, name: &[u8; 2]) -> Option<f64> {
        Some(match name {
            b"VA" => self.speed_mm_s,
            b"VU" => self.most_speed_mm_s,
            b"OH" => self.home_speed_mm_s,
            b"AC" => self.acceleration_mm_s2,
            b"AG" => self.deceleration_mm_s2,
            b"SL" => self.left_limit_count_mm,
            b"SR" => self.right_limit_count_mm,
            b"SH" => self.home_count_mm,
            name => SETTINGS.into_iter().find(|(its, _)| its == &name)?.1,
        })
    }

    /// Sets such a number after a check against the limits of the stage and the other numbers. `VA` also changes a move under
    /// way.
    pub(super) fn set_number(
        &mut self,
        name: &[u8; 2],
        value: f64,
        scene: &mut Scene,
        now_s: f64,
    ) -> Result<(), EspError> {
        // NaN isn't above zero
        let above = f64::MIN_POSITIVE;
        let (slot, least, most) = match name {
            b"VA" => (&mut self.speed_mm_s, above, self.most_speed_mm_s),
            b"VU" => (&mut self.most_speed_mm_s, above, STAGE_SPEED_MM_S),
            b"OH" => (&mut self.home_speed_mm_s, above, self.most_speed_mm_s),
            b"AC" => (&mut self.acceleration_mm_s2, above, STAGE_ACCELERATION_MM_S2),
            b"AG" => (&mut self.deceleration_mm_s2, above, STAGE_ACCELERATION_MM_S2),
            b"SL" => (&mut self.left_limit_count_mm, f64::MIN, self.right_limit_count_mm),
            b"SR" => (&mut self.right_limit_count_mm, self.left_limit_count_mm, f64::MAX),
            b"SH" => (&mut self.home_count_mm, f64::MIN, f64::MAX),
            _ => return Err(General::UNKNOWN_COMMAND.into()),
        };
        if value >= least && value <= most {
            *slot = value;
            if let (b"VA", AxisAction::Move(_)) = (name, self.action) {
                self.run_at(value, scene, now_s);
            }
            return Ok(());
        }
        let fault = match (name[0], value > most) {
            (b'V' | b'O', true) => AxisFault::SPEED_BEYOND_MOST,
            (b'V' | b'O', false) => AxisFault::SPEED_OUT_OF_RANGE,
            (b'A', true) => AxisFault::ACCELERATION_BEYOND_MOST,
            _ => AxisFault::PARAMETER_OUT_OF_RANGE,
        };
        Err(self.fault(fault))
    }

    /// Returns the commanded position and speed at `now_s`, mm and mm/s. The controller plans from them. The stage may lag
    /// behind.
    fn commanded(&self, scene: &Scene, now_s: f64) -> (f64, f64) {
        let motion = scene.motion(self.axis);
        (motion.position_mm(now_s), motion.speed_mm_s(now_s))
    }

    /// Returns an error if the axis moves. The emulator doesn't assume that a controller accepts a new target during a motion.
    fn stands(&self) -> Result<(), EspError> {
        match self.action {
            AxisAction::Idle => Ok(()),
            AxisAction::Home { .. } => Err(self.fault(AxisFault::WHILE_HOMING)),
            AxisAction::Move(_) | AxisAction::Stop => Err(self.fault(AxisFault::WHILE_MOVING)),
        }
    }

    fn may_move(&self) -> Result<(), EspError> {
        if !self.motor_on {
            return Err(self.fault(AxisFault::MOTOR_NOT_ENABLED));
        }
        self.stands()
    }

    /// Starts a motion to a position at `VA`, or to the end of travel if the position is beyond it. In the second case the axis
    /// reports an error.
    fn start_move(&mut self, wanted_mm: f64, scene: &mut Scene, now_s: f64) {
        let reached_mm = wanted_mm.clamp(-TRAVEL_MM, TRAVEL_MM);
        let fault = match self.direction * (wanted_mm - reached_mm) {
            beyond if beyond > ROUNDING_MM => Some(AxisFault::PLUS_HARDWARE_LIMIT),
            beyond if beyond < -ROUNDING_MM => Some(AxisFault::MINUS_HARDWARE_LIMIT),
            _ => None,
        };
        self.start(reached_mm, self.speed_mm_s, scene, now_s);
        self.action = AxisAction::Move(fault);
    }

    /// Starts a motion with the lesser of `AC` and `AG`, because the scene's trajectories have one acceleration for both
    /// directions. This acceleration holds until the motion ends: a slower brake would carry the axis past its target.
    fn start(&mut self, target_mm: f64, speed_mm_s: f64, scene: &mut Scene, now_s: f64) {
        self.target_mm = target_mm;
        self.ramp_mm_s2 = self.acceleration_mm_s2.min(self.deceleration_mm_s2);
        self.run_at(speed_mm_s, scene, now_s);
    }

    fn run_at(&mut self, speed_mm_s: f64, scene: &mut Scene, now_s: f64) {
        let state = self.commanded(scene, now_s);
        let speed_mm_s = speed_mm_s.min(self.most_speed_mm_s);
        let way = Trajectory::to(now_s, state, self.target_mm, speed_mm_s, self.ramp_mm_s2);
        scene.set_motion(self.axis, way, now_s);
    }

    fn brake(&mut self, deceleration_mm_s2: f64, scene: &mut Scene, now_s: f64) -> bool {
        if self.action == AxisAction::Idle {
            return false;
        }
        let (place_mm, speed_mm_s) = self.commanded(scene, now_s);
        // the end of travel stops it if the brake doesn't
        let room_mm = TRAVEL_MM - place_mm * speed_mm_s.signum();
        let needed_mm_s2 = speed_mm_s * speed_mm_s / (2.0 * room_mm);
        let deceleration_mm_s2 = deceleration_mm_s2.max(needed_mm_s2);
        let mut way = Trajectory::stop(now_s, (place_mm, speed_mm_s), deceleration_mm_s2);
        if speed_mm_s != 0.0 {
            // it ends at the next position that the controller reports
            let counts = self.count_mm(way.end_mm()) * REPORTED_PER_MM;
            let forward = self.direction * speed_mm_s > 0.0;
            let count_mm = if forward { counts.ceil() } else { counts.floor() } / REPORTED_PER_MM;
            let end_mm = (self.offset_mm + self.direction * count_mm).clamp(-TRAVEL_MM, TRAVEL_MM);
            way = Trajectory::to(now_s, (place_mm, speed_mm_s), end_mm, speed_mm_s.abs(), deceleration_mm_s2);
        }
        self.target_mm = way.end_mm();
        scene.set_motion(self.axis, way, now_s);
        let was = std::mem::replace(&mut self.action, AxisAction::Stop);
        matches!(was, AxisAction::Home { .. })
    }
}

/// Returns a number as the controller writes it: four decimals, and zero without a sign.
pub(super) fn decimal(value: f64) -> String {
    format!("{:.4}", (value * REPORTED_PER_MM).round() / REPORTED_PER_MM + 0.0)
}
