//! The first section: yield, numbers of sensors by result, and where and when they were calibrated.

use super::limited::{quartiles, sorted};
use super::order::days;
use super::{complete, sensors};
use crate::report::frame::{clock, counted, number, percent, section as under, table, words};
use maud::{Markup, html};
use palpate_data::acceptance::bound::share_interval;
use palpate_run::batch::{Cause, History, SensorState};

/// Yield of a batch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Yield {
    /// Number of accepted sensors.
    pub accepted: usize,
    /// Number of sensors with a verdict: accepted, not accepted or not decided.
    pub judged: usize,
    /// Two-sided 95 % interval of the fraction (Clopper and Pearson), 0 to 1.
    pub interval: (f64, f64),
}

impl Yield {
    /// Returns the yield by the present standing of each sensor.
    pub(super) fn of(history: &History) -> Yield {
        let count = |sensor_state| history.state.count(sensor_state);
        let accepted = count(SensorState::Accepted);
        let judged = accepted + count(SensorState::NotAccepted) + count(SensorState::NotDecided);
        Yield { accepted, judged, interval: share_interval(accepted, judged) }
    }

    /// Accepted fraction; `None` without a verdict.
    pub(super) fn share(&self) -> Option<f64> {
        (self.judged > 0).then(|| self.accepted as f64 / self.judged as f64)
    }

    /// Returns the fraction with its interval.
    pub(super) fn markup(&self) -> Markup {
        let Some(share) = self.share() else { return html! { "no sensor has a verdict" } };
        html! {
            (percent("yield", share)) " (" (number("yield.low", 100.0 * self.interval.0, 1, ""))
            " to " (number("yield.high", 100.0 * self.interval.1, 1, "")) " %)"
        }
    }
}

/// Median, lower and upper quartile of the minutes of complete sensors.
pub(super) fn minutes(history: &History) -> Option<[f64; 3]> {
    quartiles(&sorted(complete(history).map(|(_, ended)| ended.minutes)))
}

/// Median number of complete sensors a day, over the days with at least one.
pub(super) fn a_day(history: &History) -> Option<f64> {
    let days = sorted(days(history).into_iter().map(|(_, count)| count as f64));
    quartiles(&days).map(|[_, median, _]| median)
}

/// Number of alarms by cause.
pub(super) fn alarms(history: &History, cause: Cause) -> usize {
    history.alarms.iter().filter(|(_, alarm)| alarm.cause == cause).count()
}

/// Names in a list, or a dash.
pub(super) fn listed(names: &[String]) -> String {
    if names.is_empty() { "-".to_owned() } else { names.join(", ") }
}

/// Returns the section.
pub(super) fn section(history: &History) -> Markup {
    let found = Yield::of(history);
    let body = html! {
        div class="verdict" {
            @if found.judged > 0 {
                strong { (found.markup()) " accepted" }
                p {
                    (number("accepted", found.accepted as f64, 0, "")) " of " (number("judged", found.judged as f64, 0, ""))
                    " sensors with a verdict. In brackets: 95 % interval (Clopper and Pearson). \"Not decided\" counts against the yield."
                }
            } @else {
                strong { "No sensor has a verdict" }
            }
        }
        div.tables { (sensor_states(history)) (facts(history)) }
    };
    under("Yield", &body)
}

fn sensor_states(history: &History) -> Markup {
    let state = &history.state;
    let counts = SensorState::ALL.map(|sensor_state| (sensor_state, state.count(sensor_state)));
    let row = |(sensor_state, count): (SensorState, usize)| {
        vec![
            words(sensor_state.name()),
            number(&format!("standing.{}", sensors::key(sensor_state)), count as f64, 0, ""),
        ]
    };
    let mut rows: Vec<Vec<Markup>> = counts.into_iter().filter(|(_, count)| *count > 0).map(row).collect();
    rows.push(vec![words("all"), number("sensors", state.items.len() as f64, 0, "")]);
    table(&[words("result"), words("sensors")], &rows)
}

fn facts(history: &History) -> Markup {
    let (state, facts) = (&history.state, &history.state.facts);
    let repeated = state.items.iter().filter(|item| item.times > 1).count();
    let attempts = html! {
        (number("attempts", history.attempts as f64, 0, "")) @if repeated > 0 { "; " (counted(repeated, "sensor")) " more than once" }
    };
    let mut rows = vec![
        vec![words("bench"), words(listed(&history.benches))],
        vec![words("operator"), words(listed(&history.operators))],
        vec![words("begun"), words(clock(&facts.at))],
        vec![words("latest result"), words(clock(&history.until))],
        vec![words("attempts"), attempts],
    ];
    if let Some(reference) = &state.reference {
        let measured = number("references", history.references.len() as f64, 0, "");
        rows.push(vec![words(format!("reference {}", reference.serial)), html! { (measured) " times" }]);
    }
    if let Some([low, median, high]) = minutes(history) {
        let text = html! {
            (number("minutes.median", median, 1, "")) " (" (number("minutes.q1", low, 1, "")) " to "
            (number("minutes.q3", high, 1, "")) ")"
        };
        rows.push(vec![words("minutes a sensor, median and quartiles"), text]);
    }
    if let Some(median) = a_day(history) {
        rows.push(vec![words("sensors a day, median"), number("a_day", median, 1, "")]);
    }
    for (cause, name) in [(Cause::Bench, "bench"), (Cause::Batch, "batch")] {
        let count = alarms(history, cause);
        rows.push(vec![words(format!("alarms of the {name}")), number(&format!("alarms.{name}"), count as f64, 0, "")]);
    }
    if !facts.prior.is_empty() {
        rows.push(vec![words("design's prior"), words(counted(facts.prior.len(), "full calibration"))]);
    }
    table(&[words("batch"), words("")], &rows)
}
