//! What the paper's protocol costs on one core, wire protocols and fsync included: `cargo bench`.
//!
//! It measures and prints; it doesn't judge. Wall time depends on the disk by one fsync a press.
#![allow(clippy::print_stdout, reason = "it prints its results")]

use cpu_time::ProcessTime;
use palpate_data::dataset::{Origins, Provenance, RunFacts, RunFolder, Status};
use palpate_data::recipe::{self, Plan};
use palpate_run::rig;
use palpate_run::run::{Cancel, Listener, RunJob, execute};
use std::time::{Duration, Instant};

const RUNS: u64 = 5;
const RIG: &str = include_str!("../rigs/sim.toml");
const RECIPES: [(&str, &str); 2] = [
    ("recipes/paper.toml", include_str!("../recipes/paper.toml")),
    ("recipes/calibrate.toml", include_str!("../recipes/calibrate.toml")),
];

struct SilentBench;

impl Listener for SilentBench {}

struct PaperBenchCost {
    wall: Duration,
    cpu: Duration,
    virtual_s: f64,
    presses: usize,
}

fn main() {
    for (file, text) in RECIPES {
        let mut costs: Vec<PaperBenchCost> = (1..=RUNS).map(|seed| run(file, text, seed)).collect();
        costs.sort_by_key(|cost| cost.wall);
        let PaperBenchCost { wall, cpu, virtual_s, presses } = &costs[costs.len() / 2];
        println!(
            "{file}: {:.2} s wall ({:.2} to {:.2}), {:.2} s CPU, {virtual_s:.0} s of virtual time, {presses} presses: \
             {:.2} ms CPU a press",
            wall.as_secs_f64(),
            costs[0].wall.as_secs_f64(),
            costs[costs.len() - 1].wall.as_secs_f64(),
            cpu.as_secs_f64(),
            cpu.as_secs_f64() * 1e3 / *presses as f64,
        );
    }
    match peak_memory_kb() {
        Some(kb) => println!("peak memory of all of it: {:.0} MB", kb as f64 / 1024.0),
        None => println!("peak memory: this system doesn't tell"),
    }
}

/// One whole run, from the texts to the last table.
fn run(file: &str, text: &str, seed: u64) -> PaperBenchCost {
    let parent = tempfile::tempdir().expect("a folder for the run");
    let (began, cpu_began) = (Instant::now(), ProcessTime::now());
    let recipe = recipe::parse(file, text).expect("the shipped recipe");
    let spec = rig::parse("rigs/sim.toml", RIG, &|_| unreachable!("no map of its own")).expect("the shipped rig");
    let plan = Plan::new(&recipe, &spec.ground(), seed).expect("a plan");
    let facts = RunFacts::new(&plan, true);
    let origins = Origins::new(text.to_owned(), RIG.to_owned(), Vec::new());
    let out = parent.path().join("run");
    let mut folder = RunFolder::create(Some(&out), &origins, facts, Provenance::default(), &spec.array.layout)
        .expect("a run folder");
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().expect("a runtime");
    let cancel = Cancel::default();
    let job = RunJob { plan: &plan, spec: &spec, ledger: &mut folder, cancel: &cancel, shown: &|_| {} };
    let ending = runtime.block_on(execute(job, &mut SilentBench));
    assert!(ending.status() == Status::Complete, "{:?}", ending.text());
    folder.finish(ending.end(String::new(), 0.0)).expect("the tables");
    PaperBenchCost {
        wall: began.elapsed(),
        cpu: cpu_began.elapsed(),
        virtual_s: folder.manifest().virtual_s,
        presses: plan.entries.len(),
    }
}

/// Peak memory of the process, kB, where /proc states it.
fn peak_memory_kb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().trim_end_matches(" kB").parse().ok()
}
