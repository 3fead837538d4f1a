//! Texts made from lists of keys, and the keys that a reader requests. Tests of readers compare the two.

use super::{Key, Keys, Table, ValueKind, read};
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::fmt::Write;

thread_local! {
    /// Keys that were requested since a test began to note them; `None` outside of such a test.
    static ASKED: RefCell<Option<BTreeSet<String>>> = const { RefCell::new(None) };
    static DEPTH: Cell<usize> = const { Cell::new(0) };
}

/// Text that is being read. A text that is read only as part of this reading isn't noted.
pub(crate) struct TextBeingRead;

impl TextBeingRead {
    pub(crate) fn begin() -> Self {
        DEPTH.set(DEPTH.get() + 1);
        TextBeingRead
    }
}

impl Drop for TextBeingRead {
    fn drop(&mut self) {
        DEPTH.set(DEPTH.get() - 1);
    }
}

/// Notes that a key of the table at `path` is requested.
pub(crate) fn note(path: &str, name: &str) {
    ASKED.with_borrow_mut(|asked| {
        if let Some(asked) = asked.as_mut().filter(|_| DEPTH.get() == 1) {
            asked.insert(if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") });
        }
    });
}

/// Checks that a reader requests the keys of a list, each in its table, and no others. Also checks that the reader accepts the
/// list's examples and defaults.
///
/// # Panics
/// The two differ.
pub fn assert_read_is_listed(keys: &'static Keys, read: impl Fn(&str)) {
    ASKED.set(Some(BTreeSet::new()));
    (0..=most_cases(keys)).for_each(|case| read(&sample(keys, case)));
    let asked = ASKED.take().unwrap_or_default();
    let listed: BTreeSet<String> = keys.visit().into_iter().map(|listed| listed.path).collect();
    let alone = |these: &BTreeSet<String>, those| these.difference(those).cloned().collect::<Vec<_>>();
    assert!(asked == listed, "only listed: {:?}; only asked for: {:?}", alone(&listed, &asked), alone(&asked, &listed));
    for listed in keys.visit() {
        assert_takes(&listed.key, listed.key.example);
        if let Some(default) = listed.key.default() {
            assert_takes(&listed.key, &default.to_string());
        }
    }
}

/// Returns a text with an example of every key that applies when each table is in its case number `case`. All cases of every
/// table occur as the number grows to [`most_cases`].
pub fn sample(keys: &Keys, case: usize) -> String {
    let mut text = String::new();
    for key in keys.always.iter().chain(keys.cases.get(case % keys.cases.len().max(1)).into_iter().flat_map(|c| c.keys))
    {
        let of_case = keys.by.filter(|by| by == key).and_then(|_| keys.cases.get(case % keys.cases.len()));
        let value = match of_case {
            Some(case) => format!("{:?}", case.name),
            None => value(key, case),
        };
        writeln!(text, "{} = {value}", key.name).expect("a string takes it");
    }
    text
}

/// Returns the number of cases of the table with the most cases. A value that may be a table has one case at least.
pub fn most_cases(keys: &Keys) -> usize {
    let cases = |key: &Key| Some(key.inner()?.cases.len().max(usize::from(matches!(key.kind, ValueKind::Either(_)))));
    let inner = keys.visit().into_iter().filter_map(|listed| cases(&listed.key));
    inner.chain([keys.cases.len()]).max().unwrap_or_default()
}

/// Returns an example of a key's value. A value that may be a table is a table except in case 0.
fn value(key: &Key, case: usize) -> String {
    let table = |keys: &Keys| format!("{{ {} }}", sample(keys, case).trim_end().replace('\n', ", "));
    match (key.kind, key.inner()) {
        (ValueKind::Tables(keys), _) => format!("[{}]", table(keys)),
        (ValueKind::Either(_), Some(keys)) if case > 0 => table(keys),
        (ValueKind::Table(keys), _) => table(keys),
        _ => key.example.to_owned(),
    }
}

/// Checks that a value fits the kind of its key.
fn assert_takes(key: &Key, value: &str) {
    let keys: &'static [Key] = Vec::leak(vec![*key]);
    let keys: &'static Keys = Box::leak(Box::new(Keys::of(keys)));
    let taken = |table: &Table, kind: &ValueKind| match kind {
        ValueKind::Number(_) => table.number(key).is_some(),
        ValueKind::Range(_) => table.range(key).is_some(),
        ValueKind::Numbers(_) => table.number_or_list(key).is_some(),
        ValueKind::PerUnit(_) => table.per_unit(key, None).is_some(),
        ValueKind::Places(_) => table.places(key).is_some(),
        ValueKind::Matrix(_) => table.matrix(key).is_some(),
        ValueKind::Rows(_) => table.rows(key).is_some(),
        ValueKind::Whole(..) => table.whole(key).is_some(),
        ValueKind::Wholes(..) => table.wholes(key).is_some(),
        ValueKind::Flag => table.flag(key).is_some(),
        ValueKind::Text => table.text(key).is_some(),
        ValueKind::Texts => table.texts(key).is_some(),
        ValueKind::Word(words) => table.text(key).is_some_and(|word| words.contains(&word)),
        ValueKind::Words(_) => table.words(key).is_some(),
        ValueKind::Table(_) | ValueKind::Tables(_) | ValueKind::Either(_) => true,
    };
    let text = if value.is_empty() { String::new() } else { format!("{} = {value}\n", key.name) };
    let found = read("example", &text, keys, |table| taken(table, &key.kind).then_some(()));
    assert!(found.is_ok(), "`{}` doesn't take {value}: {:?}", key.name, found.map_err(|problems| problems.lines()));
}
