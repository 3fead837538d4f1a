//! Tables for a person, in at most 80 columns. They show the paper's numbers only for an array and a protocol like the paper's,
//! see [`palpate_report::report::is_beside_paper`].

use super::text_table::{TextTable, cells};
use crate::api::{ForcesEvaluated, SolverOutcome, VectorEvaluation};
use palpate_data::dataset::characteristics::{Repeatability, Staircases, characterise, terms};
use palpate_data::dataset::doubted_half_widths;
use palpate_report::errors::{self, Detail};
use palpate_report::paper;
use palpate_solver::vector::{PairShares, SuperposedPresses, VectorErrors};
use palpate_solver::{
    BEST, Choice, ErrorSummary, Evaluation, HistoryEvaluation, LoadGain, MemoryChoice, MethodForceErrors, Tie,
    TriedMethod, Verdicts,
};
use std::fmt::Write as _;

/// Largest width of printed output, columns.
pub(super) const WIDTH: usize = 80;

/// Blank at which [`filled`] doesn't break a line.
pub(super) const NO_BREAK: char = '\u{a0}';

/// The results of any number of solvers on the same test, the paper's before them or not.
pub(super) fn evaluation_table(evaluations: &[Evaluation], is_beside_paper: bool) -> String {
    let evaluations: Vec<&Evaluation> = evaluations.iter().collect();
    evaluation_rows(&evaluations, is_beside_paper, Detail::All).1.to_string() + &footnotes(&evaluations)
}

/// The rows of that table up to a detail, and the detail of each.
pub(super) fn evaluation_rows(
    evaluations: &[&Evaluation],
    is_beside_paper: bool,
    most: Detail,
) -> (Vec<Detail>, TextTable) {
    let paper_cell = |cell: &str| is_beside_paper.then(|| cell.to_owned());
    let head = [String::new()].into_iter().chain(paper_cell("paper"));
    let mut table = TextTable::new(1, head.chain(evaluations.iter().map(|evaluation| evaluation.solver.clone())));
    let mut details = vec![Detail::Means];
    for number in errors::known(evaluations, most) {
        let label = [number.name.to_owned()].into_iter().chain(paper_cell(&number.shown_of_paper()));
        table.row(label.chain(evaluations.iter().map(|evaluation| number.shown(evaluation))));
        details.push(number.detail);
    }
    (details, table)
}

/// The results of every solver on the same test, or why it has none, a line each; the paper's above them or not.
pub(super) fn solvers_table(outcomes: &[SolverOutcome], is_beside_paper: bool) -> String {
    let evaluations: Vec<&Evaluation> = outcomes.iter().filter_map(|(_, outcome)| outcome.as_ref().ok()).collect();
    let by_depth = evaluations.iter().any(|evaluation| evaluation.depth_error_mm.is_some());
    let (load, load_error) = if by_depth { ("depth", "depth error in mm") } else { ("N", "force error in N") };
    let mut table = TextTable::new(1, ["", "mean", "median", "p95", "largest", load, "1 mm", "both", "us"]);
    let percent = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:.1}", 100.0 * share));
    let number = |value: Option<f64>| value.map_or("-".to_owned(), figures);
    if is_beside_paper {
        let within = [paper::WITHIN_1MM, paper::WITHIN_BOTH].map(|share| percent(Some(share)));
        let [within_1mm, both] = &within;
        let (mm, n) = (paper::LOCATION_ERROR_MM, paper::FORCE_ERROR_N);
        table.row(cells!["paper", mm, "-", "-", "-", n, within_1mm, both, "-"]);
    }
    for (name, outcome) in outcomes {
        let evaluation = match outcome {
            Ok(evaluation) => evaluation,
            Err(reason) => {
                table.line(filled(&format!("{name}: {reason}"), "  "));
                continue;
            }
        };
        let name = if *name == BEST { format!("{BEST}: {}", evaluation.solver) } else { (*name).to_owned() };
        let ErrorSummary { mean, median, p95, max } = evaluation.location_error_mm;
        let [mean, median, p95, max] = [mean, median, p95, max].map(figures);
        let load = number(evaluation.depth_error_mm.or(evaluation.force_error_n).map(|error| error.mean));
        let within_1mm = percent(Some(evaluation.within.location_1mm));
        let us = number(evaluation.ns_per_solve.map(|ns| ns / 1000.0));
        table.row(cells![name, mean, median, p95, max, load, within_1mm, percent(evaluation.within.both), us]);
    }
    format!("location error in mm, mean {load_error}, within limits in %, solve in us\n{table}")
        + &footnotes(&evaluations)
}

/// How a method was chosen, in a line or two.
pub(super) fn chosen(choice: &Choice) -> String {
    let named = |candidate: &TriedMethod| Some((candidate.solver.clone(), candidate.location_error_mm?));
    let tried: Vec<(String, f64)> = choice.candidates.iter().filter_map(named).collect();
    let Some((_, chosen_mm)) = tried.first() else {
        return "chosen without cross-validation: too few presses\n".to_owned();
    };
    // `physics` and `blend` need more than a slightly smaller error
    let smaller = tried.iter().filter(|(_, error_mm)| error_mm < chosen_mm).map(|(solver, _)| solver.as_str());
    let smaller: Vec<&str> = smaller.collect();
    let why = if smaller.is_empty() {
        String::new()
    } else {
        format!(" ({}: better by too little to be preferred)", smaller.join(", "))
    };
    let tried: Vec<String> =
        tried.iter().map(|(solver, error_mm)| format!("{solver} {}{NO_BREAK}mm", figures(*error_mm))).collect();
    let mut text = filled(&format!("chosen by cross-validation on the calibration: {}{why}", tried.join(", ")), "  ");
    if let (false, Some(chosen)) = (choice.ties.is_empty(), choice.candidates.first()) {
        let sigmas = |tie: &Tie| match tie.sigmas.is_finite() {
            true => format!("{} (the errors differ by {:.1} standard errors)", tie.solver, tie.sigmas),
            false => tie.solver.clone(),
        };
        let ties: Vec<String> = choice.ties.iter().map(sigmas).collect();
        text += &filled(&format!("{} is nearly tied with {}", chosen.solver, ties.join(", ")), "  ");
    }
    if let Some(LoadGain { solver, any_mm, by_load_mm }) = &choice.load_gain {
        let (any_mm, by_load_mm) = (figures(*any_mm), figures(*by_load_mm));
        let gain = format!(
            "readings with the load of the calibration are solved by {solver}, which assumes this load: \
             {by_load_mm}{NO_BREAK}mm instead of {any_mm}{NO_BREAK}mm"
        );
        text += &filled(&gain, "  ");
    }
    if let Some(mean_mm) = choice.mean_place_error_mm.filter(|mean_mm| *chosen_mm > LITTLE_LEARNED * mean_mm) {
        let mean_mm = figures(mean_mm);
        let warning = format!(
            "warning: an answer that is always the mean place has {mean_mm}{NO_BREAK}mm: these outputs hardly show places"
        );
        text += &filled(&warning, "  ");
    }
    text
}

/// Fraction of the error of an answer that is always the mean place, above which a method has learned little.
const LITTLE_LEARNED: f64 = 0.75;

/// Mean errors of methods on presses that were held out of the calibration in turn, for a calibration without a test.
pub(super) fn cross_validated_table(candidates: &[TriedMethod]) -> String {
    let number = |error: Option<f64>| error.map_or("-".to_owned(), figures);
    let mut table = TextTable::new(1, ["", "location, mm", "force, N"]);
    for TriedMethod { solver, location_error_mm, force_error_n } in candidates {
        table.row(cells![solver, number(*location_error_mm), number(*force_error_n)]);
    }
    format!(
        "no test presses: cross-validated errors of the calibration, mean\n{table}\
         each press was solved by the method fitted without the press's place\n"
    )
}

/// The errors of force vectors: mean and root mean square of each component.
pub(super) fn forces_table(ForcesEvaluated { errors, left_out }: &ForcesEvaluated) -> String {
    let head = ["", "x mean", "rms", "y mean", "rms", "press mean", "rms", "p95"];
    let mut table = TextTable::new(1, head);
    for MethodForceErrors { method, components: [x, y, press] } in &errors.methods {
        let numbers = [x.mean_n, x.rmse_n, y.mean_n, y.rmse_n, press.mean_n, press.rmse_n, press.p95_n].map(figures);
        table.row(std::iter::once((*method).to_owned()).chain(numbers));
    }
    let head =
        format!("errors of the force vector, N: {} rows, left out in {} parts ({left_out})", errors.rows, errors.folds);
    filled(&head, "  ") + &table.to_string() + "best is the weighted mean of the others, with weights from other rows\n"
}

/// The errors of a series with and without earlier readings, and whether these are used.
pub(super) fn history_table(errors: &HistoryEvaluation) -> String {
    let mut table = TextTable::new(1, ["error of the force, N", "mean", "rms", "p95"]);
    for (name, errors) in [("newest reading", errors.newest), ("with earlier readings", errors.with_memories)] {
        table.row(std::iter::once(name.to_owned()).chain([errors.mean_n, errors.rmse_n, errors.p95_n].map(figures)));
    }
    let head = format!(
        "{} readings in {:.0} s, solved without each of {} blocks of time in turn",
        errors.rows, errors.span_s, errors.blocks
    );
    filled(&head, "  ") + &table.to_string() + &memories(&errors.choice) + "\n"
}

/// Describes by how much earlier readings lower the error of a force, and which are used.
pub(super) fn memories(choice: &MemoryChoice) -> String {
    let memory = match (choice.memory_s, choice.has_play) {
        (Some([first_s, last_s]), false) => format!("means over {first_s:.2} to {last_s:.0} s"),
        (Some([first_s, last_s]), true) => format!("means over {first_s:.2} to {last_s:.0} s, and outputs with play"),
        (None, _) => "outputs with play".to_owned(),
    };
    match choice.is_used {
        true => format!("earlier readings lower the error by {:.0} % ({memory})", 100.0 * choice.lower_by),
        false => "earlier readings don't lower the error clearly: the newest one is enough".to_owned(),
    }
}

/// The errors of places and force vectors, and the shares of the errors within the stated ones.
pub(super) fn vector_table(VectorEvaluation { errors, two_contacts }: &VectorEvaluation) -> String {
    let VectorErrors { presses, unsolved, shear_not_determinable, location_mm, press_n, shear_n, within } = errors;
    let percent = |components: &[usize], level: usize| {
        let shares = components.iter().map(|component| within[*component][level]);
        format!("{:.1}", 100.0 * shares.sum::<f64>() / components.len() as f64)
    };
    let mut table = TextTable::new(1, ["", "mean", "p95", "within 68 %", "within 95 %"]);
    let rows = [
        ("location, mm", Some(*location_mm), [0, 1].as_slice()),
        ("press, N", Some(*press_n), &[4]),
        ("along x and y, N", *shear_n, &[2, 3]),
    ];
    for (name, errors, components) in rows {
        let [mean, p95] =
            errors.map_or(["-", "-"].map(str::to_owned), |errors| errors.map(|error| format!("{error:.4}")));
        let within = |level| if errors.is_some() { percent(components, level) } else { "-".to_owned() };
        table.row(cells![name, mean, p95, within(0), within(1)]);
    }
    let unsolved = if *unsolved > 0 { format!("{unsolved} presses have no answer\n") } else { String::new() };
    let unstated = match shear_not_determinable {
        0 => String::new(),
        count => format!("{count} answers: the outputs don't determine the force along x and y\n"),
    };
    let pairs = if two_contacts.is_empty() { String::new() } else { pairs_table(two_contacts) };
    format!("errors of place and force vector on {presses} test presses\n{table}{unstated}{unsolved}{pairs}")
}

/// Answers to two contacts, by their distance.
fn pairs_table(two_contacts: &[SuperposedPresses]) -> String {
    let mut table = TextTable::new(1, ["distance from, mm", "pairs", "right", "not separable", "wrong", "one"]);
    for SuperposedPresses { from_mm, pairs, shares } in two_contacts {
        let PairShares { right, not_separable, wrong, one } = shares;
        let [right, not_separable, wrong, one] =
            [right, not_separable, wrong, one].map(|share| format!("{:.1} %", 100.0 * share));
        table.row(cells![format!("{from_mm:.0}"), pairs, right, not_separable, wrong, one]);
    }
    format!(
        "\ntwo contacts: the outputs of two test presses added; right means both places\nwithin 1 mm and both forces within 0.1 N\n{table}"
    )
}

/// Formats a number, not negative, in at most 6 characters.
pub(super) fn figures(number: f64) -> String {
    match number {
        small if small < 99.9995 => format!("{number:.3}"),
        large if large < 9999.95 => format!("{number:.1}"),
        _ => format!("{number:.1e}"),
    }
}

/// Breaks a paragraph at its blanks. Lines after the first are indented.
pub(super) fn filled(text: &str, indent: &str) -> String {
    textwrap::fill(text, textwrap::Options::new(WIDTH).subsequent_indent(indent)).replace(NO_BREAK, " ") + "\n"
}

/// The characteristics of each unit, after the paper's where it has them. [`definitions`] has their definitions.
pub(super) fn characteristics_table(
    staircases: &Staircases,
    repeatability: Repeatability,
    is_beside_paper: bool,
) -> String {
    let measured = characterise(staircases, repeatability);
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
    let interval = |interval: Option<(f64, f64)>| match interval {
        Some((least, most)) => format!("{least:.2} to {most:.2}"),
        None => "-".to_owned(),
    };
    let paper_head = || is_beside_paper.then(|| "paper".to_owned());
    let paper_cell = |column: usize, unit: usize| {
        let value = || paper::TABLE_1_PERCENT.get(unit - 1).map(|row| row[column]);
        is_beside_paper.then(|| number(value()))
    };
    let row = |name: &str, parts: [(Option<String>, &[String]); 2]| {
        let mut row = vec![name.to_owned()];
        for (paper, ours) in parts {
            row.extend(paper);
            row.extend_from_slice(ours);
        }
        row
    };
    let [loading, unloading] = ["loading", "unloading"].map(|branch| cells![branch, "95 % interval"]);
    let mut repeats = TextTable::new(0, row("unit", [(paper_head(), &loading), (paper_head(), &unloading)]));
    let heads = cells!["hysteresis", "of reading", "linearity", "zero return"];
    let mut others = TextTable::new(0, row("unit", [(paper_head(), &heads), (None, &[])]));
    for unit in measured.iter().filter(|unit| !unit.is_none()) {
        let loading =
            [number(unit.repeatability_loading_percent), interval(unit.repeatability_loading_interval_percent)];
        let unloading =
            [number(unit.repeatability_unloading_percent), interval(unit.repeatability_unloading_interval_percent)];
        let (name, of_paper) = (unit.name(), |column: usize| paper_cell(column, unit.unit));
        repeats.row(row(&name, [(of_paper(0), &loading), (of_paper(1), &unloading)]));
        let values = [
            unit.hysteresis_percent,
            unit.hysteresis_of_reading_percent,
            unit.linearity_percent,
            unit.zero_return_percent,
        ];
        others.row(row(&name, [(of_paper(2), &values.map(number)), (None, &[])]));
    }
    let mut text = format!("repeatability of each unit, % of full scale\n{repeats}\n");
    let _ = write!(text, "other characteristics, % of full scale; hysteresis also in % of the reading\n{others}");
    if staircases.left_out > 0 {
        let _ = writeln!(text, "excluded: {} flagged levels", staircases.left_out);
    }
    text
}

/// What the characteristics mean.
pub(super) fn definitions(repeatability: Repeatability) -> String {
    let mut text = "\n".to_owned();
    let repeats = ("repeatability", repeatability.definition());
    for (name, definition) in [repeats].into_iter().chain(terms::COMMON.map(|term| (term.name, term.definition))) {
        text += &filled(&format!("{name}: {definition}"), "  ");
    }
    text + &filled(terms::SOURCES, "") + SHARED_ERROR_NOTE
}

const SHARED_ERROR_NOTE: &str = "\
simulated taxels have one random error per contact, for both branches: the
unloading repeatability is not modelled separately\n";

/// The line of the broken outputs; empty without any.
pub(super) fn broken_outputs(outputs: &[String]) -> String {
    if outputs.is_empty() { String::new() } else { filled(&format!("broken: {}", outputs.join("; ")), "  ") }
}

fn footnotes(evaluations: &[&Evaluation]) -> String {
    let mut text = String::new();
    if let Some(evaluation) = evaluations.first().filter(|evaluation| evaluation.at_calibrated_places > 0) {
        let _ = writeln!(
            text,
            "{} of {} test presses are at places of the calibration",
            evaluation.at_calibrated_places,
            evaluation.points + evaluation.unsolved.len()
        );
    }
    // Flags belong to the run and are the same for every solver; missing answers belong to each solver.
    if let Some(left_out) = evaluations.first().map(|evaluation| &evaluation.left_out) {
        let (calibration, test) = (left_out.calibration_flagged, left_out.test_flagged);
        if calibration + test > 0 {
            let _ = writeln!(text, "excluded, flagged: {calibration} calibration and {test} test presses");
        }
    }
    text += &evaluations.first().map(|evaluation| broken_outputs(&evaluation.broken_outputs)).unwrap_or_default();
    // the best is one of them again
    let is_shown = |index: usize| evaluations[..index].iter().any(|before| before.solver == evaluations[index].solver);
    let each = || (0..evaluations.len()).filter(|index| !is_shown(*index)).map(|index| evaluations[index]);
    for Evaluation { solver, unsolved, .. } in each() {
        if let Some(first) = unsolved.first() {
            let _ = writeln!(
                text,
                "excluded, unsolved by {solver}: {} test presses; reason of the first:\n  {}",
                unsolved.len(),
                first.reason
            );
        }
    }
    for Evaluation { solver, verdicts, .. } in each() {
        text += &doubted(*verdicts)
            .map(|counts| filled(&format!("verdicts of {solver} other than ok: {counts}"), "  "))
            .unwrap_or_default();
    }
    for Evaluation { solver, not_as_calibrated_after, outputs_at_fault, .. } in each() {
        if let Some(presses) = not_as_calibrated_after {
            let why = match outputs_at_fault.as_slice() {
                [] => "the sensor has changed since, or contacts have other loads".to_owned(),
                outputs => outputs.join("; "),
            };
            let line = format!(
                "not as calibrated: after {presses} test presses too many don't fit the calibration of {solver}; {why}"
            );
            text += &filled(&line, "  ");
        }
    }
    for line in each().flat_map(doubted_half_widths) {
        text += &filled(&line, "  ");
    }
    text + &evaluations.iter().filter_map(|evaluation| evaluation.choice.as_ref()).map(chosen).collect::<String>()
}

/// Returns the number of presses with a verdict other than ok, and the verdicts, if there are any.
fn doubted(verdicts: Verdicts) -> Option<String> {
    let text: Vec<String> = verdicts
        .doubts()
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, word)| format!("{count} {word}"))
        .collect();
    (!text.is_empty()).then(|| text.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_control::Branch;
    use palpate_core::quantity::Place;
    use palpate_data::dataset::characteristics::HeldLevel;
    use palpate_data::dataset::evaluate::Trial;
    use palpate_data::dataset::{Mapping, parse_table};

    /// A small run: flagged and unsolvable presses are among its presses.
    const RUN: &str = "\
press,level,phase,x_mm,y_mm,force_set_n,force_n,out_1,out_2,flags,depth_mm,t_s,z_mm
0,0,calibration,-1,0,1,0.8,1,0.5,,0,0,0
1,0,calibration,1,0,1,0.8,0.5,1,,0,0,0
2,0,calibration,1,0,1,1,5,1,trip,0,0,0
3,0,test,-1,0,0.5,0.4,0.55,0.2,,0,0,0
4,0,test,1,0,0.5,0.4,0.2,0.55,trip,0,0,0
5,0,test,1,0,0.5,0.4,0.2,0.2,,0,0,0
";

    fn evaluation(solver: &str) -> Evaluation {
        let presses = parse_table("a.csv", RUN.as_bytes(), &Mapping::default()).unwrap();
        Trial::of_run(&presses, None).unwrap().evaluate(solver).unwrap()
    }

    #[test]
    fn excluded_presses_are_reported() {
        let text = evaluation_table(&[evaluation("pearson")], false);
        assert!(
            text.contains("flagged: 1 calibration and 1 test presses\nexcluded, unsolved by pearson: 1 test"),
            "{text}"
        );
    }

    #[test]
    fn without_forces_the_force_column_is_empty() {
        let located = Evaluation { force_error_n: None, ..evaluation("pearson") };
        let text = evaluation_table(&[located], true);
        assert!(text.contains("\nforce error, mean                   0.043 N         -\n"), "{text}");
    }

    #[test]
    fn choice_and_doubts_of_a_solver_are_printed() {
        let candidate = |solver: &str, location_error_mm| TriedMethod {
            solver: solver.to_owned(),
            location_error_mm,
            force_error_n: None,
        };
        let candidates = vec![
            candidate("gaussian-process", Some(0.1234)),
            candidate("pearson", Some(123.46)),
            candidate("physics", None),
        ];
        let untried = Choice {
            candidates: candidates[2..].to_vec(),
            ties: Vec::new(),
            mean_place_error_mm: None,
            load_gain: None,
        };
        assert_eq!(chosen(&untried), "chosen without cross-validation: too few presses\n");
        let ties = vec![Tie { solver: "pearson".to_owned(), sigmas: 1.25 }];
        let tied =
            chosen(&Choice { candidates: candidates.clone(), ties, mean_place_error_mm: Some(4.0), load_gain: None });
        assert!(
            tied.ends_with(
                "\ngaussian-process is nearly tied with pearson (the errors differ by 1.2 standard\n  errors)\n"
            ),
            "{tied}"
        );
        let lost = chosen(&Choice {
            candidates: candidates.clone(),
            ties: Vec::new(),
            mean_place_error_mm: Some(0.13),
            load_gain: None,
        });
        assert!(lost.contains("\nwarning: an answer that is always the mean place has 0.130 mm"), "{lost}");
        let choice = Choice { candidates, ties: Vec::new(), mean_place_error_mm: Some(4.0), load_gain: None };
        assert_eq!(
            chosen(&choice),
            "chosen by cross-validation on the calibration: gaussian-process 0.123 mm,\n  pearson 123.5 mm\n"
        );
        let verdicts = Verdicts { ok: 3, weak_signal: 2, outside_area: 0, not_one_contact: 0, channel_fault: 1 };
        let evaluation = Evaluation { choice: Some(choice), verdicts, ..evaluation("pearson") };
        let text = evaluation_table(&[evaluation], false);
        assert!(
            text.contains("\nverdicts of pearson other than ok: 2 weak-signal, 1 channel-fault\nchosen by cross-"),
            "{text}"
        );
    }

    #[test]
    fn solver_table_fits_80_columns() {
        let evaluation = evaluation("pearson");
        let far = ErrorSummary { mean: 1.0e6, median: 99.9996, p95: 9999.96, max: 123_456.0 };
        let far = Evaluation {
            solver: "gaussian-process".to_owned(),
            location_error_mm: far,
            ns_per_solve: Some(1_234_567.0),
            ..evaluation.clone()
        };
        let outcomes = [("pearson", Ok(evaluation)), ("physics", Err("a reason ".repeat(20))), ("best", Ok(far))];
        let outcomes = outcomes.map(|(name, outcome)| (name.to_owned(), outcome));
        let text = solvers_table(&outcomes, true);
        assert!(text.lines().all(|line| line.len() <= 80), "{text}");
        assert!(text.contains("\nbest: gaussian-process 1.0e6  100.0 1.0e4   1.2e5"), "{text}");
        assert_eq!(text.matches("excluded, unsolved by").count(), 2, "{text}");
    }

    #[test]
    fn nothing_printed_is_wider_than_80_columns() {
        let evaluation = evaluation("pearson-lsq");
        let held = |branch, force_n| HeldLevel {
            place: Place::default(),
            top_n: 2.0,
            branch,
            force_set_n: force_n,
            force_n,
            output: force_n,
        };
        let up = [0.0, 1.0, 2.0].map(|force_n| held(Branch::Loading, force_n));
        let down = [1.0, 0.0].map(|force_n| held(Branch::Unloading, force_n));
        // the widest that a unit may be: a thousand percent off
        let wild =
            [up.as_slice(), &down].concat().into_iter().map(|held| HeldLevel { output: -12.0 * held.output, ..held });
        let readings = vec![[up.to_vec(), down.to_vec(), wild.collect()].concat(); 9];
        for repeatability in Repeatability::ALL {
            let staircases =
                Staircases { units: (0..readings.len()).collect(), readings: readings.clone(), left_out: 3 };
            let text = evaluation_table(&[evaluation.clone(), evaluation.clone(), evaluation.clone()], true)
                + &characteristics_table(&staircases, repeatability, true)
                + &definitions(repeatability);
            assert!(text.lines().all(|line| line.len() <= 80), "{text}");
        }
    }
}
