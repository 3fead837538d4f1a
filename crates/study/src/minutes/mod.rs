//! Accuracy of a calibration as a function of all the minutes it takes at the bench.
//!
//! A run is executed in virtual time: a number of presses by a strategy of the force loop. The method that cross-validation finds
//! best is fitted to them. It then solves contacts at other places with other forces, which are the same for every way of
//! calibrating. The minutes are those of [`HANDLING_MIN`] and those of the run until its last press.

mod figure;

pub use figure::minutes_figures;

use super::bench::{StudyBench, executed};
use super::condition::{WINDOW_S, last_s, phase};
use super::methods::cramer_rao::MeanBound;
use super::methods::specimen::{CALIBRATION_N, FORCES_N, HALF_MM, KnownReadings, anywhere};
use super::methods::{CRAMER_RAO, MethodRow, StudiedMethod, Tally};
use super::{OnProgress, StudyError, carried_out, pareto};
use palpate_control::Strategy;
use palpate_core::quantity::{Range, round, stream};
use palpate_data::dataset::calibration::calibration_of_run;
use palpate_data::dataset::{Presses, RecordedContact};
use palpate_data::recipe::{GridOrder, Manner, Phase, Places, Plan, Recipe, Step, StepLoad};
use palpate_run::rig::RigSpec;
use palpate_run::run::Halt;
use palpate_sim::scene::Skin;
use palpate_solver::{BEST, ForceKnown, Setting, fit};
use serde::Serialize;
use std::sync::Arc;

/// Time at the bench for mounting the sensor before a run, minutes.
pub(crate) const MOUNTING_MIN: f64 = 4.0;
/// Time for warming up the load cell and the array, minutes.
pub(crate) const WARM_UP_MIN: f64 = 10.0;
/// Time for touching the sensor to find its position, and for checking zeros, minutes.
pub(crate) const ZEROING_MIN: f64 = 1.0;
/// Sum of mounting, warm-up and zeroing, minutes.
pub const HANDLING_MIN: f64 = MOUNTING_MIN + WARM_UP_MIN + ZEROING_MIN;

/// Tolerance of a press, N.
pub(super) const TOLERANCE_N: f64 = 0.010;
/// Largest reading of a unit where units saturate, V. For 1 N directly above, the unit then reads 0.76 V instead of 1 V.
const CEILING_V: f64 = 1.0;

/// Size of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MinutesSize {
    /// Numbers of places along a side of the square.
    pub sides: &'static [usize],
    /// Numbers of presses at each place.
    pub repeats: &'static [usize],
    /// Largest number of presses of a calibration.
    pub presses_max: usize,
    /// Number of specimens; each is used with every way of calibrating.
    pub specimens: usize,
    /// Number of new contacts on each specimen.
    pub tests: usize,
}

impl MinutesSize {
    /// Complete study.
    pub const WHOLE: MinutesSize = MinutesSize {
        sides: &[4, 5, 7, 9, 13, 17, 25],
        repeats: &[1, 2, 4],
        presses_max: 625,
        specimens: 3,
        tests: 1000,
    };
    /// Small study for a first look, and for tests. Its numbers mean little.
    pub const QUICK: MinutesSize =
        MinutesSize { sides: &[4, 5], repeats: &[1, 2], presses_max: 32, specimens: 1, tests: 100 };
}

/// Whether the methods' maps can describe the units exactly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum UnitFamily {
    /// The unchanged bench: a unit's reading is proportional to the force.
    Inside,
    /// Units saturate, so the proportions of a reading change with its force.
    Outside,
}

impl UnitFamily {
    /// Both families.
    pub const ALL: [UnitFamily; 2] = [UnitFamily::Inside, UnitFamily::Outside];

    /// Returns the name in rows.
    pub fn name(self) -> &'static str {
        match self {
            UnitFamily::Inside => "inside",
            UnitFamily::Outside => "outside",
        }
    }

    /// Returns the name for people.
    pub fn text(self) -> &'static str {
        match self {
            UnitFamily::Inside => "inside the solvers' family: outputs in proportion to the force",
            UnitFamily::Outside => "outside of it: units saturate",
        }
    }

    /// Returns the reading in this family for an output of the bench.
    fn read(self, output: f64) -> f64 {
        match self {
            UnitFamily::Inside => output,
            UnitFamily::Outside => CEILING_V * (output / CEILING_V).tanh(),
        }
    }
}

/// The result of one way of calibrating.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MinutesRow {
    /// Method by which the force was found.
    pub strategy: Strategy,
    /// Number of places along a side of the square.
    pub side: usize,
    /// Number of presses at each place.
    pub repeats: usize,
    /// Minutes of handling: everything except the run.
    pub handling_min: f64,
    /// Rule that ended a run, if a rule did. The row then has no numbers.
    pub rule: Option<String>,
    /// Results of the method. `scene` is the family. `minutes` are all minutes at the bench, averaged over the specimens.
    #[serde(flatten)]
    pub found: MethodRow,
}

/// One way of calibrating, and one specimen.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MinutesTry {
    strategy: Strategy,
    side: usize,
    repeats: usize,
    seed: u64,
}

/// Results of a job: minutes, and in each family the method's results for the contacts.
struct Executed {
    minutes: f64,
    tallies: Vec<Tally>,
    /// Smallest possible error on these contacts if outputs are proportional to the force.
    least: Option<MeanBound>,
}

/// Executes every way of calibrating. For each family, marks the ways for which no other is both faster and more accurate.
///
/// # Errors
/// The bench can't execute a plan. A run ended by a rule is a result and not an error.
pub fn minutes(size: MinutesSize, seed: u64, on_progress: OnProgress<'_>) -> Result<Vec<MinutesRow>, StudyError> {
    let spec = StudyBench::XpsLike.spec()?;
    let ways = ways(size);
    let mut jobs: Vec<MinutesTry> = ways
        .iter()
        .flat_map(|way| {
            (0..size.specimens).map(|specimen| MinutesTry { seed: seed.wrapping_add(specimen as u64), ..*way })
        })
        .collect();
    // the longest first, so that no processor waits at the end
    jobs.sort_by_key(|job| std::cmp::Reverse(job.presses()));
    let executed = carried_out(&jobs, on_progress, |job| job.carry_out(&spec, size.tests))?;
    let mut rows = Vec::new();
    for (index, family) in UnitFamily::ALL.into_iter().enumerate() {
        for way in &ways {
            let of_it = jobs.iter().zip(&executed).filter(|(job, _)| MinutesTry { seed: way.seed, ..**job } == *way);
            rows.push(row(way, family, index, &of_it.map(|(_, executed)| executed).collect::<Vec<_>>()));
        }
    }
    let mark = |row: &MinutesRow| (row.found.scene.clone(), row.found.minutes.zip(row.found.mean_mm()));
    let best = pareto(&rows.iter().map(mark).collect::<Vec<_>>());
    rows.iter_mut().zip(best).for_each(|(row, is_best)| row.found.pareto = Some(is_best));
    Ok(rows)
}

/// Returns all ways of calibrating, in the order of the rows.
fn ways(size: MinutesSize) -> Vec<MinutesTry> {
    let mut ways = Vec::new();
    for strategy in Strategy::ALL {
        for &repeats in size.repeats {
            ways.extend(size.sides.iter().map(|&side| MinutesTry { strategy, side, repeats, seed: 0 }));
        }
    }
    ways.retain(|way| way.presses() <= size.presses_max);
    ways
}

impl MinutesTry {
    fn presses(&self) -> usize {
        self.side * self.side * self.repeats
    }

    fn carry_out(&self, spec: &RigSpec, tests: usize) -> Result<Result<Executed, String>, StudyError> {
        let plan = self.plan(spec)?;
        let (contacts, ending) = executed(&plan, spec)?;
        if let Some(halt) = &ending.halt {
            return Ok(Err(match halt {
                Halt::Tripped(trip) => trip.rule.name().to_owned(),
                _ => "device".to_owned(),
            }));
        }
        let made: Vec<&RecordedContact> =
            contacts.iter().filter(|made| phase(made) == Some(Phase::Calibration)).collect();
        let run_min = last_s(&made).unwrap_or(0.0) / 60.0;
        // the run's specimen
        let mut skin = Skin::new(&spec.scene.skin, &spec.array.layout, spec.limits.force_n, self.seed);
        let touches = anywhere(tests, FORCES_N, &mut stream(self.seed, 0, "fresh contacts"));
        let test = KnownReadings::of(&mut skin, &touches, &mut stream(self.seed, 0, "noise of fresh contacts"));
        let tallies = UnitFamily::ALL.map(|family| self.tally(family, &contacts, &test, spec));
        Ok(Ok(Executed {
            minutes: HANDLING_MIN + run_min,
            tallies: tallies.into_iter().collect::<Result<Vec<Tally>, StudyError>>()?,
            least: MeanBound::over(&skin, &spec.scene.skin, spec.limits.force_n, &test),
        }))
    }

    fn plan(&self, spec: &RigSpec) -> Result<Plan, StudyError> {
        let manner =
            Manner { force_tolerance_n: TOLERANCE_N, sample_s: WINDOW_S, strategy: self.strategy, ..Manner::PAPER };
        let side_mm = Range { min: -HALF_MM, max: HALF_MM };
        let spacing_mm = 2.0 * HALF_MM / (self.side - 1) as f64;
        let grid = || Places::Grid { x_mm: side_mm, y_mm: side_mm, spacing_mm, order: GridOrder::Raster };
        let once = || Step::new(Phase::Calibration, grid(), StepLoad::Force(CALIBRATION_N), manner);
        let recipe = Recipe::new("minutes", (0..self.repeats).map(|_| once()).collect());
        Ok(Plan::new(&recipe, &spec.ground(), self.seed)?)
    }

    /// Counts the results of the best method for new contacts.
    fn tally(
        &self,
        family: UnitFamily,
        contacts: &[RecordedContact],
        test: &KnownReadings,
        spec: &RigSpec,
    ) -> Result<Tally, StudyError> {
        let mut presses = Presses::of_contacts("the study", contacts);
        let mut test = test.clone();
        let read = presses.presses.iter_mut().flat_map(|press| &mut press.outputs).chain(&mut test.outputs);
        read.for_each(|output| *output = family.read(*output));
        let calibration = calibration_of_run(&presses, ForceKnown::default())
            .map_err(|error| StudyError::Broken { seed: self.seed, why: error.to_string() })?;
        let setting = Setting::of_layout(Some(&spec.array.layout));
        let fitted = fit(BEST, &calibration, &setting).map(Arc::new);
        Ok(Tally::of(&StudiedMethod { name: BEST, fitted }, &test))
    }
}

fn row(way: &MinutesTry, family: UnitFamily, index: usize, executed: &[&Result<Executed, String>]) -> MinutesRow {
    let rule = executed.iter().find_map(|executed| executed.as_ref().err().cloned());
    let whole: Vec<&Executed> =
        executed.iter().filter_map(|executed| executed.as_ref().ok()).filter(|_| rule.is_none()).collect();
    let mut sum = Tally::default();
    whole.iter().for_each(|executed| sum.add(executed.tallies[index].clone()));
    let least = MeanBound::mean(whole.iter().map(|executed| executed.least)).filter(|_| family == UnitFamily::Inside);
    let minutes = whole.iter().map(|executed| executed.minutes).sum::<f64>() / whole.len() as f64;
    MinutesRow {
        strategy: way.strategy,
        side: way.side,
        repeats: way.repeats,
        handling_min: HANDLING_MIN,
        found: MethodRow {
            study: "minutes",
            scene: family.name().to_owned(),
            condition: "calibration presses",
            value: way.presses() as f64,
            calibration_presses: way.presses(),
            minutes: rule.is_none().then(|| round(minutes, 3)),
            ns_per_solve: None, // measured: the rows are the same twice
            ..sum.row(BEST, least.map(|least| (least, CRAMER_RAO)))
        },
        rule,
    }
}
