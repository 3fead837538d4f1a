//! Interface between a run in execution and its record.

use super::{DatasetError, Record, RecordedContact, SeriesQueue};
use std::collections::BTreeSet;

/// Interface between a run in execution and its record: existing data, and the destination of new data.
pub trait Ledger {
    /// Whether an entry of the plan, given by its number, is recorded.
    fn has(&self, press: u64) -> bool;

    /// Reads every record, in the order in which the records were made.
    ///
    /// # Errors
    /// Returns an error for damage, or the operating system's error.
    fn recall(&self, tell: &mut dyn FnMut(&Record)) -> Result<(), DatasetError>;

    /// Adds a record. When this returns, the record is kept; in a folder, it is on the disk.
    ///
    /// # Errors
    /// Returns the operating system's error.
    fn record(&mut self, record: &Record) -> Result<(), DatasetError>;

    /// Adds a record quickly, so that no stage has to wait. The record survives the program's end at once. It survives a power
    /// cut only after the next record is added.
    ///
    /// # Errors
    /// Returns the operating system's error.
    fn append_unsynced(&mut self, record: &Record) -> Result<(), DatasetError> {
        self.record(record)
    }

    /// Returns where the readings of every press go; `None` if they aren't kept.
    fn series(&self) -> Option<SeriesQueue> {
        None
    }
}

/// A ledger in memory that ends with the program: for studies and tests, which write no files.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    records: Vec<Record>,
    done: BTreeSet<u64>,
}

impl Memory {
    /// Returns all records in the order they were made.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// Returns the contacts in the order they were made.
    pub fn contacts(&self) -> impl Iterator<Item = &RecordedContact> {
        self.records.iter().filter_map(Record::contact)
    }
}

impl Ledger for Memory {
    fn has(&self, press: u64) -> bool {
        self.done.contains(&press)
    }

    fn recall(&self, tell: &mut dyn FnMut(&Record)) -> Result<(), DatasetError> {
        self.records.iter().for_each(tell);
        Ok(())
    }

    fn record(&mut self, record: &Record) -> Result<(), DatasetError> {
        self.done.extend(record.contact().map(|contact| contact.press));
        self.records.push(record.clone());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_ledger_returns_what_a_run_reads_again() {
        let mut memory = Memory::default();
        assert!(!memory.has(3));
        let zero = Record::Zero { t_s: 1.0, offset_n: 0.25, sigma_n: 0.003, mains: None, outputs: vec![] };
        let contact = RecordedContact { press: 3, ..RecordedContact::default() };
        let records = [zero.clone(), Record::Contact(contact.clone()), zero];
        records.iter().for_each(|record| memory.record(record).unwrap());
        assert_eq!((memory.has(3), memory.has(2)), (true, false));
        assert_eq!(memory.contacts().collect::<Vec<_>>(), [&contact]);
        let mut text = Vec::new();
        memory.recall(&mut |record| text.push(record.clone())).unwrap();
        assert_eq!(text, records);
    }
}
