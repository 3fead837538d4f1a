//! `palpate adapt` against what it replaces: the old calibration as it is, and a fit of the new presses alone.
//!
//! The pairs are two sensors of one design, or two sessions of one real skin. Bars: over many draws of the new presses, the error is
//! at most 1.05 times the smaller of both (1.10 with 10 presses, and the old one's with 5); of a single draw at most 1.25. With 5
//! presses single draws aren't judged: chance gives one in 20 a worse way, up to 1.35 of the smaller error.

use super::adapt::{AdaptRow, Found, HALF_MM, calibration, draw, grid, other_skin, pressed, sensor, spread_spec};
use super::real_skins::{data, mean_of_passes};
use palpate_core::quantity::stream;
use palpate_data::dataset::{Mapping, read_table};
use palpate_sim::scene::{Elastomer, Skin, SkinSpec};
use palpate_solver::{Adapted, BEST, Calibration, CalibrationPoint, Fitted, Model, Session, Setting, fit};
use palpate_testing::campaign;
use rand::RngExt;

/// One draw: new presses, and contacts of the same sensor.
type Draw = (Calibration, Vec<AdaptRow>);

/// How the second of two sensors differs from the first one.
#[derive(Clone, Copy, Debug)]
enum Differs {
    /// Gains by 20 %.
    Gains,
    /// Places by 0.1 mm too.
    Pitch,
    /// And a layer that is 10 % thicker.
    Layer,
    /// Another skin: another pitch, a thin layer, and a flat indenter.
    Skin,
}

impl Differs {
    /// The sensor of a seed; 0 is the old one.
    fn sensor(self, seed: u64) -> Skin {
        let spec = spread_spec(if matches!(self, Differs::Gains) { 0.0 } else { 0.1 });
        match self {
            Differs::Layer if seed > 0 => {
                sensor(&SkinSpec { elastomer: Some(Elastomer::half_space(5.5)), ..spec }, seed)
            }
            Differs::Skin if seed > 0 => other_skin(spec, seed),
            _ => sensor(&spec, seed),
        }
    }

    fn draw(self, seed: u64, presses: usize) -> Draw {
        draw(&mut self.sensor(seed), seed, presses)
    }
}

/// Means over draws.
#[derive(Debug, Default)]
struct Means {
    /// Error divided by the smaller one of the old calibration and of the new presses alone: its mean and its largest value.
    ratio: f64,
    most: f64,
    /// Error divided by that of the old calibration.
    to_old: f64,
    within_68: f64,
    within_95: f64,
    doubted: f64,
}

fn means(solver: &str, old: &Calibration, draws: u64, draw: impl Fn(u64) -> Draw) -> Means {
    let fitted = |calibration: &Calibration| fit(solver, calibration, &Setting::default());
    let unchanged: Fitted = fitted(old).unwrap();
    let (mut means, each) = (Means::default(), 1.0 / draws as f64);
    for seed in 1..=draws {
        let (new, test) = draw(seed);
        let adapted = Adapted::new(solver, old, &new, &Setting::default()).unwrap();
        let found = Found::of(adapted.model.fitted(), &test);
        let unchanged_mm = Found::of(&unchanged, &test).location_mm;
        let alone_mm = fitted(&new).map_or(f64::INFINITY, |fitted| Found::of(&fitted, &test).location_mm);
        let ratio = found.location_mm / unchanged_mm.min(alone_mm);
        println!("{seed}: {:?}, old {unchanged_mm:.3} mm, alone {alone_mm:.3} mm, {found:?}", adapted.update);
        means.ratio += each * ratio;
        means.most = means.most.max(ratio);
        means.to_old += each * found.location_mm / unchanged_mm;
        means.within_68 += each * found.within_68;
        means.within_95 += each * found.within_95;
        means.doubted += each * found.doubted;
    }
    means
}

/// Returns the bars that aren't met.
fn missed(pair: &str, presses: usize, means: &Means) -> Vec<String> {
    println!("{pair}, {presses} presses: {means:?}");
    let Means { ratio, most, to_old, within_68, within_95, doubted } = *means;
    // few draws show no coverage
    let shows_coverage = presses >= 10 && !campaign::is_quick();
    let bars = [
        (presses < 10 || most <= 1.25, "a draw"),
        (presses >= 10 || to_old <= 1.0, "worse than the old calibration"),
        (presses < 10 || ratio <= if presses < 20 { 1.10 } else { 1.05 }, "worse than the better of both"),
        (!shows_coverage || (0.60..=0.78).contains(&within_68), "68 %"),
        (!shows_coverage || (0.92..=0.985).contains(&within_95), "95 %"),
        (!shows_coverage || doubted <= 0.02, "sound contacts flagged"),
    ];
    let missed = bars.into_iter().filter(|(is_met, _)| !is_met);
    missed.map(|(_, bar)| format!("{pair}, {presses} presses, {bar}: {means:?}")).collect()
}

/// In the quick tier one draw, which shows no coverage.
#[test]
fn adapt_is_as_good_as_the_old_calibration_and_as_the_new_presses() {
    if campaign::is_quick() {
        let old = calibration(&pressed(&mut Differs::Skin.sensor(0), grid(11, HALF_MM), 0));
        let means = means("surrogate", &old, 1, |seed| Differs::Skin.draw(seed, 20));
        assert!(means.ratio <= 0.9, "a correction uses both: {means:?}");
        return;
    }
    let mut problems = Vec::new();
    for differs in [Differs::Skin, Differs::Layer, Differs::Pitch, Differs::Gains] {
        let old = calibration(&pressed(&mut differs.sensor(0), grid(13, HALF_MM), 0));
        for presses in [5, 10, 20, 50] {
            let draws = campaign::size(1, 20) as u64;
            let means = means(BEST, &old, draws, |seed| differs.draw(seed, presses));
            problems.extend(missed(&format!("{differs:?}"), presses, &means));
        }
    }
    assert!(problems.is_empty(), "{problems:#?}");
}

/// A unit that breaks later is left out. What the new presses showed of the errors holds for the refit, also from a sensor file.
#[test]
fn refit_without_a_unit_states_the_errors_of_the_new_session() {
    let draws = campaign::size(1, 10) as u64;
    for differs in &[Differs::Skin, Differs::Pitch][..campaign::size(1, 2)] {
        let old = calibration(&pressed(&mut differs.sensor(0), grid(9, HALF_MM), 0));
        let mut sum = Found::default();
        for seed in 1..=draws {
            let (new, mut test) = differs.draw(seed, 20);
            let adapted = Adapted::new("surrogate", &old, &new, &Setting::default()).unwrap();
            let model = Model::from_bytes(&adapted.model.to_bytes().unwrap()).unwrap();
            test.iter_mut().for_each(|(.., outputs)| outputs[4] = f64::NAN);
            let mut session = Session::new(model);
            let one = Found::by(|outputs, _| session.solve(outputs).unwrap(), &test);
            println!("{differs:?} {seed}: {:?} {one:?}", adapted.update);
            sum.within_68 += one.within_68 / draws as f64;
            sum.within_95 += one.within_95 / draws as f64;
            sum.doubted += one.doubted / draws as f64;
        }
        println!("{differs:?}: {sum:?}");
        assert!((0.55..=0.85).contains(&sum.within_68) && sum.within_95 >= 0.88 && sum.doubted <= 0.04, "{sum:?}");
    }
}

/// From presses of one depth to presses at random depths.
#[test]
#[ignore = "needs the published tables: PALPATE_DATA names their folder"]
fn adapt_is_as_good_on_a_real_skin_pressed_at_other_depths() {
    let data = data("eflesh");
    let old: Vec<AdaptRow> = mean_of_passes(&data.join("fixed_depth.csv"))
        .into_iter()
        .map(|(place, outputs)| (place, 1.0, outputs))
        .collect();
    let pool = read_table(&data.join("random_depth.csv"), &Mapping::default()).unwrap().presses;
    let pool: Vec<AdaptRow> = pool.into_iter().map(|press| (press.place(), 1.0, press.outputs)).collect();
    let relative = |rows: &[AdaptRow]| {
        let points =
            rows.iter().map(|(place, force_n, outputs)| CalibrationPoint { place: *place, force_n: *force_n, outputs });
        Calibration::without_forces(&points.collect::<Vec<_>>()).unwrap()
    };
    let mut problems = Vec::new();
    for presses in [5, 10, 20, 50] {
        let draw = |seed: u64| {
            let mut rng = stream(seed, 3, "contacts");
            let new: Vec<usize> = (0..presses).map(|_| rng.random_range(0..pool.len())).collect();
            let test = (0..pool.len()).step_by(7).filter(|press| !new.contains(press));
            let rows = |of: Vec<usize>| of.into_iter().map(|press| pool[press].clone()).collect::<Vec<_>>();
            (relative(&rows(new.clone())), rows(test.collect()))
        };
        let means = means(BEST, &relative(&old), campaign::size(2, 20) as u64, draw);
        problems.extend(missed("eFlesh", presses, &means));
    }
    assert!(problems.is_empty(), "{problems:#?}");
}
