//! Queue of readings from a run to its file. A run never waits for the disk while it is in contact.

use super::{SeriesMark, SeriesReadings};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;

/// Largest number of values in the queue: 128 MB. A disk that is so far behind ends the press.
const QUEUED_MOST: usize = 1 << 24;

/// Longest time for which a run waits for the disk after a press, in the clear.
const DISK_MOST: Duration = Duration::from_secs(60);

/// Reason why readings weren't kept.
#[derive(Debug, thiserror::Error)]
pub enum SeriesWriteError {
    /// The disk is slower than the devices.
    #[error("the disk takes readings more slowly than they come: {} MB wait for it", (QUEUED_MOST * 8) >> 20)]
    Behind,
    /// The disk doesn't answer.
    #[error("the disk took no readings for {} s", DISK_MOST.as_secs())]
    Silent,
    /// What writes the readings has ended.
    #[error("the file of readings was closed")]
    Closed,
    /// The readings couldn't be written.
    #[error("writing {}: {why}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        why: std::io::Error,
    },
}

/// What a run asks of the writer of its readings.
#[derive(Debug)]
pub enum SeriesRequest {
    /// Add readings.
    Add(SeriesReadings),
    /// Bring everything so far to the disk, and answer with the mark.
    Mark(Sender<Result<SeriesMark, SeriesWriteError>>),
}

/// End of the queue at which a run adds readings.
#[derive(Clone, Debug)]
pub struct SeriesQueue {
    requests: Sender<SeriesRequest>,
    queued: Arc<AtomicUsize>,
}

/// End of the queue at which readings are written.
#[derive(Debug)]
pub struct SeriesRequests {
    requests: Receiver<SeriesRequest>,
    queued: Arc<AtomicUsize>,
}

/// Creates a queue.
pub fn series_queue() -> (SeriesQueue, SeriesRequests) {
    let (sender, receiver) = channel();
    let queued = Arc::new(AtomicUsize::new(0));
    (SeriesQueue { requests: sender, queued: queued.clone() }, SeriesRequests { requests: receiver, queued })
}

impl SeriesQueue {
    /// Adds readings, and never waits.
    ///
    /// # Errors
    /// Too many readings wait already, or their writer has ended.
    pub fn add(&self, readings: SeriesReadings) -> Result<(), SeriesWriteError> {
        let values = readings.values();
        if self.queued.fetch_add(values, Ordering::Relaxed) + values > QUEUED_MOST {
            return Err(SeriesWriteError::Behind);
        }
        self.requests.send(SeriesRequest::Add(readings)).map_err(|_| SeriesWriteError::Closed)
    }

    /// Waits until everything so far is on the disk. Only for an indenter in the clear.
    ///
    /// # Errors
    /// The readings couldn't be written, or the disk takes too long.
    pub fn mark(&self) -> Result<SeriesMark, SeriesWriteError> {
        let (sender, answer) = channel();
        self.requests.send(SeriesRequest::Mark(sender)).map_err(|_| SeriesWriteError::Closed)?;
        answer.recv_timeout(DISK_MOST).map_err(|error| match error {
            RecvTimeoutError::Timeout => SeriesWriteError::Silent,
            RecvTimeoutError::Disconnected => SeriesWriteError::Closed,
        })?
    }
}

impl Iterator for SeriesRequests {
    type Item = SeriesRequest;

    /// Returns the next request; `None` when no run adds readings any more.
    fn next(&mut self) -> Option<SeriesRequest> {
        let request = self.requests.recv().ok()?;
        if let SeriesRequest::Add(readings) = &request {
            self.queued.fetch_sub(readings.values(), Ordering::Relaxed);
        }
        Some(request)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{ReadValue, SeriesReading};
    use super::*;

    fn readings(channels: usize) -> SeriesReadings {
        let reading = SeriesReading { t_s: 0.0, taken_s: None, value: ReadValue::Outputs(vec![0.0; channels]) };
        SeriesReadings { press: 0, rows: vec![reading] }
    }

    #[test]
    fn queue_refuses_readings_when_the_disk_is_far_behind_and_takes_them_again_later() {
        let (queue, mut requests) = series_queue();
        let large = QUEUED_MOST / 2 - 100;
        queue.add(readings(large)).unwrap();
        queue.add(readings(large)).unwrap();
        let refused = queue.add(readings(large)).unwrap_err().to_string();
        assert_eq!(refused, "the disk takes readings more slowly than they come: 128 MB wait for it");
        assert!(matches!(requests.next(), Some(SeriesRequest::Add(_))));
    }

    #[test]
    fn writer_that_ended_is_an_error_not_a_wait() {
        let (queue, requests) = series_queue();
        drop(requests);
        assert!(matches!(queue.add(readings(1)), Err(SeriesWriteError::Closed)));
        assert!(matches!(queue.mark(), Err(SeriesWriteError::Closed)));
    }
}
