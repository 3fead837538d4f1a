//! Lines that a printer sends.

use palpate_core::quantity::Axis;

/// A line from the printer.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum MarlinReport {
    /// A command was accepted.
    Ok,
    /// A command wasn't accepted: the number of the line that is expected next.
    Resend(u64),
    /// A command needs more time.
    Busy,
    /// The printer started.
    Start,
    /// An error, with its text.
    Error(String),
    /// Positions.
    Position(MarlinPosition),
    /// Any other text, such as a setting.
    Text(String),
}

/// Answer to `M114`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MarlinPosition {
    /// End of the queue along x, y and z, mm.
    pub ends_mm: [f64; 3],
    /// Counted steps of x, y and z. They are those of the motors.
    pub steps: [i64; 3],
}

/// Texts that a board sends when it starts (Marlin, `MarlinCore.cpp`, `setup`): the cause of the reset, its version and its memory.
const STARTS: [&str; 8] = [
    "PowerUp",
    "External Reset",
    "Brown out Reset",
    "Watchdog Reset",
    "Software Reset",
    "Last Updated:",
    "Free Memory:",
    "PlannerBufferBytes:",
];

/// Reads a line. Temperatures are nothing.
pub(super) fn parse_report(line: &str) -> Option<MarlinReport> {
    let number = |text: &str| text.split_whitespace().next()?.parse().ok();
    // stock 2.0.6 and 2.0.7 send `echo:start`; a board may send bytes before it, and a damaged announcement is followed by these texts
    if line.ends_with("start") || STARTS.iter().any(|text| line.contains(text)) {
        return Some(MarlinReport::Start);
    }
    if line == "ok" || line.starts_with("ok ") {
        return Some(MarlinReport::Ok);
    }
    if let Some(rest) = line.strip_prefix("Resend:").or_else(|| line.strip_prefix("rs ")) {
        return number(rest).map(MarlinReport::Resend);
    }
    if line.starts_with("echo:busy:") {
        return Some(MarlinReport::Busy);
    }
    if let Some(text) = line.strip_prefix("Error:") {
        return Some(MarlinReport::Error(text.trim().to_owned()));
    }
    if line.starts_with("T:") || line.starts_with("B:") {
        return None;
    }
    Some(parse_position(line).map_or_else(|| MarlinReport::Text(line.to_owned()), MarlinReport::Position))
}

/// Reads `X:0.00 Y:127.00 Z:145.00 E:0.00 Count X:0 Y:10160 Z:116000`. A blank may follow a colon. Motors that don't each move one axis are
/// counted as A, B and C; in CoreXY A counts x + y and B counts x - y (Marlin, `Stepper::report_a_position`).
fn parse_position(line: &str) -> Option<MarlinPosition> {
    let (ends, counts) = line.split_once("Count")?;
    let after = |text: &str, name: &str| -> Option<f64> {
        let (_, rest) = text.split_once(&format!("{name}:"))?;
        rest.split_whitespace().next()?.parse().ok().filter(|number: &f64| number.is_finite())
    };
    let all = |text: &str, [x, y, z]: [&str; 3]| Some([after(text, x)?, after(text, y)?, after(text, z)?]);
    let core = || all(counts, ["A", "B", "Z"]).map(|[a, b, z]| [(a + b) / 2.0, (a - b) / 2.0, z]);
    let steps = all(counts, ["X", "Y", "Z"]).or_else(core).or_else(|| all(counts, ["A", "B", "C"]))?;
    steps.iter().all(|steps| steps.fract() == 0.0).then_some(())?;
    Some(MarlinPosition { ends_mm: all(ends, ["X", "Y", "Z"])?, steps: steps.map(|steps| steps as i64) })
}

/// Returns the numbers after X, Y and Z of a setting such as `echo:  M92 X80.00 Y80.00 Z400.00 E93.00`.
pub(super) fn setting(texts: &[String], name: &str) -> Option<[f64; 3]> {
    let words = |text: &String| {
        let text = text.trim_start_matches("echo:").trim().to_owned();
        text.strip_prefix(name).filter(|rest| rest.starts_with(' ')).map(str::to_owned)
    };
    let rest = texts.iter().find_map(words)?;
    let of = |axis: Axis| {
        let word = rest.split_whitespace().find_map(|word| word.strip_prefix(&axis.name().to_uppercase()))?;
        word.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0)
    };
    Some([of(Axis::X)?, of(Axis::Y)?, of(Axis::Z)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_by_their_beginning() {
        let position = MarlinPosition { ends_mm: [0.0, 127.0, -1.5], steps: [0, 10160, -600] };
        let cases = [
            ("ok", Some(MarlinReport::Ok)),
            ("ok P15 B3", Some(MarlinReport::Ok)),
            ("okay", Some(MarlinReport::Text("okay".to_owned()))),
            ("Resend: 12", Some(MarlinReport::Resend(12))),
            ("echo:busy: processing", Some(MarlinReport::Busy)),
            ("start", Some(MarlinReport::Start)),
            (
                "Error:Printer halted. kill() called!",
                Some(MarlinReport::Error("Printer halted. kill() called!".to_owned())),
            ),
            ("T:21.50 /0.00 B:20.10 /0.00 @:0 B@:0", None),
            ("X:0.00 Y:127.00 Z:-1.50 E:0.00 Count X:0 Y:10160 Z:-600", Some(MarlinReport::Position(position))),
            ("X:0.00 Y:127.00 Z:-1.50 E:0.00 Count X: 0 Y:10160 Z:-600", Some(MarlinReport::Position(position))),
            ("X:0.00 Y:127.00 Z:-1.50 E:0.00 Count A:10160 B:-10160 Z:-600", Some(MarlinReport::Position(position))),
            ("X:0.00 Y:127.00 Z:-1.50 E:0.00 Count: A:0 B:10160 C:-600", Some(MarlinReport::Position(position))),
            (
                "X:0.00 Y:127.00 Z:-1.50 Count X:0 Y:1",
                Some(MarlinReport::Text("X:0.00 Y:127.00 Z:-1.50 Count X:0 Y:1".to_owned())),
            ),
        ];
        for (line, report) in cases {
            assert_eq!(parse_report(line), report, "{line}");
        }
        assert_eq!(parse_report("Resend: x"), None);
    }

    #[test]
    fn a_setting_is_found_among_the_others() {
        let texts =
            ["echo:; Steps per unit:", "echo:  M92 X80.00 Y80.00 Z400.00 E93.00", "echo:  M203 X500 Y500 Z0 E25"];
        let texts = texts.map(str::to_owned);
        assert_eq!(setting(&texts, "M92"), Some([80.0, 80.0, 400.0]));
        assert_eq!(setting(&texts, "M203"), None, "no speed is 0");
        assert_eq!(setting(&texts, "M9"), None);
    }
}
