//! Positions of the contacts in a journal.

use super::{DatasetError, JournalError, JournalRecords, Record, RecordedContact};
use crate::recipe::{ENTRIES_MAX, PRESSES_MAX};
use std::slice::Iter;

/// Position that means "no contact".
const NOWHERE: u64 = u64::MAX;

/// Index of the plan's entries in the journal, with their byte positions. It takes 8 bytes for each entry, reserved when the run
/// begins. So the memory of a run doesn't grow.
#[derive(Debug, Default)]
pub(super) struct Index {
    offsets: Vec<u64>,
    done: u64,
}

/// Contacts of a run in the order of their numbers, read from its journal one by one.
#[derive(Debug)]
pub struct RecordedContacts<'a> {
    records: JournalRecords,
    offsets: Iter<'a, u64>,
}

impl Index {
    /// Creates an empty index for `entries` entries. A plan with more entries than usual makes it grow.
    pub(super) fn with_room(entries: u64) -> Index {
        Index { offsets: vec![NOWHERE; entries.min(PRESSES_MAX as u64) as usize], done: 0 }
    }

    /// Stores the position at which an entry's contact begins.
    ///
    /// # Errors
    /// No plan has such an entry.
    pub(super) fn insert(&mut self, press: u64, offset: u64) -> Result<(), String> {
        let entry = usize::try_from(press).ok().filter(|&entry| entry < ENTRIES_MAX);
        let entry = entry.ok_or_else(|| format!("the plan has no press {press}"))?;
        if entry >= self.offsets.len() {
            self.offsets.resize(entry + 1, NOWHERE);
        }
        if self.offsets[entry] != NOWHERE {
            return Err(format!("press {press} is repeated here"));
        }
        self.done += 1;
        self.offsets[entry] = offset;
        Ok(())
    }

    /// Whether an entry's contact exists.
    pub(super) fn has(&self, press: u64) -> bool {
        usize::try_from(press).is_ok_and(|entry| self.offsets.get(entry).is_some_and(|&offset| offset != NOWHERE))
    }

    /// Returns the number of contacts.
    pub(super) fn done(&self) -> u64 {
        self.done
    }

    /// Returns the contacts, from the records of the indexed journal.
    pub(super) fn contacts(&self, records: JournalRecords) -> RecordedContacts<'_> {
        RecordedContacts { records, offsets: self.offsets.iter() }
    }
}

impl RecordedContacts<'_> {
    fn at(&mut self, offset: u64) -> Result<RecordedContact, JournalError> {
        match self.records.at(offset)? {
            Record::Contact(contact) => Ok(contact),
            _ => Err(self.records.damaged(offset, "no longer a contact".to_owned())),
        }
    }
}

impl Iterator for RecordedContacts<'_> {
    type Item = Result<RecordedContact, DatasetError>;

    fn next(&mut self) -> Option<Self::Item> {
        let offset = *self.offsets.find(|offset| **offset != NOWHERE)?;
        Some(self.at(offset).map_err(DatasetError::from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_index_counts_each_entry_once_and_refuses_what_no_plan_has() {
        let mut index = Index::with_room(2);
        for (press, offset) in [(5, 0), (1, 100)] {
            index.insert(press, offset).unwrap();
        }
        assert_eq!((index.done(), index.has(1), index.has(5), index.has(0)), (2, true, true, false));
        assert_eq!(index.insert(1, 200), Err("press 1 is repeated here".to_owned()));
        assert_eq!(index.insert(u64::MAX, 0), Err(format!("the plan has no press {}", u64::MAX)));
        assert!(!index.has(u64::MAX));
    }
}
