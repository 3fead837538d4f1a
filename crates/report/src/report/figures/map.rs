//! Calibration matrix: readings of each unit for the same load at each place.

use super::arrangement::MOST_UNITS;
use super::{arranged, left_out, title};
use crate::chart::{ChartAxis, ColouredCell, Figure, Mark, Panel};
use crate::report::Subject;
use crate::report::frame::{PageFigure, counted};
use palpate_core::quantity::{Place, round};
use palpate_data::dataset::Press;
use std::ops::Range;

/// Largest number of presses that are drawn for each unit. If there are more, every nth press is drawn.
const MOST_PRESSES: usize = 2500;
/// Largest number of cells in all maps. If there are more, the first units are drawn.
const MOST_CELLS: usize = 60_000;
/// Width of a panel, px, where there is room.
const PANEL_PX: f64 = 70.0;

/// Draws a map for each unit; with several channels a figure for each of them.
pub(super) fn matrices(subject: &Subject) -> Vec<PageFigure> {
    let units: Vec<Range<usize>> = subject.layout().units().collect();
    let channels = units.iter().map(Range::len).max().unwrap_or(0);
    (0..channels).filter_map(|channel| matrix(subject, &units, (channels > 1).then_some(channel))).collect()
}

/// Draws the maps of a channel, or of the only one.
fn matrix(subject: &Subject, units: &[Range<usize>], channel: Option<usize>) -> Option<PageFigure> {
    let (least, most) = subject.area()?;
    let presses = subject.calibrated();
    let drawn: Vec<_> = presses.iter().step_by(presses.len().div_ceil(MOST_PRESSES).max(1)).collect();
    let places: Vec<Place> = drawn.iter().map(|row| row.place()).collect();
    let most_units = MOST_CELLS / (drawn.len() * subject.presses.channels / units.len().max(1)).max(1);
    let (index, all) = (channel.unwrap_or(0), units.len());
    let units = &units[..all.min(MOST_UNITS).min(most_units.max(1))];
    let outputs: Vec<Option<usize>> = units.iter().map(|unit| unit.clone().nth(index)).collect();
    let load = MapLoad::of(&presses);
    let shares =
        || outputs.iter().flatten().flat_map(|unit| drawn.iter().map(|row| load.share(row, row.outputs[*unit])));
    let (quietest, loudest) = (shares().reduce(f64::min)?, shares().reduce(f64::max)?);
    let half_mm = half_cell_mm(&places);
    let axes = Axes::around(least, most, half_mm);
    let colours = ChartAxis::linear(&load.label(subject.unit()), (quietest, loudest));
    let panel = |unit: usize| {
        let cells = |output: usize| {
            drawn.iter().map(move |row| cell(row.place(), half_mm, load.share(row, row.outputs[output])))
        };
        let cells = outputs[unit].into_iter().flat_map(cells).collect();
        axes.panel(vec![Mark::Cells(colours.clone(), cells), title(subject, &units[unit])])
    };
    let arrangement = arranged(subject, units);
    let (grid, panel_px) = arrangement.grid(PANEL_PX);
    let each = if subject.has_drags() { ", one at each place" } else { "" };
    let figure = Figure {
        title: load.title(channel),
        subtitle: format!("{}{each}; one scale for all", load.text(presses.len())),
        height_px: axes.height_px(panel_px),
        panels: arrangement.panels(panel),
        grid: Some(grid),
        notes: left_out(all - units.len()),
        ..Figure::default()
    };
    let of_channel = channel.map(|channel| format!("-{}", channel + 1)).unwrap_or_default();
    Some(PageFigure::plain(figure).named(&format!("output-by-place{of_channel}")))
}

/// Load of a calibration's presses, N.
#[derive(Clone, Copy)]
enum MapLoad {
    /// All presses with one force.
    One(f64),
    /// Presses with forces in this range; outputs are divided by the forces.
    Many(f64, f64),
}

impl MapLoad {
    fn of(presses: &[&Press]) -> MapLoad {
        let forces = || presses.iter().map(|row| set_n(row));
        match (forces().reduce(f64::min), forces().reduce(f64::max)) {
            (Some(least), Some(most)) if least < most && least > 0.0 => MapLoad::Many(least, most),
            (least, _) => MapLoad::One(least.unwrap_or_default()),
        }
    }

    /// Returns the value that is drawn for an output.
    fn share(self, row: &Press, output: f64) -> f64 {
        match self {
            MapLoad::One(_) => output,
            MapLoad::Many(..) => output / set_n(row),
        }
    }

    /// Label of the drawn quantity, with its unit.
    fn label(self, unit: &str) -> String {
        match self {
            MapLoad::One(_) => format!("output, {unit}"),
            MapLoad::Many(..) => format!("output over force, {unit}/N"),
        }
    }

    fn title(self, channel: Option<usize>) -> String {
        let of = channel.map(|channel| format!("of channel {} ", channel + 1)).unwrap_or_default();
        match self {
            MapLoad::One(0.0) => format!("Output {of}of each unit at each place"),
            MapLoad::One(force_n) => format!("Output {of}of each unit for {force_n} N at each place"),
            MapLoad::Many(..) => format!("Output {of}of each unit per newton, at each place"),
        }
    }

    fn text(self, presses: usize) -> String {
        let presses = counted(presses, "press");
        match self {
            MapLoad::One(_) => presses,
            MapLoad::Many(least, most) => format!("{presses} of {} to {} N", round(least, 3), round(most, 3)),
        }
    }
}

/// Returns the commanded force, N. For an imported press it is the measured force.
fn set_n(row: &Press) -> f64 {
    row.force_set_n.or(row.force_n).unwrap_or_default()
}

/// Largest ratio of a map's height to its width. The second constant is the least ratio.
const HIGHEST: f64 = 1.2;
const LOWEST: f64 = 0.25;

/// Axes in x and y with the same scale.
pub(crate) struct Axes {
    x: (f64, f64),
    y: (f64, f64),
}

impl Axes {
    /// Creates axes around an area with some margin. A narrow strip gets a larger margin at its sides, so that the panel is
    /// neither too flat nor too tall.
    pub(crate) fn around(least: Place, most: Place, room_mm: f64) -> Axes {
        let (width_mm, height_mm) = (most.x_mm - least.x_mm + 2.0 * room_mm, most.y_mm - least.y_mm + 2.0 * room_mm);
        let beside_mm = room_mm + 0.5 * (height_mm / HIGHEST - width_mm).max(0.0);
        let above_mm = room_mm + 0.5 * (width_mm * LOWEST - height_mm).max(0.0);
        Axes { x: (least.x_mm - beside_mm, most.x_mm + beside_mm), y: (least.y_mm - above_mm, most.y_mm + above_mm) }
    }

    /// Creates a panel over the area.
    pub(crate) fn panel(&self, marks: Vec<Mark>) -> Panel {
        Panel { x: ChartAxis::linear("x, mm", self.x), y: ChartAxis::linear("y, mm", self.y), marks }
    }

    /// Returns the height of a panel of this width for equal scales, px.
    pub(crate) fn height_px(&self, width_px: f64) -> f64 {
        width_px * (self.y.1 - self.y.0) / (self.x.1 - self.x.0)
    }
}

/// Returns a cell around a place.
pub(crate) fn cell(Place { x_mm, y_mm }: Place, half_mm: f64, value: f64) -> ColouredCell {
    ColouredCell { x: (x_mm - half_mm, x_mm + half_mm), y: (y_mm - half_mm, y_mm + half_mm), value }
}

/// Returns half the side of a cell, mm. On a grid the cells touch their neighbours. For irregular places the cell has the mean
/// area per place.
pub(crate) fn half_cell_mm(places: &[Place]) -> f64 {
    // extent, and how many coordinates there are
    let along = |coordinate: fn(&Place) -> f64| {
        let mut all: Vec<f64> = places.iter().map(coordinate).collect();
        all.sort_by(f64::total_cmp);
        all.dedup_by(|a, b| (*a - *b).abs() < SAME_MM);
        (all.last().zip(all.first()).map_or(0.0, |(last, first)| last - first), all.len())
    };
    let ((width_mm, columns), (height_mm, rows)) = (along(|place| place.x_mm), along(|place| place.y_mm));
    if width_mm.max(height_mm) == 0.0 {
        return LONE_MM;
    }
    let of_grid = |extent_mm: f64, count: usize| extent_mm / count.saturating_sub(1).max(1) as f64;
    if columns * rows <= 2 * places.len() {
        0.5 * of_grid(width_mm, columns).max(of_grid(height_mm, rows)).max(SAME_MM)
    } else {
        0.5 * (width_mm * height_mm / places.len() as f64).sqrt().max(SAME_MM)
    }
}

/// Distance below which coordinates are the same, mm.
const SAME_MM: f64 = 1e-4;
/// Half the side of a single place's cell, mm. It isn't a round number, because then the numbers of two panels would meet.
const LONE_MM: f64 = 0.6;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_a_grid_meet_and_those_of_scattered_places_cover_their_area() {
        let grid: Vec<Place> = (0..25).map(|i| Place::new(0.5 * f64::from(i % 5), 0.5 * f64::from(i / 5))).collect();
        assert!((half_cell_mm(&grid) - 0.25).abs() < 1e-12);
        assert!((half_cell_mm(&grid[..5]) - 0.25).abs() < 1e-12, "a line");
        let scattered: Vec<Place> = (0..100)
            .map(|i| (f64::from(i) * 0.7549).fract())
            .zip((0..100).map(|i| (f64::from(i) * 0.5698).fract()))
            .map(|(x, y)| Place::new(10.0 * x, 10.0 * y))
            .collect();
        assert!((half_cell_mm(&scattered) - 0.5).abs() < 0.02);
        assert_eq!(half_cell_mm(&grid[..1]), LONE_MM);
    }
}
