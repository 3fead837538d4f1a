//! Presses from either door: a run's journal, or a table from outside.

use super::{Contact, Lookalike, Press};
use crate::recipe::Phase;

/// Presses of one array, each with as many outputs as the array has channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Presses {
    /// Where they come from, as given: a table's file or a run's folder.
    pub source: String,
    /// How many outputs each has.
    pub channels: usize,
    /// The presses: those of a run in the order of its plan, those of a table in the order of its rows.
    pub presses: Vec<Press>,
    /// Columns of its table that look like a force, a place or an output and aren't used.
    pub unused: Vec<Lookalike>,
    /// What was detected in its table and what was excluded, in words; empty for plain CSV.
    pub detected: Vec<String>,
    /// The line of each in its table, from 1; empty where they come from a journal.
    lines: Vec<u64>,
}

impl Presses {
    /// What a run's contacts hold, in the order of the plan.
    pub fn of_contacts<'a>(source: &str, contacts: impl IntoIterator<Item = &'a Contact>) -> Presses {
        let mut presses: Vec<Press> = contacts.into_iter().flat_map(|contact| &contact.levels).cloned().collect();
        presses.sort_by_key(|press| press.press); // stable: the levels of a press stay in their order
        Presses::new(source, presses, Vec::new())
    }

    /// Presses and, where they stand in a table, their lines.
    pub(super) fn new(source: &str, presses: Vec<Press>, lines: Vec<u64>) -> Presses {
        let channels = presses.first().map_or(0, |press| press.outputs.len());
        Presses { source: source.to_owned(), channels, presses, unused: Vec::new(), detected: Vec::new(), lines }
    }

    /// Those of one phase, flagged ones left out.
    pub fn sound(&self, phase: Phase) -> impl Iterator<Item = &Press> {
        self.presses.iter().filter(move |press| press.is_of(phase) && !press.is_flagged())
    }

    /// Where a press stands, as a message names it.
    pub fn at(&self, index: usize) -> String {
        let source = &self.source;
        match (self.lines.get(index), self.presses.get(index)) {
            (Some(line), _) => format!("{source}, line {line}"),
            (None, Some(press)) => format!("{source}, press {}, level {}", press.press, press.level),
            (None, None) => source.clone(),
        }
    }

    /// Adds those of another run of the same array.
    pub fn join(&mut self, other: Presses) {
        self.source = format!("{} and {}", self.source, other.source);
        self.channels = self.channels.max(other.channels);
        self.lines.clear();
        self.presses.extend(other.presses);
    }
}
