//! The numbered settings.

use super::fault::GrblError;

/// GRBL's numbered settings, in the order and the units of its manual.
#[derive(Clone, Debug)]
pub struct Settings {
    values: [f64; TABLE.len()],
}

/// How a setting is written, and what it takes.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// A whole number up to 255.
    Byte,
    /// 0 or 1.
    Switch,
    /// A number that isn't negative, told with three decimals.
    Number,
    /// A number above zero. GRBL itself takes a zero, and then divides by it.
    Positive,
    /// Revolutions a minute, told without decimals.
    Rpm,
}

/// Number, kind and value as it is delivered: 800 steps a mm, 25 mm/s, 100 mm/s^2, 25 mm of travel; homing and soft limits on.
const TABLE: [(u8, Kind, f64); 34] = [
    (0, Kind::Byte, 10.0),
    (1, Kind::Byte, 255.0),
    (2, Kind::Byte, 0.0),
    (3, Kind::Byte, 0.0),
    (4, Kind::Switch, 0.0),
    (5, Kind::Switch, 0.0),
    (6, Kind::Switch, 0.0),
    (STATUS_MASK, Kind::Byte, 1.0),
    (11, Kind::Number, 0.01),
    (12, Kind::Number, 0.002),
    (REPORT_INCHES, Kind::Switch, 0.0),
    (SOFT_LIMITS, Kind::Switch, 1.0),
    (HARD_LIMITS, Kind::Switch, 0.0),
    (HOMING, Kind::Switch, 1.0),
    (HOMING_DIRECTIONS, Kind::Byte, 0.0),
    (LOCATE_RATE, Kind::Positive, 60.0),
    (SEEK_RATE, Kind::Positive, 600.0),
    (DEBOUNCE, Kind::Byte, 25.0),
    (PULL_OFF, Kind::Number, 0.5),
    (30, Kind::Rpm, 1000.0),
    (31, Kind::Rpm, 0.0),
    (32, Kind::Switch, 0.0),
    (STEPS, Kind::Positive, 800.0),
    (STEPS + 1, Kind::Positive, 800.0),
    (STEPS + 2, Kind::Positive, 800.0),
    (MOST_RATE, Kind::Positive, 1500.0),
    (MOST_RATE + 1, Kind::Positive, 1500.0),
    (MOST_RATE + 2, Kind::Positive, 1500.0),
    (ACCELERATION, Kind::Positive, 100.0),
    (ACCELERATION + 1, Kind::Positive, 100.0),
    (ACCELERATION + 2, Kind::Positive, 100.0),
    (TRAVEL, Kind::Positive, 25.0),
    (TRAVEL + 1, Kind::Positive, 25.0),
    (TRAVEL + 2, Kind::Positive, 25.0),
];

/// What status reports tell: bit 0, machine (not work) position; bit 1, room in the buffers.
pub const STATUS_MASK: u8 = 10;
/// Whether positions and rates are told in inches.
pub const REPORT_INCHES: u8 = 13;
/// Whether targets beyond the travel are refused.
pub const SOFT_LIMITS: u8 = 20;
/// Whether a switch that is run into stops all.
pub const HARD_LIMITS: u8 = 21;
/// Whether there is homing, and a lock until it is done.
pub const HOMING: u8 = 22;
/// Bits of the axes that home to their - end.
pub const HOMING_DIRECTIONS: u8 = 23;
/// How fast a switch is located, mm/min.
pub const LOCATE_RATE: u8 = 24;
/// How fast a switch is looked for, mm/min.
pub const SEEK_RATE: u8 = 25;
/// Rest between the phases of homing, ms.
pub const DEBOUNCE: u8 = 26;
/// How far an axis backs off its switch, mm.
pub const PULL_OFF: u8 = 27;
/// Steps a mm: the first axis', the others follow.
pub const STEPS: u8 = 100;
/// Largest rate, mm/min: the first axis'.
pub const MOST_RATE: u8 = 110;
/// Acceleration, mm/s^2: the first axis'.
pub const ACCELERATION: u8 = 120;
/// Travel, mm: the first axis'.
pub const TRAVEL: u8 = 130;

/// The shortest step pulse, us.
const PULSE_LEAST_US: f64 = 3.0;

impl Default for Settings {
    fn default() -> Self {
        Settings { values: TABLE.map(|(_, _, value)| value) }
    }
}

impl Settings {
    /// A setting's value; zero where there is none of this number.
    pub fn get(&self, number: u8) -> f64 {
        index(number).map_or(0.0, |index| self.values[index])
    }

    /// Whether a setting isn't zero.
    pub fn on(&self, number: u8) -> bool {
        self.get(number) != 0.0
    }

    /// The settings of three axes.
    pub fn of_axes(&self, first: u8) -> [f64; 3] {
        [first, first + 1, first + 2].map(|number| self.get(number))
    }

    /// Sets one: `$n=v`.
    pub fn set(&mut self, number: f64, value: f64) -> Result<(), GrblError> {
        let index = TABLE.iter().position(|entry| f64::from(entry.0) == number).ok_or(GrblError::InvalidStatement)?;
        let (number, kind, _) = TABLE[index];
        if value < 0.0 || (kind == Kind::Positive && value == 0.0) {
            return Err(GrblError::NegativeValue);
        }
        match number {
            0 if value < PULSE_LEAST_US => return Err(GrblError::PulseTooShort),
            // positions in inches aren't served
            REPORT_INCHES if value != 0.0 => return Err(GrblError::InvalidStatement),
            SOFT_LIMITS if value != 0.0 && !self.on(HOMING) => return Err(GrblError::SoftLimitsNeedHoming),
            _ => {}
        }
        self.values[index] = match kind {
            Kind::Byte => value.trunc().min(f64::from(u8::MAX)),
            Kind::Switch => f64::from(u8::from(value != 0.0)),
            Kind::Number | Kind::Positive | Kind::Rpm => value,
        };
        if number == HOMING && value == 0.0 {
            // soft limits mean nothing without a home
            self.values[index - 2] = 0.0;
        }
        Ok(())
    }

    /// The lines of `$$`.
    pub fn lines(&self) -> impl Iterator<Item = String> {
        TABLE.iter().zip(self.values).map(|(&(number, kind, _), value)| match kind {
            Kind::Number | Kind::Positive => format!("${number}={value:.3}"),
            Kind::Byte | Kind::Switch | Kind::Rpm => format!("${number}={value:.0}"),
        })
    }
}

fn index(number: u8) -> Option<usize> {
    TABLE.iter().position(|entry| entry.0 == number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_told_as_the_manual_prints_them() {
        let told: Vec<String> = Settings::default().lines().collect();
        assert_eq!(told.len(), 34);
        for line in ["$0=10", "$10=1", "$11=0.010", "$13=0", "$27=0.500", "$30=1000", "$100=800.000", "$132=25.000"] {
            assert!(told.iter().any(|told| told == line), "{line}");
        }
    }

    #[test]
    fn what_a_setting_cant_be_is_refused_and_changes_nothing() {
        let mut settings = Settings::default();
        for (number, value, fault) in [
            (7.0, 1.0, GrblError::InvalidStatement),
            (10.5, 1.0, GrblError::InvalidStatement),
            (110.0, -1.0, GrblError::NegativeValue),
            (100.0, 0.0, GrblError::NegativeValue),
            (0.0, 2.0, GrblError::PulseTooShort),
            (13.0, 1.0, GrblError::InvalidStatement),
        ] {
            assert_eq!(settings.set(number, value), Err(fault), "${number}={value}");
        }
        assert_eq!(settings.values, Settings::default().values);
    }

    #[test]
    fn soft_limits_go_with_homing() {
        let mut settings = Settings::default();
        settings.set(22.0, 0.0).expect("a switch");
        assert!(!settings.on(SOFT_LIMITS));
        assert_eq!(settings.set(20.0, 1.0), Err(GrblError::SoftLimitsNeedHoming));
    }
}
