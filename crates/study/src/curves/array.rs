//! Units in a plane, and the similarity of their readings of two contacts.

use palpate_core::mechanics::{Passage, TaxelResponse};
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_solver::correlation;

/// Ratio of the readings' variance to their power below which all readings count as equal. It corresponds to a ten-thousandth of
/// each reading, far below any noise. Above it, the rounding error of the results is below a rise that counts.
const ALIKE: f64 = 1e-8;

/// An array: the positions of its units, and each unit's reading of a contact.
///
/// The paper's line of units is an array too. It lies along x under a half-space with a depth of 1 mm, so a distance in mm equals
/// a distance in depths H.
#[derive(Clone, Debug)]
pub struct StudiedArray {
    places: Vec<Place>,
    response: TaxelResponse,
}

impl StudiedArray {
    /// Returns an array of a layout's units. All units read the same at the same distance from a contact.
    pub fn new(layout: &ArrayLayout, response: TaxelResponse) -> StudiedArray {
        StudiedArray { places: layout.places().to_vec(), response }
    }

    /// Returns the paper's line: `units` units starting at 0, `spacing` depths apart.
    pub fn line(units: usize, spacing: f64) -> StudiedArray {
        let places = (0..units).map(|unit| Place::new(unit as f64 * spacing, 0.0)).collect();
        StudiedArray { places, response: TaxelResponse::new(Passage::half_space(1.0)) }
    }

    /// Returns the positions of the units.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// Returns the response of a unit.
    pub fn response(&self) -> &TaxelResponse {
        &self.response
    }

    /// Returns Pearson's r of two contacts; `None` if r is 0/0.
    pub fn r(&self, first: Place, second: Place) -> Option<f64> {
        let readings = |at: Place| self.places.iter().map(|unit| self.response.at(at.distance_mm(*unit))).collect();
        let (first, second): (Vec<f64>, Vec<f64>) = (readings(first), readings(second));
        correlation(&first, &second)
    }

    /// Returns the coefficient c of r = 1 - c d^2 (d in mm) for a small distance d from a contact in a direction. It is half the
    /// square of the pattern's rotation rate. `None` if there is no pattern.
    pub fn bend(&self, at: Place, direction_rad: f64) -> Option<f64> {
        let sums = self.sums(at, direction_rad, |_| 0.0);
        let power = sums.power()?;
        let growth = sums.products / power;
        let turned = sums.slopes_squared / power - growth * growth;
        Some(turned.max(0.0) / 2.0)
    }

    /// Returns a fixed first contact; `None` if all units read the same for it.
    pub fn aim(&self, first: Place) -> Option<Aim<'_>> {
        let mut pattern: Vec<f64> = self.places.iter().map(|unit| self.response.at(first.distance_mm(*unit))).collect();
        let power = self.sums(first, 0.0, |_| 0.0).power()?;
        let mean = pattern.iter().sum::<f64>() / pattern.len() as f64;
        pattern.iter_mut().for_each(|value| *value = (*value - mean) / power.sqrt());
        Some(Aim { array: self, pattern })
    }

    /// Returns all sums for r, its slope and its curvature, in one pass over the units.
    #[inline]
    fn sums(&self, at: Place, direction_rad: f64, weight: impl Fn(usize) -> f64) -> ContactSums {
        let (sin, cos) = direction_rad.sin_cos();
        let mut sums = ContactSums { count: self.places.len() as f64, ..ContactSums::default() };
        let (mut slope_sum, mut slope_square_sum, mut product_sum) = (0.0, 0.0, 0.0);
        for (index, unit) in self.places.iter().enumerate() {
            let (x_mm, y_mm) = (at.x_mm - unit.x_mm, at.y_mm - unit.y_mm);
            let distance_mm = (x_mm * x_mm + y_mm * y_mm).sqrt();
            let (reading, per_mm) = self.response.with_slope(distance_mm);
            // straight above a unit its reading is at a peak
            let slope = if distance_mm > 0.0 { per_mm * (x_mm * cos + y_mm * sin) / distance_mm } else { 0.0 };
            sums.readings += reading;
            sums.squares += reading * reading;
            slope_sum += slope;
            slope_square_sum += slope * slope;
            product_sum += reading * slope;
            let weight = weight(index);
            sums.along += weight * reading;
            sums.along_slopes += weight * slope;
        }
        sums.products = product_sum - sums.readings * slope_sum / sums.count;
        sums.slopes_squared = slope_square_sum - slope_sum * slope_sum / sums.count;
        sums
    }
}

/// Sums over the units at one contact: of readings, and of their change per mm in a direction.
#[derive(Default)]
struct ContactSums {
    count: f64,
    readings: f64,
    squares: f64,
    /// Sum of squared slopes minus their mean.
    slopes_squared: f64,
    /// Sum of products of readings and slopes, each minus its mean.
    products: f64,
    /// Products of readings and of slopes with the other contact's pattern.
    along: f64,
    along_slopes: f64,
}

impl ContactSums {
    /// Sum of the squares of the readings minus their mean; `None` if all readings are equal.
    fn power(&self) -> Option<f64> {
        let power = self.squares - self.readings * self.readings / self.count;
        (power > ALIKE * self.squares).then_some(power)
    }
}

/// A contact with which others are compared: its readings minus their mean, scaled to length 1.
pub struct Aim<'a> {
    array: &'a StudiedArray,
    pattern: Vec<f64>,
}

impl Aim<'_> {
    /// Returns r of a second contact, and its change per millimetre of the contact's path; `None` if all units read the same for
    /// it.
    pub(crate) fn r_and_slope(&self, second: Place, direction_rad: f64) -> Option<(f64, f64)> {
        let sums = self.array.sums(second, direction_rad, |unit| self.pattern[unit]);
        let power = sums.power()?;
        // the pattern is centred, so no centred readings are needed
        let r = sums.along / power.sqrt();
        if self.pattern.len() == 2 {
            return Some((r, 0.0)); // two units have two patterns, 1 and -1, and rounding between them is not a slope
        }
        Some((r, sums.along_slopes / power.sqrt() - r * sums.products / power))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::mechanics::Medium;

    fn arrays() -> [StudiedArray; 3] {
        let passage = Passage { indenter_radius_mm: 0.5, taxel_radius_mm: 1.0, ..Passage::half_space(5.0) };
        let layer = Passage { medium: Medium::BondedLayer { poisson_ratio: 0.49 }, ..passage };
        let grid = ArrayLayout::grid(3, 3, 4.5);
        [
            StudiedArray::line(9, 1.0),
            StudiedArray::new(&grid, TaxelResponse::new(passage)),
            StudiedArray::new(&grid, TaxelResponse::new(layer)),
        ]
    }

    #[test]
    fn r_equals_that_of_the_solver_and_its_slope_is_the_derivative() {
        for array in arrays() {
            let first = Place::new(0.7, 0.3);
            let aim = array.aim(first).unwrap();
            for (x_mm, y_mm, direction_rad) in [(1.5, -0.4, 0.0), (0.1, 0.9, 1.0), (2.9, 0.2, 4.0f64)] {
                let at =
                    |along: f64| Place::new(x_mm + along * direction_rad.cos(), y_mm + along * direction_rad.sin());
                let r = |along: f64| array.r(first, at(along)).unwrap();
                let (found, slope) = aim.r_and_slope(at(0.0), direction_rad).unwrap();
                assert!((found - r(0.0)).abs() < 1e-11, "{found} {}", r(0.0));
                let directly = (r(1e-4) - r(-1e-4)) / 2e-4;
                assert!((slope - directly).abs() < 2e-6, "{slope} {directly}");
            }
        }
    }

    #[test]
    fn curvature_is_that_of_r() {
        for array in arrays() {
            for direction_rad in [0.0, 2.0f64] {
                let first = Place::new(0.7, 0.3);
                let near = Place::new(0.7 + 0.01 * direction_rad.cos(), 0.3 + 0.01 * direction_rad.sin());
                let (bend, r) = (array.bend(first, direction_rad).unwrap(), array.r(first, near).unwrap());
                assert!(((1.0 - r) / 1e-4 / bend - 1.0).abs() < 0.05, "{bend} {r}");
            }
        }
    }

    #[test]
    fn where_all_units_read_the_same_there_is_no_r() {
        let two = StudiedArray::line(2, 1.0);
        assert!(two.aim(Place::new(0.5, 0.0)).is_none());
        assert_eq!(two.bend(Place::new(0.5, 0.0), 0.0), None);
        assert_eq!(two.r(Place::default(), Place::new(0.5, 0.0)), None);
        assert!(two.aim(Place::default()).unwrap().r_and_slope(Place::new(0.5, 0.0), 0.0).is_none());
    }
}
