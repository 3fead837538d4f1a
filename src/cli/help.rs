//! The help: commands by task, and the exit codes of each.

use super::CommandLine;
use clap::{Command, CommandFactory as _};
use textwrap::{Options, WordSeparator, WordSplitter, fill};

/// Tasks, and their commands.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Press a sensor", &["demo", "check", "run", "resume"]),
    (
        "Judge what was recorded",
        &["evaluate", "report", "certificate", "study", "import", "export", "verify", "rebuild"],
    ),
    ("Solve contacts", &["fit", "adapt", "solve", "serve"]),
    ("Calibrate a batch", &["batch"]),
    ("Set up a bench", &["doctor", "align", "retract", "emulate", "ports", "drivers"]),
    ("Make files to begin with", &["init", "docs", "list", "schema", "reference", "completions", "man"]),
];

const COMPLETE: &str = "0 complete, and accepted if there is a rule; 1 not accepted, not decided, or a check failed";
const READS: &str = "2 bad input";
const WRITES: &str = "2 bad input, 5 a file can't be written";
const MOVES: &str = "2 bad input, and nothing moved; 3 a device failed, 4 a safety trip, 5 the record can't be written, \
                     130 cancelled, and the stage is parked";

/// Commands, what 0 and 1 mean, and the other exit codes. A command of commands has one line for all that have no line of their own.
const CODES: [(&str, &str, &str); 35] = [
    ("demo", "0 run, reported and accepted; 1 not accepted or not decided", MOVES),
    ("check", "0 the recipe can be run", "2 it can't: each problem is reported with its line"),
    ("run", COMPLETE, MOVES),
    ("resume", COMPLETE, MOVES),
    ("evaluate", "0 accepted, or no rule; 1 not accepted or not decided", READS),
    ("report", "0 accepted, or no rule; 1 not accepted or not decided; --compare: 0 the page is written", WRITES),
    (
        "certificate",
        "0 both files are written",
        "2 certificate.toml lacks required information, 5 a file can't be written",
    ),
    ("study", "0 done", WRITES),
    ("import", "0 imported", "2 bad input, and nothing is written; 5 a file can't be written"),
    ("export", "0 written", WRITES),
    ("verify", "0 no file has changed; 1 a file has changed", READS),
    ("rebuild", "0 written", WRITES),
    ("fit", "0 written", WRITES),
    ("adapt", "0 written; 1 no better than the mean place", WRITES),
    ("solve", "0 every line is answered", "2 bad input: the lines before it are answered"),
    ("serve", "130 stopped with Ctrl-C", "2 bad input, or the port is in use"),
    ("batch", "0 done", WRITES),
    ("batch check", "0 the batch can be run", "2 it can't: each problem is reported with its line"),
    (
        "batch run",
        "0 the batch or the input ended, even if sensors failed",
        "2 bad input; 3 the stage can't be parked, 4 the same after a safety trip, 5 the record can't be written, 130 cancelled",
    ),
    ("batch status", "0 done", READS),
    ("batch report", "0 the page is written, even if sensors failed", WRITES),
    (
        "doctor",
        "0 the rig can be used; 1 nothing has shown that the load cell measures force",
        "2 bad rig file, 3 a device doesn't work, 4 the load cell can't be trusted",
    ),
    ("align", "0 located; 1 the specimen can't be located or is tilted", MOVES),
    (
        "retract",
        "0 z is at the end away from the specimen",
        "2 bad rig file, 3 the stage doesn't work, 4 the force increased",
    ),
    ("emulate", "0 stopped", READS),
    ("ports", "0 listed", "2 the system can't list them"),
    ("drivers", "0 listed", READS),
    ("docs", "0 printed", READS),
    ("list", "0 listed", READS),
    ("init", "0 written", WRITES),
    ("schema", "0 printed", READS),
    ("reference", "0 printed", READS),
    ("completions", "0 printed", READS),
    ("man", "0 written", WRITES),
    ("", "0 done; 1 not accepted or not decided", MOVES),
];

/// Width of the help, columns, and column where the description of a command begins.
const WIDTH: usize = 80;
const INDENT: usize = 14;

/// The command line with its whole help.
pub(super) fn command() -> Command {
    let command = CommandLine::command();
    let groups = GROUPS.map(|(task, names)| {
        let lines: Vec<String> = names.iter().filter_map(|name| command.find_subcommand(name).map(line)).collect();
        format!("{task}:\n{}", lines.concat())
    });
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{}\nOptions:\n{{options}}{{after-help}}",
        groups.join("\n")
    );
    with_codes(command, "").help_template(template)
}

/// A command's name and what it does.
fn line(command: &Command) -> String {
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let (first, rest) = (format!("  {:<width$}", command.get_name(), width = INDENT - 2), " ".repeat(INDENT));
    fill(&about, Options::new(WIDTH).initial_indent(&first).subsequent_indent(&rest)) + "\n"
}

/// Adds the exit codes at the end of the help of a command, and of each of its subcommands.
fn with_codes(command: Command, path: &str) -> Command {
    let path = path.to_owned();
    let command = command.mut_subcommands(|sub| {
        let path = format!("{path} {}", sub.get_name());
        with_codes(sub, path.trim())
    });
    let Some(codes) = codes(&path) else { return command };
    let before = command.get_after_help().map(|help| format!("{help}\n\n")).unwrap_or_default();
    command.after_help(before + &codes)
}

/// The exit codes of a command.
fn codes(path: &str) -> Option<String> {
    let of = |path: &str| CODES.iter().find(|(name, ..)| *name == path);
    let (_, own, others) = of(path).or_else(|| of(path.split_once(' ')?.0))?;
    let plain =
        Options::new(WIDTH).word_separator(WordSeparator::AsciiSpace).word_splitter(WordSplitter::NoHyphenation);
    Some(fill(&format!("Exit code: {own}; {others}."), plain))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(command: &Command, path: &str) -> Vec<String> {
        let subs = command.get_subcommands().flat_map(|sub| {
            let path = format!("{path} {}", sub.get_name());
            let path = path.trim().to_owned();
            std::iter::once(path.clone()).chain(paths(sub, &path))
        });
        subs.collect()
    }

    #[test]
    fn each_command_is_in_one_group_and_its_help_ends_with_its_exit_codes() {
        let command = command();
        let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
        for name in &names {
            let groups = GROUPS.iter().filter(|(_, names)| names.contains(&name.as_str())).count();
            assert_eq!(groups, 1, "{name} is in {groups} groups");
        }
        assert_eq!(GROUPS.iter().map(|(_, names)| names.len()).sum::<usize>(), names.len(), "a group names no command");
        let all = paths(&command, "");
        for (path, ..) in CODES.iter().filter(|(path, ..)| !path.is_empty()) {
            assert!(all.iter().any(|known| known == path), "{path} isn't a command");
        }
        for path in &all {
            let found = path.split(' ').try_fold(&command, |within, name| within.find_subcommand(name));
            let help = found.expect("a command").get_after_help().expect("a help").to_string();
            assert!(help.matches("Exit code").count() == 1 && help.ends_with('.'), "{path}: {help}");
        }
        let help = command.term_width(WIDTH).render_help().to_string();
        assert!(help.contains("Press a sensor:\n  demo        Run the paper"), "{help}");
        assert!(help.lines().all(|line| line.chars().count() <= WIDTH), "{help}");
    }
}
