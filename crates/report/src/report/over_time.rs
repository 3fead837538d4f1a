//! What a sensor does while it is followed: creep under a load, and noise without load.

use super::figures::column;
use super::frame::{PageFigure, Section, none, number, table, words};
use super::numbers::{NumberCell, Numbers};
use super::{Subject, ramps, waves};
use crate::chart::{ChartAxis, Hue, LineStyle, Look, Mark, Panel, Shape};
use maud::{Markup, html};
use palpate_data::dataset::{DatasetError, Followed, followed};
use palpate_data::recipe::Phase;
use palpate_solver::over_time::{Relaxation, Term, allan_deviation, relaxation};

/// Largest number of points that are drawn of a curve.
const MOST_POINTS: usize = 400;

/// Largest number of presses for which the creep is drawn. The table has all.
const MOST_DRAWN: usize = 4;

pub(super) const FORCE: Look = line(Hue::Ink);
pub(super) const OUTPUT: Look = line(Hue::Blue);

const fn line(hue: Hue) -> Look {
    Look { hue, shape: None, filled: false, line: LineStyle::Solid }
}

type Points = Vec<(f64, f64)>;

/// Creates the sections of a run with levels that were followed.
pub(super) fn sections(subject: &Subject) -> Vec<Section> {
    // reads the file of each run once
    let (mut all, mut unread): (Vec<Followed>, Vec<Section>) = (Vec::new(), Vec::new());
    for run in &subject.runs {
        match followed(run) {
            Ok(of_run) => all.extend(of_run),
            Err(error) => unread.push(unreadable(&error)),
        }
    }
    let of_phase = |phase: Phase| -> Vec<&Followed> { all.iter().filter(|followed| followed.phase == phase).collect() };
    [
        creep(&of_phase(Phase::Creep)),
        ramps::section(&of_phase(Phase::Ramp)),
        waves::section(&of_phase(Phase::Wave)),
        rest(&of_phase(Phase::Rest)),
    ]
    .into_iter()
    .flatten()
    .chain(unread)
    .collect()
}

/// Creates a section that states why what was followed is missing on the page.
fn unreadable(error: &DatasetError) -> Section {
    let before = html! { p.note { "The readings over time are missing on this page: " (error) ". `palpate verify` checks the file." } };
    Section::new("Readings over time", &before, Vec::new())
}

/// Creates the section of the levels that were followed under load.
fn creep(all: &[&Followed]) -> Option<Section> {
    if all.is_empty() {
        return None;
    }
    let mut rows = Vec::new();
    for followed in all {
        // a force that was restored doesn't relax
        for (name, [t_s, values]) in quantities(followed).into_iter().skip(usize::from(followed.holds_force)) {
            let Ok(found) = relaxation(t_s, values) else { continue };
            let first = found.final_value + found.terms.iter().map(|term| term.amplitude).sum::<f64>();
            let percent = 100.0 * (found.final_value - first) / first;
            let of_term = |index: usize| found.terms.get(index).map_or_else(none, time_constant);
            rows.push(vec![
                words(format!("{} at {}, {} mm", followed.press, followed.place.x_mm, followed.place.y_mm)),
                words(name),
                number("creep_percent", percent, 2, ""),
                of_term(0),
                of_term(1),
                undetermined(&found),
            ]);
        }
    }
    let head =
        ["press", "quantity", "change, %", "shorter time constant, s", "longer time constant, s", "longer still"];
    let note = html! {
        (table(&head.map(words), &rows))
        p.note {
            "z rested at the depth of the press, from the end of its window, or the force was restored every second. The change is that of the sum of one or two exponentials, from the "
            "first reading to the value that it tends to. Time constants have their 95 % interval; those without noise that is white are wider. "
            "A change that continues for longer than it was followed has no time constant here."
        }
    };
    Section::of_figures(
        "Creep under load",
        &note,
        all.iter().take(MOST_DRAWN).map(|followed| drawn(followed)).collect(),
    )
}

fn quantities(followed: &Followed) -> [(String, &[Vec<f64>; 2]); 2] {
    [("force".to_owned(), &followed.force_n), (format!("output {}", followed.output), &followed.values)]
}

fn time_constant(term: &Term) -> Markup {
    let [from_s, to_s] = term.time_interval_s;
    html! { (number("time_s", term.time_s, 3, "")) " (" (format!("{from_s:.3}")) " to " (format!("{to_s:.3}")) ")" }
}

fn undetermined(found: &Relaxation) -> Markup {
    words(if found.undetermined { "yes" } else { "no" })
}

/// Draws force and output of a press in percent of their first values.
fn drawn(followed: &Followed) -> PageFigure {
    let mut marks = Vec::new();
    let mut rows = Vec::new();
    let (mut least, mut most) = (100.0f64, 100.0f64);
    for (look, (name, [t_s, values])) in [FORCE, OUTPUT].into_iter().zip(quantities(followed)) {
        let means = means(t_s, values);
        let Some((_, first)) = means.first().copied() else { continue };
        let points: Points = means.iter().map(|(t_s, value)| (*t_s, 100.0 * value / first)).collect();
        least = points.iter().map(|(_, percent)| *percent).fold(least, f64::min);
        most = points.iter().map(|(_, percent)| *percent).fold(most, f64::max);
        rows.extend(means.iter().map(|(t_s, value)| {
            vec![NumberCell::Words(name.clone()), NumberCell::Number(*t_s), NumberCell::Number(*value)]
        }));
        marks.push(Mark::Curve(look, points));
    }
    let span_s = followed.force_n[0].last().copied().unwrap_or(1.0);
    let room = 0.1 * (most - least).max(0.1);
    let output = format!("output {}", followed.output);
    let held = if followed.holds_force { "the force was restored" } else { "z rested" };
    let panel = Panel {
        x: ChartAxis::linear("time since the window, s", (0.0, span_s)),
        y: ChartAxis::linear("part of the first value, %", (least - room, most + room)),
        marks,
    };
    let figure = column(
        format!("Press {} at {}, {} mm", followed.press, followed.place.x_mm, followed.place.y_mm),
        &format!("force and the output that answers it most; {held}"),
        vec![panel],
        vec![vec![(FORCE, "force".to_owned()), (OUTPUT, output)]],
    );
    let name = format!("creep-{}", followed.press);
    PageFigure::plain(figure).named(&name).with(Numbers::new(&["quantity", "t_s", "value"], rows))
}

/// Returns the means of parts of a series, each with its mean time.
pub(super) fn means(t_s: &[f64], values: &[f64]) -> Points {
    let size = t_s.len().div_ceil(MOST_POINTS).max(1);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    t_s.chunks(size).zip(values.chunks(size)).map(|(t_s, values)| (mean(t_s), mean(values))).collect()
}

/// Creates the section of the noise without load.
fn rest(all: &[&Followed]) -> Option<Section> {
    let mut rows = Vec::new();
    let mut drawn = Vec::new();
    for followed in all {
        let (mut marks, mut legend, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
        let mut all_points: Points = Vec::new();
        for (look, (name, [t_s, values])) in [FORCE, OUTPUT].into_iter().zip(quantities(followed)) {
            let span_s = t_s.last().zip(t_s.first()).map_or(0.0, |(last, first)| last - first);
            let points = allan_deviation(span_s / (t_s.len().max(2) - 1) as f64, values);
            let positive = points.iter().filter(|point| point.deviation > 0.0);
            let curve: Points = positive.map(|point| (point.tau_s, point.deviation)).collect();
            let Some(lowest) = curve.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            let unit = if name == "force" { 1000.0 } else { 1.0 };
            rows.push(vec![
                words(followed.press),
                words(if name == "force" { "force, mN".to_owned() } else { name.clone() }),
                number("noise", unit * curve[0].1, 5, ""),
                number("least", unit * lowest.1, 5, ""),
                number("least_at_s", lowest.0, 2, ""),
            ]);
            // relative to the shortest time, so that a force and an output share an axis
            let relative: Points = curve.iter().map(|(tau_s, deviation)| (*tau_s, deviation / curve[0].1)).collect();
            all_points.extend(&relative);
            numbers.extend(curve.iter().map(|(tau_s, deviation)| {
                vec![NumberCell::Words(name.clone()), NumberCell::Number(*tau_s), NumberCell::Number(*deviation)]
            }));
            let look = Look { shape: Some(Shape::Circle), ..look };
            legend.push((look, name));
            marks.push(Mark::Curve(look, relative));
        }
        if marks.is_empty() {
            continue;
        }
        let panel = Panel {
            x: ChartAxis::log("time of a mean, s", all_points.iter().map(|point| point.0), (0.1, 1.0)),
            y: ChartAxis::log("relative deviation", all_points.iter().map(|point| point.1), (0.1, 1.0)),
            marks,
        };
        let figure = column(
            format!("Allan deviation at press {}", followed.press),
            "how far means of successive times differ, relative to the shortest time; a line that falls is noise, one that rises drift",
            vec![panel],
            vec![legend],
        );
        let named = PageFigure::plain(figure).named(&format!("allan-{}", followed.press));
        drawn.push(named.with(Numbers::new(&["quantity", "tau_s", "deviation"], numbers)));
    }
    let head = ["press", "quantity", "noise of one reading", "least deviation of a mean", "at a time of, s"];
    let note = html! { (table(&head.map(words), &rows)) };
    Section::of_figures("Noise and drift without load", &note, drawn)
}
