//! Zeros and gains of a run beside the temperature that a monitor measured.

use super::{Cycled, Recorded, RecordedContact, cycled};
use palpate_core::quantity::Place;
use palpate_solver::over_time::{CyclePoint, TemperaturePoint};

/// Largest number of outputs whose zeros are returned. Of more, only that of the output that answers most.
const MOST_OUTPUTS: usize = 16;

/// End of the name of a monitor that measures a temperature in degrees Celsius.
const CELSIUS: &str = "_c";

/// What changes with a temperature.
#[derive(Clone, Debug, PartialEq)]
pub enum WarmedQuantity {
    /// Reading of the load cell without load, N.
    ForceZero,
    /// Reading of an output without load, in the array's unit; from 1.
    OutputZero(usize),
    /// Natural logarithm of the gain of presses that were repeated at a place.
    LogGain(Place),
}

/// A quantity over a run, each value with the temperature at its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Warmed {
    /// Name of the monitor.
    pub monitor: String,
    /// The quantity.
    pub quantity: WarmedQuantity,
    /// Its values.
    pub points: Vec<TemperaturePoint>,
}

/// Returns the zeros and gains of a run, for each monitor whose name ends in `_c`.
pub fn warmed(run: &Recorded) -> Vec<Warmed> {
    let names = run.contacts.first().map(|contact| contact.monitors.as_slice()).unwrap_or_default();
    let names = names.iter().map(|monitor| monitor.name.as_str()).filter(|name| name.ends_with(CELSIUS));
    let cycles = cycled(run);
    names.flat_map(|name| beside(run, &cycles, name)).collect()
}

fn beside(run: &Recorded, cycles: &[Cycled], monitor: &str) -> Vec<Warmed> {
    let of_monitor = |contact: &RecordedContact| {
        contact.monitors.iter().find(|value| value.name == monitor).map(|value| (value.t_s, value.value))
    };
    let mut readings: Vec<(f64, f64)> = run.contacts.iter().filter_map(of_monitor).collect();
    readings.dedup();
    let point = |t_s: f64, value: f64| Some(TemperaturePoint { t_s, temperature_c: at(&readings, t_s)?, value });
    let of_contacts = |value: &dyn Fn(&RecordedContact) -> Option<f64>| -> Vec<TemperaturePoint> {
        let of_contact = |contact: &RecordedContact| point(contact.levels.first()?.t_s?, value(contact)?);
        run.contacts.iter().filter_map(of_contact).collect()
    };
    let of_cycles = |points: &mut dyn Iterator<Item = &CyclePoint>| -> Vec<TemperaturePoint> {
        points.filter_map(|cycle| point(cycle.t_s, cycle.log_gain)).collect()
    };
    let warmed = |quantity, points| Warmed { monitor: monitor.to_owned(), quantity, points };
    let forces = of_contacts(&|contact| Some(contact.no_load_before.force.mean_n));
    let mut all = vec![warmed(WarmedQuantity::ForceZero, forces)];
    for output in outputs(run) {
        let zeros = of_contacts(&|contact| contact.no_load_before.outputs.get(output).copied());
        all.push(warmed(WarmedQuantity::OutputZero(output + 1), zeros));
    }
    if let Some(Cycled { points, reference, .. }) = cycles.first() {
        let mut of_reference = points.iter().filter(|point| point.is_reference);
        all.push(warmed(WarmedQuantity::LogGain(*reference), of_cycles(&mut of_reference)));
    }
    for Cycled { points, place, .. } in cycles {
        let mut own = points.iter().filter(|point| !point.is_reference);
        all.push(warmed(WarmedQuantity::LogGain(*place), of_cycles(&mut own)));
    }
    all
}

/// Returns the temperature at a time, between the readings before and after it; `None` outside all readings.
fn at(readings: &[(f64, f64)], t_s: f64) -> Option<f64> {
    let next = readings.partition_point(|(at_s, _)| *at_s <= t_s);
    let (from_s, from_c) = readings[next.checked_sub(1)?];
    let (to_s, to_c) = *readings.get(next)?;
    Some(from_c + (to_c - from_c) * (t_s - from_s) / (to_s - from_s))
}

/// Returns the outputs whose zeros are of interest.
fn outputs(run: &Recorded) -> Vec<usize> {
    let levels = || run.contacts.iter().flat_map(|contact| &contact.levels);
    let count = levels().map(|press| press.outputs.len()).next().unwrap_or(0);
    if count <= MOST_OUTPUTS {
        return (0..count).collect();
    }
    let size = |output: &usize| {
        levels().filter_map(|press| press.outputs.get(*output)).fold(0.0, |most: f64, value| most.max(value.abs()))
    };
    (0..count).max_by(|a, b| size(a).total_cmp(&size(b))).into_iter().collect()
}
