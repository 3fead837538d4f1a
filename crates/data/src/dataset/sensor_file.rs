//! A calibrated sensor as a file: two lines of text and the numbers of a model.
//!
//! The first line is [`MARK`]. The second line is a JSON object, the [`Card`]: it describes the file and its range of validity.
//! The bytes after it are the [`Model`]. `docs/reference/sensor-file.md` describes all three.

use super::files;
use super::fingerprint::Fingerprint;
use super::session::shown_label;
use miette::Diagnostic;
use palpate_solver::vector::{VECTOR_METHOD, VectorModel};
use palpate_solver::{
    Broken, ForceKnown, HISTORY_METHOD, HistoryRegression, Model, ModelError, REMOVED, Setting, Solver as _, Validity,
};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// First line of the file. The number changes whenever the byte format of a model changes.
pub const MARK: &str = "palpate sensor 2";

/// Beginning of the first line in every version of a sensor file.
const KIND: &str = "palpate sensor ";

/// Largest size of a model in a file, bytes.
pub(crate) const MOST_BYTES: usize = 128 << 20;

/// Largest size of a card, bytes.
const CARD_MOST_BYTES: usize = 64 << 10;

/// Description of a sensor file, as text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Card {
    /// Version of the program that wrote the file.
    pub palpate: String,
    /// Name of the method.
    pub method: String,
    /// Method that answers readings with the load of the calibration, if it is a second one.
    pub method_at_calibrated_load: Option<String>,
    /// ID of the sensor, if its run has one.
    #[serde(default, deserialize_with = "shown_label")]
    pub sensor: Option<String>,
    /// Sources of the fit: the journals of runs, or tables.
    pub made_from: Vec<Fingerprint>,
    /// Range of the calibration.
    pub valid: Validity,
    /// Smallest and largest depth of the calibration, mm; only if depths are solved instead of forces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_mm: Option<[f64; 2]>,
    /// Excluded outputs, counted from 1, and the reasons.
    pub left_out: Vec<LeftOutUnit>,
    /// Whether every contact is assumed to have the force of the calibration.
    pub constant_load: bool,
    /// Whether a common offset of all outputs is solved for.
    pub common_offset: bool,
    /// Accepted fraction of single contacts with a wrong verdict.
    pub false_alarms: f64,
    /// Whether the file contains the presses too. Without them, readings with missing outputs can't be solved.
    pub keeps_presses: bool,
    /// Size of the model.
    pub bytes: u64,
    /// SHA-256 of the model, in hexadecimal.
    pub sha256: String,
}

/// Model of a sensor file.
pub enum SensorModel {
    /// Solves the place, and a force or a depth.
    Contact(Box<Model>),
    /// Solves the place and a force vector.
    Vector(Box<VectorModel>),
    /// Solves a force from a series of readings.
    History(Box<HistoryRegression>),
}

/// An output that is excluded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeftOutUnit {
    /// The output, counted from 1.
    pub unit: usize,
    /// Fault of the output.
    pub why: String,
}

/// Reason why a sensor file can't be written or read.
#[derive(Debug, Error, Diagnostic)]
pub enum SensorFileError {
    /// The operating system reported an error.
    #[error("{doing} {}: {why}", path.display())]
    #[diagnostic(help("name a file that can be read and written, such as sensor.palpate"))]
    Io {
        /// Operation that failed.
        doing: &'static str,
        /// File of the operation.
        path: PathBuf,
        /// Error of the operating system.
        why: io::Error,
    },
    /// The path of the file is used by something else.
    #[error("{} already exists and isn't a sensor file", path.display())]
    #[diagnostic(help("choose another --out: only a sensor file is replaced"))]
    Taken {
        /// The file.
        path: PathBuf,
    },
    /// The file isn't a sensor file.
    #[error("{} isn't a sensor file: it doesn't begin with `{MARK}`", path.display())]
    #[diagnostic(help("`palpate fit RUN --out sensor.palpate` writes one; a run or a table goes to --calibration"))]
    NoSensorFile {
        /// The file.
        path: PathBuf,
    },
    /// The file has another version of the format.
    #[error("{} is a sensor file of version {found}; this program reads version 2", path.display())]
    #[diagnostic(help("fit the sensor again with this program, or use the version that wrote the file"))]
    Version {
        /// The file.
        path: PathBuf,
        /// Version of the file.
        found: String,
    },
    /// The file solves what the command doesn't know.
    #[error("{} solves {solved}; only {users} use such a sensor file", path.display())]
    #[diagnostic(help("for this command, fit {source_needed}"))]
    OtherModel {
        /// The file.
        path: PathBuf,
        /// What it solves.
        solved: &'static str,
        /// Commands that use it.
        users: &'static str,
        /// Presses for the command, and how they are fitted.
        source_needed: &'static str,
    },
    /// The method of the file was removed from the program.
    #[error("{} has the method `{method}`, which was removed", path.display())]
    #[diagnostic(help("fit the sensor again: `palpate fit RUN --out FILE` chooses a better method"))]
    Removed {
        /// The file.
        path: PathBuf,
        /// The method.
        method: String,
    },
    /// The file's description can't be read, or doesn't agree with the file.
    #[error("{} is damaged: {why}", path.display())]
    #[diagnostic(help("take another copy of the file, or fit the sensor again"))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Problem of the file.
        why: String,
    },
    /// The file would be too large.
    #[error("the model has {} MB without its presses; a sensor file holds {} MB", bytes >> 20, MOST_BYTES >> 20)]
    #[diagnostic(help("choose another --solver: models of many channels are large, those of `pearson` are small"))]
    TooLarge {
        /// Size of the file.
        bytes: usize,
    },
    /// The model can't be serialised.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl SensorModel {
    /// Returns the range in which the model is valid.
    pub fn validity(&self) -> &Validity {
        match self {
            SensorModel::Contact(model) => model.validity(),
            SensorModel::Vector(model) => model.validity(),
            SensorModel::History(model) => model.validity(),
        }
    }

    /// Returns the name of the method.
    pub fn method(&self) -> &str {
        match self {
            SensorModel::Contact(model) => model.fitted().name(),
            SensorModel::Vector(_) => VECTOR_METHOD,
            SensorModel::History(_) => HISTORY_METHOD,
        }
    }

    /// Serialises the model as bytes.
    ///
    /// # Errors
    /// No known case.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelError> {
        match self {
            SensorModel::Contact(model) => model.to_bytes(),
            SensorModel::Vector(model) => model.to_bytes(),
            SensorModel::History(model) => model.to_bytes(),
        }
    }

    /// Returns a copy of a model.
    ///
    /// # Errors
    /// No known case.
    pub fn copy_of(model: &Model) -> Result<Self, ModelError> {
        Ok(Model::from_bytes(&model.to_bytes()?)?.into())
    }

    fn from_bytes(method: &str, bytes: &[u8]) -> Result<Self, ModelError> {
        Ok(match method {
            VECTOR_METHOD => SensorModel::Vector(Box::new(VectorModel::from_bytes(bytes)?)),
            HISTORY_METHOD => SensorModel::History(Box::new(HistoryRegression::from_bytes(bytes)?)),
            _ => SensorModel::Contact(Box::new(Model::from_bytes(bytes)?)),
        })
    }
}

impl From<Model> for SensorModel {
    fn from(model: Model) -> Self {
        SensorModel::Contact(Box::new(model))
    }
}

/// Text of a card and bytes of its model, ready for writing.
pub struct SensorFile {
    /// Description of the file.
    pub card: Card,
    bytes: Vec<u8>,
}

impl SensorFile {
    /// Prepares a model for a file; without its presses if there is no space for them.
    ///
    /// # Errors
    /// The file is too large even without presses.
    pub fn new(
        model: impl Into<SensorModel>,
        sensor: Option<String>,
        made_from: Vec<Fingerprint>,
    ) -> Result<Self, SensorFileError> {
        SensorFile::within(MOST_BYTES, model, sensor, made_from)
    }

    /// Prepares the same file with a smaller largest size of the model, bytes.
    ///
    /// # Errors
    /// The same as for [`new`](Self::new).
    pub fn within(
        most_bytes: usize,
        model: impl Into<SensorModel>,
        sensor: Option<String>,
        made_from: Vec<Fingerprint>,
    ) -> Result<Self, SensorFileError> {
        let mut model = model.into();
        let mut bytes = model.to_bytes()?;
        if bytes.len() > most_bytes {
            model = match model {
                SensorModel::Contact(model) => model.without_calibration().into(),
                SensorModel::Vector(_) | SensorModel::History(_) => model,
            };
            bytes = model.to_bytes()?;
        }
        if bytes.len() > most_bytes {
            return Err(SensorFileError::TooLarge { bytes: bytes.len() });
        }
        let Fingerprint { bytes: length, sha256, .. } = Fingerprint::of("", &bytes);
        let left_out = |broken: &Broken| LeftOutUnit { unit: broken.unit + 1, why: broken.fault.text().to_owned() };
        let card = Card {
            palpate: env!("CARGO_PKG_VERSION").to_owned(),
            method: model.method().to_owned(),
            method_at_calibrated_load: None,
            sensor,
            made_from,
            valid: model.validity().clone(),
            depth_mm: model.validity().depth_mm,
            left_out: Vec::new(),
            constant_load: false,
            common_offset: false,
            false_alarms: Setting::default().false_alarms,
            keeps_presses: false,
            bytes: length,
            sha256,
        };
        let card = match &model {
            SensorModel::History(_) => card,
            SensorModel::Vector(model) => Card { false_alarms: model.map().false_alarms(), ..card },
            SensorModel::Contact(model) => Card {
                method_at_calibrated_load: model.fitted().at_calibrated_load().map(str::to_owned),
                left_out: model.fitted().broken().iter().map(left_out).collect(),
                constant_load: model.setting().load == ForceKnown::Constant,
                common_offset: model.setting().common_offset,
                false_alarms: model.setting().false_alarms,
                keeps_presses: model.calibration().is_some(),
                ..card
            },
        };
        Ok(SensorFile { card, bytes })
    }

    /// Writes the file completely or not at all. Replaces an existing sensor file, but nothing else.
    ///
    /// # Errors
    /// Something other than a sensor file is at the path, or an error of the operating system.
    pub fn write(&self, path: &Path) -> Result<(), SensorFileError> {
        check_replaceable(path)?;
        let io = |why| SensorFileError::Io { doing: "writing", path: path.to_owned(), why };
        let card = serde_json::to_string(&self.card).map_err(|why| io(why.into()))?;
        let mut text = format!("{MARK}\n{card}\n").into_bytes();
        text.extend_from_slice(&self.bytes);
        files::place(path, &text).map_err(io)
    }
}

/// Checks whether a sensor file may be written at a path: the path is free, or is a sensor file.
///
/// # Errors
/// Something else is at the path, or an error of the operating system.
pub fn check_replaceable(path: &Path) -> Result<(), SensorFileError> {
    let io = |why| SensorFileError::Io { doing: "writing", path: path.to_owned(), why };
    files::check_replaceable(path).map_err(io)?;
    if path.symlink_metadata().is_err() || is_sensor_file(path) {
        return Ok(());
    }
    Err(SensorFileError::Taken { path: path.to_owned() })
}

/// Whether a path is a regular file that begins like a sensor file of any version.
pub fn is_sensor_file(path: &Path) -> bool {
    let mut start = [0; KIND.len()];
    let mut read = || fs::File::open(path).and_then(|mut file| file.read_exact(&mut start));
    path.is_file() && read().is_ok() && start == *KIND.as_bytes()
}

/// Reads a sensor file that solves the place, and a force or a depth: its card and its model.
///
/// # Errors
/// As [`read_any_sensor_file`], or the file solves something else.
pub fn read_sensor_file(path: &Path) -> Result<(Card, Model), SensorFileError> {
    match read_any_sensor_file(path)? {
        (card, SensorModel::Contact(model)) => Ok((card, *model)),
        (_, SensorModel::Vector(_)) => Err(SensorFileError::OtherModel {
            path: path.to_owned(),
            solved: "force vectors",
            users: "`solve`, `serve` and the Python package",
            source_needed: "the presses without --vector",
        }),
        (_, SensorModel::History(_)) => Err(SensorFileError::OtherModel {
            path: path.to_owned(),
            solved: "a series of readings",
            users: "`solve` and `serve`",
            source_needed: "a run or a table of presses at known places, without --history",
        }),
    }
}

/// Reads a sensor file: its card and its model.
///
/// # Errors
/// The file isn't a sensor file, has another version or is damaged, or an error of the operating system.
pub fn read_any_sensor_file(path: &Path) -> Result<(Card, SensorModel), SensorFileError> {
    let io = |why| SensorFileError::Io { doing: "reading", path: path.to_owned(), why };
    let damaged = |why: &str| SensorFileError::Damaged { path: path.to_owned(), why: why.to_owned() };
    if path.is_dir() {
        return Err(SensorFileError::NoSensorFile { path: path.to_owned() });
    }
    let bytes = read(path).map_err(io)?;
    let mut rest = bytes.as_slice();
    if !rest.starts_with(KIND.as_bytes()) {
        return Err(SensorFileError::NoSensorFile { path: path.to_owned() });
    }
    let mark = line(&mut rest, MARK.len() + 8).ok_or_else(|| damaged("its first line is incomplete"))?;
    if mark != MARK.as_bytes() {
        let found = String::from_utf8_lossy(&mark[KIND.len()..]).into_owned();
        return Err(SensorFileError::Version { path: path.to_owned(), found });
    }
    let card = line(&mut rest, CARD_MOST_BYTES).ok_or_else(|| damaged("its second line is incomplete"))?;
    let card: Card = serde_json::from_slice(card).map_err(|why| damaged(&format!("its second line: {why}")))?;
    if REMOVED.contains(&card.method.as_str()) {
        return Err(SensorFileError::Removed { path: path.to_owned(), method: card.method });
    }
    if rest.len() as u64 != card.bytes {
        return Err(damaged(&format!("its model has {} bytes, but was written with {}", rest.len(), card.bytes)));
    }
    if Fingerprint::of("", rest).sha256 != card.sha256 {
        return Err(damaged("its model has changed since it was written (its SHA-256 differs)"));
    }
    let model = SensorModel::from_bytes(&card.method, rest).map_err(|why| damaged(&why.to_string()))?;
    let valid = Validity { depth_mm: card.depth_mm, ..card.valid.clone() };
    if model.method() != card.method || *model.validity() != valid {
        return Err(damaged("its second line doesn't describe its model"));
    }
    Ok((card, model))
}

/// Reads the bytes of a file, up to one more than the largest sensor file.
fn read(path: &Path) -> io::Result<Vec<u8>> {
    let file = fs::File::open(path)?;
    let most = (MARK.len() + CARD_MOST_BYTES + MOST_BYTES) as u64 + 1;
    let length = file.metadata().map_or(0, |about| about.len()).min(most);
    let mut bytes = Vec::with_capacity(length as usize); // the size first: a growing buffer is copied each time
    file.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Takes a line of at most `most` bytes from the front.
fn line<'a>(rest: &mut &'a [u8], most: usize) -> Option<&'a [u8]> {
    let end = rest.iter().take(most + 1).position(|byte| *byte == b'\n')?;
    let line = &rest[..end];
    *rest = &rest[end + 1..];
    Some(line)
}
