//! Map computed by elasticity.

use super::field::{CalibratedArea, SplineField};
use super::response::ForwardResponse;
use super::spots::Spots;
use super::{Calibration, FitError};
use palpate_core::algebra::{Matrix, Vector};
use palpate_core::mechanics::{Medium, Passage, TaxelResponse as Shape};
use palpate_core::quantity::{ArrayLayout, Place};

/// Returns the response by elasticity. Each unit has a gain, a place and a depth under a cover. The cover is a half-space (paper
/// equation 1) or a layer bonded to a rigid base, whichever fits the calibration better. Four parameters for each unit need few
/// presses, as long as the cover is of one of these kinds.
pub(super) fn physics(calibration: &Calibration, layout: Option<&ArrayLayout>) -> Result<ForwardResponse, FitError> {
    let spots = Spots::of(calibration);
    if spots.places().count() < FEWEST_PLACES {
        return Err(FitError::TooFewPlaces { places: spots.places().count(), needed: FEWEST_PLACES });
    }
    let area = CalibratedArea::around(spots.places()).ok_or(FitError::NothingToTellApart)?;
    let side = area.side_mm();
    let places: Vec<Place> = spots.places().collect();
    let (per_newton, units) = (spots.per_newton(), calibration.units());
    let taxels = &fitted_taxels(&places, &per_newton, units, layout, side);

    let depth_mm = taxels.iter().map(|taxel| taxel.parameters[DEPTH].exp()).fold(side, f64::min);
    let everywhere = |value: fn(&CoveredTaxel, Place) -> f64| {
        let row = move |place: &Place| taxels.iter().map(move |taxel| value(taxel, *place)).collect::<Vec<f64>>();
        move |places: &[Place]| places.iter().flat_map(row).collect::<Vec<f64>>()
    };
    let field = SplineField::new(area, depth_mm / CELLS_A_DEPTH, units, everywhere(|taxel, place| taxel.at(place).0));
    let (mut residuals, mut leverage) = (Vec::new(), Vec::new());
    for (place, row) in places.iter().zip(per_newton.chunks_exact(units)) {
        for (output, taxel) in row.iter().zip(taxels) {
            let own = taxel.leverage(*place).min(MOST_LEVERAGE);
            residuals.push((output - taxel.at(*place).0) / (1.0 - own));
            leverage.push(own / (1.0 - own));
        }
    }
    let held = spots.hold_out(calibration, &residuals, &leverage, false);
    Ok(ForwardResponse::new(field, everywhere(CoveredTaxel::leverage), held, calibration).known_everywhere())
}

/// Returns the place of each unit according to its own outputs, as [`physics`] finds it. Each unit is fitted separately, starting
/// from its place in the layout. For a unit of several channels, the channel with the best fit gives the place. Channels that
/// read a slope have no peak above the unit.
pub(super) fn unit_places(calibration: &Calibration, layout: &ArrayLayout) -> Result<Vec<Place>, FitError> {
    let spots = Spots::of(calibration);
    let places: Vec<Place> = spots.places().collect();
    if places.len() < FEWEST_PLACES {
        return Err(FitError::TooFewPlaces { places: places.len(), needed: FEWEST_PLACES });
    }
    let area = CalibratedArea::around(spots.places()).ok_or(FitError::NothingToTellApart)?;
    let (per_newton, outputs) = (spots.per_newton(), calibration.units());
    let taxels = fitted_taxels(&places, &per_newton, outputs, Some(layout), area.side_mm());
    let misfit = |output: usize| {
        let all: f64 = per_newton[output..].iter().step_by(outputs).map(|value| value * value).sum();
        taxels[output].left / all
    };
    let of_unit = |unit: std::ops::Range<usize>| {
        let best = unit.clone().min_by(|&a, &b| misfit(a).total_cmp(&misfit(b))).unwrap_or(unit.start);
        Place::new(taxels[best].parameters[X], taxels[best].parameters[Y])
    };
    Ok(layout.units().map(of_unit).collect())
}

/// Returns the units under the cover that fits better.
fn fitted_taxels(
    places: &[Place],
    per_newton: &[f64],
    units: usize,
    layout: Option<&ArrayLayout>,
    side: f64,
) -> Vec<CoveredTaxel> {
    let covers = [Medium::HalfSpace, Medium::BondedLayer { poisson_ratio: RUBBER }].map(|medium| {
        let shape = Shape::new(Passage { medium, ..Passage::half_space(1.0) });
        let of_unit = |unit: usize| {
            let outputs: Vec<f64> = per_newton[unit..].iter().step_by(units).copied().collect();
            let start = layout.map(|layout| layout.places()[unit]);
            CoveredTaxel::fit(&shape, places, &outputs, start, side)
        };
        (0..units).map(of_unit).collect::<Vec<CoveredTaxel>>()
    });
    let misfit = |taxels: &[CoveredTaxel]| taxels.iter().map(|taxel| taxel.left.ln()).sum::<f64>();
    let [half_space, layer] = covers;
    if misfit(&layer) < misfit(&half_space) { layer } else { half_space }
}

/// Least number of places for a fit of four parameters for each unit, so that data remain to estimate the noise.
const FEWEST_PLACES: usize = 6;
/// Poisson's ratio of a rubber-like cover.
const RUBBER: f64 = 0.49;
/// Number of cells of the response's table in the length of one depth.
const CELLS_A_DEPTH: f64 = 12.0;
/// Depths at which a fit starts, as fractions of the area's longer side. The best result counts.
const STARTS: [f64; 3] = [0.15, 0.35, 0.8];
/// Largest contribution of a measurement to its own prediction. With 1, nothing could be held out.
const MOST_LEVERAGE: f64 = 0.95;

/// Indices of the parameters: gain, x, y and the logarithm of the depth.
const GAIN: usize = 0;
const X: usize = 1;
const Y: usize = 2;
const DEPTH: usize = 3;

/// Damping of the first step of a fit, factor by which a step changes it, and the damping above which no step helps.
const FIRST_DAMPING: f64 = 1e-3;
const DAMPING_FACTOR: f64 = 10.0;
const MOST_DAMPING: f64 = 1e12;
/// Largest number of steps of a fit, and the step relative to the parameters at which it ends.
const MOST_STEPS: usize = 200;
const LEAST_STEP: f64 = 1e-13;

/// One unit under the cover.
#[derive(Clone)]
struct CoveredTaxel {
    shape: Shape,
    parameters: Vector<4>,
    /// (J'J)^-1 at the fit; `None` if the parameters can't be distinguished.
    spread: Option<Matrix<4, 4>>,
    /// Sum of the squares of the residuals; above 0.
    left: f64,
}

impl CoveredTaxel {
    /// Returns the most likely parameters, from one output per newton for each place.
    fn fit(shape: &Shape, places: &[Place], outputs: &[f64], start: Option<Place>, side: f64) -> Self {
        let loudest = (0..outputs.len()).max_by(|&a, &b| outputs[a].abs().total_cmp(&outputs[b].abs())).unwrap_or(0);
        let at = start.unwrap_or(places[loudest]);
        let fits = STARTS.map(|share| {
            let parameters = Vector::column([outputs[loudest], at.x_mm, at.y_mm, (share * side).ln()]);
            let taxel = CoveredTaxel { shape: shape.clone(), parameters, spread: None, left: f64::INFINITY };
            taxel.settled(places, outputs)
        });
        let [first, others @ ..] = fits;
        others.into_iter().fold(first, |best, next| if next.left < best.left { next } else { best })
    }

    /// Returns the unit with the parameters of the least squares near its own, by the method of Levenberg and Marquardt (Marquardt
    /// 1963), with the diagonal of J'J as the scale.
    fn settled(mut self, places: &[Place], outputs: &[f64]) -> Self {
        let mut sums = self.sums(places, outputs);
        let (mut best, mut damping) = (self.parameters, FIRST_DAMPING);
        for _ in 0..MOST_STEPS {
            let damped = sums.information + Matrix::from_diagonal(sums.information.diagonal() * damping);
            let Some(step) = damped.solve(sums.slope) else { break };
            self.parameters = best - step;
            let found = self.sums(places, outputs);
            if found.squares <= sums.squares {
                (best, sums, damping) = (self.parameters, found, damping / DAMPING_FACTOR);
                if step.dot(&step) <= LEAST_STEP.powi(2) * best.dot(&best) {
                    break;
                }
            } else if damping > MOST_DAMPING {
                break;
            } else {
                damping *= DAMPING_FACTOR;
            }
        }
        self.parameters = best;
        let left = if sums.squares.is_finite() { sums.squares.max(f64::MIN_POSITIVE) } else { f64::INFINITY };
        CoveredTaxel { spread: sums.information.inverse(), left, ..self }
    }

    fn sums(&self, places: &[Place], outputs: &[f64]) -> StepSums {
        let mut sums = StepSums { information: Matrix::ZERO, slope: Vector::ZERO, squares: 0.0 };
        for (place, output) in places.iter().zip(outputs) {
            let (value, jacobian) = self.at(*place);
            let residual = value - output;
            sums.information += jacobian * jacobian.transpose();
            sums.slope += jacobian * residual;
            sums.squares += residual * residual;
        }
        sums
    }

    /// Returns the output per newton at a place, and its derivatives with respect to each parameter.
    fn at(&self, place: Place) -> (f64, Vector<4>) {
        let p = &self.parameters;
        let depth_mm = p[DEPTH].exp();
        let (dx, dy) = (place.x_mm - p[X], place.y_mm - p[Y]);
        let distance_mm = dx.hypot(dy);
        let k = distance_mm / depth_mm;
        let (value, slope) = self.shape.with_slope(k); // a depth of 1
        // d/dx of value(k) is slope dk/dx, and dk/dx = -dx / (distance depth): 0 straight above
        let along = if distance_mm > 0.0 { -p[GAIN] * slope / (depth_mm * distance_mm) } else { 0.0 };
        (p[GAIN] * value, Vector::column([value, along * dx, along * dy, -p[GAIN] * slope * k]))
    }

    /// Ratio of the prediction's variance at a place to the variance of one measurement.
    fn leverage(&self, place: Place) -> f64 {
        let jacobian = self.at(place).1;
        self.spread.map_or(0.0, |spread| jacobian.dot(&(spread * jacobian)).max(0.0))
    }
}

/// Sums over the places for one step of a fit: J'J, J'r and r'r.
struct StepSums {
    information: Matrix<4, 4>,
    slope: Vector<4>,
    squares: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_ends_at_the_least_sum_of_squares() {
        let shape = Shape::new(Passage::half_space(1.0));
        let places: Vec<Place> = (0..25).map(|n| Place::new(f64::from(n % 5) - 2.0, f64::from(n / 5) - 2.0)).collect();
        let parameters = Vector::column([0.8, 0.4, -0.3, 1.5f64.ln()]);
        let truth = CoveredTaxel { shape: shape.clone(), parameters, spread: None, left: 1.0 };
        for error in [0.0, 0.02] {
            let output = |(n, place): (usize, &Place)| truth.at(*place).0 + if n % 2 == 0 { error } else { -error };
            let outputs: Vec<f64> = places.iter().enumerate().map(output).collect();
            let found = CoveredTaxel::fit(&shape, &places, &outputs, None, 4.0);
            let sums = found.sums(&places, &outputs);
            for (i, truth) in parameters.values().into_iter().enumerate() {
                let most = 1e-9 * (sums.information.rows()[i][i] * sums.squares).sqrt() + 1e-14;
                assert!(sums.slope[i].abs() <= most, "{error}: the slope along parameter {i} is {}", sums.slope[i]);
                let off = (found.parameters[i] - truth).abs();
                assert!(if error == 0.0 { off < 1e-9 } else { off < 0.1 }, "{error}: parameter {i} is off by {off}");
            }
        }
    }
}
