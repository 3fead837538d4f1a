//! Safety, end to end: whole walks through the simulated rig, real drivers and framing included, in virtual time. What
//! really happened is asked of the scene, so that the loop is judged against the truth and not against its own load cell.

use palpate::control::{Permit, Rule, Standing, Zero};
use palpate::dataset::{self, Origins, RunFacts, RunFolder, Session, Status};
use palpate::device::{LoadCell as _, Reins, Stage, StageUse};
use palpate::driver::Esp301;
use palpate::driver::modbus::{ModbusLoadCell, Transport};
use palpate::emulator::{Instrument, Shared, serve};
use palpate::quantity::{Axis, Down, Limits, Place, Range};
use palpate::recipe::{self, Plan};
use palpate::rig::{self, RigSpec, SimulatedRig};
use palpate::run::{Cancel, Ending, Errand, Halt, Listener, walk};
use palpate::scene::{Branch, Contact, LoadCell, Scene, SceneSpec, Trajectory};
use palpate::wire::Connector;
use std::cell::Cell;
use std::future::Future;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep};

/// What the conversion of the load cell to whole mN may add to what is shown, N.
const COUNT_N: f64 = 0.001;

const STAIRCASE: &str = "staircase = { to_n = 2.0, step_n = 0.5, repeats = 1, rest_s = 0.0 }";

fn paper_rig() -> RigSpec {
    rig::parse("sim.toml", include_str!("../rigs/sim.toml"), &|_| unreachable!()).unwrap()
}

/// The paper's rig with another specimen in it: no taxels, which only cost time here.
fn rig_with(change: impl FnOnce(&mut RigSpec, &mut SceneSpec)) -> RigSpec {
    let mut spec = paper_rig();
    let mut scene = spec.scene.clone();
    scene.skin.noise = None;
    scene.skin.hysteresis_percent = None;
    change(&mut spec, &mut scene);
    spec.scene = scene;
    spec
}

/// A recipe of one step: these places, loaded so.
fn recipe(places: &str, load: &str) -> String {
    format!(
        "name = \"safety\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.2\nsample_s = 0.1\n\
         [[step]]\nphase = \"test\"\nlist = {{ places_mm = {places} }}\n{load}\n"
    )
}

/// A run folder in a place of its own, and what is to be done in it.
struct Bench {
    spec: RigSpec,
    plan: Plan,
    folder: RunFolder,
    _home: tempfile::TempDir,
}

/// How a walk went.
struct Walked {
    ending: Ending,
    /// The largest force the load cell was seen to read, N.
    shown_most_n: f64,
    /// Forces that were seen.
    readings: u32,
    virtual_s: f64,
}

struct Silent;

impl Listener for Silent {}

impl Bench {
    fn new(spec: RigSpec, recipe_text: &str, seed: u64) -> Bench {
        let recipe = recipe::parse("recipe.toml", recipe_text).unwrap_or_else(|p| panic!("{:?}", p.lines()));
        let plan = Plan::new(&recipe, &spec.ground(), seed).unwrap_or_else(|p| panic!("{:?}", p.lines()));
        let home = tempfile::tempdir().unwrap();
        let facts = RunFacts::new(&plan, true);
        let origins = Origins { recipe: recipe_text.to_owned(), rig: String::new(), maps: Vec::new() };
        let (out, session) = (home.path().join("run"), Session::default());
        let folder = RunFolder::create(Some(&out), &origins, facts, session, &spec.array.layout).unwrap();
        Bench { spec, plan, folder, _home: home }
    }

    /// Walks the plan; a stop is asked for at this reading of the force, if any.
    fn walk(&mut self, stop_at: Option<u32>) -> Walked {
        let (most, readings, cancel) = (Cell::new(f64::NEG_INFINITY), Cell::new(0), Cancel::default());
        let shown = |force_n: f64| {
            most.set(most.get().max(force_n));
            readings.set(readings.get() + 1);
            if stop_at == Some(readings.get()) {
                cancel.ask();
            }
        };
        if stop_at == Some(0) {
            cancel.ask();
        }
        let Bench { spec, plan, folder, .. } = self;
        let errand = Errand { plan, spec, ledger: folder, cancel: &cancel, shown: &shown };
        let (ending, virtual_s) = in_virtual_time(async {
            let began = Instant::now();
            (walk(errand, &mut Silent).await, began.elapsed().as_secs_f64())
        });
        Walked { ending, shown_most_n: most.get(), readings: readings.get(), virtual_s }
    }

    /// What was recorded, in the order of its numbers.
    fn contacts(&self) -> impl Iterator<Item = dataset::Contact> {
        self.folder.contacts().unwrap().map(Result::unwrap)
    }

    /// The largest true force and the deepest true indentation of all that was recorded.
    fn worst(&self) -> (f64, f64) {
        let truths = self.contacts().flat_map(|contact| contact.truth);
        truths.fold((0.0, 0.0), |(n, mm), truth| (truth.force_peak_n.max(n), truth.depth_peak_mm.max(mm)))
    }

    /// The press and the level of each line of `presses.csv`.
    fn rows_on_disk(&self) -> Vec<(u64, u64)> {
        let mut table = csv::Reader::from_path(self.folder.path().join("presses.csv")).unwrap();
        let row = |line: csv::StringRecord| (line[0].parse().unwrap(), line[1].parse().unwrap());
        table.records().map(|line| row(line.unwrap())).collect()
    }

    /// Walks a plan that must be done whole, within every limit, each level within its tolerance.
    fn must_complete(&mut self, told: &str) {
        let walked = self.walk(None);
        assert_eq!(walked.ending.status(), Status::Complete, "{told}: {:?}", walked.ending.told());
        let (peak_n, depth_mm) = self.worst();
        let limits = self.spec.limits;
        assert!(peak_n <= limits.force_n, "{told}: {peak_n} N");
        assert!(depth_mm <= limits.depth_mm, "{told}: {depth_mm} mm");
        assert_eq!(self.folder.manifest().presses_done, self.plan.entries.len() as u64, "{told}");
        for (entry, contact) in self.plan.entries.iter().zip(self.contacts()) {
            for (row, truth) in contact.rows.iter().zip(&contact.truth) {
                let error_n = truth.force_true_n - row.force_set_n;
                assert!(
                    error_n.abs() <= entry.task.force_tolerance_n,
                    "{told}: level {} of press {} off by {error_n} N",
                    row.level,
                    row.press
                );
            }
        }
    }

    /// Walks a plan that must end with a trip, recorded, the stage parked.
    fn must_trip(&mut self, rules: &[Rule], told: &str) -> Walked {
        let walked = self.walk(None);
        let Some(Halt::Tripped(trip)) = &walked.ending.halt else {
            panic!("{told}: no trip but {:?}", walked.ending.told());
        };
        assert!(rules.contains(&trip.rule), "{told}: {trip}");
        assert!(walked.ending.unparked.is_none(), "{told}: {:?}", walked.ending.told());
        assert_eq!(walked.ending.status(), Status::Tripped, "{told}");
        assert_eq!(self.folder.manifest().trip.as_ref(), Some(trip), "{told}: the manifest");
        assert!(walked.virtual_s < 120.0, "{told}: {} s", walked.virtual_s);
        walked
    }
}

fn in_virtual_time<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_all().start_paused(true).build().unwrap().block_on(future)
}

fn linear(n_mm: f64) -> Contact {
    Contact { linear_n_mm: n_mm, quadratic_n_mm2: 0.0, toe_mm: 0.0 }
}

/// A load cell that tells the truth, so that what is shown is what was.
fn truthful(scene: &mut SceneSpec) {
    scene.load_cell = None;
}

// ---- force and depth -----------------------------------------------------------------------------------------------

#[test]
fn the_force_at_the_limit_never_exceeds_it_over_forty_seeds() {
    for seed in 1..=40 {
        let place = ["[[0, 0]]", "[[5.5, -4]]", "[[-6, 6]]", "[[-3, -6]]"][seed as usize % 4];
        Bench::new(rig_with(|_, _| {}), &recipe(place, STAIRCASE), seed).must_complete(&format!("seed {seed}"));
    }
}

#[test]
fn a_rig_mounted_any_way_round_presses_the_same() {
    let mount = |down: Down, surface_z_mm: f64, origin: Place, z: Range| {
        rig_with(|spec, _| {
            spec.frame.down = down;
            spec.frame.surface_z_mm = surface_z_mm;
            spec.frame.origin = origin;
            spec.stage.travel.axes[Axis::Z.index()] = z;
        })
    };
    let whole = Range { min: -12.5, max: 12.5 };
    for (i, (down, z_mm, x_mm, y_mm, z)) in [
        (Down::Plus, 0.0, 0.0, 0.0, whole),
        (Down::Plus, 9.25, 5.0, -4.5, Range { min: -3.0, max: 12.0 }),
        (Down::Plus, -8.0, -6.0, 6.0, whole),
        (Down::Minus, -7.125, 6.0, -6.0, Range { min: -12.5, max: 2.0 }),
        (Down::Minus, 11.0, -6.5, 2.25, whole),
    ]
    .into_iter()
    .enumerate()
    {
        let spec = mount(down, z_mm, Place::new(x_mm, y_mm), z);
        let text = recipe("[[-5, 5], [5, 5], [0, -5]]", STAIRCASE);
        Bench::new(spec, &text, 100 + i as u64).must_complete(&format!("mount {i}"));
    }
}

#[test]
fn a_specimen_as_stiff_as_declared_bears_no_more_than_the_limit() {
    let branch = |share, time_s| Branch { share, time_s };
    for (i, (contact, relaxation, declared, force_n)) in [
        (linear(1.8), vec![branch(0.05, 0.3), branch(0.05, 5.0)], 1.98, 2.0),
        (linear(2.0), vec![], 2.0, 2.0),
        (linear(1.0), vec![branch(0.5, 0.05), branch(0.5, 5.0)], 2.0, 1.8),
        (Contact { linear_n_mm: 0.8, quadratic_n_mm2: 0.5, toe_mm: 0.05 }, vec![], 2.2, 2.0),
        (linear(18.0), vec![branch(0.1, 1.0)], 20.0, 2.0),
    ]
    .into_iter()
    .enumerate()
    {
        for seed in 1..=4 {
            let spec = rig_with(|spec, scene| {
                spec.limits.stiffness_n_mm = declared;
                (scene.contact, scene.relaxation) = (contact, relaxation.clone());
            });
            let told = format!("specimen {i}, seed {seed}");
            let text = recipe("[[-5, 5], [4, -3]]", &format!("force_n = {force_n:?}"));
            Bench::new(spec, &text, seed).must_complete(&told);
        }
    }
}

#[test]
fn a_load_cell_that_is_slow_is_waited_for() {
    // a conversion that was held before a motion ended isn't the force after it
    for conversions_hz in [10.0, 20.0, 50.0, 1000.0] {
        for seed in 1..=4 {
            let spec = rig_with(|spec, scene| {
                spec.load_cell.conversions_hz = conversions_hz;
                spec.limits.stiffness_n_mm = 1.98;
                scene.contact = linear(1.8);
            });
            let told = format!("{conversions_hz} Hz, seed {seed}");
            Bench::new(spec, &recipe("[[-5, 5], [4, -3]]", "force_n = 2.0"), seed).must_complete(&told);
        }
    }
}

#[test]
fn an_offset_of_the_load_cell_is_no_force() {
    for offset_n in [-1.5, -0.4, 0.4, 1.5] {
        let spec =
            rig_with(|_, scene| scene.load_cell = Some(LoadCell { noise_n: 0.003, offset_n, ..LoadCell::default() }));
        Bench::new(spec, &recipe("[[1, 2]]", STAIRCASE), 5).must_complete(&format!("offset {offset_n} N"));
    }
}

#[test]
fn a_noisy_load_cell_doesnt_cost_force() {
    for seed in 1..=10 {
        let spec = rig_with(|_, scene| {
            scene.load_cell = Some(LoadCell { noise_n: 0.02, offset_n: 0.0, ..LoadCell::default() })
        });
        let mut bench = Bench::new(spec, &recipe("[[1, 2]]", "force_n = 1.9"), seed);
        let walked = bench.walk(None);
        assert!(walked.ending.unparked.is_none());
        let (peak_n, depth_mm) = bench.worst();
        assert!(peak_n <= 2.0 && depth_mm <= 1.6, "seed {seed}: {peak_n} N, {depth_mm} mm");
    }
}

#[test]
fn depth_is_held_where_the_specimen_yields_late() {
    // a soft start: contact is felt well after it began, and the depth limit is what binds
    for (i, contact) in [
        Contact { linear_n_mm: 0.1, quadratic_n_mm2: 1.0, toe_mm: 0.0 },
        Contact { linear_n_mm: 0.6, quadratic_n_mm2: 0.0, toe_mm: 0.3 },
        Contact { linear_n_mm: 0.05, quadratic_n_mm2: 0.4, toe_mm: 0.0 },
    ]
    .into_iter()
    .enumerate()
    {
        let spec = rig_with(|spec, scene| {
            spec.limits.stiffness_n_mm = 4.0;
            scene.contact = contact;
            truthful(scene);
        });
        // as much as the specimen bears at the depth limit, so that the press ends there, done or tripped
        let deepest_n = contact.force_n(spec.limits.depth_mm);
        let load = format!("force_n = {:.3}", (deepest_n * 1.02).min(2.0));
        let mut bench = Bench::new(spec, &recipe("[[-4, 1], [3, 3]]", &load), 3);
        let walked = bench.walk(None);
        assert!(walked.ending.unparked.is_none(), "specimen {i}");
        let (peak_n, depth_mm) = bench.worst();
        assert!(peak_n <= 2.0 && depth_mm <= 1.6, "specimen {i}: {peak_n} N, {depth_mm} mm");
        // 10 % for what the branches add
        assert!(walked.shown_most_n <= 1.1 * deepest_n, "specimen {i}: {} of {deepest_n} N", walked.shown_most_n);
    }
}

// ---- trips ---------------------------------------------------------------------------------------------------------

#[test]
fn a_specimen_too_soft_for_the_force_trips_at_the_depth_limit() {
    for seed in 1..=5 {
        let spec = rig_with(|_, scene| {
            scene.contact = linear(0.3);
            scene.relaxation.clear();
            truthful(scene);
        });
        let depth_limit_mm = spec.limits.depth_mm;
        let mut bench = Bench::new(spec, &recipe("[[2, -2]]", "force_n = 1.0"), seed);
        let walked = bench.must_trip(&[Rule::OutOfReach], &format!("seed {seed}"));
        // nothing relaxes and nothing is noise, so that the force tells the depth
        let depth_mm = (walked.shown_most_n - COUNT_N) / 0.3;
        assert!(depth_mm <= depth_limit_mm, "seed {seed}: {depth_mm} mm");
    }
}

#[test]
fn without_a_specimen_it_trips_where_the_surface_must_have_been() {
    let spec = rig_with(|_, scene| {
        scene.contact = linear(1e-6);
        scene.relaxation.clear();
    });
    Bench::new(spec, &recipe("[[0, 0]]", "force_n = 1.0"), 1).must_trip(&[Rule::NoContact], "no specimen");
}

#[test]
fn a_surface_beyond_the_declared_uncertainty_is_not_pressed_beyond_the_limit() {
    let mut tripped = 0;
    for seed in 1..=30 {
        let spec = rig_with(|spec, scene| {
            spec.limits.stiffness_n_mm = 1.98;
            scene.surface_tilt_mm = 1.2;
            scene.contact = linear(1.8);
            truthful(scene);
        });
        let mut bench = Bench::new(spec, &recipe("[[-5, -5]]", "force_n = 2.0"), seed);
        let walked = bench.walk(None);
        assert!(walked.ending.unparked.is_none(), "seed {seed}: {:?}", walked.ending.told());
        assert!(walked.shown_most_n <= 2.0 + COUNT_N, "seed {seed}: {} N", walked.shown_most_n);
        let (peak_n, depth_mm) = bench.worst();
        assert!(peak_n <= 2.0 && depth_mm <= 1.6, "seed {seed}: {peak_n} N, {depth_mm} mm");
        tripped += u32::from(walked.ending.status() == Status::Tripped);
    }
    assert!(tripped > 0, "some surface lies beyond the declared uncertainty");
}

#[test]
fn a_specimen_stiffer_than_declared_trips_whatever_the_cells_rate() {
    for conversions_hz in [20.0, 50.0, 200.0] {
        let spec = rig_with(|spec, scene| {
            spec.load_cell.conversions_hz = conversions_hz;
            spec.limits.stiffness_n_mm = 0.5;
            // more than the limit where its depth ends, less than the cell's range
            scene.contact = linear(2.0);
            scene.relaxation.clear();
            truthful(scene);
        });
        let told = format!("{conversions_hz} Hz");
        Bench::new(spec, &recipe("[[0, 0]]", "force_n = 1.9"), 2)
            .must_trip(&[Rule::OverForce, Rule::HardContact], &told);
    }
}

#[test]
fn a_cell_beyond_its_range_in_air_trips_and_the_trip_is_recorded() {
    let spec =
        rig_with(|_, scene| scene.load_cell = Some(LoadCell { noise_n: 0.003, offset_n: 6.0, ..LoadCell::default() }));
    Bench::new(spec, &recipe("[[0, 0]]", "force_n = 1.0"), 1).must_trip(&[Rule::Unhealthy], "offset beyond range");
}

// ---- the permit ----------------------------------------------------------------------------------------------------

fn permit() -> Permit {
    let limits = Limits { force_n: 2.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };
    Permit::new(
        limits,
        0.05,
        100.0,
        &Zero { offset_n: 0.0, sigma_n: 0.003, offset_sigma_n: 0.0003, frozen_after: None },
    )
}

#[test]
fn contact_above_where_the_surface_was_learned_counts_from_where_it_is() {
    // a bump: the force is there 0.2 mm before the earliest surface that the learned plane allows
    let standing = Standing { z_mm: -0.2, force_n: 0.1, sigma_n: 0.001, age_s: 0.0, first_mm: 0.0 };
    let deepest_mm = permit().deepest_mm(&standing);
    let force_n = 0.1 + 2.0 * (deepest_mm + 0.2);
    assert!(force_n <= 2.0, "{force_n} N at {deepest_mm} mm");
    // with force to spare it is the depth that binds, and it counts from no later than here
    let limits = Limits { force_n: 50.0, depth_mm: 1.6, stiffness_n_mm: 2.0 };
    let zero = Zero { offset_n: 0.0, sigma_n: 0.003, offset_sigma_n: 0.0003, frozen_after: None };
    let depth_mm = Permit::new(limits, 0.05, 100.0, &zero).deepest_mm(&standing) + 0.2;
    assert!(depth_mm <= 1.6, "{depth_mm} mm");
}

#[test]
fn nothing_is_granted_on_what_is_not_a_number() {
    let good = Standing { z_mm: -1.0, force_n: 0.0, sigma_n: 0.001, age_s: 0.0, first_mm: -0.1 };
    assert!(permit().advance(&good, -0.5, 1.0).is_ok());
    for bad in [
        Standing { z_mm: f64::NAN, ..good },
        Standing { force_n: f64::NAN, ..good },
        Standing { sigma_n: f64::NAN, ..good },
        Standing { age_s: f64::NAN, ..good },
        Standing { first_mm: f64::NAN, ..good },
        Standing { force_n: f64::NEG_INFINITY, ..good },
    ] {
        assert!(permit().advance(&bad, -0.5, 1.0).is_err(), "{bad:?}");
    }
    for speed_mm_s in [0.0, -1.0, f64::NAN] {
        assert!(permit().advance(&good, -0.5, speed_mm_s).is_err(), "{speed_mm_s} mm/s");
    }
    let granted = permit().advance(&good, -0.5, f64::INFINITY).unwrap();
    assert!(granted.speed_mm_s() < 25.0, "{} mm/s", granted.speed_mm_s());
}

// ---- a person's stop -----------------------------------------------------------------------------------------------

#[test]
fn a_stop_at_any_moment_parks_and_the_run_goes_on_to_its_end() {
    let text = recipe("[[-4, 3], [4.5, 4.5]]", "staircase = { to_n = 1.0, step_n = 0.5, repeats = 1, rest_s = 0.0 }");
    let whole = Bench::new(rig_with(|_, _| {}), &text, 9).walk(None).readings;
    assert!(whole > 500, "{whole} readings");
    // five levels at each of two places, each once
    let rows: Vec<(u64, u64)> = (0..2).flat_map(|press| (0..5).map(move |level| (press, level))).collect();
    let mut stopped_at = 0;
    while stopped_at < whole {
        let told = format!("stop at reading {stopped_at} of {whole}");
        let mut bench = Bench::new(rig_with(|_, _| {}), &text, 9);
        let walked = bench.walk(Some(stopped_at));
        assert!(matches!(walked.ending.halt, Some(Halt::Cancelled)), "{told}: {:?}", walked.ending.told());
        assert!(walked.ending.unparked.is_none(), "{told}: {:?}", walked.ending.told());
        assert_eq!(walked.ending.status(), Status::Stopped, "{told}");
        assert!(walked.readings <= stopped_at + 1, "{told}: {} readings", walked.readings);
        bench.folder.finish(walked.ending.end(String::new(), 0.0)).unwrap();
        bench.must_complete(&told);
        bench.folder.rebuild().unwrap();
        assert_eq!(bench.rows_on_disk(), rows, "{told}");
        stopped_at += 83;
    }
}

// ---- the stage's driver against its emulator -----------------------------------------------------------------------

/// The emulated stage of a rig, with a driver on it and a hand in its scene.
struct StageBench {
    driver: Esp301,
    instrument: Shared<dyn Instrument>,
    scene: Shared<Scene>,
    usage: StageUse,
    origin: Instant,
}

impl StageBench {
    fn new(spec: &RigSpec) -> StageBench {
        let origin = Instant::now();
        let SimulatedRig { scene, stage, .. } = spec.emulators(1).unwrap();
        let instrument = stage.instrument().expect("it has a link").clone();
        let (far_instrument, far_scene) = (instrument.clone(), scene.clone());
        let dial = move || {
            let (near, far) = duplex(4096);
            let (instrument, scene) = (far_instrument.clone(), far_scene.clone());
            tokio::spawn(async move { serve(far, instrument, scene, origin).await });
            near
        };
        let usage = StageUse {
            travel: spec.permitted_travel(),
            away: -spec.frame.down.sign(),
            speed_mm_s: spec.stage.speed_mm_s,
            acceleration_mm_s2: spec.stage.acceleration_mm_s2,
        };
        let driver = Esp301::new(Connector::Memory(Box::new(dial)), "bench".to_owned());
        StageBench { driver, instrument, scene, usage, origin }
    }

    fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }

    /// A command as another client of the controller would send it, acted on at once.
    fn command(&self, line: &str) {
        let now_s = self.now_s();
        self.instrument.lock().unwrap().answer(line.as_bytes(), &mut self.scene.lock().unwrap(), now_s);
    }

    fn at_mm(&self, axis: Axis) -> f64 {
        let now_s = self.now_s();
        self.scene.lock().unwrap().axis(axis, now_s).0
    }
}

/// Whether x or y moved while z was within reach of the specimen, looked at each ms.
async fn sideways_in_contact(scene: Shared<Scene>, origin: Instant, contact_below_mm: f64) -> bool {
    let look = || {
        let now_s = origin.elapsed().as_secs_f64();
        let mut scene = scene.lock().unwrap();
        Axis::ALL.map(|axis| scene.axis(axis, now_s))
    };
    let mut seen = false;
    loop {
        let [x, y, z] = look();
        seen |= (x.1 != 0.0 || y.1 != 0.0) && z.0 < contact_below_mm;
        if seen {
            return true;
        }
        sleep(Duration::from_millis(1)).await;
    }
}

#[test]
fn after_a_crash_in_contact_nothing_moves_sideways_before_z_is_clear() {
    // z was homed and still presses; the x motor is off (a following error, or a hand on the front panel)
    in_virtual_time(async {
        let spec = rig_with(|_, _| {});
        let mut bench = StageBench::new(&spec);
        bench.driver.prepare(&bench.usage, &Reins::default()).await.unwrap();
        bench.driver.begin(&[(Axis::Z, -1.0)], 10.0, &Reins::default()).await.unwrap();
        bench.driver.follow(&[Axis::Z], Duration::from_secs(2), &Reins::default()).await.unwrap();
        bench.command("1PA3");
        sleep(Duration::from_secs(2)).await;
        bench.command("1MF");
        assert!(bench.at_mm(Axis::Z) < -0.9, "pressing");
        let watch = sideways_in_contact(bench.scene.clone(), bench.origin, 0.3);
        // whether it homes x after a retreat of its own or refuses to go on is its choice
        let never = Reins::default();
        let moved = tokio::select! {
            biased;
            moved = watch => moved,
            _ = bench.driver.prepare(&bench.usage, &never) => false,
        };
        assert!(!moved, "x moved with the indenter {} mm in the specimen", -bench.at_mm(Axis::Z));
    });
}

#[test]
fn a_stage_that_still_moves_when_a_program_starts_is_brought_to_rest_first() {
    // a program that was killed left a motion behind; the next one must not take where it is for where it stays
    in_virtual_time(async {
        let spec = rig_with(|_, _| {});
        let mut bench = StageBench::new(&spec);
        bench.driver.prepare(&bench.usage, &Reins::default()).await.unwrap();
        bench.driver.begin(&[(Axis::Z, -1.0)], 1.0, &Reins::default()).await.unwrap();
        bench.driver.prepare(&bench.usage, &Reins::default()).await.unwrap();
        let here_mm = bench.driver.position_mm(Axis::Z, &Reins::default()).await.unwrap();
        sleep(Duration::from_secs(1)).await;
        assert!((bench.at_mm(Axis::Z) - here_mm).abs() < 0.001, "from {here_mm} mm to {} mm", bench.at_mm(Axis::Z));
    });
}

#[test]
fn an_indenter_that_presses_at_power_up_is_homed_away_from_the_specimen() {
    for down in [Down::Minus, Down::Plus] {
        in_virtual_time(async {
            let spec = rig_with(|spec, _| spec.frame.down = down);
            let bench = StageBench::new(&spec);
            let into = down.sign();
            bench.scene.lock().unwrap().set_motion(Axis::Z, Trajectory::at_rest(into), 0.0);
            // the controller is switched on there
            let StageBench { scene, usage, origin, .. } = bench;
            let instrument: Shared<dyn Instrument> =
                Arc::new(Mutex::new(palpate::emulator::Esp301::new(&scene.lock().unwrap())));
            let far_scene = scene.clone();
            let dial = move || {
                let (near, far) = duplex(4096);
                let (instrument, scene) = (instrument.clone(), far_scene.clone());
                tokio::spawn(async move { serve(far, instrument, scene, origin).await });
                near
            };
            let mut driver = Esp301::new(Connector::Memory(Box::new(dial)), "bench".to_owned());
            let deepest = async {
                let mut deepest_mm = f64::NEG_INFINITY;
                let mut sideways = false;
                loop {
                    let now_s = origin.elapsed().as_secs_f64();
                    let [x, _, z] = Axis::ALL.map(|axis| scene.lock().unwrap().axis(axis, now_s));
                    deepest_mm = deepest_mm.max(z.0 * into);
                    sideways |= x.1 != 0.0 && z.0 * into > -0.3;
                    assert!(deepest_mm <= 1.0 && !sideways, "{down:?}: {deepest_mm} mm");
                    sleep(Duration::from_millis(2)).await;
                }
            };
            let never = Reins::default();
            tokio::select! {
                biased;
                () = deepest => {}
                prepared = driver.prepare(&usage, &never) => drop(prepared.unwrap()),
            }
        });
    }
}

/// A driver whose far end is played by the test: line by line.
fn scripted<F: Future<Output = ()> + Send + 'static>(play: impl FnOnce(DuplexStream) -> F) -> Esp301 {
    let (near, far) = duplex(4096);
    tokio::spawn(play(far));
    let near = Mutex::new(Some(near));
    Esp301::new(Connector::Memory(Box::new(move || near.lock().unwrap().take().unwrap())), "script".to_owned())
}

async fn line_from(far: &mut DuplexStream) -> Option<String> {
    let mut line = Vec::new();
    while line.last() != Some(&b'\r') {
        line.push(far.read_u8().await.ok()?);
    }
    Some(String::from_utf8(line).unwrap().trim().to_owned())
}

#[test]
fn an_answer_that_came_twice_is_not_taken_for_the_next() {
    in_virtual_time(async {
        let mut driver = scripted(|mut far| async move {
            let mut first = true;
            while let Some(line) = line_from(&mut far).await {
                let answer: &[u8] = match line.as_str() {
                    // the line stutters once
                    "3MD?;3TP;TB?" if std::mem::take(&mut first) => b"1\r\n1\r\n-0.4321\r\n0, 1, NO ERROR DETECTED\r\n",
                    "3MD?;3TP;TB?" => b"1\r\n-0.4321\r\n0, 2, NO ERROR DETECTED\r\n",
                    "3TP" => b"-0.4321\r\n",
                    "VE?" => b"ESP301 Version 1.1.1 16/01/14\r\n",
                    _ => b"",
                };
                far.write_all(answer).await.unwrap();
            }
        });
        assert_eq!(driver.follow(&[Axis::Z], Duration::ZERO, &Reins::default()).await.unwrap(), [-0.4321]);
        assert_eq!(driver.position_mm(Axis::Z, &Reins::default()).await.unwrap(), -0.4321);
    });
}

#[test]
fn a_stop_is_sent_at_once_also_while_the_link_is_brought_back_into_step() {
    in_virtual_time(async {
        let stopped_s = Arc::new(Mutex::new(None));
        let (told, began) = (stopped_s.clone(), Instant::now());
        let mut driver = scripted(move |mut far| async move {
            let mut garbled = false;
            while let Some(line) = line_from(&mut far).await {
                let answer: &[u8] = match line.as_str() {
                    "3MD?;3TP;TB?" if garbled => b"1\r\n-0.4321\r\n0, 1, NO ERROR DETECTED\r\n",
                    "3MD?;3TP;TB?" => {
                        garbled = true;
                        b"E what?\r\n-0.4321\r\n0, 1, NO ERROR DETECTED\r\n"
                    }
                    "VE?" => {
                        sleep(Duration::from_secs(1)).await;
                        b"ESP301 Version 1.1.1 16/01/14\r\n"
                    }
                    "ST" => {
                        *told.lock().unwrap() = Some(began.elapsed().as_secs_f64());
                        b""
                    }
                    _ => b"",
                };
                far.write_all(answer).await.unwrap();
            }
        });
        let reins = Reins::default();
        let ask_for_it = async {
            sleep(Duration::from_millis(30)).await;
            reins.stop();
        };
        let (followed, ()) = tokio::join!(driver.follow(&[Axis::Z], Duration::ZERO, &reins), ask_for_it);
        followed.unwrap();
        let stopped_s = stopped_s.lock().unwrap().expect("ST was sent");
        assert!(stopped_s < 0.05, "asked for at 0.03 s, sent at {stopped_s} s");
    });
}

// ---- the load cell's driver ----------------------------------------------------------------------------------------

/// Dials a serial line that outlives its openings, as a real one does: the device answers one request after another, and
/// an answer goes to whoever has the port open by then. Answers may be late, by as much as `late` says for each request.
fn serial_line(
    instrument: Shared<dyn Instrument>,
    scene: Shared<Scene>,
    origin: Instant,
    late: impl Fn(usize) -> Duration + Send + 'static,
) -> Connector {
    let (requests, mut requested) = mpsc::unbounded_channel::<Vec<u8>>();
    let port: Arc<tokio::sync::Mutex<Option<tokio::io::WriteHalf<DuplexStream>>>> = Arc::default();
    let (device, writer) = (instrument.clone(), port.clone());
    tokio::spawn(async move {
        let mut count = 0;
        while let Some(request) = requested.recv().await {
            let now_s = origin.elapsed().as_secs_f64();
            let answer = device.lock().unwrap().answer(&request, &mut scene.lock().unwrap(), now_s);
            sleep(Duration::from_millis(2) + late(count)).await;
            count += 1;
            if let Some(writer) = writer.lock().await.as_mut() {
                // who has closed the port meanwhile misses the answer
                let _ = writer.write_all(&answer).await;
            }
        }
    });
    Connector::Memory(Box::new(move || {
        let (near, far) = duplex(4096);
        let (mut reader, writer) = tokio::io::split(far);
        *port.try_lock().unwrap() = Some(writer);
        let (instrument, requests) = (instrument.clone(), requests.clone());
        tokio::spawn(async move {
            let mut inbox = Vec::new();
            while let Ok(byte) = reader.read_u8().await {
                inbox.push(byte);
                while let Some(request) = instrument.lock().unwrap().take_request(&mut inbox) {
                    let _ = requests.send(request);
                }
            }
        });
        near
    }))
}

#[test]
fn a_reading_beyond_the_range_says_so_with_itself() {
    in_virtual_time(async {
        let spec = rig_with(|_, scene| truthful(scene));
        let origin = Instant::now();
        let SimulatedRig { scene, load_cell, .. } = spec.emulators(1).unwrap();
        let line = serial_line(load_cell.instrument().expect("it has a link").clone(), scene.clone(), origin, |_| {
            Duration::ZERO
        });
        let profile = spec.load_cell.driver.map().expect("a register map").profile.clone();
        let mut cell = ModbusLoadCell::new(line, Transport::Rtu, profile, "line", 200.0, origin).unwrap();
        cell.prepare().await.unwrap();
        cell.read().await.unwrap();
        let now_s = origin.elapsed().as_secs_f64();
        scene.lock().unwrap().set_motion(Axis::Z, Trajectory::at_rest(-6.0), now_s);
        sleep(Duration::from_millis(20)).await;
        // a mean of four, as a step is decided on: its last reading at least knows
        let mut health = Default::default();
        for _ in 0..4 {
            health = cell.read().await.unwrap().health;
        }
        assert!(health.saturated, "four readings of a saturated cell passed for good ones");
    });
}

#[test]
fn a_late_answer_of_the_load_cell_is_not_taken_for_a_fresh_force() {
    in_virtual_time(async {
        let spec = rig_with(|_, scene| truthful(scene));
        let origin = Instant::now();
        let SimulatedRig { scene, load_cell, .. } = spec.emulators(1).unwrap();
        // the fifth request is answered after the driver gave it up (200 ms) and found the line quiet
        let late = |count| Duration::from_millis(if count == 4 { 240 } else { 0 });
        let line = serial_line(load_cell.instrument().expect("it has a link").clone(), scene.clone(), origin, late);
        let profile = spec.load_cell.driver.map().expect("a register map").profile.clone();
        let mut cell = ModbusLoadCell::new(line, Transport::Rtu, profile, "line", 200.0, origin).unwrap();
        cell.prepare().await.unwrap(); // three requests
        assert_eq!(cell.read().await.unwrap().force_n, 0.0);
        let press = async {
            sleep(Duration::from_millis(100)).await;
            let now_s = origin.elapsed().as_secs_f64();
            scene.lock().unwrap().set_motion(Axis::Z, Trajectory::at_rest(-1.0), now_s);
        };
        let (reading, ()) = tokio::join!(cell.read(), press);
        // refusing it is right, and so is the force of now; the force of before isn't
        for reading in [reading, cell.read().await, cell.read().await].into_iter().flatten() {
            assert!(reading.force_n > 0.5, "{} N at {} s, after 1 mm at 0.1 s", reading.force_n, reading.at_s);
        }
    });
}
