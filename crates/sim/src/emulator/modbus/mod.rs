//! The device side of Modbus, RTU and TCP, over a register map. Frames are read and written by `rmodbus`, which the client side
//! doesn't use.
//!
//! Function codes 3, 4, 6 and 16, with the same holding and input registers; exceptions 1 (function), 2 (address) and 3 (value or
//! count). Over RTU the unit id must match. A broadcast (0) acts but isn't answered. An invalid frame waits for a silence of 3.5
//! characters and is discarded, and so is a frame that begins earlier after an answer. Over TCP the unit id is ignored.

mod labjack_t7;
mod laumas_tlb;
mod robotiq_ft300;
mod seneca_zsg;
mod transmitter;

pub use labjack_t7::LabJackT7;
pub use laumas_tlb::LaumasTlb;
pub use robotiq_ft300::RobotiqFt300;
pub use seneca_zsg::SenecaZsg;
pub use transmitter::Transmitter;

use super::Instrument;
use crate::scene::{Scene, SceneDevice};
use palpate_core::quantity::seconds;
use palpate_link::wire::SerialLine;
use rmodbus::server::{ModbusFrame, Read, Write};
use rmodbus::{ErrorKind, ModbusProto, guess_request_frame_len};
use std::ops::RangeInclusive;
use std::time::Duration;

/// Silence between two frames of a line that is faster than [`SLOW_BAUD`] or has no rate (MODBUS over Serial Line V1.02, section
/// 2.5.1.1). On a slower line it is that of [`SILENT_BYTES`].
const SILENCE: Duration = Duration::from_micros(1750);
const SLOW_BAUD: u32 = 19_200;
const SILENT_BYTES: f64 = 3.5;
/// Largest number of bytes in a frame: 256 of RTU, and the longer header of TCP.
const FRAME_MOST: usize = 260;
/// Number of bytes of the TCP header up to and including its length field. The field counts the bytes after it.
const TCP_HEADER: usize = 6;
/// Possible values of the length field: at least unit and function, at most a complete PDU (253).
const TCP_LENGTHS: RangeInclusive<usize> = 2..=254;
/// Largest number of registers in one read. The next constant is that of one write.
const READ_MOST: u16 = 125;
const WRITE_MOST: u16 = 123;

/// One register as transmitted, high byte first.
pub type RegisterBytes = [u8; 2];

/// Reason why a map refuses a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The register doesn't exist, or can't be written: exception 2.
    Address,
    /// The register doesn't accept this value or this number of words: exception 3.
    Value,
}

/// Registers of one device: its measurements, and the values that can be written.
pub trait RegisterMap: Send {
    /// The role it plays in the scene.
    fn device(&self) -> SceneDevice;

    /// Reads registers from `address` on, all at one instant.
    ///
    /// # Errors
    /// Returns a refusal if a register can't be read.
    fn read(&mut self, address: u16, words: &mut [RegisterBytes], scene: &mut Scene, now_s: f64)
    -> Result<(), Refusal>;

    /// Writes registers from `address` on.
    ///
    /// # Errors
    /// Returns a refusal if a register can't be written. The registers before it are written.
    fn write(&mut self, address: u16, words: &[RegisterBytes], scene: &mut Scene, now_s: f64) -> Result<(), Refusal>;
}

/// A Modbus device over a register map.
pub struct Modbus<M> {
    map: M,
    framing: EmulatedFraming,
    silence: Duration,
}

#[derive(Clone, Copy, PartialEq)]
enum EmulatedFraming {
    Rtu { unit_id: u8 },
    Tcp,
}

type RequestFrame<'a> = ModbusFrame<'a, Vec<u8>>;

impl<M: RegisterMap> Modbus<M> {
    /// Creates a device on a serial line, as unit `unit_id` (1 to 247).
    pub fn rtu(map: M, unit_id: u8) -> Self {
        Modbus { map, framing: EmulatedFraming::Rtu { unit_id }, silence: SILENCE }
    }

    /// Creates a device on a TCP connection.
    pub fn tcp(map: M) -> Self {
        Modbus { map, framing: EmulatedFraming::Tcp, silence: SILENCE }
    }
}

impl<M: RegisterMap> Instrument for Modbus<M> {
    fn device(&self) -> SceneDevice {
        self.map.device()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        let length = match self.framing {
            EmulatedFraming::Rtu { .. } => {
                let length = usize::from(guess_request_frame_len(inbox, ModbusProto::Rtu).ok()?);
                // a frame with a wrong check sum waits for the silence after it
                inbox.get(..length).filter(|frame| checks_out(frame))?.len()
            }
            EmulatedFraming::Tcp => {
                let &[_, _, 0, 0, high, low] = inbox.first_chunk::<TCP_HEADER>()? else {
                    // no header: the rest can't be separated any more
                    inbox.clear();
                    return None;
                };
                let length = usize::from(u16::from_be_bytes([high, low]));
                if !TCP_LENGTHS.contains(&length) {
                    inbox.clear();
                    return None;
                }
                inbox.get(..TCP_HEADER + length)?.len()
            }
        };
        let request = inbox[..length].to_vec();
        inbox.drain(..length);
        Some(request)
    }

    fn silence(&self) -> Option<Duration> {
        (self.framing != EmulatedFraming::Tcp).then_some(self.silence)
    }

    fn on_line(&mut self, line: SerialLine) -> bool {
        self.silence = if line.baud > SLOW_BAUD { SILENCE } else { seconds(SILENT_BYTES * line.time_s(1)) };
        false
    }

    /// Discards a request for an unsupported function. Its length can't be known from its first bytes, so the silence ends it.
    fn fall_silent(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        Some(std::mem::take(inbox)).filter(|frame| checks_out(frame))
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut reply = Vec::with_capacity(FRAME_MOST);
        // an error here is a frame without an answer
        if self.respond(request, &mut reply, scene, now_s).is_err() {
            reply.clear();
        }
        reply
    }
}

impl<M: RegisterMap> Modbus<M> {
    fn respond(&mut self, request: &[u8], reply: &mut Vec<u8>, scene: &mut Scene, now_s: f64) -> Result<(), ErrorKind> {
        let (protocol, header, trailer) = match self.framing {
            EmulatedFraming::Rtu { .. } => (ModbusProto::Rtu, 0, 2),
            EmulatedFraming::Tcp => (ModbusProto::TcpUdp, TCP_HEADER, 0),
        };
        let body = request.get(header..request.len().saturating_sub(trailer)).ok_or(ErrorKind::FrameBroken)?;
        let (&unit_id, pdu) = body.split_first().ok_or(ErrorKind::FrameBroken)?;
        let broadcast = self.framing != EmulatedFraming::Tcp && unit_id == 0;
        if let EmulatedFraming::Rtu { unit_id: own } = self.framing
            && unit_id != own
            && !broadcast
        {
            return Ok(());
        }
        let broadcast_units: &[u8] = if self.framing == EmulatedFraming::Tcp { &[] } else { &[0] };
        let mut frame = RequestFrame::new(unit_id, request, protocol, reply).with_broadcast_units(broadcast_units);
        if let Err(kind) = check(pdu) {
            return if broadcast { Ok(()) } else { refuse(&mut frame, request, pdu, kind) };
        }
        frame.parse()?;
        if frame.processing_required && frame.readonly {
            let result = match frame.get_external_read()? {
                Read::Words(asked) => {
                    let (words, _) = asked.buf.as_chunks_mut();
                    self.map.read(asked.address, words, scene, now_s)
                }
                Read::Bits(_) => Err(Refusal::Address),
            };
            frame.process_external_read(result.map_err(Refusal::kind))?;
        } else if frame.processing_required {
            let result = match frame.get_external_write()? {
                Write::Words(given) => {
                    let (words, _) = given.data.as_chunks();
                    self.map.write(given.address, words, scene, now_s)
                }
                Write::Bits(_) => Err(Refusal::Address),
            };
            frame.process_external_write(result.map_err(Refusal::kind))?;
        }
        if frame.response_required {
            frame.finalize_response()
        } else {
            frame.response.clear();
            Ok(())
        }
    }
}

/// Checks the properties of a PDU that `rmodbus` assumes: a supported function, the PDU's length, and a count that fits into a
/// frame. A request that follows the Modbus rules may still be refused.
fn check(pdu: &[u8]) -> Result<(), ErrorKind> {
    let is_sound = match *pdu {
        [3 | 4, _, _, high, low] => (1..=READ_MOST).contains(&u16::from_be_bytes([high, low])),
        [6, _, _, _, _] => true,
        [16, _, _, high, low, bytes, ref data @ ..] => {
            let count = u16::from_be_bytes([high, low]);
            let fits = usize::from(bytes) == data.len() && data.len() == 2 * usize::from(count);
            fits && (1..=WRITE_MOST).contains(&count)
        }
        [3 | 4 | 6 | 16, ..] => false,
        _ => return Err(ErrorKind::IllegalFunction),
    };
    if is_sound { Ok(()) } else { Err(ErrorKind::IllegalDataValue) }
}

impl Refusal {
    fn kind(self) -> ErrorKind {
        match self {
            Refusal::Address => ErrorKind::IllegalDataAddress,
            Refusal::Value => ErrorKind::IllegalDataValue,
        }
    }
}

/// Answers a frame that wasn't parsed with an exception.
fn refuse(frame: &mut RequestFrame, request: &[u8], pdu: &[u8], kind: ErrorKind) -> Result<(), ErrorKind> {
    if frame.proto == ModbusProto::TcpUdp {
        // transaction and protocol; rmodbus writes the rest
        frame.response.extend_from_slice(request.get(..4).ok_or(ErrorKind::FrameBroken)?);
    }
    frame.responding_to_fn = pdu.first().copied().ok_or(ErrorKind::FrameBroken)? & 0x7F;
    frame.error = Some(kind.to_modbus_error()?);
    frame.finalize_response()
}

/// The CRC of each byte, for [`checks_out`].
const CRCS: [u16; 256] = {
    let mut crcs = [0; 256];
    let mut byte = 0;
    while byte < crcs.len() {
        let (mut crc, mut bit) = (byte as u16, 0);
        while bit < 8 {
            crc = crc >> 1 ^ if crc & 1 == 1 { 0xA001 } else { 0 };
            bit += 1;
        }
        crcs[byte] = crc;
        byte += 1;
    }
    crcs
};

/// Whether the CRC of an RTU frame matches its bytes. `rmodbus` doesn't export its own check.
fn checks_out(frame: &[u8]) -> bool {
    let next = |crc: u16, byte: &u8| crc >> 8 ^ CRCS[usize::from(crc as u8 ^ byte)];
    let crc_of = |body: &[u8]| body.iter().fold(0xFFFF, next);
    frame.split_last_chunk().is_some_and(|(body, crc)| crc_of(body).to_le_bytes() == *crc)
}

#[cfg(test)]
mod tests;
