//! Error of a new sensor against its presses, and against minutes at the bench.

use super::super::methods::specimen::NoiseReference;
use super::super::minutes::HANDLING_MIN;
use super::presses::{FewRow, Way};
use palpate_report::chart::{ChartAxis, Figure, Hue, LineStyle, Look, Mark, Panel, Shape};

/// Ways that are drawn, and their names.
const DRAWN: [(Way, &str); 5] = [
    (Way::PriorCells, "with the prior, cell centres"),
    (Way::PriorChosen, "with the prior, each place chosen"),
    (Way::Cells, "without a prior, cell centres"),
    (Way::Grid, "without a prior, grid to the borders"),
    (Way::Paper, "the paper's method, 625 presses"),
];

/// Returns the figure for each noise: the name of its file and the SVG.
pub fn few_figures(found: &[FewRow]) -> Vec<(String, String)> {
    let scenes = NoiseReference::ALL.into_iter();
    scenes.map(|noise| (format!("few-{}.svg", noise.name()), figure(noise, found).svg())).collect()
}

fn figure(noise: NoiseReference, found: &[FewRow]) -> Figure {
    let sensors = found.iter().map(|row| row.sensors).max().unwrap_or(0);
    let without = found.iter().filter(|row| row.way == Way::Grid).map(|row| row.sensors).max().unwrap_or(0);
    Figure {
        title: "Accuracy of a new sensor of a known design".to_owned(),
        subtitle: format!(
            "prior of five full calibrations; {sensors} new sensors, {without} without a prior; presses of 1 N, contacts of 0.1 to \
             1 N; {}",
            noise.text()
        ),
        height_px: 380.0,
        panels: vec![
            panel(noise, found, "presses", (1.0, 2.0), |row| Some(row.presses as f64)),
            panel(noise, found, "minutes at the bench", (HANDLING_MIN, 1.1 * HANDLING_MIN), |row| row.minutes),
        ],
        legend: DRAWN.map(|(way, name)| (look(way), name.to_owned())).chunks(3).map(<[_]>::to_vec).collect(),
        notes: vec![
            format!(
                "minutes: {HANDLING_MIN} of handling, and those of the run, simulated on the fast bench by the strategy map"
            ),
            "from sensor to sensor, gains differ by ±20 %, depths by ±5 %, places by ±0.1 mm; bonded layer".to_owned(),
        ],
        ..Figure::default()
    }
}

fn panel(
    noise: NoiseReference,
    found: &[FewRow],
    label: &str,
    within: (f64, f64),
    at: fn(&FewRow) -> Option<f64>,
) -> Panel {
    let rows = || found.iter().filter(|row| row.scene == noise.name());
    let point = |row: &FewRow| Some((at(row)?, row.location_error_mm));
    let drawn = || rows().filter(|row| DRAWN.iter().any(|(way, _)| *way == row.way)).filter_map(point);
    let x = ChartAxis::log(label, drawn().map(|point| point.0), within);
    let y = ChartAxis::log("location error, mean, mm", drawn().map(|point| point.1), (0.1, 1.0));
    let of = |way| rows().filter(move |row| row.way == way).filter_map(point).collect::<Vec<_>>();
    Panel { x, y, marks: DRAWN.map(|(way, _)| Mark::Curve(look(way), of(way))).to_vec() }
}

fn look(way: Way) -> Look {
    let (hue, shape, line) = match way {
        Way::PriorCells => (Hue::Green, Shape::Circle, LineStyle::Solid),
        Way::PriorChosen => (Hue::Blue, Shape::Triangle, LineStyle::Dashed),
        Way::Cells => (Hue::Orange, Shape::Circle, LineStyle::Solid),
        Way::Paper => (Hue::Grey, Shape::Diamond, LineStyle::None),
        _ => (Hue::Orange, Shape::Square, LineStyle::Dashed),
    };
    Look { hue, shape: Some(shape), filled: !matches!(way, Way::Grid), line }
}
