//! From commands to motions: coordinates, steps, software endstops, bed levelling, homing and motors (Marlin's motion.cpp and
//! planner.cpp).

use super::board::MarlinBoard;
use super::gcode::MarlinCommand;
use crate::emulator::grbl::machine::{Homed, Machine, PlannedLine};
use crate::scene::Scene;
use palpate_core::quantity::Axis;

/// Axes in the order of their homing. z is last: it homes toward the bed.
const HOMING_TURNS: [&[Axis]; 3] = [&[Axis::X], &[Axis::Y], &[Axis::Z]];

/// Largest number of steps: a count has 32 bits.
const STEPS_MOST: f64 = i32::MAX as f64;

/// Length of an inch, mm.
const INCH_MM: f64 = 25.4;

/// Speed of motions until a command states one, mm/s.
const FIRST_FEED_MM_S: f64 = 25.0;

/// What the firmware knows of its axes.
///
/// Native coordinates count from the - ends, if the axes were homed. Logical ones, which a client sends and reads, are higher by
/// what G92 set. Planned steps are those of native coordinates, z with the levelling.
pub(super) struct MarlinPlanner {
    pub board: MarlinBoard,
    machine: Machine,
    /// Steps at the end of the queue.
    planned: [i64; 3],
    /// Place that the last command requested, native mm.
    at_mm: [f64; 3],
    /// Logical minus native coordinates, mm.
    shift_mm: [f64; 3],
    homed: [bool; 3],
    /// G91.
    pub relative: bool,
    /// Length of a unit of G0, G1 and G92, mm: G20 or G21. Everything else stays in mm here, as M114 does in Marlin.
    unit_mm: f64,
    feed_mm_s: f64,
    /// M220.
    pub feed_percent: f64,
    /// M211: whether targets are limited to the travel of the axes that were homed.
    pub limits_softly: bool,
    /// M420: whether z follows the bed.
    pub levels: bool,
    motors: [bool; 3],
    /// Time of the last motion, or of what counts as one, s.
    moved_s: f64,
    /// Whether the motors were switched off since then.
    rested: bool,
    /// Search for home that has begun, and its axes.
    homing: Option<(Homed, [bool; 3])>,
}

impl MarlinPlanner {
    /// Creates a board that is switched on: its axes count their homes wherever they are, and its motors are off.
    pub(super) fn new(board: MarlinBoard, scene: &Scene) -> Self {
        let mut planner = MarlinPlanner {
            machine: Machine::new(board.frame(), scene),
            planned: [0; 3],
            at_mm: board.home_mm(),
            shift_mm: [0.0; 3],
            homed: [false; 3],
            relative: false,
            unit_mm: 1.0,
            feed_mm_s: FIRST_FEED_MM_S,
            feed_percent: 100.0,
            limits_softly: true,
            levels: false,
            motors: [false; 3],
            moved_s: 0.0,
            rested: false,
            homing: None,
            board,
        };
        planner.synchronize_steps(scene);
        planner
    }

    /// Resets the board. Settings that a client wrote are lost with it: `stock` has those of the build.
    pub(super) fn reset(&mut self, stock: MarlinBoard, scene: &mut Scene, now_s: f64) {
        self.machine.power_cycle(scene, now_s);
        self.motors_off([true; 3], scene, now_s);
        *self = MarlinPlanner { moved_s: now_s, ..MarlinPlanner::new(stock, scene) };
    }

    /// Applies the effects of the motions that have ended.
    pub(super) fn settle(&mut self, scene: &mut Scene, now_s: f64) {
        self.machine.settle(scene, now_s);
    }

    /// Time at which the queue has room, s.
    pub(super) fn ready_s(&self) -> f64 {
        self.machine.ready_s()
    }

    /// Time at which the queue is empty, s.
    pub(super) fn end_s(&self) -> f64 {
        self.machine.end_s()
    }

    /// Place that the last command requested, logical mm.
    pub(super) fn logical_mm(&self) -> [f64; 3] {
        std::array::from_fn(|n| self.at_mm[n] + self.shift_mm[n])
    }

    /// Steps at this moment. An axis that moves on without steps changes nothing.
    pub(super) fn steps(&self, scene: &Scene, now_s: f64) -> [i64; 3] {
        let steps = self.homing.is_some() || self.machine.end_s() > now_s;
        if steps { self.to_steps(self.machine.places_mm(scene, now_s)) } else { self.planned }
    }

    /// Ends of the software endstops, logical mm.
    pub(super) fn limits_mm(&self) -> [[f64; 3]; 2] {
        [self.shift_mm, std::array::from_fn(|n| self.board.lengths_mm[n] + self.shift_mm[n])]
    }

    /// Plans the motion of a G0 or G1. There is room for it.
    ///
    /// Fewer steps than the least number aren't made. Their place is reported as reached, but the planned steps don't include it,
    /// so the next motion makes them, too.
    pub(super) fn go(&mut self, command: &MarlinCommand<'_>, scene: &mut Scene, now_s: f64) {
        if let Some(feed_mm_min) = command.value('F').filter(|&feed| feed > 0.0) {
            self.feed_mm_s = self.unit_mm * feed_mm_min / 60.0;
        }
        for (n, value_mm) in self.lengths_mm(command).into_iter().enumerate() {
            let Some(value_mm) = value_mm else { continue };
            self.at_mm[n] = if self.relative { self.at_mm[n] + value_mm } else { value_mm - self.shift_mm[n] };
        }
        for n in 0..3 {
            if self.limits_softly && self.homed[n] {
                self.at_mm[n] = self.at_mm[n].clamp(0.0, self.board.lengths_mm[n]);
            }
        }
        let steps = self.to_steps(self.levelled(self.at_mm));
        let way: [i64; 3] = std::array::from_fn(|n| steps[n] - self.planned[n]);
        let most = way.iter().map(|way| way.abs()).max().unwrap_or(0);
        if most < self.board.least_steps.max(1) {
            return;
        }
        let line = PlannedLine {
            to_mm: self.to_mm(steps),
            feed_mm_min: Some(60.0 * self.feed_mm_s * self.feed_percent / 100.0),
            most_mm_s2: self.board.travel_acceleration_mm_s2,
            jog: false,
        };
        self.machine.add(line, scene, now_s);
        self.planned = steps;
        for (motor, way) in self.motors.iter_mut().zip(way) {
            *motor |= way != 0;
        }
        self.moves_until(self.machine.end_s());
    }

    /// G20 and G21.
    pub(super) fn count_in_inches(&mut self, inches: bool) {
        self.unit_mm = if inches { INCH_MM } else { 1.0 };
    }

    /// Whether lengths are in inches.
    pub(super) fn counts_in_inches(&self) -> bool {
        self.unit_mm != 1.0
    }

    fn lengths_mm(&self, command: &MarlinCommand<'_>) -> [Option<f64>; 3] {
        command.axes().map(|value| value.map(|value| self.unit_mm * value))
    }

    /// G92: gives the place other logical coordinates. The steps stay, unless the build has no workspace offsets. The axes rest then.
    pub(super) fn set_logical(&mut self, command: &MarlinCommand<'_>, scene: &Scene) {
        for (n, value_mm) in self.lengths_mm(command).into_iter().enumerate() {
            match value_mm {
                None => {}
                Some(value_mm) if self.board.workspace_offsets => self.shift_mm[n] = value_mm - self.at_mm[n],
                Some(value_mm) => self.at_mm[n] = value_mm - self.shift_mm[n],
            }
        }
        if !self.board.workspace_offsets {
            self.synchronize_steps(scene);
        }
    }

    /// Begins the search of some axes for their homes, and returns the time of its end, s. Levelling is switched off.
    pub(super) fn home(&mut self, axes: [bool; 3], scene: &mut Scene, now_s: f64) -> f64 {
        self.level(false, scene);
        let turns: Vec<&[Axis]> = HOMING_TURNS.into_iter().filter(|turn| axes[turn[0].index()]).collect();
        let searches = std::array::from_fn(|n| self.board.homing(n));
        let homed = self.machine.search(&turns, &searches, 0.0, scene, now_s);
        for (motor, homes) in self.motors.iter_mut().zip(axes) {
            *motor |= homes;
        }
        self.homing = Some((homed, axes));
        self.moves_until(homed.end_s);
        homed.end_s
    }

    /// Ends the search for home. Returns whether it reached the switches: it doesn't if it was cut off.
    pub(super) fn is_home(&mut self, scene: &Scene) -> bool {
        let Some((homed, axes)) = self.homing.take() else { return false };
        self.machine.is_home(homed);
        let home_mm = self.board.home_mm();
        for n in (0..3).filter(|&n| axes[n]) {
            (self.at_mm[n], self.shift_mm[n], self.homed[n]) = (home_mm[n], 0.0, true);
        }
        self.synchronize_steps(scene);
        true
    }

    /// Switches the levelling. The axes rest and stay where they are: the coordinates change.
    pub(super) fn level(&mut self, levels: bool, scene: &Scene) {
        if levels != self.levels {
            let z_mm = self.levelled(self.at_mm)[2];
            self.levels = levels;
            self.at_mm[2] += z_mm - self.levelled(self.at_mm)[2];
            self.synchronize_steps(scene);
        }
    }

    /// M410: stops the steps at once, without a ramp. The axes move on a little, which isn't counted.
    pub(super) fn quick_stop(&mut self, scene: &mut Scene, now_s: f64) {
        let places_mm = self.to_mm(self.steps(scene, now_s));
        self.cut_off(scene, now_s);
        self.at_mm = places_mm;
        self.at_mm[2] += places_mm[2] - self.levelled(places_mm)[2];
        self.synchronize_steps(scene);
    }

    /// Ends the steps, as the end of the interrupts does.
    pub(super) fn cut_off(&mut self, scene: &mut Scene, now_s: f64) {
        self.machine.cut_off(scene, now_s);
        self.homing = None;
        self.moved_s = now_s;
    }

    /// The motors lose their current, and the firmware doesn't notice: what is planned is counted as made.
    pub(super) fn lose_current(&mut self, scene: &mut Scene, now_s: f64) {
        let on = self.motors;
        self.homing = None;
        self.machine.cut_off(scene, now_s);
        self.machine.count_from(self.to_mm(self.planned), scene);
        self.motors_off([true; 3], scene, now_s);
        self.motors = on;
    }

    /// M290: moves the axes, and counts nothing.
    pub(super) fn babystep(&mut self, command: &MarlinCommand<'_>, scene: &mut Scene, now_s: f64) {
        self.machine.slip(self.lengths_mm(command).map(Option::unwrap_or_default), scene, now_s);
    }

    /// The counted steps change by these numbers. What is planned is made all the same.
    pub(super) fn miscount(&mut self, by: [i32; 3]) {
        let by_mm: [f64; 3] = std::array::from_fn(|n| f64::from(by[n]) / self.board.steps_per_mm[n]);
        self.machine.miscount(by_mm);
        for n in 0..3 {
            self.planned[n] += i64::from(by[n]);
            self.at_mm[n] += by_mm[n];
        }
    }

    /// M17.
    pub(super) fn motors_on(&mut self, axes: [bool; 3]) {
        for (motor, on) in self.motors.iter_mut().zip(axes) {
            *motor |= on;
        }
    }

    /// Switches motors off. An axis whose motor was on slips, and nobody counts it.
    pub(super) fn motors_off(&mut self, axes: [bool; 3], scene: &mut Scene, now_s: f64) {
        let slips = |n: usize| if axes[n] && self.motors[n] { self.board.slip_mm[n] } else { 0.0 };
        self.machine.slip(std::array::from_fn(slips), scene, now_s);
        for (motor, off) in self.motors.iter_mut().zip(axes) {
            *motor &= !off;
        }
    }

    /// Time at which the motors are switched off if nothing moves, s; infinite if this can't happen.
    pub(super) fn rests_s(&self) -> f64 {
        let can = self.board.idle_s > 0.0 && !self.rested && self.motors.contains(&true);
        if can { self.moved_s + self.board.idle_s } else { f64::INFINITY }
    }

    /// Switches the motors off after a time without motion.
    pub(super) fn rest(&mut self, scene: &mut Scene, now_s: f64) {
        self.motors_off([true; 3], scene, now_s);
        self.rested = true;
    }

    /// Notes a motion until this time, s.
    pub(super) fn moves_until(&mut self, end_s: f64) {
        (self.moved_s, self.rested) = (self.moved_s.max(end_s), false);
    }

    /// Applies limits that a client wrote to later motions.
    pub(super) fn limits_changed(&mut self) {
        self.machine.board.settings = self.board.limits(self.machine.board.settings.clone());
    }

    /// Sets the steps from the coordinates (`sync_plan_position`). Steps that a short motion left are forgotten.
    fn synchronize_steps(&mut self, scene: &Scene) {
        self.planned = self.to_steps(self.levelled(self.at_mm));
        self.machine.count_from(self.to_mm(self.planned), scene);
    }

    /// Returns a place with the bed's height under it, if z follows it.
    fn levelled(&self, [x_mm, y_mm, z_mm]: [f64; 3]) -> [f64; 3] {
        let [along_x, along_y] = self.board.bed_rise.filter(|_| self.levels).unwrap_or_default();
        [x_mm, y_mm, z_mm + along_x * x_mm + along_y * y_mm]
    }

    fn to_steps(&self, places_mm: [f64; 3]) -> [i64; 3] {
        std::array::from_fn(|n| {
            (places_mm[n] * self.board.steps_per_mm[n]).round().clamp(-STEPS_MOST, STEPS_MOST) as i64
        })
    }

    fn to_mm(&self, steps: [i64; 3]) -> [f64; 3] {
        std::array::from_fn(|n| steps[n] as f64 / self.board.steps_per_mm[n])
    }
}
