//! Splits the presses of one table or run into a calibration and a test, before anything is fitted.

use super::places::{is_outside, same_places};
use super::{Press, Presses};
use miette::Diagnostic;
use palpate_core::quantity::{Place, stream};
use rand::Rng as _;

/// What is held out together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeldOutBy {
    /// All presses of a place.
    Places,
    /// Each press alone.
    Press,
    /// The last presses.
    Time,
}

/// Which part of the presses is held out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Holdout {
    /// What is held out together.
    pub by: HeldOutBy,
    /// Fraction of the places or of the presses that is the test, between 0 and 1.
    pub share: f64,
    /// Seed of the random choice.
    pub seed: u64,
    /// Largest distance between two presses of one place, mm.
    pub same_place_mm: f64,
}

/// The two parts of the presses.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    /// Presses to which a method is fitted. Flagged presses are here too, and don't count.
    pub calibration: Presses,
    /// Presses that were held out.
    pub test: Presses,
    /// Lines for a person about the split.
    pub notes: Vec<String>,
}

/// Reason why nothing can be held out.
#[derive(Debug, thiserror::Error, Diagnostic)]
#[error("{source_name}: {found} valid {what}, but a hold-out needs at least 2")]
#[diagnostic(help("use a table with more {what}, or a second table of test presses"))]
pub struct HoldoutError {
    source_name: String,
    what: &'static str,
    found: usize,
}

/// Fraction of the test presses at places of the calibration, above which a split by press gets a warning.
const KNOWN_PLACES_MOST: f64 = 0.1;
/// Least fraction of the nodes of a grid that are pressed.
const GRID_FILLED: f64 = 0.9;
/// Least number of rows and of columns of a grid that has inner places.
const GRID_LINES_LEAST: usize = 3;

impl Holdout {
    /// Splits the presses. The same presses and the same seed give the same parts.
    ///
    /// # Errors
    /// There are too few places or presses.
    pub fn split(&self, presses: &Presses) -> Result<Split, HoldoutError> {
        let all = &presses.presses;
        let is_sound = |press: &Press| !press.is_flagged() && !press.is_dragged();
        let sound: Vec<usize> = (0..all.len()).filter(|index| is_sound(&all[*index])).collect();
        let at: Vec<Place> = sound.iter().map(|index| all[*index].place()).collect();
        let place_of = same_places(&at, self.same_place_mm);
        let places: Vec<Place> = firsts(&place_of).into_iter().map(|first| at[first]).collect();
        let (count, what) = match self.by {
            HeldOutBy::Places => (places.len(), "places"),
            HeldOutBy::Press | HeldOutBy::Time => (sound.len(), "presses"),
        };
        if count < 2 {
            return Err(HoldoutError { source_name: presses.source.clone(), what, found: count });
        }
        let wanted = ((self.share * count as f64).round() as usize).clamp(1, count - 1);
        let mut notes = Vec::new();
        let inner = inner_places(&places, self.same_place_mm);
        let mut chosen = |place_of: &dyn Fn(usize) -> usize| {
            let is_inner = |one: &usize| inner.as_ref().is_some_and(|inner| inner[place_of(*one)]);
            let mut from: Vec<usize> = (0..count).filter(is_inner).collect();
            if from.len() >= wanted {
                notes.push("the outermost places of the grid stay in the calibration".to_owned());
            } else {
                from = (0..count).collect();
            }
            self.drawn(from, wanted, count)
        };
        let is_test: Vec<bool> = match self.by {
            HeldOutBy::Places => {
                let chosen = chosen(&|place| place);
                place_of.iter().map(|place| chosen[*place]).collect()
            }
            HeldOutBy::Press => chosen(&|press| place_of[press]),
            HeldOutBy::Time => {
                let times: Option<Vec<f64>> = sound.iter().map(|index| all[*index].t_s).collect();
                if times.is_none() {
                    notes.push("no column t_s: the order of the file is taken as the order of time".to_owned());
                }
                let mut order: Vec<usize> = (0..count).collect();
                order.sort_by(|a, b| times.as_ref().map_or(a.cmp(b), |t_s| t_s[*a].total_cmp(&t_s[*b])));
                marked(&order[count - wanted..], count)
            }
        };
        let (held_out, kept): (Vec<usize>, Vec<usize>) = (0..sound.len()).partition(|press| is_test[*press]);
        let pressed = |presses: &[usize]| {
            let mut is_pressed = vec![false; places.len()];
            presses.iter().for_each(|press| is_pressed[place_of[*press]] = true);
            is_pressed
        };
        let is_calibrated = pressed(&kept);
        let of = |is_pressed: &[bool]| -> Vec<Place> {
            let marked = places.iter().zip(is_pressed).filter(|(_, is_pressed)| **is_pressed);
            marked.map(|(place, _)| *place).collect()
        };
        let (calibrated, tested) = (of(&is_calibrated), of(&pressed(&held_out)));
        let test: Vec<usize> = held_out.iter().map(|press| sound[*press]).collect();
        let is_in_test = marked(&test, all.len());
        let calibration: Vec<usize> = (0..all.len()).filter(|index| !is_in_test[*index]).collect();
        let outside = is_outside(&calibrated, &tested, self.same_place_mm).into_iter().filter(|is| *is).count();
        if outside > 0 {
            let percent = 100.0 * outside as f64 / tested.len() as f64;
            notes.push(format!("{percent:.0} % of the test places are outside the area of the calibration"));
        }
        notes.insert(
            0,
            format!(
                "{} presses at {} places are the test, {} presses at {} places the calibration",
                test.len(),
                tested.len(),
                kept.len(),
                calibrated.len()
            ),
        );
        let known = held_out.iter().filter(|press| is_calibrated[place_of[**press]]).count();
        let known = known as f64 / test.len() as f64;
        if self.by == HeldOutBy::Press && known > KNOWN_PLACES_MOST {
            notes.push(format!(
                "warning: {:.0} % of the test presses are at places of the calibration, so the errors don't show how well new \
                 places are found; --holdout places holds out whole places",
                100.0 * known
            ));
        }
        Ok(Split { calibration: presses.some(&calibration), test: presses.some(&test), notes })
    }

    /// Marks `wanted` of the candidates, drawn at random, among `count`.
    fn drawn(&self, mut from: Vec<usize>, wanted: usize, count: usize) -> Vec<bool> {
        let mut random = stream(self.seed, 0, "hold-out");
        for first in 0..wanted {
            let other = first + (random.next_u64() % (from.len() - first) as u64) as usize;
            from.swap(first, other);
        }
        marked(&from[..wanted], count)
    }
}

/// Returns the first member of each group.
fn firsts(group_of: &[usize]) -> Vec<usize> {
    let mut firsts = Vec::new();
    for (index, group) in group_of.iter().enumerate() {
        if *group == firsts.len() {
            firsts.push(index);
        }
    }
    firsts
}

fn marked(which: &[usize], count: usize) -> Vec<bool> {
    let mut marks = vec![false; count];
    which.iter().for_each(|index| marks[*index] = true);
    marks
}

/// Whether each place of a grid has rows and columns around it; `None` if the places aren't a grid.
fn inner_places(places: &[Place], apart_mm: f64) -> Option<Vec<bool>> {
    let lines = |mm: fn(&Place) -> f64| {
        let on_axis: Vec<Place> = places.iter().map(|place| Place::new(mm(place), 0.0)).collect();
        let line_of = same_places(&on_axis, apart_mm);
        let lines = firsts(&line_of).len();
        let ends = on_axis.iter().enumerate().fold((0, 0), |(least, most), (index, place)| {
            let least = if place.x_mm < on_axis[least].x_mm { index } else { least };
            (least, if place.x_mm > on_axis[most].x_mm { index } else { most })
        });
        let is_inner: Vec<bool> =
            line_of.iter().map(|line| *line != line_of[ends.0] && *line != line_of[ends.1]).collect();
        (lines, is_inner)
    };
    let ((columns, in_x), (rows, in_y)) = (lines(|place| place.x_mm), lines(|place| place.y_mm));
    let is_grid = columns.min(rows) >= GRID_LINES_LEAST && places.len() as f64 >= GRID_FILLED * (columns * rows) as f64;
    is_grid.then(|| in_x.into_iter().zip(in_y).map(|(in_x, in_y)| in_x && in_y).collect())
}

#[cfg(test)]
mod tests {
    use super::super::Flag;
    use super::super::evaluate::tests::table;
    use super::*;
    use std::collections::HashSet;

    /// A grid of 10 x 10 places, each pressed three times within half a micrometre.
    fn grid() -> Presses {
        let press = |index: usize| {
            let (place, pass) = (index % 100, index / 100);
            let (x, y) = ((place % 10) as f64 + 0.0002 * pass as f64, (place / 10) as f64);
            format!("{x},{y},1,{index}\n")
        };
        table(&("x_mm,y_mm,force_n,out_1\n".to_owned() + &(0..300).map(press).collect::<String>()))
    }

    fn held_out(by: HeldOutBy, presses: &Presses) -> Split {
        Holdout { by, share: 0.2, seed: 1, same_place_mm: 0.001 }.split(presses).unwrap()
    }

    fn places(presses: &Presses) -> HashSet<(i64, i64)> {
        presses.presses.iter().map(|press| (press.x_mm.round() as i64, press.y_mm.round() as i64)).collect()
    }

    #[test]
    fn whole_places_of_the_inside_are_held_out() {
        let mut presses = grid();
        presses.presses[7].flags.push(Flag::Other);
        let split = held_out(HeldOutBy::Places, &presses);
        let (calibration, test) = (places(&split.calibration), places(&split.test));
        assert_eq!((split.test.presses.len(), test.len(), calibration.len()), (60, 20, 80));
        assert!(test.is_disjoint(&calibration) && test.iter().all(|(x, y)| (1..9).contains(x) && (1..9).contains(y)));
        assert!(split.calibration.presses.iter().any(|press| press.is_flagged()));
        assert_eq!(split.notes.len(), 2, "{:?}", split.notes);
        assert_eq!(split, held_out(HeldOutBy::Places, &presses), "a seed gives one split");
        let other = Holdout { by: HeldOutBy::Places, share: 0.2, seed: 2, same_place_mm: 0.001 };
        assert_ne!(other.split(&presses).unwrap().test, split.test);
        // the lines of the file are kept for messages
        let first = split.test.presses[0].press as usize;
        assert_eq!(split.test.at(0), presses.at(first));
    }

    #[test]
    fn more_places_than_there_are_inside_are_drawn_from_all_with_a_note() {
        let presses = grid();
        let split =
            Holdout { by: HeldOutBy::Places, share: 0.8, seed: 1, same_place_mm: 0.001 }.split(&presses).unwrap();
        assert_eq!(places(&split.test).len(), 80);
        assert!(split.notes.iter().any(|note| note.contains("are outside the area of the calibration")));
        // without a tolerance the passes of a place are places of their own
        let apart = Holdout { by: HeldOutBy::Places, share: 0.2, seed: 1, same_place_mm: 0.0001 };
        let split = apart.split(&presses).unwrap();
        assert!(!places(&split.test).is_disjoint(&places(&split.calibration)));
    }

    #[test]
    fn single_presses_are_held_out_with_a_warning_where_their_places_are_known() {
        let split = held_out(HeldOutBy::Press, &grid());
        assert_eq!(split.test.presses.len(), 60);
        assert!(split.notes.iter().any(|note| note.starts_with("warning: ") && note.contains("--holdout places")));
        let mut once = grid();
        once.presses.truncate(100);
        assert!(!held_out(HeldOutBy::Press, &once).notes.iter().any(|note| note.starts_with("warning: ")));
    }

    #[test]
    fn the_last_presses_are_held_out_by_their_time_or_by_the_order_of_the_file() {
        let mut presses = grid();
        let numbers = |split: &Split| split.test.presses.iter().map(|press| press.press).collect::<Vec<_>>();
        let split = held_out(HeldOutBy::Time, &presses);
        assert_eq!(numbers(&split), (240..300).collect::<Vec<_>>());
        assert!(split.notes.iter().any(|note| note.contains("no column t_s")), "{:?}", split.notes);
        presses.presses.iter_mut().for_each(|press| press.t_s = Some(-(press.press as f64)));
        let split = held_out(HeldOutBy::Time, &presses);
        assert_eq!(numbers(&split), (0..60).collect::<Vec<_>>());
        assert!(!split.notes.iter().any(|note| note.contains("t_s")), "{:?}", split.notes);
    }

    #[test]
    fn nothing_can_be_held_out_of_one_place() {
        let presses = table("x_mm,y_mm,out_1\n1,1,2\n1,1,3\n");
        let refused = Holdout { by: HeldOutBy::Places, share: 0.5, seed: 1, same_place_mm: 0.001 }.split(&presses);
        assert_eq!(refused.unwrap_err().to_string(), "a.csv: 1 valid places, but a hold-out needs at least 2");
    }
}
