//! The velocity loop alone: the largest stable gain by a separate simulation, for comparison with theory.

use palpate_core::quantity::round;
use serde::Serialize;
use std::f64::consts::{E, FRAC_PI_2};

/// True stiffness divided by the stiffness that the loop assumes.
pub(crate) const MISMATCHES: [f64; 7] = [0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0];
/// Total dead times, s.
pub(crate) const DEAD_TIMES_S: [f64; 4] = [0.015, 0.030, 0.060, 0.120];
/// Gain times dead time at which the continuous loop begins to overshoot.
pub(crate) const OVERSHOOTS_AT: f64 = 1.0 / E;
/// Gain times dead time from which the continuous loop never settles, see [`OVERSHOOTS_AT`].
pub(crate) const UNSTABLE_AT: f64 = FRAC_PI_2;

/// Step of the simulation, s. The second constant is the time from one order to the next, in steps.
const STEP_S: f64 = 0.001;
const PERIOD_STEPS: usize = 10;
/// Number of dead times that are simulated.
const LENGTH: f64 = 60.0;
/// Least overshoot that counts, as a fraction of the force.
const OVERSHOOT: f64 = 1e-4;
/// Number of halvings of the interval in which a gain is searched for.
const HALVINGS: usize = 30;

/// Gains at which the behaviour of the loop changes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Onset {
    /// "stability": distinguishes this row from other rows.
    pub part: &'static str,
    /// Total dead time, ms.
    pub dead_time_ms: f64,
    /// True stiffness divided by the assumed stiffness.
    pub mismatch: f64,
    /// Gain times dead time from which the force exceeds the set force.
    pub overshoots_at: f64,
    /// Gain times dead time from which the loop never settles.
    pub unstable_at: f64,
}

/// Computes the map: every dead time with every mismatch.
pub(crate) fn stability() -> Vec<Onset> {
    let of = |dead_time_s: f64, mismatch: f64| Onset {
        part: "stability",
        dead_time_ms: 1000.0 * dead_time_s,
        mismatch,
        overshoots_at: round(least_gain(|gain| peak(gain * mismatch, dead_time_s) > 1.0 + OVERSHOOT), 4),
        unstable_at: round(least_gain(|gain| grows(gain * mismatch, dead_time_s)), 4),
    };
    DEAD_TIMES_S.iter().flat_map(|dead_time_s| MISMATCHES.map(|mismatch| of(*dead_time_s, mismatch))).collect()
}

/// Returns the least product of gain and dead time at which `does` is true, by bisection of the logarithm.
fn least_gain(does: impl Fn(f64) -> bool) -> f64 {
    let (mut below, mut above) = (0.01, 100.0);
    for _ in 0..HALVINGS {
        let middle = f64::sqrt(below * above);
        if does(middle) { above = middle } else { below = middle }
    }
    f64::sqrt(below * above)
}

/// Returns the largest force on the way to 1, for a gain times dead time.
pub(crate) fn peak(gain: f64, dead_time_s: f64) -> f64 {
    forces(gain, dead_time_s).fold(0.0, f64::max)
}

/// Whether the force error is larger in the last fifth of the time than in the fifth before it.
fn grows(gain: f64, dead_time_s: f64) -> bool {
    let missing: Vec<f64> = forces(gain, dead_time_s).map(|force| (1.0 - force).abs()).collect();
    let most = |part: &[f64]| part.iter().copied().fold(0.0, f64::max);
    let fifth = missing.len() / 5;
    let (before, last) = (&missing[3 * fifth..4 * fifth], &missing[4 * fifth..]);
    // a diverged solution doesn't grow any more
    most(last) > most(before).max(OVERSHOOT) || most(last) > 1.0
}

/// Returns the force from 0 toward 1, step by step. F' = k v, and in every period v = gain / dead time * (1 - mean F) / k, as the
/// press calculates it. The mean is on average half a period old, and the order holds for another half. The rest of the dead time
/// is the delay between a force and its reading.
fn forces(gain: f64, dead_time_s: f64) -> impl Iterator<Item = f64> {
    let late = ((dead_time_s / STEP_S) as usize).saturating_sub(PERIOD_STEPS);
    let steps = (LENGTH * dead_time_s / STEP_S) as usize;
    let (mut past, mut rate, mut force) = (vec![0.0; late + PERIOD_STEPS], 0.0, 0.0f64);
    (0..steps).map(move |step| {
        if step % PERIOD_STEPS == 0 {
            let oldest = past.len() - late - PERIOD_STEPS;
            let mean = past[oldest..oldest + PERIOD_STEPS].iter().sum::<f64>() / PERIOD_STEPS as f64;
            rate = gain / dead_time_s * (1.0 - mean);
        }
        // a diverged solution stays diverged: its sign and size still show it
        force = (force + rate * STEP_S).clamp(-1e12, 1e12);
        past.push(force);
        force
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loop_follows_the_theory_with_frequent_commands() {
        for onset in stability().iter().filter(|onset| onset.dead_time_ms > 50.0) {
            let overshoots = onset.overshoots_at * onset.mismatch / OVERSHOOTS_AT;
            let unstable = onset.unstable_at * onset.mismatch / UNSTABLE_AT;
            assert!((0.95..1.1).contains(&overshoots), "{onset:?}: {overshoots}");
            assert!((0.95..1.1).contains(&unstable), "{onset:?}: {unstable}");
        }
    }
}
