//! Links: the path of bytes to an instrument and back.
//!
//! A [`Link`] is the location of an instrument, as stated in a rig file. A [`Connector`] opens the link as often as needed and
//! returns a [`ByteStream`]. A driver can't distinguish a serial port, a socket and an emulator at the end of [`in_memory`]. [`LineExchange`]
//! handles one request at a time over a line protocol. It has a deadline for each request, a stop that doesn't wait, and
//! resynchronisation after a misfit. [`Claims`] reserve a real device for one program.

mod claim;
mod connect;
pub mod daqmx;
mod datagram;
mod line;
mod lines;
mod link;
mod lock_file;
mod memory;
mod opened;
mod program;

pub use claim::{ClaimError, Claims};
pub use connect::{ByteStream, Connector, Duplex};
pub use line::{LineExchange, Urgent};
pub use lines::{LineLink, WireError, silent};
pub use link::{Link, Parity, SerialLine};
pub use memory::{MemoryStream, in_memory};
