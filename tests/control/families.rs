//! The families of stages, each with an emulator to which a fault can be given.

use palpate_data::recipe::Plan;
use palpate_run::rig::{self, RigSpec, SimulatedRig};
use palpate_sim::emulator::{
    DeviceFault, Esp301Emulator, EspFaultKind, FaultAfterBytes, GRBL_ROOM_MM, GrblBoard, GrblEmulator, GrblFaultKind,
    Instrument, KlipperBoard, KlipperEmulator, KlipperFaultKind, MarlinBoard, MarlinEmulator, MarlinFaultKind,
    ProcessStageEmulator, ProcessStageFaultKind, Shared, UrArm, UrEmulator, UrFaultKind, XpsEmulator, XpsFaultKind,
};
use palpate_sim::scene::{ContactLaw, Scene};
use palpate_testing::executions::plan;
use palpate_testing::shipped_text;
use std::f64::consts::PI;
use std::sync::{Arc, Mutex};

/// Limit of the specimen, its stiffness and what is declared of it.
pub(crate) const LIMIT_N: f64 = 2.0;
const STIFFNESS_N_MM: f64 = 1.8;
pub(crate) const DECLARED_N_MM: f64 = 2.0;

/// Least force that counts as left on the specimen, N.
pub(crate) const LEFT_N: f64 = 0.05;

/// When a fault happens.
#[derive(Clone, Copy, Debug)]
pub(crate) enum When {
    At(f64),
    AfterBytes(u64),
}

/// Returns a stage with a fault, or without one.
type Install<K> = fn(&RigSpec, &Scene, Option<(When, K)>) -> Shared<dyn Instrument>;

/// A family of stages, and how a fault is given to one.
pub(crate) struct Family<K: 'static> {
    /// Its shipped rig.
    pub(crate) rig: &'static str,
    stage: Install<K>,
    /// Whether its rig states that z holds without power.
    pub(crate) z_holds: bool,
    /// How long it takes to begin what another host sends, s.
    pub(crate) begins_s: f64,
}

impl<K> Family<K> {
    /// Returns its rig, simulated.
    pub(crate) fn spec(&self) -> RigSpec {
        shipped_rig(self.rig)
    }

    /// Returns its rig with a specimen without relaxation.
    pub(crate) fn over_specimen(&self) -> RigSpec {
        let mut spec = self.spec();
        (spec.limits.force_n, spec.limits.stiffness_n_mm) = (LIMIT_N, DECLARED_N_MM);
        spec.scene.contact = ContactLaw { linear_n_mm: STIFFNESS_N_MM, quadratic_n_mm2: 0.0, toe_mm: 0.0 };
        spec.scene.relaxation.clear();
        spec.stage.z_holds_unpowered = self.z_holds;
        spec
    }

    /// One press of 1 N that is held for 3 s.
    pub(crate) fn press(&self, spec: &RigSpec) -> Plan {
        let text = "name = \"forgetting\"\nchecks = \"none\"\n[press]\nforce_tolerance_n = 0.05\nhold_s = 3.0\nsample_s = 0.2\n[[step]]\n\
             phase = \"calibration\"\nrandom = { count = 1, x_mm = [-1.0, 1.0], y_mm = [-1.0, 1.0] }\nforce_n = 1.0\n";
        plan(spec, text, 1)
    }

    /// Gives a rig a stage with a fault, or without one.
    pub(crate) fn install(&self, spec: &RigSpec, rig: &mut SimulatedRig, fault: Option<(When, K)>) {
        let stage = (self.stage)(spec, &rig.scene.lock().expect("nobody else has it"), fault);
        rig.stage.replace(stage);
    }
}

pub(crate) const MARLIN: Family<MarlinFaultKind> =
    Family { rig: "rigs/marlin.toml", stage: marlin, z_holds: false, begins_s: 0.0 };
pub(crate) const GRBL: Family<GrblFaultKind> =
    Family { rig: "rigs/matrix.toml", stage: grbl, z_holds: false, begins_s: 0.0 };
pub(crate) const KLIPPER_THAT_HOLDS: Family<KlipperFaultKind> =
    Family { rig: "rigs/klipper.toml", stage: klipper, z_holds: true, begins_s: 0.0 };
pub(crate) const KLIPPER: Family<KlipperFaultKind> =
    Family { rig: "rigs/klipper.toml", stage: klipper, z_holds: false, begins_s: 0.0 };

pub(crate) const ESP301: Family<EspFaultKind> =
    Family { rig: "rigs/esp301.toml", stage: esp301, z_holds: false, begins_s: 0.0 };
pub(crate) const XPS: Family<XpsFaultKind> = Family { rig: "rigs/xps.toml", stage: xps, z_holds: false, begins_s: 0.0 };
pub(crate) const ARM: Family<UrFaultKind> = Family { rig: "rigs/ur.toml", stage: arm, z_holds: false, begins_s: 0.2 };
pub(crate) const PROGRAM: Family<ProcessStageFaultKind> =
    Family { rig: "rigs/process.toml", stage: program, z_holds: false, begins_s: 0.0 };

/// Returns a shipped rig, simulated.
pub(crate) fn shipped_rig(path: &str) -> RigSpec {
    rig_of(path, &shipped_text(path))
}

/// Returns the rig of a text, simulated.
pub(crate) fn rig_of(path: &str, text: &str) -> RigSpec {
    let read = rig::parse(path, text, &|_| unreachable!("no map of its own"));
    read.unwrap_or_else(|problems| panic!("{:?}\n{text}", problems.lines())).simulated()
}

/// Returns the faults at a time, and those after a number of bytes.
fn faults<K>(fault: Option<(When, K)>) -> (Vec<DeviceFault<K>>, Vec<FaultAfterBytes<K>>) {
    match fault {
        Some((When::At(from_s), kind)) => (vec![DeviceFault { from_s, kind }], Vec::new()),
        Some((When::AfterBytes(bytes), kind)) => (Vec::new(), vec![FaultAfterBytes { bytes, kind }]),
        None => (Vec::new(), Vec::new()),
    }
}

/// Returns the lower ends and the lengths of a frame with room around the rig's travel, mm.
fn frame_mm(spec: &RigSpec) -> ([f64; 3], [f64; 3]) {
    let axes = spec.stage.travel.axes;
    (axes.map(|travel| travel.min - GRBL_ROOM_MM), axes.map(|travel| travel.width() + 2.0 * GRBL_ROOM_MM))
}

fn esp301(_: &RigSpec, scene: &Scene, fault: Option<(When, EspFaultKind)>) -> Shared<dyn Instrument> {
    let (timed, after_bytes) = faults(fault);
    Arc::new(Mutex::new(Esp301Emulator::new(scene).with_faults(&timed, &after_bytes)))
}

fn xps(_: &RigSpec, scene: &Scene, fault: Option<(When, XpsFaultKind)>) -> Shared<dyn Instrument> {
    let (timed, after_bytes) = faults(fault);
    let positioners = [("XYZ", "X"), ("XYZ", "Y"), ("XYZ", "Z")];
    Arc::new(Mutex::new(XpsEmulator::new(scene, positioners, 1.0).with_faults(&timed, &after_bytes)))
}

fn arm(spec: &RigSpec, scene: &Scene, fault: Option<(When, UrFaultKind)>) -> Shared<dyn Instrument> {
    let (faults, faults_after_bytes) = faults(fault);
    let step_mm = spec.stage.steps.mm[2];
    let arm = UrArm { rotvec_rad: [0.0, PI, 0.0], step_mm, faults, faults_after_bytes, ..UrArm::default() };
    Arc::new(Mutex::new(UrEmulator::new(arm, scene)))
}

fn program(_: &RigSpec, scene: &Scene, fault: Option<(When, ProcessStageFaultKind)>) -> Shared<dyn Instrument> {
    let (timed, after_bytes) = faults(fault);
    Arc::new(Mutex::new(ProcessStageEmulator::new(scene).with_faults(&timed, &after_bytes)))
}

fn marlin(spec: &RigSpec, scene: &Scene, fault: Option<(When, MarlinFaultKind)>) -> Shared<dyn Instrument> {
    let ((min_ends_mm, lengths_mm), (faults, faults_after_bytes)) = (frame_mm(spec), faults(fault));
    let board = MarlinBoard { min_ends_mm, lengths_mm, faults, faults_after_bytes, ..MarlinBoard::default() };
    Arc::new(Mutex::new(MarlinEmulator::new(board, scene)))
}

fn grbl(spec: &RigSpec, scene: &Scene, fault: Option<(When, GrblFaultKind)>) -> Shared<dyn Instrument> {
    let ((min_ends_mm, lengths_mm), stock) = (frame_mm(spec), GrblBoard::default());
    let mut board = GrblBoard {
        settings: stock.settings.clone().with(GrblBoard::SOFT_LIMITS, 0.0).with(GrblBoard::HOMING, 0.0),
        plus_ends_mm: std::array::from_fn(|axis| min_ends_mm[axis] + lengths_mm[axis]),
        lengths_mm,
        ..stock
    };
    board.settings = (0..3).fold(board.settings, |settings, axis| {
        let (rate_mm_s, a_mm_s2) = (settings.most_mm_s(axis.into()), settings.acceleration_mm_s2(axis.into()));
        settings
            .with(GrblBoard::RATE + axis, 60.0 * rate_mm_s.max(spec.stage.speed_mm_s))
            .with(GrblBoard::ACCELERATION + axis, a_mm_s2.max(spec.stage.acceleration_mm_s2))
    });
    (board.faults, board.faults_after_bytes) = faults(fault);
    Arc::new(Mutex::new(GrblEmulator::new(board, scene)))
}

fn klipper(spec: &RigSpec, scene: &Scene, fault: Option<(When, KlipperFaultKind)>) -> Shared<dyn Instrument> {
    let ((min_ends_mm, lengths_mm), (faults, faults_after_bytes)) = (frame_mm(spec), faults(fault));
    let board = KlipperBoard { min_ends_mm, lengths_mm, faults, faults_after_bytes, ..KlipperBoard::default() };
    Arc::new(Mutex::new(KlipperEmulator::new(board, scene)))
}
