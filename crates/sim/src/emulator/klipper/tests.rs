//! Klipper behind Moonraker, request by request.

mod bench;

use super::*;
use crate::emulator::tests::POWER_ON;
use bench::{KlipperBench, post, read, rpc};
use palpate_core::quantity::Axis;
use palpate_link::time::{sleep_until, timeout};
use serde_json::json;
use std::time::Duration;
use tokio::io::AsyncReadExt;

const HEAD: &str = "HTTP/1.1 200 OK\r\nServer: TornadoServer/6.4.0\r\nContent-Type: application/json; charset=UTF-8\r\n\
                    Date: Mon, 01 Jan 2024 00:00:00 GMT\r\n";
/// Lets the printer count 12.5 where it is switched on, without a search for home.
const PLACED: &str = "SET_KINEMATIC_POSITION X=12.5 Y=12.5 Z=12.5\nG91";

#[tokio::test(start_paused = true)]
async fn requests_and_answers_have_their_form_byte_by_byte() {
    let mut wire = KlipperBench::new(&[]).wire;
    let body = r#"{"jsonrpc":"2.0","method":"printer.gcode.script","params":{"script":"G91"},"id":5}"#;
    let request = format!(
        "POST /server/jsonrpc HTTP/1.1\r\nHost: printer:7125\r\nContent-Type: application/json\r\nContent-Length: 82\r\n\r\n{body}"
    );
    let answer = format!("{HEAD}Content-Length: 38\r\n\r\n{}", r#"{"jsonrpc":"2.0","result":"ok","id":5}"#);
    // split anywhere, and two at once
    for piece in request.as_bytes().chunks(29) {
        wire.send(piece).await;
        tokio::task::yield_now().await;
    }
    let twice = wire.ask(request.repeat(2).as_bytes(), 3 * answer.len()).await;
    assert_eq!(String::from_utf8_lossy(&twice), answer.repeat(3));
    for (body, answer) in [
        ("{", json!({"jsonrpc": "2.0", "error": {"code": -32700, "message": "Parse error"}, "id": null})),
        (
            r#"[{"jsonrpc":"2.0","method":"no.such","id":1},{"jsonrpc":"2.0","method":"printer.gcode.script","id":2}]"#,
            json!([
                {"jsonrpc": "2.0", "error": {"code": -32601, "message": "Method not found"}, "id": 1},
                {"jsonrpc": "2.0", "error": {"code": 400, "message": "Missing Argument [script]"}, "id": 2},
            ]),
        ),
    ] {
        assert_eq!(post(&mut wire, "/server/jsonrpc", body).await, (200, answer));
    }
    assert_eq!(wire.ask(b"nonsense\r\n\r\n", 28).await, b"HTTP/1.1 400 Bad Request\r\n\r\n");
    assert!(wire.stream().read_u8().await.is_err(), "it hung up");
}

#[tokio::test(start_paused = true)]
async fn the_rest_form_answers_in_its_own_way() {
    let mut bench = KlipperBench::new(&[]);
    let wire = &mut bench.wire;
    let (status, body) =
        read(wire, "GET /printer/objects/query?toolhead=homed_axes,foo&webhooks&bar HTTP/1.1\r\n\r\n").await;
    let found = json!({"toolhead": {"homed_axes": "", "foo": null}, "bar": {},
        "webhooks": {"state": "ready", "state_message": "Printer is ready"}});
    assert_eq!((status, &body["result"]["status"]), (200, &found));
    let script = "POST /printer/gcode/script?script=G91%0AG1+X1 HTTP/1.1\r\n\r\n";
    let (status, body) = read(wire, script).await;
    assert_eq!((status, &body["error"]["message"]), (400, &json!("Must home axis first: 1.000 0.000 0.000 [0.000]")));
    assert_eq!(read(wire, "GET /nowhere HTTP/1.1\r\n\r\n").await.0, 404);
    assert_eq!(read(wire, "GET /printer/restart HTTP/1.1\r\n\r\n").await.0, 405);
    assert_eq!(post(wire, "/printer/gcode/script", r#"{"script":"G90"}"#).await, (200, json!({"result": "ok"})));
}

#[tokio::test(start_paused = true)]
async fn a_move_begins_late_and_m400_looks_every_tenth_of_a_second() {
    let mut bench = KlipperBench::new(&[]);
    bench.say(PLACED).await;
    bench.wait(10.0).await;
    bench.say("G1 Z-1.001 F60\nM400").await;
    // 0.25 s, then 1 mm/s and 100 mm/s^2, in whole steps: 2.5 um each
    assert_eq!([bench.true_mm(Axis::Z, 10.25), bench.true_mm(Axis::Z, 11.3)], [8.0, 7.0]);
    assert!((bench.true_mm(Axis::Z, 10.7565) - 7.5).abs() < 0.001, "{}", bench.true_mm(Axis::Z, 10.7565));
    assert!((bench.now_s() - 11.302).abs() < 0.002, "{}", bench.now_s());
    assert_eq!(bench.field("toolhead", "position").await[2], 12.5 - 1.001);
    // without M400 it waits 0.1 s for more
    bench.wait(20.0).await;
    bench.say("G1 X1 F600").await;
    assert!(bench.now_s() < 20.01);
    assert_eq!([bench.true_mm(Axis::X, 20.35), bench.true_mm(Axis::X, 20.5)], [-1.0, 0.0]);
    // half of a short move is made at a steady speed: the root of 0.9 mm times 1500 mm/s^2
    bench.wait(30.0).await;
    bench.say("G1 X0.9 F60000\nM400").await;
    let speed_mm_s = (0.9_f64 * 1500.0).sqrt();
    let end_s = 30.251 + 0.45 / speed_mm_s + 2.0 * speed_mm_s / 3000.0;
    assert!((bench.true_mm(Axis::X, end_s - 0.01) - 0.9 + 0.15).abs() < 0.001);
    assert_eq!(bench.true_mm(Axis::X, end_s + 0.001), 0.9);
}

#[tokio::test(start_paused = true)]
async fn moves_are_refused_as_klipper_does_it() {
    let mut bench = KlipperBench::new(&[]);
    assert_eq!(bench.refused("G1 Z5").await, "Must home axis first: 0.000 0.000 5.000 [0.000]");
    // one axis is given, and all count as homed
    bench.say("SET_KINEMATIC_POSITION Z=12.5").await;
    assert_eq!(bench.field("toolhead", "homed_axes").await, "xyz");
    assert_eq!(bench.refused("G1 X2\nG1 Z25.01\nG1 X3").await, "Move out of range: 2.000 0.000 25.010 [0.000]");
    assert_eq!(bench.field("gcode_move", "position").await, json!([2.0, 0.0, 12.5, 0.0]));
    assert_eq!(bench.refused("G1 X1.2.3").await, "Unable to parse move 'G1 X1.2.3'");
    bench.say("M84").await;
    assert_eq!(bench.refused("G1 X1").await, "Must home axis first: 1.000 0.000 12.500 [0.000]");
    // an unknown command is a message
    bench.say("BED_MESH_CLEAR\nM114").await;
    let store = rpc(&mut bench.wire, "server.gcode_store", json!({"count": 2})).await;
    assert_eq!(store["result"]["gcode_store"][0]["message"], "// Unknown command:\"BED_MESH_CLEAR\"");
    assert_eq!(store["result"]["gcode_store"][1]["message"], "X:2.000 Y:0.000 Z:12.500 E:0.000");
    let mut bench = KlipperBench::on(KlipperBoard { enable_force_move: false, ..KlipperBoard::default() });
    bench.say("SET_KINEMATIC_POSITION Z=12.5").await;
    assert_eq!(bench.field("toolhead", "homed_axes").await, "");
}

#[tokio::test(start_paused = true)]
async fn homing_ends_at_the_endstops_while_another_connection_asks() {
    let mut bench = KlipperBench::new(&[]);
    let mut other = bench.open();
    let query = json!({"objects": {"toolhead": ["homed_axes"], "idle_timeout": ["state"]}});
    let origin = bench.origin;
    let (homed, asked) = tokio::join!(bench.script("G28"), async {
        sleep_until(origin + Duration::from_secs(2)).await;
        rpc(&mut other, "printer.objects.query", query).await
    });
    assert_eq!(homed["result"], "ok");
    assert_eq!(asked["result"]["status"]["idle_timeout"]["state"], "Printing");
    assert_eq!(asked["result"]["status"]["toolhead"]["homed_axes"], "xy");
    let end_s = bench.now_s();
    assert_eq!(Axis::ALL.map(|axis| bench.true_mm(axis, end_s)), [-12.5, -12.5, 12.5]);
    assert_eq!(bench.field("toolhead", "position").await, json!([0.0, 0.0, 25.0, 0.0]));
    bench.say("SET_GCODE_OFFSET Z=-0.5\nG1 X5 Y5 Z20 F6000\nM400\nFORCE_MOVE STEPPER=stepper_z DISTANCE=1 VELOCITY=5\nM400").await;
    assert_eq!(bench.field("motion_report", "live_position").await, json!([5.0, 5.0, 19.5, 0.0]));
    assert_eq!(bench.true_mm(Axis::Z, bench.now_s()), 8.0);
}

#[tokio::test(start_paused = true)]
async fn motors_are_switched_off_after_ten_minutes_and_the_axes_stay() {
    let mut bench = KlipperBench::new(&[(800.0, KlipperFaultKind::IdleTimeout)]);
    bench.say(&format!("{PLACED}\nG1 X1 F600\nM400")).await;
    bench.wait(600.0).await;
    assert_eq!(bench.field("idle_timeout", "state").await, "Ready");
    bench.wait(601.0).await;
    assert_eq!(bench.field("idle_timeout", "state").await, "Idle");
    assert_eq!(bench.true_mm(Axis::X, bench.now_s()), POWER_ON.x_mm + 1.0);
    bench.say(PLACED).await;
    bench.wait(801.0).await;
    assert!(bench.refused("G1 X1").await.starts_with("Must home axis first"));
}

#[tokio::test(start_paused = true)]
async fn a_shutdown_or_a_restart_ends_the_motion() {
    let faults = [(1.0, KlipperFaultKind::Shutdown), (21.0, KlipperFaultKind::McuRestart)];
    let mut bench = KlipperBench::new(&faults);
    let message = bench.refused(&format!("{PLACED}\nG1 X10 F600\nM400\nG90")).await;
    assert!(message.starts_with("MCU 'mcu' shutdown: Timer too close\n") && message.ends_with("Printer is shutdown\n"));
    assert!(bench.now_s() < 1.11);
    let x_mm = bench.true_mm(Axis::X, 2.0);
    assert!((6.4..6.6).contains(&x_mm), "{x_mm}");
    assert_eq!(bench.field("webhooks", "state").await, "shutdown");
    assert_eq!(bench.refused("G91").await, message);
    bench.say("FIRMWARE_RESTART").await;
    let gone = bench.script("G91").await;
    assert_eq!(gone["error"], json!({"code": 503, "message": "Klippy Host not connected"}));
    bench.wait(2.5).await;
    assert!(bench.refused("G91").await.starts_with("\nPrinter is not ready\n"));
    bench.wait(20.0).await;
    assert_eq!(bench.field("toolhead", "homed_axes").await, "");
    let lost = bench.script(&format!("{PLACED}\nG1 X2 F60\nM400")).await;
    assert_eq!(lost["error"], json!({"code": 503, "message": "Klippy Disconnected"}));
    // a wait that a shutdown ends is no error
    bench.wait(30.0).await;
    let (mut other, moves) = (bench.open(), format!("{PLACED}\nG1 X2 F60\nM400"));
    let until = bench.origin + Duration::from_secs(31);
    let stop = async { (sleep_until(until).await, rpc(&mut other, "printer.emergency_stop", json!({})).await) };
    assert_eq!(tokio::join!(bench.say(&moves), stop).1.1["result"], "ok");
    assert!(bench.now_s() < 31.11);
}

#[tokio::test(start_paused = true)]
async fn answers_are_late_or_lost_and_moonraker_restarts() {
    let faults = [
        (0.0, KlipperFaultKind::SlowAnswer(3.0)),
        (4.0, KlipperFaultKind::LostAnswer),
        (10.0, KlipperFaultKind::MoonrakerRestart),
    ];
    let mut bench = KlipperBench::new(&faults);
    bench.say(&format!("{PLACED}\nG1 X1 F600")).await;
    assert!((bench.now_s() - 3.0).abs() < 0.01);
    bench.wait(9.5).await;
    let lost = post(&mut bench.wire, "/printer/gcode/script", r#"{"script":"G1 X1"}"#);
    assert!(timeout(Duration::from_millis(400), lost).await.is_err());
    bench.wait(12.0).await;
    let mut fresh = bench.open();
    for wire in [&mut bench.wire, &mut fresh] {
        assert!(wire.stream().read_u8().await.is_err(), "it hung up");
    }
    bench.wait(13.1).await;
    bench.wire = bench.open();
    assert_eq!(bench.field("toolhead", "position").await, json!([14.5, 12.5, 12.5, 0.0]));
    assert_eq!(bench.true_mm(Axis::X, bench.now_s()), POWER_ON.x_mm + 2.0);
}
