//! Accuracy and solving time of each method.

use super::cramer_rao::MeanBound;
use super::specimen::{FORCES_N, FULL_SCALE_N, KnownReadings, NoiseReference, StudySpecimen, anywhere, grid};
use super::trial::{CRAMER_RAO, MethodRow, StudiedMethod, Tally};
use crate::{OnProgress, StudyError, pareto};
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::round;
use palpate_core::quantity::{ArrayLayout, stream};
use palpate_data::dataset::evaluate::ns_per_solve;
use palpate_solver::{BEST, Calibration, Model, Setting};

/// Data for calibrating and testing methods.
#[derive(Clone, Debug)]
pub struct MethodTrial {
    /// Name of the scene in rows.
    pub scene: String,
    /// Name of the scene for people.
    pub text: String,
    /// Positions of the units, if they are known.
    pub layout: Option<ArrayLayout>,
    /// Calibration data.
    pub calibration: Calibration,
    /// Readings to solve.
    pub test: KnownReadings,
    /// Smallest possible errors, and the name of their bound.
    pub least: Option<(MeanBound, &'static str)>,
}

impl MethodTrial {
    /// Returns both scenes of the paper's array: `side` x `side` presses with 1 N, then contacts at random places with 0.1 to 1
    /// N.
    ///
    /// # Errors
    /// Never in practice: simulated presses are suitable for calibration.
    pub fn simulated(side: usize, tests: usize, seed: u64) -> Result<Vec<MethodTrial>, StudyError> {
        let of = |noise: &NoiseReference| {
            let specimen = StudySpecimen::papers(*noise);
            let mut skin = specimen.skin(seed);
            let presses = KnownReadings::of(&mut skin, &grid(side), &mut stream(seed, 0, "calibration noise"));
            let touches = anywhere(tests, FORCES_N, &mut stream(seed, 0, "test contacts"));
            let test = KnownReadings::of(&mut skin, &touches, &mut stream(seed, 0, "test noise"));
            let least = MeanBound::over(&skin, &specimen.skin, FULL_SCALE_N, &test);
            Ok(MethodTrial {
                scene: noise.name().to_owned(),
                text: noise.text().to_owned(),
                layout: Some(specimen.layout),
                calibration: presses.calibration()?,
                test,
                least: least.map(|least| (least, CRAMER_RAO)),
            })
        };
        NoiseReference::ALL.iter().map(of).collect()
    }
}

/// Measures the time of an answer of a model, ns, as a user gets it: with reading its line and writing the answer.
pub type AnswerTimer<'a> = &'a dyn Fn(Model, &KnownReadings) -> Option<f64>;

/// Calibrates every method on each trial, solves its test and measures the times of a solve and of an answer.
pub fn speed_accuracy(
    trials: &[MethodTrial],
    ns_per_answer: AnswerTimer<'_>,
    on_progress: OnProgress<'_>,
) -> Vec<MethodRow> {
    let mut rows: Vec<MethodRow> = Vec::new();
    let tried = in_parallel(trials, |trial| {
        let methods = StudiedMethod::all(&trial.calibration, &Setting::of_layout(trial.layout.as_ref()));
        let tallies: Vec<Tally> = methods.iter().map(|method| Tally::of(method, &trial.test)).collect();
        (methods, tallies)
    });
    let count = trials.len() * StudiedMethod::names().count();
    for (trial, (methods, tallies)) in trials.iter().zip(tried) {
        let first = rows.len();
        for (method, tally) in methods.iter().zip(tallies) {
            let mut row = MethodRow {
                study: "speed-accuracy",
                scene: trial.scene.clone(),
                condition: "solver",
                calibration_presses: trial.calibration.len(),
                ..tally.row(method.name, trial.least)
            };
            // one after another, because two at once would slow each other down. The best is one of them, and takes as long.
            let same = rows[first..].iter().find(|other| method.name == BEST && Some(other.solver) == row.chosen);
            [row.ns_per_solve, row.ns_per_answer] = match same {
                Some(same) => [same.ns_per_solve, same.ns_per_answer],
                None => times(method.name, trial, ns_per_answer),
            };
            rows.push(row);
            on_progress(rows.len(), count);
        }
    }
    let mark = |row: &MethodRow| (row.scene.clone(), row.ns_per_solve.zip(row.mean_mm()));
    let best = pareto(&rows.iter().map(mark).collect::<Vec<_>>());
    rows.iter_mut().zip(best).for_each(|(row, is_best)| row.pareto = Some(is_best));
    rows
}

/// Times of a solve and of an answer, ns, to two digits: more of them change from one measurement to the next.
fn times(method: &str, trial: &MethodTrial, ns_per_answer: AnswerTimer<'_>) -> [Option<f64>; 2] {
    let setting = Setting::of_layout(trial.layout.as_ref());
    let Ok(model) = Model::fit(method, trial.calibration.clone(), &setting) else { return [None; 2] };
    let solve = ns_per_solve(model.fitted(), trial.test.iter().map(|(_, outputs)| outputs));
    [solve, ns_per_answer(model, &trial.test)].map(|ns| ns.map(two_digits))
}

fn two_digits(ns: f64) -> f64 {
    round(ns, 1 - ns.log10().floor() as i32)
}
