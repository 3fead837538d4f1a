//! Forces on a bench with disturbances: drift of the zero, slow drift, mains interference, and all at once. (a) is the true force minus the
//! set force in the window, (b) the true force minus the recorded one. The true force is that of the scene.
//!
//! The full tier makes one calibration of 121 presses with each disturbance; `PALPATE_TESTS=5` makes five of 625.

use palpate_core::quantity::Axis;
use palpate_data::dataset::Record;
use palpate_data::recipe::Phase;
use palpate_run::rig::RigSpec;
use palpate_sim::scene::{LoadCellScene, Servo, Sine};
use palpate_testing::campaign;
use palpate_testing::executions::{BENCHES, ExecutedRun, bench, bench_recipe, benches, executed, in_parallel, plan};

/// Largest increase of (a) over the nominal bench at 95 %, and largest (b), N.
const WORSE_N: f64 = 0.0006;
const RECORDED_N: f64 = 0.0012;
/// Largest increase of (a), N, with a drift of 300 mN in one run, 2 to 3 mN in each press. It was 1.6 mN.
const DRIFTED_WORSE_N: f64 = 0.002;
/// (a) with all disturbances, and largest excess of a peak over the set force, N. They were 2.7 and 6.6 mN with one seed.
const ALL_N: f64 = 0.0035;
const ALL_PEAK_N: f64 = 0.009;

/// A disturbance by its name.
pub(crate) type Ill = (&'static str, fn(&mut RigSpec));

pub(crate) const ILLS: [Ill; 5] = [
    ("drift of 30 mN/min", |spec| cell(spec).drift_n_s = 0.030 / 60.0),
    ("wander of 5 mN in 25 s", |spec| cell(spec).slow_drift = Some(Sine { amplitude: 0.005, period_s: 25.0 })),
    ("mains interference of 10 mN, 49.8 Hz", |spec| {
        cell(spec).mains = Some(Sine { amplitude: 0.010, period_s: 1.0 / 49.8 })
    }),
    ("mains interference of 10 mN, 50.2 Hz", |spec| {
        cell(spec).mains = Some(Sine { amplitude: 0.010, period_s: 1.0 / 50.2 })
    }),
    ("mains interference of 10 mN, 60.1 Hz", |spec| {
        cell(spec).mains = Some(Sine { amplitude: 0.010, period_s: 1.0 / 60.1 })
    }),
];

fn cell(spec: &mut RigSpec) -> &mut LoadCellScene {
    spec.scene.load_cell.as_mut().expect("a load cell")
}

/// All at once, with a slow controller, backlash, a soft mounting and a creeping surface.
pub(crate) fn all(spec: &mut RigSpec) {
    let cell = cell(spec);
    cell.mains = Some(Sine { amplitude: 0.010, period_s: 1.0 / 50.0 });
    cell.slow_drift = Some(Sine { amplitude: 0.005, period_s: 25.0 });
    cell.stiffness_n_mm = Some(10.0);
    spec.scene.latencies.stage_s = (0.015, 0.045);
    spec.scene.surface_wave = Some(Sine { amplitude: 0.005, period_s: 60.0 });
    spec.scene.stage = Some(Servo { backlash_mm: 0.003, ..spec.scene.stage.unwrap_or_default() });
}

/// Results of the presses of some seeds, N.
struct BenchIllFigures {
    set_p95_n: f64,
    recorded_p95_n: f64,
    peak_n: f64,
}

fn figures(name: &'static str, output: &str, ill: impl Fn(&mut RigSpec)) -> BenchIllFigures {
    let seeds = campaign::size(1, 1) as u64;
    let recipe = bench_recipe(seeds);
    let mut spec = bench(name);
    ill(&mut spec);
    let seeds: Vec<u64> = (1..=seeds).collect();
    let executions = in_parallel(&seeds, |seed| {
        let executed = executed(&spec, &plan(&spec, &recipe, *seed));
        assert!(executed.ending.halt.is_none(), "{name}, {output}: {:?}", executed.ending.text());
        executed
    });
    figures_of(name, output, &executions)
}

fn figures_of(name: &str, output: &str, executions: &[ExecutedRun]) -> BenchIllFigures {
    let contacts = executions.iter().flat_map(|executed| executed.ledger.contacts());
    let (mut set, mut recorded, mut peak_n) = (Vec::new(), Vec::new(), f64::NEG_INFINITY);
    for contact in contacts.filter(|contact| contact.levels[0].is_of(Phase::Calibration)) {
        let (press, truth) = (&contact.levels[0], &contact.truth[0]);
        set.push((truth.force_true_n - press.force_set_n.unwrap()).abs());
        recorded.push((truth.force_true_n - press.force_n.unwrap()).abs());
        peak_n = peak_n.max(truth.force_peak_n - press.force_set_n.unwrap());
    }
    let p95 = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[(values.len() as f64 * 0.95).ceil() as usize - 1]
    };
    let found = BenchIllFigures { set_p95_n: p95(&mut set), recorded_p95_n: p95(&mut recorded), peak_n };
    println!(
        "{name}, {output}: {} presses, true less set {:.2} mN (95 %), true less recorded {:.2} mN (95 %), peak {:+.1} mN",
        set.len(),
        1e3 * found.set_p95_n,
        1e3 * found.recorded_p95_n,
        1e3 * found.peak_n
    );
    found
}

#[test]
fn drift_slow_drift_and_mains_are_counted() {
    for (name, _) in benches() {
        let nominal = figures(name, "nominal", |_| {});
        assert!(nominal.recorded_p95_n <= RECORDED_N, "{name}: {} N", nominal.recorded_p95_n);
        for (output, ill) in ILLS {
            let found = figures(name, output, ill);
            assert!(found.set_p95_n <= nominal.set_p95_n + WORSE_N, "{name}, {output}: {} N", found.set_p95_n);
            assert!(found.recorded_p95_n <= RECORDED_N, "{name}, {output}: {} N", found.recorded_p95_n);
        }
    }
}

#[test]
fn all_disturbances_at_once_keep_the_bounds() {
    // the benches differ only in the latency of the stage, which is a disturbance here
    let (name, _) = BENCHES[0];
    let found = figures(name, "all at once", all);
    assert!(found.set_p95_n <= ALL_N, "{} N", found.set_p95_n);
    assert!(found.recorded_p95_n <= RECORDED_N, "{} N", found.recorded_p95_n);
    assert!(found.peak_n <= ALL_PEAK_N, "{} N", found.peak_n);
}

/// A drift of 0.3 N in all: the run takes new zeros, doesn't end, and its forces are right.
#[test]
fn run_continues_through_a_drift_of_300_mn() {
    let recipe = bench_recipe(1);
    for (name, _) in benches() {
        for drift_n in [0.3, -0.3] {
            let mut spec = bench(name);
            let nominal = [executed(&spec, &plan(&spec, &recipe, 1))];
            cell(&mut spec).drift_n_s = drift_n / nominal[0].ending.t_s;
            let drifted = [executed(&spec, &plan(&spec, &recipe, 1))];
            let ExecutedRun { ending, ledger, .. } = &drifted[0];
            assert!(ending.halt.is_none(), "{name}, {drift_n} N: {:?}", ending.text());
            let is_zero = |record: &&Record| matches!(record, Record::Zero { .. });
            let zeros = ledger.records().iter().filter(is_zero).count();
            assert!(zeros >= 3, "{name}, {drift_n} N: {zeros} zeros");
            let [nominal, found] =
                [&nominal, &drifted].map(|executions| figures_of(name, &format!("{drift_n} N in all"), executions));
            assert!(
                found.set_p95_n <= nominal.set_p95_n + DRIFTED_WORSE_N,
                "{name}, {drift_n} N: {} N",
                found.set_p95_n
            );
            assert!(found.recorded_p95_n <= RECORDED_N, "{name}, {drift_n} N: {} N", found.recorded_p95_n);
        }
    }
}

/// Height of home over the surface, mm: the first descent takes half a minute, in which the zero changes by 15 mN.
const HOME_MM: f64 = 12.5;

#[test]
fn zero_drift_during_the_first_descent_is_not_a_touch() {
    let recipe = "name = \"one\"\n[[step]]\nphase = \"calibration\"\nlist = { places_mm = [[0.0, 0.0], [1.0, 0.0]] }\nforce_n = 1.0\n";
    let ills: [Ill; 4] = [
        ("+30 mN/min", |spec| cell(spec).drift_n_s = 0.030 / 60.0),
        ("-30 mN/min", |spec| cell(spec).drift_n_s = -0.030 / 60.0),
        ("+50 mN/min", |spec| cell(spec).drift_n_s = 0.050 / 60.0),
        ("5 mN in 25 s", |spec| cell(spec).slow_drift = Some(Sine { amplitude: 0.005, period_s: 25.0 })),
    ];
    for (name, _) in benches() {
        for (output, ill) in ills {
            let mut spec = bench(name);
            spec.stage.travel.axes[Axis::Z.index()].max = HOME_MM;
            ill(&mut spec);
            for seed in 1..=5 {
                let ExecutedRun { ending, ledger, .. } = &executed(&spec, &plan(&spec, recipe, seed));
                assert!(ending.halt.is_none(), "{name}, {output}, seed {seed}: {:?}", ending.text());
                for contact in ledger.contacts() {
                    let off_n = contact.truth[0].force_true_n - contact.levels[0].force_n.unwrap();
                    assert!(off_n.abs() <= 0.003, "{name}, {output}, seed {seed}: {off_n} N");
                }
            }
        }
    }
}
