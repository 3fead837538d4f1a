//! Proof that the load cell measures force: a known weight, a finger on the tip, or a press of a simulated rig.

use super::execute::{Listener, RunJob, execute};
use super::watched_cell::WatchedLoadCell;
use super::{Cancel, Halt, align_plan};
use crate::rig::RigSpec;
use palpate_control::{SafetyRule, Trip, Zero};
use palpate_data::dataset::Memory;
use palpate_link::device::LoadCell;
use palpate_link::time::Instant;
use std::time::Duration;

/// Longest wait for a finger on the tip.
pub const FINGER_WAIT: Duration = Duration::from_secs(20);

/// Readings of one look, and least time for them, s.
const READINGS: usize = 10;
const LOOK_S: f64 = 0.1;

/// Least force of a finger, as a fraction of the force limit, and in sd of a look.
const FINGER_SHARE: f64 = 0.02;
const FINGER_SIGMAS: f64 = 10.0;

/// What has shown that the load cell measures force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShownBy {
    /// A known weight.
    Weight,
    /// A finger on the tip.
    Finger,
    /// A press of a simulated rig.
    Press,
}

/// Waits until a finger presses the tip.
///
/// # Errors
/// The cell fails, reads a push as a pull, or shows nothing in time.
pub(super) async fn finger<C: LoadCell>(watched_cell: &mut WatchedLoadCell<'_, C>, limit_n: f64) -> Result<(), Halt> {
    let conversion_s = watched_cell.cell.conversion().as_secs_f64();
    let zero = Zero::of(&watched_cell.sound_readings(READINGS, LOOK_S).await?, conversion_s);
    let least_n = (FINGER_SHARE * limit_n).max(FINGER_SIGMAS * zero.offset_sigma_n);
    let began = Instant::now();
    let mut most_n = 0.0f64;
    while began.elapsed() < FINGER_WAIT {
        let readings = watched_cell.sound_readings(READINGS, LOOK_S).await?;
        let force_n = Zero::of(&readings, conversion_s).offset_n - zero.offset_n;
        if force_n > least_n {
            return Ok(());
        }
        if force_n < -least_n {
            return Err(Trip::new(SafetyRule::WrongSign, force_n, -least_n, "N").into());
        }
        most_n = most_n.max(force_n);
    }
    Err(Trip::new(SafetyRule::NoResponse, most_n, least_n, "N").into())
}

struct Silent;

impl Listener for Silent {}

/// Presses once on a simulated rig.
///
/// # Errors
/// The reason why the press ended early.
pub(super) async fn press(spec: &RigSpec, seed: u64, cancel: &Cancel) -> Result<(), Halt> {
    let Ok(mut plan) = align_plan(spec, seed) else { return Ok(()) };
    plan.entries.truncate(1);
    let mut ledger = Memory::default();
    let ending = execute(RunJob { plan: &plan, spec, ledger: &mut ledger, cancel, shown: &|_| {} }, &mut Silent).await;
    ending.halt.or(ending.unparked).map_or(Ok(()), Err)
}
