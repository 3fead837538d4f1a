use super::characteristics::Staircases;
use super::index::Index;
use super::table::{Table, TableError};
use super::verify::fingerprints;
use super::views::{PRESSES, presses_header, presses_line, replace, write};
use super::{
    Contacts, DatasetError, End, Fingerprint, Journal, Ledger, Manifest, Record, Records, Row, RunFacts, Session,
};
use crate::quantity::ArrayLayout;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// How many names are tried for a new folder: `name`, `name-2`, ...
const NAMES_MAX: usize = 100_000;

const RIG: &str = "rig.toml";
pub(super) const JOURNAL: &str = "journal.log";
pub(super) const MANIFEST: &str = "manifest.json";

/// The texts a run is made from, kept with it as given.
#[derive(Clone, Debug)]
pub struct Origins {
    /// `recipe.toml`.
    pub recipe: String,
    /// `rig.toml`.
    pub rig: String,
    /// Register maps of the user's own: file name and text.
    pub maps: Vec<(String, String)>,
}

/// A run on disk, held by this program alone. Of its presses it knows the places in the journal, and no more.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    /// Dies with its owner, however that ends.
    _lock: File,
    journal: Journal,
    /// None until a session begins to add to it.
    presses: Option<File>,
    layout: ArrayLayout,
    known: Known,
}

/// What is known of a journal without reading it again.
#[derive(Debug)]
pub(super) struct Known {
    pub contacts: Index,
    pub manifest: Manifest,
    units: Option<usize>,
}

impl RunFolder {
    /// Makes the folder of a new run: at `out`, or under `runs/` with the first free name. It appears by one rename, whole.
    ///
    /// # Errors
    /// The folder is there already, or can't be made.
    pub fn create(
        out: Option<&Path>,
        origins: &Origins,
        facts: RunFacts,
        mut session: Session,
        layout: &ArrayLayout,
    ) -> Result<RunFolder, DatasetError> {
        let parent = match out {
            Some(out) => out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")),
            None => Path::new("runs"),
        };
        if parent.is_file() {
            return Err(DatasetError::NoFolder { path: parent.to_owned() });
        }
        if let Some(out) = out.filter(|out| out.symlink_metadata().is_ok()) {
            return Err(DatasetError::Exists { path: out.to_owned() });
        }
        make_folders(parent)?;
        let name = facts.recipe.clone();
        session.texts = origins.texts().map(|(name, text)| Fingerprint::of(name, text.as_bytes())).collect();
        let draft = new_draft(parent, &name)?;
        let made = fill(&draft, origins, facts, &session, layout).and_then(|()| publish(&draft, out, parent, &name));
        let path = made.inspect_err(|_| _ = fs::remove_dir_all(&draft))?;
        sync_folder(parent)?;
        let lock = hold(&path)?; // not sooner: some systems rename no folder in which a file is open
        let mut folder = Self::attach(path, lock, layout)?;
        folder.journal.keep_for(session.durability);
        folder.presses = Some(open_presses(&folder.path)?);
        Ok(folder)
    }

    /// Opens a run and its journal, whose torn tail is cut; nothing else is changed.
    ///
    /// # Errors
    /// No journal, a damaged one, one that another program writes, or the operating system's.
    pub fn open(path: &Path, layout: &ArrayLayout) -> Result<RunFolder, DatasetError> {
        check_run(path)?;
        let lock = hold(path)?;
        Self::attach(path.to_owned(), lock, layout)
    }

    /// Begins to go on with a run: its views are made anew, whatever a power cut left of them.
    ///
    /// # Errors
    /// A text that isn't the one the run began with (the rig may be another: a link may have got another name), or the
    /// operating system's.
    pub fn go_on(&mut self, mut session: Session) -> Result<(), DatasetError> {
        for before in self.known.manifest.texts() {
            let (name, path) = (before.name.as_str(), self.path.join(&before.name));
            let now = Fingerprint::of_file(&self.path, name)?;
            if now != *before && name != RIG {
                return Err(DatasetError::Changed { path });
            }
            session.texts.push(now);
        }
        self.journal.keep_for(session.durability);
        self.record(&Record::Session(session))?;
        self.write_views()?;
        self.write_manifest()?;
        self.presses = Some(open_presses(&self.path)?);
        Ok(())
    }

    /// The manifest of a run as its file says.
    ///
    /// # Errors
    /// No run, no manifest, or not one.
    pub fn read_manifest(path: &Path) -> Result<Manifest, DatasetError> {
        check_run(path)?;
        Manifest::read(&path.join(MANIFEST))
    }

    /// The manifest of a run as its journal says, without the files' fingerprints.
    ///
    /// # Errors
    /// No journal, or a damaged one.
    pub fn recall_manifest(path: &Path) -> Result<Manifest, DatasetError> {
        check_run(path)?;
        let mut known = Known::of(None);
        let mut records = Journal::records(&path.join(JOURNAL))?;
        while let Some(next) = records.next() {
            let (offset, record) = next?;
            known.take_in(offset, &record).map_err(|problem| records.damaged(offset, problem))?;
        }
        Ok(known.manifest)
    }

    /// The presses of a run, as its table says.
    ///
    /// # Errors
    /// No table there, or one that can't be read.
    pub fn read_presses(path: &Path) -> Result<Table, TableError> {
        Table::read_run(&path.join(PRESSES))
    }

    /// What the journal of a run says, record by record, whoever writes it now.
    ///
    /// # Errors
    /// No journal, or one that can't be opened.
    pub fn read_records(path: &Path) -> Result<Records, DatasetError> {
        check_run(path)?;
        Ok(Journal::records(&path.join(JOURNAL))?)
    }

    /// Ends a session: tables are as they are to stay, then the journal says how it ended, then the manifest. Where one
    /// fails the run stays as it is when a program is killed: unfinished.
    ///
    /// # Errors
    /// The operating system's.
    pub fn finish(&mut self, end: End) -> Result<(), DatasetError> {
        self.write_views()?;
        self.record(&Record::End(end))?;
        self.vouch()
    }

    /// Makes tables and manifest anew from the journal.
    ///
    /// # Errors
    /// The operating system's.
    pub fn rebuild(&mut self) -> Result<(), DatasetError> {
        self.write_views()?;
        self.vouch()
    }

    /// Whether the manifest on disk is that of the journal, and the files are those it vouches for.
    ///
    /// # Errors
    /// A file that can't be read.
    pub fn is_finished(&self) -> Result<bool, DatasetError> {
        let files = fingerprints(&self.path, self.manifest().texts())?;
        let told = Self::read_manifest(&self.path);
        Ok(told.is_ok_and(|told| told == Manifest { files, ..self.manifest().clone() }))
    }

    /// What the run is and how far it has come.
    pub fn manifest(&self) -> &Manifest {
        &self.known.manifest
    }

    /// Where the run is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What has been measured, in the order of the plan's numbers, read from the journal one by one.
    ///
    /// # Errors
    /// The operating system's; a journal that was damaged since it was opened comes with the contacts.
    pub fn contacts(&self) -> Result<Contacts<'_>, DatasetError> {
        Ok(self.known.contacts.contacts(Journal::records(&self.path.join(JOURNAL))?))
    }

    /// The staircases among them; none where there are none.
    ///
    /// # Errors
    /// A journal that can't be read.
    pub fn staircases(&self) -> Result<Option<Staircases>, DatasetError> {
        let mut staircases = Staircases::none(&self.layout);
        for contact in self.contacts()? {
            staircases.add_contact(&contact?, &self.layout);
        }
        Ok(staircases.some())
    }

    fn attach(path: PathBuf, lock: File, layout: &ArrayLayout) -> Result<RunFolder, DatasetError> {
        let mut known = Known::of(Some(layout.len()));
        let journal = Journal::open(&path.join(JOURNAL), |offset, record| known.take_in(offset, record))?;
        Ok(RunFolder { path, _lock: lock, journal, presses: None, layout: layout.clone(), known })
    }

    fn take_in(&mut self, offset: u64, record: &Record) -> Result<(), DatasetError> {
        let taken = self.known.take_in(offset, record);
        taken.map_err(|problem| self.journal.damaged(offset, problem).into())
    }

    fn write_views(&self) -> Result<(), DatasetError> {
        write(&self.path, &self.layout, &|| self.contacts())
    }

    /// Says in the manifest what the files are by now.
    fn vouch(&mut self) -> Result<(), DatasetError> {
        self.known.manifest.files = fingerprints(&self.path, self.known.manifest.texts())?;
        self.write_manifest()
    }

    fn write_manifest(&self) -> Result<(), DatasetError> {
        replace(&self.path, MANIFEST, &self.known.manifest.text())
    }
}

impl Known {
    /// Nothing yet of a run on an array of so many units, if that is known.
    pub(super) fn of(units: Option<usize>) -> Known {
        Known { contacts: Index::default(), manifest: Manifest::default(), units }
    }

    /// A journal begins by saying what the run is, and says it once; each entry of its plan is in it once, whole.
    pub(super) fn take_in(&mut self, offset: u64, record: &Record) -> Result<(), String> {
        match record {
            Record::Run(_) if offset > 0 => return Err("the run begins a second time".to_owned()),
            Record::Run(facts) => self.contacts = Index::with_room(facts.presses_planned),
            _ if offset == 0 => return Err("it doesn't say what the run is".to_owned()),
            Record::Contact(contact) => {
                let units = |row: &Row| self.units.is_none_or(|units| row.outputs.len() == units);
                if contact.press >= self.manifest.facts.presses_planned {
                    return Err(format!("the plan has no press {}", contact.press));
                }
                if !contact.rows.iter().all(|row| row.press == contact.press && units(row)) {
                    return Err(format!("its rows aren't those of press {} on this array", contact.press));
                }
                self.contacts.insert(contact.press, offset)?;
            }
            _ => {}
        }
        self.manifest.take_in(record);
        self.manifest.presses_done = self.contacts.done();
        Ok(())
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
                let lines: String = contact.rows.iter().map(presses_line).collect();
                let path = self.path.join(PRESSES);
                // a view: it need not reach the disk now, since the journal has
                presses.write_all(lines.as_bytes()).map_err(DatasetError::io("writing", path))
            }
            (Record::Devices(_), _) => self.write_manifest(),
            _ => Ok(()),
        }
    }

    fn jot(&mut self, record: &Record) -> Result<(), DatasetError> {
        let offset = self.journal.jot(record)?;
        self.take_in(offset, record)
    }
}

impl Origins {
    /// All texts with the names of their files.
    fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        let own = [("recipe.toml", self.recipe.as_str()), (RIG, self.rig.as_str())];
        own.into_iter().chain(self.maps.iter().map(|(name, text)| (name.as_str(), text.as_str())))
    }
}

/// A run is a folder with a journal in it.
///
/// # Errors
/// It is none.
pub fn check_run(path: &Path) -> Result<(), DatasetError> {
    let is_one = path.join(JOURNAL).is_file();
    is_one.then_some(()).ok_or_else(|| DatasetError::NoRun { path: path.to_owned() })
}

/// Takes a run for this program alone. The system gives it free when the program ends, however it does. It is the journal
/// that is locked, which nobody takes for a left-over; where a lock bars readers too, a file beside it.
fn hold(path: &Path) -> Result<File, DatasetError> {
    let held = path.join(if cfg!(windows) { "run.lock" } else { JOURNAL });
    let opened = OpenOptions::new().append(true).create(cfg!(windows)).open(&held);
    let file = opened.map_err(DatasetError::io("opening", &held))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(DatasetError::Held { path: path.to_owned() }),
        Err(TryLockError::Error(error)) => Err(DatasetError::io("locking", held)(error)),
    }
}

/// The table of presses, to add rows to.
fn open_presses(folder: &Path) -> Result<File, DatasetError> {
    let path = folder.join(PRESSES);
    OpenOptions::new().append(true).create(true).open(&path).map_err(DatasetError::io("opening", path))
}

/// An empty folder beside the one to be, under a name that nobody takes for a run's. One that a program was killed over stays
/// as it is: another may be at work in it.
fn new_draft(parent: &Path, name: &str) -> Result<PathBuf, DatasetError> {
    let process = std::process::id();
    for number in 1..=NAMES_MAX {
        let draft = parent.join(format!(".{name}.{process}-{number}.new"));
        match fs::create_dir(&draft) {
            Ok(()) => return Ok(draft),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(DatasetError::io("making", draft)(error)),
        }
    }
    Err(DatasetError::Exists { path: parent.join(format!(".{name}.{process}.new")) })
}

/// Everything a run folder holds before its first press.
fn fill(
    draft: &Path,
    origins: &Origins,
    facts: RunFacts,
    session: &Session,
    layout: &ArrayLayout,
) -> Result<(), DatasetError> {
    let mut manifest = Manifest::default();
    let mut journal = Journal::create(&draft.join(JOURNAL))?;
    for record in [Record::Run(facts), Record::Session(session.clone())] {
        journal.append(&record)?;
        manifest.take_in(&record);
    }
    let views = [(MANIFEST, manifest.text()), (PRESSES, presses_header(layout.len()))];
    for (name, text) in origins.texts().chain(views.iter().map(|(name, text)| (*name, text.as_str()))) {
        let path = draft.join(name);
        let write = |text: &str| {
            let mut file = File::create_new(&path)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        write(text).map_err(DatasetError::io("writing", &path))?;
    }
    sync_folder(draft)
}

/// Renames the draft to its place. A folder with something in it is never replaced: the system refuses.
fn publish(draft: &Path, out: Option<&Path>, parent: &Path, name: &str) -> Result<PathBuf, DatasetError> {
    if let Some(out) = out {
        fs::rename(draft, out).map_err(DatasetError::io("renaming to", out))?;
        return Ok(out.to_owned());
    }
    for number in 1..=NAMES_MAX {
        let path = parent.join(if number == 1 { name.to_owned() } else { format!("{name}-{number}") });
        if path.symlink_metadata().is_ok() {
            continue;
        }
        match fs::rename(draft, &path) {
            Ok(()) => return Ok(path),
            Err(_) if path.exists() => continue, // another run was faster
            Err(error) => return Err(DatasetError::io("renaming to", path)(error)),
        }
    }
    Err(DatasetError::Exists { path: parent.join(name) })
}

/// Makes a folder and those above it, each on the disk.
fn make_folders(path: &Path) -> Result<(), DatasetError> {
    let missing: Vec<&Path> =
        path.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists()).collect();
    fs::create_dir_all(path).map_err(DatasetError::io("making", path))?;
    for made in missing {
        sync_folder(made.parent().filter(|above| !above.as_os_str().is_empty()).unwrap_or(Path::new(".")))?;
    }
    Ok(())
}

/// A rename is on the disk when its folder is. Windows keeps no handle on folders and needs none.
fn sync_folder(path: &Path) -> Result<(), DatasetError> {
    if cfg!(unix) {
        File::open(path).and_then(|folder| folder.sync_all()).map_err(DatasetError::io("flushing", path))?;
    }
    Ok(())
}
