//! Three simulated sensors, and readings of each as it was calibrated, with a broken output, and with other gains.

use palpate_core::quantity::stream;
use palpate_solver::{Calibration, CalibrationPoint};
use palpate_testing::skins::{GridSkin, Pressed};
use rand::RngExt;
use std::fmt::Write as _;

/// Number of readings of each kind that are counted. Each has a place, a force and noise of its own.
pub(super) const READINGS: usize = 300;

/// Largest change of a gain, as a fraction: more than the noise, and less than a fault of one output.
const GAIN_OFF: f64 = 0.06;

/// A calibrated sensor.
pub(super) struct Sensor {
    pub units: usize,
    pub presses: Vec<Pressed>,
    /// One reading more than are counted: the first one prepares a session.
    contacts: Vec<Pressed>,
}

/// What happened to a sensor after its calibration.
#[derive(Clone, Copy, Debug)]
pub(super) enum State {
    Healthy,
    Broken,
    Off,
}

impl State {
    pub(super) const ALL: [State; 3] = [State::Healthy, State::Broken, State::Off];

    pub(super) fn name(self) -> &'static str {
        match self {
            State::Healthy => "healthy",
            State::Broken => "one-broken",
            State::Off => "gains-off",
        }
    }
}

impl Sensor {
    /// Sensors of 9, 64 and 192 units with 169, 196 and 300 presses.
    pub(super) fn all() -> [Sensor; 3] {
        [(3, 3, 1.0), (8, 8, 2.5), (16, 12, 3.6)].map(|(columns, rows, spacing_mm)| {
            let mut skin = GridSkin::new(columns, rows);
            let (presses, contacts) = (skin.spaced(spacing_mm), skin.random(READINGS + 1));
            Sensor { units: columns * rows, presses, contacts }
        })
    }

    /// The readings in this state.
    pub(super) fn readings(&self, state: State) -> Vec<Vec<f64>> {
        let mut rng = stream(self.units as u64, 2, "gains");
        let gains: Vec<f64> = (0..self.units).map(|_| 1.0 + rng.random_range(-GAIN_OFF..GAIN_OFF)).collect();
        let change = |(_, _, outputs): &Pressed| {
            let mut outputs = outputs.clone();
            match state {
                State::Healthy => {}
                State::Broken => outputs[self.units / 2] = 0.0,
                State::Off => outputs.iter_mut().zip(&gains).for_each(|(output, gain)| *output *= gain),
            }
            outputs
        };
        self.contacts.iter().map(change).collect()
    }

    /// The same as lines of JSON.
    pub(super) fn lines(&self, state: State) -> Vec<String> {
        self.readings(state).iter().map(|outputs| format!("{outputs:?}\n")).collect()
    }

    /// The presses as a table: each, or every second one, and so on.
    pub(super) fn table(&self, step: usize) -> String {
        let header: String = (1..=self.units).map(|unit| format!(",out_{unit}")).collect();
        let mut text = format!("x_mm,y_mm,force_n{header}\n");
        for (place, force_n, outputs) in self.presses.iter().step_by(step) {
            let _ = write!(text, "{},{},{force_n}", place.x_mm, place.y_mm);
            outputs.iter().for_each(|output| text += &format!(",{output}"));
            text += "\n";
        }
        text
    }

    pub(super) fn calibration(&self) -> Calibration {
        let points = self.presses.iter().map(|(place, force_n, outputs)| CalibrationPoint {
            place: *place,
            force_n: *force_n,
            outputs,
        });
        Calibration::new(&points.collect::<Vec<_>>()).expect("a calibration with contrast")
    }
}
