use super::errors::{self, Code};
use super::events::{self, Events, INPUTS, RANGE_V};
use super::gathering::{Gathering, Source};
use super::group::{Group, Outcome};
use super::syntax::{Call, Type, number, numbers};
use crate::scene::Scene;

/// What `FirmwareVersionGet` and `InstallerVersionGet` answer.
const FIRMWARE: &str = "XPS-Q8 Firmware V2.6.4";
const INSTALLER: &str = "XPS-Q8 Installer V2.6.4";
/// What `HardwareDriverAndStageGet` answers of a plug with a stage.
const DRIVER_AND_STAGE: &str = "XPS-DRV03;VP-25XL";
/// Plugs of the controller.
const PLUGS: i32 = 8;
/// The one user there is, and the password.
const ADMINISTRATOR: &str = "Administrator";
/// How often the controller itself looks at its inputs, s: every tenth servo tick, which is the grain of tokio's timers.
const TICK_S: f64 = 0.001;

/// The controller behind all sockets.
pub struct Controller {
    pub(super) group: Group,
    events: Events,
    gathering: Gathering,
    volts_per_newton: f64,
    outputs_v: [f64; INPUTS],
}

/// What a call comes to.
pub enum Answer {
    /// These values, at once.
    Values(String),
    /// What the group's errand ends with, when it does.
    Later(Outcome),
}

impl From<()> for Answer {
    fn from((): ()) -> Self {
        Answer::Values(String::new())
    }
}

impl From<Outcome> for Answer {
    fn from(outcome: Outcome) -> Self {
        Answer::Later(outcome)
    }
}

impl From<String> for Answer {
    fn from(values: String) -> Self {
        Answer::Values(values)
    }
}

impl Controller {
    pub fn new(group: Group, volts_per_newton: f64) -> Self {
        let (events, gathering) = (Events::default(), Gathering::default());
        Controller { group, events, gathering, volts_per_newton, outputs_v: [0.0; INPUTS] }
    }

    /// Draws the consequences of what has ended by `now_s`, gathers, and lets the events that are met happen.
    pub fn notice(&mut self, scene: &mut Scene, now_s: f64) {
        self.group.notice(scene, now_s);
        let positioners = &self.group.positioners;
        let read = |source| match source {
            Source::Position(index) => positioners[index].count_mm(scene, now_s),
            Source::Setpoint(index) => positioners[index].setpoint_mm(scene, now_s),
            Source::Velocity(index) => positioners[index].speed_mm_s(scene, now_s),
            Source::Input(input) => events::input_v(input, self.volts_per_newton, scene, now_s),
        };
        self.gathering.look(read, now_s);
        if !self.guards(scene, now_s) {
            return;
        }
        let moves = self.group.moves(scene, now_s);
        let volts = |input| events::input_v(input, self.volts_per_newton, scene, now_s);
        if self.events.happen(volts, moves) {
            // a group that moves takes an abort
            let _ = self.group.abort(scene, now_s);
        }
    }

    /// When [`notice`](Self::notice) may next have something to do, s; infinite: not by itself.
    pub fn next_s(&self, scene: &Scene, now_s: f64) -> f64 {
        let look_s = if self.guards(scene, now_s) { now_s + TICK_S } else { f64::INFINITY };
        let gather_s = self.gathering.next_s().max(now_s + TICK_S);
        look_s.min(gather_s).min(self.group.end_s())
    }

    /// Whether no link waits for what the group is about.
    pub fn is_unattended(&self) -> bool {
        self.group.is_unattended()
    }

    /// Whether something has begun or ended, since this was last asked, that a link may wait for.
    pub fn take_stirred(&mut self) -> bool {
        std::mem::take(&mut self.group.stirred)
    }

    /// Acts on a call.
    pub fn run(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<Answer, Code> {
        match call.name {
            "FirmwareVersionGet" => tell(call, Type::Char, FIRMWARE),
            "InstallerVersionGet" => tell(call, Type::Char, INSTALLER),
            "ElapsedTimeGet" => tell(call, Type::Double, &number(now_s)),
            "HardwareDriverAndStageGet" => {
                let plug = call.whole()?;
                call.results(Type::Char, 1)?;
                match plug {
                    1..=3 => Ok(DRIVER_AND_STAGE.to_owned().into()),
                    4..=PLUGS => Ok(().into()),
                    _ => Err(Code::OUT_OF_RANGE),
                }
            }
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
                self.group.kill(scene, now_s);
                Ok(().into())
            }
            name if name.starts_with("GPIO") => self.run_analog(call, scene, now_s),
            name if name.starts_with("Event") => self.run_event(call),
            name if name.starts_with("Gathering") => self.run_gathering(call, scene, now_s),
            name if name.starts_with("Positioner") => self.run_positioner(call, scene, now_s),
            name if name.starts_with("Group") => self.run_group(call, scene, now_s),
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }

    /// Whether the controller must look at what it watches for.
    fn guards(&self, scene: &Scene, now_s: f64) -> bool {
        self.events.armed() && self.group.can_be_aborted(scene, now_s)
    }

    fn run_event(&mut self, mut call: Call) -> Result<Answer, Code> {
        match call.name {
            "EventExtendedConfigurationTriggerSet" => {
                self.events.set_conditions(&mut call, &self.group)?;
                done(call)
            }
            "EventExtendedConfigurationActionSet" => {
                self.events.set_action(&mut call, &self.group)?;
                done(call)
            }
            "EventExtendedStart" => {
                call.results(Type::Int, 1)?;
                // who waits for a move now waits for this as well
                self.group.stirred = true;
                Ok(self.events.start()?.to_string().into())
            }
            "EventExtendedRemove" => {
                let id = call.whole()?;
                call.end()?;
                self.events.remove(id).map(Answer::from)
            }
            "EventExtendedAllGet" => {
                let ids = self.events.ids()?;
                tell(call, Type::Char, &ids)
            }
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }

    fn run_gathering(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<Answer, Code> {
        let gathering = &mut self.gathering;
        match call.name {
            "GatheringConfigurationSet" => {
                gathering.configure(&mut call, &self.group)?;
                done(call)
            }
            "GatheringConfigurationGet" => {
                let types = gathering.types()?;
                tell(call, Type::Char, &types)
            }
            "GatheringRun" => {
                let (number, divisor) = (call.whole()?, call.whole()?);
                call.end()?;
                gathering.run(number, divisor, now_s)?;
                // who waits, or does nothing, now looks after this as well
                self.group.stirred = true;
                self.notice(scene, now_s);
                Ok(().into())
            }
            "GatheringStop" => {
                call.end()?;
                gathering.stop().map(Answer::from)
            }
            "GatheringReset" => {
                call.end()?;
                gathering.reset().map(Answer::from)
            }
            "GatheringCurrentNumberGet" => {
                call.results(Type::Int, 2)?;
                gathering.numbers().map(Answer::from)
            }
            "GatheringDataGet" => {
                let lines = gathering.lines(call.whole()?, 1)?;
                tell(call, Type::Char, &lines)
            }
            "GatheringDataMultipleLinesGet" => {
                let lines = gathering.lines(call.whole()?, call.whole()?)?;
                tell(call, Type::Char, &lines)
            }
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }

    /// `GPIOAnalogGet(name,double *,...)` and `GPIOAnalogSet(name,volts,...)`.
    fn run_analog(&mut self, mut call: Call, scene: &mut Scene, now_s: f64) -> Result<Answer, Code> {
        match call.name {
            "GPIOAnalogGet" => {
                let mut volts = Vec::new();
                while volts.is_empty() || !call.is_through() {
                    let name = call.text()?;
                    call.result(Type::Double)?;
                    let value = match (events::input(name), output(name)) {
                        (Some(input), _) => events::input_v(input, self.volts_per_newton, scene, now_s),
                        (_, Some(output)) => self.outputs_v[output],
                        _ => return Err(Code::OUT_OF_RANGE),
                    };
                    volts.push(value);
                }
                Ok(numbers(volts).into())
            }
            "GPIOAnalogSet" => {
                let mut outputs_v = self.outputs_v;
                let mut first = true;
                while std::mem::take(&mut first) || !call.is_through() {
                    let output = output(call.text()?).ok_or(Code::OUT_OF_RANGE)?;
                    outputs_v[output] = call.number()?;
                }
                if outputs_v.iter().any(|volts| volts.abs() > RANGE_V) {
                    return Err(Code::OUT_OF_RANGE);
                }
                self.outputs_v = outputs_v;
                Ok(().into())
            }
            _ => Err(Code::UNKNOWN_COMMAND),
        }
    }
}

/// Which analog output is called so, from 0.
fn output(name: &str) -> Option<usize> {
    let number: usize = name.strip_prefix("GPIO2.DAC")?.parse().ok()?;
    (1..=INPUTS).contains(&number).then(|| number - 1)
}

/// One value of a type, if the call names one.
pub(super) fn tell(call: Call, result: Type, value: &str) -> Result<Answer, Code> {
    call.results(result, 1)?;
    Ok(value.to_owned().into())
}

/// Nothing, if the call says no more.
fn done(call: Call) -> Result<Answer, Code> {
    call.end()?;
    Ok(().into())
}
