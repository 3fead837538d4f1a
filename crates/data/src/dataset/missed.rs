//! Readings of the array or of a monitor that were missed, after which a press was made again.

use super::session::shown_text;
use palpate_core::quantity::shown;
use serde::{Deserialize, Serialize};

/// A reading that was missed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MissedReading {
    /// Time, s since the run's start.
    pub t_s: f64,
    /// Entry that was being executed; `None` between two presses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub press: Option<u64>,
    /// The device, and why there is no reading.
    #[serde(deserialize_with = "shown_text")]
    pub why: String,
}

/// Missed readings of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MissedReadings {
    /// How many.
    pub count: u64,
    /// The last one.
    pub last: MissedReading,
}

impl MissedReadings {
    /// Whether no reading was missed.
    pub fn are_none(&self) -> bool {
        self.count == 0
    }

    /// Returns it in words; `None` if no reading was missed.
    pub fn text(&self) -> Option<String> {
        let MissedReadings { count, last: MissedReading { t_s, press, why } } = self;
        let at = press.map_or_else(|| "between two presses".to_owned(), |press| format!("at press {press}"));
        let readings =
            if *count == 1 { "1 reading was missed".to_owned() } else { format!("{count} readings were missed") };
        (!self.are_none()).then(|| format!("{readings}, the last {at} after {t_s:.1} s: {}", shown(why)))
    }

    pub(super) fn add(&mut self, reading: &MissedReading) {
        self.count += 1;
        self.last = reading.clone();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missed_readings_are_counted_and_the_last_is_named() {
        let mut all = MissedReadings::default();
        assert_eq!(all.text(), None);
        all.add(&MissedReading { t_s: 12.34, press: None, why: "array: silent".to_owned() });
        assert_eq!(
            all.text().unwrap(),
            "1 reading was missed, the last between two presses after 12.3 s: array: silent"
        );
        all.add(&MissedReading { t_s: 20.0, press: Some(7), why: "array: silent".to_owned() });
        assert_eq!(all.text().unwrap(), "2 readings were missed, the last at press 7 after 20.0 s: array: silent");
    }
}
