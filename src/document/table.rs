use super::problem::{Collector, Problem};
use std::ops::Range as Bytes;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Where a value stands in its text, bytes.
pub type Span = Bytes<usize>;

/// Least similarity (Jaro-Winkler, 0 to 1) at which a known name is offered for an unknown one.
const SIMILAR: f64 = 0.75;

/// The stated range of a number, and its unit.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    min: f64,
    max: f64,
    above_min: bool,
    unit: &'static str,
}

impl Bounds {
    /// Both ends allowed.
    pub const fn within(min: f64, max: f64, unit: &'static str) -> Self {
        Bounds { min, max, above_min: false, unit }
    }

    /// The upper end allowed, the lower one not.
    pub const fn above(min: f64, max: f64, unit: &'static str) -> Self {
        Bounds { min, max, above_min: true, unit }
    }

    fn admit(&self, value: f64) -> bool {
        value <= self.max && if self.above_min { value > self.min } else { value >= self.min }
    }

    fn unit(&self) -> String {
        if self.unit.is_empty() { String::new() } else { format!(" in {}", self.unit) }
    }

    fn interval(&self) -> String {
        if self.above_min {
            format!("over {}, at most {}", self.min, self.max)
        } else {
            format!("{} to {}", self.min, self.max)
        }
    }
}

/// One table of a text. Every `require_` question records a problem where there is no good answer; the others only where
/// the key is there and wrong.
pub struct Table<'d> {
    table: &'d DeTable<'d>,
    collector: &'d Collector,
    path: String,
    span: Span,
    asked: Vec<&'static str>,
    rest_is_others: bool,
}

impl<'d> Table<'d> {
    pub(super) fn root(root: &'d Spanned<DeTable<'d>>, collector: &'d Collector) -> Self {
        Table {
            table: root.get_ref(),
            collector,
            path: String::new(),
            span: 0..0,
            asked: Vec::new(),
            rest_is_others: false,
        }
    }

    /// Where the table stands.
    pub fn span(&self) -> Span {
        self.span.clone()
    }

    /// Records a problem.
    pub fn complain(&self, problem: Problem) {
        self.collector.add(problem);
    }

    /// Whether the key is there. It counts as asked for: a misspelt one is told its nearest spelling.
    pub fn has(&mut self, key: &'static str) -> bool {
        self.ask(key);
        self.table.keys().any(|k| k.get_ref() == key)
    }

    /// Whether the key is there and a string.
    pub fn is_text(&self, key: &str) -> bool {
        self.table.iter().any(|(k, v)| k.get_ref() == key && v.get_ref().is_str())
    }

    /// Where the key's value stands; the table's own place without it.
    pub fn span_of(&self, key: &str) -> Span {
        self.table.iter().find(|(k, _)| k.get_ref() == key).map_or(self.span(), |(_, v)| v.span())
    }

    /// A number within its bounds; whole numbers count.
    pub fn number(&mut self, key: &'static str, bounds: Bounds) -> Option<f64> {
        let value = self.get(key)?;
        self.number_of(key, value, bounds)
    }

    /// The same, and a problem without it.
    pub fn require_number(&mut self, key: &'static str, bounds: Bounds) -> Option<f64> {
        self.require(key, || format!("a number{}, {}", bounds.unit(), bounds.interval()));
        self.number(key, bounds)
    }

    /// A whole number from `min` to `max`.
    pub fn integer(&mut self, key: &'static str, min: u64, max: u64) -> Option<u64> {
        let value = self.get(key)?;
        self.integer_of(key, value, min, max)
    }

    /// A list of whole numbers from `min` to `max`.
    pub fn integers(&mut self, key: &'static str, min: u64, max: u64) -> Option<Vec<u64>> {
        let value = self.get(key)?;
        match value.get_ref().as_array() {
            Some(items) => all(items.iter().map(|item| self.integer_of(key, item, min, max))),
            None => self.wrong_kind(key, value, "a list of whole numbers"),
        }
    }

    /// The same, and a problem without it.
    pub fn require_integer(&mut self, key: &'static str, min: u64, max: u64) -> Option<u64> {
        self.require(key, || format!("a whole number, {min} to {max}"));
        self.integer(key, min, max)
    }

    /// True or false.
    pub fn flag(&mut self, key: &'static str) -> Option<bool> {
        let value = self.get(key)?;
        match value.get_ref().as_bool() {
            Some(flag) => Some(flag),
            None => self.wrong_kind(key, value, "true or false"),
        }
    }

    /// A list of strings.
    pub fn texts(&mut self, key: &'static str) -> Option<Vec<&'d str>> {
        let value = self.get(key)?;
        let Some(items) = value.get_ref().as_array() else { return self.wrong_kind(key, value, "a list of strings") };
        all(items.iter().map(|item| match item.get_ref().as_str() {
            Some(text) => Some(text),
            None => self.wrong_kind(key, item, "a string"),
        }))
    }

    /// A string.
    pub fn text(&mut self, key: &'static str) -> Option<&'d str> {
        let value = self.get(key)?;
        match value.get_ref().as_str() {
            Some(text) => Some(text),
            None => self.wrong_kind(key, value, "a string"),
        }
    }

    /// The same, and a problem without it; `what` says what the string means.
    pub fn require_text(&mut self, key: &'static str, what: &str) -> Option<&'d str> {
        self.require(key, || what.to_owned());
        self.text(key)
    }

    /// One of some words.
    pub fn choice<T: Copy>(&mut self, key: &'static str, choices: &[(&str, T)]) -> Option<T> {
        let span = self.span_of(key);
        let text = self.text(key)?;
        if let Some((_, value)) = choices.iter().find(|(word, _)| *word == text) {
            return Some(*value);
        }
        let words: Vec<&str> = choices.iter().map(|(word, _)| *word).collect();
        let problem = Problem::new(span, format!("`{key}` is \"{text}\", expected one of {}", words.join(", ")));
        self.complain(with_nearest(problem, text, &words));
        None
    }

    /// The same, and a problem without it.
    pub fn require_choice<T: Copy>(&mut self, key: &'static str, choices: &[(&str, T)]) -> Option<T> {
        let words: Vec<&str> = choices.iter().map(|(word, _)| *word).collect();
        self.require(key, || format!("one of {}", words.join(", ")));
        self.choice(key, choices)
    }

    /// An interval `[from, to]` with `from <= to`, both within bounds.
    pub fn range(&mut self, key: &'static str, bounds: Bounds) -> Option<crate::quantity::Range> {
        let value = self.get(key)?;
        let ends = self.numbers_of(key, value, bounds)?;
        match ends[..] {
            [min, max] if min <= max => Some(crate::quantity::Range { min, max }),
            [min, max] => self.fail(value, format!("`{key}` runs backward, from {min} to {max}")),
            _ => self.fail(value, format!("`{key}` has {} numbers, expected [from, to]", ends.len())),
        }
    }

    /// The same, and a problem without it.
    pub fn require_range(&mut self, key: &'static str, bounds: Bounds) -> Option<crate::quantity::Range> {
        self.require(key, || format!("[from, to]{}", bounds.unit()));
        self.range(key, bounds)
    }

    /// A list of numbers within bounds.
    pub fn numbers(&mut self, key: &'static str, bounds: Bounds) -> Option<Vec<f64>> {
        let value = self.get(key)?;
        self.numbers_of(key, value, bounds)
    }

    /// A list of lists of `count` numbers each, with their places.
    pub fn tuples(&mut self, key: &'static str, count: usize, bounds: &[Bounds]) -> Option<Vec<(Vec<f64>, Span)>> {
        let value = self.get(key)?;
        let Some(items) = value.get_ref().as_array() else { return self.wrong_kind(key, value, "a list of lists") };
        all(items.iter().map(|item| match item.get_ref().as_array() {
            Some(numbers) if numbers.iter().count() == count => {
                let read = numbers.iter().zip(bounds).map(|(n, b)| self.number_of(key, n, *b));
                Some((all(read)?, item.span()))
            }
            _ => self.fail(item, format!("expected {count} numbers in each entry of `{key}`")),
        }))
    }

    /// A list of some words, or none where one of them isn't known.
    pub fn choices(&mut self, key: &'static str, words: &[&str]) -> Option<Vec<&'d str>> {
        let value = self.get(key)?;
        let Some(items) = value.get_ref().as_array() else { return self.wrong_kind(key, value, "a list of strings") };
        let mut chosen = Vec::new();
        for item in items.iter() {
            match item.get_ref().as_str() {
                Some(word) if words.contains(&word) => chosen.push(word),
                Some(word) => {
                    let told = format!("`{key}` has \"{word}\", expected some of {}", words.join(", "));
                    self.complain(with_nearest(Problem::new(item.span(), told), word, words));
                }
                None => _ = self.wrong_kind::<()>(key, item, "a string"),
            }
        }
        Some(chosen)
    }

    /// A table inside this one. [`finish`](Self::finish) it when all is asked.
    pub fn table(&mut self, key: &'static str) -> Option<Table<'d>> {
        let value = self.get(key)?;
        match value.get_ref().as_table() {
            Some(table) => Some(self.inner(key, table, value.span())),
            None => self.wrong_kind(key, value, "a table"),
        }
    }

    /// The first of some keys that is there.
    pub fn first_of(&mut self, keys: &[&'static str]) -> Option<&'static str> {
        keys.iter().copied().find(|key| self.has(key))
    }

    /// The same, and a problem without it.
    pub fn require_table(&mut self, key: &'static str) -> Option<Table<'d>> {
        self.require(key, || "a table".to_owned());
        self.table(key)
    }

    /// A list of tables (`[[key]]`), empty without the key.
    pub fn tables(&mut self, key: &'static str) -> Vec<Table<'d>> {
        let Some(value) = self.get(key) else { return Vec::new() };
        let Some(items) = value.get_ref().as_array() else {
            self.wrong_kind::<()>(key, value, "a list of tables");
            return Vec::new();
        };
        let mut tables = Vec::new();
        for item in items.iter() {
            match item.get_ref().as_table() {
                Some(table) => tables.push(self.inner(key, table, item.span())),
                None => _ = self.wrong_kind::<()>(key, item, "a table"),
            }
        }
        tables
    }

    /// Says that keys nobody asked for are somebody else's to read.
    pub fn leave_the_rest(&mut self) {
        self.rest_is_others = true;
    }

    /// Records a problem for every key nobody asked for, with the nearest one that is known.
    pub fn finish(self) {
        for key in self.table.keys() {
            let name = key.get_ref().as_ref();
            if !self.rest_is_others && !self.asked.contains(&name) {
                let place = if self.path.is_empty() { String::new() } else { format!(" in `{}`", self.path) };
                let problem = Problem::new(key.span(), format!("unknown key `{name}`{place}"));
                self.complain(with_nearest(problem, name, &self.asked));
            }
        }
    }

    fn inner(&self, key: &str, table: &'d DeTable<'d>, span: Span) -> Table<'d> {
        let path = if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) };
        Table { table, collector: self.collector, path, span, asked: Vec::new(), rest_is_others: false }
    }

    fn ask(&mut self, key: &'static str) {
        if !self.asked.contains(&key) {
            self.asked.push(key);
        }
    }

    fn get(&mut self, key: &'static str) -> Option<&'d Spanned<DeValue<'d>>> {
        self.ask(key);
        self.table.iter().find(|(k, _)| k.get_ref() == key).map(|(_, value)| value)
    }

    fn require(&mut self, key: &'static str, expected: impl FnOnce() -> String) {
        if !self.has(key) {
            let place = if self.path.is_empty() { String::new() } else { format!(" in `{}`", self.path) };
            self.complain(Problem::new(self.span(), format!("`{key}` is missing{place}: {}", expected())));
        }
    }

    fn numbers_of(&self, key: &str, value: &Spanned<DeValue<'d>>, bounds: Bounds) -> Option<Vec<f64>> {
        match value.get_ref().as_array() {
            Some(items) => all(items.iter().map(|item| self.number_of(key, item, bounds))),
            None => self.wrong_kind(key, value, &format!("a list of numbers{}", bounds.unit())),
        }
    }

    fn integer_of(&self, key: &str, value: &Spanned<DeValue<'d>>, min: u64, max: u64) -> Option<u64> {
        let whole = value.get_ref().as_integer().map(|i| i64::from_str_radix(i.as_str(), i.radix()));
        match whole {
            Some(Ok(n)) if n >= 0 && (min..=max).contains(&(n as u64)) => Some(n as u64),
            Some(_) => self.fail(value, format!("`{key}` must be {min} to {max}")),
            None => self.wrong_kind(key, value, "a whole number"),
        }
    }

    fn number_of(&self, key: &str, value: &Spanned<DeValue<'d>>, bounds: Bounds) -> Option<f64> {
        let number = match value.get_ref() {
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|n| n as f64),
            DeValue::Float(x) => x.as_str().parse::<f64>().ok(),
            _ => return self.wrong_kind(key, value, &format!("a number{}", bounds.unit())),
        };
        match number {
            Some(n) if !n.is_finite() => self.fail(value, format!("`{key}` is not a finite number")),
            Some(n) if bounds.admit(n) => Some(n),
            Some(n) => {
                let told = format!("`{key}` is {n}, must be {} {}", bounds.interval(), bounds.unit);
                self.fail(value, told.trim_end().to_owned())
            }
            None => self.fail(value, format!("`{key}` is not a number this program can hold")),
        }
    }

    fn wrong_kind<T>(&self, key: &str, value: &Spanned<DeValue<'d>>, expected: &str) -> Option<T> {
        let kind = value.get_ref().type_str();
        let article = if kind.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
        let problem = Problem::new(value.span(), format!("`{key}` is {article} {kind}, expected {expected}"));
        let helped = expected.contains(" in ") && value.get_ref().is_str();
        self.complain(if helped {
            problem.help("the unit is in the key's name: write the number alone")
        } else {
            problem
        });
        None
    }

    fn fail<T>(&self, value: &Spanned<DeValue<'d>>, message: String) -> Option<T> {
        self.complain(Problem::new(value.span(), message));
        None
    }
}

/// All of some answers, or none; every one is asked for, so that every problem is told.
pub(crate) fn all<T>(answers: impl Iterator<Item = Option<T>>) -> Option<Vec<T>> {
    let answers: Vec<Option<T>> = answers.collect();
    answers.into_iter().collect()
}

/// Adds the nearest known name as help; where none is near, and nothing else helps, the list of names.
pub(crate) fn with_nearest(problem: Problem, name: &str, known: &[&str]) -> Problem {
    let name = name.to_lowercase();
    let score = |candidate: &&&str| strsim::jaro_winkler(&name, candidate);
    let nearest = known.iter().max_by(|a, b| score(a).total_cmp(&score(b)));
    match nearest {
        Some(nearest) if score(&nearest) >= SIMILAR => problem.help(format!("did you mean `{nearest}`?")),
        Some(_) if problem.help.is_none() => problem.help(format!("known here: {}", known.join(", "))),
        _ => problem,
    }
}
