//! How much of the study is done.

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AblationSize {
    /// Specimens, each with noise of its own; a term is tried off and on with each.
    pub seeds: usize,
    /// Calibration presses along a side.
    pub side: usize,
    /// Contacts that each calibration is tested with.
    pub tests: usize,
    /// Presses of the force loop along a side.
    pub presses: usize,
}

impl AblationSize {
    /// The whole study: the paper's calibration of 625 presses.
    pub const WHOLE: AblationSize = AblationSize { seeds: 20, side: 25, tests: 500, presses: 7 };
    /// For a first look, and for tests.
    pub const QUICK: AblationSize = AblationSize { seeds: 3, side: 7, tests: 40, presses: 2 };
}
