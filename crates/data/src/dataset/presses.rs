//! Presses from either source: a run's journal, or an external table.

use super::{Contact, Lookalike, Press};
use crate::recipe::Phase;

/// Presses of one array, each with as many outputs as the array has channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Presses {
    /// Source of the presses, as given: a table's file or a run's folder.
    pub source: String,
    /// Number of outputs of each press.
    pub channels: usize,
    /// Presses of a run in the order of its plan, or of a table in the order of its rows.
    pub presses: Vec<Press>,
    /// Columns of its table that look like a force, a place or an output and aren't used.
    pub unused: Vec<Lookalike>,
    /// Description of what was detected in the table and what was excluded; empty for plain CSV.
    pub detected: Vec<String>,
    /// Largest change of the load cell that the checks of the run leave possible, as a fraction of the force; 0 without checks.
    pub cell: f64,
    /// Line of each press in its table, from 1; empty if the presses are from a journal.
    lines: Vec<u64>,
}

impl Presses {
    /// Takes the presses of a run's contacts, in the order of the plan.
    pub fn of_contacts<'a>(source: &str, contacts: impl IntoIterator<Item = &'a Contact>) -> Presses {
        let mut presses: Vec<Press> = contacts.into_iter().flat_map(|contact| &contact.levels).cloned().collect();
        presses.sort_by_key(|press| press.press); // stable: the levels of a press stay in their order
        Presses::new(source, presses, Vec::new())
    }

    /// Takes presses of a run in any order.
    pub fn of_presses(source: &str, presses: Vec<Press>) -> Presses {
        Presses::new(source, presses, Vec::new())
    }

    /// Creates a list of presses. If they come from a table, `lines` are their lines.
    pub(super) fn new(source: &str, presses: Vec<Press>, lines: Vec<u64>) -> Presses {
        let channels = presses.first().map_or(0, |press| press.outputs.len());
        let (unused, detected) = (Vec::new(), Vec::new());
        Presses { source: source.to_owned(), channels, presses, unused, detected, cell: 0.0, lines }
    }

    /// Returns the presses of one phase, without flagged presses.
    pub fn sound(&self, phase: Phase) -> impl Iterator<Item = &Press> {
        self.presses.iter().filter(move |press| press.is_of(phase) && !press.is_flagged())
    }

    /// Keeps the presses of one phase, if the table has presses of this phase and of others. Returns how many there were of all.
    pub fn keep(&mut self, phase: Phase) -> Option<usize> {
        let (all, of_it) = (self.presses.len(), self.presses.iter().filter(|press| press.is_of(phase)).count());
        if of_it == 0 || of_it == all {
            return None;
        }
        if !self.lines.is_empty() {
            let kept = self.presses.iter().zip(&self.lines).filter(|(press, _)| press.is_of(phase));
            self.lines = kept.map(|(_, line)| *line).collect();
        }
        self.presses.retain(|press| press.is_of(phase));
        Some(all)
    }

    /// Returns the position of a press, for messages.
    pub fn at(&self, index: usize) -> String {
        let source = &self.source;
        match (self.lines.get(index), self.presses.get(index)) {
            (Some(line), _) => format!("{source}, line {line}"),
            (None, Some(press)) => format!("{source}, press {}, level {}", press.press, press.level),
            (None, None) => source.clone(),
        }
    }

    /// Adds the presses of another run of the same array.
    pub fn join(&mut self, other: Presses) {
        self.source = format!("{} and {}", self.source, other.source);
        self.channels = self.channels.max(other.channels);
        self.cell = self.cell.max(other.cell);
        self.lines.clear();
        self.presses.extend(other.presses);
    }
}

#[cfg(test)]
mod tests {
    use super::super::evaluate::tests::{RUN, run};
    use super::*;

    #[test]
    fn of_a_table_with_several_phases_one_is_kept_with_its_lines() {
        let (mut calibration, mut test) = (run(RUN), run(RUN));
        assert_eq!(calibration.keep(Phase::Characterisation), None);
        assert_eq!(calibration.keep(Phase::Calibration), Some(7));
        assert_eq!((calibration.presses.len(), calibration.keep(Phase::Calibration)), (3, None));
        assert!(calibration.at(2).ends_with("line 4"), "{}", calibration.at(2));
        assert_eq!((test.keep(Phase::Test), test.presses.len()), (Some(7), 3));
        assert!(test.at(0).ends_with("line 5"), "{}", test.at(0));
    }
}
