//! Monitors that fail: the error names the monitor, nothing is pressed after it, and the stage is parked.

use palpate_data::dataset::Memory;
use palpate_link::time::run_virtually;
use palpate_run::rig::{self, RigSpec, SimulatedRig};
use palpate_run::run::{Cancel, Ending, Halt, Listener, RunJob, execute_on};
use palpate_sim::emulator::lines::{LineFault, LineFaultKind, OneNumber, SerialBoard};
use palpate_testing::executions::{plan, rig_without_load_cell};
use palpate_testing::{exchanged, shipped_text};
use std::sync::{Arc, Mutex};

const RECIPE: &str = "name = \"monitored\"\n[[step]]\nphase = \"calibration\"\n\
                      list = { places_mm = [[0.0, 0.0], [3.0, -3.0], [-3.0, 1.0], [1.0, 1.0]] }\nforce_n = 1.0\n";

struct MonitorSilent;

impl Listener for MonitorSilent {}

fn monitored(rig: &str, more: &str) -> RigSpec {
    let monitor =
        "[[monitor]]\nname = \"temperature_c\"\ndriver = { lines = \"one-number\" }\nlink = \"sim\"\nevery_s = 0.1\n";
    let rig = exchanged(rig, "[scene]", &format!("{monitor}{more}\n[scene]"));
    rig::parse("rig.toml", &rig, &|_| unreachable!("no map of its own")).expect("a rig")
}

fn executed(spec: &RigSpec, recipe: &str, tamper: impl Fn(&mut SimulatedRig)) -> (Ending, Memory) {
    let plan = plan(spec, recipe, 3);
    let mut ledger = Memory::default();
    let ending = run_virtually(async {
        let mut rig = spec.emulators(plan.seed).expect("emulators");
        tamper(&mut rig);
        let rig = spec.open_on(rig).expect("drivers");
        let cancel = Cancel::default();
        let job = RunJob { plan: &plan, spec, ledger: &mut ledger, cancel: &cancel, shown: &|_| {} };
        execute_on(rig, job, &mut MonitorSilent).await
    });
    (ending, ledger)
}

fn device_error(ending: &Ending) -> String {
    assert!(ending.unparked.is_none(), "{ending:?}");
    match &ending.halt {
        Some(Halt::Device(error) | Halt::Missed(error)) => error.to_string(),
        halt => panic!("{halt:?}"),
    }
}

#[test]
fn a_monitor_that_stops_during_a_run_ends_it_with_its_name() {
    let spec = monitored(&shipped_text("rigs/sim.toml"), "");
    let stops = |at_s: f64| {
        move |rig: &mut SimulatedRig| {
            let fault = LineFault { kind: LineFaultKind::Stops, at_s, for_s: 1e6 };
            rig.monitors[0]
                .device
                .replace(Arc::new(Mutex::new(SerialBoard::new(OneNumber::new(1.0, 0.0)).with_fault(fault))));
        }
    };
    let (ending, ledger) = executed(&spec, RECIPE, stops(42.0));
    let error = device_error(&ending);
    assert!(
        error.starts_with("monitor temperature_c (one number a line at sim): while reading the outputs: "),
        "{error}"
    );
    assert!((1..4).contains(&ledger.contacts().count()), "{}", ledger.contacts().count());
    let (ending, ledger) = executed(&spec, RECIPE, stops(0.0));
    let error = device_error(&ending);
    assert!(
        error.starts_with("monitor temperature_c (one number a line at sim): while waiting for its first"),
        "{error}"
    );
    assert_eq!((ledger.contacts().count(), ending.remaining.text()), (0, None), "nothing has moved");
}

#[test]
fn a_value_that_is_no_number_is_a_device_error() {
    let mut spec = monitored(&shipped_text("rigs/sim.toml"), "");
    spec.monitors[0].offset = f64::INFINITY;
    // a sound reading: that of the first taxel without load
    let taxel = |rig: &mut SimulatedRig| rig.monitors[0].scene = rig.scene.clone();
    let (ending, ledger) = executed(&spec, RECIPE, taxel);
    let text = "monitor temperature_c: while reading its value: it answered \"0\", expected a finite number";
    assert_eq!((device_error(&ending).as_str(), ledger.contacts().count()), (text, 0));
}

#[test]
fn a_rig_without_a_load_cell_has_monitors_too() {
    let recipe = exchanged(RECIPE, "force_n = 1.0", "depth_mm = 0.4");
    let spec = RigSpec { is_touched: true, ..monitored(&rig_without_load_cell(), "") };
    let (ending, ledger) = executed(&spec, &recipe, |_| {});
    assert!(ending.halt.is_none(), "{ending:?}");
    let values: Vec<_> = ledger.contacts().map(|contact| contact.monitors[0].value).collect();
    assert_eq!(values, [23.0; 4]);
    let spec =
        RigSpec { is_touched: true, ..monitored(&rig_without_load_cell(), "bounds = [24.0, 25.0]\nwait_s = 3.0\n") };
    let (ending, ledger) = executed(&spec, &recipe, |_| {});
    let text = ending.text().expect("a reason");
    assert!(text.starts_with("temperature_c is 23, outside 24 to 25 after a wait of 3 s"), "{text}");
    assert!(matches!(ending.halt, Some(Halt::OutOfBounds(_))) && ledger.contacts().count() == 0);
}
