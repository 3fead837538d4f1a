//! Runs by depth, without a load cell and with one: the true force never exceeds the limit, whatever the frame states and whichever
//! device fails, as long as the specimen is no stiffer than declared. Depths count from a surface that the array felt, that a person
//! confirmed, or that the load cell touched.

use palpate_core::quantity::{Axis, Place, stream};
use palpate_run::rig::{self, RigSpec};
use palpate_sim::scene::{ContactLaw, FaultKind, Mounting, SceneFault};
use palpate_testing::executions::{Deaths, end_of, executed_with, in_parallel, must_be_none, plan, without_load_cell};
use palpate_testing::wire::{WireFault, put_on_wire};
use palpate_testing::{campaign, shipped_text};
use rand::RngExt;
use std::collections::BTreeMap;

/// Runs of each way to find the surface, in the quick and in the full tier.
const RUNS: (usize, usize) = (64, 5000);
const RUNS_OF_PRINTER: (usize, usize) = (64, 1000);

/// The rig of most runs. A printer has steps, and can't stop.
const SIM: &str = "rigs/sim.toml";

/// Largest error of the frame, mm.
const FRAME_OFF_MM: f64 = 2.0;

/// Upper end of z, mm: a longer way from home only costs time.
const Z_MOST_MM: f64 = 4.0;

/// Latest beginning of a fault, s.
const FAULT_FROM_S: f64 = 40.0;

/// Stiffness of the specimen over the declared one.
const STIFFER: [f64; 4] = [0.5, 1.0, 1.5, 3.0];

const RECIPE: &str = "name = \"deep\"\n[press]\nhold_s = 0.0\nsample_s = 0.05\n[[step]]\nphase = \"calibration\"\n\
    list = { places_mm = [[-3.0, -3.0], [3.0, -3.0], [0.0, 3.0]] }\ndepth_mm = [0.2, DEPTH]\n";

/// Second depth of each place, mm. The permit refuses the larger one where the surface may be too high for it.
const DEPTHS_MM: [&str; 2] = ["0.6", "0.95"];

/// Largest force with a live load cell on a specimen that is stiffer than declared, as a multiple of the limit.
const LIVE_CELL_MOST: f64 = 1.5;

/// What finds the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FoundBy {
    Array,
    Person,
    LoadCell,
}

/// What is wrong with a run.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrong {
    Nothing,
    Frame(f64),
    Wire(WireFault),
    Scene(FaultKind),
}

impl Wrong {
    fn is_of_cell(self) -> bool {
        use FaultKind::{NoSensor, Stale, Stuck, WrongSign};
        matches!(self, Wrong::Scene(NoSensor | Stuck | Stale | WrongSign))
    }
}

/// One run, and its end.
struct Outcome {
    wrong: Wrong,
    times: f64,
    is_deep: bool,
    force_n: f64,
    limit_n: f64,
    end: &'static str,
}

fn specimen(found_by: FoundBy, rig: &str, times: f64) -> RigSpec {
    let text = shipped_text(rig);
    let text = if found_by == FoundBy::LoadCell { text } else { without_load_cell(&text) };
    let mut spec = rig::parse("rig.toml", &text, &|_| unreachable!()).expect("a sound rig").simulated();
    spec.is_touched = found_by == FoundBy::Person;
    if rig == SIM {
        let z = &mut spec.stage.travel.axes[Axis::Z.index()];
        spec.stage.home_z_mm = Some(z.max); // the limit is where it was
        z.max = Z_MOST_MM;
    }
    let linear_n_mm = times * spec.limits.stiffness_n_mm;
    spec.scene.contact = ContactLaw { linear_n_mm, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
    spec.scene.relaxation.clear();
    spec
}

fn run(seed: u64, found_by: FoundBy, rig: &str) -> Outcome {
    let mut rng = stream(seed, 0, "runs without a load cell");
    let times = STIFFER[seed as usize % STIFFER.len()];
    let mut spec = specimen(found_by, rig, times);
    // a person's confirmed value is right within its uncertainty; an array that feels needs no right frame
    let off_mm = if found_by == FoundBy::Person { spec.frame.uncertainty_mm } else { FRAME_OFF_MM };
    let off_mm = rng.random_range(-off_mm..=off_mm);
    let wrong = match seed / STIFFER.len() as u64 % if found_by == FoundBy::LoadCell { 12 } else { 8 } {
        8 => Wrong::Scene(FaultKind::NoSensor),
        9 => Wrong::Scene(FaultKind::Stuck),
        10 => Wrong::Scene(FaultKind::Stale),
        11 => Wrong::Scene(FaultKind::WrongSign),
        0 => Wrong::Nothing,
        1 | 2 => Wrong::Frame(off_mm),
        3 => Wrong::Wire(WireFault::ArrayTimes(0.0)),
        4 => Wrong::Wire(WireFault::TaxelStuck(8)),
        5 => Wrong::Scene(FaultKind::ArrayLost),
        6 => Wrong::Scene(FaultKind::StageLost),
        _ => Wrong::Wire(WireFault::TaxelDead(8)),
    };
    let within_mm = 0.9 * spec.frame.uncertainty_mm;
    let z_mm = match wrong {
        Wrong::Frame(off_mm) => off_mm,
        _ => rng.random_range(-within_mm..=within_mm),
    };
    spec.scene.mounting = Some(Mounting { origin: Place::default(), rotation_deg: 0.0, z_mm });
    let from_s = rng.random_range(0.0..FAULT_FROM_S);
    if let Wrong::Scene(kind) = wrong {
        spec.scene.faults = vec![SceneFault { kind, from_s, value: None }];
    }
    let is_deep = seed / 32 % 2 == 1;
    // the plan would refuse the larger depth below a confirmed surface: here the permit has to
    let unchecked = RigSpec { is_touched: false, ..spec.clone() };
    let plan = plan(&unchecked, &RECIPE.replace("DEPTH", DEPTHS_MM[usize::from(is_deep)]), seed);
    let executed = executed_with(&spec, &plan, Deaths::Ignored, &|rig| {
        if let Wrong::Wire(fault) = wrong {
            put_on_wire(rig, fault, from_s, seed);
        }
    });
    let (force_n, limit_n) = (executed.truth.force_n, spec.limits.force_n);
    Outcome { wrong, times, is_deep, force_n, limit_n, end: end_of(&executed.ending) }
}

/// Makes the runs, and checks that the force stays within the limit, or within the multiple by which the specimen is stiffer.
fn must_stay_within(found_by: FoundBy, rig: &str, runs: (usize, usize)) {
    let seeds: Vec<u64> = (0..campaign::size(runs.0, runs.1) as u64).collect();
    let outcomes = in_parallel(&seeds, |&seed| run(seed, found_by, rig));
    let broken = seeds.iter().zip(&outcomes).filter_map(|(seed, outcome)| {
        let Outcome { wrong, times, force_n, limit_n, end, .. } = outcome;
        let is_cell_live = found_by == FoundBy::LoadCell && !wrong.is_of_cell();
        let most = if is_cell_live { LIVE_CELL_MOST } else { f64::INFINITY };
        let most_n = times.max(1.0).min(most) * limit_n;
        (*force_n > most_n).then(|| format!("seed {seed}: {wrong:?}, {times} times, {force_n:.3} N, {end}"))
    });
    must_be_none(&broken.collect::<Vec<_>>());
    let mut ends: BTreeMap<&str, usize> = BTreeMap::new();
    outcomes.iter().for_each(|outcome| *ends.entry(outcome.end).or_default() += 1);
    let most_n = |times: f64| {
        let alike = outcomes.iter().filter(|outcome| outcome.times.max(1.0) == times);
        alike.map(|outcome| outcome.force_n).fold(0.0, f64::max)
    };
    let most_n = [1.0, 1.5, 3.0].map(most_n);
    println!("{} runs, largest force by stiffness up to 1, 1.5, 3: {most_n:.3?} N, ends {ends:?}", outcomes.len());
    let sound = outcomes.iter().filter(|outcome| outcome.wrong == Wrong::Nothing);
    let may_end = |outcome: &Outcome| match outcome.end {
        "-" => true,
        "not-permitted" => outcome.is_deep,
        "hard-contact" => found_by == FoundBy::LoadCell && outcome.times > 1.0,
        _ => false,
    };
    assert!(sound.clone().all(may_end), "a sound run ended with {ends:?}");
    assert!(sound.clone().any(|outcome| outcome.force_n > 1.0), "nothing was pressed");
}

#[test]
fn no_force_is_over_the_limit_where_the_array_feels_the_surface() {
    must_stay_within(FoundBy::Array, SIM, RUNS);
}

#[test]
fn no_force_is_over_the_limit_inside_the_uncertainty_of_a_confirmed_surface() {
    must_stay_within(FoundBy::Person, SIM, RUNS);
}

#[test]
fn no_force_of_a_press_by_depth_is_over_the_limit_with_a_load_cell() {
    must_stay_within(FoundBy::LoadCell, SIM, RUNS);
}

#[test]
fn no_force_is_over_the_limit_on_a_printer_without_a_load_cell() {
    must_stay_within(FoundBy::Array, "rigs/marlin.toml", RUNS_OF_PRINTER);
    must_stay_within(FoundBy::Person, "rigs/marlin.toml", RUNS_OF_PRINTER);
}
