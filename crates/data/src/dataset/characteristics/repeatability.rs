//! Common definitions of repeatability, and the uncertainty of repeatability from few repeats.

use crate::acceptance::bound::sd_interval_factors;
use statrs::distribution::{ContinuousCDF, StudentsT};
use statrs::function::gamma::ln_gamma;
use statrs::statistics::Statistics as _;

/// Definition of repeatability, applied to the repeats of a level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Repeatability {
    /// Three standard deviations.
    ///
    /// With five repeats it is on average 0.94 of three true standard deviations, because the square root of an unbiased variance
    /// is itself biased (c4 of 5).
    #[default]
    ThreeSd,
    /// Largest minus smallest output.
    Range,
    /// Half the width of the interval that contains 95 %, by Student's t.
    T95,
    /// Three standard deviations at the level with the largest standard deviation.
    WorstLevel,
}

/// Repeatability in units of the output, and the interval that contains the true value with 95 % probability.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Repeated {
    pub value: f64,
    pub interval: Option<(f64, f64)>,
}

/// Repeats of each level of a series.
pub(super) type Levels = Vec<Vec<f64>>;

impl Repeatability {
    /// All definitions.
    pub const ALL: [Repeatability; 4] =
        [Repeatability::ThreeSd, Repeatability::Range, Repeatability::T95, Repeatability::WorstLevel];

    /// Returns the repeatability from the corrected outputs of each series. Levels held less than twice are ignored. `None` if no
    /// other levels exist.
    pub(super) fn of(self, series: &[Levels]) -> Option<Repeated> {
        let series: Vec<Vec<&[f64]>> = series.iter().map(|levels| repeated(levels)).collect();
        let levels = series.concat();
        if levels.is_empty() {
            return None;
        }
        let freedom = degrees_of_freedom(&series);
        let value = match self {
            Repeatability::ThreeSd => 3.0 * pooled_sd(&levels),
            Repeatability::Range => levels.iter().map(|level| range(level)).sum::<f64>() / levels.len() as f64,
            Repeatability::T95 => student_t95(freedom)? * pooled_sd(&levels),
            Repeatability::WorstLevel => 3.0 * levels.iter().map(|level| level.variance()).fold(0.0, f64::max).sqrt(),
        };
        let scaled =
            |bias: f64| sd_interval_factors(freedom).map(|(least, most)| (value * bias * least, value * bias * most));
        let interval = match self {
            Repeatability::ThreeSd | Repeatability::T95 => scaled(1.0),
            // a mean range isn't biased, where a standard deviation of the same repeats is
            Repeatability::Range => scaled(c4(freedom)),
            // the largest of several isn't distributed as one of them
            Repeatability::WorstLevel => None,
        };
        Some(Repeated { value, interval })
    }
}

/// Returns the levels that were held more than once.
fn repeated(levels: &Levels) -> Vec<&[f64]> {
    levels.iter().map(Vec::as_slice).filter(|level| level.len() > 1).collect()
}

/// Standard deviation common to all levels: their variances weighted by n - 1.
fn pooled_sd(levels: &[&[f64]]) -> f64 {
    (squares(levels) / freedom(levels)).sqrt()
}

/// Sum of the squared deviations from the mean of each level.
fn squares(levels: &[&[f64]]) -> f64 {
    levels.iter().map(|level| level.variance() * (level.len() - 1) as f64).sum()
}

fn freedom(levels: &[&[f64]]) -> f64 {
    levels.iter().map(|level| (level.len() - 1) as f64).sum()
}

/// Effective degrees of freedom of the pooled variance.
///
/// The levels of a staircase share its contact, and so share the contact's error. So a series of n staircases has n - 1 degrees
/// of freedom for any number of levels. If levels are missing, n is the average number of repeats for a level. This is exact if
/// the contact causes the complete error. If levels have their own errors, the number is too small, so the interval is too wide.
/// Series are independent; their sums of squares add up by Welch and Satterthwaite (JCGM 100, G.4.1).
fn degrees_of_freedom(series: &[Vec<&[f64]>]) -> f64 {
    let parts = series.iter().filter(|levels| !levels.is_empty());
    let parts = parts.map(|levels| (squares(levels), freedom(levels) / levels.len() as f64));
    let (mut sum, mut spread, mut all) = (0.0, 0.0, 0.0);
    for (squares, freedom) in parts {
        sum += squares;
        spread += squares * squares / freedom;
        all += freedom;
    }
    if spread > 0.0 { sum * sum / spread } else { all }
}

/// Ratio of the mean of standard deviations to the true standard deviation.
fn c4(degrees_of_freedom: f64) -> f64 {
    let half = degrees_of_freedom / 2.0;
    (ln_gamma(half + 0.5) - ln_gamma(half)).exp() / half.sqrt()
}

fn range(values: &[f64]) -> f64 {
    let (least, most) = values.iter().fold((f64::MAX, f64::MIN), |(least, most), v| (least.min(*v), most.max(*v)));
    most - least
}

/// Two-sided 95 % quantile of Student's t.
fn student_t95(degrees_of_freedom: f64) -> Option<f64> {
    Some(StudentsT::new(0.0, 1.0, degrees_of_freedom).ok()?.inverse_cdf(0.975))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-7, "{found} instead of {expected}");
    }

    #[test]
    fn the_worst_level_is_the_worst_and_pooling_weighs_by_freedom() {
        let levels = vec![vec![0.0, 2.0], vec![5.0], vec![1.0, 1.0, 1.0, 1.0]];
        let of = |repeatability: Repeatability| repeatability.of(std::slice::from_ref(&levels)).unwrap();
        assert_near(of(Repeatability::WorstLevel).value, 3.0 * 2.0f64.sqrt());
        assert_near(of(Repeatability::ThreeSd).value, 3.0 * 0.5f64.sqrt()); // 2 x 1 + 0 x 3 over 4
        assert_near(of(Repeatability::Range).value, 1.0);
        assert_eq!(of(Repeatability::WorstLevel).interval, None);
        // levels of two series weigh as those of one, but their degrees of freedom differ and so does Student's t
        let [first, others] = [vec![levels[0].clone()], levels[1..].to_vec()];
        for repeatability in [Repeatability::ThreeSd, Repeatability::Range, Repeatability::WorstLevel] {
            let parted = repeatability.of(&[first.clone(), others.clone()]).unwrap();
            assert_near(parted.value, of(repeatability).value);
        }
    }

    /// Quantiles of chi-squared as printed: 0.484419 and 11.143287 for 4 degrees of freedom, 2.179731 and 17.534546 for 8,
    /// 0.831212 and 12.832502 for 5.
    #[test]
    fn the_interval_has_the_degrees_of_freedom_of_the_contacts() {
        let level: Vec<f64> = vec![-2.0, -1.0, 0.0, 1.0, 2.0]; // variance 2.5
        let sd = 3.0 * 2.5f64.sqrt();
        let of = |series: &[Levels]| {
            let found = Repeatability::ThreeSd.of(series).unwrap();
            let (least, most) = found.interval.unwrap();
            [found.value, least, most]
        };
        let near = |found: [f64; 3], expected: [f64; 3]| {
            found.iter().zip(expected).for_each(|(f, e)| assert!((f / e - 1.0).abs() < 1e-6, "{found:?} {expected:?}"));
        };
        let by_four = [sd, sd * (4.0f64 / 11.143_287).sqrt(), sd * (4.0f64 / 0.484_418_6).sqrt()];
        near(of(&[vec![level.clone()]]), by_four);
        near(of(&[vec![level.clone(); 4]]), by_four);
        // two places that scatter alike
        near(
            of(&[vec![level.clone(); 4], vec![level.clone(); 4]]),
            [sd, sd * (8.0f64 / 17.534_546).sqrt(), sd * (8.0f64 / 2.179_731).sqrt()],
        );
        // one scatters twice as much: squares of 1 and 4 times 10, so 50 x 50 / (100 / 4 + 1600 / 4) = 5.882353
        let twice: Vec<f64> = level.iter().map(|value| 2.0 * value).collect();
        let [value, ..] = of(&[vec![level.clone()], vec![twice.clone()]]);
        near([value; 3], [3.0 * (50.0f64 / 8.0).sqrt(); 3]);
        assert_near(degrees_of_freedom(&[vec![&level[..]], vec![&twice[..]]]), 2500.0 / 425.0);
        // 5 repeats of three levels and 3 of one: 14 / 4
        assert_near(degrees_of_freedom(&[vec![&level[..], &level[..], &level[..], &level[..3]]]), 3.5);
    }

    #[test]
    fn students_t_has_the_same_degrees_of_freedom() {
        for (freedom, printed) in [(1.0, 12.7062), (2.0, 4.3027), (4.0, 2.7764), (8.0, 2.3060)] {
            assert!((student_t95(freedom).unwrap() - printed).abs() < 5e-5, "{freedom}");
        }
        let levels = vec![vec![-2.0, -1.0, 0.0, 1.0, 2.0]; 4];
        let of = |series: &[Levels]| Repeatability::T95.of(series).unwrap().value;
        assert!((of(std::slice::from_ref(&levels)) - 2.776_445 * 2.5f64.sqrt()).abs() < 1e-5);
        assert!((of(&[levels.clone(), levels.clone()]) - 2.306_004 * 2.5f64.sqrt()).abs() < 1e-5);
    }

    #[test]
    fn c4_is_as_printed() {
        for (repeats, printed) in [(2.0, 0.7979), (3.0, 0.8862), (5.0, 0.9400), (10.0, 0.9727)] {
            assert!((c4(repeats - 1.0) - printed).abs() < 5e-5, "{repeats}");
        }
    }
}
