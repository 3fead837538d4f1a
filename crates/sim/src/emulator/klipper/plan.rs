//! What Klipper has planned: moves at their print times, as they are commanded and as the motors make them.

use super::board::KlipperBoard;
use crate::emulator::grbl::machine::rest;
use crate::scene::{Scene, Trajectory};
use palpate_core::quantity::Axis;
use std::collections::VecDeque;

/// Time between the planning of a first move and its begin, s (BUFFER_TIME_START).
pub(super) const START_S: f64 = 0.25;
/// Ratio of the deceleration of an axis whose steps end to the largest acceleration.
const CUT_OFF_FACTOR: f64 = 4.0;
/// Distance that is none, mm.
const ROUNDING: f64 = 1e-9;

/// Planned moves. They can't be changed any more.
#[derive(Clone)]
pub(super) struct Plan {
    /// End of the last move, s.
    pub print_time_s: f64,
    /// Time of the first motion since the idle timeout, s.
    pub active_s: Option<f64>,
    /// Places at the end of the last move, mm in the scene.
    pub places_mm: [f64; 3],
    /// Position of each axis when it was last set, mm, and its place in the scene then, mm.
    anchors_mm: [(f64, f64); 3],
    /// Moves, the present one first. There is always one.
    legs: VecDeque<Leg>,
}

/// A planned move: as commanded, and as the motors make it.
#[derive(Clone)]
struct Leg {
    start_s: f64,
    end_s: f64,
    commanded: [Trajectory; 3],
    real: [Trajectory; 3],
}

impl Plan {
    /// Creates the plan of a printer that rests at position 0.
    pub(super) fn new(scene: &Scene) -> Self {
        let places_mm = Axis::ALL.map(|axis| scene.motion(axis).end_mm());
        let anchors_mm = [(0.0, 0.0); 3];
        let mut plan = Plan { print_time_s: 0.0, active_s: None, places_mm, anchors_mm, legs: VecDeque::new() };
        plan.set_position([0.0; 3]);
        plan
    }

    /// Lets the print time be at least the earliest start of a move.
    pub(super) fn synchronize(&mut self, now_s: f64) {
        if now_s + START_S > self.print_time_s {
            self.print_time_s = now_s + START_S;
            self.active_s.get_or_insert(now_s);
        }
    }

    /// Position at the end of the last move, mm.
    pub(super) fn end_mm(&self) -> [f64; 3] {
        self.legs.back().map_or([0.0; 3], |leg| leg.commanded.each_ref().map(Trajectory::end_mm))
    }

    /// Position of the motors at the end of the last move, mm.
    pub(super) fn stepped_mm(&self) -> [f64; 3] {
        std::array::from_fn(|n| self.places_mm[n] - self.anchors_mm[n].1 + self.anchors_mm[n].0)
    }

    /// Sets the position at the end of the last move. The axes stay.
    pub(super) fn set_position(&mut self, at_mm: [f64; 3]) {
        self.anchors_mm = std::array::from_fn(|n| (at_mm[n], self.places_mm[n]));
        let at_s = self.print_time_s;
        let (commanded, real) = (at_mm.map(|mm| rest(mm, at_s)), self.places_mm.map(|mm| rest(mm, at_s)));
        self.legs.push_back(Leg { start_s: at_s, end_s: at_s, commanded, real });
    }

    /// Adds a straight move between two positions, during which the axes go to some places.
    pub(super) fn add(
        &mut self,
        [from_mm, to_mm]: [[f64; 3]; 2],
        places_mm: [f64; 3],
        speed_mm_s: f64,
        accel_mm_s2: f64,
    ) {
        let start_s = self.print_time_s;
        let length_mm = length(std::array::from_fn(|n| to_mm[n] - from_mm[n]));
        // ways of other lengths take the same time: whole steps, or an axis at its end
        let way = |from_mm: f64, to_mm: f64| {
            let share = (to_mm - from_mm).abs() / length_mm;
            if (to_mm - from_mm).abs() < ROUNDING || length_mm < ROUNDING {
                return rest(to_mm, start_s);
            }
            Trajectory::to(start_s, (from_mm, 0.0), to_mm, speed_mm_s * share, accel_mm_s2 * share)
        };
        let commanded: [Trajectory; 3] = std::array::from_fn(|n| way(from_mm[n], to_mm[n]));
        let real = std::array::from_fn(|n| way(self.places_mm[n], places_mm[n]));
        let end_s = commanded.iter().map(Trajectory::end_s).fold(start_s, f64::max);
        self.legs.push_back(Leg { start_s, end_s, commanded, real });
        (self.places_mm, self.print_time_s) = (places_mm, end_s);
    }

    /// Lets the last move be none for the position.
    pub(super) fn hide_last(&mut self, at_mm: [f64; 3]) {
        if let Some(leg) = self.legs.back_mut() {
            leg.commanded = at_mm.map(|mm| rest(mm, leg.end_s));
        }
    }

    /// Gives the scene what is planned.
    pub(super) fn act(&self, scene: &mut Scene, now_s: f64) {
        for axis in Axis::ALL {
            let way = rest(scene.motion(axis).position_mm(now_s), now_s);
            let legs = self.legs.iter().filter(|leg| leg.end_s > now_s);
            let way = legs.fold(way, |way, leg| way.then(&leg.real[axis.index()]));
            scene.set_motion(axis, way, now_s);
        }
    }

    /// Ends the steps at once. Moving axes go on a little. Commanded positions stay.
    pub(super) fn cut_off(&mut self, board: &KlipperBoard, scene: &mut Scene, now_s: f64) {
        for axis in Axis::ALL {
            let (n, motion) = (axis.index(), scene.motion(axis));
            let (place_mm, speed_mm_s) = (motion.position_mm(now_s), motion.speed_mm_s(now_s));
            // the end of the frame stops what the brake doesn't
            let room_mm = (board.within_ends(n, place_mm + speed_mm_s.signum() * 1e6) - place_mm).abs();
            let needed_mm_s2 = speed_mm_s * speed_mm_s / (2.0 * room_mm.max(ROUNDING));
            let brake_mm_s2 = needed_mm_s2.max(CUT_OFF_FACTOR * board.max_accel_mm_s2);
            let way = Trajectory::stop(now_s, (place_mm, speed_mm_s), brake_mm_s2);
            self.places_mm[n] = way.end_mm();
            scene.set_motion(axis, way, now_s);
        }
    }

    /// Position and speed that are commanded for a time, mm and mm/s. Earlier moves are forgotten.
    pub(super) fn live(&mut self, now_s: f64) -> ([f64; 3], f64) {
        self.forget(now_s);
        self.legs.front().map_or(([0.0; 3], 0.0), |leg| {
            let speeds_mm_s = leg.commanded.each_ref().map(|axis| axis.speed_mm_s(now_s));
            (leg.commanded.each_ref().map(|axis| axis.position_mm(now_s)), length(speeds_mm_s))
        })
    }

    /// Forgets the moves before the present one.
    pub(super) fn forget(&mut self, now_s: f64) {
        while self.legs.get(1).is_some_and(|next| next.start_s <= now_s) {
            self.legs.pop_front();
        }
    }

    /// Returns the places for a position, in whole steps. A motor that stalls at an end of the frame loses steps.
    pub(super) fn whole_steps(&mut self, board: &KlipperBoard, to_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|n| {
            let (at_mm, place_mm) = self.anchors_mm[n];
            let steps = ((to_mm[n] - at_mm) * board.steps_per_mm[n]).round();
            let wanted_mm = place_mm + steps / board.steps_per_mm[n];
            let reached_mm = board.within_ends(n, wanted_mm);
            self.anchors_mm[n].1 += reached_mm - wanted_mm;
            reached_mm
        })
    }
}

/// Length of a way, mm, or a speed along it.
pub(super) fn length(way: [f64; 3]) -> f64 {
    way.iter().map(|way| way * way).sum::<f64>().sqrt()
}
