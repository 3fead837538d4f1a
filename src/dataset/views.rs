use super::characteristics::{Repeatability, Staircases, characterise};
use super::{Contact, Contacts, DatasetError, Row, RowTruth};
use crate::quantity::ArrayLayout;
use crate::recipe::Phase;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// The table of all presses.
pub(super) const PRESSES: &str = "presses.csv";

/// All tables a run may have.
pub const TABLES: [&str; 5] =
    [PRESSES, "characteristics.csv", "calibration_matrix.csv", "test_matrix.csv", "scene.csv"];

/// The columns of `presses.csv` before the outputs, and after them.
const BEFORE: [&str; 9] = ["press", "level", "phase", "x_mm", "y_mm", "force_set_n", "force_n", "depth_mm", "t_s"];
const AFTER: [&str; 2] = ["flags", "z_mm"];

/// Most outputs that are held at once to turn columns into rows: 8 MB.
const OUTPUTS_MAX: usize = 1 << 19;

/// Writes every table that follows from a run's contacts, each whole or not at all, and takes away those that don't. `contacts` reads them anew each time, in
/// the order of their numbers; one is held at a time.
pub(super) fn write<'a>(
    folder: &Path,
    layout: &ArrayLayout,
    contacts: &dyn Fn() -> Result<Contacts<'a>, DatasetError>,
) -> Result<(), DatasetError> {
    let mut presses = Draft::new(folder, PRESSES)?;
    let mut scene: Option<Draft> = None;
    // a reading a level of the characterisation alone, of one unit: what its statistics need
    let mut staircases = Staircases::none(layout);
    let mut matrices = [(Phase::Calibration, "calibration_matrix.csv", 0), (Phase::Test, "test_matrix.csv", 0)];
    presses.write(&presses_header(layout.len()))?;
    for contact in contacts()? {
        let contact = contact?;
        for row in &contact.rows {
            presses.write(&presses_line(row))?;
            matrices.iter_mut().filter(|(phase, ..)| row.phase == *phase).for_each(|(_, _, points)| *points += 1);
        }
        staircases.add_contact(&contact, layout);
        if !contact.truth.is_empty() {
            let scene = match &mut scene {
                Some(scene) => scene,
                None => scene.insert(Draft::with(folder, "scene.csv", SCENE_HEADER)?),
            };
            scene.write(&scene_lines(&contact))?;
        }
    }
    presses.publish()?;
    let staircases = staircases.some();
    let follows = |name: &str| match name {
        "scene.csv" => scene.is_some(),
        "characteristics.csv" => staircases.is_some(),
        _ => name == PRESSES || matrices.iter().any(|(_, matrix, points)| *matrix == name && *points > 0),
    };
    for stray in TABLES.into_iter().filter(|name| !follows(name)).map(|name| folder.join(name)) {
        if stray.is_file() {
            fs::remove_file(&stray).map_err(DatasetError::io("removing", stray))?;
        }
    }
    for (phase, name, points) in matrices.into_iter().filter(|(_, _, points)| *points > 0) {
        let mut matrix = Draft::new(folder, name)?;
        write_matrix(&mut matrix, phase, points, layout.len(), contacts)?;
        matrix.publish()?;
    }
    if let Some(staircases) = staircases {
        replace(folder, "characteristics.csv", &characteristics(&staircases))?;
    }
    scene.map_or(Ok(()), Draft::publish)
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

/// A row a unit, a column a point, no header: what the paper calls its calibration matrix. The contacts come point by point,
/// so they are read once for as many units as may be held: once in all, but for a great many points.
fn write_matrix<'a>(
    matrix: &mut Draft,
    phase: Phase,
    points: usize,
    units: usize,
    contacts: &dyn Fn() -> Result<Contacts<'a>, DatasetError>,
) -> Result<(), DatasetError> {
    let units_at_once = (OUTPUTS_MAX / points).max(1);
    for first in (0..units).step_by(units_at_once) {
        let here = first..units.min(first + units_at_once);
        let mut lines: Vec<Vec<_>> = here.clone().map(|_| Vec::with_capacity(points)).collect();
        for contact in contacts()? {
            for row in contact?.rows.iter().filter(|row| row.phase == phase) {
                here.clone().zip(&mut lines).for_each(|(unit, line)| line.push(row.outputs.get(unit).copied()));
            }
        }
        for line in lines {
            for (point, output) in line.into_iter().enumerate() {
                matrix.write(if point > 0 { "," } else { "" })?;
                matrix.write(&output.map_or_else(String::new, |output: f64| output.to_string()))?;
            }
            matrix.write("\n")?;
        }
    }
    Ok(())
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

const SCENE_HEADER: &str = "press,level,force_true_n,force_peak_n,depth_peak_mm\n";

fn scene_lines(contact: &Contact) -> String {
    let line = |(row, truth): (&Row, &RowTruth)| {
        let RowTruth { force_true_n, force_peak_n, depth_peak_mm } = truth;
        format!("{},{},{force_true_n},{force_peak_n},{depth_peak_mm}\n", row.press, row.level)
    };
    contact.rows.iter().zip(&contact.truth).map(line).collect()
}

/// Writes a file beside its place and renames it there.
pub(super) fn replace(folder: &Path, name: &str, text: &str) -> Result<(), DatasetError> {
    Draft::with(folder, name, text)?.publish()
}

/// A file on its way: written beside its place, then renamed there.
struct Draft {
    out: BufWriter<File>,
    beside: PathBuf,
    path: PathBuf,
}

impl Draft {
    fn new(folder: &Path, name: &str) -> Result<Draft, DatasetError> {
        let beside = folder.join(format!(".{name}.new"));
        let file = File::create(&beside).map_err(DatasetError::io("writing", &beside))?;
        Ok(Draft { out: BufWriter::new(file), beside, path: folder.join(name) })
    }

    fn with(folder: &Path, name: &str, text: &str) -> Result<Draft, DatasetError> {
        let mut draft = Draft::new(folder, name)?;
        draft.write(text)?;
        Ok(draft)
    }

    fn write(&mut self, text: &str) -> Result<(), DatasetError> {
        self.out.write_all(text.as_bytes()).map_err(DatasetError::io("writing", &self.beside))
    }

    fn publish(mut self) -> Result<(), DatasetError> {
        self.out.flush().map_err(DatasetError::io("writing", &self.beside))?;
        fs::rename(&self.beside, &self.path).map_err(DatasetError::io("renaming to", &self.path))
    }
}
