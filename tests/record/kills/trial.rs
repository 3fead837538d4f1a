//! One run that is killed once or more often.

use super::{KillCourse, KillTally, journalled, rows_of};
use palpate_core::quantity::{RandomStream, stream};
use palpate_testing::rows::{self, json};
use palpate_testing::{Live, TestFolder};
use rand::RngExt;
use serde_json::Value;
use std::fmt::{self, Display, Formatter};
use std::fs;
use std::ops::RangeInclusive;
use std::process::Command;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

/// With the trial's number, the seed of the times of a trial.
const SEED: u64 = 1;

/// Most kills of one run, its `resume` included.
const KILLS_OF_ONE_MOST: usize = 3;

/// Speed of a paced run, times real time: 30 s of virtual time take 0.05 to 0.5 s.
const PACES: RangeInclusive<u32> = 60..=600;

/// Time of a program to make or open its folder, us.
const START_US: u64 = 8_000;

/// Latest kill after a row, us: at once, when a row that was acknowledged too early isn't on the disk yet; within some presses, if the run
/// isn't paced; and after the last row, while tables and results are written.
const UPON_ROW_US: u64 = 200;
const AFTER_ROW_US: u64 = 3_000;
const AFTER_LAST_ROW_US: u64 = 5_000;

/// Longest press in virtual time, s.
const PRESS_S: f64 = 2.0;

/// Longest wait for a row that must come.
const PATIENCE: Duration = Duration::from_secs(20);
/// One killed run, and its `resume` if needed, until it is complete.
pub(super) struct KillTrial<'a> {
    number: u64,
    course: &'a KillCourse,
    bench: TestFolder,
    rng: RandomStream,
    /// The sessions so far, for a message.
    sessions: Vec<String>,
}

impl<'a> KillTrial<'a> {
    pub(super) fn new(number: u64, courses: &'a [KillCourse]) -> KillTrial<'a> {
        let course = &courses[number as usize % courses.len()];
        let rng = stream(SEED, number, "kills");
        KillTrial { number, course, bench: course.bench(), rng, sessions: Vec::new() }
    }

    pub(super) fn carry_out(mut self) -> KillTally {
        let (mut tally, mut acknowledged) = (KillTally { trials: 1, ..KillTally::default() }, Vec::new());
        for _ in 0..self.rng.random_range(1..=KILLS_OF_ONE_MOST) {
            tally += self.session(&mut acknowledged);
        }
        tally += self.course.assert_finished(&self.bench, &acknowledged, &self.to_string());
        tally
    }

    /// Starts the program from the state of the run, and kills it.
    fn session(&mut self, acknowledged: &mut Vec<Value>) -> KillTally {
        let pace = self.rng.random_bool(0.5).then(|| self.rng.random_range(PACES));
        let before = journal(&self.bench);
        let moment = self.moment(pace);
        let words = self.course.words(&self.bench, pace);
        self.sessions.push(format!("{words} killed {moment:?}"));
        let Killed { rows, code, err } = killed(self.bench.command(&words), moment);
        let output = self.to_string();
        assert!(matches!(code, None | Some(0)), "{output}: {err}");
        if !self.bench.has("run") {
            assert_eq!((&rows[..], code), (&[][..], None), "{output}: acknowledged without a folder");
            let entries = fs::read_dir(self.bench.path(".")).expect("a folder").map(|entry| entry.expect("an entry"));
            // the recipe and the rig exist
            let beside = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
            let beside: Vec<String> = beside.filter(|name| !["r.toml", "rig.toml"].contains(&name.as_str())).collect();
            let is_hidden = |name: &String| name.starts_with('.') && name.ends_with(".new");
            assert!(beside.iter().all(is_hidden), "{output}: {beside:?}");
            let drafts = beside.len();
            return KillTally { kills: 1, early: 1, drafts, ..KillTally::default() };
        }
        let after = journal(&self.bench);
        assert!(after.starts_with(&before), "{output}: records that were there are others now");
        let contacts = journalled(&self.bench);
        let mut presses: Vec<u64> = contacts.iter().map(|contact| contact.press).collect();
        presses.sort_unstable();
        presses.dedup();
        assert_eq!(presses.len(), contacts.len(), "{output}: the journal has a press twice");
        let records = |bytes: &[u8]| bytes.split(|&byte| byte == b'\n').filter(|line| is_contact(line)).count();
        let (made, acknowledged_rows) = (contacts.len() - records(&before), rows::presses(&rows));
        assert!(
            (acknowledged_rows..=acknowledged_rows + 1).contains(&made),
            "{output}: {made} presses in the journal, {acknowledged_rows} acknowledged"
        );
        acknowledged.extend(rows);
        let kills = usize::from(code.is_none());
        KillTally { kills, unacknowledged: made - acknowledged_rows, ..KillTally::default() }
    }

    /// Time of the next kill: at the start of the program; any time; at or after any row; or after the last one, while the tables are
    /// written.
    fn moment(&mut self, pace: Option<u32>) -> KillMoment {
        let plan = self.course.plan().len();
        let left = plan - journalled(&self.bench).iter().flat_map(rows_of).count();
        let slower =
            |seconds: f64| pace.map_or(Duration::ZERO, |pace| Duration::from_secs_f64(seconds / f64::from(pace)));
        let some_row = self.rng.random_range(0..=left);
        let (rows, most) = match self.rng.random_range(0..5) {
            0 => (0, Duration::from_micros(START_US)),
            1 => (0, (self.course.took + slower(self.course.virtual_s)).mul_f64(left as f64 / plan as f64)),
            2 => (some_row, Duration::from_micros(UPON_ROW_US)),
            3 => (some_row, Duration::from_micros(AFTER_ROW_US) + slower(PRESS_S)),
            _ => (left, Duration::from_micros(AFTER_LAST_ROW_US)),
        };
        KillMoment { rows, then: most.mul_f64(self.rng.random()) }
    }
}

impl Display for KillTrial<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let kind = if self.course.forgets { "forgetful" } else { "shipped" };
        write!(f, "trial {} ({kind} rig; {})", self.number, self.sessions.join("; "))
    }
}

/// This long after so many rows.
#[derive(Clone, Copy, Debug)]
struct KillMoment {
    rows: usize,
    then: Duration,
}

/// The rows that a killed program acknowledged, and its exit code if it had ended before.
struct Killed {
    rows: Vec<Value>,
    code: Option<i32>,
    err: String,
}

/// Starts the program and kills it at that time.
fn killed(command: Command, moment: KillMoment) -> Killed {
    let mut live = Live::start(command);
    let mut rows = Vec::new();
    let due = |rows: &Vec<Value>| (rows.len() == moment.rows).then(|| Instant::now() + moment.then);
    let mut until = due(&rows);
    loop {
        let patience = until.map_or(PATIENCE, |until| until.saturating_duration_since(Instant::now()));
        match live.line_within(patience) {
            Ok(line) => {
                rows.push(json(&line));
                until = until.or_else(|| due(&rows));
            }
            Err(RecvTimeoutError::Timeout) => {
                assert!(until.is_some(), "no row within {} s", PATIENCE.as_secs());
                break;
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    live.kill();
    let output = live.end();
    rows.extend(output.json_lines());
    Killed { rows, code: output.code, err: output.err }
}

/// The complete records of the journal, without an incomplete tail.
fn journal(bench: &TestFolder) -> Vec<u8> {
    let mut bytes =
        if bench.has("run") { fs::read(bench.path("run/journal.log")).expect("a journal") } else { Vec::new() };
    bytes.truncate(bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1));
    bytes
}

fn is_contact(line: &[u8]) -> bool {
    line.split(|&byte| byte == b' ').nth(2).is_some_and(|text| text.starts_with(br#"{"contact""#))
}
