//! A figure of the acceptance rule, as the events of a batch name it.

use super::complete;
use palpate_core::quantity::percentile;
use palpate_data::acceptance::{LimitedFigure, SensorVerdict, limit_used};
use palpate_run::batch::{Ended, History, SensorFigure};

/// A figure of the acceptance rule.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Limited {
    /// Key in the acceptance rule.
    pub key: String,
    /// The figure; `None` for a key that this program doesn't know.
    figure: Option<LimitedFigure>,
}

/// Decimals of a quantity that this program doesn't know.
const DIGITS: usize = 3;

impl Limited {
    fn of(key: &str) -> Limited {
        Limited { key: key.to_owned(), figure: LimitedFigure::ALL.into_iter().find(|figure| figure.key() == key) }
    }

    /// Returns the quantities of some batches: the known ones in the order of reports, then the others by name.
    pub(super) fn all<'a>(histories: impl IntoIterator<Item = &'a History>) -> Vec<Limited> {
        let mut keys: Vec<&str> = Vec::new();
        for found in histories.into_iter().flat_map(complete).flat_map(|(_, ended)| &ended.found) {
            if !keys.contains(&found.figure.as_str()) {
                keys.push(&found.figure);
            }
        }
        keys.sort_by_key(|key| {
            (LimitedFigure::ALL.iter().position(|figure| figure.key() == *key).unwrap_or(usize::MAX), *key)
        });
        keys.into_iter().map(Limited::of).collect()
    }

    /// Returns the name with the unit, such as `location error, mean, mm`.
    pub(super) fn label(&self) -> String {
        match self.unit() {
            "" => self.name().to_owned(),
            unit => format!("{}, {unit}", self.name()),
        }
    }

    /// Returns the name without the unit.
    pub(super) fn name(&self) -> &str {
        self.figure.map_or(self.key.as_str(), |figure| figure.name())
    }

    /// Returns the unit of displayed values.
    pub(super) fn unit(&self) -> &'static str {
        self.figure.map_or("", LimitedFigure::unit)
    }

    /// Number of displayed decimals.
    pub(super) fn digits(&self) -> usize {
        self.figure.map_or(DIGITS, LimitedFigure::digits)
    }

    /// Whether a control chart makes sense: counts are mostly 0.
    pub(super) fn is_charted(&self) -> bool {
        !matches!(self.figure, Some(LimitedFigure::BrokenChannels | LimitedFigure::FlaggedPresses))
    }

    /// Whether the figure is a fraction, which has a lower limit.
    pub(super) fn is_share(&self) -> bool {
        self.figure.is_some_and(LimitedFigure::is_share)
    }

    /// Returns a value in the displayed unit: a fraction in percent.
    pub(super) fn displayed(&self, value: f64) -> f64 {
        if self.is_share() { 100.0 * value } else { value }
    }

    /// Returns the figure of a result.
    pub(super) fn found<'e>(&self, ended: &'e Ended) -> Option<&'e SensorFigure> {
        ended.found.iter().find(|found| found.figure == self.key)
    }

    /// Returns the part of the limit that a figure uses, by its bound if it has one. A fraction uses (1 - fraction) / (1 - limit). Above 1
    /// the limit is exceeded.
    pub(super) fn used(&self, found: &SensorFigure) -> Option<f64> {
        Some(limit_used(self.is_share(), found.bound.or(found.value)?, found.limit))
    }

    /// Returns the values of a batch, in the figure's unit, sorted.
    pub(super) fn sorted(&self, history: &History) -> Vec<f64> {
        sorted(complete(history).filter_map(|(_, ended)| self.found(ended)?.value))
    }
}

/// Whether the figure alone prevents the acceptance.
pub(super) fn is_exceeded(found: &SensorFigure) -> bool {
    found.verdict == SensorVerdict::NotAccepted
}

/// Returns finite values in their order.
pub(super) fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Returns lower quartile, median and upper quartile; `None` without values.
pub(super) fn quartiles(sorted: &[f64]) -> Option<[f64; 3]> {
    (!sorted.is_empty()).then(|| [0.25, 0.5, 0.75].map(|q| percentile(sorted, q)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn used_part_of_a_limit_follows_from_bound_or_fraction() {
        let found = |figure: &str, value, bound, limit| SensorFigure {
            figure: figure.to_owned(),
            value,
            bound,
            limit,
            verdict: SensorVerdict::Accepted,
        };
        let used = |found: &SensorFigure| Limited::of(&found.figure).used(found);
        assert_eq!(used(&found("location_mean_mm", Some(0.5), None, 1.0)), Some(0.5));
        assert_eq!(used(&found("location_mean_mm", Some(0.5), Some(0.75), 1.0)), Some(0.75));
        assert_eq!(used(&found("location_within", Some(0.75), None, 0.5)), Some(0.5));
        assert_eq!(used(&found("broken_channels_most", Some(0.0), None, 0.0)), Some(0.0));
        assert_eq!(used(&found("force_mean_n", None, None, 1.0)), None);
        assert_eq!(Limited::of("force_mean_n").label(), "force error, mean, N");
        assert_eq!(Limited::of("another").label(), "another");
    }
}
