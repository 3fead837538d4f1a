//! Serial line of a printer: numbered commands, each sent until it was taken, and markers after which no late answer can come.
//!
//! A line is only repeated with its own number, so the printer takes it once (Marlin, `queue.cpp`). A printer that restarted counts lines
//! from 0 and refuses the next one, whether it announces its restart or not.

use super::report::{MarlinPosition, MarlinReport, parse_report};
use palpate_link::device::{DeviceError, DeviceProblem, MotionOrders};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, LineLink, WireError, silent};
use std::time::Duration;

/// Longest wait for an answer beyond the time that its command takes, with any answers meanwhile, and how much longer than a line
/// without an answer a `busy` makes it wait. Marlin sends one every two seconds.
const ANSWER_DEADLINE: Duration = Duration::from_secs(4);
const BUSY: Duration = Duration::from_millis(2500);

/// Number of the first line. A printer that restarted expects line 1, which is never the next one.
const NUMBER_FIRST: u64 = 1000;

/// Number of times that a line is sent before the driver gives up.
const SENDS_MAX: usize = 4;

/// Time after the port was opened in which a board announces its start, and the longest wait for the end of what it then sends.
const BOOT: Duration = Duration::from_secs(5);
const BOOT_MAX: Duration = Duration::from_secs(20);

/// Silence after which a board that starts has nothing more to send, and after which a line has no late answer.
const STARTED: Duration = Duration::from_millis(500);
const QUIET: Duration = Duration::from_millis(50);

/// Time after which a line without an answer is sent again: as long as its command may take, and this. A run allows a silence of half a second.
const AGAIN_AFTER: Duration = Duration::from_millis(150);

const LINE_MAX_BYTES: usize = 512;

/// Largest number of lines that are read of a board that starts.
const LINES_MAX: usize = 512;

/// Parts of texts without which a motion would have been made.
const HINDRANCES: [&str; 3] = ["endstops hit", " First", "Printer stopped"];

/// Largest number of stored error messages, and of stored texts.
const COMPLAINTS_MAX: usize = 16;
const TEXTS_MAX: usize = 256;

/// Answer to a numbered line.
enum Answer {
    /// `ok`.
    Ok,
    /// The printer has it already, and asks for the next one.
    Taken,
    /// The printer asks for it again.
    Again,
    /// The printer restarted.
    Restarted,
    /// Nothing.
    None,
}

/// The printer's serial line.
pub(super) struct MarlinPort {
    lines: LineLink,
    link: String,
    /// Number of the last line that was sent, and of the last one that was taken.
    number: u64,
    taken: u64,
    /// Whether the printer doesn't know the numbers yet.
    is_new: bool,
    /// Whether an answer may still come to a line that was sent before.
    in_doubt: bool,
    /// Whether an exchange was begun, which may have been given up since.
    is_begun: bool,
    /// Number of the last marker.
    marker: u64,
    pub complaints: Vec<String>,
    /// Received text that is not a report.
    pub texts: Vec<String>,
    position: Option<MarlinPosition>,
    /// Whether the last line was an error.
    is_after_error: bool,
    /// How often the printer restarted, and whether it lost its position by that.
    pub restarts: u64,
    pub is_lost: bool,
}

impl MarlinPort {
    pub(super) fn new(connector: Connector, link: String) -> Self {
        let lines = LineLink::new(connector, "\n", LINE_MAX_BYTES);
        MarlinPort {
            lines,
            link,
            number: NUMBER_FIRST,
            taken: NUMBER_FIRST,
            is_new: true,
            in_doubt: true,
            is_begun: false,
            marker: 0,
            complaints: Vec::new(),
            texts: Vec::new(),
            position: None,
            is_after_error: false,
            restarts: 0,
            is_lost: false,
        }
    }

    /// Opens the port if it is closed. Opening resets most boards: their position is then lost.
    pub(super) async fn wake(&mut self, doing: &str) -> Result<(), DeviceError> {
        let opened = self.lines.open().await;
        if !opened.map_err(|error| self.failed(doing, &error))? {
            return Ok(());
        }
        // the position isn't known, whether the board announces its start or not
        self.restarted();
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

    /// Sends a command that takes so long, and waits until it is taken. What comes before that is stored in the port's fields.
    ///
    /// If the line was damaged, or its answer was, the same line is sent again with its number. A stop ends the attempts.
    ///
    /// # Errors
    /// The printer restarted, stated once, or it doesn't answer.
    pub(super) async fn command_of(
        &mut self,
        doing: &str,
        command: &str,
        takes: Duration,
        orders: Option<&MotionOrders>,
    ) -> Result<(), DeviceError> {
        self.get_ready(doing).await?;
        self.number += 1;
        let taken = self.send_until_taken(doing, command, takes, orders).await;
        self.is_begun = false;
        taken
    }

    /// Sends two commands that move nothing, both at once; the first takes so long. The printer doesn't take the second after it refused the
    /// first. If anything is wrong, each is sent again with its number.
    pub(super) async fn both(&mut self, doing: &str, commands: [&str; 2], takes: Duration) -> Result<(), DeviceError> {
        self.get_ready(doing).await?;
        let taken = self.take_both(doing, commands, takes).await;
        self.is_begun = false;
        taken
    }

    async fn take_both(&mut self, doing: &str, commands: [&str; 2], takes: Duration) -> Result<(), DeviceError> {
        let numbers = self.number + 1..;
        for command in commands {
            self.number += 1;
            self.send_numbered(doing, command).await?;
        }
        let (last, until) = (self.number, Instant::now() + takes + ANSWER_DEADLINE);
        let mut takes = takes;
        for (number, command) in numbers.zip(commands) {
            let takes = std::mem::take(&mut takes); // the first
            let answer = match self.in_doubt {
                true => Answer::Again,
                false => self.answer(doing, Instant::now() + takes + AGAIN_AFTER, until).await?,
            };
            match answer {
                Answer::Ok if number == last => self.taken = last,
                Answer::Ok => {}
                Answer::Restarted => return Err(self.lost(doing)),
                Answer::None if Instant::now() >= until => {
                    self.in_doubt = true;
                    return Err(self.unanswered(doing, command, takes));
                }
                Answer::Taken | Answer::Again | Answer::None => {
                    self.drain(doing).await?;
                    self.number = number;
                    self.send_until_taken(doing, command, takes, None).await?;
                    self.in_doubt = true; // later answers may be those of the first attempt
                }
            }
        }
        self.number = last;
        Ok(())
    }

    async fn get_ready(&mut self, doing: &str) -> Result<(), DeviceError> {
        let restarts = self.restarts;
        self.wake(doing).await?;
        if self.restarts > restarts {
            return Err(self.lost(doing));
        }
        self.in_doubt |= std::mem::replace(&mut self.is_begun, true);
        self.get_in_step(doing).await
    }

    /// Sends the line with the last number.
    async fn send_until_taken(
        &mut self,
        doing: &str,
        command: &str,
        takes: Duration,
        orders: Option<&MotionOrders>,
    ) -> Result<(), DeviceError> {
        let until = Instant::now() + takes + ANSWER_DEADLINE;
        for send in 0..SENDS_MAX {
            if send > 0 && orders.is_some_and(MotionOrders::stopped) {
                return Ok(()); // what the read-back shows counts
            }
            self.send_numbered(doing, command).await?;
            let answer = self.answer(doing, until.min(Instant::now() + takes + AGAIN_AFTER), until).await?;
            self.in_doubt |= matches!(answer, Answer::None);
            match answer {
                Answer::Ok | Answer::Taken => {
                    self.taken = self.number;
                    return Ok(());
                }
                Answer::Restarted => return Err(self.lost(doing)),
                Answer::None if Instant::now() >= until => break,
                Answer::Again | Answer::None => {}
            }
        }
        Err(self.unanswered(doing, command, takes))
    }

    /// The error of a command that takes so long and wasn't answered.
    fn unanswered(&self, doing: &str, command: &str, takes: Duration) -> DeviceError {
        self.error(doing, DeviceProblem::Link(silent(command, takes + ANSWER_DEADLINE).to_string()))
    }

    /// Ends all motions. Without a number the line acts when it is received, before all lines that wait (Marlin, `queue.cpp`, or `e_parser.h`
    /// in a board that has it), and the count stays right but for what the motors overshoot.
    pub(super) async fn quick_stop(&mut self, doing: &str) -> Result<(), DeviceError> {
        self.in_doubt = true; // its answers come beside those to what was sent before
        self.lines.send(b"M410\n", ANSWER_DEADLINE).await.map_err(|error| self.failed(doing, &error))
    }

    async fn send_numbered(&mut self, doing: &str, command: &str) -> Result<(), DeviceError> {
        let text = format!("N{} {command}", self.number);
        let line = format!("{text}*{}\n", text.bytes().fold(0, |sum, byte| sum ^ byte));
        self.lines.send(line.as_bytes(), ANSWER_DEADLINE).await.map_err(|error| self.failed(doing, &error))
    }

    /// Waits for the answer to the line that was sent last. What the printer sends meanwhile makes it wait longer, but not beyond `until`.
    async fn answer(&mut self, doing: &str, first: Instant, until: Instant) -> Result<Answer, DeviceError> {
        let (restarts, mut patience) = (self.restarts, first);
        while let Some(report) = self.next(doing, patience.min(until)).await? {
            let more = if report == MarlinReport::Busy { BUSY } else { AGAIN_AFTER };
            patience = patience.max(Instant::now() + more);
            match report {
                MarlinReport::Ok => return Ok(Answer::Ok),
                MarlinReport::Resend(wanted) => {
                    self.keep(report);
                    // each request for a line ends with an `ok` of its own (queue.cpp, `flush_and_request_resend`)
                    self.in_doubt = self.next(doing, Instant::now() + QUIET).await? != Some(MarlinReport::Ok);
                    return Ok(match wanted {
                        wanted if wanted <= self.taken => {
                            self.restarted();
                            Answer::Restarted
                        }
                        wanted if wanted > self.number => Answer::Taken,
                        _ => Answer::Again,
                    });
                }
                report => self.keep(report),
            }
            if self.restarts > restarts {
                return Ok(Answer::Restarted);
            }
        }
        Ok(Answer::None)
    }

    /// Reads what has come in. If an answer may be late, waits for the echo of a marker: every answer to an earlier line comes before it. A
    /// motion under way is waited for.
    ///
    /// # Errors
    /// The printer restarted meanwhile, stated once.
    async fn get_in_step(&mut self, doing: &str) -> Result<(), DeviceError> {
        let restarts = self.restarts;
        while let Some(report) = self.next(doing, Instant::now()).await? {
            self.in_doubt |= report == MarlinReport::Ok; // an answer too many
            self.keep(report);
        }
        for _ in 0..SENDS_MAX {
            if self.restarts > restarts {
                return Err(self.lost(doing));
            }
            if !self.in_doubt {
                return Ok(());
            }
            self.drain(doing).await?;
            if self.is_new {
                // the line's own number isn't checked, and is the number of the last line from then on
                self.number += 1;
                self.send_numbered(doing, &format!("M110 N{}", self.number)).await?;
            }
            self.marker += 1;
            self.number += 1;
            let marker = format!("palpate{}", self.marker);
            self.send_numbered(doing, &format!("M118 {marker}")).await?;
            if self.is_echoed(doing, &marker).await? {
                (self.taken, self.is_new) = (self.number, false);
                let until = Instant::now() + AGAIN_AFTER;
                self.in_doubt = !matches!(self.answer(doing, until, until).await?, Answer::Ok);
            } else {
                self.is_new = true; // which numbers the printer knows is in doubt too
            }
        }
        match self.in_doubt {
            false => Ok(()),
            true => Err(self.unanswered(doing, "M118", Duration::ZERO)),
        }
    }

    async fn is_echoed(&mut self, doing: &str, marker: &str) -> Result<bool, DeviceError> {
        let until = Instant::now() + ANSWER_DEADLINE;
        while let Some(report) = self.next(doing, until).await? {
            match report {
                MarlinReport::Text(text) if text.contains(marker) => return Ok(true),
                MarlinReport::Resend(wanted) => {
                    if wanted <= self.taken && !self.is_new {
                        self.restarted();
                    }
                    self.keep(report);
                    return Ok(false);
                }
                report => self.keep(report),
            }
        }
        Ok(false)
    }

    /// Reads what comes until the line is quiet, for a second at most.
    async fn drain(&mut self, doing: &str) -> Result<(), DeviceError> {
        let until = Instant::now() + 10 * QUIET;
        while let Some(report) = self.next(doing, until.min(Instant::now() + QUIET)).await? {
            self.keep(report);
        }
        Ok(())
    }

    /// Asks for the position, again if its answer is damaged or lost.
    pub(super) async fn position(&mut self, doing: &str) -> Result<MarlinPosition, DeviceError> {
        self.position = None;
        for _ in 0..SENDS_MAX {
            self.texts.clear();
            self.command(doing, "M114").await?;
            if let Some(position) = self.position {
                return Ok(position);
            }
            self.in_doubt = true;
        }
        let expected = "X, Y, Z and their counted steps, as in `X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0`";
        let problem = DeviceProblem::Misfit { answer: self.texts.join(" "), expected: expected.to_owned() };
        Err(self.error(doing, problem))
    }

    /// Returns the position that was reported since the last call, if one was.
    pub(super) fn take_position(&mut self) -> Option<MarlinPosition> {
        self.position.take()
    }

    fn restarted(&mut self) {
        self.restarts += 1;
        (self.is_lost, self.is_new, self.in_doubt) = (true, true, true);
    }

    /// Returns the error for a place that is lost.
    pub(super) fn lost(&self, doing: &str) -> DeviceError {
        self.error(doing, DeviceProblem::Motion("it restarted and lost its position".to_owned()))
    }

    pub(super) fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError { device: format!("stage (Marlin at {})", self.link), doing: doing.to_owned(), problem }
    }

    async fn next(&mut self, doing: &str, until: Instant) -> Result<Option<MarlinReport>, DeviceError> {
        while let Some(line) = self.lines.next_by(until).await.map_err(|error| self.failed(doing, &error))? {
            // some firmware reports a position on the line of its `ok`
            if let Some(MarlinReport::Position(position)) = line.strip_prefix("ok ").and_then(parse_report) {
                self.position = Some(position);
            }
            if let Some(report) = parse_report(&line) {
                return Ok(Some(report));
            }
        }
        Ok(None)
    }

    fn keep(&mut self, report: MarlinReport) {
        let is_after_error = std::mem::replace(&mut self.is_after_error, matches!(report, MarlinReport::Error(_)));
        let (list, text, most) = match report {
            MarlinReport::Start if self.is_new => return, // the same restart
            MarlinReport::Start => return self.restarted(),
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
