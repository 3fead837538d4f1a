//! Several batches side by side: months, or benches.

use super::complete;
use super::headline::{Yield, a_day, alarms, listed, minutes};
use super::limited::{Limited, is_exceeded, quartiles};
use crate::chart::{Hue, Look, Shape};
use crate::report::frame::{Page, PageFigure, Section, capital, clock, counted, none, number, section, table, words};
use crate::report::side_by_side::{Series, spread};
use maud::{Markup, html};
use palpate_run::batch::{Cause, History};

/// Creates a page about several batches, in the order they were given.
pub fn batches_page(histories: &[History]) -> Page {
    let title = format!("{} side by side", counted(histories.len(), "batch"));
    let header = html! { h1 { (title) } p.lede { "In the given order: months, or benches." } };
    let quantities = Limited::all(histories);
    let figures = [yields(histories)].into_iter().chain(quantities.iter().map(|quantity| figure(histories, quantity)));
    let figures = figures.chain([times(histories)]).flatten().collect();
    let sections = [
        Some(Section::from(section("Yield, time and alarms", &summary(histories)))),
        Some(Section::from(section("Figures of the acceptance rule", &limits(histories, &quantities)))),
        Section::of_figures("Side by side", &html! {}, figures),
    ];
    Page::of(&title, &header, sections.into_iter().flatten())
}

fn name(index: usize, history: &History) -> String {
    format!("{}.\u{a0}{}", index + 1, history.state.facts.name)
}

fn summary(histories: &[History]) -> Markup {
    let origin = |(index, history): (usize, &History)| {
        vec![
            words(name(index, history)),
            words(&history.state.facts.design),
            words(listed(&history.benches)),
            words(listed(&history.operators)),
            words(clock(&history.state.facts.at)),
            words(clock(&history.until)),
        ]
    };
    let result = |(index, history): (usize, &History)| {
        let found = Yield::of(history);
        let key = |what: &str| format!("{}.{what}", index + 1);
        let count = |what: &str, count: usize| number(&key(what), count as f64, 0, "");
        let [low, median, high] = minutes(history).map_or([None; 3], |values| values.map(Some));
        let minutes =
            |what: &str, value: Option<f64>| value.map_or_else(none, |value| number(&key(what), value, 1, ""));
        vec![
            words(name(index, history)),
            html! { (count("accepted", found.accepted)) " of " (count("judged", found.judged)) },
            found.markup(),
            number(&key("attempts"), history.attempts as f64, 0, ""),
            html! { (minutes("minutes.median", median)) " (" (minutes("minutes.q1", low)) " to " (minutes("minutes.q3", high)) ")" },
            a_day(history).map_or_else(none, |median| number(&key("a_day"), median, 1, "")),
            count("alarms.bench", alarms(history, Cause::Bench)),
            count("alarms.batch", alarms(history, Cause::Batch)),
        ]
    };
    let rows =
        |row: &dyn Fn((usize, &History)) -> Vec<Markup>| histories.iter().enumerate().map(row).collect::<Vec<_>>();
    let results = [
        "batch",
        "accepted",
        "yield",
        "attempts",
        "minutes a sensor",
        "sensors a day",
        "alarms, bench",
        "alarms, batch",
    ];
    html! {
        (table(&results.map(words), &rows(&result)))
        p.note { "Yield: with its 95 % interval (Clopper and Pearson); a sensor that isn't decided counts as judged. Minutes: median and quartiles." }
        (table(&["batch", "design", "bench", "operator", "begun", "latest result"].map(words), &rows(&origin)))
    }
}

fn limits(histories: &[History], quantities: &[Limited]) -> Markup {
    let row = |(index, history): (usize, &History), quantity: &Limited| {
        let key = |what: &str| format!("{}.{}.{what}", index + 1, quantity.key);
        let sorted = quantity.sorted(history);
        let cell = |what: &str, value: Option<f64>| {
            value.map_or_else(none, |value| number(&key(what), quantity.displayed(value), quantity.digits(), ""))
        };
        let [low, median, high] = quartiles(&sorted).map_or([None; 3], |values| values.map(Some));
        let found = || complete(history).filter_map(|(_, ended)| quantity.found(ended));
        let exceeded = found().filter(|found| is_exceeded(found)).count();
        vec![
            words(name(index, history)),
            number(&key("n"), sorted.len() as f64, 0, ""),
            cell("q1", low),
            cell("median", median),
            cell("q3", high),
            cell("limit", found().last().map(|found| found.limit)),
            number(&key("exceeded"), exceeded as f64, 0, ""),
        ]
    };
    let head = ["batch", "sensors", "lower quartile", "median", "upper quartile", "limit", "exceeded by"].map(words);
    html! {
        @for quantity in quantities {
            h3 { (capital(&quantity.label())) }
            (table(&head, &histories.iter().enumerate().map(|each| row(each, quantity)).collect::<Vec<_>>()))
        }
        @if quantities.is_empty() { p { "No sensor has a figure with a limit." } }
    }
}

/// Draws a value of each batch, with strokes over its range.
fn drawn(
    histories: &[History],
    title: &str,
    label: &str,
    ranges: &str,
    rows: Vec<Option<[f64; 3]>>,
    limit: Option<(f64, String)>,
) -> Option<PageFigure> {
    let name = |(index, history): (usize, &History)| {
        let date: String = history.state.facts.at.chars().take("2026-01-01".len()).collect();
        format!("{}\n{date}", name(index, history))
    };
    let names: Vec<String> = histories.iter().enumerate().map(name).collect();
    let series = Series { look: Look::markers(Hue::Blue, Shape::Circle), name: String::new(), rows };
    Some(PageFigure::plain(spread(title, ranges, label, &names, &[series], limit)?))
}

fn yields(histories: &[History]) -> Option<PageFigure> {
    let row = |history: &History| {
        let found = Yield::of(history);
        Some([found.interval.0, found.share()?, found.interval.1].map(|share| 100.0 * share))
    };
    let rows = histories.iter().map(row).collect();
    drawn(histories, "Yield", "accepted of judged, %", "strokes: 95 % interval", rows, None)
}

fn figure(histories: &[History], quantity: &Limited) -> Option<PageFigure> {
    let row = |history: &History| {
        quartiles(&quantity.sorted(history)).map(|values| values.map(|value| quantity.displayed(value)))
    };
    let rows = histories.iter().map(row).collect();
    let limit = complete(histories.last()?).filter_map(|(_, ended)| quantity.found(ended)).last();
    let limit = limit.map(|found| (quantity.displayed(found.limit), "limit".to_owned()));
    drawn(histories, &capital(quantity.name()), &quantity.label(), "medians; strokes: quartiles", rows, limit)
}

fn times(histories: &[History]) -> Option<PageFigure> {
    let rows = histories.iter().map(minutes).collect();
    drawn(histories, "Minutes a sensor", "minutes", "medians; strokes: quartiles", rows, None)
}
