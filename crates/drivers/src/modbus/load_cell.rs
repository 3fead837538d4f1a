//! A load cell behind a Modbus transmitter.

use super::client::ModbusClient;
use super::profile::{Force, Probe, Profile, StatusWord};
use super::request::{Function, ModbusFraming};
use crate::mounting::AxesMounting;
use palpate_core::quantity::{ForceReading, Health};
use palpate_link::device::{DeviceError, DeviceProblem, Identity, LoadCell};
use palpate_link::time::Instant;
use palpate_link::wire::Connector;
use std::time::Duration;

/// Number of weight readings between two readings of the status word, which needs its own request. Every mean that decides a step
/// includes a status word.
const STATUS_EVERY: u32 = 4;

/// A load cell behind a Modbus transmitter.
pub struct ModbusLoadCell {
    client: ModbusClient,
    force: Force,
    status: Option<StatusWord>,
    probes: Vec<Probe>,
    mounting: Box<AxesMounting>,
    newton_per_count: f64,
    conversion: Duration,
    health: Health,
    until_status: u32,
    origin: Instant,
    identity: Identity,
}

impl ModbusLoadCell {
    /// Creates a load cell of a profile; returns `None` if the profile has no `[force]`. The times of readings are relative to
    /// `origin`. The transmitter converts `conversions_hz` times per second.
    pub fn new(
        connector: Connector,
        framing: impl Into<ModbusFraming>,
        profile: Profile,
        link: &str,
        conversions_hz: f64,
        origin: Instant,
    ) -> Option<Self> {
        let mut client = ModbusClient::new(connector, framing, &profile, "load cell", link);
        let conversion = Duration::from_secs_f64(1.0 / conversions_hz);
        if profile.status.is_some() {
            client.set_pace(conversion); // a status word and a weight are two requests
        }
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
            probes: profile.probe,
            mounting: Box::default(),
            newton_per_count: 1.0,
            conversion,
            health: Health::default(),
            until_status: 0,
            origin,
            identity,
        })
    }

    /// States how a cell with three axes is mounted: the matrix from the forces along its axes to those of the tip on the specimen along
    /// x, y and the press.
    #[must_use]
    pub fn mounted(self, mounting: [[f64; 3]; 3]) -> Self {
        ModbusLoadCell { mounting: Box::new(AxesMounting(mounting)), ..self }
    }

    async fn read_status(&mut self) -> Result<(), DeviceError> {
        let Some(status) = &self.status else { return Ok(()) };
        let words = self.client.read("reading the status word", Function::Holding, status.address, 1).await?;
        self.health = status.health(words.first().copied().unwrap_or_default());
        Ok(())
    }

    /// Reads the force and the values that belong to it. Returns the forces sideways of a cell with three axes, and that of a press.
    async fn read_force(&mut self) -> Result<(Option<[f64; 2]>, f64), DeviceError> {
        let doing = "reading the force";
        let Force { register, sign, .. } = self.force;
        let (first, count) = self.force.block();
        let words = self.client.read(doing, register.function, first, count).await?;
        let word_at = |address: u16| words.get(usize::from(address.wrapping_sub(first))).copied();
        if let Some(status) = &self.status
            && let Some(word) = word_at(status.address)
        {
            self.health = status.health(word);
            self.until_status = STATUS_EVERY;
        }
        let own = words.get(usize::from(register.address - first)..).unwrap_or_default();
        let negative = sign.and_then(|sign| word_at(sign.address).map(|word| word >> sign.bit & 1 == 1));
        let newton = |number: &[u16]| {
            let units = register.encoding.decode(number)?;
            let units = if negative == Some(true) { -units } else { units };
            Some((units - self.force.offset) * self.newton_per_count)
        };
        let numbers = own.chunks(usize::from(register.encoding.registers())).take(usize::from(self.force.count()));
        // a cell has at most three axes, and is read too often for a list; a number that is missing is not a force
        let mut forces_n = [f64::NAN; 3];
        forces_n.iter_mut().zip(numbers).for_each(|(force_n, number)| *force_n = newton(number).unwrap_or(f64::NAN));
        let forces_n = &forces_n[..usize::from(self.force.count())];
        let is_possible =
            |force_n: &f64| force_n.is_finite() && self.force.range_n.is_none_or(|range_n| force_n.abs() <= range_n);
        match (forces_n.iter().all(is_possible), self.force.axes, forces_n) {
            (true, false, [force_n]) => Ok((None, *force_n)),
            (true, true, &[x_n, y_n, z_n]) => {
                let (side_n, force_n) = self.mounting.forces_n([x_n, y_n, z_n]);
                Ok((Some(side_n), force_n))
            }
            _ => {
                let expected = format!("a force within {} N", self.force.range_n.unwrap_or(f64::INFINITY));
                let answer = format!("{words:?}, {forces_n:?} N");
                Err(self.client.error(doing, DeviceProblem::Misfit { answer, expected }))
            }
        }
    }
}

impl StatusWord {
    /// Returns the meaning of a status word.
    fn health(&self, word: u16) -> Health {
        let any = |bits: &[u8]| bits.iter().any(|&bit| word.checked_shr(u32::from(bit)).unwrap_or(0) & 1 == 1);
        Health { saturated: any(&self.saturated_bits), fault: any(&self.fault_bits) }
    }
}

impl LoadCell for ModbusLoadCell {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        self.client.probe(&self.probes).await?;
        let mut decimals = 0.0;
        if let Some(register) = self.force.decimals {
            decimals = self.client.read_number("reading its decimals", register).await?;
        }
        let Some(scale) = 10_u32.checked_pow(decimals as u32) else {
            let text = format!("it reports {decimals} decimals: check `decimals` of the register map");
            return Err(self.client.error("reading its decimals", DeviceProblem::Mismatch(text)));
        };
        self.newton_per_count = self.force.newton_per_unit / f64::from(scale);
        self.read_status().await?;
        self.until_status = STATUS_EVERY;
        self.read_force().await?;
        if self.health.fault {
            let text = "its status word reports a fault of the cell".to_owned();
            return Err(self.client.error("identifying it", DeviceProblem::Refused(text)));
        }
        let identity = format!("{}, {} N a count", self.identity.identity, self.newton_per_count);
        Ok(Identity { identity, ..self.identity.clone() })
    }

    fn forget_timing(&mut self) {
        self.until_status = 0; // no press begins without a look at the status word
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        // a status of one bad sample is no status of the next ones
        if self.until_status == 0 || self.health != Health::default() {
            self.read_status().await?;
            self.until_status = STATUS_EVERY;
        }
        self.until_status -= 1;
        let (side_n, force_n) = self.read_force().await?;
        let at_s = self.origin.elapsed().as_secs_f64();
        Ok(ForceReading { at_s, force_n, side_n, health: self.health })
    }

    fn conversion(&self) -> Duration {
        self.conversion
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::modbus::Transport;
    use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};

    #[tokio::test(start_paused = true)]
    async fn a_force_that_is_no_number_is_refused() {
        let (near, mut far) = duplex(256);
        let near = std::sync::Mutex::new(Some(near));
        let dial = move || near.lock().unwrap().take().expect("the link is opened once");
        let profile = Profile::shipped("labjack-t7").unwrap();
        let link = Connector::in_memory(dial);
        let origin = Instant::now();
        let mut cell = ModbusLoadCell::new(link, Transport::Tcp, profile, "script", 100.0, origin).unwrap();
        tokio::spawn(async move {
            for value in [0.5, f32::NAN, f32::INFINITY, -0.5] {
                let mut request = [0; 12];
                far.read_exact(&mut request).await.unwrap();
                let header = [request[0], request[1], 0, 0, 0, 7, request[6], request[7], 4];
                far.write_all(&[&header[..], &value.to_be_bytes()].concat()).await.unwrap();
            }
        });
        assert_eq!(cell.read().await.unwrap().force_n, 0.5);
        assert!(cell.read().await.unwrap_err().to_string().contains("a force within"));
        assert!(cell.read().await.unwrap_err().to_string().contains("a force within"));
        assert_eq!(cell.read().await.unwrap().force_n, -0.5);
    }

    #[tokio::test(start_paused = true)]
    async fn a_status_that_reports_a_fault_is_read_again_with_the_next_reading() {
        let (near, mut far) = duplex(256);
        let near = std::sync::Mutex::new(Some(near));
        let dial = move || near.lock().unwrap().take().expect("the link is opened once");
        let profile = Profile::shipped("generic-rs485").unwrap();
        let link = Connector::in_memory(dial);
        let mut cell = ModbusLoadCell::new(link, Transport::Tcp, profile, "script", 100.0, Instant::now()).unwrap();
        tokio::spawn(async move {
            // an overload of one sample, and its weight; then a sound status, and two weights
            for answer in [&[0x02, 0x43][..], &[0; 4], &[0, 3], &[0; 4], &[0; 4]] {
                let mut request = [0; 12];
                far.read_exact(&mut request).await.unwrap();
                let count = answer.len() as u8;
                let header = [request[0], request[1], 0, 0, 0, 3 + count, request[6], request[7], count];
                far.write_all(&[&header[..], answer].concat()).await.unwrap();
            }
        });
        for is_saturated in [true, false, false] {
            assert_eq!(cell.read().await.unwrap().health.saturated, is_saturated);
        }
    }
}
