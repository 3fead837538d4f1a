//! Tells the program which commit it is built from: what `PALPATE_COMMIT` says, or else what git says, if it is there.

use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=PALPATE_COMMIT");
    // the log of HEAD grows with every commit and every checkout; a file that isn't there would have this run each time
    if Path::new(".git/logs/HEAD").exists() {
        println!("cargo::rerun-if-changed=.git/logs/HEAD");
    } else {
        println!("cargo::rerun-if-changed=build.rs");
    }
    if let Some(commit) = std::env::var("PALPATE_COMMIT").ok().or_else(asked_of_git) {
        println!("cargo::rustc-env=PALPATE_COMMIT={commit}");
    }
}

/// The commit that is checked out; `-dirty` behind it where a file that is kept was changed since. Of a repository that
/// merely holds this one's files nothing is asked.
fn asked_of_git() -> Option<String> {
    if !Path::new(".git").exists() {
        return None;
    }
    let said =
        Command::new("git").args(["describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]).output().ok()?;
    let commit = String::from_utf8(said.stdout).ok()?.trim().to_owned();
    (said.status.success() && !commit.is_empty()).then_some(commit)
}
