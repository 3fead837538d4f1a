//! The stage: a group of three positioners, used over three sockets.

use super::CALL_DEADLINE;
use super::guard::{Armed, Guard};
use super::socket::Socket;
use super::text::{Answer, GroupState, group_state, number_in};
use crate::device::{DeviceError, DeviceProblem, Identity, MotionOrder, Reins, Stage, StageUse};
use crate::driver::MOTION_MARGIN;
use crate::quantity::Axis;
use crate::wire::Connector;
use std::cell::Cell;
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// Interval of questions for the group's status while waiting for something that no socket reports (EPICS: 10 ms).
const STATUS_EVERY: Duration = Duration::from_millis(10);

/// Longest time from a motion's call until the group moves or has moved.
const TAKEN_DEADLINE: Duration = Duration::from_secs(1);

/// Number of attempts for the abort, each on a new socket.
const ABORT_TRIES: usize = 2;

/// Code "not allowed in this state": the answer to an abort if nothing moves.
const NOT_ALLOWED: i32 = -22;
/// Code with which an aborted motion is answered.
const ABORTED: i32 = -27;

/// Largest difference of two read-backs of an axis at rest, mm.
pub(super) const AT_REST_MM: f64 = 0.001;

/// Controller group that is the stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Name of the group, such as `XYZ`.
    pub name: String,
    /// Positioners of the group for x, y and z.
    pub positioners: [String; 3],
    /// Whether a group that isn't homed may be homed. The way to its home must be clear of the specimen, in the axis order that
    /// is set in the controller. The program can't read this order.
    pub home_search: bool,
}

/// An XPS' group as a stage.
pub struct Xps {
    pub(super) moves: Socket,
    pub(super) asks: Socket,
    pub(super) aborts: Socket,
    pub(super) group: Group,
    pub(super) guard: Option<Guard>,
    pub(super) armed: Option<Armed>,
    pub(super) link: String,
    pub(super) usage: Option<StageUse>,
    /// Speed, acceleration and jerk times that are set in each positioner: mm/s, mm/s^2, s, s.
    pub(super) profiles: [[f64; 4]; 3],
    /// Position to which each axis was last sent and at which it arrived, mm. `None` if the axis was stopped before arrival.
    pub(super) sent_mm: [Option<f64>; 3],
    /// Motion whose end the motion socket hasn't reported yet.
    pub(super) under_way: Option<Motion>,
}

#[derive(Clone, Debug)]
pub(super) struct Motion {
    call: String,
    targets: Vec<(Axis, f64)>,
    /// Whether this program requested the abort.
    aborted: bool,
}

impl Xps {
    /// Creates a controller behind three links to the same address; nothing is sent yet. `link` is its name in messages.
    pub fn new(connectors: [Connector; 3], link: String, group: Group, guard: Option<Guard>) -> Self {
        let device = || format!("stage (XPS at {link})");
        let [moves, asks, aborts] = connectors.map(|connector| Socket::new(connector, device()));
        Xps {
            moves,
            asks,
            aborts,
            group,
            guard,
            armed: None,
            link,
            usage: None,
            profiles: [[0.0; 4]; 3],
            sent_mm: [None; 3],
            under_way: None,
        }
    }

    pub(super) fn positioner(&self, axis: Axis) -> String {
        format!("{}.{}", self.group.name, self.group.positioners[axis.index()])
    }

    pub(super) fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        self.asks.error(doing, problem)
    }

    pub(super) async fn ask(&mut self, doing: &str, call: &str) -> Result<Vec<String>, DeviceError> {
        self.asks.call(doing, call, CALL_DEADLINE).await
    }

    pub(super) async fn ask_numbers<const N: usize>(
        &mut self,
        doing: &str,
        call: &str,
    ) -> Result<[f64; N], DeviceError> {
        numbers(&mut self.asks, doing, call).await
    }

    async fn state(&mut self, doing: &str) -> Result<GroupState, DeviceError> {
        state(&mut self.asks, &self.group, doing).await
    }

    /// Returns the position of an axis. An impossible position is refused.
    async fn place_mm(&mut self, doing: &str, axis: Axis, reins: &Reins) -> Result<f64, DeviceError> {
        let call = format!("GroupPositionCurrentGet({},double *)", self.positioner(axis));
        let Xps { asks, aborts, group, .. } = self;
        let [place_mm] = with_abort(aborts, group, reins, numbers(asks, doing, &call)).await?;
        self.note_abort(reins);
        if let Some(usage) = &self.usage
            && !usage.reach(axis).contains(place_mm)
        {
            let expected = format!("a position within the travel of {}", axis.name());
            return Err(self.error(doing, DeviceProblem::Misfit { answer: place_mm.to_string(), expected }));
        }
        Ok(place_mm)
    }

    /// Records the abort that the reins requested. The answer to the motion then reports the abort and who requested it.
    fn note_abort(&mut self, reins: &Reins) {
        if let Some(motion) = self.under_way.as_mut().filter(|_| reins.stopped()) {
            motion.aborted = true;
        }
    }

    /// Waits until the group doesn't move, after any motion.
    pub(super) async fn until_still(&mut self, doing: &str, within: Duration) -> Result<GroupState, DeviceError> {
        let until = Instant::now() + within;
        loop {
            let state = self.state(doing).await?;
            if !matches!(state, GroupState::Moving | GroupState::Homing) {
                return Ok(state);
            }
            if Instant::now() > until {
                self.stop().await?;
                let told = format!("{} still moves after {} s", self.group.name, within.as_secs());
                return Err(self.error(doing, DeviceProblem::Motion(told)));
            }
            sleep(STATUS_EVERY).await;
        }
    }

    /// Sets the speed and the acceleration of a positioner's next motion.
    async fn shape(&mut self, axis: Axis, speed_mm_s: f64, reins: &Reins) -> Result<(), DeviceError> {
        let [_, _, jerk_least_s, jerk_most_s] = self.profiles[axis.index()];
        let acceleration_mm_s2 = self.usage.as_ref().map_or(0.0, |usage| usage.acceleration_mm_s2);
        let profile = [speed_mm_s, acceleration_mm_s2, jerk_least_s, jerk_most_s];
        if self.profiles[axis.index()] != profile {
            let [v, a, least, most] = profile;
            let positioner = self.positioner(axis);
            let call = format!("PositionerSGammaParametersSet({positioner},{v:.6},{a:.6},{least},{most})");
            self.profiles[axis.index()] = [f64::NAN; 4]; // unknown until it is answered
            let doing = "setting a speed";
            let Xps { asks, aborts, group, .. } = self;
            with_abort(aborts, group, reins, asks.call(doing, &call, CALL_DEADLINE)).await?;
            self.profiles[axis.index()] = profile;
        }
        Ok(())
    }

    /// Returns the call that moves axes: one positioner, or the complete group. The group's other axes stay where they were sent.
    async fn motion_to(&mut self, targets: &[(Axis, f64)]) -> Result<Motion, DeviceError> {
        let call = match targets {
            [(axis, target_mm)] => format!("GroupMoveAbsolute({},{target_mm:.6})", self.positioner(*axis)),
            _ => {
                let mut places_mm = [0.0; 3];
                for axis in Axis::ALL {
                    let target = targets.iter().find(|(other, _)| *other == axis).map(|(_, target_mm)| *target_mm);
                    places_mm[axis.index()] = match target.or(self.sent_mm[axis.index()]) {
                        Some(place_mm) => place_mm,
                        None => self.rest_mm(axis).await?,
                    };
                }
                let [x, y, z] = places_mm;
                format!("GroupMoveAbsolute({},{x:.6},{y:.6},{z:.6})", self.group.name)
            }
        };
        Ok(Motion { call, targets: targets.to_vec(), aborted: false })
    }

    /// Returns the position of an axis that was stopped before its target. Two answers must agree, because the axis is commanded
    /// to stay there.
    async fn rest_mm(&mut self, axis: Axis) -> Result<f64, DeviceError> {
        let doing = "reading the position of an axis";
        let alone = Reins::default();
        let (first_mm, again_mm) =
            (self.place_mm(doing, axis, &alone).await?, self.place_mm(doing, axis, &alone).await?);
        if (first_mm - again_mm).abs() > AT_REST_MM {
            let told =
                format!("{} is at {first_mm} mm and then at {again_mm} mm, although it doesn't move", axis.name());
            return Err(self.error(doing, DeviceProblem::Motion(told)));
        }
        Ok(first_mm)
    }

    /// Sends a motion and waits until the group moves or has moved. A stop during this time is sent on its own socket.
    async fn start(&mut self, motion: Motion, reins: &Reins) -> Result<(), DeviceError> {
        let doing = "starting a motion";
        if reins.stopped() {
            return Ok(());
        }
        motion.targets.iter().for_each(|(axis, _)| self.sent_mm[axis.index()] = None);
        self.moves.begin(doing, &motion.call, CALL_DEADLINE).await?;
        self.under_way = Some(motion);
        let until = Instant::now() + TAKEN_DEADLINE;
        while Instant::now() < until {
            let Xps { asks, aborts, group, .. } = self;
            let state = with_abort(aborts, group, reins, state(asks, group, doing)).await?;
            self.note_abort(reins);
            if state == GroupState::Moving {
                // an abort that overtook the motion found nothing to stop
                if reins.stopped() {
                    reins.take();
                    self.stop().await?;
                }
                return Ok(());
            }
            if let Some(answer) = self.moves.answer_by(doing, Instant::now()).await? {
                return self.ended(doing, answer.code);
            }
        }
        self.stop().await?;
        Err(self.error(doing, DeviceProblem::Motion(format!("{} doesn't move", self.group.name))))
    }

    /// Evaluates the answer at the end of a motion.
    fn ended(&mut self, doing: &str, code: i32) -> Result<(), DeviceError> {
        let Some(motion) = self.under_way.take() else { return Ok(()) };
        match code {
            0 => {
                motion.targets.iter().for_each(|(axis, target_mm)| self.sent_mm[axis.index()] = Some(*target_mm));
                Ok(())
            }
            ABORTED if motion.aborted => Ok(()),
            ABORTED => {
                let problem = match self.armed.take() {
                    Some(armed) => DeviceProblem::Guarded { limit_n: armed.limit_n },
                    None => {
                        DeviceProblem::Motion("the motion was aborted at the controller, not by palpate".to_owned())
                    }
                };
                Err(self.error(doing, problem))
            }
            code => Err(self.moves.refused(doing, &motion.call, code)),
        }
    }

    /// Waits for the end of the motion in progress. Returns `None` if the reins request something first.
    async fn until_ended(&mut self, doing: &str, until: Instant, reins: &Reins) -> Result<Option<()>, DeviceError> {
        if self.under_way.is_none() {
            return Ok(Some(()));
        }
        if !self.moves.is_owed() {
            // its socket was lost: what became of the motion is asked of the group
            self.under_way = None;
            return self.until_still(doing, MOTION_MARGIN).await.map(|_| Some(()));
        }
        tokio::select! {
            biased;
            () = reins.pulled().notified() => Ok(None),
            answer = self.moves.answer_by(doing, until) => match answer? {
                Some(answer) => self.ended(doing, answer.code).map(Some),
                None => {
                    self.stop().await?;
                    self.moves.close();
                    let told = format!("still moving {} s after it should have ended", MOTION_MARGIN.as_secs());
                    Err(self.error(doing, DeviceProblem::Motion(told)))
                }
            },
        }
    }

    /// Continues toward the same target at another speed, with a new motion. An S-gamma motion keeps its initial speed.
    async fn change_speed(&mut self, mm_s: f64, reins: &Reins) -> Result<(), DeviceError> {
        let Some(motion) = self.under_way.clone() else { return Ok(()) };
        self.stop().await?;
        let until = Instant::now() + MOTION_MARGIN;
        self.until_ended("changing a speed", until, &Reins::default()).await?;
        for (axis, _) in &motion.targets {
            self.shape(*axis, mm_s, reins).await?;
        }
        let motion = self.motion_to(&motion.targets).await?;
        self.start(motion, reins).await
    }
}

/// Returns the numbers in the answer to a call.
async fn numbers<const N: usize>(asks: &mut Socket, doing: &str, call: &str) -> Result<[f64; N], DeviceError> {
    let values = asks.call(doing, call, CALL_DEADLINE).await?;
    let numbers: Option<Vec<f64>> = values.iter().map(|text| number_in(text)).collect();
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
        let expected = format!("{N} numbers to {call}");
        asks.error(doing, DeviceProblem::Misfit { answer: values.join(","), expected })
    })
}

/// Returns the state of the group.
async fn state(asks: &mut Socket, group: &Group, doing: &str) -> Result<GroupState, DeviceError> {
    let [status] = numbers(asks, doing, &format!("GroupStatusGet({},int *)", group.name)).await?;
    group_state(status as i32).filter(|_| status.fract() == 0.0).ok_or_else(|| {
        let expected = "a group status".to_owned();
        asks.error(doing, DeviceProblem::Misfit { answer: status.to_string(), expected })
    })
}

/// Waits for the answer on one socket. A stop requested during this time is sent on its own socket.
async fn with_abort<T>(
    aborts: &mut Socket,
    group: &Group,
    reins: &Reins,
    asked: impl Future<Output = Result<T, DeviceError>>,
) -> Result<T, DeviceError> {
    let sending = Cell::new(false);
    let abort = async {
        // another speed is for whoever follows the motion
        while !reins.stopped() {
            reins.pulled().notified().await;
        }
        if reins.take().is_none() {
            return std::future::pending().await; // it was sent already
        }
        sending.set(true);
        abort_by(aborts, group).await
    };
    tokio::pin!(asked, abort);
    tokio::select! {
        biased;
        aborted = &mut abort => {
            aborted?;
            asked.await
        }
        answer = &mut asked => {
            // one on its way is seen through: dropped before its socket is open it would never be sent
            if sending.get() {
                abort.await?;
            }
            answer
        }
    }
}

/// Aborts the motion. It isn't an error if nothing moves.
async fn abort_by(aborts: &mut Socket, group: &Group) -> Result<(), DeviceError> {
    let (doing, call) = ("stopping", format!("GroupMoveAbort({})", group.name));
    let mut told = Ok(());
    for _ in 0..ABORT_TRIES {
        told = match aborts.call_plainly(doing, &call, CALL_DEADLINE).await {
            Ok(Answer { code: 0 | NOT_ALLOWED, .. }) => return Ok(()),
            Ok(Answer { code, .. }) => Err(aborts.refused(doing, &call, code)),
            Err(error) => Err(error),
        };
    }
    told
}

impl Stage for Xps {
    async fn identify(&mut self, _: &StageUse) -> Result<Identity, DeviceError> {
        let doing = "identifying it";
        let version = self.ask(doing, "FirmwareVersionGet(char *)").await?.join(",");
        // a program that died may have left a motion behind
        self.stop().await?;
        let state = self.until_still(doing, MOTION_MARGIN).await?;
        let identity = format!("{version}, group {} ({})", self.group.name, self.group.positioners.join(", "));
        let homes = !matches!(state, GroupState::Ready | GroupState::Disabled) && self.group.home_search;
        let told = "it homes at the speed set in its stages.ini, which palpate can't change: make sure that it stops within \
                    the force limit";
        let warnings = homes.then(|| told.to_owned()).into_iter().collect();
        Ok(Identity { role: "stage".to_owned(), identity, link: self.link.clone(), warnings })
    }

    async fn home(&mut self, usage: &StageUse, reins: &Reins) -> Result<(), DeviceError> {
        self.bring_to_ready(reins).await?;
        for axis in Axis::ALL {
            self.set_up(axis, usage).await?;
        }
        self.usage = Some(usage.clone());
        for axis in Axis::ALL {
            self.place_mm("reading a position", axis, reins).await?;
        }
        Ok(())
    }

    async fn begin(&mut self, targets: &[(Axis, f64)], speed_mm_s: f64, reins: &Reins) -> Result<(), DeviceError> {
        // a group takes one motion at a time; what is under way ends by itself, where it is safe
        let until = Instant::now() + MOTION_MARGIN;
        while self.until_ended("waiting for the previous motion", until, reins).await?.is_none() {
            if reins.stopped() && reins.take().is_some() {
                self.stop().await?;
            }
        }
        for (axis, _) in targets {
            self.shape(*axis, speed_mm_s, reins).await?;
        }
        let motion = self.motion_to(targets).await?;
        self.start(motion, reins).await
    }

    async fn follow(&mut self, axes: &[Axis], expected: Duration, reins: &Reins) -> Result<Vec<f64>, DeviceError> {
        let doing = "waiting for a motion to end";
        let until = Instant::now() + expected + MOTION_MARGIN;
        if self.under_way.is_none() {
            self.until_still(doing, MOTION_MARGIN).await?;
        }
        loop {
            match reins.take() {
                Some(MotionOrder::Stop) => self.stop().await?,
                Some(MotionOrder::Speed(mm_s)) => self.change_speed(mm_s, reins).await?,
                None => {}
            }
            if self.until_ended(doing, until, reins).await?.is_some() {
                break;
            }
        }
        let mut places_mm = Vec::with_capacity(axes.len());
        for &axis in axes {
            places_mm.push(self.place_mm(doing, axis, reins).await?);
        }
        Ok(places_mm)
    }

    async fn position_mm(&mut self, axis: Axis, reins: &Reins) -> Result<f64, DeviceError> {
        self.place_mm("reading a position", axis, reins).await
    }

    async fn stop(&mut self) -> Result<(), DeviceError> {
        if let Some(motion) = &mut self.under_way {
            motion.aborted = true;
        }
        abort_by(&mut self.aborts, &self.group).await
    }

    async fn complaints(&mut self) -> Result<Vec<String>, DeviceError> {
        let doing = "reading its errors";
        let mut complaints = Vec::new();
        for axis in Axis::ALL {
            let positioner = self.positioner(axis);
            let [code] = self.ask_numbers(doing, &format!("PositionerErrorGet({positioner},int *)")).await?;
            if code != 0.0 {
                let text = self.ask(doing, &format!("PositionerErrorStringGet({code},char *)")).await?.join(",");
                complaints.push(format!("{positioner}: error {code}, {text}"));
            }
        }
        Ok(complaints)
    }

    async fn guard(&mut self, limit_n: Option<f64>) -> Result<(), DeviceError> {
        if let Some(armed) = self.armed.take() {
            armed.disarm(&mut self.asks).await?;
        }
        if let (Some(guard), Some(limit_n)) = (&self.guard, limit_n) {
            self.armed = Some(guard.arm(&mut self.asks, &self.group.name, limit_n).await?);
        }
        Ok(())
    }
}
