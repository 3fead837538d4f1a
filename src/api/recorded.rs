//! Reads a run from its folder. Its journal is the record; a file that differs from the journal is reported in a line.

use super::columns::ColumnsOptions;
use super::sources::parse_rig;
use super::stdin;
use super::{Failure, Note};
use palpate_data::dataset::{Lookalike, Mapping, Press, Presses, Recorded, RunFacts, Texts};
use palpate_data::recipe::Phase;
use palpate_report::export::{self, BenchError};
use palpate_run::rig::{Bench, RigSpec};
use std::path::Path;

/// Reads the content of a run's journal, and the bench on which it was made. Notes each file that differs from the journal.
///
/// # Errors
/// The path isn't a run, or its journal is damaged.
pub fn read_run(run: &Path, note: Note<'_>) -> Result<(Recorded, Bench), Failure> {
    let recorded = Recorded::read(run).map_err(Failure::dataset)?;
    let warnings = recorded.warnings().map_err(Failure::dataset)?;
    let bench = bench_of(run, &recorded.manifest.facts, &recorded.texts)?;
    warnings.iter().for_each(|warning| note(&format!("warning: {warning}")));
    Ok((recorded, bench))
}

/// Returns the bench of a run, as recorded in its journal.
pub(crate) fn bench_of(run: &Path, facts: &RunFacts, texts: &Texts) -> Result<Bench, Failure> {
    export::bench_of(run, facts, texts).map_err(unknown_bench)
}

/// The bench of a run couldn't be read.
pub(crate) fn unknown_bench(error: BenchError) -> Failure {
    match error {
        BenchError::Problems(problems) => Failure::usage(problems),
        error => Failure::usage(error),
    }
}

/// Returns the rig of a run, as recorded in its journal.
pub(crate) fn rig_of(run: &Path, texts: &Texts) -> Result<RigSpec, Failure> {
    if texts.rig().is_empty() {
        let help = "restore journal.log from a copy; nothing was changed";
        let path = run.join("journal.log");
        return Err(Failure::usage(miette::miette!(help = help, "{}: the beginning is missing", path.display())));
    }
    parse_rig(&run.join("rig.toml"), texts.rig(), texts)
}

/// Reads the presses of a table. Of a table with several phases, only one is used, if one is named. Notes each fact that a person
/// should know about the table.
pub(crate) fn read_presses(
    table: &Path,
    mapping: &Mapping,
    phase: Option<Phase>,
    note: Note<'_>,
) -> Result<Presses, Failure> {
    let mut presses = stdin::table(table, mapping).map_err(Failure::usage)?;
    let name = presses.source.clone();
    difference(table).iter().for_each(|difference| note(difference));
    if let Some(phase) = phase
        && let Some(all) = presses.keep(phase)
    {
        let (kept, phase) = (presses.presses.len(), phase.name());
        note(&format!("note: {name}: its {kept} rows of phase `{phase}` are used, of {all}"));
    }
    presses.detected.iter().for_each(|detected| note(&format!("note: {name}: {detected}")));
    for Lookalike { column, looks_like, read_from } in presses.unused.iter().take(LOOKALIKES_MAX) {
        note(&format!(
            "warning: {name}: column `{column}` looks like {looks_like} but isn't used (only {read_from}; or name it in --columns)"
        ));
    }
    other_units(&presses).iter().for_each(|other| note(&format!("note: {name}: {other}")));
    let more = presses.unused.len().saturating_sub(LOOKALIKES_MAX);
    if more > 0 {
        note(&format!("warning: and {more} more such columns"));
    }
    Ok(presses)
}

/// Reads a table of presses, all phases of it. Notes each fact that a person should know about the table.
///
/// # Errors
/// Bad input.
pub fn read_table(table: &Path, columns: &ColumnsOptions, note: Note<'_>) -> Result<Presses, Failure> {
    read_presses(table, &columns.mapping()?, None, note)
}

type PressValue = fn(&Press) -> f64;

/// Span of an axis, mm, and force, N, above which another unit is likely.
const SPAN_MOST_MM: f64 = 1000.0;
const FORCE_MOST_N: f64 = 100.0;

/// Returns a note with the factor for places and for forces that are probably in another unit.
fn other_units(presses: &Presses) -> Vec<String> {
    let ends = |of: PressValue| {
        let values = presses.presses.iter().map(of);
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), value| (least.min(value), most.max(value)))
    };
    let axes: [(&str, PressValue); 2] = [("x", |press| press.x_mm), ("y", |press| press.y_mm)];
    let spans = axes.map(|(axis, of)| (axis, ends(of).1 - ends(of).0));
    let wide = spans.into_iter().find(|(_, span_mm)| *span_mm > SPAN_MOST_MM).map(|(axis, span_mm)| {
        format!("{axis} spans {span_mm:.0} mm: if places are in um, set x_mm = 0.001 in [scale] of a columns file")
    });
    let most_n = ends(|press| press.force_n.unwrap_or_default().abs()).1;
    let has_vector = presses.presses.iter().any(|press| press.force_x_n.is_some());
    let sideways = if has_vector { " and force_x_n = 0.001" } else { "" };
    let strong = (most_n > FORCE_MOST_N).then(|| {
        format!(
            "forces are up to {most_n:.0} N: if they are in mN, set force_n = 0.001{sideways} in [scale] of a columns file; if in g, 0.00980665"
        )
    });
    wide.into_iter().chain(strong).collect()
}

/// Warns where the forces or places of a test are of another order than those of the calibration: of another unit, probably.
pub(crate) fn warn_of_units(calibration: &Presses, test: &Presses, note: Note<'_>) {
    /// Ratio of two largest values from which they have different orders of magnitude.
    const OTHER_ORDER: f64 = 30.0;
    let is_other = |presses: &Presses, phase| presses.presses.iter().all(|press| press.is_of(phase));
    if is_other(calibration, Phase::Test) || is_other(test, Phase::Calibration) {
        let (first, second) = (&calibration.source, &test.source);
        note(&format!(
            "warning: {first} is used as the calibration, and {second} as the test: their column `phase` states the opposite"
        ));
    }
    let largest = |presses: &Presses, of: fn(&Press) -> f64| presses.presses.iter().map(of).fold(0.0, f64::max);
    let columns: [(&str, &str, PressValue); 3] = [
        ("force_n", "N", |press| press.force_n.unwrap_or_default().abs()),
        ("x_mm and y_mm", "mm", |press| press.x_mm.abs().max(press.y_mm.abs())),
        ("outputs", "one unit", |press| press.outputs.iter().fold(0.0, |most, output| output.abs().max(most))),
    ];
    for (column, unit, of) in columns {
        let (before, now) = (largest(calibration, of), largest(test, of));
        if before > 0.0 && now > 0.0 && (now > OTHER_ORDER * before || before > OTHER_ORDER * now) {
            let (first, second) = (&calibration.source, &test.source);
            note(&format!(
                "warning: {column} up to {now} in {second}, and up to {before} in {first}: both must be in {unit}"
            ));
        }
    }
}

/// Largest number of columns that are named one by one in a warning.
const LOOKALIKES_MAX: usize = 8;

/// Returns a line if a table, named by its path, differs from the journal next to it. The table is still read.
fn difference(table: &Path) -> Option<String> {
    let folder = table.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let is_a_runs = table.file_name().is_some_and(|name| name == "presses.csv");
    // a journal that can't be read is for `palpate verify` to report
    let recorded = is_a_runs.then(|| Recorded::read(folder).ok()).flatten()?;
    let problem = recorded.table_problem("presses.csv").ok().flatten()?;
    let (table, folder) = (table.display(), folder.display());
    Some(format!("warning: {table} {problem}; it is read as it is (name the folder {folder} to read the journal)"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_data::dataset::parse_table;

    #[test]
    fn places_and_forces_of_another_unit_get_a_note_with_the_factor() {
        let notes = |text: &str| other_units(&parse_table("a.csv", text.as_bytes(), &Mapping::default()).unwrap());
        let um = notes("x_mm,y_mm,force_n,out_1\n-6000,0,1,1\n6000,0,2,1\n");
        assert!(um.len() == 1 && um[0].starts_with("x spans 12000 mm: ") && um[0].contains("x_mm = 0.001"), "{um:?}");
        let mn = notes("x_mm,y_mm,force_n,out_1\n0,0,-1500,1\n1,0,2,1\n");
        assert!(mn.len() == 1 && mn[0].contains("force_n = 0.001") && mn[0].contains("0.00980665"), "{mn:?}");
        assert!(notes("x_mm,y_mm,out_1\n-60,5000,1\n60,5060,1\n").is_empty());
    }
}
