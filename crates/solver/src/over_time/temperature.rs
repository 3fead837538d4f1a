//! Temperature coefficient: how a zero or a gain changes with the temperature, apart from its drift in time.
//!
//! The value is `a + coefficient * temperature + drift * t`, with independent noise. A temperature that only rises or falls
//! with time hardly shows its coefficient, which the interval states.

use super::{Estimate, LeastSquares, OverTimeError, interval_sigmas};
use serde::Serialize;

/// Least number of values.
const VALUES_LEAST: usize = 8;

/// Largest part of the temperature's changes that a straight line in time may explain, beyond which nothing is estimated.
const LINE_MOST: f64 = 0.999;

/// A value with its time and its temperature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemperaturePoint {
    /// Time, s.
    pub t_s: f64,
    /// Temperature, degrees Celsius.
    pub temperature_c: f64,
    /// The value.
    pub value: f64,
}

/// Change of a value with the temperature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TemperatureCoefficient {
    /// Change of the value for each degree, in the unit of the value.
    pub per_c: Estimate,
    /// Standard deviation of a value about the model.
    pub residual_sd: f64,
    /// Difference of the highest and the lowest temperature, degrees.
    pub span_c: f64,
}

/// Estimates the temperature coefficient of a value. The points can have any order.
///
/// # Errors
/// There are fewer than 8 points, a number isn't finite, or the temperature is constant or a straight line in time.
pub fn temperature_coefficient(points: &[TemperaturePoint]) -> Result<TemperatureCoefficient, OverTimeError> {
    let is_finite =
        |point: &TemperaturePoint| [point.t_s, point.temperature_c, point.value].iter().all(|n| n.is_finite());
    if let Some(reading) = points.iter().position(|point| !is_finite(point)) {
        return Err(OverTimeError::Reading { reading });
    }
    if points.len() < VALUES_LEAST {
        return Err(OverTimeError::TooFew { readings: points.len(), needed: VALUES_LEAST });
    }
    let count = points.len() as f64;
    let mean = |of: fn(&TemperaturePoint) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (mean_s, mean_c) = (mean(|point| point.t_s), mean(|point| point.temperature_c));
    let row = |point: &TemperaturePoint| [1.0, point.temperature_c - mean_c, (point.t_s - mean_s) / 3600.0];
    let sums = |of: fn([f64; 3]) -> f64| points.iter().map(|point| of(row(point))).sum::<f64>();
    let (of_c, of_h, both) = (sums(|row| row[1].powi(2)), sums(|row| row[2].powi(2)), sums(|row| row[1] * row[2]));
    // written as the positive condition, so NaN fails
    let is_shown = both.powi(2) < LINE_MOST * of_c * of_h;
    if !is_shown {
        return Err(OverTimeError::Singular);
    }
    let fit = LeastSquares::of(points.iter().map(|point| (row(point), point.value, 1.0)));
    let [parameters, variances] = fit.solve().ok_or(OverTimeError::Singular)?;
    let rest = |point: &TemperaturePoint| {
        point.value - row(point).iter().zip(parameters).map(|(factor, parameter)| factor * parameter).sum::<f64>()
    };
    let freedom = count - 3.0;
    let residual_sd = (points.iter().map(|point| rest(point).powi(2)).sum::<f64>() / freedom).sqrt();
    let half = interval_sigmas(freedom) * residual_sd * variances[1].sqrt();
    let ends_c = points.iter().map(|point| point.temperature_c);
    Ok(TemperatureCoefficient {
        per_c: Estimate { value: parameters[1], interval: [parameters[1] - half, parameters[1] + half] },
        residual_sd,
        span_c: ends_c.clone().fold(f64::NEG_INFINITY, f64::max) - ends_c.fold(f64::INFINITY, f64::min),
    })
}
