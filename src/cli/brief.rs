//! The result of a run in a few lines. Where there isn't room for all, the least important lines are left out.

use super::tables::{broken_outputs, evaluation_rows};
use super::text_table::TextTable;
use super::verdict::{NO_RULE, head};
use crate::api::RunResults;
use palpate_data::acceptance::{LimitCheck, LimitedFigure, SensorVerdict};
use palpate_data::dataset::characteristics::{Repeatability, UnitCharacteristics, characterise};
use palpate_report::errors::Detail;
use palpate_solver::Evaluation;

/// Most lines of a run on standard output.
pub(super) const LINES_MOST: usize = 20;
/// Most limits that are named one by one.
const LIMITS_MOST: usize = 8;
/// Most limits that are named one by one where all are met.
const NAMED_MOST: usize = 4;

/// What is printed, and for which width of the terminal, columns.
pub(super) struct Brief<'a> {
    results: &'a RunResults,
    width: usize,
}

/// Importance of a line. Lines that are declared later are left out first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum LineRank {
    Verdict,
    Error,
    Reason,
    Characteristics,
    Note,
    MoreErrors,
    Blank,
}

type RankedLine = (LineRank, String);

impl<'a> Brief<'a> {
    /// Shows these results in a terminal of so many columns.
    pub(super) fn of(results: &'a RunResults, width: usize) -> Self {
        Brief { results, width }
    }

    /// At most so many lines.
    pub(super) fn text(&self, lines_most: usize) -> String {
        let blocks = [self.errors(), self.characteristics(), self.broken(), self.verdict()];
        let mut lines: Vec<RankedLine> = Vec::new();
        for block in blocks.into_iter().filter(|block| !block.is_empty()) {
            lines.push((LineRank::Blank, String::new()));
            lines.extend(block);
        }
        while lines.len() > lines_most
            && let Some(rank) = lines.iter().map(|(rank, _)| *rank).max().filter(|rank| *rank > LineRank::Error)
            && let Some(last) = lines.iter().rposition(|(of, _)| *of == rank)
        {
            lines.remove(last);
        }
        lines.into_iter().map(|(_, line)| line + "\n").collect()
    }

    /// The errors of as many methods as there is room for: the last was chosen, the first are those of the recipe.
    fn errors(&self) -> Vec<RankedLine> {
        let Some((last, others)) = self.results.evaluations.split_last() else { return Vec::new() };
        let is_beside_paper = self.results.is_beside_paper;
        let table = |(room, has_paper): (usize, bool)| {
            let shown: Vec<&Evaluation> = others.iter().take(room).chain([last]).collect();
            evaluation_rows(&shown, has_paper, Detail::Shares)
        };
        let fits = |(_, table): &(Vec<Detail>, TextTable)| table.width() <= self.width;
        let rooms = (0..=others.len()).rev().map(|room| (room, is_beside_paper));
        let (details, table) = rooms.map(table).find(fits).unwrap_or_else(|| table((0, false)));
        let rank = |detail| if detail == Detail::Means { LineRank::Error } else { LineRank::MoreErrors };
        details.into_iter().map(rank).zip(table.lines()).collect()
    }

    /// Each characteristic of its worst unit, beside its limit.
    fn characteristics(&self) -> Vec<RankedLine> {
        let Some(staircases) = &self.results.characteristics else { return Vec::new() };
        let units = characterise(staircases, Repeatability::default());
        type Value = fn(&UnitCharacteristics) -> Option<f64>;
        let all: [(&str, LimitedFigure, Value); 4] = [
            ("repeatability", LimitedFigure::Repeatability, |unit| unit.repeatability_loading_percent),
            ("hysteresis", LimitedFigure::Hysteresis, |unit| unit.hysteresis_percent),
            ("linearity", LimitedFigure::Linearity, |unit| unit.linearity_percent),
            ("zero return", LimitedFigure::ZeroReturn, |unit| unit.zero_return_percent),
        ];
        let worst = |(name, figure, value): (&str, LimitedFigure, Value)| {
            let values = units.iter().filter_map(|unit| Some((value(unit)?, unit)));
            let (worst, unit) = values.max_by(|(a, _), (b, _)| a.abs().total_cmp(&b.abs()))?;
            let limit = self
                .results
                .judgement
                .as_ref()
                .and_then(|judgement| judgement.checks.iter().find(|check| check.kind == figure));
            let limit = limit.map_or(String::new(), |check| format!(", limit {}", check.shown(Some(check.limit))));
            Some(format!("{name} {worst:.2} (unit {}{limit})", unit.name()).replace(' ', "\u{a0}"))
        };
        let worst: Vec<String> = all.into_iter().filter_map(worst).collect();
        if worst.is_empty() {
            return Vec::new();
        }
        let text = format!("worst units, % of full scale: {}", worst.join("; "));
        self.filled(&text, "  ").map(|line| (LineRank::Characteristics, line)).collect()
    }

    /// The outputs that are broken.
    fn broken(&self) -> Vec<RankedLine> {
        let of_evaluation = self.results.evaluations.first().map(|evaluation| &evaluation.broken_outputs);
        let of_judgement = self.results.judgement.as_ref().map(|judgement| &judgement.broken_outputs);
        let text = of_judgement.or(of_evaluation).map(|outputs| broken_outputs(outputs)).unwrap_or_default();
        self.filled(text.trim_end(), "  ")
            .filter(|line| !line.is_empty())
            .map(|line| (LineRank::Reason, line))
            .collect()
    }

    /// The verdict, and the limits that decide it.
    fn verdict(&self) -> Vec<RankedLine> {
        let Some(judgement) = &self.results.judgement else {
            let is_evaluated = !self.results.evaluations.is_empty();
            let no_rule = self.filled(NO_RULE.trim_end(), "  ");
            return if is_evaluated { no_rule.map(|line| (LineRank::Verdict, line)).collect() } else { Vec::new() };
        };
        let ranked = |rank: LineRank, text: &str, indent: &str| -> Vec<RankedLine> {
            self.filled(text, indent).map(|line| (rank, line)).collect()
        };
        let mut lines = ranked(LineRank::Verdict, &head(judgement), "  ");
        for reason in &judgement.reasons {
            lines.extend(ranked(LineRank::Reason, &format!("  {reason}"), "    "));
        }
        let mut missed: Vec<&LimitCheck> =
            judgement.checks.iter().filter(|check| check.verdict != SensorVerdict::Accepted).collect();
        let met = judgement.checks.len() - missed.len();
        let hidden = missed.len().saturating_sub(LIMITS_MOST);
        if hidden > 0 {
            missed.sort_by(|a, b| farther(b).total_cmp(&farther(a)));
            missed.truncate(LIMITS_MOST);
        }
        let all: Vec<&LimitCheck> = if missed.is_empty() { judgement.checks.iter().collect() } else { missed };
        let is_named = all.len() <= LIMITS_MOST && (hidden > 0 || met < judgement.checks.len() || met <= NAMED_MOST);
        for check in all.iter().filter(|_| is_named) {
            lines.extend(ranked(LineRank::Verdict, &format!("  {}", check.compared()), "    "));
        }
        let rest = match (hidden, met) {
            (0, 0) => None,
            (0, met) if met == judgement.checks.len() => (!is_named).then(|| format!("  {met} within their limits")),
            (0, met) => Some(format!("  and {met} within their limits")),
            (hidden, met) => Some(format!("  and {hidden} more that aren't met, {met} within their limits")),
        };
        lines.extend(rest.iter().flat_map(|rest| ranked(LineRank::Verdict, rest, "    ")));
        for note in &judgement.notes {
            lines.extend(ranked(LineRank::Note, &format!("  {note}"), "    "));
        }
        lines
    }

    fn filled(&self, text: &str, indent: &str) -> std::vec::IntoIter<String> {
        let options = textwrap::Options::new(self.width).subsequent_indent(indent);
        let lines: Vec<String> =
            textwrap::wrap(text, options).into_iter().map(|line| line.replace('\u{a0}', " ")).collect();
        lines.into_iter()
    }
}

/// How far a value is from its limit, as a fraction of the limit; a value that is unknown or too uncertain isn't far.
fn farther(check: &LimitCheck) -> f64 {
    let Some(value) = check.value.filter(|_| check.verdict == SensorVerdict::NotAccepted) else { return 0.0 };
    (value - check.limit).abs() / check.limit.abs().max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_data::acceptance::{AcceptanceRule, Decision, Judgement, Limit, Measured, judge};

    /// A rule of every limit of which the first so many are missed, and the others met.
    fn judgement(missed: usize) -> Judgement {
        let limits =
            LimitedFigure::ALL.map(|figure| Limit { figure, limit: 0.5, reach: figure.is_share().then_some(1.0) });
        let rule = AcceptanceRule {
            decision: Decision::Guarded,
            method: "surrogate".to_owned(),
            calibration_presses_least: 1,
            test_presses_least: 1,
            holdout: false,
            limits: limits.to_vec(),
            called_sound: false,
            afterwards_by: None,
        };
        let mut judgement = judge(&rule, &Measured::default());
        judgement.reasons.clear();
        for (index, check) in judgement.checks.iter_mut().enumerate() {
            check.value = Some(0.6 + 0.1 * index as f64);
            let is_missed = index < missed;
            check.reason = is_missed.then(|| "exceeds the limit".to_owned());
            check.verdict = if is_missed { SensorVerdict::NotAccepted } else { SensorVerdict::Accepted };
        }
        judgement
    }

    fn brief(judgement: &Judgement, width: usize) -> String {
        let judgement = Some(judgement.clone());
        let results = RunResults { evaluations: Vec::new(), characteristics: None, judgement, is_beside_paper: false };
        Brief::of(&results, width).text(LINES_MOST)
    }

    #[test]
    fn of_many_missed_limits_the_farthest_eight_are_named_and_the_others_counted() {
        let text = brief(&judgement(10), 80);
        assert_eq!(text.matches(" exceeds the limit ").count(), LIMITS_MOST, "{text}");
        assert!(text.contains("\n  and 2 more that aren't met, 7 within their limits\n"), "{text}");
        assert!(!text.contains("location error, mean 0.6") && text.contains("repeatability, worst unit 1.5"), "{text}");
    }

    #[test]
    fn limits_that_are_missed_or_not_decided_are_named_and_the_met_ones_counted() {
        let text = brief(&judgement(1), 80);
        assert!(
            text.contains(
                "\n  location error, mean 0.600 mm exceeds the limit 0.500 mm\n  and 16 within their limits\n"
            ),
            "{text}"
        );
        let text = brief(&judgement(0), 80);
        assert!(text.contains("\n  17 within their limits\n"), "{text}");
        let mut unknown = judgement(1);
        (unknown.checks[0].value, unknown.checks[0].verdict) = (None, SensorVerdict::NotDecided);
        unknown.checks[0].reason = Some("no test was evaluated".to_owned());
        assert!(
            brief(&unknown, 80).contains("location error, mean: no test was evaluated\n"),
            "{}",
            brief(&unknown, 80)
        );
    }

    #[test]
    fn no_line_is_wider_than_the_terminal_and_the_least_important_go_first() {
        let judgement = judgement(10);
        for width in [40, 60, 80, 100] {
            let text = brief(&judgement, width);
            assert!(text.lines().all(|line| line.len() <= width), "{text}");
            assert!(width < 80 || text.lines().count() <= LINES_MOST, "{text}");
        }
        let mut noted = judgement.clone();
        noted.notes = vec!["the load cell was not checked after the run".to_owned(); 12];
        let text = brief(&noted, 80);
        assert_eq!(
            (text.lines().count(), text.matches(" exceeds the limit ").count()),
            (LINES_MOST, LIMITS_MOST),
            "{text}"
        );
    }
}
