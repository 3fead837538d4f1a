//! Cost of a term: time of a reading of a skin, and of a press in the loop. Both are measured by a clock, one after another.

use super::AblationSize;
use super::presses;
use super::terms::{TERMS, TermModel, Touches};
use crate::StudyError;
use crate::methods::specimen::{DEPTH_MM, FORCES_N, Touch, anywhere};
use palpate_core::quantity::round;
use palpate_core::quantity::stream;
use palpate_run::rig::RigSpec;
use palpate_sim::scene::{Elastomer, Skin, SkinSpec};
use serde::Serialize;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Number of readings in one pass. The second constant is the number of passes. The shortest pass counts, because other programs
/// only make passes longer.
const READINGS: usize = 1000;
const PASSES: usize = 60;
/// Number of the loop's runs. The second constant is the number of presses along a side.
const PLANS_RUN: usize = 5;
const SIDE: usize = 5;

/// Cost of a term.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// "ablation".
    pub study: &'static str,
    /// Name of the term, or "all terms": everything that a skin can model, compared with a point load on a half-space.
    pub term: &'static str,
    /// Unit: "ns a reading" (of all units) or "us a press".
    pub cost: &'static str,
    /// Cost without the term.
    pub off: f64,
    /// Cost with the term.
    pub on: f64,
    /// Ratio of `on` to `off`.
    pub ratio: f64,
}

/// Name of the row for all terms together.
pub const ALL_TERMS: &str = "all terms";
/// Cost measured for a skin.
pub const PER_READING: &str = "ns a reading";
/// Cost measured for the loop; see [`PER_READING`].
pub const PER_PRESS: &str = "us a press";

/// Measures the cost of each term that is computed with a reading or in the loop.
///
/// # Errors
/// A scene can't be pressed.
pub(super) fn costs(base: &TermModel, rig: &RigSpec, size: AblationSize, seed: u64) -> Result<Vec<Cost>, StudyError> {
    let mut costs = Vec::new();
    for term in &TERMS {
        let [off, on] = [false, true].map(|on| term.set(base, on));
        // the other terms don't belong to the skin
        if off.scene.skin != on.scene.skin {
            costs.push(cost(term.name, PER_READING, ns_per_reading([&off, &on].map(|model| &model.scene.skin), rig)));
        }
        if term.touches(Touches::Press) {
            costs.push(cost(term.name, PER_PRESS, us_per_press([&off, &on], rig, size, seed)?));
        }
    }
    costs.push(cost_of_all_terms(base, rig));
    Ok(costs)
}

/// Measures the cost of a reading with everything that a skin can model, compared with a point load on a half-space over point
/// units.
pub fn cost_of_all_terms(base: &TermModel, rig: &RigSpec) -> Cost {
    let plain = SkinSpec { elastomer: Some(Elastomer::half_space(DEPTH_MM)), ..SkinSpec::default() };
    let all = TERMS.iter().fold(base.clone(), |model, term| term.set(&model, true)).scene.skin;
    cost(ALL_TERMS, PER_READING, ns_per_reading([&plain, &all], rig))
}

fn cost(term: &'static str, cost: &'static str, [off, on]: [f64; 2]) -> Cost {
    Cost { study: "ablation", term, cost, off: round(off, 1), on: round(on, 1), ratio: round(on / off, 3) }
}

/// Shortest time of many passes over the same contacts, ns per reading. The two skins alternate, so a busy machine slows both.
fn ns_per_reading(skins: [&SkinSpec; 2], rig: &RigSpec) -> [f64; 2] {
    let mut skins = skins.map(|spec| Skin::new(spec, &rig.array.layout, rig.limits.force_n, 1));
    skins.iter_mut().for_each(|skin| skin.draw_contact(&mut stream(1, 0, "taxel noise")));
    let touches = anywhere(READINGS, FORCES_N, &mut stream(1, 0, "test contacts"));
    let mut outputs = vec![0.0; rig.array.layout.len()];
    let mut least = [Duration::MAX; 2];
    for _ in 0..PASSES {
        for (skin, least) in skins.iter().zip(&mut least) {
            let began = Instant::now();
            for &Touch { place, force_n, .. } in &touches {
                // as a running scene reads its taxels while the force reverses
                outputs.fill(0.0);
                skin.add_load(black_box(force_n), black_box(place), &mut outputs);
                skin.read_out(0.5, &mut outputs);
                black_box(&mut outputs);
            }
            *least = began.elapsed().min(*least);
        }
    }
    least.map(|least| least.as_nanos() as f64 / READINGS as f64)
}

fn us_per_press(models: [&TermModel; 2], rig: &RigSpec, size: AblationSize, seed: u64) -> Result<[f64; 2], StudyError> {
    let size = AblationSize { presses: size.presses.min(SIDE), ..size };
    let mut least = [f64::INFINITY; 2];
    for _ in 0..PLANS_RUN {
        for (model, least) in models.iter().zip(&mut least) {
            let condition = presses::condition(model, rig, size, seed);
            let began = Instant::now();
            let done = condition.measure()?.done.max(1);
            *least = least.min(began.elapsed().as_secs_f64() * 1e6 / done as f64);
        }
    }
    Ok(least)
}
