//! Serial line: sends lines and receives reports.

use super::report::{GrblReport, GrblStatus, alarm_name, error_name, parse_report};
use palpate_link::device::{DeviceError, DeviceProblem, MotionOrders};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, LineLink, WireError, silent};
use std::collections::BTreeMap;
use std::time::Duration;

/// Longest wait for an answer. GRBL answers a line as soon as there is room for its motion, and a `?` within 20 ms.
pub(super) const ANSWER_DEADLINE: Duration = Duration::from_secs(1);

/// Number of times that a question without side effects is asked.
const QUESTION_TRIES: usize = 3;

/// Silence after which a line that lost synchronisation counts as quiet.
const QUIET: Duration = Duration::from_millis(100);

/// Silence after the port was opened during which nothing is asked. An Uno restarts then, and its bootloader takes 1.5 to 2 s.
const BOOT: Duration = Duration::from_millis(2500);

/// Longest wait for a board that restarts, and how often it is asked after [`BOOT`].
const START_MAX: Duration = Duration::from_secs(10);
const ASK_EVERY: Duration = Duration::from_secs(1);

/// Longest line (interface document: at most 80 characters).
const LINE_MAX_BYTES: usize = 256;

/// Largest number of lines that are read for one answer. The answer to `$$` has some 35.
const LINES_MAX: usize = 128;

/// Largest number of stored error messages.
const COMPLAINTS_MAX: usize = 16;

/// Request for a status. It acts at once and has no line end.
const STATUS: &[u8] = b"?";
/// Command that ends a jog.
pub(super) const JOG_CANCEL: &[u8] = &[0x85];
/// Command that lets a motion come to rest.
pub(super) const FEED_HOLD: &[u8] = b"!";
/// Command that resets the controller. During a motion the position is lost.
pub(super) const SOFT_RESET: &[u8] = &[0x18];

/// The controller's serial line.
pub(super) struct GrblPort {
    lines: LineLink,
    link: String,
    /// Whether the answer to a line may still come. The port waits for it before it sends the next line.
    out_of_step: bool,
    pub complaints: Vec<String>,
    /// Settings from the answer to `$$`.
    pub settings: BTreeMap<u32, f64>,
    /// Received text that is not a report.
    pub texts: Vec<String>,
    /// Whether the controller restarted and lost its position.
    pub restarted: bool,
}

impl GrblPort {
    pub(super) fn new(connector: Connector, link: String) -> Self {
        GrblPort {
            lines: LineLink::new(connector, "\n", LINE_MAX_BYTES),
            link,
            out_of_step: true,
            complaints: Vec::new(),
            settings: BTreeMap::new(),
            texts: Vec::new(),
            restarted: false,
        }
    }

    /// Opens the port if it is closed. Opening resets many boards, so nothing is sent before the board's welcome, or before the
    /// time in which a bootloader would wait. A board that isn't reset answers the question for its status.
    ///
    /// # Errors
    /// Errors of the link. A board that stays silent is no error here: the next question reports it.
    pub(super) async fn wake(&mut self, doing: &str) -> Result<(), DeviceError> {
        let opened = self.lines.open().await;
        if !opened.map_err(|error| self.failed(doing, &error))? {
            return Ok(());
        }
        let (end, mut ask_at) = (Instant::now() + START_MAX, Instant::now() + BOOT);
        while Instant::now() < end {
            match self.next(doing, ask_at, None).await? {
                Some(GrblReport::Welcome) => {
                    self.restarted = true;
                    return self.drain(doing, None).await;
                }
                Some(GrblReport::Status(_)) => return self.drain(doing, None).await,
                // Marlin, whose welcome is another
                Some(report @ GrblReport::Text(_)) => self.keep(report),
                Some(_) => {}
                None => {
                    self.send(doing, STATUS).await?;
                    ask_at = Instant::now() + ASK_EVERY;
                }
            }
        }
        Ok(())
    }

    /// Sends a line and waits for its `ok`. Input before the `ok` is stored in the port's fields.
    pub(super) async fn line(
        &mut self,
        doing: &str,
        line: &str,
        deadline: Duration,
        orders: Option<(&MotionOrders, &'static [u8])>,
    ) -> Result<(), DeviceError> {
        self.bring_back_in_step(doing, orders).await?;
        self.out_of_step = true;
        self.send(doing, format!("{line}\n").as_bytes()).await?;
        let until = Instant::now() + deadline;
        for _ in 0..LINES_MAX {
            match self.next(doing, until, orders).await? {
                Some(GrblReport::Ok) => {
                    self.out_of_step = false;
                    return Ok(());
                }
                Some(GrblReport::Refused(code)) => {
                    self.out_of_step = false;
                    let text = format!("error {code} ({}) to {line}", error_name(code));
                    return Err(self.error(doing, DeviceProblem::Refused(text)));
                }
                Some(GrblReport::Alarm(code)) => {
                    let text = format!("alarm {code} ({}) at {line}", alarm_name(code));
                    return Err(self.error(doing, DeviceProblem::Refused(text)));
                }
                Some(report) => self.keep(report),
                None => break,
            }
        }
        Err(self.error(doing, DeviceProblem::Link(silent(line, deadline).to_string())))
    }

    /// Reads what has come in, and returns whether the controller restarted since this was asked last.
    pub(super) async fn has_restarted(&mut self, doing: &str, orders: &MotionOrders) -> Result<bool, DeviceError> {
        if self.lines.something_came().await {
            self.drain(doing, Some((orders, JOG_CANCEL))).await?;
        }
        Ok(std::mem::take(&mut self.restarted))
    }

    /// Requests a status.
    pub(super) async fn status(
        &mut self,
        doing: &str,
        orders: (&MotionOrders, &'static [u8]),
    ) -> Result<GrblStatus, DeviceError> {
        self.wake(doing).await?;
        for _ in 0..QUESTION_TRIES {
            // an unrequested status may be old
            if self.lines.something_came().await {
                self.drain(doing, Some(orders)).await?;
            }
            self.send(doing, STATUS).await?;
            let until = Instant::now() + ANSWER_DEADLINE;
            for _ in 0..LINES_MAX {
                match self.next(doing, until, Some(orders)).await? {
                    Some(GrblReport::Status(status)) => return Ok(status),
                    Some(report) => self.keep(report),
                    None => break,
                }
            }
        }
        Err(self.error(doing, DeviceProblem::Link(silent("?", ANSWER_DEADLINE).to_string())))
    }

    /// Sends bytes that act at once, in step or not.
    pub(super) async fn send(&mut self, doing: &str, bytes: &[u8]) -> Result<(), DeviceError> {
        let sent = self.lines.send(bytes, ANSWER_DEADLINE).await;
        sent.map_err(|error| self.failed(doing, &error))
    }

    /// Resets the controller. What it sends then is read before the next line.
    pub(super) async fn reset(&mut self, doing: &str) -> Result<(), DeviceError> {
        self.out_of_step = true;
        self.send(doing, SOFT_RESET).await
    }

    pub(super) fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError { device: format!("stage (GRBL at {})", self.link), doing: doing.to_owned(), problem }
    }

    /// Returns the next complete report before the deadline. Damaged lines are ignored. Orders are sent at once.
    async fn next(
        &mut self,
        doing: &str,
        until: Instant,
        orders: Option<(&MotionOrders, &'static [u8])>,
    ) -> Result<Option<GrblReport>, DeviceError> {
        for _ in 0..LINES_MAX {
            let line = match orders {
                None => self.lines.next_by(until).await,
                Some((orders, stop)) => {
                    tokio::select! {
                        biased;
                        () = orders.pulled().notified() => {
                            // the follower of the motion sends another speed
                            if orders.stopped() && orders.take().is_some() {
                                self.send(doing, stop).await?;
                            }
                            continue;
                        }
                        line = self.lines.next_by(until) => line,
                    }
                }
            };
            match line.map_err(|error| self.failed(doing, &error))? {
                Some(line) if line.is_empty() => {}
                Some(line) => match parse_report(&line) {
                    Some(report) => return Ok(Some(report)),
                    None => self.out_of_step = true,
                },
                None => return Ok(None),
            }
        }
        Ok(None)
    }

    fn keep(&mut self, report: GrblReport) {
        match report {
            GrblReport::Setting(number, value) => {
                self.settings.insert(number, value);
            }
            GrblReport::Text(text) if self.texts.len() < LINES_MAX => self.texts.push(text),
            GrblReport::Welcome => self.restarted = true,
            GrblReport::Alarm(code) => self.complain(format!("alarm {code}, {}", alarm_name(code))),
            GrblReport::Refused(code) => self.complain(format!("error {code}, {}", error_name(code))),
            GrblReport::Ok | GrblReport::Status(_) | GrblReport::Text(_) => {}
        }
    }

    fn complain(&mut self, text: String) {
        if self.complaints.len() < COMPLAINTS_MAX {
            self.complaints.push(text);
        }
    }

    /// Waits until no late `ok` can come that looks like the answer to the next line.
    pub(super) async fn bring_back_in_step(
        &mut self,
        doing: &str,
        orders: Option<(&MotionOrders, &'static [u8])>,
    ) -> Result<(), DeviceError> {
        self.wake(doing).await?;
        if self.out_of_step || self.lines.something_came().await {
            self.drain(doing, orders).await?;
            self.out_of_step = false;
        }
        Ok(())
    }

    async fn drain(&mut self, doing: &str, orders: Option<(&MotionOrders, &'static [u8])>) -> Result<(), DeviceError> {
        for _ in 0..LINES_MAX {
            match self.next(doing, Instant::now() + QUIET, orders).await? {
                Some(report) => self.keep(report),
                None => break,
            }
        }
        self.lines.forget();
        Ok(())
    }

    fn failed(&mut self, doing: &str, error: &WireError) -> DeviceError {
        self.out_of_step = true;
        self.error(doing, DeviceProblem::Link(error.to_string()))
    }
}
