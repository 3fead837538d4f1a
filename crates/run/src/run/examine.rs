//! Identity and speed of each device, checked without pressing.

use super::check_weight::{Ask, AxesMeasurement, KnownWeight, Weighing, WeightMeasurement, weigh};
use super::clock::RunClock;
use super::findings::Finding;
use super::home::{AtHome, at_home};
use super::monitors::Monitors;
use super::ready::{NOISE_SHARE, check_no_load};
use super::rig_control::AnyRigControl;
use super::shown::{ShownBy, finger, press};
use super::{Cancel, Halt};
use crate::rig::RigSpec;
use palpate_control::{Drift, Glitches, Permit, Reaction, Trip, Zero, ZeroLine};
use palpate_core::quantity::{Axis, ForceReading};
use palpate_data::dataset::MonitorValue;
use palpate_drivers::lines::{ForceCounts, PAGE_PORT};
use palpate_link::device::{DeviceError, Identity, LoadCell, MotionOrders, SensorArray, Stage};
use palpate_link::time::Instant;
use palpate_link::wire::{Connector, Link};

/// Number of timed exchanges with each device.
const TIMED: usize = 200;

/// Least number of readings without load for the zero, and least time for them, s.
const ZERO_READINGS: usize = 200;
const ZERO_S: f64 = 1.0;

/// Further time of readings that show the rate of the zero, s. A run corrects a rate that was read for 8 s.
const DRIFT_S: f64 = 8.0;

/// Result of an examination of a rig, without pressing.
#[derive(Debug, Default)]
pub struct Examination {
    /// Devices in the order stage, load cell, array: the identity that each reports, or the reason why it isn't usable.
    pub devices: Vec<(&'static str, Result<Identity, DeviceError>)>,
    /// Identity and value of each monitor, in the order of the rig.
    pub monitors: Vec<(Identity, MonitorValue)>,
    /// Readings of the load cell that were left out as impossible.
    pub glitches: Glitches,
    /// Values of the rig file that aren't the measured ones.
    pub findings: Vec<Finding>,
    /// Counts per N of the rig, and those that the page of its Net F/T states, or why they aren't known.
    pub counts: Option<(f64, Result<ForceCounts, String>)>,
    /// Durations of exchanges, s, in the same order. Empty for a device that isn't usable.
    pub exchanges_s: [Vec<f64>; 3],
    /// Load cell without load, or the reason why it can't be trusted.
    pub no_load: Option<Result<NoLoadCell, Trip>>,
    /// Times from a force to the braking of the stage, s: one for each pair of exchanges, conversion and lag included.
    pub reactions_s: Vec<f64>,
    /// Reaction time that a run would use.
    pub reaction: Option<Reaction>,
    /// Fastest approach that results, mm/s.
    pub approach_mm_s: Option<f64>,
    /// Result of a known weight, or the reason why there is none. `None` if no weight was requested, or if stage or load cell
    /// weren't usable.
    pub weighed: Option<Result<WeightMeasurement, Trip>>,
    /// Result of the weight along each axis, if that was requested.
    pub weighed_axes: Option<Result<AxesMeasurement, Trip>>,
    /// What has shown that the load cell measures force, or the reason why it doesn't. `None` if nothing has.
    pub shown: Option<Result<ShownBy, Trip>>,
}

/// Request to show that the load cell measures force.
#[derive(Default)]
pub enum ForceCheck<'a> {
    /// Nothing shows it.
    #[default]
    Nobody,
    /// A simulated rig presses once.
    Press,
    /// A person puts a known weight on the load cell.
    Weight(Weighing<'a>),
    /// A person presses the tip with a finger.
    Finger(&'a mut dyn FnMut(Ask)),
}

/// Load cell without load.
#[derive(Clone, Copy, Debug)]
pub struct NoLoadCell {
    /// Zero of the load cell, and its noise.
    pub zero: Zero,
    /// Rate of the zero, from more readings.
    pub drift: Drift,
    /// Number of readings.
    pub readings: usize,
    /// Fraction of the readings that differ from the reading before.
    pub fresh_share: f64,
    /// Largest standard deviation of any unit's output, V; `None` if the array failed.
    pub outputs_sigma_v: Option<f64>,
}

/// Examines a rig: identifies each device and compares it with the rig file, moves the stage home and to the clear, measures the
/// time of the links, and measures the zero. Then it has the load cell show that it measures force, if that is requested. If one
/// device fails, the others are still examined.
///
/// # Errors
/// A person requests a stop, NI's library is required and missing, a monitor fails, or a stage loses its position.
pub async fn examine(spec: &RigSpec, seed: u64, cancel: &Cancel, asked: ForceCheck<'_>) -> Result<Examination, Halt> {
    let mut rig = spec.open(seed)?;
    let (mut monitors, identities) = Monitors::ready(&mut rig, spec, cancel).await?;
    monitors.refresh(RunClock::going_on_from(0.0)).await?;
    let monitors = identities.into_iter().zip(monitors.values()).collect();
    let AtHome { mut rig_control, stage, load_cell, array } = at_home(rig, spec, cancel, &|_| {}).await?;
    let devices = vec![("stage", stage), ("load_cell", load_cell), ("array", array)];
    let mut found = Examination { devices, monitors, ..Examination::default() };
    if let (Some(counts), Link::Udp { host, .. }) = (spec.load_cell.driver.net_ft_counts(), &spec.load_cell.link) {
        let page = Connector::Real(Link::Tcp { host: host.clone(), port: PAGE_PORT });
        let stated = ForceCounts::ask(&page).await;
        found.findings.extend(stated.as_ref().ok().and_then(|stated| Finding::of_counts(counts, stated)));
        found.counts = Some((counts, stated));
    }
    look(&mut rig_control, spec, cancel, &mut found).await?;
    let is_usable = found.devices[..2].iter().all(|(_, device)| device.is_ok());
    if !is_usable || !matches!(found.no_load, Some(Ok(_))) {
        return Ok(found);
    }
    let is_quiet = found.no_load.as_ref().is_some_and(|no_load| {
        no_load.as_ref().is_ok_and(|no_load| no_load.zero.sigma_n <= NOISE_SHARE * spec.limits.force_n)
    });
    match asked {
        ForceCheck::Weight(mut weighing) => {
            let weighed = unless_halted(weigh(&mut rig_control.cell, &rig_control.truth, &mut weighing).await)?;
            found.shown = Some(weighed.as_ref().map(|_| ShownBy::Weight).map_err(Trip::clone));
            if weighing.three_axes
                && let Ok(press) = &weighed
            {
                let axes = weigh_sideways(&mut rig_control, &mut weighing, press.clone()).await;
                found.weighed_axes = Some(unless_halted(axes)?);
            }
            found.weighed = Some(weighed);
        }
        ForceCheck::Finger(ask) => {
            ask(Ask::Finger);
            let touched = unless_halted(finger(&mut rig_control.cell, spec.limits.force_n).await)?;
            found.shown = Some(touched.map(|()| ShownBy::Finger));
        }
        // with too much noise no press begins
        ForceCheck::Press if spec.is_simulated() && found.devices[2].1.is_ok() && is_quiet => {
            drop(rig_control); // the press opens the rig again
            found.shown = Some(unless_halted(press(spec, seed, cancel).await)?.map(|()| ShownBy::Press));
        }
        ForceCheck::Press | ForceCheck::Nobody => {}
    }
    Ok(found)
}

/// Weighs along x and along y, after the press.
async fn weigh_sideways(
    rig_control: &mut AnyRigControl<'_>,
    weighing: &mut Weighing<'_>,
    press: WeightMeasurement,
) -> Result<AxesMeasurement, Halt> {
    let mut along = async |along: Axis| {
        let weight = KnownWeight { along, pull: false, ..weighing.weight };
        let mut weighing = Weighing { weight, three_axes: true, ask: &mut *weighing.ask };
        weigh(&mut rig_control.cell, &rig_control.truth, &mut weighing).await
    };
    let (x, y) = (along(Axis::X).await?, along(Axis::Y).await?);
    Ok(AxesMeasurement([x, y, press]))
}

/// Separates a trip, which is a finding, from everything else that ends an examination.
fn unless_halted<T>(result: Result<T, Halt>) -> Result<Result<T, Trip>, Halt> {
    match result {
        Ok(value) => Ok(Ok(value)),
        Err(Halt::Tripped(trip)) => Ok(Err(trip)),
        Err(halt) => Err(halt),
    }
}

async fn look(
    rig_control: &mut AnyRigControl<'_>,
    spec: &RigSpec,
    cancel: &Cancel,
    found: &mut Examination,
) -> Result<(), Halt> {
    let answers: Vec<bool> = found.devices.iter().map(|(_, device)| device.is_ok()).collect();
    let mut outputs = vec![0.0; rig_control.array.units()];
    for (device, answers) in answers.iter().enumerate() {
        for _ in 0..if *answers { TIMED } else { 0 } {
            if cancel.asked() {
                return Err(Halt::Cancelled);
            }
            let asked = Instant::now();
            match device {
                0 => _ = rig_control.stage.position_mm(Axis::Z, &MotionOrders::default()).await?,
                1 => _ = rig_control.cell.cell.read().await?,
                _ => rig_control.array.read(&mut outputs).await?,
            }
            found.exchanges_s[device].push(asked.elapsed().as_secs_f64());
        }
    }
    if answers[1] {
        let no_load = without_load(rig_control, answers[2]).await?;
        found.glitches = rig_control.cell.glitches();
        found.no_load = Some(no_load.map(|(no_load, readings)| {
            found.findings.extend(Finding::of_rate(&readings, spec));
            no_load
        }));
    }
    let [stage_s, load_cell_s, _] = &found.exchanges_s;
    if let (Some(Ok(no_load)), false) = (&found.no_load, stage_s.is_empty()) {
        let (conversion_s, lag_s) = (rig_control.cell.cell.conversion().as_secs_f64(), spec.load_cell.lag_s);
        let longest = |exchanges_s: &[f64]| exchanges_s.iter().copied().fold(0.0, f64::max);
        let pairs = stage_s.iter().zip(load_cell_s);
        found.reactions_s = pairs.map(|(stage_s, cell_s)| conversion_s + lag_s + stage_s + cell_s).collect();
        let reaction = Reaction { conversion_s, load_cell_s: longest(load_cell_s), stage_s: longest(stage_s), lag_s };
        let permit = Permit::new(spec.limits, rig_control.usage.bounds(), reaction.worst_s(), &no_load.zero);
        let fastest = permit.approach_speed_mm_s(spec.limits.force_n);
        found.approach_mm_s = Some(fastest.min(spec.stage.speed_mm_s));
        found.reaction = Some(reaction);
        let passes = no_load.drift.passes(spec.limits.force_n);
        if let Err(trip) = check_no_load(&no_load.zero, spec).and(passes) {
            found.no_load = Some(Err(trip));
        }
    }
    Ok(())
}

async fn without_load(
    rig_control: &mut AnyRigControl<'_>,
    has_array: bool,
) -> Result<Result<(NoLoadCell, Vec<ForceReading>), Trip>, Halt> {
    let readings = match rig_control.cell.sound_readings(ZERO_READINGS, ZERO_S).await {
        Err(Halt::Tripped(trip)) => return Ok(Err(trip)),
        readings => readings?,
    };
    let later = match rig_control.cell.sound_readings(ZERO_READINGS, DRIFT_S).await {
        Err(Halt::Tripped(trip)) => return Ok(Err(trip)),
        later => later?,
    };
    let fresh = readings.windows(2).filter(|pair| pair[0].force_n != pair[1].force_n).count();
    let outputs_sigma_v = if has_array { Some(spread_v(&mut rig_control.array).await?) } else { None };
    let no_load = NoLoadCell {
        zero: Zero::of(&readings, rig_control.cell.cell.conversion().as_secs_f64()),
        drift: ZeroLine::of(&[readings.as_slice(), &later].concat()).drift(),
        readings: readings.len(),
        fresh_share: fresh as f64 / (readings.len() - 1) as f64,
        outputs_sigma_v,
    };
    Ok(Ok((no_load, readings)))
}

/// Returns the largest spread of any unit's output, V.
async fn spread_v<A: SensorArray>(array: &mut A) -> Result<f64, DeviceError> {
    let mut rows = Vec::with_capacity(TIMED);
    for _ in 0..TIMED {
        let mut outputs = vec![0.0; array.units()];
        array.read(&mut outputs).await?;
        rows.push(outputs);
    }
    let spread = |unit: usize| {
        let mean = rows.iter().map(|row| row[unit]).sum::<f64>() / TIMED as f64;
        let squares: f64 = rows.iter().map(|row| (row[unit] - mean).powi(2)).sum();
        (squares / (TIMED - 1) as f64).sqrt()
    };
    Ok((0..array.units()).map(spread).fold(0.0, f64::max))
}
