//! What is known of a run without its presses: what its journal says, record by record, and where each contact stands in it.

use super::fingerprint::is_plain;
use super::index::Index;
use super::journal::JOURNAL;
use super::manifest::MANIFEST;
use super::views::PRESSES;
use super::{DatasetError, Journal, Manifest, Peaks, Press, Record, Records, Status, Text};
use crate::recipe::Phase;
use std::path::Path;

/// Most trips whose truth is kept; no run was continued after so many.
const TRIPS_MAX: usize = 10_000;

/// What is known of a journal without reading it again.
#[derive(Debug, Default)]
pub(super) struct Known {
    pub contacts: Index,
    pub manifest: Manifest,
    /// Every text that a session went by, in the order in which they came.
    pub texts: Vec<Text>,
    /// How many records there are.
    pub records: u64,
    /// How the run ended, where that is the last record.
    pub end: Option<Status>,
    /// The entry that was under way at each trip, and what really happened in it.
    pub trips: Vec<(Option<u64>, Peaks)>,
    /// How many outputs each press has; none before the first, where nobody said it.
    channels: Option<usize>,
    /// How many levels of each phase there are, in the order of [`Phase::ALL`].
    levels: [u64; Phase::ALL.len()],
}

impl Known {
    /// Nothing yet of a run on an array of so many channels, if that is known.
    pub fn of(channels: Option<usize>) -> Known {
        Known { channels, ..Known::default() }
    }

    /// What the journal of a run says, and the journal, read to its end.
    ///
    /// # Errors
    /// No journal, a damaged one, or the operating system's.
    pub fn read(folder: &Path, channels: Option<usize>) -> Result<(Known, Records), DatasetError> {
        let mut known = Known::of(channels);
        let records = Journal::read(&folder.join(JOURNAL), |offset, record| known.take_in(offset, record))?;
        Ok((known, records))
    }

    /// A journal begins by saying what the run is, and says it once; each entry of its plan is in it once, whole.
    pub fn take_in(&mut self, offset: u64, record: &Record) -> Result<(), String> {
        self.end = None;
        match record {
            Record::Run(_) if offset > 0 => return Err("a second start of the run".to_owned()),
            Record::Run(facts) => self.contacts = Index::with_room(facts.presses_planned),
            _ if offset == 0 => return Err("the first record is missing".to_owned()),
            Record::Text(text) if !is_plain(&text.name) => {
                return Err(format!("{:?} is not a valid name of a file in a run folder", text.name));
            }
            Record::Text(text) => self.texts.push(text.clone()),
            Record::Contact(contact) => {
                if contact.press >= self.manifest.facts.presses_planned {
                    return Err(format!("the plan has no press {}", contact.press));
                }
                let first = contact.levels.first().map(|press| press.outputs.len());
                let channels = self.channels.or(first);
                let is_of_it = |press: &Press| press.press == contact.press && Some(press.outputs.len()) == channels;
                if !contact.levels.iter().all(is_of_it) {
                    return Err(format!("its levels don't match press {} on this array", contact.press));
                }
                self.channels = channels;
                self.contacts.insert(contact.press, offset)?;
                for (phase, count) in Phase::ALL.into_iter().zip(&mut self.levels) {
                    *count += contact.levels.iter().filter(|press| press.is_of(phase)).count() as u64;
                }
            }
            Record::Trip { press, peaks: Some(peaks), .. } if self.trips.len() < TRIPS_MAX => {
                self.trips.push((*press, *peaks));
            }
            Record::End(end) => self.end = Some(end.status),
            _ => {}
        }
        self.records += 1;
        self.manifest.take_in(record);
        self.manifest.presses_done = self.contacts.done();
        Ok(())
    }

    /// Whether the plan is done and the journal says so: nothing can be missing from it.
    pub fn is_complete(&self) -> bool {
        let is_whole = self.manifest.presses_done == self.manifest.facts.presses_planned;
        self.end == Some(Status::Complete) && is_whole
    }

    /// How many levels there are of a phase.
    pub fn levels_of(&self, phase: Phase) -> u64 {
        Phase::ALL.into_iter().zip(self.levels).find(|(its, _)| *its == phase).map_or(0, |(_, count)| count)
    }
}

/// A run is a folder with a journal in it.
///
/// # Errors
/// It isn't one.
pub fn check_run(path: &Path) -> Result<(), DatasetError> {
    if path.join(JOURNAL).is_file() {
        return Ok(());
    }
    let is_rest_of_one = [MANIFEST, PRESSES].iter().all(|name| path.join(name).is_file());
    let path = path.to_owned();
    Err(if is_rest_of_one { DatasetError::NoJournal { path } } else { DatasetError::NoRun { path } })
}
