//! `palpate retract`.

use super::one_rig::OneRigArgs;
use super::output::OutputArgs;
use super::signals::{First, heed};
use crate::api::Failure;
use crate::api::run::block_on;
use palpate_run::run::{Retracted, retract};
use serde_json::json;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate retract rigs/esp301.toml
  palpate retract rigs/esp301.toml --confirmed down

Use this command after the program has crashed. It stops the stage, and moves z to the
end away from the specimen. x and y don't move. The load cell is read if it answers, and
a force that increases stops the stage.";

/// Move z away from the specimen, and do nothing else
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct RetractArgs {
    #[command(flatten)]
    rig: OneRigArgs,
    #[command(flatten)]
    output: OutputArgs,
}

/// Retracts, and prints the position of z.
pub(super) fn retract_rig(args: &RetractArgs) -> Result<ExitCode, Failure> {
    let (_, spec, _) = args.rig.read()?;
    let cancel = heed(First::Stop, Some("stopping"))?;
    let retracted = block_on(spec.is_simulated(), retract(&spec, args.rig.seed, &cancel))?;
    let Retracted { z_mm, load_cell } = retracted.map_err(Failure::halted)?;
    let content = json!({ "z_mm": z_mm, "load_cell_unread": load_cell });
    let read = match load_cell {
        None => "the load cell was read on the way".to_owned(),
        Some(why) => format!("the load cell was not read: {why}"),
    };
    let text = format!("z is at {z_mm:.3} mm of the stage, away from the specimen; {read}\n");
    args.output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
}
