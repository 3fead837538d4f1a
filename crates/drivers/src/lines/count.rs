//! A device's own count of its readings: repeated, lost and late ones.

/// Column of a device's count, and how it grows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CounterColumn {
    /// Its column.
    pub column: usize,
    /// How much it grows for each reading; `None` if that isn't known.
    pub step: Option<f64>,
    /// Number of counts after which it begins again; `None` if it doesn't.
    pub period: Option<f64>,
}

/// Most readings by which a late one is behind the newest. Datagrams that overtook each other differ by a few; a device that
/// restarted begins its count again.
const LATE_MOST: f64 = 16.0;

/// Most readings that are lost without a silence of the device, which stops a run anyway. A larger jump is another stream.
const LOST_MOST: f64 = 10_000.0;

/// What a count shows about its reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Counted {
    /// It is a new reading, and this many were lost before it.
    New { lost: u64 },
    /// It is the same reading again, or an older one that was overtaken.
    Old,
    /// It isn't a reading of the same stream: the count jumped from this number.
    Jumped { from: f64 },
}

impl CounterColumn {
    /// Compares a count with the last one.
    pub(super) fn compare(&self, last: Option<f64>, count: f64) -> Counted {
        let Some(last) = last else { return Counted::New { lost: 0 } };
        let Some(step) = self.step else {
            return if count == last { Counted::Old } else { Counted::New { lost: 0 } };
        };
        let ahead = self.ahead(last, count) / step;
        if ahead > 0.0 {
            // a step that isn't a multiple counts as the next smaller one
            let lost = (ahead - 1.0).max(0.0);
            if lost > LOST_MOST { Counted::Jumped { from: last } } else { Counted::New { lost: lost as u64 } }
        } else if ahead >= -LATE_MOST {
            Counted::Old
        } else {
            Counted::Jumped { from: last }
        }
    }

    /// Returns by how much a count is ahead of the last one, the shorter way round.
    fn ahead(&self, last: f64, count: f64) -> f64 {
        let ahead = count - last;
        match self.period {
            None => ahead,
            Some(period) => {
                let ahead = ahead.rem_euclid(period);
                if ahead < period / 2.0 { ahead } else { ahead - period }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn count_shows_repeated_lost_and_late_readings_and_a_restart() {
        let counter = CounterColumn { column: 0, step: Some(2.0), period: Some(65_536.0) };
        for (last, count, expected) in [
            (None, 7.0, Counted::New { lost: 0 }),
            (Some(10.0), 12.0, Counted::New { lost: 0 }),
            (Some(10.0), 18.0, Counted::New { lost: 3 }),
            (Some(10.0), 10.0, Counted::Old),
            (Some(10.0), 8.0, Counted::Old),
            (Some(65_534.0), 0.0, Counted::New { lost: 0 }),
            (Some(0.0), 65_534.0, Counted::Old),
            (Some(5000.0), 1.0, Counted::Jumped { from: 5000.0 }),
            // more than half of the period
            (Some(40_000.0), 1.0, Counted::Jumped { from: 40_000.0 }),
        ] {
            assert_eq!(counter.compare(last, count), expected, "{last:?} {count}");
        }
        // as text, a count has no end
        let endless = CounterColumn { period: None, ..counter };
        assert_eq!(endless.compare(Some(65_534.0), 0.0), Counted::Jumped { from: 65_534.0 });
        let plain = CounterColumn { step: None, ..counter };
        assert_eq!(plain.compare(Some(5000.0), 1.0), Counted::New { lost: 0 });
        assert_eq!(plain.compare(Some(5.0), 5.0), Counted::Old);
    }
}
