//! A fitted method as plain tables, for programs that solve without this library.

use super::field::SplineField;
use super::fitted::Answering;
use super::forward::Forward;
use super::{ForceKnown, ForceRule, Model, Solver as _};
use super::{descent, forward, starts};
use palpate_core::quantity::Place;

/// Everything that a method needs to solve a reading.
#[derive(Clone, Debug, PartialEq)]
pub struct Tables {
    /// Name of the method.
    pub method: &'static str,
    /// Number of outputs of a reading.
    pub outputs: usize,
    /// Outputs that the method uses, counted from 0. All tables have these outputs, in this order.
    pub kept: Vec<usize>,
    /// Additive noise of each used output, as a variance; a reading below it is a weak signal. Empty if it is unknown.
    pub silence: Vec<f64>,
    /// Sum of squares of the outputs divided by their noise, below which a reading is a weak signal.
    pub no_contact: f64,
    /// Whether forces are in newtons. Otherwise they are relative to the typical press of the calibration.
    pub forces_are_known: bool,
    /// The method's own tables.
    pub kind: MethodTables,
}

/// The tables of a kind of method.
#[derive(Clone, Debug, PartialEq)]
pub enum MethodTables {
    /// A table of calibration points, of which one is the answer.
    Points(Points),
    /// A map of the outputs, which is inverted.
    Map(Box<MapTables>),
}

/// Points of `pearson` and `pearson-lsq`.
#[derive(Clone, Debug, PartialEq)]
pub struct Points {
    /// Places of the points, specimen frame, mm.
    pub places: Vec<Place>,
    /// Force of each point, N.
    pub forces_n: Vec<f64>,
    /// Output of each point that gives the force, as its position among the used outputs.
    pub closest: Vec<usize>,
    /// Outputs of the points, row-major, points x used outputs.
    pub rows: Vec<f64>,
    /// The same, minus the mean of the row, of length 1.
    pub directions: Vec<f64>,
    /// Rule of the force.
    pub force_rule: ForceRule,
    /// Residue 1 - r above which a reading isn't one contact: a constant part, and a part that grows with 1 / F^2. Infinite if it
    /// is unknown.
    pub most_residue: [f64; 2],
}

/// Map of `surrogate` and `physics`.
#[derive(Clone, Debug, PartialEq)]
pub struct MapTables {
    /// Output of each unit per newton.
    pub response: Splines,
    /// Variance of the map relative to the noise of one calibration press.
    pub leverage: Splines,
    /// Variance of an output: a constant part for each output, and a part that grows with its square.
    pub noise: [Vec<f64>; 2],
    /// Force of the calibration, N.
    pub force_n: f64,
    /// Whether every contact has this force.
    pub is_constant_load: bool,
    /// Whether an offset that is common to all outputs is eliminated.
    pub common_offset: bool,
    /// Places where the search begins, mm, an even grid with this number of places along each side.
    pub starts: Vec<Place>,
    /// Number of places along a side of that grid.
    pub starts_a_side: usize,
    /// Standard deviation of each output, by which readings are divided before they are compared with the directions.
    pub sd: Vec<f64>,
    /// Directions of the readings at the starts, row-major, starts x used outputs.
    pub directions: Vec<f64>,
    /// Largest output of each unit per newton.
    pub loudest: Vec<f64>,
    /// Largest sum of squares of one contact, and of one contact without a unit.
    pub most: [f64; 2],
    /// Largest reduction of the sum of squares by a place outside the area.
    pub inside: f64,
    /// Largest mean leverage at which the map is known; infinite if it is known everywhere.
    pub known: f64,
    /// Bounds of the search.
    pub search: SearchBounds,
}

/// Bounds of the search for the best fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchBounds {
    /// Largest number of starts.
    pub most_starts: usize,
    /// Largest number of steps from a start.
    pub most_steps: usize,
    /// Largest number of halvings of a step.
    pub most_halvings: usize,
    /// Longest step, as a fraction of the area's longer side.
    pub longest_step: f64,
    /// Expected decrease of the sum of squares below which a step is the last.
    pub last_gain: f64,
    /// Output below which a unit looks dead, and excess above which it looks wrong, in standard deviations of its noise.
    pub broken_sd: f64,
}

/// Uniform cubic B-splines over a rectangle.
#[derive(Clone, Debug, PartialEq)]
pub struct Splines {
    /// Corners of the rectangle, mm.
    pub area: [Place; 2],
    /// Length of a cell along x and y, mm.
    pub step_mm: [f64; 2],
    /// Number of cells along x and y.
    pub cells: [usize; 2],
    /// Coefficients, row-major, y nodes x x nodes x used outputs; there are three nodes more than cells.
    pub coefficients: Vec<f64>,
}

impl Model {
    /// Returns the tables of `pearson`, `pearson-lsq`, `surrogate` or `physics`; `None` for other methods, and for depths.
    pub fn tables(&self) -> Option<Tables> {
        let fitted = Some(self.fitted()).filter(|fitted| fitted.depth_curve().is_none())?;
        let kept = fitted.kept();
        let (silence, no_contact, kind) = match fitted.answering() {
            Answering::Forward(forward) => {
                let silence = (0..kept.len()).map(|unit| forward.response.noise.variance(unit, 0.0)).collect();
                (silence, forward.limits.no_contact, MethodTables::Map(Box::new(map(forward))))
            }
            Answering::Appraised(appraised) => {
                let (silence, no_contact, most_residue) = appraised.silence();
                (silence, no_contact, MethodTables::Points(appraised.pearson()?.points(most_residue)))
            }
            Answering::ByLoad(_) => return None,
        };
        let (method, outputs) = (fitted.name(), self.validity().units);
        let forces_are_known = self.forces_are_known();
        Some(Tables { method, outputs, kept, silence, no_contact, forces_are_known, kind })
    }
}

fn map(forward: &Forward) -> MapTables {
    let Forward { response, starts, limits, load, loudest, .. } = forward;
    MapTables {
        response: splines(&response.field),
        leverage: splines(&response.leverage),
        noise: response.noise.parts(),
        force_n: response.force_n,
        is_constant_load: *load == ForceKnown::Constant,
        common_offset: starts.common_offset,
        starts: starts.places.clone(),
        starts_a_side: starts::STARTS_A_SIDE,
        sd: starts.sd.clone(),
        directions: starts.directions.rows().to_vec(),
        loudest: loudest.clone(),
        most: [limits.one_contact, limits.without_a_unit],
        inside: limits.inside,
        known: limits.known,
        search: SearchBounds {
            most_starts: starts::MOST_STARTS,
            most_steps: descent::MOST_STEPS,
            most_halvings: descent::MOST_HALVINGS,
            longest_step: descent::LONGEST_STEP,
            last_gain: descent::LAST_GAIN,
            broken_sd: forward::BROKEN_SD,
        },
    }
}

fn splines(field: &SplineField) -> Splines {
    let area = field.area();
    let (step_mm, cells, coefficients) = field.table();
    Splines { area: [area.least, area.most], step_mm, cells, coefficients: coefficients.to_vec() }
}
