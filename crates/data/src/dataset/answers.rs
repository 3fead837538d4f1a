//! Answers to lines of readings, for any source of the lines and any destination of the answers.

use super::readings::{LineContent, Reading, ReadingError, Readings};
use miette::Diagnostic;
use palpate_solver::vector::{VectorSession, VectorSolution};
use palpate_solver::{FaultChange, FaultyUnit, HistorySession, Session, Solution, Unanswered};
use serde_json::Value;

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

    /// Ends the readings, so that what the last ones show counts.
    fn finish(&mut self) {}

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

    fn finish(&mut self) {
        Session::finish(self);
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

    /// Ends the lines. Returns what the last ones show.
    pub fn finish(&mut self) -> &[FaultChange] {
        let known = self.session.changes().len();
        self.session.finish();
        &self.session.changes()[known..]
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
