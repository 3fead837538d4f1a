//! Searches a table for the largest dot products.

use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize, Serializer};

/// Table of rows of length 1, and the search for the rows with the largest dot product with a direction.
///
/// The search uses single precision, for many rows at a time. Rows so close to the best that rounding may have changed their
/// order are scored again in double precision. So the result is the same as for a simple search in double precision.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "Rows", from = "Rows")]
pub(super) struct Scan {
    /// Capabilities of the processor, read once. Reading them in every search took 7 ns of 110 on a table of 9 x 625.
    arch: Arch,
    units: usize,
    /// Rows as given, row-major rows x units.
    rows: Vec<f64>,
    /// The rows in single precision, rearranged so that one instruction multiplies many rows. First come the first unit's values
    /// of the first [`PANEL`] rows, then the second unit's, and so on. Then come the next rows. The last rows are padded with 0.
    panels: Vec<RowPanel>,
}

/// Source data of a table.
#[derive(Serialize, Deserialize)]
struct Rows {
    units: usize,
    rows: Vec<f64>,
}

impl From<Rows> for Scan {
    fn from(Rows { units, rows }: Rows) -> Self {
        Scan::new(units, rows)
    }
}

impl From<Scan> for Rows {
    fn from(Scan { units, rows, .. }: Scan) -> Self {
        Rows { units, rows }
    }
}

/// Row that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hit {
    /// Index of the row, from 0.
    pub row: usize,
    /// Dot product of the row with the direction, in double precision.
    pub score: f64,
}

/// Buffers for a search. They are kept between searches, so that no search allocates memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    direction: Vec<f32>,
    scores: Vec<RowPanel>,
    hits: Vec<Hit>,
}

impl Scratch {
    /// Returns the score of a row in the last search, in single precision.
    pub(crate) fn score(&self, row: usize) -> f32 {
        self.scores[row / PANEL].0[row % PANEL]
    }
}

/// Number of rows that are multiplied together: [`SUMS`] of the widest existing registers, 16 numbers each.
const PANEL: usize = 128;
/// Number of sums that are computed together. A multiply-add takes four cycles and two begin in each cycle, so eight keep the
/// processor busy.
const SUMS: usize = 8;
/// Number of maxima that are computed together, for the same reason.
const PEAKS: usize = 4;
/// Number of scores that are checked together: one cache line.
const LINE: usize = 16;

/// One number for each of [`PANEL`] rows. The panel is aligned, because a load across two cache lines costs twice as much.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct RowPanel([f32; PANEL]);

impl Scan {
    /// Takes rows x units, row-major, each row of length 1. Requires at least one unit.
    pub(crate) fn new(units: usize, rows: Vec<f64>) -> Self {
        Scan { arch: Arch::new(), units, panels: panels(units, &rows), rows }
    }

    /// Serialises the table without its rows.
    pub(crate) fn serialize_empty<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Rows { units: self.units, rows: Vec::new() }.serialize(serializer)
    }

    /// Returns all rows, row-major.
    pub(crate) fn rows(&self) -> &[f64] {
        &self.rows
    }

    /// Returns a row as given.
    pub(crate) fn row(&self, row: usize) -> &[f64] {
        &self.rows[row * self.units..][..self.units]
    }

    /// Returns the row with the largest dot product with a direction of length 1, and the first of equal rows. Returns `None` if
    /// there is no row or the direction isn't finite.
    pub(crate) fn best(&self, direction: &[f64], scratch: &mut Scratch) -> Option<Hit> {
        self.nearest(direction, 1, scratch).first().copied()
    }

    /// Returns the `count` rows with the largest dot products, the largest first. Of equal rows, the first in the table comes
    /// first. Returns fewer if there are fewer rows.
    pub(crate) fn nearest<'a>(&self, direction: &[f64], count: usize, scratch: &'a mut Scratch) -> &'a [Hit] {
        self.arch.dispatch(PanelSearch { scan: self, direction, count, scratch });
        &scratch.hits
    }

    /// Largest error of a score in single precision.
    ///
    /// Rounding a row and a direction of n units, multiplying and adding leaves an error below (n + 2) u / (1 - (n + 2) u) times
    /// the sum of |row| |direction| (Higham 2002, Accuracy and Stability of Numerical Algorithms, section 3.1). This sum is at
    /// most 1 (Cauchy-Schwarz). The unit roundoff u is half an epsilon. The other half allows for the denominator, for lengths
    /// that are 1 except for rounding, and for numbers too small for full precision. It also allows for the comparison with this
    /// bound, which is in single precision.
    fn rounding(&self) -> f32 {
        (self.units + 2) as f32 * f32::EPSILON
    }
}

fn panels(units: usize, rows: &[f64]) -> Vec<RowPanel> {
    let panel = |rows: &[f64], unit: usize| {
        let mut panel = RowPanel([0.0; PANEL]);
        for (value, row) in panel.0.iter_mut().zip(rows.chunks_exact(units)) {
            *value = row[unit] as f32;
        }
        panel
    };
    // damaged bytes of a file may state no unit
    rows.chunks(units.max(1) * PANEL).flat_map(|rows| (0..units).map(move |unit| panel(rows, unit))).collect()
}

struct PanelSearch<'a> {
    scan: &'a Scan,
    direction: &'a [f64],
    count: usize,
    scratch: &'a mut Scratch,
}

// Everything below runs with the instructions of `simd` only if it is inlined: hence the attributes, and no closure that might not be.
impl WithSimd for PanelSearch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let PanelSearch { scan, direction, count, scratch } = self;
        let Scratch { direction: narrow, scores, hits } = scratch;
        narrow.clear();
        narrow.extend(direction.iter().map(|&value| value as f32));
        scores.resize(scan.panels.len() / scan.units, RowPanel([0.0; PANEL]));
        multiply(simd, &scan.panels, narrow, scores);
        let last = scan.rows.len() / scan.units % PANEL;
        if let Some(scores) = scores.last_mut().filter(|_| last > 0) {
            scores.0[last..].fill(f32::NEG_INFINITY); // padding of the last panel is no row
        }
        // The best can have come out one error too low, and another row one too high.
        let floor = floor(simd, scores, count) - 2.0 * scan.rounding();
        hits.clear();
        gather(scores, floor, |row| offer(scan, direction, count, row, hits));
    }
}

/// Computes the dot product of every row with the direction.
#[inline(always)]
fn multiply<S: Simd>(simd: S, panels: &[RowPanel], direction: &[f32], scores: &mut [RowPanel]) {
    for (panel, scores) in panels.chunks_exact(direction.len()).zip(scores) {
        let (strips, _) = pulp::as_arrays_mut::<SUMS, _>(S::as_mut_simd_f32s(&mut scores.0).0);
        for (strip, scores) in strips.iter_mut().enumerate() {
            let mut sums = [simd.splat_f32s(0.0); SUMS];
            for (rows, &weight) in panel.iter().zip(direction) {
                let (strips, _) = pulp::as_arrays::<SUMS, _>(S::as_simd_f32s(&rows.0).0);
                let weight = simd.splat_f32s(weight);
                for (sum, &values) in sums.iter_mut().zip(&strips[strip]) {
                    *sum = if S::IS_SCALAR {
                        // Without vectors there is no fused instruction either, and to imitate one is slow.
                        simd.add_f32s(simd.mul_f32s(weight, values), *sum)
                    } else {
                        simd.mul_add_f32s(weight, values, *sum)
                    };
                }
            }
            *scores = sums;
        }
    }
}

/// Returns a score that the `count` best scores reach or exceed.
///
/// Each lane keeps the largest of its scores, so the lanes hold scores of different rows.
#[inline(always)]
fn floor<S: Simd>(simd: S, scores: &[RowPanel], count: usize) -> f32 {
    let nothing = simd.splat_f32s(f32::NEG_INFINITY);
    let mut peaks = [nothing; PEAKS];
    for scores in scores {
        for scores in pulp::as_arrays::<PEAKS, _>(S::as_simd_f32s(&scores.0).0).0 {
            for (peak, &score) in peaks.iter_mut().zip(scores) {
                *peak = simd.max_f32s(*peak, score);
            }
        }
    }
    let mut floor = f32::NEG_INFINITY;
    for _ in 0..count {
        let mut most = nothing;
        for &peak in &peaks {
            most = simd.max_f32s(most, peak);
        }
        floor = simd.reduce_max_f32s(most);
        // Equal values go together, which makes the threshold lower than necessary, never higher.
        for peak in &mut peaks {
            *peak = simd.select_f32s(simd.equal_f32s(*peak, simd.splat_f32s(floor)), nothing, *peak);
        }
    }
    floor
}

/// Returns the rows with a score of at least the floor, in order.
#[inline(always)]
fn gather(scores: &[RowPanel], floor: f32, mut found: impl FnMut(usize)) {
    for (panel, scores) in scores.iter().enumerate().filter(|(_, scores)| any_reaches(floor, &scores.0)) {
        for (line, scores) in scores.0.as_chunks::<LINE>().0.iter().enumerate() {
            if any_reaches(floor, scores) {
                for (lane, _) in scores.iter().enumerate().filter(|(_, score)| **score >= floor) {
                    found(panel * PANEL + line * LINE + lane);
                }
            }
        }
    }
}

/// Whether any of the scores reaches the floor. Most scores are far below it.
#[inline(always)]
fn any_reaches(floor: f32, scores: &[f32]) -> bool {
    scores.iter().fold(false, |any, &score| any | (score >= floor))
}

/// Inserts a row among the `count` best rows so far, if it belongs there.
fn offer(scan: &Scan, direction: &[f64], count: usize, row: usize, hits: &mut Vec<Hit>) {
    // with few rows the threshold also admits padding
    let Some(values) = scan.rows.chunks_exact(scan.units).nth(row) else { return };
    let score = dot(values, direction);
    let place = hits.partition_point(|hit| hit.score >= score);
    if place < count {
        hits.truncate(count - 1);
        hits.insert(place, Hit { row, score });
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Scales a row to length 1 and returns its original length. `None` if the length is 0, or a value isn't finite.
///
/// The values must be of the order of 1, so that no square overflows or vanishes.
pub(super) fn to_length_one(row: &mut [f64]) -> Option<f64> {
    let length = dot(row, row).sqrt();
    // NaN, from a value that is not finite, isn't above 0 either.
    (length > 0.0).then(|| {
        row.iter_mut().for_each(|value| *value /= length);
        length
    })
}

/// Copies a row, scaled so that its largest magnitude becomes exactly 1. Returns the original magnitude. If the magnitude is 0,
/// or a value isn't finite, the copied values may not be numbers.
pub(super) fn to_order_one(row: &[f64], scaled: &mut Vec<f64>) -> f64 {
    let scale = row.iter().fold(0.0, |most, value| if value.abs() > most { value.abs() } else { most });
    scaled.clear();
    scaled.extend(row.iter().map(|value| value / scale));
    scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Instruction sets that are supported, the fastest first; the last one works on every processor.
    fn archs() -> Vec<Arch> {
        let mut archs = vec![Arch::new(), Arch::Scalar];
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        archs.extend(pulp::x86::V3::try_new().map(Arch::V3));
        archs
    }

    /// The same search, one row after the other in double precision.
    fn plainly(units: usize, rows: &[f64], direction: &[f64], count: usize) -> Vec<Hit> {
        let scored = rows.chunks_exact(units).map(|row| dot(row, direction)).enumerate();
        let mut hits: Vec<Hit> = scored.map(|(row, score)| Hit { row, score }).collect();
        hits.sort_by(|a, b| b.score.total_cmp(&a.score)); // stable: of equals the first stays first
        hits.truncate(count);
        hits
    }

    fn assert_found_as_plainly(units: usize, rows: &[f64], direction: &[f64]) {
        let scan = Scan::new(units, rows.to_vec());
        let mut scratch = Scratch::default();
        for arch in archs() {
            let scan = Scan { arch, ..scan.clone() };
            for count in [1, 4, 20] {
                let found = scan.nearest(direction, count, &mut scratch);
                assert_eq!(found, plainly(units, rows, direction, count), "{arch:?}, the {count} best");
            }
        }
    }

    fn unit(mut row: Vec<f64>) -> Vec<f64> {
        if to_length_one(&mut row).is_none() {
            row[0] = 1.0;
        }
        row
    }

    /// Rows of one direction, bent by up to `bend`: the smaller, the closer to ties they are.
    fn bundle(units: usize, rows: usize, bend: f64) -> impl Strategy<Value = (Vec<f64>, Vec<f64>)> {
        let numbers = |count| prop::collection::vec(-1.0..1.0f64, count);
        (numbers(units), numbers(units * rows)).prop_map(move |(direction, bends)| {
            let direction = unit(direction);
            let bent = |bends: &[f64]| unit(direction.iter().zip(bends).map(|(d, b)| d + bend * b).collect());
            (bends.chunks_exact(units).flat_map(bent).collect(), direction)
        })
    }

    /// Number of units and rows, and how far the rows are bent.
    fn tables() -> impl Strategy<Value = (usize, usize, f64)> {
        let bends = prop::sample::select(vec![0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 1.0, 100.0]);
        (prop::sample::select(vec![1, 2, 9, 33]), 1..400usize, bends)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn panel_search_finds_the_result_of_a_plain_search(
            (units, table, direction) in tables().prop_flat_map(|(units, rows, bend)| {
                bundle(units, rows, bend).prop_map(move |(table, direction)| (units, table, direction))
            }),
        ) {
            assert_found_as_plainly(units, &table, &direction);
        }

        #[test]
        fn scalar_and_vector_paths_agree_to_rounding((table, direction) in bundle(9, 300, 1.0)) {
            let scan = Scan::new(9, table.clone());
            for arch in archs() {
                let mut scratch = Scratch::default();
                Scan { arch, ..scan.clone() }.best(&direction, &mut scratch);
                let narrow = scratch.scores.iter().flat_map(|panel| panel.0);
                for (score, row) in narrow.zip(table.chunks_exact(9)) {
                    prop_assert!((f64::from(score) - dot(row, &direction)).abs() <= f64::from(scan.rounding()) / 2.0);
                }
            }
        }
    }

    #[test]
    fn close_candidates_are_separated_in_double_precision() {
        // One row of each table is better than all others, by less than single precision holds.
        for (best, others) in [(0, 1..300), (299, 0..299)] {
            let mut table = [0.6, 0.8].repeat(300);
            table[2 * best + 1] += 1e-15;
            assert_found_as_plainly(2, &table, &[0.6, 0.8]);
            let hit = Scan::new(2, table).best(&[0.6, 0.8], &mut Scratch::default()).unwrap();
            assert!(hit.row == best && !others.contains(&hit.row));
        }
    }

    #[test]
    fn of_equals_the_first_counts() {
        let scan = Scan::new(2, [0.6, 0.8].repeat(1000));
        let mut scratch = Scratch::default();
        let rows: Vec<usize> = scan.nearest(&[0.8, 0.6], 3, &mut scratch).iter().map(|hit| hit.row).collect();
        assert_eq!(rows, [0, 1, 2]);
    }

    #[test]
    fn padding_rows_are_never_found() {
        // All rows score below 0, which is the score of the padding.
        let scan = Scan::new(1, vec![-1.0; 3]);
        let mut scratch = Scratch::default();
        assert_eq!(scan.best(&[1.0], &mut scratch), Some(Hit { row: 0, score: -1.0 }));
        assert_eq!(scan.nearest(&[1.0], 7, &mut scratch).len(), 3);
        assert_eq!(Scan::new(3, Vec::new()).best(&[1.0, 0.0, 0.0], &mut scratch), None);
        assert_eq!(scan.best(&[f64::NAN], &mut scratch), None);
        assert_eq!(scan.nearest(&[1.0], 0, &mut scratch), []);
    }

    #[test]
    fn one_workspace_serves_tables_of_all_sizes() {
        let mut scratch = Scratch::default();
        for rows in [500, 3, 128, 129, 500] {
            let mut table = [1.0, 0.0].repeat(rows);
            table[2 * (rows - 1)..].copy_from_slice(&[0.0, 1.0]);
            let hit = Scan::new(2, table).best(&[0.0, 1.0], &mut scratch);
            assert_eq!(hit, Some(Hit { row: rows - 1, score: 1.0 }));
        }
    }
}
