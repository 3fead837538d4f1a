//! `palpate demo`: the paper's recipe on the simulated rig, with its page in the browser.

use super::output::OutputArgs;
use super::report::{ReportArgs, report};
use super::run::{RunArgs, recorded};
use super::session::SessionArgs;
use super::summary::tell;
use crate::api::{Failure, ReportOptions, RigOptions, RunOptions};
use palpate_data::dataset::Status;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

/// The recipe.
const PAPER: &str = "recipes/paper.toml";

/// The system's program that opens a file as a double click does, with its words.
#[cfg(windows)]
const OPENER: &[&str] = &["cmd", "/C", "start", ""];
#[cfg(target_os = "macos")]
const OPENER: &[&str] = &["open"];
#[cfg(not(any(windows, target_os = "macos")))]
const OPENER: &[&str] = &["xdg-open"];

/// Longest wait for the opener's failure. One that runs longer has opened the page.
const PATIENCE: Duration = Duration::from_secs(10);

const EXAMPLES: &str = "\
Examples:
  palpate demo
  palpate demo --out first --no-open

It is `palpate run paper` and `palpate report`. No device is needed. A page that
can't be opened is only a note.";

/// Run the paper's recipe on the simulated rig and open its page in the browser
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct DemoArgs {
    /// Output folder [default: runs/paper, runs/paper-2, ...]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write the page without opening it
    #[arg(long)]
    no_open: bool,
}

/// Runs, reports and opens the page. The exit code is the run's.
pub(super) fn demo(args: &DemoArgs) -> Result<ExitCode, Failure> {
    // simulated, so that a file of the recipe's name moves no real rig
    let rig = RigOptions { simulate: true, ..RigOptions::default() };
    let options = RunOptions { recipe: PAPER.into(), rig, out: args.out.clone(), ..RunOptions::default() };
    let session = SessionArgs { is_reported: true, ..SessionArgs::default() };
    let (folder, code) = recorded(&RunArgs { options, dry_run: false, session })?;
    if folder.manifest().status != Status::Complete {
        return Ok(code);
    }
    let path = folder.path();
    report(&ReportArgs { options: ReportOptions::of(vec![path.to_owned()]), output: OutputArgs { json: false } })?;
    if !args.no_open
        && let Err(why) = open(&path.join("report.html"))
    {
        tell(&format!("note: the page wasn't opened: {}: {why}\n", OPENER[0]))?;
    }
    Ok(code)
}

fn open(page: &Path) -> io::Result<()> {
    let mut command = Command::new(OPENER[0]);
    command.args(&OPENER[1..]).arg(page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn()?;
    let (sender, receiver) = channel();
    thread::spawn(move || sender.send(child.wait()));
    match receiver.recv_timeout(PATIENCE) {
        Ok(Ok(status)) if !status.success() => Err(io::Error::other(status.to_string())),
        Ok(Err(why)) => Err(why),
        _ => Ok(()),
    }
}
