//! Emulated devices, byte by byte: requests in the form of a device's manual act on a [`Scene`], and the answers have the form of
//! the manual.
//!
//! An [`Instrument`] is one device. It finds complete requests in a stream of bytes and answers them; it has no access to clocks,
//! sockets or threads. [`serve`] puts it on the far end of any stream, on tokio's paused clock or the real one. [`listen`] offers
//! it to other programs. These emulators and the drivers are two independent implementations of one manual and share no code, so
//! that a wrong scale factor cannot cancel out.
//!
//! - [`Esp301`]: a Newport ESP301 motion controller with three VP-25XL stages.
//! - [`Xps`]: a Newport XPS-Q8 motion controller with one group of three VP-25XL stages, and a load cell on an analog input.
//! - [`DaqmxEmulator`]: a USB-6343 behind NI's DAQmx library. The library is called, not written to, so it is no [`Instrument`].
//! - [`Modbus`]: a Modbus device, RTU or TCP, over a register map: [`Transmitter`], [`LaumasTlb`] or [`SenecaZsg`] (load cells),
//!   or [`LabJackT7`] (load cell or array).
//! - [`Grbl`]: GRBL 1.1h on a frame of three axes.
//! - [`ProcessStage`], [`ProcessLoadCell`], [`ProcessArray`]: devices of the process protocol (docs/process.md).

mod daqmx;
mod esp301;
mod grbl;
pub mod listen;
mod modbus;
mod process;
mod serve;
#[cfg(test)]
mod tests;
mod xps;

pub use daqmx::DaqmxEmulator;
pub use esp301::Esp301;
pub use grbl::Grbl;
pub use modbus::{LabJackT7, LaumasTlb, Modbus, Refusal, RegisterMap, SenecaZsg, Transmitter, Word};
pub use process::{ProcessArray, ProcessLoadCell, ProcessStage};
pub use serve::{INBOX_MOST, serve};
pub use xps::Xps;

use crate::scene::{Device, Scene};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::Notify;

/// State that several links or instruments use together. A device keeps its state when a link is dropped and opened again, and
/// all devices of a rig act on one scene.
pub type Shared<T> = Arc<Mutex<T>>;

/// Travel of every emulated stage to either side along each axis, mm: that of a VP-25XL.
pub const STAGE_TRAVEL_MM: f64 = 12.5;

/// One emulated device: bytes in, bytes out, acting on a scene.
pub trait Instrument: Send {
    /// The role it plays in the scene, which decides how long it takes to answer.
    fn device(&self) -> Device;

    /// Takes the next whole request off the front of the inbox, or none as long as it isn't whole. What can never become
    /// a request may be thrown away; the inbox never grows beyond [`INBOX_MOST`].
    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>>;

    /// How long a silence on the line ends a frame; none where the bytes themselves say where one ends.
    fn silence(&self) -> Option<Duration> {
        None
    }

    /// The line fell silent with these bytes left over: takes them as a request, or throws them away.
    fn fall_silent(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        inbox.clear();
        None
    }

    /// Acts on a request at `now_s`; the bytes to send back, none for a silent command. Never called with a `now_s` that
    /// lies before an earlier one.
    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8>;

    /// Until when the device takes no request at all, s; a time that has passed: it listens.
    fn deaf_until_s(&self) -> f64 {
        0.0
    }

    /// A link is opened: the instrument that stands for the device on this link, where the device keeps its links apart.
    /// None: all links share this one.
    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        None
    }

    /// What is rung when an answer that is [owed](Self::owed) may be due sooner than was said, or on another link. None: the
    /// device never owes one, and isn't asked.
    fn bell(&self) -> Option<Arc<Notify>> {
        None
    }

    /// What the device owes this link at `now_s`; requests are taken meanwhile.
    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        let _ = (scene, now_s);
        Owed::Nothing
    }
}

/// Answer that a device still owes a link after it took a request to answer later.
#[derive(Clone, Debug, PartialEq)]
pub enum Owed {
    /// No answer, until its bell is rung.
    Nothing,
    /// Perhaps an answer at this time, s. The caller asks again then, or when its bell is rung.
    At(f64),
    /// These bytes, now.
    Ready(Vec<u8>),
    /// No answer any more: the device hung up, and the link is closed.
    HungUp,
}
