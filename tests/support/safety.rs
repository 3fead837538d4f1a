//! Whole runs through the simulated rig, with real drivers and framing, in virtual time. The loop is judged by the scene's true values and
//! not by its load cell.

use super::executions::run_virtually;
use palpate_control::SafetyRule;
use palpate_core::quantity::Axis;
use palpate_data::dataset::{self, Origins, Provenance, RunFacts, RunFolder, Status};
use palpate_data::recipe::{self, Plan};
use palpate_link::time::Instant;
use palpate_run::rig::{self, RigSpec};
use palpate_run::run::{Cancel, Ending, Halt, Listener, RunJob, execute_on};
use palpate_sim::scene::{ContactLaw, SceneSpec};
use std::cell::Cell;

/// Error of the load cell's conversion to whole mN, N.
pub const COUNT_N: f64 = 0.001;

/// Largest distance of z from its parking position, mm: the error of a read-back.
const PARKED_MM: f64 = 0.003;

pub const STAIRCASE: &str = "staircase = { to_n = 2.0, step_n = 0.5, repeats = 1, rest_s = 0.0 }";

fn paper_rig() -> RigSpec {
    rig::parse("sim.toml", include_str!("../../rigs/sim.toml"), &|_| unreachable!()).unwrap()
}

/// The paper's rig with another specimen: no taxels, which only cost time here.
pub fn rig_with(change: impl FnOnce(&mut RigSpec, &mut SceneSpec)) -> RigSpec {
    let mut spec = paper_rig();
    let mut scene = spec.scene.clone();
    scene.skin.noise = None;
    scene.skin.hysteresis_percent = None;
    change(&mut spec, &mut scene);
    spec.scene = scene;
    spec
}

/// A recipe of one step with these places and loads.
pub fn recipe(places: &str, load: &str) -> String {
    format!(
        "name = \"safety\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.2\nsample_s = 0.1\n\
         [[step]]\nphase = \"test\"\nlist = {{ places_mm = {places} }}\n{load}\n"
    )
}

/// A run folder in its own place, and its plan.
pub struct SafetyBench {
    pub spec: RigSpec,
    pub plan: Plan,
    pub folder: RunFolder,
    _home: tempfile::TempDir,
}

/// Result of a run.
pub struct SafetyRun {
    pub ending: Ending,
    /// The largest reading of the load cell, N.
    pub shown_most_n: f64,
    /// Observed forces.
    pub readings: u32,
    pub virtual_s: f64,
    /// Final z in the specimen frame, mm.
    pub z_mm: f64,
}

struct SafetySilent;

impl Listener for SafetySilent {}

impl SafetyBench {
    pub fn new(spec: RigSpec, recipe_text: &str, seed: u64) -> SafetyBench {
        let recipe = recipe::parse("recipe.toml", recipe_text).unwrap_or_else(|p| panic!("{:?}", p.lines()));
        let plan = Plan::new(&recipe, &spec.ground(), seed).unwrap_or_else(|p| panic!("{:?}", p.lines()));
        let home = tempfile::tempdir().unwrap();
        let facts = RunFacts::new(&plan, true);
        let origins = Origins::new(recipe_text.to_owned(), String::new(), Vec::new());
        let (out, session) = (home.path().join("run"), Provenance::default());
        let folder = RunFolder::create(Some(&out), &origins, facts, session, &spec.array.layout).unwrap();
        SafetyBench { spec, plan, folder, _home: home }
    }

    /// Executes the plan; stops at this reading of the force, if any.
    pub fn execute(&mut self, stop_at: Option<u32>) -> SafetyRun {
        let (most, readings, cancel) = (Cell::new(f64::NEG_INFINITY), Cell::new(0), Cancel::default());
        let shown = |force_n: f64| {
            most.set(most.get().max(force_n));
            readings.set(readings.get() + 1);
            if stop_at == Some(readings.get()) {
                cancel.ask();
            }
        };
        if stop_at == Some(0) {
            cancel.ask();
        }
        let SafetyBench { spec, plan, folder, .. } = self;
        let job = RunJob { plan, spec, ledger: folder, cancel: &cancel, shown: &shown };
        let (ending, virtual_s, z_mm) = run_virtually(async {
            let rig = spec.emulators(plan.seed).expect("emulators");
            let (scene, began) = (rig.scene.clone(), Instant::now());
            let rig = spec.open_on(rig).expect("drivers");
            let ending = execute_on(rig, job, &mut SafetySilent).await;
            let virtual_s = began.elapsed().as_secs_f64();
            let (z_mm, _) = scene.lock().expect("the walk is over").axis(Axis::Z, virtual_s);
            (ending, virtual_s, spec.frame.z_from_stage(z_mm))
        });
        SafetyRun { ending, shown_most_n: most.get(), readings: readings.get(), virtual_s, z_mm }
    }

    /// The stage is where no surface can be: the remaining force isn't asked for.
    pub fn assert_parked(&self, executed: &SafetyRun, output: &str) {
        assert!(executed.ending.unparked.is_none(), "{output}: {:?}", executed.ending.text());
        assert!(executed.z_mm <= self.spec.clear_mm() + PARKED_MM, "{output}: z is {} mm", executed.z_mm);
    }

    /// The records in the order of their numbers.
    pub fn contacts(&self) -> impl Iterator<Item = dataset::RecordedContact> {
        self.folder.contacts().unwrap().map(Result::unwrap)
    }

    /// The largest true force and the deepest true indentation of all records.
    pub fn worst(&self) -> (f64, f64) {
        let truths = self.contacts().flat_map(|contact| contact.truth);
        truths.fold((0.0, 0.0), |(n, mm), truth| (truth.force_peak_n.max(n), truth.depth_peak_mm.max(mm)))
    }

    /// The press and the level of each line of `presses.csv`.
    pub fn rows_on_disk(&self) -> Vec<(u64, u64)> {
        let mut table = csv::Reader::from_path(self.folder.path().join("presses.csv")).unwrap();
        let row = |line: csv::StringRecord| (line[0].parse().unwrap(), line[1].parse().unwrap());
        table.records().map(|line| row(line.unwrap())).collect()
    }

    /// Executes a plan that must be completed within every limit, with each level within its tolerance.
    pub fn must_complete(&mut self, output: &str) {
        let executed = self.execute(None);
        assert_eq!(executed.ending.status(), Status::Complete, "{output}: {:?}", executed.ending.text());
        self.assert_parked(&executed, output);
        let (peak_n, depth_mm) = self.worst();
        let limits = self.spec.limits;
        assert!(peak_n <= limits.force_n, "{output}: {peak_n} N");
        assert!(depth_mm <= limits.depth_mm, "{output}: {depth_mm} mm");
        assert_eq!(self.folder.manifest().presses_done, self.plan.entries.len() as u64, "{output}");
        for (entry, contact) in self.plan.entries.iter().zip(self.contacts()) {
            assert_eq!(contact.levels.len(), contact.truth.len(), "{output}: the truth of each level");
            for (row, truth) in contact.levels.iter().zip(&contact.truth) {
                let error_n = truth.force_true_n - row.force_set_n.unwrap();
                assert!(
                    error_n.abs() <= entry.task.force_tolerance_n,
                    "{output}: level {} of press {} off by {error_n} N",
                    row.level,
                    row.press
                );
            }
        }
    }

    /// Executes a plan that must end with a recorded trip and a parked stage.
    pub fn must_trip(&mut self, rules: &[SafetyRule], output: &str) -> SafetyRun {
        let executed = self.execute(None);
        let Some(Halt::Tripped(trip)) = &executed.ending.halt else {
            panic!("{output}: no trip but {:?}", executed.ending.text());
        };
        assert!(rules.contains(&trip.rule), "{output}: {trip}");
        self.assert_parked(&executed, output);
        assert_eq!(executed.ending.status(), Status::Tripped, "{output}");
        assert_eq!(self.folder.manifest().trip.as_ref(), Some(trip), "{output}: the manifest");
        assert!(executed.virtual_s < 120.0, "{output}: {} s", executed.virtual_s);
        executed
    }
}

pub fn linear(n_mm: f64) -> ContactLaw {
    ContactLaw { linear_n_mm: n_mm, quadratic_n_mm2: 0.0, toe_mm: 0.0 }
}

/// An ideal load cell, so that the shown force is the true one.
pub fn truthful(scene: &mut SceneSpec) {
    scene.load_cell = None;
}
