//! Finds the real position and tilt of the specimen: presses around its expected position, and evaluates the results.

use super::Cancel;
use super::execute::{Ending, Listener, RunJob, execute};
use crate::rig::RigSpec;
use palpate_core::quantity::{Frame, Place, TILT_MOST_DEG, Tilt};
use palpate_data::dataset::{Memory, Press};
use palpate_data::recipe::{Manner, Phase, Places, Plan, Recipe, Step, StepLoad};
use palpate_document::Problems;
use palpate_solver::{Calibration, CalibrationError, CalibrationPoint, Placement, PlacementError, Plane, place_array};

/// Number of presses along each edge of the array.
const PRESSES_A_SIDE: usize = 5;

/// Force of the presses, as a fraction of the specimen's force limit. Errors of units are a fraction of their full scale, so a
/// light press would give poor results.
const FORCE_SHARE: f64 = 0.5;

/// Least half of the pressed area's side, mm.
const HALF_LEAST_MM: f64 = 1.0;

/// Ratio of the area that is pressed later to the extent of the units (PAPER S8: 6 mm for 4.5).
const LATER_SHARE: f64 = 4.0 / 3.0;

/// Allowance for the scatter of the surface about the plane, sd, and for its unknown part, mm.
const SURFACE_SIGMAS: f64 = 5.0;
const SURFACE_LEAST_MM: f64 = 0.02;

/// Real position of a specimen, and its uncertainty.
#[derive(Clone, Copy, Debug)]
pub struct Alignment {
    /// Resulting frame: origin, rotation, tilt, surface and the surface's uncertainty.
    pub frame: Frame,
    /// Array in the frame that was assumed before.
    pub placement: Placement,
    /// Surface at the new origin in the frame that was assumed before, mm into the specimen.
    pub surface_mm: f64,
    /// Standard deviation of the slope of the surface, mm/mm.
    pub tilt_sigma: f64,
    /// Rise of the surface's plane over the pressed area, from its middle, mm.
    pub tilt_mm: f64,
    /// Standard deviation of one touch about the plane, mm.
    pub touch_sigma_mm: f64,
    /// Number of presses used.
    pub presses: usize,
}

/// Reason why a specimen's place can't be found.
#[derive(Debug, thiserror::Error)]
pub enum AlignError {
    /// The presses can't be made on this rig.
    #[error("the presses required to locate the array don't fit the rig")]
    Plan(#[source] Problems),
    /// The run ended early.
    #[error("the presses ended early")]
    Halted(Box<Ending>),
    /// A press gave no usable data.
    #[error("a press can't be used: {0}")]
    Press(#[from] CalibrationError),
    /// The fit is poor.
    #[error("can't locate the array: {0}")]
    Placement(#[from] PlacementError),
    /// The touches don't form a plane.
    #[error("the touched points don't fit a plane")]
    Surface,
    /// The surface isn't level enough.
    #[error(
        "the surface is tilted by {:.2} degrees, +-{sigma_deg:.2}, deeper toward {:.0} degrees from x toward y; at most \
         {TILT_MOST_DEG} degrees are allowed: shim the specimen and align again",
        tilt.degrees(), tilt.direction_deg()
    )]
    Tilted {
        /// Tilt that was found, in the specimen frame.
        tilt: Tilt,
        /// Standard deviation of the angle, degrees.
        sigma_deg: f64,
    },
}

impl Alignment {
    /// Returns the standard deviation of the tilt, degrees.
    pub fn tilt_sigma_deg(&self) -> f64 {
        sigma_deg(&self.frame.tilt, self.tilt_sigma)
    }
}

/// Returns the standard deviation of a tilt's angle, degrees, from that of its slope.
fn sigma_deg(tilt: &Tilt, sigma: f64) -> f64 {
    (sigma * tilt.cosine().powi(2)).to_degrees()
}

/// Presses around the expected position of the array. The touches show the position of its surface, and its outputs show the
/// position of the array itself.
///
/// # Errors
/// Anything that prevents an answer; a poor fit is an error too.
pub async fn align(
    spec: &RigSpec,
    seed: u64,
    cancel: &Cancel,
    listener: &mut dyn Listener,
) -> Result<Alignment, AlignError> {
    let plan = plan(spec, seed).map_err(AlignError::Plan)?;
    let mut ledger = Memory::default();
    let ending = execute(RunJob { plan: &plan, spec, ledger: &mut ledger, cancel, shown: &|_| {} }, listener).await;
    if ending.halt.is_some() || ending.unparked.is_some() {
        return Err(AlignError::Halted(Box::new(ending)));
    }
    let presses: Vec<&Press> =
        ledger.contacts().flat_map(|contact| &contact.levels).filter(|press| !press.is_flagged()).collect();
    found(spec, &presses)
}

/// Returns the presses, so that a person sees them before they start.
///
/// # Errors
/// The presses don't fit the rig.
pub fn plan(spec: &RigSpec, seed: u64) -> Result<Plan, Problems> {
    let half = half_mm(spec);
    let force_n = FORCE_SHARE * spec.limits.force_n;
    let along = |n: usize| 2.0 * n as f64 / (PRESSES_A_SIDE - 1) as f64 - 1.0;
    let rounded = |mm: f64| (mm * 1e4).round() / 1e4;
    let place = |n| {
        let (column, row) = (n % PRESSES_A_SIDE, n / PRESSES_A_SIDE);
        (Place::new(rounded(along(column) * half.0), rounded(along(row) * half.1)), 0..0)
    };
    let places = (0..PRESSES_A_SIDE * PRESSES_A_SIDE).map(place).collect();
    let paper = Manner::PAPER;
    let manner = Manner { force_tolerance_n: paper.force_tolerance_n.min(force_n / 2.0), ..paper };
    let step = Step::new(Phase::Calibration, Places::List(places), StepLoad::Force(force_n), manner);
    Plan::new(&Recipe::new("align", vec![step]), &spec.ground(), seed)
}

fn found(spec: &RigSpec, presses: &[&Press]) -> Result<Alignment, AlignError> {
    let points: Vec<CalibrationPoint> = presses
        .iter()
        .filter_map(|press| {
            Some(CalibrationPoint { place: press.place(), force_n: press.force_n?, outputs: &press.outputs })
        })
        .collect();
    let placement = place_array(&Calibration::new(&points)?, &spec.array.layout)?;
    let touched: Vec<(Place, f64)> =
        presses.iter().filter_map(|press| Some((press.place(), touched_mm(spec, press)?))).collect();
    let plane = Plane::through(&touched).ok_or(AlignError::Surface)?;
    let Plane { tilt: Tilt { per_x, per_y }, scatter_mm: touch_sigma_mm, tilt_sigma, .. } = plane;
    let surface_mm = plane.at_mm(placement.origin);
    let (half_x, half_y) = half_mm(spec);
    let tilt_mm = LATER_SHARE * (per_x.abs() * half_x + per_y.abs() * half_y);
    let uncertainty_mm = tilt_mm + SURFACE_SIGMAS * touch_sigma_mm + SURFACE_LEAST_MM;
    let moved = spec.frame.moved(placement.origin, placement.rotation_deg, surface_mm);
    let tilt = plane.tilt.in_frame_turned(placement.rotation_deg);
    if !tilt.is_allowed() {
        return Err(AlignError::Tilted { tilt, sigma_deg: sigma_deg(&tilt, tilt_sigma) });
    }
    let frame = Frame { uncertainty_mm, tilt, ..moved };
    Ok(Alignment { frame, placement, surface_mm, tilt_sigma, tilt_mm, touch_sigma_mm, presses: presses.len() })
}

/// Returns the z at which a press touched the surface, specimen frame, mm. The row has its depth along the surface's normal.
fn touched_mm(spec: &RigSpec, press: &Press) -> Option<f64> {
    Some(spec.frame.z_from_stage(press.z_mm?) - spec.frame.tilt.along_z_mm(press.depth_mm?))
}

/// Half of the sides of the box around the units, mm.
fn half_mm(spec: &RigSpec) -> (f64, f64) {
    let half = |along: fn(&Place) -> f64| {
        let all = spec.array.layout.places().iter().map(along);
        let (least, most) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        ((most - least) / 2.0).max(HALF_LEAST_MM)
    };
    (half(|place| place.x_mm), half(|place| place.y_mm))
}
