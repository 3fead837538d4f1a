//! Runs in virtual time on a bench, with their true values from the first message until after the end. They are observed at the stage's far
//! end: only a message to the stage changes a motion, so the time between two messages follows from a copy of the scene.

use super::observed::{Observer, observed};
use super::{campaign, exchanged};
use palpate_core::quantity::Axis;
use palpate_data::dataset::Memory;
use palpate_data::recipe::{self, Plan};
use palpate_link::device::Identity;
pub use palpate_link::time::run_virtually;
use palpate_link::time::{Instant, sleep, timeout};
use palpate_run::rig::{self, RigSpec, SimulatedRig};
use palpate_run::run::{Cancel, Ending, Halt, Listener, RunJob, execute_on};
use palpate_sim::emulator::{Instrument, Owed, Shared};
use palpate_sim::scene::{Scene, Truth};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// The benches, by name.
pub const BENCHES: [(&str, &str); 2] = [
    ("bench-fast", include_str!("../../rigs/bench-fast.toml")),
    ("bench-esp301", include_str!("../../rigs/bench-esp301.toml")),
];

/// The benches of a campaign: in the quick tier the first one.
pub fn benches() -> impl Iterator<Item = (&'static str, &'static str)> {
    BENCHES.into_iter().step_by(campaign::every(BENCHES.len(), 1))
}

/// Longest run, s; a longer one doesn't end.
const FOR_EVER: Duration = Duration::from_secs(24 * 3600);

/// Time of observation after the end of a run.
const AFTERWARDS: Duration = Duration::from_secs(30);

/// Upper end of z here, mm: a longer way from home only costs time.
const Z_MOST_MM: f64 = 1.5;

/// The recipe of the benches, with 121 of its 625 presses if only one seed is tried.
pub fn bench_recipe(seeds: u64) -> String {
    let recipe = include_str!("../../recipes/bench.toml");
    if seeds > 1 { recipe.to_owned() } else { recipe.replacen("spacing_mm = 0.5", "spacing_mm = 1.2", 1) }
}

/// A bench as shipped, without the parts that only cost time here: taxels, and most of the way from home.
pub fn bench(name: &str) -> RigSpec {
    let mut spec = bench_with_taxels(name);
    spec.scene.skin.noise = None;
    spec.scene.skin.hysteresis_percent = None;
    spec
}

/// The same with its taxels' noise and hysteresis.
pub fn bench_with_taxels(name: &str) -> RigSpec {
    let text = BENCHES.iter().find(|(bench, _)| *bench == name).expect("a bench").1;
    let mut spec = rig::parse(name, text, &|_| unreachable!("no map of its own")).expect("the shipped rig");
    spec.stage.home_z_mm = Some(spec.stage.travel.axes[Axis::Z.index()].max); // the limit is where it was
    spec.stage.travel.axes[Axis::Z.index()].max = Z_MOST_MM;
    spec
}

/// The text of the simulated rig, without its load cell.
pub fn rig_without_load_cell() -> String {
    without_load_cell(include_str!("../../rigs/sim.toml"))
}

/// The text of a rig, without its load cell.
pub fn without_load_cell(text: &str) -> String {
    let (before, cell) = text.split_once("[load_cell]").expect("it has one");
    let after = cell.find("\n[").map_or("", |at| &cell[at..]);
    format!("load_cell = \"none\"\n{before}{after}")
}

/// The text of the simulated rig, with a load cell of three axes.
pub fn rig_with_three_axes() -> String {
    let text = include_str!("../../rigs/sim.toml");
    let (before, cell) = text.split_once("[load_cell]").expect("it has one");
    let after = cell.find("\n[").map_or("", |at| &cell[at..]);
    let cell = "[load_cell]\ndriver = { lines = \"ati-netft\" }\nlink = \"sim\"\nconversions_hz = 1000.0\n\
        axes = { x = \"x\", y = \"-y\", press = \"-z\" }\n";
    format!("{before}{cell}{after}")
}

/// The same with taxels that feel the force along the surface, on a specimen on which the tip sticks, and with drags allowed.
pub fn rig_with_drags() -> String {
    let rig = rig_with_three_axes();
    let allowed = "drag = { shear_n = 0.9, slide_mm = 1.0, stiffness_n_mm = 1.2, friction = 1.2 }";
    let rig = exchanged(&rig, "force_n = 2.0", &format!("{allowed}\nstiffness_least_n_mm = 1.0\nforce_n = 3.0"));
    let rig = exchanged(
        &rig,
        "grid = { rows = 3, columns = 3, pitch_mm = 4.5 }",
        "grid = { rows = 3, columns = 3, pitch_mm = 4.5 }\nchannels_per_unit = 3",
    );
    let rig = exchanged(&rig, "{ modbus = \"labjack-t7\" }", "{ daqmx = \"Dev1/ai0:26\" }");
    let rig =
        exchanged(&rig, "elastomer = { depth_mm = 5.0 }", "elastomer = { depth_mm = 5.0 }\ntaxels = { shear = true }");
    format!("{rig}\n[scene.friction]\nsticking = 1.0\nsliding = 0.9\nstiffness_n_mm = 1.0\n")
}

/// The plan of a recipe's text on a rig.
pub fn plan(spec: &RigSpec, recipe_text: &str, seed: u64) -> Plan {
    let recipe = recipe::parse("recipe.toml", recipe_text).unwrap_or_else(|p| panic!("{:?}", p.lines()));
    Plan::new(&recipe, &spec.ground(), seed).unwrap_or_else(|p| panic!("{:?}", p.lines()))
}

/// Result of a run.
pub struct ExecutedRun {
    pub ending: Ending,
    pub ledger: Memory,
    /// The largest true values, until everything was at rest again.
    pub truth: WorstTruth,
    /// The largest true values if the host had died after one of the messages.
    pub orphaned: WorstTruth,
    /// When the instruments were ready; 0: never, s.
    pub ready_s: f64,
    /// Its duration, s.
    pub virtual_s: f64,
    /// Messages that the stage received, and their bytes.
    pub messages: usize,
    pub bytes: u64,
    /// The force on the specimen when everything was at rest again, N.
    pub left_n: f64,
}

/// The largest true values.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WorstTruth {
    pub force_n: f64,
    pub depth_mm: f64,
    pub slid_mm: f64,
    /// Force sideways, and length of the whole force.
    pub shear_n: f64,
    pub length_n: f64,
}

impl WorstTruth {
    pub fn take(&mut self, truth: Truth) {
        let Truth { force_peak_n, depth_peak_mm, slid_mm, shear_peak_n, length_peak_n, .. } = truth;
        let (force_n, depth_mm) = (force_peak_n, depth_peak_mm);
        self.join(WorstTruth { force_n, depth_mm, slid_mm, shear_n: shear_peak_n, length_n: length_peak_n });
    }

    pub fn join(&mut self, other: WorstTruth) {
        self.force_n = self.force_n.max(other.force_n);
        self.depth_mm = self.depth_mm.max(other.depth_mm);
        self.slid_mm = self.slid_mm.max(other.slid_mm);
        self.shear_n = self.shear_n.max(other.shear_n);
        self.length_n = self.length_n.max(other.length_n);
    }

    /// Whether force, depth and sideways motion stayed within the rig's limits.
    pub fn is_within(&self, spec: &RigSpec) -> bool {
        self.force_n <= spec.limits.force_n && self.depth_mm <= spec.limits.depth_mm && self.slid_mm == 0.0
    }
}

/// Notes the time when the first press begins.
struct SilentRun {
    began: Instant,
    ready_s: f64,
}

impl Listener for SilentRun {
    fn ready(&mut self, _: &[Identity]) {
        self.ready_s = self.began.elapsed().as_secs_f64();
    }
}

/// The far ends of a rig, which can be replaced before the run.
pub type Tamper<'a> = &'a dyn Fn(&mut SimulatedRig);

/// Executes a plan.
pub fn executed(spec: &RigSpec, plan: &Plan) -> ExecutedRun {
    executed_with(spec, plan, Deaths::Ignored, &|_| {})
}

/// Whether the result is calculated after every message as if it were the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Deaths {
    Ignored,
    Tried,
}

/// Executes a plan on a changed rig.
pub fn executed_with(spec: &RigSpec, plan: &Plan, deaths: Deaths, tamper: Tamper) -> ExecutedRun {
    executed_until(spec, plan, FOR_EVER, deaths, tamper)
}

/// Executes a plan on a changed rig. A person asks to stop after this time.
pub fn executed_until(
    spec: &RigSpec,
    plan: &Plan,
    asked_after: Duration,
    deaths: Deaths,
    tamper: Tamper,
) -> ExecutedRun {
    run_virtually(async {
        let mut rig = spec.emulators(plan.seed).expect("emulators");
        tamper(&mut rig);
        let scene = rig.scene.clone();
        let stage = rig.stage.instrument().expect("it has a link").clone();
        let watched = Arc::new(Mutex::new(Watched { deaths, left: None, seen: ExecutionSeen::default() }));
        rig.stage.replace(observed(stage, Eye { watched: watched.clone() }));
        let (mut ledger, cancel, began) = (Memory::default(), Cancel::default(), Instant::now());
        let rig = spec.open_on(rig).expect("drivers");
        let job = RunJob { plan, spec, ledger: &mut ledger, cancel: &cancel, shown: &|_| {} };
        let mut listener = SilentRun { began, ready_s: 0.0 };
        let ended = timeout(FOR_EVER, execute_on(rig, job, &mut listener));
        let asked = async {
            sleep(asked_after).await;
            cancel.ask();
            std::future::pending().await
        };
        let ending = tokio::select! {
            biased;
            ended = ended => ended.expect("it doesn't end by itself"),
            () = asked => unreachable!("it is pending"),
        };
        let virtual_s = began.elapsed().as_secs_f64();
        sleep(AFTERWARDS).await; // late messages have had their effect by then
        let now_s = began.elapsed().as_secs_f64();
        let mut watched = watched.lock().expect("the walk is over");
        watched.look(now_s);
        let at_rest = scene.lock().expect("the walk is over").run_out(now_s);
        watched.seen.truth.take(at_rest);
        let ExecutionSeen { truth, orphaned, messages, bytes } = watched.seen;
        ExecutedRun {
            ending,
            ledger,
            truth,
            orphaned,
            ready_s: listener.ready_s,
            virtual_s,
            messages,
            bytes,
            left_n: at_rest.force_true_n,
        }
    })
}

/// End of a run: the rule that tripped, `device` for an instrument that failed, `unparked` if the plan is complete and the stage couldn't
/// be parked, `-` if nothing was noticed.
pub fn end_of(ending: &Ending) -> &'static str {
    match &ending.halt {
        None if ending.unparked.is_some() => "unparked",
        None => "-",
        Some(Halt::Tripped(trip)) => trip.rule.name(),
        Some(Halt::Device(_) | Halt::Missed(_)) => "device",
        Some(Halt::Cancelled | Halt::OutOfBounds(_) | Halt::Record(_) | Halt::Unconfirmed(_)) => {
            panic!("{:?}", ending.text())
        }
    }
}

/// Observes the links of the stage, and the true values.
#[derive(Clone)]
struct Eye {
    watched: Shared<Watched>,
}

/// What the links of a stage have in common.
struct Watched {
    deaths: Deaths,
    /// The scene after the last message that began or changed a motion.
    left: Option<Scene>,
    seen: ExecutionSeen,
}

#[derive(Clone, Copy, Default)]
struct ExecutionSeen {
    truth: WorstTruth,
    orphaned: WorstTruth,
    messages: usize,
    bytes: u64,
}

impl Watched {
    /// Events since the last message that began or changed a motion.
    fn look(&mut self, now_s: f64) {
        if let Some(mut scene) = self.left.take() {
            self.seen.truth.take(scene.take_truth(now_s));
        }
    }
}

impl Eye {
    /// Lets the stage act on the scene, and looks whether a motion began or changed.
    fn watch<T>(&self, scene: &mut Scene, now_s: f64, act: impl FnOnce(&mut Scene) -> T) -> T {
        let motions = |scene: &Scene| Axis::ALL.map(|axis| scene.motion(axis).clone());
        let before = motions(scene);
        let acted = act(scene);
        let mut watched = self.watched.lock().expect("a device that lives");
        if watched.left.is_none() || motions(scene) != before {
            watched.look(now_s);
            let mut left = scene.clone();
            left.take_truth(now_s);
            watched.left = Some(left);
        }
        acted
    }
}

impl Observer for Eye {
    fn answer(&self, stage: &mut dyn Instrument, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let reply = self.watch(scene, now_s, |scene| stage.answer(request, scene, now_s));
        let mut watched = self.watched.lock().expect("a device that lives");
        watched.seen.messages += 1;
        watched.seen.bytes += request.len() as u64;
        if watched.deaths == Deaths::Tried {
            watched.seen.orphaned.take(scene.run_out(now_s));
        }
        reply
    }

    fn owed(&self, stage: &mut dyn Instrument, scene: &mut Scene, now_s: f64) -> Owed {
        self.watch(scene, now_s, |scene| stage.owed(scene, now_s))
    }
}

/// Fails with all broken bounds.
pub fn must_be_none(broken: &[String]) {
    assert!(broken.is_empty(), "{} runs:\n{}", broken.len(), broken.join("\n"));
}

/// As [`run_virtually`], by tokio's paused clock.
pub fn in_tokios_virtual_time<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_time().start_paused(true).build().unwrap().block_on(future)
}

/// Does all jobs on as many threads as there are cores; returns their results in order.
pub fn in_parallel<J: Sync, R: Send>(jobs: &[J], work: impl Fn(&J) -> R + Sync) -> Vec<R> {
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::with_capacity(jobs.len())));
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some((i, job)) =
                    Some(next.fetch_add(1, Ordering::Relaxed)).and_then(|i| Some((i, jobs.get(i)?)))
                {
                    let came = work(job);
                    done.lock().expect("no other job panicked").push((i, came));
                }
            });
        }
    });
    let mut done = done.into_inner().expect("no job panicked");
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, came)| came).collect()
}
