//! Marlin, line by line.

mod faults;

use super::queue::RECEIVED_MOST;
use super::*;
use crate::emulator::tests::{POWER_ON, STIFFNESS_N_MM, Wire, scene, shared};
use palpate_core::quantity::Axis;
use palpate_link::time::Instant;
use proptest::prelude::*;

/// What [`board`] reports when it is switched on: its homes.
const UNHOMED: &str = "X:0.00 Y:0.00 Z:25.00 E:0.00 Count X:0 Y:0 Z:10000|ok";
/// What a stock printer reports then, and after homing.
const ZERO: &str = "X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0|ok";
const KILL: &str = "echo:M112 Shutdown|Error:Printer halted. kill() called!";

/// A frame whose middle is in the middle of the scene, where it counts 12.5. z homes up. Opening its port doesn't reset it.
fn board() -> MarlinBoard {
    MarlinBoard {
        min_ends_mm: [-12.5; 3],
        lengths_mm: [25.0; 3],
        homes_to_plus: [false, false, true],
        boot_s: None,
        ..MarlinBoard::default()
    }
}

fn at(from_s: f64, kind: MarlinFaultKind) -> MarlinFault {
    MarlinFault { from_s, kind }
}

/// A board and its scene, talked to at given times.
struct MarlinBench {
    marlin: MarlinEmulator,
    scene: Scene,
    /// When the last answer came, s.
    done_s: f64,
}

impl MarlinBench {
    fn new() -> Self {
        MarlinBench::on(board())
    }

    fn on(board: MarlinBoard) -> Self {
        let scene = scene();
        MarlinBench { marlin: MarlinEmulator::new(board, &scene), scene, done_s: 0.0 }
    }

    /// Homed, and in the middle by 30 s, where it counts 12.5.
    fn homed(board: MarlinBoard) -> Self {
        let mut bench = MarlinBench::on(board);
        bench.script(&[
            (1.0, "G28 Z\n", "echo:busy: processing|X:0.00 Y:0.00 Z:25.00 E:0.00 Count X:0 Y:0 Z:10000|ok"),
            (10.0, "G28 X Y\n", "X:0.00 Y:0.00 Z:25.00 E:0.00 Count X:0 Y:0 Z:10000|ok"),
            (20.0, "G1 X12.5 Y12.5 Z12.5 F3000\n", "ok"),
        ]);
        bench
    }

    /// What is answered to some bytes at once.
    fn send(&mut self, now_s: f64, sent: &str) -> String {
        let mut inbox = sent.as_bytes().to_vec();
        let mut reply = Vec::new();
        while let Some(request) = self.marlin.take_request(&mut inbox) {
            reply.extend(self.marlin.answer(&request, &mut self.scene, now_s));
        }
        lines(reply)
    }

    /// What comes until a time.
    fn hear(&mut self, until_s: f64) -> String {
        let mut reply = Vec::new();
        let mut at_s = 0.0;
        loop {
            match self.marlin.owed(&mut self.scene, at_s) {
                Owed::At(next_s) if next_s <= until_s => at_s = next_s,
                Owed::Ready(owed) => {
                    reply.extend(owed);
                    self.done_s = at_s;
                }
                _ => return lines(reply),
            }
        }
    }

    /// What is answered to some bytes; a command that has to wait is waited for.
    fn say(&mut self, now_s: f64, sent: &str) -> String {
        let mut reply = self.send(now_s, sent);
        self.done_s = now_s;
        while !self.marlin.commands.is_empty() && self.marlin.power == Power::Runs {
            let Owed::At(next_s) = self.marlin.owed(&mut self.scene, self.done_s) else { panic!("nothing comes") };
            let more = self.hear(next_s);
            self.done_s = next_s;
            reply = [reply, more].into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join("|");
        }
        reply
    }

    fn script(&mut self, steps: &[(f64, &str, &str)]) {
        for &(now_s, sent, answered) in steps {
            assert_eq!(self.say(now_s, sent), answered, "{sent:?} at {now_s} s");
        }
    }

    fn true_mm(&mut self, axis: Axis, now_s: f64) -> f64 {
        (self.scene.axis(axis, now_s).0 * 1e6).round() / 1e6
    }
}

/// Lines, with a bar for the end of each but the last.
fn lines(reply: Vec<u8>) -> String {
    let text = String::from_utf8(reply).expect("ASCII");
    text.strip_suffix('\n').unwrap_or(&text).replace('\n', "|")
}

fn numbered(number: i64, command: &str) -> String {
    let line = format!("N{number} {command}");
    let sum = line.bytes().fold(0, |sum, byte| sum ^ byte);
    format!("{line}*{sum}\n")
}

#[test]
fn a_board_that_is_switched_on_counts_zero_wherever_the_axes_are() {
    let mut bench = MarlinBench::on(MarlinBoard { homes_to_plus: [false; 3], ..board() });
    bench.script(&[(0.1, "M114\n", ZERO), (0.2, "G0 X1 ; right\n", "ok")]);
    assert_eq!(bench.true_mm(Axis::X, 5.0), POWER_ON.x_mm + 1.0);
}

#[test]
fn identification_and_settings_are_complete() {
    let mut bench = MarlinBench::new();
    let text = bench.say(0.1, "M115\n");
    assert!(text.starts_with("FIRMWARE_NAME:Marlin 2.1.2 ("), "{text}");
    assert!(text.contains("|Cap:EMERGENCY_PARSER:0|") && text.contains("|Cap:AUTOLEVEL:0|"), "{text}");
    assert!(text.ends_with("|ok"), "{text}");
    let settings = "echo:; Linear Units:|echo:  G21 ; (mm)|\
        echo:; Steps per unit:|echo:  M92 X80.00 Y80.00 Z400.00 E500.00|\
        echo:; Max feedrates (units/s):|echo:  M203 X300.00 Y300.00 Z5.00 E25.00|\
        echo:; Max Acceleration (units/s2):|echo:  M201 X3000.00 Y3000.00 Z100.00 E10000.00|\
        echo:; Acceleration (units/s2) (P<print-accel> R<retract-accel> T<travel-accel>):|\
        echo:  M204 P3000.00 R3000.00 T3000.00|\
        echo:; Advanced (B<min_segment_time_us> S<min_feedrate> T<min_travel_feedrate> J<junc_dev>):|\
        echo:  M205 B20000.00 S0.00 T0.00 J0.01|echo:; Home offset:|echo:  M206 X0.00 Y0.00 Z0.00|ok";
    bench.script(&[
        (0.2, "M503\n", settings),
        (0.3, "M203 Z4\nM201 X500 Y500\nM204 T400\n", "ok|ok|ok"),
        (0.4, "M203\n", "  M203 X300.00 Y300.00 Z4.00 E25.00|ok"),
        (0.4, "M201\n", "  M201 X500.00 Y500.00 Z100.00 E10000.00|ok"),
        (0.5, "M204\n", "  M204 P3000.00 R3000.00 T400.00|ok"),
        (0.6, "M92\n", "  M92 X80.00 Y80.00 Z400.00 E500.00|ok"),
        (0.7, "M105\n", "ok T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0"),
        (0.8, "M113\nM113 S5\nM113\n", "echo:M113 S2|ok|ok|echo:M113 S5|ok"),
    ]);
}

#[test]
fn a_line_is_a_command_or_is_unknown() {
    MarlinBench::new().script(&[
        (0.1, "G5 X1\n", "echo:Unknown command: \"G5 X1\"|ok"),
        (0.1, "hello\n", "echo:Unknown command: \"hello\"|ok"),
        (0.1, "g0 X1\n", "echo:Unknown command: \"g0 X1\"|ok"),
        (0.1, "M92 X100\n", "echo:Unknown command: \"M92 X100\"|ok"),
        (0.1, "M420 S1\n", "echo:Unknown command: \"M420 S1\"|ok"),
        (0.1, "G21\nM82\nM107\nT0\n", "ok|ok|ok|ok"),
        (0.1, "\r\n; nothing\r\n", ""),
        (0.1, "M114\n", UNHOMED),
    ]);
}

#[test]
fn numbered_lines_need_their_checksum_and_follow_each_other() {
    let mut bench = MarlinBench::new();
    bench.script(&[
        (0.1, &numbered(1, "G91"), "ok"),
        (0.2, "N2 G90*1\n", "Error:checksum mismatch, Last Line: 1|Resend: 2|ok"),
        (0.3, "N2 G90\n", "Error:No Checksum with line number, Last Line: 1|Resend: 2|ok"),
        (0.4, &numbered(4, "G90"), "Error:Line Number is not Last Line Number+1, Last Line: 1|Resend: 2|ok"),
        (0.5, &numbered(2, "G90"), "ok"),
        (0.6, &numbered(0, "M110 N41"), "ok"),
        (0.7, &numbered(42, "G5"), "echo:Unknown command: \"G5\"|ok"),
        (0.8, "M110 N7\n", "ok"),
        (0.9, &numbered(8, "G90"), "ok"),
        // what was received with a refused line is lost
        (1.0, "N9 G90*1\nM114\nM11", "Error:checksum mismatch, Last Line: 8|Resend: 9|ok"),
        (1.1, "M114\n", UNHOMED),
    ]);
}

#[test]
fn motions_are_answered_at_once_and_the_end_of_the_queue_is_reported() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[
        (40.0, "G1 X22.5 Z11.5 F600\n", "ok"),
        (40.5, "M114\n", "X:22.50 Y:12.50 Z:11.50 E:0.00 Count X:1394 Y:1000 Z:4803|ok"),
        (40.6, "M400\n", "ok"),
    ]);
    // 10.05 mm at 10 mm/s, and 0.01 s for the ramps of 1005 mm/s^2 along the line
    assert!((bench.done_s - 41.015).abs() < 0.001, "{}", bench.done_s);
    bench.script(&[(42.0, "M114\n", "X:22.50 Y:12.50 Z:11.50 E:0.00 Count X:1800 Y:1000 Z:4600|ok")]);
    assert_eq!([bench.true_mm(Axis::X, 42.0), bench.true_mm(Axis::Z, 42.0)], [10.0, -1.0]);
    assert!((bench.scene.load_cell_n(42.0) - STIFFNESS_N_MM).abs() < 1e-9);
}

#[test]
fn distances_are_absolute_or_incremental_and_the_feed_stays() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[
        (40.0, "G91\nG1 X1 Y-1 F300 E2\nG90\nG0 Y12.5\n", "ok|ok|ok|ok"),
        (40.0, "M400\n", "ok"),
        (50.0, "M114\n", "X:13.50 Y:12.50 Z:12.50 E:0.00 Count X:1080 Y:1000 Z:5000|ok"),
        (60.0, "G0 Z13.5\n", "ok"),
        (60.0, "M400\n", "ok"),
    ]);
    // z has at most 5 mm/s and 100 mm/s^2, and the feed is 5 mm/s
    assert!((bench.done_s - 60.25).abs() < 1e-6, "{}", bench.done_s);
    bench.script(&[(70.0, "G0 Z12.5 F6000\n", "ok"), (70.0, "M400\n", "ok")]);
    assert!((bench.done_s - 70.25).abs() < 1e-6, "{}", bench.done_s);
    bench.script(&[(75.0, "M220\n", "FR:100%|ok"), (80.0, "G0 Z13.5 F300\nM220 S50\nG0 Z12.5\nM400\n", "ok|ok|ok|ok")]);
    assert!((bench.done_s - 80.25 - 0.425).abs() < 1e-6, "{}", bench.done_s);
    bench.script(&[(90.0, "M220 S100\nM204 T100\nG1 X3.5 F600\nM18\n", "ok|ok|ok|ok")]);
    // M18 waits: 10 mm at 10 mm/s with 100 mm/s^2
    assert!((bench.done_s - 91.1).abs() < 1e-6, "{}", bench.done_s);
}

#[test]
fn targets_are_whole_steps() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[
        (40.0, "G1 X13.007 Z12.5988\n", "ok"),
        (45.0, "M114\n", "X:13.01 Y:12.50 Z:12.60 E:0.00 Count X:1041 Y:1000 Z:5040|ok"),
    ]);
    assert_eq!([bench.true_mm(Axis::X, 45.0), bench.true_mm(Axis::Z, 45.0)], [0.5125, 0.1]);
}

#[test]
fn fewer_than_six_steps_are_reported_but_made_with_the_next_motion() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[
        (40.0, "G91\nG1 Z-0.0125\nM400\n", "ok|ok|ok"),
        (41.0, "M114\n", "X:12.50 Y:12.50 Z:12.49 E:0.00 Count X:1000 Y:1000 Z:5000|ok"),
        (42.0, "G1 Z-0.0025\n", "ok"),
        (43.0, "M114\n", "X:12.50 Y:12.50 Z:12.49 E:0.00 Count X:1000 Y:1000 Z:4994|ok"),
        // the other axes' steps count, too
        (44.0, "G1 Z-0.0125\nG1 X0.1\n", "ok|ok"),
        (45.0, "M114\n", "X:12.60 Y:12.50 Z:12.47 E:0.00 Count X:1008 Y:1000 Z:4989|ok"),
        // what sets the coordinates forgets them
        (46.0, "G1 Z-0.0125\nG28 X\n", "ok|X:0.00 Y:12.50 Z:12.46 E:0.00 Count X:0 Y:1000 Z:4984|ok"),
    ]);
    assert_eq!(bench.true_mm(Axis::Z, 60.0), -11.0 / 400.0);
    let mut bench = MarlinBench::homed(MarlinBoard { least_steps: 1, ..board() });
    bench.script(&[(40.0, "G1 Z12.4975\n", "ok")]);
    assert_eq!(bench.true_mm(Axis::Z, 41.0), -0.0025);
}

#[test]
fn a_full_queue_delays_the_ok() {
    let mut bench = MarlinBench::homed(board());
    for n in 0..15 {
        assert_eq!(bench.send(40.0, &format!("G1 X{} F600\n", 12 + n % 2)), "ok");
    }
    assert_eq!(bench.send(40.0, "G1 Y13\n"), "");
    assert_eq!(bench.say(40.01, "M114\n").matches("ok").count(), 2);
    // the first is 0.5 mm at 10 mm/s and 3000 mm/s^2
    assert!((bench.done_s - 40.0533).abs() < 0.001, "{}", bench.done_s);
    assert_eq!(bench.say(40.1, "M400\n"), "ok");
    assert_eq!(bench.true_mm(Axis::Y, bench.done_s), 0.5);
}

#[test]
fn a_long_wait_is_filled_with_busy() {
    let mut bench = MarlinBench::homed(board());
    assert_eq!(bench.send(40.0, "G1 X22.5 F120\nM400\n"), "ok");
    assert_eq!(bench.hear(41.99), "");
    assert_eq!(bench.hear(44.5), "echo:busy: processing|echo:busy: processing");
    assert_eq!(bench.hear(46.0), "ok");
    bench.script(&[
        (50.0, "G4 S2.5\n", "echo:busy: processing|ok"),
        (60.0, "G1 X12.5 F600\nG4 P500\nM113 S0\nG4 S9\n", "ok|ok|ok|ok"),
    ]);
    assert!((bench.done_s - 70.503).abs() < 0.001, "{}", bench.done_s);
}

#[test]
fn lines_that_find_no_room_are_lost() {
    let mut bench = MarlinBench::new();
    // four commands, 127 bytes behind them
    assert_eq!(bench.send(1.0, &"G4 S1\n".repeat(40)), "");
    let text = bench.say(1.5, "");
    assert_eq!(text.matches("ok").count(), 4 + 21);
    // a refused line takes those behind it along
    let mut bench = MarlinBench::new();
    assert_eq!(bench.send(1.0, &format!("{}N9 G90*1\nM114\n", "G4 S1\n".repeat(4))), "");
    let refused = "Error:Line Number is not Last Line Number+1, Last Line: 0|Resend: 1|ok";
    assert_eq!(bench.say(1.0, ""), format!("ok|{refused}|ok|ok|ok"));
}

#[test]
fn homing_takes_x_y_and_then_z_toward_the_bed() {
    let mut bench = MarlinBench::on(MarlinBoard { homes_to_plus: [false; 3], ..board() });
    assert_eq!(bench.send(1.0, "G91\nG28\n"), "ok");
    assert!(bench.scene.motion(Axis::X).moving(1.1) && bench.true_mm(Axis::Y, 1.1) == POWER_ON.y_mm);
    let text = bench.say(1.1, "");
    assert_eq!(text.replace("echo:busy: processing|", ""), ZERO);
    assert!(bench.done_s > 6.0 && bench.done_s < 12.0, "{}", bench.done_s);
    assert_eq!(Axis::ALL.map(|axis| bench.true_mm(axis, 20.0)), [-12.5; 3]);
    // G28 doesn't end G91
    bench.script(&[
        (20.0, "G1 Z1\nG1 Z1\n", "ok|ok"),
        (25.0, "M114\n", "X:0.00 Y:0.00 Z:2.00 E:0.00 Count X:0 Y:0 Z:800|ok"),
    ]);
}

#[test]
fn software_endstops_limit_axes_that_were_homed() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[
        (40.0, "G1 X99 Y-99\n", "ok"),
        (45.0, "M114\n", "X:25.00 Y:0.00 Z:12.50 E:0.00 Count X:2000 Y:0 Z:5000|ok"),
        (46.0, "M211\n", "  M211 S1 ; ON|  Min:  X0.00 Y0.00 Z0.00   Max:  X25.00 Y25.00 Z25.00|ok"),
        // without them a motor stalls at the end, and its steps are counted
        (47.0, "M211 S0\nG1 X26\n", "ok|ok"),
        (55.0, "M114\n", "X:26.00 Y:0.00 Z:12.50 E:0.00 Count X:2080 Y:0 Z:5000|ok"),
        (56.0, "G1 X25\n", "ok"),
    ]);
    assert_eq!(bench.true_mm(Axis::X, 60.0), 11.5);
    let mut bench = MarlinBench::new();
    bench.script(&[
        (1.0, "G1 X-5\n", "ok"),
        (5.0, "M114\n", &UNHOMED.replace("X:0.00", "X:-5.00").replace("X:0 ", "X:-400 ")),
    ]);
    assert_eq!(bench.true_mm(Axis::X, 6.0), POWER_ON.x_mm - 5.0);
}

#[test]
fn g92_changes_the_coordinates_and_no_step() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[
        (40.0, "G92 X0 Z100\n", "X:0.00 Y:12.50 Z:100.00 E:0.00 Count X:1000 Y:1000 Z:5000|ok"),
        (41.0, "G1 X1 Z99\n", "ok"),
        (45.0, "M114\n", "X:1.00 Y:12.50 Z:99.00 E:0.00 Count X:1080 Y:1000 Z:4600|ok"),
        (46.0, "M211\n", "  M211 S1 ; ON|  Min:  X-12.50 Y0.00 Z87.50   Max:  X12.50 Y25.00 Z112.50|ok"),
        (47.0, "G28 X\n", "X:0.00 Y:12.50 Z:99.00 E:0.00 Count X:0 Y:1000 Z:4600|ok"),
    ]);
}

#[test]
fn a_motion_from_a_new_zero_is_the_same_in_every_mode() {
    for (inches, before) in
        [(false, "G90\n"), (false, "G91\n"), (false, "G92 Z-30\n"), (true, "G20\n"), (true, "G20\nG91\nG92 Z2\n")]
    {
        let mut bench = MarlinBench::homed(MarlinBoard { inches, ..board() });
        bench.say(40.0, before);
        bench.say(41.0, "G21\nG92 X0 Y0 Z0\nG1 Z-0.5 F300\nM400\n");
        assert_eq!(bench.true_mm(Axis::Z, 45.0), -0.5, "{before}");
        let counts = bench.say(45.0, "M114\n");
        assert_eq!(counts, "X:0.00 Y:0.00 Z:-0.50 E:0.00 Count X:1000 Y:1000 Z:4800|ok", "{before}");
    }
}

#[test]
fn a_place_just_below_zero_has_a_sign() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[
        (40.0, "G92 Z0.001\nG1 Z-0.001\n", "X:12.50 Y:12.50 Z:0.00 E:0.00 Count X:1000 Y:1000 Z:5000|ok|ok"),
        (41.0, "M114\n", "X:12.50 Y:12.50 Z:-0.00 E:0.00 Count X:1000 Y:1000 Z:5000|ok"),
    ]);
}

#[test]
fn inches_scale_ways_and_feeds_of_a_build_that_knows_them_and_reports_stay_in_mm() {
    let mut bench = MarlinBench::homed(MarlinBoard { inches: true, ..board() });
    bench.script(&[
        (
            40.0,
            "G20\nG91\nG1 X-0.1 F10\nG92 Y1\n",
            "ok|ok|ok|X:9.96 Y:25.40 Z:12.50 E:0.00 Count X:1000 Y:1000 Z:5000|ok",
        ),
        (40.0, "M400\n", "ok"),
    ]);
    // 203 steps at 4.233 mm/s
    assert!((bench.done_s - 40.6008).abs() < 1e-3, "{}", bench.done_s);
    assert_eq!(bench.true_mm(Axis::X, 42.0), -203.0 / 80.0);
    assert!(bench.say(42.0, "M503\n").contains("|echo:  G20 ; (in)|"));
    MarlinBench::homed(board()).script(&[(40.0, "G20\n", "echo:Unknown command: \"G20\"|ok")]);
}

#[test]
fn a_build_without_workspace_offsets_counts_its_steps_anew() {
    let mut bench = MarlinBench::homed(MarlinBoard { workspace_offsets: false, ..board() });
    bench.script(&[
        (40.0, "G92 Z0\n", "X:12.50 Y:12.50 Z:0.00 E:0.00 Count X:1000 Y:1000 Z:0|ok"),
        // its end of z is at 0
        (41.0, "G1 Z-1\n", "ok"),
        (45.0, "M114\n", "X:12.50 Y:12.50 Z:0.00 E:0.00 Count X:1000 Y:1000 Z:0|ok"),
        (46.0, "G1 Z1\n", "ok"),
    ]);
    assert_eq!(bench.true_mm(Axis::Z, 50.0), 1.0);
}

#[test]
fn z_follows_the_bed_while_levelling_is_on() {
    let mut bench = MarlinBench::homed(MarlinBoard { bed_rise: Some([0.01, 0.0]), ..board() });
    assert!(bench.say(38.0, "M115\n").contains("|Cap:AUTOLEVEL:1|"));
    assert!(bench.say(39.0, "M503\n").contains("|echo:; Auto Bed Leveling:|echo:  M420 S0 Z0.00 ; Leveling OFF|"));
    bench.script(&[
        (
            40.0,
            "M420 S1\n",
            "echo:Bed Leveling ON|echo:Fade Height OFF|X:12.50 Y:12.50 Z:12.38 E:0.00 Count X:1000 Y:1000 Z:5000|ok",
        ),
        (41.0, "G1 X22.5\n", "ok"),
        (45.0, "M114\n", "X:22.50 Y:12.50 Z:12.38 E:0.00 Count X:1800 Y:1000 Z:5040|ok"),
    ]);
    assert_eq!(bench.true_mm(Axis::Z, 45.0), 0.1);
    bench.script(&[
        (46.0, "M420 S1\n", "echo:Bed Leveling ON|echo:Fade Height OFF|ok"),
        (
            47.0,
            "M420 S0\n",
            "echo:Bed Leveling OFF|echo:Fade Height OFF|X:22.50 Y:12.50 Z:12.60 E:0.00 Count X:1800 Y:1000 Z:5040|ok",
        ),
        (48.0, "G1 X12.5 F600\n", "ok"),
        (
            48.0,
            "M420 S1\n",
            "echo:Bed Leveling ON|echo:Fade Height OFF|X:12.50 Y:12.50 Z:12.48 E:0.00 Count X:1000 Y:1000 Z:5040|ok",
        ),
    ]);
    assert_eq!(bench.true_mm(Axis::Z, 50.0), 0.1);
}

#[test]
fn motors_are_switched_off_by_command_and_after_a_time_without_motion() {
    let slips = MarlinBoard { slip_mm: [0.0, 0.0, -0.5], ..board() };
    let mut bench = MarlinBench::homed(slips.clone());
    let rests = |bench: &mut MarlinBench, from_s: f64, to_s: f64| {
        bench.hear(from_s);
        let before_mm = bench.true_mm(Axis::Z, from_s);
        bench.hear(to_s);
        bench.true_mm(Axis::Z, to_s + 1.0) - before_mm
    };
    bench.script(&[(40.0, "G1 X13\n", "ok")]);
    assert_eq!(rests(&mut bench, 159.0, 161.0), -0.5);
    // it isn't counted, and happens once
    bench.script(&[(200.0, "M114\n", "X:13.00 Y:12.50 Z:12.50 E:0.00 Count X:1040 Y:1000 Z:5000|ok")]);
    bench.script(&[(200.0, "M17\n", "ok")]);
    assert_eq!(rests(&mut bench, 200.0, 600.0), 0.0);
    bench.script(&[(600.0, "G1 Z13.5\n", "ok"), (610.0, "M84 X Y\n", "ok")]);
    assert_eq!(bench.true_mm(Axis::Z, 620.0), 0.5);
    bench.script(&[(620.0, "M18\n", "ok")]);
    assert_eq!(bench.true_mm(Axis::Z, 622.0), 0.0);
    bench.script(&[(630.0, "M17 Z\n", "ok"), (640.0, "M84 S0\n", "ok")]);
    assert_eq!(rests(&mut bench, 640.0, 9000.0), 0.0);
    bench.script(&[(9000.0, "M84 S10\n", "ok")]);
    assert_eq!(rests(&mut bench, 9009.9, 9010.1), -0.5);
}

#[test]
fn a_quick_stop_has_no_ramp_and_takes_its_turn_if_it_has_a_number() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[(40.0, "G91\nG1 X10 F6000\nM400\n", "ok|ok|ok"), (45.0, "G1 X-10 F1200\n", "ok")]);
    // it acts while M400 waits, and once more as a command
    assert_eq!(bench.send(45.1, "M400\n"), "");
    assert_eq!(bench.say(45.2, "M410\n"), "ok|ok");
    assert_eq!(bench.done_s, 47.2);
    let text = bench.say(48.0, "M114\n");
    assert_eq!(text, "X:18.56 Y:12.50 Z:12.50 E:0.00 Count X:1485 Y:1000 Z:5000|ok");
    // from 20 mm/s with four times 3000 mm/s^2
    assert_eq!(bench.true_mm(Axis::X, 48.0), 6.05);
    let mut bench = MarlinBench::homed(board());
    assert_eq!(bench.send(40.0, "G91\nG1 X10 F600\nM400\n"), "ok|ok");
    assert_eq!(bench.say(40.5, &numbered(1, "M410")), "ok|ok");
    assert_eq!(bench.true_mm(Axis::X, 60.0), 10.0);
}

#[test]
fn a_kill_lets_the_motors_step_on_for_a_moment_and_then_answers_nothing() {
    let mut bench = MarlinBench::homed(board());
    bench.script(&[(40.0, "G91\nG1 X10 F600\n", "ok|ok"), (40.2, "M112\n", KILL), (40.3, "M114\nM112\n", "")]);
    bench.hear(60.0);
    let x_mm = bench.true_mm(Axis::X, 60.0);
    assert!((7.97..8.01).contains(&x_mm), "{x_mm}");
    bench.script(&[(61.0, "M105\n", "")]);
    // with a number it waits for its turn
    let mut bench = MarlinBench::homed(board());
    assert_eq!(bench.send(40.0, "G91\nG1 X10 F600\nM400\n"), "ok|ok");
    assert_eq!(bench.say(40.2, &numbered(1, "M112")), format!("ok|{KILL}"));
    assert!(bench.done_s > 41.0);
}

#[test]
fn a_search_for_home_that_is_stopped_kills() {
    let mut bench = MarlinBench::new();
    assert_eq!(bench.send(1.0, "G28\n"), "");
    let text = bench.say(1.2, "M410\n");
    assert!(text.ends_with("echo:Homing Failed|Error:Printer halted. kill() called!"), "{text}");
}

#[test]
fn temperatures_are_reported_when_asked_for_and_by_a_fault() {
    let report = "T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0";
    let mut bench = MarlinBench::new();
    bench.script(&[(1.0, "M155 S2\n", "ok")]);
    assert_eq!(bench.hear(5.5), format!(" {report}| {report}"));
    bench.script(&[(6.0, "M155 S0\n", "ok")]);
    assert_eq!(bench.hear(60.0), "");
    let mut bench =
        MarlinBench::on(MarlinBoard { faults: vec![at(3.0, MarlinFaultKind::Chatter { every_s: 0.4 })], ..board() });
    assert_eq!(bench.hear(3.5), format!(" {report}| {report}"));
    assert_eq!(bench.send(3.9, "M114\n"), format!(" {report}|{UNHOMED}"));
}

#[tokio::test(start_paused = true)]
async fn opening_the_port_resets_the_board() {
    let scene = shared(scene());
    let board = MarlinBoard { boot_s: Some(2.0), ..board() };
    let marlin = shared(MarlinEmulator::new(board, &scene.lock().expect("a scene")));
    let origin = Instant::now();
    let mut wire = Wire::to(marlin.clone(), scene.clone(), origin);
    wire.send(b"M114\n").await;
    assert!(wire.is_silent().await);
    assert_eq!(wire.ask(b"", 19).await, b"start\nMarlin 2.1.2\n");
    let took_s = origin.elapsed().as_secs_f64();
    assert!((1.99..2.02).contains(&took_s), "{took_s}");
    drop(wire);
    let mut again = Wire::to(marlin, scene, origin);
    assert!(again.is_silent().await);
    assert_eq!(again.ask(b"", 6).await, b"start\n");
}

proptest! {
    #[test]
    fn emulator_survives_arbitrary_bytes_in_bounded_memory(pieces in prop::collection::vec(
        prop_oneof![
            prop::collection::vec(any::<u8>(), 0..30),
            "G[0-9]{1,2}( [XYZEFPS]-?[0-9.]{0,5}){0,4}\n".prop_map(String::into_bytes),
            "(N[0-9] )?M[0-9]{1,3}( [XYZEFPS]-?[0-9.]{0,3}){0,3}(\\*[0-9]{1,2})?\n".prop_map(String::into_bytes),
            prop::sample::select(vec!["G28\n", "M18\n", "M410\n", "G91\n"]).prop_map(|text| text.as_bytes().to_vec()),
        ],
        0..40,
    )) {
        let mut bench = MarlinBench::on(MarlinBoard { bed_rise: Some([0.01, -0.01]), ..board() });
        for (n, piece) in pieces.into_iter().enumerate() {
            let now_s = 1.0 + n as f64;
            let mut inbox = piece;
            while let Some(request) = bench.marlin.take_request(&mut inbox) {
                bench.marlin.answer(&request, &mut bench.scene, now_s);
            }
            prop_assert!(bench.marlin.received.iter().map(String::len).sum::<usize>() < RECEIVED_MOST);
            for axis in Axis::ALL {
                let place_mm = bench.true_mm(axis, now_s);
                prop_assert!(place_mm.abs() <= 12.5 + 1e-6, "{axis:?} at {place_mm}");
            }
        }
    }
}
