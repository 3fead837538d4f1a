//! Answers to lines of readings, for any source of the lines and any destination of the answers.

use super::readings::{LineContent, Reading, ReadingError, Readings};
use miette::Diagnostic;
use palpate_solver::{Broken, Session, Solution, Unanswered};

/// Answers one line after another.
pub struct Answers {
    readings: Readings,
    session: Session,
}

/// Answer to a line that contains a reading, or should contain one.
#[derive(Debug)]
pub struct LineAnswer<'a> {
    /// Reading of the line. For an invalid line: its number, and its labels if they could be read.
    pub reading: &'a Reading,
    /// The contact, or the reason why there is none.
    pub solved: Result<Solution, UnansweredLine>,
    /// Units that are excluded from the next line on.
    pub broken: &'a [Broken],
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

impl Answers {
    /// Reads lines as `readings` does, and solves them as `session` does.
    pub fn new(readings: Readings, session: Session) -> Self {
        Answers { readings, session }
    }

    /// Returns the session, with the method and the excluded units.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Returns the answer to the next line; `None` if the line is blank or is the header.
    ///
    /// # Errors
    /// The header is invalid, so no further line has an answer.
    pub fn answer(&mut self, line: &[u8]) -> Result<Option<LineAnswer<'_>>, ReadingError> {
        let (known, was_out_of_date) = (self.session.broken().len(), self.session.is_out_of_date());
        let solved = match self.readings.read(line)? {
            LineContent::Nothing => return Ok(None),
            LineContent::Bad(error) => Err(UnansweredLine::Bad(error)),
            LineContent::Reading => self.session.solve(&self.readings.reading().outputs).map_err(UnansweredLine::from),
        };
        let broken = &self.session.broken()[known..];
        let is_out_of_date = self.session.is_out_of_date() && !was_out_of_date;
        Ok(Some(LineAnswer { reading: self.readings.reading(), solved, broken, is_out_of_date }))
    }
}
