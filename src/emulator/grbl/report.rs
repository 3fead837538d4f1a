use super::gcode::{MM_PER_INCH, Modal, Motion, SYSTEMS};
use super::machine::{BLOCKS_MOST, Overrides};
use super::settings::{self, Settings};
use std::fmt::Write;

/// What the help line says.
pub const HELP: &str = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]";
/// Bytes of the serial line that GRBL buffers.
pub const RX_MOST: usize = 128;
/// Reports from one that tells the work offset to the next, when something moves and when nothing does.
const OFFSET_EVERY: (u8, u8) = (30, 10);
/// Reports from one that tells the overrides to the next.
const OVERRIDES_EVERY: (u8, u8) = (20, 10);
/// Bits of `$10`.
const MACHINE_PLACE: u8 = 1;
const BUFFERS: u8 = 2;

/// Counts status reports: what seldom changes is told in some of them only.
#[derive(Default)]
pub struct Reporter {
    offset_in: u8,
    overrides_in: u8,
}

/// What a status report tells.
pub struct Status {
    /// The state's name.
    pub state: String,
    /// Whether something moves, or is held in its motion.
    pub busy: bool,
    /// Machine coordinates, mm.
    pub places_mm: [f64; 3],
    /// Machine less work coordinates, mm.
    pub offset_mm: [f64; 3],
    /// Blocks the planner has room for.
    pub room: usize,
    /// How fast the tool moves, mm/s.
    pub speed_mm_s: f64,
    /// What S says while the spindle turns.
    pub spindle_rpm: f64,
    /// Axes whose limit switch is pressed.
    pub switches: [bool; 3],
    /// Feed and rapid overrides.
    pub overrides: Overrides,
    /// Spindle override, percent.
    pub spindle_percent: f64,
}

impl Reporter {
    /// The offset has changed: the next report tells it.
    pub fn offset_changed(&mut self) {
        self.offset_in = 0;
    }

    /// An override has changed: the next report tells it.
    pub fn overrides_changed(&mut self) {
        self.overrides_in = 0;
    }

    /// The line that answers `?`.
    pub fn status(&mut self, status: &Status, settings: &Settings) -> String {
        let inches = settings.on(settings::REPORT_INCHES);
        let mask = settings.get(settings::STATUS_MASK) as u8;
        let mut line = format!("<{}|", status.state);
        // writing to a string can't fail
        let _ = if mask & MACHINE_PLACE != 0 {
            write!(line, "MPos:{}", places(status.places_mm, inches))
        } else {
            let work_mm = std::array::from_fn(|n| status.places_mm[n] - status.offset_mm[n]);
            write!(line, "WPos:{}", places(work_mm, inches))
        };
        if mask & BUFFERS != 0 {
            let _ = write!(line, "|Bf:{},{RX_MOST}", status.room);
        }
        let _ = write!(line, "|FS:{},{:.0}", rate(status.speed_mm_s * 60.0, inches), status.spindle_rpm);
        if status.switches.contains(&true) {
            line += "|Pn:";
            line.extend("XYZ".chars().zip(status.switches).filter(|(_, pressed)| *pressed).map(|(name, _)| name));
        }
        let every = |(busy, idle): (u8, u8)| if status.busy { busy - 1 } else { idle - 1 };
        if self.offset_in > 0 {
            self.offset_in -= 1;
        } else {
            self.offset_in = every(OFFSET_EVERY);
            // both never stand in one report: the overrides wait for the next
            self.overrides_in = self.overrides_in.max(1);
            let _ = write!(line, "|WCO:{}", places(status.offset_mm, inches));
        }
        if self.overrides_in > 0 {
            self.overrides_in -= 1;
        } else {
            self.overrides_in = every(OVERRIDES_EVERY);
            let Overrides { feed, rapid } = status.overrides;
            let _ = write!(line, "|Ov:{feed:.0},{rapid:.0},{:.0}", status.spindle_percent);
        }
        line + ">"
    }
}

/// The lines of `$#`.
pub fn parameters(modal: &Modal, inches: bool) -> Vec<String> {
    let zero = places([0.0; 3], inches);
    let systems = (54..54 + u16::from(SYSTEMS)).chain([28, 30]).map(|system| format!("[G{system}:{zero}]"));
    let rest = [
        format!("[G92:{}]", places(modal.g92_mm, inches)),
        format!("[TLO:{}]", length(0.0, inches)),
        format!("[PRB:{zero}:0]"),
    ];
    systems.chain(rest).collect()
}

/// The line of `$G`.
pub fn modes(modal: &Modal, inches: bool) -> String {
    let motion = match modal.motion {
        Some(Motion::Rapid) => "G0",
        Some(Motion::Feed) => "G1",
        None => "G80",
    };
    let Modal { plane, spindle, coolant, tool, spindle_rpm, .. } = modal;
    let (system, units, distance) = (54 + modal.system, 21 - u8::from(modal.inches), 90 + u8::from(modal.incremental));
    let feed = rate(modal.feed_mm_min, inches);
    format!(
        "[GC:{motion} G{system} G{plane} G{units} G{distance} G94 M{spindle} M{coolant} T{tool:.0} F{feed} S{spindle_rpm:.0}]"
    )
}

/// The lines of `$I`: options V, a spindle whose speed varies, and Z, an origin set by homing; then room in the buffers.
pub fn build_info() -> [String; 2] {
    ["[VER:1.1h.20190825:]".into(), format!("[OPT:VZ,{BLOCKS_MOST},{RX_MOST}]")]
}

/// Three coordinates with commas between.
fn places(places_mm: [f64; 3], inches: bool) -> String {
    places_mm.map(|place_mm| length(place_mm, inches)).join(",")
}

/// A length as GRBL writes it: three decimals in mm, four in inches; a zero has no sign.
fn length(length_mm: f64, inches: bool) -> String {
    let (value, decimals) = if inches { (length_mm / MM_PER_INCH, 4) } else { (length_mm, 3) };
    let shift = 10f64.powi(decimals);
    format!("{:.*}", decimals as usize, (value * shift).round() / shift + 0.0)
}

fn rate(rate_mm_min: f64, inches: bool) -> String {
    if inches { format!("{:.1}", rate_mm_min / MM_PER_INCH) } else { format!("{rate_mm_min:.0}") }
}
