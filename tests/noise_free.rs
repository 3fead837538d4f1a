//! The golden end-to-end set through the whole house: with nothing but the half-space in the scene, 625 calibration presses
//! and the 100 deterministic test points come back over the wire protocols with the location error computed apart.

use palpate::dataset::evaluate::evaluate_run;
use palpate::dataset::table::Table;
use palpate::dataset::{Manifest, Origins, RunFolder, Status};
use palpate::recipe::{self, Plan};
use palpate::rig::{self, SIM_RIG};
use palpate::run::{Cancel, Errand, Watcher, walk};

struct Silent;

impl Watcher for Silent {}

/// The shipped rig with only the cover and the contact in its scene.
fn quiet_rig() -> String {
    let (rig, scene) = SIM_RIG.split_once("[scene]").unwrap();
    let kept = |line: &&str| line.starts_with("elastomer") || line.starts_with("contact");
    let scene: Vec<&str> = scene.lines().filter(kept).collect();
    assert_eq!(scene.len(), 2);
    format!("{rig}[scene]\n{}\n", scene.join("\n"))
}

/// x = -6 + 12 frac(.754877666 i), y = -6 + 12 frac(.569840291 i), i = 1..100.
fn recipe() -> String {
    let along = |step: f64, i: u32| -6.0 + 12.0 * (step * f64::from(i)).fract();
    let points = (1..=100).map(|i| format!("[{}, {}]", along(0.754877666, i), along(0.569840291, i)));
    format!(
        "name = \"golden\"\n[[step]]\nphase = \"calibration\"\nforce_n = 1.0\n\
         grid = {{ x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], spacing_mm = 0.5 }}\n\
         [[step]]\nphase = \"test\"\nforce_n = 1.0\nlist = {{ places_mm = [{}] }}\n",
        points.collect::<Vec<_>>().join(", ")
    )
}

#[test]
fn the_golden_location_error_comes_back_over_the_wire() {
    let (rig_text, recipe_text) = (quiet_rig(), recipe());
    let spec = rig::parse("rig.toml", &rig_text, &|_| unreachable!()).unwrap();
    let recipe = recipe::parse("recipe.toml", &recipe_text).unwrap();
    let plan = Plan::new(&recipe, &spec.ground(), 1).unwrap();
    let parent = tempfile::tempdir().unwrap();
    let out = parent.path().join("run");
    let origins = Origins { recipe: recipe_text, rig: rig_text, maps: Vec::new() };
    let manifest = Manifest::new(&plan, true, None, String::new());
    let mut folder = RunFolder::create(Some(&out), &origins, manifest, &spec.array.layout).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().start_paused(true).build().unwrap();
    let cancel = Cancel::default();
    let errand = Errand { plan: &plan, spec: &spec, folder: &mut folder, cancel: &cancel, shown: &|_| {} };
    let ending = runtime.block_on(walk(errand, &mut Silent));
    assert_eq!(ending.status(), Status::Complete, "{:?}", ending.told());
    folder.finish(Status::Complete).unwrap();

    let table = Table::read_run(&out.join("presses.csv")).unwrap();
    let evaluation = evaluate_run(&table, Some(&spec.array.layout), "pearson").unwrap();
    assert_eq!(evaluation.points, 100);
    let error_mm = evaluation.location_error_mm;
    // places are recorded to a nanometre
    assert!((error_mm.mean - 0.207937677).abs() < 1e-6, "{error_mm:?}");
    assert!((error_mm.max - 0.511031).abs() < 2e-6, "{error_mm:?}");
}
