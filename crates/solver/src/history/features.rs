//! Memories of earlier outputs.

use super::super::forces::instant_features;
use super::Series;
use serde::{Deserialize, Serialize};

/// Memories that are tried together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MemorySet {
    /// Part of the time constants that is used, from the shortest on.
    means: f64,
    /// Whether outputs with play are used.
    pub has_play: bool,
}

/// Sets that are tried. The first has no memory.
pub(super) const MEMORIES: [MemorySet; 5] = [
    MemorySet { means: 0.0, has_play: false },
    MemorySet { means: 0.5, has_play: false },
    MemorySet { means: 1.0, has_play: false },
    MemorySet { means: 0.0, has_play: true },
    MemorySet { means: 1.0, has_play: true },
];

/// Ratio of one time constant to the next.
const RATIO: f64 = 10.0;

/// Longest time constant, as a part of the series, and the shortest one as a part of the longest.
const LONGEST: f64 = 0.1;
const SHORTEST: f64 = 1e-3;

/// Half-widths of play, in standard deviations of an output.
const PLAYS: [f64; 2] = [0.3, 1.0];

/// Largest gap between two readings, as a multiple of the usual one.
pub(crate) const GAP_MOST: f64 = 10.0;

/// Outputs scaled to mean 0 and standard deviation 1.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Scale {
    means: Vec<f64>,
    /// Reciprocal of each standard deviation; 0 for an output that never changes.
    over_sd: Vec<f64>,
}

impl Scale {
    pub(super) fn of(series: &Series) -> Scale {
        let (rows, channels) = (series.rows() as f64, series.channels);
        let mut means = vec![0.0; channels];
        let mut variances = vec![0.0; channels];
        for row in 0..series.rows() {
            means.iter_mut().zip(series.row(row)).for_each(|(mean, output)| *mean += output / rows);
        }
        for row in 0..series.rows() {
            let off = series.row(row).iter().zip(&means).map(|(output, mean)| (output - mean).powi(2) / rows);
            variances.iter_mut().zip(off).for_each(|(variance, off)| *variance += off);
        }
        let over_sd = variances.into_iter().map(|variance| if variance > 0.0 { 1.0 / variance.sqrt() } else { 0.0 });
        Scale { means, over_sd: over_sd.collect() }
    }

    pub(super) fn channels(&self) -> usize {
        self.means.len()
    }

    pub(super) fn is_sound(&self) -> bool {
        self.means.len() == self.over_sd.len()
            && self.means.iter().chain(&self.over_sd).all(|number| number.is_finite())
    }

    pub(super) fn scaled(&self, outputs: &[f64]) -> Vec<f64> {
        let each = outputs.iter().zip(&self.means).zip(&self.over_sd);
        each.map(|((output, mean), over_sd)| (output - mean) * over_sd).collect()
    }
}

/// What is remembered of earlier readings. In a file it is empty.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Memory {
    /// Time constants of the means, s.
    pub taus_s: Vec<f64>,
    plays: Vec<f64>,
    /// Longest gap after which the memory is still of use, s.
    gap_s: f64,
    /// Number of features of the newest reading, which come first.
    pub instant: usize,
    /// Time of the last reading, s.
    #[serde(skip)]
    pub before_s: Option<f64>,
    /// Row-major, outputs x time constants, and outputs x plays; empty before the first reading.
    #[serde(skip)]
    means: Vec<f64>,
    #[serde(skip)]
    played: Vec<f64>,
}

impl Memory {
    /// Creates an empty memory for series like this one.
    pub(super) fn of(set: &MemorySet, series: &Series) -> Memory {
        let interval_s = series.interval_s();
        let longest_s = LONGEST * series.span_s();
        let shortest_s = (2.0 * interval_s).max(SHORTEST * longest_s);
        let all: Vec<f64> = std::iter::successors(Some(shortest_s), |tau_s| Some(RATIO * tau_s))
            .take_while(|tau_s| *tau_s <= longest_s)
            .collect();
        let taus_s = all[..(set.means * all.len() as f64).round() as usize].to_vec();
        let plays = if set.has_play { PLAYS.to_vec() } else { Vec::new() };
        let (gap_s, instant) = (GAP_MOST * interval_s, instant_features(series.row(0)).len());
        Memory { taus_s, plays, gap_s, instant, before_s: None, means: Vec::new(), played: Vec::new() }
    }

    /// Whether the numbers are those of a memory for this number of outputs.
    pub(super) fn is_sound(&self, channels: usize) -> bool {
        let mut lengths = self.taus_s.iter().chain(&self.plays).chain([&self.gap_s]);
        lengths.all(|length| length.is_finite() && *length > 0.0)
            && self.instant == instant_features(&vec![0.0; channels]).len()
    }

    /// Number of features for this number of outputs.
    pub(super) fn width(&self, channels: usize) -> usize {
        self.instant + channels * (self.taus_s.len() + self.plays.len())
    }

    /// Returns the gap before a reading, s, if it is too long for this memory.
    pub(super) fn gap_s(&self, t_s: f64) -> Option<f64> {
        let has_memory = !self.taus_s.is_empty() || !self.plays.is_empty();
        self.before_s.map(|before_s| t_s - before_s).filter(|_| has_memory && self.begins_again(t_s))
    }

    /// Whether this is the first reading, or the time to the one before is too long for a memory.
    pub(super) fn begins_again(&self, t_s: f64) -> bool {
        self.before_s.is_none_or(|before_s| (t_s - before_s).abs() > self.gap_s)
    }

    /// Takes a reading of scaled outputs, and returns its features: the outputs, their squares and products with each other, and the memories.
    /// A memory is the output minus its mean, which forgets with a time constant, or minus the output with play. After a long gap the memory
    /// begins again.
    pub(super) fn features(&mut self, t_s: f64, now: &[f64]) -> Vec<f64> {
        let before_s = if self.begins_again(t_s) { None } else { self.before_s };
        if before_s.is_none() {
            let each = |times: usize| now.iter().flat_map(|output| vec![*output; times]).collect();
            (self.means, self.played) = (each(self.taus_s.len()), each(self.plays.len()));
        }
        let passed_s = before_s.map_or(0.0, |before_s| t_s - before_s);
        self.before_s = Some(t_s);
        let mut features = instant_features(now);
        for (channel, output) in now.iter().enumerate() {
            for (nth, tau_s) in self.taus_s.iter().enumerate() {
                let mean = &mut self.means[channel * self.taus_s.len() + nth];
                *mean = output + (*mean - output) * (-passed_s / tau_s).exp();
                features.push(output - *mean);
            }
            for (nth, width) in self.plays.iter().enumerate() {
                let play = &mut self.played[channel * self.plays.len() + nth];
                *play = play.max(output - width).min(output + width);
                features.push(output - *play);
            }
        }
        features
    }
}
