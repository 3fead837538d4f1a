//! Few presses of a new sensor, with the prior of its design.
//!
//! The sensors are simulated: the paper's array under a bonded layer, with the noise of its Table 1. They differ in the gain, the
//! place and the depth of each unit. The prior is made from full calibrations of other sensors. [`presses`] finds the error as a
//! function of the number of presses, [`strangers`] whether sensors that aren't of the design are found, and [`verdicts`] whether
//! few presses decide like a full calibration.

mod design;
mod figure;
mod presses;
mod strangers;
mod verdicts;

pub use design::Design;
pub use figure::few_figures;
pub use presses::{FewRow, Way, presses};
pub use strangers::{Stranger, StrangerRow, strangers};
pub use verdicts::{VerdictRow, verdicts};

use super::StudyError;

/// Size of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FewSize {
    /// Number of new sensors with each number of presses.
    pub sensors: usize,
    /// Number of new sensors that are calibrated without a prior, which takes longer.
    pub without: usize,
    /// Number of new contacts on each sensor.
    pub tests: usize,
    /// Number of good sensors in the search for strangers.
    pub good: usize,
    /// Number of strangers of each kind.
    pub strangers: usize,
    /// Number of sensors that are judged.
    pub judged: usize,
}

impl FewSize {
    /// Complete study.
    pub const WHOLE: FewSize =
        FewSize { sensors: 150, without: 20, tests: 300, good: 1000, strangers: 100, judged: 1000 };
    /// Small study for a first look, and for tests. Its numbers mean little.
    pub const QUICK: FewSize = FewSize { sensors: 6, without: 1, tests: 100, good: 20, strangers: 4, judged: 10 };
}

/// First seeds of the sensors that make the prior, of the new sensors, of the good ones and strangers, and of the judged ones.
const PRIOR_SEEDS: u64 = 0;
const NEW_SEEDS: u64 = 1000;
const GOOD_SEEDS: u64 = 10_000;
const JUDGED_SEEDS: u64 = 20_000;

/// Returns an error for a study that can't be made.
fn broken(why: impl std::fmt::Display) -> StudyError {
    StudyError::Broken { seed: PRIOR_SEEDS, why: why.to_string() }
}

#[cfg(test)]
mod tests {
    use super::design::{SIDE, cells};
    use super::*;
    use crate::solver::{Belongs, Setting};
    use crate::study::methods::NoiseReference;
    use crate::study::methods::specimen::grid;

    #[test]
    fn noise_of_the_prior_is_that_of_one_sensor() {
        for noise in NoiseReference::ALL {
            let design = Design::papers(noise);
            let prior = design.prior().unwrap();
            let setting = Setting::of_layout(Some(design.layout()));
            let few = prior.sibling(&design.calibration(NEW_SEEDS, &grid(SIDE)).unwrap(), &setting).unwrap();
            let whole = design.calibration(NEW_SEEDS, &grid(SIDE)).unwrap();
            let whole = crate::solver::fit("surrogate", &whole, &setting).unwrap();
            use crate::quantity::Place;
            use crate::solver::Solver as _;
            for at in [Place::new(0.0, 0.0), Place::new(3.0, 2.0), Place::new(-5.0, 1.0)] {
                let few = few.model.fitted().expected(at, 1.0).unwrap().mean_distance_mm();
                let whole = whole.expected(at, 1.0).unwrap().mean_distance_mm();
                println!("{} {at:?} few {few:.4} whole {whole:.4}", noise.name());
            }
            assert_eq!(few.belongs, Belongs::Typical);
            let _ = cells(1, 1);
        }
    }
}
