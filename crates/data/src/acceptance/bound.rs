//! One-sided 95 % bounds of figures that a sample shows, and the two-sided intervals beside them.
//!
//! | figure | bound | needs |
//! |---|---|---|
//! | percentile, share | exact, from order statistics and the binomial distribution (Clopper and Pearson 1934) | 59 presses for a 95th percentile |
//! | mean | Hall's transformation of Student's t (Hall 1992, J. R. Stat. Soc. B 54, 221), which allows for skewed errors | [`MEAN_PRESSES_LEAST`] |
//! | standard deviation | chi-squared; assumes normal | 2 |
//!
//! `docs/explanation/verdicts.md` shows how often each is exceeded, on drawn errors of several shapes.

use palpate_core::quantity::COVERAGE;
use statrs::distribution::{Beta, ChiSquared, ContinuousCDF, StudentsT};
use statrs::statistics::Statistics as _;

/// Smallest probability that a bound covers the true value.
pub(crate) const CONFIDENCE: f64 = 0.95;

/// Smallest number of presses from which a mean is bounded. With fewer presses, skewed errors exceed the bound too often.
pub(crate) const MEAN_PRESSES_LEAST: usize = 59;

/// Confidence for which a mean's bound is computed, as a fraction. It is large enough that the bound also covers [`CONFIDENCE`]
/// of skewed errors. Exponentially distributed errors reduce it by 0.3 %, log-normal ones (sigma 0.8) by 1.5 %.
const MEAN_CONFIDENCE: f64 = 0.96;

/// Number of degrees of freedom from which Student's t is below 2.
const FREEDOM_MANY: f64 = 61.0;

/// Tail of the distribution that a bound leaves out.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Lower,
    Upper,
}

/// Returns the upper bound of the mean of a population from a sample; `None` below [`MEAN_PRESSES_LEAST`] values.
pub(crate) fn mean_upper(values: &[f64]) -> Option<f64> {
    mean_bound(values, MEAN_CONFIDENCE, Side::Upper)
}

/// Returns the two-sided 95 % interval of the mean; `None` below [`MEAN_PRESSES_LEAST`] values.
pub fn mean_interval(values: &[f64]) -> Option<(f64, f64)> {
    let each_side = (1.0 + CONFIDENCE) / 2.0;
    Some((mean_bound(values, each_side, Side::Lower)?, mean_bound(values, each_side, Side::Upper)?))
}

/// Returns the upper bound of the quantile `share` of a population. It is the smallest order statistic that is above the quantile
/// in 95 % of samples; `None` if even the largest isn't. `sorted` is in ascending order.
pub(crate) fn quantile_upper(sorted: &[f64], share: f64) -> Option<f64> {
    let n = sorted.len();
    // the r-th smallest is above the quantile unless r or more values are below it
    let is_above = |r: &usize| binomial_at_most(r - 1, n, share) >= CONFIDENCE;
    (1..=n).find(is_above).map(|r| sorted[r - 1])
}

/// Returns the two-sided 95 % interval of the quantile; `None` if the sample is too small for one of its ends.
pub fn quantile_interval(sorted: &[f64], share: f64) -> Option<(f64, f64)> {
    let (n, tail) = (sorted.len(), (1.0 - CONFIDENCE) / 2.0);
    let upper = (1..=n).find(|r| binomial_at_most(r - 1, n, share) >= 1.0 - tail)?;
    let lower = (1..=n).rev().find(|r| binomial_at_most(r - 1, n, share) <= tail)?;
    Some((sorted[lower - 1], sorted[upper - 1]))
}

/// Returns the smallest number of values from which the quantile `share` has an upper bound: 59 for the 95th percentile.
pub(crate) fn quantile_least(share: f64) -> usize {
    ((1.0 - CONFIDENCE).ln() / share.ln()).ceil() as usize
}

/// Returns the smallest number of values from which the quantile `share`, above one half, has a two-sided interval: 72 for the 95th
/// percentile.
pub fn quantile_interval_least(share: f64) -> usize {
    (((1.0 - CONFIDENCE) / 2.0).ln() / share.ln()).ceil() as usize
}

/// Returns the lower bound of the fraction of a population with a property that `count` of `n` have; 0 to 1.
pub(crate) fn share_lower(count: usize, n: usize) -> f64 {
    if count == 0 {
        return 0.0;
    }
    // n is at least count, so both parameters are positive
    Beta::new(count as f64, (n - count + 1) as f64).map_or(0.0, |beta| beta.inverse_cdf(1.0 - CONFIDENCE))
}

/// Returns the two-sided 95 % interval of the fraction of a population with a property that `count` of `n` have (Clopper and Pearson
/// 1934); 0 to 1. Without data, the interval is everything.
pub fn share_interval(count: usize, n: usize) -> (f64, f64) {
    let tail = 0.5 * (1.0 - CONFIDENCE);
    let quantile =
        |a: usize, b: usize, q: f64| Beta::new(a as f64, b as f64).map_or(q.round(), |beta| beta.inverse_cdf(q));
    let lower = if count == 0 { 0.0 } else { quantile(count, n - count + 1, tail) };
    let upper = if count >= n { 1.0 } else { quantile(count + 1, n - count, 1.0 - tail) };
    (lower, upper)
}

/// Returns the upper bound of a standard deviation with `freedom` degrees of freedom, as a multiple of this standard deviation.
/// Assumes a normal distribution.
pub(crate) fn sd_upper_factor(freedom: f64) -> Option<f64> {
    Some((freedom / chi_squared_quantile(freedom, 1.0 - CONFIDENCE)?).sqrt())
}

/// Returns the two-sided 95 % interval of a standard deviation, as multiples of it. Assumes a normal distribution.
pub fn sd_interval_factors(freedom: f64) -> Option<(f64, f64)> {
    let tail = (1.0 - CONFIDENCE) / 2.0;
    let factor = |share| Some((freedom / chi_squared_quantile(freedom, share)?).sqrt());
    Some((factor(1.0 - tail)?, factor(tail)?))
}

/// Returns the value at which the distribution reaches a probability, by bisection. The steps of `inverse_cdf` leave the positive
/// numbers at one degree of freedom.
fn chi_squared_quantile(freedom: f64, probability: f64) -> Option<f64> {
    let chi_squared = ChiSquared::new(freedom).ok()?;
    let (mut least, mut most) = (0.0, 1.0);
    while chi_squared.cdf(most) < probability {
        (least, most) = (most, 2.0 * most);
    }
    for _ in 0..100 {
        let middle = 0.5 * (least + most);
        if chi_squared.cdf(middle) < probability {
            least = middle;
        } else {
            most = middle;
        }
    }
    Some(most)
}

/// Returns the coverage factor for 95 % with `freedom` degrees of freedom, by Student's t; at least 2 (JCGM 100, G.3).
pub fn coverage_factor(freedom: f64) -> f64 {
    let student = StudentsT::new(0.0, 1.0, freedom).ok().filter(|_| freedom < FREEDOM_MANY);
    student.map_or(COVERAGE, |student| student.inverse_cdf((1.0 + CONFIDENCE) / 2.0).max(COVERAGE))
}

/// Returns Hall's bound. His transformation of (mean - mu)/sd is `w + a w^2 + a^2 w^3 / 3 + a / (2 n)`, where `a` is a third of
/// the skewness. It is close to Student's t. It is monotone, and is inverted exactly.
fn mean_bound(values: &[f64], share: f64, side: Side) -> Option<f64> {
    if values.len() < MEAN_PRESSES_LEAST {
        return None;
    }
    let n = values.len() as f64;
    let (mean, sd) = (values.mean(), values.std_dev());
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n;
    if variance <= 0.0 {
        return Some(mean);
    }
    let skewness = values.iter().map(|value| (value - mean).powi(3)).sum::<f64>() / n / variance.powf(1.5);
    let t = StudentsT::new(0.0, 1.0, n - 1.0).ok()?.inverse_cdf(share) / n.sqrt();
    // an upper bound of the mean follows from the lower tail of the statistic
    let tail = if side == Side::Upper { -t } else { t };
    let a = skewness / 3.0;
    let moved = tail - a / (2.0 * n);
    let w = if a.abs() < 1e-9 { moved } else { ((1.0 + 3.0 * a * moved).cbrt() - 1.0) / a };
    Some(mean - sd * w)
}

/// Returns the probability of at most `most` successes in `n` trials.
fn binomial_at_most(most: usize, n: usize, share: f64) -> f64 {
    if most >= n {
        return 1.0;
    }
    Beta::new((n - most) as f64, (most + 1) as f64).map_or(1.0, |beta| beta.cdf(1.0 - share))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranks(n: usize) -> Vec<f64> {
        (1..=n).map(|rank| rank as f64).collect()
    }

    /// Ranks from tables of distribution-free tolerance limits (95 % / 95 %): 59: 59, 93: 92, 124: 122; of the median of 20: 15.
    #[test]
    fn bounds_of_percentiles_are_the_tables_order_statistics() {
        assert_eq!(quantile_least(0.95), 59);
        assert_eq!(quantile_least(0.5), 5);
        assert_eq!(quantile_upper(&ranks(58), 0.95), None);
        for (n, rank) in [(59, 59.0), (92, 92.0), (93, 92.0), (124, 122.0)] {
            assert_eq!(quantile_upper(&ranks(n), 0.95), Some(rank), "{n}");
        }
        assert_eq!(quantile_upper(&ranks(20), 0.5), Some(15.0));
        assert_eq!(quantile_interval(&ranks(20), 0.5), Some((6.0, 15.0)));
        let least = quantile_interval_least(0.95);
        assert_eq!((least, quantile_interval(&ranks(least - 1), 0.95)), (72, None));
        assert!(quantile_interval(&ranks(least), 0.95).is_some());
    }

    /// Clopper and Pearson's one-sided bounds: all of n is 0.05^(1/n); 93 of 100 by the F distribution.
    #[test]
    fn bounds_of_shares_are_exact() {
        assert!((share_lower(59, 59) - 0.05f64.powf(1.0 / 59.0)).abs() < 1e-9);
        assert!((share_lower(93, 100) - 0.872_3).abs() < 5e-4, "{}", share_lower(93, 100));
        assert_eq!(share_lower(0, 10), 0.0);
        assert_eq!(share_lower(0, 0), 0.0);
    }

    /// All of 10: 0.025^(1/10). 95 of 100: 0.88717 and 0.98356 (R's `binom.test`).
    #[test]
    fn intervals_of_shares_are_exact() {
        let is_near = |(lower, upper): (f64, f64), known: (f64, f64)| {
            assert!((lower - known.0).abs() < 1e-5 && (upper - known.1).abs() < 1e-5, "{lower} {upper} {known:?}");
        };
        is_near(share_interval(10, 10), (0.025f64.powf(0.1), 1.0));
        is_near(share_interval(0, 10), (0.0, 1.0 - 0.025f64.powf(0.1)));
        is_near(share_interval(95, 100), (0.887_17, 0.983_56));
        is_near(share_interval(0, 0), (0.0, 1.0));
    }

    #[test]
    fn few_degrees_of_freedom_need_a_larger_coverage_factor() {
        for (freedom, printed) in
            [(1.0, 12.706), (4.0, 2.776), (30.0, 2.042), (1000.0, 2.0), (f64::INFINITY, 2.0), (f64::NAN, 2.0)]
        {
            assert!((coverage_factor(freedom) - printed).abs() < 5e-4, "{freedom}");
        }
    }

    #[test]
    fn means_are_bounded_as_by_student_where_nothing_is_skewed() {
        let even: Vec<f64> = ranks(101).iter().map(|rank| rank - 51.0).collect();
        let sd = even.iter().copied().std_dev();
        let student = StudentsT::new(0.0, 1.0, 100.0).unwrap().inverse_cdf(0.975) * sd / 101f64.sqrt();
        let (lower, upper) = mean_interval(&even).unwrap();
        assert!((upper - student).abs() < 1e-9 && (lower + student).abs() < 1e-9, "{lower} {upper} {student}");
        assert_eq!(mean_upper(&ranks(58)), None);
        assert_eq!(mean_upper(&[0.25; 59]), Some(0.25));
    }

    /// To the right of skewed errors there is more room than to the left.
    #[test]
    fn a_tail_widens_the_bound_of_a_mean_on_its_own_side() {
        let mut values = vec![1.0; 95];
        values.extend([5.0; 5]);
        let (lower, upper) = mean_interval(&values).unwrap();
        let mean = values.iter().copied().mean();
        assert!(upper - mean > 1.5 * (mean - lower), "{lower} {mean} {upper}");
    }

    #[test]
    fn quantiles_of_chi_squared_are_as_printed() {
        for (freedom, least, most) in
            [(1.0, 0.000_982_069, 5.023_886), (2.0, 0.050_635_6, 7.377_759), (40.0, 24.433_039, 59.341_707)]
        {
            for (probability, printed) in [(0.025, least), (0.975, most)] {
                let found = chi_squared_quantile(freedom, probability).unwrap();
                assert!((found / printed - 1.0).abs() < 1e-6, "{freedom}, {probability}: {found}");
            }
        }
    }

    /// Chi-squared tables: 4 degrees of freedom 0.7107 (5 %), 0.4844 (2.5 %), 11.143 (97.5 %).
    #[test]
    fn bounds_of_standard_deviations_are_the_tables() {
        assert!((sd_upper_factor(4.0).unwrap() - (4.0 / 0.710_723f64).sqrt()).abs() < 1e-4);
        let (lower, upper) = sd_interval_factors(4.0).unwrap();
        assert!(
            (lower - (4.0 / 11.143_29f64).sqrt()).abs() < 1e-4 && (upper - (4.0 / 0.484_419f64).sqrt()).abs() < 1e-4
        );
    }
}
