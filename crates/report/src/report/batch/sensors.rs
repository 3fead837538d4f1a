//! Tables of sensors: those that aren't accepted, and all.

use super::limited::Limited;
use crate::report::frame::{clock, counted, none, number, section as under, words};
use maud::{Markup, html};
use palpate_run::batch::{BatchSensor, Ended, History, SensorState};
use std::collections::HashMap;

/// A page about a sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageLink {
    /// Its name for the reader.
    pub name: &'static str,
    /// Its address, relative to the page.
    pub href: String,
}

/// Largest number of sensors that are listed before the table of all, and of reasons for each.
const LISTED_MOST: usize = 20;
const REASONS_MOST: usize = 3;

/// Returns the name of a standing as a key.
pub(super) fn key(sensor_state: SensorState) -> String {
    sensor_state.name().replace(' ', "-")
}

/// Lists the sensors that ended otherwise than accepted, now or before, with the reasons. `None` if there are none.
pub(super) fn conspicuous(history: &History, links: &dyn Fn(&Ended) -> Vec<PageLink>) -> Option<Markup> {
    let is_expected =
        |end: &SensorState| matches!(end, SensorState::Accepted | SensorState::Calibrated | SensorState::Waiting);
    let is_listed = |item: &&BatchSensor| !item.ends.iter().chain([&item.sensor_state]).all(is_expected);
    let results = by_serial(history);
    let all: Vec<&BatchSensor> = history.state.items.iter().filter(is_listed).collect();
    let rest = all.len().saturating_sub(LISTED_MOST);
    let body = html! {
        div.wide {
            table {
                thead { tr { th scope="col" { "sensor" } th.words scope="col" { "result" } th.words scope="col" { "reasons" } } }
                tbody {
                    @for item in all.iter().take(LISTED_MOST) {
                        @let ended = results.get(item.serial.as_str()).copied();
                        tr {
                            th scope="row" { (linked(&item.serial, ended, links)) }
                            td.words { (result(item)) }
                            td.words { (reasons(item, ended)) }
                        }
                    }
                }
            }
        }
        @if rest > 0 { p.note { (counted(rest, "further sensor")) " in the table of all sensors." } }
    };
    (!all.is_empty()).then(|| under("Sensors that aren't accepted, or weren't at first", &body))
}

/// What became of a sensor, this time and the times before.
fn result(item: &BatchSensor) -> Markup {
    html! {
        (item.sensor_state.name())
        @if let Some(before) = item.before() { " (" (before) ")" }
    }
}

fn reasons(item: &BatchSensor, ended: Option<&Ended>) -> Markup {
    let reasons = ended.map(|ended| ended.reasons.as_slice()).unwrap_or_default();
    html! {
        @for (index, reason) in reasons.iter().take(REASONS_MOST).chain(&item.note).enumerate() {
            @if index > 0 { "; " }
            (reason)
        }
    }
}

/// Returns the table of all sensors, closed until the reader opens it.
pub(super) fn section(history: &History, links: &dyn Fn(&Ended) -> Vec<PageLink>) -> Markup {
    let (quantities, results) = (Limited::all([history]), by_serial(history));
    let items = &history.state.items;
    let body = html! {
        details {
            summary { (counted(items.len(), "sensor")) " in the order of the list" }
            div.wide {
                table {
                    thead {
                        tr {
                            th scope="col" { "sensor" }
                            th.words scope="col" { "result" }
                            @for quantity in &quantities { th scope="col" { (quantity.label()) } }
                            th scope="col" { "minutes" }
                            th scope="col" { "times" }
                            th scope="col" { "last event" }
                        }
                    }
                    tbody {
                        @for item in items {
                            (row(item, results.get(item.serial.as_str()).copied(), &quantities, links))
                        }
                    }
                }
            }
        }
    };
    under("All sensors", &body)
}

fn row(
    item: &BatchSensor,
    ended: Option<&Ended>,
    quantities: &[Limited],
    links: &dyn Fn(&Ended) -> Vec<PageLink>,
) -> Markup {
    let figure = |quantity: &Limited| {
        let value = ended.and_then(|ended| quantity.found(ended)?.value).map(|value| quantity.displayed(value));
        let key = || format!("{}.{}", item.serial, quantity.key);
        value.map_or_else(none, |value| number(&key(), value, quantity.digits(), ""))
    };
    let minutes = ended.map(|ended| number(&format!("{}.minutes", item.serial), ended.minutes, 1, ""));
    html! {
        tr {
            th scope="row" { (linked(&item.serial, ended, links)) }
            td.words { (result(item)) }
            @for quantity in quantities { td { (figure(quantity)) } }
            td { (minutes.unwrap_or_else(none)) }
            td { (item.times) }
            td { (item.at.as_deref().map_or_else(none, |at| words(clock(at)))) }
        }
    }
}

fn linked(serial: &str, ended: Option<&Ended>, links: &dyn Fn(&Ended) -> Vec<PageLink>) -> Markup {
    let links = ended.map(links).unwrap_or_default();
    html! {
        (serial)
        @for link in links { " " a href=(link.href) { (link.name) } }
    }
}

fn by_serial(history: &History) -> HashMap<&str, &Ended> {
    history.results.iter().map(|ended| (ended.serial.as_str(), ended)).collect()
}
