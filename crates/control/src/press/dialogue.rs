//! Events and commands of a press.

use super::soft::Softest;
use crate::drag::PermittedDrag;
use crate::drift::Drift;
use crate::map::Shot;
use crate::permit::{Permit, Permitted};
use crate::speed::Timing;
use crate::surface::Expected;
use crate::trip::{SafetyRule, Trip};
use crate::zero::Zero;
use palpate_core::quantity::{Limits, Place};
use serde::{Deserialize, Serialize};

/// Information that a press needs, besides its task.
#[derive(Clone, Copy, Debug)]
pub struct Context {
    /// Place of the press, specimen frame.
    pub place: Place,
    /// The rig's limits.
    pub limits: Limits,
    /// Permit of the rig: decides which motions are allowed.
    pub permit: Permit,
    /// Zero without load before this press. The press' own zero may not be far from it.
    pub zero: Zero,
    /// Age of that zero, s.
    pub zero_age_s: f64,
    /// Expected position of the surface.
    pub expected: Expected,
    /// Prediction of the map for this place and this force; `None` if the map can't be trusted there or isn't used.
    pub shot: Option<Shot>,
    /// Lowest allowed stiffness of the press.
    pub softest: Softest,
    /// Position to retract to, mm: clear of the surface here and on the way to the next place.
    pub clear_mm: f64,
    /// Fastest approach until the first touch of the specimen, mm/s.
    pub approach_mm_s: f64,
    /// Speed of steps in contact and of motions without load, mm/s.
    pub speed_mm_s: f64,
    /// Timing of the rig.
    pub timing: Timing,
}

/// Next action of the loop. Only the motion commands move the stage, and only toward a permitted end.
#[derive(Clone, Debug, PartialEq)]
pub enum LoopCommand {
    /// Average this number of readings; answered by [`LoopEvent::Averaged`].
    Average(u32),
    /// Average this number of readings on all axes; answered by [`LoopEvent::AxesAveraged`].
    AverageAxes(u32),
    /// Move x and y in contact; answered by [`LoopEvent::Dragged`].
    Drag(PermittedDrag),
    /// Move along z and pass every reading to [`ForceLoop::see`](super::ForceLoop::see); answered by [`LoopEvent::Moved`].
    Move(Permitted),
    /// Stay still for this time, s, and read the force; answered by [`LoopEvent::Dwelt`].
    Dwell(f64),
    /// Sample force and outputs for this time, s; answered by [`LoopEvent::Sampled`].
    Sample(f64),
    /// Move along z like [`Move`](Self::Move), and read all devices meanwhile; answered by [`LoopEvent::Moved`].
    Ramp(Permitted),
    /// Stay still for this time, s, and read all devices; answered by [`LoopEvent::Followed`].
    Follow(f64),
    /// Retract for good. The next action may begin once the specimen is clear. Answered by [`LoopEvent::Moved`].
    LeaveContact(Permitted),
    /// The contact is over.
    Done,
    /// The press is so much softer than those so far that the load cell must first show that it measures the force. Otherwise this rule
    /// is broken.
    Doubt(Trip),
    /// A rule is broken: stop, retract, record.
    Trip(Trip),
}

/// Event that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoopEvent {
    /// The indenter is in the clear above its place.
    Begin {
        /// Position z of the indenter, read back, mm.
        z_mm: f64,
        /// Load cell readings in the clear; forces are relative to them.
        no_load: NoLoadReadings,
    },
    /// Readings were averaged.
    Averaged {
        /// Mean force relative to the zero, N.
        force_n: f64,
    },
    /// Readings were averaged on all axes.
    AxesAveraged {
        /// Mean force relative to the zero, N.
        force_n: f64,
        /// Mean forces along x and y relative to their zeros, N; `None` if the cell has one axis.
        side_n: Option<[f64; 2]>,
    },
    /// A drag ended, at its target or by a stop.
    Dragged {
        /// Way that the tip went along x, mm.
        x_mm: f64,
        /// Way along y, mm.
        y_mm: f64,
    },
    /// A motion ended, at its target or by a stop.
    Moved {
        /// Position where the motion ended, mm.
        z_mm: f64,
    },
    /// The dwell is over.
    Dwelt,
    /// The time is over for which a level was followed.
    Followed {
        /// Mean of the last forces, N.
        force_n: f64,
    },
    /// The window is over.
    Sampled {
        /// Mean force in the window, N.
        force_n: f64,
    },
}

impl LoopEvent {
    /// The pressing force of a mean, N.
    pub(super) fn force_n(&self) -> Option<f64> {
        match *self {
            LoopEvent::Averaged { force_n }
            | LoopEvent::Sampled { force_n }
            | LoopEvent::Followed { force_n }
            | LoopEvent::AxesAveraged { force_n, .. } => Some(force_n),
            _ => None,
        }
    }

    /// # Errors
    /// Returns a trip if a value isn't a finite number.
    pub(super) fn check_finite(&self) -> Result<(), Trip> {
        let (number, unit) = match *self {
            LoopEvent::Begin { z_mm, no_load } => (z_mm + no_load.mean_n + no_load.sigma_n, "mm"),
            LoopEvent::Moved { z_mm } => (z_mm, "mm"),
            LoopEvent::AxesAveraged { force_n, side_n } => (force_n + side_n.map_or(0.0, |[x_n, y_n]| x_n + y_n), "N"),
            LoopEvent::Dragged { x_mm, y_mm } => (x_mm + y_mm, "mm"),
            _ => match self.force_n() {
                Some(force_n) => (force_n, "N"),
                None => return Ok(()),
            },
        };
        if number.is_finite() { Ok(()) } else { Err(Trip::new(SafetyRule::NotFinite, number, 0.0, unit)) }
    }
}

/// Readings without load. Two of them are equal if a journal keeps the same of them.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct NoLoadReadings {
    /// Mean of the readings, N, as the cell reads it.
    pub mean_n: f64,
    /// Standard deviation of the readings, N.
    pub sigma_n: f64,
    /// Number of readings.
    pub readings: u32,
    /// Time from the middle of the readings to their end, s.
    pub age_s: f64,
    /// Middle of the readings by their own clock, s; 0 where they come from a journal.
    #[serde(skip)]
    pub at_s: f64,
    /// Drift by which the forces of the press were corrected; `None`: no drift was shown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drift: Option<Drift>,
    /// Mean of the readings along x and y, N, as the cell reads them; `None` for a cell with one axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side_mean_n: Option<[f64; 2]>,
}

impl PartialEq for NoLoadReadings {
    fn eq(&self, other: &NoLoadReadings) -> bool {
        let kept = |NoLoadReadings { mean_n, sigma_n, readings, age_s, drift, side_mean_n, .. }: &NoLoadReadings| {
            (*mean_n, *sigma_n, *readings, *age_s, *drift, *side_mean_n)
        };
        kept(self) == kept(other)
    }
}

/// Time at which an event is passed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time, s, from any fixed origin.
    pub now_s: f64,
    /// Age of the last good reading, s.
    pub age_s: f64,
}

/// Decision about the motion under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Steer {
    /// The motion continues unchanged.
    On,
    /// The motion continues at this speed, mm/s.
    Speed(f64),
    /// The motion is stopped.
    Stop,
}
