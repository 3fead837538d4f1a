//! Devices that send lines or frames on a serial port or over TCP, by themselves or when asked: most Arduinos, many load cells and
//! most public tactile sensors.
//!
//! A [`LineProfile`] states how a reading looks. A [`LineFraming`] finds readings in the bytes. A [`LinePort`] receives them all the
//! time, keeps the newest, and remembers when its last byte arrived. [`LineLoadCell`] and [`LineArray`] read from it, and may share
//! one port.

mod columns;
mod count;
mod framing;
mod hex;
mod keys;
mod moment;
mod net_ft_page;
mod port;
mod profile;
mod roles;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_of_axes;
mod write;

pub use count::CounterColumn;
pub use framing::Rejected;
pub use framing::{Finder, LineFraming};
pub use keys::KEYS;
pub use net_ft_page::{ForceCounts, PAGE_PORT};
pub use port::{LinePort, PortCounts, Received};
pub use profile::{ForceColumns, ForceField, LineProfile, OutputColumns, SHIPPED};
pub use roles::{LineArray, LineLoadCell};
