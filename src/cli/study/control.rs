//! `palpate study control`: how fast and how near each strategy presses.

use super::begun::{Common, StudyOutput, number};
use crate::api::Failure;
use crate::cli::text_table::{TextTable, cells};
use palpate_control::Strategy;
use palpate_study::{ConditionOutcome, LoopFindings, LoopSize, StudyPart, control, figures};
use std::path::Path;
use std::process::ExitCode;

/// Executes the study, writes its figures and prints the results.
pub(super) fn study(args: &Common) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "control")?;
    let size = if args.quick { LoopSize::QUICK } else { LoopSize::WHOLE };
    let findings = begun.carried(control(size, args.seed, &begun.text()))?;
    begun.end(figures(&findings), findings.ndjson(), |out| summary(&findings, out))
}

/// Returns a summary of the results in at most 80 columns.
fn summary(findings: &LoopFindings, out: &Path) -> String {
    let size = findings.size;
    let mut text =
        format!("1 N at {0} x {0} places 0.5 mm apart: time, and error of the force, by tolerance\n\n", size.main);
    let mut table =
        TextTable::new(2, ["bench", "strategy", "mN", "median s", "p95", "/min", "mean mN", "p95", "max", "peak", ""]);
    for outcome in findings.of(StudyPart::Tolerance) {
        table.row(cells![
            outcome.rig,
            outcome.strategy.name(),
            1000.0 * outcome.tolerance_n,
            number(outcome.median_s, 2),
            number(outcome.p95_s, 2),
            number(outcome.ratio, 2),
            number(outcome.error_mean_mn, 1),
            number(outcome.error_p95_mn, 1),
            number(outcome.error_max_mn, 1),
            number(outcome.peak_over_mn, 0),
            if outcome.pareto == Some(true) { "*" } else { "" },
        ]);
        if let Some(rule) = &outcome.rule {
            table.line(format!("{:19}ends after {} of {}: {rule}", "", outcome.done, outcome.points));
        }
    }
    text += &format!(
        "{table}\n/min: median divided by the least possible time; peak: above the set force;\n\
         *: nothing on its bench is both faster and more exact\n\n"
    );
    let cell = |outcome: &ConditionOutcome| match &outcome.rule {
        Some(rule) => format!("{rule} @{}", outcome.done),
        None => format!(
            "{} {:>5} {:>5}",
            number(outcome.median_s, 2),
            number(outcome.error_p95_mn, 1),
            number(outcome.peak_over_mn, 0)
        ),
    };
    let mut table = |title: &str, part: StudyPart, name: &dyn Fn(&ConditionOutcome) -> Option<String>| {
        let mut table = TextTable::new(1, ["", "guarded", "velocity", "map"]);
        // the strategies of a row are together
        let outcomes: Vec<(String, &ConditionOutcome)> =
            findings.of(part).filter_map(|outcome| Some((name(outcome)?, outcome))).collect();
        for row in outcomes.chunk_by(|a, b| a.0 == b.0) {
            table.row([row[0].0.clone()].into_iter().chain(row.iter().map(|(_, outcome)| cell(outcome))));
        }
        text += &format!("{title}\n{table}\n");
    };
    for (rig, side) in [("XPS-like", size.scene), ("ESP301", size.small)] {
        let title = format!("scenes, {rig}, {side} x {side} (steel 5 x 5): s, p95, peak over mN; or rule @presses");
        table(&title, StudyPart::Scenes, &|outcome| (outcome.rig == rig).then(|| outcome.scene.clone()));
    }
    table("the declared stiffness, on the nominal specimen", StudyPart::Caution, &|outcome| {
        Some(format!("{} N/mm", outcome.declared_n_mm))
    });

    let mut table = TextTable::new(2, ["bench", "stiffness", "velocity"]);
    for outcome in findings.of(StudyPart::Mismatch) {
        table.row(cells![outcome.rig, outcome.scene.replace("stiffness ", ""), cell(outcome)]);
    }
    text += &format!("velocity on a stiffness other than declared: s, p95 mN, peak over mN\n{table}\n");
    text += &format!("a calibration of {0} x {0} places and its test of {1}, XPS-like\n", size.main, size.tests);
    let mut table = TextTable::new(1, ["", "mN", "minutes", "location error, mean, mm"]);
    for outcome in findings.of(StudyPart::Tolerance).filter(|outcome| outcome.location_error_mm.is_some()) {
        table.row(cells![
            outcome.strategy.name(),
            1000.0 * outcome.tolerance_n,
            number(outcome.minutes, 1),
            number(outcome.location_error_mm, 3),
        ]);
    }
    format!("{text}{table}\n{}figures and rows: {}\n", failed(findings), out.display())
}

/// Lists the conditions without a press, which have no numbers in any table.
fn failed(findings: &LoopFindings) -> String {
    let failed: Vec<&ConditionOutcome> = findings.failed().collect();
    let mut table = TextTable::new(4, ["bench", "scene", "declared", "rule", "strategies"]);
    // the strategies of a condition are together
    let place = |outcome: &ConditionOutcome| (outcome.rig, outcome.scene.clone(), outcome.limits.clone());
    for row in failed.chunk_by(|a, b| place(a) == place(b) && a.rule == b.rule) {
        let has = |strategy: &Strategy| row.iter().any(|outcome| outcome.strategy == *strategy);
        let names: Vec<&str> =
            Strategy::ALL.iter().filter(|strategy| has(strategy)).map(|strategy| strategy.name()).collect();
        let names = if names.len() == Strategy::ALL.len() { "all".to_owned() } else { names.join(", ") };
        let (first, rule) = (row[0], row[0].rule.as_deref().unwrap_or_default());
        table.row(cells![first.rig, first.scene, format!("{} N/mm", first.declared_n_mm), rule, names]);
    }
    if failed.is_empty() {
        return String::new();
    }
    format!("FAILED without a press: {} of {} conditions\n{table}\n", failed.len(), findings.outcomes.len())
}
