//! Checks the drags of a plan as the permit will.

use super::plan::Ground;
use super::step::Step;
use palpate_control::{DragLimits, DragStart};
use palpate_core::quantity::round;
use palpate_document::Problem;

/// Force by which a mean may exceed the force and its tolerance, N: the noise of a load cell.
const NOISE_N: f64 = 0.01;

/// Force sideways that a press along the normal may have, as a fraction of its force: a cell's axes are that little apart.
const SIDEWAYS_SHARE: f64 = 0.02;

/// Steps of the search for the largest way or force that passes: each halves the interval.
const HALVINGS: u32 = 12;

/// The drags of a step: largest force, largest depth, the tolerance of the force, and the way.
#[derive(Clone, Copy, Debug)]
pub struct PlannedDrag {
    /// Largest force of the press, N; 0 for a press by depth.
    pub most_n: f64,
    /// Largest depth of the press, mm; 0 for a press by force.
    pub most_mm: f64,
    /// Tolerance of the force, N.
    pub tolerance_n: f64,
    /// Way of the drag, mm.
    pub way_mm: f64,
}

impl PlannedDrag {
    /// Returns each value at its end: value, limit and unit. It is the permit's formula for a specimen as declared.
    pub fn end(&self, ground: &Ground, most: &DragLimits) -> [(f64, f64, &'static str); 3] {
        let limits = ground.limits;
        let PlannedDrag { most_n, most_mm, tolerance_n, way_mm } = *self;
        let by_force = most_n > 0.0;
        // a press by depth has any force that the declared stiffness allows
        let force_n = if by_force { most_n + tolerance_n + NOISE_N } else { limits.stiffness_n_mm * most_mm };
        let tilted_n = (ground.frame.tilt.tangent() + SIDEWAYS_SHARE) * force_n + NOISE_N;
        let depth_mm = if by_force { limits.depth_mm } else { most_mm };
        most.end(limits, &ground.steps, &DragStart { force_n, peak_n: force_n, shear_n: tilted_n, depth_mm }, way_mm)
    }

    fn is_safe(&self, ground: &Ground, most: &DragLimits) -> bool {
        self.end(ground, most).iter().all(|(value, limit, _)| value <= limit)
    }

    /// Returns the largest part of the way and of the force or depth that passes, each with the other as it is; `None`: none.
    fn largest(&self, ground: &Ground, most: &DragLimits) -> [Option<f64>; 2] {
        let less = |share: f64| PlannedDrag { way_mm: share * self.way_mm, ..*self };
        let weaker = |share: f64| PlannedDrag { most_n: share * self.most_n, most_mm: share * self.most_mm, ..*self };
        let search = |of: &dyn Fn(f64) -> PlannedDrag| {
            let (mut safe, mut unsafe_) = (0.0, 1.0);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (safe + unsafe_);
                if of(middle).is_safe(ground, most) { safe = middle } else { unsafe_ = middle }
            }
            (safe > 0.0).then_some(safe)
        };
        [search(&less), search(&weaker)]
    }
}

/// Checks the drags of a step.
pub(super) fn check_drags(step: &Step, ground: &Ground, problems: &mut Vec<Problem>) {
    let Some(first) = step.drags.first() else { return };
    let mut complain = |text: String, help: &str| {
        problems.push(Problem::new(step.drag_span.clone(), text).help(help));
    };
    let needs = [
        (
            ground.three_axes,
            "the load cell has one axis",
            "a drag needs a load cell with three axes, with `axes` in [load_cell]",
        ),
        (
            !ground.abilities.finishes(),
            "the stage finishes each motion, so nothing can end a drag",
            "use a stage that stops in time, or remove `drag`",
        ),
        (
            ground.drag.is_some(),
            "the rig allows no drag",
            "add drag = { shear_n, slide_mm, stiffness_n_mm, friction } to [limits] of the rig",
        ),
        (
            !ground.is_slippery,
            "the simulated specimen has no friction, so a drag has no force",
            "add [scene.friction] to the rig, with sticking, sliding and stiffness_n_mm",
        ),
    ];
    if let Some((_, why, help)) = needs.into_iter().find(|(is_met, ..)| !is_met) {
        return complain(format!("this step drags the tip in contact, but {why}"), help);
    }
    let Some(most) = ground.drag else { return };
    if let Some(shear_n) = first.shear_n.filter(|shear_n| *shear_n > most.shear_n) {
        let text = format!("this drag ends at {shear_n} N sideways, over the limit of {} N", most.shear_n);
        complain(text, "use a smaller `shear_n`, or correct `limits.drag` of the rig");
    }
    let planned = PlannedDrag {
        most_n: step.load.most_n(),
        most_mm: step.load.most_mm(),
        tolerance_n: step.manner.force_tolerance_n,
        way_mm: first.way_mm(),
    };
    let Some((value, limit, unit)) = planned.end(ground, &most).into_iter().find(|(value, limit, _)| value > limit)
    else {
        return;
    };
    let text = format!(
        "this drag of {} mm can end with {} {unit}, over the limit of {limit}",
        round(planned.way_mm, 3),
        round(value, 3)
    );
    let [way, weaker] = planned.largest(ground, &most);
    let way = way.map(|share| format!("drag at most {} mm", floored(share * planned.way_mm)));
    let weaker = weaker.map(|share| match planned.most_n > 0.0 {
        true => format!("press with at most {} N", floored(share * planned.most_n)),
        false => format!("press at most {} mm deep", floored(share * planned.most_mm)),
    });
    let undeclared = (planned.most_n > 0.0 && most.softest_n_mm.is_none()).then(|| {
        "add `stiffness_least_n_mm` to [limits] of the rig: a force then shows how deep the tip can be".to_owned()
    });
    let ways: Vec<String> = undeclared.into_iter().chain(way).chain(weaker).collect();
    let help = if ways.is_empty() { "correct `limits` of the rig".to_owned() } else { ways.join("; or ") };
    complain(text, &help);
}

/// Rounds down to two digits after the decimal point, so that what is proposed passes.
fn floored(value: f64) -> f64 {
    (value * 100.0).floor() / 100.0
}
