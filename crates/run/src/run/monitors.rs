//! The monitors of a rig during a run: read between presses without load, so that no press takes longer.

use super::clock::RunClock;
use super::home::unless_stopped;
use super::{Cancel, Halt, Listener};
use crate::rig::{MonitorSpec, OpenRig, RigSpec, TEMPERATURE};
use palpate_core::quantity::{round, seconds};
use palpate_data::dataset::MonitorValue;
use palpate_drivers::AnyArray;
use palpate_link::device::{DeviceError, DeviceProblem, Identity, SensorArray};
use palpate_link::time::Instant;
use std::time::Duration;

/// Monitors in use, and how long the next press has waited for them.
pub(super) struct Monitors {
    all: Vec<Monitor>,
    waited_s: f64,
}

struct Monitor {
    spec: MonitorSpec,
    device: AnyArray,
    /// Last reading; `None` before the first, and after one that was missed.
    last: Option<(Instant, MonitorValue)>,
    /// Whether the last reading was missed.
    is_missed: bool,
}

impl Monitors {
    /// Connects to each monitor of an open rig and checks that its answers mean what the rig file states, before anything moves. Returns
    /// the identities too.
    pub(super) async fn ready(
        rig: &mut OpenRig,
        spec: &RigSpec,
        cancel: &Cancel,
    ) -> Result<(Monitors, Vec<Identity>), Halt> {
        let (mut all, mut identities) = (Vec::new(), Vec::new());
        for (spec, mut device) in spec.monitors.iter().cloned().zip(std::mem::take(&mut rig.monitors)) {
            let identity = unless_stopped(cancel, device.prepare()).await?.map_err(|error| spec.named(error))?;
            identities.push(Identity { role: spec.role(), ..identity });
            all.push(Monitor { spec, device, last: None, is_missed: false });
        }
        Ok((Monitors { all, waited_s: 0.0 }, identities))
    }

    /// Reads the monitors that are due.
    pub(super) async fn refresh(&mut self, clock: RunClock) -> Result<(), DeviceError> {
        for monitor in &mut self.all {
            monitor.refresh(clock).await?;
        }
        Ok(())
    }

    /// Reads the monitors that are due. Returns how long the next press must wait; `None` if it may begin. Informs `listener` once of each
    /// wait.
    ///
    /// # Errors
    /// A monitor fails, or its value was outside its bounds for too long.
    pub(super) async fn look(
        &mut self,
        clock: RunClock,
        listener: &mut dyn Listener,
    ) -> Result<Option<Duration>, Halt> {
        self.refresh(clock).await.map_err(Halt::unread)?;
        let outside = self.all.iter().find_map(|monitor| Some((&monitor.spec, monitor.outside()?)));
        let Some((spec, text)) = outside else {
            self.waited_s = 0.0;
            return Ok(None);
        };
        if self.waited_s >= spec.wait_s {
            return Err(Halt::OutOfBounds(format!("{text} after a wait of {} s", spec.wait_s)));
        }
        if self.waited_s == 0.0 {
            listener.waits(&format!("{text}: waiting at most {} s", spec.wait_s));
        }
        let wait_s = spec.every_s.min(spec.wait_s - self.waited_s);
        self.waited_s += wait_s;
        Ok(Some(seconds(wait_s)))
    }

    /// Whether the last reading of a monitor was missed.
    pub(super) fn are_missed(&self) -> bool {
        self.all.iter().any(|monitor| monitor.is_missed)
    }

    /// Whether the monitors whose last readings were missed answer again.
    pub(super) async fn answer(&mut self) -> bool {
        for Monitor { device, .. } in self.all.iter_mut().filter(|monitor| monitor.is_missed) {
            if !answers(device).await {
                return false;
            }
        }
        true
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

/// Whether a device of outputs is reached and answers. What it had to say until then is left out.
pub(super) async fn answers<A: SensorArray>(device: &mut A) -> bool {
    let mut outputs = vec![0.0; device.units()];
    device.prepare().await.is_ok() && device.read(&mut outputs).await.is_ok()
}

impl Monitor {
    /// Reads the value if it is due. A value outside its bounds is always due.
    async fn refresh(&mut self, clock: RunClock) -> Result<(), DeviceError> {
        let is_known = self.last.as_ref().is_some_and(|(read, _)| read.elapsed().as_secs_f64() < self.spec.every_s);
        if !is_known || self.outside().is_some() {
            self.is_missed = true;
            self.last = None;
            let value = self.read().await?;
            self.is_missed = false;
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
