//! Lines from GRBL.

/// Kind of a line from the controller.
#[derive(Clone, Debug, PartialEq)]
pub enum GrblReport {
    /// A line was accepted (`ok`).
    Ok,
    /// A line was refused (`error:N`).
    Refused(u32),
    /// An alarm stopped the controller (`ALARM:N`).
    Alarm(u32),
    /// Position and activity (`<Idle|MPos:0.000,0.000,0.000|FS:0,0>`).
    Status(GrblStatus),
    /// A setting (`$100=250.000`): number and value.
    Setting(u32, f64),
    /// The controller has just started (`Grbl 1.1h ['$' for help]`, `GrblHAL 1.1f [...]`, `Grbl 3.7 [FluidNC ...]`).
    Welcome,
    /// Any other text: `[MSG:...]`, `[VER:...]`, or text that isn't from GRBL.
    Text(String),
}

/// A status report.
#[derive(Clone, Debug, PartialEq)]
pub struct GrblStatus {
    /// Activity of the controller.
    pub state: GrblState,
    /// Reported position: x, y, z, mm.
    pub position_mm: [f64; 3],
    /// Whether the position is a machine position (`MPos`); otherwise it is a work position (`WPos`).
    pub is_machine: bool,
}

/// Activity of the controller (interface document).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GrblState {
    /// Is at rest and accepts commands.
    Idle,
    /// Jogs.
    Jog,
    /// Runs a program line, or pauses it.
    Run,
    /// Searches for home.
    Home,
    /// Is locked after an alarm or after power-on.
    Alarm,
    /// Is at rest and accepts no commands: a door is open, the controller sleeps, or it is in check mode.
    Other,
}

/// Reads one line; returns `None` if it is damaged.
pub fn parse_report(line: &str) -> Option<GrblReport> {
    let number = |text: &str| text.trim().parse().ok();
    if line == "ok" {
        Some(GrblReport::Ok)
    } else if let Some(code) = line.strip_prefix("error:") {
        number(code).map(GrblReport::Refused)
    } else if let Some(code) = line.strip_prefix("ALARM:") {
        number(code).map(GrblReport::Alarm)
    } else if line.starts_with('<') {
        parse_status(line).map(GrblReport::Status)
    } else if line.starts_with("Grbl ") || line.starts_with("GrblHAL ") {
        Some(GrblReport::Welcome)
    } else if let Some((name, value)) = line.strip_prefix('$').and_then(|setting| setting.split_once('=')) {
        match name.parse() {
            // a start-up line ($N0=...) is no setting with a value
            Err(_) => Some(GrblReport::Text(line.to_owned())),
            Ok(name) => {
                value.parse().ok().filter(|value: &f64| value.is_finite()).map(|value| GrblReport::Setting(name, value))
            }
        }
    } else {
        Some(GrblReport::Text(line.to_owned()))
    }
}

fn parse_status(line: &str) -> Option<GrblStatus> {
    let mut fields = line.strip_prefix('<')?.strip_suffix('>')?.split('|');
    let state = match fields.next()?.split(':').next()? {
        "Idle" => GrblState::Idle,
        "Jog" => GrblState::Jog,
        "Run" | "Hold" => GrblState::Run,
        "Home" => GrblState::Home,
        "Alarm" => GrblState::Alarm,
        "Door" | "Check" | "Sleep" => GrblState::Other,
        _ => return None,
    };
    let (mut position, mut is_machine) = (None, false);
    for (name, value) in fields.filter_map(|field| field.split_once(':')) {
        if name == "MPos" || name == "WPos" {
            // a position has three decimals; with fewer it is damaged
            let whole = |text: &str| text.split_once('.').is_some_and(|(_, decimals)| decimals.len() >= 3);
            let places: Option<Vec<f64>> = value
                .split(',')
                .map(|text| text.parse().ok().filter(|place: &f64| place.is_finite() && whole(text)))
                .collect();
            position = Some(<[f64; 3]>::try_from(places?).ok()?);
            is_machine = name == "MPos";
        }
    }
    Some(GrblStatus { state, position_mm: position?, is_machine })
}

/// Returns the reason for a refused line in words (error codes of the interface document).
pub(super) fn error_name(code: u32) -> &'static str {
    match code {
        2 => "a number is missing or invalid",
        3 => "unknown $ command",
        5 => "homing is off ($22)",
        8 => "not idle",
        9 => "locked",
        15 => "the jog exceeds the travel",
        16 => "not a jog",
        20 => "unknown command",
        22 => "no feed rate",
        _ => "see GRBL's error codes",
    }
}

/// Returns an alarm in words (alarm codes of the interface document).
pub(super) fn alarm_name(code: u32) -> &'static str {
    match code {
        1 => "a limit switch was hit; its position is lost",
        2 => "a motion beyond the travel",
        3 => "reset in motion; its position is lost",
        6..=10 => "the search for home failed",
        _ => "see GRBL's alarm codes",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_interface_document_are_read() {
        let status = |line| match parse_report(line) {
            Some(GrblReport::Status(status)) => Some((status.state, status.position_mm, status.is_machine)),
            _ => None,
        };
        assert_eq!(status("<Idle|MPos:0.000,0.000,0.000|FS:0,0>"), Some((GrblState::Idle, [0.0; 3], true)));
        assert_eq!(
            status("<Hold:1|WPos:1.000,-2.500,0.010|F:500|WCO:0.000,0.000,0.000>"),
            Some((GrblState::Run, [1.0, -2.5, 0.01], false))
        );
        for (line, report) in [
            ("ok", GrblReport::Ok),
            ("error:9", GrblReport::Refused(9)),
            ("ALARM:3", GrblReport::Alarm(3)),
            ("$110=500.000", GrblReport::Setting(110, 500.0)),
            ("Grbl 1.1h ['$' for help]", GrblReport::Welcome),
            ("[VER:1.1h.20190825:]", GrblReport::Text("[VER:1.1h.20190825:]".to_owned())),
        ] {
            assert_eq!(parse_report(line), Some(report));
        }
    }

    #[test]
    fn damaged_line_is_ignored() {
        for line in [
            "<Idle|MPos:0.000,0.000|FS:0,0>",
            "<Idle|MPos:0.000,0.000,0.0|FS:0,0>",
            "<Idle|MPos:0.000,0.000,nan|FS:0,0>",
            "<Idle|FS:0,0>",
            "<Idl|MPos:0.000,0.000,0.000>",
            "<Idle|MPos:0.000,0.000,0.000|FS:0,0",
            "error:",
            "ALARM:x",
            "$110=1e999",
        ] {
            assert_eq!(parse_report(line), None, "{line}");
        }
    }
}
