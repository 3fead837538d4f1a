//! Inverse transform to the plane: `f(k) = 1/3 int h F(h) J0(h k) dh`, in units of a half-space's peak (whose own integral `int h
//! (1 + h) e^-h dh` is 3). The result is a table that is read in a few ns.

use std::f64::consts::PI;
use std::sync::LazyLock;

/// End of a table, in depths; the function is 0 beyond. The slowest decay, of an incompressible layer, is like e^-0.74k. At the
/// end it is at most 1e-6 of the peak, and some 1e-6 of the load remains.
const FARTHEST: f64 = 20.0;
const CELLS: usize = 400;
const PER_CELL: f64 = FARTHEST / CELLS as f64;

/// End of the integral. Every transform decays like `h e^-h`, and `40^4 e^-40` is 1e-11.
const LONGEST: f64 = 40.0;
/// Number of nodes. Gauss' rule integrates waves up to a wave number of slightly less than 2 `NODES` / `LONGEST`. A wave number
/// of 24 (`FARTHEST` and both radii) needs 480 nodes.
const NODES: usize = 560;

/// Function of the distance in depths: twice continuously differentiable, even, and 0 far out.
#[derive(Debug, PartialEq)]
pub(super) struct HankelTable {
    /// Coefficients of each cell's quintic, constant first; its variable is the fraction of the cell.
    cells: Vec<[f64; 6]>,
}

impl HankelTable {
    /// Returns the function with this transform, accurate to some 1e-8 of a half-space's peak.
    pub(super) fn inverse_of(transform: impl Fn(f64) -> f64) -> Self {
        let inversion = &*INVERSION;
        let weights: Vec<f64> = inversion.nodes.iter().map(|&(h, weight)| weight * h * transform(h) / 3.0).collect();
        let knots: Vec<[f64; 3]> = (0..CELLS).map(|knot| inversion.knot(knot, &weights)).collect();
        let end = [0.0; 3];
        let cells = (0..CELLS).map(|cell| quintic(knots[cell], *knots.get(cell + 1).unwrap_or(&end))).collect();
        HankelTable { cells }
    }

    /// Returns the value at `k` depths and its change per depth.
    #[inline]
    pub(super) fn value_and_slope(&self, k: f64) -> (f64, f64) {
        let at = k / PER_CELL;
        // a float that is no index becomes the nearest one; NaN becomes 0 and remains in the fraction. A distance isn't negative, so this
        // is its floor, with one instruction on every processor
        let cell = at as u32;
        let Some(c) = self.cells.get(cell as usize) else { return (0.0, 0.0) };
        let t = at - f64::from(cell);
        let value = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
        let slope = c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * 5.0 * c[5])));
        (value, slope / PER_CELL)
    }
}

/// Returns the quintic polynomial with a given value, slope and curvature (per cell) at each end.
fn quintic([f0, d0, c0]: [f64; 3], [f1, d1, c1]: [f64; 3]) -> [f64; 6] {
    let (rise, turn, bend) = (f1 - f0 - d0 - c0 / 2.0, d1 - d0 - c0, c1 - c0);
    let cubic = 10.0 * rise - 4.0 * turn + bend / 2.0;
    let quartic = -15.0 * rise + 7.0 * turn - bend;
    let fifth = 6.0 * rise - 3.0 * turn + bend / 2.0;
    [f0, d0, c0 / 2.0, cubic, quartic, fifth]
}

/// Data that are the same for every transform. They are computed once, in some 20 ms.
static INVERSION: LazyLock<Inversion> = LazyLock::new(Inversion::new);

struct Inversion {
    /// Abscissae h in (0, `LONGEST`) and weights.
    nodes: Vec<(f64, f64)>,
    /// J0 and J1 of h k, for each knot.
    bessel: Vec<(f64, f64)>,
}

impl Inversion {
    fn new() -> Self {
        let half = LONGEST / 2.0;
        let nodes: Vec<_> = gauss_legendre(NODES).map(|(x, weight)| (half * (1.0 + x), half * weight)).collect();
        let knots = (0..CELLS).map(|knot| knot as f64 * PER_CELL);
        let bessel = knots.flat_map(|k| nodes.iter().map(move |(h, _)| (libm::j0(h * k), libm::j1(h * k)))).collect();
        Inversion { nodes, bessel }
    }

    /// Value, slope and curvature per cell at a knot. J0' = -J1 and J1' = J0 - J1 / x.
    fn knot(&self, knot: usize, weights: &[f64]) -> [f64; 3] {
        let k = knot as f64 * PER_CELL;
        let row = &self.bessel[knot * NODES..][..NODES];
        let mut sums = [0.0; 3];
        for ((&(h, _), &weight), &(j0, j1)) in self.nodes.iter().zip(weights).zip(row) {
            let of_j1 = if knot == 0 { 0.5 } else { j0 - j1 / (h * k) };
            sums[0] += weight * j0;
            sums[1] -= weight * h * j1;
            sums[2] -= weight * h * h * of_j1;
        }
        [sums[0], sums[1] * PER_CELL, sums[2] * PER_CELL * PER_CELL]
    }
}

/// Returns abscissae in (-1, 1) and weights of Gauss' rule. It uses Newton's method on the Legendre polynomial of degree `n`. The
/// start is Tricomi's first guess, which is accurate to 1/n^3 of the interval.
fn gauss_legendre(n: usize) -> impl Iterator<Item = (f64, f64)> {
    const STEPS: usize = 6; // Newton's method doubles the digits: 3 would do
    (1..=n).map(move |root| {
        let mut x = (PI * (root as f64 - 0.25) / (n as f64 + 0.5)).cos();
        let mut slope = 0.0;
        for _ in 0..STEPS {
            let (mut last, mut this) = (1.0, x);
            for degree in 2..=n {
                let degree = degree as f64;
                (last, this) = (this, ((2.0 * degree - 1.0) * x * this - (degree - 1.0) * last) / degree);
            }
            slope = n as f64 * (x * this - last) / (x * x - 1.0);
            x -= this / slope;
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mechanics::{Medium, lambda};

    #[test]
    fn gauss_rule_integrates_polynomials_exactly() {
        let sum = |f: fn(f64) -> f64| gauss_legendre(20).map(|(x, weight)| weight * f(x)).sum::<f64>();
        assert!((sum(|_| 1.0) - 2.0).abs() < 1e-13);
        assert!((sum(|x| x.powi(38)) - 2.0 / 39.0).abs() < 1e-13);
        assert!((sum(f64::exp) - (1f64.exp() - (-1f64).exp())).abs() < 1e-13);
    }

    #[test]
    fn inverse_transform_of_the_half_space_is_lambda() {
        let table = HankelTable::inverse_of(|h| Medium::HalfSpace.transform(h));
        for i in 0..18000 {
            let k = f64::from(i) * 1.0913e-3;
            let (value, slope) = table.value_and_slope(k);
            let exact = -5.0 * k * lambda(k) / (k * k + 1.0);
            assert!((value - lambda(k)).abs() < 5e-9, "k {k}: {value} {}", lambda(k));
            assert!((slope - exact).abs() < 2e-7, "k {k}: {slope} {exact}");
        }
    }

    #[test]
    fn table_is_smooth_at_its_knots_and_ends_at_zero() {
        let table = HankelTable::inverse_of(|h| Medium::BondedLayer { poisson_ratio: 0.49 }.transform(h));
        for knot in 1..=CELLS {
            let (k, step) = (knot as f64 * PER_CELL, 1e-9);
            let ((below, slope_below), (above, slope_above)) =
                (table.value_and_slope(k - step), table.value_and_slope(k + step));
            assert!((below - above).abs() < 1e-8 && (slope_below - slope_above).abs() < 1e-7, "k = {k}");
        }
        assert_eq!(table.value_and_slope(FARTHEST), (0.0, 0.0));
        assert_eq!(table.value_and_slope(f64::INFINITY), (0.0, 0.0));
        assert!(table.value_and_slope(f64::NAN).0.is_nan());
    }
}
