//! Mean error against the presses of a calibration.

use super::{BOUND, Drawn, PAPER_MM, legend, look, methods_and_bound};
use crate::chart::{ChartAxis, Figure, Mark, Panel, Scale};
use crate::study::methods::budget::{BUDGET, PRESS_S};
use crate::study::methods::{Method, MethodRow, NoiseReference, rows_of};

/// Both scenes side by side.
pub fn budget_figures(found: &[MethodRow]) -> Vec<Drawn> {
    let specimens = found.iter().map(|row| row.calibrations).max().unwrap_or(0);
    let tests = found.iter().map(|row| row.points).max().unwrap_or(0) / specimens.max(1);
    let figure = Figure {
        title: "How many calibration presses a method needs".to_owned(),
        subtitle: format!(
            "square grids of 1 N presses on ±6 mm; mean over {specimens} specimens of {tests} contacts each, 0.1 to 1 N"
        ),
        height_px: 420.0,
        panels: NoiseReference::ALL.map(|noise| panel(noise, found)).to_vec(),
        legend: legend(methods_and_bound(), 5),
        notes: vec![
            format!("dotted: the paper's own mean error with 625 presses, {PAPER_MM} mm"),
            format!(
                "minutes: {PRESS_S} s a press, as `palpate study control` measures on the fast bench by the strategy map, 10 mN, \
                 0.5 mm apart"
            ),
            "from specimen to specimen, gains differ by ±20 %, depths by ±5 %, places by ±0.1 mm along x and y"
                .to_owned(),
        ],
        ..Figure::default()
    };
    vec![("budget.svg".to_owned(), figure.svg())]
}

fn panel(noise: NoiseReference, found: &[MethodRow]) -> Panel {
    let of = |solver| rows_of(found, noise.name(), solver, BUDGET);
    let mut ticks: Vec<(f64, String)> = Vec::new();
    for row in of(crate::solver::SOLVERS[0]) {
        let minutes = row.minutes.unwrap_or(0.0);
        let told = if minutes < 0.995 { format!("{minutes:.1}") } else { format!("{minutes:.0}") };
        ticks.push((row.value, format!("{}\n{told}", row.value)));
    }
    let ends = ticks.iter().fold((f64::MAX, 1.0f64), |(l, m), (value, _)| (l.min(*value), m.max(*value)));
    let x = ChartAxis {
        label: "presses, and minutes below".to_owned(),
        scale: Scale::LogAt(ticks),
        range: (ends.0.min(ends.1) / 1.15, ends.1 * 1.15),
    };
    let rows = || found.iter().filter(|row| row.scene == noise.name());
    let errors_mm = rows().flat_map(|row| [row.mean_mm(), row.location_bound_mm]).flatten();
    let y = ChartAxis::log("location error, mean, mm", errors_mm, (PAPER_MM, PAPER_MM));
    let mut marks = vec![
        Mark::Title(noise.told().to_owned()),
        Mark::Level(PAPER_MM, String::new()),
        Mark::Curve(
            BOUND,
            of(crate::solver::SOLVERS[0]).filter_map(|row| Some((row.value, row.location_bound_mm?))).collect(),
        ),
    ];
    marks.extend(Method::names().map(|solver| {
        Mark::Curve(look(solver), of(solver).filter_map(|row| Some((row.value, row.mean_mm()?))).collect())
    }));
    Panel { x, y, marks }
}
