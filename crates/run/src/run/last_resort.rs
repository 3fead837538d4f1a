//! The last resort: what a stopped stage does is given up if the force continues to rise beyond the limit.

use super::retraction::{LAST_READING_DEADLINE, then_notify};
use super::watched_cell::WatchedLoadCell;
use palpate_control::check_sound;
use palpate_core::quantity::ForceReading;
use palpate_link::device::{DeviceError, LoadCell};
use palpate_link::time::{sleep, timeout};
use tokio::sync::Notify;

/// Least force for the last resort, as a multiple of the limit. No motion that a permit granted reaches it.
pub const LAST_RESORT_SHARE: f64 = 1.1;
/// Least rise of the force since the first of two or more such readings, in sd of a reading. A stage that rests in contact is freed by its way
/// out, and not by a reset.
const RISE_SIGMAS: f64 = 6.0;

impl<C: LoadCell> WatchedLoadCell<'_, C> {
    /// Returns the next reading; `None` if what is awaited meanwhile is over.
    pub(super) async fn reading_until(&mut self, over: &Notify) -> Option<Result<ForceReading, DeviceError>> {
        let reading = async {
            sleep(self.cell.conversion()).await;
            self.cell.read().await
        };
        tokio::pin!(reading);
        tokio::select! {
            biased;
            () = over.notified() => {
                // an exchange that is answered in time isn't abandoned
                let _ = timeout(LAST_READING_DEADLINE, reading).await;
                None
            }
            read = &mut reading => Some(read),
        }
    }

    /// Reads until the force continues to rise beyond the limit, or what is awaited meanwhile is over. Returns whether it rose.
    pub(super) async fn rises_beyond(&mut self, over: &Notify) -> bool {
        let (zero, least_n) = (self.watch.zero(), LAST_RESORT_SHARE * self.watch.limit_n());
        let (zero, rise_n) = (*zero, RISE_SIGMAS * zero.sigma_n);
        let mut first_n = None;
        while let Some(read) = self.reading_until(over).await {
            let force_n = read.ok().filter(|read| check_sound(read).is_ok()).map(|read| zero.from_zero_n(&read));
            match (force_n.filter(|force_n| *force_n > least_n), first_n) {
                (None, _) => first_n = None,
                (Some(now_n), None) => first_n = Some(now_n),
                (Some(now_n), Some(first_n)) if now_n > first_n + rise_n => {
                    self.presses_on = true;
                    return true;
                }
                _ => {}
            }
        }
        false
    }
}

/// Awaits what a stopped stage does; `None` if the force continues to rise beyond the limit meanwhile.
pub(super) async fn unless_it_presses_on<C: LoadCell, T>(
    watched_cell: &mut WatchedLoadCell<'_, C>,
    stopping: impl Future<Output = T>,
) -> Option<T> {
    let (over, given_up) = (Notify::new(), Notify::new());
    let stopping = then_notify(unless_given_up(stopping, &given_up), &over);
    let watch = async {
        if watched_cell.rises_beyond(&over).await {
            given_up.notify_one();
        }
    };
    tokio::join!(stopping, watch).0
}

/// Awaits something; `None` if it is given up before.
pub(super) async fn unless_given_up<T>(awaited: impl Future<Output = T>, given_up: &Notify) -> Option<T> {
    tokio::select! {
        biased;
        done = awaited => Some(done),
        () = given_up.notified() => None,
    }
}
