//! Whether a typed serial number may be calibrated now.

use super::{Standing, State, check_serial};

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

impl State {
    /// Returns the kind of a typed sensor, if it may be calibrated now.
    ///
    /// # Errors
    /// The reason for the person, and what to do.
    pub fn admit(&self, typed: &str, tray: Tray) -> Result<Admitted, String> {
        check_serial(typed)?;
        if tray.iter().any(|placed| placed == typed) {
            return Err(format!("{typed} is on the tray already"));
        }
        let is_on_tray = |item: &super::Item| tray.contains(&item.serial);
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
            return Err(format!("{typed} isn't in this batch: check it, or add it with `palpate batch add`"));
        };
        let again = format!("type `.repeat {typed}` to allow it again");
        match item.standing {
            Standing::Waiting => {}
            // the reference sensor is measured again and again; only after a trip a person finds its cause first
            standing if is_reference && standing != Standing::Tripped => {}
            standing if standing.is_judged() => {
                return Err(format!("{typed} was calibrated already ({}): {again}", standing.name()));
            }
            Standing::Tripped => return Err(format!("{typed} ended with a safety trip: find its cause, then {again}")),
            Standing::Skipped => return Err(format!("{typed} was skipped: {again}")),
            standing => return Err(format!("{typed} is {}: {again}", standing.name())),
        }
        Ok(if is_reference { Admitted::Reference } else { Admitted::Sensor })
    }
}

#[cfg(test)]
mod tests {
    use super::super::Event;
    use super::super::state::tests::{at, began, begun, ended};
    use super::*;
    use palpate_data::acceptance::Verdict;
    use palpate_data::dataset::Status;

    #[test]
    fn the_failure_twins_of_a_typed_serial_number() {
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
            ended("A-1", Status::Complete, Some(Verdict::Accepted)),
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
            ("a-4", "a-4 isn't in this batch: check it, or add it with `palpate batch add`"),
            (
                "A 4",
                "not a serial number: expected 1 to 64 letters, digits, '-', '_' and '.', and no '.' at the beginning",
            ),
        ] {
            assert_eq!(state.admit(typed, &[]).unwrap_err(), reason);
        }
        assert_eq!(state.admit("A-4", &["A-4".to_owned()]).unwrap_err(), "A-4 is on the tray already");
        state.take_in(&Event::Retry { at: at(), serial: "A-2".to_owned() }).unwrap();
        assert_eq!(state.admit("A-2", &[]), Ok(Admitted::Sensor));
    }
}
