//! The verdict for a person, its exit code, and the rule that a person names.

use super::exit::{Failure, NOT_ACCEPTED};
use super::sources::{parse_kept_recipe, read};
use super::summary::tell;
use super::tables::filled;
use palpate_data::acceptance::{Check, Decision, Judgement, Rule, Verdict};
use palpate_data::dataset::Recorded;
use palpate_data::recipe::parse_rule;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// Message if there is no rule.
pub(super) const NO_RULE: &str = "no verdict: no acceptance rule ([accept] of the recipe, or --accept FILE)\n";

/// Rule that replaces the rule of the run's recipe.
#[derive(Debug, clap::Args)]
pub(super) struct AcceptArgs {
    /// Use the acceptance rule of this file instead of the recipe's
    #[arg(long, value_name = "FILE")]
    accept: Option<PathBuf>,
}

impl AcceptArgs {
    /// The rule that was named.
    pub(super) fn rule(&self) -> Result<Option<Rule>, Failure> {
        let Some(path) = &self.accept else { return Ok(None) };
        let file = path.display().to_string();
        let rule = parse_rule(&file, &read(path)?).map_err(Failure::usage)?;
        Ok(Some(Rule { afterwards_by: Some(file), ..rule }))
    }

    /// The rule that was named; else the one that the runs' recipes agree on.
    pub(super) fn rule_of<'a>(&self, runs: impl IntoIterator<Item = &'a Recorded>) -> Result<Option<Rule>, Failure> {
        if let Some(rule) = self.rule()? {
            return Ok(Some(rule));
        }
        let mut agreed: Option<Rule> = None;
        for run in runs {
            match (&agreed, rule_of(run)?) {
                (Some(first), Some(rule)) if *first != rule => {
                    let help = "select one with --accept FILE";
                    return Err(Failure::usage(miette::miette!(
                        help = help,
                        "the runs have different acceptance rules"
                    )));
                }
                (None, rule) => agreed = rule,
                _ => {}
            }
        }
        Ok(agreed)
    }
}

/// The rule of a run's own recipe. A recipe that today's program can't read gives none, and a warning.
pub(super) fn rule_of(run: &Recorded) -> Result<Option<Rule>, Failure> {
    if run.manifest.facts.imported.is_some() {
        return Ok(None);
    }
    match parse_kept_recipe(&run.path, &run.texts) {
        Ok(read) => Ok(read.recipe.rule().cloned()),
        Err(_) => {
            tell(&format!("warning: {}: its recipe can't be read, so it gives no verdict\n", run.path.display()))?;
            Ok(None)
        }
    }
}

/// The exit code of a verdict: 0 accepted, or none asked for; 1 not accepted or not decided.
pub(super) fn verdict_code(judgement: Option<&Judgement>) -> ExitCode {
    match judgement.map(|judgement| judgement.verdict) {
        None | Some(Verdict::Accepted) => ExitCode::SUCCESS,
        Some(Verdict::NotAccepted | Verdict::NotDecided) => ExitCode::from(NOT_ACCEPTED),
    }
}

/// The verdict, and what it depends on.
pub(super) fn head(judgement: &Judgement) -> String {
    let afterwards = judgement.judged_afterwards_by.as_ref().map(|file| format!(", judged afterwards by {file}"));
    format!(
        "{}: {} rule, method {}, {} calibration and {} test presses{}",
        judgement.verdict.told().to_uppercase(),
        judgement.rule,
        judgement.method,
        judgement.calibration_presses,
        judgement.test_presses,
        afterwards.unwrap_or_default()
    )
}

/// The verdict with each limit, in at most 80 columns.
pub(super) fn verdict_table(judgement: &Judgement) -> String {
    let is_guarded = judgement.rule == Decision::Guarded.word();
    let mut text = filled(&head(judgement), "  ");
    let bound = if is_guarded { "95 % bound" } else { "" };
    let _ = writeln!(text, "{:<41}{:>9}{bound:>11}{:>9}{:>6}", "", "found", "limit", "n");
    for check in &judgement.checks {
        let bound = if is_guarded { check.shown(check.bound) } else { String::new() };
        let (found, limit) = (check.shown(check.value), check.shown(Some(check.limit)));
        let _ = writeln!(text, "{:<41}{found:>9}{bound:>11}{limit:>9}{:>6}", named(check), check.n);
    }
    for note in &judgement.notes {
        text += &filled(&format!("  {note}"), "    ");
    }
    for reason in judgement.all_reasons() {
        text += &filled(&format!("  {reason}"), "    ");
    }
    text
}

/// Returns a figure's name with its unit.
fn named(check: &Check) -> String {
    let name = check.kind.full_name(check.reach);
    match check.kind.unit() {
        "" => name,
        unit => format!("{name}, {unit}"),
    }
}
