//! A lake: the tables of many runs as Parquet files, in folders by design, batch and sensor.
//!
//! `presses/design=D/batch=B/sensor=S/RUN.parquet`, and the same for `runs`, `verdicts`, `errors`, `characteristics` and `series`. RUN is
//! computed from the beginning of the run's journal, so it is the same wherever the run's folder is. Each file is written in the
//! lake's folder of drafts, synced, and appears by one rename. The presses appear last.

use super::arrow::ParquetFile;
use super::frame::{self, ExportTable};
use super::series::{SERIES, SeriesTables};
use super::{BenchError, bench_of, rows};
use miette::Diagnostic;
use palpate_core::quantity::hexadecimal;
use palpate_data::acceptance::{AcceptanceRule, Judgement};
use palpate_data::dataset::evaluate::Trial;
use palpate_data::dataset::sensor_file::SensorFileError;
use palpate_data::dataset::{DatasetError, Evidence, Labels, Manifest, Press, Presses, Recorded, RunColumns};
use palpate_data::recipe::Phase;
use palpate_run::batch::ByDesign;
use palpate_run::rig::Bench;
use palpate_solver::Evaluation;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// Tables of a lake in the order in which a run's files appear.
pub const TABLES: [&str; 6] = ["runs", "characteristics", "errors", "verdicts", SERIES, PRESSES];
const PRESSES: &str = "presses";

/// File that marks a lake, and is locked while a program writes to it.
const MARK: &str = ".palpate-lake";
/// Folder of files that aren't complete.
const DRAFTS: &str = ".drafts";

/// Value of a label that a run doesn't have. Hive uses it, and readers take it as null.
const NO_LABEL: &str = "__HIVE_DEFAULT_PARTITION__";

/// Largest number of outputs that are held until they are written: 2 MB.
const OUTPUTS_MAX: usize = 1 << 18;

/// A lake that this program writes. No other program writes to it at the same time.
pub struct Lake {
    folder: PathBuf,
    /// Lock that is released when its owner ends, for any reason.
    _lock: File,
    /// Folders of each run's files, for every table: where they were when the lake was opened, or where this program put them.
    places: BTreeMap<(&'static str, OsString), Vec<PathBuf>>,
}

/// A run whose presses are written, but not visible yet.
pub struct Staged {
    run: Recorded,
    bench: Bench,
    id: String,
    presses: u64,
    frames: Vec<ExportTable>,
}

/// Reason why a run can't be added to a lake.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum LakeError {
    /// The run or a file of the lake can't be read or written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Dataset(#[from] DatasetError),
    /// The bench of the run isn't known.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Bench(#[from] BenchError),
    /// The sensor file of a run's batch can't be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Sensor(#[from] SensorFileError),
    /// The folder has other content.
    #[error("{} isn't a lake of palpate, and isn't an empty folder", folder.display())]
    #[diagnostic(help("choose an empty or a new folder"))]
    Taken {
        /// The folder.
        folder: PathBuf,
    },
    /// Another program writes to the lake.
    #[error("{} is being written by another program", folder.display())]
    #[diagnostic(help("wait until it has ended: only one program can write to a lake"))]
    Held {
        /// The folder.
        folder: PathBuf,
    },
}

impl Lake {
    /// Opens a lake to add runs, or creates it in a new or an empty folder. Removes drafts that a killed program left.
    ///
    /// # Errors
    /// The folder has other content, another program writes to it, or an error of the operating system.
    pub fn open(folder: &Path) -> Result<Lake, LakeError> {
        let mark = folder.join(MARK);
        if folder.is_file() {
            return Err(LakeError::Taken { folder: folder.to_owned() });
        }
        fs::create_dir_all(folder).map_err(DatasetError::io("making", folder))?;
        let mut entries = fs::read_dir(folder).map_err(DatasetError::io("reading", folder))?;
        if !mark.exists() && entries.next().is_some() {
            return Err(LakeError::Taken { folder: folder.to_owned() });
        }
        let lock = File::options().append(true).create(true).open(&mark).map_err(DatasetError::io("opening", &mark))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(LakeError::Held { folder: folder.to_owned() }),
            Err(TryLockError::Error(error)) => return Err(DatasetError::io("locking", mark)(error).into()),
        }
        let drafts = folder.join(DRAFTS);
        match fs::remove_dir_all(&drafts) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(DatasetError::io("removing", drafts)(error).into());
            }
            _ => {}
        }
        fs::create_dir(&drafts).map_err(DatasetError::io("making", drafts))?;
        let mut places = BTreeMap::new();
        for table in TABLES {
            note_places(&folder.join(table), table, 3, &mut places).map_err(DatasetError::io("reading", folder))?;
        }
        Ok(Lake { folder: folder.to_owned(), _lock: lock, places })
    }

    /// Reads a run, and writes its presses to a draft. Memory doesn't grow with the number of presses, except with those of a
    /// characterisation.
    ///
    /// # Errors
    /// The run can't be read, or an error of the operating system.
    pub fn stage(&self, run: &Path) -> Result<Staged, LakeError> {
        let mut draft: Option<PressesDraft> = None;
        let (mut held, mut presses) = (Vec::new(), 0);
        let recorded = Recorded::read_each(run, |manifest, texts, contact| -> Result<(), LakeError> {
            let draft = match &mut draft {
                Some(draft) => draft,
                None => {
                    let bench = bench_of(run, &manifest.facts, texts)?;
                    draft.insert(PressesDraft::new(self.draft(PRESSES), &bench, manifest)?)
                }
            };
            presses += contact.levels.len() as u64;
            held.extend(contact.levels.iter().filter(|press| press.is_of(Phase::Characterisation)).cloned());
            contact.levels.into_iter().try_for_each(|press| draft.add(press))
        })?;
        let bench = bench_of(run, &recorded.manifest.facts, &recorded.texts)?;
        let id = run_id(&recorded.manifest);
        let draft = draft.map_or_else(|| PressesDraft::new(self.draft(PRESSES), &bench, &recorded.manifest), Ok)?;
        draft.finish(&recorded)?;
        self.draft_series(&recorded, &id)?;
        let mut frames = vec![rows::run(&recorded, &bench, &id, presses)];
        let held = Presses::of_presses(&run.display().to_string(), held);
        frames.extend(frame::characteristics_of(&held, &bench.layout).map(|frame| rows::of_run(frame, &id)));
        Ok(Staged { run: recorded, bench, id, presses, frames })
    }

    /// Makes the files of a staged run visible, and removes those of an earlier export. Returns what was added, for a person.
    ///
    /// # Errors
    /// An error of the operating system. The presses of the run are then the earlier ones, or missing.
    pub fn publish(&mut self, staged: Staged) -> Result<String, LakeError> {
        let Staged { run, id, presses, frames, .. } = staged;
        let partition = partition(&run.manifest.facts.labels);
        let file = format!("{id}.parquet");
        let manifest = frame::manifest(&run);
        for frame in &frames {
            let path = self.draft(frame.name);
            let written = new_draft(&path).and_then(|out| {
                let mut file = ParquetFile::new(out, frame, None)?;
                file.add(frame.clone())?;
                synced(file.finish(&manifest)?)
            });
            written.map_err(DatasetError::io("writing", path))?;
        }
        for table in TABLES {
            let folder = self.folder.join(table).join(&partition);
            let is_there = match table {
                PRESSES => true,
                SERIES => run.series.is_some(),
                _ => frames.iter().any(|frame| frame.name == table),
            };
            let earlier = self.places.remove(&(table, OsString::from(&file))).unwrap_or_default();
            // a reader that finds a run twice would count it twice; one that misses it finds it next time
            for stray in earlier.iter().filter(|place| !is_there || **place != folder).map(|place| place.join(&file)) {
                match fs::remove_file(&stray) {
                    Err(error) if error.kind() != io::ErrorKind::NotFound => {
                        return Err(DatasetError::io("removing", stray)(error).into());
                    }
                    _ => {}
                }
            }
            if is_there {
                fs::create_dir_all(&folder).map_err(DatasetError::io("making", &folder))?;
                let path = folder.join(&file);
                fs::rename(self.draft(table), &path).map_err(DatasetError::io("renaming to", &path))?;
                self.places.insert((table, OsString::from(&file)), vec![folder]);
            }
        }
        Ok(format!("{presses} presses at {}", self.folder.join(PRESSES).join(partition).join(file).display()))
    }

    /// Writes the readings of a run to their draft, if it has any.
    fn draft_series(&self, run: &Recorded, id: &str) -> Result<(), LakeError> {
        let Some(tables) = SeriesTables::of(run)? else { return Ok(()) };
        let path = self.draft(SERIES);
        let failed = |why| DatasetError::io("writing", &path)(why);
        let like = rows::of_run(tables.like(), id);
        let mut file = new_draft(&path).and_then(|out| ParquetFile::new(out, &like, None)).map_err(failed)?;
        for table in tables {
            file.add(rows::of_run(table?, id)).map_err(failed)?;
        }
        file.finish(&frame::manifest(run)).and_then(synced).map_err(failed)?;
        Ok(())
    }

    fn draft(&self, table: &str) -> PathBuf {
        self.folder.join(DRAFTS).join(format!("{table}.parquet"))
    }
}

impl Staged {
    /// Returns the run, without its contacts.
    pub fn run(&self) -> &Recorded {
        &self.run
    }

    /// Adds the verdict by a rule, and the errors of the rule's method at each test press. The run is read completely.
    ///
    /// # Errors
    /// The run can't be read again.
    pub fn judge(&mut self, rule: &AcceptanceRule) -> Result<(), LakeError> {
        let run = Recorded::read(&self.run.path)?;
        let presses = run.presses();
        let layout = Some(&self.bench.layout);
        let trial = Trial::of_run(&presses, layout);
        let design = ByDesign::of_runs(&[&run.path])?;
        let model = design.as_ref().and_then(|design| design.model.as_ref());
        let evaluate = |trial: &Trial<'_>| match model {
            Some(model) => trial.evaluate_with(model.fitted()).ok(),
            None => trial.evaluate(&rule.method).ok(),
        };
        let known: Vec<Evaluation> = trial.as_ref().ok().and_then(evaluate).into_iter().collect();
        let (runs, u_place_mm) = (vec![&run], self.bench.u_place_mm());
        let evidence = Evidence { presses: &presses, layout, runs, u_place_mm };
        let judgement: Judgement = match &design {
            Some(design) => design.judge(rule, &evidence, &trial, &known),
            None => evidence.judge(rule, &trial, &known),
        };
        self.frames.push(rows::of_run(rows::verdict(&judgement), &self.id));
        if let Some(evaluation) = known.first() {
            self.frames.push(rows::of_run(rows::errors(evaluation), &self.id));
        }
        Ok(())
    }
}

/// The presses of a run on their way to a file.
struct PressesDraft {
    path: PathBuf,
    file: ParquetFile<io::BufWriter<File>>,
    id: String,
    unit: String,
    columns: RunColumns,
    channels: usize,
    waiting: Vec<Press>,
    most: usize,
}

impl PressesDraft {
    fn new(path: PathBuf, bench: &Bench, manifest: &Manifest) -> Result<PressesDraft, DatasetError> {
        let (channels, unit) = (bench.layout.len(), bench.unit.clone());
        let (id, columns) = (run_id(manifest), manifest.facts.columns());
        let like = rows::of_run(frame::presses_with(&[], columns, channels, &unit), &id);
        let file = new_draft(&path).and_then(|out| ParquetFile::new(out, &like, None));
        let file = file.map_err(DatasetError::io("writing", &path))?;
        let most = (OUTPUTS_MAX / channels.max(1)).max(1);
        Ok(PressesDraft { path, file, id, unit, columns, channels, waiting: Vec::new(), most })
    }

    fn add(&mut self, press: Press) -> Result<(), LakeError> {
        self.waiting.push(press);
        if self.waiting.len() >= self.most {
            self.pass_on()?;
        }
        Ok(())
    }

    fn pass_on(&mut self) -> Result<(), DatasetError> {
        let frame = rows::of_run(frame::presses_with(&self.waiting, self.columns, self.channels, &self.unit), &self.id);
        self.waiting.clear();
        self.file.add(frame).map_err(DatasetError::io("writing", &self.path))
    }

    fn finish(mut self, run: &Recorded) -> Result<(), DatasetError> {
        self.pass_on()?;
        let written = self.file.finish(&frame::manifest(run)).and_then(synced);
        written.map_err(DatasetError::io("writing", self.path))
    }
}

/// Returns the name of a run in a lake. It is computed from the start of its first session, so it stays when the run continues,
/// is moved, copied or renamed.
fn run_id(manifest: &Manifest) -> String {
    let first = manifest.sessions.first();
    let began = first.map(|first| (&first.host, &first.started, &first.palpate));
    let facts = &manifest.facts;
    let tables: Vec<&str> = facts.imported.iter().flat_map(|its| &its.tables).map(|its| its.sha256.as_str()).collect();
    let hash = Sha256::digest(format!("{began:?} {} {} {tables:?}", facts.recipe, facts.seed));
    hexadecimal(&hash[..8])
}

/// Returns the folder of a sensor's files within a table: `design=D/batch=B/sensor=S`.
fn partition(labels: &Labels) -> PathBuf {
    let Labels { design, batch, sensor, .. } = labels;
    let level = |(key, label): (&str, &Option<String>)| match label {
        Some(label) => format!("{key}={}", encoded(label)),
        None => format!("{key}={NO_LABEL}"),
    };
    [("design", design), ("batch", batch), ("sensor", sensor)].into_iter().map(level).collect()
}

/// Returns a label as part of a path: letters, digits, `-`, `_` and `.` stay, other bytes become `%XX`.
fn encoded(label: &str) -> String {
    let byte = |byte: u8| match byte {
        b'-' | b'_' | b'.' => char::from(byte).to_string(),
        byte if byte.is_ascii_alphanumeric() => char::from(byte).to_string(),
        byte => format!("%{byte:02X}"),
    };
    label.bytes().map(byte).collect()
}

/// Notes the folder of every file that is `depth` folders below a folder.
fn note_places(
    folder: &Path,
    table: &'static str,
    depth: usize,
    places: &mut BTreeMap<(&'static str, OsString), Vec<PathBuf>>,
) -> io::Result<()> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let entry = entry?;
        match (entry.file_type()?.is_dir(), depth) {
            (true, 1..) => note_places(&entry.path(), table, depth - 1, places)?,
            (false, 0) => places.entry((table, entry.file_name())).or_default().push(folder.to_owned()),
            _ => {}
        }
    }
    Ok(())
}

fn new_draft(path: &Path) -> io::Result<io::BufWriter<File>> {
    Ok(io::BufWriter::new(File::create(path)?))
}

fn synced(out: io::BufWriter<File>) -> io::Result<()> {
    out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_folders_that_readers_of_hive_understand() {
        let labels =
            Labels { sensor: Some("A/17 ü=%".to_owned()), design: Some("..".to_owned()), ..Labels::default() };
        let expected = "design=../batch=__HIVE_DEFAULT_PARTITION__/sensor=A%2F17%20%C3%BC%3D%25";
        assert_eq!(partition(&labels), Path::new(expected));
    }

    #[test]
    fn other_folder_is_refused_as_lake_and_a_lake_has_one_writer() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("thesis.txt"), "").unwrap();
        assert!(matches!(Lake::open(folder.path()), Err(LakeError::Taken { .. })));
        let lake = Lake::open(&folder.path().join("lake")).unwrap();
        assert!(matches!(Lake::open(&folder.path().join("lake")), Err(LakeError::Held { .. })));
        drop(lake);
        assert!(Lake::open(&folder.path().join("lake")).is_ok());
    }
}
