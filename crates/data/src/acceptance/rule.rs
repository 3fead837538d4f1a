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
pub struct AcceptanceRule {
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
    /// Whether a run with presses that a person called sound gets a verdict.
    pub called_sound: bool,
    /// The limits, at least one, in the order of [`LimitedFigure::ALL`].
    pub limits: Vec<Limit>,
    /// File that gave the rule after the run; `None` if the run's own recipe gave it.
    pub afterwards_by: Option<String>,
}

/// A figure and its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// The figure.
    pub figure: LimitedFigure,
    /// Largest accepted value, in the figure's unit; for a fraction the smallest accepted value, 0 to 1.
    pub limit: f64,
    /// For a fraction: the largest error that counts, mm or N.
    pub reach: Option<f64>,
}

/// Quantities that can have a limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LimitedFigure {
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
    /// Mean absolute depth error, mm.
    DepthMean,
    /// 95th percentile of the absolute depth error, mm.
    DepthP95,
    /// Fraction of the test presses whose depth is found within an error, 0 to 1.
    DepthWithin,
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
    /// Largest noise of a channel without load, % of its largest output in the calibration.
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

impl LimitedFigure {
    /// All figures, in the order in which they are reported.
    pub const ALL: [LimitedFigure; 17] = [
        LimitedFigure::LocationMean,
        LimitedFigure::LocationP95,
        LimitedFigure::LocationWithin,
        LimitedFigure::ForceMean,
        LimitedFigure::ForceP95,
        LimitedFigure::ForceWithin,
        LimitedFigure::DepthMean,
        LimitedFigure::DepthP95,
        LimitedFigure::DepthWithin,
        LimitedFigure::Repeatability,
        LimitedFigure::Hysteresis,
        LimitedFigure::HysteresisOfReading,
        LimitedFigure::Linearity,
        LimitedFigure::ZeroReturn,
        LimitedFigure::Noise,
        LimitedFigure::BrokenChannels,
        LimitedFigure::FlaggedPresses,
    ];

    /// Returns the key that sets the limit.
    pub const fn key(self) -> &'static str {
        match self {
            LimitedFigure::LocationMean => "location_mean_mm",
            LimitedFigure::LocationP95 => "location_p95_mm",
            LimitedFigure::LocationWithin => "location_within",
            LimitedFigure::ForceMean => "force_mean_n",
            LimitedFigure::ForceP95 => "force_p95_n",
            LimitedFigure::ForceWithin => "force_within",
            LimitedFigure::DepthMean => "depth_mean_mm",
            LimitedFigure::DepthP95 => "depth_p95_mm",
            LimitedFigure::DepthWithin => "depth_within",
            LimitedFigure::Repeatability => "repeatability_percent",
            LimitedFigure::Hysteresis => "hysteresis_percent",
            LimitedFigure::HysteresisOfReading => "hysteresis_of_reading_percent",
            LimitedFigure::Linearity => "linearity_percent",
            LimitedFigure::ZeroReturn => "zero_return_percent",
            LimitedFigure::Noise => "noise_percent",
            LimitedFigure::BrokenChannels => "broken_channels_most",
            LimitedFigure::FlaggedPresses => "flagged_presses_most",
        }
    }

    /// Returns the name without the unit.
    pub const fn name(self) -> &'static str {
        match self {
            LimitedFigure::LocationMean => "location error, mean",
            LimitedFigure::LocationP95 => "location error, 95th percentile",
            LimitedFigure::LocationWithin => "location error, share within",
            LimitedFigure::ForceMean => "force error, mean",
            LimitedFigure::ForceP95 => "force error, 95th percentile",
            LimitedFigure::ForceWithin => "force error, share within",
            LimitedFigure::DepthMean => "depth error, mean",
            LimitedFigure::DepthP95 => "depth error, 95th percentile",
            LimitedFigure::DepthWithin => "depth error, share within",
            LimitedFigure::Repeatability => "repeatability, worst unit",
            LimitedFigure::Hysteresis => "hysteresis, worst unit",
            LimitedFigure::HysteresisOfReading => "hysteresis of reading, worst unit",
            LimitedFigure::Linearity => "linearity, worst unit",
            LimitedFigure::ZeroReturn => "zero return, worst unit",
            LimitedFigure::Noise => "noise, worst channel",
            LimitedFigure::BrokenChannels => "broken channels",
            LimitedFigure::FlaggedPresses => "flagged presses",
        }
    }

    /// Returns the name, with the largest error that counts for a fraction.
    pub fn full_name(self, reach: Option<f64>) -> String {
        match (self, reach) {
            (LimitedFigure::LocationWithin | LimitedFigure::DepthWithin, Some(mm)) => {
                format!("{} {mm} mm", self.name())
            }
            (LimitedFigure::ForceWithin, Some(n)) => format!("{} {n} N", self.name()),
            _ => self.name().to_owned(),
        }
    }

    /// Returns the unit of displayed values; fractions are displayed in percent.
    pub const fn unit(self) -> &'static str {
        match self {
            LimitedFigure::LocationMean | LimitedFigure::LocationP95 => "mm",
            LimitedFigure::DepthMean | LimitedFigure::DepthP95 => "mm",
            LimitedFigure::ForceMean | LimitedFigure::ForceP95 => "N",
            LimitedFigure::BrokenChannels | LimitedFigure::FlaggedPresses => "",
            _ => "%",
        }
    }

    /// Returns the number of displayed decimals.
    pub const fn digits(self) -> usize {
        match self {
            LimitedFigure::LocationMean | LimitedFigure::LocationP95 => 3,
            LimitedFigure::DepthMean | LimitedFigure::DepthP95 => 3,
            LimitedFigure::ForceMean | LimitedFigure::ForceP95 => 4,
            LimitedFigure::LocationWithin | LimitedFigure::ForceWithin | LimitedFigure::DepthWithin => 1,
            LimitedFigure::BrokenChannels | LimitedFigure::FlaggedPresses => 0,
            _ => 2,
        }
    }

    /// Whether the figure is a fraction, which has a lower limit.
    pub const fn is_share(self) -> bool {
        matches!(self, LimitedFigure::LocationWithin | LimitedFigure::ForceWithin | LimitedFigure::DepthWithin)
    }

    /// Whether the figure is determined by the test.
    pub const fn is_of_test(self) -> bool {
        matches!(
            self,
            LimitedFigure::LocationMean
                | LimitedFigure::LocationP95
                | LimitedFigure::LocationWithin
                | LimitedFigure::ForceMean
                | LimitedFigure::ForceP95
                | LimitedFigure::ForceWithin
                | LimitedFigure::DepthMean
                | LimitedFigure::DepthP95
                | LimitedFigure::DepthWithin
        )
    }

    /// Whether the figure is the worst of the units' characteristics.
    pub(crate) const fn is_of_units(self) -> bool {
        matches!(
            self,
            LimitedFigure::Repeatability
                | LimitedFigure::Hysteresis
                | LimitedFigure::HysteresisOfReading
                | LimitedFigure::Linearity
                | LimitedFigure::ZeroReturn
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
