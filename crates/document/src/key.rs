//! Keys as data: the allowed content of each table of a text.
//!
//! A [`Key`] is one key of one table. [`Keys`] are all keys of a table and its alternatives. The readers use names, bounds and
//! defaults from these lists, and read no other keys. Suggestions also come from these lists.

use palpate_core::quantity::Range;

/// One key of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Name of the key; it ends with the unit.
    pub name: &'static str,
    /// Kind of its value.
    pub kind: ValueKind,
    /// Value if the key is missing.
    pub absent: Absent,
    /// Meaning of the key, in one line.
    pub meaning: &'static str,
    /// Example value as TOML; empty for a table, whose keys have their own examples.
    pub example: &'static str,
}

/// Allowed range of a number, and its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    min: f64,
    max: f64,
    above_min: bool,
    unit: &'static str,
}

impl Bounds {
    /// Creates bounds with both ends included.
    pub const fn within(min: f64, max: f64, unit: &'static str) -> Self {
        Bounds { min, max, above_min: false, unit }
    }

    /// Creates bounds with the upper end included and the lower end excluded.
    pub const fn above(min: f64, max: f64, unit: &'static str) -> Self {
        Bounds { min, max, above_min: true, unit }
    }

    /// Returns the unit; empty for a number without a unit.
    pub const fn unit(&self) -> &'static str {
        self.unit
    }

    /// Returns the smallest and largest value.
    pub const fn ends(&self) -> (f64, f64) {
        (self.min, self.max)
    }

    /// Returns the interval and the unit as text.
    pub(super) fn stated(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        format!("{}{unit}", self.interval())
    }

    /// Whether a number is within the bounds.
    pub fn admit(&self, value: f64) -> bool {
        value <= self.max && if self.above_min { value > self.min } else { value >= self.min }
    }

    pub(super) fn in_unit(&self) -> String {
        if self.unit.is_empty() { String::new() } else { format!(" in {}", self.unit) }
    }

    pub(super) fn interval(&self) -> String {
        if self.above_min {
            format!("over {}, at most {}", self.min, self.max)
        } else {
            format!("{} to {}", self.min, self.max)
        }
    }
}

/// Kind of a key's value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ValueKind {
    /// A number; integers are allowed.
    Number(Bounds),
    /// An interval `[from, to]` with `from <= to`.
    Range(Bounds),
    /// A number, or a list of numbers.
    Numbers(Bounds),
    /// A list with one number for each unit of the array.
    PerUnit(Bounds),
    /// A list of places `[x, y]`.
    Places(Bounds),
    /// A matrix of three rows with three numbers each.
    Matrix(Bounds),
    /// Three rows with as many numbers each.
    Rows(Bounds),
    /// An integer from the first to the second number.
    Whole(u64, u64),
    /// A list of such integers.
    Wholes(u64, u64),
    /// True or false.
    Flag,
    /// A string.
    Text,
    /// A list of strings.
    Texts,
    /// One of these words.
    Word(&'static [&'static str]),
    /// A list of some of these words.
    Words(&'static [&'static str]),
    /// A table.
    Table(&'static Keys),
    /// A list of tables.
    Tables(&'static Keys),
    /// A value of one of these kinds.
    Either(&'static [ValueKind]),
}

/// Value if a key is missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Absent {
    /// No value: the key is required.
    Refused,
    /// A value that is described in the key's meaning.
    Allowed,
    /// The given value.
    Is(DefaultValue),
}

/// Default value of a key.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "each is named as the kind it is a value of")]
pub enum DefaultValue {
    Number(f64),
    Range(f64, f64),
    Whole(u64),
    Flag(bool),
    Word(&'static str),
    Texts(&'static [&'static str]),
}

/// All keys of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keys {
    /// Keys that apply in every case of the table.
    pub always: &'static [Key],
    /// Key that has a word for each case. If `None`, a case is chosen by the first of its own keys.
    pub by: Option<Key>,
    /// Alternatives of the table.
    pub cases: &'static [Case],
}

/// Keys that apply in only one case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Word that chooses the case, or the name of the key that chooses it.
    pub name: &'static str,
    /// Keys of the case.
    pub keys: &'static [Key],
}

/// A key and its position.
#[derive(Clone, Debug, PartialEq)]
pub struct Listed {
    /// Path of the key: the names of its tables and its own name, separated by dots: `limits.force_n`.
    pub path: String,
    /// Cases in which the tables on the path must be, outermost first.
    pub cases: Vec<&'static str>,
    /// The key.
    pub key: Key,
}

impl Key {
    /// Returns the keys of the tables below, if the key is or may be a table or a list of tables.
    pub fn inner(&self) -> Option<&'static Keys> {
        self.kind.pick(|kind| match kind {
            ValueKind::Table(keys) | ValueKind::Tables(keys) => Some(*keys),
            _ => None,
        })
    }

    /// Returns the default of the key, if it has one that is always the same.
    pub fn default(&self) -> Option<DefaultValue> {
        match self.absent {
            Absent::Is(value) => Some(value),
            _ => None,
        }
    }
}

impl ValueKind {
    /// Unit of the numbers; empty if there is no unit.
    pub(super) fn unit(&self) -> &'static str {
        let of = |kind: &ValueKind| match kind {
            ValueKind::Number(bounds)
            | ValueKind::Range(bounds)
            | ValueKind::Numbers(bounds)
            | ValueKind::PerUnit(bounds)
            | ValueKind::Places(bounds)
            | ValueKind::Matrix(bounds)
            | ValueKind::Rows(bounds) => Some(bounds.unit()),
            _ => None,
        };
        self.pick(of).unwrap_or_default()
    }

    /// Returns the value that `pick` returns for this kind or one of its alternatives.
    pub(super) fn pick<T>(&self, pick: impl Fn(&ValueKind) -> Option<T>) -> Option<T> {
        match self {
            ValueKind::Either(kinds) => kinds.iter().find_map(pick),
            kind => pick(kind),
        }
    }
}

impl DefaultValue {
    pub(super) fn number(self) -> Option<f64> {
        if let DefaultValue::Number(number) = self { Some(number) } else { None }
    }

    /// Returns the range.
    pub fn range(self) -> Option<Range> {
        if let DefaultValue::Range(min, max) = self { Some(Range { min, max }) } else { None }
    }

    pub(super) fn whole(self) -> Option<u64> {
        if let DefaultValue::Whole(number) = self { Some(number) } else { None }
    }

    pub(super) fn flag(self) -> Option<bool> {
        if let DefaultValue::Flag(flag) = self { Some(flag) } else { None }
    }

    pub(super) fn word(self) -> Option<&'static str> {
        if let DefaultValue::Word(word) = self { Some(word) } else { None }
    }

    pub(super) fn texts(self) -> Option<Vec<&'static str>> {
        if let DefaultValue::Texts(texts) = self { Some(texts.to_vec()) } else { None }
    }
}

impl Keys {
    /// Creates keys without alternatives.
    pub const fn of(always: &'static [Key]) -> Keys {
        Keys { always, by: None, cases: &[] }
    }

    /// Creates keys that are only alternatives.
    pub const fn one_of(cases: &'static [Case]) -> Keys {
        Keys { always: &[], by: None, cases }
    }

    /// Returns every key that the table may have in any case.
    pub fn all(&self) -> impl Iterator<Item = &'static Key> + use<> {
        self.always.iter().chain(self.cases.iter().flat_map(|case| case.keys))
    }

    /// Returns every key that the table or a table within it may have, outer keys first.
    pub fn visit(&self) -> Vec<Listed> {
        let mut listed = Vec::new();
        self.visit_within("", &[], &mut listed);
        listed
    }

    fn visit_within(&self, path: &str, cases: &[&'static str], listed: &mut Vec<Listed>) {
        let always = self.always.iter().map(|key| (key, None));
        let others = self.cases.iter().flat_map(|case| case.keys.iter().map(|key| (key, Some(case.name))));
        for (key, case) in always.chain(others) {
            let path = if path.is_empty() { key.name.to_owned() } else { format!("{path}.{}", key.name) };
            let cases: Vec<_> = cases.iter().copied().chain(case).collect();
            listed.push(Listed { path: path.clone(), cases: cases.clone(), key: *key });
            if let Some(keys) = key.inner() {
                keys.visit_within(&path, &cases, listed);
            }
        }
    }
}

impl std::fmt::Display for DefaultValue {
    /// Formats the value as TOML.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            DefaultValue::Number(n) => write!(f, "{n:?}"),
            DefaultValue::Range(from, to) => write!(f, "[{from:?}, {to:?}]"),
            DefaultValue::Whole(n) => write!(f, "{n}"),
            DefaultValue::Flag(flag) => write!(f, "{flag}"),
            DefaultValue::Word(word) => write!(f, "{word:?}"),
            DefaultValue::Texts(texts) => write!(f, "{texts:?}"),
        }
    }
}

/// Returns the words from a list of words and their meanings.
pub const fn words<T, const N: usize>(meanings: &[(&'static str, T); N]) -> [&'static str; N] {
    let mut words = [""; N];
    let mut i = 0;
    while i < N {
        words[i] = meanings[i].0;
        i += 1;
    }
    words
}

/// Parts of the rows of a [`keys!`](crate::keys) list.
pub mod row {
    pub use super::Absent::{Allowed, Refused};
    pub use super::Keys;
    pub use super::ValueKind::*;
    use super::{Absent, Bounds, DefaultValue};

    /// Bounds that include both ends.
    pub const fn within(min: f64, max: f64, unit: &'static str) -> Bounds {
        Bounds::within(min, max, unit)
    }

    /// Bounds that exclude the lower end.
    pub const fn above(min: f64, max: f64, unit: &'static str) -> Bounds {
        Bounds::above(min, max, unit)
    }

    /// A number if the key is missing.
    pub const fn or(number: f64) -> Absent {
        Absent::Is(DefaultValue::Number(number))
    }

    /// A range if the key is missing.
    pub const fn or_range(from: f64, to: f64) -> Absent {
        Absent::Is(DefaultValue::Range(from, to))
    }

    /// A whole number if the key is missing.
    pub const fn or_whole(number: u64) -> Absent {
        Absent::Is(DefaultValue::Whole(number))
    }

    /// A flag if the key is missing.
    pub const fn or_flag(flag: bool) -> Absent {
        Absent::Is(DefaultValue::Flag(flag))
    }

    /// A word if the key is missing.
    pub const fn or_word(word: &'static str) -> Absent {
        Absent::Is(DefaultValue::Word(word))
    }

    /// Texts if the key is missing.
    pub const fn or_texts(texts: &'static [&'static str]) -> Absent {
        Absent::Is(DefaultValue::Texts(texts))
    }
}

/// Defines the keys of one table as a module. Each row gives a `const` [`Key`] under its name in the text, and all keys are in
/// `KEYS`. A row states the kind, the value if the key is missing, the meaning and an example.
///
/// Keys after `as TABLE` are those of another table. Rows after `one of` are alternatives, each a separate case. Rows after `by
/// KEY` belong to a word of that key.
#[macro_export]
macro_rules! keys {
    // the value of `name`, or of `name = "text"`
    (@name $name:ident) => { stringify!($name) };
    (@name $name:ident $text:literal) => { $text };
    (@by) => { None };
    (@by $by:ident) => { Some($by) };
    (@key $name:ident $($text:literal)?, $kind:expr, $absent:expr, $meaning:expr $(, $example:literal)?) => {
        #[doc = concat!("The key `", $crate::keys!(@name $name $($text)?), "`.")]
        #[allow(non_upper_case_globals, reason = "a key has one name, in the text and here")]
        pub const $name: $crate::Key = $crate::Key {
            name: $crate::keys!(@name $name $($text)?),
            kind: $kind,
            absent: $absent,
            meaning: $meaning,
            example: concat!($($example)?),
        };
    };
    (
        $(#[$doc:meta])*
        $table:ident {
            $($name:ident $(= $text:literal)?: $kind:expr, $absent:expr, $meaning:expr $(, $example:literal)?;)*
        }
        $(as $other:ident { $($shared:ident),+ })?
        $(one of {
            $($one:ident $(= $one_text:literal)?: $one_kind:expr, $one_absent:expr, $one_meaning:expr $(, $one_example:literal)?;)+
        })?
        $(by $by:ident {
            $($case:ident $(= $word:literal)? {
                $($own:ident: $own_kind:expr, $own_absent:expr, $own_meaning:expr $(, $own_example:literal)?;)+
            })+
        })?
    ) => {
        $(#[$doc])*
        #[allow(unreachable_pub, reason = "a list may be for one room only")]
        pub mod $table {
            #[allow(unused_imports, reason = "a table needs some of them")]
            use super::*;
            #[allow(unused_imports, reason = "a table needs some of them")]
            use $crate::{Case, Key, row::*};

            $($crate::keys!(@key $name $($text)?, $kind, $absent, $meaning $(, $example)?);)*
            $($($crate::keys!(@key $one $($one_text)?, $one_kind, $one_absent, $one_meaning $(, $one_example)?);)+)?
            $($(
                #[doc = concat!("Keys that belong to `", $crate::keys!(@name $case $($word)?), "`.")]
                pub mod $case {
                    #[allow(unused_imports, reason = "a case needs some of them")]
                    use super::*;

                    $($crate::keys!(@key $own, $own_kind, $own_absent, $own_meaning $(, $own_example)?);)+
                    /// The word and its keys.
                    pub const CASE: Case =
                        Case { name: $crate::keys!(@name $case $($word)?), keys: &[$($own),+] };
                }
            )+)?

            $(pub use super::$other::{$($shared),+};)?

            #[allow(dead_code, reason = "some keys are only those of other tables")]
            const ALWAYS: &[Key] = &[$($name,)* $($($shared,)+)?];
            /// All keys of the table.
            #[allow(dead_code, reason = "some keys are only those of other tables")]
            pub const KEYS: Keys = Keys {
                always: ALWAYS,
                by: $crate::keys!(@by $($by)?),
                cases: &[$($(Case { name: $one.name, keys: &[$one] }),+)? $($($case::CASE),+)?],
            };
        }
    };
}
