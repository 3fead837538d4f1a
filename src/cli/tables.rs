//! Tables for a person, in at most 80 columns. They show the paper's numbers only for an array and a protocol like the paper's,
//! see [`palpate_report::report::is_beside_paper`].

use crate::api::Outcome;
use palpate_data::dataset::characteristics::{Repeatability, Staircases, characterise, terms};
use palpate_data::dataset::doubted_half_widths;
use palpate_report::paper;
use palpate_solver::{BEST, Candidate, Choice, Coverage, ErrorSummary, Evaluation, LoadGain, Tie, Verdicts};
use std::fmt::Write as _;

/// Largest width of printed output, columns.
pub(super) const WIDTH: usize = 80;

/// Width of a row's label in the table of errors, of the paper's column, and of a method's.
pub(super) const LABEL: usize = 27;
pub(super) const PAPER_COLUMN: usize = 9;
pub(super) const COLUMN: usize = 14;

/// Blank at which [`filled`] doesn't break a line.
const NO_BREAK: char = '\u{a0}';

/// Rows that a table of errors has, from those that every table has to those that only the longest one has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Detail {
    Means,
    Shares,
    All,
}

/// The results of any number of solvers on the same test, the paper's before them or not, in at most 80 columns for up to three.
pub(super) fn evaluation_table(evaluations: &[Evaluation], is_beside_paper: bool) -> String {
    let evaluations: Vec<&Evaluation> = evaluations.iter().collect();
    let rows = evaluation_rows(&evaluations, is_beside_paper).into_iter().map(|(_, row)| row + "\n");
    rows.collect::<String>() + &footnotes(&evaluations)
}

/// The rows of that table.
pub(super) fn evaluation_rows(evaluations: &[&Evaluation], is_beside_paper: bool) -> Vec<(Detail, String)> {
    let mut rows = Vec::new();
    let mut row = |detail: Detail, label: &str, paper: &str, ours: &dyn Fn(&Evaluation) -> String| {
        let ours: String = evaluations.iter().map(|evaluation| format!("{:>COLUMN$}", ours(evaluation))).collect();
        let paper = if is_beside_paper { format!("{paper:>PAPER_COLUMN$}") } else { String::new() };
        rows.push((detail, format!("{label:<LABEL$}{paper}{ours}").trim_end().to_owned()));
    };
    let of = |error: Option<ErrorSummary>, part: fn(&ErrorSummary) -> f64, unit: &str| match error {
        Some(error) => format!("{:.3} {unit}", part(&error)),
        None => "-".to_owned(),
    };
    let share = |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
    let papers = |share: f64| format!("{:.0} %", 100.0 * share);
    row(Detail::Means, "", "paper", &|e| e.solver.clone());
    row(Detail::All, "points", &paper::POINTS.to_string(), &|e| e.points.to_string());
    row(Detail::Means, "location error, mean", &format!("{} mm", paper::LOCATION_ERROR_MM), &|e| {
        of(Some(e.location_error_mm), |error| error.mean, "mm")
    });
    row(Detail::All, "  median", "", &|e| of(Some(e.location_error_mm), |error| error.median, "mm"));
    row(Detail::All, "  95th percentile", "", &|e| of(Some(e.location_error_mm), |error| error.p95, "mm"));
    row(Detail::All, "  largest", "", &|e| of(Some(e.location_error_mm), |error| error.max, "mm"));
    row(Detail::Means, "force error, mean", &format!("{} N", paper::FORCE_ERROR_N), &|e| {
        of(e.force_error_n, |error| error.mean, "N")
    });
    row(Detail::All, "  median", "", &|e| of(e.force_error_n, |error| error.median, "N"));
    row(Detail::All, "  95th percentile", "", &|e| of(e.force_error_n, |error| error.p95, "N"));
    row(Detail::All, "  largest", "", &|e| of(e.force_error_n, |error| error.max, "N"));
    if evaluations.iter().any(|evaluation| evaluation.force_error_load_cell_n.is_some()) {
        row(Detail::All, "  mean, by the load cell", "", &|e| of(e.force_error_load_cell_n, |error| error.mean, "N"));
    }
    row(Detail::Shares, "location error under 1 mm", &papers(paper::WITHIN_1MM), &|e| {
        share(Some(e.within.location_1mm))
    });
    row(Detail::Shares, "force error under 0.1 N", &papers(paper::WITHIN_0_1N), &|e| share(e.within.force_0_1n));
    row(Detail::Shares, "both", &papers(paper::WITHIN_BOTH), &|e| share(e.within.both));
    let has_half_widths = |e: &&Evaluation| e.coverage.as_ref().is_some_and(|coverage| coverage.location_68.is_some());
    if evaluations.iter().any(has_half_widths) {
        let both = |e: &Evaluation, parts: fn(&Coverage) -> [Option<f64>; 2]| {
            let shares = e.coverage.as_ref().map(parts).and_then(|[narrow, wide]| Some((narrow?, wide?)));
            shares.map_or("-".to_owned(), |(narrow, wide)| format!("{:.1}, {:.1} %", 100.0 * narrow, 100.0 * wide))
        };
        row(Detail::All, "inside stated 68, 95 %", "", &|e| both(e, |c| [c.location_68, c.location_95]));
        row(Detail::All, "  of the force", "", &|e| both(e, |c| [c.force_68, c.force_95]));
    }
    if evaluations.iter().any(|evaluation| evaluation.ns_per_solve.is_some()) {
        row(Detail::All, "time a solve", "", &|e| {
            e.ns_per_solve.map_or("-".to_owned(), |ns| format!("{:.2} us", ns / 1000.0))
        });
    }
    rows
}

/// The results of every solver on the same test, or why it has none, a line each; the paper's above them or not.
pub(super) fn solvers_table(outcomes: &[Outcome], is_beside_paper: bool) -> String {
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
        let papers = [
            format!("{} - - -", paper::LOCATION_ERROR_MM),
            paper::FORCE_ERROR_N.to_string(),
            format!("{:.1} {:.1}", 100.0 * paper::WITHIN_1MM, 100.0 * paper::WITHIN_BOTH),
        ];
        text += &line("paper", [&words(&papers[0]), &words(&papers[1]), &words(&papers[2])], "-");
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
pub(super) fn chosen(choice: &Choice) -> String {
    let named = |candidate: &Candidate| Some((candidate.solver.clone(), candidate.location_error_mm?));
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
        format!(" ({}: ahead by too little to be chosen)", smaller.join(", "))
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
pub(super) fn cross_validated_table(candidates: &[Candidate]) -> String {
    let number = |error: Option<f64>| error.map_or("-".to_owned(), figures);
    let mut text = "no test presses: cross-validated errors of the calibration, mean\n".to_owned();
    let _ = writeln!(text, "{:<22}{:>14}{:>10}", "", "location, mm", "force, N");
    for Candidate { solver, location_error_mm, force_error_n } in candidates {
        let _ = writeln!(text, "{solver:<22}{:>14}{:>10}", number(*location_error_mm), number(*force_error_n));
    }
    text + "each press was solved by the method fitted without the press's place\n"
}

/// Formats a number, not negative, in at most 6 characters.
fn figures(number: f64) -> String {
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

/// The characteristics of each unit, after the paper's where they stand, with their definitions in [`definitions`], in at most 80 columns.
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
    // a column of the paper's, where it stands
    let papers = |head: &str, column: Option<usize>, unit: Option<usize>| {
        let cell = match (column, unit) {
            (Some(column), Some(unit)) => number(paper::TABLE_1_PERCENT.get(unit - 1).map(|row| row[column])),
            _ => head.to_owned(),
        };
        is_beside_paper.then_some((9, cell))
    };
    let units = || measured.iter().filter(|unit| !unit.is_none());
    let plain = |width: usize, cell: String| Some((width, cell));
    let line = |cells: Vec<Option<(usize, String)>>| {
        cells.into_iter().flatten().map(|(width, cell)| format!("{cell:>width$}")).collect::<String>() + "\n"
    };
    let repeats = |first: String, [loading, unloading]: [(String, String); 2], unit: Option<usize>| {
        line(vec![
            plain(4, first),
            papers("paper", Some(0), unit),
            plain(8, loading.0),
            plain(18, loading.1),
            papers("paper", Some(1), unit),
            plain(8, unloading.0),
            plain(18, unloading.1),
        ])
    };
    let others = |first: String, [hysteresis, of_reading, linearity, zero_return]: [String; 4], unit: Option<usize>| {
        line(vec![
            plain(4, first),
            papers("paper", Some(2), unit),
            plain(8, hysteresis),
            plain(18, of_reading),
            plain(15, linearity),
            plain(15, zero_return),
        ])
    };
    let mut text = "Characteristics of each unit, % of full scale\n".to_owned();
    text += &line(vec![
        plain(4, String::new()),
        papers("", None, None),
        plain(26, "repeatability, loading".to_owned()),
        papers("", None, None),
        plain(26, "repeatability, unloading".to_owned()),
    ]);
    let head = || ("found".to_owned(), "95 % interval".to_owned());
    text += &repeats("unit".to_owned(), [head(), head()], None);
    for unit in units() {
        let loading =
            (number(unit.repeatability_loading_percent), interval(unit.repeatability_loading_interval_percent));
        let unloading =
            (number(unit.repeatability_unloading_percent), interval(unit.repeatability_unloading_interval_percent));
        text += &repeats(unit.name(), [loading, unloading], Some(unit.unit));
    }
    text.push('\n');
    let width = if is_beside_paper { 21 } else { 12 };
    text += &format!("{:>width$}{:>18}\n", "hysteresis", "hysteresis,");
    let heads = ["found", "% of reading", "linearity", "zero return"].map(str::to_owned);
    text += &others("unit".to_owned(), heads, None);
    for unit in units() {
        let cells = [
            unit.hysteresis_percent,
            unit.hysteresis_of_reading_percent,
            unit.linearity_percent,
            unit.zero_return_percent,
        ];
        text += &others(unit.name(), cells.map(number), Some(unit.unit));
    }
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
    // What is flagged is the run's doing and the same for every solver; what has no answer is each one's own.
    if let Some(left_out) = evaluations.first().map(|evaluation| &evaluation.left_out) {
        let (calibration, test) = (left_out.calibration_flagged, left_out.test_flagged);
        if calibration + test > 0 {
            let _ = writeln!(text, "excluded, flagged: {calibration} calibration and {test} test presses");
        }
    }
    // the best is one of them once more
    let is_told = |index: usize| evaluations[..index].iter().any(|before| before.solver == evaluations[index].solver);
    let each = || (0..evaluations.len()).filter(|index| !is_told(*index)).map(|index| evaluations[index]);
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
    for Evaluation { solver, not_as_calibrated_after, .. } in each() {
        if let Some(presses) = not_as_calibrated_after {
            let line = format!(
                "not as calibrated: after {presses} test presses too many don't fit the calibration of {solver}; the sensor \
                 has changed since, or contacts have other loads"
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
    fn what_was_left_out_is_said() {
        let text = evaluation_table(&[evaluation("pearson")], false);
        assert!(
            text.contains("flagged: 1 calibration and 1 test presses\nexcluded, unsolved by pearson: 1 test"),
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
        let outcomes = outcomes.map(|(name, outcome)| (name.to_owned(), outcome));
        let text = solvers_table(&outcomes, true);
        assert!(text.lines().all(|line| line.len() <= 80), "{text}");
        assert!(text.contains("\nbest: gaussian-process   1.0e6   100.0   1.0e4   1.2e5"), "{text}");
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
        // the widest that a unit may fill: a thousand percent off
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
