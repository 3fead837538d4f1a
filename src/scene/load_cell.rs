use super::spec::LoadCell;
use crate::quantity::Stream;
use rand::distr::Distribution;
use rand_distr::StandardNormal;

/// The load cell: the force at its last conversion, and noise that is one draw a conversion.
pub(super) struct LoadCellState {
    spec: Option<LoadCell>,
    conversions_hz: f64,
    rng: Stream,
    conversion: u64,
    held_n: f64,
    read: Option<(u64, f64)>,
}

impl LoadCellState {
    pub fn new(spec: Option<LoadCell>, conversions_hz: f64) -> Self {
        let rng = crate::quantity::stream(0, 0, "load cell noise");
        LoadCellState { spec, conversions_hz, rng, conversion: 0, held_n: 0.0, read: None }
    }

    pub fn reseed(&mut self, rng: Stream) {
        self.rng = rng;
    }

    /// When the last conversion at or before `to_s` happens, s.
    pub fn last_conversion_before(&self, to_s: f64) -> f64 {
        self.conversion_at(to_s) as f64 / self.conversions_hz
    }

    /// Holds the force if `now_s` is, or lies beyond, a conversion that hasn't been held yet.
    pub fn latch(&mut self, now_s: f64, force_n: f64) {
        let conversion = self.conversion_at(now_s);
        if conversion > self.conversion {
            self.conversion = conversion;
            self.held_n = force_n;
        }
    }

    /// Whether this conversion is read for the first time, the true force it held, and what the cell makes of it, N.
    pub fn read(&mut self) -> (bool, f64, f64) {
        if let Some((conversion, read_n)) = self.read
            && conversion == self.conversion
        {
            return (false, self.held_n, read_n);
        }
        let read_n = match self.spec {
            None => self.held_n,
            Some(cell) => {
                let draw: f64 = StandardNormal.sample(&mut self.rng);
                self.held_n + cell.offset_n + cell.noise_n * draw
            }
        };
        self.read = Some((self.conversion, read_n));
        (true, self.held_n, read_n)
    }

    /// The small shift keeps an instant that was computed as n / hz from falling to conversion n - 1 by rounding.
    fn conversion_at(&self, at_s: f64) -> u64 {
        (at_s * self.conversions_hz + 1e-6).floor() as u64
    }
}
