//! Problems of a text and their positions.

use miette::{Diagnostic, LabeledSpan, NamedSource, Report, Severity, SourceCode};
use std::cell::RefCell;
use std::ops::Range;
use std::sync::Arc;

/// Largest number of problems of a text that are reported. A person with more problems corrects these first.
pub const PROBLEMS_MAX: usize = 100;

/// Longest part of a text that is shown with a problem, bytes. The library that draws it fails beyond 65,535 columns.
const SHOWN_MAX_BYTES: usize = 8192;

/// One problem of a text and its position.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Bytes of the text that the problem concerns.
    pub span: Range<usize>,
    /// Description of the problem.
    pub message: String,
    /// Suggested correction, if known.
    pub help: Option<String>,
}

impl Problem {
    /// Creates a problem at a position.
    pub fn new(span: Range<usize>, message: impl Into<String>) -> Self {
        Problem { span, message: printable(message.into()), help: None }
    }

    /// Adds a suggested correction.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(printable(help.into()));
        self
    }
}

/// All problems of one text.
#[derive(Debug)]
pub struct Problems {
    name: String,
    located: Vec<LocatedProblem>,
}

impl Problems {
    /// Takes the problems of a text and sorts them by position. Keeps the first [`PROBLEMS_MAX`], and records whether there are
    /// more.
    pub fn new(name: &str, text: &str, mut problems: Vec<Problem>) -> Self {
        problems.sort_by_key(|problem| problem.span.start);
        if problems.len() > PROBLEMS_MAX {
            let more = Problem::new(problems[PROBLEMS_MAX].span.clone(), "there are more problems");
            problems.truncate(PROBLEMS_MAX);
            problems.push(more);
        }
        let text: Arc<str> = shown(text).into();
        let locate =
            |problem| LocatedProblem { source: NamedSource::new(name, text.clone()), text: text.clone(), problem };
        Problems { name: name.to_owned(), located: problems.into_iter().map(locate).collect() }
    }

    /// Returns each problem as a report that shows its line.
    pub fn into_reports(self) -> impl Iterator<Item = Report> {
        self.located.into_iter().map(Report::new)
    }

    /// Returns one line for each problem, `file:line:column: message`.
    pub fn lines(&self) -> Vec<String> {
        self.text().map(|(line, _)| line).collect()
    }

    /// Returns the same lines, each with its suggested correction.
    pub fn text(&self) -> impl Iterator<Item = (String, Option<&str>)> {
        self.located.iter().map(|located| {
            let (line, column) = located.line_and_column();
            let text = format!("{}:{line}:{column}: {}", self.name, located.problem.message);
            (text, located.problem.help.as_deref())
        })
    }
}

impl std::fmt::Display for Problems {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.located.len() {
            1 => write!(f, "{}: one problem", self.name),
            n => write!(f, "{}: {n} problems", self.name),
        }
    }
}

impl std::error::Error for Problems {}

impl Diagnostic for Problems {}

/// Problem together with its text.
#[derive(Debug)]
struct LocatedProblem {
    source: NamedSource<Arc<str>>,
    text: Arc<str>,
    problem: Problem,
}

impl LocatedProblem {
    /// Whether the lines of the problem are few and short enough to be shown. Otherwise they would hide the problem.
    fn is_shown(&self) -> bool {
        let Range { start, end } = self.problem.span;
        let (start, end) = (start.min(self.text.len()), end.min(self.text.len()));
        let from = self.text[..start].rfind('\n').unwrap_or(0);
        let to = self.text[end..].find('\n').map_or(self.text.len(), |way| end + way);
        to.saturating_sub(from) <= SHOWN_MAX_BYTES
    }

    fn line_and_column(&self) -> (usize, usize) {
        let before = &self.text[..self.problem.span.start.min(self.text.len())];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }
}

impl std::fmt::Display for LocatedProblem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if !self.is_shown() {
            let (line, column) = self.line_and_column();
            write!(f, "{}:{line}:{column}: ", self.source.name())?;
        }
        f.write_str(&self.problem.message)
    }
}

impl std::error::Error for LocatedProblem {}

impl Diagnostic for LocatedProblem {
    fn severity(&self) -> Option<Severity> {
        Some(Severity::Error)
    }

    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        self.problem.help.as_ref().map(|help| Box::new(help) as Box<dyn std::fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.is_shown().then_some(&self.source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let label = LabeledSpan::new_with_span(None, self.problem.span.clone());
        self.is_shown().then(|| Box::new(std::iter::once(label)) as Box<dyn Iterator<Item = LabeledSpan>>)
    }
}

/// Returns a text without characters that control a terminal.
pub fn printable(text: String) -> String {
    if !text.contains(char::is_control) {
        return text;
    }
    text.chars().map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() }).collect()
}

/// Returns a shown text without such characters. Every position in the text stays the same.
fn shown(text: &str) -> String {
    let kept = |c: char| !c.is_control() || matches!(c, '\n' | '\r' | '\t');
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        match kept(c) {
            true => shown.push(c),
            false => (0..c.len_utf8()).for_each(|_| shown.push('?')),
        }
    }
    shown
}

/// Collection of the problems that are found while a text is read.
#[derive(Debug, Default)]
pub(super) struct Collector(RefCell<Vec<Problem>>);

impl Collector {
    /// Stores a problem, unless more problems are already stored than are reported.
    pub(crate) fn add(&self, problem: Problem) {
        let mut problems = self.0.borrow_mut();
        if problems.len() <= PROBLEMS_MAX {
            problems.push(problem);
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.borrow().is_empty()
    }

    pub(crate) fn into_problems(self, name: &str, text: &str) -> Problems {
        Problems::new(name, text, self.0.into_inner())
    }
}
