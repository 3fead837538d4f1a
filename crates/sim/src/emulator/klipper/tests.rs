//! Klipper behind Moonraker, request by request.

mod faults;

use super::KlipperFaultKind::{IdleTimeout, LostAnswer, McuRestart, MoonrakerRestart, Shutdown, SlowAnswer};
use super::*;
use crate::emulator::tests::{POWER_ON, Wire, scene, shared};
use palpate_core::quantity::Axis;
use palpate_link::time::{Instant, sleep_until, timeout};
use std::time::Duration;
use tokio::io::AsyncReadExt;

/// Lets the printer count 12.5 where it is switched on, without a search for home.
const PLACED: &str = "SET_KINEMATIC_POSITION X=12.5 Y=12.5 Z=12.5\nG91";

/// A printer and its scene on the wire.
struct KlipperBench {
    klipper: Shared<KlipperEmulator>,
    scene: Shared<Scene>,
    origin: Instant,
    wire: Wire,
}

impl KlipperBench {
    /// A frame whose middle is in the middle of the scene, and faults at their times.
    fn new(faults: &[(f64, KlipperFaultKind)]) -> Self {
        let faults = faults.iter().map(|&(from_s, kind)| KlipperFault { from_s, kind }).collect();
        let (min_ends_mm, lengths_mm) = ([-12.5; 3], [25.0; 3]);
        let board = KlipperBoard { min_ends_mm, lengths_mm, faults, ..KlipperBoard::default() };
        let (scene, origin) = (shared(scene()), Instant::now());
        let klipper = shared(KlipperEmulator::new(board, &lock(&scene)));
        let wire = Wire::to(klipper.clone(), scene.clone(), origin);
        KlipperBench { klipper, scene, origin, wire }
    }

    fn open(&self) -> Wire {
        Wire::to(self.klipper.clone(), self.scene.clone(), self.origin)
    }

    fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }

    async fn wait(&self, until_s: f64) {
        sleep_until(self.origin + Duration::from_secs_f64(until_s)).await;
    }

    async fn ask(&mut self, request: String) -> Value {
        self.wire.send(request.as_bytes()).await;
        read(&mut self.wire).await.1
    }

    async fn say(&mut self, text: &str) {
        assert_eq!(self.ask(script(text)).await["result"], "ok", "{text}");
    }

    /// Message of the error that a script ends with.
    async fn refused(&mut self, text: &str) -> String {
        let reply = self.ask(script(text)).await;
        assert_eq!(reply["error"]["code"], 400, "{text}");
        reply["error"]["message"].as_str().expect("a message").to_owned()
    }

    async fn field(&mut self, object: &str, field: &str) -> Value {
        let reply = self.ask(call("printer.objects.query", json!({"objects": {object: [field]}}))).await;
        reply["result"]["status"][object][field].clone()
    }

    /// Place of an axis at a time, mm, rounded to a nanometer.
    fn true_mm(&self, axis: Axis, at_s: f64) -> f64 {
        (lock(&self.scene).axis(axis, at_s).0 * 1e6).round() / 1e6
    }
}

fn call(method: &str, params: Value) -> String {
    let body = json!({"jsonrpc": "2.0", "method": method, "params": params, "id": 7}).to_string();
    let head = "POST /server/jsonrpc HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length:";
    format!("{head} {}\r\n\r\n{body}", body.len())
}

fn script(script: &str) -> String {
    call("printer.gcode.script", json!({"script": script}))
}

/// Reads the status and the body of one answer.
async fn read(wire: &mut Wire) -> (u16, Value) {
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        head.push(char::from(wire.stream().read_u8().await.expect("an answer")));
    }
    let length = head.split("Content-Length: ").nth(1).and_then(|rest| rest.lines().next()).expect("a length");
    let body = wire.ask(b"", length.parse().expect("a number")).await;
    (head[9..12].parse().expect("a status"), serde_json::from_slice(&body).expect("JSON"))
}

#[tokio::test(start_paused = true)]
async fn requests_come_in_pieces_or_together_and_each_is_answered() {
    let mut bench = KlipperBench::new(&[]);
    for piece in script("G91").repeat(3).as_bytes().chunks(29) {
        bench.wire.send(piece).await;
        tokio::task::yield_now().await;
    }
    for _ in 0..3 {
        assert_eq!(read(&mut bench.wire).await, (200, json!({"jsonrpc": "2.0", "result": "ok", "id": 7})));
    }
    assert_eq!(bench.ask(call("no.such", json!({}))).await["error"]["code"], -32601);
    assert_eq!(bench.ask(call("printer.gcode.script", json!({}))).await["error"]["code"], 400);
    let query = json!({"objects": {"toolhead": ["homed_axes", "foo"], "webhooks": null, "bar": null}});
    let found = json!({"toolhead": {"homed_axes": "", "foo": null}, "bar": {},
        "webhooks": {"state": "ready", "state_message": "Printer is ready"}});
    assert_eq!(bench.ask(call("printer.objects.query", query)).await["result"]["status"], found);
    bench.wire.send(b"GET /nowhere HTTP/1.1\r\n\r\n").await;
    assert_eq!(read(&mut bench.wire).await.0, 404);
    assert!(bench.wire.stream().read_u8().await.is_err(), "it hung up");
}

#[tokio::test(start_paused = true)]
async fn a_move_begins_late_and_m400_looks_every_tenth_of_a_second() {
    let mut bench = KlipperBench::new(&[]);
    bench.say(PLACED).await;
    bench.wait(10.0).await;
    bench.say("g1 Z-1.001F60 ; down\nM400").await;
    // 0.25 s, then 1 mm/s and 100 mm/s^2, in whole steps: 2.5 um each
    assert_eq!([bench.true_mm(Axis::Z, 10.25), bench.true_mm(Axis::Z, 11.3)], [8.0, 7.0]);
    assert!((bench.true_mm(Axis::Z, 10.7565) - 7.5).abs() < 0.001, "{}", bench.true_mm(Axis::Z, 10.7565));
    assert!((bench.now_s() - 11.302).abs() < 0.002, "{}", bench.now_s());
    assert_eq!(bench.field("toolhead", "position").await[2], 12.5 - 1.001);
    // half of a short move is made at a steady speed: the root of 0.9 mm times 1500 mm/s^2
    bench.wait(30.0).await;
    bench.say("G1 X0.9 F60000").await;
    assert!(bench.now_s() < 30.01);
    let speed_mm_s = (0.9_f64 * 1500.0).sqrt();
    let end_s = 30.251 + 0.45 / speed_mm_s + 2.0 * speed_mm_s / 3000.0;
    assert!((bench.true_mm(Axis::X, end_s - 0.01) + 0.1 + 0.15).abs() < 0.001);
    assert_eq!(bench.true_mm(Axis::X, end_s + 0.001), -0.1);
}

#[tokio::test(start_paused = true)]
async fn connections_share_the_printer_and_scripts_run_one_at_a_time() {
    let mut bench = KlipperBench::new(&[]);
    let mut other = bench.open();
    bench.say(&format!("{PLACED}\nSET_GCODE_OFFSET X=0.5\nG90\nG1 X18 F150")).await;
    assert!(bench.now_s() < 0.01);
    other.send(script("M400").as_bytes()).await;
    let mut at_mm = [0.0; 3];
    for (at_mm, at_s) in at_mm.iter_mut().zip([1.0, 1.1, 1.3]) {
        bench.wait(at_s).await;
        *at_mm = bench.field("motion_report", "live_position").await[0].as_f64().expect("a number");
    }
    // refreshed four times a second
    assert!(at_mm[0] > 12.5 && at_mm[0] == at_mm[1] && (at_mm[2] - at_mm[0] - 0.75).abs() < 0.02, "{at_mm:?}");
    assert_eq!(bench.field("toolhead", "position").await[0], 18.5);
    assert_eq!(bench.field("gcode_move", "gcode_position").await[0], 18.0);
    bench.say("G91").await;
    assert!((2.65..2.77).contains(&bench.now_s()), "{}", bench.now_s());
}

#[tokio::test(start_paused = true)]
async fn moves_are_refused_as_klipper_does_it() {
    let mut bench = KlipperBench::new(&[]);
    assert_eq!(bench.refused("G1 Z5").await, "Must home axis first: 0.000 0.000 5.000 [0.000]");
    assert_eq!(bench.refused("G28 Z").await, "No trigger on z after full movement");
    // one axis is given, and all count as homed
    bench.say("SET_KINEMATIC_POSITION Z=12.5").await;
    assert_eq!(bench.field("toolhead", "homed_axes").await, "xyz");
    assert_eq!(bench.refused("G1 X2\nG1 Z25.01\nG1 X3").await, "Move out of range: 2.000 0.000 25.010 [0.000]");
    assert_eq!(bench.field("gcode_move", "position").await, json!([2.0, 0.0, 12.5, 0.0]));
    assert_eq!(bench.refused("G1 X1.2.3").await, "Unable to parse move 'G1 X1.2.3'");
    assert_eq!(bench.refused("M220 Sx").await, "Error on 'M220 Sx': unable to parse ");
    assert_eq!(bench.refused("SET_GCODE_OFFSET Z").await, "Malformed command 'SET_GCODE_OFFSET Z'");
    bench.say("M84\nBED_MESH_CLEAR\nNO_SUCH_COMMAND").await;
    assert_eq!(bench.refused("G1 X1").await, "Must home axis first: 1.000 0.000 12.500 [0.000]");
}

#[tokio::test(start_paused = true)]
async fn a_script_moves_by_a_distance_and_restores_what_another_client_set() {
    let mut bench = KlipperBench::new(&[]);
    let by = "SAVE_GCODE_STATE NAME=palpate\nM83\nG91\nG1 Z-0.5 F300\nG90\nM400\nRESTORE_GCODE_STATE NAME=palpate";
    bench.say(PLACED).await;
    for other in [
        "G90",
        "G91",
        "G92 X0 Y0 Z0",
        "SET_GCODE_OFFSET Z=3",
        "SET_KINEMATIC_POSITION Z=20",
        "SET_GCODE_OFFSET Z_ADJUST=-0.25 MOVE=1",
    ] {
        bench.say(&format!("{other}\nM400")).await;
        let from_mm = bench.true_mm(Axis::Z, bench.now_s());
        let absolute = bench.field("gcode_move", "absolute_coordinates").await;
        bench.say(by).await;
        assert_eq!(bench.true_mm(Axis::Z, bench.now_s()), from_mm - 0.5, "{other}");
        assert_eq!(bench.field("gcode_move", "absolute_coordinates").await, absolute, "{other}");
    }
    assert_eq!(bench.true_mm(Axis::Z, bench.now_s()), POWER_ON.z_mm - 6.0 * 0.5 - 0.25);
    // a script that is refused ends there: what it set stays
    assert_eq!(bench.refused("RESTORE_GCODE_STATE NAME=other").await, "Unknown g-code state: other");
    bench.say("G90").await;
    assert!(
        bench.refused("SAVE_GCODE_STATE\nG91\nG1 Z-99\nRESTORE_GCODE_STATE").await.starts_with("Move out of range")
    );
    assert_eq!(bench.field("gcode_move", "absolute_coordinates").await, false);
    // the place is left, unless it is asked for
    bench.say("G90\nSAVE_GCODE_STATE\nG91\nG1 Z1 F300\nRESTORE_GCODE_STATE\nM400").await;
    assert_eq!(bench.true_mm(Axis::Z, bench.now_s()), POWER_ON.z_mm - 2.25);
    bench.say("RESTORE_GCODE_STATE MOVE=1 MOVE_SPEED=5\nM400").await;
    assert_eq!(bench.true_mm(Axis::Z, bench.now_s()), POWER_ON.z_mm - 3.25);
}

#[tokio::test(start_paused = true)]
async fn motors_are_switched_off_after_ten_minutes_and_the_axes_stay() {
    let mut bench = KlipperBench::new(&[(800.0, IdleTimeout)]);
    bench.say(&format!("{PLACED}\nG1 X1 F600\nM400")).await;
    for (until_s, homed) in [(600.0, "xyz"), (601.0, ""), (602.0, "xyz"), (801.0, "")] {
        bench.wait(until_s).await;
        if until_s == 602.0 {
            bench.say(PLACED).await;
        }
        assert_eq!(bench.field("toolhead", "homed_axes").await, homed);
        assert_eq!(bench.true_mm(Axis::X, until_s), POWER_ON.x_mm + 1.0);
    }
}

#[tokio::test(start_paused = true)]
async fn a_shutdown_or_a_restart_ends_the_motion() {
    let mut bench = KlipperBench::new(&[(1.0, Shutdown), (21.0, McuRestart)]);
    let message = bench.refused(&format!("{PLACED}\nG1 X10 F600\nM400\nG90")).await;
    assert!(message.starts_with("MCU 'mcu' shutdown: Timer too close\n") && message.ends_with("Printer is shutdown\n"));
    assert!(bench.now_s() < 1.11);
    assert!((6.4..6.6).contains(&bench.true_mm(Axis::X, 2.0)));
    assert_eq!(bench.field("webhooks", "state").await, "shutdown");
    assert_eq!(bench.refused("G91").await, message);
    bench.say("FIRMWARE_RESTART").await;
    assert_eq!(bench.ask(script("G91")).await["error"], json!({"code": 503, "message": "Klippy Host not connected"}));
    bench.wait(2.5).await;
    assert!(bench.refused("G91").await.starts_with("\nPrinter is not ready\n"));
    bench.wait(20.0).await;
    assert_eq!(bench.field("toolhead", "homed_axes").await, "");
    let lost = bench.ask(script(&format!("{PLACED}\nG1 X2 F60\nM400"))).await;
    assert_eq!(lost["error"], json!({"code": 503, "message": "Klippy Disconnected"}));
}

#[tokio::test(start_paused = true)]
async fn an_emergency_stop_passes_a_script_that_waits() {
    let mut bench = KlipperBench::new(&[]);
    bench.say(&format!("{PLACED}\nG1 X10 F600")).await;
    bench.wait(0.75).await;
    bench.wire.send(script("M400").as_bytes()).await;
    let mut other = bench.open();
    other.send(call("printer.emergency_stop", json!({})).as_bytes()).await;
    assert_eq!(read(&mut other).await.1["result"], "ok");
    assert!(bench.now_s() < 0.76);
    // the wait ends as if the motion had (toolhead.py, `wait_moves` without `can_pause`)
    assert_eq!(read(&mut bench.wire).await.1["result"], "ok");
    assert!(bench.refused("G90").await.starts_with("Shutdown due to webhooks request\n"));
    let x_mm = bench.true_mm(Axis::X, 5.0);
    assert!((3.9..4.2).contains(&x_mm), "{x_mm}");
    assert_eq!(bench.field("webhooks", "state").await, "shutdown");
    assert_eq!(bench.ask(call("printer.firmware_restart", json!({}))).await["result"], "ok");
    bench.wait(5.0).await;
    assert_eq!(bench.field("webhooks", "state").await, "ready");
}

#[tokio::test(start_paused = true)]
async fn answers_are_late_or_lost_and_moonraker_restarts() {
    let faults = [(0.0, SlowAnswer(3.0)), (4.0, LostAnswer), (10.0, MoonrakerRestart)];
    let mut bench = KlipperBench::new(&faults);
    bench.say(&format!("{PLACED}\nG1 X1 F600")).await;
    assert!((bench.now_s() - 3.0).abs() < 0.01);
    bench.wait(9.5).await;
    assert!(timeout(Duration::from_millis(400), bench.ask(script("G1 X1"))).await.is_err());
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
