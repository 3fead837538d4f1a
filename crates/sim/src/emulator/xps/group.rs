//! A group: its life cycle, its homing and its motions.

use super::errors::Code;
use super::positioner::EmulatedPositioner;
use crate::scene::Scene;
use palpate_core::quantity::Axis;
use std::sync::{Arc, OnceLock};

/// Duration of the initialisation of the motors, s.
const INITIALIZE_S: f64 = 0.3;
/// Duration of the calibration of the encoders before the initialisation, s. The stage doesn't move during it here.
const CALIBRATE_S: f64 = 2.0;

/// Object of a call, by index: a group, or a positioner of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum XpsObject {
    Group(usize),
    Positioner(usize, usize),
}

/// Returns the object with this name: a group, or `group.positioner`.
pub(super) fn object(groups: &[EmulatedGroup], name: &str) -> Result<XpsObject, Code> {
    let index_of = |name: &str| groups.iter().position(|group| group.name == name);
    let Some((group, positioner)) = name.split_once('.') else {
        return index_of(name).map(XpsObject::Group).ok_or(Code::GROUP_NAME);
    };
    let group = index_of(group).ok_or(Code::POSITIONER_NAME)?;
    let index = groups[group].positioners.iter().position(|each| each.name == positioner);
    index.map(|index| XpsObject::Positioner(group, index)).ok_or(Code::POSITIONER_NAME)
}

/// Possible states of a group, by their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GroupStatus {
    NotInitialized = 0,
    Killed = 7,
    ReadyFromAbort = 10,
    ReadyFromHoming = 11,
    ReadyFromMotion = 12,
    ReadyFromEnable = 13,
    Disabled = 20,
    Braking = 40,
    Initializing = 41,
    NotReferenced = 42,
    Homing = 43,
    Moving = 44,
    Calibrating = 49,
}

/// Future result of a call that is answered when it is finished. The group writes it, and the waiting link reads it. A closed
/// link has dropped it.
pub(super) type PendingReply = Arc<OnceLock<Code>>;

/// One group of one to three positioners, its life cycle and its motions. It does one thing at a time.
pub(super) struct EmulatedGroup {
    name: String,
    pub positioners: Vec<EmulatedPositioner>,
    state: GroupStatus,
    action: Option<GroupAction>,
    /// Whether something that a link may wait for has begun or ended.
    pub stirred: bool,
}

/// Present action of the group, until an instant.
struct GroupAction {
    end_s: f64,
    then: Then,
    /// Result code if the activity isn't interrupted.
    code: Code,
    outcome: PendingReply,
}

/// Next state after an operation.
#[derive(Clone, Copy)]
enum Then {
    Rest(GroupStatus),
    /// z is homed; x and y are next.
    HomeOthers,
    /// All axes are homed.
    Homed,
}

impl GroupStatus {
    /// Returns the text of `GroupStatusStringGet` for a number.
    pub(super) fn text(number: i32) -> &'static str {
        match number {
            0 => "Not initialized state",
            7 => "Not initialized state due to a GroupKill or KillAll command",
            10 => "Ready state due to an AbortMove command",
            11 => "Ready state from homing",
            12 => "Ready state from motion",
            13 => "Ready state due to a MotionEnable command",
            20 => "Disable state",
            40 => "Emergency braking",
            41 => "Motor initialization state",
            42 => "Not referenced state",
            43 => "Homing state",
            44 => "Moving state",
            49 => "Encoder calibrating state",
            1..=9 => "Not initialized state for another reason",
            14..=19 => "Ready state for another reason",
            21..=39 => "Disable state for another reason",
            _ => "Unknown state",
        }
    }

    fn is_ready(self) -> bool {
        (10..=19).contains(&(self as i32))
    }
}

impl EmulatedGroup {
    /// Creates a group as it is at power-on.
    pub(super) fn new(name: &str, positioners: Vec<EmulatedPositioner>) -> Self {
        EmulatedGroup {
            name: name.into(),
            positioners,
            state: GroupStatus::NotInitialized,
            action: None,
            stirred: false,
        }
    }

    /// Restarts as at power-on. The axes come to rest, and count zero there.
    pub(super) fn restart(&mut self, scene: &mut Scene, now_s: f64) {
        self.positioners.iter().for_each(|positioner| positioner.brake(scene, now_s));
        let fresh = |old: &EmulatedPositioner| EmulatedPositioner::new(&old.name, old.axis, scene);
        let positioners = self.positioners.iter().map(fresh).collect();
        *self = EmulatedGroup { stirred: true, ..EmulatedGroup::new(&self.name, positioners) };
    }

    /// The number of its state.
    pub(super) fn status(&self) -> i32 {
        self.state as i32
    }

    /// Whether there is a motion that an abort can stop and that hasn't been aborted.
    pub(super) fn can_be_aborted(&self) -> bool {
        self.state == GroupStatus::Moving && self.action.as_ref().is_some_and(|action| action.code == Code::DONE)
    }

    /// Whether each positioner moves.
    pub(super) fn moves(&self, scene: &Scene, now_s: f64) -> Vec<bool> {
        self.positioners.iter().map(|positioner| positioner.moves(scene, now_s)).collect()
    }

    /// Time at which the activity ends, s; infinite if it never ends by itself.
    pub(super) fn end_s(&self) -> f64 {
        self.action.as_ref().map_or(f64::INFINITY, |action| action.end_s)
    }

    /// Whether no link waits for the activity.
    pub(super) fn is_unattended(&self) -> bool {
        self.action.as_ref().is_none_or(|action| Arc::strong_count(&action.outcome) == 1)
    }

    /// Applies the effects of everything that has ended by `now_s`.
    pub(super) fn notice(&mut self, scene: &mut Scene, now_s: f64) {
        while let Some(action) = self.action.take_if(|action| action.end_s <= now_s) {
            match action.then {
                Then::Rest(state) => self.rest(state, action.code, &action.outcome),
                Then::HomeOthers => {
                    self.positioners
                        .iter_mut()
                        .filter(|each| each.axis == Axis::Z)
                        .for_each(EmulatedPositioner::set_homed);
                    self.home(|axis| axis != Axis::Z, Then::Homed, action.outcome, scene, now_s);
                }
                Then::Homed => {
                    self.positioners.iter_mut().for_each(EmulatedPositioner::set_homed);
                    self.rest(GroupStatus::ReadyFromHoming, action.code, &action.outcome);
                }
            }
        }
    }

    /// `GroupInitialize`, and `GroupInitializeWithEncoderCalibration`: from not initialised to not referenced.
    pub(super) fn initialize(&mut self, calibrates: bool, scene: &Scene, now_s: f64) -> Result<PendingReply, Code> {
        self.must(matches!(self.state, GroupStatus::NotInitialized | GroupStatus::Killed))?;
        self.positioners.iter_mut().for_each(|positioner| positioner.reset_encoder(scene));
        let end_s = now_s + INITIALIZE_S + if calibrates { CALIBRATE_S } else { 0.0 };
        let state = if calibrates { GroupStatus::Calibrating } else { GroupStatus::Initializing };
        Ok(self.begin(state, end_s, Then::Rest(GroupStatus::NotReferenced)))
    }

    /// `GroupHomeSearch`: z if it is in the group, then x and y together.
    pub(super) fn home_search(&mut self, scene: &mut Scene, now_s: f64) -> Result<PendingReply, Code> {
        self.must(self.state == GroupStatus::NotReferenced)?;
        self.state = GroupStatus::Homing;
        self.stirred = true;
        let outcome = PendingReply::default();
        if self.positioners.len() > 1 && self.positioners.iter().any(|each| each.axis == Axis::Z) {
            self.home(|axis| axis == Axis::Z, Then::HomeOthers, outcome.clone(), scene, now_s);
        } else {
            self.home(|_| true, Then::Homed, outcome.clone(), scene, now_s);
        }
        Ok(outcome)
    }

    /// `GroupMoveAbsolute`: the positioners with a target start together and arrive together.
    pub(super) fn move_to(
        &mut self,
        counts_mm: &[Option<f64>],
        scene: &mut Scene,
        now_s: f64,
    ) -> Result<PendingReply, Code> {
        self.must(self.state.is_ready())?;
        self.must_allow(counts_mm)?;
        let end_s = self.start(counts_mm, scene, now_s);
        Ok(self.begin(GroupStatus::Moving, end_s, Then::Rest(GroupStatus::ReadyFromMotion)))
    }

    /// `GroupMoveRelative`: moves from the controller's setpoints.
    pub(super) fn move_by(
        &mut self,
        ways_mm: &[Option<f64>],
        scene: &mut Scene,
        now_s: f64,
    ) -> Result<PendingReply, Code> {
        let from = |(way_mm, positioner): (&Option<f64>, &EmulatedPositioner)| {
            way_mm.map(|way_mm| positioner.setpoint_mm(scene, now_s) + way_mm)
        };
        let counts_mm: Vec<_> = ways_mm.iter().zip(&self.positioners).map(from).collect();
        self.move_to(&counts_mm, scene, now_s)
    }

    /// `GroupMoveAbort`: stops each positioner with the deceleration of its motion. The move under way ends then, with its error.
    pub(super) fn abort(&mut self, scene: &mut Scene, now_s: f64) -> Result<(), Code> {
        self.must(self.state == GroupStatus::Moving)?;
        self.positioners.iter().for_each(|positioner| positioner.abort(scene, now_s));
        self.cut_short(GroupStatus::Moving, GroupStatus::ReadyFromAbort, Code::ABORTED, scene, now_s);
        Ok(())
    }

    /// `GroupKill`: stops as hard as the stage can, and turns the motors off.
    pub(super) fn kill(&mut self, scene: &mut Scene, now_s: f64) {
        self.positioners.iter().for_each(|positioner| positioner.brake(scene, now_s));
        self.cut_short(GroupStatus::Braking, GroupStatus::Killed, Code::EMERGENCY, scene, now_s);
        self.notice(scene, now_s);
    }

    /// `GroupMotionEnable` and `GroupMotionDisable`.
    pub(super) fn enable(&mut self, on: bool) -> Result<(), Code> {
        self.must(if on { self.state == GroupStatus::Disabled } else { self.state.is_ready() })?;
        self.state = if on { GroupStatus::ReadyFromEnable } else { GroupStatus::Disabled };
        Ok(())
    }

    /// `PositionerUserTravelLimitsSet`: within the travel, and not while something moves.
    pub(super) fn limit(&mut self, positioner: usize, limits_mm: (f64, f64)) -> Result<(), Code> {
        self.must(!matches!(self.state, GroupStatus::Moving | GroupStatus::Homing))?;
        let travel_mm = super::positioner::TRAVEL_MM;
        if limits_mm.0 < -travel_mm || limits_mm.1 > travel_mm || limits_mm.0 >= limits_mm.1 {
            return Err(Code::OUT_OF_RANGE);
        }
        self.positioners[positioner].limits_mm = limits_mm;
        Ok(())
    }

    fn must(&self, allowed: bool) -> Result<(), Code> {
        if allowed { Ok(()) } else { Err(Code::NOT_ALLOWED) }
    }

    fn must_allow(&self, counts_mm: &[Option<f64>]) -> Result<(), Code> {
        let within = self
            .positioners
            .iter()
            .zip(counts_mm.iter().copied())
            .filter_map(both)
            .all(|(each, count_mm)| each.allows(count_mm));
        if within { Ok(()) } else { Err(Code::OUT_OF_RANGE) }
    }

    fn begin(&mut self, state: GroupStatus, end_s: f64, then: Then) -> PendingReply {
        let outcome = PendingReply::default();
        self.state = state;
        self.stirred = true;
        self.action = Some(GroupAction { end_s, then, code: Code::DONE, outcome: outcome.clone() });
        outcome
    }

    fn home(&mut self, is_one: fn(Axis) -> bool, then: Then, outcome: PendingReply, scene: &mut Scene, now_s: f64) {
        let mut end_s = now_s;
        for positioner in self.positioners.iter().filter(|each| is_one(each.axis)) {
            positioner.go_home(scene, now_s);
            end_s = end_s.max(positioner.end_s(scene));
        }
        self.action = Some(GroupAction { end_s, then, code: Code::DONE, outcome });
    }

    /// Starts a group motion and returns its end time, s. The axis with the longest travel time moves at its own speed. The
    /// others are slowed so that all arrive together. An axis without a distance to move stays.
    fn start(&self, counts_mm: &[Option<f64>], scene: &mut Scene, now_s: f64) -> f64 {
        let time_s = |(positioner, count_mm): (&EmulatedPositioner, &Option<f64>)| {
            count_mm.map_or(0.0, |count_mm| positioner.time_to_s(count_mm, scene))
        };
        let times_s: Vec<f64> = self.positioners.iter().zip(counts_mm).map(time_s).collect();
        let longest_s = times_s.iter().copied().fold(0.0, f64::max);
        let mut end_s = now_s;
        for (time_s, (positioner, count_mm)) in times_s.into_iter().zip(self.positioners.iter().zip(counts_mm)) {
            if let Some(count_mm) = count_mm.filter(|_| time_s > 0.0) {
                positioner.go_to(count_mm, longest_s / time_s, scene, now_s);
                end_s = end_s.max(positioner.end_s(scene));
            }
        }
        end_s
    }

    /// Ends the action in progress with an error when all axes are at rest. Until then the group's state is `meanwhile`.
    fn cut_short(&mut self, meanwhile: GroupStatus, then: GroupStatus, code: Code, scene: &Scene, now_s: f64) {
        let end_s = self.positioners.iter().map(|positioner| positioner.end_s(scene)).fold(now_s, f64::max);
        let outcome = self.action.take().map(|action| action.outcome).unwrap_or_default();
        self.action = Some(GroupAction { end_s, then: Then::Rest(then), code, outcome });
        self.state = meanwhile;
        self.stirred = true;
    }

    fn rest(&mut self, state: GroupStatus, code: Code, outcome: &PendingReply) {
        self.state = state;
        self.stirred = true;
        // set once: an operation has one end
        let _ = outcome.set(code);
    }
}

/// Returns the pair if its second value is present.
fn both<A, B>((first, second): (A, Option<B>)) -> Option<(A, B)> {
    second.map(|second| (first, second))
}
