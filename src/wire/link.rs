/// Fastest line rate that is taken for a typing error and refused, baud.
const BAUD_MAX: u32 = 12_000_000;

/// Where an instrument is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Link {
    /// Our emulator, in memory.
    Sim,
    /// A serial port, 8 data bits, no parity, one stop bit.
    Serial {
        /// The port's name, such as `/dev/ttyUSB0` or `COM3`.
        port: String,
        /// Line rate.
        baud: u32,
    },
    /// A TCP server.
    Tcp {
        /// Host name or address.
        host: String,
        /// Port.
        port: u16,
    },
    /// A program of the user's own, started with its standard input and output as the link: the command and its arguments.
    Process(Vec<String>),
    /// NI's DAQmx library on this machine: the system's own, or the file of this path.
    Daqmx(Option<String>),
}

impl Link {
    /// Reads `sim`, `serial:///dev/ttyUSB0?baud=921600` (`serial://COM3?baud=...`), `tcp://host:port`, `daqmx` or
    /// `daqmx:///path/to/library`.
    ///
    /// # Errors
    /// What is wrong, and the form that was expected.
    pub fn parse(text: &str) -> Result<Link, String> {
        if text == "sim" {
            return Ok(Link::Sim);
        }
        if let Some(rest) = text.strip_prefix("serial://") {
            let form = "expected serial://PORT?baud=RATE, such as serial:///dev/ttyUSB0?baud=921600";
            let (port, query) = rest.split_once('?').ok_or_else(|| format!("no line rate: {form}"))?;
            let baud = query.strip_prefix("baud=").and_then(|rate| rate.parse().ok());
            return match baud {
                Some(baud @ 1..=BAUD_MAX) if !port.is_empty() => Ok(Link::Serial { port: port.to_owned(), baud }),
                _ => Err(form.to_owned()),
            };
        }
        if let Some(rest) = text.strip_prefix("tcp://") {
            let parts = rest.rsplit_once(':').and_then(|(host, port)| Some((host, port.parse().ok()?)));
            return match parts {
                Some((host, port)) if !host.is_empty() => Ok(Link::Tcp { host: host.to_owned(), port }),
                _ => Err("expected tcp://HOST:PORT, such as tcp://192.168.1.10:502".to_owned()),
            };
        }
        if text == "daqmx" {
            return Ok(Link::Daqmx(None));
        }
        if let Some(path) = text.strip_prefix("daqmx://") {
            let form = "expected daqmx, or daqmx:///PATH/OF/THE/LIBRARY";
            return if path.is_empty() { Err(form.to_owned()) } else { Ok(Link::Daqmx(Some(path.to_owned()))) };
        }
        Err("expected sim, serial://PORT?baud=RATE, tcp://HOST:PORT or daqmx".to_owned())
    }
}

impl std::fmt::Display for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Link::Sim => f.write_str("sim"),
            Link::Serial { port, baud } => write!(f, "serial://{port}?baud={baud}"),
            Link::Tcp { host, port } => write!(f, "tcp://{host}:{port}"),
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
            "tcp://192.168.1.10:502",
            "daqmx",
            "daqmx:///usr/lib/libnidaqmx.so",
        ] {
            assert_eq!(Link::parse(text).unwrap().to_string(), text);
        }
    }

    #[test]
    fn a_bad_link_says_the_form_that_was_expected() {
        for text in [
            "",
            "serial:///dev/ttyUSB0",
            "serial://?baud=1",
            "serial://a?baud=x",
            "tcp://host",
            "tcp://:1",
            "usb",
            "daqmx://",
        ] {
            assert!(Link::parse(text).unwrap_err().contains("expected"), "{text}");
        }
    }
}
