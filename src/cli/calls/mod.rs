//! Commands as functions, for a program that contains this one as a library: the Python package. Nothing is printed, no
//! signal is handled, and no person is asked.
//!
//! The options of a command are given in its own words, such as `--solver` and `pearson`, and are checked as on the command
//! line.

pub mod events;

pub use super::solutions::{NUMBERS, UNSOLVED, numbers};

use super::columns::ColumnsArgs;
use super::exit::{DEVICE, Failure, USAGE};
use super::fit::place;
use super::method::{FORCES_ARE_RELATIVE, MethodArgs, Source, left_out};
use super::recorded::{noted_presses, noted_run};
use super::run::{self, RunArgs};
use super::session::walked;
use clap::Parser;
use palpate_data::dataset::sensor_file::{Card, SensorFile, SensorFileError, check_replaceable, read_sensor_file};
use palpate_data::dataset::{Fingerprint, Presses, Recorded, RunFolder, Status};
use palpate_data::recipe::Plan;
use palpate_run::rig::{Bench, RigSpec};
use palpate_run::run::{Cancel, Ending, Halt, Listener};
use palpate_solver::Model;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Reason why a command failed: what the command line prints, and its exit code.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Exit code of the command.
    pub code: u8,
    /// The message, one or more lines of plain text.
    pub text: String,
}

impl From<Failure> for Refusal {
    fn from(failure: Failure) -> Self {
        let (code, text) = failure.plain();
        Refusal { code, text }
    }
}

impl Refusal {
    /// A fault of the program itself.
    fn of_panic() -> Self {
        Refusal { code: DEVICE, text: "the run died: move the stage clear of the specimen by hand".to_owned() }
    }
}

/// A model with what its sensor file states.
pub struct Sensor {
    /// The fitted method.
    pub model: Model,
    /// ID of the sensor, if its run has one.
    pub sensor: Option<String>,
    /// Sources of the fit.
    pub made_from: Vec<Fingerprint>,
    /// Lines that the command prints about its input.
    pub notes: Vec<String>,
}

/// Words of `palpate fit` without its file.
#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
struct FitWords {
    calibration: PathBuf,
    #[command(flatten)]
    method: MethodArgs,
}

/// Words of `palpate run`.
#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
struct RunWords {
    #[command(flatten)]
    args: RunArgs,
}

/// Words of a command that reads a table.
#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
struct TableWords {
    table: PathBuf,
    #[command(flatten)]
    columns: ColumnsArgs,
}

/// Fits a method to a run or a table, like `palpate fit`. The words are its options and the calibration.
///
/// # Errors
/// Bad input.
pub fn fit(words: Vec<OsString>) -> Result<Sensor, Refusal> {
    let FitWords { calibration, method } = parsed(words)?;
    let mut source = Source::noted(&calibration, &method)?;
    let model = method.fit(&source)?;
    let mut notes = std::mem::take(&mut source.notes);
    if source.is_relative && model.validity().force_n.is_none() {
        notes.push(FORCES_ARE_RELATIVE.to_owned());
    }
    notes.extend(left_out(&calibration, model.fitted()));
    Ok(Sensor { made_from: vec![source.fingerprint()?], sensor: source.sensor, model, notes })
}

/// Reads a sensor file.
///
/// # Errors
/// The file can't be read, or isn't a sensor file.
pub fn read_sensor(path: &Path) -> Result<Sensor, Refusal> {
    let (Card { sensor, made_from, .. }, model) = read_sensor_file(path).map_err(Failure::usage)?;
    let notes = left_out(path, model.fitted()).collect();
    Ok(Sensor { model, sensor, made_from, notes })
}

/// Writes a sensor file. Replaces an existing sensor file, but nothing else.
///
/// # Errors
/// Something else is at the path, or the file can't be written.
pub fn write_sensor(
    model: &Model,
    sensor: Option<String>,
    made_from: Vec<Fingerprint>,
    path: &Path,
) -> Result<(), Refusal> {
    check_replaceable(path).map_err(Failure::usage)?;
    let copy = model
        .to_bytes()
        .and_then(|bytes| Model::from_bytes(&bytes))
        .map_err(SensorFileError::from)
        .map_err(Failure::usage)?;
    let file = SensorFile::new(copy, sensor, made_from).map_err(Failure::usage)?;
    Ok(place(&file, path)?)
}

/// Reads a run with its bench, and the lines that a command prints about its files.
///
/// # Errors
/// The path isn't a run, or its journal is damaged.
pub fn read_run(path: &Path) -> Result<(Recorded, Bench, Vec<String>), Refusal> {
    Ok(noted_run(path)?)
}

/// Reads a table of presses, and the lines that a command prints about it. The words are the table and `--columns`.
///
/// # Errors
/// Bad input.
pub fn read_table(words: Vec<OsString>) -> Result<(Presses, Vec<String>), Refusal> {
    let TableWords { table, columns } = parsed(words)?;
    Ok(noted_presses(&table, &columns.mapping()?, None)?)
}

/// A run whose folder is made. Nothing has moved.
pub struct Begun {
    plan: Plan,
    rig: RigSpec,
    folder: RunFolder,
    pace: Option<f64>,
}

/// Makes the folder of a run, like `palpate run`. The words are its options and the recipe.
///
/// # Errors
/// Bad input, or the folder can't be made.
pub fn begin(words: Vec<OsString>) -> Result<Begun, Refusal> {
    let RunWords { args } = parsed(words)?;
    let run::Begun { sources, plan, folder } = run::begin(&args, &|chosen, rig| chosen.confirm(rig, false))?;
    let manner = &args.session.manner;
    Ok(Begun { plan, rig: manner.confirm.of_absent(sources.rig), folder, pace: manner.pace })
}

impl Begun {
    /// Returns the folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Returns the number of presses of the plan.
    pub fn planned(&self) -> usize {
        self.plan.entries.len()
    }

    /// Makes all presses, and parks the stage. `shown` is called for every force, N, and `listener` for every event. Returns the
    /// status: complete, or stopped if `cancel` requested it.
    ///
    /// # Errors
    /// A device failed, a safety rule was broken, or the record couldn't be stored.
    pub fn walk(
        mut self,
        cancel: &Cancel,
        shown: &dyn Fn(f64),
        listener: &mut dyn Listener,
    ) -> Result<Status, Refusal> {
        let (ending, finished) = walked(&self.plan, &self.rig, &mut self.folder, self.pace, cancel, (shown, listener))?;
        let status = ending.status();
        match ending {
            Ending { halt: None | Some(Halt::Cancelled), unparked: None, .. } => {
                finished.map_err(Failure::unfinished)?;
                Ok(status)
            }
            ending => Err(Failure::ended(ending).into()),
        }
    }
}

/// Parses words as the command line does.
fn parsed<T: Parser>(words: Vec<OsString>) -> Result<T, Refusal> {
    T::try_parse_from(words).map_err(|error| {
        let text = error.render().to_string();
        let text = text.split("\n\nUsage:").next().unwrap_or_default();
        let text = text.split("\n\nFor more information").next().unwrap_or_default();
        Refusal { code: USAGE, text: text.trim_start_matches("error: ").trim_end().to_owned() }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    fn words(words: &[&str]) -> Vec<OsString> {
        words.iter().map(OsString::from).collect()
    }

    struct Counted<'a>(&'a Cell<u32>);

    impl Listener for Counted<'_> {
        fn recorded(&mut self, _: &palpate_data::dataset::Contact) {
            self.0.set(self.0.get() + 1);
        }
    }

    #[test]
    fn a_run_is_walked_read_and_fitted_without_a_command_line() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("run");
        let out = out.to_str().unwrap();
        let begun = begin(words(&["data/example/short.toml", "--out", out])).ok().unwrap();
        let (presses, forces, planned) = (Cell::new(0), Cell::new(0_u64), begun.planned());
        let status = begun.walk(&Cancel::default(), &|_| forces.set(forces.get() + 1), &mut Counted(&presses)).unwrap();
        assert_eq!((status, presses.get() as usize), (Status::Complete, planned));
        assert!(forces.get() > 1000);
        let (recorded, _, notes) = read_run(Path::new(out)).ok().unwrap();
        assert_eq!((recorded.contacts.len(), notes.len()), (planned, 0));
        let fitted = fit(words(&[out, "--solver", "pearson"])).ok().unwrap();
        let file = folder.path().join("a.palpate");
        write_sensor(&fitted.model, fitted.sensor, fitted.made_from, &file).unwrap();
        let read = read_sensor(&file).ok().unwrap();
        assert_eq!(read.model.to_bytes().unwrap(), fitted.model.to_bytes().unwrap());
    }

    #[test]
    fn a_refusal_has_the_text_and_the_code_of_the_command_line() {
        let refused = |refusal: Option<Refusal>| refusal.map(|Refusal { code, text }| (code, text)).unwrap();
        let unknown = refused(fit(words(&["grid.csv", "--solver", "none"])).err());
        assert!(unknown.0 == 2 && unknown.1.starts_with("invalid value 'none' for '--solver <NAME>'"), "{unknown:?}");
        let missing = refused(begin(words(&["no.toml"])).err());
        assert!(
            missing.0 == 2 && missing.1.contains("no.toml") && missing.1.contains("\nhelp: give an"),
            "{missing:?}"
        );
        // a real rig that no option names is confirmed by a person, and here is none
        let folder = tempfile::tempdir().unwrap();
        let recipe = folder.path().join("recipe.toml");
        std::fs::write(&recipe, include_str!("../../../recipes/paper.toml")).unwrap();
        std::fs::write(folder.path().join("rig.toml"), include_str!("../../../rigs/esp301.toml")).unwrap();
        let real = refused(begin(words(&[recipe.to_str().unwrap()])).err());
        assert!(real.0 == 2 && real.1.contains("no terminal") && real.1.contains("help: add --rig"), "{real:?}");
    }

    #[test]
    fn a_run_that_is_stopped_before_it_begins_is_no_error() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("run");
        let begun = begin(words(&["data/example/short.toml", "--out", out.to_str().unwrap()])).ok().unwrap();
        let (cancel, presses) = (Cancel::default(), Cell::new(0));
        cancel.ask();
        assert_eq!(begun.walk(&cancel, &|_| {}, &mut Counted(&presses)), Ok(Status::Stopped));
        assert_eq!(presses.get(), 0);
    }
}
