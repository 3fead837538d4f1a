//! Start places for the search for the best fit.

use super::field::SplineField;
use super::response::ForwardResponse;
use super::scan::{Scan, to_length_one};
use super::workspace::Workspace;
use palpate_core::quantity::Place;
use serde::{Deserialize, Serialize};

/// Grid of places, and the direction of the array's reading for a contact at each place.
#[derive(Serialize, Deserialize)]
pub(super) struct Starts {
    pub places: Vec<Place>,
    pub common_offset: bool,
    /// Noise of each unit under the calibration's force.
    pub sd: Vec<f64>,
    /// Response at each place in units of `sd`, scaled to length 1. They aren't stored, because they follow from the map.
    #[serde(serialize_with = "Scan::serialize_empty")]
    pub directions: Scan,
}

/// Number of places along each side of the area.
pub(super) const STARTS_A_SIDE: usize = 25;

/// Largest number of places from which the best fit is searched for.
pub(super) const MOST_STARTS: usize = 6;

impl Starts {
    pub(crate) fn new(response: &ForwardResponse, common_offset: bool) -> Self {
        let (places, sd) = (response.field.area().grid(STARTS_A_SIDE), response.typical_sd());
        let directions = Scan::new(response.field.channels(), Vec::new());
        Starts { places, common_offset, sd, directions }.with_directions(&response.field)
    }

    /// Returns the same places with their directions in the map. Those of an older file are kept.
    pub(crate) fn with_directions(self, field: &SplineField) -> Self {
        if !self.directions.rows().is_empty() {
            return self;
        }
        let units = field.channels();
        let mut directions = vec![0.0; self.places.len() * units];
        for (place, row) in self.places.iter().zip(directions.chunks_exact_mut(units.max(1))) {
            field.value(*place, row);
            row.iter_mut().zip(&self.sd).for_each(|(value, sd)| *value /= sd);
            if self.common_offset {
                project_out(row, &self.sd);
            }
            to_length_one(row); // a row of zeros stays, and has no direction
        }
        Starts { directions: Scan::new(units, directions), ..self }
    }

    /// Fills `workspace.starts` with the places whose directions are closest to the reading's, the closest first. It takes the
    /// top of each peak, at most [`MOST_STARTS`]. If units are excluded, it takes only the closest place.
    pub(crate) fn seek(&self, outputs: &[f64], without: &[usize], workspace: &mut Workspace) {
        let Workspace { row: direction, scratch, starts, .. } = workspace;
        starts.clear();
        direction.clear();
        direction.extend(outputs.iter().zip(&self.sd).map(|(output, sd)| output / sd));
        if !without.is_empty() {
            without.iter().for_each(|&unit| direction[unit] = 0.0);
            starts.extend(self.nearest_without(direction, without).map(|place| (1.0, place)));
            return;
        }
        if self.common_offset {
            project_out(direction, &self.sd);
        }
        if to_length_one(direction).is_none() {
            return;
        }
        let Some(best) = self.directions.best(direction, scratch).filter(|hit| hit.score > 0.0) else { return };
        starts.push((best.score as f32, self.places[best.row]));
        for row in (0..self.places.len()).filter(|&row| row != best.row && is_peak(row, |row| scratch.score(row))) {
            let score = scratch.score(row);
            let rank = 1 + starts[1..].partition_point(|(other, _)| *other >= score);
            if rank < MOST_STARTS {
                starts.truncate(MOST_STARTS - 1);
                starts.insert(rank, (score, self.places[row]));
            }
        }
    }

    /// Returns the smallest distance between two starts, mm.
    pub(crate) fn step_mm(&self) -> f64 {
        let (first, last) = (self.places[0], self.places[self.places.len() - 1]);
        (last.x_mm - first.x_mm).max(last.y_mm - first.y_mm) / (STARTS_A_SIDE - 1) as f64
    }

    /// Returns the nearest place for rows without some units, which no longer have length 1. This case is rare, so the rows are
    /// compared one by one.
    fn nearest_without(&self, direction: &[f64], without: &[usize]) -> Option<Place> {
        let cosine = |row: &[f64]| {
            let along: f64 = direction.iter().zip(row).map(|(a, b)| a * b).sum();
            let left = 1.0 - without.iter().map(|&unit| row[unit] * row[unit]).sum::<f64>();
            along / left.max(f64::EPSILON).sqrt()
        };
        let scored = self.places.iter().enumerate().map(|(i, place)| (cosine(self.directions.row(i)), place));
        scored.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(cosine, _)| *cosine > 0.0).map(|(_, place)| *place)
    }
}

/// Whether a place scores more than 0, and no neighbour on the grid scores more than the place.
fn is_peak(row: usize, score: impl Fn(usize) -> f32) -> bool {
    let own = score(row);
    if own <= 0.0 {
        return false;
    }
    let (column, line) = (row % STARTS_A_SIDE, row / STARTS_A_SIDE);
    let around = |middle: usize| middle.saturating_sub(1)..=(middle + 1).min(STARTS_A_SIDE - 1);
    around(line).all(|line| around(column).all(|column| score(line * STARTS_A_SIDE + column) <= own))
}

/// Removes from a row of outputs, in units of their sd, the part that a common offset could have caused.
fn project_out(row: &mut [f64], sd: &[f64]) {
    let length: f64 = sd.iter().map(|sd| 1.0 / (sd * sd)).sum();
    let share = row.iter().zip(sd).map(|(value, sd)| value / sd).sum::<f64>() / length;
    row.iter_mut().zip(sd).for_each(|(value, sd)| *value -= share / sd);
}
