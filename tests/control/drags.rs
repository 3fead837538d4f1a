//! Runs with drags: the true force stays within its limit in length, and the force sideways within its own, whatever the friction, the
//! tilt and the failing device, as long as the specimen is as declared.

use palpate_control::DragLimits;
use palpate_core::quantity::{Axis, Tilt, stream};
use palpate_data::recipe::{self, Plan};
use palpate_run::rig::{self, RigSpec};
use palpate_run::run::rehearse;
use palpate_sim::scene::{ContactLaw, FaultKind, Friction, LoadCellScene, SceneFault, SideAxes};
use palpate_testing::campaign;
use palpate_testing::executions::{
    Deaths, WorstTruth, end_of, executed_with, in_parallel, must_be_none, rig_with_drags, rig_with_three_axes,
};
use rand::RngExt;
use std::collections::BTreeMap;

/// Runs in the quick and in the full tier.
const RUNS: (usize, usize) = (48, 5000);

/// Largest forces, as multiples of their limits.
const MOST: f64 = 1.1;

/// Slope of 5 degrees, the largest tilt of a rig.
const SLOPE: f64 = 0.0874;

/// Upper end of z, mm: a longer way from home only costs time.
const Z_MOST_MM: f64 = 4.0;

/// Latest beginning of a fault, s.
const FAULT_FROM_S: f64 = 25.0;

const LIMITS: DragLimits =
    DragLimits { shear_n: 0.8, slide_mm: 1.0, stiffness_n_mm: 1.5, friction: 3.0, softest_n_mm: None };

/// Least friction that a rig declares.
const FRICTION_LEAST: f64 = 0.1;

/// What is wrong with a run.
const WRONG: [Wrong; 12] = [
    Wrong::Nothing,
    Wrong::Nothing,
    Wrong::Axes(SideAxes::Swapped),
    Wrong::Axes(SideAxes::Mirrored),
    Wrong::Fault(FaultKind::NoSensor),
    Wrong::Fault(FaultKind::Stuck),
    Wrong::Fault(FaultKind::WrongSign),
    Wrong::Fault(FaultKind::StageLost),
    Wrong::Fault(FaultKind::ArrayLost),
    Wrong::Fault(FaultKind::DriftedZero),
    Wrong::Fault(FaultKind::Slip),
    Wrong::Fault(FaultKind::SlowStage),
];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrong {
    Nothing,
    Axes(SideAxes),
    Fault(FaultKind),
}

struct Outcome {
    wrong: Wrong,
    truth: WorstTruth,
    orphaned: WorstTruth,
    end: &'static str,
}

/// Gives a rig a home near the specimen.
fn low_home(spec: &mut RigSpec) {
    let z = &mut spec.stage.travel.axes[Axis::Z.index()];
    spec.stage.home_z_mm = Some(z.max); // the limit is where it was
    z.max = Z_MOST_MM;
}

fn run(seed: u64) -> Outcome {
    let mut rng = stream(seed, 0, "runs with drags");
    let wrong = WRONG[seed as usize % WRONG.len()];
    let mut spec = rig::parse("rig.toml", &rig_with_three_axes(), &|_| unreachable!()).expect("a sound rig");
    let friction = rng.random_range(FRICTION_LEAST..LIMITS.friction);
    spec.frame.uncertainty_mm = 1.0; // a tilted surface
    low_home(&mut spec);
    let linear_n_mm = spec.limits.stiffness_n_mm * rng.random_range(0.8..1.0);
    let softer = stream(seed, 0, "least stiffness").random_range(0.6..0.95);
    spec.stiffness_least_n_mm = Some(linear_n_mm * softer);
    spec.drag = Some(DragLimits { friction, softest_n_mm: spec.stiffness_least_n_mm, ..LIMITS });
    spec.scene.contact = ContactLaw { linear_n_mm, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
    let (slope, angle) = (rng.random_range(0.0..SLOPE), rng.random_range(0.0..std::f64::consts::TAU));
    spec.scene.surface_tilt = Tilt { per_x: slope * angle.cos(), per_y: slope * angle.sin() };
    let sticking = friction * rng.random_range(0.3..1.0);
    let stiffness_n_mm = rng.random_range(0.3..LIMITS.stiffness_n_mm);
    spec.scene.friction = Some(Friction { sticking, sliding: sticking * rng.random_range(0.4..1.0), stiffness_n_mm });
    match wrong {
        Wrong::Nothing => {}
        Wrong::Axes(side_axes) => {
            let cell = spec.scene.load_cell.unwrap_or_default();
            spec.scene.load_cell = Some(LoadCellScene { side_axes, ..cell });
        }
        Wrong::Fault(kind) => {
            let from_s = rng.random_range(0.0..FAULT_FROM_S);
            spec.scene.faults = vec![SceneFault { kind, from_s, value: kind.usual() }];
        }
    }
    let (force_n, mm) = (rng.random_range(0.3..1.6), rng.random_range(0.1..0.5));
    let recipe = format!(
        "name = \"dragged\"\nchecks = \"none\"\n[press]\nhold_s = 0.0\nsample_s = 0.05\n[[step]]\nphase = \"calibration\"\n\
         list = {{ places_mm = [[-3.0, 2.0], [3.0, -3.0]] }}\nforce_n = {force_n}\n\
         drag = {{ mm = {mm}, directions_deg = [0, 120, 240] }}\n"
    );
    let recipe = recipe::parse("recipe.toml", &recipe).expect("a sound recipe");
    let Ok(plan) = Plan::new(&recipe, &spec.ground(), seed) else {
        let (truth, orphaned) = Default::default();
        return Outcome { wrong, truth, orphaned, end: "refused" };
    };
    let executed = executed_with(&spec, &plan, Deaths::Tried, &|_| {});
    Outcome { wrong, truth: executed.truth, orphaned: executed.orphaned, end: end_of(&executed.ending) }
}

#[test]
fn no_drag_exceeds_the_limits_of_the_whole_force_and_of_the_force_sideways() {
    let seeds: Vec<u64> = (0..campaign::size(RUNS.0, RUNS.1) as u64).collect();
    let outcomes = in_parallel(&seeds, |&seed| run(seed));
    let limit_n = rig_limit_n();
    let broken = seeds.iter().zip(&outcomes).filter_map(|(seed, outcome)| {
        let Outcome { wrong, truth, orphaned, end } = outcome;
        let is_within = |truth: &WorstTruth| truth.length_n <= MOST * limit_n && truth.shear_n <= MOST * LIMITS.shear_n;
        (!is_within(truth) || !is_within(orphaned))
            .then(|| format!("seed {seed}: {wrong:?}, {truth:?}, {orphaned:?}, {end}"))
    });
    must_be_none(&broken.collect::<Vec<_>>());
    let most = |of: fn(&WorstTruth) -> f64| outcomes.iter().map(|outcome| of(&outcome.truth)).fold(0.0, f64::max);
    let mut ends: BTreeMap<&str, usize> = BTreeMap::new();
    outcomes.iter().for_each(|outcome| *ends.entry(outcome.end).or_default() += 1);
    let (length_n, shear_n) = (most(|truth| truth.length_n), most(|truth| truth.shear_n));
    println!("{} runs, largest force {length_n:.3} N, sideways {shear_n:.3} N, ends {ends:?}", outcomes.len());
    let is_sound = |(_, outcome): &(&u64, &Outcome)| outcome.wrong == Wrong::Nothing;
    let sound: Vec<(&u64, &Outcome)> = seeds.iter().zip(&outcomes).filter(is_sound).collect();
    // the permit refuses a drag whose end could be over a limit, and the earliest surface that is possible bounds the depth on a steep one
    let false_trips = sound.iter().filter(|(_, outcome)| outcome.end == "outputs-moved").count();
    // the outputs show a touch of 2 mN that 20 readings of the cell don't
    assert!(100 * false_trips <= sound.len(), "{false_trips} of {} sound runs", sound.len());
    let ended = |(seed, outcome): &(&u64, &Outcome)| {
        (!matches!(outcome.end, "-" | "refused" | "not-permitted" | "out-of-reach" | "outputs-moved"))
            .then(|| format!("seed {seed}: {}", outcome.end))
    };
    must_be_none(&sound.iter().filter_map(ended).collect::<Vec<_>>());
    let dragged = sound.iter().filter(|(_, outcome)| outcome.truth.slid_mm > 0.1 && outcome.end == "-").count();
    assert!(2 * dragged > sound.len(), "only {dragged} of {} sound runs were dragged to their end", sound.len());
    let are_found = |outcome: &&Outcome| matches!(outcome.wrong, Wrong::Axes(_)) && outcome.end == "axes-differ";
    assert!(outcomes.iter().filter(are_found).count() * 2 > outcomes.len() / 6, "{ends:?}");
}

fn rig_limit_n() -> f64 {
    let spec: RigSpec = rig::parse("rig.toml", &rig_with_three_axes(), &|_| unreachable!()).expect("a sound rig");
    spec.limits.force_n
}

/// Drags of the quick and of the full tier.
const PLANNED: (usize, usize) = (6, 1000);

/// Plans a drag on a level specimen that is softer than declared. Returns how a run of it ended; `None` if the plan refused it.
fn planned(seed: u64) -> Option<String> {
    let mut rng = stream(seed, 0, "planned drags");
    let mut spec = rig::parse("rig.toml", &rig_with_drags(), &|_| unreachable!()).expect("a sound rig");
    low_home(&mut spec);
    let is_n_mm = rng.random_range(0.6..2.0);
    spec.scene.contact = ContactLaw { linear_n_mm: is_n_mm, quadratic_n_mm2: 0.0, toe_mm: 0.01 };
    spec.limits.stiffness_n_mm = is_n_mm * rng.random_range(1.1..3.0);
    (spec.limits.force_n, spec.limits.depth_mm) = (rng.random_range(2.0..10.0), 3.0);
    spec.stiffness_least_n_mm = rng.random_bool(0.8).then(|| is_n_mm * rng.random_range(0.5..0.9));
    let (sticking, stiffness_n_mm) = (rng.random_range(0.3..1.2), rng.random_range(0.3..1.5));
    spec.scene.friction = Some(Friction { sticking, sliding: 0.8 * sticking, stiffness_n_mm });
    spec.drag = Some(DragLimits {
        shear_n: rng.random_range(0.5..3.0),
        slide_mm: 2.5,
        stiffness_n_mm: stiffness_n_mm * rng.random_range(1.05..2.0),
        friction: sticking * rng.random_range(1.05..2.0),
        softest_n_mm: spec.stiffness_least_n_mm,
    });
    let (force_n, mm) = (rng.random_range(0.2..1.5), rng.random_range(0.1..2.0));
    let text = format!(
        "name = \"dragged\"\nchecks = \"none\"\n[[step]]\nphase = \"calibration\"\nlist = {{ places_mm = [[-2.0, 2.0], [2.0, -2.0]] }}\n\
         force_n = {force_n}\ndrag = {{ mm = {mm}, directions_deg = [0, 90, 225] }}\n"
    );
    let recipe = recipe::parse("recipe.toml", &text).expect("a sound recipe");
    let plan = Plan::new(&recipe, &spec.ground(), seed).ok()?;
    let rehearsal = rehearse(&plan, &spec).expect("it is simulated");
    let executed = executed_with(&spec, &plan, Deaths::Ignored, &|_| {});
    let end = end_of(&executed.ending);
    let early = rehearsal.early.map_or("-".to_owned(), |early| early.text);
    Some(if early.starts_with(end) { end.to_owned() } else { format!("{end} after a rehearsal with {early}") })
}

#[test]
fn a_drag_that_the_plan_passes_is_made() {
    let seeds: Vec<u64> = (0..campaign::size(PLANNED.0, PLANNED.1) as u64).collect();
    let outcomes = in_parallel(&seeds, |&seed| planned(seed));
    let mut ends: BTreeMap<&str, usize> = BTreeMap::new();
    outcomes.iter().for_each(|end| *ends.entry(end.as_deref().unwrap_or("refused")).or_default() += 1);
    println!("{} drags: {ends:?}", outcomes.len());
    let made = outcomes.iter().filter(|end| end.as_deref() == Some("-")).count();
    assert!(4 * made > outcomes.len(), "{ends:?}");
    let other = seeds
        .iter()
        .zip(&outcomes)
        .filter_map(|(seed, end)| end.as_ref().filter(|end| *end != "-").map(|end| format!("seed {seed}: {end}")));
    must_be_none(&other.collect::<Vec<_>>());
}
