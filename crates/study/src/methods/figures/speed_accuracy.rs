//! Mean error as a function of the time of a solve.

use super::{FigureFile, bound_name, legend, look, methods};
use crate::methods::trial::CRAMER_RAO;
use crate::methods::{MethodRow, MethodTrial};
use palpate_report::chart::{Anchor, ChartAxis, Figure, Hue, LineStyle, Look, Mark, Panel};
use palpate_solver::BEST;

/// Draws one panel for each trial.
pub fn speed_accuracy_figures(trials: &[MethodTrial], found: &[MethodRow]) -> Vec<FigureFile> {
    let presses = found.iter().map(|row| row.calibration_presses).max().unwrap_or(0);
    let tests = found.iter().map(|row| row.points).max().unwrap_or(0);
    let panel = |trial: &MethodTrial| {
        let rows: Vec<&MethodRow> = found.iter().filter(|row| row.scene == trial.scene).collect();
        panel(&trial.text, &rows)
    };
    let to_the_right = "line to the right: an answer of palpate solve, which reads a line, watches for broken outputs and writes a line";
    let ringed = "ringed and joined: no other method is both faster and more exact";
    let figure = Figure {
        title: "Accuracy and solving time of each method".to_owned(),
        subtitle: format!(
            "calibrated with {presses} presses, {tests} test contacts; bars: 95 % of the mean; times on one core of {}",
            processor()
        ),
        height_px: 420.0,
        panels: trials.iter().map(panel).collect(),
        legend: legend(methods().filter(|(_, name)| name != BEST), 7),
        notes: [Some(to_the_right), Some(ringed), found.first().and_then(bound_name)]
            .into_iter()
            .flatten()
            .map(str::to_owned)
            .collect(),
        ..Figure::default()
    };
    vec![("speed-accuracy.svg".to_owned(), figure.svg())]
}

fn panel(text: &str, rows: &[&MethodRow]) -> Panel {
    let point = |row: &MethodRow| Some((row.ns_per_solve?, row.mean_mm()?));
    let ends = |row: &MethodRow| {
        let (mean_mm, within_mm) = (row.mean_mm()?, row.location_error_within_mm?);
        Some((mean_mm - within_mm, mean_mm + within_mm))
    };
    let answer = |row: &MethodRow| Some((row.ns_per_answer?, row.mean_mm()?));
    let points = || rows.iter().filter_map(|row| point(row));
    let bound = rows.first().and_then(|row| {
        let (mm, name) = (row.location_bound_mm?, if row.bound == Some(CRAMER_RAO) { "bound" } else { "stated" });
        Some((mm, format!("{name}: {mm:.3} mm")))
    });
    let errors_mm = points().map(|(_, mm)| mm).chain(rows.iter().filter_map(|row| ends(row)).flat_map(|(a, b)| [a, b]));
    let (first_ns, first_mm) = points().next().unwrap_or((1.0, 1.0));
    let times_ns = points().chain(rows.iter().filter_map(|row| answer(row))).map(|(ns, _)| ns);
    let x = ChartAxis::log("time per solve, ns", times_ns, (first_ns / 1.5, first_ns * 1.5));
    let y = ChartAxis::log(
        "location error, mean, mm",
        errors_mm.chain(bound.iter().map(|(mm, _)| mm / 1.3)),
        (first_mm, first_mm * 1.15),
    );
    let mut marks = vec![Mark::Title(text.to_owned())];
    if let Some((mm, text)) = bound {
        marks.push(Mark::Level(mm, String::new()));
        // to the left and below there is no method that is both faster and more accurate
        marks.push(Mark::Words((x.range.0, mm), (6.0, 15.0), Anchor::Start, text));
    }
    let mut front: Vec<(f64, f64)> =
        rows.iter().filter(|row| row.pareto == Some(true)).filter_map(|row| point(row)).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    front.dedup();
    marks.push(Mark::Curve(Look::line(Hue::Grey, LineStyle::Dashed), front.clone()));
    for row in rows {
        let Some(point) = point(row) else { continue };
        if row.solver == BEST {
            // toward the middle, where there is room for any time of a solve
            let is_left = point.0 < (x.range.0 * x.range.1).sqrt();
            let (right_px, anchor) = if is_left { (13.0, Anchor::Start) } else { (-13.0, Anchor::End) };
            marks.push(Mark::Words(point, (right_px, 4.0), anchor, "best".to_owned()));
            continue;
        }
        let look = Look { line: LineStyle::None, ..look(row.solver) };
        let strokes = ends(row).map(|(from, to)| ((point.0, from), (point.0, to)));
        let to_answer = answer(row).map(|answer| (point, answer));
        marks.push(Mark::Strokes(look.hue, strokes.into_iter().chain(to_answer).collect()));
        marks.push(Mark::Curve(look, vec![point]));
    }
    marks.extend(front.into_iter().map(Mark::Ring));
    Panel { x, y, marks }
}

/// Name of the processor, as Linux reports it.
fn processor() -> String {
    let about = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = about.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let name = name.map(|(_, name)| name.trim()).filter(|name| !name.is_empty());
    name.unwrap_or("this machine").replace("(R)", "").replace("(TM)", "")
}
