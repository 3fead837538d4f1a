//! `palpate study minutes`: the accuracy of a calibration as a function of its minutes at the bench.

use super::begun::{Common, StudyOutput, ended, number};
use crate::api::Failure;
use crate::cli::text_table::{TextTable, cells};
use palpate_study::minutes::{HANDLING_MIN, MinutesRow, MinutesSize, UnitFamily, minutes, minutes_figures};
use palpate_study::ndjson;
use std::process::ExitCode;

/// Carries the study out, writes its figure and prints the ways of calibrating that no other beats.
pub(super) fn study(args: &Common) -> Result<ExitCode, Failure> {
    let begun = StudyOutput::new(&args.output, "minutes")?;
    let size = if args.quick { MinutesSize::QUICK } else { MinutesSize::WHOLE };
    let found = begun.carried(minutes(size, args.seed, &begun.text()))?;
    begun.end(minutes_figures(&found), ndjson(&found), |out| {
        let tables = UnitFamily::ALL.map(|family| table(family, &found)).concat();
        let minutes = format!("minutes: {HANDLING_MIN} for mounting, warm-up and zeroing, and those of the run\n");
        tables + &minutes + "rows and figure have every other way of calibrating too\n" + &ended(out)
    })
}

/// Returns the ways of a family that no other way beats, the fastest first, and the ways that rules ended.
fn table(family: UnitFamily, found: &[MinutesRow]) -> String {
    let mut table =
        TextTable::new(0, ["minutes", "presses", "side", "repeats", "strategy", "mean mm", "+-", "force N"]);
    let of_it = || found.iter().filter(|row| row.found.scene == family.name());
    let mut best: Vec<&MinutesRow> = of_it().filter(|row| row.found.pareto == Some(true)).collect();
    best.sort_by(|a, b| a.found.minutes.partial_cmp(&b.found.minutes).unwrap_or(std::cmp::Ordering::Equal));
    for row in best {
        table.row(cells![
            number(row.found.minutes, 1),
            row.found.calibration_presses,
            row.side,
            row.repeats,
            row.strategy.name(),
            number(row.found.mean_mm(), 3),
            number(row.found.location_error_within_mm, 3),
            number(row.found.force_error_n.map(|error| error.mean), 4),
        ]);
    }
    for row in of_it() {
        if let Some(rule) = &row.rule {
            table.line(format!("{}, {} presses: ended by {rule}", row.strategy.name(), row.found.value));
        }
    }
    format!("{}\nno other way is both faster and more exact\n\n{table}\n", family.text())
}
