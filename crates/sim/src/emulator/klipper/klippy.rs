//! State of Klipper's host software, and what it says about it (Klipper's klippy/klippy.py and klippy/mcu.py).

/// Message of a microcontroller that got a step too late.
pub(super) const TIMER_TOO_CLOSE: &str = concat!(
    "MCU 'mcu' shutdown: Timer too close\nThis often indicates the host computer is overloaded. Check\n",
    "for other processes consuming excessive CPU time, high swap\nusage, disk errors, overheating, unstable voltage, or\n",
    "similar system problems on the host computer."
);

/// Advice that follows the reason of a shutdown.
pub(super) const SHUTDOWN: &str = concat!(
    "\nOnce the underlying issue is corrected, use the\n\"FIRMWARE_RESTART\" command to reset the firmware, reload the\n",
    "config, and restart the host software.\nPrinter is shutdown\n"
);

/// State of Klipper's host software.
pub(super) enum Klippy {
    Ready,
    /// Shut down, with a message.
    Shutdown(String),
    /// Moonraker isn't connected to it until this time, s.
    Disconnected(f64),
    /// It connects to the microcontroller until this time, s.
    Startup(f64),
}

impl Klippy {
    /// Name of the state.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Klippy::Ready => "ready",
            Klippy::Shutdown(_) => "shutdown",
            Klippy::Disconnected(_) => "disconnected",
            Klippy::Startup(_) => "startup",
        }
    }

    /// Message of the state.
    pub(super) fn message(&self) -> String {
        match self {
            Klippy::Ready => "Printer is ready".into(),
            Klippy::Shutdown(message) => message.clone(),
            Klippy::Disconnected(_) => "Klippy Disconnected".into(),
            Klippy::Startup(_) => concat!(
                "\nPrinter is not ready\nThe klippy host software is attempting to connect.  Please\n",
                "retry in a few moments.\n"
            )
            .into(),
        }
    }
}
