//! Batches as a bench would record them: random results of many sensors, in a real batch folder.

use palpate_core::quantity::stream;
use palpate_data::acceptance::SensorVerdict;
use palpate_data::dataset::{RecordedText, Status};
use palpate_run::batch::{
    Alarm, BATCH_FORMAT, BatchEvent, BatchFolder, BatchSession, Began, Cause, Charted, Ended, Facts, ReferenceSensor,
    SensorFigure, beginning,
};
use palpate_solver::UnitChange;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use std::path::Path;

/// A batch to be made.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    pub name: &'static str,
    pub sensors: usize,
    /// Outputs with a change relative to the design; 0 without a prior.
    pub outputs: usize,
    /// Sensors between two measurements of the reference sensor; 0 without one.
    pub every: usize,
    /// Whether the rule is guarded.
    pub guarded: bool,
    /// Change of the bench with each sensor, in standard deviations of the sensors.
    pub drift: f64,
    pub seed: u64,
}

/// A month of a small producer.
pub const MONTH: Drawn =
    Drawn { name: "june", sensors: 120, outputs: 9, every: 10, guarded: true, drift: 0.03, seed: 1 };

/// Sensors a day.
const A_DAY: usize = 40;

/// The limits of the random figures.
pub const LOCATION_MM: f64 = 0.6;
pub const WITHIN: f64 = 0.9;

/// Writes the batch, and returns its events.
pub fn write(path: &Path, drawn: &Drawn, rig: &str) -> Vec<BatchEvent> {
    let events = events(drawn, rig);
    drop(BatchFolder::create(path, drawn.name, &events).expect("a batch"));
    events
}

/// Normal values of the means over the outputs.
fn charted(outputs: usize) -> Vec<Charted> {
    let of = |(name, mean, sd): (&str, f64, f64)| {
        let (quantity, sd) = (name.to_owned(), sd / (outputs as f64).sqrt());
        Charted { quantity, mean, sd, reference_sd: 0.2 * sd, sensors: 5 }
    };
    [("mean gain", 1.0, 0.05), ("mean width", 0.0, 0.02)].map(of).to_vec()
}

/// Number, from 1, of the sensor with the incident.
const TRIPPED: usize = 7;
const REPEATED: usize = 4;
const SKIPPED: usize = 9;

pub fn events(drawn: &Drawn, rig: &str) -> Vec<BatchEvent> {
    let mut rng = stream(drawn.seed, 0, "drawn batch");
    let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
    let reference =
        (drawn.every > 0).then(|| ReferenceSensor { serial: "REF-1".to_owned(), every: drawn.every as u64 });
    let facts = Facts {
        format: BATCH_FORMAT,
        name: drawn.name.to_owned(),
        at: time(0),
        design: "skin-3x3".to_owned(),
        charted: if drawn.outputs > 0 { charted(drawn.outputs) } else { Vec::new() },
        reference,
        simulated: true,
        ..Facts::default()
    };
    let serials: Vec<String> = (1..=drawn.sensors).map(|number| format!("S-{number:05}")).collect();
    let session = BatchSession {
        at: time(0),
        version: "0.0.0".to_owned(),
        bench: "bench-2".to_owned(),
        operator: Some("Ada <b>".to_owned()),
    };
    let texts = [RecordedText { name: "rig.toml".to_owned(), text: rig.to_owned() }];
    let mut events = beginning(facts, &texts, &serials, session);
    for (index, serial) in serials.iter().enumerate() {
        let number = index + 1;
        let shift = drawn.drift * number as f64;
        if drawn.every > 0 && index.is_multiple_of(drawn.every) {
            let values = [shift + 0.2 * normal(), 0.2 * normal()];
            push(&mut events, number, ended("REF-1", number, values, drawn, &mut normal));
            if number > 1 && shift.abs() > 3.0 {
                events.push(BatchEvent::Alarm(Alarm {
                    at: time(number),
                    serial: "REF-1".to_owned(),
                    cause: Cause::Bench,
                    quantity: "mean gain".to_owned(),
                    sigmas: shift,
                    limit: 2.9,
                }));
            }
        }
        let values = [shift + normal(), normal()];
        let mut result = ended(serial, number, values, drawn, &mut normal);
        if number == SKIPPED {
            events.push(BatchEvent::Skipped { at: time(number), serial: serial.clone() });
            continue;
        }
        if number == TRIPPED {
            result = Ended {
                status: Status::Tripped,
                verdict: None,
                reasons: vec!["over-force: 4.2 N".to_owned()],
                found: Vec::new(),
                change: Vec::new(),
                ..result
            };
        }
        if number == REPEATED {
            push(&mut events, number, result.clone());
            events.push(BatchEvent::Retry { at: time(number), serial: serial.clone() });
        }
        push(&mut events, number, result);
    }
    events
}

fn push(events: &mut Vec<BatchEvent>, number: usize, ended: Ended) {
    events.push(BatchEvent::Began(Began {
        at: time(number),
        serial: ended.serial.clone(),
        reference: ended.reference,
        nest: None,
        run: ended.runs[0].clone(),
    }));
    events.push(BatchEvent::Ended(ended));
}

fn ended(serial: &str, number: usize, values: [f64; 2], drawn: &Drawn, normal: &mut impl FnMut() -> f64) -> Ended {
    let is_reference = serial.starts_with("REF");
    let (location_mm, within) = (0.45 + 0.05 * values[0], (0.96 + 0.02 * values[1]).clamp(0.0, 1.0));
    let verdict = |is_within: bool| if is_within { SensorVerdict::Accepted } else { SensorVerdict::NotAccepted };
    let bound = drawn.guarded.then_some(location_mm + 0.04);
    let found = vec![
        SensorFigure {
            figure: "location_mean_mm".to_owned(),
            value: Some(location_mm),
            bound,
            limit: LOCATION_MM,
            verdict: verdict(bound.unwrap_or(location_mm) <= LOCATION_MM),
        },
        SensorFigure {
            figure: "location_within".to_owned(),
            value: Some(within),
            bound: drawn.guarded.then_some(within - 0.02),
            limit: WITHIN,
            verdict: verdict(within >= WITHIN),
        },
    ];
    let all = verdict(found.iter().all(|found| found.verdict == SensorVerdict::Accepted));
    // the reference sensor is the same each time
    let part = if is_reference { 0.2 } else { 1.0 };
    let mut change = || UnitChange {
        gain: 1.0 + 0.05 * part * normal(),
        x_mm: 0.04 + 0.1 * part * normal(),
        y_mm: 0.1 * part * normal(),
        width: 0.02 * part * normal(),
    };
    let change: Vec<UnitChange> = (0..drawn.outputs).map(|_| change()).collect();
    Ended {
        at: time(number),
        serial: serial.to_owned(),
        reference: is_reference,
        runs: vec![format!("runs/{serial}")],
        status: Status::Complete,
        verdict: (!is_reference).then_some(all),
        reasons: if all == SensorVerdict::Accepted { Vec::new() } else { vec!["beyond the limit".to_owned()] },
        found,
        calibration_presses: 25,
        test_presses: 20,
        minutes: 9.0 + 0.5 * normal().abs(),
        change,
        refused: false,
        model: None,
    }
}

/// A time on a working day from 1 June 2026 on.
fn time(number: usize) -> String {
    let (day, of_day) = (number / A_DAY, number % A_DAY);
    let (month, date) = (6 + day / 28 % 7, 1 + day % 28);
    let year = 2026 + day / (28 * 7);
    format!("{year}-{month:02}-{date:02}T{:02}:{:02}:00+02:00[Europe/Berlin]", 8 + of_day / 6, of_day % 6 * 10)
}
