//! What taxels read of a contact.

use super::*;
use palpate_core::mechanics::{Medium, lambda};
use proptest::prelude::*;

const FULL_SCALE_N: f64 = 2.0;

fn paper_layout() -> ArrayLayout {
    ArrayLayout::grid(3, 3, 4.5)
}

/// A half-space 5 mm deep, and nothing else.
fn plain() -> SkinSpec {
    SkinSpec { elastomer: Some(Elastomer::half_space(5.0)), ..SkinSpec::default() }
}

/// Everything that belongs to the specimen and is linear: a bonded layer, finite contact and taxels, all spreads.
fn rich() -> SkinSpec {
    SkinSpec {
        elastomer: Some(Elastomer { depth_mm: 5.0, medium: Medium::BondedLayer { poisson_ratio: 0.49 } }),
        indenter_radius_mm: 0.5,
        taxels: Taxels {
            radius_mm: 1.0,
            gain_spread_percent: 20.0,
            place_spread_mm: 0.1,
            depth_spread_percent: 5.0,
            baseline: 0.0,
            shear: false,
        },
        ..SkinSpec::default()
    }
}

fn skin(spec: &SkinSpec, seed: u64) -> Skin {
    Skin::new(spec, &paper_layout(), FULL_SCALE_N, seed)
}

fn outputs(skin: &Skin, force_n: f64, place: Place) -> [f64; 9] {
    let mut outputs = [f64::NAN; 9];
    skin.outputs(force_n, place, &mut outputs);
    outputs
}

fn noise(of: NoiseOf, floor: f64) -> Option<TaxelNoise> {
    Some(TaxelNoise { repeatability_percent: vec![3.0; 9], of, floor })
}

fn fault(unit: usize, kind: TaxelFaultKind) -> TaxelFault {
    TaxelFault { unit, kind }
}

/// Standard deviation of the central unit's error over many contacts straight above it.
fn sd_of_errors(spec: &SkinSpec, force_n: f64) -> f64 {
    let mut skin = skin(spec, 1);
    let mut rng = stream(1, 1, "taxel noise");
    let exact = outputs(&skin, force_n, Place::default())[4];
    let errors = (0..4000).map(|_| {
        skin.draw_contact(&mut rng);
        outputs(&skin, force_n, Place::default())[4] - exact
    });
    (errors.map(|error| error * error).sum::<f64>() / 4000.0).sqrt()
}

#[test]
fn plain_skin_equals_lambda_to_the_last_bit() {
    let (skin, layout) = (skin(&plain(), 3), paper_layout());
    for place in [Place::default(), Place::new(1.3, -5.2), Place::new(-6.0, 6.0)] {
        for (output, at) in outputs(&skin, 0.7, place).into_iter().zip(layout.places()) {
            assert_eq!(output.to_bits(), (0.7 * lambda(place.distance_mm(*at) / 5.0)).to_bits());
        }
    }
}

#[test]
fn one_newton_straight_above_gives_one_on_every_skin() {
    let unspread = SkinSpec { taxels: Taxels { radius_mm: 2.0, ..Taxels::default() }, ..rich() };
    assert!((outputs(&skin(&unspread, 1), 1.0, Place::default())[4] - 1.0).abs() < 1e-12);
    let no_elastomer = SkinSpec::default();
    assert_eq!(outputs(&skin(&no_elastomer, 1), 1.0, Place::default()), [0.0; 9]);
}

#[test]
fn spreads_are_bounded_and_follow_from_the_seed() {
    let spread_of = |taxels: Taxels, of: fn(&TaxelChannel) -> f64| -> Vec<f64> {
        let spec = SkinSpec { taxels, ..plain() };
        (0..60).flat_map(|seed| skin(&spec, seed).channels.iter().map(of).collect::<Vec<_>>()).collect()
    };
    let used_and_bounded = |values: &[f64], least: f64, most: f64| {
        let (low, high) =
            (values.iter().copied().fold(f64::MAX, f64::min), values.iter().copied().fold(f64::MIN, f64::max));
        let margin = 0.02 * (most - least);
        assert!(least <= low && low < least + margin && most - margin < high && high <= most, "{low} {high}");
    };
    let gains = Taxels { gain_spread_percent: 20.0, ..Taxels::default() };
    used_and_bounded(&spread_of(gains, |unit| unit.gain), 0.8, 1.2);
    let places = Taxels { place_spread_mm: 0.1, ..Taxels::default() };
    let beside = |mm: f64| (mm / 4.5 - (mm / 4.5).round()) * 4.5;
    let along_x = spread_of(places, |unit| unit.place.x_mm);
    used_and_bounded(&along_x.iter().map(|x| beside(*x)).collect::<Vec<_>>(), -0.1, 0.1);
    let depths = Taxels { depth_spread_percent: 5.0, ..Taxels::default() };
    let depth =
        |channel: &TaxelChannel| channel.response.as_ref().map_or(f64::NAN, |response| response.passage().depth_mm);
    used_and_bounded(&spread_of(depths, depth), 4.75, 5.25);
    used_and_bounded(&spread_of(depths, |unit| unit.gain), 1.05f64.powi(-2), 0.95f64.powi(-2));

    let both = Taxels { gain_spread_percent: 20.0, ..places };
    assert_eq!(spread_of(both, |unit| unit.gain), spread_of(gains, |unit| unit.gain), "each has its own stream");
    let read = |seed| outputs(&skin(&rich(), seed), 1.0, Place::default());
    assert_eq!(read(5), read(5));
    assert_ne!(read(5), read(6));
}

#[test]
fn noise_grows_with_its_named_quantity() {
    let sds = |of, floor| {
        let spec = SkinSpec { noise: noise(of, floor), ..plain() };
        [0.2, 1.0].map(|force_n| sd_of_errors(&spec, force_n))
    };
    let are = |found: [f64; 2], expected: [f64; 2]| {
        let near = found.iter().zip(expected).all(|(found, expected)| (found / expected - 1.0).abs() < 0.05);
        assert!(near, "{found:?} instead of {expected:?}");
    };
    are(sds(NoiseOf::FullScale, 0.0), [0.02, 0.02]);
    are(sds(NoiseOf::FullScale, 0.015), [0.025, 0.025]);
    are(sds(NoiseOf::Reading, 0.0), [0.002, 0.01]);
    let floored = SkinSpec { noise: noise(NoiseOf::Reading, 0.001), ..plain() };
    assert!((sd_of_errors(&floored, 1e-6) / 0.001 - 1.0).abs() < 0.05, "the floor is there without a reading");
}

#[test]
fn error_of_a_contact_is_constant_during_it() {
    let mut skin = skin(&SkinSpec { noise: noise(NoiseOf::FullScale, 0.001), ..plain() }, 1);
    let exact = outputs(&skin, 1.0, Place::default());
    skin.draw_contact(&mut stream(1, 1, "taxel noise"));
    let first = outputs(&skin, 1.0, Place::default());
    assert!(first.iter().zip(exact).all(|(first, exact)| *first != exact), "every unit has an error");
    assert_eq!(first, outputs(&skin, 1.0, Place::default()));
    skin.forget_contact();
    assert_eq!(exact, outputs(&skin, 1.0, Place::default()));
}

#[test]
fn faults_and_baseline_have_their_declared_effect() {
    let spec = SkinSpec {
        taxels: Taxels { baseline: 0.02, ..Taxels::default() },
        faults: vec![
            fault(1, TaxelFaultKind::Dead),
            fault(2, TaxelFaultKind::Stuck(3.0)),
            fault(5, TaxelFaultKind::Drifted(10.0)),
            fault(6, TaxelFaultKind::Clipped(0.1)),
            fault(5, TaxelFaultKind::Clipped(0.7)),
        ],
        ..plain()
    };
    let skin = skin(&spec, 1);
    let sound =
        |unit: usize, force_n: f64| force_n * lambda(paper_layout().places()[unit].distance_mm(Place::default()) / 5.0);
    let read = outputs(&skin, 0.5, Place::default());
    assert_eq!((read[0], read[1], read[5]), (0.0, 3.0, 0.1));
    assert!((read[4] - 1.1 * 0.5 - 0.02).abs() < 1e-15, "drifted, and not yet clipped: {}", read[4]);
    assert!((read[8] - sound(8, 0.5) - 0.02).abs() < 1e-15);
    assert_eq!(outputs(&skin, 1.0, Place::default())[4], 0.7);
    assert_eq!(outputs(&skin, 0.0, Place::default())[8], 0.02);
}

#[test]
#[should_panic(expected = "a fault of a unit there isn't")]
fn a_fault_of_a_unit_that_isnt_there_is_refused() {
    skin(&SkinSpec { faults: vec![fault(10, TaxelFaultKind::Dead)], ..plain() }, 1);
}

#[test]
fn a_converter_rounds_to_its_steps_and_ends_at_its_range() {
    let converter = Converter { bits: 16, range: 10.0 };
    let step = 20.0 / 65536.0;
    assert_eq!(converter.convert(0.0), 0.0);
    assert_eq!(converter.convert(1.4 * step), step);
    assert_eq!(converter.convert(-1.6 * step), -2.0 * step);
    assert_eq!((converter.convert(11.0), converter.convert(-11.0)), (10.0 - step, -10.0));
    let spec = SkinSpec { converter: Some(converter), ..plain() };
    for output in outputs(&skin(&spec, 1), 0.777, Place::new(1.0, 2.0)) {
        assert_eq!(output / step, (output / step).round());
    }
}

#[test]
fn converter_rounds_halves_away_from_zero_and_keeps_sign_and_nan() {
    let converter = Converter { bits: 32, range: 2f64.powi(31) }; // steps of 1
    for x in [0.0, 0.5, 0.49999999999999994, 1.5, 2.5, 2.4999999999999996, 0.3, 1e6 + 0.5, 2147483646.5] {
        for x in [x, -x] {
            assert_eq!(converter.convert(x).to_bits(), x.round().to_bits(), "{x}");
        }
    }
    assert!(converter.convert(f64::NAN).is_nan());
    assert_eq!(converter.convert(f64::INFINITY), 2f64.powi(31) - 1.0);
}

#[test]
fn hysteresis_is_on_the_unloading_branch() {
    let skin = skin(&SkinSpec { hysteresis_percent: Some(vec![4.0; 9]), ..plain() }, 1);
    let read = |unloading| {
        let mut outputs = [0.0; 9];
        skin.add_load(1.0, Place::default(), &mut outputs);
        skin.read_out(unloading, &mut outputs);
        outputs[4]
    };
    assert_eq!(read(0.0), 1.0);
    assert!((read(1.0) - 1.08).abs() < 1e-15 && (read(0.5) - 1.04).abs() < 1e-15);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn outputs_of_several_loads_add_up(
        seed in 0u64..1000, first_n in 0.0..1.0f64, second_n in 0.0..1.0f64,
        at in prop::array::uniform4(-8.0..8.0f64),
    ) {
        let skin = skin(&rich(), seed);
        let (first, second) = (Place::new(at[0], at[1]), Place::new(at[2], at[3]));
        let mut both = [0.0; 9];
        skin.add_load(first_n, first, &mut both);
        skin.add_load(second_n, second, &mut both);
        skin.read_out(0.0, &mut both);
        let apart = (outputs(&skin, first_n, first), outputs(&skin, second_n, second));
        for (unit, sum) in both.iter().enumerate() {
            prop_assert!((sum - apart.0[unit] - apart.1[unit]).abs() < 1e-12);
        }
        // and a load of twice the force is two
        let twice = outputs(&skin, 2.0 * first_n, first);
        for (unit, reading) in twice.iter().enumerate() {
            prop_assert!((reading - 2.0 * apart.0[unit]).abs() < 1e-12);
        }
    }
}

#[test]
fn a_unit_of_three_channels_reads_the_stress_and_its_slopes_times_the_depth() {
    let layout = paper_layout();
    let (one, three) = (skin(&plain(), 3), Skin::new(&plain(), &layout.clone().with_channels(3), FULL_SCALE_N, 3));
    let read = |place: Place| {
        let mut outputs = [f64::NAN; 27];
        three.outputs(0.7, place, &mut outputs);
        outputs
    };
    for place in [Place::default(), Place::new(1.3, -5.2), Place::new(-6.0, 6.0)] {
        let (found, normal) = (read(place), outputs(&one, 0.7, place));
        // the slopes as differences of the first channel, over a tenth of a micrometre either way
        let by_mm = |dx: f64, dy: f64, unit: usize| {
            let at = |way: f64| outputs(&one, 0.7, Place::new(place.x_mm + way * dx, place.y_mm + way * dy))[unit];
            (at(1.0) - at(-1.0)) / 2e-4
        };
        for unit in 0..9 {
            assert_eq!(found[3 * unit].to_bits(), normal[unit].to_bits());
            assert!((found[3 * unit + 1] - 5.0 * by_mm(1e-4, 0.0, unit)).abs() < 1e-6, "x, unit {unit}");
            assert!((found[3 * unit + 2] - 5.0 * by_mm(0.0, 1e-4, unit)).abs() < 1e-6, "y, unit {unit}");
        }
    }
}

#[test]
fn a_units_fault_hysteresis_and_noise_are_those_of_all_its_channels() {
    let layout = paper_layout().with_channels(3);
    let spec = SkinSpec { faults: vec![fault(2, TaxelFaultKind::Stuck(3.0))], ..plain() };
    let mut outputs = [0.0; 27];
    Skin::new(&spec, &layout, FULL_SCALE_N, 1).outputs(1.0, Place::new(1.0, 1.0), &mut outputs);
    assert_eq!(outputs[3..6], [3.0; 3]);
    assert!(outputs.iter().filter(|output| **output == 3.0).count() == 3);
    let spec = SkinSpec { hysteresis_percent: Some(vec![5.0; 9]), noise: noise(NoiseOf::FullScale, 0.0), ..plain() };
    let mut skin = Skin::new(&spec, &layout, FULL_SCALE_N, 1);
    let (mut loading, mut unloading) = ([0.0; 27], [0.0; 27]);
    skin.add_load(1.0, Place::new(1.0, 1.0), &mut loading);
    skin.add_load(1.0, Place::new(1.0, 1.0), &mut unloading);
    let still = loading;
    skin.read_out(1.0, &mut unloading);
    assert!((12..15).all(|channel| unloading[channel].abs() > still[channel].abs()));
    skin.draw_contact(&mut stream(1, 1, "taxel noise"));
    skin.read_out(0.0, &mut loading);
    let errors: Vec<f64> = (12..15).map(|channel| loading[channel] - still[channel]).collect();
    assert!(errors.iter().all(|error| *error != 0.0) && errors[0] != errors[1], "{errors:?}");
}

#[test]
fn taxels_with_shear_read_the_traction_of_any_force() {
    let spec = SkinSpec { taxels: Taxels { shear: true, ..Taxels::default() }, ..plain() };
    let layout = ArrayLayout::from_places(vec![Place::new(4.5, 0.0)]).with_channels(3);
    let skin = Skin::new(&spec, &layout, FULL_SCALE_N, 1);
    let read = |force_n: [f64; 3]| {
        let mut outputs = [0.0; 3];
        skin.add_force(force_n, Place::default(), &mut outputs);
        outputs
    };
    // normal, along x, along y: golden values of Boussinesq and Cerruti at a distance of 4.5 mm and a depth of 5 mm
    let near = |read: [f64; 3], golden: [f64; 3]| read.iter().zip(golden).all(|(a, b)| (a - b).abs() < 1e-8);
    assert!(near(read([0.0, 0.0, 1.0]), [0.226_883_84, 0.204_195_46, 0.0]), "{:?}", read([0.0, 0.0, 1.0]));
    assert!(near(read([1.0, 0.0, 0.0]), [0.204_195_46, 0.183_775_91, 0.0]), "{:?}", read([1.0, 0.0, 0.0]));
    assert!(near(read([0.0, 1.0, 0.0]), [0.0; 3]), "a unit beside a force along y");
}
