//! `palpate study validation`: the paper's protocol many times over, and its numerical study, as a page.

use super::begun::{Common, StudyOutput};
use crate::api::Failure;
use palpate_study::validation::{QUICK_SEEDS, SEEDS, validation};
use std::process::ExitCode;

/// Carries the protocol out, writes the page and prints it.
pub(super) fn study(args: &Common) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "validation")?;
    let seeds = if args.quick { QUICK_SEEDS } else { SEEDS };
    let found = begun.carried(validation(seeds, args.seed, &begun.text()))?;
    let page = found.markdown();
    begun.end(vec![("validation.md".to_owned(), page)], found.ndjson(), |out| {
        let mean = |of: fn(&palpate_study::validation::ValidationOutcome) -> f64| {
            found.outcomes.iter().map(of).sum::<f64>() / found.outcomes.len() as f64
        };
        format!(
            "{} specimens; mean location error {:.3} mm by the paper's\nmethod (paper: 0.46), {:.3} mm by the best\n\
             the page and rows: {}\n",
            found.outcomes.len(),
            mean(|outcome| outcome.papers.location_error_mm.mean),
            mean(|outcome| outcome.best.location_error_mm.mean),
            out.display()
        )
    })
}
