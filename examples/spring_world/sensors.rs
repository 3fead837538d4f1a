//! What the load cell and the array of the world make of the true force.

use crate::axis::TICK_S;
use crate::world::{TOUCH_N, World};
use std::f64::consts::TAU;

/// Noise of an output, and the smallest gain that a ramp comes to.
const NOISE: f64 = 0.001;
const RAMP_LEAST: f64 = 0.3;

impl World {
    /// What the load cell makes of the force.
    pub(crate) fn convert(&mut self, force_n: f64) {
        match self.fault("cell-slow") {
            Some(lag_s) => self.filtered_n += (force_n - self.filtered_n) * TICK_S / lag_s,
            None => self.filtered_n = force_n,
        }
        if self.now_s < self.next_conversion_s {
            return;
        }
        self.next_conversion_s = self.now_s + self.fault("cell-slow-rate").unwrap_or(1.0 / self.setting.conversions_hz);
        self.history.push((self.now_s, self.filtered_n));
        let mut n = self.filtered_n;
        if let Some(s) = self.fault("cell-delayed") {
            n = self.felt_n(self.now_s - s);
        }
        if let Some((since_s, s)) = self.since("cell-replay") {
            n = self.felt_n(self.now_s - since_s - s + since_s % s);
        }
        n = self.fault("cell-dead-band").map_or(n, |band_n| if n < band_n { 0.0 } else { n });
        n *= self.fault("cell-gain").unwrap_or(1.0) * self.fault("cell-grams").unwrap_or(1.0);
        n *= self.since("cell-ramp-gain").map_or(1.0, |(s, per_s)| (1.0 + per_s * s).max(RAMP_LEAST));
        n += self.setting.offset_n + self.fault("cell-offset").unwrap_or(0.0);
        n += self.since("cell-drift").map_or(0.0, |(s, n_s)| n_s * s);
        n += self.fault("cell-hum").unwrap_or(0.0) * (TAU * 50.0 * self.now_s).sin();
        n = self.fault("cell-clips").map_or(n, |most_n| n.min(most_n));
        if self.acting("cell-stuck-noise").is_some() {
            n = self.stuck_n.unwrap_or(n) + self.setting.offset_n;
        }
        n += self.random.normal() * self.setting.noise_n * self.fault("cell-noisy").unwrap_or(1.0);
        if let Some(off_n) = self.fault("cell-spikes")
            && self.random.unit() < 1.0 / 30.0
        {
            n += off_n;
        }
        n = self.fault("cell-coarse").map_or(n, |step_n| (n / step_n).round() * step_n);
        n = if self.acting("cell-sign").is_some() { -n } else { n };
        if self.acting("cell-stuck").is_some() {
            n = self.stuck_n.unwrap_or(n);
        }
        self.reading_n = if self.acting("cell-zero").is_some() { 0.0 } else { n };
    }

    /// What the cell felt at a time.
    fn felt_n(&self, at_s: f64) -> f64 {
        let index = self.history.partition_point(|(then_s, _)| *then_s <= at_s);
        self.history.get(index.saturating_sub(1)).map_or(0.0, |(_, n)| *n)
    }

    /// The outputs of the array now, which palpate asked for.
    pub(crate) fn read_outputs(&mut self) -> Vec<f64> {
        let force_n = self.force_n();
        if force_n > TOUCH_N {
            self.seen.reads.push([self.axes[0].at_mm, self.axes[1].at_mm, force_n]);
        }
        self.outputs()
    }

    /// The outputs of the array now.
    pub(crate) fn outputs(&mut self) -> Vec<f64> {
        let sideways_mm = self.fault("array-shifted").unwrap_or(0.0) + self.fault("specimen-moves").unwrap_or(0.0);
        let [x_mm, y_mm] = [self.axes[0].at_mm + sideways_mm, self.axes[1].at_mm];
        let (force_n, noise) = (self.force_n(), NOISE * self.fault("array-noisy").unwrap_or(1.0));
        let mut outputs = Vec::new();
        for taxel in self.setting.taxels() {
            let away_mm = (x_mm - taxel.x_mm).hypot(y_mm - taxel.y_mm) / self.setting.footprint_mm;
            let volts = taxel.base + taxel.gain * force_n * (-away_mm * away_mm / 2.0).exp();
            outputs.push(volts + noise * self.random.normal());
        }
        if self.acting("array-stuck").is_some() && self.stuck_outputs.is_some() {
            outputs = self.stuck_outputs.clone().unwrap_or_default();
        }
        let one = |value: f64| (value as usize).min(self.setting.units() - 1);
        if let (Some(value), Some(stuck)) = (self.fault("array-taxel-stuck"), &self.stuck_outputs) {
            outputs[one(value)] = stuck[one(value)];
        }
        if let Some(value) = self.fault("array-taxel-dead") {
            outputs[one(value)] = 0.0;
        }
        if self.fault("array-swapped").is_some() {
            outputs.swap(0, 1);
        }
        let times = if self.fault("array-zero").is_some() { 0.0 } else { self.fault("array-scaled").unwrap_or(1.0) };
        outputs.iter_mut().for_each(|volts| *volts *= times);
        outputs
    }
}
