//! Control charts of all quantities of a batch, from its events.

use super::chart::{ChartedChange, Charts, NormalValues};
use super::{Charted, Ended};
use palpate_data::dataset::Status;
use palpate_solver::UnitChange;

/// Charts of the quantities that a design's prior knows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Monitor {
    charts: Vec<(Quantity, Charts)>,
    shown: Vec<(Quantity, ChartedChange)>,
}

/// Quantities that are charted. They are means over all outputs of a sensor, compared with the design.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Mean gain.
    Gain,
    /// Mean relative increase of the width.
    Width,
}

impl Quantity {
    /// All quantities.
    pub const ALL: [Quantity; 2] = [Quantity::Gain, Quantity::Width];

    /// Returns the name in events and on pages.
    pub const fn name(self) -> &'static str {
        match self {
            Quantity::Gain => "mean gain",
            Quantity::Width => "mean width",
        }
    }

    /// Returns the value of a sensor; `None` without its change.
    pub fn of(self, change: &[UnitChange]) -> Option<f64> {
        let value = |unit: &UnitChange| match self {
            Quantity::Gain => unit.gain,
            Quantity::Width => unit.width,
        };
        (!change.is_empty()).then(|| change.iter().map(value).sum::<f64>() / change.len() as f64)
    }
}

impl Monitor {
    /// Begins the charts of a batch.
    pub fn new(charted: &[Charted]) -> Self {
        let charts = Quantity::ALL.into_iter().filter_map(|quantity| {
            let of_it = charted.iter().find(|charted| charted.quantity == quantity.name())?;
            let Charted { mean, sd, reference_sd, sensors, .. } = *of_it;
            Some((quantity, Charts::new(NormalValues { mean, sd, reference_sd, sensors })))
        });
        Monitor { charts: charts.collect(), shown: Vec::new() }
    }

    /// Adds the result of a sensor or of the reference sensor.
    pub fn take_in(&mut self, ended: &Ended) {
        self.shown.clear();
        if ended.status != Status::Complete {
            return;
        }
        for (quantity, charts) in &mut self.charts {
            let Some(value) = quantity.of(&ended.change) else { continue };
            if ended.reference {
                self.shown.extend(charts.add_reference(value).map(|shown| (*quantity, shown)));
            } else {
                charts.add(value);
            }
        }
    }

    /// Whether the latest sensors look unusual, so that the reference sensor is due.
    pub fn is_reference_due(&self) -> bool {
        self.charts.iter().any(|(_, charts)| charts.is_reference_due())
    }

    /// Returns the changes that the latest result shows.
    pub fn shown(&self) -> &[(Quantity, ChartedChange)] {
        &self.shown
    }

    /// Returns the charts.
    pub fn charts(&self) -> &[(Quantity, Charts)] {
        &self.charts
    }
}
