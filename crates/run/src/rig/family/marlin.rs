//! Marlin 2: a 3D printer as a stage.

use super::printer::misfits;
use super::{DeviceFamily, Links, Role};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, LastResort, Misfit, RigSpec, StageDriver};
use palpate_core::quantity::{Axis, StageAbilities};
use palpate_drivers::AnyStage;
use palpate_drivers::marlin::{LEAST_STEPS, Marlin};
use palpate_sim::emulator::{GRBL_ROOM_MM, MarlinBoard, MarlinEmulator as Emulator};
use palpate_sim::scene::Scene;
use std::sync::Arc;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "marlin",
    meaning: "Marlin 2 on a 3D printer",
    simulated: "a stock Marlin 2.1, which doesn't make motions of fewer than 6 steps",
    stage: Some(Role {
        words: &["marlin"],
        keys: &[],
        links: Links::Stream,
        read: |_, _| Some(Arc::new(MarlinStageSpec)),
    }),
    load_cell: None,
    array: None,
};

#[derive(Debug)]
struct MarlinStageSpec;

impl Driver for MarlinStageSpec {
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        misfits(rig)
    }
}

impl StageDriver for MarlinStageSpec {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        AnyStage::Marlin(Marlin::new(dial.link(), rig.stage.link.to_string()))
    }

    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice {
        EmulatedDevice::serial(Emulator::new(board(rig), scene), "marlin")
    }

    fn homes_by_hand(&self) -> bool {
        true
    }

    fn abilities(&self) -> StageAbilities {
        StageAbilities { least_steps: LEAST_STEPS, ..StageAbilities::FINISHES }
    }

    fn last_resort(&self) -> LastResort {
        LastResort::KeepsPower("M410")
    }
}

/// Returns a board whose frame is large enough for the rig's travel, fast enough for its speed, and has its steps.
fn board(rig: &RigSpec) -> MarlinBoard {
    let stock = MarlinBoard::default();
    let (travel, steps) = (rig.stage.travel, rig.stage.steps);
    let step = |axis: Axis| Some(steps.along(axis)).filter(|mm| *mm > 0.0);
    MarlinBoard {
        steps_per_mm: Axis::ALL.map(|axis| step(axis).map_or(stock.steps_per_mm[axis.index()], |mm| 1.0 / mm)),
        most_mm_s: stock.most_mm_s.map(|mm_s| mm_s.max(rig.stage.speed_mm_s)),
        acceleration_mm_s2: stock.acceleration_mm_s2.map(|mm_s2| mm_s2.max(rig.stage.acceleration_mm_s2)),
        min_ends_mm: travel.axes.map(|travel| travel.min - GRBL_ROOM_MM),
        lengths_mm: travel.axes.map(|travel| travel.max - travel.min + 2.0 * GRBL_ROOM_MM),
        ..stock
    }
}
