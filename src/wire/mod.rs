//! Links: how bytes get to an instrument and back.
//!
//! A [`Link`] is where an instrument is, as a rig file says it. A [`Connector`] opens it, as often as need be, and gives a
//! [`ByteStream`]; a driver can't distinguish a serial port, a socket and an emulator in memory. [`LineExchange`] is one request
//! at a time over a line protocol: each with a deadline, a stop that needn't wait, and resynchronisation after a misfit. [`Claims`]
//! keep a real link for one program.

mod claim;
mod connect;
pub mod daqmx;
mod line;
mod lines;
mod link;
mod program;

pub use claim::{ClaimError, Claims};
pub use connect::{ByteStream, Connector, Duplex};
pub use line::{LineExchange, Urgent};
pub use lines::{Lines, WireError, silent};
pub use link::{Link, Parity};
