//! Fit of exponentials to readings, as [`relaxation`](super::relaxation()) needs it.
//!
//! The readings are averaged in bins of log time. For given times the amplitudes follow by linear least squares, so
//! only the logs of the times are searched (variable projection): from a grid of starts, by damped steps of Gauss and
//! Newton. An F-test decides whether another term is there.

use super::LeastSquares;

/// Most terms that are distinguished, and the parameters then: the final value, amplitudes, and logs of the times.
pub(super) const TERMS_MOST: usize = 2;
const PARAMETERS: usize = 1 + 2 * TERMS_MOST;

/// Most bins. So narrow bins lose no information.
const BINS_MOST: usize = 300;

/// A term is there if noise lowers the sum of squares as much with this probability. A term whose time constant is
/// determined lowers it by far more, so this hardly hides one.
const CHANCE: f64 = 1e-3;

/// Number of times in the grid of starts. Of two terms the best start of each ratio is refined, because times that
/// merge have a minimum of their own.
const GRID: usize = 12;

/// Most steps from a start. The search ends when no step, however damped, lowers the sum of squares by this share.
const STEPS_MOST: usize = 60;
const DAMPING_MOST: f64 = 1e6;
const GAIN_LEAST: f64 = 1e-10;

/// Rounding error relative to a value. It counts as a residual, because nothing smaller shows a term.
const ROUNDING: f64 = 1e-12;

/// Mean of readings that follow each other.
pub(super) struct Bin {
    /// Mean of the times from the first reading, s, and their variance.
    t_s: f64,
    variance_s2: f64,
    value: f64,
    count: f64,
}

impl Bin {
    /// A single reading.
    pub(super) fn at(t_s: f64, value: f64) -> Bin {
        Bin { t_s, variance_s2: 0.0, value, count: 1.0 }
    }

    /// Averages readings in bins that are equally wide in log time; the first ones have one reading. `interval_s` is
    /// the time between readings.
    pub(super) fn all(t_s: &[f64], values: &[f64], interval_s: f64) -> Vec<Bin> {
        let readings: Vec<Bin> = t_s.iter().zip(values).map(|(t, value)| Bin::at(t - t_s[0], *value)).collect();
        if readings.len() <= BINS_MOST {
            return readings;
        }
        let log = |reading: &Bin| (reading.t_s / interval_s).ln_1p();
        let width = log(&readings[readings.len() - 1]) / BINS_MOST as f64;
        let bin = |reading: &Bin| (log(reading) / width).floor();
        readings.chunk_by(|a, b| bin(a) == bin(b)).map(Bin::mean).collect()
    }

    fn mean(readings: &[Bin]) -> Bin {
        let count = readings.len() as f64;
        let mean = |of: &dyn Fn(&Bin) -> f64| readings.iter().map(of).sum::<f64>() / count;
        let t_s = mean(&|reading| reading.t_s);
        let variance_s2 = mean(&|reading| (reading.t_s - t_s).powi(2));
        Bin { t_s, variance_s2, value: mean(&|reading| reading.value), count }
    }

    /// Returns the mean of `exp(-t / time)` over the bin, and its derivative by the log of the time. A mean exceeds the
    /// value at the mean time by the curvature; with it the bins cause no bias.
    fn exponential(&self, log_time_s: f64) -> [f64; 2] {
        let rate = (-log_time_s).exp();
        let (x, bent) = (self.t_s * rate, self.variance_s2 * rate * rate);
        let value = (-x).exp();
        [value * (1.0 + 0.5 * bent), value * (x * (1.0 + 0.5 * bent) - bent)]
    }
}

/// Best fit for some time constants.
pub(super) struct Fit {
    /// Log of each time constant, s.
    pub(super) log_times_s: Vec<f64>,
    /// Final value and amplitudes.
    pub(super) linear: [f64; 1 + TERMS_MOST],
    /// Sum of the squared residuals of the bins, each times its count.
    pub(super) squares: f64,
}

impl Fit {
    /// The fit with as many terms as are there; `None` if the values are too large. `range` has the logs of the
    /// shortest and longest time that are searched, s.
    pub(super) fn of(bins: &[Bin], range: [f64; 2]) -> Option<Fit> {
        let mut fit = Fit::at(bins, Vec::new())?;
        for terms in 1..=TERMS_MOST {
            // the probability of a smaller ratio, for two more parameters
            let by_chance = |next: &Fit| (next.squares / fit.squares).powf(0.5 * next.freedom(bins.len()) as f64);
            match Fit::best(bins, terms, range).filter(|next| by_chance(next) < CHANCE) {
                Some(next) => fit = next,
                None => break,
            }
        }
        Some(fit)
    }

    /// `None` if the times can't be distinguished.
    fn at(bins: &[Bin], log_times_s: Vec<f64>) -> Option<Fit> {
        let rows = bins.iter().map(|bin| (row(bin, &log_times_s, &[0.0; 1 + TERMS_MOST]), bin.value, bin.count));
        let [[final_value, first, second, ..], _] = LeastSquares::of(rows).solve()?;
        let mut fit = Fit { log_times_s, linear: [final_value, first, second], squares: 0.0 };
        let square = |bin: &Bin| fit.residual(bin).powi(2) + (ROUNDING * bin.value).powi(2);
        fit.squares = bins.iter().map(|bin| bin.count * square(bin)).sum();
        Some(fit)
    }

    /// The best fit with a number of terms, from a grid of starts.
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
            let next = equations.solve().and_then(|[steps, _]| {
                let logs = self.log_times_s.iter().zip(&steps[1 + TERMS_MOST..]);
                Fit::at(bins, logs.map(|(log, step)| (log + step).clamp(from, to)).collect())
            });
            match next.filter(|next| next.squares < self.squares * (1.0 - GAIN_LEAST)) {
                Some(next) => (self, damping) = (next, 0.1 * damping),
                None if damping < DAMPING_MOST => damping *= 10.0,
                None => break,
            }
        }
        self
    }

    /// Equations of a small change of all parameters, whose variances are those of the fit for a noise of 1.
    pub(super) fn equations(&self, bins: &[Bin]) -> LeastSquares<PARAMETERS> {
        let derivatives = |bin: &Bin| row(bin, &self.log_times_s, &self.linear);
        LeastSquares::of(bins.iter().map(|bin| (derivatives(bin), self.residual(bin), bin.count)))
    }

    /// Value of a bin minus that of the fit.
    pub(super) fn residual(&self, bin: &Bin) -> f64 {
        let terms = self.log_times_s.iter().zip(&self.linear[1..]);
        bin.value - self.linear[0] - terms.map(|(log, amplitude)| amplitude * bin.exponential(*log)[0]).sum::<f64>()
    }

    /// Number of values minus that of parameters.
    pub(super) fn freedom(&self, values: usize) -> usize {
        values.saturating_sub(1 + 2 * self.log_times_s.len())
    }
}

/// Returns the derivatives of a bin's value by the parameters: final value, amplitudes, logs of the times. Without
/// amplitudes the times are absent.
pub(super) fn row(bin: &Bin, log_times_s: &[f64], linear: &[f64; 1 + TERMS_MOST]) -> [f64; PARAMETERS] {
    let mut row = [0.0; PARAMETERS];
    row[0] = 1.0;
    for (i, log_time_s) in log_times_s.iter().enumerate() {
        let [value, slope] = bin.exponential(*log_time_s);
        row[1 + i] = value;
        row[1 + TERMS_MOST + i] = linear[1 + i] * slope;
    }
    row
}
