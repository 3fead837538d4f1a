//! What happens before there is a zero: for any place of home and any direction of z, the force on the declared specimen is at most the
//! force limit, and no zero is taken in contact.
//!
//! `PALPATE_TESTS=full` makes 50 trials of each kind on each bench.

use palpate_core::quantity::{Axis, Down, Place, stream};
use palpate_run::rig::{RigSpec, SimulatedRig};
use palpate_run::run::{Cancel, ForceCheck, examine};
use palpate_sim::emulator::{Instrument, Owed, Shared};
use palpate_sim::scene::{FaultKind, Mounting, Scene, SceneDevice, SceneFault};
use palpate_testing::campaign;
use palpate_testing::executions::{
    BENCHES, Deaths, bench, end_of, executed_with, in_parallel, must_be_none, plan, run_virtually,
};
use rand::RngExt;
use std::sync::{Arc, Mutex};
use tokio::sync::Notify;

/// Trials of each kind on each bench.
fn trials() -> u64 {
    campaign::size(5, 50) as u64
}

/// The end of z's travel at which an ESP301 homes, mm.
const END_MM: f64 = 12.5;

/// Mass on the load cell, kg.
const TOOL_KG: f64 = 0.2;

/// Largest depth where only the array feels the specimen, mm.
const FELT_MM: f64 = 0.5;

/// Largest part of a peak that a scene may miss between two looks, N.
const PEAK_N: f64 = 0.0005;

const RECIPE: &str =
    "name = \"one\"\n[[step]]\nphase = \"calibration\"\nlist = { places_mm = [[0.0, 0.0]] }\nforce_n = 1.0\n";

/// The fault of a rig.
#[derive(Clone, Copy, Debug, PartialEq)]
enum UnzeroedWrong {
    /// `frame.down` is reversed, and z is clear.
    Down,
    /// The same with a load cell that reads no force: only the array feels the specimen.
    DownDeadCell,
    /// `frame.down` is reversed, and z is in contact.
    DownInContact,
    /// z is in contact at the end of its travel, where homing leaves it.
    Preload,
}

impl UnzeroedWrong {
    const ALL: [UnzeroedWrong; 4] =
        [UnzeroedWrong::Down, UnzeroedWrong::DownDeadCell, UnzeroedWrong::DownInContact, UnzeroedWrong::Preload];
}

/// A declared specimen whose surface is at this distance below the end of z's travel, mm; negative: z is in it there.
fn specimen_at(name: &str, from_end_mm: f64) -> RigSpec {
    let mut spec = bench(name);
    spec.stage.travel.axes[Axis::Z.index()].max = END_MM;
    let z_mm = -END_MM + from_end_mm;
    spec.scene.mounting = Some(Mounting { origin: Place::default(), rotation_deg: 0.0, z_mm });
    spec
}

#[test]
fn no_zero_is_taken_in_contact_and_the_specimen_bears_at_most_the_limit() {
    let mut jobs = Vec::new();
    for (name, _) in BENCHES {
        for wrong in UnzeroedWrong::ALL {
            jobs.extend((0..trials()).map(|nth| (name, wrong, nth)));
        }
    }
    let seen = in_parallel(&jobs, |&(name, wrong, nth)| {
        let mut rng = stream(nth, wrong as u64, name);
        let from_end_mm = match wrong {
            UnzeroedWrong::Down | UnzeroedWrong::DownDeadCell => rng.random_range(0.1..10.0),
            UnzeroedWrong::DownInContact | UnzeroedWrong::Preload => -rng.random_range(0.05..0.8),
        };
        let mut real = specimen_at(name, from_end_mm);
        if wrong == UnzeroedWrong::DownDeadCell {
            real.scene.faults = vec![SceneFault { kind: FaultKind::NoSensor, from_s: 0.0, value: None }];
        }
        let mut spec = real.clone();
        if wrong != UnzeroedWrong::Preload {
            spec.frame.down = Down::Plus;
        }
        let swap = |rig: &mut SimulatedRig| *rig = real.emulators(nth).expect("emulators");
        let executed = executed_with(&spec, &plan(&spec, RECIPE, nth), Deaths::Ignored, &swap);
        let end = end_of(&executed.ending);
        let zeroed = executed.ready_s > 0.0;
        let output = format!(
            "{name}, {wrong:?}, surface {from_end_mm:+.2} mm from the end: {end}, {:.3} N",
            executed.truth.force_n
        );
        let mut broken = Vec::new();
        // an XPS homes a whole group: x and y move before anything shows that z is in contact
        let slid = executed.truth.slid_mm > 0.0 && name != "bench-fast";
        if executed.truth.force_n > real.limits.force_n + PEAK_N || slid {
            broken.push(output.clone());
        }
        if zeroed {
            broken.push(format!("{output}: a zero was taken"));
        }
        if wrong == UnzeroedWrong::DownDeadCell && (end != "outputs-moved" || executed.truth.depth_mm > FELT_MM) {
            broken.push(format!("{output}, {:.3} mm deep", executed.truth.depth_mm));
        }
        (wrong, end, executed.truth.force_n, broken)
    });
    for wrong in UnzeroedWrong::ALL {
        let of_it = || seen.iter().filter(|(kind, ..)| *kind == wrong);
        let worst_n = of_it().map(|(_, _, worst_n, _)| *worst_n).fold(0.0, f64::max);
        let mut ends: Vec<&str> = of_it().map(|(_, end, ..)| *end).collect();
        ends.sort_unstable();
        let ends: Vec<String> =
            ends.chunk_by(|a, b| a == b).map(|same| format!("{} {}", same.len(), same[0])).collect();
        println!("{wrong:?}: the specimen bore at most {worst_n:.3} N; {}", ends.join(", "));
    }
    must_be_none(&seen.into_iter().flat_map(|(.., broken)| broken).collect::<Vec<_>>());
}

#[test]
fn tool_of_200_g_does_not_stop_homing() {
    let jobs: Vec<(&str, u64)> =
        BENCHES.iter().flat_map(|(name, _)| (0..trials().div_ceil(2)).map(move |nth| (*name, nth))).collect();
    let stopped = in_parallel(&jobs, |&(name, nth)| {
        let mut spec = specimen_at(name, 20.0);
        spec.scene.load_cell.as_mut().expect("a load cell").tool_kg = TOOL_KG;
        let cancel = Cancel::default();
        let found = run_virtually(examine(&spec, nth, &cancel, ForceCheck::Nobody));
        match found {
            Ok(found) if matches!(found.no_load, Some(Ok(_))) => None,
            Ok(found) => Some(format!("{name}, {nth}: {:?}", found.no_load)),
            Err(halt) => Some(format!("{name}, {nth}: {halt:?}")),
        }
    });
    println!("{} homings with {TOOL_KG} kg on the load cell", jobs.len());
    must_be_none(&stopped.into_iter().flatten().collect::<Vec<_>>());
}

/// A stage that ignores stops.
struct Unstoppable(Shared<dyn Instrument>);

impl Instrument for Unstoppable {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.0.lock().unwrap().take_request(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let text = String::from_utf8_lossy(request).replace("ST", "");
        self.0.lock().unwrap().answer(text.as_bytes(), scene, now_s)
    }

    fn deaf_until_s(&self) -> f64 {
        self.0.lock().unwrap().deaf_until_s()
    }

    fn bell(&self) -> Option<Arc<Notify>> {
        self.0.lock().unwrap().bell()
    }

    fn owed(&mut self, scene: &mut Scene, now_s: f64) -> Owed {
        self.0.lock().unwrap().owed(scene, now_s)
    }
}

/// The stage of `bench-esp301` homes toward the specimen and ignores stops: it is not reported as stopped.
#[test]
fn a_stage_that_does_not_stop_is_reported_with_the_emergency_stop() {
    let real = specimen_at("bench-esp301", 5.0);
    let mut spec = real.clone();
    spec.frame.down = Down::Plus;
    let swap = |rig: &mut SimulatedRig| {
        *rig = real.emulators(1).expect("emulators");
        let stage = rig.stage.instrument().expect("it has a link").clone();
        rig.stage.replace(Arc::new(Mutex::new(Unstoppable(stage))));
    };
    let executed = executed_with(&spec, &plan(&spec, RECIPE, 1), Deaths::Ignored, &swap);
    assert_eq!(end_of(&executed.ending), "not-stopped", "{:?}", executed.ending.text());
    let output = executed.ending.text().expect("a reason");
    assert!(output.contains("the stage does not stop: press the emergency stop"), "{output}");
    assert!(!output.contains("has stopped"), "{output}");
}
