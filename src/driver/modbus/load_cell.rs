use super::client::Client;
use super::profile::{Force, Profile, Status, Transport};
use crate::device::{DeviceError, Identity, LoadCell, Problem};
use crate::quantity::{ForceReading, Health};
use crate::wire::Connector;
use std::time::Duration;
use tokio::time::Instant;

/// Readings of the weight between two of the status word, which is a request of its own: no mean on which a step is decided
/// goes without one.
const STATUS_EVERY: u32 = 4;

/// A load cell behind a Modbus transmitter.
pub struct ModbusLoadCell {
    client: Client,
    force: Force,
    status: Option<Status>,
    newton_per_count: f64,
    conversion: Duration,
    health: Health,
    until_status: u32,
    origin: Instant,
    identity: Identity,
}

impl ModbusLoadCell {
    /// A load cell of a profile, or none if the profile has no `[force]`. Readings are timed from `origin`; the
    /// transmitter converts `conversions_hz` times a second.
    pub fn new(
        connector: Connector,
        transport: Transport,
        profile: Profile,
        link: &str,
        conversions_hz: f64,
        origin: Instant,
    ) -> Option<Self> {
        let client = Client::new(connector, transport, &profile, "load cell", link);
        let identity = Identity {
            role: "load_cell".to_owned(),
            identity: profile.name.clone(),
            link: link.to_owned(),
            warnings: Vec::new(),
        };
        Some(ModbusLoadCell {
            client,
            force: profile.force?,
            status: profile.status,
            newton_per_count: 1.0,
            conversion: Duration::from_secs_f64(1.0 / conversions_hz),
            health: Health::default(),
            until_status: 0,
            origin,
            identity,
        })
    }

    async fn read_status(&mut self) -> Result<(), DeviceError> {
        let Some(status) = &self.status else { return Ok(()) };
        let words = self.client.read("reading the status word", status.address, 1).await?;
        let word = words.first().copied().unwrap_or_default();
        let any = |bits: &[u8]| bits.iter().any(|&bit| word.checked_shr(u32::from(bit)).unwrap_or(0) & 1 == 1);
        self.health = Health { saturated: any(&status.saturated_bits), fault: any(&status.fault_bits) };
        Ok(())
    }
}

impl LoadCell for ModbusLoadCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        let mut decimals = 0;
        if let Some(place) = &self.force.decimals {
            let words = self.client.read("reading its decimals", place.address, 1).await?;
            decimals = words.first().copied().unwrap_or_default() & place.mask;
        }
        let Some(scale) = 10_u32.checked_pow(u32::from(decimals)) else {
            let told = format!("it says its weight has {decimals} decimals: is `decimals` of the register map right?");
            return Err(self.client.error("reading its decimals", Problem::Mismatch(told)));
        };
        self.newton_per_count = self.force.newton_per_unit / f64::from(scale);
        self.read_status().await?;
        self.until_status = STATUS_EVERY;
        if self.health.fault {
            let told = "its status word reports a fault of the cell".to_owned();
            return Err(self.client.error("identifying it", Problem::Refused(told)));
        }
        let identity = format!("{}, {} N a count", self.identity.identity, self.newton_per_count);
        Ok(Identity { identity, ..self.identity.clone() })
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        if self.until_status == 0 {
            self.read_status().await?;
            self.until_status = STATUS_EVERY;
        }
        self.until_status -= 1;
        let Force { address, number, word_order, .. } = self.force;
        let count = self.client.read_number("reading the force", address, number, word_order).await?;
        let at_s = self.origin.elapsed().as_secs_f64();
        Ok(ForceReading { at_s, force_n: count * self.newton_per_count, health: self.health })
    }

    fn conversion(&self) -> Duration {
        self.conversion
    }
}
