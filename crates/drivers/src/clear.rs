//! The way up of z before x or y search for home.

use palpate_core::quantity::{Axis, seconds};
use palpate_link::device::{AxisWay, DeviceError, DeviceProblem, MotionOrders, Stage, StageUse};

/// What a motion of [`clear_z`] is called in messages.
pub(crate) const CLEARING_Z: &str = "moving z away from the specimen";

/// Distance from the end of its travel to which z goes, mm: the end is the controller's own limit, and a rounding leads beyond it.
const SHORT_MM: f64 = 0.005;

/// Largest distance of z from the end of its travel at which it counts as away, mm.
const AWAY_MM: f64 = 0.01;

/// Moves z to the end of its travel that is away from the specimen: it may already be homed and in contact. Returns why nothing may move
/// sideways.
pub(crate) async fn clear_z(
    stage: &mut impl Stage,
    usage: &StageUse,
    orders: &MotionOrders,
) -> Result<Option<DeviceProblem>, DeviceError> {
    let at_mm = stage.position_mm(Axis::Z, orders).await?;
    let end_mm = usage.travel.along(Axis::Z).end(usage.away) - usage.away * SHORT_MM;
    let is_there = (at_mm - end_mm).abs() <= AWAY_MM;
    // a motion of 0 too, so that a controller that refuses it is noticed
    let way = AxisWay::between(Axis::Z, at_mm, if is_there { at_mm } else { end_mm });
    stage.send(&[way], usage.home_speed_mm_s, usage, orders).await?; // it may not be prepared yet
    stage.follow(&[Axis::Z], seconds(way.by_mm.abs() / usage.home_speed_mm_s), orders).await?;
    let at_mm = stage.position_mm(Axis::Z, &MotionOrders::default()).await?;
    // written as the positive condition, so NaN fails
    let is_away = (at_mm - end_mm).abs() <= AWAY_MM;
    Ok((!is_away).then(|| DeviceProblem::Motion(format!("z was commanded to {end_mm:.4} mm but is at {at_mm:.4} mm"))))
}
