//! GRBL 1.1: a CNC frame or a converted printer as a stage.

use super::{Family, Links, Role};
use crate::driver::AnyStage;
use crate::driver::grbl::Grbl;
use crate::emulator::{GRBL_ROOM_MM, Grbl as Emulator, GrblBoard};
use crate::quantity::{Axis, Range, Travel};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, Home, RigSpec, StageDriver, StageSpec};
use crate::scene::Scene;
use std::sync::Arc;

pub const FAMILY: Family = Family {
    name: "grbl",
    meaning: "GRBL 1.1 on a CNC frame or a converted printer",
    simulated: "GRBL 1.1h with three axes and limit switches",
    stage: Some(Role { words: &["grbl"], keys: &[], links: Links::Stream, read: |_, _| Some(Arc::new(Stage)) }),
    load_cell: None,
    array: None,
};

#[derive(Debug)]
struct Stage;

impl Driver for Stage {}

impl StageDriver for Stage {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        AnyStage::Grbl(Grbl::new(dial(), rig.stage.link.to_string()))
    }

    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice {
        EmulatedDevice::serial(Emulator::new(board(rig), scene), "grbl")
    }

    fn simulated_z_mm(&self, stage: &StageSpec) -> Range {
        stage.travel.along(Axis::Z)
    }

    fn homes_by_hand(&self) -> bool {
        true
    }
}

/// Returns a board whose frame is large enough for the rig's travel.
fn board(rig: &RigSpec) -> GrblBoard {
    let Travel { axes } = rig.stage.travel;
    let stock = GrblBoard::default();
    match rig.stage.home {
        Home::ByHand => GrblBoard {
            settings: stock.settings.clone().with(GrblBoard::SOFT_LIMITS, 0.0).with(GrblBoard::HOMING, 0.0),
            plus_ends_mm: axes.map(|travel| travel.max + GRBL_ROOM_MM),
            lengths_mm: axes.map(|travel| travel.max - travel.min + 2.0 * GRBL_ROOM_MM),
            ..stock
        },
        Home::Switches => {
            let lengths_mm: [f64; 3] = std::array::from_fn(|n| stock.lengths_mm[n].max(-axes[n].min));
            let toward_minus = f64::from(u8::from(rig.frame.down.sign() > 0.0) << Axis::Z.index());
            let settings = (0..).zip(lengths_mm).fold(
                stock.settings.clone().with(GrblBoard::HOMING_DIRECTION, toward_minus),
                |settings, (axis, length_mm)| settings.with(GrblBoard::TRAVEL + axis, length_mm),
            );
            GrblBoard { settings, lengths_mm, ..stock }
        }
    }
}
