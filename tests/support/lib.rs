//! Shared by the integration tests: the program in a folder of its own, and its output.

pub mod alone;
pub mod bad_line;
pub mod batches;
pub mod book;
pub mod campaign;
pub mod certified;
pub mod characteristics;
pub mod executions;
pub mod interrupted;
pub mod mutation;
pub mod observed;
pub mod phases;
pub mod printed;
pub mod python;
pub mod rows;
pub mod safety;
pub mod served;
pub mod skins;
#[cfg(unix)]
pub mod terminal;
pub mod twins;
pub mod vectors;
pub mod wire;

use palpate_link::device::{DeviceError, Identity, MotionOrders, Stage, StageUse};
use serde_json::Value;
use std::env;
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;
use tempfile::TempDir;

/// A small recipe with every kind of step: 1 staircase of 5 levels, 4 points of a grid, 2 random ones.
pub const SMALL: &str = r#"rig = "sim"
name = "small"

[press]
force_tolerance_n = 0.05

[[step]]
phase = "characterisation"
units = [5]
staircase = { to_n = 2.0, step_n = 1.0, repeats = 1 }

[[step]]
phase = "calibration"
grid = { x_mm = [-2.0, 2.0], y_mm = [-2.0, 2.0], spacing_mm = 4.0 }
force_n = 1.0

[[step]]
phase = "test"
random = { count = 2, x_mm = [-2.0, 2.0], y_mm = [-2.0, 2.0], force_n = [0.5, 1.0] }
"#;

/// Number of rows of `presses.csv` for [`SMALL`], and of entries of its plan.
pub const SMALL_ROWS: usize = 11;
pub const SMALL_PRESSES: u64 = 7;

/// A stage that is identified and homed.
pub async fn made_ready(
    stage: &mut impl Stage,
    usage: &StageUse,
    orders: &MotionOrders,
) -> Result<Identity, DeviceError> {
    let identity = stage.identify(usage).await?;
    stage.home(usage, orders).await.map(|()| identity)
}

/// A recipe that is long enough to be interrupted: 2 staircases of 5 levels, 9 points of a grid.
pub const LONG: &str = r#"rig = "sim"
name = "long"

[[step]]
phase = "characterisation"
units = [1, 5]
staircase = { to_n = 2.0, step_n = 1.0 }

[[step]]
phase = "calibration"
grid = { x_mm = [-2.0, 2.0], y_mm = [-2.0, 2.0], spacing_mm = 2.0 }
force_n = 1.0
"#;
pub const LONG_PRESSES: u64 = 11;

/// A folder for the program, which is removed at the end.
pub struct TestFolder {
    folder: TempDir,
}

/// Exit and output of the program.
#[derive(Debug)]
pub struct CommandOutput {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl TestFolder {
    #[allow(clippy::new_without_default)] // it creates a folder
    pub fn new() -> TestFolder {
        TestFolder { folder: tempfile::tempdir().expect("a temporary folder") }
    }

    /// A folder with files: name and text.
    pub fn with<'a>(files: impl IntoIterator<Item = (&'a str, &'a str)>) -> TestFolder {
        let bench = TestFolder::new();
        for (name, text) in files {
            bench.write(name, text);
        }
        bench
    }

    pub fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).expect("a file can be written");
    }

    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn has(&self, name: &str) -> bool {
        self.path(name).symlink_metadata().is_ok()
    }

    /// The program with some words, separated by blanks, in this folder.
    pub fn command(&self, words: &str) -> Command {
        let mut command = Command::new(program());
        command.args(words.split_whitespace()).current_dir(self.folder.path()).stdin(Stdio::null());
        // messages are pinned as they look without colour on a terminal that knows Unicode
        command.env("NO_COLOR", "1").env("LC_ALL", "C.UTF-8").env_remove("FORCE_COLOR").env_remove("CLICOLOR_FORCE");
        command.env("TERM", "xterm"); // a bar is drawn if a test gives the program a terminal
        command.env("XDG_STATE_HOME", self.folder.path()); // this user's confirmations don't count here
        command
    }

    /// Runs the program to its end.
    pub fn palpate(&self, words: &str) -> CommandOutput {
        self.command(words).output().expect("the program starts").into()
    }

    /// The same, with a text as standard input.
    pub fn palpate_reads(&self, words: &str, input: &str) -> CommandOutput {
        self.write("standard-input", input);
        let input = fs::File::open(self.path("standard-input")).expect("what was written");
        self.command(words).stdin(input).output().expect("the program starts").into()
    }

    /// The same, with the expected exit code.
    pub fn palpate_ends(&self, code: i32, words: &str) -> CommandOutput {
        let output = self.palpate(words);
        assert_eq!(output.code, Some(code), "palpate {words}\n{}\n{}", output.out, output.err);
        output
    }

    pub fn manifest(&self, run: &str) -> Value {
        serde_json::from_str(&self.read(&format!("{run}/manifest.json"))).expect("a manifest is JSON")
    }

    /// A table's header and rows.
    pub fn table(&self, name: &str) -> (Vec<String>, Vec<Vec<String>>) {
        let text = self.read(name);
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let cells = |record: &csv::StringRecord| record.iter().map(str::to_owned).collect::<Vec<String>>();
        let header = cells(reader.headers().expect("a header"));
        (header, reader.records().map(|record| cells(&record.expect("a row"))).collect())
    }

    /// One column of a table.
    pub fn column(&self, name: &str, column: &str) -> Vec<String> {
        let (header, rows) = self.table(name);
        let index = header.iter().position(|name| name == column).unwrap_or_else(|| panic!("no {column} in {name}"));
        rows.into_iter().map(|mut row| row.swap_remove(index)).collect()
    }

    /// Each file of a folder with its bytes, by name.
    pub fn bytes(&self, folder: &str) -> Vec<(String, Vec<u8>)> {
        let entries = fs::read_dir(self.path(folder)).expect("a folder").map(|entry| entry.expect("an entry").path());
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut files: Vec<_> = entries.map(|path| (name(&path), fs::read(&path).expect("a file"))).collect();
        files.sort();
        files
    }
}

impl From<Output> for CommandOutput {
    fn from(output: Output) -> CommandOutput {
        let text = |bytes| String::from_utf8(bytes).expect("the program speaks UTF-8");
        CommandOutput { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }
}

impl CommandOutput {
    /// Standard error as running text: no frame, no line breaks.
    pub fn running(&self) -> String {
        self.err.replace(['│', '·'], " ").split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// Each line of standard output as JSON.
    pub fn json_lines(&self) -> Vec<Value> {
        let line = |line: &str| serde_json::from_str(line).unwrap_or_else(|error| panic!("{line}: {error}"));
        self.out.lines().map(line).collect()
    }
}

/// The program, which cargo has put next to the folder of the running test.
///
/// # Panics The program is missing: the test isn't one of its package.
pub fn program() -> PathBuf {
    let test = env::current_exe().expect("this test has a path");
    let folder = test.ancestors().nth(2).expect("a test is in a folder of the target folder");
    let program = folder.join(format!("palpate{}", env::consts::EXE_SUFFIX));
    assert!(program.is_file(), "{} isn't there: `cargo build` makes it", program.display());
    program
}

/// A shipped file, by its path in the project.
pub fn shipped(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

/// Its text.
pub fn shipped_text(path: &str) -> String {
    fs::read_to_string(shipped(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The text with one part replaced, which must exist.
pub fn exchanged(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from:?} isn't in\n{text}");
    text.replacen(from, to, 1)
}

/// A shared library from one of the project's C files, built with additional options.
pub fn shared_library(bench: &TestFolder, name: &str, source: &str, words: &[&str]) -> PathBuf {
    let path = bench.path(name);
    let mut compiler = Command::new("cc");
    compiler.args(["-std=gnu11", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC", "-o"]);
    let output = there(compiler.arg(&path).arg(shipped(source)).args(words), "a C compiler that is called cc");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    path
}

/// Output of another program, which must exist; `install` states its package.
pub fn there(command: &mut Command, install: &str) -> Output {
    command.output().unwrap_or_else(|error| panic!("{command:?}: {error}. Install {install}"))
}

/// Longest wait for the next line of a running program: many times the usual, and an end for one that hangs.
const PATIENCE: Duration = Duration::from_secs(20);

/// A running program, killed if the test ends first.
pub struct Live {
    child: Child,
    out: Receiver<String>,
    err: Receiver<String>,
}

impl Live {
    pub fn start(mut command: Command) -> Live {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts");
        let (out, err) = (lines(child.stdout.take()), lines(child.stderr.take()));
        Live { child, out, err }
    }

    /// The next line on standard output; none at its end.
    pub fn line(&self) -> Option<String> {
        next(&self.out)
    }

    /// The same if it comes within this time.
    pub fn line_within(&self, patience: Duration) -> Result<String, RecvTimeoutError> {
        self.out.recv_timeout(patience)
    }

    /// Waits for a line on standard error that contains some words.
    pub fn until_printed(&self, words: &str) {
        while !next(&self.err).unwrap_or_else(|| panic!("it ended before it said {words:?}")).contains(words) {}
    }

    /// Its process number.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal: `INT`, `TERM`, `KILL`.
    #[cfg(unix)]
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill").arg(format!("-{name}")).arg(self.child.id().to_string()).status();
        assert!(sent.expect("kill starts").success(), "kill -{name}");
    }

    /// Kills it at once; one that has ended keeps its exit.
    pub fn kill(&mut self) {
        // its only error is that it has ended
        let _ = self.child.kill();
    }

    /// Its end, and its output since the last read.
    pub fn end(self) -> CommandOutput {
        self.end_within(PATIENCE)
    }

    /// The same for one that may be silent for longer.
    pub fn end_within(mut self, patience: Duration) -> CommandOutput {
        let rest = |lines: &Receiver<String>| {
            std::iter::from_fn(|| next_within(lines, patience)).map(|line| line + "\n").collect()
        };
        let (out, err) = (rest(&self.out), rest(&self.err));
        CommandOutput { code: self.child.wait().expect("it can be waited for").code(), out, err }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

fn lines(stream: Option<impl Read + Send + 'static>) -> Receiver<String> {
    let (sender, receiver) = channel();
    let stream = BufReader::new(stream.expect("piped"));
    thread::spawn(move || stream.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
    receiver
}

fn next(lines: &Receiver<String>) -> Option<String> {
    next_within(lines, PATIENCE)
}

fn next_within(lines: &Receiver<String>, patience: Duration) -> Option<String> {
    match lines.recv_timeout(patience) {
        Ok(line) => Some(line),
        Err(RecvTimeoutError::Disconnected) => None,
        Err(RecvTimeoutError::Timeout) => panic!("no line within {} s", patience.as_secs()),
    }
}
