//! Wear: how the gain changes with each press at one place.
//!
//! Presses at a place that isn't worn show the drift of the rig. The log of the gain is `a + wear * cycle + drift(t)` at the worn place and
//! `b + drift(t)` at the reference. The drift is a straight line in time. With 10 references it is tested whether they follow
//! one; if not, the line is bent at some of them.

use super::{LeastSquares, OverTimeError, by_chance, interval_sigmas};
use serde::Serialize;

/// Number of bends of a drift that isn't straight.
const BENDS: usize = 4;

/// Parameters: worn place, reference, wear, drift, bends. Each index is that of its factor.
const PARAMETERS: usize = 4 + BENDS;
const WEAR: usize = 2;
const DRIFT: usize = 3;

/// Least number of presses at the worn place.
const WORN_LEAST: usize = 5;

/// Least number of references that show the drift, and that show whether it is straight.
const REFERENCES_LEAST: usize = 3;
const BENT_LEAST: usize = 10;

/// References show the drift only if they extend over this share of the time of the worn presses.
const COVER_LEAST: f64 = 0.5;

/// The drift is bent if noise would bend it as much with this probability.
const CHANCE: f64 = 0.01;

/// The model doesn't fit if successive residuals differ less than noise does by so many standard deviations.
const MISFIT_SIGMAS: f64 = 3.0;

/// Least variance of the noise of the log of a gain.
const VARIANCE_LEAST: f64 = 1e-14;

/// A press of a series at one place, or a reference press in between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CyclePoint {
    /// Number of presses at the worn place so far. It isn't used for a reference.
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
    /// Change of the log of the gain with each cycle; negative if the sensor loses gain. Unless `is_separate`, it contains the rig's
    /// drift from one cycle to the next.
    pub wear_per_cycle: Estimate,
    /// Change of the log of the gain in an hour that both places share, as a mean from the first press to the last. `None` unless
    /// `is_separate`.
    pub drift_per_h: Option<Estimate>,
    /// Whether wear and drift are distinguished: there are at least 3 references, and they extend over half the time of the worn presses.
    pub is_separate: bool,
    /// Whether at least 10 references show that the drift isn't a straight line in time. Then the line is bent.
    pub is_bent: bool,
    /// Whether the worn presses scatter about the model without a trend. Otherwise the gain doesn't change in proportion to the cycles, or
    /// the drift isn't followed by so few references, and the intervals are too narrow.
    pub fits: bool,
    /// Standard deviation of the log of one gain at the worn place about the model.
    pub residual_sd: f64,
    /// Number of presses at the worn place, and of references.
    pub presses: usize,
    /// Number of references.
    pub references: usize,
}

/// Estimates the wear of a place and the drift of the rig. The points can have any order. Each place has its own noise.
///
/// # Errors
/// There are fewer than 5 presses at the worn place, all have the same cycle, or a number isn't finite.
pub fn wear(cycles: &[CyclePoint]) -> Result<Wear, OverTimeError> {
    let is_finite = |point: &CyclePoint| point.t_s.is_finite() && point.log_gain.is_finite() && point.cycle.is_finite();
    if let Some(reading) = cycles.iter().position(|point| !is_finite(point)) {
        return Err(OverTimeError::NotFinite { reading });
    }
    let mut points = cycles.to_vec();
    points.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    let (references, worn): (Vec<CyclePoint>, Vec<CyclePoint>) = points.iter().partition(|point| point.is_reference);
    if worn.len() < WORN_LEAST {
        return Err(OverTimeError::TooFew { readings: worn.len(), needed: WORN_LEAST });
    }
    if worn.iter().all(|point| point.cycle == worn[0].cycle) {
        return Err(OverTimeError::SameCycle);
    }
    let is_separate = references.len() >= REFERENCES_LEAST && span_s(&references) > COVER_LEAST * span_s(&worn);
    if !is_separate {
        points.retain(|point| !point.is_reference);
    }
    let straight = Drift::straight(&points, is_separate);
    let bent = (is_separate && references.len() >= BENT_LEAST).then(|| straight.bent_at(&references)).flatten();
    let drift = bent.as_ref().unwrap_or(&straight);
    let fit = Fit::with_own_noise(&points, drift).ok_or(OverTimeError::SameCycle)?;
    Ok(Wear {
        wear_per_cycle: fit.estimate(WEAR),
        drift_per_h: is_separate.then(|| fit.estimate(DRIFT)),
        is_separate,
        is_bent: bent.is_some(),
        fits: fit.residuals_are_random(&points),
        residual_sd: fit.sd(&points),
        presses: worn.len(),
        references: references.len(),
    })
}

fn span_s(sorted: &[CyclePoint]) -> f64 {
    sorted.first().zip(sorted.last()).map_or(0.0, |(first, last)| last.t_s - first.t_s)
}

/// Shape of the drift over time.
struct Drift {
    is_known: bool,
    first_s: f64,
    last_s: f64,
    /// Times of the bends; none for a straight line.
    bends_s: Vec<f64>,
}

impl Drift {
    fn straight(sorted: &[CyclePoint], is_known: bool) -> Drift {
        let first_s = sorted.first().map_or(0.0, |point| point.t_s);
        Drift { is_known, first_s, last_s: first_s + span_s(sorted), bends_s: Vec::new() }
    }

    /// The line bent at some of the references, if they show that it isn't straight. Worn presses don't decide, because wear that isn't
    /// proportional to the cycles would look like a bend.
    fn bent_at(&self, references: &[CyclePoint]) -> Option<Drift> {
        let at = |bend: usize| references[bend * references.len() / (BENDS + 1)].t_s;
        let bent = Drift { bends_s: (1..=BENDS).map(at).collect(), ..*self };
        let (with, without) = (Fit::of(references, &bent)?, Fit::of(references, self)?);
        (by_chance(with.squares, without.squares, BENDS, with.freedom) < CHANCE).then_some(bent)
    }

    /// Factors of the parameters in the log of a gain. A bend is 0 at the first and the last press, so the drift is the mean one.
    fn row(&self, point: &CyclePoint) -> [f64; PARAMETERS] {
        let mut row = [0.0; PARAMETERS];
        match point.is_reference {
            true => row[1] = 1.0,
            false => [row[0], row[WEAR]] = [1.0, point.cycle],
        }
        if self.is_known {
            row[DRIFT] = (point.t_s - self.first_s) / 3600.0;
        }
        for (factor, bend_s) in row[DRIFT + 1..].iter_mut().zip(&self.bends_s) {
            let rising = (point.t_s - self.first_s) / (bend_s - self.first_s);
            *factor = rising.min((self.last_s - point.t_s) / (self.last_s - bend_s));
        }
        row
    }
}

/// Least-squares fit with a drift.
struct Fit {
    parameters: [f64; PARAMETERS],
    /// Variance of each parameter, by the variances of the noise that were assumed.
    variances: [f64; PARAMETERS],
    residuals: Vec<f64>,
    /// Sum of the squared residuals, and the number of points minus that of parameters.
    squares: f64,
    freedom: usize,
}

impl Fit {
    /// Fits points of one noise. `None` if they don't determine the parameters, or leave no degree of freedom.
    fn of(points: &[CyclePoint], drift: &Drift) -> Option<Fit> {
        Fit::weighted(points, drift, [1.0; 2])
    }

    /// Fits points whose noise differs between the worn place and the reference. The references are few, so their degrees of freedom count
    /// in the intervals.
    fn with_own_noise(points: &[CyclePoint], drift: &Drift) -> Option<Fit> {
        let first = Fit::of(points, drift)?;
        let references = points.iter().filter(|point| point.is_reference).count();
        let drifts = 1 + drift.bends_s.len();
        let freedoms = match references {
            0 => [first.freedom, 1],
            _ => [points.len() - references - 2, references.saturating_sub(1 + drifts).max(1)],
        };
        let variance = |of_reference: bool, freedom: usize| {
            let squares = first.residuals.iter().zip(points).filter(|(_, point)| point.is_reference == of_reference);
            squares.map(|(residual, _)| residual * residual).sum::<f64>() / freedom.max(1) as f64
        };
        // outputs that repeat exactly still have the rounding of their records
        let variances = [false, true].map(|is| variance(is, freedoms[usize::from(is)]).max(VARIANCE_LEAST));
        let freedom = if references == 0 { freedoms[0] } else { freedoms[0].min(freedoms[1]) };
        Some(Fit { freedom, ..Fit::weighted(points, drift, variances)? })
    }

    /// Fits points with the variance of the noise at the worn place, and at the reference.
    fn weighted(points: &[CyclePoint], drift: &Drift, variances: [f64; 2]) -> Option<Fit> {
        let rows = || points.iter().map(|point| (drift.row(point), point.log_gain));
        let weights = points.iter().map(|point| 1.0 / variances[usize::from(point.is_reference)]);
        let equations = LeastSquares::of(rows().zip(weights).map(|((row, log_gain), weight)| (row, log_gain, weight)));
        let (parameters, variances) = (equations.solve()?, equations.variances()?);
        let solved =
            |row: [f64; PARAMETERS]| row.iter().zip(parameters).map(|(factor, value)| factor * value).sum::<f64>();
        let residuals: Vec<f64> = rows().map(|(row, log_gain)| log_gain - solved(row)).collect();
        let used = (0..PARAMETERS).filter(|&i| rows().any(|(row, _)| row[i] != 0.0)).count();
        let squares = residuals.iter().map(|residual| residual * residual).sum();
        let freedom = points.len().checked_sub(used).filter(|freedom| *freedom > 0)?;
        Some(Fit { parameters, variances, residuals, squares, freedom })
    }

    /// Standard deviation of the residuals at the worn place.
    fn sd(&self, points: &[CyclePoint]) -> f64 {
        let worn = self.residuals.iter().zip(points).filter(|(_, point)| !point.is_reference);
        let (count, squares) =
            worn.fold((0.0, 0.0), |(count, squares), (residual, _)| (count + 1.0, squares + residual * residual));
        (squares / f64::max(count - 2.0, 1.0)).sqrt()
    }

    fn estimate(&self, parameter: usize) -> Estimate {
        let value = self.parameters[parameter];
        let half = interval_sigmas(self.freedom) * self.variances[parameter].sqrt();
        Estimate { value, interval: [value - half, value + half] }
    }

    /// Whether residuals at the worn place differ from one to the next as random ones do (von Neumann). The points are those of the fit.
    fn residuals_are_random(&self, points: &[CyclePoint]) -> bool {
        let worn = self.residuals.iter().zip(points).filter(|(_, point)| !point.is_reference);
        let residuals: Vec<f64> = worn.map(|(residual, _)| *residual).collect();
        let squares: f64 = residuals.iter().map(|residual| residual * residual).sum();
        let steps: f64 = residuals.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
        0.5 * steps >= squares * (1.0 - MISFIT_SIGMAS / (residuals.len() as f64).sqrt())
    }
}
