//! Motions of the groups: begun together, ended one by one, stopped together.

use super::CALL_DEADLINE;
use super::groups::{DrivenGroup, GroupMotion, first_answer};
use super::stage::{AT_REST_MM, Xps, state};
use super::text::GroupState;
use crate::MOTION_MARGIN;
use palpate_core::quantity::Axis;
use palpate_link::device::{DeviceError, DeviceProblem, MotionOrders, Stage};
use palpate_link::time::Instant;
use std::time::Duration;

/// Longest time from a motion's call until the group moves or has moved.
const TAKEN_DEADLINE: Duration = Duration::from_secs(1);

/// Code with which an aborted motion is answered.
const ABORTED: i32 = -27;

impl Xps {
    /// Returns the motions of the groups that some axes are in: one positioner, or the complete group. A group's other axes stay
    /// where they were sent.
    pub(super) async fn motions_to(
        &mut self,
        targets: &[(Axis, f64)],
    ) -> Result<Vec<(usize, GroupMotion)>, DeviceError> {
        let axes: Vec<Axis> = targets.iter().map(|(axis, _)| *axis).collect();
        let mut motions = Vec::new();
        for nth in self.groups_of(&axes) {
            let DrivenGroup { name, axes, .. } = &self.groups[nth];
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
            motions.push((nth, GroupMotion { call, targets: own, aborted: false }));
        }
        Ok(motions)
    }

    /// Returns the position of an axis that was stopped before its target. Two answers must agree, because the axis is commanded
    /// to stay there.
    async fn rest_mm(&mut self, axis: Axis) -> Result<f64, DeviceError> {
        let doing = "reading the position of an axis";
        let alone = MotionOrders::default();
        let (first_mm, again_mm) =
            (self.place_mm(doing, axis, &alone).await?, self.place_mm(doing, axis, &alone).await?);
        if (first_mm - again_mm).abs() > AT_REST_MM {
            let text =
                format!("{} is at {first_mm} mm and then at {again_mm} mm, although it doesn't move", axis.name());
            return Err(self.error(doing, DeviceProblem::Motion(text)));
        }
        Ok(first_mm)
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
        let doing = "starting a motion";
        let mut sent = Vec::new();
        for (nth, motion) in motions {
            if orders.stopped() {
                break;
            }
            motion.targets.iter().for_each(|(axis, _)| self.sent_mm[axis.index()] = None);
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
            tokio::select! {
                biased;
                () = orders.pulled().notified() => return Ok(None),
                (nth, answer) = first_answer(&mut self.groups, which, doing, until) => match answer? {
                    Some(answer) => self.ended(nth, doing, answer.code)?,
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

    /// Continues toward the same targets at another speed, with new motions. An S-gamma motion keeps its initial speed.
    pub(super) async fn change_speed(
        &mut self,
        which: &[usize],
        mm_s: f64,
        orders: &MotionOrders,
    ) -> Result<(), DeviceError> {
        let motions = which.iter().filter_map(|&nth| self.groups[nth].under_way.as_ref());
        let targets: Vec<_> = motions.flat_map(|motion| motion.targets.clone()).collect();
        if targets.is_empty() {
            return Ok(());
        }
        self.abort(which).await?;
        let until = Instant::now() + MOTION_MARGIN;
        self.until_ended(which, "changing a speed", until, &MotionOrders::default()).await?;
        for (axis, _) in &targets {
            self.shape(*axis, mm_s, orders).await?;
        }
        let motions = self.motions_to(&targets).await?;
        self.start(motions, orders).await
    }

    /// Aborts the motions of some groups.
    pub(super) async fn abort(&mut self, which: &[usize]) -> Result<(), DeviceError> {
        for &nth in which {
            if let Some(motion) = &mut self.groups[nth].under_way {
                motion.aborted = true;
            }
        }
        self.brakes.abort(which).await
    }
}
