//! Counts the instructions of the program, with callgrind.

use super::feed::{Feed, feed};
use rustix::process::Signal;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};

/// Folder of callgrind's files, which show where the instructions were spent.
pub(super) const FOLDER: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/cost");

/// Longest time of the processor for a run under callgrind, s: about three times what the longest one takes. Callgrind executes some
/// 100 million instructions a second.
const LIMIT_S: u64 = 120;

/// A run of the program.
pub(super) struct Run<'a> {
    pub program: &'a Path,
    pub words: &'a str,
    /// Where it runs.
    pub folder: &'a Path,
    /// The only processor that it uses: with more, `in_parallel` would begin more threads, which are instructions too.
    pub processor: usize,
}

impl Run<'_> {
    /// Number of instructions of all threads together.
    pub(super) fn instructions(&self, name: &str, how: Feed, lines: &[String]) -> Result<f64, String> {
        let file = file(name);
        let _ = std::fs::remove_file(&file); // of an earlier run
        let mut command = Command::new("taskset");
        command.args(["--cpu-list", &self.processor.to_string(), "prlimit", &format!("--cpu={LIMIT_S}")]);
        command.args(["valgrind", "--quiet", "--tool=callgrind"]);
        // threads of which one waits for another take turns in the same order in each run
        command.arg("--fair-sched=yes").arg(format!("--callgrind-out-file={}", file.display()));
        command.arg(self.program).args(self.words.split_whitespace()).current_dir(self.folder);
        command.env("NO_COLOR", "1").env("LC_ALL", "C.UTF-8").env("XDG_STATE_HOME", self.folder);
        let said = self.folder.join(format!("{name}.err"));
        command.stderr(std::fs::File::create(&said).expect("a file can be written"));
        let status = feed(command, how, lines, self.folder, name);
        if !is_expected(status, how) {
            let said = std::fs::read_to_string(&said).unwrap_or_default();
            return Err(match status.signal() {
                Some(signal) if [Signal::XCPU, Signal::KILL].map(Signal::as_raw).contains(&signal) => {
                    format!(
                        "{name} took longer than {LIMIT_S} s of the processor under callgrind (palpate {})",
                        self.words
                    )
                }
                _ => format!("{name}: palpate {}: {status}\n{said}", self.words),
            });
        }
        let text = std::fs::read_to_string(&file).map_err(|error| format!("{name}: {}: {error}", file.display()))?;
        let total = text.lines().find_map(|line| line.strip_prefix("totals: "));
        total.and_then(|count| count.trim().parse().ok()).ok_or_else(|| format!("{}: no totals", file.display()))
    }
}

fn is_expected(status: ExitStatus, how: Feed) -> bool {
    match how {
        Feed::Server { .. } => status.signal() == Some(Signal::TERM.as_raw()),
        Feed::File | Feed::Pipe => status.success(),
    }
}

/// Callgrind's file of a run.
pub(super) fn file(name: &str) -> PathBuf {
    Path::new(FOLDER).join(format!("{name}.callgrind"))
}
