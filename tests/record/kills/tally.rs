//! Sums of the results of trials.

use std::fmt::{self, Display, Formatter};
use std::ops::AddAssign;

/// Results of some trials.
#[derive(Default)]
pub(super) struct KillTally {
    pub trials: usize,
    pub kills: usize,
    /// Kills before the folder existed, and the remaining drafts.
    pub early: usize,
    pub drafts: usize,
    /// Presses that were in the journal at the kill and not yet acknowledged.
    pub unacknowledged: usize,
    /// Presses that were acknowledged before the last session.
    pub acknowledged: usize,
    /// Acknowledged rows that are missing, have other values, or were made again.
    pub lost: usize,
    pub changed: usize,
    pub again: usize,
    /// Rows that differ from those of an uninterrupted run, on a specimen without memory.
    pub other: usize,
    pub first: Option<String>,
}

impl KillTally {
    pub(super) fn assert_clean(&self) {
        assert_eq!((self.lost, self.changed, self.again, self.other), (0, 0, 0, 0), "{self}; {:?}", self.first);
    }
}

impl AddAssign for KillTally {
    fn add_assign(&mut self, more: KillTally) {
        for (sum, part) in [
            (&mut self.trials, more.trials),
            (&mut self.kills, more.kills),
            (&mut self.early, more.early),
            (&mut self.drafts, more.drafts),
            (&mut self.unacknowledged, more.unacknowledged),
            (&mut self.acknowledged, more.acknowledged),
            (&mut self.lost, more.lost),
            (&mut self.changed, more.changed),
            (&mut self.again, more.again),
            (&mut self.other, more.other),
        ] {
            *sum += part;
        }
        self.first = self.first.take().or(more.first);
    }
}

impl Display for KillTally {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let KillTally {
            trials, kills, early, drafts, unacknowledged, acknowledged, lost, changed, again, other, ..
        } = self;
        write!(f, "{kills} kills in {trials} trials, {early} before there was a folder ({drafts} drafts left); ")?;
        write!(f, "{acknowledged} presses acknowledged, {unacknowledged} kept that were not; rows: {lost} lost, ")?;
        write!(f, "{changed} changed, {again} made again, {other} not as in a run that nothing interrupts")
    }
}
