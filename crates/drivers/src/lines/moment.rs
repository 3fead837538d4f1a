//! When a reading was taken, from its arrival and from the device's own time.

/// Largest difference of two clocks' rates. The estimated difference of the clocks is relaxed by it, so that a device whose clock
/// is slow isn't taken for one whose readings are ever older.
const CLOCKS_DIFFER: f64 = 200e-6;

/// Converts the device's own time to this program's.
///
/// A line can be held back on its way, but can't arrive early. So the least difference of arrival and device time so far is that of
/// the clocks, and what exceeds it is the delay.
#[derive(Debug, Default)]
pub(super) struct DeviceClock {
    /// Difference of the clocks, and the last device time, s.
    known: Option<(f64, f64)>,
}

impl DeviceClock {
    /// Returns the time of a reading, s: at most its arrival. A device time that goes back is a device that restarted, or a counter
    /// that began again: the difference is learned again.
    pub(super) fn taken_s(&mut self, device_s: f64, arrived_s: f64) -> f64 {
        let difference_s = arrived_s - device_s;
        let known_s = match self.known {
            Some((known_s, before_s)) if device_s >= before_s => {
                (known_s + CLOCKS_DIFFER * (device_s - before_s)).min(difference_s)
            }
            _ => difference_s,
        };
        self.known = Some((known_s, device_s));
        known_s + device_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffered_reading_has_its_age() {
        let mut clock = DeviceClock::default();
        assert_eq!(clock.taken_s(5.0, 100.0), 100.0);
        assert!((clock.taken_s(5.1, 100.101) - 100.1).abs() < 1e-4);
        // three lines in one packet, 0.3 s late
        for (device_s, taken_s) in [(5.2, 100.2), (5.3, 100.3), (5.4, 100.4)] {
            assert!((clock.taken_s(device_s, 100.7) - taken_s).abs() < 1e-3);
        }
        // it restarts: its clock begins again
        assert_eq!(clock.taken_s(0.1, 103.0), 103.0);
    }
}
