//! Klipper: a 3D printer as a stage, by Moonraker.

use super::printer::misfits;
use super::{DeviceFamily, Links, Role};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, LastResort, Misfit, RigSpec, StageDriver};
use palpate_core::quantity::{Axis, StageAbilities};
use palpate_drivers::AnyStage;
use palpate_drivers::klipper::Klipper;
use palpate_sim::emulator::{GRBL_ROOM_MM, KlipperBoard, KlipperEmulator};
use palpate_sim::scene::Scene;
use std::sync::Arc;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "klipper",
    meaning: "Klipper on a 3D printer, by Moonraker",
    simulated: "Klipper 0.12 behind Moonraker",
    stage: Some(Role {
        words: &["klipper"],
        keys: &[],
        links: Links::Stream,
        read: |_, _| Some(Arc::new(KlipperStageSpec)),
    }),
    load_cell: None,
    array: None,
};

/// How late a motion begins and is reported, s: 0.25 s by `BUFFER_TIME_START` of Klipper's toolhead, 0.1 s by `M400`.
const LATE_S: f64 = 0.35;

#[derive(Debug)]
struct KlipperStageSpec;

impl Driver for KlipperStageSpec {
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        misfits(rig)
    }
}

impl StageDriver for KlipperStageSpec {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        AnyStage::Klipper(Box::new(Klipper::new(dial.link(), rig.stage.link.to_string())))
    }

    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice {
        EmulatedDevice::network(KlipperEmulator::new(board(rig), scene), "moonraker")
    }

    fn homes_by_hand(&self) -> bool {
        true
    }

    fn abilities(&self) -> StageAbilities {
        StageAbilities { late_s: LATE_S, ..StageAbilities::FINISHES }
    }

    fn last_resort(&self) -> LastResort {
        LastResort::CutsPower("emergency_stop")
    }
}

/// Returns a board whose frame is large enough for the rig's travel, fast enough for its speed, and has its steps.
fn board(rig: &RigSpec) -> KlipperBoard {
    let stock = KlipperBoard::default();
    let (travel, steps) = (rig.stage.travel, rig.stage.steps);
    let step = |axis: Axis| Some(steps.along(axis)).filter(|mm| *mm > 0.0);
    KlipperBoard {
        steps_per_mm: Axis::ALL.map(|axis| step(axis).map_or(stock.steps_per_mm[axis.index()], |mm| 1.0 / mm)),
        max_z_velocity_mm_s: stock.max_z_velocity_mm_s.max(rig.stage.speed_mm_s),
        max_z_accel_mm_s2: stock.max_z_accel_mm_s2.max(rig.stage.acceleration_mm_s2),
        min_ends_mm: travel.axes.map(|travel| travel.min - GRBL_ROOM_MM),
        lengths_mm: travel.axes.map(|travel| travel.max - travel.min + 2.0 * GRBL_ROOM_MM),
        ..stock
    }
}
