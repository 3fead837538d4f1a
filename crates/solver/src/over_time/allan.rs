//! Allan deviation: the noise of means over longer and longer times.

use serde::Serialize;

/// Noise of means over one averaging time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AllanPoint {
    /// Averaging time, s.
    pub tau_s: f64,
    /// Allan deviation, in the unit of the values: the sd of a mean, if the noise is white.
    pub deviation: f64,
    /// Number of pairs of means that it follows from. They overlap, so about one in `2 tau_s / interval` is
    /// independent.
    pub pairs: usize,
}

/// Returns the overlapping Allan deviation of readings, for averaging times of 1, 2, 4 and so on intervals, up to a
/// quarter of the series. White noise falls as the root of the averaging time, a random walk rises as the root, and a
/// drift rises in proportion.
///
/// `interval_s` is the time between two readings, s. For readings at irregular times it is the mean interval; a gap
/// then counts as one interval. The result is empty for fewer than 4 readings, a number that isn't finite, or an
/// interval that isn't above 0.
pub fn allan_deviation(interval_s: f64, values: &[f64]) -> Vec<AllanPoint> {
    let is_sound = interval_s > 0.0 && interval_s.is_finite() && values.iter().all(|value| value.is_finite());
    if !is_sound {
        return Vec::new();
    }
    // sums from the first reading give the mean of any part by one difference; about the mean they stay small
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let mut sums = vec![0.0];
    sums.extend(values.iter().scan(0.0, |sum, value| {
        *sum += value - mean;
        Some(*sum)
    }));
    let point = |count: usize| {
        let squares: f64 =
            sums.windows(2 * count + 1).map(|part| (part[2 * count] - 2.0 * part[count] + part[0]).powi(2)).sum();
        let pairs = values.len() + 1 - 2 * count;
        let deviation = (0.5 * squares / pairs as f64).sqrt() / count as f64;
        AllanPoint { tau_s: interval_s * count as f64, deviation, pairs }
    };
    (0..).map(|power| 1 << power).take_while(|count| *count <= values.len() / 4).map(point).collect()
}

/// Returns the sd of one reading by successive differences, in the unit of the values. A slow drift hardly changes it.
/// `None` for fewer than two readings.
pub fn noise_sd(values: &[f64]) -> Option<f64> {
    let squares: f64 = values.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
    (values.len() > 1).then(|| (0.5 * squares / (values.len() - 1) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::tests::normal;
    use super::*;

    #[test]
    fn white_noise_falls_and_a_random_walk_rises_as_the_root_of_time() {
        let white = normal(1 << 14, "white");
        let walk: Vec<f64> = white
            .iter()
            .scan(0.0, |sum, step| {
                *sum += step;
                Some(*sum)
            })
            .collect();
        for point in allan_deviation(0.5, &white).iter().take(8) {
            let relative = point.deviation * (point.tau_s / 0.5).sqrt();
            assert!((relative - 1.0).abs() < 0.2, "{point:?}");
        }
        // at long times a walk of steps of sd 1 has the deviation sqrt(n / 3)
        for point in allan_deviation(0.5, &walk).iter().skip(2).take(6) {
            let relative = point.deviation / (point.tau_s / 0.5 / 3.0).sqrt();
            assert!((relative - 1.0).abs() < 0.25, "{point:?}");
        }
        assert!((noise_sd(&white).unwrap() - 1.0).abs() < 0.03);
    }

    #[test]
    fn a_short_series_is_exact() {
        // means of two: 1, 2, 2.5, 4.5 and so on
        let points = allan_deviation(2.0, &[0.0, 2.0, 2.0, 3.0, 6.0, 1.0, 0.0, 0.0]);
        assert_eq!(points.iter().map(|point| (point.tau_s, point.pairs)).collect::<Vec<_>>(), [(2.0, 7), (4.0, 5)]);
        let squares: f64 = [4.0, 0.0, 1.0, 9.0, 25.0, 1.0, 0.0].iter().sum();
        assert!((points[0].deviation - (squares / 14.0).sqrt()).abs() < 1e-12);
        let squares: f64 = [1.5f64, 2.5, 1.0, -4.0, -3.5].iter().map(|step| step * step).sum();
        assert!((points[1].deviation - (squares / 10.0).sqrt()).abs() < 1e-12);
        assert_eq!(noise_sd(&[0.0, 2.0]), Some(2f64.sqrt()));
    }

    #[test]
    fn what_has_no_deviation_gives_none() {
        assert_eq!(allan_deviation(1.0, &[1.0, 2.0, 3.0]), []);
        assert_eq!(allan_deviation(0.0, &[1.0; 8]), []);
        assert_eq!(allan_deviation(1.0, &[1.0, 2.0, f64::NAN, 3.0, 4.0]), []);
        assert_eq!(noise_sd(&[1.0]), None);
    }
}
