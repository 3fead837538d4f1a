//! Exit codes of commands, and failures as a person sees them.

use super::summary;
use crate::api::{Failure, FailureKind};
use miette::{MietteHandler, MietteHandlerOpts};
use palpate_document::Problems;
use std::env;
use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;
use textwrap::{WordSeparator, WordSplitter};

/// The exit code of a command that ends like this.
pub(super) fn exit_code(kind: FailureKind) -> ExitCode {
    ExitCode::from(kind.code())
}

/// How failures are laid out: in the width, the colours and the lines that standard error can show.
pub(super) fn handler() -> MietteHandler {
    let stderr = io::stderr();
    // a link, a path or an option is one word: it isn't broken at slashes or hyphens
    MietteHandlerOpts::new()
        .word_separator(WordSeparator::AsciiSpace)
        .word_splitter(WordSplitter::NoHyphenation)
        .break_words(false)
        .width(summary::width(&stderr))
        .color(console::colors_enabled_stderr())
        .unicode(!stderr.is_terminal() || shows_unicode())
        .terminal_links(false)
        .build()
}

/// Whether the terminal shows the lines and arrows of an error. The console of Linux has no such letters; elsewhere the locale
/// decides.
fn shows_unicode() -> bool {
    let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(|name| env::var(name).ok()).unwrap_or_default();
    let is_utf8 = ["UTF-8", "UTF8"].iter().any(|ending| locale.to_ascii_uppercase().ends_with(ending));
    (is_utf8 || cfg!(windows)) && env::var("TERM").as_deref() != Ok("linux")
}

/// Prints a failure, and returns its exit code.
pub(super) fn report(failure: Failure) -> ExitCode {
    let kind = failure.kind();
    let (stage, before, report) = failure.into_parts();
    stage.iter().for_each(|stage| say(stage));
    before.into_iter().for_each(|before| _ = self::report(*before));
    match report.downcast::<Problems>() {
        Ok(problems) => {
            // the count last, where the reader looks
            let count = problems.to_string();
            problems.into_reports().for_each(|report| say(&format!("{report:?}")));
            say(&format!("{count}; nothing was done"));
        }
        Err(report) => say(&format!("{report:?}")),
    }
    exit_code(kind)
}

/// Prints a text, of whose control characters only colours and line ends reach the terminal. If it has been closed, nothing is
/// shown, but the exit code is still returned.
fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", coloured(text));
}

fn coloured(text: &str) -> String {
    let (mut shown, mut rest) = (String::with_capacity(text.len()), text.chars());
    while let Some(letter) = rest.next() {
        let is_colour = || {
            let parts = rest.as_str().strip_prefix('[').and_then(|rest| rest.split_once('m'));
            parts.is_some_and(|(numbers, _)| numbers.chars().all(|c| c.is_ascii_digit() || c == ';'))
        };
        let is_shown = !letter.is_control() || matches!(letter, '\n' | '\t') || letter == '\u{1b}' && is_colour();
        shown.push(if is_shown { letter } else { '\u{fffd}' });
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_colour_escapes_are_printed() {
        let coloured_text = "\u{1b}[1;31mx\u{1b}[0m\n\ty\u{1b}[m";
        assert_eq!(coloured(coloured_text), coloured_text);
        assert_eq!(
            coloured("\u{1b}]0;owned\u{7}\r\u{1b}[2J\u{9b}1m"),
            "\u{fffd}]0;owned\u{fffd}\u{fffd}\u{fffd}[2J\u{fffd}1m"
        );
    }
}
