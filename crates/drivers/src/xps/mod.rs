//! Newport XPS (Q8, D, RL): three axes in one, two or three groups, and an analog input for a load cell.
//!
//! Functions and answers follow the programmer's manual. A motion is a call that is answered when the motion has ended; until
//! then it occupies its socket. So there is one socket for questions, and each group has one for its motions and one that stays free
//! for the abort.

mod analog;
mod groups;
mod guard;
mod motion;
mod ready;
mod socket;
mod stage;
mod text;

pub use analog::XpsAnalog;
pub use groups::{Grouping, PositionerName};
pub use guard::Guard;
pub use stage::Xps;
pub use text::parse_answer;

use std::time::Duration;

/// Longest wait for the answer to a call that causes no motion.
const CALL_DEADLINE: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests;
