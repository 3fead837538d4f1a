//! How fast the rig may approach by how fast it reacts.

/// How long the rig takes from a force to a stage that brakes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reaction {
    /// From one conversion of the load cell to the next, s.
    pub conversion_s: f64,
    /// Longest reading of the load cell seen, s.
    pub load_cell_s: f64,
    /// Longest exchange with the stage seen, s.
    pub stage_s: f64,
    /// How long the load cell's filters and its transport hold a force back, s.
    pub lag_s: f64,
}

/// How fast the parts of a press follow each other on a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Longest exchange with the stage seen, s.
    pub exchange_s: f64,
    /// From the end of a motion as its controller says it to a force that can be read: the stage settles, the cell follows, s.
    pub settle_s: f64,
    /// How long the cell's filter holds a force back, s; a part of `settle_s`.
    pub lag_s: f64,
    /// From one conversion of the load cell to the next, s.
    pub conversion_s: f64,
    /// Acceleration of the stage, mm/s^2.
    pub acceleration_mm_s2: f64,
    /// From a force to a stage that moves otherwise, at worst, s.
    pub reaction_s: f64,
}

impl Reaction {
    /// Servo lag and the rounding of the speed profile before a stage brakes, s.
    const SERVO_S: f64 = 0.010;
    /// What the longest exchange seen in a few is multiplied with, for the longest there is.
    const MARGIN: f64 = 1.5;

    /// The time between a force and the beginning of the braking, at worst, s.
    pub fn worst_s(&self) -> f64 {
        self.conversion_s + self.lag_s + Self::MARGIN * (self.load_cell_s + self.stage_s) + Self::SERVO_S
    }
}

/// The fastest approach that stays within a force when it hits a stiffness unannounced, mm/s:
/// `a (-T + sqrt(T^2 + 2 F / (k a)))`, from `F = k (v T + v^2 / 2a)`: the way of the reaction and that of the braking.
pub fn safe_speed_mm_s(force_n: f64, stiffness_n_mm: f64, reaction_s: f64, acceleration_mm_s2: f64) -> f64 {
    let (t, a) = (reaction_s, acceleration_mm_s2);
    let braking = 2.0 * force_n.max(0.0) / (stiffness_n_mm * a);
    a * ((t * t + braking).sqrt() - t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_uses_the_force_up_and_no_more() {
        for (force_n, k, t) in [(0.2, 2.0, 0.03), (2.0, 20.0, 0.0336), (0.05, 500.0, 0.0186)] {
            let v = safe_speed_mm_s(force_n, k, t, 100.0);
            assert!((k * (v * t + v * v / 200.0) - force_n).abs() < 1e-12);
        }
        assert_eq!(safe_speed_mm_s(-1.0, 2.0, 0.03, 100.0), 0.0);
    }

    #[test]
    fn it_agrees_with_the_study() {
        // ESP301, T = 33.6 ms, limit 2.0 N less detection at 30 mN and 3 sigma: 13.4 mm/s at 1.33 N/mm (k_i = 1.1 k), 0.10 at 500
        assert!((safe_speed_mm_s(1.96, 1.33 * 1.1, 0.0336, 100.0) - 13.4).abs() < 0.2);
        assert!((safe_speed_mm_s(1.96, 550.0, 0.0336, 100.0) - 0.10).abs() < 0.01);
    }
}
