//! What a run's world is like, and the rig and recipe that fit it: all of it follows from a seed.

use std::f64::consts::TAU;
use std::fmt::Write as _;

/// What the rig states.
pub(crate) const LIMIT_N: f64 = 2.0;
pub(crate) const DECLARED_N_MM: f64 = 2.0;
pub(crate) const DEPTH_MM: f64 = 3.0;
const TOP_MM: f64 = 2.0;

/// Set forces, N, and the tolerance.
const FORCES_N: (f64, f64) = (0.5, 1.9);
pub(crate) const TOLERANCE_N: f64 = 0.02;

/// Share of the depth limit that a press may need on a soft specimen.
const DEPTH_SHARE: f64 = 0.85;

pub(crate) const STRATEGIES: [&str; 3] = ["guarded", "velocity", "map"];

/// Random numbers: splitmix64.
#[derive(Debug)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234_5678_9abc_def1)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
    }

    /// From 0 to 1.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// One of the first so many whole numbers.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count - 1)
    }

    /// With a standard deviation of 1.
    pub(crate) fn normal(&mut self) -> f64 {
        (-2.0 * self.unit().max(1e-300).ln()).sqrt() * (TAU * self.unit()).cos()
    }
}

#[derive(Clone, Debug)]
pub(crate) struct WorldSetting {
    pub(crate) stiffness_n_mm: f64,
    pub(crate) stiffening_n_mm2: f64,
    pub(crate) surface_mm: f64,
    /// How much the surface rises per mm along x and y.
    pub(crate) tilt: [f64; 2],
    pub(crate) top_mm: f64,
    pub(crate) conversions_hz: f64,
    pub(crate) noise_n: f64,
    pub(crate) offset_n: f64,
    /// Rows and columns of the array.
    side: usize,
    pub(crate) footprint_mm: f64,
    pub(crate) strategy: &'static str,
    pub(crate) presses: usize,
    forces_n: (f64, f64),
    seed: u64,
}

/// One output of the array: where it is, what it gives without load, and per newton at its middle.
pub(crate) struct Taxel {
    pub(crate) x_mm: f64,
    pub(crate) y_mm: f64,
    pub(crate) base: f64,
    pub(crate) gain: f64,
}

const PITCH_MM: f64 = 4.5;

impl WorldSetting {
    /// The world of a seed; `share` is the true stiffness as a share of the declared one.
    pub(crate) fn new(
        seed: u64,
        share: Option<f64>,
        strategy: Option<&'static str>,
        presses: Option<usize>,
    ) -> WorldSetting {
        let mut random = Random::new(seed);
        let drawn = random.between(0.2, 1.0);
        let stiffness_n_mm = DECLARED_N_MM * share.unwrap_or(drawn);
        // linear, or up to twice as much at the depth limit, without getting stiffer than declared
        let stiffens = random.unit() < 0.3;
        let room_n_mm = (DECLARED_N_MM - stiffness_n_mm).max(0.0);
        let stiffening_n_mm2 = if stiffens { random.between(0.0, room_n_mm) / (2.0 * DEPTH_MM) } else { 0.0 };
        let reach_n = (stiffness_n_mm + stiffening_n_mm2 * DEPTH_MM * DEPTH_SHARE) * DEPTH_MM * DEPTH_SHARE;
        WorldSetting {
            stiffness_n_mm,
            stiffening_n_mm2,
            surface_mm: random.between(-0.2, 0.2),
            tilt: [random.between(-0.01, 0.01), random.between(-0.01, 0.01)],
            top_mm: TOP_MM,
            conversions_hz: [80.0, 100.0, 150.0][random.below(3)],
            noise_n: random.between(0.001, 0.004),
            offset_n: random.between(-0.2, 0.2),
            side: 2 + random.below(2),
            footprint_mm: random.between(3.0, 5.0),
            strategy: strategy.unwrap_or(STRATEGIES[random.below(3)]),
            presses: presses.unwrap_or(12 + random.below(5)),
            forces_n: (FORCES_N.0, FORCES_N.1.min(reach_n)),
            seed,
        }
    }

    pub(crate) fn units(&self) -> usize {
        self.side * self.side
    }

    pub(crate) fn taxels(&self) -> impl Iterator<Item = Taxel> + use<> {
        let (side, mut random) = (self.side, Random::new(self.seed ^ 0x7a));
        let middle = (side as f64 - 1.0) / 2.0;
        (0..side * side).map(move |unit| Taxel {
            x_mm: ((unit % side) as f64 - middle) * PITCH_MM,
            y_mm: ((unit / side) as f64 - middle) * PITCH_MM,
            base: random.between(0.05, 0.2),
            gain: random.between(0.3, 0.6),
        })
    }

    pub(crate) fn recipe(&self) -> String {
        let (low_n, high_n) = (self.forces_n.0.min(self.forces_n.1), self.forces_n.1);
        let mut text = String::new();
        let _ = writeln!(text, "name = \"spring-world\"\n\n[press]\nforce_tolerance_n = {TOLERANCE_N:?}");
        let _ = writeln!(text, "sample_s = 0.04\nstrategy = \"{}\"\n\n[[step]]\nphase = \"test\"", self.strategy);
        let area = "x_mm = [-5.0, 5.0], y_mm = [-5.0, 5.0]";
        let force = format!("force_n = [{low_n:.3}, {high_n:.3}]");
        let _ = writeln!(text, "random = {{ count = {}, {area}, {force} }}", self.presses);
        text
    }

    /// The rig, whose devices are this program in a role: `command` is the start of the list of its words.
    pub(crate) fn rig(&self, command: &dyn Fn(&str) -> String) -> String {
        format!(
            "[stage]
driver = {{ process = {stage} }}
travel_mm = {{ x = [-8.0, 8.0], y = [-8.0, 8.0], z = [-6.0, {top:?}] }}
speed_mm_s = 40.0
acceleration_mm_s2 = 600.0
approach_mm_s = 4.0
settle_ms = 5.0

[load_cell]
driver = {{ process = {cell} }}
conversions_hz = {hz:?}

[array]
driver = {{ process = {array} }}
grid = {{ rows = {side}, columns = {side}, pitch_mm = {PITCH_MM:?} }}

[limits]
force_n = {LIMIT_N:?}
depth_mm = {DEPTH_MM:?}
stiffness_n_mm = {DECLARED_N_MM:?}

[frame]
surface_mm = {{ z = 0.0, uncertainty = 0.3 }}
down = \"-z\"
",
            stage = command("stage"),
            cell = command("load_cell"),
            array = command("array"),
            top = self.top_mm,
            hz = self.conversions_hz,
            side = self.side,
        )
    }
}
