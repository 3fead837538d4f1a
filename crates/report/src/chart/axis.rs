//! One axis.

/// One axis.
#[derive(Clone, Debug)]
pub struct ChartAxis {
    /// Name of the quantity, with its unit.
    pub label: String,
    /// Distribution of values along the axis.
    pub scale: AxisScale,
    /// First and last value.
    pub range: (f64, f64),
}

/// Distribution of values along an axis.
#[derive(Clone, Debug, PartialEq)]
pub enum AxisScale {
    /// Evenly.
    Linear,
    /// Evenly, with only integers shown, because the axis shows counts.
    Count,
    /// By their logarithm.
    Log,
    /// Evenly, with only these values shown. Text after a line end is shown below.
    At(Vec<(f64, String)>),
    /// By their logarithm, with only these values shown. Text after a line end is shown below.
    LogAt(Vec<(f64, String)>),
    /// By named rows; row i is at i.
    Rows(Vec<String>),
}

/// Factor by which a logarithmic axis extends beyond its values.
const ROOM: f64 = 1.12;
/// Width below which an even axis contains only one value. Such an axis is drawn with width 1.
const NARROWEST: f64 = 1e-12;
/// Largest number of values that an even axis shows, for any range.
const MOST_TICKS: usize = 100;
/// Least number of numbers with which a logarithmic axis of less than a decade can be read. With fewer, the axis has even values.
const FEWEST_TICKS: usize = 3;

impl ChartAxis {
    /// Creates a logarithmic axis. Its range contains all values with a small margin, and at least the range `least`.
    pub fn log(label: &str, values: impl IntoIterator<Item = f64>, least: (f64, f64)) -> ChartAxis {
        let (min, max) = values
            .into_iter()
            .filter(|value| *value > 0.0)
            .fold(least, |(min, max), value| (min.min(value / ROOM), max.max(value * ROOM)));
        ChartAxis { label: label.to_owned(), scale: AxisScale::Log, range: (min, max) }
    }

    /// Creates a linear axis. If all values are equal, the axis begins at this value.
    pub fn linear(label: &str, (min, max): (f64, f64)) -> ChartAxis {
        let range = if max - min > NARROWEST { (min, max) } else { (min, min + 1.0) };
        ChartAxis { label: label.to_owned(), scale: AxisScale::Linear, range }
    }

    /// Creates a linear axis for counts.
    pub fn count(label: &str, range: (f64, f64)) -> ChartAxis {
        ChartAxis { scale: AxisScale::Count, ..ChartAxis::linear(label, range) }
    }

    /// Creates an axis of named rows.
    pub fn rows(names: Vec<String>) -> ChartAxis {
        let last = names.len() as f64 - 0.5;
        ChartAxis { label: String::new(), scale: AxisScale::Rows(names), range: (-0.5, last) }
    }

    /// Returns the position of a value, from 0 to 1.
    pub fn share(&self, value: f64) -> f64 {
        let (min, max) = self.range;
        match self.scale {
            AxisScale::Log | AxisScale::LogAt(_) => (value.max(f64::MIN_POSITIVE) / min).ln() / (max / min).ln(),
            AxisScale::Linear | AxisScale::Count | AxisScale::At(_) | AxisScale::Rows(_) => (value - min) / (max - min),
        }
    }

    /// Returns the values with a grid line, and their texts, on an axis of `length_px`. Even values are limited to those that
    /// have room, according to the length that each text takes.
    pub(super) fn ticks(&self, length_px: f64, taken_px: impl Fn(&str) -> f64) -> Vec<(f64, String)> {
        let (min, max) = self.range;
        let within = |value: &f64| (min - 1e-9 * min.abs()..=max + 1e-9 * max.abs()).contains(value);
        match &self.scale {
            AxisScale::Rows(names) => names.iter().enumerate().map(|(row, name)| (row as f64, name.clone())).collect(),
            AxisScale::At(ticks) | AxisScale::LogAt(ticks) => ticks.clone(),
            AxisScale::Linear | AxisScale::Count => {
                self.even_ticks(if self.scale == AxisScale::Count { 1.0 } else { 0.0 }, length_px, taken_px)
            }
            AxisScale::Log => {
                let decades = max.log10() - min.log10();
                let steps: &[f64] = match decades {
                    d if d < 0.9 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
                    d if d < 2.2 => &[1.0, 2.0, 5.0],
                    _ => &[1.0],
                };
                let (first, last) = (min.log10().floor() as i32, max.log10().ceil() as i32);
                let values = (first..=last).flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
                let ticks: Vec<(f64, String)> =
                    values.filter(within).map(|value| (value, number(value, value))).collect();
                // a part of a decade can lie between two of these
                if decades < 0.9 && ticks.len() < FEWEST_TICKS {
                    self.even_ticks(0.0, length_px, taken_px)
                } else {
                    ticks
                }
            }
        }
    }

    /// Returns even values with a distance of at least `least`.
    fn even_ticks(&self, least: f64, length_px: f64, taken_px: impl Fn(&str) -> f64) -> Vec<(f64, String)> {
        let (min, max) = self.range;
        if max <= min {
            return Vec::new();
        }
        let within = |value: &f64| (min - 1e-9 * min.abs()..=max + 1e-9 * max.abs()).contains(value);
        let mut step = round_step((max - min) / 6.0).max(least);
        loop {
            let first = (min / step - 1e-9).ceil() as i64; // -0.6 is three times 0.2 except for rounding
            let values = (first..).map(|i| i as f64 * step).take_while(within).take(MOST_TICKS);
            let ticks: Vec<(f64, String)> = values.map(|value| (value, number(value, step))).collect();
            let widest_px = ticks.iter().map(|(_, text)| taken_px(text)).fold(0.0, f64::max);
            if ticks.len() < 2 || length_px * step / (max - min) >= widest_px {
                return ticks;
            }
            step = round_step(1.5 * step);
        }
    }
}

/// Returns the smallest of 1, 2 and 5 times a power of ten that is at least `least`.
fn round_step(least: f64) -> f64 {
    let decade = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|step| step * decade).into_iter().find(|step| *step >= least).unwrap_or(decade)
}

/// Formats a tick's value without rounding digits. The number of digits is that of the step, at least three.
fn number(value: f64, step: f64) -> String {
    let digits = (1.0 - step.abs().log10().floor()).clamp(3.0, 15.0) as usize;
    let rounded = format!("{value:.digits$}");
    let short = rounded.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        let text = |axis: ChartAxis| text(&axis, 400.0);
        assert_eq!(text(ChartAxis { range: (0.5, 3.2), ..ChartAxis::log("", [], (1.0, 1.0)) }), "0.5 0.7 1 1.5 2 3");
        assert_eq!(text(ChartAxis { range: (1.0, 900.0), ..ChartAxis::log("", [], (1.0, 1.0)) }), "1 10 100");
        assert_eq!(text(ChartAxis { range: (0.51, 0.68), ..ChartAxis::log("", [], (1.0, 1.0)) }), "0.55 0.6 0.65");
        assert_eq!(text(ChartAxis::linear("", (-1.0, 2.0))), "-1 -0.5 0 0.5 1 1.5 2");
        assert_eq!(text(ChartAxis::rows(vec!["a".to_owned(), "b".to_owned()])), "a b");
    }

    /// The ticks of an axis so many px long where each takes 13.
    fn text(axis: &ChartAxis, length_px: f64) -> String {
        axis.ticks(length_px, |_| 13.0).into_iter().map(|(_, text)| text).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn an_axis_of_one_value_ends() {
        for range in [(0.0, 0.0), (0.0, f64::MIN_POSITIVE), (0.0, -0.0), (2.0, 2.0), (f64::NAN, f64::NAN)] {
            let axis = ChartAxis::linear("", range);
            assert!(axis.ticks(400.0, |_| 13.0).len() < 10, "{range:?}");
            assert!(range.0.is_nan() || axis.share(range.0).is_finite(), "{range:?}");
        }
        assert_eq!(text(&ChartAxis::linear("", (2.0, 2.0)), 400.0), "2 2.2 2.4 2.6 2.8 3");
    }

    #[test]
    fn ticks_differ_have_room_and_count_in_whole_steps() {
        assert_eq!(text(&ChartAxis::linear("", (0.0, 0.0021)), 400.0), "0 0.0005 0.001 0.0015 0.002");
        assert_eq!(text(&ChartAxis::linear("", (-5e-5, 5e-5)), 400.0), "-0.00004 -0.00002 0 0.00002 0.00004");
        assert_eq!(text(&ChartAxis::linear("", (-1.5, 1.5)), 28.0), "0");
        assert_eq!(text(&ChartAxis::linear("", (-1.5, 1.5)), 60.0), "-1 0 1");
        assert_eq!(text(&ChartAxis::count("", (0.5, 2.5)), 400.0), "1 2");
        assert_eq!(text(&ChartAxis::count("", (0.5, 100.5)), 400.0), "20 40 60 80 100");
    }
}
