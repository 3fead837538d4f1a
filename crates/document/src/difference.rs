//! Compares two texts key by key.

use super::{DefaultValue, Key, Keys, Problems, parsed, printable};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A key with different values in two texts.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyChange {
    /// Path of the key: `limits.force_n`. A table in a list has its number, counted from 1: `scene.fault[2].kind`.
    pub path: String,
    /// Value in the first text; `None` if the key is missing and has no default.
    pub before: Option<GivenValue>,
    /// Value in the second text, in the same way.
    pub now: Option<GivenValue>,
}

/// A value as given in a text.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenValue {
    /// The value as written in the text, or the default.
    pub text: String,
    /// The value as a number, if it is a number.
    pub number: Option<f64>,
}

/// Returns the keys whose values differ between two texts, in the order of their list. A missing key has its default. Numbers are
/// compared by value, not by spelling. A missing table differs from every existing table.
///
/// # Errors
/// A text isn't TOML.
pub fn differences(keys: &Keys, before: (&str, &str), now: (&str, &str)) -> Result<Vec<KeyChange>, Problems> {
    let (old, new) = (parsed(before.0, before.1)?, parsed(now.0, now.1)?);
    let mut comparison = Comparison { before: before.1, now: now.1, changes: Vec::new() };
    comparison.tables("", Some(keys), old.get_ref(), new.get_ref());
    Ok(comparison.changes)
}

type SpannedValue<'t> = Spanned<DeValue<'t>>;

struct Comparison<'t> {
    before: &'t str,
    now: &'t str,
    changes: Vec<KeyChange>,
}

impl Comparison<'_> {
    fn tables(&mut self, path: &str, keys: Option<&Keys>, before: &DeTable, now: &DeTable) {
        let listed: Vec<&Key> = keys.map(|keys| keys.all().collect()).unwrap_or_default();
        let mut names: Vec<&str> = listed.iter().map(|key| key.name).collect();
        names.extend(before.keys().chain(now.keys()).map(|name| name.get_ref().as_ref()));
        for (i, name) in names.iter().enumerate() {
            if names[..i].contains(name) {
                continue; // a key of two cases, or of both texts
            }
            let key = listed.iter().find(|key| key.name == *name).copied();
            let path = if path.is_empty() { (*name).to_owned() } else { format!("{path}.{name}") };
            self.items(&path, key, before.get(*name), now.get(*name));
        }
    }

    fn items(&mut self, path: &str, key: Option<&Key>, before: Option<&SpannedValue>, now: Option<&SpannedValue>) {
        let inner = key.and_then(Key::inner);
        if let (Some(DeValue::Table(old)), Some(DeValue::Table(new))) =
            (before.map(SpannedValue::get_ref), now.map(SpannedValue::get_ref))
        {
            return self.tables(path, inner, old, new);
        }
        if let (Some(old), Some(new)) = (tables_of(before), tables_of(now))
            && inner.is_some()
        {
            for i in 0..old.len().max(new.len()) {
                self.items(&format!("{path}[{}]", i + 1), key, old.get(i).copied(), new.get(i).copied());
            }
            return;
        }
        let default = key.and_then(Key::default);
        let (old, new) =
            [before, now].map(|item| item.map(|item| Plain::of(item.get_ref())).or(default.map(Plain::default))).into();
        if old != new {
            let given = |item: Option<&SpannedValue>, text, plain: Option<Plain>| {
                let text = item.map(|item| shown(item, text)).or(default.map(|value| value.to_string()));
                text.map(|text| GivenValue { text, number: plain.and_then(|plain| plain.number()) })
            };
            let (before, now) = (given(before, self.before, old), given(now, self.now, new));
            self.changes.push(KeyChange { path: path.to_owned(), before, now });
        }
    }
}

/// Returns the tables of a list of tables, or an empty list if the item is missing. `None` if the item isn't a list of tables.
fn tables_of<'i, 't>(item: Option<&'i SpannedValue<'t>>) -> Option<Vec<&'i SpannedValue<'t>>> {
    let Some(item) = item else { return Some(Vec::new()) };
    let items: Vec<&SpannedValue> = item.get_ref().as_array()?.iter().collect();
    items.iter().all(|item| item.get_ref().is_table()).then_some(items)
}

/// Value, independent of its notation.
#[derive(Debug, PartialEq)]
enum Plain {
    Number(f64),
    Word(String),
    List(Vec<Plain>),
    Table(Vec<(String, Plain)>),
}

impl Plain {
    fn of(value: &DeValue) -> Plain {
        match value {
            DeValue::String(text) => Plain::Word(format!("{text:?}")),
            DeValue::Integer(i) => match i64::from_str_radix(i.as_str(), i.radix()) {
                Ok(n) => Plain::Number(n as f64),
                Err(_) => Plain::Word(i.as_str().to_owned()),
            },
            DeValue::Float(x) => match x.as_str().parse() {
                Ok(n) => Plain::Number(n),
                Err(_) => Plain::Word(x.as_str().to_owned()),
            },
            DeValue::Boolean(flag) => Plain::Word(flag.to_string()),
            DeValue::Datetime(time) => Plain::Word(time.to_string()),
            DeValue::Array(items) => Plain::List(items.iter().map(|item| Plain::of(item.get_ref())).collect()),
            DeValue::Table(table) => {
                let entry = |(name, item): (&Spanned<_>, &SpannedValue)| {
                    (format!("{}", name.get_ref()), Plain::of(item.get_ref()))
                };
                Plain::Table(table.iter().map(entry).collect())
            }
        }
    }

    fn default(value: DefaultValue) -> Plain {
        match value {
            DefaultValue::Number(n) => Plain::Number(n),
            DefaultValue::Whole(n) => Plain::Number(n as f64),
            DefaultValue::Range(from, to) => Plain::List(vec![Plain::Number(from), Plain::Number(to)]),
            DefaultValue::Flag(flag) => Plain::Word(flag.to_string()),
            DefaultValue::Word(word) => Plain::Word(format!("{word:?}")),
            DefaultValue::Texts(texts) => {
                Plain::List(texts.iter().map(|text| Plain::Word(format!("{text:?}"))).collect())
            }
        }
    }

    fn number(&self) -> Option<f64> {
        if let Plain::Number(number) = self { Some(*number) } else { None }
    }
}

/// Returns a value as written in its text, on one line.
fn shown(item: &SpannedValue, text: &str) -> String {
    match item.get_ref() {
        DeValue::Array(items) => {
            let items: Vec<String> = items.iter().map(|item| shown(item, text)).collect();
            format!("[{}]", items.join(", "))
        }
        DeValue::Table(table) => {
            let entry =
                |(name, item): (&Spanned<_>, &SpannedValue)| format!("{} = {}", name.get_ref(), shown(item, text));
            format!("{{ {} }}", table.iter().map(entry).collect::<Vec<_>>().join(", "))
        }
        _ => printable(text.get(item.span()).unwrap_or_default().to_owned()),
    }
}
