//! Instruments that speak Modbus, RTU on a serial line or TCP: which registers mean what is a [`Profile`], not code.

mod array;
mod client;
mod line;
mod load_cell;
mod number;
mod profile;

pub use array::ModbusArray;
pub use client::Client;
pub use load_cell::ModbusLoadCell;
pub use number::{Encoding, NumberType, WordOrder};
pub use profile::{Function, Profile, Register, SHIPPED, Transport};

#[cfg(test)]
mod tests;
