//! Choices of the library as words of options, each with its help.

use super::{Failure, sources};
use clap::ValueEnum;
use palpate_control::{SafetyRule, Strategy};
use palpate_data::dataset::{Durability, calibration::SolvedQuantity, characteristics::Repeatability, readings};
use palpate_report::export;

/// Definition of repeatability.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum RepeatabilityChoice {
    /// Three standard deviations.
    ///
    /// With five repeats it is on average 0.94 of three true standard deviations, because the square root of an unbiased variance
    /// is itself biased (c4 of 5).
    #[default]
    #[value(name = "3sd")]
    ThreeSd,
    /// Largest minus smallest output.
    Range,
    /// Half the width of the interval that contains 95 %, by Student's t.
    T95,
    /// Three standard deviations at the level with the largest standard deviation.
    WorstLevel,
}

/// What is solved besides the place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum QuantityChoice {
    /// The force, N.
    Force,
    /// The depth below the surface, mm.
    Depth,
}

/// Returns the quantity that is asked for.
pub(crate) fn quantity(choice: Option<QuantityChoice>) -> SolvedQuantity {
    match choice {
        None => SolvedQuantity::Known,
        Some(QuantityChoice::Force) => SolvedQuantity::Force,
        Some(QuantityChoice::Depth) => SolvedQuantity::Depth,
    }
}

/// A safety rule whose alarm a person may call false.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SoundRule {
    /// Outputs differ from earlier presses.
    OutputsDiffer,
}

impl SoundRule {
    pub(crate) fn rule(self) -> SafetyRule {
        match self {
            SoundRule::OutputsDiffer => SafetyRule::OutputsDiffer,
        }
    }
}

/// How safely presses are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum DurabilityChoice {
    /// Each press is on the disk before the next one begins.
    #[default]
    Full,
    /// The system writes presses to the disk later.
    Fast,
}

/// Methods that solve the test presses at the end of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum EvaluateChoice {
    /// The methods of the recipe, and the best one by cross-validation on the calibration.
    #[default]
    Best,
    /// Only the methods of the recipe.
    Recipe,
}

/// Format of readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ReadingsChoice {
    /// Cells separated by commas.
    Csv,
    /// One JSON object or array per line.
    Ndjson,
}

/// Format of exported files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportChoice {
    /// Text, with units, definitions and manifest in a .json file of the same name
    Csv,
    /// Apache Parquet
    Parquet,
    /// Apache Arrow IPC (Feather 2)
    Arrow,
    /// All tables in one file of numpy
    Npz,
    /// All tables in one MAT file (v5) for MATLAB, Octave and scipy
    Mat,
    /// All tables in one HDF5 file
    #[value(name = "h5")]
    Hdf5,
    /// A sensor file as C99, for a controller
    C,
}

impl From<RepeatabilityChoice> for Repeatability {
    fn from(choice: RepeatabilityChoice) -> Self {
        match choice {
            RepeatabilityChoice::ThreeSd => Repeatability::ThreeSd,
            RepeatabilityChoice::Range => Repeatability::Range,
            RepeatabilityChoice::T95 => Repeatability::T95,
            RepeatabilityChoice::WorstLevel => Repeatability::WorstLevel,
        }
    }
}

impl From<DurabilityChoice> for Durability {
    fn from(choice: DurabilityChoice) -> Self {
        match choice {
            DurabilityChoice::Full => Durability::Full,
            DurabilityChoice::Fast => Durability::Fast,
        }
    }
}

impl From<ReadingsChoice> for readings::ReadingFormat {
    fn from(choice: ReadingsChoice) -> Self {
        match choice {
            ReadingsChoice::Csv => readings::ReadingFormat::Csv,
            ReadingsChoice::Ndjson => readings::ReadingFormat::Ndjson,
        }
    }
}

impl From<ExportChoice> for export::ExportFormat {
    fn from(choice: ExportChoice) -> Self {
        match choice {
            ExportChoice::Csv => export::ExportFormat::Csv,
            ExportChoice::Parquet => export::ExportFormat::Parquet,
            ExportChoice::Arrow => export::ExportFormat::Arrow,
            ExportChoice::Npz => export::ExportFormat::Npz,
            ExportChoice::Mat => export::ExportFormat::Mat,
            ExportChoice::Hdf5 => export::ExportFormat::Hdf5,
            ExportChoice::C => export::ExportFormat::C,
        }
    }
}

/// Returns the choice of this word. `option` names the option of the command line.
///
/// # Errors
/// No choice has this word.
pub fn choice<T: ValueEnum>(option: &str, word: &str) -> Result<T, Failure> {
    T::from_str(word, false).map_err(|_| {
        let words: Vec<String> =
            T::value_variants().iter().filter_map(|one| Some(one.to_possible_value()?.get_name().to_owned())).collect();
        Failure::option(option, word, &format!("expected one of {}", words.join(", ")))
    })
}

/// Returns the strategy of this name.
///
/// # Errors
/// No strategy has this name.
pub fn strategy(name: &str) -> Result<Strategy, Failure> {
    sources::strategy(name).map_err(|why| Failure::option("--strategy", name, &why))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_definition_of_repeatability_has_a_name() {
        assert_eq!(RepeatabilityChoice::from_str("3sd", false), Ok(RepeatabilityChoice::default()));
        assert_eq!(Repeatability::from(RepeatabilityChoice::default()), Repeatability::default());
        assert!(RepeatabilityChoice::from_str("4sd", false).is_err());
        let words = RepeatabilityChoice::value_variants();
        assert_eq!(words.iter().map(|&word| Repeatability::from(word)).collect::<Vec<_>>(), Repeatability::ALL);
    }
}
