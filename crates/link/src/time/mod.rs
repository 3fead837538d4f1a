//! Time as drivers, emulators and runs see it: tokio's, or virtual time on a thread that a simulated run has for itself.
//!
//! A simulated run is executed by [`run_virtually`]. On its thread, time passes only when nothing else is left to do: it jumps to the
//! next deadline. Everywhere else, every function here is tokio's of the same name, so a real rig never sees virtual time.

mod executor;
#[cfg(test)]
mod tests;

pub use executor::run_virtually;

use executor::{Deadline, VirtualTask};
use pin_project_lite::pin_project;
use std::future::Future;
use std::ops::{Add, AddAssign, Sub};
use std::pin::Pin;
use std::sync::OnceLock;
use std::task::{Context, Poll};
use std::time::Duration;

/// A moment of tokio's time, or of virtual time: nanoseconds since an origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instant(u64);

/// Origin of [`Instant`] before the program's first look at a clock. A paused clock of tokio may have begun before that.
const ORIGIN_BEFORE: Duration = Duration::from_secs(3600);

/// Returns the origin of real moments.
fn origin() -> tokio::time::Instant {
    static ORIGIN: OnceLock<tokio::time::Instant> = OnceLock::new();
    *ORIGIN.get_or_init(|| (std::time::Instant::now() - ORIGIN_BEFORE).into())
}

impl Instant {
    /// Returns the present moment.
    pub fn now() -> Self {
        let real = || Instant(nanoseconds(tokio::time::Instant::now() - origin()));
        executor::now().unwrap_or_else(real)
    }

    /// Returns the time since this moment.
    pub fn elapsed(self) -> Duration {
        Instant::now() - self
    }

    /// Returns the time since an earlier moment; zero if that is later.
    pub fn duration_since(self, earlier: Instant) -> Duration {
        self - earlier
    }

    fn real(self) -> tokio::time::Instant {
        origin() + Duration::from_nanos(self.0)
    }
}

/// Returns a time in ns; the longest possible one instead of more.
fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

impl Add<Duration> for Instant {
    type Output = Instant;

    fn add(self, later: Duration) -> Instant {
        Instant(self.0.saturating_add(nanoseconds(later)))
    }
}

impl AddAssign<Duration> for Instant {
    fn add_assign(&mut self, later: Duration) {
        *self = *self + later;
    }
}

impl Sub<Duration> for Instant {
    type Output = Instant;

    fn sub(self, earlier: Duration) -> Instant {
        Instant(self.0.saturating_sub(nanoseconds(earlier)))
    }
}

/// The time between two moments; zero if the second is later.
impl Sub for Instant {
    type Output = Duration;

    fn sub(self, earlier: Instant) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }
}

/// Wait for a moment.
#[derive(Debug)]
#[must_use = "it waits when it is awaited"]
pub struct Sleep(Wait);

#[derive(Debug)]
enum Wait {
    /// Time of tokio.
    Real(Pin<Box<tokio::time::Sleep>>),
    /// Virtual time.
    Virtual(Deadline),
}

impl Future for Sleep {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        match &mut self.0 {
            Wait::Real(sleep) => sleep.as_mut().poll(context),
            Wait::Virtual(deadline) => deadline.poll(context),
        }
    }
}

/// Waits for this time, to the next whole millisecond of the clock.
pub fn sleep(time: Duration) -> Sleep {
    sleep_until(Instant::now() + time)
}

/// Waits until a moment, to the next whole millisecond of the clock.
pub fn sleep_until(moment: Instant) -> Sleep {
    match Deadline::at(moment) {
        Some(deadline) => Sleep(Wait::Virtual(deadline)),
        None => Sleep(Wait::Real(Box::pin(tokio::time::sleep_until(moment.real())))),
    }
}

/// The time of a wait has passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the deadline has elapsed")]
pub struct Elapsed;

pin_project! {
    /// Wait for a result, which has a deadline.
    #[derive(Debug)]
    #[must_use = "it waits when it is awaited"]
    pub struct Timeout<F> {
        #[pin]
        result: F,
        end: Sleep,
    }
}

impl<F: Future> Future for Timeout<F> {
    type Output = Result<F::Output, Elapsed>;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        match this.result.poll(context) {
            Poll::Ready(result) => Poll::Ready(Ok(result)),
            Poll::Pending => Pin::new(this.end).poll(context).map(|()| Err(Elapsed)),
        }
    }
}

/// Waits for a result for at most this time.
pub fn timeout<F: Future>(time: Duration, result: F) -> Timeout<F> {
    timeout_at(Instant::now() + time, result)
}

/// Waits for a result until a moment.
pub fn timeout_at<F: Future>(moment: Instant, result: F) -> Timeout<F> {
    Timeout { result, end: sleep_until(moment) }
}

/// A task that runs beside the others of its thread. It continues if this is dropped.
#[derive(Debug)]
pub struct Task(EitherHandle);

#[derive(Debug)]
enum EitherHandle {
    Real(tokio::task::JoinHandle<()>),
    Virtual(VirtualTask),
}

/// Begins a task. Its result is dropped.
pub fn spawn<T>(future: impl Future<Output = T> + Send + 'static) -> Task {
    let future = async move { drop(future.await) };
    match executor::now() {
        Some(_) => Task(EitherHandle::Virtual(executor::spawn(Box::pin(future)))),
        None => Task(EitherHandle::Real(tokio::spawn(future))),
    }
}

impl Task {
    /// Whether the task has ended.
    pub fn is_finished(&self) -> bool {
        match &self.0 {
            EitherHandle::Real(task) => task.is_finished(),
            EitherHandle::Virtual(task) => task.is_finished(),
        }
    }

    /// Ends the task at its next turn, wherever it waits.
    pub fn abort(&self) {
        match &self.0 {
            EitherHandle::Real(task) => task.abort(),
            EitherHandle::Virtual(task) => task.abort(),
        }
    }
}
