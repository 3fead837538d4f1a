//! Position of the array, from the measured positions of its units.

use super::physics::unit_places;
use super::{Calibration, FitError};
use palpate_core::quantity::{ArrayLayout, Place};

/// Largest deviation of units from their places in the fitted array, as a fraction of the distance between neighbours (root mean
/// square). A swapped channel, a dead unit or a wrong pitch exceeds it clearly.
const MISFIT_SHARE: f64 = 0.15;

/// Largest uncertainty of the place, as a fraction of the same distance.
const UNCERTAIN_SHARE: f64 = 0.1;

/// Position of an array relative to its assumed position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Position of the layout's origin, mm.
    pub origin: Place,
    /// Rotation of the layout, from x toward y, degrees.
    pub rotation_deg: f64,
    /// Standard deviation of either coordinate of the origin, mm.
    pub origin_sigma_mm: f64,
    /// Standard deviation of the rotation, degrees.
    pub rotation_sigma_deg: f64,
    /// Root mean square distance of the units from the layout in this position, mm.
    pub misfit_mm: f64,
}

/// Reason why an array can't be located.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlacementError {
    /// The units can't be found individually.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// There are fewer units than are required for a rotation and an estimate of the error.
    #[error("with {units} units, the rotation of the array or its uncertainty can't be determined")]
    TooFewUnits {
        /// Number of units of the array.
        units: usize,
    },
    /// The positions of the units contradict the layout.
    #[error(
        "the outputs locate the units {misfit_mm:.2} mm off the layout at its best fit, unit {unit} most, by {worst_mm:.2} \
         mm; at most {most_mm:.2} mm is allowed"
    )]
    Poor {
        /// Root mean square distance, mm.
        misfit_mm: f64,
        /// Unit with the largest distance, counted from 1.
        unit: usize,
        /// Largest distance, mm.
        worst_mm: f64,
        /// Largest accepted root mean square distance, mm.
        most_mm: f64,
    },
    /// The error of the position is too large.
    #[error("the uncertainty of the array's position is {sigma_mm:.2} mm; at most {most_mm:.2} mm is allowed")]
    Uncertain {
        /// Standard deviation, mm.
        sigma_mm: f64,
        /// Largest useful standard deviation, mm.
        most_mm: f64,
    },
}

/// Locates an array of this layout from presses at known places. Each unit is first located by its own outputs. Then the complete
/// layout is fitted to all units (least squares, in closed form for a rotation and a shift in the plane).
///
/// # Errors
/// The fit isn't credible. Nothing is guessed.
pub fn place_array(calibration: &Calibration, layout: &ArrayLayout) -> Result<Placement, PlacementError> {
    if layout.len() != calibration.units() {
        return Err(FitError::Layout { layout: layout.len(), calibration: calibration.units() }.into());
    }
    let found = unit_places(calibration, layout);
    let layout = &layout.one_per_unit();
    let units = layout.len();
    let pitch_mm = neighbours_mm(layout).filter(|_| units >= 3).ok_or(PlacementError::TooFewUnits { units })?;
    let found = found?;
    let (middle, seen) = (mean(layout.places()), mean(&found));
    let (mut along, mut across, mut square) = (0.0, 0.0, 0.0);
    for (unit, place) in layout.places().iter().zip(&found) {
        let (u, p) = (less(*unit, middle), less(*place, seen));
        along += u.x_mm * p.x_mm + u.y_mm * p.y_mm;
        across += u.x_mm * p.y_mm - u.y_mm * p.x_mm;
        square += u.x_mm * u.x_mm + u.y_mm * u.y_mm;
    }
    let rotation_deg = across.atan2(along).to_degrees();
    let origin = less(seen, middle.turned(rotation_deg));
    let placed = |unit: Place| {
        let turned = unit.turned(rotation_deg);
        Place::new(origin.x_mm + turned.x_mm, origin.y_mm + turned.y_mm)
    };
    let off_mm: Vec<f64> =
        layout.places().iter().zip(&found).map(|(unit, place)| placed(*unit).distance_mm(*place)).collect();
    let squares: f64 = off_mm.iter().map(|off| off * off).sum();
    let misfit_mm = (squares / units as f64).sqrt();
    let most_mm = MISFIT_SHARE * pitch_mm;
    let is_within = |mm: f64, most_mm: f64| mm <= most_mm; // NaN stays NaN
    if !is_within(misfit_mm, most_mm) {
        let worst = (0..units).max_by(|&a, &b| off_mm[a].total_cmp(&off_mm[b])).unwrap_or(0);
        return Err(PlacementError::Poor { misfit_mm, unit: worst + 1, worst_mm: off_mm[worst], most_mm });
    }
    // each coordinate of each unit is one measurement, minus the three fitted numbers
    let sigma_mm = (squares / (2 * units - 3) as f64).sqrt();
    let rotation_sigma = sigma_mm / square.sqrt();
    // the middle is known best; the layout's origin also moves with the rotation
    let lever_mm = middle.distance_mm(Place::default());
    let origin_sigma_mm = (sigma_mm / (units as f64).sqrt()).hypot(rotation_sigma * lever_mm);
    let most_mm = UNCERTAIN_SHARE * pitch_mm;
    if !is_within(origin_sigma_mm, most_mm) {
        return Err(PlacementError::Uncertain { sigma_mm: origin_sigma_mm, most_mm });
    }
    let rotation_sigma_deg = rotation_sigma.to_degrees();
    Ok(Placement { origin, rotation_deg, origin_sigma_mm, rotation_sigma_deg, misfit_mm })
}

/// Returns the mean distance of a unit to its nearest neighbour, mm; `None` if two units share a place.
fn neighbours_mm(layout: &ArrayLayout) -> Option<f64> {
    let places = layout.places();
    let nearest = |(n, place): (usize, &Place)| {
        let others = places.iter().enumerate().filter(move |(other, _)| *other != n);
        others.map(|(_, other)| other.distance_mm(*place)).fold(f64::INFINITY, f64::min)
    };
    let mean = places.iter().enumerate().map(nearest).sum::<f64>() / places.len() as f64;
    (mean.is_finite() && mean > 0.0).then_some(mean)
}

fn mean(places: &[Place]) -> Place {
    let n = places.len() as f64;
    Place::new(
        places.iter().map(|place| place.x_mm).sum::<f64>() / n,
        places.iter().map(|place| place.y_mm).sum::<f64>() / n,
    )
}

fn less(a: Place, b: Place) -> Place {
    Place::new(a.x_mm - b.x_mm, a.y_mm - b.y_mm)
}

#[cfg(test)]
mod tests {
    use super::super::CalibrationPoint;
    use super::*;
    use palpate_core::mechanics::lambda;

    /// Returns presses of 1 N at 5 x 5 places by an array at this position. Each unit has a gain of its own.
    fn pressed(layout: &ArrayLayout, origin: Place, rotation_deg: f64, wiring: &[usize]) -> Calibration {
        let places: Vec<Place> =
            (0..25).map(|n| Place::new(f64::from(n % 5) * 2.0 - 4.0, f64::from(n / 5) * 2.0 - 4.0)).collect();
        let outputs: Vec<Vec<f64>> = places
            .iter()
            .map(|place| {
                let own = less(*place, origin).turned(-rotation_deg);
                let read = |&unit: &usize| {
                    let gain = 1.0 + 0.1 * unit as f64;
                    gain * lambda(layout.places()[unit].distance_mm(own) / 5.0)
                };
                wiring.iter().map(read).collect()
            })
            .collect();
        let points: Vec<CalibrationPoint> = places
            .iter()
            .zip(&outputs)
            .map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs })
            .collect();
        Calibration::new(&points).unwrap()
    }

    #[test]
    fn a_shifted_and_turned_array_is_found_where_it_is() {
        let layout = ArrayLayout::grid(3, 3, 4.5);
        let wiring: Vec<usize> = (0..9).collect();
        for (origin, rotation_deg) in
            [(Place::default(), 0.0), (Place::new(0.7, -0.4), 3.0), (Place::new(-1.5, 1.0), -8.0)]
        {
            let placement = place_array(&pressed(&layout, origin, rotation_deg, &wiring), &layout).unwrap();
            assert!(placement.origin.distance_mm(origin) < 1e-3, "{placement:?}");
            assert!((placement.rotation_deg - rotation_deg).abs() < 1e-2, "{placement:?}");
            assert!(placement.misfit_mm < 1e-3 && placement.origin_sigma_mm < 1e-3, "{placement:?}");
        }
    }

    #[test]
    fn an_array_of_units_with_three_channels_is_found_by_those_that_peak_above_them() {
        use palpate_core::mechanics::{Passage, TaxelResponse};
        let (units, origin) = (ArrayLayout::grid(3, 3, 4.5), Place::new(0.7, -0.4));
        let response = TaxelResponse::new(Passage::half_space(5.0));
        let places: Vec<Place> =
            (0..49).map(|n| Place::new(f64::from(n % 7) * 2.0 - 6.0, f64::from(n / 7) * 2.0 - 6.0)).collect();
        let read = |own: Place| -> Vec<f64> {
            let of_unit = |unit: &Place| {
                let distance_mm = own.distance_mm(*unit);
                let (value, slope) = response.with_slope(distance_mm);
                let (x, y) = (own.x_mm - unit.x_mm, own.y_mm - unit.y_mm);
                let along = move |mm: f64| 5.0 * slope * mm / distance_mm.max(1e-9);
                [along(x), value, along(y)] // whichever comes first
            };
            units.places().iter().flat_map(of_unit).collect()
        };
        let outputs: Vec<Vec<f64>> = places.iter().map(|place| read(less(*place, origin))).collect();
        let points: Vec<CalibrationPoint> = places
            .iter()
            .zip(&outputs)
            .map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs })
            .collect();
        let placement = place_array(&Calibration::new(&points).unwrap(), &units.clone().with_channels(3)).unwrap();
        assert!(placement.origin.distance_mm(origin) < 1e-3 && placement.misfit_mm < 1e-3, "{placement:?}");
    }

    #[test]
    fn swapped_channels_and_another_pitch_are_refused_and_not_guessed() {
        let layout = ArrayLayout::grid(3, 3, 4.5);
        let mut wiring: Vec<usize> = (0..9).collect();
        wiring.swap(1, 7);
        let swapped = place_array(&pressed(&layout, Place::default(), 0.0, &wiring), &layout);
        assert!(matches!(swapped, Err(PlacementError::Poor { unit: 2 | 8, .. })), "{swapped:?}");
        let straight: Vec<usize> = (0..9).collect();
        let smaller = ArrayLayout::grid(3, 3, 3.0);
        let shrunk = place_array(&pressed(&smaller, Place::default(), 0.0, &straight), &layout);
        assert!(matches!(shrunk, Err(PlacementError::Poor { .. })), "{shrunk:?}");
    }
}
