//! Readings of each unit as a function of its load, during loading and unloading, for every repeat.

use super::WIDTH_PX;
use super::map::as_placed;
use crate::chart::{ChartAxis, Figure, Grid, Hue, Line, Look, Mark, Panel, Shape};
use crate::report::Subject;
use crate::report::frame::Drawn;
use palpate_control::Branch;
use palpate_data::dataset::characteristics::{HeldLevel, Level, Staircases, by_series};
use std::collections::BTreeMap;

/// Largest number of units that are drawn. If there are more, the first are drawn.
const MOST_UNITS: usize = 25;

const LOADING: Look = Look { hue: Hue::Blue, shape: Some(Shape::Circle), filled: false, line: Line::None };
const UNLOADING: Look = Look { hue: Hue::Orange, shape: Some(Shape::Square), filled: false, line: Line::None };

/// Largest number of panels in a row.
const MOST_COLUMNS: usize = 5;

/// Draws a panel for each unit.
pub(super) fn characteristics(subject: &Subject) -> Option<Drawn> {
    let staircases = Staircases::of_run(&subject.presses, subject.layout())?;
    let pressed: Vec<(usize, &[HeldLevel])> = staircases
        .readings
        .iter()
        .enumerate()
        .filter(|(_, readings)| !readings.is_empty())
        .map(|(unit, readings)| (unit, readings.as_slice()))
        .collect();
    if pressed.is_empty() {
        return None;
    }
    let drawn = &pressed[..pressed.len().min(MOST_UNITS)];
    let all = || drawn.iter().flat_map(|(_, readings)| *readings);
    let most_n = all().map(|reading| reading.force_n).fold(0.0, f64::max);
    let (least, most) = all().fold((0.0f64, 0.0f64), |(l, m), reading| (l.min(reading.output), m.max(reading.output)));
    let room = 0.06 * (most - least).max(f64::MIN_POSITIVE);
    let is_every_unit = drawn.iter().enumerate().all(|(index, (unit, _))| index == *unit);
    let placed = as_placed(subject, drawn.len()).filter(|(_, columns)| is_every_unit && *columns <= MOST_COLUMNS);
    let (order, columns) = placed.unwrap_or_else(|| {
        let columns = (drawn.len() as f64).sqrt().ceil().clamp(1.0, MOST_COLUMNS as f64) as usize;
        ((0..drawn.len()).collect(), columns)
    });
    let panel = |(unit, readings): &(usize, &[HeldLevel])| {
        let of = |branch: Branch| -> Vec<(f64, f64)> {
            readings.iter().filter(|r| r.branch == branch).map(|r| (r.force_n, r.output)).collect()
        };
        // a line for each place and top force: their outputs aren't one curve
        let series = by_series(readings);
        let lines = [(Branch::Loading, line(LOADING, Line::Solid)), (Branch::Unloading, line(UNLOADING, Line::Dashed))];
        let curve = |(branch, look): (Branch, Look)| {
            series.iter().map(move |held| Mark::Curve(look, means(held, branch))).collect::<Vec<Mark>>()
        };
        let points = [Mark::Curve(LOADING, of(Branch::Loading)), Mark::Curve(UNLOADING, of(Branch::Unloading))];
        let title = Mark::Title(subject.layout().name(*unit));
        Panel {
            x: ChartAxis::linear("force, N", (0.0, 1.06 * most_n.max(f64::MIN_POSITIVE))),
            y: ChartAxis::linear(&format!("output, {}", subject.unit()), (least - room, most + room)),
            marks: lines.into_iter().flat_map(curve).chain(points).chain([title]).collect(),
        }
    };
    let left_out = pressed.len() - drawn.len();
    let figure = Figure {
        title: "Output of each unit against the force".to_owned(),
        subtitle: "every level of every staircase, and a line through the means at each place; force by the load cell"
            .to_owned(),
        height_px: if columns > 3 { 60.0 } else { 104.0 },
        panels: order.into_iter().map(|index| panel(&drawn[index])).collect(),
        grid: Some(Grid { columns, width_px: WIDTH_PX, shared: true }),
        legend: vec![vec![
            (line(LOADING, Line::Solid), "loading".to_owned()),
            (line(UNLOADING, Line::Dashed), "unloading".to_owned()),
        ]],
        notes: if left_out > 0 {
            vec![format!("{left_out} more outputs aren't shown; their values are in the table.")]
        } else {
            Vec::new()
        },
    };
    Some(Drawn::plain(figure))
}

fn line(look: Look, line: Line) -> Look {
    Look { line, ..look }
}

/// Returns the mean force and output of each level of a branch.
fn means(readings: &[HeldLevel], branch: Branch) -> Vec<(f64, f64)> {
    let mut levels: BTreeMap<Level, (f64, f64, f64)> = BTreeMap::new();
    for reading in readings.iter().filter(|reading| reading.branch == branch) {
        let (count, force_n, output) = levels.entry(reading.level()).or_default();
        (*count, *force_n, *output) = (*count + 1.0, *force_n + reading.force_n, *output + reading.output);
    }
    levels.into_values().map(|(count, force_n, output)| (force_n / count, output / count)).collect()
}
