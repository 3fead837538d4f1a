//! One reading of a load cell.

/// Status of a load cell together with a reading; all false means healthy.
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
    /// Time at which the answer arrived, s since the program's clock began.
    pub at_s: f64,
    /// Force as the cell reports it, N, pressing positive, relative to the cell's own zero.
    pub force_n: f64,
    /// Forces along x and y of the specimen frame, N, as the tip exerts them on the specimen, relative to the cell's own zero;
    /// `None` if the cell has one axis.
    pub side_n: Option<[f64; 2]>,
    /// Status of the cell.
    pub health: Health,
}
