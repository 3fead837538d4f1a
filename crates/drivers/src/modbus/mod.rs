//! Instruments that use Modbus, RTU on a serial line or TCP. A [`Profile`] defines the meaning of the registers, not the code.

mod array;
mod client;
mod keys;
mod line;
mod load_cell;
mod number;
mod profile;
mod request;

pub use array::ModbusArray;
pub use client::ModbusClient;
pub use load_cell::ModbusLoadCell;
pub use number::Encoding;
pub use number::RegisterNumber;
pub use number::WordOrder;
pub use profile::{Force, Profile, Register, SHIPPED};
pub use request::{Function, ModbusFraming, Transport};

use palpate_document::Keys;

/// All keys that a register map may have.
pub const KEYS: Keys = keys::root::KEYS;

#[cfg(test)]
mod tests;
