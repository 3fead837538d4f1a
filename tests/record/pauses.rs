//! Pauses and rests: a rest has the duration of its recipe for any pauses, and a trip is reported before the stage is parked.

use palpate_core::quantity::Axis;
use palpate_data::dataset::{DatasetError, Ledger, Memory, Press, Record, RecordedContact, Retouch, Status};
use palpate_data::recipe::Plan;
use palpate_link::time::{Instant, sleep};
use palpate_run::rig::RigSpec;
use palpate_run::run::{Cancel, Ending, Halt, Listener, RunJob, execute, execute_on};
use palpate_sim::emulator::Shared;
use palpate_sim::scene::{FaultKind, Scene, SceneFault};
use palpate_testing::executions::{bench, plan, run_virtually};
use std::time::Duration;

/// Largest distance of z from its parking position, mm: the error of a read-back.
const PARKED_MM: f64 = 0.003;

const REST_S: f64 = 60.0;
const RECIPE: &str = "name = \"rests\"\n[press]\nforce_tolerance_n = 0.05\n[[step]]\nphase = \"characterisation\"\n\
                      units = [5]\nstaircase = { to_n = 1.0, step_n = 1.0, repeats = 3, rest_s = 60.0 }\n";

/// A person who pauses repeatedly, and continues each time.
struct Restless {
    cancel: Cancel,
    /// Remaining pauses, each as soon as a rest begins or continues.
    pauses: usize,
    paused: usize,
    /// The stop after so many presses.
    stop_after: usize,
    made: usize,
}

impl Restless {
    fn new(pauses: usize, stop_after: usize) -> Restless {
        Restless { cancel: Cancel::default(), pauses, paused: 0, stop_after, made: 0 }
    }
}

impl Listener for Restless {
    fn rests(&mut self, _: f64) {
        if self.pauses > 0 {
            self.pauses -= 1;
            let cancel = self.cancel.clone();
            palpate_link::time::spawn(async move {
                sleep(Duration::from_secs(1)).await;
                cancel.pause();
            });
        }
    }

    fn recorded(&mut self, _: &RecordedContact) {
        self.made += 1;
        if self.made == self.stop_after {
            self.cancel.ask();
        }
    }

    fn paused(&mut self) -> bool {
        self.paused += 1;
        self.cancel.go_on();
        true
    }
}

fn executed(spec: &RigSpec, plan: &Plan, ledger: &mut dyn Ledger, listener: &mut Restless) -> Ending {
    let cancel = listener.cancel.clone();
    run_virtually(async {
        let job = RunJob { plan, spec, ledger, cancel: &cancel, shown: &|_| {} };
        execute(job, listener).await
    })
}

/// z in the specimen frame, mm.
fn z_mm(spec: &RigSpec, scene: &Shared<Scene>, began: Instant) -> f64 {
    let (z_mm, _) = scene.lock().expect("nobody holds it").axis(Axis::Z, began.elapsed().as_secs_f64());
    spec.frame.z_from_stage(z_mm)
}

/// From the last window of each press to the first of the next, s.
fn gaps_s(memory: &Memory) -> Vec<f64> {
    let levels: Vec<&[Press]> = memory.contacts().map(|contact| contact.levels.as_slice()).collect();
    let t_s = |press: Option<&Press>| press.and_then(|press| press.t_s).expect("a time");
    let gap_s = |two: &[&[Press]]| t_s(two[1].first()) - t_s(two[0].last());
    levels.windows(2).map(gap_s).collect()
}

#[test]
fn rest_is_not_shortened_by_any_number_of_pauses() {
    let spec = bench("bench-fast");
    let plan = plan(&spec, RECIPE, 1);
    for pauses in [0, 1, 3] {
        let (mut memory, mut person) = (Memory::default(), Restless::new(pauses, usize::MAX));
        let ending = executed(&spec, &plan, &mut memory, &mut person);
        assert_eq!((ending.status(), person.paused), (Status::Complete, pauses), "{:?}", ending.text());
        let gaps_s = gaps_s(&memory);
        assert!(gaps_s.len() == 2 && gaps_s.iter().all(|&gap_s| gap_s >= REST_S), "{pauses} pauses: {gaps_s:?}");
    }
}

#[test]
fn interrupted_rest_is_repeated_in_full() {
    let spec = bench("bench-fast");
    let plan = plan(&spec, RECIPE, 1);
    let (mut memory, mut person) = (Memory::default(), Restless::new(0, 1));
    assert_eq!(executed(&spec, &plan, &mut memory, &mut person).status(), Status::Stopped);
    let mut person = Restless::new(2, usize::MAX);
    let ending = executed(&spec, &plan, &mut memory, &mut person);
    assert_eq!((ending.status(), person.paused), (Status::Complete, 2), "{:?}", ending.text());
    assert!(memory.records().iter().any(|record| matches!(record, Record::Retouch(Retouch { .. }))));
    let gaps_s = gaps_s(&memory);
    assert!(gaps_s.len() == 2 && gaps_s.iter().all(|&gap_s| gap_s >= REST_S), "{gaps_s:?}");
}

#[test]
fn pause_requested_before_the_first_press_comes_before_it() {
    let spec = bench("bench-fast");
    let plan = plan(&spec, RECIPE, 1);
    let (mut memory, mut person) = (Memory::default(), Restless::new(0, usize::MAX));
    person.cancel.pause();
    let ending = executed(&spec, &plan, &mut memory, &mut person);
    assert_eq!((ending.status(), person.paused), (Status::Complete, 1), "{:?}", ending.text());
    let first = memory.records().iter().position(|record| record.contact().is_some()).expect("a contact");
    let zeros = memory.records()[..first].iter().filter(|record| matches!(record, Record::Zero { .. })).count();
    assert_eq!(zeros, 2, "before the first press, and after the pause");
}

/// A person who pauses after a press, and reads z meanwhile.
struct Looking<'a> {
    cancel: &'a Cancel,
    z_mm: &'a dyn Fn() -> f64,
    stood_mm: Vec<f64>,
}

impl Listener for Looking<'_> {
    fn recorded(&mut self, _: &RecordedContact) {
        self.cancel.pause();
    }

    fn paused(&mut self) -> bool {
        self.stood_mm.push((self.z_mm)());
        self.cancel.go_on();
        true
    }
}

#[test]
fn run_is_parked_during_a_pause() {
    let spec = bench("bench-fast");
    let plan = plan(&spec, RECIPE, 1);
    let stood_mm = run_virtually(async {
        let rig = spec.emulators(plan.seed).expect("emulators");
        let (scene, began, cancel) = (rig.scene.clone(), Instant::now(), Cancel::default());
        let z_mm = || z_mm(&spec, &scene, began);
        let (mut memory, rig) = (Memory::default(), spec.open_on(rig).expect("drivers"));
        let job = RunJob { plan: &plan, spec: &spec, ledger: &mut memory, cancel: &cancel, shown: &|_| {} };
        let mut person = Looking { cancel: &cancel, z_mm: &z_mm, stood_mm: Vec::new() };
        let ending = execute_on(rig, job, &mut person).await;
        assert_eq!(ending.status(), Status::Complete, "{:?}", ending.text());
        person.stood_mm
    });
    let parked_mm = spec.clear_mm() + PARKED_MM;
    // between the three presses, and before the check at the end
    assert!(stood_mm.len() == 3 && stood_mm.iter().all(|&z_mm| z_mm <= parked_mm), "{stood_mm:?}, not {parked_mm} mm");
}

#[test]
fn a_trip_is_reported_before_the_stage_is_parked() {
    let mut spec = bench("bench-fast");
    spec.scene.faults.push(SceneFault { kind: FaultKind::NoContact, from_s: 0.0, value: None });
    let plan = plan(&spec, RECIPE, 1);
    let (mut memory, mut person) = (Memory::default(), Restless::new(0, usize::MAX));
    let ending = executed(&spec, &plan, &mut memory, &mut person);
    assert_eq!(ending.status(), Status::Tripped);
    let stated_s = memory.records().iter().find_map(|record| match record {
        Record::Trip { t_s, .. } => Some(*t_s),
        _ => None,
    });
    assert!(
        stated_s.is_some_and(|stated_s| stated_s + 0.01 < ending.t_s),
        "reported at {stated_s:?}, parked at {}",
        ending.t_s
    );
}

/// A ledger that accepts no contact, as on a full disk.
#[derive(Default)]
struct Full(Memory);

impl Ledger for Full {
    fn has(&self, press: u64) -> bool {
        self.0.has(press)
    }

    fn recall(&self, tell: &mut dyn FnMut(&Record)) -> Result<(), DatasetError> {
        self.0.recall(tell)
    }

    fn record(&mut self, record: &Record) -> Result<(), DatasetError> {
        match record {
            Record::Contact(_) => {
                let (doing, path) = ("writing", "journal.log".into());
                Err(DatasetError::Io { doing, path, why: std::io::ErrorKind::StorageFull.into() })
            }
            other => self.0.record(other),
        }
    }
}

#[test]
fn a_press_that_cannot_be_recorded_ends_the_run_and_the_stage_is_parked() {
    let spec = bench("bench-fast");
    let plan = plan(&spec, RECIPE, 1);
    let (mut ledger, mut person) = (Full::default(), Restless::new(0, usize::MAX));
    let (ending, z_mm) = run_virtually(async {
        let rig = spec.emulators(plan.seed).expect("emulators");
        let (scene, began, cancel) = (rig.scene.clone(), Instant::now(), Cancel::default());
        let rig = spec.open_on(rig).expect("drivers");
        let job = RunJob { plan: &plan, spec: &spec, ledger: &mut ledger, cancel: &cancel, shown: &|_| {} };
        let ending = execute_on(rig, job, &mut person).await;
        (ending, z_mm(&spec, &scene, began))
    });
    assert!(matches!(ending.halt, Some(Halt::Record(_))) && ending.unparked.is_none(), "{:?}", ending.text());
    assert_eq!(person.made, 0, "nothing is acknowledged");
    assert!(z_mm <= spec.clear_mm() + PARKED_MM, "parked, and not at {z_mm} mm");
}
