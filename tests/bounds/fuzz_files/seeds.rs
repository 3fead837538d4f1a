//! Inputs for mutation: the project's own texts, and the files of a small run.

use palpate_data::dataset::{Origins, Provenance, RunFacts, RunFolder};
use palpate_data::recipe::{self, Plan};
use palpate_run::rig::{self, RigSpec, SIM_RIG};
use palpate_run::run::{Cancel, Listener, RunJob, execute};
use std::fs;
use std::path::PathBuf;
use std::sync::OnceLock;

/// A small run, whose files are mutated.
const SMALL: &str = "name = \"small\"\n[[step]]\nphase = \"characterisation\"\nunits = [5]\n\
                     staircase = { to_n = 1.0, step_n = 1.0, repeats = 1 }\n[[step]]\nphase = \"test\"\n\
                     random = { count = 2, x_mm = [-2, 2], y_mm = [-2, 2], force_n = [0.5, 1] }\n";

/// The files of a run.
pub(super) struct Run {
    pub journal: Vec<u8>,
    pub presses: Vec<u8>,
    pub manifest: Vec<u8>,
}

/// The folder of a small run.
pub(super) fn run() -> &'static Run {
    static RUN: OnceLock<Run> = OnceLock::new();
    RUN.get_or_init(|| {
        let spec = sim_rig();
        let home = tempfile::tempdir().expect("a folder");
        let recipe = recipe::parse("small.toml", SMALL).expect("a recipe");
        let plan = Plan::new(&recipe, &spec.ground(), 1).expect("a plan");
        let origins = Origins::new(SMALL.to_owned(), SIM_RIG.to_owned(), Vec::new());
        let (facts, path) = (RunFacts::new(&plan, true), home.path().join("run"));
        let mut folder =
            RunFolder::create(Some(&path), &origins, facts, Provenance::default(), &spec.array.layout).expect("a run");
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build();
        let ending = runtime.expect("a runtime").block_on(async {
            let cancel = Cancel::default();
            let job = RunJob { plan: &plan, spec: &spec, ledger: &mut folder, cancel: &cancel, shown: &|_| {} };
            execute(job, &mut Unheard).await
        });
        folder.finish(ending.end(String::new(), 0.0)).expect("a run that ends");
        let [journal, presses, manifest] =
            ["journal.log", "presses.csv", "manifest.json"].map(|name| fs::read(path.join(name)).expect(name));
        Run { journal, presses, manifest }
    })
}

struct Unheard;

impl Listener for Unheard {}

pub(super) fn sim_rig() -> RigSpec {
    rig::parse("sim.toml", SIM_RIG, &|_| unreachable!("no map of its own")).expect("the shipped rig")
}

/// All texts of a kind in one of the project's folders, in order of their names.
pub(super) fn texts_in(folder: &str, extension: &str) -> Vec<Vec<u8>> {
    let entries = fs::read_dir(root().join(folder)).expect("a folder of the project");
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("a file").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|own| own == extension));
    paths.sort();
    paths.iter().map(|path| fs::read(path).expect("a text")).collect()
}

pub(super) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}
