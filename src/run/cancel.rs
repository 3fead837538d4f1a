//! A person's word to a run.

use super::Halt;
use std::time::Duration;
use tokio::sync::watch;
use tokio::time::sleep;

/// A person's word to a run; clones share it.
#[derive(Clone, Debug)]
pub struct Cancel {
    sender: watch::Sender<Word>,
}

/// What a person said last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Word {
    #[default]
    GoOn,
    /// Nothing yet, and no press is under way that could be finished first.
    Preparing,
    Pause,
    Stop,
}

impl Default for Cancel {
    fn default() -> Self {
        Cancel { sender: watch::Sender::new(Word::GoOn) }
    }
}

impl Cancel {
    /// Asks for a stop at once, in the middle of a press. Nothing takes that back.
    pub fn ask(&self) {
        self.sender.send_replace(Word::Stop);
    }

    /// Asks for a pause when the press that is under way is recorded. Whether there will be one: there is none while the rig is
    /// made ready, and no second one.
    pub fn pause(&self) -> bool {
        self.exchange(Word::GoOn, Word::Pause)
    }

    /// The rig is made ready: until it is, no press is under way that a pause could wait for.
    pub(super) fn preparing(&self) {
        self.exchange(Word::GoOn, Word::Preparing);
    }

    /// It is.
    pub(super) fn prepared(&self) {
        self.exchange(Word::Preparing, Word::GoOn);
    }

    /// Ends a pause.
    pub fn go_on(&self) {
        self.exchange(Word::Pause, Word::GoOn);
    }

    /// Whether a stop was asked for.
    pub fn asked(&self) -> bool {
        *self.sender.borrow() == Word::Stop
    }

    /// # Errors
    /// A stop was asked for.
    pub(super) fn check(&self) -> Result<(), Halt> {
        if self.asked() { Err(Halt::Cancelled) } else { Ok(()) }
    }

    /// Whether a pause was asked for.
    pub fn pausing(&self) -> bool {
        *self.sender.borrow() == Word::Pause
    }

    /// Waits until a stop is asked for.
    pub async fn wait(&self) {
        self.wait_for(|word| word == Word::Stop).await;
    }

    /// Waits until a pause is over, or a stop is asked for.
    pub async fn while_pausing(&self) {
        self.wait_for(|word| word != Word::Pause).await;
    }

    /// Sleeps, but no longer than until a pause or a stop is asked for.
    pub async fn sleep(&self, duration: Duration) {
        tokio::select! {
            biased;
            () = self.wait_for(|word| word != Word::GoOn) => {}
            () = sleep(duration) => {}
        }
    }

    async fn wait_for(&self, is_meant: impl Fn(Word) -> bool) {
        // the sender lives as long as this does, so that waiting can't fail
        let _ = self.sender.subscribe().wait_for(|word| is_meant(*word)).await;
    }

    fn exchange(&self, from: Word, to: Word) -> bool {
        self.sender.send_if_modified(|word| {
            let fits = *word == from;
            if fits {
                *word = to;
            }
            fits
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pause_can_be_taken_back_and_a_stop_can_not() {
        let cancel = Cancel::default();
        assert!(cancel.pause() && !cancel.pause());
        assert!(cancel.pausing() && !cancel.asked());
        cancel.go_on();
        assert!(!cancel.pausing());
        cancel.ask();
        cancel.pause();
        cancel.go_on();
        assert!(cancel.asked() && !cancel.pausing());
    }

    #[test]
    fn there_is_no_pause_while_the_rig_is_made_ready_but_one_from_before_stays() {
        let cancel = Cancel::default();
        cancel.preparing();
        assert!(!cancel.pause() && !cancel.pausing() && !cancel.asked());
        cancel.prepared();
        assert!(cancel.pause());
        cancel.preparing();
        cancel.prepared();
        assert!(cancel.pausing());
    }
}
