//! Serial line of a printer: numbered commands, and markers after which no late answer can come.

use super::report::{MarlinPosition, MarlinReport, parse_report};
use palpate_link::device::{DeviceError, DeviceProblem, MotionOrders};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, LineLink, WireError, silent};
use std::time::Duration;

/// Longest wait for an answer to a marker, and how much longer a `busy` makes it. Marlin sends one every two seconds.
const ANSWER_DEADLINE: Duration = Duration::from_secs(4);
const BUSY: Duration = Duration::from_millis(2500);

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

/// Parts of texts without which a motion would have been made.
const HINDRANCES: [&str; 3] = ["endstops hit", " First", "Printer stopped"];

/// Largest number of stored error messages, and of stored texts.
const COMPLAINTS_MAX: usize = 16;
const TEXTS_MAX: usize = 256;

/// The printer's serial line.
pub(super) struct MarlinPort {
    lines: LineLink,
    link: String,
    /// Number of the last line that was sent.
    number: u64,
    /// Whether an answer may still come to a line that was sent before.
    in_doubt: bool,
    /// Number of the last marker.
    marker: u64,
    pub complaints: Vec<String>,
    /// Received text that is not a report.
    pub texts: Vec<String>,
    position: Option<MarlinPosition>,
    /// Whether the last line was an error.
    is_after_error: bool,
    /// Whether the printer restarted and lost its position.
    pub restarted: bool,
}

impl MarlinPort {
    pub(super) fn new(connector: Connector, link: String) -> Self {
        let lines = LineLink::new(connector, "\n", LINE_MAX_BYTES);
        MarlinPort {
            lines,
            link,
            number: 0,
            in_doubt: true,
            marker: 0,
            complaints: Vec::new(),
            texts: Vec::new(),
            position: None,
            is_after_error: false,
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
        self.in_doubt = true;
        Ok(())
    }

    /// Sends a command that takes no time, and waits until it is accepted.
    pub(super) async fn command(&mut self, doing: &str, command: &str) -> Result<(), DeviceError> {
        self.command_of(doing, command, Duration::ZERO, None).await
    }

    /// Sends a command that takes so long, and waits until it is accepted. What comes before that is stored in the port's fields.
    ///
    /// If the line was damaged, or its answer was, the port gets in step with the printer and sends the command again. A motion is to an
    /// absolute place, so that it makes no difference if it was accepted before. A stop ends the attempts.
    pub(super) async fn command_of(
        &mut self,
        doing: &str,
        command: &str,
        takes: Duration,
        orders: Option<&MotionOrders>,
    ) -> Result<(), DeviceError> {
        self.wake(doing).await?;
        for send in 0..SENDS_MAX {
            if send > 0 && orders.is_some_and(MotionOrders::stopped) {
                return Ok(()); // what the read-back shows counts
            }
            if self.in_doubt {
                self.get_in_step(doing).await?;
            }
            self.check_restart(doing)?;
            self.send(doing, command).await?;
            if self.is_accepted(doing, takes + AGAIN_AFTER).await? {
                self.in_doubt = false;
                return self.check_restart(doing);
            }
        }
        Err(self.error(doing, DeviceProblem::Link(silent(command, takes + AGAIN_AFTER).to_string())))
    }

    /// Sends a line with the next number. Its answer is in doubt until it has come.
    async fn send(&mut self, doing: &str, command: &str) -> Result<(), DeviceError> {
        self.in_doubt = true;
        self.number += 1;
        self.send_numbered(doing, command).await
    }

    async fn send_numbered(&mut self, doing: &str, command: &str) -> Result<(), DeviceError> {
        let text = format!("N{} {command}", self.number);
        let line = format!("{text}*{}\n", text.bytes().fold(0, |sum, byte| sum ^ byte));
        self.lines.send(line.as_bytes(), ANSWER_DEADLINE).await.map_err(|error| self.failed(doing, &error))
    }

    /// Whether the line that was sent last is accepted. It isn't if the printer asks for a line again, or is silent for `wait`.
    async fn is_accepted(&mut self, doing: &str, wait: Duration) -> Result<bool, DeviceError> {
        let mut until = Instant::now() + wait;
        for _ in 0..LINES_MAX {
            match self.next(doing, until).await? {
                Some(MarlinReport::Ok) => return Ok(true),
                None => return Ok(false),
                Some(report @ MarlinReport::Resend(_)) => {
                    self.keep(report);
                    return Ok(false);
                }
                Some(report) => {
                    self.keep(report);
                    until = until.max(Instant::now() + AGAIN_AFTER); // it is sending
                    if self.restarted {
                        return Ok(true); // the caller reports it
                    }
                }
            }
        }
        Ok(false)
    }

    /// Sets the number of the next line, and waits for the echo of a marker: every answer to an earlier line comes before it. A motion
    /// under way is waited for.
    async fn get_in_step(&mut self, doing: &str) -> Result<(), DeviceError> {
        for _ in 0..SENDS_MAX {
            self.drain(doing).await?;
            if self.restarted {
                return Ok(());
            }
            // the number of the line itself is 0
            self.number = 0;
            self.send_numbered(doing, "M110 N0").await?;
            self.marker += 1;
            let marker = format!("palpate{}", self.marker);
            self.send(doing, &format!("M118 {marker}")).await?;
            if self.is_echoed(doing, &marker).await? && self.is_accepted(doing, AGAIN_AFTER).await? {
                self.in_doubt = false;
                return Ok(());
            }
        }
        Err(self.error(doing, DeviceProblem::Link(silent("M118", ANSWER_DEADLINE).to_string())))
    }

    async fn is_echoed(&mut self, doing: &str, marker: &str) -> Result<bool, DeviceError> {
        let mut until = Instant::now() + ANSWER_DEADLINE;
        for _ in 0..LINES_MAX {
            match self.next(doing, until).await? {
                Some(MarlinReport::Text(text)) if text.contains(marker) => return Ok(true),
                Some(MarlinReport::Busy) => until = until.max(Instant::now() + BUSY),
                None => return Ok(false),
                Some(report) => {
                    let is_refused = matches!(report, MarlinReport::Resend(_));
                    self.keep(report);
                    if is_refused {
                        return Ok(false);
                    }
                }
            }
        }
        Ok(false)
    }

    /// Reads what comes until the line is quiet.
    async fn drain(&mut self, doing: &str) -> Result<(), DeviceError> {
        for _ in 0..LINES_MAX {
            match self.next(doing, Instant::now() + QUIET).await? {
                Some(report) => self.keep(report),
                None => break,
            }
        }
        Ok(())
    }

    /// Sends a command for a position, and returns the position that was reported before it was accepted.
    pub(super) async fn position(&mut self, doing: &str) -> Result<MarlinPosition, DeviceError> {
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

    async fn next(&mut self, doing: &str, until: Instant) -> Result<Option<MarlinReport>, DeviceError> {
        for _ in 0..LINES_MAX {
            match self.lines.next_by(until).await.map_err(|error| self.failed(doing, &error))? {
                None => return Ok(None),
                Some(line) => {
                    // some firmware reports a position on the line of its `ok`
                    if let Some(MarlinReport::Position(position)) = line.strip_prefix("ok ").and_then(parse_report) {
                        self.position = Some(position);
                    }
                    if let Some(report) = parse_report(&line) {
                        return Ok(Some(report));
                    }
                }
            }
        }
        Ok(None)
    }

    fn keep(&mut self, report: MarlinReport) {
        let is_after_error = std::mem::replace(&mut self.is_after_error, matches!(report, MarlinReport::Error(_)));
        let (list, text, most) = match report {
            MarlinReport::Start => return self.restarted = true,
            MarlinReport::Position(position) => return self.position = Some(position),
            // it is about a line, which is sent again
            MarlinReport::Error(text) if text.contains("Last Line") => return self.is_after_error = false,
            MarlinReport::Resend(_) => {
                // the error before it said why the line is asked for again
                if is_after_error {
                    self.complaints.pop();
                }
                return;
            }
            MarlinReport::Error(text) => (&mut self.complaints, text, COMPLAINTS_MAX),
            MarlinReport::Text(text) if HINDRANCES.iter().any(|hindrance| text.contains(hindrance)) => {
                (&mut self.complaints, text, COMPLAINTS_MAX)
            }
            MarlinReport::Text(text) => (&mut self.texts, text, TEXTS_MAX),
            MarlinReport::Ok | MarlinReport::Busy => return,
        };
        if list.len() < most {
            list.push(text);
        }
    }

    fn failed(&self, doing: &str, error: &WireError) -> DeviceError {
        self.error(doing, DeviceProblem::Link(error.to_string()))
    }
}
