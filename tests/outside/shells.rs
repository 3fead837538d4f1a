//! Completions, loaded by each shell.

use palpate_testing::{TestFolder, there};
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

#[test]
#[ignore = "needs bash and fish"]
fn completions_offer_shipped_recipes_and_rigs() {
    let bench = TestFolder::new();
    for shell in ["bash", "fish"] {
        bench.write(shell, &bench.palpate_ends(0, &format!("completions {shell}")).out);
    }
    let bash = |words: &str| {
        let before: Vec<&str> = words.split_whitespace().collect();
        let (count, previous) = (before.len(), before.last().copied().unwrap_or_default());
        let typed = format!("COMP_WORDS=({words}''); COMP_CWORD={count}; _palpate palpate '' '{previous}'");
        run("bash", &bench, &format!(". ./bash; {typed}; echo ${{COMPREPLY[@]}}"))
    };
    let fish = |words: &str| run("fish", &bench, &format!("source ./fish; complete -C '{words}'"));
    for (words, name) in [
        ("palpate run ", "characterise"),
        ("palpate run paper --rig ", "bench-esp301"),
        ("palpate doctor ", "esp301"),
        ("palpate batch run ", "batch"),
    ] {
        for offered in [bash(words), fish(words)] {
            assert!(offered.split_whitespace().any(|word| word == name), "{words}: {offered}");
        }
    }
}

/// Output of a shell.
fn run(shell: &str, bench: &TestFolder, script: &str) -> String {
    let mut command = Command::new(shell);
    let output = there(command.args(["-c", script]).current_dir(bench.path(".")), shell);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Loads the completions with these commands of the shell, which must print nothing.
fn loads(shell: &str, load: &str) {
    let bench = TestFolder::new();
    bench.write("script", &bench.palpate_ends(0, &format!("completions {shell}")).out);
    let mut command = Command::new(shell);
    let output = there(command.args(["-c", &format!("{load} ./script")]).current_dir(bench.path(".")), shell);
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && err.is_empty(), "{shell}: {err}");
}
