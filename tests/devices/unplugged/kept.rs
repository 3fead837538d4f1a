//! A run in a folder, as the program stores it, on a rig on which a device may be lost.

use super::RECIPE;
use super::far::{FarEndFate, beset};
use palpate_data::dataset::{Manifest, Origins, Provenance, RecordedContact, RunFacts, RunFolder};
use palpate_data::recipe::{Entry, Plan};
use palpate_link::time::{Instant, sleep, timeout};
use palpate_run::rig::RigSpec;
use palpate_run::run::{Cancel, Ending, Listener, RunJob, execute_on};
use palpate_sim::emulator::Shared;
use palpate_testing::executions::{WorstTruth, run_virtually};
use palpate_testing::phases::{PressPhase, Watcher};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tempfile::TempDir;

/// Longest run; a longer one doesn't end.
const FOR_EVER: Duration = Duration::from_secs(24 * 3600);

/// Time after a run's end until all is at rest: the longest motion takes 3 s.
const AFTERWARDS: Duration = Duration::from_secs(5);

/// Result of a run.
pub(super) struct UnpluggedRun {
    pub ending: Ending,
    /// The records in their order.
    pub contacts: Vec<RecordedContact>,
    pub phases: Vec<Option<PressPhase>>,
    pub worst: WorstTruth,
    /// Final z in the specimen frame, mm.
    pub z_mm: f64,
    pub at_rest: bool,
    pub virtual_s: f64,
}

/// A run in a folder, as the program stores it. Nothing else here uses run folders.
pub(super) struct StoredRun {
    folder: RunFolder,
    home: TempDir,
}

impl StoredRun {
    pub(super) fn new(spec: &RigSpec, plan: &Plan) -> StoredRun {
        let home = tempfile::tempdir().expect("a folder");
        let (out, facts) = (home.path().join("run"), facts_of(plan));
        let origins = Origins::new(RECIPE.to_owned(), String::new(), Vec::new());
        let folder = RunFolder::create(Some(&out), &origins, facts, Provenance::default(), &spec.array.layout);
        let folder = folder.expect("a run");
        StoredRun { folder, home }
    }

    /// Closes the run and opens it again, as another program would.
    pub(super) fn reopen(self, spec: &RigSpec) -> StoredRun {
        let StoredRun { folder, home } = self;
        let path = folder.path().to_owned();
        drop(folder); // a run has one writer
        let mut folder = RunFolder::open(&path, &spec.array.layout).expect("a run that was kept");
        folder.go_on(Provenance::default(), "").expect("a run that goes on");
        StoredRun { folder, home }
    }

    /// Makes the remaining presses of the plan and ends the run.
    pub(super) fn execute(&mut self, spec: &RigSpec, plan: &Plan, fate: Option<FarEndFate>) -> UnpluggedRun {
        let folder = &mut self.folder;
        let executed = run_virtually(async {
            let mut rig = spec.emulators(plan.seed).expect("emulators");
            let watcher = Arc::new(Mutex::new(Watcher::new(rig.scene.clone(), spec.frame)));
            beset(&mut rig, &watcher, fate);
            let (cancel, began) = (Cancel::default(), Instant::now());
            let rig = spec.open_on(rig).expect("drivers");
            let job = RunJob { plan, spec, ledger: folder, cancel: &cancel, shown: &|_| {} };
            let mut notes = Notes { watcher: watcher.clone(), contacts: Vec::new() };
            let ending = timeout(FOR_EVER, execute_on(rig, job, &mut notes)).await.expect("it doesn't end by itself");
            let virtual_s = began.elapsed().as_secs_f64();
            sleep(AFTERWARDS).await;
            let mut watcher = watcher.lock().expect("the walk is over");
            let (z_mm, at_rest) = watcher.z_mm_and_rest();
            let (worst, phases) = (watcher.worst(), std::mem::take(&mut watcher.phases));
            UnpluggedRun { ending, contacts: notes.contacts, phases, worst, z_mm, at_rest, virtual_s }
        });
        folder.finish(executed.ending.end(String::new(), 0.0)).expect("a run that ends");
        executed
    }

    /// Differences between the disk and the expected end of a run: its verdict, and these contacts, each once.
    pub(super) fn wrong_on_disk(
        &self,
        ending: &Ending,
        contacts: &[RecordedContact],
        plan: &Plan,
    ) -> impl Iterator<Item = String> + use<> {
        let mut wrong = Vec::new();
        let mut check = |right: bool, text: String| wrong.extend((!right).then_some(text));
        let manifest = Manifest::read(&self.folder.path().join("manifest.json")).expect("a manifest");
        check(manifest.status == ending.status(), format!("the manifest says {:?}", manifest.status));
        check(manifest.failure == ending.text(), format!("the manifest tells {:?}", manifest.failure));
        let mut expected = contacts.to_vec();
        expected.sort_by_key(|contact| contact.press);
        let journal: Vec<RecordedContact> = self.folder.contacts().expect("a journal").map(Result::unwrap).collect();
        check(journal == expected, "the journal holds other contacts".to_owned());
        let rows: Vec<(u64, u64)> =
            expected.iter().flat_map(|contact| contact.levels.iter().map(|row| (row.press, row.level))).collect();
        check(self.rows() == rows, format!("presses.csv holds {:?}, not {rows:?}", self.rows()));
        if ending.halt.is_none() {
            let levels =
                |entry: &Entry| (0..entry.task.levels.len() as u64).map(|level| (entry.press, level)).collect();
            let all: BTreeSet<(u64, u64)> = plan.entries.iter().flat_map::<Vec<_>, _>(levels).collect();
            check(rows.len() == all.len() && rows.into_iter().eq(all), "not each level of each press once".to_owned());
        }
        wrong.into_iter()
    }

    /// The press and the level of each line of `presses.csv`.
    fn rows(&self) -> Vec<(u64, u64)> {
        let mut table = csv::Reader::from_path(self.folder.path().join("presses.csv")).expect("a table");
        let row = |line: csv::StringRecord| (line[0].parse().expect("a press"), line[1].parse().expect("a level"));
        table.records().map(|line| row(line.expect("a row"))).collect()
    }
}

/// Notes the records, and informs the watcher of each press.
struct Notes {
    watcher: Shared<Watcher>,
    contacts: Vec<RecordedContact>,
}

impl Listener for Notes {
    fn begins(&mut self, entry: &Entry) {
        let training_presses = entry.phase == palpate_data::recipe::Phase::Teach;
        self.watcher.lock().expect("a test that goes on").begins(!training_presses);
    }

    fn recorded(&mut self, contact: &RecordedContact) {
        self.contacts.push(contact.clone());
    }
}

/// The facts of a plan of which only a part is made: its entries keep their numbers.
fn facts_of(plan: &Plan) -> RunFacts {
    let presses_planned = plan.entries.iter().map(|entry| entry.press + 1).max().unwrap_or(0);
    RunFacts { presses_planned, ..RunFacts::new(plan, true) }
}
