//! The plane of a touched surface.

use nalgebra::{DMatrix, DVector};
use palpate_core::quantity::{Place, Tilt};

/// A plane through heights at places, by least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Height at the origin, mm.
    pub height_mm: f64,
    /// Slopes along x and y, mm of height per mm.
    pub tilt: Tilt,
    /// Standard deviation of one height about the plane, mm.
    pub scatter_mm: f64,
    /// Standard deviation of the slope in the direction that is known least. It follows from the scatter, so bumps wider than the
    /// area count as tilt.
    pub tilt_sigma: f64,
}

impl Plane {
    /// Returns the plane through heights, mm, at places. `None` for fewer than four places, or for places in a line.
    pub fn through(heights: &[(Place, f64)]) -> Option<Plane> {
        if heights.len() < 4 {
            return None;
        }
        let basis = DMatrix::from_fn(heights.len(), 3, |row, column| {
            let place = heights[row].0;
            [1.0, place.x_mm, place.y_mm][column]
        });
        let values = DVector::from_iterator(heights.len(), heights.iter().map(|(_, height)| *height));
        let svd = basis.clone().svd(true, true);
        if svd.rank(1e-9 * svd.singular_values.max()) < 3 {
            return None;
        }
        let plane = svd.solve(&values, 0.0).ok()?;
        let left = (&basis * &plane - values).norm_squared();
        let scatter_mm = (left / (heights.len() - 3) as f64).sqrt();
        let covariance = (basis.transpose() * &basis).try_inverse()?;
        let slopes = covariance.fixed_view::<2, 2>(1, 1).into_owned();
        let tilt_sigma = scatter_mm * slopes.symmetric_eigenvalues().max().max(0.0).sqrt();
        let tilt = Tilt { per_x: plane[1], per_y: plane[2] };
        Some(Plane { height_mm: plane[0], tilt, scatter_mm, tilt_sigma })
    }

    /// Height of the plane at a place, mm.
    pub fn at_mm(&self, place: Place) -> f64 {
        self.height_mm + self.tilt.per_x * place.x_mm + self.tilt.per_y * place.y_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_found_with_its_scatter_and_a_line_has_none() {
        let height = |x: f64, y: f64| (Place::new(x, y), 0.1 + 0.02 * x - 0.01 * y);
        let plane = Plane::through(&[height(0.0, 0.0), height(1.0, 0.0), height(0.0, 1.0), height(3.0, 2.0)]).unwrap();
        assert!((plane.height_mm - 0.1).abs() < 1e-12 && (plane.tilt.per_x - 0.02).abs() < 1e-12, "{plane:?}");
        assert!(plane.scatter_mm < 1e-12 && plane.tilt_sigma < 1e-12, "{plane:?}");
        assert!((plane.at_mm(Place::new(2.0, 3.0)) - 0.11).abs() < 1e-12);
        assert_eq!(Plane::through(&[0.0, 1.0, 2.0, 3.0].map(|x| height(x, 0.0))), None);
    }

    #[test]
    fn the_slope_is_known_as_well_as_scatter_and_extent_allow() {
        // a height off by 1 um, up and down in turns, at 5 x 5 places 2 mm apart; y is stretched to 4 mm
        let at = |n: usize| Place::new(2.0 * (n % 5) as f64 - 4.0, 4.0 * (n / 5) as f64 - 8.0);
        let heights: Vec<(Place, f64)> = (0..25).map(|n| (at(n), if n % 2 == 0 { 1e-3 } else { -1e-3 })).collect();
        let plane = Plane::through(&heights).unwrap();
        // the sum of x^2 is 5 * 2 * (16 + 4) = 200 mm^2, that of y^2 is four times as much
        assert!((plane.tilt_sigma - plane.scatter_mm / 200f64.sqrt()).abs() < 1e-12, "{plane:?}");
    }
}
