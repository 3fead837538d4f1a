//! What a slow device of a simulated rig reads.

/// Temperature of a scene that doesn't name one, degrees Celsius.
const ROOM_C: f64 = 23.0;

/// Readings of a monitor. Its emulator acts on a scene of its own, whose only output they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Monitored {
    /// The quantity, which doesn't change; `None`: the temperature of the scene, degrees Celsius, or 23 if the scene doesn't name one.
    pub value: Option<f64>,
    /// The quantity is `scale` times the reading, plus `offset`.
    pub scale: f64,
    /// Quantity at a reading of 0.
    pub offset: f64,
}

impl Monitored {
    /// Reading in a scene with this temperature, degrees Celsius.
    pub(super) fn reading(&self, temperature_c: Option<f64>) -> f64 {
        (self.value.or(temperature_c).unwrap_or(ROOM_C) - self.offset) / self.scale
    }
}
