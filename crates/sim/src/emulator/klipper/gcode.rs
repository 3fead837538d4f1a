//! G-code: how a line is read, and what each command does (Klipper's klippy/gcode.py, klippy/toolhead.py and, in klippy/extras,
//! gcode_move.py, force_move.py, idle_timeout.py and stepper_enable.py).

use super::printer::KlipperPrinter;
use crate::scene::Scene;
use std::collections::HashMap;

/// Time from one look at a wait for the end of the moves to the next, s (`wait_moves`).
pub(super) const POLL_S: f64 = 0.1;
/// Planned time above which a command waits, s (BUFFER_TIME_HIGH).
const HIGH_S: f64 = 2.0;
/// Commands that are known before Klipper is ready, and after it has shut down.
const ALWAYS: [&str; 8] = ["M105", "M21", "M110", "M112", "M115", "RESTART", "FIRMWARE_RESTART", "ECHO"];
/// Largest number that is read. Klipper has no such limit.
const MOST: f64 = 1e9;

/// Name of a state of the coordinates that a command doesn't name.
const DEFAULT_STATE: &str = "default";
/// Number of states that are kept. Klipper has no such limit.
const STATES_MOST: usize = 64;

/// Coordinates of the commands, and what was saved of them.
#[derive(Default)]
pub(super) struct GcodeMove {
    /// Those in use.
    pub now: Coordinates,
    saved: HashMap<String, Coordinates>,
}

/// Coordinates of the commands.
#[derive(Clone, Copy)]
pub(super) struct Coordinates {
    pub absolute: bool,
    /// Position at which the coordinates are 0, mm.
    pub base_mm: [f64; 3],
    /// End of the last move, mm.
    pub last_mm: [f64; 3],
    /// Offset of SET_GCODE_OFFSET, mm.
    pub offset_mm: [f64; 3],
    /// Speed of moves, with the factor, mm/s.
    pub speed_mm_s: f64,
    /// Factor of M220.
    pub factor: f64,
}

impl Default for Coordinates {
    fn default() -> Self {
        let zero = [0.0; 3];
        Coordinates { absolute: true, base_mm: zero, last_mm: zero, offset_mm: zero, speed_mm_s: 25.0, factor: 1.0 }
    }
}

impl GcodeMove {
    /// Saves the coordinates under a name (SAVE_GCODE_STATE).
    fn save(&mut self, line: &GcodeLine<'_>) -> Result<(), String> {
        let name = line.value("NAME")?.unwrap_or(DEFAULT_STATE);
        if self.saved.len() < STATES_MOST || self.saved.contains_key(name) {
            self.saved.insert(name.to_owned(), self.now);
        }
        Ok(())
    }

    /// Restores what was saved under a name, but for the place (RESTORE_GCODE_STATE). Returns the speed if the tool is to move back
    /// to that, too, mm/s.
    fn restore(&mut self, line: &GcodeLine<'_>) -> Result<Option<f64>, String> {
        let name = line.value("NAME")?.unwrap_or(DEFAULT_STATE);
        let saved = *self.saved.get(name).ok_or_else(|| format!("Unknown g-code state: {name}"))?;
        let moves = line.number("MOVE")?.unwrap_or(0.0) != 0.0;
        let last_mm = if moves { saved.last_mm } else { self.now.last_mm };
        self.now = Coordinates { last_mm, ..saved };
        Ok(line.above_zero("MOVE_SPEED")?.or(Some(self.now.speed_mm_s)).filter(|_| moves))
    }
}

impl Coordinates {
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
        let other_mm = (values_mm == [None; 3] && line.number("E")?.is_none()).then_some(0.0);
        for (n, value_mm) in values_mm.into_iter().enumerate() {
            self.base_mm[n] = value_mm.or(other_mm).map_or(self.base_mm[n], |value_mm| self.last_mm[n] - value_mm);
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
    /// Executes a line. Returns the time until which the script waits then, s. The error ends the script.
    pub(super) fn execute(&mut self, line: &str, scene: &mut Scene, now_s: f64) -> Result<f64, String> {
        let line = GcodeLine::parse(line);
        let command = line.command.as_str();
        if self.klippy.name != "ready" && !ALWAYS.contains(&command) {
            return Err(self.klippy.message.clone());
        }
        let (toolhead, gcode) = (&mut self.toolhead, &mut self.gcode.now);
        match command {
            "G0" | "G1" => {
                // it waits until not too much is planned before it
                let planned_s = toolhead.print_time_s;
                gcode.go(&line)?;
                toolhead.go(gcode.last_mm, gcode.speed_mm_s, scene, now_s)?;
                return Ok(planned_s - HIGH_S);
            }
            "G4" => {
                toolhead.dwell(line.number("P")?.unwrap_or(0.0).max(0.0) / 1000.0, now_s);
                return Ok(toolhead.print_time_s - HIGH_S);
            }
            "G20" => return Err("Machine does not support G20 (inches) command".into()),
            "G28" => {
                toolhead.motors_off(now_s);
                let named = ["X", "Y", "Z"].into_iter().find(|axis| line.text.to_uppercase().contains(axis));
                return Err(format!("No trigger on {} after full movement", named.unwrap_or("X").to_lowercase()));
            }
            "G90" | "G91" => gcode.absolute = command == "G90",
            "G92" => gcode.set(&line)?,
            "M18" | "M84" => toolhead.motors_off(now_s),
            "M112" => self.shut_down("Shutdown due to M112 command", scene, now_s),
            "M204" => line.set("S", &mut toolhead.board.max_accel_mm_s2)?,
            "M220" => {
                let factor = line.above_zero("S")?.unwrap_or(100.0) / 100.0;
                gcode.speed_mm_s *= factor / gcode.factor;
                gcode.factor = factor;
            }
            "M400" => {
                // it looks at intervals
                let left_s = toolhead.print_time_s - now_s;
                return Ok(if left_s < 0.0 { now_s } else { now_s + POLL_S * ((left_s / POLL_S).floor() + 1.0) });
            }
            "SET_VELOCITY_LIMIT" => {
                line.set("VELOCITY", &mut toolhead.board.max_velocity_mm_s)?;
                line.set("ACCEL", &mut toolhead.board.max_accel_mm_s2)?;
                line.set("ACCEL_TO_DECEL", &mut toolhead.accel_to_decel_mm_s2)?;
            }
            "SET_GCODE_OFFSET" => {
                if let Some(speed_mm_s) = gcode.shift(&line)? {
                    toolhead.go(gcode.last_mm, speed_mm_s, scene, now_s)?;
                }
            }
            "SAVE_GCODE_STATE" => self.gcode.save(&line)?,
            "RESTORE_GCODE_STATE" => {
                if let Some(speed_mm_s) = self.gcode.restore(&line)? {
                    toolhead.go(self.gcode.now.last_mm, speed_mm_s, scene, now_s)?;
                }
            }
            "SET_IDLE_TIMEOUT" => line.set("TIMEOUT", &mut toolhead.board.idle_timeout_s)?,
            "SET_KINEMATIC_POSITION" if toolhead.board.enable_force_move => {
                let (axes, at_mm) = (line.axes()?, toolhead.commanded_mm);
                gcode.last_mm = std::array::from_fn(|n| axes[n].unwrap_or(at_mm[n]));
                toolhead.set_position(gcode.last_mm, scene, now_s);
            }
            "RESTART" | "FIRMWARE_RESTART" => self.restart(scene, now_s),
            // an unknown command is a message to the terminals, and no error
            _ => {}
        }
        Ok(now_s)
    }
}

/// A line of a script.
pub(super) struct GcodeLine<'a> {
    /// The command in capitals, such as `G1` or `SET_GCODE_OFFSET`. Empty without one.
    pub command: String,
    /// The line as errors quote it.
    pub text: &'a str,
    /// Names and values; `None` if an extended command has a word without a value.
    params: Option<Vec<(String, String)>>,
}

impl<'a> GcodeLine<'a> {
    /// Reads a line. A traditional command is a letter and a number, and its parameters are letters with values. An extended
    /// command has parameters of the form `NAME=value`.
    pub(super) fn parse(line: &'a str) -> Self {
        let text = line.trim();
        let code = text.split(';').next().unwrap_or_default();
        if code.as_bytes().get(1).is_some_and(u8::is_ascii_digit) {
            let code = code.to_uppercase();
            // each letter begins a word; the first word is the command
            let begins = code.match_indices(|char: char| char.is_ascii_uppercase()).map(|(at, _)| at);
            let ends = begins.clone().skip(1).chain([code.len()]);
            let mut words = begins.zip(ends).map(|(at, end)| code[at..end].split_at(1));
            let command = words.next().map(|(letter, number)| format!("{letter}{}", number.trim()));
            let params = words.map(|(name, value)| (name.to_owned(), value.trim().to_owned())).collect();
            return GcodeLine { command: command.unwrap_or_default(), text, params: Some(params) };
        }
        let mut words = code.split('#').next().unwrap_or_default().split_whitespace();
        let command = words.next().unwrap_or_default().to_uppercase();
        let pair = |(name, value): (&str, &str)| (name.to_uppercase(), value.trim_matches('"').to_owned());
        GcodeLine { command, text, params: words.map(|word| word.split_once('=').map(pair)).collect() }
    }

    /// Text of a parameter, if it is there. Of two, the last counts.
    fn value(&self, name: &str) -> Result<Option<&str>, String> {
        let params = self.params.as_ref().ok_or_else(|| format!("Malformed command '{}'", self.text))?;
        Ok(params.iter().rev().find(|(other, _)| other == name).map(|(_, value)| value.as_str()))
    }

    /// A number, if the parameter is there.
    pub(super) fn number(&self, name: &str) -> Result<Option<f64>, String> {
        let Some(value) = self.value(name)? else { return Ok(None) };
        let number = value.parse().ok().filter(|number: &f64| number.abs() <= MOST);
        number.map(Some).ok_or_else(|| format!("Error on '{}': unable to parse {value}", self.text))
    }

    /// A number above zero, if the parameter is there.
    pub(super) fn above_zero(&self, name: &str) -> Result<Option<f64>, String> {
        match self.number(name)? {
            Some(number) if number <= 0.0 => Err(format!("Error on '{}': {name} must be above 0.0", self.text)),
            number => Ok(number),
        }
    }

    /// Sets a value to a number above zero, if the parameter is there.
    pub(super) fn set(&self, name: &str, value: &mut f64) -> Result<(), String> {
        *value = self.above_zero(name)?.unwrap_or(*value);
        Ok(())
    }

    /// Numbers of X, Y and Z.
    pub(super) fn axes(&self) -> Result<[Option<f64>; 3], String> {
        Ok([self.number("X")?, self.number("Y")?, self.number("Z")?])
    }
}
