//! Tables of a run: views of its journal, each written completely or not at all.

use super::characteristics::{Repeatability, Staircases, UnitCharacteristics, characterise};
use super::files::{self, Draft};
use super::press::{RunColumns, csv_header, csv_line};
use super::{DatasetError, MonitorValue, Peaks, Press, PressTruth, RecordedContact, RecordedContacts, round};
use crate::recipe::Phase;
use palpate_core::quantity::ArrayLayout;
use std::fs;
use std::path::{Path, PathBuf};

/// File names: table of all presses, table of the true forces of a simulated run, values of the monitors, and characteristics of each unit.
pub(super) const PRESSES: &str = "presses.csv";
pub(super) const SCENE: &str = "scene.csv";
const MONITORS: &str = "monitors.csv";
const CHARACTERISTICS: &str = "characteristics.csv";

/// Tables that have one column for each point.
pub(super) const MATRICES: [(Phase, &str); 2] =
    [(Phase::Calibration, "calibration_matrix.csv"), (Phase::Test, "test_matrix.csv")];

/// All tables a run may have.
pub const TABLES: [&str; 6] = [PRESSES, CHARACTERISTICS, MATRICES[0].1, MATRICES[1].1, SCENE, MONITORS];

/// Largest number of outputs that are held at once to turn columns into rows: 8 MB.
const OUTPUTS_MAX: usize = 1 << 19;

/// Writes every table that follows from a run's contacts, each completely or not at all. Removes tables that don't follow from
/// them. `contacts` reads the contacts from the beginning each time, in the
/// order of their numbers. One contact is held at a time.
pub(super) fn write<'a>(
    folder: &Path,
    layout: &ArrayLayout,
    columns: RunColumns,
    contacts: &dyn Fn() -> Result<RecordedContacts<'a>, DatasetError>,
    trips: &[(Option<u64>, Peaks)],
) -> Result<(), DatasetError> {
    let mut presses = TableFile::new(folder, PRESSES)?;
    let (mut scene, mut monitors): (Option<TableFile>, Option<TableFile>) = (None, None);
    // a reading for each level of the characterisation only, of one unit: its statistics need it
    let mut staircases = Staircases::none(layout);
    let mut matrices = MATRICES.map(|(phase, name)| (phase, name, 0));
    presses.write(&csv_header(layout.len(), columns))?;
    for contact in contacts()? {
        let contact = contact?;
        for press in &contact.levels {
            presses.write(&csv_line(press, columns))?;
            matrices.iter_mut().filter(|(phase, ..)| press.is_of(*phase)).for_each(|(_, _, points)| *points += 1);
        }
        staircases.add_contact(&contact, layout);
        if !contact.truth.is_empty() {
            opened(&mut scene, folder, SCENE, SCENE_HEADER)?.write(&scene_lines(&contact))?;
        }
        if !contact.monitors.is_empty() {
            opened(&mut monitors, folder, MONITORS, MONITORS_HEADER)?.write(&monitor_lines(&contact))?;
        }
    }
    for (press, Peaks { force_peak_n, depth_peak_mm }) in trips {
        let press = press.map_or_else(String::new, |press| press.to_string());
        opened(&mut scene, folder, SCENE, SCENE_HEADER)?
            .write(&format!("{press},trip,,{force_peak_n},{depth_peak_mm}\n"))?;
    }
    presses.publish()?;
    let staircases = staircases.some();
    let follows = |name: &str| match name {
        SCENE => scene.is_some(),
        MONITORS => monitors.is_some(),
        CHARACTERISTICS => staircases.is_some(),
        _ => name == PRESSES || matrices.iter().any(|(_, matrix, points)| *matrix == name && *points > 0),
    };
    for stray in TABLES.into_iter().filter(|name| !follows(name)).map(|name| folder.join(name)) {
        files::check_replaceable(&stray).map_err(DatasetError::io("removing", &stray))?;
        if stray.is_file() {
            fs::remove_file(&stray).map_err(DatasetError::io("removing", stray))?;
        }
    }
    for (phase, name, points) in matrices.into_iter().filter(|(_, _, points)| *points > 0) {
        let mut matrix = TableFile::new(folder, name)?;
        write_matrix(&mut matrix, phase, points, layout.len(), contacts)?;
        matrix.publish()?;
    }
    if let Some(staircases) = staircases {
        replace(folder, CHARACTERISTICS, &characteristics(&staircases))?;
    }
    scene.into_iter().chain(monitors).try_for_each(TableFile::publish)
}

/// Writes a matrix with a row for each channel, a column for each point, and no header: the paper's calibration matrix. The
/// contacts arrive point by point, so they are read once for as many channels as can be held. Except for very many points, one
/// reading is enough.
fn write_matrix<'a>(
    matrix: &mut TableFile,
    phase: Phase,
    points: usize,
    channels: usize,
    contacts: &dyn Fn() -> Result<RecordedContacts<'a>, DatasetError>,
) -> Result<(), DatasetError> {
    let at_once = (OUTPUTS_MAX / points).max(1);
    // a missed output is blank
    let output = |press: &Press, channel: usize| press.outputs.get(channel).copied().filter(|output| !output.is_nan());
    for first in (0..channels).step_by(at_once) {
        let here = first..channels.min(first + at_once);
        let mut lines: Vec<Vec<_>> = here.clone().map(|_| Vec::with_capacity(points)).collect();
        for contact in contacts()? {
            for press in contact?.levels.iter().filter(|press| press.is_of(phase)) {
                here.clone().zip(&mut lines).for_each(|(channel, line)| line.push(output(press, channel)));
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

/// One column of `characteristics.csv`.
#[derive(Clone, Copy)]
pub struct Characteristic {
    /// Name in the header.
    pub name: &'static str,
    /// What the column contains, in a sentence.
    pub definition: &'static str,
    of: fn(&UnitCharacteristics) -> Option<f64>,
}

impl Characteristic {
    /// Returns the value of a unit, rounded as in the table; `None` if the readings don't determine it.
    pub fn of(&self, unit: &UnitCharacteristics) -> Option<f64> {
        (self.of)(unit).map(|value| round(value, 4))
    }
}

/// Columns of `characteristics.csv` after the unit and its channel.
pub const CHARACTERISTIC_COLUMNS: [Characteristic; 10] = [
    Characteristic {
        name: "repeatability_loading_percent",
        definition: "Three standard deviations of repeated loading outputs.",
        of: |unit| unit.repeatability_loading_percent,
    },
    Characteristic {
        name: "repeatability_unloading_percent",
        definition: "Three standard deviations of repeated unloading outputs.",
        of: |unit| unit.repeatability_unloading_percent,
    },
    Characteristic {
        name: "hysteresis_percent",
        definition: "Largest difference between unloading and loading.",
        of: |unit| unit.hysteresis_percent,
    },
    Characteristic {
        name: "hysteresis_of_reading_percent",
        definition: "Largest difference between unloading and loading, relative to the mean reading at the same force.",
        of: |unit| unit.hysteresis_of_reading_percent,
    },
    Characteristic {
        name: "linearity_percent",
        definition: "Largest deviation of loading outputs from a straight line.",
        of: |unit| unit.linearity_percent,
    },
    Characteristic {
        name: "zero_return_percent",
        definition: "Output without load after the load minus output without load before the load.",
        of: |unit| unit.zero_return_percent,
    },
    Characteristic {
        name: "repeatability_loading_least_percent",
        definition: "Lower end of the 95 % interval of the repeatability while loading.",
        of: |unit| Some(unit.repeatability_loading_interval_percent?.0),
    },
    Characteristic {
        name: "repeatability_loading_most_percent",
        definition: "Upper end of the 95 % interval of the repeatability while loading.",
        of: |unit| Some(unit.repeatability_loading_interval_percent?.1),
    },
    Characteristic {
        name: "repeatability_unloading_least_percent",
        definition: "Lower end of the 95 % interval of the repeatability while unloading.",
        of: |unit| Some(unit.repeatability_unloading_interval_percent?.0),
    },
    Characteristic {
        name: "repeatability_unloading_most_percent",
        definition: "Upper end of the 95 % interval of the repeatability while unloading.",
        of: |unit| Some(unit.repeatability_unloading_interval_percent?.1),
    },
];

fn characteristics(staircases: &Staircases) -> String {
    let units = characterise(staircases, Repeatability::default());
    // a unit with one channel needs no column for it
    let has_channels = units.iter().any(|unit| unit.channel.is_some());
    let channel_head = if has_channels { "channel," } else { "" };
    let mut text = format!("unit,{channel_head}{}\n", CHARACTERISTIC_COLUMNS.map(|column| column.name).join(","));
    let cell = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.4}"));
    for unit in units {
        let channel = if has_channels { format!("{},", unit.channel.unwrap_or(1)) } else { String::new() };
        text += &format!(
            "{},{channel}{}\n",
            unit.unit,
            CHARACTERISTIC_COLUMNS.map(|column| cell(column.of(&unit))).join(",")
        );
    }
    text
}

const SCENE_HEADER: &str = "press,level,force_true_n,force_peak_n,depth_peak_mm\n";
const MONITORS_HEADER: &str = "press,name,t_s,value\n";

/// Returns a table that is created with its first row.
fn opened<'t>(
    table: &'t mut Option<TableFile>,
    folder: &Path,
    name: &str,
    header: &str,
) -> Result<&'t mut TableFile, DatasetError> {
    match table {
        Some(table) => Ok(table),
        None => Ok(table.insert(TableFile::with(folder, name, header)?)),
    }
}

fn scene_lines(contact: &RecordedContact) -> String {
    let line = |(press, truth): (&Press, &PressTruth)| {
        let PressTruth { force_true_n, force_peak_n, depth_peak_mm } = truth;
        format!("{},{},{force_true_n},{force_peak_n},{depth_peak_mm}\n", press.press, press.level)
    };
    contact.levels.iter().zip(&contact.truth).map(line).collect()
}

/// No cell needs quotation marks: a rig allows no other characters in a name than letters, digits and underscores.
fn monitor_lines(contact: &RecordedContact) -> String {
    let line = |monitor: &MonitorValue| {
        let MonitorValue { name, t_s, value } = monitor;
        format!("{},{name},{t_s},{value}\n", contact.press)
    };
    contact.monitors.iter().map(line).collect()
}

/// Table that is being written and is then renamed to its final path.
struct TableFile {
    draft: Draft,
    path: PathBuf,
}

impl TableFile {
    fn new(folder: &Path, name: &str) -> Result<TableFile, DatasetError> {
        let path = folder.join(name);
        let draft = Draft::new(&path).map_err(DatasetError::io("writing", &path))?;
        Ok(TableFile { draft, path })
    }

    fn with(folder: &Path, name: &str, text: &str) -> Result<TableFile, DatasetError> {
        let mut table = TableFile::new(folder, name)?;
        table.write(text)?;
        Ok(table)
    }

    fn write(&mut self, text: &str) -> Result<(), DatasetError> {
        self.draft.write(text).map_err(DatasetError::io("writing", &self.path))
    }

    fn publish(self) -> Result<(), DatasetError> {
        self.draft.publish().map_err(DatasetError::io("renaming to", self.path))
    }
}

/// Writes a temporary file next to the final path and renames it.
pub(super) fn replace(folder: &Path, name: &str, text: &str) -> Result<(), DatasetError> {
    TableFile::with(folder, name, text)?.publish()
}
