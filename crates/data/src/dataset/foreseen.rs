//! The verdict that a plan could give about a sensor without errors. What isn't decided then isn't decided about any sensor.

use super::acceptance::Evidence;
use super::{Press, Presses};
use crate::acceptance::{AcceptanceRule, Judgement, LimitedFigure, Measured, TestErrors, Worst, judge};
use crate::recipe::{Phase, Plan};
use palpate_core::quantity::ArrayLayout;

/// What a rig knows about the true places and forces of its presses.
pub struct Truths<'a> {
    /// Positions of the array's units.
    pub layout: &'a ArrayLayout,
    /// Standard uncertainty of the pressed places, mm; `None` if it is unknown.
    pub u_place_mm: Option<f64>,
    /// Standard uncertainty of the forces of the test, N; `None` if it is unknown.
    pub u_force_n: Option<f64>,
}

/// Returns the verdict about a sensor whose errors are zero and whose outputs are its forces, without values.
pub fn foreseen(rule: &AcceptanceRule, plan: &Plan, truths: &Truths) -> Judgement {
    let count = |phase: Phase| plan.entries.iter().filter(|entry| entry.phase == phase).count();
    let (calibration_presses, test_presses) = (count(Phase::Calibration), count(Phase::Test));
    let errors =
        |u_truth: Option<f64>| (test_presses > 0).then(|| TestErrors { sizes: vec![0.0; test_presses], u_truth });
    let presses = Presses::new(&plan.name, staircases(plan, truths.layout), Vec::new());
    let evidence = Evidence { presses: &presses, layout: Some(truths.layout), runs: Vec::new(), u_place_mm: None };
    let mut worst = evidence.worst(rule);
    // each press measures the noise without load
    worst.push(Worst { figure: LimitedFigure::Noise, value: 0.0, upper: Some(0.0), n: plan.entries.len(), missing: 0 });
    let measured = Measured {
        calibration_presses,
        test_presses,
        location: errors(truths.u_place_mm),
        force: errors(truths.u_force_n),
        worst,
        broken_outputs: Some(Vec::new()),
        ..Measured::default()
    };
    let mut judgement = judge(rule, &measured);
    for check in &mut judgement.checks {
        (check.value, check.bound) = (None, None); // of no real sensor
    }
    judgement
}

/// Returns the rows of all staircases of a plan, with each force as the output of every unit.
fn staircases(plan: &Plan, layout: &ArrayLayout) -> Vec<Press> {
    let of_phase = plan.entries.iter().filter(|entry| entry.phase == Phase::Characterisation);
    let rows = of_phase.flat_map(|entry| {
        let forces = entry.task.levels.iter().filter_map(|level| level.set.force_n());
        forces.zip(0..).map(move |(force_n, level)| Press {
            press: entry.press,
            level,
            phase: Some(entry.phase),
            x_mm: entry.place.x_mm,
            y_mm: entry.place.y_mm,
            force_set_n: Some(force_n),
            force_n: Some(force_n),
            outputs: vec![force_n; layout.len()],
            ..Press::default()
        })
    });
    rows.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::acceptance::SensorVerdict;
    use crate::recipe::Ground;
    use palpate_core::quantity::{Down, Frame, Limits, Range, StageAbilities, Steps, Travel};

    /// The reasons why a recipe with these steps and this rule can't be decided.
    fn reasons(characterised: &str, tests: usize, rule: &str, u_place_mm: Option<f64>) -> Vec<String> {
        let text = format!(
            "name = \"r\"\n[[step]]\nphase = \"characterisation\"\nunits = {characterised}\n\
             staircase = {{ to_n = 2.0, step_n = 0.5, repeats = 3 }}\n\
             [[step]]\nphase = \"calibration\"\ngrid = {{ x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 1.0 }}\nforce_n = 1.0\n\
             [[step]]\nphase = \"test\"\nrandom = {{ count = {tests}, x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], force_n = [0.5, 1.0] }}\n\
             [accept]\n{rule}\n"
        );
        let recipe = crate::recipe::parse("r.toml", &text).unwrap();
        let frame = Frame::level(0.0, 0.3, Down::Minus);
        let travel = Travel { axes: [Range { min: -12.5, max: 12.5 }; 3] };
        let limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };
        let layout = ArrayLayout::grid(3, 3, 4.5);
        let ground = Ground {
            travel: &travel,
            frame: &frame,
            limits: &limits,
            layout: &layout,
            unforced_mm: None,
            drag: None,
            three_axes: false,
            abilities: StageAbilities::FULL,
            steps: Steps::FINE,
            is_slippery: false,
        };
        let plan = Plan::new(&recipe, &ground, 1).unwrap();
        let truths = Truths { layout: &layout, u_place_mm, u_force_n: Some(0.005) };
        let judgement = foreseen(recipe.rule().unwrap(), &plan, &truths);
        let reasons: Vec<String> = judgement.all_reasons().collect();
        assert_eq!(judgement.verdict == SensorVerdict::Accepted, reasons.is_empty(), "{judgement:?}");
        reasons
    }

    #[test]
    fn plan_that_allows_a_decision_gives_no_reason() {
        let all = "rule = \"guarded\"\nlocation_mean_mm = 1.0\nlocation_p95_mm = 1.0\nforce_mean_n = 0.1\n\
                   repeatability_percent = 5.0\nhysteresis_percent = 5.0\nlinearity_percent = 5.0\nnoise_percent = 1.0\n\
                   broken_channels_most = 0\nflagged_presses_most = 5";
        assert_eq!(reasons("\"all\"", 60, all, Some(0.01)), [""; 0]);
        assert_eq!(reasons("[1]", 10, "location_mean_mm = 1.0", None), [""; 0]);
    }

    #[test]
    fn few_presses_unknown_places_and_units_without_a_staircase_are_reasons() {
        let few = reasons("\"all\"", 50, "rule = \"guarded\"\nlocation_p95_mm = 1.0", Some(0.01));
        assert_eq!(
            few,
            [
                "location error, 95th percentile: 50 test presses; its 95 % bound needs 59 (a simple rule needs no bound)"
            ]
        );
        let unknown = reasons("\"all\"", 60, "rule = \"guarded\"\nlocation_mean_mm = 1.0", None);
        assert!(unknown[0].contains("the uncertainty of the positions isn't known"), "{unknown:?}");
        let some = reasons("[1, 5]", 60, "hysteresis_percent = 5.0", None);
        assert!(some[0].contains("7 units have no value"), "{some:?}");
    }
}
