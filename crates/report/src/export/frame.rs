//! Frames: tables of a run in memory, each column with its unit and its definition.
//!
//! The numbers are those of the run's own tables, to the last bit. Every format of an export is written from a frame.

use palpate_core::quantity::ArrayLayout;
use palpate_data::dataset::characteristics::{Repeatability, Staircases, UnitCharacteristics, characterise};
use palpate_data::dataset::{
    CHARACTERISTIC_COLUMNS, COLUMNS, CellType, CellValue, MonitorValue, OUTPUTS, Press, PressTruth, Presses, Recorded,
    RecordedContact, RunColumns, output_name,
};
use palpate_data::recipe::Phase;
use palpate_run::rig::Bench;
use std::borrow::Cow;
use std::ops::Range;

/// A table in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportTable {
    /// Name of the table: `presses`, `calibration_matrix`, ...
    pub name: &'static str,
    /// Number of rows of every column.
    pub rows: usize,
    /// Columns in the order in which they are written.
    pub columns: Vec<TableColumn>,
}

/// One column of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct TableColumn {
    /// Name, the same in all formats.
    pub name: String,
    /// Unit, such as `mm` or `N`; empty if the values have none.
    pub unit: String,
    /// What the column contains, in a sentence.
    pub definition: String,
    /// Values, one for each row.
    pub values: Values,
}

/// Values of a column.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Numbers; NaN if a value is missing.
    F64(Vec<f64>),
    /// Integers; none is missing.
    I64(Vec<i64>),
    /// Texts; `None` if a value is missing.
    Text(Vec<Option<Cow<'static, str>>>),
    /// Truth values; none is missing.
    Bool(Vec<bool>),
}

/// Definition of the matrices' columns of outputs.
const OUTPUT: &str = "Mean output of the channel in the window minus its output without load, in the array's unit.";

/// Returns every frame that a run has: presses, matrices, characteristics, truth and monitors. Frames without rows are left out, except
/// the presses.
pub fn all(run: &Recorded, bench: &Bench) -> Vec<ExportTable> {
    let others = [
        Some(matrix(run, bench, Phase::Calibration)),
        Some(matrix(run, bench, Phase::Test)),
        characteristics(run, &bench.layout),
        Some(truth(run)),
        Some(monitors(run)),
    ];
    let others = others.into_iter().flatten().filter(|frame| frame.rows > 0);
    std::iter::once(presses(run, bench)).chain(others).collect()
}

/// Returns the presses of a run in the order of its plan: the columns of `presses.csv`. A row is one level of one press.
pub fn presses(run: &Recorded, bench: &Bench) -> ExportTable {
    presses_with(&run.presses().presses, run.manifest.facts.columns(), bench.layout.len(), &bench.unit)
}

/// Returns some presses of an array with `channels` outputs in `unit`, with the columns that have values.
pub fn presses_of(presses: &[Press], channels: usize, unit: &str) -> ExportTable {
    let by_depth = presses.iter().any(|press| press.depth_set_mm.is_some());
    let has_load_cell = !by_depth || presses.iter().any(|press| press.force_n.is_some());
    let three_axes = presses.iter().any(|press| press.force_x_n.is_some());
    let grouped = presses.iter().any(|press| press.group.is_some());
    presses_with(presses, RunColumns { by_depth, has_load_cell, three_axes, grouped }, channels, unit)
}

/// Returns the same with the columns of the run.
pub(crate) fn presses_with(presses: &[Press], columns: RunColumns, channels: usize, unit: &str) -> ExportTable {
    let columns = columns.all().flat_map(|column| match column.name {
        OUTPUTS => outputs(presses.iter(), channels, unit),
        name => vec![TableColumn::new(name, column.definition, Values::of(column.kind, presses, column))],
    });
    ExportTable { name: "presses", rows: presses.len(), columns: columns.collect() }
}

/// Returns the outputs of a phase, one row for each place in the order of the plan: the transposed `calibration_matrix.csv` or
/// `test_matrix.csv`, with the press and its place.
pub fn matrix(run: &Recorded, bench: &Bench, phase: Phase) -> ExportTable {
    let all = run.presses();
    let its: Vec<&Press> = all.presses.iter().filter(|press| press.is_of(phase)).collect();
    let number = |of: fn(&Press) -> f64| Values::F64(its.iter().map(|press| of(press)).collect());
    let count = |of: fn(&Press) -> u64| Values::I64(its.iter().map(|press| of(press) as i64).collect());
    let mut columns = vec![
        TableColumn::new("press", definition("press"), count(|press| press.press)),
        TableColumn::new("level", definition("level"), count(|press| press.level)),
        TableColumn::new("x_mm", definition("x_mm"), number(|press| press.x_mm)),
        TableColumn::new("y_mm", definition("y_mm"), number(|press| press.y_mm)),
        TableColumn::new("force_n", definition("force_n"), number(|press| press.force_n.unwrap_or(f64::NAN))),
    ];
    columns.extend(outputs(its.iter().copied(), bench.layout.len(), &bench.unit));
    let name = if phase == Phase::Test { "test_matrix" } else { "calibration_matrix" };
    ExportTable { name, rows: its.len(), columns }
}

/// Returns the characteristics of each unit, as in `characteristics.csv`; `None` if the run has no staircases.
pub fn characteristics(run: &Recorded, layout: &ArrayLayout) -> Option<ExportTable> {
    characteristics_of(&run.presses(), layout)
}

/// Returns the same from the presses of a characterisation.
pub(crate) fn characteristics_of(presses: &Presses, layout: &ArrayLayout) -> Option<ExportTable> {
    let units = characterise(&Staircases::of_run(presses, layout)?, Repeatability::default());
    let count = |of: fn(&UnitCharacteristics) -> usize| Values::I64(units.iter().map(|unit| of(unit) as i64).collect());
    let mut columns = vec![TableColumn::new("unit", "Number of the unit, from 1.", count(|unit| unit.unit))];
    if units.iter().any(|unit| unit.channel.is_some()) {
        let channels = count(|unit| unit.channel.unwrap_or(1));
        columns.push(TableColumn::new("channel", "The channel of the unit, from 1.", channels));
    }
    columns.extend(CHARACTERISTIC_COLUMNS.iter().map(|column| {
        let values = units.iter().map(|unit| column.of(unit).unwrap_or(f64::NAN)).collect();
        TableColumn::new(column.name, column.definition, Values::F64(values))
    }));
    Some(ExportTable { name: "characteristics", rows: units.len(), columns })
}

/// Returns the true values of a simulated run in the order of its plan, as in `scene.csv`. Presses that tripped have no row.
pub fn truth(run: &Recorded) -> ExportTable {
    let mut contacts: Vec<&RecordedContact> = run.contacts.iter().collect();
    contacts.sort_by_key(|contact| contact.press);
    let rows: Vec<(&Press, &PressTruth)> =
        contacts.iter().flat_map(|contact| contact.levels.iter().zip(&contact.truth)).collect();
    let count = |of: fn(&Press) -> u64| Values::I64(rows.iter().map(|(press, _)| of(press) as i64).collect());
    let number = |of: fn(&PressTruth) -> f64| Values::F64(rows.iter().map(|(_, truth)| of(truth)).collect());
    let columns = vec![
        TableColumn::new("press", definition("press"), count(|press| press.press)),
        TableColumn::new("level", definition("level"), count(|press| press.level)),
        TableColumn::new("force_true_n", "Mean true force in the window, N.", number(|truth| truth.force_true_n)),
        TableColumn::new(
            "force_peak_n",
            "Largest true force since the previous row of the press, or since its beginning, N.",
            number(|truth| truth.force_peak_n),
        ),
        TableColumn::new(
            "depth_peak_mm",
            "Largest indentation since the previous row of the press, mm.",
            number(|truth| truth.depth_peak_mm),
        ),
    ];
    ExportTable { name: "truth", rows: rows.len(), columns }
}

/// Returns the values of the monitors at each press, as in `monitors.csv`.
pub fn monitors(run: &Recorded) -> ExportTable {
    let mut rows: Vec<(i64, &MonitorValue)> = Vec::new();
    for contact in &run.contacts {
        rows.extend(contact.monitors.iter().map(|monitor| (contact.press as i64, monitor)));
    }
    rows.sort_by_key(|(press, _)| *press); // stable: the monitors of a press stay in their order
    let number = |of: fn(&MonitorValue) -> f64| Values::F64(rows.iter().map(|(_, monitor)| of(monitor)).collect());
    let names = rows.iter().map(|(_, monitor)| Some(Cow::Owned(monitor.name.clone()))).collect();
    let columns = vec![
        TableColumn::new("press", definition("press"), Values::I64(rows.iter().map(|(press, _)| *press).collect())),
        TableColumn::new("name", "Name of the monitor, which ends in the unit of its value.", Values::Text(names)),
        TableColumn::new("t_s", "Time of the reading, s since the run's start.", number(|monitor| monitor.t_s)),
        TableColumn::new("value", "Value, read without load before the press.", number(|monitor| monitor.value)),
    ];
    ExportTable { name: "monitors", rows: rows.len(), columns }
}

/// Returns the manifest of a run as a JSON object.
pub fn manifest(run: &Recorded) -> String {
    // text and numbers can't fail to be written
    serde_json::to_string(&run.manifest).unwrap_or_default()
}

impl ExportTable {
    /// Returns the positions of the columns of outputs, `out_1` to `out_n`, which follow each other; empty without outputs.
    pub fn outputs(&self) -> Range<usize> {
        let first = self.columns.iter().position(|column| column.name == output_name(1)).unwrap_or_default();
        let count = self.columns[first..].iter().enumerate();
        let count = count.take_while(|(index, column)| column.name == output_name(index + 1)).count();
        first..first + count
    }

    /// Returns a column by its name.
    pub fn column(&self, name: &str) -> Option<&TableColumn> {
        self.columns.iter().find(|column| column.name == name)
    }
}

impl TableColumn {
    /// Creates a column. Its unit follows from the end of its name.
    pub fn new(name: impl Into<String>, definition: &str, values: Values) -> TableColumn {
        let name = name.into();
        TableColumn { unit: unit_of(&name).to_owned(), name, definition: definition.to_owned(), values }
    }
}

impl Values {
    /// Takes the values of some presses in a column with one cell a row.
    fn of(kind: CellType, presses: &[Press], column: &palpate_data::dataset::PressColumn) -> Values {
        match kind {
            CellType::Count => Values::I64(each(presses, column, |value| match value {
                CellValue::Count(count) => count as i64,
                _ => 0,
            })),
            CellType::Number => Values::F64(each(presses, column, |value| match value {
                CellValue::Number(number) => number,
                _ => f64::NAN,
            })),
            CellType::Text => Values::Text(each(presses, column, |value| match value {
                CellValue::Text("") => Some(Cow::Borrowed("")),
                CellValue::Text(text) => Some(
                    Phase::ALL
                        .into_iter()
                        .find(|phase| phase.name() == text)
                        .map_or_else(|| Cow::Owned(text.to_owned()), |phase| Cow::Borrowed(phase.name())),
                ),
                _ => None,
            })),
        }
    }
}

/// Returns one value of each press.
fn each<T>(presses: &[Press], column: &palpate_data::dataset::PressColumn, of: impl Fn(CellValue<'_>) -> T) -> Vec<T> {
    let mut values = Vec::with_capacity(presses.len());
    presses.iter().for_each(|press| column.write(press, &mut |value| values.push(of(value))));
    values
}

/// Returns the columns of outputs of some presses.
fn outputs<'a>(presses: impl Iterator<Item = &'a Press> + Clone, channels: usize, unit: &str) -> Vec<TableColumn> {
    let column = |channel: usize| {
        let values = presses.clone().map(|press| press.outputs.get(channel).copied().unwrap_or(f64::NAN));
        let values = Values::F64(values.collect());
        TableColumn { name: output_name(channel + 1), unit: unit.to_owned(), definition: OUTPUT.to_owned(), values }
    };
    (0..channels).map(column).collect()
}

/// Definition of a column of `presses.csv`.
fn definition(name: &str) -> &'static str {
    COLUMNS.iter().find(|column| column.name == name).map_or("", |column| column.definition)
}

/// Unit of a column, which is at the end of its name.
fn unit_of(name: &str) -> &'static str {
    match name.rsplit('_').next() {
        _ if !name.contains('_') => "",
        Some("mm") => "mm",
        Some("n") => "N",
        Some("s") => "s",
        Some("percent") => "%",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_of_presses_has_its_unit_and_its_definition() {
        let press = Press { outputs: vec![0.5, -0.25], force_n: None, ..Press::default() };
        let frame = presses_of(&[press], 2, "V");
        let units = |name: &str| frame.column(name).map(|column| column.unit.as_str());
        for (name, unit) in
            [("x_mm", "mm"), ("force_n", "N"), ("t_s", "s"), ("out_2", "V"), ("press", ""), ("air_after_n", "N")]
        {
            assert_eq!(units(name), Some(unit), "{name}");
        }
        assert_eq!(frame.outputs().len(), 2);
        for column in &frame.columns {
            let definition = &column.definition;
            assert!(definition.ends_with('.') && !definition.contains("  "), "{}: {definition}", column.name);
        }
        let values = |name: &str| frame.column(name).map(|column| column.values.clone());
        assert_eq!(values("out_2"), Some(Values::F64(vec![-0.25])));
        assert!(matches!(values("force_n"), Some(Values::F64(missing)) if missing[0].is_nan()));
        assert_eq!(values("phase"), Some(Values::Text(vec![None])));
        assert_eq!(values("flags"), Some(Values::Text(vec![Some(Cow::Borrowed(""))])));
    }
}
