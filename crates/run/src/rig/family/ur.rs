//! Universal Robots: an arm as a stage.

use super::{Beside, DeviceFamily, Links, Role, as_a, unfit};
use crate::rig::emulated::EmulatedDevice;
use crate::rig::spec::{Dial, Driver, LastResort, LoadCellDriver, Misfit, RigSpec, RigWiring, StageDriver};
use palpate_core::quantity::{Axis, StageAbilities};
use palpate_document::{Bounds, Problem, Table, keys, with_nearest};
use palpate_drivers::ur::{RobotLinks, RobotSettings, TaughtFrame, Ur, UrForce};
use palpate_drivers::{AnyLoadCell, AnyStage};
use palpate_link::device::DeviceError;
use palpate_sim::emulator::{UrArm, UrEmulator};
use palpate_sim::scene::{Scene, SceneDevice};
use std::f64::consts::PI;
use std::sync::Arc;

pub(super) const FAMILY: DeviceFamily = DeviceFamily {
    name: "ur",
    meaning: "Universal Robots' arms: RTDE, programs, dashboard",
    simulated: "a UR5e with PolyScope 5",
    stage: Some(Role { words: &[], keys: stage::KEYS.always, links: Links::Stream, read: read_stage }),
    load_cell: Some(Role { words: &[], keys: load_cell::KEYS.always, links: Links::Stream, read: read_load_cell }),
    array: None,
};

/// Ports of a controller for programs and for its dashboard.
const PROGRAM_PORT: u16 = 30002;
const DASHBOARD_PORT: u16 = 29999;

/// Largest coordinate of a taught point, mm.
const BASE: Bounds = Bounds::within(-2500.0, 2500.0, "mm");
const ROTATION: Bounds = Bounds::within(-2.0 * PI, 2.0 * PI, "rad");
const PATH_ERROR: Bounds = Bounds::within(0.02, 2.0, "mm");

/// Default of `path_error_mm`: several times the repeatability of a UR5e (0.03 mm), for motions at speed.
const PATH_ERROR_MM: f64 = 0.2;

/// How late a program begins, s.
const LATE_S: f64 = 0.1;

/// Largest angle between the tool and the direction in which it presses, degrees.
const LEAN_MOST_DEG: f64 = 30.0;

/// Longest tool that the reach considers, mm.
const TOOL_MM: f64 = 200.0;

keys! {
    /// `driver = { ur = ... }` of a stage.
    stage {
        ur: Text, Refused, "the robot's model", "\"UR5e\"";
        points_mm: Matrix(BASE), Refused,
            "three positions of the tip in the robot's base: the zero of the axes, one in the direction of x, one on the side of y",
            "[[300.0, -200.0, 100.0], [400.0, -200.0, 100.0], [300.0, -100.0, 100.0]]";
        tool_rad: Numbers(ROTATION), Refused, "orientation of the tool in the base while it presses, as a rotation vector",
            "[0.0, 3.1416, 0.0]";
        path_error_mm: Number(PATH_ERROR), or(PATH_ERROR_MM), "largest distance of the tip from its straight way", "0.2";
        program_port: Whole(1, 65535), or_whole(PROGRAM_PORT as u64), "port that takes programs", "30002";
        dashboard_port: Whole(1, 65535), or_whole(DASHBOARD_PORT as u64), "port of the dashboard", "29999";
    }
}

keys! {
    /// `driver = { ur = ... }` of a load cell.
    load_cell {
        ur: Word(&["own force"]), Refused, "the robot's own force; the force limit must be ten times its error", "\"own force\"";
    }
}

/// Least force limit for the robot's own force as the load cell, as a multiple of its error.
const ERRORS_LEAST: f64 = 10.0;

/// A model: its name, its reach, mm, and the error of its own force, N. Both are from its data sheet; a robot without a force sensor
/// estimates the force.
const MODELS: [(&str, f64, f64); 11] = [
    ("UR3", 500.0, 10.0),
    ("UR5", 850.0, 10.0),
    ("UR10", 1300.0, 10.0),
    ("UR3e", 500.0, 3.5),
    ("UR5e", 850.0, 4.0),
    ("UR7e", 850.0, 4.0),
    ("UR10e", 1300.0, 5.5),
    ("UR12e", 1300.0, 5.5),
    ("UR16e", 900.0, 5.5),
    ("UR20", 1750.0, 10.0),
    ("UR30", 1300.0, 10.0),
];

#[derive(Debug)]
struct UrStageSpec {
    model: &'static str,
    reach_mm: f64,
    force_error_n: f64,
    frame: TaughtFrame,
    path_error_mm: f64,
    program_port: u16,
    dashboard_port: u16,
}

fn read_stage(table: &Table, _: Beside) -> Option<Arc<dyn StageDriver>> {
    let model = table.text(&stage::ur).and_then(|name| {
        let found = MODELS.into_iter().find(|(model, ..)| model.eq_ignore_ascii_case(name));
        if found.is_none() {
            let names = MODELS.map(|(name, ..)| name);
            let problem = Problem::new(table.span_of(&stage::ur), format!("there is no model \"{name}\""));
            table.complain(with_nearest(problem.help(format!("models: {}", names.join(", "))), name, &names));
        }
        found
    });
    let frame = table.matrix(&stage::points_mm).zip(read_tool(table)).and_then(|(points_mm, tool_rad)| {
        let frame = TaughtFrame::new(points_mm, tool_rad);
        frame.map_err(|text| table.complain(Problem::new(table.span_of(&stage::points_mm), text))).ok()
    });
    let path_error_mm = table.number(&stage::path_error_mm);
    let ports = [&stage::program_port, &stage::dashboard_port].map(|key| u16::try_from(table.whole(key)?).ok());
    let ((model, reach_mm, force_error_n), [program_port, dashboard_port]) = (model?, ports);
    Some(Arc::new(UrStageSpec {
        model,
        reach_mm,
        force_error_n,
        frame: frame?,
        path_error_mm: path_error_mm?,
        program_port: program_port?,
        dashboard_port: dashboard_port?,
    }))
}

fn read_tool(table: &Table) -> Option<[f64; 3]> {
    let numbers = table.number_or_list(&stage::tool_rad)?;
    let tool_rad = <[f64; 3]>::try_from(numbers);
    tool_rad
        .map_err(|_| {
            table.complain(Problem::new(table.span_of(&stage::tool_rad), "`tool_rad` is a list of three numbers"))
        })
        .ok()
}

impl Driver for UrStageSpec {
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        let misfit = |text: String, help| Misfit { role: SceneDevice::Stage, text, help: Some(help) };
        let mut misfits = Vec::new();
        let ends = rig.stage.travel.axes.map(|range| [range.min, range.max]);
        let farthest_mm = (0..8)
            .map(|corner| self.frame.to_base(std::array::from_fn(|axis| ends[axis][corner >> axis & 1])))
            .map(|at_mm| at_mm.iter().map(|mm| mm * mm).sum::<f64>().sqrt())
            .fold(0.0, f64::max);
        if farthest_mm > self.reach_mm + TOOL_MM {
            misfits.push(misfit(
                format!(
                    "a corner of the travel is {farthest_mm:.0} mm from the robot's base, and a {} reaches {} mm",
                    self.model, self.reach_mm
                ),
                "narrow `travel_mm`, or teach a frame nearer to the base",
            ));
        }
        let lean_deg = self.frame.lean_deg(rig.frame.down.sign());
        if lean_deg > LEAN_MOST_DEG {
            misfits.push(misfit(
                format!("`tool_rad` points the tool {lean_deg:.0} degrees off `frame.down`, at most {LEAN_MOST_DEG} are allowed"),
                "copy RX, RY and RZ while the tool points at the specimen, and the points in the order zero, x, y",
            ));
        }
        misfits
    }
}

#[derive(Debug)]
struct UrLoadCellSpec;

fn read_load_cell(table: &Table, _: Beside) -> Option<Arc<dyn LoadCellDriver>> {
    table.word(&load_cell::ur, &[("own force", ())])?;
    Some(Arc::new(UrLoadCellSpec))
}

impl Driver for UrLoadCellSpec {
    fn misfits(&self, rig: &RigSpec) -> Vec<Misfit> {
        let misfit = |text: String, help| vec![Misfit { role: SceneDevice::LoadCell, text, help: Some(help) }];
        let Some(arm) = as_a::<UrStageSpec>(&*rig.stage.driver).filter(|_| rig.stage.link == rig.load_cell.link) else {
            let help = "write the stage's `driver = { ur = ... }` and the same `link`";
            return misfit("the robot's own force is of another robot than the stage".to_owned(), help);
        };
        let least_n = ERRORS_LEAST * arm.force_error_n;
        if rig.limits.force_n >= least_n {
            return Vec::new();
        }
        let (error_n, limit_n) = (arm.force_error_n, rig.limits.force_n);
        misfit(
            format!(
                "a {}'s own force has an error of {error_n} N: it measures nothing under a limit of {least_n} N, and the limit is {limit_n} N",
                arm.model
            ),
            "mount a load cell; the robot's own force only guards",
        )
    }
}

impl LoadCellDriver for UrLoadCellSpec {
    fn open(&self, dial: Dial, wiring: &RigWiring) -> Result<AnyLoadCell, DeviceError> {
        let rig = wiring.rig;
        let arm = as_a::<UrStageSpec>(&*rig.stage.driver).ok_or_else(|| unfit("load cell", "ur"))?;
        let away = -rig.frame.down.sign();
        let link = rig.load_cell.link.to_string();
        Ok(AnyLoadCell::Ur(UrForce::new(dial.link(), arm.frame.clone(), away, link, wiring.origin)))
    }

    fn emulated(&self, _: &RigSpec, stage: &EmulatedDevice) -> Result<EmulatedDevice, DeviceError> {
        Ok(stage.clone())
    }
}

impl StageDriver for UrStageSpec {
    fn open(&self, dial: Dial, rig: &RigSpec) -> AnyStage {
        let (programs, dashboard) = (dial.port(self.program_port), dial.port(self.dashboard_port));
        let settings = RobotSettings {
            frame: self.frame.clone(),
            path_error_mm: self.path_error_mm,
            guard_n: rig.limits.force_n + 2.0 * self.force_error_n,
            model: self.model.to_owned(),
        };
        let links = RobotLinks { rtde: dial.link(), programs, dashboard };
        AnyStage::Ur(Box::new(Ur::new(links, settings, rig.stage.link.to_string())))
    }

    fn emulated(&self, scene: &Scene, rig: &RigSpec) -> EmulatedDevice {
        let arm = UrArm {
            origin_mm: self.frame.origin_mm(),
            axes: self.frame.axes(),
            rotvec_rad: self.frame.tool_rad(),
            reach_m: self.reach_mm / 1000.0,
            model: self.model.to_owned(),
            force_error_n: self.force_error_n,
            step_mm: rig.stage.steps.along(Axis::Z),
            ..UrArm::default()
        };
        EmulatedDevice::network(UrEmulator::new(arm, scene), "rtde")
            .at_ports(&[(PROGRAM_PORT, "urscript"), (DASHBOARD_PORT, "dashboard")])
    }

    fn simulated_misfit(&self, _: &RigSpec) -> Option<String> {
        None // its emulator has the reach of the model
    }

    /// It can be stopped, but too late for a motion that needs it. A straight motion has one speed.
    fn abilities(&self) -> StageAbilities {
        StageAbilities { late_s: LATE_S, ..StageAbilities::FINISHES }
    }

    fn bends(&self) -> bool {
        true
    }

    fn last_resort(&self) -> LastResort {
        LastResort::KeepsPower("the dashboard's stop")
    }
}
