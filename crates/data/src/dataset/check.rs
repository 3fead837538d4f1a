//! Check of a run: a press of a place that was pressed before, compared with the first press there.

use super::RecordedContact;
use serde::{Deserialize, Serialize};

/// A check, as its journal keeps it. It is no press of the plan: no table, evaluation or count contains it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RecordedCheck {
    /// Number of the check, from 0.
    pub number: u64,
    /// Press of the plan that the check repeats.
    pub reference: u64,
    /// Whether the plan was done before the check.
    pub at_end: bool,
    /// The press of the check. Its rows have the phase `check` and the number of the check.
    pub contact: RecordedContact,
    /// Change of the outputs for each newton; `None` if the outputs weren't measured.
    pub outputs: Option<CheckChange>,
    /// Change of the outputs' pattern; `None` if the outputs weren't measured.
    pub pattern: Option<CheckChange>,
    /// Change of the depth for the force; `None` if no depth was measured.
    pub depth: Option<CheckChange>,
    /// Largest change of the load cell that the check leaves possible, as a fraction of the force.
    pub cell: f64,
    /// First press since the last check that passed, in the order of measurement; only of a check that failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubtful_from: Option<u64>,
}

/// Change since the first press at the place of a check, and its limit, both as differences of logarithms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckChange {
    /// The change.
    pub by: f64,
    /// Largest change of a check that passes.
    pub limit: f64,
}

impl CheckChange {
    /// Whether the change is within its limit.
    fn is_within(&self) -> bool {
        self.by.abs() <= self.limit
    }
}

impl RecordedCheck {
    /// Whether something has changed by more than its limit, or the outputs weren't measured.
    pub fn is_failed(&self) -> bool {
        let compared = [self.outputs, self.pattern, self.depth];
        self.outputs.is_none() || compared.iter().flatten().any(|change| !change.is_within())
    }

    /// Returns the result in one line.
    pub fn line(&self) -> String {
        let at = if self.at_end { "at the end".to_owned() } else { format!("{} during the run", self.number + 1) };
        let Some(from) = self.doubtful_from else {
            let shown = |change: CheckChange| format!("{:+.1} %", 100.0 * change.by);
            let parts = [("outputs for each newton", self.outputs), ("depth", self.depth)];
            let parts: Vec<String> =
                parts.into_iter().filter_map(|(name, change)| Some(format!("{name} {}", shown(change?)))).collect();
            return format!("check {at}: {}", parts.join(", "));
        };
        let names = [
            ("outputs for each newton differ", self.outputs),
            ("the pattern of the outputs differs", self.pattern),
            ("the depth for the force differs", self.depth),
        ];
        let beyond = names.into_iter().filter_map(|(name, change)| Some((name, change.filter(|it| !it.is_within())?)));
        let beyond: Vec<String> = beyond
            .map(|(name, CheckChange { by, limit })| {
                format!("{name} by {:.0} %, limit {:.0} %", 100.0 * by.abs(), 100.0 * limit)
            })
            .collect();
        let why = if beyond.is_empty() { "the outputs weren't measured".to_owned() } else { beyond.join(", ") };
        format!("check failed {at}: {why}; presses from {from} on are doubtful")
    }
}

/// Standard uncertainty of a force by a change of the load cell during the run, N. The change may have come at any time between
/// two checks: rectangular, with its full width.
pub(super) fn cell_u_n(cell: f64, force_n: f64) -> f64 {
    (cell * force_n).abs() / 12.0f64.sqrt()
}

#[cfg(test)]
pub(super) fn example(by: f64) -> RecordedCheck {
    let change = |by| Some(CheckChange { by, limit: 0.25 });
    let doubtful_from = (by.abs() > 0.25).then_some(1);
    RecordedCheck {
        number: 0,
        reference: 0,
        at_end: true,
        contact: RecordedContact::default(),
        outputs: change(by),
        pattern: change(0.01),
        depth: change(-0.002),
        cell: by.abs(),
        doubtful_from,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_is_printed_as_one_line() {
        assert_eq!(example(0.004).line(), "check at the end: outputs for each newton +0.4 %, depth -0.2 %");
        assert!(!example(0.004).is_failed());
        let failed = example(-0.48);
        assert!(failed.is_failed());
        assert_eq!(
            failed.line(),
            "check failed at the end: outputs for each newton differ by 48 %, limit 25 %; presses from 1 on are doubtful"
        );
        let unmeasured = RecordedCheck { outputs: None, pattern: None, doubtful_from: Some(7), ..failed };
        assert!(unmeasured.is_failed() && unmeasured.line().contains("weren't measured"), "{}", unmeasured.line());
    }

    #[test]
    fn a_change_at_an_unknown_time_is_rectangular() {
        assert!((cell_u_n(0.01, 2.0) - 0.02 / 12.0f64.sqrt()).abs() < 1e-15);
    }
}
