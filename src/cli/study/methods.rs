//! `palpate study speed-accuracy | budget | failures`: the methods that solve.

use super::begun::{Common, StudyOutput, ended, number};

use crate::api::recorded::{read_presses, read_run};
use crate::api::{self, ColumnsOptions, Failure};
use crate::cli::summary::note;
use crate::cli::text_table::{TextTable, cells};
use palpate_data::recipe::Phase;
use palpate_solver::{BEST, FORCE_REFERENCE_N, LOCATION_REFERENCE_MM, Model};
use palpate_study::methods::{
    CONDITIONS, KnownReadings, MethodRow, MethodTrial, NoiseReference, StudiedMethod, budget_figures,
    budget_figures_of, coverage_figures, failure_figures, of_run, of_tables, speed_accuracy_figures,
};
use palpate_study::{methods, ndjson};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate study speed-accuracy
  palpate study speed-accuracy runs/paper
  palpate study speed-accuracy --calibration grid.csv --test random.csv

Without a run or tables: the paper's array, simulated, with the noise of its Table 1 as a share
of full scale (T) and of the reading (Q).";

const BUDGET_EXAMPLES: &str = "\
Examples:
  palpate study budget
  palpate study budget runs/paper
  palpate study budget --calibration grid.csv --test random.csv

Of a run or of tables: every method calibrated with all of the presses, with half of them, a
quarter and so on, spread over the area. Without: the paper's array, simulated.";

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct SpeedAccuracyArgs {
    #[command(flatten)]
    source: RecordedSource,
    #[command(flatten)]
    common: Common,
}

#[derive(Debug, clap::Args)]
#[command(after_help = BUDGET_EXAMPLES)]
pub(super) struct BudgetArgs {
    #[command(flatten)]
    source: RecordedSource,
    #[command(flatten)]
    common: Common,
}

/// Recorded data, if the study isn't simulated.
#[derive(Debug, clap::Args)]
struct RecordedSource {
    /// A run folder with calibration and test presses
    run: Option<PathBuf>,
    /// A table of calibration presses
    #[arg(long, value_name = "CSV", requires = "test", conflicts_with = "run")]
    calibration: Option<PathBuf>,
    /// A table of test presses; without force_n, only location is evaluated
    #[arg(long, value_name = "CSV", requires = "calibration", conflicts_with = "run")]
    test: Option<PathBuf>,
    #[command(flatten)]
    columns: ColumnsOptions,
}

impl RecordedSource {
    /// Returns the recorded trial; `None` if nothing was named.
    fn trial(&self) -> Result<Option<MethodTrial>, Failure> {
        match (&self.run, &self.calibration, &self.test) {
            (Some(run), ..) => trial_of(run).map(Some),
            (None, Some(calibration), Some(test)) => {
                let mapping = self.columns.mapping()?;
                let (calibration, test) = (
                    read_presses(calibration, &mapping, Some(Phase::Calibration), &note)?,
                    read_presses(test, &mapping, Some(Phase::Test), &note)?,
                );
                of_tables(&calibration, &test).map_err(Failure::usage).map(Some)
            }
            _ => Ok(None),
        }
    }
}

/// Size of a simulated study: presses along a side of the calibration, and test contacts.
const SIMULATED: (usize, usize) = (25, 10_000);
const QUICK: (usize, usize) = (7, 100);

/// Accuracy of each method, and the time of a solve.
pub(super) fn speed_accuracy(args: &SpeedAccuracyArgs) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.common.output, "speed-accuracy")?;
    let trials = match args.source.trial()? {
        Some(trial) => vec![trial],
        None => {
            let (side, tests) = if args.common.quick { QUICK } else { SIMULATED };
            begun.carried(MethodTrial::simulated(side, tests, args.common.seed))?
        }
    };
    let found = begun.carried(Ok(methods::speed_accuracy(&trials, &ns_per_answer, &begun.text())))?;
    begun.end(speed_accuracy_figures(&trials, &found), ndjson(&found), |out| {
        let mut text = String::new();
        for trial in &trials {
            text += &speed_accuracy_table(&trial.text, found.iter().filter(|row| row.scene == trial.scene));
        }
        text + "ns: of a solve, and of an answer of `palpate solve`, with its lines\n*: no other method is both faster and more exact; wrong: over 1 mm or 0.1 N;\nsilent: wrong and not flagged\n" + &ended(out)
    })
}

fn ns_per_answer(model: Model, test: &KnownReadings) -> Option<f64> {
    api::ns_per_answer(model, test.iter().map(|(_, outputs)| outputs))
}

/// How near each method comes against the number of presses.
pub(super) fn budget(args: &BudgetArgs) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.common.output, "budget")?;
    let Common { quick, seed, .. } = args.common;
    let title = "location error, mean, mm, by calibration presses\n\n";
    if let Some(trial) = args.source.trial()? {
        let found = begun.carried(methods::budget_of(&trial, quick, seed, &begun.text()))?;
        return begun.end(budget_figures_of(&trial, &found), ndjson(&found), |out| {
            title.to_owned() + &budget_table(&trial.scene, &trial.scene, &found) + &ended(out)
        });
    }
    let found = begun.carried(methods::budget(quick, seed, &begun.text()))?;
    begun.end(budget_figures(&found), ndjson(&found), |out| {
        let name = |noise: NoiseReference| noise.text().split(':').next().unwrap_or_default();
        let tables = NoiseReference::ALL.map(|noise| budget_table(noise.name(), name(noise), &found)).concat();
        let minutes = format!("minutes: {} s a press, map on the fast bench; bound: Cramér-Rao\n", methods::PRESS_S);
        format!("{title}{tables}{minutes}") + &ended(out)
    })
}

/// Where each method fails.
pub(super) fn failures(args: &Common) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "failures")?;
    let found = begun.carried(methods::failures(args.quick, args.seed, &begun.text()))?;
    let figures = [failure_figures(&found), coverage_figures(&found)].concat();
    begun.end(figures, ndjson(&found), |out| {
        let of = |noise| breaks(noise, &found) + &silent(noise, &found) + &covered(noise, &found);
        let tables = NoiseReference::ALL.map(of).concat();
        tables + "rows and figures have every value between\n" + &ended(out)
    })
}

fn trial_of(run: &Path) -> Result<MethodTrial, Failure> {
    let (recorded, bench) = read_run(run, &note)?;
    let name = run.file_name().map_or_else(|| run.display().to_string(), |name| name.to_string_lossy().into_owned());
    of_run(&name, &recorded.presses(), &bench, recorded.manifest.facts.seed).map_err(Failure::usage)
}

fn speed_accuracy_table<'a>(text: &str, rows: impl Iterator<Item = &'a MethodRow>) -> String {
    let head = ["", "mean mm", "+-", "p95", "force N", "ns", "answer", "wrong", "silent", ""];
    let mut table = TextTable::new(1, head);
    let percent = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
    let (mut bound, mut refusals) = (None, String::new());
    for row in rows {
        table.row(cells![
            row.solver,
            number(row.mean_mm(), 3),
            number(row.location_error_within_mm, 3),
            number(row.location_error_mm.map(|error| error.p95), 2),
            number(row.force_error_n.map(|error| error.mean), 4),
            number(row.ns_per_solve, 0),
            number(row.ns_per_answer, 0),
            percent(row.wrong),
            percent(row.wrong_unflagged),
            if row.pareto == Some(true) { "*" } else { "" },
        ]);
        if let Some(refused) = &row.refused {
            let _ = writeln!(refusals, "{}: {refused}", row.solver);
        }
        bound = bound.or(row.location_bound_mm.zip(row.bound).zip(row.force_bound_n));
    }
    let mut whose_bound = String::new();
    if let Some(((location_mm, whose), force_n)) = bound {
        table.row(cells!["bound", number(Some(location_mm), 3), "", "", number(Some(force_n), 4)]);
        whose_bound = format!("bound: {whose}\n");
    }
    format!("{text}\n{table}{whose_bound}{refusals}\n")
}

/// Returns a table with a line for each method and a column for each number of presses. Minutes and bound are included if known.
fn budget_table(scene: &str, text: &str, found: &[MethodRow]) -> String {
    let of = |solver: &str| -> Vec<&MethodRow> {
        found.iter().filter(|row| row.scene == scene && row.solver == solver).collect()
    };
    let row = |name: &str, rows: &[&MethodRow], cell: &dyn Fn(&MethodRow) -> String| {
        [name.to_owned()].into_iter().chain(rows.iter().map(|row| cell(row))).collect::<Vec<_>>()
    };
    let presses = of(BEST);
    let mut table = TextTable::new(1, row(text, &presses, &|row| row.value.to_string()));
    if presses.iter().any(|row| row.minutes.is_some()) {
        table.row(row("minutes", &presses, &|row| number(row.minutes, 1)));
    }
    for solver in StudiedMethod::names() {
        table.row(row(solver, &of(solver), &|row| number(row.mean_mm(), 3)));
    }
    if presses.iter().any(|row| row.location_bound_mm.is_some()) {
        table.row(row("bound", &presses, &|row| number(row.location_bound_mm, 3)));
    }
    format!("{table}\n")
}

/// Describes the value of each condition at which a method's mean error exceeds the paper's reference.
fn breaks(noise: NoiseReference, found: &[MethodRow]) -> String {
    let cell = |solver: &str, harm: &methods::Harm| {
        let rows: Vec<&MethodRow> = methods::rows_of(found, noise.name(), solver, harm.name).collect();
        let is_good = |row: &MethodRow| {
            let force_n = row.force_error_n.map_or(0.0, |error| error.mean);
            row.mean_mm().is_some_and(|mm| mm <= LOCATION_REFERENCE_MM) && force_n <= FORCE_REFERENCE_N
        };
        let broken = rows.iter().find(|row| !is_good(row));
        broken.map_or("-".to_owned(), |row| row.text.map_or(row.value.to_string(), str::to_owned))
    };
    format!("{}\nfirst value with a mean error over 1 mm or 0.1 N (-: no value)\n", noise.text()) + &table(&cell)
}

/// Describes the largest fraction of a method's answers that are wrong and not flagged.
fn silent(noise: NoiseReference, found: &[MethodRow]) -> String {
    let cell = |solver: &str, harm: &methods::Harm| {
        let shares = methods::rows_of(found, noise.name(), solver, harm.name).filter_map(|row| row.wrong_unflagged);
        format!("{:.0}", 100.0 * shares.fold(0.0, f64::max))
    };
    "wrong and not flagged, at the worst value, %\n".to_owned() + &table(&cell)
}

/// Describes the least fraction of true values within the wider interval that a method states.
fn covered(noise: NoiseReference, found: &[MethodRow]) -> String {
    let cell = |solver: &str, harm: &methods::Harm| {
        let rows = methods::rows_of(found, noise.name(), solver, harm.name);
        let least = rows.filter_map(|row| Some(row.coverage?.location[1])).reduce(f64::min);
        least.map_or("-".to_owned(), |share| format!("{:.0}", 100.0 * share))
    };
    let stated = methods::STATED_PERCENT[1];
    format!("location errors within the stated {stated} % half-width, at the worst value, %\n") + &table(&cell)
}

/// Returns a table with a line for each condition and a column for each method.
fn table(cell: &dyn Fn(&str, &methods::Harm) -> String) -> String {
    let row = |first: &str, cell: &dyn Fn(&'static str) -> String| {
        let letters = |solver| cell(solver).chars().take(MOST_LETTERS).collect();
        [first.to_owned()].into_iter().chain(StudiedMethod::names().map(letters)).collect::<Vec<String>>()
    };
    let mut table = TextTable::new(1, row("", &|solver| solver.rsplit('-').next().unwrap_or(solver).to_owned()));
    for harm in &CONDITIONS {
        table.row(row(harm.name, &|solver| cell(solver, harm)));
    }
    format!("{table}\n")
}

/// Largest number of characters in a cell, so that all methods fit on a terminal.
const MOST_LETTERS: usize = 5;
