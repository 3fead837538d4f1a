use super::frame::counted;
use crate::control::Trip;
use crate::dataset::table::{Table, TableError};
use crate::dataset::{Contact, DatasetError, Manifest, Record, Retouch, RunFolder, altered};
use crate::quantity::{ArrayLayout, Place};
use miette::Diagnostic;
use std::path::Path;
use thiserror::Error;

/// A sensor and all that was recorded of it, in one run or in one for each phase.
pub struct Subject {
    /// The runs, in the order they were named; at least one.
    pub runs: Vec<Recorded>,
    /// The presses of all of them.
    pub table: Table,
    /// Where the units are.
    pub layout: ArrayLayout,
}

/// What one run recorded.
pub struct Recorded {
    /// The folder's name.
    pub name: String,
    /// What it was and how it ended.
    pub manifest: Manifest,
    /// Each zero taken in air: when, s since the run's start, and the load cell's reading, N.
    pub zeros: Vec<(f64, f64)>,
    /// Rules that were broken: when, s, in which press, and which.
    pub trips: Vec<(f64, Option<u64>, Trip)>,
    /// Places touched again before it went on.
    pub retouches: Vec<Retouch>,
    /// What was measured, in the order it was.
    pub contacts: Vec<Contact>,
    /// What of its files isn't as it was written.
    pub altered: Vec<String>,
}

/// Why there is no page.
#[derive(Debug, Error, Diagnostic)]
pub enum ReportError {
    /// A run can't be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Dataset(#[from] DatasetError),
    /// Its table can't be.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Table(#[from] TableError),
    /// Two runs of one page come from two arrays.
    #[error(
        "{first} has {first_units} units, {second} has {second_units}{}: they aren't of one sensor",
        if first_units == second_units { " at other places" } else { "" }
    )]
    #[diagnostic(help("report them apart; to hold sensors side by side, --compare"))]
    Arrays {
        /// A run.
        first: String,
        /// Its units.
        first_units: usize,
        /// Another.
        second: String,
        /// Its units.
        second_units: usize,
    },
    /// Two runs of one page both have presses of a phase.
    #[error("{first} and {second} both have {phase} presses: a page takes each phase from one run")]
    #[diagnostic(help("report them apart; to hold runs side by side, --compare"))]
    Twice {
        /// A run.
        first: String,
        /// Another.
        second: String,
        /// What both have.
        phase: &'static str,
    },
}

/// The phases that a page tells of.
const PHASES: [&str; 3] = ["characterisation", "calibration", "test"];

impl Subject {
    /// Reads the runs of one sensor, each with the layout of its array's units.
    ///
    /// # Errors
    /// A run that can't be read, or runs that don't make one page.
    pub fn read<'a>(runs: impl IntoIterator<Item = (&'a Path, &'a ArrayLayout)>) -> Result<Subject, ReportError> {
        let mut subject: Option<Subject> = None;
        for (path, layout) in runs {
            let run = Recorded::read(path)?;
            let table = presses(path, layout)?;
            subject = Some(match subject {
                None => Subject { runs: vec![run], table, layout: layout.clone() },
                Some(subject) => subject.joined(run, table, layout)?,
            });
        }
        subject.ok_or_else(|| DatasetError::NoRun { path: Path::new("").to_owned() }.into())
    }

    fn joined(mut self, run: Recorded, table: Table, layout: &ArrayLayout) -> Result<Subject, ReportError> {
        let first = |runs: &[Recorded]| runs[0].name.clone();
        if self.layout != *layout {
            return Err(ReportError::Arrays {
                first: first(&self.runs),
                first_units: self.layout.len(),
                second: run.name,
                second_units: layout.len(),
            });
        }
        for phase in PHASES {
            let earlier = self.runs.iter().find(|earlier| earlier.has(phase));
            if let Some(earlier) = earlier.filter(|_| run.has(phase)) {
                return Err(ReportError::Twice { first: earlier.name.clone(), second: run.name, phase });
            }
        }
        self.table.file = format!("{} and {}", self.table.file, table.file);
        self.table.rows.extend(table.rows);
        self.runs.push(run);
        Ok(self)
    }

    /// What the page is about.
    pub fn title(&self) -> String {
        let sensor = self.runs.iter().find_map(|run| run.manifest.facts.sensor.as_ref());
        let runs: Vec<&str> = self.runs.iter().map(|run| run.name.as_str()).collect();
        sensor.map_or_else(|| runs.join(", "), |sensor| format!("Sensor {sensor}"))
    }

    /// On what it rests, in a sentence.
    pub fn told(&self) -> String {
        let recipes: Vec<&str> = self.runs.iter().map(|run| run.manifest.facts.recipe.as_str()).collect();
        let done: u64 = self.runs.iter().map(|run| run.manifest.presses_done).sum();
        let simulated =
            if self.runs.iter().any(|run| run.manifest.facts.simulated) { ", on a simulated rig" } else { "" };
        let (presses, units) = (counted(done as usize, "press"), counted(self.layout.len(), "unit"));
        format!("{presses} of the recipe {}, {units}{simulated}.", recipes.join(", "))
    }

    /// The corners of the area that was calibrated; none without a calibration.
    pub fn area(&self) -> Option<(Place, Place)> {
        let places = self.table.rows.iter().filter(|row| row.is_of("calibration")).map(|row| row.place);
        places.map(|place| (place, place)).reduce(|(least, most), (place, _)| {
            (
                Place::new(least.x_mm.min(place.x_mm), least.y_mm.min(place.y_mm)),
                Place::new(most.x_mm.max(place.x_mm), most.y_mm.max(place.y_mm)),
            )
        })
    }
}

impl Recorded {
    /// What a run's manifest and journal say.
    fn read(path: &Path) -> Result<Recorded, ReportError> {
        let manifest = RunFolder::read_manifest(path)?;
        let name = run_name(path);
        let (zeros, trips, retouches, contacts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let altered = altered(path, &manifest)?;
        let mut run = Recorded { name, manifest, zeros, trips, retouches, contacts, altered };
        for next in RunFolder::read_records(path)? {
            match next.map_err(DatasetError::from)?.1 {
                Record::Zero { t_s, offset_n, .. } => run.zeros.push((t_s, offset_n)),
                Record::Trip { t_s, press, trip } => run.trips.push((t_s, press, trip)),
                Record::Retouch(retouch) => run.retouches.push(retouch),
                Record::Contact(contact) => run.contacts.push(contact),
                Record::Run(_) | Record::Session(_) | Record::Devices(_) | Record::End(_) => {}
            }
        }
        Ok(run)
    }

    fn has(&self, phase: &str) -> bool {
        self.contacts.iter().flat_map(|contact| &contact.rows).any(|row| row.phase.name() == phase)
    }
}

/// A run by its folder's name, also where it is named by a path that has none, such as `.`.
pub fn run_name(path: &Path) -> String {
    let whole = if path.file_name().is_none() { path.canonicalize().ok() } else { None };
    let path = whole.as_deref().unwrap_or(path);
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// A run's presses; a run that broke off before the first has none.
pub fn presses(path: &Path, layout: &ArrayLayout) -> Result<Table, TableError> {
    match RunFolder::read_presses(path) {
        Err(TableError::NoRows { file }) => Ok(Table { file, units: layout.len(), rows: Vec::new() }),
        read => read,
    }
}
