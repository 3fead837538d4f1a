//! GRBL, line by line.

mod faults;

use super::settings::BoardSettings;
use super::*;
use crate::emulator::tests::{POWER_ON, STIFFNESS_N_MM, Wire, scene, scene_with, shared};
use crate::scene::Servo;
use palpate_core::quantity::Axis;
use palpate_link::time::Instant;
use proptest::prelude::*;
use std::time::Duration;

const UNLOCK: &str = "[MSG:'$H'|'$X' to unlock]";

/// Where the middle of the frame counts after homing, mm; it is at 0 in the scene.
const MIDDLE_MM: f64 = -12.5;

/// A frame whose middle is in the middle of the scene. Its port is open.
fn board() -> MotionBoard {
    MotionBoard { plus_ends_mm: [12.5; 3], ..MotionBoard::default() }
}

/// A controller and its scene, talked to at given times.
struct GrblBench {
    grbl: GrblEmulator,
    scene: Scene,
    /// When the last answer came that was owed, s.
    done_s: f64,
}

impl GrblBench {
    fn new() -> Self {
        GrblBench::on(scene())
    }

    fn on(scene: Scene) -> Self {
        GrblBench { grbl: GrblEmulator::new(board(), &scene), scene, done_s: 0.0 }
    }

    /// Homed by 20 s, and back in the middle by 30 s, which is then zero in work coordinates.
    fn homed() -> Self {
        GrblBench::homed_on(scene())
    }

    fn homed_on(scene: Scene) -> Self {
        let mut bench = GrblBench::on(scene);
        bench.script(&[
            (0.0, "$H\n", "ok"),
            (20.0, "G0X-12.5Y-12.5Z-12.5\n", "ok"),
            (30.0, "G92X0Y0Z0\n", "ok"),
            (30.0, "?", "<Idle|MPos:-12.500,-12.500,-12.500|FS:0,0|WCO:-12.500,-12.500,-12.500>"),
        ]);
        bench
    }

    /// What is answered to some bytes at once. None of them may be left over.
    fn send(&mut self, now_s: f64, sent: &[u8]) -> String {
        let mut inbox = sent.to_vec();
        let mut reply = Vec::new();
        while let Some(request) = self.grbl.take_request(&mut inbox) {
            reply.extend(self.grbl.answer(&request, &mut self.scene, now_s));
        }
        assert!(inbox.is_empty());
        String::from_utf8(reply).expect("ASCII")
    }

    /// What is answered to some bytes; a line that has to wait is waited for.
    fn say(&mut self, now_s: f64, sent: &[u8]) -> String {
        let mut reply = self.send(now_s, sent);
        let mut at_s = now_s;
        loop {
            match self.grbl.owed(&mut self.scene, at_s) {
                Owed::Nothing | Owed::HungUp => break,
                Owed::At(next_s) => at_s = next_s.max(at_s),
                Owed::Ready(owed) | Owed::Pushed(owed) => {
                    reply += &String::from_utf8(owed).expect("ASCII");
                    self.done_s = at_s;
                }
            }
        }
        reply.strip_suffix("\r\n").unwrap_or(&reply).replace("\r\n", " ")
    }

    fn script(&mut self, steps: &[(f64, &str, &str)]) {
        for &(now_s, sent, answered) in steps {
            // real-time bytes above ASCII are written as Latin-1
            let bytes: Vec<u8> = sent.chars().map(|char| char as u32 as u8).collect();
            assert_eq!(self.say(now_s, &bytes), answered, "{sent:?} at {now_s} s");
        }
    }

    /// The state's name and the work coordinates, if the middle is their zero.
    fn state(&mut self, now_s: f64) -> (String, [f64; 3]) {
        let report = self.say(now_s, b"?");
        let mut fields = report.trim_matches(['<', '>']).split('|');
        let state = fields.next().expect("a state").to_owned();
        let places = fields.next().and_then(|field| field.strip_prefix("MPos:")).expect("a place");
        let mut places = places.split(',').map(|place| place.parse::<f64>().expect("a number") - MIDDLE_MM);
        (state, std::array::from_fn(|_| places.next().expect("three")))
    }

    fn true_mm(&mut self, axis: Axis, now_s: f64) -> f64 {
        self.scene.axis(axis, now_s).0
    }
}

#[test]
fn board_is_locked_at_power_on_and_after_reset() {
    GrblBench::new().script(&[
        (0.1, "\x18", &format!(" Grbl 1.1h ['$' for help] {UNLOCK}")),
        (0.2, "?", "<Alarm|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"),
        (0.3, "?", "<Alarm|MPos:0.000,0.000,0.000|FS:0,0|Ov:100,100,100>"),
        (0.4, "?", "<Alarm|MPos:0.000,0.000,0.000|FS:0,0>"),
        (0.5, "G0X1\n", "error:9"),
        (0.5, "$J=X1F100\n", "error:8"),
        (0.6, "\r\n", "ok ok"),
        (0.7, "$X\n", "[MSG:Caution: Unlocked] ok"),
        (0.8, "$X\n", "ok"),
        (0.9, "\x18", " Grbl 1.1h ['$' for help]"),
    ]);
}

#[test]
fn identification_lines_are_complete() {
    GrblBench::homed().script(&[
        (40.1, "$G\n", "[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0] ok"),
        (40.2, "$i\n", "[VER:1.1h.20190825:] [OPT:V,15,128] ok"),
        (40.4, "g91 g21 (mm) f25\n", "ok"),
        (40.5, "$G\n", "[GC:G0 G54 G17 G21 G91 G94 M5 M9 T0 F25 S0] ok"),
        (40.6, "G92X-1\n", "ok"),
        (40.7, "?", "<Idle|MPos:-12.500,-12.500,-12.500|FS:0,0|WCO:-11.500,-12.500,-12.500>"),
        (40.9, "?", "<Idle|MPos:-12.500,-12.500,-12.500|FS:0,0|Ov:100,100,100>"),
    ]);
    let mut bench = GrblBench::homed();
    let parameters = bench.say(40.0, b"$#\n");
    assert_eq!(parameters.matches(":0.000,0.000,0.000").count(), 9);
    assert!(parameters.starts_with("[G54:") && parameters.ends_with("[TLO:0.000] [PRB:0.000,0.000,0.000:0] ok"));
    let text = bench.say(40.0, b"$$\n");
    assert!(text.starts_with("$0=10 $1=255 ") && text.ends_with(" $131=25.000 $132=25.000 ok"), "{text}");
}

#[test]
fn impossible_line_is_refused_with_its_code_without_motion() {
    for (sent, code) in [
        ("5", 1),
        ("X", 2),
        ("$C", 3),
        ("$Jog", 16),
        ("$7=1", 3),
        ("$N", 3),
        ("$130=-1", 4),
        ("$99=1", 3),
        ("$13=x", 2),
        ("G1X1F-1", 4),
        ("G0X1111111111111111111111111111111111111111111111111111111111111111111111111111111111", 11),
        ("$J=X12.6F100", 15),
        ("$J=G91Z-12.501F100", 15),
        ("$J", 16),
        ("$J=G1X1F100", 16),
        ("G2X1", 20),
        ("$J=G92X1F100", 16),
        ("$J=X1", 22),
        ("G1X1", 22),
        ("$J=F100", 26),
    ] {
        let mut bench = GrblBench::homed();
        let answer = bench.say(40.0, format!("{sent}\n").as_bytes());
        assert_eq!(answer.trim_start_matches("ok "), format!("error:{code}"), "{sent}");
        assert_eq!(bench.state(50.0), ("Idle".into(), [0.0; 3]), "{sent} moved something");
    }
}

#[test]
fn homing_takes_z_first_and_makes_the_count_true() {
    let mut bench = GrblBench::new();
    assert_eq!(bench.say(1.0, b"$H\n"), "ok");
    let end_s = bench.done_s;
    assert!(end_s > 4.0 && end_s < 10.0, "{end_s}");
    assert_eq!(bench.state(end_s), ("Idle".into(), [12.0; 3]));
    for axis in Axis::ALL {
        assert!((bench.true_mm(axis, end_s) - 12.0).abs() < 1e-9);
    }
    let mut bench = GrblBench::new();
    bench.send(1.0, b"$H\n");
    assert_eq!(bench.true_mm(Axis::X, 1.4), POWER_ON.x_mm, "x waits for z");
    assert_eq!(bench.true_mm(Axis::Z, 1.56), 12.5);
    assert_eq!(bench.say(1.8, b""), "ok");
    assert_eq!(bench.state(20.0).1, [12.0; 3]);
}

#[test]
fn jogs_move_straight_and_are_done_when_idle() {
    let mut bench = GrblBench::homed();
    bench.script(&[
        (40.0, "$J=G91X3Y-4F600\n", "ok"),
        (40.25, "?", "<Jog|MPos:-11.240,-14.180,-12.500|FS:600,0|Ov:100,100,100>"),
        (40.26, "G0X0\n", "error:9"),
        (40.27, "$110=1\n", "error:8"),
    ]);
    // 5 mm at 10 mm/s, and 0.08 s for the ramps: no axis harder than 100 mm/s^2 is 125 along the line
    assert_eq!(bench.state(40.57).0, "Jog");
    assert_eq!(bench.state(40.59), ("Idle".into(), [3.0, -4.0, 0.0]));
    assert_eq!(bench.say(41.0, b"$J=G53Z-12.75F60\n"), "ok");
    assert!((bench.scene.load_cell_n(45.0) - 0.25 * STIFFNESS_N_MM).abs() < 1e-9);
}

#[test]
fn an_incremental_jog_counts_from_the_end_of_the_queue_whatever_another_sender_set() {
    let mut bench = GrblBench::homed();
    bench.script(&[
        (40.0, "G20 G91\nG92Z5\nG10L20P1X1Y1\n", "ok ok ok"),
        (40.0, "$J=G91 G21 X1 Z-0.5 F300\n$J=G91 G21 X1 Z-0.5 F300\n", "ok ok"),
        (41.0, "$G\n", "[GC:G0 G54 G17 G20 G91 G94 M5 M9 T0 F0 S0] ok"),
    ]);
    assert_eq!(bench.state(50.0), ("Idle".into(), [2.0, 0.0, -1.0]));
    // beyond the soft limits it is refused as a whole
    bench.script(&[(50.0, "$J=G91G21X1Z-11.51F300\n", "error:15"), (50.1, "$J=G91G21Z-11.5F300\n", "ok")]);
    assert_eq!(bench.state(120.0), ("Idle".into(), [2.0, 0.0, -12.5]));
}

#[test]
fn a_jog_is_cancelled_with_what_follows_it_and_brakes() {
    let mut bench = GrblBench::homed();
    bench.script(&[(40.0, "$J=X10F600\n$J=X0F600\n", "ok ok"), (40.5, "\u{85}", "")]);
    // at 10 mm/s after 4.5 mm; 0.1 s and 0.5 mm to rest
    assert_eq!(bench.state(40.55), ("Jog".into(), [4.875, 0.0, 0.0]));
    assert_eq!(bench.state(40.61), ("Idle".into(), [5.0, 0.0, 0.0]));
    assert_eq!(bench.state(60.0).1, [5.0, 0.0, 0.0]);
    bench.script(&[(60.0, "\u{85}", ""), (60.1, "$J=X0F600\n", "ok")]);
}

#[test]
fn a_jog_sent_while_one_is_cancelled_waits_for_it() {
    let mut bench = GrblBench::homed();
    bench.script(&[(40.0, "$J=X10F600\n", "ok"), (40.5, "\u{85}$J=G91X-1F600\n", "ok")]);
    assert!((bench.done_s - 40.6).abs() < 1e-9);
    assert_eq!(bench.state(50.0), ("Idle".into(), [4.0, 0.0, 0.0]));
}

#[test]
fn real_time_bytes_in_the_midst_of_a_line_leave_it_whole() {
    let mut bench = GrblBench::homed();
    let answer = bench.say(40.0, b"$J=X?1\x91 F6~00\n");
    assert_eq!(answer, "<Idle|MPos:-12.500,-12.500,-12.500|FS:0,0|Ov:100,100,100> ok");
    assert_eq!(bench.state(42.0).1, [1.0, 0.0, 0.0]);
}

#[test]
fn a_full_planner_makes_further_lines_wait() {
    let mut bench = GrblBench::homed();
    for n in 0..machine::BLOCKS_MOST {
        assert_eq!(bench.say(40.0, format!("$J=X{}F600\n", (n + 1) % 2).as_bytes()), "ok");
        assert!(bench.done_s < 40.0);
    }
    assert_eq!(bench.say(40.0, b"$J=Y1F600\n"), "ok");
    // 1 mm at 10 mm/s is 0.2 s
    assert!((bench.done_s - 40.2).abs() < 1e-9);
    assert_eq!(bench.state(43.1).0, "Jog");
    assert_eq!(bench.state(43.3), ("Idle".into(), [1.0, 1.0, 0.0]));
}

#[test]
fn jogs_along_one_line_are_blended() {
    let mut bench = GrblBench::homed();
    for n in 0..5 {
        assert_eq!(bench.say(40.0 + 0.1 * f64::from(n), b"$J=G91X1F600\n"), "ok");
    }
    assert!(bench.say(40.45, b"?").contains("|FS:600,0"));
    assert_eq!(bench.state(40.61), ("Idle".into(), [5.0, 0.0, 0.0]));
}

#[test]
fn dwell_begins_after_the_motion() {
    let mut bench = GrblBench::homed();
    bench.script(&[(40.0, "G1X5F600\nG4P1.5\n", "ok ok")]);
    // 0.5 s and 0.1 s for the ramps
    assert!((bench.done_s - 42.1).abs() < 1e-9);
}

#[test]
fn single_bytes_act_while_a_line_waits() {
    // a dwell
    let mut bench = GrblBench::homed();
    assert_eq!(bench.send(40.0, b"G1X5F600\nG4P1.5\n"), "ok\r\n");
    assert!(bench.send(40.1, b"?").starts_with("<Run|"));
    assert_eq!(bench.send(40.2, b"$G\n"), "");
    assert!(bench.send(41.0, b"?").starts_with("<Idle|"));
    assert!(bench.say(41.5, b"").starts_with("ok [GC:"));
    // a full planner
    let mut bench = GrblBench::homed();
    for n in 0..machine::BLOCKS_MOST {
        bench.say(40.0, format!("$J=X{}F600\n", (n + 1) % 2).as_bytes());
    }
    assert_eq!(bench.send(40.0, b"$J=Y1F600\n"), "");
    assert!(bench.send(40.05, b"?").starts_with("<Jog|"));
    let text = bench.send(40.1, b"\x18");
    assert!(text.starts_with("ALARM:3\r\n") && !text.contains("ok"), "{text}");
    assert_eq!(bench.say(41.0, b"$X\n"), "[MSG:Caution: Unlocked] ok");
    assert_eq!(bench.true_mm(Axis::Y, 50.0), 0.0);
}

#[test]
fn a_reset_in_motion_loses_the_place() {
    let mut bench = GrblBench::homed();
    bench.script(&[
        (40.0, "$J=X10F1500\n", "ok"),
        (40.4, "\x18", &format!("ALARM:3  Grbl 1.1h ['$' for help] {UNLOCK}")),
    ]);
    let (state, places) = bench.state(45.0);
    let lost_mm = bench.true_mm(Axis::X, 45.0) - places[0];
    assert_eq!(state, "Alarm");
    // from 25 mm/s with four times 100 mm/s^2
    assert!((lost_mm - 0.78).abs() < 0.01, "{lost_mm}");
    bench.script(&[(46.0, "G0X0\n", "error:9"), (46.0, "$H\n", "ok")]);
    assert_eq!(bench.state(66.0).1, [12.0; 3]);
    assert!((bench.true_mm(Axis::X, 66.0) - 12.0).abs() < 1e-9);
    // at rest nothing is lost
    bench.script(&[(70.0, "\x18", " Grbl 1.1h ['$' for help]")]);
}

#[test]
fn a_line_beyond_the_travel_is_an_alarm_that_only_a_reset_ends() {
    let mut bench = GrblBench::homed();
    bench.script(&[
        (40.0, "G0X13\n", "ALARM:2 [MSG:Reset to continue]"),
        (40.1, "?$X\n\n", ""),
        (40.2, "\x18", &format!("ok  Grbl 1.1h ['$' for help] {UNLOCK}")),
        (40.3, "$X\n", "[MSG:Caution: Unlocked] ok"),
        (40.4, "G0X-11.5\n", "ok"),
    ]);
    assert_eq!((bench.state(50.0).1, bench.true_mm(Axis::X, 50.0)), ([1.0, 0.0, 0.0], 1.0));
}

#[test]
fn an_end_of_the_frame_stops_what_is_not_homed() {
    let settings = BoardSettings::default().with(MotionBoard::SOFT_LIMITS, 0.0);
    let scene = scene();
    let mut bench =
        GrblBench { grbl: GrblEmulator::new(MotionBoard { settings, ..board() }, &scene), scene, done_s: 0.0 };
    // z is at true 8, counted 0: count 10 would be true 18
    bench.script(&[(0.0, "$X\nG0Z10\n", "[MSG:Caution: Unlocked] ok ok")]);
    bench.script(&[(5.0, "?", "<Idle|MPos:0.000,0.000,10.000|FS:0,0|Pn:Z|WCO:0.000,0.000,0.000>")]);
    bench.script(&[(5.0, "G0Z9\n", "ok")]);
    assert_eq!(bench.true_mm(Axis::Z, 9.0), 11.5);
}

#[test]
fn positions_are_whole_steps() {
    let mut bench = GrblBench::homed();
    bench.script(&[(40.0, "$J=X0.0004Y0.0007Z1.2341F600\n", "ok")]);
    for (axis, mm) in Axis::ALL.into_iter().zip([0.0, 0.001_25, 1.233_75]) {
        assert!((bench.true_mm(axis, 50.0) - mm).abs() < 1e-9, "{axis:?}");
    }
}

#[test]
fn lagging_stage_has_no_jump_at_jogs_and_a_cancel() {
    let mut bench = GrblBench::homed_on(scene_with(|spec| {
        spec.stage = Some(Servo { lag_s: 0.007, quantum_mm: 0.0, ..Servo::default() })
    }));
    let mut before = (0.0, 0.0);
    for step in 0..=12_000 {
        let now_s = 40.0 + f64::from(step) * 1e-4;
        match step {
            0 => assert_eq!(bench.say(now_s, b"$J=X6F600\n$J=X6Y2F600\n"), "ok ok"),
            1030 => assert_eq!(bench.say(now_s, b"$J=X4Y2F600\n"), "ok"),
            9000 => assert_eq!(bench.say(now_s, b"\x85"), ""),
            _ => {}
        }
        let (place_mm, speed_mm_s) = bench.scene.axis(Axis::X, now_s);
        let jump_mm = place_mm - before.0 - (speed_mm_s + before.1) / 2.0 * 1e-4;
        assert!(jump_mm.abs() < 1e-6, "{jump_mm} mm at {now_s} s");
        assert!((speed_mm_s - before.1).abs() < 100.0 * 1e-4 + 1e-6, "{} to {speed_mm_s} at {now_s} s", before.1);
        before = (place_mm, speed_mm_s);
    }
}

#[tokio::test(start_paused = true)]
async fn opening_the_port_resets_it_and_its_bootloader_takes_no_line() {
    let scene = shared(scene());
    let grbl = shared(GrblEmulator::new(board(), &scene.lock().expect("a scene")));
    let origin = Instant::now();
    let mut wire = Wire::to(grbl.clone(), scene.clone(), origin);
    wire.send(b"$I\n?").await;
    assert!(wire.is_silent().await);
    let welcome = format!("\r\nGrbl 1.1h ['$' for help]\r\n{UNLOCK}\r\n");
    assert_eq!(wire.ask(b"", welcome.len()).await, welcome.as_bytes());
    let took_s = origin.elapsed().as_secs_f64();
    assert!((1.69..1.72).contains(&took_s), "{took_s}");
    assert!(wire.is_silent().await, "what came before is lost");
    assert_eq!(wire.ask(b"$X\n$J=G91X-5F600\n", 33).await, b"[MSG:Caution: Unlocked]\r\nok\r\nok\r\n");
    // another opening: the motion ends, and the count begins at zero
    palpate_link::time::sleep(Duration::from_millis(200)).await;
    let mut again = Wire::to(grbl, scene.clone(), origin);
    assert_eq!(again.ask(b"", welcome.len()).await, welcome.as_bytes());
    let report = b"<Alarm|MPos:0.000,0.000,0.000|";
    assert_eq!(again.ask(b"?", report.len()).await, report);
    let way_mm = POWER_ON.x_mm - scene.lock().expect("a scene").axis(Axis::X, 60.0).0;
    assert!((1.0..3.0).contains(&way_mm), "{way_mm}");
}

#[test]
fn frame_without_switches_is_unlocked_counts_from_zero_and_does_not_home() {
    let settings = BoardSettings::default().with(MotionBoard::SOFT_LIMITS, 0.0).with(MotionBoard::HOMING, 0.0);
    let scene = scene();
    let mut bench =
        GrblBench { grbl: GrblEmulator::new(MotionBoard { settings, ..board() }, &scene), scene, done_s: 0.0 };
    bench.script(&[
        (0.0, "?", "<Idle|MPos:0.000,0.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"),
        (0.1, "$H\n", "error:5"),
        (0.2, "$20=1\n", "error:10"),
        (0.3, "$J=G91X1F600\n", "ok"),
        (2.0, "$22=1\n$20=1\n$1=25\n", "ok ok ok"),
    ]);
    let text = bench.say(3.0, b"$$\n");
    assert!(text.contains(" $1=25 ") || text.starts_with("$0=10 $1=25 "), "{text}");
    assert!(text.contains(" $20=1 ") && text.contains(" $22=1 "), "{text}");
}

#[test]
fn an_axis_that_homes_to_minus_and_a_build_that_sets_the_origin_count_as_grbl_does() {
    for (mask, sets_origin, counts_mm) in
        [(0.0, false, [-0.5; 3]), (3.0, false, [-24.5, -24.5, -0.5]), (0.0, true, [0.0; 3]), (7.0, true, [0.0; 3])]
    {
        let settings = BoardSettings::default().with(MotionBoard::HOMING_DIRECTION, mask);
        let scene = scene();
        let board = MotionBoard { settings, sets_origin, ..board() };
        let mut bench = GrblBench { grbl: GrblEmulator::new(board, &scene), scene, done_s: 0.0 };
        assert_eq!(bench.say(1.0, b"$H\n"), "ok");
        let at_s = bench.done_s;
        assert_eq!(bench.state(at_s).1.map(|mm| mm + MIDDLE_MM), counts_mm);
        let ends_mm: [f64; 3] = std::array::from_fn(|n| if mask as u8 & (1 << n) == 0 { 12.0 } else { -12.0 });
        assert_eq!(Axis::ALL.map(|axis| (bench.true_mm(axis, at_s) * 1e6).round() / 1e6), ends_mm);
    }
}

#[tokio::test(start_paused = true)]
async fn homing_answers_at_its_end_without_status_before() {
    let scene = scene();
    let grbl = shared(GrblEmulator::new(MotionBoard { boot_s: None, ..board() }, &scene));
    let origin = Instant::now();
    let mut wire = Wire::to(grbl, shared(scene), origin);
    wire.send(b"$H\n").await;
    assert!(wire.is_silent().await);
    wire.send(b"??!\x85").await;
    assert!(wire.is_silent().await);
    assert_eq!(wire.ask(b"", 4).await, b"ok\r\n");
    assert!(Instant::now() - origin > Duration::from_secs(4));
    let report = b"<Idle|MPos:-0.500,-0.500,-0.500|FS:0,0|WCO:0.000,0.000,0.000>\r\n";
    assert_eq!(wire.ask(b"", report.len()).await, report);
    assert!(wire.is_silent().await);
}

#[tokio::test(start_paused = true)]
async fn a_reset_ends_a_search_for_home() {
    let scene = shared(scene());
    let grbl = shared(GrblEmulator::new(MotionBoard { boot_s: None, ..board() }, &scene.lock().expect("a scene")));
    let origin = Instant::now();
    let mut wire = Wire::to(grbl, scene.clone(), origin);
    wire.send(b"$H\n").await;
    palpate_link::time::sleep(Duration::from_millis(300)).await;
    let text = format!("ALARM:6\r\n\r\nGrbl 1.1h ['$' for help]\r\n{UNLOCK}\r\n");
    assert_eq!(String::from_utf8(wire.ask(b"\x18", text.len()).await).expect("ASCII"), text);
    assert!(Instant::now() - origin < Duration::from_millis(310));
    assert!(wire.is_silent().await, "the line that was cut off has no ok");
    let z_mm = scene.lock().expect("a scene").axis(Axis::Z, 60.0).0;
    assert!(z_mm > POWER_ON.z_mm && z_mm < 12.5, "it was on its way up: {z_mm}");
    assert_eq!(wire.ask(b"G0X1\n", 9).await, b"error:9\r\n");
}

proptest! {
    #[test]
    fn emulator_survives_arbitrary_bytes_in_bounded_memory(pieces in prop::collection::vec(
        prop_oneof![
            prop::collection::vec(any::<u8>(), 0..30),
            "(\\$J=)?(G[0-9]{1,2}){0,2}([XYZFPST]-?[0-9.]{1,5}){0,4}\n".prop_map(String::into_bytes),
            "\\$[0-9]{1,3}=[0-9.]{1,6}\n".prop_map(String::into_bytes),
            prop::sample::select(vec!["$H\n", "$X\n", "\x18", "~", "!", "?"]).prop_map(|text| text.as_bytes().to_vec()),
        ],
        0..40,
    )) {
        let mut bench = GrblBench::new();
        bench.say(0.0, b"$X\n");
        let mut now_s = 1.0;
        for piece in pieces {
            bench.say(now_s, &piece);
            now_s = bench.done_s.max(now_s) + 0.05;
            prop_assert!(bench.grbl.waiting.iter().map(|line| line.text.len()).sum::<usize>() < report::RX_MOST);
            for axis in Axis::ALL {
                let place_mm = bench.true_mm(axis, now_s);
                prop_assert!(place_mm.abs() <= 12.5 + 1e-6, "{axis:?} at {place_mm}");
            }
        }
    }
}
