//! The validation as a Markdown page.

use super::{Validation, ValidationOutcome};
use palpate_data::dataset::characteristics::UnitCharacteristics;
use palpate_report::errors::{Detail, ErrorNumber, NUMBERS};
use palpate_report::paper;
use palpate_solver::Evaluation;
use statrs::statistics::Statistics as _;

/// Text of the page, with names in braces as placeholders for the results.
const PAGE: &str = include_str!("page.md");

impl Validation {
    /// Returns the page; the same seeds give the same bytes.
    pub fn markdown(&self) -> String {
        let Validation { seed, outcomes, claims } = self;
        let best: Vec<&str> = outcomes.iter().map(|outcome| outcome.best.solver.as_str()).collect();
        let claims: String = claims
            .iter()
            .map(|claim| format!("| {} | {} | {} |\n", claim.text, claim.verdict, claim.found.replace('|', "\\|")))
            .collect();
        let found = [
            ("{specimens}", outcomes.len().to_string()),
            ("{first}", seed.to_string()),
            ("{last}", (seed + outcomes.len().saturating_sub(1) as u64).to_string()),
            ("{presses}", outcomes.first().map_or(0, |outcome| outcome.presses).to_string()),
            ("{hours}", format!("{:.1}", outcomes.iter().map(|outcome| outcome.hours).mean())),
            ("{numbers}", numbers().map(|number| self.number(number)).collect()),
            ("{best}", counted(&best)),
            ("{table_1}", self.table_1()),
            ("{claims}", claims),
        ];
        found.iter().fold(PAGE.to_owned(), |page, (name, text)| page.replace(name, text))
    }

    fn number(&self, number: &ErrorNumber) -> String {
        let values = |which: fn(&ValidationOutcome) -> &Evaluation| {
            let known: Option<Vec<f64>> = self.outcomes.iter().map(|outcome| number.value(which(outcome))).collect();
            known.unwrap_or_default()
        };
        let (papers, best) = (values(|outcome| &outcome.papers), values(|outcome| &outcome.best));
        let shown = |values: &[f64]| {
            format!("{} ± {} {}", number.digits_of(values.mean()), number.digits_of(values.std_dev()), number.unit)
        };
        let away = number.paper.unwrap_or(f64::NAN) - papers.as_slice().mean();
        let away = away / papers.as_slice().std_dev();
        let away = if away.is_finite() { format!("{away:+.1}") } else { "-".to_owned() };
        format!("| {} | {} | {} | {away} | {} |\n", number.name, number.shown_of_paper(), shown(&papers), shown(&best))
    }

    fn table_1(&self) -> String {
        let line = |(unit, [loading, unloading, hysteresis]): (usize, [f64; 3])| {
            let ours = |of: fn(&UnitCharacteristics) -> Option<f64>| {
                self.outcomes.iter().filter_map(|outcome| of(outcome.table_1.get(unit)?)).mean()
            };
            let (up, down) = (ours(|u| u.repeatability_loading_percent), ours(|u| u.repeatability_unloading_percent));
            let (unit, around) = (unit + 1, ours(|u| u.hysteresis_percent));
            format!(
                "| {unit} | {loading:.2} | {up:.2} | {unloading:.2} | {down:.2} | {hysteresis:.2} | {around:.2} |\n"
            )
        };
        paper::TABLE_1_PERCENT.into_iter().enumerate().map(line).collect()
    }
}

/// Returns the number of occurrences of each name, in the order of first occurrence.
fn counted(names: &[&str]) -> String {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for name in names {
        match counts.iter_mut().find(|(known, _)| known == name) {
            Some((_, count)) => *count += 1,
            None => counts.push((name, 1)),
        }
    }
    let times = |count: usize| if count == 1 { "once".to_owned() } else { format!("{count} times") };
    counts.iter().map(|(name, count)| format!("`{name}` {}", times(*count))).collect::<Vec<_>>().join(", ")
}

/// Returns the numbers that the paper reports too.
fn numbers() -> impl Iterator<Item = &'static ErrorNumber> {
    NUMBERS.iter().filter(|number| number.detail < Detail::All && number.paper.is_some())
}
