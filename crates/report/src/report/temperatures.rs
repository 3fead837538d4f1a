//! Temperature coefficients of zeros and gains.

use super::Subject;
use super::frame::{Section, number, section as framed, table, words};
use maud::html;
use palpate_data::dataset::{Warmed, WarmedQuantity, warmed};
use palpate_solver::over_time::{TemperatureCoefficient, temperature_coefficient};

/// Creates a table; `None` if no temperature shows a coefficient.
pub(super) fn section(subject: &Subject) -> Option<Section> {
    let all: Vec<Warmed> = subject.runs.iter().flat_map(warmed).collect();
    let rows: Vec<_> = all
        .iter()
        .filter_map(|warmed| Some((warmed, temperature_coefficient(&warmed.points).ok()?)))
        .map(|(Warmed { monitor, quantity, points }, TemperatureCoefficient { per_c, span_c, .. })| {
            let (name, factor, digits) = match quantity {
                WarmedQuantity::ForceZero => ("zero of the load cell, mN".to_owned(), 1000.0, 2),
                WarmedQuantity::OutputZero(output) => (format!("zero of output {output}"), 1.0, 6),
                WarmedQuantity::LogGain(place) => (format!("gain at {}, {} mm, %", place.x_mm, place.y_mm), 100.0, 3),
            };
            let [from, to] = per_c.interval.map(|end| factor * end);
            vec![
                words(monitor),
                words(name),
                html! { (number("per_c", factor * per_c.value, digits, "")) (format!(" ({from:.digits$} to {to:.digits$})")) },
                words(points.len()),
                number("span_c", span_c, 2, ""),
            ]
        })
        .collect();
    let head = ["monitor", "quantity", "change for each degree", "values", "range, degrees"];
    let note = html! {
        (table(&head.map(words), &rows))
        p.note { "Each value has its temperature and a drift that is a straight line in time. The change has its 95 % interval. A temperature that "
            "only rises or only falls hardly shows it, and a thermometer that lags or is far away shows too little." }
    };
    (!rows.is_empty()).then(|| Section::from(framed("Temperature", &note)))
}
