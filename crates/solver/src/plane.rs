//! The plane of a touched surface.

use palpate_core::algebra::{Matrix, Vector};
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

/// Least width of an area relative to its length. Places in a narrower area are in a line.
const LEAST_WIDTH: f64 = 1e-6;

impl Plane {
    /// Returns the plane through heights, mm, at places. `None` for fewer than four places, or for places in a line.
    pub fn through(heights: &[(Place, f64)]) -> Option<Plane> {
        if heights.len() < 4 {
            return None;
        }
        let count = heights.len() as f64;
        let mean = |of: fn(&(Place, f64)) -> f64| heights.iter().map(of).sum::<f64>() / count;
        let (x_mm, y_mm, height_mm) = (mean(|(at, _)| at.x_mm), mean(|(at, _)| at.y_mm), mean(|(_, height)| *height));
        // about the mean, the height at the centre and the slopes don't depend on each other
        let centred =
            heights.iter().map(|(at, height)| (Vector::column([at.x_mm - x_mm, at.y_mm - y_mm]), height - height_mm));
        let (mut squares, mut products) = (Matrix::<2, 2>::ZERO, Vector::<2>::ZERO);
        for (at, height) in centred.clone() {
            squares += at * at.transpose();
            products += at * height;
        }
        let [[xx, xy], [_, yy]] = *squares.rows();
        let (middle_mm2, half_mm2) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        let least_mm2 = middle_mm2 - half_mm2;
        if least_mm2.is_nan() || least_mm2 <= LEAST_WIDTH.powi(2) * (middle_mm2 + half_mm2) {
            return None;
        }
        let slopes = squares.solve(products)?;
        let left: f64 = centred.map(|(at, height)| (height - slopes.dot(&at)).powi(2)).sum();
        let scatter_mm = (left / (count - 3.0)).sqrt();
        let tilt = Tilt { per_x: slopes[0], per_y: slopes[1] };
        let height_mm = height_mm - tilt.per_x * x_mm - tilt.per_y * y_mm;
        Some(Plane { height_mm, tilt, scatter_mm, tilt_sigma: scatter_mm / least_mm2.sqrt() })
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
