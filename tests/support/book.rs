//! The examples of the book work: commands are run, recipes and rigs are checked.
//!
//! A block of a page is fenced code whose first line has words after its language:
//!
//! - `console`: each line that begins with `$ ` is run by `sh` and must exit with 0, or as `exit=2` has it
//! - `hardware`: the same for a reader, and not run here
//! - `toml recipe` and `toml rig`: a whole file, checked with `palpate check`; `rig=NAME` names the rig of a recipe, otherwise `sim`
//! - `file=NAME`: the block is that file for the blocks below it
//!
//! All blocks of a page are run in one folder, which has the files of a checkout.
#![cfg(unix)]

use super::{SMALL, TestFolder, shipped, shipped_text};
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Instant;

/// Number of pages that are tried at the same time.
const WORKERS: usize = 4;

/// The pages whose blocks are tried.
pub fn pages() -> Vec<String> {
    let mut pages = vec!["README.md".to_owned()];
    for folder in ["docs/tutorials", "docs/how-to"] {
        let entries = fs::read_dir(shipped(folder)).unwrap_or_else(|error| panic!("{folder}: {error}"));
        pages.extend(entries.map(|entry| format!("{folder}/{}", entry.expect("an entry").file_name().display())));
    }
    pages.sort();
    pages
}

/// Whether a page has a command that needs Python.
pub fn needs_python(page: &str) -> bool {
    let blocks = blocks(&shipped_text(page)).into_iter().filter(|block| block.kind() == "console");
    blocks.flat_map(|block| block.commands()).any(|command| command.contains("python3"))
}

/// Tries all blocks of some pages, and returns the number of commands and of checked files. All must end as stated.
pub fn try_pages(pages: &[String]) -> (usize, usize) {
    let (mut commands, mut files, mut failed) = (0, 0, Vec::new());
    let next = AtomicUsize::new(0);
    let work = || {
        let pages = std::iter::from_fn(|| pages.get(next.fetch_add(1, Ordering::Relaxed)));
        pages.map(|page| try_page(page)).collect::<Vec<_>>()
    };
    let tried = thread::scope(|scope| {
        let workers: Vec<_> = (0..WORKERS).map(|_| scope.spawn(work)).collect();
        let pages = workers.into_iter().flat_map(|worker| worker.join().expect("pages are tried to their end"));
        pages.collect::<Vec<_>>()
    });
    for page in tried {
        (commands, files) = (commands + page.commands, files + page.files);
        failed.extend(page.failed);
    }
    println!("{} pages: {commands} commands run, {files} recipes and rigs checked", pages.len());
    assert!(failed.is_empty(), "{}", failed.join("\n\n"));
    (commands, files)
}

/// Results of a page.
#[derive(Default)]
struct Tried {
    commands: usize,
    files: usize,
    /// Blocks that didn't end as stated, with their output.
    failed: Vec<String>,
}

/// Tries all blocks of a page in a folder of its own.
fn try_page(page: &str) -> Tried {
    let bench = TestFolder::with([("small.toml", SMALL)]);
    let mut tried = Tried::default();
    for block in blocks(&shipped_text(page)) {
        let at = format!("{page}:{}", block.line);
        let file = block.option("file").unwrap_or("block.toml");
        if block.option("file").is_some() || block.has("recipe") || block.has("rig") {
            bench.write(file, &block.text);
        }
        if block.has("recipe") {
            let rig = block.option("rig").unwrap_or("sim");
            tried.failed.extend(run(&bench, &at, &format!("palpate check {file} --rig {rig}"), "0"));
            tried.files += 1;
        }
        if block.has("rig") {
            tried.failed.extend(run(&bench, &at, &format!("palpate check small.toml --rig {file}"), "0"));
            tried.files += 1;
        }
        if block.kind() == "console" {
            for command in block.commands() {
                // a checkout's first command, before anything is installed
                let command = command.replace("cargo run -- ", "palpate ");
                tried.failed.extend(run(&bench, &at, &command, block.option("exit").unwrap_or("0")));
                tried.commands += 1;
            }
        }
    }
    tried
}

/// Runs a line as a reader does; returns its output if it doesn't end as stated.
fn run(bench: &TestFolder, at: &str, line: &str, code: &str) -> Option<String> {
    let began = Instant::now();
    let Output { status, stdout, stderr } = shell(bench, line).output().expect("sh starts");
    println!("{:5.1} s  {at}  {line}", began.elapsed().as_secs_f64());
    let (out, err) = (String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
    let found = status.code().map_or_else(|| status.to_string(), |code| code.to_string());
    (found != code).then(|| format!("{at}: exit code {found} in place of {code}: {line}\n{out}\n{err}"))
}

/// A shell in a folder that finds the program by its name.
fn shell(bench: &TestFolder, line: &str) -> Command {
    let program = bench.command("");
    let folder = Path::new(program.get_program()).parent().expect("the program is in a folder").to_path_buf();
    let others = std::env::var_os("PATH").unwrap_or_default();
    let path = std::iter::once(folder).chain(std::env::split_paths(&others));
    let mut command = Command::new("sh");
    command.args(["-c", line]).env("PATH", std::env::join_paths(path).expect("a path")).stdin(Stdio::null());
    command.current_dir(program.get_current_dir().expect("a folder"));
    for (name, value) in program.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command
}

/// A block of fenced code.
pub struct Block {
    line: usize,
    info: String,
    pub text: String,
}

impl Block {
    pub fn kind(&self) -> &str {
        self.info.split_whitespace().next().unwrap_or_default()
    }

    pub fn has(&self, word: &str) -> bool {
        self.info.split_whitespace().skip(1).any(|found| found == word)
    }

    pub fn option(&self, name: &str) -> Option<&str> {
        self.info.split_whitespace().find_map(|word| word.strip_prefix(name)?.strip_prefix('='))
    }

    /// Its lines that begin with `$ `, each with its continuation lines.
    pub fn commands(&self) -> Vec<String> {
        let (mut commands, mut goes_on) = (Vec::<String>::new(), false);
        for line in self.text.lines() {
            match (line.strip_prefix("$ "), commands.last_mut()) {
                (Some(command), _) => commands.push(command.to_owned()),
                (None, Some(command)) if goes_on => *command += &format!("\n{line}"),
                (None, _) => continue,
            }
            goes_on = line.ends_with('\\');
        }
        commands
    }
}

/// The blocks of a page; one within a list item without its indentation.
pub fn blocks(page: &str) -> Vec<Block> {
    let (mut blocks, mut open) = (Vec::new(), None::<(usize, Block)>);
    for (at, line) in page.lines().enumerate() {
        let fence = line.trim_start().strip_prefix("```");
        match (fence, open.take()) {
            (Some(info), None) => {
                let indent = line.len() - line.trim_start().len();
                open = Some((indent, Block { line: at + 1, info: info.trim().to_owned(), text: String::new() }));
            }
            (Some(_), Some((_, block))) => blocks.push(block),
            (None, Some((indent, mut block))) => {
                block.text += line.get(indent..).unwrap_or_default();
                block.text.push('\n');
                open = Some((indent, block));
            }
            (None, None) => {}
        }
    }
    blocks
}
