//! The three axes: planned motions, the running motion, and homing.

use super::board::MotionBoard;
use crate::scene::{Scene, Trajectory};
use palpate_core::quantity::Axis;
use std::collections::VecDeque;

/// Number of blocks that the planner holds.
pub(super) const BLOCKS_MOST: usize = 15;
/// Axes that GRBL homes together, in order. z is first, so that it is out of the way.
const HOMING_TURNS: [&[Axis]; 2] = [&[Axis::Z], &[Axis::X, Axis::Y]];
/// Ratio of the deceleration after a cut-off of the steps to the normal braking. GRBL doesn't count the remaining motion.
pub(in crate::emulator) const CUT_OFF_FACTOR: f64 = 4.0;
/// Speed of an axis that slips, mm/s.
const SLIP_MM_S: f64 = 10.0;
/// Acceleration of an axis that slips, mm/s^2.
const SLIP_MM_S2: f64 = 500.0;
/// Tolerance for rounding: of a point on a line (fraction of the line's length), and of a pressed switch (mm).
const ROUNDING: f64 = 1e-9;

/// The three axes and the controller's knowledge of them. Places are machine coordinates: counted steps in mm. They differ from
/// the true places until the frame is homed. There is no encoder, so the controller reports the commanded place.
///
/// Blocks are planned ahead as motions of the scene, so they run even if nobody asks. An axis stops at each corner (GRBL would
/// round it, slowly). Blocks on one line at one rate are joined into one block.
pub(in crate::emulator) struct Machine {
    /// The frame and the settings.
    pub board: MotionBoard,
    /// True place minus counted place, mm.
    offset_mm: [f64; 3],
    blocks: VecDeque<StraightMotion>,
    /// Where the last line goes, not rounded to steps, mm.
    sent_mm: [f64; 3],
    /// Time at which the braking of the cancelled motion ends, s; the blocks are removed then.
    cancelled_s: Option<f64>,
    /// Time at which the axes rest in a feed hold, s.
    held_s: Option<f64>,
}

/// Request of a line: a motion to a place, machine mm, at a feed, mm/min, or as fast as possible.
#[derive(Clone, Copy, Debug)]
pub(in crate::emulator) struct PlannedLine {
    /// Target of the motion.
    pub to_mm: [f64; 3],
    /// Speed of the motion.
    pub feed_mm_min: Option<f64>,
    /// Largest acceleration along the line, mm/s^2; each axis has its own limit besides.
    pub most_mm_s2: f64,
    /// Whether it is a jog.
    pub jog: bool,
}

/// Search of one axis for its home.
#[derive(Clone, Debug)]
pub(in crate::emulator) struct HomingSearch {
    /// Places to move to, true mm, each with its speed, mm/s.
    pub phases: Vec<(f64, f64)>,
    /// What the axis counts at the last of them, mm.
    pub home_mm: f64,
}

/// Straight motion.
#[derive(Debug)]
struct StraightMotion {
    to_mm: [f64; 3],
    /// Components of the distance along each axis.
    way: [f64; 3],
    /// Programmed rate, mm/s; `None`: as fast as possible.
    feed_mm_s: Option<f64>,
    most_mm_s: f64,
    acceleration_mm_s2: f64,
    jog: bool,
    end_s: f64,
    /// Whether the motion runs into an end of the frame.
    hits: bool,
}

/// Activity of the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Activity {
    /// No motion.
    Idle,
    /// Lines with G0 and G1.
    Run,
    /// Jogs.
    Jog,
}

/// The result of a search for home.
#[derive(Clone, Copy, Debug)]
pub(in crate::emulator) struct Homed {
    /// Time of the end, s.
    pub end_s: f64,
    /// True place minus counted place at that time, mm.
    offset_mm: [f64; 3],
}

impl Machine {
    /// Creates a frame at power-on: its present place counts as zero.
    pub(in crate::emulator) fn new(board: MotionBoard, scene: &Scene) -> Self {
        let offset_mm = Axis::ALL.map(|axis| scene.motion(axis).end_mm());
        Machine { board, offset_mm, blocks: VecDeque::new(), sent_mm: [0.0; 3], cancelled_s: None, held_s: None }
    }

    /// Switches the controller off and on: the axes stop, and their present places count as zero.
    pub(in crate::emulator) fn power_cycle(&mut self, scene: &mut Scene, now_s: f64) {
        self.cut_off(scene, now_s);
        self.offset_mm = Axis::ALL.map(|axis| scene.motion(axis).end_mm());
    }

    /// Applies the effects of everything that has ended by `now_s`.
    pub(in crate::emulator) fn settle(&mut self, scene: &mut Scene, now_s: f64) {
        if let Some(cancelled_s) = self.cancelled_s {
            if now_s >= cancelled_s {
                self.blocks.clear();
                self.cancelled_s = None;
            }
            return;
        }
        while self.held_s.is_none() && self.blocks.front().is_some_and(|block| block.end_s <= now_s) {
            if let Some(block) = self.blocks.pop_front().filter(|block| block.hits) {
                // the motor stalled at the end, but its steps were counted
                let ends_mm = self.targets(&block);
                self.offset_mm = std::array::from_fn(|n| ends_mm[n] - block.to_mm[n]);
                self.plan(scene, now_s);
            }
        }
    }

    /// Activity of the axes, as of the last [`settle`](Self::settle).
    pub(super) fn activity(&self) -> Activity {
        match self.blocks.front() {
            None => Activity::Idle,
            Some(block) if block.jog => Activity::Jog,
            Some(_) => Activity::Run,
        }
    }

    /// Time at which another block can be accepted, s. This is at once unless the planner is full or a motion is being cancelled.
    pub(in crate::emulator) fn ready_s(&self) -> f64 {
        match (self.cancelled_s, self.blocks.front()) {
            (Some(cancelled_s), _) => cancelled_s,
            (None, Some(front)) if self.blocks.len() == BLOCKS_MOST => front.end_s,
            _ => 0.0,
        }
    }

    /// Time at which all planned motions have ended, s.
    pub(in crate::emulator) fn end_s(&self) -> f64 {
        self.cancelled_s.unwrap_or_else(|| self.blocks.back().map_or(0.0, |block| block.end_s))
    }

    /// Positions of the axes, machine mm, rounded to steps.
    pub(in crate::emulator) fn places_mm(&self, scene: &Scene, now_s: f64) -> [f64; 3] {
        self.whole_steps(std::array::from_fn(|n| scene.motion(Axis::ALL[n]).position_mm(now_s) - self.offset_mm[n]))
    }

    /// Place from which a line counts, machine mm: where the last one was sent, not rounded to steps (gcode.c, `gc_state.position`), unless
    /// the axes were stopped elsewhere.
    pub(super) fn parsed_mm(&self, scene: &Scene, now_s: f64) -> [f64; 3] {
        let end_mm = self.end_mm(scene, now_s);
        let sent_mm = self.whole_steps(self.sent_mm);
        let is_there = (0..3).all(|n| (sent_mm[n] - end_mm[n]).abs() < ROUNDING);
        if is_there { self.sent_mm } else { end_mm }
    }

    /// End of the planned motions, machine mm.
    fn end_mm(&self, scene: &Scene, now_s: f64) -> [f64; 3] {
        self.blocks.back().map_or_else(|| self.places_mm(scene, now_s), |block| block.to_mm)
    }

    /// Speed of the tool, mm/s.
    pub(super) fn speed_mm_s(&self, scene: &Scene, now_s: f64) -> f64 {
        Axis::ALL.map(|axis| scene.motion(axis).speed_mm_s(now_s).powi(2)).iter().sum::<f64>().sqrt()
    }

    /// Axes whose limit switch is pressed.
    pub(super) fn switches(&self, scene: &Scene, now_s: f64) -> [bool; 3] {
        std::array::from_fn(|n| {
            let (min_mm, max_mm) = self.board.ends_mm(n);
            let place_mm = scene.motion(Axis::ALL[n]).position_mm(now_s);
            place_mm <= min_mm + ROUNDING || place_mm >= max_mm - ROUNDING
        })
    }

    /// Plans one more line. There is always room, because GRBL checks this first ([`ready_s`](Self::ready_s)).
    pub(in crate::emulator) fn add(&mut self, line: PlannedLine, scene: &mut Scene, now_s: f64) {
        let from_mm = self.end_mm(scene, now_s);
        let to_mm = self.whole_steps(line.to_mm);
        self.sent_mm = line.to_mm;
        let way_mm: [f64; 3] = std::array::from_fn(|n| to_mm[n] - from_mm[n]);
        let length_mm = way_mm.iter().map(|way| way * way).sum::<f64>().sqrt();
        if length_mm < ROUNDING || self.blocks.len() >= BLOCKS_MOST {
            return;
        }
        let way = way_mm.map(|way_mm| way_mm / length_mm);
        // no axis may exceed its own limit along the line
        let settings = &self.board.settings;
        let most_along = |most: &dyn Fn(usize) -> f64| {
            (0..3).filter(|&n| way[n] != 0.0).map(|n| most(n) / way[n].abs()).fold(f64::INFINITY, f64::min)
        };
        let block = StraightMotion {
            to_mm,
            way,
            feed_mm_s: line.feed_mm_min.map(|feed| feed / 60.0),
            most_mm_s: most_along(&|n| settings.most_mm_s(n)),
            acceleration_mm_s2: most_along(&|n| settings.acceleration_mm_s2(n)).min(line.most_mm_s2),
            jog: line.jog,
            end_s: 0.0,
            hits: false,
        };
        match self.blocks.back_mut() {
            Some(last) if last.runs_into(&block) => last.to_mm = block.to_mm,
            _ => self.blocks.push_back(block),
        }
        self.plan(scene, now_s);
    }

    /// Starts all blocks again, from the present places and speeds of the axes.
    pub(super) fn plan(&mut self, scene: &mut Scene, now_s: f64) {
        if self.cancelled_s.is_some() || self.held_s.is_some() || self.blocks.is_empty() {
            return;
        }
        let mut ways = Axis::ALL.map(|axis| rest(scene.motion(axis).position_mm(now_s), now_s));
        let mut states = Axis::ALL.map(|axis| commanded(scene, axis, now_s));
        let mut from_s = now_s;
        for index in 0..self.blocks.len() {
            let block = &self.blocks[index];
            let targets = self.targets(block);
            let speed_mm_s = block.feed_mm_s.unwrap_or(f64::INFINITY).min(block.most_mm_s);
            let mut end_s = from_s;
            for n in 0..3 {
                let share = block.way[n].abs();
                if share <= ROUNDING {
                    continue;
                }
                let acceleration_mm_s2 = block.acceleration_mm_s2 * share;
                let leg = Trajectory::to(from_s, states[n], targets[n], speed_mm_s * share, acceleration_mm_s2);
                end_s = end_s.max(leg.end_s());
                states[n] = (targets[n], 0.0);
                ways[n] = ways[n].clone().then(&leg);
            }
            let hits = (0..3).any(|n| (targets[n] - block.to_mm[n] - self.offset_mm[n]).abs() > ROUNDING);
            let block = &mut self.blocks[index];
            (block.end_s, block.hits) = (end_s, hits);
            from_s = end_s;
        }
        for (axis, way) in Axis::ALL.into_iter().zip(ways) {
            scene.set_motion(axis, way, now_s);
        }
    }

    /// Brakes, and removes all blocks when the axes are at rest.
    pub(super) fn cancel(&mut self, scene: &mut Scene, now_s: f64) {
        if let Some(front) = self.blocks.front().filter(|_| self.cancelled_s.is_none()) {
            let decelerations_mm_s2 = front.way.map(|way| way.abs() * front.acceleration_mm_s2);
            self.cancelled_s = Some(self.brake(decelerations_mm_s2, scene, now_s));
        }
    }

    /// Brakes, and keeps what is planned until it is [resumed](Self::resume).
    pub(super) fn hold(&mut self, scene: &mut Scene, now_s: f64) {
        if self.held_s.is_none() {
            let front = self.blocks.front();
            let along = |n: usize| front.map_or(0.0, |front| front.way[n].abs() * front.acceleration_mm_s2);
            self.held_s = Some(self.brake(std::array::from_fn(along), scene, now_s));
        }
    }

    /// Resumes what is held and rests.
    pub(super) fn resume(&mut self, scene: &mut Scene, now_s: f64) {
        if self.held_s.take_if(|rests_s| *rests_s <= now_s).is_some() {
            self.plan(scene, now_s);
        }
    }

    /// Time at which the axes rest in a feed hold, s; `None` without one.
    pub(super) fn held_s(&self) -> Option<f64> {
        self.held_s
    }

    /// Stops the steps at once and removes all blocks. The count stays unchanged, but moving axes continue a little by inertia.
    pub(in crate::emulator) fn cut_off(&mut self, scene: &mut Scene, now_s: f64) {
        let counted_mm = self.places_mm(scene, now_s);
        let coasts = self.speed_mm_s(scene, now_s) > 0.0;
        self.blocks.clear();
        (self.cancelled_s, self.held_s) = (None, None);
        if coasts {
            let decelerations_mm_s2 =
                std::array::from_fn(|n| CUT_OFF_FACTOR * self.board.settings.acceleration_mm_s2(n));
            self.brake(decelerations_mm_s2, scene, now_s);
            self.offset_mm = std::array::from_fn(|n| scene.motion(Axis::ALL[n]).end_mm() - counted_mm[n]);
        }
    }

    /// Homes all axes: to the switch at the seek rate, off it, to it at the locate rate, off it. Only a search that has reached
    /// its end [counts](Self::is_home).
    pub(super) fn home(&mut self, scene: &mut Scene, now_s: f64) -> Homed {
        let settings = &self.board.settings;
        let (seek_mm_s, locate_mm_s, debounce_s) =
            (settings.seek_mm_s(), settings.locate_mm_s(), settings.debounce_s());
        let searches = Axis::ALL.map(|axis| {
            let (switch_mm, off_mm) = self.board.switch_mm(axis.index());
            let places = [(switch_mm, seek_mm_s), (off_mm, seek_mm_s), (switch_mm, locate_mm_s), (off_mm, locate_mm_s)];
            HomingSearch { phases: places.into(), home_mm: self.board.home_mm(axis.index()) }
        });
        self.search(&HOMING_TURNS, &searches, debounce_s, scene, now_s)
    }

    /// Searches for home, turn by turn, the axes of a turn together. Each phase ends with a rest. Only a search that has reached
    /// its end [counts](Self::is_home).
    pub(in crate::emulator) fn search(
        &mut self,
        turns: &[&[Axis]],
        searches: &[HomingSearch; 3],
        rest_s: f64,
        scene: &mut Scene,
        now_s: f64,
    ) -> Homed {
        self.cut_off(scene, now_s);
        let mut from_s = Axis::ALL.into_iter().map(|axis| scene.motion(axis).end_s()).fold(now_s, f64::max);
        let mut offset_mm = self.offset_mm;
        for turn in turns {
            let mut turn_ends_s = from_s;
            for &axis in *turn {
                let search = &searches[axis.index()];
                let way = self.homing_way(axis, &search.phases, rest_s, from_s, scene);
                turn_ends_s = turn_ends_s.max(way.end_s());
                let motion = scene.motion(axis);
                let first = if motion.moving(now_s) { motion.clone() } else { rest(motion.end_mm(), now_s) };
                scene.set_motion(axis, first.then(&way), now_s);
                offset_mm[axis.index()] = way.end_mm() - search.home_mm;
            }
            from_s = turn_ends_s;
        }
        Homed { end_s: from_s, offset_mm }
    }

    /// States what the axes count where they come to rest, mm.
    pub(in crate::emulator) fn count_from(&mut self, counts_mm: [f64; 3], scene: &Scene) {
        self.offset_mm = std::array::from_fn(|n| scene.motion(Axis::ALL[n]).end_mm() - counts_mm[n]);
    }

    /// Changes what the axes count, mm. What is planned is made all the same.
    pub(in crate::emulator) fn miscount(&mut self, by_mm: [f64; 3]) {
        for (n, by_mm) in by_mm.into_iter().enumerate() {
            self.offset_mm[n] -= by_mm;
            self.blocks.iter_mut().for_each(|block| block.to_mm[n] += by_mm);
        }
    }

    /// Moves the axes by a distance, mm, that isn't counted, up to the ends of the frame. They move by weight or by hand.
    pub(in crate::emulator) fn slip(&mut self, by_mm: [f64; 3], scene: &mut Scene, now_s: f64) {
        for axis in Axis::ALL.into_iter().filter(|axis| by_mm[axis.index()] != 0.0) {
            let n = axis.index();
            let (min_mm, max_mm) = self.board.ends_mm(n);
            let from_mm = scene.motion(axis).end_mm();
            let to_mm = (from_mm + by_mm[n]).clamp(min_mm, max_mm);
            let way = Trajectory::to(now_s, commanded(scene, axis, now_s), to_mm, SLIP_MM_S, SLIP_MM_S2);
            scene.set_motion(axis, way, now_s);
            self.offset_mm[n] += to_mm - from_mm;
        }
    }

    /// Ends the search for home: the position is now known.
    pub(in crate::emulator) fn is_home(&mut self, homed: Homed) {
        self.offset_mm = homed.offset_mm;
    }

    /// Returns the end of a block, true mm: its target, or the end of the frame before the target.
    fn targets(&self, block: &StraightMotion) -> [f64; 3] {
        std::array::from_fn(|n| {
            let (min_mm, max_mm) = self.board.ends_mm(n);
            (block.to_mm[n] + self.offset_mm[n]).clamp(min_mm, max_mm)
        })
    }

    fn whole_steps(&self, places_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|n| {
            let steps_per_mm = self.board.settings.steps_per_mm(n);
            (places_mm[n] * steps_per_mm).round() / steps_per_mm
        })
    }

    /// Brings all axes to rest, and returns the time at which they are at rest, s.
    fn brake(&self, decelerations_mm_s2: [f64; 3], scene: &mut Scene, now_s: f64) -> f64 {
        let mut end_s = now_s;
        for axis in Axis::ALL {
            let n = axis.index();
            let way = braked(scene.motion(axis), self.board.ends_mm(n), decelerations_mm_s2[n], now_s);
            end_s = end_s.max(way.end_s());
            scene.set_motion(axis, way, now_s);
        }
        end_s
    }

    fn homing_way(&self, axis: Axis, phases: &[(f64, f64)], rest_s: f64, from_s: f64, scene: &Scene) -> Trajectory {
        let start_mm = scene.motion(axis).end_mm();
        let mut way = rest(start_mm, from_s);
        let mut at = (from_s, start_mm);
        for &(target_mm, speed_mm_s) in phases {
            let acceleration_mm_s2 = self.board.settings.acceleration_mm_s2(axis.index());
            let leg = Trajectory::to(at.0, (at.1, 0.0), target_mm, speed_mm_s, acceleration_mm_s2);
            at = (leg.end_s() + rest_s, target_mm);
            way = way.then(&leg);
        }
        way
    }
}

impl StraightMotion {
    /// Whether the next block continues along the same line at the same rate.
    fn runs_into(&self, next: &StraightMotion) -> bool {
        let turn = (0..3).map(|n| (self.way[n] - next.way[n]).abs()).fold(0.0, f64::max);
        self.jog == next.jog && self.feed_mm_s == next.feed_mm_s && turn < ROUNDING
    }
}

/// Trajectory of an axis that is at rest from `since_s` on.
pub(in crate::emulator) fn rest(place_mm: f64, since_s: f64) -> Trajectory {
    Trajectory::stop(since_s, (place_mm, 0.0), 1.0)
}

/// Returns how an axis comes to rest with a deceleration. The end of the frame, mm, stops what the brake doesn't.
pub(in crate::emulator) fn braked(
    motion: &Trajectory,
    (min_mm, max_mm): (f64, f64),
    deceleration_mm_s2: f64,
    now_s: f64,
) -> Trajectory {
    let (place_mm, speed_mm_s) = (motion.position_mm(now_s), motion.speed_mm_s(now_s));
    if speed_mm_s == 0.0 {
        return rest(place_mm, now_s);
    }
    let room_mm = if speed_mm_s > 0.0 { max_mm - place_mm } else { place_mm - min_mm };
    let needed_mm_s2 = speed_mm_s * speed_mm_s / (2.0 * room_mm.max(ROUNDING));
    Trajectory::stop(now_s, (place_mm, speed_mm_s), deceleration_mm_s2.max(needed_mm_s2))
}

fn commanded(scene: &Scene, axis: Axis, now_s: f64) -> (f64, f64) {
    let motion = scene.motion(axis);
    (motion.position_mm(now_s), motion.speed_mm_s(now_s))
}
