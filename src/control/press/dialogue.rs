//! The events of a press and its commands.

use super::soft::Softest;
use crate::control::map::Shot;
use crate::control::permit::{Permit, Permitted};
use crate::control::speed::Timing;
use crate::control::surface::Expected;
use crate::control::trip::{Rule, Trip};
use crate::control::zero::Zero;
use crate::quantity::{Limits, Place};
use serde::{Deserialize, Serialize};

/// What a press rests on, besides its task.
#[derive(Clone, Copy, Debug)]
pub struct Context {
    /// The place, specimen frame.
    pub place: Place,
    /// The rig's limits.
    pub limits: Limits,
    /// Who may move where.
    pub permit: Permit,
    /// The zero of the air before this press': what its own may not be far from.
    pub zero: Zero,
    /// How long ago that was, s.
    pub zero_age_s: f64,
    /// Where the surface is expected.
    pub expected: Expected,
    /// What the map says of this place and this force; none where it can't be trusted, or isn't asked.
    pub shot: Option<Shot>,
    /// How soft the press may be.
    pub softest: Softest,
    /// Where to withdraw to, mm: clear of the surface here and on the way on.
    pub clear_mm: f64,
    /// Fastest approach until the specimen was touched for the first time, mm/s.
    pub approach_mm_s: f64,
    /// Speed of steps in contact and of motions in air, mm/s.
    pub speed_mm_s: f64,
    /// How fast the rig is.
    pub timing: Timing,
}

/// What the loop is to do next. Only the moves move, and only toward a permitted end.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Average this many readings; answered by [`Event::Averaged`].
    Average(u32),
    /// Move along z, every reading passed to [`ForceLoop::see`](super::ForceLoop::see); answered by [`Event::Moved`].
    Move(Permitted),
    /// Keep still and read the force; answered by [`Event::Dwelt`].
    Dwell(f64),
    /// Sample force and outputs for so long; answered by [`Event::Sampled`].
    Sample(f64),
    /// Withdraw for good; what comes next may begin once the specimen is clear. Answered by [`Event::Moved`].
    Depart(Permitted),
    /// The contact is over.
    Done,
    /// A rule is broken: stop, withdraw, record.
    Trip(Trip),
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The indenter is in the clear above its place.
    Begin {
        /// Its z, read back, mm.
        z_mm: f64,
        /// What the load cell read in the clear: forces count from there.
        air: AirReadings,
    },
    /// Readings were averaged.
    Averaged {
        /// Mean force from the zero, N.
        force_n: f64,
    },
    /// A motion ended, on its target or by a stop.
    Moved {
        /// Where, mm.
        z_mm: f64,
    },
    /// The dwell is over.
    Dwelt,
    /// The window is over.
    Sampled {
        /// Mean force in it, N.
        force_n: f64,
    },
}

impl Event {
    /// # Errors
    /// A trip for what isn't a number.
    pub(super) fn check_finite(&self) -> Result<(), Trip> {
        let (number, unit) = match *self {
            Event::Begin { z_mm, air } => (z_mm + air.mean_n + air.sigma_n, "mm"),
            Event::Moved { z_mm } => (z_mm, "mm"),
            Event::Averaged { force_n } | Event::Sampled { force_n } => (force_n, "N"),
            Event::Dwelt => return Ok(()),
        };
        if number.is_finite() { Ok(()) } else { Err(Trip::new(Rule::NotFinite, number, 0.0, unit)) }
    }
}

/// Readings in air.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AirReadings {
    /// Their mean, N as the cell reads it.
    pub mean_n: f64,
    /// Their standard deviation, N.
    pub sigma_n: f64,
    /// How many.
    pub readings: u32,
    /// How long before they were done their middle was, s.
    pub age_s: f64,
}

/// When an event is passed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// The time, s, from any origin that stays.
    pub now_s: f64,
    /// How old the last good reading is, s.
    pub age_s: f64,
}

/// What is to become of the motion under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Steer {
    /// It continues as it is.
    On,
    /// It continues at this speed, mm/s.
    Speed(f64),
    /// It is stopped.
    Stop,
}
