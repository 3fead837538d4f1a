//! Emulated devices, byte by byte: requests in the form of a device's manual act on a [`Scene`], and the answers have the form of
//! the manual.
//!
//! An [`Instrument`] is one device. It finds complete requests in a stream of bytes and answers them; it has no access to clocks,
//! sockets or threads. [`serve`] puts it on the far end of any stream, on tokio's paused clock or the real one, and [`serve_on`] on
//! that of a serial line. [`listen`] offers it to other programs. These emulators and the drivers are two independent
//! implementations of one manual and share no code, so that a wrong scale factor cannot cancel out. Only the calibration of a device
//! is that of the rig.
//!
//! - [`Esp301Emulator`]: a Newport ESP301 motion controller with three VP-25XL stages.
//! - [`XpsEmulator`]: a Newport XPS-Q8 motion controller with one group of three VP-25XL stages, and a load cell on an analog input.
//! - [`DaqmxEmulator`]: a USB-6343 behind NI's DAQmx library. The library is called, not written to, so it is no [`Instrument`].
//! - [`Modbus`]: a Modbus device, RTU or TCP, over a register map: [`Transmitter`], [`LaumasTlb`] or [`SenecaZsg`] (load cells),
//!   or [`LabJackT7`] (load cell or array).
//! - [`GrblEmulator`]: GRBL 1.1h on a frame of three axes.
//! - [`MarlinEmulator`]: Marlin 2.1 on a printer of three axes.
//! - [`UrEmulator`]: a Universal Robots arm of the e-Series with PolyScope 5, on its three ports.
//! - [`KlipperEmulator`]: Klipper 0.12 behind Moonraker on a printer of three axes.
//! - [`lines`]: boards that push lines or frames: an HX711, a Mark-10 gauge, a Net F/T, a Bota sensor or a GSV-8 (load cells), ReSkin, a text board or a Velostat matrix
//!   (arrays).
//! - [`ProcessStageEmulator`], [`ProcessLoadCellEmulator`], [`ProcessArrayEmulator`]: devices of the process protocol (docs/reference/process.md).

mod daqmx;
mod datagrams;
mod esp301;
mod faults;
mod grbl;
mod klipper;
mod line;
pub mod lines;
pub mod listen;
mod marlin;
mod modbus;
mod process;
mod serve;
#[cfg(test)]
mod tests;
mod ur;
mod xps;

pub use daqmx::DaqmxEmulator;
pub use esp301::{Esp301Emulator, EspFault, EspFaultAfterBytes, EspFaultKind};
pub use faults::{DeviceFault, FaultAfterBytes};
pub use grbl::{
    GrblEmulator, GrblFault, GrblFaultAfterBytes, GrblFaultKind, GrblWelcome, MotionBoard as GrblBoard,
    ROOM_MM as GRBL_ROOM_MM,
};
pub use klipper::{KlipperBoard, KlipperEmulator, KlipperFault, KlipperFaultAfterBytes, KlipperFaultKind};
pub use line::serve_on;
pub use marlin::{
    Announced as MarlinAnnounced, MarlinBoard, MarlinEmulator, MarlinFault, MarlinFaultAfterBytes, MarlinFaultKind,
};
pub use modbus::{
    LabJackT7, LaumasTlb, Modbus, Refusal, RegisterBytes, RegisterMap, RobotiqFt300, SenecaZsg, Transmitter,
};
pub use process::{
    Printer, ProcessArrayEmulator, ProcessLoadCellEmulator, ProcessStageEmulator, ProcessStageFault,
    ProcessStageFaultAfterBytes, ProcessStageFaultKind,
};
pub use serve::{INBOX_MOST, serve};
pub use ur::{
    DASHBOARD_PORT as UR_DASHBOARD_PORT, RTDE_PORT as UR_RTDE_PORT, SECONDARY_PORT as UR_SECONDARY_PORT, UrArm,
    UrEmulator, UrFault, UrFaultAfterBytes, UrFaultKind,
};
pub use xps::{XpsEmulator, XpsFault, XpsFaultAfterBytes, XpsFaultKind};

use crate::scene::{Scene, SceneDevice};
use palpate_link::wire::SerialLine;
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
    /// Role of the instrument in the scene, which determines its response time.
    fn device(&self) -> SceneDevice;

    /// Takes the next complete request from the front of the inbox. Returns `None` while the request is incomplete. Bytes that
    /// can never become a request may be discarded. The inbox never grows beyond [`INBOX_MOST`].
    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>>;

    /// Duration of silence on the line that ends a frame, and that must be between an answer and the next request. `None` if the
    /// bytes themselves show the end of a frame.
    fn silence(&self) -> Option<Duration> {
        None
    }

    /// Handles the remaining bytes when the line becomes silent: takes them as a request, or discards them.
    fn fall_silent(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        inbox.clear();
        None
    }

    /// Acts on a request at `now_s` and returns the answer's bytes, which are empty for a silent command. `now_s` never decreases
    /// from call to call.
    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8>;

    /// Time until which the device accepts no requests, s. If this time has passed, the device listens.
    fn deaf_until_s(&self) -> f64 {
        0.0
    }

    /// Puts the device on a serial line that the rig names. Returns whether the device itself sends each byte at its time;
    /// otherwise the line delays what it sends.
    fn on_line(&mut self, line: SerialLine) -> bool {
        let _ = line;
        false
    }

    /// Opens a link. Returns the instrument that represents the device on this link, if the device separates its links. `None` if
    /// all links share this instrument.
    fn accept(&mut self) -> Option<Shared<dyn Instrument>> {
        None
    }

    /// Returns the instrument that represents the device on another of its TCP ports; `None` if it has no such port.
    fn at_port(&self, port: u16) -> Option<Shared<dyn Instrument>> {
        let _ = port;
        None
    }

    /// Notification that an [owed](Self::owed) answer may be due earlier than stated, or on another link. `None` if the device
    /// never owes an answer and isn't asked.
    fn bell(&self) -> Option<Arc<Notify>> {
        None
    }

    /// Returns what the device owes this link at `now_s`. Requests are still accepted.
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
    /// These bytes, now, pushed without a request. If the client doesn't read, they are lost, so that the device isn't slowed down.
    Pushed(Vec<u8>),
    /// No answer any more: the device hung up, and the link is closed.
    HungUp,
}
