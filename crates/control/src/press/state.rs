//! State of a press: data that all of its parts read and change.

use super::dialogue::{Context, Moment};
use super::dragged::DragProgress;
use super::ramp::RampProgress;
use crate::profile::MotionProfile;
use crate::task::PressTask;
use crate::trip::Trip;

/// Distance beyond the latest expected contact over which the search continues before it reports no contact, mm. A soft surface
/// yields before it is felt.
pub(super) const SEARCH_MM: f64 = 0.20;

/// Margin that a rule on a fall or a change of a mean leaves, in sd of the mean.
pub(super) const TELL_SIGMAS: f64 = 6.0;

/// Smallest step that is commanded, mm.
pub(super) use palpate_core::quantity::FINEST_STEP_MM as STEP_LEAST_MM;

/// Largest number of steps to one level. If the declared stiffness is much too high, each step may go only a few micrometres.
pub(super) const STEPS_MAX: u32 = 1000;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PressState {
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
    Following,
    Ramping,
    Ramped,
    Bracing,
    Dragging,
    Dragged,
    Retracting,
    Leaving,
    LeavingContact,
    Over,
}

/// One contact: find the surface from above, reach each level from its own side, hold it, sample it, retract.
pub struct ForceLoop {
    pub(super) task: PressTask,
    pub(super) context: Context,
    pub(super) state: PressState,
    pub(super) level: usize,
    pub(super) z_mm: f64,
    pub(super) force_n: f64,
    /// Largest mean since the contact began, N.
    pub(super) peak_n: f64,
    pub(super) sigma_n: f64,
    pub(super) moment: Moment,
    /// Earliest position of the surface: expected before the touch, touched after it.
    pub(super) first_mm: f64,
    pub(super) in_contact: bool,
    pub(super) dwelt: bool,
    /// Time until which the present level is followed, s; `None` before its window ends.
    pub(super) follow_until_s: Option<f64>,
    pub(super) ramped: RampProgress,
    pub(super) steps: u32,
    /// Number of readings of the last look of the search; `None` before it.
    pub(super) last_look: Option<u32>,
    pub(super) motion: Option<MotionInProgress>,
    /// Rule that a reading broke during a motion.
    pub(super) broken: Option<Trip>,
    /// Time at which contact was first felt, s.
    pub(super) contact_s: Option<f64>,
    /// Reference point from which the stiffness is measured: z and force.
    pub(super) anchor: (f64, f64),
    /// Last point up to which the force has responded: z and force.
    pub(super) answered: (f64, f64),
    /// Deepest point at which the load cell was shown to follow: z and force. Until then, the earliest contact without force.
    pub(super) shown: (f64, f64),
    /// First look in contact: z and force.
    pub(super) met: (f64, f64),
    /// Last mean of a stage at rest in contact; `None` since the last motion.
    pub(super) rested: Option<Rested>,
    /// Position where the previous motion ended, mm.
    pub(super) before_mm: f64,
    pub(super) stiffness_n_mm: Option<f64>,
    /// Loading path: z and force at rest, from the touch to the first level.
    pub(super) path: Vec<(f64, f64)>,
    pub(super) push: Push,
    pub(super) landing: Option<Landing>,
    pub(super) dragged: DragProgress,
}

/// Motion in progress: its start position, its earliest start time and its course.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotionInProgress {
    pub(super) from_mm: f64,
    pub(super) from_n: f64,
    pub(super) began_s: f64,
    pub(super) profile: MotionProfile,
}

/// A mean of the force while the stage rests in contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rested {
    pub(super) force_n: f64,
    pub(super) sigma_n: f64,
    pub(super) now_s: f64,
    /// Whether the stage had rested long enough before that a slow cell would have shown a rise.
    pub(super) is_long: bool,
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

/// Result of a first motion: its end and the force that it met.
#[derive(Clone, Copy, Debug)]
pub(super) struct Landing {
    pub(super) z_mm: f64,
    pub(super) force_n: f64,
    pub(super) expected_n: f64,
    /// Force that the last correction should have reached, N.
    pub(super) left_n: f64,
    /// Part of this force that was lost by the window, as a fraction of the set force.
    pub(super) faded: Option<f64>,
}
