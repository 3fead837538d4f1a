//! What `check` states against the run: whether a plan completes, and how long it takes.

use super::families::shipped_rig;
use palpate_data::recipe::{self, Plan, SeriesScope};
use palpate_run::rig::RigSpec;
use palpate_run::run::rehearse;
use palpate_testing::executions::{Deaths, executed_with, in_parallel, must_be_none};
use palpate_testing::{campaign, shipped, shipped_text};
use std::fs;

/// Largest relative error of the time.
const TIME_OFF_MOST: f64 = 0.1;

/// Presses of a case. The longest shipped plan has 11,000.
const PRESSES_MOST: usize = 2000;

/// Step between the cases, quick and full.
const EVERY: (usize, usize) = (41, 1);

/// A recipe on a rig.
struct Case {
    name: String,
    spec: RigSpec,
    plan: Plan,
}

/// Names of the TOML files of a folder, without their ending.
fn names(folder: &str) -> Vec<String> {
    let files = fs::read_dir(shipped(folder)).expect("a folder").map(|file| file.expect("an entry").path());
    let toml = files.filter(|path| path.extension().is_some_and(|ending| ending == "toml"));
    let mut names: Vec<String> =
        toml.map(|path| path.file_stem().expect("a name").to_str().expect("text").to_owned()).collect();
    names.sort();
    names
}

fn case(rig: &str, recipe: &str) -> Option<Case> {
    let spec = shipped_rig(rig);
    // the readings are no part of this, and need a feature
    let text = shipped_text(recipe).replace("series = \"window\"", "series = \"none\"");
    let recipe_read = recipe::parse(recipe, &text).unwrap_or_else(|problems| panic!("{recipe}: {problems}"));
    // a plan that the rig refuses is no case
    let mut plan = Plan::new(&recipe_read, &spec.ground(), 1).ok()?;
    plan.entries.truncate(PRESSES_MOST);
    Some(Case { name: format!("{recipe} on {rig}"), spec, plan: Plan { series: SeriesScope::None, ..plan } })
}

/// Every recipe of its folder on every rig, and every protocol on its own rig.
fn cases() -> Vec<Case> {
    let (rigs, recipes) = (names("rigs"), names("recipes"));
    let pairs = rigs.iter().flat_map(|rig| recipes.iter().map(move |recipe| (rig, recipe)));
    let mut cases: Vec<Case> = pairs
        .filter_map(|(rig, recipe)| case(&format!("rigs/{rig}.toml"), &format!("recipes/{recipe}.toml")))
        .collect();
    for protocol in fs::read_dir(shipped("recipes/protocols")).expect("a folder") {
        let folder = protocol.expect("an entry").file_name().into_string().expect("text");
        let files = ["rig", "recipe"].map(|name| format!("recipes/protocols/{folder}/{name}.toml"));
        if files.iter().all(|file| shipped(file).exists()) {
            cases.extend(case(&files[0], &files[1]));
        }
    }
    cases
}

#[test]
fn a_rehearsal_ends_as_the_run_does_and_knows_its_time() {
    let only = std::env::var("ONLY").unwrap_or_default();
    let cases: Vec<Case> =
        cases().into_iter().filter(|c| c.name.contains(&only)).step_by(campaign::every(EVERY.0, EVERY.1)).collect();
    let wrong = in_parallel(&cases, |Case { name, spec, plan }| {
        let rehearsal = rehearse(plan, spec).expect("it is simulated");
        let executed = executed_with(spec, plan, Deaths::Ignored, &|_| {});
        let off = rehearsal.total_s() / executed.ending.t_s - 1.0;
        println!(
            "{name}: {} contacts {:.0} s, {:+.1} %, {:?}",
            executed.ledger.contacts().count(),
            executed.ending.t_s,
            100.0 * off,
            rehearsal.early
        );
        println!("{:?}", rehearsal.entries_s.iter().step_by(13).take(20).collect::<Vec<_>>());
        let is_early = executed.ending.status() != palpate_data::dataset::Status::Complete;
        if rehearsal.early.is_some() != is_early {
            return Some(format!(
                "{name}: the run ends with {:?}, the rehearsal {:?}",
                executed.ending.text(),
                rehearsal.early
            ));
        }
        (!is_early && off.abs() > TIME_OFF_MOST).then(|| format!("{name}: {:+.1} % of the time", 100.0 * off))
    });

    must_be_none(&wrong.into_iter().flatten().collect::<Vec<_>>());
}
