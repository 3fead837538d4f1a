//! The force loop, as pure code: decides what to do next from the latest events.
//!
//! [`ForceLoop`] is a state machine for one contact. Events go in and commands come out; there is no device, no clock and no
//! randomness. Every motion toward the specimen is a [`Permitted`] one, which only a [`Permit`] can create. The end point of such
//! a motion is safe by itself, so a host that fails does no harm. [`Watch`] checks every reading against the trip rules. [`ContactMap`]
//! learns from each press what to expect of the next.
//!
//! Coordinates: `z_mm` grows into the specimen and is zero at its nominal surface. Forces are relative to the zero measured in
//! air.

#![forbid(unsafe_code)]

mod believed;
mod budget;
mod curve;
mod drag;
mod drift;
mod learned_curve;
mod mains;
mod map;
mod mean;
mod neighbours;
mod permit;
mod plane;
mod press;
mod profile;
mod rate;
mod response;
mod side;
mod speed;
mod surface;
mod task;
mod trip;
mod watch;
mod zero;

pub use believed::{Belief, Believed, Glitches, without_glitches};
pub use budget::{Averaged, UncertaintyBudget};
pub use drag::{Drag, DragContext, DragLimits, DragResponses, DragStart, DragWatch, PermittedDrag, check_direction};
pub use drift::{Drift, ZeroLine};
pub use learned_curve::{KnownSoftness, LearnedCurve, Sunk};
pub use mains::MainsInterference;
pub use map::{ContactMap, LearnedContact, Shot};
pub use mean::{Mean, mean_of};
pub use neighbours::LEARNED;
pub use permit::{
    DEPTH_MARGIN_MM, MotionContext, Permit, Permitted, Sideways, TRAVEL_CLEARANCE_MM, depth_without_force_mm,
};
pub use press::{
    Context, FIRST_APPROACH_MM_S, ForceLoop, GAIN_TIMES_DEAD_TIME, LoopCommand, LoopEvent, Moment, NO_LOAD_READINGS,
    NoLoadReadings, SEARCH_ROOM_MM, Softest, Steer, TOUCH_MOST_N,
};
pub use profile::MotionProfile;
pub use rate::ShownRate;
pub use response::{Changed, LearnedOutputs, MeasuredContact};
pub use side::SideZero;
pub use speed::{Reaction, Timing, safe_speed_mm_s};
pub use surface::{Expected, TOUCH_SIGMA_MM};
pub use task::{Branch, OverTime, PressLevel, PressTask, SetPoint, Strategy};
pub use trip::{SafetyRule, Trip};
pub use watch::{Watch, check_sound};
pub use zero::{STALE_S, Zero};
