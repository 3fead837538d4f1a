//! A run on disk: creation, growth and end of its folder.

use super::characteristics::Staircases;
use super::fingerprint::is_plain;
use super::foreign::foreign;
use super::journal::JOURNAL;
use super::known::{JournalSummary, check_run};
use super::lock::hold;
use super::loss::lost;
use super::manifest::MANIFEST;
use super::new_folder::make_folder;
use super::press::{csv_header, csv_line};
use super::recorded::{COLUMNS, RECIPE, RIG, Texts};
#[cfg(feature = "files")]
use super::series::{SERIES, SeriesQueue, SeriesWriter};
use super::series::{cut, series_columns};
use super::verify::fingerprints;
use super::views::{PRESSES, TABLES, replace, write};
use super::{
    DatasetError, Fingerprint, Journal, JournalRecords, Ledger, Loss, Manifest, Presses, Provenance, Record,
    RecordedContact, RecordedContacts, RecordedText, RunFacts, SessionEnd, files,
};
use palpate_core::quantity::ArrayLayout;
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Texts from which a run is made, kept with it unchanged.
#[derive(Clone, Debug, Default)]
pub struct Origins {
    /// Texts, each with the name of its file.
    texts: Vec<(String, String)>,
}

/// What a person accepts of a journal that the other files of its folder contradict.
#[derive(Clone, Copy, Debug, Default)]
pub struct Accepted {
    /// That presses are missing from it.
    pub loss: bool,
    /// That the manifest describes another journal.
    pub another_journal: bool,
}

/// A run on disk, locked by this program. Of the presses, only their positions in the journal are kept in memory.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    /// Lock that is released when its owner ends, for any reason.
    _lock: File,
    journal: Journal,
    /// Open file of presses; `None` until a session begins to add to it.
    presses: Option<File>,
    layout: ArrayLayout,
    known: JournalSummary,
    /// Writer of readings, if they are kept.
    #[cfg(feature = "files")]
    series: Option<SeriesWriter>,
}

impl RunFolder {
    /// Creates the folder of a new run: at `out`, or under `runs/` with the first free name. The complete folder appears by one
    /// rename.
    ///
    /// # Errors
    /// The folder already exists, or can't be created.
    pub fn create(
        out: Option<&Path>,
        origins: &Origins,
        facts: RunFacts,
        mut session: Provenance,
        layout: &ArrayLayout,
    ) -> Result<RunFolder, DatasetError> {
        let name = facts.recipe.clone();
        session.texts = origins.texts().map(|(name, text)| Fingerprint::of(name, text.as_bytes())).collect();
        let path = make_folder(out, &name, |draft| fill(draft, origins, facts, &session, layout))?;
        let lock = hold(&path)?; // not sooner: some systems rename no folder in which a file is open
        let (known, records) = JournalSummary::read(&path, Some(layout.len()))?;
        let mut folder = Opened { path, lock, records, known, layout: layout.clone() }.attach()?;
        folder.journal.keep_for(session.durability);
        folder.presses = Some(open_presses(&folder.path)?);
        Ok(folder)
    }

    /// Opens a run and its journal, and cuts off an incomplete last line of the journal. Changes nothing else.
    ///
    /// # Errors
    /// The journal is missing or damaged, isn't the one that the manifest describes, contains fewer presses than the other files of
    /// the run, or is being written by another program. Or an error of the operating system. Nothing is changed in these cases.
    pub fn open(path: &Path, layout: &ArrayLayout) -> Result<RunFolder, DatasetError> {
        Self::open_accepting(path, layout, Accepted::default(), String::new())
    }

    /// Opens a run whose journal the other files contradict. A person accepts the journal, and the journal records this with `at`,
    /// the time with its time zone.
    ///
    /// # Errors
    /// The same as for [`open`](Self::open), except for what is accepted.
    pub fn open_accepting(
        path: &Path,
        layout: &ArrayLayout,
        accept: Accepted,
        at: String,
    ) -> Result<RunFolder, DatasetError> {
        let (folder, foreign, lost) = Self::take(path, layout)?;
        let path = path.to_owned();
        if !foreign.is_empty() && !accept.another_journal {
            return Err(DatasetError::Foreign { path, found: foreign });
        }
        // the tables in the folder of another journal aren't its tables
        if !lost.is_empty() && !accept.loss && foreign.is_empty() {
            return Err(DatasetError::Lost { path, lost });
        }
        let mut folder = folder.attach()?;
        if !lost.is_empty() || !foreign.is_empty() {
            folder.record(&Record::Loss(Loss { accepted: at, lost, journal: foreign }))?;
        }
        Ok(folder)
    }

    /// Begins to continue a run, with a rig that may have been changed. Regenerates the views of the run from the journal, in
    /// any state that a power cut left. The previous rig file stays in the folder under another name.
    ///
    /// # Errors
    /// Another text differs from the text with which the run began, or an error of the operating system.
    pub fn go_on(&mut self, mut session: Provenance, rig: &str) -> Result<(), DatasetError> {
        let texts = Texts::of(&self.known.texts);
        let is_changed = texts.rig() != rig;
        for before in self.known.manifest.texts() {
            if before.name == RIG {
                session.texts.push(Fingerprint::of(RIG, rig.as_bytes()));
                continue;
            }
            let path = self.path.join(&before.name);
            let now = Fingerprint::of_file(&self.path, &before.name).map_err(DatasetError::io("reading", &path))?;
            if now != *before {
                return Err(DatasetError::Changed { path });
            }
            session.texts.push(now);
        }
        let mut kept = Vec::new();
        if is_changed {
            let name = format!("rig-{}.toml", self.known.manifest.sessions.len());
            replace(&self.path, &name, texts.rig())?;
            session.texts.push(Fingerprint::of(&name, texts.rig().as_bytes()));
            kept = vec![
                RecordedText { name, text: texts.rig().to_owned() },
                RecordedText { name: RIG.to_owned(), text: rig.to_owned() },
            ];
        }
        // before the journal grows: a read-only folder isn't changed
        self.write_views()?;
        self.journal.keep_for(session.durability);
        self.record(&Record::Session(session))?;
        kept.into_iter().try_for_each(|text| self.record(&Record::Text(text)))?;
        match Fingerprint::of_file(&self.path, RIG) {
            Ok(found) if found == Fingerprint::of(RIG, rig.as_bytes()) => {}
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(DatasetError::io("reading", self.path.join(RIG))(error));
            }
            _ => replace(&self.path, RIG, rig)?,
        }
        self.write_manifest()?;
        self.presses = Some(open_presses(&self.path)?);
        Ok(())
    }

    /// Keeps the readings of every further press. The outputs are in `unit`, and the monitors have these names. Without the feature `files`, a plan that asks for this is
    /// refused before.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn keep_series(&mut self, unit: &str, monitors: &[&str]) -> Result<(), DatasetError> {
        let three_axes = self.known.manifest.facts.three_axes;
        let columns = series_columns(self.layout.len(), three_axes, unit, monitors);
        #[cfg(feature = "files")]
        {
            let writer = SeriesWriter::begin(&self.path, &columns, three_axes, self.journal.durability());
            self.series = Some(writer.map_err(DatasetError::io("opening", self.path.join(SERIES)))?);
        }
        #[cfg(not(feature = "files"))]
        drop(columns);
        Ok(())
    }

    /// Ends a session. Writes the final tables, then the journal's record of the end, then the manifest. If one of these fails,
    /// the run remains unfinished, as after a killed program.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn finish(&mut self, end: SessionEnd) -> Result<(), DatasetError> {
        #[cfg(feature = "files")]
        if let Some(series) = self.series.take() {
            series.end();
            cut(&self.path, self.known.series.as_ref())?; // readings of a press that didn't end
        }
        let end = SessionEnd { series: self.known.series.clone(), ..end };
        self.journal.keep_place()?; // the tables are read from the file of this name
        self.write_views()?;
        self.record(&Record::End(end))?;
        self.vouch()
    }

    /// Regenerates tables and manifest from the journal, and the missing texts.
    ///
    /// # Errors
    /// An error of the operating system.
    pub fn rebuild(&mut self) -> Result<(), DatasetError> {
        // the latest of several texts of one name counts
        for RecordedText { name, text } in self.known.texts.iter().rev() {
            if self.path.join(name).symlink_metadata().is_err() {
                replace(&self.path, name, text)?;
            }
        }
        self.write_views()?;
        self.vouch()
    }

    /// Whether the manifest on disk agrees with the journal, and the files agree with the manifest's fingerprints.
    ///
    /// # Errors
    /// A file can't be read.
    pub fn is_finished(&self) -> Result<bool, DatasetError> {
        let files = fingerprints(&self.path, self.manifest().texts())?;
        let text = Manifest::read(&self.path.join(MANIFEST));
        Ok(text.is_ok_and(|text| text == Manifest { files, ..self.manifest().clone() }))
    }

    /// Returns the description of the run and its progress.
    pub fn manifest(&self) -> &Manifest {
        &self.known.manifest
    }

    /// Returns the warnings about the journal since the run was opened.
    pub fn warnings(&self) -> &[String] {
        self.journal.warnings()
    }

    /// Returns the check to show: the first that failed, otherwise the last.
    pub fn check_line(&self) -> Option<&str> {
        self.known.manifest.check_failed.as_deref().or(self.known.last_check.as_deref())
    }

    /// Returns the path of the run.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the measured contacts in the order of the plan's numbers, read from the journal one by one.
    ///
    /// # Errors
    /// An error of the operating system. Damage to the journal since it was opened is reported among the contacts.
    pub fn contacts(&self) -> Result<RecordedContacts<'_>, DatasetError> {
        Ok(self.known.contacts.contacts(Journal::records(&self.path.join(JOURNAL))?))
    }

    /// Returns the presses of the run, in the order of the plan.
    ///
    /// # Errors
    /// The journal can't be read.
    pub fn presses(&self) -> Result<Presses, DatasetError> {
        let contacts = self.contacts()?.collect::<Result<Vec<RecordedContact>, DatasetError>>()?;
        Ok(Presses::of_contacts(&self.path.display().to_string(), &contacts))
    }

    /// Returns the staircases among the presses; `None` if there are none.
    ///
    /// # Errors
    /// The journal can't be read.
    pub fn staircases(&self) -> Result<Option<Staircases>, DatasetError> {
        let mut staircases = Staircases::none(&self.layout);
        for contact in self.contacts()? {
            staircases.add_contact(&contact?, &self.layout);
        }
        Ok(staircases.some())
    }

    /// Opens a run exclusively for this program and reads its journal. Also returns the differences from the journal that the
    /// manifest describes, and a description of data in the other files that the journal lacks.
    fn take(path: &Path, layout: &ArrayLayout) -> Result<(Opened, Vec<String>, Vec<String>), DatasetError> {
        check_run(path)?;
        let lock = hold(path)?;
        let (known, records) = JournalSummary::read(path, Some(layout.len()))?;
        let texts = known.manifest.texts().iter().map(|text| text.name.as_str()).filter(|name| is_plain(name));
        for name in texts.chain([MANIFEST]).chain(TABLES) {
            // before anything is written, so that a run isn't partly regenerated
            files::check_place(&path.join(name)).map_err(DatasetError::io("opening", path.join(name)))?;
        }
        let (foreign, lost) = (foreign(path, &known)?, lost(path, &known)?);
        Ok((Opened { path: path.to_owned(), lock, records, known, layout: layout.clone() }, foreign, lost))
    }

    fn take_in(&mut self, offset: u64, record: &Record) -> Result<(), DatasetError> {
        let taken = self.known.take_in(offset, record);
        taken.map_err(|problem| self.journal.damaged(offset, problem).into())
    }

    fn write_views(&self) -> Result<(), DatasetError> {
        write(&self.path, &self.layout, self.known.manifest.facts.columns(), &|| self.contacts(), &self.known.trips)
    }

    /// Writes the present fingerprints of the files to the manifest.
    fn vouch(&mut self) -> Result<(), DatasetError> {
        self.known.manifest.files = fingerprints(&self.path, self.known.manifest.texts())?;
        self.write_manifest()
    }

    fn write_manifest(&self) -> Result<(), DatasetError> {
        replace(&self.path, MANIFEST, &self.known.manifest.text())
    }
}

/// Run whose journal was read. Nothing has been changed yet.
struct Opened {
    path: PathBuf,
    lock: File,
    records: JournalRecords,
    known: JournalSummary,
    layout: ArrayLayout,
}

impl Opened {
    /// Opens the run's journal for appending and returns the run. An incomplete record at the end is cut off.
    fn attach(self) -> Result<RunFolder, DatasetError> {
        let Opened { path, lock, records, known, layout } = self;
        cut(&path, known.series.as_ref())?;
        Ok(RunFolder {
            path,
            _lock: lock,
            journal: records.go_on()?,
            presses: None,
            layout,
            known,
            #[cfg(feature = "files")]
            series: None,
        })
    }
}

impl Ledger for RunFolder {
    fn has(&self, press: u64) -> bool {
        self.known.contacts.has(press)
    }

    fn recall(&self, tell: &mut dyn FnMut(&Record)) -> Result<(), DatasetError> {
        for next in Journal::records(&self.path.join(JOURNAL))? {
            tell(&next?.1);
        }
        Ok(())
    }

    fn record(&mut self, record: &Record) -> Result<(), DatasetError> {
        let offset = self.journal.append(record)?;
        self.take_in(offset, record)?;
        match (record, &mut self.presses) {
            (Record::Contact(contact), Some(presses)) => {
                let columns = self.known.manifest.facts.columns();
                let lines: String = contact.levels.iter().map(|press| csv_line(press, columns)).collect();
                let path = self.path.join(PRESSES);
                // a table needn't reach the disk now, because the journal has
                presses.write_all(lines.as_bytes()).map_err(DatasetError::io("writing", path))
            }
            (Record::Devices(_), _) => self.write_manifest(),
            _ => Ok(()),
        }
    }

    fn append_unsynced(&mut self, record: &Record) -> Result<(), DatasetError> {
        let offset = self.journal.append_unsynced(record)?;
        self.take_in(offset, record)
    }

    #[cfg(feature = "files")]
    fn series(&self) -> Option<SeriesQueue> {
        self.series.as_ref().map(|series| series.queue.clone())
    }
}

impl Origins {
    /// Takes a recipe, a rig, and the files that these name: register maps and an acceptance rule, each with its name and text.
    pub fn new(recipe: String, rig: String, beside: Vec<(String, String)>) -> Origins {
        let own = [(RECIPE.to_owned(), recipe), (RIG.to_owned(), rig)];
        Origins { texts: own.into_iter().chain(beside).collect() }
    }

    /// Takes the columns file of an import, if there is one.
    pub fn of_import(columns: Option<String>) -> Origins {
        Origins { texts: columns.map(|text| (COLUMNS.to_owned(), text)).into_iter().collect() }
    }

    fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        self.texts.iter().map(|(name, text)| (name.as_str(), text.as_str()))
    }
}

/// Opens the table of presses for appending rows.
fn open_presses(folder: &Path) -> Result<File, DatasetError> {
    let path = folder.join(PRESSES);
    files::open_or_create(&path).map_err(DatasetError::io("opening", path))
}

/// Writes everything that a run folder contains before its first press.
fn fill(
    draft: &Path,
    origins: &Origins,
    facts: RunFacts,
    session: &Provenance,
    layout: &ArrayLayout,
) -> Result<(), DatasetError> {
    let mut manifest = Manifest::default();
    let mut journal = Journal::create(&draft.join(JOURNAL))?;
    let texts = origins.texts().map(|(name, text)| RecordedText { name: name.to_owned(), text: text.to_owned() });
    for record in [Record::Run(facts), Record::Session(session.clone())].into_iter().chain(texts.map(Record::Text)) {
        journal.append(&record)?;
        manifest.take_in(&record);
    }
    let views = [(MANIFEST, manifest.text()), (PRESSES, csv_header(layout.len(), manifest.facts.columns()))];
    for (name, text) in origins.texts().chain(views.iter().map(|(name, text)| (*name, text.as_str()))) {
        let path = draft.join(name);
        let write = |text: &str| {
            let mut file = File::create_new(&path)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        write(text).map_err(DatasetError::io("writing", &path))?;
    }
    Ok(())
}
