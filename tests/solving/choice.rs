//! How well `best` chooses among the methods on six families of simulated skins. `PALPATE_TESTS=full cargo test --release --test solving
//! choice:: -- --nocapture`. `PALPATE_SETS=DIR` writes the sets as tables, for a comparison with other programs.

use palpate_core::mechanics::Medium;
use palpate_core::parallel::in_parallel;
use palpate_core::quantity::{ArrayLayout, Place, RandomStream, stream};
use palpate_sim::scene::{Elastomer, NoiseOf, Skin, SkinSpec, TaxelNoise, Taxels};
use palpate_solver::{
    BEST, Calibration, CalibrationPoint, ContactVerdict, PreparedCalibration, SOLVERS, Setting, Solver as _, Workspace,
};
use palpate_testing::{TestFolder, campaign};
use rand::RngExt;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// A press: place, force, outputs.
pub(crate) struct ChoicePress {
    pub place: Place,
    pub force_n: f64,
    pub outputs: Vec<f64>,
}

/// Presses for calibration and for the test.
pub(crate) struct Set {
    family: &'static str,
    seed: u64,
    pub calibration: Vec<ChoicePress>,
    pub test: Vec<ChoicePress>,
    layout: ArrayLayout,
}

/// A kind of skin, and its calibration.
#[derive(Clone, Copy)]
pub(crate) struct Family {
    pub name: &'static str,
    /// Changes the outputs of an elastic skin as its electronics do, in place; the number of columns is 4.
    read: fn(&mut [f64]),
    gain_spread_percent: f64,
    /// Places along a side, and presses at each.
    side: usize,
    repeats: usize,
    /// Forces of the calibration, N.
    pub force_n: (f64, f64),
}

/// Largest loss of `best` compared with the method that is best on the other half of the test: mean of all families, and of one.
const LOSS_MOST: f64 = 0.02;
const LOSS_OF_FAMILY_MOST: f64 = 0.06;

const COLUMNS: usize = 4;
const PITCH_MM: f64 = 4.5;
const HALF_MM: f64 = 8.0;
const TESTS: usize = 400;
const SEEDS: usize = 10;

pub(crate) const FAMILIES: [Family; 6] = [
    Family { name: "gains", read: |_| {}, gain_spread_percent: 60.0, side: 13, repeats: 1, force_n: (1.0, 1.0) },
    Family { name: "saturation", read: saturate, gain_spread_percent: 20.0, side: 15, repeats: 1, force_n: (0.2, 1.0) },
    Family { name: "crosstalk", read: mix, gain_spread_percent: 20.0, side: 13, repeats: 1, force_n: (1.0, 1.0) },
    Family { name: "dead zones", read: deaden, gain_spread_percent: 20.0, side: 15, repeats: 1, force_n: (0.3, 1.0) },
    Family { name: "coarse grid", read: |_| {}, gain_spread_percent: 20.0, side: 7, repeats: 1, force_n: (1.0, 1.0) },
    Family { name: "repeats", read: saturate, gain_spread_percent: 20.0, side: 9, repeats: 5, force_n: (0.3, 1.0) },
];

fn saturate(outputs: &mut [f64]) {
    outputs.iter_mut().for_each(|output| *output = 0.4 * (*output / 0.4).tanh());
}

fn mix(outputs: &mut [f64]) {
    let own = outputs.to_vec();
    for (unit, output) in outputs.iter_mut().enumerate() {
        let is_beside = |other: &usize| {
            (unit % COLUMNS).abs_diff(other % COLUMNS) + (unit / COLUMNS).abs_diff(other / COLUMNS) == 1
        };
        *output += 0.3 * (0..own.len()).filter(is_beside).map(|other| own[other]).sum::<f64>();
    }
}

fn deaden(outputs: &mut [f64]) {
    outputs.iter_mut().for_each(|output| *output = (*output - 0.08).max(0.0));
}

/// A contact with a skin.
fn pressed(skin: &mut Skin, place: Place, force_n: f64, rng: &mut RandomStream) -> ChoicePress {
    skin.draw_contact(rng);
    let mut outputs = vec![0.0; skin.len()];
    skin.outputs(force_n, place, &mut outputs);
    ChoicePress { place, force_n, outputs }
}

impl Family {
    fn set(&self, seed: u64) -> Set {
        self.set_with(seed, (0.3, 1.0))
    }

    /// Returns a set whose test presses have forces in a range, N.
    pub(crate) fn set_with(&self, seed: u64, test_force_n: (f64, f64)) -> Set {
        let layout = ArrayLayout::grid(COLUMNS, COLUMNS, PITCH_MM);
        let spec = SkinSpec {
            elastomer: Some(Elastomer { depth_mm: 4.0, medium: Medium::BondedLayer { poisson_ratio: 0.49 } }),
            indenter_radius_mm: 0.5,
            taxels: Taxels {
                radius_mm: 1.0,
                gain_spread_percent: self.gain_spread_percent,
                place_spread_mm: 0.2,
                depth_spread_percent: 5.0,
                ..Taxels::default()
            },
            noise: Some(TaxelNoise {
                repeatability_percent: vec![2.0; COLUMNS * COLUMNS],
                of: NoiseOf::FullScale,
                floor: 0.0,
            }),
            ..SkinSpec::default()
        };
        let mut skin = Skin::new(&spec, &layout, 1.0, seed);
        let mut rng = stream(seed, 1, self.name);
        let mut press = |place: Place, force_n: f64, rng: &mut RandomStream| {
            let mut press = pressed(&mut skin, place, force_n, rng);
            (self.read)(&mut press.outputs);
            press
        };
        let at = |index: usize| HALF_MM * (2.0 * index as f64 / (self.side - 1) as f64 - 1.0);
        let mut calibration = Vec::new();
        for index in (0..self.side * self.side).flat_map(|index| vec![index; self.repeats]) {
            let force_n = rng.random_range(self.force_n.0..=self.force_n.1);
            calibration.push(press(Place::new(at(index % self.side), at(index / self.side)), force_n, &mut rng));
        }
        let mut test = Vec::new();
        for _ in 0..TESTS {
            let mut anywhere = || rng.random_range(-HALF_MM..=HALF_MM);
            let place = Place::new(anywhere(), anywhere());
            let force_n = rng.random_range(test_force_n.0..=test_force_n.1);
            test.push(press(place, force_n, &mut rng));
        }
        Set { family: self.name, seed, calibration, test, layout }
    }
}

/// Results of a method on a set.
struct ChoiceMade {
    solver: String,
    chosen: String,
    errors_mm: Vec<f64>,
    flagged: f64,
    within: [f64; 2],
}

impl ChoiceMade {
    fn mean_mm(&self) -> f64 {
        self.errors_mm.iter().sum::<f64>() / self.errors_mm.len() as f64
    }

    /// Mean error of every second test press, from the first or from the second one on.
    fn half_mm(&self, first: usize) -> f64 {
        let half: Vec<f64> = self.errors_mm.iter().skip(first).step_by(2).copied().collect();
        half.iter().sum::<f64>() / half.len() as f64
    }
}

impl Set {
    fn solve(&self) -> Vec<ChoiceMade> {
        let points: Vec<CalibrationPoint<'_>> = self
            .calibration
            .iter()
            .map(|press| CalibrationPoint { place: press.place, force_n: press.force_n, outputs: &press.outputs })
            .collect();
        let calibration = Calibration::new(&points).expect("a calibration");
        let prepared =
            PreparedCalibration::new(calibration, &Setting::of_layout(Some(&self.layout))).expect("a sound one");
        let mut made = Vec::new();
        for solver in [&[BEST], &SOLVERS[..]].concat() {
            let Ok(fitted) = prepared.fit(solver) else { continue };
            let mut workspace = Workspace::default();
            let mut one = ChoiceMade {
                solver: solver.to_owned(),
                chosen: fitted.name().to_owned(),
                errors_mm: Vec::new(),
                flagged: 0.0,
                within: [0.0; 2],
            };
            for press in &self.test {
                let Ok(solution) = fitted.solve(&press.outputs, &mut workspace) else { continue };
                let off_mm = solution.place.distance_mm(press.place);
                one.errors_mm.push(off_mm);
                let each = 1.0 / self.test.len() as f64;
                one.flagged += if solution.verdict == ContactVerdict::Ok { 0.0 } else { each };
                if let Some(half) = solution.half_widths {
                    one.within[0] += if off_mm <= half.half68_mm { each } else { 0.0 };
                    one.within[1] += if off_mm <= half.half95_mm { each } else { 0.0 };
                }
            }
            made.push(one);
        }
        made
    }

    pub(crate) fn save(&self, folder: &Path) {
        let folder = folder.join(format!("{}-{}", self.family.replace(' ', "-"), self.seed));
        fs::create_dir_all(&folder).expect("a folder");
        for (name, presses) in [("calibration.csv", &self.calibration), ("test.csv", &self.test)] {
            let columns: Vec<String> = (1..=presses[0].outputs.len()).map(|unit| format!("out_{unit}")).collect();
            let mut text = format!("x_mm,y_mm,force_n,{}\n", columns.join(","));
            for ChoicePress { place, force_n, outputs } in presses {
                let outputs: Vec<String> = outputs.iter().map(f64::to_string).collect();
                let _ = writeln!(text, "{},{},{force_n},{}", place.x_mm, place.y_mm, outputs.join(","));
            }
            fs::write(folder.join(name), text).expect("a table");
        }
    }
}

/// Loss of `best` compared with the method that is best on the other half of the test, mean of both halves.
fn loss(made: &[ChoiceMade]) -> f64 {
    let best = &made[0];
    let of_half = |chosen_on: usize, scored_on: usize| {
        let oracle = made[1..].iter().min_by(|a, b| a.half_mm(chosen_on).total_cmp(&b.half_mm(chosen_on)));
        best.half_mm(scored_on) / oracle.expect("a method").half_mm(scored_on) - 1.0
    };
    0.5 * (of_half(0, 1) + of_half(1, 0))
}

#[test]
fn best_loses_little_against_the_best_method_of_each_family() {
    let seeds = campaign::size(1, SEEDS) as u64;
    let families = &FAMILIES[..campaign::size(1, FAMILIES.len())];
    let sets: Vec<(Family, u64)> =
        families.iter().flat_map(|family| (0..seeds).map(move |seed| (*family, seed))).collect();
    let save = std::env::var_os("PALPATE_SETS");
    let made = in_parallel(&sets, |(family, seed)| {
        let set = family.set(*seed);
        if let Some(folder) = &save {
            set.save(Path::new(folder));
        }
        set.solve()
    });
    let mut losses = Vec::new();
    for family in families {
        let of_family: Vec<&Vec<ChoiceMade>> =
            sets.iter().zip(&made).filter(|((of, _), _)| of.name == family.name).map(|(_, made)| made).collect();
        let lost: Vec<f64> = of_family.iter().map(|made| loss(made)).collect();
        let mean = lost.iter().sum::<f64>() / lost.len() as f64;
        println!("{}: best loses {:.1} % in the mean", family.name, 100.0 * mean);
        for made in &of_family {
            let best = &made[0];
            let methods: Vec<String> = made[1..]
                .iter()
                .map(|made| format!("{} {:.4} ({:.1}%)", made.solver, made.mean_mm(), 100.0 * made.flagged))
                .collect();
            println!(
                "  best {} {:.4} mm, flagged {:.1} %, within {:.2} {:.2}; {}",
                best.chosen,
                best.mean_mm(),
                100.0 * best.flagged,
                best.within[0],
                best.within[1],
                methods.join(", ")
            );
        }
        losses.push(mean);
    }
    let all = losses.iter().sum::<f64>() / losses.len() as f64;
    println!("all families: best loses {:.2} %", 100.0 * all);
    assert!(all <= LOSS_MOST && losses.iter().all(|loss| *loss <= LOSS_OF_FAMILY_MOST), "{losses:?}");
}

/// The paper's scene T with so many places along a side: the better of `physics` and `surrogate`, and the choice of `best`.
#[test]
fn best_chooses_between_physics_and_surrogate_as_well_as_a_test_does() {
    let seeds: Vec<u64> = (0..campaign::size(1, 20) as u64).collect();
    for (side, most) in [(7, 1.05), (25, 1.02)].into_iter().take(campaign::size(1, 2)) {
        let made = in_parallel(&seeds, |&seed| {
            let layout = ArrayLayout::grid(3, 3, 4.5);
            let mut skin = Skin::new(&palpate_testing::skins::scene_t(), &layout, 2.0, seed);
            let mut rng = stream(seed, 1, "scene T");
            let mut press =
                |place: Place, force_n: f64, rng: &mut RandomStream| pressed(&mut skin, place, force_n, rng);
            let at = |index: usize| -6.0 + 12.0 * index as f64 / (side - 1) as f64;
            let calibration =
                (0..side * side).map(|i| press(Place::new(at(i % side), at(i / side)), 1.0, &mut rng)).collect();
            let test = (0..500)
                .map(|_| {
                    let place = Place::new(rng.random_range(-6.0..=6.0), rng.random_range(-6.0..=6.0));
                    let force_n = rng.random_range(0.1..=1.0);
                    press(place, force_n, &mut rng)
                })
                .collect();
            Set { family: "T", seed, calibration, test, layout }.solve()
        });
        let mean = |solver: &str| {
            let all: Vec<f64> =
                made.iter().map(|made| made.iter().find(|made| made.solver == solver).unwrap().mean_mm()).collect();
            all.iter().sum::<f64>() / all.len() as f64
        };
        let [best, physics, surrogate] = ["best", "physics", "surrogate"].map(mean);
        println!("{side} x {side} places: best {best:.4} mm, physics {physics:.4} mm, surrogate {surrogate:.4} mm");
        assert!(best <= most * physics.min(surrogate), "{best} mm");
    }
}

#[test]
fn fit_reports_what_a_constant_load_would_gain() {
    let bench = TestFolder::new();
    FAMILIES[0].set(0).save(&bench.path("."));
    let table = bench.read("gains-0/calibration.csv");
    let without_force = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        [&cells[..2], &cells[3..]].concat().join(",") + "\n"
    };
    bench.write("relative.csv", &table.lines().map(without_force).collect::<String>());
    let reported = |table: &str| {
        let printed = bench.palpate_ends(0, &format!("fit {table} --solver surrogate --out s.palpate")).running();
        printed.contains("--constant-load lowers the error on held-out presses from")
    };
    assert!(reported("relative.csv"), "one load, and the amplitude shows the place");
    assert!(!reported("gains-0/calibration.csv"), "forces are known");
}
