//! Newport ESP301 (and ESP300): three axes behind one ASCII line.
//!
//! Commands and answers follow the ESP300 manual (pages named at each) and a recording of a real ESP301. Set commands have no
//! answer. So their result is read from `MD?`, the read-back and the error queue.

use super::MOTION_MARGIN;
use super::clear::{CLEARING_Z, clear_z};
use palpate_core::quantity::{Axis, Range, round, seconds};
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, Identity, MotionOrder, MotionOrders, RestPlace, STARTING, Stage, StageUse,
};
use palpate_link::time::{Instant, sleep_until};
use palpate_link::wire::{Connector, LineExchange, Urgent, WireError};
use std::time::Duration;

/// Longest wait for an answer. The controller can be silent for 2 to 5 s after it hit a travel limit.
const ANSWER_DEADLINE: Duration = Duration::from_secs(6);

/// Longest search for home: 25 mm at a home speed of 1 mm/s, twice, and a margin.
const HOME_DEADLINE: Duration = Duration::from_secs(90);

/// Largest distance between the end of z and the reported position at the limit where z was homed, mm. A controller that gives
/// this position another value would press where the specimen isn't expected.
const HOME_SHORT_MM: f64 = 1.0;

/// Position of the home mark of x and y, mm: rigs count from the mark, as the controller does as shipped.
const HOME_MARK_MM: f64 = 0.0;

/// Largest distance of a read-back from where the axis was sent, mm: what the mechanics lack at rest. At a larger one somebody else set
/// another place or zero.
const SENT_MM: f64 = 0.02;

/// Rounding of a commanded position in an answer, and of a displacement to counts, mm.
const COUNT_MM: f64 = 0.0002;

/// Least number of decimals of a position (manual, page TP). A position with fewer decimals is damaged.
const DECIMALS: usize = 3;

/// Number of times that a question is asked if its answer is invalid.
const QUESTION_TRIES: usize = 2;

/// Number of reads that empties the error queue. The queue holds ten errors, and one more read says that it is empty (manual,
/// page TB).
const COMPLAINTS_MAX: usize = 11;

/// Code of millimetres (manual, page SN). The setting is a label: it is checked and never written.
const MILLIMETRES: f64 = 2.0;

/// Stops all axes (manual, page ST). It has no answer.
const STOP_ALL: &str = "ST";

/// Oldest firmware without known faults of its USB link (firmware history).
const FIRMWARE_SOUND: [u32; 3] = [1, 1, 1];

/// An ESP301 on a serial line.
pub struct Esp301 {
    line: LineExchange,
    link: String,
    /// Use of the stage; `None` before z is prepared.
    usage: Option<StageUse>,
    /// Whether all axes are homed, so that their counts are within the travel.
    all_homed: bool,
    /// Fastest answer of the press so far. A question sent this time before the end of a motion finds the motion ended.
    quickest: Duration,
    /// Unreported errors from the error queue, oldest first.
    complaints: Vec<String>,
    /// Whether the controller was stopped outside a motion and hasn't moved since.
    stopped: bool,
    /// The axes that this driver has homed.
    homed: [bool; 3],
    /// Where the controller has each axis, mm: a relative motion begins there, not where the axis is read back. `None` in a motion.
    sent_mm: [Option<f64>; 3],
    /// Whether these are sums of what was sent since home. After a stop they are read, and rounded.
    sums: [bool; 3],
}

impl Esp301 {
    /// Creates a controller behind a link; nothing is sent yet. `link` is its name in messages.
    pub fn new(connector: Connector, link: String) -> Self {
        let line = LineExchange::new(connector, ANSWER_DEADLINE, "VE?", "ESP30");
        Esp301 {
            line,
            link,
            usage: None,
            all_homed: false,
            quickest: ANSWER_DEADLINE,
            complaints: Vec::new(),
            stopped: false,
            homed: [false; 3],
            sent_mm: [None; 3],
            sums: [false; 3],
        }
    }

    async fn tell(&mut self, doing: &str, line: &str) -> Result<(), DeviceError> {
        self.line.tell(line).await.map_err(|error| self.failed(doing, &error))
    }

    async fn ask(&mut self, doing: &str, question: &str) -> Result<String, DeviceError> {
        self.line.ask(question).await.map_err(|error| self.failed(doing, &error))
    }

    async fn ask_number(&mut self, doing: &str, question: &str) -> Result<f64, DeviceError> {
        self.ask_for(doing, question, 1, None, "a number", |answers| number_in(answers.first()?)).await
    }

    /// Returns the positions of some axes if all are at rest, otherwise `None` (manual, pages MD: 0 moving, 1 done, and TP). Each
    /// call also reads one entry of the error queue.
    async fn at_rest(
        &mut self,
        doing: &str,
        axes: &[Axis],
        orders: &MotionOrders,
    ) -> Result<Option<Vec<f64>>, DeviceError> {
        let questions = |name: &'static str| axes.iter().map(move |&axis| format!("{}{name}", number(axis)));
        let travels = axes.iter().map(|&axis| self.reach(axis)).collect::<Vec<_>>();
        // also where each was sent (manual, page DP): the controller rounds each displacement to counts, and the sum isn't known
        let (commanded, count) = if self.all_homed { (axes.len(), 3) } else { (0, 2) };
        let question = questions("MD?").chain(questions("TP")).chain(questions("DP?").take(commanded));
        let question = question.collect::<Vec<_>>().join(";") + ";TB?";
        let read = |answers: &[String]| {
            let (complaint, answers) = answers.split_last()?;
            let complaint = complaint_in(complaint)?;
            let (done, answers) = answers.split_at_checked(axes.len())?;
            let (places, sent) = answers.split_at_checked(axes.len())?;
            let sent: Vec<f64> = sent.iter().map(|text| number_in(text)).collect::<Option<_>>()?;
            let done = done.iter().map(|text| match text.as_str() {
                "0" => Some(false),
                "1" => Some(true),
                _ => None,
            });
            let places = places.iter().zip(&travels).map(|(text, travel)| place_in(text, *travel));
            let (done, places): (Vec<bool>, Vec<f64>) = (done.collect::<Option<_>>()?, places.collect::<Option<_>>()?);
            Some((done.iter().all(|&done| done).then_some((places, sent)), complaint))
        };
        let expected = "0 or 1 and a position for each axis, and an error";
        let (places, complaint) =
            self.ask_for(doing, &question, count * axes.len() + 1, Some((orders, axes)), expected, read).await?;
        let room = COMPLAINTS_MAX.saturating_sub(self.complaints.len());
        self.complaints.extend(complaint.into_iter().take(room));
        let Some((places, sent)) = places else { return Ok(None) };
        for (axis, read_mm) in axes.iter().zip(sent) {
            // the sum of what was sent is finer than the answer, unless the controller's counts are coarser
            self.sent_mm[axis.index()] = match self.sent_mm[axis.index()] {
                None => Some(read_mm),
                Some(sent_mm) if (sent_mm - read_mm).abs() <= COUNT_MM => Some(sent_mm),
                // a displacement from a damaged answer would end elsewhere: two must agree
                Some(_) => {
                    self.sums[axis.index()] = false;
                    let again_mm = self.ask_number(doing, &format!("{}DP?", number(*axis))).await?;
                    (again_mm == read_mm).then_some(read_mm)
                }
            };
        }
        Ok(Some(places))
    }

    /// Returns the answers to a line of questions, asked again if the answers are invalid. Orders during the call
    /// are sent to `axes` at once.
    async fn ask_for<T>(
        &mut self,
        doing: &str,
        question: &str,
        lines: usize,
        orders: Option<(&MotionOrders, &[Axis])>,
        expected: &str,
        read: impl Fn(&[String]) -> Option<T>,
    ) -> Result<T, DeviceError> {
        let mut answers = Vec::new();
        for _ in 0..QUESTION_TRIES {
            let asked = Instant::now();
            let answered = match orders {
                None => self.line.ask_all(question, lines, None).await,
                Some((orders, axes)) => {
                    let line = || orders.take().map(|order| line_of(order, axes));
                    self.line.ask_all(question, lines, Some(&Urgent { asked: orders.pulled(), line: &line })).await
                }
            };
            answers = answered.map_err(|error| self.failed(doing, &error))?;
            self.quickest = self.quickest.min(asked.elapsed());
            match read(&answers) {
                Some(value) => return Ok(value),
                None => self.line.misfit(),
            }
        }
        let expected = format!("{expected} to {question}");
        Err(self.error(doing, DeviceProblem::Misfit { answer: answers.join(", "), expected }))
    }

    /// Range of possible positions of an axis.
    fn reach(&self, axis: Axis) -> Option<Range> {
        self.usage.as_ref().filter(|_| self.all_homed).map(|usage| usage.reach(axis))
    }

    async fn check_axis(&mut self, axis: Axis, usage: &StageUse) -> Result<(), DeviceError> {
        let (doing, n) = ("checking an axis against the rig", number(axis));
        let units = self.ask_number(doing, &format!("{n}SN?")).await?;
        if units != MILLIMETRES {
            let text = format!("axis {n} uses unit {units} instead of mm (2); change it on the controller");
            return Err(self.error(doing, DeviceProblem::Mismatch(text)));
        }
        let fastest = self.ask_number(doing, &format!("{n}VU?")).await?;
        if fastest < usage.speed_mm_s {
            let text = format!(
                "axis {n} reaches at most {fastest} mm/s, less than the rig's speed_mm_s of {}",
                usage.speed_mm_s
            );
            return Err(self.error(doing, DeviceProblem::Mismatch(text)));
        }
        Ok(())
    }

    /// Searches for home. The place where the search ends counts as `home_mm` (`SH`; 0 as shipped; manual, page SH).
    async fn search(
        &mut self,
        axis: Axis,
        mode: u8,
        home_mm: f64,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let (doing, n) = ("homing", number(axis));
        self.tell(doing, &format!("{n}MO")).await?;
        self.tell(doing, &format!("{n}OH{:.4};{n}SH{home_mm:.4};{n}OR{mode}", usage.home_speed_mm_s)).await?;
        let way_mm = usage.travel.along(axis).max - usage.travel.along(axis).min;
        let until = Instant::now() + HOME_DEADLINE + seconds(2.0 * way_mm / usage.home_speed_mm_s);
        while self.at_rest(doing, &[axis], orders).await?.is_none() {
            if Instant::now() > until {
                self.line.tell_now(STOP_ALL).await.map_err(|error| self.failed(doing, &error))?;
                let text = format!("axis {n} didn't finish homing in time");
                return Err(self.error(doing, DeviceProblem::Motion(text)));
            }
        }
        // refused, or stopped half-way: the axis isn't homed, and nothing else may move
        self.no_complaints(doing).await?;
        (self.homed[axis.index()], self.sums[axis.index()]) = (true, true);
        Ok(())
    }

    /// Whether the motor of an axis is on (manual, page MO).
    async fn is_on(&mut self, axis: Axis) -> Result<bool, DeviceError> {
        Ok(self.ask_number("homing", &format!("{}MO?", number(axis))).await? == 1.0)
    }

    /// Whether an axis is homed: by this driver, or, where the rig states it, by somebody who left the motor on. A motor that is on
    /// doesn't show it: jogging from the front panel needs it on too.
    async fn is_homed(&mut self, axis: Axis, usage: &StageUse) -> Result<bool, DeviceError> {
        Ok(self.homed[axis.index()] || (usage.homed && self.is_on(axis).await?))
    }

    async fn no_complaints(&mut self, doing: &str) -> Result<(), DeviceError> {
        let complaints = self.complaints().await?;
        if complaints.is_empty() {
            Ok(())
        } else {
            Err(self.error(doing, DeviceProblem::Refused(complaints.join("; "))))
        }
    }

    /// Sets the acceleration before anything moves, so that a stop brakes as hard as the program assumes.
    async fn set_acceleration(&mut self, usage: &StageUse) -> Result<(), DeviceError> {
        let a = usage.acceleration_mm_s2;
        let axes = Axis::ALL.map(|axis| format!("{n}AC{a};{n}AG{a}", n = number(axis)));
        self.tell("setting the acceleration", &axes.join(";")).await
    }

    async fn set_soft_limits(&mut self, axis: Axis, usage: &StageUse) -> Result<(), DeviceError> {
        let (n, travel) = (number(axis), usage.travel.along(axis));
        self.tell("setting soft limits", &format!("{n}SL{:.4};{n}SR{:.4}", travel.min, travel.max)).await
    }

    fn failed(&self, doing: &str, error: &WireError) -> DeviceError {
        self.error(doing, DeviceProblem::Link(error.to_string()))
    }
}

impl Stage for Esp301 {
    async fn identify(&mut self, usage: &StageUse) -> Result<Identity, DeviceError> {
        let doing = "identifying it";
        let version = self.ask(doing, "VE?").await?;
        if !version.contains("ESP30") {
            let expected = "an ESP300 or ESP301 version".to_owned();
            return Err(self.error(doing, DeviceProblem::Misfit { answer: version, expected }));
        }
        (self.usage, self.all_homed) = (None, false); // before homing its count has no meaning
        // an earlier program may have left a motion, and a position is valid only at rest
        self.stop().await?;
        self.follow(&Axis::ALL, Duration::ZERO, &MotionOrders::default()).await?;
        self.complaints().await?; // from before the start
        let mut stages = Vec::new();
        for axis in Axis::ALL {
            stages.push(self.ask(doing, &format!("{}ID?", number(axis))).await?);
            self.check_axis(axis, usage).await?;
        }
        let warnings = firmware_warning(&version).into_iter().collect();
        let identity = format!("{version} ({})", stages.join(" | "));
        Ok(Identity { role: "stage".to_owned(), identity, link: self.link.clone(), warnings })
    }

    async fn nudge_away(&mut self, way_mm: f64, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
        let (doing, n, speed_mm_s) = ("moving z a little", number(Axis::Z), usage.home_speed_mm_s);
        self.set_acceleration(usage).await?;
        let was_on = self.is_on(Axis::Z).await?;
        // relative: the position of an axis before homing has no meaning (manual, page PR)
        self.tell(doing, &format!("{n}MO;{n}VA{speed_mm_s:.5};{n}PR{:.5}", usage.away * way_mm)).await?;
        let until = Instant::now() + MOTION_MARGIN + seconds(way_mm / speed_mm_s);
        while self.at_rest(doing, &[Axis::Z], orders).await?.is_none() && Instant::now() < until {}
        if !was_on {
            // in the state found: a motor that is on counts as homed if the rig states so
            self.tell(doing, &format!("{n}MF")).await?;
        }
        // at the end of its travel it can't move further
        Ok(self.complaints().await?.is_empty())
    }

    /// Homes z toward the limit away from the specimen (mode 3: + limit, 4: - limit; manual, page OR).
    async fn home_z(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
        self.usage = Some(usage.clone());
        self.set_acceleration(usage).await?;
        if self.is_homed(Axis::Z, usage).await? {
            return Ok(true);
        }
        let home_mm = usage.home_z_mm;
        self.search(Axis::Z, if usage.away > 0.0 { 3 } else { 4 }, home_mm, usage, orders).await?;
        let at_mm = self.position_mm(Axis::Z, &MotionOrders::default()).await?;
        if (at_mm - home_mm).abs() > HOME_SHORT_MM {
            self.homed[Axis::Z.index()] = false;
            let text = format!(
                "z reads {at_mm:.4} mm at the limit where it homed, instead of the {home_mm} mm that were set (3SH): check the \
                 controller's SH"
            );
            return Err(self.error("homing", DeviceProblem::Mismatch(text)));
        }
        Ok(true)
    }

    async fn home(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<(), DeviceError> {
        self.home_z(usage, orders).await?;
        for axis in [Axis::X, Axis::Y] {
            if !self.is_homed(axis, usage).await? {
                // z may already be homed and in contact; if it refuses, nothing moves sideways
                let problem = clear_z(self, usage, orders).await?;
                self.no_complaints(CLEARING_Z).await?;
                if let Some(problem) = problem {
                    return Err(self.error(CLEARING_Z, problem));
                }
                self.search(axis, 1, HOME_MARK_MM, usage, orders).await?;
            }
        }
        for axis in Axis::ALL {
            self.set_soft_limits(axis, usage).await?;
        }
        self.no_complaints("preparing it").await?;
        self.all_homed = true;
        Ok(())
    }

    fn usage(&self) -> Option<&StageUse> {
        self.usage.as_ref()
    }

    fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError { device: format!("stage (ESP301 at {})", self.link), doing: doing.to_owned(), problem }
    }

    /// Nothing comes in unasked.
    async fn rest(&mut self, _: bool, _: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
        Ok(None)
    }

    async fn send(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        // relative to where the axis was sent (manual, page PR), which is near where it was read back
        let by_mm = |way: &AxisWay| {
            let sent_mm = self.sent_mm[way.axis.index()].filter(|sent_mm| (sent_mm - way.from_mm).abs() <= SENT_MM);
            let rounding_mm = if self.sums[way.axis.index()] { 0.0 } else { COUNT_MM };
            match (Some(usage).filter(|_| self.all_homed), sent_mm) {
                // before homing: in the controller's decimals a way and its way back end where they began, which may be a limit
                (None, _) => round(way.by_mm, DECIMALS as i32),
                (Some(_), None) => way.by_mm,
                (Some(usage), Some(sent_mm)) => usage.from_count(way, sent_mm, rounding_mm),
            }
        };
        let by_mm: Vec<f64> = ways.iter().map(by_mm).collect();
        let command = |(way, by_mm): (&AxisWay, &f64)| {
            let n = number(way.axis);
            format!("{n}VA{speed_mm_s:.5};{n}PR{by_mm:.5}")
        };
        let Some(last) = ways.last().map(|way| way.axis) else { return Ok(()) };
        // complaints about the motion before; on the way to park they don't stop it
        if !std::mem::take(&mut self.stopped) && !self.complaints.is_empty() {
            let text = std::mem::take(&mut self.complaints).join("; ");
            return Err(self.error(STARTING, DeviceProblem::Refused(text)));
        }
        self.complaints.clear();
        // set commands have no answer: the answer to the question after them shows that they were accepted, and when
        let (doing, question) = (STARTING, format!("{}MD?", number(last)));
        let line = ways.iter().zip(&by_mm).map(command).collect::<Vec<_>>().join(";") + ";" + &question;
        let axes: Vec<Axis> = ways.iter().map(|way| way.axis).collect();
        let urgent = || orders.take().map(|order| line_of(order, &axes));
        let urgent = Urgent { asked: orders.pulled(), line: &urgent };
        let asked = Instant::now();
        for (way, by_mm) in ways.iter().zip(&by_mm) {
            let sent_mm = &mut self.sent_mm[way.axis.index()];
            *sent_mm = sent_mm.map(|sent_mm| round(sent_mm + by_mm, 5));
        }
        let answers = self.line.ask_all(&line, 1, Some(&urgent)).await.map_err(|error| self.failed(doing, &error))?;
        self.quickest = self.quickest.min(asked.elapsed());
        // a stop during resynchronisation was sent before the motion
        if orders.stopped() {
            self.line.tell_now(STOP_ALL).await.map_err(|error| self.failed(doing, &error))?;
        }
        if answers.first().is_none_or(|answer| number_in(answer).is_none()) {
            // the motion isn't commanded twice: a stop may have come in between
            self.line.misfit();
            self.ask_for(doing, &question, 1, Some((orders, &axes)), "0 or 1", |answers| number_in(answers.first()?))
                .await?;
        }
        Ok(())
    }

    fn forget_timing(&mut self) {
        self.quickest = ANSWER_DEADLINE;
    }

    async fn follow(
        &mut self,
        axes: &[Axis],
        expected: Duration,
        orders: &MotionOrders,
    ) -> Result<Vec<f64>, DeviceError> {
        let doing = "waiting for a motion to end";
        let (first, until) = (expected.saturating_sub(self.quickest), expected + MOTION_MARGIN);
        let began = Instant::now();
        loop {
            if let Some(order) = orders.take() {
                let text = self.line.tell_now(&line_of(order, axes)).await;
                text.map_err(|error| self.failed(doing, &error))?;
            }
            if orders.stopped() {
                break;
            }
            tokio::select! {
                biased;
                () = orders.pulled().notified() => {}
                () = sleep_until(began + first) => break,
            }
        }
        loop {
            let was_stopped = orders.stopped();
            if was_stopped {
                axes.iter().for_each(|axis| (self.sent_mm[axis.index()], self.sums[axis.index()]) = (None, false));
            }
            if let Some(places_mm) = self.at_rest(doing, axes, orders).await?
                && orders.stopped() == was_stopped
            {
                return Ok(places_mm);
            }
            if began.elapsed() > until {
                self.stop().await?;
                let names = axes.iter().map(|axis| axis.name()).collect::<Vec<_>>().join(", ");
                let text = format!("{names} still moving {} s after it should have ended", MOTION_MARGIN.as_secs());
                return Err(self.error(doing, DeviceProblem::Motion(text)));
            }
        }
    }

    async fn position_mm(&mut self, axis: Axis, orders: &MotionOrders) -> Result<f64, DeviceError> {
        let (question, travel) = (format!("{}TP", number(axis)), self.reach(axis));
        let read = |answers: &[String]| place_in(answers.first()?, travel);
        let (doing, expected) = ("reading a position", "a position within the travel");
        self.ask_for(doing, &question, 1, Some((orders, &Axis::ALL)), expected, read).await
    }

    async fn stop(&mut self) -> Result<(), DeviceError> {
        (self.stopped, self.sent_mm, self.sums) = (true, [None; 3], [false; 3]);
        self.line.tell_now(STOP_ALL).await.map_err(|error| self.failed("stopping", &error))
    }

    /// Cuts the power (manual, page AB) if z holds without it.
    async fn abort(&mut self) -> Result<(), DeviceError> {
        self.stop().await?;
        match self.usage.as_ref().is_some_and(|usage| usage.z_holds_unpowered) {
            true => self.line.tell_now("AB").await.map_err(|error| self.failed("stopping it at once", &error)),
            false => Ok(()),
        }
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        let mut complaints = std::mem::take(&mut self.complaints);
        for _ in 0..COMPLAINTS_MAX {
            let read = |answers: &[String]| complaint_in(answers.first()?);
            match self.ask_for("reading the error queue", "TB?", 1, None, "code, ticks, text", read).await? {
                Some(complaint) => complaints.push(complaint),
                None => break,
            }
        }
        Ok(complaints)
    }
}

/// Returns the line that sends an order to moving axes (manual, pages ST and VA).
fn line_of(order: MotionOrder, axes: &[Axis]) -> String {
    match order {
        MotionOrder::Stop => STOP_ALL.to_owned(),
        MotionOrder::Speed(mm_s) => {
            axes.iter().map(|&axis| format!("{}VA{mm_s:.5}", number(axis))).collect::<Vec<_>>().join(";")
        }
    }
}

/// Parses an entry of the error queue: `code, ticks, TEXT` (manual, page TB). The inner value is `None` if the queue is empty.
/// The ticks wrap into negative numbers.
fn complaint_in(answer: &str) -> Option<Option<String>> {
    let mut parts = answer.splitn(3, ',').map(str::trim);
    let (code, ticks, text) = (parts.next()?.parse::<u32>().ok()?, parts.next()?.parse::<i64>().ok(), parts.next()?);
    ticks?;
    Some((code != 0).then(|| format!("error {code}, {text}")))
}

/// Parses a finite number in an answer.
fn number_in(answer: &str) -> Option<f64> {
    answer.parse().ok().filter(|number: &f64| number.is_finite())
}

/// Parses a position with its decimals, inside the travel of the axis. An answer to MD that came twice is not accepted as a
/// position.
fn place_in(answer: &str, travel: Option<Range>) -> Option<f64> {
    let (_, decimals) = answer.split_once('.')?;
    number_in(answer)
        .filter(|place_mm| decimals.len() >= DECIMALS && travel.is_none_or(|travel| travel.contains(*place_mm)))
}

/// Controller's number of an axis.
fn number(axis: Axis) -> usize {
    axis.index() + 1
}

/// Returns a warning if the version text (`ESP301 Version 1.1.1 16/01/14`) names a firmware with known faults.
fn firmware_warning(version: &str) -> Option<String> {
    let text = version.split("Version").nth(1)?.split_whitespace().next()?;
    let numbers: Vec<u32> = text.split('.').map_while(|part| part.parse().ok()).collect();
    (numbers.as_slice() < FIRMWARE_SOUND.as_slice())
        .then(|| format!("firmware {text} is older than 1.1.1 and may lose messages over USB"))
}

#[cfg(test)]
mod tests;
