//! Characteristics by name, each defined once. Pages and terminal print these sentences.

use super::Repeatability;

/// A quantity and its definition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DefinedTerm {
    /// Name of the quantity.
    pub name: &'static str,
    /// How the quantity is computed, and the source of the term.
    pub definition: &'static str,
}

/// Term for the reference of every percentage except the hysteresis of the reading.
const FULL_SCALE: DefinedTerm = DefinedTerm {
    name: "full scale",
    definition: "the mean loading output at the largest set force; of several places, where that is largest; of a unit with several \
        channels, of the channel where it is largest",
};

/// Term for the correction that makes outputs comparable.
const CORRECTION: DefinedTerm = DefinedTerm {
    name: "correction",
    definition: "each output above 0 N is first brought to the set force: the slope of the line of linearity times (set \
        force - load cell) is added",
};

/// Term for the difference between unloading and loading.
const HYSTERESIS: DefinedTerm = DefinedTerm {
    name: "hysteresis",
    definition: "|mean unloading - mean loading output| at a level between zero and top force, the largest over levels and \
        places, in % of full scale (as hysteresis in IEC 61298-2)",
};

/// Term for the same difference, relative to the reading at that force.
const HYSTERESIS_OF_READING: DefinedTerm = DefinedTerm {
    name: "hysteresis, % of reading",
    definition: "the same difference in % of the mean of both outputs at its level, the largest over levels and places (as \
        reversibility in ISO 376)",
};

/// Term for the deviation of the outputs from a straight line.
const LINEARITY: DefinedTerm = DefinedTerm {
    name: "linearity",
    definition: "the largest |mean loading output of a level - straight line|, over levels and places, in % of full scale. \
        The line is fitted by least squares at each place to the loading outputs against the load cell, 0 N included, and \
        does not have to pass through zero (the independent linearity of IEC \
        61298-2 is the same or smaller)",
};

/// Term for the output that remains after a load.
const ZERO_RETURN: DefinedTerm = DefinedTerm {
    name: "zero return",
    definition: "output without load after the staircases minus output without load before them, in % of full \
        scale; of several places the largest in magnitude (as zero error in ISO 376)",
};

/// Term for the uncertainty of a repeatability.
const INTERVAL: DefinedTerm = DefinedTerm {
    name: "95 % interval",
    definition: "where the true repeatability lies, by chi-squared; it assumes normal errors. The levels of a staircase share \
        its contact: n staircases at a place give n - 1 degrees of freedom, places add up by Welch and Satterthwaite",
};

/// Every term except the repeatability, in the order of explanation.
pub const COMMON: [DefinedTerm; 7] =
    [INTERVAL, HYSTERESIS, HYSTERESIS_OF_READING, LINEARITY, ZERO_RETURN, FULL_SCALE, CORRECTION];

/// Sources of the terms, and claims that are not made.
pub const SOURCES: &str = "Terms follow VIM (JCGM 200), IEC 61298-2 and ISO 376 where they are named; conformity to none of \
    them is claimed.";

impl Repeatability {
    /// Returns the content of the repeatability columns.
    pub const fn definition(self) -> &'static str {
        match self {
            Repeatability::ThreeSd => {
                "3 standard deviations (n - 1) of the repeats of a level at a place, pooled over all places and all levels \
                 except zero, in % of full scale (as measurement repeatability in VIM 2.21, times 3)"
            }
            Repeatability::Range => {
                "largest less smallest of the repeats of a level at a place, mean over all places and all levels except zero, in % of \
                 full scale (as non-repeatability in IEC 61298-2, which takes the largest level)"
            }
            Repeatability::T95 => {
                "Student's t (95 %, two-sided, with the degrees of freedom of the interval; 2.776 for 5 repeats) times the \
                 standard deviation (n - 1) of the repeats of a level at a place, pooled over all places and all levels \
                 except zero, in % of full scale"
            }
            Repeatability::WorstLevel => {
                "3 standard deviations (n - 1) of the repeats, at the place and the level above zero where they are largest, \
                 in % of full scale; it has no interval, since the largest of several isn't distributed as one of them"
            }
        }
    }
}
