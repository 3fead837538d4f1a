//! The result of one series: the staircases up to one force at one place.

use super::HeldLevel;
use super::estimate::RepeatMean;
use super::repeatability::Levels;
use super::staircases::LevelMicronewton;
use palpate_control::Branch;
use std::collections::BTreeMap;

/// Outputs of a series by level, corrected to the set force.
pub(super) struct CorrectedSeries {
    line: FittedLine,
    /// Corrected outputs by branch.
    corrected: [BTreeMap<LevelMicronewton, Vec<f64>>; 2],
    /// Outputs at 0 N by branch, as read. Without load there is no force to which they could be corrected.
    without_load: [Vec<f64>; 2],
    top: LevelMicronewton,
    /// Mean loading output at the largest set force with a reading.
    at_top: f64,
}

/// Straight line through loading outputs as a function of the load cell's force.
#[derive(Clone, Copy)]
struct FittedLine {
    /// Slope of the line, output units per N.
    slope: f64,
    /// Output at 0 N.
    intercept: f64,
}

impl CorrectedSeries {
    /// Evaluates readings. Returns `None` if the loading forces don't vary.
    pub(super) fn of(readings: &[HeldLevel]) -> Option<CorrectedSeries> {
        let line = FittedLine::through(readings)?;
        let mut corrected = [BTreeMap::new(), BTreeMap::new()];
        let mut without_load = [Vec::new(), Vec::new()];
        for reading in readings {
            let at_set_force = reading.output + line.slope * (reading.force_set_n - reading.force_n);
            let outputs: &mut Vec<f64> = corrected[reading.branch as usize].entry(reading.level()).or_default();
            outputs.push(at_set_force);
            if reading.level() == 0 {
                without_load[reading.branch as usize].push(reading.output);
            }
        }
        let (top, at_top) = corrected[Branch::Loading as usize].last_key_value()?;
        let (top, at_top) = (*top, mean(at_top));
        Some(CorrectedSeries { line, corrected, without_load, top, at_top })
    }

    /// Returns the largest set force with a reading, and the mean loading output there.
    pub(super) fn top(&self) -> (LevelMicronewton, f64) {
        (self.top, self.at_top)
    }

    /// Returns the outputs of a branch at each level except zero.
    pub(super) fn levels(&self, branch: Branch) -> Levels {
        let levels = self.corrected[branch as usize].iter();
        levels.filter(|(level, _)| **level > 0).map(|(_, outputs)| outputs.clone()).collect()
    }

    /// Returns the largest distance between the branches over the levels between zero and top force. Also returns the largest
    /// distance as a fraction of the mean of both branches.
    pub(super) fn hysteresis(&self) -> Option<(RepeatMean, RepeatMean)> {
        let [loading, unloading] = &self.corrected;
        let inner = loading.iter().filter(|(level, _)| **level > 0 && **level < self.top);
        let gaps = inner.filter_map(|(level, up)| {
            let down = unloading.get(level)?;
            let gap = RepeatMean::of_difference(up, down)?.magnitude();
            Some((gap, gap.scaled(1.0 / (0.5 * (mean(up) + mean(down))).abs())))
        });
        gaps.reduce(|worst, gap| (worst.0.worse(gap.0), worst.1.worse(gap.1)))
    }

    /// Returns the largest distance of a level's mean loading output from the line, zero level included. Returns `None` for fewer
    /// than three levels, because a line fits two exactly.
    pub(super) fn deviation(&self) -> Option<RepeatMean> {
        let [loading, _] = &self.corrected;
        let off = |(level, outputs): (&LevelMicronewton, &Vec<f64>)| {
            Some(RepeatMean::of(outputs)?.less(self.line.at(*level as f64 / 1e6)).magnitude())
        };
        if loading.len() > 2 { loading.iter().filter_map(off).reduce(RepeatMean::worse) } else { None }
    }

    /// Returns the mean output without load after the staircases minus the mean before them.
    pub(super) fn zero_return(&self) -> Option<RepeatMean> {
        let [before, after] = &self.without_load;
        if before.is_empty() || after.is_empty() { None } else { RepeatMean::of_difference(before, after) }
    }
}

impl FittedLine {
    /// Returns the least-squares line through all loading readings, with a free intercept; `None` if the force doesn't vary.
    fn through(readings: &[HeldLevel]) -> Option<FittedLine> {
        let loading = || readings.iter().filter(|reading| reading.branch == Branch::Loading);
        let mean_force = mean(&loading().map(|reading| reading.force_n).collect::<Vec<f64>>());
        let mean_output = mean(&loading().map(|reading| reading.output).collect::<Vec<f64>>());
        let deviation = |reading: &HeldLevel| reading.force_n - mean_force;
        let spread: f64 = loading().map(|reading| deviation(reading).powi(2)).sum();
        let common: f64 = loading().map(|reading| deviation(reading) * (reading.output - mean_output)).sum();
        let slope = common / spread;
        (spread > 0.0).then_some(FittedLine { slope, intercept: mean_output - slope * mean_force })
    }

    fn at(self, force_n: f64) -> f64 {
        self.intercept + self.slope * force_n
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
