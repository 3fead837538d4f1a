//! Effect of a term, as a mean of paired differences.

use palpate_core::quantity::round;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};
use statrs::statistics::Statistics as _;

/// Effect of a term: the mean of differences, each between two tries with the same random draws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Effect {
    /// Result without the term, mean over seeds.
    pub off: f64,
    /// Result with the term, mean over seeds.
    pub on: f64,
    /// `on` minus `off`, mean over seeds.
    pub difference: f64,
    /// Half the 95 % confidence interval of the difference (Student's t over seeds).
    pub within: f64,
    /// Number of pairs.
    pub seeds: usize,
}

impl Effect {
    /// Returns the effect for pairs (off, on). Returns `None` for fewer than two pairs, or if a number isn't finite.
    pub fn of(pairs: &[(f64, f64)]) -> Option<Effect> {
        let count = pairs.len() as f64;
        let quantile = StudentsT::new(0.0, 1.0, count - 1.0).ok()?.inverse_cdf(0.975);
        let mean = |value: fn(&(f64, f64)) -> f64| pairs.iter().map(value).mean();
        let (off, on, difference) = (mean(|pair| pair.0), mean(|pair| pair.1), mean(|pair| pair.1 - pair.0));
        let within = quantile * pairs.iter().map(|(off, on)| on - off).std_dev() / count.sqrt();
        // to useful digits: a nanometre, a micronewton, a millionth
        let [off, on, difference, within] = [off, on, difference, within].map(|value| round(value, 6));
        let effect = Effect { off, on, difference, within, seeds: pairs.len() };
        (off.is_finite() && on.is_finite() && within.is_finite()).then_some(effect)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_students_over_the_differences_and_not_over_the_values() {
        // differences 1, 2, 3: mean 2, sd 1, t(2) = 4.302653, over sqrt(3)
        let effect = Effect::of(&[(10.0, 11.0), (-50.0, -48.0), (7.0, 10.0)]).unwrap();
        assert_eq!((effect.difference, effect.seeds), (2.0, 3));
        assert!((effect.within - 2.484138).abs() < 2e-6, "{}", effect.within);
        assert_eq!((effect.off, effect.on), (-11.0, -9.0));
        assert_eq!(Effect::of(&[(1.0, 1.0), (2.0, 2.0)]).unwrap().within, 0.0);
    }

    #[test]
    fn single_pair_gives_no_correlation() {
        assert_eq!(Effect::of(&[(1.0, 2.0)]), None);
        assert_eq!(Effect::of(&[]), None);
        assert_eq!(Effect::of(&[(1.0, 2.0), (1.0, f64::NAN)]), None);
    }
}
