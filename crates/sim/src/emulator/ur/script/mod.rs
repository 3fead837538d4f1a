//! Programs of URScript, as far as clients of this emulator need it (document: "URScript manual").
//!
//! A program is a `def` with its `end`, and a secondary one, which takes no time and ends no other one, a `sec`. It is read as a whole
//! before any of it is run. It has variables, `if`, `elif`, `else` and `while`. It has no functions and threads of its own.

mod expression;
mod functions;
mod value;

pub(super) use expression::{Call, Expression};
pub(super) use value::Value;

/// Statement of a program.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Statement {
    /// Gives a variable a value.
    Let(String, Expression),
    /// A call for its effect.
    Do(Call),
    If {
        condition: Expression,
        yes: Vec<Statement>,
        no: Vec<Statement>,
    },
    While {
        condition: Expression,
        body: Vec<Statement>,
    },
}

/// A program.
#[derive(Debug, PartialEq)]
pub(super) struct Program {
    pub statements: Vec<Statement>,
    /// Whether it is a `sec`.
    pub is_secondary: bool,
}

/// Largest depth of blocks, so that no text exhausts the stack.
const DEPTH_MOST: usize = 32;

/// Takes the lines of the next whole program from the front. Blocks are counted, since indentation has no meaning.
pub(super) fn take_program(received: &mut Vec<u8>) -> Option<Vec<u8>> {
    let (mut depth, mut end) = (0_usize, 0);
    for line in received.split_inclusive(|&byte| byte == b'\n').filter(|line| line.ends_with(b"\n")) {
        end += line.len();
        let line = String::from_utf8_lossy(line);
        match bare(&line).split(|char: char| !char.is_ascii_alphanumeric() && char != '_').next() {
            Some("def" | "sec" | "thread" | "if" | "while" | "for") => depth += 1,
            Some("end") => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 {
            return Some(received.drain(..end).collect());
        }
    }
    None
}

/// Reads a program; `None` for a syntax error or a statement that isn't known here.
pub(super) fn read_program(text: &[u8]) -> Option<Program> {
    let text = std::str::from_utf8(text).ok()?;
    let mut lines = text.lines().map(bare).filter(|line| !line.is_empty());
    let (kind, head) = lines.next()?.split_once(' ')?;
    let name = head.strip_suffix(':')?.trim().strip_suffix("()")?;
    let (statements, end) = read_block(&mut lines, 0)?;
    let is_whole = ["def", "sec"].contains(&kind) && is_name(name) && end == "end" && lines.next().is_none();
    is_whole.then_some(Program { statements, is_secondary: kind == "sec" })
}

/// Reads the statements up to a line that ends the block, and returns that line, too.
fn read_block<'a>(lines: &mut impl Iterator<Item = &'a str>, depth: usize) -> Option<(Vec<Statement>, &'a str)> {
    let mut statements = Vec::new();
    loop {
        let line = lines.next().filter(|_| depth < DEPTH_MOST)?;
        if line == "end" || line == "else:" || headed(line, "elif").is_some() {
            return Some((statements, line));
        }
        statements.push(if let Some(condition) = headed(line, "if") {
            read_if(condition, lines, depth + 1)?
        } else if let Some(condition) = headed(line, "while") {
            let (body, end) = read_block(lines, depth + 1)?;
            (end == "end").then_some(Statement::While { condition: Expression::read(condition)?, body })?
        } else {
            read_statement(line)?
        });
    }
}

/// Reads the rest of an `if` or `elif`.
fn read_if<'a>(condition: &str, lines: &mut impl Iterator<Item = &'a str>, depth: usize) -> Option<Statement> {
    let condition = Expression::read(condition)?;
    let (yes, end) = read_block(lines, depth)?;
    let no = if end == "end" {
        Vec::new()
    } else if let Some(condition) = headed(end, "elif") {
        if depth == DEPTH_MOST {
            return None;
        }
        vec![read_if(condition, lines, depth + 1)?]
    } else {
        read_block(lines, depth).filter(|(_, end)| *end == "end")?.0
    };
    Some(Statement::If { condition, yes, no })
}

/// Returns what is between a word at the begin of a line and the colon at its end.
fn headed<'a>(line: &'a str, word: &str) -> Option<&'a str> {
    line.strip_prefix(word).filter(|rest| rest.starts_with([' ', '(']))?.strip_suffix(':')
}

fn read_statement(line: &str) -> Option<Statement> {
    if let Some((name, value)) = line.split_once('=')
        && !value.starts_with('=')
    {
        let name = ["local ", "global "].into_iter().find_map(|scope| name.strip_prefix(scope)).unwrap_or(name).trim();
        if is_name(name) {
            return Some(Statement::Let(name.to_owned(), Expression::read(value)?));
        }
    }
    match Expression::read(line)? {
        Expression::Call(call) => Some(Statement::Do(call)),
        _ => None,
    }
}

fn is_name(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|char| char.is_ascii_alphanumeric() || char == '_')
}

/// Returns a line without its comment and the spaces around it.
fn bare(line: &str) -> &str {
    line.split('#').next().unwrap_or(line).trim()
}
