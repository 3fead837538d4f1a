//! A test in a process of its own.

use std::env;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

/// Environment of the process that runs one test alone.
pub const ALONE: &str = "PALPATE_TEST_ALONE";

/// Runs a test, by its name in this program, in its own process, and returns true; false if this is that process. For tests of things that
/// all tests of a process share, such as its memory, or that others disturb.
pub fn ran_alone(test: &str) -> bool {
    ran_by(test, &[])
}

/// The same on one processor: for a test whose result depends on how many there are. `taskset` is a part of every Linux.
pub fn ran_alone_on_one_processor(test: &str) -> bool {
    let first = processors()[0].to_string();
    ran_by(test, &["taskset", "--cpu-list", &first])
}

/// The processors that this process may use. Linux only.
pub fn processors() -> Vec<usize> {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux has it");
    let list = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:")).expect("Linux states it");
    let number = |text: &str| text.trim().parse::<usize>().expect("a number");
    let range = |range: &str| match range.split_once('-') {
        Some((first, last)) => number(first)..=number(last),
        None => number(range)..=number(range),
    };
    list.split(',').flat_map(range).collect()
}

fn ran_by(test: &str, runner: &[&str]) -> bool {
    if env::var_os(ALONE).is_some_and(|alone| alone == test) {
        return false;
    }
    let program = env::current_exe().expect("this program has a path");
    let mut words = runner.iter().map(OsStr::new).chain([program.as_os_str()]);
    let mut command = Command::new(words.next().expect("at least the program"));
    command.args(words).args(["--exact", test, "--nocapture"]).env(ALONE, test).stdout(Stdio::piped());
    let mut child = command.spawn().expect("this program starts again");
    let said = BufReader::new(child.stdout.take().expect("piped")).lines();
    let passed = said
        .map(|line| line.expect("text"))
        .inspect(|line| println!("{line}"))
        .filter(|line| line.starts_with("test result: ok. 1 passed"))
        .count();
    let status = child.wait().expect("it can be waited for");
    assert!(status.success() && passed == 1, "{test}, in a process of its own: {status}");
    true
}
