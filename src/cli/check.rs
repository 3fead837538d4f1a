use super::exit::Failure;
use super::sources::{RigArgs, Sources};
use super::summary::{duration, print};
use crate::recipe::{Entry, Phase, Plan};
use crate::rig::RigSpec;
use crate::run::estimated_s;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate check recipes/paper.toml
  palpate check recipes/test.toml --rig rigs/esp301.toml --seed 7
  palpate check recipes/bench.toml --strategy guarded

Exit code: 0 the recipe can be run, 2 it can't: every problem is told at its line.";

/// Print what a recipe would do on a rig, without moving anything
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// The recipe
    recipe: PathBuf,
    #[command(flatten)]
    rig: RigArgs,
}

/// Checks and prints the plan.
pub fn check(args: &Args) -> Result<ExitCode, Failure> {
    let sources = Sources::read(&args.recipe, &args.rig)?;
    let plan = sources.plan(args.rig.seed)?;
    print(&described(&plan, &sources.rig))?;
    Ok(ExitCode::SUCCESS)
}

fn described(plan: &Plan, rig: &RigSpec) -> String {
    let mut text = String::new();
    let [x, y] = plan.envelope();
    let travel = &rig.stage.travel.axes;
    // writing to a string can't fail
    let _ = writeln!(text, "plan {}, seed {}", plan.name, plan.seed);
    let _ = writeln!(text, "  {:<18}{:>8}{:>8}   estimated", "phase", "presses", "levels");
    for phase in [Phase::Teach, Phase::Characterisation, Phase::Calibration, Phase::Test] {
        let part: Vec<Entry> = plan.entries.iter().filter(|entry| entry.phase == phase).cloned().collect();
        if !part.is_empty() {
            let _ = writeln!(text, "{}", counted(phase.name(), &part, rig));
        }
    }
    let _ = writeln!(text, "{}", counted("together", &plan.entries, rig));
    let _ = writeln!(text, "held against the rig");
    let _ = writeln!(text, "  x {:>7.3} to {:>6.3} mm, travel {} to {} mm", x.min, x.max, travel[0].min, travel[0].max);
    let _ = writeln!(text, "  y {:>7.3} to {:>6.3} mm, travel {} to {} mm", y.min, y.max, travel[1].min, travel[1].max);
    let limits = &rig.limits;
    let _ = writeln!(text, "  largest force {} N, limit {} N", plan.most_n(), limits.force_n);
    let _ =
        writeln!(text, "  depth at most {} mm; every move is held to {} N/mm", limits.depth_mm, limits.stiffness_n_mm);
    let links = if rig.is_simulated() { "simulated, in virtual time" } else { "real, in real time" };
    let _ = writeln!(text, "  links: {links}");
    text
}

/// One line of the plan: how many presses and levels, and how long they should take.
fn counted(name: &str, entries: &[Entry], rig: &RigSpec) -> String {
    let levels: usize = entries.iter().map(|entry| entry.task.levels.len()).sum();
    format!("  {name:<18}{:>8}{levels:>8}   {}", entries.len(), duration(estimated_s(entries, rig)))
}
