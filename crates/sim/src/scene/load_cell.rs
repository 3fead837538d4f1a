//! Load cell reading of the true force.

use super::faults::{FaultKind, SceneFaults};
use super::glitches::{Glitch, GlitchState};
use super::spec::{LoadCellScene, SideAxes};
use super::temperature::Temperature;
use palpate_core::quantity::RandomStream;
use rand::distr::Distribution;
use rand_distr::StandardNormal;
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Longest stretch over which the low-pass approximates the force by a ramp, s. Within it the contact force deviates from a ramp
/// by some 0.1 mN at 10 mm/s. At first touch it deviates by a few mN, which the low-pass forgets within its time constant.
const STRETCH_S: f64 = 0.002;

/// Number of time constants after which a low-pass has forgotten an event, to 2e-9.
const MEMORY: f64 = 20.0;

/// A conversion that was read.
#[derive(Clone, Copy)]
struct Sample {
    conversion: u64,
    /// Its reading without what happened to it, N.
    sound_n: f64,
    glitch: Option<Glitch>,
}

/// State of the load cell: the low-passed force at its conversions, the conversions that can't be read yet, and the noise. The
/// noise is one draw for each conversion.
#[derive(Clone)]
pub(super) struct LoadCellState {
    spec: Option<LoadCellScene>,
    temperature: Option<Temperature>,
    conversions_hz: f64,
    transport_s: f64,
    /// Rate of the low-pass, 1/s.
    low_pass: Option<f64>,
    rng: RandomStream,
    /// Start of the press under way, s; conversions are timed from it.
    began_s: f64,
    /// Force after the low-pass, N.
    passed_n: f64,
    /// Conversion that is read now and the conversions after it: number and force, N. Never empty.
    held: VecDeque<(u64, f64)>,
    read: Option<Sample>,
    glitches: Option<GlitchState>,
    /// Force sideways by friction now, and at the conversions that are held, N.
    side_n: [f64; 2],
    side_held: VecDeque<[f64; 2]>,
    /// Conversion whose forces sideways were read last, and these readings, N.
    side: Option<(u64, [f64; 2])>,
    side_rng: RandomStream,
    /// Conversion that was read last, and the part of its noise that passed the low-pass, N.
    filtered: Option<(u64, f64)>,
}

impl LoadCellState {
    pub(super) fn new(spec: Option<LoadCellScene>, temperature: Option<Temperature>, conversions_hz: f64) -> Self {
        // a perfect cell gets warm too
        let spec = spec.or(temperature.map(|_| LoadCellScene::IDEAL));
        let unloaded_n = spec.map_or(0.0, |cell| cell.tool_n(0.0));
        LoadCellState {
            spec,
            temperature,
            conversions_hz,
            transport_s: spec.map_or(0.0, |cell| cell.transport_s),
            low_pass: spec.and_then(|cell| cell.low_pass_hz).map(|hz| TAU * hz),
            rng: palpate_core::quantity::stream(0, 0, "load cell noise"),
            began_s: 0.0,
            passed_n: unloaded_n,
            held: VecDeque::from([(0, unloaded_n)]),
            read: None,
            glitches: spec.and_then(|cell| cell.glitches).map(GlitchState::new),
            side_n: [0.0; 2],
            side_held: VecDeque::from([[0.0; 2]]),
            side: None,
            side_rng: palpate_core::quantity::stream(0, 0, "load cell noise sideways"),
            filtered: None,
        }
    }

    /// Force reading caused by the tool while the stage accelerates toward the specimen, N.
    pub(super) fn tool_n(&self, acceleration_mm_s2: f64) -> f64 {
        self.spec.map_or(0.0, |cell| cell.tool_n(acceleration_mm_s2))
    }

    /// Begins another press, with its own noise. The press begins with a conversion, because the phase of the cell's free-running
    /// clock relative to the press is random anyway. Conversions on their way to the reader get the force of this moment.
    pub(super) fn begin(&mut self, [rng, side_rng]: [RandomStream; 2], now_s: f64) {
        (self.rng, self.side_rng) = (rng, side_rng);
        let under_way = (self.transport_s * self.conversions_hz).ceil() as u64;
        self.began_s = now_s - under_way as f64 / self.conversions_hz;
        self.held = (0..=under_way).map(|conversion| (conversion, self.passed_n)).collect();
        self.side_held = (0..=under_way).map(|_| self.side_n).collect();
        self.read = None;
        self.side = None;
        self.filtered = None;
    }

    /// Gives the corrupt samples their random stream of a press.
    pub(super) fn begin_glitches(&mut self, seed: u64, press: u64) {
        if let Some(glitches) = &mut self.glitches {
            glitches.begin(seed, press);
        }
    }

    /// Latest time at which the scene must stop on its way from `now_s` to `to_s`, s. The scene stops at every conversion that
    /// can be read at `to_s` or later; a long way has few of these. It stops often while the low-pass still has a memory of
    /// earlier forces.
    pub(super) fn next_knot(&self, now_s: f64, to_s: f64) -> f64 {
        let earliest = self.conversion_at(to_s - self.transport_s);
        let conversion = earliest.max(self.newest() + 1);
        let mut knot_s = to_s;
        if conversion <= self.conversion_at(to_s) {
            knot_s = knot_s.min(self.began_s + conversion as f64 / self.conversions_hz);
        }
        if let Some(rate) = self.low_pass {
            let remembered_s = to_s - self.transport_s - 1.0 / self.conversions_hz - MEMORY / rate;
            knot_s = knot_s.min(if now_s < remembered_s { remembered_s } else { now_s + STRETCH_S });
        }
        knot_s
    }

    /// Takes a change of the force from one value to another in `dt_s`.
    pub(super) fn follow(&mut self, dt_s: f64, from_n: f64, to_n: f64) {
        self.passed_n = match self.low_pass {
            None => to_n,
            Some(rate) => {
                // the response to a ramp, minus the rest of its start
                let slope = (to_n - from_n) / dt_s;
                let left = (-rate * dt_s).exp();
                to_n + slope / rate * (-rate * dt_s).exp_m1() + (self.passed_n - from_n) * left
            }
        };
    }

    /// Stores the force if a conversion that hasn't been stored yet is due at `now_s`.
    pub(super) fn latch(&mut self, now_s: f64) {
        let conversion = self.conversion_at(now_s);
        if conversion > self.newest() {
            self.held.push_back((conversion, self.passed_n));
            self.side_held.push_back(self.side_n);
        }
        let readable = self.conversion_at(now_s - self.transport_s);
        while self.held.get(1).is_some_and(|(next, _)| *next <= readable) {
            self.held.pop_front();
            self.side_held.pop_front();
        }
    }

    /// Returns the cell's reading at `now_s`, N; the scene must have advanced to that time.
    pub(super) fn read(&mut self, now_s: f64, faults: &SceneFaults) -> f64 {
        let Sample { sound_n, glitch, .. } = self.sample(now_s, faults);
        glitch.map_or(sound_n, |glitch| glitch.reading_n(sound_n))
    }

    /// Returns the count of a cell whose sound counts are those of `count_of` a force in N.
    pub(super) fn count(&mut self, now_s: f64, faults: &SceneFaults, count_of: impl Fn(f64) -> f64) -> f64 {
        let Sample { sound_n, glitch, .. } = self.sample(now_s, faults);
        let sound = count_of(sound_n);
        glitch.map_or(sound, |glitch| glitch.count(sound))
    }

    fn sample(&mut self, now_s: f64, faults: &SceneFaults) -> Sample {
        let (conversion, held_n) = self.held[0];
        if let Some(read) = self.read
            && (read.conversion == conversion || faults.any(FaultKind::Stuck, now_s))
        {
            return read;
        }
        let sound_n = match faults.is_empty() {
            true => self.sound(conversion, held_n),
            false => self.faulty(conversion, held_n, now_s, faults),
        };
        let at_s = self.at_s(conversion);
        let glitch = self.glitches.as_mut().and_then(|glitches| glitches.strike(at_s));
        let sample = Sample { conversion, sound_n, glitch };
        self.read = Some(sample);
        sample
    }

    /// Takes the true force sideways by friction, N.
    pub(super) fn press_sideways(&mut self, side_n: [f64; 2]) {
        self.side_n = side_n;
    }

    /// Force that the press axis reads of the forces sideways, N.
    pub(super) fn crosstalk_n(&self, per_force: [f64; 2], hung_n: [f64; 3]) -> f64 {
        let [x_n, y_n, _] = self.acts_n(per_force, hung_n);
        self.spec.map_or(0.0, |cell| cell.crosstalk) * (x_n + y_n)
    }

    /// Forces along x, y and the press that act on the cell at the conversion that is read now, N.
    fn acts_n(&self, per_force: [f64; 2], hung_n: [f64; 3]) -> [f64; 3] {
        let acts_n = self.held[0].1 - self.tool_n(0.0);
        let side_n = |axis: usize| per_force[axis] * (acts_n - hung_n[2]) + self.side_held[0][axis] + hung_n[axis];
        [side_n(0), side_n(1), acts_n]
    }

    /// Returns the readings sideways of the conversion that is read now, N: `per_force` times the pressing force, friction, and a weight
    /// `hung_n` on the tip. Each axis has the cell's noise; one conversion is one draw. The low-pass isn't modelled for friction and weight.
    pub(super) fn side(&mut self, per_force: [f64; 2], hung_n: [f64; 3], faults: &SceneFaults, now_s: f64) -> [f64; 2] {
        let conversion = self.held[0].0;
        if let Some((last, side_n)) = self.side
            && (last == conversion || faults.any(FaultKind::Stuck, now_s))
        {
            return side_n;
        }
        let cell = self.cell_at(conversion);
        let is_dead = faults.any(FaultKind::NoSensor, now_s);
        let [x_n, y_n, acts_n] = self.acts_n(per_force, hung_n);
        let [x_n, y_n] = [x_n + cell.crosstalk * (y_n + acts_n), y_n + cell.crosstalk * (x_n + acts_n)];
        let felt = match cell.side_axes {
            SideAxes::AsStated => [x_n, y_n],
            SideAxes::Swapped => [y_n, x_n],
            SideAxes::Mirrored => [-x_n, y_n],
            SideAxes::Dead => [0.0, y_n],
        };
        let read_n = felt.map(|true_n| {
            let noise: f64 = StandardNormal.sample(&mut self.side_rng);
            if is_dead { cell.noise_n * noise } else { cell.gain * true_n + cell.noise_n * noise }
        });
        self.side = Some((conversion, read_n));
        read_n
    }

    fn sound(&mut self, conversion: u64, held_n: f64) -> f64 {
        if self.spec.is_none() {
            return held_n;
        }
        let cell = self.cell_at(conversion);
        cell.gain * held_n + self.no_load_n(&cell, conversion) + cell.noise_n * self.draw()
    }

    /// The cell at the temperature of a conversion.
    fn cell_at(&self, conversion: u64) -> LoadCellScene {
        let cell = self.spec.unwrap_or_default();
        self.temperature.map_or(cell, |temperature| temperature.of_load_cell(cell, self.at_s(conversion)))
    }

    /// Time of a conversion, s.
    fn at_s(&self, conversion: u64) -> f64 {
        self.began_s + conversion as f64 / self.conversions_hz
    }

    /// Reading of a conversion without a force, N, minus the white noise.
    fn no_load_n(&mut self, cell: &LoadCellScene, conversion: u64) -> f64 {
        let at_s = self.at_s(conversion);
        let waves_n: f64 = cell.slow_drift.iter().chain(&cell.mains).map(|wave| wave.at(at_s)).sum();
        cell.offset_n + cell.drift_n_s * at_s + waves_n + self.filtered_n(cell, conversion)
    }

    /// Noise that enters before the low-pass, so that neighbouring conversions share part of it.
    fn filtered_n(&mut self, cell: &LoadCellScene, conversion: u64) -> f64 {
        if cell.noise_ahead_n == 0.0 {
            return 0.0;
        }
        let between_s =
            self.filtered.map_or(f64::INFINITY, |(last, _)| (conversion - last) as f64 / self.conversions_hz);
        let kept = self.low_pass.map_or(0.0, |rate| (-rate * between_s).exp());
        let before_n = self.filtered.map_or(0.0, |(_, noise_n)| noise_n);
        let noise_n = kept * before_n + (1.0 - kept * kept).sqrt() * cell.noise_ahead_n * self.draw();
        self.filtered = Some((conversion, noise_n));
        noise_n
    }

    fn faulty(&mut self, conversion: u64, held_n: f64, now_s: f64, faults: &SceneFaults) -> f64 {
        let cell = self.cell_at(conversion);
        let share = match (faults.any(FaultKind::NoSensor, now_s), faults.any(FaultKind::WrongSign, now_s)) {
            (true, _) => 0.0,
            (false, true) => -1.0,
            (false, false) => 1.0,
        };
        let zero_n = self.no_load_n(&cell, conversion) + faults.values(FaultKind::DriftedZero, now_s).sum::<f64>();
        let noise_n = cell.noise_n * faults.values(FaultKind::Noisy, now_s).product::<f64>();
        let most_n = faults.values(FaultKind::Saturated, now_s).fold(f64::INFINITY, f64::min);
        let gain = faults.values(FaultKind::LostGain, now_s).product::<f64>();
        let reads_n = (gain * (share * cell.gain * held_n + zero_n + noise_n * self.draw())).min(most_n);
        let turns_n = faults.values(FaultKind::RollsOver, now_s).fold(f64::INFINITY, f64::min);
        if reads_n > turns_n { reads_n - 2.0 * turns_n } else { reads_n }
    }

    fn draw(&mut self) -> f64 {
        StandardNormal.sample(&mut self.rng)
    }

    fn newest(&self) -> u64 {
        self.held.back().map_or(0, |(conversion, _)| *conversion)
    }

    /// Number of the conversion at a time. A small shift prevents a time computed as n / hz from being rounded down to conversion
    /// n - 1.
    fn conversion_at(&self, at_s: f64) -> u64 {
        ((at_s - self.began_s) * self.conversions_hz + 1e-6) as u64
    }
}
