//! A random sound rig, and a plan of presses for it.

use crate::families::{ARM, ESP301, GRBL, KLIPPER, MARLIN, PROGRAM, XPS};
use palpate_control::Strategy;
use palpate_core::quantity::{Axis, RandomStream, Steps, stream};
use palpate_data::recipe::{self, Plan};
use palpate_run::rig::{self, RigSpec};
use palpate_sim::scene::{ContactLaw, LoadCellScene};
use palpate_testing::{campaign, shipped_text};
use rand::RngExt;
use std::fmt;

/// Presses of a calibration, quick and full.
const PRESSES: (usize, usize) = (6, 25);

/// Stages: shipped rig, and whether it is a program that finishes its motions.
const STAGES: [(&str, bool); 8] = [
    (ESP301.rig, false),
    (GRBL.rig, false),
    (MARLIN.rig, false),
    (KLIPPER.rig, false),
    (ARM.rig, false),
    (XPS.rig, false),
    (PROGRAM.rig, false),
    (PROGRAM.rig, true),
];

/// Cells: the text of their section before the rate, and the largest rate that their line carries, conversions/s.
pub(super) const CELLS: [(&str, f64); 6] = [
    ("driver = { modbus = \"generic-rs485\" }\nlink = \"serial:///dev/ttyUSB7?baud=115200\"", 1000.0),
    ("driver = { modbus = \"generic-rs485\" }\nlink = \"serial:///dev/ttyUSB7?baud=9600\"", 1000.0),
    (
        "driver = { lines = \"hx711\", newton_per_unit = GAIN, offset = 84000.0 }\nlink = \"serial:///dev/ttyACM7?baud=115200\"",
        1000.0,
    ),
    (
        "driver = { lines = \"hx711\", newton_per_unit = GAIN, offset = 84000.0 }\nlink = \"serial:///dev/ttyACM7?baud=9600\"",
        80.0,
    ),
    ("driver = { process = [\"python3\", \"examples/load_cell.py\"] }", 1000.0),
    (
        "driver = { lines = \"ati-netft\" }\nlink = \"udp://192.168.1.1:49152\"\naxes = { x = \"x\", y = \"-y\", press = \"-z\" }",
        1000.0,
    ),
];

/// Surfaces that leave room for deep presses: key by key, what differs from the shipped rig.
const ROOMS: [(&str, &str, &str, &str); 4] = [
    (GRBL.rig, "stage", "travel_mm", "{ x = [-10.0, 10.0], y = [-10.0, 10.0], z = [-8.0, 2.0] }"),
    (MARLIN.rig, "frame", "surface_mm", "{ z = -9.0, uncertainty = 0.3 }"),
    (KLIPPER.rig, "frame", "surface_mm", "{ z = -9.0, uncertainty = 0.3 }"),
    (ARM.rig, "stage", "travel_mm", "{ x = [-12.5, 12.5], y = [-12.5, 12.5], z = [-4.0, 20.0] }"),
];

/// N per unit of a cell that sends counts, as shipped, and its factors.
const NEWTON_PER_UNIT: f64 = 0.000_002_5;
const GAINS: [f64; 6] = [1.0, 0.5, 2.0, -1.0, -0.5, -2.0];

/// Largest part of the reachable force that is pressed.
const REACH: f64 = 0.9;

/// Largest part of the force limit that a step of z adds: the rig file is refused at 0.05.
const STEP_SHARE: f64 = 0.049;

/// Possible error of an arm's end point by the noise of its position, mm: five sd of the difference of two positions with 0.004 mm.
const ARM_NOISE_MM: f64 = 0.03;

/// Largest part of the force limit that these reserves take: with more, hardly a force is left to press with.
const RESERVE_SHARE: f64 = 0.3;

/// Parts of a sudden load that relax.
const RELAXED: f64 = 0.1;

/// A random sound rig.
#[derive(Clone, Debug)]
pub(super) struct RigDraw {
    seed: u64,
    stage: (&'static str, bool),
    cell: &'static str,
    conversions_hz: f64,
    gain: f64,
    latency_ms: [[f64; 2]; 3],
    speed_mm_s: f64,
    acceleration_mm_s2: f64,
    step_mm: f64,
    force_n: f64,
    depth_mm: f64,
    /// True stiffness, and what is declared.
    stiffness_n_mm: f64,
    declared_n_mm: f64,
    least_n_mm: Option<f64>,
    is_relaxing: bool,
    noise_n: f64,
    strategy: Strategy,
}

impl RigDraw {
    pub(super) fn of(seed: u64) -> RigDraw {
        let mut rng = stream(seed, 0, "random rigs");
        let stage = STAGES[rng.random_range(0..STAGES.len())];
        let (cell, most_hz) = CELLS[rng.random_range(0..CELLS.len())];
        // the analog input of an XPS ends at 10 V, which are 10 N as shipped, and a reading has noise
        let force_n = drawn(&mut rng, 0.5, if stage.0 == XPS.rig { 8.0 } else { 20.0 });
        // declared up to twice as stiff
        let stiffest_n_mm = RESERVE_SHARE * force_n / (2.0 * reserve_mm(stage.0, Steps::FINE.in_position_mm(Axis::Z)));
        let stiffness_n_mm = drawn(&mut rng, 0.5, 50.0).min(stiffest_n_mm);
        let declared_n_mm = stiffness_n_mm * rng.random_range(1.0..2.0);
        let latency_ms = [0; 3].map(|_| {
            let least = rng.random_range(1.0..100.0);
            [least, rng.random_range(least..=100.0)]
        });
        let is_relaxing = rng.random_bool(0.7);
        let relaxed_n_mm = if is_relaxing { stiffness_n_mm / (1.0 + RELAXED) } else { stiffness_n_mm };
        let finest_mm = STEP_SHARE * force_n / declared_n_mm;
        RigDraw {
            seed,
            stage,
            cell,
            conversions_hz: drawn(&mut rng, 5.0, most_hz),
            gain: NEWTON_PER_UNIT * (force_n / 2.0) * GAINS[rng.random_range(0..GAINS.len())],
            latency_ms,
            speed_mm_s: drawn(&mut rng, 0.2, 20.0),
            acceleration_mm_s2: drawn(&mut rng, 20.0, 500.0).min(most_mm_s2(stage.0)),
            step_mm: drawn(&mut rng, 0.0005, 0.02).min(finest_mm),
            force_n,
            depth_mm: rng.random_range(1.2..3.0),
            stiffness_n_mm,
            declared_n_mm,
            least_n_mm: rng.random_bool(0.3).then(|| relaxed_n_mm * rng.random_range(0.5..0.95)),
            is_relaxing,
            noise_n: force_n * drawn(&mut rng, 0.0003, 0.01),
            strategy: Strategy::ALL[rng.random_range(0..Strategy::ALL.len())],
        }
    }

    /// The rig, simulated.
    pub(super) fn spec(&self) -> Result<RigSpec, String> {
        let (path, finishes) = self.stage;
        let mut text = shipped_text(path);
        if finishes {
            text = text.replacen("stage.py\"] }", "stage.py\"], finishes = true }", 1);
        }
        // a program with or without steps
        let has_steps = text.contains("step_mm =") || path == PROGRAM.rig && self.seed.is_multiple_of(2);
        if has_steps {
            let step_mm = self.step_mm;
            set(&mut text, "stage", "step_mm", &format!("{{ x = 0.0125, y = 0.0125, z = {step_mm:.6} }}"));
        }
        if let Some((_, section, key, value)) = ROOMS.iter().find(|(rig, ..)| *rig == path) {
            set(&mut text, section, key, value);
        }
        set(&mut text, "stage", "speed_mm_s", &format!("{:.2}", self.speed_mm_s));
        set(&mut text, "stage", "acceleration_mm_s2", &format!("{:.0}", self.acceleration_mm_s2));
        set(&mut text, "limits", "force_n", &format!("{:.4}", self.force_n));
        set(&mut text, "limits", "depth_mm", &format!("{:.4}", self.depth_mm));
        set(&mut text, "limits", "stiffness_n_mm", &format!("{:.5}", self.declared_n_mm));
        if let Some(least_n_mm) = self.least_n_mm {
            set(&mut text, "limits", "stiffness_least_n_mm", &format!("{least_n_mm:.5}"));
        }
        let cell = self.cell.replace("GAIN", &format!("{:e}", self.gain));
        let hz = format!("{:.3}", self.conversions_hz);
        // the guard of an XPS is its own analog input
        match path == XPS.rig {
            true => set(&mut text, "load_cell", "conversions_hz", &hz),
            false => text = with_cell(&text, &format!("{cell}\nconversions_hz = {hz}\n")),
        }
        let read = rig::parse(path, &text, &|_| unreachable!("no map of its own"));
        let mut spec = read.map_err(|problems| format!("{:?}", problems.lines()))?.simulated();
        spec.stage.approach_mm_s = spec.stage.approach_mm_s.min(self.speed_mm_s);
        let scene = &mut spec.scene;
        let relaxed = if self.is_relaxing { 1.0 + RELAXED } else { 1.0 };
        if !self.is_relaxing {
            scene.relaxation.clear();
        }
        scene.contact = ContactLaw { linear_n_mm: self.stiffness_n_mm / relaxed, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
        scene.load_cell = Some(LoadCellScene { noise_n: self.noise_n, ..LoadCellScene::IDEAL });
        let [stage_s, load_cell_s, array_s] = self.latency_ms.map(|ms| (ms[0] / 1000.0, ms[1] / 1000.0));
        (scene.latencies.stage_s, scene.latencies.load_cell_s, scene.latencies.array_s) =
            (stage_s, load_cell_s, array_s);
        Ok(spec)
    }

    /// Random presses up to what the rig reaches, or why they are refused.
    pub(super) fn plan(&self, spec: &RigSpec) -> Result<Plan, String> {
        let finishes = spec.stage.driver.abilities().finishes();
        let strategy = match self.strategy {
            Strategy::Velocity if finishes => Strategy::Guarded,
            strategy => strategy,
        };
        let relaxed = if self.is_relaxing { 1.0 + RELAXED } else { 1.0 };
        let steps = spec.stage.steps;
        // a stage with steps can't come closer than a step's force
        let step_n = self.declared_n_mm * steps.along(Axis::Z);
        // the permit keeps a reserve for where z really ends, and depth counts from the earliest surface
        let limit_n = self.force_n - step_n - self.declared_n_mm * reserve_mm(self.stage.0, steps.reserve_mm());
        let depth_mm = self.depth_mm - 2.0 * spec.frame.uncertainty_mm;
        let most_n = REACH * limit_n.min(self.stiffness_n_mm / relaxed * depth_mm);
        let tolerance_n = (0.025 * self.force_n).max(step_n).min(most_n / 8.0);
        let text = format!(
            "name = \"random\"\nchecks = \"none\"\n[press]\nstrategy = \"{}\"\nforce_tolerance_n = {tolerance_n:.5}\nhold_s = 0.0\nsample_s = 0.2\n\
             [[step]]\nphase = \"calibration\"\nrandom = {{ count = {}, x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0], force_n = [{:.4}, {most_n:.4}] }}\n",
            strategy.name(),
            campaign::size(PRESSES.0, PRESSES.1),
            most_n / 5.0,
        );
        let recipe = recipe::parse("random.toml", &text).map_err(|problems| format!("{:?}", problems.lines()))?;
        Plan::new(&recipe, &spec.ground(), self.seed).map_err(|problems| format!("{:?}", problems.lines()))
    }
}

impl fmt::Display for RigDraw {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let RigDraw { seed, stage: (path, finishes), conversions_hz, latency_ms, speed_mm_s, step_mm, .. } = self;
        let RigDraw { force_n, depth_mm, stiffness_n_mm, declared_n_mm, least_n_mm, noise_n, strategy, .. } = self;
        let finishes = if *finishes { " that finishes" } else { "" };
        let driver = self.cell.lines().next().unwrap_or_default().split('"').nth(1).unwrap_or_default();
        let line = self.cell.split("baud=").nth(1).unwrap_or("-").trim_end_matches('"');
        let ms = latency_ms.map(|[least, most]| format!("{least:.0}-{most:.0}")).join(" ");
        write!(
            f,
            "seed {seed}: {path}{finishes}, {driver} {line} {conversions_hz:.1} Hz, {ms} ms, {speed_mm_s:.2} mm/s {:.0} mm/s2, step {step_mm:.4}, \
             limit {force_n:.2} N {depth_mm:.2} mm, {stiffness_n_mm:.2} of {declared_n_mm:.2} N/mm, least {least_n_mm:.2?}, relaxing {}, \
             noise {noise_n:.4}, {}",
            self.acceleration_mm_s2,
            self.is_relaxing,
            strategy.name()
        )
    }
}

/// Largest acceleration of an emulated stage, mm/s^2.
fn most_mm_s2(path: &str) -> f64 {
    if [ESP301.rig, XPS.rig, PROGRAM.rig].contains(&path) { 100.0 } else { f64::INFINITY }
}

/// Distance by which z may end deeper than its target, mm: an arm's position has noise too, which it measures only when it is there.
fn reserve_mm(path: &str, by_steps_mm: f64) -> f64 {
    if path == ARM.rig { by_steps_mm + ARM_NOISE_MM } else { by_steps_mm }
}

/// Draws a number whose logarithm is uniform.
pub(super) fn drawn(rng: &mut RandomStream, least: f64, most: f64) -> f64 {
    (least.ln() + rng.random::<f64>() * (most / least).ln()).exp()
}

/// Gives a key of a section of a rig's text a value.
fn set(text: &mut String, section: &str, key: &str, value: &str) {
    let header = format!("[{section}]");
    let before = format!("{key} =");
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let at = lines.iter().position(|line| line.starts_with(&header)).unwrap_or_else(|| panic!("no {header}"));
    let length = lines[at + 1..].iter().position(|line| line.starts_with('[')).unwrap_or(lines.len() - at - 1);
    let own = at + 1..at + 1 + length;
    let known = own.clone().find(|&line| lines[line].starts_with(&before));
    let line = format!("{key} = {value}");
    match known {
        Some(known) => lines[known] = line,
        None => lines.insert(own.start, line),
    }
    *text = lines.join("\n") + "\n";
}

/// Returns a rig's text with another load cell.
pub(super) fn with_cell(text: &str, cell: &str) -> String {
    let (before, after) = text.split_once("[load_cell]\n").expect("it has a load cell");
    let rest = after.find("\n[").map_or("", |at| &after[at..]);
    format!("{before}[load_cell]\n{cell}{rest}")
}
