//! Emulated programs, line by line.

mod faults;

use super::*;
use crate::emulator::tests::{POWER_ON, Wire, pressed, scene, shared};
use crate::emulator::{INBOX_MOST, Owed};
use palpate_core::quantity::{Axis, Range, Steps};
use palpate_link::time::Instant;
use proptest::prelude::*;
use std::time::Duration;

const PREPARE: &str = r#"{"id": 2, "do": "prepare", "travel_mm": {"x": [-12.5, 12.5], "y": [-12.5, 12.5], "z": [-12.5, 12.5]}, "away": 1, "speed_mm_s": 10.0, "acceleration_mm_s2": 100.0}"#;

/// What is answered to a line; an answer that is owed is waited for. None of it may be left over.
fn ask<I: Instrument>(device: &mut I, scene: &mut Scene, now_s: f64, line: &str) -> String {
    let mut inbox = format!("{line}\n").into_bytes();
    let mut reply = Vec::new();
    while let Some(request) = device.take_request(&mut inbox) {
        reply.extend(device.answer(&request, scene, now_s));
    }
    assert!(inbox.is_empty());
    let mut at_s = now_s;
    loop {
        match device.owed(scene, at_s) {
            Owed::Nothing | Owed::HungUp => break,
            Owed::At(due_s) => at_s = due_s,
            Owed::Ready(owed) | Owed::Pushed(owed) => reply.extend(owed),
        }
    }
    String::from_utf8(reply).expect("UTF-8").trim_end().to_owned()
}

fn prepared() -> (ProcessStageEmulator, Scene) {
    let mut scene = scene();
    let mut stage = ProcessStageEmulator::new(&scene);
    assert_eq!(ask(&mut stage, &mut scene, 0.0, PREPARE), r#"{"id":2}"#);
    (stage, scene)
}

#[test]
fn stage_homes_and_moves_as_documented() {
    let (mut stage, mut scene) = prepared();
    for (now_s, asked, answered) in [
        (
            10.0,
            r#"{"id": 1, "do": "identify"}"#,
            r#"{"id":1,"identity":"emulated stage, serial number 1","protocol":2,"role":"stage"}"#,
        ),
        (10.0, r#"{"id": 2, "do": "status"}"#, r#"{"id":2,"moving":false,"position_mm":{"x":0.0,"y":0.0,"z":12.5}}"#),
        (10.0, r#"{"id": 3, "do": "move", "to_mm": {"x": 1, "z": 2.5}, "speed_mm_s": 10, "extra": 1}"#, r#"{"id":3}"#),
        (10.5, r#"{"id": 4, "do": "status"}"#, r#"{"id":4,"moving":true,"position_mm":{"x":1.0,"y":0.0,"z":8.0}}"#),
        (10.5, r#"{"do": "speed", "speed_mm_s": 2}"#, ""),
        (11.0, r#"{"do": "speed", "speed_mm_s": "fast"}"#, ""),
        (11.58, r#"{"id": 5, "do": "status"}"#, r#"{"id":5,"moving":true,"position_mm":{"x":1.0,"y":0.0,"z":5.52}}"#),
        (
            11.58,
            "{\"do\": \"stop\"}\n\n{\"id\": 6, \"do\": \"status\"}",
            r#"{"id":6,"moving":true,"position_mm":{"x":1.0,"y":0.0,"z":5.52}}"#,
        ),
        (12.0, r#"{"id": 7, "do": "status"}"#, r#"{"id":7,"moving":false,"position_mm":{"x":1.0,"y":0.0,"z":5.5}}"#),
        // home is known: it only comes to rest
        (13.0, PREPARE, r#"{"id":2}"#),
        (13.0, r#"{"id": 8, "do": "status"}"#, r#"{"id":8,"moving":false,"position_mm":{"x":1.0,"y":0.0,"z":5.5}}"#),
    ] {
        assert_eq!(ask(&mut stage, &mut scene, now_s, asked), answered, "{asked} at {now_s} s");
    }
}

#[test]
fn a_move_by_a_distance_begins_where_the_axis_rests_and_only_where_it_is_expected() {
    let (mut stage, mut scene) = prepared();
    for (now_s, asked, answered) in [
        (
            10.0,
            r#"{"id": 3, "do": "move", "from_mm": {"x": 0.0, "z": 12.5}, "by_mm": {"x": 1.5, "z": -2}, "speed_mm_s": 10}"#,
            r#"{"id":3}"#,
        ),
        (10.1, r#"{"id": 4, "do": "move", "by_mm": {"z": 1}, "speed_mm_s": 10}"#, r#"{"error":"z moves","id":4}"#),
        (12.0, r#"{"id": 5, "do": "status"}"#, r#"{"id":5,"moving":false,"position_mm":{"x":1.5,"y":0.0,"z":10.5}}"#),
        (12.0, r#"{"id": 6, "do": "move", "by_mm": {"z": 0.25}, "speed_mm_s": 10}"#, r#"{"id":6}"#),
        (
            14.0,
            r#"{"id": 7, "do": "move", "from_mm": {"z": 10.5}, "by_mm": {"z": -1}, "speed_mm_s": 10}"#,
            r#"{"error":"z is at 10.75 mm, not at 10.5 mm","id":7}"#,
        ),
        (
            14.0,
            r#"{"id": 8, "do": "move", "from_mm": {"z": 10.752}, "by_mm": {"z": 2}, "speed_mm_s": 10}"#,
            r#"{"error":"z = 12.75 mm exceeds the travel","id":8}"#,
        ),
        (
            14.0,
            r#"{"id": 9, "do": "move", "from_mm": {"z": 10.75}, "by_mm": {}, "speed_mm_s": 10}"#,
            r#"{"error":"by_mm names no axis","id":9}"#,
        ),
    ] {
        assert_eq!(ask(&mut stage, &mut scene, now_s, asked), answered, "{asked} at {now_s} s");
    }
    assert_eq!(scene.axis(Axis::Z, 20.0).0, 10.75);
}

#[test]
fn a_printer_moves_by_whole_steps_from_the_step_it_rests_on() {
    let (mut stage, mut scene) = printer(true);
    assert_eq!(ask(&mut stage, &mut scene, 0.0, PREPARE), r#"{"id":2}"#);
    let by = r#"{"id": 3, "do": "move", "from_mm": {"z": 8.0}, "by_mm": {"z": -0.0637}, "speed_mm_s": 10}"#;
    assert_eq!(ask(&mut stage, &mut scene, 10.0, by), r#"{"id":3}"#);
    assert!((scene.axis(Axis::Z, 12.0).0 - (POWER_ON.z_mm - 0.0625)).abs() < 1e-9);
}

fn printer(homed: bool) -> (ProcessStageEmulator, Scene) {
    let scene = scene();
    let steps = Steps { mm: [0.0125, 0.0125, 0.0025], ..Steps::FINE };
    let stage =
        ProcessStageEmulator::printer(&scene, Printer { ends_mm: [Range { min: -12.5, max: 12.5 }; 3], steps, homed });
    (stage, scene)
}

#[test]
fn a_printer_rests_on_whole_steps_and_reads_them_back() {
    let (mut stage, mut scene) = printer(false);
    assert_eq!(ask(&mut stage, &mut scene, 0.0, PREPARE), r#"{"id":2}"#);
    let to = r#"{"id": 3, "do": "move", "to_mm": {"x": 1.006, "z": 12.4012}, "speed_mm_s": 10}"#;
    assert_eq!(ask(&mut stage, &mut scene, 10.0, to), r#"{"id":3}"#);
    let at = r#"{"homed":true,"id":4,"moving":false,"position_mm":{"x":1.0,"y":0.0,"z":12.4}}"#;
    assert_eq!(ask(&mut stage, &mut scene, 12.0, r#"{"id": 4, "do": "status"}"#), at);
    assert!((scene.axis(Axis::X, 12.0).0 - 1.0).abs() < 1e-9 && (scene.axis(Axis::Z, 12.0).0 - 12.4).abs() < 1e-9);
    // a stop ends on the first step after the braking distance
    ask(&mut stage, &mut scene, 12.0, r#"{"id": 5, "do": "move", "to_mm": {"x": -5}, "speed_mm_s": 10}"#);
    ask(&mut stage, &mut scene, 12.2013, r#"{"do": "stop"}"#);
    let braked_mm = 1.0 - 0.5 - 1.013 - 0.5;
    let x_mm = scene.axis(Axis::X, 20.0).0;
    assert!(x_mm <= braked_mm && x_mm > braked_mm - 0.0125, "{x_mm}");
    assert!((x_mm / 0.0125 - (x_mm / 0.0125).round()).abs() < 1e-9, "{x_mm}");
}

#[test]
fn printer_homes_toward_specimen_only_when_allowed() {
    let prepare = |side: &str| {
        let prepare = PREPARE.replace(r#""z": [-12.5, 12.5]"#, r#""z": [-2.0, 12.5]"#);
        prepare.replace(r#""away""#, &format!(r#""home_side": "{side}", "away""#))
    };
    let (mut stage, mut scene) = printer(false);
    let refused = ask(&mut stage, &mut scene, 0.0, &prepare("none"));
    assert_eq!(refused, r#"{"error":"home isn't known","id":2}"#);
    assert_eq!(scene.axis(Axis::Z, 9.0).0, POWER_ON.z_mm, "nothing moved");
    assert_eq!(ask(&mut stage, &mut scene, 10.0, &prepare("toward")), r#"{"id":2}"#);
    assert!(scene.axis(Axis::Z, 12.15).0 < -12.4, "at the specimen's side");
    assert_eq!(scene.axis(Axis::Z, 60.0).0, -2.0);
    assert_eq!(ask(&mut stage, &mut scene, 60.0, &prepare("none")), r#"{"id":2}"#, "home is known now");
}

#[test]
fn impossible_request_is_an_error_without_motion() {
    for (asked, says) in [
        (r#"{"id": 3, "do": "move", "to_mm": {"z": -12.6}, "speed_mm_s": 1}"#, "z = -12.6 mm exceeds the travel"),
        (r#"{"id": 3, "do": "move", "to_mm": {"x": 1, "w": 1}, "speed_mm_s": 1}"#, "no axis \\\"w\\\""),
        (r#"{"id": 3, "do": "move", "to_mm": {}, "speed_mm_s": 1}"#, "no axis"),
        (r#"{"id": 3, "do": "move", "to_mm": {"x": 1}, "speed_mm_s": 0}"#, "0 mm/s"),
        (r#"{"id": 3, "do": "move", "to_mm": {"x": 1}, "speed_mm_s": 26}"#, "26 mm/s"),
        (r#"{"id": 3, "do": "move", "to_mm": {"x": "1"}, "speed_mm_s": 1}"#, "not a number"),
        (r#"{"id": 3, "do": "move", "speed_mm_s": 1}"#, "to_mm is not an object, and neither is by_mm"),
        (r#"{"id": 3, "do": "dance"}"#, "dance"),
        (r#"{"id": 3}"#, "do is missing"),
        (r#"{"do": "status"}"#, "no id"),
        (r#"{"id": "3", "do": "status"}"#, "no id"),
        (r#"{"id": 3, "do": "#, "not JSON"),
        ("[3]", "a request is an object"),
        (&PREPARE.replace("-12.5", "-13"), "x can't travel from -13 to 12.5 mm"),
        (&PREPARE.replace(r#""y""#, r#""v""#), "no range for y"),
        (&PREPARE.replace(r#""away": 1"#, r#""away": 0"#), "away"),
        (&PREPARE.replace("10.0", "30"), "30 mm/s"),
        (&PREPARE.replace("100.0", "101"), "101 mm/s^2"),
        (&PREPARE.replace(r#""id": 2, "#, ""), "no id"),
    ] {
        let (mut stage, mut scene) = prepared();
        let answer = ask(&mut stage, &mut scene, 20.0, asked);
        let id = if answer.contains("no id") || answer.contains("JSON") || asked == "[3]" {
            "null"
        } else {
            asked.get(7..8).expect("an id")
        };
        assert!(answer.contains(says) && answer.contains(&format!(r#""id":{id}"#)), "{asked}: {answer}");
        assert_eq!(Axis::ALL.map(|axis| scene.axis(axis, 30.0).0), [0.0, 0.0, 12.5], "{asked}");
    }
}

#[test]
fn a_stage_that_isnt_prepared_counts_from_where_it_was_switched_on_and_doesnt_move() {
    let mut scene = scene();
    let mut stage = ProcessStageEmulator::new(&scene);
    let answer = ask(&mut stage, &mut scene, 0.0, r#"{"id": 1, "do": "move", "to_mm": {"z": 1}, "speed_mm_s": 1}"#);
    assert_eq!(answer, r#"{"error":"the stage isn't prepared","id":1}"#);
    let answer = ask(&mut stage, &mut scene, 0.0, r#"{"id": 2, "do": "status"}"#);
    assert_eq!(answer, r#"{"id":2,"moving":false,"position_mm":{"x":0.0,"y":0.0,"z":0.0}}"#);
    assert_eq!(scene.axis(Axis::Z, 9.0).0, POWER_ON.z_mm);
}

#[test]
fn a_stop_ends_a_search_for_home_with_an_error() {
    let mut scene = scene();
    let mut stage = ProcessStageEmulator::new(&scene);
    stage.answer(PREPARE.as_bytes(), &mut scene, 0.0);
    assert_eq!(scene.axis(Axis::X, 0.3).0, POWER_ON.x_mm, "x waits for z");
    stage.answer(br#"{"do": "stop"}"#, &mut scene, 0.3);
    let text = b"{\"error\":\"stopped while it was being prepared\",\"id\":2}\n".to_vec();
    assert_eq!(stage.owed(&mut scene, 1.0), Owed::Ready(text));
    // 0.3 s, 0.1 of them a ramp, and a brake like it
    assert!((scene.axis(Axis::Z, 9.0).0 - POWER_ON.z_mm - 3.0).abs() < 1e-9);
    assert!(
        ask(&mut stage, &mut scene, 9.0, r#"{"id": 1, "do": "move", "to_mm": {"z": 1}, "speed_mm_s": 1}"#)
            .contains("error")
    );
}

#[test]
fn a_load_cell_and_an_array_read_the_scene() {
    let mut scene = pressed(0.5);
    let mut cell = ProcessLoadCellEmulator;
    let identity = r#"{"id":1,"identity":"emulated load_cell, serial number 1","protocol":1,"role":"load_cell"}"#;
    assert_eq!(ask(&mut cell, &mut scene, 1.0, r#"{"id": 1, "do": "identify"}"#), identity);
    assert_eq!(ask(&mut cell, &mut scene, 1.0, r#"{"id": 2, "do": "read"}"#), r#"{"force_n":0.5,"id":2}"#);
    assert!(ask(&mut cell, &mut scene, 1.0, r#"{"id": 2, "do": "move"}"#).contains("error"));
    let mut array = ProcessArrayEmulator;
    let identity = r#"{"id":1,"identity":"emulated array, serial number 1","protocol":1,"role":"array","units":9}"#;
    assert_eq!(ask(&mut array, &mut scene, 1.0, r#"{"id": 1, "do": "identify"}"#), identity);
    let read: Value =
        serde_json::from_str(&ask(&mut array, &mut scene, 1.0, r#"{"id": 2, "do": "read"}"#)).expect("JSON");
    let outputs: Vec<f64> = serde_json::from_value(read["outputs"].clone()).expect("numbers");
    assert!(outputs.len() == 9 && (outputs[4] - 0.5).abs() < 1e-9, "{outputs:?}");
}

#[tokio::test(start_paused = true)]
async fn prepare_is_answered_when_all_axes_are_at_rest() {
    let scene = scene();
    let origin = Instant::now();
    let mut wire = Wire::to(shared(ProcessStageEmulator::new(&scene)), shared(scene), origin);
    assert_eq!(wire.ask(format!("{PREPARE}\n").as_bytes(), 9).await, b"{\"id\":2}\n");
    // z goes 4.5 mm and then y 2 mm at 10 mm/s, with 0.1 s for the ramps each
    let took_s = (Instant::now() - origin).as_secs_f64();
    assert!(took_s > 0.85 && took_s < 0.86, "{took_s}");
}

#[tokio::test(start_paused = true)]
async fn a_stop_that_comes_while_it_is_prepared_is_obeyed_at_once() {
    let scene = shared(scene());
    let stage = shared(ProcessStageEmulator::new(&scene.lock().expect("a scene")));
    let origin = Instant::now();
    let mut wire = Wire::to(stage, scene.clone(), origin);
    wire.send(format!("{PREPARE}\n").as_bytes()).await;
    palpate_link::time::sleep(Duration::from_millis(200)).await;
    wire.send(b"{\"do\": \"speed\", \"speed_mm_s\": 1}\n").await;
    let refused = b"{\"error\":\"the stage is being prepared\",\"id\":3}\n";
    let moved = b"{\"id\": 3, \"do\": \"move\", \"to_mm\": {\"x\": 1}, \"speed_mm_s\": 1}\n";
    assert_eq!(wire.ask(moved, refused.len()).await, refused);
    let text = b"{\"error\":\"stopped while it was being prepared\",\"id\":2}\n";
    assert_eq!(wire.ask(b"{\"do\": \"stop\"}\n", text.len()).await, text);
    // 10 mm/s take 0.1 s to brake
    let took_s = (Instant::now() - origin).as_secs_f64();
    assert!(took_s > 0.3 && took_s < 0.32, "{took_s}");
    let mut scene = scene.lock().expect("a scene");
    assert!((scene.axis(Axis::Z, 60.0).0 - POWER_ON.z_mm - 2.0).abs() < 0.1);
    assert_eq!(scene.axis(Axis::X, 60.0).0, POWER_ON.x_mm);
}

#[tokio::test(start_paused = true)]
async fn line_that_is_too_long_is_discarded() {
    let mut wire = Wire::to(shared(ProcessLoadCellEmulator), shared(scene()), Instant::now());
    wire.send(&vec![b' '; 64 * INBOX_MOST]).await;
    assert_eq!(wire.ask(b"\n{\"id\": 1, \"do\": \"read\"}\n", 23).await, b"{\"force_n\":0.0,\"id\":1}\n");
}

proptest! {
    #[test]
    fn emulator_survives_arbitrary_bytes(line in prop_oneof![
        prop::collection::vec(any::<u8>(), 0..200),
        "\\{\"id\": ?-?[0-9]{1,3}, ?\"do\": ?\"(move|status|prepare|stop|speed)\"(, ?\"(to_mm|travel_mm|speed_mm_s|away)\": ?([0-9]{1,3}|\\{\"z\": ?-?[0-9e]{1,4}\\}))*\\}".prop_map(String::into_bytes),
    ]) {
        let (mut stage, mut scene) = prepared();
        let mut inbox = [&line[..], b"\n"].concat();
        while let Some(request) = stage.take_request(&mut inbox) {
            stage.answer(&request, &mut scene, 20.0);
        }
        prop_assert!(scene.axis(Axis::Z, 100.0).0.abs() <= 12.5);
    }
}
