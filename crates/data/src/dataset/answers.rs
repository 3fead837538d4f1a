//! Answers to lines of readings, for any source of the lines and any destination of the answers.

use super::readings::{LineContent, Reading, ReadingError, Readings};
use miette::Diagnostic;
use palpate_solver::vector::{VectorSession, VectorSolution};
use palpate_solver::{FaultChange, FaultyUnit, HistorySession, SearchedFaults, Session, Solution, Unanswered};
use serde_json::Value;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Answers one line after another.
pub struct Answers<S: ReadingSolver = Session> {
    readings: Readings,
    session: S,
}

/// A session: solves one reading after another.
pub trait ReadingSolver {
    /// Answer to a reading.
    type Solution;

    /// Whether each reading needs a time.
    const NEEDS_TIME: bool = false;

    /// Solves the next reading; a missing output is NaN.
    ///
    /// # Errors
    /// The reading has no answer.
    fn solve(&mut self, reading: &Reading) -> Result<Self::Solution, Unanswered>;

    /// Takes whether many more readings have arrived already. Then nobody waits for the next answer, and a search may take its time.
    fn take_backlog(&mut self, _is_long: bool) {}

    /// Changes of the units that are left out, from the first one.
    fn changes(&self) -> &[FaultChange] {
        &[]
    }

    /// Units that broke since the calibration, and are left out.
    fn at_fault(&self) -> Vec<FaultyUnit> {
        Vec::new()
    }

    /// Whether the sensor should be calibrated again.
    fn is_out_of_date(&self) -> bool {
        false
    }
}

impl ReadingSolver for Session {
    type Solution = Solution;

    fn solve(&mut self, reading: &Reading) -> Result<Solution, Unanswered> {
        Session::solve(self, &reading.outputs)
    }

    fn changes(&self) -> &[FaultChange] {
        Session::changes(self)
    }

    fn at_fault(&self) -> Vec<FaultyUnit> {
        Session::at_fault(self)
    }

    fn is_out_of_date(&self) -> bool {
        Session::is_out_of_date(self)
    }
}

/// A session whose searches for units at fault run in a thread of their own, so that no answer waits long for one.
pub struct SearchingApart {
    session: Session,
    /// Receives the result of the search that runs.
    search: Option<Receiver<SearchedFaults>>,
    /// Whether many more readings have arrived.
    has_backlog: bool,
}

/// Longest time for which an answer waits for a search.
const WAIT_MOST: Duration = Duration::from_millis(2);

impl SearchingApart {
    /// Leaves the searches of a session to threads.
    pub fn new(session: Session) -> Self {
        SearchingApart { session: session.deferring(), search: None, has_backlog: false }
    }

    /// Returns the session.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Takes whether many more readings are known already. Then each search ends before the next reading, so the same readings have
    /// the same answers.
    pub fn take_backlog(&mut self, is_long: bool) {
        self.has_backlog = is_long;
    }

    /// Solves the next reading; a missing output is NaN.
    ///
    /// # Errors
    /// The reading has no answer.
    pub fn solve(&mut self, outputs: &[f64]) -> Result<Solution, Unanswered> {
        let solved = self.session.solve(outputs);
        let wait = |search: &Receiver<SearchedFaults>| match self.has_backlog {
            true => search.recv().map_err(RecvTimeoutError::from),
            false => search.recv_timeout(WAIT_MOST),
        };
        match self.search.as_ref().map(wait) {
            Some(Ok(searched)) => {
                self.session.accept(searched);
                self.search = None;
            }
            Some(Err(RecvTimeoutError::Timeout)) => return solved,
            // a search that failed isn't repeated
            Some(Err(RecvTimeoutError::Disconnected)) | None => {}
        }
        let Some(search) = self.session.search() else { return solved };
        if self.has_backlog {
            self.session.accept(search.run());
        } else {
            let (sender, receiver) = channel();
            // a session that has ended needs no result, and one without a thread goes on without searches
            _ = thread::Builder::new().spawn(move || _ = sender.send(search.run()));
            self.search = Some(receiver);
        }
        solved
    }
}

impl ReadingSolver for SearchingApart {
    type Solution = Solution;

    fn solve(&mut self, reading: &Reading) -> Result<Solution, Unanswered> {
        SearchingApart::solve(self, &reading.outputs)
    }

    fn take_backlog(&mut self, is_long: bool) {
        SearchingApart::take_backlog(self, is_long);
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

impl ReadingSolver for VectorSession {
    type Solution = VectorSolution;

    fn solve(&mut self, reading: &Reading) -> Result<VectorSolution, Unanswered> {
        VectorSession::solve(self, &reading.outputs)
    }
}

impl ReadingSolver for HistorySession {
    /// The force, N.
    type Solution = f64;

    const NEEDS_TIME: bool = true;

    fn solve(&mut self, reading: &Reading) -> Result<f64, Unanswered> {
        let t_s = reading.t_s.as_ref().and_then(Value::as_f64).ok_or(Unanswered::NoTime)?;
        HistorySession::solve(self, t_s, &reading.outputs)
    }
}

/// Answer to a line that contains a reading, or should contain one.
#[derive(Debug)]
pub struct LineAnswer<'a, T = Solution> {
    /// Reading of the line. For an invalid line: its number, and its labels if they could be read.
    pub reading: &'a Reading,
    /// The contact, or the reason why there is none.
    pub solved: Result<T, UnansweredLine>,
    /// Units that broke, and without which the line was solved.
    pub at_fault: Vec<FaultyUnit>,
    /// Changes of these units that count from the next line on.
    pub changes: &'a [FaultChange],
    /// Whether this reading shows that the sensor should be calibrated again. Stated once.
    pub is_out_of_date: bool,
}

/// Reason why a line has no contact.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum UnansweredLine {
    /// The line isn't a reading.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Bad(ReadingError),
    /// The reading has no answer.
    #[error(transparent)]
    Unanswered(#[from] Unanswered),
}

impl<S: ReadingSolver> Answers<S> {
    /// Reads lines as `readings` does, and solves them as `session` does.
    pub fn new(readings: Readings, session: S) -> Self {
        Answers { readings: readings.with_times(S::NEEDS_TIME), session }
    }

    /// Returns the session, with the method and the excluded units.
    pub fn session(&self) -> &S {
        &self.session
    }

    /// Takes whether many more lines have arrived already.
    pub fn take_backlog(&mut self, is_long: bool) {
        self.session.take_backlog(is_long);
    }

    /// Returns the answer to the next line; `None` if the line is blank or is the header.
    ///
    /// # Errors
    /// The header is invalid, so no further line has an answer.
    pub fn answer(&mut self, line: &[u8]) -> Result<Option<LineAnswer<'_, S::Solution>>, ReadingError> {
        let (known, was_out_of_date) = (self.session.changes().len(), self.session.is_out_of_date());
        let at_fault = self.session.at_fault();
        let solved = match self.readings.read(line)? {
            LineContent::Nothing => return Ok(None),
            LineContent::Bad(error) => Err(UnansweredLine::Bad(error)),
            LineContent::Reading => self.session.solve(self.readings.reading()).map_err(UnansweredLine::from),
        };
        let changes = &self.session.changes()[known..];
        let is_out_of_date = self.session.is_out_of_date() && !was_out_of_date;
        Ok(Some(LineAnswer { reading: self.readings.reading(), solved, at_fault, changes, is_out_of_date }))
    }
}
