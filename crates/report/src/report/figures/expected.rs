//! Expected error of a method at each place, from the calibration's knowledge of the array and its noise.

use super::map::Axes;
use super::{SQUARE_PX, WIDTH_PX};
use crate::chart::{AxisScale, ChartAxis, ColouredCell, Figure, Grid, Mark};
use crate::report::frame::{PageFigure, Section};
use crate::report::{SensorResults, Subject};
use maud::html;
use palpate_core::quantity::Place;
use palpate_data::recipe::Phase;
use palpate_solver::{Fitted, Solver};

/// Number of places along each side of the area.
const SIDE: usize = 25;
/// Least ratio of the largest to the smallest error on the colour axis, so that the axis has a length.
const LEAST_RATIO: f64 = 1.01;
/// Largest ratio of the largest to the smallest error on the colour axis. Larger errors look the same, because the error at a
/// corner can be arbitrarily large.
const MOST_RATIO: f64 = 100.0;

/// Draws a map of the expected location error.
pub(crate) fn expected(subject: &Subject, judged: &SensorResults) -> Option<Section> {
    let (least, most) = subject.area()?;
    let solver: &Fitted = judged.expecting.as_ref()?;
    let mut forces: Vec<f64> = subject.presses.sound(Phase::Test).filter_map(|press| press.force_set_n).collect();
    forces.sort_by(f64::total_cmp);
    let force_n = *forces.get(forces.len() / 2)?;
    let step = |least: f64, most: f64, i: usize| least + (most - least) * (i as f64 + 0.5) / SIDE as f64;
    let place = |i: usize| Place::new(step(least.x_mm, most.x_mm, i % SIDE), step(least.y_mm, most.y_mm, i / SIDE));
    let errors: Vec<(Place, f64)> = (0..SIDE * SIDE)
        .map(place)
        .filter_map(|place| Some((place, solver.expected(place, force_n)?.mean_distance_mm())))
        .collect();
    let best = errors.iter().map(|(_, mm)| *mm).reduce(f64::min).filter(|mm| *mm > 0.0)?;
    let largest = errors.iter().map(|(_, mm)| *mm).fold(best, f64::max);
    let colours = ChartAxis {
        label: "expected location error, mm".to_owned(),
        scale: AxisScale::Log,
        range: (best, largest.clamp(LEAST_RATIO * best, MOST_RATIO * best)),
    };
    let half = |least_mm: f64, most_mm: f64| 0.5 * (most_mm - least_mm) / SIDE as f64;
    let (half_x, half_y) = (half(least.x_mm, most.x_mm), half(least.y_mm, most.y_mm));
    // a line of places has cells too
    let (half_x, half_y) = (if half_x > 0.0 { half_x } else { half_y }, if half_y > 0.0 { half_y } else { half_x });
    let cell = |(Place { x_mm, y_mm }, mm): &(Place, f64)| ColouredCell {
        x: (x_mm - half_x, x_mm + half_x),
        y: (y_mm - half_y, y_mm + half_y),
        value: *mm,
    };
    let cells = errors.iter().map(cell).collect();
    let is_line = least.x_mm >= most.x_mm || least.y_mm >= most.y_mm;
    let axes = Axes::around(least, most, if is_line { half_x } else { 0.0 });
    let mean = errors.iter().map(|(_, mm)| mm).sum::<f64>() / errors.len() as f64;
    let mut notes = vec![
        "The smallest error that any unbiased method can reach here: the Cramér-Rao bound, with the map fitted to the calibration \
         and its noise."
            .to_owned(),
    ];
    if largest > MOST_RATIO * best {
        notes.push(format!("The last colour is for all larger errors, up to {largest:.3} mm."));
    }
    let figure = Figure {
        title: format!("Expected location error at {force_n} N"),
        subtitle: format!("by {}, at the median force of the test; mean over the area {mean:.3} mm", solver.name()),
        height_px: axes.height_px(SQUARE_PX),
        panels: vec![axes.panel(vec![Mark::Cells(colours, cells)])],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        notes,
        ..Figure::default()
    };
    let drawn = vec![PageFigure::plain(figure).named("expected-location-error")];
    Section::of_figures("Expected location error", &html! {}, drawn)
}
