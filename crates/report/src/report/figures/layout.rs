//! Layout of the array: its units with their names, and the calibrated places.

use super::map::Axes;
use super::{SQUARE_PX, WIDTH_PX};
use crate::chart::{Anchor, Figure, Grid, Hue, LineStyle, Look, Mark, Shape};
use crate::report::Subject;
use crate::report::frame::{PageFigure, counted};
use palpate_core::quantity::Place;

const UNIT: Look = Look { hue: Hue::Blue, shape: Some(Shape::Square), filled: true, line: LineStyle::None };
const PRESSED: Look = Look { hue: Hue::Grey, shape: Some(Shape::Dot), filled: true, line: LineStyle::None };
/// Margin beyond the outermost places, as a fraction of the larger side. The second constant is its least width, mm.
const ROOM: f64 = 0.08;
const LEAST_ROOM_MM: f64 = 0.5;
/// Largest number of units that are all named. If there are more, the first and the last are named.
const NAMED_MOST: usize = 64;
/// Largest number of calibrated places that are drawn. If there are more, every nth place is drawn.
const MOST_PLACES: usize = 2500;

/// Draws the layout; `None` if the positions of the units are unknown.
pub(super) fn layout(subject: &Subject) -> Option<PageFigure> {
    let units: Vec<Place> = subject.placed()?.one_per_unit().places().to_vec();
    let pressed: Vec<Place> = subject.calibrated().iter().map(|press| press.place()).collect();
    let one_in = pressed.len().div_ceil(MOST_PLACES).max(1);
    let all = || units.iter().chain(&pressed).copied();
    let corner = |of: fn(f64, f64) -> f64| all().reduce(|a, b| Place::new(of(a.x_mm, b.x_mm), of(a.y_mm, b.y_mm)));
    let (least, most) = (corner(f64::min)?, corner(f64::max)?);
    let room_mm = ROOM * (most.x_mm - least.x_mm).max(most.y_mm - least.y_mm);
    let axes = Axes::around(least, most, room_mm.max(LEAST_ROOM_MM));
    let at = |place: &Place| (place.x_mm, place.y_mm);
    let is_named = |unit: usize| units.len() <= NAMED_MOST || unit == 0 || unit + 1 == units.len();
    let named = units.iter().enumerate().filter(|(unit, _)| is_named(*unit));
    let names = named.map(|(unit, place)| Mark::Words(at(place), (0.0, -8.0), Anchor::Middle, (unit + 1).to_string()));
    let marks = [
        Mark::Curve(PRESSED, pressed.iter().step_by(one_in).map(at).collect()),
        Mark::Curve(UNIT, units.iter().map(at).collect()),
    ];
    let mut legend = vec![(UNIT, counted(units.len(), "unit"))];
    legend.extend((!pressed.is_empty()).then(|| (PRESSED, counted(pressed.len(), "calibrated place"))));
    let figure = Figure {
        title: "Units and calibrated places".to_owned(),
        subtitle: "seen from above, in the frame of the sensor".to_owned(),
        height_px: axes.height_px(SQUARE_PX),
        panels: vec![axes.panel(marks.into_iter().chain(names).collect())],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        legend: vec![legend],
        notes: Vec::new(),
    };
    Some(PageFigure::plain(figure).named("layout"))
}
