//! A link that is slower than its load cell, a slow load cell, and a slow stage: a sound rig completes its run.

use super::families::{ARM, ESP301, GRBL, KLIPPER, MARLIN, PROGRAM, XPS, rig_of, shipped_rig};
use palpate_control::Strategy;
use palpate_core::quantity::{Axis, Place};
use palpate_run::rig::RigSpec;
use palpate_testing::executions::{BENCHES, bench, executed, in_parallel, must_be_none, plan};
use palpate_testing::{campaign, exchanged, shipped_text};

/// Presses of a run: quick, and full.
const PRESSES: (usize, usize) = (6, 25);

/// Latencies of the load cell's link, least and most, ms: from a quick link to one slower than any shipped profile (2400 baud: 85 ms).
const LATENCIES_MS: [[f64; 2]; 14] = [
    [60.0, 60.0],
    [2.0, 60.0],
    [2.0, 2.0],
    [10.0, 10.0],
    [36.0, 36.0],
    [45.0, 45.0],
    [100.0, 100.0],
    [200.0, 200.0],
    [10.0, 70.0],
    [36.0, 96.0],
    [45.0, 105.0],
    [60.0, 120.0],
    [100.0, 160.0],
    [140.0, 200.0],
];

/// Rates of load cells, as transmitters and the HX711 have them, conversions/s.
const RATES_HZ: [f64; 4] = [5.0, 10.0, 20.0, 80.0];

/// Largest speeds of stages, mm/s.
const SPEEDS_MM_S: [f64; 2] = [1.0, 0.2];

/// Seeds of a condition in the full tier.
const SEEDS: u64 = 5;

/// The strategies of a campaign that a rig accepts.
fn strategies(spec: &RigSpec) -> Vec<Strategy> {
    let all = Strategy::ALL.into_iter().step_by(campaign::every(Strategy::ALL.len(), 1));
    let finishes = spec.stage.driver.abilities().finishes();
    all.filter(|strategy| !finishes || *strategy != Strategy::Velocity).collect()
}

/// Runs some presses at random places, or at given ones, and returns what isn't complete.
fn incomplete(name: &str, spec: &RigSpec, strategy: Strategy, seed: u64, places: Option<[Place; 2]>) -> Option<String> {
    let step = match places {
        Some([from, to]) => {
            let places = [from, to].map(|place| format!("[{}, {}]", place.x_mm, place.y_mm)).join(", ");
            format!("list = {{ places_mm = [{places}] }}\nforce_n = 1.0\n")
        }
        None => format!(
            "random = {{ count = {}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0], force_n = [0.3, 1.0] }}\n",
            campaign::size(PRESSES.0, PRESSES.1)
        ),
    };
    let text = format!(
        "name = \"slow\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.1\nstrategy = \"{}\"\n[[step]]\nphase = \"calibration\"\n{step}",
        strategy.name()
    );
    let plan = plan(spec, &text, seed);
    let run = executed(spec, &plan);
    let is_sound = run.ending.text().is_none() && run.truth.force_n <= spec.limits.force_n;
    (!is_sound).then(|| {
        let rows = run.ledger.contacts().count();
        format!(
            "{name}, {strategy:?}, seed {seed}, after {rows} presses: {:.3} N, {:?}",
            run.truth.force_n,
            run.ending.text()
        )
    })
}

/// Tries each condition with each strategy and seed.
fn must_complete<T: Copy + Sync>(conditions: &[T], spec_of: impl Fn(T) -> (String, RigSpec) + Sync) {
    let seeds = 1..=campaign::size(1, SEEDS as usize) as u64;
    let tasks: Vec<(T, Strategy, u64)> = conditions
        .iter()
        .flat_map(|condition| {
            strategies(&spec_of(*condition).1).into_iter().map(move |strategy| (*condition, strategy))
        })
        .flat_map(|(condition, strategy)| seeds.clone().map(move |seed| (condition, strategy, seed)))
        .collect();
    let ends = in_parallel(&tasks, |&(condition, strategy, seed)| {
        let (name, spec) = spec_of(condition);
        incomplete(&name, &spec, strategy, seed, None)
    });
    println!("{} runs", ends.len());
    must_be_none(&ends.into_iter().flatten().collect::<Vec<_>>());
}

#[test]
fn a_run_completes_on_any_link_that_its_load_cell_is_quicker_than() {
    let latencies = &LATENCIES_MS[..campaign::size(2, LATENCIES_MS.len())];
    must_complete(latencies, |latency_ms| {
        let mut spec = bench(BENCHES[0].0);
        spec.scene.latencies.load_cell_s = (latency_ms[0] / 1000.0, latency_ms[1] / 1000.0);
        (format!("{latency_ms:?} ms"), spec)
    });
}

#[test]
fn a_run_completes_with_a_slow_load_cell() {
    let rates = &RATES_HZ[..campaign::size(1, RATES_HZ.len())];
    must_complete(rates, |hz| {
        let mut spec = shipped_rig("rigs/sim.toml");
        spec.load_cell.conversions_hz = hz;
        (format!("{hz} Hz"), spec)
    });
}

/// A cell on a serial line: its rig, its line as the rig has it, and the line's rates with the largest conversion rate that each carries.
type OnLine = (&'static str, &'static str, [(u32, f64); 3]);

/// A transmitter that is polled may be slower than its line or quicker. A board sends 7 to 9 bytes for each conversion.
const ON_LINES: [OnLine; 2] = [
    (ESP301.rig, "ttyUSB1?baud=115200", [(2400, 200.0), (9600, 200.0), (115_200, 200.0)]),
    (MARLIN.rig, "ttyACM0?baud=115200", [(2400, 10.0), (9600, 80.0), (115_200, 80.0)]),
];

#[test]
fn a_run_completes_at_any_rate_of_a_serial_line() {
    let on_lines: Vec<(OnLine, u32, f64)> = ON_LINES
        .into_iter()
        .flat_map(|cell| cell.2.map(|(baud, most_hz)| (cell, baud, most_hz)))
        .step_by(campaign::every(5, 1))
        .collect();
    must_complete(&on_lines, |((rig, line, _), baud, most_hz)| {
        let slower = line.replace("115200", &baud.to_string());
        let mut spec = rig_of(rig, &exchanged(&shipped_text(rig), line, &slower));
        spec.load_cell.conversions_hz = most_hz;
        (format!("{rig} at {baud} baud"), spec)
    });
}

/// One shipped rig of each family of stages. In the quick tier the first one.
const RIGS: [&str; 7] = [ESP301.rig, GRBL.rig, MARLIN.rig, KLIPPER.rig, ARM.rig, XPS.rig, PROGRAM.rig];

#[test]
fn a_run_completes_on_a_slow_stage() {
    let rigs = &RIGS[..campaign::size(1, RIGS.len())];
    let speeds = &SPEEDS_MM_S[..campaign::size(1, SPEEDS_MM_S.len())];
    let tasks: Vec<(&str, f64)> = rigs.iter().flat_map(|rig| speeds.iter().map(|speed| (*rig, *speed))).collect();
    // more than 10 s, the margin of a motion
    let places = [Place::new(-6.0, -6.0), Place::new(6.0, 6.0)];
    let ends = in_parallel(&tasks, |&(name, speed_mm_s)| {
        let mut spec = shipped_rig(name);
        spec.stage.speed_mm_s = speed_mm_s;
        spec.stage.approach_mm_s = spec.stage.approach_mm_s.min(speed_mm_s);
        incomplete(&format!("{name} at {speed_mm_s} mm/s"), &spec, Strategy::Guarded, 1, Some(places))
    });
    must_be_none(&ends.into_iter().flatten().collect::<Vec<_>>());
}

#[test]
fn a_run_completes_on_a_long_way() {
    let mut spec = shipped_rig(GRBL.rig);
    let travel = &mut spec.stage.travel.axes[Axis::X.index()];
    travel.min = travel.max - 150.0;
    spec.frame.origin.x_mm = (travel.min + travel.max) / 2.0;
    let places = [Place::new(-60.0, 0.0), Place::new(60.0, 0.0)];
    must_be_none(&incomplete("120 mm", &spec, Strategy::Guarded, 1, Some(places)).into_iter().collect::<Vec<_>>());
}
