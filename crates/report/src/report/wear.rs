//! Wear: presses that were repeated many times, with those at a reference place.

use super::Subject;
use super::figures::column;
use super::frame::{PageFigure, Section, none, number, table, words};
use super::numbers::{NumberCell, Numbers};
use crate::chart::{ChartAxis, Hue, LineStyle, Look, Mark, Panel, Shape};
use maud::html;
use palpate_data::dataset::{Cycled, cycled};
use palpate_solver::over_time::{Estimate, wear};

/// Largest number of points of a chart.
const MOST_CYCLES: usize = 1000;

type Points = Vec<(f64, f64)>;

/// Creates the section; `None` without such presses.
pub(super) fn section(subject: &Subject) -> Option<Section> {
    let all: Vec<Cycled> = subject.runs.iter().flat_map(cycled).collect();
    let mut rows = Vec::new();
    let mut drawn = Vec::new();
    for cycled in &all {
        let own = || cycled.points.iter().filter(|point| !point.is_reference);
        let count = own().count();
        let Ok(found) = wear(&cycled.points) else { continue };
        let cell = |key: &str, factor: f64, Estimate { value, interval: [from, to] }: Estimate| {
            html! { (number(key, factor * value, 3, "")) (format!(" ({:.3} to {:.3})", factor * from, factor * to)) }
        };
        rows.push(vec![
            words(format!("{}, {} mm", cycled.place.x_mm, cycled.place.y_mm)),
            words(count),
            cell("wear_percent", 1e5, found.wear_per_cycle),
            found.drift_per_h.map_or_else(none, |drift| cell("drift_percent_h", 100.0, drift)),
        ]);
        drawn.push(gains(cycled));
    }
    let head = ["place", "presses", "wear, % of the gain in 1000 presses", "drift of the rig, % per hour"];
    let note = html! {
        (table(&head.map(words), &rows))
        p.note {
            "The gain of a press is the size of its outputs for each newton. The presses at the reference place show how the rig drifts, and the rest "
            "of the change is wear. Both have their 95 % interval."
        }
    };
    Section::of_figures("Wear by many presses", &note, drawn)
}

/// Draws the gain of each press, and of the reference presses at the number of presses so far.
fn gains(cycled: &Cycled) -> PageFigure {
    let own = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: LineStyle::None };
    let reference = Look { hue: Hue::Orange, shape: Some(Shape::Square), ..own };
    let (mut made, mut of_own, mut of_reference): (f64, Points, Points) = (0.0, Vec::new(), Vec::new());
    let first = |is_reference: bool| {
        cycled.points.iter().find(|point| point.is_reference == is_reference).map_or(0.0, |point| point.log_gain)
    };
    let firsts = [first(false), first(true)];
    for point in &cycled.points {
        let percent = 100.0 * (point.log_gain - firsts[usize::from(point.is_reference)]).exp_m1();
        if point.is_reference {
            of_reference.push((made, percent));
        } else {
            made = point.cycle + 1.0;
            of_own.push((made, percent));
        }
    }
    let rows = [("cycles", &of_own), ("reference", &of_reference)].into_iter().flat_map(|(name, points)| {
        let cells = |(cycle, percent): &(f64, f64)| {
            vec![NumberCell::Words(name.to_owned()), NumberCell::Number(*cycle), NumberCell::Number(*percent)]
        };
        points.iter().map(cells).collect::<Vec<_>>()
    });
    let numbers = Numbers::new(&["presses", "cycle", "gain_change_percent"], rows.collect());
    let ends = of_own.iter().chain(&of_reference).map(|(_, percent)| *percent);
    let (least, most) = (ends.clone().fold(0.0, f64::min), ends.fold(0.0, f64::max));
    let room = 0.1 * (most - least).max(0.01);
    let one_in = of_own.len().div_ceil(MOST_CYCLES).max(1);
    let marks = vec![
        Mark::Curve(own, of_own.into_iter().step_by(one_in).collect()),
        Mark::Curve(reference, of_reference),
        Mark::Level(0.0, String::new()),
    ];
    let panel = Panel {
        x: ChartAxis::count("presses", (0.0, 1.02 * made.max(1.0))),
        y: ChartAxis::linear("change of the gain, %", (least - room, most + room)),
        marks,
    };
    let figure = column(
        format!("Gain at {}, {} mm", cycled.place.x_mm, cycled.place.y_mm),
        "change of the outputs for each newton since the first press",
        vec![panel],
        vec![vec![(own, "this place".to_owned()), (reference, "reference place".to_owned())]],
    );
    PageFigure::plain(figure).named(&format!("cycles-{}-{}", cycled.place.x_mm, cycled.place.y_mm)).with(numbers)
}
