//! Stiff specimens: from silicone to steel, every sound run is complete, and its force exceeds the set one by no more than a step of the stage
//! and the noise of the load cell explain. Judged by the true values.
//!
//! ```sh
//! PALPATE_TESTS=full cargo test --test control stiff:: -- --nocapture
//! ```

use super::families::{ESP301, When, shipped_rig};
use palpate_control::Strategy;
use palpate_core::quantity::{Axis, stream};
use palpate_run::rig::RigSpec;
use palpate_sim::emulator::EspFaultKind;
use palpate_sim::scene::{ContactLaw, LoadCellScene};
use palpate_testing::campaign;
use palpate_testing::executions::{
    Deaths, ExecutedRun, bench, end_of, executed, executed_with, in_parallel, must_be_none, plan,
};
use rand::RngExt;
use std::collections::BTreeMap;
use std::ops::Range;

/// Stiffness, N/mm: soft silicone, rubber, hard plastic, a steel ball on steel.
const STIFFNESSES: [f64; 7] = [1.0, 5.0, 20.0, 50.0, 100.0, 200.0, 500.0];

const RIGS: [&str; 3] = ["esp301", "xps", "bench-fast"];

/// Seeds and presses of a combination: quick, and full. A map is taught by ten presses.
const SEEDS: (usize, usize) = (1, 5);
const PRESSES: (usize, usize) = (2, 16);

/// Forces of the presses, N; the limit is 2 N.
const FORCES_N: Range<f64> = 0.3..1.8;

/// Quick: one in so many combinations.
const QUICK_EVERY: usize = 16;

/// Smallest step that is commanded, mm. The controller of the bench rounds each displacement to it, and the driver takes its count only where it
/// is farther than this from the sum of what was sent (`COUNT_MM`). And noise of the load cell, N.
const STEP_MM: f64 = 0.0001;
const COUNTED_MM: f64 = 0.0002;
const NOISE_N: f64 = 0.003;
/// Force over the set one that the noise explains, in sd of the cell.
const SIGMAS: f64 = 4.0;
/// Part of the force by which the last trim of `map` goes beyond it on a specimen that relaxes: what is lost until the middle of the window.
/// A branch of 5 % with 0.3 s loses a fifth of it in 70 ms.
const FADES: f64 = 0.01;
/// Force by which this trim may miss, N: it closes three tolerances of 50 mN at most, with a stiffness that is known to a twentieth.
const TRIM_N: f64 = 0.0075;
/// Largest part of the runs that the first touch may end, because it was too light for the cell and not for the array. A look on steel goes
/// 4 um, and the first 0.3 um of a tip that is round give so little.
const LIGHT_MOST: f64 = 0.03;

/// Levels up and down after the presses, N: so that unloading is seen too.
const STAIRS: &str = "[[step]]\nphase = \"characterisation\"\nlist = { places_mm = [[0.5, 0.5]] }\nstaircase = { to_n = 1.6, step_n = 0.4, \
    repeats = 1, rest_s = 1.0 }\n";

/// Height from which z descends, mm: a longer way from home only costs time.
const ABOVE_MM: f64 = 0.8;

/// A sound run on a specimen.
#[derive(Clone, Copy, Debug)]
struct StiffDraw {
    stiffness_n_mm: f64,
    rig: &'static str,
    strategy: Strategy,
    seed: u64,
}

/// How it went.
struct StiffOutcome {
    end: String,
    /// True force over the set one, N: largest at any time, and in the window either way.
    over_n: f64,
    off_n: f64,
    is_within: bool,
    virtual_s: f64,
}

impl StiffDraw {
    fn all() -> Vec<StiffDraw> {
        let mut all = Vec::new();
        for stiffness_n_mm in STIFFNESSES {
            for rig in RIGS {
                for strategy in Strategy::ALL {
                    let draw = |seed| StiffDraw { stiffness_n_mm, rig, strategy, seed };
                    all.extend((1..=campaign::size(SEEDS.0, SEEDS.1) as u64).map(draw));
                }
            }
        }
        all.into_iter().rev().step_by(campaign::every(QUICK_EVERY, 1)).collect() // steel first
    }

    /// The rig over its specimen, which relaxes in every second seed. In two of three it takes the tip 10 um to be in full contact.
    fn spec(&self) -> RigSpec {
        let StiffDraw { stiffness_n_mm, rig, seed, .. } = *self;
        let mut spec = match rig {
            "bench-fast" => bench(rig),
            _ => shipped_rig(&format!("rigs/{rig}.toml")),
        };
        let z = &mut spec.stage.travel.axes[Axis::Z.index()];
        if rig == "xps" {
            (spec.frame.surface_z_mm, z.max) = (-ABOVE_MM / 2.0, ABOVE_MM / 2.0); // it homes at 0
        } else {
            spec.stage.home_z_mm.get_or_insert(z.max); // the limit is where it was
            z.max = ABOVE_MM;
        }
        let declared = stream(seed, 0, "stiff specimens").random_range(1.0..=1.1);
        spec.limits.stiffness_n_mm = declared * stiffness_n_mm;
        spec.limits.depth_mm = spec.limits.depth_mm.max(3.0 * spec.limits.force_n / stiffness_n_mm);
        let scene = &mut spec.scene;
        let is_relaxing = self.is_relaxing();
        if !is_relaxing {
            scene.relaxation.clear();
        }
        let sudden =
            if is_relaxing { 1.0 + scene.relaxation.iter().map(|branch| branch.share).sum::<f64>() } else { 1.0 };
        let toe_mm = if seed % 3 == 1 { 0.0 } else { 0.01 };
        scene.contact = ContactLaw { linear_n_mm: stiffness_n_mm / sudden, quadratic_n_mm2: 0.0, toe_mm };
        scene.stiffness = None; // the stiffest place is the declared one
        let cell = scene.load_cell.unwrap_or_default();
        scene.load_cell = Some(LoadCellScene { noise_n: NOISE_N, ..cell });
        spec
    }

    fn run(&self) -> StiffOutcome {
        self.run_of(campaign::size(PRESSES.0, PRESSES.1))
    }

    /// Runs this number of presses.
    fn run_of(&self, presses: usize) -> StiffOutcome {
        let spec = self.spec();
        let text = format!(
            "name = \"stiff\"\nchecks = \"none\"\n[press]\nstrategy = \"{}\"\n[[step]]\nphase = \"calibration\"\n\
             random = {{ count = {}, x_mm = [-4.0, 4.0], y_mm = [-4.0, 4.0], force_n = [{}, {}] }}\n",
            self.strategy.name(),
            presses,
            FORCES_N.start,
            FORCES_N.end,
        );
        let text = if campaign::is_quick() { text } else { text + STAIRS };
        StiffOutcome::of(&executed(&spec, &plan(&spec, &text, self.seed)), &spec)
    }

    fn is_relaxing(&self) -> bool {
        self.seed.is_multiple_of(2)
    }

    /// Largest force over a set one, N.
    fn over_most_n(&self) -> f64 {
        let step_mm = if self.rig == "bench-fast" { COUNTED_MM } else { STEP_MM };
        let trim_n = match self.strategy {
            Strategy::Map if self.is_relaxing() => TRIM_N + FADES * FORCES_N.end,
            Strategy::Map => TRIM_N,
            _ => 0.0,
        };
        step_mm * self.stiffness_n_mm + SIGMAS * NOISE_N + trim_n
    }
}

impl StiffOutcome {
    fn of(run: &ExecutedRun, spec: &RigSpec) -> StiffOutcome {
        let (mut over_n, mut off_n) = (f64::NEG_INFINITY, 0f64);
        for contact in run.ledger.contacts() {
            let set_n = contact.levels[0].force_set_n.expect("a force");
            over_n = over_n.max(contact.truth[0].force_peak_n - set_n);
            off_n = off_n.max((contact.truth[0].force_true_n - set_n).abs());
        }
        let end = match end_of(&run.ending) {
            "-" => "-".to_owned(),
            _ => format!("{} after {} presses", run.ending.text().unwrap_or_default(), run.ledger.contacts().count()),
        };
        StiffOutcome { end, over_n, off_n, is_within: run.truth.is_within(spec), virtual_s: run.virtual_s }
    }
}

#[test]
fn sound_runs_on_specimens_from_silicone_to_steel_are_complete() {
    let draws = StiffDraw::all();
    let outcomes = in_parallel(&draws, StiffDraw::run);
    let mut rows: BTreeMap<(usize, &str, &str), Vec<&StiffOutcome>> = BTreeMap::new();
    for (draw, outcome) in draws.iter().zip(&outcomes) {
        let key = (draw.stiffness_n_mm as usize, draw.rig, draw.strategy.name());
        rows.entry(key).or_default().push(outcome);
    }
    println!("{:>8} {:>10} {:>9} {:>8} {:>8} {:>8}  ends", "N/mm", "rig", "strategy", "over mN", "off mN", "s");
    for ((n_mm, rig, strategy), outcomes) in rows {
        let most = |of: fn(&StiffOutcome) -> f64| outcomes.iter().map(|outcome| of(outcome)).fold(f64::MIN, f64::max);
        let mut ends: BTreeMap<&str, usize> = BTreeMap::new();
        outcomes
            .iter()
            .for_each(|outcome| *ends.entry(outcome.end.split(':').next().unwrap_or_default()).or_default() += 1);
        let (over_mn, off_mn) = (1e3 * most(|outcome| outcome.over_n), 1e3 * most(|outcome| outcome.off_n));
        println!(
            "{n_mm:>8} {rig:>10} {strategy:>9} {over_mn:>8.1} {off_mn:>8.1} {:>8.0}  {ends:?}",
            most(|outcome| outcome.virtual_s)
        );
    }
    let is_light = |outcome: &StiffOutcome| outcome.end.starts_with("outputs-moved");
    let light = outcomes.iter().filter(|outcome| is_light(outcome)).count();
    // the quick tier has too few runs for a share
    assert!(light as f64 <= (LIGHT_MOST * outcomes.len() as f64).ceil(), "{light} light touches");
    let is_sound = |draw: &StiffDraw, outcome: &StiffOutcome| {
        (outcome.end == "-" || is_light(outcome)) && outcome.over_n <= draw.over_most_n() && outcome.is_within
    };
    let broken = draws.iter().zip(&outcomes).filter(|(draw, outcome)| !is_sound(draw, outcome));
    let text = |(draw, outcome): (&StiffDraw, &StiffOutcome)| {
        format!(
            "{draw:?}: {} ({:.1} mN over, at most {:.1})",
            outcome.end,
            1e3 * outcome.over_n,
            1e3 * draw.over_most_n()
        )
    };
    must_be_none(&broken.map(text).collect::<Vec<_>>());
}

/// A motion that was slowed ends later than its profile at full speed, and the stage settles after that.
#[test]
fn a_slowed_motion_that_reaches_its_target_settles_before_a_mean() {
    const PRESSES: usize = 8;
    let run = |&seed: &u64| {
        let (rig, strategy) = ("bench-fast", Strategy::Velocity);
        StiffDraw { stiffness_n_mm: 20.0, rig, strategy, seed }.run_of(PRESSES)
    };
    let ends: Vec<String> = in_parallel(&[3, 5], run).into_iter().map(|outcome| outcome.end).collect();
    assert_eq!(ends, ["-", "-"]);
}

/// Rise of the force at rest in a run with a stage that creeps, N/s, and when it begins before the end of its sound twin, s: in the hold. Until
/// the end of the hold it is less than what counts as a hard contact.
const CREEP_N_S: f64 = 0.02;
const CREEP_BEFORE_S: f64 = 3.0;
const CREEP_HOLD_S: f64 = 4.0;

/// Runs a press of 1 N with a long hold. The stage moves on by itself after a time, if one is given. Returns how the run ended, its largest
/// force, N, and its duration, s.
fn held(stiffness_n_mm: f64, creeps_at_s: Option<f64>) -> (String, f64, f64) {
    let spec = StiffDraw { stiffness_n_mm, rig: "esp301", strategy: Strategy::Guarded, seed: 1 }.spec();
    let text = format!(
        "name = \"held\"\nchecks = \"none\"\n[press]\nhold_s = {CREEP_HOLD_S}\n[[step]]\nphase = \"calibration\"\n\
         list = {{ places_mm = [[0.0, 0.0]] }}\nforce_n = 1.0\n"
    );
    // in the controller's decimals, and far enough for the hold
    let creep =
        format!("3VA{:.5};3PR-{:.5}", CREEP_N_S / stiffness_n_mm, 2.0 * CREEP_HOLD_S * CREEP_N_S / stiffness_n_mm);
    let fault = creeps_at_s.map(|at_s| (When::At(at_s), EspFaultKind::Other(creep.leak())));
    let run = executed_with(&spec, &plan(&spec, &text, 1), Deaths::Ignored, &|rig| ESP301.install(&spec, rig, fault));
    (run.ending.text().unwrap_or_default(), run.truth.force_n, run.virtual_s)
}

#[test]
fn stage_that_moves_on_at_rest_trips_at_each_stiffness() {
    let stiffnesses: Vec<f64> = STIFFNESSES.into_iter().step_by(campaign::every(4, 1)).collect();
    let outcomes = in_parallel(&stiffnesses, |&stiffness_n_mm| {
        let (sound, _, sound_s) = held(stiffness_n_mm, None);
        let (end, force_n, _) = held(stiffness_n_mm, Some(sound_s - CREEP_BEFORE_S));
        println!("{stiffness_n_mm} N/mm: {sound:?}, then {end:?}, {force_n:.3} N");
        (sound.is_empty(), end, force_n)
    });
    let broken = stiffnesses.iter().zip(&outcomes).filter_map(|(n_mm, (is_sound, end, force_n))| {
        // on a soft specimen the stage moves so far that its own read-back shows it
        let is_seen = end.starts_with("rises-at-rest") || end.contains("something else moved it");
        (!is_sound || !is_seen || *force_n > FORCES_N.end)
            .then(|| format!("{n_mm} N/mm: {is_sound}, {end}, {force_n:.3} N"))
    });
    must_be_none(&broken.collect::<Vec<_>>());
}
