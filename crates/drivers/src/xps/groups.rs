//! The controller's groups that make up the stage: one group of three positioners, or several smaller groups.

use super::CALL_DEADLINE;
use super::guard::Armed;
use super::socket::Socket;
use super::text::XpsReply;
use palpate_core::quantity::Axis;
use palpate_link::device::{AxisWay, DeviceError, MotionOrders};
use palpate_link::time::Instant;
use std::cell::Cell;
use std::future::poll_fn;
use std::pin::Pin;
use std::task::Poll;

/// Number of attempts for the abort, each on a new socket.
const ABORT_TRIES: usize = 2;

/// Code "not allowed in this state": the answer to an abort if nothing moves.
const NOT_ALLOWED: i32 = -22;

/// Positioners of the stage in the controller's groups.
#[derive(Clone, Debug, PartialEq)]
pub struct Grouping {
    /// Positioners of x, y and z. Those of one group are in it in this order.
    pub positioners: [PositionerName; 3],
    /// Whether a group that isn't homed may be homed. The way to its home must be clear of the specimen, in the axis order that
    /// is set in the controller. The program can't read this order.
    pub home_search: bool,
}

/// A positioner, as in `XY.X`.
#[derive(Clone, Debug, PartialEq)]
pub struct PositionerName {
    /// Name of its group.
    pub group: String,
    /// Its name in the group.
    pub name: String,
}

impl Grouping {
    /// Returns one group with the positioners of x, y and z.
    pub fn one(group: &str, positioners: [&str; 3], home_search: bool) -> Self {
        let positioners = positioners.map(|name| PositionerName { group: group.to_owned(), name: name.to_owned() });
        Grouping { positioners, home_search }
    }

    /// Returns the groups with the axes of each, z's group first. So z is homed, stopped and guarded before the others.
    pub(super) fn groups(&self) -> Vec<(String, Vec<Axis>)> {
        let mut groups: Vec<(String, Vec<Axis>)> = Vec::new();
        for axis in [Axis::Z, Axis::X, Axis::Y] {
            let PositionerName { group, .. } = &self.positioners[axis.index()];
            match groups.iter_mut().find(|(name, _)| name == group) {
                Some((_, axes)) => axes.push(axis),
                None => groups.push((group.clone(), vec![axis])),
            }
        }
        groups.iter_mut().for_each(|(_, axes)| axes.sort_by_key(|axis| axis.index()));
        groups
    }
}

/// One group: its axes, the socket of its motions, and its motion.
pub(super) struct DrivenGroup {
    pub name: String,
    pub axes: Vec<Axis>,
    pub moves: Socket,
    pub armed: Option<Armed>,
    /// Motion whose end the motion socket hasn't reported yet.
    pub under_way: Option<GroupMotion>,
}

#[derive(Clone, Debug)]
pub(super) struct GroupMotion {
    pub call: String,
    pub ways: Vec<AxisWay>,
    /// Whether this program requested the abort.
    pub aborted: bool,
}

/// The sockets that stay free for the abort, one for each group.
pub(super) struct Brakes {
    pub groups: Vec<(String, Socket)>,
}

impl Brakes {
    /// Aborts the motions of some groups, all at once. It isn't an error if nothing moves.
    pub(super) async fn abort(&mut self, which: &[usize]) -> Result<(), DeviceError> {
        let groups = self.groups.iter_mut().enumerate().filter(|(nth, _)| which.contains(nth));
        all(groups.map(|(_, (group, socket))| abort_one(socket, group)).collect()).await
    }

    /// Stops a group and turns its motors off.
    pub(super) async fn kill(&mut self, nth: usize, doing: &str) -> Result<(), DeviceError> {
        let (group, socket) = &mut self.groups[nth];
        socket.call_plainly(doing, &format!("GroupKill({group})"), CALL_DEADLINE).await.map(|_| ())
    }

    /// Waits for the answer on another socket. A stop requested during this time is sent to all groups.
    pub(super) async fn ready_during<T>(
        &mut self,
        orders: &MotionOrders,
        asked: impl Future<Output = Result<T, DeviceError>>,
    ) -> Result<T, DeviceError> {
        let sending = Cell::new(false);
        let every: Vec<usize> = (0..self.groups.len()).collect();
        let abort = async {
            // the follower of the motion sends another speed
            while !orders.stopped() {
                orders.pulled().notified().await;
            }
            if orders.take().is_none() {
                return std::future::pending().await; // it was sent already
            }
            sending.set(true);
            self.abort(&every).await
        };
        tokio::pin!(asked, abort);
        tokio::select! {
            biased;
            aborted = &mut abort => {
                aborted?;
                asked.await
            }
            answer = &mut asked => {
                // an abort in progress is completed: dropped before its socket is open it would never be sent
                if sending.get() {
                    abort.await?;
                }
                answer
            }
        }
    }
}

async fn abort_one(socket: &mut Socket, group: &str) -> Result<(), DeviceError> {
    let (doing, call) = ("stopping", format!("GroupMoveAbort({group})"));
    let mut text = Ok(());
    for _ in 0..ABORT_TRIES {
        text = match socket.call_plainly(doing, &call, CALL_DEADLINE).await {
            Ok(XpsReply { code: 0 | NOT_ALLOWED, .. }) => return Ok(()),
            Ok(XpsReply { code, .. }) => Err(socket.refused(doing, &call, code)),
            Err(error) => Err(error),
        };
    }
    text
}

/// Waits for the first answer to a motion of some groups, until a time. Returns the group that it belongs to. At least one of them
/// has a motion. The future may be dropped while it waits.
pub(super) async fn first_answer(
    groups: &mut [DrivenGroup],
    which: &[usize],
    doing: &str,
    until: Instant,
) -> (usize, Result<Option<XpsReply>, DeviceError>) {
    let moving = groups.iter_mut().enumerate().filter(|(nth, group)| which.contains(nth) && group.under_way.is_some());
    let mut answers: Vec<_> = moving.map(|(nth, group)| (nth, Box::pin(group.moves.answer_by(doing, until)))).collect();
    poll_fn(|cx| {
        for (nth, answer) in &mut answers {
            if let Poll::Ready(answer) = answer.as_mut().poll(cx) {
                return Poll::Ready((*nth, answer));
            }
        }
        Poll::Pending
    })
    .await
}

/// Runs futures at the same time, each to its end. Returns the first error.
async fn all<F: Future<Output = Result<(), DeviceError>>>(futures: Vec<F>) -> Result<(), DeviceError> {
    let mut running: Vec<Pin<Box<F>>> = futures.into_iter().map(Box::pin).collect();
    let mut result = Ok(());
    poll_fn(move |cx| {
        running.retain_mut(|future| match future.as_mut().poll(cx) {
            Poll::Ready(ended) => {
                result = std::mem::replace(&mut result, Ok(())).and(ended);
                false
            }
            Poll::Pending => true,
        });
        if running.is_empty() { Poll::Ready(std::mem::replace(&mut result, Ok(()))) } else { Poll::Pending }
    })
    .await
}
