//! A program of the user's that is notified of events. Rigs and batch files have the same key.

use super::{Keys, Problem, Table, keys};

/// Largest number of words of the command.
const COMMAND_MAX: usize = 100;

keys! {
    /// `[notify]`
    notify {
        command: Texts, Refused, "the program and its arguments", "[\"notify-send\", \"palpate\"]";
    }
}

/// The keys of `[notify]`.
pub const NOTIFY: Keys = notify::KEYS;

/// Reads the program and its arguments.
pub fn read_command(table: &Table) -> Option<Vec<String>> {
    let command = table.texts(&notify::command)?;
    if command.is_empty() || command.len() > COMMAND_MAX || command[0].trim().is_empty() {
        let problem = format!("`command` must have 1 to {COMMAND_MAX} words, the first of which is the program");
        let problem = Problem::new(table.span_of(&notify::command), problem);
        table.complain(problem.help("remove [notify], or name a program"));
        return None;
    }
    Some(command.into_iter().map(str::to_owned).collect())
}
