//! Printer objects and their fields (Klipper's docs/Status_Reference.md).

use super::board::KlipperBoard;
use super::printer::{KlipperPrinter, Outcome};
use palpate_core::quantity::Axis;
use serde_json::{Map, Value, json};

/// Time of the host's clock when the microcontroller's is 0, s.
const EVENT_TIME_S: f64 = 4711.25;
/// Full steps of a motor's turn, and microsteps of each.
const STEPS_PER_TURN: (f64, f64) = (200.0, 16.0);

/// Names of the objects.
pub(super) fn names(board: &KlipperBoard) -> Vec<&'static str> {
    let stock = ["webhooks", "configfile", "gcode_move", "stepper_enable", "idle_timeout", "motion_report", "toolhead"];
    stock.into_iter().chain(board.has_bed_mesh.then_some("bed_mesh")).collect()
}

/// Answers a query: for each object its fields, or all fields if null is given. Unknown objects have none, and unknown fields are
/// null.
pub(super) fn query(objects: &Map<String, Value>, printer: &mut KlipperPrinter, now_s: f64) -> Outcome {
    let mut status = Map::new();
    for (name, wanted) in objects {
        let all = object(name, printer, now_s);
        let fields = match wanted {
            Value::Null => all,
            Value::Array(fields) => {
                let field = |field: &Value| {
                    let field = field.as_str().ok_or((400, "Invalid argument".to_owned()))?;
                    Ok((field.to_owned(), all[field].clone()))
                };
                Value::Object(fields.iter().map(field).collect::<Result<_, _>>()?)
            }
            _ => return Err((400, "Invalid argument".into())),
        };
        status.insert(name.clone(), fields);
    }
    Ok(json!({"eventtime": EVENT_TIME_S + now_s, "status": status}))
}

fn object(name: &str, printer: &mut KlipperPrinter, now_s: f64) -> Value {
    let toolhead = &mut printer.toolhead;
    match name {
        "webhooks" => json!({"state": printer.klippy.name(), "state_message": printer.klippy.message()}),
        "toolhead" => {
            let homed: String =
                ["x", "y", "z"].into_iter().zip(toolhead.homed).filter(|axis| axis.1).map(|axis| axis.0).collect();
            json!({
                "homed_axes": homed,
                "axis_minimum": with_extruder([0.0; 3]),
                "axis_maximum": with_extruder(toolhead.board.lengths_mm),
                "print_time": toolhead.plan.print_time_s,
                "stalls": 0,
                "estimated_print_time": now_s,
                "extruder": "",
                "position": with_extruder(toolhead.commanded_mm),
                "max_velocity": toolhead.max_velocity_mm_s,
                "max_accel": toolhead.max_accel_mm_s2,
                "max_accel_to_decel": toolhead.accel_to_decel_mm_s2,
                "square_corner_velocity": toolhead.square_corner_mm_s,
            })
        }
        "motion_report" => {
            let (at_mm, speed_mm_s) = toolhead.live(now_s);
            json!({
                "live_position": with_extruder(at_mm),
                "live_velocity": speed_mm_s,
                "live_extruder_velocity": 0.0,
                "steppers": steppers(|_| Value::Null).as_object().map(|names| names.keys().cloned().collect::<Vec<_>>()),
                "trapq": ["toolhead"],
            })
        }
        "gcode_move" => json!({
            "speed_factor": printer.gcode.factor,
            "speed": printer.gcode.feed_mm_min(),
            "extrude_factor": 1.0,
            "absolute_coordinates": printer.gcode.absolute,
            "absolute_extrude": true,
            "homing_origin": with_extruder(printer.gcode.offset_mm),
            "position": with_extruder(printer.gcode.last_mm),
            "gcode_position": with_extruder(printer.gcode.position_mm()),
        }),
        "idle_timeout" => {
            let (state, printing_s) = printer.activity(now_s);
            json!({"state": state, "printing_time": printing_s})
        }
        "stepper_enable" => json!({"steppers": steppers(|n| toolhead.enabled[n].into())}),
        "configfile" => json!({
            "config": {},
            "settings": settings(&toolhead.board),
            "warnings": [],
            "save_config_pending": false,
            "save_config_pending_items": {},
        }),
        "bed_mesh" if toolhead.board.has_bed_mesh => {
            json!({"profile_name": "", "mesh_min": [0.0, 0.0], "mesh_max": [0.0, 0.0], "probed_matrix": [[]], "mesh_matrix": [[]]})
        }
        _ => json!({}),
    }
}

/// The configuration with all defaults.
fn settings(board: &KlipperBoard) -> Value {
    let stepper = |n: usize| {
        json!({
            "rotation_distance": STEPS_PER_TURN.0 * STEPS_PER_TURN.1 / board.steps_per_mm[n],
            "microsteps": STEPS_PER_TURN.1 as u64,
            "full_steps_per_rotation": STEPS_PER_TURN.0 as u64,
            "position_min": 0.0,
            "position_max": board.lengths_mm[n],
            "position_endstop": board.endstop_mm(n),
            "homing_speed": board.homing_mm_s[n],
            "second_homing_speed": board.homing_mm_s[n] / 2.0,
            "homing_retract_dist": KlipperBoard::RETRACT_MM,
            "homing_retract_speed": board.homing_mm_s[n],
            "homing_positive_dir": board.homes_to_plus[n],
        })
    };
    let mut settings = steppers(stepper);
    settings["printer"] = json!({
        "kinematics": "cartesian",
        "max_velocity": board.max_velocity_mm_s,
        "max_accel": board.max_accel_mm_s2,
        "max_accel_to_decel": board.max_accel_mm_s2 / 2.0,
        "square_corner_velocity": KlipperBoard::SQUARE_CORNER_MM_S,
        "max_z_velocity": board.max_z_velocity_mm_s,
        "max_z_accel": board.max_z_accel_mm_s2,
    });
    settings["idle_timeout"] = json!({"timeout": board.idle_timeout_s, "gcode": "\nTURN_OFF_HEATERS\nM84\n"});
    settings["force_move"] = json!({"enable_force_move": board.enable_force_move});
    if board.has_bed_mesh {
        settings["bed_mesh"] = json!({"speed": 50.0, "horizontal_move_z": 5.0});
    }
    settings
}

/// An object with a value for each stepper.
fn steppers(value: impl Fn(usize) -> Value) -> Value {
    let names = ["stepper_x", "stepper_y", "stepper_z"];
    Axis::ALL
        .into_iter()
        .map(|axis| (names[axis.index()].to_owned(), value(axis.index())))
        .collect::<Map<_, _>>()
        .into()
}

/// Coordinates as Klipper reports them, with a fourth one.
fn with_extruder([x_mm, y_mm, z_mm]: [f64; 3]) -> Value {
    json!([x_mm, y_mm, z_mm, 0.0])
}
