//! From presses to a calibration: which of them count, and whose force.

use super::{Press, Presses};
use crate::recipe::Phase;
use crate::solver::{Calibration, CalibrationError, CalibrationPoint, FitError, ForceKnown, TestPress};
use miette::Diagnostic;

/// Why a table is no calibration; all of them are exit code 2.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum CalibrateError {
    /// There is no press of the kind asked for.
    #[error("{source_name}: no valid {phase} press ({flagged} are flagged and excluded)")]
    #[diagnostic(help(
        "an evaluation needs presses of both phases, or two tables: \
         --calibration runs/calibrate/presses.csv --test runs/test/presses.csv"
    ))]
    NoPresses {
        /// The run or the table.
        source_name: String,
        /// calibration or test.
        phase: &'static str,
        /// How many of them are flagged.
        flagged: usize,
    },
    /// A press can't be calibrated on.
    #[error("{at}, column `{column}`: this press can't be used for a calibration")]
    #[diagnostic(help(
        "correct or remove the row; where pressing is a negative force, use a columns file with `force_n = -1.0` in [scale]"
    ))]
    Press {
        /// Where it stands.
        at: String,
        /// The column its force comes from.
        column: &'static str,
        /// What is wrong.
        source: CalibrationError,
    },
    /// The method can't be fitted.
    #[error("{source_name}: can't be used as a calibration")]
    Fit {
        /// The calibration's run or table.
        source_name: String,
        /// Why.
        source: FitError,
    },
}

/// The calibration presses of a run, by the load cell's force.
pub fn calibration_of_run(presses: &Presses, load: ForceKnown) -> Result<Calibration, CalibrateError> {
    Selection::of_phase(presses, Phase::Calibration)?.calibration(&LOAD_CELL, load)
}

/// Every press of a table. Without `force_n` the forces are relative, see [`Calibration::without_forces`].
pub fn calibration_of_table(presses: &Presses, load: ForceKnown) -> Result<Calibration, CalibrateError> {
    Selection::of_all(presses, Phase::Calibration)?.calibration(&LOAD_CELL, load)
}

/// Where the true force of a press comes from.
pub struct ForceColumn {
    name: &'static str,
    of: fn(&Press) -> Option<f64>,
}

/// What the load cell measured, and the force of a table from outside if it has one.
pub const LOAD_CELL: ForceColumn = ForceColumn { name: "force_n", of: |press| press.force_n };

/// What was commanded; only a run knows.
pub const COMMANDED: ForceColumn = ForceColumn { name: "force_set_n", of: |press| press.force_set_n };

/// The unflagged presses of one kind.
pub struct Selection<'a> {
    presses: &'a Presses,
    chosen: Vec<usize>,
    /// How many presses of that kind are flagged, and left out.
    pub flagged: usize,
}

impl<'a> Selection<'a> {
    /// The presses of a run that were made for a phase.
    ///
    /// # Errors
    /// There is none that isn't flagged.
    pub fn of_phase(presses: &'a Presses, phase: Phase) -> Result<Self, CalibrateError> {
        Self::new(presses, phase, |press| press.is_of(phase))
    }

    /// All presses, which count as of a phase, even if they state another.
    ///
    /// # Errors
    /// There is none that isn't flagged.
    pub fn of_all(presses: &'a Presses, phase: Phase) -> Result<Self, CalibrateError> {
        Self::new(presses, phase, |_| true)
    }

    fn new(presses: &'a Presses, phase: Phase, is_of_it: impl Fn(&Press) -> bool) -> Result<Self, CalibrateError> {
        let of_it = (0..presses.presses.len()).filter(|index| is_of_it(&presses.presses[*index]));
        let (flagged, chosen): (Vec<usize>, Vec<usize>) = of_it.partition(|index| presses.presses[*index].is_flagged());
        let flagged = flagged.len();
        if chosen.is_empty() {
            let (source_name, phase) = (presses.source.clone(), phase.name());
            return Err(CalibrateError::NoPresses { source_name, phase, flagged });
        }
        Ok(Selection { presses, chosen, flagged })
    }

    /// The presses, in their order.
    pub fn iter(&self) -> impl Iterator<Item = &'a Press> {
        self.chosen.iter().map(|index| &self.presses.presses[*index])
    }

    /// Where they come from.
    pub fn source(&self) -> &'a str {
        &self.presses.source
    }

    /// Whether every press has a force of that kind: newtons, then, and not shares of a typical press.
    pub fn knows(&self, force: &ForceColumn) -> bool {
        self.iter().all(|press| (force.of)(press).is_some())
    }

    /// The presses to solve. `is_known` says whether the calibration is in newtons: if it isn't, no force can be compared with one.
    pub fn to_solve(&self, force: &ForceColumn, is_known: bool) -> Vec<TestPress<'a>> {
        let press = |press: &'a Press| TestPress {
            place: press.place(),
            force_n: (force.of)(press).filter(|_| is_known),
            outputs: &press.outputs,
        };
        self.iter().map(press).collect()
    }

    /// The presses as a calibration.
    ///
    /// # Errors
    /// A press that can't be calibrated on.
    pub fn calibration(&self, force: &ForceColumn, load: ForceKnown) -> Result<Calibration, CalibrateError> {
        let point = |press: &'a Press| CalibrationPoint {
            place: press.place(),
            force_n: (force.of)(press).unwrap_or(UNIT_FORCE_N),
            outputs: &press.outputs,
        };
        let points: Vec<CalibrationPoint<'_>> = self.iter().map(point).collect();
        let calibration = match load {
            ForceKnown::Unknown if !self.knows(force) => Calibration::without_forces(&points),
            _ => Calibration::new(&points),
        };
        calibration.map_err(|source| {
            let index = source.point().and_then(|point| self.chosen.get(point)).copied();
            let at = index.map_or_else(|| self.source().to_owned(), |index| self.presses.at(index));
            CalibrateError::Press { at, column: force.name, source }
        })
    }
}

/// What a constant load counts as where no force is given, N.
const UNIT_FORCE_N: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::super::evaluate::tests::{RUN, run, table};
    use super::*;

    fn forces(calibration: &Calibration) -> Vec<f64> {
        calibration.points().map(|point| point.force_n).collect()
    }

    #[test]
    fn stated_forces_stand_and_a_constant_load_is_1_n() {
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
    fn a_runs_calibration_is_its_unflagged_presses_by_the_load_cell() {
        let presses = run(RUN);
        assert_eq!(forces(&calibration_of_run(&presses, ForceKnown::Unknown).unwrap()), [0.8, 0.8]);
        let without = run(&RUN.replace("calibration", "teach"));
        let refusal = calibration_of_run(&without, ForceKnown::Unknown).unwrap_err();
        assert!(matches!(refusal, CalibrateError::NoPresses { phase: "calibration", flagged: 0, .. }), "{refusal}");
    }
}
