//! `palpate study shear` and `palpate study two-contacts`: force vectors and pairs of contacts.

use super::begun::{Common, StudyOutput, ended};
use crate::api::Failure;
use crate::cli::text_table::{TextTable, cells};
use palpate_study::ndjson;
use palpate_study::vector::{ShearRow, TwoRow, VectorSize, shear, shear_figures, two_contacts, two_figures};
use std::process::ExitCode;

/// Fraction of answers from which a condition is reported as the one that breaks.
const HALF: f64 = 0.5;

fn size(args: &Common) -> VectorSize {
    if args.quick { VectorSize::QUICK } else { VectorSize::WHOLE }
}

/// Carries the study of force vectors out, writes its figure and prints its table.
pub(super) fn study_shear(args: &Common) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "shear")?;
    let found = begun.carried(shear(size(args), args.seed, &begun.text()))?;
    begun.end(shear_figures(&found), ndjson(&found), |out| shear_table(&found) + &ended(out))
}

/// Carries the study of two contacts out, writes its figure and prints its table.
pub(super) fn study_two(args: &Common) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "two-contacts")?;
    let found = begun.carried(two_contacts(size(args), args.seed, &begun.text()))?;
    begun.end(two_figures(&found), ndjson(&found), |out| two_table(&found) + &ended(out))
}

fn shear_table(found: &[ShearRow]) -> String {
    let head = ["taxels", "varied", "value", "mm", "bound", "press N", "shear N", "bound", "unknown", "us"];
    let mut table = TextTable::new(2, head);
    for row in found {
        table.row(cells![
            row.taxels,
            row.condition,
            row.value,
            format!("{:.3}", row.location_error_mm),
            format!("{:.3}", row.location_bound_mm),
            format!("{:.4}", row.press_error_n),
            format!("{:.4}", row.shear_error_n),
            format!("{:.4}", row.shear_bound_n),
            format!("{:.2}", row.not_determinable),
            format!("{:.0}", row.us_per_solve),
        ]);
    }
    let breaks = found.iter().filter(|row| row.condition == "noise" && row.not_determinable > HALF).collect::<Vec<_>>();
    // the least noise of each kind of taxels
    let breaks = breaks.chunk_by(|a, b| a.taxels == b.taxels).map(|rows| rows[0]);
    let breaks =
        breaks.map(|row| format!("{}: most shears are unknown from a noise of {} on\n", row.taxels, row.value));
    format!("{table}unknown: fraction of shears that the outputs can't show\n{}", breaks.collect::<String>())
}

fn two_table(found: &[TwoRow]) -> String {
    let head = ["scene", "taxels", "mm apart", "right", "not sep.", "wrong", "one", "bound mm", "us"];
    let mut table = TextTable::new(2, head);
    let places = found.iter().map(|row| row.places).max();
    let is_printed = |row: &&TwoRow| !row.is_true_map && Some(row.places) == places;
    for row in found.iter().filter(is_printed) {
        table.row(cells![
            row.scene,
            row.taxels,
            row.separation_mm,
            format!("{:.2}", row.right),
            format!("{:.2}", row.not_separable),
            format!("{:.3}", row.wrong),
            format!("{:.2}", row.called_one),
            format!("{:.2}", row.location_bound_mm),
            format!("{:.0}", row.us_per_solve),
        ]);
    }
    let places = places.map_or(0, |side| side * side);
    let others =
        if found.iter().any(|row| row.is_true_map) { "; the rows have fewer places and the exact map too" } else { "" };
    format!(
        "{table}right: within 1 mm and 0.1 N; others: not separable, wrong, or called one\n\
         calibrated at {places} places{others}\n"
    )
}
