//! The guarded press: contact stops a slow approach, then steps from below follow. Each step uses a stiffness that can't be too
//! small. So the force exceeds the set force only if a single step of the stage causes that.

use super::state::{ForceLoop, PressState, SEARCH_MM, STEP_LEAST_MM, STEPS_MAX, TELL_SIGMAS};
use super::{Branch, LoopCommand, SafetyRule, SetPoint, Strategy, Trip};
use crate::surface::Expected;
use crate::zero::{DETECT_LEAST_N, DETECT_SIGMAS};

/// Fraction of the first force that an approach may add before it stops at contact, and fraction of a set depth.
const TOUCH_SHARE: f64 = 0.6;
const TOUCH_DEPTH_SHARE: f64 = 0.2;
/// Largest force that the touch may use, N.
pub const TOUCH_MOST_N: f64 = 0.2;
/// Height above the earliest contact at which the fast descent ends, mm.
const STANDOFF_MM: f64 = 0.02;
/// Largest gap to the standoff that doesn't need a separate motion, mm.
const SHORT_DESCENT_MM: f64 = 0.10;
/// Fraction of the set force that separates small steps from large ones. Up to it a gap is closed with the declared stiffness; a
/// larger step shows the real stiffness.
pub(super) const LEARN_SHARE: f64 = 0.25;
/// Factor for a learned stiffness. The specimen stiffens with depth, and stiffens more if it is pressed faster.
const STIFFENING: f64 = 1.15;
/// Rise of a path, N, from which the path shows its slope after a first touch of any force.
const LINE_LEAST_N: f64 = 0.2;
/// Possible error of the extrapolation from the first point of a loading path back to zero force. It is given in sd of a mean,
/// and as fractions of the extrapolated distance for a line and for a parabola.
const ROOT_SIGMAS: f64 = 12.0;
const LINE_MISSES: f64 = 1.0;
const PARABOLA_MISSES: f64 = 0.2;
/// Ratio of the path's first force to the rise after it. Above this ratio the fractional error of the extrapolation grows.
const BACK: f64 = 0.3;
/// Distance of the aim below a loading level, in sd of a mean, so that the true force stays below the level too.
const BELOW_SIGMAS: f64 = 4.0;
/// Fraction of the tolerance within which a level counts as reached. The rest is reserved for the change of the force until it is
/// sampled.
const REACHED_SHARE: f64 = 0.1;
/// Fraction of the tolerance within which a level counts as reached after many steps. The fraction grows with each step.
const LET_OFF_SHARE: f64 = 0.5;
const LET_OFF_STEPS: f64 = 60.0;
/// Least change of the force over a distance into the specimen, as a fraction of the expected change.
pub(super) const RESPONSE_SHARE: f64 = 0.1;
/// Fraction of the force from which an expected change can be distinguished from relaxation.
const TELL_SHARE: f64 = 0.3;
/// A smaller change counts near the limit, where the expected force would be this multiple of it. The second constant is the least
/// fraction of the force.
const TELL_LIMITS: f64 = 1.1;
const TELL_LEAST: f64 = 0.12;
/// Gap to a set depth, mm, below which the depth counts as reached, and up to which one motion closes a gap. A motion closes half of a
/// larger gap, because the touched surface is known better as the loading path grows.
const DEPTH_REACHED_MM: f64 = 0.001;
const DEPTH_WHOLE_MM: f64 = 0.020;
/// Largest number of looks for contact. On steel each look may advance only a few micrometres, and the first descent goes all the
/// way from home.
const LOOKS_MAX: u32 = 2000;
const FIRST_LOOKS_MAX: u32 = 20_000;
/// How much softer than declared a specimen may be that a search still feels: the declared stiffness has a margin, and the specimen relaxes.
const SOFTER: f64 = 3.0;
/// Number of readings of the last look of a search, and least mean that is a contact, in sd of the mean: as for a single reading.
const LAST_READINGS: u32 = 64;
const LAST_SIGMAS: f64 = DETECT_SIGMAS;
/// Fastest approach, mm/s. A higher speed loses its gain in braking.
pub(crate) const APPROACH_MOST_MM_S: f64 = 2.0;

/// Fastest approach until the first touch of the specimen, mm/s, unless the rig file states another value. An obstacle of 200
/// N/mm then gets less than 3 N while host and load cell work.
pub const FIRST_APPROACH_MM_S: f64 = 0.4;

impl ForceLoop {
    /// Descends fast to just above the earliest contact, if the distance is long enough for a separate motion.
    pub(super) fn descend(&mut self) -> Result<LoopCommand, Trip> {
        let standoff_mm = self.first_mm - STANDOFF_MM;
        if !self.context.expected.touched || standoff_mm - self.z_mm < SHORT_DESCENT_MM {
            return self.approach();
        }
        self.advance(PressState::Descending, standoff_mm, self.context.speed_mm_s)
    }

    /// Descends slowly until the force shows contact. The motion ends at a safe point even if nothing stops it.
    pub(super) fn approach(&mut self) -> Result<LoopCommand, Trip> {
        let search_mm = self.context.expected.last_mm + self.search_mm();
        let share = if self.is_by_depth() { TOUCH_DEPTH_SHARE } else { TOUCH_SHARE };
        let detect_n = self.context.zero.detect_n();
        let touch_n = (share * self.level_n()).min(TOUCH_MOST_N).max(1.2 * detect_n);
        // above the earliest contact the permit alone limits the way: an obstacle there gets the largest force at most
        let look_mm = self.z_mm.max(self.first_mm) + self.context.permit.approach_way_mm(touch_n);
        let target_mm = self.in_steps_mm(self.context.permit.deepest_mm(&self.context()).min(search_mm).min(look_mm));
        self.steps += 1;
        let looks_max = if self.context.expected.touched { LOOKS_MAX } else { FIRST_LOOKS_MAX };
        let is_at_end = target_mm - self.z_mm < STEP_LEAST_MM;
        if is_at_end && self.last_look.is_none() && self.z_mm >= self.first_mm {
            // a soft specimen may be felt by a mean only
            let readings = LAST_READINGS.max(self.readings());
            self.last_look = Some(readings);
            self.sigma_n = self.context.zero.sigma_mean_n(readings);
            return self.go(PressState::Touching, LoopCommand::Average(readings));
        }
        if is_at_end || self.steps > looks_max {
            return Err(Trip::new(SafetyRule::NoContact, self.z_mm, search_mm, "mm"));
        }
        let speed = self.context.permit.approach_speed_mm_s(touch_n);
        let most_mm_s = if self.context.expected.touched { APPROACH_MOST_MM_S } else { self.context.approach_mm_s };
        self.advance(PressState::Approaching, target_mm, speed.min(most_mm_s).min(self.context.speed_mm_s))
    }

    pub(super) fn touched(&mut self, force_n: f64) -> Result<LoopCommand, Trip> {
        let Expected { first_mm, touched, .. } = self.context.expected;
        let in_contact = force_n >= self.felt_n();
        if in_contact && !touched && self.z_mm < first_mm {
            return Err(Trip::new(SafetyRule::SurfaceElsewhere, self.z_mm, first_mm, "mm"));
        }
        self.check_hardness(force_n)?;
        self.force_n = force_n;
        if !in_contact {
            return self.approach();
        }
        self.make_contact(force_n);
        self.steps = 0;
        self.anchor = (self.z_mm, force_n);
        self.answered = self.anchor;
        self.note_path();
        let steps = self.task.strategy != Strategy::Velocity || self.is_by_depth() || self.must_show_stiffness();
        if steps { self.pursue() } else { self.push() }
    }

    /// Distance beyond the latest expected contact over which the search continues, mm: the force of a noisy cell is felt late.
    fn search_mm(&self) -> f64 {
        let softest_n_mm = self.context.limits.stiffness_n_mm / SOFTER;
        SEARCH_MM.max(self.context.zero.detect_n() / 2.0 / softest_n_mm)
    }

    /// Least mean that is a contact, N. At the end of a search it is that of a mean of many readings, which a noisy cell needs on a soft specimen.
    fn felt_n(&self) -> f64 {
        let usual_n = self.context.zero.detect_n() / 2.0;
        let by_mean_n = self.last_look.map_or(f64::INFINITY, |readings| {
            (LAST_SIGMAS * self.context.zero.sigma_mean_n(readings)).max(DETECT_LEAST_N / 2.0)
        });
        usual_n.min(by_mean_n)
    }

    /// Checks that the force changes as z advances. No other rule detects a cell that always returns the same value. Distances
    /// too short to show a change among noise and relaxation are added up until they are long enough.
    pub(super) fn check_answer(&mut self) -> Result<(), Trip> {
        let (z_mm, force_n) = self.answered;
        let way_mm = self.z_mm - z_mm;
        if way_mm < 0.0 {
            self.answered = (self.z_mm, self.force_n);
            return Ok(());
        }
        // no less than the stiffness from the earliest contact to here, since a specimen stiffens
        let secant = force_n / (z_mm - self.first_mm).max(STEP_LEAST_MM);
        let expected_n = secant.min(self.context.limits.stiffness_n_mm) * way_mm;
        let (least_n, answer_n) = (RESPONSE_SHARE * expected_n, self.force_n - force_n);
        let room_n = TELL_LIMITS * self.context.limits.force_n - force_n;
        let tell_n = room_n.max(TELL_LEAST * force_n).min(TELL_SHARE * force_n); // a force may be negative
        if least_n > TELL_SIGMAS * self.sigma_n && expected_n > tell_n {
            if answer_n < least_n {
                return Err(Trip::new(SafetyRule::NoResponse, answer_n, least_n, "N"));
            }
            self.answered = (self.z_mm, self.force_n);
        }
        Ok(())
    }

    /// Learns the stiffness from a large step. A small step would show too low a stiffness, because the specimen relaxes
    /// meanwhile.
    pub(super) fn learn(&mut self) {
        if self.level().is_none() {
            return;
        }
        self.note_path();
        let (z_mm, force_n) = (self.z_mm - self.anchor.0, self.force_n - self.anchor.1);
        if force_n.abs() >= LEARN_SHARE * self.level_n() && z_mm * force_n > 0.0 {
            // the rounding of a tip takes up to half of its depth from the way, and the stiffness is that of the rest. Ways of more than
            // 40 um are long enough for the usual factor to cover it, the few um on steel show nothing
            let least_mm = z_mm.abs().min(STIFFENING * (z_mm.abs() - self.read_back_mm() / 2.0));
            self.stiffness_n_mm = (least_mm > 0.0).then(|| force_n.abs() / least_mm);
            self.anchor = (self.z_mm, self.force_n);
            // depth counts from the touched surface, once the stiffness is known; before that from the earliest surface
            if let (Some(touched_mm), Some(earliest_mm)) = (self.touched_mm(), earliest_mm(&self.path, self.sigma_n)) {
                self.first_mm = self.first_mm.max(earliest_mm.min(touched_mm));
            }
        }
    }

    /// Moves closer to the level from the level's own side. If the level is reached, continues to the dwell and the window.
    pub(super) fn pursue(&mut self) -> Result<LoopCommand, Trip> {
        let Some((_, level)) = self.level() else { return self.leave_contact() };
        let force_set_n = match level.set {
            SetPoint::Force(force_n) => force_n,
            SetPoint::Depth(depth_mm) => return self.pursue_depth(depth_mm),
        };
        let limit_n = self.context.limits.force_n;
        let (side, below_n) = match level.branch {
            Branch::Loading => (1.0, BELOW_SIGMAS * self.sigma_n),
            Branch::Unloading => (-1.0, 0.0),
        };
        let gap_n = side * (force_set_n.min(limit_n) - self.force_n) - below_n;
        // a force that relaxes as fast as it is restored is accepted, the sooner the more often it was tried
        let let_off_n = (LET_OFF_SHARE * f64::from(self.steps) / LET_OFF_STEPS).min(1.0) * self.task.force_tolerance_n;
        let reached_n = (REACHED_SHARE * self.task.force_tolerance_n - below_n).max(self.sigma_n).max(let_off_n);
        if gap_n <= reached_n {
            return self.reached();
        }
        self.steps += 1;
        if self.steps > STEPS_MAX {
            return Err(Trip::new(SafetyRule::NoConvergence, self.force_n, force_set_n, "N"));
        }
        let declared = self.context.limits.stiffness_n_mm;
        let stiffness = match self.stiffness_n_mm {
            Some(learned) if gap_n < LEARN_SHARE * force_set_n => {
                (learned * STIFFENING).clamp(declared / 20.0, declared)
            }
            _ => declared,
        };
        let Some(way_mm) = self.way_mm(gap_n / stiffness) else { return self.reached() };
        let step_mm = side * way_mm;
        if side < 0.0 {
            let z_mm = self.z_mm + step_mm;
            let granted = self.retract_to(z_mm)?;
            return self.go(PressState::Stepping, LoopCommand::Move(granted));
        }
        self.step_to(PressState::Stepping, self.z_mm + step_mm)
    }

    /// Moves deeper toward a depth below the touched surface, from above. If it is reached, continues to the dwell and the window.
    fn pursue_depth(&mut self, depth_mm: f64) -> Result<LoopCommand, Trip> {
        let Some(gap_mm) = self.depth_gap_mm(depth_mm) else { return self.approach() };
        if gap_mm <= DEPTH_REACHED_MM {
            return self.reached();
        }
        self.steps += 1;
        if self.steps > STEPS_MAX {
            return Err(Trip::new(SafetyRule::NoConvergence, depth_mm - gap_mm, depth_mm, "mm"));
        }
        let part_mm = if gap_mm > DEPTH_WHOLE_MM { gap_mm / 2.0 } else { gap_mm };
        let Some(way_mm) = self.way_mm(part_mm) else { return self.reached() };
        self.step_to(PressState::Stepping, self.z_mm + way_mm)
    }

    /// Whether the present level is a depth.
    fn is_by_depth(&self) -> bool {
        self.level().is_some_and(|(_, level)| level.set.depth_mm().is_some())
    }

    /// Distance to a set depth below the touched surface, mm; `None` before contact.
    fn depth_gap_mm(&self, depth_mm: f64) -> Option<f64> {
        Some(self.touched_mm()? + depth_mm - self.z_mm)
    }

    /// Returns the distance that closes a gap, mm: the nearest that the stage can go. `None` if the gap is under half a step, so
    /// nothing is nearer than here.
    pub(super) fn way_mm(&self, gap_mm: f64) -> Option<f64> {
        let steps = self.context.permit.steps();
        let way_mm = if steps.is_fine() { gap_mm.max(STEP_LEAST_MM) } else { steps.nearest_mm(gap_mm) };
        Some(way_mm).filter(|_| gap_mm >= self.step_mm() / 2.0)
    }

    /// Smallest step of z, mm.
    pub(super) fn step_mm(&self) -> f64 {
        self.context.permit.steps().least_z_mm()
    }

    /// Returns the deepest z, mm, no deeper than wanted, at which the stage can stand.
    pub(super) fn in_steps_mm(&self, wanted_mm: f64) -> f64 {
        self.context.permit.steps().no_deeper_mm(self.z_mm, wanted_mm)
    }

    /// Moves deeper as far as permitted. If no further motion is permitted, a force within the tolerance is accepted.
    pub(super) fn step_to(&mut self, state: PressState, wanted_mm: f64) -> Result<LoopCommand, Trip> {
        if let Some(dwell_s) = self.must_show_answer_s(wanted_mm)? {
            return self.go(PressState::Lingering, LoopCommand::Dwell(dwell_s));
        }
        let deepest_mm = self.in_steps_mm(self.context.permit.deepest_mm(&self.context()));
        if deepest_mm - self.z_mm < STEP_LEAST_MM {
            let set = self.level().map(|(_, level)| level.set);
            let (missing, tolerance, measured, limit, unit) = match set {
                Some(SetPoint::Depth(depth_mm)) => {
                    let gap_mm = self.depth_gap_mm(depth_mm).unwrap_or(depth_mm);
                    (gap_mm, self.task.depth_tolerance_mm, depth_mm - gap_mm, depth_mm, "mm")
                }
                _ => {
                    let set_n = self.level_n();
                    (set_n - self.force_n, self.task.force_tolerance_n, self.force_n, set_n, "N")
                }
            };
            if missing <= tolerance {
                return self.reached();
            }
            if self.is_doubted() {
                return Ok(LoopCommand::Doubt(Trip::new(SafetyRule::SofterThanTaught, measured, limit, unit)));
            }
            let rule =
                if self.is_bounded_by_neighbours() { SafetyRule::SofterThanTaught } else { SafetyRule::OutOfReach };
            return Err(Trip::new(rule, measured, limit, unit));
        }
        self.advance(state, wanted_mm.min(deepest_mm), self.context.speed_mm_s)
    }
}

/// Returns the position at which a loading path has zero force. It uses the parabola through the first, a middle and the last
/// point, or the line through two points. With one point it estimates the position from the declared stiffness.
pub(super) fn root_of(path: &[(f64, f64)], declared_n_mm: f64) -> Option<f64> {
    let &(z0, f0) = path.first()?;
    let guess = z0 - f0 / (declared_n_mm / 2.0);
    let tells = |last: &&(f64, f64)| last.1 > f0 * 1.5 || last.1 > f0 + LINE_LEAST_N;
    let Some(&(z2, f2)) = path.last().filter(tells) else { return Some(guess) };
    let line_mm = z0 - f0 * (z2 - z0) / (f2 - f0);
    // the path relaxes during the search: keep the root between the line and the guess
    Some(parabola_root_mm(path).unwrap_or(line_mm).clamp(guess.min(line_mm), z0))
}

/// Returns the position of zero force on the parabola through a path's first, a middle and its last point.
fn parabola_root_mm(path: &[(f64, f64)]) -> Option<f64> {
    let (&(z0, f0), (z1, f1), &(z2, f2)) = (path.first()?, middle_of(path)?, path.last()?);
    let curvature = ((f2 - f1) / (z2 - z1) - (f1 - f0) / (z1 - z0)) / (z2 - z0);
    let slope = (f1 - f0) / (z1 - z0) - curvature * (z1 - z0);
    // f0 - slope u + curvature u^2 = 0 for the way u back from z0
    let discriminant = slope * slope - 4.0 * curvature * f0;
    Some(z0 - 2.0 * f0 / (slope + discriminant.max(0.0).sqrt()))
}

/// Returns the earliest possible position of contact, mm, for a path with this noise of a point. Unlike [`root_of`], it includes
/// the possibility that contact began farther back than a line or a parabola shows.
fn earliest_mm(path: &[(f64, f64)], sigma_n: f64) -> Option<f64> {
    let (&(z0, f0), &(z2, f2)) = (path.first()?, path.last().filter(|_| path.len() > 1)?);
    let line_mm = z0 - f0 * (z2 - z0) / (f2 - f0);
    let (root_mm, missed) = match parabola_root_mm(path) {
        Some(parabola_mm) => (parabola_mm.min(line_mm), PARABOLA_MISSES),
        None => (line_mm, LINE_MISSES),
    };
    // distance back, in units of the path
    let back = f0 / (f2 - f0);
    let noise_mm = ROOT_SIGMAS * (1.0 + back) * sigma_n * (z2 - z0) / (f2 - f0);
    Some(root_mm - noise_mm - missed * (back / BACK).powi(2).max(1.0) * (z0 - root_mm))
}

/// Returns the first point of a path that is well separated from both ends of the path.
fn middle_of(path: &[(f64, f64)]) -> Option<(f64, f64)> {
    let (&(_, f0), &(_, f2)) = (path.first()?, path.last()?);
    path.iter().copied().find(|&(_, f)| f > f0 * 1.5 && f < f2 - 0.25 * (f2 - f0))
}
