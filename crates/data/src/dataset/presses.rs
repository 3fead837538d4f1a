//! Presses from either source: a run's journal, or an external table.

use super::{Lookalike, Press, RecordedContact, output_name};
use crate::recipe::Phase;
use palpate_core::quantity::Place;
use palpate_solver::vector::{DraggedRow, VectorRow};
use std::collections::HashMap;

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
    pub fn of_contacts<'a>(source: &str, contacts: impl IntoIterator<Item = &'a RecordedContact>) -> Presses {
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

    /// Returns the presses of one phase, with those after a drag.
    pub fn of_phase(&self, phase: Phase) -> Presses {
        let is_of_it = |index: &usize| self.presses[*index].phase == Some(phase);
        self.some(&(0..self.presses.len()).filter(is_of_it).collect::<Vec<_>>())
    }

    /// Returns the presses without a fault whose force vector is known.
    pub fn vector_rows(&self) -> impl Iterator<Item = VectorRow<'_>> {
        self.presses.iter().filter_map(Press::vector_row)
    }

    /// Returns the same presses, each with the place where its drag began.
    pub fn dragged_rows(&self) -> Vec<DraggedRow<'_>> {
        // a press is before its drag; another session may use its number again
        let mut pressed: HashMap<u64, Place> = HashMap::new();
        let rows = self.presses.iter().filter_map(|press| {
            let place = press.place();
            if !press.is_dragged() {
                pressed.insert(press.press, place);
            }
            let pressed = pressed.get(&press.press).copied().unwrap_or(place);
            press.vector_row().map(|row| DraggedRow { pressed, row })
        });
        rows.collect()
    }

    /// Keeps the presses of one phase, if the table has presses of this phase and of others. Returns how many there were of all.
    pub fn keep(&mut self, phase: Phase) -> Option<usize> {
        let all = self.presses.len();
        let of_it: Vec<usize> = (0..all).filter(|index| self.presses[*index].is_of(phase)).collect();
        if of_it.is_empty() || of_it.len() == all {
            return None;
        }
        *self = self.some(&of_it);
        Some(all)
    }

    /// Returns some of the presses, with their lines in the table.
    pub(super) fn some(&self, which: &[usize]) -> Presses {
        Presses {
            presses: which.iter().map(|index| self.presses[*index].clone()).collect(),
            lines: which.iter().filter_map(|index| self.lines.get(*index)).copied().collect(),
            source: self.source.clone(),
            unused: self.unused.clone(),
            detected: self.detected.clone(),
            ..*self
        }
    }

    /// Returns the presses as the text of a table with what an evaluation uses. Every number is read back to the last bit.
    pub fn to_csv(&self) -> String {
        let has_forces = self.presses.iter().all(|press| press.force_n.is_some());
        let has_depths = self.presses.iter().all(|press| press.depth_mm.is_some());
        let is_flagged = self.presses.iter().any(Press::is_flagged);
        let depth = if has_depths { ",depth_mm" } else { "" };
        let outputs: String = (1..=self.channels).map(|channel| format!(",{}", output_name(channel))).collect();
        let (force, flags) = (if has_forces { ",force_n" } else { "" }, if is_flagged { ",flags" } else { "" });
        let mut text = format!("x_mm,y_mm{force}{depth}{outputs}{flags}\n");
        for press in &self.presses {
            let force_n = press.force_n.filter(|_| has_forces);
            let depth_mm = press.depth_mm.filter(|_| has_depths);
            let known = [press.x_mm, press.y_mm].into_iter().chain(force_n).chain(depth_mm);
            let numbers = known.chain(press.outputs.iter().copied());
            text += &numbers.map(|number| number.to_string()).collect::<Vec<_>>().join(",");
            text += if is_flagged { "," } else { "" };
            text += press.flags.first().map_or("", |flag| flag.name());
            text.push('\n');
        }
        text
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
    use super::super::evaluate::tests::{RUN, run, table};
    use super::*;

    #[test]
    fn written_values_are_read_back_bit_for_bit() {
        let text = "x_mm,y_mm,force_n,out_1,out_2,flags\n0.1,-3e-7,0.30000000000000004,1e21,5e-324,\n1,2,3,4,5,bad\n";
        let presses = table(text);
        let again = table(&presses.to_csv());
        assert_eq!((again.presses, again.channels), (presses.presses, presses.channels));
        let silent = table("x_mm,y_mm,out_1\n1,2,3\n");
        assert_eq!(silent.to_csv(), "x_mm,y_mm,out_1\n1,2,3\n");
    }

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
