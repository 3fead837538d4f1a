//! What a run measured over time: levels that were followed, and presses that were repeated.

use super::Recorded;
#[cfg(feature = "files")]
use super::{DatasetError, FollowedTime, RecordedSeries};
use crate::recipe::Phase;
use palpate_core::quantity::Place;
use palpate_solver::over_time::CyclePoint;

/// A level that was followed over time: the readings of the load cell, and of the output that answers it most.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    /// Number of the press in the plan.
    pub press: u64,
    /// Creep, rest, ramp or wave.
    pub phase: Phase,
    /// Place of the press.
    pub place: Place,
    /// Speed of a ramp, mm/s, positive into the specimen; `None` at rest.
    pub speed_mm_s: Option<f64>,
    /// Whether the force was restored; otherwise z rested.
    pub holds_force: bool,
    /// The output, from 1.
    pub output: usize,
    /// Times of the forces, s since the level began to be followed, and the forces, N.
    pub force_n: [Vec<f64>; 2],
    /// Times of the output, s, and its values in the array's unit.
    pub values: [Vec<f64>; 2],
}

/// Presses that were repeated at one place, with those at the reference place.
#[derive(Clone, Debug, PartialEq)]
pub struct Cycled {
    /// The place.
    pub place: Place,
    /// The reference place.
    pub reference: Place,
    /// A point for each press: of the place itself, and of the reference place.
    pub points: Vec<CyclePoint>,
}

/// A place of the phase cycles: its first outputs, its number of presses, and those whose gain is known.
struct PressedPlace {
    place: Place,
    first: Vec<f64>,
    presses: u32,
    points: Vec<CyclePoint>,
}

/// Reads the levels of a run that were followed, in the order of their presses. Runs without readings have none.
///
/// # Errors
/// The file of readings can't be read.
#[cfg(feature = "files")]
pub fn followed(run: &Recorded) -> Result<Vec<Followed>, DatasetError> {
    let Some(mark) = &run.series else { return Ok(Vec::new()) };
    let mut all: Vec<(Followed, [f64; 2])> = run.contacts.iter().flat_map(|contact| begun(run, contact)).collect();
    if all.is_empty() {
        return Ok(Vec::new());
    }
    all.sort_by_key(|(followed, _)| followed.press);
    let series = RecordedSeries::open(&run.path, mark.bytes)?;
    let names: Vec<&str> = series.columns().iter().skip(1).map(|column| column.name.as_str()).collect();
    let at = |name: &str| names.iter().position(|column| *column == name).unwrap_or_default();
    let (t_s, taken_s, force_n, out_1) = (at("t_s"), at("taken_s"), at("force_n"), at("out_1"));
    for batch in series {
        let batch = batch?;
        for (row, press) in batch.press.iter().enumerate() {
            let number = |column: usize| batch.numbers[column][row];
            let before = all.partition_point(|(followed, _)| (followed.press as i64) < *press);
            let mut of_press = all[before..].iter_mut().take_while(|(followed, _)| followed.press as i64 == *press);
            let is_in = |(_, [from_s, to_s]): &&mut (Followed, [f64; 2])| (*from_s..=*to_s).contains(&number(t_s));
            let Some((followed, [from_s, _])) = of_press.find(is_in) else { continue };
            let output = out_1 + followed.output - 1;
            let read = [(&mut followed.force_n, taken_s, force_n), (&mut followed.values, t_s, output)];
            for ([times, values], time, value) in read {
                if !number(value).is_nan() {
                    times.push(number(time) - *from_s);
                    values.push(number(value));
                }
            }
        }
    }
    Ok(all.into_iter().map(|(followed, _)| followed).collect())
}

/// Returns what was followed of a contact without its readings, and the times.
#[cfg(feature = "files")]
fn begun(run: &Recorded, contact: &super::RecordedContact) -> Vec<(Followed, [f64; 2])> {
    let Some((last, phase)) = contact.levels.last().and_then(|last| Some((last, last.phase?))) else {
        return Vec::new();
    };
    let loudest = |outputs: &[f64]| {
        let all = outputs.iter().enumerate().filter(|(_, output)| !output.is_nan());
        all.max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs())).map_or((0, 0.0), |(index, value)| (index, value.abs()))
    };
    // without load, the output that answers most in the rest of the run
    let contacts = if phase == Phase::Rest { run.contacts.as_slice() } else { std::slice::from_ref(contact) };
    let each = contacts.iter().flat_map(|contact| &contact.levels).map(|press| loudest(&press.outputs));
    let (output, _) = each.max_by(|(_, a), (_, b)| a.total_cmp(b)).unwrap_or_default();
    let empty = || [Vec::new(), Vec::new()];
    let each = contact.followed.iter().map(|time| {
        let (press, place, output) = (contact.press, last.place(), output + 1);
        let FollowedTime { speed_mm_s, holds_force, .. } = *time;
        let followed =
            Followed { press, phase, place, speed_mm_s, holds_force, output, force_n: empty(), values: empty() };
        (followed, [time.from_s, time.to_s])
    });
    each.collect()
}

/// Returns the places that a run pressed many times, each with its presses in the order of measurement. The gain of a press is the size of
/// its outputs along those of the first press at its place, for each newton.
pub fn cycled(run: &Recorded) -> Vec<Cycled> {
    let mut places: Vec<PressedPlace> = Vec::new();
    for press in run.contacts.iter().flat_map(|contact| &contact.levels).filter(|press| press.is_of(Phase::Cycles)) {
        let (Some(force_n), Some(t_s)) = (press.force_n, press.t_s) else { continue };
        let known = places.iter().position(|known| known.place == press.place());
        let index = known.unwrap_or_else(|| {
            places.push(PressedPlace {
                place: press.place(),
                first: press.outputs.clone(),
                presses: 0,
                points: Vec::new(),
            });
            places.len() - 1
        });
        let PressedPlace { first, presses, points, .. } = &mut places[index];
        let along: f64 = first.iter().zip(&press.outputs).map(|(first, output)| first * output).sum();
        let gain = along / first.iter().map(|first| first * first).sum::<f64>() / force_n;
        if gain > 0.0 && !press.is_flagged() {
            // a step presses its reference place first
            let (cycle, is_reference) = (f64::from(*presses), index == 0);
            points.push(CyclePoint { cycle, t_s, log_gain: gain.ln(), is_reference });
        }
        *presses += 1;
    }
    let Some((reference, others)) = places.split_first() else { return Vec::new() };
    let with_reference = |other: &PressedPlace| {
        let mut points = [other.points.as_slice(), &reference.points].concat();
        points.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        Cycled { place: other.place, reference: reference.place, points }
    };
    others.iter().map(with_reference).collect()
}
