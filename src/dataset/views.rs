use super::characteristics::{Repeatability, Staircases, characterise};
use super::table::Table;
use super::{Contact, DatasetError, Row};
use crate::quantity::ArrayLayout;
use crate::recipe::Phase;
use std::fs;
use std::path::Path;

/// The table of all presses.
pub(super) const PRESSES: &str = "presses.csv";

/// The columns of `presses.csv` before the outputs, and after them.
const BEFORE: [&str; 9] = ["press", "level", "phase", "x_mm", "y_mm", "force_set_n", "force_n", "depth_mm", "t_s"];
const AFTER: [&str; 2] = ["flags", "z_mm"];

/// Writes every table that follows from a run's contacts, in the plan's order, each whole or not at all.
pub(super) fn write(folder: &Path, contacts: &[&Contact], layout: &ArrayLayout) -> Result<(), DatasetError> {
    let rows: Vec<&Row> = contacts.iter().flat_map(|contact| &contact.rows).collect();
    let presses = rows.iter().fold(presses_header(layout.len()), |text, row| text + &presses_line(row));
    replace(folder, PRESSES, &presses)?;
    for (phase, name) in [(Phase::Calibration, "calibration_matrix.csv"), (Phase::Test, "test_matrix.csv")] {
        let columns: Vec<&Row> = rows.iter().copied().filter(|row| row.phase == phase).collect();
        if !columns.is_empty() {
            replace(folder, name, &matrix(&columns, layout.len()))?;
        }
    }
    // from the table as it stands, so that who evaluates it later comes to the same
    if let Ok(table) = Table::of_run(PRESSES, &presses)
        && let Some(staircases) = Staircases::of_run(&table, layout)
    {
        replace(folder, "characteristics.csv", &characteristics(&staircases))?;
    }
    if contacts.iter().any(|contact| !contact.truth.is_empty()) {
        replace(folder, "scene.csv", &scene(contacts))?;
    }
    Ok(())
}

/// The first line of `presses.csv`.
pub(super) fn presses_header(units: usize) -> String {
    let outputs = (1..=units).map(|unit| format!("out_{unit}"));
    let names: Vec<String> =
        BEFORE.map(str::to_owned).into_iter().chain(outputs).chain(AFTER.map(str::to_owned)).collect();
    names.join(",") + "\n"
}

/// One line of `presses.csv`. No cell needs quoting: numbers, and words of our own.
pub(super) fn presses_line(row: &Row) -> String {
    let Row { press, level, x_mm, y_mm, force_set_n, force_n, depth_mm, t_s, z_mm, .. } = row;
    let outputs = row.outputs.iter().fold(String::new(), |text, output| format!("{text}{output},"));
    let (phase, flags) = (row.phase.name(), row.flags_text());
    format!("{press},{level},{phase},{x_mm},{y_mm},{force_set_n},{force_n},{depth_mm},{t_s},{outputs}{flags},{z_mm}\n")
}

/// A row a unit, a column a point, no header: what the paper calls its calibration matrix.
fn matrix(columns: &[&Row], units: usize) -> String {
    let line = |unit: usize| {
        let cell = |row: &&Row| row.outputs.get(unit).map_or_else(String::new, f64::to_string);
        columns.iter().map(cell).collect::<Vec<_>>().join(",") + "\n"
    };
    (0..units).map(line).collect()
}

fn characteristics(staircases: &Staircases) -> String {
    let mut text = "unit,repeatability_loading_percent,repeatability_unloading_percent,hysteresis_percent\n".to_owned();
    let cell = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.4}"));
    for unit in characterise(staircases, Repeatability::default()) {
        let cells = [unit.repeatability_loading_percent, unit.repeatability_unloading_percent, unit.hysteresis_percent];
        text += &format!("{},{}\n", unit.unit, cells.map(cell).join(","));
    }
    text
}

fn scene(contacts: &[&Contact]) -> String {
    let mut text = "press,level,force_true_n,force_peak_n,depth_peak_mm\n".to_owned();
    for contact in contacts {
        for (row, truth) in contact.rows.iter().zip(&contact.truth) {
            let super::RowTruth { force_true_n, force_peak_n, depth_peak_mm } = truth;
            text += &format!("{},{},{force_true_n},{force_peak_n},{depth_peak_mm}\n", row.press, row.level);
        }
    }
    text
}

/// Writes a file beside its place and renames it there.
pub(super) fn replace(folder: &Path, name: &str, text: &str) -> Result<(), DatasetError> {
    let path = folder.join(name);
    let beside = folder.join(format!(".{name}.new"));
    fs::write(&beside, text).map_err(DatasetError::io("writing", &beside))?;
    fs::rename(&beside, &path).map_err(DatasetError::io("renaming to", &path))
}
