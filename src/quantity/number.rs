//! Numbers as they are kept, and seconds as a clock takes them.

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

/// A time to wait for. What no clock can wait for is no wait.
pub fn seconds(s: f64) -> Duration {
    Duration::try_from_secs_f64(s).unwrap_or_default()
}
