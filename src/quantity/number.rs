//! Numbers as they are kept, percentiles, and seconds as a clock takes them.

use std::time::Duration;

/// To so many decimals.
pub fn round(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    let rounded = (value * scale).round() / scale;
    if !rounded.is_finite() {
        return value; // too large to have decimals
    }
    if rounded == 0.0 { 0.0 } else { rounded } // no "-0"
}

/// The value at rank q (n - 1) of sorted values, counted from 0 and interpolated linearly (definition 7 of Hyndman and Fan 1996);
/// NaN of none. Values may be infinite.
pub fn percentile(sorted: &[f64], q: f64) -> f64 {
    let rank = q * sorted.len().saturating_sub(1) as f64;
    let at = |rank: f64| sorted.get(rank as usize).copied().unwrap_or(f64::NAN);
    let (below, above) = (at(rank.floor()), at(rank.ceil()));
    if below == above { below } else { below + (above - below) * rank.fract() }
}

/// A time to wait for. What no clock can wait for is no wait.
pub fn seconds(s: f64) -> Duration {
    Duration::try_from_secs_f64(s).unwrap_or_default()
}
