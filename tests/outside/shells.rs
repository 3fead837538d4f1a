//! Completions, each loaded by its shell.

use palpate_testing::{Bench, there};
use std::process::Command;

#[test]
#[ignore = "needs bash"]
fn completions_load_in_bash() {
    loads("bash", ".");
}

#[test]
#[ignore = "needs zsh"]
fn completions_load_in_zsh() {
    loads("zsh", "compdef() { :; }; .");
}

#[test]
#[ignore = "needs fish"]
fn completions_load_in_fish() {
    loads("fish", "source");
}

/// Loads the completions by these words of the shell, which must take them without a word.
fn loads(shell: &str, load: &str) {
    let bench = Bench::new();
    bench.write("script", &bench.palpate_ends(0, &format!("completions {shell}")).out);
    let mut command = Command::new(shell);
    let output = there(command.args(["-c", &format!("{load} ./script")]).current_dir(bench.path(".")), shell);
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && err.is_empty(), "{shell}: {err}");
}
