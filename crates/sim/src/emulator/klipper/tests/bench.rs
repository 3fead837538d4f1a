//! A printer on the wire, and a client.

use super::super::{KlipperBoard, KlipperEmulator, KlipperFault, KlipperFaultKind};
use crate::emulator::Shared;
use crate::emulator::tests::{Wire, scene, shared};
use crate::scene::Scene;
use palpate_core::quantity::Axis;
use palpate_link::time::{Instant, sleep_until};
use serde_json::{Value, json};
use std::time::Duration;
use tokio::io::AsyncReadExt;

/// A printer and its scene on the wire.
pub(super) struct KlipperBench {
    klipper: Shared<KlipperEmulator>,
    scene: Shared<Scene>,
    pub(super) origin: Instant,
    pub(super) wire: Wire,
}

impl KlipperBench {
    /// A printer with faults at their times.
    pub(super) fn new(faults: &[(f64, KlipperFaultKind)]) -> Self {
        let faults = faults.iter().map(|&(from_s, kind)| KlipperFault { from_s, kind }).collect();
        KlipperBench::on(KlipperBoard { faults, ..KlipperBoard::default() })
    }

    /// A frame whose middle is in the middle of the scene. z homes up.
    pub(super) fn on(board: KlipperBoard) -> Self {
        let homes_to_plus = [false, false, true];
        let board = KlipperBoard { min_ends_mm: [-12.5; 3], lengths_mm: [25.0; 3], homes_to_plus, ..board };
        let scene = scene();
        let klipper = shared(KlipperEmulator::new(board, &scene));
        let (scene, origin) = (shared(scene), Instant::now());
        let wire = Wire::to(klipper.clone(), scene.clone(), origin);
        KlipperBench { klipper, scene, origin, wire }
    }

    /// A further connection.
    pub(super) fn open(&self) -> Wire {
        Wire::to(self.klipper.clone(), self.scene.clone(), self.origin)
    }

    /// Time of the scene, s.
    pub(super) fn now_s(&self) -> f64 {
        self.origin.elapsed().as_secs_f64()
    }

    /// Waits until a time.
    pub(super) async fn wait(&self, until_s: f64) {
        sleep_until(self.origin + Duration::from_secs_f64(until_s)).await;
    }

    /// Answer to a script.
    pub(super) async fn script(&mut self, script: &str) -> Value {
        rpc(&mut self.wire, "printer.gcode.script", json!({"script": script})).await
    }

    /// Sends a script that succeeds.
    pub(super) async fn say(&mut self, script: &str) {
        assert_eq!(self.script(script).await["result"], "ok", "{script}");
    }

    /// Message of the error that a script ends with.
    pub(super) async fn refused(&mut self, script: &str) -> String {
        let reply = self.script(script).await;
        assert_eq!(reply["error"]["code"], 400, "{script}");
        reply["error"]["message"].as_str().expect("a message").to_owned()
    }

    /// A field of an object.
    pub(super) async fn field(&mut self, object: &str, field: &str) -> Value {
        let reply = rpc(&mut self.wire, "printer.objects.query", json!({"objects": {object: [field]}})).await;
        reply["result"]["status"][object][field].clone()
    }

    /// Place of an axis at a time, mm, rounded to a nanometer.
    pub(super) fn true_mm(&self, axis: Axis, at_s: f64) -> f64 {
        (self.scene.lock().expect("a scene").axis(axis, at_s).0 * 1e6).round() / 1e6
    }
}

/// Sends a request with JSON.
pub(super) async fn post(wire: &mut Wire, path: &str, body: &str) -> (u16, Value) {
    let length = body.len();
    let head = format!("POST {path} HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n\r\n");
    read(wire, &(head + body)).await
}

/// Sends a request, and reads the status and the body of one answer.
pub(super) async fn read(wire: &mut Wire, request: &str) -> (u16, Value) {
    wire.send(request.as_bytes()).await;
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        head.push(char::from(wire.stream().read_u8().await.expect("an answer")));
    }
    let length = head.split("Content-Length: ").nth(1).and_then(|rest| rest.lines().next()).expect("a length");
    let body = wire.ask(b"", length.parse().expect("a number")).await;
    (head[9..12].parse().expect("a status"), serde_json::from_slice(&body).expect("JSON"))
}

/// Calls a method, and reads the answer.
pub(super) async fn rpc(wire: &mut Wire, method: &str, params: Value) -> Value {
    let call = json!({"jsonrpc": "2.0", "method": method, "params": params, "id": 7});
    post(wire, "/server/jsonrpc", &call.to_string()).await.1
}
