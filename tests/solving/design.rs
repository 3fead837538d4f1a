//! One map for several sensors of a design, and its errors on a sensor that it doesn't know.

use super::adapt::{AdaptRow, Found, HALF_MM, calibration, draw, grid, other_skin, pressed, sensor, spread_spec};
use palpate_core::quantity::stream;
use palpate_sim::scene::{Elastomer, Skin, SkinSpec};
use palpate_solver::{
    Adapted, BEST, Calibration, DesignMap, PreparedCalibration, SensorErrors, SensorPresses, Setting, fit,
    leave_one_sensor_out,
};
use palpate_testing::{TestFolder, campaign};
use rand::RngExt;

/// How the sensors of a design differ.
#[derive(Clone, Copy, Debug)]
enum Design {
    /// Gains by 20 %.
    Gains,
    /// Places by 0.1 mm too.
    Pitch,
    /// And the thickness of the layer by 10 %.
    Layer,
    /// Gains and places, of another skin: another pitch, a thin layer, and a flat indenter.
    Skin,
}

impl Design {
    fn sensor(self, seed: u64) -> Skin {
        let spec = spread_spec(if matches!(self, Design::Gains) { 0.0 } else { 0.1 });
        match self {
            Design::Gains | Design::Pitch => sensor(&spec, seed),
            Design::Layer => {
                let times = stream(seed, 4, "layer").random_range(0.9..=1.1);
                sensor(&SkinSpec { elastomer: Some(Elastomer::half_space(5.0 * times)), ..spec }, seed)
            }
            Design::Skin => other_skin(spec, seed),
        }
    }

    fn calibration(self, seed: u64, side: usize) -> Calibration {
        calibration(&pressed(&mut self.sensor(seed), grid(side, HALF_MM), seed))
    }
}

/// Sums over draws of the errors on unseen sensors.
#[derive(Debug, Default)]
struct Unseen {
    by_design_mm: f64,
    by_one_mm: f64,
    within_68: f64,
    within_95: f64,
    flagged: f64,
    adapted_from_design_mm: f64,
    adapted_from_one_mm: f64,
}

/// The means over draws of some sensors and an unseen one.
fn unseen(solver: &str, design: Design, sensors: u64, side: usize, draws: u64) -> Unseen {
    let (mut means, each) = (Unseen::default(), 1.0 / draws as f64);
    for first in (0..draws).map(|draw| 100 * draw) {
        let sensors: Vec<Calibration> = (first..first + sensors).map(|seed| design.calibration(seed, side)).collect();
        let map = DesignMap::new(solver, &sensors, &Setting::default()).unwrap().model;
        let seed = first + 50;
        let (few, test) = draw(&mut design.sensor(seed), seed, 10);
        let found = Found::of(map.fitted(), &test);
        let adapted_mm = |from: &Calibration| {
            let adapted = Adapted::new(solver, from, &few, &Setting::default()).unwrap();
            each * Found::of(adapted.model.fitted(), &test).location_mm
        };
        means.by_design_mm += each * found.location_mm;
        means.by_one_mm += each * Found::of(&fit(solver, &sensors[0], &Setting::default()).unwrap(), &test).location_mm;
        means.within_68 += each * found.within_68;
        means.within_95 += each * found.within_95;
        means.flagged += each * found.doubted;
        means.adapted_from_design_mm += adapted_mm(map.calibration().unwrap());
        means.adapted_from_one_mm += adapted_mm(&sensors[0]);
    }
    println!("{design:?} {solver}, {sensors} sensors of {side} x {side} places: {means:.3?}");
    means
}

/// In the quick tier one draw, which shows no coverage.
#[test]
fn map_of_a_design_is_better_than_that_of_one_sensor() {
    if campaign::is_quick() {
        let means = unseen("surrogate", Design::Pitch, 3, 7, 1);
        assert!(means.by_design_mm < means.by_one_mm && means.flagged <= 0.02, "{means:?}");
        return;
    }
    let mut missed = Vec::new();
    for design in [Design::Gains, Design::Pitch, Design::Layer, Design::Skin] {
        for (sensors, side) in [(2, 13), (3, 13), (5, 13), (5, 7)] {
            let means = unseen(BEST, design, sensors, side, campaign::size(1, 20) as u64);
            let Unseen { within_68, within_95, .. } = means;
            // two sensors show little of how sensors differ
            let is_covered = sensors == 2 || (0.60..=0.78).contains(&within_68) && (0.92..=0.985).contains(&within_95);
            let is_better = means.by_design_mm < means.by_one_mm
                && means.adapted_from_design_mm <= 1.05 * means.adapted_from_one_mm;
            if !is_covered || !is_better || means.flagged > 0.02 {
                missed.push(format!("{design:?}, {sensors} sensors: {means:?}"));
            }
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}

/// One skin whose outputs have known gains: the mean of all sensors is 1 for each unit.
fn with_gains(gains: [f64; 3]) -> [Vec<AdaptRow>; 3] {
    let mut seed = 0;
    gains.map(|gain| {
        seed += 1;
        let mut rows = pressed(&mut Design::Pitch.sensor(7), grid(9, HALF_MM), seed);
        // the first unit deviates the other way
        let scaled = |(unit, output): (usize, &mut f64)| *output *= if unit == 0 { 2.0 - gain } else { gain };
        rows.iter_mut().for_each(|(.., outputs)| outputs.iter_mut().enumerate().for_each(scaled));
        rows
    })
}

#[test]
fn known_gains_are_found() {
    let gains = [0.8, 1.0, 1.2];
    let calibrations = with_gains(gains).map(|rows| calibration(&rows));
    let map = DesignMap::new("surrogate", &calibrations, &Setting::default()).unwrap();
    for (sensor, gain) in map.sensors.iter().zip(gains) {
        for (unit, change) in sensor.change.units.iter().enumerate() {
            let expected = if unit == 0 { 2.0 - gain } else { gain };
            assert!((change.gain - expected).abs() < 0.02, "unit {unit}: {change:?}, expected {expected}");
            assert!(change.x_mm.hypot(change.y_mm) < 0.05, "unit {unit}: {change:?}");
        }
    }
}

#[test]
fn a_sensor_that_is_left_out_is_unknown() {
    let sensors = |gain: f64| {
        let [first, second, mut third] = with_gains([0.95, 1.05, 1.0]);
        third.iter_mut().for_each(|(.., outputs)| outputs.iter_mut().for_each(|output| *output *= gain));
        let presses = |rows: &[AdaptRow]| SensorPresses { calibration: calibration(rows), test: None };
        leave_one_sensor_out("surrogate", &[presses(&first), presses(&second), presses(&third)], &Setting::default())
            .unwrap()
    };
    let ((before, all), (after, _)) = (sensors(1.0), sensors(2.0));
    let force_n = |errors: &SensorErrors| errors.force_error_n.mean;
    // of 1 N; a map that knew the sensor would have a part of its gain
    assert!(force_n(&before[2].by_the_others) < 0.1, "{before:?}");
    assert!((force_n(&after[2].by_the_others) - 1.0).abs() < 0.1, "{after:?}");
    assert!(after[2].by_the_others.flagged >= before[2].by_the_others.flagged);
    // the others' map has changed, their own calibration hasn't
    assert!(force_n(&after[0].by_the_others) > 2.0 * force_n(&before[0].by_the_others), "{after:?}");
    assert_eq!(after[0].by_its_own.location_error_mm, before[0].by_its_own.location_error_mm);
    assert_eq!(all.presses, before.iter().map(|sensor| sensor.by_the_others.presses).sum::<usize>());
}

/// `pearson` answers with one of the places that it knows. Known to it, the place of a press would be its answer.
#[test]
fn place_of_a_press_is_unknown_to_a_method_that_recognises_places() {
    for jitter_mm in [0.0, 0.004] {
        let of = |seed: u64| {
            let mut rng = stream(seed, 5, "jitter");
            let mut rows = pressed(&mut Design::Pitch.sensor(seed), grid(7, HALF_MM), seed);
            rows.iter_mut().for_each(|(place, ..)| place.x_mm += jitter_mm * rng.random_range(-1.0..=1.0));
            calibration(&rows)
        };
        let calibrations = [of(1), of(2), of(3)];
        let map = DesignMap::new("pearson", &calibrations, &Setting::default()).unwrap();
        for sensor in &map.sensors {
            let location_mm = sensor.by_the_others.location_mm;
            assert!(location_mm >= 1.9, "2 mm is the distance of the places: {location_mm} mm");
        }
        let prepared = PreparedCalibration::new(map.model.calibration().unwrap().clone(), &Setting::default()).unwrap();
        let tried = prepared.candidates("pearson").unwrap();
        assert!(tried[0].location_error_mm > Some(1.0), "{jitter_mm}: {tried:?}");
    }
}

fn table(rows: &[AdaptRow]) -> String {
    let row = |(place, force_n, outputs): &AdaptRow| {
        let outputs: Vec<String> = outputs.iter().map(f64::to_string).collect();
        format!("{},{},{force_n},{}\n", place.x_mm, place.y_mm, outputs.join(","))
    };
    let header: String = (1..=rows[0].2.len()).map(|unit| format!(",out_{unit}")).collect();
    format!("x_mm,y_mm,force_n{header}\n") + &rows.iter().map(row).collect::<String>()
}

#[test]
fn fit_of_several_sensors_prints_and_writes_their_map() {
    let [a, b, c] = with_gains([0.8, 1.0, 1.2]).map(|rows| table(&rows));
    let few = table(&pressed(&mut Design::Pitch.sensor(3), grid(3, 4.0), 5));
    let bench = TestFolder::with([("a.csv", &*a), ("b.csv", &b), ("c.csv", &c), ("few.csv", &few)]);
    let fit = "fit a.csv b.csv c.csv --solver surrogate --out d.palpate";
    let output = bench.palpate_ends(0, fit);
    assert!(output.out.contains("\na.csv        81  0.84"), "{}", output.out);
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    let written = String::from_utf8_lossy(&std::fs::read(bench.path("d.palpate")).unwrap()).into_owned();
    assert!(["a.csv", "b.csv", "c.csv"].iter().all(|name| written.contains(&format!("\"name\":\"{name}\""))));
    let object: serde_json::Value = serde_json::from_str(&bench.palpate_ends(0, &format!("{fit} --json")).out).unwrap();
    let sensors = object["sensors"].as_array().unwrap();
    assert_eq!(sensors.iter().map(|sensor| &sensor["sensor"]).collect::<Vec<_>>(), ["a.csv", "b.csv", "c.csv"]);
    assert!(sensors[2]["mean_error"]["force_n"].as_f64() > Some(0.1), "{object}");
    let reading = few.lines().nth(1).unwrap().split(',').skip(3).collect::<Vec<_>>().join(",");
    let answer = bench.palpate_reads("solve --model d.palpate --json", &format!("[{reading}]")).json_lines();
    assert!(answer[0]["half95_mm"].as_f64() > answer[0]["half68_mm"].as_f64(), "{answer:?}");
    bench.palpate_ends(0, "adapt --from d.palpate --with few.csv --solver surrogate --out e.palpate");
    let alone = bench.palpate_ends(0, "fit a.csv --solver surrogate --out a.palpate --json").out;
    assert!(!alone.contains("sensors"), "{alone}");
    let evaluate = "evaluate a.csv b.csv c.csv --leave-one-sensor-out --solver surrogate";
    let output = bench.palpate_ends(0, evaluate);
    assert!(output.out.starts_with("location, mm  presses ") && output.out.contains("\nforce, N "), "{}", output.out);
    assert!(output.out.contains("\nall               243 "), "{}", output.out);
    assert!(output.out.lines().all(|line| line.chars().count() <= 80), "{}", output.out);
    let object: serde_json::Value =
        serde_json::from_str(&bench.palpate_ends(0, &format!("{evaluate} --json")).out).unwrap();
    assert_eq!(object["all"]["presses"], 243);
    assert_eq!(object["sensors"][1]["by_its_own"]["presses"], 81);
    // `fit` knows the error before the limits of a misfit, with which some presses are solved without a unit
    let mean_mm = object["sensors"][2]["by_the_others"]["location_error_mm"]["mean"].as_f64().unwrap();
    let of_fit_mm = sensors[2]["mean_error"]["location_mm"].as_f64().unwrap();
    assert!((mean_mm / of_fit_mm - 1.0).abs() < 0.1, "{mean_mm} mm, {of_fit_mm} mm");
}

#[test]
fn sensors_that_are_no_design_are_refused_by_name() {
    let [a, b, _] = with_gains([0.8, 1.0, 1.2]);
    let without = |column: &str| table(&b).replace("force_n", column);
    let two: Vec<AdaptRow> = b.iter().map(|(place, force_n, of)| (*place, *force_n, of[..2].to_vec())).collect();
    let dead: Vec<AdaptRow> =
        b.iter().map(|(place, force_n, of)| (*place, *force_n, [&[0.0], &of[1..]].concat())).collect();
    let bench = TestFolder::with([
        ("a.csv", &*table(&a)),
        ("b.csv", &table(&b)),
        ("two.csv", &table(&two)),
        ("dead.csv", &table(&dead)),
        ("unknown.csv", &without("note")),
        ("depth.csv", &without("depth_mm")),
    ]);
    for (arguments, problem) in [
        ("a.csv two.csv", "two.csv: 2 outputs per press, a.csv has 9"),
        ("a.csv dead.csv", "dead.csv: output 1 "),
        ("a.csv unknown.csv", "unknown.csv: the forces of its presses aren't known, in newtons"),
        ("a.csv depth.csv", "depth.csv: the forces of its presses aren't known, in newtons"),
        ("a.csv a.csv", "a.csv: it is the same sensor as a.csv"),
        ("a.csv b.csv --vector", "--vector fits one sensor, not a design"),
        ("a.csv b.csv --history", "--history fits one sensor, not a design"),
    ] {
        let output = bench.palpate_ends(2, &format!("fit {arguments} --out d.palpate"));
        assert!(output.running().contains(problem), "{}", output.err);
        assert!(!bench.has("d.palpate"));
    }
    for (arguments, problem) in [
        ("a.csv two.csv --leave-one-sensor-out", "two.csv: 2 outputs per press, a.csv has 9"),
        ("a.csv --leave-one-sensor-out", "a design needs at least two sensors"),
        ("a.csv b.csv --leave-one-sensor-out --solver all", "invalid value 'all' for '--solver'"),
        ("a.csv b.csv --leave-one-sensor-out --accept a.toml", "cannot be used with"),
        ("a.csv b.csv --leave-one-sensor-out --holdout places 20%", "cannot be used with"),
        ("a.csv b.csv two.csv", "takes one run folder, or two tables"),
    ] {
        let output = bench.palpate_ends(2, &format!("evaluate {arguments}"));
        assert!(output.running().contains(problem), "{arguments}: {}", output.err);
    }
}
