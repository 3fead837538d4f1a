//! Comparison of runs.

use super::figures::LOOKS;
use super::frame::{Page, PageFigure, Section, clock, counted, none, number, percent, section, table, words};
use super::judged::PAPERS;
use super::numbers::{NumberCell, Numbers};
use super::side_by_side::{Series, rows, spread};
use crate::chart::{ChartAxis, ColouredCell, Figure, Mark};
use maud::{Markup, html};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::Place;
use palpate_data::acceptance::{AcceptanceRule, Judgement, SensorVerdict};
use palpate_data::dataset::characteristics::{Repeatability, Staircases, UnitCharacteristics, characterise};
use palpate_data::dataset::evaluate::{EvaluateError, Trial};
use palpate_data::dataset::{Evidence, Manifest, Presses, Recorded};
use palpate_data::recipe::Phase;
use palpate_run::rig::Bench;
use palpate_solver::{ErrorSummary, Evaluation};
use statrs::statistics::Statistics as _;

/// A run to be compared, its bench, and the rule by which it is judged.
pub struct ToCompare {
    /// The run.
    pub run: Recorded,
    /// Bench of the run.
    pub bench: Bench,
    /// Rule for the verdict; `None` for no verdict.
    pub rule: Option<AcceptanceRule>,
}

/// Results of one run in a comparison.
pub struct Compared {
    name: String,
    manifest: Manifest,
    /// Evaluations by the paper's method and by the requested method.
    evaluations: [Option<Evaluation>; 2],
    /// Reason why there is no evaluation.
    why_not: Option<String>,
    /// Verdict by the rule of the run's recipe or by the given rule; `None` without a rule.
    judgement: Option<Judgement>,
    /// Means over the units, %: repeatability loading and unloading (3 sd), hysteresis.
    table_1: [Option<f64>; 3],
    /// Mean output of each unit over the calibration, in its own unit per newton; empty without a calibration.
    gains: Vec<f64>,
    /// Places of the calibration with their commanded forces. Gains are comparable if these are equal.
    calibrated: Vec<(Place, f64)>,
}

/// Least difference at the ends of the colour scale for a unit's output, %. It is the least difference that is shown.
const LEAST_PERCENT: f64 = 0.01;

impl Compared {
    /// Evaluates runs, each with the layout of its array, on all processors. `solver` is used in addition to the paper's method.
    pub fn all(runs: &[ToCompare], solver: &str) -> Vec<Compared> {
        in_parallel(runs, |run| Compared::of(run, solver))
    }

    fn of(ToCompare { run, bench, rule }: &ToCompare, solver: &str) -> Compared {
        let (presses, layout) = (run.presses(), &bench.layout);
        let trial = Trial::of_run(&presses, bench.placed());
        let (evaluations, why_not) = match &trial {
            Ok(trial) => {
                let answers = [PAPERS, solver].map(|solver| trial.answers(solver));
                let why_not = answers.iter().find_map(|answers| answers.as_ref().err().map(EvaluateError::text));
                (answers.map(Result::ok), why_not)
            }
            Err(why) => ([None, None], Some(why.text())),
        };
        let known: Vec<Evaluation> = evaluations.iter().flatten().cloned().collect();
        let evidence =
            Evidence { presses: &presses, layout: Some(layout), runs: vec![run], u_place_mm: bench.u_place_mm() };
        let judgement = rule.as_ref().map(|rule| evidence.judge(rule, &trial, &known));
        let units = Staircases::of_run(&presses, layout)
            .map_or_else(Vec::new, |staircases| characterise(&staircases, Repeatability::default()));
        let mean =
            |of: fn(&UnitCharacteristics) -> Option<f64>| mean(&units.iter().filter_map(of).collect::<Vec<f64>>());
        Compared {
            name: run.name(),
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

    /// Returns the verdict; `None` without a rule.
    pub fn verdict(&self) -> Option<SensorVerdict> {
        self.judgement.as_ref().map(|judgement| judgement.verdict)
    }

    /// Number and name of the run.
    fn numbered(&self, index: usize) -> Markup {
        words(format!("{}.\u{a0}{}", index + 1, self.name))
    }

    /// Name of the sensor if it was stated, otherwise name of the run.
    fn text(&self) -> &str {
        self.manifest.facts.labels.sensor.as_deref().unwrap_or(&self.name)
    }

    /// Start time of the run in readable form; empty if the run never began.
    fn began(&self) -> String {
        self.manifest.sessions.first().map(|session| clock(&session.started)).unwrap_or_default()
    }

    /// Name of the run next to a figure: the sensor, and below it the day and the minute.
    fn in_figure(&self) -> String {
        let minute: String = self.began().chars().take("2026-01-01 00:00".len()).collect();
        format!("{}\n{minute}", self.text())
    }

    /// Sensor, run and start time, with which every table of a figure's numbers begins.
    fn origin(&self) -> [NumberCell; 3] {
        let sensor = self.manifest.facts.labels.sensor.as_deref().map_or(NumberCell::None, NumberCell::from);
        [sensor, NumberCell::from(self.name.as_str()), NumberCell::from(self.began().as_str())]
    }
}

/// Returns the mean output per newton of each unit over the calibration presses, with forces from the load cell.
fn gains(presses: &Presses) -> Vec<f64> {
    let sound: Vec<_> = presses.sound(Phase::Calibration).collect();
    let load_n: f64 = sound.iter().filter_map(|press| press.force_n).sum();
    if sound.is_empty() || load_n <= 0.0 {
        return Vec::new();
    }
    let mean = |channel: usize| sound.iter().map(|press| press.outputs[channel]).sum::<f64>() / load_n;
    (0..presses.channels).map(mean).collect()
}

/// Returns the places and forces of a calibration, in an order that doesn't depend on the order of the presses.
fn calibrated(presses: &Presses) -> Vec<(Place, f64)> {
    let sound = presses.sound(Phase::Calibration);
    let mut all: Vec<(Place, f64)> =
        sound.map(|press| (press.place(), press.force_set_n.or(press.force_n).unwrap_or_default())).collect();
    let key = |(place, force_n): &(Place, f64)| [place.y_mm, place.x_mm, *force_n];
    all.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
    all
}

/// Creates a page about many runs, in the order they were given.
pub fn comparison(runs: &[Compared], solver: &str) -> Page {
    let header = html! {
        h1 { (counted(runs.len(), "run")) " side by side" }
        p.lede { "In the given order: sensors of a batch, or one sensor over time." }
    };
    let empty = html! {};
    let sections = [
        Some(section("Results of each run", &numbers(runs, solver)).into()),
        Section::of_figures("Errors of each run", &empty, errors(runs, solver)),
        Section::of_figures("How the units differ", &empty, changes(runs).into_iter().collect()),
    ];
    Page::of(&counted(runs.len(), "run"), &header, sections.into_iter().flatten())
}

/// Returns two tables, because one table would be too wide to print.
fn numbers(runs: &[Compared], solver: &str) -> Markup {
    let unevaluated = runs.iter().filter_map(|run| Some((run, run.why_not.as_ref()?)));
    let unaccepted = runs.iter().filter_map(|run| Some((run, run.judgement.as_ref()?)));
    let unaccepted = unaccepted.filter(|(_, judgement)| judgement.verdict != SensorVerdict::Accepted);
    html! {
        (errors_table(runs, solver))
        p.note { "Mean errors against the commanded force. Both under: share of the presses under 1 mm and under 0.1 N. Verdict: by the acceptance rule, - without one." }
        @for (run, judgement) in unaccepted { p.note { (run.name) ": " (reasons(judgement)) } }
        @for (run, why) in unevaluated { p.note { (run.name) " isn't evaluated: " (why) } }
        (origins_table(runs))
        p.note { "Repeatability (3 sd) and hysteresis: means over the units, % of the output at the top force." }
    }
}

/// Returns the reasons why a run isn't accepted.
fn reasons(judgement: &Judgement) -> String {
    format!("{}; {}", judgement.verdict.text(), judgement.all_reasons().collect::<Vec<String>>().join("; "))
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
        cells.push(words(run.verdict().map_or("-", SensorVerdict::text)));
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
        let mut cells = vec![
            run.numbered(index),
            words(run.began()),
            words(format!("{} of {}", manifest.presses_done, manifest.facts.presses_planned)),
            words(manifest.rows_flagged),
        ];
        cells.extend(run.table_1.map(|value| value.map_or_else(none, |value| number("", value, 2, ""))));
        cells
    };
    table(&head.map(words), &runs.iter().enumerate().map(row).collect::<Vec<_>>())
}

type Summary = fn(&[f64]) -> Option<f64>;

/// Returns the mean; `None` if there are no values.
fn mean(values: &[f64]) -> Option<f64> {
    ErrorSummary::of(values).map(|sum| sum.mean)
}

/// Returns the standard deviation (n - 1); `None` for fewer than two values.
fn sd(values: &[f64]) -> Option<f64> {
    Some(values.std_dev()).filter(|sd| sd.is_finite())
}

/// First columns of a table of a figure's numbers.
const ORIGIN: [&str; 3] = ["sensor", "run", "began"];

/// Returns two figures, one for each of the two errors, with all runs.
fn errors(runs: &[Compared], solver: &str) -> Vec<PageFigure> {
    let names: Vec<String> = runs.iter().map(Compared::in_figure).collect();
    // a method that is compared with itself is drawn once
    let methods = [PAPERS, solver].into_iter().enumerate().filter(|(method, name)| *method == 0 || *name != PAPERS);
    let methods: Vec<(usize, &str)> = methods.collect();
    let of = |title: &str, label: &str, heads: [&str; 2], value: fn(&Evaluation) -> Option<ErrorSummary>| {
        let mut numbers = Vec::new();
        let series: Vec<Series> = methods
            .iter()
            .map(|&(method, name)| {
                let row = |run: &Compared| {
                    let error = value(run.evaluations[method].as_ref()?)?;
                    let values =
                        [NumberCell::from(name), NumberCell::Number(error.mean), NumberCell::Number(error.p95)];
                    numbers.push(run.origin().into_iter().chain(values).collect());
                    Some([error.mean, error.mean, error.p95])
                };
                Series { look: LOOKS[method], name: name.to_owned(), rows: runs.iter().map(row).collect() }
            })
            .collect();
        let head = ORIGIN.into_iter().chain(["solver"]).chain(heads).collect::<Vec<_>>();
        let figure = spread(title, "marks: means; strokes: up to the 95th percentile", label, &names, &series, None)?;
        Some(PageFigure::plain(figure).with(Numbers::new(&head, numbers)))
    };
    let location = ["location_error_mean_mm", "location_error_p95_mm"];
    let force = ["force_error_mean_n", "force_error_p95_n"];
    let figures = [
        of("Location errors", "location error, mm", location, |e| Some(e.location_error_mm)),
        of("Force errors", "force error, N", force, |e| e.force_error_n),
    ];
    figures.into_iter().flatten().collect()
}

/// Returns the figure of each unit's mean output relative to the first run. `None` if fewer than two runs have the same units.
fn changes(runs: &[Compared]) -> Option<PageFigure> {
    let first = runs.iter().find(|run| !run.gains.is_empty())?;
    let units = first.gains.len();
    let is_alike = |run: &&Compared| run.gains.len() == units && run.calibrated == first.calibrated;
    let alike: Vec<&Compared> = runs.iter().filter(is_alike).collect();
    (alike.len() > 1).then_some(())?;
    let left_out = runs.len() - alike.len();
    let percent = |run: &Compared, unit: usize| 100.0 * (run.gains[unit] / first.gains[unit] - 1.0);
    let every = || alike.iter().flat_map(|run| (0..units).map(|unit| percent(run, unit))).filter(|p| p.is_finite());
    let most = every().map(f64::abs).fold(0.0, f64::max).max(LEAST_PERCENT);
    let (mut cells, mut numbers) = (Vec::new(), Vec::new());
    for (row, run) in alike.iter().enumerate() {
        for unit in 0..units {
            let (at, row, value) = ((unit + 1) as f64, row as f64, percent(run, unit));
            cells.push(ColouredCell { x: (at - 0.5, at + 0.5), y: (row - 0.5, row + 0.5), value });
            numbers.push(run.origin().into_iter().chain([at, value].map(NumberCell::Number)).collect());
        }
    }
    let names: Vec<String> = alike.iter().map(|run| run.in_figure()).collect();
    let subtitle = format!("over the calibration, per newton, relative to {}", first.text());
    let x = ChartAxis::count("output", (0.5, units as f64 + 0.5));
    let marks = vec![Mark::Cells(ChartAxis::linear("change of the mean output, %", (-most, most)), cells)];
    let excluded = (left_out > 0).then(|| {
        format!("{} excluded: calibrated at other places or forces, or not calibrated", counted(left_out, "run"))
    });
    let figure = Figure {
        notes: excluded.into_iter().collect(),
        ..rows("Mean output of each unit", &subtitle, x, &names, marks)
    };
    let head = [&ORIGIN[..], &["output", "change_percent"]].concat();
    Some(PageFigure::plain(figure).named("output-changes").with(Numbers::new(&head, numbers)))
}
