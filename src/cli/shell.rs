//! `palpate completions` and `palpate man`: the command line for shells and for `man`.

use super::help;
use super::summary::print;
use crate::api::Failure;
use crate::api::shipped::{BATCHES, RECIPES, RIGS, Shipped, names};
use clap::builder::PossibleValuesParser;
use clap::{Command, ValueEnum};
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
    let mut command = with_shipped(help::command());
    aot::generate(shell, &mut command, "palpate", &mut script);
    let script = or_files(String::from_utf8_lossy(&script).into_owned());
    let more = if matches!(args.shell, Shell::Fish) { fish_arguments(&command, "") } else { String::new() };
    print(&(script + &more))?;
    Ok(ExitCode::SUCCESS)
}

/// Arguments that name a shipped file: where they are defined, and the files.
const SHIPPED: [(&str, &[Shipped]); 3] = [("recipe", RECIPES), ("rig", RIGS), ("batch_file", BATCHES)];

/// Adds the names of shipped files to the arguments that can be such a name.
fn with_shipped(command: Command) -> Command {
    let named = command.mut_args(|arg| match SHIPPED.iter().find(|(id, _)| arg.get_id() == id) {
        Some((_, shipped)) => arg.value_parser(PossibleValuesParser::new(names(shipped))),
        None => arg,
    });
    named.mut_subcommands(with_shipped)
}

/// Offers files too where a script offers shipped names. Bash does this where no name fits.
fn or_files(mut script: String) -> String {
    for (_, shipped) in SHIPPED {
        let names = names(shipped);
        let zsh = names.join(" ");
        script = script.replace(
            &format!(":({zsh})'"),
            &format!(":{{_alternative \"names:name:({zsh})\" \"files:file:_files\"}}'"),
        );
        let fish = names.iter().map(|name| format!("{name}\\t''")).collect::<Vec<_>>().join("\n");
        script = script.replace(&format!("-r -f -a \"{fish}\""), &format!("-r -F -a \"{fish}\""));
    }
    script
}

/// Lines for the arguments of commands, which the generator leaves out for fish.
fn fish_arguments(command: &Command, before: &str) -> String {
    let of = |sub: &Command| {
        let name = sub.get_name();
        let condition = match before {
            "" => format!("__fish_palpate_using_subcommand {name}"),
            _ => format!("__fish_palpate_using_subcommand {before}; and __fish_seen_subcommand_from {name}"),
        };
        let shipped = sub.get_positionals().find_map(|arg| SHIPPED.iter().find(|(id, _)| arg.get_id() == id));
        let own = shipped.map(|(_, shipped)| {
            format!("complete -c palpate -n \"{condition}\" -a \"{}\"\n", names(shipped).join(" "))
        });
        own.unwrap_or_default() + &fish_arguments(sub, name)
    };
    command.get_subcommands().map(of).collect()
}

const MAN_EXAMPLES: &str = "\
Example:
  palpate man --out ~/.local/share/man/man1";

/// Write a man page for each command
#[derive(Debug, clap::Args)]
#[command(after_help = MAN_EXAMPLES)]
pub(super) struct ManArgs {
    /// Output folder; created if missing
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
