//! How the bytes of a board reach the computer.

use std::collections::VecDeque;

/// Boot time of an Uno or a Nano, s: its bootloader waits for a new program. Optiboot waits 1 s (Optiboot/optiboot, issue 98), newer
/// versions 2 s (pull request 158). 1.7 s is between them.
const BOOTLOADER_S: f64 = 1.7;

/// Bits that a serial line needs for a byte: 8N1.
const BITS_PER_BYTE: f64 = 10.0;

/// Number of bytes that wait in the processor while a sketch continues: `SERIAL_TX_BUFFER_SIZE` of an Uno. A sketch that prints
/// more waits.
const PRINTED_AHEAD: f64 = 64.0;

/// Largest number of bytes that wait for a client, while an adapter withholds them. Further lines are lost.
const WAITING_MOST: usize = 1 << 20;

/// Port of a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Port {
    /// Bits per second of a serial line with 8N1. `None`: native USB or TCP, where a line takes no time. A link
    /// that names a rate replaces it.
    pub baud: Option<f64>,
    /// Silence after a link was opened, s: the adapter resets the board. `None` if opening doesn't reset the board.
    pub boot_s: Option<f64>,
    /// Time that a board that isn't reset needs when its first link is opened, s.
    pub setup_s: f64,
    /// Whether each frame is a datagram of its own.
    pub packets: bool,
}

impl Port {
    /// A board behind a USB adapter whose DTR line resets it when a link is opened: Uno, Nano, Mega.
    pub fn uno(baud: f64) -> Self {
        Port { baud: Some(baud), boot_s: Some(BOOTLOADER_S), setup_s: 0.0, packets: false }
    }

    /// A board with native USB, which isn't reset when a link is opened: Zero, Trinket M0, QT Py, Leonardo.
    pub fn native_usb(setup_s: f64) -> Self {
        Port { baud: None, boot_s: None, setup_s, packets: false }
    }

    /// A serial line without a reset.
    pub fn serial(baud: f64) -> Self {
        Port { baud: Some(baud), boot_s: None, setup_s: 0.0, packets: false }
    }

    /// A network over which each frame is a datagram. A new client gets nothing until it asks.
    pub fn datagrams() -> Self {
        Port { baud: None, boot_s: None, setup_s: 0.0, packets: true }
    }
}

/// Sender of a board: bytes that are on their way, each with its time of arrival.
pub(super) struct Uart {
    /// Time for each byte, s.
    byte_s: f64,
    /// Whether what is sent arrives frame by frame.
    packets: bool,
    under_way: VecDeque<Transmission>,
    /// Number of bytes under way.
    waiting: usize,
    /// Time at which all bytes are sent, s.
    free_s: f64,
}

struct Transmission {
    bytes: Vec<u8>,
    from_s: f64,
    taken: usize,
}

impl Uart {
    pub(super) fn new(port: Port) -> Self {
        let byte_s = port.baud.map_or(0.0, |baud| BITS_PER_BYTE / baud);
        Uart { byte_s, packets: port.packets, under_way: VecDeque::new(), waiting: 0, free_s: 0.0 }
    }

    /// Sets the time for each byte, s.
    pub(super) fn set_byte_s(&mut self, byte_s: f64) {
        self.byte_s = byte_s;
    }

    /// Sends bytes from `at_s` on, after those under way. Returns the time at which the last byte is sent, s.
    pub(super) fn send(&mut self, bytes: Vec<u8>, at_s: f64) -> f64 {
        let from_s = at_s.max(self.free_s);
        self.free_s = from_s + bytes.len() as f64 * self.byte_s;
        if !bytes.is_empty() && self.waiting + bytes.len() <= WAITING_MOST {
            self.waiting += bytes.len();
            self.under_way.push_back(Transmission { bytes, from_s, taken: 0 });
        }
        self.free_s
    }

    /// Time from which a sketch can print without waiting, s.
    pub(super) fn has_room_s(&self) -> f64 {
        self.free_s - PRINTED_AHEAD * self.byte_s
    }

    /// Takes the bytes that have arrived at `now_s`; of packets the first.
    pub(super) fn arrived(&mut self, now_s: f64) -> Vec<u8> {
        let mut arrived = Vec::new();
        while let Some(first) = self.under_way.front_mut() {
            let sent = first.sent(self.byte_s, now_s);
            arrived.extend_from_slice(&first.bytes[first.taken..sent.max(first.taken)]);
            first.taken = sent.max(first.taken);
            if first.taken < first.bytes.len() {
                break;
            }
            self.under_way.pop_front();
            if self.packets {
                break;
            }
        }
        self.waiting -= arrived.len();
        arrived
    }

    /// Time at which the next transmission is complete, s; infinite if there is none.
    pub(super) fn next_s(&self) -> f64 {
        self.under_way.front().map_or(f64::INFINITY, |first| first.from_s + first.bytes.len() as f64 * self.byte_s)
    }

    /// Stops sending at `at_s`: bytes that weren't sent until then are lost.
    pub(super) fn cut(&mut self, at_s: f64) {
        for transmission in &mut self.under_way {
            let sent = transmission.sent(self.byte_s, at_s).max(transmission.taken);
            transmission.bytes.truncate(sent);
        }
        self.under_way.retain(|transmission| transmission.taken < transmission.bytes.len());
        self.waiting = self.under_way.iter().map(|transmission| transmission.bytes.len() - transmission.taken).sum();
        self.free_s = at_s;
    }

    /// Loses all bytes under way.
    pub(super) fn clear(&mut self, now_s: f64) {
        self.under_way.clear();
        self.waiting = 0;
        self.free_s = now_s;
    }
}

impl Transmission {
    /// Number of bytes that are sent at `now_s`.
    fn sent(&self, byte_s: f64, now_s: f64) -> usize {
        match (now_s - self.from_s) / byte_s {
            _ if now_s < self.from_s => 0,
            bytes if bytes.is_finite() => (bytes as usize).min(self.bytes.len()),
            _ => self.bytes.len(), // a line takes no time
        }
    }
}
