//! Repeatability and hysteresis of each unit from load/unload staircases: Table 1 of the paper as measured.
//!
//! The paper gives neither definition. Ours stand in [`Repeatability::definition`] and [`HYSTERESIS_DEFINITION`], fit
//! to be printed beside the numbers. Common to all of them:
//!
//! - an output is first **brought to the set force**: the force loop stops anywhere within its tolerance, and that
//!   isn't the unit's error. Added is the unit's slope times (set force - load cell), with the slope from a straight
//!   line fitted to all loading outputs against the load cell;
//! - **full scale** is the mean loading output at the top force;
//! - the zero level is left out: in air nothing is there to repeat.

use super::{Contact, Press, Presses};
use crate::control::Branch;
use crate::quantity::ArrayLayout;
use crate::recipe::Phase;
use statrs::distribution::{ContinuousCDF, StudentsT};
use statrs::statistics::Statistics as _;
use std::collections::BTreeMap;

/// What the hysteresis column holds, in lines of at most 78 characters.
pub const HYSTERESIS_DEFINITION: &str = "\
hysteresis: the largest, over the levels between zero and top force, of
|mean unloading - mean loading output|, in % of the output at the top force";

/// How outputs are brought to the set force, in lines of at most 78 characters.
pub const CORRECTION_DEFINITION: &str = "\
for both, each output is first brought to the set force by the load cell and
the unit's slope (least squares over its loading outputs)";

/// One held level of one staircase, for the unit it was pressed on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldLevel {
    /// On the way up or down.
    pub branch: Branch,
    /// The commanded force, N.
    pub force_set_n: f64,
    /// The load cell's, N.
    pub force_n: f64,
    /// The unit's output, its own units.
    pub output: f64,
}

/// Staircases sorted by unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Staircases {
    /// The readings of each unit, in the order of the layout; empty where none was pressed there.
    pub readings: Vec<Vec<HeldLevel>>,
    /// How many rows were left out because they are flagged.
    pub left_out: usize,
}

/// One row of Table 1, % of the output at full scale; none where the readings don't determine it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnitCharacteristics {
    /// The unit, from 1.
    pub unit: usize,
    /// How well loading outputs repeat.
    pub repeatability_loading_percent: Option<f64>,
    /// How well unloading outputs repeat.
    pub repeatability_unloading_percent: Option<f64>,
    /// How far unloading runs from loading.
    pub hysteresis_percent: Option<f64>,
}

/// The usual readings of the word repeatability, over the repeats of a level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Repeatability {
    /// Three standard deviations.
    ///
    /// Of five repeats it gives 0.94 of three true ones on average, since the square root of an unbiased variance is itself biased
    /// (c4 of 5).
    #[default]
    #[value(name = "3sd")]
    ThreeSd,
    /// Largest less smallest.
    Range,
    /// Half the width of the interval that holds 95 %, by Student's t for the number of repeats.
    T95,
    /// Three standard deviations at the level where they are largest.
    WorstLevel,
}

impl Repeatability {
    /// What the repeatability columns hold, in lines of at most 78 characters.
    pub fn definition(self) -> &'static str {
        match self {
            Repeatability::ThreeSd => {
                "repeatability: 3 standard deviations (n - 1) of the repeats of a level, pooled\n\
                 over the levels but zero, in % of the output at the top force"
            }
            Repeatability::Range => {
                "repeatability: largest less smallest of the repeats of a level, mean over the\n\
                 levels but zero, in % of the output at the top force"
            }
            Repeatability::T95 => {
                "repeatability: Student's t (95 %, two-sided; 2.776 for 5 repeats) times the\n\
                 standard deviation (n - 1) of the repeats of a level, pooled over the levels\n\
                 but zero, in % of the output at the top force"
            }
            Repeatability::WorstLevel => {
                "repeatability: 3 standard deviations (n - 1) of the repeats, at the level but\n\
                 zero where they are largest, in % of the output at the top force"
            }
        }
    }

    /// Over the corrected outputs of each level; levels held less than twice tell nothing. None without any other.
    fn of_levels(self, levels: &[Vec<f64>]) -> Option<f64> {
        let repeated: Vec<&[f64]> = levels.iter().map(Vec::as_slice).filter(|level| level.len() > 1).collect();
        let fewest = repeated.iter().map(|level| level.len()).min()?;
        Some(match self {
            Repeatability::ThreeSd => 3.0 * pooled_sd(&repeated),
            Repeatability::Range => mean(repeated.iter().map(|level| range(level))),
            // The levels of a staircase share its contact and so its error: pooling them adds no degrees of freedom.
            Repeatability::T95 => student_t95(fewest - 1)? * pooled_sd(&repeated),
            Repeatability::WorstLevel => 3.0 * repeated.iter().map(|level| level.variance()).fold(0.0, f64::max).sqrt(),
        })
    }
}

/// Table 1, a row a unit. A repeatability needs two repeats of a level; a hysteresis needs a level between zero and the
/// top force on both branches; both need an output other than 0 at the top force.
pub fn characterise(staircases: &Staircases, repeatability: Repeatability) -> Vec<UnitCharacteristics> {
    let rows = staircases.readings.iter().enumerate();
    rows.map(|(index, readings)| characterise_unit(index + 1, readings, repeatability)).collect()
}

impl Staircases {
    /// Picks the staircases of a run; none where it has none. A staircase belongs to the unit it was pressed closest to.
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

    /// None yet, for the units of an array.
    pub(super) fn none(layout: &ArrayLayout) -> Self {
        Staircases { readings: vec![Vec::new(); layout.len()], left_out: 0 }
    }

    /// These; none where there is not a row.
    pub(super) fn some(self) -> Option<Self> {
        (self.left_out > 0 || self.readings.iter().any(|readings| !readings.is_empty())).then_some(self)
    }

    /// Adds the levels of a contact, if it is a characterisation's.
    pub(super) fn add_contact(&mut self, contact: &Contact, layout: &ArrayLayout) {
        let levels = contact.levels.iter().filter(|press| press.is_of(Phase::Characterisation));
        self.add(&levels.collect::<Vec<_>>(), layout);
    }

    /// Adds the levels of one press, in the order they were held.
    fn add(&mut self, levels: &[&Press], layout: &ArrayLayout) {
        let top_n = levels.iter().filter_map(|press| press.force_set_n).fold(f64::MIN, f64::max);
        let top = levels.iter().position(|press| press.force_set_n == Some(top_n)).unwrap_or(0);
        for (order, press) in levels.iter().enumerate() {
            let branch = if order <= top { Branch::Loading } else { Branch::Unloading };
            let remoteness = |unit: &usize| press.place().distance_mm(layout.places()[*unit]);
            let closest = (0..layout.len()).min_by(|a, b| remoteness(a).total_cmp(&remoteness(b)));
            match (closest, press.force_set_n, press.force_n) {
                (Some(closest), Some(force_set_n), Some(force_n)) if !press.is_flagged() => {
                    // every channel of the unit
                    let of_unit = |index: &usize| layout.unit(*index) == layout.unit(closest);
                    for (index, output) in
                        press.outputs.iter().take(layout.len()).enumerate().filter(|(index, _)| of_unit(index))
                    {
                        self.readings[index].push(HeldLevel { branch, force_set_n, force_n, output: *output });
                    }
                }
                _ => self.left_out += 1,
            }
        }
    }
}

fn characterise_unit(unit: usize, readings: &[HeldLevel], repeatability: Repeatability) -> UnitCharacteristics {
    let corrected = Corrected::new(readings);
    let percent = |value: Option<f64>| Some(100.0 * value? / corrected.as_ref()?.full_scale);
    let repeats = |branch| repeatability.of_levels(&corrected.as_ref()?.levels(branch));
    UnitCharacteristics {
        unit,
        repeatability_loading_percent: percent(repeats(Branch::Loading)),
        repeatability_unloading_percent: percent(repeats(Branch::Unloading)),
        hysteresis_percent: percent(corrected.as_ref().and_then(Corrected::hysteresis)),
    }
}

/// One unit's outputs brought to the set force, by level.
struct Corrected {
    loading: BTreeMap<Level, Vec<f64>>,
    unloading: BTreeMap<Level, Vec<f64>>,
    top: Level,
    /// Magnitude of the mean loading output at the top force; not 0.
    full_scale: f64,
}

/// A set force as a level: whole uN, so that 3 x 0.5 and 1.5 are the same one.
type Level = i64;

impl Corrected {
    /// None where the loading forces don't vary, or nothing is read at the top.
    fn new(readings: &[HeldLevel]) -> Option<Self> {
        let slope = slope(readings)?;
        let mut branches = [BTreeMap::new(), BTreeMap::new()];
        for reading in readings {
            let level = (reading.force_set_n * 1e6).round() as Level;
            let at_set_force = reading.output + slope * (reading.force_set_n - reading.force_n);
            let outputs: &mut Vec<f64> = branches[reading.branch as usize].entry(level).or_default();
            outputs.push(at_set_force);
        }
        let [loading, unloading] = branches;
        let (top, at_top) = loading.last_key_value()?;
        let (top, full_scale) = (*top, mean(at_top.iter().copied()).abs());
        (full_scale > 0.0).then_some(Corrected { loading, unloading, top, full_scale })
    }

    /// The outputs of a branch at each level but zero.
    fn levels(&self, branch: Branch) -> Vec<Vec<f64>> {
        let levels = match branch {
            Branch::Loading => &self.loading,
            Branch::Unloading => &self.unloading,
        };
        levels.iter().filter(|(level, _)| **level > 0).map(|(_, outputs)| outputs.clone()).collect()
    }

    fn hysteresis(&self) -> Option<f64> {
        let inner = self.loading.iter().filter(|(level, _)| **level > 0 && **level < self.top);
        let both = inner.filter_map(|(level, loading)| Some((loading, self.unloading.get(level)?)));
        let gap = |(loading, unloading): (&Vec<f64>, &Vec<f64>)| {
            (mean(unloading.iter().copied()) - mean(loading.iter().copied())).abs()
        };
        both.map(gap).reduce(f64::max)
    }
}

/// Least-squares slope of the loading outputs against the load cell, output units per N; none where the force doesn't
/// vary.
fn slope(readings: &[HeldLevel]) -> Option<f64> {
    let loading = || readings.iter().filter(|reading| reading.branch == Branch::Loading);
    let mean_force = mean(loading().map(|reading| reading.force_n));
    let mean_output = mean(loading().map(|reading| reading.output));
    let deviation = |reading: &HeldLevel| reading.force_n - mean_force;
    let spread: f64 = loading().map(|reading| deviation(reading).powi(2)).sum();
    let common: f64 = loading().map(|reading| deviation(reading) * (reading.output - mean_output)).sum();
    (spread > 0.0).then(|| common / spread)
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().sum::<f64>() / values.count() as f64
}

/// The standard deviation common to all levels: their variances weighted by n - 1.
fn pooled_sd(levels: &[&[f64]]) -> f64 {
    let freedom = |level: &[f64]| (level.len() - 1) as f64;
    let squares: f64 = levels.iter().map(|level| level.variance() * freedom(level)).sum();
    (squares / levels.iter().map(|level| freedom(level)).sum::<f64>()).sqrt()
}

fn range(values: &[f64]) -> f64 {
    let (least, most) = values.iter().fold((f64::MAX, f64::MIN), |(least, most), v| (least.min(*v), most.max(*v)));
    most - least
}

/// Two-sided 95 % quantile of Student's t.
fn student_t95(degrees_of_freedom: usize) -> Option<f64> {
    Some(StudentsT::new(0.0, 1.0, degrees_of_freedom as f64).ok()?.inverse_cdf(0.975))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Flag;
    use clap::ValueEnum as _;

    const LEVELS: [f64; 9] = [0.0, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0, 0.5, 0.0];

    /// A unit that reads `force + offset`, with `loop_width` added on the way down at 1 N and half of it at 0.5 and 1.5
    /// N.
    fn staircase(offset: f64, loop_width: f64, force_error_n: f64) -> Vec<HeldLevel> {
        let held = LEVELS.iter().enumerate();
        held.map(|(level, &force_set_n)| {
            let branch = if level <= 4 { Branch::Loading } else { Branch::Unloading };
            let share = if level <= 4 { 0.0 } else { 1.0 - (force_set_n - 1.0).abs() };
            let in_contact = if force_set_n > 0.0 { 1.0 } else { 0.0 };
            let sign = if branch == Branch::Loading { -1.0 } else { 1.0 };
            let force_n = force_set_n + sign * force_error_n * in_contact;
            HeldLevel { branch, force_set_n, force_n, output: force_n + offset * in_contact + share * loop_width }
        })
        .collect()
    }

    fn one_unit(readings: Vec<HeldLevel>, repeatability: Repeatability) -> UnitCharacteristics {
        characterise(&Staircases { readings: vec![readings], left_out: 0 }, repeatability)[0]
    }

    fn assert_near(found: Option<f64>, expected: f64) {
        assert!((found.unwrap() - expected).abs() < 1e-9, "{found:?} instead of {expected}");
    }

    #[test]
    fn each_repeatability_is_what_it_says() {
        // Offsets of -0.02..0.02: variance 0.00025, range 0.04; full scale 2.
        let readings: Vec<HeldLevel> =
            [-0.02, -0.01, 0.0, 0.01, 0.02].iter().flat_map(|&offset| staircase(offset, 0.0, 0.0)).collect();
        let sd_percent = 0.00025f64.sqrt() / 2.0 * 100.0;
        for (repeatability, expected) in [
            (Repeatability::ThreeSd, 3.0 * sd_percent),
            (Repeatability::Range, 2.0),
            (Repeatability::T95, 2.776_445_105_197_79 * sd_percent),
            (Repeatability::WorstLevel, 3.0 * sd_percent),
        ] {
            let measured = one_unit(readings.clone(), repeatability);
            assert!((measured.repeatability_loading_percent.unwrap() - expected).abs() < 1e-6, "{repeatability:?}");
            assert!((measured.repeatability_unloading_percent.unwrap() - expected).abs() < 1e-6, "{repeatability:?}");
        }
    }

    #[test]
    fn the_worst_level_is_the_worst_and_pooling_weighs_by_freedom() {
        let levels = vec![vec![0.0, 2.0], vec![5.0], vec![1.0, 1.0, 1.0, 1.0]];
        assert_near(Repeatability::WorstLevel.of_levels(&levels), 3.0 * 2.0f64.sqrt());
        assert_near(Repeatability::ThreeSd.of_levels(&levels), 3.0 * 0.5f64.sqrt()); // 2 x 1 + 0 x 3 over 4
        assert_near(Repeatability::Range.of_levels(&levels), 1.0);
    }

    #[test]
    fn hysteresis_is_the_widest_inner_gap_wherever_the_loop_stops() {
        for force_error_n in [0.0, 0.05] {
            let readings = (0..5).flat_map(|_| staircase(0.0, 0.08, force_error_n)).collect();
            let measured = one_unit(readings, Repeatability::ThreeSd);
            assert_near(measured.hysteresis_percent, 4.0); // 0.08 of 2
            assert_near(measured.repeatability_loading_percent, 0.0);
        }
    }

    #[test]
    fn what_the_readings_do_not_determine_is_none() {
        let once = one_unit(staircase(0.0, 0.08, 0.0), Repeatability::T95);
        assert_eq!((once.repeatability_loading_percent, once.repeatability_unloading_percent), (None, None));
        assert_near(once.hysteresis_percent, 4.0);

        let nothing = UnitCharacteristics {
            unit: 1,
            repeatability_loading_percent: None,
            repeatability_unloading_percent: None,
            hysteresis_percent: None,
        };
        assert_eq!(one_unit(Vec::new(), Repeatability::ThreeSd), nothing);
        let constant = HeldLevel { branch: Branch::Loading, force_set_n: 1.0, force_n: 1.0, output: 1.0 };
        assert_eq!(one_unit(vec![constant; 5], Repeatability::ThreeSd), nothing); // no slope
        let mute = staircase(0.0, 0.0, 0.0).iter().map(|reading| HeldLevel { output: 0.0, ..*reading }).collect();
        assert_eq!(one_unit(mute, Repeatability::ThreeSd), nothing); // no full scale
        let only_down = HeldLevel { branch: Branch::Unloading, ..constant };
        assert_eq!(one_unit(vec![only_down; 5], Repeatability::ThreeSd), nothing);
    }

    #[test]
    fn a_runs_staircases_go_to_the_closest_unit_and_flagged_levels_are_counted() {
        let row = |press, level: usize, flagged: bool, phase| Press {
            press,
            level: level as u64,
            phase: Some(phase),
            x_mm: 2.0,
            y_mm: 0.1,
            force_set_n: Some(LEVELS[level]),
            force_n: Some(LEVELS[level]),
            outputs: vec![7.0, LEVELS[level]],
            flags: if flagged { vec![Flag::Stale] } else { vec![] },
            ..Press::default()
        };
        let layout = ArrayLayout::grid(1, 2, 4.0);
        // Flagged or not, the top tells loading from unloading.
        for flagged in [3, 4] {
            let rows = (0..9).rev().map(|level| row(3, level, level == flagged, Phase::Characterisation));
            let rows = rows.chain([row(4, 0, false, Phase::Test)]).collect();
            let table = Presses::new("presses.csv", rows, vec![]);
            let staircases = Staircases::of_run(&table, &layout).unwrap();
            assert_eq!((staircases.left_out, staircases.readings[0].len()), (1, 0));
            let branches: Vec<Branch> = staircases.readings[1].iter().map(|reading| reading.branch).collect();
            assert_eq!(branches, [[Branch::Loading; 4], [Branch::Unloading; 4]].concat());
        }
        let table = Presses::new("presses.csv", vec![row(4, 0, false, Phase::Test)], vec![]);
        assert_eq!(Staircases::of_run(&table, &layout), None);
    }

    #[test]
    fn every_name_is_understood_and_every_definition_fits_a_line() {
        for repeatability in Repeatability::value_variants() {
            let definition = repeatability.definition();
            assert!(definition.lines().all(|line| line.len() <= 78), "{definition}");
        }
        assert_eq!(Repeatability::from_str("3sd", false), Ok(Repeatability::default()));
        assert!(Repeatability::from_str("4sd", false).is_err());
    }
}
