//! A session of live readings: its searches for units at fault run in a thread of the process.

use super::answers::ReadingSolver;
use super::readings::Reading;
use palpate_core::parallel::lock;
use palpate_solver::{FaultChange, FaultSearch, FaultyUnit, SearchedFaults, Session, Solution, Unanswered};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, Sender, SyncSender, TryRecvError, TrySendError, channel, sync_channel};
use std::thread;

/// A session whose searches for units at fault run beside its answers: no answer waits for one.
pub struct LiveSession {
    session: Session,
    search: Option<Receiver<SearchedFaults>>,
}

/// A search, and where its result goes.
type Job = (FaultSearch, Sender<SearchedFaults>);

/// Largest number of searches that wait: one for each of the connections that `serve` accepts.
const QUEUE: usize = 1000;

/// What is added to the niceness of the thread: the most that Linux knows (setpriority(2)).
#[cfg(target_os = "linux")]
const LEAST_SHARE: i32 = 19;

/// The thread that makes the searches of all sessions, one after another; `None` until it is needed.
static WORKER: Mutex<Option<SyncSender<Job>>> = Mutex::new(None);

impl LiveSession {
    /// Leaves the searches of a session to the thread.
    pub fn new(session: Session) -> Self {
        LiveSession { session: session.deferring(), search: None }
    }

    /// Returns the session.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Solves the next reading; a missing output is NaN.
    ///
    /// # Errors
    /// The reading has no answer.
    pub fn solve(&mut self, outputs: &[f64]) -> Result<Solution, Unanswered> {
        if let Some(search) = &self.search {
            match search.try_recv() {
                Ok(searched) => self.take(Some(searched)),
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Disconnected) => self.take(None),
            }
        }
        let solved = self.session.solve(outputs);
        if let Some(search) = self.session.search() {
            match begun(search) {
                Some(result) => self.search = Some(result),
                None => self.session.forget_search(),
            }
        }
        solved
    }

    /// Solves the next of several readings that are all known. The result of a search is waited for where it counts, so the same readings
    /// have the same answers.
    ///
    /// # Errors
    /// The reading has no answer.
    pub fn solve_known(&mut self, outputs: &[f64]) -> Result<Solution, Unanswered> {
        let solved = self.session.solve(outputs);
        if let Some(search) = self.session.search() {
            self.session.accept(search.run());
        }
        if self.session.awaits_search() {
            let searched = self.search.as_ref().and_then(|search| search.recv().ok());
            self.take(searched);
        }
        solved
    }

    /// Takes the result of the search; `None` if it failed.
    fn take(&mut self, searched: Option<SearchedFaults>) {
        self.search = None;
        match searched {
            Some(searched) => self.session.accept(searched),
            None => self.session.forget_search(),
        }
    }
}

impl ReadingSolver for LiveSession {
    type Solution = Solution;

    fn solve(&mut self, reading: &Reading) -> Result<Solution, Unanswered> {
        LiveSession::solve(self, &reading.outputs)
    }

    fn changes(&self) -> &[FaultChange] {
        self.session.changes()
    }

    fn at_fault(&self) -> Vec<FaultyUnit> {
        self.session.at_fault()
    }

    fn is_out_of_date(&self) -> bool {
        self.session.is_out_of_date()
    }
}

/// Hands a search to the thread. Returns where its result arrives; `None` if there is no thread or its queue is full.
fn begun(search: FaultSearch) -> Option<Receiver<SearchedFaults>> {
    let (sender, receiver) = channel();
    let mut worker = lock(&WORKER);
    let mut job = (search, sender);
    if let Some(known) = worker.as_ref() {
        match known.try_send(job) {
            Ok(()) => return Some(receiver),
            Err(TrySendError::Full(_)) => return None,
            // a search failed, and its thread with it
            Err(TrySendError::Disconnected(back)) => job = back,
        }
    }
    let (jobs, searches) = sync_channel::<Job>(QUEUE);
    let work = move || {
        yield_to_answers();
        searches.iter().for_each(|(search, result)| _ = result.send(search.run()));
    };
    thread::Builder::new().name("searches".to_owned()).spawn(work).ok()?;
    jobs.try_send(job).ok()?;
    *worker = Some(jobs);
    Some(receiver)
}

/// Gives this thread the least share of the processors: beside another busy program on two of them, a search of 192 units made one answer of a
/// hundred wait for 2 to 4 ms. Elsewhere than on Linux such a call would hold back the whole process.
#[cfg(target_os = "linux")]
fn yield_to_answers() {
    // without the right to it, a search is only less polite
    _ = rustix::process::nice(LEAST_SHARE);
}

#[cfg(not(target_os = "linux"))]
fn yield_to_answers() {}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_solver::{Calibration, CalibrationPoint, Model, Place, Setting};

    /// Nine units in a line of outputs that fall with the distance, and a change of one of them.
    fn outputs(x_mm: f64, y_mm: f64, broken: f64) -> Vec<f64> {
        let output = |unit: usize| {
            let (at_x, at_y) = ((unit % 3) as f64 - 1.0, (unit / 3) as f64 - 1.0);
            let square = (x_mm - 4.5 * at_x).powi(2) + (y_mm - 4.5 * at_y).powi(2);
            let part = if unit == 4 { broken } else { 1.0 };
            // no model is exact
            part * (1.0 + 0.01 * (17.0 * x_mm + 29.0 * y_mm + unit as f64).sin()) / (1.0 + square / 25.0)
        };
        (0..9).map(output).collect()
    }

    fn session() -> Session {
        let at = |i: usize| -6.0 + i as f64;
        let rows: Vec<(Place, Vec<f64>)> = (0..169)
            .map(|i| Place::new(at(i % 13), at(i / 13)))
            .map(|place| (place, outputs(place.x_mm, place.y_mm, 1.0)))
            .collect();
        let point =
            |(place, outputs): &'static (Place, Vec<f64>)| CalibrationPoint { place: *place, force_n: 1.0, outputs };
        let points: Vec<CalibrationPoint<'_>> = Vec::leak(rows).iter().map(point).collect();
        Session::new(Model::fit("pearson", Calibration::new(&points).unwrap(), &Setting::default()).unwrap())
    }

    /// Contacts at places without an order, with a weak unit.
    fn contacts(count: usize) -> impl Iterator<Item = Vec<f64>> {
        (0..count).map(|i| outputs((i * 37 % 113) as f64 / 9.5 - 6.0, (i * 61 % 109) as f64 / 9.2 - 6.0, 0.3))
    }

    /// How often this thread has waited.
    #[cfg(target_os = "linux")]
    fn waits() -> u64 {
        let status = std::fs::read_to_string("/proc/thread-self/status").unwrap();
        let waits = status.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:")).unwrap();
        waits.trim().parse().unwrap()
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_thousand_answers_come_while_a_search_never_ends() {
        let mut live = LiveSession::new(session());
        let mut never = None;
        let before = waits();
        for reading in contacts(1000) {
            let solved = live.session.solve(&reading);
            if live.session.search().is_some() {
                let (sender, receiver) = channel();
                (live.search, never) = (Some(receiver), Some(sender));
            }
            assert!(live.solve(&reading).is_ok() && solved.is_ok());
        }
        assert!(never.is_some(), "a search was due");
        assert!(live.session.awaits_search() && live.session().at_fault().is_empty());
        // what the system interrupts isn't counted
        assert!(waits() - before < 10, "{} waits in 1000 answers", waits() - before);
    }

    #[test]
    fn known_readings_are_answered_as_a_file_and_live_ones_name_the_same() {
        let (mut file, mut known, mut live) = (session(), LiveSession::new(session()), LiveSession::new(session()));
        for reading in contacts(300) {
            assert_eq!(file.solve(&reading).unwrap(), known.solve_known(&reading).unwrap());
            assert_eq!(file.changes(), known.session().changes());
            live.solve(&reading).unwrap();
            // as if the next reading came after the search
            if let Some(search) = live.search.take() {
                live.take(search.recv().ok());
            }
        }
        assert_eq!(file.at_fault().iter().map(|faulty| faulty.unit).collect::<Vec<_>>(), [4]);
        let is_named = live.session().at_fault().iter().any(|faulty| faulty.unit == 4);
        assert!(is_named, "{:?}", live.session().changes());
    }
}
