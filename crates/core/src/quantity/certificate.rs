//! Accuracy of instruments: their certificates, and the check of a load cell with a known weight.

/// Coverage factor of an expanded uncertainty that doesn't state its own: 95 % of a normal distribution.
pub const COVERAGE: f64 = 2.0;

/// Largest difference of a load cell's gain from 1 that can be adjusted for. A larger difference is a fault and is never adjusted
/// for.
pub const GAIN_OFF_MOST: f64 = 0.1;

/// A load cell's calibration certificate.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadCellCertificate {
    /// Number of the certificate.
    pub number: String,
    /// Date of the calibration, as year-month-day.
    pub date: String,
    /// Stated error of a reading.
    pub stated: StatedError,
    /// Change of the sensitivity with the temperature, if it is stated.
    pub temperature: Option<TemperatureEffect>,
}

/// Largest change of a load cell's sensitivity with its temperature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemperatureEffect {
    /// Change either way, percent of the reading per degree Celsius.
    pub percent_per_c: f64,
    /// Temperature at the calibration, degrees Celsius.
    pub calibrated_at_c: f64,
}

impl TemperatureEffect {
    /// Standard uncertainty of a force of this size at a temperature, N. No reading is corrected: any change of the sensitivity up to the
    /// stated one is equally likely.
    pub fn standard_uncertainty_n(&self, force_n: f64, temperature_c: f64) -> f64 {
        let change = self.percent_per_c / 100.0 * (temperature_c - self.calibrated_at_c);
        (change * force_n).abs() / 3f64.sqrt()
    }
}

/// Error of a reading, as stated in a certificate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StatedError {
    /// An expanded uncertainty and its coverage factor.
    Expanded {
        /// The expanded uncertainty, N.
        u_n: f64,
        /// Its coverage factor.
        k: f64,
    },
    /// An expanded uncertainty as a fraction of the force, and its coverage factor.
    Relative {
        /// The expanded uncertainty, percent of the force.
        u_percent: f64,
        /// Its coverage factor.
        k: f64,
    },
    /// Limits of error as a fraction of full scale. All errors within the limits are equally likely.
    Class {
        /// The limit of error either way, percent of full scale.
        class_percent: f64,
        /// Full scale, N.
        full_scale_n: f64,
    },
}

/// A stage's calibration certificate.
#[derive(Clone, Debug, PartialEq)]
pub struct StageCertificate {
    /// Number of the certificate.
    pub number: String,
    /// Date of the calibration, as year-month-day.
    pub date: String,
    /// Expanded uncertainty of a place along one axis, mm.
    pub u_mm: f64,
    /// Coverage factor.
    pub k: f64,
}

impl StageCertificate {
    /// Standard uncertainty of a place along one axis, mm.
    pub fn standard_uncertainty_mm(&self) -> f64 {
        self.u_mm / self.k
    }
}

impl LoadCellCertificate {
    /// Standard uncertainty of a force of this size, N.
    pub fn standard_uncertainty_n(&self, force_n: f64) -> f64 {
        match self.stated {
            StatedError::Expanded { u_n, k } => u_n / k,
            StatedError::Relative { u_percent, k } => u_percent / 100.0 * force_n.abs() / k,
            StatedError::Class { class_percent, full_scale_n } => class_percent / 100.0 * full_scale_n / 3f64.sqrt(),
        }
    }
}

/// Largest part of a force that may show on another axis without a warning.
pub const CROSSTALK_MOST: f64 = 0.02;

/// Gains and crosstalk of a load cell with three axes, measured with a known weight along each axis.
#[derive(Clone, Debug, PartialEq)]
pub struct AxesCheck {
    /// Readings per newton: a row for a force along x, y and the press each, with the readings of x, y and the press.
    pub along: [[f64; 3]; 3],
    /// Standard uncertainty of each of these numbers.
    pub u: f64,
    /// Date of the check, as year-month-day.
    pub date: String,
}

impl AxesCheck {
    /// Returns the largest crosstalk, with its sign, and its two axes: that of the force and that of the reading.
    pub fn crosstalk(&self) -> (f64, usize, usize) {
        let pairs = (0..3).flat_map(|force| (0..3).map(move |reading| (force, reading)));
        let others = pairs.filter(|(force, reading)| force != reading);
        let all = others.map(|(force, reading)| (self.along[force][reading], force, reading));
        all.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).unwrap_or_default()
    }

    /// Returns the part of each axis' standard uncertainty that the other axes cause, N, for the forces along x, y and the press. No
    /// reading is corrected, so the whole crosstalk counts (GUM F.2.4.5).
    pub fn crosstalk_n(&self, forces_n: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|reading| {
            let others = (0..3).filter(|force| *force != reading);
            let from = |force: usize| self.along[force][reading].hypot(self.u) * forces_n[force];
            others.map(|force| from(force).powi(2)).sum::<f64>().sqrt()
        })
    }

    /// Standard uncertainty of an axis' own gain, whose departure from 1 isn't corrected.
    pub fn gain_u(&self, axis: usize) -> f64 {
        (self.along[axis][axis] - 1.0).hypot(self.u)
    }
}

/// Gain of a load cell, measured with a known weight.
#[derive(Clone, Debug, PartialEq)]
pub struct WeightCheck {
    /// The weight's force, N.
    pub weight_n: f64,
    /// Expanded uncertainty of the weight's force, k = 2, N.
    pub weight_u_n: f64,
    /// Whether the weight hung from the tip. Otherwise it acted in the direction of contact.
    pub pull: bool,
    /// Cell reading of the weight, as a fraction of the weight; negative if the sign was wrong.
    pub gain: f64,
    /// Repeatability: standard deviation of the gain between repetitions.
    pub gain_sd: f64,
    /// Number of times that the weight was put on.
    pub times: u32,
    /// Date of the check, as year-month-day.
    pub date: String,
    /// Whether readings are divided by the gain from this check on.
    pub adjusted: bool,
}

impl WeightCheck {
    /// Standard uncertainty of the gain, from the weight's uncertainty and the repeatability of the mean.
    pub fn standard_uncertainty(&self) -> f64 {
        let weight = self.gain.abs() * self.weight_u_n / COVERAGE / self.weight_n;
        weight.hypot(self.gain_sd / f64::from(self.times.max(1)).sqrt())
    }

    /// Number that readings are divided by.
    pub fn divisor(&self) -> f64 {
        if self.adjusted { self.gain } else { 1.0 }
    }

    /// Largest difference of a gain from 1 that can be explained. It is twice the standard uncertainty of this check combined
    /// with that of the certificate, if there is one. The certificate isn't used for a gain that was adjusted for.
    pub fn explained(&self, certificate: Option<&LoadCellCertificate>) -> f64 {
        let certificate = certificate.filter(|_| !self.adjusted);
        let stated = certificate.map_or(0.0, |stated| stated.standard_uncertainty_n(self.weight_n) / self.weight_n);
        COVERAGE * self.standard_uncertainty().hypot(stated)
    }

    /// Whether the gain is near enough to 1 to be adjusted for. With a larger difference it is a fault.
    pub fn is_adjustable(&self) -> bool {
        (self.gain - 1.0).abs() <= GAIN_OFF_MOST
    }

    /// Whether the readings can be used. Either the gain is no fault and is adjusted for, or it is 1 within what check and
    /// certificate can show.
    pub fn is_sound(&self, certificate: Option<&LoadCellCertificate>) -> bool {
        self.is_adjustable() && (self.adjusted || (self.gain - 1.0).abs() <= self.explained(certificate))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn certificate(stated: StatedError) -> LoadCellCertificate {
        LoadCellCertificate { number: "1".to_owned(), date: "2026-05-04".to_owned(), stated, temperature: None }
    }

    fn check(gain: f64, adjusted: bool) -> WeightCheck {
        WeightCheck {
            weight_n: 0.5,
            weight_u_n: 0.0005,
            pull: false,
            gain,
            gain_sd: 0.0002,
            times: 4,
            date: "2026-05-04".to_owned(),
            adjusted,
        }
    }

    #[test]
    fn a_change_of_temperature_widens_the_uncertainty_in_proportion_either_way() {
        let effect = TemperatureEffect { percent_per_c: -0.05, calibrated_at_c: 21.0 };
        let u_n = effect.standard_uncertainty_n(2.0, 25.0);
        assert!((u_n - 0.0005 * 4.0 * 2.0 / 3f64.sqrt()).abs() < 1e-15, "{u_n}");
        assert_eq!(effect.standard_uncertainty_n(-2.0, 17.0), u_n);
        assert_eq!(effect.standard_uncertainty_n(2.0, 21.0), 0.0);
    }

    #[test]
    fn a_standard_uncertainty_follows_from_each_way_to_state_an_error() {
        let at = |stated, force_n| certificate(stated).standard_uncertainty_n(force_n);
        assert_eq!(at(StatedError::Expanded { u_n: 0.002, k: 2.0 }, 0.7), 0.001);
        assert_eq!(at(StatedError::Relative { u_percent: 0.2, k: 2.0 }, -1.0), 0.001);
        let class = at(StatedError::Class { class_percent: 0.1, full_scale_n: 5.0 }, 1.0);
        assert!((class - 0.005 / 3f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn a_gain_has_the_uncertainty_of_the_weight_and_of_its_repetitions() {
        let u = check(1.0, false).standard_uncertainty();
        assert!((u - 0.0005f64.hypot(0.0001)).abs() < 1e-15, "{u}");
    }

    #[test]
    fn wrong_gain_is_sound_only_after_adjustment_and_a_fault_never() {
        assert!(check(1.0008, false).is_sound(None), "within 2 sd");
        assert!(!check(1.0012, false).is_sound(None));
        let stated = certificate(StatedError::Expanded { u_n: 0.002, k: 2.0 });
        assert!(check(1.0040, false).is_sound(Some(&stated)), "0.2 % are the certificate's");
        assert!(!check(1.0050, false).is_sound(Some(&stated)));
        assert!(check(1.05, true).is_sound(Some(&stated)));
        for fault in [0.5, 1.25, -1.0, f64::NAN] {
            assert!(!check(fault, true).is_sound(None) && !check(fault, false).is_sound(None), "{fault}");
        }
        assert_eq!((check(1.05, true).divisor(), check(1.05, false).divisor()), (1.05, 1.0));
    }
}
