//! Whether a typed serial number may be calibrated now.

use super::{BatchState, SensorState, check_serial};

/// Kind of a sensor that may be calibrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Admitted {
    /// A sensor of the batch.
    Sensor,
    /// The reference sensor.
    Reference,
}

/// Serial numbers that were typed and not calibrated yet: the sensors on the tray.
pub(crate) type Tray<'a> = &'a [String];

impl BatchState {
    /// Returns the kind of a typed sensor, if it may be calibrated now.
    ///
    /// # Errors
    /// The reason for the person, and what to do.
    pub fn admit(&self, typed: &str, tray: Tray) -> Result<Admitted, String> {
        check_serial(typed)?;
        if tray.iter().any(|placed| placed == typed) {
            return Err(format!("{typed} is on the tray already"));
        }
        let is_on_tray = |item: &super::BatchSensor| tray.contains(&item.serial);
        let is_reference = self.is_reference(typed);
        if let Some(reference) = self.reference.as_ref().filter(|item| self.is_reference_due() && !is_on_tray(item))
            && !is_reference
        {
            let serial = &reference.serial;
            return Err(format!(
                "the reference sensor {serial} is due: put it on the bench and type {serial}, or type `later`"
            ));
        }
        let Some(item) = self.item(typed) else {
            let alike = self.spelled_alike(typed).map(|serial| format!("did you mean {serial}? Else "));
            return Err(format!(
                "{typed} isn't in this batch: {}check it, or add it with `palpate batch add`",
                alike.unwrap_or_default()
            ));
        };
        let again = format!("type `.repeat {typed}` to allow it again");
        match item.sensor_state {
            SensorState::Waiting => {}
            // the reference sensor is measured repeatedly; only after a trip a person finds its cause first
            sensor_state if is_reference && sensor_state != SensorState::Tripped => {}
            sensor_state if sensor_state.is_judged() => {
                return Err(format!("{typed} was calibrated already ({}): {again}", sensor_state.name()));
            }
            SensorState::Tripped => {
                return Err(format!("{typed} ended with a safety trip: find its cause, then {again}"));
            }
            SensorState::Skipped => return Err(format!("{typed} was skipped: {again}")),
            sensor_state => return Err(format!("{typed} is {}: {again}", sensor_state.name())),
        }
        Ok(if is_reference { Admitted::Reference } else { Admitted::Sensor })
    }

    /// Returns the only sensor whose serial number differs from the typed one by nothing but case, separators and leading zeros.
    fn spelled_alike(&self, typed: &str) -> Option<&str> {
        let all = self.items.iter().chain(&self.reference).map(|item| item.serial.as_str());
        let mut alike = all.filter(|serial| plain(serial) == plain(typed));
        alike.next().filter(|_| alike.next().is_none())
    }
}

/// Returns a serial number in lower case, without separators and without the zeros that begin its numbers.
fn plain(serial: &str) -> String {
    let mut plain = String::new();
    let mut letters = serial.chars().filter(char::is_ascii_alphanumeric).peekable();
    while let Some(letter) = letters.next() {
        let begins = !plain.ends_with(|before: char| before.is_ascii_digit());
        let has_more = letters.peek().is_some_and(char::is_ascii_digit);
        if !(letter == '0' && begins && has_more) {
            plain.push(letter.to_ascii_lowercase());
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::super::BatchEvent;
    use super::super::state::tests::{at, began, begun, ended};
    use super::*;
    use palpate_data::acceptance::SensorVerdict;
    use palpate_data::dataset::Status;

    #[test]
    fn wrong_serial_numbers_are_refused() {
        let mut state = begun();
        assert_eq!(
            state.admit("A-1", &[]).unwrap_err(),
            "the reference sensor REF is due: put it on the bench and type REF, or type `later`"
        );
        assert_eq!(state.admit("REF", &[]), Ok(Admitted::Reference));
        assert_eq!(state.admit("A-1", &["REF".to_owned()]), Ok(Admitted::Sensor), "it is in another nest");
        let all = [
            began("REF"),
            ended("REF", Status::Complete, None),
            began("A-1"),
            ended("A-1", Status::Complete, Some(SensorVerdict::Accepted)),
            began("A-2"),
            ended("A-2", Status::Tripped, None),
            began("A-3"),
        ];
        all.iter().for_each(|event| state.take_in(event).unwrap());
        assert_eq!(state.admit("A-4", &[]), Ok(Admitted::Sensor));
        assert_eq!(state.admit("REF", &[]), Ok(Admitted::Reference));
        for (typed, reason) in [
            ("A-1", "A-1 was calibrated already (accepted): type `.repeat A-1` to allow it again"),
            ("A-2", "A-2 ended with a safety trip: find its cause, then type `.repeat A-2` to allow it again"),
            ("A-3", "A-3 is interrupted: type `.repeat A-3` to allow it again"),
            ("a-4", "a-4 isn't in this batch: did you mean A-4? Else check it, or add it with `palpate batch add`"),
            ("A04", "A04 isn't in this batch: did you mean A-4? Else check it, or add it with `palpate batch add`"),
            ("A-40", "A-40 isn't in this batch: check it, or add it with `palpate batch add`"),
            (
                "A 4",
                "not a serial number: expected 1 to 64 letters, digits, '-', '_' and '.', and no '.' at the beginning",
            ),
        ] {
            assert_eq!(state.admit(typed, &[]).unwrap_err(), reason);
        }
        assert_eq!(state.admit("A-4", &["A-4".to_owned()]).unwrap_err(), "A-4 is on the tray already");
        state.take_in(&BatchEvent::Retry { at: at(), serial: "A-2".to_owned() }).unwrap();
        assert_eq!(state.admit("A-2", &[]), Ok(Admitted::Sensor));
    }
}
