//! Everything known about a run except its presses: the content of its journal's records, and the position of each contact in the
//! journal.

use super::fingerprint::is_plain;
use super::index::Index;
use super::journal::JOURNAL;
use super::manifest::MANIFEST;
use super::views::PRESSES;
use super::{
    DatasetError, Journal, JournalRecords, Loss, Manifest, Peaks, Press, Record, RecordedText, SeriesMark, Status,
};
use crate::recipe::Phase;
use std::path::Path;

/// Largest number of trips whose truth is kept. No run was continued after that many trips.
const TRIPS_MAX: usize = 10_000;

/// Summary of a journal, so that it needn't be read again.
#[derive(Debug, Default)]
pub(super) struct JournalSummary {
    pub contacts: Index,
    pub manifest: Manifest,
    /// Every text that a session used, in order.
    pub texts: Vec<RecordedText>,
    /// Number of records.
    pub records: u64,
    /// Ending of the run, if nothing was measured or lost after it.
    pub end: Option<Status>,
    /// For each trip, the entry that was being executed and its true peaks.
    pub trips: Vec<(Option<u64>, Peaks)>,
    /// Length of the file of readings after the last contact.
    pub series: Option<SeriesMark>,
    /// The last check.
    pub last_check: Option<String>,
    /// Number of outputs of each press; `None` before the first press, if the number wasn't given.
    channels: Option<usize>,
    /// Number of levels of each phase, in the order of [`Phase::ALL`].
    levels: [u64; Phase::ALL.len()],
}

impl JournalSummary {
    /// Creates the empty state of a run on an array with `channels` outputs, if this number is known.
    pub(super) fn of(channels: Option<usize>) -> JournalSummary {
        JournalSummary { channels, ..JournalSummary::default() }
    }

    /// Reads the journal of a run to its end. Returns its content and the journal.
    ///
    /// # Errors
    /// The journal is missing or damaged, or an error of the operating system.
    pub(super) fn read(
        folder: &Path,
        channels: Option<usize>,
    ) -> Result<(JournalSummary, JournalRecords), DatasetError> {
        let mut known = JournalSummary::of(channels);
        let records = Journal::read(&folder.join(JOURNAL), |offset, record| known.take_in(offset, record))?;
        Ok((known, records))
    }

    /// Adds a record. A journal begins with exactly one description of the run, and contains each entry of the plan once,
    /// complete.
    pub(super) fn take_in(&mut self, offset: u64, record: &Record) -> Result<(), String> {
        if !matches!(record, Record::Loss(Loss { lost, .. }) if lost.is_empty()) {
            self.end = None; // another journal was accepted, with its end
        }
        match record {
            Record::Run(_) if offset > 0 => return Err("a second start of the run".to_owned()),
            Record::Run(facts) => self.contacts = Index::with_room(facts.presses_planned),
            _ if offset == 0 => return Err("the first record is missing".to_owned()),
            Record::Text(RecordedText { name, .. }) if !is_plain(name) => return Err(unplain(name)),
            Record::Session(session) => {
                if let Some(text) = session.texts.iter().find(|text| !is_plain(&text.name)) {
                    return Err(unplain(&text.name));
                }
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
                if let Some(mark) = &contact.series {
                    let before = self.series.as_ref().map_or(0, |before| before.bytes);
                    if mark.bytes < before {
                        return Err(format!(
                            "its readings end at byte {}, before those of an earlier press",
                            mark.bytes
                        ));
                    }
                    self.series = Some(mark.clone());
                }
                self.contacts.insert(contact.press, offset)?;
                for (phase, count) in Phase::ALL.into_iter().zip(&mut self.levels) {
                    *count += contact.levels.iter().filter(|press| press.is_of(phase)).count() as u64;
                }
            }
            Record::Check(check) => {
                let made = self.manifest.checks;
                if check.number != made {
                    return Err(format!("check {}, expected {made}", check.number));
                }
                let is_of_it = |press: &Press| {
                    press.press == check.number && self.channels.is_none_or(|channels| press.outputs.len() == channels)
                };
                if !check.contact.levels.iter().all(is_of_it) {
                    return Err(format!("its levels don't match check {} on this array", check.number));
                }
                self.last_check = Some(check.line());
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

    /// Whether the plan is finished and the journal states this, so that nothing can be missing.
    pub(super) fn is_complete(&self) -> bool {
        let is_whole = self.manifest.presses_done == self.manifest.facts.presses_planned;
        self.end == Some(Status::Complete) && is_whole
    }

    /// Returns the number of levels of a phase.
    pub(super) fn levels_of(&self, phase: Phase) -> u64 {
        Phase::ALL.into_iter().zip(self.levels).find(|(its, _)| *its == phase).map_or(0, |(_, count)| count)
    }
}

fn unplain(name: &str) -> String {
    format!("{name:?} is not a valid name of a file in a run folder")
}

/// Checks that a path is a run: a folder with a journal in it.
///
/// # Errors
/// The path isn't a run.
pub fn check_run(path: &Path) -> Result<(), DatasetError> {
    if path.join(JOURNAL).is_file() {
        return Ok(());
    }
    if path.join(JOURNAL).is_dir() {
        return Err(DatasetError::JournalFolder { path: path.to_owned() });
    }
    let is_rest_of_one = [MANIFEST, PRESSES].iter().all(|name| path.join(name).is_file());
    let path = path.to_owned();
    Err(match path.exists() {
        false => DatasetError::Missing { path },
        true if is_rest_of_one => DatasetError::NoJournal { path },
        true => DatasetError::NoRun { path },
    })
}
