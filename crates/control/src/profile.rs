//! A motion from rest to rest as planned by a controller.

/// A motion from rest to rest as planned by a controller: a trapezoid of speed, or a triangle if the distance is short.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionProfile {
    way_mm: f64,
    peak_mm_s: f64,
    acceleration_mm_s2: f64,
}

impl MotionProfile {
    /// Creates the profile for a distance (its sign doesn't matter), a maximum speed, and one acceleration for speeding up and
    /// braking.
    pub fn new(way_mm: f64, speed_mm_s: f64, acceleration_mm_s2: f64) -> Self {
        let way_mm = way_mm.abs();
        let summit_mm_s = (way_mm * acceleration_mm_s2).sqrt();
        MotionProfile { way_mm, peak_mm_s: summit_mm_s.min(speed_mm_s), acceleration_mm_s2 }
    }

    /// Duration of the motion, s.
    pub fn duration_s(&self) -> f64 {
        if self.peak_mm_s <= 0.0 {
            return 0.0;
        }
        self.way_mm / self.peak_mm_s + self.peak_mm_s / self.acceleration_mm_s2
    }

    /// Distance covered after a time, mm.
    pub fn at_mm(&self, after_s: f64) -> f64 {
        let (v, a, whole_s) = (self.peak_mm_s, self.acceleration_mm_s2, self.duration_s());
        let ramp_s = v / a;
        if after_s <= 0.0 {
            0.0
        } else if after_s < ramp_s {
            a * after_s * after_s / 2.0
        } else if after_s < whole_s - ramp_s {
            v * (after_s - ramp_s / 2.0)
        } else {
            self.way_mm - a * (whole_s - after_s).max(0.0).powi(2) / 2.0
        }
    }

    /// Time at which the motion has covered a distance, s.
    pub fn reaches_s(&self, mm: f64) -> f64 {
        let (v, a) = (self.peak_mm_s, self.acceleration_mm_s2);
        let ramp_mm = v * v / (2.0 * a);
        let mm = mm.clamp(0.0, self.way_mm);
        if mm < ramp_mm {
            (2.0 * mm / a).sqrt()
        } else if mm < self.way_mm - ramp_mm {
            v / a + (mm - ramp_mm) / v
        } else {
            self.duration_s() - (2.0 * (self.way_mm - mm) / a).sqrt()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn short_motion_is_a_triangle_and_long_one_cruises() {
        assert!((MotionProfile::new(-0.25, 25.0, 100.0).duration_s() - 0.1).abs() < 1e-12);
        assert!((MotionProfile::new(10.0, 5.0, 100.0).duration_s() - 2.05).abs() < 1e-12);
        assert_eq!(MotionProfile::new(0.0, 5.0, 100.0).duration_s(), 0.0);
    }

    proptest! {
        #[test]
        fn time_and_place_of_a_profile_are_inverse(way in 0.001..20.0f64, speed in 0.1..25.0f64, share in 0.0..1.0f64) {
            let profile = MotionProfile::new(way, speed, 100.0);
            let mm = share * way;
            prop_assert!((profile.at_mm(profile.reaches_s(mm)) - mm).abs() < 1e-9);
            prop_assert!((profile.at_mm(profile.duration_s() + 1.0) - way).abs() < 1e-12);
        }
    }
}
