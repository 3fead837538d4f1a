//! Newport ESP301 and ESP300: three axes on a serial line, or behind a serial server.

use super::{DeviceFamily, Links, Role};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, LastResort, RigSpec, StageDriver};
use palpate_drivers::{AnyStage, Esp301};
use palpate_sim::emulator;
use palpate_sim::scene::Scene;
use std::sync::Arc;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "esp301",
    meaning: "Newport ESP301 or ESP300 motion controller",
    simulated: "three VP-25XL axes that home automatically",
    stage: Some(Role {
        words: &["esp301", "esp300"],
        keys: &[],
        links: Links::Stream,
        read: |_, _| Some(Arc::new(Esp301StageSpec)),
    }),
    load_cell: None,
    array: None,
};

#[derive(Debug)]
struct Esp301StageSpec;

impl Driver for Esp301StageSpec {}

impl StageDriver for Esp301StageSpec {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        AnyStage::Esp301(Esp301::new(dial.link(), rig.stage.link.to_string()))
    }

    fn emulated(&self, scene: &Scene, _: &RigSpec) -> EmulatedDevice {
        EmulatedDevice::serial(emulator::Esp301Emulator::new(scene), "esp301")
    }

    fn last_resort(&self) -> LastResort {
        LastResort::CutsPower("AB")
    }
}
