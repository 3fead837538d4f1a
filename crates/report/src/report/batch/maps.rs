//! Maps of the batch's outputs, relative to the design: mean gain, its standard deviation, and mean displacement.

use super::complete;
use crate::chart::{ChartAxis, Figure, Grid, Hue, LineStyle, Look, Mark, Shape};
use crate::report::figures::{Axes, SQUARE_PX, WIDTH_PX, cell, half_cell_mm};
use crate::report::frame::{PageFigure, Section, counted, number, table, words};
use maud::{Markup, html};
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_run::batch::History;
use palpate_run::rig;
use palpate_solver::UnitChange;
use std::io;

/// Names of the rig's text and of its own files in a batch folder.
const RIG: &str = "rig.toml";
const OF_RIG: &str = "rig-";

/// Longest drawn displacement, relative to half of a cell.
const LONGEST: f64 = 0.9;

/// Least width of the colour scale, %. It is the least difference that is shown.
const LEAST_PERCENT: f64 = 0.01;

/// Largest number of outputs that are listed.
const LISTED_MOST: usize = 256;

/// Changes of the outputs of all sensors, for sensors with the same number of outputs.
pub(super) struct BatchOutputs<'a> {
    /// Serial number and changes of each sensor.
    pub sensors: Vec<(&'a str, &'a [UnitChange])>,
    count: usize,
}

/// Mean and standard deviation of an output over the batch.
#[derive(Clone, Copy, Default)]
struct OutputSpread {
    /// Mean change of the gain, %, and its standard deviation (n - 1), which is not a number for one sensor.
    gain_percent: [f64; 2],
    /// Mean displacement, mm.
    moved_mm: [f64; 2],
}

impl BatchOutputs<'_> {
    /// Takes the changes of the complete sensors; `None` if there are none.
    pub(super) fn of(history: &History) -> Option<BatchOutputs<'_>> {
        let all = || complete(history).filter(|(_, ended)| !ended.change.is_empty());
        let count = all().next()?.1.change.len();
        let alike = all().filter(|(_, ended)| ended.change.len() == count);
        let sensors = alike.map(|(_, ended)| (ended.serial.as_str(), ended.change.as_slice())).collect();
        Some(BatchOutputs { sensors, count })
    }

    fn spreads(&self) -> Vec<OutputSpread> {
        let of_output = |output: usize| {
            let mean = |value: fn(&UnitChange) -> f64| {
                self.sensors.iter().map(|(_, changes)| value(&changes[output])).sum::<f64>() / self.sensors.len() as f64
            };
            let gain = mean(|change| change.gain);
            let squares: f64 = self.sensors.iter().map(|(_, changes)| (changes[output].gain - gain).powi(2)).sum();
            let sd = (squares / (self.sensors.len() as f64 - 1.0)).sqrt();
            OutputSpread {
                gain_percent: [100.0 * (gain - 1.0), 100.0 * sd],
                moved_mm: [mean(|change| change.x_mm), mean(|change| change.y_mm)],
            }
        };
        (0..self.count).map(of_output).collect()
    }
}

/// Draws the maps, if the changes are known.
pub(super) fn section(history: &History) -> Option<Section> {
    let outputs = BatchOutputs::of(history)?;
    let spreads = outputs.spreads();
    let places = places(history, outputs.count);
    let drawn = places.as_ref().map(|places| drawn(&outputs, &spreads, places)).unwrap_or_default();
    let text = html! {
        p.note {
            (counted(outputs.sensors.len(), "sensor")) " relative to the design. A channel of a unit counts as its unit."
            @if places.is_none() { " The rig's text doesn't give the positions of these outputs, so there is no map." }
        }
    };
    Some(Section::new("Deviation from the design", &html! { (text) (listed(&spreads)) }, drawn))
}

/// Returns the place of each change: of each output, or of each unit. `None` if the rig has another number of outputs, or can't be
/// read.
fn places(history: &History, count: usize) -> Option<Vec<Place>> {
    let texts = &history.state.texts;
    let text = |name: &str| texts.iter().find(|text| text.name == name).map(|text| text.text.clone());
    let own = |name: &str| text(&format!("{OF_RIG}{name}")).ok_or_else(|| io::ErrorKind::NotFound.into());
    let layout: ArrayLayout = rig::parse(RIG, &text(RIG)?, &own).ok()?.array.layout;
    let of_units = layout.one_per_unit();
    [layout, of_units].into_iter().find(|layout| layout.len() == count).map(|layout| layout.places().to_vec())
}

fn drawn(outputs: &BatchOutputs, spreads: &[OutputSpread], places: &[Place]) -> Vec<PageFigure> {
    let half_mm = half_cell_mm(places);
    let fold = |of: fn(f64, f64) -> f64| {
        let over = |value: fn(&Place) -> f64| places.iter().map(value).reduce(of).unwrap_or_default();
        Place::new(over(|place| place.x_mm), over(|place| place.y_mm))
    };
    let axes = Axes::around(fold(f64::min), fold(f64::max), half_mm);
    let figure = |title: &str, subtitle: String, marks: Vec<Mark>| Figure {
        title: title.to_owned(),
        subtitle,
        height_px: axes.height_px(SQUARE_PX),
        panels: vec![axes.panel(marks)],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        ..Figure::default()
    };
    let units = by_place(spreads, places);
    let map = |title: &str, label: &str, which: usize, range: (f64, f64)| {
        let cells = units.iter().map(|(place, spread)| cell(*place, half_mm, spread.gain_percent[which])).collect();
        let marks = vec![Mark::Cells(ChartAxis::linear(label, range), cells)];
        PageFigure::plain(figure(title, format!("of {}", counted(outputs.sensors.len(), "sensor")), marks))
    };
    let most = |which: usize| {
        let values = units.iter().map(|(_, spread)| spread.gain_percent[which].abs());
        values.filter(|value| value.is_finite()).fold(LEAST_PERCENT, f64::max)
    };
    let mean = map("Mean gain of each output", "gain relative to the design, %", 0, (-most(0), most(0)));
    let sd = (outputs.sensors.len() > 1)
        .then(|| map("Standard deviation of the gain", "standard deviation of the gain, %", 1, (0.0, most(1))));
    let (marks, times, longest_mm) = displaced(&units, half_mm);
    let subtitle = format!("drawn {times} times as long; longest {longest_mm:.3} mm");
    let moved = PageFigure::plain(figure("Mean displacement of each output", subtitle, marks));
    [Some(mean), sd, Some(moved)].into_iter().flatten().collect()
}

/// Returns the mean of the outputs at each place: the channels of a unit have one place.
fn by_place(spreads: &[OutputSpread], places: &[Place]) -> Vec<(Place, OutputSpread)> {
    let mut units: Vec<(Place, Vec<OutputSpread>)> = Vec::new();
    for (spread, place) in spreads.iter().zip(places) {
        // the channels of a unit follow each other
        match units.last_mut().filter(|(last, _)| last == place) {
            Some((_, channels)) => channels.push(*spread),
            None => units.push((*place, vec![*spread])),
        }
    }
    let mean = |channels: &[OutputSpread], value: &dyn Fn(&OutputSpread) -> f64| {
        channels.iter().map(value).sum::<f64>() / channels.len() as f64
    };
    let of_unit = |(place, channels): (Place, Vec<OutputSpread>)| {
        let both =
            |value: fn(&OutputSpread) -> [f64; 2]| [0, 1].map(|index| mean(&channels, &|spread| value(spread)[index]));
        (
            place,
            OutputSpread { gain_percent: both(|spread| spread.gain_percent), moved_mm: both(|spread| spread.moved_mm) },
        )
    };
    units.into_iter().map(of_unit).collect()
}

/// Returns the marks of the displacements, how many times as long they are drawn, and the longest, mm.
fn displaced(units: &[(Place, OutputSpread)], half_mm: f64) -> (Vec<Mark>, f64, f64) {
    let longest_mm = units.iter().map(|(_, spread)| spread.moved_mm[0].hypot(spread.moved_mm[1])).fold(0.0, f64::max);
    let times = round_times(LONGEST * half_mm / longest_mm);
    let from = |place: &Place| (place.x_mm, place.y_mm);
    let to = |(place, spread): &(Place, OutputSpread)| {
        (place.x_mm + times * spread.moved_mm[0], place.y_mm + times * spread.moved_mm[1])
    };
    let place = Look { hue: Hue::Grey, shape: Some(Shape::Circle), filled: false, line: LineStyle::None };
    let marks = vec![
        Mark::Curve(place, units.iter().map(|(place, _)| from(place)).collect()),
        Mark::Strokes(Hue::Blue, units.iter().map(|unit| (from(&unit.0), to(unit))).collect()),
        Mark::Curve(Look::markers(Hue::Blue, Shape::Diamond), units.iter().map(to).collect()),
    ];
    (marks, times, longest_mm)
}

/// Returns the largest of 1, 2 and 5 times a power of ten that is at most `most`; 1 if there is none.
fn round_times(most: f64) -> f64 {
    if !most.is_finite() || most <= 0.0 {
        return 1.0;
    }
    let decade = 10f64.powf(most.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|step| step * decade).find(|times| *times <= most).unwrap_or(decade)
}

/// Returns the table of all outputs, closed until the reader opens it.
fn listed(spreads: &[OutputSpread]) -> Markup {
    let row = |(output, spread): (usize, &OutputSpread)| {
        let key = |what: &str| format!("output.{output}.{what}");
        let sd = spread.gain_percent[1];
        vec![
            words(output),
            number(&key("gain"), spread.gain_percent[0], 2, ""),
            if sd.is_finite() { number(&key("gain_sd"), sd, 2, "") } else { crate::report::frame::none() },
            number(&key("x_mm"), spread.moved_mm[0], 3, ""),
            number(&key("y_mm"), spread.moved_mm[1], 3, ""),
        ]
    };
    let head = ["output", "gain, %", "sd of the gain, %", "x, mm", "y, mm"].map(words);
    let rest = spreads.len().saturating_sub(LISTED_MOST);
    html! {
        details {
            summary { (counted(spreads.len(), "output")) ": means over the batch" }
            (table(&head, &(1..).zip(spreads).take(LISTED_MOST).map(row).collect::<Vec<_>>()))
            @if rest > 0 { p.note { (counted(rest, "further output")) "." } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacements_are_drawn_a_round_number_of_times_as_long() {
        assert_eq!([0.7, 1.0, 3.0, 49.0].map(round_times), [0.5, 1.0, 2.0, 20.0]);
        assert_eq!([0.0, f64::NAN, f64::INFINITY].map(round_times), [1.0; 3]);
    }

    #[test]
    fn channels_of_a_unit_count_as_one() {
        let spread = |gain: f64| OutputSpread { gain_percent: [gain, 1.0], moved_mm: [gain, 0.0] };
        let place = |x: f64| Place::new(x, 0.0);
        let units = by_place(&[1.0, 3.0, 5.0].map(spread), &[place(0.0), place(0.0), place(1.0)]);
        assert_eq!(units.iter().map(|(_, spread)| spread.gain_percent).collect::<Vec<_>>(), [[2.0, 1.0], [5.0, 1.0]]);
    }
}
