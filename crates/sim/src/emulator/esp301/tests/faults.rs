//! Faults of an ESP301, byte by byte.

use super::*;
use EspFaultKind::{DoubledAnswer, LostAnswer, Mirrored, NeverDone, Other, Restart};

/// A homed controller with z at true 2 mm, which it counts 2, by 20 s.
fn failing(timed: &[(f64, EspFaultKind)], after_bytes: &[EspFaultAfterBytes]) -> Esp301Bench {
    let mut bench = Esp301Bench::homed();
    bench.say(10.0, "3PA2");
    let timed: Vec<EspFault> = timed.iter().map(|&(from_s, kind)| EspFault { from_s, kind }).collect();
    bench.say(19.0, "TP?");
    bench.esp = bench.esp.with_faults(&timed, after_bytes);
    bench
}

#[test]
fn an_answer_is_lost_or_doubled() {
    let mut bench = failing(&[(20.0, LostAnswer), (21.0, DoubledAnswer)], &[]);
    let heard = [20.0, 20.5, 21.0, 21.5].map(|at_s| bench.say(at_s, "3PR0;3TP?"));
    assert_eq!(heard, ["", "2.0000", "2.0000|2.0000", "2.0000"]);
}

#[test]
fn another_host_defines_home_anew_or_jogs_and_shares_the_errors() {
    let mut bench = failing(&[(20.0, Other("3DH")), (25.0, Other("3VA5;3PR-1\nXX;3TP?"))], &[]);
    assert_eq!(bench.say(20.0, "3TP?;3PR-0.5"), "0.0000");
    assert_eq!(bench.true_mm(Axis::Z, 24.0), 1.5);
    // it moves although nobody of ours asks
    assert_eq!(bench.esp.owed(&mut bench.scene, 24.0), Owed::At(25.0));
    assert_eq!(bench.esp.owed(&mut bench.scene, 25.0), Owed::Nothing);
    assert_eq!(bench.say(25.1, "3MD?;3PR0.5"), "0");
    assert_eq!(bench.errors(29.0), ["6", "332"]);
    assert_eq!(bench.say(30.0, "3TP?"), "-1.5000");
    assert_eq!(bench.true_mm(Axis::Z, 30.0), 0.5);
}

#[test]
fn a_restart_counts_zero_where_the_axes_are_and_loses_what_comes() {
    let mut bench = failing(&[(20.0, Restart { motors_on: true, takes_s: 2.0 })], &[]);
    assert_eq!(bench.say(21.0, "3TP?;3PR-1"), "");
    assert_eq!(bench.say(22.0, "TP?;3MO?;3VA?;TE?"), "0.0000, 0.0000, 0.0000|1|10.0000|0");
    bench.say(23.0, "3PA-0.5");
    assert_eq!(bench.true_mm(Axis::Z, 25.0), 1.5);
    // under way the axis brakes; with its motors off nothing moves again
    let mut bench = failing(&[(20.5, Restart { motors_on: false, takes_s: 0.0 })], &[]);
    bench.say(20.0, "3VA1;3PR-5");
    assert_eq!(bench.esp.owed(&mut bench.scene, 20.5), Owed::Nothing);
    assert_eq!(bench.say(21.0, "3MD?;3MO?;3PR-1"), "1|0");
    assert_eq!(bench.errors(21.0), ["313"]);
    assert!((1.4..1.6).contains(&bench.true_mm(Axis::Z, 30.0)), "{}", bench.true_mm(Axis::Z, 30.0));
}

#[test]
fn a_restart_after_any_byte_loses_its_line() {
    let sent = "3VA1;3PR-1;3MD?\r";
    for bytes in 1..=sent.len() as u64 {
        let fault = EspFaultAfterBytes { bytes, kind: Restart { motors_on: true, takes_s: 1.0 } };
        let mut bench = failing(&[], &[fault]);
        assert_eq!(bench.say(20.0, sent), "", "{bytes}");
        assert_eq!(bench.say(25.0, "3TP?;TE?"), "0.0000|0", "{bytes}");
        assert_eq!(bench.true_mm(Axis::Z, 25.0), 2.0, "{bytes}");
    }
}

#[test]
fn a_mirrored_axis_counts_on_and_goes_the_other_way() {
    let mut bench = failing(&[(20.0, Mirrored(Axis::Z))], &[]);
    assert_eq!(bench.say(20.0, "3TP?;3PA?;3PR-1"), "2.0000|2.0000");
    assert_eq!(bench.say(25.0, "3TP?"), "1.0000");
    assert_eq!(bench.true_mm(Axis::Z, 25.0), 3.0);
    bench.say(25.0, "3PA-12");
    assert_eq!(bench.errors(40.0), ["305"]);
    assert_eq!(bench.true_mm(Axis::Z, 40.0), 12.5);
    bench.say(40.0, "3OR3");
    assert_eq!(bench.true_mm(Axis::Z, 50.0), -12.5);
    assert_eq!(bench.say(50.0, "3TP?;3SR30;3PR-1"), "12.5000");
    assert_eq!(bench.true_mm(Axis::Z, 55.0), -11.5);
}

#[test]
fn a_motion_is_never_reported_done() {
    let mut bench = failing(&[(20.0, NeverDone)], &[]);
    assert_eq!(bench.say(20.0, "3PR-1;3MD?"), "0");
    assert_eq!(bench.say(60.0, "3MD?;MD?;3TP?"), "0|0, 0, 0|1.0000");
}
