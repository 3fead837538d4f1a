//! Faults of an XPS, call by call.

use super::*;
use XpsFaultKind::{DoubledAnswer, LostAnswer, Other, Restart};

const DOWN: &str = "GroupMoveRelative(XYZ.Z,-1)";
const PLACE: &str = "GroupPositionCurrentGet(XYZ.Z,double *)";

/// A homed controller whose axes are at 0, with faults at their times.
fn failing(timed: &[(f64, XpsFaultKind)], after_bytes: &[XpsFaultAfterBytes]) -> XpsBench {
    let XpsBench { xps, scene } = XpsBench::homed();
    let timed: Vec<XpsFault> = timed.iter().map(|&(from_s, kind)| XpsFault { from_s, kind }).collect();
    XpsBench { xps: xps.with_faults(&timed, after_bytes), scene }
}

#[test]
fn an_answer_is_lost_or_doubled_at_once_or_at_the_end_of_a_move() {
    let mut bench = failing(&[(20.0, LostAnswer), (21.0, DoubledAnswer)], &[]);
    let heard = [20.0, 20.5, 21.0, 21.5].map(|at_s| bench.say(at_s, PLACE));
    assert_eq!(heard, ["", "0,0,EndOfAPI", "0,0,EndOfAPI0,0,EndOfAPI", "0,0,EndOfAPI"]);
    for (kind, end) in [(LostAnswer, ""), (DoubledAnswer, "0,,EndOfAPI0,,EndOfAPI")] {
        let mut bench = failing(&[(20.0, kind)], &[]);
        assert_eq!(bench.say(20.0, DOWN), "");
        assert_eq!(bench.settle(25.0), end);
        assert_eq!(bench.say(25.0, PLACE), "0,-1,EndOfAPI");
    }
}

#[test]
fn another_client_moves_or_homes_anew() {
    let calls = [(20.0, Other("GroupMoveRelative(XYZ.Z,-2)")), (25.0, Other("GroupKill(XYZ)\nGroupInitialize(XYZ)"))];
    let mut bench = failing(&calls, &[]);
    bench.settle(20.0);
    assert_eq!(bench.say(20.05, DOWN), format!("-22,{DOWN},EndOfAPI"));
    bench.settle(24.0);
    assert_eq!(bench.say(24.0, PLACE), "0,-2,EndOfAPI");
    bench.settle(26.0);
    assert_eq!(bench.status(26.0), "42");
    assert_eq!(bench.say(26.0, PLACE), "0,0,EndOfAPI");
    assert_eq!(bench.say(26.0, DOWN), format!("-22,{DOWN},EndOfAPI"));
    assert_eq!(bench.true_mm(Axis::Z, 30.0), -2.0);
}

#[test]
fn a_restart_closes_all_sockets_and_counts_zero_where_the_axes_are() {
    let mut bench = failing(&[(20.1, Restart { takes_s: 5.0 })], &[]);
    assert_eq!(bench.say(20.0, "GroupMoveRelative(XYZ.Z,-8)"), "");
    assert_eq!(bench.xps.owed(&mut bench.scene, 20.05), Owed::At(20.1));
    assert_eq!(bench.xps.owed(&mut bench.scene, 20.1), Owed::HungUp);
    let opened = bench.xps.accept().expect("another");
    assert_eq!(opened.lock().expect("sound").owed(&mut bench.scene, 24.0), Owed::HungUp);
    let opened = bench.xps.accept().expect("another");
    let mut opened = opened.lock().expect("sound");
    let mut ask = |sent: &str| String::from_utf8(opened.answer(sent.as_bytes(), &mut bench.scene, 26.0)).expect("text");
    assert_eq!(ask("GroupStatusGet(XYZ,int *)"), "0,0,EndOfAPI");
    assert_eq!(ask(PLACE), "0,0,EndOfAPI");
    assert_eq!(ask(DOWN), format!("-22,{DOWN},EndOfAPI"));
    drop(opened);
    assert!((-1.0..0.0).contains(&bench.true_mm(Axis::Z, 30.0)));
}

#[test]
fn a_restart_after_any_byte_loses_its_call() {
    for bytes in 1..=DOWN.len() as u64 {
        let mut bench = failing(&[], &[XpsFaultAfterBytes { bytes, kind: Restart { takes_s: 0.0 } }]);
        assert_eq!(bench.say(20.0, DOWN), "", "{bytes}");
        assert_eq!(bench.xps.owed(&mut bench.scene, 20.0), Owed::HungUp, "{bytes}");
        assert_eq!(bench.true_mm(Axis::Z, 30.0), 0.0, "{bytes}");
    }
}
