//! Subject of a page: a sensor and its runs.

use super::beside_paper::is_beside_paper;
use super::frame::counted;
use miette::Diagnostic;
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_data::dataset::{DatasetError, Evidence, Labels, Press, Presses, Recorded};
use palpate_data::recipe::Phase;
use palpate_run::rig::Bench;
use std::collections::HashSet;
use std::path::Path;
use thiserror::Error;

/// A sensor and all its recorded data, in one run or in one run for each phase.
pub struct Subject {
    /// Runs in the order they were given; at least one.
    pub runs: Vec<Recorded>,
    /// Presses of all runs.
    pub presses: Presses,
    /// Benches of the runs: at least one, all with the same array.
    pub benches: Vec<Bench>,
}

/// Reason why there is no page.
#[derive(Debug, Error, Diagnostic)]
pub enum ReportError {
    /// A run can't be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Dataset(#[from] DatasetError),
    /// Two runs of one page are from two arrays.
    #[error(
        "{first} has {first_units} units, {second} has {second_units}{}: they are of different sensors",
        if first_units == second_units { " at other places" } else { "" }
    )]
    #[diagnostic(help("report them separately, or add --compare to compare sensors"))]
    Arrays {
        /// Name of a run.
        first: String,
        /// Number of its units.
        first_units: usize,
        /// Name of another run.
        second: String,
        /// Number of its units.
        second_units: usize,
    },
    /// Two runs of one page are from two sensors, designs or batches.
    #[error("{first} is of the {label} {of_first}, {second} of {of_second}: a page is about one sensor")]
    #[diagnostic(help("report them separately, or add --compare to compare sensors"))]
    Sensors {
        /// Label that differs.
        label: &'static str,
        /// Name of a run.
        first: String,
        /// Its label.
        of_first: String,
        /// Name of another run.
        second: String,
        /// Its label.
        of_second: String,
    },
    /// A run doesn't state its sensor.
    #[error("{run} has no sensor ID: it may be of another sensor than {other}")]
    #[diagnostic(help("if they are of one sensor, add --same-sensor; give --sensor ID with the next run"))]
    Unnamed {
        /// Name of the run.
        run: String,
        /// Name of a run on the same page.
        other: String,
    },
    /// Two runs of one page have outputs in different units.
    #[error(
        "the outputs of {first} are in {first_unit}, those of {second} in {second_unit}: they are of different sensors"
    )]
    #[diagnostic(help("report them separately, or add --compare to compare sensors"))]
    Units {
        /// Name of a run.
        first: String,
        /// The unit of its outputs.
        first_unit: String,
        /// Name of another run.
        second: String,
        /// The unit of its outputs.
        second_unit: String,
    },
    /// Two runs of one page both have presses of a phase.
    #[error("{first} and {second} both have {phase} presses: a page can use only one run per phase")]
    #[diagnostic(help("report them separately, or add --compare to compare runs"))]
    Twice {
        /// Name of a run.
        first: String,
        /// Name of another run.
        second: String,
        /// Phase that both runs have.
        phase: &'static str,
    },
}

/// Phases that a page reports.
const PHASES: [Phase; 3] = [Phase::Characterisation, Phase::Calibration, Phase::Test];

impl Subject {
    /// Takes the runs of one sensor, each with its bench. With `same_sensor`, runs without a sensor ID also belong to the sensor.
    ///
    /// # Errors
    /// There is no run, or the runs don't belong on one page.
    pub fn of(runs: impl IntoIterator<Item = (Recorded, Bench)>, same_sensor: bool) -> Result<Subject, ReportError> {
        let mut subject: Option<Subject> = None;
        for (run, bench) in runs {
            let presses = run.presses();
            subject = Some(match subject {
                None => Subject { runs: vec![run], presses, benches: vec![bench] },
                Some(subject) => {
                    subject.check_sensor(&run, same_sensor)?;
                    subject.check_array(&run, &bench)?;
                    subject.joined(run, bench, presses)?
                }
            });
        }
        subject.ok_or_else(|| DatasetError::NoRun { path: Path::new("").to_owned() }.into())
    }

    /// Returns all recorded data of the sensor, for the verdict.
    pub fn evidence(&self) -> Evidence<'_> {
        let runs = self.runs.iter().collect();
        Evidence { presses: &self.presses, layout: Some(self.layout()), runs, u_place_mm: self.u_place_mm() }
    }

    /// Returns the outputs and their units.
    pub fn layout(&self) -> &ArrayLayout {
        &self.benches[0].layout
    }

    /// Returns the layout, if the positions of the units are known.
    pub fn placed(&self) -> Option<&ArrayLayout> {
        self.benches[0].placed()
    }

    /// Returns the unit of the outputs.
    pub fn unit(&self) -> &str {
        &self.benches[0].unit
    }

    /// Returns the standard uncertainty of the pressed places, mm: the largest of all runs. `None` if it is unknown for any run.
    pub fn u_place_mm(&self) -> Option<f64> {
        let all: Option<Vec<f64>> = self.benches.iter().map(Bench::u_place_mm).collect();
        all?.into_iter().reduce(f64::max)
    }

    /// Checks that a run belongs to the same sensor as the runs before, if the runs state their sensor. For runs that don't,
    /// `same_sensor` states that it is the same.
    fn check_sensor(&self, run: &Recorded, same_sensor: bool) -> Result<(), ReportError> {
        let labels = |run: &Recorded| {
            let Labels { sensor, design, batch, .. } = run.manifest.facts.labels.clone();
            [("sensor", sensor), ("design", design), ("batch", batch)]
        };
        let second = run.name();
        for earlier in &self.runs {
            let first = earlier.name();
            for ((label, of_first), (_, of_second)) in labels(earlier).into_iter().zip(labels(run)) {
                match (of_first, of_second) {
                    (Some(of_first), Some(of_second)) if of_first != of_second => {
                        return Err(ReportError::Sensors { label, first, of_first, second, of_second });
                    }
                    (None, _) if label == "sensor" && !same_sensor => {
                        return Err(ReportError::Unnamed { run: first, other: second });
                    }
                    (_, None) if label == "sensor" && !same_sensor => {
                        return Err(ReportError::Unnamed { run: second, other: first });
                    }
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// Checks that a run's array is that of the runs before.
    fn check_array(&self, run: &Recorded, Bench { layout, unit, .. }: &Bench) -> Result<(), ReportError> {
        let (first, second) = (self.runs[0].name(), run.name());
        if self.layout() != layout {
            let (first_units, second_units) = (self.layout().len(), layout.len());
            return Err(ReportError::Arrays { first, first_units, second, second_units });
        }
        if self.unit() != unit {
            let (first_unit, second_unit) = (self.unit().to_owned(), unit.clone());
            return Err(ReportError::Units { first, first_unit, second, second_unit });
        }
        Ok(())
    }

    fn joined(mut self, run: Recorded, bench: Bench, presses: Presses) -> Result<Subject, ReportError> {
        for phase in PHASES {
            let earlier = self.runs.iter().find(|earlier| has(earlier, phase));
            if let Some(earlier) = earlier.filter(|_| has(&run, phase)) {
                let (first, second) = (earlier.name(), run.name());
                return Err(ReportError::Twice { first, second, phase: phase.name() });
            }
        }
        self.presses.join(presses);
        self.runs.push(run);
        self.benches.push(bench);
        Ok(self)
    }

    /// Returns the title of the page.
    pub fn title(&self) -> String {
        let sensor = self.runs.iter().find_map(|run| run.manifest.facts.labels.sensor.as_ref());
        let runs: Vec<String> = self.runs.iter().map(|run| run.name()).collect();
        sensor.map_or_else(|| runs.join(", "), |sensor| format!("Sensor {sensor}"))
    }

    /// Returns the basis of the page, as a sentence.
    pub fn text(&self) -> String {
        let recipes: Vec<String> = self.runs.iter().map(|run| run.manifest.facts.text()).collect();
        let done: u64 = self.runs.iter().map(|run| run.manifest.presses_done).sum();
        let simulated =
            if self.runs.iter().any(|run| run.manifest.facts.simulated) { ", on a simulated rig" } else { "" };
        let forces = match self.has_load_cell() {
            true => "",
            false => {
                " There was no load cell: no force is known, and nothing but the declared stiffness limited the force."
            }
        };
        let confirmed = self.runs.iter().filter_map(|run| run.manifest.facts.confirmed_within_mm).reduce(f64::max);
        let surface = confirmed.map_or_else(String::new, |mm| {
            format!(
                " Depths count from a surface that a person confirmed. Its uncertainty, {mm} mm, isn't in the depth errors."
            )
        });
        let (presses, units) = (counted(done as usize, "press"), counted(self.layout().units().len(), "unit"));
        format!("{presses} of {}, {units}{simulated}.{forces}", recipes.join(", ")) + &surface
    }

    /// Whether every run had a load cell.
    pub(super) fn has_load_cell(&self) -> bool {
        self.runs.iter().all(|run| !run.manifest.facts.without_load_cell)
    }

    /// Whether the tip was dragged in contact.
    pub(super) fn has_drags(&self) -> bool {
        self.presses.presses.iter().any(Press::is_dragged)
    }

    /// Returns the sound presses of the calibration. With drags, a place is pressed once for each of them: the first one is returned.
    pub(super) fn calibrated(&self) -> Vec<&Press> {
        let (has_drags, mut known) = (self.has_drags(), HashSet::new());
        let load = |press: &Press| [press.x_mm, press.y_mm, press.force_set_n.unwrap_or_default()].map(f64::to_bits);
        let presses = self.presses.sound(Phase::Calibration);
        presses.filter(|press| !has_drags || known.insert(load(press))).collect()
    }

    /// Whether the paper's numbers are shown next to the sensor's numbers, see [`is_beside_paper`].
    pub fn is_beside_paper(&self) -> bool {
        is_beside_paper(self.layout(), &self.presses)
    }

    /// Returns the corners of the calibrated area; `None` without a calibration.
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
