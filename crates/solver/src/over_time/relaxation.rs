//! Time constants of values that are held at rest: `final + sum of amplitude exp(-t / time)`, with at most two terms.

use super::exponentials::{Bin, Fit, TERMS_MOST, row};
use super::{LeastSquares, OverTimeError, interval_sigmas};
use serde::Serialize;

/// Least number of readings.
const READINGS_LEAST: usize = 10;

/// A time constant is determined if its interval is narrower than this factor, and it is at least so many intervals of
/// reading.
const FACTOR_MOST: f64 = 3.0;
const INTERVALS_LEAST: f64 = 2.0;

/// Time constants are searched up to so many spans, because what is slower looks like a straight line.
const SPANS_MOST: f64 = 10.0;

/// How values at rest change over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Relaxation {
    /// Value that the terms approach. With `undetermined` it is the value at the last reading, without the terms below:
    /// what is slower ends at an unknown value.
    pub final_value: f64,
    /// Determined terms, sorted by time.
    pub terms: Vec<Term>,
    /// Whether the values also change with a time constant that isn't determined and is left out: it is longer than the
    /// span, shorter than two intervals of reading, or too near another one for the noise.
    pub undetermined: bool,
    /// Standard deviation of one reading about all terms, also those that are left out.
    pub residual_sd: f64,
    /// Number of readings.
    pub readings: usize,
    /// Time from the first to the last reading, s.
    pub span_s: f64,
}

/// One exponential.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Term {
    /// Value at the first reading, in the unit of the values.
    pub amplitude: f64,
    /// Its standard uncertainty.
    pub amplitude_u: f64,
    /// Time constant, s.
    pub time_s: f64,
    /// Its 95 % interval, s.
    pub time_interval_s: [f64; 2],
}

/// A term that is expected before it is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedTerm {
    /// Value at the first reading, in the unit of the values.
    pub amplitude: f64,
    /// Time constant, s.
    pub time_s: f64,
}

/// Estimates the time constants of values held at rest, with 0, 1 or 2 terms. `t_s` has the time of each of `values`,
/// s, and increases. Amplitudes count from the first reading.
///
/// The readings' noise should be white: noise with a memory longer than a bin looks like a term.
///
/// # Errors
/// There are fewer than 10 readings, not one value for each time, a number that isn't finite, or times that don't
/// increase.
pub fn relaxation(t_s: &[f64], values: &[f64]) -> Result<Relaxation, OverTimeError> {
    check(t_s, values)?;
    let span_s = t_s[t_s.len() - 1] - t_s[0];
    let interval_s = interval_s(t_s);
    let bins = Bin::all(t_s, values, interval_s);
    let fit = Fit::of(&bins, [interval_s.ln(), (SPANS_MOST * span_s).ln()]).ok_or(OverTimeError::Singular)?;
    let solved = fit.equations(&bins).solve();
    let freedom = fit.freedom(bins.len());
    // from the bins: noise with a short memory widens the interval, as it should
    let (sigmas, sd) = (interval_sigmas(freedom as f64), (fit.squares / freedom as f64).sqrt());
    let term = |i: usize| {
        let u = |parameter: usize| solved.map_or(f64::INFINITY, |[_, variances]| sd * variances[parameter].sqrt());
        let [amplitude_u, log_u] = [u(1 + i), u(1 + TERMS_MOST + i)];
        let [time_s, factor] = [fit.log_times_s[i].exp(), (sigmas * log_u).exp()];
        let time_interval_s = [time_s / factor, time_s * factor];
        Term { amplitude: fit.linear[1 + i], amplitude_u, time_s, time_interval_s }
    };
    let (mut terms, left_out): (Vec<Term>, Vec<Term>) = (0..fit.log_times_s.len()).map(term).partition(|term| {
        let [from_s, to_s] = term.time_interval_s;
        to_s < FACTOR_MOST * from_s && (INTERVALS_LEAST * interval_s..=span_s).contains(&term.time_s)
    });
    terms.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let squares: f64 =
        t_s.iter().zip(values).map(|(t, value)| fit.residual(&Bin::at(t - t_s[0], *value)).powi(2)).sum();
    Ok(Relaxation {
        final_value: fit.linear[0]
            + left_out.iter().map(|term| term.amplitude * (-span_s / term.time_s).exp()).sum::<f64>(),
        terms,
        undetermined: !left_out.is_empty(),
        residual_sd: (squares / fit.freedom(t_s.len()) as f64).sqrt(),
        readings: t_s.len(),
        span_s,
    })
}

/// Returns the least relative sd of each time constant that readings at the times `t_s`, s, can reach (Cramer-Rao).
/// `sigma` is the sd of one reading, in the unit of the amplitudes. The result has one number for each of `terms`. They
/// are infinite where the plan determines nothing, and for more than two terms, which aren't distinguished.
pub fn relaxation_bound(t_s: &[f64], sigma: f64, terms: &[PlannedTerm]) -> Vec<f64> {
    let unknown = vec![f64::INFINITY; terms.len()];
    if terms.len() > TERMS_MOST || t_s.is_empty() {
        return unknown;
    }
    let log_times_s: Vec<f64> = terms.iter().map(|term| term.time_s.ln()).collect();
    let mut linear = [0.0; 1 + TERMS_MOST];
    linear[1..].iter_mut().zip(terms).for_each(|(amplitude, term)| *amplitude = term.amplitude);
    let rows = t_s.iter().map(|t| (row(&Bin::at(t - t_s[0], 0.0), &log_times_s, &linear), 0.0, 1.0));
    let Some([_, variances]) = LeastSquares::of(rows).solve() else { return unknown };
    let sds = variances[1 + TERMS_MOST..].iter().map(|variance| sigma * variance.sqrt());
    sds.zip(terms).map(|(sd, term)| if term.amplitude == 0.0 { f64::INFINITY } else { sd }).collect()
}

fn check(t_s: &[f64], values: &[f64]) -> Result<(), OverTimeError> {
    if t_s.len() < READINGS_LEAST {
        return Err(OverTimeError::TooFew { readings: t_s.len(), needed: READINGS_LEAST });
    }
    let is_finite = |of: &[f64], i: usize| of.get(i).is_some_and(|number| number.is_finite());
    let is_sound = |i: usize| is_finite(t_s, i) && is_finite(values, i) && (i == 0 || t_s[i] > t_s[i - 1]);
    let wrong = (0..t_s.len().max(values.len())).find(|i| !is_sound(*i));
    wrong.map_or(Ok(()), |reading| Err(OverTimeError::Reading { reading }))
}

/// Usual time between two readings, s.
fn interval_s(t_s: &[f64]) -> f64 {
    let mut gaps: Vec<f64> = t_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    gaps[gaps.len() / 2]
}
