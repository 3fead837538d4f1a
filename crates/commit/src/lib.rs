//! The commit that a program is built from, as a macro. A build script would compile the whole package again after every commit;
//! this macro makes the commit an input of the one target that names it.

#![forbid(unsafe_code)]

use proc_macro::TokenStream;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Expands to an `Option<&'static str>`: what `PALPATE_COMMIT` says when the program is compiled, or else what git says of this
/// repository, with `-dirty` at its end if a tracked file was changed. `None` without git.
#[proc_macro]
pub fn commit(_: TokenStream) -> TokenStream {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (watched, commit) = match history(&root) {
        // the compiler notes an included file as an input, so that cargo compiles the target again once it has changed
        Some(history) => (format!("const _: &[u8] = include_bytes!({history:?});"), described(&root)),
        None => (String::new(), None),
    };
    let expression = format!("{{ {watched} option_env!(\"PALPATE_COMMIT\").or({commit:?}) }}");
    expression.parse().expect("an expression")
}

/// Returns the file that grows with every commit and every checkout, or else the one that names what is checked out. A
/// repository that only contains this one's files isn't asked.
fn history(root: &Path) -> Option<PathBuf> {
    root.join(".git").exists().then_some(())?;
    let file =
        |name: &str| Some(root.join(git(root, &["rev-parse", "--git-path", name])?)).filter(|file| file.exists());
    file("logs/HEAD").or_else(|| file("HEAD"))?.canonicalize().ok()
}

fn described(root: &Path) -> Option<String> {
    git(root, &["describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"])
}

fn git(root: &Path, words: &[&str]) -> Option<String> {
    let output = Command::new("git").args(words).current_dir(root).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    (output.status.success() && !text.is_empty()).then_some(text)
}
