//! Long runs, recorded without a rig.

use palpate_control::{LearnedContact, NoLoadReadings};
use palpate_core::quantity::{ArrayLayout, Place};
use palpate_data::dataset::{
    Durability, Ledger as _, NoLoad, Origins, Press, PressTruth, Provenance, Record, RecordedContact, RunFacts,
    RunFolder, Status,
};
use palpate_data::recipe::Phase;
use std::path::Path;

pub(crate) const OUTPUTS: usize = 9;

/// A press with as many digits as a measured one.
pub(crate) fn press(number: u64) -> Press {
    let wave = |n: u64| ((number * 7919 + n * 104_729) % 1_000_003) as f64 / 1e6 + 0.123_456_7;
    Press {
        press: number,
        phase: Some(Phase::Calibration),
        x_mm: -6.0 + 0.5 * (number % 25) as f64,
        y_mm: -6.0 + 0.5 * (number / 25 % 25) as f64,
        force_set_n: Some(1.0),
        force_n: Some(0.9 + 0.1 * wave(1)),
        u_force_n: Some(0.001 * wave(2)),
        depth_mm: Some(wave(3)),
        t_s: Some(3.0 * number as f64),
        outputs: (0..OUTPUTS as u64).map(|n| wave(10 + n)).collect(),
        z_mm: Some(-wave(4)),
        air_before_n: Some(0.01 * wave(5)),
        air_after_n: Some(0.01 * wave(6)),
        ..Press::default()
    }
    .rounded()
}

/// Makes an unfinished run folder of so many presses.
pub(crate) fn recorded(run: &Path, presses: u64) {
    let layout = ArrayLayout::grid(3, 3, 4.5);
    let facts = RunFacts { recipe: "many".to_owned(), presses_planned: presses, ..RunFacts::default() };
    let session = Provenance { durability: Durability::Fast, ..Provenance::default() };
    let rig = include_str!("../../rigs/sim.toml").to_owned();
    let origins = Origins::new(String::new(), rig, Vec::new());
    let mut folder = RunFolder::create(Some(run), &origins, facts, session, &layout).unwrap();
    for number in 0..presses {
        let wave = |n: u64| ((number * 7919 + n * 104_729) % 1_000_003) as f64 / 3e6;
        let no_load = |n: u64| {
            let force = NoLoadReadings {
                mean_n: wave(n),
                sigma_n: 0.002_917_3,
                readings: 83,
                age_s: 0.0415,
                ..NoLoadReadings::default()
            };
            NoLoad { force, outputs: (0..OUTPUTS as u64).map(|output| wave(n + output)).collect() }
        };
        let path = (0..6).map(|n| (wave(n), wave(n + 1))).collect();
        let truth = PressTruth { force_true_n: wave(4), force_peak_n: wave(5), depth_peak_mm: wave(6) };
        let contact = RecordedContact {
            press: number,
            levels: vec![press(number)],
            truth: vec![truth.rounded()],
            learned_contact: Some(LearnedContact::Touch { place: Place::new(-5.5, 6.0), z_mm: wave(7), path }),
            no_load_before: no_load(8),
            no_load_after: no_load(9),
            ..RecordedContact::default()
        };
        folder.record(&Record::Contact(contact)).unwrap();
    }
    assert_eq!(folder.manifest().status, Status::Stopped);
}
