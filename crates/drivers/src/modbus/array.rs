//! A sensor array on the inputs of a Modbus converter.

use super::client::ModbusClient;
use super::profile::{OutputRegisters, Probe, Profile};
use super::request::ModbusFraming;
use palpate_link::device::{DeviceError, DeviceProblem, Identity, SensorArray};
use palpate_link::wire::Connector;

/// A sensor array on the analog inputs of a Modbus converter.
pub struct ModbusArray {
    client: ModbusClient,
    outputs: OutputRegisters,
    probes: Vec<Probe>,
    units: usize,
    identity: Identity,
}

impl ModbusArray {
    /// Creates an array of `units` units on a profile's outputs; returns `None` if the profile has no `[outputs]` or too few
    /// outputs.
    pub fn new(
        connector: Connector,
        framing: impl Into<ModbusFraming>,
        profile: Profile,
        link: &str,
        units: usize,
    ) -> Option<Self> {
        let client = ModbusClient::new(connector, framing, &profile, "array", link);
        let outputs = profile.outputs.filter(|outputs| (1..=outputs.count_max).contains(&units))?;
        let identity = Identity {
            role: "array".to_owned(),
            identity: format!("{}, {units} channels", profile.name),
            link: link.to_owned(),
            warnings: Vec::new(),
        };
        Some(ModbusArray { client, outputs, probes: profile.probe, units, identity })
    }
}

impl SensorArray for ModbusArray {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        self.client.probe(&self.probes).await?;
        let mut outputs = vec![0.0; self.units];
        self.read(&mut outputs).await?;
        Ok(self.identity.clone())
    }

    async fn read(&mut self, outputs: &mut [f64]) -> Result<(), DeviceError> {
        let doing = "reading the outputs";
        let register = self.outputs.register;
        let each = register.encoding.registers();
        let words = self.client.read(doing, register.function, register.address, each * self.units as u16).await?;
        for (output, words) in outputs.iter_mut().zip(words.chunks(usize::from(each))) {
            let value = register.encoding.decode(words).filter(|value| value.is_finite());
            *output = value.ok_or_else(|| {
                let expected = "a finite number from every unit".to_owned();
                self.client.error(doing, DeviceProblem::Misfit { answer: format!("{words:?}"), expected })
            })?;
        }
        Ok(())
    }

    fn units(&self) -> usize {
        self.units
    }
}
