//! `palpate reference commands`: all commands on one page. Options that several commands have are described once.

use super::help;
use clap::{Arg, Command};
use std::collections::BTreeMap;

/// Number of commands from which on an option with the same help is described at the end of the page.
const SHARED_LEAST: usize = 3;

const BEGIN: &str = "\
# Commands

`palpate COMMAND --help` prints the help of a command with its exit codes. An option named after \"also\" is described at the [end of this
page](#options-of-several-commands). Every command has `--help`. [Exit codes](exit-codes.md) lists the codes.
";

/// Returns the page, as Markdown.
pub(super) fn commands_page() -> String {
    let mut all = help::command();
    all.build();
    let mut commands = Vec::new();
    collect(&all, 2, &mut commands);
    let mut counts = BTreeMap::new();
    for arg in commands.iter().flat_map(|(_, command)| options(command)) {
        *counts.entry(described(arg)).or_insert(0) += 1;
    }
    let is_shared = |arg: &Arg| counts.get(&described(arg)).is_some_and(|count| *count >= SHARED_LEAST);
    let sections = commands.iter().map(|(level, command)| section(*level, command, &is_shared));
    let shared = counts.iter().filter(|(_, count)| **count >= SHARED_LEAST).map(|(line, _)| format!("- {line}\n"));
    let end = "\n## Options of several commands\n\n".to_owned();
    BEGIN.to_owned() + &sections.collect::<String>() + &end + &shared.collect::<String>()
}

/// Lists the commands with the levels of their headings.
fn collect<'a>(within: &'a Command, level: usize, commands: &mut Vec<(usize, &'a Command)>) {
    for command in within.get_subcommands().filter(|command| command.get_name() != "help") {
        commands.push((level, command));
        collect(command, level + 1, commands);
    }
}

/// The visible options of a command without `--help`.
fn options(command: &Command) -> impl Iterator<Item = &Arg> {
    command.get_arguments().filter(|arg| {
        !arg.is_positional() && !arg.is_hide_set() && !["help", "version"].contains(&arg.get_id().as_str())
    })
}

fn section(level: usize, command: &Command, is_shared: &impl Fn(&Arg) -> bool) -> String {
    let name = command.get_bin_name().unwrap_or(command.get_name());
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let positional: String = command.get_positionals().map(|arg| format!(" {arg}")).collect();
    let mut section = format!("\n{} {name}\n\n{about}.\n\n`{name}{positional}`\n", "#".repeat(level));
    let own = command.get_positionals().chain(options(command).filter(|arg| !is_shared(arg)));
    let own: String = own.map(|arg| format!("- {}\n", described(arg))).collect();
    if !own.is_empty() {
        section += &format!("\n{own}");
    }
    let shared: Vec<String> = options(command)
        .filter(|arg| is_shared(arg))
        .filter_map(|arg| Some(format!("`--{}`", arg.get_long()?)))
        .collect();
    if !shared.is_empty() {
        section += &format!("\nAlso {}.\n", shared.join(", "));
    }
    let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let notes = after.split("\n\nExit code: ").next().filter(|notes| !notes.starts_with("Exit code: "));
    section + &notes.map(|notes| format!("\n```text\n{notes}\n```\n")).unwrap_or_default()
}

/// An argument with its help, values and default, in one line.
fn described(arg: &Arg) -> String {
    let mut line = format!("`{arg}`: {}", arg.get_help().map(ToString::to_string).unwrap_or_default());
    if arg.get_action().takes_values() {
        let values = arg.get_possible_values();
        let values: Vec<&str> =
            values.iter().filter(|value| !value.is_hide_set()).map(|value| value.get_name()).collect();
        if !values.is_empty() {
            line += &format!(" ({})", values.join(", "));
        }
        if let [default] = arg.get_default_values()
            && !arg.is_hide_default_value_set()
        {
            line += &format!(" [default: {}]", default.to_string_lossy());
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Most words of the page.
    const WORDS_MOST: usize = 5_500;

    #[test]
    fn commands_page_is_short_and_names_each_command_and_option() {
        let page = commands_page();
        let words = page.split_whitespace().count();
        assert!(words <= WORDS_MOST, "{words} words");
        let mut all = help::command();
        all.build();
        let mut commands = Vec::new();
        collect(&all, 2, &mut commands);
        for (_, command) in commands {
            let name = command.get_bin_name().unwrap();
            let (_, section) = page.split_once(&format!("# {name}\n")).unwrap_or_else(|| panic!("no section {name}"));
            let section = section.split("\n#").next().unwrap();
            for option in options(command) {
                let long = format!("`--{}", option.get_long().unwrap());
                assert!(section.contains(&long), "{name}: {long}");
            }
        }
    }
}
