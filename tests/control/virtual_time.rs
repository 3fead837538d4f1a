//! Shipped recipes on shipped rigs: virtual time and tokio's paused clock give the same presses, to the last bit.

use palpate_data::dataset::{Memory, RecordedContact};
use palpate_link::time::run_virtually;
use palpate_run::rig;
use palpate_run::run::{Cancel, Listener, RunJob, execute};
use palpate_testing::executions::{in_parallel, in_tokios_virtual_time};
use palpate_testing::{campaign, shipped_text};

/// Presses of a recipe that are made in the quick tier.
const QUICK: usize = 6;

const RECIPES: [&str; 6] = ["paper", "calibrate", "characterise", "test", "bench", "batch"];
const RIGS: [&str; 14] = [
    "sim",
    "paper",
    "bench-esp301",
    "bench-fast",
    "esp301",
    "xps",
    "grbl",
    "marlin",
    "klipper",
    "ur",
    "matrix",
    "process",
    "printer",
    "batch",
];

struct VirtualTimeDeaf;

impl Listener for VirtualTimeDeaf {}

#[test]
fn presses_equal_those_under_tokios_paused_clock() {
    // in the quick tier, each recipe on the simulated rig, and one recipe on each rig
    let is_quick = campaign::is_quick();
    let pairs = RIGS.into_iter().flat_map(|rig| RECIPES.map(|recipe| (rig, recipe)));
    let tried = |(rig, recipe): &(&str, &str)| !is_quick || *rig == "sim" || *recipe == "test";
    let pairs: Vec<(&str, &str)> = pairs.filter(tried).collect();
    let made = in_parallel(&pairs, |(rig, recipe)| (contacts(rig, recipe, true), contacts(rig, recipe, false)));
    for ((rig, recipe), (ours, tokios)) in pairs.iter().zip(made) {
        assert_eq!(ours, tokios, "{recipe} on {rig}");
    }
}

/// Makes the first presses of a recipe on a simulated rig, or none if the recipe exceeds the rig's limits.
fn contacts(rig: &str, recipe: &str, ours: bool) -> Vec<String> {
    let beside = |name: &str| Ok(shipped_text(&format!("rigs/{name}")));
    let spec = rig::parse(rig, &shipped_text(&format!("rigs/{rig}.toml")), &beside).expect("a shipped rig").simulated();
    let recipe =
        palpate_data::recipe::parse(recipe, &shipped_text(&format!("recipes/{recipe}.toml"))).expect("a recipe");
    let Ok(mut plan) = palpate_data::recipe::Plan::new(&recipe, &spec.ground(), 3) else { return Vec::new() };
    plan.entries.truncate(campaign::size(QUICK, plan.entries.len().min(120)));
    let (mut memory, cancel) = (Memory::default(), Cancel::default());
    let job = RunJob { plan: &plan, spec: &spec, ledger: &mut memory, cancel: &cancel, shown: &|_| {} };
    let mut deaf = VirtualTimeDeaf;
    let execute = execute(job, &mut deaf);
    let ending = if ours { run_virtually(execute) } else { in_tokios_virtual_time(execute) };
    let output = [format!("{:?} {} s", ending.text(), ending.t_s)].into_iter();
    output.chain(memory.contacts().map(|contact: &RecordedContact| format!("{contact:?}"))).collect()
}
