//! A TOML text read with every problem kept, each at its place.
//!
//! Recipes and rigs are read through a [`Table`]: each question for a key either answers or records a [`Problem`] and goes on,
//! so that a person sees all that is wrong at once, with the line, what was expected and the nearest right spelling.

mod problem;
mod table;

pub use problem::{Problem, Problems};
pub use table::{Bounds, Span, Table};
pub(crate) use table::{all, with_nearest};

use problem::Collector;
use toml::de::DeTable;

/// Longest text that is read as a recipe or a rig, bytes: a hundred times the longest list a person would write by hand.
pub const TEXT_MAX_BYTES: usize = 4 << 20;

/// Most problems of a text that are told: who has more corrects these first.
pub const PROBLEMS_MAX: usize = 100;

/// Reads a TOML text with `read`, which asks a root [`Table`] for what it needs. Keys nobody asked for are problems too.
///
/// `name` is the file's name as it stands in messages.
///
/// # Errors
/// All problems of the text, in the order of their places.
pub fn read<T>(name: &str, text: &str, read: impl FnOnce(&mut Table) -> Option<T>) -> Result<T, Problems> {
    let collector = Collector::default();
    if text.len() > TEXT_MAX_BYTES {
        collector.add(Problem::new(0..0, format!("the text is {} bytes long, over {TEXT_MAX_BYTES}", text.len())));
        return Err(collector.into_problems(name, ""));
    }
    let (root, errors) = DeTable::parse_recoverable(text);
    for error in &errors {
        let place = error.span().unwrap_or(0..0);
        collector.add(Problem::new(place, format!("not TOML: {}", error.message())));
    }
    if !errors.is_empty() {
        return Err(collector.into_problems(name, text));
    }
    let mut table = Table::root(&root, &collector);
    let value = read(&mut table);
    table.finish();
    match value {
        Some(value) if collector.is_empty() => Ok(value),
        _ => Err(collector.into_problems(name, text)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn messages(text: &str, ask: impl FnOnce(&mut Table) -> Option<()>) -> Vec<String> {
        match read("test.toml", text, ask) {
            Ok(()) => Vec::new(),
            Err(problems) => problems.lines(),
        }
    }

    #[test]
    fn all_problems_are_told_at_once_each_at_its_line() {
        let text = "hold_s = -1.0\nsample = 0.1\nforce_n = \"1 N\"\n";
        let told = messages(text, |table| {
            table.number("hold_s", Bounds::within(0.0, 10.0, "s"));
            table.number("sample_s", Bounds::within(0.0, 10.0, "s"));
            table.require_number("force_n", Bounds::within(0.0, 2.0, "N"));
            Some(())
        });
        assert_eq!(
            told,
            [
                "test.toml:1:10: `hold_s` is -1, must be 0 to 10 s",
                "test.toml:2:1: unknown key `sample`",
                "test.toml:3:11: `force_n` is a string, expected a number in N",
            ]
        );
    }

    #[test]
    fn nan_is_refused_and_a_missing_key_points_at_its_table() {
        let told = messages("[a]\nx = nan\n", |table| {
            let mut a = table.require_table("a")?;
            a.require_number("x", Bounds::within(0.0, 1.0, "mm"));
            a.require_number("y", Bounds::within(0.0, 1.0, "mm"));
            a.finish();
            Some(())
        });
        assert_eq!(
            told,
            [
                "test.toml:1:1: `y` is missing in `a`: a number in mm, 0 to 1",
                "test.toml:2:5: `x` is not a finite number",
            ]
        );
    }

    #[test]
    fn broken_toml_is_told_with_its_place() {
        let told = messages("a = [1,\nb = 2\n", |_| Some(()));
        assert!(told[0].starts_with("test.toml:"), "{told:?}");
        assert!(told[0].contains("not TOML"), "{told:?}");
    }
}
