//! Newport ESP301 and ESP300: three axes on a serial line, or behind a serial server.

use super::{Family, Links, Role};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, RigSpec, StageDriver};
use palpate_drivers::{AnyStage, Esp301};
use palpate_sim::emulator;
use palpate_sim::scene::Scene;
use std::sync::Arc;

pub(super) const FAMILY: Family = Family {
    name: "esp301",
    meaning: "Newport ESP301 or ESP300 motion controller",
    simulated: "three VP-25XL axes that home automatically",
    stage: Some(Role {
        words: &["esp301", "esp300"],
        keys: &[],
        links: Links::Stream,
        read: |_, _| Some(Arc::new(Stage)),
    }),
    load_cell: None,
    array: None,
};

#[derive(Debug)]
struct Stage;

impl Driver for Stage {}

impl StageDriver for Stage {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        AnyStage::Esp301(Esp301::new(dial(), rig.stage.link.to_string()))
    }

    fn emulated(&self, scene: &Scene, _: &RigSpec) -> EmulatedDevice {
        EmulatedDevice::serial(emulator::Esp301::new(scene), "esp301")
    }
}
