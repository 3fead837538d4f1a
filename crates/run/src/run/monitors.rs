//! The monitors of a rig during a run: read between presses without load, so that no press takes longer.

use super::clock::RunClock;
use super::home::unless_stopped;
use super::{Cancel, Halt};
use crate::rig::{MonitorSpec, OpenRig, RigSpec, TEMPERATURE};
use palpate_core::quantity::round;
use palpate_data::dataset::MonitorValue;
use palpate_drivers::AnyArray;
use palpate_link::device::{DeviceError, DeviceProblem, Identity, SensorArray};
use palpate_link::time::Instant;

/// Monitors in use, and how long the next press has waited for them.
pub(super) struct Monitors {
    all: Vec<Monitor>,
    waited_s: f64,
}

/// A wait for a value that is outside its bounds.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Wait {
    /// Time until the next look, s.
    pub seconds: f64,
    /// Message for a person, once in each wait.
    pub text: Option<String>,
}

struct Monitor {
    spec: MonitorSpec,
    device: AnyArray,
    /// Last reading; `None` before the first.
    last: Option<(Instant, MonitorValue)>,
}

impl Monitors {
    /// Takes the monitors of a rig that was opened.
    pub(super) fn of(rig: &mut OpenRig, spec: &RigSpec) -> Monitors {
        let devices = std::mem::take(&mut rig.monitors);
        let monitor = |(spec, device): (&MonitorSpec, AnyArray)| Monitor { spec: spec.clone(), device, last: None };
        Monitors { all: spec.monitors.iter().zip(devices).map(monitor).collect(), waited_s: 0.0 }
    }

    /// Connects to each monitor and checks that its answers mean what the rig says, before anything moves.
    pub(super) async fn prepare(&mut self, cancel: &Cancel) -> Result<Vec<Identity>, Halt> {
        let mut identities = Vec::with_capacity(self.all.len());
        for monitor in &mut self.all {
            identities.push(monitor.prepare(cancel).await??);
        }
        Ok(identities)
    }

    /// Reads each monitor once, for an examination. Returns its identity and its value.
    pub(super) async fn examine(&mut self, cancel: &Cancel) -> Result<Vec<Examined>, Halt> {
        let mut examined = Vec::with_capacity(self.all.len());
        for monitor in &mut self.all {
            let found = match monitor.prepare(cancel).await? {
                Ok(identity) => monitor.read().await.map(|value| (identity, value)),
                Err(error) => Err(error),
            };
            examined.push((monitor.spec.name.clone(), found));
        }
        Ok(examined)
    }

    /// Reads the monitors that are due. Returns how long the next press must wait; `None` if it may begin.
    ///
    /// # Errors
    /// A monitor fails, or its value was outside its bounds for too long.
    pub(super) async fn look(&mut self, clock: RunClock) -> Result<Option<Wait>, Halt> {
        for monitor in &mut self.all {
            monitor.refresh(clock).await?;
        }
        let outside = self.all.iter().find_map(|monitor| Some((&monitor.spec, monitor.outside()?)));
        let Some((spec, text)) = outside else {
            self.waited_s = 0.0;
            return Ok(None);
        };
        if self.waited_s >= spec.wait_s {
            return Err(Halt::OutOfBounds(format!("{text} after a wait of {} s", spec.wait_s)));
        }
        let seconds = spec.every_s.min(spec.wait_s - self.waited_s);
        let text = (self.waited_s == 0.0).then(|| format!("{text}: waiting at most {} s", spec.wait_s));
        self.waited_s += seconds;
        Ok(Some(Wait { seconds, text }))
    }

    /// Returns the last values, in the order of the rig.
    pub(super) fn values(&self) -> Vec<MonitorValue> {
        self.all.iter().filter_map(|monitor| Some(monitor.last.as_ref()?.1.clone())).collect()
    }

    /// Returns the last temperature of the rig, degrees Celsius; `None` without such a monitor.
    pub(super) fn temperature_c(&self) -> Option<f64> {
        let monitor = self.all.iter().find(|monitor| monitor.spec.name == TEMPERATURE)?;
        Some(monitor.last.as_ref()?.1.value)
    }
}

/// Name of a monitor, with its identity and its value, or the reason why it isn't usable.
pub type Examined = (String, Result<(Identity, f64), DeviceError>);

impl Monitor {
    async fn prepare(&mut self, cancel: &Cancel) -> Result<Result<Identity, DeviceError>, Halt> {
        let identity = unless_stopped(cancel, self.device.prepare()).await?;
        let named = |identity: Identity| Identity { role: self.spec.role(), ..identity };
        Ok(identity.map(named).map_err(|error| self.spec.named(error)))
    }

    /// Reads the value if it is due. A value outside its bounds is always due.
    async fn refresh(&mut self, clock: RunClock) -> Result<(), DeviceError> {
        let is_known = self.last.as_ref().is_some_and(|(read, _)| read.elapsed().as_secs_f64() < self.spec.every_s);
        if !is_known || self.outside().is_some() {
            let value = self.read().await?;
            let (now, t_s, name) = (Instant::now(), round(clock.now_s(), 4), self.spec.name.clone());
            self.last = Some((now, MonitorValue { name, value, t_s }));
        }
        Ok(())
    }

    async fn read(&mut self) -> Result<f64, DeviceError> {
        let mut outputs = vec![0.0; self.device.units()];
        self.device.read(&mut outputs).await.map_err(|error| self.spec.named(error))?;
        let reading = outputs.first().copied().unwrap_or(f64::NAN);
        let value = round(self.spec.scale * reading + self.spec.offset, 6);
        if value.is_finite() {
            return Ok(value);
        }
        let problem = DeviceProblem::Misfit { answer: reading.to_string(), expected: "a finite number".to_owned() };
        Err(DeviceError { device: self.spec.role(), doing: "reading its value".to_owned(), problem })
    }

    /// Returns what is outside its bounds.
    fn outside(&self) -> Option<String> {
        let ((_, MonitorValue { name, value, .. }), bounds) = self.last.as_ref().zip(self.spec.bounds)?;
        (!self.spec.admits(*value)).then(|| format!("{name} is {value}, outside {} to {}", bounds.min, bounds.max))
    }
}
