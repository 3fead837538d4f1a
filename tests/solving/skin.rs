//! The effect of each physical term on the paper's solver, compared with the numbers of an independent program: a skin is calibrated with 1
//! N at 625 points and tested with random contacts, without a rig. See the numbers with `cargo test --release --test solving skin:: --
//! --nocapture`.

use palpate_core::mechanics::Medium;
use palpate_core::quantity::{ArrayLayout, Place, RandomStream, stream};
use palpate_sim::scene::{Elastomer, Skin, SkinSpec, TaxelFault, TaxelFaultKind, Taxels};
use palpate_solver::{Calibration, CalibrationPoint, Setting, TestPress, evaluate, fit};
use palpate_testing::campaign;
use palpate_testing::skins::{scene_q, scene_t};
use rand::RngExt;

/// Seeds in the full tier, and tests of each.
const SEEDS: usize = 12;
const TESTS: usize = 300;

fn seeds() -> usize {
    campaign::size(1, SEEDS)
}

/// Mean location error (mm) and force error (N) of the paper's solver over all seeds.
#[derive(Debug)]
struct SkinErrors {
    location_mm: f64,
    force_n: f64,
}

/// A skin's reading of one contact.
fn read(skin: &mut Skin, rng: &mut RandomStream, force_n: f64, place: Place) -> Vec<f64> {
    let mut outputs = vec![0.0; skin.len()];
    skin.draw_contact(rng);
    skin.outputs(force_n, place, &mut outputs);
    outputs
}

/// The paper's solver, calibrated on one skin and tested on the skin after a change.
fn errors(calibrated: &SkinSpec, tested: &SkinSpec) -> SkinErrors {
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let mut sums = SkinErrors { location_mm: 0.0, force_n: 0.0 };
    for seed in 0..seeds() as u64 {
        let [mut before, mut after] = [calibrated, tested].map(|spec| Skin::new(spec, &layout, 2.0, seed));
        let mut rng = stream(seed, 1, "taxel noise");
        let at = |index: usize| -6.0 + 0.5 * index as f64;
        let grid: Vec<_> = (0..625)
            .map(|index| Place::new(at(index % 25), at(index / 25)))
            .map(|place| (place, read(&mut before, &mut rng, 1.0, place)))
            .collect();
        let points: Vec<_> =
            grid.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
        let contacts: Vec<_> = (0..TESTS)
            .map(|_| {
                let place = Place::new(rng.random_range(-6.0..=6.0), rng.random_range(-6.0..=6.0));
                let force_n = rng.random_range(0.1..=1.0);
                (place, force_n, read(&mut after, &mut rng, force_n, place))
            })
            .collect();
        let tests: Vec<_> = contacts
            .iter()
            .map(|(place, force_n, outputs)| TestPress {
                place: *place,
                force_n: Some(*force_n),
                depth_mm: None,
                outputs,
            })
            .collect();
        let solver = fit("pearson", &Calibration::new(&points).unwrap(), &Setting::of_layout(Some(&layout))).unwrap();
        let evaluation = evaluate(&solver, &tests).unwrap();
        sums.location_mm += evaluation.location_error_mm.mean / seeds() as f64;
        sums.force_n += evaluation.force_error_n.unwrap().mean / seeds() as f64;
    }
    sums
}

/// Two programs with other random numbers: each mean of some thousand contacts is known to 2 %, and that of fewer seeds less well.
fn assert_near(name: &str, found: &SkinErrors, location_mm: f64, force_n: Option<f64>) {
    let SkinErrors { location_mm: ours_mm, force_n: ours_n } = *found;
    let force = force_n.map_or(String::new(), |force_n| format!(" and {force_n} N"));
    let within = 0.06 * (SEEDS as f64 / seeds() as f64).sqrt().max(1.0);
    println!("{name:<24}{} seeds: {ours_mm:.3} mm {ours_n:.4} N, computed apart {location_mm} mm{force}", seeds());
    assert!((ours_mm / location_mm - 1.0).abs() < within, "{name}: {ours_mm} mm instead of {location_mm}");
    let near = force_n.is_none_or(|force_n| (ours_n / force_n - 1.0).abs() < within);
    assert!(near, "{name}: {ours_n} N instead of {force_n:?}");
}

#[test]
fn terms_of_the_specimen_have_their_expected_effect_on_pearson() {
    let layer = Some(Elastomer { depth_mm: 5.0, medium: Medium::BondedLayer { poisson_ratio: 0.49 } });
    let spread = Taxels {
        radius_mm: 1.0,
        gain_spread_percent: 20.0,
        place_spread_mm: 0.1,
        depth_spread_percent: 5.0,
        ..Taxels::default()
    };
    let size = |radius_mm| Taxels { radius_mm, ..Taxels::default() };
    let rich = SkinSpec { elastomer: layer, indenter_radius_mm: 0.5, taxels: spread, ..scene_t() };
    for (name, spec, location_mm, force_n) in [
        ("noise of full scale", scene_t(), 0.455, Some(0.0332)),
        ("noise of the reading", scene_q(), 0.220, Some(0.0198)),
        ("bonded layer", SkinSpec { elastomer: layer, ..scene_t() }, 0.465, Some(0.0400)),
        ("indenter", SkinSpec { indenter_radius_mm: 0.5, ..scene_t() }, 0.445, Some(0.0321)),
        ("taxels of 1 mm", SkinSpec { taxels: size(1.0), ..scene_t() }, 0.437, None),
        ("taxels of 2 mm", SkinSpec { taxels: size(2.0), ..scene_t() }, 0.408, None),
        ("all of it", rich, 0.442, Some(0.0363)),
    ] {
        assert_near(name, &errors(&spec, &spec), location_mm, force_n);
    }
}

#[test]
fn faults_after_calibration_have_their_expected_effect() {
    let with = |unit, kind| SkinSpec { faults: vec![TaxelFault { unit, kind }], ..scene_t() };
    for (name, after, location_mm, force_n) in [
        ("dead corner", with(1, TaxelFaultKind::Dead), 0.912, None),
        ("dead edge", with(2, TaxelFaultKind::Dead), 1.154, None),
        ("dead centre", with(5, TaxelFaultKind::Dead), 1.675, None),
        ("clipped edge", with(2, TaxelFaultKind::Clipped(0.3)), 0.50, Some(0.047)),
        ("drifted edge", with(2, TaxelFaultKind::Drifted(10.0)), 0.465, None),
        ("offset", SkinSpec { taxels: OFFSET, ..scene_t() }, 0.449, Some(0.041)),
    ] {
        assert_near(name, &errors(&scene_t(), &after), location_mm, force_n);
    }
    assert_near("offset, quiet", &errors(&scene_q(), &SkinSpec { taxels: OFFSET, ..scene_q() }), 0.221, Some(0.0315));
}

/// Common offset of all units, 1 % of full scale.
const OFFSET: Taxels = Taxels {
    radius_mm: 0.0,
    gain_spread_percent: 0.0,
    place_spread_mm: 0.0,
    depth_spread_percent: 0.0,
    baseline: 0.02,
    shear: false,
};

#[test]
fn a_common_offset_moves_no_place_and_a_stuck_unit_moves_all() {
    let unrounded = SkinSpec { converter: None, ..scene_q() };
    let sound = errors(&unrounded, &unrounded);
    let offset = errors(&unrounded, &SkinSpec { taxels: OFFSET, ..unrounded.clone() });
    assert!((sound.location_mm - offset.location_mm).abs() < 1e-12, "a correlation knows of no offset");
    assert!(offset.force_n > sound.force_n, "a force does");
    let stuck = TaxelFault { unit: 5, kind: TaxelFaultKind::Stuck(3.0) };
    let stuck = errors(&unrounded, &SkinSpec { faults: vec![stuck], ..unrounded.clone() });
    assert!(stuck.location_mm > 2.0, "{stuck:?}");
}
