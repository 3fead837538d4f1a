//! Failures of methods: for each condition, a panel of errors and a panel of silent failures.

use super::{BOUND, FigureFile, look, methods_and_bound};
use crate::methods::conditions::{CONDITIONS, Harm, MEANINGS, ValueAxis};
use crate::methods::{MethodRow, NoiseReference, StudiedMethod, rows_of};
use palpate_report::chart::{ChartAxis, Figure, Grid, Mark, Panel};
use palpate_solver::{LOCATION_REFERENCE_MM, SOLVERS};

/// Number of panels in a row.
pub(super) const COLUMNS: usize = 4;
/// Fraction of silent failures up to which an axis keeps its range, %.
const LEAST_PERCENT: f64 = 5.0;

/// Draws one figure for each scene.
pub fn failure_figures(found: &[MethodRow]) -> Vec<FigureFile> {
    NoiseReference::ALL.map(|noise| (format!("failures-{}.svg", noise.name()), figure(noise, found).svg())).to_vec()
}

fn figure(noise: NoiseReference, found: &[MethodRow]) -> Figure {
    let points = found.first().map_or(0, |row| row.points);
    let presses = found.first().map_or(0, |row| row.calibration_presses);
    let panels = CONDITIONS.chunks(COLUMNS).flat_map(|harms| {
        let errors = harms.iter().map(|harm| errors(harm, noise, found));
        errors.chain(harms.iter().map(|harm| silent(harm, noise, found))).collect::<Vec<Panel>>()
    });
    Figure {
        title: format!("Where each method fails, and whether it reports that; {}", noise.text()),
        subtitle: format!(
            "above: mean error (dotted: 1 mm); below: share of answers off by more than 1 mm or 0.1 N and not flagged; calibrated \
             with 1 N at {presses} places on ±6 mm, {points} contacts at each value"
        ),
        height_px: 150.0,
        panels: panels.collect(),
        grid: Some(Grid { columns: COLUMNS, width_px: 1240.0, shared: false }),
        legend: vec![methods_and_bound().collect()],
        notes: MEANINGS.map(str::to_owned).to_vec(),
    }
}

fn errors(harm: &Harm, noise: NoiseReference, found: &[MethodRow]) -> Panel {
    let rows = || found.iter().filter(|row| row.scene == noise.name() && row.condition == harm.name);
    let values = rows().flat_map(|row| [row.mean_mm(), row.location_bound_mm]).flatten();
    let most_mm = rows().filter_map(MethodRow::mean_mm).fold(LOCATION_REFERENCE_MM, f64::max);
    // a bound beyond all errors doesn't apply to methods that know the area
    let y = ChartAxis::log("location error, mean, mm", values.map(|mm| mm.min(most_mm)), (0.9, LOCATION_REFERENCE_MM));
    let mut marks = vec![Mark::Title(harm.name.to_owned()), Mark::Level(LOCATION_REFERENCE_MM, String::new())];
    let is_inside = |mm: &f64| *mm <= y.range.1;
    let bound = curve(harm, noise, SOLVERS[0], found, |row| row.location_bound_mm.filter(is_inside));
    marks.push(Mark::Curve(BOUND, bound));
    marks.extend(
        StudiedMethod::names()
            .map(|solver| Mark::Curve(look(solver), curve(harm, noise, solver, found, MethodRow::mean_mm))),
    );
    Panel { x: axis(harm, false), y, marks }
}

fn silent(harm: &Harm, noise: NoiseReference, found: &[MethodRow]) -> Panel {
    let percent = |row: &MethodRow| row.wrong_unflagged.map(|share| 100.0 * share);
    let rows = found.iter().filter(|row| row.scene == noise.name() && row.condition == harm.name);
    let most = rows.filter_map(percent).fold(LEAST_PERCENT, f64::max);
    let marks =
        StudiedMethod::names().map(|solver| Mark::Curve(look(solver), curve(harm, noise, solver, found, percent)));
    Panel {
        x: axis(harm, true),
        y: ChartAxis::linear("wrong, not flagged, %", (0.0, 1.05 * most)),
        marks: marks.collect(),
    }
}

/// Returns the values of a method in the order of the axis.
pub(super) fn curve(
    harm: &Harm,
    noise: NoiseReference,
    solver: &str,
    found: &[MethodRow],
    value: impl Fn(&MethodRow) -> Option<f64>,
) -> Vec<(f64, f64)> {
    let rows = rows_of(found, noise.name(), solver, harm.name);
    let mut points: Vec<(f64, f64)> = rows.filter_map(|row| Some((row.value, value(row)?))).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// Axis of a condition's values.
pub(super) fn axis(harm: &Harm, labelled: bool) -> ChartAxis {
    let label = if labelled { harm.label } else { "" };
    let ends = harm.values.iter().fold((f64::MAX, f64::MIN), |(l, m), value| (l.min(*value), m.max(*value)));
    let room = 0.04 * (ends.1 - ends.0);
    match harm.spread {
        ValueAxis::Linear => ChartAxis::linear(label, (ends.0 - room, ends.1 + room)),
        ValueAxis::Log => ChartAxis::log(label, [], (ends.0 / 1.12, ends.1 * 1.12)),
        ValueAxis::Words(words) => {
            let names = words.iter().map(|word| (*word).to_owned()).collect();
            ChartAxis { label: label.to_owned(), ..ChartAxis::rows(names) }
        }
    }
}
