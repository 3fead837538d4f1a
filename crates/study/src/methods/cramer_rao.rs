//! Smallest possible error: the bound of Cramer and Rao on any unbiased method that knows the specimen's response exactly.
//!
//! A reading's expectation is the skin's noise-free output. Its derivatives by x, y and force, weighted by the noise of the
//! reading, give the information. The inverse of the information is the covariance. The information in a signal-dependent
//! variance is ignored, and so is the noise of a calibration. A method that averages, or that knows that contacts are within an
//! area, is biased. Such a method can be better than a large bound: at low force, and in the corners.

use super::specimen::{KnownContact, KnownReadings};
use palpate_core::algebra::Matrix;
use palpate_core::quantity::Place;
use palpate_sim::scene::{NoiseOf, Skin, SkinSpec, TaxelFaultKind};
use palpate_solver::Covariance;

/// Half of the distance over which a slope is calculated, mm.
const STEP_MM: f64 = 1e-3;
/// Largest covariance, mm^2 and N^2. If it is larger, the matrix has no inverse.
const MOST: f64 = 1e6;

/// Standard deviation of a unit's error, reading units. It contains the noise and the converter's rounding (a step divided by the
/// square root of 12). `None` if the unit gives no information.
fn error_sd(spec: &SkinSpec, full_scale_n: f64, unit: usize, reading: f64) -> Option<f64> {
    for fault in spec.faults.iter().filter(|fault| fault.unit == unit + 1) {
        match fault.kind {
            TaxelFaultKind::Dead | TaxelFaultKind::Stuck(_) => return None,
            TaxelFaultKind::Clipped(most) if reading > most => return None,
            TaxelFaultKind::Clipped(_) | TaxelFaultKind::Drifted(_) => {}
        }
    }
    let of_noise = spec.noise.as_ref().map_or(0.0, |noise| {
        let share = noise.repeatability_percent.get(unit).map_or(0.0, |percent| percent / 300.0);
        let scale = match noise.of {
            NoiseOf::FullScale => full_scale_n,
            NoiseOf::Reading => reading,
        };
        (share * scale).hypot(noise.floor)
    });
    let step = spec.converter.map_or(0.0, |converter| 2.0 * converter.range / 2f64.powi(converter.bits.cast_signed()));
    Some(of_noise.hypot(step / 12f64.sqrt())).filter(|sd| *sd > 0.0)
}

/// Returns the smallest covariance of x (mm), y (mm) and force (N) for an unbiased method; `None` if the units don't determine
/// all three.
pub(crate) fn bound(skin: &Skin, spec: &SkinSpec, full_scale_n: f64, place: Place, force_n: f64) -> Option<Covariance> {
    let outputs = |x_mm: f64, y_mm: f64| {
        let mut outputs = vec![0.0; skin.len()];
        skin.add_load(1.0, Place::new(x_mm, y_mm), &mut outputs);
        outputs
    };
    let Place { x_mm, y_mm } = place;
    let here = outputs(x_mm, y_mm);
    let sides = [
        [outputs(x_mm + STEP_MM, y_mm), outputs(x_mm - STEP_MM, y_mm)],
        [outputs(x_mm, y_mm + STEP_MM), outputs(x_mm, y_mm - STEP_MM)],
    ];
    let mut information = Matrix::<3, 3>::ZERO;
    for (unit, per_n) in here.iter().enumerate() {
        let Some(sd) = error_sd(spec, full_scale_n, unit, force_n * per_n) else { continue };
        let slope = |[after, before]: &[Vec<f64>; 2]| force_n * (after[unit] - before[unit]) / (2.0 * STEP_MM);
        let row = Matrix::of([[slope(&sides[0]), slope(&sides[1]), *per_n]]) / sd;
        information += row.transpose() * row;
    }
    let covariance = *information.inverse()?.rows();
    (0..3).all(|i| (0.0..MOST).contains(&covariance[i][i])).then_some(Covariance(covariance))
}

/// Means of the bound over several contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanBound {
    /// Mean distance, mm.
    pub location_mm: f64,
    /// Mean force error, N.
    pub force_n: f64,
}

impl MeanBound {
    /// Returns the mean over the single contacts among the readings; `None` if the units don't determine one of them.
    pub fn over(skin: &Skin, spec: &SkinSpec, full_scale_n: f64, readings: &KnownReadings) -> Option<MeanBound> {
        let of = |truth: &KnownContact| bound(skin, spec, full_scale_n, truth.place, truth.force_n?);
        Self::mean(readings.truths.iter().map(|truth| of(truth).map(MeanBound::of)))
    }

    /// Returns the bound for one covariance.
    pub fn of(covariance: Covariance) -> MeanBound {
        MeanBound { location_mm: covariance.mean_distance_mm(), force_n: covariance.mean_force_error_n() }
    }

    /// Returns the mean of several bounds; `None` if one is missing or there are none.
    pub fn mean(bounds: impl Iterator<Item = Option<MeanBound>>) -> Option<MeanBound> {
        let bounds = bounds.collect::<Option<Vec<MeanBound>>>().filter(|bounds| !bounds.is_empty())?;
        let mean = |of: fn(&MeanBound) -> f64| bounds.iter().map(of).sum::<f64>() / bounds.len() as f64;
        Some(MeanBound { location_mm: mean(|bound| bound.location_mm), force_n: mean(|bound| bound.force_n) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::specimen::{FORCES_N, FULL_SCALE_N, NoiseReference, StudySpecimen, Touch, anywhere, grid};
    use super::*;
    use palpate_core::quantity::stream;
    use palpate_sim::scene::TaxelNoise;
    use palpate_solver::{Setting, Solver, fit};

    fn even(sd: f64) -> StudySpecimen {
        StudySpecimen::papers(NoiseReference::T).with(|skin| {
            let repeatability_percent = vec![300.0 * sd / FULL_SCALE_N; 9];
            skin.noise = Some(TaxelNoise { repeatability_percent, of: NoiseOf::FullScale, floor: 0.0 });
            skin.converter = None;
        })
    }

    #[test]
    fn bound_has_the_values_of_an_independent_program() {
        let specimen = even(0.01);
        let skin = specimen.skin(1);
        for (x_mm, y_mm, golden) in [
            (0.0, 0.0, [0.058443, 0.058443, 0.008986]),
            (2.25, 2.25, [0.036104, 0.036104, 0.011574]),
            (4.5, 4.5, [0.087329, 0.087329, 0.009995]),
            (6.0, 0.0, [0.246060, 0.073421, 0.066623]),
            (6.0, 6.0, [0.848750, 0.848750, 0.422704]),
        ] {
            let least = bound(&skin, &specimen.skin, FULL_SCALE_N, Place::new(x_mm, y_mm), 1.0).unwrap();
            for (ours, golden) in [least.x_mm(), least.y_mm(), least.force_n()].into_iter().zip(golden) {
                assert!((ours - golden).abs() < 1e-6, "({x_mm}, {y_mm}): {ours}, golden {golden}");
            }
        }
    }

    #[test]
    fn the_mean_over_area_and_forces_is_that_of_both_scenes() {
        for (noise, location_mm, force_n) in [(NoiseReference::T, 0.2288, 0.0181), (NoiseReference::Q, 0.0352, 0.0033)]
        {
            let specimen = StudySpecimen::papers(noise);
            let touches = anywhere(20_000, FORCES_N, &mut stream(3, 0, "test"));
            let mut skin = specimen.skin(1);
            let readings = KnownReadings::of(&mut skin, &touches, &mut stream(3, 1, "test"));
            let least = MeanBound::over(&skin, &specimen.skin, FULL_SCALE_N, &readings).unwrap();
            assert!((least.location_mm / location_mm - 1.0).abs() < 0.02, "{noise:?}: {least:?}");
            assert!((least.force_n / force_n - 1.0).abs() < 0.02, "{noise:?}: {least:?}");
        }
    }

    #[test]
    fn expected_error_is_the_bound_and_the_map_error() {
        let specimen = StudySpecimen::papers(NoiseReference::T);
        let mut skin = specimen.skin(1);
        let presses = KnownReadings::of(&mut skin, &grid(25), &mut stream(5, 0, "calibration"));
        let setting = Setting::of_layout(Some(&specimen.layout));
        for name in ["physics", "surrogate"] {
            let fitted = fit(name, &presses.calibration().unwrap(), &setting).unwrap();
            for (x_mm, y_mm) in [(0.0, 0.0), (2.25, -2.25), (4.0, 1.0), (-5.5, 5.5)] {
                let place = Place::new(x_mm, y_mm);
                let known = bound(&skin, &specimen.skin, FULL_SCALE_N, place, 0.5).unwrap();
                let expected = fitted.expected(place, 0.5).unwrap();
                let ratio = expected.mean_distance_mm() / known.mean_distance_mm();
                assert!((0.85..1.25).contains(&ratio), "{name} at ({x_mm}, {y_mm}): {ratio}");
            }
        }
        let pearson = fit("pearson", &presses.calibration().unwrap(), &setting).unwrap();
        assert_eq!(pearson.expected(Place::default(), 0.5), None, "it has no map");
    }

    #[test]
    fn uninformative_units_have_no_bound() {
        let specimen = StudySpecimen::square(NoiseReference::T, 1, 4.5);
        assert_eq!(bound(&specimen.skin(1), &specimen.skin, FULL_SCALE_N, Place::default(), 1.0), None);
        let touch = Touch { place: Place::default(), force_n: 1.0, second: Some(Place::default()) };
        let papers = StudySpecimen::papers(NoiseReference::T);
        let mut skin = papers.skin(1);
        let readings = KnownReadings::of(&mut skin, &[touch], &mut stream(1, 0, "test"));
        assert_eq!(MeanBound::over(&skin, &papers.skin, FULL_SCALE_N, &readings), None, "two contacts");
    }
}
