//! What a line of readings is answered with, wherever the line came from and wherever its answer goes.

use super::readings::{Held, Reading, ReadingError, Readings};
use crate::solver::{Broken, Session, Solution, Unanswered};
use miette::Diagnostic;

/// Answers one line after another: a line in, its answer out.
pub struct Answers {
    readings: Readings,
    session: Session,
}

/// The answer to a line that holds a reading, or should hold one.
#[derive(Debug)]
pub struct Answer<'a> {
    /// What was read; of a bad line its number, and its labels where they could be read.
    pub reading: &'a Reading,
    /// The contact, or why there is none.
    pub solved: Result<Solution, Unsolved>,
    /// Units that are left out from the next line on.
    pub broken: &'a [Broken],
}

/// Why a line has no contact.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum Unsolved {
    /// It isn't a reading.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Bad(ReadingError),
    /// The reading has no answer.
    #[error(transparent)]
    Unanswered(#[from] Unanswered),
}

impl Answers {
    /// Lines as `readings` takes them, solved as `session` does.
    pub fn new(readings: Readings, session: Session) -> Self {
        Answers { readings, session }
    }

    /// The method, and which units are left out.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// The answer to the next line; none where it holds blanks, or is the header.
    ///
    /// # Errors
    /// A header that can't be used: no line has an answer from here on.
    pub fn answer(&mut self, line: &[u8]) -> Result<Option<Answer<'_>>, ReadingError> {
        let known = self.session.broken().len();
        let solved = match self.readings.read(line)? {
            Held::Nothing => return Ok(None),
            Held::Bad(error) => Err(Unsolved::Bad(error)),
            Held::Reading => self.session.solve(&self.readings.reading().outputs).map_err(Unsolved::from),
        };
        let broken = &self.session.broken()[known..];
        Ok(Some(Answer { reading: self.readings.reading(), solved, broken }))
    }
}
