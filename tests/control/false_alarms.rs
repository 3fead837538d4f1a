//! Sound calibrations don't come near the limits of the rules that compare a press with the presses around it: with disturbances, with soft
//! or stiff free edges, and without presses nearby.
//!
//! The fractions of the limits come from the ledger: its contacts go through a new map and a new response, as in a run.

use crate::bench_ills::{ILLS, all};
use palpate_control::{
    ContactMap, LearnedContact, LearnedCurve, LearnedOutputs, MeasuredContact, NO_LOAD_READINGS, Strategy, Zero,
};
use palpate_core::quantity::{Place, RandomStream, stream};
use palpate_data::dataset::{Flag, Memory, Record, RecordedContact};
use palpate_run::rig::RigSpec;
use palpate_sim::scene::Edges;
use palpate_testing::campaign;
use palpate_testing::executions::{BENCHES, ExecutedRun, bench_with_taxels, executed, in_parallel, must_be_none, plan};
use rand::RngExt;
use rand::seq::SliceRandom;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Calibrations of the quick and the full tier.
const CALIBRATIONS: (usize, usize) = (3, 60);

/// Largest fraction of a limit for a sound press.
const SHARE_MOST: f64 = 0.8;

/// The shipped recipe's grid, coarser in the quick tier.
const RECIPE: &str = include_str!("../../recipes/bench.toml");
const COARSER: (&str, &str) = ("spacing_mm = 0.5", "spacing_mm = 4.0");
const PAPER: &str = include_str!("../../recipes/paper.toml");

/// A force near the limit, N.
const NEAR_LIMIT_N: f64 = 1.8;

/// Distance between places that are far apart, mm, and largest displacement of each from its grid point.
const APART_MM: f64 = 4.0;
const JITTER_MM: f64 = 1.0;

/// Change of the stiffness at a free edge, %; position of the edges, and their width, mm.
const EDGE_PERCENT: f64 = 40.0;
const EDGE_HALF_MM: (f64, f64) = (6.0, 7.0);
const EDGE_WIDTH_MM: (f64, f64) = (1.5, 4.0);

/// Declaration of a specimen with such edges: its largest stiffness, N/mm, or its depth, mm.
const STIFF_N_MM: f64 = 2.8;
const SOFT_DEPTH_MM: f64 = 3.2;

/// The fraction 0.25 of a limit as a logarithm: the least that the rules allow. And the fraction of the softest press around, before a
/// prediction counts.
const LEAST: f64 = 0.25;
const SOFTEST_SHARE: f64 = 0.55;
const WAY_MM: f64 = 0.010;

/// What is pressed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum FalseAlarmPressed {
    Map,
    MapInterleaved,
    Guarded,
    Velocity,
    NearLimit,
    FarApart,
    Few,
    Points,
    Paper,
}

/// In this order, repeatedly: most are whole calibrations.
const PRESSED: [FalseAlarmPressed; 12] = [
    FalseAlarmPressed::Map,
    FalseAlarmPressed::Guarded,
    FalseAlarmPressed::FarApart,
    FalseAlarmPressed::MapInterleaved,
    FalseAlarmPressed::Velocity,
    FalseAlarmPressed::Few,
    FalseAlarmPressed::Points,
    FalseAlarmPressed::Map,
    FalseAlarmPressed::NearLimit,
    FalseAlarmPressed::MapInterleaved,
    FalseAlarmPressed::Paper,
    FalseAlarmPressed::Guarded,
];

/// One calibration.
struct FalseAlarmCalibration {
    seed: u64,
    pressed: FalseAlarmPressed,
    text: String,
    spec: RigSpec,
    recipe: String,
}

impl FalseAlarmCalibration {
    fn new(nth: usize) -> FalseAlarmCalibration {
        let (seed, pressed) = (nth as u64 + 1, PRESSED[nth % PRESSED.len()]);
        let mut rng = stream(seed, 0, "false alarms");
        let (bench, _) = BENCHES[rng.random_range(0..BENCHES.len())];
        let mut spec = bench_with_taxels(bench);
        let has_edges = (nth + nth / PRESSED.len()).is_multiple_of(2);
        let with = if has_edges { give_edges(&mut spec, &mut rng) } else { give_an_ill(&mut spec, pressed, &mut rng) };
        if pressed == FalseAlarmPressed::NearLimit {
            spec.limits.depth_mm = SOFT_DEPTH_MM; // where the support of the tip gives way it goes deeper
        }
        let recipe = recipe(pressed, &mut rng);
        let output = format!("calibration {seed}: {bench}, {pressed:?}, {with}");
        FalseAlarmCalibration { seed, pressed, text: output, spec, recipe }
    }

    fn executed(&self) -> FalseAlarmOutcome {
        let ExecutedRun { ending, ledger, .. } = executed(&self.spec, &plan(&self.spec, &self.recipe, self.seed));
        let presses = ledger.contacts().count();
        let alarm = ending.text().map(|why| format!("{}, after {presses} presses: {why}", self.text));
        FalseAlarmOutcome { presses, alarm, shares: shares(&self.spec, &ledger) }
    }
}

/// Result of a calibration.
struct FalseAlarmOutcome {
    presses: usize,
    alarm: Option<String>,
    shares: BTreeMap<&'static str, Share>,
}

/// Largest fraction of a rule's limit, its press, and the number of compared presses.
#[derive(Clone, Copy, Default)]
struct Share {
    largest: f64,
    press: u64,
    compared: usize,
}

fn give_edges(spec: &mut RigSpec, rng: &mut RandomStream) -> String {
    let percent = if rng.random_bool(0.5) { EDGE_PERCENT } else { -EDGE_PERCENT };
    let half_mm = rng.random_range(EDGE_HALF_MM.0..EDGE_HALF_MM.1);
    let width_mm = rng.random_range(EDGE_WIDTH_MM.0..EDGE_WIDTH_MM.1);
    spec.scene.edges = Some(Edges { percent, half_mm, width_mm });
    if percent > 0.0 {
        spec.limits.stiffness_n_mm = STIFF_N_MM
    } else {
        spec.limits.depth_mm = SOFT_DEPTH_MM
    }
    format!("edges of {percent:+} % at {half_mm:.2} mm, {width_mm:.2} mm wide")
}

fn give_an_ill(spec: &mut RigSpec, pressed: FalseAlarmPressed, rng: &mut RandomStream) -> String {
    // the first one is a drift: in the hours of the paper's protocol it leaves the range of the cell
    let first = usize::from(pressed == FalseAlarmPressed::Paper);
    match ILLS.get(rng.random_range(first..ILLS.len() + 2)) {
        Some((output, ill)) => {
            ill(spec);
            (*output).to_owned()
        }
        None => {
            all(spec);
            "all ills at once".to_owned()
        }
    }
}

fn recipe(pressed: FalseAlarmPressed, rng: &mut RandomStream) -> String {
    let head = RECIPE.split("[[step]]").next().expect("what is before the steps");
    let strategy = |strategy: Strategy, text: &str| {
        text.replacen("strategy = \"map\"", &format!("strategy = \"{}\"", strategy.name()), 1)
    };
    let one_of_them = Strategy::ALL[rng.random_range(0..Strategy::ALL.len())];
    let thinned =
        |text: &str| if campaign::is_quick() { text.replacen(COARSER.0, COARSER.1, 1) } else { text.to_owned() };
    let places = |places: &[Place]| {
        let mut list = String::new();
        places.iter().for_each(|at| write!(list, "[{:.3}, {:.3}], ", at.x_mm, at.y_mm).expect("a string"));
        strategy(one_of_them, head)
            + &format!("[[step]]\nphase = \"calibration\"\nlist = {{ places_mm = [{list}] }}\nforce_n = 1.0\n")
    };
    match pressed {
        FalseAlarmPressed::Map => thinned(RECIPE),
        FalseAlarmPressed::MapInterleaved => {
            thinned(&RECIPE.replacen(COARSER.0, &format!("{}, order = \"interleaved\"", COARSER.0), 1))
        }
        FalseAlarmPressed::Guarded => thinned(&strategy(Strategy::Guarded, RECIPE)),
        FalseAlarmPressed::Velocity => thinned(&strategy(Strategy::Velocity, RECIPE)),
        FalseAlarmPressed::NearLimit => thinned(&strategy(
            one_of_them,
            &RECIPE.replacen("force_n = 1.0", &format!("force_n = {NEAR_LIMIT_N:?}"), 1),
        )),
        FalseAlarmPressed::FarApart => places(&far_apart(rng)),
        FalseAlarmPressed::Few => {
            let count = rng.random_range(2..12);
            let mut place = || rng.random_range(-6.0..6.0);
            places(&(0..count).map(|_| Place::new(place(), place())).collect::<Vec<_>>())
        }
        FalseAlarmPressed::Points => {
            let count = if campaign::is_quick() { 20 } else { 100 };
            let random =
                format!("random = {{ count = {count}, x_mm = [-6.0, 6.0], y_mm = [-6.0, 6.0], force_n = [0.1, 1.0] }}");
            strategy(one_of_them, head) + &format!("[[step]]\nphase = \"test\"\n{random}\n")
        }
        FalseAlarmPressed::Paper if campaign::is_quick() => {
            thinned(PAPER).replacen("units = \"all\"", "units = [5]", 1).replacen("count = 100", "count = 10", 1)
        }
        FalseAlarmPressed::Paper => PAPER.to_owned(),
    }
}

/// Places of a coarse grid in random order, each displaced from its grid point.
fn far_apart(rng: &mut RandomStream) -> Vec<Place> {
    let mut places = Vec::new();
    for (column, row) in (0..16).map(|i| (f64::from(i % 4), f64::from(i / 4))) {
        let mut at = |n: f64| APART_MM * (n - 1.5) + rng.random_range(-JITTER_MM..JITTER_MM);
        places.push(Place::new(at(column).clamp(-6.0, 6.0), at(row).clamp(-6.0, 6.0)));
    }
    places.shuffle(rng);
    places
}

/// Largest fraction of each rule's limit in the presses of a ledger.
fn shares(spec: &RigSpec, ledger: &Memory) -> BTreeMap<&'static str, Share> {
    let (mut map, mut response) = (
        ContactMap::new(spec.frame.uncertainty_mm),
        LearnedOutputs::new(spec.array.layout.pitch_mm(), spec.limits.force_n),
    );
    let (mut all, mut cell_n) = (BTreeMap::<_, Share>::new(), 0.0);
    for record in ledger.records() {
        if let Record::Zero { sigma_n, .. } = record {
            cell_n = Zero::with_noise(*sigma_n).sigma_mean_n(NO_LOAD_READINGS);
        }
        let mut take = |rule, press: u64, share: f64| {
            let entry = all.entry(rule).or_default();
            entry.compared += 1;
            if share > entry.largest || share.is_nan() {
                (entry.largest, entry.press) = (share, press);
            }
        };
        if let Record::Check(check) = record {
            let parts =
                [("check, outputs", check.outputs), ("check, pattern", check.pattern), ("check, depth", check.depth)];
            for (rule, change) in parts.into_iter().filter_map(|(rule, change)| Some((rule, change?))) {
                take(rule, check.reference, change.by.abs() / change.limit);
            }
        }
        let Some(contact) = record.contact() else { continue };
        let mut take = |rule, share: f64| take(rule, contact.press, share);
        if let Some(felt) = felt(contact, cell_n) {
            response.share(&felt).into_iter().for_each(|share| take("outputs-differ", share));
            response.learn(felt);
        }
        let Some(learned_contact) = &contact.learned_contact else { continue };
        if let Some((place, from_n, to_n, way_mm)) = rise(learned_contact, &map)
            && let Some(learned_curve) = map.learned_curve(place)
        {
            let softer = softer(&learned_curve, from_n, to_n, way_mm);
            match learned_curve.share(from_n, to_n, way_mm) {
                None => take("softer-than-taught, before ten", softer),
                Some(share) if is_softer(&learned_curve, from_n, to_n, way_mm) => {
                    take("softer-than-taught", share.max(softer));
                }
                Some(share) => take("stiffer-than-taught", share),
            }
        }
        map.learn(learned_contact);
    }
    all
}

/// Outputs of a press, as a run compares them.
fn felt(contact: &RecordedContact, cell_n: f64) -> Option<MeasuredContact> {
    let level = contact.levels.iter().find(|level| level.force_set_n.is_some_and(|force_n| force_n > 0.0))?;
    let is_measured = !level.flags.iter().any(|flag| matches!(flag, Flag::Saturated | Flag::Stale));
    let force_n = level.force_n.filter(|force_n| *force_n > 0.0 && is_measured)?;
    let place = Place::new(level.x_mm, level.y_mm);
    Some(MeasuredContact { place, force_n, outputs: level.outputs.clone(), sigmas: [0.0, cell_n] })
}

/// Rise of the force in a press: its place, the two forces, N, and the distance between them, mm.
fn rise(learned_contact: &LearnedContact, map: &ContactMap) -> Option<(Place, f64, f64, f64)> {
    match learned_contact {
        LearnedContact::Touch { place, path, .. } => {
            let (&(from_mm, from_n), &(to_mm, to_n)) = (path.first()?, path.last()?);
            (to_mm > from_mm && to_n > from_n).then_some((*place, from_n, to_n, to_mm - from_mm))
        }
        LearnedContact::Shot { place, z_mm, force_n, .. } => {
            Some((*place, 0.0, *force_n, z_mm - map.expect(*place).z_mm))
        }
    }
}

/// The distance as a fraction of its limit, which is that of a prediction or of the softest press around.
fn softer(learned_curve: &LearnedCurve, from_n: f64, to_n: f64, way_mm: f64) -> f64 {
    let most_mm = learned_curve.longest_mm(from_n, to_n) - WAY_MM;
    match learned_curve.share(from_n, to_n, way_mm) {
        Some(_) => 1.0 + (way_mm / most_mm).ln() / LEAST,
        None => 1.0 + (way_mm / most_mm).ln() / (1.0 / SOFTEST_SHARE).ln(),
    }
}

/// Whether the distance is longer than predicted.
fn is_softer(learned_curve: &LearnedCurve, from_n: f64, to_n: f64, way_mm: f64) -> bool {
    learned_curve.share(from_n, to_n, 1.0001 * way_mm) > learned_curve.share(from_n, to_n, way_mm)
}

#[test]
fn sound_calibration_stays_far_from_every_alarm() {
    let calibrations: Vec<FalseAlarmCalibration> =
        (0..campaign::size(CALIBRATIONS.0, CALIBRATIONS.1)).map(FalseAlarmCalibration::new).collect();
    let outcomes = in_parallel(&calibrations, FalseAlarmCalibration::executed);
    let mut broken: Vec<String> = outcomes.iter().filter_map(|outcome| outcome.alarm.clone()).collect();
    let mut tables: BTreeMap<&str, (Share, &str)> = BTreeMap::new();
    for (calibration, outcome) in calibrations.iter().zip(&outcomes) {
        for (rule, share) in &outcome.shares {
            let (largest, output) = tables.entry(rule).or_default();
            let compared = largest.compared + share.compared;
            if share.largest >= largest.largest {
                (*largest, *output) = (*share, &calibration.text);
            }
            largest.compared = compared;
            let is_far = share.largest <= SHARE_MOST;
            if !is_far {
                let Share { largest, press, .. } = share;
                broken.push(format!("{}: {rule}: {largest:.2} of the limit, press {press}", calibration.text));
            }
        }
    }
    let presses: usize = outcomes.iter().map(|outcome| outcome.presses).sum();
    let alarms = outcomes.iter().filter(|outcome| outcome.alarm.is_some()).count();
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    calibrations.iter().for_each(|c| *kinds.entry(format!("{:?}", c.pressed)).or_default() += 1);
    println!("{} calibrations, {presses} presses, {alarms} alarms: {kinds:?}", calibrations.len());
    for (rule, (Share { largest, press, compared }, output)) in &tables {
        println!("{rule}: at most {largest:.2} of the limit in {compared}, press {press} of {output}");
    }
    must_be_none(&broken);
}
