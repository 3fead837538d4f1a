//! Faults of a board with Marlin, byte by byte.

use super::*;

/// What [`numbered`] is answered by a board that counts lines from the start again.
const RESENT: &str = "Error:Line Number is not Last Line Number+1, Last Line: 0|Resend: 1|ok";

/// A homed board in the middle with a fault at 40 s.
fn failing(kind: MarlinFaultKind) -> MarlinBench {
    MarlinBench::homed(MarlinBoard { faults: vec![at(40.0, kind)], inches: true, babysteps: true, ..board() })
}

#[test]
fn an_ok_is_lost_and_a_line_is_garbled() {
    let faults = vec![
        at(1.0, MarlinFaultKind::LostOk),
        at(2.0, MarlinFaultKind::GarbledLine),
        at(3.0, MarlinFaultKind::GarbledLine),
    ];
    MarlinBench::on(MarlinBoard { faults, ..board() }).script(&[
        (0.5, "G91\n", "ok"),
        (1.0, "G1 X1\n", ""),
        (1.1, "M110 N4\n", "ok"),
        (2.0, &numbered(5, "G90"), "Error:checksum mismatch, Last Line: 4|Resend: 5|ok"),
        (2.1, &numbered(5, "G90"), "ok"),
        (3.0, "G1 X5\n", "echo:Unknown command: \"F1 X5\"|ok"),
        (4.0, "M114\n", "X:1.00 Y:0.00 Z:25.00 E:0.00 Count X:80 Y:0 Z:10000|ok"),
    ]);
}

#[test]
fn a_reboot_in_contact_loses_the_place_and_the_lines() {
    let faults = vec![at(41.0, MarlinFaultKind::Restart(Announced::Start))];
    let mut bench = MarlinBench::homed(MarlinBoard { faults, boot_s: Some(2.0), ..board() });
    assert_eq!(bench.send(40.0, "G91\nG1 Z-1 F30\nM400\n"), "ok|ok");
    assert_eq!(bench.hear(41.5), "");
    assert_eq!(bench.send(42.0, "M114\n"), "");
    let banner = bench.hear(43.0);
    assert!(banner.starts_with("start|Marlin 2.1.2||echo: Last Updated: "), "{banner}");
    assert!(banner.contains("|echo:  M92 X80.00 Y80.00 Z400.00 E500.00|"), "{banner}");
    let z_mm = bench.true_mm(Axis::Z, 50.0);
    assert!((-0.51..-0.49).contains(&z_mm), "{z_mm}");
    // G91 is lost, too, and z counts its home
    bench
        .script(&[(50.0, "M114\n", "X:0.00 Y:0.00 Z:25.00 E:0.00 Count X:0 Y:0 Z:10000|ok"), (51.0, "G1 Z26\n", "ok")]);
    assert!((bench.true_mm(Axis::Z, 55.0) - z_mm - 1.0).abs() < 1e-5);
}

#[test]
fn motors_without_current_are_counted_on() {
    let faults = vec![at(40.5, MarlinFaultKind::MotorsOff)];
    let mut bench = MarlinBench::homed(MarlinBoard { faults, slip_mm: [0.0, 0.0, -0.2], ..board() });
    bench.script(&[
        (40.0, "G91\nG1 X10 F600\n", "ok|ok"),
        (40.5, "M114\n", "X:22.50 Y:12.50 Z:12.50 E:0.00 Count X:1800 Y:1000 Z:5000|ok"),
    ]);
    let x_mm = bench.true_mm(Axis::X, 46.0);
    assert!((4.9..5.1).contains(&x_mm), "{x_mm}");
    assert_eq!(bench.true_mm(Axis::Z, 46.0), -0.2);
}

#[test]
fn each_form_of_a_restart_begins_with_its_bytes_and_ends_in_the_default_state() {
    for (announced, first) in [
        (Announced::Start, "start|Marlin 2.1.2||echo: Last Updated: "),
        (Announced::EchoStart, "echo:start|Marlin 2.1.2||echo: Last Updated: "),
        (Announced::Stray, "\0\u{7f}start|Marlin 2.1.2||echo: Last Updated: "),
        (Announced::Damaged, "sdart|Marlin 2.1.2||echo: Last Updated: "),
        (Announced::WithinAnswer, "ok T:start|Marlin 2.1.2||echo: Last Updated: "),
        (Announced::Cut, "sta"),
        (Announced::Silent, ""),
    ] {
        let mut bench = failing(MarlinFaultKind::Restart(announced));
        for line in [numbered(1, "G91"), numbered(2, "G20"), numbered(3, "G92 Z1")] {
            assert!(bench.say(39.0, &line).ends_with("ok"));
        }
        let heard = bench.hear(40.5);
        assert!(heard.starts_with(first), "{announced:?}: {heard}");
        assert_eq!(heard.contains("|echo:  M92 X80.00 "), first.contains('|'), "{announced:?}: {heard}");
        assert_eq!(bench.say(41.0, &numbered(4, "G1 Z-1")), RESENT, "{announced:?}");
        // it counts zero where it is, in mm, and moves to where it is sent
        bench.script(&[
            (42.0, "M114\n", UNHOMED),
            (43.0, "G1 Z26 F300\n", "ok"),
            (45.0, "M114\n", "X:0.00 Y:0.00 Z:26.00 E:0.00 Count X:0 Y:0 Z:10400|ok"),
        ]);
        assert_eq!(bench.true_mm(Axis::Z, 50.0), 1.0, "{announced:?}");
    }
}

#[test]
fn a_cut_announcement_is_on_the_line_of_the_next_answer() {
    let mut bench = failing(MarlinFaultKind::Restart(Announced::Cut));
    let mut heard = Vec::new();
    while let Owed::Ready(bytes) = bench.marlin.owed(&mut bench.scene, 40.0) {
        heard.extend(bytes);
    }
    heard.extend(bench.marlin.answer(b"M400", &mut bench.scene, 41.0));
    assert_eq!(heard, b"staok\n");
}

#[test]
fn a_restart_after_any_byte_loses_the_rest_of_its_line() {
    let sent = "G91\nG1 Z-1 F300\n";
    for bytes in 1..=sent.len() as u64 {
        let kind = MarlinFaultKind::Restart(Announced::Silent);
        let after = vec![MarlinFaultAfterBytes { bytes, kind }];
        let mut bench = MarlinBench::on(MarlinBoard { faults_after_bytes: after, boot_s: Some(0.5), ..board() });
        assert_eq!(bench.send(1.0, sent), if bytes > 4 { "ok" } else { "" }, "{bytes}");
        bench.script(&[(2.0, "M114\n", UNHOMED)]);
        assert_eq!(bench.true_mm(Axis::Z, 9.0), POWER_ON.z_mm, "{bytes}");
        // one that is ready at once takes the rest for a line
        let after = vec![MarlinFaultAfterBytes { bytes, kind }];
        let mut bench = MarlinBench::on(MarlinBoard { faults_after_bytes: after, ..board() });
        let heard = bench.send(1.0, sent);
        match bytes {
            4 => assert_eq!(heard, "ok"),
            5 => assert_eq!(heard, "ok|echo:Unknown command: \"1 Z-1 F300\"|ok"),
            16 => assert_eq!(heard, "ok"),
            _ => {}
        }
        assert_eq!(bench.say(9.0, &numbered(1, "M400")), "ok", "{bytes}");
    }
}

#[test]
fn an_ok_is_doubled() {
    failing(MarlinFaultKind::DoubledOk).script(&[
        (40.0, "M105\n", "ok T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0|ok T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0"),
        (40.1, "G90\n", "ok"),
    ]);
    failing(MarlinFaultKind::DoubledOk).script(&[(40.0, "G1 X13\n", "ok|ok"), (40.1, "G90\n", "ok")]);
}

#[test]
fn a_command_that_never_ends_is_busy_for_ever_and_only_a_kill_is_obeyed() {
    let mut bench = failing(MarlinFaultKind::Busy);
    assert_eq!(bench.send(40.0, "G1 Z12\n"), "");
    assert_eq!(bench.hear(50.5), ["echo:busy: processing"; 5].join("|"));
    assert_eq!(bench.send(51.0, "M114\n"), "");
    assert_eq!(bench.hear(100.5), ["echo:busy: processing"; 25].join("|"));
    assert_eq!(bench.true_mm(Axis::Z, 101.0), 0.0);
    assert_eq!(bench.send(101.0, "M112\n"), KILL);
    assert_eq!(bench.hear(200.0), "");
}

#[test]
fn an_emergency_parser_stops_at_once_whatever_waits() {
    let busy = vec![at(40.0, MarlinFaultKind::Busy)];
    let mut bench = MarlinBench::homed(MarlinBoard { emergency_parser: true, faults: busy, ..board() });
    assert!(bench.say(38.0, "M115\n").contains("|Cap:EMERGENCY_PARSER:1|"));
    assert_eq!(bench.say(39.5, "G1 X22.5 F600\n"), "ok");
    // the first of these never ends, and fills the buffers with the others
    assert_eq!(bench.send(40.0, &"M400\n".repeat(40)), "");
    assert_eq!(bench.send(40.5, &numbered(1, "M410")), "");
    assert!((9.9..10.0).contains(&bench.true_mm(Axis::X, 60.0)), "{}", bench.true_mm(Axis::X, 60.0));
    bench.hear(61.0);
    assert_eq!(bench.send(61.0, &numbered(2, "M112")), KILL);
    let mut bench = MarlinBench::homed(MarlinBoard { ok_after_resend: false, ..board() });
    assert_eq!(bench.say(40.0, &numbered(4, "G90")), RESENT.trim_end_matches("|ok"));
}

#[test]
fn counts_jump_and_nothing_moves() {
    let mut bench = failing(MarlinFaultKind::CountsJump([0, 0, -400]));
    assert_eq!(bench.say(39.0, "G1 Z12 F30\n"), "ok");
    bench.hear(39.5);
    // under way, too
    bench.script(&[(42.0, "M114\n", "X:12.50 Y:12.50 Z:11.00 E:0.00 Count X:1000 Y:1000 Z:4400|ok")]);
    assert_eq!(bench.true_mm(Axis::Z, 42.0), -0.5);
    bench.script(&[(43.0, "G1 Z11.5 F300\n", "ok")]);
    assert_eq!(bench.true_mm(Axis::Z, 45.0), 0.0);
}

#[test]
fn another_host_shares_modes_and_coordinates_and_gets_its_own_answers() {
    for (lines, ours, z_mm, counts) in [
        ("G92 Z0", "G1 Z-1 F300\n", -1.0, "Z:-1.00 E:0.00 Count X:1000 Y:1000 Z:4600"),
        ("G91", "G1 Z11.5 F300\n", 11.5, "Z:24.00 E:0.00 Count X:1000 Y:1000 Z:9600"),
        ("G20\nG91", "G1 Z-0.1 F10\n", -2.54, "Z:9.96 E:0.00 Count X:1000 Y:1000 Z:3984"),
        ("G91\nG1 Z-1 F300\nG90", "M400\n", -1.0, "Z:11.50 E:0.00 Count X:1000 Y:1000 Z:4600"),
        ("M290 Z-0.2", "M400\n", -0.2, "Z:12.50 E:0.00 Count X:1000 Y:1000 Z:5000"),
        ("G1 X20 F6000\nG1 X5\nG1 Z11.5\nG1 X12.5", "M400\n", -1.0, "Z:11.50 E:0.00 Count X:1000 Y:1000 Z:4600"),
    ] {
        let mut bench = failing(MarlinFaultKind::Other(lines));
        assert_eq!(bench.hear(40.0), "", "{lines}");
        assert_eq!(bench.say(40.1, ours), "ok", "{lines}");
        let text = bench.say(60.0, "M114\n");
        assert_eq!(text, format!("X:12.50 Y:12.50 {counts}|ok"), "{lines}");
        assert!((bench.true_mm(Axis::Z, 60.0) - z_mm).abs() < 1e-9, "{lines}: {}", bench.true_mm(Axis::Z, 60.0));
        // our lines are still counted on
        assert_eq!(bench.say(61.0, &numbered(1, "G21")), "ok", "{lines}");
    }
}

#[test]
fn another_host_kills_the_board_for_all() {
    let mut bench = failing(MarlinFaultKind::Other("M112"));
    assert_eq!(bench.say(39.9, "G1 X22.5 F600\n"), "ok");
    assert_eq!(bench.hear(40.7), KILL);
    assert_eq!(bench.send(41.0, "M114\n"), "");
    assert!((6.9..7.1).contains(&bench.true_mm(Axis::X, 60.0)), "{}", bench.true_mm(Axis::X, 60.0));
    let mut bench =
        MarlinBench::on(MarlinBoard { faults: vec![at(1.0, MarlinFaultKind::Other("M290 Z1"))], ..board() });
    // a stock build has no babysteps
    bench.hear(1.0);
    assert_eq!(bench.true_mm(Axis::Z, 5.0), POWER_ON.z_mm);
}
