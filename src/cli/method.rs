//! How a method is asked for on the command line, and what is known of the load.

use crate::solver::{ForceKnown, SOLVERS};
use clap::builder::PossibleValuesParser;

/// Every name a method can be asked for by, with some more.
pub fn solvers<const MORE: usize>(more: [&'static str; MORE]) -> PossibleValuesParser {
    PossibleValuesParser::new(more.into_iter().chain(SOLVERS))
}

/// What `--constant-load` says.
pub fn load(is_constant: bool) -> ForceKnown {
    if is_constant { ForceKnown::Constant } else { ForceKnown::Unknown }
}
