//! Emulators of devices that only their profile knows: a line profile or a register map of the user. The profile writes what its own
//! reader reads, so a simulated run can't find a mistake in it. Devices whose public source is known have emulators in `sim`.

mod board;
mod cell;
mod registers;
mod response;

pub(super) use board::ProfiledBoard;
pub(super) use cell::{ProfiledCell, most_n};
pub(super) use registers::MappedRegisters;
pub(super) use response::ArrayResponse;
