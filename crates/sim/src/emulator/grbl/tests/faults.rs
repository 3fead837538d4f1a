//! Faults of a board with GRBL, byte by byte.

use super::*;
use GrblFaultKind::{CountsJump, DoubledOk, LostOk, Other, Restart};

/// A frame without switches in the middle of the scene, with a fault at 40 s. It counts from zero where it is switched on.
fn by_hand(kind: GrblFaultKind) -> GrblBench {
    by_hand_on(MotionBoard { faults: vec![GrblFault { from_s: 40.0, kind }], ..board() })
}

fn by_hand_with(faults_after_bytes: Vec<GrblFaultAfterBytes>) -> GrblBench {
    by_hand_on(MotionBoard { faults_after_bytes, ..board() })
}

fn by_hand_on(board: MotionBoard) -> GrblBench {
    let settings = BoardSettings::default().with(MotionBoard::SOFT_LIMITS, 0.0).with(MotionBoard::HOMING, 0.0);
    let scene = scene();
    let board = MotionBoard { settings, boot_s: None, ..board };
    GrblBench { grbl: GrblEmulator::new(board, &scene), scene, done_s: 0.0 }
}

#[test]
fn each_welcome_of_a_restart_has_its_bytes_and_the_count_begins_at_zero() {
    for (welcome, said) in [
        (GrblWelcome::Clean, " Grbl 1.1h ['$' for help]"),
        (GrblWelcome::Damaged, " Grbm 1.1h ['$' for help]"),
        (GrblWelcome::Stray, "\0\u{7f}Grbl 1.1h ['$' for help]"),
        (GrblWelcome::Lost, ""),
    ] {
        let mut bench = by_hand(Restart(welcome));
        assert_eq!(bench.send(10.0, b"G20 G91\nG92 Z5\n$J=G91 G21 Z-2 F300\n"), "ok\r\n".repeat(3));
        assert_eq!(bench.say(40.0, b""), said, "{welcome:?}");
        bench.script(&[
            (40.1, "?", "<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"),
            (40.2, "$G\n", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0] ok"),
            // nothing locks it: a place of before is another one
            (40.3, "$J=G90 G53 Z0.5 F300\n", "ok"),
        ]);
        assert_eq!(bench.true_mm(Axis::Z, 45.0), POWER_ON.z_mm - 1.5, "{welcome:?}");
    }
    // a board that homes is locked, and says so
    let faults = vec![GrblFault { from_s: 40.0, kind: Restart(GrblWelcome::Damaged) }];
    let scene = scene();
    let grbl = GrblEmulator::new(MotionBoard { faults, ..board() }, &scene);
    let mut bench = GrblBench { grbl, scene, done_s: 0.0 };
    assert_eq!(bench.say(40.0, b""), format!(" Grbm 1.1h ['$' for help] {UNLOCK}"));
    assert!((bench.done_s - 41.7).abs() < 1e-9);
    bench.script(&[(42.0, "$J=G91 Z1 F300\n", "error:8")]);
}

#[test]
fn a_restart_after_any_byte_loses_the_rest_of_its_line() {
    let sent = "$J=G91 G21 Z-1 F300\n?";
    for bytes in 1..sent.len() as u64 {
        let fault = GrblFaultAfterBytes { bytes, kind: Restart(GrblWelcome::Lost) };
        let mut bench = by_hand_with(vec![fault]);
        bench.grbl.machine.board.boot_s = Some(0.5);
        assert_eq!(bench.say(1.0, sent.as_bytes()), "", "{bytes}");
        assert_eq!(bench.say(2.0, b"?"), "<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>", "{bytes}");
        assert_eq!(bench.true_mm(Axis::Z, 9.0), POWER_ON.z_mm, "{bytes}");
    }
    // one that is ready at once takes the rest for a line, which can be a motion: `G91 G21 Z-1 F300` is a rapid one
    let mut bench = by_hand_with(vec![GrblFaultAfterBytes { bytes: 3, kind: Restart(GrblWelcome::Lost) }]);
    assert!(bench.say(1.0, sent.as_bytes()).starts_with("ok <Run|"));
    assert_eq!(bench.true_mm(Axis::Z, 9.0), POWER_ON.z_mm - 1.0);
}

#[test]
fn an_ok_is_lost_or_doubled() {
    let (at_s, jog) = (40.0, "$J=G91 G21 Z1 F300\n");
    by_hand(LostOk).script(&[(at_s, jog, ""), (41.0, "$G\n", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0] ok")]);
    by_hand(DoubledOk).script(&[(at_s, jog, "ok ok"), (41.0, "\n", "ok")]);
}

#[test]
fn counts_jump_and_nothing_moves() {
    let mut bench = by_hand(CountsJump([0, 0, -800]));
    bench.script(&[(39.9, "$J=G91 G21 Z-2 F600\n", "ok")]);
    bench.say(40.0, b"");
    bench.script(&[(45.0, "?", "<Idle|MPos:0.000,0.000,-3.000|FS:0,0|WCO:0.000,0.000,0.000>")]);
    assert_eq!(bench.true_mm(Axis::Z, 45.0), POWER_ON.z_mm - 2.0);
}

#[test]
fn another_sender_changes_modes_and_zeros_and_gets_its_own_answers() {
    for (lines, z_mm, report) in [
        ("G92 Z0", -1.0, "0.000,0.000,-1.500|FS:0,0|WCO:0.000,0.000,-0.500"),
        ("G10 L20 P1 Z3", -1.0, "0.000,0.000,-1.500|FS:0,0|WCO:0.000,0.000,-3.500"),
        ("G91\nG20", -1.0, "0.000,0.000,-1.500|FS:0,0|WCO:0.000,0.000,0.000"),
        ("$J=G91 G21 Z-1 F600", -2.0, "0.000,0.000,-2.500|FS:0,0|WCO:0.000,0.000,0.000"),
        ("G91\nG1 Z-1 F600\nX1\nX-1\nG90", -2.0, "0.000,0.000,-2.500|FS:0,0|WCO:0.000,0.000,0.000"),
    ] {
        let mut bench = by_hand(Other(lines));
        bench.script(&[(30.0, "$J=G91 G21 Z-0.5 F300\n", "ok"), (40.0, "", "")]);
        bench.script(&[(50.0, "$J=G91 G21 Z-1 F300\n", "ok"), (60.0, "?", &format!("<Idle|MPos:{report}>"))]);
        assert_eq!(bench.true_mm(Axis::Z, 60.0), POWER_ON.z_mm - 0.5 + z_mm, "{lines}");
    }
    // our jog meets a motion of the other's
    let mut bench = by_hand(Other("G91\nG1 Z-1 F60"));
    bench.say(40.0, b"");
    bench.script(&[(40.1, "$J=G91 G21 Z1 F300\n", "error:8")]);
}

#[test]
fn a_feed_hold_lets_lines_wait_until_it_is_resumed_or_reset() {
    let mut bench = by_hand(Other("!"));
    bench.say(40.0, b"");
    bench.script(&[
        (40.1, "$J=G91 G21 Z-1 F300\n", ""),
        (41.0, "$G\n", ""),
        (60.0, "?", "<Hold:0|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"),
        (61.0, "~", "ok [GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0] ok"),
    ]);
    assert_eq!(bench.true_mm(Axis::Z, 65.0), POWER_ON.z_mm - 1.0);
    // a line is braked and continued; a jog is cancelled
    bench.script(&[(70.0, "G91\nG1 Z-2 F600\n", "ok ok"), (70.15, "!", "")]);
    assert!(bench.say(70.16, b"?").starts_with("<Hold:1|"));
    assert!(bench.say(72.0, b"?").starts_with("<Hold:0|"));
    assert!(bench.true_mm(Axis::Z, 72.0) > POWER_ON.z_mm - 3.0);
    bench.script(&[(73.0, "~", "")]);
    assert_eq!(bench.true_mm(Axis::Z, 75.0), POWER_ON.z_mm - 3.0);
    bench.script(&[(80.0, "$J=G21 Z5 F600\n", "ok"), (80.2, "!", "")]);
    assert!(bench.say(82.0, b"?").starts_with("<Idle|"));
    // a reset of what rests loses no place, and no lock follows
    bench.script(&[(90.0, "G1 Z1 F600\n", "ok"), (90.05, "!", ""), (91.0, "\x18", " Grbl 1.1h ['$' for help]")]);
    assert!(bench.say(92.0, b"?").starts_with("<Idle|"));
}
