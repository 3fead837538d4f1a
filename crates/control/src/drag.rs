//! Drags: motions of x and y in contact. Recipe and rig both name them, and only a load cell with three axes allows them.

use super::permit::{DEPTH_MARGIN_MM, Permit, SPEED_LEAST_MM_S};
use super::trip::{SafetyRule, Trip};
use palpate_core::quantity::{Axis, Limits, Place, Steps};
use std::f64::consts::FRAC_1_SQRT_2;

/// Largest slope of a surface: a rig with a tilt of more than 5 degrees is refused.
const SLOPE_MOST: f64 = 0.0875;

/// Part of the ratio of the forces, sideways over pressing, that remains after a slip at most, and its least fall in sd of a reading.
const SLIP_SHARE: f64 = 0.8;
const SLIP_SIGMAS: f64 = 6.0;

/// Least pressing force by which a force sideways is divided, N.
const CONTACT_LEAST_N: f64 = 0.030;

/// Part of the pressing force that must remain after a drag on a level surface.
const LEFT_SHARE: f64 = 0.5;

/// Least change of the force sideways, in sd of a mean, from which its direction is compared with that of the drag.
const DIRECTION_SIGMAS: f64 = 10.0;

/// Least force per way of one axis, as a fraction of the other axis'. A specimen is less different along x and y.
const RESPONSE_LEAST: f64 = 0.1;

/// What a rig allows in a drag. Every value is declared; none has a default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DragLimits {
    /// Largest force sideways, N.
    pub shear_n: f64,
    /// Longest way in contact, mm.
    pub slide_mm: f64,
    /// Largest stiffness of the specimen sideways, N/mm.
    pub stiffness_n_mm: f64,
    /// Largest force sideways per pressing force.
    pub friction: f64,
    /// Least stiffness of the specimen along z, N/mm: a force shows how deep the tip can be. `None` if the rig declares none.
    pub softest_n_mm: Option<f64>,
}

/// What is known where a drag begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DragStart {
    /// Largest pressing force, N.
    pub force_n: f64,
    /// Largest pressing force since the contact began, N.
    pub peak_n: f64,
    /// Largest force sideways, N.
    pub shear_n: f64,
    /// Largest depth below the earliest surface, mm.
    pub depth_mm: f64,
}

/// A drag of a recipe, from the place of the press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drag {
    /// Way along x of the specimen frame, mm.
    pub x_mm: f64,
    /// Way along y, mm.
    pub y_mm: f64,
    /// Speed, mm/s.
    pub speed_mm_s: f64,
    /// Force sideways at which the drag ends before its way does, N; `None`: it goes all the way.
    pub shear_n: Option<f64>,
    /// Whether a slip ends the run; otherwise it is recorded.
    pub ends_at_slip: bool,
}

impl DragLimits {
    /// Returns each value at the end of a drag: value, limit and unit. Plan and permit have this formula, see [`Permit::drag`].
    pub fn end(&self, limits: &Limits, steps: &Steps, start: &DragStart, way_mm: f64) -> [(f64, f64, &'static str); 3] {
        // a stage with steps may end beyond its target
        let beyond_mm =
            if steps.is_fine() { 0.0 } else { steps.in_position_mm(Axis::X) + steps.in_position_mm(Axis::Y) };
        let way_mm = way_mm + beyond_mm;
        let DragStart { force_n, peak_n, shear_n, depth_mm } = *start;
        let (stiffness_n_mm, rise_mm) = (limits.stiffness_n_mm, SLOPE_MOST * way_mm);
        // the specimen may have relaxed here, but not where the tip arrives
        let by_depth_n = stiffness_n_mm * (depth_mm + steps.reserve_mm());
        let by_force_n = self
            .softest_n_mm
            .map_or(f64::INFINITY, |softest_n_mm| stiffness_n_mm * (peak_n / softest_n_mm + steps.reserve_mm()));
        let normal_n = force_n.max(by_depth_n.min(by_force_n)) + stiffness_n_mm * rise_mm;
        // a larger force on a slope pushes sideways too
        let sticking_n = shear_n + self.stiffness_n_mm * way_mm + SLOPE_MOST * (normal_n - force_n);
        // friction along a slope, in the axes of the cell
        let level = 1.0 - self.friction * SLOPE_MOST;
        let sliding_n = if level > 0.0 { (self.friction + SLOPE_MOST) / level * normal_n } else { f64::INFINITY };
        let shear_n = sticking_n.min(sliding_n).max(shear_n);
        [
            (way_mm, self.slide_mm, "mm of drag"),
            (shear_n, self.shear_n, "N sideways"),
            (normal_n.hypot(shear_n), limits.force_n, "N, all axes"),
        ]
    }
}

impl Drag {
    /// Length of the way, mm.
    pub fn way_mm(&self) -> f64 {
        self.x_mm.hypot(self.y_mm)
    }

    /// Place where it ends if it begins at this one.
    pub fn end(&self, place: Place) -> Place {
        Place::new(place.x_mm + self.x_mm, place.y_mm + self.y_mm)
    }
}

/// A drag that may be commanded. Only [`Permit`] creates it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PermittedDrag {
    drag: Drag,
    shear_most_n: f64,
}

impl PermittedDrag {
    /// The drag.
    pub fn drag(&self) -> Drag {
        self.drag
    }

    /// Largest force sideways that the rig allows, N.
    pub fn shear_most_n(&self) -> f64 {
        self.shear_most_n
    }
}

/// Known state when a drag is requested; the stage is at rest in contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DragContext {
    /// Pressing force, N.
    pub force_n: f64,
    /// Largest pressing force since the contact began, N.
    pub peak_n: f64,
    /// Standard deviation of the pressing force, N.
    pub sigma_n: f64,
    /// Forces along x and y, N.
    pub side_n: [f64; 2],
    /// Standard deviation of each, N.
    pub side_sigma_n: f64,
    /// Age of these forces, s.
    pub age_s: f64,
    /// Depth below the earliest surface, mm.
    pub depth_mm: f64,
}

impl Permit {
    /// Permits a drag, whose end must be safe even if nothing ends the motion earlier.
    ///
    /// With the way w and the largest slope s, the pressing force is at most `Fn' = max(Fn + 3 sigma, F0) + kn s w`. `F0` is the force on
    /// a fresh spot: where the tip arrives, the specimen hasn't relaxed. It is at most `kn` times the depth, and at most `kn / k0` times
    /// the largest force since the contact began, with the least stiffness k0. The force sideways is at most
    /// `Ft' = min(Ft + 3 sigma + kt w + s (Fn' - Fn), (mu + s) / (1 - mu s) Fn')`, and at least what it is. `hypot(Fn', Ft')` must be
    /// within the force limit, `Ft'` within the shear limit, `w` within the longest way, and the depth after the largest slope within the
    /// depth limit.
    ///
    /// # Errors
    /// A trip if the rig allows no drag, or the end isn't safe. Nothing moves then.
    pub fn drag(&self, context: &DragContext, drag: &Drag) -> Result<PermittedDrag, Trip> {
        let DragContext { force_n, peak_n, sigma_n, side_n, side_sigma_n, age_s, depth_mm } = *context;
        let Some(most) = self.drag else {
            return Err(Trip::new(SafetyRule::NotPermitted, drag.way_mm(), 0.0, "mm of drag"));
        };
        let [x_n, y_n] = side_n;
        let numbers = [force_n, peak_n, sigma_n, x_n, y_n, side_sigma_n, depth_mm, drag.x_mm, drag.y_mm];
        if let Some(wrong) = numbers.into_iter().find(|number| !number.is_finite()) {
            return Err(Trip::new(SafetyRule::NotFinite, wrong, 0.0, "of a drag")); // `max` and `min` ignore NaN
        }
        let is_fresh = age_s <= self.stale_s; // written as the positive condition, so NaN fails
        if !is_fresh {
            return Err(Trip::new(SafetyRule::Stale, age_s, self.stale_s, "s"));
        }
        let steps = self.steps();
        let force_n = force_n.max(0.0) + 3.0 * sigma_n;
        let peak_n = force_n.max(peak_n + 3.0 * sigma_n);
        let start = DragStart { force_n, peak_n, shear_n: x_n.hypot(y_n) + 3.0 * side_sigma_n, depth_mm };
        let end = most.end(&self.limits, &steps, &start, drag.way_mm());
        let [(way_mm, ..), ..] = end;
        let deepest_mm = depth_mm + steps.reserve_mm() + SLOPE_MOST * way_mm;
        let depth = (deepest_mm, self.limits.depth_mm - DEPTH_MARGIN_MM, "mm");
        for (value, limit, unit) in end.into_iter().chain([depth]) {
            let is_safe = value <= limit;
            if !is_safe {
                return Err(Trip::new(SafetyRule::NotPermitted, value, limit, unit));
            }
        }
        match drag.speed_mm_s >= SPEED_LEAST_MM_S {
            true => Ok(PermittedDrag { drag: *drag, shear_most_n: most.shear_n }),
            false => Err(Trip::new(SafetyRule::NotPermitted, drag.speed_mm_s, SPEED_LEAST_MM_S, "mm/s")),
        }
    }
}

/// Follows the forces during a drag: the limit sideways, a force at which it ends, and slips.
#[derive(Clone, Copy, Debug)]
pub struct DragWatch {
    shear_most_n: f64,
    side_sigma_n: f64,
    drag: Drag,
    /// Time from the decision to stop until the stage rests, s.
    stops_after_s: f64,
    /// Time and force sideways of the first mean, s and N.
    first: Option<(f64, f64)>,
    /// Last forces: pressing, along x, along y, N.
    last: Option<[f64; 3]>,
    largest: f64,
    slips: u64,
}

impl DragWatch {
    /// Creates the watch of a drag. `side_sigma_n` is the standard deviation of one reading.
    pub fn new(drag: Drag, shear_most_n: f64, side_sigma_n: f64, stops_after_s: f64) -> Self {
        let (first, last) = (None, None);
        DragWatch { shear_most_n, side_sigma_n, drag, stops_after_s, first, last, largest: 0.0, slips: 0 }
    }

    /// Number of slips so far.
    pub fn slips(&self) -> u64 {
        self.slips
    }

    /// Takes a reading, and returns whether the drag has reached its force.
    ///
    /// # Errors
    /// A trip if the mean of two readings is over the shear limit, or the tip slipped and a slip ends the run.
    pub fn see(&mut self, force_n: f64, side_n: [f64; 2], now_s: f64) -> Result<bool, Trip> {
        // one reading is no mean: a single outlier ends no drag
        let Some(last) = self.last.replace([force_n, side_n[0], side_n[1]]) else { return Ok(false) };
        let force_n = 0.5 * (force_n + last[0]);
        let shear_n = (0.5 * (side_n[0] + last[1])).hypot(0.5 * (side_n[1] + last[2]));
        let most_n = self.shear_most_n + 3.0 * self.side_sigma_n;
        let is_within = shear_n <= most_n;
        if !is_within {
            return Err(Trip::new(SafetyRule::OverShear, shear_n, most_n, "N sideways"));
        }
        let ratio = shear_n / force_n.max(CONTACT_LEAST_N);
        let fell_n = (self.largest - ratio) * force_n;
        if ratio < SLIP_SHARE * self.largest && fell_n > SLIP_SIGMAS * self.side_sigma_n {
            self.slips += 1;
            self.largest = ratio;
            if self.drag.ends_at_slip {
                return Err(Trip::new(SafetyRule::Slipped, shear_n, fell_n + shear_n, "N sideways"));
            }
        }
        self.largest = self.largest.max(ratio);
        let (began_s, began_n) = *self.first.get_or_insert((now_s, shear_n));
        // the force rises until the stage rests
        let rate_n_s = if now_s > began_s { (shear_n - began_n) / (now_s - began_s) } else { 0.0 };
        Ok(self.drag.shear_n.is_some_and(|end_n| shear_n + rate_n_s.max(0.0) * self.stops_after_s >= end_n))
    }
}

/// Largest force sideways per way of the drags so far, along x and along y, N/mm.
#[derive(Clone, Copy, Debug, Default)]
pub struct DragResponses([Option<f64>; 2]);

impl DragResponses {
    /// Adds a drag: the way that the tip went, mm, and the change of the force sideways, N. Only a drag along an axis counts.
    ///
    /// # Errors
    /// A trip if one axis reads almost nothing of the drags along it.
    pub fn add(&mut self, way: [f64; 2], change_n: [f64; 2]) -> Result<(), Trip> {
        let way_mm = way[0].hypot(way[1]);
        for axis in 0..2 {
            let is_along = way[axis].abs() > 0.9 * way_mm;
            if is_along {
                let per_mm = (change_n[axis] / way[axis]).max(0.0);
                self.0[axis] = Some(self.0[axis].map_or(per_mm, |largest| largest.max(per_mm)));
            }
        }
        let [Some(x), Some(y)] = self.0 else { return Ok(()) };
        // neither axis may have read anything
        let ratio = if x.max(y) > 0.0 { x.min(y) / x.max(y) } else { 0.0 };
        let is_alike = ratio >= RESPONSE_LEAST; // written as the positive condition, so NaN fails
        if is_alike {
            Ok(())
        } else {
            Err(Trip::new(SafetyRule::AxesDiffer, ratio, RESPONSE_LEAST, "of the other axis' force per way"))
        }
    }
}

/// Checks that the force sideways changed along the way that the tip went, mm: a swapped axis or a wrong sign turns it by 90 degrees or
/// more, if the way is along an axis. `sigma_n` is the standard deviation of each mean.
///
/// # Errors
/// A trip if the direction is off by more than 45 degrees.
pub fn check_direction(way: [f64; 2], before_n: [f64; 2], after_n: [f64; 2], sigma_n: f64) -> Result<(), Trip> {
    let change = [after_n[0] - before_n[0], after_n[1] - before_n[1]];
    let (change_n, way_mm) = (change[0].hypot(change[1]), way[0].hypot(way[1]));
    if change_n <= DIRECTION_SIGMAS * sigma_n || way_mm == 0.0 {
        return Ok(());
    }
    let along = (change[0] * way[0] + change[1] * way[1]) / (change_n * way_mm);
    let is_along = along >= FRAC_1_SQRT_2;
    if is_along {
        Ok(())
    } else {
        Err(Trip::new(SafetyRule::AxesDiffer, along, FRAC_1_SQRT_2, "of the force sideways"))
    }
}

/// Returns the least pressing force after a drag, N: half of that before, less what the largest slope takes away.
pub(crate) fn least_after_n(force_n: f64, limits: &Limits, way_mm: f64) -> f64 {
    LEFT_SHARE * force_n - limits.stiffness_n_mm * SLOPE_MOST * way_mm
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Zero;
    use palpate_core::quantity::StageBounds;
    use proptest::prelude::*;

    const LIMITS: Limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };
    const MOST: DragLimits =
        DragLimits { shear_n: 0.8, slide_mm: 2.0, stiffness_n_mm: 1.5, friction: 1.2, softest_n_mm: None };
    const AT_1_N: DragContext = DragContext {
        force_n: 1.0,
        peak_n: 1.0,
        sigma_n: 0.0,
        side_n: [0.0; 2],
        side_sigma_n: 0.0,
        age_s: 0.01,
        depth_mm: 0.4,
    };

    fn permit(drag: Option<DragLimits>) -> Permit {
        Permit::new(LIMITS, StageBounds::fine(100.0), 0.05, &Zero::with_noise(0.003)).with_drags(drag)
    }

    fn along_x(x_mm: f64) -> Drag {
        Drag { x_mm, y_mm: 0.0, speed_mm_s: 0.5, shear_n: None, ends_at_slip: false }
    }

    fn refused(context: DragContext, x_mm: f64) -> Option<SafetyRule> {
        permit(Some(MOST)).drag(&context, &along_x(x_mm)).err().map(|trip| trip.rule)
    }

    #[test]
    fn a_drag_is_permitted_up_to_each_of_its_limits() {
        assert_eq!(permit(None).drag(&AT_1_N, &along_x(0.1)).unwrap_err().rule, SafetyRule::NotPermitted);
        assert_eq!(refused(AT_1_N, 0.52), None, "1.5 N/mm * 0.52 mm is 0.78 N, and 8 mN are by the slope");
        assert_eq!(
            refused(DragContext { side_n: [0.9, 0.0], ..AT_1_N }, 0.01),
            Some(SafetyRule::NotPermitted),
            "already"
        );
        assert_eq!(refused(AT_1_N, 0.54), Some(SafetyRule::NotPermitted));
        let slippery = permit(Some(DragLimits { friction: 0.4, ..MOST }));
        assert!(slippery.drag(&AT_1_N, &along_x(2.0)).is_ok(), "friction bounds the force sideways");
        assert!(slippery.drag(&AT_1_N, &along_x(2.01)).is_err(), "the longest way");
        let pressed = DragContext { force_n: 1.9, ..AT_1_N };
        assert!(slippery.drag(&pressed, &along_x(0.5)).is_err(), "1.99 and 0.75 N are 2.12 N");
        let relaxed = DragContext { depth_mm: 0.98, ..AT_1_N };
        assert!(slippery.drag(&relaxed, &along_x(0.5)).is_err(), "0.98 mm on a fresh spot are 1.96 N");
        assert_eq!(refused(DragContext { side_sigma_n: 0.1, ..AT_1_N }, 0.52), Some(SafetyRule::NotPermitted), "3 sd");
        assert!(slippery.drag(&AT_1_N, &along_x(0.5)).is_ok(), "1.09 and 0.55 N");
        let noisy = DragContext { sigma_n: 0.3, ..AT_1_N };
        assert!(slippery.drag(&noisy, &along_x(0.5)).is_err(), "1.99 and 0.76 N with 3 sd");
        assert_eq!(refused(DragContext { age_s: 0.3, ..AT_1_N }, 0.1), Some(SafetyRule::Stale));
        assert_eq!(refused(DragContext { depth_mm: 1.57, ..AT_1_N }, 0.1), Some(SafetyRule::NotPermitted));
        for wrong in [
            DragContext { force_n: f64::NAN, ..AT_1_N },
            DragContext { force_n: f64::NEG_INFINITY, ..AT_1_N },
            DragContext { sigma_n: f64::NAN, ..AT_1_N },
            DragContext { side_n: [f64::NAN, 0.0], ..AT_1_N },
            DragContext { side_sigma_n: f64::NAN, ..AT_1_N },
            DragContext { age_s: f64::NAN, ..AT_1_N },
            DragContext { depth_mm: f64::NAN, ..AT_1_N },
        ] {
            assert!(refused(wrong, 0.1).is_some(), "{wrong:?}");
        }
    }

    #[test]
    fn a_force_shows_how_deep_the_tip_can_be() {
        let declared = |softest_n_mm| DragLimits { friction: 0.4, softest_n_mm, ..MOST };
        let is_permitted =
            |context: DragContext, softest| permit(Some(declared(softest))).drag(&context, &along_x(0.4)).is_ok();
        let pressed = DragContext { force_n: 0.5, peak_n: 0.5, depth_mm: 1.2, ..AT_1_N };
        assert!(!is_permitted(pressed, None), "1.2 mm on a fresh spot are 2.4 N");
        assert!(is_permitted(pressed, Some(0.6)), "0.5 N are at most 0.83 mm, or 1.67 N");
        assert!(!is_permitted(pressed, Some(0.5)), "or 2 N");
        assert!(!is_permitted(DragContext { peak_n: 0.65, ..pressed }, Some(0.6)), "it came up from there");
        assert!(is_permitted(DragContext { depth_mm: 0.5, ..pressed }, Some(0.1)), "the depth is known better");
        assert!(!is_permitted(DragContext { peak_n: f64::NAN, ..pressed }, Some(0.6)));
    }

    #[test]
    fn a_drag_ends_within_the_depth_limit_after_the_largest_slope() {
        let (limits, most) = (Limits { stiffness_n_mm: 1.0, ..LIMITS }, DragLimits { friction: 0.2, ..MOST });
        let permit =
            Permit::new(limits, StageBounds::fine(100.0), 0.05, &Zero::with_noise(0.003)).with_drags(Some(most));
        let deep = DragContext { depth_mm: 1.5, ..AT_1_N };
        assert!(permit.drag(&deep, &along_x(0.5)).is_ok(), "1.5 + 0.0875 * 0.5 mm are 1.544 of 1.57 mm");
        assert!(permit.drag(&deep, &along_x(1.0)).is_err(), "1.588 mm");
    }

    proptest! {
        /// Another world: a tip on a plane of any slope up to five degrees, held by a spring that slips, walked in small steps. The
        /// specimen has relaxed where the drag begins, and nowhere else.
        #[test]
        fn no_permitted_drag_ends_over_a_limit(
            relaxed in 0.7..1.0f64, depth_mm in 0.05..1.2f64, x_mm in -2.0..2.0f64, y_mm in -2.0..2.0f64,
            slope in -0.0875..0.0875f64, kn in 0.1..1.0f64, kt in 0.1..1.0f64, mu in 0.05..1.0f64,
            softer in 0.3..1.0f64, is_declared in any::<bool>(),
        ) {
            let (cos, sin) = (1.0 / slope.hypot(1.0), slope / slope.hypot(1.0));
            let (kn, kt, mu) = (kn * LIMITS.stiffness_n_mm, kt * MOST.stiffness_n_mm, mu * MOST.friction);
            let drag = Drag { x_mm, y_mm, ..along_x(0.0) };
            let begins_n = relaxed * kn * depth_mm;
            // it relaxed on the way down too, by half as much
            let peak_n = 0.5 * (1.0 + relaxed) * kn * depth_mm * cos;
            let softest_n_mm = is_declared.then_some(softer * peak_n / depth_mm);
            let context =
                DragContext { force_n: begins_n * cos, peak_n, side_n: [begins_n * sin, 0.0], depth_mm, ..AT_1_N };
            if permit(Some(DragLimits { softest_n_mm, ..MOST })).drag(&context, &drag).is_ok() {
                let (steps, way_mm) = (200, drag.way_mm());
                let mut held_n = 0.0f64;
                for step in 1..=steps {
                    let at_mm = way_mm * f64::from(step) / f64::from(steps);
                    let normal_n = (kn * (depth_mm + slope * at_mm)).max(0.0);
                    held_n = (held_n + kt * way_mm / f64::from(steps)).min(mu * normal_n);
                    let sideways_n = (normal_n * sin + held_n * cos).abs();
                    prop_assert!(normal_n.hypot(held_n) <= LIMITS.force_n + 1e-9);
                    prop_assert!(sideways_n <= MOST.shear_n + 1e-9, "{sideways_n}");
                }
            }
        }
    }

    /// Passes forces along x to a watch, 10 ms apart.
    fn seen(watch: &mut DragWatch, forces: &[f64]) -> Result<bool, Trip> {
        let each = forces.iter().zip(0..).map(|(&x, i)| watch.see(1.0, [x, 0.0], 0.01 * f64::from(i)));
        each.collect::<Result<Vec<bool>, Trip>>().map(|reached| reached.contains(&true))
    }

    #[test]
    fn the_limit_sideways_and_slips_are_seen() {
        let mut watch = DragWatch::new(along_x(1.0), 0.5, 0.002, 0.0);
        assert_eq!(seen(&mut watch, &[0.1, 0.2, 0.3, 0.4]), Ok(false));
        assert_eq!(watch.slips(), 0);
        assert_eq!(seen(&mut watch, &[0.2, 0.2, 0.25]), Ok(false));
        assert_eq!(watch.slips(), 1, "one slip, in the means of two readings");
        assert_eq!(seen(&mut watch, &[0.6]), Ok(false), "one reading is no mean");
        assert_eq!(seen(&mut watch, &[0.6]).unwrap_err().rule, SafetyRule::OverShear);
        let ends = Drag { ends_at_slip: true, ..along_x(1.0) };
        let trip = seen(&mut DragWatch::new(ends, 0.5, 0.002, 0.0), &[0.3, 0.4, 0.2, 0.1]).unwrap_err();
        assert_eq!(trip.rule, SafetyRule::Slipped);
    }

    #[test]
    fn a_drag_ends_before_its_force_by_what_the_stop_adds() {
        let to = Drag { shear_n: Some(0.3), ..along_x(1.0) };
        let watch = |stops_after_s: f64| DragWatch::new(to, 0.5, 0.002, stops_after_s);
        assert_eq!(seen(&mut watch(0.0), &[0.0, 0.1, 0.2, 0.3]), Ok(false), "the mean is 0.25 N");
        assert_eq!(seen(&mut watch(0.005), &[0.0, 0.1, 0.2, 0.3]), Ok(true), "10 N/s for 5 ms are 0.05 N more");
    }

    #[test]
    fn an_axis_that_reads_nothing_is_found_by_drags_along_both() {
        let mut both = DragResponses::default();
        for (way, change_n) in [([0.4, 0.0], [0.3, 0.01]), ([0.3, 0.3], [0.0; 2]), ([0.0, -0.4], [0.0, -0.1])] {
            both.add(way, change_n).unwrap();
        }
        let mut dead = DragResponses::default();
        dead.add([0.4, 0.0], [0.001, 0.0]).unwrap();
        assert_eq!(dead.add([0.0, 0.4], [0.0, 0.3]).unwrap_err().rule, SafetyRule::AxesDiffer);
        let mut neither = DragResponses::default();
        neither.add([0.4, 0.0], [0.0; 2]).unwrap();
        assert!(neither.add([0.0, 0.4], [0.0; 2]).is_err());
    }

    #[test]
    fn swapped_and_mirrored_axes_are_found_by_the_first_drag() {
        let check = |after_n: [f64; 2]| check_direction([1.0, 0.1], [0.02, -0.01], after_n, 0.001).is_ok();
        assert!(check([0.5, 0.04]) && check([0.021, -0.012]), "along the drag, or too little to judge");
        assert!(!check([-0.5, -0.04]) && !check([0.04, 0.5]) && !check([f64::NAN, 0.0]));
    }
}
