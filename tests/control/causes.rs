//! What ends a run is named by its cause: each ill of a load cell that was reported from the field, with its message.

use palpate_sim::scene::{CorruptSamples, FaultKind, GlitchKind, LoadCellScene, SceneFault};
use palpate_testing::executions::{
    BENCHES, Deaths, ExecutedRun, bench, executed_with, in_parallel, must_be_none, plan,
};
use palpate_testing::wire::{WireFault, put_on_wire};

/// An ill load cell, and what the message that must end the run begins with and says; `None` if the run must be complete.
struct IllCell {
    name: &'static str,
    presses: usize,
    ails: fn(&mut LoadCellScene),
    fault: Option<SceneFault>,
    wire: Option<(WireFault, f64)>,
    /// Largest true force, N.
    most_n: f64,
    says: Option<[&'static str; 2]>,
}

const fn healthy(_: &mut LoadCellScene) {}

/// Largest true force, N: what is set and its tolerance. If the cell shows less than that, only the limit counts.
const MOST_N: f64 = 1.05;
const LIMIT_N: f64 = 2.0;

/// Begins in the air before the second press, before the first touch, and in a contact.
const IN_THE_AIR_S: f64 = 15.0;
const EARLY_S: f64 = 12.0;
const STICKS_S: f64 = 17.0;

/// Begins between two presses, after some that the array has felt.
const BETWEEN_S: f64 = 21.0;

/// A sound cell, whose run is complete.
const SOUND: IllCell =
    IllCell { name: "", presses: 4, ails: healthy, fault: None, wire: None, most_n: MOST_N, says: None };

const ILL: [IllCell; 17] = [
    IllCell {
        name: "0.4 % of the samples are minus one",
        ails: |cell| cell.glitches = Some(CorruptSamples::of(GlitchKind::MinusOne, 0.004)),
        ..SOUND
    },
    IllCell {
        name: "it always reads 0",
        ails: |cell| (cell.gain, cell.noise_n) = (0.0, 0.0),
        says: Some([
            "frozen: ",
            " equal readings while the array shows a contact, limit 20; check that the transmitter still converts",
        ]),
        ..SOUND
    },
    IllCell {
        name: "it reads its noise and no force",
        ails: |cell| cell.gain = 0.0,
        says: Some(["outputs-moved: ", "the array detected a contact but the load cell didn't: check the load cell"]),
        ..SOUND
    },
    IllCell { name: "it drifts by 13 mN/s", ails: |cell| cell.drift_n_s = 0.013, ..SOUND },
    IllCell {
        name: "it drifts by 40 mN/s",
        ails: |cell| cell.drift_n_s = 0.040,
        says: Some([
            "drifts: 0.0399 N/s, limit 0.0267 N/s; it needs a `limits.force_n` of at least 3.00 N, ",
            "let the load cell warm up",
        ]),
        ..SOUND
    },
    IllCell {
        name: "its count rolls over under load",
        fault: Some(SceneFault { kind: FaultKind::RollsOver, from_s: 0.0, value: Some(0.5) }),
        says: Some(["jumped: -0.9", "check the load cell's range, because its count turns around at its end"]),
        ..SOUND
    },
    IllCell {
        name: "its zero falls in the air, with its gain",
        fault: Some(SceneFault { kind: FaultKind::DriftedZero, from_s: IN_THE_AIR_S, value: Some(-0.5) }),
        says: Some(["jumped: -0.4", "because its zero or gain may have changed"]),
        ..SOUND
    },
    IllCell {
        name: "it drifts by 12 mN/s for minutes",
        presses: 160,
        ails: |cell| cell.drift_n_s = 0.012,
        says: Some(["zero-outside: 2.", " limit 2.0000 N; the load cell drifts: by 12.0"]),
        ..SOUND
    },
    IllCell {
        name: "it drifts by 4 mN/s without noise",
        ails: |cell| (cell.drift_n_s, cell.noise_n) = (0.004, 0.0),
        ..SOUND
    },
    IllCell {
        name: "it drifts by 1 mN/s without noise",
        ails: |cell| (cell.drift_n_s, cell.noise_n) = (0.001, 0.0),
        ..SOUND
    },
    IllCell {
        name: "it drifts by -1 mN/s without noise",
        ails: |cell| (cell.drift_n_s, cell.noise_n) = (-0.001, 0.0),
        ..SOUND
    },
    IllCell {
        name: "it reads 0.5 N at most",
        most_n: LIMIT_N,
        fault: Some(SceneFault { kind: FaultKind::Saturated, from_s: 0.0, value: Some(0.5) }),
        says: Some(["saturated: 0.49", "the load cell can't read more than this: check that its range is larger"]),
        ..SOUND
    },
    IllCell {
        name: "it sticks in a contact",
        fault: Some(SceneFault { kind: FaultKind::Stuck, from_s: STICKS_S, value: None }),
        says: Some(["frozen: ", "check that the transmitter still converts"]),
        ..SOUND
    },
    IllCell {
        name: "its noise grows in the air",
        fault: Some(SceneFault { kind: FaultKind::Noisy, from_s: IN_THE_AIR_S, value: Some(10.0) }),
        says: Some(["noisy: 0.0", "check the cell for vibration"]),
        ..SOUND
    },
    IllCell {
        name: "its noise grows before the first touch",
        fault: Some(SceneFault { kind: FaultKind::Noisy, from_s: EARLY_S, value: Some(10.0) }),
        says: Some(["noisy: 0.0", "check the cell for vibration"]),
        ..SOUND
    },
    IllCell {
        name: "it reads a tenth of the force",
        most_n: LIMIT_N,
        ails: |cell| cell.gain = 0.1,
        says: Some([
            "out-of-reach: 0.1",
            " N; the array feels the contact, so either the load cell reads too little or the specimen is softer",
        ]),
        ..SOUND
    },
    IllCell {
        name: "its gain falls by 90 % between two presses",
        most_n: LIMIT_N,
        presses: 12,
        wire: Some((WireFault::CellGain(0.1), BETWEEN_S)),
        says: Some(["softer-than-taught: 0.1", " N/mm; check whether the load cell reads less than before"]),
        ..SOUND
    },
];

impl IllCell {
    fn executed(&self) -> ExecutedRun {
        let mut spec = bench(BENCHES[0].0);
        (self.ails)(spec.scene.load_cell.get_or_insert_default());
        spec.scene.faults.extend(self.fault);
        let recipe = format!(
            "name = \"ill\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 0.0\nsample_s = 0.1\n[[step]]\nphase = \"calibration\"\n\
                      random = {{ count = {}, x_mm = [-3.0, 3.0], y_mm = [-3.0, 3.0], force_n = [0.6, 1.0] }}\n",
            self.presses
        );
        executed_with(&spec, &plan(&spec, &recipe, 1), Deaths::Ignored, &|rig| {
            if let Some((fault, from_s)) = self.wire {
                put_on_wire(rig, fault, from_s, 1);
            }
        })
    }
}

#[test]
fn the_message_names_the_cause() {
    let ends = in_parallel(&ILL, |ill| {
        let run = ill.executed();
        (run.ending.text(), run.truth.force_n, run.virtual_s)
    });
    let mut wrong = Vec::new();
    for (ill, (text, force_n, at_s)) in ILL.iter().zip(&ends) {
        println!("{}: {force_n:.3} N, {at_s:.1} s: {}", ill.name, text.as_deref().unwrap_or("complete"));
        let is_right = match (ill.says, text) {
            (None, None) => true,
            (Some([begins, says]), Some(text)) => text.starts_with(begins) && text.contains(says),
            _ => false,
        };
        if !is_right || *force_n > ill.most_n || text.as_ref().is_some_and(|text| text.contains("could not be parked"))
        {
            wrong.push(format!("{}: {text:?}", ill.name));
        }
    }
    must_be_none(&wrong);
}
