/// One axis.
#[derive(Clone, Debug)]
pub struct Axis {
    /// What it is, with its unit.
    pub label: String,
    /// How values are spread.
    pub scale: Scale,
    /// First and last value.
    pub range: (f64, f64),
}

/// How values are spread along an axis.
#[derive(Clone, Debug, PartialEq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By their logarithm.
    Log,
    /// By their logarithm, with these values and no others told; what follows a line's end stands below.
    LogAt(Vec<(f64, String)>),
    /// By rows with names; row i is at i.
    Rows(Vec<String>),
}

/// By how much a logarithmic axis goes beyond its values.
const ROOM: f64 = 1.12;

impl Axis {
    /// An axis by the logarithm, its range widened to hold all values with a little room; at least as wide as asked for.
    pub fn log(label: &str, values: impl IntoIterator<Item = f64>, least: (f64, f64)) -> Axis {
        let (min, max) = values
            .into_iter()
            .filter(|value| *value > 0.0)
            .fold(least, |(min, max), value| (min.min(value / ROOM), max.max(value * ROOM)));
        Axis { label: label.to_owned(), scale: Scale::Log, range: (min, max) }
    }

    /// An axis of even spread.
    pub fn linear(label: &str, range: (f64, f64)) -> Axis {
        Axis { label: label.to_owned(), scale: Scale::Linear, range }
    }

    /// Rows with names.
    pub fn rows(names: Vec<String>) -> Axis {
        let last = names.len() as f64 - 0.5;
        Axis { label: String::new(), scale: Scale::Rows(names), range: (-0.5, last) }
    }

    /// Where a value is, from 0 to 1.
    pub fn share(&self, value: f64) -> f64 {
        let (min, max) = self.range;
        match self.scale {
            Scale::Log | Scale::LogAt(_) => (value.max(f64::MIN_POSITIVE) / min).ln() / (max / min).ln(),
            Scale::Linear | Scale::Rows(_) => (value - min) / (max - min),
        }
    }

    /// Values with a line across, and how they are told.
    pub(super) fn ticks(&self) -> Vec<(f64, String)> {
        let (min, max) = self.range;
        let within = |value: &f64| (min - 1e-9 * min.abs()..=max + 1e-9 * max.abs()).contains(value);
        match &self.scale {
            Scale::Rows(names) => names.iter().enumerate().map(|(row, name)| (row as f64, name.clone())).collect(),
            Scale::LogAt(ticks) => ticks.clone(),
            Scale::Linear => {
                let step = linear_step(max - min);
                let first = (min / step).ceil() as i64;
                let values = (first..).map(|i| i as f64 * step).take_while(within);
                values.map(|value| (value, number(value))).collect()
            }
            Scale::Log => {
                let decades = max.log10() - min.log10();
                let steps: &[f64] = match decades {
                    d if d < 0.9 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
                    d if d < 2.2 => &[1.0, 2.0, 5.0],
                    _ => &[1.0],
                };
                let (first, last) = (min.log10().floor() as i32, max.log10().ceil() as i32);
                let values = (first..=last).flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
                values.filter(within).map(|value| (value, number(value))).collect()
            }
        }
    }
}

fn linear_step(width: f64) -> f64 {
    let rough = width / 6.0;
    let decade = 10f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|step| step * decade).into_iter().find(|step| *step >= rough).unwrap_or(decade)
}

/// A tick's value without the digits that rounding leaves.
fn number(value: f64) -> String {
    let rounded = format!("{value:.3}");
    let short = rounded.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        let told = |axis: Axis| axis.ticks().into_iter().map(|(_, told)| told).collect::<Vec<_>>().join(" ");
        assert_eq!(told(Axis { range: (0.5, 3.2), ..Axis::log("", [], (1.0, 1.0)) }), "0.5 0.7 1 1.5 2 3");
        assert_eq!(told(Axis { range: (1.0, 900.0), ..Axis::log("", [], (1.0, 1.0)) }), "1 10 100");
        assert_eq!(told(Axis::linear("", (-1.0, 2.0))), "-1 -0.5 0 0.5 1 1.5 2");
        assert_eq!(told(Axis::rows(vec!["a".to_owned(), "b".to_owned()])), "a b");
    }
}
