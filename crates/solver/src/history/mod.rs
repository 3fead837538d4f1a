//! Force from readings over time: what earlier readings add to the newest.
//!
//! A skin that creeps answers a force later, and one with hysteresis answers by its way there. So the force follows from the newest outputs
//! and from memories of earlier ones: means that forget with a time constant, and outputs with play. Which memories help is decided by
//! blocks of time that were left out. Only memories that lower the error clearly are used.

mod features;
mod regression;

pub(crate) use features::GAP_MOST;
pub use regression::{HISTORY_METHOD, HistoryRegression, HistorySession};

use super::forces::folds::{blocks, without};
use super::forces::{ComponentErrors, ForceTable, ForceTableError, SeriesFit};
use features::{MEMORIES, Memory, MemorySet, Scale};
use serde::Serialize;

/// Least number of readings, and of blocks that are left out.
const ROWS_LEAST: usize = 200;
const BLOCKS: usize = 10;

/// Largest number of readings that are regressed. Of more readings every second, third and so on is; the memories know them all.
const ROWS_MOST: usize = 10_000;

/// Number of blocks that the reported errors come from; each is solved by a regression that never saw it.
const OUTER_BLOCKS: usize = 5;

/// Memories are used only if they lower the error by this share, and by this many standard errors over the blocks.
const GAIN_LEAST: f64 = 0.03;
const SURE: f64 = 2.5;

/// Readings over time, each with the force that caused it.
#[derive(Clone, Debug)]
pub struct Series {
    t_s: Vec<f64>,
    channels: usize,
    /// Row-major, readings x channels.
    outputs: Vec<f64>,
    force_n: Vec<f64>,
}

/// Reason why a series can't be evaluated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SeriesError {
    /// Too few readings.
    #[error("{rows} readings with a time and a force, at least {ROWS_LEAST} are needed")]
    TooFew {
        /// Number of readings.
        rows: usize,
    },
    /// Times don't increase.
    #[error("reading {row} isn't later than the one before")]
    Order {
        /// The reading, from 0.
        row: usize,
    },
    /// The numbers can't be regressed.
    #[error(transparent)]
    Table(#[from] ForceTableError),
}

/// Errors with and without memories, on blocks of time that were left out in turn.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HistoryEvaluation {
    /// Number of readings.
    pub rows: usize,
    /// Time from the first to the last, s.
    pub span_s: f64,
    /// Number of blocks that were left out in turn.
    pub blocks: usize,
    /// Errors by the newest reading alone.
    pub newest: ComponentErrors,
    /// Errors with memories, also if they aren't used.
    pub with_memories: ComponentErrors,
    /// Errors of what is used.
    pub used: ComponentErrors,
    /// The memories.
    #[serde(flatten)]
    pub choice: MemoryChoice,
}

/// The best memories for a series.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MemoryChoice {
    /// Whether they lower the error clearly, so that they are used.
    pub is_used: bool,
    /// Share by which they lower the root mean squared error on blocks of time that were left out.
    pub lower_by: f64,
    /// Shortest and longest time constant of the means, s; `None` without means.
    pub memory_s: Option<[f64; 2]>,
    /// Whether outputs with play are among them.
    pub has_play: bool,
}

impl Series {
    /// Creates a series from its readings: time, s, outputs, and force, N.
    ///
    /// # Errors
    /// The readings can't be used.
    pub fn new<'a>(rows: impl Iterator<Item = (f64, &'a [f64], f64)>) -> Result<Series, SeriesError> {
        let mut series = Series { t_s: Vec::new(), channels: 0, outputs: Vec::new(), force_n: Vec::new() };
        for (row, (t_s, outputs, force_n)) in rows.enumerate() {
            if row == 0 {
                series.channels = outputs.len();
            }
            let is_sound = outputs.len() == series.channels && !outputs.is_empty();
            if !is_sound || !outputs.iter().chain([&t_s, &force_n]).all(|number| number.is_finite()) {
                return Err(ForceTableError::Row { row }.into());
            }
            if series.t_s.last().is_some_and(|before_s| t_s <= *before_s) {
                return Err(SeriesError::Order { row });
            }
            series.t_s.push(t_s);
            series.outputs.extend_from_slice(outputs);
            series.force_n.push(force_n);
        }
        match series.t_s.len() {
            rows if rows < ROWS_LEAST => Err(SeriesError::TooFew { rows }),
            _ => Ok(series),
        }
    }

    fn rows(&self) -> usize {
        self.t_s.len()
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.outputs[row * self.channels..(row + 1) * self.channels]
    }

    /// Time from the first to the last reading, s.
    fn span_s(&self) -> f64 {
        self.t_s[self.rows() - 1] - self.t_s[0]
    }

    /// Usual time between two readings, s.
    fn interval_s(&self) -> f64 {
        let mut gaps: Vec<f64> = self.t_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        gaps.sort_by(f64::total_cmp);
        gaps[gaps.len() / 2]
    }
}

/// Evaluates whether earlier readings lower the error of a force. Each block of time is solved by a regression without it, whose memories
/// were chosen without it, too.
///
/// # Errors
/// The readings can't be regressed.
pub fn evaluate_history(series: &Series) -> Result<HistoryEvaluation, SeriesError> {
    let tables = tables(series)?;
    let all = all_rows(&tables[0]);
    let mut errors_n: [Vec<f64>; 3] = Default::default();
    for part in blocks(all.len(), OUTER_BLOCKS) {
        let training = without(&all, &part);
        let choice = Choice::of(&tables, &training);
        for (set, errors_n) in [0, choice.set, choice.used()].into_iter().zip(&mut errors_n) {
            let fit = &choice.fits[set];
            errors_n.extend(part.iter().map(|&row| fit.error_n(&tables[set], row)));
        }
    }
    let [newest, with_memories, used] = errors_n.map(|errors_n| ComponentErrors::of(errors_n.into_iter()));
    Ok(HistoryEvaluation {
        rows: series.rows(),
        span_s: series.span_s(),
        blocks: OUTER_BLOCKS,
        newest,
        choice: Choice::of(&tables, &all).memories(series, [newest.rmse_n, with_memories.rmse_n]),
        with_memories,
        used,
    })
}

/// Choice of memories by blocks of some rows that were left out in turn.
struct Choice {
    /// The best set of memories, in [`MEMORIES`], other than none.
    set: usize,
    is_used: bool,
    /// Fit of each set to all the rows.
    fits: Vec<SeriesFit>,
    /// Root of the mean squared error of all blocks, by the newest readings alone and with the best memories, N.
    rmse_n: [f64; 2],
}

impl Choice {
    fn of(tables: &[ForceTable], rows: &[usize]) -> Choice {
        let parts = blocks(rows.len(), BLOCKS);
        // mean squared error of each block that was left out, for each set
        let (fits, squares): (Vec<SeriesFit>, Vec<Vec<f64>>) =
            tables.iter().map(|table| SeriesFit::of(table, rows, &parts)).unzip();
        let errors: Vec<Vec<f64>> =
            squares.iter().map(|squares| squares.iter().map(|square| square.sqrt()).collect()).collect();
        let sum = |errors: &[f64]| errors.iter().sum::<f64>();
        let best =
            (1..tables.len()).fold(1, |best, set| if sum(&errors[set]) < sum(&errors[best]) { set } else { best });
        // the simplest set that isn't clearly worse than the best holds best elsewhere
        let set = (1..best).find(|set| !is_lower(&errors[*set], &errors[best], 1.0)).unwrap_or(best);
        let is_used =
            sum(&errors[set]) < (1.0 - GAIN_LEAST) * sum(&errors[0]) && is_lower(&errors[0], &errors[set], SURE);
        let rmse_n = |set: usize| (squares[set].iter().sum::<f64>() / parts.len() as f64).sqrt();
        Choice { set, is_used, fits, rmse_n: [rmse_n(0), rmse_n(set)] }
    }

    /// Describes the best memories, by the errors without and with them.
    fn memories(&self, series: &Series, [newest_n, with_memories_n]: [f64; 2]) -> MemoryChoice {
        let taus_s = Memory::of(&MEMORIES[self.set], series).taus_s;
        MemoryChoice {
            is_used: self.is_used,
            lower_by: if newest_n > 0.0 { 1.0 - with_memories_n / newest_n } else { 0.0 },
            memory_s: taus_s.first().zip(taus_s.last()).map(|(first, last)| [*first, *last]),
            has_play: MEMORIES[self.set].has_play,
        }
    }

    /// The set that is used.
    fn used(&self) -> usize {
        if self.is_used { self.set } else { 0 }
    }
}

/// Whether the errors of blocks are lower than other ones, by some standard errors of their differences.
fn is_lower(errors_n: &[f64], than_n: &[f64], sure: f64) -> bool {
    let gains: Vec<f64> = errors_n.iter().zip(than_n).map(|(error_n, than_n)| error_n - than_n).collect();
    let count = gains.len() as f64;
    let gain = gains.iter().sum::<f64>() / count;
    let spread = gains.iter().map(|each| (each - gain).powi(2)).sum::<f64>() / (count - 1.0);
    gain > sure * (spread / count).sqrt()
}

/// Returns a table of features for each set of memories.
fn tables(series: &Series) -> Result<Vec<ForceTable>, SeriesError> {
    MEMORIES.iter().map(|set| table(series, set)).collect()
}

fn table(series: &Series, set: &MemorySet) -> Result<ForceTable, SeriesError> {
    let (scale, step) = (Scale::of(series), series.rows().div_ceil(ROWS_MOST));
    let mut memory = Memory::of(set, series);
    let mut rows = Vec::new();
    for row in 0..series.rows() {
        let features = memory.features(series.t_s[row], &scale.scaled(series.row(row)));
        if row % step == 0 {
            rows.push((features, [0.0, 0.0, series.force_n[row]]));
        }
    }
    Ok(ForceTable::new(rows.iter().map(|(features, force_n)| (features.as_slice(), *force_n, 0)))?)
}

fn all_rows(table: &ForceTable) -> Vec<usize> {
    (0..table.rows()).collect()
}

#[cfg(test)]
mod tests;
