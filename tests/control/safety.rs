//! Safety, end to end: for any specimen, mounting and load cell, force and depth stay within their limits in a whole run; a stop at any
//! time parks the stage.

use palpate_core::quantity::{Axis, Down, Place, Range};
use palpate_data::dataset::Status;
use palpate_run::run::Halt;
use palpate_sim::scene::{ContactLaw, LoadCellScene, RelaxationBranch};
use palpate_testing::campaign;
use palpate_testing::safety::{STAIRCASE, SafetyBench, linear, recipe, rig_with, truthful};

// ---- force and depth -----------------------------------------------------------------------------------------------

#[test]
fn the_force_at_the_limit_never_exceeds_it_over_forty_seeds() {
    for seed in 1..=40 {
        let place = ["[[0, 0]]", "[[5.5, -4]]", "[[-6, 6]]", "[[-3, -6]]"][seed as usize % 4];
        SafetyBench::new(rig_with(|_, _| {}), &recipe(place, STAIRCASE), seed).must_complete(&format!("seed {seed}"));
    }
}

#[test]
fn rig_mounted_in_any_direction_presses_the_same() {
    let mount = |down: Down, surface_z_mm: f64, origin: Place, z: Range| {
        rig_with(|spec, _| {
            spec.frame.down = down;
            spec.frame.surface_z_mm = surface_z_mm;
            spec.frame.origin = origin;
            spec.stage.travel.axes[Axis::Z.index()] = z;
            spec.stage.home_z_mm = Some(-12.5 * down.sign()); // the limit is beyond the travel of some
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
        SafetyBench::new(spec, &text, 100 + i as u64).must_complete(&format!("mount {i}"));
    }
}

#[test]
fn specimen_as_stiff_as_declared_gets_at_most_the_limit() {
    let branch = |share, time_s| RelaxationBranch { share, time_s };
    for (i, (contact, relaxation, declared, force_n)) in [
        (linear(1.8), vec![branch(0.05, 0.3), branch(0.05, 5.0)], 1.98, 2.0),
        (linear(2.0), vec![], 2.0, 2.0),
        (linear(1.0), vec![branch(0.5, 0.05), branch(0.5, 5.0)], 2.0, 1.8),
        (ContactLaw { linear_n_mm: 0.8, quadratic_n_mm2: 0.5, toe_mm: 0.05 }, vec![], 2.2, 2.0),
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
            let output = format!("specimen {i}, seed {seed}");
            let text = recipe("[[-5, 5], [4, -3]]", &format!("force_n = {force_n:?}"));
            SafetyBench::new(spec, &text, seed).must_complete(&output);
        }
    }
}

#[test]
fn slow_load_cell_is_awaited() {
    // a conversion from before the end of a motion isn't the force after it
    for conversions_hz in [10.0, 20.0, 50.0, 1000.0] {
        for seed in 1..=4 {
            let spec = rig_with(|spec, scene| {
                spec.load_cell.conversions_hz = conversions_hz;
                spec.limits.stiffness_n_mm = 1.98;
                scene.contact = linear(1.8);
            });
            let output = format!("{conversions_hz} Hz, seed {seed}");
            SafetyBench::new(spec, &recipe("[[-5, 5], [4, -3]]", "force_n = 2.0"), seed).must_complete(&output);
        }
    }
}

#[test]
fn offset_of_the_load_cell_is_not_a_force() {
    for offset_n in [-1.5, -0.4, 0.4, 1.5] {
        let spec = rig_with(|_, scene| {
            scene.load_cell = Some(LoadCellScene { noise_n: 0.003, offset_n, ..LoadCellScene::default() })
        });
        SafetyBench::new(spec, &recipe("[[1, 2]]", STAIRCASE), 5).must_complete(&format!("offset {offset_n} N"));
    }
}

#[test]
fn noisy_load_cell_keeps_the_force() {
    for seed in 1..=10 {
        let spec = rig_with(|_, scene| {
            scene.load_cell = Some(LoadCellScene { noise_n: 0.02, offset_n: 0.0, ..LoadCellScene::default() })
        });
        let mut bench = SafetyBench::new(spec, &recipe("[[1, 2]]", "force_n = 1.9"), seed);
        let executed = bench.execute(None);
        assert_eq!(executed.ending.status(), Status::Complete, "seed {seed}: {:?}", executed.ending.text());
        let (peak_n, depth_mm) = bench.worst();
        assert!(peak_n <= 2.0 && depth_mm <= 1.6, "seed {seed}: {peak_n} N, {depth_mm} mm");
        // the tolerance, and the uncertainty of a window's mean of 20 readings: 2.5 sd of 4.5 mN
        let contact = bench.contacts().next().expect("a press");
        let off_n = contact.truth[0].force_true_n - 1.9;
        assert!(off_n.abs() <= 0.05 + 0.011, "seed {seed}: off by {off_n} N");
    }
}

#[test]
fn depth_limit_holds_on_a_specimen_that_yields_late() {
    // a soft start: contact is noticed late, and the depth limit ends the press
    for (i, contact) in [
        ContactLaw { linear_n_mm: 0.1, quadratic_n_mm2: 1.0, toe_mm: 0.0 },
        ContactLaw { linear_n_mm: 0.6, quadratic_n_mm2: 0.0, toe_mm: 0.3 },
        ContactLaw { linear_n_mm: 0.05, quadratic_n_mm2: 0.4, toe_mm: 0.0 },
    ]
    .into_iter()
    .enumerate()
    {
        let spec = rig_with(|spec, scene| {
            spec.limits.stiffness_n_mm = 4.0;
            scene.contact = contact;
            truthful(scene);
        });
        // the specimen reaches the force limit at the depth limit, so the press ends there, complete or with a trip
        let deepest_n = contact.force_n(spec.limits.depth_mm);
        let load = format!("force_n = {:.3}", (deepest_n * 1.02).min(2.0));
        let mut bench = SafetyBench::new(spec, &recipe("[[-4, 1], [3, 3]]", &load), 3);
        let executed = bench.execute(None);
        assert!(executed.ending.unparked.is_none(), "specimen {i}");
        let (peak_n, depth_mm) = bench.worst();
        assert!(peak_n <= 2.0 && depth_mm <= 1.6, "specimen {i}: {peak_n} N, {depth_mm} mm");
        // 10 % for the branches
        assert!(executed.shown_most_n <= 1.1 * deepest_n, "specimen {i}: {} of {deepest_n} N", executed.shown_most_n);
    }
}

// ---- a stop by a person --------------------------------------------------------------------------------------------

#[test]
fn stop_at_any_time_parks_and_the_run_can_be_completed() {
    let text = recipe("[[-4, 3], [4.5, 4.5]]", "staircase = { to_n = 1.0, step_n = 0.5, repeats = 1, rest_s = 0.0 }");
    let whole = SafetyBench::new(rig_with(|_, _| {}), &text, 9).execute(None).readings;
    assert!(whole > 500, "{whole} readings");
    // five levels at each of two places, each once
    let rows: Vec<(u64, u64)> = (0..2).flat_map(|press| (0..5).map(move |level| (press, level))).collect();
    let mut stopped_at = 0;
    while stopped_at < whole {
        let output = format!("stop at reading {stopped_at} of {whole}");
        let mut bench = SafetyBench::new(rig_with(|_, _| {}), &text, 9);
        let executed = bench.execute(Some(stopped_at));
        assert!(matches!(executed.ending.halt, Some(Halt::Cancelled)), "{output}: {:?}", executed.ending.text());
        bench.assert_parked(&executed, &output);
        assert_eq!(executed.ending.status(), Status::Stopped, "{output}");
        assert!(executed.readings <= stopped_at + 1, "{output}: {} readings", executed.readings);
        bench.folder.finish(executed.ending.end(String::new(), 0.0)).unwrap();
        bench.must_complete(&output);
        bench.folder.rebuild().unwrap();
        assert_eq!(bench.rows_on_disk(), rows, "{output}");
        stopped_at += campaign::every(331, 83) as u32;
    }
}
