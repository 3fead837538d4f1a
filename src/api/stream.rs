//! Answers the lines of a stream until it ends: standard input of `solve`, or a connection of `serve`.

use super::Note;
use super::lines::AnswerWriter;
use palpate_data::dataset::answers::{Answers, LineAnswer, ReadingSolver, UnansweredLine};
use palpate_data::dataset::readings::{ReadingError, StreamLines};
use palpate_solver::FaultChange;
use std::collections::HashSet;
use std::io::{self, Read};

/// Largest number of different reasons for readings without an answer that are printed.
const REASONS_MAX: usize = 10;

/// How the lines of a stream are answered.
pub(crate) struct AnswerStream<'a> {
    /// Name of the stream in messages.
    pub source: &'a str,
    /// Whether an invalid line is answered with its problem. Otherwise it ends the stream.
    pub keep_going: bool,
    /// Whether each reason of a reading without an answer is printed once.
    pub with_reasons: bool,
    /// Receives what an answer has no column for.
    pub note: Note<'a>,
    /// Whether a line isn't for this program, so that the stream ends without an answer.
    pub is_refused: fn(&[u8]) -> bool,
}

impl AnswerStream<'_> {
    /// Writes an answer for each line. When it ends for any reason, all earlier answers are written.
    pub(crate) fn answer<S: ReadingSolver>(
        &self,
        answers: &mut Answers<S>,
        lines: &mut StreamLines<impl Read>,
        solutions: &mut impl AnswerWriter<S::Solution>,
    ) -> io::Result<Result<(), ReadingError>> {
        let (mut reasons, mut is_empty) = (HashSet::new(), true);
        let end = loop {
            let answer = match lines.read_next() {
                Ok(Some(line)) if (self.is_refused)(line) => break Ok(()),
                Ok(Some(line)) => answers.answer(line),
                Ok(None) => break Ok(()),
                Err(error) => break Err(error),
            };
            match answer {
                Ok(Some(LineAnswer { solved: Err(UnansweredLine::Bad(error)), .. })) if !self.keep_going => {
                    break Err(error);
                }
                Ok(Some(answer)) => {
                    is_empty = false;
                    solutions.write(answer.reading, &answer.at_fault, &answer.solved)?;
                    self.remark(&answer, &mut reasons);
                }
                Ok(None) => {}
                Err(error) => break Err(error),
            }
            if lines.is_drained() {
                solutions.flush()?;
            }
        };
        solutions.flush()?;
        for change in answers.finish() {
            (self.note)(&format!("{}: {}", self.source, said(change)));
        }
        if is_empty && end.is_ok() && self.with_reasons {
            (self.note)(&format!("{}: no reading", self.source));
        }
        Ok(end)
    }

    /// Notes what an answer has no column for.
    fn remark<T>(&self, answer: &LineAnswer<'_, T>, reasons: &mut HashSet<String>) {
        let note = |text: &str| (self.note)(&format!("{}, line {}: {text}", self.source, answer.reading.line));
        if let Err(why) = &answer.solved
            && self.with_reasons
            && reasons.len() < REASONS_MAX
            && reasons.insert(why.to_string())
        {
            note(&format!("unsolved, {why} (reported once)"));
        }
        for change in answer.changes {
            note(&said(change));
        }
        if answer.is_out_of_date {
            note(
                "too many of the last contacts don't fit the calibration; if each was at one place only, calibrate the sensor again",
            );
        }
    }
}

/// Describes a change of the units that are left out.
fn said(change: &FaultChange) -> String {
    match change {
        FaultChange::LeftOut(faulty) => format!("{}, left out from here on", faulty.text()),
        FaultChange::Back(unit) => format!("output {} agrees with the others again, used from here on", unit + 1),
        FaultChange::Unfit => {
            "an output is at fault, but the sensor file has no presses to leave it out: fit again".to_owned()
        }
    }
}
