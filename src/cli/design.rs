//! Sensors of a design for a person: how they differ, and their errors by the map of the others.

use super::tables::{figures, filled};
use super::text_table::{TextTable, cells};
use crate::api::{LeftOutSensors, Named};
use palpate_solver::{ArrayChange, DesignSensor, ErrorSummary, LeftOutSensor, SensorErrors, UnitChange};
use serde_json::{Value, json};

/// Most characters of a sensor's name in a table. Of a longer one its end is shown.
const NAME_MOST: usize = 20;

fn shown(name: &str) -> String {
    match name.chars().count().checked_sub(NAME_MOST) {
        None | Some(0) => name.to_owned(),
        Some(over) => format!("...{}", name.chars().skip(over + 3).collect::<String>()),
    }
}

/// Gain and displacement of a sensor.
struct MeanChange {
    gain: f64,
    gain_least: f64,
    gain_most: f64,
    x_mm: f64,
    y_mm: f64,
}

impl MeanChange {
    fn of(change: &ArrayChange) -> Self {
        let each = |of: fn(&UnitChange) -> f64| change.units.iter().map(of);
        let mean = |of| each(of).sum::<f64>() / change.units.len() as f64;
        let gains = || each(|unit| unit.gain);
        MeanChange {
            gain: mean(|unit| unit.gain),
            gain_least: gains().fold(f64::INFINITY, f64::min),
            gain_most: gains().fold(0.0, f64::max),
            x_mm: mean(|unit| unit.x_mm),
            y_mm: mean(|unit| unit.y_mm),
        }
    }
}

/// The sensors that made a map: their changes, and their errors by the map of the others.
pub(super) fn design_table(sensors: &[Named<DesignSensor>]) -> String {
    let head = ["sensor", "presses", "gain", "least", "most", "x, mm", "y, mm", "error, mm", "N"];
    let mut table = TextTable::new(1, head);
    for Named { sensor, of: DesignSensor { presses, change, by_the_others } } in sensors {
        let MeanChange { gain, gain_least, gain_most, x_mm, y_mm } = MeanChange::of(change);
        let [gain, least, most] = [gain, gain_least, gain_most].map(figures);
        let (x_mm, y_mm) = (format!("{x_mm:+.3}"), format!("{y_mm:+.3}"));
        let [location, force] = [by_the_others.location_mm, by_the_others.force_n].map(figures);
        table.row(cells![shown(sensor), presses, gain, least, most, x_mm, y_mm, location, force]);
    }
    let note = "gain (mean, and of single units) and place are relative to the mean of the sensors; errors are means, by the map of \
                the other sensors";
    format!("{table}{}", filled(note, ""))
}

/// The same content as an object.
pub(super) fn design_value(sensors: &[Named<DesignSensor>]) -> Value {
    let value = |Named { sensor, of }: &Named<DesignSensor>| {
        let MeanChange { gain, gain_least, gain_most, x_mm, y_mm } = MeanChange::of(&of.change);
        json!({
            "sensor": sensor, "presses": of.presses, "gain": gain, "gain_least": gain_least, "gain_most": gain_most,
            "x_mm": x_mm, "y_mm": y_mm, "units": of.change.units,
            "mean_error": { "location_mm": of.by_the_others.location_mm, "force_n": of.by_the_others.force_n },
        })
    };
    sensors.iter().map(value).collect()
}

/// The errors of sensors by the map of the others: those of the location, then those of the force.
pub(super) fn left_out_table(LeftOutSensors { sensors, all }: &LeftOutSensors) -> String {
    let percent = |share: f64| format!("{:.1}", 100.0 * share);
    let table = |error: &str, of: fn(&SensorErrors) -> (ErrorSummary, [f64; 2])| {
        let head = [error, "presses", "mean", "median", "p95", "in 68 %", "in 95 %", "flagged %", "own"];
        let mut table = TextTable::new(1, head);
        let mut row = |name: &str, errors: &SensorErrors, own: String| {
            let (ErrorSummary { mean, median, p95, .. }, within) = of(errors);
            let ([mean, median, p95], [in_68, in_95]) = ([mean, median, p95].map(figures), within.map(percent));
            table.row(cells![
                shown(name),
                errors.presses,
                mean,
                median,
                p95,
                in_68,
                in_95,
                percent(errors.flagged),
                own
            ]);
        };
        for Named { sensor, of: LeftOutSensor { by_the_others, by_its_own } } in sensors {
            row(sensor, by_the_others, figures(of(by_its_own).0.mean));
        }
        row("all", all, String::new());
        table.to_string()
    };
    let note = "each sensor is solved by the map of the others; `in` is the share of errors within a half-width, in %; own is the mean \
                error of the sensor's own calibration, which doesn't know the place of the press";
    let location = table("location, mm", |errors| (errors.location_error_mm, errors.location_within));
    let force = table("force, N", |errors| (errors.force_error_n, errors.force_within));
    format!("{location}\n{force}{}", filled(note, ""))
}
