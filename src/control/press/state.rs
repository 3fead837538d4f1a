//! State of a press: data that all of its parts read and change.

use super::dialogue::{Context, Moment};
use crate::control::profile::MotionProfile;
use crate::control::task::Task;
use crate::control::trip::Trip;

/// How far beyond the latest contact the search continues before there is none, mm: a soft surface yields before it is felt.
pub(super) const SEARCH_MM: f64 = 0.20;

/// How many sd of a mean a rule on its fall or its answer leaves.
pub(super) const TELL_SIGMAS: f64 = 6.0;

/// Smallest step worth commanding, mm.
pub(super) const STEP_LEAST_MM: f64 = 0.000_1;

/// Most steps to one level: where much more stiffness is declared than there is, each may go a few micrometres only.
pub(super) const STEPS_MAX: u32 = 1000;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum State {
    Idle,
    Descending,
    Approaching,
    Touching,
    Pushing,
    Shooting,
    Landing,
    Stepping,
    Trimming,
    Reading,
    Dwelling,
    Lingering,
    Waiting,
    Sampling,
    Withdrawing,
    Leaving,
    Departing,
    Over,
}

/// One contact: find the surface from above, reach each level from its own side, hold it, sample it, withdraw.
pub struct ForceLoop {
    pub(super) task: Task,
    pub(super) context: Context,
    pub(super) state: State,
    pub(super) level: usize,
    pub(super) z_mm: f64,
    pub(super) force_n: f64,
    pub(super) sigma_n: f64,
    pub(super) moment: Moment,
    /// The earliest surface, expected or, once touched, touched.
    pub(super) first_mm: f64,
    pub(super) in_contact: bool,
    pub(super) dwelt: bool,
    pub(super) steps: u32,
    pub(super) motion: Option<Motion>,
    /// A rule that a reading broke while a motion was under way.
    pub(super) broken: Option<Trip>,
    /// When contact was first felt, s.
    pub(super) contact_s: Option<f64>,
    /// Where stiffness is measured from: z and force.
    pub(super) anchor: (f64, f64),
    /// Up to where the force has answered: z and force.
    pub(super) answered: (f64, f64),
    /// Where the last motion ended before this one, mm.
    pub(super) before_mm: f64,
    pub(super) stiffness_n_mm: Option<f64>,
    /// The loading path: z and force at rest, from the touch to the first level.
    pub(super) path: Vec<(f64, f64)>,
    pub(super) push: Push,
    pub(super) landing: Option<Landing>,
}

/// The motion under way: where it began, when at the earliest, and how it goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    pub(super) from_mm: f64,
    pub(super) from_n: f64,
    pub(super) began_s: f64,
    pub(super) profile: MotionProfile,
}

/// The state of a motion that is steered.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Push {
    pub(super) goal_n: f64,
    pub(super) speed_mm_s: f64,
    pub(super) ordered_s: f64,
    pub(super) sum_n: f64,
    pub(super) count: f64,
}

/// A first motion as it ended, and what came of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Landing {
    pub(super) z_mm: f64,
    pub(super) force_n: f64,
    pub(super) expected_n: f64,
    /// The force that the last correction should have left, N.
    pub(super) left_n: f64,
    /// What of it was gone in the window, as a share of the set force.
    pub(super) faded: Option<f64>,
}
