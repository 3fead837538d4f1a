//! Serial line of a printer: numbered commands, each accepted once.

use super::report::{MarlinReport, Position, parse_report};
use palpate_link::device::{DeviceError, DeviceProblem};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, LineLink, WireError, silent};
use std::time::Duration;

/// Longest wait for an answer to a line that was sent again.
const ANSWER_DEADLINE: Duration = Duration::from_secs(4);

/// Number of times that a line is sent before the driver gives up.
const SENDS_MAX: usize = 4;

/// Time after the port was opened in which a board announces its start, and the longest wait for the end of what it then sends.
const BOOT: Duration = Duration::from_secs(5);
const BOOT_MAX: Duration = Duration::from_secs(20);

/// Silence after which a board that starts has nothing more to send, and after which a line has no late answer.
const STARTED: Duration = Duration::from_millis(500);
const QUIET: Duration = Duration::from_millis(100);

/// Time after which a line without an answer is sent again: as long as its command may take, and this. A run allows a silence of half a second.
const AGAIN_AFTER: Duration = Duration::from_millis(250);

const LINE_MAX_BYTES: usize = 512;

/// Largest number of lines that are read for one command. `M503` has some 40, and a late command some `busy`.
const LINES_MAX: usize = 512;

/// Largest number of stored error messages, and of stored texts.
const COMPLAINTS_MAX: usize = 16;
const TEXTS_MAX: usize = 256;

/// The printer's serial line.
pub(super) struct MarlinPort {
    lines: LineLink,
    link: String,
    /// Number of the last line that was accepted.
    number: u64,
    pub complaints: Vec<String>,
    /// Received text that is no report.
    pub texts: Vec<String>,
    position: Option<Position>,
    /// Whether the printer restarted and lost its position.
    pub restarted: bool,
}

/// End of one attempt to send a line.
enum Attempt {
    Accepted,
    Again,
    Silent,
}

impl MarlinPort {
    pub(super) fn new(connector: Connector, link: String) -> Self {
        let lines = LineLink::new(connector, "\n", LINE_MAX_BYTES);
        MarlinPort {
            lines,
            link,
            number: 0,
            complaints: Vec::new(),
            texts: Vec::new(),
            position: None,
            restarted: false,
        }
    }

    /// Opens the port if it is closed. Opening resets most boards: their position is then lost.
    pub(super) async fn wake(&mut self, doing: &str) -> Result<(), DeviceError> {
        let opened = self.lines.open().await;
        if !opened.map_err(|error| self.failed(doing, &error))? {
            return Ok(());
        }
        // the position isn't known, whether the board announces its start or not
        self.restarted = true;
        let end = Instant::now() + BOOT_MAX;
        let mut until = Instant::now() + BOOT;
        for _ in 0..LINES_MAX {
            match self.next(doing, until.min(end)).await? {
                Some(report) => self.keep(report),
                None => break,
            }
            until = Instant::now() + STARTED;
        }
        self.number = 0;
        // the number of the line itself is 0
        self.exchange(doing, "M110 N0", 0, ANSWER_DEADLINE).await
    }

    /// Sends a command that takes no time, and waits until it is accepted. What comes before that is stored in the port's fields.
    ///
    /// A line that was damaged is sent again. If no answer comes, the same line with the same number is sent again: a printer that has
    /// accepted it asks for the next one, so that no motion is made twice.
    pub(super) async fn command(&mut self, doing: &str, command: &str) -> Result<(), DeviceError> {
        self.command_of(doing, command, Duration::ZERO).await
    }

    /// Sends a command that takes so long.
    pub(super) async fn command_of(&mut self, doing: &str, command: &str, takes: Duration) -> Result<(), DeviceError> {
        self.wake(doing).await?;
        self.check_restart(doing)?;
        self.exchange(doing, command, self.number + 1, takes + AGAIN_AFTER).await?;
        self.number += 1;
        self.check_restart(doing)
    }

    /// Sends a command for a position, and returns the position that was reported before it was accepted.
    pub(super) async fn position(&mut self, doing: &str) -> Result<Position, DeviceError> {
        self.position = None;
        self.command(doing, "M114").await?;
        self.position.ok_or_else(|| {
            let expected = "X, Y, Z and their counted steps, as in `X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0`";
            self.error(doing, DeviceProblem::Misfit { answer: self.texts.join(" "), expected: expected.to_owned() })
        })
    }

    pub(super) fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError { device: format!("stage (Marlin at {})", self.link), doing: doing.to_owned(), problem }
    }

    fn check_restart(&self, doing: &str) -> Result<(), DeviceError> {
        match self.restarted {
            true => Err(self.error(doing, DeviceProblem::Motion("it restarted and lost its position".to_owned()))),
            false => Ok(()),
        }
    }

    async fn exchange(
        &mut self,
        doing: &str,
        command: &str,
        number: u64,
        first_wait: Duration,
    ) -> Result<(), DeviceError> {
        let text = format!("N{number} {command}");
        let line = format!("{text}*{}\n", text.bytes().fold(0, |sum, byte| sum ^ byte));
        for send in 0..SENDS_MAX {
            let sent = self.lines.send(line.as_bytes(), ANSWER_DEADLINE).await;
            sent.map_err(|error| self.failed(doing, &error))?;
            let wait = if send == 0 { first_wait } else { ANSWER_DEADLINE };
            match self.attempt(doing, number, wait).await? {
                Attempt::Accepted if send > 0 => return self.drain(doing).await,
                Attempt::Accepted => return Ok(()),
                Attempt::Again | Attempt::Silent => {}
            }
        }
        Err(self.error(doing, DeviceProblem::Link(silent(&text, ANSWER_DEADLINE).to_string())))
    }

    /// Waits for late answers to a line that was sent more than once.
    async fn drain(&mut self, doing: &str) -> Result<(), DeviceError> {
        for _ in 0..LINES_MAX {
            match self.next(doing, Instant::now() + QUIET).await? {
                Some(report) => self.keep(report),
                None => break,
            }
        }
        Ok(())
    }

    async fn attempt(&mut self, doing: &str, number: u64, wait: Duration) -> Result<Attempt, DeviceError> {
        let mut until = Instant::now() + wait;
        let mut resend = None;
        for _ in 0..LINES_MAX {
            match self.next(doing, until).await? {
                // after a request to send again, an `ok` follows that belongs to no command
                Some(MarlinReport::Ok) => {
                    return Ok(match resend {
                        None => Attempt::Accepted,
                        Some(next) if next == number + 1 => Attempt::Accepted,
                        Some(_) => Attempt::Again,
                    });
                }
                Some(MarlinReport::Resend(next)) if next == number || next == number + 1 => resend = Some(next),
                Some(MarlinReport::Resend(next)) => {
                    let text = format!("it asks for line {next}, but line {number} was sent");
                    return Err(self.error(doing, DeviceProblem::Refused(text)));
                }
                Some(MarlinReport::Busy) => until = until.max(Instant::now() + AGAIN_AFTER),
                Some(report) => {
                    self.keep(report);
                    until = until.max(Instant::now() + AGAIN_AFTER); // it is sending
                    if self.restarted && number > 0 {
                        return Ok(Attempt::Accepted); // `command` reports the restart
                    }
                }
                None => return Ok(if resend.is_some() { Attempt::Again } else { Attempt::Silent }),
            }
        }
        Ok(Attempt::Silent)
    }

    async fn next(&mut self, doing: &str, until: Instant) -> Result<Option<MarlinReport>, DeviceError> {
        for _ in 0..LINES_MAX {
            match self.lines.next_by(until).await.map_err(|error| self.failed(doing, &error))? {
                None => return Ok(None),
                Some(line) => {
                    if let Some(report) = parse_report(&line) {
                        return Ok(Some(report));
                    }
                }
            }
        }
        Ok(None)
    }

    fn keep(&mut self, report: MarlinReport) {
        match report {
            MarlinReport::Start => self.restarted = true,
            // what Resend follows is no complaint
            MarlinReport::Error(text) if text.contains("Last Line") => {}
            MarlinReport::Error(text) if self.complaints.len() < COMPLAINTS_MAX => self.complaints.push(text),
            MarlinReport::Text(text) if self.texts.len() < TEXTS_MAX => self.texts.push(text),
            MarlinReport::Position(position) => self.position = Some(position),
            _ => {}
        }
    }

    fn failed(&self, doing: &str, error: &WireError) -> DeviceError {
        self.error(doing, DeviceProblem::Link(error.to_string()))
    }
}
