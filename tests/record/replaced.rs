//! A journal that another program removes, replaces or moves during the run.
#![cfg(unix)] // elsewhere the standard library has no number that identifies a file

use palpate_core::quantity::Axis;
use palpate_data::dataset::{
    DatasetError, Journal, Origins, Provenance, Record, RecordedContact, RunFacts, RunFolder, Status,
};
use palpate_link::time::Instant;
use palpate_run::run::{Cancel, Ending, Listener, RunJob, execute_on};
use palpate_testing::executions::{bench, plan, run_virtually};
use palpate_testing::{Live, SMALL, SMALL_PRESSES, TestFolder};
use std::fs;
use std::path::{Path, PathBuf};

/// Presses that are acknowledged before the journal is changed.
const BEFORE: usize = 2;

/// Largest distance of z from its parking position, mm: the error of a read-back.
const PARKED_MM: f64 = 0.003;

/// One press that takes some seconds.
const HELD: &str =
    "name = \"held\"\nrig = \"sim\"\n[press]\nhold_s = 30\n[[step]]\nphase = \"test\"\nforce_n = 1.0\nunits = [5]\n";

/// Counts the acknowledgements, and changes the run's folder after some.
struct Meddler<'a> {
    acknowledged: usize,
    meddle: &'a dyn Fn(usize),
}

impl Listener for Meddler<'_> {
    fn recorded(&mut self, _: &RecordedContact) {
        self.acknowledged += 1;
        (self.meddle)(self.acknowledged);
    }
}

struct ReplacedRun {
    home: TestFolder,
    ending: Ending,
    finished: Result<(), DatasetError>,
    acknowledged: usize,
    warnings: Vec<String>,
}

/// Executes [`SMALL`] in a folder, and does something with the folder after each press.
fn executed(meddle: impl Fn(usize, &Path)) -> ReplacedRun {
    let (home, spec) = (TestFolder::new(), bench("bench-fast"));
    let (plan, path) = (plan(&spec, SMALL, 1), home.path("run"));
    let origins = Origins::new(SMALL.to_owned(), String::new(), Vec::new());
    let facts = RunFacts::new(&plan, true);
    let folder = RunFolder::create(Some(&path), &origins, facts, Provenance::default(), &spec.array.layout);
    let mut folder = folder.expect("a run");
    let mut meddler = Meddler { acknowledged: 0, meddle: &|done| meddle(done, &path) };
    let (ending, z_mm) = run_virtually(async {
        let rig = spec.emulators(plan.seed).expect("emulators");
        let (scene, began, cancel) = (rig.scene.clone(), Instant::now(), Cancel::default());
        let rig = spec.open_on(rig).expect("drivers");
        let job = RunJob { plan: &plan, spec: &spec, ledger: &mut folder, cancel: &cancel, shown: &|_| {} };
        let ending = execute_on(rig, job, &mut meddler).await;
        let (z_mm, _) = scene.lock().expect("the walk is over").axis(Axis::Z, began.elapsed().as_secs_f64());
        (ending, spec.frame.z_from_stage(z_mm))
    });
    assert!(ending.unparked.is_none() && z_mm <= spec.clear_mm() + PARKED_MM, "not parked: {z_mm} mm");
    let finished = folder.finish(ending.end(String::new(), 0.0));
    let (acknowledged, warnings) = (meddler.acknowledged, folder.warnings().to_vec());
    ReplacedRun { home, ending, finished, acknowledged, warnings }
}

/// Contacts of a journal.
fn contacts(journal: &Path) -> usize {
    let records = Journal::<Record>::records(journal).expect("a journal").map(|record| record.expect("sound").1);
    records.filter(|record| record.contact().is_some()).count()
}

/// A copy of the journal with another inode takes its name, as with a program that synchronizes folders.
fn replace_by(run: &Path, content: &[u8]) {
    fs::write(run.join("copy"), content).expect("a file");
    fs::rename(run.join("copy"), run.join("journal.log")).expect("a new name");
}

/// No press after the change is acknowledged, and both errors report it.
fn ends_for(executed: &ReplacedRun, what: &str) {
    let output = executed.ending.text().expect("it ended early");
    assert!(output.contains("journal.log") && output.contains(what), "{output}");
    assert_eq!((executed.ending.status(), executed.acknowledged), (Status::Failed, BEFORE));
    let unfinished = executed.finished.as_ref().expect_err("nothing more is written").to_string();
    assert!(unfinished.contains(what), "{unfinished}");
}

#[test]
fn no_press_is_acknowledged_after_the_journal_is_removed() {
    let executed = executed(|done, run| {
        if done == BEFORE {
            fs::remove_file(run.join("journal.log")).expect("a journal");
        }
    });
    ends_for(&executed, "was removed");
    assert!(!executed.home.has("run/journal.log"));
}

#[test]
fn no_press_is_acknowledged_after_another_file_takes_the_journals_name() {
    let foreign: [fn(Vec<u8>) -> Vec<u8>; 3] = [
        |_| b"another text\n".to_vec(),
        |journal| journal[..journal.len() / 2].to_vec(),
        |journal| [journal.as_slice(), b"another text\n"].concat(),
    ];
    for change in foreign {
        let executed = executed(|done, run| {
            if done == BEFORE {
                replace_by(run, &change(fs::read(run.join("journal.log")).expect("a journal")));
                fs::copy(run.join("journal.log"), run.join("as-it-was")).expect("a copy");
            }
        });
        ends_for(&executed, "was replaced by another file");
        assert_eq!(executed.home.read("run/journal.log"), executed.home.read("run/as-it-was"), "it is left alone");
    }
}

#[test]
fn run_continues_in_an_equal_copy_of_its_journal_and_warns_once() {
    let executed = executed(|done, run| {
        // the first copies lack the record that is being written, the last one has all
        let is_replaced = [BEFORE, BEFORE + 1, SMALL_PRESSES as usize].contains(&done);
        if is_replaced {
            replace_by(run, &fs::read(run.join("journal.log")).expect("a journal"));
        }
        if done > BEFORE + 1 && !is_replaced {
            let second = RunFolder::open(run, &bench("bench-fast").array.layout).expect_err("one writer").to_string();
            assert!(second.contains("is being written by another program"), "{second}");
        }
    });
    assert_eq!(executed.ending.status(), Status::Complete, "{:?}", executed.ending.text());
    executed.finished.expect("it ends as any other");
    assert_eq!(contacts(&executed.home.path("run/journal.log")), executed.acknowledged);
    assert_eq!(executed.acknowledged, SMALL_PRESSES as usize);
    assert!(executed.warnings.len() == 1 && executed.warnings[0].contains("journal.log"), "{:?}", executed.warnings);
}

#[test]
fn no_press_is_acknowledged_after_the_folder_is_moved() {
    let executed = executed(|done, run| {
        if done == BEFORE {
            fs::rename(run, run.with_file_name("moved")).expect("another name");
        }
    });
    ends_for(&executed, "its folder was moved");
    assert!(!executed.home.has("run") && contacts(&executed.home.path("moved/journal.log")) >= BEFORE);
}

#[test]
fn removed_journal_ends_the_program_with_5_and_advice() {
    type Meddle = fn(PathBuf);
    let cases: [(&str, Meddle, &str); 3] = [
        ("removed", |run| fs::remove_file(run.join("journal.log")).expect("a journal"), "was removed"),
        ("replaced", |run| replace_by(&run, b"another text\n"), "was replaced by another file"),
        ("moved", |run| fs::rename(&run, run.with_file_name("elsewhere")).expect("a new name"), "was moved"),
    ];
    let bench = TestFolder::with([("held.toml", HELD)]);
    let start = |name: &str| Live::start(bench.command(&format!("run held.toml --json --pace 10 --out {name}")));
    let runs: Vec<Live> = cases.iter().map(|(name, ..)| start(name)).collect();
    for ((name, meddle, _), run) in cases.iter().zip(&runs) {
        run.until_printed(": from press 1");
        meddle(bench.path(name));
    }
    for ((name, _, what), run) in cases.into_iter().zip(runs) {
        let output = run.end();
        assert_eq!(
            (output.code, output.out.as_str()),
            (Some(5), ""),
            "{name}: nothing is acknowledged\n{}",
            output.err
        );
        let err = output.running();
        let expected = [&format!("{name}/journal.log"), what, "the stage is parked", "palpate resume"];
        expected.iter().for_each(|words| assert!(err.contains(*words), "{name}: no {words:?} in {}", output.err));
        assert!(!err.contains("stored in the journal"), "{name}: {}", output.err);
    }
    // after the move, the run continues
    bench.palpate_ends(0, "resume elsewhere");
    bench.palpate_ends(0, "verify elsewhere");
}
