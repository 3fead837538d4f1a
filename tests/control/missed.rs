//! Arrays that miss readings: silent for a time or for ever, or with an answer that is an error. A missed reading costs a press its time,
//! and never a force.

use palpate_core::quantity::stream;
use palpate_run::rig::SimulatedRig;
use palpate_sim::emulator::{Instrument, Owed};
use palpate_sim::scene::Scene;
use palpate_testing::campaign;
use palpate_testing::executions::{BENCHES, Deaths, ExecutedRun, bench, executed_with, in_parallel, must_be_none, plan};
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
    let recipe = format!(
        "name = \"missed\"\nchecks = \"none\"\n{on_miss}\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.1\n\
         strategy = \"guarded\"\n[[step]]\nphase = \"calibration\"\nforce_n = 1.0\n\
         random = {{ count = {presses}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0] }}\n"
    );
    let array = Mutex::new(None);
    let tamper = |rig: &mut SimulatedRig| *array.lock().expect("no panic") = Some(MissingArray::put_on(rig, misses));
    let run = executed_with(&spec, &plan(&spec, &recipe, SEED), Deaths::Ignored, &tamper);
    let requests = array.lock().expect("no panic").as_ref().map_or(0, MissingArray::requests);
    (run, requests)
}

/// Numbers of the recorded presses, in the order in which they were made.
fn recorded(run: &ExecutedRun) -> Vec<u64> {
    run.ledger.contacts().map(|contact| contact.press).collect()
}

/// What is wrong with a run that must have each press once, measured, and no harder than the sound one.
fn wrong(run: &ExecutedRun, sound: &ExecutedRun) -> Option<String> {
    let rows = || run.ledger.contacts().flat_map(|contact| &contact.levels);
    let is_measured = rows().all(|row| row.outputs.iter().all(|output| output.is_finite()) && row.force_n.is_some());
    let is_whole = run.ending.halt.is_none() && recorded(run) == recorded(sound) && is_measured;
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
