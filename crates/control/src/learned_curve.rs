//! Depth that the presses so far needed for their force. The next press near them is compared with it.

use super::curve::CurveShape;
use super::neighbours::{
    FieldSmoothness, LEARNED, Misses, OWN, SAME_MM, SIGMAS, most_changed, most_off_by, nearest, remember, weights,
};
use palpate_core::quantity::Place;

/// Least number of places for a comparison with presses at other places.
const PLACES_LEAST: usize = 4;
/// Number of places that are remembered.
const PLACES_MAX: usize = 2048;
/// Least rise of the force for a press to be remembered, as a fraction of its final force.
const ROSE_SHARE: f64 = 0.5;
/// Change of the logarithm of the stiffness over a specimen. Elastomers of a few mm have free edges about as wide as they are thick.
const STIFFNESS: FieldSmoothness = FieldSmoothness { length_mm: 3.0, spread: 0.25 };
/// Fraction of the usual limit of a difference, in sd. Stiffness is smoother than outputs, and where presses are a few mm apart the
/// usual limit lets half the gain of a load cell pass.
const STRICTER: f64 = 0.75;
/// Error of a distance, mm, from the read-back and a contact that isn't flat.
pub(super) const WAY_MM: f64 = 0.010;
/// Fraction of the distance of the softest press around beyond which a press is too soft with any scatter.
const SOFTEST_SHARE: f64 = 0.55;
/// Standard deviation of a prediction, as a fraction, up to which a press may go as deep as predicted at once.
const SURE: f64 = 0.10;
/// Excess of the predicted force over the set force at which a press near the limit ends: least and largest, as fractions, and in
/// sd of the prediction. The third fraction is the excess over the limit for the softest press around, before there is a prediction.
const OVER: (f64, f64) = (0.02, 0.05);
const OVER_SIGMAS: f64 = 1.5;
const OVER_SOFTEST: f64 = 0.20;
/// Room below the limit that a prediction leaves, in sd, until the load cell has shown that it follows.
const UNDER_SIGMAS: f64 = 3.0;

/// Rise of the force that a press showed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rise {
    /// Force at the start and at the end, N.
    pub from_n: f64,
    pub to_n: f64,
    /// Distance that the rise took, mm.
    pub way_mm: f64,
}

/// Rises that the presses have shown.
#[derive(Clone, Debug, Default)]
pub(super) struct Rises {
    /// The first rise at each place. Later ones don't change it: a failing load cell would.
    all: Vec<(Place, Rise)>,
    misses: Misses,
}

/// Ratio of the distance to that on the curve that is predicted for a place.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PredictedSoftness {
    softness: f64,
    /// Standard deviation of its logarithm, and the largest difference of a sound press in standard deviations.
    sigma: f64,
    sigmas: f64,
}

/// Change of the depth that a force needs at one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sunk {
    /// Change of the logarithm of the depth for the force.
    pub depth: f64,
    /// Change of the logarithm of the force that this depth indicates, relative to the force that was measured.
    pub force: f64,
    /// Limit of the change of the depth.
    pub limit: f64,
}

impl Sunk {
    /// Compares two presses at a place, each by its force, N, and its depth, mm. The limit covers the error of both depths. `None`
    /// if one of them shows nothing.
    pub(crate) fn of(shape: CurveShape, [before, now]: [(f64, f64); 2]) -> Option<Sunk> {
        let softness = |(to_n, way_mm): (f64, f64)| Rise { from_n: 0.0, to_n, way_mm }.softness(shape);
        let sunk = Sunk {
            depth: (softness(now) / softness(before)).ln(),
            force: (shape.force_n(now.1 / softness(before)) / now.0).ln(),
            limit: most_changed((WAY_MM / before.1).hypot(WAY_MM / now.1)),
        };
        [sunk.depth, sunk.force, sunk.limit].iter().all(|value| value.is_finite()).then_some(sunk)
    }
}

/// Softness of an earlier press.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownSoftness {
    shape: CurveShape,
    softness: f64,
}

impl KnownSoftness {
    /// Depth of a force with this softness, mm.
    pub(crate) fn depth_mm(&self, force_n: f64) -> f64 {
        self.softness * self.shape.depth_mm(force_n)
    }
}

/// Information from the presses around a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearnedCurve {
    shape: CurveShape,
    /// Largest force for which the curve is used, N.
    most_n: f64,
    /// Largest ratio of the distance to that on the curve among the presses around.
    softest: f64,
    /// `None` before enough places.
    predicted: Option<PredictedSoftness>,
}

impl Rise {
    /// Ratio of the distance to that on the curve.
    fn softness(&self, shape: CurveShape) -> f64 {
        self.way_mm / (shape.depth_mm(self.to_n) - shape.depth_mm(self.from_n))
    }
}

impl Rises {
    /// Adds the first rise at a place. If there is no room left, it replaces the nearest one.
    pub(crate) fn learn(&mut self, place: Place, rise: Rise, shape: Option<CurveShape>) {
        let tells = rise.to_n - rise.from_n >= ROSE_SHARE * rise.to_n && rise.way_mm > 0.0;
        if !tells || self.at(place).is_some() {
            return;
        }
        if self.all.len() >= LEARNED {
            self.learn_miss(place, rise, shape);
        }
        remember(&mut self.all, (place, rise), PLACES_MAX, |(at, _)| *at);
        if self.all.len() == LEARNED {
            self.all.clone().into_iter().for_each(|(place, rise)| self.learn_miss(place, rise, shape));
        }
    }

    /// Adds how far the rises at other places miss a rise.
    fn learn_miss(&mut self, place: Place, rise: Rise, shape: Option<CurveShape>) {
        let Some(shape) = shape else { return };
        let others: Vec<(Place, Rise)> =
            self.all.iter().filter(|(at, _)| at.distance_mm(place) >= SAME_MM).copied().collect();
        let near = nearest_of(&others, place);
        if let Some((softness, sigma)) = kriged(&near, place, shape) {
            let sigma = (self.misses.scale() * sigma).hypot(WAY_MM / rise.way_mm);
            self.misses.learn((rise.softness(shape) / softness).ln(), sigma, near[0].0.distance_mm(place));
        }
    }

    /// First rise at a place.
    fn at(&self, place: Place) -> Option<&Rise> {
        self.all.iter().find(|(at, _)| at.distance_mm(place) < SAME_MM).map(|(_, rise)| rise)
    }

    /// Returns the first press at a place, or else the stiffest of the nearest ones; `None` before the first press, and where the places
    /// around predict the force.
    pub(crate) fn doubted(&self, place: Place, shape: Option<CurveShape>) -> Option<KnownSoftness> {
        let (shape, near, here) = (shape?, nearest_of(&self.all, place), self.at(place));
        if self.all.len() >= LEARNED && self.predicted(&near, here, place, shape).is_some() {
            return None;
        }
        let stiffest = near.iter().map(|(_, rise)| rise.softness(shape)).fold(f64::INFINITY, f64::min);
        let softness = here.map_or(stiffest, |here| here.softness(shape));
        (softness.is_finite() && softness > 0.0).then_some(KnownSoftness { shape, softness })
    }

    /// Returns the information from the presses around a place; `None` if there are too few. `most_n` is the largest force
    /// for which the curve is used, N.
    pub(crate) fn around(&self, place: Place, shape: Option<CurveShape>, most_n: f64) -> Option<LearnedCurve> {
        let here = self.at(place);
        let shape = shape.filter(|_| self.all.len() >= PLACES_LEAST || here.is_some())?;
        let near = nearest_of(&self.all, place);
        let softest = near.iter().map(|(_, rise)| rise.softness(shape)).fold(0.0, f64::max);
        let predicted = self.predicted(&near, here, place, shape);
        (softest.is_finite() && softest > 0.0).then_some(LearnedCurve { shape, most_n, softest, predicted })
    }

    /// Returns what the nearest places predict, the place itself among them if it was pressed. `None` where nothing has tested it.
    fn predicted(
        &self,
        near: &[(Place, Rise)],
        here: Option<&Rise>,
        place: Place,
        shape: CurveShape,
    ) -> Option<PredictedSoftness> {
        if self.all.len() < LEARNED {
            let here = here?;
            let sigma = OWN.hypot(WAY_MM / here.way_mm);
            return Some(PredictedSoftness { softness: here.softness(shape), sigma, sigmas: SIGMAS });
        }
        if !self.misses.have_tested(near.first()?.0.distance_mm(place)) {
            return None;
        }
        let (softness, sigma) = kriged(near, place, shape)?;
        Some(PredictedSoftness { softness, sigma: sigma * self.misses.scale(), sigmas: self.misses.sigmas() })
    }
}

/// Returns the nearest rises, nearest first.
fn nearest_of(all: &[(Place, Rise)], place: Place) -> Vec<(Place, Rise)> {
    nearest(all.iter().map(|(at, _)| *at), place).into_iter().map(|i| all[i]).collect()
}

/// Returns the ratio of the distance to that on the curve that rises predict for a place, and the standard deviation of its logarithm
/// before anything was learned of the misses.
fn kriged(near: &[(Place, Rise)], place: Place, shape: CurveShape) -> Option<(f64, f64)> {
    let places: Vec<Place> = near.iter().map(|(at, _)| *at).collect();
    let own: Vec<f64> = near.iter().map(|(_, rise)| WAY_MM / rise.way_mm).collect();
    let weights = weights(&places, &own, place, STIFFNESS)?;
    let parts = near.iter().zip(&weights.each).map(|((_, rise), weight)| weight * rise.softness(shape).ln());
    let softness = parts.sum::<f64>().exp();
    (softness.is_finite() && softness > 0.0).then_some((softness, weights.sigma))
}

impl PredictedSoftness {
    /// Largest difference of the logarithm, with a further standard deviation of `own`.
    fn most_off(&self, own: f64) -> f64 {
        most_off_by(STRICTER * self.sigmas, self.sigma.hypot(own))
    }
}

impl LearnedCurve {
    /// Longest distance that a rise of the force may need at that place, mm.
    pub fn longest_mm(&self, from_n: f64, to_n: f64) -> f64 {
        let on_curve_mm = self.on_curve_mm(from_n, to_n);
        let most = self.softest / SOFTEST_SHARE;
        let predicted = self.predicted.map(|of| of.softness * of.most_off(0.0).exp());
        predicted.map_or(most, |predicted| predicted.min(most)) * on_curve_mm + WAY_MM
    }

    /// Shortest distance that a rise of the force may need at that place, mm; 0 if too little is known.
    pub fn shortest_mm(&self, from_n: f64, to_n: f64) -> f64 {
        let least = self.predicted.map_or(0.0, |of| of.softness * (-of.most_off(0.0)).exp());
        (least * self.on_curve_mm(from_n, to_n) - WAY_MM).max(0.0)
    }

    /// Share of the allowed difference that a rise of the force over a distance uses up; `None` if too little is known.
    pub fn share(&self, from_n: f64, to_n: f64, way_mm: f64) -> Option<f64> {
        let predicted = self.predicted?;
        let expected_mm = predicted.softness * self.on_curve_mm(from_n, to_n);
        Some((way_mm / expected_mm).ln().abs() / predicted.most_off(WAY_MM / expected_mm))
    }

    /// Force, N, of the softest of them at a position deeper by `way_mm` than where the force is `from_n`.
    pub fn force_n(&self, from_n: f64, way_mm: f64) -> f64 {
        self.shape.force_n(self.shape.depth_mm(from_n) + way_mm / self.softest)
    }

    /// Depth, mm, that a press of `set_n` may not exceed; infinite beyond the learned forces. There the predicted force is
    /// `limit_n`, or a little more than `set_n` if that is near the limit.
    pub fn deepest_mm(&self, limit_n: f64, set_n: f64) -> f64 {
        if limit_n > self.most_n {
            return f64::INFINITY;
        }
        let (softness, to_n) = match self.predicted {
            Some(PredictedSoftness { softness, sigma, .. }) => {
                let over = (OVER_SIGMAS * sigma).clamp(OVER.0, OVER.1);
                (softness, limit_n.max((1.0 + over) * set_n))
            }
            None => (self.softest, (1.0 + OVER_SOFTEST) * limit_n),
        };
        softness * self.shape.depth_mm(to_n) + WAY_MM
    }

    /// Depth, mm, at which the force is within `limit_n` by what the presses around have shown, with any reading of the load
    /// cell; 0 if they have shown too little.
    pub fn safe_mm(&self, limit_n: f64) -> f64 {
        match self.predicted {
            Some(PredictedSoftness { softness, sigma, .. }) if sigma <= SURE => {
                let to_n = limit_n.min(self.most_n);
                softness * self.shape.depth_mm(to_n) * (-UNDER_SIGMAS * sigma).exp()
            }
            _ => 0.0,
        }
    }

    fn on_curve_mm(&self, from_n: f64, to_n: f64) -> f64 {
        self.shape.depth_mm(to_n) - self.shape.depth_mm(from_n)
    }
}
