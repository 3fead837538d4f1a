use super::Place;

/// Where the sensing units of the array lie, in the specimen frame; unit 1 is `places[0]`.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrayLayout {
    places: Vec<Place>,
}

impl ArrayLayout {
    /// Units at given places, in the order of the array's channels.
    pub fn from_places(places: Vec<Place>) -> Self {
        ArrayLayout { places }
    }

    /// A grid centred on the origin, row-major: x grows along a row, y from row to row (unit 1 at the smallest x and y).
    pub fn grid(rows: usize, columns: usize, pitch_mm: f64) -> Self {
        let offset = |index: usize, count: usize| (index as f64 - (count as f64 - 1.0) / 2.0) * pitch_mm;
        let place = |i: usize| Place::new(offset(i % columns, columns), offset(i / columns, rows));
        ArrayLayout { places: (0..rows * columns).map(place).collect() }
    }

    /// The places of the units, in channel order, mm.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// How many units there are.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// How many outputs the array has.
    pub fn channels(&self) -> usize {
        self.len()
    }

    /// Whether there is no unit at all.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
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
    }
}
