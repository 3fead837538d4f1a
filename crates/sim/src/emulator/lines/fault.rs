//! Faults of a board and of its line: damaged lines, pauses and resets.

use super::LINE_END;
use palpate_core::quantity::RandomStream;
use rand::RngExt;

/// Largest number of bytes that one damage drops.
const DROPPED_MOST: usize = 3;

/// Damage to a fraction of the lines.
#[derive(Clone, Debug, PartialEq)]
pub struct Damage {
    /// Fraction of the lines that are damaged, 0 to 1.
    pub fraction: f64,
    /// Kinds of damage, one of which is drawn for each damaged line. If empty, no line is damaged.
    pub kinds: Vec<DamageKind>,
    /// Seed of the random stream.
    pub seed: u64,
}

/// Kind of damage to a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DamageKind {
    /// One to three bytes that follow each other are missing.
    Dropped,
    /// One bit is inverted.
    Flipped,
    /// The end of the line is missing, so the next line continues it.
    Merged,
    /// The last bytes before the end of the line are missing.
    Cut,
}

impl DamageKind {
    /// All kinds.
    pub const ALL: [DamageKind; 4] = [DamageKind::Dropped, DamageKind::Flipped, DamageKind::Merged, DamageKind::Cut];
}

impl Damage {
    /// Damages a line, or leaves it unchanged. Returns whether it is damaged.
    pub(super) fn strike(&self, line: &mut Vec<u8>, rng: &mut RandomStream) -> bool {
        let text = line.len().saturating_sub(LINE_END.len());
        if text == 0 || self.kinds.is_empty() || !rng.random_bool(self.fraction.clamp(0.0, 1.0)) {
            return false;
        }
        match self.kinds[rng.random_range(0..self.kinds.len())] {
            DamageKind::Dropped => {
                let from = rng.random_range(0..line.len());
                let to = (from + rng.random_range(1..=DROPPED_MOST)).min(line.len());
                line.drain(from..to);
            }
            DamageKind::Flipped => {
                let at = rng.random_range(0..line.len());
                line[at] ^= 1 << rng.random_range(0..8);
            }
            DamageKind::Merged => line.truncate(text),
            DamageKind::Cut => drop(line.drain(rng.random_range(0..text)..text)),
        }
        true
    }
}

/// A fault that begins at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LineFault {
    /// Kind of the fault.
    pub kind: LineFaultKind,
    /// Time at which it begins, s.
    pub at_s: f64,
    /// Its duration, s.
    pub for_s: f64,
}

/// Kind of a fault that begins at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFaultKind {
    /// The board sends nothing, then continues with new readings.
    Stops,
    /// The board continues, but its adapter withholds the bytes. Then all of them arrive at once.
    Withholds,
    /// The board is reset: it boots for the duration, then starts again.
    Resets,
}

/// Faults of one board that may still happen.
#[derive(Default)]
pub(super) struct LineFaults(Vec<LineFault>);

impl LineFaults {
    pub(super) fn add(&mut self, fault: LineFault) {
        self.0.push(fault);
    }

    /// End of a fault of this kind that is present at `at_s`, s.
    pub(super) fn end_s(&self, kind: LineFaultKind, at_s: f64) -> Option<f64> {
        let ends = self.0.iter().filter(|fault| fault.kind == kind && fault.at_s <= at_s);
        ends.map(|fault| fault.at_s + fault.for_s).filter(|&end_s| at_s < end_s).reduce(f64::max)
    }

    /// Time of the next reset, s; infinite if there is none.
    pub(super) fn next_reset_s(&self) -> f64 {
        self.resets().map(|(_, fault)| fault.at_s).fold(f64::INFINITY, f64::min)
    }

    /// Takes the first reset up to `until_s`.
    pub(super) fn take_reset(&mut self, until_s: f64) -> Option<LineFault> {
        let first = self.resets().min_by(|(_, a), (_, b)| a.at_s.total_cmp(&b.at_s));
        let (index, _) = first.filter(|(_, fault)| fault.at_s <= until_s)?;
        Some(self.0.swap_remove(index))
    }

    fn resets(&self) -> impl Iterator<Item = (usize, &LineFault)> {
        self.0.iter().enumerate().filter(|(_, fault)| fault.kind == LineFaultKind::Resets)
    }
}
