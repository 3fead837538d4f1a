//! Control charts of a batch: a bench that drifts is distinguished from sensors that drift.
//!
//! A reference sensor is measured again and again between the sensors of the batch. It doesn't change, so its changes are those
//! of the bench. The values of the sensors are corrected by them, interpolated between two measurements of the reference. Both
//! series are charted as exponentially weighted means. Only a measurement of the reference decides what changed. If a sensor looks
//! unusual, [`Charts::is_reference_due`] asks for the reference at once.

use super::Cause;
use palpate_core::quantity::Ewma;

/// Largest expected standard deviation of the bench, as a fraction of that of the sensors. A bench that repeats worse than this
/// raises alarms, because its own deviation then matters.
pub(crate) const BENCH_SHARE: f64 = 0.2;

/// Weights of the newest value.
const REFERENCE_WEIGHT: f64 = 0.5;
const SENSOR_WEIGHT: f64 = 0.4;

/// Limits of both charts in standard deviations. The false alarms of 20 sensors were measured in simulation: see the test.
pub const LIMIT_SIGMAS: f64 = 3.15;
/// Statistic of the sensors from which the reference is measured at once.
const SUSPECT_SIGMAS: f64 = 2.5;

/// Normal values of a quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalValues {
    /// Mean of the design.
    pub mean: f64,
    /// Standard deviation of the sensors of the design.
    pub sd: f64,
    /// Standard deviation of repeated measurements of one sensor.
    pub reference_sd: f64,
    /// Number of sensors that gave mean and standard deviation.
    pub sensors: usize,
}

/// Charts of one quantity of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Charts {
    normal: NormalValues,
    /// First value of the reference, which the others are compared with.
    first: Option<f64>,
    /// Latest change of the reference, in standard deviations of the sensors.
    latest: f64,
    reference: Ewma,
    sensors: Ewma,
    /// Values of the sensors since the latest measurement of the reference.
    open: Vec<f64>,
}

/// A change that a chart shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChartedChange {
    /// What changed.
    pub cause: Cause,
    /// Statistic of the chart, in standard deviations.
    pub sigmas: f64,
}

impl Charts {
    /// Begins the charts of a quantity.
    pub fn new(normal: NormalValues) -> Self {
        let (reference, sensors) = (Ewma::new(REFERENCE_WEIGHT), Ewma::new(SENSOR_WEIGHT));
        Charts { normal, first: None, latest: 0.0, reference, sensors, open: Vec::new() }
    }

    /// Adds the value of a sensor.
    pub fn add(&mut self, value: f64) {
        self.open.push((value - self.normal.mean) / self.normal.sd);
    }

    /// Whether the sensors since the latest measurement of the reference look unusual.
    pub fn is_reference_due(&self) -> bool {
        let chart = self.open.iter().fold(self.sensors, |chart, value| chart.with(value - self.latest));
        chart.is_changed(self.of_mean(), SUSPECT_SIGMAS)
    }

    /// Adds a measurement of the reference. Returns the change that the charts then show.
    pub fn add_reference(&mut self, value: f64) -> Option<ChartedChange> {
        let Some(first) = self.first else {
            self.first = Some(value);
            return None;
        };
        let now = (value - first) / self.normal.sd;
        let (before, steps) = (self.latest, (self.open.len() + 1) as f64);
        for (index, value) in std::mem::take(&mut self.open).into_iter().enumerate() {
            let bench = before + (now - before) * (index + 1) as f64 / steps;
            self.sensors = self.sensors.with(value - bench);
        }
        self.latest = now;
        self.reference = self.reference.with(now / self.bench_share());
        // the first measurement deviates as much as the others
        let [bench, batch] = self.sigmas();
        if self.reference.is_changed(1.0, LIMIT_SIGMAS) {
            Some(ChartedChange { cause: Cause::Bench, sigmas: bench })
        } else {
            let is_changed = self.sensors.is_changed(self.of_mean(), LIMIT_SIGMAS);
            is_changed.then_some(ChartedChange { cause: Cause::Batch, sigmas: batch })
        }
    }

    /// Returns the statistics of the reference and of the sensors, in standard deviations.
    pub fn sigmas(&self) -> [f64; 2] {
        [self.reference.sigmas(1.0), self.sensors.sigmas(self.of_mean())]
    }

    /// Variance of the design's mean and of the first reference, relative to that of one sensor.
    fn of_mean(&self) -> f64 {
        1.0 / self.normal.sensors.max(1) as f64 + self.bench_share().powi(2)
    }

    /// Standard deviation of the reference's values, relative to that of the sensors.
    fn bench_share(&self) -> f64 {
        BENCH_SHARE.max(self.normal.reference_sd / self.normal.sd)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::quantity::stream;
    use rand::distr::Distribution;
    use rand_distr::StandardNormal;

    const SENSORS: usize = 20;
    const EVERY: usize = 2;
    const TRIALS: u64 = 4000;

    /// Returns the number of the sensor at which the first change was shown, and its cause, if bench or batch drift by these
    /// standard deviations a sensor.
    fn shown(seed: u64, bench_drift: f64, batch_drift: f64) -> Option<(usize, Cause)> {
        let mut rng = stream(seed, 0, "control chart");
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut charts =
            Charts::new(NormalValues { mean: normal() / 5f64.sqrt(), sd: 1.0, reference_sd: 0.0, sensors: 5 });
        charts.add_reference(BENCH_SHARE * normal());
        let mut since = 0;
        for sensor in 1..=SENSORS {
            let bench = bench_drift * sensor as f64;
            charts.add(bench + batch_drift * sensor as f64 + normal());
            since += 1;
            if since == EVERY || charts.is_reference_due() {
                since = 0;
                if let Some(ChartedChange { cause, .. }) = charts.add_reference(bench + BENCH_SHARE * normal()) {
                    return Some((sensor, cause));
                }
            }
        }
        None
    }

    fn percent(is: impl Fn(u64) -> bool) -> f64 {
        100.0 * (0..TRIALS).filter(|seed| is(*seed)).count() as f64 / TRIALS as f64
    }

    #[test]
    fn a_drift_is_reported_right_within_five_sensors_and_false_alarms_are_few() {
        let is_reported = |cause: Cause, drift: [f64; 2]| {
            percent(|seed| matches!(shown(seed, drift[0], drift[1]), Some((sensor, of)) if sensor <= 5 && of == cause))
        };
        let bench = is_reported(Cause::Bench, [1.0, 0.0]);
        let batch = is_reported(Cause::Batch, [0.0, 1.0]);
        let false_alarms = percent(|seed| shown(seed, 0.0, 0.0).is_some());
        // a batch charts two quantities
        let of_two = percent(|seed| [seed, TRIALS + seed].iter().any(|seed| shown(*seed, 0.0, 0.0).is_some()));
        println!("bench {bench:.2} %, batch {batch:.2} %, false alarms {false_alarms:.2} %, of two {of_two:.2} %");
        assert!(bench >= 95.0 && batch >= 95.0, "{bench} {batch}");
        assert!(false_alarms <= 5.0 && of_two <= 5.0, "{false_alarms} {of_two}");
    }
}
