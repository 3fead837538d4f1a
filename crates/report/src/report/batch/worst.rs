//! The sensors nearest to a limit, and the outputs that deviate most from the design.

use super::complete;
use super::limited::Limited;
use super::maps::BatchOutputs;
use crate::report::frame::{none, number, percent, section as under, table, words};
use maud::{Markup, html};
use palpate_run::batch::{Ended, History, SensorFigure};
use palpate_solver::UnitChange;

/// Number of rows of each table.
const ROWS: usize = 10;

/// Returns the section; `None` if no figure has a limit and no change is known.
pub(super) fn section(history: &History) -> Option<Markup> {
    let (limits, outputs) = (nearest(history), deviating(history));
    if limits.is_none() && outputs.is_none() {
        return None;
    }
    let body = html! {
        @if let Some(limits) = limits {
            h3 { "Nearest to a limit, or beyond it" }
            (limits)
            p.note { "Used: part of the limit that the figure uses, by its 95 % bound if the rule is guarded. Of a fraction: (1 - fraction) / (1 - limit)." }
        }
        @if let Some(outputs) = outputs {
            h3 { "Outputs that deviate most from the design" }
            (outputs)
            p.note { "Deviation: gain and displacement, each relative to its root mean square over all outputs of the batch, combined." }
        }
    };
    Some(under("Worst sensors", &body))
}

fn nearest(history: &History) -> Option<Markup> {
    let quantities = Limited::all([history]);
    let worst = |ended: &'_ Ended| -> Option<(usize, f64)> {
        let used = quantities
            .iter()
            .enumerate()
            .filter_map(|(index, quantity)| Some((index, quantity.used(quantity.found(ended)?)?)));
        used.max_by(|(_, one), (_, other)| one.total_cmp(other))
    };
    let mut all: Vec<(&Ended, usize, f64)> =
        complete(history).filter_map(|(_, ended)| worst(ended).map(|(index, used)| (ended, index, used))).collect();
    all.sort_by(|(.., one), (.., other)| other.total_cmp(one));
    let is_guarded = all.iter().take(ROWS).any(|(ended, ..)| ended.found.iter().any(|found| found.bound.is_some()));
    let row = |(ended, index, used): &(&Ended, usize, f64)| {
        let quantity = &quantities[*index];
        let found = quantity.found(ended);
        let cell = |what: &str, value: fn(&SensorFigure) -> Option<f64>| {
            let value = found.and_then(value).map(|value| quantity.displayed(value));
            value.map_or_else(none, |value| {
                number(&format!("{}.{}.{what}", ended.serial, quantity.key), value, quantity.digits(), "")
            })
        };
        let mut cells = vec![words(&ended.serial), words(quantity.label()), cell("value", |found| found.value)];
        cells.extend(is_guarded.then(|| cell("bound", |found| found.bound)));
        cells.extend([cell("limit", |found| Some(found.limit)), percent(&format!("{}.used", ended.serial), *used)]);
        cells
    };
    let bound = if is_guarded { &["95 % bound"][..] } else { &[] };
    let head = [&["sensor", "figure", "measured"], bound, &["limit", "used"]].concat();
    let head: Vec<Markup> = head.into_iter().map(words).collect();
    (!all.is_empty()).then(|| table(&head, &all.iter().take(ROWS).map(row).collect::<Vec<_>>()))
}

fn deviating(history: &History) -> Option<Markup> {
    let outputs = BatchOutputs::of(history)?;
    let (gain, moved) = (rms(&outputs, |change| change.gain - 1.0), rms(&outputs, distance_mm));
    let part = |value: f64, of: f64| if of > 0.0 { value / of } else { 0.0 };
    let deviation = |change: &UnitChange| part(change.gain - 1.0, gain).hypot(part(distance_mm(change), moved));
    let mut all: Vec<(&str, usize, &UnitChange, f64)> = Vec::new();
    for (serial, changes) in &outputs.sensors {
        all.extend((1..).zip(*changes).map(|(output, change)| (*serial, output, change, deviation(change))));
        // few are kept, for any number of sensors and outputs
        all.sort_by(|(.., one), (.., other)| other.total_cmp(one));
        all.truncate(ROWS);
    }
    let row = |(serial, output, change, deviation): &(&str, usize, &UnitChange, f64)| {
        let key = |what: &str| format!("{serial}.{output}.{what}");
        vec![
            words(serial),
            words(output),
            number(&key("gain"), 100.0 * (change.gain - 1.0), 2, ""),
            number(&key("x_mm"), change.x_mm, 3, ""),
            number(&key("y_mm"), change.y_mm, 3, ""),
            number(&key("width"), 100.0 * change.width, 2, ""),
            number(&key("deviation"), *deviation, 2, ""),
        ]
    };
    let head = ["sensor", "output", "gain, %", "x, mm", "y, mm", "width, %", "deviation"].map(words);
    Some(table(&head, &all.iter().map(row).collect::<Vec<_>>()))
}

fn distance_mm(change: &UnitChange) -> f64 {
    change.x_mm.hypot(change.y_mm)
}

fn rms(outputs: &BatchOutputs, value: impl Fn(&UnitChange) -> f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for change in outputs.sensors.iter().flat_map(|(_, changes)| *changes) {
        sum += value(change).powi(2);
        count += 1;
    }
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}
