//! What a page is about: a sensor and its runs.

use super::beside_paper::is_beside_paper;
use super::frame::counted;
use crate::dataset::{DatasetError, Presses, Recorded};
use crate::quantity::{ArrayLayout, Place};
use crate::recipe::Phase;
use crate::rig::ArraySpec;
use miette::Diagnostic;
use std::path::Path;
use thiserror::Error;

/// A sensor and all that was recorded of it, in one run or in one for each phase.
pub struct Subject {
    /// The runs, in the order they were named; at least one.
    pub runs: Vec<Recorded>,
    /// The presses of all of them.
    pub presses: Presses,
    /// Where the units are.
    pub layout: ArrayLayout,
    /// The unit of the outputs, as the rig says.
    pub unit: String,
}

/// Why there is no page.
#[derive(Debug, Error, Diagnostic)]
pub enum ReportError {
    /// A run can't be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Dataset(#[from] DatasetError),
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

/// The phases that a page reports.
const PHASES: [Phase; 3] = [Phase::Characterisation, Phase::Calibration, Phase::Test];

impl Subject {
    /// The runs of one sensor, each with its array as the rig says.
    ///
    /// # Errors
    /// No run, or runs that don't make one page.
    pub fn of(runs: impl IntoIterator<Item = (Recorded, ArraySpec)>) -> Result<Subject, ReportError> {
        let mut subject: Option<Subject> = None;
        for (run, ArraySpec { layout, unit, .. }) in runs {
            let presses = run.presses();
            subject = Some(match subject {
                None => Subject { runs: vec![run], presses, layout, unit },
                Some(subject) => subject.joined(run, presses, &layout)?,
            });
        }
        subject.ok_or_else(|| DatasetError::NoRun { path: Path::new("").to_owned() }.into())
    }

    fn joined(mut self, run: Recorded, presses: Presses, layout: &ArrayLayout) -> Result<Subject, ReportError> {
        let first = |runs: &[Recorded]| run_name(&runs[0].path);
        if self.layout != *layout {
            return Err(ReportError::Arrays {
                first: first(&self.runs),
                first_units: self.layout.len(),
                second: run_name(&run.path),
                second_units: layout.len(),
            });
        }
        for phase in PHASES {
            let earlier = self.runs.iter().find(|earlier| has(earlier, phase));
            if let Some(earlier) = earlier.filter(|_| has(&run, phase)) {
                let (first, second) = (run_name(&earlier.path), run_name(&run.path));
                return Err(ReportError::Twice { first, second, phase: phase.name() });
            }
        }
        self.presses.join(presses);
        self.runs.push(run);
        Ok(self)
    }

    /// What the page is about.
    pub fn title(&self) -> String {
        let sensor = self.runs.iter().find_map(|run| run.manifest.facts.sensor.as_ref());
        let runs: Vec<String> = self.runs.iter().map(|run| run_name(&run.path)).collect();
        sensor.map_or_else(|| runs.join(", "), |sensor| format!("Sensor {sensor}"))
    }

    /// On what it rests, in a sentence.
    pub fn told(&self) -> String {
        let recipes: Vec<&str> = self.runs.iter().map(|run| run.manifest.facts.recipe.as_str()).collect();
        let done: u64 = self.runs.iter().map(|run| run.manifest.presses_done).sum();
        let simulated =
            if self.runs.iter().any(|run| run.manifest.facts.simulated) { ", on a simulated rig" } else { "" };
        let (presses, units) = (counted(done as usize, "press"), counted(self.layout.units().len(), "unit"));
        format!("{presses} of the recipe {}, {units}{simulated}.", recipes.join(", "))
    }

    /// Whether the paper's numbers stand beside its own, see [`is_beside_paper`].
    pub fn is_beside_paper(&self) -> bool {
        is_beside_paper(&self.layout, &self.presses)
    }

    /// The corners of the area that was calibrated; none without a calibration.
    pub fn area(&self) -> Option<(Place, Place)> {
        let calibrated = self.presses.presses.iter().filter(|press| press.is_of(Phase::Calibration));
        let places = calibrated.map(|press| press.place());
        places.map(|place| (place, place)).reduce(|(least, most), (place, _)| {
            (
                Place::new(least.x_mm.min(place.x_mm), least.y_mm.min(place.y_mm)),
                Place::new(most.x_mm.max(place.x_mm), most.y_mm.max(place.y_mm)),
            )
        })
    }
}

/// Whether a run has presses of a phase.
fn has(run: &Recorded, phase: Phase) -> bool {
    run.contacts.iter().flat_map(|contact| &contact.levels).any(|press| press.is_of(phase))
}

/// A run by its folder's name, also where it is named by a path that has none, such as `.`.
pub fn run_name(path: &Path) -> String {
    let whole = if path.file_name().is_none() { path.canonicalize().ok() } else { None };
    let path = whole.as_deref().unwrap_or(path);
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}
