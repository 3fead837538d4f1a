//! `palpate adapt`: an old calibration that is updated with few presses.

use palpate_core::quantity::{ArrayLayout, Place, stream};
use palpate_sim::scene::{Elastomer, Skin, SkinSpec, Taxels};
use palpate_solver::{
    Adapted, Calibration, CalibrationPoint, ContactVerdict, Fitted, HalfWidths, Setting, Solution, Solver as _,
    Workspace, fit,
};
use palpate_testing::skins::scene_t;
use palpate_testing::{TestFolder, campaign};
use rand::RngExt;

/// Sensors of one design: gains differ by 20 %, places by 0.1 mm.
fn family_sensor(seed: u64) -> Skin {
    sensor(&spread_spec(0.1), seed)
}

/// The design's skin, with gains that differ by 20 %.
pub(super) fn spread_spec(place_spread_mm: f64) -> SkinSpec {
    SkinSpec { taxels: Taxels { gain_spread_percent: 20.0, place_spread_mm, ..Taxels::default() }, ..scene_t() }
}

pub(super) fn sensor(spec: &SkinSpec, seed: u64) -> Skin {
    Skin::new(spec, &ArrayLayout::grid(3, 3, 4.5), 2.0, seed)
}

/// A sensor of another skin: another pitch, a thin layer, and a flat indenter.
pub(super) fn other_skin(spec: SkinSpec, seed: u64) -> Skin {
    let spec = SkinSpec { elastomer: Some(Elastomer::half_space(3.5)), indenter_radius_mm: 1.0, ..spec };
    Skin::new(&spec, &ArrayLayout::grid(3, 3, 5.0), 2.0, seed)
}

/// Largest coordinate of a contact, mm.
pub(super) const HALF_MM: f64 = 6.0;

/// New presses of a sensor under 1 N, and 400 contacts.
pub(super) fn draw(skin: &mut Skin, seed: u64, presses: usize) -> (Calibration, Vec<AdaptRow>) {
    let mut rng = stream(seed, 2, "contacts");
    let mut place = || Place::new(rng.random_range(-HALF_MM..=HALF_MM), rng.random_range(-HALF_MM..=HALF_MM));
    let new: Vec<_> = (0..presses).map(|_| (place(), 1.0)).collect();
    let contacts: Vec<_> = (0..400).map(|_| place()).collect();
    let contacts: Vec<_> = contacts.into_iter().map(|place| (place, rng.random_range(0.1..=1.0))).collect();
    (calibration(&pressed(skin, new, seed + 1000)), pressed(skin, contacts, seed + 2000))
}

pub(super) type AdaptRow = (Place, f64, Vec<f64>);

pub(super) fn pressed(skin: &mut Skin, contacts: impl IntoIterator<Item = (Place, f64)>, seed: u64) -> Vec<AdaptRow> {
    let mut rng = stream(seed, 1, "contacts");
    let mut press = |(place, force_n): (Place, f64)| {
        skin.draw_contact(&mut rng);
        let mut outputs = vec![0.0; skin.len()];
        skin.outputs(force_n, place, &mut outputs);
        (place, force_n, outputs)
    };
    contacts.into_iter().map(&mut press).collect()
}

pub(super) fn calibration(rows: &[AdaptRow]) -> Calibration {
    let points: Vec<CalibrationPoint<'_>> = rows
        .iter()
        .map(|(place, force_n, outputs)| CalibrationPoint { place: *place, force_n: *force_n, outputs })
        .collect();
    Calibration::new(&points).unwrap()
}

pub(super) fn grid(side: usize, half_mm: f64) -> Vec<(Place, f64)> {
    let at = |i: usize| -half_mm + 2.0 * half_mm * i as f64 / (side - 1) as f64;
    (0..side * side).map(|i| (Place::new(at(i % side), at(i / side)), 1.0)).collect()
}

/// So many presses, spread over the area.
fn few(count: usize) -> Vec<(Place, f64)> {
    match count {
        5 => [(0.0, 0.0), (4.0, 4.0), (-4.0, 4.0), (4.0, -4.0), (-4.0, -4.0)]
            .map(|(x_mm, y_mm)| (Place::new(x_mm, y_mm), 1.0))
            .to_vec(),
        9 => grid(3, 4.5),
        count => spread(count),
    }
}

/// Places that fill the area evenly, in any order.
fn spread(count: usize) -> Vec<(Place, f64)> {
    let at = |i: usize, step: f64| 11.0 * ((0.5 + (i + 1) as f64 * step).fract() - 0.5);
    (0..count).map(|i| (Place::new(at(i, 0.754_877_666), at(i, 0.569_840_291)), 1.0)).collect()
}

/// Mean errors, the fraction of single contacts with another verdict, and the fractions of errors within the half-widths.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub location_mm: f64,
    force_n: f64,
    pub doubted: f64,
    pub within_68: f64,
    pub within_95: f64,
}

impl Found {
    pub(super) fn of(fitted: &Fitted, test: &[AdaptRow]) -> Self {
        Found::by(|outputs, workspace| fitted.solve(outputs, workspace).unwrap(), test)
    }

    pub(super) fn by(mut solve: impl FnMut(&[f64], &mut Workspace) -> Solution, test: &[AdaptRow]) -> Self {
        let (mut workspace, mut found) = (Workspace::default(), Found::default());
        let each = 1.0 / test.len() as f64;
        for (place, force_n, outputs) in test {
            let solution = solve(outputs, &mut workspace);
            let off_mm = solution.place.distance_mm(*place);
            found.location_mm += each * off_mm;
            found.force_n += each * (solution.force_n - force_n).abs();
            found.doubted += each * f64::from(u8::from(solution.verdict != ContactVerdict::Ok));
            let is_within = |most_mm: fn(&HalfWidths) -> f64| {
                f64::from(u8::from(solution.half_widths.is_none_or(|half| off_mm <= most_mm(&half))))
            };
            found.within_68 += each * is_within(|half| half.half68_mm);
            found.within_95 += each * is_within(|half| half.half95_mm);
        }
        found
    }
}

/// The mean over some sensors of the same family: with the old calibration, with the updated one, and with a complete one.
fn found(counts: &[usize], contacts_of: impl Fn(usize) -> Vec<(Place, f64)>) -> (Found, Vec<Found>, Found) {
    let seeds = campaign::size(1, 3) as u64;
    let add = |sum: &mut Found, one: Found| {
        let each = 1.0 / seeds as f64;
        sum.location_mm += each * one.location_mm;
        sum.force_n += each * one.force_n;
        sum.doubted += each * one.doubted;
        sum.within_68 += each * one.within_68;
    };
    let old = calibration(&pressed(&mut family_sensor(100), grid(25, 6.0), 100));
    let fitted = |calibration: &Calibration| fit("surrogate", calibration, &Setting::default()).unwrap();
    let (mut before, mut full) = (Found::default(), Found::default());
    let mut after: Vec<Found> = counts.iter().map(|_| Found::default()).collect();
    for seed in 1..=seeds {
        let mut skin = family_sensor(seed);
        let mut rng = stream(seed, 2, "contacts");
        let mut along = || rng.random_range(-6.0..=6.0);
        let places: Vec<Place> = (0..400).map(|_| Place::new(along(), along())).collect();
        let contacts: Vec<_> = places.into_iter().map(|place| (place, rng.random_range(0.1..=1.0))).collect();
        let test = pressed(&mut skin, contacts, seed + 10);
        add(&mut before, Found::of(&fitted(&old), &test));
        add(&mut full, Found::of(&fitted(&calibration(&pressed(&mut skin, grid(25, 6.0), seed + 20))), &test));
        for (count, after) in counts.iter().zip(&mut after) {
            let new = calibration(&pressed(&mut skin, contacts_of(*count), seed + 30));
            let adapted = Adapted::new("surrogate", &old, &new, &Setting::default()).unwrap();
            let one = Found::of(adapted.model.fitted(), &test);
            println!("{seed}, {count}: {:?} {:?} {one:?}", adapted.update, adapted.held_out());
            add(after, one);
        }
    }
    println!("old {before:?}");
    counts.iter().zip(&after).for_each(|(count, after)| println!("{count}: {after:?}"));
    println!("full {full:?}");
    (before, after, full)
}

#[test]
fn sensor_of_the_same_family_needs_few_presses() {
    let all = [(5, 0.27, 2.0), (9, 0.24, 1.25), (50, 0.23, 1.25)];
    let tried = if campaign::is_quick() { &all[..2] } else { &all[..] };
    let counts: Vec<usize> = tried.iter().map(|(count, ..)| *count).collect();
    let (before, after, full) = found(&counts, few);
    for (after, &(_, most_mm, most_times)) in after.iter().zip(tried) {
        assert!(after.location_mm <= most_mm, "{after:?}");
        assert!(after.force_n <= most_times * full.force_n, "{after:?} {full:?}");
        assert!(after.within_68 >= 0.6, "{after:?}");
    }
    assert!(before.location_mm > 0.4, "{before:?}");
}

#[test]
fn new_presses_may_be_anywhere() {
    let all = [(5, 0.27), (9, 0.25)];
    let tried = if campaign::is_quick() { &all[..1] } else { &all[..] };
    let counts: Vec<usize> = tried.iter().map(|(count, _)| *count).collect();
    let (_, after, _) = found(&counts, spread);
    assert!(after.iter().zip(tried).all(|(after, (_, most_mm))| after.location_mm <= *most_mm), "{after:?}");
}

#[test]
fn adapt_writes_a_sensor_file_and_prints_held_out_errors() {
    let table = |rows: &[AdaptRow]| {
        let row = |(place, force_n, outputs): &AdaptRow| {
            let outputs: Vec<String> = outputs.iter().map(f64::to_string).collect();
            format!("{},{},{force_n},{}\n", place.x_mm, place.y_mm, outputs.join(","))
        };
        let header = "x_mm,y_mm,force_n,out_1,out_2,out_3,out_4,out_5,out_6,out_7,out_8,out_9\n";
        header.to_owned() + &rows.iter().map(row).collect::<String>()
    };
    let old = table(&pressed(&mut family_sensor(100), grid(13, 6.0), 100));
    let nine = pressed(&mut family_sensor(1), few(9), 31);
    let bench = TestFolder::with([("old.csv", &*old), ("few.csv", &table(&nine)), ("four.csv", &table(&nine[..4]))]);
    let output = bench.palpate_ends(0, "adapt --from old.csv --with few.csv --solver surrogate --out a.palpate");
    assert!(
        output.out.starts_with("9 new presses, mean error (cross-validated)\n  old calibration, unchanged ")
            && output.out.contains("  <- chosen\n")
            && output.out.contains("\ngains     x "),
        "{}",
        output.out
    );
    assert!(output.out.lines().all(|line| line.chars().count() < 80), "{}", output.out);
    let bytes = std::fs::read(bench.path("a.palpate")).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.contains("\"name\":\"old.csv\"") && text.contains("\"name\":\"few.csv\""), "{}", &text[..600]);
    // a sensor file replaces the presses that it contains
    bench.palpate_ends(0, "fit old.csv --solver surrogate --out old.palpate");
    let again = bench.palpate_ends(0, "adapt --from old.palpate --with few.csv --solver surrogate --out a.palpate");
    assert_eq!(again.out, output.out);
    // places that have nothing to do with the readings
    let shuffled = nine.iter().zip(nine.iter().rev()).enumerate().map(|(i, (one, other))| {
        let (place, _, _) = if i % 2 == 0 { one } else { other };
        (Place::new(-place.y_mm, place.x_mm), one.1, one.2.clone())
    });
    bench.write("shuffled.csv", &table(&shuffled.collect::<Vec<_>>()));
    let command = "adapt --from old.csv --with shuffled.csv --solver surrogate --out b.palpate";
    let output = bench.palpate_ends(1, command);
    assert!(output.running().contains("the mean place of the new presses is as good an answer"), "{}", output.err);
    assert!(!bench.has("b.palpate"));
    bench.palpate_ends(0, &format!("{command} --anyway"));
    std::fs::remove_file(bench.path("b.palpate")).unwrap();
    let output = bench.palpate_ends(2, "adapt --from old.csv --with four.csv --out b.palpate");
    assert!(output.running().contains("there are 4 new presses; 5 are required"), "{}", output.err);
    bench.write("two.csv", "x_mm,y_mm,out_1,out_2\n0,0,1,2\n");
    let output = bench.palpate_ends(2, "adapt --from old.csv --with two.csv --out b.palpate");
    assert!(
        output.running().contains("the old calibration has 9 outputs per press, the new presses have 2"),
        "{}",
        output.err
    );
    assert!(!bench.has("b.palpate"));
}
