use super::permit::{DEPTH_MARGIN_MM, Permit, Permitted, Standing};
use super::surface::Expected;
use super::task::{Branch, Level, Task};
use super::trip::{Rule, Trip};
use super::zero::Zero;
use crate::quantity::Limits;

/// Largest force in air before a press, N: beyond it the zero has drifted.
const AIR_N: f64 = 0.020;
/// Readings averaged to look at the zero before a press.
const AIR_READINGS: u32 = 8;
/// Readings averaged between two steps.
const STEP_READINGS: u32 = 4;
/// Readings averaged where the force is near the limit, so that little of the limit is lost to noise.
const LIMIT_READINGS: u32 = 16;
/// Share of the limit from which it counts as near.
const NEAR_LIMIT: f64 = 0.85;
/// Share of the first force that an approach may use up when contact comes, and the most it may, N.
const TOUCH_SHARE: f64 = 0.6;
const TOUCH_MOST_N: f64 = 0.2;
/// How far above the earliest contact the fast descent ends, mm.
const STANDOFF_MM: f64 = 0.02;
/// A gap to the standoff that isn't worth a motion of its own, mm.
const SHORT_DESCENT_MM: f64 = 0.10;
/// How far beyond the latest contact the search goes on before there is none, mm: a soft surface yields before it is felt.
const SEARCH_MM: f64 = 0.20;
/// What a depth limit must leave beyond the surface's uncertainty for that search, mm.
pub const SEARCH_ROOM_MM: f64 = SEARCH_MM + DEPTH_MARGIN_MM;
/// Share of the set force from which a gap is closed with the declared stiffness, and a step teaches the real one.
const LEARN_SHARE: f64 = 0.25;
/// What a learned stiffness is multiplied with: the specimen stiffens with depth, and stiffens more the faster it is pressed.
const STIFFENING: f64 = 1.15;
/// Share of the tolerance within which a level counts as reached; the rest is for what the force does until it is sampled.
const REACHED_SHARE: f64 = 0.1;
/// Share of the declared stiffness with which the force must at least answer a step, where the step is large enough to tell.
const RESPONSE_SHARE: f64 = 0.05;
/// How many sd of the force that least answer must be to tell.
const RESPONSE_SIGMAS: f64 = 6.0;
/// Smallest step worth commanding, mm.
const STEP_LEAST_MM: f64 = 0.000_5;
/// Most steps to one level, and most looks for contact.
const STEPS_MAX: u32 = 60;
/// Fastest approach, mm/s: what is gained beyond it is lost in braking.
const APPROACH_MOST_MM_S: f64 = 2.0;

/// What a press rests on, besides its task.
#[derive(Clone, Copy, Debug)]
pub struct Context {
    /// The rig's limits.
    pub limits: Limits,
    /// Who may move where.
    pub permit: Permit,
    /// The zero in air.
    pub zero: Zero,
    /// Where the surface is expected.
    pub expected: Expected,
    /// Where to withdraw to, mm: clear of the surface here and on the way on.
    pub clear_mm: f64,
    /// Speed of steps in contact and of motions in air, mm/s.
    pub speed_mm_s: f64,
}

/// What the loop is to do next. Only [`Command::Move`] moves, and only toward a permitted end.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Average this many readings; answered by [`Event::Averaged`].
    Average(u32),
    /// Move along z and read the force meanwhile; answered by [`Event::Moved`].
    Move(Permitted),
    /// Keep still and read the force; answered by [`Event::Dwelt`].
    Dwell(f64),
    /// Sample force and outputs for so long; answered by [`Event::Sampled`].
    Sample(f64),
    /// The contact is over, the indenter in the clear.
    Done,
    /// A rule is broken: stop, withdraw, record.
    Trip(Trip),
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The indenter is in the clear above its place; here is its z, mm.
    Begin {
        /// Read back, mm.
        z_mm: f64,
    },
    /// Readings were averaged.
    Averaged {
        /// Mean force from the zero, N.
        force_n: f64,
    },
    /// A motion ended, on its target or by a stop.
    Moved {
        /// Read back, mm.
        z_mm: f64,
    },
    /// The dwell is over.
    Dwelt,
    /// The window is over.
    Sampled {
        /// Mean force in it, N.
        force_n: f64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum State {
    Idle,
    CheckingAir,
    Descending,
    Approaching,
    Touching,
    Stepping,
    Reading,
    Dwelling,
    Sampling,
    Withdrawing,
    Leaving,
}

/// One contact: find the surface from above, reach each level from its own side, hold it, sample it, withdraw.
pub struct Press {
    task: Task,
    context: Context,
    state: State,
    level: usize,
    z_mm: f64,
    force_n: f64,
    sigma_n: f64,
    /// How far the zero has drifted below air, N: the true force is larger by that.
    drift_n: f64,
    /// How old the last reading is, s.
    age_s: f64,
    /// The earliest surface, expected or, once touched, touched.
    first_mm: f64,
    in_contact: bool,
    dwelt: bool,
    steps: u32,
    /// Where stiffness is measured from: z and force.
    anchor: (f64, f64),
    /// Where the last step began: z and force.
    before_step: (f64, f64),
    stiffness_n_mm: Option<f64>,
    /// The loading path: z and force at rest, from the touch to the first level.
    path: Vec<(f64, f64)>,
}

impl Press {
    /// A press that hasn't begun.
    pub fn new(task: Task, context: Context) -> Self {
        Press {
            task,
            context,
            state: State::Idle,
            level: 0,
            z_mm: 0.0,
            force_n: 0.0,
            sigma_n: 0.0,
            drift_n: 0.0,
            age_s: f64::INFINITY,
            first_mm: context.expected.first_mm,
            in_contact: false,
            dwelt: false,
            steps: 0,
            anchor: (0.0, 0.0),
            before_step: (0.0, 0.0),
            stiffness_n_mm: None,
            path: Vec::new(),
        }
    }

    /// The level that is being reached, held or sampled: its number and itself.
    pub fn level(&self) -> Option<(usize, Level)> {
        self.task.levels.get(self.level).map(|level| (self.level, *level))
    }

    /// Where contact began, mm, as the loading path leads back to no force; none before there was contact.
    pub fn touched_mm(&self) -> Option<f64> {
        root_of(&self.path, self.context.limits.stiffness_n_mm)
    }

    /// A reading came while a motion is under way: whether the motion must be stopped.
    pub fn must_stop(&self, force_n: f64) -> bool {
        matches!(self.state, State::Descending | State::Approaching) && force_n >= self.context.zero.detect_n()
    }

    /// The next command. `age_s` is how old the last good reading is. An event that doesn't fit the state ends the press with a
    /// trip rather than a guess.
    pub fn next(&mut self, event: Event, age_s: f64) -> Command {
        self.age_s = age_s;
        let next = match (self.state, event) {
            (State::Idle, Event::Begin { z_mm }) => {
                self.z_mm = z_mm;
                self.average(State::CheckingAir, AIR_READINGS)
            }
            (State::CheckingAir, Event::Averaged { force_n }) => self.air_checked(force_n),
            (State::Descending | State::Approaching, Event::Moved { z_mm }) => {
                let descended = self.state == State::Descending && z_mm < self.first_mm;
                self.z_mm = z_mm;
                if descended { self.approach() } else { self.average(State::Touching, STEP_READINGS) }
            }
            (State::Touching, Event::Averaged { force_n }) => self.touched(force_n),
            (State::Stepping, Event::Moved { z_mm }) => {
                self.before_step = (self.z_mm, self.force_n);
                self.z_mm = z_mm;
                self.average(State::Reading, self.readings())
            }
            (State::Reading, Event::Averaged { force_n }) => {
                self.force_n = force_n;
                self.answered().and_then(|()| {
                    self.learn();
                    self.pursue()
                })
            }
            (State::Dwelling, Event::Dwelt) => self.average(State::Reading, self.readings()),
            (State::Sampling, Event::Sampled { force_n }) => {
                self.force_n = force_n;
                self.level += 1;
                self.steps = 0;
                self.dwelt = false;
                self.next_level()
            }
            (State::Withdrawing, Event::Moved { z_mm }) => {
                self.z_mm = z_mm;
                self.average(State::Leaving, STEP_READINGS)
            }
            (State::Leaving, Event::Averaged { force_n }) => self.left(force_n),
            _ => Err(Trip::new(Rule::NotPermitted, 0.0, 0.0, "event out of turn")),
        };
        next.unwrap_or_else(Command::Trip)
    }

    fn air_checked(&mut self, force_n: f64) -> Result<Command, Trip> {
        let most_n = AIR_N + 3.0 * self.sigma_n;
        if force_n.abs() > most_n {
            return Err(Trip::new(Rule::ZeroDrifted, force_n, most_n, "N"));
        }
        self.force_n = 0.0;
        self.drift_n = (-force_n).max(0.0);
        self.next_level()
    }

    /// Whether the force has answered the step that was made: a cell that always says the same is held by nothing else.
    fn answered(&mut self) -> Result<(), Trip> {
        let (z_mm, force_n) = std::mem::replace(&mut self.before_step, (self.z_mm, self.force_n));
        let least_n = RESPONSE_SHARE * self.context.limits.stiffness_n_mm * (self.z_mm - z_mm);
        let answer_n = self.force_n - force_n;
        if least_n > RESPONSE_SIGMAS * self.sigma_n && answer_n < least_n {
            return Err(Trip::new(Rule::NoResponse, answer_n, least_n, "N"));
        }
        Ok(())
    }

    fn next_level(&mut self) -> Result<Command, Trip> {
        match self.level() {
            None | Some((_, Level { force_set_n: 0.0, .. })) if self.in_contact => self.withdraw(),
            None if self.z_mm > self.context.clear_mm + STEP_LEAST_MM => self.withdraw(),
            None => Ok(Command::Done),
            Some((_, Level { force_set_n: 0.0, .. })) => self.sample(),
            Some(_) if self.in_contact => self.average(State::Reading, self.readings()),
            Some(_) => self.descend(),
        }
    }

    /// Fast to just above the earliest contact, if that is worth a motion of its own.
    fn descend(&mut self) -> Result<Command, Trip> {
        let standoff_mm = self.first_mm - STANDOFF_MM;
        if standoff_mm - self.z_mm < SHORT_DESCENT_MM {
            return self.approach();
        }
        self.advance(State::Descending, standoff_mm, self.context.speed_mm_s)
    }

    /// Slowly, until the force says contact: the motion ends on a safe point even if nobody stops it.
    fn approach(&mut self) -> Result<Command, Trip> {
        let search_mm = self.context.expected.last_mm + SEARCH_MM;
        let target_mm = self.context.permit.deepest_mm(&self.standing()).min(search_mm);
        self.steps += 1;
        if target_mm - self.z_mm < STEP_LEAST_MM || self.steps > STEPS_MAX {
            return Err(Trip::new(Rule::NoContact, self.z_mm, search_mm, "mm"));
        }
        let touch_n = self.level().map_or(0.0, |(_, level)| TOUCH_SHARE * level.force_set_n).min(TOUCH_MOST_N);
        let detect_n = self.context.zero.detect_n();
        let speed = self.context.permit.approach_speed_mm_s(touch_n.max(1.2 * detect_n));
        self.advance(State::Approaching, target_mm, speed.min(APPROACH_MOST_MM_S))
    }

    fn touched(&mut self, force_n: f64) -> Result<Command, Trip> {
        self.force_n = force_n;
        if force_n < self.context.zero.detect_n() / 2.0 {
            return self.approach();
        }
        self.in_contact = true;
        self.steps = 0;
        self.anchor = (self.z_mm, force_n);
        self.before_step = self.anchor;
        self.path.push((self.z_mm, force_n));
        self.pursue()
    }

    /// A large step teaches the stiffness; a small one reads too soft, because the specimen relaxes meanwhile.
    fn learn(&mut self) {
        let Some((index, level)) = self.level() else { return };
        if index == self.first_loaded() && self.path.last().is_some_and(|last| self.z_mm > last.0) {
            self.path.push((self.z_mm, self.force_n));
        }
        let (z_mm, force_n) = (self.z_mm - self.anchor.0, self.force_n - self.anchor.1);
        if force_n.abs() >= LEARN_SHARE * level.force_set_n && z_mm * force_n > 0.0 {
            self.stiffness_n_mm = Some(force_n / z_mm);
            self.anchor = (self.z_mm, self.force_n);
            // depth counts from the surface as touched, which is known once the stiffness is; until then from the earliest
            self.first_mm = self.first_mm.max(self.touched_mm().unwrap_or(self.first_mm));
        }
    }

    /// Closer to the level from its own side, or on to the dwell and the window if it is reached.
    fn pursue(&mut self) -> Result<Command, Trip> {
        let Some((_, level)) = self.level() else { return self.withdraw() };
        let side = match level.branch {
            Branch::Loading => 1.0,
            Branch::Unloading => -1.0,
        };
        let limit_n = self.context.limits.force_n - self.drift_n - 3.0 * self.sigma_n;
        let gap_n = side * (level.force_set_n.min(limit_n) - self.force_n);
        let reached_n = (REACHED_SHARE * self.task.force_tolerance_n).max(3.0 * self.sigma_n);
        if gap_n <= reached_n {
            return self.reached();
        }
        self.steps += 1;
        if self.steps > STEPS_MAX {
            return Err(Trip::new(Rule::NoConvergence, self.force_n, level.force_set_n, "N"));
        }
        let declared = self.context.limits.stiffness_n_mm;
        let stiffness = match self.stiffness_n_mm {
            Some(learned) if gap_n < LEARN_SHARE * level.force_set_n => {
                (learned * STIFFENING).clamp(declared / 20.0, declared)
            }
            _ => declared,
        };
        let step_mm = side * (gap_n / stiffness).max(STEP_LEAST_MM);
        if side < 0.0 {
            let z_mm = self.z_mm + step_mm;
            return self.go(State::Stepping, self.context.permit.withdraw(self.z_mm, z_mm, self.context.speed_mm_s)?);
        }
        let deepest_mm = self.context.permit.deepest_mm(&self.standing());
        let target_mm = (self.z_mm + step_mm).min(deepest_mm);
        if target_mm - self.z_mm < STEP_LEAST_MM {
            // no more is permitted: within the tolerance that will do
            let short_n = level.force_set_n - self.force_n;
            if short_n <= self.task.force_tolerance_n {
                return self.reached();
            }
            return Err(Trip::new(Rule::OutOfReach, self.force_n, level.force_set_n, "N"));
        }
        self.advance(State::Stepping, target_mm, self.context.speed_mm_s)
    }

    fn reached(&mut self) -> Result<Command, Trip> {
        if self.task.hold_s > 0.0 && !self.dwelt {
            self.dwelt = true;
            return self.go_still(State::Dwelling, Command::Dwell(self.task.hold_s));
        }
        self.sample()
    }

    fn sample(&mut self) -> Result<Command, Trip> {
        self.go_still(State::Sampling, Command::Sample(self.task.sample_s))
    }

    fn withdraw(&mut self) -> Result<Command, Trip> {
        let granted = self.context.permit.withdraw(self.z_mm, self.context.clear_mm, self.context.speed_mm_s)?;
        self.go(State::Withdrawing, granted)
    }

    /// Out of contact, as the force must show; then the next level (in air), or the end.
    fn left(&mut self, force_n: f64) -> Result<Command, Trip> {
        let most_n = self.context.zero.detect_n();
        if force_n.abs() >= most_n {
            return Err(Trip::new(Rule::StillTouching, force_n, most_n, "N"));
        }
        self.in_contact = false;
        self.force_n = 0.0;
        self.next_level()
    }

    fn advance(&mut self, state: State, z_mm: f64, speed_mm_s: f64) -> Result<Command, Trip> {
        let granted = self.context.permit.advance(&self.standing(), z_mm, speed_mm_s)?;
        self.go(state, granted)
    }

    fn go(&mut self, state: State, granted: Permitted) -> Result<Command, Trip> {
        self.go_still(state, Command::Move(granted))
    }

    fn go_still(&mut self, state: State, command: Command) -> Result<Command, Trip> {
        self.state = state;
        Ok(command)
    }

    fn average(&mut self, state: State, readings: u32) -> Result<Command, Trip> {
        self.sigma_n = self.context.zero.sigma_mean_n(readings);
        self.go_still(state, Command::Average(readings))
    }

    /// How many readings the next look at the force takes.
    fn readings(&self) -> u32 {
        let most_n = self.force_n.max(self.level().map_or(0.0, |(_, level)| level.force_set_n));
        if most_n > NEAR_LIMIT * self.context.limits.force_n { LIMIT_READINGS } else { STEP_READINGS }
    }

    fn first_loaded(&self) -> usize {
        self.task.levels.iter().position(|level| level.force_set_n > 0.0).unwrap_or(0)
    }

    fn standing(&self) -> Standing {
        Standing {
            z_mm: self.z_mm,
            force_n: self.force_n + self.drift_n,
            sigma_n: self.sigma_n,
            age_s: self.age_s,
            first_mm: self.first_mm,
        }
    }
}

/// Where a loading path has no force: the parabola through its first, a middle and its last point, or the line through two, or
/// a guess from the declared stiffness with one.
fn root_of(path: &[(f64, f64)], declared_n_mm: f64) -> Option<f64> {
    let &(z0, f0) = path.first()?;
    let guess = z0 - f0 / (declared_n_mm / 2.0);
    let Some(&(z2, f2)) = path.last().filter(|last| last.1 > f0 * 1.5) else { return Some(guess) };
    let line = (f2 - f0) / (z2 - z0);
    let root = path
        .iter()
        .copied()
        .filter(|&(_, f)| f > f0 * 1.5 && f < f2 - 0.25 * (f2 - f0))
        .map(|(z1, f1)| {
            let curvature = ((f2 - f1) / (z2 - z1) - (f1 - f0) / (z1 - z0)) / (z2 - z0);
            let slope = (f1 - f0) / (z1 - z0) - curvature * (z1 - z0);
            // f0 - slope u + curvature u^2 = 0 for the way u back from z0
            let discriminant = slope * slope - 4.0 * curvature * f0;
            z0 - 2.0 * f0 / (slope + discriminant.max(0.0).sqrt())
        })
        .next()
        .unwrap_or(z0 - f0 / line);
    // the path relaxes while it is walked: hold the root between the line and the guess
    Some(root.clamp(guess.min(z0 - f0 / line), z0))
}

#[cfg(test)]
mod tests;
