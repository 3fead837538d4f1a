//! Temperature of a scene, and its effects on taxels and load cell.

use super::spec::{LoadCellScene, Sine};

/// Temperature as a function of time alone, and its effects. Each effect is proportional to the difference from `reference_c`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Temperature {
    /// Temperature when the rig is opened, degrees Celsius.
    pub mean_c: f64,
    /// Periodic change, degrees Celsius; `None`: no such change.
    pub wave: Option<Sine>,
    /// Drift, degrees Celsius per hour.
    pub drift_c_h: f64,
    /// Temperature at which there is no effect, degrees Celsius.
    pub reference_c: f64,
    /// Change of every taxel's output, loaded or not, reading units per degree.
    pub taxel_zero_per_c: f64,
    /// Relative change of every taxel's gain, 1 per degree.
    pub taxel_gain_per_c: f64,
    /// Change of the load cell's reading, loaded or not, N per degree. With three axes it is that of the press axis.
    pub load_cell_zero_n_per_c: f64,
    /// Relative change of the load cell's gain, 1 per degree.
    pub load_cell_gain_per_c: f64,
}

impl Temperature {
    /// Temperature at a time since the rig was opened, degrees Celsius.
    pub fn at_c(&self, at_s: f64) -> f64 {
        self.mean_c + self.wave.map_or(0.0, |wave| wave.at(at_s)) + self.drift_c_h * at_s / 3600.0
    }

    /// Factor on the taxels' gains, and shift of their zeros, reading units.
    pub(super) fn of_taxels(&self, at_s: f64) -> (f64, f64) {
        let warmer_c = self.at_c(at_s) - self.reference_c;
        (1.0 + self.taxel_gain_per_c * warmer_c, self.taxel_zero_per_c * warmer_c)
    }

    /// Returns the load cell at this temperature.
    pub(super) fn of_load_cell(&self, cell: LoadCellScene, at_s: f64) -> LoadCellScene {
        let warmer_c = self.at_c(at_s) - self.reference_c;
        let gain = cell.gain * (1.0 + self.load_cell_gain_per_c * warmer_c);
        LoadCellScene { gain, offset_n: cell.offset_n + self.load_cell_zero_n_per_c * warmer_c, ..cell }
    }
}
