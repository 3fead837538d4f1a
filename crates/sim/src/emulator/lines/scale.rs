//! How the numbers of a device follow what it measures, as its owner has calibrated it.

/// Numbers of a load cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellScale {
    /// N per unit of the number; negative if a push decreases it.
    pub newton_per_unit: f64,
    /// Number without force.
    pub offset: f64,
}

impl CellScale {
    /// Numbers in N.
    pub const NEWTON: CellScale = CellScale { newton_per_unit: 1.0, offset: 0.0 };

    /// Returns the number of a force.
    pub fn number(&self, force_n: f64) -> f64 {
        let number = force_n / self.newton_per_unit;
        // an offset of 0 would turn -0 into 0
        if self.offset == 0.0 { number } else { number + self.offset }
    }
}

/// Returns the change of an array's number for one reading unit, if the rig multiplies it by `scale`: so the rig's outputs stay
/// what they are with a scale of `own_scale`. It stays within what the converter resolves and reaches: a quarter and four times
/// that of the device as delivered.
pub(super) fn per_unit(delivered: f64, own_scale: f64, scale: f64) -> f64 {
    let factor = own_scale / scale;
    delivered * factor.signum() * factor.abs().clamp(0.25, 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_the_inverse_of_what_the_rig_states() {
        let scale = CellScale { newton_per_unit: -0.5, offset: 10.0 };
        assert_eq!([0.0, 1.0, -2.0].map(|force_n| scale.number(force_n)), [10.0, 8.0, 14.0]);
        assert!(CellScale::NEWTON.number(-0.0).is_sign_negative());
    }

    #[test]
    fn outputs_of_the_rig_stay_the_same_as_far_as_the_converter_reaches() {
        for (scale, expected) in [(1.0, 100.0), (2.0, 50.0), (0.5, 200.0), (-1.0, -100.0), (1e-3, 400.0), (-1e3, -25.0)]
        {
            assert_eq!(per_unit(100.0, 1.0, scale), expected, "{scale}");
        }
    }
}
