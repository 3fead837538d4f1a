//! Permitted motions.

use super::drag::DragLimits;
use super::drift::Drift;
use super::speed::safe_speed_mm_s;
use super::trip::{SafetyRule, Trip};
use super::zero::Zero;
use palpate_core::quantity::{Axis, FINEST_STEP_MM, Limits, StageBounds, Steps};

/// Part of the depth limit that is reserved for the error of the touched surface, mm.
pub const DEPTH_MARGIN_MM: f64 = 0.03;

/// Slowest motion that is commanded, mm/s. Below it the speed would be lost in a controller's number format.
pub(crate) const SPEED_LEAST_MM_S: f64 = 1e-4;

/// Allowed rounding of a motion, mm.
const ROUNDING_MM: f64 = 1e-9;

/// Largest excess of a force over the force that the declared stiffness allows, N, and in sd of one reading. Above it the contact
/// counts as harder than declared.
const HARD_N: f64 = 0.12;
const HARD_SIGMAS: f64 = 6.0;

/// Largest move of the zero between two no-load readings, N, and additional drift allowed for the time between them, N/s (I4). The
/// drift is twice that of a cell that warms up. A larger or sudden move isn't a drift.
const NO_LOAD_N: f64 = 0.020;
const DRIFT_N_S: f64 = 0.001;
/// Largest move of a zero whose rate isn't known yet, as a fraction of the force limit.
const UNKNOWN_SHARE: f64 = 0.1;
/// Additional apparent drift that is allowed before a first touch, in sd of a mean.
const DRIFT_SIGMAS: f64 = 4.0;

/// Largest difference of the zero between two neighbouring heights, N, in addition to noise and drift.
const FREE_N: f64 = 0.005;

/// Distance between these two heights. Over this distance, the force of the declared specimen rises by at most this fraction of
/// the force limit. The second constant is the largest distance, mm.
const SOUNDING_SHARE: f64 = 0.1;
const SOUNDING_MOST_MM: f64 = 0.1;

/// Least clearance above the highest possible surface at which x and y may move, mm (I7).
const SIDEWAYS_MM: f64 = 0.030;

/// Distance of the indenter from the earliest possible surface when it travels, mm.
pub const TRAVEL_CLEARANCE_MM: f64 = 0.10;

/// A motion along z that may be commanded. Only [`Permit`] creates it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Permitted {
    z_mm: f64,
    speed_mm_s: f64,
}

impl Permitted {
    /// End of the motion, mm into the specimen.
    pub fn z_mm(&self) -> f64 {
        self.z_mm
    }

    /// Maximum speed of the motion, mm/s.
    pub fn speed_mm_s(&self) -> f64 {
        self.speed_mm_s
    }
}

/// Permission to move x and y. Only [`Permit`] gives it.
#[derive(Debug)]
pub struct Sideways(());

/// Known state when a motion is requested.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionContext {
    /// Position of the indenter, read back, mm.
    pub z_mm: f64,
    /// Force on the indenter, N.
    pub force_n: f64,
    /// Standard deviation of that force, N.
    pub sigma_n: f64,
    /// Age of that force, s.
    pub age_s: f64,
    /// Earliest z at which contact is possible, mm.
    pub first_mm: f64,
    /// Deepest z by what doesn't depend on the present force, mm; infinite if nothing bounds it.
    pub most_mm: f64,
}

/// Rules under which a motion may be commanded. The end point of a motion must be safe even if the host, the link or the loop
/// fails during the motion. I1 to I7 are the study's names for the rules.
///
/// | rule | where |
/// |---|---|
/// | I1 force at the end point, by the declared stiffness | [`deepest_mm`](Self::deepest_mm) |
/// | I2 depth at the end point | [`deepest_mm`](Self::deepest_mm) |
/// | I3 speed, by the measured reaction time | [`advance`](Self::advance) |
/// | I4 a recent force, and a zero that moves no faster than a drift, checked before each press | [`advance`](Self::advance), [`zero_holds`](Self::zero_holds) |
/// | I5 contact no stiffer than declared | [`most_n`](Self::most_n) |
/// | I6 motion away is always allowed; a stop needs no permission | [`retract`](Self::retract) |
/// | I7 x and y move only in the clear, or by a drag whose end is safe | [`sideways`](Self::sideways), [`drag`](Self::drag) |
#[derive(Clone, Copy, Debug)]
pub struct Permit {
    pub(crate) limits: Limits,
    /// What the rig allows in a drag; `None`: none.
    pub(crate) drag: Option<DragLimits>,
    reaction_s: f64,
    detect_n: f64,
    /// Standard deviation of one reading, N.
    sigma_n: f64,
    /// Largest age of a reading on which a motion may depend, s.
    pub(crate) stale_s: f64,
    stage: StageBounds,
}

impl Permit {
    /// Creates the permit of a rig from its limits, its stage, its measured reaction time, and the force that counts as contact. On a stage
    /// with steps every motion may end deeper than its target, and the position from which it begins may be deeper than it was read back:
    /// together by [`Steps::reserve_mm`]. On a stage that can't be stopped each approach ends where a contact adds no more than a touch.
    pub fn new(limits: Limits, stage: StageBounds, reaction_s: f64, zero: &Zero) -> Self {
        let (detect_n, sigma_n, stale_s) = (zero.detect_n(), zero.sigma_n, zero.stale_s());
        Permit { limits, drag: None, reaction_s, detect_n, sigma_n, stale_s, stage }
    }

    /// Returns the permit of a rig that allows these drags.
    #[must_use]
    pub fn with_drags(self, drag: Option<DragLimits>) -> Self {
        Permit { drag, ..self }
    }

    /// Steps of the stage.
    pub fn steps(&self) -> Steps {
        self.stage.steps
    }

    /// Returns the deepest end point that would be permitted, mm.
    ///
    /// Force (I1): `F + 3 sigma + k (z - max(z_now, z_first)) <= F_limit`, with the rig's declared stiffness, relaxation
    /// included. Depth (I2): `z - z_first <= depth limit`, minus a margin for the error of the touched surface. Both count the steps
    /// of the stage. A load cell may read an old force, so [`MotionContext::most_mm`] bounds the end point too.
    pub fn deepest_mm(&self, context: &MotionContext) -> f64 {
        let MotionContext { z_mm, force_n, sigma_n, first_mm, most_mm, .. } = *context;
        if ![z_mm, force_n, sigma_n, first_mm].iter().all(|number| number.is_finite()) || most_mm.is_nan() {
            return f64::NEG_INFINITY; // `max` and `min` ignore NaN
        }
        // a force shows contact, for any expected surface
        let first_mm = if force_n >= self.detect_n { first_mm.min(z_mm) } else { first_mm };
        let room_n = self.limits.force_n - force_n - 3.0 * sigma_n;
        let by_force = z_mm.max(first_mm) + room_n.max(0.0) / self.limits.stiffness_n_mm;
        let by_depth = first_mm + self.limits.depth_mm - DEPTH_MARGIN_MM;
        by_force.min(by_depth).min(most_mm) - self.reserve_mm()
    }

    /// Distance by which a motion may end deeper than its target, mm: on a fine stage half of the smallest step, which is a force on steel.
    pub(crate) fn reserve_mm(&self) -> f64 {
        self.stage.steps.reserve_mm().max(FINEST_STEP_MM / 2.0)
    }

    /// Returns the longest way of one approach, mm, if nothing can stop it: a contact of the declared stiffness adds at most `force_n`.
    pub fn approach_way_mm(&self, force_n: f64) -> f64 {
        if !self.stage.finishes {
            return f64::INFINITY;
        }
        (force_n / self.limits.stiffness_n_mm).max(self.stage.steps.along(Axis::Z))
    }

    /// Returns the fastest approach, mm/s, that keeps the force at most `force_n` at an unexpected contact. A stage that can't be stopped
    /// has no reaction time: its way alone limits the force.
    pub fn approach_speed_mm_s(&self, force_n: f64) -> f64 {
        if self.stage.finishes {
            return f64::INFINITY;
        }
        let room_n = force_n - self.detect_n;
        safe_speed_mm_s(room_n, self.limits.stiffness_n_mm, self.reaction_s, self.stage.acceleration_mm_s2)
    }

    /// Returns the largest force at `z_mm`, N, of a contact no stiffer than declared (E+). The motion began at a position
    /// `from_mm` with a force `from_n`. If the contact pushes harder, it isn't the specimen that the limits were declared for.
    pub fn most_n(&self, (from_mm, from_n): (f64, f64), first_mm: f64, z_mm: f64) -> f64 {
        let way_mm = (z_mm - from_mm.max(first_mm)).max(0.0) + self.reserve_mm();
        from_n.max(0.0) + self.limits.stiffness_n_mm * way_mm + HARD_N.max(HARD_SIGMAS * self.sigma_n)
    }

    /// Permits a motion toward the specimen, no faster than the force limit allows (I3).
    ///
    /// # Errors
    /// A trip if the end point of the motion isn't safe or the force used isn't recent (I4). Nothing moves then.
    pub fn advance(&self, context: &MotionContext, z_mm: f64, speed_mm_s: f64) -> Result<Permitted, Trip> {
        // written as the positive condition, so NaN fails
        let is_fresh = context.age_s <= self.stale_s;
        if !is_fresh {
            return Err(Trip::new(SafetyRule::Stale, context.age_s, self.stale_s, "s"));
        }
        self.no_deeper_than(self.deepest_mm(context), z_mm, speed_mm_s)
    }

    /// Permits a motion toward the specimen on a rig without a load cell. Its end point is at most the force limit over the declared stiffness,
    /// and at most the depth limit, below `first_mm`, the earliest surface that is possible.
    ///
    /// # Errors
    /// A trip if the end point of the motion isn't safe. Nothing moves then.
    pub fn advance_without_force(&self, first_mm: f64, z_mm: f64, speed_mm_s: f64) -> Result<Permitted, Trip> {
        self.no_deeper_than(self.deepest_without_force_mm(first_mm), z_mm, speed_mm_s)
    }

    /// Permits a motion whose end point is at most this deep, no faster than the force limit allows (I3).
    fn no_deeper_than(&self, deepest_mm: f64, z_mm: f64, speed_mm_s: f64) -> Result<Permitted, Trip> {
        let fastest = self.approach_speed_mm_s(self.limits.force_n);
        // written as the positive condition, so NaN fails
        let is_safe = z_mm <= deepest_mm + ROUNDING_MM && speed_mm_s >= SPEED_LEAST_MM_S && fastest >= SPEED_LEAST_MM_S;
        if !is_safe {
            return Err(Trip::new(SafetyRule::NotPermitted, z_mm, deepest_mm, "mm"));
        }
        Ok(Permitted { z_mm, speed_mm_s: speed_mm_s.min(fastest) })
    }

    /// Returns the deepest end point that would be permitted without a load cell, mm.
    pub fn deepest_without_force_mm(&self, first_mm: f64) -> f64 {
        first_mm + depth_without_force_mm(&self.limits) - self.stage.steps.reserve_mm()
    }

    /// Checks that the newest air differs from the earlier air, and the drift that it showed, by no more than a zero drifts besides in the time
    /// between (I4).
    ///
    /// # Errors
    /// A trip if the difference is larger.
    pub(crate) fn zero_holds(&self, moved_n: f64, sigma_n: f64, between_s: f64, drift: Drift) -> Result<(), Trip> {
        let unknown_n = (drift.unknown_n_s() * between_s).min(UNKNOWN_SHARE * self.limits.force_n);
        let most_n = NO_LOAD_N + 3.0 * sigma_n + DRIFT_N_S * between_s + unknown_n;
        moved_no_further(SafetyRule::ZeroDrifted, moved_n, most_n)
    }

    /// Whether the reading without load moved no further than a zero drifts in the time between, besides the drift that it showed. A larger
    /// change may be a touch that is too light to count as contact. `sigma_n` is the standard deviation of the newer mean, N.
    pub fn is_drift(moved_n: f64, sigma_n: f64, between_s: f64, drift: Drift) -> bool {
        moved_n.abs() <= DRIFT_N_S.max(drift.unknown_on_descent_n_s()) * between_s + DRIFT_SIGMAS * sigma_n
    }

    /// Checks that the load cell's reading without load stays the same when z moves a little away or nearer, so no contact contributes
    /// to it.
    ///
    /// # Errors
    /// A trip if the reading changes.
    pub fn nothing_in_contact(&self, moved_n: f64, sigma_n: f64, between_s: f64) -> Result<(), Trip> {
        moved_no_further(SafetyRule::ZeroInContact, moved_n, FREE_N + 3.0 * sigma_n + DRIFT_N_S * between_s)
    }

    /// Distance that z moves to check that nothing is in contact, mm. On this distance the declared specimen would give a small part of
    /// the force limit.
    pub fn sounding_mm(&self) -> f64 {
        (SOUNDING_SHARE * self.limits.force_n / self.limits.stiffness_n_mm).min(SOUNDING_MOST_MM)
    }

    /// Permits a motion of x and y (I7). The z that was read back must be clear of the highest possible surface on the way,
    /// without force. `first_mm` is the earliest z at which contact is possible.
    ///
    /// # Errors
    /// A trip if z isn't clear.
    pub fn sideways(&self, z_mm: f64, first_mm: f64, force_n: f64) -> Result<Sideways, Trip> {
        let clear_mm = self.clear_mm(first_mm);
        let (is_clear, is_free) = (z_mm <= clear_mm, force_n.abs() < self.detect_n);
        if !is_clear {
            return Err(Trip::new(SafetyRule::NotPermitted, z_mm, clear_mm, "mm"));
        }
        if !is_free {
            return Err(Trip::new(SafetyRule::StillTouching, force_n, self.detect_n, "N"));
        }
        Ok(Sideways(()))
    }

    /// Returns the z at which x and y may move, mm, if contact is possible from `first_mm` on.
    pub fn clear_mm(&self, first_mm: f64) -> f64 {
        first_mm - SIDEWAYS_MM - self.stage.steps.reserve_mm()
    }

    /// Returns the z to which the indenter goes before x and y move, mm: clear even where the stage ends as early as it may.
    pub fn travel_mm(&self, first_mm: f64) -> f64 {
        (first_mm - TRAVEL_CLEARANCE_MM).min(self.clear_mm(first_mm) - self.stage.steps.in_position_mm(Axis::Z))
    }

    /// Force that counts as contact, N.
    pub fn detect_n(&self) -> f64 {
        self.detect_n
    }

    /// Permits a motion away from the specimen, which is always allowed.
    ///
    /// # Errors
    /// A trip if the motion isn't directed away.
    pub fn retract(&self, from_mm: f64, z_mm: f64, speed_mm_s: f64) -> Result<Permitted, Trip> {
        if z_mm.is_finite() && z_mm <= from_mm + ROUNDING_MM && speed_mm_s >= SPEED_LEAST_MM_S {
            Ok(Permitted { z_mm, speed_mm_s })
        } else {
            Err(Trip::new(SafetyRule::NotPermitted, z_mm, from_mm, "mm"))
        }
    }
}

/// Returns the largest depth below the earliest possible surface that is allowed without a load cell, mm: by the force limit over the
/// declared stiffness, and by the depth limit.
pub fn depth_without_force_mm(limits: &Limits) -> f64 {
    (limits.force_n / limits.stiffness_n_mm).min(limits.depth_mm - DEPTH_MARGIN_MM)
}

/// Checks that a zero moved by at most the allowed amount. The condition is written so that a NaN is refused.
fn moved_no_further(rule: SafetyRule, moved_n: f64, most_n: f64) -> Result<(), Trip> {
    if moved_n.abs() <= most_n { Ok(()) } else { Err(Trip::new(rule, moved_n, most_n, "N")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: Limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };

    const STAGE: StageBounds = StageBounds::fine(100.0);

    fn permit() -> Permit {
        permit_of(STAGE)
    }

    fn permit_of(stage: StageBounds) -> Permit {
        let zero = Zero { offset_sigma_n: 0.0003, ..Zero::with_noise(0.003) };
        Permit::new(LIMITS, stage, 0.05, &zero)
    }

    #[test]
    fn descent_from_home_ends_at_the_earliest_surface() {
        let context = MotionContext {
            z_mm: -12.5,
            force_n: 0.0,
            sigma_n: 0.0,
            age_s: 0.0,
            first_mm: -0.3,
            most_mm: f64::INFINITY,
        };
        assert!((permit().deepest_mm(&context) - (0.7 - ROUNDED_MM)).abs() < 1e-12);
        assert!(permit().advance(&context, 0.7 - ROUNDED_MM, 1.0).is_ok());
        assert_eq!(permit().advance(&context, 0.71, 1.0).unwrap_err().rule, SafetyRule::NotPermitted);
    }

    const STEPS: Steps = Steps { mm: [0.0, 0.0, 0.02], ..Steps::FINE };
    /// In position 0.003 mm and half a step beyond a target, and read back half a step too high.
    const RESERVE_MM: f64 = 0.003 + 0.01 + 0.01;
    /// A fine stage rounds its targets too.
    const ROUNDED_MM: f64 = FINEST_STEP_MM / 2.0;

    #[test]
    fn end_points_leave_room_for_noise_an_old_force_and_steps() {
        let stepped = permit_of(StageBounds { steps: STEPS, ..STAGE });
        let context = |sigma_n: f64, most_mm: f64| MotionContext {
            z_mm: 0.0,
            force_n: 1.0,
            sigma_n,
            age_s: 0.0,
            first_mm: -0.5,
            most_mm,
        };
        for (permit, context, deepest_mm) in [
            (permit(), context(0.0, f64::INFINITY), 0.5 - ROUNDED_MM),
            (permit(), context(0.1, f64::INFINITY), 0.35 - ROUNDED_MM),
            (permit(), context(0.1, 0.2), 0.2 - ROUNDED_MM),
            (stepped, context(0.1, f64::INFINITY), 0.35 - RESERVE_MM),
        ] {
            assert!((permit.deepest_mm(&context) - deepest_mm).abs() < 1e-12, "{context:?}");
            assert!(permit.advance(&context, deepest_mm + 1e-6, 1.0).is_err(), "{context:?}");
        }
        assert!((permit().deepest_without_force_mm(-0.3) - 0.7).abs() < 1e-12);
        assert!((stepped.deepest_without_force_mm(-0.3) - (0.7 - RESERVE_MM)).abs() < 1e-12);
        assert!((permit().clear_mm(-0.3) + 0.33).abs() < 1e-12, "30 um above the highest surface");
        assert!((stepped.clear_mm(-0.3) - (-0.33 - RESERVE_MM)).abs() < 1e-12);
    }

    #[test]
    fn stage_that_finishes_its_motions_approaches_in_short_ways() {
        let finishes = permit_of(StageBounds { finishes: true, ..STAGE });
        assert_eq!(permit().approach_way_mm(0.1), f64::INFINITY);
        assert_eq!(finishes.approach_way_mm(0.1), 0.05);
        let stepped = permit_of(StageBounds { steps: STEPS, finishes: true, ..STAGE });
        assert_eq!(stepped.approach_way_mm(0.01), 0.02, "no less than a step");
        assert!(permit().approach_speed_mm_s(0.1) < 2.0 && finishes.approach_speed_mm_s(0.1) == f64::INFINITY);
    }

    #[test]
    fn contact_in_the_zero_and_a_way_out_toward_the_specimen_are_refused() {
        assert_eq!(permit().nothing_in_contact(0.0075, 0.001, 0.0), Ok(()), "5 mN and 3 sd");
        for moved_n in [0.0085, -0.0085, f64::NAN] {
            assert_eq!(permit().nothing_in_contact(moved_n, 0.001, 0.0).unwrap_err().rule, SafetyRule::ZeroInContact);
        }
        assert!(permit().retract(0.5, 0.4, 1.0).is_ok());
        assert_eq!(permit().retract(0.5, 0.51, 1.0).unwrap_err().rule, SafetyRule::NotPermitted);
    }

    #[test]
    fn stale_force_or_nan_permits_no_motion() {
        let good = MotionContext {
            z_mm: 0.0,
            force_n: 0.1,
            sigma_n: 0.001,
            age_s: 0.01,
            first_mm: -0.1,
            most_mm: f64::INFINITY,
        };
        assert!(permit().advance(&good, 0.2, 1.0).is_ok());
        assert_eq!(
            permit().advance(&MotionContext { age_s: 0.3, ..good }, 0.2, 1.0).unwrap_err().rule,
            SafetyRule::Stale
        );
        assert_eq!(
            permit().advance(&MotionContext { age_s: f64::NAN, ..good }, 0.2, 1.0).unwrap_err().rule,
            SafetyRule::Stale
        );
        let nowhere = MotionContext { z_mm: f64::NAN, first_mm: f64::NAN, ..good };
        for bad in [MotionContext { force_n: f64::NAN, ..good }, MotionContext { most_mm: f64::NAN, ..good }, nowhere] {
            assert!(permit().advance(&bad, 0.9, 1.0).is_err());
        }
        assert!(permit().advance(&good, f64::NAN, 1.0).is_err());
        assert!(permit().retract(0.0, f64::NAN, 1.0).is_err());
    }

    #[test]
    fn x_and_y_are_permitted_only_in_the_clear_and_without_force() {
        let (permit, first_mm) = (permit(), -0.3);
        let (clear_mm, touch_n) = (permit.clear_mm(first_mm), permit.detect_n());
        assert!(permit.sideways(clear_mm, first_mm, 0.9 * touch_n).is_ok());
        for (z_mm, force_n, rule) in [
            (clear_mm + 0.001, 0.0, SafetyRule::NotPermitted),
            (f64::NAN, 0.0, SafetyRule::NotPermitted),
            (clear_mm, touch_n, SafetyRule::StillTouching),
            (clear_mm, -touch_n, SafetyRule::StillTouching),
            (clear_mm, f64::NAN, SafetyRule::StillTouching),
        ] {
            let refused = permit.sideways(z_mm, first_mm, force_n).unwrap_err();
            assert_eq!(refused.rule, rule, "{force_n} N at {z_mm} mm");
        }
    }

    proptest! {
        /// The promise itself: with every granted motion, a specimen no stiffer than declared bears at most the limit at its end.
        #[test]
        fn no_granted_end_point_exceeds_a_limit(
            surface in -0.3..0.3f64, k in 0.05..2.0f64, lead in 0.0..0.3f64, start in -1.0..1.5f64, wish in -1.0..3.0f64,
        ) {
            let force_at = |z: f64| k * (z - surface).max(0.0);
            let start = start.min(surface + 1.9 / k);
            let context = MotionContext {
                z_mm: start, force_n: force_at(start), sigma_n: 0.0, age_s: 0.0, first_mm: surface - lead,
                most_mm: f64::INFINITY,
            };
            if let Ok(granted) = permit().advance(&context, wish, 5.0) {
                prop_assert!(force_at(granted.z_mm()) <= LIMITS.force_n + 1e-9);
                prop_assert!(granted.z_mm() - surface <= LIMITS.depth_mm);
            }
        }

        /// The same on a stage with steps: it stands where the nearest step is, reads back the same or half a step off, and ends
        /// as far beyond its target as counts as in position.
        #[test]
        fn no_granted_end_point_exceeds_a_limit_on_a_stage_with_steps(
            surface in -0.3..0.3f64, k in 1.9..2.0f64, lead in 0.0..0.3f64, start in -1.0..1.5f64, beyond in -2.0..2.0f64,
            step in 0.0005..0.04f64, off in -0.5..0.5f64,
        ) {
            let steps = Steps { mm: [0.0, 0.0, step], ..Steps::FINE };
            let force_at = |z: f64| k * (z - surface).max(0.0);
            let start = start.min(surface + 1.9 / k);
            let context = MotionContext {
                z_mm: start + off * step, force_n: force_at(start), sigma_n: 0.0, age_s: 0.0, first_mm: surface - lead,
                most_mm: f64::INFINITY,
            };
            // as stiff as declared, and within two steps of where the specimen bears the limit
            let wish = surface + LIMITS.force_n / k + beyond * step;
            if let Ok(granted) = permit_of(StageBounds { steps, ..STAGE }).advance(&context, wish, 5.0) {
                let deepest_mm = granted.z_mm() + steps.in_position_mm(palpate_core::quantity::Axis::Z);
                prop_assert!(deepest_mm <= start || force_at(deepest_mm) <= LIMITS.force_n + 1e-9);
                prop_assert!(deepest_mm - surface <= LIMITS.depth_mm);
            }
        }
    }
}
