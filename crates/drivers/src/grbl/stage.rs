//! The stage: prepared, moved by jogs, followed by status reports.

use super::firmware::{Build, GrblFirmware};
use super::port::{ANSWER_DEADLINE, FEED_HOLD, GrblPort, JOG_CANCEL, SOFT_RESET};
use super::report::{GrblState, GrblStatus};
use super::settings::{FLUIDNC_IDLE, FLUIDNC_INCHES, ROUNDING_MM, ReportedSettings};
use crate::MOTION_MARGIN;
use crate::printer::feed_mm_min;
use palpate_core::quantity::{Axis, round, seconds};
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, Identity, MotionOrder, MotionOrders, RestPlace, STARTING, Stage, StageUse,
};
use palpate_link::time::{Instant, sleep_until};
use palpate_link::wire::Connector;
use std::time::Duration;

/// Longest search for home.
const HOME_DEADLINE: Duration = Duration::from_secs(120);

/// Interval of status questions while a motion is late (interface document: 5 to 10 times per second).
const STATUS_EVERY: Duration = Duration::from_millis(100);

/// Time from the expected end of a motion to the first look at it. Its last steps wait in a buffer.
const FIRST_LOOK: Duration = Duration::from_millis(10);

/// Largest difference between the count at home and what the settings say of it, mm.
const HOME_OFF_MOST_MM: f64 = 0.1;

/// A GRBL controller on a serial line.
pub struct Grbl {
    port: GrblPort,
    link: String,
    pub(super) usage: Option<StageUse>,
    /// What each axis should count at home, mm, if it is known.
    home_mm: Option<[f64; 3]>,
    /// The motion under way.
    ways: Vec<AxisWay>,
    /// Where GRBL counts the next jog from, mm: a cancel leaves it at whole steps of all axes (gcode.c, `gc_sync_position`), so it is `None`
    /// until the next read-back.
    sent_mm: Option<[f64; 3]>,
    /// Whether it restarted, so that its count isn't the rig's.
    is_lost: bool,
}

impl Grbl {
    /// Creates a controller behind a link; nothing is sent yet. `link` is its name in messages.
    pub fn new(connector: Connector, link: String) -> Self {
        Grbl {
            port: GrblPort::new(connector, link.clone()),
            link,
            usage: None,
            home_mm: None,
            ways: Vec::new(),
            sent_mm: None,
            is_lost: false,
        }
    }

    /// Returns the controller's state and the positions of the axes in machine coordinates. Impossible positions are refused.
    async fn status(&mut self, doing: &str, orders: &MotionOrders) -> Result<GrblStatus, DeviceError> {
        let status = self.port.status(doing, (orders, JOG_CANCEL)).await?;
        // once: a later motion away from the specimen must be possible
        if std::mem::take(&mut self.port.restarted) {
            return Err(self.lost(doing));
        }
        if !status.is_machine {
            let text = "it reports work positions (WPos); set $10=1 for machine positions".to_owned();
            return Err(self.port.error(doing, DeviceProblem::Mismatch(text)));
        }
        if let Some(usage) = self.usage.as_ref().filter(|_| !self.is_lost) {
            for axis in Axis::ALL {
                let place_mm = status.position_mm[axis.index()];
                if !usage.reach(axis).contains(place_mm) {
                    let expected = format!("a position within the travel of {}", axis.name());
                    return Err(self
                        .port
                        .error(doing, DeviceProblem::Misfit { answer: place_mm.to_string(), expected }));
                }
            }
        }
        Ok(status)
    }

    fn lost(&mut self, doing: &str) -> DeviceError {
        (self.is_lost, self.sent_mm) = (true, None);
        self.port.error(doing, DeviceProblem::Motion("it restarted and lost its position".to_owned()))
    }

    async fn build(&mut self) -> Result<Build, DeviceError> {
        let doing = "identifying it";
        let asked = self.port.line(doing, "$I", ANSWER_DEADLINE, None).await;
        let said = std::mem::take(&mut self.port.texts);
        // opening the port resets many boards: a welcome before this doesn't count
        (self.port.restarted, self.is_lost) = (false, false);
        if said.iter().any(|text| text.contains("Marlin") || text.starts_with("echo:")) {
            let words = "this is Marlin: write `driver = \"marlin\"` in [stage]";
            return Err(self.port.error(doing, DeviceProblem::Mismatch(words.to_owned())));
        }
        asked?;
        Build::read(&said).ok_or_else(|| {
            let expected = "[VER:1.1...], the version of GRBL that jogs, or FluidNC".to_owned();
            self.port.error(doing, DeviceProblem::Misfit { answer: said.join(" "), expected })
        })
    }

    /// Compares the controller's settings with the rig's. Returns what a person should know.
    pub(super) async fn check_settings(&mut self, build: &Build, usage: &StageUse) -> Result<Vec<String>, DeviceError> {
        let doing = "checking its settings against the rig";
        self.port.texts.clear();
        self.port.line(doing, "$$", ANSWER_DEADLINE, None).await?;
        if build.firmware == GrblFirmware::FluidNc {
            for name in [FLUIDNC_IDLE, FLUIDNC_INCHES] {
                match self.port.line(doing, name, ANSWER_DEADLINE, None).await {
                    // a version without this name: the check states which setting isn't known
                    Ok(()) | Err(DeviceError { problem: DeviceProblem::Refused(_), .. }) => {}
                    Err(error) => return Err(error),
                }
            }
        }
        let settings =
            ReportedSettings::new(std::mem::take(&mut self.port.settings), &std::mem::take(&mut self.port.texts));
        let checked = settings.check(build, usage);
        let checked = checked.map_err(|texts| self.port.error(doing, DeviceProblem::Settings(texts)))?;
        self.home_mm = checked.home_mm;
        Ok(checked.warnings)
    }

    /// Homes all axes: z first and away from the bed, then x and y (GRBL's default cycle). The axes are homed each time, because
    /// GRBL can't be asked whether it is homed. A frame that a person unlocked is idle too, but its position is as unknown as
    /// that of a locked frame.
    async fn search(&mut self, orders: &MotionOrders) -> Result<(), DeviceError> {
        let doing = "homing";
        match self.until_still(doing).await? {
            GrblState::Idle | GrblState::Alarm => {}
            state => {
                return Err(self.port.error(doing, DeviceProblem::Mismatch(format!("it is in the state {state:?}"))));
            }
        }
        // a reset ends a search for home, shown by a welcome
        self.port.line(doing, "$H", HOME_DEADLINE, Some((orders, SOFT_RESET))).await?;
        if orders.stopped() {
            return Err(self.port.error(doing, DeviceProblem::Motion("it was stopped".to_owned())));
        }
        match self.status(doing, &MotionOrders::default()).await?.state {
            GrblState::Idle => Ok(()),
            state => {
                Err(self.port.error(doing, DeviceProblem::Motion(format!("it is in the state {state:?} afterwards"))))
            }
        }
    }

    /// Checks that the axes count after homing what the settings say.
    async fn check_home(&mut self) -> Result<(), DeviceError> {
        let Some(home_mm) = self.home_mm else { return Ok(()) };
        let doing = "checking its position after homing";
        let counts_mm = self.status(doing, &MotionOrders::default()).await?.position_mm;
        match Axis::ALL
            .into_iter()
            .find(|axis| (counts_mm[axis.index()] - home_mm[axis.index()]).abs() > HOME_OFF_MOST_MM)
        {
            None => Ok(()),
            Some(axis) => {
                let (name, is_mm, should_mm) = (axis.name(), counts_mm[axis.index()], home_mm[axis.index()]);
                let text = format!(
                    "{name} counts {is_mm:.3} mm after homing, and by its settings should count {should_mm:.3} mm: it \
                     isn't a build of GRBL that palpate knows"
                );
                Err(self.port.error(doing, DeviceProblem::Mismatch(text)))
            }
        }
    }

    /// Checks that a frame without switches accepts motions.
    async fn unlocked(&mut self) -> Result<(), DeviceError> {
        let doing = "preparing it";
        match self.until_still(doing).await? {
            GrblState::Idle => Ok(()),
            state => Err(self.port.error(doing, DeviceProblem::Mismatch(format!("it is in the state {state:?}")))),
        }
    }

    /// Waits until the stage is at rest, after any motion.
    async fn until_still(&mut self, doing: &str) -> Result<GrblState, DeviceError> {
        let until = Instant::now() + MOTION_MARGIN;
        loop {
            let state = self.status(doing, &MotionOrders::default()).await?.state;
            if !matches!(state, GrblState::Jog | GrblState::Run | GrblState::Home) {
                return Ok(state);
            }
            if Instant::now() > until {
                return Err(self.late(doing).await?);
            }
            sleep_until(Instant::now() + STATUS_EVERY).await;
        }
    }

    /// Cancels a jog.
    async fn cancel(&mut self, doing: &str) -> Result<(), DeviceError> {
        self.sent_mm = None;
        self.port.send(doing, JOG_CANCEL).await
    }

    /// Stops a motion that doesn't end.
    async fn late(&mut self, doing: &str) -> Result<DeviceError, DeviceError> {
        self.cancel(doing).await?;
        let text = format!("still moving {} s after it should have ended", MOTION_MARGIN.as_secs());
        Ok(self.port.error(doing, DeviceProblem::Motion(text)))
    }

    /// Makes what is left of the motion at another speed, with a new jog. A jog keeps its initial speed.
    async fn change_speed(&mut self, mm_s: f64, orders: &MotionOrders) -> Result<(), DeviceError> {
        let doing = "changing a speed";
        self.cancel(doing).await?;
        self.until_still(doing).await?;
        // a displacement from a damaged answer would end elsewhere: two must agree
        let at_mm = self.status(doing, orders).await?.position_mm;
        if self.status(doing, orders).await?.position_mm != at_mm {
            let text = "two answers at rest have different positions".to_owned();
            return Err(self.port.error(doing, DeviceProblem::Motion(text)));
        }
        let left = |way: &AxisWay| AxisWay::between(way.axis, at_mm[way.axis.index()], way.to_mm());
        let left: Vec<AxisWay> = self.ways.iter().map(left).collect();
        self.begin(&left, mm_s, orders).await
    }
}

impl Stage for Grbl {
    async fn identify(&mut self, usage: &StageUse) -> Result<Identity, DeviceError> {
        self.usage = None; // before homing its count has no meaning
        self.port.wake("waiting for its welcome").await?;
        // an earlier program may have left a jog
        self.stop().await?;
        let build = self.build().await?;
        let warnings = self.check_settings(&build, usage).await?;
        Ok(Identity { role: "stage".to_owned(), identity: build.to_string(), link: self.link.clone(), warnings })
    }

    async fn nudge_away(&mut self, way_mm: f64, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
        let doing = "moving z a little";
        if self.until_still(doing).await? == GrblState::Alarm {
            self.port.line(doing, "$X", ANSWER_DEADLINE, None).await?;
        }
        let line = format!("$J=G91 G21 Z{:.4} F{:.3}", usage.away * way_mm, usage.home_speed_mm_s * 60.0);
        match self.port.line(doing, &line, ANSWER_DEADLINE, Some((orders, JOG_CANCEL))).await {
            Ok(()) => {}
            // where it counts itself at the end of its travel
            Err(DeviceError { problem: DeviceProblem::Refused(_), .. }) => return Ok(false),
            Err(error) => return Err(error),
        }
        if orders.stopped() {
            self.cancel(doing).await?;
        }
        self.follow(&[Axis::Z], seconds(way_mm / usage.home_speed_mm_s), orders).await?;
        Ok(true)
    }

    async fn home(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<(), DeviceError> {
        if usage.by_hand {
            self.unlocked().await?;
        } else {
            self.search(orders).await?;
            self.check_home().await?;
        }
        self.usage = Some(usage.clone());
        self.status("reading its position", &MotionOrders::default()).await?;
        self.port.complaints.clear();
        Ok(())
    }

    fn usage(&self) -> Option<&StageUse> {
        self.usage.as_ref()
    }

    fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        self.port.error(doing, problem)
    }

    /// A place would cost an exchange.
    async fn rest(&mut self, is_leaving: bool, orders: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
        match self.port.has_restarted(STARTING, orders).await? || (self.is_lost && !is_leaving) {
            true => Err(self.lost(STARTING)),
            false => Ok(None),
        }
    }

    async fn send(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let (doing, is_leaving, mut by_mm) = (STARTING, usage.is_leaving(ways), [0.0; 3]);
        for way in ways {
            let nth = way.axis.index();
            // where the last jog went is known better than where it was read back
            let sent_mm = self.sent_mm.map(|sent_mm| sent_mm[nth]);
            let most_mm = usage.steps.in_position_mm(way.axis);
            let sent_mm = sent_mm.filter(|sent_mm| !is_leaving && (sent_mm - way.from_mm).abs() <= most_mm);
            by_mm[nth] = usage.from_count(way, sent_mm.unwrap_or(way.from_mm), ROUNDING_MM);
        }
        let words = |way: &AxisWay| format!("{}{:.5}", way.axis.name().to_uppercase(), by_mm[way.axis.index()]);
        let words = ways.iter().map(words).collect::<Vec<_>>().join(" ");
        self.ways = ways.to_vec();
        // relative and in mm in this line alone (jogging document)
        let line = format!("$J=G91 G21 {words} F{:.3}", feed_mm_min(ways.iter().map(|way| way.by_mm), speed_mm_s));
        self.port.bring_back_in_step(doing, Some((orders, JOG_CANCEL))).await?; // before the question below: it takes its time
        if orders.stopped() {
            return Ok(());
        }
        let sent_mm = self.sent_mm.take(); // in doubt until the line is accepted
        self.port.line(doing, &line, ANSWER_DEADLINE, Some((orders, JOG_CANCEL))).await?;
        self.sent_mm = sent_mm.map(|sent_mm| std::array::from_fn(|axis| sent_mm[axis] + round(by_mm[axis], 5)));
        // GRBL ignores a cancel that comes before the jog is under way; with its `ok` it is
        if orders.stopped() {
            self.cancel(doing).await?;
        }
        Ok(())
    }

    async fn follow(
        &mut self,
        axes: &[Axis],
        expected: Duration,
        orders: &MotionOrders,
    ) -> Result<Vec<f64>, DeviceError> {
        let doing = "waiting for a motion to end";
        let began = Instant::now();
        let mut look = began + expected + if expected.is_zero() { Duration::ZERO } else { FIRST_LOOK };
        loop {
            match orders.take() {
                Some(MotionOrder::Stop) => {
                    self.cancel(doing).await?;
                    look = Instant::now();
                }
                Some(MotionOrder::Speed(mm_s)) => {
                    self.change_speed(mm_s, orders).await?;
                    look = Instant::now() + STATUS_EVERY;
                }
                None => {}
            }
            tokio::select! {
                biased;
                () = orders.pulled().notified() => continue,
                () = sleep_until(look) => {}
            }
            let GrblStatus { state, position_mm, .. } = self.status(doing, orders).await?;
            match state {
                GrblState::Jog | GrblState::Run | GrblState::Home => {}
                GrblState::Idle => {
                    self.sent_mm = self.sent_mm.filter(|_| !orders.stopped());
                    self.sent_mm.get_or_insert(position_mm);
                    return Ok(axes.iter().map(|axis| position_mm[axis.index()]).collect());
                }
                GrblState::Alarm | GrblState::Other => {
                    let why = self.port.complaints.join("; ");
                    let text = format!("it stopped in the state {state:?}; {why}");
                    return Err(self.port.error(doing, DeviceProblem::Motion(text)));
                }
            }
            if began.elapsed() > expected + MOTION_MARGIN {
                return Err(self.late(doing).await?);
            }
            look = Instant::now() + STATUS_EVERY;
        }
    }

    async fn position_mm(&mut self, axis: Axis, orders: &MotionOrders) -> Result<f64, DeviceError> {
        Ok(self.status("reading a position", orders).await?.position_mm[axis.index()])
    }

    async fn stop(&mut self) -> Result<(), DeviceError> {
        self.cancel("stopping").await
    }

    /// Holds the feed, resets the controller, and unlocks it. A jog is ended by less, but not a motion that somebody else commanded.
    async fn abort(&mut self) -> Result<(), DeviceError> {
        let doing = "stopping it at once";
        self.sent_mm = None;
        self.port.send(doing, FEED_HOLD).await?;
        // a reset of axes that move loses their place
        let brakes_s = self.usage.as_ref().map_or(0.0, |usage| usage.speed_mm_s / usage.acceleration_mm_s2);
        sleep_until(Instant::now() + seconds(brakes_s)).await;
        self.port.reset(doing).await?;
        self.port.line(doing, "$X", ANSWER_DEADLINE, None).await
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        Ok(std::mem::take(&mut self.port.complaints))
    }
}
