//! Largest approach speed that the reaction time of the rig allows.

/// Time between a force and the braking of the stage, in parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reaction {
    /// Time between two conversions of the load cell, s.
    pub conversion_s: f64,
    /// Longest observed reading of the load cell, s.
    pub load_cell_s: f64,
    /// Longest observed exchange with the stage, s.
    pub stage_s: f64,
    /// Delay of a force by the load cell's filters and its transport, s.
    pub lag_s: f64,
}

/// Timing of the parts of a press on a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Longest observed exchange with the stage, s.
    pub exchange_s: f64,
    /// Time from the end of a motion as its controller reports it until the force can be read, s. The stage settles and the cell
    /// follows.
    pub settle_s: f64,
    /// Delay of a force by the cell's filter, s; a part of `settle_s`.
    pub lag_s: f64,
    /// Time between two conversions of the load cell, s.
    pub conversion_s: f64,
    /// Acceleration of the stage, mm/s^2.
    pub acceleration_mm_s2: f64,
    /// Longest time from a force until the stage changes its motion, s.
    pub reaction_s: f64,
}

impl Reaction {
    /// Servo lag and rounding of the speed profile before a stage brakes, s.
    const SERVO_S: f64 = 0.010;
    /// Factor that estimates the longest possible exchange from the longest of a few exchanges.
    const MARGIN: f64 = 1.5;

    /// Longest time between a force and the beginning of the braking, s.
    pub fn worst_s(&self) -> f64 {
        self.conversion_s + self.lag_s + Self::MARGIN * (self.load_cell_s + self.stage_s) + Self::SERVO_S
    }
}

/// Returns the fastest approach, mm/s, that stays within a force when it meets a stiffness unexpectedly: `a (-T + sqrt(T^2 + 2 F
/// / (k a)))`, from `F = k (v T + v^2 / 2a)`. The two terms are the reaction distance and the braking distance.
pub fn safe_speed_mm_s(force_n: f64, stiffness_n_mm: f64, reaction_s: f64, acceleration_mm_s2: f64) -> f64 {
    let (t, a) = (reaction_s, acceleration_mm_s2);
    let braking = 2.0 * force_n.max(0.0) / (stiffness_n_mm * a);
    a * ((t * t + braking).sqrt() - t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fastest_speed_uses_exactly_the_available_force() {
        for (force_n, k, t) in [(0.2, 2.0, 0.03), (2.0, 20.0, 0.0336), (0.05, 500.0, 0.0186)] {
            let v = safe_speed_mm_s(force_n, k, t, 100.0);
            assert!((k * (v * t + v * v / 200.0) - force_n).abs() < 1e-12);
        }
        assert_eq!(safe_speed_mm_s(-1.0, 2.0, 0.03, 100.0), 0.0);
    }

    #[test]
    fn fastest_speed_agrees_with_the_study() {
        // ESP301, T = 33.6 ms, limit 2.0 N less detection at 30 mN and 3 sigma: 13.4 mm/s at 1.33 N/mm (k_i = 1.1 k), 0.10 at 500
        assert!((safe_speed_mm_s(1.96, 1.33 * 1.1, 0.0336, 100.0) - 13.4).abs() < 0.2);
        assert!((safe_speed_mm_s(1.96, 550.0, 0.0336, 100.0) - 0.10).abs() < 0.01);
    }
}
