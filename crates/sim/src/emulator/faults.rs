//! Faults that a test gives a device: at a time, or after so many bytes of input.
//!
//! Another client's lines are a fault too, called `Other` in every family. The device carries them out between those of the client under
//! test. Their answers go to the port that they came from, so nobody here sees them.

/// A fault that happens at a time, or with the first thing after it that it concerns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceFault<K> {
    /// Time from which it can happen, s.
    pub from_s: f64,
    /// What happens.
    pub kind: K,
}

/// A fault that happens when the device has received a number of bytes on all its links. The rest of the line under way comes after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultAfterBytes<K> {
    /// Number of bytes from the start of the device on.
    pub bytes: u64,
    /// What happens.
    pub kind: K,
}

/// Longest request whose bytes are counted one by one.
const HELD_MOST: usize = 1 << 16;

/// Faults that haven't happened yet.
pub(super) struct Faults<K> {
    timed: Vec<DeviceFault<K>>,
    after_bytes: Vec<FaultAfterBytes<K>>,
    received: u64,
    /// Those whose bytes have come since the device last continued.
    due: Vec<K>,
}

impl<K: Copy> Faults<K> {
    pub(super) fn new(timed: &[DeviceFault<K>], after_bytes: &[FaultAfterBytes<K>]) -> Self {
        Faults { timed: timed.to_vec(), after_bytes: after_bytes.to_vec(), received: 0, due: Vec::new() }
    }

    pub(super) fn add(&mut self, fault: DeviceFault<K>) {
        self.timed.push(fault);
    }

    /// Time of the next fault of some kinds, s; infinite without one.
    pub(super) fn next_s(&self, wanted: impl Fn(K) -> bool) -> f64 {
        self.timed.iter().filter(|fault| wanted(fault.kind)).map(|fault| fault.from_s).fold(f64::INFINITY, f64::min)
    }

    /// Takes the next fault of some kinds, if its time has come.
    pub(super) fn take(&mut self, now_s: f64, wanted: impl Fn(K) -> bool) -> Option<K> {
        let next_s = self.next_s(&wanted);
        let index =
            self.timed.iter().position(|fault| wanted(fault.kind) && fault.from_s == next_s && next_s <= now_s)?;
        Some(self.timed.remove(index).kind)
    }

    /// Lets the faults whose bytes have come happen now. A device does this before anything else.
    pub(super) fn come(&mut self, now_s: f64) {
        self.timed.extend(self.due.drain(..).map(|kind| DeviceFault { from_s: now_s, kind }));
    }

    /// Takes the next request from the front of the inbox as `take` does. Bytes beyond the next fault stay in the inbox until it has
    /// happened: an empty request lets it happen. `held` has the bytes of this link that have been counted.
    pub(super) fn admit(
        &mut self,
        inbox: &mut Vec<u8>,
        held: &mut Vec<u8>,
        mut take: impl FnMut(&mut Vec<u8>) -> Option<Vec<u8>>,
    ) -> Option<Vec<u8>> {
        if self.after_bytes.is_empty() && self.due.is_empty() {
            inbox.splice(0..0, held.drain(..));
            return take(inbox);
        }
        let mut bytes = std::mem::take(inbox).into_iter();
        loop {
            let request = take(held).or_else(|| (!self.due.is_empty()).then(Vec::new));
            let byte = if request.is_some() || held.len() == HELD_MOST { None } else { bytes.next() };
            let Some(byte) = byte else {
                inbox.extend(bytes);
                return request;
            };
            held.push(byte);
            self.received += 1;
            let received = self.received;
            let come = self.after_bytes.extract_if(.., |fault| fault.bytes <= received);
            self.due.extend(come.map(|fault| fault.kind));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn take_line(bytes: &mut Vec<u8>) -> Option<Vec<u8>> {
        let end = bytes.iter().position(|&byte| byte == b'\n')?;
        Some(bytes.drain(..=end).collect())
    }

    #[test]
    fn a_fault_comes_after_each_number_of_bytes_once_and_no_byte_is_lost() {
        let sent = b"G1\nM400\nG4\n";
        for bytes in 1..=sent.len() as u64 {
            for chunk in 1..=sent.len() {
                let mut faults = Faults::new(&[], &[FaultAfterBytes { bytes, kind: () }]);
                let (mut inbox, mut held, mut found, mut came_after) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
                for chunk in sent.chunks(chunk) {
                    inbox.extend_from_slice(chunk);
                    while let Some(request) = faults.admit(&mut inbox, &mut held, take_line) {
                        faults.come(1.0);
                        if faults.take(1.0, |()| true).is_some() {
                            came_after.push(found.len());
                        }
                        found.extend(request);
                    }
                }
                assert_eq!(found, sent);
                // before the line that its byte is in, or ends, is carried out
                let lines = sent[..bytes as usize - 1].iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
                assert_eq!(came_after, [lines], "{bytes} bytes in chunks of {chunk}");
            }
        }
    }

    #[test]
    fn of_the_faults_whose_time_has_come_the_earliest_is_taken_first() {
        let at = |from_s, kind| DeviceFault { from_s, kind };
        let mut faults = Faults::new(&[at(2.0, 'b'), at(1.0, 'a'), at(1.5, 'x')], &[]);
        assert_eq!((faults.next_s(|kind| kind != 'x'), faults.take(0.5, |_| true)), (1.0, None));
        assert_eq!([(); 3].map(|()| faults.take(3.0, |kind| kind != 'x')), [Some('a'), Some('b'), None]);
    }
}
