//! Reads a TOML text and collects every problem with its position.
//!
//! The allowed content of a text is data: [`Keys`] list every [`Key`] of a table. Recipes, rigs and register maps are read
//! through a [`Table`]. Each request for a key either returns a value, or records a [`Problem`] and continues. A person therefore
//! sees all problems at once, each with the line, the expected value and the nearest correct spelling.

#![forbid(unsafe_code)]

mod difference;
mod key;
pub mod layout;
pub mod notify;
mod problem;
mod reference;
#[doc(hidden)]
pub mod sample;
mod schema;
mod table;

pub use difference::{GivenValue, KeyChange, differences};
pub use key::{Absent, Bounds, Case, DefaultValue, Key, Keys, Listed, ValueKind};
pub use key::{row, words};
pub use problem::printable;
pub use problem::{PROBLEMS_MAX, Problem, Problems};
pub use reference::reference;
pub use schema::schema;
pub use table::{Span, Table};
pub use table::{all, misspelt, optional, with_nearest};

use problem::Collector;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use toml_parser::Source;
use toml_parser::lexer::TokenKind;

/// Length of the longest text that is read as a recipe or a rig, bytes: a hundred times the longest list written by hand.
pub const TEXT_MAX_BYTES: usize = 4 << 20;

/// Largest depth of nested brackets. No recipe or rig needs five. The parser would follow brackets that are never closed until
/// its stack overflows.
const DEPTH_MAX: usize = 32;

/// Reads a TOML text with `read`, which requests keys of the list from a root [`Table`]. Keys that aren't in the list are
/// problems too.
///
/// `name` is the file's name in messages.
///
/// # Errors
/// All problems of the text, in the order of their positions.
pub fn read<T>(
    name: &str,
    text: &str,
    keys: &'static Keys,
    read: impl FnOnce(&Table) -> Option<T>,
) -> Result<T, Problems> {
    let root = parsed_as(name, text, Some(keys))?;
    let _reading = sample::TextBeingRead::begin();
    let collector = Collector::default();
    let table = Table::root(&root, keys, &collector);
    table.check_names();
    let value = read(&table);
    match value {
        Some(value) if collector.is_empty() => Ok(value),
        _ => Err(collector.into_problems(name, text)),
    }
}

/// Whether a text has a key of this name outside its tables; false if the text isn't TOML.
pub fn has_key(text: &str, name: &str) -> bool {
    parsed("", text).is_ok_and(|root| root.get_ref().keys().any(|key| key.get_ref() == name))
}

/// Returns the positions of the values at a path of keys. In a list of tables, each table is searched. Empty if the text isn't TOML.
pub fn positions(text: &str, path: &[&str]) -> Vec<Span> {
    let mut found = Vec::new();
    if let Ok(root) = parsed("", text) {
        add_positions(root.get_ref(), path, &mut found);
    }
    found
}

fn add_positions(table: &DeTable<'_>, path: &[&str], found: &mut Vec<Span>) {
    let Some((name, rest)) = path.split_first() else { return };
    let Some((_, value)) = table.iter().find(|(key, _)| key.get_ref() == name) else { return };
    if rest.is_empty() {
        found.push(value.span());
        return;
    }
    let listed = value.get_ref().as_array().into_iter().flat_map(|items| items.iter().map(Spanned::get_ref));
    let tables = std::iter::once(value.get_ref()).chain(listed).filter_map(DeValue::as_table);
    tables.for_each(|table| add_positions(table, rest, found));
}

/// Returns the name of a table of the root that has a string of this name, and the position of the string's key. `None` if the
/// root itself has a key of this name, or if the text isn't TOML.
pub fn text_in_table(text: &str, name: &str) -> Option<(String, Span)> {
    let root = parsed("", text).ok()?;
    let root = root.get_ref();
    if root.keys().any(|key| key.get_ref() == name) {
        return None;
    }
    root.iter().find_map(|(table, value)| {
        let is_it =
            |(key, value): &(&Spanned<_>, &Spanned<DeValue<'_>>)| *key.get_ref() == name && value.get_ref().is_str();
        let (key, _) = value.get_ref().as_table()?.iter().find(is_it)?;
        Some((table.get_ref().to_string(), key.span()))
    })
}

/// Parses a text as TOML.
fn parsed<'t>(name: &str, text: &'t str) -> Result<Spanned<DeTable<'t>>, Problems> {
    parsed_as(name, text, None)
}

/// Parses a text as TOML. `keys` are those of its root, if they are known: they decide which headings may be repeated.
fn parsed_as<'t>(name: &str, text: &'t str, keys: Option<&Keys>) -> Result<Spanned<DeTable<'t>>, Problems> {
    if text.len() > TEXT_MAX_BYTES {
        let problem =
            Problem::new(0..0, format!("the file has {} bytes, but at most {TEXT_MAX_BYTES} are allowed", text.len()));
        return Err(Problems::new(name, "", vec![problem]));
    }
    if let Some(at) = too_deep(text) {
        let problem = Problem::new(at..at + 1, format!("not valid TOML: more than {DEPTH_MAX} brackets are open here"));
        return Err(Problems::new(name, text, vec![problem.help("close each `[` and `{`")]));
    }
    let (root, errors) = DeTable::parse_recoverable(text);
    if errors.is_empty() {
        return Ok(root);
    }
    let collector = Collector::default();
    let mut seen: Vec<&str> = Vec::new();
    let mut commas: Vec<Span> = Vec::new();
    let mut is_broken = false;
    for error in &errors {
        let place = error.span().unwrap_or(0..0);
        let is_twice = error.message() == "duplicate key";
        let heading = is_twice.then(|| heading_at(text, place.start)).flatten();
        let unit = value_with_unit(text, place.start);
        let problem = match (decimal_comma(text, place.start), heading) {
            // one comma can cause several errors
            (Some((number, _)), _) if commas.contains(&number) => continue,
            (Some((number, decimal)), _) => {
                commas.push(number.clone());
                Problem::new(number, "a number has a decimal point, not a comma").help(format!("write {decimal}"))
            }
            (None, Some((_, heading))) if seen.contains(&heading) => continue,
            (None, Some((is_double, heading))) => {
                seen.push(heading);
                heading_twice(text, place, heading, is_double, keys)
            }
            // the keys under such a heading are twice there too
            (None, None) if is_twice && !seen.is_empty() => continue,
            // the errors after the first one mostly follow from it
            (None, None) if !is_twice && std::mem::replace(&mut is_broken, true) => continue,
            (None, None) if is_twice => key_twice(text, place),
            (None, None) => match unit {
                Some((value, number)) => Problem::new(value, "a number with a unit: only the number is allowed")
                    .help(format!("write {number}, converted to the unit at the end of the key's name")),
                None => invalid(place, error.message()),
            },
        };
        collector.add(problem);
    }
    Err(collector.into_problems(name, text))
}

/// Returns the problem of a text that isn't TOML. In a list or an inline table a bracket may be open.
fn invalid(place: Span, message: &str) -> Problem {
    let problem = Problem::new(place, format!("not valid TOML: {message}"));
    match ["array", "inline table", "`]`", "`}`"].iter().any(|word| message.contains(word)) {
        true => problem.help("check that each bracket is closed"),
        false => problem,
    }
}

/// Returns the name in the heading `[name]` or `[[name]]` at this byte, and whether its brackets are double.
fn heading_at(text: &str, at: usize) -> Option<(bool, &str)> {
    let start = text.get(..at)?.rfind('\n').map_or(0, |newline| newline + 1);
    heading_of(text[start..].lines().next()?)
}

/// Returns the name of a line that is a heading, and whether its brackets are double. A comment may follow.
fn heading_of(line: &str) -> Option<(bool, &str)> {
    let line = line.split('#').next()?.trim();
    let inner = line.strip_prefix('[')?.strip_suffix(']')?;
    let double = inner.strip_prefix('[').and_then(|inner| inner.strip_suffix(']'));
    Some((double.is_some(), double.unwrap_or(inner)))
}

/// Returns the problem of a heading that comes again, with the brackets that the text needs.
fn heading_twice(text: &str, place: Span, heading: &str, is_double: bool, keys: Option<&Keys>) -> Problem {
    let list = format!("write [[{heading}]] with double brackets if there are several, each time");
    if is_double {
        // the first one has single brackets
        let mut start = 0;
        for line in text.split_inclusive('\n') {
            if heading_of(line) == Some((false, heading)) {
                let words = format!("[{heading}] has single brackets, but [[{heading}]] follows");
                return Problem::new(start..start + line.trim_end().len(), words).help(list);
            }
            start += line.len();
        }
    }
    if let Some(line) = line_of_value(text, heading) {
        let words = format!("[{heading}] is a table here, but line {line} gives `{heading}` a value");
        return Problem::new(place, words).help(format!("delete line {line}, or the table [{heading}]"));
    }
    let problem = Problem::new(place, format!("[{heading}] is here a second time"));
    let key = keys.and_then(|keys| keys.all().find(|key| key.name == heading));
    match key.map(|key| key.kind.pick(|kind| matches!(kind, ValueKind::Tables(_)).then_some(())).is_some()) {
        Some(false) => problem.help(format!("put all its keys under one [{heading}]")),
        _ => problem.help(list),
    }
}

/// Returns the number of the line above all headings that gives this key a value.
fn line_of_value(text: &str, key: &str) -> Option<usize> {
    let mut lines = text.lines().take_while(|line| heading_of(line).is_none());
    lines.position(|line| line.split_once('=').is_some_and(|(name, _)| name.trim() == key)).map(|index| index + 1)
}

/// Returns the value of the line with this byte if it is a number and a unit, such as `2.0 N`, and the number alone.
fn value_with_unit(text: &str, at: usize) -> Option<(Span, &str)> {
    let line_start = text.get(..at)?.rfind('\n').map_or(0, |newline| newline + 1);
    let line = text[line_start..].lines().next()?.split('#').next()?;
    let value = line.split_once('=')?.1.trim();
    let number = value.trim_end_matches(|c: char| c.is_ascii_alphabetic() || matches!(c, '%' | '/' | 'µ')).trim_end();
    let is_number = number.parse::<f64>().is_ok_and(f64::is_finite);
    let start = line_start + line.find(value)?;
    (is_number && number.len() < value.len()).then(|| (start..start + value.len(), number))
}

/// Returns the problem of a key that comes again in its table.
fn key_twice(text: &str, place: Span) -> Problem {
    let key = text.get(place.clone()).unwrap_or_default().to_owned();
    let before = text.get(..place.start).unwrap_or_default();
    let lines: Vec<&str> = before.lines().collect();
    let is_it = |line: &str| line.split_once('=').is_some_and(|(name, _)| name.trim() == key);
    let first = lines.iter().rposition(|line| is_it(line)).map(|index| format!(", after line {}", index + 1));
    let words = format!("`{key}` is here a second time{}", first.unwrap_or_default());
    Problem::new(place, words).help("delete one of the two lines")
}

/// Returns the first number with a decimal comma in the line with this byte, such as `0,5`, and the same number with a point.
fn decimal_comma(text: &str, at: usize) -> Option<(Span, String)> {
    let line_start = text.get(..at)?.rfind('\n').map_or(0, |newline| newline + 1);
    // a comma in a string or a comment is none of a number
    let line = text[line_start..].lines().next()?.split(['#', '"', '\'']).next()?;
    line.match_indices(',').find_map(|(comma, _)| {
        let (before, after) = (&line[..comma], &line[comma + 1..]);
        let is_in_number = |c: char| c.is_ascii_digit() || matches!(c, '-' | '+' | '_');
        let start = before.trim_end_matches(is_in_number).len();
        let digits = after.len() - after.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let is_value = before[..start].trim_end_matches([' ', '\t']).ends_with('=');
        let is_end = after[digits..].trim_start().starts_with([',', '}']) || after[digits..].trim().is_empty();
        let number = line_start + start..line_start + comma + 1 + digits;
        (is_value && is_end && start < comma && digits > 0).then(|| (number.clone(), text[number].replace(',', ".")))
    })
}

/// Returns the position of the first bracket that is nested too deep. A bracket of the other kind closes nothing.
fn too_deep(text: &str) -> Option<usize> {
    let mut open = Vec::with_capacity(DEPTH_MAX + 1);
    let mut tokens = Source::new(text).lex();
    let token = tokens.find(|token| {
        let kind = token.kind();
        match kind {
            TokenKind::LeftSquareBracket | TokenKind::LeftCurlyBracket => open.push(kind),
            TokenKind::RightSquareBracket => _ = open.pop_if(|last| *last == TokenKind::LeftSquareBracket),
            TokenKind::RightCurlyBracket => _ = open.pop_if(|last| *last == TokenKind::LeftCurlyBracket),
            _ => {}
        }
        open.len() > DEPTH_MAX
    });
    token.map(|token| token.span().start())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Table;
    use crate::row::*;

    keys! { press {
        hold_s: Number(within(0.0, 10.0, "s")), or(0.0), "a dwell", "1.0";
        sample_s: Number(within(0.0, 10.0, "s")), or(0.1), "a window", "0.1";
        force_n: Number(within(0.0, 2.0, "N")), Refused, "a force", "1.0";
    } }

    keys! { a {
        x: Number(within(0.0, 1.0, "mm")), Refused, "a place", "0.0";
        y: Number(within(0.0, 1.0, "mm")), Refused, "a place", "0.0";
    } }

    keys! { outer {
        a: Table(&a::KEYS), Refused, "a table";
    } }

    keys! { lists {
        a: Wholes(0, 1), Allowed, "ones and zeros", "[0, 1]";
    } }

    keys! { any {
        x: Text, Allowed, "anything", "";
        y: Text, Allowed, "anything", "";
    } }

    const NONE: &Keys = &Keys::of(&[]);

    fn messages(text: &str, keys: &'static Keys, ask: impl FnOnce(&Table) -> Option<()>) -> Vec<String> {
        match read("test.toml", text, keys, ask) {
            Ok(()) => Vec::new(),
            Err(problems) => problems.lines(),
        }
    }

    #[test]
    fn all_problems_are_reported_at_once_each_at_its_line() {
        let text = "hold_s = -1.0\nsample = 0.1\nforce_n = \"1 N\"\n";
        let words = messages(text, &press::KEYS, |table| {
            table.number(&press::hold_s);
            table.number(&press::sample_s);
            table.number(&press::force_n);
            Some(())
        });
        assert_eq!(
            words,
            [
                "test.toml:1:10: `hold_s` is -1, must be 0 to 10 s",
                "test.toml:2:1: unknown key `sample`",
                "test.toml:3:11: `force_n` is a string, expected a number in N",
            ]
        );
    }

    #[test]
    fn nan_is_refused_and_a_missing_key_points_at_its_table() {
        let text = messages("[a]\nx = nan\n", &outer::KEYS, |table| {
            let table = table.table(&outer::a)?;
            table.number(&a::x);
            table.number(&a::y);
            Some(())
        });
        assert_eq!(
            text,
            [
                "test.toml:1:1: `y` is missing in `a`: a number in mm, 0 to 1",
                "test.toml:2:5: `x` is not a finite number",
            ]
        );
    }

    #[test]
    fn unclosed_brackets_do_not_overflow_the_stack() {
        for open in ["x = [", "d = { f its\n\n[l]\n", "a={b={", "[[[[", "d = { f [l]]\n", "d = { [ } ]\n"] {
            let words = messages(&open.repeat(100_000), NONE, |_| Some(()));
            assert!(words[0].contains("not valid TOML"), "{open:?}: {}", words[0]);
        }
        let brackets = |depth: usize| format!("x = {}{}\n", "[".repeat(depth), "]".repeat(depth));
        let words = |text: &str| messages(text, &any::KEYS, |_| Some(()));
        assert_eq!(words(&brackets(DEPTH_MAX)), [""; 0]);
        assert_eq!(
            words(&brackets(DEPTH_MAX + 1)),
            ["test.toml:1:37: not valid TOML: more than 32 brackets are open here"]
        );
        // none of these is open
        assert_eq!(words(&format!("x = \"{0}\" # {0}\ny = '{0}'\n", "[{".repeat(99))), [""; 0]);
    }

    #[test]
    fn problem_far_along_a_line_is_reported_without_the_line() {
        let far = |name: &str| {
            let text = format!("a = [{}\"{name}\"]\n", "0, ".repeat(30_000));
            let problems = read("t.toml", &text, &lists::KEYS, |table| {
                table.wholes(&lists::a);
                Some(())
            });
            problems.unwrap_err().into_reports().map(|report| format!("{report:?}")).collect::<String>()
        };
        let words = far("x");
        assert!(words.len() < 1000 && words.contains("t.toml:1:"), "{words}");
        let words = messages("\"a\\u001b[2J\" = 1\n", NONE, |_| Some(()));
        assert_eq!(words, ["test.toml:1:1: unknown key `a\\u{1b}[2J`"]);
        let problem = Problem::new(0..1, "told").help("a\tb");
        assert_eq!(problem.help.as_deref(), Some("a\\tb"));
        let report = Problems::new("t", "a\u{1b}[2J = 1\u{9b}2J", vec![problem]).into_reports().next().unwrap();
        let shown = format!("{report:?}");
        assert!(shown.contains("a?[2J = 1??2J"), "{shown}");
    }

    #[test]
    fn number_of_reported_problems_is_bounded() {
        let text = messages(&"a.b = 1\n".repeat(5000).replace("a.b", "\"\"\"x"), NONE, |_| Some(()));
        assert!(text.len() <= PROBLEMS_MAX + 1, "{}", text.len());
        let keys: String = (0..5000).map(|i| format!("k{i} = 1\n")).collect();
        let text = messages(&keys, NONE, |_| Some(()));
        assert_eq!(text.len(), PROBLEMS_MAX + 1);
        assert!(text[PROBLEMS_MAX].ends_with("there are more problems"), "{}", text[PROBLEMS_MAX]);
    }

    #[test]
    fn invalid_toml_is_reported_with_its_probable_meaning() {
        let words = |text: &str| read("t.toml", text, &outer::KEYS, |_| Some(())).unwrap_err().lines();
        assert_eq!(words("name = \"a\"\nx = 0,5\n"), ["t.toml:2:5: a number has a decimal point, not a comma"]);
        let both = words("a = { z = -12.5, u = 0,3 }\nb = { u = 0,3, z = 1 } # 0,5\n");
        assert_eq!(both[0], "t.toml:1:22: a number has a decimal point, not a comma");
        assert_eq!(both[1..], ["t.toml:2:11: a number has a decimal point, not a comma"]);
        for text in ["a = \"x = 0,5\" y\n", "a = [1,5\n", "a = { b = 1,2 = }\n", "a = x # y = 0,5\n"] {
            assert!(words(text)[0].contains("not valid TOML"), "{text}");
        }
        // a character of several bytes right before the number
        for text in ["x = {\u{fffd}2, y = 3\n", "x = \u{2003}2,5\n"] {
            assert!(words(text)[0].contains("not valid TOML"), "{text}");
        }
        let steps = "[step]\na = 1\n[step]\na = 2\n[step]\na = 3\n";
        assert_eq!(words(steps), ["t.toml:3:2: [step] is here a second time"]);
        assert_eq!(words("a = 1\n# b\na = 2\n"), ["t.toml:3:1: `a` is here a second time, after line 1"]);
        for value in ["2.0 N", "2.0N", "-3 mm", "50 %"] {
            assert_eq!(
                words(&format!("name = {value}\n")),
                ["t.toml:1:8: a number with a unit: only the number is allowed"]
            );
        }
        assert!(words("name = N\n")[0].contains("not valid TOML"));
    }

    #[test]
    fn a_heading_that_comes_twice_is_reported_with_the_brackets_that_it_needs() {
        let words = |text: &str| {
            let problems = read("t.toml", text, &outer::KEYS, |_| Some(())).unwrap_err();
            problems.text().map(|(line, help)| (line, help.unwrap_or_default().to_owned())).collect::<Vec<_>>()
        };
        // a table that exists once
        let once = words("[a]\nx = 0.5\n[a] # again\ny = 0.5\n");
        assert_eq!(
            once,
            [("t.toml:3:2: [a] is here a second time".to_owned(), "put all its keys under one [a]".to_owned())]
        );
        // a value, then a table
        let value = words("a = \"none\"\n[a]\nx = 0.5\n");
        assert_eq!(value.len(), 1, "{value:?}");
        assert_eq!(value[0].0, "t.toml:2:2: [a] is a table here, but line 1 gives `a` a value");
        // single brackets first
        let single = words("[step] # one\na = 1\n[[step]]\na = 2\n[[step]]\na = 3\n");
        assert_eq!(single.len(), 1, "{single:?}");
        assert_eq!(single[0].0, "t.toml:1:1: [step] has single brackets, but [[step]] follows");
        assert!(single[0].1.contains("write [[step]] with double brackets"), "{single:?}");
    }

    #[test]
    fn only_the_first_error_of_the_syntax_is_reported() {
        let text = "a = { x = [-12.5, 12.5, y = [-12.5, 12.5], z = [1.0, 2.0] }\nb = 2\n";
        let words = messages(text, NONE, |_| Some(()));
        assert_eq!(words.len(), 1, "{words:?}");
    }

    #[test]
    fn a_name_with_another_unit_is_reported_to_convert_its_number() {
        let help = |name: &str| {
            let text = format!("{name} = 1\nforce_n = 1.0\n");
            let problems = read("t.toml", &text, &press::KEYS, |table| table.number(&press::force_n)).unwrap_err();
            problems.text().next().and_then(|(_, help)| help.map(str::to_owned)).unwrap_or_default()
        };
        assert_eq!(help("hold_min"), "did you mean `hold_s`? Convert the number: the unit is in the key's name");
        assert_eq!(help("hold_ms"), "did you mean `hold_s`? Convert the number: the unit is in the key's name");
        assert_eq!(help("hodl_s"), "did you mean `hold_s`?");
        assert_eq!(help("hold_x"), "did you mean `hold_s`?");
    }

    #[test]
    fn positions_are_those_of_each_table_of_a_list() {
        let text = "x = 1\n[a]\nx = 2\n[[b]]\nx = 3\n[[b]]\nx = 4\n[[b]]\ny = 5\n";
        let values = |path: &[&str]| positions(text, path).into_iter().map(|span| &text[span]).collect::<Vec<_>>();
        assert_eq!((values(&["x"]), values(&["a", "x"]), values(&["b", "x"])), (vec!["1"], vec!["2"], vec!["3", "4"]));
        assert!(values(&["a", "y"]).is_empty() && positions("x", &["x"]).is_empty());
    }

    #[test]
    fn a_string_is_found_in_the_table_that_it_slipped_into() {
        let text = "[a]\ny = 1\n[b]\nx = \"none\"\n";
        assert_eq!(text_in_table(text, "x"), Some(("b".to_owned(), 14..15)));
        assert_eq!((text_in_table(text, "y"), text_in_table("x = 1\n[b]\nx = \"none\"\n", "x")), (None, None));
    }

    #[test]
    fn broken_toml_is_reported_with_its_place() {
        let text = messages("a = [1,\nb = 2\n", NONE, |_| Some(()));
        assert!(text[0].starts_with("test.toml:"), "{text:?}");
        assert!(text[0].contains("not valid TOML"), "{text:?}");
    }
}
