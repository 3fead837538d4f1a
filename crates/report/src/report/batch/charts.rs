//! Control charts of a batch, drawn after the fact, and the alarms of its journal.

use super::complete;
use super::figures::{figure, named};
use super::limited::Limited;
use super::order::axis;
use crate::chart::{ChartAxis, Hue, LineStyle, Look, Mark, Panel, Shape};
use crate::report::frame::{PageFigure, Section, capital, clock, counted, number, table, words};
use maud::{Markup, html};
use palpate_run::batch::chart::{Charts, LIMIT_SIGMAS, NormalValues};
use palpate_run::batch::{Alarm, Cause, Ended, History, Quantity};
use statrs::statistics::Statistics as _;

/// Number of sensors at the beginning of the batch that give the normal mean and standard deviation, at most and at least.
const NORMAL_MOST: usize = 20;
const NORMAL_LEAST: usize = 5;

/// Largest statistic that is drawn, standard deviations. Larger ones are at the edge.
const DRAWN_MOST: f64 = 4.0 * LIMIT_SIGMAS;
/// Distance of the limits from the edge of a panel, relative to the limits.
const ROOM: f64 = 0.25;

/// Largest number of points that are drawn with a marker.
const MARKED_MOST: usize = 80;

/// Largest numbers of alarms that are named in a figure, and listed.
const NAMED_MOST: usize = 8;
const LISTED_MOST: usize = 30;

const REFERENCE: Look = Look { hue: Hue::Orange, shape: Some(Shape::Square), filled: true, line: LineStyle::Solid };
const SENSORS: Look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: LineStyle::Solid };
const ALARM: Look = Look::markers(Hue::Red, Shape::Diamond);

/// A control chart.
struct ControlChart {
    /// Name of the quantity in alarms.
    key: String,
    title: String,
    /// Where the normal values come from.
    normal: String,
    points: Vec<Point>,
}

/// A point of a chart: position on the axis of the sensors, and the statistics of reference and sensors.
struct Point {
    at: f64,
    sigmas: [f64; 2],
}

/// Draws the control charts: those of the design, which decided about alarms, and those of the rule's figures. `None` if there is
/// neither a chart nor an alarm.
pub(super) fn section(history: &History) -> Option<Section> {
    let of_figures = Limited::all([history]);
    let of_figures =
        of_figures.iter().filter(|figure| figure.is_charted()).filter_map(|figure| of_figure(history, figure));
    let charts: Vec<ControlChart> = of_design(history).into_iter().chain(of_figures).collect();
    if charts.is_empty() && history.alarms.is_empty() {
        return None;
    }
    let is_charted = |alarm: &Alarm| charts.iter().any(|chart| chart.key == alarm.quantity);
    let drawn = charts.iter().enumerate().map(|(index, chart)| {
        // an alarm of a quantity without a chart is in the first chart
        draw(history, chart, |alarm| alarm.quantity == chart.key || (index == 0 && !is_charted(alarm)))
    });
    let drawn = drawn.collect();
    Some(Section::new("Control charts", &before(history), drawn))
}

fn before(history: &History) -> Markup {
    html! {
        p.note {
            "Exponentially weighted means in standard deviations. "
            @if history.references.is_empty() {
                "Without a reference sensor a change of the bench can't be distinguished from a change of the sensors."
            } @else {
                "The sensors are corrected by the changes of the reference sensor, which are those of the bench."
            }
        }
        @if history.alarms.is_empty() { p { "The journal has no alarm." } } @else { (listed(&history.alarms)) }
        @if history.unkept > 0 { p.note { (history.unkept) " further alarms and reference measurements are only counted." } }
    }
}

fn listed(alarms: &[(usize, Alarm)]) -> Markup {
    let row = |(_, alarm): &(usize, Alarm)| {
        vec![
            words(clock(&alarm.at)),
            words(&alarm.serial),
            words(cause(alarm.cause)),
            words(&alarm.quantity),
            number("alarm.sigmas", alarm.sigmas, 2, ""),
            number("alarm.limit", alarm.limit, 2, ""),
        ]
    };
    let head = ["alarm", "sensor", "of the", "quantity", "statistic, sd", "limit, sd"].map(words);
    let rest = alarms.len().saturating_sub(LISTED_MOST);
    html! {
        (table(&head, &alarms.iter().take(LISTED_MOST).map(row).collect::<Vec<_>>()))
        @if rest > 0 { p.note { (counted(rest, "further alarm")) "." } }
    }
}

const fn cause(cause: Cause) -> &'static str {
    match cause {
        Cause::Bench => "bench",
        Cause::Batch => "batch",
    }
}

/// Returns the charts of the batch itself, whose normal values are those of the design.
fn of_design(history: &History) -> Vec<ControlChart> {
    let chart = |quantity: Quantity| {
        let points = history.references.iter().zip(&history.charted).filter_map(|((before, _), charted)| {
            let (_, sigmas) = charted.iter().find(|(of, _)| *of == quantity)?;
            Some(Point { at: *before as f64 + 0.5, sigmas: *sigmas })
        });
        let points: Vec<Point> = points.collect();
        let (key, normal) = (quantity.name().to_owned(), "normal values of the design".to_owned());
        (!points.is_empty()).then(|| ControlChart { title: capital(&key), key, normal, points })
    };
    Quantity::ALL.into_iter().filter_map(chart).collect()
}

/// Returns the chart of a figure of the rule; `None` if there are too few sensors, or if they all have the same value.
fn of_figure(history: &History, figure: &Limited) -> Option<ControlChart> {
    let finite = |ended: &Ended| figure.found(ended)?.value.filter(|value| value.is_finite());
    let values: Vec<(usize, f64)> =
        complete(history).filter_map(|(number, ended)| Some((number, finite(ended)?))).collect();
    let references: Vec<(usize, f64)> =
        history.references.iter().filter_map(|(before, ended)| Some((*before, finite(ended)?))).collect();
    let first: Vec<f64> = values.iter().take(NORMAL_MOST).map(|(_, value)| *value).collect();
    let of_reference: Vec<f64> = references.iter().take(NORMAL_MOST).map(|(_, value)| *value).collect();
    let reference_sd =
        Some((&of_reference).std_dev()).filter(|sd| of_reference.len() >= NORMAL_LEAST && sd.is_finite());
    let normal = NormalValues {
        mean: (&first).mean(),
        sd: (&first).std_dev(),
        reference_sd: reference_sd.unwrap_or_default(),
        sensors: first.len(),
    };
    if first.len() < NORMAL_LEAST || normal.sd.is_nan() || normal.sd <= f64::EPSILON * normal.mean.abs() {
        return None;
    }
    let points = replayed(Charts::new(normal), values, references);
    let text = format!("normal values of the first {}", counted(first.len(), "sensor"));
    (!points.is_empty()).then(|| ControlChart {
        key: figure.key.clone(),
        title: capital(figure.name()),
        normal: text,
        points,
    })
}

/// Returns the points of charts to which values of sensors and of the reference sensor are added, each with its number.
fn replayed(mut charts: Charts, values: Vec<(usize, f64)>, references: Vec<(usize, f64)>) -> Vec<Point> {
    if references.is_empty() {
        // a bench that never changes
        charts.add_reference(0.0);
        let point = |(number, value): (usize, f64)| {
            charts.add(value);
            charts.add_reference(0.0);
            Point { at: number as f64, sigmas: charts.sigmas() }
        };
        return values.into_iter().map(point).collect();
    }
    let mut waiting = values.into_iter().peekable();
    let point = |(before, reference): (usize, f64)| {
        while let Some((_, value)) = waiting.next_if(|(number, _)| *number <= before) {
            charts.add(value);
        }
        charts.add_reference(reference);
        Point { at: before as f64 + 0.5, sigmas: charts.sigmas() }
    };
    references.into_iter().map(point).collect()
}

fn draw(history: &History, chart: &ControlChart, belongs: impl Fn(&Alarm) -> bool) -> PageFigure {
    let points = &chart.points;
    let alarms: Vec<(f64, &Alarm)> = history
        .alarms
        .iter()
        .filter(|(_, alarm)| belongs(alarm))
        .map(|(before, alarm)| (*before as f64 + 0.5, alarm))
        .collect();
    let all = points.iter().flat_map(|point| point.sigmas).chain(alarms.iter().map(|(_, alarm)| alarm.sigmas));
    let most = all.map(f64::abs).filter(|sigmas| sigmas.is_finite()).fold(LIMIT_SIGMAS, f64::max).min(DRAWN_MOST);
    let most = most + ROOM * LIMIT_SIGMAS;
    let look = |look: Look| if points.len() > MARKED_MOST { Look { shape: None, ..look } } else { look };
    let curve = |of: usize, as_look: Look| {
        Mark::Curve(look(as_look), points.iter().map(|point| (point.at, point.sigmas[of])).collect())
    };
    let mut legend = vec![(look(SENSORS), "sensors".to_owned())];
    let mut marks = vec![
        Mark::Level(LIMIT_SIGMAS, format!("limit {LIMIT_SIGMAS}")),
        Mark::Level(-LIMIT_SIGMAS, format!("limit -{LIMIT_SIGMAS}")),
        curve(1, SENSORS),
    ];
    if !history.references.is_empty() {
        marks.push(curve(0, REFERENCE));
        legend.push((look(REFERENCE), "reference sensor".to_owned()));
    }
    if !alarms.is_empty() {
        marks.push(Mark::Curve(ALARM, alarms.iter().map(|(at, alarm)| (*at, alarm.sigmas)).collect()));
        legend.push((ALARM, "alarm of the journal".to_owned()));
        let last = history.results.len() as f64;
        let named = |(at, alarm): &(f64, &Alarm)| named((*at, alarm.sigmas), last, cause(alarm.cause));
        marks.extend(alarms.iter().take(NAMED_MOST).map(named));
    }
    let panel = Panel { x: axis(history), y: ChartAxis::linear("statistic, sd", (-most, most)), marks };
    let mut drawn = figure(&chart.title, &format!("control chart; {}", chart.normal), panel, legend);
    if alarms.len() > NAMED_MOST {
        drawn.notes.push(format!("the first {NAMED_MOST} of {} alarms are named", alarms.len()));
    }
    PageFigure::plain(drawn).named(&format!("control-chart {}", chart.key))
}
