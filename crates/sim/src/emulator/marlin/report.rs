//! What the board says: its banner, its settings, its place.

use super::planner::MarlinPlanner;
use crate::scene::Scene;

/// Temperatures, all heaters off.
pub(super) const TEMPERATURES: &str = " T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0";

/// Lines after a reset, behind its announcement. The settings follow.
pub(super) const BANNER: [&str; 6] = [
    "Marlin 2.1.2",
    "",
    "echo: Last Updated: 2022-12-17 | Author: (none, default config)",
    "echo: Compiled: Dec 17 2022",
    "echo: Free Memory: 4159  PlannerBufferBytes: 1200",
    "echo:Hardcoded Default Settings Loaded",
];

/// First line that answers M115.
pub(super) const FIRMWARE: &str = "FIRMWARE_NAME:Marlin 2.1.2 (Dec 17 2022 12:00:00) \
    SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0 MACHINE_TYPE:3D Printer EXTRUDER_COUNT:1 \
    UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff";

/// Capabilities that answer M115 on a build without bed levelling. Those that aren't stated are missing, too.
pub(super) const CAPABILITIES: &str = "SERIAL_XON_XOFF:0 BINARY_FILE_TRANSFER:0 EEPROM:0 VOLUMETRIC:1 AUTOREPORT_POS:0 \
    AUTOREPORT_TEMP:1 PROGRESS:0 PRINT_JOB:1 AUTOLEVEL:0 RUNOUT:0 Z_PROBE:0 LEVELING_DATA:0 BUILD_PERCENT:0 \
    SOFTWARE_POWER:0 TOGGLE_LIGHTS:0 EMERGENCY_PARSER:0 HOST_ACTION_COMMANDS:0 PROMPT_SUPPORT:0 SDCARD:0 \
    THERMAL_PROTECTION:1 MOTION_MODES:0 ARCS:0 BABYSTEPPING:0 CHAMBER_TEMPERATURE:0";

/// Returns the line of M114: what was requested last, and the steps at this moment.
pub(super) fn position(planner: &MarlinPlanner, scene: &Scene, now_s: f64) -> String {
    let [x_mm, y_mm, z_mm] = planner.logical_mm().map(|mm| decimals(mm, 2));
    let [x, y, z] = planner.steps(scene, now_s);
    format!("X:{x_mm} Y:{y_mm} Z:{z_mm} E:0.00 Count X:{x} Y:{y} Z:{z}")
}

/// Returns the setting of a command, such as M92, as a command that would write it.
pub(super) fn setting(planner: &MarlinPlanner, number: u32) -> Option<String> {
    let board = &planner.board;
    let axes = |values: [f64; 3], e: &str| {
        let [x, y, z] = values.map(|value| decimals(value, 2));
        format!("  M{number} X{x} Y{y} Z{z}{e}")
    };
    Some(match number {
        92 => axes(board.steps_per_mm, " E500.00"),
        201 => axes(board.acceleration_mm_s2, " E10000.00"),
        203 => axes(board.most_mm_s, " E25.00"),
        204 => format!("  M204 P3000.00 R3000.00 T{}", decimals(board.travel_acceleration_mm_s2, 2)),
        205 => "  M205 B20000.00 S0.00 T0.00 J0.01".into(),
        206 => axes([0.0; 3], ""),
        211 => format!("  M211 S{} ; {}", u8::from(planner.limits_softly), on_off(planner.limits_softly)),
        420 => format!("  M420 S{} Z0.00 ; Leveling {}", u8::from(planner.levels), on_off(planner.levels)),
        _ => return None,
    })
}

/// Returns the line of the software endstops' ends.
pub(super) fn soft_ends(planner: &MarlinPlanner) -> String {
    let [min, max] = planner.limits_mm().map(|ends_mm| {
        let [x, y, z] = ends_mm.map(|mm| decimals(mm, 2));
        format!("X{x} Y{y} Z{z}")
    });
    format!("  Min:  {min}   Max:  {max}")
}

/// Returns the lines of M503.
pub(super) fn settings(planner: &MarlinPlanner) -> Vec<String> {
    let heads = [
        (92, "Steps per unit"),
        (203, "Max feedrates (units/s)"),
        (201, "Max Acceleration (units/s2)"),
        (204, "Acceleration (units/s2) (P<print-accel> R<retract-accel> T<travel-accel>)"),
        (205, "Advanced (B<min_segment_time_us> S<min_feedrate> T<min_travel_feedrate> J<junc_dev>)"),
        (206, "Home offset"),
        (420, "Auto Bed Leveling"),
    ];
    let has = |number: u32| number != 420 || planner.board.bed_rise.is_some();
    let units = if planner.counts_in_inches() { "echo:  G20 ; (in)" } else { "echo:  G21 ; (mm)" };
    let mut lines: Vec<String> = vec!["echo:; Linear Units:".into(), units.into()];
    for (number, head) in heads.into_iter().filter(|(number, _)| has(*number)) {
        lines.push(format!("echo:; {head}:"));
        lines.extend(setting(planner, number).map(|setting| format!("echo:{setting}")));
    }
    lines
}

/// Marlin's words for a switch.
pub(super) fn on_off(on: bool) -> &'static str {
    if on { "ON" } else { "OFF" }
}

/// Formats a number with decimals. A number below zero has a sign, also if its decimals are zeros (`printNumber`, serial_base.h).
fn decimals(number: f64, decimals: i32) -> String {
    let scale = 10f64.powi(decimals);
    format!("{:.*}", decimals as usize, ((number + 0.0) * scale).round() / scale)
}
