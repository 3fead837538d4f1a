//! Mean error as a function of the number of calibration presses.

use super::{BOUND, FigureFile, PAPER_MM, legend, look, methods, methods_and_bound};
use crate::methods::budget::{BUDGET, PRESS_S};
use crate::methods::{MethodRow, MethodTrial, NoiseReference, StudiedMethod, rows_of};
use palpate_report::chart::{AxisScale, ChartAxis, Figure, Mark, Panel};

/// Draws both scenes side by side.
pub fn budget_figures(found: &[MethodRow]) -> Vec<FigureFile> {
    let specimens = found.iter().map(|row| row.calibrations).max().unwrap_or(0);
    let tests = found.iter().map(|row| row.points).max().unwrap_or(0) / specimens.max(1);
    let figure = Figure {
        title: "Number of calibration presses that a method needs".to_owned(),
        subtitle: format!(
            "square grids of 1 N presses on ±6 mm; mean over {specimens} specimens of {tests} contacts each, 0.1 to 1 N"
        ),
        height_px: 420.0,
        panels: NoiseReference::ALL.map(|noise| panel(noise.name(), noise.text(), Some(PAPER_MM), found)).to_vec(),
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

/// Draws one panel of recorded presses.
pub fn budget_figures_of(trial: &MethodTrial, found: &[MethodRow]) -> Vec<FigureFile> {
    let draws = found.iter().map(|row| row.calibrations).max().unwrap_or(0);
    let has_bound = found.iter().any(|row| row.location_bound_mm.is_some());
    let figure = Figure {
        title: "Number of calibration presses that a method needs".to_owned(),
        subtitle: format!(
            "subsets of the {} recorded presses, spread over the area; mean over {draws} choices of them; {} test presses",
            trial.calibration.len(),
            trial.test.truths.len()
        ),
        height_px: 420.0,
        panels: vec![panel(&trial.scene, &trial.text, None, found)],
        legend: if has_bound { legend(methods_and_bound(), 5) } else { legend(methods(), 5) },
        ..Figure::default()
    };
    vec![("budget.svg".to_owned(), figure.svg())]
}

fn panel(scene: &str, text: &str, level_mm: Option<f64>, found: &[MethodRow]) -> Panel {
    let of = |solver| rows_of(found, scene, solver, BUDGET);
    let first = palpate_solver::SOLVERS[0];
    let mut ticks: Vec<(f64, String)> = Vec::new();
    for row in of(first) {
        let minutes = row.minutes.map(|minutes| match minutes < 0.995 {
            true => format!("\n{minutes:.1}"),
            false => format!("\n{minutes:.0}"),
        });
        ticks.push((row.value, format!("{}{}", row.value, minutes.unwrap_or_default())));
    }
    let ends = ticks.iter().fold((f64::MAX, 1.0f64), |(l, m), (value, _)| (l.min(*value), m.max(*value)));
    let has_minutes = of(first).any(|row| row.minutes.is_some());
    let x = ChartAxis {
        label: if has_minutes { "presses, and minutes below" } else { "presses" }.to_owned(),
        scale: AxisScale::LogAt(ticks),
        range: (ends.0.min(ends.1) / 1.15, ends.1 * 1.15),
    };
    let rows = || found.iter().filter(|row| row.scene == scene);
    let errors_mm = || rows().flat_map(|row| [row.mean_mm(), row.location_bound_mm]).flatten();
    let within_mm = level_mm.or_else(|| errors_mm().next()).unwrap_or(1.0);
    let y = ChartAxis::log("location error, mean, mm", errors_mm(), (within_mm, within_mm));
    let mut marks = vec![Mark::Title(text.to_owned())];
    marks.extend(level_mm.map(|level_mm| Mark::Level(level_mm, String::new())));
    let bound = of(first).filter_map(|row| Some((row.value, row.location_bound_mm?)));
    marks.push(Mark::Curve(BOUND, bound.collect()));
    marks.extend(StudiedMethod::names().map(|solver| {
        Mark::Curve(look(solver), of(solver).filter_map(|row| Some((row.value, row.mean_mm()?))).collect())
    }));
    Panel { x, y, marks }
}
