//! Inputs of the device: their names, ranges and conversion.

use super::errors::DaqmxStatus;
use palpate_link::wire::daqmx::{DIFF, NRSE, RSE};

/// Inputs of a USB-6343: from `ai0` on, each relative to ground.
pub(super) const INPUTS: u32 = 32;
/// `DAQmx_Val_Cfg_Default`: differential if the input allows it, otherwise against ground.
const DEFAULT_TERMINAL: i32 = -1;
/// Difference between the numbers of the two inputs of a differential pair.
const PAIR: u32 = 8;
/// Ranges of an input, +- V.
const RANGES_V: [f64; 4] = [0.2, 1.0, 5.0, 10.0];
/// Number of steps from 0 to the end of a range: 16 bits with both signs.
const STEPS: f64 = 32_768.0;
/// Largest excess of a requested range over an existing range that counts as rounding, V.
const ROUNDING_V: f64 = 1e-9;

/// One channel of a task: an input relative to ground or to another input, in a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TaskChannel {
    pub input: u32,
    /// Input that it is measured against; `None`: ground.
    pub against: Option<u32>,
    range_v: f64,
}

impl TaskChannel {
    pub(super) fn new(input: u32, terminal: i32, least_v: f64, most_v: f64) -> Result<Self, DaqmxStatus> {
        // ai0 to ai7 and ai16 to ai23
        let paired = input % (2 * PAIR) < PAIR;
        let against = match terminal {
            RSE | NRSE => None,
            DIFF if paired => Some(input + PAIR),
            DEFAULT_TERMINAL => paired.then_some(input + PAIR),
            _ => return Err(DaqmxStatus::BAD_VALUE),
        };
        let widest_v = least_v.abs().max(most_v.abs());
        let range_v = RANGES_V.into_iter().find(|range_v| widest_v <= range_v + ROUNDING_V);
        match range_v {
            Some(range_v) if least_v < most_v => Ok(TaskChannel { input, against, range_v }),
            _ => Err(DaqmxStatus::BAD_VALUE),
        }
    }

    /// Returns the converter's result for a voltage, V.
    pub(super) fn convert(&self, volts: f64) -> f64 {
        let step_v = self.range_v / STEPS;
        (volts / step_v).round().clamp(-STEPS, STEPS - 1.0) * step_v
    }
}

/// Returns the inputs of `Dev1/ai0`, `Dev1/ai0:8` or a comma-separated list of these, in order.
pub(super) fn inputs(physical: &str, device: &str) -> Result<Vec<u32>, DaqmxStatus> {
    let mut inputs = Vec::new();
    for part in physical.split(',') {
        let (name, input) = part.trim().split_once('/').ok_or(DaqmxStatus::NO_SUCH_DEVICE)?;
        if !name.eq_ignore_ascii_case(device) {
            return Err(DaqmxStatus::NO_SUCH_DEVICE);
        }
        let (first, last) = input.split_once(':').unwrap_or((input, input));
        let first = number(first).ok_or(DaqmxStatus::NO_SUCH_INPUT)?;
        let last =
            number(last).or(last.parse().ok()).filter(|last| *last < INPUTS).ok_or(DaqmxStatus::NO_SUCH_INPUT)?;
        if first <= last { inputs.extend(first..=last) } else { inputs.extend((last..=first).rev()) }
    }
    Ok(inputs)
}

/// Number of an input with a name such as `ai7`.
fn number(name: &str) -> Option<u32> {
    let (ai, digits) = name.split_at_checked(2)?;
    let number = digits.parse().ok().filter(|number| *number < INPUTS);
    number.filter(|_| ai.eq_ignore_ascii_case("ai"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_named_alone_in_ranges_and_in_lists() {
        let dev1 = |physical: &str| inputs(physical, "Dev1");
        assert_eq!(dev1("Dev1/ai3"), Ok(vec![3]));
        assert_eq!(dev1("dev1/AI30:31, Dev1/ai2:0"), Ok(vec![30, 31, 2, 1, 0]));
        assert_eq!(dev1("Dev1/ai0:ai1"), Ok(vec![0, 1]));
        for bad in ["Dev2/ai0", "ai0", "", "Dev1/ai0,,Dev1/ai1"] {
            assert_eq!(dev1(bad), Err(DaqmxStatus::NO_SUCH_DEVICE), "{bad}");
        }
        for bad in ["Dev1/ai32", "Dev1/ao0", "Dev1/ai", "Dev1/ai0:4294967295", "Dev1/ai0:", "Dev1/aé"] {
            assert_eq!(dev1(bad), Err(DaqmxStatus::NO_SUCH_INPUT), "{bad}");
        }
    }

    #[test]
    fn differential_inputs_are_those_of_the_manual() {
        let diff: Vec<u32> = (0..INPUTS).filter(|&input| TaskChannel::new(input, DIFF, -1.0, 1.0).is_ok()).collect();
        assert_eq!(diff, (0..8).chain(16..24).collect::<Vec<_>>());
        let default = |input| TaskChannel::new(input, DEFAULT_TERMINAL, -1.0, 1.0).map(|channel| channel.against);
        assert_eq!((default(17), default(8)), (Ok(Some(25)), Ok(None)));
    }

    #[test]
    fn the_range_is_the_least_that_holds_what_is_asked_for_and_clips() {
        for (least_v, most_v, step_v) in
            [(-0.2, 0.1, 6.1e-6), (0.0, 1.0, 30.5e-6), (-5.0, 2.0, 153e-6), (0.0, 10.0, 305e-6)]
        {
            let channel = TaskChannel::new(0, RSE, least_v, most_v).expect("a range");
            let range_v = channel.range_v;
            assert!((channel.convert(step_v * 0.9) - step_v).abs() < step_v / 100.0, "{range_v}");
            assert_eq!((channel.convert(-99.0), channel.convert(99.0)), (-range_v, range_v * 32_767.0 / STEPS));
        }
        for (least_v, most_v) in [(-10.1, 1.0), (1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
            assert_eq!(TaskChannel::new(0, RSE, least_v, most_v), Err(DaqmxStatus::BAD_VALUE), "{least_v} to {most_v}");
        }
    }
}
