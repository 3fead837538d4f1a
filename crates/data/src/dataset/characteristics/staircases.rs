//! Levels of staircases, sorted by unit, and by place and top force.

use crate::dataset::{Press, Presses, RecordedContact};
use crate::recipe::Phase;
use palpate_control::Branch;
use palpate_core::quantity::{ArrayLayout, Place};
use std::collections::BTreeMap;

/// One level of one staircase, for the pressed unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldLevel {
    /// Place of the staircase, specimen frame.
    pub place: Place,
    /// Largest commanded force of the staircase, N.
    pub top_n: f64,
    /// Branch: loading or unloading.
    pub branch: Branch,
    /// Commanded force, N.
    pub force_set_n: f64,
    /// Force of the load cell, N.
    pub force_n: f64,
    /// Output of the unit, in its own units.
    pub output: f64,
}

/// Staircases sorted by unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Staircases {
    /// The readings of each output, in the order of the layout; empty where none was pressed there.
    pub readings: Vec<Vec<HeldLevel>>,
    /// The index of the unit that each output belongs to.
    pub units: Vec<usize>,
    /// Number of rows excluded because they are flagged.
    pub left_out: usize,
}

/// Returns the number of staircases among the readings of an output: each holds its largest force once.
pub fn repeats(readings: &[HeldLevel]) -> usize {
    readings.iter().filter(|held| held.branch == Branch::Loading && held.level() == micro(held.top_n)).count()
}

/// A set force as a level, in integer uN, so that 3 x 0.5 and 1.5 are the same level.
pub type LevelMicronewton = i64;

impl HeldLevel {
    /// Returns the commanded force as a level.
    pub fn level(&self) -> LevelMicronewton {
        micro(self.force_set_n)
    }
}

/// Returns the readings of each series of a unit. Staircases up to the same force at the same place repeat each other.
pub fn by_series(readings: &[HeldLevel]) -> Vec<Vec<HeldLevel>> {
    let mut series: BTreeMap<[i64; 3], Vec<HeldLevel>> = BTreeMap::new();
    for reading in readings {
        let key = [micro(reading.place.y_mm), micro(reading.place.x_mm), micro(reading.top_n)];
        series.entry(key).or_default().push(*reading);
    }
    series.into_values().collect()
}

fn micro(value: f64) -> i64 {
    (value * 1e6).round() as i64
}

impl Staircases {
    /// Selects the staircases of a run; `None` if it has none. A staircase belongs to the unit closest to its place.
    pub fn of_run(presses: &Presses, layout: &ArrayLayout) -> Option<Self> {
        let mut staircases = Staircases::none(layout);
        let mut of_it: Vec<&Press> =
            presses.presses.iter().filter(|press| press.is_of(Phase::Characterisation)).collect();
        of_it.sort_by_key(|press| (press.press, press.level));
        for levels in of_it.chunk_by(|a, b| a.press == b.press) {
            staircases.add(levels, layout);
        }
        staircases.some()
    }

    /// Returns an empty collection for the units of an array.
    pub(in crate::dataset) fn none(layout: &ArrayLayout) -> Self {
        Staircases {
            readings: vec![Vec::new(); layout.len()],
            units: (0..layout.len()).map(|output| layout.unit(output)).collect(),
            left_out: 0,
        }
    }

    /// Returns this collection; `None` if it has no rows.
    pub(in crate::dataset) fn some(self) -> Option<Self> {
        (self.left_out > 0 || self.readings.iter().any(|readings| !readings.is_empty())).then_some(self)
    }

    /// Adds the levels of a contact, if it belongs to a characterisation.
    pub(in crate::dataset) fn add_contact(&mut self, contact: &RecordedContact, layout: &ArrayLayout) {
        let levels = contact.levels.iter().filter(|press| press.is_of(Phase::Characterisation));
        self.add(&levels.collect::<Vec<_>>(), layout);
    }

    /// Adds the levels of one press, in the order in which they were held.
    fn add(&mut self, levels: &[&Press], layout: &ArrayLayout) {
        let top_n = levels.iter().filter_map(|press| press.force_set_n).fold(f64::MIN, f64::max);
        let top = levels.iter().position(|press| press.force_set_n == Some(top_n)).unwrap_or(0);
        for (order, press) in levels.iter().enumerate() {
            let branch = if order <= top { Branch::Loading } else { Branch::Unloading };
            let place = press.place();
            let remoteness = |unit: &usize| place.distance_mm(layout.places()[*unit]);
            let closest = (0..layout.len()).min_by(|a, b| remoteness(a).total_cmp(&remoteness(b)));
            match (closest, press.force_set_n, press.force_n) {
                (Some(closest), Some(force_set_n), Some(force_n)) if !press.is_flagged() => {
                    // every channel of the unit
                    let of_unit = |index: &usize| layout.unit(*index) == layout.unit(closest);
                    for (index, output) in
                        press.outputs.iter().take(layout.len()).enumerate().filter(|(index, _)| of_unit(index))
                    {
                        let held = HeldLevel { place, top_n, branch, force_set_n, force_n, output: *output };
                        self.readings[index].push(held);
                    }
                }
                _ => self.left_out += 1,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Flag;

    const LEVELS: [f64; 9] = [0.0, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0, 0.5, 0.0];

    fn row(press: u64, level: usize, phase: Phase) -> Press {
        Press {
            press,
            level: level as u64,
            phase: Some(phase),
            x_mm: 2.0,
            y_mm: 0.1,
            force_set_n: Some(LEVELS[level]),
            force_n: Some(LEVELS[level]),
            outputs: vec![7.0, LEVELS[level]],
            ..Press::default()
        }
    }

    #[test]
    fn a_runs_staircases_go_to_the_closest_unit_and_flagged_levels_are_counted() {
        let layout = ArrayLayout::grid(1, 2, 4.0);
        // Flagged or not, the top separates loading from unloading.
        for flagged in [3, 4] {
            let rows = (0..9).rev().map(|level| Press {
                flags: if level == flagged { vec![Flag::Stale] } else { vec![] },
                ..row(3, level, Phase::Characterisation)
            });
            let rows = rows.chain([row(4, 0, Phase::Test)]).collect();
            let table = Presses::new("presses.csv", rows, vec![]);
            let staircases = Staircases::of_run(&table, &layout).unwrap();
            assert_eq!((staircases.left_out, staircases.readings[0].len()), (1, 0));
            let branches: Vec<Branch> = staircases.readings[1].iter().map(|reading| reading.branch).collect();
            assert_eq!(branches, [[Branch::Loading; 4], [Branch::Unloading; 4]].concat());
            assert!(staircases.readings[1].iter().all(|reading| reading.top_n == 2.0));
        }
        let table = Presses::new("presses.csv", vec![row(4, 0, Phase::Test)], vec![]);
        assert_eq!(Staircases::of_run(&table, &layout), None);
    }

    #[test]
    fn staircases_at_one_place_up_to_one_force_are_a_series() {
        let at = |press: u64, x_mm: f64, top: usize| {
            let levels = (0..=top).chain(9 - top..9);
            levels.enumerate().map(move |(order, level)| Press {
                level: order as u64,
                x_mm,
                ..row(press, level, Phase::Characterisation)
            })
        };
        // two repeats up to 2 N and one up to 1 N at a place, one up to 2 N beside it, and one at the other unit
        let rows = at(0, 2.0, 4).chain(at(1, 2.0, 4)).chain(at(2, 2.0, 2)).chain(at(3, 1.5, 4)).chain(at(4, -2.0, 4));
        let table = Presses::new("presses.csv", rows.collect(), vec![]);
        let staircases = Staircases::of_run(&table, &ArrayLayout::grid(1, 2, 4.0)).unwrap();
        let of_unit = |unit: usize| {
            let series = by_series(&staircases.readings[unit]);
            series.iter().map(|held| (held[0].place.x_mm, held[0].top_n, held.len())).collect::<Vec<_>>()
        };
        assert_eq!(of_unit(0), [(-2.0, 2.0, 9)]);
        assert_eq!(of_unit(1), [(1.5, 2.0, 9), (2.0, 1.0, 5), (2.0, 2.0, 18)]);
    }
}
