//! Runs beside one another.

use super::figures::{LOOKS, WIDTH_PX};
use super::frame::{Drawn, clock, counted, document, figures, none, number, percent, section, table, words};
use super::judged::PAPERS;
use super::subject::run_name;
use crate::acceptance::{Judgement, Rule, Verdict};
use crate::chart::{Cell, ChartAxis, Figure, Grid, Mark, Panel};
use crate::dataset::characteristics::{Repeatability, Staircases, UnitCharacteristics, characterise};
use crate::dataset::evaluate::{EvaluateError, Trial};
use crate::dataset::{Evidence, Manifest, Presses, Recorded};
use crate::parallel::in_parallel;
use crate::quantity::Place;
use crate::recipe::Phase;
use crate::rig::RigSpec;
use crate::solver::{ErrorSummary, Evaluation};
use maud::{Markup, html};
use statrs::statistics::Statistics as _;

/// A run to be compared, with its rig and the rule that it is judged by.
pub struct ToCompare {
    /// The run.
    pub run: Recorded,
    /// Its rig.
    pub rig: RigSpec,
    /// The rule; none: no verdict.
    pub rule: Option<Rule>,
}

/// One run as it stands beside others.
pub struct Compared {
    name: String,
    manifest: Manifest,
    /// By the paper's method, and by the one that was asked for.
    evaluations: [Option<Evaluation>; 2],
    /// Why there is no evaluation.
    why_not: Option<String>,
    /// The verdict by its own recipe's rule or by the one that was named; none without a rule.
    judgement: Option<Judgement>,
    /// Means over the units, %: repeatability loading and unloading (3 sd), hysteresis.
    table_1: [Option<f64>; 3],
    /// Mean output of each unit over the calibration, in its own unit a newton; empty without one.
    gains: Vec<f64>,
    /// The calibration's places with their commanded forces: gains of the same ones are comparable.
    calibrated: Vec<(Place, f64)>,
}

/// The least difference for which the colours of a unit's output reach to their ends, %: the least that is told.
const LEAST_PERCENT: f64 = 0.01;

impl Compared {
    /// Evaluates runs, each with the layout of its array, on all processors. `solver` stands beside the paper's method.
    pub fn all(runs: &[ToCompare], solver: &str) -> Vec<Compared> {
        in_parallel(runs, |run| Compared::of(run, solver))
    }

    fn of(ToCompare { run, rig, rule }: &ToCompare, solver: &str) -> Compared {
        let (presses, layout) = (run.presses(), &rig.array.layout);
        let trial = Trial::of_run(&presses, Some(layout));
        let (evaluations, why_not) = match &trial {
            Ok(trial) => {
                let answers = [PAPERS, solver].map(|solver| trial.answers(solver));
                let why_not = answers.iter().find_map(|answers| answers.as_ref().err().map(EvaluateError::told));
                (answers.map(Result::ok), why_not)
            }
            Err(why) => ([None, None], Some(why.told())),
        };
        let known: Vec<Evaluation> = evaluations.iter().flatten().cloned().collect();
        let contacts = run.contacts.iter().collect();
        let evidence = Evidence { presses: &presses, layout: Some(layout), contacts, u_place_mm: rig.u_place_mm() };
        let judgement = rule.as_ref().map(|rule| evidence.judge(rule, &trial, &known));
        let units = Staircases::of_run(&presses, layout)
            .map_or_else(Vec::new, |staircases| characterise(&staircases, Repeatability::default()));
        let mean =
            |of: fn(&UnitCharacteristics) -> Option<f64>| mean(&units.iter().filter_map(of).collect::<Vec<f64>>());
        Compared {
            name: run_name(&run.path),
            manifest: run.manifest.clone(),
            evaluations,
            why_not,
            judgement,
            table_1: [
                mean(|unit| unit.repeatability_loading_percent),
                mean(|unit| unit.repeatability_unloading_percent),
                mean(|unit| unit.hysteresis_percent),
            ],
            gains: gains(&presses),
            calibrated: calibrated(&presses),
        }
    }

    /// The verdict; none without a rule.
    pub fn verdict(&self) -> Option<Verdict> {
        self.judgement.as_ref().map(|judgement| judgement.verdict)
    }

    /// Its place and its name.
    fn numbered(&self, index: usize) -> Markup {
        words(format!("{}.\u{a0}{}", index + 1, self.name))
    }

    /// The sensor, where somebody said which; else the run.
    fn told(&self) -> String {
        self.manifest.facts.labels.sensor.clone().unwrap_or_else(|| self.name.clone())
    }
}

/// Mean output of each unit over the calibration presses, a newton by the load cell.
fn gains(presses: &Presses) -> Vec<f64> {
    let sound: Vec<_> = presses.sound(Phase::Calibration).collect();
    let load_n: f64 = sound.iter().filter_map(|press| press.force_n).sum();
    if sound.is_empty() || load_n <= 0.0 {
        return Vec::new();
    }
    let mean = |channel: usize| sound.iter().map(|press| press.outputs[channel]).sum::<f64>() / load_n;
    (0..presses.channels).map(mean).collect()
}

/// Where a calibration pressed, and how hard, in an order that doesn't depend on that of the presses.
fn calibrated(presses: &Presses) -> Vec<(Place, f64)> {
    let sound = presses.sound(Phase::Calibration);
    let mut all: Vec<(Place, f64)> =
        sound.map(|press| (press.place(), press.force_set_n.unwrap_or_default())).collect();
    let key = |(place, force_n): &(Place, f64)| [place.y_mm, place.x_mm, *force_n];
    all.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
    all
}

/// A page about many runs, in the order they were named.
pub fn comparison(runs: &[Compared], solver: &str) -> String {
    let body = html! {
        header {
            h1 { (counted(runs.len(), "run")) " side by side" }
            p.lede { "In the order they were named: sensors of a batch, or one sensor over time." }
        }
        (section("What each came to", &numbers(runs, solver)))
        (section("Errors", &figures(&errors(runs, solver))))
        @if let Some(changes) = changes(runs) { (section("How the units differ", &figures(&[changes]))) }
    };
    document(&counted(runs.len(), "run"), &body)
}

/// Two tables, since one would be too wide to print.
fn numbers(runs: &[Compared], solver: &str) -> Markup {
    let unevaluated = runs.iter().filter_map(|run| Some((run, run.why_not.as_ref()?)));
    let unaccepted = runs.iter().filter_map(|run| Some((run, run.judgement.as_ref()?)));
    let unaccepted = unaccepted.filter(|(_, judgement)| judgement.verdict != Verdict::Accepted);
    html! {
        (errors_table(runs, solver))
        p.note { "Mean errors against the commanded force. Both under: share of the presses under 1 mm and under 0.1 N. Verdict: by the acceptance rule, - where none was given." }
        @for (run, judgement) in unaccepted { p.note { (run.name) ": " (reasons(judgement)) } }
        @for (run, why) in unevaluated { p.note { (run.name) " isn't evaluated: " (why) } }
        (origins_table(runs))
        p.note { "Repeatability (3 sd) and hysteresis: means over the units, % of the output at the top force." }
    }
}

/// Why a run isn't accepted.
fn reasons(judgement: &Judgement) -> String {
    format!("{}; {}", judgement.verdict.told(), judgement.all_reasons().collect::<Vec<String>>().join("; "))
}

fn errors_table(runs: &[Compared], solver: &str) -> Markup {
    let of = |name: &str| [format!("{name}: location, mm"), "force, N".to_owned(), "both under".to_owned()];
    let head = ["run", "sensor"].map(words).into_iter().chain([PAPERS, solver].into_iter().flat_map(of).map(words));
    let head: Vec<Markup> = head.chain([words("verdict")]).collect();
    let row = |(index, run): (usize, &Compared)| {
        let mut cells = vec![run.numbered(index), words(run.manifest.facts.labels.sensor.as_deref().unwrap_or("-"))];
        for evaluation in &run.evaluations {
            let key = |evaluation: &Evaluation, what: &str| format!("{}.{}.{what}", index + 1, evaluation.solver);
            let e = evaluation.as_ref();
            let location = e.map(|e| number(&key(e, "location_error_mm.mean"), e.location_error_mm.mean, 3, ""));
            let force = e.and_then(|e| Some(number(&key(e, "force_error_n.mean"), e.force_error_n?.mean, 4, "")));
            let both = e.and_then(|e| Some(percent(&key(e, "within.both"), e.within.both?)));
            cells.extend([location, force, both].map(|cell| cell.unwrap_or_else(none)));
        }
        cells.push(words(run.verdict().map_or("-", Verdict::told)));
        cells
    };
    let mut rows: Vec<Vec<Markup>> = runs.iter().enumerate().map(row).collect();
    rows.extend([("mean", mean as Summary), ("sd", sd)].map(|(name, summary)| {
        let cells = [0, 1].into_iter().flat_map(|method| {
            let over = |value: fn(&Evaluation) -> Option<f64>| {
                summary(&runs.iter().filter_map(|run| value(run.evaluations[method].as_ref()?)).collect::<Vec<f64>>())
            };
            let location = over(|e| Some(e.location_error_mm.mean)).map(|value| number("", value, 3, ""));
            let force = over(|e| Some(e.force_error_n?.mean)).map(|value| number("", value, 4, ""));
            [location, force, over(|e| e.within.both).map(|share| percent("", share))]
        });
        let cells = cells.map(|cell| cell.unwrap_or_else(none));
        [words(name), words("")].into_iter().chain(cells).chain([words("")]).collect()
    }));
    table(&head, &rows)
}

fn origins_table(runs: &[Compared]) -> Markup {
    let head = ["run", "began", "presses", "flagged", "repeatability, loading, %", "unloading, %", "hysteresis, %"];
    let row = |(index, run): (usize, &Compared)| {
        let manifest = &run.manifest;
        let began = manifest.sessions.first().map(|session| clock(&session.started)).unwrap_or_default();
        let mut cells = vec![
            run.numbered(index),
            words(began),
            words(format!("{} of {}", manifest.presses_done, manifest.facts.presses_planned)),
            words(manifest.rows_flagged),
        ];
        cells.extend(run.table_1.map(|value| value.map_or_else(none, |value| number("", value, 2, ""))));
        cells
    };
    table(&head.map(words), &runs.iter().enumerate().map(row).collect::<Vec<_>>())
}

type Summary = fn(&[f64]) -> Option<f64>;

/// None of none.
fn mean(values: &[f64]) -> Option<f64> {
    ErrorSummary::of(values).map(|sum| sum.mean)
}

/// Standard deviation (n - 1); none of fewer than two.
fn sd(values: &[f64]) -> Option<f64> {
    Some(values.std_dev()).filter(|sd| sd.is_finite())
}

fn errors(runs: &[Compared], solver: &str) -> Vec<Drawn> {
    let of = |title: &str, label: &str, value: fn(&Evaluation) -> Option<(f64, f64)>| {
        let mut marks = Vec::new();
        let mut most = 0.0f64;
        for (method, look) in LOOKS.into_iter().enumerate() {
            let points = runs.iter().enumerate().filter_map(|(index, run)| {
                let (mean, p95) = value(run.evaluations[method].as_ref()?)?;
                Some(((index + 1) as f64, mean, p95))
            });
            let points: Vec<(f64, f64, f64)> = points.collect();
            most = points.iter().map(|point| point.2).fold(most, f64::max);
            // side by side, so that both are seen
            let shift = if method == 0 { -0.15 } else { 0.15 };
            let stroke = |(x, mean, p95): &(f64, f64, f64)| ((x + shift, *mean), (x + shift, *p95));
            marks.push(Mark::Strokes(look.hue, points.iter().map(stroke).collect()));
            marks.push(Mark::Curve(look, points.iter().map(|(x, mean, _)| (x + shift, *mean)).collect()));
        }
        (most > 0.0).then(|| {
            Drawn::plain(Figure {
                title: title.to_owned(),
                subtitle: "marks: means; strokes: up to the 95th percentile".to_owned(),
                height_px: 240.0,
                panels: vec![Panel {
                    x: ChartAxis::count("run", (0.5, runs.len() as f64 + 0.5)),
                    y: ChartAxis::linear(label, (0.0, 1.05 * most)),
                    marks,
                }],
                grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
                legend: LOOKS
                    .into_iter()
                    .zip([PAPERS, solver])
                    .map(|(look, name)| vec![(look, name.to_owned())])
                    .collect(),
                ..Figure::default()
            })
        })
    };
    let location =
        of("Location error", "location error, mm", |e| Some((e.location_error_mm.mean, e.location_error_mm.p95)));
    let force = of("Force error", "force error, N", |e| e.force_error_n.map(|error| (error.mean, error.p95)));
    [location, force].into_iter().flatten().collect()
}

/// Each unit's mean output against that of the first run; none where fewer than two runs have the same units.
fn changes(runs: &[Compared]) -> Option<Drawn> {
    let first = runs.iter().find(|run| !run.gains.is_empty())?;
    let units = first.gains.len();
    let is_alike = |run: &Compared| run.gains.len() == units && run.calibrated == first.calibrated;
    let alike: Vec<(usize, &Compared)> = runs.iter().enumerate().filter(|(_, run)| is_alike(run)).collect();
    (alike.len() > 1).then_some(())?;
    let left_out = runs.len() - alike.len();
    let percent = |run: &Compared, unit: usize| 100.0 * (run.gains[unit] / first.gains[unit] - 1.0);
    let every =
        || alike.iter().flat_map(|(_, run)| (0..units).map(|unit| percent(run, unit))).filter(|p| p.is_finite());
    let most = every().map(f64::abs).fold(0.0, f64::max).max(LEAST_PERCENT);
    let cells = alike.iter().flat_map(|(index, run)| {
        let at = (index + 1) as f64;
        (0..units).map(move |unit| {
            let row = (unit + 1) as f64;
            let share = 0.5 + 0.5 * percent(run, unit) / most;
            Cell { x: (at - 0.5, at + 0.5), y: (row - 0.5, row + 0.5), share }
        })
    });
    let figure = Figure {
        title: "Mean output of each unit".to_owned(),
        subtitle: format!("over the calibration, a newton, against that of {}", first.told()),
        height_px: (18.0 * units as f64).clamp(80.0, 400.0),
        panels: vec![Panel {
            x: ChartAxis::count("run", (0.5, runs.len() as f64 + 0.5)),
            y: ChartAxis::count("unit", (0.5, units as f64 + 0.5)),
            marks: vec![Mark::Cells(cells.collect())],
        }],
        grid: Some(Grid { columns: 1, width_px: WIDTH_PX, shared: false }),
        notes: match left_out {
            0 => Vec::new(),
            _ => vec![format!(
                "{} left out: calibrated at other places or forces, or not at all",
                counted(left_out, "run")
            )],
        },
        ..Figure::default()
    };
    Some(Drawn { figure, ramp: Some([-most, most].map(|percent| format!("{percent:+.2} %"))) })
}
