//! `palpate demo`: the paper's recipe on the simulated rig, with its page in the browser.

use super::exit::Failure;
use super::report::{ReportArgs, report};
use super::run::{RunArgs, recorded};
use super::summary::tell;
use palpate_data::dataset::Status;
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

/// The recipe, and what keeps a file of that name from moving a real rig.
const WORDS: [&str; 2] = ["recipes/paper.toml", "--simulate"];

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
    let mut run: RunArgs = parsed(WORDS)?;
    run.out.clone_from(&args.out);
    run.session.is_reported = true;
    let (folder, code) = recorded(&run)?;
    if folder.manifest().status != Status::Complete {
        return Ok(code);
    }
    let path = folder.path();
    report(&parsed::<ReportArgs>([OsStr::new("--"), path.as_os_str()])?)?;
    if !args.no_open
        && let Err(why) = open(&path.join("report.html"))
    {
        tell(&format!("note: the page wasn't opened: {}: {why}\n", OPENER[0]))?;
    }
    Ok(code)
}

/// Returns the arguments of another command.
fn parsed<A: clap::Args>(words: [impl AsRef<OsStr>; 2]) -> Result<A, Failure> {
    let command = A::augment_args(clap::Command::new("palpate").no_binary_name(true));
    let matches = command.try_get_matches_from(words.iter().map(AsRef::as_ref));
    matches
        .and_then(|matches| A::from_arg_matches(&matches))
        .map_err(|error| Failure::usage(miette::miette!("{error}")))
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
