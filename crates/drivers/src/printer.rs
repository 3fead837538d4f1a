//! What printers have in common: their settings beside the rig's, a zero to which a person brings the axes, and lines of G-code.

use palpate_core::quantity::Axis;
use palpate_link::device::StageUse;

/// Longest piece of a nudge, mm. It can't be stopped.
const NUDGE_PIECE_MM: f64 = 0.05;

/// Largest count of an axis at its zero, mm, where a person brought it.
const ZERO_MOST_MM: f64 = 0.5;

/// Largest difference between a step that the rig states and that of the printer, as a fraction.
const STEP_DIFFERENCE: f64 = 1e-3;

/// Compares a step of the printer, by one of its settings, with the rig's.
///
/// # Errors
/// What to change.
pub(crate) fn check_step(axis: Axis, step_mm: f64, setting: &str, usage: &StageUse) -> Result<(), String> {
    let (name, stated_mm) = (axis.name(), usage.steps.along(axis));
    // a fine stage is in position within 3 um, which is more than half a step
    let is_same = match stated_mm > 0.0 {
        true => (stated_mm / step_mm - 1.0).abs() <= STEP_DIFFERENCE,
        false => step_mm / 2.0 <= usage.steps.in_position_mm(axis),
    };
    if is_same {
        return Ok(());
    }
    Err(format!(
        "a step of {name} is {step_mm:.6} mm by {setting}, the rig states {stated_mm} mm; write `step_mm.{name} = {step_mm:.6}` in [stage] if \
         the printer is set correctly"
    ))
}

/// Checks that a person brings the axes to their zero.
///
/// # Errors
/// What to write.
pub(crate) fn check_by_hand(usage: &StageUse) -> Result<(), String> {
    match usage.by_hand {
        true => Ok(()),
        false => Err("a search for home can't be stopped: write `home = \"by hand\"` in [stage]".to_owned()),
    }
}

/// Returns an axis that counts too much for one at its zero, and its count, mm.
pub(crate) fn off_zero(counts_mm: [f64; 3]) -> Option<(Axis, f64)> {
    let counts = Axis::ALL.map(|axis| (axis, counts_mm[axis.index()]));
    counts.into_iter().find(|(_, count_mm)| count_mm.abs() > ZERO_MOST_MM)
}

/// Returns the number of pieces of a nudge, and their length, mm.
pub(crate) fn pieces_of(way_mm: f64) -> (u32, f64) {
    let pieces = (way_mm / NUDGE_PIECE_MM).ceil().max(1.0);
    (pieces as u32, way_mm / pieces)
}

/// Returns the feed along the path at which the fastest axis moves at a speed, mm/min.
pub(crate) fn feed_mm_min(by_mm: impl IntoIterator<Item = f64>, speed_mm_s: f64) -> f64 {
    let (whole, longest) =
        by_mm.into_iter().fold((0.0f64, 0.0f64), |(whole, longest), way| (whole.hypot(way), longest.max(way.abs())));
    let stretch = if longest > 0.0 { whole / longest } else { 1.0 };
    speed_mm_s * stretch * 60.0
}
