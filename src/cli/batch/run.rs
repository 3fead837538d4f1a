//! `palpate batch run`.

use super::super::notify::Notifier;
use super::super::signals::{First, heed};
use super::super::summary::tell;
use super::desk::Desk;
use super::material::Material;
use crate::api::Failure;
use crate::api::MannerOptions;
use crate::api::labels::label;
use crate::api::provenance::now;
use palpate_run::batch::{BATCH_FORMAT, BatchEvent, BatchFolder, BatchSession, Facts, RIG, beginning};
use palpate_run::rig::{Difference, differences};
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate batch run batch
  palpate batch run monday.toml --operator Ada
  printf 'A-01\\nA-02\\n' | palpate batch run batch --out runs/two --json

The program asks for the next serial number, typed or scanned. A line that begins with
a dot is a command: .repeat [SERIAL], .skip SERIAL, .note TEXT, .status, .end.
The same command continues a batch. Nothing is calibrated again unless .repeat or
`palpate batch retry` allows it; the new run gets a folder of its own: SERIAL-2.

Ctrl-C during a run finishes the press and pauses; a second one stops and ends.";

/// Calibrate the sensors of a batch, one after another
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct BatchRunArgs {
    /// The batch file
    #[arg(value_name = "BATCH")]
    batch_file: PathBuf,
    /// Simulate: replace the rig's links by emulators, in virtual time
    #[arg(long)]
    simulate: bool,
    /// Folder of the batch; it is continued if it exists [default: runs/NAME]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Operator, instead of the batch file's
    #[arg(long, value_name = "NAME", value_parser = label)]
    operator: Option<String>,
    /// Print one JSON line for each event when it is stored on disk
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manner: MannerOptions,
}

/// Creates the batch's folder or continues it, and calibrates the sensors that are typed.
pub(super) fn run(args: &BatchRunArgs) -> Result<ExitCode, Failure> {
    let material = Material::read(&args.batch_file, args.simulate)?;
    args.manner.check(&material.rig)?;
    material.check()?;
    tell(&material.chosen.line(&material.rig))?;
    let operator = args.operator.clone().or_else(|| material.file.operator.clone());
    let path = args.out.clone().unwrap_or_else(|| Path::new("runs").join(&material.file.name));
    let version = env!("CARGO_PKG_VERSION").to_owned();
    let session = BatchSession { at: now(), version, bench: material.bench.clone(), operator: operator.clone() };
    let cancel = heed(First::Pause, Some("stopping"))?;
    let new = |folder: BatchFolder, material: Material| {
        let warned = RefCell::default();
        Desk { folder, material, cancel, operator, json: args.json, warned, notifier: None }
    };
    let mut desk = if path.symlink_metadata().is_err() {
        let first = beginning(facts(&material)?, &material.texts, &material.file.serials, session);
        let folder = BatchFolder::create(&path, &material.file.name, &first).map_err(Failure::batch)?;
        let desk = new(folder, material);
        first.iter().try_for_each(|event| desk.publish(event))?;
        desk
    } else {
        let folder = BatchFolder::open(&path).map_err(Failure::batch)?;
        let mut desk = new(folder, material);
        go_on(&mut desk, session)?;
        desk
    };
    desk.notifier = Notifier::start(desk.material.notified());
    let ended = desk.work(&args.manner);
    let closed = desk.record(&BatchEvent::Closed { at: now() });
    let code = ended?;
    closed.map(|()| code)
}

fn facts(material: &Material) -> Result<Facts, Failure> {
    let file = &material.file;
    Ok(Facts {
        format: BATCH_FORMAT,
        name: file.name.clone(),
        at: now(),
        design: file.design.clone(),
        prior: material.made_from.clone(),
        charted: material.charted()?,
        reference: file.reference.clone(),
        seed: file.seed,
        simulated: material.rig.is_simulated(),
    })
}

/// Continues a batch: checks that it is this one. Only the rig may have changed; the batch then keeps its text too.
fn go_on(desk: &mut Desk, session: BatchSession) -> Result<(), Failure> {
    let (state, material) = (desk.folder.state(), &desk.material);
    let path = desk.folder.path().display();
    let is_rigs = |name: &str| name == RIG || name.starts_with("rig-");
    let kept = |name: &str| state.texts.iter().find(|kept| kept.name == name).map(|kept| &kept.text);
    let all = state.texts.iter().chain(&material.texts).map(|text| text.name.as_str()).filter(|name| !is_rigs(name));
    let now_is = |name: &str| material.texts.iter().find(|text| text.name == name).map(|text| &text.text);
    if let Some(changed) = all.clone().find(|name| kept(name) != now_is(name)) {
        let help = "restore it, or begin another batch with another `name` or --out; `palpate batch add` adds sensors";
        return Err(Failure::usage(miette::miette!(help = help, "{path} was begun with another {changed}")));
    }
    if state.facts.prior != material.made_from {
        let help = "restore it, or begin another batch with another `name` or --out";
        return Err(Failure::usage(miette::miette!(help = help, "{path} was begun with another `prior`")));
    }
    if state.facts.simulated != material.rig.is_simulated() {
        let help = "begin another batch with another --out";
        let was = if state.facts.simulated { "simulated" } else { "measured on a real rig" };
        return Err(Failure::usage(miette::miette!(help = help, "{path} is {was}, and can't be continued otherwise")));
    }
    let rig = now_is(RIG).map_or("", String::as_str);
    let wider: Vec<Difference> = differences(&state.first_rig, rig)
        .map_err(Failure::usage)?
        .into_iter()
        .filter(Difference::is_wider_limit)
        .collect();
    if !wider.is_empty() {
        let each = |d: &Difference| format!("\n  `{}` is {}; the batch began with {}", d.path, d.now, d.before);
        let each: String = wider.iter().map(each).collect();
        let help = "restore them, or begin another batch with another `name` or --out: in a batch, limits may only get stricter";
        return Err(Failure::usage(miette::miette!(help = help, "{path} can't be continued with wider limits:{each}")));
    }
    let texts = material.texts.iter().filter(|text| is_rigs(&text.name) && kept(&text.name) != Some(&text.text));
    let changed: Vec<BatchEvent> = texts.cloned().map(BatchEvent::Text).collect();
    if !changed.is_empty() {
        tell("the rig has changed since the last session: the batch keeps both\n")?;
    }
    desk.record(&BatchEvent::Session(session))?;
    changed.iter().try_for_each(|event| desk.record(event))
}
