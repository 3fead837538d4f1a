//! Time constants of values that are held at rest: `final + sum of amplitude exp(-t / time)`, with at most two terms.
//!
//! The readings are averaged in bins of log time. For given times the amplitudes follow by linear least squares, so only the logs of the
//! times are searched (variable projection): from a grid of starts, by damped steps of Gauss and Newton. An F-test decides whether
//! another term is there.

use super::{LeastSquares, OverTimeError, by_chance, interval_sigmas};
use serde::Serialize;

/// Most terms that are distinguished, and the parameters then: the final value, amplitudes, and logs of the times.
const TERMS_MOST: usize = 2;
const PARAMETERS: usize = 1 + 2 * TERMS_MOST;

/// Least number of readings.
const READINGS_LEAST: usize = 10;

/// Most bins. So narrow bins lose no information.
const BINS_MOST: usize = 300;

/// A term is there if noise lowers the sum of squares as much with this probability. It is for one time constant that is known
/// beforehand; the search finds the best of many, which is about ten times as probable.
const CHANCE: f64 = 1e-3;

/// A time constant is determined if its interval is narrower than this factor, and it is at least so many intervals of reading.
const FACTOR_MOST: f64 = 3.0;
const INTERVALS_LEAST: f64 = 2.0;

/// Time constants are searched up to so many spans, because what is slower looks like a straight line.
const SPANS_MOST: f64 = 10.0;

/// Number of times in the grid of starts. Of two terms the best start of each ratio is refined, because times that merge have a
/// minimum of their own.
const GRID: usize = 12;

/// Most steps from a start. The search ends when the log of each time changes by less than `STEP_LEAST`, or the damping has grown so
/// much that no step improves the fit.
const STEPS_MOST: usize = 60;
const STEP_LEAST: f64 = 1e-7;
const DAMPING_MOST: f64 = 1e6;

/// Rounding error relative to the largest value. A lower sum of squares than its own shows nothing.
const ROUNDING: f64 = 1e-12;

/// How values at rest change over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Relaxation {
    /// Value that the terms approach. With `undetermined` it is the value at the last reading, without the terms below: what is slower
    /// ends at an unknown value.
    pub final_value: f64,
    /// Determined terms, sorted by time.
    pub terms: Vec<Term>,
    /// Whether the values also change with a time constant that isn't determined and is left out: it is longer than the span, shorter
    /// than two intervals of reading, or too near another one for the noise.
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

/// Estimates the time constants of values held at rest, with 0, 1 or 2 terms. `t_s` has the time of each of `values`, s, and
/// increases. Amplitudes count from the first reading.
///
/// The readings' noise should be white: noise with a memory longer than a bin looks like a term.
///
/// # Errors
/// There are fewer than 10 readings, not one value for each time, a number that isn't finite, or times that don't increase.
pub fn relaxation(t_s: &[f64], values: &[f64]) -> Result<Relaxation, OverTimeError> {
    check(t_s, values)?;
    let span_s = t_s[t_s.len() - 1] - t_s[0];
    let interval_s = interval_s(t_s);
    let bins = bins(t_s, values, interval_s);
    let (fit, variances) = fit(&bins, [interval_s.ln(), (SPANS_MOST * span_s).ln()]);
    let freedom = bins.len().saturating_sub(fit.parameters());
    // from the bins: noise with a short memory widens the interval, as it should
    let (sigmas, sd) = (interval_sigmas(freedom), (fit.squares / freedom as f64).sqrt());
    let term = |i: usize| {
        let [amplitude_u, log_u] = [1 + i, 1 + TERMS_MOST + i].map(|parameter| sd * variances[parameter].sqrt());
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
        residual_sd: (squares / (t_s.len() - fit.parameters()) as f64).sqrt(),
        readings: t_s.len(),
        span_s,
    })
}

/// Returns the least relative sd of each time constant that readings at the times `t_s`, s, can reach (Cramer-Rao). `sigma` is the sd of
/// one reading, in the unit of the amplitudes. The result has one number for each of `terms`. They are infinite where the plan determines
/// nothing, and for more than two terms, which aren't distinguished.
pub fn relaxation_bound(t_s: &[f64], sigma: f64, terms: &[PlannedTerm]) -> Vec<f64> {
    let unknown = vec![f64::INFINITY; terms.len()];
    if terms.len() > TERMS_MOST || t_s.is_empty() {
        return unknown;
    }
    let log_times_s: Vec<f64> = terms.iter().map(|term| term.time_s.ln()).collect();
    let mut linear = [0.0; 1 + TERMS_MOST];
    linear[1..].iter_mut().zip(terms).for_each(|(amplitude, term)| *amplitude = term.amplitude);
    let rows = t_s.iter().map(|t| (row(&Bin::at(t - t_s[0], 0.0), &log_times_s, &linear), 0.0, 1.0));
    let is_there = |i: usize| terms[i].amplitude != 0.0;
    let Some(variances) = LeastSquares::of(rows).variances() else { return unknown };
    let sd = |i: usize| if is_there(i) { sigma * variances[1 + TERMS_MOST + i].sqrt() } else { f64::INFINITY };
    (0..terms.len()).map(sd).collect()
}

fn check(t_s: &[f64], values: &[f64]) -> Result<(), OverTimeError> {
    if t_s.len() != values.len() {
        return Err(OverTimeError::Lengths { times: t_s.len(), values: values.len() });
    }
    if t_s.len() < READINGS_LEAST {
        return Err(OverTimeError::TooFew { readings: t_s.len(), needed: READINGS_LEAST });
    }
    if let Some(reading) = t_s.iter().zip(values).position(|(t, value)| !t.is_finite() || !value.is_finite()) {
        return Err(OverTimeError::NotFinite { reading });
    }
    match t_s.windows(2).position(|pair| pair[1] <= pair[0]) {
        Some(before) => Err(OverTimeError::Order { reading: before + 1 }),
        None => Ok(()),
    }
}

/// Usual time between two readings, s.
fn interval_s(t_s: &[f64]) -> f64 {
    let mut gaps: Vec<f64> = t_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    gaps[gaps.len() / 2]
}

/// Mean of readings that follow each other.
struct Bin {
    /// Mean of the times from the first reading, s, and their variance.
    t_s: f64,
    variance_s2: f64,
    value: f64,
    count: f64,
}

impl Bin {
    /// A single reading.
    fn at(t_s: f64, value: f64) -> Bin {
        Bin { t_s, variance_s2: 0.0, value, count: 1.0 }
    }

    fn of(readings: &[Bin]) -> Bin {
        let count = readings.len() as f64;
        let mean = |of: &dyn Fn(&Bin) -> f64| readings.iter().map(of).sum::<f64>() / count;
        let t_s = mean(&|reading| reading.t_s);
        let variance_s2 = mean(&|reading| (reading.t_s - t_s).powi(2));
        Bin { t_s, variance_s2, value: mean(&|reading| reading.value), count }
    }

    /// Returns the mean of `exp(-t / time)` over the bin, and its derivative by the log of the time. A mean exceeds the value at the mean
    /// time by the curvature; with it the bins cause no bias.
    fn exponential(&self, log_time_s: f64) -> [f64; 2] {
        let rate = (-log_time_s).exp();
        let (x, bent) = (self.t_s * rate, self.variance_s2 * rate * rate);
        let value = (-x).exp();
        [value * (1.0 + 0.5 * bent), value * (x * (1.0 + 0.5 * bent) - bent)]
    }
}

/// Averages readings in bins that are equally wide in log time; the first ones have one reading.
fn bins(t_s: &[f64], values: &[f64], interval_s: f64) -> Vec<Bin> {
    let readings: Vec<Bin> = t_s.iter().zip(values).map(|(t, value)| Bin::at(t - t_s[0], *value)).collect();
    if readings.len() <= BINS_MOST {
        return readings;
    }
    let log = |reading: &Bin| (reading.t_s / interval_s).ln_1p();
    let width = log(&readings[readings.len() - 1]) / BINS_MOST as f64;
    let bin = |reading: &Bin| (log(reading) / width).floor();
    readings.chunk_by(|a, b| bin(a) == bin(b)).map(Bin::of).collect()
}

/// Best fit for some time constants.
#[derive(Clone)]
struct Fit {
    log_times_s: Vec<f64>,
    /// Final value and amplitudes.
    linear: [f64; 1 + TERMS_MOST],
    /// Sum of the squared residuals of the bins, each times its count.
    squares: f64,
}

impl Fit {
    /// `None` if the times can't be distinguished.
    fn at(bins: &[Bin], log_times_s: Vec<f64>) -> Option<Fit> {
        let rows = bins.iter().map(|bin| (row(bin, &log_times_s, &[0.0; 1 + TERMS_MOST]), bin.value, bin.count));
        let [final_value, first, second, ..] = LeastSquares::of(rows).solve()?;
        let mut fit = Fit { log_times_s, linear: [final_value, first, second], squares: 0.0 };
        fit.squares = bins.iter().map(|bin| bin.count * fit.residual(bin).powi(2)).sum();
        Some(fit)
    }

    /// The best fit with so many terms, from a grid of starts. `range` has the logs of the shortest and longest time, s.
    fn best(bins: &[Bin], terms: usize, range: [f64; 2]) -> Option<Fit> {
        let [from, to] = range;
        let grid: Vec<f64> = (0..GRID).map(|i| from + (to - from) * i as f64 / (GRID - 1) as f64).collect();
        let at = |times: &[usize]| Fit::at(bins, times.iter().map(|&i| grid[i]).collect());
        let least = |a: &Fit, b: &Fit| a.squares.total_cmp(&b.squares);
        let starts: Vec<Fit> = match terms {
            1 => (0..GRID).filter_map(|i| at(&[i])).collect(),
            _ => (1..GRID).filter_map(|gap| (gap..GRID).filter_map(|i| at(&[i - gap, i])).min_by(least)).collect(),
        };
        starts.into_iter().map(|start| start.refined(bins, range)).min_by(least)
    }

    /// Steps to the nearest minimum (Levenberg and Marquardt).
    fn refined(mut self, bins: &[Bin], [from, to]: [f64; 2]) -> Fit {
        let mut damping = 1e-3;
        for _ in 0..STEPS_MOST {
            let mut equations = self.equations(bins);
            (0..PARAMETERS).for_each(|i| equations.matrix[i][i] *= 1.0 + damping);
            let next = equations.solve().and_then(|steps| {
                let steps = &steps[1 + TERMS_MOST..];
                let logs = self.log_times_s.iter().zip(steps).map(|(log, step)| (log + step).clamp(from, to));
                Fit::at(bins, logs.collect())
            });
            let Some(next) = next.filter(|next| next.squares < self.squares) else {
                if damping > DAMPING_MOST {
                    break;
                }
                damping *= 10.0;
                continue;
            };
            let is_last =
                next.log_times_s.iter().zip(&self.log_times_s).all(|(new, old)| (new - old).abs() < STEP_LEAST);
            self = next;
            if is_last {
                break;
            }
            damping *= 0.1;
        }
        self
    }

    /// Equations of a small change of all parameters.
    fn equations(&self, bins: &[Bin]) -> LeastSquares<PARAMETERS> {
        LeastSquares::of(
            bins.iter().map(|bin| (row(bin, &self.log_times_s, &self.linear), self.residual(bin), bin.count)),
        )
    }

    fn residual(&self, bin: &Bin) -> f64 {
        let terms = self.log_times_s.iter().zip(&self.linear[1..]);
        bin.value - self.linear[0] - terms.map(|(log, amplitude)| amplitude * bin.exponential(*log)[0]).sum::<f64>()
    }

    fn parameters(&self) -> usize {
        1 + 2 * self.log_times_s.len()
    }
}

/// Returns the derivatives of a bin's value by the parameters: final value, amplitudes, logs of the times. Without amplitudes the times
/// are absent.
fn row(bin: &Bin, log_times_s: &[f64], linear: &[f64; 1 + TERMS_MOST]) -> [f64; PARAMETERS] {
    let mut row = [0.0; PARAMETERS];
    row[0] = 1.0;
    for (i, log_time_s) in log_times_s.iter().enumerate() {
        let [value, slope] = bin.exponential(*log_time_s);
        row[1 + i] = value;
        row[1 + TERMS_MOST + i] = linear[1 + i] * slope;
    }
    row
}

/// Returns the fit with as many terms as are there, and the variances of its parameters for a noise of 1. They are infinite if the bins
/// don't determine them.
fn fit(bins: &[Bin], range: [f64; 2]) -> (Fit, [f64; PARAMETERS]) {
    let count: f64 = bins.iter().map(|bin| bin.count).sum();
    let mean = bins.iter().map(|bin| bin.count * bin.value).sum::<f64>() / count;
    let largest = bins.iter().map(|bin| bin.value.abs()).fold(0.0, f64::max);
    let rounding = count * (ROUNDING * largest).powi(2);
    let squares = bins.iter().map(|bin| bin.count * (bin.value - mean).powi(2)).sum();
    let mut fit = Fit { log_times_s: Vec::new(), linear: [mean, 0.0, 0.0], squares };
    for terms in 1..=TERMS_MOST {
        let Some(next) = Fit::best(bins, terms, range) else { break };
        let freedom = bins.len().saturating_sub(next.parameters());
        if by_chance(next.squares + rounding, fit.squares + rounding, 2, freedom) > CHANCE {
            break;
        }
        fit = next;
    }
    let variances = fit.equations(bins).variances().unwrap_or([f64::INFINITY; PARAMETERS]);
    (fit, variances)
}
