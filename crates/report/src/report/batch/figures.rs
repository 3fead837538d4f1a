//! Figures along the batch: each figure of the acceptance rule by sensor, and the time that a sensor takes.

use super::complete;
use super::limited::{Limited, is_exceeded, quartiles, sorted};
use super::order::{self, Along, axis};
use crate::chart::{Anchor, AxisScale, ChartAxis, Figure, Grid, Hue, LineStyle, Look, Mark, Panel, Shape, WidthPart};
use crate::report::figures::WIDTH_PX;
use crate::report::frame::{PageFigure, Section, capital, counted};
use maud::html;
use palpate_core::quantity::round;
use palpate_run::batch::{History, SensorFigure};

/// Height of a panel, px.
const HEIGHT_PX: f64 = 230.0;

/// Largest number of sensors that are named in a figure: those farthest beyond the limit.
const NAMED_MOST: usize = 5;

/// Largest value that is drawn, relative to the limit. Values beyond it are at the edge.
const BEYOND: f64 = 3.0;

/// Distance between the values and the edge of a panel, relative to the axis.
const ROOM: f64 = 0.08;

/// Distance of the least value from 0, relative to the range of the values, up to which the axis begins at 0.
const ZERO_NEAR: f64 = 0.5;

const VALUE: Look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: LineStyle::None };
/// Digits of a limit after the decimal point.
const SHOWN_DIGITS: i32 = 6;

const EXCEEDED: Look = Look::markers(Hue::Red, Shape::Cross);

/// Returns a figure of one panel.
pub(super) fn figure(title: &str, subtitle: &str, panel: Panel, legend: Vec<(Look, String)>) -> Figure {
    Figure {
        title: title.to_owned(),
        subtitle: subtitle.to_owned(),
        height_px: HEIGHT_PX,
        panels: vec![panel],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        legend: vec![legend],
        notes: Vec::new(),
    }
}

/// Draws each figure of the acceptance rule by sensor.
pub(super) fn section(history: &History) -> Option<Section> {
    let drawn = Limited::all([history]).iter().filter_map(|quantity| by_sensor(history, quantity)).collect();
    Section::of_figures("Figures of the acceptance rule", &html! {}, drawn)
}

fn by_sensor(history: &History, quantity: &Limited) -> Option<PageFigure> {
    let found: Vec<(usize, &str, &SensorFigure)> = complete(history)
        .filter_map(|(number, ended)| Some((number, ended.serial.as_str(), quantity.found(ended)?)))
        .collect();
    let limit = quantity.displayed(found.last()?.2.limit);
    let displayed = |value: fn(&SensorFigure) -> Option<f64>| -> Vec<(usize, f64)> {
        found.iter().filter_map(|(number, _, found)| Some((*number, quantity.displayed(value(found)?)))).collect()
    };
    let (values, bounds) = (displayed(|found| found.value), displayed(|found| found.bound));
    let range = range(quantity, limit, values.iter().chain(&bounds).map(|(_, value)| *value));
    let outside = values.iter().filter(|(_, value)| !(range.0..=range.1).contains(value)).count();
    let (marks, legend) = marks(quantity, &found, (&values, &bounds), limit);
    let panel = Panel { x: axis(history), y: ChartAxis::linear(&quantity.label(), range), marks };
    let subtitle = format!("{}; limit {}", counted(values.len(), "sensor"), shown(quantity, limit));
    let mut figure = figure(&capital(quantity.name()), &subtitle, panel, legend);
    if outside > 0 {
        figure.notes.push(format!("{} beyond the axis at its edge", counted(outside, "sensor")));
    }
    let unmeasured = found.len() - values.len();
    if unmeasured > 0 {
        figure.notes.push(format!("{} without this figure", counted(unmeasured, "sensor")));
    }
    Some(PageFigure::plain(figure).named(&format!("by-sensor {}", quantity.key)))
}

type Numbered = [(usize, f64)];

fn marks(
    quantity: &Limited,
    found: &[(usize, &str, &SensorFigure)],
    (values, bounds): (&Numbered, &Numbered),
    limit: f64,
) -> (Vec<Mark>, Vec<(Look, String)>) {
    let along = Along::new(values);
    let mut legend = vec![(VALUE, along.text("measured"))];
    let mut marks = vec![Mark::Level(limit, format!("limit {}", shown(quantity, limit)))];
    if !bounds.is_empty() {
        let of_bounds = Along::new(bounds);
        let look = Look::line(Hue::Orange, LineStyle::Solid);
        if of_bounds.of == 1 {
            let of = |found: &SensorFigure| Some((quantity.displayed(found.value?), quantity.displayed(found.bound?)));
            let stroke = |(number, _, found): &(usize, &str, &SensorFigure)| {
                let (value, bound) = of(found)?;
                Some(((*number as f64, value), (*number as f64, bound)))
            };
            marks.push(Mark::Strokes(Hue::Orange, found.iter().filter_map(stroke).collect()));
            legend.push((look, "up to the 95 % bound".to_owned()));
        } else {
            marks.push(Mark::Curve(look, of_bounds.points));
            legend.push((look, "95 % bound, median".to_owned()));
        }
    }
    marks.extend([Mark::Strokes(Hue::Blue, along.ranges), Mark::Curve(VALUE, along.points)]);
    let mut exceeded: Vec<_> = found.iter().filter(|(_, _, found)| is_exceeded(found)).collect();
    // a guarded rule compares the bound
    let at =
        |number: usize, found: &SensorFigure| Some((number as f64, quantity.displayed(found.bound.or(found.value)?)));
    if !exceeded.is_empty() {
        let points = exceeded.iter().filter_map(|(number, _, found)| at(*number, found)).collect();
        marks.push(Mark::Curve(EXCEEDED, points));
        legend.push((EXCEEDED, "limit exceeded".to_owned()));
    }
    let used = |found: &SensorFigure| quantity.used(found).unwrap_or_default();
    exceeded.sort_by(|(.., one), (.., other)| used(other).total_cmp(&used(one)));
    let last = found.last().map_or(0, |(number, ..)| *number);
    let words = exceeded
        .into_iter()
        .take(NAMED_MOST)
        .filter_map(|(number, serial, found)| Some(named(at(*number, found)?, last as f64, serial)));
    marks.extend(words);
    (marks, legend)
}

/// Returns words next to a point, on the side where there is room: toward the middle of an axis from 0 to `last`.
pub(super) fn named(at: (f64, f64), last: f64, words: &str) -> Mark {
    let (right_px, anchor) = if 2.0 * at.0 > last { (-8.0, Anchor::End) } else { (8.0, Anchor::Start) };
    Mark::Words(at, (right_px, 4.0), anchor, words.to_owned())
}

/// Returns the range of an axis that contains the limit and the values, unless they are far beyond the limit. It begins at 0 if 0 is
/// near, and ends at 100 % at most for a fraction.
fn range(quantity: &Limited, limit: f64, values: impl Iterator<Item = f64>) -> (f64, f64) {
    let values = values.filter(|value| value.is_finite());
    let (least, most) = values.fold((limit, limit), |(least, most), value| (least.min(value), most.max(value)));
    let most = if limit > 0.0 { most.min(BEYOND * limit) } else { most };
    let room = ROOM * (most - least);
    let end = if quantity.is_share() { 100f64.max(most) } else { most + room };
    let is_zero_near = least >= 0.0 && least < ZERO_NEAR * (most - least);
    (if is_zero_near { 0.0 } else { least - room }, end)
}

fn shown(quantity: &Limited, displayed: f64) -> String {
    format!("{} {}", round(displayed, SHOWN_DIGITS), quantity.unit()).trim_end().to_owned()
}

/// Draws the minutes of each complete sensor, and the number of sensors a day.
pub(super) fn minutes(history: &History) -> Option<Section> {
    let values: Vec<(usize, f64)> = complete(history).map(|(number, ended)| (number, ended.minutes)).collect();
    let [_, median, _] = quartiles(&sorted(values.iter().map(|(_, minutes)| *minutes)))?;
    let along = Along::new(&values);
    let legend = vec![(VALUE, along.text("measured"))];
    let most = values.iter().map(|(_, minutes)| *minutes).fold(median, f64::max).min(BEYOND * median);
    let marks = vec![
        Mark::Level(median, format!("median {median:.1}")),
        Mark::Strokes(Hue::Blue, along.ranges),
        Mark::Curve(VALUE, along.points),
    ];
    let panel = Panel { x: axis(history), y: ChartAxis::linear("minutes", (0.0, (1.0 + ROOM) * most)), marks };
    let subtitle = "from the beginning of the first run to the end of the last";
    let drawn = [Some(PageFigure::plain(figure("Minutes a sensor", subtitle, panel, legend))), a_day(history)];
    Section::of_figures("Time", &html! {}, drawn.into_iter().flatten().collect())
}

/// Number of ticks below the days, at most.
const DAYS_MOST: usize = 4;

fn a_day(history: &History) -> Option<PageFigure> {
    let days = order::days(history);
    let most = days.iter().map(|(_, count)| *count).max().filter(|_| days.len() > 1)? as f64;
    let every = days.len().div_ceil(DAYS_MOST);
    let middle = |day: usize| day as f64 + 0.5;
    // a date in the middle of its part of the axis has room at both sides
    let ticks = days.iter().enumerate().skip(every / 2).step_by(every);
    let ticks = ticks.map(|(day, (date, _))| (middle(day), date.clone())).collect();
    let columns =
        days.iter().enumerate().map(|(day, (_, count))| ((day as f64 + 0.1, day as f64 + 0.9), *count as f64));
    let x = ChartAxis {
        label: "day with a sensor".to_owned(),
        scale: AxisScale::At(ticks),
        range: (0.0, days.len() as f64),
    };
    let marks = vec![Mark::Columns(Hue::Blue, WidthPart { index: 0, of: 1 }, columns.collect())];
    let panel = Panel { x, y: ChartAxis::count("sensors", (0.0, (1.0 + ROOM) * most)), marks };
    let subtitle = format!("complete ones; {} days", days.len());
    Some(PageFigure::plain(figure("Sensors a day", &subtitle, panel, Vec::new())))
}
