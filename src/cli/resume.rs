//! `palpate resume`.

use super::session::{SessionArgs, carry_out};
use super::summary::{note, print, tell};
use super::which_way::asked_at;
use crate::api::run::{Resumed, resume_with};
use crate::api::{Failure, ResumeOptions};
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  palpate resume runs/paper
  palpate resume runs/paper-3 --after-trip

Devices are identified and three places touched again. The run continues only
if they haven't moved. A complete run stays unchanged.";

/// Continue a run that was stopped
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ResumeArgs {
    #[command(flatten)]
    options: ResumeOptions,
    #[command(flatten)]
    session: SessionArgs,
}

/// Continues from the journal.
pub(super) fn resume(args: &ResumeArgs) -> Result<ExitCode, Failure> {
    let show = if args.session.json { tell } else { print };
    match resume_with(&args.options, &|chosen, rig| show(&chosen.line(rig)), &note)? {
        Resumed::Begun(mut begun) => {
            begun.rig = asked_at(&args.options.manner.confirm, begun.rig);
            carry_out(&mut begun, &args.session)
        }
        Resumed::Complete { is_rebuilt, .. } => {
            let state = if is_rebuilt { "its tables were regenerated" } else { "nothing to do" };
            tell(&format!("{} is complete: {state}\n", args.options.run.display()))?;
            Ok(ExitCode::SUCCESS)
        }
    }
}
