//! Plans with few places, places far apart, and places that are pressed again and again: a sound skin isn't accused, and a load cell that
//! loses gain is found at the next place that was pressed before.
//!
//! ```sh
//! PALPATE_TESTS=full cargo test --test control sparse_plans:: -- --nocapture
//! ```

use palpate_core::quantity::{Axis, Place, RandomStream, stream};
use palpate_data::dataset::{Record, RecordedCheck};
use palpate_data::recipe::Plan;
use palpate_run::rig::{self, RigSpec};
use palpate_sim::scene::{FaultKind, SceneFault};
use palpate_testing::executions::{BENCHES, ExecutedRun, executed, in_parallel, must_be_none, plan};
use palpate_testing::{campaign, exchanged, shipped_text};
use rand::RngExt;
use std::fmt::Write;

/// Seeds of each plan: quick, and full.
const SEEDS: (usize, usize) = (1, 200);
/// Seeds of single presses: quick, and full.
const LIGHT_SEEDS: (usize, usize) = (4, 100);
/// Quick: one seed with a lost gain in so many.
const QUICK_EVERY: usize = 7;

/// Largest scatter of a repeated contact, % of full scale.
const REPEATABILITY_PERCENT: f64 = 2.0;

/// What the load cell's gain falls to, and the presses before which it falls.
const GAINS: [f64; 2] = [0.65, 0.5];
const FALLS: std::ops::RangeInclusive<usize> = 3..=20;

/// The bench's stage and frame, and those of a long strip.
const SHORT: (&str, &str) = (
    "driver = \"esp301\"\nlink = \"sim\"\ntravel_mm = { x = [-12.5, 12.5], y = [-12.5, 12.5], z = [-12.5, 12.5] }",
    "driver = \"grbl\"\nlink = \"sim\"\ntravel_mm = { x = [-199.0, -0.5], y = [-40.5, -0.5], z = [-24.5, -0.5] }",
);
const LEVEL: (&str, &str) = (
    "surface_mm = { z = 0.0, uncertainty = 0.3 }\norigin_mm = { x = 0.0, y = 0.0 }",
    "surface_mm = { z = -12.5, uncertainty = 0.3 }\norigin_mm = { x = -100.0, y = -20.0 }",
);

/// Factors on all outputs, the press from which they are scaled, and the limit of a check under which they must be found.
const SCALES: [f64; 3] = [0.77, 1.3, 3.0];
const SCALED_FROM: usize = 5;
const FINE_CHECK: f64 = 0.2;

/// Upper end of z here, mm: a longer way from home only costs time.
const Z_MOST_MM: f64 = 1.5;

/// An array and the places that are pressed.
#[derive(Clone, Copy, Debug)]
struct SparsePlan {
    name: &'static str,
    /// Lines of the array, the number of its units and outputs, and lines of the scene's skin.
    array: &'static str,
    units: usize,
    outputs: usize,
    skin: &'static str,
    places: fn(&mut RandomStream) -> Vec<Place>,
    /// Presses in succession at each place, and how often all places are visited.
    at_once: usize,
    rounds: usize,
}

const CROSS: &str = "places_mm = [[0.0, 0.0], [4.0, 0.0], [-4.0, 0.0], [0.0, 4.0], [0.0, -4.0]]\nchannels_per_unit = 3";
const SMALL_TAXELS: &str = "elastomer = { depth_mm = 2.5 }\ntaxels = { radius_mm = 1.0 }";
const SQUARE: &str = "grid = { rows = 2, columns = 2, pitch_mm = 10.0 }\nchannels_per_unit = 3";
const LARGE_TAXELS: &str = "elastomer = { depth_mm = 4.0 }\ntaxels = { radius_mm = 3.0 }";
const STRIP: &str = "grid = { rows = 1, columns = 5, pitch_mm = 15.0 }";
const DEEP: &str = "elastomer = { depth_mm = 10.0 }\ntaxels = { radius_mm = 4.0 }";
const USUAL: &str = "grid = { rows = 3, columns = 3, pitch_mm = 4.5 }";
const HALF_SPACE: &str = "elastomer = { depth_mm = 5.0 }";

const PLANS: [SparsePlan; 14] = [
    SparsePlan {
        name: "star, 5 times",
        array: CROSS,
        units: 5,
        outputs: 15,
        skin: SMALL_TAXELS,
        places: star,
        at_once: 5,
        rounds: 1,
    },
    SparsePlan {
        name: "star, 8 times",
        array: CROSS,
        units: 5,
        outputs: 15,
        skin: SMALL_TAXELS,
        places: star,
        at_once: 8,
        rounds: 1,
    },
    SparsePlan {
        name: "star, 20 times",
        array: CROSS,
        units: 5,
        outputs: 15,
        skin: SMALL_TAXELS,
        places: star,
        at_once: 20,
        rounds: 1,
    },
    SparsePlan {
        name: "2 x 2 units",
        array: SQUARE,
        units: 4,
        outputs: 12,
        skin: LARGE_TAXELS,
        places: |_| grid(5, 4.0, 5, 4.0),
        at_once: 4,
        rounds: 1,
    },
    SparsePlan {
        name: "strip",
        array: STRIP,
        units: 5,
        outputs: 5,
        skin: DEEP,
        places: |_| grid(15, 5.0, 3, 5.0),
        at_once: 1,
        rounds: 1,
    },
    SparsePlan {
        name: "star, in rounds",
        array: CROSS,
        units: 5,
        outputs: 15,
        skin: SMALL_TAXELS,
        places: star,
        at_once: 1,
        rounds: 6,
    },
    SparsePlan {
        name: "corners",
        array: USUAL,
        units: 9,
        outputs: 9,
        skin: HALF_SPACE,
        places: |_| grid(2, 12.0, 2, 12.0),
        at_once: 6,
        rounds: 2,
    },
    SparsePlan {
        name: "line",
        array: USUAL,
        units: 9,
        outputs: 9,
        skin: HALF_SPACE,
        places: |_| grid(12, 1.0, 1, 1.0),
        at_once: 3,
        rounds: 1,
    },
    SparsePlan {
        name: "one place",
        array: USUAL,
        units: 9,
        outputs: 9,
        skin: HALF_SPACE,
        places: |_| grid(1, 1.0, 1, 1.0),
        at_once: 30,
        rounds: 1,
    },
    SparsePlan {
        name: "wide grid",
        array: USUAL,
        units: 9,
        outputs: 9,
        skin: SMALL_TAXELS,
        places: |_| grid(4, 4.0, 4, 4.0),
        at_once: 1,
        rounds: 2,
    },
    SparsePlan {
        name: "random places",
        array: USUAL,
        units: 9,
        outputs: 9,
        skin: HALF_SPACE,
        places: |rng| random(rng, 30, 6.0),
        at_once: 1,
        rounds: 1,
    },
    SparsePlan {
        name: "close together, then far",
        array: USUAL,
        units: 9,
        outputs: 9,
        skin: SMALL_TAXELS,
        places: close_then_far,
        at_once: 1,
        rounds: 1,
    },
    SparsePlan {
        name: "ring",
        array: CROSS,
        units: 5,
        outputs: 15,
        skin: LARGE_TAXELS,
        places: |_| ring(12, 5.0),
        at_once: 2,
        rounds: 2,
    },
    SparsePlan {
        name: "random on 2 x 2 units",
        array: SQUARE,
        units: 4,
        outputs: 12,
        skin: SMALL_TAXELS,
        places: |rng| random(rng, 40, 8.0),
        at_once: 1,
        rounds: 1,
    },
];

fn star(_: &mut RandomStream) -> Vec<Place> {
    let mut places = ring(8, 5.0);
    places.insert(0, Place::default());
    places
}

fn ring(count: usize, radius_mm: f64) -> Vec<Place> {
    let turn = |i: usize| std::f64::consts::TAU * i as f64 / count as f64;
    (0..count).map(|i| Place::new(radius_mm * turn(i).cos(), radius_mm * turn(i).sin())).collect()
}

fn grid(columns: usize, dx_mm: f64, rows: usize, dy_mm: f64) -> Vec<Place> {
    let at = |i: usize, count: usize, step_mm: f64| (i as f64 - (count as f64 - 1.0) / 2.0) * step_mm;
    (0..rows * columns).map(|i| Place::new(at(i % columns, columns, dx_mm), at(i / columns, rows, dy_mm))).collect()
}

fn random(rng: &mut RandomStream, count: usize, half_mm: f64) -> Vec<Place> {
    let mut place = || rng.random_range(-half_mm..half_mm);
    (0..count).map(|_| Place::new(place(), place())).collect()
}

fn close_then_far(rng: &mut RandomStream) -> Vec<Place> {
    let mut places = random(rng, 20, 1.0);
    places.extend(grid(3, 6.0, 3, 6.0));
    places
}

impl SparsePlan {
    fn spec_and_plan(&self, seed: u64) -> (RigSpec, Plan) {
        let mut rng = stream(seed, 0, self.name);
        let (bench, text) = BENCHES[0];
        let text = exchanged(text, USUAL, self.array);
        let text = exchanged(&text, HALF_SPACE, self.skin);
        let text = exchanged(
            &text,
            "[array]\ndriver = { modbus = \"labjack-t7\" }",
            &format!("[array]\ndriver = {{ daqmx = \"Dev1/ai0:{}\" }}", self.outputs - 1),
        );
        // the axes of the bench are too short for it
        let text =
            if self.array == STRIP { exchanged(&exchanged(&text, SHORT.0, SHORT.1), LEVEL.0, LEVEL.1) } else { text };
        let percent = rng.random_range(0.0..REPEATABILITY_PERCENT);
        let noise = format!("repeatability_percent = {:?}", vec![percent; self.units]);
        let text: Vec<String> =
            text.lines()
                .filter(|line| !line.starts_with("hysteresis"))
                // a tilt of the bench is too high at the ends of a strip
                .filter(|line| self.array != STRIP || !line.starts_with("surface ="))
                .map(|line| {
                    if line.starts_with("taxel_noise") {
                        format!("taxel_noise = {{ {noise} }}")
                    } else {
                        line.to_owned()
                    }
                })
                .collect();
        let mut spec = rig::parse(bench, &text.join("\n"), &|_| unreachable!("no map of its own"))
            .unwrap_or_else(|problems| panic!("{}: {:?}", self.name, problems.lines()));
        if self.array != STRIP {
            let z = &mut spec.stage.travel.axes[Axis::Z.index()];
            spec.stage.home_z_mm = Some(std::mem::replace(&mut z.max, Z_MOST_MM));
        }
        let mut list = String::new();
        let places = (self.places)(&mut rng);
        for at in (0..self.rounds).flat_map(|_| &places).flat_map(|at| vec![at; self.at_once]) {
            write!(list, "[{:.3}, {:.3}], ", at.x_mm, at.y_mm).expect("a string");
        }
        let recipe = format!(
            "name = \"sparse\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.05\n[[step]]\nphase = \"calibration\"\n\
             list = {{ places_mm = [{list}] }}\nforce_n = 1.0\n"
        );
        let plan = plan(&spec, &recipe, seed);
        (spec, plan)
    }
}

/// A plan with its seed.
fn draws() -> Vec<(SparsePlan, u64)> {
    let seeds = campaign::size(SEEDS.0, SEEDS.1) as u64;
    PLANS.iter().flat_map(|plan| (1..=seeds).map(move |seed| (*plan, seed))).collect()
}

#[test]
fn sound_skin_is_not_accused_where_places_are_few_or_far_apart() {
    let draws = draws();
    let ends = in_parallel(&draws, |(sparse, seed)| {
        let (spec, plan) = sparse.spec_and_plan(*seed);
        let run = executed(&spec, &plan);
        run.ending.text().map(|text| {
            format!("{}, seed {seed}, after {} presses: {text}", sparse.name, run.ledger.contacts().count())
        })
    });
    let broken: Vec<String> = ends.into_iter().flatten().collect();
    for plan in PLANS {
        let of_plan = broken.iter().filter(|end| end.starts_with(&format!("{}, seed", plan.name))).count();
        println!("{}: {of_plan} of {} ended", plan.name, draws.len() / PLANS.len());
    }
    must_be_none(&broken);
}

/// Number of presses until the first press from `fell` on at a place that was pressed before it; `None` if there is none.
fn next_known(plan: &Plan, fell: usize) -> Option<usize> {
    let places: Vec<Place> = plan.entries.iter().map(|entry| entry.place).collect();
    (fell..places.len()).find(|&nth| places[..fell].contains(&places[nth]))
}

/// Executes a plan in which a fault begins before that press; `None` if the plan has fewer presses.
fn failing(mut spec: RigSpec, plan: &Plan, kind: FaultKind, value: f64, before: usize) -> Option<ExecutedRun> {
    let sound = executed(&spec, plan);
    let times_s: Vec<f64> = sound.ledger.contacts().filter_map(|contact| contact.levels.first()?.t_s).collect();
    let from_s = (times_s.get(before - 1)? + times_s.get(before)?) / 2.0;
    spec.scene.faults.push(SceneFault { kind, from_s, value: Some(value) });
    Some(executed(&spec, plan))
}

#[test]
fn lost_gain_is_found_at_the_next_place_that_was_pressed_before() {
    let cases: Vec<(SparsePlan, u64, f64, usize)> = draws()
        .into_iter()
        .flat_map(|(plan, seed)| GAINS.map(|gain| (plan, seed, gain)))
        .enumerate()
        .map(|(nth, (plan, seed, gain))| (plan, seed, gain, FALLS.start() + nth % FALLS.count()))
        .step_by(campaign::every(QUICK_EVERY, 1))
        .collect();
    let ends = in_parallel(&cases, |&(sparse, seed, gain, fell)| {
        let (spec, plan) = sparse.spec_and_plan(seed);
        let known = next_known(&plan, fell)?;
        let run = failing(spec, &plan, FaultKind::LostGain, gain, fell)?;
        let presses = run.ledger.contacts().count();
        let text = run.ending.text();
        println!(
            "{}, seed {seed}, gain {gain} from press {fell}: {presses} presses of {known}, {:.2} N, {text:?}",
            sparse.name, run.truth.force_n
        );
        (text.is_none() || presses > known).then(|| {
            format!(
                "{}, seed {seed}, gain {gain} from press {fell}: {presses} presses, known at {known}: {text:?}",
                sparse.name
            )
        })
    });
    must_be_none(&ends.into_iter().flatten().collect::<Vec<String>>());
}

#[test]
fn outputs_that_are_scaled_are_found_by_the_next_press_at_a_place_or_by_the_check() {
    let cases: Vec<(SparsePlan, u64, f64)> = draws()
        .into_iter()
        .flat_map(|(plan, seed)| SCALES.map(|scale| (plan, seed, scale)))
        .step_by(campaign::every(QUICK_EVERY, 1))
        .collect();
    let ends = in_parallel(&cases, |&(sparse, seed, scale)| {
        let (spec, plan) = sparse.spec_and_plan(seed);
        let run = failing(spec, &plan, FaultKind::ScaledOutputs, scale, SCALED_FROM)?;
        let checks: Vec<&RecordedCheck> = run
            .ledger
            .records()
            .iter()
            .filter_map(|record| if let Record::Check(check) = record { Some(check) } else { None })
            .collect();
        let limit = checks.last().and_then(|check| Some(check.outputs?.limit));
        let is_found = run.ending.text().is_some() || checks.iter().any(|check| check.is_failed());
        println!("{}, seed {seed}, outputs x {scale}: found {is_found}, limit of the check {limit:?}", sparse.name);
        (!is_found && limit.is_some_and(|limit| limit < FINE_CHECK))
            .then(|| format!("{}, seed {seed}, outputs x {scale}: limit {limit:?}", sparse.name))
    });
    must_be_none(&ends.into_iter().flatten().collect::<Vec<String>>());
}

/// The first press of the tutorial, and stronger ones: its check may not doubt a sound cell.
#[test]
fn check_of_a_single_light_press_knows_its_noise() {
    let forces_n = [0.2, 0.5, 1.0];
    let seeds = campaign::size(LIGHT_SEEDS.0, LIGHT_SEEDS.1) as u64;
    let cases: Vec<(f64, u64)> =
        forces_n.iter().flat_map(|&force_n| (1..=seeds).map(move |seed| (force_n, seed))).collect();
    let ends = in_parallel(&cases, |&(force_n, seed)| {
        let spec = rig::parse("sim.toml", &shipped_text("rigs/sim.toml"), &|_| unreachable!("no map of its own"));
        let spec = spec.unwrap_or_else(|problems| panic!("{:?}", problems.lines()));
        let recipe = format!(
            "name = \"first\"\n[[step]]\nphase = \"calibration\"\nlist = {{ places_mm = [[0.0, 0.0]] }}\nforce_n = {force_n:?}\n"
        );
        let run = executed(&spec, &plan(&spec, &recipe, seed));
        let failed =
            run.ledger.records().iter().find(|record| matches!(record, Record::Check(check) if check.is_failed()));
        let end = run.ending.text().or_else(|| failed.map(|check| format!("{check:?}")));
        end.map(|end| format!("{force_n} N, seed {seed}: {end}"))
    });
    must_be_none(&ends.into_iter().flatten().collect::<Vec<String>>());
}
