//! Hankel transforms (order 0) of a pressure or an average over a disc, 1 at 0, for loads and taxels that aren't points. The
//! response of a spread taxel to a spread load is the point response with both transforms multiplied in.

/// Pressure under a rigid flat punch of radius a that carries 1 N: `p = 1 / (2 pi a sqrt(a^2 - r^2))` (Johnson, Contact
/// Mechanics, section 3.4). This is the pressure on a half-space, and it holds on a layer while a is small compared with the
/// layer's thickness. `x` is the wave number times a.
pub(super) fn flat_punch(x: f64) -> f64 {
    if x < SMALL { 1.0 - x * x / 6.0 } else { x.sin() / x }
}

/// Mean over a disc of radius b. `x` is the wave number times b.
pub(super) fn disc(x: f64) -> f64 {
    if x < SMALL { 1.0 - x * x / 8.0 } else { 2.0 * libm::j1(x) / x }
}

/// Value below which the first two terms of the series are exact to the last digit.
const SMALL: f64 = 1e-4;

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// The transform directly: the mean of `J0(x r / a)` over the load, `J0` by its integral. `r` of a share of the load.
    fn directly(x: f64, r_of_share: impl Fn(f64) -> f64) -> f64 {
        let (rings, rays) = (4000, 64);
        let ring = |i: i32| {
            let r = r_of_share((f64::from(i) + 0.5) / f64::from(rings));
            (0..rays).map(|j| (x * r * (TAU * f64::from(j) / f64::from(rays)).cos()).cos()).sum::<f64>()
                / f64::from(rays)
        };
        (0..rings).map(ring).sum::<f64>() / f64::from(rings)
    }

    #[test]
    fn the_transforms_are_those_of_the_loads() {
        for x in [0.0, 5e-5, 1e-3, 0.4, 2.0, 9.0] {
            // within r of a punch's centre is 1 - sqrt(1 - r^2) of its load, of a disc's r^2 of its area
            let (punch, mean) = (directly(x, |s| (1.0 - (1.0 - s) * (1.0 - s)).sqrt()), directly(x, f64::sqrt));
            assert!((flat_punch(x) - punch).abs() < 1e-5, "{x}: {} {punch}", flat_punch(x));
            assert!((disc(x) - mean).abs() < 1e-5, "{x}: {} {mean}", disc(x));
        }
    }
}
