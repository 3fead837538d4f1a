//! Every driver on a line that drops, delays, repeats, truncates, garbles and swaps messages, and sometimes closes. No call hangs or
//! panics, no value is used that can be known to be wrong, and a stage ends where it was sent or stopped.
//!
//! `PALPATE_TESTS=10` makes 100,000 runs of all drivers together, `PALPATE_BAD_LINE_ONLY=Xps` only one driver's.

mod readers;
mod stages;

use palpate_run::rig::{self, RigSpec};
use palpate_sim::scene::{ContactLaw, Latencies};
use palpate_testing::alone::ran_alone;
use palpate_testing::campaign;
use palpate_testing::executions::{in_parallel, run_virtually};
use std::collections::BTreeMap;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Mutex;

/// Runs of all drivers together: quick and full.
const RUNS: (usize, usize) = (500, 10_000);

/// Largest fraction of undetectable wrong values: a line that garbles 15 % of all messages garbles a digit of at most so many answers.
const UNSEEN_MOST: f64 = 0.05;

/// Largest number of printed problems.
const SHOWN_MOST: usize = 40;

/// What is tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum BadLineSubject {
    Esp301,
    Xps,
    Grbl,
    ProcessStage,
    CellRtu,
    CellTcp,
    CellLaumas,
    CellXps,
    CellDaqmx,
    CellProcess,
    ArrayTcp,
    ArrayDaqmx,
    ArrayProcess,
}

/// Each with its fraction of the runs: a stage has more that can fail.
const SUBJECTS: [(BadLineSubject, u64); 13] = [
    (BadLineSubject::Esp301, 4),
    (BadLineSubject::Xps, 4),
    (BadLineSubject::Grbl, 4),
    (BadLineSubject::ProcessStage, 4),
    (BadLineSubject::CellRtu, 2),
    (BadLineSubject::CellTcp, 2),
    (BadLineSubject::CellLaumas, 2),
    (BadLineSubject::CellXps, 2),
    (BadLineSubject::CellDaqmx, 2),
    (BadLineSubject::CellProcess, 2),
    (BadLineSubject::ArrayTcp, 2),
    (BadLineSubject::ArrayDaqmx, 1),
    (BadLineSubject::ArrayProcess, 1),
];

impl BadLineSubject {
    /// A check sum covers the bytes.
    fn has_check_sum(self) -> bool {
        matches!(self, BadLineSubject::CellRtu | BadLineSubject::CellLaumas)
    }

    /// Answers name their requests.
    fn numbers_answers(self) -> bool {
        use BadLineSubject::{ArrayProcess, ArrayTcp, CellProcess, CellTcp, ProcessStage};
        matches!(self, ProcessStage | CellTcp | CellProcess | ArrayTcp | ArrayProcess)
    }
}

/// Result of a run.
#[derive(Default)]
struct BadLineOutcome {
    values: usize,
    altered: usize,
    stray: usize,
    errors: usize,
    /// A stage that moved elsewhere after a garbled command, and the number of those that nobody noticed.
    elsewhere: usize,
    unnoticed: usize,
    /// What must not happen.
    broken: Vec<String>,
    /// The longest call of each name, s, and the largest number of its messages.
    longest: BTreeMap<&'static str, (f64, usize)>,
}

impl BadLineOutcome {
    /// Judges a wrong value by the events on the line during its request.
    fn judge(&mut self, subject: BadLineSubject, altered: bool, stray: bool, output: impl FnOnce() -> String) {
        self.values += 1;
        if altered && !subject.has_check_sum() {
            self.altered += 1;
        } else if stray && !subject.numbers_answers() {
            self.stray += 1;
        } else {
            self.broken.push(output());
        }
    }

    fn took(&mut self, call: &'static str, took_s: f64, messages: usize) {
        let longest = self.longest.entry(call).or_default();
        *longest = (longest.0.max(took_s), longest.1.max(messages));
    }

    fn join(&mut self, other: BadLineOutcome) {
        self.values += other.values;
        self.altered += other.altered;
        self.stray += other.stray;
        self.errors += other.errors;
        self.elsewhere += other.elsewhere;
        self.unnoticed += other.unnoticed;
        self.broken.extend(other.broken);
        other.longest.into_iter().for_each(|(call, (took_s, messages))| self.took(call, took_s, messages));
    }
}

/// A rig whose values are exact, so that a wrong value shows.
fn rig(stage: &str, load_cell: &str, array: &str) -> RigSpec {
    let text = format!(
        "[stage]\ndriver = {stage}\nlink = \"sim\"\n\
         travel_mm = {{ x = [-12.5, 12.5], y = [-12.5, 12.5], z = [-12.5, 12.5] }}\n\
         speed_mm_s = 10.0\nacceleration_mm_s2 = 100.0\nsettle_ms = 10.0\n\
         [load_cell]\ndriver = {load_cell}\nlink = \"sim\"\nconversions_hz = 200.0\nlag_ms = 0.0\n\
         [array]\ndriver = {array}\nlink = \"sim\"\ngrid = {{ rows = 3, columns = 3, pitch_mm = 4.5 }}\n\
         [limits]\nforce_n = 2.0\ndepth_mm = 1.6\nstiffness_n_mm = 2.0\n\
         [frame]\nsurface_mm = {{ z = 0.0, uncertainty = 0.3 }}\norigin_mm = {{ x = 0.0, y = 0.0 }}\ndown = \"-z\"\n"
    );
    let mut spec = rig::parse("rig.toml", &text, &|_| unreachable!("no map of its own"))
        .unwrap_or_else(|problems| panic!("{:?}", problems.lines()));
    spec.scene.contact = ContactLaw { linear_n_mm: readers::STIFFNESS_N_MM, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
    (spec.scene.relaxation, spec.scene.surface_tilt_mm) = (Vec::new(), 0.0);
    (spec.scene.relief, spec.scene.stiffness, spec.scene.stage, spec.scene.load_cell) = (None, None, None, None);
    (spec.scene.skin.noise, spec.scene.skin.hysteresis_percent) = (None, None);
    spec.scene.latencies =
        Latencies { stage_s: (0.01, 0.03), load_cell_s: (0.001, 0.003), array_s: (0.001, 0.003), stage_spikes: None };
    spec
}

fn run(subject: BadLineSubject, seed: u64, bad: bool) -> BadLineOutcome {
    let tried = panic::catch_unwind(AssertUnwindSafe(|| {
        run_virtually(async {
            match subject {
                BadLineSubject::Esp301 | BadLineSubject::Xps | BadLineSubject::Grbl | BadLineSubject::ProcessStage => {
                    stages::run(subject, seed, bad).await
                }
                _ => readers::run(subject, seed, bad).await,
            }
        })
    }));
    tried.unwrap_or_else(|_| BadLineOutcome { broken: vec!["it panicked".into()], ..BadLineOutcome::default() })
}

/// Panics of this process: a panic in a task would be missed otherwise.
static PANICS: Mutex<Vec<String>> = Mutex::new(Vec::new());

fn note_panics() {
    panic::set_hook(Box::new(|panic| {
        let output = format!("{panic}");
        PANICS.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(output);
    }));
}

fn campaign(runs: u64, bad: bool) {
    note_panics();
    let parts: u64 = SUBJECTS.iter().map(|(_, part)| part).sum();
    let count = |part: u64| (runs * part).div_ceil(parts);
    let only = std::env::var("PALPATE_BAD_LINE_ONLY").ok();
    let jobs: Vec<(BadLineSubject, u64)> = SUBJECTS
        .iter()
        .filter(|(subject, _)| only.as_ref().is_none_or(|only| format!("{subject:?}") == *only))
        .flat_map(|&(subject, part)| (1..=count(part)).map(move |seed| (subject, seed)))
        .collect();
    let mut rows: BTreeMap<BadLineSubject, (usize, BadLineOutcome)> = BTreeMap::new();
    let mut broken = Vec::new();
    for ((subject, seed), outcome) in jobs.iter().zip(in_parallel(&jobs, |&(subject, seed)| run(subject, seed, bad))) {
        broken.extend(outcome.broken.iter().map(|output| format!("{subject:?}, seed {seed}: {output}")));
        let row = rows.entry(*subject).or_default();
        row.0 += 1;
        row.1.join(outcome);
    }
    let mut unseen = Vec::new();
    for (subject, (runs, row)) in &rows {
        let share = |part: usize| 100.0 * part as f64 / row.values.max(1) as f64;
        println!(
            "{subject:?}: {runs} runs, {} values, garbled unseen {} ({:.2} %), of another moment {} ({:.2} %), {} errors, \
             elsewhere {} ({} unnoticed)",
            row.values,
            row.altered,
            share(row.altered),
            row.stray,
            share(row.stray),
            row.errors,
            row.elsewhere,
            row.unnoticed
        );
        let longest = row.longest.iter().map(|(call, (s, messages))| format!("{call} {s:.1} s {messages}"));
        println!("    longest and most messages: {}", longest.collect::<Vec<_>>().join(", "));
        if (row.altered + row.stray) as f64 > UNSEEN_MOST * row.values as f64 {
            unseen.push(format!("{subject:?}: {} of {}", row.altered + row.stray, row.values));
        }
    }
    drop(panic::take_hook());
    let panics = std::mem::take(&mut *PANICS.lock().expect("the hook doesn't panic"));
    let output: Vec<&String> = panics.iter().chain(&broken).take(SHOWN_MOST).collect();
    assert!(output.is_empty(), "{} panics, {} broken: {output:#?}", panics.len(), broken.len());
    assert!(unseen.is_empty(), "more is falsified unseen than can be: {unseen:?}");
}

#[test]
fn damaged_line_is_never_taken_for_a_true_reading() {
    if ran_alone("bad_line::damaged_line_is_never_taken_for_a_true_reading") {
        return;
    }
    let runs = campaign::size(RUNS.0, RUNS.1) as u64;
    campaign(runs / 20, false); // the judged properties are checked on a good line
    campaign(runs, true);
}
