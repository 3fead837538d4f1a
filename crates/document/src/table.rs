//! Reads the listed keys of one table of a text.

use super::key::{Absent, Bounds, Case, DefaultValue, Key, Keys, ValueKind};
use super::problem::{Collector, Problem};
use jiff::civil::Date;
use palpate_core::quantity::{Place, Range};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Earliest year of a date. No instrument's certificate is older.
const YEAR_LEAST: i16 = 1900;

/// Position of a value in its text, bytes.
pub type Span = std::ops::Range<usize>;

/// Least similarity (Jaro-Winkler, 0 to 1) at which a known name is suggested for an unknown one.
const SIMILAR: f64 = 0.75;

/// One table of a text. A request for a [`Key`] of its list returns the value, or the key's default if the key is missing. An
/// invalid key, or a missing key without default, is recorded as a problem, and the request returns `None`.
pub struct Table<'d> {
    table: &'d DeTable<'d>,
    keys: &'static Keys,
    collector: &'d Collector,
    path: String,
    span: Span,
}

impl<'d> Table<'d> {
    pub(super) fn root(root: &'d Spanned<DeTable<'d>>, keys: &'static Keys, collector: &'d Collector) -> Self {
        Table { table: root.get_ref(), keys, collector, path: String::new(), span: 0..0 }
    }

    /// Returns the position of the table.
    pub fn span(&self) -> Span {
        self.span.clone()
    }

    /// Records a problem.
    pub fn complain(&self, problem: Problem) {
        self.collector.add(problem);
    }

    /// Whether the key exists.
    pub fn has(&self, key: &Key) -> bool {
        self.ask(key);
        self.find(key.name).is_some()
    }

    /// Whether the key exists and is a string.
    pub fn is_text(&self, key: &Key) -> bool {
        self.find(key.name).is_some_and(|value| value.get_ref().is_str())
    }

    /// Whether the key exists and is a table.
    pub fn is_table(&self, key: &Key) -> bool {
        self.find(key.name).is_some_and(|value| value.get_ref().is_table())
    }

    /// Whether the key is a table that has a key of this name.
    pub fn inner_has(&self, key: &Key, inner: &Key) -> bool {
        let table = self.find(key.name).and_then(|value| value.get_ref().as_table());
        table.is_some_and(|table| table.keys().any(|name| name.get_ref() == inner.name))
    }

    /// Whether the key is present and a list.
    pub fn is_list(&self, key: &Key) -> bool {
        self.find(key.name).is_some_and(|value| value.get_ref().is_array())
    }

    /// Whether the key exists and is exactly this string.
    pub fn text_is(&self, key: &Key, text: &str) -> bool {
        self.find(key.name).and_then(|value| value.get_ref().as_str()) == Some(text)
    }

    /// Returns the position of the key's value, or of the table if the key is missing.
    pub fn span_of(&self, key: &Key) -> Span {
        self.find(key.name).map_or(self.span(), |value| value.span())
    }

    /// Returns the name of the table's case, chosen by the first of the case's keys; `None` without any of them.
    pub fn case(&self) -> Option<&'static str> {
        self.keys.cases.iter().find(|case| self.find(case.name).is_some()).map(|case| case.name)
    }

    /// Records a problem if the key is missing, because this table requires it. Returns whether the key exists.
    pub fn require(&self, key: &Key) -> bool {
        self.require_as(key, &expected(key))
    }

    /// Requires a key in the same way; `expected` describes its value.
    pub fn require_as(&self, key: &Key, expected: &str) -> bool {
        let there = self.has(key);
        // a misspelt key is one problem, which names the right one
        if !there && !self.is_misspelt(key) {
            let text = format!("`{}` is missing{}: {expected}", key.name, self.place());
            let problem = Problem::new(self.span(), text);
            self.complain(match key.example {
                "" => problem,
                example => problem.help(format!("for example {} = {example}", key.name)),
            });
        }
        there
    }

    /// Reads a number.
    pub fn number(&self, key: &Key) -> Option<f64> {
        match self.get(key) {
            Some(value) => self.number_of(key, value, bounds(key)),
            None => key.default().and_then(DefaultValue::number),
        }
    }

    /// Reads several numbers, so that each problem is reported; `None` if one of them is missing.
    pub fn numbers<const N: usize>(&self, keys: [Key; N]) -> Option<[f64; N]> {
        let read = keys.map(|key| self.number(&key));
        read.iter().all(Option::is_some).then(|| read.map(Option::unwrap_or_default))
    }

    /// Reads a number, with another default than the key's own.
    pub fn number_or(&self, key: &Key, default: f64) -> Option<f64> {
        if self.has(key) { self.number(key) } else { Some(default) }
    }

    /// Reads an integer.
    pub fn whole(&self, key: &Key) -> Option<u64> {
        let (min, max) = whole(key);
        self.whole_within(key, min, max)
    }

    /// Reads an integer that the rest of the text limits to `min` to `max`.
    pub fn whole_within(&self, key: &Key, min: u64, max: u64) -> Option<u64> {
        match self.get(key) {
            Some(value) => self.whole_of(key, value, min, max),
            None => key.default().and_then(DefaultValue::whole),
        }
    }

    /// Reads a list of integers.
    pub fn wholes(&self, key: &Key) -> Option<Vec<u64>> {
        let (min, max) = whole(key);
        let items = self.list(key, self.get(key)?, "a list of whole numbers")?;
        all(items.map(|item| self.whole_of(key, item, min, max)))
    }

    /// Reads true or false.
    pub fn flag(&self, key: &Key) -> Option<bool> {
        match self.get(key) {
            Some(value) => value.get_ref().as_bool().or_else(|| self.wrong_kind(key, value, "true or false")),
            None => key.default().and_then(DefaultValue::flag),
        }
    }

    /// Reads a string.
    pub fn text(&self, key: &Key) -> Option<&'d str> {
        match self.get(key) {
            Some(value) => self.text_of(key, value),
            None => key.default().and_then(DefaultValue::word),
        }
    }

    /// Reads a date as year-month-day.
    pub fn day(&self, key: &Key) -> Option<&'d str> {
        let text = self.text(key)?;
        if text.parse::<Date>().is_ok_and(|date| date.to_string() == text && date.year() >= YEAR_LEAST) {
            return Some(text);
        }
        let words = format!("`{}` is {text:?}, expected a day as year-month-day, \"2026-05-04\"", key.name);
        self.complain(Problem::new(self.span_of(key), words));
        None
    }

    /// Reads a list of strings.
    pub fn texts(&self, key: &Key) -> Option<Vec<&'d str>> {
        match self.get(key) {
            Some(value) => all(self.list(key, value, "a list of strings")?.map(|item| self.text_of(key, item))),
            None => key.default().and_then(DefaultValue::texts),
        }
    }

    /// Reads one of the key's words and returns its meaning.
    pub fn word<T: Copy>(&self, key: &Key, meanings: &[(&'static str, T)]) -> Option<T> {
        let known = known_words(key);
        debug_assert!(meanings.iter().all(|(word, _)| known.contains(word)), "`{}` has an invalid value", key.name);
        let word = match self.get(key) {
            Some(value) => {
                let text = self.text_of(key, value)?;
                if !known.contains(&text) {
                    let tables = key.inner().map(table_list).unwrap_or_default();
                    let words = format!("`{}` is \"{text}\", expected one of {}{tables}", key.name, listed(known));
                    let problem = Problem::new(value.span(), words).help(format!("`{}`: {}", key.name, key.meaning));
                    self.complain(with_typo(problem, text, known));
                }
                text
            }
            None => key.default().and_then(DefaultValue::word)?,
        };
        meanings.iter().find(|(known, _)| *known == word).map(|(_, value)| *value)
    }

    /// Reads one of the key's words, with another default than the key's own.
    pub fn word_or<T: Copy>(&self, key: &Key, meanings: &[(&'static str, T)], default: T) -> Option<T> {
        if self.has(key) { self.word(key, meanings) } else { Some(default) }
    }

    /// Reads a list of some of the key's words, without unknown words.
    pub fn words(&self, key: &Key) -> Option<Vec<&'d str>> {
        let known = known_words(key);
        let Some(value) = self.get(key) else {
            return key.default().and_then(DefaultValue::texts);
        };
        let chosen = self.list(key, value, "a list of strings")?.filter_map(|item| {
            let word = self.text_of(key, item)?;
            if !known.contains(&word) {
                let text = format!("`{}` has \"{word}\", expected some of {}", key.name, known.join(", "));
                self.complain(with_typo(Problem::new(item.span(), text), word, known));
                return None;
            }
            Some(word)
        });
        Some(chosen.collect())
    }

    /// Reads an interval.
    pub fn range(&self, key: &Key) -> Option<Range> {
        let Some(value) = self.get(key) else {
            return key.default().and_then(DefaultValue::range);
        };
        let ends = self.numbers_of(key, value)?;
        match ends[..] {
            [min, max] if min <= max => Some(Range { min, max }),
            [min, max] => {
                self.fail(value, format!("`{}` has its first number above the second: {min} to {max}", key.name))
            }
            _ => self.fail(value, format!("`{}` has {} numbers, expected [from, to]", key.name, ends.len())),
        }
    }

    /// Reads a number or a list of numbers.
    pub fn number_or_list(&self, key: &Key) -> Option<Vec<f64>> {
        let value = self.get(key)?;
        match value.get_ref().is_array() {
            true => self.numbers_of(key, value),
            false => self.number_of(key, value, bounds(key)).map(|number| vec![number]),
        }
    }

    /// Reads a list of numbers, one for each unit. `units` is their number, if it is known.
    pub fn per_unit(&self, key: &Key, units: Option<usize>) -> Option<Vec<f64>> {
        let value = self.get(key)?;
        if value.get_ref().is_array() {
            return self.numbers_of(key, value);
        }
        let count =
            units.map_or("one number for each unit".to_owned(), |units| format!("{units} numbers, one for each unit"));
        self.wrong_kind(key, value, &format!("a list of {count}"))
    }

    /// Reads a list of places, each with its position in the text.
    pub fn places(&self, key: &Key) -> Option<Vec<(Place, Span)>> {
        let items = self.list(key, self.get(key)?, "a list of lists")?;
        all(items.map(|item| match item.get_ref().as_array().map(|numbers| numbers.iter().collect::<Vec<_>>()) {
            Some(numbers) if numbers.len() == 2 => {
                let xy = all(numbers.into_iter().map(|number| self.number_of(key, number, bounds(key))))?;
                Some((Place::new(xy[0], xy[1]), item.span()))
            }
            _ => self.fail(item, format!("expected 2 numbers in each entry of `{}`", key.name)),
        }))
    }

    /// Reads a matrix of three rows with three numbers each.
    pub fn matrix(&self, key: &Key) -> Option<[[f64; 3]; 3]> {
        let value = self.get(key)?;
        let rows = all(self.list(key, value, "three lists of three numbers")?.map(|row| self.numbers_of(key, row)))?;
        let rows: Option<Vec<[f64; 3]>> = rows.into_iter().map(|row| row.try_into().ok()).collect();
        match rows.and_then(|rows| rows.try_into().ok()) {
            Some(matrix) => Some(matrix),
            None => self.fail(value, format!("`{}` must have three lists of three numbers", key.name)),
        }
    }

    /// Reads three rows with as many numbers each.
    pub fn rows(&self, key: &Key) -> Option<[Vec<f64>; 3]> {
        let value = self.get(key)?;
        let rows = all(self.list(key, value, "three lists of numbers")?.map(|row| self.numbers_of(key, row)))?;
        match <[Vec<f64>; 3]>::try_from(rows) {
            Ok(rows) if rows.iter().all(|row| row.len() == rows[0].len()) => Some(rows),
            _ => self.fail(value, format!("`{}` must have three lists with as many numbers each", key.name)),
        }
    }

    /// Reads a table inside this one.
    pub fn table(&self, key: &Key) -> Option<Table<'d>> {
        let value = self.get(key)?;
        self.table_of(key, value)
    }

    /// Reads a list of tables (`[[key]]`), empty without the key.
    pub fn tables(&self, key: &Key) -> Vec<Table<'d>> {
        let items = self.get(key).and_then(|value| self.list(key, value, TABLES));
        items.into_iter().flatten().filter_map(|item| self.table_of(key, item)).collect()
    }

    /// Records a problem for every key that isn't in the list, with the most similar key in the list. Also records a problem for
    /// every key that belongs to another case of the table.
    pub(super) fn check_names(&self) {
        let known: Vec<&str> = self.keys.all().map(|key| key.name).collect();
        let chosen = self.keys.by.map(|by| self.find(by.name).and_then(|value| value.get_ref().as_str()));
        let is_case = |case: &&Case| match chosen {
            Some(word) => word == Some(case.name),
            None => self.find(case.name).is_some(),
        };
        let cases: Vec<&Case> = self.keys.cases.iter().filter(is_case).collect();
        // a table whose case isn't known has a problem that its reader reports
        let undecided = match (self.keys.by, chosen) {
            (Some(by), Some(word)) => !word.is_some_and(|word| known_words(&by).contains(&word)),
            _ => cases.is_empty(),
        };
        for key in self.table.keys() {
            let name = key.get_ref().as_ref();
            let is_in = |keys: &[Key]| keys.iter().any(|key| key.name == name);
            if !known.contains(&name) {
                let problem = Problem::new(key.span(), format!("unknown key `{name}`{}", self.place()));
                self.complain(with_nearest(problem, name, &known));
            } else if !undecided && !is_in(self.keys.always) && !cases.iter().any(|case| is_in(case.keys)) {
                let others = self.keys.cases.iter().filter(|case| is_in(case.keys)).map(|case| case.name);
                let text = format!("`{name}`{} can't be used here", self.place());
                let help = format!("it requires {}", others.collect::<Vec<_>>().join(", "));
                self.complain(Problem::new(key.span(), text).help(help));
            }
        }
    }

    /// Whether a key of the table is unknown and most similar to this one.
    fn is_misspelt(&self, key: &Key) -> bool {
        let known: Vec<&str> = self.keys.all().map(|key| key.name).collect();
        let names = self.table.keys().map(|key| key.get_ref().as_ref());
        names.filter(|name| !known.contains(name)).any(|name| nearest(name, &known) == Some(key.name))
    }

    fn place(&self) -> String {
        if self.path.is_empty() { String::new() } else { format!(" in `{}`", self.path) }
    }

    fn ask(&self, key: &Key) {
        debug_assert!(self.keys.all().any(|listed| listed == key), "`{}`{} isn't in the list", key.name, self.place());
        super::sample::note(&self.path, key.name);
    }

    fn find(&self, name: &str) -> Option<&'d Spanned<DeValue<'d>>> {
        self.table.iter().find(|(key, _)| key.get_ref() == name).map(|(_, value)| value)
    }

    /// Returns the key's value. Records a problem if a required key is missing.
    fn get(&self, key: &Key) -> Option<&'d Spanned<DeValue<'d>>> {
        self.ask(key);
        if key.absent == Absent::Refused {
            self.require(key);
        }
        self.find(key.name)
    }

    fn table_of(&self, key: &Key, value: &'d Spanned<DeValue<'d>>) -> Option<Table<'d>> {
        let Some(table) = value.get_ref().as_table() else { return self.wrong_kind(key, value, "a table") };
        let path = if self.path.is_empty() { key.name.to_owned() } else { format!("{}.{}", self.path, key.name) };
        let keys = key.inner()?;
        let inner = Table { table, keys, collector: self.collector, path, span: value.span() };
        inner.check_names();
        Some(inner)
    }

    fn list(
        &self,
        key: &Key,
        value: &'d Spanned<DeValue<'d>>,
        expected: &str,
    ) -> Option<impl Iterator<Item = &'d Spanned<DeValue<'d>>> + use<'d>> {
        match value.get_ref().as_array() {
            Some(items) => Some(items.iter()),
            None => self.wrong_kind(key, value, expected),
        }
    }

    fn text_of(&self, key: &Key, value: &'d Spanned<DeValue<'d>>) -> Option<&'d str> {
        value.get_ref().as_str().or_else(|| self.wrong_kind(key, value, "a string"))
    }

    fn numbers_of(&self, key: &Key, value: &'d Spanned<DeValue<'d>>) -> Option<Vec<f64>> {
        let bounds = bounds(key);
        let items = self.list(key, value, &format!("a list of numbers{}", bounds.in_unit()))?;
        all(items.map(|item| self.number_of(key, item, bounds)))
    }

    fn whole_of(&self, key: &Key, value: &Spanned<DeValue<'d>>, min: u64, max: u64) -> Option<u64> {
        let whole = value.get_ref().as_integer().map(|i| i64::from_str_radix(i.as_str(), i.radix()));
        match whole {
            Some(Ok(n)) if n >= 0 && (min..=max).contains(&(n as u64)) => Some(n as u64),
            Some(Ok(0))
                if min == 1 && key.kind.pick(|kind| matches!(kind, ValueKind::Wholes(..)).then_some(())).is_some() =>
            {
                let text = format!("`{}` has 0, must be {min} to {max}", key.name);
                self.complain(Problem::new(value.span(), text).help("the first is 1"));
                None
            }
            Some(Ok(n)) => self.fail(value, format!("`{}` is {n}, must be {min} to {max}", key.name)),
            Some(Err(_)) => self.fail(value, format!("`{}` must be {min} to {max}", key.name)),
            None => self.wrong_kind(key, value, "a whole number"),
        }
    }

    fn number_of(&self, key: &Key, value: &Spanned<DeValue<'d>>, bounds: Bounds) -> Option<f64> {
        let number = match value.get_ref() {
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|n| n as f64),
            DeValue::Float(x) => x.as_str().parse::<f64>().ok(),
            _ => return self.wrong_kind(key, value, &format!("a number{}", bounds.in_unit())),
        };
        let name = key.name;
        match number {
            Some(n) if !n.is_finite() => self.fail(value, format!("`{name}` is not a finite number")),
            Some(n) if bounds.admit(n) => Some(n),
            Some(n) => {
                let text = format!("`{name}` is {n}, must be {} {}", bounds.interval(), bounds.unit());
                self.complain(Problem::new(value.span(), text.trim_end()).help(format!("`{name}`: {}", key.meaning)));
                None
            }
            None => self.fail(value, format!("`{name}` is too large a number")),
        }
    }

    fn wrong_kind<T>(&self, key: &Key, value: &Spanned<DeValue<'d>>, expected: &str) -> Option<T> {
        let kind = value.get_ref().type_str();
        let article = if kind.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
        let problem = Problem::new(value.span(), format!("`{}` is {article} {kind}, expected {expected}", key.name));
        let text = value.get_ref().as_str().map(str::trim);
        let is_quoted = text.is_some_and(|text| text.starts_with(['{', '[']) || text.parse::<f64>().is_ok());
        let helped =
            expected.contains(" in ") && text.is_some_and(|text| text.starts_with(|c: char| c.is_ascii_digit()));
        let is_one_table = expected == TABLES && value.get_ref().is_table();
        self.complain(match (helped, is_one_table) {
            _ if is_quoted => problem.help("remove the quotes"),
            (true, _) => problem.help("the unit is in the key's name: write only the number"),
            _ if value.get_ref().is_datetime() => problem.help("write it in quotes: \"2026-05-04\""),
            (_, true) => problem.help(format!("write [[{}]] with double brackets, also for a single one", key.name)),
            _ => problem,
        });
        None
    }

    fn fail<T>(&self, value: &Spanned<DeValue<'d>>, message: String) -> Option<T> {
        self.complain(Problem::new(value.span(), message));
        None
    }
}

/// Describes the tables that are allowed instead of a word, by the key that selects each.
fn table_list(keys: &Keys) -> String {
    let each = |key: &Key| {
        let own = match key.kind {
            ValueKind::Texts => "[...]",
            _ => "...",
        };
        format!("{{ {} = {own} }}", key.name)
    };
    let first: Vec<String> = keys.cases.iter().filter_map(|case| case.keys.first()).map(each).collect();
    if first.is_empty() { String::new() } else { format!(", or a table: {}", first.join(", ")) }
}

/// Description of a list of tables.
const TABLES: &str = "a list of tables";

/// Describes the expected value of a missing key.
fn expected(key: &Key) -> String {
    let of = |kind: &ValueKind| match kind {
        ValueKind::Number(bounds) => Some(format!("a number{}, {}", bounds.in_unit(), bounds.interval())),
        ValueKind::Range(bounds) => Some(format!("[from, to]{}", bounds.in_unit())),
        ValueKind::Numbers(bounds) => Some(format!("a number or a list{}", bounds.in_unit())),
        ValueKind::PerUnit(bounds) => Some(format!("a list with one {} per unit", bounds.unit())),
        ValueKind::Places(_) => Some("[[x, y], ...]".to_owned()),
        ValueKind::Matrix(_) => Some("three lists of three numbers".to_owned()),
        ValueKind::Rows(_) => Some("three lists of numbers".to_owned()),
        ValueKind::Whole(min, max) => Some(format!("a whole number, {min} to {max}")),
        ValueKind::Word(words) => Some(format!("one of {}", listed(words))),
        ValueKind::Table(keys) => Some(format!("a table{}", with_keys(keys))),
        ValueKind::Tables(keys) => Some(format!("a list: [[{}]]{}", key.name, with_keys(keys))),
        _ => None,
    };
    key.kind.pick(of).unwrap_or_else(|| key.meaning.to_owned())
}

/// Lists words. A list with signs, such as a comma, has quotes.
fn listed(words: &[&str]) -> String {
    let is_sign = |word: &&str| !word.contains(char::is_alphanumeric);
    match words.iter().any(is_sign) {
        true => words.iter().map(|word| format!("\"{word}\"")).collect::<Vec<_>>().join(", "),
        false => words.join(", "),
    }
}

/// Describes the keys that a table must have, and those of which it must have one.
fn with_keys(keys: &Keys) -> String {
    let required = keys.always.iter().filter(|key| key.absent == Absent::Refused);
    let mut names: Vec<String> = required.map(|key| format!("`{}`", key.name)).collect();
    if keys.by.is_none() && !keys.cases.is_empty() {
        let cases: Vec<String> = keys.cases.iter().map(|case| format!("`{}`", case.name)).collect();
        names.push(cases.join(" or "));
    }
    if names.is_empty() { String::new() } else { format!(" with {}", names.join(", ")) }
}

/// Returns the bounds of a key's numbers in the list of keys. A program that asks for a number where the list has none is wrong.
fn bounds(key: &Key) -> Bounds {
    let bounds = key.kind.pick(|kind| match kind {
        ValueKind::Number(bounds)
        | ValueKind::Range(bounds)
        | ValueKind::Numbers(bounds)
        | ValueKind::PerUnit(bounds)
        | ValueKind::Places(bounds)
        | ValueKind::Matrix(bounds)
        | ValueKind::Rows(bounds) => Some(*bounds),
        _ => None,
    });
    bounds.unwrap_or_else(|| unreachable!("`{}` isn't a number", key.name))
}

fn whole(key: &Key) -> (u64, u64) {
    let ends = key.kind.pick(|kind| match kind {
        ValueKind::Whole(min, max) | ValueKind::Wholes(min, max) => Some((*min, *max)),
        _ => None,
    });
    ends.unwrap_or_else(|| unreachable!("`{}` isn't a whole number", key.name))
}

fn known_words(key: &Key) -> &'static [&'static str] {
    let words = key.kind.pick(|kind| match kind {
        ValueKind::Word(words) | ValueKind::Words(words) => Some(*words),
        _ => None,
    });
    words.unwrap_or_else(|| unreachable!("`{}` isn't a word", key.name))
}

/// Returns all answers, or `None` if one is missing. Every answer is requested, so that every problem is reported.
pub fn all<T>(answers: impl Iterator<Item = Option<T>>) -> Option<Vec<T>> {
    let answers: Vec<Option<T>> = answers.collect();
    answers.into_iter().collect()
}

/// Reads a table that may be missing. The outer value is `None` if the table is present and invalid.
pub fn optional<T>(table: Option<Table>, read: impl FnOnce(&Table) -> Option<T>) -> Option<Option<T>> {
    match table {
        None => Some(None),
        Some(table) => read(&table).map(Some),
    }
}

/// Adds a value as help if the text is a misspelling of this value. A value determines the meaning of the data. So for any other
/// text the message only lists the values.
fn with_typo(problem: Problem, text: &str, known: &[&str]) -> Problem {
    match misspelt(text, known) {
        Some(value) => problem.help(format!("did you mean `{value}`?")),
        None => problem,
    }
}

/// Returns the value of which a text is clearly a misspelling: at most 2 edits, fewer than for any other value, and the same first
/// letter.
pub fn misspelt<'k>(text: &str, known: &[&'k str]) -> Option<&'k str> {
    /// Largest number of letters that are changed, added or left out.
    const EDITS: usize = 2;
    let text = text.to_lowercase();
    let typo = |value: &&'k str| {
        let edits = strsim::damerau_levenshtein(&text, value);
        let is_typo = edits <= EDITS && edits < value.len().div_ceil(2) && text.chars().next() == value.chars().next();
        is_typo.then_some((edits, *value))
    };
    let mut typos: Vec<(usize, &str)> = known.iter().filter_map(typo).collect();
    typos.sort_unstable();
    match typos.as_slice() {
        [(edits, value), others @ ..] if others.iter().all(|(more, _)| more > edits) => Some(value),
        _ => None,
    }
}

/// Adds the most similar known name as help. If no name is similar and there is no other help, adds the list of names.
pub fn with_nearest(problem: Problem, name: &str, known: &[&str]) -> Problem {
    match nearest(name, known) {
        Some(nearest) => {
            let convert = if differ_in_unit(&name.to_lowercase(), nearest) {
                " Convert the number: the unit is in the key's name"
            } else {
                ""
            };
            problem.help(format!("did you mean `{nearest}`?{convert}"))
        }
        None if problem.help.is_none() && !known.is_empty() => {
            problem.help(format!("allowed keys: {}", known.join(", ")))
        }
        None => problem,
    }
}

/// Returns the most similar known name, if one is similar.
fn nearest<'k>(name: &str, known: &[&'k str]) -> Option<&'k str> {
    let name = name.to_lowercase();
    let scored = known.iter().map(|known| (strsim::jaro_winkler(&name, known), *known));
    scored.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(score, _)| *score >= SIMILAR).map(|(_, known)| known)
}

/// Units at the end of a name that a person may write.
const UNITS: [&str; 27] = [
    "um", "mm", "cm", "m", "in", "us", "ms", "s", "min", "h", "mn", "n", "kn", "g", "kg", "lb", "hz", "khz", "mv", "v",
    "deg", "rad", "percent", "ppm", "mm2", "s2", "pa",
];

/// Whether two names have the same beginning, and then different units: `hold_min` and `hold_s`.
fn differ_in_unit(name: &str, known: &str) -> bool {
    let (name, known): (Vec<&str>, Vec<&str>) = (name.split('_').collect(), known.split('_').collect());
    let same = name.iter().zip(&known).take_while(|(a, b)| a == b).count();
    let is_unit = |rest: &[&str]| !rest.is_empty() && rest.iter().all(|word| UNITS.contains(word));
    same > 0 && is_unit(&name[same..]) && is_unit(&known[same..])
}
