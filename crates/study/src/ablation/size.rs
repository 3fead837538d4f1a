//! Amount of the study that is done.

/// Amount of measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AblationSize {
    /// Number of specimens, each with its own noise. A term is tried off and on with each specimen.
    pub seeds: usize,
    /// Number of calibration presses along a side.
    pub side: usize,
    /// Number of contacts with which each calibration is tested.
    pub tests: usize,
    /// Number of presses of the force loop along a side.
    pub presses: usize,
}

impl AblationSize {
    /// Complete study: the paper's calibration of 625 presses.
    pub const WHOLE: AblationSize = AblationSize { seeds: 20, side: 25, tests: 500, presses: 7 };
    /// Small study for a first look, and for tests.
    pub const QUICK: AblationSize = AblationSize { seeds: 3, side: 7, tests: 40, presses: 2 };
}
