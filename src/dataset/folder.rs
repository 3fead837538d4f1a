use super::characteristics::Staircases;
use super::index::Index;
use super::table::{Table, TableError};
use super::views::{PRESSES, presses_header, presses_line, replace, write};
use super::{Contacts, DatasetError, Journal, Ledger, Manifest, Record, Status};
use crate::device::Identity;
use crate::quantity::ArrayLayout;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// How many names are tried for a new folder: `name`, `name-2`, ...
const NAMES_MAX: usize = 100_000;

const JOURNAL: &str = "journal.log";
const MANIFEST: &str = "manifest.json";

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

/// A run on disk that is being written. Of its presses it holds the places in the journal, and no more.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    journal: Journal,
    presses: File,
    layout: ArrayLayout,
    /// What the run is, kept up to date by its writer.
    pub manifest: Manifest,
    known: Known,
}

/// What is known of a journal without reading it again.
#[derive(Debug)]
struct Known {
    contacts: Index,
    flagged_rows: u64,
    first_zero_n: Option<f64>,
    last_s: f64,
}

impl RunFolder {
    /// Makes the folder of a new run: at `out`, or under `runs/` with the first free name. It appears by one rename, whole.
    ///
    /// # Errors
    /// The folder is there already, or can't be made.
    pub fn create(
        out: Option<&Path>,
        origins: &Origins,
        manifest: Manifest,
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
        fs::create_dir_all(parent).map_err(DatasetError::io("making", parent))?;
        let draft = parent.join(format!(".{}.{}.new", manifest.recipe, std::process::id()));
        let path =
            fill(&draft, origins, &manifest, layout).and_then(|()| publish(&draft, out, parent, &manifest.recipe));
        let path = path.inspect_err(|_| _ = fs::remove_dir_all(&draft))?;
        sync_folder(parent)?;
        Self::attach(path, manifest, layout)
    }

    /// Opens a run to go on with it.
    ///
    /// # Errors
    /// No manifest, a damaged journal, or the operating system's.
    pub fn open(path: &Path, layout: &ArrayLayout) -> Result<RunFolder, DatasetError> {
        let manifest = Self::read_manifest(path)?;
        let mut folder = Self::attach(path.to_owned(), manifest, layout)?;
        folder.write_views()?; // what a power cut left of the tables
        folder.presses = open_presses(path)?;
        Ok(folder)
    }

    /// The manifest of a run.
    ///
    /// # Errors
    /// None there, or not one.
    pub fn read_manifest(path: &Path) -> Result<Manifest, DatasetError> {
        let file = path.join(MANIFEST);
        let text = fs::read_to_string(&file).map_err(|error| match error.kind() {
            ErrorKind::NotFound | ErrorKind::NotADirectory => DatasetError::NoRun { path: path.to_owned() },
            _ => DatasetError::io("reading", &file)(error),
        })?;
        serde_json::from_str(&text).map_err(|error| DatasetError::Manifest { path: file, problem: error.to_string() })
    }

    /// The presses of a run, as its table says.
    ///
    /// # Errors
    /// No table there, or one that can't be read.
    pub fn read_presses(path: &Path) -> Result<Table, TableError> {
        Table::read_run(&path.join(PRESSES))
    }

    /// Ends the run: tables and manifest as they are to stay.
    ///
    /// # Errors
    /// The operating system's.
    pub fn finish(&mut self, status: Status) -> Result<(), DatasetError> {
        self.manifest.status = status;
        self.write_views()?;
        self.write_manifest()
    }

    /// Writes the manifest as it is now.
    ///
    /// # Errors
    /// The operating system's.
    pub fn write_manifest(&self) -> Result<(), DatasetError> {
        replace(&self.path, MANIFEST, &manifest_text(&self.manifest))
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

    /// How many rows have something wrong with them.
    pub fn flagged_rows(&self) -> u64 {
        self.known.flagged_rows
    }

    fn attach(path: PathBuf, manifest: Manifest, layout: &ArrayLayout) -> Result<RunFolder, DatasetError> {
        let mut known = Known {
            contacts: Index::with_room(manifest.presses_planned),
            flagged_rows: 0,
            first_zero_n: None,
            last_s: 0.0,
        };
        let journal = Journal::open(&path.join(JOURNAL), |offset, record| known.take_in(offset, record))?;
        let presses = open_presses(&path)?;
        let mut folder = RunFolder { path, journal, presses, layout: layout.clone(), manifest, known };
        folder.say_how_far();
        Ok(folder)
    }

    /// What is on disk is what is known: a run that was killed couldn't say how far it had come.
    fn say_how_far(&mut self) {
        self.manifest.virtual_s = self.manifest.virtual_s.max(self.known.last_s);
        self.manifest.presses_done = self.known.contacts.done();
    }

    fn write_views(&self) -> Result<(), DatasetError> {
        write(&self.path, &self.layout, &|| self.contacts())
    }
}

impl Known {
    fn take_in(&mut self, offset: u64, record: &Record) -> Result<(), String> {
        match record {
            Record::Contact(contact) => {
                self.contacts.insert(contact.press, offset)?;
                self.flagged_rows += contact.rows.iter().filter(|row| !row.flags.is_empty()).count() as u64;
                self.last_s = contact.rows.iter().map(|row| row.t_s).fold(self.last_s, f64::max);
            }
            Record::Zero { offset_n, .. } => _ = self.first_zero_n.get_or_insert(*offset_n),
            Record::Trip { .. } => {}
        }
        Ok(())
    }
}

impl Ledger for RunFolder {
    fn has(&self, press: u64) -> bool {
        self.known.contacts.has(press)
    }

    fn first_zero_n(&self) -> Option<f64> {
        self.known.first_zero_n
    }

    fn elapsed_s(&self) -> f64 {
        self.manifest.virtual_s
    }

    /// A trip comes into the manifest too, even if the journal can't be written any more.
    fn record(&mut self, record: &Record) -> Result<(), DatasetError> {
        if let Record::Trip { trip, .. } = record {
            self.manifest.trip = Some(trip.clone());
        }
        let offset = self.journal.append(record)?;
        self.known.take_in(offset, record).map_err(|problem| self.journal.damaged(offset, problem))?;
        if let Record::Contact(contact) = record {
            let lines: String = contact.rows.iter().map(presses_line).collect();
            let path = self.path.join(PRESSES);
            // a view: it need not reach the disk now, since the journal has
            self.presses.write_all(lines.as_bytes()).map_err(DatasetError::io("writing", path))?;
        }
        self.say_how_far();
        Ok(())
    }

    fn note_devices(&mut self, devices: &[Identity]) -> Result<(), DatasetError> {
        self.manifest.devices = devices.to_vec();
        self.write_manifest()
    }

    fn note_elapsed(&mut self, elapsed_s: f64) {
        self.manifest.virtual_s = elapsed_s;
    }
}

/// The table of presses, to add rows to.
fn open_presses(folder: &Path) -> Result<File, DatasetError> {
    let path = folder.join(PRESSES);
    OpenOptions::new().append(true).create(true).open(&path).map_err(DatasetError::io("opening", path))
}

/// Everything a run folder holds before its first press.
fn fill(draft: &Path, origins: &Origins, manifest: &Manifest, layout: &ArrayLayout) -> Result<(), DatasetError> {
    fs::create_dir(draft).map_err(DatasetError::io("making", draft))?;
    let presses = presses_header(layout.len());
    let manifest = manifest_text(manifest);
    let own =
        [("recipe.toml", &origins.recipe), ("rig.toml", &origins.rig), (MANIFEST, &manifest), (PRESSES, &presses)];
    let maps = origins.maps.iter().map(|(name, text)| (name.as_str(), text));
    for (name, text) in own.into_iter().chain(maps) {
        let path = draft.join(name);
        let write = |text: &str| {
            let mut file = File::create_new(&path)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        write(text).map_err(DatasetError::io("writing", &path))?;
    }
    Journal::create(&draft.join(JOURNAL))?;
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

fn manifest_text(manifest: &Manifest) -> String {
    // a manifest is text and numbers, which can't fail to be written
    serde_json::to_string_pretty(manifest).unwrap_or_default() + "\n"
}

/// A rename is on the disk when its folder is. Windows keeps no handle on folders and needs none.
fn sync_folder(path: &Path) -> Result<(), DatasetError> {
    if cfg!(unix) {
        File::open(path).and_then(|folder| folder.sync_all()).map_err(DatasetError::io("flushing", path))?;
    }
    Ok(())
}
