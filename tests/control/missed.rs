//! Arrays that miss readings: silent for a time or for ever, or with an answer that is an error. A missed reading costs a press its time,
//! and never a force.

use palpate_core::quantity::stream;
use palpate_data::dataset::{Flag, Press, Record};
use palpate_run::rig::SimulatedRig;
use palpate_sim::emulator::{Instrument, Owed};
use palpate_sim::scene::{FaultKind, Scene, SceneFault};
use palpate_testing::campaign;
use palpate_testing::executions::{
    BENCHES, Deaths, ExecutedRun, bench, end_of, executed_with, in_parallel, must_be_none, plan,
};
use palpate_testing::observed::{Observer, observed};
use rand::RngExt;
use std::sync::{Arc, Mutex};

/// Time for which the array is silent, s: longer than its driver asks again.
const SILENT_S: f64 = 2.5;

/// Silences and presses of a run: quick, and full (the paper's grid).
const SILENCES: (usize, usize) = (3, 10);
const PRESSES: (usize, usize) = (12, 625);

const SEED: u64 = 1;

/// What two sound runs differ by in the largest true force, N: noise of the load cell that steers.
const HARDER_N: f64 = 0.02;

/// The array misses after this part of a sound run's requests: in the middle of the plan. Errors of one press are so many requests apart,
/// less than a press has.
const LATE: u64 = 2;
const ERRORS_APART: u64 = 8;

/// Least true force of a contact, N. The specimen rises by so much, mm, after the array became silent, s: sooner than its driver gives up.
const IN_CONTACT_N: f64 = 0.5;
const RISES_MM: f64 = 1.0;
const RISES_AFTER_S: f64 = 0.5;

/// Longest time from there until the indenter leaves, s: half of what the driver would take.
const LEFT_WITHIN_S: f64 = 0.5;

/// What the driver says of an array that is silent.
const NO_ANSWER: &str = "array (LabJack T7 at sim): while reading the outputs: no answer within 500 ms, 3 times";

/// Byte of a Modbus answer with its function, the bit that makes it an exception, and the exception of a device that failed.
const FUNCTION_AT: usize = 7;
const EXCEPTION: u8 = 0x80;
const DEVICE_FAILED: u8 = 4;

/// What an array does instead of an answer.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Miss {
    /// It answers nothing for this time, s.
    Silent(f64),
    /// It answers once that it failed.
    Error,
}

/// An array that misses from these requests on, counted from its first one.
#[derive(Clone)]
struct MissingArray(Arc<Mutex<Misses>>);

struct Misses {
    requests: u64,
    left: Vec<(u64, Miss)>,
    silent_until_s: f64,
}

impl MissingArray {
    fn put_on(rig: &mut SimulatedRig, misses: &[(u64, Miss)]) -> MissingArray {
        let state = Misses { requests: 0, left: misses.to_vec(), silent_until_s: 0.0 };
        let array = MissingArray(Arc::new(Mutex::new(state)));
        let sound = rig.array.instrument().expect("it has a link").clone();
        rig.array.replace(observed(sound, array.clone()));
        array
    }

    fn requests(&self) -> u64 {
        self.0.lock().expect("no panic").requests
    }
}

impl Observer for MissingArray {
    fn answer(&self, array: &mut dyn Instrument, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut state = self.0.lock().expect("no panic");
        let sound = array.answer(request, scene, now_s);
        if now_s < state.silent_until_s {
            return Vec::new();
        }
        state.requests += 1;
        let requests = state.requests;
        let now = state.left.iter().position(|(from, _)| *from <= requests).map(|at| state.left.remove(at).1);
        match now {
            Some(Miss::Silent(for_s)) => {
                state.silent_until_s = now_s + for_s;
                Vec::new()
            }
            Some(Miss::Error) => {
                let mut answer = sound[..FUNCTION_AT].to_vec();
                answer[5] = 3; // bytes that follow: unit, function and exception
                answer.extend([sound[FUNCTION_AT] | EXCEPTION, DEVICE_FAILED]);
                answer
            }
            None => sound,
        }
    }

    fn owed(&self, array: &mut dyn Instrument, scene: &mut Scene, now_s: f64) -> Owed {
        array.owed(scene, now_s)
    }
}

/// A run of random presses whose array misses, and the requests that the array got.
fn run(presses: usize, on_miss: &str, misses: &[(u64, Miss)]) -> (ExecutedRun, u64) {
    let spec = bench(BENCHES[0].0);
    let array = Mutex::new(None);
    let tamper = |rig: &mut SimulatedRig| *array.lock().expect("no panic") = Some(MissingArray::put_on(rig, misses));
    let plan = plan(&spec, &recipe(presses, on_miss), SEED);
    let run = executed_with(&spec, &plan, Deaths::Ignored, &tamper);
    let requests = array.lock().expect("no panic").as_ref().map_or(0, MissingArray::requests);
    (run, requests)
}

/// Random presses, and what becomes of one with a missed reading.
fn recipe(presses: usize, on_miss: &str) -> String {
    format!(
        "name = \"missed\"\nchecks = \"none\"\n{on_miss}\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.1\n\
         strategy = \"guarded\"\n[[step]]\nphase = \"calibration\"\nforce_n = 1.0\n\
         random = {{ count = {presses}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0] }}\n"
    )
}

/// Numbers of the recorded presses, in the order in which they were made.
fn recorded(run: &ExecutedRun) -> Vec<u64> {
    run.ledger.contacts().map(|contact| contact.press).collect()
}

/// What is wrong with a run that must have each press once, measured, and no harder than the sound one.
fn wrong(run: &ExecutedRun, sound: &ExecutedRun) -> Option<String> {
    let is_whole = run.ending.halt.is_none() && recorded(run) == recorded(sound) && !rows(run).any(is_blank);
    let is_gentle = run.truth.force_n <= sound.truth.force_n + HARDER_N && run.truth.is_within(&bench(BENCHES[0].0));
    (!is_whole || !is_gentle).then(|| {
        let (made, force_n) = (recorded(run).len(), run.truth.force_n);
        format!("{made} presses, {force_n:.3} N of {:.3} N: {:?}", sound.truth.force_n, run.ending.text())
    })
}

#[test]
fn a_press_whose_reading_is_missed_is_made_again() {
    let presses = campaign::size(PRESSES.0, PRESSES.1);
    let (sound, requests) = run(presses, "", &[]);
    assert!(sound.ending.halt.is_none(), "{:?}", sound.ending.text());
    let mut rng = stream(SEED, 0, "when an array misses");
    let mut when = || rng.random_range(requests / 5..requests);
    let count = campaign::size(SILENCES.0, SILENCES.1);
    let silences: Vec<(u64, Miss)> = (0..count).map(|_| (when(), Miss::Silent(SILENT_S))).collect();
    let error = vec![(when(), Miss::Error)];
    let faults = [silences, error];
    let runs = in_parallel(&faults, |misses| run(presses, "", misses).0);
    must_be_none(&runs.iter().filter_map(|run| wrong(run, &sound)).collect::<Vec<_>>());
}

#[test]
fn an_array_that_is_silent_for_ever_ends_the_run_or_flags_the_rows() {
    let (sound, requests) = run(PRESSES.0, "", &[]);
    let silent = [(requests / LATE, Miss::Silent(f64::INFINITY))];
    let policies = ["", "on_miss = \"retry\"", "on_miss = \"end\"", "on_miss = \"flag\""];
    let runs = in_parallel(&policies, |on_miss| run(PRESSES.0, on_miss, &silent).0);
    let [default, retry, end, flag] = &runs[..] else { unreachable!("one for each") };
    for run in [default, retry, end] {
        let text = run.ending.text().expect("it ended early");
        assert!(text.starts_with(NO_ANSWER), "{text}");
        assert!((1..PRESSES.0).contains(&recorded(run).len()) && run.ending.unparked.is_none(), "{text}");
        assert!(run.truth.force_n <= sound.truth.force_n + HARDER_N && run.left_n == 0.0, "{text}");
    }
    assert!(missed(end) == 0 && missed(retry) == 1, "only one is waited for");
    assert_eq!((flag.ending.text(), recorded(flag)), (None, recorded(&sound)));
    let blank: Vec<bool> = rows(flag).map(is_blank).collect();
    let first = blank.iter().position(|is_blank| *is_blank).expect("a row that is blank");
    assert_eq!(first, recorded(retry).len(), "the press at which the others ended");
    assert!(blank[first..].iter().all(|is_blank| *is_blank), "{blank:?}");
}

#[test]
fn a_press_is_flagged_after_its_retries_and_later_ones_are_measured() {
    let (sound, requests) = run(PRESSES.0, "", &[]);
    // the array is back for each retry, and fails again with the next window
    let errors: Vec<(u64, Miss)> = (0..3).map(|nth| (requests / LATE + ERRORS_APART * nth, Miss::Error)).collect();
    let runs =
        in_parallel(&["on_miss = \"retry\"", "on_miss = \"flag\""], |on_miss| run(PRESSES.0, on_miss, &errors).0);
    let text = runs[0].ending.text().expect("it ended early");
    assert!(text.contains("Server device failure") && missed(&runs[0]) == 3, "{text}");
    assert_eq!((runs[1].ending.text(), recorded(&runs[1])), (None, recorded(&sound)));
    assert_eq!(rows(&runs[1]).filter(|row| is_blank(row)).count(), 1);
    assert!(!is_blank(rows(&runs[1]).last().expect("a row")), "later presses are measured");
}

#[test]
fn a_load_cell_that_is_silent_ends_the_run_as_ever() {
    let mut spec = bench(BENCHES[0].0);
    let plan = plan(&spec, &recipe(PRESSES.0, "on_miss = \"flag\""), SEED);
    let sound = executed_with(&spec, &plan, Deaths::Ignored, &|_| {});
    let from_s = (sound.ready_s + sound.virtual_s) / 2.0;
    spec.scene.faults.push(SceneFault { kind: FaultKind::Stale, from_s, value: None });
    let run = executed_with(&spec, &plan, Deaths::Ignored, &|_| {});
    assert!(run.ending.halt.is_some() && missed(&run) == 0, "{:?}", run.ending.text());
}

#[test]
fn the_force_is_watched_while_an_array_is_silent_in_contact() {
    let mut spec = bench(BENCHES[0].0);
    let plan = plan(&spec, &recipe(1, ""), SEED);
    let began = Arc::new(Mutex::new(None));
    let silent = |rig: &mut SimulatedRig| {
        let array = SilentInContact { began: began.clone() };
        rig.array.replace(observed(rig.array.instrument().expect("it has a link").clone(), array));
    };
    let sound = executed_with(&spec, &plan, Deaths::Ignored, &silent);
    let from_s = began.lock().expect("no panic").take().expect("a contact") + RISES_AFTER_S;
    assert!(sound.truth.force_n < 1.0 + HARDER_N && end_of(&sound.ending) == "device", "{:?}", sound.ending.text());
    spec.scene.faults.push(SceneFault { kind: FaultKind::Risen, from_s, value: Some(RISES_MM) });
    let risen = executed_with(&spec, &plan, Deaths::Ignored, &silent);
    assert_eq!(end_of(&risen.ending), "over-force", "{:?}", risen.ending.text());
    let tripped_s = risen.ledger.records().iter().find_map(|record| match record {
        Record::Trip { t_s, .. } => Some(t_s - from_s),
        _ => None,
    });
    assert!(tripped_s.is_some_and(|since_s| since_s < LEFT_WITHIN_S), "{tripped_s:?} s");
    assert!(risen.left_n == 0.0, "{} N left", risen.left_n);
}

/// An array that is silent for ever from the first request in a contact on.
#[derive(Clone)]
struct SilentInContact {
    began: Arc<Mutex<Option<f64>>>,
}

impl Observer for SilentInContact {
    fn answer(&self, array: &mut dyn Instrument, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let mut began = self.began.lock().expect("no panic");
        if began.is_none() && scene.true_force_n(now_s) > IN_CONTACT_N {
            *began = Some(now_s);
        }
        if began.is_some() { Vec::new() } else { array.answer(request, scene, now_s) }
    }

    fn owed(&self, array: &mut dyn Instrument, scene: &mut Scene, now_s: f64) -> Owed {
        array.owed(scene, now_s)
    }
}

/// Number of missed readings in the journal of a run.
fn missed(run: &ExecutedRun) -> usize {
    run.ledger.records().iter().filter(|record| matches!(record, Record::Missed(_))).count()
}

fn rows(run: &ExecutedRun) -> impl Iterator<Item = &Press> {
    run.ledger.contacts().flat_map(|contact| &contact.levels)
}

fn is_blank(row: &Press) -> bool {
    let is_empty = row.force_n.is_none() && row.outputs.iter().all(|output| output.is_nan());
    assert_eq!(is_empty, row.flags == [Flag::Missed], "{row:?}");
    is_empty
}
