//! Steps of the axes of a coarse stage.

use super::Axis;
use std::f64::consts::SQRT_2;

/// Largest distance of a read-back from the axis' target, mm, on a stage whose steps are fine.
const IN_POSITION_MM: f64 = 0.003;

/// Smallest step that is commanded, mm: a stage whose steps are fine goes to within half of it.
pub const FINEST_STEP_MM: f64 = 0.000_1;

/// Noise of a motion that counts as in position, in sd of a read-back: 5 sd of the read-backs from which it began and after which it ended,
/// together. Of ten thousand motions none ends elsewhere by it.
const NOISE_SIGMAS: f64 = 5.0 * SQRT_2;

/// Distance that is rounding of a number, mm. It is less than the rounding that a permit allows.
const ROUNDING_MM: f64 = 5e-10;

/// Smallest step of each axis, mm; zero for a stage whose steps are too fine to matter.
///
/// A stage goes to the step nearest to its target and reads back in whole steps. So a motion ends within half a step of its target.
/// Where the steps lie is not known: they are counted from the position that was read back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steps {
    /// Step of x, y and z, mm.
    pub mm: [f64; 3],
    /// Standard deviation of a position that is read back at rest, mm.
    pub noise_mm: f64,
}

impl Steps {
    /// Steps too fine to matter.
    pub const FINE: Steps = Steps { mm: [0.0; 3], noise_mm: 0.0 };

    /// Whether no axis has steps that matter.
    pub fn is_fine(&self) -> bool {
        *self == Steps::FINE
    }

    /// Step of an axis, mm.
    pub fn along(&self, axis: Axis) -> f64 {
        self.mm[axis.index()]
    }

    /// Least distance by which z is moved, mm: its step, or the smallest one that is commanded.
    pub fn least_z_mm(&self) -> f64 {
        self.along(Axis::Z).max(FINEST_STEP_MM)
    }

    /// Largest distance of a read-back from the axis' target, mm.
    pub fn in_position_mm(&self, axis: Axis) -> f64 {
        IN_POSITION_MM + self.along(axis) / 2.0 + NOISE_SIGMAS * self.noise_mm
    }

    /// Largest distance of two read-backs of an axis at rest, mm: each is that near to where it rests.
    pub fn at_rest_mm(&self, axis: Axis) -> f64 {
        2.0 * self.in_position_mm(axis)
    }

    /// Distance by which z may end deeper than its target, added to the possible error of its read-back, mm. Zero on a fine stage.
    pub fn reserve_mm(&self) -> f64 {
        let step_mm = self.along(Axis::Z);
        if step_mm > 0.0 { self.in_position_mm(Axis::Z) + step_mm / 2.0 } else { 0.0 }
    }

    /// Returns the deepest z in whole steps from `from_mm` that isn't deeper than `wanted_mm`, mm.
    pub fn no_deeper_mm(&self, from_mm: f64, wanted_mm: f64) -> f64 {
        let step_mm = self.along(Axis::Z);
        if step_mm > 0.0 {
            from_mm + ((wanted_mm - from_mm + ROUNDING_MM) / step_mm).floor() * step_mm
        } else {
            wanted_mm
        }
    }

    /// Returns the distance of z in whole steps that is nearest to `way_mm`, mm.
    pub fn nearest_mm(&self, way_mm: f64) -> f64 {
        let step_mm = self.along(Axis::Z);
        if step_mm > 0.0 { (way_mm / step_mm).round() * step_mm } else { way_mm }
    }

    /// Returns the force that can be reached to within, N, on a specimen of this stiffness: half a step of z. Zero on a fine stage.
    pub fn reach_n(&self, stiffness_n_mm: f64) -> f64 {
        stiffness_n_mm * self.along(Axis::Z) / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::stream;
    use rand::RngExt;
    use std::f64::consts::TAU;

    const PRINTER: Steps = Steps { mm: [0.0125, 0.0125, 0.0025], noise_mm: 0.0 };

    #[test]
    fn noise_of_a_read_back_counts_as_in_position_and_in_the_reserve() {
        let arm = Steps { mm: [0.05, 0.05, 0.02], noise_mm: 0.004 };
        let noise_mm = 5.0 * 2f64.sqrt() * 0.004;
        assert!((arm.in_position_mm(Axis::Z) - (0.013 + noise_mm)).abs() < 1e-12);
        assert!((arm.reserve_mm() - (0.023 + noise_mm)).abs() < 1e-12);
    }

    #[test]
    fn noise_of_both_ends_of_a_motion_is_in_position() {
        const MOTIONS: usize = 20_000;
        let arm = Steps { mm: [0.0; 3], noise_mm: 0.004 };
        let mut rng = stream(1, 0, "both ends of a motion");
        // two normal numbers at once (Box and Muller)
        let mut off_mm = || {
            let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
            let (sin, cos) = (TAU * v).sin_cos();
            arm.noise_mm * (-2.0 * u.ln()).sqrt() * (sin + cos).abs()
        };
        let off_mm = (0..MOTIONS).map(|_| off_mm()).fold(0.0, f64::max);
        assert!(off_mm < arm.in_position_mm(Axis::Z) - IN_POSITION_MM, "{off_mm} mm");
        assert!(off_mm > 5.0 * arm.noise_mm, "the noise of one end doesn't explain it");
    }

    #[test]
    fn fine_stage_is_not_rounded_to_steps() {
        assert_eq!(Steps::FINE.in_position_mm(Axis::Z), 0.003);
        assert_eq!((Steps::FINE.reserve_mm(), Steps::FINE.reach_n(2.0)), (0.0, 0.0));
        assert_eq!((Steps::FINE.least_z_mm(), PRINTER.least_z_mm()), (0.0001, 0.0025));
        assert_eq!((Steps::FINE.no_deeper_mm(0.1, 0.2341), Steps::FINE.nearest_mm(0.0007)), (0.2341, 0.0007));
    }

    #[test]
    fn whole_steps_are_counted_from_where_z_is_and_never_go_deeper_than_wanted() {
        assert!((PRINTER.no_deeper_mm(0.0013, 0.008_799_99) - 0.0063).abs() < 1e-12);
        assert!((PRINTER.no_deeper_mm(0.0013, 0.0088) - 0.0088).abs() < 1e-12, "a whole number of steps is kept");
        assert!((PRINTER.no_deeper_mm(0.0, -0.001) + 0.0025).abs() < 1e-12, "away is rounded farther away");
        assert_eq!((PRINTER.nearest_mm(0.0012), PRINTER.nearest_mm(0.0013)), (0.0, 0.0025));
        assert!((PRINTER.in_position_mm(Axis::X) - 0.009_25).abs() < 1e-12);
        assert!((PRINTER.reserve_mm() - 0.0055).abs() < 1e-12 && (PRINTER.reach_n(2.0) - 0.0025).abs() < 1e-12);
    }
}
