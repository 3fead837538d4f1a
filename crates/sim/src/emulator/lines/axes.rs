//! Forces along the axes of a cell with three axes, as it is mounted.

use crate::scene::Scene;

/// Axes of a cell that are x and y of the specimen and the press.
pub const STRAIGHT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Returns the forces along the cell's x, y and z at `now_s`, N, at most the ends of its range, and whether one is beyond them. `mounting`
/// is the matrix from the forces of the tip on the specimen along x, y and the press.
pub fn read(scene: &mut Scene, now_s: f64, mounting: &[[f64; 3]; 3], range_n: f64) -> ([f64; 3], bool) {
    let specimen_n = scene.load_cell_axes_n(now_s);
    let device_n =
        mounting.map(|row| row.iter().zip(specimen_n).map(|(factor, force_n)| factor * force_n).sum::<f64>());
    (device_n.map(|force_n| force_n.clamp(-range_n, range_n)), device_n.iter().any(|force_n| force_n.abs() > range_n))
}
