//! Manifest: description of a run and its ending, in one JSON object for people and other programs.

use super::session::is_false;
use super::{DatasetError, Fingerprint, Loss, MissedReadings, Provenance, Record, RunFacts, SessionEnd, Status, files};
use palpate_control::{Glitches, Trip};
use palpate_core::quantity::Identity;
use serde::{Deserialize, Serialize};
use std::io;
use std::path::Path;

/// Name of the manifest in the run folder.
pub(super) const MANIFEST: &str = "manifest.json";

/// Largest manifest that is read, bytes. A run that was continued a thousand times is far below it.
const MANIFEST_MAX_BYTES: u64 = 4 << 20;

/// `manifest.json`: description of a run and its ending. Everything except the files' fingerprints follows from the journal.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Ending of the run. During a run the status is `stopped`, which is correct unless a later record changes it.
    pub status: Status,
    /// Description of the run.
    #[serde(flatten)]
    pub facts: RunFacts,
    /// Number of entries on disk.
    pub presses_done: u64,
    /// Number of checks.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub checks: u64,
    /// First check that failed, in one line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub check_failed: Option<String>,
    /// First statement of a person that a press is sound which a safety rule stopped, in one line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub called_sound: Option<String>,
    /// Number of flagged rows.
    pub rows_flagged: u64,
    /// Time in the run, s. In a simulated run it is the time of the simulation.
    pub virtual_s: f64,
    /// Real time, s. The time of a killed program is unknown.
    pub wall_s: f64,
    /// Sessions that began or continued the run: program, place and time.
    pub sessions: Vec<Provenance>,
    /// End time, with its time zone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<String>,
    /// Identities most recently reported by the devices.
    pub devices: Vec<Identity>,
    /// Rule that was broken, in a tripped run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trip: Option<Trip>,
    /// Cause of failure in a failed run, or monitored value that stopped the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// Whether the rig knows a weight for its load cell, and the load cell wasn't checked with it after the run.
    #[serde(default, skip_serializing_if = "is_false")]
    pub cell_unchecked: bool,
    /// Readings of the load cell that were left out as impossible, in all sessions; absent if none were.
    #[serde(default, skip_serializing_if = "Glitches::are_none")]
    pub glitches: Glitches,
    /// Readings of the array or of a monitor that were missed, in all sessions; absent if none were.
    #[serde(default, skip_serializing_if = "MissedReadings::are_none")]
    pub missed: MissedReadings,
    /// Contradictions to the journal that a person accepted: lost presses, or another journal.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub losses: Vec<Loss>,
    /// Other files of the folder as written; empty during a run.
    pub files: Vec<Fingerprint>,
}

/// Whether a count is zero. Serde requires the reference.
fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl Manifest {
    /// Adds the data of a journal record. The caller counts contacts, because it knows which are new.
    pub(super) fn take_in(&mut self, record: &Record) {
        self.virtual_s = record.t_s().map_or(self.virtual_s, |t_s| self.virtual_s.max(t_s));
        match record {
            Record::Run(facts) => self.facts = facts.clone(),
            Record::Session(session) => {
                // the result of the session before doesn't count any more
                (self.status, self.ended, self.trip, self.failure) = (Status::Stopped, None, None, None);
                self.files.clear();
                self.called_sound = self.called_sound.take().or_else(|| session.sound.map(|sound| sound.line()));
                self.sessions.push(session.clone());
            }
            Record::Devices(devices) => self.devices = devices.iter().cloned().map(Identity::shown).collect(),
            Record::Trip { trip, .. } => {
                // a program that is killed during parking has tripped too
                self.status = Status::Tripped;
                self.trip = Some(trip.clone());
            }
            Record::End(SessionEnd { status, ended, wall_s, failure, cell_unchecked, cell_off, glitches, .. }) => {
                self.glitches.add(glitches);
                self.cell_unchecked = *cell_unchecked;
                self.check_failed = self.check_failed.take().or_else(|| cell_off.clone());
                self.status = *status;
                self.ended = Some(ended.clone());
                self.wall_s += wall_s;
                self.failure.clone_from(failure);
            }
            Record::Contact(contact) => {
                self.rows_flagged += contact.levels.iter().filter(|press| press.is_flagged()).count() as u64;
            }
            Record::Check(check) => {
                self.checks += 1;
                if check.is_failed() && self.check_failed.is_none() {
                    self.check_failed = Some(check.line());
                }
            }
            Record::Loss(loss) => {
                if !loss.lost.is_empty() {
                    (self.status, self.ended) = (Status::Stopped, None);
                }
                self.losses.push(loss.clone());
            }
            Record::Missed(reading) => self.missed.add(reading),
            Record::Text(_) | Record::Zero { .. } | Record::Retouch(_) | Record::Surface(_) => {}
        }
    }

    /// Returns what makes the run doubtful: the first check that failed, and what a person called sound.
    pub fn doubts(&self) -> impl Iterator<Item = &String> {
        self.check_failed.iter().chain(&self.called_sound)
    }

    /// Returns the text files that the run used last.
    pub(super) fn texts(&self) -> &[Fingerprint] {
        self.sessions.last().map_or(&[], |session| &session.texts)
    }

    /// Reads a manifest.
    ///
    /// # Errors
    /// The file is missing, too large, or not a manifest; the error states line and column.
    pub fn read(path: &Path) -> Result<Manifest, DatasetError> {
        let problem = |at: String, problem: String| DatasetError::Manifest { path: path.to_owned(), at, problem };
        let text = match files::read_text(path, MANIFEST_MAX_BYTES) {
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                return Err(problem(String::new(), "not UTF-8 text".to_owned()));
            }
            Err(error) => return Err(DatasetError::io("reading", path)(error)),
            Ok(text) if text.len() as u64 > MANIFEST_MAX_BYTES => {
                return Err(problem(String::new(), format!("longer than {MANIFEST_MAX_BYTES} bytes")));
            }
            Ok(text) => text,
        };
        Manifest::parse(&text).map_err(|error| {
            let words = error.to_string();
            let words = words.split(" at line ").next().unwrap_or_default().to_owned();
            problem(format!(":{}:{}", error.line(), error.column()), words)
        })
    }

    /// Reads a manifest's text.
    ///
    /// # Errors
    /// The text isn't a manifest; the error states the problem and its position.
    pub fn parse(text: &str) -> Result<Manifest, serde_json::Error> {
        serde_json::from_str(text)
    }

    /// Returns the text of the manifest file.
    pub(super) fn text(&self) -> String {
        // text and numbers can't fail to be written
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}
