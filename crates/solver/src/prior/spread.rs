//! How the sensors of a design differ.

use crate::adapt::Moved;
use serde::{Deserialize, Serialize};

/// Standard deviations of the changes between sensors of a design.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DesignSpread {
    /// Of one unit of a sensor, about what all units of the sensor have in common.
    pub own: Deviations,
    /// Of what all units of a sensor have in common.
    pub common: Deviations,
}

/// Standard deviations of a change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Deviations {
    /// Of the relative gain.
    pub gain: f64,
    /// Of the displacement along x and along y, mm.
    pub place_mm: f64,
    /// Of the relative width.
    pub width: f64,
}

impl Deviations {
    pub(super) fn squares(&self) -> Moved {
        let Deviations { gain, place_mm, width } = *self;
        Moved::column([gain, place_mm, place_mm, width]).map(|sd| sd * sd)
    }

    pub(super) fn of(squares: &Moved) -> Self {
        let place_mm = (0.5 * (squares[1] + squares[2])).sqrt();
        Deviations { gain: squares[0].sqrt(), place_mm, width: squares[3].sqrt() }
    }
}

impl DesignSpread {
    /// Returns the spread of a further sensor from the changes of some sensors about their mean: sensors x units.
    pub(super) fn of(found: &[Vec<Moved>]) -> Self {
        let (sensors, units) = (found.len() as f64, found[0].len() as f64);
        let mean = |of: &[Moved]| of.iter().copied().sum::<Moved>() / of.len() as f64;
        let square = |moved: Moved| moved.times(moved);
        let (mut own, mut common) = (Moved::ZERO, Moved::ZERO);
        for sensor in found {
            let mean = mean(sensor);
            common += square(mean);
            own += sensor.iter().map(|moved| square(*moved - mean)).sum::<Moved>();
        }
        // the mean of the sensors is subtracted; a further sensor differs from this mean and not from the true one
        let further = 1.0 + 1.0 / sensors;
        let own = own * further / ((sensors - 1.0) * (units - 1.0).max(1.0));
        let common = common * further / (sensors - 1.0);
        DesignSpread { own: Deviations::of(&own), common: Deviations::of(&common) }
    }
}

/// Returns the changes of each sensor about the mean of all sensors, for each unit.
pub(super) fn about_their_mean(changes: &[Vec<Moved>]) -> Vec<Vec<Moved>> {
    let mean = |unit: usize| changes.iter().map(|of| of[unit]).sum::<Moved>() / changes.len() as f64;
    let means: Vec<Moved> = (0..changes[0].len()).map(mean).collect();
    changes.iter().map(|of| of.iter().zip(&means).map(|(moved, mean)| *moved - *mean).collect()).collect()
}
