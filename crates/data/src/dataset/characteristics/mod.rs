//! Characteristics of each unit from load/unload staircases: repeatability, hysteresis, linearity, zero return.
//!
//! The paper gives no definitions for its Table 1. This program's definitions are in [`terms`], and are printed next to the
//! numbers. A recipe may press several staircases at a place, at several places per unit and up to several forces. Staircases at
//! one place up to one force repeat each other and form a series. Each series is evaluated separately. A unit gets the pooled
//! repeatability of its series, and the worst value of each other quantity.

mod estimate;
mod repeatability;
mod series;
mod staircases;
pub mod terms;

pub use estimate::RepeatUncertainty;
pub use repeatability::Repeatability;
pub use staircases::{HeldLevel, LevelMicronewton, Staircases, by_series, repeats};

use estimate::RepeatMean;
use palpate_control::Branch;
use repeatability::{Levels, Repeated};
use series::CorrectedSeries;

/// Characteristics of one unit, in % of full scale unless the name states otherwise; `None` if the readings don't determine them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UnitCharacteristics {
    /// Number of the unit, from 1.
    pub unit: usize,
    /// The channel, from 1, where the unit has several.
    pub channel: Option<usize>,
    /// Repeatability of loading outputs.
    pub repeatability_loading_percent: Option<f64>,
    /// 95 % interval of the true repeatability while loading.
    pub repeatability_loading_interval_percent: Option<(f64, f64)>,
    /// Repeatability of unloading outputs.
    pub repeatability_unloading_percent: Option<f64>,
    /// 95 % interval of the true repeatability while unloading.
    pub repeatability_unloading_interval_percent: Option<(f64, f64)>,
    /// Difference between unloading and loading.
    pub hysteresis_percent: Option<f64>,
    /// Uncertainty of the hysteresis, %.
    pub hysteresis_known: Option<RepeatUncertainty>,
    /// Difference between unloading and loading, % of the mean reading at the same force.
    pub hysteresis_of_reading_percent: Option<f64>,
    /// Uncertainty of this hysteresis, %.
    pub hysteresis_of_reading_known: Option<RepeatUncertainty>,
    /// Deviation of loading outputs from a straight line.
    pub linearity_percent: Option<f64>,
    /// Uncertainty of the linearity, %.
    pub linearity_known: Option<RepeatUncertainty>,
    /// Output without load after the load minus output without load before the load.
    pub zero_return_percent: Option<f64>,
    /// Uncertainty of the zero return, %.
    pub zero_return_known: Option<RepeatUncertainty>,
}

impl UnitCharacteristics {
    /// Returns the 95 % interval of the repeatability on a branch.
    pub fn repeatability_interval_percent(&self, branch: Branch) -> Option<(f64, f64)> {
        match branch {
            Branch::Loading => self.repeatability_loading_interval_percent,
            Branch::Unloading => self.repeatability_unloading_interval_percent,
        }
    }

    /// Whether no characteristic of the unit was measured.
    pub fn is_none(&self) -> bool {
        *self == UnitCharacteristics { unit: self.unit, channel: self.channel, ..UnitCharacteristics::default() }
    }

    /// The unit as it is shown: `14`, or `14.2` for its second channel.
    pub fn name(&self) -> String {
        self.channel.map_or_else(|| self.unit.to_string(), |channel| format!("{}.{channel}", self.unit))
    }
}

/// Returns the characteristics, one row for each unit. Every characteristic needs an output other than 0 at the top force. A
/// repeatability needs two repeats of a level. A hysteresis needs a level between zero and the top force on both branches. A
/// linearity needs three levels. A zero return needs the readings without load before and after.
pub fn characterise(staircases: &Staircases, repeatability: Repeatability) -> Vec<UnitCharacteristics> {
    let series: Vec<Vec<CorrectedSeries>> = staircases
        .readings
        .iter()
        .map(|readings| by_series(readings).iter().filter_map(|readings| CorrectedSeries::of(readings)).collect())
        .collect();
    let own: Vec<Option<f64>> = series.iter().map(|series| full_scale(series)).collect();
    // the channels of a unit share the scale of the one with the largest output: another may hardly read a load from above
    let of_unit = |unit: usize| {
        let its = staircases.units.iter().zip(&own).filter(move |(its, _)| **its == unit);
        its.filter_map(|(_, own)| *own).reduce(f64::max)
    };
    let characterised = staircases.units.iter().enumerate().map(|(index, &unit)| {
        let full_scale = of_unit(unit);
        let of_scale = |full_scale| characterise_channel(&series[index], full_scale, repeatability);
        let mut found = full_scale.map(of_scale).unwrap_or_default();
        (found.unit, found.channel) = (unit + 1, channel(&staircases.units, index));
        if own[index] != full_scale {
            (found.hysteresis_of_reading_percent, found.hysteresis_of_reading_known) = (None, None);
        }
        found
    });
    characterised.collect()
}

/// Returns the channel of an output within its unit, from 1; `None` for a unit with one channel.
fn channel(units: &[usize], index: usize) -> Option<usize> {
    let count = |among: &[usize]| among.iter().filter(|unit| **unit == units[index]).count();
    (count(units) > 1).then(|| 1 + count(&units[..index]))
}

fn characterise_channel(
    series: &[CorrectedSeries],
    full_scale: f64,
    repeatability: Repeatability,
) -> UnitCharacteristics {
    let percent = |value: f64| 100.0 * value / full_scale;
    let repeats = |branch| {
        let repeated = repeatability.of(&series.iter().map(|series| series.levels(branch)).collect::<Vec<Levels>>());
        let value = repeated.map(|Repeated { value, .. }| percent(value));
        let interval = repeated.and_then(|Repeated { interval, .. }| interval);
        (value, interval.map(|(least, most)| (percent(least), percent(most))))
    };
    let (loading, unloading) = (repeats(Branch::Loading), repeats(Branch::Unloading));
    let worst = |estimates: &mut dyn Iterator<Item = RepeatMean>| estimates.reduce(RepeatMean::worse);
    let gaps = || series.iter().filter_map(CorrectedSeries::hysteresis);
    let of_full_scale = |estimate: Option<RepeatMean>| estimate.map(|estimate| estimate.scaled(100.0 / full_scale));
    let hysteresis = of_full_scale(worst(&mut gaps().map(|(gap, _)| gap)));
    let of_reading = worst(&mut gaps().map(|(_, share)| share)).map(|share| share.scaled(100.0));
    let linearity = of_full_scale(worst(&mut series.iter().filter_map(CorrectedSeries::deviation)));
    let zero_return = of_full_scale(worst(&mut series.iter().filter_map(CorrectedSeries::zero_return)));
    let value = |estimate: Option<RepeatMean>| estimate.map(|estimate| estimate.value);
    let known = |estimate: Option<RepeatMean>| estimate.and_then(|estimate| estimate.known);
    UnitCharacteristics {
        repeatability_loading_percent: loading.0,
        repeatability_loading_interval_percent: loading.1,
        repeatability_unloading_percent: unloading.0,
        repeatability_unloading_interval_percent: unloading.1,
        hysteresis_percent: value(hysteresis),
        hysteresis_known: known(hysteresis),
        hysteresis_of_reading_percent: value(of_reading),
        hysteresis_of_reading_known: known(of_reading),
        linearity_percent: value(linearity),
        linearity_known: known(linearity),
        zero_return_percent: value(zero_return),
        zero_return_known: known(zero_return),
        ..UnitCharacteristics::default()
    }
}

/// Magnitude of the mean loading output at the largest set force, at the place where this output is largest; `None` if it is 0.
fn full_scale(series: &[CorrectedSeries]) -> Option<f64> {
    let (top, _) = series.iter().map(CorrectedSeries::top).max_by_key(|(top, _)| *top)?;
    let at_top = series.iter().map(CorrectedSeries::top).filter(|(level, _)| *level == top);
    at_top.map(|(_, output)| output.abs()).reduce(f64::max).filter(|full_scale| *full_scale > 0.0)
}

#[cfg(test)]
mod tests;
