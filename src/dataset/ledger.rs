use super::{Contact, DatasetError, Record};
use crate::device::Identity;
use std::collections::BTreeSet;

/// What a walk needs of a record: what is there already, and where what it measures goes.
pub trait Ledger {
    /// Whether an entry of the plan is recorded, by its number.
    fn has(&self, press: u64) -> bool;

    /// The load cell's reading in air when the run began, N; none before the first zero.
    fn first_zero_n(&self) -> Option<f64>;

    /// Time that has passed in the run, s.
    fn elapsed_s(&self) -> f64;

    /// Adds a record. When this returns it is kept: in a folder, on the disk.
    ///
    /// # Errors
    /// The operating system's.
    fn record(&mut self, record: &Record) -> Result<(), DatasetError>;

    /// Keeps what the devices said they are.
    ///
    /// # Errors
    /// The operating system's.
    fn note_devices(&mut self, devices: &[Identity]) -> Result<(), DatasetError>;

    /// Keeps how much time has passed in the run, s.
    fn note_elapsed(&mut self, elapsed_s: f64);
}

/// A ledger that ends with the program: for studies and tests, which leave no files.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    records: Vec<Record>,
    done: BTreeSet<u64>,
    devices: Vec<Identity>,
    elapsed_s: f64,
}

impl Memory {
    /// All records in the order they were made.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// The contacts in the order they were made.
    pub fn contacts(&self) -> impl Iterator<Item = &Contact> {
        self.records.iter().filter_map(Record::contact)
    }

    /// What the devices said they are.
    pub fn devices(&self) -> &[Identity] {
        &self.devices
    }
}

impl Ledger for Memory {
    fn has(&self, press: u64) -> bool {
        self.done.contains(&press)
    }

    fn first_zero_n(&self) -> Option<f64> {
        self.records.iter().find_map(|record| match record {
            Record::Zero { offset_n, .. } => Some(*offset_n),
            _ => None,
        })
    }

    fn elapsed_s(&self) -> f64 {
        self.elapsed_s
    }

    fn record(&mut self, record: &Record) -> Result<(), DatasetError> {
        self.done.extend(record.contact().map(|contact| contact.press));
        self.records.push(record.clone());
        Ok(())
    }

    fn note_devices(&mut self, devices: &[Identity]) -> Result<(), DatasetError> {
        self.devices = devices.to_vec();
        Ok(())
    }

    fn note_elapsed(&mut self, elapsed_s: f64) {
        self.elapsed_s = elapsed_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_keeps_what_a_walk_asks_for_again() {
        let mut memory = Memory::default();
        assert_eq!((memory.has(3), memory.first_zero_n(), memory.elapsed_s()), (false, None, 0.0));
        let zero = |offset_n| Record::Zero { t_s: 1.0, offset_n, sigma_n: 0.003, outputs: vec![] };
        let contact = Contact { press: 3, rows: vec![], truth: vec![], lesson: None };
        for record in [zero(0.25), Record::Contact(contact.clone()), zero(0.5)] {
            memory.record(&record).unwrap();
        }
        memory.note_elapsed(12.0);
        assert_eq!((memory.has(3), memory.has(2)), (true, false));
        assert_eq!((memory.first_zero_n(), memory.elapsed_s()), (Some(0.25), 12.0), "the first zero stays the first");
        assert_eq!(memory.contacts().collect::<Vec<_>>(), [&contact]);
        assert_eq!(memory.records().len(), 3);
    }
}
