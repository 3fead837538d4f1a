//! Motion of an axis: trajectories in closed form.

/// Step to which the time since a motion began is rounded, s. It is finer than any time used here, and far coarser than the
/// rounding error of a float for the time of day. So a motion is bit-identical at any start time.
const GRAIN_S: f64 = 1e-9;

/// Motion of one axis: intervals of constant acceleration, then rest. It is a trapezoid of speed, as a controller plans it.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    stretches: Vec<Stretch>,
    end: At,
    end_mm: f64,
}

/// Instant in a motion, given as the start of the motion and the time after the start.
#[derive(Clone, Copy, Debug, PartialEq)]
struct At {
    began_s: f64,
    after_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Stretch {
    from: At,
    position_mm: f64,
    speed_mm_s: f64,
    acceleration_mm_s2: f64,
}

impl Trajectory {
    /// Creates an axis at rest at `position_mm`.
    pub fn at_rest(position_mm: f64) -> Self {
        Trajectory { stretches: Vec::new(), end: At { began_s: 0.0, after_s: 0.0 }, end_mm: position_mm }
    }

    /// Creates a motion from a position and a speed to rest at `target_mm`, at most at `speed_mm_s` (positive) with
    /// `acceleration_mm_s2` (positive) both ways. If the speed is too high for the remaining distance, the axis brakes beyond the
    /// target and returns.
    pub fn to(now_s: f64, state: (f64, f64), target_mm: f64, speed_mm_s: f64, acceleration_mm_s2: f64) -> Self {
        let (start_mm, start_speed) = state;
        let mut plan = Planner::from(now_s, start_mm, start_speed);
        let a = acceleration_mm_s2;
        let heading = if target_mm >= start_mm { 1.0 } else { -1.0 };
        let stopping_mm = start_speed * start_speed / (2.0 * a);
        let wrong_way = start_speed * heading < 0.0;
        if start_speed != 0.0 && (wrong_way || stopping_mm > (target_mm - start_mm).abs() + 1e-12) {
            plan.change_speed(0.0, a);
        }
        plan.run_to(target_mm, speed_mm_s, a);
        Trajectory { stretches: plan.stretches, end: plan.at, end_mm: target_mm }
    }

    /// Creates a motion from a position and a speed to rest as soon as `deceleration_mm_s2` allows.
    pub fn stop(now_s: f64, state: (f64, f64), deceleration_mm_s2: f64) -> Self {
        let (position_mm, speed_mm_s) = state;
        let mut plan = Planner::from(now_s, position_mm, speed_mm_s);
        plan.change_speed(0.0, deceleration_mm_s2);
        Trajectory { stretches: plan.stretches, end: plan.at, end_mm: plan.position_mm }
    }

    /// Joins this motion, a rest, and a second motion that starts at the end position of this one, at the end time or later.
    pub fn then(mut self, next: &Trajectory) -> Self {
        if next.stretches.first().is_some_and(|first| first.from.s() > self.end_s()) {
            self.stretches.push(self.rest());
        }
        if !next.stretches.is_empty() {
            self.stretches.extend_from_slice(&next.stretches);
            (self.end, self.end_mm) = (next.end, next.end_mm);
        }
        self
    }

    /// Returns this motion without what has passed.
    pub(crate) fn left(&self, now_s: f64) -> Trajectory {
        let gone = self.stretches.iter().filter(|s| s.from.s() <= now_s).count().saturating_sub(1);
        Trajectory { stretches: self.stretches[gone..].to_vec(), ..*self }
    }

    /// Returns the trajectory of a stage that follows a new profile from `now_s` with a lag of `lag_s`. The stage first continues
    /// its old motion for the lag time. Then it is at the position of the profile `lag_s` earlier.
    pub(super) fn followed_by(&self, profile: &Trajectory, now_s: f64, lag_s: f64) -> Trajectory {
        if lag_s == 0.0 {
            return profile.clone();
        }
        let splice = At { began_s: now_s + lag_s, after_s: 0.0 };
        let mut stretches = self.left(now_s).stretches;
        stretches.retain(|s| s.from.s() < splice.s());
        if self.end_s() < splice.s() {
            stretches.push(self.rest());
        }
        let late = |at: At| At { began_s: at.began_s + lag_s, ..at };
        let end = late(profile.end);
        if end.s() <= splice.s() {
            return Trajectory { stretches, end: splice, end_mm: profile.end_mm }; // the profile has ended
        }
        stretches.extend(profile.stretches.iter().map(|s| Stretch { from: late(s.from), ..*s }));
        Trajectory { stretches, end, end_mm: profile.end_mm }
    }

    /// Time at which the axis comes to rest, s.
    pub fn end_s(&self) -> f64 {
        self.end.s()
    }

    /// Position at which the axis comes to rest, mm.
    pub fn end_mm(&self) -> f64 {
        self.end_mm
    }

    /// Whether the axis still moves.
    pub fn moving(&self, now_s: f64) -> bool {
        !self.end.is_past(now_s)
    }

    /// Position of the axis, mm.
    pub fn position_mm(&self, now_s: f64) -> f64 {
        self.state(now_s).0
    }

    /// Speed of the axis, mm/s.
    pub fn speed_mm_s(&self, now_s: f64) -> f64 {
        self.state(now_s).1
    }

    /// Position, speed and acceleration: mm, mm/s, mm/s^2.
    pub(super) fn state(&self, now_s: f64) -> (f64, f64, f64) {
        if self.end.is_past(now_s) {
            return (self.end_mm, 0.0, 0.0);
        }
        let stretch = self.stretches.iter().rev().find(|s| s.from.is_past(now_s)).or(self.stretches.first());
        let Some(s) = stretch else { return (self.end_mm, 0.0, 0.0) };
        let (dt, a) = (s.from.since_s(now_s), s.acceleration_mm_s2);
        (s.position_mm + dt * (s.speed_mm_s + dt * a / 2.0), s.speed_mm_s + a * dt, a)
    }

    /// Returns the next instant after `now_s` at which the acceleration changes.
    pub(super) fn next_knot(&self, now_s: f64) -> Option<f64> {
        if self.end.is_past(now_s) {
            return None;
        }
        let next = self.stretches.iter().map(|s| s.from.s()).find(|&from_s| from_s > now_s);
        Some(next.unwrap_or(self.end_s()))
    }

    fn rest(&self) -> Stretch {
        Stretch { from: self.end, position_mm: self.end_mm, speed_mm_s: 0.0, acceleration_mm_s2: 0.0 }
    }
}

impl At {
    fn s(self) -> f64 {
        self.began_s + self.after_s
    }

    /// Time since this instant, s.
    fn since_s(self, now_s: f64) -> f64 {
        ((now_s - self.began_s) / GRAIN_S).round() * GRAIN_S - self.after_s
    }

    /// Whether the instant has passed. An instant long ago needs no rounding, which is the usual case, because axes mostly rest.
    fn is_past(self, now_s: f64) -> bool {
        now_s - self.s() > 1000.0 * GRAIN_S || self.since_s(now_s) >= -GRAIN_S
    }
}

struct Planner {
    at: At,
    position_mm: f64,
    speed_mm_s: f64,
    stretches: Vec<Stretch>,
}

impl Planner {
    fn from(now_s: f64, position_mm: f64, speed_mm_s: f64) -> Planner {
        Planner { at: At { began_s: now_s, after_s: 0.0 }, position_mm, speed_mm_s, stretches: Vec::new() }
    }

    fn keep(&mut self, acceleration_mm_s2: f64, for_s: f64) {
        if for_s <= 0.0 {
            return;
        }
        self.stretches.push(Stretch {
            from: self.at,
            position_mm: self.position_mm,
            speed_mm_s: self.speed_mm_s,
            acceleration_mm_s2,
        });
        self.at.after_s += for_s;
        self.position_mm += for_s * (self.speed_mm_s + for_s * acceleration_mm_s2 / 2.0);
        self.speed_mm_s += acceleration_mm_s2 * for_s;
    }

    fn change_speed(&mut self, speed_mm_s: f64, a: f64) {
        let change = speed_mm_s - self.speed_mm_s;
        self.keep(a * change.signum(), change.abs() / a);
        self.speed_mm_s = speed_mm_s;
    }

    /// Moves toward a target. The initial speed is zero or points to the target, and leaves enough distance to brake.
    fn run_to(&mut self, target_mm: f64, cruise_mm_s: f64, a: f64) {
        let way_mm = target_mm - self.position_mm;
        let heading = way_mm.signum();
        let start = self.speed_mm_s * heading;
        // the speed at which accelerating and then braking exactly cover the distance
        let summit = ((way_mm.abs() * 2.0 * a + start * start) / 2.0).sqrt();
        let cruise = if start > cruise_mm_s { cruise_mm_s } else { summit.min(cruise_mm_s) };
        self.change_speed(cruise * heading, a);
        let braking_mm = cruise * cruise / (2.0 * a);
        let left_mm = (target_mm - self.position_mm).abs() - braking_mm;
        if cruise > 0.0 {
            self.keep(0.0, left_mm.max(0.0) / cruise);
        }
        self.change_speed(0.0, a);
        self.position_mm = target_mm;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_short_move_is_a_triangle_and_takes_twice_the_root_of_way_over_acceleration() {
        let t = Trajectory::to(1.0, (0.0, 0.0), 0.25, 25.0, 100.0);
        assert!((t.end_s() - 1.0 - 2.0 * (0.25f64 / 100.0).sqrt()).abs() < 1e-12);
        assert!((t.position_mm(1.05) - 0.125).abs() < 1e-12);
    }

    #[test]
    fn a_long_move_cruises() {
        let t = Trajectory::to(0.0, (2.0, 0.0), -8.0, 5.0, 100.0);
        assert!((t.end_s() - (10.0 / 5.0 + 5.0 / 100.0)).abs() < 1e-12);
        assert!((t.speed_mm_s(1.0) + 5.0).abs() < 1e-12);
    }

    #[test]
    fn combined_motions_rest_between_them() {
        let there = Trajectory::to(1.0, (0.0, 0.0), 1.0, 10.0, 100.0);
        let back = Trajectory::to(2.0, (1.0, 0.0), 0.5, 10.0, 100.0);
        let both = there.clone().then(&Trajectory::at_rest(1.0)).then(&back);
        for at_s in [0.5, 1.1, 1.3, there.end_s(), 1.9] {
            assert_eq!(both.state(at_s), there.state(at_s), "{at_s} s");
        }
        for at_s in [2.0, 2.05, back.end_s(), 9.0] {
            assert_eq!(both.state(at_s), back.state(at_s), "{at_s} s");
        }
        let knots = std::iter::successors(Some(0.0), |&knot_s| both.next_knot(knot_s)).collect::<Vec<_>>();
        assert!(knots.is_sorted_by(|a, b| a < b) && knots.contains(&there.end_s()) && knots.contains(&2.0));
    }

    #[test]
    fn lagging_stage_follows_the_profile_through_changes() {
        let lag_s = 0.007;
        let mut profile = Trajectory::to(1.0, (0.0, 0.0), 8.0, 10.0, 100.0);
        let mut real = Trajectory::at_rest(0.0).followed_by(&profile, 1.0, lag_s);
        let mut past = vec![(0.0, Trajectory::at_rest(0.0)), (1.0, profile.clone())];
        // a new speed, another one within its lag, a stop, and a new move before the stop is complete
        for (now_s, stop, target_mm, speed_mm_s) in
            [(1.2, false, 8.0, 2.0), (1.203, false, 8.0, 20.0), (1.35, true, 0.0, 0.0), (1.36, false, -3.0, 5.0)]
        {
            let state = (profile.position_mm(now_s), profile.speed_mm_s(now_s));
            profile = if stop {
                Trajectory::stop(now_s, state, 100.0)
            } else {
                Trajectory::to(now_s, state, target_mm, speed_mm_s, 100.0)
            };
            real = real.followed_by(&profile, now_s, lag_s);
            past.push((now_s, profile.clone()));
            assert!(real.stretches.is_sorted_by(|a, b| a.from.s() < b.from.s()), "each knot in its turn");
            for step in 0..=400 {
                let at_s = now_s + f64::from(step) * 1e-4;
                let then_s = at_s - lag_s;
                let (_, was) = past.iter().rev().find(|(from_s, _)| *from_s <= then_s).expect("a profile");
                let (found, expected) = (real.state(at_s), was.state(then_s));
                assert!((found.0 - expected.0).abs() < 1e-9 && (found.1 - expected.1).abs() < 1e-7, "{at_s} s");
            }
        }
        assert!((real.end_s() - profile.end_s() - lag_s).abs() < 1e-12 && real.end_mm() == -3.0);
        assert!(real.stretches.len() <= 12, "what has passed is forgotten");
    }

    #[test]
    fn a_lagging_stage_rests_until_a_new_profile_reaches_it() {
        let profile = Trajectory::to(5.0, (2.0, 0.0), 3.0, 10.0, 100.0);
        let real = Trajectory::at_rest(2.0).followed_by(&profile, 5.0, 0.01);
        assert_eq!((real.state(5.0), real.state(5.0099)), ((2.0, 0.0, 0.0), (2.0, 0.0, 0.0)));
        assert_eq!(real.next_knot(5.0), Some(5.01));
        assert!(real.moving(profile.end_s() + 0.0099) && !real.moving(profile.end_s() + 0.0101));
    }

    proptest! {
        #[test]
        fn any_motion_is_continuous_and_ends_at_rest_on_its_target(
            start in -10.0..10.0f64, speed in -20.0..20.0f64, target in -10.0..10.0f64, cruise in 0.1..25.0f64,
        ) {
            let t = Trajectory::to(0.0, (start, speed), target, cruise, 100.0);
            let mut knots = vec![0.0];
            while let Some(next) = t.next_knot(*knots.last().unwrap()) { knots.push(next); }
            for &knot in &knots[1..] {
                let (before, after) = (t.state(knot - 1e-9), t.state(knot));
                prop_assert!((before.0 - after.0).abs() < 1e-6 && (before.1 - after.1).abs() < 1e-5);
            }
            prop_assert_eq!(t.state(t.end_s()), (target, 0.0, 0.0));
            let stop = Trajectory::stop(0.0, (start, speed), 100.0);
            prop_assert!((stop.end_mm() - (start + speed * speed.abs() / 200.0)).abs() < 1e-9);
        }
    }

    #[test]
    fn lagging_stage_rests_where_its_profile_has_ended() {
        let (lag_s, end_s) = (0.007, 3.0);
        let mut profile = Trajectory::to(1.0, (0.0, 0.0), -3.0, 5.0, 100.0);
        let mut real = Trajectory::at_rest(0.0).followed_by(&profile, 1.0, lag_s);
        // another axis moves: this one gets what is left of its motion, which is its end
        profile = profile.left(end_s);
        real = real.followed_by(&profile, end_s, lag_s);
        for ms in 0..=20 {
            assert_eq!(real.state(end_s + f64::from(ms) * 1e-3), (-3.0, 0.0, 0.0), "{ms} ms");
        }
    }
}
