//! Requests for registers: the framing and the function.

use palpate_core::quantity::seconds;
use palpate_link::wire::Link;
use std::time::Duration;

/// Protocol of Modbus on a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Serial line, CRC and silence.
    Rtu,
    /// TCP, with a header that numbers the transactions.
    Tcp,
}

/// Characters of silence that separate two frames of a serial line (MODBUS over Serial Line V1.02, section 2.5.1.1).
const SILENT_CHARACTERS: f64 = 3.5;

/// Fixed silence of lines faster than this rate (same section). A simulated line without a rate has this silence too.
const FAST_BAUD: u32 = 19_200;
const FAST_SILENCE: Duration = Duration::from_micros(1750);

/// Framing of Modbus on a particular link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModbusFraming {
    /// Protocol on the link.
    pub transport: Transport,
    /// Shortest silence between an answer and the next request.
    pub silence: Duration,
}

impl ModbusFraming {
    /// Returns the framing of a link: RTU on a serial port, Modbus TCP to a server, and the device's `own` protocol elsewhere.
    pub fn of(link: &Link, own: Transport) -> ModbusFraming {
        match (link.serial_line(), link) {
            (Some(line), _) if line.baud <= FAST_BAUD => {
                let silence = seconds(SILENT_CHARACTERS * line.time_s(1));
                ModbusFraming { transport: Transport::Rtu, silence }
            }
            (Some(_), _) => Transport::Rtu.into(),
            (None, Link::Tcp { .. }) => Transport::Tcp.into(),
            _ => own.into(),
        }
    }
}

/// Framing on a link without a rate.
impl From<Transport> for ModbusFraming {
    fn from(transport: Transport) -> Self {
        let silence = if transport == Transport::Rtu { FAST_SILENCE } else { Duration::ZERO };
        ModbusFraming { transport, silence }
    }
}

/// Function that reads registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// Function code 3.
    Holding,
    /// Function code 4.
    Input,
}

impl Function {
    /// Returns the other function, for comparison: an answer to one function can't be an answer to the other.
    pub fn other(self) -> Function {
        match self {
            Function::Holding => Function::Input,
            Function::Input => Function::Holding,
        }
    }
}
