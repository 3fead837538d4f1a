//! How a run ended, for a person.

use super::tables::{WIDTH, characteristics_table, definitions, evaluation_table, filled};
use super::verdict::{NO_RULE, verdict_table};
use crate::api::{Failure, RunResults};
use palpate_control::SafetyRule;
use palpate_data::dataset::characteristics::Repeatability;
use palpate_data::dataset::{DatasetError, JournalError, RunFolder, Status, TABLES};
use std::fmt::Write as _;
use std::io::{self, Write};

/// How a run ended, how long it took, and where its files are; the tables only where all is printed.
pub(super) fn ended(folder: &RunFolder, virtual_time: bool, is_full: bool) -> String {
    let manifest = folder.manifest();
    let mut text = String::new();
    // writing to a string can't fail
    let _ = writeln!(
        text,
        "{}: {} of {} presses, {}",
        manifest.status.name(),
        manifest.presses_done,
        manifest.facts.presses_planned,
        folder.path().display()
    );
    if virtual_time {
        let (passed, wall_s) = (duration(manifest.virtual_s), manifest.wall_s);
        let _ = writeln!(text, "time: {passed} of virtual time in {wall_s:.2} s");
    } else {
        let _ = writeln!(text, "time: {}", duration(manifest.wall_s));
    }
    let flagged = manifest.rows_flagged;
    if flagged > 0 {
        let _ = writeln!(text, "flagged: {flagged} rows; they are stored but not evaluated");
    }
    text += &manifest.glitches.text().map_or_else(String::new, |text| filled(&text, "  "));
    text += &manifest.missed.text().map_or_else(String::new, |text| filled(&text, "  "));
    if let Some(check) = folder.check_line() {
        text += &filled(check, "  ");
    }
    match (manifest.status, manifest.presses_done) {
        (Status::Complete, _) => {}
        (Status::Failed | Status::Tripped, 0) => {
            _ = writeln!(text, "no press was recorded: correct the problem and run again")
        }
        (Status::Tripped, _) => {
            let is_comparison = manifest.trip.as_ref().is_some_and(|trip| trip.rule == SafetyRule::OutputsDiffer);
            let sound = if is_comparison { "\n  or, if the press is sound, --sound outputs-differ" } else { "" };
            _ = writeln!(text, "to continue: palpate resume {} --after-trip{sound}", folder.path().display())
        }
        _ => _ = writeln!(text, "to continue: palpate resume {}", folder.path().display()),
    }
    if is_full && manifest.presses_done > 0 {
        let there: Vec<&str> = TABLES.into_iter().filter(|name| folder.path().join(name).is_file()).collect();
        text += &format!("its tables:\n{}", filled(&there.join(" "), ""));
    }
    text
}

/// What is safe of a run that couldn't be finished.
pub(super) fn unfinished(folder: &RunFolder, error: &DatasetError) -> String {
    let (manifest, path) = (folder.manifest(), folder.path().display());
    let made = format!("not finished: {} of {} presses", manifest.presses_done, manifest.facts.presses_planned);
    match error {
        DatasetError::Journal(JournalError::Displaced { .. }) => {
            format!("{made}, in a journal that isn't in {path} now\n")
        }
        _ => format!("{made}, stored in the journal of {path}\nto continue: palpate resume {path}\n"),
    }
}

/// Prints the warnings about a run's journal.
pub(super) fn warn(folder: &RunFolder) -> Result<(), Failure> {
    folder.warnings().iter().try_for_each(|warning| tell(&format!("warning: {warning}\n")))
}

/// The results of a complete run for a person: evaluation, characteristics and verdict, with all that is known.
pub(super) fn full(results: &RunResults) -> String {
    let mut text = String::new();
    if !results.evaluations.is_empty() {
        let _ = write!(text, "\n{}", evaluation_table(&results.evaluations, results.is_beside_paper));
    }
    if let Some(staircases) = &results.characteristics {
        let table = characteristics_table(staircases, Repeatability::default(), results.is_beside_paper)
            + &definitions(Repeatability::default());
        let _ = write!(text, "\n{table}");
    }
    match &results.judgement {
        Some(judgement) => _ = write!(text, "\n{}", verdict_table(judgement)),
        None if results.evaluations.is_empty() => {}
        None => _ = write!(text, "\n{NO_RULE}"),
    }
    text
}

/// Width of a terminal, columns; of what isn't a terminal, the usual one.
#[cfg(unix)]
pub(super) fn width(of: impl std::os::fd::AsFd) -> usize {
    let columns = rustix::termios::tcgetwinsize(of).map_or(0, |size| usize::from(size.ws_col));
    if columns == 0 { WIDTH } else { columns }
}

/// Width of a terminal, columns.
#[cfg(not(unix))]
pub(super) fn width<T>(_: T) -> usize {
    WIDTH
}

/// A duration as a person reads it.
pub(super) fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match (whole / 3600, whole % 3600 / 60, whole % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s:02} s"),
        (h, m, _) => format!("{h} h {m:02} min"),
    }
}

/// A word, and beside it a text over as many lines of 80 columns as it needs.
pub(super) fn beside(word: &str, columns: usize, text: &str) -> String {
    let (first, others) = (format!("{word:<columns$}"), " ".repeat(columns));
    textwrap::fill(text, textwrap::Options::new(80).initial_indent(&first).subsequent_indent(&others)) + "\n"
}

/// Writes to standard output; a reader that has seen enough (`| head`) is no error.
pub(super) fn print(text: &str) -> Result<(), Failure> {
    written(io::stdout().lock(), text)
}

/// Prints a note or a warning, in lines of at most 80 columns. If nobody can read it, the command continues.
pub(super) fn note(text: &str) {
    let _ = tell(&filled(text, "  "));
}

/// Writes to standard error.
pub(super) fn tell(text: &str) -> Result<(), Failure> {
    written(io::stderr().lock(), text)
}

fn written(mut to: impl Write, text: &str) -> Result<(), Failure> {
    let is_shown = |c: char| !c.is_control() || matches!(c, '\n' | '\t');
    let text = if text.chars().all(is_shown) { text } else { &text.replace(|c| !is_shown(c), "\u{fffd}") };
    match to.write_all(text.as_bytes()).and_then(|()| to.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            let help = "free disk space, or write the output to another place";
            Err(Failure::unwritten(miette::miette!(help = help, "can't write the result: {error}")))
        }
        _ => Ok(()),
    }
}
