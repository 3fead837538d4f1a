//! Regression from the outputs of an array to the three components of a force, without a place.
//!
//! A sensor with a single taxel, or one that is always pressed at the same place, has no map to invert. Four methods are fitted, and each
//! component of the answer is their weighted mean. The weights are those that are best on groups of rows that were left out.

pub(crate) mod folds;
mod ridge;
mod weights;

use super::extra_trees::Forest;
use super::hyperparameters::Hyperparameters;
use super::process::Process;
use folds::{folds, without};
use palpate_core::quantity::stream;
use rand::seq::SliceRandom as _;
use ridge::{Features, Fold, Ridge, linear, quadratic};
use serde::{Deserialize, Serialize};
use weights::{METHODS, MethodWeights};

/// Least number of rows for a regression.
const ROWS_LEAST: usize = 30;

/// Largest number of rows from which trees are grown, and from which they are grown to choose the weights.
const TREE_ROWS: usize = 30_000;
const TREE_ROWS_TO_CHOOSE: usize = 4000;

/// The same for the Gaussian process, whose cost grows with the cube of this number.
const PROCESS_ROWS: usize = 1500;
const PROCESS_ROWS_TO_CHOOSE: usize = 600;

/// Largest number of groups that are left out one by one. More groups are left out together, in this many parts.
const OUTER_FOLDS: usize = 20;

/// Number of parts in which groups are left out to choose the weights.
const INNER_FOLDS: usize = 5;

/// Rows of outputs with the force vector that caused each.
#[derive(Clone, Debug)]
pub struct ForceTable {
    channels: usize,
    /// Row-major, rows x channels.
    outputs: Vec<f64>,
    forces_n: Vec<[f64; 3]>,
    /// Group of each row. The rows of a group are left out together.
    groups: Vec<u64>,
}

/// Reason why forces can't be regressed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ForceTableError {
    /// Too few rows.
    #[error("{rows} rows have a force vector, at least {ROWS_LEAST} are needed, also without each group")]
    TooFew {
        /// Number of rows.
        rows: usize,
    },
    /// Nothing to leave out.
    #[error("all rows are of one group, so none can be left out")]
    OneGroup,
    /// No output changes.
    #[error("no output changes, so nothing shows the force")]
    Constant,
    /// A number isn't finite, or a row has another number of outputs.
    #[error("row {row} has another number of outputs, or a number that isn't finite")]
    Row {
        /// The row, from 0.
        row: usize,
    },
}

impl ForceTable {
    /// Creates a table from its rows: outputs, forces along x, y and the press in N, and group.
    ///
    /// # Errors
    /// The rows can't be regressed.
    pub fn new<'a>(rows: impl Iterator<Item = (&'a [f64], [f64; 3], u64)>) -> Result<ForceTable, ForceTableError> {
        let mut table = ForceTable { channels: 0, outputs: Vec::new(), forces_n: Vec::new(), groups: Vec::new() };
        for (row, (outputs, force_n, group)) in rows.enumerate() {
            if row == 0 {
                table.channels = outputs.len();
            }
            let is_sound = outputs.len() == table.channels && outputs.iter().chain(&force_n).all(|n| n.is_finite());
            if !is_sound || outputs.is_empty() {
                return Err(ForceTableError::Row { row });
            }
            table.outputs.extend_from_slice(outputs);
            table.forces_n.push(force_n);
            table.groups.push(group);
        }
        if table.forces_n.len() < ROWS_LEAST {
            return Err(ForceTableError::TooFew { rows: table.forces_n.len() });
        }
        if (1..table.rows()).all(|row| table.row(row) == table.row(0)) {
            return Err(ForceTableError::Constant);
        }
        Ok(table)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.forces_n.len()
    }

    fn row(&self, row: usize) -> &[f64] {
        &self.outputs[row * self.channels..(row + 1) * self.channels]
    }
}

/// Errors of one component.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ComponentErrors {
    /// Mean of the absolute error, N.
    pub mean_n: f64,
    /// Root of the mean squared error, N.
    pub rmse_n: f64,
    /// 95th percentile of the absolute error, N.
    pub p95_n: f64,
}

/// Errors of a method on rows that it was fitted without.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodForceErrors {
    /// The method; `best` is the weighted mean.
    pub method: &'static str,
    /// Errors along x, y and the press.
    pub components: [ComponentErrors; 3],
}

/// Errors of all methods on left-out groups.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ForceEvaluation {
    /// Number of rows.
    pub rows: usize,
    /// Number of parts that were left out in turn.
    pub folds: usize,
    /// Each method, `best` first.
    pub methods: Vec<MethodForceErrors>,
}

/// Fitted regression of a force vector.
pub struct ForceRegression {
    features: Features,
    methods: FittedMethods,
    weights: [MethodWeights; 3],
}

/// The methods of [`METHODS`].
struct FittedMethods {
    linear: Ridge,
    quadratic: Ridge,
    /// Gaussian process of what the linear regression leaves.
    process: Process,
    trees: [Forest; 3],
}

impl ForceRegression {
    /// Fits the four methods and their weights.
    pub fn fit(table: &ForceTable) -> ForceRegression {
        let all: Vec<usize> = (0..table.rows()).collect();
        ForceRegression::fit_rows(table, &all)
    }

    fn fit_rows(table: &ForceTable, rows: &[usize]) -> ForceRegression {
        let features = Features::of(table, rows);
        let parts = folds(table, rows, INNER_FOLDS, false);
        let fold = Fold::of(&features, table, rows, &parts);
        let (linear, linear_without) = fold.fit(true);
        let (quadratic, quadratic_without) = fold.fit(false);
        // one correlation does for all parts: its search costs more than a fit
        let seen = left(&features, table, &some(rows, super::gaussian_process::MANNER.most_to_seek_with), &linear);
        let hyperparameters =
            Hyperparameters::of(&seen.0, features.channels(), &seen.1, 3, super::gaussian_process::MANNER);
        let process = |linear: &Ridge, rows: &[usize]| {
            let (inputs, values) = left(&features, table, rows, linear);
            Process::fit(inputs, features.channels(), &values, 3, &hyperparameters, 3).0
        };
        // what the methods answer for the rows of each part without it
        let mut left_out = vec![[[0.0; 3]; METHODS.len()]; rows.len()];
        for (part, (linear, quadratic)) in parts.iter().zip(linear_without.into_iter().zip(quadratic_without)) {
            let training = without(rows, part);
            let process = process(&linear, &some(&training, PROCESS_ROWS_TO_CHOOSE));
            let trees = forests(&features, table, &some(&training, TREE_ROWS_TO_CHOOSE));
            let methods = FittedMethods { linear, quadratic, process, trees };
            part.iter().for_each(|&at| left_out[at] = methods.answers(&features.standard(table.row(rows[at]))));
        }
        let weights = [0, 1, 2].map(|component| {
            let answers = left_out.iter().map(|answers| answers.map(|answer| answer[component]));
            MethodWeights::of(answers.zip(rows.iter().map(|&row| table.forces_n[row][component])))
        });
        let (process, trees) =
            (process(&linear, &some(rows, PROCESS_ROWS)), forests(&features, table, &some(rows, TREE_ROWS)));
        ForceRegression { features, methods: FittedMethods { linear, quadratic, process, trees }, weights }
    }

    /// Returns the force along x, y and the press that caused a reading, N.
    pub fn solve(&self, outputs: &[f64]) -> [f64; 3] {
        self.weighted(self.methods.answers(&self.features.standard(outputs)))
    }

    fn weighted(&self, answers: [[f64; 3]; METHODS.len()]) -> [f64; 3] {
        [0, 1, 2].map(|component| self.weights[component].of_answers(answers.map(|answer| answer[component])))
    }
}

impl FittedMethods {
    /// Returns the answer of each method to scaled outputs.
    fn answers(&self, standard: &[f64]) -> [[f64; 3]; METHODS.len()] {
        let linear_n = self.linear.of(&linear(standard));
        let mut left_n = [0.0; 3];
        self.process.predict(standard, &mut left_n);
        let with_process_n = [0, 1, 2].map(|component| linear_n[component] + left_n[component]);
        let trees_n = self.trees.each_ref().map(|forest| forest.answer(standard));
        [linear_n, self.quadratic.of(&quadratic(standard)), with_process_n, trees_n]
    }
}

/// Fits without each group in turn and solves its rows. The weights are chosen without the group, too.
///
/// # Errors
/// There is only one group.
pub fn evaluate_forces(table: &ForceTable) -> Result<ForceEvaluation, ForceTableError> {
    let all: Vec<usize> = (0..table.rows()).collect();
    if table.groups.iter().all(|group| *group == table.groups[0]) {
        return Err(ForceTableError::OneGroup);
    }
    let parts = folds(table, &all, OUTER_FOLDS, true);
    let rows = parts.iter().map(|part| all.len() - part.len()).min().unwrap_or(0);
    if rows < ROWS_LEAST {
        return Err(ForceTableError::TooFew { rows });
    }
    let mut errors: Vec<Vec<[f64; 3]>> = vec![Vec::with_capacity(table.rows()); METHODS.len() + 1];
    for part in &parts {
        let regression = ForceRegression::fit_rows(table, &without(&all, part));
        for &row in part {
            let answers = regression.methods.answers(&regression.features.standard(table.row(row)));
            let best = regression.weighted(answers);
            let true_n = table.forces_n[row];
            for (errors, answer) in errors.iter_mut().zip(std::iter::once(best).chain(answers)) {
                errors.push([0, 1, 2].map(|component| answer[component] - true_n[component]));
            }
        }
    }
    let names = std::iter::once(super::BEST).chain(METHODS);
    let method = |(method, errors): (&'static str, &Vec<[f64; 3]>)| MethodForceErrors {
        method,
        components: [0, 1, 2].map(|component| ComponentErrors::of(errors.iter().map(|error| error[component]))),
    };
    Ok(ForceEvaluation { rows: table.rows(), folds: parts.len(), methods: names.zip(&errors).map(method).collect() })
}

/// Linear regression of the force along the press from features of a series, whose ridge is chosen on left-out parts.
#[derive(Serialize, Deserialize)]
pub(super) struct SeriesFit {
    features: Features,
    ridge: Ridge,
    /// Least and largest value of each feature that was fitted.
    ranges: Vec<[f64; 2]>,
}

impl SeriesFit {
    /// Fits some rows, and returns the mean squared error of each part by the fit without it.
    pub(super) fn of(table: &ForceTable, rows: &[usize], parts: &[Vec<usize>]) -> (SeriesFit, Vec<f64>) {
        let features = Features::of(table, rows);
        let (ridge, without_each) = Fold::of(&features, table, rows, parts).fit(true);
        let square = |ridge: &Ridge, row: usize| {
            (ridge.of(&linear(&features.standard(table.row(row))))[PRESS] - table.forces_n[row][PRESS]).powi(2)
        };
        let squares = parts.iter().zip(&without_each).map(|(part, ridge)| {
            part.iter().map(|&at| square(ridge, rows[at])).sum::<f64>() / part.len().max(1) as f64
        });
        let squares = squares.collect();
        let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; table.channels];
        for &row in rows {
            let each = ranges.iter_mut().zip(table.row(row));
            each.for_each(|([least, most], value)| (*least, *most) = (least.min(*value), most.max(*value)));
        }
        (SeriesFit { features, ridge, ranges }, squares)
    }

    /// Whether the numbers are finite, and as many as this number of features needs.
    pub(super) fn is_sound(&self, features: usize) -> bool {
        let is_range = |[least, most]: &[f64; 2]| least.is_finite() && most.is_finite() && least <= most;
        self.features.is_sound(features)
            && self.ridge.is_sound(features + 1)
            && self.ranges.len() == features
            && self.ranges.iter().all(is_range)
    }

    /// Returns the error of the force of a row, N.
    pub(super) fn error_n(&self, table: &ForceTable, row: usize) -> f64 {
        self.answer_n(table.row(row), 0) - table.forces_n[row][PRESS]
    }

    /// Returns the force of features, N. Memories are known only within what was fitted, so they count no further.
    pub(super) fn answer_n(&self, features: &[f64], instant: usize) -> f64 {
        let within = |(nth, (value, [least, most])): (usize, (&f64, &[f64; 2]))| {
            if nth < instant { *value } else { value.clamp(*least, *most) }
        };
        let features: Vec<f64> = features.iter().zip(&self.ranges).enumerate().map(within).collect();
        self.ridge.of(&linear(&self.features.standard(&features)))[PRESS]
    }
}

/// Component of the force along the press.
const PRESS: usize = 2;

/// Features of scaled outputs without memory: the outputs, their squares and products.
pub(super) fn instant_features(standard: &[f64]) -> Vec<f64> {
    quadratic(standard).split_off(1)
}

impl ComponentErrors {
    pub(super) fn of(errors_n: impl Iterator<Item = f64>) -> ComponentErrors {
        let mut sizes: Vec<f64> = errors_n.map(f64::abs).collect();
        sizes.sort_by(f64::total_cmp);
        let count = sizes.len().max(1) as f64;
        let mean_n = sizes.iter().sum::<f64>() / count;
        let rmse_n = (sizes.iter().map(|size| size * size).sum::<f64>() / count).sqrt();
        let p95_n = sizes.get((0.95 * count) as usize).copied().unwrap_or_default();
        ComponentErrors { mean_n, rmse_n, p95_n }
    }
}

/// Returns at most this many of the rows, chosen at random.
fn some(rows: &[usize], most: usize) -> Vec<usize> {
    if rows.len() <= most {
        return rows.to_vec();
    }
    let mut chosen = rows.to_vec();
    let (chosen, _) = chosen.partial_shuffle(&mut stream(0, 0, "rows of a force regression"), most);
    chosen.to_vec()
}

/// Returns the scaled outputs of rows, and what a linear regression leaves of their forces.
fn left(features: &Features, table: &ForceTable, rows: &[usize], ridge: &Ridge) -> (Vec<f64>, Vec<f64>) {
    let (mut inputs, mut values) = (Vec::new(), Vec::new());
    for &row in rows {
        let standard = features.standard(table.row(row));
        let (answer, true_n) = (ridge.of(&linear(&standard)), table.forces_n[row]);
        values.extend([0, 1, 2].map(|component| true_n[component] - answer[component]));
        inputs.extend(standard);
    }
    (inputs, values)
}

/// Grows trees for each component.
fn forests(features: &Features, table: &ForceTable, rows: &[usize]) -> [Forest; 3] {
    let mut columns = vec![Vec::with_capacity(rows.len()); features.channels()];
    for &row in rows {
        columns.iter_mut().zip(features.standard(table.row(row))).for_each(|(column, value)| column.push(value));
    }
    let forces_n: Vec<[f64; 3]> = rows.iter().map(|&row| table.forces_n[row]).collect();
    Forest::grow(columns, forces_n)
}

#[cfg(test)]
mod tests;
