//! Virtual time slowed down to the wall clock.

use palpate_link::time::{Instant, sleep};
use std::time::{Duration, Instant as WallInstant};

/// Interval at which virtual time is compared with the wall clock.
const GRAIN: Duration = Duration::from_millis(10);

/// Slows a run on the paused clock down to `pace` times real time; never ends.
///
/// The thread itself sleeps, and so the paused clock stays still, because everything that answers runs on this thread too.
pub async fn keep_pace(pace: f64) {
    let (began, wall_began) = (Instant::now(), WallInstant::now());
    loop {
        sleep(GRAIN).await;
        let due = began.elapsed().div_f64(pace);
        if let Some(ahead) = due.checked_sub(wall_began.elapsed()) {
            std::thread::sleep(ahead);
        }
    }
}
