//! The world: a stage with an indenter, a spring as specimen, a load cell, an array, and the faults. It knows the true force.
//!
//! It moves in real time, in ticks of 0.5 ms, whenever somebody asks. z counts up, away from the specimen.

use crate::axis::{Law, TICK_S, WorldAxis};
use crate::faults::{Fault, WorldMoment};
use crate::setting::{DEPTH_MM, Random, WorldSetting};
use std::time::Instant;

/// Force from which the tip counts as touching, N, and how far to the side the next place is, mm.
pub(crate) const TOUCH_N: f64 = 0.005;
const NEXT_PLACE_MM: f64 = 0.3;

/// Interval of the force that is kept, s.
const TRACE_S: f64 = 0.005;

/// Furthest that a creep goes, mm; how fast a drop is, mm/s.
const SLOW_RETRACT_MM: f64 = 0.5;
const DROP_MM_S: f64 = 20.0;

/// How long a specimen takes to rise or sink, s.
const RISE_S: f64 = 1.0;
const SINK_S: f64 = 0.2;

/// What the world has seen.
#[derive(Debug, Default)]
pub(crate) struct WorldSeen {
    pub(crate) force_max_n: f64,
    pub(crate) max_at_s: f64,
    /// Largest true force before the first fault, and from then on.
    pub(crate) before_n: f64,
    pub(crate) after_n: f64,
    /// How much deeper the tip was than a faithful stage would have been in the same contact, or was sent, mm.
    pub(crate) own_mm: f64,
    /// Motions toward the specimen that were commanded after the first fault.
    pub(crate) toward_after: u32,
    /// Each reading of the outputs in contact: x, y and the true force.
    pub(crate) reads: Vec<[f64; 3]>,
    /// The true force each [`TRACE_S`].
    pub(crate) trace_n: Vec<f64>,
}

pub(crate) struct World {
    pub(crate) setting: WorldSetting,
    pub(crate) faults: Vec<Fault>,
    pub(crate) seen: WorldSeen,
    pub(crate) axes: [WorldAxis; 3],
    /// z as a faithful stage would have it.
    faithful: WorldAxis,
    /// Where that was lowest in this contact, or was sent.
    granted_mm: f64,
    pub(crate) travel_mm: Option<[[f64; 2]; 3]>,
    acceleration_mm_s2: f64,
    /// What is commanded later: when, and what.
    later: Vec<(f64, WorldCommand)>,
    /// How much deeper the controller holds z than it reports, mm.
    hidden_mm: f64,
    began: Instant,
    pub(crate) now_s: f64,
    ticks: u64,
    pub(crate) random: Random,
    pub(crate) press: u32,
    place_mm: Option<[f64; 2]>,
    pub(crate) filtered_n: f64,
    pub(crate) next_conversion_s: f64,
    pub(crate) reading_n: f64,
    /// The force at each conversion.
    pub(crate) history: Vec<(f64, f64)>,
    pub(crate) stuck_n: Option<f64>,
    pub(crate) stuck_outputs: Option<Vec<f64>>,
    stuck_z_mm: Option<f64>,
    /// Signals that palpate is due, which the runner takes.
    pub(crate) signals: Vec<Fault>,
}

#[derive(Clone, Debug)]
pub(crate) enum WorldCommand {
    Move { to_mm: [Option<f64>; 3], speed_mm_s: f64 },
    Speed(f64),
    Stop,
}

impl World {
    pub(crate) fn new(setting: WorldSetting, faults: Vec<Fault>, seed: u64) -> World {
        World {
            axes: [WorldAxis::at(0.5), WorldAxis::at(-0.5), WorldAxis::at(setting.top_mm - 0.3)],
            faithful: WorldAxis::at(setting.top_mm - 0.3),
            granted_mm: setting.top_mm,
            setting,
            faults,
            seen: WorldSeen::default(),
            travel_mm: None,
            acceleration_mm_s2: 100.0,
            later: Vec::new(),
            hidden_mm: 0.0,
            began: Instant::now(),
            now_s: 0.0,
            ticks: 0,
            random: Random::new(seed ^ 0x5eed),
            press: 0,
            place_mm: None,
            filtered_n: 0.0,
            next_conversion_s: 0.0,
            reading_n: 0.0,
            history: Vec::new(),
            stuck_n: None,
            stuck_outputs: None,
            stuck_z_mm: None,
            signals: Vec::new(),
        }
    }

    /// The value of a fault that acts now.
    pub(crate) fn fault(&self, name: &str) -> Option<f64> {
        self.acting(name).map(|fault| fault.value)
    }

    pub(crate) fn acting(&self, name: &str) -> Option<&Fault> {
        self.faults.iter().find(|fault| fault.name == name && fault.acts(self.now_s))
    }

    /// Seconds since a fault began, and its value.
    pub(crate) fn since(&self, name: &str) -> Option<(f64, f64)> {
        self.acting(name).map(|fault| (self.now_s - fault.fired_s.unwrap_or(self.now_s), fault.value))
    }

    fn has_fired(&self) -> bool {
        self.faults.iter().any(|fault| fault.fired_s.is_some() && fault.name != "none")
    }

    /// Moves the world up to now.
    pub(crate) fn advance(&mut self) {
        while (self.ticks as f64) * TICK_S < self.began.elapsed().as_secs_f64() {
            self.ticks += 1;
            self.now_s = self.ticks as f64 * TICK_S;
            self.tick();
        }
    }

    fn tick(&mut self) {
        let law = Law { acceleration_mm_s2: self.acceleration_mm_s2, speed_times: 1.0, brakes_softer: 1.0 };
        self.faithful.tick(law);
        let speed_times = self.fault("stage-slow").or(self.fault("stage-fast")).unwrap_or(1.0);
        let brakes_softer = self.fault("stage-soft-brakes").unwrap_or(1.0);
        self.axes.iter_mut().for_each(|axis| axis.tick(Law { speed_times, brakes_softer, ..law }));
        if let Some((since_s, mm_s)) = self.since("stage-creeps")
            && since_s * mm_s < SLOW_RETRACT_MM
        {
            self.axes[2].at_mm -= mm_s * TICK_S;
        }
        while let Some(due) = self.later.iter().position(|(due_s, _)| *due_s <= self.now_s) {
            let (_, command) = self.later.remove(due);
            self.obey(&command);
        }
        let force_n = self.force_n();
        self.number_the_place(force_n);
        self.watch(force_n);
        self.look_at_faults(force_n);
        self.convert(force_n);
    }

    fn height_mm(&self) -> f64 {
        let [x_mm, y_mm] = [self.axes[0].at_mm, self.axes[1].at_mm];
        let sideways_mm = self.fault("specimen-moves").unwrap_or(0.0);
        let mut surface_mm = self.setting.tilt[0] * (x_mm + sideways_mm) + self.setting.tilt[1] * y_mm;
        surface_mm += self.setting.surface_mm + self.fault("specimen-jumps").unwrap_or(0.0);
        surface_mm += self.since("specimen-rises").map_or(0.0, |(since_s, mm)| mm * (since_s / RISE_S).min(1.0));
        surface_mm -= self.since("specimen-sinks").map_or(0.0, |(since_s, mm)| mm * (since_s / SINK_S).min(1.0));
        self.axes[2].at_mm - surface_mm
    }

    /// The true force on the specimen now.
    pub(crate) fn force_n(&self) -> f64 {
        let depth_mm = (-self.height_mm()).max(0.0);
        let times = self.fault("specimen-stiffer").or(self.fault("specimen-softer")).unwrap_or(1.0);
        let torn = self.fault("specimen-tears").is_some();
        // below the depth limit it gets no stiffer
        let square_mm2 = depth_mm * depth_mm - (depth_mm - DEPTH_MM).max(0.0).powi(2);
        let n = self.setting.stiffness_n_mm * depth_mm + self.setting.stiffening_n_mm2 * square_mm2;
        if torn { 0.0 } else { n * times }
    }

    /// Counts places that were touched: the next one begins when x or y has left the last.
    fn number_the_place(&mut self, force_n: f64) {
        let here = [self.axes[0].at_mm, self.axes[1].at_mm];
        let left = |place: [f64; 2]| (here[0] - place[0]).hypot(here[1] - place[1]) > NEXT_PLACE_MM;
        if force_n > TOUCH_N && self.place_mm.is_none() {
            self.place_mm = Some(here);
            self.press = self.press.max(1);
        } else if force_n == 0.0 && self.place_mm.is_some_and(left) {
            self.place_mm = None;
            self.press += 1;
        }
    }

    fn watch(&mut self, force_n: f64) {
        if force_n > self.seen.force_max_n {
            (self.seen.force_max_n, self.seen.max_at_s) = (force_n, self.now_s);
        }
        let largest_n = if self.has_fired() { &mut self.seen.after_n } else { &mut self.seen.before_n };
        *largest_n = largest_n.max(force_n);
        // deeper than a sound stage was in this contact, or may go
        let granted_mm = self.faithful.at_mm.min(self.faithful.target_mm());
        if force_n > 0.0 {
            self.granted_mm = self.granted_mm.min(granted_mm);
            self.seen.own_mm = self.seen.own_mm.max(self.granted_mm - self.axes[2].at_mm);
        } else {
            self.granted_mm = granted_mm;
        }
        if self.now_s >= self.seen.trace_n.len() as f64 * TRACE_S {
            self.seen.trace_n.push(force_n);
        }
    }

    fn look_at_faults(&mut self, force_n: f64) {
        let moment = WorldMoment { now_s: self.now_s, press: self.press, force_n, height_mm: self.height_mm() };
        for index in 0..self.faults.len() {
            if !self.faults[index].look(&moment) {
                continue;
            }
            let fault = self.faults[index].clone();
            match fault.name {
                "stage-drops" | "stage-drops-hidden" => {
                    self.hidden_mm = if fault.name == "stage-drops" { 0.0 } else { fault.value };
                    let target_mm = self.axes[2].at_mm - fault.value;
                    self.axes[2].start(target_mm, None, DROP_MM_S);
                }
                "stage-frozen" => self.stuck_z_mm = Some(self.axes[2].at_mm),
                "cell-stuck" => self.stuck_n = Some(self.reading_n),
                "cell-stuck-noise" => self.stuck_n = Some(force_n),
                "array-stuck" | "array-taxel-stuck" => self.stuck_outputs = Some(self.outputs()),
                name if name.starts_with("host-") => self.signals.push(fault),
                _ => {}
            }
        }
    }

    /// Whether the stage says that it moves, and where it says it is.
    pub(crate) fn status(&self) -> (bool, [f64; 3]) {
        let real = self.axes.iter().any(|axis| axis.moving);
        let hides = ["stage-deeper", "stage-says-target", "stage-twice-way", "stage-short-way", "stage-mirror"];
        let hides = self.hidden_mm > 0.0 || hides.iter().any(|name| self.acting(name).is_some());
        let mut z_mm = if hides { self.faithful.at_mm } else { self.axes[2].at_mm };
        z_mm += self.fault("stage-offset").unwrap_or(0.0);
        if self.acting("stage-frozen").is_some() {
            z_mm = self.stuck_z_mm.unwrap_or(z_mm);
        }
        let mut at_mm = [self.axes[0].at_mm, self.axes[1].at_mm, z_mm];
        if self.acting("stage-early-target").is_some() {
            at_mm = [0, 1, 2].map(|axis| self.axes[axis].target_mm());
        }
        let times = [("stage-inch", 1.0 / 25.4), ("stage-um", 1000.0), ("stage-sign", -1.0)];
        let times: f64 = times.iter().filter(|(name, _)| self.acting(name).is_some()).map(|(_, times)| times).product();
        let ended = self.acting("stage-early-target").or(self.acting("stage-early-end")).is_some();
        let moving = real || self.acting("stage-never-ends").is_some() || (hides && self.faithful.moving);
        (moving && !ended, at_mm.map(|mm| mm * times))
    }

    /// Takes a command now, or later if a fault delays it.
    pub(crate) fn command(&mut self, command: WorldCommand) {
        let toward =
            matches!(&command, WorldCommand::Move { to_mm: [_, _, Some(z_mm)], .. } if *z_mm < self.faithful.at_mm);
        if toward && self.has_fired() {
            self.seen.toward_after += 1;
        }
        let (delay_s, ignored) = match &command {
            WorldCommand::Move { .. } => (self.fault("stage-late-move"), false),
            WorldCommand::Speed(_) => (None, self.acting("stage-no-speed").is_some()),
            WorldCommand::Stop => (self.fault("stage-late-stop"), self.acting("stage-no-stop").is_some()),
        };
        self.obey_faithfully(&command);
        match delay_s {
            _ if ignored => {}
            Some(delay_s) => self.later.push((self.now_s + delay_s, command)),
            None => self.obey(&command),
        }
    }

    fn obey_faithfully(&mut self, command: &WorldCommand) {
        match command {
            WorldCommand::Move { to_mm: [_, _, Some(z_mm)], speed_mm_s } => {
                self.faithful.start(*z_mm, None, *speed_mm_s)
            }
            WorldCommand::Move { .. } => {}
            WorldCommand::Speed(mm_s) => self.faithful.speed_mm_s = *mm_s,
            WorldCommand::Stop => self.faithful.brake(),
        }
    }

    fn obey(&mut self, command: &WorldCommand) {
        match command {
            WorldCommand::Stop => self.axes.iter_mut().for_each(WorldAxis::brake),
            WorldCommand::Speed(mm_s) => {
                self.axes.iter_mut().filter(|axis| axis.moving).for_each(|axis| axis.speed_mm_s = *mm_s);
            }
            WorldCommand::Move { to_mm, speed_mm_s } => {
                if self.fault("stage-stands").or(self.fault("stage-says-target")).is_some() {
                    return;
                }
                let way_mm = |axis: usize| to_mm[axis].map_or(0.0, |to_mm| (to_mm - self.axes[axis].at_mm).abs());
                let longest_mm = [0, 1, 2].map(way_mm).into_iter().fold(1e-9, f64::max);
                let speeds = [0, 1, 2].map(|axis| (speed_mm_s * way_mm(axis) / longest_mm).max(0.01));
                for axis in 0..3 {
                    let Some(to_mm) = to_mm[axis] else { continue };
                    let (target_mm, then_mm) = if axis == 2 { self.aim(to_mm) } else { (to_mm, None) };
                    self.axes[axis].start(target_mm, then_mm, speeds[axis]);
                }
            }
        }
    }

    /// Where z goes in truth: the target, and where it goes after that.
    fn aim(&self, to_mm: f64) -> (f64, Option<f64>) {
        let (at_mm, way_mm) = (self.axes[2].at_mm, to_mm - self.faithful.at_mm);
        let down = way_mm < 0.0;
        let deeper_mm = self.hidden_mm + self.fault("stage-deeper").or(self.fault("stage-offset")).unwrap_or(0.0);
        let target_mm = match self.fault("stage-twice-way").map(|_| 2.0).or(self.fault("stage-short-way")) {
            _ if self.acting("stage-mirror").is_some() => at_mm - way_mm,
            Some(times) if down => at_mm + way_mm * times,
            _ => to_mm - deeper_mm,
        };
        match self.fault("stage-overshoots") {
            Some(mm) if down => (target_mm - mm, Some(target_mm)),
            _ => (target_mm, None),
        }
    }

    pub(crate) fn prepare(&mut self, travel_mm: [[f64; 2]; 3], acceleration_mm_s2: f64) {
        (self.travel_mm, self.acceleration_mm_s2) = (Some(travel_mm), acceleration_mm_s2);
    }

    pub(crate) fn rests(&self) -> bool {
        self.later.is_empty() && self.axes.iter().all(|axis| !axis.moving)
    }
}
