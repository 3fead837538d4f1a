//! Makes a calibration from presses: selects the presses that count and the source of their forces.

use super::{Press, Presses};
use crate::recipe::Phase;
use miette::Diagnostic;
use palpate_solver::{Calibration, CalibrationError, CalibrationPoint, FitError, ForceKnown, TestPress};
use std::collections::HashSet;

/// Reason why a table isn't a calibration; all reasons are exit code 2.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum CalibrateError {
    /// There is no press of the requested kind.
    #[error("{source_name}: no valid {phase} press ({flagged} are flagged and excluded)")]
    #[diagnostic(help(
        "an evaluation needs presses of both phases, or two tables: \
         --calibration runs/calibrate/presses.csv --test runs/test/presses.csv"
    ))]
    NoPresses {
        /// Name of the run or the table.
        source_name: String,
        /// Phase: calibration or test.
        phase: &'static str,
        /// Number of these presses that are flagged.
        flagged: usize,
    },
    /// A press is unsuitable for calibration.
    #[error("{at}, column `{column}`: this press can't be used for a calibration")]
    #[diagnostic(help(
        "correct or remove the row; where pressing is a negative force, use a columns file with `force_n = -1.0` in [scale]"
    ))]
    Press {
        /// Position of the press in the source.
        at: String,
        /// Column of its force.
        column: &'static str,
        /// Cause of the error.
        source: CalibrationError,
    },
    /// A press has no depth.
    #[error("{0}: not every press has a depth")]
    #[diagnostic(help("add a column `depth_mm`, or name it: --columns depth_mm=NAME"))]
    NoDepth(String),
    /// The presses don't show how outputs depend on the place.
    #[error("{source_name}: {presses} calibration {} at {places} {}; a calibration needs at least {PLACES_LEAST} different places",
        if *presses == 1 { "press" } else { "presses" }, if *places == 1 { "place" } else { "places" })]
    #[diagnostic(help(
        "press a grid over the area to be solved, such as 25 x 25 places; check that x_mm and y_mm are the places in mm"
    ))]
    FewPlaces {
        /// Run or table of the calibration.
        source_name: String,
        /// Number of presses.
        presses: usize,
        /// Number of different places.
        places: usize,
    },
    /// The method can't be fitted.
    #[error("{source_name}: can't be used as a calibration")]
    Fit {
        /// Run or table of the calibration.
        source_name: String,
        /// Reason of the error.
        source: FitError,
    },
}

/// Smallest number of different places of a calibration. With fewer, every contact would get the same place.
pub(crate) const PLACES_LEAST: usize = 2;

/// Returns the calibration presses of a run, with the load cell's forces.
pub fn calibration_of_run(presses: &Presses, load: ForceKnown) -> Result<Calibration, CalibrateError> {
    run_by(presses, load, SolvedQuantity::Known)
}

/// Returns the calibration presses of a run, with their forces or depths.
pub fn run_by(presses: &Presses, load: ForceKnown, quantity: SolvedQuantity) -> Result<Calibration, CalibrateError> {
    let selection = Selection::of_phase(presses, Phase::Calibration)?;
    selection.calibration(quantity.of(&selection, &LOAD_CELL), load)
}

/// Returns every press of a table. Without `force_n` the presses are known by `depth_mm`; without both the forces are relative, see
/// [`Calibration::without_forces`].
pub fn calibration_of_table(presses: &Presses, load: ForceKnown) -> Result<Calibration, CalibrateError> {
    table_by(presses, load, SolvedQuantity::Known)
}

/// Returns every press of a table, with their forces or depths.
pub fn table_by(presses: &Presses, load: ForceKnown, quantity: SolvedQuantity) -> Result<Calibration, CalibrateError> {
    let selection = Selection::of_all(presses, Phase::Calibration)?;
    selection.calibration(quantity.of(&selection, &LOAD_CELL), load)
}

/// Checks that a calibration has enough different places to fit a method.
///
/// # Errors
/// It has fewer than [`PLACES_LEAST`].
pub fn check_places(source_name: &str, calibration: &Calibration) -> Result<(), CalibrateError> {
    let places = calibration.points().map(|point| [point.place.x_mm, point.place.y_mm].map(f64::to_bits));
    let places = places.collect::<HashSet<_>>().len();
    if places < PLACES_LEAST {
        let (source_name, presses) = (source_name.to_owned(), calibration.len());
        return Err(CalibrateError::FewPlaces { source_name, presses, places });
    }
    Ok(())
}

/// Source of the true force of a press, or of its depth.
#[derive(Debug)]
pub struct ForceSource {
    name: &'static str,
    of: fn(&Press) -> Option<f64>,
}

/// Force measured by the load cell, or the force of an external table if it has one.
pub const LOAD_CELL: ForceSource = ForceSource { name: "force_n", of: |press| press.force_n };

/// Commanded force; known only for a run.
pub(crate) const COMMANDED: ForceSource = ForceSource { name: "force_set_n", of: |press| press.force_set_n };

/// Depth below the surface, mm, instead of a force.
pub const DEPTH: ForceSource = ForceSource { name: "depth_mm", of: |press| press.depth_mm };

impl ForceSource {
    /// Whether it is the depth.
    pub fn is_depth(&self) -> bool {
        self.name == DEPTH.name
    }
}

/// What is solved besides the place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SolvedQuantity {
    /// The force, or the depth if no press has a force and every press has a depth.
    #[default]
    Known,
    /// The force.
    Force,
    /// The depth.
    Depth,
}

impl SolvedQuantity {
    /// Returns the source for some presses: the depth if it is wanted, otherwise this source of forces.
    pub(crate) fn of(self, presses: &Selection<'_>, force: &'static ForceSource) -> &'static ForceSource {
        let is_only_depth = || presses.knows(&DEPTH) && !presses.iter().any(|press| press.force_n.is_some());
        match self {
            SolvedQuantity::Depth => &DEPTH,
            SolvedQuantity::Known if is_only_depth() => &DEPTH,
            SolvedQuantity::Known | SolvedQuantity::Force => force,
        }
    }
}

/// The unflagged presses of one kind.
pub struct Selection<'a> {
    presses: &'a Presses,
    chosen: Vec<usize>,
    /// Number of presses of that kind that are flagged, and therefore excluded.
    pub flagged: usize,
}

impl<'a> Selection<'a> {
    /// Selects the presses of a run that belong to a phase.
    ///
    /// # Errors
    /// There is no press without a flag.
    pub fn of_phase(presses: &'a Presses, phase: Phase) -> Result<Self, CalibrateError> {
        Self::new(presses, phase, |press| press.is_of(phase))
    }

    /// Selects all presses. They count as presses of `phase`, even if they state another phase.
    ///
    /// # Errors
    /// There is no press without a flag.
    pub fn of_all(presses: &'a Presses, phase: Phase) -> Result<Self, CalibrateError> {
        Self::new(presses, phase, |_| true)
    }

    fn new(presses: &'a Presses, phase: Phase, is_of_it: impl Fn(&Press) -> bool) -> Result<Self, CalibrateError> {
        let of_it = (0..presses.presses.len()).filter(|index| {
            let press = &presses.presses[*index];
            is_of_it(press) && !press.is_dragged()
        });
        let (flagged, chosen): (Vec<usize>, Vec<usize>) = of_it.partition(|index| presses.presses[*index].is_flagged());
        let flagged = flagged.len();
        if chosen.is_empty() {
            let (source_name, phase) = (presses.source.clone(), phase.name());
            return Err(CalibrateError::NoPresses { source_name, phase, flagged });
        }
        Ok(Selection { presses, chosen, flagged })
    }

    /// Returns the presses in order.
    pub fn iter(&self) -> impl Iterator<Item = &'a Press> {
        self.chosen.iter().map(|index| &self.presses.presses[*index])
    }

    /// Returns the largest change of the load cell that the checks leave possible, as a fraction of the force.
    pub fn cell(&self) -> f64 {
        self.presses.cell
    }

    /// Returns the source of the presses.
    pub fn source(&self) -> &'a str {
        &self.presses.source
    }

    /// Whether every press has a force of that kind. Forces are then in newtons, and not relative to a typical press.
    pub fn knows(&self, force: &ForceSource) -> bool {
        self.iter().all(|press| (force.of)(press).is_some())
    }

    /// Returns the presses to solve. `is_known` states whether the calibration is in newtons. If it isn't, no force can be
    /// compared with a solved force.
    pub fn to_solve(&self, force: &ForceSource, is_known: bool) -> Vec<TestPress<'a>> {
        let press = |press: &'a Press| TestPress {
            place: press.place(),
            force_n: (force.of)(press).filter(|_| is_known && !force.is_depth()),
            depth_mm: press.depth_mm.filter(|_| is_known && force.is_depth()),
            outputs: &press.outputs,
        };
        self.iter().map(press).collect()
    }

    /// Returns the presses as a calibration.
    ///
    /// # Errors
    /// A press is unsuitable for calibration.
    pub fn calibration(&self, force: &ForceSource, load: ForceKnown) -> Result<Calibration, CalibrateError> {
        let point = |press: &'a Press| CalibrationPoint {
            place: press.place(),
            force_n: (force.of)(press).filter(|_| !force.is_depth()).unwrap_or(UNIT_FORCE_N),
            outputs: &press.outputs,
        };
        let points: Vec<CalibrationPoint<'_>> = self.iter().map(point).collect();
        let depths_mm: Option<Vec<f64>> = self.iter().map(|press| press.depth_mm).collect();
        let calibration = match load {
            ForceKnown::Unknown if force.is_depth() => {
                let depths_mm = depths_mm.ok_or_else(|| CalibrateError::NoDepth(self.source().to_owned()))?;
                Calibration::by_depth(&points, &depths_mm)
            }
            _ if force.is_depth() => Calibration::new(&points).map(Calibration::with_unknown_forces),
            ForceKnown::Unknown if !self.knows(force) => Calibration::without_forces(&points),
            ForceKnown::Constant if !self.knows(force) => {
                Calibration::new(&points).map(Calibration::with_unknown_forces)
            }
            _ => Calibration::new(&points),
        };
        calibration.map_err(|source| {
            let index = source.point().and_then(|point| self.chosen.get(point)).copied();
            let at = index.map_or_else(|| self.source().to_owned(), |index| self.presses.at(index));
            CalibrateError::Press { at, column: force.name, source }
        })
    }
}

/// Assumed force of a constant load if no force is given, N.
const UNIT_FORCE_N: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::super::evaluate::tests::{RUN, run, table};
    use super::*;

    fn forces(calibration: &Calibration) -> Vec<f64> {
        calibration.points().map(|point| point.force_n).collect()
    }

    #[test]
    fn stated_forces_are_kept_and_constant_load_is_1_n() {
        let stated = table("x_mm,y_mm,force_n,out_1\n0,0,2,1\n1,0,3,9\n");
        let silent = table("x_mm,y_mm,out_1\n0,0,1\n1,0,9\n");
        for load in [ForceKnown::Unknown, ForceKnown::Constant] {
            assert_eq!(forces(&calibration_of_table(&stated, load).unwrap()), [2.0, 3.0]);
        }
        assert_eq!(forces(&calibration_of_table(&silent, ForceKnown::Constant).unwrap()), [1.0, 1.0]);
        let relative = forces(&calibration_of_table(&silent, ForceKnown::Unknown).unwrap());
        assert!((relative[1] / relative[0] - 9.0).abs() < 1e-12, "{relative:?}");
    }

    #[test]
    fn presses_at_one_place_are_refused_as_calibration() {
        for (text, presses) in [
            ("x_mm,y_mm,out_1\n0,0,1\n", "1 calibration press"),
            ("x_mm,y_mm,out_1\n0,0,1\n0,0,2\n", "2 calibration presses"),
        ] {
            let calibration = calibration_of_table(&table(text), ForceKnown::Unknown).unwrap();
            let refused = check_places("a.csv", &calibration).unwrap_err().to_string();
            assert!(
                refused.contains(&format!("{presses} at 1 place; a calibration needs at least 2 different places")),
                "{refused}"
            );
        }
    }

    #[test]
    fn a_runs_calibration_is_its_unflagged_presses_by_the_load_cell() {
        let presses = run(RUN);
        assert_eq!(forces(&calibration_of_run(&presses, ForceKnown::Unknown).unwrap()), [0.8, 0.8]);
        let without = run(&RUN.replace("calibration", "teach"));
        let refusal = calibration_of_run(&without, ForceKnown::Unknown).unwrap_err();
        assert!(matches!(refusal, CalibrateError::NoPresses { phase: "calibration", flagged: 0, .. }), "{refusal}");
    }
}
