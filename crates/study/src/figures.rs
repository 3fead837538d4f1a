//! Figures of the study's results.

use super::StudyBench;
use super::condition::{ConditionOutcome, StudyPart};
use super::control::{LoopFindings, MISMATCHES, SLOW_N_MM, SLOW_SIDE, TOLERANCES_N};
use super::scenes::SCENES;
use super::stability::{self, OVERSHOOTS_AT, UNSTABLE_AT};
use palpate_control::{GAIN_TIMES_DEAD_TIME, Strategy};
use palpate_report::chart::{Anchor, ChartAxis, Figure, Hue, LineStyle, Look, Mark, Panel, Shape};
use palpate_report::paper;

/// Mean location error in the paper, mm.
const PAPER_MM: f64 = paper::LOCATION_ERROR_MM;

/// One number of an outcome, if the outcome has it.
type OutcomeValue = fn(&ConditionOutcome) -> Option<f64>;

/// Returns every figure: a file's name and the SVG.
pub fn figures(findings: &LoopFindings) -> Vec<(String, String)> {
    let drawn = [
        ("1-time-error.svg", time_and_error(findings)),
        ("2-stability.svg", stability_map(findings)),
        ("3-scenes.svg", scenes(findings)),
        ("4-caution.svg", caution(findings)),
        ("5-calibration.svg", calibration(findings)),
        ("6-stages.svg", stages(findings)),
    ];
    drawn.map(|(name, figure)| (name.to_owned(), figure.svg())).to_vec()
}

/// Figure of time per press against force error, for each strategy on each bench.
fn time_and_error(findings: &LoopFindings) -> Figure {
    let whole = || findings.of(StudyPart::Tolerance).filter(|outcome| outcome.rule.is_none());
    let point = |outcome: &ConditionOutcome| Some((outcome.median_s?, outcome.error_p95_mn?));
    let bound_s = whole().next().map_or(1.0, |outcome| outcome.bound_s);
    let x = ChartAxis::log("time per press, median, s", whole().filter_map(point).map(|p| p.0), (bound_s / 1.1, 1.0));
    let y = ChartAxis::log("force error, 95th percentile, mN", whole().filter_map(point).map(|p| p.1), (2.0, 10.0));
    let mut marks = vec![Mark::At(bound_s, format!("least possible time: {bound_s:.3} s"))];
    let mut legend = Vec::new();
    for bench in StudyBench::ALL {
        for strategy in Strategy::ALL {
            let of_it: Vec<&ConditionOutcome> =
                whole().filter(|outcome| outcome.rig == bench.name() && outcome.strategy == strategy).collect();
            let look = look(strategy, bench);
            marks.push(Mark::Curve(look, of_it.iter().filter_map(|outcome| point(outcome)).collect()));
            for (at, tolerances) in alike(&of_it, point) {
                marks.push(Mark::Words(at, (11.0, -4.0), Anchor::Start, tolerances));
            }
            let best = of_it.iter().filter(|outcome| outcome.pareto == Some(true)).filter_map(|outcome| point(outcome));
            marks.extend(best.map(Mark::Ring));
            legend.push((look, format!("{}, {}", strategy.name(), bench.name())));
        }
    }
    Figure {
        title: "Speed and accuracy: 1 N at one place after another".to_owned(),
        subtitle: format!(
            "{0} x {0} places 0.5 mm apart, window 0.1 s; errors by the simulated truth, teaching presses excluded",
            findings.size.main
        ),
        height_px: 420.0,
        panels: vec![Panel { x, y, marks }],
        legend: legend.chunks(Strategy::ALL.len()).map(<[_]>::to_vec).collect(),
        notes: with_left_out(
            vec![
                "next to a point: the set tolerances, mN; ringed: nothing on its bench is both faster and more exact"
                    .to_owned(),
            ],
            findings,
            StudyPart::Tolerance,
        ),
        ..Figure::default()
    }
}

/// Figure of time per press against force error, for each kind of stage.
fn stages(findings: &LoopFindings) -> Figure {
    const HUES: [Hue; 6] = [Hue::Blue, Hue::Green, Hue::Orange, Hue::Purple, Hue::Red, Hue::Teal];
    let whole = || findings.of(StudyPart::Stages).filter(|outcome| outcome.rule.is_none());
    let point = |outcome: &ConditionOutcome| Some((outcome.median_s?, outcome.error_p95_mn?));
    let mut names: Vec<&str> = Vec::new();
    for outcome in findings.of(StudyPart::Stages) {
        if !names.contains(&outcome.rig) {
            names.push(outcome.rig);
        }
    }
    let (mut marks, mut legend) = (Vec::new(), Vec::new());
    for (name, hue) in names.into_iter().zip(HUES) {
        for (strategy, filled, line) in
            [(Strategy::Map, true, LineStyle::Solid), (Strategy::Guarded, false, LineStyle::Dashed)]
        {
            let look = Look { hue, shape: Some(Shape::Circle), filled, line };
            let of_it: Vec<&ConditionOutcome> =
                whole().filter(|outcome| outcome.rig == name && outcome.strategy == strategy).collect();
            marks.push(Mark::Curve(look, of_it.iter().filter_map(|outcome| point(outcome)).collect()));
            if strategy == Strategy::Map {
                legend.push((look, name.to_owned()));
            }
        }
    }
    Figure {
        title: "Speed and accuracy of six stages".to_owned(),
        subtitle: format!(
            "1 N on one specimen, {0} x {0} places 0.5 mm apart, one load cell; tolerances of 50 to 2 mN; filled: map, hollow: guarded",
            findings.size.small
        ),
        height_px: 420.0,
        panels: vec![Panel {
            x: ChartAxis::log("time per press, median, s", whole().filter_map(point).map(|p| p.0), (0.5, 5.0)),
            y: ChartAxis::log("force error, 95th percentile, mN", whole().filter_map(point).map(|p| p.1), (2.0, 10.0)),
            marks,
        }],
        legend: vec![legend],
        notes: with_left_out(Vec::new(), findings, StudyPart::Stages),
        ..Figure::default()
    }
}

/// Figure of the gains at which the velocity loop is stable, and of the effect of a wrong stiffness on the real links.
fn stability_map(findings: &LoopFindings) -> Figure {
    let shapes = [Shape::Circle, Shape::Square, Shape::Triangle, Shape::Diamond];
    let dot = |hue, shape, filled| Look { hue, shape: Some(shape), filled, line: LineStyle::None };
    let theory = |gain: f64| [0.5, 5.0].map(|mismatch| (mismatch, gain / mismatch)).to_vec();
    let mut marks = vec![
        Mark::Curve(Look::line(Hue::Orange, LineStyle::Solid), theory(UNSTABLE_AT)),
        Mark::Curve(Look::line(Hue::Blue, LineStyle::Dashed), theory(OVERSHOOTS_AT)),
        Mark::Level(GAIN_TIMES_DEAD_TIME, format!("this loop: {GAIN_TIMES_DEAD_TIME}")),
    ];
    let mut dots = Vec::new();
    for (dead_time_s, shape) in stability::DEAD_TIMES_S.into_iter().zip(shapes) {
        let of_it = || findings.onsets.iter().filter(move |onset| onset.dead_time_ms == 1000.0 * dead_time_s);
        let unstable = of_it().map(|onset| (onset.mismatch, onset.unstable_at)).collect();
        let overshoots = of_it().map(|onset| (onset.mismatch, onset.overshoots_at)).collect();
        marks.push(Mark::Curve(dot(Hue::Orange, shape, false), unstable));
        marks.push(Mark::Curve(dot(Hue::Blue, shape, true), overshoots));
        dots.push((dot(Hue::Grey, shape, false), format!("dead time {:.0} ms", 1000.0 * dead_time_s)));
    }
    let map = Panel {
        x: ChartAxis::log("true stiffness / assumed, k/k_hat", [], (0.45, 5.6)),
        y: ChartAxis::log("gain x dead time", [], (0.05, 5.0)),
        marks,
    };
    let mut marks = vec![Mark::Level(1.0, "set".to_owned())];
    let alone =
        |mismatch: f64| (mismatch, stability::peak(GAIN_TIMES_DEAD_TIME * mismatch, stability::DEAD_TIMES_S[1]));
    marks.push(Mark::Curve(Look::line(Hue::Grey, LineStyle::Dashed), MISMATCHES.map(alone).to_vec()));
    let cross = Look::markers(Hue::Grey, Shape::Cross);
    let mut wire_legend = vec![
        (cross, "right: a rule ends it".to_owned()),
        (Look::line(Hue::Grey, LineStyle::Dashed), "the loop alone".to_owned()),
    ];
    for bench in StudyBench::ALL {
        let of_it = || {
            let outcomes = findings.of(StudyPart::Mismatch).filter(move |outcome| outcome.rig == bench.name());
            MISMATCHES.into_iter().zip(outcomes)
        };
        let reached =
            |(mismatch, outcome): (f64, &ConditionOutcome)| Some((mismatch, 1.0 + outcome.peak_over_mn? / 1000.0));
        let look = look(Strategy::Velocity, bench);
        marks.push(Mark::Curve(look, of_it().filter_map(reached).collect()));
        let tripped = of_it().filter_map(|(mismatch, outcome)| Some((mismatch, outcome.trip_force_n?)));
        marks.push(Mark::Curve(Look { hue: look.hue, ..cross }, tripped.collect()));
        wire_legend.insert(0, (look, format!("right: largest force, {}", bench.name())));
    }
    let wire = Panel {
        x: ChartAxis::log("true stiffness / declared", [], (0.45, 5.6)),
        y: ChartAxis::linear("force, N", (0.0, 1.8)),
        marks,
    };
    Figure {
        title: "The velocity loop: its stable gain, and the effect of a wrong stiffness".to_owned(),
        subtitle: format!(
            "left: F' = k v, v = K (F* - F) / k_hat, simulated alone, orders every 10 ms; right: on the wire, 1 N, {0} x {0} places",
            findings.size.small
        ),
        height_px: 360.0,
        panels: vec![map, wire],
        legend: vec![
            vec![
                (Look::line(Hue::Orange, LineStyle::Solid), "left: never settles, theory pi/2 k_hat/k".to_owned()),
                (
                    Look::line(Hue::Blue, LineStyle::Dashed),
                    "left panel: overshoots; theory: (k_hat / k) / e".to_owned(),
                ),
            ],
            dots,
            wire_legend,
        ],
        notes: vec![
            "left: filled, the gain from which it overshoots; hollow, the gain from which it never settles".to_owned(),
        ],
        ..Figure::default()
    }
}

/// Figure of error and peak of each strategy in each scene, on the fast bench.
fn scenes(findings: &LoopFindings) -> Figure {
    let rows = || ChartAxis::rows(SCENES.iter().map(|scene| scene.name.to_owned()).collect());
    let markers = |strategy| Look { line: LineStyle::None, ..look(strategy, StudyBench::XpsLike) };
    let (mut errors, mut peaks) = (vec![Mark::At(10.0, String::new())], Vec::new());
    for (strategy, offset) in Strategy::ALL.into_iter().zip([-0.27, 0.0, 0.27]) {
        let (mut near, mut over) = (Vec::new(), Vec::new());
        let of_it =
            |outcome: &&ConditionOutcome| outcome.strategy == strategy && outcome.rig == StudyBench::XpsLike.name();
        for outcome in findings.of(StudyPart::Scenes).filter(of_it) {
            let row = SCENES.iter().position(|scene| scene.name == outcome.scene).unwrap_or_default();
            let y = row as f64 + offset;
            near.extend(outcome.error_p95_mn.map(|error_mn| (error_mn, y)));
            over.extend(outcome.peak_over_mn.map(|peak_mn| (peak_mn, y)));
            if let Some(rule) = &outcome.rule {
                let text = format!("{}: {rule}, {} of {}", strategy.name(), outcome.done, outcome.points);
                let at = (outcome.error_p95_mn.unwrap_or(1.0), y);
                errors.push(Mark::Words(at, (9.0, 4.0), Anchor::Start, text));
            }
        }
        errors.push(Mark::Curve(markers(strategy), near));
        peaks.push(Mark::Curve(markers(strategy), over));
    }
    let panel = |label: &str, marks| Panel { x: ChartAxis::log(label, [], (1.0, 1000.0)), y: rows(), marks };
    Figure {
        title: "Test conditions of the loop, one changed at a time".to_owned(),
        subtitle: format!(
            "1 N (soft: 0.3 N), tolerance 10 mN, {0} x {0} places on the XPS-like bench, limits set correctly",
            findings.size.scene
        ),
        height_px: 44.0 * SCENES.len() as f64,
        panels: vec![
            panel("force error, 95th percentile, mN", errors),
            panel("peak over the set force, mN (at the edge: 1 or less)", peaks),
        ],
        legend: vec![Strategy::ALL.map(|strategy| (markers(strategy), strategy.name().to_owned())).to_vec()],
        notes: vec![
            "a strategy that breaks a safety rule ends there: its marks are of the presses made until then; dotted: the tolerance".to_owned(),
        ],
        ..Figure::default()
    }
}

/// Figure of time per press against the declared stiffness, for the same specimen.
fn caution(findings: &LoopFindings) -> Figure {
    let whole = || findings.of(StudyPart::Caution).filter(|outcome| outcome.rule.is_none());
    let bound_s = whole().next().map_or(1.0, |outcome| outcome.bound_s);
    let times_s = whole().filter_map(|outcome| outcome.median_s);
    let y = ChartAxis::log("time per press, median, s", times_s, (bound_s / 1.1, 2.0));
    let mut marks = vec![Mark::Level(bound_s, format!("least possible time: {bound_s:.3} s"))];
    for strategy in Strategy::ALL {
        let of_it = whole().filter(|outcome| outcome.strategy == strategy);
        let points = of_it.filter_map(|outcome| Some((outcome.declared_n_mm, outcome.median_s?))).collect();
        marks.push(Mark::Curve(look(strategy, StudyBench::XpsLike), points));
    }
    Figure {
        title: "Cost of caution: time per press against the declared stiffness".to_owned(),
        subtitle: format!(
            "nominal specimen (at 1 N up to 1.6 N/mm, relaxation included), {0} x {0} places, XPS-like bench",
            findings.size.small
        ),
        height_px: 360.0,
        panels: vec![Panel { x: ChartAxis::log("declared stiffness, N/mm", [2.0, 500.0], (1.6, 1000.0)), y, marks }],
        legend: vec![Strategy::ALL.map(named).to_vec()],
        notes: with_left_out(
            vec![format!("{SLOW_SIDE} x {SLOW_SIDE} places from {SLOW_N_MM} N/mm on")],
            findings,
            StudyPart::Caution,
        ),
        ..Figure::default()
    }
}

/// Figure of a calibration's time and location error against the tolerance.
fn calibration(findings: &LoopFindings) -> Figure {
    let strategies = [Strategy::Guarded, Strategy::Map];
    let panel = |label: &str, value: OutcomeValue, level: Option<Mark>| {
        let of = |strategy| {
            let of_it = findings.of(StudyPart::Tolerance).filter(move |outcome| outcome.strategy == strategy);
            of_it.filter_map(|outcome| Some((1000.0 * outcome.tolerance_n, value(outcome)?))).collect::<Vec<_>>()
        };
        let most = strategies.iter().flat_map(|strategy| of(*strategy)).map(|point| point.1).fold(0.1, f64::max);
        let curves = strategies.map(|strategy| Mark::Curve(look(strategy, StudyBench::XpsLike), of(strategy)));
        let ends = (1000.0 * TOLERANCES_N[TOLERANCES_N.len() - 1] / 1.2, 1000.0 * TOLERANCES_N[0] * 1.2);
        Panel {
            x: ChartAxis::log("set force tolerance, mN", [], ends),
            y: ChartAxis::linear(label, (0.0, 1.15 * most)),
            marks: level.into_iter().chain(curves).collect(),
        }
    };
    let papers = Mark::Level(PAPER_MM, format!("the paper: {PAPER_MM} mm"));
    Figure {
        title: "A calibration and its location error".to_owned(),
        subtitle: format!(
            "{0} x {0} places with 1 N, then {1} random contacts of 0.1 to 1 N, solved by correlation; XPS-like bench",
            findings.size.main, findings.size.tests
        ),
        height_px: 320.0,
        panels: vec![
            panel("location error, mean, mm", |outcome| outcome.location_error_mm, Some(papers)),
            panel("time of the calibration, minutes", |outcome| outcome.minutes, None),
        ],
        legend: vec![strategies.map(named).to_vec()],
        notes: vec![
            "excluded, as in every evaluation: presses outside the tolerance by the load cell; not shown: runs ended by a rule"
                .to_owned(),
        ],
        ..Figure::default()
    }
}

/// Adds how many runs of a part a figure leaves out, if any, and how many of them failed before their first press.
fn with_left_out(notes: Vec<String>, findings: &LoopFindings, part: StudyPart) -> Vec<String> {
    let ended = findings.of(part).filter(|outcome| outcome.rule.is_some()).count();
    let failed = findings.of(part).filter(|outcome| outcome.has_no_press()).count();
    let left_out = format!("not shown: {ended} runs ended by a rule, {failed} of them before the first press");
    notes.into_iter().chain((ended > 0).then_some(left_out)).collect()
}

/// Look of a strategy on the fast bench, and its name.
fn named(strategy: Strategy) -> (Look, String) {
    (look(strategy, StudyBench::XpsLike), strategy.name().to_owned())
}

/// Look of a strategy on a bench: colour and shape show the strategy, fill and line show the bench.
fn look(strategy: Strategy, bench: StudyBench) -> Look {
    let (hue, shape) = match strategy {
        Strategy::Guarded => (Hue::Blue, Shape::Square),
        Strategy::Velocity => (Hue::Orange, Shape::Triangle),
        Strategy::Map => (Hue::Green, Shape::Circle),
    };
    let (filled, line) = match bench {
        StudyBench::XpsLike => (true, LineStyle::Solid),
        StudyBench::Esp301 => (false, LineStyle::Dashed),
    };
    Look { hue, shape: Some(shape), filled, line }
}

/// Merges points that look like one point. Each merged point has its tolerances in mN.
fn alike(
    outcomes: &[&ConditionOutcome],
    point: impl Fn(&ConditionOutcome) -> Option<(f64, f64)>,
) -> Vec<((f64, f64), String)> {
    let mut text: Vec<((f64, f64), String)> = Vec::new();
    for outcome in outcomes {
        let Some((x, y)) = point(outcome) else { continue };
        let tolerance = format!("{}", 1000.0 * outcome.tolerance_n);
        let is_near = |((there_x, there_y), _): &&mut ((f64, f64), String)| {
            (x / there_x).ln().abs() < 0.01 && (y / there_y).ln().abs() < 0.02
        };
        match text.iter_mut().find(is_near) {
            Some((_, tolerances)) => *tolerances += &format!(", {tolerance}"),
            None => text.push(((x, y), tolerance)),
        }
    }
    text
}
