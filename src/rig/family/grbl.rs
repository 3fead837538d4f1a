//! GRBL 1.1: a CNC frame or a converted printer as a stage.

use super::{Family, Links, Role};
use crate::driver::AnyStage;
use crate::driver::grbl::Grbl;
use crate::emulator;
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, RigSpec, StageDriver};
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

    fn emulated(&self, scene: &Scene, _: &RigSpec) -> EmulatedDevice {
        EmulatedDevice::serial(emulator::Grbl::new(scene), "grbl")
    }
}
