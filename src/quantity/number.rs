//! Numbers as stored, percentiles, and seconds as used by a clock.

use std::time::Duration;

/// Rounds to this number of decimals.
pub fn round(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    let rounded = (value * scale).round() / scale;
    if !rounded.is_finite() {
        return value; // too large to have decimals
    }
    if rounded == 0.0 { 0.0 } else { rounded } // no "-0"
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
