//! Sound runs of all families of stages: nothing is wrong, so each run is complete, no force is over the limit, and the last resort is never
//! sent. Judged by the true values, and by what the stage received.
//!
//! ```sh
//! PALPATE_TESTS=full cargo test --test control sound_runs:: -- --nocapture
//! ```

mod holds;
mod wire;

use super::families::{
    ARM, DECLARED_N_MM, ESP301, Family, GRBL, KLIPPER, KLIPPER_THAT_HOLDS, LIMIT_N, MARLIN, PROGRAM, When, XPS,
};
use palpate_control::Strategy;
use palpate_core::quantity::{Place, stream};
use palpate_data::recipe::{self, Plan};
use palpate_run::rig::RigSpec;
use palpate_sim::emulator::{GrblFaultKind, KlipperFaultKind, MarlinFaultKind, Shared, UrFaultKind};
use palpate_sim::scene::Mounting;
use palpate_testing::campaign;
use palpate_testing::executions::{Deaths, ExecutedRun, executed_with, in_parallel, must_be_none};
use rand::RngExt;
use std::fmt::Debug;
use std::ops::Range;
use wire::{Seen, Wire, tap};

/// Sound runs of a family, and of the arm, whose state comes 500 times a second: all of them in a quarter of an hour on two cores.
const RUNS: (usize, usize) = (3, 2500);
const RUNS_OF_ARM: (usize, usize) = (1, 800);

/// Wished forces, N, and the largest depth of one, of the depth limit: a soft specimen isn't pressed deeper.
const FORCE_N: Range<f64> = 0.2..1.8;
const DEPTH: f64 = 0.9;

/// How long before the end of a press a second host jogs, s: in its hold.
const JOG_BEFORE_S: f64 = 4.0;

/// One in so many runs with a map is long enough to learn one, by so many presses more.
const TAUGHT_EVERY: u32 = 4;
const TAUGHT_PRESSES: usize = 9;

/// Largest part of the sound runs that a touch of few mN may end, which moves the outputs of an array in counts before the load cell.
const LIGHT_MOST: f64 = 0.01;

#[test]
fn sound_runs_of_printers_are_complete_without_the_last_resort() {
    MARLIN.runs(wire::MARLIN, RUNS);
    KLIPPER.runs(wire::KLIPPER, RUNS);
}

#[test]
fn sound_runs_of_an_arm_are_complete_without_the_last_resort() {
    ARM.runs(wire::ARM, RUNS_OF_ARM);
}

#[test]
fn sound_runs_of_a_grbl_are_complete_without_the_last_resort() {
    GRBL.runs(wire::GRBL, RUNS);
}

#[test]
fn sound_runs_of_motion_controllers_are_complete_without_the_last_resort() {
    ESP301.runs(wire::ESP301, RUNS);
    XPS.runs(wire::XPS, RUNS);
}

#[test]
fn sound_runs_of_a_program_are_complete_without_the_last_resort() {
    PROGRAM.runs(wire::PROGRAM, RUNS);
}

/// So that a last resort would be seen.
#[test]
fn the_last_resort_is_seen_on_the_wire() {
    const JOG: &str = "G91\nG1 Z-4 F300";
    const MOVEL: &str =
        "def job():\n movel(pose_add(get_actual_tcp_pose(), p[0,0,-0.004,0,0,0]), a=0.1, v=0.005)\nend\n";
    MARLIN.aborts(wire::MARLIN, MarlinFaultKind::Other(JOG));
    GRBL.aborts(wire::GRBL, GrblFaultKind::Other(JOG));
    KLIPPER_THAT_HOLDS.aborts(wire::KLIPPER, KlipperFaultKind::Other(JOG));
    ARM.aborts(wire::ARM, UrFaultKind::Other(MOVEL));
}

/// A sound run.
#[derive(Clone, Copy, Debug)]
struct SoundDraw {
    seed: u64,
    strategy: Strategy,
    /// Stiffness of the specimen, of the declared one.
    share: f64,
    /// How far its surface is from where it is said to be, of the stated uncertainty.
    off: f64,
    hold_s: f64,
    presses: usize,
}

impl SoundDraw {
    fn of(seed: u64, strategies: &[Strategy]) -> SoundDraw {
        let mut rng = stream(seed, 0, "sound runs");
        let strategy = strategies[rng.random_range(0..strategies.len())];
        let presses = rng.random_range(1..=4);
        let is_taught = strategy == Strategy::Map && rng.random_ratio(1, TAUGHT_EVERY);
        SoundDraw {
            seed,
            strategy,
            share: rng.random_range(0.5..=1.0),
            off: rng.random_range(-0.9..=0.9),
            hold_s: rng.random_range(0.0..=5.0),
            presses: if is_taught { presses + TAUGHT_PRESSES } else { presses },
        }
    }

    /// Its plan, or why it is refused.
    fn plan(&self, spec: &RigSpec) -> Result<Plan, String> {
        let SoundDraw { strategy, hold_s, presses, .. } = self;
        let most_n = FORCE_N.end.min(DEPTH * spec.limits.depth_mm * self.share * DECLARED_N_MM);
        let text = format!(
            "name = \"sound\"\nchecks = \"none\"\n[press]\nstrategy = \"{}\"\nforce_tolerance_n = 0.05\nhold_s = {hold_s}\nsample_s = 0.2\n\
             [[step]]\nphase = \"calibration\"\nrandom = {{ count = {presses}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0], force_n = [{}, {most_n:.3}] }}\n",
            strategy.name(),
            FORCE_N.start
        );
        let recipe = recipe::parse("sound.toml", &text).unwrap_or_else(|problems| panic!("{:?}", problems.lines()));
        Plan::new(&recipe, &spec.ground(), self.seed).map_err(|problems| format!("{:?}", problems.lines()))
    }
}

impl<K: Copy + Debug + Send + Sync> Family<K> {
    /// Its rig, with a last resort that is seen where it is sent.
    fn sound_spec(&self) -> RigSpec {
        let mut spec = self.over_specimen();
        spec.stage.z_holds_unpowered = true;
        spec
    }

    /// The strategies that the family accepts. One that needs stops is refused, with a reason, for a stage that finishes each motion.
    fn strategies(&self) -> Vec<Strategy> {
        let spec = self.sound_spec();
        let is_accepted = |strategy: &Strategy| match SoundDraw::of(0, &[*strategy]).plan(&spec) {
            Ok(_) => true,
            Err(why) => {
                assert!(why.contains("this one finishes each motion unchanged"), "{}: {why}", self.rig);
                false
            }
        };
        let strategies: Vec<Strategy> = Strategy::ALL.into_iter().filter(is_accepted).collect();
        let finishes = [MARLIN.rig, KLIPPER.rig, ARM.rig].contains(&self.rig);
        assert_eq!(strategies.contains(&Strategy::Velocity), !finishes, "{}: {strategies:?}", self.rig);
        strategies
    }

    /// Makes sound runs. Prints and checks them.
    fn runs(&self, wire: Wire, (quick, full): (usize, usize)) {
        let strategies = self.strategies();
        let draws: Vec<SoundDraw> =
            (0..campaign::size(quick, full) as u64).map(|seed| SoundDraw::of(seed, &strategies)).collect();
        let outcomes = in_parallel(&draws, |draw| {
            let mut spec = self.sound_spec();
            spec.scene.contact.linear_n_mm = draw.share * DECLARED_N_MM;
            let z_mm = draw.off * spec.frame.uncertainty_mm;
            spec.scene.mounting = Some(Mounting { origin: Place::default(), rotation_deg: 0.0, z_mm });
            let plan = draw.plan(&spec).unwrap_or_else(|why| panic!("{draw:?}: {why}"));
            let seen = Shared::default();
            let run = executed_with(&spec, &plan, Deaths::Ignored, &|rig| {
                self.install(&spec, rig, None);
                tap(rig, wire, None, &seen);
            });
            SoundOutcome::of(&run, &plan, (wire.aborts)(&seen.lock().expect("the run is over").received))
        });
        self.print(&draws, &outcomes);
        self.must_be_sound(&draws, &outcomes);
    }

    /// Checks that a last resort is seen where one is sent: against a second host that moves z down in a press.
    fn aborts(&self, wire: Wire, jog: K) {
        let spec = self.sound_spec();
        let seen = Shared::default();
        let run = |fault, seen: &Shared<Seen>| {
            executed_with(&spec, &self.press(&spec), Deaths::Ignored, &|rig| {
                self.install(&spec, rig, fault);
                tap(rig, wire, None, seen);
            })
        };
        let sound = run(None, &Shared::default());
        run(Some((When::At(sound.virtual_s - JOG_BEFORE_S), jog)), &seen);
        let aborts = (wire.aborts)(&seen.lock().expect("the run is over").received);
        assert!(aborts > 0, "{}: no last resort was seen", self.rig);
    }

    fn print<D>(&self, draws: &[D], outcomes: &[SoundOutcome]) {
        let most = |of: fn(&SoundOutcome) -> f64| outcomes.iter().map(of).fold(0.0, f64::max);
        let total = |of: fn(&SoundOutcome) -> usize| outcomes.iter().map(of).sum::<usize>();
        println!(
            "{}: {} runs, {} presses, {:.0} s at most, largest force {:.4} N, {} ended, {} last resorts",
            self.rig,
            draws.len(),
            total(|outcome| outcome.presses),
            most(|outcome| outcome.virtual_s),
            most(|outcome| outcome.force_n),
            total(|outcome| usize::from(outcome.text.is_some())),
            total(|outcome| outcome.aborts),
        );
    }

    fn must_be_sound<D: Debug>(&self, draws: &[D], outcomes: &[SoundOutcome]) {
        let is_light =
            |outcome: &SoundOutcome| outcome.text.as_ref().is_some_and(|text| text.starts_with("outputs-moved"));
        let is_sound = |outcome: &SoundOutcome| {
            (outcome.text.is_none() || is_light(outcome)) && outcome.force_n <= LIMIT_N && outcome.aborts == 0
        };
        let light = outcomes.iter().filter(|outcome| is_light(outcome)).count();
        assert!(light as f64 <= LIGHT_MOST * outcomes.len() as f64, "{}: {light} touches ended a run", self.rig);
        let broken = draws.iter().zip(outcomes).filter(|(_, outcome)| !is_sound(outcome));
        must_be_none(&broken.map(|(draw, outcome)| format!("{} {draw:?}: {outcome:?}", self.rig)).collect::<Vec<_>>());
    }
}

/// How a run went.
#[derive(Debug)]
struct SoundOutcome {
    /// Why it isn't complete.
    text: Option<String>,
    presses: usize,
    virtual_s: f64,
    force_n: f64,
    aborts: usize,
}

impl SoundOutcome {
    fn of(run: &ExecutedRun, plan: &Plan, aborts: usize) -> SoundOutcome {
        let is_made = run.ledger.contacts().count() == plan.entries.len();
        let is_complete = is_made && run.ending.halt.is_none() && run.ending.unparked.is_none();
        SoundOutcome {
            text: (!is_complete).then(|| run.ending.text().unwrap_or_default()),
            presses: run.ledger.contacts().count(),
            virtual_s: run.virtual_s,
            force_n: run.truth.force_n,
            aborts,
        }
    }
}
