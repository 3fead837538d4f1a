//! Results of a certificate: each value with its unit, its uncertainty, and its number of readings.

use crate::report::{SensorResults, Subject};
use palpate_core::quantity::percentile;
use palpate_data::acceptance::bound::{coverage_factor, quantile_interval, quantile_interval_least};
use palpate_data::dataset::characteristics::{
    RepeatUncertainty, Repeatability, Staircases, UnitCharacteristics, characterise, repeats,
};
use palpate_solver::{Evaluation, PressError};
use statrs::statistics::Statistics as _;

/// A table of results.
pub(super) struct ResultTable {
    /// Title of the table.
    pub title: &'static str,
    /// Definitions of the values, and the components of their uncertainties.
    pub method: String,
    /// Values of the table.
    pub rows: Vec<ResultRow>,
}

/// One result.
pub(super) struct ResultRow {
    /// Name of the result.
    pub name: String,
    /// Value, in `unit`.
    pub value: f64,
    /// Unit of the value.
    pub unit: Unit,
    /// Number of decimals.
    pub digits: usize,
    /// Uncertainty of the value.
    pub uncertainty: Uncertainty,
    /// Number of presses or readings.
    pub n: usize,
}

/// Units of results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unit {
    /// Millimetre.
    Millimetre,
    /// Newton.
    Newton,
    /// A hundredth.
    Percent,
}

/// Uncertainty of a result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Uncertainty {
    /// Expanded uncertainty, 95 %, and its coverage factor.
    Expanded {
        /// Expanded uncertainty, in the result's unit.
        expanded: f64,
        /// Coverage factor: 2, or larger if there are few repeats.
        k: f64,
    },
    /// 95 % coverage interval.
    Interval(f64, f64),
    /// No uncertainty is stated.
    NotStated,
}

impl Unit {
    /// Returns the symbol for people.
    pub(super) const fn symbol(self) -> &'static str {
        match self {
            Unit::Millimetre => "mm",
            Unit::Newton => "N",
            Unit::Percent => "%",
        }
    }

    /// Returns the unit in D-SI.
    pub(super) const fn d_si(self) -> &'static str {
        match self {
            Unit::Millimetre => "\\milli\\metre",
            Unit::Newton => "\\newton",
            Unit::Percent => "\\percent",
        }
    }
}

/// Function that returns the error of a press.
type Error = fn(&PressError) -> Option<f64>;

/// Returns all measured results of a sensor.
pub(super) fn results(subject: &Subject, judged: &SensorResults) -> Vec<ResultTable> {
    let test = judged.decisive().map(|evaluation| of_test(subject, judged, evaluation));
    let units = Staircases::of_run(&subject.presses, subject.layout()).map(|staircases| of_units(&staircases));
    test.into_iter().chain(units).collect()
}

/// Returns the errors of location and force.
fn of_test(subject: &Subject, judged: &SensorResults, evaluation: &Evaluation) -> ResultTable {
    let truths = [subject.u_place_mm(), judged.u_force_n];
    let kinds: [(&str, Unit, usize, Error); 2] = [
        ("location error", Unit::Millimetre, 3, |press| Some(press.location_error_mm)),
        ("force error", Unit::Newton, 4, |press| press.force_error_n),
    ];
    let (mut rows, mut few) = (Vec::new(), String::new());
    for ((name, unit, digits, error), truth) in kinds.into_iter().zip(truths) {
        let Some(mut sizes) = evaluation.presses.iter().map(error).collect::<Option<Vec<f64>>>() else { continue };
        let n = sizes.len();
        let scatter = if n > 1 { sizes.iter().std_dev() / (n as f64).sqrt() } else { f64::NAN };
        let u = scatter.hypot(truth.unwrap_or(0.0));
        // Welch and Satterthwaite: the true value has at least as many degrees of freedom
        let k = coverage_factor((n as f64 - 1.0) * (u / scatter).powi(4));
        let uncertainty =
            if u.is_finite() { Uncertainty::Expanded { expanded: k * u, k } } else { Uncertainty::NotStated };
        let value = sizes.iter().mean();
        rows.push(ResultRow { name: format!("{name}, mean"), value, unit, digits, uncertainty, n });
        sizes.sort_by(f64::total_cmp);
        let interval = quantile_interval(&sizes, 0.95);
        if interval.is_none() {
            let least = quantile_interval_least(0.95);
            few = format!(
                " The 95th percentiles have no stated interval, because it needs {least} presses and there are {n}."
            );
        }
        let uncertainty = interval.map_or(Uncertainty::NotStated, |(low, high)| Uncertainty::Interval(low, high));
        let value = percentile(&sizes, 0.95);
        rows.push(ResultRow { name: format!("{name}, 95th percentile"), value, unit, digits, uncertainty, n });
    }
    let included = |what: &str, truth: Option<f64>, unit: &str| match truth {
        Some(u) => format!("The standard uncertainty of the {what}, {u:.4} {unit}, is included in the means."),
        None => format!("The uncertainty of the {what} isn't known and not included."),
    };
    let method = format!(
        "Presses of known place and force, solved by the method {}. Intervals of percentiles are order statistics with 95 % coverage.{few} {} {}",
        evaluation.solver,
        included("places", truths[0], "mm"),
        included("forces", truths[1], "N")
    );
    ResultTable { title: "Errors of the test", method, rows }
}

type ResultValue = fn(&UnitCharacteristics) -> Option<f64>;
type IsKnown = fn(&UnitCharacteristics) -> Option<RepeatUncertainty>;

/// Characteristics except repeatability: the name, the value, and whether the uncertainty is known.
const OTHERS: [(&str, ResultValue, IsKnown); 4] = [
    ("hysteresis", |unit| unit.hysteresis_percent, |unit| unit.hysteresis_known),
    ("hysteresis, % of reading", |unit| unit.hysteresis_of_reading_percent, |unit| unit.hysteresis_of_reading_known),
    ("linearity", |unit| unit.linearity_percent, |unit| unit.linearity_known),
    ("zero return", |unit| unit.zero_return_percent, |unit| unit.zero_return_known),
];

/// Returns the characteristics of each unit, % of full scale.
fn of_units(staircases: &Staircases) -> ResultTable {
    let definition = Repeatability::default();
    let mut rows = Vec::new();
    for (unit, readings) in characterise(staircases, definition).into_iter().zip(&staircases.readings) {
        let row = |name: &str, value, uncertainty| {
            let name = format!("unit {}, {name}", unit.name());
            ResultRow { name, value, unit: Unit::Percent, digits: 2, uncertainty, n: repeats(readings) }
        };
        let repeated = [
            ("repeatability, loading", unit.repeatability_loading_percent, unit.repeatability_loading_interval_percent),
            (
                "repeatability, unloading",
                unit.repeatability_unloading_percent,
                unit.repeatability_unloading_interval_percent,
            ),
        ];
        for (name, value, interval) in repeated {
            let uncertainty = interval.map_or(Uncertainty::NotStated, |(low, high)| Uncertainty::Interval(low, high));
            rows.extend(value.map(|value| row(name, value, uncertainty)));
        }
        for (name, value, known) in OTHERS {
            let known = known(&unit);
            let uncertainty = known.map_or(Uncertainty::NotStated, |RepeatUncertainty { u, n, .. }| {
                let k = coverage_factor(n as f64 - 1.0);
                Uncertainty::Expanded { expanded: k * u, k }
            });
            let n = known.map_or(repeats(readings), |known| known.n);
            rows.extend(value(&unit).map(|value| ResultRow { n, ..row(name, value, uncertainty) }));
        }
    }
    let method = format!(
        "Staircases of force on each unit, % of full scale. Repeatability: {}. Uncertainties of the others are from \
         the scatter of the repeats only. The other terms are defined in the report.",
        definition.definition()
    );
    ResultTable { title: "Characteristics of each unit", method, rows }
}
