use std::time::Duration;
use tokio::sync::watch;
use tokio::time::sleep;

/// A person's word that the run is to stop; clones share it.
#[derive(Clone, Debug)]
pub struct Cancel {
    sender: watch::Sender<bool>,
}

impl Default for Cancel {
    fn default() -> Self {
        Cancel { sender: watch::Sender::new(false) }
    }
}

impl Cancel {
    /// Asks for the stop.
    pub fn ask(&self) {
        self.sender.send_replace(true);
    }

    /// Whether it was asked for.
    pub fn asked(&self) -> bool {
        *self.sender.borrow()
    }

    /// Waits until the stop is asked for.
    pub async fn wait(&self) {
        // the sender lives as long as this does, so that waiting can't fail
        let _ = self.sender.subscribe().wait_for(|asked| *asked).await;
    }

    /// Sleeps, but no longer than until the stop is asked for.
    pub async fn sleep(&self, duration: Duration) {
        tokio::select! {
            biased;
            () = self.wait() => {}
            () = sleep(duration) => {}
        }
    }
}
