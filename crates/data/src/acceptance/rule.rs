//! Requirements on a sensor: a rule with its limits.

/// Method of comparing a figure with its limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Decision {
    /// The figure itself is within the limit (ILAC-G8: simple acceptance, no guard band).
    #[default]
    Simple,
    /// The figure's one-sided 95 % upper bound is within the limit (ILAC-G8: guarded acceptance; the guard band is the bound
    /// minus the figure).
    Guarded,
}

/// An acceptance rule: `[accept]` of a recipe, or a separate file.
#[derive(Clone, Debug, PartialEq)]
pub struct Rule {
    /// Method of comparing figures with their limits.
    pub decision: Decision,
    /// Method that finds places and forces.
    pub method: String,
    /// Smallest number of calibration presses that count.
    pub calibration_presses_least: usize,
    /// Smallest number of test presses that count.
    pub test_presses_least: usize,
    /// Whether presses that were held out of the calibration's own table or run can be the test.
    pub holdout: bool,
    /// The limits, at least one, in the order of [`Figure::ALL`].
    pub limits: Vec<Limit>,
    /// File that gave the rule after the run; `None` if the run's own recipe gave it.
    pub afterwards_by: Option<String>,
}

/// A figure and its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// The figure.
    pub figure: Figure,
    /// Largest accepted value, in the figure's unit; for a fraction the smallest accepted value, 0 to 1.
    pub limit: f64,
    /// For a fraction: the largest error that counts, mm or N.
    pub reach: Option<f64>,
}

/// Quantities that can have a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// Mean distance between true and found place, mm.
    LocationMean,
    /// 95th percentile of this distance, mm.
    LocationP95,
    /// Fraction of the test presses that are found within a distance, 0 to 1.
    LocationWithin,
    /// Mean absolute force error, N.
    ForceMean,
    /// 95th percentile of the absolute force error, N.
    ForceP95,
    /// Fraction of the test presses whose force is found within an error, 0 to 1.
    ForceWithin,
    /// Largest repeatability of a unit while loading, % of full scale.
    Repeatability,
    /// Largest hysteresis of a unit, % of full scale.
    Hysteresis,
    /// Largest hysteresis of a unit, % of reading.
    HysteresisOfReading,
    /// Largest deviation of a unit from its straight line, % of full scale.
    Linearity,
    /// Largest zero return of a unit, % of full scale.
    ZeroReturn,
    /// Largest noise of a channel in air, % of its largest output in the calibration.
    Noise,
    /// Number of dead or saturated channels.
    BrokenChannels,
    /// Number of flagged presses of calibration and test.
    FlaggedPresses,
}

impl Decision {
    /// Returns the word in recipes and reports.
    pub const fn word(self) -> &'static str {
        match self {
            Decision::Simple => "simple",
            Decision::Guarded => "guarded",
        }
    }
}

impl Figure {
    /// All figures, in the order in which they are reported.
    pub const ALL: [Figure; 14] = [
        Figure::LocationMean,
        Figure::LocationP95,
        Figure::LocationWithin,
        Figure::ForceMean,
        Figure::ForceP95,
        Figure::ForceWithin,
        Figure::Repeatability,
        Figure::Hysteresis,
        Figure::HysteresisOfReading,
        Figure::Linearity,
        Figure::ZeroReturn,
        Figure::Noise,
        Figure::BrokenChannels,
        Figure::FlaggedPresses,
    ];

    /// Returns the key that sets the limit.
    pub const fn key(self) -> &'static str {
        match self {
            Figure::LocationMean => "location_mean_mm",
            Figure::LocationP95 => "location_p95_mm",
            Figure::LocationWithin => "location_within",
            Figure::ForceMean => "force_mean_n",
            Figure::ForceP95 => "force_p95_n",
            Figure::ForceWithin => "force_within",
            Figure::Repeatability => "repeatability_percent",
            Figure::Hysteresis => "hysteresis_percent",
            Figure::HysteresisOfReading => "hysteresis_of_reading_percent",
            Figure::Linearity => "linearity_percent",
            Figure::ZeroReturn => "zero_return_percent",
            Figure::Noise => "noise_percent",
            Figure::BrokenChannels => "broken_channels_most",
            Figure::FlaggedPresses => "flagged_presses_most",
        }
    }

    /// Returns the name without the unit.
    pub const fn name(self) -> &'static str {
        match self {
            Figure::LocationMean => "location error, mean",
            Figure::LocationP95 => "location error, 95th percentile",
            Figure::LocationWithin => "location error, share within",
            Figure::ForceMean => "force error, mean",
            Figure::ForceP95 => "force error, 95th percentile",
            Figure::ForceWithin => "force error, share within",
            Figure::Repeatability => "repeatability, worst unit",
            Figure::Hysteresis => "hysteresis, worst unit",
            Figure::HysteresisOfReading => "hysteresis of reading, worst unit",
            Figure::Linearity => "linearity, worst unit",
            Figure::ZeroReturn => "zero return, worst unit",
            Figure::Noise => "noise, worst channel",
            Figure::BrokenChannels => "broken channels",
            Figure::FlaggedPresses => "flagged presses",
        }
    }

    /// Returns the name, with the largest error that counts for a fraction.
    pub fn full_name(self, reach: Option<f64>) -> String {
        match (self, reach) {
            (Figure::LocationWithin, Some(mm)) => format!("{} {mm} mm", self.name()),
            (Figure::ForceWithin, Some(n)) => format!("{} {n} N", self.name()),
            _ => self.name().to_owned(),
        }
    }

    /// Returns the unit of displayed values; fractions are displayed in percent.
    pub const fn unit(self) -> &'static str {
        match self {
            Figure::LocationMean | Figure::LocationP95 => "mm",
            Figure::ForceMean | Figure::ForceP95 => "N",
            Figure::BrokenChannels | Figure::FlaggedPresses => "",
            _ => "%",
        }
    }

    /// Returns the number of displayed decimals.
    pub const fn digits(self) -> usize {
        match self {
            Figure::LocationMean | Figure::LocationP95 => 3,
            Figure::ForceMean | Figure::ForceP95 => 4,
            Figure::LocationWithin | Figure::ForceWithin => 1,
            Figure::BrokenChannels | Figure::FlaggedPresses => 0,
            _ => 2,
        }
    }

    /// Whether the figure is a fraction, which has a lower limit.
    pub const fn is_share(self) -> bool {
        matches!(self, Figure::LocationWithin | Figure::ForceWithin)
    }

    /// Whether the figure is determined by the test.
    pub const fn is_of_test(self) -> bool {
        matches!(
            self,
            Figure::LocationMean
                | Figure::LocationP95
                | Figure::LocationWithin
                | Figure::ForceMean
                | Figure::ForceP95
                | Figure::ForceWithin
        )
    }

    /// Whether the figure is the worst of the units' characteristics.
    pub(crate) const fn is_of_units(self) -> bool {
        matches!(
            self,
            Figure::Repeatability
                | Figure::Hysteresis
                | Figure::HysteresisOfReading
                | Figure::Linearity
                | Figure::ZeroReturn
        )
    }

    /// Returns a value with `digits` decimals, without its unit; a fraction in percent.
    pub fn shown(self, value: f64, digits: usize) -> String {
        let value = if self.is_share() { 100.0 * value } else { value };
        if value.abs() < LARGE { format!("{value:.digits$}") } else { format!("{value:.1e}") }
    }
}

/// Value from which an exponent is shown.
const LARGE: f64 = 1e5;

/// Returns the part of a limit that a figure's value uses; a fraction uses it by what it lacks. Above 1 the limit is exceeded.
pub fn limit_used(is_share: bool, value: f64, limit: f64) -> f64 {
    let part = if is_share { (1.0 - value) / (1.0 - limit) } else { value / limit };
    if part.is_nan() { 0.0 } else { part }
}
