//! Extremely randomised trees.

use super::gaussian_process::places_in_turn;
use super::method::EXTRA_TREES;
use super::view::{View, has_several_lengths};
use super::{Calibration, FitError, ForceKnown, Locate, LocatedContact, SolveError, Workspace};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::{Place, RandomStream, stream};
use rand::Rng;
use serde::{Deserialize, Serialize};

/// Extremely randomised trees (Geurts, Ernst and Wehenkel 2006). Each tree splits the presses by one coordinate after another, at
/// random thresholds. A tree's answer is the press at which the reading ends, and the result is the mean over all trees. A wrong
/// press affects only readings near it, and the scale of the outputs has no effect.
///
/// The coordinates are the reading divided by its length. If the amplitude may be used, the outputs and the logarithm of the
/// length are added.
#[derive(Serialize, Deserialize)]
pub(super) struct ExtraTrees {
    trees: Vec<Tree>,
    view: View,
    sees_amplitude: bool,
    load: ForceKnown,
    /// Force of the calibration if the load is constant, N.
    force_n: f64,
}

/// Nodes of a tree, the root first.
#[derive(Serialize, Deserialize)]
struct Tree {
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
enum Node {
    /// Coordinate that is compared, the threshold, the node for values below the threshold and the node for the others.
    Split {
        coordinate: u32,
        threshold: f64,
        below: u32,
        above: u32,
    },
    Leaf(LeafAnswer),
}

/// Answer: x and y, mm, and the logarithm of the force. If only the reading's direction is seen, the force is divided by a
/// quantity proportional to the reading.
type LeafAnswer = [f64; ANSWERS];
const ANSWERS: usize = 3;

const TREES: usize = 50;

/// Largest number of presses from which a tree is grown. If there are more, some are chosen at random.
const MOST_PRESSES: usize = 5000;

/// Number of coordinates that are tried at each split. If there are fewer, all are tried. If there are very many, twice the
/// square root of their number is tried.
const TRIED_COORDINATES: usize = 32;

/// Least spread of the trees that counts, mm.
const LEAST_SPREAD_MM: f64 = 1e-4;

impl ExtraTrees {
    pub(crate) fn fit(calibration: &Calibration, load: ForceKnown) -> Result<Self, FitError> {
        let view = View::of_direction(calibration);
        let sees_amplitude =
            load == ForceKnown::Constant || calibration.has_several_forces() || has_several_lengths(calibration);
        let force_n = calibration.typical_force_n();
        let mut forest = ExtraTrees { trees: Vec::new(), view, sees_amplitude, load, force_n };
        let mut grown = Grown { coordinates: Vec::new(), answers: Vec::new(), scale: [1.0; ANSWERS] };
        for press in places_in_turn(calibration).into_iter().take(MOST_PRESSES) {
            let point = calibration.point(press);
            let length = forest.view.length(point.outputs);
            if length > 0.0 {
                let mut row = Vec::with_capacity(2 * point.outputs.len() + 1);
                forest.see(point.outputs, length, &mut row);
                grown.coordinates.resize(row.len(), Vec::new());
                grown.coordinates.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
                let log_force = point.force_n.ln() - forest.log_proportional(length);
                grown.answers.push([point.place.x_mm, point.place.y_mm, log_force]);
            }
        }
        if grown.answers.is_empty() {
            return Err(FitError::NothingToTellApart);
        }
        grown.scale = grown.scales();
        forest.trees = grown.trees();
        Ok(forest)
    }

    fn see(&self, outputs: &[f64], length: f64, seen: &mut Vec<f64>) {
        self.view.see(outputs, length, seen);
        if self.sees_amplitude {
            seen.extend_from_slice(outputs);
            seen.push(length.ln());
        }
    }

    fn log_proportional(&self, length: f64) -> f64 {
        if self.sees_amplitude { 0.0 } else { length.ln() }
    }
}

/// Trees that answer one of three values.
pub(super) struct Forest {
    trees: Vec<Tree>,
    value: usize,
}

impl Forest {
    /// Grows trees from columns, one for each coordinate, to one of the values that belong to their rows. Returns one forest for each
    /// value.
    pub(super) fn grow(coordinates: Vec<Vec<f64>>, values: Vec<[f64; ANSWERS]>) -> [Forest; ANSWERS] {
        let mut grown = Grown { coordinates, answers: values, scale: [0.0; ANSWERS] };
        [0, 1, 2].map(|value| {
            let one_over_sd = grown.one_over_sd(value);
            grown.scale = [0, 1, 2].map(|other| if other == value { one_over_sd } else { 0.0 });
            Forest { trees: grown.trees(), value }
        })
    }

    /// Returns the value that belongs to a row.
    pub(super) fn answer(&self, row: &[f64]) -> f64 {
        self.trees.iter().map(|tree| tree.answer(row)[self.value]).sum::<f64>() / self.trees.len().max(1) as f64
    }
}

impl Locate for ExtraTrees {
    fn name(&self) -> &'static str {
        EXTRA_TREES
    }

    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<LocatedContact, SolveError> {
        let length = self.view.length(outputs);
        if length == 0.0 {
            return Err(SolveError::AllEqual);
        }
        workspace.row.clear();
        self.see(outputs, length, &mut workspace.row);
        let (mut sums, mut squares) = ([0.0; ANSWERS], 0.0);
        for tree in &self.trees {
            let answer = tree.answer(&workspace.row);
            sums.iter_mut().zip(answer).for_each(|(sum, value)| *sum += value);
        }
        let [x_mm, y_mm, log_force] = sums.map(|sum| sum / self.trees.len() as f64);
        for tree in &self.trees {
            let [x, y, _] = tree.answer(&workspace.row);
            squares += (x - x_mm).powi(2) + (y - y_mm).powi(2);
        }
        let force_n = self.load.force_n(self.force_n, log_force + self.log_proportional(length))?;
        let residue = squares / self.trees.len() as f64;
        let scale_mm = residue.sqrt().max(LEAST_SPREAD_MM);
        Ok(LocatedContact { place: Place::new(x_mm, y_mm), force_n, residue, scale_mm, ..LocatedContact::PLAIN })
    }
}

impl Tree {
    fn answer(&self, row: &[f64]) -> LeafAnswer {
        let mut at = 0;
        loop {
            match self.nodes[at] {
                Node::Leaf(answer) => return answer,
                Node::Split { coordinate, threshold, below, above } => {
                    at = if row[coordinate as usize] < threshold { below } else { above } as usize;
                }
            }
        }
    }
}

/// Data from which trees are grown.
struct Grown {
    /// Columns, one for each coordinate.
    coordinates: Vec<Vec<f64>>,
    answers: Vec<LeafAnswer>,
    /// Factor by which each answer is multiplied so that all answers have equal weight.
    scale: LeafAnswer,
}

impl Grown {
    fn trees(&self) -> Vec<Tree> {
        let seeds: Vec<u64> = (0..TREES as u64).collect();
        in_parallel(&seeds, |&seed| self.tree(stream(0, seed, "extra trees")))
    }

    /// Returns the inverse of the spread of the places, and of the forces.
    fn scales(&self) -> LeafAnswer {
        let of_places = one_over_sd(0.5 * (self.variance(0) + self.variance(1)));
        [of_places, of_places, self.one_over_sd(2)]
    }

    fn one_over_sd(&self, answer: usize) -> f64 {
        one_over_sd(self.variance(answer))
    }

    fn variance(&self, i: usize) -> f64 {
        let count = self.answers.len() as f64;
        let mean = self.answers.iter().map(|answer| answer[i]).sum::<f64>() / count;
        self.answers.iter().map(|answer| (answer[i] - mean).powi(2)).sum::<f64>() / count
    }

    fn tree(&self, mut rng: RandomStream) -> Tree {
        let mut rows: Vec<u32> = (0..self.answers.len() as u32).collect();
        let mut order: Vec<u32> = (0..self.coordinates.len() as u32).collect();
        let scaled: Vec<LeafAnswer> =
            self.answers.iter().map(|a| std::array::from_fn(|i| a[i] * self.scale[i])).collect();
        let mut nodes = vec![Node::Leaf([0.0; ANSWERS])];
        let mut open = vec![(0, 0, rows.len())];
        while let Some((node, first, past)) = open.pop() {
            let rows = &mut rows[first..past];
            let Some((coordinate, threshold)) = self.split(rows, &scaled, &mut order, &mut rng) else {
                let mean = |i: usize| rows.iter().map(|&row| self.answers[row as usize][i]).sum::<f64>();
                nodes[node] = Node::Leaf(std::array::from_fn(|i| mean(i) / rows.len() as f64));
                continue;
            };
            let column = &self.coordinates[coordinate as usize];
            let mut middle = 0;
            for i in 0..rows.len() {
                if column[rows[i] as usize] < threshold {
                    rows.swap(i, middle);
                    middle += 1;
                }
            }
            let below = nodes.len();
            nodes.extend([Node::Leaf([0.0; ANSWERS]); 2]);
            nodes[node] = Node::Split { coordinate, threshold, below: below as u32, above: below as u32 + 1 };
            open.extend([(below, first, first + middle), (below + 1, first + middle, past)]);
        }
        Tree { nodes }
    }

    /// Returns the random threshold with the least remaining variance, from one threshold for each of some coordinates. Returns
    /// `None` if the rows are equal.
    fn split(
        &self,
        rows: &[u32],
        scaled: &[LeafAnswer],
        order: &mut [u32],
        rng: &mut RandomStream,
    ) -> Option<(u32, f64)> {
        let is_alike = rows.iter().all(|&row| scaled[row as usize] == scaled[rows[0] as usize]);
        if rows.len() < 2 || is_alike {
            return None;
        }
        let tried = TRIED_COORDINATES.max((2.0 * (order.len() as f64).sqrt()) as usize);
        let total = sum(rows.iter().map(|&row| scaled[row as usize]));
        let (mut best, mut left): (Option<(f64, u32, f64)>, usize) = (None, tried);
        for first in 0..order.len() {
            let other = first + (rng.next_u64() % (order.len() - first) as u64) as usize;
            order.swap(first, other);
            let column = &self.coordinates[order[first] as usize];
            let values = || rows.iter().map(|&row| column[row as usize]);
            let (least, most) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), v| (l.min(v), m.max(v)));
            let share = (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
            let threshold = least + (most - least) * share;
            if !(least < threshold && threshold <= most) {
                continue;
            }
            let below = rows.iter().filter(|&&row| column[row as usize] < threshold);
            let count = below.clone().count() as f64;
            let sums = sum(below.map(|&row| scaled[row as usize]));
            let of = |sums: f64, total: f64| sums * sums / count + (total - sums).powi(2) / (rows.len() as f64 - count);
            let explained: f64 = sums.iter().zip(total).map(|(&sums, total)| of(sums, total)).sum();
            if best.is_none_or(|(most, ..)| explained > most) {
                best = Some((explained, order[first], threshold));
            }
            left -= 1;
            if left == 0 {
                break;
            }
        }
        best.map(|(_, coordinate, threshold)| (coordinate, threshold))
    }
}

fn one_over_sd(variance: f64) -> f64 {
    if variance > 1e-18 { 1.0 / variance.sqrt() } else { 0.0 }
}

fn sum(answers: impl Iterator<Item = LeafAnswer>) -> LeafAnswer {
    answers.fold([0.0; ANSWERS], |sums, answer| std::array::from_fn(|i| sums[i] + answer[i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CalibrationPoint;

    /// Two units on a line of 41 places, of which every tenth press went wrong.
    fn calibration() -> Calibration {
        let rows: Vec<(f64, [f64; 2])> = (0..205)
            .map(|i| {
                let x_mm = 0.1 * f64::from(i / 5);
                let seen = if i % 10 == 7 { 4.0 - x_mm } else { x_mm };
                (x_mm, [5.0 - seen, 1.0 + seen])
            })
            .collect();
        let point = |(x_mm, outputs)| CalibrationPoint { place: Place::new(x_mm, 0.0), force_n: 1.0, outputs };
        Calibration::new(&rows.iter().map(|(x_mm, outputs)| point((*x_mm, outputs))).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn few_wrong_presses_hardly_count() {
        let trees = ExtraTrees::fit(&calibration(), ForceKnown::Unknown).unwrap();
        let located = trees.locate(&[2.0, 1.0], &mut Workspace::default()).unwrap();
        assert!((located.place.x_mm - 1.0).abs() < 0.35 && (located.force_n - 0.5).abs() < 0.1, "{located:?}");
    }

    #[test]
    fn trees_are_reproducible() {
        let located = || {
            let trees = ExtraTrees::fit(&calibration(), ForceKnown::Constant).unwrap();
            trees.locate(&[3.3, 2.7], &mut Workspace::default()).unwrap()
        };
        assert_eq!(located(), located());
        assert!(located().scale_mm > 0.0);
    }
}
