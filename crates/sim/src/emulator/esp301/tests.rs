//! The ESP301, command by command.

mod faults;

use super::*;
use crate::emulator::tests::{POWER_ON, STIFFNESS_N_MM, Wire, scene, scene_with, shared};
use crate::scene::Servo;
use palpate_link::time::Instant;
use proptest::prelude::*;
use std::time::Duration;

/// A controller and its scene, talked to at given times.
struct Esp301Bench {
    esp: Esp301Emulator,
    scene: Scene,
}

impl Esp301Bench {
    fn new() -> Self {
        Esp301Bench::on(scene())
    }

    fn on(scene: Scene) -> Self {
        Esp301Bench { esp: Esp301Emulator::new(&scene), scene }
    }

    /// Motors on and homed by `OR1`, at true zero from 10 s on.
    fn homed() -> Self {
        Esp301Bench::homed_on(scene())
    }

    fn homed_on(scene: Scene) -> Self {
        let mut bench = Esp301Bench::on(scene);
        // z away from the specimen first, or it would be homed into it
        assert_eq!(bench.say(0.0, "1MO;2MO;3MO;1OR1;2OR1;3SH12.5;3OR3"), "");
        bench.say(10.0, "TP?");
        bench
    }

    /// What is answered to some lines sent at once, without their ends.
    fn say(&mut self, now_s: f64, lines: &str) -> String {
        let mut inbox = format!("{lines}\r").into_bytes();
        let mut reply = String::new();
        while let Some(line) = self.esp.take_request(&mut inbox) {
            reply += &String::from_utf8(self.esp.answer(&line, &mut self.scene, now_s)).expect("ASCII");
        }
        reply.strip_suffix("\r\n").unwrap_or(&reply).replace("\r\n", "|")
    }

    /// The codes of all errors, oldest first.
    fn errors(&mut self, now_s: f64) -> Vec<String> {
        std::iter::from_fn(|| Some(self.say(now_s, "TE?")).filter(|code| code != "0")).collect()
    }

    fn true_mm(&mut self, axis: Axis, now_s: f64) -> f64 {
        self.scene.axis(axis, now_s).0
    }
}

#[test]
fn startup_of_the_recorded_session_is_reproduced() {
    let mut bench = Esp301Bench::new();
    for (now_s, sent, answered) in [
        (0.1, "VE?", "ESP301 Version 1.1.1 16/01/14"),
        (0.2, "TB?", "0, 500, NO ERROR DETECTED"),
        (0.3, "1 ID?", "VP-25XL, SN171801"),
        (0.4, "1VA5", ""),
        (0.5, "1SL-12.5", ""),
        (0.6, "1SR12.5", ""),
        (0.7, "1MO?", "0"),
        (0.8, "1MO", ""),
        (0.9, "1MO?", "1"),
        (1.0, "1OR1", ""),
        (1.1, "1MD?", "0"),
        (9.0, "1MD?", "1"),
        (9.1, "1TP", "0.0000"),
        (9.2, "1PA-10.2370", ""),
        (9.3, "1MD?", "0"),
        (19.0, "1MD?", "1"),
        (19.1, "1TP", "-10.2370"),
        (19.2, "1PA?", "-10.2370"),
        (19.3, "ST", ""),
        (19.4, "TE?", "0"),
    ] {
        assert_eq!(bench.say(now_s, sent), answered, "{sent} at {now_s} s");
    }
}

#[test]
fn lagging_stage_has_no_jump_at_a_new_speed_or_stop() {
    let lag_s = 0.007;
    let mut bench = Esp301Bench::homed_on(scene_with(|spec| {
        spec.stage = Some(Servo { lag_s, quantum_mm: 0.0, ..Servo::default() })
    }));
    bench.say(11.0, "1VA10;1PA5");
    let mut before = (0.0, 0.0);
    for step in 0..=10_000 {
        let now_s = 11.0 + f64::from(step) * 1e-4;
        match step {
            2000 => assert_eq!(bench.say(now_s, "1VA3"), ""),
            2030 => assert_eq!(bench.say(now_s, "1VA6"), ""),
            5000 => assert_eq!(bench.say(now_s, "1ST"), ""),
            _ => {}
        }
        let (place_mm, speed_mm_s) = bench.scene.axis(Axis::X, now_s);
        let jump_mm = place_mm - before.0 - (speed_mm_s + before.1) / 2.0 * 1e-4;
        assert!(jump_mm.abs() < 1e-6, "{jump_mm} mm at {now_s} s");
        assert!((speed_mm_s - before.1).abs() < 100.0 * 1e-4 + 1e-9, "{} to {speed_mm_s} at {now_s} s", before.1);
        before = (place_mm, speed_mm_s);
    }
    assert_eq!(bench.errors(12.0), [""; 0]);
    assert_eq!(bench.say(12.0, "1MD?"), "1");
}

#[test]
fn lagging_stage_is_done_before_rest_and_tp_gives_its_position() {
    let mut bench = Esp301Bench::homed_on(scene_with(|spec| {
        spec.stage = Some(Servo { lag_s: 0.05, quantum_mm: 0.0, ..Servo::default() })
    }));
    bench.say(11.0, "1VA10;1PA1");
    let done_s = bench.scene.motion(Axis::X).end_s() + 1e-6;
    assert_eq!(bench.say(done_s - 1e-5, "1MD?"), "0");
    assert_eq!(bench.say(done_s, "1MD?"), "1");
    let there_mm: f64 = bench.say(done_s, "1TP?").parse().expect("a place");
    assert!((there_mm - 0.9375).abs() < 1e-3, "50 ms at 50 mm/s^2 are 0.0625 mm: {there_mm}");
    assert_eq!(bench.say(done_s + 0.05, "1TP?"), "1.0000");
}

#[test]
fn targets_are_rounded_to_the_stages_quantum() {
    let mut bench = Esp301Bench::homed_on(scene_with(|spec| {
        spec.stage = Some(Servo { lag_s: 0.0, quantum_mm: 0.01, ..Servo::default() })
    }));
    bench.say(11.0, "1PA0.1263");
    assert_eq!(bench.say(12.0, "1TP?;1PA?"), "0.1300|0.1300");
    assert!((bench.true_mm(Axis::X, 12.0) - 0.13).abs() < 1e-12);
}

#[test]
fn query_is_answered_with_and_without_its_mark_in_any_case() {
    let mut bench = Esp301Bench::homed();
    for tell in ["1TP?", "1TP", "01TP?", "1 tp ?", "001tp"] {
        assert_eq!(bench.say(10.0, tell), "0.0000", "{tell}");
    }
    assert_eq!(bench.say(10.0, "2ID"), "VP-25XL, SN171802");
    assert_eq!(bench.say(10.0, "01MD"), "1");
    assert_eq!(bench.say(10.0, "TP"), "0.0000, 0.0000, 12.5000");
    assert_eq!(bench.say(10.0, "0TP?"), "0.0000, 0.0000, 12.5000");
    assert_eq!(bench.say(10.0, "0MD?"), "1, 1, 1");
    assert_eq!(bench.say(10.0, "1TP?;2TP?; ;1MD?"), "0.0000|0.0000|1");
    assert_eq!(bench.say(10.0, "1VU?;1SL?;1SR?;1SN?"), "25.0000|-12.5000|12.5000|2");
    assert_eq!(bench.say(10.0, "1MF?"), "1");
    assert_eq!(bench.errors(10.0), [""; 0]);
}

#[test]
fn impossible_command_queues_its_error_code() {
    for (sent, code) in [
        ("*IDN?", "6"),
        ("*OPC?", "6"),
        ("1XX", "6"),
        ("1", "6"),
        ("1TP7", "7"),
        ("WS-1", "7"),
        ("4TP?", "9"),
        ("99PA1", "9"),
        ("4294967297TP", "9"),
        ("1HN1,2,3", "27"),
        ("1HL0,0,0", "27"),
        ("PA1", "37"),
        ("VA?", "37"),
        ("1PA", "38"),
        ("1PAx", "101"),
        ("2PA1E0", "201"),
        ("1OR7", "101"),
        ("1OR1.5", "101"),
        ("1SN12", "101"),
        ("1SL13", "101"),
        ("3PA-12.6", "307"),
        ("3PA12.6", "306"),
        ("1PA-12.5001", "107"),
        ("3PR0.1", "306"),
        ("1OH25.1", "110"),
        ("1MV+", "6"),
        ("1VA25.1", "110"),
        ("2AC100.5", "211"),
        ("1VA0", "124"),
        ("1VA-1", "124"),
        ("1AC0", "101"),
        ("1MF;1PA1", "113"),
        ("1MF;1OR1", "113"),
    ] {
        let mut bench = Esp301Bench::homed();
        assert_eq!(bench.say(20.0, sent), "", "{sent}");
        assert_eq!(bench.errors(20.0), [code], "{sent}");
        assert_eq!(bench.say(30.0, "TP"), "0.0000, 0.0000, 12.5000", "{sent} moved something");
    }
}

#[test]
fn both_error_queries_empty_the_same_queue() {
    let mut bench = Esp301Bench::new();
    bench.say(1.0, "XX;4TP;PA1");
    assert_eq!(bench.say(2.0, "TB?"), "6, 2500, COMMAND DOES NOT EXIST");
    assert_eq!(bench.say(2.0, "TE?"), "9");
    assert_eq!(bench.say(2.0, "01TB"), "37, 2500, AXIS NUMBER MISSING");
    assert_eq!(bench.say(2.0, "TE"), "0");
    assert_eq!(bench.say(859_000.0, "TB?"), "0, -2147467296, NO ERROR DETECTED");
}

#[test]
fn count_before_homing_is_relative_to_the_position_at_power_up() {
    let mut bench = Esp301Bench::new();
    assert_eq!(bench.say(0.0, "TP"), "0.0000, 0.0000, 0.0000");
    bench.say(0.0, "3MO;3PA-1");
    assert_eq!(bench.say(5.0, "3TP;3PA?;3PA-2"), "-1.0000|-1.0000");
    assert_eq!(bench.true_mm(Axis::Z, 10.0), POWER_ON.z_mm - 2.0);
    bench.say(10.0, "3DH5");
    assert_eq!(bench.say(10.0, "3TP;3PA?"), "5.0000|5.0000");
    bench.say(10.0, "3DH");
    assert_eq!(bench.say(10.0, "3TP"), "0.0000");
}

#[test]
fn a_search_for_home_ends_at_the_count_that_sh_states_and_at_0_as_shipped() {
    for (mode, place_mm) in [("1", 0.0), ("2", 0.0), ("3", 12.5), ("4", -12.5), ("5", 12.5), ("6", -12.5)] {
        let mut bench = Esp301Bench::new();
        for (sh, count) in [("", "0.0000"), ("2SH-7.25;", "-7.2500")] {
            let mut bench = Esp301Bench::new();
            bench.say(0.0, &format!("2MO;{sh}2OR{mode}"));
            assert_eq!(bench.say(4.0, "2TP?"), count, "{sh} mode {mode}");
            assert_eq!(bench.true_mm(Axis::Y, 4.0), place_mm);
        }
        bench.say(0.0, &format!("2MO;2SH{place_mm};2OR{mode}"));
        // 2 mm at 5 mm/s take less than a second, all the way to an end less than four
        assert_eq!(bench.say(0.2, "2MD?"), "0");
        assert_eq!(bench.say(4.0, "2MD?"), "1");
        assert_eq!(bench.true_mm(Axis::Y, 4.0), place_mm);
        assert_eq!(bench.say(4.0, "2TP?"), decimal(place_mm));
        assert_eq!(bench.errors(4.0), [""; 0]);
    }
    let mut bench = Esp301Bench::new();
    bench.say(0.0, "2MO;2PA1");
    bench.say(4.0, "2OR0");
    assert_eq!(bench.say(8.0, "2TP?"), "0.0000");
    assert_eq!(bench.true_mm(Axis::Y, 8.0), POWER_ON.y_mm);
}

#[test]
fn settings_that_clients_read_at_the_start_are_answered() {
    let mut bench = Esp301Bench::new();
    for question in ["1VB?", "1JH?", "1JL?", "1FR?", "1SU?", "1QM?", "1QS?", "1KP?", "1LC?", "1SH?", "1ZB?", "TX?"] {
        assert!(!bench.say(0.0, question).is_empty(), "{question}");
    }
    assert_eq!(bench.errors(0.0), [""; 0]);
}

#[test]
fn a_homing_takes_no_other_motion_and_is_aborted_by_a_stop() {
    let mut bench = Esp301Bench::new();
    bench.say(0.0, "2MO;2OR4");
    bench.say(0.5, "2PA0;2OR1;2DH");
    bench.say(0.6, "2ST");
    assert_eq!(bench.errors(2.0), ["230", "230", "230", "220"]);
    let (stopped, count) = (bench.true_mm(Axis::Y, 2.0), bench.say(2.0, "2TP"));
    // not homed: the count is as wrong as before
    assert_eq!(count, decimal(stopped - POWER_ON.y_mm));
}

#[test]
fn a_new_target_under_way_is_refused_and_the_old_one_reached() {
    let mut bench = Esp301Bench::homed();
    bench.say(10.0, "1PA10");
    bench.say(10.2, "1PA-10;1OR1;1DH");
    assert_eq!(bench.errors(10.3), ["132"; 3]);
    assert_eq!(bench.say(20.0, "1TP?"), "10.0000");
}

#[test]
fn a_relative_move_counts_from_the_commanded_place_whatever_it_is_called() {
    let mut bench = Esp301Bench::homed_on(scene_with(|spec| {
        spec.stage = Some(Servo { lag_s: 0.05, quantum_mm: 0.0, ..Servo::default() })
    }));
    assert_eq!(bench.say(11.0, "1VA10;1PR1.5;2VA5;2PR-0.5;3PR-2.25;3MD?"), "0");
    assert_eq!(bench.say(15.0, "TP;1PA?;2PA?;3PA?"), "1.5000, -0.5000, 10.2500|1.5000|-0.5000|10.2500");
    // the stage lags behind, and the second way adds to the first as a whole
    bench.say(16.0, "1PR1");
    let done_s = bench.scene.motion(Axis::X).end_s() + 1e-6;
    assert_eq!(bench.say(done_s, "1MD?;1PR1"), "1");
    assert!((bench.true_mm(Axis::X, 20.0) - 3.5).abs() < 1e-9);
    // a new home changes the count, not how far a relative motion goes
    bench.say(20.0, "3DH;3PR-0.5");
    assert_eq!(bench.say(25.0, "3TP"), "-0.5000");
    assert_eq!(bench.true_mm(Axis::Z, 25.0), 9.75);
    // after a stop it counts from where the axis was stopped
    bench.say(30.0, "1PR5");
    bench.say(30.4, "1ST");
    let stopped_mm = bench.true_mm(Axis::X, 32.0);
    bench.say(32.0, "1PR-1");
    assert!((bench.true_mm(Axis::X, 40.0) - stopped_mm + 1.0).abs() < 1e-9);
    assert_eq!(bench.errors(40.0), [""; 0]);
}

#[test]
fn a_relative_move_is_refused_like_an_absolute_one() {
    for (sent, codes) in [
        ("PR1", &["37"][..]),
        ("1PR", &["38"]),
        ("4PR1", &["9"]),
        ("1PRx;2PR1", &["101"]),
        ("1PR12.51", &["106"]),
        ("1PR-12.51;3PR-25.1", &["107", "307"]),
        ("3MF;3PR-1", &["313"]),
        ("2PR1;2PR1", &["232"]),
        ("2OR4;2PR1", &["230"]),
    ] {
        let mut bench = Esp301Bench::homed();
        assert_eq!(bench.say(20.0, sent), "", "{sent}");
        assert_eq!(bench.errors(30.0), codes, "{sent}");
    }
}

#[test]
fn a_new_speed_acts_at_once() {
    let mut bench = Esp301Bench::homed();
    bench.say(10.0, "1VA2;1PA10");
    assert_eq!(bench.scene.axis(Axis::X, 11.0).1, 2.0);
    bench.say(11.0, "1VA5");
    assert!((bench.scene.axis(Axis::X, 11.5).1 - 5.0).abs() < 1e-9);
    assert_eq!(bench.say(11.5, "1MD?"), "0");
    // 2 mm/s for a second, 5 mm/s for the other eight: 12 s would have been needed except for the ramps
    assert_eq!(bench.say(14.0, "1MD?;1TP"), "1|10.0000");
    assert_eq!(bench.errors(14.0), [""; 0]);
}

#[test]
fn stop_brakes_with_ag_and_next_target_waits_for_rest() {
    let mut bench = Esp301Bench::homed();
    bench.say(10.0, "1VA10;1AC50;1AG50;1PA10");
    let before = bench.true_mm(Axis::X, 10.5);
    bench.say(10.5, "1ST");
    // from 10 mm/s with 50 mm/s^2: 0.2 s and 1 mm
    assert_eq!(bench.say(10.6, "1MD?"), "0");
    assert!((bench.scene.axis(Axis::X, 10.6).1 - 5.0).abs() < 1e-9);
    bench.say(10.6, "1PA0;1VA1");
    assert_eq!(bench.say(10.71, "1MD?"), "1");
    assert!((bench.true_mm(Axis::X, 11.0) - before - 1.0).abs() < 1e-9);
    assert_eq!(bench.errors(11.0), ["132"]);
    bench.say(11.0, "1PA0");
    assert_eq!(bench.say(20.0, "1TP"), "0.0000");
}

#[test]
fn abort_of_any_axis_stops_all_and_turns_the_motors_off() {
    for abort in ["AB", "1AB"] {
        let mut bench = Esp301Bench::homed();
        bench.say(10.0, "1PA5;2PA5");
        bench.say(10.3, abort);
        assert_eq!(bench.say(10.6, "MD?;1MO?;2MO?;3MO?"), "1, 1, 1|0|0|0");
        assert!(bench.true_mm(Axis::Y, 20.0) < 5.0);
        assert_eq!(bench.errors(20.0), [""; 0]);
    }
}

#[test]
fn the_end_of_travel_stops_a_move_that_the_count_allowed() {
    let mut bench = Esp301Bench::new();
    // z is at true 8, counted 0: count 10 would be true 18
    bench.say(0.0, "3MO;3PA10");
    assert_eq!(bench.say(5.0, "3MD?"), "1");
    assert_eq!(bench.true_mm(Axis::Z, 5.0), 12.5);
    assert!(bench.say(5.0, "TB?").ends_with(", AXIS-3 POSITIVE HARDWARE LIMIT DETECTED"));
    bench.say(5.0, "3SL-30;3VA25;3PA-25");
    assert_eq!(bench.true_mm(Axis::Z, 10.0), -12.5);
    assert_eq!(bench.errors(10.0), ["305"]);
}

#[test]
fn end_of_travel_stops_a_motion_with_a_weak_brake() {
    let mut bench = Esp301Bench::homed();
    bench.say(10.0, "1VA25;1AC100;1AG100;1PA12");
    // 4 s more with this brake
    bench.say(10.4, "1AG5;1ST");
    let end_mm = bench.true_mm(Axis::X, 20.0);
    assert!(end_mm <= drive::TRAVEL_MM && end_mm > 12.49, "{end_mm}");
}

#[test]
fn a_zero_has_no_sign() {
    assert_eq!(
        (decimal(-0.000_01), decimal(-0.0), decimal(-0.000_06)),
        ("0.0000".into(), "0.0000".into(), "-0.0001".into())
    );
}

#[test]
fn encoder_counts_are_reported_when_asked_for() {
    let mut bench = Esp301Bench::homed();
    bench.say(10.0, "1PA-1.5;1SN0");
    assert_eq!(bench.say(20.0, "1TP;1SN?;1PA?"), "-300000|0|-1.5000");
    assert_eq!(bench.say(20.0, "1SN2;1TP"), "-1.5000");
}

#[test]
fn a_press_reaches_the_scene() {
    let mut bench = Esp301Bench::homed();
    bench.say(10.0, "3PA-0.5");
    assert!((bench.scene.load_cell_n(20.0) - 0.5 * STIFFNESS_N_MM).abs() < 1e-9);
}

#[test]
fn a_wait_stalls_until_the_stop_and_its_time() {
    let mut bench = Esp301Bench::homed();
    bench.say(10.0, "1VA2;1AC50;1PA4");
    // 2 s for the way and 0.04 s for the ramps
    bench.say(10.0, "1WS0");
    assert!((bench.esp.deaf_until_s() - 12.04).abs() < 1e-9);
    bench.say(10.0, "WS500");
    assert!((bench.esp.deaf_until_s() - 12.54).abs() < 1e-9);
    bench.say(20.0, "1WS0");
    assert_eq!(bench.esp.deaf_until_s(), 20.0);
}

#[tokio::test(start_paused = true)]
async fn coalesced_lines_are_answered_in_order_and_a_wait_delays_the_next() {
    let scene = scene();
    let esp = shared(Esp301Emulator::new(&scene));
    let origin = Instant::now();
    let mut wire = Wire::to(esp, shared(scene), origin);
    // what pymeasure sends, in one write: home, wait, ask
    assert_eq!(wire.ask(b"1MO\r1OR1\r1WS0\r1MD?\r1TP", 3).await, b"1\r\n");
    // 1 mm at 5 mm/s takes 0.3 s
    let took = Instant::now() - origin;
    assert!(took > Duration::from_millis(300) && took < Duration::from_millis(330), "{took:?}");
    assert_eq!(wire.ask(b"?\r\n", 8).await, b"0.0000\r\n");
    // the rest of a line waits too
    assert_eq!(wire.ask(b"1PA1;1WS;1TP\r", 8).await, b"1.0000\r\n");
    wire.send(b"*OPC?\r").await;
    assert!(wire.is_silent().await);
    assert_eq!(wire.ask(b"TE?\r", 3).await, b"6\r\n");
}

proptest! {
    #[test]
    fn emulator_survives_arbitrary_bytes(lines in prop::collection::vec("[0-9]{0,2}[A-Z]{2}[-+?.0-9]{0,6}[;\r]?", 0..40)) {
        let mut bench = Esp301Bench::homed();
        for (n, line) in lines.iter().enumerate() {
            bench.say(10.0 + n as f64 * 0.05, line);
        }
        for axis in Axis::ALL {
            let place_mm = bench.true_mm(axis, 100.0);
            prop_assert!(place_mm.abs() <= drive::TRAVEL_MM + 1e-9, "{axis:?} at {place_mm}");
        }
    }

    #[test]
    fn commands_in_any_order_keep_the_stage_within_its_travel(
        steps in prop::collection::vec((0usize..10, -20.0..20.0f64, 0.0..1.0f64), 1..40),
    ) {
        let mut bench = Esp301Bench::new();
        let mut now_s = 0.0;
        bench.say(now_s, "1MO;1SL-30;1SR30");
        for (command, x, wait_s) in steps {
            let text = ["1PA#", "1VA#", "1AC#", "1AG#", "1OR4", "1ST", "1MO", "1DH#", "AB", "1MF"][command].replace('#', &format!("{x:.3}"));
            bench.say(now_s, &text);
            for part in 0..=10 {
                let place_mm = bench.true_mm(Axis::X, now_s + wait_s * f64::from(part) / 10.0);
                prop_assert!(place_mm.abs() <= drive::TRAVEL_MM + 1e-6, "{text}: {place_mm}");
            }
            now_s += wait_s;
        }
    }
}
