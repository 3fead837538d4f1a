//! The stage: identified without a motion, moved by one program for each motion, watched on its way.

use super::frame::{TaughtFrame, length, longest, minus, plus, sideways_mm};
use super::rtde::{RobotState, Rtde};
use super::script::{self, StraightMotion};
use crate::MOTION_MARGIN;
use palpate_core::quantity::Axis;
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, Identity, MotionOrder, MotionOrders, RestPlace, STARTING, Stage, StageUse,
};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, LineLink, WireError, silent};
use std::time::Duration;

/// Longest time from a program until it begins. A controller needs some 0.1 s.
const BEGUN_DEADLINE: Duration = Duration::from_secs(2);

/// Longest wait for the dashboard, and until the robot accepts a program.
const ANSWER_DEADLINE: Duration = Duration::from_secs(2);

/// Longest line of the dashboard, bytes.
const LINE_BYTES_MAX: usize = 1024;

/// Speed below which the arm is at rest, mm/s.
const REST_MM_S: f64 = 0.1;

/// Largest difference of the tool's orientation from the taught one, rad.
const TILT_RAD: f64 = 0.01;

/// Deceleration of a stop before the rig's own is known, mm/s^2.
const STOP_MM_S2: f64 = 500.0;

/// Number of states in which a program that began is neither running nor at its end.
const IDLE_STATES_MAX: usize = 20;

/// Time of the states whose mean is a position at rest, and number of such means from which its noise is known. The pose of an arm at rest
/// has noise of 10 to 20 um (recordings of arms of the e-Series), so a single state may be off by more than half a step.
const MEAN_TIME: Duration = Duration::from_millis(50);
const NOISE_MEANS: usize = 8;

/// Slowest setting of the speed slider with which a run continues.
const PACE_LEAST: f64 = 0.05;

/// Values of the robot's state (RTDE guide): robot mode, safety modes, runtime state.
const RUNNING: i32 = 7;
const NORMAL: i32 = 1;
const REDUCED: i32 = 2;
const PROTECTIVE_STOP: i32 = 3;
const STOPPED: u32 = 1;
const PLAYING: u32 = 2;
const PAUSED: u32 = 4;

/// Links to a robot, each to another of its ports.
pub struct RobotLinks {
    /// RTDE, port 30004.
    pub rtde: Connector,
    /// Programs, port 30002.
    pub programs: Connector,
    /// Dashboard, port 29999.
    pub dashboard: Connector,
}

/// What a rig states about a robot.
#[derive(Clone, Debug)]
pub struct RobotSettings {
    /// Frame of the stage.
    pub frame: TaughtFrame,
    /// Largest distance of the tool from its straight way, mm.
    pub path_error_mm: f64,
    /// Change of the robot's own force in one motion at which it is stopped, N. It includes the error of that force.
    pub guard_n: f64,
    /// Model, such as `UR5e`.
    pub model: String,
}

/// An arm with PolyScope 5 or 3.
pub struct Ur {
    robot: Rtde,
    programs: LineLink,
    dashboard: LineLink,
    settings: RobotSettings,
    link: String,
    usage: Option<StageUse>,
    /// Where the axes were sent last, or came to rest, mm.
    at_mm: [f64; 3],
    /// Number of the last program, and whether its end is awaited.
    number: i32,
    is_awaited: bool,
    motion: Option<ArmMotion>,
    pace: f64,
    /// Whether its last state allows a motion.
    is_running: bool,
    /// Standard deviation of each coordinate of a position at rest, mm.
    noise_mm: f64,
}

/// Motion under way, in the base, mm.
#[derive(Clone, Copy)]
struct ArmMotion {
    from_mm: [f64; 3],
    to_mm: [f64; 3],
    /// The robot's own force at its start, N.
    force_n: [f64; 3],
    /// Whether it goes away from the specimen. Nothing but the robot's own modes may prevent that.
    is_leaving: bool,
    /// Whether it was ordered to stop before its end.
    is_stopped: bool,
}

impl Ur {
    /// Creates an arm behind its links; nothing is sent yet. `link` is its name in messages.
    pub fn new(links: RobotLinks, settings: RobotSettings, link: String) -> Self {
        let is_cb = ["UR3", "UR5", "UR10"].contains(&settings.model.as_str());
        let interval = if is_cb { Rtde::INTERVAL } else { Rtde::SHORT_INTERVAL };
        Ur {
            robot: Rtde::new(links.rtde, interval),
            programs: LineLink::new(links.programs, "\n", LINE_BYTES_MAX),
            dashboard: LineLink::new(links.dashboard, "\n", LINE_BYTES_MAX),
            settings,
            link,
            usage: None,
            at_mm: [f64::NAN; 3],
            number: 0,
            is_awaited: false,
            motion: None,
            pace: 1.0,
            is_running: false,
            noise_mm: 0.0,
        }
    }

    fn failed(&self, doing: &str, error: &WireError) -> DeviceError {
        self.error(doing, DeviceProblem::Link(error.to_string()))
    }

    /// Asks the dashboard one question after another.
    async fn ask<const N: usize>(&mut self, doing: &str, questions: [&str; N]) -> Result<[String; N], DeviceError> {
        self.dashboard.close();
        let opened = self.dashboard.open().await;
        opened.map_err(|error| self.failed(doing, &error))?;
        self.line(doing, "a greeting").await?;
        let mut answers = [const { String::new() }; N];
        for (question, answer) in questions.into_iter().zip(&mut answers) {
            let sent = self.dashboard.send(format!("{question}\n").as_bytes(), ANSWER_DEADLINE).await;
            sent.map_err(|error| self.failed(doing, &error))?;
            *answer = self.line(doing, question).await?;
        }
        self.dashboard.close();
        Ok(answers)
    }

    async fn line(&mut self, doing: &str, question: &str) -> Result<String, DeviceError> {
        match self.dashboard.next_by(Instant::now() + ANSWER_DEADLINE).await {
            Ok(Some(line)) => Ok(line),
            Ok(None) => Err(self.failed(doing, &silent(question, ANSWER_DEADLINE))),
            Err(error) => Err(self.failed(doing, &error)),
        }
    }

    /// Sends a program. It replaces the one under way.
    async fn run(&mut self, doing: &str, program: impl FnOnce(i32) -> String) -> Result<(), DeviceError> {
        self.number = self.number.checked_add(1).unwrap_or(1);
        self.is_awaited = true;
        // a new connection: the controller fills the old one with messages that nobody reads
        self.programs.close();
        let sent = self.programs.send(program(self.number).as_bytes(), ANSWER_DEADLINE).await;
        sent.map_err(|error| self.failed(doing, &error))
    }

    /// Returns one state; the stream then rests.
    async fn state(&mut self, doing: &str) -> Result<RobotState, DeviceError> {
        let state = self.robot.start().await;
        self.robot.pause().await;
        state.map_err(|error| self.failed(doing, &error))
    }

    /// Returns the next state of the stream.
    async fn next_state(&mut self, doing: &str) -> Result<RobotState, DeviceError> {
        let state = self.robot.next().await;
        state.map_err(|error| self.failed(doing, &error))
    }

    /// Checks that the robot can move, and is where it is to be.
    fn check(&mut self, doing: &str, state: &RobotState) -> Result<(), DeviceError> {
        // outside a motion the robot's own scaling means nothing
        let scaling = if state.runtime == PLAYING && state.scaling > 0.0 { state.scaling } else { 1.0 };
        self.pace = (state.slider * scaling).max(PACE_LEAST);
        self.is_running = matches!((state.safety_mode, state.robot_mode), (NORMAL | REDUCED, RUNNING));
        let is_leaving = self.motion.is_some_and(|motion| motion.is_leaving);
        let problem = match (state.safety_mode, state.robot_mode) {
            // the way out of a contact may take long
            (NORMAL | REDUCED, RUNNING) if state.slider < PACE_LEAST && !is_leaving => {
                format!("its speed slider is at {:.0} %: set it to 100 %", 100.0 * state.slider)
            }
            (NORMAL | REDUCED, RUNNING) if state.runtime == PAUSED => {
                "its program is paused, and continues when somebody lets it: stop it on the pendant".to_owned()
            }
            (NORMAL | REDUCED, RUNNING) if is_leaving => return Ok(()),
            (NORMAL | REDUCED, RUNNING) => return self.check_way(doing, state),
            (PROTECTIVE_STOP, _) => "it is in a protective stop and stays where it is: its tip may still press on the specimen. Find the \
                                     cause, stop the paused program and unlock the stop on the pendant, and move the tip away by hand \
                                     (Freedrive); palpate never unlocks it"
                .to_owned(),
            (NORMAL | REDUCED, mode) => {
                format!("its robot mode is {mode}, not 7 (running): switch it on and release its brakes on the pendant")
            }
            (safety, _) => format!(
                "its safety mode is {safety} (5: safeguard stop, 6 and 7: emergency stop): it stays where it is, and its tip may still press \
                 on the specimen. Clear the cause and move the tip away by hand"
            ),
        };
        Err(self.error(doing, DeviceProblem::Motion(problem)))
    }

    /// Checks that the tool is on the straight way of the motion, not tilted, and that the robot's own force is within its guard.
    fn check_way(&self, doing: &str, state: &RobotState) -> Result<(), DeviceError> {
        let tilt_rad = self.settings.frame.tilt_rad(state.rotation_rad);
        if tilt_rad > TILT_RAD {
            let text =
                format!("its tool is tilted by {:.2} degrees from the taught orientation", tilt_rad.to_degrees());
            return Err(self.error(doing, DeviceProblem::Motion(text)));
        }
        let Some(motion) = self.motion else { return Ok(()) };
        let (off_mm, most_mm) = (sideways_mm(motion.from_mm, motion.to_mm, state.at_mm), self.settings.path_error_mm);
        if off_mm > most_mm {
            let text = format!("its tool is {off_mm:.3} mm off its straight way, `path_error_mm` is {most_mm}");
            return Err(self.error(doing, DeviceProblem::Motion(text)));
        }
        let (changed_n, limit_n) = (length(minus(state.force_n, motion.force_n)), self.settings.guard_n);
        if changed_n > limit_n {
            let text = format!(
                "the robot's own force changed by {changed_n:.1} N in one motion, over {limit_n:.1} N: it was stopped"
            );
            return Err(self.error(doing, DeviceProblem::Motion(text)));
        }
        Ok(())
    }

    /// Sends a program and reads states until one is accepted. A stop that is ordered meanwhile is sent at once.
    async fn until(
        &mut self,
        doing: &str,
        deadline: Duration,
        orders: &MotionOrders,
        is_done: impl Fn(&Ur, &RobotState) -> bool,
        late: &str,
    ) -> Result<RobotState, DeviceError> {
        let (begun, mut idle) = (Instant::now(), 0);
        loop {
            let next = tokio::select! {
                biased;
                () = orders.pulled().notified() => None,
                next = self.robot.next() => Some(next),
            };
            match next {
                None if orders.take() == Some(MotionOrder::Stop) => self.stop().await?,
                None => {} // a straight motion keeps its speed
                Some(next) => {
                    let state = next.map_err(|error| self.failed(doing, &error))?;
                    self.check(doing, &state)?;
                    orders.slow(self.pace);
                    if is_done(self, &state) {
                        return Ok(state);
                    }
                    let is_cut = state.runtime == STOPPED && state.begun == self.number && state.ended != self.number;
                    idle = if is_cut { idle + 1 } else { 0 };
                    if idle > IDLE_STATES_MAX {
                        let text =
                            "its program was ended by somebody else, or by an error that the pendant shows".to_owned();
                        return Err(self.error(doing, DeviceProblem::Motion(text)));
                    }
                }
            }
            if begun.elapsed() > deadline.div_f64(self.pace) {
                return Err(self.error(doing, DeviceProblem::Motion(late.to_owned())));
            }
        }
    }

    /// Begins a straight motion by a vector of the stage, mm.
    async fn move_by(
        &mut self,
        doing: &str,
        by_mm: [f64; 3],
        (speed_mm_s, usage): (f64, &StageUse),
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let started = self.robot.start().await;
        let state = started.map_err(|error| self.failed(doing, &error))?;
        let is_leaving = by_mm[0] == 0.0 && by_mm[1] == 0.0 && by_mm[2] * usage.away > 0.0;
        let (to_mm, frame) = (plus(self.at_mm, by_mm), &self.settings.frame);
        let rest_mm = frame.to_base(self.at_mm);
        let [x_mm, y_mm, _] = frame.to_stage(state.at_mm);
        // the way out is straight from where the tip is, which isn't where it was sent if the arm gives way
        let off_mm = length(minus(state.at_mm, rest_mm));
        let is_near = off_mm <= self.settings.path_error_mm;
        let target_mm = frame.to_base(if is_leaving && is_near { [x_mm, y_mm, to_mm[2]] } else { to_mm });
        let otherwise_mm = is_leaving.then(|| minus(frame.to_base(by_mm), frame.origin_mm()));
        self.motion = Some(ArmMotion {
            from_mm: state.at_mm,
            to_mm: target_mm,
            force_n: state.force_n,
            is_leaving,
            is_stopped: false,
        });
        let checked = self.check(doing, &state).and_then(|()| self.check_start(doing, off_mm));
        if let Err(error) = checked {
            self.motion = None; // nothing moves
            return Err(error);
        }
        let along_path = length(by_mm) / longest(by_mm);
        if longest(by_mm) == 0.0 || orders.stopped() {
            self.motion = None;
            return Ok(());
        }
        // speed and acceleration of the rig are those of an axis
        let (v, a) = (speed_mm_s * along_path, usage.acceleration_mm_s2 * along_path);
        let from_mm = (rest_mm, self.settings.path_error_mm);
        // on the way out the tool doesn't turn
        let rotation_rad = if is_leaving { state.rotation_rad } else { self.settings.frame.tool_rad() };
        let way = StraightMotion { from_mm, to_mm: target_mm, rotation_rad, otherwise_mm };
        self.run(doing, |number| script::motion(number, &way, v, a)).await?;
        self.at_mm = to_mm;
        let late = "it doesn't begin a program: is it in remote control, and no message on the pendant?";
        self.until(doing, BEGUN_DEADLINE, orders, |own, state| state.begun == own.number, late).await?;
        Ok(())
    }

    /// Checks that nothing else moved the tool since it came to rest.
    fn check_start(&self, doing: &str, off_mm: f64) -> Result<(), DeviceError> {
        let is_leaving = self.motion.is_some_and(|motion| motion.is_leaving);
        if off_mm > self.settings.path_error_mm && !is_leaving {
            let text = format!("its tool is {off_mm:.3} mm from where it came to rest: something else moved it");
            return Err(self.error(doing, DeviceProblem::Motion(text)));
        }
        Ok(())
    }

    /// Returns where the axes are at rest, mm: the mean of a state and of those after it.
    async fn mean_mm(&mut self, doing: &str, first: &RobotState) -> Result<[f64; 3], DeviceError> {
        let (mut sum_mm, mut count, begun) = (first.at_mm, 1.0, Instant::now());
        while begun.elapsed() < MEAN_TIME {
            sum_mm = plus(sum_mm, self.next_state(doing).await?.at_mm);
            count += 1.0;
        }
        Ok(self.settings.frame.to_stage(sum_mm.map(|sum| sum / count)))
    }

    /// Measures the noise of a position, as the arm is read back at rest.
    async fn measure_noise(&mut self, doing: &str) -> Result<(), DeviceError> {
        let mut means_mm = [[0.0; 3]; NOISE_MEANS];
        for mean_mm in &mut means_mm {
            let first = self.next_state(doing).await?;
            *mean_mm = self.mean_mm(doing, &first).await?;
        }
        let middle_mm =
            means_mm.iter().fold([0.0; 3], |sum, mean| plus(sum, *mean)).map(|sum| sum / NOISE_MEANS as f64);
        let squares: f64 = means_mm.iter().map(|mean| length(minus(*mean, middle_mm)).powi(2)).sum();
        self.noise_mm = (squares / (3 * (NOISE_MEANS - 1)) as f64).sqrt();
        Ok(())
    }

    /// Waits until the motion has ended, and returns where the axes are, mm.
    async fn ended(&mut self, doing: &str, expected: Duration, orders: &MotionOrders) -> Result<[f64; 3], DeviceError> {
        if !self.robot.is_started() {
            let started = self.robot.start().await;
            started.map_err(|error| self.failed(doing, &error))?;
        }
        let late = format!("still moving {} s after it should have ended", MOTION_MARGIN.as_secs());
        let begun = Instant::now();
        let is_done = |own: &Ur, state: &RobotState| {
            // a stop that never begins was refused: the arm may rest all the same
            let is_refused = state.begun != own.number && begun.elapsed() > BEGUN_DEADLINE;
            let has_ended = !own.is_awaited || state.ended == own.number || is_refused;
            has_ended && state.runtime == STOPPED && length(state.speed_mm_s) < REST_MM_S
        };
        let state = self.until(doing, expected + MOTION_MARGIN, orders, is_done, &late).await?;
        let at_mm = self.mean_mm(doing, &state).await?;
        let is_off = length(minus(at_mm, self.at_mm)) > self.settings.path_error_mm;
        let ended = self.motion.take();
        self.is_awaited = false;
        match ended {
            Some(motion) if motion.is_stopped || (is_off && motion.is_leaving) => self.at_mm = at_mm,
            Some(_) if is_off => {
                self.at_mm = at_mm;
                let text =
                    "it didn't go: its tool wasn't where it came to rest. Another client moved it, or set another TCP";
                return Err(self.error(doing, DeviceProblem::Motion(text.to_owned())));
            }
            _ => {}
        }
        Ok(at_mm)
    }

    /// After an error the arm is stopped where it is, and the stream of states rests.
    async fn settle<T>(&mut self, result: Result<T, DeviceError>) -> Result<T, DeviceError> {
        if result.is_err() {
            // the first error is reported
            if self.motion.take().is_some() {
                self.is_awaited = self.is_running && self.stop().await.is_ok();
                self.at_mm = [f64::NAN; 3];
            }
            if !self.is_running {
                // a paused program would continue by itself when its cause is cleared
                let _ = self.ask("stopping its program", ["stop"]).await;
            }
            self.robot.pause().await;
        }
        result
    }

    /// Has the robot check whether it reaches the corners of the travel.
    async fn check_reach(&mut self, doing: &str, usage: &StageUse, orders: &MotionOrders) -> Result<(), DeviceError> {
        let ends = usage.travel.axes.map(|range| [range.min, range.max]);
        let corners_mm: [[f64; 3]; 8] =
            std::array::from_fn(|corner| std::array::from_fn(|axis| ends[axis][corner >> axis & 1]));
        let (corners, tool_rad) =
            (corners_mm.map(|at| self.settings.frame.to_base(at)), self.settings.frame.tool_rad());
        self.run(doing, |number| script::reach(number, &corners, tool_rad)).await?;
        let late = "it doesn't run a program: is it in remote control, and no message on the pendant?";
        let is_done = |own: &Ur, state: &RobotState| state.ended == own.number && state.runtime == STOPPED;
        let state = self.until(doing, BEGUN_DEADLINE, orders, is_done, late).await?;
        self.is_awaited = false;
        match state.outside.checked_sub(1).and_then(|nth| usize::try_from(nth).ok()).and_then(|nth| corners_mm.get(nth))
        {
            None => Ok(()),
            Some([x, y, z]) => {
                let text = format!(
                    "the arm can't reach x = {x}, y = {y}, z = {z} mm within its joint and safety limits: narrow `travel_mm` in [stage], or \
                     teach a frame nearer to its base"
                );
                Err(self.error(doing, DeviceProblem::Mismatch(text)))
            }
        }
    }
}

impl Stage for Ur {
    async fn identify(&mut self, _: &StageUse) -> Result<Identity, DeviceError> {
        let doing = "identifying it";
        (self.usage, self.motion, self.is_awaited) = (None, None, false);
        let questions = ["get robot model", "get serial number", "PolyscopeVersion", "is in remote control"];
        let [model, serial, version, remote] = self.ask(doing, questions).await?;
        if remote == "false" {
            let text = "it is in local control: select remote control on the pendant".to_owned();
            return Err(self.error(doing, DeviceProblem::Mismatch(text)));
        }
        if model.trim_end_matches('e') != self.settings.model.trim_end_matches('e') {
            let text = format!("it is a {model}, and the rig states `ur = \"{}\"`", self.settings.model);
            return Err(self.error(doing, DeviceProblem::Mismatch(text)));
        }
        // a frame that was taught again may have another direction of z, which a person confirms again
        let identity = format!("{model} {serial}, {version}, frame {:08x}", self.settings.frame.checksum());
        let state = self.state(doing).await?;
        self.check(doing, &state)?;
        if state.runtime != STOPPED {
            let text = "a program runs on it: stop it on the pendant".to_owned();
            return Err(self.error(doing, DeviceProblem::Mismatch(text)));
        }
        self.number = state.begun.max(state.ended).max(0);
        self.at_mm = self.settings.frame.to_stage(state.at_mm);
        Ok(Identity { role: "stage".to_owned(), identity, link: self.link.clone(), warnings: Vec::new() })
    }

    async fn is_homed(&mut self) -> Result<bool, DeviceError> {
        Ok(true) // it knows where it is
    }

    async fn nudge_away(&mut self, way_mm: f64, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
        let doing = "moving z a little";
        let by_mm = [0.0, 0.0, usage.away * way_mm];
        if !usage.travel.along(Axis::Z).contains(self.at_mm[2] + by_mm[2]) {
            return Ok(false);
        }
        let speed_mm_s = usage.home_speed_mm_s;
        let moved = async {
            self.move_by(doing, by_mm, (speed_mm_s, usage), orders).await?;
            self.ended(doing, Duration::from_secs_f64(way_mm / speed_mm_s), orders).await
        };
        let moved = moved.await;
        self.settle(moved).await?;
        self.robot.pause().await;
        Ok(true)
    }

    /// Checks where the arm is and what it reaches. Nothing moves.
    async fn home(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<(), DeviceError> {
        let doing = "preparing it";
        let started = self.robot.start().await;
        let state = started.map_err(|error| self.failed(doing, &error))?;
        for axis in Axis::ALL {
            let (reach, at_mm) = (usage.reach(axis), self.settings.frame.to_stage(state.at_mm)[axis.index()]);
            if !reach.contains(at_mm) {
                let text = format!(
                    "{} is at {at_mm:.3} mm, outside {} to {} mm: move the tip into the travel by hand",
                    axis.name(),
                    reach.min,
                    reach.max
                );
                return Err(self.error(doing, DeviceProblem::Mismatch(text)));
            }
        }
        let checked = self.check_reach(doing, usage, orders).await;
        self.settle(checked).await?;
        let measured = self.measure_noise(doing).await;
        self.settle(measured).await?;
        self.robot.pause().await;
        self.usage = Some(usage.clone());
        Ok(())
    }

    fn position_noise_mm(&self) -> f64 {
        self.noise_mm
    }

    fn usage(&self) -> Option<&StageUse> {
        self.usage.as_ref()
    }

    fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        DeviceError { device: format!("stage (UR at {})", self.link), doing: doing.to_owned(), problem }
    }

    async fn rest(&mut self, _: bool, orders: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
        if self.at_mm[0].is_nan() {
            let at_rest = self.ended(STARTING, Duration::ZERO, orders).await;
            self.at_mm = self.settle(at_rest).await?;
        }
        Ok(Some(RestPlace { at_mm: self.at_mm, uncertainty_mm: self.settings.path_error_mm }))
    }

    async fn send(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        usage: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let mut by_mm = [0.0; 3];
        let is_leaving = usage.is_leaving(ways);
        for way in ways {
            // where it was sent is known better than where it was read back
            let sent_mm = self.at_mm[way.axis.index()];
            let is_near = (sent_mm - way.from_mm).abs() <= self.settings.path_error_mm;
            let left_mm = way.to_mm() - sent_mm;
            let is_known = !is_leaving || (is_near && left_mm * way.by_mm > 0.0);
            by_mm[way.axis.index()] = if is_known { left_mm } else { way.by_mm };
        }
        let begun = self.move_by(STARTING, by_mm, (speed_mm_s, usage), orders).await;
        self.settle(begun).await
    }

    async fn follow(
        &mut self,
        axes: &[Axis],
        expected: Duration,
        orders: &MotionOrders,
    ) -> Result<Vec<f64>, DeviceError> {
        let ended = self.ended("waiting for a motion to end", expected, orders).await;
        let at_mm = self.settle(ended).await?;
        self.robot.pause().await;
        Ok(axes.iter().map(|axis| at_mm[axis.index()]).collect())
    }

    async fn position_mm(&mut self, axis: Axis, _: &MotionOrders) -> Result<f64, DeviceError> {
        let doing = "reading a position";
        let started = self.robot.start().await;
        let state = started.map_err(|error| self.failed(doing, &error))?;
        let at_mm = self.mean_mm(doing, &state).await;
        self.robot.pause().await;
        Ok(at_mm?[axis.index()])
    }

    async fn stop(&mut self) -> Result<(), DeviceError> {
        if let Some(motion) = &mut self.motion {
            motion.is_stopped = true;
        }
        let deceleration_mm_s2 = self.usage.as_ref().map_or(STOP_MM_S2, |usage| usage.acceleration_mm_s2);
        self.run("stopping it", |number| script::stop(number, deceleration_mm_s2)).await
    }

    /// Stops what runs by the dashboard, which has a port of its own.
    async fn abort(&mut self) -> Result<(), DeviceError> {
        if let Some(motion) = &mut self.motion {
            motion.is_stopped = true;
        }
        self.ask("stopping it at once", ["stop"]).await.map(drop)
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        Ok(std::mem::take(&mut self.robot.texts))
    }
}
