//! A test in a process of its own.

use std::env;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

/// Environment of the process that runs one test alone.
const ALONE: &str = "PALPATE_TEST_ALONE";

/// Runs a test, by its name in this program, in its own process, and returns true; false if this is that process. For tests of things that
/// all tests of a process share, such as its memory, or that others disturb.
pub fn ran_alone(test: &str) -> bool {
    if env::var_os(ALONE).is_some_and(|alone| alone == test) {
        return false;
    }
    let mut command = Command::new(env::current_exe().expect("this program has a path"));
    command.args(["--exact", test, "--nocapture"]).env(ALONE, test).stdout(Stdio::piped());
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
