//! Wear: how the gain changes with each press at one place.
//!
//! Presses at a place that isn't worn show the drift of the rig. The log of the gain is `a + wear * cycle + drift(t)`
//! at the worn place and `b + drift(t)` at the reference. The drift is a straight line in time. With 10 references it
//! has four bends: both places share them, so they hardly make the wear less certain.

use super::{LeastSquares, OverTimeError, interval_sigmas};
use serde::Serialize;
use std::array::from_fn;

/// Number of bends of the drift.
const BENDS: usize = 4;

/// Parameters: worn place, reference, wear, its curve, drift, bends. Each index is that of its factor.
const PARAMETERS: usize = 5 + BENDS;
const REFERENCE: usize = 1;
const WEAR: usize = 2;
const CURVE: usize = 3;
const DRIFT: usize = 4;

/// Least number of presses at the worn place.
const WORN_LEAST: usize = 5;

/// Least number of references that show the drift, and that show its bends.
const REFERENCES_LEAST: usize = 3;
const BENT_LEAST: usize = 10;

/// References show the drift only if they extend over this share of the time of the worn presses.
const COVER_LEAST: f64 = 0.5;

/// Wear isn't proportional to the cycles if its curve is this many times as large as half its 95 % interval.
const CURVE_MOST: f64 = 1.5;

/// Least variance of the noise of the log of a gain.
const VARIANCE_LEAST: f64 = 1e-14;

/// A press of a series at one place, or a reference press in between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CyclePoint {
    /// Number of presses at the worn place so far. A reference may have any finite number.
    pub cycle: f64,
    /// Time, s.
    pub t_s: f64,
    /// Natural logarithm of the gain.
    pub log_gain: f64,
    /// Whether it is at the place that isn't worn.
    pub is_reference: bool,
}

/// An estimate with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Estimated value.
    pub value: f64,
    /// The interval, in the unit of the value.
    pub interval: [f64; 2],
}

/// Change of a gain with the presses, and with time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Wear {
    /// Change of the log of the gain with each cycle; negative if the sensor loses gain. Unless `is_separate`, it
    /// contains the rig's drift from one cycle to the next.
    pub wear_per_cycle: Estimate,
    /// Change of the log of the gain in an hour that both places share, as a mean from the first press to the last.
    /// `None` unless `is_separate`.
    pub drift_per_h: Option<Estimate>,
    /// Whether wear and drift are distinguished: there are at least 3 references, and they extend over half the time of
    /// the worn presses.
    pub is_separate: bool,
    /// Whether the log of the gain changes in proportion to the cycles. Otherwise the wear is a mean and its interval
    /// too narrow: the wear becomes slower or faster, or there are fewer than 10 references and a drift that isn't
    /// straight.
    pub fits: bool,
    /// Standard deviation of the log of one gain about the model.
    pub residual_sd: f64,
    /// Number of presses at the worn place.
    pub presses: usize,
    /// Number of references.
    pub references: usize,
}

/// Estimates the wear of a place and the drift of the rig. The points can have any order. Each place has its own noise.
///
/// # Errors
/// There are fewer than 5 presses at the worn place, all have the same cycle, or a number isn't finite.
pub fn wear(cycles: &[CyclePoint]) -> Result<Wear, OverTimeError> {
    let is_finite = |point: &CyclePoint| [point.t_s, point.log_gain, point.cycle].iter().all(|value| value.is_finite());
    if let Some(reading) = cycles.iter().position(|point| !is_finite(point)) {
        return Err(OverTimeError::Reading { reading });
    }
    let mut points = cycles.to_vec();
    points.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    let (references, worn): (Vec<CyclePoint>, Vec<CyclePoint>) = points.iter().partition(|point| point.is_reference);
    if worn.len() < WORN_LEAST {
        return Err(OverTimeError::TooFew { readings: worn.len(), needed: WORN_LEAST });
    }
    let span_s = |of: &[CyclePoint]| of[of.len() - 1].t_s - of[0].t_s;
    let is_separate = references.len() >= REFERENCES_LEAST && span_s(&references) > COVER_LEAST * span_s(&worn);
    let used = if is_separate { &points } else { &worn };
    let ends_s = [used[0].t_s, used[used.len() - 1].t_s];
    let bends = is_separate.then_some(if references.len() < BENT_LEAST { 0 } else { BENDS });
    let middle = worn.iter().map(|point| point.cycle).sum::<f64>() / worn.len() as f64;
    let rows = used.iter().map(|point| (row(point, middle, ends_s, bends), point.log_gain));
    let curved = Fit::of(rows.clone().collect());
    let straight = rows.map(|(row, log_gain)| (from_fn(|i| if i == CURVE { 0.0 } else { row[i] }), log_gain)).collect();
    let is_worn = worn.iter().any(|point| point.cycle != worn[0].cycle);
    let fit = Fit::of(straight).filter(|_| is_worn).ok_or(OverTimeError::Singular)?;
    Ok(Wear {
        wear_per_cycle: fit.estimate(WEAR),
        drift_per_h: is_separate.then(|| fit.estimate(DRIFT)),
        is_separate,
        fits: curved.is_none_or(|fit| fit.parameters[CURVE].abs() <= CURVE_MOST * fit.half(CURVE)),
        residual_sd: fit.sd,
        presses: worn.len(),
        references: references.len(),
    })
}

/// Returns the factors of the parameters in the log of a gain. `middle` is the mean cycle, which makes the curve
/// independent of the wear. `ends_s` has the times of the first and the last press. A bend is 0 at both, so the drift
/// is the mean one. It is left out without a number of bends.
fn row(point: &CyclePoint, middle: f64, [first_s, last_s]: [f64; 2], bends: Option<usize>) -> [f64; PARAMETERS] {
    let mut row = [0.0; PARAMETERS];
    match point.is_reference {
        true => row[REFERENCE] = 1.0,
        false => [row[0], row[WEAR], row[CURVE]] = [1.0, point.cycle - middle, (point.cycle - middle).powi(2)],
    }
    if let Some(bends) = bends {
        row[DRIFT] = (point.t_s - first_s) / 3600.0;
        let share = (point.t_s - first_s) / (last_s - first_s);
        for bend in 1..=bends {
            let at = bend as f64 / (BENDS + 1) as f64;
            row[DRIFT + bend] = (share / at).min((1.0 - share) / (1.0 - at));
        }
    }
    row
}

/// Least-squares fit.
struct Fit {
    parameters: [f64; PARAMETERS],
    /// Variance of each parameter by the noise of the worn place, and by that of the reference.
    variances: [[f64; 2]; PARAMETERS],
    /// Degrees of freedom of both noises.
    freedoms: [f64; 2],
    /// Standard deviation of one log of a gain at the worn place.
    sd: f64,
}

impl Fit {
    /// Fits rows, each with its log of the gain. The noise of the worn place and that of the reference are estimated separately. `None` if the
    /// rows don't determine the parameters, or leave no degree of freedom.
    fn of(rows: Vec<([f64; PARAMETERS], f64)>) -> Option<Fit> {
        let group = |row: &[f64; PARAMETERS]| usize::from(row[REFERENCE] != 0.0);
        let weighted = |variances: [f64; 2]| {
            LeastSquares::of(rows.iter().map(|(row, log_gain)| (*row, *log_gain, 1.0 / variances[group(row)])))
        };
        let is_used = |parameter: &usize| rows.iter().any(|(row, _)| row[*parameter] != 0.0);
        let of_drift = (DRIFT..PARAMETERS).filter(is_used).count();
        let references = rows.iter().filter(|(row, _)| group(row) == 1).count();
        let own = (0..DRIFT).filter(is_used).count() - usize::from(references > 0);
        // the few references determine the drift
        let freedoms = match references {
            0 => [rows.len().checked_sub(own + of_drift)?, 1],
            _ => [(rows.len() - references).checked_sub(own)?, references.checked_sub(1 + of_drift)?],
        };
        if freedoms.contains(&0) {
            return None;
        }
        let [first, _] = weighted([1.0; 2]).solve()?;
        let mut squares = [0.0; 2];
        for (row, log_gain) in &rows {
            squares[group(row)] += (log_gain - product(row, &first)).powi(2);
        }
        // gains that repeat exactly are still rounded
        let noises = [0, 1].map(|group| (squares[group] / freedoms[group] as f64).max(VARIANCE_LEAST));
        let equations = weighted(noises);
        let ([parameters, _], covariance) = (equations.solve()?, equations.covariance()?);
        let mut variances = [[0.0; 2]; PARAMETERS];
        for (row, _) in &rows {
            for (variance, column) in variances.iter_mut().zip(&covariance) {
                variance[group(row)] += product(row, column).powi(2) / noises[group(row)];
            }
        }
        Some(Fit { parameters, variances, freedoms: freedoms.map(|freedom| freedom as f64), sd: noises[0].sqrt() })
    }

    /// Half the 95 % interval of a parameter. The degrees of freedom of two noises are combined (Welch and Satterthwaite).
    fn half(&self, parameter: usize) -> f64 {
        let [worn, reference] = self.variances[parameter];
        let variance = worn + reference;
        let [of_worn, of_reference] = self.freedoms;
        let freedom = variance.powi(2) / (worn.powi(2) / of_worn + reference.powi(2) / of_reference);
        interval_sigmas(freedom) * variance.sqrt()
    }

    fn estimate(&self, parameter: usize) -> Estimate {
        let (value, half) = (self.parameters[parameter], self.half(parameter));
        Estimate { value, interval: [value - half, value + half] }
    }
}

fn product(row: &[f64; PARAMETERS], other: &[f64; PARAMETERS]) -> f64 {
    row.iter().zip(other).map(|(factor, value)| factor * value).sum()
}
