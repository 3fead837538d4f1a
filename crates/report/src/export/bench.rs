//! The bench of a run, as its journal describes it.

use miette::Diagnostic;
use palpate_data::dataset::{Mapping, RunFacts, Texts};
use palpate_document::Problems;
use palpate_run::rig::{self, Bench};
use std::io;
use std::path::Path;

/// Reason why the bench of a run isn't known.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum BenchError {
    /// The rig or the columns file in the journal can't be read by this program.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Problems(#[from] Problems),
    /// The journal has no rig.
    #[error("{file}: the beginning is missing")]
    #[diagnostic(help("restore journal.log from a copy; nothing was changed"))]
    NoRig {
        /// The journal.
        file: String,
    },
}

/// Returns the bench of the run in a folder: its rig, or the array of the columns file of an import.
///
/// # Errors
/// The texts of the journal are missing, or this program can't read them.
pub fn bench_of(run: &Path, facts: &RunFacts, texts: &Texts) -> Result<Bench, BenchError> {
    let name = |file: &str| run.join(file).display().to_string();
    if let Some(imported) = &facts.imported {
        let columns = Mapping::parse(&name("columns.toml"), texts.columns())?;
        return Ok(Bench::of_import(columns.array, imported.outputs as usize));
    }
    if texts.rig().is_empty() {
        return Err(BenchError::NoRig { file: name("journal.log") });
    }
    let kept = |file: &str| texts.latest(file).map(str::to_owned).ok_or_else(|| io::ErrorKind::NotFound.into());
    Ok(Bench::of_rig(rig::parse(&name("rig.toml"), texts.rig(), &kept)?))
}
