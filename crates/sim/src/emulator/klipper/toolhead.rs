//! The tool head: its limits, and its moves, as they are commanded and as the motors make them (Klipper's klippy/toolhead.py and
//! klippy/kinematics/cartesian.py).
//!
//! The host plans moves ahead of time. The print time is the end of what is planned. A move of a printer that rests begins 0.25 s
//! later.

use super::board::KlipperBoard;
use crate::emulator::grbl::machine::{CUT_OFF_FACTOR, braked, rest};
use crate::scene::{Scene, Trajectory};
use palpate_core::quantity::Axis;

/// Time between the planning of a first move and its begin, s (BUFFER_TIME_START).
const START_S: f64 = 0.25;
/// Time for which a reported live position is repeated, s (STATUS_REFRESH_TIME of motion_report.py).
const REFRESH_S: f64 = 0.25;
/// Time for which motors are switched off, s (twice DISABLE_STALL_TIME of stepper_enable.py).
const SWITCHING_S: f64 = 0.2;

/// Least share of an axis in the speed of a move, so that none is zero.
const ROUNDING: f64 = 1e-9;

/// What Klipper knows of the axes.
pub(super) struct Toolhead {
    /// The printer, with the limits that commands set.
    pub board: KlipperBoard,
    /// End of the last move, mm.
    pub commanded_mm: [f64; 3],
    /// End of the last move, s.
    pub print_time_s: f64,
    /// Axes whose limits are known.
    pub homed: [bool; 3],
    /// Acceleration that limits the speed of short moves, mm/s^2 (`max_accel_to_decel`).
    pub accel_to_decel_mm_s2: f64,
    /// Moves as they are commanded.
    commanded: [Trajectory; 3],
    /// Position of each axis when it was last set, mm, and its place in the scene then, mm.
    anchors_mm: [(f64, f64); 3],
    /// Last report of the live position: its time, s, and position and speed, mm and mm/s.
    live: (f64, [f64; 3], f64),
}

impl Toolhead {
    /// Creates a printer that is switched on: nothing is homed, and all positions are 0.
    pub(super) fn new(board: KlipperBoard, scene: &Scene) -> Self {
        Toolhead {
            commanded_mm: [0.0; 3],
            print_time_s: 0.0,
            homed: [false; 3],
            accel_to_decel_mm_s2: board.max_accel_mm_s2 / 2.0,
            commanded: Axis::ALL.map(|_| Trajectory::at_rest(0.0)),
            anchors_mm: Axis::ALL.map(|axis| (0.0, scene.motion(axis).end_mm())),
            live: (f64::NEG_INFINITY, [0.0; 3], 0.0),
            board,
        }
    }

    /// Plans a move from rest to rest. Refuses it beyond the limits of an axis that moves.
    pub(super) fn go(&mut self, to_mm: [f64; 3], speed_mm_s: f64, scene: &mut Scene, now_s: f64) -> Result<(), String> {
        let way_mm: [f64; 3] = std::array::from_fn(|n| to_mm[n] - self.commanded_mm[n]);
        for n in (0..3).filter(|&n| way_mm[n] != 0.0) {
            if !self.homed[n] || !(0.0..=self.board.lengths_mm[n]).contains(&to_mm[n]) {
                let why = if self.homed[n] { "Move out of range" } else { "Must home axis first" };
                let [x_mm, y_mm, z_mm] = to_mm;
                return Err(format!("{why}: {x_mm:.3} {y_mm:.3} {z_mm:.3} [0.000]"));
            }
        }
        let length_mm = length(way_mm);
        if length_mm == 0.0 {
            return Ok(());
        }
        let along_z = length_mm / way_mm[2].abs(); // infinite without z, so that its limits don't matter
        let accel_mm_s2 = self.board.max_accel_mm_s2.min(self.board.max_z_accel_mm_s2 * along_z);
        // half of a short move is made at a steady speed
        let summit_mm_s = (length_mm * self.accel_to_decel_mm_s2.min(accel_mm_s2)).sqrt();
        let most_mm_s = self.board.max_velocity_mm_s.min(self.board.max_z_velocity_mm_s * along_z).min(summit_mm_s);
        let speed_mm_s = speed_mm_s.min(most_mm_s);
        self.dwell(0.0, now_s);
        let start_s = self.print_time_s;
        // ways of other lengths take the same time: whole steps, or an axis at its end
        let leg = |from_mm: f64, to_mm: f64| {
            let share = ((to_mm - from_mm).abs() / length_mm).max(ROUNDING);
            Trajectory::to(start_s, (from_mm, 0.0), to_mm, speed_mm_s * share, accel_mm_s2 * share)
        };
        for axis in Axis::ALL {
            let (n, motion) = (axis.index(), scene.motion(axis));
            let commanded = leg(self.commanded_mm[n], to_mm[n]);
            self.print_time_s = self.print_time_s.max(commanded.end_s());
            self.commanded[n] = self.commanded[n].left(now_s).then(&commanded);
            let real = leg(motion.end_mm(), self.whole_steps_mm(n, to_mm[n]));
            scene.set_motion(axis, motion.left(now_s).then(&real), now_s);
        }
        self.commanded_mm = to_mm;
        Ok(())
    }

    /// Plans a pause, s, which begins at the earliest start of a move. A pause of zero leaves the print time there.
    pub(super) fn dwell(&mut self, pause_s: f64, now_s: f64) {
        self.print_time_s = self.print_time_s.max(now_s + START_S) + pause_s;
    }

    /// Sets the position where the axes stand at the end of what is planned. All count as homed.
    pub(super) fn set_position(&mut self, at_mm: [f64; 3], scene: &Scene, now_s: f64) {
        self.dwell(0.0, now_s);
        self.anchors_mm = std::array::from_fn(|n| (at_mm[n], scene.motion(Axis::ALL[n]).end_mm()));
        self.commanded = at_mm.map(|mm| rest(mm, now_s));
        (self.commanded_mm, self.homed) = (at_mm, [true; 3]);
    }

    /// Switches the motors off at the end of what is planned. The axes stay where they are.
    pub(super) fn motors_off(&mut self, now_s: f64) {
        self.dwell(SWITCHING_S, now_s);
        self.homed = [false; 3];
    }

    /// Ends the steps at once. Moving axes continue a little. Klipper still believes that what was planned is made.
    pub(super) fn cut_off(&self, scene: &mut Scene, now_s: f64) {
        for axis in Axis::ALL {
            let brake_mm_s2 = CUT_OFF_FACTOR * self.board.max_accel_mm_s2;
            let way = braked(scene.motion(axis), self.board.ends_mm(axis.index()), brake_mm_s2, now_s);
            scene.set_motion(axis, way, now_s);
        }
    }

    /// Position that is commanded for this moment, mm, and its speed, mm/s. Klipper computes it four times in a second.
    pub(super) fn live(&mut self, now_s: f64) -> ([f64; 3], f64) {
        if now_s >= self.live.0 + REFRESH_S {
            let at_mm = self.commanded.each_ref().map(|axis| axis.position_mm(now_s));
            self.live = (now_s, at_mm, length(self.commanded.each_ref().map(|axis| axis.speed_mm_s(now_s))));
        }
        (self.live.1, self.live.2)
    }

    /// Returns the place of an axis for a position, in whole steps. A motor that stalls at an end of the frame loses steps.
    fn whole_steps_mm(&mut self, axis: usize, to_mm: f64) -> f64 {
        let ((at_mm, place_mm), steps_per_mm) = (self.anchors_mm[axis], self.board.steps_per_mm[axis]);
        let wanted_mm = place_mm + ((to_mm - at_mm) * steps_per_mm).round() / steps_per_mm;
        let (min_mm, max_mm) = self.board.ends_mm(axis);
        let reached_mm = wanted_mm.clamp(min_mm, max_mm);
        self.anchors_mm[axis].1 += reached_mm - wanted_mm;
        reached_mm
    }
}

/// Length of a way, mm, or a speed along it.
fn length(way: [f64; 3]) -> f64 {
    way.iter().map(|way| way * way).sum::<f64>().sqrt()
}
