//! Reports of the controller: status reports and the answers to `$` questions.

use super::gcode::{Modal, MotionMode};
use super::machine::BLOCKS_MOST;
use std::fmt::Write;

/// Bytes of the serial line that GRBL buffers.
pub(super) const RX_MOST: usize = 128;
/// Number of reports from one report with the work offset to the next, during a motion and at rest.
const OFFSET_EVERY: (u8, u8) = (30, 10);
/// Number of reports from one report with the overrides to the next, during a motion and at rest.
const OVERRIDES_EVERY: (u8, u8) = (20, 10);

/// Counter of status reports. Data that seldom change are only in some reports.
#[derive(Default)]
pub(super) struct Reporter {
    offset_in: u8,
    overrides_in: u8,
}

/// Content of a status report.
pub(super) struct StatusReport {
    /// Name of the state.
    pub state: String,
    /// Whether an axis moves.
    pub busy: bool,
    /// Machine coordinates, mm.
    pub places_mm: [f64; 3],
    /// Machine minus work coordinates, mm.
    pub offset_mm: [f64; 3],
    /// Speed of the tool, mm/s.
    pub speed_mm_s: f64,
    /// Axes whose limit switch is pressed.
    pub switches: [bool; 3],
}

impl Reporter {
    /// Notes that the offset has changed; the next report contains it.
    pub(super) fn offset_changed(&mut self) {
        self.offset_in = 0;
    }

    /// Returns the line that answers `?`.
    pub(super) fn status(&mut self, status: &StatusReport) -> String {
        let mut line = format!("<{}|MPos:{}", status.state, places(status.places_mm));
        // writing to a string can't fail
        let _ = write!(line, "|FS:{:.0},0", status.speed_mm_s * 60.0);
        if status.switches.contains(&true) {
            line += "|Pn:";
            line.extend("XYZ".chars().zip(status.switches).filter(|(_, pressed)| *pressed).map(|(name, _)| name));
        }
        let every = |(busy, idle): (u8, u8)| if status.busy { busy - 1 } else { idle - 1 };
        if self.offset_in > 0 {
            self.offset_in -= 1;
        } else {
            self.offset_in = every(OFFSET_EVERY);
            // a report never has both: the overrides wait for the next one
            self.overrides_in = self.overrides_in.max(1);
            let _ = write!(line, "|WCO:{}", places(status.offset_mm));
        }
        if self.overrides_in > 0 {
            self.overrides_in -= 1;
        } else {
            self.overrides_in = every(OVERRIDES_EVERY);
            line += "|Ov:100,100,100";
        }
        line + ">"
    }
}

/// Returns the lines of `$#`.
pub(super) fn parameters(modal: &Modal) -> Vec<String> {
    let zero = places([0.0; 3]);
    let g54 = format!("[G54:{}]", places(modal.g54_mm));
    let systems = (55..=59).chain([28, 30]).map(|system| format!("[G{system}:{zero}]"));
    let rest = [format!("[G92:{}]", places(modal.g92_mm)), "[TLO:0.000]".into(), format!("[PRB:{zero}:0]")];
    [g54].into_iter().chain(systems).chain(rest).collect()
}

/// Returns the line of `$G`.
pub(super) fn modes(modal: &Modal) -> String {
    let (motion, distance) = (u8::from(modal.motion == MotionMode::Feed), 90 + u8::from(modal.incremental));
    let units = 21 - u8::from(modal.inches);
    format!("[GC:G{motion} G54 G17 G{units} G{distance} G94 M5 M9 T0 F{:.0} S0]", modal.feed_mm_min)
}

/// Returns the lines of `$I`: option V, a spindle with variable speed, and perhaps Z, an origin set by homing; then the sizes of the
/// buffers.
pub(super) fn build_info(sets_origin: bool) -> [String; 2] {
    let options = if sets_origin { "VZ" } else { "V" };
    ["[VER:1.1h.20190825:]".into(), format!("[OPT:{options},{BLOCKS_MOST},{RX_MOST}]")]
}

/// Formats three coordinates with three decimals each, separated by commas. A zero has no sign.
fn places(places_mm: [f64; 3]) -> String {
    places_mm.map(|place_mm| format!("{:.3}", (place_mm * 1000.0).round() / 1000.0 + 0.0)).join(",")
}
