//! What each command does (Klipper's klippy/extras/gcode_move.py, force_move.py, idle_timeout.py, stepper_enable.py and
//! klippy/toolhead.py).

use super::gcode::GcodeLine;
use super::klippy::Klippy;
use super::printer::{KlipperPrinter, Stall, Then};
use crate::scene::Scene;
use std::collections::VecDeque;

/// Time from one look at a wait for the end of the moves to the next, s (`wait_moves`).
pub(super) const POLL_S: f64 = 0.1;
/// Pause before a restart, s.
const BEFORE_RESTART_S: f64 = 0.5;
/// Version of the host software.
pub(super) const VERSION: &str = "v0.12.0";
/// Commands that are known before Klipper is ready, and after it has shut down.
const ALWAYS: [&str; 11] =
    ["M105", "M21", "M110", "M112", "M115", "M114", "RESTART", "FIRMWARE_RESTART", "ECHO", "STATUS", "GET_POSITION"];

/// Coordinates of the commands.
pub(super) struct GcodeMove {
    pub absolute: bool,
    /// Position at which the coordinates are 0, mm.
    base_mm: [f64; 3],
    /// End of the last move, mm.
    pub last_mm: [f64; 3],
    /// Offset of SET_GCODE_OFFSET, mm.
    pub offset_mm: [f64; 3],
    /// Speed of moves, with the factor, mm/s.
    speed_mm_s: f64,
    /// Factor of M220.
    pub factor: f64,
}

impl Default for GcodeMove {
    fn default() -> Self {
        let zero = [0.0; 3];
        GcodeMove { absolute: true, base_mm: zero, last_mm: zero, offset_mm: zero, speed_mm_s: 25.0, factor: 1.0 }
    }
}

impl GcodeMove {
    /// End of the last move in the coordinates of the commands, mm.
    pub(super) fn position_mm(&self) -> [f64; 3] {
        std::array::from_fn(|n| self.last_mm[n] - self.base_mm[n])
    }

    /// Speed as a command states it, mm/min.
    pub(super) fn feed_mm_min(&self) -> f64 {
        60.0 * self.speed_mm_s / self.factor
    }

    /// Applies the words of a move.
    fn go(&mut self, line: &GcodeLine<'_>) -> Result<(), String> {
        let unread = |_| format!("Unable to parse move '{}'", line.text);
        for (n, value_mm) in line.axes().map_err(unread)?.into_iter().enumerate() {
            if let Some(value_mm) = value_mm {
                self.last_mm[n] = value_mm + if self.absolute { self.base_mm[n] } else { self.last_mm[n] };
            }
        }
        match line.number("F").map_err(unread)? {
            Some(feed) if feed <= 0.0 => return Err(format!("Invalid speed in '{}'", line.text)),
            Some(feed) => self.speed_mm_s = feed / 60.0 * self.factor,
            None => {}
        }
        Ok(())
    }

    /// Gives the last position other coordinates (G92).
    fn set(&mut self, line: &GcodeLine<'_>) -> Result<(), String> {
        let values_mm = line.axes()?;
        let all = values_mm == [None; 3] && line.get("E")?.is_none();
        for (n, value_mm) in values_mm.into_iter().enumerate() {
            if let Some(value_mm) = value_mm.or(all.then_some(0.0)) {
                self.base_mm[n] = self.last_mm[n] - value_mm;
            }
        }
        Ok(())
    }

    /// Shifts the coordinates (SET_GCODE_OFFSET). Returns the speed if the tool is to move along, mm/s.
    fn shift(&mut self, line: &GcodeLine<'_>) -> Result<Option<f64>, String> {
        let moves = line.number("MOVE")?.unwrap_or(0.0) != 0.0;
        for (n, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
            let more_mm = line.number(&format!("{axis}_ADJUST"))?.map(|more_mm| self.offset_mm[n] + more_mm);
            let Some(offset_mm) = line.number(axis)?.or(more_mm) else { continue };
            let by_mm = offset_mm - self.offset_mm[n];
            self.base_mm[n] += by_mm;
            self.offset_mm[n] = offset_mm;
            self.last_mm[n] += if moves { by_mm } else { 0.0 };
        }
        Ok(line.above_zero("MOVE_SPEED")?.or(Some(self.speed_mm_s)).filter(|_| moves))
    }
}

impl KlipperPrinter {
    /// Executes a line. Returns what the script waits for then. The error ends the script.
    pub(super) fn execute(&mut self, line: &str, scene: &mut Scene, now_s: f64) -> Result<Option<Stall>, String> {
        let line = GcodeLine::parse(line);
        let ready = matches!(self.klippy, Klippy::Ready);
        let command = line.command.as_str();
        if !ready && !ALWAYS.contains(&command) {
            return Err(self.klippy.message());
        }
        let (force, mesh) = (self.toolhead.board.enable_force_move, self.toolhead.board.has_bed_mesh);
        match command {
            "" | "G21" | "M21" | "M82" | "M83" | "M105" | "M107" | "M110" => {}
            "G0" | "G1" => {
                self.gcode.go(&line)?;
                self.toolhead.add(self.gcode.last_mm, self.gcode.speed_mm_s, scene, now_s)?;
                return Ok(self.room(now_s));
            }
            "G4" => {
                let pause_ms = line.number("P")?.unwrap_or(0.0);
                if pause_ms < 0.0 {
                    return Err(format!("Error on '{}': P must have minimum of 0.0", line.text));
                }
                self.toolhead.dwell(pause_ms / 1000.0, scene, now_s);
                return Ok(self.room(now_s));
            }
            "G20" => return Err("Machine does not support G20 (inches) command".into()),
            "G28" => {
                let mut axes = VecDeque::new();
                for (n, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
                    if line.get(axis)?.is_some() {
                        axes.push_back(n);
                    }
                }
                let axes = if axes.is_empty() { (0..3).collect() } else { axes };
                return Ok(Some(self.home(axes, scene, now_s)));
            }
            "G90" | "G91" => self.gcode.absolute = command == "G90",
            "G92" => self.gcode.set(&line)?,
            "M18" | "M84" => self.toolhead.motors_off(scene, now_s),
            "M112" => self.shut_down("Shutdown due to M112 command", scene, now_s),
            "M114" => {
                let [x_mm, y_mm, z_mm] = self.gcode.position_mm();
                self.respond(format!("X:{x_mm:.3} Y:{y_mm:.3} Z:{z_mm:.3} E:0.000"), now_s);
            }
            "M115" => self.inform(&format!("FIRMWARE_NAME:Klipper FIRMWARE_VERSION:{VERSION}"), now_s),
            "M204" => match (line.above_zero("S")?, line.above_zero("P")?, line.above_zero("T")?) {
                (Some(accel), ..) => self.toolhead.max_accel_mm_s2 = accel,
                (None, Some(print), Some(travel)) => self.toolhead.max_accel_mm_s2 = print.min(travel),
                _ => self.inform(&format!("Invalid M204 command \"{}\"", line.text), now_s),
            },
            "M220" => {
                let factor = line.above_zero("S")?.unwrap_or(100.0) / 100.0;
                self.gcode.speed_mm_s *= factor / self.gcode.factor;
                self.gcode.factor = factor;
            }
            "M400" => {
                self.toolhead.flush(now_s, scene, now_s);
                return Ok(self.still(Then::GoOn, now_s));
            }
            "SET_VELOCITY_LIMIT" => self.limit(&line, now_s)?,
            "SET_GCODE_OFFSET" => {
                if let Some(speed_mm_s) = self.gcode.shift(&line)? {
                    self.toolhead.add(self.gcode.last_mm, speed_mm_s, scene, now_s)?;
                }
            }
            "SET_IDLE_TIMEOUT" => {
                self.idle_timeout_s = line.above_zero("TIMEOUT")?.unwrap_or(self.idle_timeout_s);
                self.idle_from_s = now_s;
                self.inform(&format!("idle_timeout: Timeout set to {:.2} s", self.idle_timeout_s), now_s);
            }
            "BED_MESH_CLEAR" if mesh => {}
            "SET_KINEMATIC_POSITION" if force => {
                let axes = line.axes()?;
                self.toolhead.synchronize(scene, now_s);
                let at_mm = self.toolhead.commanded_mm;
                self.toolhead.set_position(std::array::from_fn(|n| axes[n].unwrap_or(at_mm[n])));
                self.toolhead.homed = [true; 3];
                self.gcode.last_mm = self.toolhead.commanded_mm;
            }
            "FORCE_MOVE" if force => {
                let stepper = line.needed("STEPPER", line.get("STEPPER")?)?;
                let axis = ["stepper_x", "stepper_y", "stepper_z"].iter().position(|name| *name == stepper);
                let axis = axis.ok_or_else(|| format!("Unknown stepper {stepper}"))?;
                let by_mm = line.needed("DISTANCE", line.number("DISTANCE")?)?;
                let speed_mm_s = line.needed("VELOCITY", line.above_zero("VELOCITY")?)?;
                let accel_mm_s2 = line.number("ACCEL")?.unwrap_or(0.0);
                self.toolhead.force(axis, by_mm, (speed_mm_s, accel_mm_s2), scene, now_s);
                return Ok(self.room(now_s));
            }
            "GET_POSITION" => self.report_position(now_s),
            "ECHO" => self.inform(line.text, now_s),
            "STATUS" if ready => self.inform("Klipper state: Ready", now_s),
            "STATUS" => return Err(format!("{}\nKlipper state: Not ready", self.klippy.message().trim_end())),
            "RESTART" | "FIRMWARE_RESTART" if ready => {
                self.toolhead.dwell(BEFORE_RESTART_S, scene, now_s);
                return Ok(self.still(Then::Restart, now_s));
            }
            "RESTART" | "FIRMWARE_RESTART" => return Ok(Some(Stall { until_s: now_s, then: Then::Restart })),
            // heaters and fans that aren't there are switched off without a message
            "M104" | "M140" if line.number("S")?.unwrap_or(0.0) == 0.0 => {}
            "M106" if line.number("S")?.unwrap_or(1.0) == 0.0 => {}
            _ => self.inform(&format!("Unknown command:\"{command}\""), now_s),
        }
        Ok(None)
    }

    /// Begins to home the first of some axes. Each begins when the one before is home.
    pub(super) fn home(&mut self, mut axes: VecDeque<usize>, scene: &mut Scene, now_s: f64) -> Stall {
        let until_s = axes.pop_front().map_or(now_s, |axis| {
            let until_s = self.toolhead.home(axis, scene, now_s);
            self.gcode.last_mm = self.toolhead.commanded_mm;
            self.gcode.base_mm[axis] = self.gcode.offset_mm[axis];
            until_s
        });
        Stall { until_s, then: Then::Home(axes) }
    }

    /// Wait until not too much is planned.
    fn room(&self, now_s: f64) -> Option<Stall> {
        let until_s = self.toolhead.room_s();
        (until_s > now_s).then_some(Stall { until_s, then: Then::GoOn })
    }

    /// Wait until everything planned has ended. Klipper looks at intervals.
    fn still(&self, then: Then, now_s: f64) -> Option<Stall> {
        let left_s = self.toolhead.plan.print_time_s - now_s;
        let until_s = now_s + if left_s < 0.0 { 0.0 } else { POLL_S * ((left_s / POLL_S).floor() + 1.0) };
        Some(Stall { until_s, then })
    }

    /// Changes the limits of moves, or reports them.
    fn limit(&mut self, line: &GcodeLine<'_>, now_s: f64) -> Result<(), String> {
        let names = ["VELOCITY", "ACCEL", "ACCEL_TO_DECEL", "SQUARE_CORNER_VELOCITY"];
        let toolhead = &mut self.toolhead;
        let limits = [
            &mut toolhead.max_velocity_mm_s,
            &mut toolhead.max_accel_mm_s2,
            &mut toolhead.accel_to_decel_mm_s2,
            &mut toolhead.square_corner_mm_s,
        ];
        let mut lines = Vec::new();
        let mut reports = true;
        for (name, limit) in names.into_iter().zip(limits) {
            let value = line.above_zero(name)?;
            reports &= value.is_none();
            *limit = value.unwrap_or(*limit);
            let label = name.to_lowercase();
            lines.push(format!("{}{label}: {:.6}", if label.starts_with("square") { "" } else { "max_" }, *limit));
        }
        if reports {
            self.inform(&lines.join("\n"), now_s);
        }
        Ok(())
    }

    fn report_position(&mut self, now_s: f64) {
        let list = |names: [&str; 3], values: [f64; 3]| {
            names
                .into_iter()
                .zip(values)
                .map(|(name, value)| format!("{name}:{value:.6}"))
                .collect::<Vec<_>>()
                .join(" ")
        };
        let (axes, stepped_mm) = (["X", "Y", "Z"], self.toolhead.plan.stepped_mm());
        let lines = [
            format!("stepper: {}", list(["stepper_x", "stepper_y", "stepper_z"], stepped_mm)),
            format!("kinematic: {}", list(axes, stepped_mm)),
            format!("toolhead: {} E:0.000000", list(axes, self.toolhead.commanded_mm)),
            format!("gcode: {} E:0.000000", list(axes, self.gcode.last_mm)),
            format!("gcode base: {} E:0.000000", list(axes, self.gcode.base_mm)),
            format!("gcode homing: {}", list(axes, self.gcode.offset_mm)),
        ];
        self.inform(&lines.join("\n"), now_s);
    }
}
