//! The three axes: what is planned, what runs, and homing.

use super::settings::{self, Settings};
use crate::quantity::Axis;
use crate::scene::{Scene, Trajectory};
use std::collections::VecDeque;

/// How far the frame goes to either side of its middle, true mm: a limit switch is at each end.
pub const END_MM: f64 = 12.5;
/// Blocks the planner holds.
pub const BLOCKS_MOST: usize = 15;
/// Axes that GRBL homes together, in turn: z first, out of the way.
const HOMING_TURNS: [&[Axis]; 2] = [&[Axis::Z], &[Axis::X, Axis::Y]];
/// A switch is looked for so many travels far.
const SEARCH_TRAVELS: f64 = 1.5;
/// Steps that are cut off stop an axis this much harder than it would brake; GRBL doesn't count how far it coasts.
const CUT_OFF_FACTOR: f64 = 4.0;
/// How far beside a line a place may lie to be on it (part of the line's length), and a switch to be pressed (mm).
const ROUNDING: f64 = 1e-9;

/// The three axes and what the controller knows of them. Places are machine coordinates, that is counted steps in mm, off
/// from the true ones until the frame is homed. There is no encoder: what is told is what was commanded.
///
/// Blocks are planned ahead as motions of the scene, so they run on whether or not anybody asks. An axis stops at each
/// corner (GRBL would round it, slowly); blocks on one line at one rate become one.
pub struct Machine {
    /// True place less counted, mm.
    offset_mm: [f64; 3],
    blocks: VecDeque<Block>,
    halt: Halt,
    /// When a brake is done, s.
    halted_s: f64,
}

/// What a line asks for: to a place, machine mm; at a feed, mm/min, or as fast as it goes.
#[derive(Clone, Copy, Debug)]
pub struct PlannedLine {
    /// Where to.
    pub to_mm: [f64; 3],
    /// How fast.
    pub feed_mm_min: Option<f64>,
    /// Whether it is a jog.
    pub jog: bool,
}

/// One straight motion.
#[derive(Debug)]
struct Block {
    to_mm: [f64; 3],
    /// Parts of the way along each axis.
    way: [f64; 3],
    /// Programmed rate, mm/s; none: as fast as it goes.
    feed_mm_s: Option<f64>,
    most_mm_s: f64,
    acceleration_mm_s2: f64,
    jog: bool,
    end_s: f64,
    /// Runs into an end of the frame.
    hits: bool,
}

/// What became of the blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Halt {
    None,
    /// Held; they are kept.
    Hold,
    /// A jog was cancelled; they go when it stands.
    Cancel,
}

/// What the axes are about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Activity {
    /// Nothing.
    Idle,
    /// Lines with G0 and G1.
    Run,
    /// Jogs.
    Jog,
    /// On the way to a hold.
    Braking,
    /// In a hold.
    Held,
}

/// What a search for home comes to when it ends.
#[derive(Clone, Copy, Debug)]
pub struct Homed {
    /// When, s.
    pub end_s: f64,
    /// True place less counted then, mm.
    offset_mm: [f64; 3],
}

/// Why homing fails, as the alarm's number.
pub const SWITCH_NOT_CLEARED: u8 = 8;
/// Why homing fails, as the alarm's number.
pub const SWITCH_NOT_FOUND: u8 = 9;

impl Machine {
    /// A frame that is switched on: where it stands is zero.
    pub fn new(scene: &Scene) -> Self {
        let offset_mm = Axis::ALL.map(|axis| scene.motion(axis).end_mm());
        Machine { offset_mm, blocks: VecDeque::new(), halt: Halt::None, halted_s: 0.0 }
    }

    /// Draws the consequences of what has ended by `now_s`: whether an axis ran into an end.
    pub fn settle(&mut self, scene: &mut Scene, now_s: f64) -> bool {
        match self.halt {
            Halt::Cancel if now_s >= self.halted_s => {
                self.blocks.clear();
                self.halt = Halt::None;
            }
            Halt::None => {
                while self.blocks.front().is_some_and(|block| block.end_s <= now_s) {
                    if let Some(block) = self.blocks.pop_front().filter(|block| block.hits) {
                        // the motor stalled at the end: the steps were counted all the same
                        let ends_mm = self.targets(&block);
                        self.offset_mm = std::array::from_fn(|n| ends_mm[n] - block.to_mm[n]);
                        self.plan(scene, now_s);
                        return true;
                    }
                }
            }
            Halt::Cancel | Halt::Hold => {}
        }
        false
    }

    /// What the axes are about, as of the last [`settle`](Self::settle).
    pub fn activity(&self, now_s: f64) -> Activity {
        match (self.halt, self.blocks.front()) {
            (Halt::Hold, _) if now_s < self.halted_s => Activity::Braking,
            (Halt::Hold, _) => Activity::Held,
            (_, None) => Activity::Idle,
            (_, Some(block)) if block.jog => Activity::Jog,
            (_, Some(_)) => Activity::Run,
        }
    }

    /// Whether it is held, or on the way to it.
    pub fn is_held(&self) -> bool {
        self.halt == Halt::Hold
    }

    /// Blocks that the planner has room for.
    pub fn room(&self) -> usize {
        BLOCKS_MOST - self.blocks.len()
    }

    /// When a further block can be taken, s: at once unless the planner is full or a jog is being cancelled.
    pub fn ready_s(&self) -> f64 {
        match (self.halt, self.blocks.front()) {
            (Halt::Cancel, _) => self.halted_s,
            (_, Some(front)) if self.blocks.len() == BLOCKS_MOST => front.end_s,
            _ => 0.0,
        }
    }

    /// When all that is planned has run, s.
    pub fn end_s(&self) -> f64 {
        let planned_s = self.blocks.back().map_or(0.0, |block| block.end_s);
        if self.halt == Halt::Cancel { self.halted_s } else { planned_s }
    }

    /// Where the axes are, machine mm, in whole steps.
    pub fn places_mm(&self, settings: &Settings, scene: &Scene, now_s: f64) -> [f64; 3] {
        let steps = settings.of_axes(settings::STEPS);
        let count_mm = |n: usize| scene.motion(Axis::ALL[n]).position_mm(now_s) - self.offset_mm[n];
        std::array::from_fn(|n| whole_steps(count_mm(n), steps[n]))
    }

    /// Where the motions that are planned end, machine mm.
    pub fn end_mm(&self, settings: &Settings, scene: &Scene, now_s: f64) -> [f64; 3] {
        self.blocks.back().map_or_else(|| self.places_mm(settings, scene, now_s), |block| block.to_mm)
    }

    /// How fast the tool moves, mm/s.
    pub fn speed_mm_s(&self, scene: &Scene, now_s: f64) -> f64 {
        Axis::ALL.map(|axis| scene.motion(axis).speed_mm_s(now_s).powi(2)).iter().sum::<f64>().sqrt()
    }

    /// The axes whose limit switch is pressed.
    pub fn switches(&self, scene: &Scene, now_s: f64) -> [bool; 3] {
        Axis::ALL.map(|axis| scene.motion(axis).position_mm(now_s).abs() >= END_MM - ROUNDING)
    }

    /// Plans one more line; GRBL looks for room before ([`ready_s`](Self::ready_s)), so there is some.
    pub fn add(&mut self, line: PlannedLine, settings: &Settings, scene: &mut Scene, now_s: f64) {
        let from_mm = self.end_mm(settings, scene, now_s);
        let steps = settings.of_axes(settings::STEPS);
        let to_mm: [f64; 3] = std::array::from_fn(|n| whole_steps(line.to_mm[n], steps[n]));
        let way_mm: [f64; 3] = std::array::from_fn(|n| to_mm[n] - from_mm[n]);
        let length_mm = way_mm.iter().map(|way| way * way).sum::<f64>().sqrt();
        if length_mm < ROUNDING || self.blocks.len() >= BLOCKS_MOST {
            return;
        }
        let way = way_mm.map(|way_mm| way_mm / length_mm);
        // along the line, no axis may do more than its own most
        let least_over_way = |most: [f64; 3]| {
            let each = most.iter().zip(way).filter(|(_, way)| way.abs() > ROUNDING).map(|(most, way)| most / way.abs());
            each.fold(f64::INFINITY, f64::min)
        };
        let block = Block {
            to_mm,
            way,
            feed_mm_s: line.feed_mm_min.map(|feed| feed / 60.0),
            most_mm_s: least_over_way(settings.of_axes(settings::MOST_RATE)) / 60.0,
            acceleration_mm_s2: least_over_way(settings.of_axes(settings::ACCELERATION)),
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

    /// Puts all blocks on their way again, from where the axes are and as fast as they are.
    pub fn plan(&mut self, scene: &mut Scene, now_s: f64) {
        if self.halt != Halt::None || self.blocks.is_empty() {
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

    /// Brakes to a hold; a jog is cancelled by it.
    pub fn hold(&mut self, scene: &mut Scene, now_s: f64) {
        if self.halt != Halt::None {
            return;
        }
        (self.halt, self.halted_s) = match self.blocks.front() {
            None => (Halt::Hold, now_s),
            Some(front) => {
                let decelerations_mm_s2 = front.way.map(|way| way.abs() * front.acceleration_mm_s2);
                let halt = if front.jog { Halt::Cancel } else { Halt::Hold };
                (halt, brake(decelerations_mm_s2, scene, now_s))
            }
        };
    }

    /// Goes on after a hold.
    pub fn resume(&mut self, scene: &mut Scene, now_s: f64) {
        if self.activity(now_s) == Activity::Held {
            self.halt = Halt::None;
            self.plan(scene, now_s);
        }
    }

    /// Cuts the steps off: forgets all blocks. The count stays where it is; axes that move coast on a little.
    pub fn cut_off(&mut self, settings: &Settings, scene: &mut Scene, now_s: f64) {
        let counted_mm = self.places_mm(settings, scene, now_s);
        let coasts = self.speed_mm_s(scene, now_s) > 0.0;
        self.blocks.clear();
        self.halt = Halt::None;
        if coasts {
            brake(settings.of_axes(settings::ACCELERATION).map(|most| most * CUT_OFF_FACTOR), scene, now_s);
            self.offset_mm = std::array::from_fn(|n| scene.motion(Axis::ALL[n]).end_mm() - counted_mm[n]);
        }
    }

    /// Homes all axes: to the switch at the seek rate, off it, to it at the locate rate, off it. Only what has got to its end
    /// [counts](Self::is_home).
    ///
    /// GRBL counts from 0 at the switch of a + end down to minus the travel. This build counts half a travel more, so
    /// that the middle of the travel is zero.
    ///
    /// # Errors
    /// The number of the alarm.
    pub fn home(&mut self, settings: &Settings, scene: &mut Scene, now_s: f64) -> Result<Homed, u8> {
        self.cut_off(settings, scene, now_s);
        let pull_off_mm = settings.get(settings::PULL_OFF);
        let travels_mm = settings.of_axes(settings::TRAVEL);
        let far = |axis: Axis| {
            let way_mm = (end(axis, settings) - scene.motion(axis).end_mm()).abs();
            way_mm > SEARCH_TRAVELS * travels_mm[axis.index()]
        };
        if Axis::ALL.into_iter().any(far) {
            return Err(SWITCH_NOT_FOUND);
        }
        if pull_off_mm == 0.0 {
            return Err(SWITCH_NOT_CLEARED);
        }
        let mut from_s = Axis::ALL.into_iter().map(|axis| scene.motion(axis).end_s()).fold(now_s, f64::max);
        let mut offset_mm = self.offset_mm;
        for turn in HOMING_TURNS {
            let mut turn_ends_s = from_s;
            for &axis in turn {
                let way = homing_way(axis, from_s, settings, scene);
                turn_ends_s = turn_ends_s.max(way.end_s());
                let motion = scene.motion(axis);
                let first = if motion.moving(now_s) { motion.clone() } else { rest(motion.end_mm(), now_s) };
                scene.set_motion(axis, first.then(&way), now_s);
                let n = axis.index();
                let half_mm = travels_mm[n] / 2.0 - pull_off_mm;
                offset_mm[n] = way.end_mm() - half_mm * end(axis, settings).signum();
            }
            from_s = turn_ends_s;
        }
        Ok(Homed { end_s: from_s, offset_mm })
    }

    /// The search for home is done: it knows where it is.
    pub fn is_home(&mut self, homed: Homed) {
        self.offset_mm = homed.offset_mm;
    }

    /// Where a block ends, true mm: at its target, or at the end of the frame before it.
    fn targets(&self, block: &Block) -> [f64; 3] {
        std::array::from_fn(|n| (block.to_mm[n] + self.offset_mm[n]).clamp(-END_MM, END_MM))
    }
}

impl Block {
    /// Whether another goes on along the same line at the same rate.
    fn runs_into(&self, next: &Block) -> bool {
        let turn = (0..3).map(|n| (self.way[n] - next.way[n]).abs()).fold(0.0, f64::max);
        self.jog == next.jog && self.feed_mm_s == next.feed_mm_s && turn < ROUNDING
    }
}

/// Brings all axes to rest, and tells when they are, s.
fn brake(decelerations_mm_s2: [f64; 3], scene: &mut Scene, now_s: f64) -> f64 {
    let mut end_s = now_s;
    for axis in Axis::ALL {
        let (place_mm, speed_mm_s) = commanded(scene, axis, now_s);
        let way = if speed_mm_s == 0.0 {
            rest(place_mm, now_s)
        } else {
            // the end of the frame stops what the brake doesn't
            let room_mm = END_MM - place_mm * speed_mm_s.signum();
            let needed_mm_s2 = speed_mm_s * speed_mm_s / (2.0 * room_mm.max(ROUNDING));
            Trajectory::stop(now_s, (place_mm, speed_mm_s), decelerations_mm_s2[axis.index()].max(needed_mm_s2))
        };
        end_s = end_s.max(way.end_s());
        scene.set_motion(axis, way, now_s);
    }
    end_s
}

/// The end of the frame that an axis homes to, true mm.
fn end(axis: Axis, settings: &Settings) -> f64 {
    let minus = settings.get(settings::HOMING_DIRECTIONS) as u8 >> axis.index() & 1 == 1;
    if minus { -END_MM } else { END_MM }
}

fn homing_way(axis: Axis, from_s: f64, settings: &Settings, scene: &Scene) -> Trajectory {
    let switch_mm = end(axis, settings);
    let off_mm = switch_mm - settings.get(settings::PULL_OFF).min(2.0 * END_MM) * switch_mm.signum();
    let seek_mm_s = settings.get(settings::SEEK_RATE) / 60.0;
    let locate_mm_s = settings.get(settings::LOCATE_RATE) / 60.0;
    let rest_s = settings.get(settings::DEBOUNCE) / 1000.0;
    let acceleration_mm_s2 = settings.of_axes(settings::ACCELERATION)[axis.index()];
    let start_mm = scene.motion(axis).end_mm();
    let phases = [(switch_mm, seek_mm_s), (off_mm, seek_mm_s), (switch_mm, locate_mm_s), (off_mm, locate_mm_s)];
    let mut way = rest(start_mm, from_s);
    let mut at = (from_s, start_mm);
    for (target_mm, speed_mm_s) in phases {
        let leg = Trajectory::to(at.0, (at.1, 0.0), target_mm, speed_mm_s, acceleration_mm_s2);
        at = (leg.end_s() + rest_s, target_mm);
        way = way.then(&leg);
    }
    way
}

/// An axis that stands from an instant on.
fn rest(place_mm: f64, since_s: f64) -> Trajectory {
    Trajectory::stop(since_s, (place_mm, 0.0), 1.0)
}

fn commanded(scene: &Scene, axis: Axis, now_s: f64) -> (f64, f64) {
    let motion = scene.motion(axis);
    (motion.position_mm(now_s), motion.speed_mm_s(now_s))
}

fn whole_steps(place_mm: f64, steps_per_mm: f64) -> f64 {
    (place_mm * steps_per_mm).round() / steps_per_mm
}
