//! Positions of the outputs of a sensor array.

use super::Place;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Outputs of a sensor array, in their order, and the units that they belong to. A unit is one place with one output, or with
/// several outputs, its channels, such as a chip with three axes. The channels of a unit follow each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArrayLayout {
    /// Place of each output.
    places: Vec<Place>,
    /// Index of the unit of each output.
    units: Vec<usize>,
}

impl ArrayLayout {
    /// Creates units of one output each at given places (specimen frame), in the order of their outputs.
    pub fn from_places(places: Vec<Place>) -> Self {
        ArrayLayout { units: (0..places.len()).collect(), places }
    }

    /// Creates units of one output each in a grid centred on the origin, row-major. x grows along a row, and y grows from row to
    /// row (unit 1 at the smallest x and y).
    pub fn grid(rows: usize, columns: usize, pitch_mm: f64) -> Self {
        let offset = |index: usize, count: usize| (index as f64 - (count as f64 - 1.0) / 2.0) * pitch_mm;
        let place = |i: usize| Place::new(offset(i % columns, columns), offset(i / columns, rows));
        ArrayLayout::from_places((0..rows * columns).map(place).collect())
    }

    /// Returns the same units with this number of outputs each: those of the first unit, then those of the second, and so on.
    #[must_use]
    pub fn with_channels(self, channels_per_unit: usize) -> Self {
        let each = |index: usize| std::iter::repeat_n(index, channels_per_unit);
        let outputs: Vec<usize> = (0..self.places.len()).flat_map(each).collect();
        ArrayLayout {
            places: outputs.iter().map(|&output| self.places[output]).collect(),
            units: outputs.iter().map(|&output| self.units[output]).collect(),
        }
    }

    /// Returns some of the outputs, by their indices, each with its unit's place.
    ///
    /// # Panics
    /// If an output doesn't exist.
    #[must_use]
    pub fn only(&self, outputs: &[usize]) -> Self {
        ArrayLayout {
            places: outputs.iter().map(|&output| self.places[output]).collect(),
            units: outputs.iter().map(|&output| self.units[output]).collect(),
        }
    }

    /// Returns the name of an output: its unit, counted from 1, and also the channel if a unit has several channels.
    ///
    /// # Panics
    /// If the output doesn't exist.
    pub fn name(&self, output: usize) -> String {
        let unit = self.units[output];
        let of_unit = |index: &usize| self.units[*index] == unit;
        let (before, all) = ((0..output).filter(of_unit).count(), (0..self.len()).filter(of_unit).count());
        let channel = if all > 1 { format!(", channel {}", before + 1) } else { String::new() };
        format!("unit {}{channel}", unit + 1)
    }

    /// Number of outputs.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there are no outputs.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Place of each output, in their order, mm. Channels of one unit have the same place.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// Shortest distance between two units, mm; `None` if there is only one place.
    pub fn pitch_mm(&self) -> Option<f64> {
        let nearest_mm = |(i, at): (usize, &Place)| {
            let others = self.places[i + 1..].iter().map(|other| other.distance_mm(*at));
            others.filter(|mm| *mm > 0.0).fold(f64::INFINITY, f64::min)
        };
        let pitch_mm = self.places.iter().enumerate().map(nearest_mm).fold(f64::INFINITY, f64::min);
        pitch_mm.is_finite().then_some(pitch_mm)
    }

    /// Returns the index of the unit that an output belongs to.
    ///
    /// # Panics
    /// If the output doesn't exist.
    pub fn unit(&self, output: usize) -> usize {
        self.units[output]
    }

    /// The outputs of each unit, as ranges of their indices.
    pub fn units(&self) -> std::vec::IntoIter<Range<usize>> {
        let ends: Vec<usize> = (1..=self.len()).filter(|&end| self.units.get(end) != self.units.get(end - 1)).collect();
        let starts = std::iter::once(0).chain(ends.clone());
        starts.zip(ends).map(|(start, end)| start..end).collect::<Vec<_>>().into_iter()
    }

    /// Returns the first output of each unit, to give the positions of the units.
    #[must_use]
    pub fn one_per_unit(&self) -> Self {
        self.only(&self.units().map(|unit| unit.start).collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_grid_is_row_major_and_centred() {
        let layout = ArrayLayout::grid(3, 3, 4.5);
        assert_eq!(layout.places()[0], Place::new(-4.5, -4.5));
        assert_eq!(layout.places()[1], Place::new(0.0, -4.5));
        assert_eq!(layout.places()[4], Place::new(0.0, 0.0));
        assert_eq!(layout.places()[8], Place::new(4.5, 4.5));
        assert_eq!(layout.pitch_mm(), Some(4.5));
    }

    #[test]
    fn channels_of_a_unit_follow_each_other_at_its_place() {
        let plain = ArrayLayout::grid(1, 2, 4.0);
        assert_eq!(plain.clone().with_channels(1), plain);
        let layout = plain.clone().with_channels(3);
        assert_eq!((layout.len(), layout.unit(2), layout.unit(3)), (6, 0, 1));
        assert_eq!(layout.places()[2], Place::new(-2.0, 0.0));
        assert!(layout.units().eq([0..3, 3..6]));
        assert_eq!(layout.one_per_unit(), plain);
        // a unit that lost a channel, and one that lost all
        let kept = layout.only(&[0, 2]);
        assert_eq!((kept.units().len(), kept.units().next()), (1, Some(0..2)));
        assert_eq!(ArrayLayout::from_places(Vec::new()).units().len(), 0);
    }
}
