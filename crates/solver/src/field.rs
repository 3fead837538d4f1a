//! Smooth functions of a place, stored as splines.

use super::process::Process;
use palpate_core::quantity::{Place, Range, cell_centres};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Smooth functions of the place, one for each channel, tabulated over an area: uniform cubic B-splines in x and y. A value and
/// its gradient need sixteen rows of the table, for any origin of the functions.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "StoredField", try_from = "StoredField")]
pub(super) struct SplineField {
    area: CalibratedArea,
    channels: usize,
    x: Subdivision,
    y: Subdivision,
    /// Coefficients, row-major, y nodes x x nodes x channels.
    coefficients: Vec<f64>,
    /// Process that a large table was made from. It is stored instead of the table, because it is many times smaller.
    process: Option<Arc<Process>>,
}

/// A field in a sensor file.
#[derive(Serialize, Deserialize)]
struct StoredField {
    area: CalibratedArea,
    channels: usize,
    x: Subdivision,
    y: Subdivision,
    /// The coefficients, or the [numbers](Process::numbers) of the process: they aren't as many.
    numbers: Vec<f64>,
}

/// Rectangle that contains the calibration points, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct CalibratedArea {
    /// Lower left corner.
    pub least: Place,
    /// Upper right corner.
    pub most: Place,
}

impl CalibratedArea {
    /// Returns the smallest area that contains all places; `None` if there are no places.
    pub(crate) fn around(places: impl IntoIterator<Item = Place>) -> Option<Self> {
        places.into_iter().map(|place| CalibratedArea { least: place, most: place }).reduce(|a, b| CalibratedArea {
            least: Place::new(a.least.x_mm.min(b.least.x_mm), a.least.y_mm.min(b.least.y_mm)),
            most: Place::new(a.most.x_mm.max(b.most.x_mm), a.most.y_mm.max(b.most.y_mm)),
        })
    }

    /// Returns the length of the longer side, mm.
    pub(crate) fn side_mm(&self) -> f64 {
        (self.most.x_mm - self.least.x_mm).max(self.most.y_mm - self.least.y_mm)
    }

    /// Whether a place is inside the area and not on its border. An area with a side of length 0 has no inside.
    pub(crate) fn has_inside(&self, place: Place) -> bool {
        let within = |mm: f64, least: f64, most: f64| least == most || (mm > least + SAME_MM && mm < most - SAME_MM);
        within(place.x_mm, self.least.x_mm, self.most.x_mm) && within(place.y_mm, self.least.y_mm, self.most.y_mm)
    }

    /// Returns an even grid with `side` places along each side.
    pub(crate) fn grid(&self, side: usize) -> Vec<Place> {
        let along = |least: f64, most: f64, i: usize| least + (most - least) * i as f64 / (side - 1) as f64;
        let place = |i: usize| {
            let x_mm = along(self.least.x_mm, self.most.x_mm, i % side);
            Place::new(x_mm, along(self.least.y_mm, self.most.y_mm, i / side))
        };
        (0..side * side).map(place).collect()
    }

    /// Returns the centres of equal cells, `side` along each side.
    pub(crate) fn cells(&self, side: usize) -> Vec<Place> {
        let range = |min: f64, max: f64| Range { min, max };
        let (least, most) = (self.least, self.most);
        cell_centres(range(least.x_mm, most.x_mm), range(least.y_mm, most.y_mm), side, side)
    }

    /// Returns the place in the area that is nearest to the given place.
    pub(crate) fn clamp(&self, place: Place) -> Place {
        Place::new(place.x_mm.clamp(self.least.x_mm, self.most.x_mm), place.y_mm.clamp(self.least.y_mm, self.most.y_mm))
    }
}

/// Distance below which two places are the same, mm.
const SAME_MM: f64 = 1e-3;
/// Largest number of cells along one axis. A table of 100 channels then takes less than 5 MB.
const MOST_CELLS: usize = 64;
/// Least number of cells along one axis.
const FEWEST_CELLS: usize = 4;
/// Number of coefficients from which a table is made from its process again when a file is read: 4 MB. Below it reading the table is
/// faster.
const MOST_STORED: usize = 500_000;
/// Number of channels whose sums a processor keeps in its registers.
const CHANNELS_AT_ONCE: usize = 4;

impl SplineField {
    /// Tabulates `sample` in cells of about `step_mm`. `sample` is called once for the values at many places (row-major, places x
    /// channels). The places go up to two cells beyond the area.
    pub(crate) fn new(
        area: CalibratedArea,
        step_mm: f64,
        channels: usize,
        sample: impl FnOnce(&[Place]) -> Vec<f64>,
    ) -> Self {
        let x = Subdivision::new(area.least.x_mm, area.most.x_mm, step_mm);
        let y = Subdivision::new(area.least.y_mm, area.most.y_mm, step_mm);
        SplineField { area, channels, x, y, coefficients: coefficients(&x, &y, channels, sample), process: None }
    }

    /// Tabulates the predictions of a process, one channel for each of its outputs. `sample` returns the same predictions, except for
    /// rounding, and is faster.
    pub(crate) fn of_process(
        area: CalibratedArea,
        step_mm: f64,
        process: &Process,
        sample: impl FnOnce(&[Place]) -> Vec<f64>,
    ) -> Self {
        let (x, y) = (
            Subdivision::new(area.least.x_mm, area.most.x_mm, step_mm),
            Subdivision::new(area.least.y_mm, area.most.y_mm, step_mm),
        );
        let channels = process.mean.len();
        let count = x.coefficients() * y.coefficients() * channels;
        if count <= MOST_STORED || 2 * process.numbers().len() > count {
            return SplineField::new(area, step_mm, channels, sample);
        }
        SplineField::made(area, x, y, process.clone())
    }

    /// Makes the table of a process: with the same numbers on every machine.
    fn made(area: CalibratedArea, x: Subdivision, y: Subdivision, process: Process) -> Self {
        let channels = process.mean.len();
        let coefficients = coefficients(&x, &y, channels, |places| process.predict_places(places));
        SplineField { area, channels, x, y, coefficients, process: Some(Arc::new(process)) }
    }

    /// Returns the area of the table.
    pub(crate) fn area(&self) -> CalibratedArea {
        self.area
    }

    /// Returns the length of a cell, mm.
    pub(crate) fn step_mm(&self) -> f64 {
        self.x.step.min(self.y.step)
    }

    /// Returns the number of functions.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    /// Returns the lengths of a cell, mm, and the numbers of cells along x and y, and the coefficients.
    pub(crate) fn table(&self) -> ([f64; 2], [usize; 2], &[f64]) {
        ([self.x.step, self.y.step], [self.x.cells, self.y.cells], &self.coefficients)
    }

    /// Returns the values at a place.
    pub(crate) fn value(&self, place: Place, value: &mut [f64]) {
        let (x, y) = (self.x.find(place.x_mm), self.y.find(place.y_mm));
        value.fill(0.0);
        for (row, wy) in y.weights.into_iter().enumerate() {
            for (column, wx) in x.weights.into_iter().enumerate() {
                let weight = wx * wy;
                for (value, c) in value.iter_mut().zip(self.node(x.first + column, y.first + row)) {
                    *value += weight * c;
                }
            }
        }
    }

    /// Returns the values at a place and their changes with x and with y, per mm.
    pub(crate) fn value_and_gradient(&self, place: Place, value: &mut [f64], along_x: &mut [f64], along_y: &mut [f64]) {
        let (x, y) = (self.x.find(place.x_mm), self.y.find(place.y_mm));
        let node = |i: usize| {
            let (column, row) = (i % 4, i / 4);
            let weights = [
                x.weights[column] * y.weights[row],
                x.slopes[column] * y.weights[row],
                x.weights[column] * y.slopes[row],
            ];
            (weights, self.node(x.first + column, y.first + row))
        };
        let nodes: [_; 16] = std::array::from_fn(node);
        let blocks = value.chunks_mut(CHANNELS_AT_ONCE).zip(along_x.chunks_mut(CHANNELS_AT_ONCE));
        for (block, ((value, along_x), along_y)) in blocks.zip(along_y.chunks_mut(CHANNELS_AT_ONCE)).enumerate() {
            let first = block * CHANNELS_AT_ONCE;
            let mut sums = [[0.0; CHANNELS_AT_ONCE]; 3];
            match value.len() {
                // of a known length: the sums stay in registers
                CHANNELS_AT_ONCE => add_nodes(&nodes, first, CHANNELS_AT_ONCE, &mut sums),
                fewer => add_nodes(&nodes, first, fewer, &mut sums),
            }
            [value, along_x, along_y]
                .into_iter()
                .zip(&sums)
                .for_each(|(to, sums)| to.copy_from_slice(&sums[..to.len()]));
        }
    }

    /// Returns the same field with some of its channels.
    pub(crate) fn of_channels(&self, kept: &[usize]) -> Self {
        let nodes = self.coefficients.chunks_exact(self.channels);
        let coefficients = nodes.flat_map(|node| kept.iter().map(|channel| node[*channel])).collect();
        SplineField { channels: kept.len(), coefficients, process: None, ..*self }
    }

    /// Returns the value of one channel and its changes with x and with y, per mm.
    pub(crate) fn channel(&self, channel: usize, place: Place) -> [f64; 3] {
        let (x, y) = (self.x.find(place.x_mm), self.y.find(place.y_mm));
        let mut sums = [0.0; 3];
        for (row, (wy, sy)) in y.weights.into_iter().zip(y.slopes).enumerate() {
            for (column, (wx, sx)) in x.weights.into_iter().zip(x.slopes).enumerate() {
                let c = self.node(x.first + column, y.first + row)[channel];
                sums.iter_mut().zip([wx * wy, sx * wy, wx * sy]).for_each(|(sum, weight)| *sum += weight * c);
            }
        }
        sums
    }

    fn node(&self, x: usize, y: usize) -> &[f64] {
        &self.coefficients[(y * self.x.coefficients() + x) * self.channels..][..self.channels]
    }
}

impl From<SplineField> for StoredField {
    fn from(SplineField { area, channels, x, y, coefficients, process }: SplineField) -> Self {
        let numbers = process.map_or(coefficients, |process| process.numbers());
        StoredField { area, channels, x, y, numbers }
    }
}

impl TryFrom<StoredField> for SplineField {
    type Error = &'static str;

    fn try_from(StoredField { area, channels, x, y, numbers }: StoredField) -> Result<Self, Self::Error> {
        let nodes = x.coefficients().saturating_mul(y.coefficients());
        if numbers.len() == nodes.saturating_mul(channels) {
            return Ok(SplineField { area, channels, x, y, coefficients: numbers, process: None });
        }
        match Process::of_numbers(&numbers, channels) {
            Some(process) if x.cells.max(y.cells) <= MOST_CELLS => Ok(SplineField::made(area, x, y, process)),
            _ => Err("a table of the map has a wrong size"),
        }
    }
}

/// Adds to the sums of some channels their coefficients at all nodes, times each of the node's three weights.
#[inline(always)]
fn add_nodes(nodes: &[([f64; 3], &[f64]); 16], first: usize, count: usize, sums: &mut [[f64; CHANNELS_AT_ONCE]; 3]) {
    for (weights, coefficients) in nodes {
        let coefficients = &coefficients[first..first + count];
        for (sums, weight) in sums.iter_mut().zip(weights) {
            sums.iter_mut().zip(coefficients).for_each(|(sum, c)| *sum += weight * c);
        }
    }
}

/// Equal cells between two values.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Subdivision {
    least: f64,
    step: f64,
    cells: usize,
}

/// Four coefficients that affect a value: their weights, and the derivatives of the weights.
struct Stencil {
    first: usize,
    weights: [f64; 4],
    slopes: [f64; 4],
}

impl Subdivision {
    fn new(least: f64, most: f64, step: f64) -> Self {
        let width = most - least;
        if width <= 0.0 {
            return Subdivision { least, step, cells: 1 }; // all places on one line: nothing is known beside it
        }
        let cells = (width / step).ceil().clamp(FEWEST_CELLS as f64, MOST_CELLS as f64) as usize;
        Subdivision { least, step: width / cells as f64, cells }
    }

    fn coefficients(&self) -> usize {
        self.cells.saturating_add(3) // a damaged file may state any number
    }

    /// Position of a sample. The third sample is at the axis' least value.
    fn node(&self, index: usize) -> f64 {
        self.least + (index as f64 - 2.0) * self.step
    }

    fn find(&self, value: f64) -> Stencil {
        let cell = ((value - self.least) / self.step).clamp(0.0, self.cells as f64);
        let first = (cell as usize).min(self.cells - 1);
        let t = cell - first as f64;
        let (u, slope) = (1.0 - t, 0.5 / self.step);
        Stencil {
            first,
            weights: [
                u * u * u / 6.0,
                (4.0 + 3.0 * t * t * (t - 2.0)) / 6.0,
                (4.0 + 3.0 * u * u * (u - 2.0)) / 6.0,
                t * t * t / 6.0,
            ],
            slopes: [-u * u * slope, t * (3.0 * t - 4.0) * slope, u * (4.0 - 3.0 * u) * slope, t * t * slope],
        }
    }
}

/// Returns the coefficients of a table (row-major, y nodes x x nodes x channels). `sample` is called once, for all places.
fn coefficients(
    x: &Subdivision,
    y: &Subdivision,
    channels: usize,
    sample: impl FnOnce(&[Place]) -> Vec<f64>,
) -> Vec<f64> {
    // One more node each way than coefficients: a coefficient is made from three samples.
    let (wide, high) = (x.coefficients() + 2, y.coefficients() + 2);
    let place = |node: usize| Place::new(x.node(node % wide), y.node(node / wide));
    let samples = sample(&(0..wide * high).map(place).collect::<Vec<_>>());
    let along_x = quasi_interpolated(&samples, high, wide, channels);
    quasi_interpolated(&along_x, 1, high, x.coefficients() * channels)
}

/// Returns coefficients of cubic B-splines from samples along the middle one of three dimensions: (-f- + 8 f - f+) / 6, which is
/// exact for cubics (de Boor and Fix 1973). The result has two values fewer than the input.
fn quasi_interpolated(samples: &[f64], outer: usize, count: usize, inner: usize) -> Vec<f64> {
    let mut coefficients = Vec::with_capacity(outer * (count - 2) * inner);
    for block in samples.chunks_exact(count * inner) {
        for at in inner..(count - 1) * inner {
            coefficients.push((8.0 * block[at] - block[at - inner] - block[at + inner]) / 6.0);
        }
    }
    coefficients
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: CalibratedArea =
        CalibratedArea { least: Place { x_mm: -3.0, y_mm: 1.0 }, most: Place { x_mm: 5.0, y_mm: 7.0 } };

    #[test]
    fn cubics_and_their_gradients_are_exact() {
        let cubic = |place: Place, values: &mut [f64]| {
            let (x, y) = (place.x_mm, place.y_mm);
            values.copy_from_slice(&[x * x * x - 2.0 * x * y * y, y * y * y + x]);
        };
        let field = SplineField::new(AREA, 1.3, 2, |places| {
            let mut values = vec![0.0; 2 * places.len()];
            places.iter().zip(values.chunks_exact_mut(2)).for_each(|(place, row)| cubic(*place, row));
            values
        });
        let (mut value, mut along_x, mut along_y) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        for (x, y) in [(-3.0, 1.0), (5.0, 7.0), (0.31, 4.2), (4.99, 1.01)] {
            let mut truth = [0.0; 2];
            cubic(Place::new(x, y), &mut truth);
            field.value_and_gradient(Place::new(x, y), &mut value, &mut along_x, &mut along_y);
            let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b} at {x} {y}");
            near(value[0], truth[0]);
            near(value[1], truth[1]);
            near(along_x[0], 3.0 * x * x - 2.0 * y * y);
            near(along_y[0], -4.0 * x * y);
            near(along_x[1], 1.0);
            near(along_y[1], 3.0 * y * y);
            let mut alone = [0.0; 2];
            field.value(Place::new(x, y), &mut alone);
            assert_eq!(alone, value);
        }
    }

    #[test]
    fn outside_the_area_the_border_value_is_used() {
        let field =
            SplineField::new(AREA, 1.0, 1, |places| places.iter().map(|place| place.x_mm + place.y_mm).collect());
        let mut value = [0.0];
        field.value(Place::new(99.0, -99.0), &mut value);
        assert!((value[0] - 6.0).abs() < 1e-9);
    }

    #[test]
    fn an_area_may_be_a_line_or_a_place() {
        let place = Place::new(1.0, 2.0);
        let area = CalibratedArea::around([place]).unwrap();
        let field = SplineField::new(area, 0.5, 1, |places| places.iter().map(|place| place.y_mm).collect());
        let mut value = [0.0];
        field.value(place, &mut value);
        assert!((value[0] - 2.0).abs() < 1e-12);
        assert_eq!(area.clamp(Place::new(7.0, 7.0)), place);
        assert_eq!(CalibratedArea::around([]), None);
    }
}
