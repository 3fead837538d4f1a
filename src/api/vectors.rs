//! Place and force vector from presses and drags: `evaluate --vector` and `solve --vector`.

use super::recorded::{read_presses, read_run};
use super::solutions::io_error;
use super::solve::{SOURCE, unwritten};
use super::vector_answer::{VectorAnswer, VectorSolver};
use super::{Failure, Note, SolveOptions};
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_data::dataset::readings::{LineContent, Reading, Readings, StreamLines};
use palpate_data::dataset::{Mapping, Press, Presses};
use palpate_data::recipe::Phase;
use palpate_solver::vector::{DraggedRow, VectorError, VectorErrors, VectorMap, VectorRow, VectorWorkspace};
use serde_json::Value;
use std::collections::HashMap;
use std::io::{self, BufWriter, Read, Write};
use std::path::Path;

/// Evaluates a run, or a table of calibration and a table of test presses.
pub(super) fn evaluated(
    [calibration, test]: [Option<&Path>; 2],
    mapping: &Mapping,
    note: Note<'_>,
) -> Result<VectorErrors, Failure> {
    let Some(calibration) = calibration else {
        return Err(Failure::usage(miette::miette!("--vector needs a run, or two tables")));
    };
    let [calibration, test] = match test {
        Some(_) if calibration.is_dir() => {
            let help = "a run has its own test presses: name it alone";
            return Err(Failure::usage(miette::miette!(help = help, "--vector needs a run, or two tables")));
        }
        Some(test) => [read_presses(calibration, mapping, None, note)?, read_presses(test, mapping, None, note)?],
        None if calibration.is_dir() => {
            let (recorded, _) = read_run(calibration, note)?;
            let all = recorded.presses();
            [Phase::Calibration, Phase::Test].map(|phase| of_phase(&all, phase))
        }
        None => {
            let help = "name a second table with test presses";
            return Err(Failure::usage(miette::miette!(help = help, "--vector needs a run, or two tables")));
        }
    };
    let map = fitted(&calibration, note)?;
    VectorErrors::of(&map, test.presses.iter().filter_map(row)).ok_or_else(|| {
        Failure::usage(miette::miette!("{}: no test press has three components of the force", test.source))
    })
}

/// Fits presses and drags.
fn fitted(calibration: &Presses, note: Note<'_>) -> Result<VectorMap, Failure> {
    // a press is before its drag; another session may use its number again
    let mut pressed: HashMap<u64, Place> = HashMap::new();
    let dragged = |press: &'_ Press| {
        if !press.is_dragged() {
            pressed.insert(press.press, press.place());
        }
        pressed.get(&press.press).copied().unwrap_or(press.place())
    };
    let places: Vec<Place> = calibration.presses.iter().map(dragged).collect();
    let with_place = |(press, pressed)| Some(DraggedRow { pressed, row: row(press)? });
    let rows: Vec<DraggedRow<'_>> = calibration.presses.iter().zip(places).filter_map(with_place).collect();
    if rows.is_empty() {
        let help =
            "a load cell with three axes records them, see `axes` of [load_cell]; a table names them in --columns";
        let text = format!("{}: no press of the calibration has three components of the force", calibration.source);
        return Err(Failure::usage(miette::miette!(help = help, "{text}")));
    }
    let map = VectorMap::fit_dragged(&rows).map_err(|error| {
        let help = match error {
            VectorError::TooFewPlaces { .. } => "press more places, over the whole area",
            _ => "record presses and drags with a load cell with three axes: `drag` of a step of the recipe",
        };
        Failure::usage(miette::miette!(help = help, "{}: {error}", calibration.source))
    })?;
    if !map.knows_shear() {
        note(
            "note: no drags show the effect of a force along x and along y: only the press is solved, and its stated errors are those \
             without a force along the surface",
        );
    }
    Ok(map)
}

/// Answers each reading with a place and a force vector, or with two contacts, like `palpate solve --vector`.
///
/// # Errors
/// Bad input, or contacts that can't be written. All earlier contacts are written.
pub fn solve_vectors(
    options: &SolveOptions,
    readings: impl Read,
    contacts: impl Write,
    note: Note<'_>,
) -> Result<(), Failure> {
    let calibration = options.calibration.as_deref().unwrap_or(Path::new(""));
    let mapping = options.method.mapping()?;
    let (presses, layout) = if calibration.is_dir() {
        let (recorded, bench) = read_run(calibration, note)?;
        (of_phase(&recorded.presses(), Phase::Calibration), Some(bench.layout))
    } else {
        let presses = read_presses(calibration, &mapping, None, note)?;
        let layout = mapping.layout_of(presses.channels);
        (presses, layout)
    };
    let map = fitted(&presses, note)?;
    let layout = layout.unwrap_or_else(|| ArrayLayout::from_places(vec![Place::default(); map.outputs()]));
    let solver = VectorSolver::new(&map, &layout);
    let mut lines = StreamLines::new(SOURCE, readings);
    let mut readings = Readings::new(SOURCE, map.outputs(), options.input.map(Into::into), mapping);
    let mut answers = Lines::new(contacts, options.json);
    let mut workspace = VectorWorkspace::default();
    let end = loop {
        let Some(line) = lines.read_next().map_err(Failure::usage)? else { break Ok(()) };
        match readings.read(line) {
            Err(error) | Ok(LineContent::Bad(error)) => break Err(Failure::usage(error)),
            Ok(LineContent::Nothing) => continue,
            Ok(LineContent::Reading) => {}
        }
        if let Err(error) =
            answers.write(readings.reading(), &solver.answer(&readings.reading().outputs, &mut workspace))
        {
            break unwritten(error);
        }
        if lines.is_drained()
            && let Err(error) = answers.flush()
        {
            break unwritten(error);
        }
    };
    match answers.flush() {
        Ok(()) => end,
        Err(error) => end.and_then(|()| unwritten(error)),
    }
}

/// Writes answers, a line each.
enum Lines<W: Write> {
    /// `labels` states whether the columns id and t_s exist. The first reading decides it.
    Csv {
        writer: Box<csv::Writer<W>>,
        labels: Option<[bool; 2]>,
    },
    Ndjson(BufWriter<W>),
}

impl<W: Write> Lines<W> {
    fn new(to: W, json: bool) -> Self {
        match json {
            true => Lines::Ndjson(BufWriter::new(to)),
            false => Lines::Csv { writer: Box::new(csv::Writer::from_writer(to)), labels: None },
        }
    }

    fn write(&mut self, reading: &Reading, answer: &VectorAnswer) -> io::Result<()> {
        let labels_of = [("id", &reading.id), ("t_s", &reading.t_s)];
        match self {
            Lines::Ndjson(to) => {
                let labels = labels_of.into_iter().filter_map(|(name, value)| Some((name, value.clone()?)));
                let fields = labels.chain(answer.fields()).map(|(name, value)| (name.to_owned(), value));
                writeln!(to, "{}", Value::Object(fields.collect()))
            }
            Lines::Csv { writer, labels } => {
                let is_first = labels.is_none();
                let labels = labels.get_or_insert(labels_of.map(|(_, value)| value.is_some()));
                let labels = labels_of.into_iter().zip(*labels).filter(|(_, is_there)| *is_there);
                let labels = labels.map(|((name, value), _)| (name, value.clone().unwrap_or_default()));
                let fields: Vec<(&str, Value)> = labels.chain(answer.fields()).collect();
                if is_first {
                    writer.write_record(fields.iter().map(|(name, _)| name)).map_err(io_error)?;
                }
                let cell = |(_, value): &(&str, Value)| match value {
                    Value::Null => String::new(),
                    Value::String(text) => text.clone(),
                    number => number.to_string(),
                };
                writer.write_record(fields.iter().map(cell)).map_err(io_error)
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Lines::Ndjson(to) => to.flush(),
            Lines::Csv { writer, .. } => writer.flush(),
        }
    }
}

/// Returns the presses of a phase, with those after a drag.
fn of_phase(all: &Presses, phase: Phase) -> Presses {
    let mut presses = all.clone();
    presses.presses.retain(|press| press.phase == Some(phase));
    presses
}

/// Returns the row of a press without a fault.
fn row(press: &Press) -> Option<VectorRow<'_>> {
    let force_n = press.force_vector_n()?;
    (!press.is_flagged()).then(|| VectorRow { place: press.place(), force_n, outputs: &press.outputs })
}
