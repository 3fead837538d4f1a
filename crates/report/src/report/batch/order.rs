//! The axis of the sensors in the order of calibration, and values along it.

use super::limited::{quartiles, sorted};
use crate::chart::{AxisScale, ChartAxis};
use palpate_run::batch::History;

/// Largest number of sensors that are drawn one by one. More are drawn in groups of neighbours.
const POINTS_MOST: usize = 300;

/// Number of groups, at most.
const GROUPS_MOST: usize = 100;

/// Number of dates next to the axis, at most.
const DATES_MOST: usize = 4;

/// Lengths of a date and of a minute in a time.
const DATE: usize = "2026-01-01".len();
const MINUTE: usize = "2026-01-01T00:00".len();

/// Returns the axis of the sensors: their numbers, and below these the dates; the times of the day if all have one date.
pub(super) fn axis(history: &History) -> ChartAxis {
    let (count, step) = (history.results.len(), step(history.results.len()));
    let days = days(history).len();
    let tick = |number: usize| {
        let at = &history.results[number - 1].at;
        let text = if days > 1 { at.get(..DATE) } else { at.get(DATE + 1..MINUTE) };
        (number as f64, format!("{number}\n{}", text.unwrap_or_default()))
    };
    let ticks = (1..=count).filter(|number| number.is_multiple_of(step)).map(tick).collect();
    let range = (0.5, count.max(1) as f64 + 0.5);
    ChartAxis { label: "sensor, in the order of calibration".to_owned(), scale: AxisScale::At(ticks), range }
}

/// Returns the distance between numbers next to the axis: 1, 2 or 5 times a power of ten.
fn step(count: usize) -> usize {
    let decades = (0..).map(|decade| 10usize.pow(decade));
    let steps = decades.flat_map(|decade| [1, 2, 5].map(|step| step * decade));
    let is_enough = |step: &usize| count / step <= DATES_MOST;
    steps.take(60).find(is_enough).unwrap_or(1)
}

/// Returns the days on which sensors ended, each with the number of complete ones.
pub(super) fn days(history: &History) -> Vec<(String, usize)> {
    let mut days: Vec<(String, usize)> = Vec::new();
    for (_, ended) in super::complete(history) {
        let day = ended.at.get(..DATE).unwrap_or_default();
        match days.last_mut().filter(|(last, _)| last == day) {
            Some((_, count)) => *count += 1,
            None => days.push((day.to_owned(), 1)),
        }
    }
    days
}

/// Values along the axis, one by one or in groups.
pub(super) struct Along {
    /// Values, or medians of the groups.
    pub points: Vec<(f64, f64)>,
    /// From the least to the greatest value of each group; empty if there are no groups.
    pub ranges: Vec<((f64, f64), (f64, f64))>,
    /// Number of sensors of a group; 1 if there are no groups.
    pub of: usize,
}

impl Along {
    /// Takes values, each with its sensor's number.
    pub(super) fn new(values: &[(usize, f64)]) -> Along {
        if values.len() <= POINTS_MOST {
            let points = values.iter().map(|(number, value)| (*number as f64, *value)).collect();
            return Along { points, ranges: Vec::new(), of: 1 };
        }
        let of = values.len().div_ceil(GROUPS_MOST);
        let (mut points, mut ranges) = (Vec::new(), Vec::new());
        for group in values.chunks(of) {
            let middle = 0.5 * (group[0].0 + group[group.len() - 1].0) as f64;
            let sorted = sorted(group.iter().map(|(_, value)| *value));
            if let (Some([_, median, _]), Some(least), Some(most)) = (quartiles(&sorted), sorted.first(), sorted.last())
            {
                points.push((middle, median));
                ranges.push(((middle, *least), (middle, *most)));
            }
        }
        Along { points, ranges, of }
    }

    /// Describes what a mark stands for.
    pub(super) fn text(&self, what: &str) -> String {
        match self.of {
            1 => what.to_owned(),
            of => format!("{what}: median of {of} sensors, and their range"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_next_to_the_axis_are_round_and_few() {
        let steps = [1, 4, 5, 9, 30, 100, 5000].map(step);
        assert_eq!(steps, [1, 1, 2, 2, 10, 50, 2000]);
    }

    #[test]
    fn many_values_are_grouped_and_the_extremes_stay() {
        let values: Vec<(usize, f64)> = (1..=5000).map(|number| (number, (number % 50) as f64)).collect();
        let along = Along::new(&values);
        assert_eq!((along.points.len(), along.of), (100, 50));
        assert_eq!(along.points[0], (25.5, 24.5));
        assert_eq!(along.ranges[99], ((4975.5, 0.0), (4975.5, 49.0)));
        assert_eq!(Along::new(&values[..300]).points.len(), 300);
    }
}
