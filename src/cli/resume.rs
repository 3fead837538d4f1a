//! `palpate resume`.

use super::exit::Failure;
use super::provenance::session;
use super::recorded::rig_of;
use super::session::{SessionArgs, carry_out};
use super::sources::{RigArgs, Sources, read_rig_text};
use super::summary;
use super::which_rig::Chosen;
use palpate_data::dataset::{Provenance, RigChange, RunFolder, Status, Texts, files};
use palpate_document::TEXT_MAX_BYTES;
use palpate_run::rig::{Consequence, Difference, differences};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate resume runs/paper
  palpate resume runs/paper-3 --after-trip

The devices are identified again, and three places are touched again: the run
continues only if they haven't moved. An interrupted staircase is repeated
from its start. A complete run is not changed.";

/// Continue a run that was stopped
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ResumeArgs {
    /// The run folder
    run: PathBuf,
    /// Continue with this rig: links and commands of processes may differ, limits may be tighter
    #[arg(long, value_name = "RIG")]
    rig: Option<PathBuf>,
    /// Continue after a safety trip, once you have found its cause
    #[arg(long)]
    after_trip: bool,
    #[command(flatten)]
    session: SessionArgs,
}

/// Continues from the journal.
pub(super) fn resume(args: &ResumeArgs) -> Result<ExitCode, Failure> {
    let (manifest, texts) = Texts::read(&args.run).map_err(Failure::dataset)?;
    let facts = manifest.facts;
    let rig_path = args.rig.clone().unwrap_or_else(|| args.run.join("rig.toml"));
    let rig = RigArgs {
        rig: args.rig.clone(),
        simulate: facts.simulated,
        seed: facts.seed,
        strategy: facts.strategy,
        presses_max: facts.presses_max,
    };
    if facts.imported.is_some() {
        let help = "an imported run is complete: `palpate import` makes a new one";
        return Err(Failure::usage(miette::miette!(help = help, "{} was imported, not measured", args.run.display())));
    }
    rig_of(&args.run, &texts)?; // reports best that the journal has lost its beginning
    let rig_text = rig_text(args, &texts)?;
    let changes = changes(&rig_path, &texts, &rig_text)?;
    let mut sources = Sources::of_run(&args.run, &texts, &rig, Chosen::of_run(rig_path, rig_text.clone()))?;
    sources.rig.scene.specimen = facts.specimen;
    let plan = sources.plan(facts.seed)?;
    args.session.manner.check(&sources.rig)?;
    let mut folder = RunFolder::open(&args.run, &sources.rig.array.layout).map_err(Failure::dataset)?;
    if folder.manifest().status == Status::Tripped && !args.after_trip {
        let trip = folder.manifest().trip.as_ref().map(|trip| trip.to_string()).unwrap_or_default();
        let help = "find the cause; then add --after-trip";
        return Err(Failure::usage(miette::miette!(help = help, "the run ended with a safety trip: {trip}")));
    }
    if folder.manifest().status == Status::Complete {
        let is_finished = folder.is_finished().map_err(Failure::dataset)?;
        if !is_finished {
            folder.rebuild().map_err(Failure::dataset)?;
        }
        let state = if is_finished { "nothing to do" } else { "its tables were regenerated" };
        summary::tell(&format!("{} is complete: {state}\n", args.run.display()))?;
        return Ok(ExitCode::SUCCESS);
    }
    let show = if args.session.json { summary::tell } else { summary::print };
    show(&sources.chosen.line(&sources.rig))?;
    for RigChange { key, before, now } in &changes {
        summary::tell(&format!("rig: `{key}` is {now} (it was {before} when the run began)\n"))?;
    }
    let session = Provenance { changes, ..session(args.session.manner.durability.into()) };
    folder.go_on(session, &rig_text).map_err(Failure::dataset)?;
    carry_out(&plan, &sources.rig, &mut folder, &sources.recipe, &args.session)
}

/// Returns the text of the rig to continue with: the named one, that of the folder, or the one stored in the journal.
fn rig_text(args: &ResumeArgs, texts: &Texts) -> Result<String, Failure> {
    if let Some(rig) = &args.rig {
        return read_rig_text(rig);
    }
    let path = args.run.join("rig.toml");
    match files::read_text(&path, TEXT_MAX_BYTES as u64) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(texts.rig().to_owned()),
        Err(error) => Err(Failure::usage(miette::miette!("{}: {error}", path.display()))),
        Ok(text) => Ok(text),
    }
}

/// Returns the differences from the rig with which the run began. Links, commands and tighter limits may differ. Any other
/// difference is refused, with its name.
fn changes(path: &Path, texts: &Texts, now: &str) -> Result<Vec<RigChange>, Failure> {
    let found = differences(texts.first_rig(), now).map_err(Failure::usage)?;
    let (refused, allowed): (Vec<Difference>, Vec<Difference>) =
        found.into_iter().partition(|difference| difference.verdict == Consequence::Other);
    if refused.is_empty() {
        return Ok(allowed.into_iter().map(|d| RigChange { key: d.path, before: d.before, now: d.now }).collect());
    }
    let each = |d: &Difference| format!("\n  `{}` is {}; the run began with {}", d.path, d.now, d.before);
    let each: String = refused.iter().map(each).collect();
    let help = "restore the values, or start a new run: only links, commands of processes and tighter limits may \
                change";
    Err(Failure::usage(miette::miette!(help = help, "{} isn't the rig that the run began with:{each}", path.display())))
}
