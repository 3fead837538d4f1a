//! The library on its own thread.

use super::NiDaqmx;
use crate::time::timeout;
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;
use tokio::sync::oneshot;

/// Longest duration of a library call. None of this program's calls waits, but a device that is being unplugged can block a call.
const CALL_DEADLINE: Duration = Duration::from_secs(5);

type LibraryCall = Box<dyn FnOnce(&dyn NiDaqmx) + Send>;

/// Functions, in the place where they may be called.
#[derive(Clone)]
pub enum Functions {
    /// Functions of an emulator. They take no time and are called directly.
    Here(Arc<dyn NiDaqmx>),
    /// Functions of the library, on their own thread, because a blocked call would delay a stop. The text of an error is stored
    /// for each thread, so all calls must use one thread.
    Thread(Sender<LibraryCall>),
}

/// The library's thread is blocked, or has ended.
#[derive(Debug, thiserror::Error)]
#[error("a call of the DAQmx library didn't return within {} s", CALL_DEADLINE.as_secs())]
pub struct HeldUp;

impl Functions {
    /// Puts a table on its own thread, which ends with the last handle.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn on_a_thread(table: Arc<dyn NiDaqmx>) -> std::io::Result<Functions> {
        let (sender, jobs) = channel::<LibraryCall>();
        std::thread::Builder::new().name("daqmx".to_owned()).spawn(move || {
            for job in jobs {
                job(&*table);
            }
        })?;
        Ok(Functions::Thread(sender))
    }

    /// Calls functions and waits for their results, on the runtime's clock.
    ///
    /// # Errors
    /// The functions don't return.
    pub async fn call<T: Send + 'static>(
        &self,
        job: impl FnOnce(&dyn NiDaqmx) -> T + Send + 'static,
    ) -> Result<T, HeldUp> {
        match self {
            Functions::Here(table) => Ok(job(&**table)),
            Functions::Thread(sender) => {
                let (done, result) = oneshot::channel();
                let job: LibraryCall = Box::new(move |table| {
                    let _ = done.send(job(table)); // no receiver is left
                });
                sender.send(job).map_err(|_| HeldUp)?;
                timeout(CALL_DEADLINE, result).await.ok().and_then(Result::ok).ok_or(HeldUp)
            }
        }
    }

    /// Calls functions without waiting for their end.
    pub fn call_and_leave(&self, job: impl FnOnce(&dyn NiDaqmx) + Send + 'static) {
        match self {
            Functions::Here(table) => job(&**table),
            Functions::Thread(sender) => {
                let _ = sender.send(Box::new(job)); // a thread that has ended has no task left either
            }
        }
    }
}
