//! The plans that recipes come to.

use super::{Checks, Ground, PRESSES_CEILING, PRESSES_MAX, Phase, Plan, Recipe, parse};
use palpate_control::Strategy;
use palpate_core::quantity::{ArrayLayout, Down, Frame, Limits, Place, Range, StageAbilities, Steps, Travel};
use palpate_document::Problems;

fn plan(steps: &str, seed: u64) -> Result<Plan, Vec<String>> {
    plan_with(steps, seed, |recipe| recipe).map_err(|p| p.lines())
}

fn plan_with(steps: &str, seed: u64, change: impl Fn(Recipe) -> Recipe) -> Result<Plan, Problems> {
    let travel = Travel { axes: [Range { min: -12.5, max: 12.5 }; 3] };
    let frame = Frame::level(0.0, 0.3, Down::Minus);
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
        steps: Steps::FINE,
        is_slippery: false,
        abilities: StageAbilities::FULL,
    };
    let recipe = parse("r.toml", &format!("name = \"r\"\n{steps}"))?;
    Plan::new(&change(recipe), &ground, seed)
}

#[test]
fn checks_are_at_the_end_by_default() {
    let read = |line: &str| {
        parse("r.toml", &format!("name = \"r\"\n{line}\n[[step]]\nphase = \"test\"\nunits = \"all\"\nforce_n = 1\n"))
    };
    let checks = |line: &str| read(line).unwrap().checks;
    let words = ["", "checks = \"end\"", "checks = \"between\"", "checks = \"none\""];
    assert_eq!(words.map(checks), [Checks::End, Checks::End, Checks::Between, Checks::None]);
    let refused = read("checks = \"never\"").unwrap_err().lines();
    assert_eq!(refused, ["r.toml:2:10: `checks` is \"never\", expected one of end, between, none"]);
    let step = "name = \"r\"\n[[step]]\nphase = \"check\"\nunits = \"all\"\nforce_n = 1\n";
    assert!(
        parse("r.toml", step).unwrap_err().lines()[0].contains("`phase` is \"check\""),
        "only the program makes them"
    );
}

#[test]
fn the_papers_grid_is_625_points_x_fastest() {
    let text = "[[step]]\nphase = \"calibration\"\nforce_n = 1.0\n\
                grid = { x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 0.5 }\n";
    let plan = plan(text, 1).unwrap();
    assert_eq!(plan.entries.len(), 625);
    assert_eq!(plan.entries[1].place, Place::new(-5.5, -6.0));
    assert_eq!(plan.entries[624].place, Place::new(6.0, 6.0));
    assert_eq!(plan.most_n(), 1.0);
}

/// The numbers of a plan's entries as they are visited.
fn visits(steps: &str) -> Vec<u64> {
    plan(steps, 1).unwrap().entries.iter().map(|entry| entry.press).collect()
}

#[test]
fn interleaved_grid_is_visited_in_four_passes_with_the_same_numbers() {
    let grid = |x_mm: &str| {
        format!(
            "[[step]]\nphase = \"calibration\"\nforce_n = 1.0\n\
             grid = {{ x_mm = {x_mm}, y_mm = [0, 2], spacing_mm = 1, order = \"interleaved\" }}\n"
        )
    };
    let raster = grid("[0, 2]").replace("interleaved", "raster");
    assert_eq!(visits(&raster), [0, 1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(visits(&grid("[0, 2]")), [0, 2, 6, 8, 1, 7, 3, 5, 4]);
    assert_eq!(visits(&grid("[0, 3]")), [0, 2, 8, 10, 1, 3, 9, 11, 4, 6, 5, 7]);
    assert_eq!(visits(&grid("[1, 1]")), [0, 2, 1]);
    // a number means the same place in any order, and counting continues after the step before
    let twice = format!("{raster}{}", grid("[0, 2]"));
    let mut twice = plan(&twice, 1).unwrap().entries;
    twice.sort_by_key(|entry| entry.press);
    assert!(twice.iter().map(|entry| entry.press).eq(0..18));
    assert!((0..9).all(|i| twice[i].place == twice[i + 9].place));
}

#[test]
fn the_repeats_at_a_place_stay_together_in_any_order() {
    let text = "[[step]]\nphase = \"calibration\"\n\
                grid = { x_mm = [0, 1], y_mm = [0, 1], spacing_mm = 0.5, order = \"interleaved\" }\n\
                staircase = { to_n = 1.0, step_n = 0.5, repeats = 2 }\n";
    assert_eq!(visits(text)[..6], [0, 1, 4, 5, 12, 13]);
}

const MAPPED: &str = "[[step]]\nphase = \"calibration\"\nforce_n = 1.0\nstrategy = \"map\"\nhold_s = 1\n\
                      grid = { x_mm = [-2, 2], y_mm = [-1, 2], spacing_mm = 1 }\n";

/// Number, place and force of the presses that teach, which stand in front.
fn learned_contacts(plan: &Plan) -> Vec<(u64, f64, f64, f64)> {
    let learned_contacts = plan.entries.iter().take_while(|entry| entry.phase == Phase::Teach);
    learned_contacts.map(|entry| (entry.press, entry.place.x_mm, entry.place.y_mm, entry.task.most_n())).collect()
}

#[test]
fn plan_with_map_begins_with_five_training_presses() {
    let learned_curve = plan(MAPPED, 1).unwrap();
    // 5 x 4 points; of the two next to the centre, the first
    let expected =
        [(20, -2.0, -1.0, 1.0), (21, 2.0, -1.0, 1.0), (22, -2.0, 2.0, 1.0), (23, 2.0, 2.0, 1.0), (24, 0.0, 0.0, 1.0)];
    assert_eq!(learned_contacts(&learned_curve), expected);
    let interleaved = MAPPED.replace("spacing_mm = 1", "spacing_mm = 1, order = \"interleaved\"");
    assert_eq!(learned_contacts(&plan(&interleaved, 1).unwrap()), expected);
    for learned_contact in &learned_curve.entries[..5] {
        assert_eq!((learned_contact.task.strategy, learned_contact.task.levels.len()), (Strategy::Guarded, 1));
        assert_eq!(
            (learned_contact.task.hold_s, learned_contact.task.sample_s, learned_contact.rest_after_s),
            (0.0, 0.1, 0.0)
        );
    }
    // the ordinary presses there come last
    let visits: Vec<u64> = learned_curve.entries[5..].iter().map(|entry| entry.press).collect();
    assert_eq!(visits, [1, 2, 3, 5, 6, 8, 9, 10, 11, 12, 13, 14, 16, 17, 18, 0, 4, 7, 15, 19]);
    let ordinary = plan(&MAPPED.replace("map", "velocity"), 1).unwrap();
    assert!(ordinary.entries.iter().map(|entry| entry.press).eq(0..20));
    assert!(plan(&MAPPED.replace("calibration", "teach"), 1).unwrap_err()[0].contains("expected one of"));
}

#[test]
fn training_press_uses_the_largest_force_below_the_limit() {
    let harder = "[[step]]\nphase = \"test\"\nforce_n = 1.5\nstrategy = \"map\"\nlist = { places_mm = [[3, 3]] }\n";
    let learned_curve = plan(&format!("{MAPPED}{harder}"), 1).unwrap();
    assert!(learned_contacts(&learned_curve).iter().all(|(.., force_n)| *force_n == 1.5));
    assert_eq!(learned_contacts(&learned_curve)[3], (24, 3.0, 3.0, 1.5), "the box is that of both steps");
    let learned_curve = plan(&format!("{MAPPED}{}", harder.replace("1.5", "2.0")), 1).unwrap();
    assert!(learned_contacts(&learned_curve).iter().all(|(.., force_n)| *force_n == 1.8));
}

#[test]
fn few_presses_and_staircases_have_no_training() {
    let stairs = "[[step]]\nphase = \"characterisation\"\nunits = \"all\"\nstrategy = \"map\"\n\
                  staircase = { to_n = 2.0, step_n = 1.0, repeats = 3 }\n";
    let nine = MAPPED.replace("[-2, 2]", "[0, 2]").replace("[-1, 2]", "[0, 2]");
    assert!(plan(&format!("{stairs}{nine}"), 1).unwrap().entries.iter().map(|entry| entry.press).eq(0..36));
    // guarded steps don't need learning, but each press still has its number
    let guarded = nine.replace("map", "guarded");
    let learned_curve = plan(&format!("{guarded}{stairs}{MAPPED}{guarded}"), 1).unwrap();
    assert_eq!(learned_contacts(&learned_curve)[0], (65, -2.0, -1.0, 1.0));
    let mut numbers: Vec<u64> = learned_curve.entries.iter().map(|entry| entry.press).collect();
    numbers.sort_unstable();
    assert!(numbers.into_iter().eq(0..70));
    // ten presses at one place teach it once
    let here = MAPPED.replace(
        "grid = { x_mm = [-2, 2], y_mm = [-1, 2], spacing_mm = 1 }",
        &format!("list = {{ places_mm = [{}] }}", ["[1, 1]"; 10].join(", ")),
    );
    assert_eq!(learned_contacts(&plan(&here, 1).unwrap()), [(10, 1.0, 1.0, 1.0)]);
}

#[test]
fn a_seed_decides_the_random_points() {
    let text = "[[step]]\nphase = \"test\"\n\
                random = { count = 100, x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], force_n = [0.1, 1.0] }\n";
    assert_eq!(plan(text, 3), plan(text, 3));
    assert_ne!(plan(text, 3), plan(text, 4));
    let drawn = plan(text, 3).unwrap();
    assert!(drawn.entries.iter().all(|e| (0.1..=1.0).contains(&e.task.most_n()) && e.place.x_mm.abs() <= 6.0));
}

#[test]
fn rests_lie_between_the_repeats_at_a_place() {
    let text = "[[step]]\nphase = \"characterisation\"\nunits = [1, 9]\n\
                staircase = { to_n = 2.0, step_n = 0.5, repeats = 2, rest_s = 300.0 }\n";
    let rests: Vec<f64> = plan(text, 1).unwrap().entries.iter().map(|e| e.rest_after_s).collect();
    assert_eq!(rests, [300.0, 0.0, 300.0, 0.0]);
}

#[test]
fn plan_beyond_the_rig_is_refused() {
    let text = "[[step]]\nphase = \"test\"\nforce_n = 2.5\nlist = { places_mm = [[0, 0], [13, 0]] }\n\
                [[step]]\nphase = \"test\"\nforce_n = 1.0\nunits = [10]\n";
    assert_eq!(
        plan(text, 1).unwrap_err(),
        [
            "r.toml:4:11: this step presses with 2.5 N, over the specimen's limit of 2 N",
            "r.toml:5:31: (13, 0) mm is outside the stage's travel: x goes from -12.5 to 12.5 mm",
            "r.toml:9:9: there is no unit 10: the rig's array has 9",
        ]
    );
    let text = "[[step]]\nphase = \"test\"\nforce_n = 1.0\n\
                grid = { x_mm = [-6, 6], y_mm = [-6, 6], spacing_mm = 0.01 }\n";
    assert_eq!(
        plan(text, 1).unwrap_err(),
        ["r.toml:5:8: the plan has 1442401 presses, but at most 100000 are allowed"]
    );
    // more points than can be counted
    let most = format!("r.toml:5:8: the plan has {} presses, but at most 10000000 are allowed", usize::MAX);
    assert_eq!(plan(&text.replace("0.01", "1e-310"), 1).unwrap_err(), [most]);
}

#[test]
fn the_limit_of_presses_can_be_raised_by_name_up_to_a_ceiling() {
    let random = |count: usize| {
        format!(
            "[[step]]\nphase = \"test\"\nforce_n = 1.0\nlist = {{ places_mm = [[0, 0]] }}\n\
             [[step]]\nphase = \"test\"\nforce_n = 1.0\nrandom = {{ count = {count}, x_mm = [0, 1], y_mm = [0, 1] }}\n"
        )
    };
    let allowed = |count, presses_max| plan_with(&random(count), 1, |recipe| recipe.with_presses_max(presses_max));
    let text = |count, presses_max| {
        let problems = allowed(count, presses_max).unwrap_err();
        problems.into_reports().map(|report| (report.to_string(), report.help().unwrap().to_string())).next().unwrap()
    };
    assert_eq!(plan_with(&random(PRESSES_MAX - 1), 1, |recipe| recipe).unwrap().entries.len(), PRESSES_MAX);
    assert_eq!(
        plan(&random(PRESSES_MAX), 1).unwrap_err(),
        ["r.toml:9:10: the plan has 100001 presses, but at most 100000 are allowed"]
    );
    // the hint names a value that passes
    let help = "split the recipe, or add --presses-max 100001";
    assert_eq!(
        text(PRESSES_MAX, PRESSES_MAX),
        ("the plan has 100001 presses, but at most 100000 are allowed".into(), help.into())
    );
    assert_eq!(allowed(PRESSES_MAX, 100_001).unwrap().entries.len(), 100_001);
    assert_eq!(text(9, 9).1, "split the recipe, or add --presses-max 10");
    // and nothing above the ceiling
    let help = "use a coarser `spacing_mm`, or split the recipe";
    for presses_max in [PRESSES_MAX, PRESSES_CEILING, usize::MAX] {
        let over = "the plan has 10000001 presses, but at most 10000000 are allowed".to_owned();
        assert_eq!(text(PRESSES_CEILING, presses_max), (over, help.into()));
    }
}
