//! Load cell on an analog input.

use super::CALL_DEADLINE;
use super::socket::Socket;
use super::text::number_in;
use palpate_core::quantity::{ForceReading, Health};
use palpate_link::device::{DeviceError, DeviceProblem, Identity, LoadCell};
use palpate_link::time::Instant;
use palpate_link::wire::Connector;
use std::time::Duration;

/// Voltage from which a reading may be beyond the end of the range, V. The inputs' range is +-10 V.
const FULL_SCALE_V: f64 = 9.99;

/// Largest possible reading of an input, V. An answer with a larger value is damaged.
const MOST_V: f64 = 10.5;

/// A load cell on an analog input of the controller, such as `GPIO2.ADC1`, read over a socket of its own.
pub struct XpsAnalog {
    socket: Socket,
    link: String,
    call: String,
    input: String,
    newton_per_volt: f64,
    conversion: Duration,
    origin: Instant,
}

impl XpsAnalog {
    /// Creates a load cell with its sensitivity in N per volt, read `conversions_hz` times per second. The times of readings are
    /// relative to `origin`.
    pub fn new(
        connector: Connector,
        link: String,
        input: &str,
        newton_per_volt: f64,
        conversions_hz: f64,
        origin: Instant,
    ) -> Self {
        XpsAnalog {
            socket: Socket::new(connector, format!("load cell ({input} of the XPS at {link})")),
            link,
            call: format!("GPIOAnalogGet({input},double *)"),
            input: input.to_owned(),
            newton_per_volt,
            conversion: Duration::from_secs_f64(1.0 / conversions_hz),
            origin,
        }
    }
}

impl LoadCell for XpsAnalog {
    async fn prepare(&mut self) -> Result<Identity, DeviceError> {
        self.read().await?;
        Ok(Identity {
            role: "load_cell".to_owned(),
            identity: format!("{} of an XPS, {} N a volt", self.input, self.newton_per_volt),
            link: self.link.clone(),
            warnings: Vec::new(),
        })
    }

    async fn read(&mut self) -> Result<ForceReading, DeviceError> {
        let doing = "reading the force";
        let values = self.socket.call(doing, &self.call, CALL_DEADLINE).await?;
        let at_s = self.origin.elapsed().as_secs_f64();
        let volts = values.first().and_then(|text| number_in(text)).filter(|volts| volts.abs() <= MOST_V);
        let volts = volts.ok_or_else(|| {
            let expected = "a voltage within +-10 V".to_owned();
            self.socket.error(doing, DeviceProblem::Misfit { answer: values.join(","), expected })
        })?;
        let health = Health { saturated: volts.abs() >= FULL_SCALE_V, fault: false };
        Ok(ForceReading { at_s, force_n: volts * self.newton_per_volt, side_n: None, health })
    }

    fn conversion(&self) -> Duration {
        self.conversion
    }
}
