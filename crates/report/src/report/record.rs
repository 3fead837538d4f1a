//! Control of the force: error, overshoot and time of every press.

use super::Subject;
use super::frame::{PageFigure, Section, none, number, table, words};
use crate::chart::{ChartAxis, Figure, Grid, Hue, LineStyle, Look, Mark, Panel, Shape};
use maud::{Markup, html};
use palpate_data::dataset::{Press, Recorded, RecordedContact};
use palpate_data::recipe::Phase;
use palpate_solver::ErrorSummary;

/// Force errors of one row, mN, with the press' number in its page.
struct Controlled {
    phase: Phase,
    press: f64,
    error_mn: f64,
    /// Largest true force minus the set force; known only in a simulation.
    over_mn: Option<f64>,
}

/// Phases, with the look of each and the name of the item.
const PHASES: [(Phase, Hue, Shape); 7] = [
    (Phase::Characterisation, Hue::Green, Shape::Triangle),
    (Phase::Calibration, Hue::Blue, Shape::Circle),
    (Phase::Test, Hue::Orange, Shape::Square),
    (Phase::Creep, Hue::Green, Shape::Square),
    (Phase::Ramp, Hue::Orange, Shape::Triangle),
    (Phase::Cycles, Hue::Blue, Shape::Triangle),
    (Phase::Wave, Hue::Ink, Shape::Circle),
];

/// Largest number of points that are drawn for a phase. If there are more, every nth point is drawn.
const MOST_POINTS: usize = 1000;

/// Creates a table of the phases, and figures of every press.
pub(super) fn section(subject: &Subject) -> Option<Section> {
    let (held, times) = (held(&subject.runs), times_s(&subject.runs));
    if held.is_empty() {
        return None;
    }
    let (head, rows) = quantities(&held, &times);
    let errors: Vec<(Phase, f64, f64)> = held.iter().map(|held| (held.phase, held.press, held.error_mn)).collect();
    let overshoots: Vec<(Phase, f64, f64)> =
        held.iter().filter_map(|held| Some((held.phase, held.press, held.over_mn?))).collect();
    let drifts = drifts(&subject.runs);
    let drawn = [
        ("press-force-errors", "Force in the window minus the set force", "force error, mN", &errors, true),
        ("press-overshoots", "Largest true force minus the set force", "overshoot, mN", &overshoots, true),
        ("press-zero-drift", "Drift of the load cell's zero", "zero drift, mN", &drifts, true),
        ("press-times", "Time of each press", "time, s", &times, false),
    ];
    let drawn: Vec<PageFigure> = drawn
        .into_iter()
        .filter_map(|(stem, title, label, points, is_about_0)| {
            by_press(title, label, points, is_about_0, 0.0)?.named(stem).into()
        })
        .collect();
    let before = html! {
        (table(&head, &rows))
        p.note { "Force error: the load cell's mean in the window minus the set force. On loading it is negative by intention, except "
            "with the strategy map: the force is increased from below and stops about four standard deviations of a measured force "
            "short, so that the true force does not exceed the set force. A sensor that relaxes loses some more force until the window." }
        p.note { "The true force is known only in a simulated run; negative: it stayed below the set force. Zero drift: forces count from "
            "the readings without load before and after each press, so it is not in them. Time: from one window to the next of the same phase. Flagged "
            "presses are included." @if subject.has_drags() { " The time of a press includes its drag." } }
    };
    Some(Section::new("Force control", &before, drawn))
}

/// Returns a column for each phase, and a row for each quantity.
fn quantities(held: &[Controlled], times: &[(Phase, f64, f64)]) -> (Vec<Markup>, Vec<Vec<Markup>>) {
    let mut head = vec![words("")];
    let names = [
        "levels held",
        "force error, mean, mN",
        "size of the force error, 95th percentile, mN",
        "size of the force error, largest, mN",
        "largest true force minus the set force, mN",
        "time of a press, median, s",
    ];
    let mut rows: Vec<Vec<Markup>> = names.iter().map(|name| vec![words(name)]).collect();
    for (phase, ..) in PHASES {
        let of_it: Vec<&Controlled> = held.iter().filter(|held| held.phase == phase).collect();
        let sizes: Vec<f64> = of_it.iter().map(|held| held.error_mn.abs()).collect();
        let Some(size) = ErrorSummary::of(&sizes) else { continue };
        let mean_mn = of_it.iter().map(|held| held.error_mn).sum::<f64>() / of_it.len() as f64;
        let over_mn = of_it.iter().filter_map(|held| held.over_mn).reduce(f64::max);
        let time =
            ErrorSummary::of(&times.iter().filter(|time| time.0 == phase).map(|time| time.2).collect::<Vec<_>>());
        let cell = |value: Option<f64>, digits: usize| value.map_or_else(none, |value| number("", value, digits, ""));
        let cells = [
            words(of_it.len()),
            cell(Some(mean_mn), 1),
            cell(Some(size.p95), 1),
            cell(Some(size.max), 1),
            cell(over_mn, 1),
            cell(time.map(|time| time.median), 2),
        ];
        head.push(words(phase.name()));
        rows.iter_mut().zip(cells).for_each(|(row, cell)| row.push(cell));
    }
    (head, rows)
}

fn held(runs: &[Recorded]) -> Vec<Controlled> {
    let mut held = Vec::new();
    for (index, contact) in presses(runs) {
        let known = |press: &Press| Some((press.phase?, press.force_set_n?, press.force_n?));
        // the pressing force isn't controlled in a drag
        let levels = || contact.levels.iter().filter(|press| !press.is_dragged());
        for (level, (phase, force_set_n, force_n)) in levels().filter_map(known).enumerate() {
            if force_set_n <= 0.0 || PHASES.iter().all(|(its, ..)| *its != phase) {
                continue;
            }
            let to_mn = |force_n: f64| 1000.0 * (force_n - force_set_n);
            // on the way down the peak is that of the level before
            let truth = contact.truth.get(level).filter(|_| levels().count() == 1);
            let over_mn = truth.map(|truth| to_mn(truth.force_peak_n));
            held.push(Controlled { phase, press: index, error_mn: to_mn(force_n), over_mn });
        }
    }
    held
}

/// Returns phase, press, and the move of the load cell's reading without load since the run began, mN.
fn drifts(runs: &[Recorded]) -> Vec<(Phase, f64, f64)> {
    let mut drifts = Vec::new();
    let mut presses = presses(runs);
    for run in runs.iter().filter(|run| !run.manifest.facts.without_load_cell) {
        let first_n = run.contacts.first().map_or(0.0, |first| first.no_load_before.force.mean_n);
        for (press, contact) in presses.by_ref().take(run.contacts.len()) {
            let phase = contact.levels.first().and_then(|level| level.phase);
            let moved_mn = 1000.0 * (contact.no_load_after.force.mean_n - first_n);
            drifts.extend(phase.map(|phase| (phase, press, moved_mn)));
        }
    }
    drifts
}

/// Returns phase, press, and time since the previous window, s. The previous window must be that of the previous press and of the
/// same phase. Staircases have a rest between them.
fn times_s(runs: &[Recorded]) -> Vec<(Phase, f64, f64)> {
    let of = |contact: &RecordedContact| {
        let mut levels = contact.levels.iter().filter(|press| !press.is_dragged());
        levels.next().filter(|_| levels.next().is_none()).and_then(|press| press.phase.zip(press.t_s))
    };
    let pairs = presses(runs).zip(presses(runs).skip(1));
    pairs
        .filter_map(|((_, before), (press, this))| {
            let ((phase_before, before_s), (phase, this_s)) = (of(before)?, of(this)?);
            (phase_before == phase && this_s > before_s).then_some((phase, press, this_s - before_s))
        })
        .collect()
}

/// Returns all contacts with their numbers in the page, from 1.
pub(super) fn presses(runs: &[Recorded]) -> impl Iterator<Item = (f64, &RecordedContact)> {
    runs.iter().flat_map(|run| &run.contacts).enumerate().map(|(index, contact)| ((index + 1) as f64, contact))
}

fn look(hue: Hue, shape: Shape) -> Look {
    Look { hue, shape: Some(shape), filled: false, line: LineStyle::None }
}

/// Returns one panel of points by press, with a mark for each phase that has points. The upright axis begins at `from`, or at a smaller
/// value. `None` if there are no points.
pub(super) fn by_press(
    title: &str,
    label: &str,
    points: &[(Phase, f64, f64)],
    is_about_0: bool,
    from: f64,
) -> Option<PageFigure> {
    let value = |(_, _, value): &(Phase, f64, f64)| *value;
    let largest = points.iter().map(value).reduce(f64::max)?;
    let most = if is_about_0 { largest.max(0.0) } else { largest };
    let least = points.iter().map(value).fold(from, f64::min);
    let room = if most > least { 0.05 * (most - least) } else { 0.5 };
    let last = points.iter().map(|(_, press, _)| *press).fold(1.0, f64::max);
    let mut marks: Vec<Mark> = Vec::new();
    let mut legend = Vec::new();
    for (phase, hue, shape) in PHASES {
        let of_it: Vec<(f64, f64)> =
            points.iter().filter(|point| point.0 == phase).map(|(_, press, value)| (*press, *value)).collect();
        if !of_it.is_empty() {
            let one_in = of_it.len().div_ceil(MOST_POINTS);
            marks.push(Mark::Curve(look(hue, shape), of_it.into_iter().step_by(one_in).collect()));
            legend.push((look(hue, shape), phase.name().to_owned()));
        }
    }
    if is_about_0 {
        marks.push(Mark::Level(0.0, String::new()));
    }
    let x = ChartAxis::count("press", (0.0, 1.02 * last));
    let y = ChartAxis::linear(label, (least - if least == 0.0 { 0.0 } else { room }, most + room));
    let grid = Some(Grid { columns: 1, width_px: super::figures::WIDTH_PX, shared: false });
    let panels = vec![Panel { x, y, marks }];
    let figure =
        Figure { title: title.to_owned(), height_px: 220.0, panels, grid, legend: vec![legend], ..Figure::default() };
    Some(PageFigure::plain(figure))
}
