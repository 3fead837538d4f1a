//! The roles of a rig as traits: a stage that moves, and a load cell and an array that are read.
//!
//! A driver plays a role over a link. The common part of all drivers of a role in a press (moving while watching the force,
//! checking the read-back) is written once over these traits, in `palpate_run::run`. A driver adds only the few hooks that this
//! part needs.

mod error;
mod orders;

pub use error::{DeviceError, DeviceProblem};
pub use orders::{MotionOrder, MotionOrders};
pub use palpate_core::quantity::{Identity, SHOWN_MAX_CHARS, shown};

use palpate_core::quantity::{Axis, ForceReading, Range, StageAbilities, StageBounds, Steps, Travel, round};
use std::future::Future;
use std::time::Duration;

/// Use of the stage, as set by the rig.
#[derive(Clone, Debug, PartialEq)]
pub struct StageUse {
    /// Travel limits of each axis, mm; z already ends at the specimen's depth limit.
    pub travel: Travel,
    /// Direction along z that leads away from the specimen: +1 or -1.
    pub away: f64,
    /// Highest speed allowed on any axis, mm/s.
    pub speed_mm_s: f64,
    /// Acceleration and deceleration to be used, mm/s^2.
    pub acceleration_mm_s2: f64,
    /// Speed of a search for home, mm/s. At this speed the stage can be stopped within the force limit.
    pub home_speed_mm_s: f64,
    /// Count of z at the limit where it homes, mm; only for controllers that let the program choose it.
    pub home_z_mm: f64,
    /// Whether a person brings the axes to their zero, because there are no switches.
    pub by_hand: bool,
    /// Whether the rig states that axes whose motors are on are homed; only for controllers that don't report it.
    pub homed: bool,
    /// Whether z stays where it is without power.
    pub z_holds_unpowered: bool,
    /// Steps of the axes.
    pub steps: Steps,
    /// How z may search for home.
    pub home_search: HomeSearch,
    /// What it can do in a motion.
    pub abilities: StageAbilities,
}

/// How z may search for home.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HomeSearch {
    /// Away from the specimen.
    #[default]
    Away,
    /// Toward the specimen: a person confirmed that nothing is in the way.
    Toward,
    /// Not at all: home must be known.
    Never,
}

/// Largest distance beyond its travel at which an axis may be read back, mm. It covers the position before the preparation, and
/// rounding.
const BEYOND_MM: f64 = 0.1;

impl StageUse {
    /// Returns the possible range of an axis. A read-back outside this range is damaged.
    pub fn reach(&self, axis: Axis) -> Range {
        self.travel.along(axis).widened(BEYOND_MM)
    }

    /// What decides where a motion ends.
    pub fn bounds(&self) -> StageBounds {
        StageBounds {
            steps: self.steps,
            finishes: self.abilities.finishes(),
            acceleration_mm_s2: self.acceleration_mm_s2,
        }
    }

    /// Checks that all ways end within the travel, or nearer to it: a stage may find its home beyond it. The way out of a contact is always
    /// open.
    ///
    /// # Errors
    /// The end that isn't.
    pub fn check(&self, ways: &[AxisWay]) -> Result<(), DeviceProblem> {
        if self.is_leaving(ways) {
            return Ok(());
        }
        let is_allowed = |way: &AxisWay| {
            let Range { min, max } = self.travel.along(way.axis);
            let beyond_mm = |mm: f64| (min - mm).max(mm - max).max(0.0);
            // written as the positive condition, so NaN fails
            way.to_mm().is_finite() && beyond_mm(way.to_mm()) <= beyond_mm(way.from_mm) + WAY_MM
        };
        match ways.iter().find(|way| !is_allowed(way)) {
            None => Ok(()),
            Some(way) => {
                let (name, to_mm) = (way.axis.name(), way.to_mm());
                Err(DeviceProblem::Motion(format!("{name} at {to_mm} mm is outside the rig's travel")))
            }
        }
    }

    /// Checks that the axes rest where the ways begin, within a distance beyond that of two read-backs, mm. The way out of a contact is open from
    /// anywhere.
    ///
    /// # Errors
    /// The axis that doesn't: somebody else moved it, or its controller lost the place.
    pub fn check_rest(&self, ways: &[AxisWay], at_mm: [f64; 3], more_mm: f64) -> Result<(), DeviceProblem> {
        // written as the positive condition, so NaN fails
        let rests =
            |way: &AxisWay| (at_mm[way.axis.index()] - way.from_mm).abs() <= self.steps.at_rest_mm(way.axis) + more_mm;
        match ways.iter().find(|way| !rests(way)).filter(|_| !self.is_leaving(ways)) {
            None => Ok(()),
            Some(AxisWay { axis, from_mm, .. }) => {
                let (name, is_mm) = (axis.name(), at_mm[axis.index()]);
                Err(DeviceProblem::Motion(format!(
                    "{name} came to rest at {from_mm:.4} mm and is at {is_mm:.4} mm: something else moved it, or it lost its place"
                )))
            }
        }
    }

    /// Returns how far an axis goes from where its controller has it, mm. A way to an end of the travel ends as much before it as the
    /// controller's count is uncertain: the end is its own limit, and it refuses a motion that a rounding leads beyond. An axis that is
    /// there stays.
    pub fn from_count(&self, way: &AxisWay, count_mm: f64, rounding_mm: f64) -> f64 {
        let (to_mm, Range { min, max }) = (way.to_mm(), self.travel.along(way.axis));
        let end_mm = if (to_mm - min).abs() < rounding_mm {
            min + rounding_mm
        } else if (max - to_mm).abs() < rounding_mm {
            max - rounding_mm
        } else {
            return round(to_mm - count_mm, WAY_DECIMALS);
        };
        let is_there = (to_mm - count_mm).abs() < rounding_mm;
        if is_there { 0.0 } else { round(end_mm - count_mm, WAY_DECIMALS) }
    }

    /// Whether a motion only leads away from the specimen.
    pub fn is_leaving(&self, ways: &[AxisWay]) -> bool {
        ways.iter().all(|way| way.by_mm == 0.0 || (way.axis == Axis::Z && way.by_mm * self.away > 0.0))
    }
}

/// Displacement of an axis in a motion.
///
/// A controller gets the displacement and never a place, because a controller that restarted, or that somebody else gave another zero,
/// would go somewhere else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisWay {
    /// The axis.
    pub axis: Axis,
    /// Where it rests, by the read-backs until now, mm.
    pub from_mm: f64,
    /// How far it goes, mm.
    pub by_mm: f64,
}

/// Decimals of places and displacements. Displacements between rounded places add up without an error.
const WAY_DECIMALS: i32 = 5;
/// Rounding of the end of a way between places that have more decimals, mm.
pub const WAY_MM: f64 = 1e-5;
/// Decimals of the end of a way: the sum of two numbers has an error of its own.
const TO_DECIMALS: i32 = 9;

impl AxisWay {
    /// Returns the way from one place to another, mm.
    pub fn between(axis: Axis, from_mm: f64, to_mm: f64) -> Self {
        let by_mm = round(round(to_mm, WAY_DECIMALS) - round(from_mm, WAY_DECIMALS), WAY_DECIMALS);
        AxisWay { axis, from_mm, by_mm }
    }

    /// Where it ends, mm.
    pub fn to_mm(&self) -> f64 {
        round(self.from_mm + self.by_mm, TO_DECIMALS)
    }
}

/// Where axes rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestPlace {
    /// Positions of x, y and z, mm.
    pub at_mm: [f64; 3],
    /// How far they may be off beyond what two read-backs at rest differ by, mm.
    pub uncertainty_mm: f64,
}

/// What a stage does when a motion begins, in messages.
pub const STARTING: &str = "starting a motion";

/// A three-axis stage. Positions are stage coordinates, mm.
///
/// A motion is started and then followed. A controller finishes a started motion even if the program ends, so only a motion that
/// is safe to finish is started.
pub trait Stage {
    /// Connects, brings all axes to rest, and checks units and limits. Causes no other motion.
    fn identify(&mut self, usage: &StageUse) -> impl Future<Output = Result<Identity, DeviceError>>;

    /// Moves z by a distance away from the specimen, homed or not, from rest to rest, so that a person sees the direction.
    /// Returns whether z moved: a controller may refuse motions of an axis that isn't homed.
    fn nudge_away(
        &mut self,
        way_mm: f64,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> impl Future<Output = Result<bool, DeviceError>> {
        let _ = (way_mm, usage, orders);
        async { Ok(false) }
    }

    /// Whether home is known, so that nothing moves to find it. `false` if the stage doesn't report it. The stage was
    /// [identified](Stage::identify) before.
    fn is_homed(&mut self) -> impl Future<Output = Result<bool, DeviceError>> {
        async { Ok(false) }
    }

    /// Homes z alone, if it isn't homed, away from the specimen. Returns whether z was homed separately: a controller may home
    /// all axes in one operation.
    fn home_z(&mut self, usage: &StageUse, orders: &MotionOrders) -> impl Future<Output = Result<bool, DeviceError>> {
        let _ = (usage, orders);
        async { Ok(false) }
    }

    /// Homes the axes that aren't homed: z first, away from the specimen. A stop ends a search for home at once, which is an
    /// error. The stage was [identified](Stage::identify) before.
    fn home(&mut self, usage: &StageUse, orders: &MotionOrders) -> impl Future<Output = Result<(), DeviceError>>;

    /// Standard deviation of a position as it is read back at rest, mm, measured while the stage was prepared.
    fn position_noise_mm(&self) -> f64 {
        0.0
    }

    /// Resets learned timing at the start of a press.
    fn forget_timing(&mut self) {}

    /// Returns how the stage is used; `None` before it is prepared.
    fn usage(&self) -> Option<&StageUse>;

    /// Returns an error of this stage.
    fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError;

    /// Reads what has come in while the stage rested, and returns where the axes rest, if that costs no exchange of its own or is due before a
    /// motion toward the specimen. For a way out of a contact, a lost place is no error.
    fn rest(
        &mut self,
        is_leaving: bool,
        orders: &MotionOrders,
    ) -> impl Future<Output = Result<Option<RestPlace>, DeviceError>>;

    /// Sends a checked motion, as [`begin`](Stage::begin) says.
    fn send(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> impl Future<Output = Result<(), DeviceError>>;

    /// Starts axes on their ways, each at most at `speed_mm_s`. When this function returns, the controller has accepted the
    /// command and finishes it independently: the motion began just now. A stop that is ordered during the call is sent at
    /// once. If the stop was requested before the call, the axes don't move.
    ///
    /// A motion is sent once, as displacements. A way out of a contact is accepted even if the place is lost.
    ///
    /// # Errors
    /// The stage isn't prepared, the motion ends outside its travel, the stage lost its place or isn't where it came to rest, or it refuses.
    fn begin(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        orders: &MotionOrders,
    ) -> impl Future<Output = Result<(), DeviceError>> {
        async move {
            let Some(usage) = self.usage().cloned() else {
                return Err(self.error(STARTING, DeviceProblem::Motion("it isn't prepared".to_owned())));
            };
            // a controller's own limits end where its frame does, not where the specimen does
            usage.check(ways).map_err(|problem| self.error(STARTING, problem))?;
            if let Some(RestPlace { at_mm, uncertainty_mm }) = self.rest(usage.is_leaving(ways), orders).await? {
                let rests = usage.check_rest(ways, at_mm, uncertainty_mm);
                rests.map_err(|problem| self.error(STARTING, problem))?;
            }
            if orders.stopped() {
                return Ok(());
            }
            self.send(ways, speed_mm_s, &usage, orders).await
        }
    }

    /// Waits until the controller reports the axes at rest, and returns their positions, in their order, mm. `expected` is the
    /// expected duration of the motion. Orders are carried out at once, even while an answer is awaited.
    fn follow(
        &mut self,
        axes: &[Axis],
        expected: Duration,
        orders: &MotionOrders,
    ) -> impl Future<Output = Result<Vec<f64>, DeviceError>>;

    /// Returns the position of an axis. Orders during the call are carried out at once.
    fn position_mm(&mut self, axis: Axis, orders: &MotionOrders) -> impl Future<Output = Result<f64, DeviceError>>;

    /// Stops all axes at once, without waiting.
    fn stop(&mut self) -> impl Future<Output = Result<(), DeviceError>>;

    /// The last resort: ends a motion that no stop has ended, by the strongest means that keep z powered, or by stronger ones if z
    /// [holds without power](StageUse::z_holds_unpowered). The place may be lost. Any other call may have been given up before.
    fn abort(&mut self) -> impl Future<Output = Result<(), DeviceError>> {
        self.stop()
    }

    /// Returns the controller's error messages, oldest first, and empties its list.
    fn complaints(&mut self) -> impl Future<Output = Result<Vec<String>, DeviceError>>;

    /// Makes the controller itself end a motion when the load cell reads `limit_n`, N, including the cell's own zero. `None` ends
    /// this guard. If the controller can't do this, or the rig doesn't request it, nothing happens.
    fn guard(&mut self, limit_n: Option<f64>) -> impl Future<Output = Result<(), DeviceError>> {
        let _ = limit_n;
        async { Ok(()) }
    }
}

/// A load cell.
pub trait LoadCell {
    /// Connects and checks that the answers mean what the rig says.
    fn prepare(&mut self) -> impl Future<Output = Result<Identity, DeviceError>>;

    /// Resets learned timing at the start of a press.
    fn forget_timing(&mut self) {}

    /// Returns the latest reading, relative to the cell's own zero.
    fn read(&mut self) -> impl Future<Output = Result<ForceReading, DeviceError>>;

    /// Time from one conversion to the next. Faster reading returns the same value again.
    fn conversion(&self) -> Duration;
}

/// The sensor's outputs.
pub trait SensorArray {
    /// Connects and checks that the answers mean what the rig says.
    fn prepare(&mut self) -> impl Future<Output = Result<Identity, DeviceError>>;

    /// Reads every output once into `outputs`, in the sensor's own unit (volts unless the rig states another).
    fn read(&mut self, outputs: &mut [f64]) -> impl Future<Output = Result<(), DeviceError>>;

    /// Number of outputs: one for each channel of each unit.
    fn units(&self) -> usize;
}

/// The three instruments of a rig.
pub struct Instruments<S, C, A> {
    /// The stage.
    pub stage: S,
    /// The load cell.
    pub load_cell: C,
    /// The array.
    pub array: A,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usage() -> StageUse {
        StageUse {
            travel: Travel { axes: [Range { min: -12.5, max: 12.5 }; 3] },
            away: 1.0,
            speed_mm_s: 10.0,
            acceleration_mm_s2: 100.0,
            home_speed_mm_s: 1.0,
            home_z_mm: 12.5,
            by_hand: false,
            homed: false,
            z_holds_unpowered: false,
            steps: Steps { mm: [0.01, 0.01, 0.0025], ..Steps::FINE },
            home_search: HomeSearch::Away,
            abilities: StageAbilities::FINISHES,
        }
    }

    #[test]
    fn bounds_have_the_steps_and_whether_each_motion_is_finished() {
        let bounds = StageBounds { steps: usage().steps, finishes: true, acceleration_mm_s2: 100.0 };
        assert_eq!(usage().bounds(), bounds);
        assert!(!StageUse { abilities: StageAbilities::FULL, ..usage() }.bounds().finishes);
    }

    #[test]
    fn a_motion_ends_within_the_travel_or_nearer_to_it() {
        let is_allowed =
            |axis, from_mm: f64, to_mm: f64| usage().check(&[AxisWay::between(axis, from_mm, to_mm)]).is_ok();
        assert!(is_allowed(Axis::X, 0.0, 12.5) && !is_allowed(Axis::X, 0.0, 12.6) && !is_allowed(Axis::X, 0.0, -12.6));
        assert!(is_allowed(Axis::Z, 14.0, 13.9), "from a home beyond the travel");
        assert!(
            !is_allowed(Axis::X, 14.0, 14.1) && !is_allowed(Axis::Z, -14.0, -14.1) && !is_allowed(Axis::X, 14.0, -14.1)
        );
        assert!(is_allowed(Axis::Z, -14.0, -13.0) && is_allowed(Axis::Z, 12.0, 14.0), "the way out is open");
        assert!(!is_allowed(Axis::X, 0.0, f64::NAN));
    }

    #[test]
    fn motion_to_an_end_of_travel_ends_before_it_by_the_rounding() {
        let by_mm = |from_mm: f64, to_mm: f64, count_mm: f64| {
            usage().from_count(&AxisWay::between(Axis::Z, from_mm, to_mm), count_mm, 2e-4)
        };
        assert_eq!(by_mm(12.4, 12.5, 12.40003), 0.09977);
        assert_eq!(by_mm(-12.4, -12.5, -12.40003), -0.09977);
        assert_eq!(by_mm(12.5, 12.5, 12.50003), 0.0);
        assert_eq!(by_mm(12.4, 12.0, 12.40003), -0.40003, "from the controller's count");
        assert_eq!(by_mm(12.4, 13.5, 12.4), 1.1, "a motion far beyond is refused by who commands it");
    }
}
