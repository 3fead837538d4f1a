//! Runs that are killed at any time: nothing acknowledged is lost or changed, and `resume` completes the plan.
//!
//! `PALPATE_TESTS=full` kills 50 times, and cuts the journal at each eleventh byte of its last records; `PALPATE_TESTS=20` kills 1000
//! times, and cuts it at every byte.
#![cfg(unix)]

mod tally;
mod trial;

use palpate_data::dataset::{Journal, Record, RecordedContact};
use palpate_testing::interrupted::cut_back;
use palpate_testing::rows::{self, StoredRow, numbered};
use palpate_testing::{TestFolder, campaign, shipped_text};
use serde_json::Value;
use std::fs;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use tally::KillTally;
use trial::KillTrial;

/// Kills: quick and full.
const KILLS: (usize, usize) = (8, 50);

/// Trials at a time.
const THREADS: usize = 2;

/// Records in which the journal is cut (the last three presses and the end), and the step between cuts, bytes: quick and full.
const CUT_RECORDS: usize = 4;
const CUT_STRIDE: (usize, usize) = (1009, 11);

/// 2 staircases of 5 levels and 12 points of a grid: enough for training presses with `--strategy map`.
const RECIPE: &str = r#"
name = "killed"

[[step]]
phase = "characterisation"
units = [1, 5]
staircase = { to_n = 2.0, step_n = 1.0 }

[[step]]
phase = "calibration"
grid = { x_mm = [-2.0, 2.0], y_mm = [-3.0, 3.0], spacing_mm = 2.0 }
force_n = 1.0
"#;
const STAIRCASES: u64 = 2;
const LEVELS: u64 = 5;
const POINTS: u64 = 12;
const TRAINING_PRESSES: u64 = 5;

const STRATEGIES: [&str; 3] = ["guarded", "velocity", "map"];

/// Memory of the shipped rig's specimen: without it a repeated press has the same values.
const MEMORIES: [&str; 2] = ["relaxation = ", "hysteresis = "];

#[test]
fn run_killed_at_any_time_keeps_acknowledged_rows_and_is_resumed() {
    let courses = KillCourse::all();
    let (wanted, made, trials) = (campaign::size(KILLS.0, KILLS.1), AtomicUsize::new(0), AtomicU64::new(0));
    let tally = on_threads(|tally| {
        while made.load(Ordering::Relaxed) < wanted {
            let of_one = KillTrial::new(trials.fetch_add(1, Ordering::Relaxed), &courses).carry_out();
            made.fetch_add(of_one.kills, Ordering::Relaxed);
            *tally += of_one;
        }
    });
    println!("{tally}");
    assert!(tally.kills >= wanted && tally.acknowledged > 0, "{tally}");
    tally.assert_clean();
}

#[test]
fn journal_cut_at_any_byte_of_its_last_records_is_resumed() {
    let courses = KillCourse::all();
    let chosen = [("guarded", false), ("map", true)];
    let chosen = courses.iter().filter(|course| chosen.contains(&(course.strategy, course.forgets)));
    let cuts: Vec<(&KillCourse, usize)> =
        chosen.flat_map(|course| course.cuts().map(move |cut| (course, cut))).collect();
    let next = AtomicUsize::new(0);
    let tally = on_threads(|tally| {
        while let Some((course, cut)) = cuts.get(next.fetch_add(1, Ordering::Relaxed)) {
            *tally += course.assert_finished_from(*cut);
        }
    });
    println!("{} cuts: {tally}", cuts.len());
    tally.assert_clean();
}

/// Does the same on some threads at once, and adds their counts.
fn on_threads(work: impl Fn(&mut KillTally) + Sync) -> KillTally {
    let mut sum = KillTally::default();
    thread::scope(|scope| {
        let one = || {
            let mut tally = KillTally::default();
            work(&mut tally);
            tally
        };
        let threads: Vec<_> = (0..THREADS).map(|_| scope.spawn(one)).collect();
        threads.into_iter().for_each(|thread| sum += thread.join().expect("trials that hold"));
    });
    sum
}

/// A rig and a strategy, and their uninterrupted run.
struct KillCourse {
    rig: String,
    /// Whether the rig's specimen has no memory after a press.
    forgets: bool,
    strategy: &'static str,
    whole: Vec<(String, Vec<u8>)>,
    /// Its duration, and its duration at a pace of 1.
    took: Duration,
    virtual_s: f64,
}

impl KillCourse {
    fn all() -> Vec<KillCourse> {
        let shipped = shipped_text("rigs/sim.toml");
        let remembers = |line: &str| MEMORIES.iter().any(|memory| line.starts_with(memory));
        assert_eq!(shipped.lines().filter(|line| remembers(line)).count(), MEMORIES.len(), "{shipped}");
        let forgetful: String =
            shipped.lines().filter(|line| !remembers(line)).map(|line| line.to_owned() + "\n").collect();
        let rigs = [(shipped, false), (forgetful, true)];
        let course = |(rig, forgets): &(String, bool), strategy| KillCourse::new(rig.clone(), *forgets, strategy);
        rigs.iter().flat_map(|rig| STRATEGIES.map(|strategy| course(rig, strategy))).collect()
    }

    fn new(rig: String, forgets: bool, strategy: &'static str) -> KillCourse {
        let mut course = KillCourse { rig, forgets, strategy, whole: Vec::new(), took: Duration::ZERO, virtual_s: 0.0 };
        let bench = course.bench();
        let began = Instant::now();
        bench.palpate_ends(0, &course.words(&bench, None));
        course.took = began.elapsed();
        course.virtual_s = bench.manifest("run")["virtual_s"].as_f64().expect("a duration");
        course.whole = bench.bytes("run");
        assert_eq!(numbered(&rows::table(&bench, "run")), course.plan(), "{strategy}");
        course
    }

    fn bench(&self) -> TestFolder {
        TestFolder::with([("r.toml", RECIPE), ("rig.toml", self.rig.as_str())])
    }

    /// Continues from the state of a folder.
    fn words(&self, bench: &TestFolder, pace: Option<u32>) -> String {
        let words = if bench.has("run") {
            "resume run --json".to_owned()
        } else {
            format!("run r.toml --rig rig.toml --json --out run --strategy {}", self.strategy)
        };
        words + &pace.map_or_else(String::new, |pace| format!(" --pace {pace}"))
    }

    /// Each press and level in the order of the table.
    fn plan(&self) -> Vec<(u64, u64)> {
        let training_presses = if self.strategy == "map" { TRAINING_PRESSES } else { 0 };
        let staircases = (0..STAIRCASES).flat_map(|press| (0..LEVELS).map(move |level| (press, level)));
        staircases.chain((STAIRCASES..STAIRCASES + POINTS + training_presses).map(|press| (press, 0))).collect()
    }

    fn file(&self, name: &str) -> &[u8] {
        &self.whole.iter().find(|(file, _)| file == name).expect("a file of the run").1
    }

    /// Where to cut the journal: at the end of each of the last records, one byte before and after it, and between.
    fn cuts(&self) -> impl Iterator<Item = usize> {
        let journal = self.file("journal.log");
        let ends: Vec<usize> = (1..=journal.len()).filter(|&end| journal[end - 1] == b'\n').collect();
        let first = ends[ends.len() - 1 - CUT_RECORDS];
        let stride = campaign::every(CUT_STRIDE.0, CUT_STRIDE.1);
        let is_wanted =
            move |cut: &usize| ends.iter().any(|end| cut.abs_diff(*end) <= 1) || (cut - first).is_multiple_of(stride);
        (first..=journal.len()).filter(is_wanted)
    }

    /// The run after a power cut that only lost the journal's end.
    fn assert_finished_from(&self, cut: usize) -> KillTally {
        let bench = self.bench();
        fs::create_dir(bench.path("run")).expect("a folder");
        for (name, bytes) in &self.whole {
            fs::write(bench.path("run").join(name), bytes).expect("a file can be written");
        }
        let (header, _) = bench.table("run/presses.csv");
        let table = rows::table(&bench, "run");
        cut_back(&bench, "run", &self.file("journal.log")[..cut]);
        // complete records before the cut were acknowledged
        let kept: Vec<(u64, u64)> = journalled(&bench).iter().flat_map(rows_of).collect();
        let acknowledged: Vec<Value> = table
            .into_iter()
            .zip(self.plan())
            .filter(|(_, number)| kept.contains(number))
            .map(|(row, _)| row)
            .collect();
        let tally = self.assert_finished(&bench, &acknowledged, &format!("cut at byte {cut} ({})", self.strategy));
        assert_eq!(bench.table("run/presses.csv").0, header);
        tally
    }

    /// Completes the run and checks all of it.
    fn assert_finished(&self, bench: &TestFolder, acknowledged: &[Value], output: &str) -> KillTally {
        let before: Vec<(u64, u64)> = journalled(bench).iter().flat_map(rows_of).collect();
        let ended = bench.palpate_ends(0, &self.words(bench, None));
        let made: Vec<Value> = ended.json_lines();
        let (plan, table) = (self.plan(), rows::table(bench, "run"));
        assert_eq!(numbered(&table), plan, "{output}: each row of the plan once and in its order");
        let manifest = bench.manifest("run");
        let presses = STAIRCASES as usize + plan.len() - (STAIRCASES * LEVELS) as usize;
        assert_eq!((&manifest["status"], &manifest["presses_done"]), (&"complete".into(), &presses.into()), "{output}");
        let names = |files: &[(String, Vec<u8>)]| files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&bench.bytes("run")), names(&self.whole), "{output}: drafts of tables are gone");
        let contacts = journalled(bench);
        assert_eq!(contacts.len(), presses, "{output}: the journal has a press twice, or lacks one");
        let mut all: Vec<(u64, u64)> = before.into_iter().chain(numbered(&made)).collect();
        all.sort_unstable();
        assert_eq!(all, plan, "{output}: what was there and what was made since");
        let others = if self.forgets { self.others(bench) } else { Vec::new() };
        let StoredRow { lost, changed, first } = rows::kept(&[acknowledged, &made].concat(), &table);
        let (was, is) = (numbered(acknowledged), numbered(&made));
        let again = was.iter().enumerate().filter(|(n, row)| is.contains(row) || was[..*n].contains(row)).count();
        let other = others.len();
        let first = first.or(others.into_iter().next()).map(|first| format!("{output}: {first}"));
        let acknowledged = rows::presses(acknowledged);
        KillTally { acknowledged, lost, changed, again, other, first, ..KillTally::default() }
    }

    /// The rows that differ from those of the uninterrupted run, to the last digit.
    fn others(&self, bench: &TestFolder) -> Vec<String> {
        let whole = std::str::from_utf8(self.file("presses.csv")).expect("text");
        let (same, now) = (timeless(whole), timeless(&bench.read("run/presses.csv")));
        let differing = same.into_iter().zip(now).filter(|(same, now)| same != now);
        differing.map(|(same, now)| format!("{now}, which is {same} if nothing interrupts")).collect()
    }
}

/// The contacts of the journal, in their order.
fn journalled(bench: &TestFolder) -> Vec<RecordedContact> {
    if !bench.has("run") {
        return Vec::new();
    }
    let records = Journal::<Record>::records(&bench.path("run/journal.log")).expect("a journal");
    records.filter_map(|record| record.expect("a sound record").1.contact().cloned()).collect()
}

fn rows_of(contact: &RecordedContact) -> impl Iterator<Item = (u64, u64)> {
    contact.levels.iter().map(|row| (row.press, row.level))
}

/// The lines of a table of presses without their times, which differ after a break.
fn timeless(table: &str) -> Vec<String> {
    let column = table.lines().next().and_then(|header| header.split(',').position(|name| name == "t_s"));
    let column = column.expect("a time");
    let cells = |line: &str| {
        let cells = line.split(',').enumerate().filter(|(n, _)| *n != column).map(|(_, cell)| cell);
        cells.collect::<Vec<_>>().join(",")
    };
    table.lines().map(cells).collect()
}
