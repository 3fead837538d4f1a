//! Control charts of a batch, drawn after the fact, and the alarms of its journal.

use super::complete;
use super::figures::figure;
use super::order::axis;
use super::quantity::Quantity;
use crate::batch::chart::{Charts, LIMIT_SIGMAS, Normal};
use crate::batch::{Alarm, Cause, Ended, History};
use crate::chart::{Anchor, ChartAxis, Hue, Line, Look, Mark, Panel, Shape};
use crate::report::frame::{Drawn, Section, capital, clock, counted, number, table, words};
use maud::{Markup, html};
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

/// Name of the quantity of the mean gain in alarms.
const GAIN: &str = "gain";

const REFERENCE: Look = Look { hue: Hue::Orange, shape: Some(Shape::Square), filled: true, line: Line::Solid };
const SENSORS: Look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: Line::Solid };
const ALARM: Look = Look::markers(Hue::Red, Shape::Diamond);

/// A quantity that is charted.
struct Charted {
    key: String,
    label: String,
    value: Box<dyn Fn(&Ended) -> Option<f64>>,
}

/// A point of the charts: position on the axis of the sensors, and the statistics of reference and sensors.
struct Point {
    at: f64,
    sigmas: [f64; 2],
}

/// Draws the control charts of the mean gain and of each figure, and lists the alarms. `None` if there is neither.
pub fn section(history: &History) -> Option<Section> {
    let drawn: Vec<(Charted, Vec<Point>)> = charted(history)
        .into_iter()
        .filter_map(|charted| points(history, &charted).map(|points| (charted, points)))
        .collect();
    if drawn.is_empty() && history.alarms.is_empty() {
        return None;
    }
    let is_drawn = |alarm: &Alarm| drawn.iter().any(|(charted, _)| charted.key == alarm.quantity);
    let figures = drawn.iter().enumerate().map(|(index, (charted, points))| {
        // an alarm of a quantity without a chart is in the first chart
        let belongs = |alarm: &Alarm| alarm.quantity == charted.key || (index == 0 && !is_drawn(alarm));
        draw(history, charted, points, belongs)
    });
    let figures = figures.collect();
    Some(Section::new("Control charts", &before(history), figures))
}

fn before(history: &History) -> Markup {
    html! {
        p.note {
            "Exponentially weighted means in standard deviations of the sensors. Normal values are those of the first sensors (at most "
            (NORMAL_MOST) "). "
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

fn charted(history: &History) -> Vec<Charted> {
    let gain = Charted {
        key: GAIN.to_owned(),
        label: "mean gain, relative to the design".to_owned(),
        value: Box::new(|ended| {
            (!ended.change.is_empty()).then(|| ended.change.iter().map(|change| change.gain).mean())
        }),
    };
    let figures = Quantity::all([history]).into_iter().filter(Quantity::is_charted).map(|quantity| Charted {
        key: quantity.key.clone(),
        label: quantity.name().to_owned(),
        value: Box::new(move |ended| quantity.found(ended)?.value),
    });
    [gain].into_iter().chain(figures).collect()
}

/// Returns the points of the charts of a quantity; `None` if there are too few sensors, or if they all have the same value.
fn points(history: &History, charted: &Charted) -> Option<Vec<Point>> {
    let finite = |ended: &Ended| (charted.value)(ended).filter(|value| value.is_finite());
    let values: Vec<(usize, f64)> =
        complete(history).filter_map(|(number, ended)| Some((number, finite(ended)?))).collect();
    let first: Vec<f64> = values.iter().take(NORMAL_MOST).map(|(_, value)| *value).collect();
    let normal = Normal { mean: (&first).mean(), sd: (&first).std_dev(), sensors: first.len() };
    if first.len() < NORMAL_LEAST || normal.sd.is_nan() || normal.sd <= f64::EPSILON * normal.mean.abs() {
        return None;
    }
    let references: Vec<(usize, f64)> =
        history.references.iter().filter_map(|(before, ended)| Some((*before, finite(ended)?))).collect();
    let mut charts = Charts::new(normal);
    let mut points = Vec::new();
    if references.is_empty() {
        // a bench that never changes
        charts.add_reference(0.0);
        for (number, value) in values {
            charts.add(value);
            charts.add_reference(0.0);
            points.push(Point { at: number as f64, sigmas: charts.sigmas() });
        }
        return Some(points);
    }
    let mut waiting = values.into_iter().peekable();
    for (before, reference) in references {
        while let Some((_, value)) = waiting.next_if(|(number, _)| *number <= before) {
            charts.add(value);
        }
        charts.add_reference(reference);
        points.push(Point { at: before as f64 + 0.5, sigmas: charts.sigmas() });
    }
    Some(points)
}

fn draw(history: &History, charted: &Charted, points: &[Point], belongs: impl Fn(&Alarm) -> bool) -> Drawn {
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
        marks.extend(alarms.iter().take(NAMED_MOST).map(|(at, alarm)| {
            Mark::Words((*at, alarm.sigmas), (8.0, 4.0), Anchor::Start, cause(alarm.cause).to_owned())
        }));
    }
    let panel = Panel { x: axis(history), y: ChartAxis::linear("statistic, sd", (-most, most)), marks };
    let mut drawn = figure(&capital(&charted.label), "control chart", panel, legend);
    if alarms.len() > NAMED_MOST {
        drawn.notes.push(format!("the first {NAMED_MOST} of {} alarms are named", alarms.len()));
    }
    Drawn::plain(drawn).named(&format!("control-chart {}", charted.key))
}
