//! Motions of the groups: begun together, ended one by one, stopped together.

use super::CALL_DEADLINE;
use super::groups::{DrivenGroup, GroupMotion, first_answer};
use super::stage::{Xps, numbers, state};
use super::text::GroupState;
use crate::MOTION_MARGIN;
use palpate_core::quantity::Axis;
use palpate_link::device::{AxisWay, DeviceError, DeviceProblem, MotionOrders, STARTING, Stage, WAY_MM};
use palpate_link::time::Instant;
use std::time::Duration;

/// Longest time from a motion's call until the group moves or has moved.
const TAKEN_DEADLINE: Duration = Duration::from_secs(1);

/// Largest distance of a read-back from the setpoint, mm: what the mechanics lack at rest.
const SENT_MM: f64 = 0.02;

/// Longest wait for the answer to an aborted motion. Then the group's status shows its result.
const ABORTED_ANSWER_DEADLINE: Duration = Duration::from_secs(1);

/// Code with which an aborted motion is answered.
const ABORTED: i32 = -27;

impl Xps {
    /// Returns the motions of the groups that some axes are in: one positioner, or the complete group, whose other axes don't move.
    pub(super) async fn motions_of(
        &mut self,
        ways: &[AxisWay],
        orders: &MotionOrders,
    ) -> Result<Vec<(usize, GroupMotion)>, DeviceError> {
        let mut all = Vec::with_capacity(ways.len());
        for way in ways {
            let sent_mm = match self.sent_mm[way.axis.index()] {
                Some(sent_mm) => sent_mm,
                None => {
                    let call = format!("GroupPositionSetpointGet({},double *)", self.positioner(way.axis));
                    let Xps { asks, brakes, .. } = self;
                    let [sent_mm] = brakes.ready_during(orders, numbers(asks, "reading a setpoint", &call)).await?;
                    self.note_abort(orders);
                    self.sent_mm[way.axis.index()] = Some(sent_mm);
                    sent_mm
                }
            };
            // near where it was read back; otherwise somebody else set another place or zero
            let near = self.usage.as_ref().filter(|_| self.all_homed && (sent_mm - way.from_mm).abs() <= SENT_MM);
            all.push(near.map_or(*way, |usage| {
                let by_mm = usage.from_count(way, sent_mm, WAY_MM);
                AxisWay { axis: way.axis, from_mm: sent_mm, by_mm }
            }));
        }
        let axes: Vec<Axis> = ways.iter().map(|way| way.axis).collect();
        let motion = |nth: usize| {
            let DrivenGroup { name, axes, .. } = &self.groups[nth];
            let own: Vec<AxisWay> = all.iter().copied().filter(|way| axes.contains(&way.axis)).collect();
            let call = match own[..] {
                [way] => format!("GroupMoveRelative({},{:.6})", self.positioner(way.axis), way.by_mm),
                _ => {
                    let by_mm = |axis: &Axis| own.iter().find(|way| way.axis == *axis).map_or(0.0, |way| way.by_mm);
                    let all: String = axes.iter().map(|axis| format!(",{:.6}", by_mm(axis))).collect();
                    format!("GroupMoveRelative({name}{all})")
                }
            };
            (nth, GroupMotion { call, ways: own, aborted: false })
        };
        Ok(self.groups_of(&axes).into_iter().map(motion).collect())
    }

    /// Sends motions, one to each group, and waits until each group moves or has moved. A stop during this time is sent at once.
    /// If one group doesn't start, all are stopped.
    pub(super) async fn start(
        &mut self,
        motions: Vec<(usize, GroupMotion)>,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let started = self.start_all(motions, orders).await;
        self.all_or_none(started).await
    }

    async fn start_all(
        &mut self,
        motions: Vec<(usize, GroupMotion)>,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let doing = STARTING;
        let mut sent = Vec::new();
        for (nth, motion) in motions {
            if orders.stopped() {
                break;
            }
            motion.ways.iter().for_each(|way| self.sent_mm[way.axis.index()] = None);
            let group = &mut self.groups[nth];
            group.moves.begin(doing, &motion.call, CALL_DEADLINE).await?;
            group.under_way = Some(motion);
            sent.push(nth);
        }
        for nth in sent {
            self.until_taken(nth, doing, orders).await?;
        }
        Ok(())
    }

    /// Waits until a group moves or has moved.
    async fn until_taken(&mut self, nth: usize, doing: &str, orders: &MotionOrders) -> Result<(), DeviceError> {
        let until = Instant::now() + TAKEN_DEADLINE;
        while Instant::now() < until {
            let Xps { asks, brakes, groups, .. } = self;
            let state = brakes.ready_during(orders, state(asks, &groups[nth].name, doing)).await?;
            self.note_abort(orders);
            if state == GroupState::Moving {
                // an abort that came before the motion stopped nothing
                if orders.stopped() {
                    orders.take();
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
                motion.ways.iter().for_each(|way| self.sent_mm[way.axis.index()] = Some(way.to_mm()));
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
            let _ = self.stop().await; // the failure is reported
        }
        done
    }

    /// Waits for the end of the motions of some groups. Returns `None` if an order comes first. If one motion fails,
    /// all are stopped.
    pub(super) async fn until_ended(
        &mut self,
        which: &[usize],
        doing: &str,
        until: Instant,
        orders: &MotionOrders,
    ) -> Result<Option<()>, DeviceError> {
        let ended = self.until_each_ended(which, doing, until, orders).await;
        self.all_or_none(ended).await
    }

    async fn until_each_ended(
        &mut self,
        which: &[usize],
        doing: &str,
        until: Instant,
        orders: &MotionOrders,
    ) -> Result<Option<()>, DeviceError> {
        loop {
            for &nth in which {
                let group = &mut self.groups[nth];
                if group.under_way.is_some() && !group.moves.is_owed() {
                    // its socket was lost: the group's status shows the result of the motion
                    group.under_way = None;
                    self.until_still(nth, doing, MOTION_MARGIN).await?;
                }
            }
            if which.iter().all(|&nth| self.groups[nth].under_way.is_none()) {
                return Ok(Some(()));
            }
            let is_aborted = |nth: &usize| self.groups[*nth].under_way.as_ref().is_none_or(|motion| motion.aborted);
            let are_aborted = which.iter().all(is_aborted);
            let by = if are_aborted { until.min(Instant::now() + ABORTED_ANSWER_DEADLINE) } else { until };
            tokio::select! {
                biased;
                () = orders.pulled().notified() => return Ok(None),
                (nth, answer) = first_answer(&mut self.groups, which, doing, by) => match answer? {
                    Some(answer) => self.ended(nth, doing, answer.code)?,
                    // its answer was lost
                    None if are_aborted => self.groups[nth].moves.close(),
                    None => {
                        self.stop().await?;
                        self.groups[nth].moves.close();
                        let text = format!("still moving {} s after it should have ended", MOTION_MARGIN.as_secs());
                        return Err(self.error(doing, DeviceProblem::Motion(text)));
                    }
                },
            }
        }
    }

    /// Makes what is left of the motions at another speed, with new ones. An S-gamma motion keeps its initial speed.
    pub(super) async fn change_speed(
        &mut self,
        which: &[usize],
        mm_s: f64,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let motions = which.iter().filter_map(|&nth| self.groups[nth].under_way.as_ref());
        let ways: Vec<AxisWay> = motions.flat_map(|motion| motion.ways.clone()).collect();
        if ways.is_empty() {
            return Ok(());
        }
        self.abort_groups(which).await?;
        let (doing, until) = ("changing a speed", Instant::now() + MOTION_MARGIN);
        self.until_ended(which, doing, until, &MotionOrders::default()).await?;
        let mut left = Vec::with_capacity(ways.len());
        for way in ways {
            self.shape(way.axis, mm_s, orders).await?;
            let at_mm = self.place_mm(doing, way.axis, orders).await?;
            left.push(AxisWay::between(way.axis, at_mm, way.to_mm()));
        }
        let motions = self.motions_of(&left, orders).await?;
        self.start(motions, orders).await
    }

    /// Aborts the motions of some groups.
    pub(super) async fn abort_groups(&mut self, which: &[usize]) -> Result<(), DeviceError> {
        for &nth in which {
            if let Some(motion) = &mut self.groups[nth].under_way {
                motion.aborted = true;
            }
        }
        self.brakes.abort(which).await
    }
}
