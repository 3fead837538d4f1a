//! Place where r turns: r decreases as the second contact moves away, then increases again.

use super::array::StudiedArray;
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::Place;
use serde::Serialize;
use std::f64::consts::TAU;

/// Least increase of r over a depth that counts as rising. It is far below any readable change, and above the rounding of a
/// table.
const RISING: f64 = 1e-6;
/// Value of r above which two contacts can't practically be distinguished.
pub const NEAR_R: f64 = 0.99;
/// Factor by which the step is smaller when a turning is examined more closely.
const FINER: f64 = 2.0;
/// Number of rays that are examined further: those that turn first.
const FOLLOWED: usize = 12;
/// Largest and least number of rounds. In each round the unknowns are varied along each coordinate, in both directions.
const ROUNDS: (usize, usize) = (500, 4);
/// Number of readings that are computed in a search. It limits the rounds for a large array.
const SEARCH_READINGS: f64 = 3e7;

/// Area of possible contacts, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ContactArea {
    /// First and last x.
    pub x_mm: (f64, f64),
    /// First and last y.
    pub y_mm: (f64, f64),
}

impl ContactArea {
    /// Returns the box around some places, with `margin_mm` on each side.
    pub fn around(places: &[Place], margin_mm: f64) -> ContactArea {
        let ends = |along: fn(&Place) -> f64| {
            let values = places.iter().map(along);
            values.fold((f64::MAX, f64::MIN), |(least, most), value| (least.min(value), most.max(value)))
        };
        let (x, y) = (ends(|place| place.x_mm), ends(|place| place.y_mm));
        ContactArea { x_mm: (x.0 - margin_mm, x.1 + margin_mm), y_mm: (y.0 - margin_mm, y.1 + margin_mm) }
    }

    /// Returns the place at these fractions of the sides along x and y.
    pub fn at(&self, across: f64, up: f64) -> Place {
        let between = |(from, to): (f64, f64), share: f64| from + share * (to - from);
        Place::new(between(self.x_mm, across), between(self.y_mm, up))
    }

    /// Distance from a place inside to the edge, mm; negative for a place outside.
    fn reach_mm(&self, from: Place, direction_rad: f64) -> f64 {
        let (sin, cos) = direction_rad.sin_cos();
        let along = |(first, last): (f64, f64), at: f64, speed: f64| {
            if !(first..=last).contains(&at) {
                -1.0
            } else if speed > 0.0 {
                (last - at) / speed
            } else if speed < 0.0 {
                (first - at) / speed
            } else {
                f64::INFINITY
            }
        };
        along(self.x_mm, from.x_mm, cos).min(along(self.y_mm, from.y_mm, sin))
    }
}

/// Start, direction and distance of a turning of r.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Turning {
    /// The first contact.
    #[serde(flatten)]
    pub from: Place,
    /// Direction of the second contact, from x toward y.
    pub direction_rad: f64,
    /// Distance of the second contact, mm.
    pub distance_mm: f64,
}

/// Behaviour of r on one path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathSearch {
    /// Distance at which r decreased to [`NEAR_R`], mm.
    pub near_mm: Option<f64>,
    /// Distance at which r turned, mm.
    pub turning_mm: Option<f64>,
}

impl StudiedArray {
    /// Step that misses no turn, mm: a small fraction of the distance over which the readings vary.
    fn step_mm(&self, pitch_mm: f64) -> f64 {
        pitch_mm.min(self.response().passage().depth_mm) / 20.0
    }

    /// Moves a second contact from a first contact over this distance in a direction.
    pub fn follow(&self, from: Place, direction_rad: f64, reach_mm: f64, step_mm: f64) -> PathSearch {
        let mut follow = PathSearch::default();
        let Some(aim) = self.aim(from) else { return follow };
        let (sin, cos) = direction_rad.sin_cos();
        let at = |mm: f64| aim.r_and_slope(Place::new(from.x_mm + mm * cos, from.y_mm + mm * sin), direction_rad);
        let rising = RISING / self.response().passage().depth_mm;
        let is_falling = |mm: f64| at(mm).is_none_or(|(_, slope)| slope <= rising);
        let is_near = |mm: f64| at(mm).is_none_or(|(r, _)| r >= NEAR_R);
        let steps = (reach_mm / step_mm).ceil().max(0.0) as usize;
        for step in 1..=steps {
            let (before_mm, mm) = ((step - 1) as f64 * step_mm, (step as f64 * step_mm).min(reach_mm));
            let Some((r, slope)) = at(mm) else { continue };
            if follow.near_mm.is_none() && r < NEAR_R {
                follow.near_mm = Some(last(before_mm, mm, is_near));
            }
            if follow.turning_mm.is_none() && slope > rising {
                follow.turning_mm = Some(last(before_mm, mm, is_falling));
            }
            if follow.near_mm.is_some() && follow.turning_mm.is_some() {
                break;
            }
        }
        follow
    }
}

/// Returns the last point between two at which a condition is true. The condition is true at the first point and false at the
/// second. The result is accurate to a millionth of the interval.
pub(super) fn last(mut holds: f64, mut fails: f64, is: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..20 {
        let middle = (holds + fails) / 2.0;
        *if is(middle) { &mut holds } else { &mut fails } = middle;
    }
    holds
}

/// Behaviour of r on many paths over an area.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// Number of paths. They start at places all over the area, each in its own direction, and go to the edge.
    pub rays: usize,
    /// Distances at which r turned, mm, sorted, for the paths on which it turned.
    pub turned_mm: Vec<f64>,
    /// Turning with the smallest distance, found by search over all places and directions.
    pub first: Option<Turning>,
    /// Points where r decreased to [`NEAR_R`], for the paths that reach this value, the nearest first.
    pub near: Vec<Turning>,
}

impl Survey {
    /// Follows `rays` paths over an area, and refines the search from the paths that turn first.
    pub fn new(array: &StudiedArray, area: &ContactArea, pitch_mm: f64, rays: usize) -> Survey {
        let step_mm = array.step_mm(pitch_mm);
        let starts: Vec<(Place, f64)> = (1..=rays).map(|ray| start(area, ray)).collect();
        let paths = in_parallel(&starts, |&(from, direction_rad)| {
            array.follow(from, direction_rad, area.reach_mm(from, direction_rad), step_mm)
        });
        let ordered = |distance_mm: fn(&PathSearch) -> Option<f64>| {
            let found = starts.iter().zip(&paths).filter_map(|(&(from, direction_rad), follow)| {
                Some(Turning { from, direction_rad, distance_mm: distance_mm(follow)? })
            });
            let mut found: Vec<Turning> = found.collect();
            found.sort_by(|a, b| a.distance_mm.total_cmp(&b.distance_mm));
            found
        };
        let turned = ordered(|follow| follow.turning_mm);
        let followed =
            in_parallel(&turned[..turned.len().min(FOLLOWED)], |turning| follow(array, area, turning, step_mm / FINER));
        Survey {
            rays,
            turned_mm: turned.iter().map(|turning| turning.distance_mm).collect(),
            first: followed.into_iter().min_by(|a, b| a.distance_mm.total_cmp(&b.distance_mm)),
            near: ordered(|follow| follow.near_mm),
        }
    }

    /// Returns the fraction of the paths on which r turned.
    pub fn share_turned(&self) -> f64 {
        self.turned_mm.len() as f64 / self.rays as f64
    }

    /// Returns the median of the distances where r decreased to [`NEAR_R`], and the largest one.
    pub fn near_median_and_worst(&self) -> Option<(f64, Turning)> {
        Some((self.near.get(self.near.len() / 2)?.distance_mm, *self.near.last()?))
    }
}

fn start(area: &ContactArea, ray: usize) -> (Place, f64) {
    let [across, up, around] = spread(ray);
    (area.at(across, up), TAU * around)
}

/// Returns points that fill a cube evenly for any number of points. They are multiples of powers of the inverse of the root of
/// x^4 = x + 1 (the additive recurrence of M. Roberts).
pub(super) fn spread(point: usize) -> [f64; 3] {
    [0.819_172_513_396_164_4, 0.671_043_606_703_789_3, 0.549_700_477_901_970_1].map(|by| (by * point as f64).fract())
}

/// Returns the first turning near the given one, in place and direction.
fn follow(array: &StudiedArray, area: &ContactArea, turning: &Turning, step_mm: f64) -> Turning {
    let distance_mm = |[x_mm, y_mm, direction_rad]: &[f64; 3]| {
        let from = Place::new(*x_mm, *y_mm);
        // a path that turns later than the followed one isn't needed
        let reach_mm = area.reach_mm(from, *direction_rad).min(turning.distance_mm + step_mm);
        array.follow(from, *direction_rad, reach_mm, step_mm).turning_mm.unwrap_or(f64::INFINITY)
    };
    let from = [turning.from.x_mm, turning.from.y_mm, turning.direction_rad];
    let steps = [8.0 * step_mm, 8.0 * step_mm, 8.0 * step_mm / turning.distance_mm.max(step_mm)];
    let readings_a_path = array.places().len() as f64 * (turning.distance_mm / step_mm).max(1.0);
    let affordable = SEARCH_READINGS / (readings_a_path * (2 * from.len() * FOLLOWED) as f64);
    let rounds = (affordable as usize).clamp(ROUNDS.1, ROUNDS.0);
    let ([x_mm, y_mm, direction_rad], distance_mm) = descend(from, steps, rounds, distance_mm);
    Turning { from: Place::new(x_mm, y_mm), direction_rad, distance_mm }
}

/// Finds a minimum along one coordinate after the other, in decreasing steps. The function may be discontinuous.
pub(super) fn descend<const N: usize>(
    mut at: [f64; N],
    mut steps: [f64; N],
    rounds: usize,
    height: impl Fn(&[f64; N]) -> f64,
) -> ([f64; N], f64) {
    let (mut least, enough) = (height(&at), steps[0] * 1e-5);
    for _ in 0..rounds {
        let before = least;
        for axis in 0..N {
            for step in [steps[axis], -steps[axis]] {
                let mut tried = at;
                tried[axis] += step;
                let height = height(&tried);
                if height < least {
                    (at, least) = (tried, height);
                }
            }
        }
        if least == before {
            steps = steps.map(|step| step / 2.0);
        }
        if steps[0] < enough {
            break;
        }
    }
    (at, least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn distance_to_the_edge_is_exact() {
        let area = ContactArea { x_mm: (-6.0, 6.0), y_mm: (-3.0, 1.0) };
        for (direction_rad, reach_mm) in [(0.0, 5.0), (PI, 7.0), (FRAC_PI_2, 1.0), (-FRAC_PI_2, 3.0)] {
            assert!((area.reach_mm(Place::new(1.0, 0.0), direction_rad) - reach_mm).abs() < 1e-9);
        }
        assert!((area.reach_mm(Place::default(), 5f64.atan2(5.0)) - 2f64.sqrt()).abs() < 1e-9);
        assert!(area.reach_mm(Place::new(1.0, 1.1), 4.0) < 0.0);
        assert_eq!(ContactArea::around(&[Place::new(-4.5, -1.5), Place::new(4.5, -0.5)], 1.5), area);
    }

    #[test]
    fn descending_finds_the_lowest_point_of_a_bowl() {
        let bowl = |[x, y]: &[f64; 2]| (x - 1.0).powi(2) + 3.0 * (y + 2.0).powi(2) + x * y;
        let ([x, y], _) = descend([5.0, 5.0], [1.0, 1.0], 500, bowl);
        assert!((x - 24.0 / 11.0).abs() < 1e-4 && (y + 26.0 / 11.0).abs() < 1e-4, "{x} {y}");
    }

    #[test]
    fn path_is_followed_to_the_turn_of_r() {
        let line = StudiedArray::line(3, 1.0);
        let whole = line.follow(Place::default(), 0.0, 2.0, 0.02);
        assert!((whole.turning_mm.unwrap() - 1.5405).abs() < 1e-4, "{whole:?}");
        assert_eq!(line.follow(Place::default(), 0.0, 1.54, 0.02).turning_mm, None);
        let near = StudiedArray::line(9, 1.0).follow(Place::default(), 0.0, 2.0, 0.02);
        assert!(near.turning_mm.is_none() && (near.near_mm.unwrap() - 0.200).abs() < 1e-3, "{near:?}");
    }
}
