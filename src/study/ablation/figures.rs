//! The figures of the study: what each term changes, in per cent of the base's own number, so that one line across says for all
//! questions from where on a difference counts.

use super::rule::{Question, SHARE};
use super::terms::{TERMS, Touches};
use super::{AblationFindings, TermRow};
use crate::chart::{ChartAxis, Figure, Hue, Line, Look, Mark, Panel, Shape};

/// Height of a term's row, px.
const ROW_PX: f64 = 32.0;
/// From one question's mark to the next within a row, rows.
const APART: f64 = 0.24;

/// A file's name and the SVG.
pub fn ablation_figures(found: &AblationFindings) -> Vec<(String, String)> {
    let methods = figure(
        found,
        "What each term of a scene changes in the methods that solve",
        &[
            (
                "location error, mean",
                &[Question::PaperLocation, Question::SurrogateLocation, Question::PhysicsLocation],
            ),
            ("force error, mean", &[Question::PaperForce, Question::SurrogateForce, Question::PhysicsForce]),
        ],
    );
    let rig = figure(
        found,
        "What each term of a scene changes in Table 1 and in the press",
        &[
            (
                "Table 1, mean over units",
                &[Question::RepeatabilityLoading, Question::RepeatabilityUnloading, Question::Hysteresis],
            ),
            ("the press", &[Question::PressError, Question::PressPeak, Question::PressTime]),
        ],
    );
    vec![("ablation-methods.svg".to_owned(), methods.svg()), ("ablation-rig.svg".to_owned(), rig.svg())]
}

fn figure(found: &AblationFindings, title: &str, panels: &[(&str, &[Question])]) -> Figure {
    let asked = || panels.iter().flat_map(|(_, questions)| questions.iter().copied());
    // rows only of terms that can touch any of it
    let names: Vec<&'static str> =
        TERMS.iter().filter(|term| asked().any(|question| term.touches(question.of()))).map(|term| term.name).collect();
    Figure {
        title: title.to_owned(),
        subtitle: format!("on less off, in % of the base's own number; bars: 95 % over {} seeds", found.size.seeds),
        height_px: ROW_PX * names.len() as f64,
        panels: panels.iter().map(|(told, questions)| panel(found, told, questions, &names)).collect(),
        legend: legend(panels),
        notes: vec![
            pressed(found, panels),
            format!(
                "base: the scene of rigs/paper.toml. Dotted: beyond ±{:.0} % a difference counts, or beyond a floor that is drawn there",
                100.0 * SHARE
            ),
            "no mark: the term can't touch it by construction".to_owned(),
        ],
        ..Figure::default()
    }
}

/// A line where the marks of all panels mean the same, else one a panel.
fn legend(panels: &[(&str, &[Question])]) -> Vec<Vec<(Look, String)>> {
    let line = |(_, questions): &(&str, &[Question])| -> Vec<(Look, String)> {
        questions.iter().enumerate().map(|(index, question)| (look(index), name(*question).to_owned())).collect()
    };
    let mut lines: Vec<_> = panels.iter().map(line).collect();
    lines.dedup();
    if lines.len() > 1 {
        for (line, (told, _)) in lines.iter_mut().zip(panels) {
            let whose = told.split(',').next().unwrap_or(told);
            line.iter_mut().take(1).for_each(|(_, name)| *name = format!("{whose}: {name}"));
        }
    }
    lines
}

/// What was pressed for it.
fn pressed(found: &AblationFindings, panels: &[(&str, &[Question])]) -> String {
    let size = found.size;
    match panels.first().and_then(|(_, questions)| questions.first()).map(|question| question.of()) {
        Some(Touches::Methods) => format!(
            "calibrated with 1 N at {} places on ±6 mm; {} test contacts of 0.1 to 1 N anywhere there",
            size.side * size.side,
            size.tests
        ),
        _ => format!(
            "Table 1: five staircases to 2 N above each unit; the press: 1 N ± 50 mN at {} places 0.5 mm apart, by the strategy guarded",
            size.presses * size.presses
        ),
    }
}

fn panel(found: &AblationFindings, told: &str, questions: &[Question], names: &[&'static str]) -> Panel {
    let row = |name: &str, question| found.row(name, question);
    let every = || names.iter().flat_map(|name| questions.iter().filter_map(|question| row(name, *question)));
    let ends =
        every().map(percents).fold((-15.0f64, 15.0f64), |(least, most), (from, _, to)| (least.min(from), most.max(to)));
    let room = 0.06 * (ends.1 - ends.0);
    let counts = 100.0 * SHARE;
    let mut marks =
        vec![Mark::Title(told.to_owned()), Mark::At(-counts, String::new()), Mark::At(counts, String::new())];
    for (index, question) in questions.iter().enumerate() {
        let aside = APART * (index as f64 - (questions.len() as f64 - 1.0) / 2.0);
        let look = look(index);
        let found = names.iter().enumerate().filter_map(|(at, name)| Some((at as f64 + aside, row(name, *question)?)));
        let (mut bars, mut points) = (Vec::new(), Vec::new());
        for (y, row) in found {
            let (from, middle, to) = percents(row);
            bars.push(Mark::Curve(Look { shape: None, ..look }, vec![(from, y), (to, y)]));
            points.push((middle, y));
        }
        marks.extend(bars);
        marks.push(Mark::Curve(Look { line: Line::None, ..look }, points));
    }
    Panel {
        x: ChartAxis::linear("on less off, % of the base's number", (ends.0 - room, ends.1 + room)),
        y: ChartAxis::rows(names.iter().map(|name| (*name).to_owned()).collect()),
        marks,
    }
}

/// Where a row's interval begins, its middle and where it ends, % of the base's number; in that measure a difference counts from
/// the rule's share on.
fn percents(row: &TermRow) -> (f64, f64, f64) {
    let percent = |difference: f64| 100.0 * SHARE * difference / row.counts_from;
    let super::Effect { difference, within, .. } = row.effect;
    (percent(difference - within), percent(difference), percent(difference + within))
}

fn look(index: usize) -> Look {
    let (hue, shape) = [(Hue::Blue, Shape::Circle), (Hue::Green, Shape::Diamond), (Hue::Red, Shape::Square)][index % 3];
    Look { hue, shape: Some(shape), filled: true, line: Line::Solid }
}

fn name(question: Question) -> &'static str {
    match question {
        Question::PaperLocation | Question::PaperForce => "the paper's",
        Question::SurrogateLocation | Question::SurrogateForce => "surrogate",
        Question::PhysicsLocation | Question::PhysicsForce => "physics",
        Question::RepeatabilityLoading => "repeatability, loading",
        Question::RepeatabilityUnloading => "repeatability, unloading",
        Question::Hysteresis => "hysteresis",
        Question::PressError => "force error in the window",
        Question::PressPeak => "peak over the set force",
        Question::PressTime => "time",
    }
}
