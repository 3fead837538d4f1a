//! Allocations of a reading, and their bytes, in this process.

use super::expected::{Count, Table, check};
use super::skins::{Sensor, State};
use crate::HEAP;
use crate::counting::Counting;
use palpate_data::dataset::Mapping;
use palpate_data::dataset::answers::Answers;
use palpate_data::dataset::readings::{ReadingFormat, Readings};
use palpate_solver::{Model, Session, Setting};
use palpate_testing::alone::{ALONE, ran_alone_on_one_processor};
use std::env;
use std::hint::black_box;
use std::sync::Arc;

const TEST: &str = "cost::allocations::a_reading_allocates_as_much_as_expected";

/// One more for each reading is a problem, and half of one is not noise either: the counts are exact.
static ALLOCATIONS: Table =
    Table { name: "allocations", of: "allocations a reading", share: 0.0, least: 0.4, decimals: 2 };

/// Few bytes are one small allocation, which is counted above.
static BYTES: Table = Table { name: "bytes", of: "bytes allocated a reading", share: 0.05, least: 8.0, decimals: 0 };

#[test]
fn a_reading_allocates_as_much_as_expected() {
    // a search for broken outputs may use all processors, and each takes memory
    if ran_alone_on_one_processor(TEST) {
        return;
    }
    assert_eq!(each(vec![0_u64; 9], |value| _ = black_box(Box::new(value))), [1.0, 8.0], "one box each");
    let (mut allocations, mut bytes) = (Vec::new(), Vec::new());
    let mut add = |name: String, [count, size]: [f64; 2]| {
        let test = env::current_exe().expect("this test has a path");
        let shown_by = format!("{ALONE}={TEST} valgrind --tool=dhat {} --exact {TEST}", test.display());
        let counted = |found| Ok(Count { name: name.clone(), found, shown_by: shown_by.clone() });
        allocations.push(counted(count));
        bytes.push(counted(size));
    };
    for sensor in Sensor::all() {
        let model = Arc::new(Model::fit("pearson", sensor.calibration(), &Setting::default()).expect("pearson fits"));
        for state in State::ALL {
            // searches are counted as instructions
            let mut session = Session::new(model.clone()).deferring();
            let solve = |outputs: Vec<f64>| _ = session.solve(&outputs);
            add(format!("session-{}-{}", sensor.units, state.name()), each(sensor.readings(state), solve));

            let readings = Readings::new("stdin", sensor.units, Some(ReadingFormat::Ndjson), Mapping::default());
            let mut answers = Answers::new(readings, Session::new(model.clone()).deferring());
            let answer = |line: String| _ = answers.answer(line.as_bytes()).expect("a reading");
            add(format!("answers-{}-{}", sensor.units, state.name()), each(sensor.lines(state), answer));
        }
    }
    check([(&ALLOCATIONS, allocations), (&BYTES, bytes)]);
}

/// Allocations and bytes of each input but the first one, which prepares buffers.
fn each<I>(mut inputs: Vec<I>, mut work: impl FnMut(I)) -> [f64; 2] {
    let rest = inputs.split_off(1);
    inputs.into_iter().for_each(&mut work);
    let (count, before) = (rest.len(), [Counting::count(), HEAP.total_allocated()]);
    rest.into_iter().for_each(work);
    let after = [Counting::count(), HEAP.total_allocated()];
    [0, 1].map(|what| (after[what] - before[what]) as f64 / count as f64)
}
