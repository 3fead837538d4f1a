//! Reasons for which a line is refused.

/// Reason why a line is refused, by the codes of GRBL's table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrblError {
    ExpectedLetter = 1,
    BadNumber = 2,
    InvalidStatement = 3,
    NegativeValue = 4,
    HomingDisabled = 5,
    NotIdle = 8,
    Locked = 9,
    SoftLimitNeedsHoming = 10,
    Overlong = 11,
    TravelExceeded = 15,
    BadJog = 16,
    Unsupported = 20,
    NoFeed = 22,
    TwoUseAxes = 24,
    RepeatedWord = 25,
    NoAxisWords = 26,
    MissingValue = 28,
    UnusedWords = 36,
}
