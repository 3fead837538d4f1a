//! Moonraker's methods over JSON-RPC, and the objects of Klipper that they read (Moonraker's docs/external_api and
//! klippy_connection.py, Klipper's docs/Status_Reference.md).

use super::board::KlipperBoard;
use super::printer::{KlipperPrinter, Outcome};
use super::{Turn, http};
use crate::scene::Scene;
use palpate_core::quantity::Axis;
use serde_json::{Value, json};
use std::sync::{Arc, OnceLock};

/// Carries out a call, or begins to.
pub(super) fn call(body: &[u8], printer: &mut KlipperPrinter, scene: &mut Scene, now_s: f64) -> Turn {
    let error = |code, message: &str| Err((code, message.to_owned()));
    let call: Value = serde_json::from_slice(body).unwrap_or_default();
    let (state, message) = (printer.klippy.name, printer.klippy.message.clone());
    let outcome = match call["method"].as_str().filter(|_| call["jsonrpc"] == "2.0") {
        None if call.is_null() => error(-32700, "Parse error"),
        None => error(-32600, "Invalid Request"),
        Some("server.info") => Ok(json!({
            "klippy_connected": state != "disconnected", "klippy_state": state, "warnings": [], "failed_components": [],
            "moonraker_version": "v0.8.0", "api_version": [1, 4, 0], "api_version_string": "1.4.0",
        })),
        Some(_) if state == "disconnected" => error(503, "Klippy Host not connected"),
        Some("printer.info") => Ok(json!({
            "state": state, "state_message": message, "hostname": "printer", "software_version": "v0.12.0",
        })),
        Some("printer.objects.query") => query(&call["params"]["objects"], printer, now_s),
        Some("printer.gcode.script") => match call["params"]["script"].as_str() {
            Some(script) => return Turn::Called(call["id"].clone(), printer.begin(script, scene, now_s)),
            None => error(400, "Missing Argument [script]"),
        },
        Some("printer.emergency_stop") => {
            printer.shut_down("Shutdown due to webhooks request", scene, now_s);
            Ok("ok".into())
        }
        Some("printer.restart" | "printer.firmware_restart") => {
            printer.restart(scene, now_s);
            Ok("ok".into())
        }
        Some(_) => error(-32601, "Method not found"),
    };
    Turn::Called(call["id"].clone(), Arc::new(OnceLock::from(outcome)))
}

/// Returns the answer to a call.
pub(super) fn answer(id: &Value, outcome: &Outcome, closes: bool) -> Vec<u8> {
    let body = match outcome {
        Ok(result) => json!({"jsonrpc": "2.0", "result": result, "id": id}),
        Err((code, message)) => json!({"jsonrpc": "2.0", "error": {"code": code, "message": message}, "id": id}),
    };
    http::answer("200 OK", &body.to_string(), closes)
}

/// Answers a query: for each object its fields, or all fields if null is given. Unknown objects have none, and unknown fields are
/// null.
fn query(objects: &Value, printer: &mut KlipperPrinter, now_s: f64) -> Outcome {
    let objects = objects.as_object().ok_or((400, "Missing Argument [objects]".to_owned()))?;
    let mut status = json!({});
    for (name, wanted) in objects {
        let all = object(name, printer, now_s);
        status[name] = match wanted.as_array() {
            Some(fields) => fields.iter().filter_map(Value::as_str).map(|field| (field, all[field].clone())).collect(),
            None => all,
        };
    }
    Ok(json!({"eventtime": now_s, "status": status}))
}

/// Fields of an object.
fn object(name: &str, printer: &mut KlipperPrinter, now_s: f64) -> Value {
    let (toolhead, gcode) = (&mut printer.toolhead, &printer.gcode.now);
    let four = |[x_mm, y_mm, z_mm]: [f64; 3]| json!([x_mm, y_mm, z_mm, 0.0]); // with an extruder
    match name {
        "webhooks" => json!({"state": printer.klippy.name, "state_message": printer.klippy.message}),
        "toolhead" => {
            let homed = Axis::ALL.into_iter().filter(|axis| toolhead.homed[axis.index()]);
            json!({
                "homed_axes": homed.map(Axis::name).collect::<String>(),
                "axis_minimum": four([0.0; 3]), "axis_maximum": four(toolhead.board.lengths_mm),
                "print_time": toolhead.print_time_s, "estimated_print_time": now_s, "position": four(toolhead.commanded_mm),
                "max_velocity": toolhead.board.max_velocity_mm_s, "max_accel": toolhead.board.max_accel_mm_s2,
                "max_accel_to_decel": toolhead.accel_to_decel_mm_s2,
            })
        }
        "motion_report" => {
            let (at_mm, speed_mm_s) = toolhead.live(now_s);
            json!({"live_position": four(at_mm), "live_velocity": speed_mm_s, "live_extruder_velocity": 0.0})
        }
        "gcode_move" => json!({
            "speed_factor": gcode.factor, "speed": 60.0 * gcode.speed_mm_s / gcode.factor,
            "absolute_coordinates": gcode.absolute,
            "homing_origin": four(gcode.offset_mm), "position": four(gcode.last_mm),
            "gcode_position": four(std::array::from_fn(|n| gcode.last_mm[n] - gcode.base_mm[n])),
        }),
        "configfile" => json!({"settings": settings(&printer.stock)}),
        _ => json!({}),
    }
}

/// The configuration with all defaults.
fn settings(board: &KlipperBoard) -> Value {
    let mut settings = json!({
        "printer": {
            "max_velocity": board.max_velocity_mm_s, "max_accel": board.max_accel_mm_s2,
            "max_z_velocity": board.max_z_velocity_mm_s, "max_z_accel": board.max_z_accel_mm_s2,
        },
        "idle_timeout": {"timeout": board.idle_timeout_s},
        "force_move": {"enable_force_move": board.enable_force_move},
    });
    for axis in Axis::ALL {
        settings[format!("stepper_{}", axis.name())] = json!({
            "rotation_distance": 200.0 * 16.0 / board.steps_per_mm[axis.index()],
            "full_steps_per_rotation": 200, "microsteps": 16,
            "position_min": 0.0, "position_max": board.lengths_mm[axis.index()],
        });
    }
    settings
}
