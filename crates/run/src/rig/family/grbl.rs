//! GRBL 1.1: a CNC frame or a converted printer as a stage.

use super::{DeviceFamily, Links, Role};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, Home, LastResort, RigSpec, StageDriver};
use palpate_core::quantity::{Axis, Range, Travel, round};
use palpate_drivers::AnyStage;
use palpate_drivers::grbl::{AxisCounts, Build, Grbl, GrblFirmware, ReportedSettings};
use palpate_sim::emulator::{GRBL_ROOM_MM, GrblBoard, GrblEmulator as Emulator};
use palpate_sim::scene::Scene;
use std::sync::Arc;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "grbl",
    meaning: "GRBL 1.1 on a CNC frame or a converted printer",
    simulated: "GRBL 1.1h with limit switches, as long as the travel of the rig",
    stage: Some(Role { words: &["grbl"], keys: &[], links: Links::Stream, read: |_, _| Some(Arc::new(GrblStageSpec)) }),
    load_cell: None,
    array: None,
};

#[derive(Debug)]
struct GrblStageSpec;

impl Driver for GrblStageSpec {}

impl StageDriver for GrblStageSpec {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        AnyStage::Grbl(Grbl::new(dial.link(), rig.stage.link.to_string()))
    }

    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice {
        EmulatedDevice::serial(Emulator::new(board(rig), scene), "grbl")
    }

    fn simulated_misfit(&self, rig: &RigSpec) -> Option<String> {
        misfit(rig)
    }

    fn homes_by_hand(&self) -> bool {
        true
    }

    fn last_resort(&self) -> LastResort {
        LastResort::KeepsPower("a feed hold and a reset")
    }
}

/// Returns a board whose frame is large enough for the rig's travel, and fast enough for its speed.
fn board(rig: &RigSpec) -> GrblBoard {
    let Travel { axes } = rig.stage.travel;
    let stock = GrblBoard::default();
    let settings = (0..3).fold(stock.settings.clone(), |settings, axis| {
        let (rate_mm_s, a_mm_s2) = (settings.most_mm_s(axis.into()), settings.acceleration_mm_s2(axis.into()));
        settings
            .with(GrblBoard::RATE + axis, 60.0 * rate_mm_s.max(rig.stage.speed_mm_s))
            .with(GrblBoard::ACCELERATION + axis, a_mm_s2.max(rig.stage.acceleration_mm_s2))
    });
    match rig.stage.home {
        Home::ByHand => GrblBoard {
            settings: settings.with(GrblBoard::SOFT_LIMITS, 0.0).with(GrblBoard::HOMING, 0.0),
            plus_ends_mm: axes.map(|travel| travel.max + GRBL_ROOM_MM),
            lengths_mm: axes.map(|travel| travel.max - travel.min + 2.0 * GRBL_ROOM_MM),
            ..stock
        },
        Home::Switches => {
            let mut lengths_mm: [f64; 3] = std::array::from_fn(|n| stock.lengths_mm[n].max(-axes[n].min));
            let is_z_to_minus = rig.frame.down.sign() > 0.0;
            if is_z_to_minus {
                // it homes at the least count of the travel
                lengths_mm[Axis::Z.index()] = (stock.settings.pull_off_mm() - axes[Axis::Z.index()].min).max(1.0);
            }
            let toward_minus = f64::from(u8::from(is_z_to_minus) << Axis::Z.index());
            let settings = (0..)
                .zip(lengths_mm)
                .fold(settings.with(GrblBoard::HOMING_DIRECTION, toward_minus), |settings, (axis, length_mm)| {
                    settings.with(GrblBoard::TRAVEL + axis, length_mm)
                });
            GrblBoard { settings, lengths_mm, ..stock }
        }
    }
}

/// Returns the reason why the driver would refuse the emulated board, and the travel that it would accept.
fn misfit(rig: &RigSpec) -> Option<String> {
    let (board, usage) = (board(rig), rig.stage_use());
    let number = |line: String| {
        let (number, value) = line.strip_prefix('$')?.split_once('=')?;
        Some((number.parse().ok()?, value.parse().ok()?))
    };
    let settings = ReportedSettings::new(board.settings.lines().filter_map(number).collect(), &[]);
    let build = Build { firmware: GrblFirmware::Grbl, version: "1.1h".to_owned(), sets_origin: board.sets_origin };
    let texts = settings.check(&build, &usage).err()?;
    let counts = Axis::ALL.into_iter().filter_map(|axis| settings.counts(&build, axis).ok());
    let misfits: Vec<AxisCounts> = counts.filter(|counts| counts.misfit(&usage).is_some()).collect();
    if misfits.is_empty() {
        return Some(texts.join("; "));
    }
    let text = misfits.iter().map(|counts| travel_text(counts, rig.stage.travel.along(counts.axis)));
    Some(format!("{}; or write `home = \"by hand\"` in [stage]", text.collect::<Vec<_>>().join("; ")))
}

/// Names the end that the travel of an axis must have in a simulation, and the lines that give it this end. The other end is free,
/// because the emulated frame is as long as the rig's travel.
fn travel_text(counts: &AxisCounts, travel: Range) -> String {
    let (axis, end_mm) = (counts.axis.name(), round(counts.range.max, 3));
    let Range { min, max } = travel;
    let text = format!("`travel_mm.{axis}` is [{min}, {max}], but {axis} of a simulated GRBL ends at {end_mm} mm");
    if max < end_mm {
        return format!("{text}, where it homes: write {axis} = [{min}, {end_mm}]");
    }
    let (way_mm, frame) = (round(end_mm - max, 3), if counts.axis == Axis::Z { "surface" } else { "origin" });
    let min = round(min + way_mm, 3);
    format!("{text}: write {axis} = [{min}, {end_mm}], and move `frame.{frame}_mm.{axis}` by {way_mm} mm")
}
