//! Links in the form that a person writes.

/// Fastest accepted line rate, baud. A faster rate is refused as a typing error.
const BAUD_MAX: u32 = 12_000_000;

/// Link of an instrument.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Link {
    /// This program's emulator, in memory.
    Sim,
    /// This program's emulator, in memory, instead of this real link, with the rate of its line.
    Emulated(Box<Link>),
    /// A serial port, 8 data bits.
    Serial {
        /// The port's name, such as `/dev/ttyUSB0` or `COM3`.
        port: String,
        /// Line rate.
        baud: u32,
        /// Parity; no parity unless the link states another.
        parity: Parity,
        /// Stop bits: 1 or 2.
        stop_bits: u8,
        /// Whether the lines RTS and CTS control the flow.
        rts_cts: bool,
    },
    /// A TCP server.
    Tcp {
        /// Host name or address.
        host: String,
        /// Port.
        port: u16,
    },
    /// A device that sends datagrams after it got one.
    Udp {
        /// Host name or address.
        host: String,
        /// Port.
        port: u16,
    },
    /// A program of the user, given as the command and its arguments. Its standard input and output are the link.
    Process(Vec<String>),
    /// NI's DAQmx library on this machine: the system's own, or the file of this path.
    Daqmx(Option<String>),
}

/// Parity bit that a serial line adds to each byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// Makes the number of ones even.
    Even,
    /// Makes the number of ones odd.
    Odd,
}

/// Rate of a serial line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialLine {
    /// Bits per second.
    pub baud: u32,
    /// Bits of a byte on the line: a start bit, eight data bits, and the parity and stop bits.
    pub bits: u8,
}

impl SerialLine {
    /// Returns the time that a number of bytes takes, s.
    pub fn time_s(self, bytes: usize) -> f64 {
        bytes as f64 * f64::from(self.bits) / f64::from(self.baud)
    }
}

const FLOWS: [(&str, bool); 2] = [("none", false), ("rts-cts", true)];
const PARITIES: [(&str, Parity); 3] = [("none", Parity::None), ("even", Parity::Even), ("odd", Parity::Odd)];

impl Link {
    /// Returns the link in memory to this program's emulator instead of this link.
    #[must_use]
    pub fn emulated(self) -> Link {
        if self.is_simulated() { self } else { Link::Emulated(Box::new(self)) }
    }

    /// Whether this program's emulator is at the far end.
    pub fn is_simulated(&self) -> bool {
        matches!(self, Link::Sim | Link::Emulated(_))
    }

    /// Returns the serial line of the link, or of the link that an emulator replaces; `None` if it names no rate.
    pub fn serial_line(&self) -> Option<SerialLine> {
        match self {
            Link::Serial { baud, parity, stop_bits, .. } => {
                Some(SerialLine { baud: *baud, bits: 9 + u8::from(*parity != Parity::None) + stop_bits })
            }
            Link::Emulated(real) => real.serial_line(),
            _ => None,
        }
    }

    /// Parses `sim`, `serial:///dev/ttyUSB0?baud=921600` (`serial://COM3?baud=...`; `&parity=even`, `&stop_bits=2` and
    /// `&flow=rts-cts` may follow), `tcp://host:port`, `udp://host:port`, `daqmx` or `daqmx:///path/to/library`.
    ///
    /// # Errors
    /// The mistake, and the expected form.
    pub fn parse(text: &str) -> Result<Link, String> {
        if text == "sim" {
            return Ok(Link::Sim);
        }
        if let Some(rest) = text.strip_prefix("serial://") {
            let form = "expected serial://PORT?baud=RATE, such as serial:///dev/ttyUSB0?baud=921600, or with \
                        &parity=even, &stop_bits=2 and &flow=rts-cts appended";
            let (port, query) = rest.split_once('?').ok_or_else(|| format!("the baud rate is missing: {form}"))?;
            return serial(port, query).ok_or_else(|| form.to_owned());
        }
        if let Some(rest) = text.strip_prefix("tcp://") {
            let form = "expected tcp://HOST:PORT, such as tcp://192.168.1.10:502";
            return host_and_port(rest, form).map(|(host, port)| Link::Tcp { host, port });
        }
        if let Some(rest) = text.strip_prefix("udp://") {
            let form = "expected udp://HOST:PORT, such as udp://192.168.1.1:49152";
            return host_and_port(rest, form).map(|(host, port)| Link::Udp { host, port });
        }
        if text == "daqmx" {
            return Ok(Link::Daqmx(None));
        }
        if let Some(path) = text.strip_prefix("daqmx://") {
            let form = "expected daqmx, or daqmx:///PATH/OF/THE/LIBRARY";
            return if path.is_empty() { Err(form.to_owned()) } else { Ok(Link::Daqmx(Some(path.to_owned()))) };
        }
        Err("expected an address: sim, serial://, tcp://, udp:// or daqmx".to_owned())
    }
}

/// Reads `HOST:PORT`.
fn host_and_port(text: &str, form: &str) -> Result<(String, u16), String> {
    let is_number = |port: &str| !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit());
    match text.rsplit_once(':').map(|(host, port)| (host, port, port.parse())) {
        Some((host, _, Ok(port))) if !host.is_empty() => Ok((host.to_owned(), port)),
        Some((host, port, Err(_))) if !host.is_empty() && is_number(port) => {
            Err(format!("but a port is at most {}: correct {port}", u16::MAX))
        }
        _ => Err(form.to_owned()),
    }
}

fn serial(port: &str, query: &str) -> Option<Link> {
    let (mut rate, mut parity, mut stop_bits, mut rts_cts) = (None, Parity::None, 1, false);
    for (key, value) in query.split('&').map(|part| part.split_once('=').unwrap_or((part, ""))) {
        match key {
            "baud" => rate = value.parse().ok().filter(|rate| (1..=BAUD_MAX).contains(rate)),
            "parity" => parity = PARITIES.iter().find(|(name, _)| *name == value)?.1,
            "flow" => rts_cts = FLOWS.iter().find(|(name, _)| *name == value)?.1,
            "stop_bits" => stop_bits = value.parse().ok().filter(|bits| (1..=2).contains(bits))?,
            _ => return None,
        }
    }
    (!port.is_empty()).then_some(Link::Serial { port: port.to_owned(), baud: rate?, parity, stop_bits, rts_cts })
}

impl std::fmt::Display for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Link::Sim | Link::Emulated(_) => f.write_str("sim"),
            Link::Serial { port, baud, parity, stop_bits, rts_cts } => {
                write!(f, "serial://{port}?baud={baud}")?;
                if let Some((name, _)) = PARITIES.iter().skip(1).find(|(_, other)| other == parity) {
                    write!(f, "&parity={name}")?;
                }
                if *stop_bits != 1 {
                    write!(f, "&stop_bits={stop_bits}")?;
                }
                if *rts_cts { f.write_str("&flow=rts-cts") } else { Ok(()) }
            }
            Link::Tcp { host, port } => write!(f, "tcp://{host}:{port}"),
            Link::Udp { host, port } => write!(f, "udp://{host}:{port}"),
            Link::Process(command) => write!(f, "process {}", command.join(" ")),
            Link::Daqmx(None) => f.write_str("daqmx"),
            Link::Daqmx(Some(path)) => write!(f, "daqmx://{path}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_read_and_written_back() {
        for text in [
            "sim",
            "serial:///dev/ttyUSB0?baud=921600",
            "serial://COM3?baud=9600",
            "serial://COM3?baud=9600&parity=even&stop_bits=2",
            "serial:///dev/ttyS0?baud=19200&flow=rts-cts",
            "tcp://192.168.1.10:502",
            "udp://192.168.1.1:49152",
            "daqmx",
            "daqmx:///usr/lib/libnidaqmx.so",
        ] {
            assert_eq!(Link::parse(text).unwrap().to_string(), text);
        }
    }

    #[test]
    fn a_byte_on_a_line_has_a_start_bit_and_what_the_link_states() {
        for (text, bits, byte_s) in [
            ("serial:///dev/a?baud=9600", 10, 10.0 / 9600.0),
            ("serial:///dev/a?baud=2400&parity=even", 11, 11.0 / 2400.0),
            ("serial:///dev/a?baud=115200&parity=odd&stop_bits=2", 12, 12.0 / 115_200.0),
        ] {
            let link = Link::parse(text).unwrap();
            for link in [link.clone(), link.emulated()] {
                let line = link.serial_line().unwrap();
                assert_eq!((line.bits, line.time_s(1)), (bits, byte_s), "{text}");
            }
        }
        for text in ["sim", "tcp://a:1", "daqmx"] {
            let link = Link::parse(text).unwrap().emulated();
            assert_eq!((link.serial_line(), link.is_simulated(), link.to_string()), (None, true, "sim".to_owned()));
        }
    }

    #[test]
    fn bad_link_error_shows_the_expected_form() {
        for text in [
            "",
            "serial:///dev/ttyUSB0",
            "serial://?baud=1",
            "serial://a?baud=x",
            "serial://a?baud=1&parity=maybe",
            "serial://a?baud=1&bits=7",
            "serial://a?baud=1&flow=xon-xoff",
            "tcp://host",
            "tcp://:1",
            "udp://:1",
            "usb",
            "daqmx://",
        ] {
            assert!(Link::parse(text).unwrap_err().contains("expected"), "{text}");
        }
        for text in ["tcp://a:70000", "udp://a:70000"] {
            assert_eq!(Link::parse(text).unwrap_err(), "but a port is at most 65535: correct 70000");
        }
    }
}
