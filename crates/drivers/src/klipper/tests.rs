//! The Klipper driver against a Moonraker that carries scripts out at once.

use super::Klipper;
use crate::script::{made_ready, usage};
use palpate_core::quantity::{Axis, Steps};
use palpate_link::device::{AxisWay, MotionOrders, Stage, StageUse};
use palpate_link::wire::Connector;
use serde_json::{Value, json};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};

/// A printer of 235 mm along each axis.
struct FakePrinter {
    at_mm: [f64; 3],
    homed: &'static str,
    /// What G92 shifted z by, mm.
    shift_mm: f64,
    knows_force_move: bool,
    job: &'static str,
    gear_ratio: Value,
    scripts: Vec<String>,
    /// Answers that are an error page of a proxy, and answers that never come.
    pages: usize,
    lost: usize,
    /// Whether it hangs up after each answer.
    hangs_up: bool,
}

impl Default for FakePrinter {
    fn default() -> Self {
        FakePrinter {
            at_mm: [0.0; 3],
            homed: "",
            shift_mm: 0.0,
            knows_force_move: true,
            job: "standby",
            gear_ratio: json!([]),
            scripts: Vec::new(),
            pages: 0,
            lost: 0,
            hangs_up: false,
        }
    }
}

type Fake = Arc<Mutex<FakePrinter>>;
type Change = fn(&mut FakePrinter);

impl FakePrinter {
    fn answer(&mut self, method: &str, params: &Value) -> Value {
        if method == "printer.info" {
            return json!({ "state": "ready", "software_version": "v0.12.0", "hostname": "bench" });
        }
        if method == "printer.gcode.script" {
            let script = params["script"].as_str().unwrap();
            self.scripts.push(script.to_owned());
            script.lines().for_each(|line| self.run(line));
            return json!("ok");
        }
        let stepper = |turn_mm: f64, gears: &Value| json!({ "rotation_distance": turn_mm, "microsteps": 16, "gear_ratio": gears, "position_min": 0.0, "position_max": 235.0 });
        let [x, y, z] = self.at_mm;
        json!({ "status": {
            "webhooks": { "state": "ready" },
            "toolhead": { "position": [x, y, z, 0.0], "homed_axes": self.homed },
            "motion_report": { "live_position": [x, y, z, 0.0] },
            "gcode_move": { "gcode_position": [x, y, z + self.shift_mm, 0.0] },
            "print_stats": { "state": self.job },
            "configfile": { "settings": {
                "printer": { "max_velocity": 300.0, "max_accel": 3000.0 },
                "stepper_x": stepper(40.0, &json!([])),
                "stepper_y": stepper(40.0, &json!([])),
                "stepper_z": stepper(8.0, &self.gear_ratio),
                "stepper_z1": {},
            } },
        } })
    }

    fn run(&mut self, line: &str) {
        let number =
            |word: &str| word.trim_start_matches(|c: char| c.is_ascii_alphabetic() || c == '=').parse().unwrap();
        let axis = |word: &str| "XYZ".find(&word[..1]);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("G1") => words
                .filter_map(|word| Some((axis(word)?, number(word))))
                .for_each(|(nth, mm): (usize, f64)| self.at_mm[nth] += mm),
            Some("SET_KINEMATIC_POSITION") if self.knows_force_move => {
                self.homed = "xyz";
                words.for_each(|word| self.at_mm[axis(word).unwrap()] = number(word));
            }
            _ => {}
        }
    }
}

async fn serve(fake: Fake, mut far: DuplexStream) {
    let (mut inbox, mut chunk) = (Vec::new(), [0; 4096]);
    while let Ok(count @ 1..) = far.read(&mut chunk).await {
        inbox.extend_from_slice(&chunk[..count]);
        let text = String::from_utf8(inbox.clone()).unwrap();
        let Some((head, body)) = text.split_once("\r\n\r\n") else { continue };
        assert!(
            head.starts_with(
                "POST /server/jsonrpc HTTP/1.1\r\nHost: printer:7125\r\nContent-Type: application/json\r\n"
            )
        );
        let length: usize = head.rsplit("Content-Length: ").next().unwrap().parse().unwrap();
        if body.len() < length {
            continue;
        }
        inbox.clear();
        let request: Value = serde_json::from_str(body).unwrap();
        let (answer, hangs_up) = {
            let mut fake = fake.lock().unwrap();
            let result = fake.answer(request["method"].as_str().unwrap(), &request["params"]);
            let body = json!({ "jsonrpc": "2.0", "result": result, "id": request["id"] }).to_string();
            let page = (502, "<html>Bad Gateway</html>".to_owned());
            let is_motion = body.contains("\"ok\"");
            let lost = is_motion && fake.lost > 0;
            fake.lost -= usize::from(lost);
            let (status, body) = if is_motion && fake.pages > 0 { page } else { (200, body) };
            fake.pages -= usize::from(status != 200);
            let message = format!("HTTP/1.1 {status} X\r\nContent-length: {}\r\n\r\n{body}", body.len());
            (if lost { String::new() } else { message }, fake.hangs_up)
        };
        far.write_all(answer.as_bytes()).await.unwrap();
        if hangs_up {
            return;
        }
    }
}

fn use_of_it() -> StageUse {
    StageUse { by_hand: true, steps: Steps { mm: [0.0125, 0.0125, 0.0025], ..Steps::FINE }, ..usage() }
}

fn printer(fake: &Fake) -> Klipper {
    let fake = fake.clone();
    let dial = move || {
        let (near, far) = duplex(1 << 16);
        tokio::spawn(serve(fake.clone(), far));
        near
    };
    Klipper::new(Connector::in_memory(dial), "tcp://printer:7125".to_owned())
}

async fn ready() -> (Fake, Klipper) {
    let fake = Fake::default();
    let mut stage = printer(&fake);
    let identity = made_ready(&mut stage, &use_of_it(), &MotionOrders::default()).await.unwrap();
    assert_eq!(identity.identity, "Klipper v0.12.0 on bench");
    (fake, stage)
}

async fn moved(stage: &mut Klipper, targets: &[(Axis, f64)]) -> Result<Vec<f64>, String> {
    let orders = MotionOrders::default();
    let axes: Vec<Axis> = targets.iter().map(|(axis, _)| *axis).collect();
    let mut ways = Vec::new();
    for (axis, to_mm) in targets {
        let from_mm = match stage.at_mm {
            Some(at_mm) => at_mm[axis.index()],
            None => stage.position_mm(*axis, &orders).await.unwrap(),
        };
        ways.push(AxisWay::between(*axis, from_mm, *to_mm));
    }
    stage.begin(&ways, 2.0, &orders).await.map_err(|error| error.to_string())?;
    stage.follow(&axes, Duration::from_secs(1), &orders).await.map_err(|error| error.to_string())
}

#[tokio::test(start_paused = true)]
async fn each_motion_is_one_script_that_sets_what_it_needs() {
    let (fake, mut stage) = ready().await;
    // the middle of the rig's travel is in the middle of the printer's
    assert_eq!(fake.lock().unwrap().at_mm, [117.5; 3]);
    let first = fake.lock().unwrap().scripts[0].clone();
    for motor in ["stepper_x", "stepper_y", "stepper_z", "stepper_z1"] {
        assert!(first.contains(&format!("SET_STEPPER_ENABLE STEPPER={motor} ENABLE=1\n")), "{first}");
    }
    assert_eq!(moved(&mut stage, &[(Axis::Z, -1.0)]).await.unwrap(), [-1.0]);
    assert_eq!(moved(&mut stage, &[(Axis::X, 3.0), (Axis::Y, 4.0)]).await.unwrap(), [3.0, 4.0]);
    let scripts = fake.lock().unwrap().scripts.clone();
    let setup = "BED_MESH_CLEAR\nSET_VELOCITY_LIMIT ACCEL=100\nM220 S100\n";
    assert_eq!(scripts[scripts.len() - 2], format!("{setup}G91\nG1 Z-1.000000 F120.000\nG90\nM400"));
    assert_eq!(scripts[scripts.len() - 1], format!("{setup}G91\nG1 X3.000000 Y4.000000 F150.000\nG90\nM400"));
}

#[tokio::test(start_paused = true)]
async fn what_somebody_else_changed_stops_a_motion_but_not_the_way_out() {
    let cases: [(Change, &str); 2] = [
        (|fake| fake.at_mm[0] += 10.0, "x was sent to 0.0000 mm but is at 10.0000 mm: something else moved it"),
        (|fake| fake.shift_mm = 0.5, "its G-code coordinates were shifted by somebody else"),
    ];
    for (change, expected) in cases {
        let (fake, mut stage) = ready().await;
        change(&mut fake.lock().unwrap());
        let refused = moved(&mut stage, &[(Axis::Z, -1.0)]).await.unwrap_err();
        assert!(refused.contains(expected), "{refused}");
        assert_eq!(fake.lock().unwrap().at_mm[2], 117.5, "nothing moved");
        // usage() presses toward smaller z
        assert_eq!(moved(&mut stage, &[(Axis::Z, 1.0)]).await.unwrap(), [1.0]);
    }
}

#[tokio::test(start_paused = true)]
async fn a_printer_that_may_not_be_used_is_refused_and_left_alone() {
    let cases: [(Change, &str, usize); 4] = [
        (|fake| fake.job = "printing", "it is printing a job: nothing was changed", 0),
        (|fake| fake.gear_ratio = json!([[80.0, 16.0]]), "a step of z is 0.000500 mm by [stepper_z]", 0),
        (|fake| fake.knows_force_move = false, "add [force_move] with `enable_force_move: True`", 2),
        (|fake| (fake.homed, fake.at_mm) = ("xyz", [117.5, 117.5, 130.0]), "z was at 12.50 mm by its count", 1),
    ];
    for (change, expected, scripts) in cases {
        let fake = Fake::default();
        change(&mut fake.lock().unwrap());
        let refused = made_ready(&mut printer(&fake), &use_of_it(), &MotionOrders::default()).await.unwrap_err();
        assert!(refused.to_string().contains(expected), "{refused}");
        assert_eq!(fake.lock().unwrap().scripts.len(), scripts, "{expected}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_motion_whose_answer_was_lost_is_awaited_before_the_next() {
    for change in [(|fake| fake.pages = 1) as Change, |fake| fake.lost = 1] {
        let (fake, mut stage) = ready().await;
        change(&mut fake.lock().unwrap());
        moved(&mut stage, &[(Axis::Z, -1.0)]).await.unwrap_err();
        assert_eq!(moved(&mut stage, &[(Axis::Z, 1.0)]).await.unwrap(), [1.0]);
        let scripts = fake.lock().unwrap().scripts.clone();
        assert_eq!(scripts[scripts.len() - 2], "M400");
    }
}

#[tokio::test(start_paused = true)]
async fn a_connection_that_a_proxy_closed_is_opened_again() {
    let (fake, mut stage) = ready().await;
    fake.lock().unwrap().hangs_up = true;
    for z_mm in [-1.0, -2.0] {
        tokio::time::sleep(Duration::from_secs(60)).await;
        assert_eq!(moved(&mut stage, &[(Axis::Z, z_mm)]).await.unwrap(), [z_mm]);
    }
}
