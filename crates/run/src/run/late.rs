//! What is awaited in contact and comes late: the force is read meanwhile, and is never waited for in vain.

use super::Halt;
use super::last_resort::unless_given_up;
use super::retraction::LAST_READING_DEADLINE;
use super::watched_cell::{OLD_SHARE, WatchedLoadCell};
use palpate_core::quantity::seconds;
use palpate_link::device::LoadCell;
use palpate_link::time::timeout;
use std::cell::Cell;
use tokio::sync::Notify;

/// Something that is awaited while z rests in contact, such as the outputs of an array.
#[derive(Default)]
pub(super) struct Late {
    ended: Cell<bool>,
    /// Notified at its end.
    end: Notify,
    /// Notified when nobody waits for it any more.
    given_up: Notify,
}

impl Late {
    /// Awaits it; `None` if it is given up before.
    pub(super) async fn ends<T>(&self, awaited: impl Future<Output = T>) -> Option<T> {
        let ended = unless_given_up(awaited, &self.given_up).await;
        self.ended.set(true);
        self.end.notify_one();
        ended
    }

    /// Gives it up, because the force has halted the press. An exchange that is answered in time isn't abandoned.
    pub(super) async fn give_up_soon(&self) {
        if timeout(LAST_READING_DEADLINE, self.end.notified()).await.is_err() {
            self.given_up.notify_one();
        }
    }
}

impl<C: LoadCell> WatchedLoadCell<'_, C> {
    /// Reads the force until something late has ended. What ends soon isn't late.
    pub(super) async fn watch_while(&mut self, late: &Late) -> Result<(), Halt> {
        let soon = seconds(OLD_SHARE * self.watch.zero().stale_s());
        if timeout(soon, late.end.notified()).await.is_ok() {
            return Ok(());
        }
        while !late.ended.get() {
            if let Err(halt) = self.force_n().await {
                late.give_up_soon().await;
                return Err(halt);
            }
        }
        Ok(())
    }

    /// Awaits something at rest, and reads the force meanwhile if it is late.
    pub(super) async fn watched_while<T>(&mut self, awaited: impl Future<Output = T>) -> Result<T, Halt> {
        let late = Late::default();
        let (ended, watched) = tokio::join!(late.ends(awaited), self.watch_while(&late));
        watched?;
        ended.ok_or(Halt::Cancelled) // given up only where the watch has halted
    }
}
