//! Requests of a person to a run.

use super::Halt;
use palpate_link::time::sleep;
use std::time::Duration;
use tokio::sync::watch;

/// Requests of a person to a run; clones share the state.
#[derive(Clone, Debug)]
pub struct Cancel {
    sender: watch::Sender<OperatorCommand>,
}

/// Last command of the operator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum OperatorCommand {
    #[default]
    GoOn,
    /// No request so far, and no press is under way that could be finished first.
    Preparing,
    Pause,
    Stop,
}

impl Default for Cancel {
    fn default() -> Self {
        Cancel { sender: watch::Sender::new(OperatorCommand::GoOn) }
    }
}

impl Cancel {
    /// Requests an immediate stop, even during a press. The request can't be taken back.
    pub fn ask(&self) {
        self.sender.send_replace(OperatorCommand::Stop);
    }

    /// Requests a pause after the press under way is recorded. Returns whether there will be a pause: there is none while the rig
    /// is being prepared, and no second one.
    pub fn pause(&self) -> bool {
        self.exchange(OperatorCommand::GoOn, OperatorCommand::Pause)
    }

    /// Marks that the rig is being prepared. Until it is prepared, there is no press whose end a pause could wait for.
    pub fn preparing(&self) {
        self.exchange(OperatorCommand::GoOn, OperatorCommand::Preparing);
    }

    /// Marks that the rig is prepared.
    pub fn prepared(&self) {
        self.exchange(OperatorCommand::Preparing, OperatorCommand::GoOn);
    }

    /// Ends a pause.
    pub fn go_on(&self) {
        self.exchange(OperatorCommand::Pause, OperatorCommand::GoOn);
    }

    /// Whether a stop was requested.
    pub fn asked(&self) -> bool {
        *self.sender.borrow() == OperatorCommand::Stop
    }

    /// # Errors
    /// Returns a halt if a stop was requested.
    pub(super) fn check(&self) -> Result<(), Halt> {
        if self.asked() { Err(Halt::Cancelled) } else { Ok(()) }
    }

    /// Whether a pause was requested.
    pub fn pausing(&self) -> bool {
        *self.sender.borrow() == OperatorCommand::Pause
    }

    /// Waits until a stop is requested.
    pub async fn wait(&self) {
        self.wait_for(|word| word == OperatorCommand::Stop).await;
    }

    /// Waits until a pause ends or a stop is requested.
    pub(crate) async fn while_pausing(&self) {
        self.wait_for(|word| word != OperatorCommand::Pause).await;
    }

    /// Sleeps for a duration, but ends early if a pause or a stop is requested.
    pub async fn sleep(&self, duration: Duration) {
        tokio::select! {
            biased;
            () = self.wait_for(|word| word != OperatorCommand::GoOn) => {}
            () = sleep(duration) => {}
        }
    }

    async fn wait_for(&self, is_meant: impl Fn(OperatorCommand) -> bool) {
        // the sender lives as long as this, so waiting can't fail
        let _ = self.sender.subscribe().wait_for(|word| is_meant(*word)).await;
    }

    fn exchange(&self, from: OperatorCommand, to: OperatorCommand) -> bool {
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
    fn pause_during_preparation_is_refused_and_an_earlier_one_stays() {
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
