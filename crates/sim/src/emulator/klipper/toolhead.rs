//! The tool head: queued moves, print time, whole steps and homing (Klipper's klippy/toolhead.py, klippy/kinematics/cartesian.py
//! and klippy/extras/homing.py).
//!
//! The host plans moves ahead of time. The print time is the end of what is planned, on the clock of the microcontroller. Moves
//! wait for later ones until something needs the end of the queue, or for 0.1 s. If the printer rests then, they begin 0.25 s
//! later. A planned move can't be changed any more.

use super::board::KlipperBoard;
use crate::scene::{Scene, Trajectory};
use palpate_core::quantity::Axis;
use std::collections::VecDeque;

/// Time between the planning of a first move and its begin, s (BUFFER_TIME_START).
const START_S: f64 = 0.25;
/// Planned time below which queued moves are planned, s (BUFFER_TIME_LOW).
const LOW_S: f64 = 1.0;
/// Planned time above which a command waits, s (BUFFER_TIME_HIGH). Queued moves of this duration are planned at once.
const HIGH_S: f64 = 2.0;
/// Least time for which a queued move waits for others, s.
const PRIMING_S: f64 = 0.1;
/// Time for which a reported live position is repeated, s (STATUS_REFRESH_TIME of motion_report.py).
const REFRESH_S: f64 = 0.25;
/// Time before and after the motors are switched off, s (DISABLE_STALL_TIME of stepper_enable.py).
const DISABLE_S: f64 = 0.1;
/// Distance by which an axis moves back from its endstop, mm (`homing_retract_dist`).
const RETRACT_MM: f64 = 5.0;
/// Ratio of the deceleration of an axis whose steps end to its largest acceleration.
const CUT_OFF_FACTOR: f64 = 4.0;
/// Difference of two directions that are the same, and distance that is none, mm.
const ROUNDING: f64 = 1e-9;

/// What Klipper knows of the axes, and what they do in the scene.
pub(super) struct Toolhead {
    pub board: KlipperBoard,
    /// End of the last move that was accepted, mm.
    pub commanded_mm: [f64; 3],
    /// Axes whose limits are known.
    pub homed: [bool; 3],
    /// Motors that are on.
    pub enabled: [bool; 3],
    /// End of what is planned, s.
    pub print_time_s: f64,
    pub max_velocity_mm_s: f64,
    pub max_accel_mm_s2: f64,
    /// Acceleration that limits the speed of short moves, mm/s^2 (`max_accel_to_decel`).
    pub accel_to_decel_mm_s2: f64,
    pub square_corner_mm_s: f64,
    /// Time of the first motion since the motors were switched off by themselves, s.
    pub active_s: Option<f64>,
    lookahead: Vec<QueuedMove>,
    /// Time at which the queued moves are planned, s.
    pub flush_s: f64,
    /// Planned moves, the present one first.
    legs: VecDeque<Leg>,
    /// Position of each axis when it was last set, mm, and its place in the scene then, mm.
    anchors_mm: [(f64, f64); 3],
    /// Places at the end of what is planned, mm in the scene.
    places_mm: [f64; 3],
    /// Last report of the live position: its time, s, the position, mm, and the speed, mm/s.
    live: (f64, [f64; 3], f64),
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

/// A planned move: as planned, and as the motors make it.
#[derive(Clone)]
struct Leg {
    start_s: f64,
    end_s: f64,
    planned: [Trajectory; 3],
    real: [Trajectory; 3],
}

impl Toolhead {
    /// Creates a printer that is switched on: nothing is homed, and all positions are 0.
    pub(super) fn new(board: KlipperBoard, scene: &Scene) -> Self {
        let places_mm = Axis::ALL.map(|axis| scene.motion(axis).end_mm());
        let mut toolhead = Toolhead {
            commanded_mm: [0.0; 3],
            homed: [false; 3],
            enabled: [false; 3],
            print_time_s: 0.0,
            max_velocity_mm_s: board.max_velocity_mm_s,
            max_accel_mm_s2: board.max_accel_mm_s2,
            accel_to_decel_mm_s2: board.max_accel_mm_s2 / 2.0,
            square_corner_mm_s: 5.0,
            active_s: None,
            lookahead: Vec::new(),
            flush_s: f64::INFINITY,
            legs: VecDeque::new(),
            anchors_mm: [(0.0, 0.0); 3],
            places_mm,
            live: (f64::NEG_INFINITY, [0.0; 3], 0.0),
            board,
        };
        toolhead.set_position([0.0; 3]);
        toolhead
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
        match self.lookahead.last_mut() {
            Some(last) if last.runs_into(&queued) => {
                (last.to_mm, last.length_mm) = (to_mm, last.length_mm + length_mm);
            }
            _ => self.lookahead.push(queued),
        }
        self.flush_s = now_s + PRIMING_S.max(self.print_time_s - now_s - LOW_S);
        if self.lookahead.iter().map(|queued| queued.length_mm / queued.speed_mm_s).sum::<f64>() >= HIGH_S {
            self.flush(scene, now_s);
        } else {
            self.preview(scene, now_s);
        }
        Ok(())
    }

    /// Plans the queued moves.
    pub(super) fn flush(&mut self, scene: &mut Scene, now_s: f64) {
        self.plan_queued(now_s);
        self.act(scene, now_s);
    }

    /// Plans the queued moves at their time, which may have passed.
    pub(super) fn flush_in_time(&mut self, scene: &mut Scene, now_s: f64) {
        self.plan_queued(self.flush_s);
        self.act(scene, now_s);
    }

    /// Lets the scene make the queued moves as if nothing more came, so that they are made even if nobody asks.
    fn preview(&mut self, scene: &mut Scene, now_s: f64) {
        let (legs, queued, flush_s) = (self.legs.len(), self.lookahead.clone(), self.flush_s);
        let before = (self.print_time_s, self.active_s, self.enabled, self.places_mm, self.anchors_mm);
        self.plan_queued(flush_s);
        let all = self.legs.clone();
        self.act(scene, now_s);
        self.legs = all;
        self.legs.truncate(legs);
        (self.lookahead, self.flush_s) = (queued, flush_s);
        (self.print_time_s, self.active_s, self.enabled, self.places_mm, self.anchors_mm) = before;
    }

    fn plan_queued(&mut self, now_s: f64) {
        self.flush_s = f64::INFINITY;
        let queued = std::mem::take(&mut self.lookahead);
        if queued.is_empty() {
            return;
        }
        self.synchronize(now_s);
        let mut from_mm = self.legs.back().map_or(self.commanded_mm, |leg| leg.end_mm());
        for QueuedMove { to_mm, speed_mm_s, accel_mm_s2, way, length_mm } in queued {
            for (enabled, way) in self.enabled.iter_mut().zip(way) {
                *enabled |= way != 0.0;
            }
            // from rest to rest, half of a short move is made at a steady speed
            let summit_mm_s = (length_mm * self.accel_to_decel_mm_s2.min(accel_mm_s2)).sqrt();
            let places_mm = self.whole_steps(to_mm);
            self.plan([from_mm, to_mm], places_mm, speed_mm_s.min(summit_mm_s), accel_mm_s2);
            from_mm = to_mm;
        }
    }

    /// Plans the queued moves, and returns the print time, which is never nearer than the start of a move, s.
    pub(super) fn last_move_s(&mut self, scene: &mut Scene, now_s: f64) -> f64 {
        self.flush(scene, now_s);
        self.synchronize(now_s);
        self.print_time_s
    }

    /// Adds a pause, s.
    pub(super) fn dwell(&mut self, pause_s: f64, scene: &mut Scene, now_s: f64) {
        self.print_time_s = self.last_move_s(scene, now_s) + pause_s.max(0.0);
    }

    /// Time at which a command that plans more may go on, s.
    pub(super) fn room_s(&self) -> f64 {
        self.print_time_s - HIGH_S
    }

    /// Whether queued moves wait.
    pub(super) fn is_queueing(&self) -> bool {
        !self.lookahead.is_empty()
    }

    /// Sets the position where the axes stand at the end of what is planned.
    pub(super) fn set_position(&mut self, at_mm: [f64; 3]) {
        self.commanded_mm = at_mm;
        self.anchors_mm = std::array::from_fn(|n| (at_mm[n], self.places_mm[n]));
        let at_s = self.print_time_s;
        let (planned, real) = (at_mm.map(|mm| rest(mm, at_s)), self.places_mm.map(|mm| rest(mm, at_s)));
        self.legs.push_back(Leg { start_s: at_s, end_s: at_s, planned, real });
    }

    /// Moves one axis without a change of its position, at a constant speed or with an acceleration (FORCE_MOVE).
    pub(super) fn force(&mut self, axis: usize, by_mm: f64, rates: (f64, f64), scene: &mut Scene, now_s: f64) {
        self.last_move_s(scene, now_s);
        let mut places_mm = self.places_mm;
        places_mm[axis] = self.within_ends(axis, places_mm[axis] + by_mm);
        let mut to_mm = self.commanded_mm;
        to_mm[axis] += by_mm;
        if !std::mem::replace(&mut self.enabled[axis], true) {
            self.print_time_s += DISABLE_S;
        }
        let accel_mm_s2 = if rates.1 > 0.0 { rates.1 } else { 1e3 * rates.0 };
        self.plan([self.commanded_mm, to_mm], places_mm, rates.0, accel_mm_s2);
        if let Some(leg) = self.legs.back_mut() {
            leg.planned = self.commanded_mm.map(|mm| rest(mm, leg.end_s));
        }
        self.act(scene, now_s);
        self.set_position(self.commanded_mm);
    }

    /// Begins the homing of one axis: to its endstop, back, and slowly to it again. Returns the time of its end, s. As in Klipper,
    /// the axis counts as homed from here on.
    pub(super) fn home(&mut self, axis: usize, scene: &mut Scene, now_s: f64) -> f64 {
        self.last_move_s(scene, now_s);
        let (switch_mm, speed_mm_s) = (self.board.switch_mm(axis), self.board.homing_mm_s[axis]);
        let back_mm = RETRACT_MM.min(self.board.lengths_mm[axis]);
        let back_mm = if self.board.homes_to_plus[axis] { switch_mm - back_mm } else { switch_mm + back_mm };
        let accel_mm_s2 =
            if axis == 2 { self.board.max_z_accel_mm_s2 } else { f64::INFINITY }.min(self.max_accel_mm_s2);
        (self.homed[axis], self.enabled[axis]) = (true, true);
        let counts_mm = self.board.endstop_mm(axis) - switch_mm;
        for (n, (place_mm, share)) in [(switch_mm, 1.0), (back_mm, 1.0), (switch_mm, 0.5)].into_iter().enumerate() {
            // the way back is a move of a printer that rests
            self.print_time_s += if n == 1 { START_S } else { 0.0 };
            let (mut from_mm, mut to_mm, mut places_mm) = (self.commanded_mm, self.commanded_mm, self.places_mm);
            (from_mm[axis], to_mm[axis]) = (places_mm[axis] + counts_mm, place_mm + counts_mm);
            places_mm[axis] = place_mm;
            self.plan([from_mm, to_mm], places_mm, share * speed_mm_s, accel_mm_s2);
        }
        self.act(scene, now_s);
        let mut at_mm = self.commanded_mm;
        at_mm[axis] = self.board.endstop_mm(axis);
        self.set_position(at_mm);
        self.print_time_s
    }

    /// Switches the motors off at the end of what is planned. The axes stay where they are.
    pub(super) fn motors_off(&mut self, scene: &mut Scene, now_s: f64) {
        self.dwell(2.0 * DISABLE_S, scene, now_s);
        (self.homed, self.enabled) = ([false; 3], [false; 3]);
    }

    /// Ends the steps at once. Moving axes go on a little. Positions aren't corrected.
    pub(super) fn cut_off(&mut self, scene: &mut Scene, now_s: f64) {
        self.lookahead.clear();
        self.flush_s = f64::INFINITY;
        for axis in Axis::ALL {
            let (n, motion) = (axis.index(), scene.motion(axis));
            let (place_mm, speed_mm_s) = (motion.position_mm(now_s), motion.speed_mm_s(now_s));
            let way = if speed_mm_s == 0.0 {
                rest(place_mm, now_s)
            } else {
                // the end of the frame stops what the brake doesn't
                let room_mm = (self.within_ends(n, place_mm + speed_mm_s.signum() * 1e6) - place_mm).abs();
                let needed_mm_s2 = speed_mm_s * speed_mm_s / (2.0 * room_mm.max(ROUNDING));
                let brake_mm_s2 = CUT_OFF_FACTOR * self.board.max_accel_mm_s2;
                Trajectory::stop(now_s, (place_mm, speed_mm_s), brake_mm_s2.max(needed_mm_s2))
            };
            self.places_mm[n] = way.end_mm();
            scene.set_motion(axis, way, now_s);
        }
    }

    /// Position that the plan has at this moment, mm, and its speed, mm/s. Klipper computes it four times in a second.
    pub(super) fn live(&mut self, now_s: f64) -> ([f64; 3], f64) {
        if now_s >= self.live.0 + REFRESH_S {
            self.forget(now_s);
            let leg = &self.legs[0];
            let speeds = leg.planned.each_ref().map(|axis| axis.speed_mm_s(now_s));
            self.live = (now_s, leg.planned.each_ref().map(|axis| axis.position_mm(now_s)), length(speeds));
        }
        (self.live.1, self.live.2)
    }

    /// Positions of the motors at the end of what is planned, in whole steps, mm (GET_POSITION).
    pub(super) fn stepped_mm(&self) -> [f64; 3] {
        std::array::from_fn(|n| self.places_mm[n] - self.anchors_mm[n].1 + self.anchors_mm[n].0)
    }

    /// Lets the print time be at least the earliest start of a move.
    fn synchronize(&mut self, now_s: f64) {
        if now_s + START_S > self.print_time_s {
            self.print_time_s = now_s + START_S;
            self.active_s.get_or_insert(now_s);
        }
    }

    /// Plans one move at the print time, along a straight line of positions, to some places.
    fn plan(&mut self, [from_mm, to_mm]: [[f64; 3]; 2], places_mm: [f64; 3], speed_mm_s: f64, accel_mm_s2: f64) {
        let start_s = self.print_time_s;
        let way_mm: [f64; 3] = std::array::from_fn(|n| to_mm[n] - from_mm[n]);
        let length_mm = length(way_mm);
        // ways of other lengths take the same time: whole steps, or an axis at its end
        let leg = |from_mm: f64, to_mm: f64| {
            let share = (to_mm - from_mm).abs() / length_mm;
            if share * length_mm < ROUNDING {
                return rest(to_mm, start_s);
            }
            Trajectory::to(start_s, (from_mm, 0.0), to_mm, speed_mm_s * share, accel_mm_s2 * share)
        };
        let planned: [Trajectory; 3] = std::array::from_fn(|n| leg(from_mm[n], to_mm[n]));
        let real = std::array::from_fn(|n| leg(self.places_mm[n], places_mm[n]));
        let end_s = planned.iter().map(Trajectory::end_s).fold(start_s, f64::max);
        self.legs.push_back(Leg { start_s, end_s, planned, real });
        (self.places_mm, self.print_time_s) = (places_mm, end_s);
    }

    /// Gives the scene what is planned.
    fn act(&mut self, scene: &mut Scene, now_s: f64) {
        self.forget(now_s);
        for axis in Axis::ALL {
            let n = axis.index();
            let way = rest(scene.motion(axis).position_mm(now_s), now_s);
            let way = self.legs.iter().filter(|leg| leg.end_s > now_s).fold(way, |way, leg| way.then(&leg.real[n]));
            scene.set_motion(axis, way, now_s);
        }
    }

    /// Forgets the moves before the present one.
    fn forget(&mut self, now_s: f64) {
        while self.legs.get(1).is_some_and(|next| next.start_s <= now_s) {
            self.legs.pop_front();
        }
    }

    /// Returns the places for a position, in whole steps. A motor that stalls at an end of the frame loses steps.
    fn whole_steps(&mut self, to_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|n| {
            let (at_mm, place_mm) = self.anchors_mm[n];
            let steps = ((to_mm[n] - at_mm) * self.board.steps_per_mm[n]).round();
            let wanted_mm = place_mm + steps / self.board.steps_per_mm[n];
            let reached_mm = self.within_ends(n, wanted_mm);
            self.anchors_mm[n].1 += reached_mm - wanted_mm;
            reached_mm
        })
    }

    fn within_ends(&self, axis: usize, place_mm: f64) -> f64 {
        let min_mm = self.board.min_ends_mm[axis];
        place_mm.clamp(min_mm, min_mm + self.board.lengths_mm[axis])
    }
}

impl QueuedMove {
    /// Whether the next move goes on along the same line at the same speed.
    fn runs_into(&self, next: &QueuedMove) -> bool {
        let turn = (0..3).map(|n| (self.way[n] - next.way[n]).abs()).fold(0.0, f64::max);
        turn < 1e-6 && self.speed_mm_s == next.speed_mm_s && self.accel_mm_s2 == next.accel_mm_s2
    }
}

impl Leg {
    fn end_mm(&self) -> [f64; 3] {
        self.planned.each_ref().map(Trajectory::end_mm)
    }
}

/// Trajectory of an axis that is at rest from `since_s` on.
fn rest(place_mm: f64, since_s: f64) -> Trajectory {
    Trajectory::stop(since_s, (place_mm, 0.0), 1.0)
}

fn length(way: [f64; 3]) -> f64 {
    way.iter().map(|way| way * way).sum::<f64>().sqrt()
}
