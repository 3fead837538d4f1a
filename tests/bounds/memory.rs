//! A longer run takes no more memory, because its presses are only on the disk. Solving readings doesn't either.

use crate::HEAP;
use palpate_control::{Glitches, LearnedContact, NoLoadReadings};
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_data::dataset::answers::Answers;
use palpate_data::dataset::readings::{ReadingFormat, Readings, StreamLines};
use palpate_data::dataset::{
    Ledger, Mapping, NoLoad, Origins, Press, PressTruth, Provenance, Record, RecordedContact, RunFacts, RunFolder,
    SessionEnd, Status,
};
use palpate_data::recipe::Phase;
use palpate_solver::{Calibration, CalibrationPoint, Model, Session, Setting};
use palpate_testing::alone::ran_alone;
use std::io::{self, Read};

/// Number of contacts. Each would take more than a kilobyte in memory.
const PRESSES: u64 = 5000;

/// Outputs of each: enough for a matrix that is made in two parts.
const UNITS: usize = 11 * 11;

/// Memory for each press: its position in the journal.
const HELD_BYTES_A_PRESS: usize = 16;

/// Memory for outputs while the matrix is transposed, for any number of presses.
const TURNED_BYTES: usize = 8 << 20;

/// Memory for buffers, for any number of presses.
const BUFFERS_BYTES: usize = 64 << 10;

#[test]
fn run_folder_keeps_positions_of_contacts_in_memory_not_contacts() {
    if ran_alone("memory::run_folder_keeps_positions_of_contacts_in_memory_not_contacts") {
        return;
    }
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("run");
    let layout = ArrayLayout::grid(11, 11, 4.5);
    let origins = Origins::new(String::new(), String::new(), Vec::new());
    let bound = PRESSES as usize * HELD_BYTES_A_PRESS + BUFFERS_BYTES;

    let before = HEAP.allocated();
    let mut folder = RunFolder::create(Some(&path), &origins, facts(), Provenance::default(), &layout).unwrap();
    // every second one first, as a plan may order them
    for press in (0..PRESSES).step_by(2).chain((1..PRESSES).step_by(2)) {
        folder.record(&Record::Contact(contact(press))).unwrap();
    }
    let held = HEAP.allocated() - before;
    assert!(held < bound, "{held} bytes are held for {PRESSES} presses");
    drop(folder);

    let mut folder = RunFolder::open(&path, &layout).unwrap();
    let held = HEAP.allocated() - before;
    assert!(held < bound, "{held} bytes are held when {PRESSES} presses are opened");
    let (status, ended) = (Status::Complete, String::new());
    folder
        .finish(SessionEnd {
            status,
            t_s: 0.0,
            ended,
            wall_s: 0.0,
            failure: None,
            cell_unchecked: false,
            cell_off: None,
            glitches: Glitches::default(),
            series: None,
        })
        .unwrap();
    let most = HEAP.max_allocated() - before;
    assert!(most < bound + TURNED_BYTES, "{most} bytes were held at most while {PRESSES} presses were read");

    assert_eq!(folder.manifest().presses_done, PRESSES);
    assert_eq!(folder.manifest().rows_flagged, 0);
    assert!((0..PRESSES).all(|press| folder.has(press)) && !folder.has(PRESSES));
    assert!(folder.contacts().unwrap().map(Result::unwrap).eq((0..PRESSES).map(contact)), "in order, as recorded");
    let matrix = std::fs::read_to_string(path.join("calibration_matrix.csv")).unwrap();
    let points: Vec<usize> = matrix.lines().map(|line| line.split(',').count()).collect();
    assert_eq!(points, [PRESSES as usize; UNITS]);
    assert!(matrix.starts_with("0,0.001,0.002,"), "in the order of the numbers");
}

/// Number of readings. One in a hundred is invalid or lacks an output.
const READINGS: usize = 200_000;

/// Memory for buffers of answers, for any number of readings.
const ANSWERS_BYTES: usize = 16 << 10;

#[test]
fn readings_are_solved_without_being_kept() {
    if ran_alone("memory::readings_are_solved_without_being_kept") {
        return;
    }
    let calibration = calibration();
    for (readings, format) in [(CSV_READINGS, ReadingFormat::Csv), (JSON_READINGS, ReadingFormat::Ndjson)] {
        let session = Session::new(Model::fit("pearson", calibration.clone(), &Setting::default()).unwrap());
        let mut answers = Answers::new(Readings::new("stdin", 3, Some(format), Mapping::default()), session);
        let mut lines =
            StreamLines::new("stdin", MemoryRepeated { block: block(readings), at: 0, left: READINGS / 1000 });
        let (mut answered, mut unsolved, mut before) = (0, 0, 0);
        while let Some(line) = lines.read_next().unwrap() {
            let answer = answers.answer(line).unwrap().expect("no line is blank");
            unsolved += usize::from(answer.solved.is_err());
            drop(answer);
            answered += 1;
            if answered == 1000 {
                before = HEAP.allocated();
            }
            let held = HEAP.allocated().saturating_sub(before);
            assert!(answered <= 1000 || held < ANSWERS_BYTES, "{held} bytes are held after {answered} readings");
        }
        assert_eq!((answered, unsolved), (READINGS, READINGS * 8 / 1000), "{format:?}");
    }
}

/// A good reading, and ten others: eight without an answer, two with a missing channel.
const CSV_READINGS: [&str; 11] = [
    "1,0.3,0.1",
    "1,x,1",
    "1,0.3",
    "1,\"0.3,0.1",
    "[1,0.3,0.1]",
    ",,",
    "nan,nan,nan",
    "inf,0.3,0.1",
    "\u{fffd}",
    "nan,0.4,0.2",
    "1,,0.2",
];
const JSON_READINGS: [&str; 11] = [
    "{\"id\":7,\"outputs\":[1,0.3,0.1]}",
    "[1,\"x\",1]",
    "[1,0.3]",
    "[1,0.3,",
    "1,0.3,0.1",
    "[NaN,NaN,NaN]",
    "{\"outputs\":{}}",
    "{}",
    "[[1,0.3,0.1]]",
    "[NaN,0.4,0.2]",
    "[1,null,0.2]",
];

/// 1000 lines with each of the invalid ones once.
fn block(readings: [&str; 11]) -> Vec<u8> {
    let nth = |line: usize| if line % 100 == 99 { 1 + line / 100 } else { 0 };
    (0..1000).flat_map(|line| format!("{}\n", readings[nth(line)]).into_bytes()).collect()
}

/// A block, repeated so many times.
struct MemoryRepeated {
    block: Vec<u8>,
    at: usize,
    left: usize,
}

impl Read for MemoryRepeated {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.left == 0 {
            return Ok(0);
        }
        let count = (&self.block[self.at..]).read(buffer)?;
        self.at += count;
        if self.at == self.block.len() {
            (self.at, self.left) = (0, self.left - 1);
        }
        Ok(count)
    }
}

/// Three units whose output falls with the distance, at nine places.
fn calibration() -> Calibration {
    let units = [Place::new(-2.0, 0.0), Place::new(2.0, 1.0), Place::new(0.0, -2.0)];
    let at = |index: i32| Place::new(f64::from(index % 3) - 1.0, f64::from(index / 3) - 1.0);
    let row = |place: Place| units.map(|unit| 1.0 / (1.0 + place.distance_mm(unit)));
    let rows: Vec<(Place, [f64; 3])> = (0..9).map(at).map(|place| (place, row(place))).collect();
    let points: Vec<CalibrationPoint<'_>> =
        rows.iter().map(|(place, outputs)| CalibrationPoint { place: *place, force_n: 1.0, outputs }).collect();
    Calibration::new(&points).unwrap()
}

fn contact(press: u64) -> RecordedContact {
    let row = Press {
        press,
        level: 0,
        phase: Some(Phase::Calibration),
        x_mm: 1.0,
        y_mm: -1.0,
        force_set_n: Some(1.0),
        force_n: Some(1.0),
        depth_mm: Some(0.5),
        t_s: Some(3.0 * press as f64),
        outputs: vec![press as f64 * 1e-3; UNITS],
        flags: Vec::new(),
        z_mm: Some(-0.5),
        ..Press::default()
    };
    let truth = PressTruth { force_true_n: 1.0, force_peak_n: 1.0, depth_peak_mm: 0.5 };
    let learned_contact =
        Some(LearnedContact::Touch { place: Place::new(1.0, -1.0), z_mm: 0.0, path: vec![(0.1, 0.1)] });
    let no_load = |n: f64| {
        let force = NoLoadReadings {
            mean_n: 1e-4 * n,
            sigma_n: 0.003,
            readings: 150,
            age_s: 0.07,
            ..NoLoadReadings::default()
        };
        NoLoad { force, outputs: vec![1e-5 * n; UNITS] }
    };
    let (no_load_before, no_load_after) = (no_load(press as f64), no_load(press as f64 + 1.0));
    RecordedContact {
        press,
        levels: vec![row.rounded()],
        truth: vec![truth],
        budgets: Vec::new(),
        learned_contact,
        no_load_before,
        no_load_after,
        left: None,
        ..RecordedContact::default()
    }
}

fn facts() -> RunFacts {
    RunFacts { recipe: "memory".to_owned(), presses_planned: PRESSES, ..RunFacts::default() }
}
