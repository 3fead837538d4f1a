//! The tables a person reads, in at most 80 columns. The paper's numbers are in them only where they stand beside ours, see
//! [`crate::report::is_beside_paper`].

use crate::dataset::characteristics::{
    CORRECTION_DEFINITION, HYSTERESIS_DEFINITION, Repeatability, Staircases, characterise,
};
use crate::paper;
use crate::solver::{
    BEST, Candidate, Choice, Coverage, ErrorSummary, Evaluation, FORCE_REFERENCE_N, LOCATION_REFERENCE_MM, Verdicts,
};
use std::fmt::Write as _;

/// The widest that anything is printed, columns.
const WIDTH: usize = 80;

/// A blank at which [`filled`] breaks no line.
const NO_BREAK: char = '\u{a0}';

/// The results of any number of solvers on the same test, the paper's before them or not, in at most 80 columns for up to three.
pub fn evaluation_table(evaluations: &[Evaluation], is_beside_paper: bool) -> String {
    let mut text = String::new();
    let mut row = |label: &str, paper: &str, ours: &dyn Fn(&Evaluation) -> String| {
        let ours: String = evaluations.iter().map(|evaluation| format!("{:>14}", ours(evaluation))).collect();
        let paper = if is_beside_paper { format!("{paper:>9}") } else { String::new() };
        let _ = writeln!(text, "{}", format!("{label:<27}{paper}{ours}").trim_end());
    };
    let of = |error: Option<ErrorSummary>, part: fn(&ErrorSummary) -> f64, unit: &str| match error {
        Some(error) => format!("{:.3} {unit}", part(&error)),
        None => "-".to_owned(),
    };
    let share = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
    row("", "paper", &|e| e.solver.clone());
    row("points", "100", &|e| e.points.to_string());
    row("location error, mean", "0.46 mm", &|e| of(Some(e.location_error_mm), |error| error.mean, "mm"));
    row("  median", "", &|e| of(Some(e.location_error_mm), |error| error.median, "mm"));
    row("  95th percentile", "", &|e| of(Some(e.location_error_mm), |error| error.p95, "mm"));
    row("  largest", "", &|e| of(Some(e.location_error_mm), |error| error.max, "mm"));
    row("force error, mean", "0.043 N", &|e| of(e.force_error_n, |error| error.mean, "N"));
    row("  median", "", &|e| of(e.force_error_n, |error| error.median, "N"));
    row("  95th percentile", "", &|e| of(e.force_error_n, |error| error.p95, "N"));
    row("  largest", "", &|e| of(e.force_error_n, |error| error.max, "N"));
    if evaluations.iter().any(|evaluation| evaluation.force_error_load_cell_n.is_some()) {
        row("  mean, by the load cell", "", &|e| of(e.force_error_load_cell_n, |error| error.mean, "N"));
    }
    row("location error under 1 mm", "93 %", &|e| share(Some(e.within.location_1mm)));
    row("force error under 0.1 N", "91 %", &|e| share(e.within.force_0_1n));
    row("both", "84 %", &|e| share(e.within.both));
    if evaluations.iter().any(|evaluation| evaluation.coverage.is_some()) {
        let both = |e: &Evaluation, parts: fn(&Coverage) -> [Option<f64>; 2]| {
            let shares = e.coverage.as_ref().map(parts).and_then(|[one, two]| Some((one?, two?)));
            shares.map_or("-".to_owned(), |(one, two)| format!("{:.1}, {:.1} %", 100.0 * one, 100.0 * two))
        };
        row("x, y within 1, 2 stated sd", "", &|e| both(e, |c| [Some(c.xy_1sd), Some(c.xy_2sd)]));
        row("force within 1, 2 stated sd", "", &|e| both(e, |c| [c.force_1sd, c.force_2sd]));
    }
    if evaluations.iter().any(|evaluation| evaluation.ns_per_solve.is_some()) {
        row("time a solve", "", &|e| e.ns_per_solve.map_or("-".to_owned(), |ns| format!("{:.2} us", ns / 1000.0)));
    }
    row("accepted", "yes", &|e| if e.accepted() { "yes" } else { "no" }.to_owned());
    text + &footnotes(&evaluations.iter().collect::<Vec<_>>())
}

/// The results of every solver on the same test, or why it has none, a line each; the paper's above them or not.
pub fn solvers_table(outcomes: &[(&str, Result<Evaluation, String>)], is_beside_paper: bool) -> String {
    let line = |name: &str, [location, force, within]: [&[String]; 3], time: &str| {
        let cells =
            |cells: &[String], width: usize| cells.iter().map(|cell| format!("{cell:>width$}")).collect::<String>();
        let numbers = cells(location, 8) + &cells(force, 7) + &cells(within, 6);
        format!("{name:<22}{numbers}{time:>7}").trim_end().to_owned() + "\n"
    };
    let words = |words: &str| words.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let mut text = format!("{:<22}{:<31}{:>8}{:>12}{:>7}\n", "", "  location error, mm", "force, N", "within, %", "us");
    text += &line("", [&words("mean median p95 largest"), &words("mean"), &words("1mm both")], "solve");
    if is_beside_paper {
        text += &line("paper", [&words("0.46 - - -"), &words("0.043"), &words("93.0 84.0")], "-");
    }
    for (name, outcome) in outcomes {
        let evaluation = match outcome {
            Ok(evaluation) => evaluation,
            Err(reason) => {
                text += &filled(&format!("{name:<22}{reason}"), &" ".repeat(22));
                continue;
            }
        };
        let name = if *name == BEST { format!("{BEST}: {}", evaluation.solver) } else { (*name).to_owned() };
        let ErrorSummary { mean, median, p95, max } = evaluation.location_error_mm;
        let force = evaluation.force_error_n.map_or("-".to_owned(), |error| figures(error.mean));
        let percent = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:.1}", 100.0 * share));
        let within = [Some(evaluation.within.location_1mm), evaluation.within.both].map(percent);
        let us = evaluation.ns_per_solve.map_or("-".to_owned(), |ns| figures(ns / 1000.0));
        text += &line(&name, [&[mean, median, p95, max].map(figures), &[force], &within], &us);
    }
    let evaluations: Vec<&Evaluation> = outcomes.iter().filter_map(|(_, outcome)| outcome.as_ref().ok()).collect();
    text + &footnotes(&evaluations)
}

/// How a method was chosen, in a line or two.
pub fn chosen(choice: &Choice) -> String {
    let candidate = |candidate: &Candidate| {
        let error_mm = candidate.location_error_mm?;
        Some(format!("{} {}{NO_BREAK}mm", candidate.solver, figures(error_mm)))
    };
    let tried: Vec<String> = choice.candidates.iter().filter_map(candidate).collect();
    if tried.is_empty() {
        return "chosen without cross-validation: too few presses\n".to_owned();
    }
    filled(&format!("chosen by cross-validation on the calibration: {}", tried.join(", ")), "  ")
}

/// A number, not negative, in at most 6 characters.
fn figures(number: f64) -> String {
    match number {
        small if small < 99.9995 => format!("{number:.3}"),
        large if large < 9999.95 => format!("{number:.1}"),
        _ => format!("{number:.1e}"),
    }
}

/// A paragraph broken at its blanks, lines after the first indented.
fn filled(text: &str, indent: &str) -> String {
    textwrap::fill(text, textwrap::Options::new(WIDTH).subsequent_indent(indent)).replace(NO_BREAK, " ") + "\n"
}

/// Repeatability and hysteresis of each unit, after the paper's or not, with the definitions underneath, in at most 80 columns.
pub fn characteristics_table(staircases: &Staircases, repeatability: Repeatability, is_beside_paper: bool) -> String {
    let measured = characterise(staircases, repeatability);
    let line = |first: &str, columns: [String; 3]| {
        let [loading, unloading, hysteresis] = columns;
        format!("{first:<15}{loading:>18}{unloading:>23}{hysteresis:>23}").trim_end().to_owned() + "\n"
    };
    let mut text = line("% of", ["repeatability", "repeatability", "hysteresis"].map(str::to_owned));
    text += &line("full scale", ["loading", "unloading", ""].map(str::to_owned));
    let head = if is_beside_paper { format!("paper{:>9}", "measured") } else { String::new() };
    text += &line("unit", [&head, &head, &head].map(String::clone));
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
    for (index, unit) in measured.iter().enumerate() {
        let ours = [unit.repeatability_loading_percent, unit.repeatability_unloading_percent, unit.hysteresis_percent];
        if ours.iter().all(Option::is_none) {
            continue; // it wasn't measured
        }
        let cell = |column: usize| match paper::TABLE_1_PERCENT.get(index).filter(|_| is_beside_paper) {
            Some(row) => format!("{:.2}{:>9}", row[column], number(ours[column])),
            None => number(ours[column]),
        };
        text += &line(&unit.unit.to_string(), [0, 1, 2].map(cell));
    }
    let _ = writeln!(text, "\n{}\n{HYSTERESIS_DEFINITION}\n{CORRECTION_DEFINITION}", repeatability.definition());
    text.push_str(SHARED_ERROR_NOTE);
    if staircases.left_out > 0 {
        let _ = writeln!(text, "left out: {} flagged levels", staircases.left_out);
    }
    text
}

const SHARED_ERROR_NOTE: &str = "\
simulated taxels draw one error a contact, for both branches: there, the
unloading repeatability is not modelled apart\n";

fn footnotes(evaluations: &[&Evaluation]) -> String {
    let mut text = format!(
        "(mean errors under {LOCATION_REFERENCE_MM} mm and, where the force is known, {FORCE_REFERENCE_N} N)\n"
    );
    // What is flagged is the run's doing and the same for every solver; what has no answer is each one's own.
    if let Some(left_out) = evaluations.first().map(|evaluation| &evaluation.left_out) {
        let (calibration, test) = (left_out.calibration_flagged, left_out.test_flagged);
        if calibration + test > 0 {
            let _ = writeln!(text, "left out, flagged: {calibration} calibration and {test} test presses");
        }
    }
    // the best is one of them once more
    let is_told = |index: usize| evaluations[..index].iter().any(|before| before.solver == evaluations[index].solver);
    let each = || (0..evaluations.len()).filter(|index| !is_told(*index)).map(|index| evaluations[index]);
    for Evaluation { solver, unsolved, .. } in each() {
        if let Some(first) = unsolved.first() {
            let _ = writeln!(
                text,
                "left out, unsolved by {solver}: {} test presses, the first as\n  {}",
                unsolved.len(),
                first.reason
            );
        }
    }
    for Evaluation { solver, verdicts, .. } in each() {
        text += &doubted(*verdicts)
            .map(|counts| filled(&format!("doubted by {solver}: {counts}"), "  "))
            .unwrap_or_default();
    }
    text + &evaluations.iter().filter_map(|evaluation| evaluation.choice.as_ref()).map(chosen).collect::<String>()
}

/// How many presses got a verdict other than ok, and which, if there are any.
fn doubted(verdicts: Verdicts) -> Option<String> {
    let told: Vec<String> = verdicts
        .doubts()
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, word)| format!("{count} {word}"))
        .collect();
    (!told.is_empty()).then(|| told.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Branch;
    use crate::dataset::characteristics::HeldLevel;
    use crate::dataset::evaluate::{Trial, tests};
    use clap::ValueEnum as _;

    fn evaluation(solver: &str) -> Evaluation {
        Trial::of_run(&tests::run(tests::RUN), None).unwrap().evaluate(solver).unwrap()
    }

    #[test]
    fn what_was_left_out_is_said() {
        let text = evaluation_table(&[evaluation("pearson")], false);
        assert!(
            text.contains("flagged: 1 calibration and 1 test presses\nleft out, unsolved by pearson: 1 test"),
            "{text}"
        );
    }

    #[test]
    fn without_forces_the_force_column_is_empty() {
        let located = Evaluation { force_error_n: None, ..evaluation("pearson") };
        assert!(evaluation_table(&[located], true).contains("force error, mean            0.043 N             -"));
    }

    #[test]
    fn how_a_solver_was_chosen_and_what_it_doubts_is_said() {
        let candidate = |solver: &str, location_error_mm| Candidate {
            solver: solver.to_owned(),
            location_error_mm,
            force_error_n: None,
        };
        let candidates = vec![
            candidate("gaussian-process", Some(0.1234)),
            candidate("pearson", Some(123.46)),
            candidate("physics", None),
        ];
        let untried = Choice { candidates: candidates[2..].to_vec() };
        assert_eq!(chosen(&untried), "chosen without cross-validation: too few presses\n");
        let choice = Choice { candidates };
        assert_eq!(
            chosen(&choice),
            "chosen by cross-validation on the calibration: gaussian-process 0.123 mm,\n  pearson 123.5 mm\n"
        );
        let verdicts = Verdicts { ok: 3, weak_signal: 2, outside_area: 0, not_one_contact: 0, channel_fault: 1 };
        let evaluation = Evaluation { choice: Some(choice), verdicts, ..evaluation("pearson") };
        let text = evaluation_table(&[evaluation], false);
        assert!(text.contains("\ndoubted by pearson: 2 weak-signal, 1 channel-fault\nchosen by cross-"), "{text}");
    }

    #[test]
    fn a_line_a_solver_stays_within_80_columns() {
        let evaluation = evaluation("pearson");
        let far = ErrorSummary { mean: 1.0e6, median: 99.9996, p95: 9999.96, max: 123_456.0 };
        let far = Evaluation {
            solver: "gaussian-process".to_owned(),
            location_error_mm: far,
            ns_per_solve: Some(1_234_567.0),
            ..evaluation.clone()
        };
        let outcomes = [("pearson", Ok(evaluation)), ("physics", Err("a reason ".repeat(20))), ("best", Ok(far))];
        let text = solvers_table(&outcomes, true);
        assert!(text.lines().all(|line| line.len() <= 80), "{text}");
        assert!(text.contains("\nbest: gaussian-process   1.0e6   100.0   1.0e4   1.2e5"), "{text}");
        assert_eq!(text.matches("left out, unsolved by").count(), 2, "{text}");
    }

    #[test]
    fn nothing_printed_is_wider_than_80_columns() {
        let evaluation = evaluation("pearson-lsq");
        let reading = |force_n| HeldLevel { branch: Branch::Loading, force_set_n: force_n, force_n, output: force_n };
        let readings = vec![[0.0, 1.0, 2.0].map(reading).to_vec(); 9];
        for repeatability in Repeatability::value_variants() {
            let staircases = Staircases { readings: readings.clone(), left_out: 3 };
            let text = evaluation_table(&[evaluation.clone(), evaluation.clone(), evaluation.clone()], true)
                + &characteristics_table(&staircases, *repeatability, true);
            assert!(text.lines().all(|line| line.len() <= 80), "{text}");
        }
    }
}
