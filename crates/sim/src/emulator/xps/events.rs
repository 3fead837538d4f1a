//! Events that the controller watches for by itself: the guard of a move.

use super::errors::Code;
use super::group::{EmulatedGroup, XpsObject, object};
use super::syntax::Call;
use crate::scene::Scene;

/// Largest number of simultaneously started events.
const EVENTS_MOST: usize = 10;
/// Largest number of conditions of one event.
const CONDITIONS_MOST: usize = 10;
/// Number of analog inputs, from `GPIO2.ADC1` on.
const INPUTS: usize = 4;

/// Extended events, which the controller checks by itself, once in each servo tick. Conditions: an analog input over or under a
/// limit (`GPIO2.ADC1.ADCHighLimit`, `ADCLowLimit`), and a motion (`XYZ.SGamma.MotionState`, also of one positioner). The only
/// action: `XYZ.MoveAbort`.
#[derive(Default)]
pub(super) struct ExtendedEvents {
    conditions: Vec<EventCondition>,
    /// Index of the group that the configured action aborts.
    aborts: Option<usize>,
    started: Vec<ExtendedEvent>,
    last_id: i32,
}

struct ExtendedEvent {
    id: i32,
    conditions: Vec<EventCondition>,
    aborts: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum EventCondition {
    Over { input: usize, limit_v: f64 },
    Under { input: usize, limit_v: f64 },
    Moving(XpsObject),
}

impl ExtendedEvents {
    /// `EventExtendedConfigurationTriggerSet(name,p1,p2,p3,p4,...)`: sets the conditions, which must all be met.
    pub(super) fn set_conditions(&mut self, call: &mut Call, groups: &[EmulatedGroup]) -> Result<(), Code> {
        let mut conditions = Vec::new();
        while conditions.is_empty() || !call.is_through() {
            conditions.push(EventCondition::read(call, groups)?);
        }
        if conditions.len() > CONDITIONS_MOST {
            return Err(Code::OUT_OF_RANGE);
        }
        self.conditions = conditions;
        Ok(())
    }

    /// `EventExtendedConfigurationActionSet(name,p1,p2,p3,p4)`: sets the action.
    pub(super) fn set_action(&mut self, call: &mut Call, groups: &[EmulatedGroup]) -> Result<(), Code> {
        let name = call.text()?;
        let Some(Ok(XpsObject::Group(aborts))) = name.strip_suffix(".MoveAbort").map(|name| object(groups, name))
        else {
            return Err(Code::ACTION_NAME);
        };
        for _ in 0..4 {
            call.text()?;
        }
        self.aborts = Some(aborts);
        Ok(())
    }

    /// `EventExtendedStart`: returns the id of a new event.
    pub(super) fn start(&mut self) -> Result<i32, Code> {
        if self.conditions.is_empty() {
            return Err(Code::NO_EVENTS);
        }
        let aborts = self.aborts.ok_or(Code::NO_ACTIONS)?;
        if self.started.len() == EVENTS_MOST {
            return Err(Code::TOO_MANY_EVENTS);
        }
        self.last_id += 1;
        self.started.push(ExtendedEvent { id: self.last_id, conditions: self.conditions.clone(), aborts });
        Ok(self.last_id)
    }

    /// `EventExtendedRemove`: removes an event.
    pub(super) fn remove(&mut self, id: i32) -> Result<(), Code> {
        let index = self.started.iter().position(|event| event.id == id).ok_or(Code::EVENT_UNKNOWN)?;
        self.started.remove(index);
        Ok(())
    }

    /// Whether any event is started.
    pub(super) fn armed(&self) -> bool {
        !self.started.is_empty()
    }

    /// Returns the groups that the events that happen now abort. `moves` are the groups' positioners that move, and `volts`
    /// returns the input voltages. Events that have happened are removed.
    pub(super) fn happen(&mut self, mut volts: impl FnMut(usize) -> f64, moves: &[Vec<bool>]) -> Vec<usize> {
        let mut aborted = Vec::new();
        self.started.retain(|event| {
            let met = event.conditions.iter().all(|condition| condition.is_met(&mut volts, moves));
            if met {
                aborted.push(event.aborts);
            }
            !met
        });
        aborted
    }
}

impl EventCondition {
    fn read(call: &mut Call, groups: &[EmulatedGroup]) -> Result<Self, Code> {
        let name = call.text()?;
        let moving = name.strip_suffix(".SGamma.MotionState").and_then(|name| object(groups, name).ok());
        let limited = [(".ADCHighLimit", true), (".ADCLowLimit", false)];
        let limited = limited.iter().find_map(|(suffix, over)| Some((input(name.strip_suffix(suffix)?)?, *over)));
        let mut parameters = 4;
        let condition = match (moving, limited) {
            (Some(object), _) => EventCondition::Moving(object),
            (_, Some((input, over))) => {
                let limit_v = call.number()?;
                parameters -= 1;
                if over { EventCondition::Over { input, limit_v } } else { EventCondition::Under { input, limit_v } }
            }
            _ => return Err(Code::EVENT_NAME),
        };
        for _ in 0..parameters {
            call.text()?;
        }
        Ok(condition)
    }

    fn is_met(self, mut volts: impl FnMut(usize) -> f64, moves: &[Vec<bool>]) -> bool {
        match self {
            EventCondition::Over { input, limit_v } => volts(input) > limit_v,
            EventCondition::Under { input, limit_v } => volts(input) < limit_v,
            EventCondition::Moving(XpsObject::Group(group)) => moves[group].contains(&true),
            EventCondition::Moving(XpsObject::Positioner(group, index)) => moves[group][index],
        }
    }
}

/// Returns the index of the analog input with this name, from 0.
pub(super) fn input(name: &str) -> Option<usize> {
    let number: usize = name.strip_prefix("GPIO2.ADC")?.parse().ok()?;
    (1..=INPUTS).contains(&number).then(|| number - 1)
}

/// Returns the voltage on an analog input, V: the load cell on the first input, zero on the others.
pub(super) fn input_v(input: usize, volts_per_newton: f64, scene: &mut Scene, now_s: f64) -> f64 {
    if input == 0 { (scene.load_cell_n(now_s) * volts_per_newton).clamp(-RANGE_V, RANGE_V) } else { 0.0 }
}

/// Range of the analog inputs, +- V.
const RANGE_V: f64 = 10.0;
