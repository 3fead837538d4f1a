//! Numbers as stored, percentiles, and seconds as used by a clock.

use std::time::Duration;

/// Rounds to this number of decimals.
// inlined, so that the power of a constant is one too
#[inline]
pub fn round(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    let rounded = nearest(value * scale) / scale;
    if !rounded.is_finite() {
        return value; // too large to have decimals
    }
    if rounded == 0.0 { 0.0 } else { rounded } // no "-0"
}

/// Returns bytes as hexadecimal digits, two each.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the nearest integer, half away from 0, like `f64::round`. That function is a call into the system's library on
/// processors of 2003, for which programs are compiled.
#[inline]
fn nearest(value: f64) -> f64 {
    /// From here on all numbers are integers.
    const INTEGERS: f64 = (1_u64 << 52) as f64;
    if value.abs() < INTEGERS {
        let whole = (value as i64) as f64;
        let part = value - whole; // exact, and so is twice as much
        // without a branch, which no processor could predict
        whole + f64::from((part + part) as i32)
    } else {
        value.round()
    }
}

/// Returns the value at rank q (n - 1) of sorted values, counted from 0 and interpolated linearly (definition 7 of Hyndman and
/// Fan 1996); NaN if there are no values. Values may be infinite.
pub fn percentile(sorted: &[f64], q: f64) -> f64 {
    let rank = q * sorted.len().saturating_sub(1) as f64;
    let at = |rank: f64| sorted.get(rank as usize).copied().unwrap_or(f64::NAN);
    let (below, above) = (at(rank.floor()), at(rank.ceil()));
    if below == above { below } else { below + (above - below) * rank.fract() }
}

/// Returns a time to wait for; zero if no clock can wait for it.
pub fn seconds(s: f64) -> Duration {
    Duration::try_from_secs_f64(s).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn assert_as_the_systems(value: f64) {
        let (ours, systems) = (nearest(value), value.round());
        assert!(ours == systems || (ours.is_nan() && systems.is_nan()), "{value:?}: {ours:?}, {systems:?}");
    }

    #[test]
    fn halves_and_limits_are_rounded_as_by_the_systems_function() {
        let large = (1_u64 << 52) as f64;
        for value in [0.0, 0.49999999999999994, 0.5, 1.5, 2.5, large - 0.5, large - 1.5, large, 1e300, f64::INFINITY] {
            [value, -value, value.next_up(), value.next_down()].into_iter().for_each(assert_as_the_systems);
        }
        assert_as_the_systems(f64::NAN);
        assert_eq!((round(-0.000_000_4, 6).to_bits(), round(1e300, 6)), (0, 1e300));
    }

    proptest! {
        #[test]
        fn any_number_is_rounded_as_by_the_systems_function(value in prop::num::f64::ANY, small in -1e7..1e7f64) {
            assert_as_the_systems(value);
            assert_as_the_systems(small);
            assert_as_the_systems((small * 2.0).trunc() / 2.0);
        }
    }
}
