//! How a cell with three axes is mounted.

/// Matrix from the forces along the axes of a cell to those of the tip on the specimen along x, y and the press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AxesMounting(pub(crate) [[f64; 3]; 3]);

impl Default for AxesMounting {
    /// The axes of the cell are those of the specimen, with its z into it.
    fn default() -> Self {
        AxesMounting([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    }
}

impl AxesMounting {
    /// Returns the forces sideways and that of a press.
    pub(crate) fn forces_n(&self, device_n: [f64; 3]) -> ([f64; 2], f64) {
        let along = |row: [f64; 3]| row.iter().zip(device_n).map(|(factor, force_n)| factor * force_n).sum();
        let [x_n, y_n, force_n] = self.0.map(along);
        ([x_n, y_n], force_n)
    }
}
