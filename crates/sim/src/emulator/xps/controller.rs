//! The controller behind all sockets: the effects of the calls.

use super::errors::{self, Code};
use super::events::{self, ExtendedEvents};
use super::fault::XpsFaultKind;
use super::group::{EmulatedGroup, PendingReply};
use super::syntax::{Call, Type, number, numbers};
use crate::emulator::faults::Faults;
use crate::scene::Scene;

/// Answer to `FirmwareVersionGet` and `InstallerVersionGet`.
const FIRMWARE: &str = "XPS-Q8 Firmware V2.6.4";
const INSTALLER: &str = "XPS-Q8 Installer V2.6.4";
/// Name of the only user, and the password.
const ADMINISTRATOR: &str = "Administrator";
/// Interval at which the controller itself reads its inputs, s. It is every tenth servo tick, and the resolution of tokio's
/// timers.
const TICK_S: f64 = 0.001;

/// The controller behind all sockets.
pub(super) struct Controller {
    pub(super) groups: Vec<EmulatedGroup>,
    events: ExtendedEvents,
    volts_per_newton: f64,
    /// Whether an event was started, which concerns every link that waits for a motion.
    stirred: bool,
    pub(super) faults: Faults<XpsFaultKind>,
    /// Number of restarts. A socket ends with the restart after it was opened.
    pub(super) restarts: u32,
    /// Time until which it restarts, s.
    pub(super) down_until_s: f64,
}

/// The result of a call.
pub(super) enum CallReply {
    /// These values, at once.
    Values(String),
    /// Result of a group's activity, when it ends.
    Later(PendingReply),
}

impl From<()> for CallReply {
    fn from((): ()) -> Self {
        CallReply::Values(String::new())
    }
}

impl From<PendingReply> for CallReply {
    fn from(outcome: PendingReply) -> Self {
        CallReply::Later(outcome)
    }
}

impl Controller {
    pub(super) fn new(groups: Vec<EmulatedGroup>, volts_per_newton: f64) -> Self {
        Controller {
            groups,
            events: ExtendedEvents::default(),
            volts_per_newton,
            stirred: false,
            faults: Faults::new(&[], &[]),
            restarts: 0,
            down_until_s: f64::NEG_INFINITY,
        }
    }

    /// Lets the faults happen that are due.
    fn fail(&mut self, scene: &mut Scene, now_s: f64) {
        self.faults.come(now_s);
        loop {
            let at_s = self.faults.next_s(XpsFaultKind::is_timed);
            match self.faults.take(now_s, XpsFaultKind::is_timed) {
                None => return,
                Some(XpsFaultKind::Restart { takes_s }) => {
                    self.groups.iter_mut().for_each(|group| group.restart(scene, now_s));
                    self.events = ExtendedEvents::default();
                    (self.restarts, self.down_until_s, self.stirred) = (self.restarts + 1, at_s + takes_s, true);
                }
                Some(XpsFaultKind::Other(calls)) if now_s >= self.down_until_s => {
                    for call in calls.lines() {
                        // nobody hears the answer
                        let _ = Call::read(call.as_bytes()).and_then(|call| self.run(call, scene, now_s));
                    }
                }
                Some(_) => {}
            }
        }
    }

    /// Applies the effects of everything that has ended by `now_s`, and triggers the events whose conditions are met.
    pub(super) fn notice(&mut self, scene: &mut Scene, now_s: f64) {
        self.fail(scene, now_s);
        self.groups.iter_mut().for_each(|group| group.notice(scene, now_s));
        if !self.guards() {
            return;
        }
        let moves: Vec<_> = self.groups.iter().map(|group| group.moves(scene, now_s)).collect();
        let volts = |input| events::input_v(input, self.volts_per_newton, scene, now_s);
        for group in self.events.happen(volts, &moves) {
            // a group that moves takes an abort
            let _ = self.groups[group].abort(scene, now_s);
        }
    }

    /// Next time at which [`notice`](Self::notice) may have something to do, s; infinite if there is none without a call.
    pub(super) fn next_s(&self, now_s: f64) -> f64 {
        let look_s = if self.guards() { now_s + TICK_S } else { f64::INFINITY };
        self.groups.iter().map(EmulatedGroup::end_s).fold(look_s, f64::min)
    }

    /// Whether no link waits for any group's activity.
    pub(super) fn is_unattended(&self) -> bool {
        self.groups.iter().all(EmulatedGroup::is_unattended)
    }

    /// Whether something that a link may wait for has begun or ended since the last call.
    pub(super) fn take_stirred(&mut self) -> bool {
        let stirred = std::mem::take(&mut self.stirred);
        self.groups.iter_mut().fold(stirred, |stirred, group| std::mem::take(&mut group.stirred) || stirred)
    }

    /// Executes a call.
    pub(super) fn run(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<CallReply, Code> {
        match call.name {
            "FirmwareVersionGet" => tell(call, Type::Char, FIRMWARE),
            "InstallerVersionGet" => tell(call, Type::Char, INSTALLER),
            "ElapsedTimeGet" => tell(call, Type::Double, &number(now_s)),
            "ErrorStringGet" => {
                let code = Code(call.whole()?);
                tell(call, Type::Char, code.text().ok_or(Code::OUT_OF_RANGE)?)
            }
            "ErrorListGet" => tell(call, Type::Char, &errors::list()),
            "Login" => {
                let known = call.text()? == ADMINISTRATOR && call.text()? == ADMINISTRATOR;
                if known { done(call) } else { Err(Code::LOGIN) }
            }
            "CloseAllOtherSockets" => done(call),
            "KillAll" => {
                done(call)?;
                self.groups.iter_mut().for_each(|group| group.kill(scene, now_s));
                Ok(().into())
            }
            "GPIOAnalogGet" => self.run_analog(call, scene, now_s),
            name if name.starts_with("Event") => self.run_event(call),
            name if name.starts_with("Positioner") => self.run_positioner(call, scene, now_s),
            name if name.starts_with("Group") => self.run_group(call, scene, now_s),
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }

    /// Whether the controller has to check its event conditions.
    fn guards(&self) -> bool {
        self.events.armed() && self.groups.iter().any(EmulatedGroup::can_be_aborted)
    }

    fn run_event(&mut self, mut call: Call) -> Result<CallReply, Code> {
        match call.name {
            "EventExtendedConfigurationTriggerSet" => {
                self.events.set_conditions(&mut call, &self.groups)?;
                done(call)
            }
            "EventExtendedConfigurationActionSet" => {
                self.events.set_action(&mut call, &self.groups)?;
                done(call)
            }
            "EventExtendedStart" => {
                call.results(Type::Int, 1)?;
                // a call that waits for a move now waits for this as well
                self.stirred = true;
                Ok(CallReply::Values(self.events.start()?.to_string()))
            }
            "EventExtendedRemove" => {
                let id = call.whole()?;
                call.end()?;
                self.events.remove(id).map(CallReply::from)
            }
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }

    /// `GPIOAnalogGet(name,double *,...)`.
    fn run_analog(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<CallReply, Code> {
        let mut volts = Vec::new();
        while volts.is_empty() || !call.is_through() {
            let input = events::input(call.text()?).ok_or(Code::OUT_OF_RANGE)?;
            call.result(Type::Double)?;
            volts.push(events::input_v(input, self.volts_per_newton, scene, now_s));
        }
        Ok(CallReply::Values(numbers(volts)))
    }
}

/// Returns one value of a type, if the call has a placeholder for it.
pub(super) fn tell(call: Call, result: Type, value: &str) -> Result<CallReply, Code> {
    call.results(result, 1)?;
    Ok(CallReply::Values(value.to_owned()))
}

/// Returns an empty answer, if the call has no further arguments.
fn done(call: Call) -> Result<CallReply, Code> {
    call.end()?;
    Ok(().into())
}
