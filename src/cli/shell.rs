//! `palpate completions` and `palpate man`: the command line for shells and for `man`.

use super::exit::Failure;
use super::help;
use super::summary::print;
use clap::ValueEnum;
use clap_complete::aot;
use miette::{IntoDiagnostic, WrapErr};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::{fs, io};

/// Shell with completions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Shell {
    Bash,
    Zsh,
    Fish,
    #[value(name = "powershell")]
    Pwsh,
}

const COMPLETIONS_EXAMPLES: &str = "\
Examples:
  palpate completions bash > ~/.local/share/bash-completion/completions/palpate
  palpate completions zsh > ~/.zfunc/_palpate    # with fpath+=~/.zfunc
  palpate completions fish > ~/.config/fish/completions/palpate.fish
  palpate completions powershell >> $PROFILE";

/// Print completions for a shell
#[derive(Debug, clap::Args)]
#[command(after_help = COMPLETIONS_EXAMPLES)]
pub(super) struct CompletionsArgs {
    /// Which shell
    shell: Shell,
}

/// Prints the completions.
pub(super) fn completions(args: &CompletionsArgs) -> Result<ExitCode, Failure> {
    let shell = match args.shell {
        Shell::Bash => aot::Shell::Bash,
        Shell::Zsh => aot::Shell::Zsh,
        Shell::Fish => aot::Shell::Fish,
        Shell::Pwsh => aot::Shell::PowerShell,
    };
    let mut script = Vec::new();
    aot::generate(shell, &mut help::command(), "palpate", &mut script);
    print(&String::from_utf8_lossy(&script))?;
    Ok(ExitCode::SUCCESS)
}

const MAN_EXAMPLES: &str = "\
Example:
  palpate man --out ~/.local/share/man/man1";

/// Write a man page for each command
#[derive(Debug, clap::Args)]
#[command(after_help = MAN_EXAMPLES)]
pub(super) struct ManArgs {
    /// The folder to write to; it is made if it is missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Writes the pages.
pub(super) fn man(args: &ManArgs) -> Result<ExitCode, Failure> {
    pages(&args.out)
        .into_diagnostic()
        .wrap_err_with(|| format!("can't write man pages to {}", args.out.display()))
        .map_err(Failure::unwritten)?;
    Ok(ExitCode::SUCCESS)
}

fn pages(folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    clap_mangen::generate_to(help::command(), folder)
}
