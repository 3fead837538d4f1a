//! The tool head: queued moves, limits, homing and motors (Klipper's klippy/toolhead.py, klippy/kinematics/cartesian.py and
//! klippy/extras/homing.py).
//!
//! The host plans moves ahead of time. The print time is the end of what is planned, on the clock of the microcontroller. Moves
//! wait for later ones until something needs the end of the queue, or for 0.1 s. If the printer rests then, they begin 0.25 s
//! later.

use super::board::KlipperBoard;
use super::plan::{Plan, START_S, length};
use crate::scene::Scene;

/// Planned time below which queued moves are planned, s (BUFFER_TIME_LOW).
const LOW_S: f64 = 1.0;
/// Planned time above which a command waits, s (BUFFER_TIME_HIGH). Queued moves that last this long after the first
/// are planned at once.
const HIGH_S: f64 = 2.0;
/// Least time for which a queued move waits for others, s.
const PRIMING_S: f64 = 0.1;
/// Time for which a reported live position is repeated, s (STATUS_REFRESH_TIME of motion_report.py).
const REFRESH_S: f64 = 0.25;
/// Time before and after motors are switched, s (DISABLE_STALL_TIME of stepper_enable.py).
const SWITCHING_S: f64 = 0.1;

/// What Klipper knows of the axes.
pub(super) struct Toolhead {
    pub board: KlipperBoard,
    pub plan: Plan,
    /// End of the last move that was accepted, mm.
    pub commanded_mm: [f64; 3],
    /// Axes whose limits are known.
    pub homed: [bool; 3],
    /// Motors that are on.
    pub enabled: [bool; 3],
    pub max_velocity_mm_s: f64,
    pub max_accel_mm_s2: f64,
    /// Acceleration that limits the speed of short moves, mm/s^2 (`max_accel_to_decel`).
    pub accel_to_decel_mm_s2: f64,
    pub square_corner_mm_s: f64,
    lookahead: Vec<QueuedMove>,
    /// Duration of the queued moves after the first, s.
    waiting_s: f64,
    /// Time at which the queued moves are planned, s.
    pub flush_s: f64,
    /// Last report of the live position: its time, s, and position and speed, mm and mm/s.
    live: (f64, ([f64; 3], f64)),
}

/// A move that waits for later ones.
#[derive(Clone)]
struct QueuedMove {
    to_mm: [f64; 3],
    speed_mm_s: f64,
    accel_mm_s2: f64,
    way: [f64; 3],
    length_mm: f64,
}

impl Toolhead {
    /// Creates a printer that is switched on: nothing is homed, and all positions are 0.
    pub(super) fn new(board: KlipperBoard, scene: &Scene) -> Self {
        Toolhead {
            plan: Plan::new(scene),
            commanded_mm: [0.0; 3],
            homed: [false; 3],
            enabled: [false; 3],
            max_velocity_mm_s: board.max_velocity_mm_s,
            max_accel_mm_s2: board.max_accel_mm_s2,
            accel_to_decel_mm_s2: board.max_accel_mm_s2 / 2.0,
            square_corner_mm_s: KlipperBoard::SQUARE_CORNER_MM_S,
            lookahead: Vec::new(),
            waiting_s: 0.0,
            flush_s: f64::INFINITY,
            live: (f64::NEG_INFINITY, ([0.0; 3], 0.0)),
            board,
        }
    }

    /// Queues a move. Refuses it beyond the limits of an axis that moves.
    pub(super) fn add(
        &mut self,
        to_mm: [f64; 3],
        speed_mm_s: f64,
        scene: &mut Scene,
        now_s: f64,
    ) -> Result<(), String> {
        let way_mm: [f64; 3] = std::array::from_fn(|n| to_mm[n] - self.commanded_mm[n]);
        let length_mm = length(way_mm);
        if length_mm == 0.0 {
            return Ok(());
        }
        for n in (0..3).filter(|&n| way_mm[n] != 0.0) {
            if !self.homed[n] || !(0.0..=self.board.lengths_mm[n]).contains(&to_mm[n]) {
                let why = if self.homed[n] { "Move out of range" } else { "Must home axis first" };
                let [x_mm, y_mm, z_mm] = to_mm;
                return Err(format!("{why}: {x_mm:.3} {y_mm:.3} {z_mm:.3} [0.000]"));
            }
        }
        let way = way_mm.map(|way_mm| way_mm / length_mm);
        let along_z = 1.0 / way[2].abs(); // infinite without z, so that its limits don't matter
        let queued = QueuedMove {
            to_mm,
            speed_mm_s: speed_mm_s.min(self.max_velocity_mm_s).min(self.board.max_z_velocity_mm_s * along_z),
            accel_mm_s2: self.max_accel_mm_s2.min(self.board.max_z_accel_mm_s2 * along_z),
            way,
            length_mm,
        };
        self.commanded_mm = to_mm;
        self.waiting_s += if self.is_queueing() { length_mm / queued.speed_mm_s } else { 0.0 };
        match self.lookahead.last_mut() {
            Some(last) if last.runs_into(&queued) => {
                (last.to_mm, last.length_mm) = (to_mm, last.length_mm + length_mm);
            }
            _ => self.lookahead.push(queued),
        }
        self.flush_s = now_s + PRIMING_S.max(self.plan.print_time_s - now_s - LOW_S);
        if self.waiting_s >= HIGH_S {
            self.flush(now_s, scene, now_s);
            return Ok(());
        }
        // the scene makes the queued moves as if nothing more came, so that they are made even if nobody asks
        let (plan, enabled, queued) = (self.plan.clone(), self.enabled, self.lookahead.clone());
        let (flush_s, waiting_s) = (self.flush_s, self.waiting_s);
        self.flush(flush_s, scene, now_s);
        (self.plan, self.enabled, self.lookahead) = (plan, enabled, queued);
        (self.flush_s, self.waiting_s) = (flush_s, waiting_s);
        Ok(())
    }

    /// Plans the queued moves as at `at_s`, now or at another time.
    pub(super) fn flush(&mut self, at_s: f64, scene: &mut Scene, now_s: f64) {
        (self.flush_s, self.waiting_s) = (f64::INFINITY, 0.0);
        let queued = std::mem::take(&mut self.lookahead);
        if queued.is_empty() {
            return;
        }
        self.plan.synchronize(at_s);
        self.plan.forget(now_s);
        for QueuedMove { to_mm, speed_mm_s, accel_mm_s2, way, length_mm } in queued {
            for (enabled, way) in self.enabled.iter_mut().zip(way) {
                *enabled |= way != 0.0;
            }
            // from rest to rest, half of a short move is made at a steady speed
            let summit_mm_s = (length_mm * self.accel_to_decel_mm_s2.min(accel_mm_s2)).sqrt();
            let places_mm = self.plan.whole_steps(&self.board, to_mm);
            let from_mm = self.plan.end_mm();
            self.plan.add([from_mm, to_mm], places_mm, speed_mm_s.min(summit_mm_s), accel_mm_s2);
        }
        self.plan.act(scene, now_s);
    }

    /// Plans the queued moves, and lets the print time be at least the earliest start of a move (`get_last_move_time`).
    pub(super) fn synchronize(&mut self, scene: &mut Scene, now_s: f64) {
        self.flush(now_s, scene, now_s);
        self.plan.synchronize(now_s);
    }

    /// Adds a pause, s.
    pub(super) fn dwell(&mut self, pause_s: f64, scene: &mut Scene, now_s: f64) {
        self.synchronize(scene, now_s);
        self.plan.print_time_s += pause_s;
    }

    /// Time at which a command that plans more may go on, s.
    pub(super) fn room_s(&self) -> f64 {
        self.plan.print_time_s - HIGH_S
    }

    /// Whether queued moves wait.
    pub(super) fn is_queueing(&self) -> bool {
        !self.lookahead.is_empty()
    }

    /// Sets the position where the axes stand at the end of what is planned.
    pub(super) fn set_position(&mut self, at_mm: [f64; 3]) {
        self.commanded_mm = at_mm;
        self.plan.set_position(at_mm);
    }

    /// Moves one axis without a change of its position, at a speed and an acceleration, which may be 0 for none (FORCE_MOVE).
    pub(super) fn force(&mut self, axis: usize, by_mm: f64, rates: (f64, f64), scene: &mut Scene, now_s: f64) {
        let switched = !std::mem::replace(&mut self.enabled[axis], true);
        self.dwell(if switched { SWITCHING_S } else { 0.0 }, scene, now_s);
        let (at_mm, mut to_mm, mut places_mm) = (self.commanded_mm, self.commanded_mm, self.plan.places_mm);
        places_mm[axis] = self.board.within_ends(axis, places_mm[axis] + by_mm);
        to_mm[axis] += by_mm;
        let accel_mm_s2 = if rates.1 > 0.0 { rates.1 } else { 1e3 * rates.0 };
        self.plan.add([at_mm, to_mm], places_mm, rates.0, accel_mm_s2);
        self.plan.hide_last(at_mm);
        self.plan.act(scene, now_s);
        self.set_position(at_mm);
    }

    /// Begins the homing of one axis: to its endstop, back, and slowly to it again. Returns the time of its end, s. As in Klipper,
    /// the axis counts as homed from here on, and the end of the move is commanded.
    pub(super) fn home(&mut self, axis: usize, scene: &mut Scene, now_s: f64) -> f64 {
        self.synchronize(scene, now_s);
        (self.homed[axis], self.enabled[axis]) = (true, true);
        let (switch_mm, speed_mm_s) = (self.board.switch_mm(axis), self.board.homing_mm_s[axis]);
        let back_mm = KlipperBoard::RETRACT_MM.min(self.board.lengths_mm[axis]);
        let back_mm = if self.board.homes_to_plus[axis] { switch_mm - back_mm } else { switch_mm + back_mm };
        let most_mm_s2 = if axis == 2 { self.board.max_z_accel_mm_s2 } else { f64::INFINITY };
        let counts_mm = self.board.endstop_mm(axis) - switch_mm;
        for (n, (place_mm, share)) in [(switch_mm, 1.0), (back_mm, 1.0), (switch_mm, 0.5)].into_iter().enumerate() {
            // the way back is a move of a printer that rests
            self.plan.print_time_s += if n == 1 { START_S } else { 0.0 };
            let (mut from_mm, mut to_mm, mut places_mm) = (self.commanded_mm, self.commanded_mm, self.plan.places_mm);
            (from_mm[axis], to_mm[axis]) = (places_mm[axis] + counts_mm, place_mm + counts_mm);
            places_mm[axis] = place_mm;
            self.plan.add([from_mm, to_mm], places_mm, share * speed_mm_s, most_mm_s2.min(self.max_accel_mm_s2));
        }
        self.plan.act(scene, now_s);
        let mut at_mm = self.commanded_mm;
        at_mm[axis] = self.board.endstop_mm(axis);
        self.set_position(at_mm);
        self.plan.print_time_s
    }

    /// Switches the motors off at the end of what is planned. The axes stay where they are.
    pub(super) fn motors_off(&mut self, scene: &mut Scene, now_s: f64) {
        self.dwell(2.0 * SWITCHING_S, scene, now_s);
        (self.homed, self.enabled) = ([false; 3], [false; 3]);
    }

    /// Ends the steps at once. Klipper still believes that what was planned is made.
    pub(super) fn cut_off(&mut self, scene: &mut Scene, now_s: f64) {
        self.lookahead.clear();
        self.flush_s = f64::INFINITY;
        self.plan.cut_off(&self.board, scene, now_s);
    }

    /// Position that the plan has at this moment, mm, and its speed, mm/s. Klipper computes it four times in a second.
    pub(super) fn live(&mut self, now_s: f64) -> ([f64; 3], f64) {
        if now_s >= self.live.0 + REFRESH_S {
            self.live = (now_s, self.plan.live(now_s));
        }
        self.live.1
    }
}

impl QueuedMove {
    /// Whether the next move goes on along the same line at the same speed.
    fn runs_into(&self, next: &QueuedMove) -> bool {
        let turn = (0..3).map(|n| (self.way[n] - next.way[n]).abs()).fold(0.0, f64::max);
        turn < 1e-6 && self.speed_mm_s == next.speed_mm_s && self.accel_mm_s2 == next.accel_mm_s2
    }
}
