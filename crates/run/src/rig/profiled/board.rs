//! A board that sends what a line profile reads.

use super::cell::ProfiledCell;
use super::response::ArrayResponse;
use palpate_core::quantity::Range;
use palpate_drivers::lines::{ForceColumns, ForceField, LineFraming, LineProfile};
use palpate_sim::emulator::lines::{BoardFirmware, Port};
use palpate_sim::scene::{Scene, SceneDevice};

/// Steps of a printed number in the range of its force, and in that of an output.
const FORCE_STEPS: f64 = 10_000.0;
const OUTPUT_STEPS: f64 = 1000.0;

/// Most decimals of a printed number.
const DECIMALS_MOST: i32 = 9;

/// Time that most boards need after their port was opened, s, and its largest part of the time that the profile grants: a bootloader
/// waits for a new program.
const BOOT_S: f64 = 1.7;
const BOOT_PART: f64 = 0.5;

/// A board that only its profile knows. It sends by itself, after the command at the start if there is one, or answers the profile's
/// question. Columns without a meaning are 0.
pub(in crate::rig) struct ProfiledBoard {
    profile: LineProfile,
    device: SceneDevice,
    hz: f64,
    cell: Option<ProfiledCell>,
    outputs: Option<ArrayResponse>,
    is_started: bool,
    sent: f64,
}

impl ProfiledBoard {
    /// Creates a board that sends `hz` readings per second. Without a load cell or outputs, their columns stay at rest.
    pub(in crate::rig) fn new(
        profile: LineProfile,
        hz: f64,
        cell: Option<ProfiledCell>,
        outputs: Option<ArrayResponse>,
    ) -> Self {
        let device = if cell.is_some() { SceneDevice::LoadCell } else { SceneDevice::Array };
        ProfiledBoard { profile, device, hz, cell, outputs, is_started: false, sent: 0.0 }
    }

    /// Checks that the profile reads what it writes, and that its numbers can hold the forces of a run.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub(in crate::rig) fn check(&self) -> Result<(), String> {
        if let Some((cell, force)) = self.cell.as_ref().zip(self.profile.force.as_ref()) {
            for column in force.columns.all() {
                cell.check(|force_n| force.number(force_n), force_range(&self.profile, force, *column))?;
            }
        }
        let reading = self.numbers(&[0.0; 3], false, &vec![0.0; self.output_count()], false, 0.0);
        if self.profile.reads_back(&reading) {
            return Ok(());
        }
        Err("its profile doesn't read the reading without load that it describes: correct its [text] or [frame], or `possible`"
            .to_owned())
    }

    fn output_count(&self) -> usize {
        self.profile.outputs.as_ref().map_or(0, |outputs| outputs.columns.len())
    }

    /// Returns the numbers of a reading.
    fn numbers(&self, forces_n: &[f64; 3], is_beyond: bool, outputs: &[f64], is_value: bool, now_s: f64) -> Vec<f64> {
        let profile = &self.profile;
        let mut numbers = vec![0.0; profile.columns()];
        let mut set = |column: usize, number: f64| {
            if let Some(place) = numbers.get_mut(column) {
                *place = number;
            }
        };
        if let (Some(own), Some(response)) = (&profile.outputs, &self.outputs) {
            for (column, output) in own.columns.iter().zip(outputs) {
                let span = own.possible.map_or(1.0 / own.scale, |possible| possible.width());
                set(*column, self.rounded(response.number(*output, is_value), span, OUTPUT_STEPS));
            }
        }
        if let Some(force) = &profile.force {
            let range_n = self.cell.as_ref().map_or(1.0, ProfiledCell::range_n);
            let span = range_n / force.newton_per_unit.unwrap_or(1.0);
            let count = if matches!(force.columns, ForceColumns::One(_)) { 1 } else { 3 };
            for (column, force_n) in force.columns.all().iter().zip(&forces_n[..count]) {
                let number = within(force.number(*force_n), force_range(profile, force, *column));
                set(*column, self.rounded(number, span, FORCE_STEPS));
            }
        }
        if let Some(status) = profile.status {
            set(status.column, if is_beyond { status.saturated_mask as f64 } else { 0.0 });
        }
        if let Some(time) = profile.time {
            let ticks = (now_s / time.unit_s).floor();
            set(time.column, wrapped(ticks, profile.whole_range(time.column)));
        }
        if let Some(counter) = &profile.counter {
            let count = self.sent * counter.step.unwrap_or(1.0);
            set(counter.column, wrapped(count, profile.whole_range(counter.column)));
        }
        numbers
    }

    /// Rounds a printed number to its decimals, as many as resolve a part of its span.
    fn rounded(&self, number: f64, span: f64, steps: f64) -> f64 {
        if matches!(self.profile.framing, LineFraming::Frame(_)) {
            return number; // its type rounds it
        }
        let decimals = (steps / span.abs()).log10().ceil().clamp(0.0, f64::from(DECIMALS_MOST)) as i32;
        let places = 10f64.powi(decimals);
        (number * places).round() / places
    }
}

/// Returns the ends of a force's numbers; `None` if there are none.
fn force_range(profile: &LineProfile, force: &ForceField, column: usize) -> Option<Range> {
    match (profile.whole_range(column), force.saturated_at) {
        (Some(own), Some(ends)) => Some(Range { min: own.min.max(ends.min), max: own.max.min(ends.max) }),
        (own, ends) => own.or(ends),
    }
}

fn within(number: f64, range: Option<Range>) -> f64 {
    range.map_or(number, |range| number.max(range.min).min(range.max))
}

/// Returns a count that begins again at the end of its type.
fn wrapped(count: f64, range: Option<Range>) -> f64 {
    range.map_or(count, |range| range.min + (count - range.min).rem_euclid(range.width() + 1.0))
}

impl BoardFirmware for ProfiledBoard {
    fn device(&self) -> SceneDevice {
        self.device
    }

    /// The rate is that of the link.
    fn port(&self) -> Port {
        if self.profile.is_packets() {
            return Port::datagrams();
        }
        Port { boot_s: Some(BOOT_S.min(BOOT_PART * self.profile.start_s)), ..Port::native_usb(0.0) }
    }

    fn start(&mut self) -> Vec<u8> {
        (self.is_started, self.sent) = (false, 0.0);
        Vec::new()
    }

    fn period_s(&self, _: &Scene) -> Option<f64> {
        let is_silent = self.profile.ask.is_some() || self.profile.on_start.is_some() && !self.is_started;
        (!is_silent).then(|| 1.0 / self.hz)
    }

    fn read(&mut self, scene: &mut Scene, now_s: f64) -> Vec<f64> {
        let (forces_n, is_beyond) = self.cell.map_or(([0.0; 3], false), |cell| cell.read(scene, now_s));
        let mut outputs = vec![0.0; self.output_count()];
        if self.outputs.is_some() && outputs.len() == scene.taxels() {
            scene.outputs(now_s, &mut outputs);
        }
        self.sent += 1.0;
        self.numbers(&forces_n, is_beyond, &outputs, scene.is_monitored(), now_s)
    }

    fn line(&self, reading: &[f64]) -> Vec<u8> {
        self.profile.write(reading)
    }

    fn take_request(&mut self, inbox: &mut Vec<u8>) -> Option<Vec<u8>> {
        let known = [self.profile.ask.as_deref().map(str::as_bytes), self.profile.on_start.as_deref()];
        let found = known.into_iter().flatten().filter(|command| !command.is_empty()).filter_map(|command| {
            let at = inbox.windows(command.len()).position(|part| part == command)?;
            Some((at, command.len()))
        });
        let (at, length) = found.min()?;
        let request = inbox[at..at + length].to_vec();
        inbox.drain(..at + length);
        Some(request)
    }

    fn answer(&mut self, request: &[u8], scene: &mut Scene, now_s: f64) -> Vec<u8> {
        if self.profile.ask.as_deref().map(str::as_bytes) == Some(request) {
            let reading = self.read(scene, now_s);
            return self.line(&reading);
        }
        self.is_started = true;
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::{SIM_RIG, parse};
    use palpate_core::parallel::lock;

    const FRAME: &str = "name = \"a\"\non_start = \"go\"\n[frame]\nhead = \"AA\"\nnumbers = [\"u8\", \"u16\", \"i16\", \"u16\"]\n\
        [counter]\ncolumn = 1\nstep = 100\n[status]\ncolumn = 2\nsaturated_mask = 4\n[force]\ncolumn = 3\n\
        newton_per_unit = 0.001\noffset = 7.0\n[time]\ncolumn = 4\nunit_s = 0.001\n";

    /// A board of a profile in the rig of the paper, with a cell of this range, and the scene.
    fn board(text: &str, range_n: Option<f64>) -> (ProfiledBoard, palpate_sim::emulator::Shared<Scene>) {
        let rig = parse("rig.toml", SIM_RIG, &|_| Err(std::io::ErrorKind::NotFound.into())).expect("the shipped rig");
        let profile = LineProfile::parse("a.toml", text).map_err(|problems| problems.lines()).expect("a profile");
        let cell = ProfiledCell::new(&rig, false, range_n);
        (ProfiledBoard::new(profile, 50.0, Some(cell), None), rig.emulators(1).expect("emulators").scene)
    }

    #[test]
    fn counts_and_times_begin_again_and_a_state_reports_a_force_beyond_the_range() {
        // the noise of the cell is more than that
        let (mut own, scene) = board(FRAME, Some(1e-6));
        let mut read = |now_s| own.read(&mut lock(&scene), now_s);
        let first = read(1.0);
        assert_eq!((&first[..2], first[3]), (&[100.0, 4.0][..], 1000.0));
        assert!((first[2] - 7.0).abs() < 0.0011, "{first:?}");
        assert_eq!(read(65.536)[..2], [200.0, 4.0]);
        assert_eq!([read(65.536)[0], read(65.6)[3]], [300.0 - 256.0, 64.0]);
        let (mut own, scene) = board(FRAME, None);
        assert_eq!(own.read(&mut lock(&scene), 0.0)[1], 0.0);
    }

    #[test]
    fn a_board_begins_after_its_command_or_answers_its_question() {
        let (mut own, scene) = board(FRAME, None);
        let mut scene = lock(&scene);
        assert_eq!(own.period_s(&scene), None);
        let mut inbox = b"xgo?".to_vec();
        let request = own.take_request(&mut inbox).expect("the command");
        assert_eq!((own.answer(&request, &mut scene, 0.0), inbox.as_slice()), (Vec::new(), &b"?"[..]));
        assert_eq!(own.period_s(&scene), Some(0.02));
        own.start();
        assert_eq!(own.period_s(&scene), None);
        let (mut asked, _) = board(
            "name = \"a\"\nask = \"?\"\n[text]\ncolumns = 1\nafter = \" N\"\n[force]\nnewton_per_unit = 1\n",
            None,
        );
        assert_eq!((asked.period_s(&scene), asked.take_request(&mut Vec::new())), (None, None));
        let request = asked.take_request(&mut inbox).expect("the question");
        let answer = String::from_utf8(asked.answer(&request, &mut scene, 0.0)).expect("text");
        let (number, unit) = answer.split_once(' ').expect("a number and a unit");
        assert_eq!(unit, "N\r\n");
        assert!(number.parse::<f64>().expect("a number").abs() < 0.05 && number.len() <= "-0.0000".len(), "{answer}");
    }

    #[test]
    fn a_profile_that_reads_nothing_of_what_it_describes_is_refused() {
        let text = "name = \"a\"\n[text]\ncolumns = 2\nseparator = \"0\"\n[force]\nnewton_per_unit = 1.0\n";
        let why = board(text, None).0.check().expect_err("zeros between zeros");
        assert!(why.contains("correct its [text] or [frame]"), "{why}");
    }
}
