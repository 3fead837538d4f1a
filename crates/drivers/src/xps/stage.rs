//! The stage: its groups, used over a socket for questions and two for each group.

use super::CALL_DEADLINE;
use super::groups::{Brakes, DrivenGroup, Grouping};
use super::guard::Guard;
use super::socket::Socket;
use super::text::{GroupState, group_state, number_in};
use crate::MOTION_MARGIN;
use palpate_core::quantity::{Axis, seconds};
use palpate_link::device::{
    AxisWay, DeviceError, DeviceProblem, Identity, MotionOrder, MotionOrders, RestPlace, Stage, StageUse,
};
use palpate_link::time::{Instant, sleep};
use palpate_link::wire::Connector;
use std::time::Duration;

/// Interval of questions for a group's status while waiting for something that no socket reports (EPICS: 10 ms).
const STATUS_EVERY: Duration = Duration::from_millis(10);

/// One to three groups of an XPS as a stage.
pub struct Xps {
    pub(super) asks: Socket,
    pub(super) brakes: Brakes,
    /// The groups, z's first.
    pub(super) groups: Vec<DrivenGroup>,
    pub(super) grouping: Grouping,
    pub(super) guard: Option<Guard>,
    pub(super) link: String,
    pub(super) usage: Option<StageUse>,
    /// Whether all axes are homed, so that their counts are within the travel.
    pub(super) all_homed: bool,
    /// Acceleration of every motion, mm/s^2; known once the first group is ready.
    pub(super) acceleration_mm_s2: f64,
    /// Speed, acceleration and jerk times that are set in each positioner: mm/s, mm/s^2, s, s.
    pub(super) profiles: [[f64; 4]; 3],
    /// Setpoint of each axis, mm: a relative motion begins there, not where the axis is read back. `None` in a motion and after a stop.
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
            groups.push(DrivenGroup { name, axes, moves, armed: None, under_way: None });
        }
        let brakes = Brakes { groups: brakes };
        let (usage, profiles, sent_mm) = (None, [[0.0; 4]; 3], [None; 3]);
        Xps {
            asks,
            brakes,
            groups,
            grouping,
            guard,
            link,
            usage,
            all_homed: false,
            acceleration_mm_s2: 0.0,
            profiles,
            sent_mm,
        }
    }

    pub(super) fn positioner(&self, axis: Axis) -> String {
        let positioner = &self.grouping.positioners[axis.index()];
        format!("{}.{}", positioner.group, positioner.name)
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
    pub(super) fn groups_of(&self, axes: &[Axis]) -> Vec<usize> {
        let has_one = |group: &DrivenGroup| group.axes.iter().any(|axis| axes.contains(axis));
        (0..self.groups.len()).filter(|&nth| has_one(&self.groups[nth])).collect()
    }

    /// Returns the position of an axis. An impossible position is refused.
    pub(super) async fn place_mm(
        &mut self,
        doing: &str,
        axis: Axis,
        orders: &MotionOrders,
    ) -> Result<f64, DeviceError> {
        let call = format!("GroupPositionCurrentGet({},double *)", self.positioner(axis));
        let Xps { asks, brakes, .. } = self;
        let [place_mm] = brakes.ready_during(orders, numbers(asks, doing, &call)).await?;
        self.note_abort(orders);
        if let Some(usage) = self.usage.as_ref().filter(|_| self.all_homed)
            && !usage.reach(axis).contains(place_mm)
        {
            let expected = format!("a position within the travel of {}", axis.name());
            return Err(self.error(doing, DeviceProblem::Misfit { answer: place_mm.to_string(), expected }));
        }
        Ok(place_mm)
    }

    /// Records the ordered abort. The answers to the motions then report the abort and who requested it.
    pub(super) fn note_abort(&mut self, orders: &MotionOrders) {
        for motion in self.groups.iter_mut().filter(|_| orders.stopped()).filter_map(|group| group.under_way.as_mut()) {
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
                let text = format!("{} still moves after {} s", self.groups[nth].name, within.as_secs());
                return Err(self.error(doing, DeviceProblem::Motion(text)));
            }
            sleep(STATUS_EVERY).await;
        }
    }

    /// Sets the speed and the acceleration of a positioner's next motion.
    pub(super) async fn shape(
        &mut self,
        axis: Axis,
        speed_mm_s: f64,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let [_, _, jerk_least_s, jerk_most_s] = self.profiles[axis.index()];
        let profile = [speed_mm_s, self.acceleration_mm_s2, jerk_least_s, jerk_most_s];
        if self.profiles[axis.index()] != profile {
            let [v, a, least, most] = profile;
            let positioner = self.positioner(axis);
            let call = format!("PositionerSGammaParametersSet({positioner},{v:.6},{a:.6},{least},{most})");
            // unknown until it is answered; nobody else changes the jerk times
            self.profiles[axis.index()] = [f64::NAN, a, least, most];
            let doing = "setting a speed";
            let Xps { asks, brakes, .. } = self;
            brakes.ready_during(orders, asks.call(doing, &call, CALL_DEADLINE)).await?;
            self.profiles[axis.index()] = profile;
        }
        Ok(())
    }
}

/// Returns the numbers in the answer to a call.
pub(super) async fn numbers<const N: usize>(
    asks: &mut Socket,
    doing: &str,
    call: &str,
) -> Result<[f64; N], DeviceError> {
    let values = asks.call(doing, call, CALL_DEADLINE).await?;
    let numbers: Option<Vec<f64>> = values.iter().map(|text| number_in(text)).collect();
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
        let expected = format!("{N} numbers to {call}");
        asks.error(doing, DeviceProblem::Misfit { answer: values.join(","), expected })
    })
}

/// Returns the state of a group.
pub(super) async fn state(asks: &mut Socket, group: &str, doing: &str) -> Result<GroupState, DeviceError> {
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
        // an earlier program may have left a motion
        self.stop().await?;
        let (mut names, mut is_ready) = (Vec::new(), true);
        for nth in 0..self.groups.len() {
            let state = self.until_still(nth, doing, MOTION_MARGIN).await?;
            is_ready &= matches!(state, GroupState::Ready | GroupState::Disabled);
            let DrivenGroup { name, axes, .. } = &self.groups[nth];
            let own = axes.iter().map(|axis| self.grouping.positioners[axis.index()].name.as_str());
            names.push(format!("group {name} ({})", own.collect::<Vec<_>>().join(", ")));
        }
        let identity = format!("{version}, {}", names.join(", "));
        let homes = !is_ready && self.grouping.home_search;
        let text = "it homes at the speed set in its stages.ini, which palpate can't change: make sure that it stops within \
                    the force limit";
        let warnings = homes.then(|| text.to_owned()).into_iter().collect();
        Ok(Identity { role: "stage".to_owned(), identity, link: self.link.clone(), warnings })
    }

    async fn nudge_away(&mut self, way_mm: f64, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
        if self.groups[0].axes != [Axis::Z] {
            return Ok(false);
        }
        // an XPS refuses motions of a group that isn't homed
        self.prepare(0, usage, orders).await?;
        let end_mm = usage.travel.along(Axis::Z).end(usage.away);
        let way =
            AxisWay { axis: Axis::Z, from_mm: self.position_mm(Axis::Z, orders).await?, by_mm: usage.away * way_mm };
        if (way.to_mm() - end_mm) * usage.away > 0.0 {
            return Ok(false);
        }
        self.send(&[way], usage.home_speed_mm_s, usage, orders).await?;
        self.follow(&[Axis::Z], seconds(way_mm / usage.home_speed_mm_s), orders).await?;
        Ok(true)
    }

    async fn home_z(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<bool, DeviceError> {
        self.usage = Some(usage.clone());
        // a group with other axes homes them in the same operation
        let is_alone = self.groups[0].axes == [Axis::Z];
        if is_alone {
            self.prepare(0, usage, orders).await?;
        }
        Ok(is_alone)
    }

    async fn home(&mut self, usage: &StageUse, orders: &MotionOrders) -> Result<(), DeviceError> {
        for nth in 0..self.groups.len() {
            self.prepare(nth, usage, orders).await?;
        }
        (self.usage, self.all_homed) = (Some(usage.clone()), true);
        for axis in Axis::ALL {
            self.place_mm("reading a position", axis, orders).await?;
        }
        Ok(())
    }

    fn usage(&self) -> Option<&StageUse> {
        self.usage.as_ref()
    }

    fn error(&self, doing: &str, problem: DeviceProblem) -> DeviceError {
        self.asks.error(doing, problem)
    }

    /// Nothing comes in unasked.
    async fn rest(&mut self, _: bool, _: &MotionOrders) -> Result<Option<RestPlace>, DeviceError> {
        Ok(None)
    }

    async fn send(
        &mut self,
        ways: &[AxisWay],
        speed_mm_s: f64,
        _: &StageUse,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        // a group takes one motion at a time; the current one ends at a safe point
        let until = Instant::now() + MOTION_MARGIN;
        let which = self.groups_of(&ways.iter().map(|way| way.axis).collect::<Vec<_>>());
        while self.until_ended(&which, "waiting for the previous motion", until, orders).await?.is_none() {
            if orders.stopped() && orders.take().is_some() {
                self.stop().await?;
            }
        }
        for way in ways {
            self.shape(way.axis, speed_mm_s, orders).await?;
        }
        let motions = self.motions_of(ways, orders).await?;
        self.start(motions, orders).await
    }

    async fn follow(
        &mut self,
        axes: &[Axis],
        expected: Duration,
        orders: &MotionOrders,
    ) -> Result<Vec<f64>, DeviceError> {
        let doing = "waiting for a motion to end";
        let until = Instant::now() + expected + MOTION_MARGIN;
        let which = self.groups_of(axes);
        for &nth in &which {
            if self.groups[nth].under_way.is_none() {
                self.until_still(nth, doing, MOTION_MARGIN).await?;
            }
        }
        loop {
            match orders.take() {
                Some(MotionOrder::Stop) => self.stop().await?,
                Some(MotionOrder::Speed(mm_s)) => self.change_speed(&which, mm_s, orders).await?,
                None => {}
            }
            if self.until_ended(&which, doing, until, orders).await?.is_some() {
                break;
            }
        }
        let mut places_mm = Vec::with_capacity(axes.len());
        for &axis in axes {
            places_mm.push(self.place_mm(doing, axis, orders).await?);
        }
        Ok(places_mm)
    }

    async fn position_mm(&mut self, axis: Axis, orders: &MotionOrders) -> Result<f64, DeviceError> {
        self.place_mm("reading a position", axis, orders).await
    }

    async fn stop(&mut self) -> Result<(), DeviceError> {
        self.abort_groups(&(0..self.groups.len()).collect::<Vec<_>>()).await
    }

    /// Aborts all motions, on sockets of their own, and cuts the power if z holds without it.
    async fn abort(&mut self) -> Result<(), DeviceError> {
        self.stop().await?;
        if self.usage.as_ref().is_some_and(|usage| usage.z_holds_unpowered) {
            for nth in 0..self.groups.len() {
                self.brakes.kill(nth, "stopping it at once").await?;
            }
        }
        Ok(())
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
