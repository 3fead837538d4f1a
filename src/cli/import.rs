//! `palpate import`: makes a run folder from tables that another program recorded.

use super::output::OutputArgs;
use super::summary::{note, tell};
use crate::api::ColumnsOptions;
use crate::api::Failure;
use crate::api::LabelOptions;
use crate::api::provenance::{now, session};
use crate::api::recorded::{read_presses, warn_of_units};
use crate::api::stdin;
use palpate_control::Glitches;
use palpate_core::quantity::{Place, round};
use palpate_data::dataset::{
    DatasetError, Durability, Fingerprint, Imported, Ledger as _, Mapping, Origins, Press, Presses, Record,
    RecordedContact, RunFacts, RunFolder, SessionEnd, Status,
};
use palpate_data::recipe::Phase;
use palpate_run::rig::Bench;
use serde::Serialize;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

const EXAMPLES: &str = "\
Examples:
  palpate import grid.csv --test random.csv --columns columns.toml --sensor A-017
  palpate import grid.csv --columns x_mm=X,y_mm=Y,force_n=Fz,outputs=ch0..ch15
  palpate import grid.xlsx --sheet Data
  palpate report runs/grid

Tables are CSV; with the feature `files` also .xlsx, .npz, .mat (v5) and .parquet.
The run folder states that its presses were imported, with the SHA-256 of the
tables and of the columns file; pages and certificates repeat it. A row with a
blank cell or NaN is excluded when --columns is given. `palpate init --from tables`
writes a columns file with comments; `palpate reference columns` lists its keys.";

/// Make a run folder from tables of presses that another program recorded
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ImportArgs {
    /// The table of calibration presses
    calibration: PathBuf,
    /// The table of test presses, with the same columns
    #[arg(long, value_name = "CSV")]
    test: Option<PathBuf>,
    #[command(flatten)]
    columns: ColumnsOptions,
    #[command(flatten)]
    labels: LabelOptions,
    /// Output folder [default: runs/NAME, runs/NAME-2, ...]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
}

/// Reads the tables completely, then creates the folder.
pub(super) fn import(args: &ImportArgs) -> Result<ExitCode, Failure> {
    let started = Instant::now();
    let columns = args.columns.read()?;
    let mapping = args.columns.mapping()?;
    let paths = [(Some(&args.calibration), Phase::Calibration), (args.test.as_ref(), Phase::Test)];
    let given = || paths.into_iter().filter_map(|(path, phase)| Some((path?, phase)));
    let tables: Vec<(Presses, Phase)> = given()
        .map(|(path, phase)| Ok((read_presses(path, &mapping, Some(phase), &note)?, phase)))
        .collect::<Result<_, Failure>>()?;
    let outputs = tables[0].0.channels;
    check_outputs(&tables, &mapping)?;
    if let [(calibration, _), (test, _)] = tables.as_slice() {
        warn_of_units(calibration, test, &note);
    }
    let imported = Imported {
        tables: given()
            .map(|(path, _)| stdin::fingerprint(path).map_err(Failure::dataset))
            .collect::<Result<_, _>>()?,
        columns: columns.as_ref().map(|columns| Fingerprint::of(&file_name(&columns.name), columns.text.as_bytes())),
        outputs: outputs as u64,
        notes: tables
            .iter()
            .flat_map(|(table, _)| table.detected.iter().map(|note| format!("{}: {note}", file_name(&table.source))))
            .collect(),
        measured: mapping.measured.clone(),
    };
    check_forces(&tables)?;
    let ranges: Vec<Ranges> = tables.iter().map(|(table, phase)| Ranges::of(table, *phase)).collect();
    let presses: usize = tables.iter().map(|(table, _)| table.presses.len()).sum();
    let has = |of: fn(&Press) -> bool| tables.iter().any(|(table, _)| table.presses.iter().any(of));
    let facts = RunFacts {
        recipe: name_of(&args.calibration),
        labels: args.labels.labels(),
        presses_planned: presses as u64,
        imported: Some(imported),
        three_axes: has(|press| press.force_x_n.is_some()),
        grouped: has(|press| press.group.is_some()),
        ..RunFacts::default()
    };
    let bench = Bench::of_import(mapping.array.clone(), outputs);
    if let Some(outside) = outside(&bench, &tables) {
        tell(&outside)?;
    }
    let origins = Origins::of_import(columns.map(|columns| columns.text));
    let folder = RunFolder::create(args.out.as_deref(), &origins, facts, session(Durability::Fast), &bench.layout);
    let mut folder = folder.map_err(Failure::dataset)?;
    record(&mut folder, tables, mapping.is_series(), started).map_err(Failure::dataset)?;
    let path = folder.path().display().to_string();
    if !bench.is_placed {
        tell("note: the positions of the units aren't known (`array` of the columns file)\n")?;
    }
    let lines: String = ranges.iter().map(Ranges::line).collect();
    let text =
        format!("{path}: {presses} presses of {outputs} outputs imported\n{lines}next: palpate evaluate {path}\n");
    let content = json!({
        "run": path, "presses": presses, "outputs": outputs, "positions_known": bench.is_placed, "ranges": ranges,
    });
    args.output.print(&text, &content)?;
    Ok(ExitCode::SUCCESS)
}

/// Returns the name of a file without its folder, which means nothing on another machine.
fn file_name(path: &str) -> String {
    Path::new(path).file_name().map_or_else(|| path.to_owned(), |name| name.to_string_lossy().into_owned())
}

/// Checks that the tables are of one array, and of the array in the columns file.
fn check_outputs(tables: &[(Presses, Phase)], mapping: &Mapping) -> Result<(), Failure> {
    let (first, outputs) = (&tables[0].0.source, tables[0].0.channels);
    if let Some((other, _)) = tables.iter().find(|(table, _)| table.channels != outputs) {
        let text = format!("{first} has {outputs} outputs, {} has {}", other.source, other.channels);
        return Err(Failure::usage(miette::miette!(help = "import tables of one sensor together", "{text}")));
    }
    match &mapping.array {
        Some((layout, _)) if layout.len() != outputs => {
            let text = format!("{first} has {outputs} outputs, but `array` of the columns file has {}", layout.len());
            let help = "correct grid, places_mm or channels_per_unit, or name the columns in `outputs`";
            Err(Failure::usage(miette::miette!(help = help, "{text}")))
        }
        _ => Ok(()),
    }
}

/// Checks the sign of the forces. A calibration with only pulling forces has the wrong sign.
fn check_forces(tables: &[(Presses, Phase)]) -> Result<(), Failure> {
    let is_pulled =
        |(table, _): &&(Presses, Phase)| table.presses.iter().all(|press| press.force_n.is_some_and(|n| n < 0.0));
    let Some((table, _)) = tables.iter().find(is_pulled) else { return Ok(()) };
    let help = "pressing is a positive force: write a columns file with `force_n = -1.0` in [scale]";
    Err(Failure::usage(miette::miette!(help = help, "{}: all forces are negative", table.source)))
}

/// From how many times the width of the array the presses are probably in another unit.
const WIDER: f64 = 20.0;

/// Returns the smallest and the largest x and y of some places, mm.
fn extent(places: impl Iterator<Item = Place>) -> [(f64, f64); 2] {
    let wider = |(least, most): (f64, f64), mm: f64| (least.min(mm), most.max(mm));
    places.fold([(f64::MAX, f64::MIN); 2], |[x, y], place| [wider(x, place.x_mm), wider(y, place.y_mm)])
}

/// Returns a warning if the area of the presses doesn't fit the array: another unit of length, or another origin.
fn outside(bench: &Bench, tables: &[(Presses, Phase)]) -> Option<String> {
    let units = bench.placed()?.one_per_unit();
    let area = extent(tables.iter().flat_map(|(table, _)| &table.presses).map(Press::place));
    let width = |[x, y]: [(f64, f64); 2]| (x.1 - x.0).max(y.1 - y.0);
    let (array_mm, area_mm) = (width(extent(units.places().iter().copied())), width(area));
    if array_mm > 0.0 && area_mm > WIDER * array_mm {
        return Some(format!(
            "warning: the presses are over {area_mm} mm, but the array is {array_mm} mm wide:\n  \
             if places are in um, set x_mm = 0.001 in [scale]\n"
        ));
    }
    let [x, y] = area;
    let is_outside = |unit: &&Place| unit.x_mm < x.0 || unit.x_mm > x.1 || unit.y_mm < y.0 || unit.y_mm > y.1;
    let count = units.places().iter().filter(is_outside).count();
    let all = units.len();
    (2 * count > all).then(|| {
        format!(
            "warning: {count} of {all} units are outside the area of the presses:\n  \
             check the origin (`grid` is centred on x = y = 0; [offset] moves the presses)\n"
        )
    })
}

/// Smallest and largest values of a table's presses, in which a wrong column or unit is visible.
#[derive(Serialize)]
struct Ranges {
    phase: &'static str,
    x_mm: Option<(f64, f64)>,
    y_mm: Option<(f64, f64)>,
    force_n: Option<(f64, f64)>,
}

impl Ranges {
    fn of(table: &Presses, phase: Phase) -> Ranges {
        let range = |of: fn(&Press) -> Option<f64>| {
            let values = || table.presses.iter().filter_map(of);
            values().reduce(f64::min).zip(values().reduce(f64::max))
        };
        let [x_mm, y_mm] = [range(|press| Some(press.x_mm)), range(|press| Some(press.y_mm))];
        Ranges { phase: phase.name(), x_mm, y_mm, force_n: range(|press| press.force_n) }
    }

    fn line(&self) -> String {
        let shown = |(least, most): (f64, f64)| format!("{} to {}", round(least, 3), round(most, 3));
        let [x, y] = [self.x_mm, self.y_mm].map(|range| range.map(shown).unwrap_or_default());
        let force = self.force_n.map_or(", no forces".to_owned(), |range| format!(", force {} N", shown(range)));
        format!("  {:<12} x {x} mm, y {y} mm{force}\n", self.phase)
    }
}

/// Returns the name of a run from its table, without folder, extension, and characters that a path can't have.
fn name_of(table: &Path) -> String {
    let stem = table.file_stem().unwrap_or_default().to_string_lossy();
    let fit = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '-' };
    let name: String = stem.chars().map(fit).collect();
    match name.trim_matches(['-', '.']) {
        "" => "import".to_owned(),
        name => name.to_owned(),
    }
}

/// Records every press as a separate contact, then the end. The readings of a series have their time since its first one.
fn record(
    folder: &mut RunFolder,
    tables: Vec<(Presses, Phase)>,
    is_series: bool,
    started: Instant,
) -> Result<(), DatasetError> {
    let began_s = tables[0].0.presses.first().and_then(|press| press.t_s).filter(|_| is_series);
    let presses =
        tables.into_iter().flat_map(|(table, phase)| table.presses.into_iter().map(move |press| (press, phase)));
    for (number, (mut press, phase)) in presses.enumerate() {
        press.press = number as u64;
        press.phase = Some(phase);
        // a time of another program isn't the time since the run's start; otherwise only the order is kept
        press.t_s = press.t_s.zip(began_s).map(|(t_s, began_s)| t_s - began_s);
        let contact = RecordedContact { press: press.press, levels: vec![press], ..RecordedContact::default() };
        folder.record(&Record::Contact(contact))?;
    }
    let wall_s = started.elapsed().as_secs_f64();
    let (status, ended) = (Status::Complete, now());
    folder.finish(SessionEnd {
        status,
        t_s: 0.0,
        ended,
        wall_s,
        failure: None,
        cell_unchecked: false,
        cell_off: None,
        glitches: Glitches::default(),
        series: None,
    })
}
