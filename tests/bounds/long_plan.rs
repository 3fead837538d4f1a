//! A recipe of a million points is refused at once and needs no memory. Where it is allowed, it is planned.

use crate::HEAP;
use cpu_time::ThreadTime;
use palpate_data::recipe::{self, Plan};
use palpate_run::rig::{self, RigSpec, SIM_RIG};
use palpate_testing::alone::ran_alone;

const MILLION: usize = 1_000_000;

/// Largest memory of a refusal, bytes: a complete plan would need ten times as much.
const REFUSAL_BYTES: usize = 20 << 20;

/// Largest memory for the plan of so many presses, bytes for each press.
const PRESS_BYTES: usize = 300;

/// Every kind of step that gives a million presses in a few words.
const STEPS: [&str; 4] = [
    "grid = { x_mm = [-5, 4.99], y_mm = [-5, 4.99], spacing_mm = 0.01 }\nforce_n = 1.0",
    "random = { count = 1000000, x_mm = [-5, 5], y_mm = [-5, 5] }\nforce_n = 1.0",
    "random = { count = 1000000, x_mm = [-5, 5], y_mm = [-5, 5], force_n = [0.1, 1.0] }",
    "random = { count = 1000, x_mm = [-5, 5], y_mm = [-5, 5] }\n\
     staircase = { to_n = 1.0, step_n = 0.1, repeats = 1000 }",
];

#[test]
fn million_points_are_refused_cheaply_and_planned_if_allowed() {
    if ran_alone("long_plan::million_points_are_refused_cheaply_and_planned_if_allowed") {
        return;
    }
    let spec = rig::parse("sim.toml", SIM_RIG, &|_| unreachable!("no map of its own")).expect("the shipped rig");
    let text = |step| format!("name = \"long\"\n[[step]]\nphase = \"test\"\n{step}\n");
    // the refusals first, because the peak of memory never falls
    for step in STEPS {
        let (refused, cost) = measured(|| planned(&spec, &text(step), recipe::PRESSES_MAX));
        println!("refused: {:.6} s, {} bytes", cost.cpu_s, cost.bytes);
        let place = if step.starts_with("grid") { "4:8" } else { "4:10" };
        assert_eq!(
            refused.unwrap_err(),
            [format!("r.toml:{place}: the plan has 1000000 presses, but at most 100000 are allowed")]
        );
        assert!(cost.bytes < REFUSAL_BYTES, "{step}: {cost:?}");
    }
    for step in STEPS {
        let (allowed, cost) = measured(|| planned(&spec, &text(step), MILLION));
        println!("planned: {:.3} s, {:.1} MB at most so far", cost.cpu_s, cost.bytes as f64 / 1e6);
        assert_eq!(allowed.expect("it is allowed"), MILLION);
        assert!(cost.bytes < MILLION * PRESS_BYTES, "{step}: {cost:?}");
    }
}

/// Number of presses in the plan of a recipe, where so many are allowed.
fn planned(spec: &RigSpec, text: &str, presses_max: usize) -> Result<usize, Vec<String>> {
    let recipe = recipe::parse("r.toml", text).map_err(|problems| problems.lines())?;
    let plan = Plan::new(&recipe.with_presses_max(presses_max), &spec.ground(), 1).map_err(|problems| problems.lines());
    plan.map(|plan| plan.entries.len())
}

/// Cost of something.
#[derive(Debug)]
struct LongPlanCost {
    cpu_s: f64,
    /// Peak of memory until now.
    bytes: usize,
}

fn measured<T>(work: impl FnOnce() -> T) -> (T, LongPlanCost) {
    let (before, began) = (HEAP.allocated(), ThreadTime::now());
    let result = work();
    let cpu_s = began.elapsed().as_secs_f64();
    (result, LongPlanCost { cpu_s, bytes: HEAP.max_allocated().saturating_sub(before) })
}
