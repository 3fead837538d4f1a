//! Newport ESP301 (and ESP300): three axes behind one ASCII line.
//!
//! Commands and answers after the ESP300 manual (pages named at each) and a recording of a real ESP301. Set commands are
//! silent, so what became of one is read from `MD?`, the read-back and the error queue.

use crate::device::{DeviceError, Identity, Problem, Stage, StageUse};
use crate::quantity::Axis;
use crate::wire::{Connector, LineExchange, Stop, WireError};
use std::time::Duration;
use tokio::sync::Notify;
use tokio::time::{Instant, sleep};

/// Longest wait for an answer. The controller can be silent for 2 to 5 s after it hit a travel limit.
const ANSWER_DEADLINE: Duration = Duration::from_secs(6);

/// How much longer than expected a motion may take.
const MOTION_MARGIN: Duration = Duration::from_secs(10);

/// Longest search for home: 25 mm at a home speed of 1 mm/s, twice, and a margin.
const HOME_DEADLINE: Duration = Duration::from_secs(90);

/// How often a question is asked whose answer makes no sense.
const QUESTION_TRIES: usize = 2;

/// The error queue holds ten; one more says that it is empty (manual, page TB).
const COMPLAINTS_MAX: usize = 11;

/// Code of millimetres (manual, page SN). The setting is a label: it is checked and never written.
const MILLIMETRES: f64 = 2.0;

/// Stop all axes (manual, page ST). It has no answer.
const STOP_ALL: &str = "ST";

/// Oldest firmware without known faults of its USB link (firmware history).
const FIRMWARE_SOUND: [u32; 3] = [1, 1, 1];

/// An ESP301 on a serial line.
pub struct Esp301 {
    line: LineExchange,
    link: String,
}

impl Esp301 {
    /// A controller behind a link; nothing is sent yet. `link` is its name in messages.
    pub fn new(connector: Connector, link: String) -> Self {
        Esp301 { line: LineExchange::new(connector, ANSWER_DEADLINE, "VE?", "ESP30"), link }
    }

    async fn tell(&mut self, doing: &str, line: &str) -> Result<(), DeviceError> {
        self.line.tell(line).await.map_err(|error| self.failed(doing, &error))
    }

    async fn ask(&mut self, doing: &str, question: &str) -> Result<String, DeviceError> {
        self.line.ask(question, None).await.map_err(|error| self.failed(doing, &error))
    }

    async fn ask_number(&mut self, doing: &str, question: &str, stop: Option<&Notify>) -> Result<f64, DeviceError> {
        let mut answer = String::new();
        for _ in 0..QUESTION_TRIES {
            let stop = stop.map(|asked| Stop { asked, line: STOP_ALL });
            answer = self.line.ask(question, stop.as_ref()).await.map_err(|error| self.failed(doing, &error))?;
            match answer.parse::<f64>() {
                Ok(number) if number.is_finite() => return Ok(number),
                _ => self.line.misfit(),
            }
        }
        let expected = format!("a number to {question}");
        Err(self.error(doing, Problem::Misfit { answer, expected }))
    }

    async fn check_axis(&mut self, axis: Axis, usage: &StageUse) -> Result<(), DeviceError> {
        let (doing, n) = ("checking an axis against the rig", number(axis));
        let units = self.ask_number(doing, &format!("{n}SN?"), None).await?;
        if units != MILLIMETRES {
            let told = format!("axis {n} counts in unit {units}, not in mm (2); set it on the controller, not here");
            return Err(self.error(doing, Problem::Mismatch(told)));
        }
        let fastest = self.ask_number(doing, &format!("{n}VU?"), None).await?;
        if fastest < usage.speed_mm_s {
            let told =
                format!("axis {n} goes at most {fastest} mm/s, under the rig's speed_mm_s of {}", usage.speed_mm_s);
            return Err(self.error(doing, Problem::Mismatch(told)));
        }
        Ok(())
    }

    /// An axis whose motor is on was homed when it was switched on: power-up leaves the motor off (manual, page MO).
    async fn home(&mut self, axis: Axis, mode: u8) -> Result<(), DeviceError> {
        let (doing, n) = ("homing", number(axis));
        if self.ask_number(doing, &format!("{n}MO?"), None).await? == 1.0 {
            return Ok(());
        }
        self.tell(doing, &format!("{n}MO")).await?;
        self.tell(doing, &format!("{n}OR{mode}")).await?;
        let until = Instant::now() + HOME_DEADLINE;
        while self.ask_number(doing, &format!("{n}MD?"), None).await? != 1.0 {
            if Instant::now() > until {
                self.line.tell_now(STOP_ALL).await.map_err(|error| self.failed(doing, &error))?;
                let told = format!("axis {n} didn't find its home within {} s", HOME_DEADLINE.as_secs());
                return Err(self.error(doing, Problem::Motion(told)));
            }
        }
        Ok(())
    }

    async fn set_up(&mut self, axis: Axis, usage: &StageUse) -> Result<(), DeviceError> {
        let (n, travel, a) = (number(axis), usage.travel.along(axis), usage.acceleration_mm_s2);
        let line = format!("{n}SL{:.4};{n}SR{:.4};{n}AC{a};{n}AG{a}", travel.min, travel.max);
        self.tell("setting soft limits and acceleration", &line).await
    }

    fn failed(&self, doing: &str, error: &WireError) -> DeviceError {
        self.error(doing, Problem::Link(error.to_string()))
    }

    fn error(&self, doing: &str, problem: Problem) -> DeviceError {
        DeviceError { device: format!("stage (ESP301 at {})", self.link), doing: doing.to_owned(), problem }
    }
}

impl Stage for Esp301 {
    async fn prepare(&mut self, usage: &StageUse) -> Result<Identity, DeviceError> {
        let doing = "identifying it";
        let version = self.ask(doing, "VE?").await?;
        if !version.contains("ESP30") {
            let expected = "an ESP300 or ESP301 version".to_owned();
            return Err(self.error(doing, Problem::Misfit { answer: version, expected }));
        }
        self.complaints().await?; // of what happened before us
        let mut stages = Vec::new();
        for axis in Axis::ALL {
            stages.push(self.ask(doing, &format!("{}ID?", number(axis))).await?);
            self.check_axis(axis, usage).await?;
        }
        // z first, toward the limit that lies away from the specimen (mode 3: + limit, 4: - limit; manual, page OR)
        self.home(Axis::Z, if usage.away > 0.0 { 3 } else { 4 }).await?;
        self.home(Axis::X, 1).await?;
        self.home(Axis::Y, 1).await?;
        for axis in Axis::ALL {
            self.set_up(axis, usage).await?;
        }
        let complaints = self.complaints().await?;
        if !complaints.is_empty() {
            return Err(self.error("preparing it", Problem::Refused(complaints.join("; "))));
        }
        let warnings = firmware_warning(&version).into_iter().collect();
        let identity = format!("{version} ({})", stages.join(" | "));
        Ok(Identity { role: "stage".to_owned(), identity, link: self.link.clone(), warnings })
    }

    async fn begin(&mut self, targets: &[(Axis, f64)], speed_mm_s: f64) -> Result<(), DeviceError> {
        let command = |(axis, target_mm): &(Axis, f64)| {
            let n = number(*axis);
            format!("{n}VA{speed_mm_s:.5};{n}PA{target_mm:.5}")
        };
        let line = targets.iter().map(command).collect::<Vec<_>>().join(";");
        self.tell("starting a motion", &line).await
    }

    async fn follow(&mut self, axes: &[Axis], expected: Duration, stop: &Notify) -> Result<(), DeviceError> {
        let doing = "waiting for a motion to end";
        let until = Instant::now() + expected + MOTION_MARGIN;
        tokio::select! {
            biased;
            () = stop.notified() => self.stop().await?,
            () = sleep(expected) => {}
        }
        for &axis in axes {
            let question = format!("{}MD?", number(axis));
            while self.ask_number(doing, &question, Some(stop)).await? != 1.0 {
                if Instant::now() > until {
                    self.stop().await?;
                    let told = format!(
                        "the {} axis still moves {} s after it should have ended",
                        axis.name(),
                        MOTION_MARGIN.as_secs()
                    );
                    return Err(self.error(doing, Problem::Motion(told)));
                }
            }
        }
        Ok(())
    }

    async fn position_mm(&mut self, axis: Axis) -> Result<f64, DeviceError> {
        self.ask_number("reading a position", &format!("{}TP", number(axis)), None).await
    }

    async fn stop(&mut self) -> Result<(), DeviceError> {
        self.line.tell_now(STOP_ALL).await.map_err(|error| self.failed("stopping", &error))
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        let mut complaints = Vec::new();
        for _ in 0..COMPLAINTS_MAX {
            let answer = self.ask("reading the error queue", "TB?").await?;
            // `code, ticks, TEXT` (manual, page TB)
            let mut parts = answer.splitn(3, ',').map(str::trim);
            match (parts.next().and_then(|code| code.parse::<u32>().ok()), parts.next(), parts.next()) {
                (Some(0), Some(_), Some(_)) => break,
                (Some(code), Some(_), Some(text)) => complaints.push(format!("error {code}, {text}")),
                _ => {
                    self.line.misfit();
                    let expected = "code, ticks, text".to_owned();
                    return Err(self.error("reading the error queue", Problem::Misfit { answer, expected }));
                }
            }
        }
        Ok(complaints)
    }
}

/// The controller's number of an axis.
fn number(axis: Axis) -> usize {
    axis.index() + 1
}

/// A warning where the version text (`ESP301 Version 1.1.1 16/01/14`) names a firmware with known faults.
fn firmware_warning(version: &str) -> Option<String> {
    let text = version.split("Version").nth(1)?.split_whitespace().next()?;
    let numbers: Vec<u32> = text.split('.').map_while(|part| part.parse().ok()).collect();
    (numbers.as_slice() < FIRMWARE_SOUND.as_slice())
        .then(|| format!("firmware {text} is older than 1.1.1 and may lose messages over USB"))
}

#[cfg(test)]
mod tests;
