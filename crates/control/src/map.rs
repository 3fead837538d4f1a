//! Knowledge from earlier presses: the surface, the curve, and how much deeper each press went.

use super::curve::{Curve, CurveShape};
use super::learned_curve::{KnownSoftness, LearnedCurve, Rise, Rises, Sunk};
use super::neighbours::{SAME_MM, nearest};
use super::plane::BayesianPlane;
use super::surface::{Expected, SurfaceMap};
use palpate_core::quantity::{Limits, Place};
use serde::{Deserialize, Serialize};

/// Height of a corner of a way above both ends that the clearance allows for, mm.
const CORNER_MM: f64 = 0.02;

/// Number of touches from which the surface is known. A plane needs three, and the fourth touch checks the plane.
const LEARNED_LEAST: usize = 4;
/// Least distance of the aim of a first shot from the force limit, N. This press hasn't yet shown the properties of its place.
const SHOT_ROOM_N: f64 = 0.06;
/// Largest force for which the curve is used, as a multiple of the largest force that the curve was learned from.
const BEYOND: f64 = 1.3;
/// Largest uncertainty of a shot, as a fraction of the set force. Above it the map can't be trusted (CONTROL 1).
const TRUST: f64 = 0.15;
/// Distance between the aim of a shot and the set force, in sd of the force at which the shot may end. The other two constants
/// are the least and the largest distance, as fractions of the set force.
const SHORT_SIGMAS: f64 = 3.0;
const SHORT_LEAST: f64 = 0.02;
const SHORT_MOST: f64 = 0.45;
/// Assumed error of a shot before the first shot: sd of the height, mm, and sd of the depth, as a fraction of the depth.
const HEIGHT_SIGMA_MM: f64 = 0.010;
const DEPTH_SIGMA: f64 = 0.04;
/// Weight of that assumption, in shots. The second constant is the number of shots over which misses are remembered.
const MISS_PRIOR: f64 = 3.0;
const MISS_MEMORY: f64 = 30.0;
/// Largest miss that counts, in sd. One bad press doesn't end the trust in a map.
const MISS_MOST: f64 = 5.0;
/// Least and largest ratio of the shown depth to the expected depth of a place. Outside this range the reading is doubted.
const SURPRISES: [f64; 2] = [0.8, 1.25];
/// Least and largest accepted ratio of a place's depth to the depth on the curve.
const SCALES: [f64; 2] = [0.3, 3.0];
/// Number of shots that are remembered.
const SHOTS_MAX: usize = 2048;
/// Index of the neighbour whose distance is the reach of the weights, counted from 0.
const REACH: usize = 5;
/// Sd of one shot's scale about the local plane. The other constants are the sd of the plane's height and the sd of its slope,
/// 1/mm.
const SCALE_SIGMA: f64 = 0.005;
const SCALE_LEVEL: f64 = 0.06;
const SCALE_SLOPE: f64 = 0.02;
/// Largest accepted fading of a press, as a fraction of the set force.
const FADED_MOST: f64 = 0.2;
/// Least weight of a new press in the learned fading.
const FADE_GAIN: f64 = 0.1;

/// Information from one press for later presses, as stored in the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LearnedContact {
    /// A guarded press: position of the surface, and growth of the force below it.
    Touch {
        /// The place, specimen frame.
        #[serde(flatten)]
        place: Place,
        /// Position where contact began, mm into the specimen.
        z_mm: f64,
        /// Loading path at rest: z, mm, and force, N.
        path: Vec<(f64, f64)>,
    },
    /// A press whose first motion went to the position that the map gave.
    Shot {
        /// The place, specimen frame.
        #[serde(flatten)]
        place: Place,
        /// Position where the first motion ended, mm into the specimen.
        z_mm: f64,
        /// Force measured at that position, N.
        force_n: f64,
        /// Force that the map expected at that position, N.
        expected_n: f64,
        /// Force lost between the last correction and the mean of the window, as a fraction of the set force.
        faded: f64,
    },
}

/// Knowledge of a specimen from the presses so far: its surface, its curve, and how both vary from place to place.
#[derive(Clone, Debug)]
pub struct ContactMap {
    surface: SurfaceMap,
    curve: Curve,
    rises: Rises,
    /// Places of the shots, and how much deeper than on the curve the force was reached there, as a fraction.
    scales: Vec<(Place, f64)>,
    shots: f64,
    /// Mean square of the misses, in units of the assumed miss.
    miss: f64,
    faded: Option<f64>,
}

/// Prediction of a map for one place: the depth at which a force will be reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    surface_mm: f64,
    shape: CurveShape,
    /// Ratio of the depth at this place to the depth on the curve.
    scale: f64,
    /// Force to aim at, as a fraction of the set force.
    aim: f64,
    /// Force that is lost until the middle of the window, as a fraction of the set force.
    pub(super) faded: f64,
}

impl ContactMap {
    /// Creates a map that contains only this: the surface is within `uncertainty_mm` of z = 0.
    pub fn new(uncertainty_mm: f64) -> Self {
        ContactMap {
            surface: SurfaceMap::new(uncertainty_mm),
            curve: Curve::default(),
            rises: Rises::default(),
            scales: Vec::new(),
            shots: 0.0,
            miss: 1.0,
            faded: None,
        }
    }

    /// Returns the expected position of the surface.
    pub fn expect(&self, place: Place) -> Expected {
        self.surface.expect(place)
    }

    /// Returns the earliest z at which contact is possible on the way between two places, mm. One axis may arrive before the other, so the
    /// way is anywhere in the rectangle between the places.
    pub fn first_on_way_mm(&self, here: Place, there: Place) -> f64 {
        let first_mm = |x: Place, y: Place| self.expect(Place::new(x.x_mm, y.y_mm)).first_mm;
        let ends_mm = first_mm(here, here).min(first_mm(there, there));
        let corners_mm = first_mm(here, there).min(first_mm(there, here));
        if corners_mm < ends_mm - CORNER_MM { corners_mm } else { ends_mm }
    }

    /// Whether the specimen was touched. Before the first touch the map only repeats the frame, and no motion may rely on that.
    pub fn is_touched(&self) -> bool {
        self.surface.touches() > 0
    }

    /// Adds the information from a press.
    pub fn learn(&mut self, learned_contact: &LearnedContact) {
        match learned_contact {
            LearnedContact::Touch { place, z_mm, path } => {
                self.surface.learn(*place, *z_mm);
                self.curve.learn(path.iter().map(|(z, force_n)| (z - z_mm, *force_n)));
                if let (Some(&(from_mm, from_n)), Some(&(to_mm, to_n))) = (path.first(), path.last()) {
                    let rise = Rise { from_n, to_n, way_mm: to_mm - from_mm };
                    self.rises.learn(*place, rise, self.curve.shape());
                }
            }
            LearnedContact::Shot { place, z_mm, force_n, expected_n, faded } => {
                let Some(shape) = self.curve.shape().filter(|_| *force_n > 0.0) else { return };
                let (depth_mm, on_curve_mm) = (z_mm - self.expect(*place).z_mm, shape.depth_mm(*force_n));
                self.rises.learn(*place, Rise { from_n: 0.0, to_n: *force_n, way_mm: depth_mm }, Some(shape));
                let miss_mm = (force_n - expected_n) / shape.stiffness_n_mm(on_curve_mm);
                let misses = (miss_mm / assumed_sigma_mm(on_curve_mm)).powi(2).min(MISS_MOST.powi(2));
                self.miss += (misses - self.miss) / (self.shots + MISS_PRIOR).min(MISS_MEMORY);
                self.shots += 1.0;
                let scale = depth_mm / on_curve_mm;
                if (SCALES[0]..=SCALES[1]).contains(&scale) {
                    self.remember(*place, scale - 1.0);
                }
                let gain = (1.0 / self.shots).max(FADE_GAIN);
                let faded = faded.clamp(-FADED_MOST, FADED_MOST);
                let before = self.faded.unwrap_or(faded);
                self.faded = Some(before + gain * (faded - before));
            }
        }
    }

    /// Returns the prediction for a shot at a place, or `None` if the map can't be trusted there. Reasons: the map has learned
    /// too little, the force is too near the limit or beyond the learned forces, or the surface or the stiffness varies too much.
    pub fn shot(&self, place: Place, force_set_n: f64, limits: &Limits) -> Option<Shot> {
        let shape = self.curve.shape()?;
        let known_n = (BEYOND * self.curve.most_n()).min(limits.force_n - SHOT_ROOM_N);
        if self.surface.touches() < LEARNED_LEAST || force_set_n > known_n {
            return None;
        }
        let depth_mm = shape.depth_mm(force_set_n);
        let (scale, scale_sigma) = self.scale(place);
        let missed_mm = self.miss.sqrt() * assumed_sigma_mm(depth_mm);
        let sigma_mm = missed_mm.hypot(scale_sigma * depth_mm).max(self.roughness_mm());
        let sigma = shape.stiffness_n_mm(depth_mm) * sigma_mm / force_set_n;
        if sigma > TRUST {
            return None;
        }
        Some(Shot {
            surface_mm: self.expect(place).z_mm,
            shape,
            scale: (1.0 + scale).clamp(SCALES[0], SCALES[1]),
            aim: 1.0 - (SHORT_SIGMAS * sigma).clamp(SHORT_LEAST, SHORT_MOST),
            faded: self.faded.unwrap_or(0.0),
        })
    }

    /// Returns how deep the presses around a place went for their force; `None` if there are too few.
    pub fn learned_curve(&self, place: Place) -> Option<LearnedCurve> {
        self.rises.around(place, self.curve.shape(), BEYOND * self.curve.most_n())
    }

    /// Returns the press by which a force at a place is doubted that needs a much larger depth; `None` beyond the learned forces, before the
    /// first press, and where the places around predict the force.
    pub fn doubted(&self, place: Place, force_set_n: f64) -> Option<KnownSoftness> {
        if force_set_n > BEYOND * self.curve.most_n() {
            return None;
        }
        self.rises.doubted(place, self.curve.shape())
    }

    /// Compares two presses at a place, each by its force, N, and its depth, mm. `None` before the first press, or if one of them
    /// shows nothing.
    pub fn compare(&self, presses: [(f64, f64); 2]) -> Option<Sunk> {
        Sunk::of(self.curve.shape()?, presses)
    }

    /// Scatter of the touches beyond their usual scatter, mm.
    fn roughness_mm(&self) -> f64 {
        if self.shots > MISS_MEMORY { 0.0 } else { self.surface.excess_mm() }
    }

    /// Stores a shot. If there is no more room, or an earlier shot was made at the same place, the new shot replaces the nearest
    /// one. The knowledge of other places remains.
    fn remember(&mut self, place: Place, scale: f64) {
        let distance_mm = |at: &Place| at.distance_mm(place);
        let is_full = self.scales.len() >= SHOTS_MAX;
        let nearest = self.scales.iter_mut().min_by(|(a, _), (b, _)| distance_mm(a).total_cmp(&distance_mm(b)));
        match nearest {
            Some(near) if distance_mm(&near.0) < SAME_MM => *near = (place, scale),
            Some(near) if is_full => *near = (place, scale),
            _ => self.scales.push((place, scale)),
        }
    }

    /// Returns the scale of the local plane through the nearest shots, and its sd. Before the first shot, the curve is used
    /// unchanged.
    fn scale(&self, place: Place) -> (f64, f64) {
        let near: Vec<(Place, f64)> =
            nearest(self.scales.iter().map(|(at, _)| *at), place).into_iter().map(|i| self.scales[i]).collect();
        if near.is_empty() {
            return (0.0, 0.0); // the assumption about a shot is right
        }
        let reach_mm = near[REACH.min(near.len() - 1)].0.distance_mm(place).max(0.1);
        let mut plane = BayesianPlane::new(
            place,
            [
                (SCALE_SIGMA / SCALE_LEVEL).powi(2),
                (SCALE_SIGMA / SCALE_SLOPE).powi(2),
                (SCALE_SIGMA / SCALE_SLOPE).powi(2),
            ],
        );
        for (at, scale) in near {
            plane.take(at, scale, 1.0 / (1.0 + (at.distance_mm(place) / reach_mm).powi(2)).powi(2));
        }
        let (scale, spread) = plane.at(place);
        (scale, SCALE_SIGMA * spread.sqrt())
    }
}

impl Shot {
    /// Position where a force will be reached, mm into the specimen.
    pub fn z_mm(&self, force_n: f64) -> f64 {
        self.surface_mm + self.scale * self.shape.depth_mm(force_n)
    }

    /// Force to aim the first motion at, N. This force is below the set force by the possible miss.
    pub(crate) fn aim_n(&self, force_set_n: f64) -> f64 {
        self.aim * force_set_n
    }

    /// Expected force at a position, N.
    pub fn force_n(&self, z_mm: f64) -> f64 {
        self.shape.force_n((z_mm - self.surface_mm) / self.scale)
    }

    /// Stiffness at a force, N/mm, from the result of this shot: `force_n` at `z_mm`.
    pub fn stiffness_n_mm(&self, at_n: f64, z_mm: f64, force_n: f64) -> f64 {
        let met = (z_mm - self.surface_mm) / self.shape.depth_mm(force_n);
        let [least, most] = SURPRISES.map(|surprise| surprise * self.scale);
        let scale = if met.is_finite() { met.clamp(least, most) } else { self.scale };
        self.shape.stiffness_n_mm(self.shape.depth_mm(at_n)) / scale
    }

    /// Position of the surface, mm into the specimen.
    pub fn surface_mm(&self) -> f64 {
        self.surface_mm
    }

    /// Depth and stiffness at a force if the curve holds unchanged, mm and N/mm.
    pub(crate) fn on_curve(&self, force_n: f64) -> (f64, f64) {
        let depth_mm = self.shape.depth_mm(force_n);
        (depth_mm, self.shape.stiffness_n_mm(depth_mm))
    }
}

/// Assumed sd of the position where a force is reached, before shots give a better value, mm.
fn assumed_sigma_mm(depth_mm: f64) -> f64 {
    HEIGHT_SIGMA_MM.hypot(DEPTH_SIGMA * depth_mm)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: Limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };

    /// A specimen with a tilt and a stiffness that varies by a few percent over some millimetres.
    fn depth_mm(place: Place, force_n: f64) -> f64 {
        let scale = 1.0 + 0.05 * (0.6 * place.x_mm).sin() * (0.5 * place.y_mm).cos();
        scale * force_n / 1.3
    }

    fn surface_mm(place: Place) -> f64 {
        0.02 * place.x_mm - 0.01 * place.y_mm
    }

    fn touch(place: Place) -> LearnedContact {
        let path = (1..=8).map(|i| 0.125 * f64::from(i)).map(|n| (surface_mm(place) + n / 1.3, n)).collect();
        LearnedContact::Touch { place, z_mm: surface_mm(place), path }
    }

    fn learned_curve() -> ContactMap {
        let mut map = ContactMap::new(0.3);
        for (x, y) in [(-6.0, -6.0), (6.0, -6.0), (-6.0, 6.0), (6.0, 6.0), (0.0, 0.0)] {
            map.learn(&touch(Place::new(x, y)));
        }
        map
    }

    /// A shot at a place in a simulation: the learned contact, and the error of its force.
    fn shoot(map: &ContactMap, place: Place) -> (LearnedContact, f64) {
        let shot = map.shot(place, 1.0, &LIMITS).expect("the map is trusted");
        let z_mm = shot.z_mm(shot.aim_n(1.0));
        let force_n = (z_mm - surface_mm(place)) / depth_mm(place, 1.0);
        let expected_n = shot.force_n(z_mm);
        (LearnedContact::Shot { place, z_mm, force_n, expected_n, faded: 0.006 }, force_n - expected_n)
    }

    #[test]
    fn cell_that_reads_less_changes_depth_and_true_force() {
        let (map, place) = (learned_curve(), Place::new(1.0, 1.0));
        let sunk = map.compare([(1.0, depth_mm(place, 1.0)), (1.0, depth_mm(place, 1.0 / 0.7))]).unwrap();
        assert!((sunk.force - (1.0f64 / 0.7).ln()).abs() < 0.02 && sunk.depth > sunk.limit, "{sunk:?}");
        let same = map.compare([(1.0, depth_mm(place, 1.0)), (1.03, depth_mm(place, 1.03))]).unwrap();
        assert!(same.depth.abs() < 0.01 && same.force.abs() < 0.01, "{same:?}");
        assert_eq!(map.compare([(1.0, 0.0), (1.0, 0.5)]), None);
        assert_eq!(ContactMap::new(0.3).compare([(1.0, 0.5), (1.0, 0.5)]), None);
    }

    #[test]
    fn errors_of_shots_fall_along_a_raster() {
        let mut map = learned_curve();
        let first_aim = map.shot(Place::new(-6.0, -6.0), 1.0, &LIMITS).unwrap().aim_n(1.0);
        let mut misses = Vec::new();
        for row in 0..9 {
            for column in 0..25 {
                let place = Place::new(-6.0 + 0.5 * f64::from(column), -6.0 + 0.5 * f64::from(row));
                let (learned_contact, miss_n) = shoot(&map, place);
                misses.push(miss_n.abs());
                map.learn(&learned_contact);
            }
        }
        let last = &misses[100..];
        assert!(last.iter().all(|miss| *miss < 0.01), "{:?}", last.iter().copied().fold(0.0, f64::max));
        let shot = map.shot(Place::new(0.0, -3.0), 1.0, &LIMITS).unwrap();
        assert!(first_aim < 0.95 && shot.aim_n(1.0) > 0.97, "{first_aim} then {}", shot.aim_n(1.0));
        assert!((shot.faded - 0.006).abs() < 1e-9);
    }

    #[test]
    fn several_large_misses_distrust_the_map_and_one_does_not() {
        let mut map = learned_curve();
        let miss = |force_n| {
            let place = Place::default();
            LearnedContact::Shot { place, z_mm: 0.5, force_n, expected_n: 0.65, faded: 0.0 }
        };
        map.learn(&miss(1.5));
        map.learn(&miss(0.65));
        assert!(map.shot(Place::new(5.0, 5.0), 1.0, &LIMITS).is_some());
        (0..30).for_each(|i| map.learn(&miss(if i % 2 == 0 { 0.4 } else { 1.0 })));
        assert_eq!(map.shot(Place::new(5.0, 5.0), 1.0, &LIMITS), None);
    }

    #[test]
    fn rough_surface_gets_no_shot() {
        let mut map = ContactMap::new(0.3);
        for (i, (x, y)) in [(-6.0, -6.0), (6.0, -6.0), (-6.0, 6.0), (6.0, 6.0), (0.0, 0.0)].into_iter().enumerate() {
            let place = Place::new(x, y);
            let LearnedContact::Touch { z_mm, path, .. } = touch(place) else { unreachable!() };
            let relief_mm = if i == 4 { 0.15 } else { -0.05 };
            let path = path.into_iter().map(|(z, n)| (z + relief_mm, n)).collect();
            map.learn(&LearnedContact::Touch { place, z_mm: z_mm + relief_mm, path });
        }
        assert_eq!(map.shot(Place::default(), 1.0, &LIMITS), None);
    }

    #[test]
    fn map_is_bounded_and_keeps_its_corners() {
        let mut map = learned_curve();
        for i in 0..2 * SHOTS_MAX {
            let place = Place::new(-6.0 + 0.05 * (i % 240) as f64, -6.0 + 0.5 * (i / 240) as f64);
            let learned_contact = shoot(&map, place).0;
            map.learn(&learned_contact);
        }
        assert!(map.scales.len() <= SHOTS_MAX);
        let corner = Place::new(-6.0, -6.0);
        assert!(map.scales.iter().any(|(at, _)| at.distance_mm(corner) < 1.0));
        let again = map.scales.len();
        map.learn(&shoot(&map, corner).0);
        assert_eq!(map.scales.len(), again);
    }
}
