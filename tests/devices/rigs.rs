//! One recipe on every kind of rig: other controllers and converters give the same answers for the same specimen. See the numbers with
//! `cargo test --release --test devices rigs:: -- --nocapture`.

use palpate_core::quantity::{ArrayLayout, Axis, Place, round, stream};
use palpate_data::dataset::Recorded;
use palpate_data::dataset::evaluate::Trial;
use palpate_link::device::{AxisWay, DeviceProblem, Instruments, MotionOrders, Stage};
use palpate_link::time::{Instant, sleep, sleep_until};
use palpate_run::rig::{self, OpenRig};
use palpate_sim::scene::{FaultKind, SceneFault};
use palpate_testing::executions::run_virtually;
use palpate_testing::{SMALL, TestFolder, campaign, exchanged, made_ready, shipped, shipped_text};
use rand::RngExt;
use std::time::Duration;

/// The rig for comparison, and the others.
const FIRST: &str = "sim";
const OTHERS: [&str; 5] = ["paper", "esp301", "xps", "grbl", "process"];

/// Largest distance between the places that two rigs find for a test point, mm: the median, and of 95 %. A unit has the same error in a
/// contact on all rigs; the rest is due to force loop and converters.
const LOCATION_MM: (f64, f64) = (0.001, 0.3);

/// Largest difference between the forces that two rigs find for a test point, N: the median, and of 95 %.
const FORCE_N: (f64, f64) = (0.006, 0.020);

/// Largest difference between the mean forces of a window on two rigs, N: 95 %. Each is within some 10 mN of the set force.
const WINDOW_N: f64 = 0.025;

/// Result of the paper's protocol on a rig.
struct RigOutcome {
    windows_n: Vec<f64>,
    found: Vec<(Place, f64)>,
    mean_mm: f64,
}

fn outcome(bench: &TestFolder, rig: &str) -> RigOutcome {
    let (recipe, file) = (shipped("recipes/paper.toml"), shipped(&format!("rigs/{rig}.toml")));
    bench.palpate_ends(
        0,
        &format!("run {} --rig {} --simulate --durability fast --out {rig}", recipe.display(), file.display()),
    );
    let presses = Recorded::read(&bench.path(rig)).expect("a run").presses();
    let evaluation = Trial::of_run(&presses, Some(&ArrayLayout::grid(3, 3, 4.5)))
        .unwrap()
        .evaluate("pearson")
        .expect("an evaluation");
    let windows = bench.column(&format!("{rig}/presses.csv"), "force_n");
    RigOutcome {
        windows_n: windows.iter().map(|force| force.parse().expect("a number")).collect(),
        found: evaluation.presses.iter().map(|press| (press.place_solved, press.force_solved_n)).collect(),
        mean_mm: evaluation.location_error_mm.mean,
    }
}

#[test]
fn the_same_seed_gives_locations_and_forces_that_agree_between_rigs() {
    let bench = TestFolder::new();
    let first = outcome(&bench, FIRST);
    for rig in OTHERS.into_iter().step_by(campaign::every(3, 1)) {
        let other = outcome(&bench, rig);
        assert_eq!((other.windows_n.len(), other.found.len()), (1130, 100), "{rig}");
        let pairs = || first.found.iter().zip(&other.found);
        let apart_mm = spread(pairs().map(|(a, b)| a.0.distance_mm(b.0)));
        let apart_n = spread(pairs().map(|(a, b)| (a.1 - b.1).abs()));
        let windows_n = spread(first.windows_n.iter().zip(&other.windows_n).map(|(a, b)| (a - b).abs()));
        println!(
            "{rig:<8} mean location error {:.4} mm; beside {FIRST}: location {apart_mm:.4?} mm, force {apart_n:.4?} N, \
             window {windows_n:.4?} N (median, 95 %)",
            other.mean_mm
        );
        assert!(apart_mm.0 <= LOCATION_MM.0 && apart_mm.1 <= LOCATION_MM.1, "{rig}: {apart_mm:?} mm");
        assert!(apart_n.0 <= FORCE_N.0 && apart_n.1 <= FORCE_N.1, "{rig}: {apart_n:?} N");
        assert!(windows_n.1 <= WINDOW_N, "{rig}: {windows_n:?} N");
    }
}

#[test]
fn esp301_as_slow_as_the_recorded_one_makes_its_presses() {
    // 73 ms a command, 71 to 78: a recording of a real one
    let rig = exchanged(&shipped_text("rigs/sim.toml"), "stage = [5.0, 20.0]", "stage = [71.0, 78.0]");
    let bench = TestFolder::with([("slow.toml", rig.as_str()), ("r.toml", SMALL)]);
    let doctor = bench.palpate_ends(0, "doctor slow.toml --json").json_lines().remove(0);
    let worst_ms = doctor["reaction_worst_ms"].as_f64().expect("a number");
    assert!((120.0..150.0).contains(&worst_ms), "{worst_ms} ms");
    bench.palpate_ends(0, "run r.toml --rig slow.toml --out run");
    assert_eq!(bench.column("run/presses.csv", "flags").iter().filter(|flags| !flags.is_empty()).count(), 0);
}

/// The shipped rig of an XPS with its positioners in one, two or three groups.
fn xps_in_groups() -> [String; 3] {
    let one = "xps = \"XYZ\", positioners = [\"X\", \"Y\", \"Z\"]";
    let two = "xps = [\"XY\", \"Z\"], positioners = [\"XY.X\", \"XY.Y\", \"Z.Pos\"]";
    let three = "xps = [\"GX\", \"GY\", \"GZ\"], positioners = [\"GX.Pos\", \"GY.Pos\", \"GZ.Pos\"]";
    [one, two, three].map(|grouped| exchanged(&shipped_text("rigs/xps.toml"), one, grouped))
}

#[test]
fn an_xps_presses_the_same_in_one_group_two_or_three() {
    let mut firsts: Option<Vec<f64>> = None;
    for rig in xps_in_groups() {
        let bench = TestFolder::with([("rig.toml", rig.as_str()), ("r.toml", SMALL)]);
        bench.palpate_ends(0, "run r.toml --rig rig.toml --simulate --out run");
        assert_eq!(
            bench.column("run/presses.csv", "flags").iter().filter(|flags| !flags.is_empty()).count(),
            0,
            "{rig}"
        );
        let column = bench.column("run/presses.csv", "force_n");
        let forces_n: Vec<f64> = column.iter().map(|force| force.parse().expect("a number")).collect();
        let firsts = firsts.get_or_insert(forces_n.clone());
        assert!(forces_n.len() == firsts.len() && forces_n.len() > 3, "{rig}");
        let apart_n = spread(firsts.iter().zip(&forces_n).map(|(a, b)| (a - b).abs()));
        println!("{} presses, {apart_n:.4?} N from those in one group (median, 95 %)", forces_n.len());
        assert!(apart_n.1 <= WINDOW_N, "{rig}: {apart_n:?} N");
    }
}

#[test]
fn x_and_y_of_an_xps_are_homed_only_with_z_away_also_if_z_is_in_contact_and_homed() {
    let text =
        xps_in_groups()[1].clone() + "\n[scene]" + shipped_text("rigs/paper.toml").split_once("[scene]").unwrap().1;
    let spec = rig::parse("rig.toml", &text, &|_| unreachable!()).expect("a rig").simulated();
    run_virtually(async {
        let orders = MotionOrders::default();
        let simulated = spec.emulators(1).expect("emulators");
        let (scene, origin) = (simulated.scene.clone(), Instant::now());
        let truth = || scene.lock().expect("sound").take_truth(origin.elapsed().as_secs_f64());
        let OpenRig { instruments: Instruments { mut stage, .. }, stage_use, .. } =
            spec.open_on(simulated).expect("drivers");
        stage.identify(&stage_use).await.expect("a stage");
        assert!(stage.home_z(&stage_use, &orders).await.expect("z at home"), "z has its own group");
        // the surface is at -5 mm
        let top_mm = stage.position_mm(Axis::Z, &orders).await.expect("z at home");
        stage.begin(&[AxisWay::between(Axis::Z, top_mm, -6.0)], 5.0, &orders).await.expect("a motion");
        stage.follow(&[Axis::Z], Duration::from_secs(3), &orders).await.expect("its end");
        let before = truth();
        assert!(before.force_peak_n > 0.3, "{before:?}");
        stage.home(&stage_use, &orders).await.expect("all at home");
        assert_eq!(truth().slid_mm, 0.0, "it slid over the specimen");
        let z_mm = stage.position_mm(Axis::Z, &orders).await.expect("z");
        assert!((z_mm - 12.5).abs() < 0.01, "{z_mm} mm");
    });
}

#[test]
fn xps_with_a_guard_ends_a_motion_with_any_slow_host() {
    for text in xps_in_groups() {
        guard_ends_a_motion(&text);
    }
}

/// Rounding of a way, mm.
const ROUNDING_MM: f64 = 1e-9;

fn guard_ends_a_motion(rig: &str) {
    // the cell jumps over the limit while z moves; only the controller reads it
    let text = rig.to_owned() + "\n[scene]" + shipped_text("rigs/paper.toml").split_once("[scene]").unwrap().1;
    let text = exchanged(&text, "stage = [1.0, 5.0]", "stage = [60.0, 70.0]");
    let mut spec = rig::parse("rig.toml", &text, &|_| unreachable!()).expect("a rig").simulated();
    let leap_s = 20.0;
    spec.scene.faults.push(SceneFault { kind: FaultKind::DriftedZero, from_s: leap_s, value: Some(5.0) });
    run_virtually(async {
        let (began, orders) = (Instant::now(), MotionOrders::default());
        let OpenRig { instruments: Instruments { mut stage, .. }, stage_use, .. } = spec.open(1).expect("drivers");
        made_ready(&mut stage, &stage_use, &orders).await.expect("a stage");
        stage.guard(Some(2.05)).await.expect("a guard");
        sleep_until(began + Duration::from_secs_f64(leap_s - 1.0)).await;
        // if z has its own group, it is away from where x and y were homed; otherwise it is at its home
        let from_mm = stage.position_mm(Axis::Z, &orders).await.expect("a place");
        stage.begin(&[AxisWay::between(Axis::Z, from_mm, 10.0)], 2.0, &orders).await.expect("a motion");
        let begun_s = began.elapsed().as_secs_f64();
        let error = stage.follow(&[Axis::Z], Duration::from_secs(5), &orders).await.expect_err("it was ended");
        assert!(matches!(error.problem, DeviceProblem::Guarded { limit_n: 2.05 }), "{error}");
        // moving for less than a second at 2 mm/s; the 0.02 mm that it loses at the start are its braking distance
        let ran_mm = 2.0 * (leap_s - begun_s);
        let at_mm = stage.position_mm(Axis::Z, &orders).await.expect("a place");
        let went_mm = (at_mm - from_mm).abs();
        assert!(
            (-ROUNDING_MM..0.15).contains(&(went_mm - ran_mm)),
            "z went {went_mm} mm, {ran_mm} mm when the force came"
        );
        // it has ended a motion: the way out is free
        stage.guard(None).await.expect("none any more");
        stage.begin(&[AxisWay::between(Axis::Z, at_mm, 10.0)], 10.0, &orders).await.expect("the way out");
        let places_mm = stage.follow(&[Axis::Z], Duration::from_secs(1), &orders).await.expect("the way out");
        assert!((places_mm[0] - 10.0).abs() < 0.001, "{places_mm:?}");
    });
}

#[test]
fn an_axis_that_was_stopped_anywhere_reaches_the_end_of_its_travel() {
    // a stop leaves it between two values that the controller writes, and the end of the travel is the controller's own limit
    for name in ["esp301", "xps", "grbl", "klipper", "marlin", "process", "ur"] {
        let file = format!("rigs/{name}.toml");
        let text = shipped_text(&file);
        let spec = rig::parse(&file, &text, &|_| unreachable!("no map of its own")).expect("a rig").simulated();
        run_virtually(async {
            let never = MotionOrders::default();
            let OpenRig { instruments: Instruments { mut stage, .. }, stage_use, .. } = spec.open(1).expect("drivers");
            made_ready(&mut stage, &stage_use, &never).await.expect("a stage");
            let end_mm = stage_use.travel.along(Axis::Z).end(stage_use.away);
            let mut rng = stream(1, 0, "stops");
            for _ in 0..campaign::size(100, 2000) {
                let orders = MotionOrders::default();
                let from_mm = stage.position_mm(Axis::Z, &never).await.expect("a place");
                let way =
                    AxisWay { axis: Axis::Z, from_mm, by_mm: stage_use.away * -round(rng.random_range(0.01..2.0), 4) };
                stage
                    .begin(&[way], rng.random_range(0.5..2.0), &orders)
                    .await
                    .unwrap_or_else(|error| panic!("{name}: {error}"));
                sleep(Duration::from_secs_f64(rng.random_range(0.01..1.5))).await;
                orders.stop();
                let places_mm = stage.follow(&[Axis::Z], Duration::from_secs(2), &orders).await.expect("a stop");
                let up = AxisWay::between(Axis::Z, places_mm[0], end_mm);
                stage.begin(&[up], 5.0, &never).await.unwrap_or_else(|error| panic!("{name}: {error}"));
                let time = Duration::from_secs_f64(up.by_mm.abs() / 5.0 + 0.2);
                let places_mm = stage.follow(&[Axis::Z], time, &never).await.expect("its end");
                let complaints = stage.complaints().await.expect("an answer");
                assert_eq!(complaints, Vec::<String>::new(), "{name}: {:?} of {end_mm} mm", places_mm);
                let most_mm = spec.stage.steps.in_position_mm(Axis::Z);
                assert!((places_mm[0] - end_mm).abs() <= most_mm, "{name}: {places_mm:?} of {end_mm} mm");
            }
        });
    }
}

#[test]
fn every_shipped_map_of_a_load_cell_fits_its_emulator() {
    for (map, name) in [
        ("generic-rs485", "generic RS485"),
        ("laumas-tlb", "Laumas TLB"),
        ("seneca-zsg", "Seneca Z-SG,"),
        ("seneca-zsg2", "Seneca Z-SG2,"),
        ("labjack-t7", "LabJack T7"),
    ] {
        let rig = exchanged(&shipped_text("rigs/sim.toml"), "\"generic-rs485\"", &format!("\"{map}\""));
        let bench = TestFolder::with([("rig.toml", rig.as_str()), ("r.toml", SMALL)]);
        let output = bench.palpate_ends(0, "doctor rig.toml --json").json_lines().remove(0);
        let identity = output["devices"][1]["identity"]["identity"].as_str().expect("a name");
        assert!(identity.starts_with(name), "{map}: {identity}");
        bench.palpate_ends(0, "run r.toml --rig rig.toml --out run");
        assert_eq!(
            bench.column("run/presses.csv", "flags").iter().filter(|flags| !flags.is_empty()).count(),
            0,
            "{map}"
        );
    }
}

/// The median, and the bound of 95 %.
fn spread(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    (sorted[sorted.len() / 2], sorted[sorted.len() * 95 / 100])
}
