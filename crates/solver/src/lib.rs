//! The inverse problem: finds place and force of a contact from a calibration and one reading of the array.
//!
//! A [`Calibration`] is presses of known place and force. [`Model::fit`] fits a method to it once, and a [`Session`] solves one
//! reading after another: one output of each taxel gives a [`Solution`], or the reason why there is none. No answer is NaN.
//! [`evaluate`] compares the answers with presses whose place and force are known. Places are in the specimen frame, mm; forces in N.
//!
//! Nothing here reads files, asks the time or logs.
//!
//! ```
//! use palpate_solver::{Calibration, CalibrationPoint, Model, Place, Session, Setting};
//!
//! // a row of three taxels, 4 mm apart, pressed with 1 N at nine places
//! let outputs = |x_mm: f64| [-4.0, 0.0, 4.0].map(|taxel_mm: f64| (-(x_mm - taxel_mm).powi(2) / 16.0).exp());
//! let presses: Vec<_> = (-4..=4).map(|x_mm| (f64::from(x_mm), outputs(f64::from(x_mm)))).collect();
//! let points: Vec<_> = presses
//!     .iter()
//!     .map(|(x_mm, outputs)| CalibrationPoint { place: Place::new(*x_mm, 0.0), force_n: 1.0, outputs })
//!     .collect();
//! let model = Model::fit("pearson", Calibration::new(&points)?, &Setting::default())?;
//!
//! let half_the_force = outputs(2.1).map(|output| 0.5 * output);
//! let contact = Session::new(model).solve(&half_the_force)?;
//! assert_eq!(contact.place, Place::new(2.0, 0.0)); // the paper's method answers with a calibrated place
//! assert!((contact.force_n - 0.5).abs() < 0.05);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # The methods
//!
//! | name | file | description |
//! |---|---|---|
//! | `pearson`, `pearson-lsq` | `pearson` | the paper's: the calibration point of the highest correlation |
//! | `surrogate` | `surrogate` | a smooth map of the calibration, inverted |
//! | `physics` | `physics` | an elastic map with four parameters a unit, inverted |
//! | `gaussian-process` | `gaussian_process` | a regression from readings to places |
//! | `pattern-map` | `pattern_map` | a smooth map of the pattern, inverted with the errors of all units correlated |
//! | `blend` | `blend` | the weighed mean of `gaussian-process` and a map |
//! | `extra-trees` | `extra_trees` | extremely randomised trees from readings to places |
//!
//! The first three search a table (`scan`). `surrogate` and `physics` each make a `Response` (map, its error, noise), which
//! `Forward` inverts: `field` tabulates it, `descent` and `normal` refine, `threshold` gives the largest misfit
//! of a single contact. Methods without a map answer through `Appraised`. It learns the size of their errors from held-out
//! presses (`heldout`). `best` ranks all methods by these errors. `surrogate` and `gaussian-process` share `kriging`. [`fit`]
//! returns a [`Fitted`]; a [`Session`] solves one reading after another with it.
//!
//! A new method implements `Locate` in a file of its own, with a name in [`SOLVERS`], a variant of `Method` and an arm in
//! `prepared`. A [`Model`] is a fit with all data that a session needs. A sensor file stores it. [`Adapted`] makes a model from an
//! older calibration and a few new presses: changed (`adapt`), corrected (`correction`) or not used at all.
//! A [`Prior`] makes a model from few presses and the full calibrations of other sensors of the design (`prior`).
//! A [`HistoryRegression`] solves the force of a series of readings, with memories of earlier ones where they help.
//! [`vector`] solves place and force along three axes, from presses and drags; [`two`] solves two contacts at once,
//! and [`causes`] decides what a misfit means. [`over_time`] estimates time constants, noise and wear from repeated readings.

#![forbid(unsafe_code)]

mod adapt;
mod adapted;
mod appraised;
mod best;
mod blend;
mod broken;
mod by_load;
mod calibration;
pub mod causes;
mod centred;
mod chart;
mod competition;
mod correction;
mod correlation;
mod depth_curve;
mod descent;
mod design;
mod evaluation;
mod expectation;
mod extra_trees;
mod fault_search;
mod field;
mod fits;
mod fitted;
mod forces;
mod forward;
mod gaussian_process;
mod heldout;
mod history;
mod hyperparameters;
mod kriging;
mod method;
mod model;
mod nearest;
mod noise;
mod normal;
pub mod over_time;
mod pattern_map;
mod pearson;
mod physics;
mod placement;
mod plane;
mod prepared;
mod prior;
mod process;
mod rescaled;
mod response;
mod scan;
mod search_schedule;
mod session;
mod setting;
mod solution;
mod spots;
mod starts;
mod surrogate;
pub mod tables;
mod threshold;
mod tridiagonal;
pub mod two;
pub mod vector;
mod view;
mod widths;
mod workspace;

pub use adapt::{ArrayChange, UnitChange, Update};
pub use adapted::AdaptError;
pub use adapted::{Adapted, MeanErrors, TriedUpdate};
pub use broken::{Broken, OutputFault, broken};
pub use by_load::LoadGain;
pub use calibration::{Calibration, CalibrationError, CalibrationPoint};
pub use depth_curve::{DepthCurve, SEVERAL_DEPTHS};
pub use design::{DesignMap, DesignSensor, LeftOutSensor, SensorErrors, SensorPresses, leave_one_sensor_out};
pub use evaluation::{
    Coverage, ErrorSummary, Evaluation, EvaluationError, FORCE_REFERENCE_N, LOCATION_REFERENCE_MM, LeftOut, PressError,
    TestPress, UnsolvedPress, Verdicts, Within, evaluate,
};
pub use fault_search::{FaultChange, FaultSearch, FaultyUnit, SearchedFaults};
pub use fits::Fits;
pub(crate) use fits::MOST_FITS;
pub use fitted::{Choice, Fitted, Tie, TriedMethod};
pub use forces::{
    ComponentErrors, ForceEvaluation, ForceRegression, ForceTable, ForceTableError, MethodForceErrors, evaluate_forces,
};
pub use history::{
    HISTORY_METHOD, HistoryEvaluation, HistoryRegression, HistorySession, MemoryChoice, Series, SeriesError,
    evaluate_history,
};
pub use model::{Model, ModelError, Validity};
pub use pearson::{ForceRule, Pearson, correlation};
pub use placement::{Placement, PlacementError, place_array};
pub use plane::Plane;
pub use prepared::PreparedCalibration;
pub use prior::Deviations;
pub use prior::PriorError;
pub use prior::{Belongs, DesignSpread, Deviation, FamilySensor, Prior, SENSORS_LEAST};
pub use session::{MOST_PARTIAL, Session, Unanswered};
pub use setting::{ForceKnown, Setting};
pub use solution::{ContactVerdict, Covariance, Solution, SolvedDepth};
pub use widths::HalfWidths;
pub use workspace::Workspace;

pub use palpate_core::quantity::{ArrayLayout, Place};

/// Names that [`fit`] accepts; the paper's own method is first.
pub const SOLVERS: [&str; 8] =
    ["pearson", "pearson-lsq", "surrogate", "physics", "gaussian-process", "pattern-map", "blend", "extra-trees"];

/// Names of methods that are no longer there: others answer better in every scene that was tried.
pub const REMOVED: [&str; 2] = ["pearson-knn", "whitened"];

/// A fitted method.
pub trait Solver: Send + Sync {
    /// The name it goes by in [`SOLVERS`].
    fn name(&self) -> &'static str;

    /// Returns the contact that caused one reading. `outputs` holds one value for each unit, in the units and the order of the
    /// calibration.
    ///
    /// After the workspace was first used with this solver, no more memory is allocated.
    fn solve(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<Solution, SolveError>;

    /// Returns the expected error at a place, specimen frame, under a force in N. It is the Cramer-Rao bound on the map that the
    /// solver inverts, including the map's own error. `None` if there is no such map, or if the units don't determine the
    /// contact.
    fn expected(&self, _place: Place, _force_n: f64) -> Option<Covariance> {
        None
    }
}

/// Method that returns place and force. [`Appraised`] adds the uncertainty.
trait Locate: Send + Sync {
    /// The name it goes by in [`SOLVERS`].
    fn name(&self) -> &'static str;

    /// Returns the contact that caused one reading.
    fn locate(&self, outputs: &[f64], workspace: &mut Workspace) -> Result<LocatedContact, SolveError>;
}

/// A contact without its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LocatedContact {
    /// Place of the contact, specimen frame, mm.
    place: Place,
    /// Force, N.
    force_n: f64,
    /// Misfit between the reading and a contact there, in a measure of the method's own; 0 is a perfect fit.
    residue: f64,
    /// Improvement of the fit if the contact could be beyond the calibrated area, in the same measure.
    beyond: f64,
    /// Quantities to which the errors of location, mm, and of force, N, are proportional. The factor is the same for all answers
    /// of the method. The value is 1 if the method doesn't distinguish readings.
    scale_mm: f64,
    scale_n: f64,
    /// Part of these quantities' squares that is due to the error of the method's map, 0 to 1; 0 if it is unknown.
    of_map: f64,
}

impl LocatedContact {
    /// Default values for a method that gives only place, force and residue.
    const PLAIN: LocatedContact = LocatedContact {
        place: Place { x_mm: 0.0, y_mm: 0.0 },
        force_n: 0.0,
        residue: 0.0,
        beyond: 0.0,
        scale_mm: 1.0,
        scale_n: 1.0,
        of_map: 0.0,
    };
}

/// Name under which [`fit`] chooses the method itself.
pub const BEST: &str = "best";

/// Fits the method of that name, or the method that cross-validation on the calibration finds best.
///
/// Units that are dead or saturated in the calibration are excluded. Methods without a map of the array are tried on held-out
/// presses, with the force unknown to the methods. These trials give the methods' errors and the method for [`BEST`].
///
/// # Errors
/// No method has that name, the layout belongs to another array, or the method can't be fitted to the calibration.
pub fn fit(name: &str, calibration: &Calibration, setting: &Setting<'_>) -> Result<Fitted, FitError> {
    PreparedCalibration::new(calibration.clone(), setting)?.fit(name)
}

/// Reason why a method couldn't be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// No method has that name.
    #[error("unknown solver `{name}`; expected one of {BEST}, {}", SOLVERS.join(", "))]
    UnknownSolver {
        /// Requested name.
        name: String,
    },
    /// The layout belongs to another array.
    #[error("the array's layout has {layout} units, the calibration {calibration}")]
    Layout {
        /// Number of units in the layout.
        layout: usize,
        /// Number of units in the calibration.
        calibration: usize,
    },
    /// There are too few places for the method.
    #[error("the calibration has {places} places, the method requires {needed}")]
    TooFewPlaces {
        /// Number of places in the calibration.
        places: usize,
        /// Number of places required.
        needed: usize,
    },
    /// At every calibration point all units read the same, so the points can't be distinguished.
    #[error("all units have the same output at every calibration point, so the points can't be distinguished")]
    NothingToTellApart,
    /// The noise isn't suitable as a divisor.
    #[error("the noise must have one standard deviation per unit, each finite and above 0")]
    Noise,
}

/// Reason why a reading has no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// The reading comes from another array.
    #[error("the reading has {found} outputs, the calibration has {expected}")]
    Channels {
        /// Number of units in the calibration.
        expected: usize,
        /// Number of outputs in the reading.
        found: usize,
    },
    /// An output is NaN or infinite.
    #[error("output {unit} is not a finite number")]
    NotFinite {
        /// The unit, counted from 1.
        unit: usize,
    },
    /// Nothing that the array can feel touches it, so the correlation would be 0/0.
    #[error("all outputs are equal: the reading correlates with no place")]
    AllEqual,
    /// Only a force away from the specimen would give the reading.
    #[error("no press explains the reading; are the signs of the outputs reversed?")]
    NoPress,
    /// The solved force is too large for a number.
    #[error("the reading is too large for the calibration: its force is not finite")]
    OutOfProportion,
}

#[cfg(test)]
mod depth_tests;
#[cfg(test)]
mod tests;

/// The example of the README.
#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;
