//! Exponentially weighted mean, the statistic of a control chart.

/// Exponentially weighted mean of independent values with mean 0 and standard deviation 1, as long as nothing has changed (Roberts
/// 1959). A slow drift shows in it earlier than in single values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ewma {
    weight: f64,
    mean: f64,
    /// Variance of the mean.
    variance: f64,
}

impl Ewma {
    /// Creates a chart. `weight` is that of the newest value, above 0 and at most 1.
    pub fn new(weight: f64) -> Self {
        Ewma { weight, mean: 0.0, variance: 0.0 }
    }

    /// Returns the chart after a further value.
    #[must_use]
    pub fn with(self, value: f64) -> Self {
        let Ewma { weight, mean, variance } = self;
        let kept = 1.0 - weight;
        Ewma { weight, mean: kept * mean + weight * value, variance: kept * kept * variance + weight * weight }
    }

    /// Returns the mean in standard deviations, if the values' reference has the variance `of_reference`. 0 without values.
    pub fn sigmas(&self, of_reference: f64) -> f64 {
        if self.variance == 0.0 { 0.0 } else { self.mean / (self.variance + of_reference).sqrt() }
    }

    /// Whether the values no longer agree with their reference, which has the variance `of_reference`: the rule by which a bench, a
    /// batch or a sensor is calibrated again.
    pub fn is_changed(&self, of_reference: f64, limit_sigmas: f64) -> bool {
        self.sigmas(of_reference).abs() > limit_sigmas
    }

    /// Returns the weighted mean.
    pub fn mean(&self) -> f64 {
        self.mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ewma_of_one_value_is_the_value_and_of_many_their_mean() {
        assert_eq!(Ewma::new(0.4).sigmas(0.0), 0.0);
        assert!((Ewma::new(0.4).with(2.0).sigmas(0.0) - 2.0).abs() < 1e-12);
        let many = (0..100).fold(Ewma::new(0.4), |chart, _| chart.with(1.0));
        // variance w / (2 - w)
        assert!((many.sigmas(0.0) - 2.0).abs() < 1e-6 && (many.mean() - 1.0).abs() < 1e-12);
        assert!((many.sigmas(0.75) - 1.0).abs() < 1e-6);
    }
}
