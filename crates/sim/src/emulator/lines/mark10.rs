//! A Mark-10 force gauge, Series 5 or 7 (Series 5 user's guide, "Command Set / Gauge Control Language 2", section 9.6 or 9.8 by
//! edition; AOUT, IPOL and OPOL as in the Model 7i user's guide, 14.6; the form of a reading as in the Series 4 guide, 9.1.4).

use super::{BoardFirmware, CellScale, LINE_END, Port};
use crate::scene::{Scene, SceneDevice};

/// Baud rate of a delivered gauge (1ramihamada/read-force, README.md; the guides let the user choose).
const BAUD: f64 = 115_200.0;

/// Number of steps of a gauge's capacity: 0.002 N of 10 N for the M5-2 (from memory).
const STEPS: f64 = 5000.0;

/// Part of the capacity beyond which the reading stays: the gauge is overloaded at 110 % (from memory). What it sends then is from
/// no manual.
const OVERLOAD: f64 = 1.1;

/// Permitted rates of AOUT per second. 0 ends it, and 1 gives 50 per second, as the guide of the 7i states.
const RATES: [u32; 9] = [0, 1, 2, 5, 10, 25, 50, 125, 250];
const RATE_OF_ONE: u32 = 50;

/// Commands of the manual that this emulator doesn't support, or that don't apply: other units, peaks, averages, memory.
const NOT_APPLICABLE: [&str; 13] = ["LB", "OZ", "KG", "G", "KN", "?PT", "?PC", "?ET", "?A", "PT", "PC", "MEM", "STA"];

/// A gauge that is switched on with newtons, units in its readings and no continuous output.
///
/// Requests end with CR; LF is ignored. A reading is such as `-1.234 N` with CR LF, positive for compression and without a `+`. Set
/// commands have no answer, as far as the manual states. Errors are `*10` (illegal command), `*11` (not applicable) and `*12`
/// (invalid specifier). Supported: `?`, `?C`, `N`, `MN`, `CUR`, `CLR`, `Z`, `FULL`, `NUM`, `AOUTn`, `IPOLn`, `OPOLn`, `LIST`.
/// Opening the port doesn't reset the gauge.
pub struct Mark10 {
    capacity_n: f64,
    scale: CellScale,
    zero_n: f64,
    milli: bool,
    with_unit: bool,
    inverted: bool,
    unsigned: bool,
    /// `n` of AOUT.
    auto_output: u32,
}

/// Error codes of the manual.
const ILLEGAL_COMMAND: &str = "*10";
const INAPPLICABLE: &str = "*11";
const INVALID_SPECIFIER: &str = "*12";

impl Mark10 {
    /// Creates a gauge for forces up to `capacity_n` either way.
    pub fn new(capacity_n: f64) -> Self {
        Mark10 {
            capacity_n,
            scale: CellScale::NEWTON,
            zero_n: 0.0,
            milli: false,
            with_unit: true,
            inverted: false,
            unsigned: false,
            auto_output: 0,
        }
    }

    /// Gives it another calibration: its newtons aren't those of the force.
    #[must_use]
    pub fn scaled(self, scale: CellScale) -> Self {
        Mark10 { scale, ..self }
    }

    /// Force of the gauge without its zero, N.
    fn force_n(&self, scene: &mut Scene, now_s: f64) -> f64 {
        let most_n = OVERLOAD * self.capacity_n;
        scene.load_cell_n(now_s).clamp(-most_n, most_n)
    }

    /// Smallest step of a reading, in the unit of the reading.
    fn step(&self) -> f64 {
        self.per_newton() * self.capacity_n / STEPS / self.scale.newton_per_unit.abs()
    }

    fn per_newton(&self) -> f64 {
        if self.milli { 1000.0 } else { 1.0 }
    }

    /// Runs a command. Returns its answer without the end of the line; `None` if it has none.
    fn run(&mut self, command: &str, scene: &mut Scene, now_s: f64) -> Result<Option<String>, &'static str> {
        match command {
            "?" | "?C" => {
                let reading = self.read(scene, now_s);
                return Ok(Some(self.text(&reading)));
            }
            "LIST" => return Ok(Some(self.list())),
            "N" | "MN" => self.milli = command == "MN",
            "FULL" | "NUM" => self.with_unit = command == "FULL",
            "Z" => self.zero_n = self.force_n(scene, now_s),
            "CUR" | "CLR" => {}
            _ if NOT_APPLICABLE.contains(&command) => return Err(INAPPLICABLE),
            _ => match command.split_at_checked(4).ok_or(ILLEGAL_COMMAND)? {
                ("AOUT", rate) => {
                    let rate = rate.parse().ok().filter(|rate| RATES.contains(rate));
                    self.auto_output = rate.ok_or(INVALID_SPECIFIER)?;
                }
                ("IPOL", choice) => self.inverted = chosen(choice)?,
                ("OPOL", choice) => self.unsigned = chosen(choice)?,
                _ => return Err(ILLEGAL_COMMAND),
            },
        }
        Ok(None)
    }

    fn text(&self, reading: &[f64]) -> String {
        let value = reading.first().copied().unwrap_or(0.0);
        let decimals = (-self.step().log10().floor()).max(0.0) as usize;
        let unit = match (self.with_unit, self.milli) {
            (false, _) => "",
            (true, false) => " N",
            (true, true) => " mN",
        };
        format!("{value:.decimals$}{unit}")
    }

    /// Settings, in the form of the manual's example `V1.00;LBF;CUR;FLTC8;FLTP1;AOUT00;AOFF5;FULL;MIT;POL;B0`.
    fn list(&self) -> String {
        let unit = if self.milli { "MN" } else { "N" };
        let form = if self.with_unit { "FULL" } else { "NUM" };
        format!("V1.00;{unit};CUR;FLTC8;FLTP1;AOUT{:02};AOFF5;{form};MIT;POL;B0", self.auto_output)
    }
}

fn chosen(choice: &str) -> Result<bool, &'static str> {
    match choice {
        "0" => Ok(false),
        "1" => Ok(true),
        _ => Err(INVALID_SPECIFIER),
    }
}

impl BoardFirmware for Mark10 {
    fn device(&self) -> SceneDevice {
        SceneDevice::LoadCell
    }

    fn port(&self) -> Port {
        Port::serial(BAUD)
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        match self.auto_output {
            0 => None,
            1 => Some(1.0 / f64::from(RATE_OF_ONE)),
            rate => Some(1.0 / f64::from(rate)),
        }
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let force_n = self.force_n(scene, now_s) - self.zero_n;
        let value = match (self.unsigned, self.inverted) {
            (true, _) => force_n.abs(),
            (false, true) => -force_n,
            (false, false) => force_n,
        };
        let step = self.step();
        // plus zero: never -0
        vec![(self.scale.number(value) * self.per_newton() / step).round() * step + 0.0]
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        [self.text(reading).as_bytes(), LINE_END].concat()
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        while let Some(end) = inbox.iter().position(|&byte| byte == b'\r') {
            let request: Vec<u8> = inbox.drain(..=end).filter(|byte| !matches!(byte, b'\r' | b'\n')).collect();
            if !request.is_empty() {
                return Some(request);
            }
        }
        None
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        let answer = match self.run(&String::from_utf8_lossy(request), scene, now_s) {
            Ok(None) => return Vec::new(),
            Ok(Some(answer)) => answer,
            Err(code) => code.to_owned(),
        };
        [answer.as_bytes(), LINE_END].concat()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulator::lines::SerialBoard;
    use crate::emulator::lines::tests::{listen, opened};
    use crate::emulator::tests::{Wire, pressed, scene, shared};
    use palpate_link::time::Instant;
    use std::time::Duration;

    fn answers(force_n: f64, requests: &str) -> String {
        let (mut watched_cell, mut scene) = (Mark10::new(10.0), pressed(force_n));
        let mut inbox = requests.as_bytes().to_vec();
        let mut answers = Vec::new();
        while let Some(request) = watched_cell.take_request(&mut inbox) {
            answers.extend(watched_cell.answer(&request, &mut scene, 1.0));
        }
        assert!(inbox.is_empty() || !inbox.contains(&b'\r'));
        String::from_utf8(answers).expect("text")
    }

    #[test]
    fn a_reading_is_rounded_to_the_step_of_the_gauge_and_has_its_unit() {
        assert_eq!(answers(1.2344, "?\r"), "1.234 N\r\n");
        assert_eq!(answers(1.2351, "?C\r\n"), "1.236 N\r\n");
        assert_eq!(answers(1.2344, "NUM\r?\rFULL\r?\r"), "1.234\r\n1.234 N\r\n");
        assert_eq!(answers(1.2344, "MN\r?\r"), "1234 mN\r\n");
        assert_eq!(answers(20.0, "?\r"), "11.000 N\r\n");
    }

    #[test]
    fn zero_and_polarity_are_as_the_manual_states() {
        let (mut watched_cell, mut scene) = (Mark10::new(10.0), pressed(1.0));
        assert_eq!(watched_cell.answer(b"Z", &mut scene, 1.0), b"");
        assert_eq!(watched_cell.answer(b"?", &mut scene, 1.0), b"0.000 N\r\n");
        let mut no_load = crate::emulator::tests::scene();
        assert_eq!(watched_cell.answer(b"?", &mut no_load, 1.0), b"-1.000 N\r\n");
        assert_eq!(answers(1.0, "IPOL1\r?\rOPOL1\r?\r"), "-1.000 N\r\n1.000 N\r\n");
    }

    #[test]
    fn errors_have_the_codes_of_the_manual() {
        assert_eq!(answers(0.5, "HELLO\r"), "*10\r\n");
        assert_eq!(answers(0.5, "?PT\rLB\r"), "*11\r\n*11\r\n");
        assert_eq!(answers(0.5, "AOUT3\rAOUT\rIPOL2\r"), "*12\r\n*12\r\n*12\r\n");
        assert_eq!(answers(0.5, "AOUT50\rN\rCUR\rCLR\r\r\n\r"), "");
        assert_eq!(answers(0.5, "AOUT50\rLIST\r"), "V1.00;N;CUR;FLTC8;FLTP1;AOUT50;AOFF5;FULL;MIT;POL;B0\r\n");
    }

    #[test]
    fn aout_pushes_readings_and_ends_with_0() {
        let (mut watched_cell, mut scene) = (opened(SerialBoard::new(Mark10::new(10.0))), pressed(0.5));
        assert!(listen(&mut watched_cell, &mut scene, 0.0, 1.0).is_empty());
        for (command, per_second) in [("AOUT50", 50), ("AOUT1", 50), ("AOUT250", 250), ("AOUT0", 0)] {
            use crate::emulator::Instrument;
            let from_s = watched_cell.sent().next_back().map_or(1.0, |sent| sent.last_byte_s.ceil());
            assert_eq!(watched_cell.answer(command.as_bytes(), &mut scene, from_s), b"");
            let heard = listen(&mut watched_cell, &mut scene, from_s, from_s + 1.0);
            let bytes: Vec<u8> = heard.into_iter().flat_map(|(_, bytes)| bytes).collect();
            let lines = bytes.split(|&byte| byte == b'\n').filter(|line| *line == b"0.500 N\r").count();
            assert!(lines.abs_diff(per_second) <= 1, "{command}: {lines}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_question_during_continuous_output_never_splits_a_line() {
        let watched_cell = SerialBoard::new(Mark10::new(10.0)).on(Port::serial(2400.0));
        let mut wire = Wire::to(shared(watched_cell), shared(scene()), Instant::now());
        wire.send(b"AOUT25\r").await;
        for _ in 0..100 {
            wire.send(b"HELLO\r").await;
            palpate_link::time::sleep(Duration::from_millis(37)).await;
        }
        let heard = String::from_utf8(wire.ask(b"", 1200).await).expect("text");
        let of = |line: &str| heard.lines().filter(|heard| *heard == line).count();
        let (readings, errors, all) = (of("0.000 N"), of("*10"), heard.lines().count());
        assert!(readings > 70 && errors > 70, "{readings} {errors}");
        assert!(all - readings - errors <= 1, "{heard}");
    }
}
