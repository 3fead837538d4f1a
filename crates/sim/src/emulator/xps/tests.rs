//! The XPS, call by call.

mod faults;
mod sockets;

use super::positioner::TRAVEL_MM;
use super::*;
use crate::emulator::tests::{POWER_ON, STIFFNESS_N_MM, scene, scene_with};
use crate::scene::Servo;
use palpate_core::quantity::Axis;
use proptest::prelude::*;

/// Volts a newton of the load cell's amplifier.
const VOLTS_PER_NEWTON: f64 = 2.0;

fn xps(scene: &Scene) -> XpsEmulator {
    XpsEmulator::new(scene, [("XYZ", "X"), ("XYZ", "Y"), ("XYZ", "Z")], VOLTS_PER_NEWTON)
}

/// Some sockets of a controller and its scene, talked to at given times.
struct XpsBench {
    xps: XpsEmulator,
    scene: Scene,
}

impl XpsBench {
    fn new() -> Self {
        XpsBench::on(scene())
    }

    fn on(scene: Scene) -> Self {
        XpsBench { xps: xps(&scene), scene }
    }

    /// Homed from 10 s on.
    fn homed() -> Self {
        XpsBench::homed_on(scene())
    }

    fn homed_on(scene: Scene) -> Self {
        let mut bench = XpsBench::on(scene);
        bench.say(0.0, "GroupInitialize(XYZ)");
        bench.settle(1.0);
        bench.say(1.0, "GroupHomeSearch(XYZ)");
        assert_eq!(bench.settle(10.0), "0,,EndOfAPI");
        bench
    }

    /// What is answered at once, if anything.
    fn say(&mut self, now_s: f64, sent: &str) -> String {
        let mut inbox = sent.as_bytes().to_vec();
        let mut replies = Vec::new();
        while let Some(request) = self.xps.take_request(&mut inbox) {
            replies.extend(self.xps.answer(&request, &mut self.scene, now_s));
        }
        String::from_utf8(replies).expect("text")
    }

    /// What is owed by then, the controller being asked when it says so.
    fn settle(&mut self, until_s: f64) -> String {
        let mut at_s = 0.0;
        loop {
            match self.xps.owed(&mut self.scene, at_s) {
                Owed::Ready(reply) => return String::from_utf8(reply).expect("text"),
                Owed::At(next_s) if next_s <= until_s => at_s = next_s,
                _ if at_s == until_s => return String::new(),
                _ => at_s = until_s,
            }
        }
    }

    fn status(&mut self, now_s: f64) -> String {
        let reply = self.say(now_s, "GroupStatusGet(XYZ,int *)");
        reply.strip_prefix("0,").and_then(|rest| rest.strip_suffix(",EndOfAPI")).expect("a status").into()
    }

    fn true_mm(&mut self, axis: Axis, now_s: f64) -> f64 {
        self.scene.axis(axis, now_s).0
    }
}

#[test]
fn captured_session_is_reproduced() {
    let mut bench = XpsBench::new();
    for (sent, answered) in [
        ("FirmwareVersionGet(char *)", "0,XPS-Q8 Firmware V2.6.4,EndOfAPI"),
        ("InstallerVersionGet(char*)", "0,XPS-Q8 Installer V2.6.4,EndOfAPI"),
        ("ElapsedTimeGet(double *)", "0,20,EndOfAPI"),
        ("Login(Administrator,Administrator)", "0,,EndOfAPI"),
        ("Login(Administrator,admin)", "-106,Login(Administrator,admin),EndOfAPI"),
        ("CloseAllOtherSockets()\r\n", "0,,EndOfAPI"),
        ("ErrorStringGet(-27,char *)", "0,Move aborted,EndOfAPI"),
        ("ErrorStringGet(7,char *)", "-17,ErrorStringGet(7,char *),EndOfAPI"),
        ("GroupStatusGet(XYZ,int *)", "0,0,EndOfAPI"),
        ("GroupStatusStringGet(12,char *)", "0,Ready state from motion,EndOfAPI"),
        ("PositionerSGammaParametersGet(XYZ.X,double *,double *,double *,double *)", "0,25,100,0.005,0.05,EndOfAPI"),
        ("PositionerSGammaParametersSet(XYZ.X,2.5,50,0.01,0.04)", "0,,EndOfAPI"),
        ("PositionerSGammaParametersGet(XYZ.X,double *,double *,double *,double *)", "0,2.5,50,0.01,0.04,EndOfAPI"),
        ("PositionerMaximumVelocityAndAccelerationGet(XYZ.Z,double *,double *)", "0,25,100,EndOfAPI"),
        ("PositionerUserTravelLimitsGet(XYZ.Z,double *,double *)", "0,-12.5,12.5,EndOfAPI"),
        ("PositionerUserTravelLimitsSet(XYZ.Z,-3,12)", "0,,EndOfAPI"),
        ("PositionerUserTravelLimitsGet(XYZ.Z,double*,double*)", "0,-3,12,EndOfAPI"),
        ("PositionerErrorGet(XYZ.Y,int *)", "0,0,EndOfAPI"),
        ("PositionerErrorStringGet(0,char *)", "0,,EndOfAPI"),
        ("PositionerHardwareStatusGet(XYZ.Y,int *)", "0,4,EndOfAPI"),
        ("PositionerHardwareStatusStringGet(4,char *)", "0,ZM high level,EndOfAPI"),
        ("GPIOAnalogGet(GPIO2.ADC1,double *,GPIO2.ADC2,double *)", "0,0,0,EndOfAPI"),
        // not homed: counted from where it was switched on
        ("GroupPositionCurrentGet(XYZ,double *,double *,double *)", "0,0,0,0,EndOfAPI"),
    ] {
        assert_eq!(bench.say(20.0, sent), answered, "{sent}");
    }
    let list = bench.say(20.0, "ErrorListGet(char *)");
    assert!(list.starts_with("0,Error -1: ") && list.ends_with(";,EndOfAPI") && list.len() <= 1024);
}

#[test]
fn impossible_call_is_answered_with_its_code_and_request() {
    for (sent, code) in [
        ("*IDN?\n", -7),
        ("Group Move(1)", -7),
        ("Reset(all)", -4),
        ("GroupDance(XYZ)", -4),
        ("PositionerDance(XYZ.X)", -4),
        ("EventExtendedWait()", -4),
        ("GroupKill(XYZ.X)", -8),
        ("PositionerErrorGet(XYZ,int *)", -8),
        ("GroupMoveAbsolute(XYZ,1,2)", -9),
        ("GroupMoveAbsolute (XYZ.X, 1 , 2)", -9),
        ("GroupStatusGet(XYZ)", -9),
        ("FirmwareVersionGet(int *)", -13),
        ("GroupMoveAbsolute(XYZ.X,one)", -14),
        ("GroupMoveAbsolute(XYZ.X,inf)", -14),
        ("GroupStatusGet(XYZ,double *)", -15),
        ("GroupMoveAbsolute (XYZ.X,380)", -17),
        ("GroupMoveRelative(XYZ,0,-12.6,0)", -17),
        ("PositionerSGammaParametersSet(XYZ.X,25.1,100,0.005,0.05)", -17),
        ("PositionerSGammaParametersSet(XYZ.X,0,100,0.005,0.05)", -17),
        ("PositionerSGammaParametersSet(XYZ.X,1,101,0.005,0.05)", -17),
        ("PositionerSGammaParametersSet(XYZ.X,1,100,0.05,0.005)", -17),
        ("PositionerUserTravelLimitsSet(XYZ.X,-13,1)", -17),
        ("GPIOAnalogGet(GPIO2.ADC5,double *)", -17),
        ("GroupMoveAbsolute(XYZ.W,1)", -18),
        ("GroupMoveAbsolute(Group1,1,2,3)", -19),
        ("GroupHomeSearch(XYZ)", -22),
        ("GroupInitialize(XYZ)", -22),
        ("GroupMotionEnable(XYZ)", -22),
        ("GroupMoveAbort(XYZ)", -22),
        ("EventExtendedStart(int *)", -80),
        ("EventExtendedConfigurationTriggerSet(XYZ.Spin,0,0,0,0)", -40),
        ("EventExtendedConfigurationTriggerSet(XYZ.SGamma.MotionState,0,0,0)", -9),
        ("EventExtendedConfigurationActionSet(ABC.MoveAbort,0,0,0,0)", -39),
        ("EventExtendedRemove(1)", -83),
    ] {
        let mut bench = XpsBench::homed();
        let echo = sent.trim_end();
        assert_eq!(bench.say(20.0, sent), format!("{code},{echo},EndOfAPI"));
        assert_eq!(bench.status(20.0), "11");
        assert_eq!(bench.say(30.0, "GroupPositionCurrentGet(XYZ,double *,double *,double *)"), "0,0,0,0,EndOfAPI");
    }
}

#[test]
fn groups_of_one_and_two_positioners_are_independent() {
    let scene = scene();
    let xps = XpsEmulator::new(&scene, [("XY", "X"), ("XY", "Y"), ("Z", "Pos")], VOLTS_PER_NEWTON);
    let mut bench = XpsBench { xps, scene };
    let other = |bench: &mut XpsBench, now_s: f64, sent: &str| {
        let socket = bench.xps.accept().expect("another");
        let reply = socket.lock().expect("sound").answer(sent.as_bytes(), &mut bench.scene, now_s);
        String::from_utf8(reply).expect("text")
    };
    for (at_s, group) in [(0.0, "Z"), (10.0, "XY")] {
        bench.say(at_s, &format!("GroupInitialize({group})"));
        assert_eq!(bench.settle(at_s + 1.0), "0,,EndOfAPI");
        bench.say(at_s + 1.0, &format!("GroupHomeSearch({group})"));
        let still = if group == "Z" { "0,0,EndOfAPI" } else { "0,11,EndOfAPI" };
        let on_other = if group == "Z" { "GroupStatusGet(XY,int *)" } else { "GroupStatusGet(Z,int *)" };
        assert_eq!(other(&mut bench, at_s + 1.1, on_other), still);
        assert_eq!(bench.settle(at_s + 9.0), "0,,EndOfAPI");
    }
    for (sent, code) in [
        ("GroupMoveAbsolute(XY,1)", -9),
        ("GroupMoveAbsolute(XY,1,2,3)", -9),
        ("GroupMoveAbsolute(Z,1,2)", -9),
        ("GroupMoveAbsolute(XY,1,z)", -14),
        ("GroupPositionCurrentGet(XY,double *)", -9),
        ("GroupPositionCurrentGet(Z.Pos,double *,double *)", -9),
        ("GroupMoveAbsolute(XY.Pos,1)", -18),
        ("GroupMoveAbsolute(XYZ,1,2,3)", -19),
        ("GroupKill(Z.Pos)", -8),
        ("PositionerErrorGet(Z,int *)", -8),
        ("EventExtendedConfigurationActionSet(Z.Pos.MoveAbort,0,0,0,0)", -39),
    ] {
        assert_eq!(bench.say(20.0, sent), format!("{code},{sent},EndOfAPI"));
    }
    // both groups at once; the abort of one leaves the other
    bench.say(20.0, "GroupMoveAbsolute(XY,5,-5)");
    assert_eq!(other(&mut bench, 20.0, "GroupMoveAbsolute(Z.Pos,5)"), "");
    let statuses = |bench: &mut XpsBench, now_s| {
        ["XY", "Z"].map(|group| other(bench, now_s, &format!("GroupStatusGet({group},int *)")))
    };
    assert_eq!(statuses(&mut bench, 20.1), ["0,44,EndOfAPI", "0,44,EndOfAPI"]);
    assert_eq!(other(&mut bench, 20.1, "GroupMoveAbort(Z)"), "0,,EndOfAPI");
    assert_eq!(statuses(&mut bench, 20.3), ["0,44,EndOfAPI", "0,10,EndOfAPI"]);
    assert_eq!(bench.settle(25.0), "0,,EndOfAPI");
    assert_eq!(bench.say(25.0, "GroupPositionCurrentGet(XY,double *,double *)"), "0,5,-5,EndOfAPI");
    assert!(bench.true_mm(Axis::Z, 25.0) < 3.0);
}

#[test]
fn group_passes_through_its_states() {
    let mut bench = XpsBench::new();
    let now_s = std::cell::Cell::new(0.0);
    // answered within 20 s, with the status at once, and then
    let mut step = |sent: &str| {
        let asked_s = now_s.get();
        let at_once = bench.say(asked_s, sent);
        let soon = bench.status_on_another(asked_s);
        now_s.set(asked_s + 20.0);
        let reply = if at_once.is_empty() { bench.settle(now_s.get()) } else { at_once };
        (reply.split(',').next().map(str::to_owned).expect("a code"), soon, bench.status(now_s.get()))
    };
    for (sent, code, soon, then) in [
        ("GroupHomeSearch(XYZ)", "-22", "0", "0"),
        ("GroupMoveAbsolute(XYZ,0,0,0)", "-22", "0", "0"),
        ("GroupInitialize(XYZ)", "0", "41", "42"),
        ("GroupMoveAbsolute(XYZ,0,0,0)", "-22", "42", "42"),
        ("GroupInitialize(XYZ)", "-22", "42", "42"),
        ("GroupHomeSearch(XYZ)", "0", "43", "11"),
        ("GroupHomeSearch(XYZ)", "-22", "11", "11"),
        ("GroupMoveAbsolute(XYZ,1,2,3)", "0", "44", "12"),
        ("GroupMoveRelative(XYZ.X,-2)", "0", "44", "12"),
        ("GroupMotionDisable(XYZ)", "0", "20", "20"),
        ("GroupMoveAbsolute(XYZ.X,1)", "-22", "20", "20"),
        ("GroupMotionEnable(XYZ)", "0", "13", "13"),
        ("GroupKill(XYZ)", "0", "7", "7"),
        ("GroupInitializeWithEncoderCalibration(XYZ)", "0", "49", "42"),
        ("GroupHomeSearch(XYZ)", "0", "43", "11"),
        ("GroupMoveAbsolute(XYZ,1,2,3)", "0", "44", "12"),
        ("KillAll()", "0", "7", "7"),
    ] {
        assert_eq!(step(sent), (code.into(), soon.into(), then.into()), "{sent}");
    }
    let places = "GroupPositionCurrentGet(XYZ,double *,double *,double *)";
    assert_eq!(bench.say(1000.0, places), "0,1,2,3,EndOfAPI");
    bench.say(1000.0, "KillAll()");
    bench.say(1000.0, "GroupInitialize(XYZ)");
    assert_eq!(bench.settle(1001.0), "0,,EndOfAPI");
    assert_eq!(bench.say(1001.0, places), "0,0,0,0,EndOfAPI");
}

#[test]
fn a_relative_move_holds_its_socket_until_its_end_and_ends_like_an_absolute_one() {
    let mut bench = XpsBench::homed();
    let places = "GroupPositionCurrentGet(XYZ,double *,double *,double *)";
    assert_eq!(bench.say(20.0, "GroupMoveRelative(XYZ,1,-2,0.5)"), "");
    assert_eq!(bench.status_on_another(20.05), "44");
    let busy = "GroupMoveRelative(XYZ.Z,1)";
    assert_eq!(bench.say(20.05, busy), format!("-1,{busy},EndOfAPI"));
    assert_eq!(bench.settle(25.0), "0,,EndOfAPI");
    bench.say(25.0, "GroupMoveRelative(XYZ.Z, -2.5)");
    assert_eq!(bench.settle(30.0), "0,,EndOfAPI");
    assert_eq!(bench.say(30.0, places), "0,1,-2,-2,EndOfAPI");
    for (sent, code) in [
        ("GroupMoveRelative(XYZ,1,-2)", -9),
        ("GroupMoveRelative(XYZ.Z,up)", -14),
        ("GroupMoveRelative(XYZ.Z,-10.6)", -17),
        ("GroupMoveRelative(XYZ.W,1)", -18),
        ("GroupMoveRelative(ABC,1,1,1)", -19),
    ] {
        assert_eq!(bench.say(30.0, sent), format!("{code},{sent},EndOfAPI"));
    }
    // from another socket it is aborted, and the next one counts from there
    bench.say(30.0, "GroupMoveRelative(XYZ.Z,9)");
    let abort = bench.xps.accept().expect("another");
    let answer = abort.lock().expect("sound").answer(b"GroupMoveAbort(XYZ)", &mut bench.scene, 30.3);
    assert_eq!(answer, b"0,,EndOfAPI");
    assert_eq!(bench.settle(35.0), "-27,GroupMoveRelative(XYZ.Z,9),EndOfAPI");
    let from_mm = bench.true_mm(Axis::Z, 35.0);
    bench.say(35.0, "GroupMoveRelative(XYZ.Z,-1)");
    assert_eq!(bench.settle(40.0), "0,,EndOfAPI");
    assert!((bench.true_mm(Axis::Z, 40.0) - from_mm + 1.0).abs() < 1e-9);
}

impl XpsBench {
    fn status_on_another(&mut self, now_s: f64) -> String {
        let other = self.xps.accept().expect("another");
        let mut other = other.lock().expect("sound");
        let reply = other.answer(b"GroupStatusGet(XYZ,int *)", &mut self.scene, now_s);
        String::from_utf8(reply).expect("text").split(',').nth(1).expect("a status").into()
    }
}

#[test]
fn homing_takes_its_time_z_first() {
    let mut bench = XpsBench::new();
    bench.say(0.0, "GroupInitialize(XYZ)");
    bench.settle(1.0);
    bench.say(1.0, "GroupHomeSearch(XYZ)");
    // 8 mm at 5 mm/s and 0.1 s for the ramps
    bench.settle(2.6);
    assert_eq!((bench.true_mm(Axis::X, 2.6), bench.true_mm(Axis::Y, 2.6)), (POWER_ON.x_mm, POWER_ON.y_mm));
    assert!(bench.true_mm(Axis::Z, 2.6) < 1.0);
    assert_eq!(bench.settle(3.15), "");
    assert_eq!(bench.settle(3.3), "0,,EndOfAPI");
    assert_eq!(Axis::ALL.map(|axis| bench.true_mm(axis, 3.3)), [0.0; 3]);
}

#[test]
fn a_group_arrives_together_and_a_positioner_goes_alone() {
    let mut bench = XpsBench::homed();
    for positioner in ["X", "Y", "Z"] {
        bench.say(10.0, &format!("PositionerSGammaParametersSet(XYZ.{positioner},2,100,0.005,0.05)"));
    }
    bench.say(10.0, "GroupMoveAbsolute(XYZ,4,-1,0)");
    let end_s = bench.scene.motion(Axis::X).end_s();
    assert!((end_s - 12.02).abs() < 1e-9);
    assert!((bench.scene.motion(Axis::Y).end_s() - end_s).abs() < 1e-9);
    assert!(!bench.scene.motion(Axis::Z).moving(10.01));
    // halfway in half the time
    let half_s = (10.0 + end_s) / 2.0;
    let half_mm = [Axis::X, Axis::Y].map(|axis| bench.true_mm(axis, half_s));
    assert!((half_mm[0] - 2.0).abs() < 1e-9 && (half_mm[1] + 0.5).abs() < 1e-9, "{half_mm:?}");
    assert_eq!(bench.settle(end_s - 0.01), "");
    assert_eq!(bench.settle(end_s + 1e-9), "0,,EndOfAPI");
    let tell = bench.say(13.0, "GroupPositionCurrentGet(XYZ,double *,double *,double *)");
    assert_eq!(tell, "0,4,-1,0,EndOfAPI");
    bench.say(13.0, "GroupMoveAbsolute(XYZ.Z,1.5)");
    let busy = bench.xps.accept().expect("another");
    let ask = |bench: &mut XpsBench, text: &str| {
        let reply = busy.lock().expect("sound").answer(text.as_bytes(), &mut bench.scene, 13.5);
        String::from_utf8(reply).expect("text")
    };
    assert_eq!(ask(&mut bench, "GroupStatusGet(XYZ,int *)"), "0,44,EndOfAPI");
    assert_eq!(bench.scene.axis(Axis::Z, 13.5).1, 2.0);
    assert!(ask(&mut bench, "GroupMoveAbsolute(XYZ.X,0)").starts_with("-22,"));
    assert_eq!(bench.settle(14.0), "0,,EndOfAPI");
    assert_eq!(bench.true_mm(Axis::Z, 14.0), 1.5);
}

#[test]
fn targets_are_rounded_to_the_step_and_no_distance_takes_no_time() {
    let mut bench = XpsBench::homed_on(scene_with(|spec| {
        spec.stage = Some(Servo { lag_s: 0.0, quantum_mm: 0.01, ..Servo::default() })
    }));
    bench.say(11.0, "GroupMoveAbsolute(XYZ,0.1263,0,0)");
    assert_eq!(bench.settle(12.0), "0,,EndOfAPI");
    assert!((bench.true_mm(Axis::X, 12.0) - 0.13).abs() < 1e-12);
    bench.say(12.0, "GroupMoveAbsolute(XYZ.X,0.1299)");
    assert_eq!(bench.settle(12.0), "0,,EndOfAPI");
}

#[test]
fn load_cell_is_read_in_volts_within_the_input_range() {
    let mut bench = XpsBench::homed();
    for (depth_mm, volts) in [(0.5, "2"), (3.0, "10")] {
        assert_eq!(STIFFNESS_N_MM * VOLTS_PER_NEWTON, 4.0);
        let now_s = 20.0 + depth_mm;
        bench.say(now_s, &format!("GroupMoveAbsolute(XYZ.Z,-{depth_mm})"));
        bench.settle(now_s + 1.0);
        assert_eq!(bench.say(now_s + 1.0, "GPIOAnalogGet(GPIO2.ADC1,double *)"), format!("0,{volts},EndOfAPI"));
    }
}

#[test]
fn kill_brakes_and_ends_waiting_calls() {
    let mut bench = XpsBench::homed();
    bench.say(10.0, "GroupMoveAbsolute(XYZ.X,10)");
    let other = bench.xps.accept().expect("another");
    let reply = other.lock().expect("sound").answer(b"GroupKill(XYZ)", &mut bench.scene, 10.3);
    assert_eq!(reply, b"0,,EndOfAPI");
    assert_eq!(bench.status_on_another(10.31), "40");
    assert_eq!(bench.settle(11.0), "-26,GroupMoveAbsolute(XYZ.X,10),EndOfAPI");
    assert_eq!(bench.status(11.0), "7");
}

proptest! {
    #[test]
    fn emulator_survives_arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..1200)) {
        let mut bench = XpsBench::homed();
        let mut inbox = bytes;
        while let Some(request) = bench.xps.take_request(&mut inbox) {
            prop_assert!(bench.xps.answer(&request, &mut bench.scene, 20.0).len() <= 1024);
        }
    }

    #[test]
    fn emulator_survives_malformed_calls(
        calls in prop::collection::vec((0usize..CALLS.len(), any::<prop::sample::Index>(), any::<u8>(), 0usize..4), 1..30),
    ) {
        let mut bench = XpsBench::homed();
        let mut now_s = 10.0;
        for (call, at, byte, how) in calls {
            let mut text = CALLS[call].as_bytes().to_vec();
            let at = at.index(text.len());
            match how {
                0 => text[at] = byte,
                1 => text.truncate(at),
                2 => text.insert(at, byte),
                _ => {}
            }
            while let Some(request) = bench.xps.take_request(&mut text) {
                prop_assert!(bench.xps.answer(&request, &mut bench.scene, now_s).len() <= 1024);
            }
            now_s += 0.2;
            bench.xps.owed(&mut bench.scene, now_s);
            for axis in Axis::ALL {
                prop_assert!(bench.true_mm(axis, now_s).abs() <= TRAVEL_MM + 1e-6);
            }
        }
    }
}

const CALLS: [&str; 12] = [
    "GroupMoveAbsolute(XYZ,1,-12,12)",
    "GroupMoveRelative(XYZ.X,5)",
    "GroupMoveAbort(XYZ)",
    "GroupKill(XYZ)",
    "GroupInitialize(XYZ)",
    "GroupHomeSearch(XYZ)",
    "PositionerSGammaParametersSet(XYZ.X,20,3,0.005,0.05)",
    "PositionerUserTravelLimitsSet(XYZ.X,-3,3)",
    "GPIOAnalogGet(GPIO2.ADC1,double *,GPIO2.ADC2,double *)",
    "EventExtendedConfigurationTriggerSet(GPIO2.ADC1.ADCLowLimit,1,0,0,0)",
    "EventExtendedConfigurationActionSet(XYZ.MoveAbort,0,0,0,0)",
    "EventExtendedStart(int *)",
];
