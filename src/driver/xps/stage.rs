//! The stage: its groups, used over a socket for questions and two for each group.

use super::CALL_DEADLINE;
use super::groups::{Brakes, Group, Grouping, Motion, first_answer};
use super::guard::Guard;
use super::socket::Socket;
use super::text::{GroupState, group_state, number_in};
use crate::device::{DeviceError, DeviceProblem, Identity, MotionOrder, Reins, Stage, StageUse};
use crate::driver::MOTION_MARGIN;
use crate::quantity::Axis;
use crate::wire::Connector;
use std::time::Duration;
use tokio::time::{Instant, sleep};

/// Interval of questions for a group's status while waiting for something that no socket reports (EPICS: 10 ms).
const STATUS_EVERY: Duration = Duration::from_millis(10);

/// Longest time from a motion's call until the group moves or has moved.
const TAKEN_DEADLINE: Duration = Duration::from_secs(1);

/// Code with which an aborted motion is answered.
const ABORTED: i32 = -27;

/// Largest difference of two read-backs of an axis at rest, mm.
pub(super) const AT_REST_MM: f64 = 0.001;

/// One to three groups of an XPS as a stage.
pub struct Xps {
    pub(super) asks: Socket,
    pub(super) brakes: Brakes,
    /// The groups, z's first.
    pub(super) groups: Vec<Group>,
    pub(super) grouping: Grouping,
    pub(super) guard: Option<Guard>,
    pub(super) link: String,
    pub(super) usage: Option<StageUse>,
    /// Acceleration of every motion, mm/s^2; known once the first group is ready.
    pub(super) acceleration_mm_s2: f64,
    /// Speed, acceleration and jerk times that are set in each positioner: mm/s, mm/s^2, s, s.
    pub(super) profiles: [[f64; 4]; 3],
    /// Position to which each axis was last sent and at which it arrived, mm. `None` if the axis was stopped before arrival.
    pub(super) sent_mm: [Option<f64>; 3],
}

impl Xps {
    /// Creates a controller behind links to the same address, which `dial` opens; nothing is sent yet. The first is for questions,
    /// then each group has one for its motions and one for its abort, z's group first. `link` is its name in messages.
    pub fn new(mut dial: impl FnMut() -> Connector, link: String, grouping: Grouping, guard: Option<Guard>) -> Self {
        let device = || format!("stage (XPS at {link})");
        let mut socket = || Socket::new(dial(), device());
        let (asks, mut groups, mut brakes) = (socket(), Vec::new(), Vec::new());
        for (name, axes) in grouping.groups() {
            let (moves, aborts) = (socket(), socket());
            brakes.push((name.clone(), aborts));
            groups.push(Group { name, axes, moves, armed: None, under_way: None });
        }
        let brakes = Brakes { groups: brakes };
        let (usage, profiles, sent_mm) = (None, [[0.0; 4]; 3], [None; 3]);
        Xps { asks, brakes, groups, grouping, guard, link, usage, acceleration_mm_s2: 0.0, profiles, sent_mm }
    }

    pub(super) fn positioner(&self, axis: Axis) -> String {
        let positioner = &self.grouping.positioners[axis.index()];
        format!("{}.{}", positioner.group, positioner.name)
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

    /// Returns the groups that some axes are in.
    fn groups_of(&self, axes: &[Axis]) -> Vec<usize> {
        let has_one = |group: &Group| group.axes.iter().any(|axis| axes.contains(axis));
        (0..self.groups.len()).filter(|&nth| has_one(&self.groups[nth])).collect()
    }

    /// Returns the position of an axis. An impossible position is refused.
    async fn place_mm(&mut self, doing: &str, axis: Axis, reins: &Reins) -> Result<f64, DeviceError> {
        let call = format!("GroupPositionCurrentGet({},double *)", self.positioner(axis));
        let Xps { asks, brakes, .. } = self;
        let [place_mm] = brakes.ready_during(reins, numbers(asks, doing, &call)).await?;
        self.note_abort(reins);
        if let Some(usage) = &self.usage
            && !usage.reach(axis).contains(place_mm)
        {
            let expected = format!("a position within the travel of {}", axis.name());
            return Err(self.error(doing, DeviceProblem::Misfit { answer: place_mm.to_string(), expected }));
        }
        Ok(place_mm)
    }

    /// Records the abort that the reins requested. The answers to the motions then report the abort and who requested it.
    fn note_abort(&mut self, reins: &Reins) {
        for motion in self.groups.iter_mut().filter(|_| reins.stopped()).filter_map(|group| group.under_way.as_mut()) {
            motion.aborted = true;
        }
    }

    /// Waits until a group doesn't move, after any motion.
    pub(super) async fn until_still(
        &mut self,
        nth: usize,
        doing: &str,
        within: Duration,
    ) -> Result<GroupState, DeviceError> {
        let until = Instant::now() + within;
        loop {
            let state = state(&mut self.asks, &self.groups[nth].name, doing).await?;
            if !matches!(state, GroupState::Moving | GroupState::Homing) {
                return Ok(state);
            }
            if Instant::now() > until {
                self.stop().await?;
                let told = format!("{} still moves after {} s", self.groups[nth].name, within.as_secs());
                return Err(self.error(doing, DeviceProblem::Motion(told)));
            }
            sleep(STATUS_EVERY).await;
        }
    }

    /// Sets the speed and the acceleration of a positioner's next motion.
    async fn shape(&mut self, axis: Axis, speed_mm_s: f64, reins: &Reins) -> Result<(), DeviceError> {
        let [_, _, jerk_least_s, jerk_most_s] = self.profiles[axis.index()];
        let profile = [speed_mm_s, self.acceleration_mm_s2, jerk_least_s, jerk_most_s];
        if self.profiles[axis.index()] != profile {
            let [v, a, least, most] = profile;
            let positioner = self.positioner(axis);
            let call = format!("PositionerSGammaParametersSet({positioner},{v:.6},{a:.6},{least},{most})");
            self.profiles[axis.index()] = [f64::NAN; 4]; // unknown until it is answered
            let doing = "setting a speed";
            let Xps { asks, brakes, .. } = self;
            brakes.ready_during(reins, asks.call(doing, &call, CALL_DEADLINE)).await?;
            self.profiles[axis.index()] = profile;
        }
        Ok(())
    }

    /// Returns the motions of the groups that some axes are in: one positioner, or the complete group. A group's other axes stay
    /// where they were sent.
    async fn motions_to(&mut self, targets: &[(Axis, f64)]) -> Result<Vec<(usize, Motion)>, DeviceError> {
        let axes: Vec<Axis> = targets.iter().map(|(axis, _)| *axis).collect();
        let mut motions = Vec::new();
        for nth in self.groups_of(&axes) {
            let Group { name, axes, .. } = &self.groups[nth];
            let (name, axes) = (name.clone(), axes.clone());
            let own: Vec<_> = targets.iter().copied().filter(|(axis, _)| axes.contains(axis)).collect();
            let call = match own[..] {
                [(axis, target_mm)] => format!("GroupMoveAbsolute({},{target_mm:.6})", self.positioner(axis)),
                _ => {
                    let mut places = String::new();
                    for axis in axes {
                        let target = own.iter().find(|(other, _)| *other == axis).map(|(_, target_mm)| *target_mm);
                        let place_mm = match target.or(self.sent_mm[axis.index()]) {
                            Some(place_mm) => place_mm,
                            None => self.rest_mm(axis).await?,
                        };
                        places += &format!(",{place_mm:.6}");
                    }
                    format!("GroupMoveAbsolute({name}{places})")
                }
            };
            motions.push((nth, Motion { call, targets: own, aborted: false }));
        }
        Ok(motions)
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

    /// Sends motions, one to each group, and waits until each group moves or has moved. A stop during this time is sent at once.
    /// If one group doesn't start, all are stopped.
    async fn start(&mut self, motions: Vec<(usize, Motion)>, reins: &Reins) -> Result<(), DeviceError> {
        let started = self.start_all(motions, reins).await;
        self.all_or_none(started).await
    }

    async fn start_all(&mut self, motions: Vec<(usize, Motion)>, reins: &Reins) -> Result<(), DeviceError> {
        let doing = "starting a motion";
        let mut sent = Vec::new();
        for (nth, motion) in motions {
            if reins.stopped() {
                break;
            }
            motion.targets.iter().for_each(|(axis, _)| self.sent_mm[axis.index()] = None);
            let group = &mut self.groups[nth];
            group.moves.begin(doing, &motion.call, CALL_DEADLINE).await?;
            group.under_way = Some(motion);
            sent.push(nth);
        }
        for nth in sent {
            self.until_taken(nth, doing, reins).await?;
        }
        Ok(())
    }

    /// Waits until a group moves or has moved.
    async fn until_taken(&mut self, nth: usize, doing: &str, reins: &Reins) -> Result<(), DeviceError> {
        let until = Instant::now() + TAKEN_DEADLINE;
        while Instant::now() < until {
            let Xps { asks, brakes, groups, .. } = self;
            let state = brakes.ready_during(reins, state(asks, &groups[nth].name, doing)).await?;
            self.note_abort(reins);
            if state == GroupState::Moving {
                // an abort that overtook the motion found nothing to stop
                if reins.stopped() {
                    reins.take();
                    self.stop().await?;
                }
                return Ok(());
            }
            if let Some(answer) = self.groups[nth].moves.answer_by(doing, Instant::now()).await? {
                return self.ended(nth, doing, answer.code);
            }
        }
        self.stop().await?;
        Err(self.error(doing, DeviceProblem::Motion(format!("{} doesn't move", self.groups[nth].name))))
    }

    /// Evaluates the answer at the end of a group's motion.
    fn ended(&mut self, nth: usize, doing: &str, code: i32) -> Result<(), DeviceError> {
        let group = &mut self.groups[nth];
        let Some(motion) = group.under_way.take() else { return Ok(()) };
        match code {
            0 => {
                motion.targets.iter().for_each(|(axis, target_mm)| self.sent_mm[axis.index()] = Some(*target_mm));
                Ok(())
            }
            ABORTED if motion.aborted => Ok(()),
            ABORTED => {
                let problem = match group.armed.take() {
                    Some(armed) => DeviceProblem::Guarded { limit_n: armed.limit_n },
                    None => {
                        DeviceProblem::Motion("the motion was aborted at the controller, not by palpate".to_owned())
                    }
                };
                Err(self.error(doing, problem))
            }
            code => Err(group.moves.refused(doing, &motion.call, code)),
        }
    }

    /// Stops the other groups if one group failed. A single group has no others.
    async fn all_or_none<T>(&mut self, done: Result<T, DeviceError>) -> Result<T, DeviceError> {
        if done.is_err() && self.groups.len() > 1 && self.groups.iter().any(|group| group.under_way.is_some()) {
            let _ = self.stop().await; // the failure is what is reported
        }
        done
    }

    /// Waits for the end of the motions of some groups. Returns `None` if the reins request something first. If one motion fails,
    /// all are stopped.
    async fn until_ended(
        &mut self,
        which: &[usize],
        doing: &str,
        until: Instant,
        reins: &Reins,
    ) -> Result<Option<()>, DeviceError> {
        let ended = self.until_each_ended(which, doing, until, reins).await;
        self.all_or_none(ended).await
    }

    async fn until_each_ended(
        &mut self,
        which: &[usize],
        doing: &str,
        until: Instant,
        reins: &Reins,
    ) -> Result<Option<()>, DeviceError> {
        loop {
            for &nth in which {
                let group = &mut self.groups[nth];
                if group.under_way.is_some() && !group.moves.is_owed() {
                    // its socket was lost: what became of the motion is asked of the group
                    group.under_way = None;
                    self.until_still(nth, doing, MOTION_MARGIN).await?;
                }
            }
            if which.iter().all(|&nth| self.groups[nth].under_way.is_none()) {
                return Ok(Some(()));
            }
            tokio::select! {
                biased;
                () = reins.pulled().notified() => return Ok(None),
                (nth, answer) = first_answer(&mut self.groups, which, doing, until) => match answer? {
                    Some(answer) => self.ended(nth, doing, answer.code)?,
                    None => {
                        self.stop().await?;
                        self.groups[nth].moves.close();
                        let told = format!("still moving {} s after it should have ended", MOTION_MARGIN.as_secs());
                        return Err(self.error(doing, DeviceProblem::Motion(told)));
                    }
                },
            }
        }
    }

    /// Continues toward the same targets at another speed, with new motions. An S-gamma motion keeps its initial speed.
    async fn change_speed(&mut self, which: &[usize], mm_s: f64, reins: &Reins) -> Result<(), DeviceError> {
        let motions = which.iter().filter_map(|&nth| self.groups[nth].under_way.as_ref());
        let targets: Vec<_> = motions.flat_map(|motion| motion.targets.clone()).collect();
        if targets.is_empty() {
            return Ok(());
        }
        self.abort(which).await?;
        let until = Instant::now() + MOTION_MARGIN;
        self.until_ended(which, "changing a speed", until, &Reins::default()).await?;
        for (axis, _) in &targets {
            self.shape(*axis, mm_s, reins).await?;
        }
        let motions = self.motions_to(&targets).await?;
        self.start(motions, reins).await
    }

    /// Aborts the motions of some groups.
    async fn abort(&mut self, which: &[usize]) -> Result<(), DeviceError> {
        for &nth in which {
            if let Some(motion) = &mut self.groups[nth].under_way {
                motion.aborted = true;
            }
        }
        self.brakes.abort(which).await
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

/// Returns the state of a group.
async fn state(asks: &mut Socket, group: &str, doing: &str) -> Result<GroupState, DeviceError> {
    let [status] = numbers(asks, doing, &format!("GroupStatusGet({group},int *)")).await?;
    group_state(status as i32).filter(|_| status.fract() == 0.0).ok_or_else(|| {
        let expected = "a group status".to_owned();
        asks.error(doing, DeviceProblem::Misfit { answer: status.to_string(), expected })
    })
}

impl Stage for Xps {
    async fn identify(&mut self, _: &StageUse) -> Result<Identity, DeviceError> {
        let doing = "identifying it";
        let version = self.ask(doing, "FirmwareVersionGet(char *)").await?.join(",");
        // a program that died may have left a motion behind
        self.stop().await?;
        let (mut names, mut is_ready) = (Vec::new(), true);
        for nth in 0..self.groups.len() {
            let state = self.until_still(nth, doing, MOTION_MARGIN).await?;
            is_ready &= matches!(state, GroupState::Ready | GroupState::Disabled);
            let Group { name, axes, .. } = &self.groups[nth];
            let own = axes.iter().map(|axis| self.grouping.positioners[axis.index()].name.as_str());
            names.push(format!("group {name} ({})", own.collect::<Vec<_>>().join(", ")));
        }
        let identity = format!("{version}, {}", names.join(", "));
        let homes = !is_ready && self.grouping.home_search;
        let told = "it homes at the speed set in its stages.ini, which palpate can't change: make sure that it stops within \
                    the force limit";
        let warnings = homes.then(|| told.to_owned()).into_iter().collect();
        Ok(Identity { role: "stage".to_owned(), identity, link: self.link.clone(), warnings })
    }

    async fn home_z(&mut self, usage: &StageUse, reins: &Reins) -> Result<bool, DeviceError> {
        // a group with other axes homes them in the same operation
        let is_alone = self.groups[0].axes == [Axis::Z];
        if is_alone {
            self.prepare(0, usage, reins).await?;
        }
        Ok(is_alone)
    }

    async fn home(&mut self, usage: &StageUse, reins: &Reins) -> Result<(), DeviceError> {
        for nth in 0..self.groups.len() {
            self.prepare(nth, usage, reins).await?;
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
        let which = self.groups_of(&targets.iter().map(|(axis, _)| *axis).collect::<Vec<_>>());
        while self.until_ended(&which, "waiting for the previous motion", until, reins).await?.is_none() {
            if reins.stopped() && reins.take().is_some() {
                self.stop().await?;
            }
        }
        for (axis, _) in targets {
            self.shape(*axis, speed_mm_s, reins).await?;
        }
        let motions = self.motions_to(targets).await?;
        self.start(motions, reins).await
    }

    async fn follow(&mut self, axes: &[Axis], expected: Duration, reins: &Reins) -> Result<Vec<f64>, DeviceError> {
        let doing = "waiting for a motion to end";
        let until = Instant::now() + expected + MOTION_MARGIN;
        let which = self.groups_of(axes);
        for &nth in &which {
            if self.groups[nth].under_way.is_none() {
                self.until_still(nth, doing, MOTION_MARGIN).await?;
            }
        }
        loop {
            match reins.take() {
                Some(MotionOrder::Stop) => self.stop().await?,
                Some(MotionOrder::Speed(mm_s)) => self.change_speed(&which, mm_s, reins).await?,
                None => {}
            }
            if self.until_ended(&which, doing, until, reins).await?.is_some() {
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
        self.abort(&(0..self.groups.len()).collect::<Vec<_>>()).await
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
        let Xps { asks, groups, guard, .. } = self;
        for group in groups.iter_mut() {
            if let Some(armed) = group.armed.take() {
                armed.disarm(asks).await?;
            }
        }
        if let (Some(guard), Some(limit_n)) = (guard, limit_n) {
            for group in groups {
                group.armed = Some(guard.arm(asks, &group.name, limit_n).await?);
            }
        }
        Ok(())
    }
}
