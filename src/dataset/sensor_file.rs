//! A calibrated sensor as a file: two lines of text and the numbers of a model.
//!
//! The first line is [`MARK`], the second a JSON object, the [`Card`]: it says what the file is and where it holds. The bytes after it
//! are the [`Model`]. `docs/sensor-file.md` describes all three.

use super::files;
use super::fingerprint::Fingerprint;
use crate::solver::{Broken, ForceKnown, Model, ModelError, Solver as _, Validity};
use miette::Diagnostic;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The first line. The number changes whenever the bytes of a model do.
pub const MARK: &str = "palpate sensor 1";

/// What the first line of every version begins with.
const KIND: &str = "palpate sensor ";

/// The most bytes of a model in a file.
pub const MOST_BYTES: usize = 32 << 20;

/// The most bytes of a card.
const CARD_MOST_BYTES: usize = 64 << 10;

/// What a sensor file says about itself, in text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Card {
    /// The version of the program that wrote it.
    pub palpate: String,
    /// The method.
    pub method: String,
    /// The sensor's ID, where its run has one.
    #[serde(default)]
    pub sensor: Option<String>,
    /// What the method was fitted to: the journals of runs, or tables.
    pub made_from: Vec<Fingerprint>,
    /// What the calibration contains.
    pub valid: Validity,
    /// Units that are left out, counted from 1, and why.
    pub left_out: Vec<LeftOutUnit>,
    /// Whether every contact is taken to press as hard as the calibration did.
    pub constant_load: bool,
    /// Whether one offset of all outputs is solved for.
    pub common_offset: bool,
    /// Accepted share of single contacts with a wrong verdict.
    pub false_alarms: f64,
    /// Whether the presses are in the file too: without them no reading that lacks an output can be solved.
    pub keeps_presses: bool,
    /// Size of the model.
    pub bytes: u64,
    /// SHA-256 of the model, in hexadecimal.
    pub sha256: String,
}

/// A unit that is left out of account.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeftOutUnit {
    /// The unit, counted from 1.
    pub unit: usize,
    /// What is wrong with it.
    pub why: String,
}

/// A sensor file can't be written or read.
#[derive(Debug, Error, Diagnostic)]
pub enum SensorFileError {
    /// The operating system refused.
    #[error("{doing} {}: {why}", path.display())]
    Io {
        /// What was being done.
        doing: &'static str,
        /// To which file.
        path: PathBuf,
        /// What came back.
        why: io::Error,
    },
    /// Something else is at the place of the file.
    #[error("{} already exists and isn't a sensor file", path.display())]
    #[diagnostic(help("choose another --out: only a sensor file is replaced"))]
    Taken {
        /// The file.
        path: PathBuf,
    },
    /// It isn't a sensor file.
    #[error("{} isn't a sensor file: it doesn't begin with `{MARK}`", path.display())]
    #[diagnostic(help("`palpate fit RUN --out sensor.palpate` writes one; a run or a table goes to --calibration"))]
    NoSensorFile {
        /// The file.
        path: PathBuf,
    },
    /// Another version of the format.
    #[error("{} is a sensor file of version {found}; this program reads version 1", path.display())]
    #[diagnostic(help("fit the sensor again with this program, or use the version that wrote the file"))]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: String,
    },
    /// What it says of itself can't be read, or isn't so.
    #[error("{} is damaged: {why}", path.display())]
    #[diagnostic(help("take another copy of the file, or fit the sensor again"))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// It would be too large.
    #[error("the model has {} MB without its presses; a sensor file holds {} MB", bytes >> 20, MOST_BYTES >> 20)]
    #[diagnostic(help(
        "choose another --solver: models of many channels are large, those of `pearson` and `whitened` are small"
    ))]
    TooLarge {
        /// Its size.
        bytes: usize,
    },
    /// The model can't be put into bytes.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// The text of a card and the bytes of its model, ready to be written.
pub struct SensorFile {
    /// What it says about itself.
    pub card: Card,
    bytes: Vec<u8>,
}

impl SensorFile {
    /// Puts a model into a file's form; without its presses where there is no room for them.
    ///
    /// # Errors
    /// It is too large even so.
    pub fn new(model: Model, sensor: Option<String>, made_from: Vec<Fingerprint>) -> Result<Self, SensorFileError> {
        let mut model = model;
        let mut bytes = model.to_bytes()?;
        if bytes.len() > MOST_BYTES {
            model = model.without_calibration();
            bytes = model.to_bytes()?;
        }
        if bytes.len() > MOST_BYTES {
            return Err(SensorFileError::TooLarge { bytes: bytes.len() });
        }
        let setting = model.setting();
        let fitted = model.fitted();
        let Fingerprint { bytes: length, sha256, .. } = Fingerprint::of("", &bytes);
        let left_out = |broken: &Broken| LeftOutUnit { unit: broken.unit + 1, why: broken.fault.told().to_owned() };
        let card = Card {
            palpate: env!("CARGO_PKG_VERSION").to_owned(),
            method: fitted.name().to_owned(),
            sensor,
            made_from,
            valid: model.validity().clone(),
            left_out: fitted.broken().iter().map(left_out).collect(),
            constant_load: setting.load == ForceKnown::Constant,
            common_offset: setting.common_offset,
            false_alarms: setting.false_alarms,
            keeps_presses: model.calibration().is_some(),
            bytes: length,
            sha256,
        };
        Ok(SensorFile { card, bytes })
    }

    /// Writes it, whole or not at all. A sensor file that is there is replaced, anything else isn't.
    ///
    /// # Errors
    /// Something else is there, or the operating system's.
    pub fn write(&self, path: &Path) -> Result<(), SensorFileError> {
        check_replaceable(path)?;
        let io = |why| SensorFileError::Io { doing: "writing", path: path.to_owned(), why };
        let card = serde_json::to_string(&self.card).map_err(|why| io(why.into()))?;
        let mut text = format!("{MARK}\n{card}\n").into_bytes();
        text.extend_from_slice(&self.bytes);
        files::place(path, &text).map_err(io)
    }
}

/// Whether a sensor file may be written there: the place is empty, or holds a sensor file.
///
/// # Errors
/// What stands there, or the operating system's.
pub fn check_replaceable(path: &Path) -> Result<(), SensorFileError> {
    let io = |why| SensorFileError::Io { doing: "writing", path: path.to_owned(), why };
    files::check_replaceable(path).map_err(io)?;
    if path.symlink_metadata().is_err() || is_sensor_file(path) {
        return Ok(());
    }
    Err(SensorFileError::Taken { path: path.to_owned() })
}

/// Whether a regular file begins as a sensor file of any version does.
pub fn is_sensor_file(path: &Path) -> bool {
    let mut start = [0; KIND.len()];
    let mut read = || fs::File::open(path).and_then(|mut file| file.read_exact(&mut start));
    path.is_file() && read().is_ok() && start == *KIND.as_bytes()
}

/// Reads a sensor file: its card and its model.
///
/// # Errors
/// It isn't one, is of another version or damaged, or the operating system's.
pub fn read_sensor_file(path: &Path) -> Result<(Card, Model), SensorFileError> {
    let io = |why| SensorFileError::Io { doing: "reading", path: path.to_owned(), why };
    let damaged = |why: &str| SensorFileError::Damaged { path: path.to_owned(), why: why.to_owned() };
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
    if rest.len() as u64 != card.bytes {
        return Err(damaged(&format!("its model has {} bytes, but was written with {}", rest.len(), card.bytes)));
    }
    if Fingerprint::of("", rest).sha256 != card.sha256 {
        return Err(damaged("its model has changed since it was written (its SHA-256 differs)"));
    }
    let model = Model::from_bytes(rest).map_err(|why| damaged(&why.to_string()))?;
    Ok((card, model))
}

/// The bytes of a file, up to one more than a sensor file has.
fn read(path: &Path) -> io::Result<Vec<u8>> {
    let file = fs::File::open(path)?;
    let most = (MARK.len() + CARD_MOST_BYTES + MOST_BYTES) as u64 + 1;
    let length = file.metadata().map_or(0, |about| about.len()).min(most);
    let mut bytes = Vec::with_capacity(length as usize); // asked first: a buffer that grows is copied each time
    file.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Takes a line of at most so many bytes off the front.
fn line<'a>(rest: &mut &'a [u8], most: usize) -> Option<&'a [u8]> {
    let end = rest.iter().take(most + 1).position(|byte| *byte == b'\n')?;
    let line = &rest[..end];
    *rest = &rest[end + 1..];
    Some(line)
}
