//! A tilted specimen: `align` finds its tilt, rows are along its normal, and x and y don't move in contact.

use palpate_core::quantity::{Axis, Place, Tilt, stream};
use palpate_data::recipe::Plan;
use palpate_run::rig::RigSpec;
use palpate_run::run::{AlignError, Alignment, Cancel, Listener, align};
use palpate_sim::emulator::{Instrument, Shared};
use palpate_sim::scene::{Mounting, Scene, SceneDevice};
use palpate_testing::campaign;
use palpate_testing::executions::{Deaths, bench, executed, executed_with, in_parallel, plan, run_virtually};
use palpate_testing::safety::{STAIRCASE, recipe, rig_with, truthful};
use proptest::prelude::*;
use rand::RngExt;
use std::sync::{Arc, Mutex};

/// Surface of a rig with a tilt of up to 5 degrees, mm: the tilt over half of the loading area, and a margin.
const UNCERTAINTY_MM: f64 = 0.6;

/// Half of the loading area, mm, to which `surface_tilt_mm` refers.
const LOADING_HALF_MM: f64 = 6.0;

struct TiltSilent;

impl Listener for TiltSilent {}

fn found(spec: &RigSpec, seed: u64) -> Result<Alignment, AlignError> {
    run_virtually(align(spec, seed, &Cancel::default(), &mut TiltSilent))
}

/// A tilt of this angle, deeper in this direction.
fn tilt(degrees: f64, toward_deg: f64) -> Tilt {
    let (sin, cos) = toward_deg.to_radians().sin_cos();
    let slope = degrees.to_radians().tan();
    Tilt { per_x: slope * cos, per_y: slope * sin }
}

/// The slopes that a scene draws for its `surface_tilt_mm`.
fn drawn(tilt_mm: f64, seed: u64) -> Tilt {
    let mut rng = stream(seed, 0, "surface");
    let mut third = || rng.random_range(-1.0..=1.0) * tilt_mm / 3.0;
    let [_, per_x, per_y] = [third(), third() / LOADING_HALF_MM, third() / LOADING_HALF_MM];
    Tilt { per_x, per_y }
}

/// Two rigs without and with bumps and roughness, whose specimen is tilted.
fn tilted_rig(bumpy: bool, tilt_mm: f64, tilt: Tilt) -> RigSpec {
    let mut spec = if bumpy { bench("bench-fast") } else { rig_with(|_, _| {}) };
    spec.frame.uncertainty_mm = UNCERTAINTY_MM;
    (spec.scene.surface_tilt_mm, spec.scene.surface_tilt) = (tilt_mm, tilt);
    spec
}

#[test]
fn align_finds_the_tilt() {
    let tilts = [(0.0, 0.0), (0.2, 0.0), (1.2, 0.0), (0.0, 0.5), (0.0, 2.0), (0.0, 4.5), (0.2, 4.0)];
    for bumpy in [false, true] {
        for (tilt_mm, degrees) in tilts {
            let seeds: Vec<u64> = (1..=campaign::size(2, 8) as u64).collect();
            let errors = in_parallel(&seeds, |&seed| {
                let stated = tilt(degrees, 75.0 * seed as f64);
                let aligned = found(&tilted_rig(bumpy, tilt_mm, stated), seed).expect("an alignment");
                let (drawn, turned_deg) = (drawn(tilt_mm, seed), aligned.frame.rotation_deg);
                let real = Tilt { per_x: drawn.per_x + stated.per_x, per_y: drawn.per_y + stated.per_y };
                let (real, found) = (real.in_frame_turned(turned_deg), aligned.frame.tilt);
                let off = (found.per_x - real.per_x).hypot(found.per_y - real.per_y);
                (off.atan().to_degrees(), off / aligned.tilt_sigma)
            });
            let n = errors.len() as f64;
            let mean_deg = errors.iter().map(|(deg, _)| deg).sum::<f64>() / n;
            let worst_deg = errors.iter().map(|(deg, _)| *deg).fold(0.0, f64::max);
            let sigmas = (errors.iter().map(|(_, sigmas)| sigmas * sigmas).sum::<f64>() / (2.0 * n)).sqrt();
            println!(
                "bumps {bumpy:<5} surface_tilt_mm {tilt_mm}, tilt {degrees} degrees: off by {mean_deg:.4} degrees (mean of {n}), \
                 {worst_deg:.4} (worst), {sigmas:.2} stated sd (rms of a slope)"
            );
            assert!(worst_deg < 0.1, "{bumpy} {tilt_mm} {degrees}: {errors:?}");
        }
    }
}

#[test]
fn align_finds_the_tilt_in_the_frame_of_a_rotated_specimen() {
    let real = tilt(2.0, 20.0);
    let mut spec = tilted_rig(false, 0.0, real);
    let origin = Place::new(0.5, -0.3);
    spec.scene.mounting = Some(Mounting { origin, rotation_deg: 10.0, z_mm: 0.05 });
    let first = found(&spec, 3).expect("an alignment");
    let off = |found: Tilt| (found.per_x - real.per_x).hypot(found.per_y - real.per_y);
    // the error of the rotation, some degrees, turns the slope of 0.035
    assert!((first.frame.rotation_deg - 10.0).abs() < 2.0 && off(first.frame.tilt) < 2e-3, "{first:?}");
    // a rig that states a tilt already gets the same value, not the remainder or the double
    spec.frame.tilt = first.frame.tilt;
    let again = found(&spec, 3).expect("an alignment");
    assert!((again.frame.tilt.per_x - first.frame.tilt.per_x).abs() < 1e-6, "{again:?}");
    assert!((again.surface_mm - first.surface_mm).abs() < 1e-4, "{} {}", again.surface_mm, first.surface_mm);
}

#[test]
fn align_refuses_a_specimen_that_is_not_level_enough() {
    let refused = found(&tilted_rig(false, 0.0, tilt(5.5, 200.0)), 1);
    let Err(error @ AlignError::Tilted { .. }) = refused else { panic!("{refused:?}") };
    let output = error.to_string();
    assert!(output.starts_with("the surface is tilted by 5.") && output.contains("shim the specimen"), "{output}");
    assert!(output.contains("deeper toward 200 degrees") || output.contains("deeper toward 199 degrees"), "{output}");
}

/// Mean errors of the recorded values, and their means: forces, and depths gained from the first level in contact to the deepest one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct TiltRecorded {
    force_off_n: f64,
    depth_off_mm: f64,
    force_n: f64,
    depth_mm: f64,
}

fn recorded(spec: &RigSpec, plan: &Plan) -> TiltRecorded {
    let executed = executed(spec, plan);
    assert!(executed.ending.halt.is_none(), "{:?}", executed.ending.text());
    let (mut sum, mut levels, mut contacts) = (TiltRecorded::default(), 0.0, 0.0);
    for contact in executed.ledger.contacts() {
        for (row, truth) in contact.levels.iter().zip(&contact.truth) {
            sum.force_off_n += row.force_n.expect("a force") - truth.force_true_n;
            sum.force_n += truth.force_true_n;
            levels += 1.0;
        }
        let deepest = contact.levels.len() / 2;
        let gained = |of: &dyn Fn(usize) -> f64| of(deepest) - of(1); // level 0 is without load
        // nothing relaxes, so the true force shows the depth
        let real_mm = gained(&|level| spec.scene.contact.depth_mm(contact.truth[level].force_true_n));
        sum.depth_off_mm += gained(&|level| contact.levels[level].depth_mm.expect("a depth")) - real_mm;
        sum.depth_mm += real_mm;
        contacts += 1.0;
    }
    let TiltRecorded { force_off_n, depth_off_mm, force_n, depth_mm } = sum;
    TiltRecorded {
        force_off_n: force_off_n / levels,
        depth_off_mm: depth_off_mm / contacts,
        force_n: force_n / levels,
        depth_mm: depth_mm / contacts,
    }
}

#[test]
fn rows_are_along_the_normal_of_a_rig_that_states_its_tilt() {
    let text = recipe("[[0, 0], [4, -3], [-5, 5], [2, 5], [-3, -2], [5, 1]]", STAIRCASE);
    for degrees in [0.0, 1.0, 3.0, 4.9] {
        let mut spec = tilted_rig(false, 0.0, tilt(degrees, 30.0));
        spec.limits.force_n = 2.2;
        spec.scene.relaxation.clear();
        truthful(&mut spec.scene);
        let plan = plan(&spec, &text, 5);
        let without = recorded(&spec, &plan);
        spec.frame.tilt = spec.scene.surface_tilt;
        let with = recorded(&spec, &plan);
        println!(
            "{degrees} degrees: force off by {:.2} mN without the key and {:.2} mN with it, of {:.3} N; depth off by {:.2} um and \
             {:.2} um, of {:.3} mm",
            1e3 * without.force_off_n,
            1e3 * with.force_off_n,
            with.force_n,
            1e3 * without.depth_off_mm,
            1e3 * with.depth_off_mm,
            with.depth_mm
        );
        if degrees == 0.0 {
            assert_eq!(without, with, "a level surface changes nothing");
        }
        // the cell counts whole mN, the stage 0.1 um
        let cosine = spec.frame.tilt.cosine();
        assert!((without.force_off_n + (1.0 - cosine) * without.force_n).abs() < 3e-4, "{without:?}");
        assert!((without.depth_off_mm - (1.0 / cosine - 1.0) * without.depth_mm).abs() < 2e-4, "{without:?}");
        assert!(with.force_off_n.abs() < 3e-4 && with.depth_off_mm.abs() < 2e-4, "{with:?}");
    }
}

/// Observes the stage, and notes the largest true force at which x or y began to move.
struct TiltSideways {
    stage: Shared<dyn Instrument>,
    seen: Arc<Mutex<TiltSeen>>,
}

#[derive(Clone, Copy, Default)]
struct TiltSeen {
    commands: usize,
    under_n: f64,
}

impl Instrument for TiltSideways {
    fn device(&self) -> SceneDevice {
        SceneDevice::Stage
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        self.stage.lock().expect("a device that lives").take_request(inbox)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let motions = |scene: &Scene| [Axis::X, Axis::Y].map(|axis| scene.motion(axis).clone());
        let before = motions(scene);
        let reply = self.stage.lock().expect("a device that lives").answer(request, scene, now_s);
        if motions(scene) != before {
            let mut seen = self.seen.lock().expect("one thread");
            seen.commands += 1;
            seen.under_n = seen.under_n.max(scene.true_force_n(now_s));
        }
        reply
    }

    fn deaf_until_s(&self) -> f64 {
        self.stage.lock().expect("a device that lives").deaf_until_s()
    }
}

/// Presses a tilted specimen at five places. x and y get no command under a force, and don't move in contact.
fn assert_stays(degrees: f64, toward_deg: f64, seed: u64, strategy: usize, stated: bool) -> Result<(), TestCaseError> {
    // no place is higher or deeper than the frame states: 5 degrees at 5.7 mm are 0.5 mm, and a higher one could be grazed
    let places = "[[-4, 4], [4, -4], [0, 0], [-4, -4], [4, 4]]";
    assert_stays_at(places, degrees, toward_deg, seed, strategy, stated)
}

fn assert_stays_at(
    places: &str,
    degrees: f64,
    toward_deg: f64,
    seed: u64,
    strategy: usize,
    stated: bool,
) -> Result<(), TestCaseError> {
    let strategy = ["guarded", "velocity", "map"][strategy];
    let mut spec = tilted_rig(false, 0.0, tilt(degrees, toward_deg));
    if stated {
        spec.frame.tilt = spec.scene.surface_tilt;
    }
    let text = recipe(places, "force_n = 1.0").replace("[press]\n", &format!("[press]\nstrategy = \"{strategy}\"\n"));
    let seen = Arc::new(Mutex::new(TiltSeen::default()));
    let executed = executed_with(&spec, &plan(&spec, &text, seed), Deaths::Ignored, &|rig| {
        let stage = rig.stage.instrument().expect("it has a link").clone();
        rig.stage.replace(Arc::new(Mutex::new(TiltSideways { stage, seen: seen.clone() })));
    });
    let TiltSeen { commands, under_n } = *seen.lock().expect("one thread");
    prop_assert_eq!((under_n, executed.truth.slid_mm), (0.0, 0.0));
    prop_assert!(executed.ending.halt.is_none(), "{:?}", executed.ending.text());
    prop_assert!(commands >= 5, "{} commands", commands);
    prop_assert!(executed.truth.is_within(&spec), "{:?}", executed.truth);
    Ok(())
}

/// The place after the middle one is the highest. Two touches show the height of the middle one by then.
#[test]
fn x_and_y_wait_until_z_is_clear_of_a_next_place_that_is_higher() {
    for strategy in 0..3 {
        assert_stays(4.9, 45.0, 1, strategy, false).expect("x and y wait");
    }
}

/// Both axes of an ESP301 move at the same speed, so the shorter one arrives first and the way has a corner. Here the surface is as high at
/// both ends, and 0.15 mm higher at the corner.
#[test]
fn z_is_clear_of_the_corner_of_a_way() {
    let places = "[[-5, -2.5], [5, 2.5], [-5, -2.5], [5, 2.5], [-5, -2.5], [5, 2.5], [-5, -2.5], [5, 2.5]]";
    for strategy in 0..3 {
        assert_stays_at(places, 4.9, -63.43, 1, strategy, false).expect("x and y stay clear");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: campaign::size(3, 24) as u32, ..ProptestConfig::default() })]

    /// For any tilt, seed and strategy, and whether or not the rig states the tilt.
    #[test]
    fn x_and_y_never_move_in_contact_with_a_tilted_surface(
        degrees in 0.0..5.0f64, toward_deg in 0.0..360.0f64, seed in 0..1000u64, strategy in 0..3usize, stated: bool,
    ) {
        assert_stays(degrees, toward_deg, seed, strategy, stated)?;
    }
}
