//! `palpate study ablation`: the terms that a scene needs, and the results that need them.

use super::begun::{Common, StudyOutput};
use crate::api::Failure;
use crate::cli::text_table::TextTable;
use palpate_study::ablation::{
    ALL_TERMS, AblationFindings, AblationSize, Needed, PER_PRESS, PER_READING, QUESTIONS, Question, SHARE, SceneTerm,
    TERMS, TermRow, ablation,
};
use std::path::Path;
use std::process::ExitCode;

/// Executes the study, writes its rows and prints the results.
pub(super) fn study(args: &Common) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "ablation")?;
    let size = if args.quick { AblationSize::QUICK } else { AblationSize::WHOLE };
    let found = begun.carried(ablation(size, args.seed, &begun.text()))?;
    begun.end(Vec::new(), found.ndjson(), |out| summary(&found, out))
}

/// Returns a summary of the results in at most 80 columns.
fn summary(found: &AblationFindings, out: &Path) -> String {
    let AblationSize { seeds, side, tests, presses } = found.size;
    let mut text = format!(
        "Each term off and on, all else as in rigs/paper.toml; on minus off, and half of\n\
         its 95 % interval over {seeds} seeds. *: part of the base; blank: can't have an effect\n\n\
         mean error (mm, mN) of {tests} contacts on ±6 mm, calibrated by 1 N at {} places\n",
        side * side
    );
    let heads = ["paper", "mN", "surrogate", "mN", "physics", "mN"];
    text += &effects(found, &QUESTIONS[..6], &heads, None);
    text += "\nTable 1, mean over units, % of full scale; time of a reading of all units, ns\n";
    let heads = ["loading", "unloading", "hysteresis"];
    text += &effects(found, &QUESTIONS[6..9], &heads, Some((PER_READING, "ns")));
    text += &format!(
        "\npresses of 1 N, ±50 mN, {} a seed, by the strategy guarded; time of a press, us\n",
        presses * presses
    );
    let heads = ["error mN", "peak mN", "time s"];
    text += &effects(found, &QUESTIONS[9..], &heads, Some((PER_PRESS, "us")));
    text + &needs(found) + &format!("\nrows, and what each term is: {}\n", out.display())
}

/// Returns a table with a line for each term that can affect a question, or that has a cost there: `cost` is its name and its unit.
fn effects(found: &AblationFindings, questions: &[Question], heads: &[&str], cost: Option<(&str, &str)>) -> String {
    let row = |first: &str, cell: &dyn Fn(&Question) -> String, costs: [String; 2]| {
        let cells = [first.to_owned()].into_iter().chain(questions.iter().map(cell));
        cells.chain(costs.into_iter().filter(|_| cost.is_some())).collect::<Vec<_>>()
    };
    let costs = cost.map_or_else(Default::default, |(_, unit)| ["off", "on"].map(|side| format!("{unit} {side}")));
    let heads =
        [""].iter().chain(heads).map(|head| (*head).to_owned()).chain(costs.into_iter().filter(|_| cost.is_some()));
    let mut table = TextTable::new(1, heads);
    let base = |question: &Question| {
        let row = found.rows.iter().find(|row| row.question == question.name);
        row.map_or(String::new(), |row| shown(row.base, question))
    };
    table.row(row("base", &base, Default::default()));
    for term in &TERMS {
        let costs = cost.and_then(|(cost, _)| found.costs.iter().find(|its| its.term == term.name && its.cost == cost));
        if costs.is_some() || questions.iter().any(|question| term.touches(question.of)) {
            let costs = costs.map_or_else(Default::default, |its| [its.off, its.on].map(|cost| format!("{cost:.0}")));
            table.row(row(&named(term), &|question| cell(found, term.name, question), costs));
        }
    }
    table.to_string()
}

fn named(term: &SceneTerm) -> String {
    format!("{}{}", term.name, if term.in_base { "*" } else { "" })
}

fn cell(found: &AblationFindings, term: &str, question: &Question) -> String {
    let text = |row: &TermRow| {
        let within = shown(row.effect.within, question);
        // there is no room for a zero before the point
        let difference = shown(row.effect.difference.abs(), question);
        let difference = if difference.starts_with("0.") { &difference[1..] } else { &difference };
        let sign = if row.effect.difference < 0.0 { "-" } else { "+" };
        // tenths mean nothing in a wide interval
        let within = match within.split_once('.') {
            Some(("0", _)) => &within[1..],
            Some((whole, _)) if whole.len() > 1 => whole,
            _ => &within,
        };
        format!("{sign}{difference} {within}")
    };
    found.row(term, question).map_or(String::new(), text)
}

/// Formats a value. Force errors of methods are in mN, because there isn't room for more digits.
fn shown(value: f64, question: &Question) -> String {
    match question.unit {
        "N" => format!("{:.1}", 1000.0 * value),
        "mN" => format!("{value:.1}"),
        "% FS" => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

/// Describes which term is needed for which question, and which terms aren't needed.
fn needs(found: &AblationFindings) -> String {
    let mut text = format!(
        "\na term is needed if the difference is significant and exceeds {:.0} % of the base's\n\
         number, 0.01 mm, 1 mN, 0.05 %; of a press 0.3 mN, at its peak 3 mN, 10 ms\n",
        100.0 * SHARE
    );
    let mut line =
        |words: &str| text += &(textwrap::fill(words, textwrap::Options::new(80).subsequent_indent("  ")) + "\n");
    for term in &TERMS {
        let is_needed = |row: &&TermRow| row.term == term.name && row.needed == Needed::Yes;
        let needed: Vec<&str> = found.rows.iter().filter(is_needed).map(|row| row.question).collect();
        if !needed.is_empty() {
            line(&format!("{}: {}", term.name, needed.join(", ")));
        }
    }
    for (verdict, words) in
        [(Needed::No, "not needed for any question"), (Needed::Undecided, "undecided, more seeds are required")]
    {
        let names: Vec<&str> =
            TERMS.iter().map(|term| term.name).filter(|name| found.verdict(name) == verdict).collect();
        if !names.is_empty() {
            line(&format!("{words}: {}", names.join(", ")));
        }
    }
    if let Some(all) = found.costs.iter().find(|cost| cost.term == ALL_TERMS) {
        text += &format!("a skin with all terms: {:.2} times a plain one's time a reading\n", all.ratio);
    }
    text
}
