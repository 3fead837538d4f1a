//! Force as a function of depth, learned from presses.

/// Curve of the force against the depth, learned from the loading paths of all presses: `linear s + quadratic s^2`.
///
/// Only sums are stored, so the size of the curve doesn't grow.
#[derive(Clone, Debug, Default)]
pub(super) struct Curve {
    s2: f64,
    s3: f64,
    s4: f64,
    fs: f64,
    fs2: f64,
    most_n: f64,
}

/// State of a curve at one moment of learning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CurveShape {
    linear_n_mm: f64,
    quadratic_n_mm2: f64,
}

/// Weight of the prior that a specimen doesn't stiffen, mm^4. A single point at 0.2 mm has the same weight.
const STRAIGHT: f64 = 1.6e-3;

impl Curve {
    /// Adds a loading path: depth below the touched surface, mm, and force, N.
    pub(crate) fn learn(&mut self, path: impl Iterator<Item = (f64, f64)>) {
        for (s, force_n) in path.filter(|&(s, force_n)| s > 0.0 && force_n > 0.0) {
            self.s2 += s * s;
            self.s3 += s.powi(3);
            self.s4 += s.powi(4);
            self.fs += force_n * s;
            self.fs2 += force_n * s * s;
            self.most_n = self.most_n.max(force_n);
        }
    }

    /// Largest force among the data of the curve, N.
    pub(crate) fn most_n(&self) -> f64 {
        self.most_n
    }

    /// Returns the curve by least squares; `None` before the first path was added.
    pub(crate) fn shape(&self) -> Option<CurveShape> {
        if self.s2 <= 0.0 {
            return None;
        }
        let s4 = self.s4 + STRAIGHT;
        let quadratic = ((self.s2 * self.fs2 - self.s3 * self.fs) / (self.s2 * s4 - self.s3 * self.s3)).max(0.0);
        let linear = (self.fs - quadratic * self.s3) / self.s2;
        (linear > 0.0).then_some(CurveShape { linear_n_mm: linear, quadratic_n_mm2: quadratic })
    }
}

impl CurveShape {
    /// Force at a depth, N.
    pub(crate) fn force_n(&self, s: f64) -> f64 {
        let s = s.max(0.0);
        s * (self.linear_n_mm + self.quadratic_n_mm2 * s)
    }

    /// Depth at a force, mm.
    pub(crate) fn depth_mm(&self, force_n: f64) -> f64 {
        let (a, b, f) = (self.linear_n_mm, self.quadratic_n_mm2, force_n.max(0.0));
        2.0 * f / (a + (a * a + 4.0 * b * f).sqrt())
    }

    /// Slope at a depth, N/mm.
    pub(crate) fn stiffness_n_mm(&self, s: f64) -> f64 {
        self.linear_n_mm + 2.0 * self.quadratic_n_mm2 * s.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curve_of_a_path_is_recovered() {
        let mut curve = Curve::default();
        assert_eq!(curve.shape(), None);
        let force = |s: f64| 1.1 * s + 0.1556 * s * s;
        for _ in 0..20 {
            curve.learn((1..=8).map(|i| 0.1 * f64::from(i)).map(|s| (s, force(s))));
        }
        let shape = curve.shape().unwrap();
        assert!((shape.force_n(0.7) - force(0.7)).abs() < 1e-3, "{shape:?}");
        assert!((shape.depth_mm(shape.force_n(0.7)) - 0.7).abs() < 1e-12);
        assert!((shape.stiffness_n_mm(0.8) - (1.1 + 0.3112 * 0.8)).abs() < 0.02);
        assert!((curve.most_n() - force(0.8)).abs() < 1e-12);
    }
}
