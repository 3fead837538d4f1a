//! One reading of a load cell.

/// What a load cell says of itself along with a reading; all false means healthy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// The cell or its amplifier is beyond its range.
    pub saturated: bool,
    /// The transmitter reports a fault of the cell, the bridge or the converter.
    pub fault: bool,
}

/// One reading of the load cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceReading {
    /// When the answer arrived, s since the program's clock began.
    pub at_s: f64,
    /// Force as the cell reports it, N, pressing positive; from the cell's own zero.
    pub force_n: f64,
    /// What the cell says of itself.
    pub health: Health,
}
