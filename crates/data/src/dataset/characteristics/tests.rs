//! Characteristics of readings that a person can work out.

use super::*;
use palpate_core::quantity::{Place, stream};
use rand_distr::{Distribution as _, StandardNormal};

const LEVELS: [f64; 9] = [0.0, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0, 0.5, 0.0];

/// The levels of a staircase at a place, read as said: the level's number, its branch and its set force.
fn held(place: Place, output: impl Fn(usize, Branch, f64) -> f64) -> Vec<HeldLevel> {
    let levels = LEVELS.iter().enumerate();
    levels
        .map(|(level, &force_n)| {
            let branch = if level <= 4 { Branch::Loading } else { Branch::Unloading };
            let output = output(level, branch, force_n);
            HeldLevel { place, top_n: 2.0, branch, force_set_n: force_n, force_n, output }
        })
        .collect()
}

/// A unit that reads `force + offset`, with `loop_width` added on the way down at 1 N and half of it at 0.5 and 1.5
/// N.
fn staircase(offset: f64, loop_width: f64, force_error_n: f64) -> Vec<HeldLevel> {
    let mut readings = held(Place::default(), |level, _, force_n| {
        let share = if level <= 4 { 0.0 } else { 1.0 - (force_n - 1.0).abs() };
        force_n + share * loop_width
    });
    for reading in readings.iter_mut().filter(|reading| reading.force_set_n > 0.0) {
        let sign = if reading.branch == Branch::Loading { -1.0 } else { 1.0 };
        reading.force_n += sign * force_error_n;
        reading.output += offset + sign * force_error_n;
    }
    readings
}

fn one_unit(readings: Vec<HeldLevel>, repeatability: Repeatability) -> UnitCharacteristics {
    characterise(&Staircases { readings: vec![readings], units: vec![0], left_out: 0 }, repeatability)[0]
}

fn assert_near(found: Option<f64>, expected: f64) {
    assert!((found.unwrap() - expected).abs() < 1e-9, "{found:?} instead of {expected}");
}

#[test]
fn each_repeatability_matches_its_definition() {
    // Offsets of -0.02..0.02: variance 0.00025, range 0.04; full scale 2.
    let readings: Vec<HeldLevel> =
        [-0.02, -0.01, 0.0, 0.01, 0.02].iter().flat_map(|&offset| staircase(offset, 0.0, 0.0)).collect();
    let sd_percent = 0.00025f64.sqrt() / 2.0 * 100.0;
    // chi-squared of 4 degrees of freedom: 0.4844186 and 11.143287; c4 of 5 repeats: 0.939986
    let (least, most) = ((4.0f64 / 11.143_287).sqrt(), (4.0f64 / 0.484_418_6).sqrt());
    for (repeatability, expected, interval) in [
        (Repeatability::ThreeSd, 3.0 * sd_percent, Some(1.0)),
        (Repeatability::Range, 2.0, Some(0.939_985_6)),
        (Repeatability::T95, 2.776_445_105_197_79 * sd_percent, Some(1.0)),
        (Repeatability::WorstLevel, 3.0 * sd_percent, None),
    ] {
        let measured = one_unit(readings.clone(), repeatability);
        assert!((measured.repeatability_loading_percent.unwrap() - expected).abs() < 1e-6, "{repeatability:?}");
        assert!((measured.repeatability_unloading_percent.unwrap() - expected).abs() < 1e-6, "{repeatability:?}");
        for branch in [Branch::Loading, Branch::Unloading] {
            let found = measured.repeatability_interval_percent(branch);
            assert_eq!(found.is_some(), interval.is_some(), "{repeatability:?}");
            let ends = interval.map(|share| (expected * share * least, expected * share * most));
            for (found, expected) in found.into_iter().zip(ends) {
                let off = (found.0 / expected.0 - 1.0).abs().max((found.1 / expected.1 - 1.0).abs());
                assert!(off < 1e-6, "{repeatability:?}: {found:?} instead of {expected:?}");
            }
        }
    }
}

#[test]
fn hysteresis_is_the_widest_inner_gap_wherever_the_loop_stops() {
    for force_error_n in [0.0, 0.05] {
        let readings = (0..5).flat_map(|_| staircase(0.0, 0.08, force_error_n)).collect();
        let measured = one_unit(readings, Repeatability::ThreeSd);
        assert_near(measured.hysteresis_percent, 4.0); // 0.08 of 2
        // 0.08 between 1 and 1.08; at 0.5 N it is 0.04 between 0.5 and 0.54: 7.692307692 %
        assert_near(measured.hysteresis_of_reading_percent, 100.0 * 0.08 / 1.04);
        assert_near(measured.repeatability_loading_percent, 0.0);
    }
}

#[test]
fn linearity_is_the_largest_distance_from_the_least_squares_line() {
    // 0, 0.5, 1, 1.5 and 2 N read 0, 0.6, 1, 1.4, 2: by hand, slope 0.96 and intercept 0.04, so that the levels are off by
    // -0.04, 0.08, 0, -0.08 and 0.04
    let readings = held(Place::default(), |_, branch, force_n| {
        let bump = if force_n == 0.5 { 0.1 } else { -0.1 };
        let bump = if force_n % 1.0 == 0.5 { bump } else { 0.0 };
        // unloading has no effect on linearity
        force_n + bump + if branch == Branch::Unloading { 0.3 } else { 0.0 }
    });
    assert_near(one_unit(readings, Repeatability::ThreeSd).linearity_percent, 4.0); // 0.08 of 2
    // a line that misses zero is linear too
    let lifted = held(Place::default(), |_, _, force_n| 0.5 + force_n);
    assert_near(one_unit(lifted, Repeatability::ThreeSd).linearity_percent, 0.0);
    // and any two levels are on one
    let two = staircase(0.0, 0.0, 0.0).into_iter().filter(|reading| reading.force_set_n % 2.0 == 0.0).collect();
    assert_eq!(one_unit(two, Repeatability::ThreeSd).linearity_percent, None);
}

#[test]
fn zero_return_is_the_output_without_load_after_minus_before() {
    // two staircases: 0.01 before and 0.03 after, 0.02 before and 0.03 after: 0.015 of 2 on average
    let read = |before: f64, after: f64| {
        let no_load = move |level: usize| [before, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, after][level];
        held(Place::default(), move |level, _, force_n| force_n + no_load(level))
    };
    let mut readings = [read(0.01, 0.03), read(0.02, 0.03)].concat();
    // the load cell's reading without load isn't used
    readings.iter_mut().filter(|reading| reading.force_set_n == 0.0).for_each(|reading| reading.force_n = 0.004);
    assert_near(one_unit(readings.clone(), Repeatability::ThreeSd).zero_return_percent, 0.75);
    assert_near(one_unit(read(0.03, 0.01), Repeatability::ThreeSd).zero_return_percent, -1.0);
    readings.retain(|reading| reading.force_set_n > 0.0);
    assert_eq!(one_unit(readings, Repeatability::ThreeSd).zero_return_percent, None);
}

#[test]
fn repeats_are_those_of_one_place_and_the_rest_is_the_worst_place() {
    // at the unit's centre it reads the force, 3 mm away half of it; each place repeats to the digit
    let near = |offset: f64| staircase(offset, 0.08, 0.0);
    let far = |offset: f64| {
        let far =
            |reading: HeldLevel| HeldLevel { place: Place::new(3.0, 0.0), output: 0.5 * reading.output, ..reading };
        staircase(offset, 0.02, 0.0).into_iter().map(far).collect::<Vec<HeldLevel>>()
    };
    let still = one_unit([near(0.0), far(0.0), near(0.0), far(0.0)].concat(), Repeatability::ThreeSd);
    assert_near(still.repeatability_loading_percent, 0.0);
    assert_near(still.repeatability_unloading_percent, 0.0);
    assert_near(still.hysteresis_percent, 4.0); // of the centre: 0.08 of its 2
    assert_near(still.hysteresis_of_reading_percent, 100.0 * 0.08 / 1.04);

    // variances of 2e-4 at the centre and 0.5e-4 away, from two repeats each: 1.25e-4 pooled
    let loose = [near(-0.01), near(0.01), far(-0.01), far(0.01)].concat();
    let loose = one_unit(loose, Repeatability::ThreeSd);
    assert_near(loose.repeatability_loading_percent, 300.0 * 1.25e-4f64.sqrt() / 2.0);

    // up to 1 N the loop differs: that series is separate, and full scale is that of 2 N
    let half: Vec<HeldLevel> = near(0.0)
        .into_iter()
        .filter(|reading| {
            reading.force_set_n < 1.0 || (reading.force_set_n == 1.0 && reading.branch == Branch::Loading)
        })
        .map(|reading| HeldLevel {
            top_n: 1.0,
            output: if reading.force_set_n > 0.0 { reading.output + 0.2 } else { 0.0 },
            ..reading
        })
        .collect();
    let both = one_unit([near(0.0), near(0.0), half].concat(), Repeatability::ThreeSd);
    assert_near(both.repeatability_loading_percent, 0.0);
    assert_near(both.hysteresis_percent, 4.0);
}

#[test]
fn channels_of_a_unit_share_the_scale_of_the_largest() {
    let scaled = |factor: f64| -> Vec<HeldLevel> {
        let mut readings = staircase(0.0, 0.1, 0.0);
        readings.iter_mut().for_each(|reading| reading.output *= factor);
        readings
    };
    let readings = vec![scaled(1.0), scaled(-0.001), scaled(3.0)];
    let staircases = Staircases { readings, units: vec![0, 0, 1], left_out: 0 };
    let [normal, slope, other] = characterise(&staircases, Repeatability::default())[..] else { unreachable!() };
    assert_eq!([normal.name(), slope.name(), other.name()], ["1.1", "1.2", "2"]);
    assert_near(normal.hysteresis_percent, 5.0);
    assert_near(slope.hysteresis_percent, 0.005);
    assert_near(other.hysteresis_percent, 5.0);
    assert!(normal.hysteresis_of_reading_percent.is_some() && slope.hysteresis_of_reading_percent.is_none());
}

#[test]
fn undetermined_characteristic_is_none() {
    let once = one_unit(staircase(0.0, 0.08, 0.0), Repeatability::T95);
    assert_eq!((once.repeatability_loading_percent, once.repeatability_unloading_percent), (None, None));
    assert_eq!(once.repeatability_loading_interval_percent, None);
    assert_near(once.hysteresis_percent, 4.0);

    let nothing = UnitCharacteristics { unit: 1, ..UnitCharacteristics::default() };
    assert!(nothing.is_none() && !once.is_none());
    assert_eq!(one_unit(Vec::new(), Repeatability::ThreeSd), nothing);
    let constant = HeldLevel { force_set_n: 1.0, force_n: 1.0, output: 1.0, ..staircase(0.0, 0.0, 0.0)[0] };
    assert_eq!(one_unit(vec![constant; 5], Repeatability::ThreeSd), nothing); // no slope
    let mute = staircase(0.0, 0.0, 0.0).iter().map(|reading| HeldLevel { output: 0.0, ..*reading }).collect();
    assert_eq!(one_unit(mute, Repeatability::ThreeSd), nothing); // no full scale
    let only_down = HeldLevel { branch: Branch::Unloading, ..constant };
    assert_eq!(one_unit(vec![only_down; 5], Repeatability::ThreeSd), nothing);
}

/// Errors of a sensor whose true standard deviation is known.
struct Errors {
    /// The contact's, shared by all levels.
    of_contact: f64,
    /// Each level's own.
    of_level: f64,
    /// Whether both grow with the force, up to these at 2 N.
    grow: bool,
}

/// The share of 1,000 sensors whose true repeatability lies in the interval, by loading and unloading repeats together.
fn coverage(repeatability: Repeatability, errors: &Errors, repeats: usize, reads_at_places: &[f64]) -> f64 {
    let mut noise = stream(7, repeats as u64, "coverage");
    let mut normal = |sd: f64| {
        let drawn: f64 = StandardNormal.sample(&mut noise);
        sd * drawn
    };
    let (mut covered, mut all) = (0, 0);
    for _ in 0..1000 {
        let mut readings = Vec::new();
        for (place, reads) in reads_at_places.iter().enumerate() {
            for _ in 0..repeats {
                let contact = normal(errors.of_contact);
                let own: Vec<f64> = LEVELS.iter().map(|_| normal(errors.of_level)).collect();
                readings.extend(held(Place::new(place as f64, 0.0), |level, _, force_n| {
                    let share = if errors.grow { force_n / 2.0 } else { 1.0 };
                    let error = if force_n > 0.0 { share * (contact + own[level]) } else { 0.0 };
                    reads * (force_n + error)
                }));
            }
        }
        let unit = one_unit(readings, repeatability);
        // levels of 0.5, 1 and 1.5 N count on both branches, that of 2 N while loading
        for (branch, forces) in [(Branch::Loading, &LEVELS[1..5]), (Branch::Unloading, &LEVELS[5..8])] {
            let share = |force_n: &f64| if errors.grow { force_n / 2.0 } else { 1.0 };
            let sd = errors.of_contact.hypot(errors.of_level);
            let each = || reads_at_places.iter().flat_map(|reads| forces.iter().map(move |n| reads * sd * share(n)));
            let count = each().count() as f64;
            let true_value = match repeatability {
                Repeatability::Range => 2.325_93 * each().sum::<f64>() / count, // d2 of 5
                Repeatability::T95 => 2.776_445 * (each().map(|sd| sd * sd).sum::<f64>() / count).sqrt(),
                _ => 3.0 * (each().map(|sd| sd * sd).sum::<f64>() / count).sqrt(),
            };
            let most = reads_at_places.iter().fold(0.0f64, |most, reads| most.max(2.0 * reads));
            let (truth, interval) = (100.0 * true_value / most, unit.repeatability_interval_percent(branch));
            covered += u32::from(interval.is_some_and(|(least, most)| least < truth && truth < most));
            all += 1;
        }
    }
    f64::from(covered) / f64::from(all)
}

#[test]
fn nineteen_of_twenty_intervals_contain_the_true_repeatability() {
    let of_contact = |grow| Errors { of_contact: 0.02, of_level: 0.0, grow };
    let mostly = Errors { of_contact: 0.02, of_level: 0.004, grow: false };
    let is_stated = |share: f64, what: &str| {
        println!("{what}: {share}");
        assert!((0.925..=0.975).contains(&share), "{what}: {share}");
    };
    for repeats in [2, 3, 5, 10] {
        for grow in [false, true] {
            let share = coverage(Repeatability::ThreeSd, &of_contact(grow), repeats, &[1.0]);
            is_stated(share, &format!("{repeats} repeats, errors that grow: {grow}"));
        }
    }
    for repeatability in [Repeatability::Range, Repeatability::T95] {
        is_stated(coverage(repeatability, &of_contact(false), 5, &[1.0]), &format!("{repeatability:?}"));
    }
    is_stated(coverage(Repeatability::ThreeSd, &mostly, 5, &[1.0]), "errors of levels besides");
    for places in [[1.0, 1.0, 1.0], [1.0, 0.5, 0.2]] {
        let share = coverage(Repeatability::ThreeSd, &of_contact(false), 5, &places);
        is_stated(share, &format!("places that read {places:?}"));
    }
    // where the whole error is that of the levels, the interval is too wide, never too narrow
    let own = Errors { of_contact: 0.0, of_level: 0.02, grow: false };
    assert!(coverage(Repeatability::ThreeSd, &own, 5, &[1.0]) > 0.975);
}

#[test]
fn every_term_is_explained_once_in_a_sentence() {
    let common = terms::COMMON.map(|term| term.definition);
    let definitions = common.into_iter().chain(Repeatability::ALL.map(|one| one.definition()));
    for definition in definitions {
        assert!(!definition.contains("  ") && !definition.ends_with('.'), "{definition}");
    }
    for (index, term) in terms::COMMON.iter().enumerate() {
        assert!(terms::COMMON[..index].iter().all(|before| before.name != term.name), "{}", term.name);
    }
}
