//! Readings of each unit as a function of its load, during loading and unloading, for every repeat and channel.

use super::arrangement::MOST_UNITS;
use super::{arranged, left_out, title};
use crate::chart::{ChartAxis, Figure, Hue, LineStyle, Look, Mark, Panel, Shape};
use crate::report::Subject;
use crate::report::frame::PageFigure;
use palpate_control::Branch;
use palpate_data::dataset::characteristics::{HeldLevel, LevelMicronewton, Staircases, by_series};
use std::collections::BTreeMap;
use std::ops::Range;

/// Colours of the channels of a unit, in their order.
const CHANNELS: [Hue; 6] = [Hue::Blue, Hue::Orange, Hue::Green, Hue::Purple, Hue::Red, Hue::Teal];
/// Colours of the branches of a unit with one channel.
const BRANCHES: [Hue; 2] = [Hue::Blue, Hue::Orange];
/// Width of a panel, px, where there is room; its largest height, and its height as a fraction of its width.
const PANEL_PX: f64 = 100.0;
const HIGHEST_PX: f64 = 104.0;
const HEIGHT: f64 = 0.9;

/// Draws a panel for each unit, with a line for each of its channels and branches.
pub(super) fn characteristics(subject: &Subject) -> Option<PageFigure> {
    let staircases = Staircases::of_run(&subject.presses, subject.layout())?;
    let is_pressed = |unit: &Range<usize>| staircases.readings[unit.clone()].iter().any(|held| !held.is_empty());
    let pressed: Vec<Range<usize>> = subject.layout().units().filter(is_pressed).collect();
    let drawn = &pressed[..pressed.len().min(MOST_UNITS)];
    let channels = drawn.iter().map(Range::len).max()?;
    let all = || drawn.iter().flat_map(|unit| staircases.readings[unit.clone()].iter().flatten());
    let most_n = all().map(|reading| reading.force_n).fold(0.0, f64::max);
    let (least, most) = all().fold((0.0f64, 0.0f64), |(l, m), reading| (l.min(reading.output), m.max(reading.output)));
    let room = 0.06 * (most - least).max(f64::MIN_POSITIVE);
    let curves = |(channel, output): (usize, usize)| {
        let readings = &staircases.readings[output];
        let of_branch = move |(branch, look): (Branch, Look)| {
            let points = readings.iter().filter(|r| r.branch == branch).map(|r| (r.force_n, r.output)).collect();
            // a line for each place and top force: their outputs aren't one curve
            let lines = by_series(readings)
                .into_iter()
                .map(move |held| Mark::Curve(Look { shape: None, ..look }, means(&held, branch)));
            lines.chain([Mark::Curve(Look { line: LineStyle::None, ..look }, points)]).collect::<Vec<Mark>>()
        };
        looks(channel, channels).into_iter().flat_map(of_branch)
    };
    let panel = |index: usize| Panel {
        x: ChartAxis::linear("force, N", (0.0, 1.06 * most_n.max(f64::MIN_POSITIVE))),
        y: ChartAxis::linear(&format!("output, {}", subject.unit()), (least - room, most + room)),
        marks: drawn[index].clone().enumerate().flat_map(curves).chain([title(subject, &drawn[index])]).collect(),
    };
    let arrangement = arranged(subject, drawn);
    let (grid, panel_px) = arrangement.grid(PANEL_PX);
    let entry = |channel: usize| {
        let of = if channels > 1 { format!("channel {}, ", channel + 1) } else { String::new() };
        let names = ["loading", "unloading"].map(|branch| format!("{of}{branch}"));
        looks(channel, channels).into_iter().zip(names).map(|((_, look), name)| (look, name)).collect()
    };
    let figure = Figure {
        title: "Output of each unit against the force".to_owned(),
        subtitle: "every level of every staircase, and a line through the means at each place; force by the load cell"
            .to_owned(),
        height_px: (HEIGHT * panel_px).min(HIGHEST_PX),
        panels: arrangement.panels(panel),
        grid: Some(grid),
        legend: (0..channels).map(entry).collect(),
        notes: left_out(pressed.len() - drawn.len()),
    };
    Some(PageFigure::plain(figure))
}

/// Returns the look of each branch of a channel. With several channels the colour is the channel's.
fn looks(channel: usize, channels: usize) -> [(Branch, Look); 2] {
    let [loading, unloading] = if channels > 1 { [CHANNELS[channel % CHANNELS.len()]; 2] } else { BRANCHES };
    let look = |hue: Hue, shape: Shape, line: LineStyle| Look { hue, shape: Some(shape), filled: false, line };
    [
        (Branch::Loading, look(loading, Shape::Circle, LineStyle::Solid)),
        (Branch::Unloading, look(unloading, Shape::Square, LineStyle::Dashed)),
    ]
}

/// Returns the mean force and output of each level of a branch.
fn means(readings: &[HeldLevel], branch: Branch) -> Vec<(f64, f64)> {
    let mut levels: BTreeMap<LevelMicronewton, (f64, f64, f64)> = BTreeMap::new();
    for reading in readings.iter().filter(|reading| reading.branch == branch) {
        let (count, force_n, output) = levels.entry(reading.level()).or_default();
        (*count, *force_n, *output) = (*count + 1.0, *force_n + reading.force_n, *output + reading.output);
    }
    levels.into_values().map(|(count, force_n, output)| (force_n / count, output / count)).collect()
}
