//! What a run of the tests leaves out. It is said in one way, so that `.ci/run` can count it.

use std::collections::BTreeSet;
use std::env;
use std::io::{self, Write};
use std::sync::Mutex;

/// Says that a test is skipped.
pub(crate) fn skipped(test: &str, reason: &str) {
    say(format!("skipped: {test}: {reason}\n"));
}

/// What an environment variable asks of a campaign. Where nothing asks for a long one, says that it is short.
pub(crate) fn asked(variable: &str) -> Option<String> {
    let asked = env::var(variable).ok();
    if asked.is_none() {
        say(format!("short: {variable} isn't set\n"));
    }
    asked
}

/// Prints past the test runner, which keeps what a test prints that passes: each line once, and in one piece.
fn say(line: String) {
    static SAID: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let mut said = SAID.lock().expect("not poisoned");
    if !said.contains(&line) {
        // its only error is that nobody listens
        let _ = io::stderr().write_all(line.as_bytes());
        said.insert(line);
    }
}
